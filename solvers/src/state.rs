//! Dense copies of the vertex columns for the integrators, and the one way in which they ask for
//! energies, forces and tangents.

use bevy_ecs::prelude::*;
use bytemuck::Pod;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::kept::with_query;
use sinew_engine::law::{ElasticEnergy, EvaluationRequest, TangentKind, ViscousRequest};
use sinew_engine::report::StepReport;
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{ForceSchedule, evaluate_dampers, evaluate_viscous, has_dampers};
use sinew_engine::vertex::{
    Displacement, ElasticForce, ExternalForce, FixedAxes, Mass, PrescribedDisplacement,
    RestPosition, Velocity,
};
use std::ops::Range;

/// A padded vector per vertex row.
pub type Rows<S> = Vec<[S; 4]>;

/// The columns of [`NodeState`].
type Columns<S> = (
    &'static Displacement<S>,
    &'static Velocity<S>,
    &'static ExternalForce<S>,
    &'static PrescribedDisplacement<S>,
    &'static Mass<S>,
    &'static FixedAxes,
);

/// What an integrator reads at the start of a step.
#[derive(Clone, Debug, Default)]
pub struct NodeState<S> {
    /// Displacements (m).
    pub u: Rows<S>,
    /// Velocities (m/s).
    pub v: Rows<S>,
    /// External forces (N) at the end of the step.
    pub external: Rows<S>,
    /// Displacements (m) of held axes at the end of the step.
    pub prescribed: Rows<S>,
    /// Masses (kg).
    pub mass: Vec<S>,
    /// Held axes.
    pub fixed: Vec<FixedAxes>,
}

impl<S: Scalar> NodeState<S> {
    /// Copies the columns.
    pub fn read(&mut self, world: &mut World) {
        with_query(world, |world, query| self.read_columns(world, query));
    }

    fn read_columns(&mut self, world: &World, query: &mut QueryState<Columns<S>>) {
        self.u.clear();
        self.v.clear();
        self.external.clear();
        self.prescribed.clear();
        self.mass.clear();
        self.fixed.clear();
        if let Some((u, v, external, prescribed, mass, fixed)) =
            single_table(query.contiguous_iter(world))
        {
            self.u.extend(u.iter().map(|x| x.0));
            self.v.extend(v.iter().map(|x| x.0));
            self.external.extend(external.iter().map(|x| x.0));
            self.prescribed.extend(prescribed.iter().map(|x| x.0));
            self.mass.extend(mass.iter().map(|x| x.0));
            self.fixed.extend_from_slice(fixed);
        }
    }

    /// Forgets velocities and prescribed places that are zero in all rows, as those of bodies at rest are.
    pub fn leave_out_zeros(&mut self) {
        for column in [&mut self.v, &mut self.prescribed] {
            if is_zero(column) {
                *column = Vec::new();
            }
        }
    }

    /// Whether the columns are what they were when they were read, to the bit. What [is left out](Self::leave_out_zeros) was zero.
    pub fn is_as_in(&self, world: &mut World) -> bool {
        with_query::<Columns<S>, (), _>(world, |world, query| {
            let columns = single_table(query.contiguous_iter(world));
            let same = columns.map(|(u, v, external, prescribed, mass, fixed)| {
                same_bits(u, &self.u)
                    && same_or_zero(v, &self.v)
                    && same_bits(external, &self.external)
                    && same_or_zero(prescribed, &self.prescribed)
                    && same_bits(mass, &self.mass)
                    && fixed == self.fixed
            });
            same.unwrap_or_else(|| self.is_empty())
        })
    }

    /// Number of vertex rows.
    pub fn len(&self) -> usize {
        self.u.len()
    }

    /// Whether there are no vertices.
    pub fn is_empty(&self) -> bool {
        self.u.is_empty()
    }

    /// Whether an unknown is free.
    #[inline(always)]
    pub fn free(&self, row: usize, axis: usize) -> bool {
        !self.fixed[row].holds(axis)
    }

    /// Free axes of a row.
    #[inline(always)]
    pub fn free_axes(&self, row: usize) -> impl Iterator<Item = usize> + use<S> {
        let fixed = self.fixed[row];
        (0..3).filter(move |&axis| !fixed.holds(axis))
    }

    /// Held axes of a row.
    #[inline(always)]
    pub fn held_axes(&self, row: usize) -> impl Iterator<Item = usize> + use<S> {
        let fixed = self.fixed[row];
        (0..3).filter(move |&axis| fixed.holds(axis))
    }

    /// Kinetic energy (J) at velocities `v` of the free and of the held unknowns among `rows`.
    pub fn kinetic_energy(&self, rows: Range<usize>, v: &[[S; 4]]) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for row in rows {
            let half_mass = 0.5 * self.mass[row].to_f64();
            if self.fixed[row].0 == 0 {
                sum[0] += half_mass * dot3(&v[row], &v[row]);
                continue;
            }
            for k in 0..3 {
                let speed = v[row][k].to_f64();
                sum[usize::from(!self.free(row, k))] += half_mass * speed * speed;
            }
        }
        sum
    }

    /// Work (J) of the external forces on `rows` along displacements `u` from rest.
    pub fn load_potential(&self, rows: Range<usize>, u: &[[S; 4]]) -> f64 {
        self.external[rows.clone()].iter().zip(&u[rows]).map(|(f, u)| dot3(f, u)).sum()
    }
}

/// Whether two columns are the same to the bit.
pub fn same_bits<A: Pod, B: Pod>(a: &[A], b: &[B]) -> bool {
    bytemuck::cast_slice::<A, u8>(a) == bytemuck::cast_slice::<B, u8>(b)
}

/// The same, where no values stand for zeros.
fn same_or_zero<A: Pod, B: Pod>(a: &[A], b: &[B]) -> bool {
    if b.is_empty() { is_zero(a) } else { same_bits(a, b) }
}

/// Whether all rows of a column are zero, to the bit.
fn is_zero<A: Pod>(rows: &[A]) -> bool {
    let parts = bytemuck::cast_slice::<A, [u8; 16]>(rows);
    parts.iter().fold(0, |any, part| any | u128::from_ne_bytes(*part)) == 0
}

/// Scalar product of two padded rows in `f64`, first three entries.
#[inline(always)]
pub fn dot3<S: Scalar>(a: &[S; 4], b: &[S; 4]) -> f64 {
    a[0].to_f64() * b[0].to_f64() + a[1].to_f64() * b[1].to_f64() + a[2].to_f64() * b[2].to_f64()
}

/// The first three entries of a row.
pub fn vector<S: Scalar>(x: &[S; 4]) -> DVec3 {
    DVec3::new(x[0].to_f64(), x[1].to_f64(), x[2].to_f64())
}

/// Positions (m) of vertex rows at displacements `u`.
pub fn position<S: Scalar>(rest: &[DVec3], u: &[[S; 4]]) -> impl Fn(VertexRow) -> DVec3 {
    move |row| {
        let (x, u) = (rest[row.index()], &u[row.index()]);
        x + DVec3::new(u[0].to_f64(), u[1].to_f64(), u[2].to_f64())
    }
}

/// Momentum (kg m/s) and angular momentum about the origin (kg m^2/s) of displacements `u` and
/// velocities `v`.
pub fn book_momentum<S: Scalar>(
    report: &mut StepReport,
    rest: &[DVec3],
    mass: &[S],
    u: &[[S; 4]],
    v: &[[S; 4]],
) {
    let vector = |x: &[S; 4]| DVec3::new(x[0].to_f64(), x[1].to_f64(), x[2].to_f64());
    let (mut linear, mut angular) = (DVec3::ZERO, DVec3::ZERO);
    for (((x, m), u), v) in rest.iter().zip(mass).zip(u).zip(v) {
        let p = m.to_f64() * vector(v);
        linear += p;
        angular += (*x + vector(u)).cross(p);
    }
    (report.momentum, report.angular_momentum) = (linear.to_array(), angular.to_array());
}

/// Rest positions (m) of all rows.
pub fn read_rest(world: &mut World, rest: &mut Vec<DVec3>) {
    rest.clear();
    with_query::<&RestPosition, (), _>(world, |world, query| {
        if let Some(column) = single_table(query.contiguous_iter(world)) {
            rest.extend(column.iter().map(|x| x.0));
        }
    });
}

/// Writes displacements.
pub fn write_displacement<S: Scalar>(world: &mut World, u: &[[S; 4]]) {
    with_query::<&mut Displacement<S>, (), _>(world, |world, query| {
        if let Some(mut column) = single_table(query.contiguous_iter_mut(world)) {
            let column = column.bypass_change_detection();
            for (x, u) in column.iter_mut().zip(u) {
                x.0 = *u;
            }
        }
    });
}

/// Writes displacements and velocities.
pub fn write_state<S: Scalar>(world: &mut World, u: &[[S; 4]], v: &[[S; 4]]) {
    write_displacement(world, u);
    with_query::<&mut Velocity<S>, (), _>(world, |world, query| {
        if let Some(mut column) = single_table(query.contiguous_iter_mut(world)) {
            let column = column.bypass_change_detection();
            for (x, v) in column.iter_mut().zip(v) {
                x.0 = *v;
            }
        }
    });
}

/// Copies the elastic forces of the last evaluation.
pub fn read_force<S: Scalar>(world: &mut World, force: &mut Rows<S>) {
    force.clear();
    with_query::<&ElasticForce<S>, (), _>(world, |world, query| {
        if let Some(column) = single_table(query.contiguous_iter(world)) {
            force.extend(column.iter().map(|f| f.0));
        }
    });
}

/// Evaluates at the displacements `u` and returns the elastic energy (J; 0 when not asked for).
pub fn evaluate<S: Scalar>(
    world: &mut World,
    u: &[[S; 4]],
    energy: bool,
    force: bool,
    tangent: Option<TangentKind>,
) -> f64 {
    write_displacement(world, u);
    world.insert_resource(EvaluationRequest { energy, force, tangent });
    world.run_schedule(ForceSchedule);
    if energy { world.resource::<ElasticEnergy>().total } else { 0.0 }
}

/// The largest rate (1/s) at which dampers slow free unknowns down is at most this, 0 without dampers: the largest
/// row sum of the viscous matrix over the masses, which no displacement changes.
pub fn viscous_rate<S: Scalar>(world: &mut World, node: &NodeState<S>) -> f64 {
    if !has_dampers(world) {
        return 0.0;
    }
    let mut bound = Rows::<S>::default();
    evaluate_viscous(world, &ViscousRequest::Bound, &mut bound);
    let free = |row: usize| (0..3).any(|k| node.free(row, k)) && node.mass[row] > S::ZERO;
    let rate = |row: usize| (bound[row][0] / node.mass[row]).to_f64();
    (0..node.len()).filter(|&row| free(row)).map(rate).fold(0.0, f64::max)
}

/// Leaves the viscous matrix (N s/m) of all dampers at the displacements `u` in the world's tangent; false,
/// and nothing changed, where there are none.
pub fn evaluate_damping<S: Scalar>(world: &mut World, u: &[[S; 4]]) -> bool {
    if !has_dampers(world) {
        return false;
    }
    write_displacement(world, u);
    evaluate_dampers::<S>(world);
    true
}
