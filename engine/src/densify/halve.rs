//! The set after Gaussians went and others were halved, in both branches.

use crate::gaussians::{GaussianSet, split::halves};

/// What happens to a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// It stays as it is.
    Keep,
    /// It is taken out.
    Prune,
    /// Its halves take its place.
    Split,
}

/// The set after the changes; a second half stands behind all that its branch had.
///
/// # Shapes
/// `changes` and `axes` `[N]`; axes, 0 to 2, are those of what is split.
///
/// # Panics
/// When there are fewer changes than Gaussians, or no axis of one that is split.
pub fn change(set: &GaussianSet, changes: &[Change], axes: &[u8]) -> GaussianSet {
    let mut branches = [0..set.num_lidar, set.num_lidar..set.len()].map(|range| {
        let kept: Vec<usize> = range.clone().filter(|&i| changes[i] != Change::Prune).collect();
        let split: Vec<usize> = range.filter(|&i| changes[i] == Change::Split).collect();
        let mut rows = kept.clone();
        rows.extend(&split);
        let mut out = set.select(&rows, 0);
        for (row, &i) in out.attributes.iter_mut().zip(&kept) {
            if changes[i] == Change::Split {
                *row = halves(set, i, usize::from(axes[i]))[0];
            }
        }
        for (row, &i) in out.attributes[kept.len()..].iter_mut().zip(&split) {
            *row = halves(set, i, usize::from(axes[i]))[1];
        }
        out
    });
    let num_lidar = branches[0].len();
    let background = std::mem::take(&mut branches[1]);
    let mut all = std::mem::take(&mut branches[0]);
    all.append(&background);
    all.num_lidar = num_lidar;
    all
}
