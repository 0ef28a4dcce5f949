//! How a patch that is pulled gives way, at rest in time: what a haptic device feels between two steps.
//!
//! A pull has springs of stiffness `k w_a` from the vertices `a` of its patch to a hand, `sum w_a = 1`. With the hand at
//! `x` the tissue is at rest where `K' u = k P x + f`, `K' = K + k diag(w)` being the tangent with these springs and
//! `P = w (x) I`. So the patch, `p = P^T u`, follows a motion of the hand by
//!
//! `dp/dx = G = P^T K'^-1 P k`.
//!
//! Three solves give the columns `U` of `K'^-1 P k` up to residuals `R = P k - K' U`. `k G = U^T (P k + R)` is then off by
//! `R^T K'^-1 R` alone, the square of what the columns are off by, so that loose solves are good enough.

use crate::cg::CgStatus;
use crate::linear_solver::LinearSolver;
use crate::settings::{LinearOptions, SolverSettings};
use crate::state::{NodeState, Rows, dot3, read_rest};
use crate::support::is_supported;
use crate::system::{ShiftedTangent, ranges};
use bevy_ecs::prelude::*;
use glam::{DMat3, DVec3};
use sinew_contact::pull::Pull;
use sinew_contact::set::{ContactBlocks, ContactSet};
use sinew_engine::law::{EvaluationRequest, TangentKind};
use sinew_engine::layout::UNUSED;
use sinew_engine::matrix::Tangent;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::ForceSchedule;
use sinew_engine::step::StepClock;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;
use std::ops::Range;

/// How the patch of a pull follows the hand, and how that was found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PatchCompliance {
    /// `dp/dx`: motion of the weighted mean of the patch over that of the hand.
    pub gain: DMat3,
    /// Nothing holds the body against rigid motions, so that it has no place of rest: the gain is that of one step from rest,
    /// with `K + M / h^2` in place of `K`.
    pub with_inertia: bool,
    /// The tangent had negative curvature; the gain is that of the projected one.
    pub projected: bool,
    /// The linear systems were solved. Without that the gain is the last one that was found, or zero.
    pub solved: bool,
    /// Iterations of conjugate gradients, of all three systems.
    pub iterations: u32,
}

/// Finds the compliance of one pull step after step. It has a preconditioner of its own, since that of the steps belongs to
/// another matrix, and since nobody who feels at a simulation is to change it.
#[derive(Clone, Debug, Default)]
pub struct PatchSolver<S: Scalar> {
    linear: LinearSolver<S>,
    node: NodeState<S>,
    rest: Vec<DVec3>,
    /// Layout that `rest` and `ways` belong to.
    revision: Option<u64>,
    /// Held axes, and whether they support the bodies.
    supported: Option<(Vec<FixedAxes>, bool)>,
    /// The last solutions (m/m) and the forces (N/m) that they take, of the rows of the group.
    ways: [Rows<S>; 3],
    products: [Rows<S>; 3],
    last: DMat3,
}

impl<S: Scalar> PatchSolver<S> {
    /// The compliance at the end of the last step, in which `pull` acted on bodies of `group`. `tolerance` is the relative
    /// residual of the linear systems.
    ///
    /// The tangent is evaluated at that state, so that any integrator may have led there; forces and energies stay those
    /// that the step left.
    pub fn find(
        &mut self,
        world: &mut World,
        pull: &Pull,
        group: &Range<usize>,
        tolerance: f64,
    ) -> PatchCompliance {
        self.read(world);
        let blocks = world.get_resource::<ContactSet>().map(|contact| contact.blocks(group));
        let rows = ranges(world.resource::<Topology>(), group).0;
        let forces = self.forces(pull, &rows);
        let with_inertia = !self.is_supported(world, group);
        for way in &mut self.ways {
            way.resize(rows.len(), [S::ZERO; 4]);
        }
        let mut found = PatchCompliance { gain: self.last, with_inertia, ..Default::default() };
        for kind in [TangentKind::Exact, TangentKind::Projected] {
            world.insert_resource(EvaluationRequest {
                tangent: Some(kind),
                ..EvaluationRequest::default()
            });
            world.run_schedule(ForceSchedule);
            found.projected = kind == TangentKind::Projected;
            let matrix = (blocks.as_ref(), with_inertia, tolerance);
            match self.solve(world, group, &forces, matrix, &mut found.iterations) {
                Ok(work) => {
                    // `work` is k G
                    found.gain = work * (1.0 / pull.stiffness);
                    found.solved = found.gain.is_finite();
                    break;
                }
                Err(CgStatus::Indefinite) => {
                    self.ways.iter_mut().for_each(|way| way.fill([S::ZERO; 4]))
                }
                Err(_) => break,
            }
        }
        if found.solved {
            self.last = found.gain;
        } else {
            found.gain = self.last;
            self.ways.iter_mut().for_each(|way| way.fill([S::ZERO; 4]));
        }
        found
    }

    /// Reads columns, and what follows from the layout where it is new.
    fn read(&mut self, world: &mut World) {
        self.node.read(world);
        let revision = world.resource::<Topology>().revision;
        if self.revision != Some(revision) {
            read_rest(world, &mut self.rest);
            self.ways.iter_mut().for_each(Vec::clear);
            (self.revision, self.supported) = (Some(revision), None);
        }
        // nothing but their inertia holds vertices without elements
        for body in &world.resource::<Topology>().bodies {
            for (local, _) in body.piece.iter().enumerate().filter(|(_, piece)| **piece == UNUSED) {
                self.node.fixed[body.vertices.start as usize + local] = FixedAxes::ALL;
            }
        }
    }

    fn is_supported(&mut self, world: &mut World, group: &Range<usize>) -> bool {
        match &self.supported {
            Some((fixed, known)) if *fixed == self.node.fixed => *known,
            _ => {
                let found = is_supported(world, &self.node, group);
                self.supported = Some((self.node.fixed.clone(), found));
                found
            }
        }
    }

    /// `P k` (N/m): forces on the rows of the group for a motion of the hand along each axis.
    fn forces(&self, pull: &Pull, rows: &Range<usize>) -> [Rows<S>; 3] {
        let sum: f64 = pull.weights.iter().sum();
        let mut forces = [(); 3].map(|()| vec![[S::ZERO; 4]; rows.len()]);
        for (row, weight) in pull.rows.iter().zip(&pull.weights) {
            let own = row.index() - rows.start;
            for k in self.node.free_axes(row.index()) {
                forces[k][own][k] += S::from_f64(pull.stiffness * weight / sum);
            }
        }
        forces
    }

    /// `k G` (N/m), symmetric.
    fn solve(
        &mut self,
        world: &World,
        group: &Range<usize>,
        forces: &[Rows<S>; 3],
        (contact, with_inertia, tolerance): (Option<&ContactBlocks>, bool, f64),
        iterations: &mut u32,
    ) -> Result<DMat3, CgStatus> {
        let Self { linear, node, rest, ways, products, .. } = self;
        let dt = world.resource::<StepClock>().dt;
        let tangent = world.resource::<Tangent<S>>();
        let system = ShiftedTangent {
            topology: world.resource(),
            workers: world.resource(),
            mass: &node.mass,
            mass_factor: if with_inertia { S::from_f64(1.0 / (dt * dt)) } else { S::ZERO },
            tangent: &tangent.matrix,
            low_rank: &tangent.low_rank,
            tangent_factor: S::ONE,
            damping: None,
            fixed: &node.fixed,
            contact,
        };
        let settings = world.resource::<SolverSettings>();
        let mut options = LinearOptions { tolerance, ..settings.linear_options() };
        let mut work = DMat3::ZERO;
        for axis in 0..3 {
            let (b, x) = (&forces[axis], &mut ways[axis]);
            // however near the start is
            options.reference = b.iter().map(|b| dot3(b, b)).sum::<f64>().sqrt();
            let outcome = linear.solve(&system, rest, group.clone(), b, x, &options);
            *iterations += outcome.iterations;
            if !matches!(outcome.status, CgStatus::Converged) {
                return Err(outcome.status);
            }
            options.same_matrix = true;
            let product = &mut products[axis];
            product.resize(b.len(), [S::ZERO; 4]);
            linear.multiply_solution(&system, group.clone(), b, x, product);
        }
        for j in 0..3 {
            for i in 0..3 {
                // b + r = 2 b - K' x
                let parts = ways[i].iter().zip(&forces[j]).zip(&products[j]);
                let sum: f64 = parts.map(|((x, b), y)| 2.0 * dot3(x, b) - dot3(x, y)).sum();
                work.col_mut(j)[i] = sum;
            }
        }
        // what the residuals leave unsymmetric
        let symmetric = (work + work.transpose()) * 0.5;
        let negative = DVec3::AXES.iter().any(|axis| axis.dot(symmetric * *axis) < 0.0);
        if negative { Err(CgStatus::Indefinite) } else { Ok(symmetric) }
    }
}
