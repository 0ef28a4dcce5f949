//! How a patch that is pulled gives way, at rest in time: what a haptic device feels between two steps.
//!
//! A pull has springs of stiffness `k w_a` from the vertices `a` of its patch to a hand, `sum w_a = 1`. With the hand at
//! `x` the tissue is at rest where `K' u = k P x + f`, `K' = K + k diag(w)` being the tangent with these springs and
//! `P = w (x) I`. So the patch, `p = P^T u`, follows a motion of the hand by
//!
//! `dp/dx = G = P^T K'^-1 P k`.
//!
//! A hand that turns, too, moves the end of a spring by `D_a (dx, dt) = dx + dt x r_a`, `dt` being its turn (rad) about a centre
//! and `r_a` the arm from there. Then `P = sum_a w_a e_a (x) D_a` has six columns, and force `F` (N) and torque `M` (N m) on the
//! hand change by
//!
//! `d(F, M) = -(k sum_a w_a D_a^T D_a - k P^T K'^-1 P k) (dx, dt) + (0, sum_a (dt x r_a) x F_a)`,
//!
//! the last of it because the forces `F_a` of the springs go on with their arms.
//!
//! A tool on a spring `K` ([`Tool::spring`](sinew_contact::tool::Tool::spring)) has the tangents `H_i` of its points in place of springs: with
//! `P k = sum_i B_i^T H_i`, `B_i` being the shares of a point, the tool feels `S = sum_i H_i - (P k)^T K'^-1 P k`, follows the
//! hand by `G = (K + S)^-1 K`, and the hand feels `K (1 - G)`.
//!
//! A solve for each direction gives the columns `U` of `K'^-1 P k` up to residuals `R = P k - K' U`. `k G = U^T (P k + R)` is
//! then off by `R^T K'^-1 R` alone, the square of what the columns are off by, so that loose solves are good enough.

use crate::cg::CgStatus;
use crate::linear_solver::LinearSolver;
use crate::settings::{LinearOptions, SolverSettings};
use crate::state::{NodeState, Rows, dot3, read_rest, vector};
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
    /// Force (N) and torque (N m) on the hand over its motion (m) and turn (rad), with a minus: rows, then columns. Without a turn
    /// nothing but the first is not zero, `k (1 - G)`.
    pub stiffness: [[DMat3; 2]; 2],
    /// `sum_a w_a (r_a^2 I - r_a r_a^T)` (m^2) of the arms of a hand that turns: torque over stiffness and turn of a patch that is held, before
    /// forces act.
    pub arms: DMat3,
    /// Nothing holds the body against rigid motions, so that it has no place of rest: the gain is that of one step from rest,
    /// with `K + M / h^2` in place of `K`.
    pub with_inertia: bool,
    /// The tangent had negative curvature; the gain is that of the projected one.
    pub projected: bool,
    /// The linear systems were solved. Without that the gain is the last one that was found, or zero.
    pub solved: bool,
    /// Iterations of conjugate gradients, of all three systems, or six.
    pub iterations: u32,
}

/// Part of the residual to which systems are solved that begin from nothing: what is left of those is in soft directions, where it counts
/// most. Without, models just after a cut were up to 1.6 % off.
const COLD: f64 = 0.3;

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
    ways: Vec<Rows<S>>,
    /// Rows that they are of, and their number.
    of: Option<(Range<usize>, usize)>,
    /// They are nothing yet, as at first and after a cut.
    is_cold: bool,
    products: Vec<Rows<S>>,
    /// What was found last, if anything was.
    last: PatchCompliance,
    is_known: bool,
}

/// What the hand holds, or the tool in it.
#[derive(Clone, Copy, Debug)]
pub enum Held<'a> {
    /// The patch of a pull; the hand turns, or does not.
    Patch(&'a Pull, bool),
    /// A tool by its entity, on a spring of that stiffness (N/m).
    Tool(Entity, f64),
}

/// Forces on rows of the world (N/m, N/rad) for each direction of the hand or tool, and what they have back of it, were the tissue held.
struct Ends {
    forces: Vec<Vec<(usize, DVec3)>>,
    springs: Pairs,
    arms: DMat3,
}

/// Sums over pairs of directions.
type Pairs = [[f64; 6]; 6];

impl<S: Scalar> PatchSolver<S> {
    /// The compliance at the end of the last step, in which what is held acted on bodies of `group`. `tolerance` is the relative
    /// residual of the linear systems.
    ///
    /// The tangent is evaluated at that state, so that any integrator may have led there; forces and energies stay those
    /// that the step left.
    pub fn find(
        &mut self,
        world: &mut World,
        held: Held,
        group: &Range<usize>,
        tolerance: f64,
    ) -> PatchCompliance {
        self.read(world);
        let (ends, stiffness) = match held {
            Held::Patch(pull, turns) => (self.ends_of_patch(pull, turns), pull.stiffness),
            Held::Tool(tool, stiffness) => (ends_of_tool(world, tool), stiffness),
        };
        let of = |found: &PatchCompliance, work: &Pairs| match held {
            Held::Patch(..) => found.of_patch(&ends, work, stiffness),
            Held::Tool(..) => found.of_tool(&ends, work, stiffness),
        };
        let blocks = world.get_resource::<ContactSet>().map(|contact| match held {
            Held::Patch(..) => contact.blocks(group),
            Held::Tool(tool, _) => contact.blocks_with_held(group, tool),
        });
        let rows = ranges(world.resource::<Topology>(), group).0;
        let forces = self.forces(&ends, &rows);
        let with_inertia = !self.is_supported(world, group);
        if self.of != Some((rows.clone(), forces.len())) {
            self.of = Some((rows.clone(), forces.len()));
            self.ways = vec![vec![[S::ZERO; 4]; rows.len()]; forces.len()];
            self.is_cold = true;
        }
        let mut found = PatchCompliance { with_inertia, solved: false, ..self.last };
        (found.projected, found.iterations) = (false, 0);
        if !self.is_known {
            // as if the tissue were held, until a model is found
            let held = of(&found, &Pairs::default());
            found = PatchCompliance { with_inertia, solved: false, ..held };
        }
        for kind in [TangentKind::Exact, TangentKind::Projected] {
            world.insert_resource(EvaluationRequest {
                tangent: Some(kind),
                ..EvaluationRequest::default()
            });
            world.run_schedule(ForceSchedule);
            found.projected = kind == TangentKind::Projected;
            let part = match held {
                // a small difference of what contact and tissue take, and what touches is never quite what did before
                Held::Tool(..) => {
                    let firm = [0, 1, 2].map(|i| ends.springs[i][i]).into_iter().sum::<f64>() / 3.0;
                    let firm = firm.max(0.0);
                    COLD * (stiffness / (stiffness + firm)).sqrt()
                }
                Held::Patch(..) if self.is_cold => COLD,
                Held::Patch(..) => 1.0,
            };
            let matrix = (blocks.as_ref(), with_inertia, part * tolerance);
            match self.solve(world, group, &forces, matrix, &mut found.iterations) {
                Ok(work) => {
                    let new = of(&found, &work);
                    found = if new.solved { new } else { found };
                    break;
                }
                Err(CgStatus::Indefinite) => {
                    self.ways.iter_mut().for_each(|way| way.fill([S::ZERO; 4]));
                    self.is_cold = true;
                }
                Err(_) => break,
            }
        }
        if found.solved {
            (self.last, self.is_known, self.is_cold) = (found, true, false);
        } else {
            self.is_cold = true;
            self.ways.iter_mut().for_each(|way| way.fill([S::ZERO; 4]));
        }
        found
    }

    /// Forgets the last solutions: what is held is another thing, or nothing was.
    pub fn forget(&mut self) {
        (self.of, self.is_known, self.last) = (None, false, PatchCompliance::default());
    }

    /// Reads columns, and what follows from the layout where it is new.
    fn read(&mut self, world: &mut World) {
        self.node.read(world);
        let revision = world.resource::<Topology>().revision;
        if self.revision != Some(revision) {
            read_rest(world, &mut self.rest);
            self.of = None;
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

    /// The springs of a pull to a hand that turns or does not.
    fn ends_of_patch(&self, pull: &Pull, turns: bool) -> Ends {
        let sum: f64 = pull.weights.iter().sum();
        let centre = pull.moved_centre();
        let directions = if turns { 6 } else { 3 };
        let mut ends = Ends {
            forces: vec![Vec::new(); directions],
            springs: Pairs::default(),
            arms: DMat3::ZERO,
        };
        for ((row, weight), arm) in pull.rows.iter().zip(&pull.weights).zip(pull.arms()) {
            let stiffness = pull.stiffness * weight / sum;
            let place = self.rest[row.index()] + vector(&self.node.u[row.index()]);
            // on the hand
            let force = stiffness * (place - (centre + arm));
            let ways = ways(arm);
            for i in 0..directions {
                ends.forces[i].push((row.index(), stiffness * ways[i]));
                for j in 0..directions {
                    ends.springs[i][j] += stiffness * ways[i].dot(ways[j]);
                    if i >= 3 && j >= 3 {
                        ends.springs[i][j] -= ways[j].cross(force)[i - 3];
                    }
                }
            }
            if turns {
                let outer = DMat3::from_cols(arm.x * arm, arm.y * arm, arm.z * arm);
                let square = DMat3::from_diagonal(DVec3::splat(arm.length_squared()));
                ends.arms += weight / sum * (square - outer);
            }
        }
        ends
    }

    /// Forces on the rows of the group (N/m, N/rad) for a motion of the hand along each direction, were these held.
    fn forces(&self, ends: &Ends, rows: &Range<usize>) -> Vec<Rows<S>> {
        let of = |own: &Vec<(usize, DVec3)>| {
            let mut forces = vec![[S::ZERO; 4]; rows.len()];
            for &(row, force) in own.iter().filter(|(row, _)| rows.contains(row)) {
                for k in self.node.free_axes(row) {
                    forces[row - rows.start][k] += S::from_f64(force[k]);
                }
            }
            forces
        };
        ends.forces.iter().map(of).collect()
    }

    /// `(P k)^T K'^-1 P k` (N/m, N/rad, N m/rad), symmetric.
    fn solve(
        &mut self,
        world: &World,
        group: &Range<usize>,
        forces: &[Rows<S>],
        (contact, with_inertia, tolerance): (Option<&ContactBlocks>, bool, f64),
        iterations: &mut u32,
    ) -> Result<Pairs, CgStatus> {
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
        let mut work = Pairs::default();
        products.resize(forces.len(), Vec::new());
        for ((b, x), product) in forces.iter().zip(ways.iter_mut()).zip(products.iter_mut()) {
            // however near the start is
            options.reference = b.iter().map(|b| dot3(b, b)).sum::<f64>().sqrt();
            let outcome = linear.solve(&system, rest, group.clone(), b, x, &options);
            *iterations += outcome.iterations;
            if !matches!(outcome.status, CgStatus::Converged) {
                return Err(outcome.status);
            }
            options.same_matrix = true;
            product.resize(b.len(), [S::ZERO; 4]);
            linear.multiply_solution(&system, group.clone(), b, x, product);
        }
        for (j, (b, y)) in forces.iter().zip(&*products).enumerate() {
            for (i, x) in ways.iter().enumerate() {
                // b + r = 2 b - K' x
                let parts = x.iter().zip(b).zip(y);
                let sum: f64 = parts.map(|((x, b), y)| 2.0 * dot3(x, b) - dot3(x, y)).sum();
                // the mean, since residuals leave it unsymmetric
                work[i][j] += 0.5 * sum;
                work[j][i] += 0.5 * sum;
            }
        }
        let is_negative = (0..6).any(|i| work[i][i] < 0.0);
        if is_negative { Err(CgStatus::Indefinite) } else { Ok(work) }
    }
}

/// How the end of a spring at the hand moves along with each direction of the hand: motions (m/m), then turns (m/rad).
fn ways(arm: DVec3) -> [DVec3; 6] {
    let [x, y, z] = DVec3::AXES;
    let [a, b, c] = DVec3::AXES.map(|axis| axis.cross(arm));
    [x, y, z, a, b, c]
}

/// The points that touch a tool, which moves.
fn ends_of_tool(world: &mut World, tool: Entity) -> Ends {
    let mut ends =
        Ends { forces: vec![Vec::new(); 3], springs: Pairs::default(), arms: DMat3::ZERO };
    let Some(mut contact) = world.get_resource_mut::<ContactSet>() else { return ends };
    let Some(index) = contact.with_exact_tangents(tool) else { return ends };
    for (axis, way) in DVec3::AXES.into_iter().enumerate() {
        let mut all = DVec3::ZERO;
        contact.for_motion(index, way, |row, force| ends.forces[axis].push((row, force)));
        contact.for_motion(index, way, |_, force| all += force);
        for i in 0..3 {
            ends.springs[i][axis] = all[i];
        }
    }
    ends
}

impl PatchCompliance {
    /// Of a tool that touches nothing.
    pub fn free() -> Self {
        Self {
            gain: DMat3::IDENTITY,
            stiffness: [[DMat3::ZERO; 2]; 2],
            arms: DMat3::ZERO,
            solved: true,
            ..Self::default()
        }
    }

    /// With what the springs do over the motions of the hand, of which the tissue gives back `work`.
    fn of_patch(&self, ends: &Ends, work: &Pairs, stiffness: f64) -> Self {
        let left = |i: usize, j: usize| ends.springs[i][j] - work[i][j];
        let gain = block(|i, j| work[i][j], [0, 0]) * (1.0 / stiffness);
        let of_all = [0, 1].map(|i| [0, 1].map(|j| block(left, [i, j])));
        self.found(gain, of_all, ends.arms)
    }

    /// The same of a tool between tissue and hand.
    fn of_tool(&self, ends: &Ends, work: &Pairs, stiffness: f64) -> Self {
        let felt = block(|i, j| ends.springs[i][j] - work[i][j], [0, 0]);
        let spring = DMat3::from_diagonal(DVec3::splat(stiffness));
        let gain = (spring + felt).inverse() * stiffness;
        let mut of_all = [[DMat3::ZERO; 2]; 2];
        of_all[0][0] = (DMat3::IDENTITY - gain) * stiffness;
        self.found(gain, of_all, DMat3::ZERO)
    }

    fn found(&self, gain: DMat3, stiffness: [[DMat3; 2]; 2], arms: DMat3) -> Self {
        let blocks = stiffness.as_flattened();
        let solved = gain.is_finite() && blocks.iter().all(|block| block.is_finite());
        Self { gain, stiffness, arms, solved, ..*self }
    }
}

/// A block of three rows and three columns.
fn block(of: impl Fn(usize, usize) -> f64, [i, j]: [usize; 2]) -> DMat3 {
    let column = |c: usize| DVec3::from_array([0, 1, 2].map(|r| of(3 * i + r, 3 * j + c)));
    DMat3::from_cols(column(0), column(1), column(2))
}
