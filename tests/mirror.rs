//! A scene that is mirrored, or whose vertices and elements are numbered otherwise, has the same result.

use crate::common::{max_distance, max_length, options, sheet, soft, solver};
use bevy_ecs::entity::Entity;
use glam::{DQuat, DVec3};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, quad_grid, triangle_grid};
use sinew::models::body::sheet::MembraneDescription;
use sinew::prelude::*;
use sinew::touch::tool::Points;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Tetrahedra,
    TenNodes,
    Hexahedra,
    Triangles,
    Quads,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    Nothing,
    /// x becomes -x, and elements are turned so that they stay in order.
    Mirror,
    /// Vertices and elements in another order.
    Numbers,
}

impl Change {
    fn of(self, x: DVec3) -> DVec3 {
        if self == Self::Mirror { x.with_x(-x.x) } else { x }
    }

    /// A changed mesh, and for each of its vertices the one that it was.
    fn mesh(self, mesh: &Mesh) -> (Mesh, Vec<usize>) {
        let mut changed = mesh.clone();
        changed.groups.clear();
        let n = mesh.points.len();
        let mut was: Vec<usize> = (0..n).collect();
        match self {
            Self::Nothing => {}
            Self::Mirror => {
                changed.points.iter_mut().for_each(|x| *x = self.of(*x));
                changed.tetrahedra.iter_mut().for_each(|t| t.swap(2, 3));
                for [_, bc, ac, ad, bd, _] in &mut changed.middles {
                    (*bc, *ac, *ad, *bd) = (*bd, *ad, *ac, *bc);
                }
                changed.hexahedra.iter_mut().for_each(|h| h.rotate_left(4));
                changed.triangles.iter_mut().for_each(|t| t.swap(1, 2));
                changed.quads.iter_mut().for_each(|q| q.swap(1, 3));
            }
            Self::Numbers => {
                shuffle(&mut was);
                let mut now = vec![0; n];
                was.iter().enumerate().for_each(|(i, &old)| now[old] = i as u32);
                changed.points = was.iter().map(|&old| mesh.points[old]).collect();
                let order = |v: &mut u32| *v = now[*v as usize];
                changed.tetrahedra.iter_mut().flatten().for_each(order);
                changed.middles.iter_mut().flatten().for_each(order);
                changed.hexahedra.iter_mut().flatten().for_each(order);
                changed.triangles.iter_mut().flatten().for_each(order);
                changed.quads.iter_mut().flatten().for_each(order);
                let mut cells: Vec<usize> = (0..changed.tetrahedra.len()).collect();
                shuffle(&mut cells);
                changed.tetrahedra = cells.iter().map(|&i| changed.tetrahedra[i]).collect();
                if mesh.is_second_order() {
                    changed.middles = cells.iter().map(|&i| changed.middles[i]).collect();
                }
                shuffle(&mut changed.hexahedra);
                shuffle(&mut changed.triangles);
                shuffle(&mut changed.quads);
            }
        }
        (changed, was)
    }
}

fn shuffle<T>(list: &mut [T]) {
    let mut state = 12345_u64;
    for i in (1..list.len()).rev() {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        list.swap(i, (state >> 33) as usize % (i + 1));
    }
}

/// A block or sheet with its middle at the origin of x and y and its top at 0.
fn mesh(kind: Kind, fine: usize) -> Mesh {
    let size = DVec3::new(0.06, 0.05, 0.02);
    let n = [4 * fine, 3 * fine, fine + 1];
    let mesh = match kind {
        Kind::Tetrahedra => box_tets(size, n),
        Kind::TenNodes => box_tets(size, [2 * fine, 2 * fine, fine]).map(|m| m.with_second_order()),
        Kind::Hexahedra => box_hexahedra(size, n),
        Kind::Triangles => triangle_grid(size.truncate(), [n[0], n[1]]),
        Kind::Quads => quad_grid(size.truncate(), [n[0], n[1]]),
    };
    let (mesh, flat) = (mesh.unwrap(), matches!(kind, Kind::Triangles | Kind::Quads));
    let top = if flat { 0.0 } else { size.z };
    mesh.transformed(1.0, DQuat::IDENTITY, -DVec3::new(0.5 * size.x, 0.5 * size.y, top))
}

struct Added {
    body: BodyHandle,
    /// Vertices of the mesh as it was.
    was: Vec<usize>,
}

/// Adds a body, changed, with what `holds` says held.
fn add(
    simulation: &mut Simulation,
    name: &str,
    mesh: &Mesh,
    change: Change,
    holds: impl Fn(DVec3) -> bool,
) -> (Added, Entity) {
    let (changed, was) = change.mesh(mesh);
    let quads = changed.quads.clone();
    let body = if changed.tetrahedra.is_empty() && changed.hexahedra.is_empty() {
        let membrane = MembraneDescription {
            quads: &quads,
            ..MembraneDescription::new(&changed.triangles, 2e-3, soft(2e4, 0.4))
        };
        BodyDescription { name, ..sheet(&changed.points, membrane) }
    } else {
        BodyDescription::new(name, &changed, soft(1e4, 0.4))
    };
    let body = simulation.add_body(&body).unwrap();
    let held: Vec<u32> =
        (0..changed.points.len() as u32).filter(|&v| holds(mesh.points[was[v as usize]])).collect();
    let rows = simulation.rows(body, name, &held).unwrap();
    let constraint = simulation.add_constraint(Constraint::hold(name, rows));
    (Added { body, was }, constraint)
}

/// Displacements of all bodies at all steps, changed back: something is pressed on a body, then drawn over it.
fn run(
    kind: Kind,
    tool: bool,
    friction: f64,
    change: Change,
    settings: &SolverSettings,
    aside: DVec3,
) -> Vec<DVec3> {
    let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
    simulation.set_solver(settings.clone());
    simulation.set_dt(0.01);
    simulation.set_gravity(DVec3::ZERO);
    let lower = mesh(kind, 1);
    let flat = matches!(kind, Kind::Triangles | Kind::Quads);
    let floor = |x: DVec3| {
        if flat { x.x.abs() > 0.0299 || x.y.abs() > 0.0249 } else { x.z < -0.0199 }
    };
    let (low, _) = add(&mut simulation, "lower", &lower, change, floor);
    let mut bodies = vec![low];
    let depth = if flat { 0.006 } else { 0.004 };
    let way = |k: u32| {
        let (down, along) = (f64::from(k.min(6)) / 6.0, f64::from(k.max(6) - 6) / 6.0);
        change.of(DVec3::new(0.004 * along, 0.001 * along, -depth * down))
    };
    let mut all = Vec::new();
    let ball = DVec3::new(0.0, 0.0, 0.0101) + aside;
    let moved = if tool {
        let ball = Tool::new("ball", Shape::Sphere { radius: 0.01 }, change.of(ball));
        let ball = ball.with_points(Points::Faces(2)).with_friction(friction);
        simulation.add_tool(ball).unwrap()
    } else {
        let mut upper = mesh(kind, 1).transformed(0.5, DQuat::IDENTITY, DVec3::ZERO);
        upper
            .points
            .iter_mut()
            .for_each(|x| *x += aside + DVec3::Z * if flat { 1e-4 } else { 0.0101 });
        let top = upper.points.iter().map(|x| x.z).fold(f64::MIN, f64::max);
        let (up, held) = add(&mut simulation, "upper", &upper, change, |x| x.z > top - 1e-6);
        let pair = BodyContact::new("pair", [bodies[0].body, up.body]).with_friction(friction);
        simulation.add_body_contact(pair);
        bodies.push(up);
        held
    };
    for step in 1..=12 {
        if tool {
            simulation.move_tool(moved, change.of(ball) + way(step)).unwrap();
        } else {
            simulation.set_target(moved, way(step)).unwrap();
        }
        simulation.step().unwrap();
        for own in &bodies {
            let u = simulation.displacements(own.body);
            let mut back = vec![DVec3::ZERO; u.len()];
            own.was.iter().zip(&u).for_each(|(&old, u)| back[old] = change.of(*u));
            all.extend(back);
        }
    }
    all
}

/// Largest differences of a changed scene from the scene as it is, over the largest displacement: mirrored, and renumbered.
fn off(kind: Kind, tool: bool, friction: f64, settings: &SolverSettings, aside: DVec3) -> [f64; 2] {
    let straight = run(kind, tool, friction, Change::Nothing, settings, aside);
    [Change::Mirror, Change::Numbers].map(|change| {
        let other = run(kind, tool, friction, change, settings, aside);
        max_distance(&straight, &other) / max_length(&straight)
    })
}

/// Beside the middle of things, so that no vertex lies on an edge of what it touches.
const ASIDE: DVec3 = DVec3::new(0.0013, 0.0007, 0.0);
const KINDS: [Kind; 5] =
    [Kind::Tetrahedra, Kind::TenNodes, Kind::Hexahedra, Kind::Triangles, Kind::Quads];

/// Steps whose contact is found to 1e-8 of its force where its rounds allow.
fn tight() -> SolverSettings {
    solver!(Integrator::Safe, linear_tolerance = 1e-9)
}

#[test]
fn under_tools_mirrors_and_numbers_do_not_matter() {
    for kind in KINDS {
        for (friction, aside) in
            [(0.0, DVec3::ZERO), (0.0, ASIDE), (0.3, DVec3::ZERO), (0.3, ASIDE)]
        {
            let found = off(kind, true, friction, &tight(), aside);
            assert!(found.iter().all(|off| *off < 1e-6), "{kind:?} {friction} {aside}: {found:?}");
        }
    }
}

/// Not ten-node tetrahedra on each other: in the furrows between their faces the scene has several outcomes, up to a fifth of the
/// displacement apart, and rounding chooses (another preconditioner is enough).
const WITH_ONE_OUTCOME: [Kind; 4] =
    [Kind::Tetrahedra, Kind::Hexahedra, Kind::Triangles, Kind::Quads];

/// What mirrors and numbers change between bodies is what is left when the inner loop ends: at the default tolerance 3e-3
/// of the displacement of hexahedra. The tangents leave
/// out how normals turn, so every round leaves a part of up to nine tenths: a hundred times what it changes may be left.
#[test]
#[ignore = "slow"]
fn between_bodies_mirrors_and_numbers_matter_as_the_tolerance_does() {
    for kind in WITH_ONE_OUTCOME {
        let found = off(kind, false, 0.0, &tight(), ASIDE);
        assert!(found.iter().all(|off| *off < 1e-5), "{kind:?}: {found:?}");
    }
}

/// With friction, too, what is left shrinks with the tolerance. Not tetrahedra whose vertices meet edges: there the scene has
/// two outcomes, 1.2 % of the displacement apart at any tolerance, and rounding chooses.
#[test]
#[ignore = "slow"]
fn friction_between_bodies_shrinks_what_mirrors_and_numbers_change_with_the_tolerance() {
    for kind in WITH_ONE_OUTCOME {
        for aside in [DVec3::ZERO, ASIDE] {
            if kind == Kind::Tetrahedra && aside == DVec3::ZERO {
                continue;
            }
            let found = off(kind, false, 0.3, &tight(), aside);
            assert!(found.iter().all(|off| *off < 2e-4), "{kind:?} {aside}: {found:?}");
        }
    }
}
