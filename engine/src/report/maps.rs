//! What became of a clip's depth maps, in words.

use crate::gaussians::background::MapFit;

/// How well depth maps fitted the sweeps, as one line; `None` where there are none.
pub fn maps_in_words(fits: &[MapFit]) -> Option<String> {
    if fits.is_empty() {
        return None;
    }
    let used: Vec<&MapFit> = fits.iter().filter(|fit| fit.used).collect();
    let mut words = format!("{} of {} used", used.len(), fits.len());
    let percent = |error: f64| format!("{:.1} %", 100.0 * error);
    let mut errors: Vec<(f64, &MapFit)> = used.iter().filter_map(|fit| Some((fit.error?, *fit))).collect();
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    if let (Some((middle, _)), Some((worst, of))) = (errors.get(errors.len() / 2), errors.last()) {
        words += &format!(
            ", median error of the inverse depth at the returns {} (worst {}: frame {} {})",
            percent(*middle),
            percent(*worst),
            of.frame,
            of.camera
        );
    }
    if let Some(left_out) = fits.iter().find(|fit| !fit.used) {
        let why = left_out
            .error
            .map_or(format!("{} returns tell no scale", left_out.returns), |error| format!("error {}", percent(error)));
        words += &format!("; searched instead: frame {} {} ({why})", left_out.frame, left_out.camera);
        if fits.len() - used.len() > 1 {
            words += &format!(" and {} more", fits.len() - used.len() - 1);
        }
    }
    Some(words)
}

#[cfg(test)]
mod tests {
    use lgs_formats::clip::DepthKind;

    use super::*;

    fn fit(frame: usize, error: Option<f64>, used: bool) -> MapFit {
        let (camera, kind) = ("front".to_owned(), DepthKind::Relative);
        MapFit { frame, camera, kind, scale: 1.0, shift: 0.0, returns: 12, error, inliers: error, used }
    }

    #[test]
    fn the_middle_the_worst_and_what_is_left_out_are_named() {
        assert_eq!(maps_in_words(&[]), None);
        let good = maps_in_words(&[fit(0, Some(0.02), true), fit(1, Some(0.05), true), fit(2, Some(0.03), true)]);
        let want = "3 of 3 used, median error of the inverse depth at the returns 3.0 % (worst 5.0 %: frame 1 front)";
        assert_eq!(good.as_deref(), Some(want));
        let bad = maps_in_words(&[fit(0, Some(0.6), false), fit(3, None, false)]);
        assert_eq!(bad.as_deref(), Some("0 of 2 used; searched instead: frame 0 front (error 60.0 %) and 1 more"));
        let none = maps_in_words(&[fit(3, None, false)]);
        assert_eq!(none.as_deref(), Some("0 of 1 used; searched instead: frame 3 front (12 returns tell no scale)"));
    }
}
