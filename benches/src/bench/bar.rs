//! A bar that hangs and swings under its weight, against published tables: cases CSM1 to CSM3 of Turek & Hron 2006, "Proposal
//! for numerical benchmarking of fluid-structure interaction", the structure alone. St Venant-Kirchhoff in plane strain, 0.35
//! by 0.02 m, held at one end, gravity 2 m/s^2.

use crate::toolbox::prelude::*;
use crate::toolbox::stats::median;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::engine::report::Fallbacks;
use sinew::engine::vertex::FixedAxes;
use sinew::models::body::Integration;

/// Size (m) across and along.
const SIZE: [f64; 2] = [0.02, 0.35];
/// Young's modulus (Pa) of CSM1 and CSM2, and where the middle of the free end comes to rest (mm).
pub const AT_REST: [(f64, [f64; 2]); 2] = [(1.4e6, [-7.187, -66.10]), (5.6e6, [-0.469, -16.97])];
/// Amplitude (mm) of that place across the bar, and frequency (Hz), of CSM3: the material of CSM1 from rest.
pub const MOTION: [f64; 2] = [65.160, 1.0995];

/// What the bar is cut into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BarElements {
    /// Linear tetrahedra.
    Linear,
    /// Ten-node tetrahedra.
    TenNode,
    /// Hexahedra.
    Hexahedra(Integration),
}

impl BarElements {
    const ALL: [Self; 4] = [
        Self::Linear,
        Self::TenNode,
        Self::Hexahedra(Integration::Full),
        Self::Hexahedra(Integration::Reduced),
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear tetrahedra",
            Self::TenNode => "ten-node tetrahedra",
            Self::Hexahedra(Integration::Full) => "hexahedra",
            Self::Hexahedra(Integration::Reduced) => "reduced hexahedra",
        }
    }
}

/// The bar, and the middle of its free end among the vertices.
pub struct Bar {
    /// It alone.
    pub simulation: Simulation,
    /// The bar.
    pub body: BodyHandle,
    tip: usize,
}

impl Bar {
    /// With this Young's modulus (Pa) and an even number of cells across.
    ///
    /// # Errors
    /// When it cannot be built.
    pub fn new(elements: BarElements, young_modulus: f64, across: usize) -> Result<Self> {
        let [width, length] = SIZE;
        let size = DVec3::new(length, width, width / across as f64);
        let cells = [35 * across / 2, across, 1];
        let mut mesh = match elements {
            BarElements::Hexahedra(_) => box_hexahedra(size, cells)?,
            _ => box_tets(size, cells)?,
        };
        for x in &mut mesh.points {
            // the cylinder that holds the bar has a radius of 0.05 m: its middle is the shortest part
            let y = x.y - 0.5 * width;
            let start = (0.05 * 0.05 - y * y).sqrt() - 0.05;
            x.x = start + x.x / length * (length - start);
        }
        if elements == BarElements::TenNode {
            mesh = mesh.with_second_order();
        }
        let material = YoungPoisson { young_modulus, poisson_ratio: 0.4, density: 1000.0 };
        let integration = match elements {
            BarElements::Hexahedra(integration) => integration,
            _ => Integration::default(),
        };
        let body = BodyDescription::new("bar", &mesh, material);
        let description = BodyDescription { model: Model::StVK, integration, ..body };
        let options = SimulationOptions { threads: 1, exclusive: true, ..Default::default() };
        let mut simulation = Simulation::new(options)?;
        let body = simulation.add_body(&description)?;
        let rows = simulation.group_rows(body, &mesh, "x0")?;
        simulation.add_constraint(Constraint::hold("clamp", rows));
        let all: Vec<u32> = (0..mesh.points.len() as u32).collect();
        let rows = simulation.rows(body, "plane", &all)?;
        let mut plane = Constraint::hold("plane", rows);
        plane.axes = FixedAxes(0b100);
        simulation.add_constraint(plane);
        simulation.set_gravity(DVec3::new(0.0, -2.0, 0.0));
        let end = size * DVec3::new(1.0, 0.5, 0.5);
        let distance = |v: &usize| mesh.points[*v].distance(end);
        let tip = (0..mesh.points.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        Ok(Self { simulation, body, tip: tip.unwrap_or(0) })
    }

    /// Displacement (mm) of the middle of the free end.
    pub fn tip(&mut self) -> DVec3 {
        1e3 * self.simulation.displacements(self.body)[self.tip]
    }

    fn solve_by(&mut self, integrator: Integrator) {
        self.simulation.set_solver(SolverSettings { integrator, ..Default::default() });
    }

    /// Where it comes to rest (mm).
    ///
    /// # Errors
    /// When no equilibrium is found.
    pub fn at_rest(&mut self) -> Result<DVec3> {
        self.solve_by(Integrator::QuasiStatic);
        self.simulation.step()?;
        let report = self.simulation.report();
        if report.unconverged {
            let reason = format!("{} iterations of Newton's method", report.newton_iterations);
            return Err(BenchError::NoTruth { case: "bar at rest".into(), reason });
        }
        Ok(self.tip())
    }

    /// Ten seconds in steps of `dt` (s).
    ///
    /// # Errors
    /// When a step fails.
    pub fn swing(&mut self, integrator: Integrator, dt: f64) -> Result<BarSwing> {
        self.simulation.set_dt(dt);
        self.solve_by(integrator);
        let mut swing = BarSwing { steps: (10.0 / dt).round() as u64, ..BarSwing::default() };
        let (mut path, mut work, mut milliseconds) = (vec![0.0], 0.0, Vec::new());
        for _ in 0..swing.steps {
            let clock = Instant::now();
            self.simulation.step()?;
            milliseconds.push(1e3 * clock.elapsed().as_secs_f64());
            let report = self.simulation.report();
            swing.second_order += u64::from(report.second_order_steps);
            swing.safe += u64::from(report.fallbacks != Fallbacks::default());
            work += report.load_work;
            let whole = report.elastic_energy + report.kinetic_energy - work;
            swing.energy = swing.energy.max(whole);
            swing.kinetic = swing.kinetic.max(report.kinetic_energy);
            path.push(self.tip().y);
        }
        swing.ms = median(&milliseconds).unwrap_or(f64::NAN);
        // turns, from the parabola through three places
        let mut turns = Vec::new();
        for (i, y) in path.windows(3).enumerate() {
            let (slope, curve) = (0.5 * (y[2] - y[0]), y[0] - 2.0 * y[1] + y[2]);
            if (y[1] - y[0]) * (y[2] - y[1]) <= 0.0 && curve != 0.0 {
                let time = (i + 1) as f64 - slope / curve;
                turns.push((time * dt, y[1] - 0.5 * slope * slope / curve));
            }
        }
        if let [first, second, .., before, last] = turns[..] {
            swing.amplitude = [second.1 - first.1, last.1 - before.1].map(|way| 0.5 * way.abs());
            swing.frequency = 0.5 * (turns.len() - 1) as f64 / (last.0 - first.0);
        }
        Ok(swing)
    }
}

/// What a swing looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BarSwing {
    /// Half of the way (mm) of the tip from one turn to the next, first and last.
    pub amplitude: [f64; 2],
    /// Hz.
    pub frequency: f64,
    /// Linearised steps of second order.
    pub second_order: u64,
    /// Steps that a scheme of second order left to the safe step.
    pub safe: u64,
    /// All steps.
    pub steps: u64,
    /// Largest kinetic and potential energy (J): it starts with none.
    pub energy: f64,
    /// Largest kinetic energy (J).
    pub kinetic: f64,
    /// Median time (ms) of a step.
    pub ms: f64,
}

impl BarSwing {
    /// Share of the first amplitude that the last has lost.
    pub fn lost(&self) -> f64 {
        1.0 - self.amplitude[1] / self.amplitude[0]
    }
}

/// The bar at rest by kinds of elements, and in motion by integrators.
///
/// # Errors
/// When the bar cannot be built or a step fails.
pub fn run(
    integrators: &[Integrator],
    quick: bool,
    tell: &mut impl FnMut(&str),
) -> Result<Vec<Table>> {
    let off = |found: f64, published: f64| 100.0 * (found / published - 1.0);
    let mut still = Vec::new();
    for elements in BarElements::ALL {
        for across in if quick { &[2][..] } else { &[2, 4, 8][..] } {
            // ten-node tetrahedra have vertices between those of their cells
            if elements == BarElements::TenNode && *across == 8 {
                continue;
            }
            tell(&format!("integrators: bar at rest, {across} {} across", elements.name()));
            for (case, (young_modulus, published)) in (1..).zip(AT_REST) {
                let u = Bar::new(elements, young_modulus, *across)?.at_rest()?;
                still.push((case, elements.name(), *across, u, published));
            }
        }
    }
    let mut moving = Vec::new();
    for &integrator in integrators {
        for dt in if quick { &[0.0325][..] } else { &[1.0 / 60.0, 0.0325][..] } {
            tell(&format!("integrators: swinging bar, {}", integrator.name()));
            let mut bar = Bar::new(BarElements::TenNode, AT_REST[0].0, 2)?;
            let (found, failure) = match bar.swing(integrator, *dt) {
                Ok(found) => (Some(found), None),
                Err(error) => (None, Some(error.to_string())),
            };
            moving.push((integrator, dt, found, failure));
        }
    }
    let title = "Published bar at rest: Turek & Hron's cases CSM1 and CSM2";
    let still = table_of!("bar-rest", title; for (case, elements, across, u, published) in still;
        "case" => format!("CSM{case}"), "elements" => elements, "cells across" => across,
        "along mm" => u.x, "off %" => off(u.x, published[0]), "across mm" => u.y,
        "off across %" => off(u.y, published[1]),
    )
    .note(
        "St Venant-Kirchhoff, nu 0.4, plane strain; 35 cells along the bar for two across. off: from the published place of \
         the middle of the free end.",
    );
    let title = "Published bar in motion: Turek & Hron's case CSM3";
    let motion = table_of!("bar-motion", title; for (integrator, dt, found, failure) in moving;
        "integrator" => integrator.name(), "dt ms" => 1e3 * dt,
        "steps a period" => 1.0 / (dt * MOTION[1]),
        "amplitude mm" => found.map(|s| s.amplitude[0]),
        "off %" => found.map(|s| off(s.amplitude[0], MOTION[0])),
        "lost in 10 s %" => found.map(|s| 100.0 * s.lost()),
        "frequency off %" => found.map(|s| off(s.frequency, MOTION[1])),
        "safe steps" => found.map(|s| s.safe),
        "ms/step" => found.map(|s| s.ms), "failure" => failure,
    )
    .note(
        "35 x 2 cells of ten-node tetrahedra, default tolerances, one thread. amplitude: of the first swing; off: from the \
         published 65.160 mm and 1.0995 Hz. lost: of the last swing over the first. safe steps: those that a \
         scheme of second order left to the safe step, a first one without history included.",
    );
    Ok(vec![still, motion])
}
