//! The solid elements of a body on their way into the world, whatever their law.

use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::element::{
    RestVolume, ShapeGradientBundle, TetrahedronBlocks, TetrahedronIndex, TetrahedronVertices,
    shape_gradient_bundle,
};
use sinew_engine::isoparametric::{
    HexahedronBlocks, HexahedronIndex, HexahedronRest, HexahedronVertices, RestHexahedron,
    RestTetrahedron10, Tetrahedron10Blocks, Tetrahedron10Rest, Tetrahedron10Vertices,
};
use sinew_engine::layout::BodyLayout;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;

use super::moduli::{ClusterIndex, Moduli, Pressures, moduli_bundle};
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

/// A body on its way into the world, with what its solid elements are made of.
pub struct SolidPart<'a> {
    pub(crate) layout: &'a BodyLayout,
    /// Rest position (m) of a vertex row.
    pub(crate) rest_of: &'a dyn Fn(u32) -> DVec3,
    pub(crate) rest: &'a RestShapes,
    /// Lamé parameters of tetrahedra and of hexahedra.
    pub(crate) lame: [Vec<LameParameters>; 2],
    /// Whether their law has the compression term.
    pub(crate) compression: bool,
    /// Cluster of every tetrahedron, where the body has them.
    pub(crate) clusters: Vec<u32>,
    pub(crate) at: Offsets,
}

/// Components of a tetrahedron, without the mark of its law.
type TetrahedronBundle<S> = (
    TetrahedronVertices,
    TetrahedronBlocks,
    TetrahedronIndex,
    BodyId,
    ShapeGradientBundle<S>,
    RestVolume<S>,
    Moduli<S>,
);

/// Components of a hexahedron, likewise.
type HexahedronBundle<S> = (
    HexahedronVertices,
    HexahedronBlocks,
    HexahedronIndex,
    BodyId,
    HexahedronRest<S>,
    RestVolume<S>,
    Moduli<S>,
);

/// Components of a ten-node tetrahedron, likewise.
type Tetrahedron10Bundle<S> = (
    Tetrahedron10Vertices,
    Tetrahedron10Blocks,
    TetrahedronIndex,
    BodyId,
    Tetrahedron10Rest<S>,
    RestVolume<S>,
    Moduli<S>,
);

impl SolidPart<'_> {
    pub(crate) fn tetrahedra<S: Scalar>(&self) -> impl Iterator<Item = TetrahedronBundle<S>> {
        let Self { layout, compression, at, .. } = self;
        let elements = layout.tetrahedra.iter().zip(&layout.cells.tetrahedron_edges);
        let numbers = self.rest.tetrahedra.iter().zip(&self.lame[0]);
        let elements = elements.zip(&layout.tetrahedron_order).zip(numbers);
        elements.map(move |(((t, e), &original), (rest, &lame))| {
            let d = [rest.gradients[1], rest.gradients[2], rest.gradients[3]];
            (
                TetrahedronVertices(at.vertices(t)),
                TetrahedronBlocks(at.blocks(e)),
                TetrahedronIndex(original),
                at.body,
                shape_gradient_bundle::<S>(d),
                RestVolume(S::from_f64(rest.volume)),
                moduli_bundle::<S>(lame, *compression),
            )
        })
    }

    fn hexahedra<S: Scalar>(&self) -> impl Iterator<Item = HexahedronBundle<S>> {
        let Self { layout, compression, at, .. } = self;
        let elements = layout.hexahedra.iter().zip(&layout.cells.hexahedron_edges);
        let numbers = self.rest.hexahedra.iter().zip(&self.lame[1]);
        let elements = elements.zip(&layout.hexahedron_order).zip(numbers);
        elements.map(move |(((h, e), &original), (rest, &lame))| {
            (
                HexahedronVertices(at.vertices(h)),
                HexahedronBlocks(at.blocks(e)),
                HexahedronIndex(original),
                at.body,
                rest.component::<S>(),
                RestVolume(S::from_f64(rest.total_volume())),
                moduli_bundle::<S>(lame, *compression),
            )
        })
    }

    fn tetrahedra10<S: Scalar>(&self) -> impl Iterator<Item = Tetrahedron10Bundle<S>> {
        let Self { layout, compression, at, .. } = self;
        let elements = layout.tetrahedra10.iter().zip(&layout.cells.tetrahedron10_edges);
        let numbers = self.rest.tetrahedra10.iter().zip(&self.lame[0]);
        let elements = elements.zip(&layout.tetrahedron_order).zip(numbers);
        elements.map(move |(((t, e), &original), (rest, &lame))| {
            (
                Tetrahedron10Vertices(at.vertices(t)),
                Tetrahedron10Blocks(at.blocks(e)),
                TetrahedronIndex(original),
                at.body,
                rest.component::<S>(),
                RestVolume(S::from_f64(rest.total_volume())),
                moduli_bundle::<S>(lame, *compression),
            )
        })
    }
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

/// Spawns the ten-node tetrahedra of a body, likewise.
pub(crate) fn spawn_tetrahedra10<M, S>(world: &mut World, part: &SolidPart)
where
    M: Bundle<Effect: NoBundleEffect> + Default,
    S: Scalar,
{
    let marked = part.tetrahedra10::<S>().map(|t| (t, M::default()));
    world.spawn_batch(marked.collect::<Vec<_>>());
}
