//! Cuts of bodies that are a membrane of triangles and nothing else.

use crate::common::*;
use crate::cutting_elements::{books, nothing_changed, rows};
use glam::{DMat3, DVec2, DVec3};
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::generate::{quad_grid, triangle_grid};
use sinew::engine::row::MeshVertex;
use sinew::models::axes::description::{AxisFamily, FibreForm};
use sinew::models::body::sheet::{Bending, MembraneDescription, MembraneModel};
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew::snapshot::Snapshot;
use sinew::touch::tool::ToolMotion;
use std::collections::HashSet;

const SIDE: f64 = 0.06;
const THICKNESS: f64 = 1e-3;

/// A square whose inner vertices are moved about in its plane, and bulged by so much (m).
fn film(cells: usize, bulge: f64) -> Mesh {
    let mut mesh = triangle_grid(DVec2::splat(SIDE), [cells; 2]).unwrap();
    let moves = random_field(mesh.points.len(), 5);
    for (x, own) in mesh.points.iter_mut().zip(moves) {
        let [s, t] = [x.x / SIDE, x.y / SIDE];
        if s > 1e-9 && s < 1.0 - 1e-9 && t > 1e-9 && t < 1.0 - 1e-9 {
            *x += DVec3::new(own.x, own.y, 0.0) * 0.15 * SIDE / cells as f64;
        }
        x.z = bulge * 16.0 * s * (1.0 - s) * t * (1.0 - t);
    }
    mesh
}

fn body(mesh: &Mesh, model: MembraneModel) -> BodyDescription<'_> {
    let membrane = MembraneDescription::new(&mesh.triangles, THICKNESS, soft(1e5, 0.3));
    let whole = sheet(&mesh.points, MembraneDescription { model, ..membrane });
    BodyDescription { spare: 3 * mesh.points.len(), ..whole }
}

/// Fibres along a direction.
fn fibres(along: &[DVec3; 1]) -> [AxisFamily<'_>; 1] {
    [AxisFamily { form: FibreForm::Biquadratic, ..AxisFamily::new("f", along, 1e5) }]
}

/// Through all of it along x, oblique to the plane and to the edges.
fn across() -> [[DVec3; 2]; 2] {
    let edge = |x: f64, y: f64| [DVec3::new(x, y, 0.03), DVec3::new(x, y + 0.01, -0.03)];
    [edge(-0.02, 0.0237), edge(0.08, 0.0337)]
}

/// From its side y = 0 to somewhere inside.
fn inward() -> [[DVec3; 2]; 2] {
    let edge = |y: f64| [DVec3::new(0.033, y, 0.04), DVec3::new(0.028, y, -0.03)];
    [edge(-0.02), edge(0.0395)]
}

#[test]
fn nothing_changes_at_the_instant() {
    for mesh in [film(5, 0.0), film(6, 0.01)] {
        let models = MembraneModel::ALL.into_iter().filter(|m| *m != MembraneModel::MassSpring);
        let models = models.map(|model| (model, &[][..]));
        // one law has fibres
        let along = [DVec3::new(2.0, 1.0, 0.0)];
        let fibres = fibres(&along);
        for (model, fibres) in models.chain([(MembraneModel::Biquadratic, &fibres[..])]) {
            for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 3e-5)] {
                let mut description = body(&mesh, model);
                description.membrane.as_mut().unwrap().fibres = fibres;
                let (mut simulation, film) = alone(options(precision, 2), &description);
                let n = mesh.points.len();
                let u: Vec<DVec3> = random_field(n, 3).iter().map(|u| *u * 1e-3).collect();
                simulation.set_state(film, &u, &random_field(n, 4)).unwrap();
                let before = books(&mut simulation);
                let mut reports = Vec::new();
                for strip in [inward(), across()] {
                    reports.push(simulation.cut(film, &strip).unwrap());
                    let what = format!("{model:?} {precision:?}");
                    nothing_changed(&mut simulation, &before, tolerance, &what);
                }
                assert_eq!([1, 3], [reports[0].pieces, reports[1].pieces]);
                assert!(reports.iter().all(|r| r.copies.len() > 4 && r.elastic_energy == 0.0));
                let skin = simulation.skin(film).unwrap();
                let area = |x: &[DVec3]| -> f64 {
                    let of = |t: &[u32; 3]| {
                        let [a, b, c] = t.map(|p| x[p as usize]);
                        (b - a).cross(c - a).length() / 2.0
                    };
                    skin.triangles.iter().map(of).sum()
                };
                let of_mesh = |t: &[u32; 3]| {
                    let [a, b, c] = t.map(|v| mesh.points[v as usize]);
                    (b - a).cross(c - a).length() / 2.0
                };
                let whole: f64 = mesh.triangles.iter().map(of_mesh).sum();
                assert!((area(&skin.rest) / whole - 1.0).abs() < 1e-12 && simulation.is_cut(film));
                assert!(skin.wound.iter().all(|wound| !wound) && skin.cells.is_empty());
                assert!(skin.elements.len() == skin.triangles.len());
            }
        }
    }
}

/// The pull of fibres on the end of a film is as large as what is left of its width.
#[test]
fn fibres_pull_with_what_is_left() {
    let (mesh, fibres) = (film(6, 0.0), fibres(&[DVec3::X]));
    let mut found = Vec::new();
    for fibres in [&[][..], &fibres[..]] {
        let mut description = body(&mesh, MembraneModel::Biquadratic);
        description.membrane.as_mut().unwrap().fibres = fibres;
        let (mut simulation, film) = alone(options(Precision::F64, 1), &description);
        let u: Vec<DVec3> = mesh.points.iter().map(|x| 0.08 * DVec3::X * x.x).collect();
        simulation.displace(film, &u);
        let pull = |simulation: &mut Simulation| -> f64 {
            let all = rows(simulation);
            all.iter().filter(|row| row.1.x > SIDE - 1e-9).map(|row| row.4.x).sum()
        };
        let whole = pull(&mut simulation);
        let edge = |x: f64| [DVec3::new(x, 0.0237, 0.03), DVec3::new(x, 0.0237, -0.03)];
        let report = simulation.cut(film, &[edge(-0.02), edge(0.09)]).unwrap();
        assert_eq!(report.pieces, 2);
        assert!((pull(&mut simulation) / whole - 1.0).abs() < 1e-10);
        assert_as_fresh(&mut simulation, film, "fibres");
        // triangles of the piece below are taken out
        let rows = simulation.topology().bodies[0].clone();
        let corner = vertices(&mesh.points, |x| x.y < 1e-9)[0];
        let low = rows.piece[rows.row_of_vertex[MeshVertex(corner)].unwrap().index()];
        let numbers = rows.triangles().iter().zip(&rows.order.triangles);
        let gone = numbers.filter(|(t, _)| rows.piece[t[0] as usize] == low).map(|(_, t)| *t);
        simulation.remove(film, Region::Triangles(gone.collect()));
        let left = pull(&mut simulation) / whole;
        assert!((left / (1.0 - 0.0237 / SIDE) - 1.0).abs() < 1e-10, "{left}");
        assert_as_fresh(&mut simulation, film, "half of the fibres");
        found.push(whole);
    }
    assert!(found[1].abs() > 1.5 * found[0].abs(), "{found:?}");
}

/// The length of a cut right through a flat film, times the thickness; its marks are where the blade is.
#[test]
fn a_wound_is_where_the_blade_was() {
    let mesh = film(7, 0.0);
    let (mut simulation, film) =
        alone(options(Precision::F64, 1), &body(&mesh, MembraneModel::Biquadratic));
    let report = simulation.cut(film, &across()).unwrap();
    let [[p, q], [r, _]] = across();
    let normal = (q - p).cross(r - p).normalize();
    let length = SIDE / DVec3::new(0.1, 0.01, 0.0).normalize().x;
    assert_eq!(report.pieces, 2);
    assert!(
        (report.area / (THICKNESS * length) - 1.0).abs() < 1e-12,
        "{}",
        report.area / THICKNESS
    );
    let skin = simulation.skin(film).unwrap();
    let made = &skin.rest[mesh.points.len()..];
    assert!(made.len() > 20);
    assert!(made.iter().all(|x| normal.dot(*x - p).abs() < 1e-15));
}

/// A stretch along a cut, whose stress has nothing across it: no force on inner vertices and ghosts.
#[test]
fn patch_of_a_film() {
    let mesh = film(6, 0.0);
    for model in [MembraneModel::CompressibleBiquadratic, MembraneModel::Biquadratic] {
        let (mut simulation, film) = alone(options(Precision::F64, 2), &body(&mesh, model));
        let [[p, _], [r, _]] = across();
        let along = DVec3::new(r.x - p.x, r.y - p.y, 0.0).normalize();
        let side = DVec3::Z.cross(along);
        let strain = 0.5 * (1.1 * 1.1 - 1.0);
        let turn = DMat3::from_cols(along, side, DVec3::Z);
        let stretch = DVec3::new(1.1, f64::sqrt(1.0 - 2.0 * 0.3 * strain), 1.0);
        let f = turn * DMat3::from_diagonal(stretch) * turn.transpose();
        let u: Vec<DVec3> = mesh.points.iter().map(|x| f * *x - *x).collect();
        simulation.displace(film, &u);
        let report = simulation.cut(film, &across().map(|edge| edge.map(|x| f * x))).unwrap();
        assert!(report.pieces == 2 && report.copies.len() > 10);
        let all = rows(&mut simulation);
        let inside = |x: DVec3| x.x.min(x.y) > 1e-9 && x.x.max(x.y) < SIDE - 1e-9;
        let largest = all.iter().map(|row| row.4.length()).fold(0.0, f64::max);
        let inner: Vec<f64> =
            all.iter().filter(|row| inside(row.1)).map(|row| row.4.length()).collect();
        let count = mesh.points.iter().filter(|x| inside(**x)).count();
        assert!(inner.len() > count && largest > 0.0);
        assert!(inner.into_iter().fold(0.0, f64::max) < 1e-10 * largest, "{model:?}");
    }
}

/// Half of a film that is held on one side is cut off: it falls freely, the other half stays.
#[test]
fn what_is_cut_off_falls() {
    let mesh = film(6, 0.0);
    let held = vertices(&mesh.points, |x| x.y < 0.02);
    let loose = vertices(&mesh.points, |x| x.y > 0.04);
    let mut shortened = 0;
    let both = [Integrator::Newton, Integrator::Safe];
    for (precision, integrator) in
        [Precision::F64, Precision::F32].into_iter().flat_map(|p| both.map(|by| (p, by)))
    {
        let description = body(&mesh, MembraneModel::CompressibleBiquadratic);
        let (mut simulation, film) = alone(options(precision, 1), &description);
        let on = simulation.rows(film, "held", &held).unwrap();
        simulation.add_constraint(Constraint::hold("held", on));
        simulation.integrate_by(integrator);
        simulation.cut(film, &across()).unwrap();
        for _ in 0..20 {
            simulation.step().unwrap();
            // the half that is held, slack under its weight, overshoots; what falls does not stop for it
            shortened +=
                if integrator == Integrator::Safe { simulation.report().backtracks } else { 0 };
        }
        let u = simulation.displacements(film);
        let time = simulation.time();
        let fallen = -0.5 * 9.81 * time * (time + 0.01);
        // a safe step solves to 1e-3
        let tolerance = match (precision, integrator) {
            (Precision::F64, Integrator::Newton) => 1e-9,
            (Precision::F64, _) => 1e-6,
            (Precision::F32, _) => 1e-5,
        };
        for &v in &loose {
            assert!(
                (u[v as usize].z / fallen - 1.0).abs() < tolerance,
                "{precision:?} {integrator:?}: {} {fallen}",
                u[v as usize].z
            );
        }
        assert!(held.iter().all(|v| u[*v as usize] == DVec3::ZERO));
    }
    assert!(shortened > 0);
}

/// A slit of length `2 a` in a wide plate under a tension `s` across it opens by `4 s a / E` in its middle (plane stress). A cut is up to an
/// element longer at either end than the blade, and elements at its ends are stiff: with 5 elements on the slit within 0.3, and half of that
/// with 10.
#[test]
fn a_slit_opens_as_in_theory() {
    let (a, stress) = (0.01, 100.0);
    for (cells, bound) in [(25, 0.3), (51, 0.15)] {
        let size = 10.0 * a;
        let mesh = triangle_grid(DVec2::splat(size), [cells; 2]).unwrap();
        let membrane = MembraneDescription::new(&mesh.triangles, THICKNESS, soft(1e5, 0.0));
        let whole = sheet(&mesh.points, membrane);
        let whole = BodyDescription { spare: 200, ..whole };
        let (mut simulation, film) = alone(options(Precision::F64, 2), &whole);
        simulation.set_gravity(DVec3::ZERO);
        // without Poisson's ratio sides stay straight in a tension
        let u: Vec<DVec3> = mesh.points.iter().map(|x| DVec3::Y * x.y * (stress / 1e5)).collect();
        simulation.displace(film, &u);
        for side in ["y0", "y1"] {
            clamp(&mut simulation, film, &mesh, side);
        }
        for side in ["x0", "x1", "body"] {
            let axes = if side == "body" { 0b100 } else { 0b001 };
            guide(&mut simulation, film, &mesh, side, axes);
        }
        let middle = 0.5 * size + 1e-4;
        let edge = |x: f64| [DVec3::new(x, middle, 0.01), DVec3::new(x, middle, -0.01)];
        let strip = [edge(0.5 * size - a), edge(0.5 * size + a)];
        let report = simulation.cut(film, &strip).unwrap();
        assert_eq!(report.pieces, 1);
        simulation.settle();
        let skin = simulation.skin(film).unwrap();
        let near = |p: &usize| (skin.rest[*p].x - 0.5 * size).abs() < 0.6 * size / cells as f64;
        let made = (mesh.points.len()..skin.points.len()).filter(near);
        let moved: Vec<f64> = made.map(|p| skin.points[p].y - skin.rest[p].y).collect();
        let most = moved.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let least = moved.iter().copied().fold(f64::INFINITY, f64::min);
        let theory = 4.0 * stress * a / 1e5;
        let off = (most - least) / theory - 1.0;
        assert!(off.abs() < bound, "{cells}: {off}");
    }
}

/// Cuts anywhere and removals, under a pressure: as a film that was divided at once, whatever the number of threads, and again from a
/// snapshot; how vertices are numbered changes rounding alone, as long as no cut meets another one.
#[test]
fn films_are_cut_and_removed() {
    let mesh = film(6, 0.01);
    let last = mesh.points.len() as u32 - 1;
    let turned = |t: &[u32; 3]| [last - t[1], last - t[2], last - t[0]];
    let backwards = Mesh {
        points: mesh.points.iter().rev().copied().collect(),
        triangles: mesh.triangles.iter().map(turned).collect(),
        ..Mesh::default()
    };
    let mut hashes = Vec::new();
    let mut ends: Vec<(f64, f64, usize)> = Vec::new();
    for (mesh, threads) in [(&mesh, 1), (&mesh, 3), (&backwards, 2)] {
        let description = body(mesh, MembraneModel::CompressibleBiquadratic);
        let (mut simulation, film) = alone(options(Precision::F64, threads), &description);
        let rim = vertices(&mesh.points, |x| x.x < 1e-9 || x.x > SIDE - 1e-9);
        let on = simulation.rows(film, "rim", &rim).unwrap();
        simulation.add_constraint(Constraint::hold("rim", on));
        let pressure = 50.0;
        blow(&mut simulation, film, &mesh.triangles, pressure, Curve::Constant);
        let exact = solver!(Integrator::Safe, linear_tolerance = 1e-12);
        simulation.set_solver(exact.clone());
        let mut next = random_numbers(5);
        let mut taken = None;
        for round in 0..5 {
            let mut point = || DVec2::from([0; 2].map(|_| next(1000) as f64 * SIDE * 1e-3));
            let (a, b) = (point(), point());
            let edge = |x: DVec2| [0.05, -0.05].map(|z| x.extend(z));
            let mass =
                |simulation: &mut Simulation| rows(simulation).iter().map(|r| r.0).sum::<f64>();
            let before = mass(&mut simulation);
            simulation.cut(film, &[edge(a), edge(b)]).unwrap();
            assert!((mass(&mut simulation) / before - 1.0).abs() < 1e-12);
            simulation.steps(2);
            if round == 1 {
                taken = Some((simulation.snapshot().unwrap(), simulation.state_hash()));
            }
            if round == 3 {
                let nearest = |copies: bool| {
                    let rows = &simulation.topology().bodies[0];
                    let left = simulation.remaining(film, ElementKind::Triangle);
                    let count = rows.mesh_elements(ElementKind::Triangle) as u32;
                    left.into_iter().find(|t| (*t >= count) == copies)
                };
                // the numbers of copies depend on those of the mesh
                let gone = nearest(true).filter(|_| threads != 2).into_iter().chain(nearest(false));
                let gone: Vec<u32> = gone.collect();
                if threads != 2 {
                    simulation.remove(film, Region::Triangles(gone));
                }
            }
        }
        let found = simulation.verify_against_fresh(film).unwrap();
        assert!(found.largest() < 1e-12 && found.mass < 1e-12, "{found:?}");
        hashes.push(simulation.state_hash());
        // back to before, and once more in another world
        let (snapshot, hash) = taken.unwrap();
        simulation.restore(&snapshot).unwrap();
        assert_eq!(simulation.state_hash(), hash);
        let pieces = simulation.topology().bodies[0].piece_count();
        ends.push((simulation.evaluate(), simulation.report().kinetic_energy, pieces));
        let (mut other, _) = alone(options(Precision::F64, 2), &description);
        let on = other.rows(film, "rim", &rim).unwrap();
        other.add_constraint(Constraint::hold("rim", on));
        blow(&mut other, film, &mesh.triangles, pressure, Curve::Constant);
        other.set_solver(exact);
        other.restore(&Snapshot::from_bytes(&snapshot.to_bytes()).unwrap()).unwrap();
        simulation.steps(3);
        other.steps(3);
        assert_eq!(simulation.state_hash(), other.state_hash());
    }
    assert_eq!(hashes[0], hashes[1]);
    let [a, _, b] = ends[..] else { unreachable!() };
    assert!((a.0 / b.0 - 1.0).abs() < 1e-6 && (a.1 / b.1 - 1.0).abs() < 1e-6, "{a:?} {b:?}");
    assert_eq!(a.2, b.2);
}

/// The resultant of a pressure on what is left of a film that was cut and is at rest, piece by piece: pressure times area.
#[test]
fn a_pressure_acts_on_every_piece_of_a_film() {
    let mesh = film(6, 0.0);
    for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 3e-5)] {
        let description = body(&mesh, MembraneModel::Biquadratic);
        let (mut simulation, film) = alone(options(precision, 1), &description);
        blow(&mut simulation, film, &mesh.triangles, 40.0, Curve::Constant);
        simulation.cut(film, &across()).unwrap();
        simulation.evaluate();
        // of the flat film below and above the line y = 0.0237 + 0.005 + 0.1 (x + 0.02)
        let below = 0.0307 * SIDE + 0.05 * SIDE * SIDE;
        let rows_of = simulation.topology().bodies[0].clone();
        let all = rows(&mut simulation);
        for (held, area) in [(0.0, below), (SIDE, SIDE * SIDE - below)] {
            let corner = vertices(&mesh.points, |x| x.x < 1e-9 && (x.y - held).abs() < 1e-9)[0];
            let at = rows_of.row(sinew::engine::row::MeshVertex(corner)).unwrap().index();
            let own = (0..all.len()).filter(|row| rows_of.piece[*row] == rows_of.piece[at]);
            let force: DVec3 = own.map(|row| all[row].4).sum();
            let expected = DVec3::Z * 40.0 * area;
            assert!((force.abs() - expected).length() < tolerance * 0.2, "{force} {expected}");
        }
    }
}

/// The same on slits that cross a few edges, round which copies of a triangle hang together; and `outside` has triangles of the mesh alone.
#[test]
fn a_pressure_acts_on_all_of_a_film_with_slits() {
    let mesh = film(6, 0.0);
    let (mut twins, mut next) = (0, random_numbers(3));
    let sorted = |mut t: [u32; 3]| {
        t.sort_unstable();
        t
    };
    let known: HashSet<[u32; 3]> = mesh.triangles.iter().map(|t| sorted(*t)).collect();
    for _ in 0..60 {
        let description = body(&mesh, MembraneModel::Biquadratic);
        let (mut simulation, film) = alone(options(Precision::F64, 1), &description);
        blow(&mut simulation, film, &mesh.triangles, 40.0, Curve::Constant);
        let mut number = |low: f64, high: f64| low + (high - low) * next(1000) as f64 * 1e-3;
        let a = DVec2::new(number(0.01, 0.05), number(0.01, 0.05));
        let b = a + DVec2::from_angle(number(0.0, 6.2)) * number(0.002, 0.012);
        let edge = |x: DVec2| [0.01, -0.01].map(|z| x.extend(z));
        let report = simulation.cut(film, &[edge(a), edge(b)]).unwrap();
        simulation.evaluate();
        let force: DVec3 = rows(&mut simulation).iter().map(|row| row.4).sum();
        let whole = 40.0 * SIDE * SIDE;
        assert!((force.abs() - DVec3::Z * whole).length() < 1e-12 * whole, "{force} {whole}");
        let mut nodes = simulation.topology().bodies[0].triangles().to_vec();
        nodes.sort_unstable();
        twins += nodes.windows(2).filter(|pair| pair[0] == pair[1]).count();
        // without those beside the ends of the slit, which are whole but have points on their edges
        let (outside, count) = (simulation.outside(film), mesh.triangles.len());
        let gone = count - outside.len();
        let parted = report.separated.len();
        assert!(outside.iter().all(|t| known.contains(&sorted(*t))) && gone >= parted);
        assert!(gone <= parted + 4, "{gone} {parted}");
    }
    assert!(twins > 5, "{twins}");
}

/// A ball pushes the half that it is over, and lifts nothing of the other one, although triangles of both lie in the same place.
#[test]
fn a_ball_pushes_the_half_that_it_meets() {
    let mesh = film(8, 0.0);
    for integrator in [Integrator::Safe, Integrator::Newton] {
        let description = body(&mesh, MembraneModel::CompressibleBiquadratic);
        let (mut simulation, film) = alone(options(Precision::F64, 1), &description);
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_solver(SolverSettings {
            integrator,
            mass_damping: 5.0,
            ..Default::default()
        });
        for side in ["x0", "x1"] {
            clamp(&mut simulation, film, &mesh, side);
        }
        let above = DVec3::new(0.03, 0.02, 0.0055);
        let mut ball = Tool::new("ball", Shape::Sphere { radius: 0.005 }, above);
        ball.motion = ToolMotion::Translate(DVec3::Z * -0.005, Curve::ramp(0.0, 0.3));
        let ball = simulation.add_tool(ball).unwrap();
        let report = simulation.cut(film, &across()).unwrap();
        assert_eq!(report.pieces, 2);
        simulation.steps(40);
        let report = simulation.tool_report(ball).unwrap();
        assert!(report.force.z > 1e-3 && !simulation.report().unconverged, "{report:?}");
        let u = simulation.displacements(film);
        let other = vertices(&mesh.points, |x| x.y > 0.04);
        let own = vertices(&mesh.points, |x| x.distance(DVec3::new(0.03, 0.02, 0.0)) < 0.004);
        assert!(own.iter().any(|v| u[*v as usize].z < -0.002), "{u:?}");
        assert!(other.iter().all(|v| u[*v as usize] == DVec3::ZERO), "{u:?}");
    }
}

/// All integrators, before and after a cut of a film that hangs under its weight.
#[test]
fn films_hang_after_cuts() {
    let mesh = film(5, 0.004);
    for &integrator in Integrator::ALL {
        let description = body(&mesh, MembraneModel::CompressibleBiquadratic);
        let (mut simulation, film) = alone(options(Precision::F64, 1), &description);
        for side in ["x0", "x1"] {
            clamp(&mut simulation, film, &mesh, side);
        }
        simulation.integrate_by(integrator);
        simulation.set_dt(if integrator.is_explicit() { 1e-5 } else { 0.01 });
        simulation.steps(3);
        let at = simulation.positions(film)[12].z;
        let edge = |x: f64| [DVec3::new(x, 0.028, at + 0.03), DVec3::new(x, 0.031, at - 0.03)];
        let report = simulation.cut(film, &[edge(0.011), edge(0.045)]).unwrap();
        assert!(report.pieces == 1 && report.copies.len() > 3, "{integrator:?} {report:?}");
        simulation.steps(10);
        let u = simulation.displacements(film);
        assert!(u.iter().all(|u| u.is_finite() && u.length() < 0.1), "{integrator:?}");
    }
}

/// What cannot be cut is told by name, and nothing changes.
#[test]
fn films_that_cannot_be_cut() {
    let mesh = film(4, 0.0);
    let quads = quad_grid(DVec2::splat(SIDE), [4; 2]).unwrap();
    let membrane = MembraneDescription::new(&mesh.triangles, THICKNESS, soft(1e5, 0.3));
    let of_quads = MembraneDescription::new(&[], THICKNESS, soft(1e5, 0.3));
    let of_quads = MembraneDescription { quads: &quads.quads, ..of_quads };
    let bending = Some(Bending::default());
    let bends = MembraneDescription { bending, ..membrane };
    let springs = MembraneDescription { model: MembraneModel::MassSpring, ..membrane };
    let cases = [
        (sheet(&mesh.points, membrane), 0, "vertices to spare"),
        (sheet(&quads.points, of_quads), 40, "quadrilaterals"),
        (sheet(&mesh.points, bends), 40, "bending"),
        (sheet(&mesh.points, springs), 40, "springs of its membrane"),
    ];
    for (description, spare, why) in cases {
        let description = BodyDescription { spare, ..description };
        let (mut simulation, film) = alone(options(Precision::F64, 1), &description);
        simulation.steps(1);
        let before = simulation.state_hash();
        let error = simulation.cut(film, &across()).unwrap_err().to_string();
        assert!(error.contains("`sheet`") && error.contains(why), "{error}");
        assert_eq!(before, simulation.state_hash());
    }
    // what a tear releases is of tetrahedra
    let (mut simulation, film) =
        alone(options(Precision::F64, 1), &body(&mesh, MembraneModel::Biquadratic));
    let tear = Tear { toughness: Some(100.0), ..tear_of(film, 1e4, None) };
    let error = simulation.set_tear(tear).unwrap_err().to_string();
    assert!(error.contains("leave its toughness out"), "{error}");
    // nobody knows what fibres bear
    let (mut description, fibres) = (body(&mesh, MembraneModel::Biquadratic), fibres(&[DVec3::X]));
    description.membrane.as_mut().unwrap().fibres = &fibres;
    let (mut simulation, film) = alone(options(Precision::F64, 1), &description);
    let error = simulation.set_tear(tear_of(film, 1e4, None)).unwrap_err().to_string();
    assert!(error.contains("axes and fibres"), "{error}");
}

/// A blade through a film that is stretched: it takes energy, step by step, and decides as one that goes the same way at once; a film
/// resists no edge, and one that would is told.
#[test]
fn a_blade_goes_through_a_stretched_film() {
    const BLADE: DVec3 = DVec3::new(0.0371, -0.004, -0.01);
    let mesh = film(8, 0.0);
    let stretched = |toughness: f64, glue: f64| {
        let description = BodyDescription { glue, ..body(&mesh, MembraneModel::Biquadratic) };
        let (mut simulation, film) = alone(options(Precision::F64, 1), &description);
        simulation.set_gravity(DVec3::ZERO);
        let u: Vec<DVec3> = mesh.points.iter().map(|x| DVec3::X * 0.15 * x.x).collect();
        simulation.displace(film, &u);
        for side in ["x0", "x1"] {
            clamp(&mut simulation, film, &mesh, side);
        }
        let edge = Edge {
            ends: [DVec3::ZERO, DVec3::Z * 0.02],
            into: DVec3::Y,
            toughness,
            travel: DVec3::ZERO,
        };
        let blade = simulation.add_tool(Tool::blade("scalpel", edge, BLADE)).unwrap();
        (simulation, film, blade)
    };
    for (integrator, dt, glue) in [
        (Integrator::Safe, 0.005, 0.0),
        (Integrator::Safe, 0.033, 0.0),
        (Integrator::Newton, 0.01, 0.0),
        (Integrator::Safe, 0.005, 5.0),
        (Integrator::Safe, 0.033, 5.0),
    ] {
        let (mut simulation, film, blade) = stretched(0.0, glue);
        simulation.integrate_by(integrator);
        simulation.set_dt(dt);
        let whole = simulation.evaluate();
        let (mut last, mut springs) = (whole, 0);
        for step in 0..40 {
            let way = DVec3::Y * f64::from(step) * 1.1e-3;
            simulation.move_tool(blade, BLADE + way).unwrap();
            simulation.step().unwrap();
            let report = simulation.report();
            let energy = report.elastic_energy + report.kinetic_energy;
            assert!(energy < last * (1.0 + 1e-9), "{integrator:?} {dt}: {energy} {last}");
            last = energy;
            springs = simulation.glue_report(film).map_or(0, |own| own.springs).max(springs);
        }
        assert_eq!(springs > 0, glue > 0.0);
        let report = simulation.tool_report(blade).unwrap();
        let pieces = simulation.topology().bodies[0].piece_count();
        assert!(report.separated > 8 && pieces == 1, "{report:?} {pieces}");
        assert!(last < 0.95 * whole, "{last} {whole}");
        // in the plane of the blade, where the film was at first
        let skin = simulation.skin(film).unwrap();
        let off = |p: usize| (skin.rest[p].x - BLADE.x / 1.15).abs() * 8.0 / SIDE;
        let most = (mesh.points.len()..skin.rest.len()).map(off).fold(0.0, f64::max);
        assert!(most < 0.15, "{integrator:?} {dt}: {most}");
    }
    let (mut simulation, _, blade) = stretched(100.0, 0.0);
    simulation.step().unwrap();
    simulation.move_tool(blade, BLADE + DVec3::Y * 0.01).unwrap();
    let error = simulation.step().unwrap_err().to_string();
    assert!(error.contains("scalpel") && error.contains("toughness = 0"), "{error}");
}

fn tear_of(film: BodyHandle, strength: f64, radius: Option<f64>) -> Tear {
    Tear { body: film.0, strength, toughness: None, radius, max_speed: None }
}

/// The stress of a uniform stretch is that of the law, in any direction; where it is above the strength a tear begins, across it.
#[test]
fn a_film_tears_where_it_is_stretched_too_far() {
    let mesh = film(8, 0.0);
    for (precision, tolerance) in [(Precision::F64, 1e-9), (Precision::F32, 1e-4)] {
        for angle in [0.0, 0.4] {
            let description = body(&mesh, MembraneModel::Biquadratic);
            let (mut simulation, film) = alone(options(precision, 1), &description);
            simulation.set_gravity(DVec3::ZERO);
            let strain = 0.5 * (1.1 * 1.1 - 1.0);
            let turn = DMat3::from_rotation_z(angle);
            let stretch = DVec3::new(1.1, f64::sqrt(1.0 - 2.0 * 0.3 * strain), 1.0);
            let f = turn * DMat3::from_diagonal(stretch) * turn.transpose();
            let u: Vec<DVec3> = mesh.points.iter().map(|x| f * *x - *x).collect();
            simulation.displace(film, &u);
            for side in ["x0", "x1", "y0", "y1"] {
                clamp(&mut simulation, film, &mesh, side);
            }
            simulation.integrate_by(Integrator::Safe);
            // F S F^T at the same volume
            let stress = 1.1 * 1.1 * 1e5 * strain;
            for (strength, tears) in [(1.01 * stress, false), (0.99 * stress, true)] {
                simulation.set_tear(tear_of(film, strength, None)).unwrap();
                simulation.step().unwrap();
                let report = simulation.tear_report(film).unwrap();
                assert_eq!(report.begun > 0, tears, "{precision:?} {angle}: {report:?}");
                if tears {
                    let off = report.stress / stress - 1.0;
                    assert!(off.abs() < tolerance, "{report:?} {stress}");
                }
            }
            let skin = simulation.skin(film).unwrap();
            let size = |way: DVec3| {
                let own = skin.rest[mesh.points.len()..].iter().map(|x| x.dot(way));
                let most = own.clone().fold(f64::NEG_INFINITY, f64::max);
                most - own.fold(f64::INFINITY, f64::min)
            };
            let (aside, length) = (size(turn * DVec3::X), size(turn * DVec3::Y));
            assert!(aside < 0.1 * length && length > 0.5 * SIDE / 8.0, "{aside} {length}");
        }
    }
}

/// The stress at the end of a slit, averaged over a ball, is that of the film and not of its mesh.
#[test]
fn a_strength_means_the_same_on_all_meshes() {
    let mut found = Vec::new();
    for cells in [8, 12, 16] {
        let mesh = film(cells, 0.0);
        let description = body(&mesh, MembraneModel::Biquadratic);
        let (mut simulation, film) = alone(options(Precision::F64, 1), &description);
        simulation.set_gravity(DVec3::ZERO);
        let u: Vec<DVec3> = mesh.points.iter().map(|x| DVec3::X * 0.1 * x.x).collect();
        simulation.displace(film, &u);
        for side in ["x0", "x1"] {
            clamp(&mut simulation, film, &mesh, side);
        }
        let edge = |y: f64| [0.01, -0.01].map(|z| DVec3::new(0.0347, y, z));
        simulation.cut(film, &[edge(-0.01), edge(0.02)]).unwrap();
        simulation.settle();
        simulation.set_tear(tear_of(film, 1e9, Some(0.012))).unwrap();
        simulation.step().unwrap();
        found.push(simulation.tear_report(film).unwrap().stress);
    }
    let most = found.iter().copied().fold(0.0, f64::max);
    let least = found.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(least > 1e4 && most / least < 1.12, "{found:?}");
}

/// A notched film is drawn apart until it tears across: force rises, then goes; and again from a snapshot.
#[test]
fn a_notched_film_tears_in_two() {
    let mesh = film(12, 0.0);
    let make = |threads: usize| {
        let description = body(&mesh, MembraneModel::CompressibleBiquadratic);
        let (mut simulation, film) = alone(options(Precision::F64, threads), &description);
        simulation.set_gravity(DVec3::ZERO);
        clamp(&mut simulation, film, &mesh, "x0");
        let rows = simulation.group_rows(film, &mesh, "x1").unwrap();
        let motion = Motion::Translate(DVec3::X * 0.5 * SIDE);
        let pull = Constraint::moving("pull", rows, motion, Curve::ramp(0.0, 1.0));
        let pull = simulation.add_constraint(pull);
        // one linear solve leaves a tenth of what a step strains beside the side that moves
        simulation.set_solver(solver!(Integrator::Newton, mass_damping = 10.0));
        simulation.set_tear(tear_of(film, 3e4, None)).unwrap();
        (simulation, film, pull)
    };
    let (mut simulation, film, pull) = make(1);
    let edge = |y: f64| [0.01, -0.01].map(|z| DVec3::new(0.0312, y, z));
    simulation.cut(film, &[edge(-0.01), edge(0.02)]).unwrap();
    let (mut forces, mut taken) = (Vec::new(), None);
    for step in 0..100 {
        simulation.step().unwrap();
        forces.push(simulation.reaction(pull).unwrap().x.abs());
        let torn = simulation.tear_report(film).unwrap().separated;
        if torn > 4 && taken.is_none() {
            taken = Some((simulation.snapshot().unwrap(), step));
        }
    }
    let report = simulation.tear_report(film).unwrap();
    assert!(report.pieces == 2 && report.begun == 0 && report.separated > 12, "{report:?}");
    let most = forces.iter().copied().fold(0.0, f64::max);
    assert!(most > 0.2 && forces[99] < 0.02 * most, "{forces:?}");
    // from its notch to the other side, an element aside at most
    let skin = simulation.skin(film).unwrap();
    let made = &skin.rest[mesh.points.len()..];
    assert!(made.iter().all(|x| (x.x - 0.0312).abs() < 2.0 * SIDE / 12.0));
    let area = THICKNESS * (SIDE - 0.02);
    assert!((0.8..1.4).contains(&(report.area / area)), "{} {area}", report.area);
    let (snapshot, step) = taken.unwrap();
    let (mut other, _, _) = make(2);
    other.restore(&Snapshot::from_bytes(&snapshot.to_bytes()).unwrap()).unwrap();
    (step + 1..100).for_each(|_| other.step().unwrap());
    assert_eq!(simulation.state_hash(), other.state_hash());
}
