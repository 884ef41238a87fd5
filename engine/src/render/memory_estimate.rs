//! How much the lists of a view's tiles will hold, before they are made.

use rayon::prelude::*;

use super::backward::Moments;
use super::project::Projector;
use super::tiles::{TileGrid, count_tiles};
use crate::allocator::available_for;
use crate::error::{EngineError, Result};
use crate::gaussians::GaussianSet;
use crate::gaussians::physical::{Splat, splat_of};
use crate::views::PinholeView;

/// Gaussians that stand for a scene, at most.
const MOST_SAMPLES: usize = 8192;
/// Bytes of an intersection, a Gaussian and a tile that it reaches: the tile twice, its place and its index.
const INTERSECTION: u64 = 4 * 4;
/// Bytes of its sums in the gradient pass.
const SUMS: u64 = size_of::<Moments>() as u64;
/// Bytes that nobody asks the system for.
const UNASKED: u64 = 1 << 30;
/// Intersections that a view's lists cannot count.
const TOO_MANY: u64 = 1 << 32;
/// What lowers the number of intersections: smaller images have fewer tiles.
const SETTING: &str = "image-size";

/// What the lists are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pass {
    /// The images alone.
    Images,
    /// The images and their gradient.
    Gradient,
}

/// How much drawing a scene takes, told by some of its Gaussians that are evenly chosen.
#[derive(Clone, Debug)]
pub struct MemoryEstimate {
    splats: Vec<Splat>,
    /// Gaussians that each stands for.
    each: usize,
}

impl MemoryEstimate {
    /// That of a set.
    pub fn of_set(set: &GaussianSet) -> Self {
        Self::of(set.len(), |i| splat_of(set, i))
    }

    /// That of physical values.
    pub fn of_splats(splats: &[Splat]) -> Self {
        Self::of(splats.len(), |i| splats[i])
    }

    fn of(num: usize, splat: impl Fn(usize) -> Splat) -> Self {
        let each = num.div_ceil(MOST_SAMPLES).max(1);
        Self { splats: (0..num).step_by(each).map(splat).collect(), each }
    }

    /// About how many intersections of a Gaussian and a tile of the view there are; exactly, in scenes that are small.
    pub fn num_intersections(&self, view: &PinholeView) -> u64 {
        let projector = Projector::new(view);
        let tiles = |splat: &Splat| projector.footprint(splat, 0).map_or(0, |footprint| count_tiles(&footprint, view));
        self.splats.par_iter().with_min_len(512).map(tiles).sum::<u64>().saturating_mul(self.each as u64)
    }

    /// Fails when the lists of a view cannot be counted in 32 bits or not be held by the memory that is free; what is not known counts as
    /// enough.
    ///
    /// # Errors
    /// [`EngineError::Setting`] and [`EngineError::TooLarge`] for the image size.
    pub fn check<'a>(&self, views: impl IntoIterator<Item = &'a PinholeView>, pass: Pass) -> Result<()> {
        let each = pass.intersection_bytes();
        let gaussians = (self.splats.len() as u64).saturating_mul(self.each as u64);
        for view in views {
            let most = gaussians.saturating_mul(TileGrid::of(view).num_tiles() as u64);
            if most.saturating_mul(each) > UNASKED {
                let count = self.num_intersections(view);
                check_intersections(view, count, each, available_for(count.saturating_mul(each)))?;
            }
        }
        Ok(())
    }
}

impl Pass {
    const fn intersection_bytes(self) -> u64 {
        match self {
            Self::Images => INTERSECTION,
            Self::Gradient => INTERSECTION + SUMS,
        }
    }
}

/// Fails when so many intersections of so many bytes cannot be counted, or not be held by what is available.
fn check_intersections(view: &PinholeView, count: u64, each: u64, available: Option<u64>) -> Result<()> {
    let need = count.saturating_mul(each);
    let size = format!("a view of {}x{} pixels", view.height, view.width);
    let found = format!("about {count} intersections of a Gaussian and a tile in {size}");
    if count >= TOO_MANY {
        let expected = "views whose tiles hold fewer than 2^32 Gaussians in all".to_owned();
        return Err(EngineError::Setting { setting: SETTING, expected, found });
    }
    match available.filter(|&free| need > UNASKED && need > free) {
        Some(free) => {
            Err(EngineError::TooLarge { setting: SETTING, what: "views that can be drawn", found, need, free })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::render_for_gradient;
    use crate::views::samples::ahead;

    fn view(width: usize, height: usize) -> PinholeView {
        ahead(width, height, 60.0)
    }

    /// Gaussians all over the view, from a pixel to several tiles large.
    fn scene(num: usize) -> Vec<Splat> {
        let at = |i: usize, salt: f32| (i as f32 * 12.9898 + salt).sin() * 43_758.547 % 1.0;
        let splat = |i: usize| Splat {
            mean: [8.0 * at(i, 0.1), 4.0 * at(i, 0.7), 4.0 + 2.0 * at(i, 1.3)],
            quat: [1.0, at(i, 2.0), at(i, 3.0), 0.2],
            scale: [0.5 * at(i, 4.0).abs(), 0.2, 0.05],
            opacity: 0.2 + 0.7 * at(i, 5.0).abs(),
            colour: [0.5; 3],
            velocity: [0.0; 3],
            time: 0.0,
        };
        (0..num).map(splat).collect()
    }

    #[test]
    fn few_gaussians_are_all_counted_and_many_are_told_by_some() {
        let view = view(400, 200);
        let [few, many] = [5000, 50_000].map(scene);
        let drawn = |splats: &[Splat]| render_for_gradient(splats, &view, [0.0; 3]).num_intersections() as u64;
        assert_eq!(MemoryEstimate::of_splats(&few).num_intersections(&view), drawn(&few));
        let (got, want) = (MemoryEstimate::of_splats(&many).num_intersections(&view) as f64, drawn(&many) as f64);
        assert!(want > 1e5 && (got / want - 1.0).abs() < 0.05, "{got} of {want}");
    }

    #[test]
    fn what_cannot_be_counted_or_held_is_refused() {
        let splats = vec![Splat { mean: [0.0, 0.0, 1.0], scale: [1e4; 3], ..scene(1)[0] }; 2000];
        let probes = MemoryEstimate::of_splats(&splats);
        assert!(probes.check([&view(320, 160)], Pass::Gradient).is_ok());
        let message = probes.check([&view(64, 64), &view(50_000, 50_000)], Pass::Images).unwrap_err().to_string();
        let counted = "image-size: expected views whose tiles hold fewer than 2^32 Gaussians in all, found about 9768";
        assert!(message.starts_with(counted) && message.ends_with("in a view of 50000x50000 pixels"), "{message}");
        let (each, seen) = (Pass::Gradient.intersection_bytes(), view(4, 2));
        let check = |count, available| check_intersections(&seen, count, each, available);
        assert!(check(1 << 30, Some(u64::MAX)).is_ok() && check(1 << 30, None).is_ok());
        let message = check(1 << 30, Some(9_000_000_000)).unwrap_err().to_string();
        assert!(message.contains("the 9000 MB") && message.ends_with("at least 60130 MB in all"), "{message}");
        assert!(check(u64::MAX, Some(u64::MAX)).is_err(), "products do not wrap");
        assert!(check(1000, Some(0)).is_ok(), "little is not asked for");
    }
}
