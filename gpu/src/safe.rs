//! The safe step on the device: implicit Euler with one linear system, line search and energy cap. Twin of
//! `sinew_solvers::implicit` with `Integrator::Safe`; the same formulas, tests and constants.
//!
//! The host decides between the parts and sees only sums: nothing of the size of the body crosses but the new
//! state, where it is asked for, once. A smooth step waits for the device three times: for conjugate gradients, for
//! the line search, for the end.

use sinew_engine::law::TangentKind;
use sinew_engine::report::StepReport;
use sinew_solvers::settings::{Preconditioner, SolverSettings};

use crate::body::{CgState, DeviceBody, RowSlot, StepUniform, kind_number, total};
use crate::coarse::{self, Coarse, KeptInverse};
use crate::context::{Context, Pass, PassRecorder, PendingRead, groups_for};
use crate::elements::BodyEnergies;
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
/// Most iterations before the host looks at them.
const MAX_BATCH: u32 = 512;
/// Iterations in one submission: the device begins with the first while the host records the next.
const SUBMISSION: u32 = 12;

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
enum SolveEnd {
    Solved,
    Indefinite,
    NotFinite,
}

/// Sums of a measurement of the line search.
struct SearchSums {
    linear: f64,
    quadratic: f64,
    slope: f64,
    inertia: f64,
    largest: f64,
}

impl SearchSums {
    /// The step leads downhill, or there is none to make.
    fn descends(&self) -> bool {
        self.slope < 0.0 || self.largest == 0.0
    }
}

/// Energies (J) at the start of a step.
struct SafeStart {
    /// Before held vertices move.
    before: BodyEnergies,
    /// What is minimised, held vertices moved.
    elastic: f64,
    /// Kinetic energies of free and of held unknowns.
    kinetic: [f64; 2],
    /// Potential of the loads before held vertices move.
    loads: f64,
    /// Kinetic plus potential energy, held vertices moved.
    budget: f64,
}

/// A step under way.
struct SafeProgress<'a, 's> {
    step: &'a SafeStep<'s>,
    input: &'a BodyInput,
    kept: &'a mut Option<KeptInverse>,
    report: &'a mut StepReport,
    device: &'a mut GpuReport,
    uniform: StepUniform,
    /// Of the longest linear solve; before the first, those expected.
    iterations: u32,
}

impl<'s> SafeProgress<'_, 's> {
    /// The whole step.
    fn run(mut self) -> Result<BodyOutput, GpuError> {
        let before = self.begin();
        let (start, solved) = self.linearise(before)?;
        let finite = start.elastic.is_finite() && start.budget.is_finite();
        if solved == SolveEnd::NotFinite || !finite {
            return Ok(self.not_finite());
        }
        self.report.projections += u32::from(self.input.inverted);
        let Some((search, energies)) = self.find_direction(solved)? else {
            return Ok(self.not_finite());
        };
        let energies = self.backtrack(&start, &search, energies)?;
        self.finish(&start, energies)
    }

    fn not_finite(&self) -> BodyOutput {
        BodyOutput { iterations: self.iterations, ..BodyOutput::default() }
    }

    /// Sets the constants of the kernels and begins to record.
    fn record(&self) -> PassRecorder<'s> {
        self.step.body.set(self.step.context, self.uniform);
        self.step.context.record()
    }

    /// The tangent of the damping, and the energies before held vertices move, if any do.
    fn begin(&mut self) -> Option<PendingRead> {
        let SafeStep { body, .. } = *self.step;
        if !self.input.moves && !self.step.damped() {
            return None;
        }
        self.uniform.kind = kind_number(TangentKind::GaussNewton);
        let mut recorder = self.record();
        recorder.pass(Phase::Rows, |pass| body.each_row(pass, "look_back"));
        let before = self.input.moves.then(|| {
            body.energies(&mut recorder);
            self.report.evaluations += 1;
            body.read_energies(&mut recorder)
        });
        if self.step.damped() {
            body.tangent(&mut recorder, TangentKind::GaussNewton, true);
            self.report.evaluations += 1;
        }
        recorder.submit();
        before
    }

    /// Energies, residual and tangent with held vertices moved, and the first linear solve.
    fn linearise(
        &mut self,
        before: Option<PendingRead>,
    ) -> Result<(SafeStart, SolveEnd), GpuError> {
        let SafeStep { body, .. } = *self.step;
        let kind = if self.input.inverted { TangentKind::Projected } else { TangentKind::Exact };
        self.uniform.kind = kind_number(kind);
        let mut recorder = self.record();
        recorder.pass(Phase::Rows, |pass| {
            body.each_row(pass, "begin");
            self.step.multiply_damping(pass);
        });
        body.energies(&mut recorder);
        let energies = body.read_energies(&mut recorder);
        body.forces(&mut recorder);
        recorder.pass(Phase::Rows, |pass| body.summing(pass, "measure_start"));
        let sums = body.read_sums(&mut recorder, 2);
        self.report.evaluations += 1;
        body.tangent(&mut recorder, kind, false);
        body.shift(&mut recorder);
        recorder.submit();
        let solved = self.solve()?;
        let start = self.open_books(before, energies, sums)?;
        Ok((start, solved))
    }

    /// Opens the energy books.
    fn open_books(
        &mut self,
        before: Option<PendingRead>,
        energies: PendingRead,
        sums: PendingRead,
    ) -> Result<SafeStart, GpuError> {
        let SafeStep { context, body, .. } = *self.step;
        let at_start = body.elements.sum_energies(&energies.wait(context)?);
        let before = match before {
            Some(pending) => body.elements.sum_energies(&pending.wait(context)?),
            None => at_start,
        };
        let elastic = at_start.total();
        let sums = sums.wait::<[f32; 4]>(context)?;
        let start = |at: usize, k: usize| total(&sums, 2, at, k);
        let kinetic = [start(0, 0), start(0, 1)];
        let damping = 0.5 * self.stiffness_damping() * start(0, 2);
        // loads along the displacements at the start, and along the way of the held vertices
        let (loads, loads_moved) = (start(1, 0), start(0, 3));
        let budget = kinetic[0] + elastic - (loads + loads_moved) + damping;
        self.report.constraint_work += elastic + damping - before.total() - loads_moved;
        Ok(SafeStart { before, elastic, kinetic, loads, budget })
    }

    /// Factor of the damping matrix over the step length.
    fn stiffness_damping(&self) -> f64 {
        self.step.body.elements.damping_factor() / self.step.dt
    }

    fn solve(&mut self) -> Result<SolveEnd, GpuError> {
        let expected = self.iterations;
        let (kept, report) = (&mut *self.kept, &mut *self.report);
        let (solved, state) =
            self.step.solve(&self.uniform, expected, kept, report, self.device)?;
        self.iterations = state.iterations;
        Ok(solved)
    }

    /// A step that leads downhill, if need be by a definite tangent or along the preconditioned gradient;
    /// `None` when a number is not finite.
    fn find_direction(
        &mut self,
        solved: SolveEnd,
    ) -> Result<Option<(SearchSums, BodyEnergies)>, GpuError> {
        if solved == SolveEnd::Solved {
            let found = self.step.direction(self.input, &mut self.uniform)?;
            if found.0.descends() {
                return Ok(Some(found));
            }
        }
        if !self.input.inverted {
            match self.solve_projected()? {
                SolveEnd::NotFinite => return Ok(None),
                SolveEnd::Solved => {
                    let found = self.step.direction(self.input, &mut self.uniform)?;
                    if found.0.descends() {
                        return Ok(Some(found));
                    }
                }
                SolveEnd::Indefinite => {}
            }
        }
        self.report.gradient_fallbacks += 1;
        let SafeStep { context, body, .. } = *self.step;
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| {
            body.each_row(pass, "preconditioned_gradient");
        });
        recorder.submit();
        let input = BodyInput { free_pieces: Vec::new(), ..self.input.clone() };
        self.step.direction(&input, &mut self.uniform).map(Some)
    }

    /// Solves again with the projected tangent.
    fn solve_projected(&mut self) -> Result<SolveEnd, GpuError> {
        let SafeStep { body, .. } = *self.step;
        self.uniform.kind = kind_number(TangentKind::Projected);
        self.uniform.warm = 0;
        let mut recorder = self.record();
        // the trial moved the point of evaluation
        recorder.pass(Phase::Rows, |pass| {
            body.each_row(pass, "begin");
            self.step.multiply_damping(pass);
        });
        body.tangent(&mut recorder, TangentKind::Projected, false);
        body.shift(&mut recorder);
        recorder.submit();
        self.report.evaluations += 1;
        self.report.projections += 1;
        let first = self.iterations;
        let solved = self.solve()?;
        self.iterations = self.iterations.max(first);
        Ok(solved)
    }

    /// Backtracking on the incremental potential from the full step, where the elements have `energies`;
    /// their energies at the fraction accepted, none of the step where no fraction is.
    fn backtrack(
        &mut self,
        start: &SafeStart,
        search: &SearchSums,
        mut energies: BodyEnergies,
    ) -> Result<BodyEnergies, GpuError> {
        let report = &mut *self.report;
        report.newton_iterations += 1;
        report.newton_step = report.newton_step.max(search.largest / self.input.size);
        let scale = start.elastic.abs() + search.inertia;
        let rounding = NOISE * scale;
        let mut t = 1.0;
        for halving in 0..MAX_HALVINGS {
            report.evaluations += 1;
            let change = (energies.total() - start.elastic)
                + t * search.linear
                + 0.5 * t * t * search.quadratic;
            if change <= ARMIJO * t * search.slope + rounding {
                let predicted = search.slope * (t - 0.5 * t * t);
                if predicted.abs() > rounding {
                    let error = (change / predicted - 1.0).abs();
                    report.linearisation_error = report.linearisation_error.max(error);
                }
                self.uniform.t = t as f32;
                return Ok(energies);
            }
            report.backtracks += 1;
            t *= 0.5;
            if halving + 1 < MAX_HALVINGS {
                energies = self.step.trial(t, &mut self.uniform)?;
            }
        }
        report.line_search_failures += 1;
        self.step.trial(0.0, &mut self.uniform)
    }

    /// The end: velocities, sums, the energy cap, the report.
    fn finish(
        &mut self,
        start: &SafeStart,
        energies: BodyEnergies,
    ) -> Result<BodyOutput, GpuError> {
        let SafeStep { context, body, .. } = *self.step;
        let input = self.input;
        let mut recorder = self.record();
        recorder.pass(Phase::Rows, |pass| {
            body.each_row(pass, "advance");
            self.step.multiply_direction(pass);
            body.summing(pass, "measure_end");
        });
        let sums = body.read_sums(&mut recorder, 3);
        if input.volumes {
            body.volumes(&mut recorder);
        }
        let volumes = input.volumes.then(|| body.read_energies(&mut recorder));
        let u = input.read_back.then(|| body.read_rows(&mut recorder, RowSlot::Y));
        let v = input.read_back.then(|| body.read_rows(&mut recorder, RowSlot::Step));
        recorder.submit();
        let mut sums = EndSums(sums.wait(context)?);
        let rows =
            |pending: Option<PendingRead>| pending.map_or(Ok(Vec::new()), |p| p.wait(context));
        let (u, mut v) = (rows(u)?, rows(v)?);
        let volumes = match volumes {
            Some(pending) => {
                let found = pending.wait::<[f32; 4]>(context)?;
                let smallest = found.iter().map(|x| f64::from(x[0])).fold(f64::INFINITY, f64::min);
                Some((smallest, total(&found, 1, 0, 1) as u64))
            }
            None => None,
        };
        if sums.get(1, 3) > 0.0 || !energies.total().is_finite() {
            return Ok(self.not_finite());
        }
        let kinetic = sums.get(0, 0);
        let mass_damping = self.step.settings.mass_damping;
        let power = 2.0 * mass_damping * kinetic + self.stiffness_damping() * sums.get(0, 2);
        self.report.damping_dissipation += self.step.dt * power;
        let potential = energies.total() - (start.loads + sums.get(0, 3));
        let rounding = NOISE * (kinetic + potential.abs());
        // the cap changes neither
        let (held, load_work) = (sums.get(0, 1), sums.get(0, 3));
        if kinetic > 0.0 && kinetic + potential > start.budget + rounding {
            let factor = ((start.budget - potential).max(0.0) / kinetic).sqrt();
            let capped;
            (sums, capped) = self.cap_energy(factor)?;
            v = rows(capped)?;
        }
        let report = &mut *self.report;
        // small beside the potential of loads, so summed apart
        report.elastic_energy += energies.elastic;
        report.kinetic_energy += sums.get(0, 0) + held;
        report.constraint_work += held - start.kinetic[1];
        report.load_work += load_work + start.before.load - energies.load;
        // completed by the caller: energy at the start plus work less energy at the end
        report.dissipation += start.before.elastic + start.kinetic[0] + start.kinetic[1];
        for k in 0..3 {
            report.momentum[k] += sums.get(1, k);
            report.angular_momentum[k] += sums.get(2, k);
        }
        Ok(BodyOutput { u, v, volumes, iterations: self.iterations, finite: true })
    }

    /// Multiplies the velocities by a factor; the sums of the end with them, and the velocities on their way
    /// to the host where they are asked for.
    fn cap_energy(&mut self, factor: f64) -> Result<(EndSums, Option<PendingRead>), GpuError> {
        let SafeStep { context, body, .. } = *self.step;
        self.uniform.scale = factor as f32;
        let mut recorder = self.record();
        recorder.pass(Phase::Rows, |pass| {
            body.each_row(pass, "cap_velocity");
            body.summing(pass, "measure_end");
        });
        let sums = body.read_sums(&mut recorder, 3);
        let velocities = self.input.read_back.then(|| body.read_rows(&mut recorder, RowSlot::Step));
        recorder.submit();
        self.report.energy_caps += 1;
        Ok((EndSums(sums.wait(context)?), velocities))
    }
}

/// Sums of the measurement at the end of a step.
struct EndSums(Vec<[f32; 4]>);

impl EndSums {
    /// Entry `k` of row `at` of three.
    fn get(&self, at: usize, k: usize) -> f64 {
        total(&self.0, 3, at, k)
    }
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
        kept: &mut Option<KeptInverse>,
        report: &mut StepReport,
        device: &mut GpuReport,
    ) -> Result<BodyOutput, GpuError> {
        let uniform = self.uniform();
        let iterations = input.iterations;
        SafeProgress { step: self, input, kept, report, device, uniform, iterations }.run()
    }

    /// Damping matrix times the way from the offset.
    fn multiply_damping(&self, pass: &mut Pass<'_>) {
        if self.damped() {
            self.body.each_row(pass, "moved_to_direction");
            self.multiply_direction(pass);
        }
    }

    /// Damping matrix times the direction.
    fn multiply_direction(&self, pass: &mut Pass<'_>) {
        if self.damped() {
            self.body.product(pass, "product_plain", true);
            self.body.each_row(pass, "product_to_damped");
        }
    }

    /// Conjugate gradients from the right-hand side on.
    fn solve(
        &self,
        uniform: &StepUniform,
        expected: u32,
        kept: &mut Option<KeptInverse>,
        report: &mut StepReport,
        device: &mut GpuReport,
    ) -> Result<(SolveEnd, CgState), GpuError> {
        let context = self.context;
        let mut coarse = self.coarse();
        report.preconditioner = Preconditioner::BlockJacobi.name().into();
        let state = loop {
            let mut recorder = context.record();
            if let Some(coarse) = coarse {
                report.preconditioner = self.preconditioner.name().into();
                let factors = [uniform.inertia, uniform.mass_damping, uniform.stiffness_damping];
                if !kept.as_ref().is_some_and(|kept| kept.serves(factors)) {
                    coarse.refresh(&mut recorder);
                    let matrix = self.body.matrix.as_ref().map_or(0, |m| m.pattern.bytes());
                    *kept = Some(KeptInverse::new(factors, coarse.cost(matrix)));
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
            report.preconditioner = Preconditioner::BlockJacobi.name().into();
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
                SolveEnd::Solved
            }
            phase::NOT_FINITE => SolveEnd::NotFinite,
            _ => SolveEnd::Indefinite,
        };
        Ok((outcome, state))
    }

    /// The iterations, in batches.
    fn iterate<'r>(
        &'r self,
        mut recorder: PassRecorder<'r>,
        coarse: Option<&Coarse>,
        expected: u32,
    ) -> Result<CgState, GpuError> {
        let (context, body) = (self.context, self.body);
        // as many as last time and a few more, so that one wait does
        let mut batch =
            if expected == 0 { FIRST_BATCH } else { expected + expected / 8 + 4 }.min(MAX_BATCH);
        let rows = groups_for(u64::from(body.n));
        recorder.pass(Phase::Rows, |pass| body.each_row(pass, "right_hand_side"));
        recorder.pass(Phase::Solve, |pass| {
            body.product(pass, "product_alone", false);
            body.summing(pass, "start_residual");
            if let Some(coarse) = coarse {
                body.product(pass, coarse::START[0], false);
                coarse.apply(coarse::START, pass);
            }
            body.single(pass, "start_end");
            if let Some(coarse) = coarse {
                coarse.dispatch("first_direction", rows, pass);
            }
        });
        loop {
            let mut left = batch;
            while left > 0 {
                let now = left.min(SUBMISSION);
                left -= now;
                recorder.pass(Phase::Solve, |pass| {
                    for _ in 0..now {
                        body.single(pass, "note");
                        body.product(pass, "product", false);
                        body.summing(pass, "improve");
                        match coarse {
                            Some(coarse) => {
                                body.product(pass, coarse::ITERATION[0], false);
                                coarse.apply(coarse::ITERATION, pass);
                                coarse.dispatch("direction", [body.groups, 1], pass);
                            }
                            None => body.summing(pass, "direction"),
                        }
                    }
                });
                if left > 0 {
                    recorder.submit();
                    recorder = context.record();
                }
            }
            recorder.pass(Phase::Solve, |pass| {
                body.single(pass, "note");
                body.each_row(pass, "verify_begin");
                body.product(pass, "product_verify", false);
                body.summing(pass, "verify_residual");
                if let Some(coarse) = coarse {
                    body.product(pass, coarse::VERIFY[0], false);
                    coarse.apply(coarse::VERIFY, pass);
                }
                body.single(pass, "verify_end");
                if let Some(coarse) = coarse {
                    coarse.dispatch("first_direction", rows, pass);
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

    /// Balances the momentum of free pieces, measures the step found and evaluates at its end.
    fn direction(
        &self,
        input: &BodyInput,
        uniform: &mut StepUniform,
    ) -> Result<(SearchSums, BodyEnergies), GpuError> {
        let (context, body) = (self.context, self.body);
        for &(piece, mass) in &input.free_pieces {
            uniform.piece = piece;
            uniform.piece_mass = uniform.inertia.mul_add(1.0, uniform.mass_damping) * mass as f32;
            body.set(context, *uniform);
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| {
                body.summing(pass, "missing_momentum");
                body.summing(pass, "correct_momentum");
            });
            recorder.submit();
        }
        uniform.t = 1.0;
        body.set(context, *uniform);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| {
            if self.damped() {
                body.each_row(pass, "step_to_direction");
                body.product(pass, "product_plain", true);
            }
            body.summing(pass, "measure_search");
            body.each_row(pass, "trial");
        });
        let sums = body.read_sums(&mut recorder, 2);
        body.energies(&mut recorder);
        let energies = body.read_energies(&mut recorder);
        recorder.submit();
        let sums = sums.wait::<[f32; 4]>(context)?;
        let energies = energies.wait::<[f32; 4]>(context)?;
        let largest = sums.iter().skip(1).step_by(2).map(|row| f64::from(row[0]));
        let search = SearchSums {
            linear: total(&sums, 2, 0, 0),
            quadratic: total(&sums, 2, 0, 1),
            slope: total(&sums, 2, 0, 2),
            inertia: total(&sums, 2, 0, 3),
            largest: largest.fold(0.0, f64::max),
        };
        Ok((search, body.elements.sum_energies(&energies)))
    }

    /// Energies at the fraction `t` of the step.
    fn trial(&self, t: f64, uniform: &mut StepUniform) -> Result<BodyEnergies, GpuError> {
        let (context, body) = (self.context, self.body);
        uniform.t = t as f32;
        body.set(context, *uniform);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| body.each_row(pass, "trial"));
        body.energies(&mut recorder);
        let energies = body.read_energies(&mut recorder);
        recorder.submit();
        Ok(body.elements.sum_energies(&energies.wait::<[f32; 4]>(context)?))
    }
}
