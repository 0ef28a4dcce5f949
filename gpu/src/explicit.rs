//! Explicit substeps on the device: symplectic Euler and Störmer-Verlet, as `sinew_solvers::explicit` has them.
//!
//! All substeps of a step are recorded at once, unless loads or held vertices vary within it; then each brings
//! their values along. A step waits for the device once, for energy, sums and the new state; if the energy grew it
//! is repeated from the old state with twice as many substeps.

use sinew_engine::report::StepReport;
use sinew_engine::row::VertexRow;
use sinew_engine::substep::WithinStep;
use sinew_solvers::explicit::{GROWTH, KickFactors};
use sinew_solvers::settings::{Integrator, SolverSettings};
use std::ops::Range;

use crate::body::{DeviceBody, RowSlot, StepUniform, total};
use crate::context::Context;
use crate::error::GpuError;
use crate::report::Phase;
use crate::safe::BodyOutput;

/// Substeps in one submission.
const BATCH: u32 = 64;

/// One body's step.
pub(crate) struct ExplicitStep<'a> {
    pub context: &'a Context,
    pub body: &'a DeviceBody,
    pub settings: &'a SolverSettings,
    pub dt: f64,
    /// Rows of the body in the world, to which `within` counts.
    pub rows: Range<usize>,
    /// Loads (N) at the end of the step, and where held unknowns are (m): at the start, and at the end.
    pub load: &'a [[f32; 4]],
    pub place: [&'a [[f32; 4]]; 2],
    /// Energies (J) at the start: elastic, kinetic of free and of held unknowns.
    pub before: [f64; 3],
}

/// What varies through the step, on the host.
struct Varying {
    load: Vec<[f32; 4]>,
    place: Vec<[f32; 4]>,
    differences: Vec<glam::DVec3>,
    ways: Vec<f64>,
}

impl ExplicitStep<'_> {
    /// One attempt with so many substeps, with the growth of the energy and the energies involved (J); `None` when
    /// it grew too much or a number is not finite.
    pub fn attempt(
        &self,
        substeps: u32,
        within: &mut WithinStep,
        report: &mut StepReport,
    ) -> Result<Option<(BodyOutput, [f64; 2])>, GpuError> {
        let (context, body) = (self.context, self.body);
        let h = self.dt / f64::from(substeps);
        let verlet = self.settings.integrator == Integrator::StormerVerlet;
        let [first, middle, last] =
            KickFactors::of(self.settings, h).map(|KickFactors { keep, kick, drift }| {
                StepUniform { keep, kick, drift, ..StepUniform::default() }
            });

        // state and forces at the start
        let mut varying = Varying {
            load: self.load.to_vec(),
            place: self.place[0].to_vec(),
            differences: Vec::new(),
            ways: Vec::new(),
        };
        let varies = self.varies(within);
        self.write_load(within, 0.0, &mut varying);
        self.write_place(within, if varies { 0.0 } else { 1.0 }, &mut varying);
        body.set(context, first);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| body.each_row(pass, "explicit_begin"));
        body.forces(&mut recorder);
        recorder.submit();
        report.evaluations += 1 + substeps;
        // substeps
        let mut done = 0;
        while done < substeps {
            // the first has factors of its own; what varies comes with every substep
            let count = if done == 0 || varies { 1 } else { (substeps - done).min(BATCH) };
            let part = f64::from(done + count) / f64::from(substeps);
            if varies {
                self.write_place(within, part, &mut varying);
            }
            body.set(context, if done == 0 { first } else { middle });
            let mut recorder = context.record();
            for _ in 0..count {
                recorder.pass(Phase::Rows, |pass| body.each_row(pass, "kick_and_drift"));
                body.forces(&mut recorder);
                if !varies {
                    recorder.pass(Phase::Rows, |pass| body.each_row(pass, "close_books"));
                }
            }
            recorder.submit();
            if varies {
                self.write_load(within, part, &mut varying);
                let mut recorder = context.record();
                recorder.pass(Phase::Rows, |pass| body.each_row(pass, "close_books"));
                recorder.submit();
            }
            done += count;
        }
        // the last half kick, energies and the state
        body.set(context, last);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| {
            if verlet {
                body.each_row(pass, "kick_and_drift");
            }
            body.summing(pass, "measure_explicit");
        });
        let sums = body.read_sums(&mut recorder, 3);
        body.energies(&mut recorder);
        let energies = body.read_energies(&mut recorder);
        let u = body.read_rows(&mut recorder, RowSlot::Y);
        let v = body.read_rows(&mut recorder, RowSlot::Step);
        recorder.submit();
        let sums = sums.wait::<[f32; 4]>(context)?;
        let elastic = total(&energies.wait::<[f32; 4]>(context)?, 1, 0, 0);
        let (u, v) = (u.wait(context)?, v.wait(context)?);

        // energy books
        let end = |at: usize, k: usize| total(&sums, 3, at, k);
        let (kinetic, held) = (end(0, 0), end(0, 1));
        let (constraint_work, load_work) = (end(0, 2), end(0, 3));
        let [elastic0, kinetic0, held0] = self.before;
        let change = elastic - elastic0 - load_work;
        let scale = kinetic0 + kinetic + elastic.abs() + change.abs() + constraint_work.abs();
        let grown = kinetic - kinetic0 + change - constraint_work;
        let bad = end(1, 3) > 0.0;
        if bad || !grown.is_finite() || grown > GROWTH[usize::from(verlet)] * scale {
            return Ok(None);
        }
        report.elastic_energy = elastic;
        report.kinetic_energy = kinetic + held;
        report.constraint_work = constraint_work + held - held0;
        report.load_work = load_work;
        report.dissipation = -grown;
        report.damping_dissipation = self.settings.mass_damping * self.dt * (kinetic0 + kinetic);
        for k in 0..3 {
            report.momentum[k] = end(1, k);
            report.angular_momentum[k] = end(2, k);
        }
        Ok(Some((BodyOutput { u, v, finite: true, ..BodyOutput::default() }, [grown, scale])))
    }

    fn varies(&self, within: &WithinStep) -> bool {
        let own = |row: VertexRow| self.rows.contains(&row.index());
        within.loaded.iter().any(|&row| own(row)) || within.moving.iter().any(|m| own(m.row))
    }

    /// Loads when `part` of the step has passed.
    fn write_load(&self, within: &WithinStep, part: f64, varying: &mut Varying) {
        within.load_differences(part, &mut varying.differences);
        for (&row, difference) in within.loaded.iter().zip(&varying.differences) {
            if self.rows.contains(&row.index()) {
                let local = row.index() - self.rows.start;
                for k in 0..3 {
                    varying.load[local][k] =
                        (f64::from(self.load[local][k]) + difference[k]) as f32;
                }
            }
        }
        self.body.write_rows(self.context, RowSlot::Load, &varying.load);
    }

    /// Held unknowns when `part` of the step has passed.
    fn write_place(&self, within: &mut WithinStep, part: f64, varying: &mut Varying) {
        within.ways(part, &mut varying.ways);
        for (m, way) in within.moving.iter().zip(&varying.ways) {
            if self.rows.contains(&m.row.index()) {
                let (local, k) = (m.row.index() - self.rows.start, m.axis as usize);
                varying.place[local][k] = if part < 1.0 {
                    (f64::from(self.place[0][local][k]) + way) as f32
                } else {
                    self.place[1][local][k]
                };
            }
        }
        self.body.write_rows(self.context, RowSlot::Target, &varying.place);
    }
}
