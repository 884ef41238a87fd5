//! What a GPU keeps from one work to the next.

use std::collections::HashMap;

use wgpu::{BindGroupLayout, Buffer, ComputePipeline};

use super::told::TellBuffers;

/// Buffers and kernels by their names.
#[derive(Debug, Default)]
pub(super) struct Room {
    pub(super) buffers: HashMap<&'static str, Buffer>,
    /// With the layouts of their bindings.
    pub(super) pipelines: HashMap<&'static str, (ComputePipeline, BindGroupLayout)>,
    pub(super) told: TellBuffers,
    /// Where what is small is read.
    pub(super) small: Option<Buffer>,
}
