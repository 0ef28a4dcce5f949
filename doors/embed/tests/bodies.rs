//! Bodies: meshes from arrays, materials by element, membranes, fibres, buffers.

use crate::{equilibria, held, options, slab};
use sinew_embed::*;
use std::borrow::Cow;

/// A mesh as arrays with its vertices in reverse, so that no order can be right by chance.
fn reversed(mesh: &Mesh) -> Mesh {
    let last = mesh.points.len() as u32 - 1;
    let points: Vec<f64> = mesh.points.iter().rev().flat_map(|x| x.to_array()).collect();
    let tetrahedra: Vec<u32> = mesh.tetrahedra.as_flattened().iter().map(|&v| last - v).collect();
    let floor: Vec<u32> = mesh.group("z0").unwrap().vertices.iter().map(|&v| last - v).collect();
    mesh_from_arrays(&MeshArrays {
        points: &points,
        tetrahedra: &tetrahedra,
        groups: &[("floor", &floor)],
        ..MeshArrays::default()
    })
    .unwrap()
}

#[test]
fn buffers_are_in_the_order_of_the_user() {
    let (mesh, material) = (slab(), preset("liver").unwrap());
    let solver = solver_settings("linear_tolerance = 1e-12").unwrap();
    let options = Options { solver, ..options() };
    let (mut sim, body, _) = held(&options);
    let turned = reversed(&mesh);
    let mut other = Embedding::new(&options).unwrap();
    let second = other.add_body(&turned, &BodyDescription::new("r", &turned, material)).unwrap();
    let floor = other.group(second, "floor").unwrap();
    assert_eq!(other.groups(second).unwrap(), ["floor"]);
    other.add_constraint(second, &ConstraintSpec::hold("floor", &floor)).unwrap();
    let last = mesh.points.len() - 1;
    // the state is the order: every vertex its own displacement
    let u: Vec<f64> = (0..3 * mesh.points.len()).map(|i| 1e-6 * i as f64).collect();
    let v: Vec<f64> = u.iter().map(|x| 0.1 - x).collect();
    sim.set_state(body, &u, &v).unwrap();
    for i in [0, 17, last] {
        let now = sim.positions(body).unwrap()[i];
        let expected: [f64; 3] = std::array::from_fn(|k| mesh.points[i][k] + u[3 * i + k]);
        assert_eq!(now, expected);
        assert_eq!(sim.displacements(body).unwrap()[i][..], u[3 * i..3 * i + 3]);
        assert_eq!(sim.velocities(body).unwrap()[i][..], v[3 * i..3 * i + 3]);
    }
    let flip = |x: &[f64]| -> Vec<f64> { x.chunks(3).rev().flatten().copied().collect() };
    other.set_state(second, &flip(&u), &flip(&v)).unwrap();
    for sim in [&mut sim, &mut other] {
        sim.step(3).unwrap();
    }
    let (a, b) = (sim.positions(body).unwrap(), other.positions(second).unwrap());
    for (i, (x, y)) in a.iter().zip(b.iter().rev()).enumerate() {
        let distance = DVec3::from_array(*x).distance(DVec3::from_array(*y));
        assert!(distance < 1e-9, "vertex {i}: {x:?} {y:?}");
    }
}

#[test]
fn buffers_follow_every_step_and_fill_the_memory_of_a_host() {
    let (mut sim, body, _) = held(&Options { gravity: [0.0, 0.0, -9.81], ..options() });
    let n = sim.vertex_count(body).unwrap();
    let mut seen = Vec::new();
    for _ in 0..3 {
        let epoch = sim.epoch();
        sim.step(1).unwrap();
        assert_ne!(sim.epoch(), epoch);
        let kept = sim.positions(body).unwrap().to_vec();
        let exact = sim.simulation_mut().positions(sinew::prelude::BodyHandle(0));
        assert!(kept.iter().zip(&exact).all(|(x, y)| *x == y.to_array()));
        assert!(!seen.contains(&kept));
        seen.push(kept);
    }
    let own = sim.numbers(body, Quantity::Positions).unwrap().into_owned();
    assert_eq!(own, sim.positions(body).unwrap().as_flattened());
    let own = sim.numbers(body, Quantity::Velocities).unwrap().into_owned();
    assert_eq!(own, sim.velocities(body).unwrap().as_flattened());
    let own = sim.numbers(body, Quantity::Displacements).unwrap().into_owned();
    assert_eq!(own, sim.displacements(body).unwrap().as_flattened());
    // 12 bytes of position in every 20
    let mut bytes = vec![0xab; 20 * (n - 1) + 12];
    sim.positions_f32(body, &mut bytes, 20).unwrap();
    for (i, x) in sim.positions(body).unwrap().iter().enumerate() {
        for k in 0..3 {
            let at = 20 * i + 4 * k;
            let stored = f32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap());
            assert_eq!(stored, x[k] as f32);
        }
        assert!(bytes[20 * i + 12..].iter().take(8).all(|b| *b == 0xab));
    }
}

#[test]
fn vertices_without_elements_stay() {
    let mut mesh = slab();
    mesh.points.push(DVec3::new(7.0, 8.0, 9.0));
    let mut sim = Embedding::new(&options()).unwrap();
    let description = BodyDescription::new("slab", &mesh, preset("liver").unwrap());
    let body = sim.add_body(&mesh, &description).unwrap();
    assert!(sim.warnings().iter().any(|w| w.code == "mesh.unused-vertices"));
    sim.step(1).unwrap();
    let last = mesh.points.len() - 1;
    assert_eq!(sim.positions(body).unwrap()[last], [7.0, 8.0, 9.0]);
    assert_eq!(sim.displacements(body).unwrap()[last], [0.0; 3]);
    assert_eq!(sim.masses(body).unwrap()[last], 0.0);
    let error = sim.add_load(body, "l", &[last as u32], &[0.0; 3], Curve::Constant).unwrap_err();
    assert!(error.text.contains("belongs to no element"), "{error}");
}

/// How far the top of a slab sinks under its weight.
fn sag<'a>(mesh: &'a Mesh, description: impl Fn(&mut BodyDescription<'a>)) -> f64 {
    let mut sim = Embedding::new(&Options { gravity: [0.0, 0.0, -9.81], ..equilibria() }).unwrap();
    let mut own = BodyDescription::new("slab", mesh, preset("liver").unwrap());
    description(&mut own);
    let body = sim.add_body(mesh, &own).unwrap();
    let floor = sim.group(body, "z0").unwrap();
    sim.add_constraint(body, &ConstraintSpec::hold("floor", &floor)).unwrap();
    sim.step(1).unwrap();
    sim.displacements(body).unwrap().iter().map(|u| -u[2]).fold(0.0, f64::max)
}

#[test]
fn materials_come_uniform_and_by_element() {
    let mesh = slab();
    let cells = mesh.tetrahedra.len();
    let liver = preset("liver").unwrap();
    let soft = sag(&mesh, |_| {});
    let stiff = vec![2.0 * liver.young_modulus; cells];
    let ratio = soft / sag(&mesh, |b| b.young_modulus = Some(&stiff));
    assert!((1.9..2.3).contains(&ratio), "{ratio}");
    let heavy = vec![2.0 * liver.density; cells];
    let ratio = sag(&mesh, |b| b.density = Some(&heavy)) / soft;
    assert!((1.9..2.3).contains(&ratio), "{ratio}");
    let slack = vec![0.1; cells];
    assert!(sag(&mesh, |b| b.poisson_ratio = Some(&slack)) > 1.2 * soft);
    // all models that a material defines
    for model in Model::ALL {
        let named = choice::<Model>("model", model.name()).unwrap();
        assert_eq!(named, model);
        let sunk = sag(&mesh, |b| b.model = named);
        assert!((0.3..3.0).contains(&(sunk / soft)), "{}: {sunk} {soft}", model.name());
    }
    let pooled = choice::<Evaluation>("evaluation", "pooled").unwrap();
    assert!((sag(&mesh, |b| b.evaluation = pooled) / soft - 1.0).abs() < 1e-6);
    let springs = spring_rule("two-norm", None).unwrap();
    assert!(sag(&mesh, |b| (b.model, b.springs) = (Model::MassSpring, Some(springs))) > 0.0);
}

#[test]
fn a_material_may_change_in_the_run() {
    let (mut sim, body, _) = held(&Options { gravity: [0.0, 0.0, -9.81], ..equilibria() });
    let liver = preset("liver").unwrap();
    sim.step(1).unwrap();
    let before = sim.energy().elastic;
    let stiff = YoungPoisson { young_modulus: 3.0 * liver.young_modulus, ..liver };
    let change = sim.set_material(body, stiff.into()).unwrap();
    assert!((change.elastic_energy / before - 2.0).abs() < 1e-9, "{change:?} {before}");
    assert_eq!(sim.energy().elastic, before + change.elastic_energy);
    sim.step(1).unwrap();
    assert!((0.25..0.45).contains(&(sim.energy().elastic / before)));
    let wrong = [1.0];
    let field = MaterialField { young_modulus: Some(&wrong), ..liver.into() };
    assert_eq!(sim.set_material(body, field).unwrap_err().code, Code::Material);
}

#[test]
fn a_membrane_carries_a_pressure() {
    let mesh = mesh_from_generator("sheet = { size = [0.1, 0.1], cells = [8, 8] }").unwrap();
    let rubber = YoungPoisson { young_modulus: 1e5, poisson_ratio: 0.4, density: 1000.0 };
    let (triangles, quads) = membrane_cells(&mesh, MembraneCells::All).unwrap();
    let mut description = BodyDescription::new("sheet", &mesh, rubber);
    description.membrane = Some(MembraneDescription {
        quads: &quads,
        ..MembraneDescription::new(&triangles, 1e-3, rubber)
    });
    let mut sim = Embedding::new(&options()).unwrap();
    let body = sim.add_body(&mesh, &description).unwrap();
    let rim: Vec<u32> = ["x0", "x1", "y0", "y1"]
        .iter()
        .flat_map(|g| sim.group(body, g).unwrap())
        .collect::<std::collections::BTreeSet<u32>>()
        .into_iter()
        .collect();
    let hold = sim.add_constraint(body, &ConstraintSpec::hold("rim", &rim)).unwrap();
    let faces: Vec<u32> = triangles.as_flattened().to_vec();
    let p = sim.add_pressure(body, "air", &faces, 50.0, Curve::Constant).unwrap();
    sim.set_solver(solver_settings("mass_damping = 50.0").unwrap()).unwrap();
    sim.step(60).unwrap();
    let height = sim.displacements(body).unwrap().iter().map(|u| u[2]).fold(0.0, f64::max);
    assert!((2e-3..2e-2).contains(&height), "{height}");
    // equilibrium: the rim holds the resultant on the projected area, which the rim bounds
    let force = sim.reaction(hold, [0.0; 3]).unwrap().force;
    assert_eq!(sim.area_ratios(body).unwrap().len(), triangles.len());
    let ratios = sim.area_ratios(body).unwrap();
    assert!(ratios.iter().sum::<f64>() > 1.001 * ratios.len() as f64, "{ratios:?}");
    let smallest = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    assert!((sim.report().smallest_area_ratio.unwrap() / smallest - 1.0).abs() < 1e-9);
    assert!(sim.surface(body).unwrap().triangles.len() == triangles.len());
    sim.remove(p).unwrap();
    sim.step(40).unwrap();
    let fallen = sim.displacements(body).unwrap().iter().map(|u| u[2]).fold(0.0, f64::max);
    assert!(fallen < 0.5 * height, "{fallen} {height}");
    let after = sim.reaction(hold, [0.0; 3]).unwrap().force;
    assert!(after[2].abs() < 0.5 * force[2].abs() || force[2].abs() < 1e-9, "{force:?} {after:?}");
}

#[test]
fn fibres_stiffen_and_muscles_pull() {
    let mesh = slab();
    let muscle = MuscleSettings { peak_stress: 1e3, ..MuscleSettings::default() };
    let family = AxisFamily {
        name: Cow::Borrowed("m"),
        directions: Cow::Borrowed(&[DVec3::Z]),
        modulus: 1e3,
        form: FibreForm::Stretch,
        viscosity: 0.0,
        share: None,
        muscle: Some(muscle),
    };
    let axes = AxesDescription { families: vec![family], ..AxesDescription::default() };
    let description = BodyDescription {
        axes: Some(axes),
        ..BodyDescription::new("slab", &mesh, preset("liver").unwrap())
    };
    let mut sim = Embedding::new(&equilibria()).unwrap();
    let body = sim.add_body(&mesh, &description).unwrap();
    let floor = sim.group(body, "z0").unwrap();
    sim.add_constraint(body, &ConstraintSpec::hold("floor", &floor)).unwrap();
    let top = |sim: &mut Embedding| sim.displacements(body).unwrap()[2][2];
    sim.step(1).unwrap();
    assert_eq!(top(&mut sim), 0.0);
    sim.set_activation(body, "m", 0.5).unwrap();
    sim.step(1).unwrap();
    let half = top(&mut sim);
    sim.set_activation(body, "m", 1.0).unwrap();
    sim.step(1).unwrap();
    let full = top(&mut sim);
    assert!(half < -1e-3 && full < 1.5 * half, "{half} {full}");
    let error = sim.set_activation(body, "m", 1.5).unwrap_err();
    assert_eq!(error.text, "activation 1.5 of family `m` is not between 0 and 1");
    let change = sim.set_axis_modulus(body, "m", 2e3).unwrap();
    assert!(change > 0.0);
    assert!(sim.volume(body).unwrap() < 5e-4);
}
