//! Glue: what holds wounds closed that a blade has not come to.

use crate::common::*;
use bevy_ecs::prelude::Entity;
use glam::{DQuat, DVec2, DVec3};
use sinew::engine::law::{DisabledLaws, ElasticEnergy, EvaluationRequest, TangentKind};
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::mesh::generate::quad_grid;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::vertex::{Displacement, ElasticForce, RestPosition};
use sinew::engine::workers::Workers;
use sinew::models::body::sheet::MembraneDescription;
use sinew::models::cutting::glue::GlueReport;
use sinew::prelude::*;
use sinew::snapshot::Snapshot;

const LAW: &str = "glue of wounds";
const SIDE: f64 = 0.06;

/// How a scene is stated: numbers of lengths and masses in SI units, and whether x points the other way.
#[derive(Clone, Copy, Debug)]
struct Stated {
    solid: Solid,
    length: f64,
    mass: f64,
    mirror: f64,
}

const SI: Stated = Stated { solid: Solid::Linear, length: 1.0, mass: 1.0, mirror: 1.0 };

impl Stated {
    fn place(self, x: DVec3) -> DVec3 {
        self.length * x.with_x(self.mirror * x.x)
    }

    fn mesh(self) -> Mesh {
        let mut mesh = self.solid.block(SIDE, 4);
        place_mesh(&mut mesh, |x| self.place(x));
        mesh
    }
}

struct Scene {
    simulation: Simulation,
    body: BodyHandle,
    blade: Entity,
    stated: Stated,
}

/// A block whose sides across x are drawn apart, and a blade beside it that stands upright and cuts along y: down to 0.035 m, or right
/// through.
fn scene(glue: f64, through: bool, options: SimulationOptions, stated: Stated) -> Scene {
    let mesh = stated.mesh();
    let material = YoungPoisson {
        young_modulus: 1e4 * stated.mass / stated.length,
        poisson_ratio: 0.3,
        density: 1000.0 * stated.mass / stated.length.powi(3),
    };
    let description = BodyDescription::new("block", &mesh, material);
    let spare = 3 * mesh.points.len();
    let (mut simulation, body) = alone(options, &BodyDescription { spare, glue, ..description });
    simulation.set_gravity(DVec3::ZERO);
    for (x, way) in [(0.0, -0.003), (SIDE, 0.003)] {
        let on = |own: DVec3| (own.x - stated.mirror * stated.length * x).abs() < 1e-9;
        let rows = simulation.rows(body, "side", &vertices(&mesh.points, on)).unwrap();
        let motion = Motion::Translate(stated.place(DVec3::X * way));
        simulation.add_constraint(Constraint::moving("side", rows, motion, Curve::ramp(0.0, 0.05)));
    }
    simulation.set_solver(solver!(Integrator::Safe, mass_damping = 20.0));
    simulation.steps(30);
    let up = if through { 0.04 } else { 0.02 };
    let ends = [up, -up].map(|z| stated.length * z * DVec3::Z);
    let edge = Edge { ends, into: DVec3::Y, toughness: 0.0, travel: DVec3::ZERO };
    let height = if through { 0.03 } else { 0.055 };
    let at = stated.place(DVec3::new(0.031, -0.005, height));
    let blade = simulation.add_tool(Tool::blade("scalpel", edge, at)).unwrap();
    simulation.step().unwrap();
    Scene { simulation, body, blade, stated }
}

impl Scene {
    /// Moves the blade on along y (m) in so many steps.
    fn draw(&mut self, way: f64, steps: u32) {
        let from = self.simulation.tool_report(self.blade).unwrap().position;
        for i in 1..=steps {
            let way = self.stated.length * way * f64::from(i) / f64::from(steps);
            self.simulation.move_tool(self.blade, from + DVec3::Y * way).unwrap();
            self.simulation.step().unwrap();
        }
    }

    fn glue(&mut self) -> GlueReport {
        self.simulation.glue_report(self.body).unwrap()
    }

    /// Displaces all rows (m), ghosts included, from their places at rest.
    fn displace(&mut self, u: impl Fn(usize, DVec3) -> DVec3) {
        let mut query =
            self.simulation.world_mut().query::<(&RestPosition, &mut Displacement<f64>)>();
        let all = query.iter_mut(self.simulation.world_mut()).enumerate();
        all.for_each(|(row, (rest, mut own))| {
            let [x, y, z] = u(row, rest.0).to_array();
            own.0 = [x, y, z, 0.0];
        });
    }

    /// Energy, forces, and the product of the tangent with a field, of the glue alone.
    fn evaluate(&mut self, dx: &[[f64; 4]]) -> (f64, Vec<[f64; 4]>, Vec<[f64; 4]>) {
        let world = self.simulation.world_mut();
        let request =
            EvaluationRequest { energy: true, force: true, tangent: Some(TangentKind::Exact) };
        world.insert_resource(request);
        world.run_schedule(ForceSchedule);
        let mut forces = world.query::<&ElasticForce<f64>>();
        let force = forces.iter(world).map(|f| f.0).collect();
        let mut product = vec![[0.0; 4]; dx.len()];
        let spans = &mut ProductSpans::default();
        let matrix = &world.resource::<Tangent<f64>>().matrix;
        let workers = world.resource::<Workers>();
        matrix.multiply(world.resource(), workers, spans, dx, &mut product);
        (world.resource::<ElasticEnergy>().total, force, product)
    }
}

#[test]
fn force_and_tangent_are_derivatives_of_the_energy() {
    for solid in Solid::ALL {
        is_derivative(Stated { solid, ..SI });
    }
}

fn is_derivative(stated: Stated) {
    let mut scene = scene(5.0, false, options(Precision::F64, 1), stated);
    scene.draw(0.03, 20);
    assert!(scene.glue().springs > 0, "{:?}", scene.glue());
    let by_law = scene.simulation.world().resource::<ElasticEnergy>().by_law.clone();
    let others = by_law.iter().map(|(name, _)| *name).filter(|name| *name != LAW).collect();
    scene.simulation.world_mut().insert_resource(DisabledLaws(others));
    let rows = scene.simulation.topology().vertex_count();
    let (u, way) = (random_field(rows, 3), random_field(rows, 4));
    let dx: Vec<[f64; 4]> = way.iter().map(|d| [d.x, d.y, d.z, 0.0]).collect();
    let at = |scene: &mut Scene, part: f64| {
        scene.displace(|row, _| 1e-3 * (u[row] + part * way[row]));
        scene.evaluate(&dx)
    };
    let [before, now, after] = [-1.0, 0.0, 1.0].map(|part| at(&mut scene, part));
    assert!(now.0 > 0.0);
    let dot = |f: &[[f64; 4]]| -> f64 {
        f.iter().zip(&dx).map(|(f, d)| f[0] * d[0] + f[1] * d[1] + f[2] * d[2]).sum()
    };
    // of second degree, so that differences are exact
    let slope = -(after.0 - before.0) / 2e-3;
    assert!((dot(&now.1) / slope - 1.0).abs() < 1e-9, "{} {slope}", dot(&now.1));
    let largest = now.2.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (product, (a, b)) in now.2.iter().zip(after.1.iter().zip(&before.1)) {
        for k in 0..3 {
            let off = product[k] + (a[k] - b[k]) / 2e-3;
            assert!(off.abs() < 1e-9 * largest, "{off} of {largest}");
        }
    }
    // it resists along every field, and pulls nothing about
    assert!(dot(&now.2) > 0.0);
    let sum: DVec3 = now.1.iter().map(|f| DVec3::new(f[0], f[1], f[2])).sum();
    assert!(sum.length() < 1e-12 * largest, "{sum}");
}

/// Copies come in place: glue has no energy then, and none in a rigid motion of both.
#[test]
fn glue_comes_without_energy() {
    let all = Solid::ALL.map(|solid| [(solid, Precision::F64), (solid, Precision::F32)]);
    for (solid, precision) in all.into_iter().flatten() {
        let mut scene = scene(5.0, false, options(precision, 1), Stated { solid, ..SI });
        let before = scene.simulation.evaluate();
        let edge = |y: f64| [DVec3::new(0.029, y, 0.07), DVec3::new(0.031, y, 0.033)];
        scene.simulation.cut(scene.body, &[edge(-0.01), edge(0.025)]).unwrap();
        let report = scene.glue();
        assert!(report.springs > 0 && before > 0.0, "{report:?}");
        assert_eq!((report.energy, report.released), (0.0, 0.0));
        let rounding = if precision == Precision::F64 { 1e-12 } else { 1e-5 };
        // elements with Gauss points get other ones
        let without = match solid {
            Solid::Linear => before,
            _ => {
                let mut own =
                    self::scene(0.0, false, options(precision, 1), Stated { solid, ..SI });
                own.simulation.cut(own.body, &[edge(-0.01), edge(0.025)]).unwrap();
                own.simulation.evaluate()
            }
        };
        assert!((scene.simulation.evaluate() / without - 1.0).abs() < rounding);
        if precision == Precision::F64 {
            let turn = DQuat::from_rotation_y(2.0) * DQuat::from_rotation_z(1.0);
            scene.displace(|_, x| turn * x - x + DVec3::new(1.0, 2.0, 3.0));
            assert_eq!(scene.glue().energy, 0.0);
        }
    }
}

/// In the middle of a stroke a snapshot is taken; what follows has the same bits after it, in another simulation, with other threads.
#[test]
fn glued_strokes_go_on_from_snapshots() {
    let all = Solid::ALL.map(|solid| [(solid, Precision::F64), (solid, Precision::F32)]);
    for (solid, precision) in all.into_iter().flatten() {
        let stated = Stated { solid, ..SI };
        let mut one = scene(5.0, false, options(precision, 1), stated);
        one.draw(0.03, 20);
        let at = one.glue();
        assert!(at.springs > 0 && at.energy > 0.0 && at.released > 0.0, "{at:?}");
        let snapshot = one.simulation.snapshot().unwrap();
        one.draw(0.03, 20);
        let (hash, end) = (one.simulation.state_hash(), one.glue());
        assert!(end.released > at.released, "{end:?} {at:?}");
        one.simulation.restore(&snapshot).unwrap();
        assert_eq!(one.glue(), at);
        one.draw(0.03, 20);
        assert_eq!((one.simulation.state_hash(), one.glue()), (hash, end));
        let mut other = scene(5.0, false, options(precision, 3), stated);
        other.simulation.restore(&Snapshot::from_bytes(&snapshot.to_bytes()).unwrap()).unwrap();
        assert_eq!(other.glue(), at);
        other.draw(0.03, 20);
        assert_eq!((other.simulation.state_hash(), other.glue()), (hash, end));
        // and from the start
        let mut other = scene(5.0, false, options(precision, 3), stated);
        other.draw(0.03, 20);
        other.draw(0.03, 20);
        assert_eq!((other.simulation.state_hash(), other.glue()), (hash, end));
    }
}

/// Where a blade went right through, nothing is held, and both pieces come to rest as they do without glue: each unstrained, where the
/// side goes that is held.
#[test]
fn nothing_is_left_where_all_was_swept() {
    for solid in Solid::ALL {
        nothing_is_left(Stated { solid, ..SI });
    }
}

fn nothing_is_left(stated: Stated) {
    let mut found = Vec::new();
    for glue in [0.0, 5.0] {
        let mut scene = scene(glue, true, options(Precision::F64, 1), stated);
        let mut most = 0;
        for _ in 0..50 {
            scene.draw(0.0015, 1);
            most = most.max(scene.simulation.glue_report(scene.body).map_or(0, |own| own.springs));
        }
        assert_eq!(most > 0, glue > 0.0);
        scene.simulation.step().unwrap();
        if glue > 0.0 {
            let report = scene.glue();
            assert_eq!((report.springs, report.energy), (0, 0.0), "{report:?}");
            assert!(report.released > 0.0, "{report:?}");
        }
        let rows = &scene.simulation.topology().bodies[scene.body.0];
        assert_eq!(rows.piece_count(), 2, "glue {glue}");
        scene.simulation.settle();
        let rest = scene.stated.mesh().points;
        let u = scene.simulation.displacements(scene.body);
        for (u, x) in u.iter().zip(&rest) {
            let way = if x.x < 0.031 { -0.003 } else { 0.003 };
            assert!(u.distance(DVec3::X * way) < 1e-5 * 0.003, "glue {glue}: {u} at {x}");
        }
        let skin = scene.simulation.skin(scene.body).unwrap();
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|p| skin.rest[p as usize]);
            0.5 * (b - a).cross(c - a).length()
        };
        let wound = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound);
        found.push(wound.map(|(t, _)| area(t)).sum::<f64>());
    }
    // lips that move less are crossed elsewhere by a little
    assert!((found[1] / found[0] - 1.0).abs() < 1e-2, "{found:?}");
}

/// It holds: less opens ahead of the blade, and what is behind it opens all the same.
#[test]
fn wounds_open_less_ahead_of_the_blade() {
    for solid in Solid::ALL {
        opens_less(Stated { solid, ..SI });
    }
}

fn opens_less(stated: Stated) {
    let mut gaps = Vec::new();
    for glue in [0.0, 5.0, 50.0] {
        let mut scene = scene(glue, false, options(Precision::F64, 1), stated);
        // into the middle of an element
        scene.draw(if stated.solid == Solid::Hexahedra { 0.0225 } else { 0.0315 }, 40);
        scene.simulation.steps(40);
        let skin = scene.simulation.skin(scene.body).unwrap();
        let edge = scene.simulation.tool_report(scene.blade).unwrap().position.y;
        // both sides of a face of the wound have the same corners at rest
        let wound = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound);
        let mut faces: Vec<[(DVec3, DVec3); 3]> = wound
            .map(|(t, _)| t.map(|p| (skin.rest[p as usize], skin.points[p as usize])))
            .collect();
        let key = |x: DVec3| x.to_array().map(|x| (1e9 * x).round() as i64);
        faces.iter_mut().for_each(|face| face.sort_by_key(|(x, _)| key(*x)));
        faces.sort_by_key(|face| face.map(|(x, _)| key(x)));
        let mut most = [0.0_f64; 2];
        for two in faces.chunk_by(|a, b| a.map(|(x, _)| key(x)) == b.map(|(x, _)| key(x))) {
            let [one, other] = two else { panic!("{} sides", two.len()) };
            for (i, j) in (0..=8).flat_map(|i| (0..=8 - i).map(move |j| (i, j))) {
                let part = [i, j, 8 - i - j].map(|i| f64::from(i) / 8.0);
                let mean = |of: &dyn Fn(usize) -> DVec3| -> DVec3 {
                    (0..3).map(|k| part[k] * of(k)).sum()
                };
                let ahead = usize::from(mean(&|k| one[k].0).y > edge + 0.002);
                most[ahead] = most[ahead].max(mean(&|k| one[k].1 - other[k].1).length());
            }
        }
        gaps.push(most);
    }
    // lips are linear where they are held, too: what opens behind takes some of what is ahead along
    let [without, with, stiff] = [gaps[0], gaps[1], gaps[2]];
    assert!(stiff[1] < with[1] && with[1] < without[1], "{:?} {gaps:?}", stated.solid);
    assert!(with[0] > 0.7 * without[0], "{:?} {gaps:?}", stated.solid);
}

/// Units and a mirror change nothing.
#[test]
fn units_and_mirrors_do_not_matter() {
    for solid in Solid::ALL {
        only_the_scene_matters(Stated { solid, ..SI });
    }
}

fn only_the_scene_matters(si: Stated) {
    let run = |stated| {
        let mut scene = scene(5.0, false, options(Precision::F64, 1), stated);
        let tight = solver!(Integrator::Safe, mass_damping = 20.0, linear_tolerance = 1e-9);
        scene.simulation.set_solver(tight);
        scene.draw(0.033, 20);
        let tool = scene.simulation.tool_report(scene.blade).unwrap().separated;
        (tool, scene.glue())
    };
    let (separated, truth) = run(si);
    assert!(truth.springs > 0 && truth.released > 0.0, "{truth:?}");
    let units = Stated { length: 1e3, mass: 1e3, ..si };
    for stated in [units, Stated { mirror: -1.0, ..si }] {
        let (parted, own) = run(stated);
        assert_eq!((parted, own.springs), (separated, truth.springs));
        let unit = stated.mass * stated.length.powi(2);
        for (own, truth) in [(own.energy, truth.energy), (own.released, truth.released)] {
            // in which points a piece of a hexahedron is integrated depends on its axes
            let is_turned = si.solid == Solid::Hexahedra && stated.mirror < 0.0;
            let bound = if is_turned { 1e-2 } else { 1e-5 };
            assert!((own / (unit * truth) - 1.0).abs() < bound, "{si:?}: {own} {truth}");
        }
    }
}

/// Glue that a stroke left at its end goes with what is removed, holds after another cut beside it, and goes when a blade passes it.
#[test]
fn glue_outlives_its_stroke() {
    let mut scene = scene(5.0, true, options(Precision::F64, 1), SI);
    let edge = |x: f64, y: f64| [DVec3::new(x, y, 0.07), DVec3::new(x, y, -0.01)];
    let along = |x: f64, from: f64, to: f64| [edge(x, from), edge(x, to)];
    scene.simulation.cut(scene.body, &along(0.031, -0.01, 0.027)).unwrap();
    let left = scene.glue().springs;
    assert!(left > 10);
    scene.simulation.steps(20);
    assert!(scene.glue().energy > 0.0);
    assert_as_fresh(&mut scene.simulation, scene.body, "glued");
    let start = scene.simulation.snapshot().unwrap();
    // across its end, far from its places: what is parted there takes it along
    let across = |y: f64| {
        let at = |x: f64| [DVec3::new(x, y, 0.07), DVec3::new(x, y + 0.004, -0.01)];
        [at(-0.01), at(0.07)]
    };
    let energy = scene.simulation.evaluate();
    scene.simulation.cut(scene.body, &across(0.012)).unwrap();
    let report = scene.glue();
    assert!(report.springs >= left && report.released == 0.0, "{report:?} {left}");
    assert!((scene.simulation.evaluate() / energy - 1.0).abs() < 1e-12);
    assert_as_fresh(&mut scene.simulation, scene.body, "cut across");
    scene.simulation.steps(3);
    scene.simulation.restore(&start).unwrap();
    // right through its end
    scene.simulation.cut(scene.body, &across(0.034)).unwrap();
    assert!((scene.simulation.evaluate() / energy - 1.0).abs() < 0.1);
    assert_as_fresh(&mut scene.simulation, scene.body, "cut through");
    scene.simulation.steps(3);
    scene.simulation.restore(&start).unwrap();
    assert_eq!(scene.glue().springs, left);
    // on through the rest
    let report = scene.simulation.cut(scene.body, &along(0.031, 0.02, 0.07)).unwrap();
    let glue = scene.glue();
    assert!(glue.springs == 0 && glue.released > 0.0, "{glue:?}");
    assert_eq!(report.pieces, 2);
    scene.simulation.restore(&start).unwrap();
    // all that is glued is removed
    let mesh = scene.stated.mesh();
    let region = touching(&mesh, |x| (x.x - 0.031).abs() < 0.02 && x.y > 0.02);
    scene.simulation.remove(scene.body, region);
    assert_eq!(scene.glue().springs, 0);
    assert_as_fresh(&mut scene.simulation, scene.body, "removed");
    scene.simulation.steps(3);
}

#[test]
fn glue_says_what_it_cannot_hold() {
    let mesh = SI.mesh();
    let body = BodyDescription::new("block", &mesh, soft(1e4, 0.3));
    for glue in [-1.0, f64::NAN, f64::INFINITY] {
        let text = refused(&BodyDescription { glue, ..body.clone() });
        assert!(text.contains("`block`: glue is") && text.contains("0 or positive"), "{text}");
    }
    let quads = quad_grid(DVec2::splat(SIDE), [2; 2]).unwrap();
    let sheet = MembraneDescription::new(&[], 1e-3, soft(1e4, 0.3));
    let sheet = MembraneDescription { quads: &quads.quads, ..sheet };
    let body = BodyDescription::from_parts("block", &quads.points, &[], soft(1e4, 0.3));
    let text = refused(&BodyDescription { membrane: Some(sheet), glue: 5.0, ..body });
    assert!(text.contains("hexahedra and triangles"), "{text}");
    let mut scene = scene(5.0, false, options(Precision::F64, 1), SI);
    let (strength, toughness, radius, max_speed) = (1e3, None, None, None);
    let tear = Tear { body: scene.body.0, strength, toughness, radius, max_speed };
    let text = scene.simulation.set_tear(tear).unwrap_err().to_string();
    assert!(text.contains("glue") && text.contains("build it without"), "{text}");
}
