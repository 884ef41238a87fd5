//! Which image belongs to which sweep when sensors run at rates of their own.

/// An image and its moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shot {
    /// Index of the image in the caller's list.
    pub(super) image: usize,
    /// Seconds.
    pub(super) time: f64,
}

/// `[sweeps]` the image of one camera that belongs to each sweep: it is nearest to this sweep of all, at most `reach`
/// seconds away, and no other image of the camera is nearer to the sweep.
pub(super) fn image_of_each(sweeps: &[f64], shots: &[Shot], reach: f64) -> Vec<Option<usize>> {
    let mut nearest: Vec<Option<Shot>> = vec![None; sweeps.len()];
    for shot in shots {
        let distance = |sweep: usize| (sweeps[sweep] - shot.time).abs();
        let Some(sweep) = (0..sweeps.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b))) else { break };
        let nearer = nearest[sweep].is_none_or(|other| distance(sweep) < (sweeps[sweep] - other.time).abs());
        if nearer && distance(sweep) <= reach {
            nearest[sweep] = Some(*shot);
        }
    }
    nearest.into_iter().map(|shot| shot.map(|shot| shot.image)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_goes_to_its_nearest_sweep_and_a_sweep_keeps_its_nearest_image() {
        let shots: Vec<Shot> =
            [0.01, 0.06, 0.11, 0.30, 0.9].into_iter().enumerate().map(|(image, time)| Shot { image, time }).collect();
        assert_eq!(image_of_each(&[0.0, 0.1, 0.2, 0.3], &shots, 0.05), [Some(0), Some(2), None, Some(3)]);
        assert_eq!(image_of_each(&[0.0], &[], 0.05), [None]);
        assert!(image_of_each(&[], &shots, 0.05).is_empty());
    }
}
