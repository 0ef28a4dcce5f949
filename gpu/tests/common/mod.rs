//! A device for tests, and bodies in states that matter.

pub mod compare;
#[allow(dead_code, unused_imports, reason = "tests of the processor use the rest")]
#[path = "../../../tests/common/mod.rs"]
pub mod shared;

use glam::DVec3;
use shared::{Shortcuts, clamp, max_distance, max_length};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::engine::report::StepReport;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;
use sinew::solvers::settings::Preconditioner;
use sinew_gpu::{GpuBackend, GpuError, GpuOptions};

/// A device, or `None` with a message where there is no adapter.
pub fn device(options: &GpuOptions) -> Option<GpuBackend> {
    match GpuBackend::new(options) {
        Ok(backend) => Some(backend),
        Err(GpuError::Adapter(error)) => {
            say(&format!("skipped: no GPU adapter ({error})"));
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// A simulation on the device, or `None` where there is no adapter.
pub fn on_device(options: &GpuOptions) -> Option<Simulation> {
    let backend = device(options)?;
    Some(Simulation::with_gpu(SimulationOptions::default(), backend).unwrap())
}

/// On the processor, and on the device if there is one.
pub fn simulations(options: &GpuOptions) -> Option<[Simulation; 2]> {
    let gpu = on_device(options)?;
    Some([Simulation::new(SimulationOptions::default()).unwrap(), gpu])
}

/// For whoever reads the log.
#[allow(clippy::print_stderr, reason = "a skipped test says so, a parity test its figures")]
pub fn say(message: &str) {
    eprintln!("{message}");
}

/// A beam of soft tissue.
pub fn beam(cells: [usize; 3]) -> Mesh {
    box_tets(DVec3::new(0.2, 0.05, 0.05), cells).unwrap()
}

/// The same of hexahedra whose faces are not plane.
pub fn bricks(cells: [usize; 3]) -> Mesh {
    let mut mesh = box_hexahedra(DVec3::new(0.2, 0.05, 0.05), cells).unwrap();
    for (i, x) in mesh.points.iter_mut().enumerate() {
        *x += 1.5e-3 * noise(i);
    }
    mesh
}

/// The same, the first half of its cells cut into tetrahedra.
pub fn half_bricks(cells: [usize; 3]) -> Mesh {
    let mut mesh = bricks(cells);
    let half = mesh.hexahedra.len() / 2;
    mesh.hexahedra.drain(..half);
    mesh.tetrahedra = beam(cells).tetrahedra;
    mesh.tetrahedra.truncate(6 * half);
    mesh
}

/// 10 kPa, nearly incompressible.
pub const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.45, density: 1000.0 };

/// A beam made of it.
pub fn of(mesh: &Mesh, model: Model) -> BodyDescription<'_> {
    BodyDescription { model, ..BodyDescription::new("beam", mesh, MATERIAL) }
}

/// A state: name and displacement (m) of a rest position (m), with noise of its own in [-1, 1]^3.
pub type State = (&'static str, fn(DVec3, DVec3) -> DVec3);

/// Typical, hardly deformed, bent, squeezed with elements inside out, crushed flat.
pub const STATES: [State; 5] = [
    ("stretched and sheared", |x, noise| {
        DVec3::new(0.1 * x.x + 0.05 * x.y, -0.03 * x.y, 0.04 * x.x - 0.02 * x.z) + 2e-4 * noise
    }),
    ("strain of 1e-5", |x, noise| 1e-5 * DVec3::new(x.x, -0.4 * x.y, -0.4 * x.z) + 1e-8 * noise),
    ("bent", |x, _| {
        let radius = 0.2 / 0.5;
        let (sin, cos) = (x.x / radius).sin_cos();
        let r = radius + x.z;
        DVec3::new(r * sin, x.y, r * cos - radius) - x
    }),
    ("squeezed", |x, noise| DVec3::new(-0.45 * x.x, 0.1 * x.y, 0.1 * x.z) + 3e-3 * noise),
    ("crushed", |x, noise| DVec3::new(0.1 * x.x, 0.1 * x.y, -0.98 * x.z) + 2e-3 * noise),
];

/// Three numbers in [-1, 1] from a counter.
pub fn noise(i: usize) -> DVec3 {
    let number = |k: u64| {
        let mut x = (i as u64 * 3 + k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    DVec3::new(number(0), number(1), number(2))
}

/// Displacements (m) of a state.
pub fn displacements(mesh: &Mesh, state: &State) -> Vec<DVec3> {
    displacements_of(&mesh.points, state)
}

/// Displacements (m) of points (m) in a state.
pub fn displacements_of(points: &[DVec3], state: &State) -> Vec<DVec3> {
    points.iter().enumerate().map(|(i, x)| (state.1)(*x, noise(i))).collect()
}

/// Largest length of a difference over the largest length of `b`.
pub fn relative(a: &[DVec3], b: &[DVec3]) -> f64 {
    max_distance(a, b) / max_length(b)
}

/// Builds a scene round a body on the processor and on the device, runs both and returns displacements, velocities
/// and reports of all steps of each; `None` without an adapter.
pub fn run_both(
    description: &BodyDescription,
    steps: usize,
    settings: &SolverSettings,
    scene: impl Fn(&mut Simulation, BodyHandle),
) -> Option<[Run; 2]> {
    Some(simulations(&GpuOptions::default())?.map(|mut simulation| {
        let body = simulation.add_body(description).unwrap();
        simulation.set_solver(settings.clone());
        scene(&mut simulation, body);
        let mut reports = Vec::new();
        for _ in 0..steps {
            simulation.step().unwrap();
            reports.push(simulation.report().clone());
        }
        let (u, v) = (simulation.displacements(body), simulation.velocities(body));
        Run { simulation, u, v, reports }
    }))
}

/// What became of a scene.
pub struct Run {
    pub simulation: Simulation,
    pub u: Vec<DVec3>,
    pub v: Vec<DVec3>,
    pub reports: Vec<StepReport>,
}

impl Run {
    /// A sum over the reports of all steps.
    pub fn sum<T: std::iter::Sum>(&self, pick: impl Fn(&StepReport) -> T) -> T {
        self.reports.iter().map(pick).sum()
    }
}

/// Both ended at the same places with the same velocities.
pub fn end_alike([cpu, gpu]: &[Run; 2], what: &str) {
    let (u, v) = (relative(&gpu.u, &cpu.u), relative(&gpu.v, &cpu.v));
    say(&format!("{what}: displacement {u:.1e} velocity {v:.1e}"));
    assert!(u < 1e-4 && v < 1e-3, "{what}: {u:.1e} {v:.1e}");
}

/// The energy books of both agree all along.
pub fn books_agree([cpu, gpu]: &[Run; 2]) {
    for (a, b) in gpu.reports.iter().zip(&cpu.reports) {
        let scale = b.elastic_energy.abs() + b.kinetic_energy + b.load_work.abs();
        close(a.elastic_energy, b.elastic_energy, scale, 1e-3, "elastic energy");
        close(a.kinetic_energy, b.kinetic_energy, scale, 1e-3, "kinetic energy");
        close(a.load_work, b.load_work, scale, 1e-3, "work of loads");
        close(a.dissipation, b.dissipation, scale, 1e-3, "dissipation");
        close(a.damping_dissipation, b.damping_dissipation, scale, 1e-3, "damping");
    }
}

/// Settings in which both do the same.
pub fn settings() -> SolverSettings {
    SolverSettings {
        integrator: Integrator::Safe,
        preconditioner: Preconditioner::BlockJacobi,
        linear_tolerance: 1e-5,
        ..SolverSettings::default()
    }
}

/// Holds a group of vertices.
pub fn hold(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh, group: &str) {
    clamp(simulation, body, mesh, group);
}

/// Turns elements of a body inside out, without gravity.
pub fn scramble(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) {
    simulation.set_gravity(DVec3::ZERO);
    let u: Vec<_> = (0..mesh.points.len()).map(|i| 0.03 * noise(i)).collect();
    simulation.displace(body, &u);
}

/// Which cells have their middle in a notch at the top of a beam.
pub fn in_notch<const N: usize>(mesh: &Mesh, cells: &[[u32; N]]) -> Vec<u32> {
    let middle =
        |cell: &[u32; N]| cell.iter().map(|&v| mesh.points[v as usize]).sum::<DVec3>() / N as f64;
    let inside = |x: DVec3| (x.x - 0.1).abs() < 0.03 && x.z > 0.03;
    (0..).zip(cells).filter(|(_, cell)| inside(middle(cell))).map(|(i, _)| i).collect()
}

/// Cuts the notch into a beam of tetrahedra.
pub fn cut_notch(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) {
    let notch = in_notch(mesh, &mesh.tetrahedra);
    assert!(notch.len() > 10);
    simulation.remove_elements(body, &Removal::new(Region::Tetrahedra(notch))).unwrap();
}

pub fn close(a: f64, b: f64, scale: f64, bound: f64, what: &str) {
    assert!((a - b).abs() <= bound * scale, "{what}: {a} against {b}, scale {scale}");
}
