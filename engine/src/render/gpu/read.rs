//! What is read back from a GPU.

use std::sync::mpsc;

use bytemuck::{AnyBitPattern, NoUninit};
use wgpu::{Buffer, BufferUsages};

use super::error::GpuError;
use super::work::Work;

/// Bytes up to which what is read is small.
const SMALL: u64 = 1 << 12;

impl Work<'_> {
    /// `len` elements of a buffer from `first` on, once all work before is done.
    ///
    /// # Errors
    /// [`GpuError::Lost`] where that work failed.
    pub(crate) fn read<T: AnyBitPattern + NoUninit>(
        &mut self,
        buffer: &Buffer,
        first: usize,
        len: usize,
    ) -> Result<Vec<T>, GpuError> {
        self.read_pieces(&[(buffer, first)], len)
    }

    /// `len` elements of each of some buffers from a first one on, one after the other, once all work before is done.
    ///
    /// # Errors
    /// As [`Work::read`].
    pub(crate) fn read_pieces<T: AnyBitPattern + NoUninit>(
        &mut self,
        pieces: &[(&Buffer, usize)],
        len: usize,
    ) -> Result<Vec<T>, GpuError> {
        let bytes = |count: usize| count as u64 * size_of::<T>() as u64;
        let all = len * pieces.len();
        if all == 0 {
            return Ok(Vec::new());
        }
        let copy = self.read_back(bytes(all));
        for (number, (buffer, first)) in pieces.iter().enumerate() {
            self.encoder().copy_buffer_to_buffer(buffer, bytes(*first), &copy, bytes(number * len), bytes(len));
        }
        self.submit();
        let mut values = vec![T::zeroed(); all];
        self.map(&copy, bytemuck::cast_slice_mut(&mut values))?;
        Ok(values)
    }

    /// A buffer that can be read here: what is small is read so often that one is kept for it.
    fn read_back(&mut self, size: u64) -> Buffer {
        let device = &self.gpu.device;
        let create = |size: u64| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("read back"),
                size,
                usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        if size > SMALL {
            return create(size);
        }
        self.room.small.get_or_insert_with(|| create(SMALL)).clone()
    }

    /// Waits for a buffer, and copies what it holds.
    fn map(&self, copy: &Buffer, to: &mut [u8]) -> Result<(), GpuError> {
        let (told, asked) = mpsc::channel();
        let bytes = to.len() as u64;
        copy.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
            // Nobody waits any more once the work has failed.
            let _ = told.send(result);
        });
        let polled = self.gpu.device.poll(wgpu::PollType::wait_indefinitely());
        self.gpu.check()?;
        let lost = GpuError::Lost;
        polled.map_err(|error| lost(error.to_string()))?;
        let mapped = asked.recv().map_err(|error| lost(error.to_string()))?;
        mapped.map_err(|error| lost(error.to_string()))?;
        let view = copy.get_mapped_range(..bytes).map_err(|error| lost(error.to_string()))?;
        to.copy_from_slice(&view);
        drop(view);
        copy.unmap();
        Ok(())
    }
}
