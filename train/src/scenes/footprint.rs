//! The ground that things take up, and whether two of them meet.

use glam::DVec2;

use super::motion::Movement;

/// A rectangle on the ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Footprint {
    pub(crate) centre: DVec2,
    /// Unit vector along its length.
    pub(crate) forward: DVec2,
    /// Half length and half width (metres).
    pub(crate) half: DVec2,
}

impl Footprint {
    /// That of a body of this length and width (metres).
    pub(crate) fn of(movement: &Movement, length: f64, width: f64) -> Self {
        Self {
            centre: movement.pose.translation().truncate(),
            forward: movement.pose.rotation().x_axis.truncate(),
            half: DVec2::new(length, width) * 0.5,
        }
    }

    /// The same rectangle, larger by `margin` metres on all sides.
    pub(crate) fn grown(self, margin: f64) -> Self {
        Self { half: self.half + margin, ..self }
    }

    /// Whether the rectangles have a point in common: no side of either parts them.
    pub(crate) fn meets(&self, other: &Self) -> bool {
        let between = other.centre - self.centre;
        let axes = [self.forward, self.forward.perp(), other.forward, other.forward.perp()];
        axes.iter().all(|&axis| between.dot(axis).abs() <= self.reach(axis) + other.reach(axis))
    }

    fn reach(&self, axis: DVec2) -> f64 {
        self.half.x * self.forward.dot(axis).abs() + self.half.y * self.forward.perp().dot(axis).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_between_two_bodies_decides() {
        let car = Footprint { centre: DVec2::ZERO, forward: DVec2::X, half: DVec2::new(2.0, 1.0) };
        let turned = |x: f64, y: f64| Footprint {
            centre: DVec2::new(x, y),
            forward: DVec2::new(1.0, 1.0).normalize(),
            half: DVec2::new(2.0, 1.0),
        };
        assert!(car.meets(&turned(3.9, 0.0)) && turned(3.9, 0.0).meets(&car));
        assert!(!car.meets(&turned(4.2, 0.0)));
        // Apart along neither axis of the first, but along one of the second.
        assert!(!car.meets(&turned(3.5, -2.5)));
        assert!(car.meets(&turned(4.2, 0.0).grown(0.2)));
    }
}
