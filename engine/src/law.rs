//! How laws and solvers meet: an [`EvaluationRequest`] says what is wanted, every law writes into
//! its own [`LawBuffer`] (so laws never conflict and may run in parallel), and the gather adds the
//! buffers up in a fixed order.
//!
//! A buffer holds private arrays for a fixed set of element ranges. Because elements are sorted by
//! vertex row, a range touches only a short span of rows and of tangent blocks, and its private
//! arrays cover just that span. There are no atomics and no colouring, and the sum does not depend
//! on the number of threads.

use crate::matrix::{BlockMatrix, LowRank};
use crate::resource::{put, take};
use crate::scalar::Scalar;
use crate::topology::Topology;
use crate::workers::Workers;
use bevy_ecs::component::ComponentId;
use bevy_ecs::prelude::{Resource, World};
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Which second derivative, or positive semidefinite stand-in for it, a tangent is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TangentKind {
    /// The second derivative. Indefinite under any compression.
    Exact,
    /// Material part and `p2` part only: the geometric stiffness and the second derivative of `J`
    /// are dropped. Positive semidefinite for `lambda >= -2/3 mu`, at no extra work.
    GaussNewton,
    /// The second derivative with the negative eigenvalues of the 9x9 `dP/dF` set to zero; equal to
    /// `Exact` where there are none. The element matrix is then positive semidefinite too. Always
    /// decided and decomposed in `f64`; about four times the work of `Exact` except in elements
    /// that are stretched in every direction.
    Projected,
}

/// What the next run of [`crate::schedule::ForceSchedule`] has to produce.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct EvaluationRequest {
    /// Elastic energy into [`ElasticEnergy`].
    pub energy: bool,
    /// Elastic forces into [`crate::vertex::ElasticForce`].
    pub force: bool,
    /// Tangent into [`crate::matrix::Tangent`].
    pub tangent: Option<TangentKind>,
}

/// Bodies that recover from inversion: their laws give way to the corotational energy, whose elements
/// have one minimum only.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq)]
pub struct RecoveringBodies(pub Vec<bool>);

impl RecoveringBodies {
    /// Whether a body recovers.
    #[inline]
    pub fn contains(&self, body: usize) -> bool {
        self.0.get(body).is_some_and(|&recovers| recovers)
    }
}

/// Bodies that sleep, by index: they stay where they are, so that what was found of their elements at these displacements
/// still holds. A solver fills it for as long as a step lasts.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq)]
pub struct SleepingBodies(pub Vec<bool>);

impl SleepingBodies {
    /// Whether a body sleeps.
    #[inline]
    pub fn contains(&self, body: usize) -> bool {
        self.0.get(body).is_some_and(|&sleeps| sleeps)
    }

    /// Whether all bodies of the world sleep.
    pub fn everyone(&self) -> bool {
        !self.0.is_empty() && !self.0.contains(&false)
    }
}

/// Bodies that never recover, by index: springs on edges alone or axes alone have no energy of a material
/// that the corotational one could stand in for.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq)]
pub struct BodiesWithoutRecovery(Vec<bool>);

impl BodiesWithoutRecovery {
    /// Adds a body.
    pub fn insert(&mut self, body: usize) {
        self.0.resize(self.0.len().max(body + 1), false);
        self.0[body] = true;
    }

    /// Whether a body never recovers.
    #[inline]
    pub fn contains(&self, body: usize) -> bool {
        self.0.get(body).is_some_and(|&without| without)
    }
}

/// Laws that are switched off, by name: neither evaluated nor summed up, and named in the report of a run.
/// Bodies that rely on one have no energy of it. Takes effect at the next evaluation.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq)]
pub struct DisabledLaws(pub Vec<&'static str>);

impl DisabledLaws {
    /// Whether a law is switched off.
    #[inline]
    pub fn contains(&self, name: &str) -> bool {
        self.0.contains(&name)
    }
}

/// Elastic energy of the last evaluation (J), with the potential of loads that are laws.
#[derive(Resource, Clone, Debug, Default)]
pub struct ElasticEnergy {
    /// Sum over all laws.
    pub total: f64,
    /// Contribution of each law, in gather order.
    pub by_law: Vec<(&'static str, f64)>,
    /// Sum over all laws for each body, in the order of [`Topology::bodies`].
    pub by_body: Vec<f64>,
    /// Part of `total` that is no elastic energy but the potential of loads ([`LawInfo::is_load`]).
    pub load: f64,
    /// [`LowRank::values`] of the laws that have such a part, in gather order.
    pub values: Vec<Vec<f64>>,
}

impl ElasticEnergy {
    /// Energy stored in the bodies (J), without the potential of loads.
    pub fn elastic(&self) -> f64 {
        self.total - self.load
    }
}

/// What the engine knows of a law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LawInfo {
    /// Name shown in reports; unique.
    pub name: &'static str,
    /// Whether its energy is the potential of a load: part of what solvers minimise, but booked as work of
    /// loads and not as elastic energy.
    pub is_load: bool,
}

impl LawInfo {
    /// A law whose energy is elastic.
    pub const fn elastic(name: &'static str) -> Self {
        Self { name, is_load: false }
    }
}

/// Private arrays of one range of elements.
#[derive(Clone, Debug)]
pub struct Span<S> {
    /// Body that the elements belong to; ranges never cross from one body to the next.
    pub body: usize,
    /// Elements (table rows) of this range.
    pub elements: Range<usize>,
    /// Vertex rows they touch, lowest to highest.
    pub rows: Range<usize>,
    /// Tangent blocks of those rows.
    pub blocks: Range<usize>,
    /// Forces (N), one per row of `rows`; fourth entry padding.
    pub force: Vec<[S; 4]>,
    /// Diagonal tangent blocks (N/m), one per row of `rows`, row-major; empty until asked for.
    pub diagonal: Vec<[S; 9]>,
    /// Off-diagonal tangent blocks (N/m), one per block of `blocks`; empty until asked for.
    pub off_diagonal: Vec<[S; 9]>,
    /// Edge-table rows that its springs pull on; set by laws of springs, else empty.
    pub edges: Range<usize>,
    /// What its springs add to the tension (N/m) of those edges; empty for other laws.
    pub tension: Vec<S>,
    /// Energy (J).
    pub energy: f64,
    /// Elements whose eigenvalues had to be clamped.
    pub clamped: u64,
    /// The body [sleeps](SleepingBodies): energy and force hold, and there is no tangent.
    pub sleeps: bool,
}

impl<S> Span<S> {
    /// Cuts a range of elements into fixed ranges, each of one body; `vertices(i)` lists the vertex rows of element `i`.
    /// Elements lie body by body, but copies that cuts made come after all others.
    pub fn cut<'a>(
        elements: Range<usize>,
        topology: &Topology,
        vertices: impl Fn(usize) -> &'a [u32],
    ) -> Vec<Self> {
        let mut spans = Vec::new();
        let mut first = elements.start;
        while first < elements.end {
            let row = vertices(first)[0];
            let body = topology.bodies.partition_point(|body| body.vertices.end <= row);
            let mut end = first;
            while end < elements.end && topology.bodies[body].vertices.contains(&vertices(end)[0]) {
                end += 1;
            }
            let own = end - first;
            let pieces = (own / ELEMENTS_PER_SPAN).clamp(1, MAX_SPANS);
            for piece in 0..pieces {
                let elements = first + own * piece / pieces..first + own * (piece + 1) / pieces;
                if !elements.is_empty() {
                    spans.push(span(body, elements, topology, &vertices));
                }
            }
            first = end;
        }
        spans
    }
}

impl<S: Scalar> Span<S> {
    /// Makes the force array zero.
    pub fn clear_force(&mut self) {
        self.force.clear();
        self.force.resize(self.rows.len(), [S::ZERO; 4]);
    }

    /// Makes the tension array zero.
    pub fn clear_tension(&mut self) {
        self.tension.clear();
        self.tension.resize(self.edges.len(), S::ZERO);
    }

    /// Makes the tangent arrays zero, allocating them at first use.
    pub fn clear_tangent(&mut self) {
        self.diagonal.clear();
        self.diagonal.resize(self.rows.len(), [S::ZERO; 9]);
        self.off_diagonal.clear();
        self.off_diagonal.resize(self.blocks.len(), [S::ZERO; 9]);
        self.clamped = 0;
    }

    /// Empties the tangent arrays (memory is kept): this law has no part in the tangent.
    pub fn drop_tangent(&mut self) {
        self.diagonal.clear();
        self.off_diagonal.clear();
        self.clamped = 0;
    }

    /// No energy, no force and no part in the tangent: the body's elements follow another law.
    pub fn silence(&mut self) {
        self.energy = 0.0;
        self.force.clear();
        self.drop_tangent();
    }

    /// Adds a force to a vertex row.
    #[inline(always)]
    pub fn add_force(&mut self, row: u32, f: [S; 3]) {
        let p = &mut self.force[row as usize - self.rows.start];
        p[0] += f[0];
        p[1] += f[1];
        p[2] += f[2];
    }

    /// Adds a diagonal block.
    #[inline(always)]
    pub fn add_diagonal(&mut self, row: u32, m: &[S; 9]) {
        let p = &mut self.diagonal[row as usize - self.rows.start];
        for i in 0..9 {
            p[i] += m[i];
        }
    }

    /// Adds an off-diagonal block given for (row of `a`, column of `b`); it is transposed when `a`
    /// is the higher row, since only the upper half is stored.
    #[inline(always)]
    pub fn add_off_diagonal(&mut self, block: u32, a: u32, b: u32, m: &[S; 9]) {
        let p = &mut self.off_diagonal[block as usize - self.blocks.start];
        if a < b {
            for i in 0..9 {
                p[i] += m[i];
            }
        } else {
            for i in 0..3 {
                for j in 0..3 {
                    p[3 * i + j] += m[3 * j + i];
                }
            }
        }
    }
}

/// What is wanted of a law of dampers.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ViscousRequest<S> {
    /// Its viscous matrix (N s/m, symmetric and positive semidefinite), as the tangent.
    #[default]
    Matrix,
    /// Its forces (N) at these velocities (m/s), one per vertex row.
    Force(Vec<[S; 4]>),
    /// For every vertex row a bound (N s/m), as the first component of the force, on the sum of what unit velocities
    /// of all vertices can make of its force at any displacement. The largest of them over the masses bounds the
    /// rates (1/s) at which dampers slow vertices down.
    Bound,
}

/// Contribution of one law to forces, tangent and energy.
#[derive(Clone, Debug, Default)]
pub struct LawBuffer<S> {
    /// Fixed ranges of elements with their private arrays.
    pub spans: Vec<Span<S>>,
    /// Host time of the law's last evaluation; the gather books it.
    pub time: Duration,
    /// What is wanted, of laws of dampers.
    pub viscous: ViscousRequest<S>,
    /// Part of the tangent that couples the vertices of many elements; of laws without one, `None`.
    pub low_rank: Option<LowRank<S>>,
    /// What its vectors are derivatives of (J^1/2), as [`LowRank::values`], at every evaluation.
    pub values: Vec<f64>,
}

/// Elements per range: enough work to be worth a task, few enough ranges to keep overlaps small.
const ELEMENTS_PER_SPAN: usize = 2048;
/// Upper limit for the number of ranges.
const MAX_SPANS: usize = 16;

impl<S: Scalar> LawBuffer<S> {
    /// Cuts elements into fixed ranges, body by body. `vertices(i)` lists the vertex rows of element
    /// `i`; elements lie body by body in their table.
    pub fn partition<'a>(
        &mut self,
        count: usize,
        topology: &Topology,
        vertices: impl Fn(usize) -> &'a [u32],
    ) {
        self.spans = Span::cut(0..count, topology, vertices);
    }

    /// Empties the tangent arrays of all ranges.
    pub fn drop_tangent(&mut self) {
        self.spans.iter_mut().for_each(Span::drop_tangent);
    }

    /// Calls `f(index, range)` for the ranges of all bodies that do not sleep, side by side; `work` (ns) is that of all ranges.
    pub fn for_each_awake(
        &mut self,
        workers: &Workers,
        work: usize,
        f: impl Fn(usize, &mut Span<S>) + Send + Sync,
    ) {
        self.each_awake(workers, work, &f);
    }

    /// [`for_each_awake`](Self::for_each_awake), compiled once.
    #[inline(never)]
    fn each_awake(
        &mut self,
        workers: &Workers,
        work: usize,
        f: &(dyn Fn(usize, &mut Span<S>) + Sync),
    ) {
        if self.spans.iter().all(|span| !span.sleeps) {
            return workers.for_each(&mut self.spans, work, f);
        }
        let all = self.spans.len();
        let mut awake: Vec<_> =
            self.spans.iter_mut().enumerate().filter(|(_, span)| !span.sleeps).collect();
        let work = work * awake.len() / all;
        workers.for_each(&mut awake, work, |_, (index, span)| f(*index, span));
    }

    /// Number of elements.
    pub fn element_count(&self) -> usize {
        self.spans.iter().map(|s| s.elements.len()).sum()
    }

    /// Sum of the energies of all ranges (J).
    pub fn energy(&self) -> f64 {
        self.spans.iter().map(|s| s.energy).sum()
    }

    /// Adds the forces of all ranges to `total`, range by range for each row.
    pub fn add_forces_to(&self, workers: &Workers, total: &mut [[S; 4]]) {
        let work = self.spans.iter().map(|s| s.rows.len()).sum::<usize>() * 2;
        workers.for_chunks(total, ROW_CHUNK, work, |first, rows| {
            for span in &self.spans {
                let from = span.rows.start.max(first);
                let to = span.rows.end.min(first + rows.len());
                if from >= to || span.force.is_empty() {
                    continue;
                }
                let source = &span.force[from - span.rows.start..to - span.rows.start];
                for (t, f) in rows[from - first..to - first].iter_mut().zip(source) {
                    for k in 0..4 {
                        t[k] += f[k];
                    }
                }
            }
        });
    }

    /// Adds the tangent blocks of all ranges to `total`, range by range for each block; to zero instead of what is there, if
    /// that is `stale`.
    pub fn add_tangent_to(&self, workers: &Workers, total: &mut BlockMatrix<S>, stale: bool) {
        let work = self.spans.iter().map(|s| s.blocks.len()).sum::<usize>() * 6;
        let add = |first: usize, into: &mut [[S; 9]], range: &Range<usize>, from: &[[S; 9]]| {
            let low = range.start.max(first);
            let high = range.end.min(first + into.len());
            if low >= high || from.is_empty() {
                return;
            }
            let source = &from[low - range.start..high - range.start];
            for (t, m) in into[low - first..high - first].iter_mut().zip(source) {
                for k in 0..9 {
                    t[k] += m[k];
                }
            }
        };
        workers.for_chunks(&mut total.diagonal, ROW_CHUNK, work / 7, |first, rows| {
            if stale {
                rows.fill([S::ZERO; 9]);
            }
            self.spans.iter().for_each(|s| add(first, rows, &s.rows, &s.diagonal));
        });
        workers.for_chunks(&mut total.off_diagonal, ROW_CHUNK, work, |first, blocks| {
            if stale {
                blocks.fill([S::ZERO; 9]);
            }
            self.spans.iter().for_each(|s| add(first, blocks, &s.blocks, &s.off_diagonal));
        });
    }
}

/// Cuts the elements of a law, those with the component `mark`, into the ranges of its buffer.
pub type Partition<S> = fn(&mut World, mark: Option<ComponentId>, &mut LawBuffer<S>);

/// Place of a law in [`LawBuffers`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LawId(pub(crate) usize);

/// One active law.
pub(crate) struct Slot<S> {
    pub(crate) info: LawInfo,
    /// Its place in the sum.
    place: usize,
    /// Whether it is a law of dampers: a part of the viscous matrix and of nothing else.
    pub(crate) is_damper: bool,
    mark: Option<ComponentId>,
    partition: Partition<S>,
    /// Every law writes into its own buffer alone, so this lock never waits.
    pub(crate) buffer: Mutex<LawBuffer<S>>,
}

/// The buffers of all active laws, summed up in the order of the laws' places.
#[derive(Resource, Default)]
pub struct LawBuffers<S: Scalar> {
    pub(crate) slots: Vec<Slot<S>>,
    /// Slots by place.
    pub(crate) order: Vec<usize>,
    /// Number of evaluations so far.
    pub(crate) evaluations: u64,
    /// Bodies whose ranges are left out.
    pub(crate) asleep: SleepingBodies,
}

impl<S: Scalar> LawBuffers<S> {
    /// Adds an empty buffer, unless there is one of this name.
    pub(crate) fn insert(
        &mut self,
        info: LawInfo,
        place: usize,
        is_damper: bool,
        mark: Option<ComponentId>,
        partition: Partition<S>,
    ) -> Option<LawId> {
        if self.id(info.name).is_some() {
            return None;
        }
        let id = self.slots.len();
        let buffer = Mutex::default();
        self.slots.push(Slot { info, place, is_damper, mark, partition, buffer });
        self.order.push(id);
        self.order.sort_by_key(|&slot| self.slots[slot].place);
        Some(LawId(id))
    }

    /// Number of evaluations so far: who finds the number of its own last one knows that the buffers are as it left them.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Lets the ranges of these bodies keep energy and force of the last evaluation, and those of all others be evaluated
    /// again.
    pub fn put_to_sleep(&mut self, bodies: &SleepingBodies) {
        self.asleep.clone_from(bodies);
        for slot in self.slots.iter_mut().filter(|slot| !slot.is_damper) {
            let buffer = slot.buffer.get_mut().unwrap_or_else(PoisonError::into_inner);
            for span in &mut buffer.spans {
                span.sleeps = bodies.contains(span.body);
                if span.sleeps {
                    span.drop_tangent();
                }
            }
        }
    }

    /// Whether some law joins elements of several bodies.
    pub fn joins_bodies(&self, topology: &Topology) -> bool {
        self.slots.iter().any(|slot| {
            let buffer = slot.buffer.lock().unwrap_or_else(PoisonError::into_inner);
            buffer.spans.iter().any(|span| {
                let own = topology.bodies.get(span.body).map(|body| &body.vertices);
                own.is_none_or(|own| {
                    span.rows.start < own.start as usize || span.rows.end > own.end as usize
                })
            })
        })
    }

    /// The law of this name, if it is active.
    pub fn id(&self, name: &str) -> Option<LawId> {
        self.slots.iter().position(|slot| slot.info.name == name).map(LawId)
    }

    /// The buffer of a law.
    pub fn lock(&self, law: LawId) -> MutexGuard<'_, LawBuffer<S>> {
        // a panic elsewhere leaves numbers that the next evaluation writes anew
        self.slots[law.0].buffer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The buffer of the law of this name, if it is active.
    pub fn get(&self, name: &str) -> Option<MutexGuard<'_, LawBuffer<S>>> {
        self.id(name).map(|law| self.lock(law))
    }
}

/// Cuts the elements of every active law into its fixed ranges; to be called when rows have changed.
pub fn partition_laws<S: Scalar>(world: &mut World) {
    let mut buffers = take::<LawBuffers<S>>(world);
    for slot in &mut buffers.slots {
        let buffer = slot.buffer.get_mut().unwrap_or_else(PoisonError::into_inner);
        (slot.partition)(world, slot.mark, buffer);
    }
    put(world, buffers);
}

/// An empty range with the rows and blocks that its elements touch.
fn span<'a, S>(
    body: usize,
    elements: Range<usize>,
    topology: &Topology,
    vertices: &impl Fn(usize) -> &'a [u32],
) -> Span<S> {
    let (mut low, mut high) = (u32::MAX, 0);
    for i in elements.clone() {
        for &v in vertices(i) {
            low = low.min(v);
            high = high.max(v);
        }
    }
    let rows = low as usize..high as usize + 1;
    let blocks = topology.edge_start[rows.start] as usize..topology.edge_start[rows.end] as usize;
    Span {
        body,
        elements,
        rows,
        blocks,
        force: Vec::new(),
        diagonal: Vec::new(),
        off_diagonal: Vec::new(),
        edges: 0..0,
        tension: Vec::new(),
        energy: 0.0,
        clamped: 0,
        sleeps: false,
    }
}

const ROW_CHUNK: usize = 2048;
