//! Materials and force laws of Sinew: plain functions on plain values.
//!
//! | module | content |
//! |---|---|
//! | [`material`] | Young's modulus, Poisson's ratio and density as the user states them, Lamé parameters, tissue presets; materials that vary from element to element |
//! | [`element`] | single elements: rest shapes and their spring constants, energy, forces and tangents of tetrahedra and membrane triangles |
//! | [`frame`] | what runs a law over all elements of a kind, several at a time; the traits that a law implements |
//! | [`laws`] | the table of laws and the laws: each with energy, forces and tangents in its docs |
//! | [`axes`] | axes of anisotropy, fibre fields, muscles, preservation of volume |
//! | [`body`] | from mesh and material to entities, and to a new material; membranes and lumped springs as parts of bodies |
//! | [`resection`] | removal of elements |
//! | [`cutting`] | cuts through elements: material, copies with shares of volume, ghosts |
//! | [`traction`] | what vertices get of tractions on faces |
//!
//! Comparison models, each fused only, without compression term:
//!
//! | module | for | not for |
//! |---|---|---|
//! | [`laws::linear`] | finite element references, modes of vibration, small displacements | anything that turns: it swells |
//! | [`laws::corotational`] `corotational_warped` | the classic of real-time simulation: forces of the next row, tangent always definite | Newton's method to convergence: linear, not quadratic |
//! | [`laws::corotational`] `corotational` | comparison with other engines, recovery from inversion | large strain of real materials |
//! | [`laws::stvk_fem`] | cost and rounding of the textbook form | work: same energy as the default, slower |
//! | [`laws::neo_hookean`] | large strain, strong compression | small-strain speed: its projected tangent decomposes every element |
//! | [`laws::svk_volume`] | nearly incompressible solids at large strain | small-strain speed, likewise |
//!
//! Everything is in SI units and driven by the displacement `u` from the rest shape, never by
//! positions: differences of displacements keep their digits in `f32` where differences of
//! positions do not. Kernels are generic over [`Real`](sinew_engine::scalar::Real), one number
//! or a register of them, allocate nothing and hold no state.
//!
//! ```
//! use sinew_models::material::YoungPoisson;
//! use sinew_models::element::precompute::RestTetrahedron;
//! use sinew_models::element::tetrahedron::{self, Element};
//!
//! let material = YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.45, density: 1060.0 };
//! let rest = RestTetrahedron::new([
//!     [0.0, 0.0, 0.0],
//!     [0.01, 0.0, 0.0],
//!     [0.0, 0.01, 0.0],
//!     [0.0, 0.0, 0.01],
//! ])?;
//! let element = Element::<f64>::new(&rest, material.lame()?, true);
//!
//! // Lift the last node by a tenth of the altitude: it is pulled back down.
//! let u = [[0.0; 3], [0.0; 3], [0.0; 3], [0.0, 0.0, 1e-3]];
//! assert!((tetrahedron::volume_ratio(&element, &u) - 1.1).abs() < 1e-12);
//! let forces = tetrahedron::forces(&element, &u);
//! assert!(forces[3][2] < 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod axes;
pub mod body;
pub mod cutting;
pub mod edits;
pub mod element;
pub mod frame;
pub mod laws;
pub mod material;
pub mod resection;
pub mod traction;
