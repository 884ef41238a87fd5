//! What a GPU keeps from one work to the next.

use std::collections::HashMap;

use wgpu::{Buffer, ComputePipeline};

/// Buffers and kernels by their names.
#[derive(Debug, Default)]
pub(super) struct Room {
    pub(super) buffers: HashMap<&'static str, Buffer>,
    pub(super) pipelines: HashMap<&'static str, ComputePipeline>,
}
