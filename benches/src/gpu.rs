//! Graphics processor beside processor: force passes and implicit steps, time and error of both. `sinew-lab bench
//! gpu`.

use crate::beam::{MATERIAL, beam, bend, cells_for, evaluate, relative_distance, request};
use glam::DVec3;
use serde::Serialize;
use sinew::gpu::{GpuBackend, GpuOptions, GpuReport};
use sinew::prelude::*;
use sinew::simulation::{Backend, Readback};
use sinew::solvers::settings::Preconditioner;
use std::error::Error;
use std::fmt;
use std::time::Instant;

/// What is measured.
#[derive(Clone, Debug)]
pub struct GpuBenchOptions {
    /// Sizes of the beam (tetrahedra, about).
    pub sizes: Vec<usize>,
    /// Steps that are timed.
    pub steps: usize,
}

/// One way of computing, time and error.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Which.
    pub name: &'static str,
    /// Force pass (ns per tetrahedron) as the host sees it.
    pub force_ns: f64,
    /// The same on the device, if it can be told.
    pub force_device_ns: Option<f64>,
    /// Error of the force, of the largest one, against `f64`.
    pub force_error: f64,
    /// Median step (ms) as the host sees it.
    pub step_ms: f64,
    /// Median time (ms) of its passes on the device.
    pub step_device_ms: Option<f64>,
    /// Bytes per step that came back from the device, the state left there.
    pub bytes_down: Option<u64>,
    /// Preconditioner of the linear systems.
    pub preconditioner: String,
    /// Times it was computed.
    pub refreshes: u32,
    /// Conjugate-gradient iterations per step.
    pub iterations: f64,
    /// Worst relative residual of the linear systems.
    pub residual: f64,
    /// Displacement after the steps, distance from that of `f64` over the largest.
    pub step_error: f64,
}

/// All of one size.
#[derive(Clone, Debug, Serialize)]
pub struct Size {
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Vertices.
    pub vertices: usize,
    /// Bytes that a force pass on the device moves at least.
    pub force_bytes: u64,
    /// Bandwidth (GB/s) of the force pass on the device by these bytes: device time where known.
    pub bandwidth: f64,
    /// Setting up the device for the body (ms): uploads and shaders, once.
    pub setup_ms: f64,
    /// One row per way.
    pub rows: Vec<Row>,
}

/// The report.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Adapter, interface and kind.
    pub adapter: String,
    /// Shaders run on the main processor.
    pub software: bool,
    /// Whether the device times passes.
    pub timestamps: bool,
    /// Bandwidth (GB/s) of copies on the device, read and written.
    pub copy_bandwidth: f64,
    /// Steps timed.
    pub steps: usize,
    /// One per size.
    pub sizes: Vec<Size>,
}

/// Measures.
///
/// # Errors
/// When there is no adapter, a body cannot be made or a step fails.
pub fn run(options: &GpuBenchOptions) -> Result<Report, Box<dyn Error>> {
    let probe = GpuBackend::new(&GpuOptions::default())?;
    let copy_bandwidth = probe.copy_bandwidth()? * 1e-9;
    let (adapter, software) = (probe.summary().to_string(), probe.summary().software());
    let timestamps = probe.has_timestamps();
    drop(probe);
    let sizes = options.sizes.iter().map(|&size| measure(size, options.steps));
    let sizes = sizes.collect::<Result<_, _>>()?;
    let steps = options.steps;
    Ok(Report { adapter, software, timestamps, copy_bandwidth, steps, sizes })
}

fn settings() -> SolverSettings {
    SolverSettings { integrator: Integrator::Safe, ..SolverSettings::default() }
}

/// What is compared: name, number type, backend, preconditioner.
const WAYS: [(&str, Precision, Backend, Preconditioner); 4] = [
    ("CPU f64", Precision::F64, Backend::Cpu, Preconditioner::Auto),
    ("CPU f32", Precision::F32, Backend::Cpu, Preconditioner::Auto),
    ("GPU f32", Precision::F32, Backend::Gpu, Preconditioner::Auto),
    ("GPU f32", Precision::F32, Backend::Gpu, Preconditioner::BlockJacobi),
];

/// A beam clamped at one end.
fn scene(simulation: &mut Simulation, mesh: &Mesh) -> Result<BodyHandle, Box<dyn Error>> {
    let body = simulation.add_body(&BodyDescription::new("beam", mesh, MATERIAL))?;
    let rows = simulation.group_rows(body, mesh, "x0")?;
    simulation.add_constraint(Constraint::hold("clamp", rows));
    simulation.set_solver(settings());
    Ok(body)
}

fn measure(size: usize, steps: usize) -> Result<Size, Box<dyn Error>> {
    let mesh = beam(cells_for(size))?;
    let tetrahedra = mesh.tetrahedra.len();
    let at_rest = vec![DVec3::ZERO; mesh.points.len()];
    let bent = bend(&mesh);
    let mut rows = Vec::new();
    let mut truth: Option<[Vec<DVec3>; 2]> = None;
    let (mut force_bytes, mut bandwidth, mut setup_ms) = (0, 0.0, 0.0);
    for (name, precision, backend, preconditioner) in WAYS {
        // forces of the bent beam
        let options = SimulationOptions { precision, ..SimulationOptions::default() };
        let mut simulation = Simulation::new(options)?;
        let body = scene(&mut simulation, &mesh)?;
        simulation.set_state(body, &bent, &at_rest)?;
        let (forces, force_ns, force_device_ns);
        if backend == Backend::Cpu {
            request(&mut simulation, false, true, None);
            evaluate(&mut simulation);
            let mut best = f64::INFINITY;
            for _ in 0..20 {
                let clock = Instant::now();
                evaluate(&mut simulation);
                best = best.min(clock.elapsed().as_secs_f64());
            }
            (force_ns, force_device_ns) = (best * 1e9 / tetrahedra as f64, None);
            forces = simulation.elastic_forces(body);
        } else {
            let mut device = GpuBackend::new(&GpuOptions::default())?;
            let clock = Instant::now();
            let found = device.evaluate::<f32>(simulation.world_mut())?;
            setup_ms = clock.elapsed().as_secs_f64() * 1e3;
            let timing = device.time_forces::<f32>(simulation.world_mut(), 20)?;
            let each =
                |seconds: f64| seconds * 1e9 / (f64::from(timing.passes) * tetrahedra as f64);
            (force_ns, force_device_ns) =
                (each(timing.host_seconds), timing.device_seconds.map(each));
            force_bytes = timing.bytes;
            let ns = force_device_ns.unwrap_or(force_ns) * tetrahedra as f64;
            bandwidth = timing.bytes as f64 / ns;
            let topology = &simulation.topology().bodies[body.0];
            let mut by_vertex = at_rest.clone();
            for (f, vertex) in found.forces.iter().zip(&topology.vertex_order) {
                by_vertex[vertex.index()] = DVec3::new(f[0].into(), f[1].into(), f[2].into());
            }
            forces = by_vertex;
        }

        // steps of the beam that falls from rest
        let options = SimulationOptions { backend, readback: Readback::OnDemand, ..options };
        let mut simulation = Simulation::new(options)?;
        let body = scene(&mut simulation, &mesh)?;
        simulation.set_solver(SolverSettings { preconditioner, ..settings() });
        // compiles shaders
        simulation.step()?;
        let (mut times, mut device_times) = (Vec::new(), Vec::new());
        let (mut iterations, mut residual) = (0, 0.0_f64);
        let mut refreshes = simulation.report().preconditioner_refreshes;
        let mut bytes_down = None;
        for _ in 0..steps {
            let clock = Instant::now();
            simulation.step()?;
            times.push(clock.elapsed().as_secs_f64() * 1e3);
            let report = simulation.report();
            iterations += report.cg_iterations;
            residual = residual.max(report.cg_residual);
            refreshes += report.preconditioner_refreshes;
            let device = simulation.world().get_resource::<GpuReport>();
            bytes_down = device.map(|report| report.bytes_down);
            device_times.extend(device.and_then(GpuReport::device_total).map(|s| s * 1e3));
        }
        let preconditioner = simulation.report().preconditioner.to_string();
        let u = simulation.displacements(body);
        let [true_forces, true_u] = truth.get_or_insert_with(|| [forces.clone(), u.clone()]);
        rows.push(Row {
            name,
            force_ns,
            force_device_ns,
            force_error: relative_distance(&forces, true_forces),
            step_ms: median(&mut times).unwrap_or(f64::NAN),
            step_device_ms: median(&mut device_times),
            bytes_down,
            preconditioner,
            refreshes,
            iterations: f64::from(iterations) / steps as f64,
            residual,
            step_error: relative_distance(&u, true_u),
        });
    }
    let vertices = mesh.points.len();
    Ok(Size { tetrahedra, vertices, force_bytes, bandwidth, setup_ms, rows })
}

fn median(samples: &mut [f64]) -> Option<f64> {
    samples.sort_by(f64::total_cmp);
    samples.get(samples.len() / 2).copied()
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.adapter)?;
        if self.software {
            writeln!(f, "a software adapter: these times say nothing of a graphics processor")?;
        }
        if !self.timestamps {
            writeln!(f, "no timestamps: device times are unknown")?;
        }
        writeln!(
            f,
            "copies {:.1} GB/s; safe steps of 10 ms, tolerance {:.0e}, median of {}",
            self.copy_bandwidth,
            settings().linear_tolerance,
            self.steps
        )?;
        for size in &self.sizes {
            let share = 100.0 * size.bandwidth / self.copy_bandwidth;
            writeln!(
                f,
                "\n{} tetrahedra, {} vertices; set up in {:.0} ms; a force pass moves {:.2} MB: {:.1} GB/s, \
                 {share:.0} % of copies",
                size.tetrahedra,
                size.vertices,
                size.setup_ms,
                size.force_bytes as f64 * 1e-6,
                size.bandwidth,
            )?;
            writeln!(
                f,
                "            force ns/tet  on device   error   step ms  on device   error  iterations  residual   kB down  \
                 preconditioner (computed)"
            )?;
            for r in &size.rows {
                let known = |x: Option<f64>| x.map_or_else(|| "-".into(), |x| format!("{x:.2}"));
                writeln!(
                    f,
                    "  {:<9} {:12.2} {:>10} {:7.0e} {:9.2} {:>10} {:7.0e} {:11.1} {:9.0e} {:>9}  {} ({})",
                    r.name,
                    r.force_ns,
                    known(r.force_device_ns),
                    r.force_error,
                    r.step_ms,
                    known(r.step_device_ms),
                    r.step_error,
                    r.iterations,
                    r.residual,
                    known(r.bytes_down.map(|bytes| bytes as f64 * 1e-3)),
                    r.preconditioner,
                    r.refreshes,
                )?;
            }
        }
        Ok(())
    }
}
