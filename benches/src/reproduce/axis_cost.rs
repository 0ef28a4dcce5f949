//! Bourguignon & Cani 2000, table 1: seconds of computing per second of motion.

use super::frame::world;
use crate::bench::error::BenchError;
use crate::report::{Figure, Finding};
use sinew::engine::mesh::generate::{box_hexahedra, irregular_box_tets};
use sinew::engine::step::StepError;
use sinew::engine::vertex::FixedAxes;
use sinew::models::axes::description::{AxesDescription, AxisForm};
use sinew::prelude::*;
use sinew_tune::table_of;
use std::time::Instant;

const SIDE: f64 = 0.1;
const CELLS: [usize; 3] = [5, 5, 5];
const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.4, density: 1000.0 };
/// Step (s) of the paper, and steps that are timed.
const STEP: f64 = 0.01;
const STEPS: usize = 100;
/// Times each is run; the fastest counts.
const RUNS: usize = 3;

/// A row of the table.
struct Line {
    name: &'static str,
    hexahedra: bool,
    axes: Option<AxisForm>,
    /// Time (s) in the paper.
    printed: Option<f64>,
}

const fn line(
    name: &'static str,
    hexahedra: bool,
    axes: Option<AxisForm>,
    printed: Option<f64>,
) -> Line {
    Line { name, hexahedra, axes, printed }
}

const LINES: [Line; 7] = [
    line("mass-spring", false, None, Some(0.129)),
    line("mass-spring", true, None, Some(0.117)),
    line("axes, printed", false, Some(AxisForm::Printed), Some(1.867)),
    line("axes, with energy", false, Some(AxisForm::EnergyConsistent), Some(1.867)),
    line("axes, with energy", true, Some(AxisForm::EnergyConsistent), Some(0.427)),
    // without the resultant of the springs of volume, which push hexahedra about until explicit steps give up
    line("axes, printed but balanced", true, Some(AxisForm::PrintedBalanced), Some(0.427)),
    line("St Venant-Kirchhoff", false, None, None),
];

/// Seconds of computing per second of motion, and explicit substeps per step.
fn time(line: &Line, integrator: Integrator, steps: usize) -> Result<(f64, f64), BenchError> {
    let size = DVec3::splat(SIDE);
    let mesh = match line.hexahedra {
        true => box_hexahedra(size, CELLS)?,
        false => irregular_box_tets(size, CELLS, 0.15, 0)?,
    };
    let axes = match line.axes {
        Some(form) => {
            Some(AxesDescription { form, ..AxesDescription::isotropic(MATERIAL.lame()?) })
        }
        None => None,
    };
    let model = match (&axes, line.printed) {
        (Some(_), _) => Model::Axes,
        (None, Some(_)) => Model::MassSpring,
        (None, None) => Model::CompressibleStVK,
    };
    let solver = SolverSettings { integrator, mass_damping: 2.0, ..SolverSettings::default() };
    let description = BodyDescription::new("block", &mesh, MATERIAL);
    let (mut simulation, body) = world(&BodyDescription { model, axes, ..description }, solver)?;
    simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    simulation.set_dt(STEP);
    let mut table = Constraint::hold("table", simulation.group_rows(body, &mesh, "z0")?);
    table.axes = FixedAxes(4);
    simulation.add_constraint(table);
    let failed = |e: StepError| BenchError::NoTruth {
        case: format!("{}, {}", line.name, integrator.name()),
        reason: e.to_string(),
    };
    simulation.step().map_err(failed)?;
    let (start, mut substeps) = (Instant::now(), 0.0);
    for _ in 0..steps {
        simulation.step().map_err(failed)?;
        substeps += f64::from(simulation.report().substeps);
    }
    let simulated = STEP * steps as f64;
    Ok((start.elapsed().as_secs_f64() / simulated, substeps / steps as f64))
}

pub(super) fn figure() -> Result<Figure, BenchError> {
    let mut measured = Vec::new();
    for line in &LINES {
        let (mut explicit, mut implicit, mut substeps) = (f64::INFINITY, f64::INFINITY, 0.0);
        for _ in 0..RUNS {
            let (seconds, count) = time(line, Integrator::StormerVerlet, STEPS)?;
            (explicit, substeps) = (explicit.min(seconds), count);
            implicit = implicit.min(time(line, Integrator::Auto, STEPS)?.0);
        }
        measured.push((explicit, explicit / substeps.max(1.0), implicit, substeps));
    }
    let title = "Seconds of computing per second of motion, one thread";
    let rows = LINES.iter().zip(&measured);
    let table = table_of!("d-time", title; for (line, (explicit, each, implicit, substeps)) in rows;
        "model" => line.name, "mesh" => if line.hexahedra { "hexahedra" } else { "tetrahedra" },
        "masses" => 216_usize, "elements" => if line.hexahedra { 125_usize } else { 750 },
        "paper s" => line.printed, "explicit s" => *explicit, "substeps" => *substeps,
        "per substep of 0.01 s: s" => *each, "implicit s" => *implicit,
    )
    .note(
        "explicit: Störmer-Verlet with the substeps that stability asks for; per substep: what it would take \
         with one evaluation a step, as in the paper; implicit: the default integrator.",
    );
    let each = |i: usize| measured.get(i).map_or(f64::NAN, |m| m.1);
    let slowest = measured.iter().map(|m| m.2).fold(0.0, f64::max);
    let findings = vec![
        Finding::of(each(2) > each(0) && each(4) > each(1)).says(format!(
                "axes cost more than plain springs: {:.1} times as much on tetrahedra in the printed form, {:.1} times \
                 with an energy, {:.1} and {:.1} times on hexahedra; 14.5 and 3.6 times in the paper",
                each(2) / each(0),
                each(3) / each(0),
                each(5) / each(1),
                each(4) / each(1)
            )),
        Finding::of(each(5) < each(2)).says(format!(
                "hexahedra are the cheaper mesh for axes: {:.2} of the time of tetrahedra in the printed form, with one \
                 set of axes in each (0.23 in the paper); {:.2} with an energy, where each hexahedron has axes at \
                 eight Gauss points",
                each(5) / each(2),
                each(4) / each(3)
            )),
        Finding::of(slowest < 1.0).says(format!(
                "all run in real time, which in the paper the tetrahedra with axes did not: {slowest:.3} s per second \
                 at most with the default integrator"
            )),
    ];
    Ok(Figure {
        setting: format!(
            "A cube on a table under gravity, step {STEP} s as in the paper (SGI O2, R5000 at 300 MHz, Störmer's \
             method without adaptive step); 216 masses and 750 tetrahedra or 125 hexahedra (222 and 804, 216 and \
             125 in the paper), E = {} Pa; the fastest of {RUNS} runs of {STEPS} steps.",
            MATERIAL.young_modulus
        ),
        findings,
        tables: vec![table],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_runs_with_both_integrators() {
        for line in &LINES {
            let (seconds, substeps) = time(line, Integrator::StormerVerlet, 2).unwrap();
            assert!(seconds > 0.0 && substeps >= 1.0, "{}", line.name);
            assert!(time(line, Integrator::Auto, 2).unwrap().0 > 0.0);
        }
    }
}
