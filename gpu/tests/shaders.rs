//! Every shader is valid WGSL. Needs no adapter.

use naga::valid::{Capabilities, ValidationFlags, Validator};

#[test]
fn every_shader_is_valid() {
    for source in sinew_gpu::shaders() {
        let module = naga::front::wgsl::parse_str(&source.text)
            .unwrap_or_else(|e| panic!("{}: {}", source.name, e.emit_to_string(&source.text)));
        assert!(!module.entry_points.is_empty(), "{} has no entry point", source.name);
        Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{}: {}", source.name, e.emit_to_string(&source.text)));
        // what WebGPU guarantees
        for entry in &module.entry_points {
            assert_eq!(entry.workgroup_size, [256, 1, 1], "{}", entry.name);
        }
    }
}
