//! The GPUs of a machine, and one that was opened.

use std::future::Future;
use std::path::Path;
use std::pin::pin;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::task::{Context, Poll, Waker};

use super::error::GpuError;
use super::memory::Memory;
use super::room::Room;

/// Share of the memory that the driver offers that may be taken, percent.
const MOST_OF_MEMORY: u8 = 95;

/// A GPU that the machine has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// Its number among those of the machine.
    pub index: usize,
    /// Its name.
    pub name: String,
    /// Through what it is used: Vulkan, Metal or DX12.
    pub backend: String,
    /// Its driver.
    pub driver: String,
    /// Whether the processor plays it.
    pub is_software: bool,
}

/// A GPU that was opened. It stays open as long as the program runs.
pub struct Gpu {
    adapter: Adapter,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// Bytes that one buffer may have.
    pub(super) most_bytes: u64,
    pub(super) memory: Memory,
    /// Buffers and kernels; whoever draws holds it.
    pub(super) room: Mutex<Room>,
    pub(super) failure: Arc<Mutex<Option<String>>>,
    refusals: Mutex<Vec<String>>,
}

impl Gpu {
    /// What it is.
    pub const fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// Lets it hold so many bytes, and no more; what it holds already stays.
    pub fn limit_memory(&self, bytes: u64) {
        self.memory.set_limit(bytes);
    }

    /// Why work that it was asked for was done by the processor, each reason once.
    pub fn refusals(&self) -> Vec<String> {
        self.refusals.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Notes why the processor does what it was asked for.
    pub fn refused(&self, error: &GpuError) {
        let mut refusals = self.refusals.lock().unwrap_or_else(PoisonError::into_inner);
        let reason = error.to_string();
        if !refusals.contains(&reason) {
            refusals.push(reason);
        }
    }

    /// Stops it, as if it had been lost: what it is asked for from now on is refused.
    pub fn stop(&self) {
        self.device.destroy();
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert("it was stopped".to_owned());
    }

    /// Whether it works.
    ///
    /// # Errors
    /// [`GpuError::Lost`] once it has stopped.
    pub(super) fn check(&self) -> Result<(), GpuError> {
        match &*self.failure.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(reason) => Err(GpuError::Lost(reason.clone())),
            None => Ok(()),
        }
    }
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Gpu").field("adapter", &self.adapter).finish_non_exhaustive()
    }
}

/// The GPUs of this machine, those that the processor plays included.
pub fn adapters() -> Vec<Adapter> {
    found().iter().enumerate().map(|(index, adapter)| describe(index, adapter)).collect()
}

/// The first real GPU; `None` where there is none, or it cannot be opened.
pub fn open_real() -> Option<&'static Gpu> {
    // Without a device file there is none, and no driver has to be loaded to tell: software ones are slow to begin.
    let files = ["/dev/dri", "/dev/nvidiactl", "/dev/kfd", "/dev/dxg"];
    if cfg!(target_os = "linux") && !files.iter().any(|file| Path::new(file).exists()) {
        return None;
    }
    let real = adapters().into_iter().find(|adapter| !adapter.is_software)?;
    open(real.index).ok()
}

/// The GPU of a number; the same every time.
///
/// # Errors
/// [`GpuError::NotOpened`] where there is none, or it does not do what drawing needs.
pub fn open(index: usize) -> Result<&'static Gpu, GpuError> {
    static OPENED: Mutex<Vec<(usize, &'static Gpu)>> = Mutex::new(Vec::new());
    let mut opened = OPENED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, gpu)) = opened.iter().find(|(number, _)| *number == index) {
        return Ok(gpu);
    }
    let found = found();
    let adapter = found
        .get(index)
        .ok_or_else(|| GpuError::NotOpened(format!("expected a GPU of number {index}, found {}", found.len())))?;
    // What is open stays so: nothing is won by closing it before the program ends.
    let gpu: &'static Gpu = Box::leak(Box::new(opened_gpu(index, adapter)?));
    opened.push((index, gpu));
    Ok(gpu)
}

/// The GPU of a number, as if it gave out less memory at once: for who wants to see what does not fit.
///
/// # Errors
/// As [`open`].
pub fn open_limited(index: usize, most_bytes: u64) -> Result<&'static Gpu, GpuError> {
    let found = found();
    let adapter = found
        .get(index)
        .ok_or_else(|| GpuError::NotOpened(format!("expected a GPU of number {index}, found {}", found.len())))?;
    let opened = opened_gpu(index, adapter)?;
    Ok(Box::leak(Box::new(Gpu { most_bytes: opened.most_bytes.min(most_bytes), ..opened })))
}

fn opened_gpu(index: usize, adapter: &wgpu::Adapter) -> Result<Gpu, GpuError> {
    let limits = adapter.limits();
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("lgs"),
        required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
        required_limits: limits.clone(),
        memory_hints: wgpu::MemoryHints::Performance,
        ..wgpu::DeviceDescriptor::default()
    };
    let opening = ready(adapter.request_device(&descriptor));
    let (device, queue) = opening.map_err(|error| GpuError::NotOpened(error.to_string()))?;
    let failure = Arc::new(Mutex::new(None));
    let note = |failure: &Mutex<Option<String>>, reason: String| {
        failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(reason);
    };
    let of_errors = Arc::clone(&failure);
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&of_errors, one_line(&error.to_string()))));
    let of_loss = Arc::clone(&failure);
    device.set_device_lost_callback(move |_, reason| note(&of_loss, one_line(&reason)));
    Ok(Gpu {
        adapter: describe(index, adapter),
        most_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
        device,
        queue,
        room: Mutex::new(Room::default()),
        failure,
        memory: Memory::default(),
        refusals: Mutex::new(Vec::new()),
    })
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Looked for once: it takes a while.
fn found() -> &'static [wgpu::Adapter] {
    static FOUND: OnceLock<Vec<wgpu::Adapter>> = OnceLock::new();
    FOUND.get_or_init(look)
}

fn look() -> Vec<wgpu::Adapter> {
    let backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    // Where the driver tells how much memory is free, what would take nearly all of it is refused before the system suffers.
    let memory_budget_thresholds =
        wgpu::MemoryBudgetThresholds { for_resource_creation: Some(MOST_OF_MEMORY), for_device_loss: None };
    let plain = wgpu::InstanceDescriptor::new_without_display_handle();
    let descriptor = wgpu::InstanceDescriptor { backends, memory_budget_thresholds, ..plain };
    ready(wgpu::Instance::new(descriptor).enumerate_adapters(backends))
}

fn describe(index: usize, adapter: &wgpu::Adapter) -> Adapter {
    let info = adapter.get_info();
    Adapter {
        index,
        name: info.name,
        backend: info.backend.to_string(),
        driver: one_line(&format!("{} {}", info.driver, info.driver_info)),
        is_software: info.device_type == wgpu::DeviceType::Cpu,
    }
}

/// The value of a future that waits for nothing: outside of browsers these are.
fn ready<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
        std::thread::yield_now();
    }
}
