//! The native half of the Python package `sinew`: a thin skin over `sinew-embed`. `package/sinew/__init__.py` is the other half, which
//! names things and documents them.
#![forbid(unsafe_code)]

mod batch;
mod engine;
mod error;
mod input;
mod live;
mod mesh;
mod simulation;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use sinew_embed::InstructionSet;

/// What was built: version, machine, instruction sets.
#[pyfunction]
fn build_info(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let sets: Vec<_> = InstructionSet::available().map(InstructionSet::name).collect();
    let info = PyDict::new(py);
    info.set_item("version", sinew_embed::version())?;
    info.set_item("os", std::env::consts::OS)?;
    info.set_item("arch", std::env::consts::ARCH)?;
    info.set_item("optimised", !cfg!(debug_assertions))?;
    info.set_item("gpu", cfg!(feature = "gpu"))?;
    info.set_item("instruction_sets", sets)?;
    Ok(info)
}

/// Constants of a tissue preset: Young's modulus (Pa), Poisson's ratio, density (kg/m^3).
#[pyfunction]
fn preset(name: &str) -> PyResult<(f64, f64, f64)> {
    let own = sinew_embed::preset(name).map_err(error::raise)?;
    Ok((own.young_modulus, own.poisson_ratio, own.density))
}

/// The native module of the package.
#[pymodule(gil_used = true)]
mod _native {
    #[pymodule_export]
    use super::batch::step_all;
    #[pymodule_export]
    use super::live::{HapticDevice, HapticFeedback, Reader};
    #[pymodule_export]
    use super::mesh::Mesh;
    #[pymodule_export]
    use super::simulation::{Engine, Snapshot};
    #[pymodule_export]
    use super::{build_info, preset};
}
