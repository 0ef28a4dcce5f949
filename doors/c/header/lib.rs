//! The header of the C library, written from its sources by cbindgen.
//!
//! `cargo test --manifest-path doors/c/header/Cargo.toml` compares it with the committed one; with `SINEW_HEADER=write` in the
//! environment it is written.
#![cfg(test)]

use std::path::{Path, PathBuf};

const ABOUT: &str = "/* Sinew: deformable bodies of soft tissue. SI units throughout.
 *
 * Written from the sources of crate sinew-c; do not edit. docs/c.md tells how to build the library and use this header.
 *
 * - Functions answer SINEW_OK or a code; sinew_last_error() says in words what went wrong and what to do.
 * - Set the member struct_size of structures to their sizeof, everything else that is not needed to 0.
 * - Lists of unknown length: ask with NULL and capacity 0, which tells `needed`, then once more with room for it.
 * - A simulation may be used by one thread at a time, and by another one later; a call while another one runs answers
 *   SINEW_BUSY. After SINEW_PANIC it can only be freed.
 */";

/// What cbindgen makes of the sources.
fn generated() -> String {
    let mut config = cbindgen::Config {
        language: cbindgen::Language::C,
        cpp_compat: true,
        header: Some(ABOUT.into()),
        include_guard: Some("SINEW_H".into()),
        no_includes: true,
        sys_includes: vec!["stddef.h".into(), "stdint.h".into()],
        usize_is_size_t: true,
        documentation_style: cbindgen::DocumentationStyle::C99,
        style: cbindgen::Style::Both,
        ..cbindgen::Config::default()
    };
    config.export.exclude = vec!["sinew_test_panic".into()];
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("../src");
    let mut builder = cbindgen::Builder::new().with_config(config);
    for name in ["types", "reports", "call", "simulation", "snapshot", "mesh", "body", "act", "touch", "thread", "live", "report"] {
        builder = builder.with_src(sources.join(format!("{name}.rs")));
    }
    let mut raw = Vec::new();
    builder.generate().unwrap().write(&mut raw);
    String::from_utf8(raw).unwrap()
}

fn committed() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../include/sinew.h")
}

#[test]
fn the_header_is_that_of_the_sources() {
    let generated = generated();
    if std::env::var("SINEW_HEADER").is_ok_and(|value| value == "write") {
        std::fs::write(committed(), &generated).unwrap();
    }
    let found = std::fs::read_to_string(committed()).unwrap_or_default();
    assert!(
        found == generated,
        "doors/c/include/sinew.h is not that of the sources: run this test with SINEW_HEADER=write"
    );
    assert!(!found.contains("sinew_test") && found.contains("#define SINEW_ABI "));
}
