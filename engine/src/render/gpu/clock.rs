//! What each kernel of a work takes, by the GPU's own clock.

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePassTimestampWrites, Features, QuerySet, QuerySetDescriptor, QueryType,
};

use super::device::Gpu;

/// Dispatches that are timed; those that follow are not.
const MOST: u32 = wgpu::QUERY_SET_MAX_QUERIES / 2;

/// Times of the dispatches of a work.
#[derive(Debug)]
pub(super) struct Clock {
    queries: QuerySet,
    names: Vec<&'static str>,
}

impl Clock {
    /// A clock; `None` where the GPU has none.
    pub(super) fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.device.features().contains(Features::TIMESTAMP_QUERY) {
            return None;
        }
        let descriptor = QuerySetDescriptor { label: Some("clock"), ty: QueryType::Timestamp, count: 2 * MOST };
        Some(Self { queries: gpu.device.create_query_set(&descriptor), names: Vec::new() })
    }

    /// Where the next dispatch, of this kernel, writes its times.
    pub(super) fn next(&mut self, name: &'static str) -> Option<ComputePassTimestampWrites<'_>> {
        let number = u32::try_from(self.names.len()).ok().filter(|&number| number < MOST)?;
        self.names.push(name);
        Some(ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * number),
            end_of_pass_write_index: Some(2 * number + 1),
        })
    }

    /// Asks for the ticks, two of each dispatch, and in which buffer they will be.
    pub(super) fn resolve(&self, gpu: &Gpu, encoder: &mut CommandEncoder) -> (Buffer, usize) {
        let ticks = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ticks"),
            size: u64::from(2 * MOST) * size_of::<u64>() as u64,
            usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let len = 2 * self.names.len();
        encoder.resolve_query_set(&self.queries, 0..u32::try_from(len).unwrap_or(2 * MOST), &ticks, 0);
        (ticks, len)
    }

    /// Seconds of every kernel, in the order of their first dispatch, from the ticks.
    pub(super) fn seconds(&self, gpu: &Gpu, ticks: &[u64]) -> Vec<(&'static str, f64)> {
        let period = f64::from(gpu.queue.get_timestamp_period()) * 1e-9;
        let mut seconds: Vec<(&'static str, f64)> = Vec::new();
        for (&name, pair) in self.names.iter().zip(ticks.as_chunks::<2>().0) {
            let taken = pair[1].saturating_sub(pair[0]) as f64 * period;
            match seconds.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => *sum += taken,
                None => seconds.push((name, taken)),
            }
        }
        seconds
    }
}
