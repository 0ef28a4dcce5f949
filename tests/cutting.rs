//! Cuts of bodies in a simulation: what must not change at the instant, and what cannot be cut. Cases of a separate program are
//! those of `sinew validate`.

use crate::common::*;
use glam::DVec3;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, jitter_interior};
use sinew::engine::scalar::Scalar;
use sinew::engine::surface::SurfaceReader;
use sinew::engine::vertex::{Displacement, Mass, Position, RestPosition, Velocity};
use sinew::models::body::sheet::{Bending, MembraneDescription, MembraneModel};
use sinew::models::body::{Evaluation, Integration, MassRule};
use sinew::models::cutting::{CutError, MaterialSkin};
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;

/// Mass (kg), place (m) and velocity (m/s) of every row of a simulation of one body.
fn rows<S: Scalar>(simulation: &mut Simulation) -> Vec<(f64, DVec3, DVec3)> {
    let world = simulation.world_mut();
    let mut query = world.query::<(&Mass<S>, &RestPosition, &Displacement<S>, &Velocity<S>)>();
    query.iter(world).map(|(m, x, u, v)| (m.0.to_f64(), x.0 + u.get(), v.get())).collect()
}

/// Mass, kinetic energy, momentum, angular momentum.
fn motion(rows: &[(f64, DVec3, DVec3)]) -> [f64; 8] {
    let mut sums = [0.0; 8];
    for &(m, x, v) in rows {
        let (p, l) = (m * v, m * x.cross(v));
        let own = [m, 0.5 * m * v.length_squared(), p.x, p.y, p.z, l.x, l.y, l.z];
        (0..8).for_each(|i| sums[i] += own[i]);
    }
    sums
}

fn block(cells: usize) -> Mesh {
    let mesh = box_tets(DVec3::splat(0.06), [cells; 3]).unwrap();
    jitter_interior(&mesh, 0.2, 5).unwrap()
}

/// An oblique cut through a block that ends inside.
fn oblique() -> [[DVec3; 2]; 2] {
    let edge = |y: f64| [DVec3::new(0.033, y, 0.08), DVec3::new(0.026, y, 0.025)];
    [edge(-0.02), edge(0.08)]
}

fn cuttable(mesh: &Mesh, options: SimulationOptions, model: Model) -> (Simulation, BodyHandle) {
    let body = BodyDescription { model, ..BodyDescription::new("block", mesh, soft(1e4, 0.3)) };
    alone(options, &BodyDescription { spare: 3 * mesh.points.len(), ..body })
}

#[test]
fn nothing_changes_at_the_instant() {
    let mesh = block(4);
    let no_volume = [Model::QuadraticSprings, Model::MassSpring, Model::Axes];
    for model in Model::ALL.into_iter().filter(|model| !no_volume.contains(model)) {
        for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 1e-5)] {
            let (mut simulation, body) = cuttable(&mesh, options(precision, 2), model);
            let (u, v) = (random_field(mesh.points.len(), 3), random_field(mesh.points.len(), 4));
            let u: Vec<_> = u.iter().map(|u| *u * 0.001).collect();
            let state = |simulation: &mut Simulation| {
                let rows = match precision {
                    Precision::F64 => rows::<f64>(simulation),
                    Precision::F32 => rows::<f32>(simulation),
                };
                (simulation.evaluate(), motion(&rows))
            };
            simulation.set_state(body, &u, &v).unwrap();
            let (energy, sums) = state(&mut simulation);
            let (forces, hash) = (simulation.elastic_forces(body), simulation.positions(body));
            let whole = simulation.cut(body, &oblique()).unwrap();
            // again, right through and across
            let edge = |x: f64| [DVec3::new(x, 0.032, 0.09), DVec3::new(x, 0.029, -0.03)];
            let report = simulation.cut(body, &[edge(-0.02), edge(0.08)]).unwrap();
            assert!(whole.pieces == 1 && report.pieces >= 2 && !report.copies.is_empty());
            assert_eq!(simulation.positions(body), hash);
            let (energy_after, after) = state(&mut simulation);
            let what = format!("{model:?} {precision:?}");
            assert!(
                (energy_after / energy - 1.0).abs() < tolerance,
                "{what}: {energy_after} {energy}"
            );
            for i in 0..8 {
                let size = [sums[0], sums[1]].get(i).copied().unwrap_or(sums[0] * 0.1);
                assert!(
                    (after[i] - sums[i]).abs() < tolerance * size,
                    "{what} {i}: {after:?} {sums:?}"
                );
            }
            // forces of vertices and of their ghosts add up to what they were
            let total = |forces: &[DVec3]| forces.iter().map(|f| f.length()).fold(0.0, f64::max);
            assert!(total(&simulation.elastic_forces(body)) <= total(&forces) * (1.0 + 1e-5));
            // another material gives the same as that of a body that never was cut
            let (mut other, same) = cuttable(&mesh, options(precision, 2), model);
            other.set_state(body, &u, &v).unwrap();
            for (simulation, body) in [(&mut simulation, body), (&mut other, same)] {
                simulation.set_material(body, soft(3e4, 0.4)).unwrap();
            }
            let (a, b) = (state(&mut simulation), state(&mut other));
            assert!(
                (a.0 / b.0 - 1.0).abs() < tolerance && (a.1[0] / b.1[0] - 1.0).abs() < tolerance,
                "{what}"
            );
        }
    }
}

/// Cuts, removals of what they left and steps, in turns: states stay finite and bits do not depend on threads.
#[test]
fn cuts_and_removals_in_turns() {
    let mesh = block(3);
    let mut hashes = Vec::new();
    for threads in [1, 3] {
        let (mut simulation, body) =
            cuttable(&mesh, options(Precision::F64, threads), Model::NeoHookean);
        clamp(&mut simulation, body, &mesh, "z0");
        simulation.integrate_by(Integrator::Safe);
        let mut next = random_numbers(11);
        let mut volume = 0.06_f64.powi(3);
        for _ in 0..8 {
            let mut point = || DVec3::from([0; 3].map(|_| next(1000) as f64 * 6e-5));
            let (a, b, c) = (point(), point(), point());
            simulation.cut(body, &[[a, b], [c, a + b - c]]).unwrap();
            simulation.steps(3);
            let left = simulation.remaining_tetrahedra(body);
            let gone = Removal::new(Region::Tetrahedra(pick(left, 5, next(100) as u64)));
            volume -= simulation.remove_elements(body, &gone).unwrap().volume;
            let mass: f64 = rows::<f64>(&mut simulation).iter().map(|row| row.0).sum();
            assert!((mass / 1000.0 - volume).abs() < 1e-12 * volume);
            assert!(simulation.displacements(body).iter().all(|u| u.is_finite()));
        }
        hashes.push(simulation.state_hash());
    }
    assert_eq!(hashes[0], hashes[1]);
}

#[test]
fn what_cannot_be_cut_is_told() {
    let mesh = block(3);
    let material = soft(1e4, 0.3);
    let plain = BodyDescription { spare: 300, ..BodyDescription::new("block", &mesh, material) };
    let hexahedra = box_hexahedra(DVec3::splat(0.06), [3; 3]).unwrap();
    let bricks = BodyDescription::new("block", &hexahedra, material);
    let bricks = BodyDescription { spare: 300, ..bricks };
    let mut curved = mesh.with_second_order();
    let last = curved.points.len() - 1;
    curved.points[last] += 1e-4;
    let (skin, across) = (mesh.surface_triangles(), [[0, 3, 12]]);
    let membrane = MembraneDescription::new(&skin, 0.001, material);
    let free = MembraneDescription { triangles: &across, ..membrane };
    let stiff = MembraneDescription { bending: Some(Bending::default()), ..membrane };
    let springs = MembraneDescription { model: MembraneModel::MassSpring, ..membrane };
    let quads = MembraneDescription { triangles: &[], quads: &[[0, 1, 5, 4]], ..membrane };
    let cases = [
        (BodyDescription { spare: 0, ..plain.clone() }, "no vertices to spare"),
        (BodyDescription { spare: 5, ..plain.clone() }, "5 are spare"),
        (BodyDescription { evaluation: Evaluation::Pooled, ..plain.clone() }, "pooled springs"),
        (BodyDescription { model: Model::MassSpring, ..plain.clone() }, "proportional to a volume"),
        (
            BodyDescription { model: Model::QuadraticSprings, ..plain.clone() },
            "proportional to a volume",
        ),
        (BodyDescription { masses: MassRule::Equal, ..plain.clone() }, "equal masses"),
        (BodyDescription { membrane: Some(free), ..plain.clone() }, "no face of its tetrahedra"),
        (BodyDescription { membrane: Some(stiff), ..plain.clone() }, "without bending"),
        (BodyDescription { membrane: Some(springs), ..plain.clone() }, "springs of its membrane"),
        (BodyDescription { membrane: Some(quads), ..plain.clone() }, "only triangles"),
        (BodyDescription { integration: Integration::Reduced, ..bricks.clone() }, "reduced"),
        (BodyDescription { masses: MassRule::Nodal, ..bricks.clone() }, "masses at corners"),
        (
            BodyDescription { spare: 300, ..BodyDescription::new("block", &curved, material) },
            "curved",
        ),
    ];
    for (description, words) in cases {
        let (mut simulation, body) = alone(options(Precision::F64, 1), &description);
        let before = simulation.state_hash();
        let error = simulation.cut(body, &oblique()).unwrap_err().to_string();
        assert!(error.contains("`block`") && error.contains(words), "{words}: {error}");
        assert_eq!(simulation.state_hash(), before);
        simulation.step().unwrap();
    }
    let many = BodyDescription { spare: u32::MAX as usize, ..plain.clone() };
    assert!(refused(&many).contains("needs about"), "rows for all vertices that there may be");
    let (mut simulation, body) = alone(options(Precision::F64, 1), &plain);
    let [first, last] = oblique();
    for strip in
        [vec![first], vec![first, [last[0], DVec3::NAN]], vec![[first[0]; 2], [last[0]; 2]]]
    {
        assert!(matches!(simulation.cut(body, &strip), Err(CutError::Strip { .. })));
    }
    assert!(matches!(simulation.cut(BodyHandle(4), &oblique()), Err(CutError::Rows(_))));
    // beside the body
    let far = oblique().map(|edge| edge.map(|x| x + 1.0));
    assert!(simulation.cut(body, &far).unwrap().separated.is_empty());
    simulation.cut(body, &oblique()).unwrap();
    // both sides of the wound and all that is left of the faces
    let surface: f64 = {
        let skin = simulation.skin(body).unwrap();
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|p| skin.points[p as usize]);
            (b - a).cross(c - a).length() / 2.0
        };
        let outside = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| !**wound);
        outside.map(|(t, _)| area(t)).sum()
    };
    assert!((surface / (6.0 * 0.06 * 0.06) - 1.0).abs() < 1e-12, "{surface}");
    simulation.step().unwrap();
}

/// A block cut through by a level blade, between a table and a plate that presses it together and leaves again: the force is that
/// of the whole block but for what the contact of the lips gives way, and nothing sticks. Without contact
/// of the lips the pieces go through each other.
#[test]
fn lips_bear_what_presses_them_together() {
    bear_what_presses(Solid::Linear);
}

#[test]
#[ignore = "slow"]
fn lips_of_other_elements_bear_what_presses_them_together() {
    bear_what_presses(Solid::TenNodes);
    bear_what_presses(Solid::Hexahedra);
}

fn bear_what_presses(solid: Solid) {
    let mesh = &solid.block(0.06, if solid == Solid::TenNodes { 3 } else { 4 });
    let press = |is_cut: bool, lips: bool| {
        let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
        simulation.set_gravity(DVec3::ZERO);
        let description = BodyDescription::new("block", mesh, soft(1e4, 0.0));
        let body = simulation
            .add_body(&BodyDescription { spare: 3 * mesh.points.len(), ..description })
            .unwrap();
        let table = simulation.add_tool(Tool::ground("table", DVec3::ZERO, DVec3::Z)).unwrap();
        let top = Tool::ground("plate", DVec3::Z * 0.06, -DVec3::Z);
        let plate = simulation.add_tool(top.clone()).unwrap();
        let contact =
            lips.then(|| simulation.add_body_contact(BodyContact::new("lips", [body; 2])));
        if is_cut {
            let strip =
                [-0.01, 0.07].map(|y| [DVec3::new(-0.01, y, 0.031), DVec3::new(0.07, y, 0.031)]);
            assert_eq!(simulation.cut(body, &strip).unwrap().pieces, 2);
        }
        let damped = SolverSettings { mass_damping: 30.0, ..SolverSettings::default() };
        simulation.set_solver(damped);
        let mut forces = Vec::new();
        for (way, steps) in [(-0.001, 60), (0.002, 60)] {
            let pose = ToolPose { position: DVec3::Z * (0.06 + way), ..top.start };
            simulation.move_tool(plate, pose).unwrap();
            simulation.steps(steps);
            let force = |tool| simulation.tool_report(tool).unwrap().force.z;
            forces.push([force(table), force(plate)]);
        }
        let area = contact.map(|own| simulation.body_contact_report(own).unwrap().area);
        assert!(area.is_none_or(|area| area == 0.0), "they have parted: {area:?}");
        forces
    };
    let whole = press(false, false);
    let lips = press(true, true);
    let through = press(true, false);
    let ratio = lips[0][0] / whole[0][0];
    // what gives way is as thick as faces are long
    let least = if solid == Solid::Hexahedra { 0.95 } else { 0.97 };
    assert!(ratio > least && ratio < 1.0, "{solid:?}: {ratio}");
    // steps find contact between bodies to a hundredth of the sum of its forces, which here is four times this one
    assert!((lips[0][0] + lips[0][1]).abs() < 0.04 * lips[0][1], "{solid:?}: {lips:?}");
    assert!(through[0][0].abs() < 0.5 * whole[0][0].abs(), "{through:?}");
    assert_eq!(lips[1], [0.0; 2], "{lips:?}");
}

/// The skin is what drawing needs: smooth sides with points of their own, depths, a volume; it moves without being made anew.
#[test]
fn the_skin_follows_cut_motion_and_removal() {
    let size = 0.06;
    let mesh = block(6);
    let (mut simulation, body) = cuttable(&mesh, options(Precision::F64, 1), Model::default());
    let mut skin = MaterialSkin::default();
    assert!(simulation.update_skin(body, &mut skin).unwrap() && !simulation.is_cut(body));
    assert_eq!((skin.points.len(), skin.cells.len()), (mesh.points.len(), 0));
    simulation.cut(body, &oblique()).unwrap();
    assert!(simulation.update_skin(body, &mut skin).unwrap() && simulation.is_cut(body));
    assert_eq!(skin.points[..mesh.points.len()], mesh.points);
    assert_eq!(skin, simulation.skin(body).unwrap());
    let [p, q] = oblique()[0];
    let blade = (q - p).cross(DVec3::Y).normalize();
    let is_wound = |v: u32| {
        let own = skin.triangles.iter().zip(&skin.wound).filter(|(t, _)| t.contains(&v));
        own.map(|(_, wound)| *wound).collect::<std::collections::BTreeSet<_>>()
    };
    let mut wounds = 0;
    for v in mesh.points.len()..skin.points.len() {
        let round = is_wound(v as u32);
        assert!(round.len() == 1, "a point of the wound and of what is round it: {round:?}");
        let at = skin.rest[v];
        let on_faces = at.min(size - at).min_element();
        // the cut of elements at the end of the blade goes on in its plane
        if round.contains(&true) {
            wounds += 1;
            assert!((at - p).dot(blade).abs() < 1e-3 * size / 6.0, "{at}");
            let depth = skin.depth[v];
            assert!((depth - on_faces).abs() < 1e-15, "{depth} {on_faces}");
        } else {
            assert!(skin.depth[v] == 0.0 && on_faces < 1e-15);
        }
    }
    assert!(wounds > 40);
    // a side of the wound is one surface: but for the edge of the wound every edge has two triangles
    let mut edges = std::collections::BTreeMap::new();
    for t in skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound).map(|(t, _)| t) {
        for k in 0..3 {
            *edges.entry([t[k], t[(k + 1) % 3]]).or_insert(0) += 1;
        }
    }
    let open = edges.keys().filter(|[a, b]| !edges.contains_key(&[*b, *a]));
    let on_edge = |v: u32| skin.rest[v as usize].min(size - skin.rest[v as usize]).min_element();
    assert!(open.clone().count() > 20 && open.flatten().all(|&v| on_edge(v) < 1e-15));
    let volume = |skin: &MaterialSkin| -> f64 {
        let corners = skin.triangles.iter().map(|t| t.map(|v| skin.points[v as usize]));
        corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    };
    let cells: f64 = skin
        .cells
        .iter()
        .map(|(cell, _)| cell.map(|v| skin.points[v as usize]))
        .map(|[a, b, c, d]| (b - a).cross(c - a).dot(d - a) / 6.0)
        .sum();
    assert!((volume(&skin) / size.powi(3) - 1.0).abs() < 1e-12);
    assert!(cells > 0.0 && cells < 0.5 * size.powi(3), "{cells}");
    // it moves as the elements do, and whatever is known at nodes is known there
    simulation.step().unwrap();
    assert!(!simulation.update_skin(body, &mut skin).unwrap());
    assert_eq!(skin, simulation.skin(body).unwrap());
    let at = simulation.node_places(body);
    assert!(skin.mean(|node| at[node as usize]).eq(skin.points.iter().copied()));
    assert!((volume(&skin) / simulation.volume(body) - 1.0).abs() < 1e-9);
    let region = Region::Sphere { centre: DVec3::new(0.03, 0.03, 0.06), radius: 0.012 };
    simulation.remove_elements(body, &Removal::new(region)).unwrap();
    assert!(simulation.update_skin(body, &mut skin).unwrap());
    assert!((volume(&skin) / simulation.volume(body) - 1.0).abs() < 1e-9);
}

/// Cuts through the half of a bar that is held leave the motion of its other half alone: also the second order, which needs the
/// step before.
#[test]
fn motion_goes_on_through_cuts() {
    let mesh = box_tets(DVec3::new(0.16, 0.04, 0.04), [16, 4, 4]).unwrap();
    let held = vertices(&mesh.points, |p| p.x < 0.081);
    let pushed = |p: &DVec3| DVec3::Z * (p.x - 0.08).max(0.0) * 20.0;
    let speeds: Vec<DVec3> = mesh.points.iter().map(pushed).collect();
    let still = vec![DVec3::ZERO; speeds.len()];
    for integrator in [Integrator::LinearisedBdf2, Integrator::Bdf2, Integrator::LinearisedTrBdf2] {
        let build = |threads| {
            let options = options(Precision::F64, threads);
            let (mut simulation, body) = cuttable(&mesh, options, Model::NeoHookean);
            let rows = simulation.rows(body, "held", &held).unwrap();
            simulation.add_constraint(Constraint::hold("held", rows));
            let tight = SolverSettings {
                linear_tolerance: 1e-11,
                newton_tolerance: 1e-11,
                mass_damping: 5.0,
                ..SolverSettings::default()
            };
            simulation.set_solver(SolverSettings { integrator, ..tight });
            simulation.set_state(body, &still, &speeds).unwrap();
            (simulation, body)
        };
        let ((mut whole, own), (mut cut, body)) = (build(1), build(2));
        let (mut copies, mut farthest, mut starts) = (0, 0.0_f64, 0);
        let (mut saved, mut hash) = (None, 0);
        for i in 0..24 {
            if i % 2 == 1 {
                let edge = |y: f64| {
                    [
                        DVec3::new(0.0063 * i as f64 / 2.0 + 0.001, y, 0.05),
                        DVec3::new(0.0063 * i as f64 / 2.0, y, 0.013),
                    ]
                };
                copies += cut.cut(body, &[edge(-0.01), edge(0.05)]).unwrap().copies.len();
            }
            if i == 13 {
                saved = Some(cut.snapshot().unwrap());
            }
            for simulation in [&mut whole, &mut cut] {
                simulation.step().unwrap();
            }
            starts += cut.report().fallbacks.start;
            // damped as it is, no step takes energy that it has no budget for: a cut leaves none over
            assert_eq!(cut.report().fallbacks, whole.report().fallbacks, "{integrator:?} {i}");
            let [a, b] = [whole.positions(own), cut.positions(body)];
            farthest = farthest.max(max_distance(&a, &mesh.points));
            let apart = max_distance(&a, &b) / farthest;
            assert!(apart < 1e-8, "{integrator:?} {i}: {apart}");
            if i == 13 {
                hash = cut.state_hash();
            }
        }
        assert!(copies > 500 && farthest > 0.01 && starts < 2, "{copies} {farthest} {starts}");
        // also from a snapshot between a cut and its step
        let mut other = build(1).0;
        other.restore(&saved.unwrap()).unwrap();
        other.step().unwrap();
        assert_eq!(other.state_hash(), hash, "{integrator:?}");
    }
}

/// What contact knows of a wound is what is drawn of it, however vertices are displaced, also at the end of a cut, where lips have points in
/// common.
#[test]
fn contact_meets_what_is_drawn() {
    for solid in Solid::ALL {
        let mesh = solid.block(0.06, 3);
        let description = BodyDescription::new("block", &mesh, soft(1e4, 0.3));
        let body = BodyDescription { spare: 6 * mesh.points.len(), ..description };
        let (mut simulation, body) = alone(options(Precision::F64, 1), &body);
        simulation.set_gravity(DVec3::ZERO);
        let mut next = random_numbers(7);
        for round in 0..6 {
            let mut point = || DVec3::from([0; 3].map(|_| next(1000) as f64 * 1e-4 - 0.02));
            let (a, b, c) = (point(), point(), point());
            simulation.cut(body, &[[a, b], [c, a + b - c]]).unwrap();
            // ghosts move, too, and nothing is alike
            let world = simulation.world_mut();
            let rows = world.query::<&Displacement<f64>>().iter(world).count();
            let field = random_field(rows, round + 1);
            let mut query = world.query::<(&mut Displacement<f64>, &mut Position, &RestPosition)>();
            for ((mut u, mut x, rest), own) in query.iter_mut(world).zip(&field) {
                let [x0, y0, z0] = (2e-3 * own).to_array();
                u.0 = [x0, y0, z0, 0.0];
                x.0 = rest.0 + 2e-3 * own;
            }
            let at: Vec<DVec3> = world.query::<&Position>().iter(world).map(|x| x.0).collect();
            let read = *world.get_resource::<SurfaceReader>().unwrap();
            let surface = (read.0)(world, body.0);
            let count = simulation.topology().bodies[body.0].row_count() as u32;
            let place = |v: u32| match v.checked_sub(count) {
                None => at[v as usize],
                Some(made) => {
                    let shares = surface.points[made as usize].shares();
                    shares.map(|(row, w)| w * at[row as usize]).sum()
                }
            };
            let mut touched: Vec<[DVec3; 3]> =
                surface.triangles[..surface.wounds].iter().map(|t| t.map(place)).collect();
            let skin = simulation.skin(body).unwrap();
            let wound = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound);
            let mut drawn: Vec<[DVec3; 3]> =
                wound.map(|(t, _)| t.map(|v| skin.points[v as usize])).collect();
            // at the end of a cut both lips are at one place
            let less = |a: &DVec3, b: &DVec3| a.to_array().partial_cmp(&b.to_array()).unwrap();
            let middle = |t: &[DVec3; 3]| (t[0] + t[1] + t[2]) / 3.0;
            for list in [&mut touched, &mut drawn] {
                list.iter_mut().for_each(|t| t.sort_by(less));
                list.sort_by(|a, b| less(&middle(a), &middle(b)));
            }
            assert!(round < 5 || drawn.len() > 50, "{solid:?}: {}", drawn.len());
            assert_eq!(touched.len(), drawn.len(), "{solid:?}");
            for (a, b) in touched.iter().zip(&drawn) {
                let off = max_distance(a, b);
                assert!(off < 1e-12, "{solid:?} {round}: {a:?} {b:?}");
            }
            let world = simulation.world_mut();
            let mut query = world.query::<&mut Displacement<f64>>();
            query.iter_mut(world).for_each(|mut u| u.0 = [0.0; 4]);
        }
    }
}
