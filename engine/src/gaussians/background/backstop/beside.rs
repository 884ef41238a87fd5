//! What stands beside something that moves goes on behind it.

use rayon::prelude::*;

use super::{ALIKE, BLOCK, Behind, Grid, says_what_is_behind};
use crate::{
    gaussians::background::{Sheet, depth::Trust, is_ignored},
    views::{Projected, View},
};

/// Fills the blocks of `grid`, those of `view`, behind what moves with what stands beside it, where none of the `others`, views with their sheets,
/// shows what is there.
pub(super) fn go_on_behind_what_moves(grid: &mut Grid, view: &View, sheet: &Sheet, others: &[(&View, &Sheet)]) {
    let (columns, side) = (grid.columns, grid.side as f32);
    grid.cells.par_chunks_mut(columns.max(1)).enumerate().for_each(|(row, cells)| {
        let is_hidden = |column: usize| is_hidden(view, sheet, row * BLOCK, column * BLOCK);
        let is_news = |column: usize, behind: Behind| {
            let [u, v] = [column, row].map(|k| (k as f32 + 0.5) * side);
            let point = view.pinhole.unproject(Projected { u, v, depth: 1.0 / behind.farthest });
            others.iter().all(|(other, sheet)| {
                let seen = other.pinhole.project(point);
                seen.is_none_or(|at| !says_what_is_behind(other, sheet, at.pixel(other.pinhole.width)))
            })
        };
        go_on(cells, is_hidden, is_news);
    });
}

/// Whether something that moves hides what is behind a block.
fn is_hidden(view: &View, sheet: &Sheet, row_of_block: usize, column_of_block: usize) -> bool {
    let [columns, rows] = [(column_of_block, view.pinhole.width), (row_of_block, view.pinhole.height)]
        .map(|(at, size)| at..(at + BLOCK).min(size));
    rows.flat_map(|r| columns.clone().map(move |c| r * view.pinhole.width + c))
        .any(|i| sheet.trust[i] == Trust::Moving && !is_ignored(view, i))
}

/// Fills a row's cells of which nothing is known for what moves in front, where that is news: there goes on what is beside, the farther of both
/// sides, and where both are as far, a mix of them.
fn go_on(cells: &mut [Option<Behind>], is_hidden: impl Fn(usize) -> bool, is_news: impl Fn(usize, Behind) -> bool) {
    let mut start = 0;
    while start < cells.len() {
        let open = |k: usize| cells[k].is_none() && is_hidden(k);
        if !open(start) {
            start += 1;
            continue;
        }
        let end = (start + 1..cells.len()).find(|&k| !open(k)).unwrap_or(cells.len());
        let [left, right] = [start.checked_sub(1), Some(end)].map(|k| k.and_then(|k| cells.get(k).copied().flatten()));
        for k in start..end {
            let share = (k + 1 - start) as f32 / (end + 1 - start) as f32;
            let behind = match (left, right) {
                (Some(left), Some(right)) => Some(between(left, right, share)),
                (one, other) => one.or(other),
            };
            cells[k] = behind.filter(|&behind| is_news(k, behind));
        }
        start = end;
    }
}

/// What is this share of the way from one to another: the farther, in its colour, or where the other is as far, in one between theirs.
fn between(from: Behind, to: Behind, share: f32) -> Behind {
    let farthest = from.farthest.min(to.farthest);
    let [first, second] = [(from, 1.0 - share), (to, share)]
        .map(|(side, weight)| if side.farthest <= ALIKE * farthest { weight } else { 0.0 });
    let colour = std::array::from_fn(|c| (first * from.colour[c] + second * to.colour[c]) / (first + second));
    Behind { farthest, colour }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use super::{Grid, Sheet, Trust, go_on_behind_what_moves};
    use crate::views::samples::{ahead, seen};

    #[test]
    fn what_is_beside_goes_on_behind_what_moves() {
        let (width, height) = (120, 60);
        let view =
            seen(ahead(width, height, 50.0), (0..3 * width * height).map(|i| (i / 3 % width) as f32 / 120.0).collect());
        let moves = |i: usize| (40..90).contains(&(i % width)) || i % width >= 100 && i / width < 30;
        let trust = (0..width * height).map(|i| match moves(i) {
            true => Trust::Moving,
            false if i % width < 3 && i / width >= 30 => Trust::OwnVehicle,
            false => Trust::Confirmed,
        });
        let sheet = Sheet { trust: trust.collect(), inverse_depths: vec![0.1; width * height] };
        let mut grid = Grid::finest(&view, &sheet);
        let shown = grid.clone();
        go_on_behind_what_moves(&mut grid, &view, &sheet, &[]);
        assert!(grid.cells.iter().all(Option::is_some), "every block is filled");
        // Between what is left and right of it, and at the edge of the image as what is left.
        let colours = |row: usize, columns: Range<usize>| -> Vec<f32> {
            columns.map(|k| grid.cells[20 * row + k].unwrap().colour[0]).collect()
        };
        let middle = colours(8, 6..16);
        assert!(middle.is_sorted() && middle[0] > 0.25 && middle[9] < 0.85, "{middle:?}");
        let edge = colours(1, 17..20);
        assert!(edge.iter().all(|&grey| grey == edge[0] && (0.7..0.84).contains(&grey)), "{edge:?}");
        // Another view that shows what is there knows better.
        let all = Sheet { trust: vec![Trust::Confirmed; width * height], inverse_depths: vec![0.1; width * height] };
        let mut told = shown.clone();
        go_on_behind_what_moves(&mut told, &view, &sheet, &[(&view, &all)]);
        assert!(told == shown && shown != grid);
        let nothing = Sheet { trust: vec![Trust::Unknown; width * height], ..sheet };
        assert!(Grid::finest(&view, &nothing).cells.iter().all(Option::is_none));
    }
}
