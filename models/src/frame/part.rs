//! The solid elements of a body on their way into the world, whatever their law.

use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::element::{
    RestVolume, TetrahedronBlocks, TetrahedronIndex, TetrahedronVertices, shape_gradient_bundle,
};
use sinew_engine::isoparametric::{
    CornerPoints, HexahedronBlocks, HexahedronIndex, HexahedronVertices, PointsRest,
    RestHexahedron, RestPoints, RestTetrahedron10, Tetrahedron10Blocks, Tetrahedron10Vertices,
};
use sinew_engine::layout::BodyLayout;
use sinew_engine::mesh::Filled;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;

use super::moduli::{ClusterIndex, Moduli, Pressures, moduli_bundle};
use super::reduced::{HexahedronShape, HourglassStiffness};
use crate::element::hourglass::RestShape;
use crate::element::precompute::RestTetrahedron;
use crate::material::LameParameters;

/// Where the rows of a body begin.
#[derive(Clone, Copy)]
pub(crate) struct Offsets {
    pub vertex: u32,
    pub block: u32,
    pub body: BodyId,
}

impl Offsets {
    /// Rows of vertices of a body in the world.
    pub fn vertices<const N: usize>(&self, local: &[u32; N]) -> [u32; N] {
        local.map(|v| v + self.vertex)
    }

    /// Blocks of edges of a body in the tangent of the world.
    pub fn blocks<const N: usize>(&self, local: &[u32; N]) -> [u32; N] {
        local.map(|b| b + self.block)
    }
}

/// Rest shapes of the solid elements of a body, in the order of its layout.
pub(crate) struct RestShapes {
    pub tetrahedra: Vec<RestTetrahedron>,
    pub tetrahedra10: Vec<RestTetrahedron10>,
    pub hexahedra: Vec<RestHexahedron>,
}

/// The first element that names a vertex which is none of `count`, or one twice.
pub(crate) fn bad_vertices<const N: usize>(
    elements: &[[u32; N]],
    count: usize,
) -> Option<(usize, &[u32])> {
    let mut elements = elements.iter().map(|vertices| &vertices[..]).enumerate();
    elements.find(|(_, vertices)| !are_vertices(vertices, count))
}

/// Whether they are different ones of `count` vertices.
pub(crate) fn are_vertices(vertices: &[u32], count: usize) -> bool {
    let distinct = (0..vertices.len()).all(|i| !vertices[..i].contains(&vertices[i]));
    distinct && vertices.iter().all(|&v| (v as usize) < count)
}

/// Rest shapes of the elements of a kind, in the order of the layout, from their points (m) and indices in the user's mesh.
pub(crate) fn rest_shapes<T, E, const N: usize>(
    nodes: &[[u32; N]],
    order: &[u32],
    rest_of: impl Fn(u32) -> DVec3,
    new: impl Fn([[f64; 3]; N], usize) -> Result<T, E>,
) -> Result<Vec<T>, E> {
    let points = |nodes: &[u32; N]| nodes.map(|row| rest_of(row).to_array());
    nodes.iter().zip(order).map(|(nodes, &index)| new(points(nodes), index as usize)).collect()
}

/// A body on its way into the world, with what its solid elements are made of.
pub struct SolidPart<'a> {
    pub(crate) layout: &'a BodyLayout,
    /// Rest position (m) of a vertex row.
    pub(crate) rest_of: &'a dyn Fn(u32) -> DVec3,
    pub(crate) rest: &'a RestShapes,
    /// Lamé parameters of tetrahedra and of hexahedra.
    pub(crate) lame: [Vec<LameParameters>; 2],
    /// What fills hexahedra.
    pub(crate) filled: Vec<Filled>,
    /// Whether their law has the compression term.
    pub(crate) compression: bool,
    /// Cluster of every tetrahedron, where the body has them.
    pub(crate) clusters: Vec<u32>,
    pub(crate) at: Offsets,
}

impl SolidPart<'_> {
    /// Components of the elements of a kind, from `bundle` and what all kinds have.
    fn elements<S: Scalar, R, B, const V: usize, const P: usize>(
        &self,
        (nodes, edges): (&[[u32; V]], &[[u32; P]]),
        order: &[u32],
        (rest, lame): (&[R], &[LameParameters]),
        bundle: impl Fn([u32; V], [u32; P], u32, &R) -> B,
    ) -> impl Iterator<Item = (B, BodyId, Moduli<S>)> {
        let Self { compression, at, .. } = self;
        let elements = nodes.iter().zip(edges).zip(order).zip(rest.iter().zip(lame));
        elements.map(move |(((nodes, edges), &original), (rest, &lame))| {
            let own = bundle(at.vertices(nodes), at.blocks(edges), original, rest);
            (own, at.body, moduli_bundle::<S>(lame, *compression))
        })
    }

    /// Components of the tetrahedra, without the mark of their law.
    pub(crate) fn tetrahedra<S: Scalar>(
        &self,
    ) -> impl Iterator<Item = impl Bundle<Effect: NoBundleEffect>> {
        let Self { layout, rest, lame, .. } = self;
        self.elements::<S, _, _, 4, 6>(
            (layout.tetrahedra(), layout.cells.edges_of.tetrahedra.each::<6>()),
            &layout.order.tetrahedra,
            (&rest.tetrahedra, &lame[0]),
            |nodes, edges, original, rest| {
                let d = [rest.gradients[1], rest.gradients[2], rest.gradients[3]];
                (
                    (TetrahedronVertices(nodes), TetrahedronBlocks(edges)),
                    TetrahedronIndex(original),
                    shape_gradient_bundle::<S>(d),
                    RestVolume(S::from_f64(rest.volume)),
                )
            },
        )
    }

    fn hexahedra<S: Scalar>(&self) -> impl Iterator<Item = impl Bundle<Effect: NoBundleEffect>> {
        let Self { layout, rest, lame, .. } = self;
        self.elements::<S, _, _, 8, 28>(
            (layout.hexahedra(), layout.cells.edges_of.hexahedra.each::<28>()),
            &layout.order.hexahedra,
            (&rest.hexahedra, &lame[1]),
            |nodes, edges, original, rest| {
                let own = (HexahedronVertices(nodes), HexahedronBlocks(edges));
                (own, HexahedronIndex(original), points_bundle::<S, 8>(rest))
            },
        )
    }

    fn reduced_hexahedra<S: Scalar>(
        &self,
    ) -> impl Iterator<Item = impl Bundle<Effect: NoBundleEffect>> {
        let Self { layout, rest, lame, .. } = self;
        let elements = self.elements::<S, _, _, 8, 28>(
            (layout.hexahedra(), layout.cells.edges_of.hexahedra.each::<28>()),
            &layout.order.hexahedra,
            (&rest.hexahedra, &lame[1]),
            |nodes, edges, original, _| {
                let own = (HexahedronVertices(nodes), HexahedronBlocks(edges));
                (own, HexahedronIndex(original))
            },
        );
        let shapes = layout.hexahedra().iter().zip(&rest.hexahedra).zip(&lame[1]);
        elements.zip(shapes.zip(&self.filled)).map(|(own, (((nodes, rest), &lame), filled))| {
            let points = nodes.map(|row| (self.rest_of)(row).to_array());
            let shape = HexahedronShape::<S>::new(&RestShape::new(rest, &points, filled));
            let stiffness = HourglassStiffness::<S>::new(&points, lame, filled);
            let corners = points_bundle::<S, 8>(&rest.at_corners(&points));
            (own, shape, stiffness, corners, CornerPoints)
        })
    }

    fn tetrahedra10<S: Scalar>(&self) -> impl Iterator<Item = impl Bundle<Effect: NoBundleEffect>> {
        let Self { layout, rest, lame, .. } = self;
        self.elements::<S, _, _, 10, 45>(
            (layout.tetrahedra10(), layout.cells.edges_of.tetrahedra.each::<45>()),
            &layout.order.tetrahedra,
            (&rest.tetrahedra10, &lame[0]),
            |nodes, edges, original, rest| {
                let own = (Tetrahedron10Vertices(nodes), Tetrahedron10Blocks(edges));
                (own, TetrahedronIndex(original), points_bundle::<S, 4>(rest))
            },
        )
    }
}

/// Rest shape and volume of an element with Gauss points.
fn points_bundle<S: Scalar, const Q: usize>(
    rest: &RestPoints<Q>,
) -> (PointsRest<S, Q>, RestVolume<S>) {
    (rest.component::<S>(), RestVolume(S::from_f64(rest.total_volume())))
}

/// Spawns the tetrahedra of a body with the mark `M` of their law.
pub(crate) fn spawn_tetrahedra<M: Component + Default, S: Scalar>(
    world: &mut World,
    part: &SolidPart,
) {
    let marked = part.tetrahedra::<S>().map(|t| (t, M::default()));
    world.spawn_batch(marked.collect::<Vec<_>>());
}

/// Spawns the tetrahedra of a body in clusters with the mark `M` of their law.
pub(crate) fn spawn_clustered<M: Component + Default, S: Scalar>(
    world: &mut World,
    part: &SolidPart,
) {
    let taken = world.query::<&ClusterIndex>().iter(world).map(|own| own.0 + 1).max();
    let first = taken.unwrap_or(0);
    let marked = part
        .tetrahedra::<S>()
        .zip(&part.clusters)
        .map(|(t, &own)| (t, ClusterIndex(first + own), Pressures::<S>::default(), M::default()));
    world.spawn_batch(marked.collect::<Vec<_>>());
}

/// Spawns the hexahedra of a body with `M`, the mark of their law and columns of its own.
pub(crate) fn spawn_hexahedra<M, S>(world: &mut World, part: &SolidPart)
where
    M: Bundle<Effect: NoBundleEffect> + Default,
    S: Scalar,
{
    let marked = part.hexahedra::<S>().map(|h| (h, M::default()));
    world.spawn_batch(marked.collect::<Vec<_>>());
}

/// Spawns the hexahedra of a body for reduced integration, likewise.
pub(crate) fn spawn_reduced<M, S>(world: &mut World, part: &SolidPart)
where
    M: Bundle<Effect: NoBundleEffect> + Default,
    S: Scalar,
{
    let marked = part.reduced_hexahedra::<S>().map(|h| (h, M::default()));
    world.spawn_batch(marked.collect::<Vec<_>>());
}

/// Spawns the ten-node tetrahedra of a body, likewise.
pub(crate) fn spawn_tetrahedra10<M, S>(world: &mut World, part: &SolidPart)
where
    M: Bundle<Effect: NoBundleEffect> + Default,
    S: Scalar,
{
    let marked = part.tetrahedra10::<S>().map(|t| (t, M::default()));
    world.spawn_batch(marked.collect::<Vec<_>>());
}
