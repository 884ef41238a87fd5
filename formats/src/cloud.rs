//! Splat clouds as files hold them: raw parameters, before activation.

/// Zeroth spherical harmonic: `colour = 0.5 + SH_DC * sh_dc`.
pub const SH_DC: f32 = 0.282_094_79;

/// A Gaussian scene; every column has the same length N.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplatCloud {
    /// `[N, 3]` positions at each splat's own time, metres.
    pub means: Vec<[f32; 3]>,
    /// `[N, 3]` natural logarithms of the scales in metres.
    pub log_scales: Vec<[f32; 3]>,
    /// `[N, 4]` rotations (w, x, y, z), not necessarily of length 1.
    pub quats: Vec<[f32; 4]>,
    /// `[N]` logits of the opacities.
    pub logit_opacities: Vec<f32>,
    /// `[N, 3]` colours as coefficients of the zeroth spherical harmonic: see [`SH_DC`].
    pub sh_dc: Vec<[f32; 3]>,
    /// `[N, 3]` velocities, metres per second.
    pub velocities: Vec<[f32; 3]>,
    /// `[N]` times at which the splats stand at their means, seconds.
    pub times: Vec<f32>,
    /// `[N]` indices of the clip's frames that the splats come from; `None` where nothing says so.
    pub frames: Option<Vec<u32>>,
    /// Further columns of N values, by name, in file order.
    pub extra: Vec<(String, Vec<f32>)>,
}

impl SplatCloud {
    /// The number of splats.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// The scene at one moment: every splat where its velocity has brought it, standing.
    #[must_use]
    pub fn at(&self, moment: f32) -> Self {
        let motion = self.velocities.iter().zip(&self.times);
        let moved = |(mean, (velocity, time)): (&[f32; 3], (&[f32; 3], &f32))| {
            std::array::from_fn(|k| mean[k] + velocity[k] * (moment - time))
        };
        Self {
            means: self.means.iter().zip(motion).map(moved).collect(),
            velocities: vec![[0.0; 3]; self.len()],
            times: vec![moment; self.len()],
            ..self.clone()
        }
    }

    /// Whether there is no splat.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }
}
