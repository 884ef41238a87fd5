//! Work on a GPU: buffers that are kept, kernels that are built once, and dispatches.

use std::sync::{MutexGuard, PoisonError};

use bytemuck::NoUninit;
use wgpu::{BindGroupLayout, Buffer, BufferUsages, ComputePipeline};

use super::clock::Clock;
use super::device::Gpu;
use super::error::GpuError;
use super::kernels::Kernel;
use super::memory::Owned;
use super::room::Room;
use super::told::Told;

/// Groups in one dimension, at most.
const MOST_GROUPS: u32 = 65_535;
/// Invocations of a group that goes over a list.
const GROUP: u32 = 256;

/// Work on a GPU, which nobody else does meanwhile.
pub(crate) struct Work<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) room: MutexGuard<'a, Room>,
    encoder: Option<wgpu::CommandEncoder>,
    /// Dispatches that follow one another share a pass; it ends before anything else is encoded.
    pass: Option<wgpu::ComputePass<'static>>,
    pub(super) clock: Option<Clock>,
}

/// Groups that go over so many elements.
pub(crate) const fn groups_over(elements: u32) -> u32 {
    elements.div_ceil(GROUP)
}

impl Gpu {
    /// Begins work; waits for whoever works on it.
    ///
    /// # Errors
    /// [`GpuError::Lost`] once it has stopped.
    pub(crate) fn work(&self) -> Result<Work<'_>, GpuError> {
        self.check()?;
        let mut room = self.room.lock().unwrap_or_else(PoisonError::into_inner);
        room.told.begin();
        Ok(Work { gpu: self, room, encoder: None, pass: None, clock: None })
    }
}

impl Work<'_> {
    /// Bytes that the buffer of a name may have.
    pub(crate) fn most_bytes(&self, name: &str) -> u64 {
        let own = self.room.buffers.get(name).map_or(0, Buffer::size);
        self.gpu.most_bytes.min(self.gpu.memory.room().saturating_add(own))
    }

    /// The buffer of a name, with room for `len` elements of `T`; what it holds is undefined.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] where the GPU has no buffer so large, [`GpuError::NoRoom`] where it may not hold so much.
    pub(crate) fn buffer<T>(&mut self, name: &'static str, len: usize) -> Result<Buffer, GpuError> {
        let need = (len.max(1) as u64).saturating_mul(size_of::<T>() as u64).next_multiple_of(16);
        let limit = self.gpu.most_bytes;
        if need > limit {
            return Err(GpuError::TooLarge { what: name, need, limit });
        }
        if let Some(buffer) = self.room.buffers.get(name).filter(|buffer| buffer.size() >= need) {
            return Ok(buffer.clone());
        }
        // Some more than asked for, so that a view that shows a little more needs no new one.
        let freed = self.room.buffers.get(name).map_or(0, Buffer::size);
        self.gpu.memory.check(name, need, freed)?;
        let most = self.most_bytes(name);
        let size = (need + need / 8).next_multiple_of(16).min(most / 16 * 16).max(need);
        let buffer = self.create(name, size)?;
        self.gpu.memory.count(size, freed);
        self.room.buffers.insert(name, buffer.clone());
        Ok(buffer)
    }

    /// A buffer of its own with these elements, which is kept as long as it lives.
    ///
    /// # Errors
    /// As [`Work::buffer`].
    pub(crate) fn own<T: NoUninit>(&mut self, name: &'static str, values: &[T]) -> Result<Owned, GpuError> {
        let owned = self.room_for::<T>(name, values.len())?;
        self.submit();
        self.gpu.queue.write_buffer(owned.buffer(), 0, bytemuck::cast_slice(values));
        Ok(owned)
    }

    /// A buffer of its own with room for `len` elements; what it holds is undefined.
    ///
    /// # Errors
    /// As [`Work::buffer`].
    pub(crate) fn room_for<T>(&mut self, name: &'static str, len: usize) -> Result<Owned, GpuError> {
        let need = (len.max(1) as u64).saturating_mul(size_of::<T>() as u64).next_multiple_of(16);
        let limit = self.gpu.most_bytes;
        if need > limit {
            return Err(GpuError::TooLarge { what: name, need, limit });
        }
        self.gpu.memory.check(name, need, 0)?;
        Ok(self.gpu.memory.own(self.create(name, need)?))
    }

    /// Copies the first `len` elements of a buffer to another.
    pub(crate) fn copy<T>(&mut self, from: &Buffer, to: &Buffer, len: usize) {
        let bytes = len as u64 * size_of::<T>() as u64;
        self.encoder().copy_buffer_to_buffer(from, 0, to, 0, bytes);
    }

    /// Whether a buffer was made here.
    pub(crate) fn has(&self, owned: &Owned) -> bool {
        owned.is_in(&self.gpu.memory)
    }

    /// Fails before anything is made where so many bytes are more than there is room for, what is made already for all works included.
    ///
    /// # Errors
    /// [`GpuError::NoRoom`].
    pub(crate) fn expect(&self, what: &'static str, bytes: u64) -> Result<(), GpuError> {
        let shared = self.room.buffers.values().map(Buffer::size).sum();
        self.gpu.memory.check(what, bytes, shared)
    }

    /// Bytes that true images may take.
    pub(crate) fn most_kept(&self) -> u64 {
        self.gpu.memory.most_kept()
    }

    fn create(&self, name: &'static str, size: u64) -> Result<Buffer, GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let buffer = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(name),
            size,
            usage,
            mapped_at_creation: false,
        });
        self.gpu.check()?;
        Ok(buffer)
    }

    /// The buffer of a name, with these elements; zeros follow where it is longer.
    ///
    /// # Errors
    /// As [`Work::buffer`].
    pub(crate) fn upload<T: NoUninit>(&mut self, name: &'static str, values: &[T]) -> Result<Buffer, GpuError> {
        let buffer = self.buffer::<T>(name, values.len())?;
        // Writes go before all commands that are not submitted yet.
        self.submit();
        self.gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(values));
        Ok(buffer)
    }

    /// Sets the first `len` elements of a buffer to zero.
    pub(crate) fn clear<T>(&mut self, buffer: &Buffer, len: usize) {
        let bytes = (len as u64 * size_of::<T>() as u64).next_multiple_of(4);
        self.encoder().clear_buffer(buffer, 0, Some(bytes));
    }

    /// What kernels are told, until the end of the work.
    pub(crate) fn tell<T: NoUninit>(&mut self, value: &T) -> Told {
        self.room.told.add(&self.gpu.device, bytemuck::bytes_of(value))
    }

    /// The encoder, outside of a pass.
    pub(super) fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        let device = &self.gpu.device;
        self.encoder.get_or_insert_with(|| device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default()))
    }

    pub(super) fn submit(&mut self) {
        self.pass = None;
        if let Some(encoder) = self.encoder.take() {
            self.room.told.write(&self.gpu.queue);
            self.gpu.queue.submit([encoder.finish()]);
        }
    }

    /// Runs a kernel of so many groups on what it is told, which has the first bindings, and on buffers by their binding; nothing where there are no
    /// groups.
    pub(crate) fn run(&mut self, kernel: &Kernel, told: &[&Told], bindings: &[(u32, &Buffer)], groups: u32) {
        if groups == 0 {
            return;
        }
        let y = groups.div_ceil(MOST_GROUPS);
        self.run_over(kernel, told, bindings, [groups.div_ceil(y), y, 1]);
    }

    /// Runs a kernel over a grid of groups.
    pub(crate) fn run_over(&mut self, kernel: &Kernel, told: &[&Told], bindings: &[(u32, &Buffer)], groups: [u32; 3]) {
        let device = &self.gpu.device;
        let (pipeline, layout) =
            self.room.pipelines.entry(kernel.name).or_insert_with(|| built(device, kernel)).clone();
        let told = told.iter().zip(0..).map(|(told, binding)| wgpu::BindGroupEntry { binding, resource: told.bound() });
        let buffers = bindings
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding: *binding, resource: buffer.as_entire_binding() });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.name),
            layout: &layout,
            entries: &told.chain(buffers).collect::<Vec<_>>(),
        });
        let pass = self.pass(kernel.name);
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
    }

    /// The pass that the next dispatch is part of: one of its own where it is timed.
    fn pass(&mut self, name: &'static str) -> &mut wgpu::ComputePass<'static> {
        if self.clock.is_some() {
            self.pass = None;
        }
        let device = &self.gpu.device;
        let (clock, encoder) = (&mut self.clock, &mut self.encoder);
        self.pass.get_or_insert_with(|| {
            let encoder = encoder
                .get_or_insert_with(|| device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default()));
            let timestamp_writes = clock.as_mut().and_then(|clock| clock.next(name));
            let descriptor = wgpu::ComputePassDescriptor { label: Some(name), timestamp_writes };
            encoder.begin_compute_pass(&descriptor).forget_lifetime()
        })
    }
}

fn built(device: &wgpu::Device, kernel: &Kernel) -> (ComputePipeline, BindGroupLayout) {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(kernel.name),
        source: wgpu::ShaderSource::Wgsl(kernel.text().into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(kernel.name),
        layout: None,
        module: &module,
        entry_point: Some(kernel.entry),
        compilation_options: wgpu::PipelineCompilationOptions {
            zero_initialize_workgroup_memory: false,
            ..wgpu::PipelineCompilationOptions::default()
        },
        cache: None,
    });
    let layout = pipeline.get_bind_group_layout(0);
    (pipeline, layout)
}
