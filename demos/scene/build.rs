//! Compiler version and optimisation level, for the summary of a run.

use std::process::Command;

fn main() {
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    let version = Command::new(rustc)
        .arg("--version")
        .output()
        .ok()
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .unwrap_or_else(|| "unknown".into());
    println!("cargo::rustc-env=SINEW_RUSTC={}", version.trim());
    for name in ["TARGET", "OPT_LEVEL"] {
        let value = std::env::var(name).unwrap_or_else(|_| "unknown".into());
        println!("cargo::rustc-env=SINEW_{name}={value}");
    }
    println!("cargo::rerun-if-changed=build.rs");
}
