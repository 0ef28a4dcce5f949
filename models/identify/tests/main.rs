//! Springs of elements and meshes. In one binary: each would link, and in part compile, everything below for itself.

#[path = "../../../tests/common/json.rs"]
mod json;
mod mesh;
mod reference;
#[cfg(feature = "virtual-test")]
mod virtual_test;
#[cfg(feature = "virtual-test")]
mod whole;
