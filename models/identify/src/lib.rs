//! Spring constants of mass-spring bodies, identified from linear finite elements.
//!
//! A body of *lumped elements* (Natsupakpong & Cavusoglu 2010, "paper B") has the shape of a finite
//! element mesh. Every pair of nodes of an element is joined by a linear spring: 3 springs in a
//! triangle, 6 in a quadrilateral, 6 in a tetrahedron, 28 in a hexahedron. Their constants make the
//! stiffness of the springs at rest as close as possible to the stiffness of the finite element,
//! `min_k |R - K(k)|`. Springs of neighbouring elements on the same pair of nodes are added up.
//!
//! | module | holds |
//! |---|---|
//! | [`kind`] | kinds of elements, methods by name |
//! | [`material`] | moduli, plane stress and plane strain, thickness |
//! | [`cells`] | elements of a mesh |
//! | [`geometry`] | rest shapes of elements, projection to the mean plane |
//! | [`stiffness`] | linear finite element stiffness (N/m) |
//! | [`mass`] | lumped masses (kg) |
//! | [`springs`] | pairs of nodes and the stiffness of springs at rest |
//! | [`fit`] | the fits: Frobenius, off-diagonal blocks, 2-norm, non-negative ones; whether a 2-norm fit is unique |
//! | [`baselines`] | closed forms from the literature |
//! | [`method`] | one element by any of these |
//! | [`mesh`] | a whole mesh, in parallel; congruent elements are fitted once |
//! | [`response`] | the moduli that a spring lattice really has |
//! | [`error_metrics`] | paper B's errors between two sets of positions |
//! | `virtual_test` (feature `virtual-test`) | tension, shear, torsion and bending of meshes: finite elements against springs; springs found for a whole body |
//!
//! # What springs cannot do
//!
//! Central forces obey the Cauchy relation `C12 = C44`, so an isotropic lattice has a Poisson ratio of
//! 1/4 in space and 1/3 in the plane for any target ([`response`] measures it). Near
//! incompressibility the fits are several times too stiff in tension. Fits may also give negative
//! constants, which make a tangent indefinite; every fit counts them, and the non-negative fits
//! and [`ElementMethod::Delingette`] have none.
//!
//! ```
//! use sinew_identify::cells::Cells;
//! use sinew_identify::mesh::fit_elements;
//! use sinew_identify::{ElementMethod, LinearMaterial, Section};
//!
//! // two equilateral triangles of side 1 m, plane stress with nu = 1/3: springs are exact there
//! let h = 3f64.sqrt() / 2.0;
//! let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, h, 0.0], [1.5, h, 0.0]];
//! let cells = Cells { triangles: &[[0, 1, 2], [1, 3, 2]], ..Cells::default() };
//! let material = LinearMaterial::new(1.0, 1.0 / 3.0)?;
//! let springs =
//!     fit_elements(&points, &cells, &[material], &Section::default(), ElementMethod::Frobenius)?;
//! assert_eq!(springs.edges, [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]);
//! assert!((springs.constants[0] - 3f64.sqrt() / 4.0).abs() < 1e-15);
//! assert!((springs.constants[2] - 3f64.sqrt() / 2.0).abs() < 1e-15); // shared by both
//! assert_eq!(springs.report.distinct_fits, 1);
//! # Ok::<(), sinew_identify::IdentifyError>(())
//! ```

pub mod baselines;
pub mod cells;
pub mod error;
pub mod error_metrics;
pub mod fit;
pub mod geometry;
pub mod kind;
pub mod mass;
pub mod material;
pub mod mesh;
pub mod method;
pub mod response;
pub mod springs;
pub mod stiffness;
#[cfg(feature = "virtual-test")]
pub mod virtual_test;

pub use error::{ElementError, IdentifyError};
pub use fit::ElementFit;
pub use geometry::ElementGeometry;
pub use kind::{ElementKind, ElementMethod};
pub use material::{LinearMaterial, Plane, Section};
pub use method::fit_element;
