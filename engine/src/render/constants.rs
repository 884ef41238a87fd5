//! Every constant of the rasteriser, with its origin.

/// Added to both diagonal intersections of the projected covariance, px^2 (gsplat `eps2d`).
pub const BLUR_PX2: f64 = 0.3;
/// Largest alpha of one Gaussian at one pixel (gsplat 1.5.3; 1.6 has 0.99).
pub const ALPHA_MAX: f32 = 0.999;
/// Alphas below this are skipped (gsplat).
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// `log2(ALPHA_MIN)`, rounded down so that no pixel at the threshold is lost.
pub const LOG2_ALPHA_MIN: f32 = -7.994_36;
/// A Gaussian that would bring the transmittance to this or below is left out and ends the pixel (gsplat).
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// Transmittance behind which nothing shows, even where one opaque Gaussian ([`ALPHA_MAX`]) is taken out in front: a thousandth of f32's
/// precision.
pub const UNSEEN: f32 = 1e-10;
/// Transmittance behind which hardly anything shows where one opaque Gaussian is taken out in front: a hundredth. For a choice of what to prune a
/// tenth and a thousandth are as good as [`UNSEEN`] (27.13 dB in the mean of five real clips, all three), and quicker.
pub const HARDLY_SEEN: f32 = 1e-5;
/// Gaussians nearer than this along the camera's z axis are not drawn, metres (gsplat `near_plane`).
pub const NEAR_PLANE: f64 = 0.01;
/// The Jacobian is taken inside the image widened by this share of the tangent of half the field of view (gsplat).
pub const JACOBIAN_MARGIN: f64 = 0.3;
/// Smallest alpha that expected depth is divided by.
pub const EXPECTED_DEPTH_EPS: f32 = 1e-10;

/// Width of a tile, pixels: a multiple of the widest vector (16 lanes).
pub const TILE_WIDTH: usize = 32;
/// Height of a tile, pixels.
pub const TILE_HEIGHT: usize = 16;
/// Pixels of a tile.
pub const TILE_PIXELS: usize = TILE_WIDTH * TILE_HEIGHT;
