//! Graphics processor beside processor: force passes and implicit steps, time and error of both. `sinew-lab bench
//! gpu`.

use crate::toolbox::beam::{MATERIAL, beam, bend, cells_for, evaluate, relative_distance, request};
use crate::toolbox::prelude::*;
use crate::toolbox::stats::{Spread, median};
use sinew::gpu::report::Phase;
use sinew::gpu::{GpuBackend, GpuOptions, GpuReport};
use sinew::simulation::{Backend, Readback};
use sinew::solvers::settings::Preconditioner;

/// One way of computing; errors are against `f64`, over the largest.
struct DeviceRow {
    name: &'static str,
    force_ns: f64,
    force_device_ns: Option<f64>,
    force_error: f64,
    step_ms: f64,
    step_device_ms: Option<f64>,
    bytes_down: Option<u64>,
    preconditioner: String,
    refreshes: u32,
    iterations: f64,
    residual: f64,
    step_error: f64,
    /// Time on the device (ms) of a step by phase.
    phases: Vec<(&'static str, f64)>,
    /// Of a step (ms): the host waits in the integrator, works there, works outside.
    host: [f64; 3],
    /// Submissions of a step.
    submissions: f64,
}

/// All of one size.
struct DeviceSize {
    tetrahedra: usize,
    vertices: usize,
    /// Bytes that a force pass on the device moves at least, and these over its time (GB/s): device time where known.
    force_bytes: u64,
    bandwidth: f64,
    /// Uploads and shaders (ms), once.
    setup_ms: f64,
    rows: Vec<DeviceRow>,
}

/// Measures so many steps of beams of about these sizes.
///
/// # Errors
/// When there is no adapter, a body cannot be made or a step fails.
pub fn run(sizes: &[usize], steps: usize, mut tell: impl FnMut(&str)) -> Result<Vec<Table>> {
    let probe = GpuBackend::new(&GpuOptions::default())?;
    let copies = probe.copy_bandwidth()? * 1e-9;
    let (adapter, software) = (probe.summary().to_string(), probe.summary().software());
    let timestamps = probe.has_timestamps();
    drop(probe);
    let mut measured = Vec::new();
    for &size in sizes {
        tell(&format!("gpu: about {size} tetrahedra"));
        measured.push(measure(size, steps)?);
    }
    let rows = measured.iter().flat_map(|size| size.rows.iter().map(move |row| (size, row)));
    let title = format!("Graphics processor beside processor: {adapter}");
    let mut ways = table_of!("gpu", title; for (size, r) in rows;
        "way" => r.name, "tets" => size.tetrahedra, "force ns/tet" => r.force_ns,
        "on device" => r.force_device_ns, "error" => r.force_error, "step ms" => r.step_ms,
        "on device" => r.step_device_ms, "error" => r.step_error, "CG its" => r.iterations,
        "residual" => r.residual, "kB down" => r.bytes_down.map(|bytes| bytes as f64 * 1e-3),
        "preconditioner" => &r.preconditioner, "computed" => r.refreshes,
    )
    .note(format!(
        "safe steps of 10 ms, tolerance {:.0e}, median of {steps}; least of the force passes; errors against f64.",
        settings().linear_tolerance
    ));
    if software {
        ways = ways.note("a software adapter: these times say nothing of a graphics processor.");
    }
    if !timestamps {
        ways = ways.note("no timestamps: device times are unknown.");
    }
    let sizes = table_of!("gpu-sizes", "Force passes on the device"; for size in &measured;
        "tets" => size.tetrahedra, "vertices" => size.vertices, "set up ms" => size.setup_ms,
        "moves MB" => size.force_bytes as f64 * 1e-6, "GB/s" => size.bandwidth,
        "of copies %" => 100.0 * size.bandwidth / copies,
    )
    .note(format!("copies: {copies:.1} GB/s."));
    let phase_of = |row: &DeviceRow, phase: Phase| {
        row.phases.iter().find(|(name, _)| *name == phase.name()).map(|(_, ms)| *ms)
    };
    let on_device = measured
        .iter()
        .flat_map(|size| size.rows.iter().map(move |row| (size, row)))
        .filter(|(_, row)| !row.phases.is_empty());
    let phases = table_of!("gpu-phases", "Steps on the device by phase (ms)"; for (size, r) in on_device;
        "tets" => size.tetrahedra, "preconditioner" => &r.preconditioner,
        "forces" => phase_of(r, Phase::Forces), "tangent" => phase_of(r, Phase::Tangent),
        "inverse" => phase_of(r, Phase::Preconditioner), "solve" => phase_of(r, Phase::Solve),
        "rows" => phase_of(r, Phase::Rows), "host waits" => r.host[0], "host works" => r.host[1],
        "outside" => r.host[2], "submissions" => r.submissions,
    )
    .note(
        "means over the steps; inverse: of the coarse matrix, made anew when it pays; outside: systems of the step \
         other than the integrator. The device works while the host does.",
    );
    Ok(vec![ways, phases, sizes])
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
fn scene(simulation: &mut Simulation, mesh: &Mesh) -> Result<BodyHandle> {
    let body = simulation.add_body(&BodyDescription::new("beam", mesh, MATERIAL))?;
    let rows = simulation.group_rows(body, mesh, "x0")?;
    simulation.add_constraint(Constraint::hold("clamp", rows));
    simulation.set_solver(settings());
    Ok(body)
}

fn measure(size: usize, steps: usize) -> Result<DeviceSize> {
    let mesh = beam(cells_for(size))?;
    let tetrahedra = mesh.tetrahedra.len();
    let at_rest = vec![DVec3::ZERO; mesh.points.len()];
    let bent = bend(&mesh);
    let mut rows = Vec::new();
    let mut truth: Option<[Vec<DVec3>; 2]> = None;
    let (mut force_bytes, mut bandwidth, mut setup_ms) = (0, 0.0, 0.0);
    for (name, precision, backend, preconditioner) in WAYS {
        // forces of the bent beam
        let options =
            SimulationOptions { precision, exclusive: true, ..SimulationOptions::default() };
        let mut simulation = Simulation::new(options)?;
        let body = scene(&mut simulation, &mesh)?;
        simulation.set_state(body, &bent, &at_rest)?;
        let (forces, force_ns, force_device_ns);
        if backend == Backend::Cpu {
            request(&mut simulation, false, true, None);
            evaluate(&mut simulation);
            let passes = [(); 20].map(|()| {
                let clock = Instant::now();
                evaluate(&mut simulation);
                clock.elapsed().as_secs_f64()
            });
            let best = Spread::of(&passes).map_or(f64::NAN, |s| s.minimum);
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
        let mut phases: Vec<(&'static str, f64)> = Vec::new();
        let mut submissions = 0;
        let mut host = [0.0; 3];
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
            for &(name, seconds) in device.iter().flat_map(|report| &report.device_seconds) {
                let ms = seconds * 1e3 / steps as f64;
                match phases.iter_mut().find(|(own, _)| *own == name) {
                    Some((_, sum)) => *sum += ms,
                    None => phases.push((name, ms)),
                }
            }
            if let (Some(device), Some(all)) = (device, times.last()) {
                let own = [device.waited_seconds, device.host_seconds].map(|s| s * 1e3);
                let parts = [own[0], own[1] - own[0], all - own[1]];
                (0..3).for_each(|k| host[k] += parts[k] / steps as f64);
                submissions += device.submissions;
            }
        }
        let preconditioner = simulation.report().preconditioner.to_string();
        let u = simulation.displacements(body);
        let [true_forces, true_u] = truth.get_or_insert_with(|| [forces.clone(), u.clone()]);
        rows.push(DeviceRow {
            name,
            force_ns,
            force_device_ns,
            force_error: relative_distance(&forces, true_forces),
            step_ms: median(&times).unwrap_or(f64::NAN),
            step_device_ms: median(&device_times),
            bytes_down,
            preconditioner,
            refreshes,
            iterations: f64::from(iterations) / steps as f64,
            residual,
            step_error: relative_distance(&u, true_u),
            phases,
            host,
            submissions: f64::from(submissions) / steps as f64,
        });
    }
    let vertices = mesh.points.len();
    Ok(DeviceSize { tetrahedra, vertices, force_bytes, bandwidth, setup_ms, rows })
}
