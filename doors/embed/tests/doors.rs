//! Every door once, with a number that would be wrong if the door were wrong.

use crate::{equilibria, held, options, slab};
use sinew_embed::*;

fn near(a: f64, b: f64, part: f64) -> bool {
    (a - b).abs() <= part * b.abs()
}

#[test]
fn the_reaction_balances_the_weight_and_its_moment() {
    let (mut sim, body, hold) = held(&Options { gravity: [0.0, 0.0, -9.81], ..equilibria() });
    sim.step(1).unwrap();
    let masses = sim.masses(body).unwrap();
    let weight = 9.81 * masses.iter().sum::<f64>();
    let about = DVec3::new(0.3, -0.2, 0.1);
    let positions = sim.positions(body).unwrap().to_vec();
    let moment: DVec3 = positions
        .iter()
        .zip(&masses)
        .map(|(x, m)| (DVec3::from_array(*x) - about).cross(DVec3::Z * (m * 9.81)))
        .sum();
    let Wrench { force, torque } = sim.reaction(hold, about.to_array()).unwrap();
    assert!(near(force[2], weight, 1e-6) && force[0].abs() < 1e-6 * weight, "{force:?} {weight}");
    assert!(
        DVec3::from_array(torque).distance(moment) < 1e-6 * moment.length(),
        "{torque:?} {moment}"
    );
    let external: f64 = sim.external_forces(body).unwrap().iter().map(|f| f[2]).sum();
    assert!(near(external, -weight, 1e-12));
    let elastic = sim.elastic_forces(body).unwrap();
    assert!(elastic.iter().map(|f| f[2]).sum::<f64>().abs() < 1e-6 * weight);
    assert!(near(sim.energy().elastic, sim.report().figures.elastic_energy, 1e-9));
    assert_eq!(sim.energy().kinetic, 0.0);
    let ratios = sim.volume_ratios(body).unwrap();
    assert_eq!(ratios.len(), slab().tetrahedra.len());
    let smallest = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(near(smallest, sim.report().volume.smallest_ratio, 1e-12) && smallest < 1.0);
    assert!(sim.volume(body).unwrap() < 5e-4);
}

#[test]
fn loads_pull_and_may_be_taken_away() {
    let (mut sim, body, hold) = held(&equilibria());
    let top = sim.group(body, "z1").unwrap();
    let load = sim.add_load(body, "all", &top, &[0.0, 0.0, 0.2], Curve::Constant).unwrap();
    sim.step(1).unwrap();
    assert!(near(sim.reaction(hold, [0.0; 3]).unwrap().force[2], -0.2, 1e-6));
    let forces: Vec<f64> = top.iter().flat_map(|_| [0.01, 0.0, 0.0]).collect();
    sim.add_load(body, "each", &top, &forces, Curve::ramp(0.0, 1.0)).unwrap();
    sim.set_dt(0.5).unwrap();
    sim.step(1).unwrap();
    // the clock stands at 0.51 s
    let expected = -0.01 * top.len() as f64 * sim.time();
    assert!(near(sim.reaction(hold, [0.0; 3]).unwrap().force[0], expected, 1e-6));
    sim.remove(load).unwrap();
    sim.step(1).unwrap();
    assert!(sim.reaction(hold, [0.0; 3]).unwrap().force[2].abs() < 1e-7);
}

#[test]
fn pressure_pushes_along_normals() {
    let (mut sim, body, hold) = held(&equilibria());
    let mesh = slab();
    let group = mesh.group("z1").unwrap();
    let triangles: Vec<u32> =
        group.cells.triangles.iter().flat_map(|&t| mesh.triangles[t as usize]).collect();
    // outward triangles: a positive pressure on them pulls
    sim.add_pressure(body, "suction", &triangles, 20.0, Curve::Constant).unwrap();
    sim.step(1).unwrap();
    let force = sim.reaction(hold, [0.0; 3]).unwrap().force;
    assert!(near(force[2], -20.0 * 0.01, 0.05), "{force:?}");
}

#[test]
fn tractions_keep_their_direction() {
    let mesh = slab();
    let group = mesh.group("z1").unwrap();
    let triangles: Vec<u32> =
        group.cells.triangles.iter().flat_map(|&t| mesh.triangles[t as usize]).collect();
    for on in [TractionOn::Group("z1"), TractionOn::Triangles(&triangles)] {
        let (mut sim, body, hold) = held(&equilibria());
        let push = [3.0, 0.0, -20.0];
        let load = sim.add_traction(body, "push", on, push, Curve::Constant).unwrap();
        sim.step(1).unwrap();
        let force = sim.reaction(hold, [0.0; 3]).unwrap().force;
        assert!(
            near(force[2], 20.0 * 0.01, 1e-4) && near(force[0], -3.0 * 0.01, 1e-4),
            "{force:?}"
        );
        sim.remove(load).unwrap();
        sim.step(1).unwrap();
        assert!(sim.reaction(hold, [0.0; 3]).unwrap().force[2].abs() < 1e-6);
        let mut refused = |on, traction: [f64; 3]| {
            sim.add_traction(body, "push", on, traction, Curve::Constant).unwrap_err().text
        };
        assert!(refused(TractionOn::Group("top"), push).contains("top"));
        assert!(refused(TractionOn::Triangles(&[]), push).contains("no face"));
        assert!(refused(TractionOn::Quads(&[0, 1, 2]), push).contains("4 for each"));
        assert!(refused(TractionOn::Whole, [f64::NAN; 3]).contains("traction"));
    }
}

#[test]
fn constraints_move_follow_and_let_go() {
    let (mut sim, body, _) = held(&options());
    let top = sim.group(body, "z1").unwrap();
    let vertex = top[0] as usize;
    let rest = sim.mesh(body).unwrap().points[vertex];
    let spec = ConstraintSpec {
        motion: Motion::Translate(DVec3::Z * 0.01),
        curve: Curve::ramp(0.0, 0.1),
        until: 0.1001,
        ..ConstraintSpec::hold("lift", &top)
    };
    let lift = sim.add_constraint(body, &spec).unwrap();
    sim.step(5).unwrap();
    assert!((sim.displacements(body).unwrap()[vertex][2] - 0.005).abs() < 1e-12);
    let refused = sim.set_target(lift, DVec3::X).unwrap_err();
    assert!(refused.text.contains("moves by a curve of its own"), "{refused}");
    sim.step(15).unwrap();
    assert!(sim.displacements(body).unwrap()[vertex][2] < 0.009);
    // a pose turns what it holds
    let (mut sim, body, _) = held(&options());
    let hand = sim.add_constraint(body, &ConstraintSpec::hold("hand", &top)).unwrap();
    let centre = DVec3::new(0.05, 0.05, 0.05);
    let rotation = DQuat::from_rotation_z(0.1);
    sim.set_target(hand, Pose { translation: DVec3::Z * 0.002, rotation, centre }).unwrap();
    sim.step(1).unwrap();
    let expected = centre + rotation * (rest - centre) + DVec3::Z * 0.002;
    let now = DVec3::from_array(sim.positions(body).unwrap()[vertex]);
    assert!(now.distance(expected) < 1e-12, "{now} {expected}");
    // one axis alone
    let spec = ConstraintSpec { axes: [false, false, true], ..ConstraintSpec::hold("x", &top) };
    sim.remove(hand).unwrap();
    sim.add_constraint(body, &spec).unwrap();
    sim.step(2).unwrap();
    let after = DVec3::from_array(sim.positions(body).unwrap()[vertex]);
    assert!((after.z - expected.z).abs() < 1e-12 && after.truncate() != expected.truncate());
}

#[test]
fn tools_press_grip_and_report_their_parts() {
    let (mut sim, body, hold) = held(&options());
    sim.set_solver(solver_settings("mass_damping = 50.0").unwrap()).unwrap();
    let above = DVec3::new(0.05, 0.05, 0.075);
    let tool = Tool::new("ball", Shape::Sphere { radius: 0.02 }, above).with_friction(0.3);
    let ball = sim.add_tool(tool, None).unwrap();
    for step in 1..=40 {
        sim.move_tool(ball, above - DVec3::Z * 0.0003 * f64::from(step)).unwrap();
        sim.step(1).unwrap();
    }
    for _ in 0..40 {
        sim.step(1).unwrap();
    }
    let report = sim.tool_report(ball).unwrap();
    assert!(report.force.z > 0.05 && report.depth > 0.0 && report.depth < 1e-3, "{report:?}");
    let reaction = sim.reaction(hold, [0.0; 3]).unwrap().force[2];
    assert!(near(reaction, report.force.z, 0.02), "{reaction} {}", report.force.z);
    let pushed: f64 = sim.contact_forces(body).unwrap().iter().map(|f| f[2]).sum();
    assert!(near(-pushed, report.force.z, 1e-6));
    assert!(sim.contact_pressures(body).unwrap().iter().any(|p| *p > 0.0));
    sim.place_tool(ball, DVec3::Z).unwrap();
    sim.step(1).unwrap();
    assert_eq!(sim.tool_report(ball).unwrap().force, DVec3::ZERO);
    sim.remove(ball).unwrap();
    assert_eq!(sim.tool_report(ball).unwrap_err().code, Code::Handle);

    // jaws with capsules and boxes that close by their opening about a hinge
    let jaw = |side: f64| Part {
        shape: Shape::Box { half: DVec3::new(0.02, 0.005, 0.01), rounding: 0.002 },
        at: DVec3::new(0.03, 0.02 * side, 0.0),
        rotation: DQuat::IDENTITY,
        cavity: false,
        jaw: 0.5 * side,
    };
    let start =
        ToolPose { position: DVec3::new(0.2, 0.2, 0.2), opening: 0.4, ..ToolPose::default() };
    let mut forceps = Tool::of_parts("forceps", vec![jaw(1.0), jaw(-1.0)], start);
    forceps.hinge = Hinge { point: DVec3::ZERO, axis: DVec3::Z };
    forceps.local_stiffness = true;
    let forceps = sim.add_tool(forceps, None).unwrap();
    sim.set_grip(forceps, true).unwrap();
    sim.move_tool(forceps, ToolPose { opening: 0.1, ..start }).unwrap();
    sim.step(1).unwrap();
    let report = sim.tool_report(forceps).unwrap();
    assert_eq!((report.opening, report.parts.len()), (0.1, 2));
    // all shapes, and faces of a body alone
    let field = distance_field(&slab(), None).unwrap();
    let top: Vec<u32> = {
        let mesh = sim.mesh(body).unwrap();
        let of = mesh.group("z1").unwrap();
        of.cells.triangles.iter().flat_map(|&t| mesh.triangles[t as usize]).collect()
    };
    for (name, shape) in [
        ("capsule", Shape::Capsule { half_length: 0.01, radius: 0.01 }),
        ("plate", Shape::Field(field)),
        ("half", Shape::HalfSpace),
    ] {
        let tool = Tool::new(name, shape, DVec3::new(0.0, 0.0, -0.5));
        sim.add_tool(tool, Some((body, &top))).unwrap();
    }
    sim.step(1).unwrap();
    let names: Vec<String> = sim.list(Kind::Tool).into_iter().map(|(_, name)| name).collect();
    assert_eq!(names, ["forceps", "capsule", "plate", "half"]);
}

#[test]
fn bodies_touch_each_other() {
    let mesh = slab();
    let mut sim = Embedding::new(&Options { dt: 0.005, ..options() }).unwrap();
    let liver = preset("liver").unwrap();
    let below = sim.add_body(&mesh, &BodyDescription::new("below", &mesh, liver)).unwrap();
    let raised = mesh.transformed(1.0, DQuat::IDENTITY, DVec3::Z * 0.051);
    let above = sim.add_body(&raised, &BodyDescription::new("above", &raised, liver)).unwrap();
    for (name, body, group) in [("floor", below, "z0"), ("hand", above, "z1")] {
        let vertices = sim.group(body, group).unwrap();
        sim.add_constraint(body, &ConstraintSpec::hold(name, &vertices)).unwrap();
    }
    let hand = sim.find(Kind::Constraint, "hand").unwrap();
    let contact = sim.add_contact("pair", [below, above], 0.0, BodyContact::STIFFNESS).unwrap();
    sim.set_solver(solver_settings("mass_damping = 50.0").unwrap()).unwrap();
    for step in 1..=40 {
        sim.set_target(hand, DVec3::Z * -0.0001 * f64::from(step)).unwrap();
        sim.step(1).unwrap();
    }
    sim.step(60).unwrap();
    let report = sim.contact_report(contact).unwrap();
    let force = sim.reaction(hand, [0.0; 3]).unwrap().force[2];
    assert!(report.force.z < -0.1 && near(-force, -report.force.z, 0.05), "{report:?} {force}");
    sim.remove(contact).unwrap();
    sim.step(40).unwrap();
    assert!(sim.reaction(hand, [0.0; 3]).unwrap().force[2].abs() < 0.2 * force.abs());
}

#[test]
fn a_ray_finds_what_a_pull_takes_hold_of() {
    let (mut sim, body, _) = held(&options());
    let pick = sim.pick([0.06, 0.03, 1.0], [0.0, 0.0, -2.0]).unwrap().unwrap();
    assert_eq!(pick.body, body);
    assert!((pick.distance - 0.95).abs() < 1e-12 && (pick.position[2] - 0.05).abs() < 1e-12);
    let points = &sim.mesh(body).unwrap().points;
    let at: DVec3 =
        pick.vertices.iter().zip(pick.weights).map(|(&v, w)| points[v as usize] * w).sum();
    assert!(at.distance(DVec3::new(0.06, 0.03, 0.05)) < 1e-12);
    assert_eq!(sim.pick([0.06, 0.03, 1.0], [0.0, 0.0, 1.0]).unwrap(), None);
    let spec = PullSpec {
        name: "mouse",
        vertices: &pick.vertices,
        weights: &pick.weights,
        stiffness: 20.0,
        damping: 0.1,
    };
    let pull = sim.add_pull(body, &spec).unwrap();
    sim.move_pull(pull, DVec3::Z * 0.01).unwrap();
    sim.step(60).unwrap();
    let report = sim.pull_report(pull).unwrap();
    assert!(near(report.force.length() / report.distance, 20.0, 0.1), "{report:?}");
    assert_eq!(sim.move_pull(pull, DVec3::NAN).unwrap_err().code, Code::Argument);
    sim.remove(pull).unwrap();
    assert_eq!(sim.pull_report(pull).unwrap_err().code, Code::Handle);
    sim.add_pull(body, &spec).unwrap();
}

#[test]
fn bodies_come_and_go_with_what_acts_on_them() {
    let (mut sim, body, hold) = held(&options());
    let raised = slab().transformed(1.0, DQuat::IDENTITY, DVec3::Z * 0.051);
    let liver = preset("liver").unwrap();
    let mut last = None;
    for _ in 0..2 {
        let above = sim.add_body(&raised, &BodyDescription::new("above", &raised, liver)).unwrap();
        let top = sim.group(above, "z1").unwrap();
        let hand = sim.add_constraint(above, &ConstraintSpec::hold("hand", &top)).unwrap();
        let pair = sim.add_contact("pair", [body, above], 0.0, BodyContact::STIFFNESS).unwrap();
        sim.step(3).unwrap();
        let snapshot = sim.snapshot().unwrap();
        sim.remove(above).unwrap();
        for gone in [above, hand, pair] {
            assert_eq!(sim.name(gone).unwrap_err().code, Code::Handle);
        }
        assert_eq!(sim.positions(above).unwrap_err().code, Code::Handle);
        sim.reaction(hold, [0.0; 3]).unwrap();
        sim.step(3).unwrap();
        // back, and away again
        sim.restore(&snapshot).unwrap();
        assert_eq!(sim.find(Kind::Body, "above").unwrap(), above);
        sim.reaction(hand, [0.0; 3]).unwrap();
        sim.step(1).unwrap();
        sim.remove(above).unwrap();
        assert_ne!(last.replace(above), Some(above));
    }
    sim.remove(body).unwrap();
    sim.step(2).unwrap();
    assert_eq!(sim.energy(), Energy::default());
}

#[test]
fn removals_change_the_surface_and_its_revision() {
    let (mut sim, body, _) = held(&options());
    let mesh = slab();
    let whole = sim.surface(body).unwrap().triangles.len();
    assert_eq!(whole, mesh.surface_triangles().len());
    let revision = sim.surface(body).unwrap().revision;
    sim.step(2).unwrap();
    assert_eq!(sim.surface(body).unwrap().revision, revision);
    let report = sim.remove_elements(
        body,
        Region::Tetrahedra(vec![0, 1, 2, 3, 4, 5]),
        MassPolicy::Recompute,
    );
    let report = report.unwrap();
    assert_eq!(report.tetrahedra, [0, 1, 2, 3, 4, 5]);
    // a cell of the corner: three squares of its six were outside, three come
    let now = sim.surface(body).unwrap();
    assert_eq!((now.triangles.len(), now.revision), (whole, revision + 1));
    let left = sim.remaining(body, ElementKind::Tetrahedron).unwrap();
    assert_eq!((left.len(), left[0]), (mesh.tetrahedra.len() - 6, 6));
    let again = Region::Tetrahedra(vec![0]);
    assert_eq!(
        sim.remove_elements(body, again, MassPolicy::Keep).unwrap_err().code,
        Code::Argument
    );
    let ball = Region::Sphere { centre: DVec3::new(0.05, 0.05, 0.05), radius: 0.03 };
    let report = sim.remove_elements(body, ball, MassPolicy::Recompute).unwrap();
    assert!(report.tetrahedra.len() > 10 && report.mass > 0.0);
    assert_eq!(sim.surface(body).unwrap().revision, revision + 2);
    let points = sim.positions(body).unwrap().len();
    let surface = sim.surface(body).unwrap();
    assert!(surface.triangles.iter().flatten().all(|&v| (v as usize) < points));
    sim.step(3).unwrap();
}

#[test]
fn reports_are_those_of_the_engine() {
    let (mut sim, _, _) = held(&Options { gravity: [0.0, 0.0, -9.81], ..options() });
    sim.step(2).unwrap();
    let report = sim.report();
    let exact = serde_json::to_value(sim.simulation().report()).unwrap();
    let json: serde_json::Value = serde_json::from_str(&sim.report_json()).unwrap();
    for (key, value) in exact.as_object().unwrap() {
        assert_eq!(&json[key], value, "{key}");
    }
    assert_eq!((&json["step"], report.step), (&2.into(), 2));
    assert!((json["time"].as_f64().unwrap() - 0.02).abs() < 1e-15);
    assert_eq!(json["volume"]["elements_by_body"][0], slab().tetrahedra.len());
    let energy = sim.energy();
    assert!(near(energy.kinetic, report.figures.kinetic_energy, 1e-9));
    assert!(near(energy.elastic, report.figures.elastic_energy, 1e-9));
}

#[test]
fn settings_are_what_was_asked_for() {
    let precision = choice::<PrecisionName>("precision", "f32").unwrap().into();
    let set = choice("instruction set", "portable").unwrap();
    let options = Options { precision, threads: 2, instruction_set: Some(set), ..options() };
    let (mut sim, body, _) = held(&options);
    assert_eq!((sim.precision(), sim.threads()), (Precision::F32, 2));
    assert_eq!((sim.instruction_set(), sim.backend()), (InstructionSet::Portable, Backend::Cpu));
    let gravity = [1.0, -2.0, 3.0];
    sim.set_gravity(gravity).unwrap();
    sim.set_dt(0.02).unwrap();
    sim.set_solver(solver_settings("integrator = \"safe\"").unwrap()).unwrap();
    assert_eq!((sim.gravity(), sim.dt()), (gravity, 0.02));
    assert_eq!(sim.solver().integrator, Integrator::Safe);
    sim.step(1).unwrap();
    assert_eq!((sim.time(), sim.steps_done(), sim.steps_planned()), (0.02, 1, None));
    let masses = sim.masses(body).unwrap();
    let forces = sim.external_forces(body).unwrap();
    assert!(near(forces[5][2], 3.0 * masses[5], 1e-6));
    assert!(!sim.is_static() && sim.scene_name().is_none());
    assert_eq!(version(), env!("CARGO_PKG_VERSION"));
}

#[test]
fn a_body_is_cut_and_what_is_drawn_of_it_follows() {
    let mesh = slab();
    let mut sim = Embedding::new(&options()).unwrap();
    let own = BodyDescription::new("slab", &mesh, preset("liver").unwrap());
    let own = BodyDescription { spare: mesh.points.len(), ..own };
    let body = sim.add_body(&mesh, &own).unwrap();
    let count = mesh.points.len();
    let surface = sim.surface(body).unwrap().triangles.to_vec();
    let skin = sim.skin(body).unwrap();
    let first = skin.revision;
    assert_eq!((skin.points.len(), skin.triangles), (count, &surface[..]));
    assert!(skin.depth == [0.0; 75] && !skin.wound.contains(&true));
    let before = sim.snapshot().unwrap();
    // upright, across the middle of the slab but for its cells
    let edge = |y: f64| [DVec3::new(0.045, y, 0.06), DVec3::new(0.045, y, -0.01)];
    let strip = [edge(-0.01), edge(0.11)];
    let report = sim.cut(body, &strip).unwrap();
    assert!(report.pieces == 2 && report.vertices > 0 && near(report.area, 0.005, 1e-9));
    let volume = |skin: &Skin| -> f64 {
        let corners = skin.triangles.iter().map(|t| t.map(|v| skin.points[v as usize]));
        let corners = corners.map(|t| t.map(DVec3::from_array));
        corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    };
    let skin = sim.skin(body).unwrap();
    let (second, points) = (skin.revision, skin.points.len());
    assert!(second > first && points > count && skin.points == skin.rest);
    let deepest = skin.depth.iter().copied().fold(0.0, f64::max);
    // half of how thick it is; triangles are looked for round the nearest vertices alone
    assert!((0.024..0.026).contains(&deepest) && near(volume(&skin), 5e-4, 1e-12), "{deepest}");
    let wound = skin.triangles.iter().zip(skin.wound).filter(|(_, wound)| **wound);
    let on = |v: &u32| (skin.points[*v as usize][0] - 0.045).abs() < 1e-12;
    assert!(wound.clone().count() > 20 && wound.flat_map(|(t, _)| t).all(on));
    assert_eq!(sim.vertex_count(body).unwrap(), count);
    // the surface over the vertices of the mesh has no stretched elements
    let inside = sim.surface(body).unwrap().triangles.len();
    assert!(inside > 0 && inside != surface.len());
    // positions alone change by steps
    let velocity: Vec<f64> = mesh.points.iter().flat_map(|_| [0.1, 0.0, 0.0]).collect();
    sim.set_state(body, &[0.0].repeat(3 * count), &velocity).unwrap();
    sim.step(3).unwrap();
    let skin = sim.skin(body).unwrap();
    assert!(skin.revision == second && skin.points.len() == points && skin.points != skin.rest);
    // back to before it, and what cannot be cut
    sim.restore(&before).unwrap();
    let skin = sim.skin(body).unwrap();
    assert!(skin.revision > second && skin.points.len() == count);
    let error = sim.cut(body, &strip[..1]).unwrap_err();
    assert!(error.code == Code::Argument && error.text.contains("two positions"), "{error}");
    let (mut sim, body, _) = held(&options());
    assert!(sim.cut(body, &strip).unwrap_err().text.contains("spare"));
}

#[test]
fn glue_is_told() {
    let (mut sim, mesh) = (Embedding::new(&options()).unwrap(), slab());
    let own = BodyDescription::new("slab", &mesh, preset("liver").unwrap());
    let own = BodyDescription { spare: 4 * mesh.points.len(), glue: 5.0, ..own };
    let body = sim.add_body(&mesh, &own).unwrap();
    let none = sim.glue_report(body).unwrap().unwrap();
    assert_eq!((none.springs, none.energy, none.released), (0, 0.0, 0.0));
    let edge = |y: f64| [DVec3::new(0.045, y, 0.06), DVec3::new(0.045, y, 0.02)];
    sim.cut(body, &[edge(-0.01), edge(0.055)]).unwrap();
    let report = sim.glue_report(body).unwrap().unwrap();
    assert!(report.springs > 0 && report.energy == 0.0, "{report:?}");
    let numbers = sim.numbers(body, Quantity::Glue).unwrap();
    assert_eq!(*numbers, [report.springs as f64, 0.0, report.released]);
    let (mut sim, body) = wounded();
    assert_eq!(sim.glue_report(body).unwrap(), None);
    assert!(sim.numbers(body, Quantity::Glue).unwrap_err().text.contains("glue"));
}

/// A slab that can be cut, held below, and `length` m of the way through it from above cut at x = 45 mm.
fn wounded() -> (Embedding, Handle) {
    let (mut sim, mesh) = (Embedding::new(&options()).unwrap(), slab());
    let own = BodyDescription::new("slab", &mesh, preset("liver").unwrap());
    let own = BodyDescription { spare: mesh.points.len(), ..own };
    let body = sim.add_body(&mesh, &own).unwrap();
    let floor = sim.group(body, "z0").unwrap();
    sim.add_constraint(body, &ConstraintSpec::hold("floor", &floor)).unwrap();
    let edge = |y: f64| [DVec3::new(0.045, y, 0.06), DVec3::new(0.045, y, 0.02)];
    sim.cut(body, &[edge(-0.01), edge(0.11)]).unwrap();
    (sim, body)
}

#[test]
fn threads_and_clips_are_laid_drawn_tied_and_cut() {
    let (mut sim, body) = wounded();
    let tissue = |at| ThreadPoint { of: body, at };
    let hand = ThreadPoint { of: 0, at: [0.045, 0.05, 0.08] };
    let through = [[0.03, 0.05, 0.04], [0.06, 0.05, 0.04]].map(tissue);
    let points = [through[0], through[1], hand];
    let words = |name: &str| format!("name = \"{name}\"\nstiffness = 20.0");
    let lay = |sim: &mut Embedding, name: &str, points: &[ThreadPoint]| {
        sim.add_thread(Kind::Thread, &words(name), points)
    };
    let stitch = lay(&mut sim, "stitch", &points).unwrap();
    let clip =
        sim.add_thread(Kind::Clip, "{\"name\": \"clip\", \"stiffness\": 0.5}", &through).unwrap();
    assert_eq!(sim.thread_report(stitch).unwrap(), ThreadReport::default());
    // no tissue there, a name that is taken, a body that is none; nothing is changed by them
    let nowhere = lay(&mut sim, "other", &[tissue([9.0; 3]), hand]).unwrap_err();
    assert!(nowhere.code == Code::Argument && nowhere.text.contains("point 1 of thread `other`"));
    assert_eq!(lay(&mut sim, "stitch", &points).unwrap_err().code, Code::Argument);
    let none = ThreadPoint { of: 77, at: [0.0; 3] };
    assert_eq!(lay(&mut sim, "other", &[none, hand]).unwrap_err().code, Code::Handle);
    assert!(sim.tie_thread(stitch).unwrap_err().text.contains("make a step"));
    let start = sim.snapshot().unwrap();
    for step in 1..=10 {
        sim.draw_thread(stitch, 1, 3e-4 * f64::from(step)).unwrap();
        sim.move_thread(stitch, 2, [0.045, 0.05, 0.08 + 1e-4 * f64::from(step)]).unwrap();
        sim.step(1).unwrap();
    }
    let drawn = sim.thread_report(stitch).unwrap();
    assert!(drawn.largest() > 0.01 && drawn.work > 0.0 && drawn.spans[0] < 0.03, "{drawn:?}");
    assert!(sim.thread_report(clip).unwrap().largest() > 0.0);
    let hash = sim.hash();
    assert_eq!(sim.move_thread(stitch, 0, [0.0; 3]).unwrap_err().code, Code::Argument);
    // tied, the handle stands for the loop; back before that it is the open one again
    let before = sim.snapshot().unwrap();
    sim.tie_thread(stitch).unwrap();
    sim.step(3).unwrap();
    let tied = sim.thread_report(stitch).unwrap();
    assert!(tied.held.len() == 3 && tied.largest() > 0.005, "{tied:?}");
    sim.restore(&before).unwrap();
    assert_eq!((sim.hash(), sim.thread_report(stitch).unwrap()), (hash, drawn));
    // cut between the lips: nothing is left of the first part, the second is drawn on
    let parts = sim.cut_thread(stitch, 0).unwrap();
    assert!(parts == [None, Some(stitch)]);
    sim.step(1).unwrap();
    assert_eq!(sim.thread_report(stitch).unwrap().held, [0, 1]);
    sim.restore(&start).unwrap();
    let long = [points[0], points[1], points[0], points[1]];
    let long = lay(&mut sim, "long", &long).unwrap();
    sim.step(1).unwrap();
    let [Some(first), Some(second)] = sim.cut_thread(long, 1).unwrap() else { panic!("parts") };
    assert_eq!((first, sim.name(second).unwrap()), (long, "long-2".into()));
    assert_eq!(sim.find(Kind::Thread, "long-2").unwrap(), second);
    for own in [stitch, clip, first, second] {
        sim.remove(own).unwrap();
        assert_eq!(sim.thread_report(own).unwrap_err().code, Code::Handle);
    }
    sim.step(1).unwrap();
}

#[test]
fn needles_leave_channels_to_threads() {
    let (mut sim, _) = wounded();
    let own = "into = [0, 0, -1]\nlength = 0.1\ndiameter = 1e-3\ntoughness = 50.0\nfriction = 5.0";
    let at = |way: f64| DVec3::new(0.071, 0.052, 0.051 - way);
    let pin = sim.add_tool(Tool::needle("needle", needle(own).unwrap(), at(0.0)), None).unwrap();
    let words = "name = \"thread\"\nstiffness = 20.0";
    let channel = [ThreadPoint { of: pin, at: [0.0; 3] }];
    let early = sim.add_thread(Kind::Thread, words, &channel).unwrap_err();
    assert!(early.code == Code::Argument && early.text.contains("drive one in"), "{early}");
    for step in 1..=60 {
        sim.move_tool(pin, at(5e-4 * f64::from(step))).unwrap();
        sim.step(1).unwrap();
    }
    let report = sim.tool_report(pin).unwrap();
    assert!(report.punctures == 1 && near(report.inserted, 0.029, 0.3), "{report:?}");
    let thread = sim.add_thread(Kind::Thread, words, &channel).unwrap();
    sim.remove(pin).unwrap();
    sim.step(2).unwrap();
    let laid = sim.thread_report(thread).unwrap();
    // from the surface on, up to the last point behind the tip
    let [first, last] = [laid.points[0].z, laid.points[laid.points.len() - 1].z];
    assert!((0.049..0.051).contains(&first) && (0.022..0.036).contains(&last), "{laid:?}");
    assert!(needle("length = 0.1").unwrap_err().text.contains("into"));
}

#[test]
fn tears_are_told() {
    let (mut sim, body) = wounded();
    assert_eq!(sim.tear_report(body).unwrap(), None);
    assert_eq!(sim.set_tear(body, Some("strength = -1.0")).unwrap_err().code, Code::Argument);
    sim.set_tear(body, Some("strength = 400.0")).unwrap();
    assert_eq!(sim.tear_report(body).unwrap(), Some(TearReport::default()));
    sim.remove(sim.find(Kind::Constraint, "floor").unwrap()).unwrap();
    for (name, group, way) in [("left", "x0", -0.02), ("right", "x1", 0.02)] {
        let side = sim.group(body, group).unwrap();
        let motion = Motion::Translate(DVec3::X * way);
        let spec = ConstraintSpec { motion, ..ConstraintSpec::hold(name, &side) };
        let curve = Curve::Points(vec![[0.0, 0.0], [0.3, 1.0]]);
        sim.add_constraint(body, &ConstraintSpec { curve, ..spec }).unwrap();
    }
    sim.step(40).unwrap();
    let torn = sim.tear_report(body).unwrap().unwrap();
    assert!(torn.area > 1e-3 && torn.separated > 0 && torn.pieces > 1, "{torn:?}");
    sim.set_tear(body, None).unwrap();
    assert_eq!(sim.tear_report(body).unwrap(), None);
}
