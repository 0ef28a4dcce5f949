//! Small builders shared by these tests and those of the device.

pub mod rich_axes;

use bevy_ecs::entity::Entity;
use glam::{DQuat, DVec3};
use sinew::engine::connectivity::ElementKind;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::load::Pressure;
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, jitter_interior};
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::vertex::FixedAxes;
use sinew::engine::workers::Workers;
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::MembraneDescription;
use sinew::models::resection::{Region, Removal, RemovalReport};
use sinew::prelude::*;

/// Settings of a solver: the integrator, and what else is not as by default.
macro_rules! solver {
    ($integrator:expr $(, $field:ident $(= $value:expr)?)*) => {
        SolverSettings { integrator: $integrator, $($field $(: $value)?,)* ..Default::default() }
    };
}
pub(crate) use solver;

/// Largest distance between two fields.
pub fn max_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

pub fn max_length(a: &[DVec3]) -> f64 {
    a.iter().map(|a| a.length()).fold(0.0, f64::max)
}

/// A simulation with one body.
pub fn simulation(
    options: SimulationOptions,
    points: &[DVec3],
    tetrahedra: &[[u32; 4]],
    material: YoungPoisson,
    model: Model,
    evaluation: Evaluation,
) -> (Simulation, BodyHandle) {
    let body = BodyDescription {
        model,
        evaluation,
        ..BodyDescription::from_parts("body", points, tetrahedra, material)
    };
    alone(options, &body)
}

/// A box of tetrahedra with one corner at the origin, its interior vertices moved at random.
pub fn jittered_box(size: [f64; 3], cells: [usize; 3]) -> Mesh {
    let mesh = box_tets(DVec3::from_array(size), cells).expect("sizes are positive");
    jitter_interior(&mesh, 0.2, 7).expect("fraction below 1")
}

/// A material of water's density.
pub fn soft(young_modulus: f64, poisson_ratio: f64) -> YoungPoisson {
    YoungPoisson { young_modulus, poisson_ratio, density: 1000.0 }
}

/// Kinds of solid elements that can be cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solid {
    Linear,
    TenNodes,
    Hexahedra,
}

impl Solid {
    pub const ALL: [Self; 3] = [Self::Linear, Self::TenNodes, Self::Hexahedra];

    /// A cube of so many cells along every edge, whose inner vertices are moved; those of hexahedra are not, so that wounds in them are plane.
    pub fn block(self, side: f64, cells: usize) -> Mesh {
        self.slab(DVec3::splat(side), [cells; 3])
    }

    /// A block of any size with so many steps from vertex to vertex: ten-node tetrahedra are two of these wide.
    pub fn spaced(self, size: DVec3, steps: [usize; 3]) -> Mesh {
        let wide = if self == Self::TenNodes { 2 } else { 1 };
        self.slab(size, steps.map(|n| n.div_ceil(wide)))
    }

    /// The same with so many cells.
    pub fn slab(self, size: DVec3, cells: [usize; 3]) -> Mesh {
        let tetrahedra = || {
            let mesh = box_tets(size, cells).unwrap();
            jitter_interior(&mesh, 0.2, 5).unwrap()
        };
        match self {
            Self::Linear => tetrahedra(),
            Self::TenNodes => tetrahedra().with_second_order(),
            Self::Hexahedra => box_hexahedra(size, cells).unwrap(),
        }
    }
}

/// Moves the points of a mesh. Where that is a mirror, vertices of elements change places.
pub fn place_mesh(mesh: &mut Mesh, place: impl Fn(DVec3) -> DVec3) {
    mesh.points.iter_mut().for_each(|x| *x = place(*x));
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|own| place(own) - place(DVec3::ZERO));
    if x.cross(y).dot(z) < 0.0 {
        mesh.tetrahedra.iter_mut().for_each(|t| t.swap(2, 3));
        mesh.middles.iter_mut().for_each(|m| *m = [m[0], m[4], m[3], m[2], m[1], m[5]]);
        mesh.hexahedra.iter_mut().for_each(|h| h.rotate_left(4));
    }
}

/// A simulation with one body made of a mesh.
pub fn simulate(
    options: SimulationOptions,
    mesh: &Mesh,
    material: YoungPoisson,
    model: Model,
    evaluation: Evaluation,
) -> (Simulation, BodyHandle) {
    let body =
        BodyDescription { model, evaluation, ..BodyDescription::new("body", mesh, material) };
    alone(options, &body)
}

/// A simulation with one body, and nothing beside it.
pub fn alone(options: SimulationOptions, body: &BodyDescription) -> (Simulation, BodyHandle) {
    let mut simulation = Simulation::new(options).unwrap();
    let body = simulation.add_body(body).unwrap();
    (simulation, body)
}

/// What is said of a body that cannot be built.
pub fn refused(body: &BodyDescription) -> String {
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    simulation.add_body(body).unwrap_err().to_string()
}

/// Two blocks above each other on a table, with friction: the table, and the contact of the blocks.
pub fn two_blocks(options: SimulationOptions) -> (Simulation, [Entity; 2]) {
    let mesh = box_tets(DVec3::new(0.03, 0.03, 0.02), [3, 3, 2]).unwrap();
    let mut simulation = Simulation::new(options).unwrap();
    for (i, name) in ["lower", "upper"].into_iter().enumerate() {
        let shift = DVec3::new(0.003, 0.002, 0.0201) * i as f64;
        let mesh = mesh.transformed(1.0, DQuat::IDENTITY, shift);
        simulation.add_body(&BodyDescription::new(name, &mesh, soft(1e4, 0.4))).unwrap();
    }
    let table = Tool::ground("table", DVec3::ZERO, DVec3::Z).with_friction(0.3);
    let table = simulation.add_tool(table).unwrap();
    let pair = BodyContact::new("pair", [BodyHandle(0), BodyHandle(1)]).with_friction(0.3);
    let pair = simulation.add_body_contact(pair);
    simulation.set_solver(solver!(Integrator::Auto, mass_damping = 10.0));
    (simulation, [table, pair])
}

/// A body of a mesh with the default options.
pub fn plain(
    mesh: &Mesh,
    material: YoungPoisson,
    model: Model,
    evaluation: Evaluation,
) -> (Simulation, BodyHandle) {
    simulate(SimulationOptions::default(), mesh, material, model, evaluation)
}

/// The same with the default model.
pub fn fused(mesh: &Mesh, material: YoungPoisson) -> (Simulation, BodyHandle) {
    plain(mesh, material, Model::CompressibleStVK, Evaluation::Fused)
}

pub fn options(precision: Precision, threads: usize) -> SimulationOptions {
    SimulationOptions { precision, threads, ..Default::default() }
}

/// What tests do with a simulation again and again.
pub trait Shortcuts {
    /// Steps, all of which must succeed.
    fn steps(&mut self, count: usize);
    /// Makes all settings of the solver the default ones but for the integrator.
    fn integrate_by(&mut self, integrator: Integrator);
    /// Displaces a body (m), at rest.
    fn displace(&mut self, body: BodyHandle, u: &[DVec3]);
    /// Finds the equilibrium under the loads at the end of a step.
    fn settle(&mut self);
    /// Removes elements, with their mass.
    fn remove(&mut self, body: BodyHandle, region: Region) -> RemovalReport;
}

impl Shortcuts for Simulation {
    fn steps(&mut self, count: usize) {
        (0..count).for_each(|_| self.step().unwrap());
    }

    fn integrate_by(&mut self, integrator: Integrator) {
        self.set_solver(SolverSettings { integrator, ..Default::default() });
    }

    fn displace(&mut self, body: BodyHandle, u: &[DVec3]) {
        self.set_state(body, u, &vec![DVec3::ZERO; u.len()]).unwrap();
    }

    fn settle(&mut self) {
        self.integrate_by(Integrator::QuasiStatic);
        self.step().unwrap();
        assert!(!self.report().unconverged);
    }

    fn remove(&mut self, body: BodyHandle, region: Region) -> RemovalReport {
        self.remove_elements(body, &Removal::new(region)).unwrap()
    }
}

/// A body that starts out of shape is whole and nearly at rest after 5 s.
pub fn recovers(description: &BodyDescription, u: &[DVec3], what: &str) {
    let (mut simulation, body) = alone(options(Precision::F64, 1), description);
    simulation.displace(body, u);
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(1.0 / 60.0);
    simulation.integrate_by(Integrator::Safe);
    simulation.steps(300);
    assert_eq!(simulation.volume_report().inverted, 0, "{what}");
    assert!(simulation.evaluate() < 1e-6 * description.material.young_modulus, "{what}");
}

/// Displaces the vertices of a body at random, along every axis by `size` (m) at most.
pub fn disturb(simulation: &mut Simulation, body: BodyHandle, size: f64, seed: u64) {
    let n = simulation.displacements(body).len();
    let u: Vec<_> = random_field(n, seed).iter().map(|r| *r * size).collect();
    simulation.displace(body, &u);
}

/// Vertices of a named group.
pub fn group(mesh: &Mesh, name: &str) -> Vec<u32> {
    mesh.group(name).expect("the generators name their sides").vertices.clone()
}

/// Holds a named side of a body for good.
pub fn clamp(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh, side: &str) -> Entity {
    guide(simulation, body, mesh, side, FixedAxes::ALL.0)
}

/// Holds a named side of a body along some axes for good.
pub fn guide(
    simulation: &mut Simulation,
    body: BodyHandle,
    mesh: &Mesh,
    side: &str,
    axes: u8,
) -> Entity {
    let rows = simulation.group_rows(body, mesh, side).expect("vertices exist");
    let mut hold = Constraint::hold(side, rows);
    hold.axes = FixedAxes(axes);
    simulation.add_constraint(hold)
}

/// Moves a named side of a body.
pub fn drive(
    simulation: &mut Simulation,
    body: BodyHandle,
    mesh: &Mesh,
    side: &str,
    motion: Motion,
    curve: Curve,
) -> Entity {
    let rows = simulation.group_rows(body, mesh, side).expect("vertices exist");
    simulation.add_constraint(Constraint::moving(side, rows, motion, curve))
}

/// Vertices whose rest positions pass a test.
pub fn vertices(points: &[DVec3], test: impl Fn(DVec3) -> bool) -> Vec<u32> {
    (0..).zip(points).filter(|(_, p)| test(**p)).map(|(i, _)| i).collect()
}

/// Holds the vertices of a body at x = 0 for good.
pub fn hold_end(simulation: &mut Simulation, body: BodyHandle, points: &[DVec3]) {
    let rows = simulation.rows(body, "end", &vertices(points, |p| p.x < 1e-9)).unwrap();
    simulation.add_constraint(Constraint::hold("end", rows));
}

/// Tetrahedra round the vertices that pass a test.
pub fn touching(mesh: &Mesh, test: impl Fn(DVec3) -> bool) -> Region {
    let touches = |t: &[u32; 4]| t.iter().any(|&v| test(mesh.points[v as usize]));
    let all = (0..).zip(&mesh.tetrahedra);
    Region::Tetrahedra(all.filter(|(_, t)| touches(t)).map(|(i, _)| i).collect())
}

/// Numbers below `n`, the same every time.
pub fn random_numbers(seed: u64) -> impl FnMut(usize) -> usize {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move |n| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % n
    }
}

/// `count` of some elements.
pub fn pick(mut left: Vec<u32>, count: usize, seed: u64) -> Vec<u32> {
    let mut next = random_numbers(seed);
    let count = count.min(left.len());
    for i in 0..count {
        let j = i + next(left.len() - i);
        left.swap(i, j);
    }
    left.truncate(count);
    left
}

/// `K dx` of the tangent of the given kind at the current state, in the user's order.
pub fn tangent_product(
    simulation: &mut Simulation,
    body: BodyHandle,
    kind: TangentKind,
    dx: &[DVec3],
) -> Vec<DVec3> {
    let rows = simulation.topology().bodies[body.0].clone();
    let world = simulation.world_mut();
    world.insert_resource(EvaluationRequest { energy: false, force: false, tangent: Some(kind) });
    world.run_schedule(ForceSchedule);
    let x: Vec<[f64; 4]> =
        rows.vertex_order.iter().map(|v| dx[v.index()]).map(|d| [d.x, d.y, d.z, 0.0]).collect();
    let mut y = vec![[0.0; 4]; x.len()];
    world.resource::<Tangent<f64>>().matrix.multiply(
        world.resource(),
        world.resource::<Workers>(),
        &mut ProductSpans::default(),
        &x,
        &mut y,
    );
    let mut result = vec![DVec3::ZERO; dx.len()];
    for (row, vertex) in rows.vertex_order.iter().enumerate() {
        result[vertex.index()] = DVec3::new(y[row][0], y[row][1], y[row][2]);
    }
    result
}

/// After a removal the state is that of a body newly built, as far as rounding allows. Masses are not compared: those
/// that `MassPolicy::Keep` left, and equal ones, are not those of a new body.
pub fn assert_as_fresh(simulation: &mut Simulation, body: BodyHandle, what: &str) {
    // forces are compared to 1e-3 of stiffness times reach: 4.5 roundings of that in either precision
    let rounding = match simulation.precision() {
        Precision::F64 => f64::EPSILON,
        Precision::F32 => f32::EPSILON.into(),
    };
    let difference = simulation.verify_against_fresh(body).unwrap();
    assert!(difference.largest() <= 4500.0 * rounding, "{what}: {difference:?}");
}

/// After a removal the state and the masses are those of a body newly built, within a relative tolerance.
pub fn assert_fresh(simulation: &mut Simulation, body: BodyHandle, tolerance: f64, what: &str) {
    let difference = simulation.verify_against_fresh(body).unwrap();
    let largest = difference.largest().max(difference.mass);
    assert!(largest <= tolerance, "{what}: {difference:?}");
}

/// A body that is all membrane, of the membrane's material.
pub fn sheet<'a>(points: &'a [DVec3], membrane: MembraneDescription<'a>) -> BodyDescription<'a> {
    let plain = BodyDescription::from_parts("sheet", points, &[], membrane.material);
    BodyDescription { membrane: Some(membrane), ..plain }
}

/// Elements of one kind, by their numbers.
pub fn region(kind: ElementKind, elements: Vec<u32>) -> Region {
    match kind {
        ElementKind::Tetrahedron => Region::Tetrahedra(elements),
        ElementKind::Hexahedron => Region::Hexahedra(elements),
        ElementKind::Triangle => Region::Triangles(elements),
        ElementKind::Quad => Region::Quads(elements),
    }
}

/// Lets a pressure (Pa) act on triangles of a body.
pub fn blow(
    simulation: &mut Simulation,
    body: BodyHandle,
    triangles: &[[u32; 3]],
    pressure: f64,
    curve: Curve,
) -> Entity {
    let faces = simulation.face_rows(body, "air", triangles).expect("faces of the body");
    simulation.add_pressure(Pressure { name: "air".into(), faces, pressure, curve })
}

/// Triangles of quadrilaterals that are cut along both diagonals, each for half of a pressure: so that every corner gets what its
/// shape function gives it.
pub fn both_diagonals(quads: impl IntoIterator<Item = [u32; 4]>) -> Vec<[u32; 3]> {
    let cut = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d], [b, c, d], [b, d, a]];
    quads.into_iter().flat_map(cut).collect()
}

/// Lets a pressure (Pa) act on some faces of a solid, triangles and quadrilaterals, into the body.
pub fn press_on(
    simulation: &mut Simulation,
    body: BodyHandle,
    (triangles, quads): (&[[u32; 3]], &[[u32; 4]]),
    pressure: f64,
) {
    let inward = |faces: &[[u32; 3]]| faces.iter().map(|&[a, b, c]| [a, c, b]).collect::<Vec<_>>();
    let halves = both_diagonals(quads.iter().copied());
    for (faces, pressure) in [(inward(triangles), pressure), (inward(&halves), 0.5 * pressure)] {
        if !faces.is_empty() {
            blow(simulation, body, &faces, pressure, Curve::Constant);
        }
    }
}

/// The same field of numbers between -1 and 1 every time (splitmix64).
pub fn random_field(n: usize, mut seed: u64) -> Vec<DVec3> {
    let mut next = || {
        seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..n).map(|_| DVec3::new(next(), next(), next())).collect()
}
