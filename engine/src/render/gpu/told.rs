//! What kernels are told: small values, many of which share a buffer.

use std::ops::Range;

use wgpu::{BindingResource, Buffer, BufferBinding, BufferSize, BufferUsages, Device, Queue};

/// Bytes of a buffer.
const BYTES: usize = 1 << 16;
/// Bytes that the places of values are multiples of, on every GPU.
const PLACE: usize = 256;

/// A value that is told, as long as the work lasts.
#[derive(Clone, Debug)]
pub(crate) struct Told {
    buffer: Buffer,
    offset: u64,
    size: u64,
}

impl Told {
    /// What a kernel is bound to.
    pub(super) fn bound(&self) -> BindingResource<'_> {
        let size = BufferSize::new(self.size);
        BindingResource::Buffer(BufferBinding { buffer: &self.buffer, offset: self.offset, size })
    }
}

/// Buffers of what is told. No place is used twice in a work: what was told stays true for commands that run later.
#[derive(Debug, Default)]
pub(super) struct TellBuffers {
    buffers: Vec<(Buffer, Vec<u8>)>,
    /// Bytes that are told, those of the buffers one after the other, and of them those that are written.
    told: usize,
    written: usize,
}

impl TellBuffers {
    /// Begins a work: what was told before is no longer needed.
    pub(super) fn begin(&mut self) {
        (self.told, self.written) = (0, 0);
    }

    /// Adds a value of at most [`BYTES`].
    pub(super) fn add(&mut self, device: &Device, bytes: &[u8]) -> Told {
        let room = bytes.len().next_multiple_of(PLACE);
        if self.told % BYTES + room > BYTES {
            self.told = self.told.next_multiple_of(BYTES);
        }
        let (number, offset) = (self.told / BYTES, self.told % BYTES);
        if number == self.buffers.len() {
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("told"),
                size: BYTES as u64,
                usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            self.buffers.push((buffer, vec![0; BYTES]));
        }
        let (buffer, values) = &mut self.buffers[number];
        values[offset..offset + bytes.len()].copy_from_slice(bytes);
        self.told += room;
        Told { buffer: buffer.clone(), offset: offset as u64, size: bytes.len() as u64 }
    }

    /// Writes what was told since the last time; it is there for the commands that are submitted next.
    pub(super) fn write(&mut self, queue: &Queue) {
        while self.written < self.told {
            let Range { start, end } = part(self.written, self.told);
            let (buffer, values) = &self.buffers[self.written / BYTES];
            queue.write_buffer(buffer, start as u64, &values[start..end]);
            self.written += end - start;
        }
    }
}

/// The part of the bytes from `first` to `last` that is in the buffer of the first of them.
fn part(first: usize, last: usize) -> Range<usize> {
    let start = first % BYTES;
    start..(start + (last - first)).min(BYTES)
}

#[cfg(test)]
mod tests {
    use super::{BYTES, part};

    #[test]
    fn parts_end_with_their_buffer() {
        assert_eq!(part(0, 512), 0..512);
        assert_eq!(part(BYTES - 256, BYTES + 512), BYTES - 256..BYTES);
        assert_eq!(part(BYTES, BYTES + 512), 0..512);
    }
}
