//! What kernels that go over the lists of tiles are told.

use bytemuck::{Pod, Zeroable};

/// Its WGSL.
pub(super) const WALK: &str = include_str!("walk.wgsl");
/// Its WGSL for ways back: what they read, and how they hold Gaussians.
pub(super) const WALK_BACK: &str = include_str!("walk_back.wgsl");

/// A walk over tiles; `walk.wgsl` says what stands where.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Walk {
    pub(super) size: [u32; 4],
    pub(super) background: [f32; 4],
    pub(super) batch: [u32; 4],
    pub(super) per: [f32; 4],
}
