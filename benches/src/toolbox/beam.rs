//! The beams that all kernel and step benches use: 0.2 x 0.05 x 0.05 m, bent by half a radian.

use bevy_ecs::prelude::World;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::mesh::MeshError;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::scalar::Scalar;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::workers::Workers;
use sinew::models::axes::description::AxesDescription;
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::MembraneDescription;
use sinew::prelude::*;
use sinew::simulation::SimulationError;

/// Name and cells of 5 040 and 49 392 tetrahedra.
pub const SIZES: [(&str, [usize; 3]); 2] = [("5k", [20, 6, 7]), ("50k", [42, 14, 14])];

/// Edge lengths (m).
pub const EXTENT: DVec3 = DVec3::new(0.2, 0.05, 0.05);

/// Soft tissue: 10 kPa, nearly incompressible.
pub const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.45, density: 1000.0 };

/// A beam of `6 nx ny nz` tetrahedra.
///
/// # Errors
/// When there are too many cells.
pub fn beam(cells: [usize; 3]) -> Result<Mesh, MeshError> {
    box_tets(EXTENT, cells)
}

/// Cells of a beam of about so many tetrahedra, as cubic as they get.
pub fn cells_for(tetrahedra: usize) -> [usize; 3] {
    match tetrahedra {
        5_000 => SIZES[0].1,
        50_000 => SIZES[1].1,
        500_000 => [92, 30, 30],
        _ => {
            // 4 n n n cells of six tetrahedra
            let across = (tetrahedra as f64 / 24.0).cbrt();
            let n = across.round().max(1.0);
            [(4.0 * across.powi(3) / (n * n)).round().max(1.0) as usize, n as usize, n as usize]
        }
    }
}

/// Soft tissue clamped at x = 0 and bent.
///
/// # Errors
/// When threads cannot be started or the mesh cannot be used.
pub fn bent(
    mesh: &Mesh,
    precision: Precision,
    threads: usize,
    evaluation: Evaluation,
    model: Model,
) -> Result<(Simulation, BodyHandle), SimulationError> {
    let options = SimulationOptions { precision, threads, exclusive: true, ..Default::default() };
    bent_with(options, mesh, evaluation, model)
}

/// [`bent`] with any options.
///
/// # Errors
/// When threads cannot be started or the mesh cannot be used.
pub fn bent_with(
    options: SimulationOptions,
    mesh: &Mesh,
    evaluation: Evaluation,
    model: Model,
) -> Result<(Simulation, BodyHandle), SimulationError> {
    let mut simulation = Simulation::new(options)?;
    let material = MATERIAL;
    let axes = match model {
        // a material without moduli is refused with the body
        Model::Axes => material.lame().ok().map(AxesDescription::isotropic),
        _ => None,
    };
    let body = simulation.add_body(&BodyDescription {
        evaluation,
        model,
        axes,
        ..BodyDescription::new("beam", mesh, material)
    })?;
    let rows = simulation.group_rows(body, mesh, "x0")?;
    simulation.add_constraint(Constraint::hold("clamp", rows));
    let u = bend(mesh);
    simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()])?;
    Ok((simulation, body))
}

/// A body that is a membrane alone.
pub fn sheet<'a>(
    name: &'a str,
    mesh: &'a Mesh,
    membrane: MembraneDescription<'a>,
) -> BodyDescription<'a> {
    let material = membrane.material;
    BodyDescription {
        membrane: Some(membrane),
        ..BodyDescription::from_parts(name, &mesh.points, &[], material)
    }
}

/// Displacements (m) of a bar bent into an arc of 0.5 rad.
pub fn bend(mesh: &Mesh) -> Vec<DVec3> {
    let radius = EXTENT.x / 0.5;
    let place = |x: &DVec3| {
        let (sin, cos) = (x.x / radius).sin_cos();
        let r = radius + x.z;
        DVec3::new(r * sin, x.y, r * cos - radius) - *x
    };
    mesh.points.iter().map(place).collect()
}

/// What the next [`evaluate`] has to produce.
pub fn request(
    simulation: &mut Simulation,
    energy: bool,
    force: bool,
    tangent: Option<TangentKind>,
) {
    simulation.world_mut().insert_resource(EvaluationRequest { energy, force, tangent });
}

/// One run of the force schedule.
pub fn evaluate(simulation: &mut Simulation) {
    simulation.world_mut().run_schedule(ForceSchedule);
}

/// Runs `f` on the threads of the simulation, awake as they are throughout a step.
pub fn as_in_a_step<R: Send>(
    simulation: &mut Simulation,
    f: impl FnOnce(&mut World) -> R + Send,
) -> R {
    let workers = simulation.world().resource::<Workers>().clone();
    let world = simulation.world_mut();
    workers.enter(|| f(world))
}

/// Largest distance of two fields over the largest length in the second.
pub fn relative_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    let far = a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    far / b.iter().map(|b| b.length()).fold(0.0, f64::max)
}

/// Gives a world another pool of threads.
pub fn lend(world: &mut World, pool: &mut Option<Workers>) {
    if let Some(pool) = pool.take() {
        world.insert_resource(pool);
    }
}

/// Takes the pool back; one thread is left.
pub fn take_back(world: &mut World, pool: &mut Option<Workers>) {
    *pool = world.remove_resource::<Workers>();
    world.insert_resource(Workers::serial());
}

/// The precision of a number type.
pub fn precision_of<S: Scalar>() -> Precision {
    if S::NAME == "f32" { Precision::F32 } else { Precision::F64 }
}
