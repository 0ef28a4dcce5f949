//! Choice of a graphics adapter, shared by the compute path and the renderer of Sinew.
//!
//! Both work without a window. [`list`] says what is there, [`open`] takes the best adapter that fits an
//! [`AdapterRequest`], and [`AdapterError`] says what was found when none fits. A software adapter (Vulkan
//! on the processor, such as Mesa's lavapipe) is as good as any other for correctness, never for speed;
//! [`AdapterSummary::software`] tells it apart.
//!
//! The environment variable [`ADAPTER_VARIABLE`] replaces the name that was asked for: a part of an
//! adapter's name, or the word `software`.
//!
//! ```
//! use sinew_adapter::{AdapterError, AdapterRequest, open};
//!
//! match open(&AdapterRequest::default()) {
//!     Ok(gpu) => {
//!         assert!(!gpu.summary.name.is_empty());
//!         // What WebGPU guarantees, or more.
//!         assert!(gpu.device.limits().max_storage_buffer_binding_size >= 128 << 20);
//!     }
//!     // A machine without a driver is told what to install.
//!     Err(error @ AdapterError::NoneFound { .. }) => {
//!         assert!(error.to_string().contains("mesa-vulkan-drivers"));
//!     }
//!     Err(error) => panic!("{error}"),
//! }
//! ```
mod choice;

use std::fmt;

use serde::{Deserialize, Serialize};
pub use wgpu;

/// The environment variable that overrides [`AdapterRequest::name`]: part of an adapter's name, case
/// ignored, or `software` for any adapter on the processor.
pub const ADAPTER_VARIABLE: &str = "SINEW_ADAPTER";

/// Driver interface through which an adapter is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GraphicsApi {
    /// Vulkan: Linux, Windows, Android.
    Vulkan,
    /// Metal: Apple systems.
    Metal,
    /// Direct3D 12: Windows.
    Dx12,
}

impl GraphicsApi {
    fn of(backend: wgpu::Backend) -> Option<Self> {
        match backend {
            wgpu::Backend::Vulkan => Some(Self::Vulkan),
            wgpu::Backend::Metal => Some(Self::Metal),
            wgpu::Backend::Dx12 => Some(Self::Dx12),
            _ => None,
        }
    }
}

impl fmt::Display for GraphicsApi {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Vulkan => "Vulkan",
            Self::Metal => "Metal",
            Self::Dx12 => "DX12",
        })
    }
}

/// Which of several hardware adapters to prefer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PowerPreference {
    /// Separate graphics cards before those that share the processor's memory.
    #[default]
    HighPerformance,
    /// The other way round.
    LowPower,
}

/// What is asked of an adapter. The default takes the fastest kind there is, software last.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdapterRequest {
    /// Part of the adapter's name, case ignored.
    pub name: Option<String>,
    /// Driver interface; any when `None`.
    pub backend: Option<GraphicsApi>,
    /// `Some(true)`: only an adapter on the processor; `Some(false)`: never one; `None`: last choice.
    pub software: Option<bool>,
    /// Order among hardware adapters.
    pub power: PowerPreference,
}

/// Kind of an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AdapterKind {
    /// A card with memory of its own.
    Discrete,
    /// A graphics processor that shares the main memory.
    Integrated,
    /// A graphics processor as a virtual machine shows it.
    Virtual,
    /// Software on the main processor: right results, no speed.
    Software,
    /// The driver does not say.
    Other,
}

impl fmt::Display for AdapterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Software => "software",
            Self::Other => "other",
        })
    }
}

/// What a report says about an adapter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AdapterSummary {
    /// The driver's name of it.
    pub name: String,
    /// Driver interface.
    pub backend: GraphicsApi,
    /// Kind of processor.
    pub kind: AdapterKind,
    /// Name and version of the driver.
    pub driver: String,
    /// Largest part of a buffer that a shader can see at once (bytes).
    pub max_binding_bytes: u64,
    /// Largest buffer (bytes).
    pub max_buffer_bytes: u64,
}

impl AdapterSummary {
    /// Whether shaders run on the main processor.
    pub fn software(&self) -> bool {
        self.kind == AdapterKind::Software
    }

    fn of(adapter: &wgpu::Adapter) -> Option<Self> {
        let info = adapter.get_info();
        let limits = adapter.limits();
        Some(Self {
            backend: GraphicsApi::of(info.backend)?,
            kind: match info.device_type {
                wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
                wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
                wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
                wgpu::DeviceType::Cpu => AdapterKind::Software,
                wgpu::DeviceType::Other => AdapterKind::Other,
            },
            driver: [info.driver, info.driver_info]
                .into_iter()
                .filter(|part| !part.is_empty())
                .collect::<Vec<_>>()
                .join(" "),
            name: info.name,
            max_binding_bytes: limits.max_storage_buffer_binding_size,
            max_buffer_bytes: limits.max_buffer_size,
        })
    }
}

impl fmt::Display for AdapterSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {})", self.name, self.backend, self.kind)
    }
}

/// An opened adapter.
#[derive(Debug, Clone)]
pub struct Gpu {
    /// The library's entry point.
    pub instance: wgpu::Instance,
    /// The adapter that was chosen.
    pub adapter: wgpu::Adapter,
    /// Creates buffers, pipelines and commands.
    pub device: wgpu::Device,
    /// Takes commands.
    pub queue: wgpu::Queue,
    /// What to say about it.
    pub summary: AdapterSummary,
    /// Whether passes can be timed on the device (`TIMESTAMP_QUERY`).
    pub timestamps: bool,
}

/// Why no adapter was opened.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AdapterError {
    /// No driver offers an adapter.
    #[error(
        "no graphics adapter: install a driver for the graphics card, or a software one (Debian: \
         mesa-vulkan-drivers), or use the CPU backend"
    )]
    NoneFound,
    /// Adapters exist, none is what was asked for.
    #[error(
        "no graphics adapter matches {wanted}; there is: {found}; change the request or the environment \
         variable SINEW_ADAPTER, or install a driver (a software one: Debian's mesa-vulkan-drivers)"
    )]
    NoMatch {
        /// The request in words.
        wanted: String,
        /// The adapters there are.
        found: String,
    },
    /// The adapter does not offer what WebGPU asks of every adapter.
    #[error(
        "graphics adapter {adapter} offers {limit} = {offered}, {needed} is needed; choose another with the \
         environment variable SINEW_ADAPTER; there is: {found}"
    )]
    TooSmall {
        /// Its name.
        adapter: String,
        /// The limit's name in WebGPU.
        limit: &'static str,
        /// What it offers.
        offered: u64,
        /// What is needed.
        needed: u64,
        /// The adapters there are.
        found: String,
    },
    /// The driver refused.
    #[error(
        "graphics adapter {adapter} could not be opened: {reason}; choose another with the environment \
         variable SINEW_ADAPTER; there is: {found}"
    )]
    Refused {
        /// Its name.
        adapter: String,
        /// The driver's words.
        reason: String,
        /// The adapters there are.
        found: String,
    },
}

/// All adapters that can be reached, best first by the default request.
pub fn list() -> Vec<AdapterSummary> {
    let mut found: Vec<_> = adapters(&instance()).into_iter().map(|(_, summary)| summary).collect();
    found.sort_by_key(|summary| choice::rank(summary, PowerPreference::default()));
    found
}

/// Opens the best adapter that fits, with the limits of the adapter for buffers and textures where these
/// are above WebGPU's defaults, and with timestamp queries where it has them.
///
/// # Errors
/// [`AdapterError`] when none fits or the driver refuses; it lists the adapters there are.
pub fn open(request: &AdapterRequest) -> Result<Gpu, AdapterError> {
    let instance = instance();
    let mut found = adapters(&instance);
    let request = choice::overridden(request, std::env::var(ADAPTER_VARIABLE).ok().as_deref());
    let summaries: Vec<_> = found.iter().map(|(_, summary)| summary.clone()).collect();
    let (adapter, summary) = found.swap_remove(choice::choose(&summaries, &request)?);
    let listed = choice::listed(&summaries);
    let offered = adapter.limits();
    let mut refusal = None;
    wgpu::Limits::defaults().check_limits_with_fail_fn(&offered, true, |limit, needed, offered| {
        refusal = Some(AdapterError::TooSmall {
            adapter: summary.to_string(),
            limit,
            offered,
            needed,
            found: listed.clone(),
        });
    });
    if let Some(refusal) = refusal {
        return Err(refusal);
    }
    let timestamps = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("sinew"),
        required_features: if timestamps {
            wgpu::Features::TIMESTAMP_QUERY
        } else {
            wgpu::Features::empty()
        },
        required_limits: choice::limits(&offered),
        ..Default::default()
    };
    let (device, queue) =
        pollster::block_on(adapter.request_device(&descriptor)).map_err(|error| {
            AdapterError::Refused {
                adapter: summary.to_string(),
                reason: error.to_string(),
                found: listed,
            }
        })?;
    Ok(Gpu { instance, adapter, device, queue, summary, timestamps })
}

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    // The driver's own validation layers are a developer's tool: `WGPU_VALIDATION=1` switches them on.
    descriptor.flags = wgpu::InstanceFlags::empty().with_env();
    wgpu::Instance::new(descriptor)
}

fn adapters(instance: &wgpu::Instance) -> Vec<(wgpu::Adapter, AdapterSummary)> {
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()))
        .into_iter()
        .filter_map(|adapter| AdapterSummary::of(&adapter).map(|summary| (adapter, summary)))
        .collect()
}
