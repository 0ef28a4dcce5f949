//! Forces and steps of Sinew on any graphics processor that `wgpu` reaches (Vulkan, Metal, DX12).
//!
//! A world is the same on both backends: bodies, constraints, loads, reports and columns. [`install_gpu`] installs
//! the integrator of the device, as `sinew_solvers::install_solver` installs that of the processor; `Simulation` does
//! so for `backend = "gpu"`. [`GpuReport`] holds times and traffic of the last step.
//!
//! # What runs there
//!
//! * The laws below, any number of them in a body ([`laws`]).
//! * The safe step (`Integrator::Safe`; `auto` means it here): tangent, projected where it is
//!   indefinite, conjugate gradients with inverse diagonal blocks or two levels, line search, energy cap, recovery from
//!   inversion; held and prescribed vertices, loads, gravity, Rayleigh damping; many bodies.
//! * Explicit substeps (`SymplecticEuler`, `StormerVerlet`), with loads and motions that vary within a step. The
//!   stability limit is estimated on the processor, at the start and when edges have changed.
//!
//! Everything else is an error that names it ([`GpuError`]), from [`check`] and from a step. Nothing is left out
//! silently.
//!
//! | elements | laws |
//! |---|---|
//! | tetrahedra | St Venant-Kirchhoff fused, with and without compression term; the same as in textbooks; quadratic springs, linear, stiffness warping, corotational, stable neo-Hookean |
//! | tetrahedra, triangles and edges of pooled bodies | tensile, angular and volumetric springs, compression term, projected tangent |
//! | hexahedra, 2x2x2 Gauss points | St Venant-Kirchhoff with and without compression term, linear, corotational, stable neo-Hookean |
//! | edges | springs |
//! | axes in tetrahedra, and in hexahedra at their Gauss points | triads with angles and volume, single fibres, passive and active, volume alone; dampers, in safe steps |
//! | membrane triangles | biquadratic springs with and without compression term, fused and pooled; quadratic springs, linear, corotational |
//! | membrane quadrilaterals, 2x2 Gauss points | biquadratic springs with and without compression term, linear, corotational |
//! | surface triangles | follower pressure, in safe steps |
//!
//! # How
//!
//! * **`f32` on displacements**, never positions: forces keep five to six digits at any strain. The host adds
//!   partial sums of energy in `f64` and decides on them.
//! * **Two passes, no atomics.** A body has a set of elements for each of its laws. Elements write forces (tangent
//!   blocks) into slots of their own; vertices (blocks of the matrix) gather them through lists in the order of the
//!   elements, set after set in the order of the laws on the processor. Sums are formed by fixed trees, so one
//!   device repeats its bits, however buffers are cut.
//! * **Two levels** precondition (`coarse.rs`): from 600 vertices on by default, and as `"multigrid"`.
//! * **The tangent is assembled**, all 3x3 blocks of a row next to each other; `matrix.rs` says why.
//! * **Constants are uploaded when they change**, only those of the laws that read them: activations, a new
//!   material, removed elements. Lists and matrices stay until the vertices of elements change.
//! * **A pressure is a set of elements** whose factor is its value in the step. Products rely on blocks of a row
//!   that sum to 0; where pressure acts, the remainder is stored separately. Its potential is booked as load.
//! * **The host sees sums only.** A smooth step waits three times: for conjugate gradients, for the line search and
//!   for the end. Conjugate gradients run in batches as long as those of the last step, and verify their true
//!   residual on the device.
//! * **Buffers are cut** to the adapter's binding limit: elements into chunks, the matrix into ranges of rows.
//!   Vertex rows are not: a vertex takes 19 slots of 16 bytes, so a body has at most 441 000 vertices at the 128 MiB
//!   that every adapter has, and 7.0 million at 2 GiB. The largest limit of the adapter is requested.
//! * **The state is downloaded** after every step, 32 bytes a vertex, or only when somebody asks ([`readback`]).
//!   Sums and volume ratios are formed on the device.
//!
//! The WGSL of a law is next to the file that names its columns, with functions named as in `sinew_models`. Common
//! code is in `prelude.wgsl` and `elements.wgsl`, the code of a kind of element in a file of its own. A module is
//! these files one after another ([`shaders`]).
//!
//! ```
//! use sinew_gpu::{GpuBackend, GpuError, GpuOptions};
//!
//! match GpuBackend::new(&GpuOptions::default()) {
//!     Ok(backend) => assert!(!backend.summary().name.is_empty()),
//!     // a machine without a driver is told what to install
//!     Err(error @ GpuError::Adapter(_)) => assert!(error.to_string().contains("driver")),
//!     Err(error) => panic!("{error}"),
//! }
//! // every law is a whole module
//! assert!(sinew_gpu::laws::all().any(|law| law.name() == "linear elasticity"));
//! assert!(sinew_gpu::shaders().iter().all(|module| module.text.contains("@compute")));
//! ```
pub mod backend;
// public for the tests of this crate, which look into the coarse space
#[doc(hidden)]
pub mod body;
#[doc(hidden)]
pub mod coarse;
#[doc(hidden)]
pub mod context;
mod elements;
mod error;
mod explicit;
pub mod laws;
mod lists;
#[doc(hidden)]
pub mod matrix;
pub mod measure;
pub mod readback;
mod recovery;
pub mod report;
mod safe;
pub mod sources;
mod substeps;

pub use backend::{GpuBackend, GpuOptions, check, install_gpu};
pub use error::GpuError;
pub use measure::{DeviceEvaluation, DeviceVolumes, ForceTiming};
pub use readback::{columns_needed, fetch_state};
pub use report::GpuReport;

/// Every module of WGSL, for validation without an adapter.
pub fn shaders() -> Vec<sources::ShaderSource> {
    let shared = sources::SHARED.iter().map(|(name, _)| sources::shared(name));
    shared.chain(laws::all().map(|law| law.source())).collect()
}
