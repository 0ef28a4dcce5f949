//! Forces of two bodies on each other against what they have to be: uniform pressure, limits of friction, other stiffnesses and
//! number types, edges that pass over edges.

use crate::common::{max_length, soft, solver};
use bevy_ecs::entity::Entity;
use glam::{DQuat, DVec3};
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::engine::mesh::{Mesh, MeshError};
use sinew::engine::precision::Precision;
use sinew::engine::vertex::FixedAxes;
use sinew::prelude::*;
use sinew::touch::pair::BodyContactReport;
use sinew::touch::tool::Stiffness;

/// A block on another one, of the same material; a hand holds the upper side of the upper one.
struct Blocks {
    simulation: Simulation,
    meshes: [Mesh; 2],
    bodies: [BodyHandle; 2],
    pair: Entity,
    hand: Entity,
}

/// The mesh of a block.
type Boxes = fn(DVec3, [usize; 3]) -> Result<Mesh, MeshError>;

/// How the blocks are made and held.
#[derive(Clone)]
struct Setup {
    size: DVec3,
    cells: [[usize; 3]; 2],
    /// Of the upper block, from where it would stand on the lower one.
    shift: DVec3,
    young: f64,
    poisson: f64,
    friction: f64,
    stiffness: f64,
    precision: Precision,
    boxes: Boxes,
    /// Axes that outer sides are held along.
    axes: FixedAxes,
}

/// Blocks of the study that chose the law: as soft as tissue, shifted so that no vertex lies on a vertex.
fn study() -> Setup {
    Setup {
        size: DVec3::new(0.1, 0.1, 0.05),
        cells: [[8, 8, 4]; 2],
        shift: DVec3::new(0.003, 0.002, 0.0),
        young: 5e3,
        poisson: 0.45,
        friction: 0.0,
        stiffness: 20.0,
        precision: Precision::F64,
        boxes: box_tets,
        axes: FixedAxes::ALL,
    }
}

impl Blocks {
    fn new(setup: &Setup) -> Self {
        let options =
            SimulationOptions { threads: 1, precision: setup.precision, ..Default::default() };
        let mut simulation = Simulation::new(options).unwrap();
        simulation.set_gravity(DVec3::ZERO);
        let [lower, upper] = setup.cells.map(|cells| (setup.boxes)(setup.size, cells).unwrap());
        let shift = setup.shift + DVec3::Z * setup.size.z;
        let upper = upper.transformed(1.0, DQuat::IDENTITY, shift);
        let material = soft(setup.young, setup.poisson);
        let mut add = |name, mesh: &Mesh, side, hold: &str| {
            let body = simulation.add_body(&BodyDescription::new(name, mesh, material)).unwrap();
            let rows = simulation.group_rows(body, mesh, side).unwrap();
            let hold = Constraint { axes: setup.axes, ..Constraint::hold(hold, rows) };
            (body, simulation.add_constraint(hold))
        };
        let (below, _) = add("lower", &lower, "z0", "floor");
        let (above, hand) = add("upper", &upper, "z1", "hand");
        let bodies = [below, above];
        let pair = BodyContact {
            stiffness: Stiffness::Relative(setup.stiffness),
            ..BodyContact::new("pair", bodies).with_friction(setup.friction)
        };
        let pair = simulation.add_body_contact(pair);
        Self { simulation, meshes: [lower, upper], bodies, pair, hand }
    }

    fn report(&self) -> BodyContactReport {
        *self.simulation.body_contact_report(self.pair).unwrap()
    }

    /// Takes the hand there (m from its start) within so many steps, from `from`.
    fn lead(&mut self, from: DVec3, to: DVec3, steps: u32, mut each: impl FnMut(&Self)) {
        for step in 1..=steps {
            let at = from.lerp(to, f64::from(step) / f64::from(steps));
            self.simulation.set_target(self.hand, at).unwrap();
            self.simulation.step().unwrap();
            each(self);
        }
    }

    /// Presses by 4 mm in 0.1 s, and waits until all is still.
    fn press(&mut self) -> BodyContactReport {
        self.simulation.set_solver(solver!(Integrator::Safe, mass_damping = 20.0));
        let down = DVec3::NEG_Z * 0.004;
        self.lead(DVec3::ZERO, down, 10, |_| {});
        self.lead(down, down, 90, |_| {});
        self.report()
    }
}

/// Blocks that are pressed together evenly, free to widen, are strained evenly whatever their meshes. Vertices of one mesh sink into
/// the faces of the other by turns, by 2.3 % of the pressure in the study. Looked at two edges from the rim,
/// where vertices have faces beside them as well as below.
#[test]
fn meshes_that_do_not_match_pass_an_even_pressure_on() {
    for boxes in [box_tets as Boxes, box_hexahedra] {
        let setup = Setup {
            size: DVec3::new(0.06, 0.06, 0.02),
            cells: [[12, 12, 4], [13, 11, 4]],
            shift: DVec3::ZERO,
            young: 1e4,
            poisson: 0.3,
            axes: FixedAxes(4),
            boxes,
            ..study()
        };
        let mut blocks = Blocks::new(&setup);
        blocks.simulation.set_solver(solver!(Integrator::Safe, mass_damping = 20.0));
        let down = DVec3::NEG_Z * 0.0004;
        blocks.lead(DVec3::ZERO, down, 5, |_| {});
        blocks.lead(down, down, 60, |_| {});
        let expected = setup.young * 0.0004 / (2.0 * setup.size.z);
        for (body, mesh) in blocks.bodies.into_iter().zip(&blocks.meshes) {
            let pressures = blocks.simulation.contact_pressures(body);
            let inside = |x: &DVec3| x.x.min(x.y) > 0.011 && x.x.max(x.y) < 0.049;
            let inner = |x: &DVec3| (x.z - setup.size.z).abs() < 1e-9 && inside(x);
            let own = mesh.points.iter().zip(pressures).filter(|(x, _)| inner(x));
            let own: Vec<f64> = own.map(|(_, p)| p).collect();
            let mean = own.iter().sum::<f64>() / own.len() as f64;
            let rms = own.iter().map(|p| (p / mean - 1.0).powi(2)).sum::<f64>() / own.len() as f64;
            assert!(own.len() > 40 && rms.sqrt() < 0.025, "{}: {own:?}", rms.sqrt());
            // a column of this strain, less what the rims, with faces beside them, leave out: a sixth of the area at most
            assert!((0.84..1.02).contains(&(mean / expected)), "{mean} Pa, {expected} expected");
        }
    }
}

#[test]
fn twice_the_stiffness_changes_the_force_by_less_than_a_hundredth() {
    let force = |stiffness| Blocks::new(&Setup { stiffness, ..study() }).press().force.length();
    let (once, twice) = (force(20.0), force(40.0));
    assert!((twice / once - 1.0).abs() < 0.01, "{once} {twice}");
}

#[test]
fn single_precision_finds_the_force_of_double_precision() {
    for friction in [0.0, 0.3] {
        let force =
            |precision| Blocks::new(&Setup { precision, friction, ..study() }).press().force;
        let (double, single) = (force(Precision::F64), force(Precision::F32));
        assert!(double.distance(single) < 1e-4 * double.length(), "{double} {single}");
    }
}

/// Blocks a thousand times as stiff as what presses them stay plane: what slides there holds with its limit.
#[test]
fn what_slides_on_a_plane_is_held_by_its_limit() {
    for friction in [0.1, 0.3] {
        let setup = Setup {
            size: DVec3::new(0.06, 0.06, 0.02),
            cells: [[6, 6, 2], [5, 5, 2]],
            shift: DVec3::new(0.003, 0.002, 0.0),
            young: 1e6,
            poisson: 0.3,
            friction,
            ..study()
        };
        let mut blocks = Blocks::new(&setup);
        let down = DVec3::NEG_Z * 2e-6;
        blocks.lead(DVec3::ZERO, down, 5, |_| {});
        blocks.lead(down, down + DVec3::X * 0.004, 20, |_| {});
        let BodyContactReport { force, sticking, slipping, .. } = blocks.report();
        let ratio = force.truncate().length() / force.z.abs();
        assert!(sticking == 0 && slipping > 20, "{sticking} stick, {slipping} slip");
        assert!((ratio / friction - 1.0).abs() < 1e-3, "{ratio} for {friction}");
    }
}

/// Edges of a block pass over those of another: off a parabola through it the largest force is above the least by a hundredth, with
/// friction by a hundredth and a half.
#[test]
fn edges_that_pass_over_edges_are_hardly_felt() {
    for (friction, within) in [(0.0, 0.01), (0.3, 0.015)] {
        let mut blocks = Blocks::new(&Setup { friction, ..study() });
        blocks.press();
        let (down, mut forces) = (DVec3::NEG_Z * 0.004, Vec::new());
        let along = DVec3::X * 0.026;
        blocks.lead(down, down + along, 52, |b| forces.push(b.report().force.z.abs()));
        // past the start, where friction builds up and the rims settle
        let forces = &forces[12..];
        let off = off_parabola(forces);
        let ripple = off.iter().fold(0.0, |most: f64, x| most.max(*x))
            - off.iter().fold(0.0, |least: f64, x| least.min(*x));
        let mean = forces.iter().sum::<f64>() / forces.len() as f64;
        assert!(ripple < within * mean, "friction {friction}: {} of {mean} N", ripple / mean);
        assert!(max_length(&blocks.simulation.velocities(blocks.bodies[0])) < 0.2);
    }
}

/// What numbers at even distances differ by from the parabola nearest to them.
fn off_parabola(y: &[f64]) -> Vec<f64> {
    let n = y.len();
    let t = |i: usize| 2.0 * i as f64 / (n - 1) as f64 - 1.0;
    // polynomials orthogonal on these places
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut left = y.to_vec();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for degree in 0..3 {
        let mut own: Vec<f64> = (0..n).map(|i| t(i).powi(degree)).collect();
        for known in &basis {
            let part = dot(&own, known) / dot(known, known);
            own.iter_mut().zip(known).for_each(|(own, known)| *own -= part * known);
        }
        let part = dot(&left, &own) / dot(&own, &own);
        left.iter_mut().zip(&own).for_each(|(left, own)| *left -= part * own);
        basis.push(own);
    }
    left
}
