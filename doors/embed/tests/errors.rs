//! Handles that are stale or wrong, numbers that cannot be used.

use crate::{held, options, slab};
use sinew::engine::mesh::{CheckOptions, check};
use sinew::models::body::BodyError;
use sinew_embed::*;

#[test]
fn an_embedding_may_change_threads() {
    fn is_send<T: Send>() {}
    is_send::<Embedding>();
    let (mut sim, body, _) = held(&Options { gravity: [0.0, 0.0, -9.81], ..options() });
    let moved = std::thread::spawn(move || {
        sim.step(2).unwrap();
        sim.displacements(body).unwrap()[2][2]
    });
    assert!(moved.join().unwrap() < 0.0);
}

#[test]
fn wrong_and_stale_handles_are_told() {
    let (mut sim, body, hold) = held(&options());
    let (mut other, _, _) = held(&options());
    let code = |result: Result<()>, text: &str| {
        let error = result.unwrap_err();
        assert_eq!(error.code, Code::Handle, "{error}");
        assert!(error.text.contains(text), "{error}");
    };
    code(sim.positions(0).map(drop), "0 is no handle of a body");
    code(sim.positions(u64::MAX).map(drop), "is no handle of a body");
    code(sim.positions(hold).map(drop), "is that of a constraint, not of a body");
    code(sim.reaction(body, [0.0; 3]).map(drop), "is that of a body, not of a constraint");
    code(other.positions(body).map(drop), "belongs to another simulation");
    code(sim.remove(7), "7 is no handle; use");
    code(sim.name(7).map(drop), "7 is no handle; use");
    sim.remove(hold).unwrap();
    code(sim.remove(hold), "is gone");
    code(sim.set_target(hold, DVec3::X), "is gone");
    // its place is taken by another one, which it does not reach
    let floor = sim.group(body, "z0").unwrap();
    let again = sim.add_constraint(body, &ConstraintSpec::hold("floor", &floor)).unwrap();
    assert_ne!(again, hold);
    code(sim.reaction(hold, [0.0; 3]).map(drop), "is gone");
    sim.reaction(again, [0.0; 3]).unwrap();
    for (kind, name) in [(Kind::Tool, "tool"), (Kind::Pull, "pull"), (Kind::Load, "load")] {
        let error = sim.find(kind, "x").unwrap_err();
        assert_eq!(error.code, Code::Argument);
        assert_eq!(error.text, format!("unknown {name} `x`; there is no {name} to choose from"));
    }
    assert!(sim.find(Kind::Body, "slap").unwrap_err().text.contains("did you mean `slab`?"));
}

#[test]
fn numbers_that_cannot_be_used_are_told() {
    let (mut sim, body, hold) = held(&options());
    let n = sim.vertex_count(body).unwrap();
    let before = sim.hash();
    let argument = |result: Result<()>, text: &str| {
        let error = result.unwrap_err();
        assert_eq!(error.code, Code::Argument, "{error}");
        assert!(error.text.contains(text), "{error} has no `{text}`");
    };
    let zero = vec![0.0; 3 * n];
    let mut bad = zero.clone();
    bad[7] = f64::NAN;
    argument(sim.set_state(body, &zero[3..], &zero), "displacements: 222 numbers given, 3 x 75");
    argument(sim.set_state(body, &zero, &[]), "velocities: 0 numbers given, 3 x 75 needed");
    argument(sim.set_state(body, &bad, &zero), "displacements: number 7 (from 0) is NaN");
    argument(sim.set_dt(0.0), "step length dt = 0 s");
    argument(sim.set_dt(f64::NAN), "step length dt = NaN s");
    argument(sim.set_gravity([0.0, f64::INFINITY, 0.0]), "gravity: number 1 (from 0) is inf");
    argument(sim.positions_f32(body, &mut [0; 900], 11), "a stride of 11 bytes");
    argument(sim.positions_f32(body, &mut [0; 899], 12), "at least 900 bytes for 75 vertices");
    argument(sim.reaction(hold, [f64::NAN; 3]).map(drop), "point: number 0");
    argument(sim.pick([0.0; 3], [0.0; 3]).map(drop), "it has no length");
    argument(sim.set_target(hold, DVec3::NAN), "target of constraint `floor`");
    let load = |sim: &mut Embedding, vertices: &[u32], forces: &[f64], curve| {
        sim.add_load(body, "load", vertices, forces, curve).map(drop)
    };
    argument(load(&mut sim, &[75], &[0.0; 3], Curve::Constant), "vertex 75 of body `slab`");
    argument(load(&mut sim, &[], &[0.0; 3], Curve::Constant), "no vertex is given");
    argument(load(&mut sim, &[1, 2, 3], &[0.0; 6], Curve::Constant), "3, or 3 x 3 needed");
    argument(load(&mut sim, &[1], &[0.0; 2], Curve::Constant), "three for each needed");
    argument(load(&mut sim, &[1], &[0.0; 3], Curve::Points(vec![])), "its curve has no points");
    let pressure = sim.add_pressure(body, "p", &[0, 1, 74], 1.0, Curve::Constant);
    argument(pressure.map(drop), "is no face");
    let pressure = sim.add_pressure(body, "p", &[0, 1], 1.0, Curve::Constant);
    argument(pressure.map(drop), "triangles: 2 numbers given, 3 for each");
    let twice = sim.add_constraint(body, &ConstraintSpec::hold("floor", &[1]));
    argument(twice.map(drop), "there is a constraint `floor` already");
    let spec = ConstraintSpec { axes: [false; 3], ..ConstraintSpec::hold("a", &[1]) };
    argument(sim.add_constraint(body, &spec).map(drop), "it holds no axis");
    let spec = ConstraintSpec { from: 2.0, until: 1.0, ..ConstraintSpec::hold("a", &[1]) };
    argument(sim.add_constraint(body, &spec).map(drop), "make `until` later than `from`");
    let motion = Motion::TranslateEach(vec![DVec3::X; 2]);
    let spec = ConstraintSpec { motion, ..ConstraintSpec::hold("a", &[1]) };
    argument(sim.add_constraint(body, &spec).map(drop), "one translation per vertex");
    let tool = Tool::new("ball", Shape::Sphere { radius: -1.0 }, DVec3::Z);
    argument(sim.add_tool(tool, None).map(drop), "its radius is -1 m");
    let pull = PullSpec { name: "p", vertices: &[1], weights: &[], stiffness: -1.0, damping: 0.0 };
    argument(sim.add_pull(body, &pull).map(drop), "its stiffness is -1 N/m");
    let pull = PullSpec { weights: &[1.0, 1.0], stiffness: 1.0, ..pull };
    argument(sim.add_pull(body, &pull).map(drop), "2 weights for 1 rows");
    let contact = sim.add_contact("c", [body, body], -0.5, BodyContact::STIFFNESS);
    argument(contact.map(drop), "its friction is -0.5");
    let region = Region::Tetrahedra(vec![999_999]);
    argument(sim.remove_elements(body, region, MassPolicy::Recompute).map(drop), "999999");
    argument(sim.set_activation(body, "m", 0.5), "has no active family `m`");
    argument(choice::<Model>("model", "svk_com").map(drop), "`svk_comp`");
    argument(spring_rule("uniform", None).map(drop), "needs a constant");
    argument(spring_rule("best", None).map(drop), "best");
    argument(solver_settings("integrator = \"sav\"").map(drop), "sav");
    argument(mesh_from_generator("ball = 1").map(drop), "ball");
    let solver = solver_settings("{\"linear_tolerance\": 2.0}").unwrap_err();
    assert!(solver.text.contains("linear_tolerance = 2"), "{solver}");
    assert_eq!(sim.hash(), before);
    sim.step(1).unwrap();
}

#[test]
fn texts_are_those_of_typed_errors() {
    let mesh = slab();
    let mut sim = Embedding::new(&options()).unwrap();
    let material = YoungPoisson { young_modulus: -1.0, ..preset("liver").unwrap() };
    let description = BodyDescription::new("slab", &mesh, material);
    let typed: BodyError =
        Simulation::new(Default::default()).unwrap().add_body(&description).unwrap_err();
    let error = sim.add_body(&mesh, &description).unwrap_err();
    assert_eq!(error, EmbedError::new(Code::Material, typed.to_string()));
    assert_eq!(sim.list(Kind::Body), []);

    let mut broken = mesh.clone();
    broken.points[3].x = f64::NAN;
    let typed = check(&broken, &CheckOptions::default()).unwrap_err();
    let description = BodyDescription::new("slab", &broken, preset("liver").unwrap());
    let error = sim.add_body(&broken, &description).unwrap_err();
    assert_eq!(error, EmbedError::new(Code::Mesh, typed.to_string()));

    let typed = Mesh::from_bytes("skin.obj", b"v 0 zero 0\n").unwrap_err();
    let error = mesh_from_bytes("skin.obj", b"v 0 zero 0\n").unwrap_err();
    assert_eq!(error, EmbedError::new(Code::Mesh, typed.to_string()));
    assert_eq!(mesh_from_file("no.msh").unwrap_err().code, Code::Io);
    assert_eq!(preset("lever").unwrap_err().code, Code::Material);
    let none = Options { dt: -1.0, ..options() };
    assert_eq!(Embedding::new(&none).err().unwrap().code, Code::Argument);
    let many = Options { threads: 1 << 40, ..options() };
    assert_eq!(Embedding::new(&many).err().unwrap().code, Code::Backend);

    let arrays = MeshArrays { points: &[0.0; 4], ..MeshArrays::default() };
    assert!(mesh_from_arrays(&arrays).unwrap_err().text.contains("points: 4 numbers given"));
    let arrays =
        MeshArrays { points: &[0.0; 12], tetrahedra: &[0, 1, 2, 4], ..MeshArrays::default() };
    let error = mesh_from_arrays(&arrays).unwrap_err();
    assert!(error.text.contains("tetrahedra: index 4 at place 3"), "{error}");
    let arrays = MeshArrays { points: &[f64::NAN; 3], ..MeshArrays::default() };
    assert_eq!(mesh_from_arrays(&arrays).unwrap_err().code, Code::Argument);
}

#[test]
fn a_step_that_fails_leaves_the_state() {
    // an explicit step far beyond the limit of substeps
    let solver = SolverSettings {
        integrator: Integrator::StormerVerlet,
        max_substeps: 1,
        ..SolverSettings::default()
    };
    let (mut sim, body, _) = held(&Options { dt: 1e-5, solver, ..options() });
    sim.set_gravity([0.0, 0.0, -9.81]).unwrap();
    sim.step(3).unwrap();
    let (before, time) = (sim.hash(), sim.time());
    sim.set_dt(1.0).unwrap();
    let error = sim.step(5).unwrap_err();
    assert_eq!(error.code, Code::Step);
    assert!(error.text.contains("substeps"), "{error}");
    assert_eq!((sim.hash(), sim.time(), sim.steps_done()), (before, time, 3));
    sim.set_dt(1e-5).unwrap();
    sim.step(1).unwrap();
    assert!(sim.positions(body).unwrap().iter().flatten().all(|x| x.is_finite()));
}

#[test]
fn a_poisoned_simulation_says_why() {
    let (mut sim, _, _) = held(&options());
    sim.check().unwrap();
    sim.poison("index out of bounds");
    assert!(sim.is_poisoned());
    let error = sim.check().unwrap_err();
    assert_eq!(error.code, Code::Panic);
    assert!(error.text.ends_with("index out of bounds"));
}
