//! What each kernel of a work takes, by the GPU's own clock.

use wgpu::{Buffer, BufferUsages, ComputePassTimestampWrites, Features, QuerySet, QuerySetDescriptor, QueryType};

use super::device::Gpu;
use super::error::GpuError;
use super::work::Work;

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
}

impl Work<'_> {
    /// Seconds of every kernel since the clock was set, in the order of their first dispatch; empty where the GPU has no clock.
    ///
    /// # Errors
    /// Where the GPU has stopped.
    pub(super) fn stop_clock(&mut self) -> Result<Vec<(&'static str, f64)>, GpuError> {
        let Some(clock) = self.clock.take().filter(|clock| !clock.names.is_empty()) else { return Ok(Vec::new()) };
        let num_ticks = 2 * clock.names.len();
        let ticks = self.timed(&clock.queries, num_ticks)?;
        let period = f64::from(self.gpu.queue.get_timestamp_period()) * 1e-9;
        let mut seconds: Vec<(&'static str, f64)> = Vec::new();
        for (&name, pair) in clock.names.iter().zip(ticks.as_chunks::<2>().0) {
            let taken = pair[1].saturating_sub(pair[0]) as f64 * period;
            match seconds.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => *sum += taken,
                None => seconds.push((name, taken)),
            }
        }
        Ok(seconds)
    }

    fn timed(&mut self, queries: &QuerySet, len: usize) -> Result<Vec<u64>, GpuError> {
        let ticks = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ticks"),
            size: u64::from(2 * MOST) * size_of::<u64>() as u64,
            usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        self.resolve(queries, len, &ticks);
        self.read(&ticks, 0, len)
    }

    fn resolve(&mut self, queries: &QuerySet, len: usize, to: &Buffer) {
        let last = u32::try_from(len).unwrap_or(2 * MOST);
        self.encoder().resolve_query_set(queries, 0..last, to, 0);
    }
}
