//! The safe step on the device: implicit Euler with one linear system, line search and energy cap. Twin of
//! `sinew_solvers::implicit` with `Integrator::Safe`; the same formulas, tests and constants.
//!
//! The host decides between the parts and sees only sums: nothing of the size of the body crosses but the new
//! state, where it is asked for, once. A smooth step waits for the device three times: for conjugate gradients, for
//! the line search, for the end.

use sinew_engine::law::TangentKind;
use sinew_engine::report::StepReport;
use sinew_solvers::settings::{Preconditioner, SolverSettings};

use crate::body::{CgState, DeviceBody, Slot, StepUniform, kind_number, total};
use crate::coarse::{self, Coarse, Kept};
use crate::context::{Context, Pending, Recorder, groups_for};
use crate::elements::Energies;
use crate::error::GpuError;
use crate::report::{GpuReport, Phase};

/// Armijo constant, as on the CPU.
const ARMIJO: f64 = 1e-4;
/// Most halvings of the line search, as on the CPU.
const MAX_HALVINGS: u32 = 30;
/// Relative size below which differences of energies are rounding, as on the CPU in `f32`.
const NOISE: f64 = 450.0 * f32::EPSILON as f64;
/// Iterations of conjugate gradients submitted before anything is known of a body.
const FIRST_BATCH: u32 = 32;
/// Most iterations in one submission.
const MAX_BATCH: u32 = 512;

/// Phases of conjugate gradients, as in cg.wgsl.
mod phase {
    pub const ITERATING: u32 = 0;
    pub const CLAIMED: u32 = 1;
    pub const CONVERGED: u32 = 2;
    pub const CAPPED: u32 = 3;
    pub const NOT_FINITE: u32 = 5;
    pub const STALLED: u32 = 6;
    pub const UNUSABLE: u32 = 7;
}

/// What the host knows of a body at the start of a step.
#[derive(Clone, Debug)]
pub(crate) struct BodyInput {
    /// Elements are inverted.
    pub inverted: bool,
    /// Held unknowns have a way to go.
    pub moves: bool,
    /// Pieces without held unknowns and their masses (kg).
    pub free_pieces: Vec<(u32, f64)>,
    /// Longest side (m).
    pub size: f64,
    /// Iterations that the last linear system took.
    pub iterations: u32,
    /// The new state is wanted on the host.
    pub read_back: bool,
    /// Volume ratios are wanted.
    pub volumes: bool,
}

/// The end of a step, not yet accepted.
#[derive(Clone, Debug, Default)]
pub(crate) struct BodyOutput {
    /// Displacements (m) and velocities (m/s), where they were asked for.
    pub u: Vec<[f32; 4]>,
    pub v: Vec<[f32; 4]>,
    /// Smallest volume ratio and inverted elements, where they were asked for.
    pub volumes: Option<(f64, u64)>,
    pub iterations: u32,
    /// The new state, or something on the way, is not finite.
    pub finite: bool,
}

/// One body's step.
pub(crate) struct SafeStep<'a> {
    pub context: &'a Context,
    pub body: &'a DeviceBody,
    pub settings: &'a SolverSettings,
    /// What it stands for in this body.
    pub preconditioner: Preconditioner,
    pub dt: f64,
}

/// How a linear solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Solve {
    Solved,
    Indefinite,
    NotFinite,
}

/// Sums of a measurement of the line search.
struct Search {
    linear: f64,
    quadratic: f64,
    slope: f64,
    inertia: f64,
    largest: f64,
}

impl SafeStep<'_> {
    fn uniform(&self) -> StepUniform {
        let settings = self.settings;
        let rate = 1.0 / self.dt;
        StepUniform {
            h: self.dt as f32,
            rate: rate as f32,
            inertia: (rate * rate) as f32,
            mass_damping: (settings.mass_damping * rate) as f32,
            stiffness_damping: (self.body.elements.damping_factor() * rate) as f32,
            tolerance: settings.linear_tolerance as f32,
            max_iterations: settings.max_linear_iterations,
            t: 1.0,
            warm: 1,
            coarse_groups: self.coarse().map_or(0, |coarse| coarse.groups),
            smoother: coarse::smoother(self.body.elements.most_vertices()),
            ..StepUniform::default()
        }
    }

    /// Motions of aggregates, if they are part of the preconditioner.
    fn coarse(&self) -> Option<&Coarse> {
        let coarse = self.body.coarse.as_ref();
        coarse.filter(|_| self.preconditioner == Preconditioner::Multigrid)
    }

    fn damped(&self) -> bool {
        self.body.elements.damping_factor() > 0.0
    }

    /// Carries out the step up to where it only has to be accepted.
    pub fn run(
        &self,
        input: &BodyInput,
        kept: &mut Option<Kept>,
        report: &mut StepReport,
        device: &mut GpuReport,
    ) -> Result<BodyOutput, GpuError> {
        let (context, body) = (self.context, self.body);
        let mut uniform = self.uniform();

        // the tangent of the damping, and the energy before held vertices move
        let mut before = None;
        if input.moves || self.damped() {
            uniform.kind = kind_number(TangentKind::GaussNewton);
            body.set(context, uniform);
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| body.each_row(context, pass, "look_back"));
            if input.moves {
                body.energies(context, &mut recorder);
                before = Some(body.read_energies(&mut recorder));
                report.evaluations += 1;
            }
            if self.damped() {
                body.tangent(context, &mut recorder, TangentKind::GaussNewton, true);
                report.evaluations += 1;
            }
            recorder.submit();
        }

        // everything up to the first iterations of the linear system
        let kind = if input.inverted { TangentKind::Projected } else { TangentKind::Exact };
        uniform.kind = kind_number(kind);
        body.set(context, uniform);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| {
            body.each_row(context, pass, "begin");
            if self.damped() {
                body.each_row(context, pass, "moved_to_direction");
                body.product(context, pass, "product_plain", true);
                body.each_row(context, pass, "product_to_damped");
            }
        });
        body.energies(context, &mut recorder);
        let start_energy = body.read_energies(&mut recorder);
        body.forces(context, &mut recorder);
        recorder.pass(Phase::Rows, |pass| body.summing(context, pass, "measure_start"));
        let start_sums = body.read_sums(&mut recorder, 2);
        report.evaluations += 1;
        body.tangent(context, &mut recorder, kind, false);
        body.shift(context, &mut recorder);
        recorder.submit();
        let mut outcome = self.solve(&uniform, input.iterations, kept, report, device)?;

        let at_start = body.elements.sum_energies(&start_energy.wait(context)?);
        let before = match before {
            Some(pending) => body.elements.sum_energies(&pending.wait(context)?),
            None => at_start,
        };
        // what is minimised
        let elastic = at_start.total();
        let sums = start_sums.wait::<[f32; 4]>(context)?;
        let start = |at: usize, k: usize| total(&sums, 2, at, k);
        let (free_before, held_before) = (start(0, 0), start(0, 1));
        let stiffness_damping = body.elements.damping_factor() / self.dt;
        let damping = 0.5 * stiffness_damping * start(0, 2);
        // loads along the displacements at the start, and along the way of the held vertices
        let (loads_before, loads_moved) = (start(1, 0), start(0, 3));
        let budget = free_before + elastic - (loads_before + loads_moved) + damping;
        report.constraint_work += elastic + damping - before.total() - loads_moved;

        let mut iterations = outcome.1.iterations;
        let not_finite = |iterations| BodyOutput { iterations, ..BodyOutput::default() };
        let finite = elastic.is_finite() && budget.is_finite();
        if outcome.0 == Solve::NotFinite || !finite {
            return Ok(not_finite(iterations));
        }

        // a step that leads downhill, if need be by a definite tangent
        if input.inverted {
            report.projections += 1;
        }
        let mut found = None;
        if outcome.0 == Solve::Solved {
            let (search, energy) = self.direction(input, &mut uniform)?;
            if search.slope < 0.0 || search.largest == 0.0 {
                found = Some((search, energy));
            }
        }
        if found.is_none() && !input.inverted {
            uniform.kind = kind_number(TangentKind::Projected);
            uniform.warm = 0;
            body.set(context, uniform);
            let mut recorder = context.record();
            // the trial moved the point of evaluation
            recorder.pass(Phase::Rows, |pass| body.each_row(context, pass, "begin"));
            if self.damped() {
                recorder.pass(Phase::Rows, |pass| {
                    body.each_row(context, pass, "moved_to_direction");
                    body.product(context, pass, "product_plain", true);
                    body.each_row(context, pass, "product_to_damped");
                });
            }
            body.tangent(context, &mut recorder, TangentKind::Projected, false);
            body.shift(context, &mut recorder);
            recorder.submit();
            report.evaluations += 1;
            report.projections += 1;
            outcome = self.solve(&uniform, iterations, kept, report, device)?;
            iterations = iterations.max(outcome.1.iterations);
            match outcome.0 {
                Solve::NotFinite => return Ok(not_finite(iterations)),
                Solve::Solved => {
                    let (search, energy) = self.direction(input, &mut uniform)?;
                    if search.slope < 0.0 || search.largest == 0.0 {
                        found = Some((search, energy));
                    }
                }
                Solve::Indefinite => {}
            }
        }
        let (search, mut trial_energy) = match found {
            Some(found) => found,
            None => {
                report.gradient_fallbacks += 1;
                let mut recorder = context.record();
                recorder.pass(Phase::Rows, |pass| {
                    body.each_row(context, pass, "preconditioned_gradient");
                });
                recorder.submit();
                self.direction(
                    &BodyInput { free_pieces: Vec::new(), ..input.clone() },
                    &mut uniform,
                )?
            }
        };
        report.newton_iterations += 1;
        report.newton_step = report.newton_step.max(search.largest / input.size);

        // backtracking on the incremental potential
        let scale = elastic.abs() + search.inertia;
        let rounding = NOISE * scale;
        let mut t = 1.0;
        let mut accepted = false;
        for halving in 0..MAX_HALVINGS {
            report.evaluations += 1;
            let change = (trial_energy.total() - elastic)
                + t * search.linear
                + 0.5 * t * t * search.quadratic;
            if change <= ARMIJO * t * search.slope + rounding {
                accepted = true;
                let predicted = search.slope * (t - 0.5 * t * t);
                if predicted.abs() > rounding {
                    let error = (change / predicted - 1.0).abs();
                    report.linearisation_error = report.linearisation_error.max(error);
                }
                break;
            }
            report.backtracks += 1;
            t *= 0.5;
            if halving + 1 < MAX_HALVINGS {
                trial_energy = self.trial(t, &mut uniform)?;
            }
        }
        if !accepted {
            report.line_search_failures += 1;
            t = 0.0;
            trial_energy = self.trial(t, &mut uniform)?;
        }

        // the end: velocities, sums, the energy cap
        uniform.t = t as f32;
        body.set(context, uniform);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| {
            body.each_row(context, pass, "advance");
            if self.damped() {
                body.product(context, pass, "product_plain", true);
                body.each_row(context, pass, "product_to_damped");
            }
            body.summing(context, pass, "measure_end");
        });
        let end_sums = body.read_sums(&mut recorder, 3);
        if input.volumes {
            body.volumes(context, &mut recorder);
        }
        let volumes = input.volumes.then(|| body.read_energies(&mut recorder));
        let u = input.read_back.then(|| body.read_rows(&mut recorder, Slot::Y));
        let v = input.read_back.then(|| body.read_rows(&mut recorder, Slot::Step));
        recorder.submit();
        let mut sums = end_sums.wait::<[f32; 4]>(context)?;
        let rows = |pending: Option<Pending>| pending.map_or(Ok(Vec::new()), |p| p.wait(context));
        let (u, mut v) = (rows(u)?, rows(v)?);
        let volumes = match volumes {
            Some(pending) => {
                let found = pending.wait::<[f32; 4]>(context)?;
                let smallest = found.iter().map(|x| f64::from(x[0])).fold(f64::INFINITY, f64::min);
                Some((smallest, total(&found, 1, 0, 1) as u64))
            }
            None => None,
        };
        if total(&sums, 3, 1, 3) > 0.0 || !trial_energy.total().is_finite() {
            return Ok(not_finite(iterations));
        }
        let end = |sums: &[[f32; 4]], at: usize, k: usize| total(sums, 3, at, k);
        let (mut kinetic, held) = (end(&sums, 0, 0), end(&sums, 0, 1));
        report.damping_dissipation += self.dt
            * (2.0 * self.settings.mass_damping * kinetic + stiffness_damping * end(&sums, 0, 2));
        let load_work = end(&sums, 0, 3);
        let potential = trial_energy.total() - (loads_before + load_work);
        if kinetic > 0.0 && kinetic + potential > budget + NOISE * (kinetic + potential.abs()) {
            let factor = ((budget - potential).max(0.0) / kinetic).sqrt();
            uniform.scale = factor as f32;
            body.set(context, uniform);
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| {
                body.each_row(context, pass, "cap_velocity");
                body.summing(context, pass, "measure_end");
            });
            let end_sums = body.read_sums(&mut recorder, 3);
            let capped = input.read_back.then(|| body.read_rows(&mut recorder, Slot::Step));
            recorder.submit();
            sums = end_sums.wait(context)?;
            v = rows(capped)?;
            kinetic = end(&sums, 0, 0);
            report.energy_caps += 1;
        }
        // small beside the potential of loads, so summed apart
        report.elastic_energy += trial_energy.elastic;
        report.kinetic_energy += kinetic + held;
        report.constraint_work += held - held_before;
        report.load_work += load_work + before.load - trial_energy.load;
        // completed by the caller: energy at the start plus work less energy at the end
        report.dissipation += before.elastic + free_before + held_before;
        for k in 0..3 {
            report.momentum[k] += end(&sums, 1, k);
            report.angular_momentum[k] += end(&sums, 2, k);
        }
        Ok(BodyOutput { u, v, volumes, iterations, finite: true })
    }

    /// Conjugate gradients from the right-hand side on.
    fn solve(
        &self,
        uniform: &StepUniform,
        expected: u32,
        kept: &mut Option<Kept>,
        report: &mut StepReport,
        device: &mut GpuReport,
    ) -> Result<(Solve, CgState), GpuError> {
        let context = self.context;
        let mut coarse = self.coarse();
        report.preconditioner = Preconditioner::BlockJacobi.name();
        let state = loop {
            let mut recorder = context.record();
            if let Some(coarse) = coarse {
                report.preconditioner = self.preconditioner.name();
                let factors = [uniform.inertia, uniform.mass_damping, uniform.stiffness_damping];
                if !kept.as_ref().is_some_and(|kept| kept.serves(factors)) {
                    coarse.refresh(context, &mut recorder);
                    let matrix = self.body.matrix.as_ref().map_or(0, |m| m.pattern.bytes());
                    *kept = Some(Kept::new(factors, coarse.cost(matrix)));
                    report.preconditioner_refreshes += 1;
                }
            }
            let state = self.iterate(recorder, coarse, expected)?;
            if state.phase != phase::UNUSABLE {
                break state;
            }
            // `f32` could not hold the inverse: this system goes without
            report.cg_iterations += state.iterations;
            report.preconditioner_breakdowns += 1;
            report.preconditioner = Preconditioner::BlockJacobi.name();
            *kept = None;
            coarse = None;
            self.body.set(context, StepUniform { coarse_groups: 0, ..*uniform });
        };
        if coarse.is_some() {
            let reduction = f64::from(state.residual) / f64::from(state.reference);
            match (state.phase, kept.as_mut()) {
                (phase::CONVERGED, Some(kept)) => {
                    kept.book(state.iterations, -0.5 * reduction.log10());
                }
                // `f32` gets no closer, whatever the preconditioner
                (phase::STALLED, _) => {}
                // made for a matrix that was given up: not worth keeping
                _ => *kept = None,
            }
        }
        report.cg_iterations += state.iterations;
        device.restarts += state.restarts;
        let outcome = match state.phase {
            phase::CONVERGED | phase::CAPPED | phase::STALLED => {
                let residual = if state.reference > 0.0 {
                    (f64::from(state.residual) / f64::from(state.reference)).sqrt()
                } else {
                    0.0
                };
                report.cg_residual = report.cg_residual.max(residual);
                report.cg_caps += u32::from(state.phase == phase::CAPPED);
                device.stalled += u32::from(state.phase == phase::STALLED);
                Solve::Solved
            }
            phase::NOT_FINITE => Solve::NotFinite,
            _ => Solve::Indefinite,
        };
        Ok((outcome, state))
    }

    /// The iterations, in batches.
    fn iterate<'r>(
        &'r self,
        mut recorder: Recorder<'r>,
        coarse: Option<&Coarse>,
        expected: u32,
    ) -> Result<CgState, GpuError> {
        let (context, body) = (self.context, self.body);
        // as many as last time and a few more, so that one wait does
        let mut batch =
            if expected == 0 { FIRST_BATCH } else { expected + expected / 8 + 4 }.min(MAX_BATCH);
        let rows = groups_for(u64::from(body.n));
        recorder.pass(Phase::Rows, |pass| body.each_row(context, pass, "right_hand_side"));
        recorder.pass(Phase::Solve, |pass| {
            body.product(context, pass, "product_alone", false);
            body.summing(context, pass, "start_residual");
            if let Some(coarse) = coarse {
                body.product(context, pass, coarse::START[0], false);
                coarse.apply(context, coarse::START, pass);
            }
            body.single(context, pass, "start_end");
            if let Some(coarse) = coarse {
                coarse.dispatch(context, "first_direction", rows, pass);
            }
        });
        loop {
            recorder.pass(Phase::Solve, |pass| {
                for _ in 0..batch {
                    self.matrix_single(pass, "note");
                    body.product(context, pass, "product", false);
                    body.summing(context, pass, "improve");
                    match coarse {
                        Some(coarse) => {
                            body.product(context, pass, coarse::ITERATION[0], false);
                            coarse.apply(context, coarse::ITERATION, pass);
                            coarse.dispatch(context, "direction", [body.groups, 1], pass);
                        }
                        None => body.summing(context, pass, "direction"),
                    }
                }
                self.matrix_single(pass, "note");
                body.each_row(context, pass, "verify_begin");
                body.product(context, pass, "product_verify", false);
                body.summing(context, pass, "verify_residual");
                if let Some(coarse) = coarse {
                    body.product(context, pass, coarse::VERIFY[0], false);
                    coarse.apply(context, coarse::VERIFY, pass);
                }
                body.single(context, pass, "verify_end");
                if let Some(coarse) = coarse {
                    coarse.dispatch(context, "first_direction", rows, pass);
                }
            });
            let pending = body.read_cg(&mut recorder);
            recorder.submit();
            let state = pending.wait::<CgState>(context)?[0];
            if !matches!(state.phase, phase::ITERATING | phase::CLAIMED) {
                return Ok(state);
            }
            batch = FIRST_BATCH;
            recorder = context.record();
        }
    }

    fn matrix_single(&self, pass: &mut sinew_adapter::wgpu::ComputePass<'_>, entry: &'static str) {
        self.body.single(self.context, pass, entry);
    }

    /// Balances the momentum of free pieces, measures the step found and evaluates at its end.
    fn direction(
        &self,
        input: &BodyInput,
        uniform: &mut StepUniform,
    ) -> Result<(Search, Energies), GpuError> {
        let (context, body) = (self.context, self.body);
        for &(piece, mass) in &input.free_pieces {
            uniform.piece = piece;
            uniform.piece_mass = uniform.inertia.mul_add(1.0, uniform.mass_damping) * mass as f32;
            body.set(context, *uniform);
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| {
                body.summing(context, pass, "missing_momentum");
                body.summing(context, pass, "correct_momentum");
            });
            recorder.submit();
        }
        uniform.t = 1.0;
        body.set(context, *uniform);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| {
            if self.damped() {
                body.each_row(context, pass, "step_to_direction");
                body.product(context, pass, "product_plain", true);
            }
            body.summing(context, pass, "measure_search");
            body.each_row(context, pass, "trial");
        });
        let sums = body.read_sums(&mut recorder, 2);
        body.energies(context, &mut recorder);
        let energies = body.read_energies(&mut recorder);
        recorder.submit();
        let sums = sums.wait::<[f32; 4]>(context)?;
        let energies = energies.wait::<[f32; 4]>(context)?;
        let largest = sums.iter().skip(1).step_by(2).map(|row| f64::from(row[0]));
        let search = Search {
            linear: total(&sums, 2, 0, 0),
            quadratic: total(&sums, 2, 0, 1),
            slope: total(&sums, 2, 0, 2),
            inertia: total(&sums, 2, 0, 3),
            largest: largest.fold(0.0, f64::max),
        };
        Ok((search, body.elements.sum_energies(&energies)))
    }

    /// Energies at the fraction `t` of the step.
    fn trial(&self, t: f64, uniform: &mut StepUniform) -> Result<Energies, GpuError> {
        let (context, body) = (self.context, self.body);
        uniform.t = t as f32;
        body.set(context, *uniform);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| body.each_row(context, pass, "trial"));
        body.energies(context, &mut recorder);
        let energies = body.read_energies(&mut recorder);
        recorder.submit();
        Ok(body.elements.sum_energies(&energies.wait::<[f32; 4]>(context)?))
    }
}
