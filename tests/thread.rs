//! Threads and clips: answers of a separate program and closed forms, energy and momentum, cuts and removals, snapshots.

use crate::common::*;
use bevy_ecs::prelude::World;
use glam::{DQuat, DVec3};
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::engine::row::VertexRow;
use sinew::engine::scalar::Scalar;
use sinew::engine::surface::PointReader;
use sinew::engine::vertex::{Displacement, RestPosition};
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew::snapshot::Snapshot;
use sinew::touch::thread::ThreadReport;

const SIZE: DVec3 = DVec3::new(0.06, 0.06, 0.03);
const MIDDLE: DVec3 = DVec3::new(0.03, 0.03, 0.04);

/// A block that stands on a table, cut open from above, in units and a place of one's own.
struct Wound {
    simulation: Simulation,
    body: BodyHandle,
    /// Metres per unit, and where it lies.
    unit: f64,
    place: fn(DVec3) -> DVec3,
}

impl Wound {
    fn new(options: SimulationOptions, solid: Solid) -> Self {
        Self::of(options, solid, 1.0, |x| x)
    }

    fn of(options: SimulationOptions, solid: Solid, unit: f64, place: fn(DVec3) -> DVec3) -> Self {
        let mut mesh = solid.spaced(SIZE, [6, 6, 3]);
        let at = |x: DVec3| place(x) / unit;
        place_mesh(&mut mesh, at);
        let material = YoungPoisson {
            young_modulus: 5e3 * unit,
            poisson_ratio: 0.4,
            density: 1000.0 * unit.powi(3),
        };
        let block = BodyDescription::new("block", &mesh, material);
        let (mut simulation, body) = alone(options, &BodyDescription { spare: 1000, ..block });
        simulation.set_gravity((at(DVec3::Z) - at(DVec3::ZERO)) * -9.81);
        let floor = simulation.group_rows(body, &mesh, "z0").unwrap();
        simulation.add_constraint(Constraint::hold("table", floor));
        let edge = |y: f64| [DVec3::new(0.0311, y, 0.04), DVec3::new(0.0311, y, 0.011)].map(at);
        simulation.cut(body, &[edge(-0.01), edge(0.07)]).unwrap();
        simulation.integrate_by(Integrator::Safe);
        Self { simulation, body, unit, place }
    }

    /// A point of tissue, in metres of the block as it lies by default.
    fn tissue(&mut self, at: [f64; 3]) -> Hold {
        let at = (self.place)(DVec3::from(at)) / self.unit;
        self.simulation.tissue_point(self.body, at).unwrap()
    }

    fn hand(&self, at: DVec3) -> Hold {
        Hold::Place((self.place)(at) / self.unit)
    }

    /// A thread through both lips that ends in a hand above.
    fn stitch(&mut self, stiffness: f64) -> Thread {
        let through =
            [[0.02, 0.03, 0.029], [0.022, 0.031, 0.017], [0.04, 0.03, 0.016], [0.042, 0.03, 0.029]];
        let mut points: Vec<Hold> = through.map(|at| self.tissue(at)).to_vec();
        points.push(self.hand(MIDDLE));
        Thread::new("stitch", points, stiffness)
    }
}

fn one() -> SimulationOptions {
    options(Precision::F64, 1)
}

fn report(simulation: &Simulation, thread: bevy_ecs::entity::Entity) -> ThreadReport {
    simulation.thread_report(thread).unwrap().clone()
}

fn places<S: Scalar>(world: &mut World) -> Vec<DVec3> {
    let mut all = world.query::<(&RestPosition, &Displacement<S>)>();
    all.iter(world).map(|(rest, u)| rest.0 + u.get()).collect()
}

/// Where a point of tissue is now; none where it is gone.
fn place_of(simulation: &mut Simulation, hold: &Hold) -> Option<DVec3> {
    let Hold::Tissue { body, element, vertices, weights } = hold else { panic!("{hold:?}") };
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{hold:?}");
    let precision = simulation.precision();
    let world = simulation.world_mut();
    let reader = world.resource::<PointReader>().0;
    let (rows, weights) = reader(world, *body, *element, (*vertices, *weights))?;
    let at = match precision {
        Precision::F32 => places::<f32>(world),
        Precision::F64 => places::<f64>(world),
    };
    Some(rows.iter().zip(weights).map(|(VertexRow(row), w)| w * at[*row as usize]).sum())
}

#[test]
fn points_are_where_they_are_found_and_go_with_the_tissue() {
    for (solid, precision) in
        Solid::ALL.into_iter().flat_map(|s| [(s, Precision::F64), (s, Precision::F32)])
    {
        // whole, also of hexahedra whose faces are not plane
        let mesh = jitter_interior(&solid.block(0.03, 3), 0.2, 3).unwrap();
        let block = BodyDescription::new("block", &mesh, soft(1e4, 0.3));
        let (mut simulation, body) = alone(options(precision, 1), &block);
        let affine =
            |x: DVec3| DVec3::new(x.y - 0.3 * x.z, 0.2 * x.y - 1.1 * x.x, 0.9 * x.z) * 1.25;
        let bent = |x: DVec3| x + DVec3::new(8.0 * x.y * x.y, 0.0, 5.0 * x.x * x.y);
        let mut grid = Vec::new();
        for i in 0..343 {
            grid.push(DVec3::from(
                [i % 7, i / 7 % 7, i / 49].map(|i| 1e-3 + 4.6e-3 * f64::from(i)),
            ));
        }
        let all: Vec<Hold> =
            grid.iter().map(|x| simulation.tissue_point(body, *x).unwrap()).collect();
        let moved = |map: &dyn Fn(DVec3) -> DVec3| -> Vec<DVec3> {
            mesh.points.iter().map(|x| map(*x) - *x).collect()
        };
        simulation.displace(body, &moved(&affine));
        // columns of f32 round displacements of vertices
        let enough = if precision == Precision::F32 { 1e-8 } else { 1e-12 * 0.03 };
        for (x, hold) in grid.iter().zip(&all) {
            let at = place_of(&mut simulation, hold).unwrap();
            assert!(at.distance(affine(*x)) < enough, "{solid:?} {precision:?} {x}: {at}");
        }
        simulation.displace(body, &moved(&bent));
        let mut found = 0;
        for x in &grid {
            let Some(hold) = simulation.tissue_point(body, bent(*x)) else { continue };
            let at = place_of(&mut simulation, &hold).unwrap();
            assert!(at.distance(bent(*x)) < 1e-12 * 0.03, "{solid:?} {precision:?} {x}: {at}");
            found += 1;
        }
        assert_eq!(found, grid.len(), "{solid:?}");
    }
}

#[test]
fn points_of_what_was_cut_are_where_they_are_found() {
    for (solid, precision) in
        Solid::ALL.into_iter().flat_map(|s| [(s, Precision::F64), (s, Precision::F32)])
    {
        let mut wound = Wound::new(options(precision, 1), solid);
        wound.simulation.steps(10);
        let mut found = [0; 2];
        for i in 0..1000 {
            let own =
                DVec3::from([i % 10, i / 10 % 10, i / 100].map(|i| 0.03 + 0.1 * f64::from(i)));
            // round the wound
            let x = DVec3::new(0.02, 0.0, 0.008) + own * DVec3::new(0.022, 0.06, 0.02);
            let Some(hold) = wound.simulation.tissue_point(wound.body, x) else {
                assert!((x.x - 0.0311).abs() < 3e-3, "{solid:?} {precision:?}: a hole at {x}");
                continue;
            };
            let at = place_of(&mut wound.simulation, &hold).unwrap();
            assert!(at.distance(x) < 1e-12 * 0.06, "{solid:?} {precision:?} {x}: {at}");
            found[usize::from(x.x > 0.0311)] += 1;
        }
        assert!(found.iter().all(|n| *n > 400), "{solid:?} {found:?}");
    }
}

/// Ratio of the tensions at the ends of a thread that turns by angles round rings, drawn at its last end.
fn capstan(friction: f64, grip: f64, angles: &[f64], integrator: Integrator) -> ThreadReport {
    let mesh = box_tets(DVec3::splat(0.01), [1, 1, 1]).unwrap();
    let (mut simulation, _) = alone(one(), &BodyDescription::new("aside", &mesh, soft(1e4, 0.3)));
    simulation.integrate_by(integrator);
    let (mut at, mut turned) = (DVec3::ZERO, 0.0_f64);
    let mut rings = vec![Hold::Place(at)];
    for angle in [&[0.0], angles].concat() {
        turned += angle;
        at += 0.01 * DVec3::new(turned.cos(), turned.sin(), 0.0);
        rings.push(Hold::Place(at));
    }
    let thread = Thread { friction, grip, ..Thread::new("thread", rings, 20.0) };
    let thread = simulation.add_thread(thread).unwrap();
    for step in 1..=5 {
        simulation.draw_thread(thread, 1, 2e-4 * f64::from(step)).unwrap();
        simulation.step().unwrap();
    }
    report(&simulation, thread)
}

#[test]
fn friction_holds_what_a_capstan_holds() {
    let half = [0.5; 6];
    let cases: [(f64, &[f64], f64); 4] = [
        (0.0, &half, 1.0),
        (0.1, &half, 1.349_858_807_576_003),
        (0.3, &half, 2.459_603_111_156_949_4),
        (0.2, &[0.3, 1.2, 0.7], 1.552_707_218_511_336_2),
    ];
    for integrator in [Integrator::Safe, Integrator::Auto, Integrator::SymplecticEuler] {
        for (mu, angles, ratio) in cases {
            let found = capstan(mu, 0.0, angles, integrator);
            let (first, last) = (found.tension[0], *found.tension.last().unwrap());
            assert!((last / first / ratio - 1.0).abs() < 1e-6, "{integrator:?} {mu}: {found:?}");
            // drawn through all rings towards the hand, and the hand's work is stored or lost
            assert!(found.slid[1..=angles.len()].iter().all(|s| *s < 0.0), "{found:?}");
            let length: f64 = found.free.iter().sum();
            let stored: f64 =
                found.tension.iter().zip(&found.free).map(|(t, l)| t * t * l / 40.0).sum();
            assert!((length / (0.01 * angles.len() as f64 + 0.01 - 1e-3) - 1.0).abs() < 1e-12);
            assert!(
                found.dissipation >= 0.0 && stored + found.dissipation < found.work,
                "{found:?}"
            );
        }
        // what rings hold of themselves adds up
        let found = capstan(0.0, 0.02, &half, integrator);
        for pair in found.tension.windows(2) {
            assert!((pair[1] - pair[0] - 0.02).abs() < 1e-8, "{found:?}");
        }
    }
}

/// Energy of a simulation, and what was put into it since the start.
struct Books {
    work: f64,
    first: Option<f64>,
}

impl Books {
    fn check(&mut self, simulation: &Simulation, what: &str) {
        let now = simulation.report();
        let energy = now.elastic_energy + now.kinetic_energy + now.contact.energy;
        let put_in = now.contact.work + now.load_work + now.constraint_work;
        self.work += put_in;
        let first = *self.first.get_or_insert(energy + now.dissipation - put_in);
        let scale = energy + first.abs() + self.work.abs();
        let allowed = if simulation.precision() == Precision::F32 { 1e-4 } else { 1e-9 } * scale;
        assert!(energy.is_finite(), "{what}");
        assert!(energy - first <= self.work + allowed, "{what}: {energy} {first} {}", self.work);
    }
}

#[test]
fn a_stiff_thread_that_is_torn_at_puts_in_no_more_than_the_hand_does() {
    let integrators =
        [Integrator::Safe, Integrator::Auto, Integrator::Newton, Integrator::LinearisedTrBdf2];
    for (solid, precision) in [
        (Solid::Linear, Precision::F64),
        (Solid::Linear, Precision::F32),
        (Solid::TenNodes, Precision::F64),
        (Solid::Hexahedra, Precision::F32),
    ] {
        for integrator in integrators {
            for friction in [0.0, 0.2] {
                for moves in [false, true] {
                    let what = format!("{solid:?} {precision:?} {integrator:?} {friction} {moves}");
                    let mut wound = Wound::new(options(precision, 1), solid);
                    let mut stitch = wound.stitch(1e3);
                    stitch.friction = friction;
                    let simulation = &mut wound.simulation;
                    let thread = simulation.add_thread(stitch).unwrap();
                    simulation.integrate_by(integrator);
                    simulation.set_dt(0.033);
                    let mut books = Books { work: 0.0, first: None };
                    // 1 m/s for a tenth of a second, then still
                    for step in 1..=12 {
                        let way = 0.033 * f64::from(step.min(3));
                        if moves {
                            simulation.move_thread(thread, 4, MIDDLE + way * DVec3::Z).unwrap();
                        } else {
                            let drawn = way * 0.4;
                            simulation.draw_thread(thread, 1, drawn).unwrap();
                        }
                        simulation.step().unwrap();
                        if integrator != Integrator::Auto {
                            books.check(simulation, &what);
                        }
                        let found = report(simulation, thread);
                        assert!(found.largest().is_finite() && found.dissipation >= 0.0, "{what}");
                    }
                    assert!(simulation.report().dissipation >= -1e-6 * books.work, "{what}");
                    assert!(report(simulation, thread).largest() > 0.1, "{what}");
                }
            }
        }
    }
}

#[test]
fn what_holds_together_keeps_its_momentum() {
    let integrators =
        [Integrator::Safe, Integrator::Auto, Integrator::Newton, Integrator::SymplecticEuler];
    for (solid, integrator) in Solid::ALL.into_iter().flat_map(|s| integrators.map(|i| (s, i))) {
        let mesh = solid.spaced(DVec3::splat(0.02), [2; 3]);
        let mut simulation = Simulation::new(one()).unwrap();
        let bodies = [0.0, 1.0].map(|i| {
            let mesh = mesh.transformed(1.0, DQuat::IDENTITY, DVec3::new(0.025, 0.003, 0.0) * i);
            let name = format!("block {i}");
            simulation.add_body(&BodyDescription::new(&name, &mesh, soft(1e4, 0.3))).unwrap()
        });
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_solver(solver!(integrator, linear_tolerance = 1e-8));
        simulation.set_dt(0.005);
        let at = |x, y, z| DVec3::new(x, y, z);
        let mut tissue = |body: usize, at| simulation.tissue_point(bodies[body], at).unwrap();
        let ends = [tissue(0, at(0.018, 0.012, 0.009)), tissue(1, at(0.027, 0.01, 0.013))];
        let loop_ = vec![
            tissue(0, at(0.004, 0.007, 0.015)),
            tissue(1, at(0.031, 0.018, 0.004)),
            tissue(0, at(0.017, 0.004, 0.003)),
        ];
        let clip = simulation.add_clip(Clip::new("clip", ends, 50.0)).unwrap();
        let thread =
            Thread { length: Some(0.045), friction: 0.2, ..Thread::new("thread", loop_, 5.0) };
        let thread = simulation.add_thread(thread).unwrap();
        for _ in 0..40 {
            simulation.step().unwrap();
        }
        let (mut p, mut l, mut scale) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for body in bodies {
            let (m, v) = (simulation.masses(body), simulation.velocities(body));
            for ((m, v), x) in m.iter().zip(v).zip(simulation.positions(body)) {
                (p, l, scale) = (p + *m * v, l + *m * x.cross(v), scale + m * v.length());
            }
        }
        assert!(scale > 1e-4, "nothing moves");
        assert!(p.length() < 1e-12 * scale, "{solid:?} {integrator:?}: {p} {scale}");
        // angular momentum is that of the integrator: explicit steps keep it
        if integrator == Integrator::SymplecticEuler {
            assert!(l.length() < 1e-6 * scale * 0.05, "{l}");
        }
        let found = [report(&simulation, clip), report(&simulation, thread)];
        // of 51 mm
        let most = if solid == Solid::Linear { 0.045 } else { 0.047 };
        for own in found {
            assert!(own.length < most && own.lost == 0, "{solid:?} {integrator:?} {own:?}");
        }
    }
}

/// Tensions of a stitch after some steps.
fn pulled(mut wound: Wound) -> ThreadReport {
    let mut stitch = wound.stitch(20.0 / wound.unit);
    stitch.friction = 0.15;
    let simulation = &mut wound.simulation;
    simulation.set_solver(solver!(Integrator::Safe, linear_tolerance = 1e-8));
    let thread = simulation.add_thread(stitch).unwrap();
    for step in 1..=15 {
        simulation.draw_thread(thread, 1, 2e-4 * f64::from(step) / wound.unit).unwrap();
        simulation.step().unwrap();
    }
    report(simulation, thread)
}

#[test]
fn neither_place_nor_units_nor_threads_nor_digits_matter() {
    Solid::ALL.into_iter().for_each(is_the_same_everywhere);
}

fn is_the_same_everywhere(solid: Solid) {
    let truth = pulled(Wound::new(one(), solid));
    assert!(
        truth.largest() > 0.05 && truth.tension[0] < 0.9 * truth.tension[3],
        "{solid:?} {truth:?}"
    );
    let three = pulled(Wound::new(options(Precision::F64, 3), solid));
    assert_eq!(truth, three);
    let turn: fn(DVec3) -> DVec3 = |x| DQuat::from_xyzw(0.1, -0.5, 0.3, 0.8).normalize() * x;
    let mirror: fn(DVec3) -> DVec3 = |x| DVec3::new(-x.x, x.y, x.z);
    let others = [
        ("turned", 1e-3, Wound::of(one(), solid, 1.0, turn)),
        // in which points a piece of a hexahedron is integrated depends on its axes
        (
            "mirrored",
            if solid == Solid::Hexahedra { 1e-2 } else { 1e-3 },
            Wound::of(one(), solid, 1.0, mirror),
        ),
        ("in millimetres", 1e-3, Wound::of(one(), solid, 1e-3, |x| x)),
        ("f32", 1e-3, Wound::new(options(Precision::F32, 1), solid)),
    ];
    for (what, enough, wound) in others {
        let unit = wound.unit;
        let found = pulled(wound);
        for (t, of_truth) in found.tension.iter().zip(&truth.tension) {
            // kg m/s^2 = kg 1000 mm/s^2
            assert!(
                (t * unit / of_truth - 1.0).abs() < enough,
                "{solid:?} {what}: {found:?} {truth:?}"
            );
        }
    }
}

#[test]
fn a_snapshot_in_the_middle_goes_on_with_the_same_bits() {
    let integrators = [Integrator::Auto, Integrator::SymplecticEuler];
    for (solid, integrator) in Solid::ALL.into_iter().flat_map(|s| integrators.map(|i| (s, i))) {
        let build = || {
            let mut wound = Wound::new(one(), solid);
            wound.simulation.integrate_by(integrator);
            let mut stitch = wound.stitch(20.0);
            stitch.friction = 0.15;
            let (a, b) = (wound.tissue([0.025, 0.05, 0.025]), wound.tissue([0.038, 0.05, 0.024]));
            let thread = wound.simulation.add_thread(stitch).unwrap();
            wound.simulation.add_clip(Clip::new("clip", [a, b], 40.0)).unwrap();
            (wound, thread)
        };
        let go = |wound: &mut Wound, thread, steps: std::ops::Range<u32>| {
            for step in steps {
                wound.simulation.draw_thread(thread, 1, 3e-4 * f64::from(step)).unwrap();
                wound.simulation.step().unwrap();
            }
        };
        let (mut wound, thread) = build();
        go(&mut wound, thread, 1..6);
        let middle = wound.simulation.snapshot().unwrap();
        go(&mut wound, thread, 6..12);
        let hash = wound.simulation.state_hash();
        let truth = report(&wound.simulation, thread);
        wound.simulation.restore(&middle).unwrap();
        go(&mut wound, thread, 6..12);
        assert_eq!(
            (wound.simulation.state_hash(), report(&wound.simulation, thread)),
            (hash, truth)
        );
        // into another simulation, and where the thread was taken away meanwhile
        let (mut other, thread) = build();
        assert!(other.simulation.remove_contact(thread));
        other.simulation.restore(&Snapshot::from_bytes(&middle.to_bytes()).unwrap()).unwrap();
        let thread = other.simulation.find::<Thread>("stitch").unwrap();
        go(&mut other, thread, 6..12);
        assert_eq!(other.simulation.state_hash(), hash);
    }
}

#[test]
fn points_go_with_their_side_of_a_cut_and_are_lost_with_their_elements() {
    Solid::ALL.into_iter().for_each(points_go_with_their_side);
}

fn points_go_with_their_side(solid: Solid) {
    let mut wound = Wound::new(one(), solid);
    // in the same elements, on either side of a second cut
    let y = |y: f64| [0.015, y, 0.028];
    let holds = [wound.tissue(y(0.0455)), wound.tissue(y(0.0445))];
    let of = |hold: &Hold| match hold {
        Hold::Tissue { element, .. } => *element,
        _ => panic!(),
    };
    let simulation = &mut wound.simulation;
    let [a, b] = [&holds[0], &holds[1]].map(of);
    let thread = Thread { length: Some(1e-4), ..Thread::new("thread", holds.to_vec(), 0.05) };
    let thread = simulation.add_thread(thread).unwrap();
    simulation.step().unwrap();
    let edge = |x: f64| [DVec3::new(x, 0.045, 0.035), DVec3::new(x, 0.045, 0.015)];
    let cut = simulation.cut(wound.body, &[edge(-0.01), edge(0.07)]).unwrap();
    assert!(cut.separated.contains(&a) && cut.separated.contains(&b), "the cut misses them");
    // the wound is drawn open, but for the thread
    simulation.steps(30);
    let found = report(simulation, thread);
    assert_eq!((found.lost, found.held.clone()), (0, vec![0, 1]));
    assert!(found.points[0].y > found.points[1].y && found.spans[0] < 0.0011, "{found:?}");
    // a clip with its points in one element pulls at nothing, parted ones at both lips
    let [up, down] = found.ends;
    assert!(up.length() > 1e-3 && (up + down).length() < 1e-12, "{found:?}");
    // the piece of one element that has the first point goes
    simulation.remove(wound.body, Region::Sphere { centre: found.points[0], radius: 0.01 });
    simulation.step().unwrap();
    assert!(report(simulation, thread).lost > 0);
    let codes: Vec<String> = simulation.warnings().into_iter().map(|w| w.code).collect();
    assert!(codes.iter().any(|code| code == "run.thread.lost"), "{codes:?}");
}

#[test]
fn a_clip_breaks_and_a_loose_end_slips_off() {
    let mut wound = Wound::new(one(), Solid::Linear);
    let ends = [wound.tissue([0.02, 0.02, 0.025]), wound.tissue([0.042, 0.02, 0.025])];
    let through = vec![
        wound.tissue([0.02, 0.04, 0.025]),
        wound.tissue([0.042, 0.04, 0.025]),
        wound.hand(MIDDLE),
    ];
    let simulation = &mut wound.simulation;
    let strong = Clip { length: 0.015, ..Clip::new("strong", ends.clone(), 20.0) };
    let clip = |strength| Clip { strength, ..strong.clone() };
    let holds = simulation.add_clip(clip(None)).unwrap();
    simulation.steps(5);
    let force = report(simulation, holds).largest();
    assert!(simulation.remove_contact(holds) && force > 1e-3, "{force}");
    simulation.steps(20);
    let weak = simulation.add_clip(clip(Some(0.5 * force))).unwrap();
    simulation.steps(2);
    let found = report(simulation, weak);
    assert!(found.broken && found.dissipation > 0.0, "{found:?}");
    // 2 mm beyond the first point, of which 1 mm is drawn out
    let thread = Thread { tails: [0.002, 0.0], grip: 0.01, ..Thread::new("loose", through, 20.0) };
    let thread = simulation.add_thread(thread).unwrap();
    for step in 1..=40 {
        simulation.draw_thread(thread, 1, 1e-4 * f64::from(step)).unwrap();
        simulation.step().unwrap();
        let found = report(simulation, thread);
        match step {
            1..=18 => {
                assert_eq!(found.lost, 0);
                // nothing holds it but what its points hold
                assert!(
                    found.tension[0] < 0.01 + 1e-9 && found.tension[1] < 0.02 + 1e-9,
                    "{found:?}"
                );
            }
            25.. => assert_eq!((found.lost, found.held.clone()), (1, vec![1, 2])),
            _ => {}
        }
    }
}

#[test]
fn threads_are_tied_and_cut() {
    let mut wound = Wound::new(one(), Solid::Linear);
    let stitch = wound.stitch(20.0);
    let simulation = &mut wound.simulation;
    let thread = simulation.add_thread(stitch).unwrap();
    assert!(simulation.tie_thread(thread).is_err());
    for step in 1..=20 {
        simulation.draw_thread(thread, 1, 2e-4 * f64::from(step)).unwrap();
        simulation.step().unwrap();
    }
    let before = report(simulation, thread);
    let tied = simulation.tie_thread(thread).unwrap();
    simulation.step().unwrap();
    let found = report(simulation, tied);
    assert_eq!((found.held.len(), found.points[0]), (5, found.points[4]));
    // as taut as it was: the ends are drawn together now, where a hand drew them up
    let closing = before.points[0].distance(before.points[3]) / (1.0 + before.largest() / 20.0);
    let free = [&before.free[..3], &[closing]].concat().iter().sum::<f64>();
    assert!((found.free.iter().sum::<f64>() / free - 1.0).abs() < 1e-12);
    assert!((0.4..1.0).contains(&(found.largest() / before.largest())), "{found:?} {before:?}");
    let [a, b] = simulation.cut_thread(tied, 1).unwrap();
    simulation.steps(3);
    for part in [a, b].into_iter().flatten() {
        assert_eq!(report(simulation, part).largest(), 0.0);
    }
    assert!(a.is_some() && b.is_some() && simulation.thread_report(tied).is_none());
    assert!(simulation.cut_thread(tied, 0).is_err());
}

#[test]
fn what_cannot_be_used_is_named() {
    let mut wound = Wound::new(one(), Solid::Linear);
    assert!(wound.simulation.tissue_point(wound.body, DVec3::Z).is_none());
    let good = wound.stitch(20.0);
    let simulation = &mut wound.simulation;
    let tissue = |weights| match &good.points[0] {
        Hold::Tissue { body, element, vertices, .. } => {
            Hold::Tissue { body: *body, element: *element, vertices: *vertices, weights }
        }
        _ => panic!(),
    };
    let bad = [
        (Thread { stiffness: 0.0, ..good.clone() }, "stiffness is 0 N"),
        (Thread { length: Some(-1.0), ..good.clone() }, "length is -1 m"),
        (Thread { friction: f64::NAN, ..good.clone() }, "friction is NaN"),
        (Thread { grip: -0.1, ..good.clone() }, "must not be negative"),
        (Thread { drawn: [0.0, f64::INFINITY], ..good.clone() }, "not finite"),
        (Thread { tails: [0.0, 0.1], drawn: [0.0, 0.1], ..good.clone() }, "end that is free"),
        (Thread { points: vec![good.points[0].clone()], ..good.clone() }, "two points"),
        (Thread { points: vec![tissue([0.5; 4]); 2], ..good.clone() }, "sum to 1"),
    ];
    for (thread, problem) in bad {
        let error = simulation.add_thread(thread).unwrap_err().to_string();
        assert!(error.contains(problem), "{error}");
    }
    let clip = Clip::new("clip", [good.points[0].clone(), good.points[1].clone()], -1.0);
    let error = simulation.add_clip(clip).unwrap_err().to_string();
    assert!(error.contains("`clip`: its stiffness is -1 N/m"), "{error}");
    // more than there is
    let thread = simulation.add_thread(good).unwrap();
    simulation.step().unwrap();
    simulation.draw_thread(thread, 1, 1.0).unwrap();
    let hash = simulation.state_hash();
    let error = simulation.step().unwrap_err().to_string();
    assert!(error.contains("`stitch`") && error.contains("are left"), "{error}");
    assert_eq!(simulation.state_hash(), hash);
    simulation.draw_thread(thread, 1, 0.0).unwrap();
    simulation.step().unwrap();
    assert!(simulation.move_thread(thread, 0, DVec3::ZERO).is_err());
}
