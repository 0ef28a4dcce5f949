//! Materials and force laws of Sinew: plain functions on plain values.
//!
//! | module | content |
//! |---|---|
//! | [`material`] | Young's modulus, Poisson's ratio and density as the user states them, Lamé parameters, tissue presets |
//! | [`field`] | a material that varies from tetrahedron to tetrahedron |
//! | [`precompute`] | shape vectors and rest volume of a tetrahedron, its 21 biquadratic spring constants |
//! | [`spring`] | tensile and coupling springs on squared-length changes, one scalar at a time |
//! | [`quadratic`] | springs on changes of length: tetrahedra of quadratic springs (TQS), mass-spring edges |
//! | [`tetrahedron`] | the same energy per element in one pass, the compression term, exact and definite tangents and their products |
//! | [`membrane`] | triangles in space: biquadratic and quadratic springs, linear and corotational, their compression term |
//! | [`pressure`] | follower pressure on surfaces |
//! | [`axes`] | axes of anisotropy, fibre fields, muscles, preservation of volume |
//! | [`pooled`], [`fused`], [`fused_membrane`] | the systems that run these over all elements, several at a time |
//! | [`sheet`] | membranes as parts of bodies |
//! | [`body`], [`change`] | from mesh and material to entities, and to a new material |
//!
//! Comparison models, each fused only, without compression term:
//!
//! | module | for | not for |
//! |---|---|---|
//! | [`linear`] | finite element references, modes of vibration, small displacements | anything that turns: it swells |
//! | [`corotational`] `corotational_warped` | the classic of real-time simulation: forces of the next row, tangent always definite | Newton's method to convergence: linear, not quadratic |
//! | [`corotational`] `corotational` | comparison with other engines, recovery from inversion | large strain of real materials |
//! | [`stvk_fem`] | cost and rounding of the textbook form | work: same energy as the default, slower |
//! | [`neo_hookean`] | large strain, strong compression | small-strain speed: its projected tangent decomposes every element |
//!
//!
//! Everything is in SI units and driven by the displacement `u` from the rest shape, never by
//! positions: differences of displacements keep their digits in `f32` where differences of
//! positions do not. Kernels are generic over [`Real`](sinew_engine::scalar::Real), one number
//! or a register of them, allocate nothing and hold no state.
//!
//! ```
//! use sinew_models::material::YoungPoisson;
//! use sinew_models::precompute::RestTetrahedron;
//! use sinew_models::tetrahedron::{self, Element};
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
pub mod change;
pub mod corotational;
pub mod field;
pub mod fused;
pub mod fused_membrane;
pub mod hexahedron;
pub mod laws;
pub mod linear;
pub mod lumped;
pub mod material;
pub mod membrane;
pub mod model;
pub mod neo_hookean;
pub mod pooled;
pub mod precompute;
pub mod pressure;
mod projection;
pub mod quad;
pub mod quadratic;
pub mod resection;
pub mod sheet;
pub mod spring;
pub mod stvk_fem;
pub mod svk_volume;
pub mod tetrahedron;
