//! Wounds that are drawn open: where they lie, how far they open, what they cost the solver, when they tear on, and what
//! closes them.

use super::super::compare::worst;
use super::*;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::engine::vertex::{Displacement, ExternalForce};
use sinew::models::body::VolumeRule;
use std::f64::consts::PI;

/// A block that is cut from above to a height, held at one side and pulled at others, in linear elasticity.
struct Opened {
    size: DVec3,
    held: &'static str,
    loads: &'static [(&'static str, DVec3)],
    /// Surface of the blade: x at y and z.
    x: fn(f64, f64) -> f64,
    /// Height down to which it cuts.
    low: f64,
}

const CUBE: Opened = Opened {
    size: DVec3::ONE,
    held: "z0",
    loads: &[("x0", DVec3::NEG_X), ("x1", DVec3::X)],
    x: |y, z| 0.5 + 0.15 * (z - 0.5) + 0.12 * (y - 0.5) + 0.08 * libm::sin(PI * y),
    low: 0.4,
};

const BEAM: Opened = Opened {
    size: DVec3::new(3.0, 1.0, 1.0),
    held: "x0",
    loads: &[("x1", DVec3::NEG_Z)],
    x: |y, z| 1.0 + 0.35 * (z - 0.5) + 0.2 * (y - 0.5),
    low: 0.45,
};

/// Load (Pa) where Young's modulus is 1: strains for which elasticity is linear.
const LOAD: f64 = 1e-4;
const SEEDS: [u64; 3] = [1, 2, 3];
/// Cells along the edge of the cube whose notch tears.
const CELLS: [usize; 5] = [8, 10, 12, 14, 16];

impl Opened {
    /// Positions of the blade, in lengths of so many metres.
    fn strip(&self, low: f64, unit: f64) -> Vec<[DVec3; 2]> {
        let edge = |y: f64| [1.05, low].map(|z| unit * DVec3::new((self.x)(y, z), y, z));
        (0..=24).map(|i| edge(-0.05 + 1.1 * f64::from(i) / 24.0)).collect()
    }

    /// A mesh of so many cells in a unit of length.
    fn mesh(&self, cells: usize, seed: u64) -> Outcome<Mesh> {
        let cells = self.size.to_array().map(|side| side as usize * cells);
        Ok(jitter_interior(&box_tets(self.size, cells)?, 0.2, seed)?)
    }

    /// Cut and loaded, with the solver of equilibria.
    fn stand(&self, threads: usize, mesh: &Mesh) -> Outcome<(Simulation, BodyHandle)> {
        let material = YoungPoisson { young_modulus: 1.0, poisson_ratio: 0.3, density: 1.0 };
        // that of ten nodes, whose law is not linear, at strains where it is
        let model = if mesh.is_second_order() { Model::StVK } else { Model::Linear };
        let (mut simulation, body) = alone(threads, &cuttable(mesh, material, model))?;
        hold(&mut simulation, body, mesh, self.held)?;
        simulation.cut(body, &self.strip(self.low, 1.0))?;
        for (side, way) in self.loads {
            pull(&mut simulation, body, side_of(mesh, side)?, *way * LOAD)?;
        }
        simulation.set_solver(SolverSettings {
            linear_tolerance: 1e-8,
            newton_tolerance: 1e-7,
            ..moved_by(Integrator::QuasiStatic)
        });
        Ok((simulation, body))
    }
}

/// Triangles of a named side.
fn side_of(mesh: &Mesh, name: &str) -> Outcome<Vec<[u32; 3]>> {
    let own = &mesh.group(name).ok_or("a side without name")?.cells.triangles;
    Ok(own.iter().map(|&t| mesh.triangles[t as usize]).collect())
}

/// Criterion 8: how far wounds open beside the continuum.
pub(super) fn against_continuum(rows: &mut CutRows) {
    let (root, threads) = (rows.case.root(), rows.threads());
    let cases = [
        ("block, n = 8", "block", CUBE, 8, false, 0.36),
        ("block, n = 12", "block", CUBE, 12, false, 0.27),
        ("beam, n = 8", "beam", BEAM, 8, false, 0.57),
        ("block, ten nodes, 6", "block", CUBE, 6, true, 0.2),
    ];
    for (what, key, case, cells, ten_nodes, bound) in cases {
        rows.add(what, |row| {
            let truth = root.get(key).get("extrapolated").get("opening_volume").number()?;
            let mut sum = 0.0;
            for seed in SEEDS {
                let mesh = case.mesh(cells, seed)?;
                let mesh = if ten_nodes { mesh.with_second_order() } else { mesh };
                (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
                let (mut simulation, body) = case.stand(threads, &mesh)?;
                let rest = simulation.skin(body)?.points;
                simulation.step()?;
                row.newton_iterations += u64::from(simulation.report().newton_iterations);
                row.cg_iterations += u64::from(simulation.report().cg_iterations);
                let own = opening(&simulation.skin(body)?, &rest) / (LOAD * truth) - 1.0;
                row.remark(format!("{:.1} %", 100.0 * own));
                sum += own;
            }
            let mean = sum / SEEDS.len() as f64;
            row.within("opening beside the continuum", mean, [-bound, bound]);
            Ok(())
        });
    }
}

/// Criterion 7: distance of the wound from the surface of the blade, in edges.
pub(super) fn on_the_blade(rows: &mut CutRows, _: &CaseEntry) {
    let plane = Opened { x: |y, z| 0.5 + 0.15 * (z - 0.5) + 0.12 * (y - 0.5), ..CUBE };
    for (what, case, bounds) in [("curved", CUBE, [0.02, 0.1]), ("plane", plane, [1e-3; 2])] {
        rows.add(what, |row| {
            let cells = 12;
            let (mut sum, mut largest, mut count) = (0.0, 0.0_f64, 0.0);
            for seed in SEEDS {
                let mesh = case.mesh(cells, seed)?;
                (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
                let mut material = Material::new(mesh.points.len(), &mesh.tetrahedra);
                cut(&mut material, &mesh.points, &case.strip(case.low, 1.0));
                let of = |p: u32| -> DVec3 {
                    let point = &material.points[p as usize];
                    let parts = point.vertices.iter().zip(point.weights);
                    parts.map(|(&v, w)| w * mesh.points[v as usize]).sum()
                };
                // corners and middles of its triangles inside of what was swept, to first order in the distance
                for (face, _, _) in material.skin().into_iter().filter(|(.., wound)| *wound) {
                    let [a, b, c] = face.map(of);
                    for x in [a, b, c, (a + b + c) / 3.0].into_iter().filter(|x| x.z > case.low) {
                        let at = |dy: f64, dz: f64| (case.x)(x.y + dy, x.z + dz);
                        let slope = [(1e-5, 0.0), (0.0, 1e-5)];
                        let [dy, dz] = slope.map(|(dy, dz)| (at(dy, dz) - at(-dy, -dz)) / 2e-5);
                        let off = (x.x - at(0.0, 0.0)) / DVec3::new(1.0, dy, dz).length();
                        let off = off.abs() * cells as f64;
                        (sum, largest, count) = (sum + off * off, worst(largest, off), count + 1.0);
                    }
                }
            }
            row.at_most("rms distance in edges", f64::sqrt(sum / count), bounds[0]);
            row.at_most("largest distance in edges", largest, bounds[1]);
            Ok(())
        });
    }
}

/// The cube of so many cells in two parts whose faces lie on the surface of a blade that goes right through.
fn fitted(cells: usize, seed: u64) -> Outcome<Mesh> {
    let mut whole = Mesh::default();
    for right in [false, true] {
        let part = box_tets(DVec3::new(0.5, 1.0, 1.0), [cells / 2, cells, cells])?;
        let mut part = jitter_interior(&part, 0.2, seed + u64::from(right))?;
        for x in &mut part.points {
            let (across, face) = (2.0 * x.x, (CUBE.x)(x.y, x.z));
            x.x = if right { face + (1.0 - face) * across } else { face * across };
        }
        let first = whole.points.len() as u32;
        whole.points.extend(part.points);
        whole.tetrahedra.extend(part.tetrahedra.iter().map(|t| t.map(|v| v + first)));
    }
    Ok(whole)
}

/// Mean iterations of steps that follow on so many others, or the most of those with the factor of an earlier one.
fn cost_of_steps(
    threads: usize,
    mesh: &Mesh,
    (poisson_ratio, clusters): (f64, bool),
    dt: f64,
    cuts_at: Option<usize>,
) -> Outcome<f64> {
    let unit = 0.06;
    let mut mesh = mesh.clone();
    mesh.points.iter_mut().for_each(|x| *x *= unit);
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio, density: 1000.0 };
    let model = if clusters { Model::NeoHookean } else { Model::default() };
    let volume = if clusters { VolumeRule::Clusters } else { VolumeRule::default() };
    let (mut simulation, body) =
        alone(threads, &BodyDescription { volume, ..cuttable(&mesh, material, model) })?;
    simulation.set_dt(dt);
    simulation.set_solver(moved_by(Integrator::Safe));
    simulation.set_gravity(DVec3::Z * -9.81);
    let on = |is: &dyn Fn(DVec3) -> bool| {
        let all = (0..).zip(&mesh.points).filter(|(_, x)| is(**x));
        all.map(|(v, _)| v).collect::<std::collections::BTreeSet<u32>>()
    };
    let floor = on(&|x| x.z == 0.0).into_iter().collect::<Vec<_>>();
    let floor = simulation.rows(body, "floor", &floor)?;
    simulation.add_constraint(Constraint::hold("floor", floor));
    for (x, sign) in [(0.0, -1.0), (unit, 1.0)] {
        let side = on(&|own| (own.x - x).abs() < 1e-9 * unit);
        let mut triangles = mesh.surface_triangles();
        triangles.retain(|t| t.iter().all(|v| side.contains(v)));
        pull(&mut simulation, body, triangles, DVec3::X * (100.0 * sign))?;
    }
    let (mut sum, mut kept) = (0.0, f64::NAN);
    for step in 0..15 {
        if cuts_at == Some(step) {
            simulation.cut(body, &CUBE.strip(-0.05, unit))?;
        }
        simulation.step()?;
        let report = simulation.report();
        let own = f64::from(report.cg_iterations) / f64::from(report.newton_iterations.max(1));
        if step >= 5 {
            sum += own / 10.0;
            kept = if report.preconditioner_refreshes == 0 { kept.max(own) } else { kept };
        }
    }
    Ok(if cuts_at.is_some_and(|step| step > 0) { kept } else { sum })
}

/// Criterion 6: iterations after a full section.
pub(super) fn iterations(rows: &mut CutRows, _: &CaseEntry) {
    let threads = rows.threads();
    for (what, tissue) in
        [("nu 0.3", (0.3, false)), ("nu 0.45", (0.45, false)), ("clusters 0.4999", (0.4999, true))]
    {
        for dt in [0.01, 0.033] {
            rows.add(&format!("{what}, {:.0} ms", 1e3 * dt), |row| {
                let (mut sums, mut kept) = ([0.0; 3], 0.0_f64);
                for seed in SEEDS {
                    let whole = CUBE.mesh(8, seed)?;
                    (row.nodes, row.cells) = (whole.points.len(), whole.tetrahedra.len());
                    let fitted = fitted(8, seed)?;
                    let all = [(&whole, Some(0)), (&fitted, None), (&whole, None)];
                    for (sum, (mesh, cuts_at)) in sums.iter_mut().zip(all) {
                        *sum +=
                            cost_of_steps(threads, mesh, tissue, dt, cuts_at)? / SEEDS.len() as f64;
                    }
                    kept = kept.max(cost_of_steps(threads, &whole, tissue, dt, Some(5))?);
                }
                let [cut, fitted, uncut] = sums;
                row.at_most("beside a mesh that fits the cut", cut / fitted, 1.15);
                row.at_most("beside the uncut body", cut / uncut, 1.7);
                row.at_most("with a factor of before the cut, beside a fresh one", kept / cut, 2.0);
                row.remark(format!(
                    "{cut:.1} iterations, fitted {fitted:.1}, uncut {uncut:.1}, kept {kept:.1}"
                ));
                Ok(())
            });
        }
    }
}

/// Criterion 12: where glue holds what a steady blade has not come to, nearly every move opens its wound.
pub(super) fn glued(rows: &mut CutRows, _: &CaseEntry) {
    let threads = rows.threads();
    for seed in SEEDS {
        rows.add(&format!("60 moves through mesh {seed}"), |row| {
            let mesh = CUBE.mesh(8, seed)?;
            (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
            for glue in [5.0, 0.0] {
                let works = match works_of_moves(threads, &mesh, glue) {
                    Ok(works) => works,
                    Err(error) => {
                        row.remark(format!("glue {glue}: {error}"));
                        if glue > 0.0 {
                            row.at_most("strokes without an equilibrium", 1.0, 0.0);
                        }
                        continue;
                    }
                };
                let all = works[works.len() - 1] - works[0];
                let parts: Vec<f64> = works.windows(2).map(|two| (two[1] - two[0]) / all).collect();
                // far above what the solver leaves
                let still = parts.iter().filter(|part| **part < 1e-6).count();
                let rise = parts.iter().copied().fold(0.0, worst);
                row.remark(format!("glue {glue}: {still} still, largest rise {rise:.3}"));
                // without glue it is told beside it alone
                if glue > 0.0 {
                    let fall = parts.iter().map(|part| -part).fold(f64::NEG_INFINITY, worst);
                    row.at_most("moves in which nothing opens", still as f64, 15.0);
                    row.at_most("largest fall of the work of the load", fall, 1e-9);
                }
            }
            Ok(())
        });
    }
}

/// Work (J) of the load on the cube before and after each of 60 moves of a blade along its cut, at rest.
fn works_of_moves(threads: usize, mesh: &Mesh, glue: f64) -> Outcome<Vec<f64>> {
    const MOVES: u32 = 60;
    let material = YoungPoisson { young_modulus: 1.0, poisson_ratio: 0.3, density: 1.0 };
    let body = BodyDescription { glue, ..cuttable(mesh, material, Model::Linear) };
    let (mut simulation, body) = alone(threads, &body)?;
    hold(&mut simulation, body, mesh, CUBE.held)?;
    for (side, way) in CUBE.loads {
        pull(&mut simulation, body, side_of(mesh, side)?, *way * LOAD)?;
    }
    simulation.set_solver(static_settings());
    let at = |y: f64| DVec3::new((CUBE.x)(y, CUBE.low), y, CUBE.low);
    let up = DVec3::new((CUBE.x)(0.0, 1.05), 0.0, 1.05) - at(0.0);
    let ends = [up, DVec3::ZERO];
    let edge = Edge { ends, into: DVec3::Y, toughness: 0.0, travel: DVec3::ZERO };
    let blade = simulation.add_tool(Tool::blade("scalpel", edge, at(-0.05)))?;
    simulation.step()?;
    let mut works = Vec::new();
    for i in 0..=MOVES {
        simulation.move_tool(blade, at(-0.05 + 1.1 * f64::from(i) / f64::from(MOVES)))?;
        // what a move crosses comes apart as the next step begins
        simulation.step()?;
        simulation.step()?;
        let world = simulation.world_mut();
        let mut query = world.query::<(&ExternalForce<f64>, &Displacement<f64>)>();
        works.push(query.iter(world).map(|(f, u)| f.get().dot(u.get())).sum());
    }
    Ok(works)
}

/// Criterion 19: the load at which the notch of the cube tears on does not depend on the mesh.
pub(super) fn tearing(rows: &mut CutRows, _: &CaseEntry) {
    let threads = rows.threads();
    // by strength, by toughness, and by the stress of as few elements as may be on every mesh
    let mut loads: [Vec<f64>; 3] = Default::default();
    let spread = |row: &mut ValidationRow, loads: &[f64]| {
        loads.iter().zip(CELLS).for_each(|(own, n)| row.remark(format!("n = {n}: {own:.3}")));
        let least = loads.iter().copied().fold(f64::INFINITY, f64::min);
        loads.iter().copied().fold(0.0, worst) / least - 1.0
    };
    let what = "largest over least critical load, less 1";
    rows.add("strength", |row| {
        for cells in CELLS {
            let mut sums = [0.0; 3];
            for seed in SEEDS {
                let mesh = CUBE.mesh(cells, seed)?;
                (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
                let (mut simulation, body) = CUBE.stand(threads, &mesh)?;
                simulation.step()?;
                let mut report = |radius: Option<f64>| -> Outcome<_> {
                    let (strength, toughness) = (1.0, Some(1.0));
                    let tear = Tear { body: body.0, strength, toughness, radius, max_speed: None };
                    simulation.set_tear(tear)?;
                    simulation.step()?;
                    Ok(simulation.tear_report(body).ok_or("it does not tear")?)
                };
                let (ball, few) = (report(Some(0.25))?, report(None)?);
                let own = [1.0 / ball.stress, ball.energy_release.sqrt().recip(), 1.0 / few.stress];
                sums.iter_mut()
                    .zip(own)
                    .for_each(|(sum, own)| *sum += LOAD * own / SEEDS.len() as f64);
            }
            loads.iter_mut().zip(sums).for_each(|(all, own)| all.push(own));
        }
        let own = spread(row, &loads[0]);
        row.at_most(what, own, 0.12);
        Ok(())
    });
    rows.add("toughness", |row| {
        let own = spread(row, &loads[1]);
        row.at_most(what, own, 0.12);
        Ok(())
    });
    rows.add("few elements", |row| {
        let own = spread(row, &loads[2]);
        row.within(what, own, [0.12, f64::INFINITY]);
        Ok(())
    });
    rows.add("a single element", |row| {
        let mesh = CUBE.mesh(8, 1)?;
        let (mut simulation, body) = CUBE.stand(threads, &mesh)?;
        let (strength, toughness, radius) = (1.0, None, Some(0.02));
        let tear = Tear { body: body.0, strength, toughness, radius, max_speed: None };
        row.at_most(
            "radii below an edge that are taken",
            f64::from(simulation.set_tear(tear).is_ok()),
            0.0,
        );
        Ok(())
    });
}

/// The block of `block_plane` and `stitch`, with an edge of one.
const STITCHED: Opened =
    Opened { x: |y, z| 0.52 + 0.05 * (y + 0.1) + (z - 1.1) / 6.7, low: 0.43, ..CUBE };

/// Criterion 20: tension of a thread that closes a wound by 30 %, on three meshes.
pub(super) fn closing(rows: &mut CutRows, _: &CaseEntry) {
    let threads = rows.threads();
    rows.add("channel of 25 points", |row| {
        let mut tensions = Vec::new();
        for cells in [6, 8, 12] {
            let mut sum = 0.0;
            for seed in SEEDS {
                let mesh = STITCHED.mesh(cells, seed)?;
                (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
                sum += closing_tension(threads, &mesh)? / (LOAD * SEEDS.len() as f64);
            }
            row.remark(format!("n = {cells}: {sum:.4}"));
            tensions.push(sum);
        }
        let least = tensions.iter().copied().fold(f64::INFINITY, f64::min);
        let most = tensions.iter().copied().fold(0.0, worst);
        row.at_most("largest over least tension, less 1", most / least - 1.0, 0.02);
        Ok(())
    });
}

/// Tension of a thread along an arc through both lips of a block at which the wound is 30 % less open.
fn closing_tension(threads: usize, mesh: &Mesh) -> Outcome<f64> {
    let (mut simulation, body) = STITCHED.stand(threads, mesh)?;
    let rest = simulation.skin(body)?.points;
    simulation.step()?;
    let open = opening(&simulation.skin(body)?, &rest);
    // half a circle from one side of the wound to the other, through the ends of `stitch`
    let mut holds = Vec::new();
    for i in 0..25 {
        let (sine, cosine) = (PI * f64::from(i) / 24.0).sin_cos();
        let at = DVec3::new(0.51 - 0.21 * cosine, 0.45, 0.97 - 0.22 * sine);
        let moved = simulation.tissue_point(body, at);
        holds.push(moved.ok_or("no tissue where the thread goes")?);
    }
    let stiffness = 1e3 * LOAD;
    let thread = simulation.add_thread(Thread::new("stitch", holds, stiffness))?;
    simulation.step()?;
    let report = simulation.thread_report(thread).ok_or("the thread is gone")?;
    let (mut drawn, mut tension) = ([0.0, 0.05 * report.length], [0.0, 0.0]);
    let mut off = [0.3, f64::NAN];
    // the opening falls nearly in proportion to what is drawn in: a secant finds it
    for _ in 0..12 {
        simulation.draw_thread(thread, 1, drawn[1])?;
        simulation.step()?;
        let report = simulation.thread_report(thread).ok_or("the thread is gone")?;
        tension[1] = report.largest();
        off[1] = 0.3 - (1.0 - opening(&simulation.skin(body)?, &rest) / open);
        if off[1].abs() < 1e-6 {
            return Ok(tension[1]);
        }
        let next = drawn[1] - off[1] * (drawn[1] - drawn[0]) / (off[1] - off[0]);
        (drawn, off, tension) = ([drawn[1], next.max(0.0)], [off[1], f64::NAN], [tension[1], 0.0]);
    }
    Err("no length of the thread closes the wound by 30 %".into())
}
