//! What can be wrong with the input, with the place and the remedy.

use thiserror::Error;

use crate::kind::{ElementKind, ElementMethod};

/// What is wrong with one element, its material or its method. [`IdentifyError::Element`] adds where.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ElementError {
    /// Young's modulus is not a positive number.
    #[error("Young's modulus is {0} Pa; give a finite value above 0")]
    YoungsModulus(f64),
    /// Poisson's ratio outside of what the element allows.
    #[error(
        "Poisson's ratio is {value}; {setting} needs a value above -1 and below {limit} \
         (0.45 is usual for soft tissue)"
    )]
    PoissonsRatio {
        /// the value given
        value: f64,
        /// what it was to be used for
        setting: &'static str,
        /// upper bound, exclusive
        limit: f64,
    },
    /// Thickness is not a positive number.
    #[error("thickness is {0} m; give a finite value above 0")]
    Thickness(f64),
    /// Density is not a positive number.
    #[error("density is {0} kg/m^3; give a finite value above 0")]
    Density(f64),
    /// A number of nodes that does not fit the kind of element.
    #[error("a {kind} has {expected} nodes, but {given} were given")]
    NodeCount {
        /// kind of element
        kind: ElementKind,
        /// nodes it has
        expected: usize,
        /// nodes given
        given: usize,
    },
    /// A coordinate is not finite.
    #[error("local node {node} has a coordinate that is not a finite number; repair the mesh")]
    NotFinite {
        /// local node
        node: usize,
    },
    /// Two nodes coincide.
    #[error("local nodes {a} and {b} coincide; merge them and drop the element, or mesh again")]
    CoincidentNodes {
        /// first local node
        a: usize,
        /// second local node
        b: usize,
    },
    /// No area or volume to speak of, or an element that is folded over or numbered in another order.
    #[error(
        "the element is flat, folded over or numbered in another order: its Jacobian determinant relative to \
         its size falls to {least:.1e} (largest {largest:.1e}); mesh again, or number the nodes in \
         Gmsh/VTK order"
    )]
    Jacobian {
        /// least Jacobian determinant over size^dimension, in the orientation of most of the element
        least: f64,
        /// largest one
        largest: f64,
    },
    /// A method that has no formula for this kind of element.
    #[error(
        "`{method}` has no formula for a {kind}; it serves: {served}. `frobenius` serves every kind"
    )]
    NotServed {
        /// the method
        method: ElementMethod,
        /// kind of element
        kind: ElementKind,
        /// kinds it serves, in words
        served: String,
    },
    /// Baudet's formulas hold for rectangles and cubes.
    #[error(
        "`baudet` needs a {shape}, and this {kind} is off by {off_percent:.3} % of its longest diagonal; \
         use `frobenius`, or a mesh of {shape}s"
    )]
    NotRectangular {
        /// "rectangle" or "cube"
        shape: &'static str,
        /// kind of element
        kind: ElementKind,
        /// worst distance between a pair of nodes against that of the ideal shape, percent of the diagonal
        off_percent: f64,
    },
    /// The 2-norm fit stopped before its certificate was as tight as promised.
    #[error(
        "the 2-norm fit stopped {gap:.1e} (relative) above its lower bound; the element is badly shaped: \
         use `frobenius` or `nonnegative`, or mesh again"
    )]
    NotConverged {
        /// relative gap between norm and lower bound
        gap: f64,
    },
    /// The springs of the element are linearly dependent to working precision.
    #[error(
        "the springs of the element are linearly dependent to rounding; it is too badly shaped: mesh again"
    )]
    DependentSprings,
}

/// What is wrong with a mesh, a material list or a name.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// One element or its material cannot be used.
    #[error("{kind} {index}: {source}")]
    Element {
        /// kind of element
        kind: ElementKind,
        /// index among the elements of its kind, from 0
        index: usize,
        /// what is wrong
        source: ElementError,
    },
    /// Something that concerns no single element.
    #[error(transparent)]
    Setting(#[from] ElementError),
    /// A node index beyond the list of points.
    #[error("{kind} {index} names node {node}, but there are {points} points; repair the mesh")]
    NodeOutOfRange {
        /// kind of element
        kind: ElementKind,
        /// index among the elements of its kind, from 0
        index: usize,
        /// the node
        node: u32,
        /// number of points
        points: usize,
    },
    /// Neither one material nor one for every element.
    #[error("{given} materials for {elements} elements; give one for all, or one for each")]
    MaterialCount {
        /// materials given
        given: usize,
        /// elements of all kinds
        elements: usize,
    },
    /// A mesh without elements.
    #[error(
        "the mesh has no triangle, quadrilateral, tetrahedron or hexahedron to put springs into"
    )]
    NoElements,
    /// A name that no method has.
    #[error("there is no method `{name}`; methods are: {known}")]
    UnknownMethod {
        /// the name given
        name: String,
        /// known names
        known: String,
    },
    /// Sets of positions that cannot be compared.
    #[error("positions to compare: {0}")]
    Positions(&'static str),
}
