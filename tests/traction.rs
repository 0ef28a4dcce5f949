//! Tractions on faces: what a uniform stress needs on every kind of element, over time, and while elements are taken away.

use crate::common::*;
use glam::DMat3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::load::{Load, LoadedFace, LoadedFaces};
use sinew::engine::mesh::Surface;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, quad_grid, triangle_grid};
use sinew::engine::vertex::ExternalForce;
use sinew::models::body::sheet::MembraneDescription;
use sinew::prelude::*;

const SIZE: f64 = 0.1;

/// Moves the vertices that are not at corners, those in faces and edges of the box within these.
fn shaken(mesh: &Mesh, cells: f64) -> Mesh {
    let shifts = random_field(mesh.points.len(), 11);
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

/// Cubes of linear tetrahedra, hexahedra and ten-node tetrahedra.
fn cubes() -> [Mesh; 3] {
    let (size, n) = (DVec3::splat(SIZE), [2; 3]);
    let tetrahedra = shaken(&box_tets(size, n).unwrap(), 2.0);
    let second_order = tetrahedra.with_second_order();
    [tetrahedra, shaken(&box_hexahedra(size, n).unwrap(), 2.0), second_order]
}

/// Faces on which `on` is true of all vertices.
fn part(mesh: &Mesh, on: impl Fn(DVec3) -> bool) -> Surface {
    let within = |face: &[u32]| face.iter().all(|&v| on(mesh.points[v as usize]));
    let mut surface = mesh.surface();
    surface.triangles.retain(|t| within(t));
    surface.quads.retain(|q| within(q));
    surface
}

fn far_end(mesh: &Mesh) -> Surface {
    part(mesh, |x| (x.x - SIZE).abs() < 1e-9)
}

fn total(faces: &[LoadedFace]) -> DVec3 {
    faces.iter().flat_map(|face| &face.forces).map(|(_, force)| *force).sum()
}

/// Holds a vertex along axes.
fn pin(s: &mut Simulation, body: BodyHandle, mesh: &Mesh, at: DVec3, axes: u8) {
    let vertex = vertices(&mesh.points, |x| x.distance(at) < 1e-9);
    let rows = s.rows(body, "pin", &vertex).unwrap();
    let axes = sinew::engine::vertex::FixedAxes(axes);
    s.add_constraint(Constraint { axes, ..Constraint::hold("pin", rows) });
}

/// All six sides bear the tractions of one stress: the body takes the one strain that goes with it, whatever its mesh. Dead
/// loads per rest area are those of the first Piola-Kirchhoff stress.
#[test]
fn a_uniform_stress_is_met_exactly_on_shaken_meshes() {
    let material = soft(1e4, 0.3);
    let lame = material.lame().unwrap();
    let stretch = DMat3::from_cols(
        DVec3::new(1.10, 0.0, 0.0),
        DVec3::new(0.08, 1.06, 0.0),
        DVec3::new(-0.05, 0.06, 1.04),
    );
    let law = |strain: DMat3| {
        let trace = strain.x_axis.x + strain.y_axis.y + strain.z_axis.z;
        DMat3::from_diagonal(DVec3::splat(lame.lambda * trace)) + 2.0 * lame.mu * strain
    };
    let one = DMat3::IDENTITY;
    for mesh in cubes() {
        for model in [Model::StVK, Model::Linear] {
            if mesh.is_second_order() && !model.serves_tetrahedra10() {
                continue;
            }
            let stress = match model {
                Model::Linear => law(0.5 * (stretch + stretch.transpose()) - one),
                _ => stretch * law(0.5 * (stretch.transpose() * stretch - one)),
            };
            let body = BodyDescription { model, ..BodyDescription::new("cube", &mesh, material) };
            let (mut s, body) = alone(SimulationOptions::default(), &body);
            s.set_gravity(DVec3::ZERO);
            // six unknowns, none of which moves in this strain
            pin(&mut s, body, &mesh, DVec3::ZERO, 0b111);
            pin(&mut s, body, &mesh, DVec3::X * SIZE, 0b110);
            pin(&mut s, body, &mesh, DVec3::Y * SIZE, 0b100);
            for axis in 0..3 {
                for (side, sign) in [(0.0, -1.0), (SIZE, 1.0)] {
                    let on = part(&mesh, |x| (x[axis] - side).abs() < 1e-9);
                    let traction = sign * stress.col(axis);
                    let faces = s.traction_faces(body, "side", &on, traction).unwrap();
                    let whole = traction * SIZE * SIZE;
                    assert!(total(&faces).distance(whole) < 1e-12 * whole.length());
                    s.add_loaded_faces("side", faces, Curve::Constant);
                }
            }
            s.set_solver(solver!(
                Integrator::QuasiStatic,
                linear_tolerance = 1e-12,
                newton_tolerance = 1e-11,
                max_newton_iterations = 100
            ));
            s.step().unwrap();
            assert!(!s.report().unconverged, "{:?}", s.report());
            let expected: Vec<DVec3> = mesh.points.iter().map(|x| stretch * *x - *x).collect();
            let off = max_distance(&s.displacements(body), &expected) / max_length(&expected);
            assert!(off < 1e-8, "{model:?}, {}: off by {off:e}", mesh.source);
        }
    }
}

/// Places and weights of Simpson's rule, exact to third degree.
const SIMPSON: [(f64, f64); 3] = [(0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)];

#[test]
fn tractions_do_the_work_of_the_continuum() {
    let traction = DVec3::new(30.0, -70.0, 90.0);
    let sheets = [
        triangle_grid(glam::DVec2::splat(SIZE), [3, 3]),
        quad_grid(glam::DVec2::splat(SIZE), [3, 3]),
    ];
    let [a, b] = sheets.map(|mesh| shaken(&mesh.unwrap(), 3.0));
    for mesh in cubes().into_iter().chain([a, b]) {
        let solid = mesh.is_solid();
        let membrane = MembraneDescription::new(&mesh.triangles, 1e-3, soft(1e4, 0.3));
        let membrane = MembraneDescription { quads: &mesh.quads, ..membrane };
        let body = match solid {
            true => BodyDescription::new("cube", &mesh, soft(1e4, 0.3)),
            false => sheet(&mesh.points, membrane),
        };
        let on = match solid {
            true => part(&mesh, |x| x.z < 1e-9),
            false => Surface { triangles: mesh.triangles.clone(), quads: mesh.quads.clone() },
        };
        let (mut s, body) = alone(SimulationOptions::default(), &body);
        let faces = s.traction_faces(body, "side", &on, traction).unwrap();
        let rows = s.rows(body, "all", &mesh.used_vertices()).unwrap();
        let at = |row: VertexRow| {
            let own = rows.iter().position(|r| *r == row).unwrap();
            mesh.points[mesh.used_vertices()[own] as usize]
        };
        let second = mesh.is_second_order();
        let fields: [(bool, fn(DVec3) -> f64); 5] = [
            (true, |_| 1.0),
            (true, |x| x.x),
            (true, |x| x.y),
            (second, |x| x.x * x.y),
            (second, |x| x.x * x.x),
        ];
        for (exact, field) in fields.into_iter().filter(|(exact, _)| *exact) {
            let own = faces.iter().flat_map(|face| &face.forces);
            let found: DVec3 = own.map(|&(row, force)| force * field(at(row))).sum();
            let mut integral = 0.0;
            for (x, wx) in SIMPSON {
                for (y, wy) in SIMPSON {
                    let place = DVec3::new(x, y, 0.0) * SIZE;
                    integral += wx * wy * SIZE * SIZE * field(place);
                }
            }
            let off = found.distance(integral * traction) / (SIZE * SIZE * traction.length());
            assert!(off < 1e-13, "{}: {off:e} {exact}", mesh.source);
        }
    }
}

/// Solid elements, of which the mesh has one kind, round the vertices that pass a test.
fn round(mesh: &Mesh, test: impl Fn(DVec3) -> bool) -> Vec<u32> {
    let touches = |cell: &[u32]| cell.iter().any(|&v| test(mesh.points[v as usize]));
    let tetrahedra = mesh.tetrahedra.iter().map(|t| touches(t));
    let all = tetrahedra.chain(mesh.hexahedra.iter().map(|h| touches(h)));
    (0..).zip(all).filter(|(_, touches)| *touches).map(|(e, _)| e).collect()
}

fn bar() -> Mesh {
    jittered_box([SIZE, 0.03, 0.03], [6, 2, 2])
}

/// A free bar under a traction that grows: its momentum is the integral of the force.
#[test]
fn every_integrator_takes_a_traction_by_its_curve() {
    let mesh = bar();
    let (traction, end, n) = (DVec3::new(3.0, 1.0, -2.0), 0.05, 10);
    for &integrator in Integrator::ALL.iter().filter(|own| own.facts().dynamic) {
        let (mut s, body) = fused(&mesh, soft(1e4, 0.3));
        s.set_gravity(DVec3::ZERO);
        let faces = s.traction_faces(body, "pull", &far_end(&mesh), traction).unwrap();
        let force = total(&faces);
        s.add_loaded_faces("pull", faces, Curve::ramp(0.0, end));
        s.set_dt(end / f64::from(n));
        s.set_solver(solver!(integrator, linear_tolerance = 1e-10));
        let mut substeps = u64::MAX;
        for _ in 0..n {
            s.step().unwrap();
            substeps = substeps.min(u64::from(s.report().substeps));
        }
        let momentum: DVec3 =
            s.velocities(body).iter().zip(s.masses(body)).map(|(v, m)| m * *v).sum();
        let off = momentum.distance(0.5 * end * force) / (0.5 * end * force.length());
        // who takes the force at the end of a step or substep is ahead by half of one
        let parts = f64::from(n) * substeps.max(1) as f64;
        assert!(off < 1.01 / parts, "{integrator:?}: {off} in {parts} parts");
    }
}

/// External forces (N) of the last step, summed.
fn external(s: &mut Simulation) -> DVec3 {
    let world = s.world_mut();
    world.query::<&ExternalForce<f64>>().iter(world).map(|f| f.get()).sum()
}

#[test]
fn faces_that_go_take_their_share_along_and_snapshots_know_it() {
    let [tetrahedra, hexahedra, second_order] = cubes();
    let cells = [
        (tetrahedra, ElementKind::Tetrahedron),
        (hexahedra, ElementKind::Hexahedron),
        (second_order, ElementKind::Tetrahedron),
    ];
    for (mesh, kind) in cells {
        let traction = DVec3::new(2.0, 0.5, -1.0);
        let build = || {
            let (mut s, body) =
                alone(portable(), &BodyDescription::new("cube", &mesh, soft(1e4, 0.3)));
            s.set_gravity(DVec3::ZERO);
            clamp(&mut s, body, &mesh, "x0");
            (s, body)
        };
        let (mut s, body) = build();
        let faces = s.traction_faces(body, "pull", &far_end(&mesh), traction).unwrap();
        let pull = s.add_loaded_faces("pull", faces, Curve::Constant);
        s.steps(2);
        assert!(external(&mut s).distance(traction * SIZE * SIZE) < 1e-14);
        // what has a vertex in one quarter of the end
        let quarter = |x: DVec3| x.x > 0.75 * SIZE && x.y < 0.25 * SIZE && x.z < 0.25 * SIZE;
        let report = s.remove(body, region(kind, round(&mesh, quarter)));
        assert!(report.pressure_faces > 0);
        s.steps(1);
        // the faces of what is left at the end, summed anew
        let gone = round(&mesh, quarter);
        let left = |count: usize| (0..count).filter(|e| !gone.contains(&(*e as u32)));
        let tetrahedra = left(mesh.tetrahedra.len());
        let rest = Mesh {
            middles: left(mesh.middles.len()).map(|e| mesh.middles[e]).collect(),
            tetrahedra: tetrahedra.map(|e| mesh.tetrahedra[e]).collect(),
            hexahedra: left(mesh.hexahedra.len()).map(|e| mesh.hexahedra[e]).collect(),
            ..mesh.clone()
        };
        let on = far_end(&rest);
        let expected = total(&s.traction_faces(body, "left", &on, traction).unwrap());
        assert!(expected.length() < 0.95 * traction.length() * SIZE * SIZE);
        assert!(external(&mut s).distance(expected) < 1e-14, "{}", mesh.source);
        let load = s.world().get::<Load>(pull).unwrap();
        assert_eq!(load.forces, s.world().get::<LoadedFaces>(pull).unwrap().forces());
        // a snapshot holds what is left, and goes on alike
        let snapshot = s.snapshot().unwrap();
        s.steps(3);
        let (mut other, own) = build();
        other.restore(&snapshot).unwrap();
        other.steps(3);
        assert_eq!(s.displacements(body), other.displacements(own));
        let end = round(&mesh, |x| x.x > SIZE - 1e-9);
        let end = end.into_iter().filter(|e| !gone.contains(e)).collect();
        other.remove(own, region(kind, end));
        other.steps(1);
        assert_eq!(external(&mut other), DVec3::ZERO);
        assert!(s.remove_load_or_constraint(pull));
        s.steps(1);
        assert_eq!(external(&mut s), DVec3::ZERO);
    }
}

fn portable() -> SimulationOptions {
    options(Precision::F64, 1)
}

#[test]
fn faces_that_are_none_are_told() {
    let mesh = bar();
    let (mut s, body) = fused(&mesh, soft(1e4, 0.3));
    let on = |triangles| Surface { triangles, quads: Vec::new() };
    let far = mesh.points.len() as u32 - 1;
    let error = s.traction_faces(body, "pull", &on(vec![[0, 1, far]]), DVec3::X).unwrap_err();
    assert!(error.to_string().contains("`pull`: face 0"), "{error}");
    let error = s.traction_faces(body, "pull", &on(vec![[0, 1, 9999]]), DVec3::X).unwrap_err();
    assert!(error.to_string().contains("vertex 9999"), "{error}");
    let quads = vec![[0, 1, 2, far]];
    let error = s.traction_faces(body, "pull", &Surface { triangles: vec![], quads }, DVec3::X);
    assert!(error.is_err());
    let faces = s.traction_faces(body, "pull", &far_end(&mesh), DVec3::NAN).unwrap();
    s.add_loaded_faces("pull", faces, Curve::Constant);
    assert!(s.step().unwrap_err().to_string().contains("`pull`"));
}
