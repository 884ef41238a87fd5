//! What is behind the pixels of the input views, turned to Gaussians one kind after another.

use lgs_formats::casts::to_u32;

use super::{
    Sheet, backstop,
    coverage::{Coverage, Shape},
    depth::{self, Trust},
    emit::{self, Wanted},
    moving,
};
use crate::{
    gaussians::{Coarseness, Gaussian, GaussianSet, NUM_ATTRIBUTES, mean_of},
    parallel,
    points::{PointCloud, samples_at},
    views::{PinholeView, View},
};

/// Images of one camera that are nearer in time than this say nothing about its speed, seconds.
const SAME_MOMENT: f32 = 1e-3;

/// What is behind the pixels of the input views, and which of them Gaussians cover.
pub(super) struct Backdrop<'a> {
    /// From the middle frame outwards.
    views: Vec<&'a View>,
    /// `[views]`
    sheets: Vec<Sheet>,
    /// `[views]`
    coverages: Vec<Coverage>,
    /// `[views]` pixels around what moves that no other image tells to show it, or what is behind it.
    doubtful: Vec<Vec<usize>>,
}

impl<'a> Backdrop<'a> {
    /// That of `views`, of whose pixels the moving Gaussians of `set` cover some.
    pub(super) fn new(views: Vec<&'a View>, sheets: Vec<Sheet>, set: &GaussianSet) -> Self {
        let shapes = Shape::moving(set);
        let covered = |k: usize| {
            let mut coverage = Coverage::new(&views[k].pinhole);
            coverage.add(&views[k].pinhole, &shapes);
            coverage
        };
        let coverages = parallel::map(views.len(), 1, &covered);
        Self { doubtful: vec![Vec::new(); views.len()], views, sheets, coverages }
    }

    /// Appends Gaussians for the uncovered pixels of what moves, and takes these pixels from the sheets.
    pub(super) fn add_moving(
        &mut self,
        set: &mut GaussianSet,
        still: &PointCloud,
        things: &[moving::Thing],
        coarseness: Coarseness,
    ) {
        let velocities = vec![[0.0; 3]; still.len()];
        for k in 0..self.views.len() {
            let view = self.views[k];
            let things: Vec<&moving::Thing> =
                things.iter().filter(|thing| u32::try_from(view.frame) == Ok(thing.flow.frame)).collect();
            let standing = samples_at(still, &velocities, view);
            let shown = moving::shown(view, &self.sheets[k], &standing, &things, &self.sources(k));
            let mut own = Sheet::unknown(view);
            for (thing, shown) in things.into_iter().zip(shown) {
                let Some(shown) = shown else { continue };
                for &(pixel, inverse) in &shown.pixels {
                    self.sheets[k].trust[pixel] = Trust::Unknown;
                    (own.inverse_depths[pixel], own.trust[pixel]) = (inverse, Trust::Alone);
                }
                let wanted = Wanted { trust: Trust::Alone, rows: shown.rows };
                let rows = emit::rows(view, &own, &self.coverages[k], wanted, &[], coarseness);
                shown.pixels.iter().for_each(|&(pixel, _)| own.trust[pixel] = Trust::Unknown);
                let first = set.len();
                moving::append(set, view, thing, &rows);
                let mut shapes = Shape::of(&set.attributes[first..]);
                for (shape, i) in shapes.iter_mut().zip(first..) {
                    shape.move_as(set.times[i], set.velocities[i]);
                }
                self.cover(&shapes);
                self.doubtful[k].extend(shown.around);
            }
        }
    }

    /// Appends Gaussians for all uncovered pixels of a known depth.
    pub(super) fn add_pixels(&mut self, set: &mut GaussianSet, coarseness: Coarseness) {
        for trust in [Trust::Confirmed, Trust::Alone, Trust::Contradicted] {
            for k in 0..self.views.len() {
                let view = self.views[k];
                let wanted = Wanted { trust, rows: 0..view.pinhole.height };
                let rows = emit::rows(view, &self.sheets[k], &self.coverages[k], wanted, &self.sources(k), coarseness);
                self.cover(&Shape::of(&rows));
                append(set, view, rows);
            }
        }
    }

    /// Appends Gaussians for the own vehicle as the first view of each camera shows it, which move with the camera.
    pub(super) fn add_own_vehicle(&self, set: &mut GaussianSet, coarseness: Coarseness) {
        for (k, &view) in self.views.iter().enumerate() {
            let first = !self.views[..k].iter().any(|other| other.camera == view.camera);
            let Some(other) = self.sources(k).first().copied().filter(|_| first) else { continue };
            let nothing = Coverage::new(&view.pinhole);
            let wanted = Wanted { trust: Trust::OwnVehicle, rows: 0..view.pinhole.height };
            let rows = emit::rows(view, &self.sheets[k], &nothing, wanted, &[], coarseness);
            let velocity = velocity(&view.pinhole, &other.pinhole);
            for attributes in rows {
                let time = view.pinhole.exposed_at(mean_of(&attributes));
                set.push(Gaussian { attributes, time, frame: frame_of(view), velocity });
            }
        }
    }

    /// Appends the coarse layer behind everything. What may show something that moves, and that no other image confirms, says nothing of what
    /// stands behind it: it would leave a ghost of that there.
    pub(super) fn add_backstop(&mut self, set: &mut GaussianSet, coarseness: Coarseness) {
        for (sheet, pixels) in self.sheets.iter_mut().zip(&self.doubtful) {
            for &pixel in pixels {
                if sheet.trust[pixel] != Trust::Confirmed {
                    sheet.trust[pixel] = Trust::Unknown;
                }
            }
        }
        let behind = |k: usize| backstop::rows(self.views[k], &self.sheets[k], coarseness);
        let behind = parallel::map(self.views.len(), 1, &behind);
        self.views.iter().zip(behind).for_each(|(view, rows)| append(set, view, rows));
    }

    /// The views that the one at `k` is compared with.
    fn sources(&self, k: usize) -> Vec<&'a View> {
        depth::sources(&self.views, k).into_iter().map(|j| self.views[j]).collect()
    }

    fn cover(&mut self, shapes: &[Shape]) {
        parallel::for_each(&mut self.coverages, 1, &|k, coverage| coverage.add(&self.views[k].pinhole, shapes));
    }
}

/// Appends Gaussians that stand still and that an image asked for.
fn append(set: &mut GaussianSet, view: &View, rows: Vec<[f32; NUM_ATTRIBUTES]>) {
    let frame = frame_of(view);
    for attributes in rows {
        set.push(Gaussian { attributes, time: 0.0, frame, velocity: [0.0; 3] });
    }
}

fn frame_of(view: &View) -> u32 {
    to_u32(view.frame)
}

/// Velocity (metres a second) of a camera between two of its images; 0 when they were taken at the same moment, or nearly.
fn velocity(from: &PinholeView, to: &PinholeView) -> [f32; 3] {
    let (a, b, seconds) = (from.centre(), to.centre(), to.time - from.time);
    if seconds.abs() < SAME_MOMENT { [0.0; 3] } else { std::array::from_fn(|k| (b[k] - a[k]) / seconds) }
}
