//! The doors of a simulation, by handles. `package/sinew/_simulation.py` makes objects of them.

use crate::engine::{Shared, guarded, refreshed};
use crate::error::{panic_text, raise};
use crate::input::*;
use crate::live::{HapticDevice, Reader};
use crate::mesh::Mesh;
use numpy::prelude::*;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use sinew_embed::*;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};

/// Numbers in a row.
type Array<'py, T> = Bound<'py, PyArray1<T>>;

/// A simulation.
#[pyclass(frozen, module = "sinew._native")]
pub struct Engine(pub Shared);

/// The state of a simulation at one time. It can be pickled: the package says how.
#[pyclass(frozen, module = "sinew._native")]
pub struct Snapshot(sinew_embed::Snapshot);

#[pymethods]
impl Snapshot {
    /// As bytes, for a file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let bytes = py.detach(|| self.0.to_bytes());
        PyBytes::new(py, &bytes)
    }

    /// Reads what `to_bytes` wrote.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Self> {
        py.detach(|| sinew_embed::Snapshot::from_bytes(bytes)).map(Self).map_err(raise)
    }
}

/// Calls what makes a simulation; a panic in it is an error.
fn made(make: impl FnOnce() -> Result<Embedding> + Send) -> PyResult<Engine> {
    let panicked = |payload: Box<dyn std::any::Any + Send>| {
        Err(EmbedError::new(Code::Panic, panic_text(&*payload)))
    };
    let make = || catch_unwind(AssertUnwindSafe(make)).unwrap_or_else(panicked);
    let own = Python::attach(|py| py.detach(make));
    own.map(|own| Engine(Shared::new(own))).map_err(raise)
}

/// What a program says about how a simulation is carried out; what is `None` is as it is by default.
#[derive(FromPyObject)]
struct Choices {
    precision: Option<String>,
    backend: Option<String>,
    threads: Option<usize>,
    executor: Option<String>,
    instruction_set: Option<String>,
    steps: Option<u64>,
}

impl Choices {
    fn overrides(&self) -> Result<Overrides> {
        fn named<T: DeserializeOwned>(
            kind: &'static str,
            own: &Option<String>,
        ) -> Result<Option<T>> {
            own.as_deref().map(|name| choice(kind, name)).transpose()
        }
        Ok(Overrides {
            precision: named::<PrecisionName>("precision", &self.precision)?.map(Into::into),
            backend: named::<BackendName>("backend", &self.backend)?.map(Into::into),
            threads: self.threads,
            executor: named::<ExecutorName>("executor", &self.executor)?.map(Into::into),
            instruction_set: named("instruction set", &self.instruction_set)?,
            steps: self.steps,
            ..Overrides::default()
        })
    }
}

/// Files that a scene names, asked of a Python function that answers `bytes`.
fn files(read: Py<PyAny>) -> impl Fn(&str) -> io::Result<Vec<u8>> + Send + Sync {
    move |path| {
        Python::attach(|py| {
            let bytes = read.bind(py).call1((path,)).map_err(io::Error::other)?;
            let bytes = bytes.cast::<PyBytes>().map_err(|e| io::Error::other(PyErr::from(e)))?;
            Ok(bytes.as_bytes().to_vec())
        })
    }
}

fn json(own: &impl serde::Serialize) -> String {
    serde_json::to_string(own).unwrap_or_default()
}

fn kind(name: &str) -> Result<Kind> {
    let named = Kind::ALL.into_iter().find(|kind| kind.name() == name);
    named.ok_or_else(|| invalid(format!("unknown kind `{name}`")))
}

/// Elements by their kind.
fn element_kind(name: &str) -> Result<ElementKind> {
    Ok(match name {
        "tetrahedra" => ElementKind::Tetrahedron,
        "triangles" => ElementKind::Triangle,
        "hexahedra" => ElementKind::Hexahedron,
        "quads" => ElementKind::Quad,
        _ => return Err(invalid(format!("unknown kind of elements `{name}`"))),
    })
}

fn region(kind: &str, list: Indices, numbers: &[f64]) -> Result<Region> {
    let vector = |own: &[f64]| DVec3::from_slice(own);
    Ok(match (kind, numbers) {
        ("sphere", &[x, y, z, radius]) => Region::Sphere { centre: DVec3::new(x, y, z), radius },
        ("capsule", own) if own.len() == 7 => {
            let (from, to) = (vector(&own[..3]), vector(&own[3..6]));
            Region::Capsule { from, to, radius: own[6] }
        }
        ("strain", &[above]) => Region::Strain { above },
        ("stress", &[above]) => Region::Stress { above },
        _ => match element_kind(kind)? {
            ElementKind::Tetrahedron => Region::Tetrahedra(list.0),
            ElementKind::Triangle => Region::Triangles(list.0),
            ElementKind::Hexahedron => Region::Hexahedra(list.0),
            ElementKind::Quad => Region::Quads(list.0),
        },
    })
}

fn add_body(
    own: &mut Embedding,
    name: &str,
    mesh: &sinew_embed::Mesh,
    spec: BodyIn,
) -> Result<Handle> {
    let [young_modulus, poisson_ratio, density] = spec.material.arrays();
    let cells = spec.membrane.as_ref().map(|membrane| membrane.faces(mesh)).transpose()?;
    let membrane = match (&cells, &spec.membrane) {
        (Some((triangles, quads)), Some(membrane)) => Some(MembraneDescription {
            quads,
            plane: choice("plane state", &membrane.plane)?,
            model: choice("model of membranes", &membrane.model)?,
            evaluation: choice("evaluation", &membrane.evaluation)?,
            springs: springs(&membrane.springs)?,
            bending: match membrane.bending {
                true => Some(Bending {
                    thickness: membrane.bending_thickness,
                    rest: choice("rest shape", &membrane.bending_rest)?,
                }),
                false => None,
            },
            ..MembraneDescription::new(triangles, membrane.thickness, membrane.material.uniform())
        }),
        _ => None,
    };
    let description = BodyDescription {
        young_modulus,
        poisson_ratio,
        density,
        model: choice("model", &spec.model)?,
        evaluation: choice("evaluation", &spec.evaluation)?,
        volume: choice("rule for the volume", &spec.volume)?,
        integration: match &spec.integration {
            Some(name) => choice("integration", name)?,
            None => Integration::default(),
        },
        masses: choice("rule of masses", &spec.masses)?,
        springs: springs(&spec.springs)?,
        spare: spec.spare,
        glue: spec.glue,
        membrane,
        axes: spec.axes.map(AxesIn::description).transpose()?,
        ..BodyDescription::new(name, mesh, spec.material.uniform())
    };
    own.add_body(mesh, &description)
}

/// A tool, and the triangles of a body that it alone touches.
fn tool(spec: ToolIn) -> Result<(Tool, Option<(Handle, Vec<u32>)>)> {
    let parts: Result<Vec<Part>> = spec.parts.iter().map(PartIn::part).collect();
    let mut tool = Tool::of_parts(spec.name, parts?, tool_pose(spec.start)?);
    tool.hinge = hinge(spec.hinge);
    tool.motion = match (spec.path, spec.by) {
        (Some(path), _) => {
            let point = |(time, pose)| Ok(PathPoint { time, pose: tool_pose(pose)? });
            ToolMotion::Path(path.into_iter().map(point).collect::<Result<_>>()?)
        }
        (None, Some(by)) => ToolMotion::Translate(vec3(by), curve(spec.curve)),
        (None, None) => ToolMotion::Follow,
    };
    (tool.friction, tool.grip, tool.exact) = (spec.friction, spec.grip, spec.exact);
    tool.points = points(spec.points)?;
    tool.stiffness = stiffness(&spec.stiffness);
    (tool.keeps_side, tool.error_bar) = (spec.keeps_side, spec.error_bar);
    tool.local_stiffness = spec.local_stiffness;
    if let Some(text) = &spec.edge {
        give_edge(&mut tool, text)?;
    }
    tool.needle = spec.needle.as_deref().map(needle).transpose()?;
    (tool.from, tool.until) = (spec.begin, spec.until);
    Ok((tool, spec.on.map(|(body, triangles)| (body, triangles.0))))
}

/// What holds vertices and moves them.
#[derive(FromPyObject)]
struct ConstraintIn {
    name: String,
    vertices: Indices,
    axes: [bool; 3],
    by: Option<Floats>,
    rotation: Option<(Vec3, Vec3, f64)>,
    curve: Option<CurveIn>,
    begin: f64,
    until: f64,
}

impl ConstraintIn {
    fn motion(&self) -> Motion {
        match (&self.by, self.rotation) {
            (_, Some((centre, axis, angle))) => {
                Motion::Rotate { centre: vec3(centre), axis: vec3(axis), angle }
            }
            (Some(by), None) => match by.0.as_chunks::<3>().0 {
                &[by] => Motion::Translate(vec3(by)),
                each => Motion::TranslateEach(each.iter().map(|&by| vec3(by)).collect()),
            },
            (None, None) => Motion::Hold,
        }
    }
}

#[pymethods]
impl Engine {
    /// A simulation without bodies.
    #[staticmethod]
    fn create(choices: Choices, dt: f64, gravity: Vec3, solver: String) -> PyResult<Self> {
        made(|| {
            let own = choices.overrides()?;
            Embedding::new(&Options {
                precision: own.precision.unwrap_or_default(),
                backend: own.backend.unwrap_or_default(),
                threads: own.threads.unwrap_or_default(),
                instruction_set: own.instruction_set,
                dt,
                gravity,
                solver: solver_settings(&solver)?,
            })
        })
    }

    /// The simulation of a scene file.
    #[staticmethod]
    fn of_file(path: &str, choices: Choices) -> PyResult<Self> {
        made(|| Embedding::from_scene_file(path, &choices.overrides()?))
    }

    /// The simulation of a scene's text; `read` answers the bytes of files that it names.
    #[staticmethod]
    fn of_text(text: &str, name: &str, read: Py<PyAny>, choices: Choices) -> PyResult<Self> {
        made(|| Embedding::from_scene(text, name, files(read), &choices.overrides()?))
    }

    /// Makes steps.
    fn step(&self, py: Python<'_>, count: u32) -> PyResult<()> {
        self.0.step(py, count)
    }

    /// Steps done, time (s), length of a step (s).
    fn clock(&self) -> PyResult<(u64, f64, f64)> {
        self.0.read(|own| Ok((own.steps_done(), own.time(), own.dt())))
    }

    /// What does not change.
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let own = self.0.take(py);
        let dict = PyDict::new(py);
        let filled = (|| {
            dict.set_item("precision", own.precision().name())?;
            dict.set_item("threads", own.threads())?;
            dict.set_item("instruction_set", own.instruction_set().name())?;
            let gpu = matches!(own.backend(), Backend::Gpu);
            dict.set_item("backend", if gpu { "gpu" } else { "cpu" })?;
            dict.set_item("scene", own.scene_name())?;
            dict.set_item("steps_planned", own.steps_planned())?;
            dict.set_item("is_static", own.is_static())
        })();
        self.0.put(own);
        filled.map(|()| dict)
    }

    fn set_dt(&self, dt: f64) -> PyResult<()> {
        self.0.read(|own| own.set_dt(dt))
    }

    fn gravity(&self) -> PyResult<Vec3> {
        self.0.read(|own| Ok(own.gravity()))
    }

    fn set_gravity(&self, gravity: Vec3) -> PyResult<()> {
        self.0.read(|own| own.set_gravity(gravity))
    }

    /// Settings of the solver as JSON.
    fn solver(&self) -> PyResult<String> {
        self.0.read(|own| Ok(json(own.solver())))
    }

    /// Settings of the solver from TOML or JSON.
    fn set_solver(&self, text: &str) -> PyResult<()> {
        self.0.read(|own| own.set_solver(solver_settings(text)?))
    }

    fn hash(&self) -> PyResult<u64> {
        self.0.with(|own| Ok(own.hash()))
    }

    /// What the last step did, as JSON.
    fn report(&self) -> PyResult<String> {
        self.0.read(|own| Ok(own.report_json()))
    }

    /// Elastic and kinetic energy (J).
    fn energy(&self) -> PyResult<(f64, f64)> {
        let energy = self.0.with(|own| Ok(own.energy()))?;
        Ok((energy.elastic, energy.kinetic))
    }

    /// Code, level, subject, message and remedy of each.
    fn warnings(&self) -> PyResult<Vec<[String; 5]>> {
        self.0.read(|own| {
            let parts = |w: &Warning| {
                let level = w.level.name().to_string();
                [w.code.clone(), level, w.subject.clone(), w.message.clone(), w.remedy.clone()]
            };
            Ok(own.warnings().iter().map(parts).collect())
        })
    }

    /// Why the state cannot be trusted, if so.
    fn verdict(&self) -> PyResult<Option<String>> {
        self.0.read(|own| Ok(own.verdict()))
    }

    fn find(&self, of: &str, name: &str) -> PyResult<Handle> {
        self.0.read(|own| own.find(kind(of)?, name))
    }

    fn list(&self, of: &str) -> PyResult<Vec<(Handle, String)>> {
        self.0.read(|own| Ok(own.list(kind(of)?)))
    }

    fn remove(&self, handle: Handle) -> PyResult<()> {
        self.0.with(|own| own.remove(handle))
    }

    fn add_body(&self, name: &str, mesh: &Mesh, spec: BodyIn) -> PyResult<Handle> {
        self.0.with(|own| add_body(own, name, &mesh.0, spec))
    }

    fn mesh(&self, body: Handle) -> PyResult<Mesh> {
        self.0.read(|own| Ok(Mesh(Arc::new(own.mesh(body)?.clone()))))
    }

    fn group<'py>(&self, py: Python<'py>, body: Handle, name: &str) -> PyResult<Array<'py, u32>> {
        Ok(PyArray1::from_vec(py, self.0.read(|own| own.group(body, name))?))
    }

    /// The array of a body that is refreshed: positions, displacements or velocities.
    fn view(&self, py: Python<'_>, body: Handle, quantity: &str) -> PyResult<Py<PyAny>> {
        self.0.view(py, body, refreshed(quantity).map_err(raise)?)
    }

    /// A copy of it.
    fn copy(&self, py: Python<'_>, body: Handle, quantity: &str) -> PyResult<Py<PyAny>> {
        self.0.copy(py, body, refreshed(quantity).map_err(raise)?)
    }

    fn set_state(&self, body: Handle, displacements: Floats, velocities: Floats) -> PyResult<()> {
        self.0.with(|own| own.set_state(body, &displacements.0, &velocities.0))
    }

    /// Numbers, three in a row for vectors.
    fn numbers<'py>(
        &self,
        py: Python<'py>,
        body: Handle,
        quantity: &str,
    ) -> PyResult<Array<'py, f64>> {
        let read = |own: &mut Embedding| {
            Ok(own.numbers(body, choice("quantity", quantity)?)?.into_owned())
        };
        Ok(PyArray1::from_vec(py, self.0.with(read)?))
    }

    fn volume(&self, body: Handle) -> PyResult<f64> {
        self.0.with(|own| own.volume(body))
    }

    /// Triangles of the outside, and their revision.
    fn surface<'py>(
        &self,
        py: Python<'py>,
        body: Handle,
    ) -> PyResult<(Bound<'py, PyArray2<u32>>, u64)> {
        let (triangles, revision) = self.0.with(|own| {
            let surface = own.surface(body)?;
            Ok((surface.triangles.to_vec(), surface.revision))
        })?;
        let count = triangles.len();
        let flat = PyArray1::from_vec(py, triangles.into_flattened());
        Ok((flat.reshape([count, 3])?, revision))
    }

    fn remaining<'py>(&self, py: Python<'py>, body: Handle, of: &str) -> PyResult<Array<'py, u32>> {
        let left = self.0.with(|own| own.remaining(body, element_kind(of)?))?;
        Ok(PyArray1::from_vec(py, left))
    }

    /// Young's moduli, Poisson's ratios and densities: one number, or one per element.
    fn material<'py>(&self, py: Python<'py>, body: Handle) -> PyResult<[Array<'py, f64>; 3]> {
        let numbers = self.0.read(|own| {
            let (material, arrays) = own.material(body)?;
            let field = arrays.field(material);
            let given = |each: Option<&[f64]>, one| each.map_or(vec![one], <[f64]>::to_vec);
            Ok([
                given(field.young_modulus, material.young_modulus),
                given(field.poisson_ratio, material.poisson_ratio),
                given(field.density, material.density),
            ])
        })?;
        Ok(numbers.map(|numbers| PyArray1::from_vec(py, numbers)))
    }

    /// By how much (J) elastic and kinetic energy changed.
    fn set_material(&self, body: Handle, material: MaterialIn) -> PyResult<(f64, f64)> {
        let change = self.0.with(|own| {
            let [young_modulus, poisson_ratio, density] = material.arrays();
            let material = material.uniform();
            let field = MaterialField { young_modulus, poisson_ratio, density, ..material.into() };
            own.set_material(body, field)
        })?;
        Ok((change.elastic_energy, change.kinetic_energy))
    }

    /// What was removed, as JSON.
    fn remove_elements(
        &self,
        body: Handle,
        of: &str,
        list: Indices,
        numbers: Vec<f64>,
        mass: &str,
    ) -> PyResult<String> {
        let report = self.0.with(|own| {
            let mass = choice("rule of mass", mass)?;
            own.remove_elements(body, region(of, list, &numbers)?, mass)
        })?;
        Ok(json(&report))
    }

    /// What a cut did, as JSON.
    fn cut(&self, body: Handle, strip: Floats) -> PyResult<String> {
        let ends = strip.0.as_chunks::<6>().0.iter();
        let ends = ends.map(|x| [DVec3::from_slice(&x[..3]), DVec3::from_slice(&x[3..])]);
        let ends: Vec<_> = ends.collect();
        Ok(json(&self.0.with(|own| own.cut(body, &ends))?))
    }

    /// What to draw of a body: points, the same at rest, depths, triangles, whether each is wound, and the revision.
    #[expect(clippy::type_complexity, reason = "a tuple for Python, unpacked at once")]
    fn skin<'py>(
        &self,
        py: Python<'py>,
        body: Handle,
    ) -> PyResult<([Array<'py, f64>; 3], Array<'py, u32>, Array<'py, bool>, u64)> {
        let (numbers, triangles, wound, revision) = self.0.with(|own| {
            let skin = own.skin(body)?;
            let numbers = [skin.points.as_flattened(), skin.rest.as_flattened(), skin.depth];
            let triangles = skin.triangles.as_flattened().to_vec();
            Ok((numbers.map(<[f64]>::to_vec), triangles, skin.wound.to_vec(), skin.revision))
        })?;
        let numbers = numbers.map(|numbers| PyArray1::from_vec(py, numbers));
        let triangles = PyArray1::from_vec(py, triangles);
        Ok((numbers, triangles, PyArray1::from_vec(py, wound), revision))
    }

    fn set_activation(&self, body: Handle, family: &str, activation: f64) -> PyResult<()> {
        self.0.with(|own| own.set_activation(body, family, activation))
    }

    fn set_axis_modulus(&self, body: Handle, family: &str, modulus: f64) -> PyResult<f64> {
        self.0.with(|own| own.set_axis_modulus(body, family, modulus))
    }

    fn add_constraint(&self, body: Handle, spec: ConstraintIn) -> PyResult<Handle> {
        self.0.with(|own| {
            let motion = spec.motion();
            own.add_constraint(
                body,
                &ConstraintSpec {
                    name: &spec.name,
                    vertices: &spec.vertices.0,
                    axes: spec.axes,
                    motion,
                    curve: curve(spec.curve),
                    from: spec.begin,
                    until: spec.until,
                },
            )
        })
    }

    fn set_target(&self, constraint: Handle, to: PoseIn) -> PyResult<()> {
        self.0.with(|own| own.set_target(constraint, pose(to)?))
    }

    /// Force (N) and torque (N m) about a point.
    fn reaction(&self, constraint: Handle, about: Vec3) -> PyResult<[Vec3; 2]> {
        let wrench = self.0.with(|own| own.reaction(constraint, about))?;
        Ok([wrench.force, wrench.torque])
    }

    fn add_load(
        &self,
        body: Handle,
        name: &str,
        vertices: Indices,
        forces: Floats,
        over: Option<CurveIn>,
    ) -> PyResult<Handle> {
        self.0.with(|own| own.add_load(body, name, &vertices.0, &forces.0, curve(over)))
    }

    fn add_pressure(
        &self,
        body: Handle,
        name: &str,
        triangles: Indices,
        pressure: f64,
        over: Option<CurveIn>,
    ) -> PyResult<Handle> {
        self.0.with(|own| own.add_pressure(body, name, &triangles.0, pressure, curve(over)))
    }

    /// On faces of so many corners, of a group, or on the whole surface.
    fn add_traction(
        &self,
        body: Handle,
        name: &str,
        faces: Option<(usize, Indices)>,
        group: Option<&str>,
        traction: Vec3,
        over: Option<CurveIn>,
    ) -> PyResult<Handle> {
        let on = match (&faces, group) {
            (Some((4, list)), _) => TractionOn::Quads(&list.0),
            (Some((_, list)), _) => TractionOn::Triangles(&list.0),
            (None, Some(group)) => TractionOn::Group(group),
            (None, None) => TractionOn::Whole,
        };
        self.0.with(|own| own.add_traction(body, name, on, traction, curve(over)))
    }

    fn add_tool(&self, spec: ToolIn) -> PyResult<Handle> {
        self.0.with(|own| {
            let (tool, on) = tool(spec)?;
            own.add_tool(tool, on.as_ref().map(|(body, list)| (*body, list.as_slice())))
        })
    }

    fn move_tool(&self, tool: Handle, to: ToolPoseIn) -> PyResult<()> {
        self.0.with(|own| own.move_tool(tool, tool_pose(to)?))
    }

    fn place_tool(&self, tool: Handle, at: ToolPoseIn) -> PyResult<()> {
        self.0.with(|own| own.place_tool(tool, tool_pose(at)?))
    }

    fn set_grip(&self, tool: Handle, grip: bool) -> PyResult<()> {
        self.0.with(|own| own.set_grip(tool, grip))
    }

    fn record(&self, every: u64) -> PyResult<()> {
        self.0.with(|own| own.record(every))
    }

    /// Ends the recording, as one HTML file.
    fn page(&self) -> PyResult<String> {
        self.0.with(|own| own.page())
    }

    /// What a tool felt, as JSON.
    fn tool_report(&self, tool: Handle) -> PyResult<String> {
        self.0.read(|own| Ok(json(&own.tool_report(tool)?)))
    }

    fn add_contact(
        &self,
        name: &str,
        bodies: [Handle; 2],
        friction: f64,
        stiff: StiffnessIn,
    ) -> PyResult<Handle> {
        self.0.with(|own| own.add_contact(name, bodies, friction, stiffness(&stiff)))
    }

    /// What two bodies did to each other, as JSON.
    fn contact_report(&self, contact: Handle) -> PyResult<String> {
        self.0.read(|own| Ok(json(&own.contact_report(contact)?)))
    }

    fn add_pull(
        &self,
        body: Handle,
        name: &str,
        vertices: Indices,
        weights: Floats,
        springs: (f64, f64),
    ) -> PyResult<Handle> {
        let (stiffness, damping) = springs;
        self.0.with(|own| {
            let (vertices, weights) = (&vertices.0, &weights.0);
            own.add_pull(body, &PullSpec { name, vertices, weights, stiffness, damping })
        })
    }

    fn move_pull(&self, pull: Handle, to: PoseIn) -> PyResult<()> {
        self.0.with(|own| own.move_pull(pull, pose(to)?))
    }

    /// What a pull did, as JSON.
    fn pull_report(&self, pull: Handle) -> PyResult<String> {
        self.0.read(|own| Ok(json(&own.pull_report(pull)?)))
    }

    /// A pull, and the device that holds by it. Numbers: stiffness, damping, limit, stale, fade, mass of the device, tolerance, largest
    /// torque, moment of inertia of the device.
    fn add_haptic(
        &self,
        body: Handle,
        name: String,
        vertices: Indices,
        turns: bool,
        numbers: [f64; 9],
    ) -> PyResult<(Handle, HapticDevice)> {
        let [stiffness, damping, limit, stale, fade, device_mass, tolerance, ..] = numbers;
        let [.., torque_limit, device_inertia] = numbers;
        let (pull, device) = self.0.with(|own| {
            let or = own.haptic_options(body, &vertices.0)?;
            let options = HapticOptions { name, stiffness, damping, limit, stale, ..or };
            let options = HapticOptions { turns, torque_limit, device_inertia, ..options };
            own.add_haptic(HapticOptions { fade, device_mass, tolerance, ..options })
        })?;
        Ok((pull, HapticDevice(device)))
    }

    /// Has the device of a pull or tool let go.
    fn let_go(&self, held: Handle) -> PyResult<()> {
        self.0.with(|own| own.let_go(held))
    }

    /// Shares bodies and tools with another thread.
    fn share(&self, bodies: Vec<Handle>, tools: Vec<Handle>) -> PyResult<Reader> {
        let reader = self.0.with(|own| own.share(&bodies, &tools))?;
        Ok(Reader(Mutex::new(reader)))
    }

    fn add_thread(
        &self,
        of: &str,
        settings: &str,
        points: Vec<(Handle, Vec3)>,
    ) -> PyResult<Handle> {
        let points: Vec<_> = points.into_iter().map(|(of, at)| ThreadPoint { of, at }).collect();
        self.0.with(|own| own.add_thread(kind(of)?, settings, &points))
    }

    fn move_thread(&self, thread: Handle, point: usize, at: Vec3) -> PyResult<()> {
        self.0.with(|own| own.move_thread(thread, point, at))
    }

    fn draw_thread(&self, thread: Handle, end: usize, length: f64) -> PyResult<()> {
        self.0.with(|own| own.draw_thread(thread, end, length))
    }

    fn hold_thread(&self, thread: Handle, end: usize) -> PyResult<()> {
        self.0.with(|own| own.hold_thread(thread, end))
    }

    fn tie_thread(&self, thread: Handle) -> PyResult<()> {
        self.0.with(|own| own.tie_thread(thread))
    }

    /// Handles and names of the parts.
    fn cut_thread(
        &self,
        thread: Handle,
        segment: usize,
    ) -> PyResult<[Option<(Handle, String)>; 2]> {
        self.0.with(|own| {
            let parts = own.cut_thread(thread, segment)?;
            let named = |part: Option<Handle>| -> Result<Option<(Handle, String)>> {
                part.map(|handle| Ok((handle, own.name(handle)?))).transpose()
            };
            let [a, b] = parts.map(named);
            Ok([a?, b?])
        })
    }

    /// What a thread or clip did, as JSON.
    fn thread_report(&self, thread: Handle) -> PyResult<String> {
        self.0.read(|own| Ok(json(&own.thread_report(thread)?)))
    }

    fn set_tear(&self, body: Handle, settings: Option<&str>) -> PyResult<()> {
        self.0.with(|own| own.set_tear(body, settings))
    }

    /// What the glue of a body does, as JSON, if it has some.
    fn glue_report(&self, body: Handle) -> PyResult<Option<String>> {
        self.0.read(|own| Ok(own.glue_report(body)?.as_ref().map(json)))
    }

    /// What tears of a body did, as JSON, if it tears.
    fn tear_report(&self, body: Handle) -> PyResult<Option<String>> {
        self.0.read(|own| Ok(own.tear_report(body)?.as_ref().map(json)))
    }

    /// Body, vertices, weights, point (m) and distance (m) of what a ray meets first.
    #[expect(clippy::type_complexity, reason = "a tuple for Python, unpacked at once")]
    fn pick(
        &self,
        origin: Vec3,
        direction: Vec3,
    ) -> PyResult<Option<(Handle, [u32; 3], Vec3, Vec3, f64)>> {
        let pick = self.0.with(|own| own.pick(origin, direction))?;
        Ok(pick.map(|p| (p.body, p.vertices, p.weights, p.position, p.distance)))
    }

    /// The state as it is.
    fn snapshot(&self) -> PyResult<Snapshot> {
        Ok(Snapshot(self.0.with(|own| own.snapshot())?))
    }

    /// Takes up a state.
    fn restore(&self, snapshot: &Snapshot) -> PyResult<()> {
        let own = &snapshot.0;
        self.0.with(|engine| engine.restore(own))
    }

    /// Panics inside, for the test of what happens then.
    fn panic(&self, text: String) -> PyResult<()> {
        self.0.with(|own| guarded(own, |_| std::panic::panic_any(text)))
    }
}
