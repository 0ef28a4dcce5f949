//! What moves by a hand or falls: blades, a loose piece, a needle.

use super::super::compare::worst;
use super::*;
use bevy_ecs::prelude::Entity;
use sinew::engine::load::Pressure;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::engine::vertex::{Displacement, Mass, RestPosition, Velocity};
use sinew::touch::edge::EdgeState;
use sinew::touch::tool::ToolReport;

const SIDE: f64 = 0.06;

fn tissue(young_modulus: f64) -> YoungPoisson {
    YoungPoisson { young_modulus, poisson_ratio: 0.3, density: 1000.0 }
}

fn block(cells: usize) -> Outcome<Mesh> {
    Ok(jitter_interior(&box_tets(DVec3::splat(SIDE), [cells; 3])?, 0.2, 5)?)
}

/// A block and a blade beside it, whose edge stands upright and reaches down to a height; it cuts along y.
struct Stroke {
    simulation: Simulation,
    body: BodyHandle,
    blade: Entity,
    at: DVec3,
}

impl Stroke {
    /// The blade is there one step after this.
    fn new(threads: usize, mesh: &Mesh, young: f64, toughness: f64, low: f64) -> Outcome<Self> {
        let (mut simulation, body) =
            alone(threads, &cuttable(mesh, tissue(young), Model::default()))?;
        let ends = [DVec3::Z * 0.02, DVec3::Z * -0.02];
        let edge = Edge { ends, into: DVec3::Y, toughness, travel: DVec3::ZERO };
        let at = DVec3::new(0.031, -0.005, low + 0.02);
        let blade = simulation.add_tool(Tool::blade("scalpel", edge, at))?;
        Ok(Self { simulation, body, blade, at })
    }

    fn report(&self) -> Outcome<ToolReport> {
        Ok(self.simulation.tool_report(self.blade).ok_or("the blade is gone")?.clone())
    }

    /// Moves the blade on along y in so many steps.
    fn draw(
        &mut self,
        way: f64,
        steps: u32,
        each: &mut dyn FnMut(&mut Self) -> Outcome,
    ) -> Outcome {
        let from = self.at;
        for i in 1..=steps {
            self.at = from + DVec3::Y * (way * f64::from(i) / f64::from(steps));
            self.simulation.move_tool(self.blade, self.at)?;
            self.simulation.step()?;
            each(self)?;
        }
        Ok(())
    }

    /// Number of tetrahedra and copies inside out that have more than 1e-3 of a whole one.
    fn inverted(&mut self) -> f64 {
        let world = self.simulation.world_mut();
        let mut query = world.query::<(&RestPosition, &Displacement<f64>)>();
        let places: Vec<_> = query.iter(world).map(|(x, u)| (x.0, x.0 + u.get())).collect();
        let body = &self.simulation.topology().bodies[self.body.0];
        let volume = |[a, b, c, d]: [DVec3; 4]| (b - a).cross(c - a).dot(d - a);
        let out = |(corners, portion): &(&[u32; 4], &[f64; 4])| {
            let [rest, now] = [0, 1].map(|i| {
                volume(corners.map(|row| [places[row as usize].0, places[row as usize].1][i]))
            });
            portion.iter().sum::<f64>() > 1e-3 && now * rest <= 0.0
        };
        body.tetrahedra().iter().zip(&body.copies.portions).filter(out).count() as f64
    }

    /// Length (m) of the edge in tissue.
    fn inside(&self) -> f64 {
        let state = self.simulation.world().get::<EdgeState>(self.blade);
        state.map_or(f64::NAN, |state| state.points.iter().map(|point| point.width).sum())
    }
}

/// Criterion 5: a blade without force through a block that is drawn apart across it, in steps of several lengths.
pub(super) fn without_force(rows: &mut CutRows, _: &CaseEntry) {
    let threads = rows.threads();
    for stretch in [0.15, 0.6] {
        rows.add(&format!("stretched by {:.0} %", 100.0 * stretch), |row| {
            let mesh = block(5)?;
            (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
            let mut ends: Vec<(f64, Vec<DVec3>)> = Vec::new();
            let (mut rise, mut inverted) = (f64::NEG_INFINITY, 0.0_f64);
            for dt in [0.001, 0.002, 0.005, 0.01, 0.02, 0.033] {
                let mut stroke = Stroke::new(threads, &mesh, 1e4, 0.0, 0.035)?;
                for (side, sign) in [("x0", -0.5), ("x1", 0.5)] {
                    let s = &mut stroke.simulation;
                    let group = s.group_rows(stroke.body, &mesh, side)?;
                    let motion = Motion::Translate(DVec3::X * (sign * stretch * SIDE));
                    s.add_constraint(Constraint::moving(
                        side,
                        group,
                        motion,
                        Curve::ramp(0.0, 0.3),
                    ));
                }
                let settings = SolverSettings { mass_damping: 20.0, ..moved_by(Integrator::Safe) };
                stroke.simulation.set_solver(settings.clone());
                // one state for all
                stroke.simulation.set_dt(0.01);
                for _ in 0..200 {
                    stroke.simulation.step()?;
                }
                stroke.simulation.set_solver(moved_by(Integrator::Safe));
                stroke.simulation.set_dt(dt);
                let mut before = f64::INFINITY;
                let mut watch = |stroke: &mut Stroke| {
                    let report = stroke.simulation.report();
                    let now = report.elastic_energy + report.kinetic_energy;
                    rise = if before.is_finite() { worst(rise, now / before - 1.0) } else { rise };
                    before = now;
                    inverted = inverted.max(stroke.inverted());
                    Ok(())
                };
                stroke.draw(0.045, (1.0 / dt).round() as u32, &mut watch)?;
                stroke.simulation.set_solver(settings);
                for _ in 0..(1.0 / dt).round() as u32 {
                    stroke.simulation.step()?;
                    watch(&mut stroke)?;
                }
                let energy = stroke.simulation.report().elastic_energy;
                ends.push((energy, stroke.simulation.displacements(stroke.body)));
            }
            let (energy, truth) = ends[3].clone();
            let largest = truth.iter().map(|u| u.length()).fold(0.0, f64::max);
            let off =
                |u: &[DVec3]| u.iter().zip(&truth).map(|(a, b)| a.distance(*b)).fold(0.0, worst);
            row.at_most("rise of energy in a step", rise, 1e-9);
            let energies = ends.iter().map(|end| (end.0 / energy - 1.0).abs()).fold(0.0, worst);
            row.at_most("energies at the end", energies, 1e-3);
            let places = ends.iter().map(|end| off(&end.1) / largest).fold(0.0, worst);
            row.at_most("places at the end", places, 1e-3);
            row.at_most("shares above 1e-3 inside out", inverted, 0.0);
            Ok(())
        });
    }
}

/// Criterion 11: force and work of a blade that goes on steadily.
pub(super) fn steady(rows: &mut CutRows, _: &CaseEntry) {
    let threads = rows.threads();
    rows.add("steady stroke", |row| {
        let (mesh, toughness) = (block(6)?, 50.0);
        (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
        let mut stroke = Stroke::new(threads, &mesh, 1e4, toughness, 0.035)?;
        hold(&mut stroke.simulation, stroke.body, &mesh, "z0")?;
        stroke.simulation.step()?;
        let mut steady: Vec<[f64; 4]> = Vec::new();
        stroke.draw(0.045, 180, &mut |stroke| {
            let report = stroke.report()?;
            let share = -report.force.y / (toughness * stroke.inside());
            if report.position.y > 0.02 {
                let stored = stroke.simulation.report().elastic_energy + report.energy;
                steady.push([share, report.work, toughness * report.cut_area, stored]);
            }
            Ok(())
        })?;
        let mut shares: Vec<f64> = steady.iter().map(|own| own[0]).collect();
        shares.sort_by(f64::total_cmp);
        let change = [1, 2, 3].map(|i| steady[steady.len() - 1][i] - steady[0][i]);
        let left = (change[0] - change[1] - change[2]) / change[0];
        row.within(
            "median force over toughness times length",
            shares[shares.len() / 2],
            [0.99, 1.01],
        );
        row.within("work that is left over all work", left, [0.0, 0.04]);
        Ok(())
    });
}

/// Criterion 11: force, power and work of a blade, `force` of a separate program, which has tissue that does not yield.
pub(super) fn force(rows: &mut CutRows) {
    let (root, threads) = (rows.case.root(), rows.threads());
    let cases = root.get("cases");
    let truth = |i: usize, key: &str| cases.at(i).get(key).number();
    let ready = |low: f64| -> Outcome<Stroke> {
        let mesh = block(6)?;
        let toughness = root.get("toughness").number()?;
        let mut stroke = Stroke::new(threads, &mesh, 1e7, toughness, low)?;
        hold(&mut stroke.simulation, stroke.body, &mesh, "z0")?;
        stroke.simulation.step()?;
        Ok(stroke)
    };
    rows.add("force and power", |row| {
        let mut stroke = ready(SIDE - truth(0, "blade_in_tissue")?)?;
        let speed = truth(0, "speed")?;
        let dt = 0.03 / 120.0 / speed;
        stroke.simulation.set_dt(dt);
        let (mut forces, mut work) = (Vec::new(), Vec::new());
        stroke.draw(0.03, 120, &mut |stroke| {
            let report = stroke.report()?;
            if report.position.y > 0.01 {
                forces.push(-report.force.y);
                work.push(report.work);
            }
            Ok(())
        })?;
        let power = (work[work.len() - 1] - work[0]) / (dt * (work.len() - 1) as f64);
        forces.sort_by(f64::total_cmp);
        let force = forces[forces.len() / 2];
        row.at_most("median force", (force / truth(0, "force")? - 1.0).abs(), 1e-3);
        row.at_most("mean power", (power / truth(0, "power")? - 1.0).abs(), 1e-3);
        Ok(())
    });
    rows.add("area and work", |row| {
        let mut stroke = ready(SIDE - truth(1, "depth")?)?;
        stroke.draw(truth(1, "advance")? + 0.01, 280, &mut |_| Ok(()))?;
        let report = stroke.report()?;
        row.at_most("area", (report.cut_area / truth(1, "area")? - 1.0).abs(), 1e-3);
        row.at_most("work of fracture", (report.fracture / truth(1, "work")? - 1.0).abs(), 1e-3);
        Ok(())
    });
}

/// Criterion 15: the loose piece of a block whose other side is held falls freely: no ghost of it is held or loaded.
pub(super) fn loose_piece(rows: &mut CutRows, _: &CaseEntry) {
    let threads = rows.threads();
    rows.add("falls freely", |row| {
        let mesh = block(4)?;
        (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
        let model = Model::CompressibleStVK;
        let (mut simulation, body) = alone(threads, &cuttable(&mesh, tissue(1e4), model))?;
        let where_x = |is: &dyn Fn(f64) -> bool| {
            let all = (0..).zip(&mesh.points).filter(|(_, x)| is(x.x));
            all.map(|(v, _)| v).collect::<Vec<u32>>()
        };
        // held are even vertices whose elements are cut
        let held = where_x(&|x| x < 0.031);
        let group = simulation.rows(body, "held", &held)?;
        simulation.add_constraint(Constraint::hold("held", group));
        simulation.set_gravity(DVec3::Z * -9.81);
        let edge = |y: f64| [DVec3::new(0.036, y, 0.08), DVec3::new(0.034, y, -0.02)];
        let report = simulation.cut(body, &[edge(-0.02), edge(0.08)])?;
        row.at_most("pieces but two", report.pieces.abs_diff(2) as f64, 0.0);
        let settings = SolverSettings { linear_tolerance: 1e-13, ..moved_by(Integrator::Safe) };
        simulation.set_solver(settings);
        for _ in 0..20 {
            simulation.step()?;
        }
        let (u, time) = (simulation.displacements(body), simulation.time());
        // as far as implicit Euler falls in steps of 10 ms
        let fallen = DVec3::Z * (-0.5 * 9.81 * time * (time + 0.01));
        let off = |v: u32| u[v as usize].distance(fallen) / fallen.length();
        let loose = where_x(&|x| x > 0.046);
        row.at_most("way of the piece", loose.into_iter().map(off).fold(0.0, worst), 1e-9);
        let moved = held.iter().map(|&v| u[v as usize].length()).fold(0.0, worst);
        row.at_most("way of what is held", moved, 0.0);
        Ok(())
    });
    rows.add("pressure", |row| {
        let mesh = block(4)?;
        (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
        let model = Model::CompressibleStVK;
        let (mut simulation, body) = alone(threads, &cuttable(&mesh, tissue(1e4), model))?;
        let is_top = |t: &[u32; 3]| t.iter().all(|&v| mesh.points[v as usize].z > SIDE - 1e-9);
        let top: Vec<[u32; 3]> = mesh.surface_triangles().into_iter().filter(is_top).collect();
        let (faces, pressure) = (simulation.face_rows(body, "top", &top)?, 100.0);
        let (name, curve) = ("top".into(), Curve::Constant);
        simulation.add_pressure(Pressure { name, faces, pressure, curve });
        let edge = |y: f64| [DVec3::new(0.036, y, 0.08), DVec3::new(0.034, y, -0.02)];
        let report = simulation.cut(body, &[edge(-0.02), edge(0.08)])?;
        row.at_most("pieces but two", report.pieces.abs_diff(2) as f64, 0.0);
        simulation.set_solver(moved_by(Integrator::SymplecticEuler));
        simulation.set_dt(1e-6);
        simulation.step()?;
        // the momentum of a piece is what its part of the faces got
        let mut momentum = [DVec3::ZERO; 2];
        let rows = simulation.topology().bodies[0].clone();
        let mut query = simulation.world_mut().query::<(&Mass<f64>, &Velocity<f64>)>();
        for (local, (mass, v)) in query.iter(simulation.world()).enumerate() {
            if let Some(own) = momentum.get_mut(rows.piece[local] as usize) {
                *own += mass.0 * v.get();
            }
        }
        momentum.sort_by(|a, b| a.z.total_cmp(&b.z));
        // the cut is at 35.6 mm there
        let off = [SIDE - 0.0356, 0.0356].into_iter().zip(momentum).map(|(width, own)| {
            let truth = DVec3::Z * (pressure * SIDE * width * 1e-6);
            own.distance(truth) / truth.length()
        });
        row.at_most("resultant on either piece", off.fold(0.0, worst), 1e-12);
        Ok(())
    });
}

/// Criterion 21: a needle goes in, stops, and comes back.
pub(super) fn needle(rows: &mut CutRows, _: &CaseEntry) {
    let threads = rows.threads();
    for (moves, enough) in [(100, 0.02), (400, 0.005)] {
        rows.add(&format!("{moves} moves"), |row| {
            let (size, edge) = (DVec3::new(SIDE, SIDE, 0.05), 0.01);
            let mesh = jitter_interior(&box_tets(size, [6, 6, 5])?, 0.2, 5)?;
            (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
            let (mut simulation, body) =
                alone(threads, &BodyDescription::new("block", &mesh, tissue(1e4)))?;
            hold(&mut simulation, body, &mesh, "z0")?;
            simulation.set_solver(moved_by(Integrator::QuasiStatic));
            let own = Needle { into: -DVec3::Z, ..Needle::new(0.1, 1e-3, 200.0, 25.0) };
            let (cutting, puncture) = (own.cutting_force(), own.puncture_force());
            let mut at = DVec3::new(0.0302, 0.0301, 0.051);
            let needle = simulation.add_tool(Tool::needle("needle", own, at))?;
            simulation.step()?;
            // moves the needle, steps, and says what it feels and how far it is below the surface beside it
            let mut go = |simulation: &mut Simulation, way: f64| -> Outcome<(ToolReport, f64)> {
                at.z += way;
                simulation.move_tool(needle, at)?;
                simulation.step()?;
                let report = simulation.tool_report(needle).ok_or("the needle is gone")?.clone();
                let places = simulation.positions(body);
                let near = places
                    .iter()
                    .filter(|x| x.truncate().distance(DVec3::splat(0.03).truncate()) < 3e-3);
                let top = near.map(|x| x.z).fold(f64::NEG_INFINITY, f64::max);
                Ok((report, top - at.z))
            };
            let (mut dent, mut way, mut steady) = (0.0_f64, 0.0, 0.0_f64);
            for _ in 0..moves {
                let down = 0.036 / f64::from(moves);
                let (report, depth) = go(&mut simulation, -down)?;
                way = if report.punctures > 0 { way + down } else { 0.0 };
                if report.punctures == 0 {
                    dent = dent.max(report.force.z);
                } else if way > 0.5 * edge + down {
                    // what had been dented has come back along the shaft, and all of the channel slips
                    let share = report.force.z / (cutting + own.friction * depth);
                    steady = worst(steady, (share - 1.0).abs());
                }
            }
            row.within("force before it punctures over the limit", dent / puncture, [0.9, 1.0]);
            row.at_most("force of going on", steady, enough);
            simulation.set_dt(1.0);
            // what the last move parted is known in the step after it
            go(&mut simulation, 0.0)?;
            let before = simulation.positions(body);
            for _ in 0..10 {
                go(&mut simulation, 0.0)?;
            }
            let after = simulation.positions(body);
            let creep =
                before.iter().zip(&after).map(|(a, b)| a.distance(*b) / edge).fold(0.0, worst);
            row.at_most("creep in 10 s over an edge", creep, 1e-3);
            // the tissue goes along until the channel gives way
            for _ in 0..moves {
                go(&mut simulation, 0.02 / f64::from(moves))?;
            }
            let mut back = 0.0_f64;
            for _ in 0..moves / 4 {
                let (report, depth) = go(&mut simulation, 0.02 / f64::from(moves))?;
                back = worst(back, (report.force.z / (-own.friction * depth) - 1.0).abs());
                back = if report.tip_force == 0.0 { back } else { f64::INFINITY };
            }
            row.at_most("force of drawing back", back, 0.01);
            for _ in 0..moves {
                go(&mut simulation, 0.02 / f64::from(moves))?;
            }
            let left = go(&mut simulation, 0.0)?.0;
            row.at_most("force once it is out (N)", left.force.length() + left.inserted, 0.0);
            Ok(())
        });
    }
}
