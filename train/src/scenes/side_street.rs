//! The mouth of a side street: the carriageway goes on between its kerbs, across the street's own.

use glam::Vec2;
use lgs_formats::casts::to_f32;

use super::road::Road;

/// Half of the width of a side street (metres).
pub(crate) const HALF_WIDTH: f64 = 3.6;

/// A street that crosses at a right angle, without end on both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SideStreet {
    /// Place of its middle line along the street (metres).
    pub(crate) s: f64,
}

impl SideStreet {
    /// How far a ground point is outside of the side street's kerbs (metres); negative inside.
    pub(crate) fn outside(self, road: &Road, at: Vec2) -> f32 {
        (road.coordinates(at).x - to_f32(self.s)).abs() - to_f32(HALF_WIDTH)
    }

    /// Whether something `reach` metres long on both sides of `s` keeps clear of its mouth.
    pub(crate) fn is_clear(self, s: f64, reach: f64) -> bool {
        (s - self.s).abs() > HALF_WIDTH + reach
    }
}
