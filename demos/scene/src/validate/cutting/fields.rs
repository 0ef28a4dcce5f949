//! Cases of a separate program on its own meshes: what a blade decides, equilibria of cut blocks, what must not change at the
//! instant of a cut, and threads.

use super::super::compare::worst;
use super::*;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::row::LocalRow;
use sinew::engine::vertex::{Displacement, Mass, RestPosition, Velocity};

/// Mesh, material and blade of a case.
pub(super) struct CutBlock {
    pub mesh: Mesh,
    material: YoungPoisson,
    pub blade: Vec<[DVec3; 2]>,
}

/// Positions `[p, q]` (m) of a blade.
pub(super) fn strip(entry: &CaseEntry) -> Result<Vec<[DVec3; 2]>, CaseError> {
    entry.list()?.map(|ends| Ok([ends.at(0).vector()?, ends.at(1).vector()?])).collect()
}

/// What is where a text such as `x = 0.06` says.
fn on_side(entry: &CaseEntry) -> Result<impl Fn(DVec3) -> bool + use<>, CaseError> {
    let parsed = entry.text()?.split_once(" = ").and_then(|(axis, value)| {
        let axis = ["x", "y", "z"].iter().position(|own| *own == axis)?;
        Some((axis, value.parse::<f64>().ok()?))
    });
    let (axis, value) =
        parsed.ok_or_else(|| entry.error("an axis and a place, such as `x = 0.06`"))?;
    Ok(move |x: DVec3| (x[axis] - value).abs() < 1e-9)
}

/// How many entries of two lists differ.
pub(super) fn differing<T: PartialEq>(a: &[T], b: &[T]) -> f64 {
    (a.len().abs_diff(b.len()) + a.iter().zip(b).filter(|(a, b)| a != b).count()) as f64
}

impl CutBlock {
    pub fn read(root: &CaseEntry) -> Result<Self, CaseError> {
        let mesh = root.get("mesh");
        let (points, tetrahedra) = (mesh.get("nodes").vectors()?, mesh.get("tets").cells()?);
        let mesh = Mesh { points, tetrahedra, ..Mesh::default() };
        let number = |key: &str| root.get("material").get(key).number();
        let material = YoungPoisson {
            young_modulus: number("E")?,
            poisson_ratio: number("nu")?,
            density: number("rho")?,
        };
        let blade = root.get("blade");
        let blade = if blade.is_absent() { Vec::new() } else { strip(&blade)? };
        Ok(Self { mesh, material, blade })
    }

    pub fn material(&self) -> Material {
        Material::new(self.mesh.points.len(), &self.mesh.tetrahedra)
    }

    pub fn description(&self) -> BodyDescription<'_> {
        cuttable(&self.mesh, self.material, Model::StVK)
    }

    /// Holds and loads a body as the case says.
    fn load(&self, simulation: &mut Simulation, body: BodyHandle, root: &CaseEntry) -> Outcome {
        let on = on_side(&root.get("fixed"))?;
        let points = &self.mesh.points;
        let held = (0..).zip(points).filter(|(_, x)| on(**x)).map(|(v, _)| v).collect::<Vec<u32>>();
        let held = simulation.rows(body, "held", &held)?;
        simulation.add_constraint(Constraint::hold("held", held));
        for load in root.get("loads").list()? {
            let on = on_side(&load.at(0))?;
            let mut triangles = self.mesh.surface_triangles();
            triangles.retain(|t| t.iter().all(|&v| on(points[v as usize])));
            pull(simulation, body, triangles, load.at(1).vector()?)?;
        }
        Ok(())
    }

    /// The block in a world of its own, held and loaded.
    fn stand(&self, threads: usize, root: &CaseEntry) -> Outcome<(Simulation, BodyHandle)> {
        let (mut simulation, body) = alone(threads, &self.description())?;
        self.load(&mut simulation, body, root)?;
        Ok((simulation, body))
    }

    fn size(&self, row: &mut ValidationRow) {
        (row.nodes, row.cells) = (self.mesh.points.len(), self.mesh.tetrahedra.len());
    }

    /// Marks, parted elements, shares and centroids beside those of the file.
    fn compare_marks(&self, results: &CaseEntry, row: &mut ValidationRow) -> Outcome {
        self.size(row);
        let rest = &self.mesh.points;
        let mut material = self.material();
        let stroke = cut(&mut material, rest, &self.blade);
        let separated = results.get("separated").indices()?;
        row.at_most("parted elements that differ", differing(&stroke.separated, &separated), 0.0);
        let (mut edges, mut off) = (Vec::new(), 0.0);
        for (i, mark) in results.get("marks").list()?.enumerate() {
            edges.push(([mark.at(0).index()?, mark.at(1).index()?], mark.at(3).flag()?));
            let own = stroke.marks.get(i).map_or(f64::NAN, |own| own.at);
            off = worst(off, (own - mark.at(2).number()?).abs());
        }
        let own: Vec<_> = stroke.marks.iter().map(|mark| (mark.edge, mark.swept)).collect();
        row.at_most("marked edges that differ", differing(&own, &edges), 0.0);
        row.at_most("marks", off, 1e-12);
        let mut copies: Vec<(u32, f64, DVec3)> = Vec::new();
        let mut of = vec![0; self.mesh.tetrahedra.len()];
        material.elements.iter().for_each(|element| of[element.source as usize] += 1);
        for element in material.elements.iter().filter(|own| of[own.source as usize] > 1) {
            let x = element.vertices.map(|v| rest[v as usize]);
            let sum: DVec3 = x.iter().zip(element.portion).map(|(x, w)| w * *x).sum();
            copies.push((element.source, element.share(), sum));
        }
        copies.sort_by(|a, b| {
            (a.0, a.1).partial_cmp(&(b.0, b.1)).unwrap_or(std::cmp::Ordering::Equal)
        });
        let size = rest.iter().map(|x| x.length()).fold(0.0, f64::max);
        let (mut sources, mut shares, mut centres) = (Vec::new(), 0.0, 0.0);
        for (i, copy) in results.get("cut_copies").list()?.enumerate() {
            let truth = copy.numbers()?;
            let &[source, share, x, y, z, ..] = &truth[..] else {
                return Err(copy.error("element, share, centroid, ...").into());
            };
            sources.push(source as u32);
            let own = copies.get(i).copied().unwrap_or((0, f64::NAN, DVec3::NAN));
            shares = worst(shares, (own.1 - share).abs());
            centres = worst(centres, (own.2 - share * DVec3::new(x, y, z)).length() / size);
        }
        let own: Vec<u32> = copies.iter().map(|copy| copy.0).collect();
        row.at_most("copies that differ", differing(&own, &sources), 0.0);
        row.at_most("shares", shares, 1e-11);
        row.at_most("centroids times shares over the size", centres, 1e-11);
        Ok(())
    }

    /// Displacements of all vertices of copies beside those of the file.
    fn compare_equilibrium(
        &self,
        root: &CaseEntry,
        threads: usize,
        row: &mut ValidationRow,
    ) -> Outcome {
        self.size(row);
        let results = root.get("results");
        let (mut simulation, body) = self.stand(threads, root)?;
        let report = simulation.cut(body, &self.blade)?;
        simulation.set_solver(static_settings());
        simulation.step()?;
        row.newton_iterations = simulation.report().newton_iterations.into();
        row.cg_iterations = simulation.report().cg_iterations.into();
        row.at_most("not converged", f64::from(simulation.report().unconverged), 0.0);
        let area = report.area / results.get("wound_area").number()?;
        row.at_most("area of the wound", (area - 1.0).abs(), 1e-10);
        let energy = simulation.evaluate() / results.get("elastic_energy").number()?;
        row.energy_difference = (energy - 1.0).abs();
        // copies by element and share, vertices in the order of the mesh
        let topology = simulation.topology().bodies[body.0].clone();
        let world = simulation.world_mut();
        let u: Vec<DVec3> =
            world.query::<&Displacement<f64>>().iter(world).map(|u| u.get()).collect();
        let mut copies: Vec<(u32, f64, [DVec3; 4])> = Vec::new();
        for (copy, local) in topology.tetrahedra().iter().enumerate() {
            if !topology.is_whole(ElementKind::Tetrahedron, copy as u32) {
                let source =
                    topology.source(ElementKind::Tetrahedron, topology.order.tetrahedra[copy]);
                let moved = self.mesh.tetrahedra[source as usize].map(|v| {
                    let own = |row: &&u32| topology.vertex_of(LocalRow(**row)).0 == v;
                    local.iter().find(own).map_or(DVec3::NAN, |&row| u[row as usize])
                });
                copies.push((source, topology.copies.portions[copy].iter().sum(), moved));
            }
        }
        copies.sort_by(|a, b| {
            (a.0, a.1).partial_cmp(&(b.0, b.1)).unwrap_or(std::cmp::Ordering::Equal)
        });
        let truth: Result<Vec<_>, CaseError> =
            results.get("cut_copies").list()?.map(|c| c.numbers()).collect();
        let truth = truth?;
        let moved = |copy: &Vec<f64>| copy[5.min(copy.len())..].to_vec();
        let expected: Vec<f64> = truth.iter().flat_map(moved).collect();
        let own: Vec<f64> = copies.iter().flat_map(|c| c.2).flat_map(|u| u.to_array()).collect();
        row.at_most(
            "displacements that differ in number",
            own.len().abs_diff(expected.len()) as f64,
            0.0,
        );
        let largest = expected.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let off = own.iter().zip(&expected).map(|(a, b)| (a - b).abs() / largest).fold(0.0, worst);
        row.max_difference = off;
        row.at_most("displacements", off, 1e-8);
        Ok(())
    }

    /// Another number of moves of the blade decides the same.
    fn compare_moves(&self, row: &mut ValidationRow) -> Outcome {
        self.size(row);
        let [Some(&first), Some(&last)] = [self.blade.first(), self.blade.last()] else {
            return Err("a blade without positions".into());
        };
        let truth = cut(&mut self.material(), &self.mesh.points, &self.blade);
        let (mut others, mut off) = (0.0, 0.0);
        for moves in [1, 6, 50, 400] {
            let part = |i: usize| i as f64 / moves as f64;
            let blade: Vec<_> =
                (0..=moves).map(|i| [0, 1].map(|k| first[k].lerp(last[k], part(i)))).collect();
            let own = cut(&mut self.material(), &self.mesh.points, &blade);
            let edges = |stroke: &Stroke| {
                stroke.marks.iter().map(|m| (m.edge, m.swept)).collect::<Vec<_>>()
            };
            others += differing(&own.separated, &truth.separated)
                + differing(&edges(&own), &edges(&truth));
            let pairs = own.marks.iter().zip(&truth.marks);
            off = pairs.map(|(a, b)| (a.at - b.at).abs()).fold(off, worst);
        }
        row.at_most("decisions that differ", others, 0.0);
        row.at_most("marks", off, 1e-12);
        Ok(())
    }

    /// The block and another body in either order, cut and moved.
    fn beside(&self, root: &CaseEntry, threads: usize, first: bool) -> Outcome<(Vec<u32>, u64)> {
        let other = box_tets(DVec3::splat(0.01), [2; 3])?;
        let own = self.description();
        let other = BodyDescription::new("other", &other, self.material);
        let pair = if first { [&own, &other] } else { [&other, &own] };
        let (mut simulation, _) = alone(threads, pair[0])?;
        let second = simulation.add_body(pair[1])?;
        let body = if first { BodyHandle(0) } else { second };
        self.load(&mut simulation, body, root)?;
        simulation.set_solver(moved_by(Integrator::Safe));
        simulation.step()?;
        let report = simulation.cut(body, &self.blade)?;
        for _ in 0..4 {
            simulation.step()?;
        }
        Ok((report.separated, simulation.state_hash()))
    }
}

/// Criteria 1 and 2: a blade that ends inside, tissue at rest.
pub(super) fn at_rest(rows: &mut CutRows) {
    let (root, threads) = (rows.case.root(), rows.threads());
    let read = || CutBlock::read(&root).map_err(Failure::from);
    rows.add("marks and shares", |row| read()?.compare_marks(&root.get("results"), row));
    rows.add("equilibrium", |row| read()?.compare_equilibrium(&root, threads, row));
    let Ok(block) = read() else { return };
    if rows.name == "block_plane" {
        rows.add("moves of the blade", |row| block.compare_moves(row));
        rows.add("order and threads", |row| {
            let truth = block.beside(&root, 1, true)?;
            let mut others = 0.0;
            for threads in [1, 2, 16] {
                others += f64::from(block.beside(&root, threads, true)? != truth);
            }
            let mirrored = block.beside(&root, 1, false)?.0;
            row.at_most("runs with other bits", others, 0.0);
            row.at_most(
                "decisions that differ in mirrored order",
                differing(&mirrored, &truth.0),
                0.0,
            );
            Ok(())
        });
    }
}

/// Criterion 3: masses, motion and energy of a block that is cut in two while it moves.
pub(super) fn at_the_instant(rows: &mut CutRows) {
    let (root, threads) = (rows.case.root(), rows.threads());
    let results = root.get("results");
    rows.add("marks and shares", |row| CutBlock::read(&root)?.compare_marks(&results, row));
    rows.add("at the instant", |row| {
        let block = CutBlock::read(&root)?;
        block.size(row);
        let nodes = block.mesh.points.len();
        let [u, v] = ["displacement", "velocity"].map(|key| root.get(key).field(nodes));
        let (mut simulation, body) = alone(threads, &block.description())?;
        simulation.set_state(body, &u?, &v?)?;
        // energies, volume, mass; momentum and angular momentum
        let state = |simulation: &mut Simulation| {
            let elastic = simulation.evaluate();
            let volume = simulation.volume(body);
            let world = simulation.world_mut();
            type Rows = (
                &'static Mass<f64>,
                &'static RestPosition,
                &'static Displacement<f64>,
                &'static Velocity<f64>,
            );
            let mut sums = ([elastic, 0.0, volume, 0.0], [DVec3::ZERO; 2]);
            for (m, x, u, v) in world.query::<Rows>().iter(world) {
                let (x, v) = (x.0 + u.get(), v.get());
                sums.0[1] += 0.5 * m.0 * v.length_squared();
                sums.0[3] += m.0;
                sums.1[0] += m.0 * v;
                sums.1[1] += m.0 * x.cross(v);
            }
            sums
        };
        let before = state(&mut simulation);
        let report = simulation.cut(body, &block.blade)?;
        let after = state(&mut simulation);
        row.at_most("pieces but two", report.pieces.abs_diff(2) as f64, 0.0);
        for (i, what) in ["energy", "kinetic energy", "volume", "mass"].into_iter().enumerate() {
            row.at_most(what, (after.0[i] / before.0[i] - 1.0).abs(), 1e-12);
        }
        for (i, what) in ["momentum", "angular momentum"].into_iter().enumerate() {
            row.at_most(what, after.1[i].distance(before.1[i]) / before.1[i].length(), 1e-12);
        }
        for (i, key) in ["elastic_energy_after", "kinetic_energy_after"].into_iter().enumerate() {
            let off = (after.0[i] / results.get(key).number()? - 1.0).abs();
            row.energy_difference = row.energy_difference.max(off);
        }
        row.at_most("energies of the file", row.energy_difference, 1e-12);
        Ok(())
    });
}

/// Criterion 20: a thread closes the wound of another case.
pub(super) fn stitch(rows: &mut CutRows) {
    let (own, threads) = (rows.case, rows.threads());
    let root = own.root();
    rows.add("closed wound", |row| {
        let file = own.path.with_file_name(root.get("cut").text()?);
        let case = ReferenceCase::read(&file, own.options)?;
        let block = CutBlock::read(&case.root())?;
        block.size(row);
        let (mut simulation, body) = block.stand(threads, &case.root())?;
        // in elements that the blade parts: at rest before, and found again behind
        let mut holds = Vec::new();
        for point in root.get("points").list()? {
            let hold = simulation.tissue_point(body, point.get("rest").vector()?);
            holds.push(hold.ok_or_else(|| point.error("a point in the tissue"))?);
        }
        simulation.cut(body, &block.blade)?;
        simulation.set_solver(static_settings());
        simulation.step()?;
        let [mut tension, mut energy, mut places, mut open] = [0.0_f64; 4];
        for result in root.get("results").list()? {
            let number = |key: &str| result.get(key).number();
            let length = Some(number("free_length")?);
            let thread = Thread::new("stitch", holds.clone(), root.get("EA").number()?);
            let thread = simulation.add_thread(Thread { length, ..thread })?;
            simulation.step()?;
            open += f64::from(simulation.report().unconverged);
            let found = simulation.thread_report(thread).ok_or("the thread is gone")?.clone();
            let truth = number("tension")?;
            tension = found.tension.iter().map(|t| (t / truth - 1.0).abs()).fold(tension, worst);
            let points = result.get("points").field(holds.len())?;
            let length = points[0].distance(points[points.len() - 1]);
            places = found
                .points
                .iter()
                .zip(points)
                .map(|(a, b)| a.distance(b) / length)
                .fold(places, worst);
            energy = worst(energy, (simulation.evaluate() / number("elastic_energy")? - 1.0).abs());
            simulation.remove_contact(thread);
        }
        (row.max_difference, row.energy_difference) = (places, energy);
        row.at_most("not converged", open, 0.0);
        row.at_most("tension", tension, 1e-7);
        row.at_most("places over the distance of the ends", places, 1e-7);
        row.at_most("elastic energy", energy, 1e-7);
        Ok(())
    });
}

/// Criterion 20: ratio of the tensions at the ends of a thread that turns by angles round rings, drawn at its last end.
pub(super) fn capstan(rows: &mut CutRows) {
    let root = rows.case.root();
    for integrator in [Integrator::Safe, Integrator::Auto, Integrator::SymplecticEuler] {
        rows.add(integrator.name(), |row| {
            let mut off = 0.0;
            for entry in root.get("cases").list()? {
                let angles = entry.get("theta").numbers()?;
                let mesh = box_tets(DVec3::splat(0.01), [1; 3])?;
                let material =
                    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1e3 };
                let (mut simulation, _) =
                    alone(1, &BodyDescription::new("aside", &mesh, material))?;
                simulation.set_solver(moved_by(integrator));
                let (mut at, mut turned) = (DVec3::ZERO, 0.0_f64);
                let mut rings = vec![Hold::Place(at)];
                for angle in [&[0.0], &angles[..]].concat() {
                    turned += angle;
                    at += 0.01 * DVec3::new(turned.cos(), turned.sin(), 0.0);
                    rings.push(Hold::Place(at));
                }
                let friction = entry.get("mu").number()?;
                let thread = Thread { friction, ..Thread::new("thread", rings, 20.0) };
                let thread = simulation.add_thread(thread)?;
                for step in 1..=5 {
                    simulation.draw_thread(thread, 1, 2e-4 * f64::from(step))?;
                    simulation.step()?;
                }
                let found = simulation.thread_report(thread).ok_or("the thread is gone")?;
                let ends = found.tension.first().zip(found.tension.last());
                let ratio = ends.map_or(f64::NAN, |(first, last)| last / first);
                off = worst(off, (ratio / entry.get("ratio").number()? - 1.0).abs());
            }
            row.at_most("ratio of tensions", off, 1e-6);
            Ok(())
        });
    }
}
