//! Which primitives a round samples, and where their copies stand: drawn by (seed, round, primitive) alone.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sha2::{Digest, Sha256};

/// What a generator is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    Sample = 0,
    Displacement = 1,
}

fn generator(seed: u64, round: u8, i: usize, purpose: Purpose) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((i as u64) << 16 | u64::from(round) << 8 | purpose as u64);
    rng
}

/// A clip's own seed, so that two clips are not sampled alike.
pub fn clip_seed(seed: u64, clip: &str) -> u64 {
    let digest = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(clip).finalize();
    digest.iter().take(8).fold(0, |seed, &byte| seed << 8 | u64::from(byte))
}

/// `[n]` whether a round samples each primitive.
///
/// # Formula
/// `u(seed, round, i) < rho`, u uniform in 0..1: all of them for `rho` 1, none for 0.
pub fn sampled(seed: u64, round: u8, n: usize, rho: f64) -> Vec<bool> {
    let unit = |i| (generator(seed, round, i, Purpose::Sample).next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    (0..n).map(|i| unit(i) < rho).collect()
}

/// Displacement of the copy of a primitive, metres.
///
/// # Formula
/// `N(0, noise_m)` per axis (Box and Muller).
#[expect(clippy::cast_possible_truncation, reason = "positions are stored in f32")]
pub fn displacement(seed: u64, round: u8, i: usize, noise_m: f64) -> [f32; 3] {
    let mut rng = generator(seed, round, i, Purpose::Displacement);
    let mut unit = || (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
    std::array::from_fn(|_| {
        let (radius, angle) = ((-2.0 * unit().ln()).sqrt(), std::f64::consts::TAU * unit());
        (noise_m * radius * angle.cos()) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_is_rho_and_rounds_seeds_and_clips_differ() {
        let n = 20_000;
        let draw = |seed, round| sampled(seed, round, n, 0.2);
        let share = draw(3, 0).iter().filter(|s| **s).count() as f64 / n as f64;
        assert!((share - 0.2).abs() < 0.01, "{share}");
        assert_ne!(draw(3, 0), draw(3, 1));
        assert_ne!(draw(3, 0), draw(4, 0));
        assert_ne!(clip_seed(0, "a"), clip_seed(0, "b"));
        assert_eq!(draw(3, 0)[..50], sampled(3, 0, 50, 0.2));
        assert!(sampled(1, 0, 100, 1.0).iter().all(|s| *s) && !sampled(1, 0, 100, 0.0).iter().any(|s| *s));
    }

    #[test]
    fn displacements_have_the_deviation_that_was_asked_for() {
        let all: Vec<f64> = (0..4000).flat_map(|i| displacement(9, 1, i, 0.01)).map(f64::from).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let deviation = (all.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        assert!(mean.abs() < 5e-4 && (deviation - 0.01).abs() < 3e-4, "{mean} {deviation}");
        assert_eq!(displacement(9, 1, 5, 0.0), [0.0; 3]);
    }
}
