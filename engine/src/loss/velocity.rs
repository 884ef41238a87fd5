//! Mean speed of the Gaussians: nothing moves unless the images ask for it.

use lgs_formats::casts::to_f32;

/// `weight` times the mean speed (metres a second), and its gradient by the velocities; no Gaussian gives 0.
///
/// # Shapes
/// `velocities` and the gradient `[N, 3]`.
///
/// # Gradient
/// `weight v / (|v| N)`, and 0 at `v = 0`. A velocity that is not finite makes the value not finite; its own row of the
/// gradient is 0, the others are not touched.
pub fn velocity_loss(velocities: &[[f32; 3]], weight: f32) -> (f64, Vec<[f32; 3]>) {
    let scale = f64::from(weight) / velocities.len().max(1) as f64;
    let mut sum = 0.0_f64;
    let gradient = velocities.iter().map(|velocity| {
        let speed = velocity.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        sum += speed;
        if speed > 0.0 && speed.is_finite() { velocity.map(|v| to_f32(scale * f64::from(v) / speed)) } else { [0.0; 3] }
    });
    let gradient = gradient.collect();
    (scale * sum, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_is_the_weighted_mean_speed() {
        let (value, gradient) = velocity_loss(&[[3.0, 4.0, 0.0], [0.0; 3]], 2.0);
        assert_eq!(value, 5.0);
        assert_eq!(gradient, [[0.6, 0.8, 0.0], [0.0; 3]]);
        assert_eq!(velocity_loss(&[], 2.0), (0.0, vec![]));
    }

    #[test]
    fn gradient_is_the_finite_difference() {
        let velocities = [[0.5, -1.5, 2.0], [1e-3, 2e-3, -1e-3], [30.0, 0.0, 0.25]];
        let (_, gradient) = velocity_loss(&velocities, 0.7);
        for i in 0..3 {
            for k in 0..3 {
                let step = 1.0 / f32::from(1_u16 << 14);
                let moved = |by: f32| {
                    let mut velocities = velocities;
                    velocities[i][k] += by;
                    velocity_loss(&velocities, 0.7).0
                };
                let want = (moved(step) - moved(-step)) / f64::from(2.0 * step);
                assert!(
                    (f64::from(gradient[i][k]) - want).abs() < 3e-4,
                    "{i} {k}: got {}, want {want}",
                    gradient[i][k]
                );
            }
        }
    }

    #[test]
    fn a_velocity_that_is_not_finite_stays_alone() {
        let (value, gradient) = velocity_loss(&[[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [0.0, 0.0, 2.0]], 3.0);
        assert!(value.is_nan());
        assert_eq!(gradient, [[0.0; 3], [0.0; 3], [0.0, 0.0, 1.0]]);
    }
}
