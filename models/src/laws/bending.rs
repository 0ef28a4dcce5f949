//! Bending of membranes: angles at the edges between triangles ([`crate::element::hinge`]), coupled so that together they
//! are a plate ([`crate::element::plate`]).
//!
//! With `sigma` and `kappa` of every hinge and the constants `C` of the plate:
//!
//! ```text
//! E = 1/2 sigma^T C sigma + 1/2 sum_e C_ee kappa_e^2                            (J)
//! f = -sum_e (m_e dsigma_e/dx + C_ee kappa_e dkappa_e/dx),   m = C sigma         (N)
//! K = sum_ef C_ef dsigma_e dsigma_f^T + sum_e C_ee dkappa_e dkappa_e^T           (N/m)
//!     + sum_e (m_e d2sigma_e + C_ee kappa_e d2kappa_e)
//! ```
//!
//! For small angles this is `1/2 theta^T C theta`. A single hinge has the energy `C_ee (1 - cos theta)`: it resists to the end,
//! and nothing jumps where an edge is folded over. Angles of a bent sheet shrink with its triangles, and with them what
//! differs from `theta^T C theta`.
//!
//! The first line of `K` is positive semidefinite, because `C` is. It is the stand-in ([`TangentKind::GaussNewton`] and
//! [`TangentKind::Projected`]). What is left out is smaller by the factor `theta`. The exact tangent leaves out the
//! derivative of the fading of triangles that have lost nine tenths of their area.
//!
//! An angle knows two triangles, its constants know their neighbours, so neither elements nor registers of them fit. All
//! angles are measured first, then every hinge writes its forces and the blocks of its four vertices. The edge graph
//! of a body that bends holds more pairs ([`Neighbours::couplings`]), which no element has.

use bevy_ecs::prelude::*;
use sinew_engine::columns::single_table;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::law::{
    DisabledLaws, EvaluationRequest, LawBuffer, LawBuffers, LawInfo, Span, TangentKind,
};
use sinew_engine::scalar::{Scalar, Single, scale};
use sinew_engine::schedule::{ForceSystems, Input, activate_law_of_systems, declare_inputs};
use sinew_engine::stopwatch::Stopwatch;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{Displacement, RestPosition};
use sinew_engine::workers::Workers;

use crate::body::description::SoftBody;
use crate::body::present::Resection;
use crate::element::hinge::{Hinge, HingeState, Nodes};
use crate::element::matrix::{add_outer, symmetrise};
use crate::element::plate::{self, Neighbours};
use crate::frame::row::{self, Elements, InRecovery, LawRow, PlacedLaw, mark};

/// Bending of all membranes that have it.
pub static ROW: LawRow = LawRow::of_systems(
    LawInfo::elastic("bending of membranes"),
    Elements::Hinges,
    [mark::<SoftBody>; 2],
    [activate_law::<f64>, activate_law::<Single>],
)
// membranes go on while solids recover
.in_recovery(InRecovery::Unchanged)
// no more than a bounded energy
.yielding_to_pressure();

/// Places of vertices that the energy of a hinge is coupled with: the triangles of the couplings of its two triangles
/// and their four neighbours form a tree of 30, each of which adds a vertex to the first two.
const MOST: usize = 32;
/// What hinges add to the memory (bytes) of a membrane triangle, with the blocks of matrices that they couple.
pub(crate) const MEMORY: u64 = 6000;
/// Where an own vertex has no block to write: its partner writes it.
const NOT_STORED: u32 = u32::MAX;
/// A diagonal block.
const DIAGONAL: u32 = u32::MAX - 1;

/// The hinges of all membranes that bend, body by body.
#[derive(Resource, Debug, Default)]
pub(crate) struct Hinges<S> {
    /// Vertex rows: the edge, and the corners opposite to it.
    nodes: Vec<[u32; 4]>,
    rest: Vec<Hinge<S>>,
    /// `C_ee` (J).
    own: Vec<S>,
    /// First coupling of every hinge; one more than hinges.
    start: Vec<u32>,
    couplings: Vec<Coupling<S>>,
    /// First vertex of every hinge in `coupled`; one more than hinges.
    first: Vec<u32>,
    /// Vertex rows that a hinge is coupled with, ascending.
    coupled: Vec<u32>,
    /// For each of those the blocks that it forms with the vertices of the hinge.
    blocks: Vec<[u32; 4]>,
    /// Places of the vertices of the hinge among those.
    places: Vec<[u8; 4]>,
}

/// A hinge that another one is coupled with.
#[derive(Clone, Copy, Debug)]
struct Coupling<S> {
    hinge: u32,
    /// `C_ef` (J).
    value: S,
    /// Places of its vertices among those that the other one is coupled with.
    places: [u8; 4],
}

/// The hinges at the last displacements.
#[derive(Resource, Debug, Default)]
struct HingeStates<S>(Vec<HingeState<S>>);

fn activate_law<S: Scalar>(world: &mut World, law: PlacedLaw) {
    // cut when hinges are collected
    let elements = (None, (|_, _, _| {}) as sinew_engine::law::Partition<S>);
    activate_law_of_systems(world, (law.row.info, law.place), elements, |schedule, _| {
        schedule.add_systems(evaluate::<S>.in_set(ForceSystems::Evaluate));
    });
    let changed: fn(&mut World) -> bool = |world| world.is_resource_changed::<Hinges<S>>();
    declare_inputs(world, law.row.info.name, &[Input::Watch(changed)]);
}

/// Puts the law into the schedule; [`refresh`] finds its hinges.
pub(crate) fn activate<S: Scalar>(world: &mut World) {
    if !world.contains_resource::<Hinges<S>>() {
        world.insert_resource(Hinges::<S>::default());
        world.insert_resource(HingeStates::<S>::default());
        row::activate::<S>(world, &ROW);
    }
}

/// Finds the hinges of what is left of all bodies, if there are any that bend. `resection`: what knows it, in place of
/// that of the world.
pub(crate) fn refresh<S: Scalar>(world: &mut World, resection: Option<&Resection>) {
    if !world.contains_resource::<Hinges<S>>() {
        return;
    }
    let mut bodies: Vec<SoftBody> = world.query::<&SoftBody>().iter(world).cloned().collect();
    bodies.sort_by_key(|soft| soft.index);
    let mut rests = world.query::<&RestPosition>();
    let rest = single_table(rests.contiguous_iter(world)).unwrap_or(&[]);
    let topology = world.resource::<Topology>();
    let resection = resection.or_else(|| world.get_resource::<Resection>());
    let mut hinges = Hinges::<S> { start: vec![0], first: vec![0], ..Default::default() };
    for soft in &bodies {
        let Some((moduli, flat)) = soft.membrane.and_then(|m| m.plate()) else { continue };
        let body = &topology.bodies[soft.index];
        let connectivity = resection.and_then(|r| r.connectivity(soft.index));
        let is_left =
            |t: usize| connectivity.is_none_or(|c| c.is_present(ElementKind::Triangle, t as u32));
        let v0 = body.vertices.start;
        let triangles = body.triangles().iter().enumerate().filter(|(t, _)| is_left(*t));
        let triangles = triangles.map(|(_, nodes)| nodes.map(|v| v + v0)).collect();
        // branching edges were refused before
        let Ok(near) = Neighbours::new(triangles) else { continue };
        let rest_of = |v: u32| rest[v as usize].0.to_array();
        hinges.add(&near, rest_of, (moduli, flat), topology);
    }
    let mut buffer = LawBuffer::<S>::default();
    let coupled = |i: usize| &hinges.coupled[hinges.vertices_of(i)];
    buffer.spans = Span::cut(0..hinges.nodes.len(), topology, coupled);
    if let Some(mut own) = world.resource::<LawBuffers<S>>().get(ROW.info.name) {
        *own = buffer;
    }
    world.insert_resource(hinges);
}

/// Whether a block of the tangent is one that hinges write, for all blocks.
pub(crate) fn used_blocks<S: Scalar>(world: &World) -> Vec<bool> {
    let mut used = vec![false; world.resource::<Topology>().edges.len()];
    if let Some(hinges) = world.get_resource::<Hinges<S>>() {
        let blocks = hinges.blocks.iter().flatten();
        blocks.filter(|&&b| b < DIAGONAL).for_each(|&b| used[b as usize] = true);
    }
    used
}

/// Energy (J) of the hinges of a body at the displacements that the world holds.
pub(crate) fn energy<S: Scalar>(world: &mut World, body: usize) -> f64 {
    let mut vertices = world.query::<&Displacement<S>>();
    let Some(hinges) = world.get_resource::<Hinges<S>>() else { return 0.0 };
    let Some(u) = single_table(vertices.contiguous_iter(world)) else { return 0.0 };
    let rows = &world.resource::<Topology>().bodies[body].vertices;
    let own: Vec<usize> =
        (0..hinges.nodes.len()).filter(|&i| rows.contains(&hinges.nodes[i][0])).collect();
    let displacement = bytemuck::TransparentWrapper::peel_slice(u);
    let mut states = vec![HingeState::default(); hinges.nodes.len()];
    own.iter().for_each(|&i| states[i] = hinges.state(i, displacement));
    own.iter().map(|&i| hinges.energy(i, &states)).sum()
}

impl<S: Scalar> Hinges<S> {
    fn vertices_of(&self, i: usize) -> std::ops::Range<usize> {
        self.first[i] as usize..self.first[i + 1] as usize
    }

    fn couplings_of(&self, i: usize) -> &[Coupling<S>] {
        &self.couplings[self.start[i] as usize..self.start[i + 1] as usize]
    }

    /// Adds the hinges of a body.
    fn add(
        &mut self,
        near: &Neighbours,
        rest_of: impl Fn(u32) -> [f64; 3],
        (moduli, flat): ([f64; 2], bool),
        topology: &Topology,
    ) {
        let before = self.nodes.len() as u32;
        let couplings = plate::couplings(near, &rest_of, moduli);
        let hinges = near.hinges();
        for (i, &nodes) in hinges.iter().enumerate() {
            let entries = couplings.start[i] as usize..couplings.start[i + 1] as usize;
            let partners = &couplings.hinge[entries.clone()];
            let mut coupled: Vec<u32> = partners.iter().flat_map(|&h| hinges[h as usize]).collect();
            coupled.sort_unstable();
            coupled.dedup();
            let places = |nodes: [u32; 4]| {
                nodes.map(|v| coupled.binary_search(&v).unwrap_or_default() as u8)
            };
            for (&hinge, &value) in partners.iter().zip(&couplings.value[entries]) {
                let own = hinge as usize == i;
                let (places, value) = (places(hinges[hinge as usize]), S::from_f64(value));
                self.couplings.push(Coupling { hinge: before + hinge, value, places });
                if own {
                    self.own.push(value);
                }
            }
            self.start.push(self.couplings.len() as u32);
            self.places.push(places(nodes));
            let block = |a: u32, v: u32| match a.cmp(&v) {
                std::cmp::Ordering::Equal => DIAGONAL,
                std::cmp::Ordering::Greater => NOT_STORED,
                // the graph of a body that bends has all of them
                std::cmp::Ordering::Less => topology.block(a, v).unwrap_or(NOT_STORED),
            };
            self.blocks.extend(coupled.iter().map(|&v| nodes.map(|a| block(a, v))));
            self.coupled.extend(coupled);
            self.first.push(self.coupled.len() as u32);
            self.rest.push(Hinge::new(&nodes.map(&rest_of), flat).cast());
        }
        self.nodes.extend_from_slice(hinges);
    }

    fn displacements(&self, i: usize, u: &[[S; 4]]) -> Nodes<S> {
        self.nodes[i].map(|v| {
            let [x, y, z, _] = u[v as usize];
            [x, y, z]
        })
    }

    fn state(&self, i: usize, u: &[[S; 4]]) -> HingeState<S> {
        self.rest[i].state(&self.displacements(i, u))
    }

    /// `m_e` (J).
    fn moment(&self, i: usize, states: &[HingeState<S>]) -> S {
        let of = |c: &Coupling<S>| c.value * states[c.hinge as usize].sigma;
        self.couplings_of(i).iter().map(of).fold(S::ZERO, |sum, x| sum + x)
    }

    fn energy(&self, i: usize, states: &[HingeState<S>]) -> f64 {
        let state = &states[i];
        let folded = self.own[i] * state.kappa * state.kappa;
        0.5 * (self.moment(i, states) * state.sigma + folded).to_f64()
    }

    fn add_force(&self, i: usize, states: &[HingeState<S>], span: &mut Span<S>) {
        let state = &states[i];
        let (m, k) = (self.moment(i, states), self.own[i] * state.kappa);
        for (v, &row) in self.nodes[i].iter().enumerate() {
            let f: [S; 3] =
                std::array::from_fn(|x| -(m * state.of_sigma[v][x] + k * state.of_kappa[v][x]));
            span.add_force(row, f);
        }
    }

    fn add_tangent(
        &self,
        i: usize,
        (states, u): (&[HingeState<S>], &[[S; 4]]),
        exact: bool,
        span: &mut Span<S>,
    ) {
        let state = &states[i];
        let vertices = self.vertices_of(i);
        let blocks = &self.blocks[vertices.clone()];
        let mut row = [[S::ZERO; 3]; MOST];
        for c in self.couplings_of(i) {
            let other = &states[c.hinge as usize].of_sigma;
            for (v, &place) in c.places.iter().enumerate() {
                for x in 0..3 {
                    row[usize::from(place)][x] += c.value * other[v][x];
                }
            }
        }
        for (other, blocks) in row.iter().zip(blocks) {
            for (v, &block) in blocks.iter().enumerate() {
                if block != NOT_STORED {
                    let mut m = [S::ZERO; 9];
                    add_outer(&mut m, state.of_sigma[v], *other);
                    self.add_block(i, (v, block), m, span);
                }
            }
        }
        // what a hinge gives by itself
        let (moment, folded) = (self.moment(i, states), self.own[i] * state.kappa);
        let (sin, cos, fade) = (state.sin, state.cos, state.fade);
        let tension = fade * (moment * cos + folded * sin);
        let second = exact.then(|| self.rest[i].second_derivative(&self.displacements(i, u)));
        for v in 0..4 {
            for (w, &place) in self.places[i].iter().enumerate() {
                let block = blocks[usize::from(place)][v];
                if block == NOT_STORED {
                    continue;
                }
                let mut m = [S::ZERO; 9];
                add_outer(&mut m, scale(state.of_kappa[v], self.own[i]), state.of_kappa[w]);
                if let Some(second) = &second {
                    let turning = fade * (folded * cos - moment * sin);
                    add_outer(&mut m, scale(state.gradient[v], turning), state.gradient[w]);
                    for x in 0..9 {
                        m[x] += tension * second[v][w][x];
                    }
                }
                self.add_block(i, (v, block), m, span);
            }
        }
    }

    fn add_block(&self, i: usize, (v, block): (usize, u32), mut m: [S; 9], span: &mut Span<S>) {
        if block == DIAGONAL {
            // those of all hinges add up to a symmetric one
            symmetrise(&mut m);
            span.add_diagonal(self.nodes[i][v], &m);
        } else {
            span.add_off_diagonal(block, 0, 1, &m);
        }
    }
}

/// Hinges that one task measures.
const CHUNK: usize = 1024;

fn evaluate<S: Scalar>(
    (request, workers): (Res<EvaluationRequest>, Res<Workers>),
    hinges: Res<Hinges<S>>,
    mut states: ResMut<HingeStates<S>>,
    (buffers, disabled): (Res<LawBuffers<S>>, Res<DisabledLaws>),
    vertices: Query<&Displacement<S>>,
) {
    let start = Stopwatch::start();
    if disabled.contains(ROW.info.name) {
        return;
    }
    let Some(mut buffer) = buffers.get(ROW.info.name) else { return };
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let displacement: &[[S; 4]] = bytemuck::TransparentWrapper::peel_slice(u);
    let count = hinges.nodes.len();
    let states = &mut states.0;
    states.resize(count, HingeState::default());
    workers.for_chunks(states, CHUNK, count * 100, |first, states| {
        for (i, state) in (first..).zip(states) {
            *state = hinges.state(i, displacement);
        }
    });
    let states = &*states;
    let work = 40 + 1500 * usize::from(request.tangent.is_some());
    buffer.for_each_awake(&workers, count * work, |_, span| {
        let own = span.elements.clone();
        if request.energy {
            span.energy = own.clone().map(|i| hinges.energy(i, states)).sum();
        }
        if request.force {
            span.clear_force();
            own.clone().for_each(|i| hinges.add_force(i, states, span));
        }
        match request.tangent {
            Some(kind) => {
                span.clear_tangent();
                let exact = kind == TangentKind::Exact;
                own.for_each(|i| hinges.add_tangent(i, (states, displacement), exact, span));
            }
            None => span.drop_tangent(),
        }
    });
    buffer.time = start.elapsed();
}
