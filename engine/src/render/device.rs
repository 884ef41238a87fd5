//! Where views are drawn: by the processor, or on a GPU.

use std::num::NonZeroUsize;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

#[cfg(feature = "gpu")]
use super::gpu::{self, Gpu, GpuError};
use super::{Rendered, render};
use crate::error::{EngineError, Result};
use crate::gaussians::physical::Splat;
use crate::views::PinholeView;

/// Name of the setting.
const SETTING: &str = "device";

/// Where views are to be drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum DeviceChoice {
    /// On a real GPU where there is one, else by the processor.
    #[default]
    Auto,
    /// By the processor.
    Cpu,
    /// On a GPU: that of a number, or the first, real ones first.
    Gpu(Option<usize>),
}

/// Where views are drawn.
#[derive(Clone, Copy, Debug, Default)]
pub enum Device {
    /// By the processor.
    #[default]
    Cpu,
    /// On a GPU, which stays open as long as the program runs.
    #[cfg(feature = "gpu")]
    Gpu(&'static Gpu),
}

/// Where the views of a run were drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DrawnOn {
    /// The GPU's name and what it is used through; `CPU` for the processor.
    pub device: String,
    /// Why the processor drew what the GPU was asked for; no key where it did not.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<String>,
}

impl DeviceChoice {
    /// Whether nobody asked for another.
    pub fn is_auto(&self) -> bool {
        *self == Self::Auto
    }

    /// The device; the same every time.
    ///
    /// # Errors
    /// [`EngineError::Setting`] where a GPU is asked for and there is none, or this program draws on none.
    pub fn open(self) -> Result<Device> {
        match self {
            Self::Cpu => Ok(Device::Cpu),
            #[cfg(feature = "gpu")]
            Self::Auto => Ok(gpu::open_real().map_or(Device::Cpu, Device::Gpu)),
            #[cfg(feature = "gpu")]
            Self::Gpu(index) => {
                let adapters = gpu::adapters();
                let first = || adapters.iter().min_by_key(|adapter| adapter.is_software).map(|adapter| adapter.index);
                let found =
                    index.filter(|&index| index < adapters.len()).or_else(|| first().filter(|_| index.is_none()));
                let Some(index) = found else {
                    return Err(self.missing(format!("{} GPUs", adapters.len())));
                };
                gpu::open(index).map(Device::Gpu).map_err(|error| self.missing(error.to_string()))
            }
            #[cfg(not(feature = "gpu"))]
            Self::Auto => Ok(Device::Cpu),
            #[cfg(not(feature = "gpu"))]
            Self::Gpu(_) => Err(self.missing("a program that was built without the feature `gpu`".to_owned())),
        }
    }

    /// Fails where a GPU is asked for that cannot be opened; looks at none where nobody asks.
    ///
    /// # Errors
    /// As [`DeviceChoice::open`].
    pub fn check(self) -> Result<()> {
        match self {
            Self::Auto | Self::Cpu => Ok(()),
            Self::Gpu(_) => self.open().map(drop),
        }
    }

    /// As [`DeviceChoice::open`]; the processor where that fails, which [`DeviceChoice::check`] tells before.
    pub fn opened(self) -> Device {
        self.open().unwrap_or_default()
    }

    fn missing(self, found: String) -> EngineError {
        let expected = match self {
            Self::Gpu(Some(index)) => format!("a machine with a GPU of number {index}, from 0"),
            _ => "a machine with a GPU".to_owned(),
        };
        EngineError::Setting { setting: SETTING, expected, found }
    }
}

impl FromStr for DeviceChoice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let index = || text.strip_prefix("gpu:").and_then(|index| index.parse().ok());
        match text {
            "auto" => Ok(Self::Auto),
            "cpu" => Ok(Self::Cpu),
            "gpu" => Ok(Self::Gpu(None)),
            _ => index()
                .map(|index| Self::Gpu(Some(index)))
                .ok_or_else(|| format!("expected auto, cpu, gpu or gpu:N, found {text}")),
        }
    }
}

impl TryFrom<String> for DeviceChoice {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        text.parse()
    }
}

impl From<DeviceChoice> for String {
    fn from(choice: DeviceChoice) -> Self {
        match choice {
            DeviceChoice::Auto => "auto".to_owned(),
            DeviceChoice::Cpu => "cpu".to_owned(),
            DeviceChoice::Gpu(None) => "gpu".to_owned(),
            DeviceChoice::Gpu(Some(index)) => format!("gpu:{index}"),
        }
    }
}

impl PartialEq for Device {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Cpu, Self::Cpu) => true,
            #[cfg(feature = "gpu")]
            (Self::Gpu(a), Self::Gpu(b)) => std::ptr::eq(*a, *b),
            #[cfg(feature = "gpu")]
            _ => false,
        }
    }
}

impl Eq for Device {}

impl Device {
    /// The device, which may take so many 10^6 bytes from now on; as many as its driver gives where nobody says.
    #[must_use]
    pub fn held_to(self, megabytes: Option<NonZeroUsize>) -> Self {
        #[cfg(feature = "gpu")]
        if let Self::Gpu(gpu) = self {
            gpu.limit_memory(megabytes.map_or(u64::MAX, |count| (count.get() as u64).saturating_mul(1_000_000)));
        }
        // The processor has limits of its own.
        let _ = megabytes;
        self
    }

    /// As [`render`], here; by the processor where the GPU has not the room for it, or has stopped.
    pub fn render(self, splats: &[Splat], view: &PinholeView, background: [f32; 3]) -> Rendered {
        #[cfg(feature = "gpu")]
        if let Some(rendered) = self.try_gpu(|gpu| gpu::render(gpu, splats, view, background)) {
            return rendered;
        }
        render(splats, view, background)
    }

    /// What `work` gives on the GPU; `None` by the processor, and where the GPU could not, which is noted.
    #[cfg(feature = "gpu")]
    pub(crate) fn try_gpu<T>(self, work: impl FnOnce(&'static Gpu) -> std::result::Result<T, GpuError>) -> Option<T> {
        let Self::Gpu(gpu) = self else { return None };
        work(gpu).map_err(|error| gpu.refused(&error)).ok()
    }

    /// Where views were drawn until now.
    pub fn drawn_on(self) -> DrawnOn {
        match self {
            Self::Cpu => DrawnOn { device: "CPU".to_owned(), refused: Vec::new() },
            #[cfg(feature = "gpu")]
            Self::Gpu(gpu) => {
                let adapter = gpu.adapter();
                DrawnOn { device: format!("{} ({})", adapter.name, adapter.backend), refused: gpu.refusals() }
            }
        }
    }
}

/// A line for each GPU that the machine has: its number as `gpu:N`, its name, through what it is used and its driver.
pub fn devices() -> Vec<String> {
    #[cfg(feature = "gpu")]
    let found = gpu::adapters();
    #[cfg(feature = "gpu")]
    let lines = found.iter().map(|gpu::Adapter { index, name, backend, driver, is_software }| {
        let played = if *is_software { ", played by the processor" } else { "" };
        format!("gpu:{index}  {name} ({backend}, {driver}{played})")
    });
    #[cfg(not(feature = "gpu"))]
    let lines = std::iter::empty();
    std::iter::once("cpu".to_owned()).chain(lines).collect()
}

#[cfg(test)]
mod tests {
    use super::DeviceChoice;

    #[test]
    fn choices_are_read_as_they_are_told() {
        for text in ["auto", "cpu", "gpu", "gpu:0", "gpu:12"] {
            assert_eq!(String::from(text.parse::<DeviceChoice>().unwrap()), text);
        }
        for text in ["", "cuda", "gpu:", "gpu:-1", "gpu:x", "GPU"] {
            assert!(text.parse::<DeviceChoice>().unwrap_err().ends_with(text), "{text}");
        }
    }
}
