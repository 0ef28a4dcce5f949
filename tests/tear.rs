//! Tears: the load at which a wound goes on, how it goes, and what must hold meanwhile.

use crate::common::*;
use crate::snapshot::{Scene, exact};
use glam::{DQuat, DVec3};
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, jitter_interior};
use sinew::engine::mesh::{Mesh, Surface};
use sinew::engine::vertex::{FixedAxes, Mass};
use sinew::models::body::VolumeRule;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;

/// Bears a stress (Pa) on both sides across x.
fn pull(s: &mut Simulation, body: BodyHandle, mesh: &Mesh, stress: f64) {
    for (side, sign) in [("x0", -1.0), ("x1", 1.0)] {
        let own = &mesh.group(side).unwrap().cells;
        let on = Surface {
            triangles: own.triangles.iter().map(|&t| mesh.triangles[t as usize]).collect(),
            quads: own.quads.iter().map(|&q| mesh.quads[q as usize]).collect(),
        };
        let faces = s.traction_faces(body, side, &on, DVec3::X * (sign * stress)).unwrap();
        s.add_loaded_faces(side, faces, Curve::Constant);
    }
}

/// The stress that is compared is that of Cauchy, force by present area.
#[test]
fn a_bar_tears_at_its_strength() {
    let laws = [(Model::StVK, 0.0), (Model::NeoHookean, 0.3), (Model::StVKVolume, 0.3)];
    let all = Solid::ALL.map(|solid| laws.map(|(model, nu)| (solid, model, nu)));
    for (solid, model, nu) in all.into_iter().flatten() {
        let mesh = solid.slab(DVec3::new(0.04, 0.02, 0.02), [8, 4, 4]);
        let description = BodyDescription::new("bar", &mesh, soft(1e4, nu));
        let (spare, stress) = (400, 2e3);
        let description = BodyDescription { spare, model, ..description };
        let (mut s, body) = alone(SimulationOptions::default(), &description);
        s.set_gravity(DVec3::ZERO);
        for (side, axis) in [("x0", 1), ("y0", 2), ("z0", 4)] {
            let rows = s.group_rows(body, &mesh, side).unwrap();
            s.add_constraint(Constraint { axes: FixedAxes(axis), ..Constraint::hold(side, rows) });
        }
        pull(&mut s, body, &mesh, stress);
        s.set_solver(solver!(
            Integrator::QuasiStatic,
            linear_tolerance = 1e-10,
            newton_tolerance = 1e-9
        ));
        s.step().unwrap();
        let u = s.displacements(body);
        let side = |k: usize| u.iter().map(|u| u[k].abs()).fold(0.0, f64::max) / 0.02;
        let cauchy = stress / (1.0 - side(1)).powi(2);
        for (part, begun) in [(1.001, 0), (0.999, 1)] {
            let strength = cauchy * part;
            s.set_tear(Tear {
                body: body.0,
                strength,
                toughness: None,
                radius: None,
                max_speed: None,
            })
            .unwrap();
            s.step().unwrap();
            let report = s.tear_report(body).unwrap();
            assert_eq!(report.begun, begun, "{solid:?} {model:?} {part}");
        }
    }
}

/// A long strip whose edges are held and drawn apart, with a wound between them: by area it releases the energy of the strip far before
/// it, `W h` (Rivlin and Thomas 1953, section 3), whatever its length. The law tells `W`, and so do two lengths.
#[test]
fn energy_release_is_that_of_a_longer_wound() {
    let (size, stretch, young, nu) = (DVec3::new(0.12, 0.04, 0.01), 1.2, 1e4, 0.3);
    let strip = |across: usize, model: Model, length: f64| {
        let cells = [3 * across, across, across / 4];
        let mesh = jitter_interior(&box_tets(size, cells).unwrap(), 0.2, 5).unwrap();
        let body = BodyDescription::new("strip", &mesh, soft(young, nu));
        let body = BodyDescription { spare: 4000, model, ..body };
        let (mut s, body) = alone(SimulationOptions::default(), &body);
        s.set_gravity(DVec3::ZERO);
        for (side, axis) in [("z0", 4), ("z1", 4)] {
            let rows = s.group_rows(body, &mesh, side).unwrap();
            s.add_constraint(Constraint { axes: FixedAxes(axis), ..Constraint::hold(side, rows) });
        }
        for (side, sign) in [("y0", -0.5), ("y1", 0.5)] {
            let rows = s.group_rows(body, &mesh, side).unwrap();
            let motion = Motion::Translate(DVec3::Y * (sign * (stretch - 1.0) * size.y));
            s.add_constraint(Constraint::moving(side, rows, motion, Curve::Constant));
        }
        let edge = |x: f64| [-0.01, 0.02].map(|z| DVec3::new(x, 0.0203, z));
        let area = s.cut(body, &[edge(-0.01), edge(length)]).unwrap().area;
        s.set_solver(solver!(
            Integrator::QuasiStatic,
            linear_tolerance = 1e-8,
            newton_tolerance = 1e-7
        ));
        s.step().unwrap();
        (s, body, area)
    };
    let set = |s: &mut Simulation, body: BodyHandle, toughness: f64, radius: Option<f64>| {
        let toughness = Some(toughness);
        s.set_tear(Tear { body: body.0, strength: 1e9, toughness, radius, max_speed: None })
            .unwrap();
        s.step().unwrap();
        s.tear_report(body).unwrap()
    };
    // of critical loads, beside the continuum, with these elements across
    for (model, across, most) in [
        (Model::StVK, 8, 1.19),
        (Model::StVK, 12, 1.11),
        (Model::StVK, 16, 1.10),
        (Model::NeoHookean, 12, 1.11),
    ] {
        let [(mut s, body, less), (mut longer, _, more)] =
            [0.045, 0.075].map(|x| strip(across, model, x));
        let [short, long] = [&mut s, &mut longer].map(|s| s.evaluate());
        let truth = (short - long) / (more - less);
        if model == Model::StVK {
            let strain = 0.5 * (stretch * stretch - 1.0);
            let moduli = young * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu));
            let closed = 0.5 * moduli * strain * strain * size.y;
            assert!((truth / closed - 1.0).abs() < 0.05, "{truth} {closed}");
        }
        let whole = set(&mut s, body, 1e9, Some(0.01));
        let few = set(&mut s, body, 1e9, None);
        let load = (truth / whole.energy_release).sqrt();
        assert!((0.95..most).contains(&load), "{model:?} {across}: {load}");
        // the radius decides what the stress is, not what is released
        let [stress, release] =
            [few.stress / whole.stress, few.energy_release / whole.energy_release];
        assert!((release.sqrt() - 1.0).abs() < 0.12, "{model:?} {across}: {release}");
        assert!(across < 16 || stress > 1.2, "{stress}");
        // it goes on by toughness, however strong it is
        for (part, parted) in [(1.001, false), (0.999, true)] {
            let report = set(&mut s, body, whole.energy_release * part, Some(0.01));
            assert_eq!(report.separated > 0, parted, "{part} {report:?}");
        }
    }
}

/// A strip that is drawn apart at both ends, with a notch in its edge; in units of so many metres, and turned.
struct Strip {
    precision: Precision,
    threads: usize,
    unit: f64,
    turn: DQuat,
    solid: Solid,
    spare: usize,
    toughness: Option<f64>,
    max_speed: Option<f64>,
}

impl Default for Strip {
    fn default() -> Self {
        let (precision, threads, unit, turn) = (Precision::F64, 1, 1.0, DQuat::IDENTITY);
        let (solid, spare) = (Solid::Linear, 1000);
        Self { precision, threads, unit, turn, solid, spare, toughness: None, max_speed: None }
    }
}

const STRENGTH: f64 = 1e4;
const TOUGHNESS: Option<f64> = Some(30.0);
/// Area (m^2) across the strip beside its notch.
const LEFT: f64 = (0.03 - 0.008) * 0.006;

impl Strip {
    /// Without a tear, and with.
    fn whole(&self) -> (Simulation, BodyHandle) {
        let cells = if self.solid == Solid::TenNodes { [14, 7, 2] } else { [20, 10, 2] };
        let mut mesh = self.solid.slab(DVec3::new(0.06, 0.03, 0.006), cells);
        if self.solid == Solid::Hexahedra {
            // between equals rounding would decide
            mesh = jitter_interior(&mesh, 0.1, 5).unwrap();
        }
        let place = |x: DVec3| self.turn * x / self.unit;
        mesh.points.iter_mut().for_each(|x| *x = place(*x));
        let material = YoungPoisson {
            young_modulus: 3e4 * self.unit,
            poisson_ratio: 0.4,
            density: 1e3 * self.unit.powi(3),
        };
        let body = BodyDescription::new("strip", &mesh, material);
        let body = BodyDescription { spare: self.spare, model: Model::NeoHookean, ..body };
        let (mut s, body) = alone(options(self.precision, self.threads), &body);
        s.set_gravity(DVec3::ZERO);
        for (end, way) in [("x0", -0.01), ("x1", 0.01)] {
            let rows = s.group_rows(body, &mesh, end).unwrap();
            let motion = Motion::Translate(place(DVec3::X * way));
            let ramp = Curve::Points(vec![[0.0, 0.0], [0.55, 1.0]]);
            s.add_constraint(Constraint::moving(end, rows, motion, ramp));
        }
        let edge = |y: f64| [DVec3::new(0.0305, y, -0.01), DVec3::new(0.0305, y, 0.02)].map(place);
        s.cut(body, &[edge(-0.001), edge(0.008)]).unwrap();
        s.set_solver(solver!(Integrator::Safe, mass_damping = 5.0));
        (s, body)
    }

    fn tear(&self, s: &mut Simulation, body: BodyHandle) {
        let Self { toughness, max_speed, unit, .. } = *self;
        let few = if self.solid == Solid::TenNodes { 0.0075 } else { 0.0055 };
        let radius = Some(toughness.map_or(few, |_| 0.007) / unit);
        let strength = STRENGTH * unit;
        s.set_tear(Tear { body: body.0, strength, toughness, radius, max_speed }).unwrap();
    }

    fn build(&self) -> (Simulation, BodyHandle) {
        let (mut s, body) = self.whole();
        self.tear(&mut s, body);
        (s, body)
    }
}

/// Steps until a body is in pieces, but for so many steps at most.
fn until_torn(s: &mut Simulation, body: BodyHandle, most: u32) -> Option<u32> {
    (1..=most).find(|_| {
        s.step().unwrap();
        s.tear_report(body).unwrap().pieces > 1
    })
}

#[test]
fn a_strip_tears_across_from_its_notch() {
    let all = [
        (Solid::Linear, Precision::F32, None),
        (Solid::Linear, Precision::F64, TOUGHNESS),
        (Solid::TenNodes, Precision::F64, None),
        (Solid::Hexahedra, Precision::F64, None),
        (Solid::Hexahedra, Precision::F32, None),
    ];
    for (solid, precision, toughness) in all {
        let (mut s, body) = Strip { solid, precision, toughness, ..Strip::default() }.build();
        let torn = until_torn(&mut s, body, 120);
        let report = s.tear_report(body).unwrap();
        assert!(torn.is_some() && report.begun == 0, "{report:?}");
        assert!((0.9..1.25).contains(&(report.area / LEFT)), "{} {report:?}", report.area / LEFT);
        let skin = s.skin(body).unwrap();
        let on = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound);
        let far = on.flat_map(|(t, _)| t.map(|p| (skin.rest[p as usize].x - 0.0305).abs()));
        let far = far.fold(0.0, f64::max);
        assert!(far < 0.008, "{far}");
        // the halves come to rest
        s.steps(100);
        let energy = s.report().elastic_energy + s.report().kinetic_energy;
        assert!(energy < 1e-2 * STRENGTH * LEFT * 0.06, "{energy}");
        let smallest = s.volume_ratios(body).into_iter().fold(f64::INFINITY, f64::min);
        assert!(smallest > 0.2, "{smallest}");
        // what tears a body goes with it
        s.remove_body(body).unwrap();
        s.step().unwrap();
        assert!(s.tear_report(body).is_none() && !s.remove_tear(body));
    }
}

/// The ends stand still: nothing but what is stored there is left to move it.
#[test]
fn energy_never_rises_while_it_tears() {
    let linear = [(0.002, None), (0.01, None), (0.01, TOUGHNESS), (0.033, None)];
    let linear = linear.map(|(dt, toughness)| (Solid::Linear, dt, toughness));
    let others = [(Solid::TenNodes, 0.01, None), (Solid::Hexahedra, 0.01, None)];
    for (solid, dt, toughness) in linear.into_iter().chain(others) {
        let strip = Strip { solid, toughness, ..Strip::default() };
        let (mut s, body) = strip.whole();
        s.set_dt(0.01);
        s.steps(100);
        strip.tear(&mut s, body);
        s.set_dt(dt);
        let mut energy = f64::INFINITY;
        for _ in 0..40 {
            s.step().unwrap();
            let now = s.report().elastic_energy + s.report().kinetic_energy;
            assert!(now <= energy * (1.0 + 1e-9), "{solid:?} {dt}: {now} {energy}");
            energy = now;
        }
        let report = s.tear_report(body).unwrap();
        assert!(report.pieces > 1, "{solid:?} {dt}: {report:?}");
    }
}

#[test]
fn units_and_directions_decide_nothing() {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1);
    let all = [
        Strip::default(),
        Strip { unit: 1e-3, ..Strip::default() },
        Strip { turn, ..Strip::default() },
        Strip { precision: Precision::F32, ..Strip::default() },
    ];
    // of hexahedra, whose outside is a regular grid, rounding decides a little
    for toughness in [None, TOUGHNESS] {
        let found = all.each_ref().map(|strip| {
            let (mut s, body) = Strip { toughness, ..*strip }.build();
            let step = until_torn(&mut s, body, 120).unwrap();
            let report = s.tear_report(body).unwrap();
            (step, report.separated, report.vertices, report.area * strip.unit.powi(2))
        });
        for own in &found[1..] {
            let (step, separated, vertices, area) = found[0];
            assert_eq!((own.0, own.1, own.2), (step, separated, vertices), "{found:?}");
            assert!((own.3 / area - 1.0).abs() < 1e-3, "{found:?}");
        }
    }
}

/// A tear goes on from a snapshot in its middle, also in another simulation, with other threads, and from a record, to the bit.
#[test]
fn tears_go_on_from_snapshots() {
    let all = [
        (Solid::Linear, Precision::F32, None, None),
        (Solid::Linear, Precision::F64, TOUGHNESS, None),
        (Solid::Hexahedra, Precision::F64, None, Some(0.1)),
    ];
    for (solid, precision, toughness, max_speed) in all {
        let build = |own: SimulationOptions| {
            let threads = own.threads;
            Strip { solid, precision, toughness, threads, max_speed, ..Strip::default() }.build().0
        };
        let (mut s, body) = (build(options(precision, 1)), BodyHandle(0));
        s.steps(50);
        let report = s.tear_report(body).unwrap();
        assert!(report.separated > 0 && report.pieces == 1, "not in the middle: {report:?}");
        exact("tear", options(precision, 1), &Scene { build: &build, act: &|_, _| () });
    }
}

#[test]
fn a_tear_is_no_faster_than_it_may_be() {
    let speed = 0.1;
    let (mut s, body) = Strip { max_speed: Some(speed), ..Strip::default() }.build();
    let first = (0..120).find(|_| {
        s.step().unwrap();
        s.tear_report(body).unwrap().separated > 0
    });
    let steps = until_torn(&mut s, body, 200).unwrap();
    assert!(first.is_some());
    // layer by layer: the first one has the way that came together before
    let way = speed * 0.01 * f64::from(steps + 1) + 0.0055 / 1.2;
    assert!(way > 0.75 * 0.022, "{steps} steps, {way} m");
}

#[test]
fn a_body_says_why_it_cannot_tear() {
    let mesh = jittered_box([0.04, 0.02, 0.02], [4, 2, 2]);
    let tear = Tear { body: 0, strength: 1e3, toughness: None, radius: None, max_speed: None };
    let own =
        |mesh| BodyDescription { spare: 100, ..BodyDescription::new("bar", mesh, soft(1e4, 0.3)) };
    let refuse = |description: &BodyDescription, tear: Tear, words: &[&str]| {
        let (mut s, _) = alone(SimulationOptions::default(), description);
        let error = s.set_tear(tear).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    };
    let whole = own(&mesh);
    for (own, words) in [
        (Tear { strength: 0.0, ..tear }, ["`bar`", "strength is 0 Pa"]),
        (Tear { strength: f64::NAN, ..tear }, ["`bar`", "strength is NaN Pa"]),
        (Tear { toughness: Some(-2.0), ..tear }, ["`bar`", "toughness is -2 J/m^2"]),
        (Tear { radius: Some(1e-3), ..tear }, ["radius is 0.001 m", "finer mesh"]),
        (Tear { max_speed: Some(-1.0), ..tear }, ["max_speed is -1 m/s", "positive"]),
        (Tear { body: 7, ..tear }, ["7", "bod"]),
    ] {
        refuse(&whole, own, &words);
    }
    refuse(&BodyDescription { spare: 0, ..whole.clone() }, tear, &["`bar`", "spare"]);
    let clusters =
        BodyDescription { volume: VolumeRule::Clusters, model: Model::NeoHookean, ..whole.clone() };
    refuse(&clusters, tear, &["volume = \"elements\""]);
    let bricks = box_hexahedra(DVec3::new(0.04, 0.02, 0.02), [4, 2, 2]).unwrap();
    let tough = Tear { toughness: Some(2.0), ..tear };
    refuse(&own(&bricks), tough, &["`bar`", "linear tetrahedra alone", "leave its toughness out"]);
    refuse(&own(&mesh.with_second_order()), tough, &["linear tetrahedra alone"]);
    // too few vertices: the step is not made, and the tissue is as it was
    let (mut s, _) = Strip { spare: 42, ..Strip::default() }.build();
    let error = loop {
        let before = s.state_hash();
        if let Err(error) = s.step() {
            assert_eq!(s.state_hash(), before);
            break error.to_string();
        }
        assert!(s.time() < 1.2, "no error");
    };
    assert!(error.contains("`strip`") && error.contains("larger `spare`"), "{error}");
}

/// Everything at once, far above the strength: what tears, what a blade parts and what is removed.
#[test]
fn tears_blades_and_removals_get_along() {
    let linear = [(1e3, 1), (3e3, 2), (6e3, 3)].map(|(strength, seed)| {
        let mesh = box_tets(DVec3::splat(0.06), [6; 3]).unwrap();
        (strength, jitter_interior(&mesh, 0.2, seed).unwrap())
    });
    let others = [(Solid::TenNodes, 4), (Solid::Hexahedra, 6)];
    let others = others.map(|(solid, cells)| (3e3, solid.block(0.06, cells)));
    for (strength, mesh) in linear.into_iter().chain(others) {
        let elements = mesh.tetrahedra.len() + mesh.hexahedra.len();
        let description = BodyDescription::new("block", &mesh, soft(1e4, 0.3));
        let description = BodyDescription { spare: 4000, model: Model::NeoHookean, ..description };
        let (mut s, body) = alone(options(Precision::F64, 1), &description);
        s.set_gravity(DVec3::ZERO);
        for (end, way) in [("x0", -0.02), ("x1", 0.02)] {
            let rows = s.group_rows(body, &mesh, end).unwrap();
            let motion = Motion::Translate(DVec3::X * way);
            let ramp = Curve::Points(vec![[0.0, 0.0], [0.4, 1.0]]);
            s.add_constraint(Constraint::moving(end, rows, motion, ramp));
        }
        s.set_solver(solver!(Integrator::Safe, mass_damping = 2.0));
        s.set_tear(Tear { body: body.0, strength, toughness: None, radius: None, max_speed: None })
            .unwrap();
        let edge = Edge {
            ends: [DVec3::Z * 0.02, DVec3::Z * -0.02],
            into: DVec3::Y,
            toughness: 0.0,
            travel: DVec3::ZERO,
        };
        let start = DVec3::new(0.025, -0.005, 0.05);
        let blade = s.add_tool(Tool::blade("scalpel", edge, start)).unwrap();
        let mass: f64 = s.masses(body).iter().sum();
        let material = |s: &mut Simulation| {
            let skin = s.skin(body).unwrap();
            let of = |(corners, _): &([u32; 4], u32)| {
                let [a, b, c, d] = corners.map(|p| skin.rest[p as usize]);
                (b - a).cross(c - a).dot(d - a) / 6.0
            };
            (skin.cells.iter().map(of).fold(f64::INFINITY, f64::min), skin.cells.len())
        };
        for step in 0..80 {
            let way = DVec3::Y * (0.065 * f64::from(step) / 60.0).min(0.065);
            s.move_tool(blade, start + way).unwrap();
            s.step().unwrap();
            if step == 40 {
                let mut masses = s.world_mut().query::<&Mass<f64>>();
                let total: f64 = masses.iter(s.world()).map(|own| own.0).sum();
                assert!((total / mass - 1.0).abs() < 1e-9, "{total} {mass}");
                let ball = Region::Sphere { centre: DVec3::splat(0.03), radius: 0.012 };
                s.remove_elements(body, &Removal::new(ball)).unwrap();
            }
        }
        let (report, tool) = (s.tear_report(body).unwrap(), s.tool_report(blade).unwrap().clone());
        assert!(
            report.separated as usize > elements / 13 && tool.separated > 0,
            "{report:?} {tool:?}"
        );
        let (least, cells) = material(&mut s);
        assert!(least > 0.0 && cells > elements * 2 / 5, "{least} {cells}");
        assert!(s.displacements(body).iter().all(|u| u.is_finite()));
    }
}
