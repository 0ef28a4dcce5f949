//! The force kernel over plain vectors: the same kernel, ranges and sums as the force schedule, no
//! entities.

use sinew::engine::columns::single_table;
use sinew::engine::element::{
    RestVolume, ShapeGradients, TetrahedronBlocks, TetrahedronShapes, TetrahedronVertices,
};
use sinew::engine::law::{EvaluationRequest, LawBuffer};
use sinew::engine::scalar::Scalar;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::Displacement;
use sinew::engine::workers::Workers;
use sinew::models::frame::moduli::{CompressionModulus, FirstLameParameter, ShearModulus};
use sinew::models::frame::tetrahedra::{TetrahedronColumns, evaluate_columns};
use sinew::models::laws::svk::FusedStVK;
use sinew::prelude::Simulation;

/// The columns of a body copied into plain vectors.
pub struct PlainArrays<S: Scalar> {
    displacement: Vec<[S; 4]>,
    nodes: Vec<[u32; 4]>,
    blocks: Vec<[u32; 6]>,
    gradients: [Vec<S>; 9],
    volume: Vec<S>,
    moduli: [Vec<S>; 3],
    buffer: LawBuffer<S>,
    total: Vec<[S; 4]>,
    workers: Workers,
}

impl<S: Scalar> PlainArrays<S> {
    /// Copies; `None` for a world without fused bodies.
    pub fn of(simulation: &mut Simulation) -> Option<Self> {
        let world = simulation.world_mut();
        let mut vertices = world.query::<&Displacement<S>>();
        let displacement: Vec<[S; 4]> =
            single_table(vertices.contiguous_iter(world))?.iter().map(|u| u.0).collect();
        let mut elements = world.query::<(
            &TetrahedronVertices,
            &TetrahedronBlocks,
            ShapeGradients<S>,
            &RestVolume<S>,
            &FirstLameParameter<S>,
            &ShearModulus<S>,
            &CompressionModulus<S>,
        )>();
        let (nodes, blocks, gradients, volume, lambda, mu, compression) =
            single_table(elements.contiguous_iter(world))?;
        let shapes = TetrahedronShapes::new(&[], nodes, gradients);
        let nodes: Vec<[u32; 4]> = nodes.iter().map(|n| n.0).collect();
        // the fixed ranges of the engine
        let mut buffer = LawBuffer::default();
        buffer.partition(nodes.len(), world.resource::<Topology>(), |i| &nodes[i]);
        Some(Self {
            total: vec![[S::ZERO; 4]; displacement.len()],
            displacement,
            nodes,
            blocks: blocks.iter().map(|b| b.0).collect(),
            gradients: shapes.gradients.map(<[S]>::to_vec),
            volume: volume.iter().map(|v| v.0).collect(),
            moduli: [
                lambda.iter().map(|m| m.0).collect(),
                mu.iter().map(|m| m.0).collect(),
                compression.iter().map(|m| m.0).collect(),
            ],
            buffer,
            workers: Workers::serial(),
        })
    }

    /// Forces of all tetrahedra, the same work as the force schedule without entities.
    pub fn forces(&mut self) -> &[[S; 4]] {
        let columns = TetrahedronColumns {
            shapes: TetrahedronShapes {
                displacement: &self.displacement,
                nodes: &self.nodes,
                gradients: std::array::from_fn(|i| &self.gradients[i][..]),
            },
            blocks: &self.blocks,
            volume: &self.volume,
            lambda: &self.moduli[0],
            mu: &self.moduli[1],
            compression: &self.moduli[2],
            pressure: &[],
            predicted: &[],
        };
        let request = EvaluationRequest { force: true, ..Default::default() };
        evaluate_columns::<FusedStVK, S>(&columns, &request, &self.workers, &mut self.buffer);
        self.total.fill([S::ZERO; 4]);
        self.buffer.add_forces_to(&self.workers, &mut self.total);
        &self.total
    }
}
