//! What cutting costs: a blade at 50 mm/s through stretched tissue, beside the same steps without it.

use super::resection::FrameTimes;
use crate::toolbox::aim::BenchAim;
use crate::toolbox::prelude::*;
use glam::DVec3;
use sinew::engine::mesh::generate::box_tets;

/// Length of a step (s).
const STEP: f64 = 0.01;
/// Size of the block (m).
const SIZE: DVec3 = DVec3::new(0.06, 0.05, 0.035);
/// Speed of the blade (m/s), and its way (m): through the block, from beside it to beside it.
const BLADE: [f64; 2] = [0.05, 0.06];
/// Steps in which the block is stretched, before anything is measured.
const STRETCHING: u32 = 60;

/// A block that lies on a bath and is stretched by a tenth.
struct Rig {
    simulation: Simulation,
    blade: Option<bevy_ecs::entity::Entity>,
    parted: u32,
    /// Times (ms) of steps: in which nothing fell apart, in which something did, once the blade is gone.
    ms: [Vec<f64>; 3],
    iterations: [u32; 3],
    residual: f64,
}

impl Rig {
    fn new(mesh: &Mesh, spare: usize, blade: bool, threads: usize) -> Result<Self> {
        let mut simulation =
            Simulation::new(SimulationOptions { threads, exclusive: true, ..Default::default() })?;
        let material = YoungPoisson { young_modulus: 3e4, poisson_ratio: 0.4, density: 1000.0 };
        let description = BodyDescription::new("block", mesh, material);
        let body = simulation.add_body(&BodyDescription { spare, ..description })?;
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_dt(STEP);
        simulation.set_solver(SolverSettings {
            integrator: Integrator::Safe,
            mass_damping: 5.0,
            ..Default::default()
        });
        let [left, right, bed] =
            ["x0", "x1", "z0"].map(|group| simulation.group_rows(body, mesh, group));
        simulation.add_constraint(Constraint::hold("left", left?));
        let end = f64::from(STRETCHING) * STEP;
        let motion = Motion::Translate(DVec3::X * (0.1 * SIZE.x));
        let curve = Curve::ramp(0.0, end / 2.0);
        simulation.add_constraint(Constraint::moving("right", right?, motion, curve));
        let axes = sinew::engine::vertex::FixedAxes(0b100);
        simulation.add_constraint(Constraint { axes, ..Constraint::hold("bed", bed?) });
        let edge = Edge {
            ends: [DVec3::ZERO, DVec3::Z * 0.04],
            into: DVec3::Y,
            toughness: 100.0,
            travel: DVec3::ZERO,
        };
        let start = DVec3::new(0.53 * SIZE.x, -0.006, 0.005);
        let blade = match blade {
            true => Some(simulation.add_tool(Tool::blade("scalpel", edge, start))?),
            false => None,
        };
        for _ in 0..STRETCHING {
            simulation.step()?;
        }
        let ms = <[Vec<f64>; 3]>::default();
        Ok(Self { simulation, blade, parted: 0, ms, iterations: [0; 3], residual: 0.0 })
    }

    fn step(&mut self) -> Result<()> {
        let at = |rig: &Self| {
            let report = rig.simulation.tool_report(rig.blade?);
            report.map(|own| (own.position, own.separated))
        };
        if let (Some(blade), Some((position, _))) = (self.blade, at(self)) {
            self.simulation.move_tool(blade, position + DVec3::Y * (BLADE[0] * STEP))?;
        }
        let clock = Instant::now();
        self.simulation.step()?;
        let ms = clock.elapsed().as_secs_f64() * 1e3;
        let parted = at(self).map_or(0, |(_, parted)| parted);
        let kind = match (parted > self.parted, self.parted > 0 && self.blade.is_none()) {
            (true, _) => 1,
            (false, true) => 2,
            (false, false) => 0,
        };
        self.parted = self.parted.max(parted);
        self.ms[kind].push(ms);
        let report = self.simulation.report();
        self.iterations[kind] += report.cg_iterations;
        self.residual = self.residual.max(report.cg_residual);
        Ok(())
    }
}

/// Steps of blocks of about these sizes (tetrahedra) with and without a blade, in turns.
///
/// # Errors
/// When a body cannot be made or a step fails.
pub fn run(
    sizes: &[usize],
    threads: &[usize],
    mut tell: impl FnMut(&str),
) -> Result<(Table, Vec<BenchAim>)> {
    let title =
        "A blade at 50 mm/s, 30 mm deep in stretched tissue, steps of 10 ms, safe step (ms)";
    let mut rows = Vec::new();
    let mut aims = Vec::new();
    for &size in sizes {
        let cells = (SIZE / (SIZE.element_product() * 6.0 / size as f64).cbrt()).round();
        let mesh = box_tets(SIZE, cells.to_array().map(|n| n as usize))?;
        let (tets, spare) = (mesh.tetrahedra.len(), mesh.points.len() / 4);
        for &threads in threads {
            tell(&format!("cutting: {tets} tetrahedra, threads {threads}"));
            let mut plain = Rig::new(&mesh, 0, false, threads)?;
            let mut spared = Rig::new(&mesh, spare, false, threads)?;
            let mut cut = Rig::new(&mesh, spare, true, threads)?;
            let mut all = [&mut plain, &mut spared, &mut cut];
            for _ in 0..(BLADE[1] / BLADE[0] / STEP).round() as u32 {
                all.iter_mut().try_for_each(|rig| rig.step())?;
            }
            if let Some(blade) = cut.blade.take() {
                cut.simulation.world_mut().despawn(blade);
            }
            for _ in 0..STRETCHING {
                cut.step()?;
            }
            let own = [
                ("cannot be cut", &plain, 0),
                ("can be cut", &spared, 0),
                ("nothing parts", &cut, 0),
                ("elements part", &cut, 1),
                ("after it", &cut, 2),
            ];
            let base = FrameTimes::of(plain.ms[0].clone()).median;
            for (what, rig, kind) in
                own.into_iter().filter(|(_, rig, kind)| !rig.ms[*kind].is_empty())
            {
                let (count, times) = (rig.ms[kind].len(), FrameTimes::of(rig.ms[kind].clone()));
                let iterations = f64::from(rig.iterations[kind]) / count as f64;
                rows.push((
                    what,
                    tets,
                    threads,
                    count,
                    times,
                    base,
                    iterations,
                    rig.residual,
                    rig.parted,
                ));
            }
            let median = |rig: &Rig, kind: usize| match rig.ms[kind].is_empty() {
                true => f64::NAN,
                false => FrameTimes::of(rig.ms[kind].clone()).median,
            };
            let longest = FrameTimes::of(cut.ms.concat()).max;
            let of = |what: &str| format!("{what}, {tets} tetrahedra, threads {threads}");
            aims.extend([
                BenchAim::at_most(
                    of("a step in which elements part beside a plain one"),
                    2.0,
                    "times",
                    median(&cut, 1) / base,
                ),
                BenchAim::at_most(
                    of("a body that can be cut beside one that cannot"),
                    1.15,
                    "times",
                    median(&spared, 0) / base,
                ),
                BenchAim::at_most(of("longest step of the stroke"), 16.0, "ms", longest),
            ]);
        }
    }
    let table = table_of!("cutting", title; for (what, tets, threads, count, t, base, iterations, residual, parted) in rows;
        "what" => what, "tets" => tets, "threads" => threads, "steps" => count, "least" => t.min, "median" => t.median,
        "of plain" => t.median / base, "95 %" => t.p95, "longest" => t.max, "CG its" => iterations,
        "worst residual" => residual, "parted" => parted,
    );
    Ok((table.note("parted: elements that the stroke parted, by the end; plain: a body that cannot be cut, in the same run, in turns."), aims))
}
