//! Which adapter fits a request: pure functions, tested without any driver.
use crate::{AdapterError, AdapterKind, AdapterRequest, AdapterSummary, PowerPreference};

/// Smaller is better.
pub(crate) fn rank(summary: &AdapterSummary, power: PowerPreference) -> u8 {
    use AdapterKind::{Discrete, Integrated, Other, Software, Virtual};
    let order = match power {
        PowerPreference::HighPerformance => [Discrete, Integrated, Virtual, Other, Software],
        PowerPreference::LowPower => [Integrated, Discrete, Virtual, Other, Software],
    };
    order.iter().position(|kind| *kind == summary.kind).map_or(u8::MAX, |place| place as u8)
}

/// `request` with the environment's word instead of its name.
pub(crate) fn overridden(request: &AdapterRequest, variable: Option<&str>) -> AdapterRequest {
    let mut request = request.clone();
    match variable.map(str::trim) {
        None | Some("") => {}
        Some(word) if word.eq_ignore_ascii_case("software") => {
            request.name = None;
            request.backend = None;
            request.software = Some(true);
        }
        Some(name) => {
            request.name = Some(name.to_owned());
            request.backend = None;
            request.software = None;
        }
    }
    request
}

/// Index of the best adapter.
pub(crate) fn choose(
    found: &[AdapterSummary],
    request: &AdapterRequest,
) -> Result<usize, AdapterError> {
    if found.is_empty() {
        return Err(AdapterError::NoneFound);
    }
    let name = request.name.as_ref().map(|name| name.to_lowercase());
    found
        .iter()
        .enumerate()
        .filter(|(_, summary)| {
            name.as_ref().is_none_or(|name| summary.name.to_lowercase().contains(name))
                && request.backend.is_none_or(|backend| backend == summary.backend)
                && request.software.is_none_or(|software| software == summary.software())
        })
        .min_by_key(|(_, summary)| rank(summary, request.power))
        .map(|(index, _)| index)
        .ok_or_else(|| AdapterError::NoMatch { wanted: words(request), found: listed(found) })
}

/// The adapters in one line.
pub(crate) fn listed(found: &[AdapterSummary]) -> String {
    found.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

fn words(request: &AdapterRequest) -> String {
    let mut words = Vec::new();
    if let Some(name) = &request.name {
        words.push(format!("the name \"{name}\""));
    }
    if let Some(backend) = request.backend {
        words.push(format!("the interface {backend}"));
    }
    match request.software {
        Some(true) => words.push("software only".to_owned()),
        Some(false) => words.push("no software".to_owned()),
        None => {}
    }
    if words.is_empty() { "any".to_owned() } else { words.join(", ") }
}

/// WebGPU's defaults, raised to what the adapter offers where size matters: large bodies and pictures.
pub(crate) fn limits(offered: &wgpu::Limits) -> wgpu::Limits {
    let defaults = wgpu::Limits::defaults();
    wgpu::Limits {
        max_buffer_size: offered.max_buffer_size.max(defaults.max_buffer_size),
        max_storage_buffer_binding_size: offered
            .max_storage_buffer_binding_size
            .max(defaults.max_storage_buffer_binding_size),
        max_texture_dimension_2d: offered
            .max_texture_dimension_2d
            .max(defaults.max_texture_dimension_2d),
        ..defaults
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GraphicsApi;

    fn summary(name: &str, backend: GraphicsApi, kind: AdapterKind) -> AdapterSummary {
        AdapterSummary {
            name: name.to_owned(),
            backend,
            kind,
            driver: String::new(),
            max_binding_bytes: 128 << 20,
            max_buffer_bytes: 256 << 20,
        }
    }

    fn machine() -> Vec<AdapterSummary> {
        vec![
            summary("llvmpipe (LLVM 15)", GraphicsApi::Vulkan, AdapterKind::Software),
            summary("Integrated 630", GraphicsApi::Vulkan, AdapterKind::Integrated),
            summary("Large Card", GraphicsApi::Dx12, AdapterKind::Discrete),
            summary("Large Card", GraphicsApi::Vulkan, AdapterKind::Discrete),
        ]
    }

    #[test]
    fn hardware_comes_first_and_power_orders_it() {
        let found = machine();
        assert_eq!(choose(&found, &AdapterRequest::default()), Ok(2));
        let low = AdapterRequest { power: PowerPreference::LowPower, ..Default::default() };
        assert_eq!(choose(&found, &low), Ok(1));
        assert_eq!(choose(&found[..1], &AdapterRequest::default()), Ok(0));
    }

    #[test]
    fn name_interface_and_software_narrow_the_choice() {
        let found = machine();
        let by = |name: Option<&str>, backend, software| AdapterRequest {
            name: name.map(str::to_owned),
            backend,
            software,
            ..Default::default()
        };
        assert_eq!(choose(&found, &by(Some("LLVMPIPE"), None, None)), Ok(0));
        assert_eq!(choose(&found, &by(None, Some(GraphicsApi::Vulkan), None)), Ok(3));
        assert_eq!(choose(&found, &by(None, None, Some(true))), Ok(0));
        let error = choose(&found, &by(Some("card"), None, Some(true))).unwrap_err().to_string();
        for word in ["\"card\"", "software only", "Integrated 630", "mesa-vulkan-drivers"] {
            assert!(error.contains(word), "{error}");
        }
        assert_eq!(choose(&[], &by(None, None, None)), Err(AdapterError::NoneFound));
    }

    #[test]
    fn the_environment_overrides_the_request() {
        let asked = AdapterRequest {
            name: Some("card".into()),
            software: Some(false),
            ..Default::default()
        };
        assert_eq!(overridden(&asked, None), asked);
        assert_eq!(overridden(&asked, Some(" ")), asked);
        let soft = overridden(&asked, Some("Software"));
        assert_eq!((soft.name, soft.software), (None, Some(true)));
        let named = overridden(&asked, Some("630"));
        assert_eq!((named.name.as_deref(), named.software), (Some("630"), None));
    }

    #[test]
    fn limits_never_fall_below_what_every_adapter_offers() {
        let mut offered = wgpu::Limits::defaults();
        offered.max_storage_buffer_binding_size = 1 << 30;
        offered.max_buffer_size = 2 << 30;
        let limits = limits(&offered);
        assert_eq!(limits.max_storage_buffer_binding_size, 1 << 30);
        assert_eq!(limits.max_buffer_size, 2 << 30);
        assert_eq!(limits.max_storage_buffers_per_shader_stage, 8);
    }
}
