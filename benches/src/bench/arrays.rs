//! The force kernel over plain vectors: the same ranges and sums as the force schedule, no entities.

use sinew::engine::columns::single_table;
use sinew::engine::element::{RestVolume, ShapeGradients, TetrahedronVertices};
use sinew::engine::law::LawBuffer;
use sinew::engine::scalar::{Scalar, xyz};
use sinew::engine::topology::Topology;
use sinew::engine::vertex::Displacement;
use sinew::engine::workers::Workers;
use sinew::models::fused::{FusedStVK, Moduli};
use sinew::models::tetrahedron::{self, Element};
use sinew::prelude::Simulation;

/// The columns of a body copied into plain vectors.
pub struct PlainArrays<S: Scalar> {
    displacement: Vec<[S; 4]>,
    nodes: Vec<[u32; 4]>,
    gradients: Vec<[[S; 3]; 3]>,
    volume: Vec<S>,
    moduli: Vec<Moduli<S>>,
    buffer: LawBuffer<FusedStVK, S>,
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
        let mut elements =
            world.query::<(&TetrahedronVertices, &ShapeGradients<S>, &RestVolume<S>, &Moduli<S>)>();
        let (nodes, gradients, volume, moduli) = single_table(elements.contiguous_iter(world))?;
        let nodes: Vec<[u32; 4]> = nodes.iter().map(|n| n.0).collect();
        // the fixed ranges of the engine
        let mut buffer = LawBuffer::default();
        buffer.partition(nodes.len(), world.resource::<Topology>(), |i| &nodes[i]);
        Some(Self {
            total: vec![[S::ZERO; 4]; displacement.len()],
            displacement,
            nodes,
            gradients: gradients.iter().map(|g| g.0).collect(),
            volume: volume.iter().map(|v| v.0).collect(),
            moduli: moduli.to_vec(),
            buffer,
            workers: Workers::serial(),
        })
    }

    /// Forces of all tetrahedra, the same work as the force schedule without entities.
    pub fn forces(&mut self) -> &[[S; 4]] {
        for span in &mut self.buffer.spans {
            span.clear_force();
            for i in span.elements.clone() {
                let m = self.moduli[i];
                let e = Element {
                    gradients: self.gradients[i],
                    volume: self.volume[i],
                    lambda: m.lambda,
                    mu: m.mu,
                    compression: m.compression,
                };
                let n = self.nodes[i];
                let f = tetrahedron::forces(&e, &n.map(|v| xyz(self.displacement[v as usize])));
                for (a, &row) in n.iter().enumerate() {
                    span.add_force(row, f[a]);
                }
            }
        }
        self.total.fill([S::ZERO; 4]);
        self.buffer.add_forces_to(&self.workers, &mut self.total);
        &self.total
    }
}
