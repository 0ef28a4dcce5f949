//! Clusters of tetrahedra after a removal: none falls into pieces, and none is of very few elements.

use bevy_ecs::prelude::*;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::scalar::Scalar;
use std::collections::BTreeSet;

use super::state::{Queries, State};
use crate::body::clusters::{FEW, neighbours, pieces};
use crate::body::description::SoftBody;
use crate::body::matter::Chosen;
use crate::body::present::BodyResection;
use crate::frame::means::Sums;
use crate::frame::moduli::ClusterIndex;

/// Tetrahedra.
const KIND: ElementKind = ElementKind::Tetrahedron;

/// Clusters that lose elements, and their energy (J) before that.
#[derive(Debug, Default)]
pub(super) struct Losing {
    clusters: BTreeSet<u32>,
    energy: f64,
}

impl BodyResection {
    fn cluster(&self, world: &World, element: u32) -> Option<u32> {
        let entity = self.rows.elements[KIND][element as usize];
        world.get::<ClusterIndex>(entity).map(|index| index.0)
    }

    /// Elements of some clusters, ascending.
    fn members(&self, world: &World, clusters: &BTreeSet<u32>) -> Vec<(u32, u32)> {
        let all = self.connectivity.all_left(KIND);
        let own = all.filter_map(|e| Some((self.cluster(world, e)?, e)));
        own.filter(|(cluster, _)| clusters.contains(cluster)).collect()
    }

    /// Clusters of the chosen tetrahedra, which still have their rows.
    pub(super) fn losing<S: Scalar>(
        &self,
        state: &State<S>,
        world: &World,
        chosen: &Chosen,
    ) -> Losing {
        let clusters = chosen[KIND].iter().filter_map(|&e| self.cluster(world, e)).collect();
        let energy = self.cluster_energy(state, world, &clusters);
        Losing { clusters, energy }
    }

    /// Energy (J) of some clusters by the means of their elements that are left.
    fn cluster_energy<S: Scalar>(
        &self,
        state: &State<S>,
        world: &World,
        clusters: &BTreeSet<u32>,
    ) -> f64 {
        let mut members = self.members(world, clusters);
        members.sort_unstable();
        let of_cluster = |own: &[(u32, u32)]| {
            let mut sums = Sums::default();
            own.iter().for_each(|&(_, e)| state.add_to(&mut sums, e));
            sums.energy()
        };
        members.chunk_by(|a, b| a.0 == b.0).map(of_cluster).sum()
    }

    /// Makes what is left of clusters hang together; the energy (J) that clusters have less than before.
    pub(super) fn settle_clusters<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        losing: Losing,
    ) -> f64 {
        let Losing { mut clusters, mut energy } = losing;
        if clusters.is_empty() {
            return 0.0;
        }
        let moves = self.moves(world, &clusters);
        // those that take others in had their energies too
        let taking: BTreeSet<u32> = moves.iter().map(|m| m.1).collect();
        let taking: BTreeSet<u32> = taking.difference(&clusters).copied().collect();
        let mut queries = Queries::<S>::new(world);
        energy += self.cluster_energy(&State::new(self, world, soft, &mut queries), world, &taking);
        for &(element, cluster) in &moves {
            let entity = self.rows.elements[KIND][element as usize];
            if let Some(mut index) = world.get_mut::<ClusterIndex>(entity) {
                index.0 = cluster;
            }
        }
        clusters.extend(taking);
        let mut queries = Queries::<S>::new(world);
        energy - self.cluster_energy(&State::new(self, world, soft, &mut queries), world, &clusters)
    }

    /// Tetrahedra that go to other clusters.
    fn moves(&self, world: &mut World, clusters: &BTreeSet<u32>) -> Vec<(u32, u32)> {
        let mut taken = world.query::<&ClusterIndex>();
        let mut next = taken.iter(world).map(|index| index.0).max().map_or(0, |last| last + 1);
        let mut members = self.members(world, clusters);
        members.sort_unstable();
        // pieces of the clusters, by number
        let mut parts: Vec<(u32, Vec<u32>)> = Vec::new();
        for own in members.chunk_by(|a, b| a.0 == b.0) {
            let elements: Vec<u32> = own.iter().map(|m| m.1).collect();
            let nodes: Vec<[u32; 4]> = elements
                .iter()
                .map(|&e| self.connectivity.ordered.tetrahedra()[e as usize])
                .collect();
            let places: Vec<u32> = (0..elements.len() as u32).collect();
            let piece = pieces(&places, &neighbours(&nodes), |_, _| true);
            for number in 0..=piece.iter().copied().max().unwrap_or(0) {
                let of_piece = elements.iter().zip(&piece).filter(|(_, p)| **p == number);
                let name = if number == 0 { own[0].0 } else { next };
                next += u32::from(number > 0);
                parts.push((name, of_piece.map(|(e, _)| *e).collect()));
            }
        }
        let mut moves: Vec<(u32, u32)> = Vec::new();
        for part in 0..parts.len() {
            if parts[part].1.len() < FEW
                && let Some(to) = self.smallest_neighbour(world, &parts, part)
            {
                let few = std::mem::take(&mut parts[part].1);
                match parts.iter_mut().find(|(name, own)| *name == to && !own.is_empty()) {
                    Some((_, own)) => own.extend(few),
                    None => moves.extend(few.iter().map(|&e| (e, to))),
                }
            }
        }
        for (name, own) in parts {
            moves.extend(own.iter().map(|&e| (e, name)));
        }
        moves.retain(|&(e, to)| self.cluster(world, e) != Some(to));
        moves.sort_unstable();
        moves
    }

    /// Cluster across a face of a part, the one of the fewest elements.
    fn smallest_neighbour(
        &self,
        world: &World,
        parts: &[(u32, Vec<u32>)],
        part: usize,
    ) -> Option<u32> {
        let connectivity = &self.connectivity;
        let mut near = BTreeSet::new();
        for &e in &parts[part].1 {
            let nodes = connectivity.ordered.tetrahedra()[e as usize];
            for opposite in 0..4 {
                let mut face = [1, 2, 3].map(|k| nodes[(opposite + k) % 4]);
                face.sort_unstable();
                let Some(triangle) = self.triangle(face) else { continue };
                let round = connectivity.round_triangle.of(triangle as u32).iter();
                let left = round.filter(|&&t| connectivity.is_present(KIND, t));
                for &t in left.filter(|t| !parts[part].1.contains(t)) {
                    let of_part = parts.iter().find(|(_, own)| own.contains(&t));
                    near.extend(of_part.map(|part| part.0).or_else(|| self.cluster(world, t)));
                }
            }
        }
        let size = |name: u32| match parts.iter().find(|(own, e)| *own == name && !e.is_empty()) {
            Some((_, own)) => own.len(),
            None => self.members(world, &BTreeSet::from([name])).len(),
        };
        near.into_iter().min_by_key(|&name| (size(name), name))
    }
}
