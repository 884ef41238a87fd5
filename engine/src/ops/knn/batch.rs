//! What a search has found so far, for the points of one leaf together.

use super::NO_NEIGHBOUR;
use super::tree::{LEAF, Leaf};

/// A neighbour found: squared distance, index. Nothing found yet: infinity, [`NO_NEIGHBOUR`].
pub(super) type Found = (f64, u32);

const NOTHING: Found = (f64::INFINITY, NO_NEIGHBOUR);

/// What has been found for the points of one leaf.
#[derive(Debug)]
pub(super) struct Batch {
    k: usize,
    /// `[LEAF, k]` nearest first.
    pub(super) found: Vec<Found>,
    /// The k-th of every point; what is not below it is of no use.
    pub(super) last: [Found; LEAF],
    /// f32 squared distances above this are surely above the k-th; negative for a slot without a point.
    pub(super) limits: [f32; LEAF],
    /// The largest of `last`.
    pub(super) worst: Found,
    /// Nodes to visit and what their points can reach at best.
    pub(super) stack: Vec<(u32, Found)>,
}

impl Batch {
    pub(super) fn new(k: usize) -> Self {
        Self {
            k,
            found: vec![NOTHING; LEAF * k],
            last: [NOTHING; LEAF],
            limits: [0.0; LEAF],
            worst: NOTHING,
            stack: Vec::new(),
        }
    }

    pub(super) fn start(&mut self, leaf: &Leaf) {
        self.found.fill(NOTHING);
        for slot in 0..LEAF {
            let present = leaf.indices[slot] != NO_NEIGHBOUR;
            self.last[slot] = if present { NOTHING } else { (-1.0, 0) };
            self.limits[slot] = if present { f32::INFINITY } else { -1.0 };
        }
        self.worst = NOTHING;
        self.stack.clear();
    }

    /// Inserts a candidate that comes before the k-th.
    #[inline(always)]
    pub(super) fn insert(&mut self, slot: usize, candidate: Found) {
        let found = &mut self.found[slot * self.k..(slot + 1) * self.k];
        let mut place = found.len() - 1;
        while place > 0 && candidate < found[place - 1] {
            found[place] = found[place - 1];
            place -= 1;
        }
        found[place] = candidate;
        self.last[slot] = found[self.k - 1];
        self.limits[slot] = limit(self.last[slot].0);
    }

    pub(super) fn update_worst(&mut self) {
        self.worst = self.last.iter().fold((-1.0, 0), |worst, &last| if last > worst { last } else { worst });
    }
}

/// An f32 squared distance above this belongs to an f64 squared distance above `squared`.
///
/// Rounding changes the difference of two f32 by 2^-24 of itself, the sum of the squares by less than 5e-7 of itself or, where squares
/// underflow, by less than 1e-37.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounded; the margin covers it")]
fn limit(squared: f64) -> f32 {
    squared as f32 * 1.000_001 + 1e-37
}
