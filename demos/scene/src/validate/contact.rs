//! Contact of tools, schema `sinew-contact-ref/1`: forces on tools and displacements at rest, along paths and in
//! motion, from an independent program on the same mesh, with the same points and stiffness.

use super::body::{CaseBody, CaseCells, CaseLaw, CaseMaterial, mesh};
use super::compare::worst;
use super::read::{CaseEntry, ReferenceCase};
use super::{CaseError, Rows, STATIC_TOLERANCE, Status, ValidationRow};
use bevy_ecs::prelude::Entity;
use glam::{DMat3, DQuat, DVec3};
use sinew::engine::mesh::Mesh;
use sinew::prelude::*;
use sinew::solvers::settings::LinearPrecision;
use sinew::touch::set::ContactSet;
use sinew::touch::tool::{Points, Stiffness, ToolMotion};
use std::time::Instant;

const KEYS: &str = "accuracy analytic contact_faces depth dt fixed gravity increments \
    initial_velocity kind material mesh name penalty_k poses records results schema steps tangential_k tools what";

/// Increments in which a tool comes where the case names none; the end does not depend on them.
const INCREMENTS: u32 = 8;
/// Way (m) over the size of the body from which it comes then.
const FROM: f64 = 0.02;

struct ContactCase<'a> {
    case: &'a ReferenceCase<'a>,
    mesh: &'a Mesh,
    law: CaseLaw,
    material: CaseMaterial,
}

/// What a run ended with.
struct ContactOutcome {
    simulation: Simulation,
    body: BodyHandle,
    tools: Vec<Entity>,
    seconds: f64,
    newton: u64,
    cg: u64,
    unconverged: u32,
}

pub(super) fn run(case: &ReferenceCase) -> Rows {
    let root = case.root();
    root.refuse_unknown(KEYS)?;
    let mesh = read_mesh(case)?;
    let cells =
        CaseCells::of(&mesh).ok_or_else(|| root.get("mesh").error("a mesh with elements"))?;
    let name = root.get("material").get("law");
    let law = CaseLaw::find(name.text()?, cells.kind())?;
    let material = CaseMaterial::read(&root.get("material"), cells.len())?;
    let contact = ContactCase { case, mesh: &mesh, law, material };
    let mut rows = Vec::new();
    let mut add = |label: &str, run: &dyn Fn(&mut ValidationRow) -> Result<(), CaseError>| {
        let mut row = ValidationRow::new(&case.name(), label, mesh.points.len(), cells.len());
        (row.max_difference, row.reaction_difference) = (0.0, 0.0);
        let outcome = run(&mut row);
        rows.push(row.ended(outcome));
    };
    match root.get("kind").text()? {
        "static" => {
            for name in root.get("results").object()?.keys() {
                let result = root.get("results").get(name);
                let Some(points) = points_of(name) else { continue };
                add(name, &|row| contact.at_rest(&result, name, points, row));
            }
        }
        "quasi_static_path" => add("path", &|row| contact.along_path(row)),
        "dynamic" => add("implicit Euler", &|row| contact.in_motion(row)),
        _ => return Err(root.get("kind").error("static, quasi_static_path or dynamic")),
    }
    Ok(rows)
}

/// The kind of points that a result was found with; nothing for those of other methods.
fn points_of(name: &str) -> Option<Points> {
    let rest = name.strip_prefix("penalty_");
    if name.starts_with("exact_vertex") || rest.is_some_and(|r| r.starts_with("vertex")) {
        return Some(Points::Vertex);
    }
    let rest = rest?;
    if rest.starts_with("gauss3") {
        return Some(Points::Faces(2));
    }
    rest.strip_prefix("sub")?.parse().ok().map(Points::Faces)
}

/// A mesh file of any kind, or `nodes` and `tets` in JSON.
fn read_mesh(case: &ReferenceCase) -> Result<Mesh, CaseError> {
    let name = case.root().get("mesh").text()?;
    let file = case.path.parent().map(|folder| folder.join(name));
    match file.filter(|file| file.extension().is_some_and(|e| e == "json") && file.is_file()) {
        Some(file) => {
            let mesh = ReferenceCase::read(&file, case.options)?;
            let root = mesh.root();
            let points = root.get("nodes").vectors()?;
            Ok(Mesh { points, tetrahedra: root.get("tets").cells()?, ..Mesh::default() })
        }
        None => mesh(case),
    }
}

impl ContactCase<'_> {
    fn failed(&self, error: impl Into<sinew::simulation::SimulationError>) -> CaseError {
        self.case.simulation_error(error)
    }

    /// The body, held as the case says.
    fn simulation(&self, settings: SolverSettings) -> Result<(Simulation, BodyHandle), CaseError> {
        let root = self.case.root();
        let cells = CaseCells::of(self.mesh).ok_or_else(|| root.error("a mesh with elements"))?;
        let body = CaseBody::new(&self.mesh.points, cells, self.law, &self.material);
        let body = CaseBody { thickness: 0.0, ..body };
        let (mut simulation, handle) = body.simulation(self.case)?;
        simulation.set_solver(settings);
        let mut axes = vec![0_u8; self.mesh.points.len()];
        for entry in root.get("fixed").list()? {
            let (node, axis) = (entry.at(0).index()?, entry.at(1).index()?);
            *axes
                .get_mut(node as usize)
                .filter(|_| axis < 3)
                .ok_or_else(|| entry.error("a node of the mesh and an axis"))? |= 1 << axis;
        }
        for mask in 1..8 {
            let held: Vec<u32> =
                (0..).zip(&axes).filter(|(_, own)| **own == mask).map(|(node, _)| node).collect();
            if !held.is_empty() {
                let rows = simulation.rows(handle, "fixed", &held).map_err(|e| self.failed(e))?;
                let mut constraint = Constraint::hold(format!("fixed {mask}"), rows);
                constraint.axes = sinew::engine::vertex::FixedAxes(mask);
                simulation.add_constraint(constraint);
            }
        }
        Ok((simulation, handle))
    }

    /// Faces whose vertices rest at an extreme coordinate.
    fn faces(&self, name: &CaseEntry) -> Result<Vec<[u32; 3]>, CaseError> {
        let text = name.text()?;
        let axis = ["x", "y", "z"].iter().position(|axis| text.starts_with(axis));
        let (Some(axis), Some(sign)) = (
            axis,
            match &text[1..] {
                "_max" => Some(1.0),
                "_min" => Some(-1.0),
                _ => None,
            },
        ) else {
            return Err(name.error("x_min, x_max, y_min, ..."));
        };
        let points = &self.mesh.points;
        let most = points.iter().map(|p| sign * p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let on = |t: &[u32; 3]| t.iter().all(|&v| sign * points[v as usize][axis] > most - 1e-9);
        Ok(self.mesh.surface_triangles().into_iter().filter(on).collect())
    }

    fn tool(
        &self,
        simulation: &Simulation,
        body: BodyHandle,
        index: usize,
        points: Points,
    ) -> Result<Tool, CaseError> {
        let root = self.case.root();
        let entry = root.get("tools").at(index);
        let centre = entry.get("centre");
        let place = |entry: CaseEntry| {
            if entry.is_absent() { Ok(DVec3::ZERO) } else { entry.vector() }
        };
        let name = format!("tool {index}");
        let shape = entry.get("shape");
        let mut tool = match shape.text()? {
            "sphere" => {
                let radius = entry.get("radius").number()?;
                Tool::new(name, Shape::Sphere { radius }, place(centre)?)
            }
            "half_space" => {
                Tool::ground(name, place(entry.get("point"))?, entry.get("normal").vector()?)
            }
            "capsule" => {
                let shape = Shape::Capsule {
                    half_length: entry.get("half_length").number()?,
                    radius: entry.get("radius").number()?,
                };
                let mut tool = Tool::new(name, shape, place(centre)?);
                let axis = entry.get("axis").vector()?.normalize();
                tool.start.rotation = DQuat::from_rotation_arc(DVec3::X, axis);
                tool
            }
            "box" => {
                let shape = Shape::Box {
                    half: entry.get("half").vector()?,
                    rounding: entry.get("rounding").number()?,
                };
                Tool::new(name, shape, place(centre)?)
            }
            _ => return Err(shape.error("sphere, half_space, capsule or box")),
        };
        tool.friction = entry.get("mu").number()?;
        tool.points = points;
        tool.stiffness = Stiffness::Absolute(root.get("penalty_k").number()?);
        // the truth takes the nearest side always
        tool.keeps_side = false;
        let own = entry.get("contact_faces");
        let faces = self.faces(&if own.is_absent() { root.get("contact_faces") } else { own })?;
        let faces =
            simulation.face_rows(body, "contact faces", &faces).map_err(|e| self.failed(e))?;
        tool.faces = Some(faces);
        Ok(tool)
    }

    fn static_settings() -> SolverSettings {
        SolverSettings {
            integrator: Integrator::QuasiStatic,
            linear_tolerance: 1e-10,
            linear_precision: LinearPrecision::Full,
            newton_tolerance: 1e-12,
            ..SolverSettings::default()
        }
    }

    /// Presses tools on the body, step by step; `place` gives the place of a tool after step `i`.
    fn press(
        &self,
        (mut simulation, body): (Simulation, BodyHandle),
        tools: Vec<Tool>,
        steps: usize,
        place: &dyn Fn(usize, usize) -> Result<DVec3, CaseError>,
        each: &mut dyn FnMut(usize, &mut Simulation, &[Entity]) -> Result<(), CaseError>,
    ) -> Result<ContactOutcome, CaseError> {
        let start = Instant::now();
        let mut entities = Vec::new();
        let turns: Vec<DQuat> = tools.iter().map(|tool| tool.start.rotation).collect();
        for mut tool in tools {
            tool.motion = ToolMotion::Follow;
            entities.push(simulation.add_tool(tool).map_err(|e| CaseError::NotRun(e.to_string()))?);
        }
        let (mut newton, mut cg, mut unconverged) = (0, 0, 0);
        for step in 0..steps {
            for (tool, (&entity, &rotation)) in entities.iter().zip(&turns).enumerate() {
                let pose = ToolPose { position: place(step, tool)?, rotation, opening: 0.0 };
                simulation.move_tool(entity, pose).map_err(|e| CaseError::NotRun(e.to_string()))?;
            }
            simulation.step().map_err(|e| self.failed(e))?;
            let report = simulation.report();
            newton += u64::from(report.newton_iterations);
            cg += u64::from(report.cg_iterations);
            unconverged += u32::from(report.unconverged);
            each(step, &mut simulation, &entities)?;
        }
        let seconds = start.elapsed().as_secs_f64();
        Ok(ContactOutcome { simulation, body, tools: entities, seconds, newton, cg, unconverged })
    }

    fn at_rest(
        &self,
        result: &CaseEntry,
        name: &str,
        points: Points,
        row: &mut ValidationRow,
    ) -> Result<(), CaseError> {
        let root = self.case.root();
        let (simulation, body) = self.simulation(Self::static_settings())?;
        let mut tool = self.tool(&simulation, body, 0, points)?;
        tool.exact = name.starts_with("exact");
        let mut end = tool.start.position;
        if let Some((x, y)) = name.split_once("offset_").and_then(|(_, at)| at.split_once('_')) {
            let shift = |text: &str| {
                text.parse::<f64>().map_err(|_| result.error("a result named ..offset_X_Y"))
            };
            end += DVec3::new(shift(x)?, shift(y)?, 0.0);
        }
        let (increments, way) = match root.get("increments").given() {
            Some(count) => (count.index()?, DVec3::Z * root.get("depth").number()?),
            None => {
                let out = self.outward()?;
                let depth = end.distance(tool.start.position);
                let size = simulation.topology().bodies[body.0].size;
                (INCREMENTS, out * (depth + FROM * size + self.depth(&tool)?))
            }
        };
        tool.start.position = end + way;
        let steps = increments as usize;
        let place =
            |step: usize, _: usize| Ok(end + way * (1.0 - (step + 1) as f64 / steps as f64));
        let along = result.get("force_z_along_path");
        let mut path = Vec::new();
        let mut outcome = self.press(
            (simulation, body),
            vec![tool],
            steps,
            &place,
            &mut |_, simulation, tools| {
                path.push(simulation.tool_report(tools[0]).map_or(f64::NAN, |r| r.force.z));
                Ok(())
            },
        )?;
        let truth = result.get("force_on_tool").vector()?;
        let report = outcome.simulation.tool_report(outcome.tools[0]).cloned().unwrap_or_default();
        let mut scale = truth.length();
        let mut force = (report.force - truth).length();
        if along.is_list() {
            let truth = along.numbers()?;
            scale = truth.iter().fold(scale, |m, f| m.max(f.abs()));
            for (own, truth) in path.iter().zip(&truth) {
                force = worst(force, (own - truth).abs());
            }
        }
        row.reaction_difference = force / scale;
        self.compare_field(&mut outcome, &result.get("u"), row)?;
        if let Some(pressure) = root.get("analytic").get("nominal_pressure").given() {
            // pressures of all points are equal
            let pressures = outcome.simulation.contact_pressures(outcome.body);
            let own: Vec<f64> = pressures.into_iter().filter(|p| *p > 0.0).collect();
            let mean = own.iter().sum::<f64>() / own.len().max(1) as f64;
            let spread = own.iter().map(|p| (p / mean - 1.0).abs()).fold(0.0, f64::max);
            row.energy_difference = spread;
            row.note = format!("{mean:.4} Pa of {:.4}, spread {spread:.1e}", pressure.number()?);
        }
        self.close(&outcome, row)
    }

    /// Direction from which a tool comes: out of the touched faces.
    fn outward(&self) -> Result<DVec3, CaseError> {
        let root = self.case.root();
        let name = root.get("contact_faces");
        let text = name.text()?;
        let axis = match text.as_bytes().first() {
            Some(b'x') => DVec3::X,
            Some(b'y') => DVec3::Y,
            _ => DVec3::Z,
        };
        Ok(if text.ends_with("_min") { -axis } else { axis })
    }

    /// Depth (m) of the undeformed surface in the tool.
    fn depth(&self, tool: &Tool) -> Result<f64, CaseError> {
        let faces = self.faces(&self.case.root().get("contact_faces"))?;
        let (centre, rotation) = tool.part_pose(0, &tool.start);
        let inverse = DMat3::from_quat(rotation.inverse());
        let gap = |v: &u32| {
            tool.parts[0].shape.distance(inverse * (self.mesh.points[*v as usize] - centre)).0
        };
        Ok(-faces.iter().flatten().map(gap).fold(0.0, f64::min))
    }

    fn along_path(&self, row: &mut ValidationRow) -> Result<(), CaseError> {
        let root = self.case.root();
        let (simulation, body) = self.simulation(Self::static_settings())?;
        let mut tool = self.tool(&simulation, body, 0, Points::Vertex)?;
        let steps: Vec<CaseEntry> = root.get("steps").list()?.collect();
        tool.start.position = DVec3::Z * self.mesh.points.iter().map(|p| p.z).fold(0.0, f64::max);
        let place = |step: usize, _: usize| steps[step].get("point").vector();
        let (mut off, mut scale) = (0.0_f64, 0.0_f64);
        let mut outcome = self.press(
            (simulation, body),
            vec![tool],
            steps.len(),
            &place,
            &mut |step, simulation, tools| {
                let truth = steps[step].get("force_on_tool").vector()?;
                let own = recorded(simulation, tools[0]);
                off = worst(off, (own - truth).length());
                scale = scale.max(truth.length());
                Ok(())
            },
        )?;
        row.reaction_difference = off / scale;
        self.compare_field(&mut outcome, &root.get("results").get("u_end"), row)?;
        self.close(&outcome, row)
    }

    fn in_motion(&self, row: &mut ValidationRow) -> Result<(), CaseError> {
        let root = self.case.root();
        let settings = SolverSettings {
            integrator: Integrator::Newton,
            linear_tolerance: 1e-10,
            linear_precision: LinearPrecision::Full,
            newton_tolerance: 1e-12,
            ..SolverSettings::default()
        };
        let (mut simulation, body) = self.simulation(settings)?;
        simulation.set_gravity(root.get("gravity").vector()?);
        simulation.set_dt(root.get("dt").number()?);
        if let Some(velocity) = root.get("initial_velocity").given() {
            let n = self.mesh.points.len();
            let (u, v) = (vec![DVec3::ZERO; n], vec![velocity.vector()?; n]);
            simulation.set_state(body, &u, &v).map_err(|e| self.failed(e))?;
        }
        let count = root.get("tools").list()?.count();
        let mut tools = Vec::new();
        for index in 0..count {
            tools.push(self.tool(&simulation, body, index, Points::Vertex)?);
        }
        let poses = root.get("poses");
        let still: Vec<DVec3> = tools.iter().map(|tool| tool.start.position).collect();
        if poses.is_list() {
            // they come from where they do not touch yet
            for (i, tool) in tools.iter_mut().enumerate() {
                let normal = tool.start.rotation * DVec3::Z;
                let first = poses.at(0).at(i).vector()?;
                let reach = |x: &DVec3| (*x - first).dot(normal);
                let nearest = self.mesh.points.iter().map(reach).fold(f64::INFINITY, f64::min);
                tool.start.position = first + nearest * normal;
            }
        }
        let place = |step: usize, tool: usize| {
            if poses.is_list() { poses.at(step).at(tool).vector() } else { Ok(still[tool]) }
        };
        let steps = root.get("steps").index()? as usize;
        let truth = root.get("results").get("trajectory");
        let masses = simulation.masses(body);
        let mass: f64 = masses.iter().sum();
        let (dt, gravity) = (root.get("dt").number()?, root.get("gravity").vector()?);
        let velocity = root.get("initial_velocity").given();
        let velocity = velocity.map_or(Ok(DVec3::ZERO), |v| v.vector())?;
        let mut before = mass * velocity;
        row.energy_difference = 0.0;
        let (mut off, mut scale) = ([0.0_f64; 2], [0.0_f64; 2]);
        let outcome = self.press(
            (simulation, body),
            tools,
            steps,
            &place,
            &mut |step, simulation, tools| {
                let record = truth.at(step).numbers()?;
                let of = |i: usize| DVec3::new(record[3 * i], record[3 * i + 1], record[3 * i + 2]);
                let u = simulation.displacements(body);
                let centre = u.iter().zip(&masses).map(|(u, m)| *u * *m).sum::<DVec3>() / mass;
                let mut compare = |k: usize, own: DVec3, truth: DVec3| {
                    off[k] = worst(off[k], (own - truth).length());
                    scale[k] = scale[k].max(truth.length());
                };
                let mut felt = DVec3::ZERO;
                for (i, tool) in tools.iter().enumerate() {
                    compare(0, recorded(simulation, *tool), of(i));
                    felt += simulation.tool_report(*tool).map_or(DVec3::NAN, |r| r.force);
                }
                let now = DVec3::from_array(simulation.report().momentum);
                // what the tools feel is what the body gains and gravity gives
                let gained = now - before - dt * mass * gravity;
                let off_balance = (gained + dt * felt).length() / (dt * mass * gravity.length());
                row.energy_difference = worst(row.energy_difference, off_balance);
                before = now;
                compare(1, centre, of(tools.len()));
                Ok(())
            },
        )?;
        row.reaction_difference = off[0] / scale[0];
        row.max_difference = off[1] / scale[1];
        self.close(&outcome, row)
    }

    /// Displacements `[node, x, y, z]` of some nodes.
    fn compare_field(
        &self,
        outcome: &mut ContactOutcome,
        truth: &CaseEntry,
        row: &mut ValidationRow,
    ) -> Result<(), CaseError> {
        let own = outcome.simulation.displacements(outcome.body);
        let scale = own.iter().map(|u| u.length()).fold(0.0, f64::max);
        for entry in truth.list()? {
            let node = entry.at(0).index()? as usize;
            let u = DVec3::new(entry.at(1).number()?, entry.at(2).number()?, entry.at(3).number()?);
            let own = own.get(node).ok_or_else(|| entry.error("a node of the mesh"))?;
            let off = if scale > 0.0 { own.distance(u) / scale } else { own.distance(u) };
            row.max_difference = worst(row.max_difference, off);
        }
        Ok(())
    }

    fn close(&self, outcome: &ContactOutcome, row: &mut ValidationRow) -> Result<(), CaseError> {
        row.seconds = outcome.seconds;
        row.newton_iterations = outcome.newton;
        row.cg_iterations = outcome.cg;
        let tolerance = self.case.options.tolerance.unwrap_or(STATIC_TOLERANCE);
        if outcome.unconverged > 0 {
            row.note = format!("{} steps did not converge; {}", outcome.unconverged, row.note);
        }
        let off = worst(row.max_difference, row.reaction_difference);
        row.status = if off <= tolerance { Status::Pass } else { Status::Fail };
        Ok(())
    }
}

/// Force (N) on a tool as the files record it: friction with the elastic slip that is kept for the next step. That is
/// not what acts in the step, as the momentum of their own trajectories shows; the row's energy column says how far
/// the force that Sinew reports is from balancing the momentum.
fn recorded(simulation: &Simulation, tool: Entity) -> DVec3 {
    let contact = simulation.world().get_resource::<ContactSet>();
    contact.and_then(|contact| contact.force_by_kept_slip(tool)).unwrap_or(DVec3::NAN)
}
