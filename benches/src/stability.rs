//! The hard cases: cantilevers over a grid of steps and materials, crush and release, collapsed and
//! inverted starts. Every case has a pass criterion; a failing case stays in the table as failing.

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::engine::mesh::{Mesh, MeshError};
use sinew::prelude::*;
use std::fmt;

/// Cell size of the cubes (m); how fast a crushed cube springs back, in steps, depends on it.
const CUBE_CELL: f64 = 0.02;

/// Energy may rise by this much of the case's energy scale: rounding.
const ENERGY_TOLERANCE: f64 = 1e-6;

/// Result of one case.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Group of cases.
    pub group: &'static str,
    /// What was run.
    pub case: String,
    /// All criteria met.
    pub pass: bool,
    /// Counted in the pass criterion, or shown for comparison only.
    pub required: bool,
    /// Finite and total energy never above its start plus outside work.
    pub bounded: bool,
    /// Largest rise of total energy above its start plus outside work, over the energy scale.
    pub energy_excess: f64,
    /// Largest number of inverted elements while it counts, and at the end.
    pub inverted: [u64; 2],
    /// Root mean square of relative edge-length change at the end.
    pub edge_error: f64,
    /// Total energy at the end over that at the start.
    pub energy_left: f64,
    /// Steps, linear systems, steps on a projected tangent, capped velocities.
    pub steps: [u64; 4],
    /// What stopped it, if anything.
    pub error: Option<String>,
}

/// A finished suite.
#[derive(Clone, Debug, Serialize)]
pub struct Suite {
    /// Schema of the JSON form.
    pub schema: &'static str,
    /// Integrator.
    pub integrator: Integrator,
    /// Number type.
    pub precision: &'static str,
    /// One row per case.
    pub rows: Vec<Row>,
}

impl Suite {
    /// Whether every required row passed.
    pub fn passed(&self) -> bool {
        self.rows.iter().all(|r| r.pass || !r.required)
    }
}

/// Choice of cases and solver.
#[derive(Clone, Copy, Debug)]
pub struct SuiteOptions {
    /// A third of the cases, short enough for continuous integration.
    pub quick: bool,
    /// Integrator.
    pub integrator: Integrator,
    /// Number type.
    pub precision: Precision,
}

/// Runs the suite; cases run side by side, one thread each.
///
/// # Errors
/// When a mesh cannot be generated.
pub fn run(options: SuiteOptions) -> Result<Suite, MeshError> {
    let mut cases: Vec<Case> = Vec::new();
    cantilever_cases(options.quick, &mut cases)?;
    release_cases(options.quick, &mut cases)?;
    collapse_cases(options.quick, &mut cases)?;
    let rows = cases.par_iter().map(|case| case.run(&options)).collect();
    Ok(Suite {
        schema: "sinew-stability/1",
        integrator: options.integrator,
        precision: options.precision.name(),
        rows,
    })
}

struct Case {
    group: &'static str,
    name: String,
    required: bool,
    mesh: Mesh,
    material: YoungPoisson,
    dt: f64,
    kind: Kind,
}

enum Kind {
    Cantilever { steps: u64, must_not_invert: bool },
    Release { squeeze: f64, held_must_not_invert: bool },
    Collapse { start: Vec<DVec3>, steps: u64, must_recover: bool },
}

fn material(young_modulus: f64, poisson_ratio: f64) -> YoungPoisson {
    YoungPoisson { young_modulus, poisson_ratio, density: 1000.0 }
}

fn cantilever_cases(quick: bool, cases: &mut Vec<Case>) -> Result<(), MeshError> {
    let mesh = jitter_interior(&box_tets(DVec3::new(0.3, 0.075, 0.075), [12, 3, 3])?, 0.15, 1)?;
    for dt in [1e-4, 1e-3, 1e-2, 1.0 / 30.0, 0.1] {
        for young in [1e3, 1e4, 1e5, 1e6, 1e7] {
            for nu in [0.0, 0.3, 0.45, 0.49, 0.499] {
                if quick && (young == 1e4 || young == 1e6 || nu == 0.3 || nu == 0.49) {
                    continue;
                }
                let material = material(young, nu);
                // the compression term gives way above a nominal stress of 2 (lambda + mu)
                let strength = material.lame().map_or(0.0, |m| 2.0 * (m.lambda + m.mu));
                cases.push(Case {
                    group: "cantilever",
                    name: format!("h {dt:.4} E {young:.0e} nu {nu}"),
                    required: true,
                    mesh: mesh.clone(),
                    material,
                    dt,
                    kind: Kind::Cantilever {
                        steps: 30,
                        must_not_invert: 1000.0 * 9.81 * 0.3 < strength,
                    },
                });
            }
        }
    }
    Ok(())
}

fn release_cases(quick: bool, cases: &mut Vec<Case>) -> Result<(), MeshError> {
    let mesh = jitter_interior(&box_tets(DVec3::splat(4.0 * CUBE_CELL), [4, 4, 4])?, 0.15, 2)?;
    for squeeze in [0.5, 0.8, 0.95] {
        for nu in [0.3, 0.45, 0.49] {
            for dt in [1.0 / 60.0, 0.1] {
                if quick && (nu == 0.49 || squeeze == 0.8) {
                    continue;
                }
                cases.push(Case {
                    group: "release",
                    name: format!("{:.0} % nu {nu} h {dt:.4}", 100.0 * squeeze),
                    required: true,
                    mesh: mesh.clone(),
                    material: material(1e4, nu),
                    dt,
                    kind: Kind::Release { squeeze, held_must_not_invert: squeeze < 0.9 },
                });
            }
        }
    }
    Ok(())
}

fn collapse_cases(quick: bool, cases: &mut Vec<Case>) -> Result<(), MeshError> {
    for cells in if quick { vec![3] } else { vec![3, 5] } {
        let size = cells as f64 * CUBE_CELL;
        let mesh = jitter_interior(&box_tets(DVec3::splat(size), [cells; 3])?, 0.15, 3)?;
        let x = mesh.points.clone();
        let centre = DVec3::splat(size / 2.0);
        let map = |f: &dyn Fn(DVec3) -> DVec3| -> Vec<DVec3> { x.iter().map(|&x| f(x)).collect() };
        let mut starts: Vec<(String, bool, Vec<DVec3>)> = vec![
            ("plane".into(), true, map(&|x| DVec3::new(x.x, x.y, centre.z))),
            ("line".into(), true, map(&|x| DVec3::new(x.x, centre.y, centre.z))),
            ("mirror".into(), true, map(&|x| DVec3::new(x.x, x.y, size - x.z))),
            (
                "folded".into(),
                true,
                map(&|x| if x.z > centre.z { DVec3::new(x.x, x.y, size - x.z) } else { x }),
            ),
            ("pushed through".into(), true, {
                let mut y = x.clone();
                let far = nearest(&x, DVec3::splat(size));
                y[far] = DVec3::splat(-0.3 * size);
                y
            }),
            ("pushed out".into(), true, {
                let mut y = x.clone();
                let inner = nearest(&x, centre);
                y[inner] = DVec3::new(1.5 * size, centre.y, centre.z);
                y
            }),
        ];
        for seed in 0..if quick { 1 } else { 4 } {
            let mut random = Random(0x1234_5678_9abc_def1 + seed);
            starts.push((format!("point {seed}"), false, {
                map(&|_| centre)
                    .into_iter()
                    .map(|c| c + (random.vector() - DVec3::splat(0.5)) * 1e-6 * size)
                    .collect()
            }));
            let mut random = Random(0x2345_6789_abcd_ef12 + seed);
            starts.push((
                format!("random {seed}"),
                false,
                x.iter().map(|_| random.vector() * size).collect(),
            ));
            let mut random = Random(0x3456_789a_bcde_f123 + seed);
            starts.push((
                format!("random 3x {seed}"),
                false,
                x.iter()
                    .map(|_| centre + (random.vector() - DVec3::splat(0.5)) * 3.0 * size)
                    .collect(),
            ));
        }
        for nu in [0.3, 0.45] {
            for dt in [1.0 / 60.0, 0.1] {
                if quick && dt == 0.1 {
                    continue;
                }
                for (name, must_recover, start) in &starts {
                    cases.push(Case {
                        group: "collapse",
                        name: format!("{name} {cells}^3 nu {nu} h {dt:.4}"),
                        required: true,
                        mesh: mesh.clone(),
                        material: material(1e4, nu),
                        dt,
                        kind: Kind::Collapse {
                            start: start.clone(),
                            steps: 180,
                            must_recover: *must_recover,
                        },
                    });
                }
            }
        }
    }
    Ok(())
}

fn nearest(points: &[DVec3], to: DVec3) -> usize {
    let by_distance =
        |a: &usize, b: &usize| points[*a].distance(to).total_cmp(&points[*b].distance(to));
    (0..points.len()).min_by(by_distance).unwrap_or(0)
}

/// A small generator of random numbers: the suite must be the same everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// Total energy along a run, against its start plus outside work.
struct Ledger {
    start: f64,
    outside: f64,
    scale: f64,
    excess: f64,
    counts: [u64; 4],
}

impl Ledger {
    fn new(start: f64, scale: f64) -> Self {
        Self { start, outside: 0.0, scale, excess: 0.0, counts: [0; 4] }
    }

    /// Books a step; kinetic plus elastic energy at its end.
    fn step(&mut self, report: &StepReport) -> f64 {
        self.outside += report.load_work + report.constraint_work;
        let energy = report.kinetic_energy + report.elastic_energy;
        self.excess = self.excess.max((energy - self.start - self.outside) / self.scale);
        self.counts[0] += 1;
        self.counts[1] += u64::from(report.newton_iterations);
        self.counts[2] += u64::from(report.projections > 0);
        self.counts[3] += u64::from(report.energy_caps > 0);
        energy
    }
}

impl Case {
    fn run(&self, options: &SuiteOptions) -> Row {
        let mut row = Row {
            group: self.group,
            case: self.name.clone(),
            pass: false,
            required: self.required,
            bounded: false,
            energy_excess: f64::NAN,
            inverted: [0; 2],
            edge_error: f64::NAN,
            energy_left: f64::NAN,
            steps: [0; 4],
            error: None,
        };
        if let Err(error) = self.simulate(options, &mut row) {
            row.error = Some(error.to_string());
            row.bounded = false;
            row.pass = false;
        }
        row
    }

    fn simulate(
        &self,
        options: &SuiteOptions,
        row: &mut Row,
    ) -> Result<(), Box<dyn std::error::Error>> {
        let mut simulation = Simulation::new(SimulationOptions {
            precision: options.precision,
            threads: 1,
            ..Default::default()
        })?;
        let body = simulation.add_body(&BodyDescription {
            model: Model::CompressibleStVK,
            evaluation: Evaluation::Fused,
            ..BodyDescription::new("body", &self.mesh, self.material)
        })?;
        simulation.set_dt(self.dt);
        simulation.set_gravity(DVec3::ZERO);
        // f32 energies carry rounding of 1e-7 of their parts
        let tolerance = match options.precision {
            Precision::F64 => ENERGY_TOLERANCE,
            Precision::F32 => 1e-4,
        };
        let mut solver = SolverSettings { integrator: options.integrator, ..Default::default() };
        let face = |name: &str| -> Vec<u32> {
            self.mesh.group(name).map_or_else(Vec::new, |g| g.vertices.clone())
        };
        let ledger = match &self.kind {
            Kind::Cantilever { steps, must_not_invert } => {
                simulation.set_solver(solver);
                simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
                let rows = simulation.rows(body, "clamp", &face("x0"))?;
                simulation.add_constraint(Constraint::hold("clamp", rows));
                let mass: f64 = simulation.masses(body).iter().sum();
                let mut ledger = Ledger::new(0.0, mass * 9.81 * 0.3);
                for _ in 0..*steps {
                    simulation.step()?;
                    ledger.step(simulation.report());
                    row.inverted[0] = row.inverted[0].max(simulation.volume_report().inverted);
                }
                row.inverted[1] = simulation.volume_report().inverted;
                row.bounded = ledger.excess <= tolerance;
                row.pass = row.bounded && (!must_not_invert || row.inverted[0] == 0);
                row.energy_left = f64::NAN;
                ledger
            }
            Kind::Release { squeeze, held_must_not_invert } => {
                solver.mass_damping = 3.5;
                simulation.set_solver(solver);
                let ramp = 0.5;
                let held = 10.0 * self.dt;
                let steps = ((ramp + held + 1.5) / self.dt).round() as u64;
                let released_after = ((ramp + held) / self.dt).round() as u64;
                for (name, way) in [("x0", 2.0 * CUBE_CELL), ("x1", -2.0 * CUBE_CELL)] {
                    let rows = simulation.rows(body, name, &face(name))?;
                    let motion = Motion::Translate(DVec3::X * way * *squeeze);
                    let mut constraint =
                        Constraint::moving(name, rows, motion, Curve::ramp(0.0, ramp));
                    constraint.until = (released_after as f64 + 0.5) * self.dt;
                    simulation.add_constraint(constraint);
                }
                let mut driven = Ledger::new(0.0, 1.0);
                for _ in 0..released_after {
                    simulation.step()?;
                    driven.step(simulation.report());
                    let inverted = simulation.volume_report().inverted;
                    if simulation.time() > ramp {
                        row.inverted[0] = row.inverted[0].max(inverted);
                    }
                }
                let report = simulation.report();
                let start = report.elastic_energy + report.kinetic_energy;
                let mut ledger = Ledger::new(start, start);
                let mut energy = start;
                for _ in released_after..steps {
                    simulation.step()?;
                    energy = ledger.step(simulation.report());
                }
                row.energy_left = energy / start;
                row.inverted[1] = simulation.volume_report().inverted;
                row.edge_error = edge_error(&mut simulation, body, &self.mesh);
                // the driven phase was booked in joules
                ledger.excess = ledger.excess.max(driven.excess / start);
                row.bounded = ledger.excess <= tolerance;
                row.pass = row.bounded
                    && (!held_must_not_invert || row.inverted[0] == 0)
                    && row.inverted[1] == 0
                    && row.edge_error < 0.01;
                ledger
            }
            Kind::Collapse { start, steps, must_recover } => {
                solver.mass_damping = 3.5;
                simulation.set_solver(solver);
                let u: Vec<DVec3> =
                    start.iter().zip(&self.mesh.points).map(|(x, r)| *x - *r).collect();
                simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()])?;
                let energy0 = simulation.evaluate();
                let mut ledger = Ledger::new(energy0, energy0);
                let mut energy = energy0;
                for _ in 0..*steps {
                    simulation.step()?;
                    energy = ledger.step(simulation.report());
                    row.inverted[0] = row.inverted[0].max(simulation.volume_report().inverted);
                }
                row.energy_left = energy / energy0;
                row.inverted[1] = simulation.volume_report().inverted;
                row.edge_error = edge_error(&mut simulation, body, &self.mesh);
                row.bounded = ledger.excess <= tolerance;
                let tets = self.mesh.tetrahedra.len() as f64;
                row.pass = row.bounded
                    && if *must_recover {
                        row.edge_error < 0.01 && row.inverted[1] == 0
                    } else {
                        row.energy_left < 0.05 && row.inverted[1] as f64 <= 0.02 * tets
                    };
                ledger
            }
        };
        row.energy_excess = ledger.excess;
        row.steps = ledger.counts;
        Ok(())
    }
}

/// Root mean square over edges of relative length change.
fn edge_error(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) -> f64 {
    let u = simulation.displacements(body);
    let rows = simulation.topology().bodies[body.0].clone();
    let edges = simulation.topology().edges.clone();
    let mut sum = 0.0;
    for [a, b] in &edges {
        let [a, b] = [a, b].map(|r| rows.vertex_order[(r - rows.vertices.start) as usize] as usize);
        let rest = mesh.points[a].distance(mesh.points[b]);
        let now = (mesh.points[a] + u[a]).distance(mesh.points[b] + u[b]);
        sum += (now / rest - 1.0).powi(2);
    }
    (sum / edges.len() as f64).sqrt()
}

impl fmt::Display for Suite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<11} {:<34} {:>5} {:>9} {:>9} {:>9} {:>8} {:>6} {:>6} {:>5}",
            "group",
            "case",
            "pass",
            "energy+",
            "inverted",
            "edge err",
            "H/H0",
            "solves",
            "proj",
            "cap"
        )?;
        for r in &self.rows {
            writeln!(
                f,
                "{:<11} {:<34} {:>5} {:>9.1e} {:>9} {:>9.1e} {:>8.1e} {:>6} {:>6} {:>5}{}",
                r.group,
                r.case,
                if r.pass { "ok" } else { "FAIL" },
                r.energy_excess,
                format!("{}/{}", r.inverted[0], r.inverted[1]),
                r.edge_error,
                r.energy_left,
                r.steps[1],
                r.steps[2],
                r.steps[3],
                r.error.as_ref().map_or(String::new(), |e| format!("  {e}")),
            )?;
        }
        writeln!(f)?;
        for group in ["cantilever", "release", "collapse"] {
            let rows: Vec<&Row> = self.rows.iter().filter(|r| r.group == group).collect();
            let count = |p: &dyn Fn(&Row) -> bool| rows.iter().filter(|r| p(r)).count();
            writeln!(
                f,
                "{group:<11} pass {:>3} of {:>3}   bounded {:>3}   edge error below 1 % {:>3}   \
                 not inverted at the end {:>3}",
                count(&|r| r.pass),
                rows.len(),
                count(&|r| r.bounded),
                count(&|r| r.edge_error < 0.01),
                count(&|r| r.inverted[1] == 0 && r.error.is_none()),
            )?;
        }
        Ok(())
    }
}
