//! Element components. Local numbering of a tetrahedron, positive volume, right-handed:
//!
//! ```text
//!            3
//!           /|\            edges: 0 = 01   1 = 02   2 = 03   3 = 12   4 = 13   5 = 23
//!          / | \           opposite pairs: (0, 5) (1, 4) (2, 3)
//!         /  |  \          (X1 - X0) x (X2 - X0) . (X3 - X0) > 0
//!        0---|---2
//!         \  |  /
//!          \ | /
//!            1
//! ```
//!
//! Edge `i` of a triangle lies opposite its vertex `i`: 0 = (1, 2), 1 = (2, 0), 2 = (0, 1).

#![allow(
    clippy::multiple_bound_locations,
    reason = "the derive macros of bytemuck repeat the bound on S"
)]

use crate::lanes::Lanes;
use crate::scalar::{Real, Scalar, add, cross, dot, sub};
use crate::vertex::Displacement;
use bevy_ecs::prelude::Component;
use bytemuck::TransparentWrapper;

/// Local vertices of the six edges of a tetrahedron.
pub const TETRAHEDRON_EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Local vertices of the four faces of a tetrahedron; face `i` lies opposite vertex `i`, outward.
pub const TETRAHEDRON_FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Local vertices of the edges of a triangle; edge `i` lies opposite vertex `i`.
pub const TRIANGLE_EDGES: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];

/// Columns of vertex rows, edge rows or tangent blocks.
macro_rules! row_columns {
    ($($(#[$doc:meta])* $name:ident($rows:ty),)+) => {$(
        $(#[$doc])*
        #[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
        #[component(summary_tick, clone_behavior = Ignore)]
        #[repr(transparent)]
        pub struct $name(pub $rows);
    )+};
}
/// Columns that say which element of the user's mesh a row is.
macro_rules! index_columns {
    ($($(#[$doc:meta])* $name:ident,)+) => {$(
        $(#[$doc])*
        #[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
        #[component(clone_behavior = Ignore)]
        #[repr(transparent)]
        pub struct $name(pub u32);
    )+};
}
/// Columns of one number each, so that kernels load the same number of neighbouring elements at once.
#[macro_export]
#[doc(hidden)]
macro_rules! number_columns {
    ($($(#[$doc:meta])* $name:ident $(<$($index:ident),+>)?,)+) => {$(
        $(#[$doc])*
        #[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
        #[component(summary_tick, clone_behavior = Ignore)]
        #[repr(transparent)]
        pub struct $name<S: Scalar $($(, const $index: usize)+)?>(pub S);
    )+};
}
/// The three columns of a vector as query data, slices and components, how the components are made, and the
/// slices as plain numbers.
#[macro_export]
#[doc(hidden)]
macro_rules! vector_columns {
    ($column:ident $(<$of:ident>)?: $data:ident, $slices:ident, $bundle:ident, $make:ident, $peel:ident) => {
        #[doc = concat!("The three columns of [`", stringify!($column), "`]: query data.")]
        pub type $data<S $(, const $of: usize)?> = (
            &'static $column<S $(, $of)?, 0>,
            &'static $column<S $(, $of)?, 1>,
            &'static $column<S $(, $of)?, 2>,
        );
        #[doc = concat!("Slices of [`", stringify!($data), "`], as a contiguous query gives them.")]
        pub type $slices<'a, S $(, const $of: usize)?> = (
            &'a [$column<S $(, $of)?, 0>],
            &'a [$column<S $(, $of)?, 1>],
            &'a [$column<S $(, $of)?, 2>],
        );
        #[doc = concat!("The components of [`", stringify!($data), "`].")]
        pub type $bundle<S $(, const $of: usize)?> =
            ($column<S $(, $of)?, 0>, $column<S $(, $of)?, 1>, $column<S $(, $of)?, 2>);
        #[doc = concat!("The components of [`", stringify!($data), "`] from a vector.")]
        pub fn $make<S: Scalar $(, const $of: usize)?>(vector: [f64; 3]) -> $bundle<S $(, $of)?> {
            let [x, y, z] = vector.map(S::from_f64);
            ($column(x), $column(y), $column(z))
        }
        #[doc = concat!("The numbers of [`", stringify!($slices), "`].")]
        pub fn $peel<S: Scalar $(, const $of: usize)?>(
            (x, y, z): $slices<'_, S $(, $of)?>,
        ) -> [&[S]; 3] {
            [$column::peel_slice(x), $column::peel_slice(y), $column::peel_slice(z)]
        }
    };
}

pub(crate) use {index_columns, row_columns};

/// Vectors of the elements from `first` on, from their entries as columns.
#[inline(always)]
pub fn load_vectors<L: Lanes, const N: usize, const M: usize>(
    columns: &[&[L::Scalar]; M],
    first: usize,
) -> [[L; 3]; N] {
    let mut vectors = [[L::ZERO; 3]; N];
    for a in 0..N {
        for x in 0..3 {
            vectors[a][x] = L::load(&columns[3 * a + x][first..]);
        }
    }
    vectors
}

/// Displacements (m) of the vertices of the elements from `first` on.
#[inline(always)]
pub fn load_displacements<L: Lanes, const N: usize>(
    displacement: &[[L::Scalar; 4]],
    nodes: &[[u32; N]],
    first: usize,
) -> [[L; 3]; N] {
    let nodes = &nodes[first..];
    let mut u = [[L::ZERO; 3]; N];
    for a in 0..N {
        u[a] = L::load_rows(displacement, nodes, a);
    }
    u
}

row_columns! {
    /// Vertex rows of an edge, lower first.
    EdgeVertices([u32; 2]),
    /// Off-diagonal block of the tangent that an edge owns (index into the edge graph).
    EdgeBlock(u32),
    /// Edge-table rows of a triangle, edge `i` opposite vertex `i`.
    TriangleEdges([u32; 3]),
    /// Vertex rows of a tetrahedron, positively oriented.
    TetrahedronVertices([u32; 4]),
    /// Tangent blocks (edge-graph indices) of the six edges of a tetrahedron.
    TetrahedronBlocks([u32; 6]),
    /// Edge-table rows of the six edges of a tetrahedron (pooled evaluation only).
    TetrahedronEdges([u32; 6]),
    /// Vertex rows of a membrane triangle, ascending.
    MembraneVertices([u32; 3]),
    /// Tangent blocks (edge-graph indices) of a membrane triangle, block `i` opposite vertex `i`.
    MembraneBlocks([u32; 3]),
    /// Vertex rows of the tetrahedron that axes lie in (not a tetrahedron by itself), in its local order.
    AxisVertices([u32; 4]),
    /// Tangent blocks (edge-graph indices) of the tetrahedron that axes lie in.
    AxisBlocks([u32; 6]),
}

index_columns! {
    /// Index of the tetrahedron in the mesh that the user gave.
    TetrahedronIndex,
    /// Index of the membrane triangle in the list that the user gave.
    MembraneIndex,
    /// Index, in the mesh that the user gave, of the tetrahedron that axes lie in.
    AxisTetrahedron,
    /// Index, in the list that the user gave, of the membrane triangle that a fibre lies in.
    AxisTriangle,
}

number_columns! {
    /// Component `AXIS` (0, 1, 2) of the rest vector X_a - X_b of an edge (m), a the lower row.
    RestEdge<AXIS>,
    /// Component `AXIS` (0, 1, 2) of the shape vector `D_VERTEX` (1/m) of a tetrahedron, `VERTEX` 1, 2 or
    /// 3: the gradient of that vertex's barycentric coordinate. D_0 = -(D_1 + D_2 + D_3).
    ShapeGradient<VERTEX, AXIS>,
    /// Component `AXIS` (0, 1, 2) of the rest edge `X_VERTEX - X_0` (m) of a membrane triangle, `VERTEX` 1 or
    /// 2.
    MembraneEdge<VERTEX, AXIS>,
    /// Rest area (m^2).
    RestArea,
    /// Rest volume (m^3).
    RestVolume,
}

vector_columns!(RestEdge: RestEdges, RestEdgeColumns, RestEdgeBundle, rest_edge_bundle, rest_edge_numbers);
vector_columns!(
    ShapeGradient<VERTEX>:
    ShapeVector, ShapeVectorColumns, ShapeVectorBundle, shape_vector_bundle, shape_vector_numbers
);
vector_columns!(
    MembraneEdge<VERTEX>:
    MembraneVector, MembraneVectorColumns, MembraneVectorBundle, membrane_vector_bundle,
    membrane_vector_numbers
);

/// Deformation of many edges: vertex displacements and the columns that turn them into edge vectors.
#[derive(Clone, Copy, Debug)]
pub struct EdgeShapes<'a, S> {
    /// Displacement of every vertex row (m).
    pub displacement: &'a [[S; 4]],
    /// Vertex rows of the edges, lower first.
    pub nodes: &'a [[u32; 2]],
    /// Components of the rest vectors (m).
    pub rest: [&'a [S]; 3],
}

impl<'a, S: Scalar> EdgeShapes<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        nodes: &'a [EdgeVertices],
        rest: RestEdgeColumns<'a, S>,
    ) -> Self {
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: EdgeVertices::peel_slice(nodes),
            rest: rest_edge_numbers(rest),
        }
    }

    /// Rest vectors of the edges from `first` on.
    #[inline(always)]
    pub fn rest<L: Lanes<Scalar = S>>(&self, first: usize) -> [L; 3] {
        let [rest] = load_vectors(&self.rest, first);
        rest
    }

    /// Displacements `u_a - u_b` of the lower row against the higher one.
    #[inline(always)]
    pub fn relative<L: Lanes<Scalar = S>>(&self, first: usize) -> [L; 3] {
        let nodes = &self.nodes[first..];
        sub(L::load_rows(self.displacement, nodes, 0), L::load_rows(self.displacement, nodes, 1))
    }
}

/// Change of squared length (m^2), `|x_a - x_b|^2 - L^2`.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct EdgeChange<S: Scalar>(pub S);

/// Edge tension (N/m): derivative of the energy with respect to the change of squared length.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct EdgeTension<S: Scalar>(pub S);

/// All nine columns of [`ShapeGradient`]: query data.
pub type ShapeGradients<S> = (ShapeVector<S, 1>, ShapeVector<S, 2>, ShapeVector<S, 3>);

/// The components of [`ShapeGradients`].
pub type ShapeGradientBundle<S> =
    (ShapeVectorBundle<S, 1>, ShapeVectorBundle<S, 2>, ShapeVectorBundle<S, 3>);

/// The components of [`ShapeGradients`] from the shape vectors D_1, D_2, D_3 (1/m).
pub fn shape_gradient_bundle<S: Scalar>([a, b, c]: [[f64; 3]; 3]) -> ShapeGradientBundle<S> {
    (shape_vector_bundle(a), shape_vector_bundle(b), shape_vector_bundle(c))
}

/// Slices of the columns of [`ShapeGradients`], as a contiguous query gives them.
pub type ShapeGradientColumns<'a, S> =
    (ShapeVectorColumns<'a, S, 1>, ShapeVectorColumns<'a, S, 2>, ShapeVectorColumns<'a, S, 3>);

/// The numbers of [`ShapeGradientColumns`].
pub fn shape_gradient_numbers<S: Scalar>((d1, d2, d3): ShapeGradientColumns<'_, S>) -> [&[S]; 9] {
    let [a, b, c] = shape_vector_numbers(d1);
    let [d, e, f] = shape_vector_numbers(d2);
    let [g, h, i] = shape_vector_numbers(d3);
    [a, b, c, d, e, f, g, h, i]
}

/// Deformation of many tetrahedra: vertex displacements and the columns that turn them into
/// displacement gradients.
#[derive(Clone, Copy, Debug)]
pub struct TetrahedronShapes<'a, S> {
    /// Displacement of every vertex row (m).
    pub displacement: &'a [[S; 4]],
    /// Vertex rows of the tetrahedra.
    pub nodes: &'a [[u32; 4]],
    /// Entries of D_1, D_2, D_3 (1/m), row-major.
    pub gradients: [&'a [S]; 9],
}

impl<'a, S: Scalar> TetrahedronShapes<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        nodes: &'a [TetrahedronVertices],
        gradients: ShapeGradientColumns<'a, S>,
    ) -> Self {
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: TetrahedronVertices::peel_slice(nodes),
            gradients: shape_gradient_numbers(gradients),
        }
    }

    /// Shape vectors of the tetrahedra from `first` on.
    #[inline(always)]
    pub fn gradients<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 3] {
        load_vectors(&self.gradients, first)
    }

    /// Displacements of the vertices of the tetrahedra from `first` on.
    #[inline(always)]
    pub fn displacements<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 4] {
        load_displacements(self.displacement, self.nodes, first)
    }
}

/// Rest shape of membrane triangles, six columns of [`MembraneEdge`] and [`RestArea`]: query data.
pub type MembraneRest<S> = (MembraneVector<S, 1>, MembraneVector<S, 2>, &'static RestArea<S>);

/// The components of [`MembraneRest`].
pub type MembraneRestBundle<S> =
    (MembraneVectorBundle<S, 1>, MembraneVectorBundle<S, 2>, RestArea<S>);

/// The components of [`MembraneRest`] from the rest edges (m) and the rest area (m^2).
pub fn membrane_rest_bundle<S: Scalar>([a, b]: [[f64; 3]; 2], area: f64) -> MembraneRestBundle<S> {
    (membrane_vector_bundle(a), membrane_vector_bundle(b), RestArea(S::from_f64(area)))
}

/// Slices of the columns of [`MembraneRest`], as a contiguous query gives them.
pub type MembraneRestColumns<'a, S> =
    (MembraneVectorColumns<'a, S, 1>, MembraneVectorColumns<'a, S, 2>, &'a [RestArea<S>]);

/// Deformation of many triangles: vertex displacements and the columns of their rest shapes.
#[derive(Clone, Copy, Debug)]
pub struct MembraneShapes<'a, S> {
    /// Displacement of every vertex row (m).
    pub displacement: &'a [[S; 4]],
    /// Vertex rows of the triangles.
    pub nodes: &'a [[u32; 3]],
    /// Components of the rest edges `X_1 - X_0` and `X_2 - X_0` (m).
    pub edges: [&'a [S]; 6],
    /// Rest areas (m^2).
    pub area: &'a [S],
}

impl<'a, S: Scalar> MembraneShapes<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        nodes: &'a [MembraneVertices],
        (first, second, area): MembraneRestColumns<'a, S>,
    ) -> Self {
        let [a, b, c] = membrane_vector_numbers(first);
        let [d, e, f] = membrane_vector_numbers(second);
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: MembraneVertices::peel_slice(nodes),
            edges: [a, b, c, d, e, f],
            area: RestArea::peel_slice(area),
        }
    }

    /// Rest edges of the triangles from `first` on.
    #[inline(always)]
    pub fn edges<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 2] {
        load_vectors(&self.edges, first)
    }

    /// Displacements of the vertices of the triangles from `first` on.
    #[inline(always)]
    pub fn displacements<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 3] {
        load_displacements(self.displacement, self.nodes, first)
    }
}

/// Deformed over rest area of a triangle with the rest edges `edges` (m) and rest area `area` (m^2).
#[inline(always)]
pub fn area_ratio<S: Real>(edges: &[[S; 3]; 2], area: S, u: &[[S; 3]; 3]) -> S {
    let a = add(edges[0], sub(u[1], u[0]));
    let b = add(edges[1], sub(u[2], u[0]));
    let normal = cross(a, b);
    dot(normal, normal).sqrt() / (area + area)
}

/// `G = sum_a u_a (x) D_a`, row-major.
#[inline(always)]
pub fn displacement_gradient<S: Real>(gradients: &[[S; 3]; 3], u: &[[S; 3]; 4]) -> [S; 9] {
    // D_0 = -(D_1 + D_2 + D_3) turns the sum into one over displacements relative to vertex 0.
    let (w1, w2, w3) = (sub(u[1], u[0]), sub(u[2], u[0]), sub(u[3], u[0]));
    let [d1, d2, d3] = gradients;
    let mut g = [S::ZERO; 9];
    for i in 0..3 {
        for j in 0..3 {
            g[3 * i + j] = w3[i].mul_add(d3[j], w2[i].mul_add(d2[j], w1[i] * d1[j]));
        }
    }
    g
}

/// `J - 1` from the invariants of `G`.
#[inline(always)]
pub fn volume_change<S: Real>(g: &[S; 9]) -> S {
    let m0 = minor(g[4], g[8], g[5], g[7]);
    let m1 = minor(g[0], g[8], g[2], g[6]);
    let m2 = minor(g[0], g[4], g[1], g[3]);
    let det =
        dot([g[0], g[1], g[2]], [m0, minor(g[5], g[6], g[3], g[8]), minor(g[3], g[7], g[4], g[6])]);
    (g[0] + g[4] + g[8]) + (m0 + m1 + m2) + det
}

/// `a b - c d`.
#[inline(always)]
pub fn minor<S: Real>(a: S, b: S, c: S, d: S) -> S {
    (-c).mul_add(d, a * b)
}
