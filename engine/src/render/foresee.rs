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
const MOST_PROBES: usize = 8192;
/// Bytes of a pair of a Gaussian and a tile that it reaches: the tile twice, its place and its entry.
const PAIR: u64 = 4 * 4;
/// Bytes of its sums in the gradient pass.
const SUMS: u64 = size_of::<Moments>() as u64;
/// Bytes that nobody asks the system for.
const UNASKED: u64 = 1 << 30;
/// Pairs that a view's lists cannot count.
const TOO_MANY: u64 = 1 << 32;

/// What the lists are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pass {
    /// The images alone.
    Images,
    /// The images and their gradient.
    Gradient,
}

/// Gaussians, evenly chosen, that stand for a scene.
#[derive(Clone, Debug)]
pub struct Probes {
    splats: Vec<Splat>,
    /// Gaussians that each stands for.
    each: usize,
}

impl Probes {
    /// Those of a set.
    pub fn of_set(set: &GaussianSet) -> Self {
        Self::of(set.len(), |i| splat_of(set, i))
    }

    /// Those of physical values.
    pub fn of_splats(splats: &[Splat]) -> Self {
        Self::of(splats.len(), |i| splats[i])
    }

    fn of(num: usize, splat: impl Fn(usize) -> Splat) -> Self {
        let each = num.div_ceil(MOST_PROBES).max(1);
        Self { splats: (0..num).step_by(each).map(splat).collect(), each }
    }

    /// About how many pairs there are of a Gaussian and a tile of the view that it reaches; exactly, in scenes that are small.
    pub fn pairs(&self, view: &PinholeView) -> u64 {
        let projector = Projector::new(view);
        let tiles = |splat: &Splat| projector.footprint(splat, 0).map_or(0, |footprint| count_tiles(&footprint, view));
        self.splats.par_iter().with_min_len(512).map(tiles).sum::<u64>().saturating_mul(self.each as u64)
    }

    /// Nothing, when the lists of each view can be counted in 32 bits and held by the memory that is free; what is not known counts as enough.
    ///
    /// # Errors
    /// [`EngineError::Setting`] for `--image-size`: smaller images have fewer tiles.
    pub fn check<'a>(&self, views: impl IntoIterator<Item = &'a PinholeView>, pass: Pass) -> Result<()> {
        let each = pass.pair_bytes();
        let gaussians = (self.splats.len() as u64).saturating_mul(self.each as u64);
        for view in views {
            let most = gaussians.saturating_mul(TileGrid::of(view).num_tiles() as u64);
            if most.saturating_mul(each) > UNASKED {
                let pairs = self.pairs(view);
                check_pairs(pairs, each, available_for(pairs.saturating_mul(each)))
                    .map_err(|[expected, found]| refusal(view, expected, &found))?;
            }
        }
        Ok(())
    }
}

impl Pass {
    const fn pair_bytes(self) -> u64 {
        match self {
            Self::Images => PAIR,
            Self::Gradient => PAIR + SUMS,
        }
    }
}

/// Nothing, when so many pairs of so many bytes can be counted and held; else what was expected and what was found.
fn check_pairs(pairs: u64, each: u64, available: Option<u64>) -> std::result::Result<(), [String; 2]> {
    let bytes = pairs.saturating_mul(each);
    let found = format!("about {pairs} pairs of a Gaussian and a tile, at least {} MB", bytes.div_ceil(1_000_000));
    match available.filter(|&available| bytes > UNASKED && bytes > available) {
        _ if pairs >= TOO_MANY => Err(["views whose tiles hold fewer than 2^32 Gaussians in all".to_owned(), found]),
        Some(free) => {
            Err([format!("views that can be drawn in the {} MB of memory that are free", free / 1_000_000), found])
        }
        None => Ok(()),
    }
}

fn refusal(view: &PinholeView, expected: String, found: &str) -> EngineError {
    let found = format!("{found}, in a view of {}x{} pixels", view.height, view.width);
    EngineError::Setting { setting: "--image-size", expected, found }
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
        assert_eq!(Probes::of_splats(&few).pairs(&view), drawn(&few));
        let (got, want) = (Probes::of_splats(&many).pairs(&view) as f64, drawn(&many) as f64);
        assert!(want > 1e5 && (got / want - 1.0).abs() < 0.05, "{got} of {want}");
    }

    #[test]
    fn what_cannot_be_counted_or_held_is_refused() {
        let splats = vec![Splat { mean: [0.0, 0.0, 1.0], scale: [1e4; 3], ..scene(1)[0] }; 2000];
        let probes = Probes::of_splats(&splats);
        assert!(probes.check([&view(320, 160)], Pass::Gradient).is_ok());
        let message = probes.check([&view(64, 64), &view(50_000, 50_000)], Pass::Images).unwrap_err().to_string();
        let counted =
            "--image-size: expected views whose tiles hold fewer than 2^32 Gaussians in all, found about 9768";
        assert!(message.starts_with(counted) && message.ends_with("in a view of 50000x50000 pixels"), "{message}");
        let each = Pass::Gradient.pair_bytes();
        assert!(check_pairs(1 << 30, each, Some(u64::MAX)).is_ok() && check_pairs(1 << 30, each, None).is_ok());
        let [expected, found] = check_pairs(1 << 30, each, Some(9_000_000_000)).unwrap_err();
        assert!(expected.contains("the 9000 MB") && found.ends_with("at least 60130 MB"), "{expected}, {found}");
        assert!(check_pairs(u64::MAX, each, Some(u64::MAX)).is_err(), "products do not wrap");
        assert!(check_pairs(1000, each, Some(0)).is_ok(), "little is not asked for");
    }
}
