//! Clusters of tetrahedra after a removal or a cut: none falls into pieces, and none is of very few elements.

use bevy_ecs::prelude::*;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::scalar::Scalar;
use std::collections::BTreeSet;

use super::state::{Queries, State};
use crate::body::clusters::{FEW, neighbours, pieces};
use crate::body::description::SoftBody;
use crate::body::present::BodyResection;
use crate::frame::means::Sums;
use crate::frame::moduli::ClusterIndex;
use crate::frame::rules::VolumeRule;

/// Tetrahedra.
const KIND: ElementKind = ElementKind::Tetrahedron;

/// Clusters that lose elements, and their energy (J) before that.
#[derive(Debug, Default)]
pub(crate) struct Losing {
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
        chosen: &[u32],
    ) -> Losing {
        let clusters = chosen.iter().filter_map(|&e| self.cluster(world, e)).collect();
        let energy = self.cluster_energy(state, world, &clusters);
        Losing { clusters, energy }
    }

    /// The same, before a blade parts these tetrahedra.
    pub(crate) fn parting<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        parted: &[u32],
    ) -> Losing {
        if soft.volume != VolumeRule::Clusters || self.element_of[KIND].is_empty() {
            return Losing::default();
        }
        let mut queries = Queries::<S>::new(world);
        self.losing(&State::new(self, world, soft, &mut queries), world, parted)
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
    pub(crate) fn settle_clusters<S: Scalar>(
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
        let beside = self.beside();
        // pieces of the clusters, by number
        let mut parts: Vec<(u32, Vec<u32>)> = Vec::new();
        for own in members.chunk_by(|a, b| a.0 == b.0) {
            let elements: Vec<u32> = own.iter().map(|m| m.1).collect();
            let piece = match &beside {
                Some(beside) => pieces(&elements, beside, |_, _| true),
                None => {
                    let all = self.connectivity.ordered.tetrahedra();
                    let nodes: Vec<[u32; 4]> = elements.iter().map(|&e| all[e as usize]).collect();
                    let places: Vec<u32> = (0..elements.len() as u32).collect();
                    pieces(&places, &neighbours(&nodes), |_, _| true)
                }
            };
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
                && let Some(to) = self.smallest_neighbour(world, beside.as_deref(), &parts, part)
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

    /// In bodies that were cut, the elements that each hangs together with: both sides of a wound have the same faces at
    /// its end, so that only what is left between them tells.
    fn beside(&self) -> Option<Vec<Vec<u32>>> {
        let mut beside = vec![Vec::new(); self.element_of[KIND].len()];
        for pair in self.material.as_ref()?.joined_elements(|_| true) {
            let [a, b] = pair.map(|e| self.element_of[KIND][e as usize]);
            beside[a as usize].push(b);
            beside[b as usize].push(a);
        }
        Some(beside)
    }

    /// Cluster across a face of a part, the one of the fewest elements.
    fn smallest_neighbour(
        &self,
        world: &World,
        beside: Option<&[Vec<u32>]>,
        parts: &[(u32, Vec<u32>)],
        part: usize,
    ) -> Option<u32> {
        let connectivity = &self.connectivity;
        let across = |e: u32| -> Vec<u32> {
            if let Some(beside) = beside {
                return beside[e as usize].clone();
            }
            let nodes = connectivity.ordered.tetrahedra()[e as usize];
            let faces = (0..4).filter_map(|opposite| {
                let mut face = [1, 2, 3].map(|k| nodes[(opposite + k) % 4]);
                face.sort_unstable();
                self.triangle(face)
            });
            faces.flat_map(|face| connectivity.round_triangle.of(face as u32)).copied().collect()
        };
        let mut near = BTreeSet::new();
        for t in parts[part].1.iter().flat_map(|&e| across(e)) {
            if connectivity.is_present(KIND, t) && !parts[part].1.contains(&t) {
                let of_part = parts.iter().find(|(_, own)| own.contains(&t));
                near.extend(of_part.map(|part| part.0).or_else(|| self.cluster(world, t)));
            }
        }
        let size = |name: u32| match parts.iter().find(|(own, e)| *own == name && !e.is_empty()) {
            Some((_, own)) => own.len(),
            None => self.members(world, &BTreeSet::from([name])).len(),
        };
        near.into_iter().min_by_key(|&name| (size(name), name))
    }
}
