//! How much of a scene moves.

use serde::Serialize;

use crate::gaussians::GaussianSet;

/// Speed above which a Gaussian counts as moving, m/s.
pub const MOVING_SPEED: f32 = 0.5;

/// Shares (0 to 1) of the Gaussians of a scene that are faster than [`MOVING_SPEED`]; `None` for a branch without any.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MovingShares {
    /// Of the `LiDAR` branch.
    pub lidar: Option<f64>,
    /// Of the background.
    pub background: Option<f64>,
}

impl MovingShares {
    /// Those of `scene`.
    pub fn of(scene: &GaussianSet) -> Self {
        let share = |velocities: &[[f32; 3]]| {
            let moving = velocities.iter().filter(|v| v.iter().map(|x| x * x).sum::<f32>() > MOVING_SPEED.powi(2));
            (!velocities.is_empty()).then(|| moving.count() as f64 / velocities.len() as f64)
        };
        let (lidar, background) = scene.velocities.split_at(scene.num_lidar.min(scene.velocities.len()));
        Self { lidar: share(lidar), background: share(background) }
    }
}

/// The share as people read it: per cent, with two digits after the point; a dash for none.
pub fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "–".to_owned(), |share| format!("{:.2} %", 100.0 * share))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_those_of_each_branch() {
        let velocities = vec![[0.0; 3], [0.5, 0.0, 0.0], [0.4, 0.3, 0.1], [0.0; 3], [-3.0, 0.0, 4.0]];
        let scene = GaussianSet { velocities, num_lidar: 4, ..GaussianSet::default() };
        let shares = MovingShares::of(&scene);
        assert_eq!(shares, MovingShares { lidar: Some(0.25), background: Some(1.0) });
        assert_eq!(percent(shares.lidar), "25.00 %");
        assert_eq!(MovingShares::of(&GaussianSet::default()), MovingShares::default());
        assert_eq!(percent(None), "–");
    }
}
