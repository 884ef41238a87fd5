//! Which returns are in front where several are seen together.

use crate::{
    points::PointCloud,
    views::{PinholeView, Projected},
};

/// Side of a cell, pixels.
const CELL: usize = 8;
/// What is this much farther than the nearest return of the cells around it, a share and metres, is on its surface yet.
const BEHIND: (f32, f32) = (0.08, 0.5);

/// The nearest returns of all sweeps, by cells of an image.
pub(super) struct Front {
    /// Cells in a row.
    width: usize,
    /// Nearest return in and around each cell, metres.
    depths: Vec<f32>,
}

impl Front {
    pub(super) fn new(cloud: &PointCloud, view: &PinholeView) -> Self {
        let [width, height] = [view.width, view.height].map(|side| side.div_ceil(CELL));
        let mut nearest = vec![f32::INFINITY; width * height];
        for at in cloud.positions.iter().filter_map(|&place| view.project(place)) {
            let cell = cell(at, width);
            nearest[cell] = nearest[cell].min(at.depth);
        }
        let around = |cell: usize| {
            let (row, column) = (cell / width, cell % width);
            let columns = column.saturating_sub(1)..(column + 2).min(width);
            let rows = row.saturating_sub(1)..(row + 2).min(height);
            let cells = rows.flat_map(|r| columns.clone().map(move |c| r * width + c));
            cells.map(|cell| nearest[cell]).fold(f32::INFINITY, f32::min)
        };
        Self { width, depths: (0..nearest.len()).map(around).collect() }
    }

    /// Whether nothing around a place of the image is clearly nearer than what is there.
    pub(super) fn shows(&self, at: Projected) -> bool {
        at.depth < (1.0 + BEHIND.0) * self.depths[cell(at, self.width)] + BEHIND.1
    }
}

fn cell(at: Projected, width: usize) -> usize {
    let pixel = at.pixel(width * CELL);
    pixel / (width * CELL) / CELL * width + pixel % (width * CELL) / CELL
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::samples::ahead;

    #[test]
    fn what_is_behind_a_surface_is_not_shown() {
        let view = ahead(64, 48, 60.0);
        let wall = (0..400_u16).map(|i| [f32::from(i % 20) * 0.1 - 1.0, f32::from(i / 20) * 0.08 - 0.8, 4.0]);
        let cloud = PointCloud { positions: wall.collect(), ..PointCloud::default() };
        let front = Front::new(&cloud, &view);
        let shown = |point: [f32; 3]| front.shows(view.project(point).unwrap());
        assert!(shown([0.0, 0.0, 4.0]) && shown([0.1, 0.1, 4.7]) && shown([0.0, 0.0, 1.0]));
        assert!(!shown([0.0, 0.0, 5.5]) && !shown([1.0, 0.5, 40.0]));
        // Nothing is in front where nothing was measured.
        let empty = Front::new(&PointCloud::default(), &view);
        assert!(empty.shows(view.project([0.0, 0.0, 900.0]).unwrap()));
    }
}
