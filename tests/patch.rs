//! Patch tests of loads: pressure and weight on every kind of element do the work of the continuum on all fields that the shape
//! functions can make, so that what the elements can represent comes out exactly.

use crate::common::*;
use sinew::engine::element_kind::ElementKind;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, quad_grid, triangle_grid};
use sinew::engine::vertex::ExternalForce;
use sinew::models::body::VolumeRule;
use sinew::models::body::sheet::MembraneDescription;
use sinew::prelude::*;

const SIZE: f64 = 0.1;

/// Moves the vertices that are not at corners, those in faces and edges of the box within these.
fn irregular(mesh: &Mesh, cells: f64) -> Mesh {
    let shifts = random_field(mesh.points.len(), 5);
    let mut mesh = mesh.clone();
    for (x, shift) in mesh.points.iter_mut().zip(shifts) {
        for k in 0..3 {
            if x[k] > 1e-9 && x[k] < SIZE - 1e-9 {
                x[k] += 0.2 * SIZE / cells * shift[k];
            }
        }
    }
    mesh
}

/// Cubes of irregular linear tetrahedra, hexahedra and ten-node tetrahedra.
fn cubes(cells: usize) -> [Mesh; 3] {
    let (size, n) = (DVec3::splat(SIZE), [cells; 3]);
    let tetrahedra = irregular(&box_tets(size, n).unwrap(), cells as f64);
    let hexahedra = irregular(&box_hexahedra(size, n).unwrap(), cells as f64);
    let second_order = tetrahedra.with_second_order();
    [tetrahedra, hexahedra, second_order]
}

/// Lets a pressure (Pa) push the sides into the body on which `on` is true of all vertices.
fn press(
    simulation: &mut Simulation,
    body: BodyHandle,
    mesh: &Mesh,
    pressure: f64,
    on: impl Fn(DVec3) -> bool,
) {
    let surface = mesh.surface();
    let within = |face: &[u32]| face.iter().all(|&v| on(mesh.points[v as usize]));
    let triangles: Vec<_> = surface.triangles.into_iter().filter(|t| within(t)).collect();
    let quads: Vec<_> = surface.quads.into_iter().filter(|q| within(q)).collect();
    press_on(simulation, body, (&triangles, &quads), pressure);
}

/// Holds three sides along their normals.
fn on_rollers(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) {
    for (k, name) in ["x0", "y0", "z0"].into_iter().enumerate() {
        guide(simulation, body, mesh, name, 1 << k);
    }
}

fn equilibrium(simulation: &mut Simulation) {
    simulation.set_solver(solver!(
        Integrator::QuasiStatic,
        linear_tolerance = 1e-10,
        newton_tolerance = 1e-9,
        max_newton_iterations = 100
    ));
    simulation.step().unwrap();
    assert!(!simulation.report().unconverged, "{:?}", simulation.report());
}

#[test]
fn a_cube_under_pressure_on_rollers_stays_a_box() {
    let young = 1e4;
    for model in [Model::CompressibleStVK, Model::NeoHookean, Model::StVKVolume] {
        for (nu, volume) in [(0.3, VolumeRule::Elements), (0.4999, VolumeRule::Clusters)] {
            if volume == VolumeRule::Clusters && !model.keeps_mean_volume() {
                continue;
            }
            for part in [0.02, 0.2] {
                let mut stretches = Vec::new();
                for mesh in cubes(2) {
                    let what = format!(
                        "{model:?} {volume:?} {part} {}",
                        if mesh.is_second_order() { "ten-node" } else { "linear" }
                    );
                    let body = BodyDescription::new("cube", &mesh, soft(young, nu));
                    let body = BodyDescription { model, volume, ..body };
                    let (mut s, body) = alone(SimulationOptions::default(), &body);
                    s.set_gravity(DVec3::ZERO);
                    on_rollers(&mut s, body, &mesh);
                    let far = |x: DVec3, k: usize| (x[k] - SIZE).abs() < 1e-9;
                    (0..3).for_each(|k| press(&mut s, body, &mesh, part * young, |x| far(x, k)));
                    equilibrium(&mut s);
                    let u = s.displacements(body);
                    let far =
                        mesh.points.iter().position(|x| x.distance(DVec3::splat(SIZE)) < 1e-9);
                    let stretch = u[far.unwrap()] / SIZE;
                    let expected: Vec<DVec3> = mesh.points.iter().map(|x| stretch * *x).collect();
                    let off = max_distance(&u, &expected) / max_length(&u);
                    assert!(off < 1e-6, "{what}: off by {off:e}");
                    stretches.push(stretch);
                }
                for stretch in &stretches[1..] {
                    let off = stretch.distance(stretches[0]) / stretches[0].length();
                    assert!(off < 1e-6, "{model:?} {volume:?} {part}: {stretches:?}");
                }
            }
        }
    }
}

/// Fields of first degree, and with `quadratic` those of second degree too.
fn fields(quadratic: bool) -> Vec<Box<dyn Fn(DVec3) -> DVec3>> {
    let mut monomials: Vec<Box<dyn Fn(DVec3) -> f64>> = vec![Box::new(|_| 1.0)];
    for i in 0..3 {
        monomials.push(Box::new(move |x| x[i]));
        for j in 0..=i {
            if quadratic {
                monomials.push(Box::new(move |x| x[i] * x[j]));
            }
        }
    }
    let mut fields: Vec<Box<dyn Fn(DVec3) -> DVec3>> = Vec::new();
    for factor in monomials {
        let direction = DVec3::new(0.3, -0.7, 0.9);
        fields.push(Box::new(move |x| factor(x) * direction));
    }
    fields
}

/// Places and weights of Simpson's rule, exact to third degree.
const SIMPSON: [(f64, f64); 3] = [(0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)];

/// Integral over a square side of the cube.
fn over_side(axis: usize, at: f64, of: impl Fn(DVec3) -> f64) -> f64 {
    let mut sum = 0.0;
    for (a, wa) in SIMPSON {
        for (b, wb) in SIMPSON {
            let mut x = DVec3::splat(at);
            (x[(axis + 1) % 3], x[(axis + 2) % 3]) = (a * SIZE, b * SIZE);
            sum += wa * wb * SIZE * SIZE * of(x);
        }
    }
    sum
}

fn work(forces: &[DVec3], points: &[DVec3], field: impl Fn(DVec3) -> DVec3) -> f64 {
    forces.iter().zip(points).map(|(f, x)| f.dot(field(*x))).sum()
}

#[test]
fn pressure_does_the_work_of_the_continuum() {
    let pressure = 70.0;
    for mesh in cubes(2) {
        let body = BodyDescription::new("cube", &mesh, soft(1e4, 0.3));
        for axis in 0..3 {
            let (mut s, body) = alone(SimulationOptions::default(), &body);
            press(&mut s, body, &mesh, pressure, |x| (x[axis] - SIZE).abs() < 1e-9);
            s.evaluate();
            let forces = s.elastic_forces(body);
            for field in fields(mesh.is_second_order()) {
                let expected = over_side(axis, SIZE, |x| -pressure * field(x)[axis]);
                let found = work(&forces, &mesh.points, field);
                assert!(
                    (found - expected).abs() < 1e-12 * pressure * SIZE * SIZE,
                    "{found} {expected}"
                );
            }
        }
    }
    // membranes, of which a square is all
    let grids = [
        triangle_grid(glam::DVec2::splat(SIZE), [3, 3]),
        quad_grid(glam::DVec2::splat(SIZE), [3, 3]),
    ];
    for mesh in grids {
        let mesh = irregular(&mesh.unwrap(), 3.0);
        let membrane = MembraneDescription::new(&mesh.triangles, 1e-3, soft(1e4, 0.3));
        let membrane = MembraneDescription { quads: &mesh.quads, ..membrane };
        let (mut s, body) = alone(SimulationOptions::default(), &sheet(&mesh.points, membrane));
        blow(&mut s, body, &mesh.triangles, pressure, Curve::Constant);
        let halves = both_diagonals(mesh.quads.iter().copied());
        blow(&mut s, body, &halves, 0.5 * pressure, Curve::Constant);
        s.evaluate();
        let forces = s.elastic_forces(body);
        for field in fields(false) {
            let expected = over_side(2, 0.0, |x| pressure * field(x).z);
            let found = work(&forces, &mesh.points, field);
            assert!(
                (found - expected).abs() < 1e-12 * pressure * SIZE * SIZE,
                "{found} {expected}"
            );
        }
    }
}

/// Forces (N) of gravity on a body, in the user's order.
fn weights(simulation: &mut Simulation, body: BodyHandle) -> Vec<DVec3> {
    let rows = simulation.topology().bodies[body.0].clone();
    let world = simulation.world_mut();
    let forces: Vec<DVec3> =
        world.query::<&ExternalForce<f64>>().iter(world).map(|f| f.get()).collect();
    let mut of = vec![DVec3::ZERO; rows.mesh_vertices()];
    rows.vertices_and_rows().for_each(|(vertex, row)| of[vertex.index()] = forces[row.index()]);
    of
}

#[test]
fn weight_does_the_work_of_the_continuum() {
    let gravity = DVec3::new(1.0, 2.0, -9.81);
    let density = 1000.0;
    for mesh in cubes(2) {
        let description = BodyDescription::new("cube", &mesh, soft(1e4, 0.3));
        let (mut s, body) = alone(SimulationOptions::default(), &description);
        s.set_gravity(gravity);
        let check = |s: &mut Simulation, volume: f64| {
            s.set_dt(1e-6);
            s.step().unwrap();
            let forces = weights(s, body);
            let total: DVec3 = forces.iter().sum();
            let mass: f64 = s.masses(body).iter().sum();
            assert!((mass - density * volume).abs() < 1e-12 * mass, "{mass} {volume}");
            assert!(total.distance(mass * gravity) < 1e-12 * total.length(), "{total} {mass}");
            forces
        };
        let forces = check(&mut s, SIZE.powi(3));
        for field in fields(mesh.is_second_order()) {
            let layer = |(z, w): (f64, f64)| {
                w * SIZE * over_side(2, z * SIZE, |x| density * gravity.dot(field(x)))
            };
            let expected: f64 = SIMPSON.into_iter().map(layer).sum();
            let found = work(&forces, &mesh.points, field);
            assert!((found - expected).abs() < 1e-12 * forces.len() as f64, "{found} {expected}");
        }
        // the same of what is left, and of another material
        let kind = if mesh.hexahedra.is_empty() {
            ElementKind::Tetrahedron
        } else {
            ElementKind::Hexahedron
        };
        s.remove(body, region(kind, vec![0, 3]));
        assert_fresh(&mut s, body, 1e-9, "removed");
        let left = s.masses(body).iter().sum::<f64>() / density;
        check(&mut s, left);
        s.set_material(body, soft(2e4, 0.3)).unwrap();
        check(&mut s, left);
    }
}

/// A column under its own weight between smooth walls: ten-node tetrahedra can make the parabola that is the solution.
#[test]
fn a_column_of_ten_node_tetrahedra_sinks_as_a_parabola() {
    // stiff: strains of 1e-8, so that every law is linear
    let (young, nu, density, gravity) = (1e11, 0.3, 1000.0, 9.81);
    let [_, _, mesh] = cubes(2);
    for model in Model::ALL.into_iter().filter(|model| model.serves_tetrahedra10()) {
        let body = BodyDescription::new("column", &mesh, soft(young, nu));
        let (mut s, body) = alone(SimulationOptions::default(), &BodyDescription { model, ..body });
        s.set_gravity(DVec3::NEG_Z * gravity);
        on_rollers(&mut s, body, &mesh);
        guide(&mut s, body, &mesh, "x1", 1);
        guide(&mut s, body, &mesh, "y1", 2);
        equilibrium(&mut s);
        let modulus = young * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu));
        let sink =
            |x: &DVec3| DVec3::Z * (-density * gravity / modulus * (SIZE * x.z - 0.5 * x.z * x.z));
        let expected: Vec<DVec3> = mesh.points.iter().map(sink).collect();
        let u = s.displacements(body);
        let off = max_distance(&u, &expected) / max_length(&expected);
        assert!(off < 1e-6, "{model:?}: off by {off:e}");
    }
}

/// A cube that is hardly compressible, clamped at one side, under the same pressure all round: nearly nothing happens.
#[test]
fn a_cube_under_pressure_all_round_hardly_moves() {
    let young = 1e4;
    for part in [0.25, 1.0, 2.0] {
        let largest = cubes(3).map(|mesh| {
            let body = BodyDescription {
                model: Model::NeoHookean,
                volume: VolumeRule::Clusters,
                ..BodyDescription::new("cube", &mesh, soft(young, 0.4999))
            };
            let (mut s, body) = alone(SimulationOptions::default(), &body);
            s.set_gravity(DVec3::ZERO);
            clamp(&mut s, body, &mesh, "x0");
            press(&mut s, body, &mesh, part * young, |_| true);
            equilibrium(&mut s);
            assert_eq!(s.volume_report().inverted, 0);
            max_length(&s.displacements(body))
        });
        // of twice as many hexahedra, which agree with finer ones to 2 %
        let converged = part * 2.797e-5;
        let off = largest.map(|u| u / converged - 1.0);
        assert!(off[2].abs() < 0.05 && off.iter().all(|off| off.abs() < 0.25), "{part} E: {off:?}");
    }
}
