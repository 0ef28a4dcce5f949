//! From a scene to a simulation. Everything is checked here, before the first step, and everything
//! that was found on the way is kept as a warning.

use crate::axes;
use crate::error::{Place, SceneError, hint};
use crate::resection::{self, BuiltResection};
use crate::scene::{
    Body, CurveEntry, Faces, Generate, LoadedScene, Material, Membrane, Mode, Probe, Quantity,
    Rotation, Selection, SheetCells, SolidCells,
};
use crate::summary::{Level, Warning};
use glam::{DQuat, DVec2, DVec3};
use sinew::engine::load::{Constraint, Curve, Load, Motion, Pressure, rotation};
use sinew::engine::mesh::check::Severity;
use sinew::engine::mesh::generate::{
    box_hexahedra, box_tets, cup_hexahedra, cylinder_hexahedra, cylinder_tets, disc_triangles,
    irregular_box_tets, jitter_interior, quad_grid, specimen_hexahedra, specimen_quads,
    specimen_tets, specimen_triangles, sphere_tets, sphere_triangles, triangle_grid,
};
use sinew::engine::mesh::{CheckOptions, CheckReport, FindingCode, Group, Mesh, MeshError, check};
use sinew::engine::vertex::FixedAxes;
use sinew::identify::ElementMethod;
use sinew::models::axes::description::AxesDescription;
use sinew::models::body::{BodyDescription, Evaluation, Model};
use sinew::models::field::FieldError;
use sinew::models::material::{MaterialError, YoungPoisson, preset};
use sinew::models::sheet::MembraneSettings;
use sinew::simulation::{Backend, BodyHandle, Precision, Readback, Simulation, SimulationOptions};
use sinew::solvers::settings::{Integrator, SolverSettings};
use std::collections::HashMap;

use bevy_ecs::entity::Entity;

/// What a caller may set in place of the scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct BuildOptions {
    /// Number type.
    pub precision: Option<Precision>,
    /// Where steps are computed.
    pub backend: Option<Backend>,
    /// Threads; 0 means one per core.
    pub threads: Option<usize>,
    /// Steps (load steps of a static scene).
    pub steps: Option<u64>,
}

/// A scene, ready for its first step.
pub struct BuiltScene {
    /// The simulation.
    pub simulation: Simulation,
    /// Bodies in the order of the file.
    pub bodies: Vec<BuiltBody>,
    /// Constraints in the order of the file.
    pub constraints: Vec<BuiltConstraint>,
    /// Loads in the order of the file.
    pub loads: Vec<BuiltLoad>,
    /// Resections in the order of the file.
    pub resections: Vec<BuiltResection>,
    /// Pressures in the order of the file.
    pub pressures: Vec<BuiltPressure>,
    /// Probes in the order of the file.
    pub probes: Vec<BuiltProbe>,
    /// Steps and intervals.
    pub plan: Plan,
    /// What was found and repaired, or looks unintended.
    pub warnings: Vec<Warning>,
}

/// Steps and intervals of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Kind of the scene.
    pub mode: Mode,
    /// Step length (s); of a static scene the fraction of the loads per step.
    pub dt: f64,
    /// Number of steps.
    pub steps: u64,
    /// Steps between frames.
    pub frame_every: u64,
    /// Steps between rows of the probes.
    pub probe_every: u64,
    /// Full gravity (m/s^2).
    pub gravity: DVec3,
    /// Settings of the solver.
    pub settings: SolverSettings,
    /// Threads asked for; 0 means one per core.
    pub threads: usize,
}

/// A body in the simulation.
pub struct BuiltBody {
    /// Name.
    pub name: String,
    /// The body.
    pub handle: BodyHandle,
    /// Its mesh, in place and repaired.
    pub mesh: Mesh,
    /// What the check found.
    pub report: CheckReport,
    /// Vertices that its elements use, sorted.
    pub used_vertices: Vec<u32>,
    /// Material.
    pub material: YoungPoisson,
    /// Sum of the masses of its elements (kg).
    pub mass: f64,
    /// Its membrane.
    pub membrane: Option<BuiltMembrane>,
    /// Preset that it came from.
    pub preset: Option<String>,
    /// Energy.
    pub model: Model,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// How constants of lumped springs are found, where the scene says so.
    pub element_method: Option<ElementMethod>,
    /// Axes.
    pub axes: Option<AxesDescription<'static>>,
}

/// The membrane of a body.
#[derive(Clone, Debug)]
pub struct BuiltMembrane {
    /// Triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Quadrilaterals.
    pub quads: Vec<[u32; 4]>,
    /// What it is made of.
    pub settings: MembraneSettings,
    /// Area (m^2).
    pub area: f64,
}

impl BuiltBody {
    /// Triangles of its membrane, none without one.
    pub fn membrane_triangles(&self) -> &[[u32; 3]] {
        self.membrane.as_ref().map_or(&[], |m| &m.triangles)
    }

    /// Quadrilaterals of its membrane, none without one.
    pub fn membrane_quads(&self) -> &[[u32; 4]] {
        self.membrane.as_ref().map_or(&[], |m| &m.quads)
    }
}

/// A pressure in the simulation.
#[derive(Clone, Debug)]
pub struct BuiltPressure {
    /// Name.
    pub name: String,
    /// Index of the body.
    pub body: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Pressure (Pa) at curve value 1.
    pub pressure: f64,
}

/// A constraint in the simulation.
#[derive(Clone, Debug)]
pub struct BuiltConstraint {
    /// Name.
    pub name: String,
    /// Index of the body.
    pub body: usize,
    /// The constraint.
    pub entity: Entity,
    /// Vertices, sorted.
    pub vertices: Vec<u32>,
    /// Held axes.
    pub axes: FixedAxes,
    /// Time (s) from which it acts.
    pub from: f64,
    /// Time (s) until which it acts.
    pub until: f64,
    /// What it does, in words.
    pub motion: String,
}

/// A load in the simulation.
#[derive(Clone, Debug)]
pub struct BuiltLoad {
    /// Name.
    pub name: String,
    /// Index of the body.
    pub body: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// Total force (N) at curve value 1.
    pub force: DVec3,
}

/// A probe, resolved.
#[derive(Clone, Debug)]
pub struct BuiltProbe {
    /// Name.
    pub name: String,
    /// Index of the body.
    pub body: usize,
    /// Vertices, sorted.
    pub vertices: Vec<u32>,
    /// Triangles of its group, where it records what they enclose.
    pub faces: Vec<[u32; 3]>,
    /// Index of the constraint.
    pub constraint: Option<usize>,
    /// What to record.
    pub record: Vec<Quantity>,
}

/// Checks a scene and builds its simulation.
///
/// # Errors
/// [`SceneError`] with file, line, key and remedy.
pub fn build(loaded: &LoadedScene, options: &BuildOptions) -> Result<BuiltScene, SceneError> {
    let scene = &loaded.scene;
    let builder = Builder { loaded };
    if scene.name.trim().is_empty() {
        return Err(builder.value("name", "the name is empty", "give the scene a name"));
    }
    let plan = builder.plan(options)?;
    let mut warnings = Vec::new();
    if scene.bodies.is_empty() {
        return Err(SceneError::Missing {
            place: loaded.place(""),
            what: "a body".into(),
            remedy: "add a [[body]] with `mesh` or `generate`".into(),
        });
    }
    builder.unique("body", scene.bodies.iter().map(|b| b.name.as_str()))?;
    builder.unique("constraint", scene.constraints.iter().map(|c| c.name.as_str()))?;
    builder.unique("load", scene.loads.iter().map(|l| l.name.as_str()))?;
    builder.unique("resection", scene.resections.iter().map(|r| r.name.as_str()))?;
    builder.unique("probe", scene.probes.iter().map(|p| p.name.as_str()))?;
    for (i, load) in scene.loads.iter().enumerate() {
        if scene.constraints.iter().any(|c| c.name == load.name) {
            let (place, name) = (loaded.place(format!("load[{i}].name")), load.name.clone());
            return Err(SceneError::Duplicate { place, kind: "constraint", name });
        }
    }

    let precision = options.precision.unwrap_or(scene.precision.into());
    let backend = options.backend.unwrap_or(scene.backend.into());
    let threads = plan.threads;
    // the runner reads the state through the simulation, which asks for it
    let readback = Readback::OnDemand;
    let options = SimulationOptions { precision, threads, backend, readback, ..Default::default() };
    let place = if backend == Backend::Cpu { "threads" } else { "backend" };
    let of_simulation =
        |source| SceneError::Simulation { place: loaded.place(place), source: Box::new(source) };
    let mut simulation = Simulation::new(options).map_err(of_simulation)?;
    simulation.set_gravity(plan.gravity);
    simulation.set_dt(plan.dt);
    simulation.set_solver(plan.settings.clone());

    let mut bodies = Vec::new();
    for (i, body) in scene.bodies.iter().enumerate() {
        bodies.push(builder.body(&mut simulation, i, body, plan.mode, &mut warnings)?);
    }
    let constraints = builder.constraints(&mut simulation, &bodies, &plan, &mut warnings)?;
    let loads = builder.loads(&mut simulation, &bodies, &plan)?;
    let resections =
        resection::build(&builder, &scene.resections, &mut simulation, &bodies, &plan)?;
    let pressures =
        builder.pressures(&mut simulation, &bodies, &constraints, &plan, &mut warnings)?;
    let probes = builder.probes(&bodies, &constraints)?;
    if plan.mode == Mode::Static || plan.settings.integrator == Integrator::QuasiStatic {
        builder.all_held(&bodies, &constraints)?;
    }
    simulation.check_backend().map_err(of_simulation)?;
    Ok(BuiltScene {
        simulation,
        bodies,
        constraints,
        loads,
        pressures,
        resections,
        probes,
        plan,
        warnings,
    })
}

/// The mesh of a generated shape.
///
/// # Errors
/// [`MeshError`] when a parameter is out of range, `Ok(None)` unless exactly one shape is given.
pub fn generate(shape: &Generate) -> Result<Option<Mesh>, MeshError> {
    let Generate { cuboid, cylinder, sphere, sheet, specimen, disc, balloon, cup } = shape;
    let shapes = [
        cuboid.as_ref().map(|s| {
            let size = DVec3::from_array(s.size);
            match s.elements {
                SolidCells::Tetrahedra => box_tets(size, s.cells),
                SolidCells::Hexahedra => box_hexahedra(size, s.cells),
                SolidCells::Irregular => {
                    irregular_box_tets(size, s.cells, 0.15, s.seed.unwrap_or(0))
                }
            }
        }),
        cylinder.as_ref().map(|s| match s.elements {
            SolidCells::Tetrahedra => cylinder_tets(s.radius, s.length, s.rings, s.layers),
            SolidCells::Hexahedra => {
                cylinder_hexahedra(s.radius, s.length, 2 * s.rings, s.rings, s.layers)
            }
            SolidCells::Irregular => cylinder_tets(s.radius, s.length, s.rings, s.layers)
                .and_then(|mesh| jitter_interior(&mesh, 0.15, 0)),
        }),
        sphere.as_ref().map(|s| sphere_tets(s.radius, s.shells)),
        sheet.as_ref().map(|s| {
            let size = DVec2::from_array(s.size);
            match s.elements {
                SheetCells::Triangles => triangle_grid(size, s.cells),
                SheetCells::Quads => quad_grid(size, s.cells),
            }
        }),
        specimen.as_ref().map(|s| {
            let cells = |i: usize| s.cells.get(i).copied().unwrap_or(0);
            let (flat, deep) = ([cells(0), cells(1)], [cells(0), cells(1), cells(2)]);
            match (s.thickness, s.solid, s.sheet.unwrap_or_default()) {
                (None, _, SheetCells::Triangles) => specimen_triangles(s.width, flat),
                (None, _, SheetCells::Quads) => specimen_quads(s.width, flat),
                (Some(t), Some(SolidCells::Hexahedra), _) => specimen_hexahedra(s.width, t, deep),
                (Some(t), ..) => specimen_tets(s.width, t, deep),
            }
        }),
        disc.as_ref().map(|s| disc_triangles(s.radius, s.rings)),
        balloon.as_ref().map(|s| sphere_triangles(s.radius, s.cuts)),
        cup.as_ref().map(|s| {
            let mesh = cup_hexahedra([s.radius, s.depth], s.wall, s.core, s.rings, s.layers)?;
            match s.elements {
                SolidCells::Hexahedra => Ok(mesh),
                SolidCells::Tetrahedra => Ok(mesh.split_into_simplices()),
                SolidCells::Irregular => jitter_interior(&mesh.split_into_simplices(), 0.15, 0),
            }
        }),
    ];
    let mut given = shapes.into_iter().flatten();
    match (given.next(), given.next()) {
        (Some(mesh), None) => mesh.map(Some),
        _ => Ok(None),
    }
}

/// Key of the value that is wrong.
fn material_key(error: &MaterialError) -> &'static str {
    match error {
        MaterialError::NonFinite { quantity, .. } if quantity.starts_with('Y') => "young_modulus",
        MaterialError::YoungModulus { .. } => "young_modulus",
        MaterialError::NonFinite { quantity, .. } if quantity.starts_with('d') => "density",
        MaterialError::Density { .. } => "density",
        MaterialError::UnknownPreset { .. } => "preset",
        _ => "poisson_ratio",
    }
}

pub(crate) struct Builder<'a> {
    loaded: &'a LoadedScene,
}

impl Builder<'_> {
    pub(crate) fn place(&self, key: impl Into<String>) -> Box<Place> {
        self.loaded.place(key)
    }

    pub(crate) fn value(
        &self,
        key: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> SceneError {
        SceneError::Value { place: self.place(key), found: found.into(), remedy: remedy.into() }
    }

    pub(crate) fn finite<const N: usize>(
        &self,
        key: &str,
        values: [f64; N],
    ) -> Result<DVec3, SceneError> {
        if values.iter().all(|x| x.is_finite()) {
            let at = |i: usize| values.get(i).copied().unwrap_or(0.0);
            Ok(DVec3::new(at(0), at(1), at(2)))
        } else {
            Err(self.value(key, format!("{values:?} is not finite"), "give finite numbers"))
        }
    }

    fn unique<'n>(
        &self,
        kind: &'static str,
        names: impl Iterator<Item = &'n str>,
    ) -> Result<(), SceneError> {
        let mut seen = HashMap::new();
        for (i, name) in names.enumerate() {
            let key = format!("{kind}[{i}].name");
            if name.trim().is_empty() {
                return Err(self.value(key, "the name is empty", "give it a name"));
            }
            if seen.insert(name, i).is_some() {
                return Err(SceneError::Duplicate {
                    place: self.place(key),
                    kind,
                    name: name.into(),
                });
            }
        }
        Ok(())
    }

    fn plan(&self, options: &BuildOptions) -> Result<Plan, SceneError> {
        let scene = &self.loaded.scene;
        let gravity = self.finite("gravity", scene.gravity)?;
        let mut settings = scene.solver.clone();
        let (dt, steps) = match scene.mode {
            Mode::Dynamic => {
                self.dynamic_only_absent("load_steps", scene.load_steps.is_some(), "static")?;
                let positive = |key: &'static str, value: Option<f64>, what: &str| {
                    let value = value.ok_or_else(|| SceneError::Missing {
                        place: self.place(key),
                        what: format!("key `{key}`"),
                        remedy: format!("a dynamic scene needs {what}, for example {key} = 0.01"),
                    })?;
                    if value > 0.0 && value.is_finite() {
                        Ok(value)
                    } else {
                        let remedy = format!("give {what}, positive and finite");
                        Err(self.value(key, format!("{key} is {value} s"), remedy))
                    }
                };
                let dt = positive("dt", scene.dt, "a step length in seconds")?;
                let duration = positive("duration", scene.duration, "a simulated time in seconds")?;
                let steps = (duration / dt - 1e-9).ceil().max(1.0);
                if dt > duration * (1.0 + 1e-9) {
                    let found = format!("dt is {dt} s, longer than the duration of {duration} s");
                    return Err(self.value("dt", found, "give a shorter step"));
                }
                if steps > 1e9 {
                    let found = format!("dt = {dt} s makes {steps:.3e} steps in {duration} s");
                    return Err(self.value("dt", found, "give a longer step (at most 1e9 steps)"));
                }
                (dt, steps as u64)
            }
            Mode::Static => {
                self.dynamic_only_absent("dt", scene.dt.is_some(), "dynamic")?;
                self.dynamic_only_absent("duration", scene.duration.is_some(), "dynamic")?;
                let steps = options.steps.unwrap_or(scene.load_steps.unwrap_or(1).into());
                if steps == 0 {
                    return Err(self.value("load_steps", "load_steps is 0", "give at least 1"));
                }
                let integrator = settings.integrator;
                if integrator != Integrator::QuasiStatic && integrator != Integrator::default() {
                    return Err(self.value(
                        "solver.integrator",
                        format!("integrator {} in a static scene", integrator.name()),
                        "leave it out, or use mode = \"dynamic\"",
                    ));
                }
                settings.integrator = Integrator::QuasiStatic;
                (1.0 / steps as f64, steps)
            }
        };
        let steps = options.steps.unwrap_or(steps);
        if steps == 0 {
            return Err(self.value("", "0 steps asked for", "give at least 1"));
        }
        settings.validate().map_err(|source| {
            let message = source.to_string();
            let key = message.split([' ', '=']).next().unwrap_or_default();
            SceneError::Setting { place: self.place(format!("solver.{key}")), source }
        })?;
        self.check_dampers(settings.integrator)?;
        let output = &scene.output;
        if let (Some(_), Some(_)) = (output.every, output.frames_per_second) {
            return Err(self.value(
                "output.every",
                "both `every` and `frames_per_second` are given",
                "keep one of them",
            ));
        }
        for (key, count) in [("every", output.every), ("probe_every", output.probe_every)] {
            if count == Some(0) {
                let key = format!("output.{key}");
                return Err(self.value(key, "0 steps", "give at least 1"));
            }
        }
        let rate = output.frames_per_second.unwrap_or(30.0);
        if !(rate > 0.0 && rate.is_finite()) {
            return Err(self.value(
                "output.frames_per_second",
                format!("{rate} frames per second"),
                "give a positive number",
            ));
        }
        let frame_every = match (output.every, scene.mode) {
            (Some(every), _) => every,
            (None, Mode::Static) => 1,
            (None, Mode::Dynamic) => ((1.0 / (rate * dt)).round() as u64).max(1),
        };
        Ok(Plan {
            mode: scene.mode,
            dt,
            steps,
            frame_every,
            probe_every: output.probe_every.unwrap_or(1),
            gravity,
            settings,
            threads: options.threads.unwrap_or(scene.threads),
        })
    }

    /// Dampers of fibres are for implicit steps in time.
    fn check_dampers(&self, integrator: Integrator) -> Result<(), SceneError> {
        for (b, body) in self.loaded.scene.bodies.iter().enumerate() {
            let Some(f) = body.fibres.iter().position(|f| f.viscosity.is_some_and(|v| v != 0.0))
            else {
                continue;
            };
            let key = format!("body[{b}].fibres[{f}].viscosity");
            self.dynamic_only_absent(&key, integrator == Integrator::QuasiStatic, "dynamic")?;
            integrator
                .check_dampers()
                .map_err(|source| SceneError::Setting { place: self.place(key), source })?;
        }
        Ok(())
    }

    fn dynamic_only_absent(
        &self,
        key: &str,
        present: bool,
        mode: &'static str,
    ) -> Result<(), SceneError> {
        if present {
            let other = if mode == "static" { "dynamic" } else { "static" };
            let found = format!("`{key}` in a {other} scene");
            return Err(self.value(
                key,
                found,
                format!("leave it out, or use mode = \"{mode}\" (see demos/scenes/README.md)"),
            ));
        }
        Ok(())
    }

    fn material(&self, key: &str, entry: &Material) -> Result<YoungPoisson, SceneError> {
        let base = match &entry.preset {
            Some(name) => {
                let found = preset(name).map_err(|source| SceneError::Material {
                    place: self.place(format!("{key}.preset")),
                    source,
                })?;
                Some(found.material)
            }
            None => None,
        };
        let pick = |name: &str, value: Option<f64>, base: Option<f64>| {
            value.or(base).ok_or_else(|| SceneError::Missing {
                place: self.place(format!("{key}.{name}")),
                what: format!("key `{name}`"),
                remedy: "give young_modulus, poisson_ratio and density, or a preset".into(),
            })
        };
        let material = YoungPoisson {
            young_modulus: pick(
                "young_modulus",
                entry.young_modulus,
                base.map(|m| m.young_modulus),
            )?,
            poisson_ratio: pick(
                "poisson_ratio",
                entry.poisson_ratio,
                base.map(|m| m.poisson_ratio),
            )?,
            density: pick("density", entry.density, base.map(|m| m.density))?,
        };
        material.validate().map_err(|source| SceneError::Material {
            place: self.place(format!("{key}.{}", material_key(&source))),
            source,
        })?;
        Ok(material)
    }

    /// Values of the solid elements from the cell data of that name, when a scene names one.
    pub(crate) fn field(
        &self,
        key: &str,
        name: Option<&String>,
        mesh: &Mesh,
    ) -> Result<Option<Vec<f64>>, SceneError> {
        let Some(name) = name else { return Ok(None) };
        match mesh.data(name) {
            Some(data) => Ok(Some([&data.tetrahedra[..], &data.hexahedra[..]].concat())),
            None if mesh.cell_data.is_empty() => Err(self.value(
                key,
                format!("there is no cell data `{name}` in {}", mesh.source),
                "use a mesh file with cell data (VTU, VTK or Gmsh's $ElementData)",
            )),
            None => {
                let known = mesh.cell_data.iter().map(|data| data.name.as_str());
                let place = self.place(key);
                let hint = hint("array", name, known);
                Err(SceneError::Unknown { place, kind: "cell data", name: name.clone(), hint })
            }
        }
    }

    /// A value of a field that cannot be used, with the array that it stands in.
    fn field_error(
        &self,
        key: &str,
        entry: &Material,
        mesh: &Mesh,
        source: FieldError,
    ) -> SceneError {
        let quantity = match &source {
            FieldError::Tetrahedron { source, .. } | FieldError::Hexahedron { source, .. } => {
                material_key(source)
            }
            _ => "",
        };
        let array = match quantity {
            "young_modulus" => &entry.young_modulus_field,
            "poisson_ratio" => &entry.poisson_ratio_field,
            _ => &entry.density_field,
        };
        SceneError::Field {
            place: self.place(format!("{key}.material.{quantity}_field")),
            mesh: mesh.source.clone(),
            array: array.clone().unwrap_or_default(),
            source: Box::new(source),
        }
    }

    /// Reads or generates the mesh of a body and puts it in place.
    fn mesh(&self, key: &str, body: &Body) -> Result<Mesh, SceneError> {
        let mesh = match (&body.mesh, &body.generate) {
            (Some(path), None) => {
                self.loaded.read_mesh(path).map_err(|source| SceneError::Mesh {
                    place: self.place(format!("{key}.mesh")),
                    source: Box::new(source),
                })?
            }
            (None, Some(shape)) => {
                let key = format!("{key}.generate");
                let mesh = generate(shape).map_err(|source| SceneError::Mesh {
                    place: self.place(&key),
                    source: Box::new(source),
                })?;
                mesh.ok_or_else(|| {
                    let remedy =
                        "give one of `box`, `cylinder`, `sphere`, `sheet`, `specimen`, `disc`, \
                         `balloon` and `cup`";
                    self.value(key, "not exactly one shape is given", remedy)
                })?
            }
            (None, None) => {
                return Err(SceneError::Missing {
                    place: self.place(key),
                    what: "the mesh".into(),
                    remedy: "give `mesh` (a file) or `generate` (a shape)".into(),
                });
            }
            (Some(_), Some(_)) => {
                let key = format!("{key}.generate");
                let found = "both `mesh` and `generate` are given";
                return Err(self.value(key, found, "keep one of them"));
            }
        };
        let scale = body.scale.unwrap_or(1.0);
        if !(scale > 0.0 && scale.is_finite()) {
            let key = format!("{key}.scale");
            return Err(self.value(key, format!("scale is {scale}"), "give a positive factor"));
        }
        let rotation = match &body.rotate {
            Some(Rotation { axis, degrees }) => {
                let key = format!("{key}.rotate");
                let axis = self.axis(&key, *axis)?;
                self.finite(&format!("{key}.degrees"), [*degrees])?;
                rotation(axis, degrees.to_radians())
            }
            None => DQuat::IDENTITY,
        };
        let translation =
            self.finite(&format!("{key}.translate"), body.translate.unwrap_or_default())?;
        Ok(mesh.transformed(scale, rotation, translation))
    }

    fn axis(&self, key: &str, axis: [f64; 3]) -> Result<DVec3, SceneError> {
        let key = format!("{key}.axis");
        let axis = self.finite(&key, axis)?;
        axis.try_normalize()
            .ok_or_else(|| self.value(key, "the axis has no length", "give a direction"))
    }

    fn body(
        &self,
        simulation: &mut Simulation,
        index: usize,
        body: &Body,
        mode: Mode,
        warnings: &mut Vec<Warning>,
    ) -> Result<BuiltBody, SceneError> {
        let key = format!("body[{index}]");
        let material = self.material(&format!("{key}.material"), &body.material)?;
        let mesh = self.mesh(&key, body)?;
        let mesh_key =
            if body.mesh.is_some() { format!("{key}.mesh") } else { format!("{key}.generate") };
        let mut checked = check(&mesh, &CheckOptions::default())
            .map_err(|source| SceneError::Check { place: self.place(&mesh_key), source })?;
        let membrane = match &body.membrane {
            Some(entry) => Some(self.membrane(&key, entry, &checked.mesh, material)?),
            None => None,
        };
        if !checked.mesh.is_solid() && membrane.is_none() {
            return Err(self.value(
                mesh_key,
                "the mesh has faces but no tetrahedra or hexahedra",
                "give them a thickness, membrane = { thickness = 0.001 }, or fill the mesh with \
                 tetrahedra (Gmsh, TetGen)",
            ));
        }
        if let Some(m) = &membrane {
            let used = &mut checked.used_vertices;
            *used = checked.mesh.tetrahedra.as_flattened().to_vec();
            used.extend(checked.mesh.hexahedra.as_flattened());
            used.extend(m.triangles.as_flattened());
            used.extend(m.quads.as_flattened());
            used.sort_unstable();
            used.dedup();
            // the check does not know of the membrane
            let unused = checked.mesh.points.len() - used.len();
            let findings = &mut checked.report.findings;
            findings.retain(|f| f.code != FindingCode::UnusedVertices || unused > 0);
            for finding in findings.iter_mut().filter(|f| f.code == FindingCode::UnusedVertices) {
                (finding.count, finding.entity) = (unused, String::new());
                finding.message =
                    format!("{unused} vertices belong to no element and are left out");
            }
        }
        warnings.extend(checked.report.findings.iter().map(|finding| Warning {
            code: format!("mesh.{}", finding.code),
            level: match finding.severity {
                Severity::Info => Level::Note,
                _ => Level::Warning,
            },
            subject: format!("body `{}`", body.name),
            message: if finding.entity.is_empty() {
                finding.message.clone()
            } else {
                format!("{}: {}", finding.message, finding.entity)
            },
            remedy: finding.remedy.clone(),
        }));
        warnings.extend(material.findings().into_iter().map(|finding| Warning {
            code: finding.code.into(),
            level: Level::Warning,
            subject: format!("body `{}`", body.name),
            message: finding.message,
            remedy: finding.remedy.into(),
        }));
        let entry = &body.material;
        let field = |quantity: &str, name: &Option<String>| {
            self.field(&format!("{key}.material.{quantity}_field"), name.as_ref(), &checked.mesh)
        };
        let young_modulus = field("young_modulus", &entry.young_modulus_field)?;
        let poisson_ratio = field("poisson_ratio", &entry.poisson_ratio_field)?;
        let density = field("density", &entry.density_field)?;
        let axes = axes::build(self, &key, body, &checked.mesh, mode, warnings)?;
        let description = BodyDescription {
            axes: axes.clone(),
            young_modulus: young_modulus.as_deref(),
            poisson_ratio: poisson_ratio.as_deref(),
            density: density.as_deref(),
            model: body.model,
            evaluation: body.evaluation,
            springs: body.element_method,
            membrane: membrane.as_ref().map(|m| m.settings.of(&m.triangles, &m.quads)),
            ..BodyDescription::new(&body.name, &checked.mesh, material)
        };
        description
            .material_field()
            .validate(checked.mesh.tetrahedra.len(), checked.mesh.hexahedra.len())
            .map_err(|source| self.field_error(&key, entry, &checked.mesh, source))?;
        let mass = match description.density {
            Some(density) => {
                let mesh = &checked.mesh;
                let tetrahedra = mesh.tetrahedra.iter().map(|&t| mesh.signed_volume(t));
                let hexahedra = mesh.hexahedra.iter().map(|&h| mesh.hexahedron_volume(h));
                let volumes = tetrahedra.chain(hexahedra).map(|volume| volume.unwrap_or(0.0));
                volumes.zip(density).map(|(volume, rho)| rho * volume).sum()
            }
            None => checked.report.statistics.total_volume * material.density,
        };
        let sheet = membrane.as_ref().map_or(0.0, |m| m.area * m.settings.surface().1);
        let handle = simulation.add_body(&description).map_err(|source| SceneError::Body {
            place: self.place(mesh_key),
            source: Box::new(source),
        })?;
        Ok(BuiltBody {
            name: body.name.clone(),
            handle,
            mesh: checked.mesh,
            report: checked.report,
            used_vertices: checked.used_vertices,
            material,
            mass: mass + sheet,
            membrane,
            preset: body.material.preset.clone(),
            model: body.model,
            evaluation: body.evaluation,
            element_method: body.element_method,
            axes,
        })
    }

    /// The membrane of a body: its triangles, and what they are made of.
    fn membrane(
        &self,
        body: &str,
        entry: &Membrane,
        mesh: &Mesh,
        base: YoungPoisson,
    ) -> Result<BuiltMembrane, SceneError> {
        let key = format!("{body}.membrane");
        let material = match &entry.material {
            Some(own) => self.material(&format!("{key}.material"), own)?,
            None => base,
        };
        if !(entry.thickness > 0.0 && entry.thickness.is_finite()) {
            let key = format!("{key}.thickness");
            let found = format!("the thickness is {} m", entry.thickness);
            return Err(self.value(key, found, "make it positive and finite"));
        }
        if !entry.model.supports(entry.evaluation) {
            let found = format!("model \"{}\" has no pooled evaluation", entry.model.name());
            return Err(self.value(format!("{key}.evaluation"), found, "leave it out"));
        }
        let (triangles, quads) = match (&entry.group, entry.surface) {
            (Some(group), None) => self.group_cells(&key, group, mesh)?,
            (None, Some(true)) => {
                let surface = mesh.surface();
                (surface.triangles, surface.quads)
            }
            (None, None) if !mesh.is_solid() => (mesh.triangles.clone(), mesh.quads.clone()),
            _ => {
                let found = "not exactly one kind of cells is given";
                return Err(self.value(key, found, "give `group`, or `surface = true`"));
            }
        };
        if triangles.is_empty() && quads.is_empty() {
            let found = "it has no triangles and no quadrilaterals";
            return Err(self.value(key, found, "choose other ones"));
        }
        let twice = |points: &[u32]| {
            let sides = (0..points.len()).map(|i| {
                let [a, b] = [points[i], points[(i + 1) % points.len()]];
                mesh.points[a as usize].cross(mesh.points[b as usize])
            });
            sides.sum::<DVec3>().length()
        };
        let areas = triangles.iter().map(|t| twice(t)).chain(quads.iter().map(|q| twice(q)));
        let area = 0.5 * areas.sum::<f64>();
        let Membrane { thickness, plane, model, evaluation, element_method: springs, .. } = *entry;
        let settings = MembraneSettings { thickness, material, plane, model, evaluation, springs };
        Ok(BuiltMembrane { triangles, quads, settings, area })
    }

    /// Triangles and quadrilaterals of the groups of that name, at least one.
    fn group_cells(
        &self,
        key: &str,
        name: &str,
        mesh: &Mesh,
    ) -> Result<(Vec<[u32; 3]>, Vec<[u32; 4]>), SceneError> {
        let place = || self.place(format!("{key}.group"));
        if mesh.group(name).is_none() {
            let hint = hint("group", name, mesh.groups.iter().map(|g| g.name.as_str()));
            let name = name.to_string();
            return Err(SceneError::Unknown { place: place(), kind: "group", name, hint });
        }
        let (mut triangles, mut quads) = (Vec::new(), Vec::new());
        for group in mesh.groups.iter().filter(|g| g.name == name) {
            triangles.extend(group.triangles.iter().map(|&t| mesh.triangles[t as usize]));
            quads.extend(group.quads.iter().map(|&q| mesh.quads[q as usize]));
        }
        if triangles.is_empty() && quads.is_empty() {
            let found = format!("group `{name}` has no triangles and no quadrilaterals");
            let has = |g: &&Group| !g.triangles.is_empty() || !g.quads.is_empty();
            let with: Vec<&str> = mesh.groups.iter().filter(has).map(|g| g.name.as_str()).collect();
            let remedy = format!("groups with such cells: {}", with.join(", "));
            return Err(self.value(format!("{key}.group"), found, remedy));
        }
        Ok((triangles, quads))
    }

    fn pressures(
        &self,
        simulation: &mut Simulation,
        bodies: &[BuiltBody],
        constraints: &[BuiltConstraint],
        plan: &Plan,
        warnings: &mut Vec<Warning>,
    ) -> Result<Vec<BuiltPressure>, SceneError> {
        let entries = &self.loaded.scene.pressures;
        self.unique("pressure", entries.iter().map(|p| p.name.as_str()))?;
        let mut built = Vec::new();
        for (i, entry) in entries.iter().enumerate() {
            let key = format!("pressure[{i}]");
            let body = self.which(&key, entry.body.as_deref(), bodies)?;
            let (triangles, share) = self.faces(&format!("{key}.on"), &entry.on, &bodies[body])?;
            self.finite(&format!("{key}.pressure"), [entry.pressure])?;
            let curve = self.factor(&key, entry.curve.as_ref(), plan.mode)?;
            // a rim vertex that is free along every axis
            let mut edges = HashMap::new();
            for &[a, b, c] in &triangles {
                for (a, b) in [(a, b), (b, c), (c, a)] {
                    let (count, turns) = edges.entry((a.min(b), a.max(b))).or_insert((0, 0));
                    *count += 1;
                    *turns += if a < b { 1 } else { -1 };
                }
            }
            let held = |v: u32| {
                let mut own = constraints.iter().filter(|c| c.body == body);
                own.any(|c| c.vertices.binary_search(&v).is_ok())
            };
            // faces that are cut twice share their diagonals, which they pass in opposite directions
            let rim = edges.iter().filter(
                |(_, (count, turns))| {
                    if share == 1.0 { *count == 1 } else { *turns != 0 }
                },
            );
            let free = rim.filter(|((a, b), _)| !held(*a) || !held(*b)).count();
            if free > 0 {
                warnings.push(Warning {
                    code: "scene.pressure.rim".into(),
                    level: Level::Note,
                    subject: format!("pressure `{}`", entry.name),
                    message: format!(
                        "{free} edges of its rim are free to move: there it has no potential, and \
                         energies of implicit steps are approximate"
                    ),
                    remedy: "hold the rim, or put it on a closed surface, for exact energies"
                        .into(),
                });
            }
            let (name, count) = (entry.name.clone(), triangles.len());
            let faces =
                simulation.face_rows(bodies[body].handle, &name, &triangles).map_err(|source| {
                    SceneError::Simulation {
                        place: self.place(format!("{key}.on")),
                        source: Box::new(source),
                    }
                })?;
            let pressure = entry.pressure * share;
            simulation.add_pressure(Pressure { name: name.clone(), faces, pressure, curve });
            let pressure = entry.pressure;
            built.push(BuiltPressure { name, body, triangles: count, pressure });
        }
        Ok(built)
    }

    /// Triangles that a pressure pushes along their normals, and the share of the pressure that each gets: with
    /// quadrilaterals among them half, because these are cut along both diagonals, so that every corner gets
    /// what its shape function gives it, and triangles come twice.
    fn faces(
        &self,
        key: &str,
        on: &Faces,
        body: &BuiltBody,
    ) -> Result<(Vec<[u32; 3]>, f64), SceneError> {
        let sorted = |cell: &[u32]| {
            let mut cell = cell.to_vec();
            cell.sort_unstable();
            cell
        };
        let (triangles, quads) = match (&on.group, on.surface, on.membrane) {
            (Some(group), None, None) => {
                let surface = body.mesh.surface();
                let outward: HashMap<Vec<u32>, [u32; 3]> =
                    surface.triangles.iter().map(|t| (sorted(t), *t)).collect();
                let outward_quads: HashMap<Vec<u32>, [u32; 4]> =
                    surface.quads.iter().map(|q| (sorted(q), *q)).collect();
                let (mut triangles, mut quads) = self.group_cells(key, group, &body.mesh)?;
                for t in &mut triangles {
                    *t = outward.get(&sorted(t)).map_or(*t, |&[a, b, c]| [a, c, b]);
                }
                for q in &mut quads {
                    *q = outward_quads.get(&sorted(q)).map_or(*q, |&[a, b, c, d]| [a, d, c, b]);
                }
                (triangles, quads)
            }
            (None, Some(true), None) => {
                let surface = body.mesh.surface();
                let triangles = surface.triangles.into_iter().map(|[a, b, c]| [a, c, b]);
                let quads = surface.quads.into_iter().map(|[a, b, c, d]| [a, d, c, b]);
                (triangles.collect(), quads.collect())
            }
            (None, None, Some(true)) => {
                (body.membrane_triangles().to_vec(), body.membrane_quads().to_vec())
            }
            _ => {
                return Err(self.value(
                    key,
                    "not exactly one kind of faces is given",
                    "give one of `group`, `surface = true` and `membrane = true`",
                ));
            }
        };
        if triangles.is_empty() && quads.is_empty() {
            let found = format!("body `{}` has no such triangles", body.name);
            return Err(self.value(key, found, "choose other ones, or give the body a membrane"));
        }
        if quads.is_empty() {
            return Ok((triangles, 1.0));
        }
        let cut = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d], [b, c, d], [a, b, d]];
        let twice = triangles.iter().chain(&triangles).copied();
        Ok((twice.chain(quads.into_iter().flat_map(cut)).collect(), 0.5))
    }

    /// The body of that name, or the only one.
    pub(crate) fn which(
        &self,
        key: &str,
        name: Option<&str>,
        bodies: &[BuiltBody],
    ) -> Result<usize, SceneError> {
        let place = || self.place(format!("{key}.body"));
        match name {
            Some(name) => bodies.iter().position(|b| b.name == name).ok_or_else(|| {
                let hint = hint("body", name, bodies.iter().map(|b| b.name.as_str()));
                SceneError::Unknown { place: place(), kind: "body", name: name.into(), hint }
            }),
            None if bodies.len() == 1 => Ok(0),
            None => Err(SceneError::Missing {
                place: place(),
                what: "key `body`".into(),
                remedy: format!("the scene has {} bodies, say which one is meant", bodies.len()),
            }),
        }
    }

    /// Sorted vertices of a selection, at least one.
    fn select(
        &self,
        key: &str,
        selection: &Selection,
        body: &BuiltBody,
    ) -> Result<Vec<u32>, SceneError> {
        let Selection { group, vertices, cuboid, sphere, all } = selection;
        let given = [
            group.is_some(),
            vertices.is_some(),
            cuboid.is_some(),
            sphere.is_some(),
            all.is_some(),
        ];
        if given.iter().filter(|&&g| g).count() != 1 {
            return Err(self.value(
                key,
                "not exactly one kind of selection is given",
                "give one of `group`, `vertices`, `box`, `sphere` and `all = true`",
            ));
        }
        let points = &body.mesh.points;
        let within = |test: &dyn Fn(DVec3) -> bool| -> Vec<u32> {
            body.used_vertices.iter().copied().filter(|&v| test(points[v as usize])).collect()
        };
        let (chosen, remedy) = if let Some(name) = group {
            let groups = body.mesh.groups.iter().filter(|g| g.name == *name);
            let mut chosen: Vec<u32> = groups.flat_map(|g| g.vertices.iter().copied()).collect();
            if !body.mesh.groups.iter().any(|g| g.name == *name) {
                let known = body.mesh.groups.iter().map(|g| g.name.as_str());
                let place = self.place(format!("{key}.group"));
                let mut hint = hint("group", name, known.clone());
                if hint.starts_with("did") {
                    let all: Vec<&str> = known.collect();
                    hint.push_str(&format!(" groups of the mesh: {}", all.join(", ")));
                }
                return Err(SceneError::Unknown { place, kind: "group", name: name.clone(), hint });
            }
            chosen.sort_unstable();
            chosen.dedup();
            chosen.retain(|v| body.used_vertices.binary_search(v).is_ok());
            (chosen, "the group has no vertex that an element uses".to_string())
        } else if let Some(vertices) = vertices {
            if let Some(&vertex) = vertices.iter().find(|&&v| v as usize >= points.len()) {
                return Err(SceneError::VertexIndex {
                    place: self.place(format!("{key}.vertices")),
                    body: body.name.clone(),
                    vertex,
                    count: points.len(),
                });
            }
            if let Some(vertex) =
                vertices.iter().find(|v| body.used_vertices.binary_search(v).is_err())
            {
                return Err(self.value(
                    format!("{key}.vertices"),
                    format!("no element uses vertex {vertex} of body `{}`", body.name),
                    "leave it out",
                ));
            }
            let mut chosen = vertices.clone();
            chosen.sort_unstable();
            chosen.dedup();
            (chosen, "the list is empty".to_string())
        } else if let Some(region) = cuboid {
            let low = self.finite(&format!("{key}.box.min"), region.min)?;
            let high = self.finite(&format!("{key}.box.max"), region.max)?;
            if !low.cmple(high).all() {
                let found = format!("min {low} is not below max {high}");
                return Err(self.value(format!("{key}.box"), found, "exchange the corners"));
            }
            (within(&|p| p.cmpge(low).all() && p.cmple(high).all()), bounds_remedy(body))
        } else if let Some(region) = sphere {
            let centre = self.finite(&format!("{key}.sphere.centre"), region.centre)?;
            let radius = region.radius;
            if !(radius > 0.0 && radius.is_finite()) {
                let key = format!("{key}.sphere.radius");
                return Err(self.value(key, format!("radius is {radius} m"), "make it positive"));
            }
            (within(&|p| p.distance(centre) <= radius), bounds_remedy(body))
        } else if *all == Some(true) {
            (body.used_vertices.clone(), String::new())
        } else {
            let key = format!("{key}.all");
            return Err(self.value(key, "`all = false` selects nothing", "give another selection"));
        };
        if chosen.is_empty() {
            let (place, body) = (self.place(key), body.name.clone());
            return Err(SceneError::EmptySelection { place, body, remedy });
        }
        Ok(chosen)
    }

    fn curve(&self, key: &str, entry: &CurveEntry) -> Result<Curve, SceneError> {
        let CurveEntry { hold, ramp, release, pulse, points, sine } = entry;
        let given = [
            hold.is_some(),
            ramp.is_some(),
            release.is_some(),
            pulse.is_some(),
            points.is_some(),
            sine.is_some(),
        ];
        if given.iter().filter(|&&g| g).count() != 1 {
            return Err(self.value(
                key,
                "not exactly one kind of curve is given",
                "give one of `hold`, `ramp`, `release`, `pulse`, `points` and `sine`",
            ));
        }
        let (name, list) = if let Some(factor) = hold {
            ("hold", vec![[0.0, *factor]])
        } else if let Some([a, b]) = ramp {
            ("ramp", vec![[*a, 0.0], [*b, 1.0]])
        } else if let Some([a, b]) = release {
            ("release", vec![[*a, 1.0], [*b, 0.0]])
        } else if let Some([a, b, c, d]) = pulse {
            ("pulse", vec![[*a, 0.0], [*b, 1.0], [*c, 1.0], [*d, 0.0]])
        } else if let Some(points) = points {
            ("points", points.clone())
        } else if let Some(sine) = sine {
            self.finite(&format!("{key}.sine"), [sine.frequency, sine.degrees])?;
            return Ok(Curve::Sine { frequency: sine.frequency, phase: sine.degrees.to_radians() });
        } else {
            ("points", Vec::new())
        };
        let key = format!("{key}.{name}");
        if list.is_empty() {
            return Err(self.value(key, "the list is empty", "give [time, factor] pairs"));
        }
        if !list.iter().flatten().all(|x| x.is_finite()) {
            return Err(self.value(key, "a number is not finite", "give finite numbers"));
        }
        if let Some(pair) = list.windows(2).find(|pair| pair[0][0] >= pair[1][0]) {
            let found = format!("time {} s follows time {} s", pair[1][0], pair[0][0]);
            return Err(self.value(key, found, "give times in ascending order"));
        }
        Ok(Curve::Points(list))
    }

    /// The curve of a static scene: loads and motions grow with the load steps.
    pub(crate) fn factor(
        &self,
        key: &str,
        entry: Option<&CurveEntry>,
        mode: Mode,
    ) -> Result<Curve, SceneError> {
        match (mode, entry) {
            (Mode::Static, Some(_)) => Err(self.value(
                format!("{key}.curve"),
                "a curve in a static scene",
                "leave it out, a static scene has no time (loads grow over `load_steps`)",
            )),
            (Mode::Static, None) => Ok(Curve::ramp(0.0, 1.0)),
            (Mode::Dynamic, Some(entry)) => self.curve(&format!("{key}.curve"), entry),
            (Mode::Dynamic, None) => Ok(Curve::Constant),
        }
    }

    fn constraints(
        &self,
        simulation: &mut Simulation,
        bodies: &[BuiltBody],
        plan: &Plan,
        warnings: &mut Vec<Warning>,
    ) -> Result<Vec<BuiltConstraint>, SceneError> {
        let mut built: Vec<BuiltConstraint> = Vec::new();
        for (i, entry) in self.loaded.scene.constraints.iter().enumerate() {
            let key = format!("constraint[{i}]");
            let body = self.which(&key, entry.body.as_deref(), bodies)?;
            let vertices = self.select(&format!("{key}.select"), &entry.select, &bodies[body])?;
            let axes = self.axes(&key, entry.axes.as_deref())?;
            let motion_key = format!("{key}.motion");
            let (motion, words) = match entry.motion.as_ref().map(|m| (&m.translate, &m.rotate)) {
                None => (Motion::Hold, "held".to_string()),
                Some((Some(d), None)) => {
                    let d = self.finite(&format!("{motion_key}.translate"), *d)?;
                    (Motion::Translate(d), format!("moved by [{}, {}, {}] m", d.x, d.y, d.z))
                }
                Some((None, Some(turn))) => {
                    let key = format!("{motion_key}.rotate");
                    let axis = self.axis(&key, turn.axis)?;
                    let centre = self.finite(&format!("{key}.centre"), turn.centre)?;
                    self.finite(&format!("{key}.degrees"), [turn.degrees])?;
                    let angle = turn.degrees.to_radians();
                    let words = format!("turned by {} degrees", turn.degrees);
                    (Motion::Rotate { centre, axis, angle }, words)
                }
                Some(_) => {
                    return Err(self.value(
                        motion_key,
                        "not exactly one motion is given",
                        "give `translate` or `rotate`",
                    ));
                }
            };
            if entry.motion.is_none() && entry.curve.is_some() {
                return Err(self.value(
                    format!("{key}.curve"),
                    "a curve without a motion",
                    "add `motion`, or use `from` and `until` to hold and release",
                ));
            }
            let curve = self.factor(&key, entry.curve.as_ref(), plan.mode)?;
            let from = entry.from.unwrap_or(f64::NEG_INFINITY);
            let until = entry.until.unwrap_or(f64::INFINITY);
            for (name, value) in [("from", entry.from), ("until", entry.until)] {
                let Some(value) = value else { continue };
                let key = format!("{key}.{name}");
                if plan.mode == Mode::Static {
                    let found = format!("`{name}` in a static scene");
                    return Err(self.value(key, found, "leave it out, there is no time"));
                }
                self.finite(&key, [value])?;
            }
            if from >= until {
                let found = format!("it acts from {from} s until {until} s");
                let key = format!("{key}.until");
                return Err(self.value(key, found, "make `until` later than `from`"));
            }
            let jumps = entry.motion.is_some() && entry.curve.is_none();
            if plan.mode == Mode::Dynamic && jumps {
                warnings.push(Warning {
                    code: "scene.motion.jump".into(),
                    level: Level::Warning,
                    subject: format!("constraint `{}`", entry.name),
                    message: "the whole motion happens in its first step".into(),
                    remedy: "add a curve such as `curve = { ramp = [0.0, 1.0] }`".into(),
                });
            }
            for other in &built {
                let shared = if other.body == body && other.axes.0 & axes.0 != 0 {
                    vertices.iter().filter(|v| other.vertices.binary_search(v).is_ok()).count()
                } else {
                    0
                };
                if shared > 0 && from < other.until && other.from < until {
                    warnings.push(Warning {
                        code: "scene.constraint.overlap".into(),
                        level: Level::Warning,
                        subject: format!("constraint `{}`", entry.name),
                        message: format!(
                            "{shared} of its vertices are held by `{}` too",
                            other.name
                        ),
                        remedy: "the later entry wins; make the selections disjoint".into(),
                    });
                }
            }
            let rows =
                simulation.rows(bodies[body].handle, &entry.name, &vertices).map_err(|source| {
                    SceneError::Simulation { place: self.place(&key), source: Box::new(source) }
                })?;
            let mut constraint = Constraint::moving(entry.name.clone(), rows, motion, curve);
            constraint.axes = axes;
            constraint.from = from;
            constraint.until = until;
            let entity = simulation.add_constraint(constraint);
            let (name, motion) = (entry.name.clone(), words);
            built.push(BuiltConstraint { name, body, entity, vertices, axes, from, until, motion });
        }
        Ok(built)
    }

    fn axes(&self, key: &str, axes: Option<&str>) -> Result<FixedAxes, SceneError> {
        let Some(axes) = axes else { return Ok(FixedAxes::ALL) };
        let mut bits = 0u8;
        for letter in axes.chars() {
            let bit = match letter {
                'x' => 1,
                'y' => 2,
                'z' => 4,
                _ => 0,
            };
            if bit == 0 || bits & bit != 0 {
                bits = 0;
                break;
            }
            bits |= bit;
        }
        if bits == 0 {
            return Err(self.value(
                format!("{key}.axes"),
                format!("axes are \"{axes}\""),
                "use the letters x, y and z, each at most once, such as \"xyz\" or \"z\"",
            ));
        }
        Ok(FixedAxes(bits))
    }

    fn loads(
        &self,
        simulation: &mut Simulation,
        bodies: &[BuiltBody],
        plan: &Plan,
    ) -> Result<Vec<BuiltLoad>, SceneError> {
        let mut built = Vec::new();
        for (i, entry) in self.loaded.scene.loads.iter().enumerate() {
            let key = format!("load[{i}]");
            let body = self.which(&key, entry.body.as_deref(), bodies)?;
            let vertices = self.select(&format!("{key}.select"), &entry.select, &bodies[body])?;
            let force = self.finite(&format!("{key}.force"), entry.force)?;
            let curve = self.factor(&key, entry.curve.as_ref(), plan.mode)?;
            let rows =
                simulation.rows(bodies[body].handle, &entry.name, &vertices).map_err(|source| {
                    SceneError::Simulation { place: self.place(&key), source: Box::new(source) }
                })?;
            let share = force / rows.len() as f64;
            let forces = rows.iter().map(|&row| (row, share)).collect();
            let name = entry.name.clone();
            simulation.add_load(Load { name: name.clone(), forces, curve });
            built.push(BuiltLoad { name, body, vertices: rows.len(), force });
        }
        Ok(built)
    }

    fn probes(
        &self,
        bodies: &[BuiltBody],
        constraints: &[BuiltConstraint],
    ) -> Result<Vec<BuiltProbe>, SceneError> {
        let mut built = Vec::new();
        for (i, entry) in self.loaded.scene.probes.iter().enumerate() {
            let key = format!("probe[{i}]");
            let Probe { name, body, select, constraint, record } = entry;
            if record.is_empty() {
                let found = "nothing to record";
                return Err(self.value(format!("{key}.record"), found, "name a quantity"));
            }
            let reaction = record.contains(&Quantity::Reaction);
            let constraint = match constraint {
                Some(wanted) => {
                    let known = || constraints.iter().map(|c| c.name.as_str());
                    let found = known().position(|name| name == wanted).ok_or_else(|| {
                        SceneError::Unknown {
                            place: self.place(format!("{key}.constraint")),
                            kind: "constraint",
                            name: wanted.clone(),
                            hint: hint("constraint", wanted, known()),
                        }
                    })?;
                    if !reaction {
                        let found = "a constraint, but no \"reaction\" to record";
                        let remedy = "add \"reaction\" to `record`, or leave `constraint` out";
                        return Err(self.value(format!("{key}.constraint"), found, remedy));
                    }
                    Some(found)
                }
                None if reaction => {
                    return Err(SceneError::Missing {
                        place: self.place(format!("{key}.constraint")),
                        what: "key `constraint`".into(),
                        remedy: "\"reaction\" is the force of a constraint, name it".into(),
                    });
                }
                None => None,
            };
            let only_scene = record.iter().all(|q| {
                matches!(q, Quantity::ElasticEnergy | Quantity::KineticEnergy | Quantity::Reaction)
            });
            let body = match (constraint, body) {
                // the selection of a reaction is that of its constraint
                (Some(index), None) => constraints[index].body,
                (None, None) if only_scene => 0,
                _ => self.which(&key, body.as_deref(), bodies)?,
            };
            let vertices = match (select, constraint) {
                (Some(select), _) => {
                    self.select(&format!("{key}.select"), select, &bodies[body])?
                }
                (None, Some(index)) if constraints[index].body == body => {
                    constraints[index].vertices.clone()
                }
                _ => bodies[body].used_vertices.clone(),
            };
            let mut faces = Vec::new();
            if record.contains(&Quantity::EnclosedVolume) {
                let key = format!("{key}.select");
                let Some(group) = select.as_ref().and_then(|s| s.group.as_ref()) else {
                    let found = "\"enclosed_volume\" without a group of faces";
                    return Err(self.value(key, found, "give `select = { group = ... }`"));
                };
                let (triangles, quads) = self.group_cells(&key, group, &bodies[body].mesh)?;
                faces = triangles;
                faces.extend(quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]));
            }
            let (name, record) = (name.clone(), record.clone());
            built.push(BuiltProbe { name, body, vertices, faces, constraint, record });
        }
        Ok(built)
    }

    /// Every body of a static scene is held against rigid motion, as far as counting tells.
    fn all_held(
        &self,
        bodies: &[BuiltBody],
        constraints: &[BuiltConstraint],
    ) -> Result<(), SceneError> {
        for (i, body) in bodies.iter().enumerate() {
            let held = constraints.iter().filter(|c| c.body == i).fold(0, |h, c| h | c.axes.0);
            let free: Vec<&str> = ["x", "y", "z"]
                .into_iter()
                .enumerate()
                .filter_map(|(k, name)| (held >> k & 1 == 0).then_some(name))
                .collect();
            // six rigid motions need six held unknowns; a vertex in two constraints counts once
            let mut unknowns: Vec<(u32, usize)> = constraints
                .iter()
                .filter(|c| c.body == i)
                .flat_map(|c| c.vertices.iter().map(move |&v| (v, c.axes)))
                .flat_map(|(v, axes)| (0..3).filter(move |&k| axes.holds(k)).map(move |k| (v, k)))
                .collect();
            unknowns.sort_unstable();
            unknowns.dedup();
            let motion = if !free.is_empty() {
                format!("translation along {}", free.join(", "))
            } else if unknowns.len() < 6 {
                format!("rotation ({} unknowns are held, at least 6 are needed)", unknowns.len())
            } else {
                continue;
            };
            let (place, body) = (self.place(format!("body[{i}].name")), body.name.clone());
            return Err(SceneError::NotHeld { place, body, motion });
        }
        Ok(())
    }
}

fn bounds_remedy(body: &BuiltBody) -> String {
    match body.mesh.bounds() {
        Some((low, high)) => format!(
            "the body reaches from [{:.4}, {:.4}, {:.4}] to [{:.4}, {:.4}, {:.4}] m",
            low.x, low.y, low.z, high.x, high.y, high.z
        ),
        None => "the body has no points".into(),
    }
}
