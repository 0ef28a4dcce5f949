//! What lies on faces of linear tetrahedra that a blade parts: pressures and membranes.

use crate::common::*;
use crate::cutting_elements::*;
use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::load::{Pressure, SweptVolumes};
use sinew::engine::matrix::Tangent;
use sinew::engine::mesh::Surface;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::row::MeshVertex;
use sinew::engine::scalar::Scalar;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::Displacement;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::laws::pressure::swept_volume;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;

/// Faces at the top of a block, outward.
fn top_of(mesh: &Mesh) -> Vec<[u32; 3]> {
    let mut top = mesh.surface_triangles();
    top.retain(|t| t.iter().all(|&v| mesh.points[v as usize].z > SIDE - 1e-9));
    top
}

/// Displaces all rows (m), ghosts as well.
fn displace(simulation: &mut Simulation, u: &[DVec3]) {
    fn of<S: Scalar>(simulation: &mut Simulation, u: &[DVec3]) {
        let world = simulation.world_mut();
        let mut query = world.query::<&mut Displacement<S>>();
        for (own, u) in query.iter_mut(world).zip(u) {
            own.into_inner().0 = [u.x, u.y, u.z, 0.0].map(S::from_f64);
        }
    }
    match simulation.precision() {
        Precision::F64 => of::<f64>(simulation, u),
        Precision::F32 => of::<f32>(simulation, u),
    }
}

/// Row of every node of the skin of a body: of vertices of the mesh, then of ghosts.
fn row_of_node(simulation: &Simulation) -> Vec<usize> {
    let rows = &simulation.topology().bodies[0];
    let ghosts = 0..rows.copies.ghosts.len();
    let vertices = (0..rows.mesh_vertices() as u32).map(|v| rows.row(MeshVertex(v)));
    let vertices = vertices.map(|row| row.map_or(0, |row| row.index()));
    vertices.chain(ghosts.map(|ghost| rows.vertex_order.len() + ghost)).collect()
}

/// Force (N) of a pressure on all rows, and the volume (m^3) that its faces swept, from the triangles of the skin that were of the top.
fn of_skin(simulation: &mut Simulation, pressure: f64) -> (Vec<DVec3>, f64) {
    let skin = simulation.skin(BodyHandle(0)).unwrap();
    let (rows, nodes) = (rows(simulation).len(), row_of_node(simulation));
    let (mut forces, mut volume) = (vec![DVec3::ZERO; rows], 0.0);
    for (triangle, _) in skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| !**wound) {
        let rest = triangle.map(|p| skin.rest[p as usize]);
        if rest.iter().any(|x| (x.z - SIDE).abs() > 1e-9) {
            continue;
        }
        let [a, b, c] = triangle.map(|p| skin.points[p as usize]);
        let force = (b - a).cross(c - a) * (pressure / 6.0);
        for p in triangle.map(|p| p as usize) {
            for (node, weight) in skin.nodes[p].iter().zip(skin.weights[p]) {
                forces[nodes[*node as usize]] += force * weight;
            }
        }
        let edges = [rest[1] - rest[0], rest[2] - rest[0]].map(|x| x.to_array());
        let u = [a - rest[0], b - rest[1], c - rest[2]].map(|x| x.to_array());
        volume += swept_volume(&edges, &u, [1.0; 3]);
    }
    (forces, volume)
}

/// Forces (N) on all rows, and `v K v` of the exact tangent.
fn forces_and_stiffness(simulation: &mut Simulation, v: &[DVec3]) -> (Vec<DVec3>, f64) {
    simulation.evaluate();
    let forces = rows(simulation).iter().map(|row| row.4).collect();
    if simulation.precision() == Precision::F32 {
        return (forces, 0.0);
    }
    let world = simulation.world_mut();
    let tangent = Some(TangentKind::Exact);
    world.insert_resource(EvaluationRequest { energy: false, force: false, tangent });
    world.run_schedule(ForceSchedule);
    let (matrix, edges) =
        (&world.resource::<Tangent<f64>>().matrix, &world.resource::<Topology>().edges);
    let product = |m: &[f64; 9], a: usize, b: usize| -> f64 {
        (0..9).map(|i| v[a][i / 3] * m[i] * v[b][i % 3]).sum()
    };
    let diagonal: f64 = (0..v.len()).map(|i| product(&matrix.diagonal[i], i, i)).sum();
    let off = edges.iter().zip(&matrix.off_diagonal);
    let off = off.map(|([a, b], m)| 2.0 * product(m, *a as usize, *b as usize)).sum::<f64>();
    (forces, diagonal + off)
}

/// Forces, swept volume and tangent of a pressure are those of the triangles that are left of its faces, in any state; the pieces of the
/// body at rest get the pressure times their areas.
fn is_that_of_the_skin(simulation: &mut Simulation, pressure: f64, tolerance: f64) {
    let count = rows(simulation).len();
    let size = |f: &[DVec3]| f.iter().map(|f| f.length()).fold(0.0, f64::max);
    let (rest, way) = (vec![DVec3::ZERO; count], random_field(count, 8));
    displace(simulation, &rest);
    let (forces, _) = forces_and_stiffness(simulation, &rest);
    let (expected, _) = of_skin(simulation, pressure);
    let rows = simulation.topology().bodies[0].clone();
    for piece in 0..rows.piece_count() as u32 {
        let of = |f: &[DVec3]| {
            let own = f.iter().zip(&rows.piece).filter(|(_, own)| **own == piece);
            own.map(|(f, _)| *f).sum::<DVec3>()
        };
        let whole = pressure * SIDE * SIDE;
        assert!((of(&forces) - of(&expected)).length() < tolerance * whole);
    }
    let u: Vec<DVec3> = random_field(count, 9).iter().map(|u| *u * 2e-3).collect();
    let at = |simulation: &mut Simulation, step: f64| {
        let moved: Vec<DVec3> = u.iter().zip(&way).map(|(u, w)| *u + *w * step).collect();
        displace(simulation, &moved);
        forces_and_stiffness(simulation, &way)
    };
    let step = 1e-4;
    let [before, now, after] = [-step, 0.0, step].map(|step| {
        let loaded = at(simulation, step);
        let (expected, volume) = of_skin(simulation, pressure);
        let swept = simulation.world().resource::<SweptVolumes>().0[0][1];
        assert!((swept - volume).abs() < tolerance * SIDE * SIDE * 2e-3, "{swept} {volume}");
        let entity = simulation.find::<Pressure>("air").unwrap();
        let air = simulation.world().get::<Pressure>(entity).unwrap().clone();
        simulation.remove_load_or_constraint(entity);
        let bare = at(simulation, step);
        simulation.add_pressure(air);
        let own: Vec<DVec3> = loaded.0.iter().zip(&bare.0).map(|(f, g)| *f - *g).collect();
        let far = max_distance(&own, &expected);
        assert!(far < tolerance * size(&loaded.0), "{far} of {}", size(&loaded.0));
        (expected, loaded.1 - bare.1)
    });
    if simulation.precision() == Precision::F64 {
        let change: f64 =
            (0..count).map(|i| way[i].dot(before.0[i] - after.0[i]) / (2.0 * step)).sum();
        assert!((now.1 - change).abs() < 1e-9 * change.abs(), "{} {change}", now.1);
    }
}

#[test]
fn a_pressure_acts_on_what_is_left_of_faces() {
    let (mesh, strips) = (block(4), [lengthwise(), halfway()]);
    let seen = |x: DVec3| DVec3::new(x.x, SIDE - x.y, x.z);
    for (mirror, renumber) in [(false, false), (false, true), (true, true)] {
        let mesh = if renumber { renumbered(&mesh, mirror) } else { mesh.clone() };
        for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 3e-5)] {
            let (mut simulation, body) =
                alone(options(precision, 2), &cuttable(&mesh, Model::StVK));
            let top = top_of(&mesh);
            let pressure = 5e3;
            blow(&mut simulation, body, &top, pressure, Curve::Constant);
            simulation.evaluate();
            let whole = rows(&mut simulation);
            let mut report = Default::default();
            for strip in strips {
                let strip = if mirror { strip.map(|edge| edge.map(seen)) } else { strip };
                report = simulation.cut(body, &strip).unwrap();
                assert!(!report.copies.is_empty());
                is_that_of_the_skin(&mut simulation, pressure, tolerance);
            }
            // vertices whose faces are whole have what they had, to the last bit
            let rest = vec![DVec3::ZERO; whole.len()];
            displace(&mut simulation, &rest);
            simulation.evaluate();
            let parted = rows(&mut simulation);
            let same = whole.iter().zip(&parted).filter(|(a, b)| a.4 == b.4 && a.4.z != 0.0);
            assert!(same.count() >= 5);
            let gone = vec![report.separated[0], report.copies[0][0]];
            simulation.remove(body, Region::Tetrahedra(gone));
            is_that_of_the_skin(&mut simulation, pressure, tolerance);
            // dead loads are those of vertices
            let on = Surface { triangles: top.clone(), ..Surface::default() };
            let error = simulation.traction_faces(body, "late", &on, DVec3::Z).unwrap_err();
            assert!(error.to_string().contains("as far as these are whole"), "{error}");
            // as if it had come to act on the faces as they are now
            let entity = simulation.find::<Pressure>("air").unwrap();
            let left = simulation.world().get::<Pressure>(entity).unwrap().faces.clone();
            let vertices = &simulation.topology().bodies[0];
            let left: Vec<[u32; 3]> =
                left.iter().map(|face| face.map(|row| vertices.vertex(row).0)).collect();
            simulation.remove_load_or_constraint(entity);
            blow(&mut simulation, body, &left, pressure, Curve::Constant);
            is_that_of_the_skin(&mut simulation, pressure, tolerance);
            if precision == Precision::F64 {
                let found = simulation.verify_against_fresh(body).unwrap();
                assert!(found.largest() < 1e-12, "{found:?}");
            }
        }
    }
}

/// Triangles of a mesh of boxes whose vertices have all this height.
fn level(mesh: &Mesh, z: f64) -> Vec<[u32; 3]> {
    let at = |v: &u32| (mesh.points[*v as usize].z - z).abs() < 1e-9;
    let faces = mesh.tetrahedra.iter().flat_map(|&[a, b, c, d]| {
        [[b, c, d], [a, c, d], [a, b, d], [a, b, c]].map(|mut face| {
            face.sort_unstable();
            face
        })
    });
    let mut level: Vec<[u32; 3]> = faces.filter(|face| face.iter().all(at)).collect();
    level.sort_unstable();
    level.dedup();
    level
}

/// A block of little stiffness in a skin, with a membrane through its middle.
fn skinned(mesh: &Mesh) -> Vec<[u32; 3]> {
    let mut skin = mesh.surface_triangles();
    skin.extend(level(mesh, SIDE / 2.0));
    skin
}

#[test]
fn membranes_at_the_instant() {
    let mesh = box_tets(DVec3::splat(SIDE), [4; 3]).unwrap();
    let skin = skinned(&mesh);
    let models = MembraneModel::ALL.into_iter().filter(|model| *model != MembraneModel::MassSpring);
    for model in models {
        let membrane = MembraneDescription::new(&skin, 2e-3, soft(1e5, 0.3));
        let membrane = Some(MembraneDescription { model, ..membrane });
        for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 3e-5)] {
            let body = BodyDescription { membrane, ..cuttable(&mesh, Model::StVK) };
            let (mut simulation, body) = alone(options(precision, 2), &body);
            let (u, v) = (random_field(mesh.points.len(), 3), random_field(mesh.points.len(), 4));
            let u: Vec<_> = u.iter().map(|u| *u * 1e-3).collect();
            simulation.set_state(body, &u, &v).unwrap();
            let before = books(&mut simulation);
            let count = simulation.remaining(body, ElementKind::Triangle).len();
            for strip in [lengthwise(), halfway()] {
                simulation.cut(body, &strip).unwrap();
                let what = format!("{model:?} {precision:?}");
                nothing_changed(&mut simulation, &before, tolerance, &what);
            }
            let parted = simulation.remaining(body, ElementKind::Triangle).len();
            assert!(parted > count + 20, "{parted} {count}");
        }
    }
}

/// A membrane through a body that is pulled along a cut: nothing acts on inner vertices and ghosts.
#[test]
fn patch_of_a_membrane() {
    let mesh = box_tets(DVec3::splat(SIDE), [6; 3]).unwrap();
    let inner = level(&mesh, SIDE / 2.0);
    let plain = cuttable(&mesh, Model::StVK);
    let membrane = MembraneDescription::new(&inner, 2e-3, soft(1e5, 0.3));
    let borne = BodyDescription { membrane: Some(membrane), ..plain };
    let [alone, sums] = patch(&borne, pulled(), &lengthwise());
    assert!(alone < 1e-10 && sums < 1e-10, "{alone} {sums}");
}

/// Skin under tension on something much softer, cut as deep as the first layer of elements: the wound gapes as far as the skin was
/// stretched, whose energy is gone.
#[test]
fn a_wound_gapes_where_skin_was_stretched() {
    let mesh = box_tets(DVec3::splat(SIDE), [4; 3]).unwrap();
    let top = top_of(&mesh);
    let membrane = Some(MembraneDescription::new(&top, 1e-3, soft(1e6, 0.3)));
    let fat = BodyDescription::new("fat", &mesh, soft(200.0, 0.3));
    let fat = BodyDescription { spare: 500, model: Model::NeoHookean, membrane, ..fat };
    let (mut simulation, body) = alone(options(Precision::F64, 2), &fat);
    simulation.set_gravity(DVec3::ZERO);
    let stretched = mesh.points.iter().map(|x| DVec3::X * 0.1 * (x.x - SIDE / 2.0));
    simulation.displace(body, &stretched.collect::<Vec<_>>());
    for side in ["x0", "x1"] {
        clamp(&mut simulation, body, &mesh, side);
    }
    simulation.set_solver(solver!(Integrator::Safe, mass_damping = 10.0));
    let beside = [0.25, 0.75].map(|part| {
        let at = DVec3::new(part * SIDE, SIDE / 2.0, SIDE);
        vertices(&mesh.points, |x| x.distance(at) < 1e-9)[0] as usize
    });
    let settle = |simulation: &mut Simulation| {
        simulation.steps(50);
        let x = simulation.positions(body);
        (x[beside[1]].x - x[beside[0]].x, simulation.evaluate())
    };
    let before = settle(&mut simulation);
    let edge = |y: f64| [DVec3::new(0.033, y, 0.08), DVec3::new(0.031, y, 0.043)];
    assert!(!simulation.cut(body, &[edge(-0.02), edge(0.08)]).unwrap().copies.is_empty());
    let after = settle(&mut simulation);
    assert_eq!(simulation.volume_report().inverted, 0);
    // each half of the skin was stretched by a tenth, of which a vertex in its middle had half
    let gape = (after.0 - before.0) / (0.05 * SIDE);
    assert!(
        (0.95..1.0).contains(&gape) && after.1 < 0.01 * before.1,
        "{gape} {after:?} {before:?}"
    );
}

/// Cuts, removals of what is on the body and of what it is of: as a body that was divided at once, whatever the number of threads;
/// a pressure stays on skin whose tissue is gone.
#[test]
fn membranes_are_cut_and_removed() {
    let mesh = box_tets(DVec3::splat(SIDE), [4; 3]).unwrap();
    let skin = skinned(&mesh);
    let membrane = Some(MembraneDescription::new(&skin, 1e-3, soft(1e5, 0.3)));
    let description = BodyDescription { membrane, ..cuttable(&mesh, Model::NeoHookean) };
    let mut hashes = Vec::new();
    for threads in [1, 3] {
        let (mut simulation, body) = alone(options(Precision::F64, threads), &description);
        clamp(&mut simulation, body, &mesh, "z0");
        let pressure = 200.0;
        blow(&mut simulation, body, &top_of(&mesh), pressure, Curve::Constant);
        simulation.integrate_by(Integrator::Safe);
        let mut next = random_numbers(5);
        for _ in 0..6 {
            let mut point = || DVec3::from([0; 3].map(|_| next(1000) as f64 * SIDE * 1e-3));
            let (a, b, c) = (point(), point(), point());
            let mass =
                |simulation: &mut Simulation| rows(simulation).iter().map(|r| r.0).sum::<f64>();
            let before = mass(&mut simulation);
            simulation.cut(body, &[[a, b], [c, a + b - c]]).unwrap();
            assert!((mass(&mut simulation) / before - 1.0).abs() < 1e-12);
            simulation.steps(2);
            let left = simulation.remaining(body, ElementKind::Triangle);
            let gone = pick(left.clone(), 4, next(100) as u64);
            let copy = left.last().filter(|t| !gone.contains(t)).copied();
            simulation.remove(body, Region::Triangles(gone.into_iter().chain(copy).collect()));
        }
        let found = simulation.verify_against_fresh(body).unwrap();
        assert!(found.largest() < 1e-12 && found.mass < 1e-12, "{found:?}");
        let count = rows(&mut simulation).len();
        let total = |simulation: &mut Simulation| {
            displace(simulation, &vec![DVec3::ZERO; count]);
            simulation.evaluate();
            rows(simulation).iter().map(|row| row.4.z).sum::<f64>()
        };
        let whole = pressure * SIDE * SIDE;
        assert!((total(&mut simulation) / whole - 1.0).abs() < 1e-11);
        let tissue = simulation.remaining(body, ElementKind::Tetrahedron);
        let lost = simulation.remove_elements(body, &Removal::new(Region::Tetrahedra(tissue)));
        assert!(lost.unwrap().volume > 0.0);
        // where skin was removed before, too, nothing is left
        let share = total(&mut simulation) / whole;
        assert!(share < 1.0 && share > 0.5, "{share}");
        let error = simulation.cut(body, &lengthwise()).unwrap_err().to_string();
        assert!(error.contains("membrane"), "{error}");
        hashes.push(simulation.state_hash());
    }
    assert_eq!(hashes[0], hashes[1]);
}
