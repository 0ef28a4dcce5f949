//! Bourguignon & Cani 2000, table 1: seconds of computing per second of motion, with the springs of the paper.

use super::frame::{damped_axes, stormer, uniform, world, world_of_axes};
use super::prelude::*;
use crate::axes::springs::VolumeForm::{self, Balanced, Printed};
use sinew::engine::element::EdgeVertices;
use sinew::engine::mesh::generate::{box_hexahedra, irregular_box_tets};
use sinew::engine::vertex::FixedAxes;
use sinew::models::body::MassRule;

const SIDE: f64 = 0.1;
const CELLS: [usize; 3] = [5, 5, 5];
const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.4, density: 1000.0 };
/// Step (s) of the paper, and steps that are timed.
const STEP: f64 = 0.01;
const STEPS: usize = 100;
/// Times each is run; the fastest counts.
const RUNS: usize = 3;

/// Mass damping (1/s), which plain springs have in the place of dampers, and viscosity (Pa s) of the dampers of axes.
const DAMPING: f64 = 2.0;
const VISCOSITY: f64 = 10.0;

/// A row of the table.
struct Line {
    name: &'static str,
    hexahedra: bool,
    /// Its axes, if it has some: printed ones, or some with an energy.
    axes: Option<Option<VolumeForm>>,
    /// Springs, and time (s), in the paper.
    printed: Option<(usize, f64)>,
}

const fn line(
    name: &'static str,
    hexahedra: bool,
    axes: Option<Option<VolumeForm>>,
    printed: Option<(usize, f64)>,
) -> Line {
    Line { name, hexahedra, axes, printed }
}

/// The rows of the paper's table, then what stands beside them.
const LINES: [Line; 8] = [
    line("mass-spring", false, None, Some((1175, 0.129))),
    line("mass-spring", true, None, Some((1040, 0.117))),
    line("axes, printed", false, Some(Some(Printed)), Some((8040, 1.867))),
    line("axes, printed", true, Some(Some(Printed)), Some((1750, 0.427))),
    line("axes, printed but balanced", true, Some(Some(Balanced)), None),
    line("axes, with energy", false, Some(None), None),
    line("axes, with energy", true, Some(None), None),
    line("St Venant-Kirchhoff", false, None, None),
];

impl Line {
    fn mesh(&self) -> Result<Mesh> {
        let size = DVec3::splat(SIDE);
        Ok(match self.hexahedra {
            true => box_hexahedra(size, CELLS)?,
            false => irregular_box_tets(size, CELLS, 0.15, 0)?,
        })
    }

    fn elements(&self) -> usize {
        CELLS.iter().product::<usize>() * if self.hexahedra { 1 } else { 6 }
    }

    /// Number of springs as the paper counts them: one for every pair of vertices, or 3 axial, 3 angular and one of
    /// volume for every vertex of an element; `None` for other laws.
    fn springs(&self, simulation: &mut Simulation) -> Option<usize> {
        match self.axes {
            Some(_) => Some(self.elements() * if self.hexahedra { 14 } else { 10 }),
            None if self.printed.is_none() => None,
            None => {
                let mut springs = simulation.world_mut().query::<&EdgeVertices>();
                Some(springs.iter(simulation.world_mut()).len())
            }
        }
    }
}

/// What a row takes.
struct Timed {
    /// Seconds of computing per second of motion, and explicit substeps per step; not numbers where a step could not be
    /// carried out.
    seconds: f64,
    substeps: f64,
    springs: Option<usize>,
}

fn time(line: &Line, integrator: Integrator, steps: usize) -> Result<Timed> {
    let mesh = line.mesh()?;
    let model = if line.printed.is_some() { Model::MassSpring } else { Model::CompressibleStVK };
    let description = BodyDescription {
        model,
        springs: uniform(MATERIAL.young_modulus * SIDE / CELLS[0] as f64),
        masses: MassRule::Equal,
        ..BodyDescription::new("block", &mesh, MATERIAL)
    };
    let solver = SolverSettings { integrator, ..stormer(DAMPING) };
    let (mut simulation, body) = match line.axes {
        Some(form) => world_of_axes(description, damped_axes(MATERIAL, VISCOSITY)?, form, solver)?,
        None => world(&description, solver)?,
    };
    simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    simulation.set_dt(STEP);
    let mut table = Constraint::hold("table", simulation.group_rows(body, &mesh, "z0")?);
    table.axes = FixedAxes(4);
    simulation.add_constraint(table);
    let springs = line.springs(&mut simulation);
    let failed = Timed { seconds: f64::NAN, substeps: f64::NAN, springs };
    if simulation.step().is_err() {
        return Ok(failed);
    }
    let (start, mut substeps) = (Instant::now(), 0.0);
    for _ in 0..steps {
        if simulation.step().is_err() {
            return Ok(failed);
        }
        substeps += f64::from(simulation.report().substeps);
    }
    let (simulated, steps) = (STEP * steps as f64, steps as f64);
    Ok(Timed {
        seconds: start.elapsed().as_secs_f64() / simulated,
        substeps: substeps / steps,
        springs,
    })
}

/// A row, measured.
struct Measured {
    explicit: Timed,
    /// Seconds per second of motion with one evaluation in a step.
    each: f64,
    implicit: f64,
}

fn measure(line: &Line) -> Result<Measured> {
    let mut explicit = time(line, Integrator::StormerVerlet, STEPS)?;
    let mut implicit = f64::NAN;
    for _ in 0..RUNS {
        explicit.seconds =
            explicit.seconds.min(time(line, Integrator::StormerVerlet, STEPS)?.seconds);
        implicit = implicit.min(time(line, Integrator::Auto, STEPS)?.seconds);
    }
    let each = explicit.seconds / explicit.substeps.max(1.0);
    Ok(Measured { explicit, each, implicit })
}

/// A ratio of times agrees with that of the paper within this factor: machines and code differ, the counts of springs
/// do not.
const WITHIN: f64 = 2.0;

fn finding_of_ratio(what: &str, own: f64, paper: f64) -> Finding {
    let agrees = own < WITHIN * paper && own > paper / WITHIN;
    Finding::of_times(agrees).says(format!(
        "{what}: {own:.2} times the time, {paper:.2} times in the paper (a factor of {WITHIN} allowed either way)"
    ))
}

pub(crate) fn figure() -> Result<Figure> {
    let measured: Vec<Measured> = LINES.iter().map(measure).collect::<Result<_, _>>()?;
    let title = "Seconds of computing per second of motion, one thread";
    let rows = LINES.iter().zip(&measured);
    let table = table_of!("d-time", title; for (line, m) in rows;
        where { let elements = line.elements(); }
        "model" => line.name, "mesh" => if line.hexahedra { "hexahedra" } else { "tetrahedra" },
        "masses" => 216_usize, "elements" => elements, "springs" => m.explicit.springs,
        "springs per element" => m.explicit.springs.map(|n| n as f64 / elements as f64),
        "paper springs" => line.printed.map(|p| p.0), "paper s" => line.printed.map(|p| p.1),
        "one evaluation a step: s" => m.each, "explicit s" => m.explicit.seconds,
        "substeps" => m.explicit.substeps, "implicit s" => m.implicit,
    )
    .note(
        "one evaluation a step: Störmer-Verlet at 0.01 s without substeps, as in the paper; explicit: with the substeps \
         that stability asks for; implicit: the default integrator. Springs of axes are counted as in the paper.",
    );
    let each = |i: usize| measured.get(i).map_or(f64::NAN, |m| m.each);
    let own = |i: usize| measured.get(i).map_or(f64::NAN, |m| m.explicit.seconds);
    let printed = |i: usize| LINES[i].printed.map_or(f64::NAN, |p| p.1);
    let ratio = |what: &str, i: usize, j: usize| {
        finding_of_ratio(what, each(i) / each(j), printed(i) / printed(j))
    };
    let counts = measured.get(1).and_then(|m| m.explicit.springs);
    let findings = vec![
        Finding::of(counts == Some(1040)).says(format!(
            "plain springs of 125 hexahedra are {} (1040 in the paper, 12 edges and 4 diagonals of each)",
            counts.unwrap_or(0)
        )),
        ratio("axes, printed, beside plain springs, on tetrahedra", 2, 0),
        ratio("axes, printed, beside plain springs, on hexahedra", 3, 1),
        ratio("axes, printed, on hexahedra beside tetrahedra", 3, 2),
        Finding::of_times(own(3) < 1.0).says(format!(
            "hexahedra with axes run in real time with the substeps that stability asks for: {:.2} s per second on one \
             thread of this machine, tetrahedra {:.2} s (0.43 and 1.87 s in the paper)",
            own(3),
            own(2)
        )),
    ];
    Ok(Figure {
        setting: format!(
            "A cube on a table under gravity, step {STEP} s as in the paper (SGI O2, R5000 at 300 MHz, Störmer's \
             method without adaptive step); 216 equal masses and 750 tetrahedra or 125 hexahedra (222 and 804, 216 and \
             125 in the paper), E = {} Pa; axes with dampers of {VISCOSITY} Pa s, mass damping {DAMPING} 1/s; plain \
             springs of one constant, E times the size of a cell; the fastest of {} runs of {STEPS} steps. The printed \
             form is written for one element at a time, other laws for registers of elements.",
            MATERIAL.young_modulus,
            RUNS + 1,
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
            let explicit = time(line, Integrator::StormerVerlet, 2).unwrap();
            assert!(explicit.seconds > 0.0 && explicit.substeps >= 1.0, "{}", line.name);
            assert!(time(line, Integrator::Auto, 2).unwrap().seconds > 0.0);
        }
        let of_hexahedra = time(&LINES[1], Integrator::StormerVerlet, 1).unwrap();
        assert_eq!(of_hexahedra.springs, Some(1040));
    }

    #[test]
    fn ratios_are_judged_to_either_side() {
        let agrees = |own| finding_of_ratio("", own, 4.0).agrees();
        assert!(agrees(7.9) && agrees(2.1) && !agrees(8.1) && !agrees(1.9) && !agrees(f64::NAN));
    }
}
