//! Needles: what it takes to puncture tissue, to go on, to stop and to come back, and what must hold meanwhile.

use crate::common::*;
use bevy_ecs::prelude::Entity;
use glam::{DQuat, DVec3};
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::prelude::*;
use sinew::snapshot::Snapshot;
use sinew::touch::tool::ToolReport;

const SIZE: DVec3 = DVec3::new(0.06, 0.06, 0.05);
/// Mean edge (m) of the block, roughly.
const EDGE: f64 = 0.01;
/// Beside the vertex in the middle of the upper side, so that it tells where the surface is.
const ABOVE: DVec3 = DVec3::new(0.0302, 0.0301, 0.051);

/// A block without weight whose bottom is held, and a needle above it that points down, in units and a place of one's own.
struct Biopsy {
    simulation: Simulation,
    body: BodyHandle,
    needle: Entity,
    unit: f64,
    place: fn(DVec3) -> DVec3,
    at: DVec3,
}

fn needle() -> Needle {
    Needle { into: -DVec3::Z, ..Needle::new(0.1, 1e-3, 200.0, 25.0) }
}

impl Biopsy {
    fn new(options: SimulationOptions) -> Self {
        Self::of(options, needle(), 1.0, |x| x)
    }

    fn of(options: SimulationOptions, needle: Needle, unit: f64, place: fn(DVec3) -> DVec3) -> Self {
        let mesh = box_tets(SIZE, [6, 6, 5]).unwrap();
        let mut mesh = jitter_interior(&mesh, 0.2, 5).unwrap();
        mesh.points.iter_mut().for_each(|x| *x = place(*x) / unit);
        if place(DVec3::X).cross(place(DVec3::Y)).dot(place(DVec3::Z)) < 0.0 {
            mesh.tetrahedra.iter_mut().for_each(|t| t.swap(0, 1));
        }
        let material = YoungPoisson {
            young_modulus: 1e4 * unit,
            poisson_ratio: 0.3,
            density: 1000.0 * unit.powi(3),
        };
        let block = BodyDescription::new("block", &mesh, material);
        let (mut simulation, body) = alone(options, &block);
        simulation.set_gravity(DVec3::ZERO);
        let floor = simulation.group_rows(body, &mesh, "z0").unwrap();
        simulation.add_constraint(Constraint::hold("floor", floor));
        simulation.integrate_by(Integrator::QuasiStatic);
        let way = |x: DVec3| (place(x) - place(DVec3::ZERO)) / unit;
        let needle = Needle {
            tip: DVec3::ZERO,
            into: way(needle.into),
            centre: needle.centre.map(|x| way(x - needle.tip)),
            length: needle.length / unit,
            diameter: needle.diameter / unit,
            toughness: needle.toughness,
            puncture: needle.puncture.map(|force| force / unit),
            friction: needle.friction,
        };
        let own = Tool::needle("needle", needle, place(ABOVE) / unit);
        let needle = simulation.add_tool(own).unwrap();
        simulation.step().unwrap();
        Self { simulation, body, needle, unit, place, at: ABOVE }
    }

    /// Moves the needle on by `way` (m) in so many steps.
    fn go(&mut self, way: DVec3, steps: u32, each: &mut dyn FnMut(&mut Self)) {
        let from = self.at;
        for i in 1..=steps {
            self.at = from + way * (f64::from(i) / f64::from(steps));
            let at = (self.place)(self.at) / self.unit;
            self.simulation.move_tool(self.needle, at).unwrap();
            self.simulation.step().unwrap();
            each(self);
        }
    }

    fn report(&self) -> ToolReport {
        self.simulation.tool_report(self.needle).unwrap().clone()
    }

    /// How far (m) its tip is under the surface beside it.
    fn depth(&self) -> f64 {
        let at = self.simulation.positions(self.body);
        let top = (0..at.len()).filter(|i| (at[*i] - DVec3::new(0.03, 0.03, at[*i].z)).length() < 3e-3);
        top.map(|i| at[i].z).fold(f64::NEG_INFINITY, f64::max) - self.at.z
    }
}

#[test]
fn trial() {
    let own = needle();
    for steps in [100, 400] {
        let mut biopsy = Biopsy::new(options(Precision::F64, 1));
        let mut i = 0;
        biopsy.go(DVec3::Z * -0.036, steps, &mut |b| {
            let r = b.report();
            i += 1;
            if i % (steps / 50) == 0 {
                let expected = own.cutting_force() + own.friction * b.depth();
                println!("{:.5} F {:.4} tip {:.4} shaft {:.4} L {:.5} depth {:.5} ratio {:.4} n {} {} it {:?}", b.at.z, r.force.z, r.tip_force, r.shaft_force, r.inserted, b.depth(), r.force.z/expected, r.punctures, b.simulation.needle_channel(b.needle).unwrap().len(), b.simulation.report().unconverged);
            }
        });
        biopsy.go(DVec3::ZERO, 10, &mut |_| ());
        println!("hold {:?}", biopsy.report().force.z);
        biopsy.go(DVec3::Z * 0.05, steps, &mut |b| {
            let r = b.report();
            i += 1;
            if i % (steps / 50) == 0 {
                let expected = -own.friction * b.depth();
                println!("{:.5} F {:.4} tip {:.4} shaft {:.4} L {:.5} depth {:.5} ratio {:.4} n {} {}", b.at.z, r.force.z, r.tip_force, r.shaft_force, r.inserted, b.depth(), r.force.z/expected, r.punctures, b.simulation.needle_channel(b.needle).unwrap().len());
            }
        });
    }
}
