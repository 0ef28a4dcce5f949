//! Whether a body is held against rigid motion, without which its equilibrium is not unique.

use crate::state::NodeState;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::element_kind::ElementKind;
use sinew_engine::layout::UNUSED;
use sinew_engine::row::LocalRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::sets::DisjointSets;
use sinew_engine::step::StepError;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::RestPosition;
use std::collections::HashMap;
use std::ops::Range;

/// Pivot of the rigid-motion matrix, relative to the largest, below which a motion counts as free.
const FREE: f64 = 1e-9;

/// Most rigid parts of a body that are looked at together: the work grows with the third power.
const MOST_PARTS: usize = 100;

/// Every body must be held against every motion that deforms no element: the six rigid motions of each
/// connected piece, and those of parts about a hinge, which share no more than an edge or a vertex.
///
/// # Errors
/// [`StepError::InvalidSetting`] naming the body, a vertex that can move and the number of motions that
/// are free.
pub fn check_support<S: Scalar>(world: &mut World, node: &NodeState<S>) -> Result<(), StepError> {
    let mut query = world.query::<&RestPosition>();
    let Some(rest) = single_table(query.contiguous_iter(world)) else { return Ok(()) };
    let topology = world.resource::<Topology>();
    topology.bodies.iter().try_for_each(|body| check_body(topology, body, node, rest))
}

/// Whether that holds of consecutive bodies.
pub(crate) fn is_supported<S: Scalar>(
    world: &mut World,
    node: &NodeState<S>,
    bodies: &Range<usize>,
) -> bool {
    let mut query = world.query::<&RestPosition>();
    let Some(rest) = single_table(query.contiguous_iter(world)) else { return true };
    let topology = world.resource::<Topology>();
    let mut own = topology.bodies[bodies.clone()].iter();
    own.all(|body| check_body(topology, body, node, rest).is_ok())
}

fn check_body<S: Scalar>(
    topology: &Topology,
    body: &BodyRows,
    node: &NodeState<S>,
    rest: &[RestPosition],
) -> Result<(), StepError> {
    let held = held_motions(body, node, rest);
    check_pieces(body, &held)?;
    let parts = RigidParts::new(topology, body);
    if (2..=MOST_PARTS).contains(&parts.count) {
        check_parts(body, rest, &parts, &held)?;
    }
    Ok(())
}

/// Held unknowns of a body: row relative to its first, and the part of each rigid motion (three translations,
/// three turns about its first vertex over its size) in that unknown.
fn held_motions<S: Scalar>(
    body: &BodyRows,
    node: &NodeState<S>,
    rest: &[RestPosition],
) -> Vec<(usize, [f64; 6])> {
    let first = body.vertices.start as usize;
    let used = |local: &usize| body.piece[*local] != UNUSED;
    (0..body.piece.len())
        .filter(used)
        .flat_map(|local| node.held_axes(first + local).map(move |k| (local, k)))
        .map(|(local, k)| (local, motions(body, rest, local)[k]))
        .collect()
}

/// Displacement along each axis of a vertex (row relative to the body's first) in each rigid motion.
fn motions(body: &BodyRows, rest: &[RestPosition], local: usize) -> [[f64; 6]; 3] {
    let first = body.vertices.start as usize;
    let arm = (rest[first + local].0 - rest[first].0) / body.size;
    DVec3::AXES.map(|axis| {
        let turn = arm.cross(axis);
        [axis.x, axis.y, axis.z, turn.x, turn.y, turn.z]
    })
}

/// The six rigid motions of every connected piece.
fn check_pieces(body: &BodyRows, held: &[(usize, [f64; 6])]) -> Result<(), StepError> {
    let mut gram = vec![DMatrix::zeros(6); body.piece_count()];
    for (local, w) in held {
        gram[body.piece[*local] as usize].add_square(&[(0, *w)]);
    }
    for (piece, gram) in gram.into_iter().enumerate() {
        let free = 6 - gram.rank();
        if free > 0 {
            let sample = body.piece.iter().position(|&p| p as usize == piece).unwrap_or(0);
            return Err(StepError::InvalidSetting(format!(
                "body `{}`: {free} of the 6 rigid motions of the piece with vertex {} are not \
                 held, so its equilibrium is not unique; fix more vertices or axes, or use a \
                 dynamic integrator",
                body.name,
                body.vertex_of(LocalRow(sample as u32))
            )));
        }
    }
    Ok(())
}

/// The motions of rigid parts that vertices join.
fn check_parts(
    body: &BodyRows,
    rest: &[RestPosition],
    parts: &RigidParts,
    held: &[(usize, [f64; 6])],
) -> Result<(), StepError> {
    let mut gram = DMatrix::zeros(6 * parts.count);
    for (local, w) in held {
        if let Some(&part) = parts.at_vertex[*local].first() {
            gram.add_square(&[(part as usize, *w)]);
        }
    }
    let mut hinge = None;
    for (local, parts) in parts.at_vertex.iter().enumerate() {
        for pair in parts.windows(2) {
            hinge = hinge.or(Some(local));
            for w in motions(body, rest, local) {
                let [a, b] = [pair[0] as usize, pair[1] as usize];
                gram.add_square(&[(a, w), (b, w.map(|w| -w))]);
            }
        }
    }
    let free = 6 * parts.count - gram.rank();
    match hinge {
        Some(local) if free > 0 => Err(StepError::InvalidSetting(format!(
            "body `{}`: parts of it share no more than an edge or a vertex, such as vertex {}, and can turn \
             about it in {free} ways without deforming, so its equilibrium is not unique; join their meshes \
             by faces, fix more vertices, or use a dynamic integrator",
            body.name,
            body.vertex_of(LocalRow(local as u32))
        ))),
        _ => Ok(()),
    }
}

/// Sets of elements of a body that are rigid while no element deforms: those joined by faces, or by three
/// vertices or more. Membranes count as rigid where they are connected; they bend without resistance, but
/// tension holds them.
struct RigidParts {
    count: usize,
    /// Parts at each vertex row (relative to the body's first), ascending.
    at_vertex: Vec<Vec<u32>>,
}

impl RigidParts {
    fn new(topology: &Topology, body: &BodyRows) -> Self {
        let first = body.vertices.start;
        // an element that was removed has an edge that no other uses, mostly; one that has none joins what
        // lies round it anyway
        let lives = |cell: &[u32]| {
            let row = |i: usize| first + cell[i];
            (1..cell.len()).all(|i| {
                let edge = topology.block(row(0).min(row(i)), row(0).max(row(i)));
                edge.is_some_and(|edge| topology.uses_edge(edge as usize))
            })
        };
        let of = |kind: ElementKind| {
            let shared = if kind.is_solid() { 3 } else { 2 };
            body.nodes[kind].iter().map(move |cell| (cell, shared))
        };
        let cells: Vec<(&[u32], usize)> = ElementKind::IN_FILES
            .into_iter()
            .flat_map(of)
            .filter(|(cell, _)| lives(cell))
            .collect();
        let mut at_vertex = vec![Vec::new(); body.piece.len()];
        for (i, (cell, _)) in (0..).zip(&cells) {
            cell.iter().for_each(|&v| at_vertex[v as usize].push(i));
        }
        // cells that share so many vertices move together; parts that do so after that, likewise
        let mut sets = DisjointSets::new(cells.len());
        while join(&cells, &at_vertex, &mut sets) {}
        let number = sets.count();
        for parts in &mut at_vertex {
            parts.iter_mut().for_each(|i| *i = number[*i as usize]);
            parts.sort_unstable();
            parts.dedup();
        }
        let count = number.iter().max().map_or(0, |&last| last as usize + 1);
        Self { count, at_vertex }
    }
}

/// Joins the parts of cells that share enough vertices with another; whether there were any.
fn join(cells: &[(&[u32], usize)], at_vertex: &[Vec<u32>], sets: &mut DisjointSets) -> bool {
    let mut joined = false;
    let mut shared: HashMap<u32, usize> = HashMap::new();
    for (i, (cell, enough)) in (0..).zip(cells) {
        shared.clear();
        let own = sets.root(i);
        for &v in *cell {
            let mut others: Vec<u32> =
                at_vertex[v as usize].iter().map(|&other| sets.root(other)).collect();
            others.sort_unstable();
            others.dedup();
            others
                .into_iter()
                .filter(|&o| o != own)
                .for_each(|o| *shared.entry(o).or_default() += 1);
        }
        for (&other, &count) in &shared {
            joined |= count >= *enough && sets.join(i, other);
        }
    }
    joined
}

/// A symmetric positive semidefinite matrix, row by row.
#[derive(Clone)]
struct DMatrix {
    n: usize,
    entries: Vec<f64>,
}

impl DMatrix {
    fn zeros(n: usize) -> Self {
        Self { n, entries: vec![0.0; n * n] }
    }

    /// Adds the square of a sum of motions of parts.
    fn add_square(&mut self, of_parts: &[(usize, [f64; 6])]) {
        for (p, v) in of_parts {
            for (q, w) in of_parts {
                for i in 0..6 {
                    for j in 0..6 {
                        self.entries[(6 * p + i) * self.n + 6 * q + j] += v[i] * w[j];
                    }
                }
            }
        }
    }

    /// Rank, by elimination with the largest pivot first.
    fn rank(mut self) -> usize {
        let n = self.n;
        let diagonal = |m: &Self, i: usize| m.entries[i * n + i];
        let largest = (0..n).map(|i| diagonal(&self, i)).fold(0.0, f64::max);
        let mut left: Vec<usize> = (0..n).collect();
        for found in 0..n {
            let pivot = (0..left.len())
                .max_by(|&a, &b| diagonal(&self, left[a]).total_cmp(&diagonal(&self, left[b])));
            let Some(place) = pivot.filter(|&p| diagonal(&self, left[p]) > FREE * largest) else {
                return found;
            };
            let p = left.swap_remove(place);
            for &i in &left {
                let factor = self.entries[i * n + p] / self.entries[p * n + p];
                for &j in &left {
                    self.entries[i * n + j] -= factor * self.entries[p * n + j];
                }
            }
        }
        n
    }
}

#[cfg(test)]
mod tests {
    use super::DMatrix;

    #[test]
    fn rank_of_singular_and_regular_matrices() {
        let mut m = DMatrix::zeros(6);
        assert_eq!(m.clone().rank(), 0);
        for i in 0..6 {
            m.entries[7 * i] = 1.0 + i as f64;
        }
        assert_eq!(m.clone().rank(), 6);
        m.entries[7 * 3] = 1e-12;
        assert_eq!(m.rank(), 5);
    }
}
