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

/// Vertex rows of an edge, lower first.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct EdgeVertices(pub [u32; 2]);

/// Off-diagonal block of the tangent that an edge owns (index into the edge graph).
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct EdgeBlock(pub u32);

/// Component `AXIS` (0, 1, 2) of the rest vector X_a - X_b of an edge (m), a the lower row.
///
/// One column per number, so that kernels load the same entry of neighbouring edges at once.
#[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct RestEdge<S: Scalar, const AXIS: usize>(pub S);

/// All three columns of [`RestEdge`]: query data.
pub type RestEdges<S> = (&'static RestEdge<S, 0>, &'static RestEdge<S, 1>, &'static RestEdge<S, 2>);

/// The components of [`RestEdges`].
pub type RestEdgeBundle<S> = (RestEdge<S, 0>, RestEdge<S, 1>, RestEdge<S, 2>);

/// The components of [`RestEdges`] from the rest vector (m).
pub fn rest_edge_bundle<S: Scalar>(rest: [f64; 3]) -> RestEdgeBundle<S> {
    let [x, y, z] = rest.map(S::from_f64);
    (RestEdge(x), RestEdge(y), RestEdge(z))
}

/// Slices of the columns of [`RestEdges`], as a contiguous query gives them.
pub type RestEdgeColumns<'a, S> =
    (&'a [RestEdge<S, 0>], &'a [RestEdge<S, 1>], &'a [RestEdge<S, 2>]);

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
        (x, y, z): RestEdgeColumns<'a, S>,
    ) -> Self {
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: EdgeVertices::peel_slice(nodes),
            rest: [RestEdge::peel_slice(x), RestEdge::peel_slice(y), RestEdge::peel_slice(z)],
        }
    }

    /// Rest vectors of the edges from `first` on.
    #[inline(always)]
    pub fn rest<L: Lanes<Scalar = S>>(&self, first: usize) -> [L; 3] {
        let [x, y, z] = self.rest;
        [L::load(&x[first..]), L::load(&y[first..]), L::load(&z[first..])]
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
#[repr(transparent)]
pub struct EdgeChange<S: Scalar>(pub S);

/// Edge tension (N/m): derivative of the energy with respect to the change of squared length.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper)]
#[repr(transparent)]
pub struct EdgeTension<S: Scalar>(pub S);

/// Edge-table rows of a triangle, edge `i` opposite vertex `i`.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct TriangleEdges(pub [u32; 3]);

/// Vertex rows of a tetrahedron, positively oriented.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct TetrahedronVertices(pub [u32; 4]);

/// Tangent blocks (edge-graph indices) of the six edges of a tetrahedron.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct TetrahedronBlocks(pub [u32; 6]);

/// Edge-table rows of the six edges of a tetrahedron (pooled evaluation only).
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct TetrahedronEdges(pub [u32; 6]);

/// Index of the tetrahedron in the mesh that the user gave.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct TetrahedronIndex(pub u32);

/// Component `AXIS` (0, 1, 2) of the shape vector `D_VERTEX` (1/m) of a tetrahedron, `VERTEX` 1, 2 or
/// 3: the gradient of that vertex's barycentric coordinate. D_0 = -(D_1 + D_2 + D_3).
///
/// One column per number, so that kernels load the same entry of neighbouring tetrahedra at once.
#[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct ShapeGradient<S: Scalar, const VERTEX: usize, const AXIS: usize>(pub S);

/// All nine columns of [`ShapeGradient`]: query data.
pub type ShapeGradients<S> = (
    (
        &'static ShapeGradient<S, 1, 0>,
        &'static ShapeGradient<S, 1, 1>,
        &'static ShapeGradient<S, 1, 2>,
    ),
    (
        &'static ShapeGradient<S, 2, 0>,
        &'static ShapeGradient<S, 2, 1>,
        &'static ShapeGradient<S, 2, 2>,
    ),
    (
        &'static ShapeGradient<S, 3, 0>,
        &'static ShapeGradient<S, 3, 1>,
        &'static ShapeGradient<S, 3, 2>,
    ),
);

/// The components of [`ShapeGradients`].
pub type ShapeGradientBundle<S> = (
    (ShapeGradient<S, 1, 0>, ShapeGradient<S, 1, 1>, ShapeGradient<S, 1, 2>),
    (ShapeGradient<S, 2, 0>, ShapeGradient<S, 2, 1>, ShapeGradient<S, 2, 2>),
    (ShapeGradient<S, 3, 0>, ShapeGradient<S, 3, 1>, ShapeGradient<S, 3, 2>),
);

/// The components of [`ShapeGradients`] from the shape vectors D_1, D_2, D_3 (1/m).
pub fn shape_gradient_bundle<S: Scalar>(d: [[f64; 3]; 3]) -> ShapeGradientBundle<S> {
    let [[a, b, c], [d, e, f], [g, h, i]] = d.map(|row| row.map(S::from_f64));
    (
        (ShapeGradient(a), ShapeGradient(b), ShapeGradient(c)),
        (ShapeGradient(d), ShapeGradient(e), ShapeGradient(f)),
        (ShapeGradient(g), ShapeGradient(h), ShapeGradient(i)),
    )
}

/// Slices of the columns of [`ShapeGradients`], as a contiguous query gives them.
pub type ShapeGradientColumns<'a, S> = (
    (&'a [ShapeGradient<S, 1, 0>], &'a [ShapeGradient<S, 1, 1>], &'a [ShapeGradient<S, 1, 2>]),
    (&'a [ShapeGradient<S, 2, 0>], &'a [ShapeGradient<S, 2, 1>], &'a [ShapeGradient<S, 2, 2>]),
    (&'a [ShapeGradient<S, 3, 0>], &'a [ShapeGradient<S, 3, 1>], &'a [ShapeGradient<S, 3, 2>]),
);

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
        (d1, d2, d3): ShapeGradientColumns<'a, S>,
    ) -> Self {
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: TetrahedronVertices::peel_slice(nodes),
            gradients: [
                ShapeGradient::peel_slice(d1.0),
                ShapeGradient::peel_slice(d1.1),
                ShapeGradient::peel_slice(d1.2),
                ShapeGradient::peel_slice(d2.0),
                ShapeGradient::peel_slice(d2.1),
                ShapeGradient::peel_slice(d2.2),
                ShapeGradient::peel_slice(d3.0),
                ShapeGradient::peel_slice(d3.1),
                ShapeGradient::peel_slice(d3.2),
            ],
        }
    }

    /// Shape vectors of the tetrahedra from `first` on.
    #[inline(always)]
    pub fn gradients<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 3] {
        let mut d = [[L::ZERO; 3]; 3];
        for a in 0..3 {
            for x in 0..3 {
                d[a][x] = L::load(&self.gradients[3 * a + x][first..]);
            }
        }
        d
    }

    /// Displacements of the vertices of the tetrahedra from `first` on.
    #[inline(always)]
    pub fn displacements<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 4] {
        let nodes = &self.nodes[first..];
        let mut u = [[L::ZERO; 3]; 4];
        for a in 0..4 {
            u[a] = L::load_rows(self.displacement, nodes, a);
        }
        u
    }
}

/// Vertex rows of a membrane triangle, ascending.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct MembraneVertices(pub [u32; 3]);

/// Tangent blocks (edge-graph indices) of a membrane triangle, block `i` opposite vertex `i`.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct MembraneBlocks(pub [u32; 3]);

/// Index of the membrane triangle in the list that the user gave.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct MembraneIndex(pub u32);

/// Component `AXIS` (0, 1, 2) of the rest edge `X_VERTEX - X_0` (m) of a membrane triangle, `VERTEX` 1 or
/// 2.
#[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct MembraneEdge<S: Scalar, const VERTEX: usize, const AXIS: usize>(pub S);

/// Rest area (m^2).
#[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct RestArea<S: Scalar>(pub S);

/// Rest shape of membrane triangles, six columns of [`MembraneEdge`] and [`RestArea`]: query data.
pub type MembraneRest<S> = (
    (
        &'static MembraneEdge<S, 1, 0>,
        &'static MembraneEdge<S, 1, 1>,
        &'static MembraneEdge<S, 1, 2>,
    ),
    (
        &'static MembraneEdge<S, 2, 0>,
        &'static MembraneEdge<S, 2, 1>,
        &'static MembraneEdge<S, 2, 2>,
    ),
    &'static RestArea<S>,
);

/// The components of [`MembraneRest`].
pub type MembraneRestBundle<S> = (
    (MembraneEdge<S, 1, 0>, MembraneEdge<S, 1, 1>, MembraneEdge<S, 1, 2>),
    (MembraneEdge<S, 2, 0>, MembraneEdge<S, 2, 1>, MembraneEdge<S, 2, 2>),
    RestArea<S>,
);

/// The components of [`MembraneRest`] from the rest edges (m) and the rest area (m^2).
pub fn membrane_rest_bundle<S: Scalar>(edges: [[f64; 3]; 2], area: f64) -> MembraneRestBundle<S> {
    let [[a, b, c], [d, e, f]] = edges.map(|edge| edge.map(S::from_f64));
    (
        (MembraneEdge(a), MembraneEdge(b), MembraneEdge(c)),
        (MembraneEdge(d), MembraneEdge(e), MembraneEdge(f)),
        RestArea(S::from_f64(area)),
    )
}

/// Slices of the columns of [`MembraneRest`], as a contiguous query gives them.
pub type MembraneRestColumns<'a, S> = (
    (&'a [MembraneEdge<S, 1, 0>], &'a [MembraneEdge<S, 1, 1>], &'a [MembraneEdge<S, 1, 2>]),
    (&'a [MembraneEdge<S, 2, 0>], &'a [MembraneEdge<S, 2, 1>], &'a [MembraneEdge<S, 2, 2>]),
    &'a [RestArea<S>],
);

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
        (a, b, area): MembraneRestColumns<'a, S>,
    ) -> Self {
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: MembraneVertices::peel_slice(nodes),
            edges: [
                MembraneEdge::peel_slice(a.0),
                MembraneEdge::peel_slice(a.1),
                MembraneEdge::peel_slice(a.2),
                MembraneEdge::peel_slice(b.0),
                MembraneEdge::peel_slice(b.1),
                MembraneEdge::peel_slice(b.2),
            ],
            area: RestArea::peel_slice(area),
        }
    }

    /// Rest edges of the triangles from `first` on.
    #[inline(always)]
    pub fn edges<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 2] {
        let mut edges = [[L::ZERO; 3]; 2];
        for a in 0..2 {
            for x in 0..3 {
                edges[a][x] = L::load(&self.edges[3 * a + x][first..]);
            }
        }
        edges
    }

    /// Displacements of the vertices of the triangles from `first` on.
    #[inline(always)]
    pub fn displacements<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 3] {
        let nodes = &self.nodes[first..];
        let mut u = [[L::ZERO; 3]; 3];
        for a in 0..3 {
            u[a] = L::load_rows(self.displacement, nodes, a);
        }
        u
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

/// Rest volume (m^3).
#[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct RestVolume<S: Scalar>(pub S);

/// Vertex rows of the tetrahedron that axes lie in (not a tetrahedron by itself), in its local order.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct AxisVertices(pub [u32; 4]);

/// Tangent blocks (edge-graph indices) of the tetrahedron that axes lie in.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct AxisBlocks(pub [u32; 6]);

/// Index, in the mesh that the user gave, of the tetrahedron that axes lie in.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct AxisTetrahedron(pub u32);

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
