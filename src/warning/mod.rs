//! What bodies, scenes and steps deserve a word about, and whether a run is to be trusted.
//!
//! A step that could not be carried out is an error. One that was carried out, but not as it should be, is told here: a body
//! was halted, contact did not converge, elements were turned inside out. [`Simulation::warnings`] has all of that since the
//! start, after what was found in meshes and materials; [`Simulation::verdict`] says whether the state can be trusted at all.

mod rules;
pub mod totals;
mod verdict;

use crate::simulation::Simulation;
use bevy_ecs::prelude::*;
use rules::Run;
use serde::{Deserialize, Serialize};
use sinew_engine::mesh::{CheckOptions, CheckReport, Finding, Mesh, Severity, check};
use sinew_engine::resource::ensure;
use sinew_engine::topology::Topology;
use sinew_models::axes::description::AxisFamily;
use sinew_models::body::sheet::PlaneState;
use sinew_models::body::{BodyDescription, BodyError, SoftBody, VolumeRule, spawn_body};
use sinew_models::material::MaterialFinding;
use std::fmt;
use totals::RunTotals;
pub use verdict::{Untrusted, verdict};

/// How much a warning matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Worth knowing.
    Note,
    /// The run may not be what was meant.
    Warning,
}

impl Level {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Warning => "warning",
        }
    }
}

/// Something that was found in the scene or during the run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Warning {
    /// Stable identifier, such as `mesh.inverted-winding`.
    pub code: String,
    /// How much it matters.
    pub level: Level,
    /// Body, constraint or stage.
    pub subject: String,
    /// What was found.
    pub message: String,
    /// What to do, or that nothing is to be done.
    pub remedy: String,
}

impl Warning {
    /// With its five parts in the order of the fields.
    pub fn new(
        code: impl Into<String>,
        level: Level,
        subject: impl Into<String>,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            code: code.into(),
            level,
            subject: subject.into(),
            message: message.into(),
            remedy: remedy.into(),
        }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let level = self.level.name();
        write!(f, "{level} [{}] {}: {}", self.code, self.subject, self.message)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, "; {}", self.remedy) }
    }
}

/// What is kept of bodies from when they were built.
#[derive(Resource, Default)]
struct BuiltBodies(Vec<BuiltBody>);

struct BuiltBody {
    entity: Entity,
    /// What the check of its mesh found.
    findings: Vec<Finding>,
    /// Volume (m^3) of its solid elements at rest.
    volume: f64,
    /// Area (m^2) of its membrane at rest.
    area: f64,
    /// Moduli (Pa) of its fibres and of their term of volume, and peak stresses of its muscles, all together.
    fibres: f64,
}

/// Builds a body as [`spawn_body`] does, and keeps what a check of its mesh finds for [`warnings`].
///
/// # Errors
/// As of [`spawn_body`].
pub fn spawn_checked_body(world: &mut World, body: &BodyDescription) -> Result<Entity, BodyError> {
    let entity = spawn_body(world, body)?;
    let faces = body.membrane.as_ref();
    let mesh = Mesh {
        source: body.name.into(),
        points: body.points.to_vec(),
        tetrahedra: body.tetrahedra.to_vec(),
        middles: body.middles.to_vec(),
        hexahedra: body.hexahedra.to_vec(),
        triangles: faces.map_or_else(Vec::new, |m| m.triangles.to_vec()),
        quads: faces.map_or_else(Vec::new, |m| m.quads.to_vec()),
        ..Mesh::default()
    };
    let report = match check(&mesh, &CheckOptions::default()) {
        Ok(mut checked) => {
            if faces.is_some() {
                checked.use_faces(&mesh.triangles, &mesh.quads);
            }
            checked.report
        }
        Err(error) => *error.report,
    };
    keep_findings(world, entity, body, &report);
    Ok(entity)
}

/// Keeps what the check of the mesh of a body found for [`warnings`], and its size for [`verdict`].
pub(crate) fn keep_findings(
    world: &mut World,
    entity: Entity,
    body: &BodyDescription,
    report: &CheckReport,
) {
    let point = |v: u32| body.points[v as usize];
    let area =
        |[a, b, c]: [u32; 3]| (point(b) - point(a)).cross(point(c) - point(a)).length() / 2.0;
    let area = body.membrane.as_ref().map_or(0.0, |m| {
        let halves = m.quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        m.triangles.iter().copied().chain(halves).map(area).sum()
    });
    let fibres = body.axes.as_ref().map_or(0.0, |axes| {
        let peak = |f: &AxisFamily| f.muscle.as_ref().map_or(0.0, |m| m.peak_stress);
        let families = axes.families.iter().map(|f| f.modulus + peak(f));
        families.sum::<f64>() + axes.volume_modulus
    });
    let (findings, volume) = (report.findings.clone(), report.statistics.total_volume);
    let built = BuiltBody { entity, findings, volume, area, fibres };
    ensure::<BuiltBodies>(world).0.push(built);
}

/// What was found in the meshes and materials of the bodies of a world, such as that of a Bevy app.
pub fn body_warnings(world: &World) -> Vec<Warning> {
    let Some(mut query) = world.try_query::<(Entity, &SoftBody)>() else { return Vec::new() };
    let mut bodies: Vec<_> = query.iter(world).collect();
    bodies.sort_by_key(|(_, soft)| soft.index);
    let built = world.get_resource::<BuiltBodies>();
    let mut found = Vec::new();
    for (entity, soft) in bodies {
        let subject = format!("body `{}`", world.resource::<Topology>().bodies[soft.index].name);
        let own = built.and_then(|built| built.0.iter().find(|own| own.entity == entity));
        let findings = own.into_iter().flat_map(|own| &own.findings);
        found.extend(findings.map(|f| of_mesh(&subject, f)));
        found.extend(of_material(world, soft, &subject));
        found.extend(of_springs(soft, subject));
    }
    found
}

/// Springs that push the more the longer they get, with which a body need not be stable at rest.
fn of_springs(soft: &SoftBody, subject: String) -> Option<Warning> {
    let [negative, all] = soft.springs.negative();
    (negative > 0).then(|| {
        Warning::new(
            "material.springs.negative",
            Level::Warning,
            subject,
            format!(
                "{negative} of {all} springs have negative constants, with which a body may give way to no load at all, and \
                 an equilibrium may be one of less energy than at rest"
            ),
            "element_method = \"nonnegative\" has none; `sinew fit` says what springs of a mesh are worth",
        )
    })
}

fn of_mesh(subject: &str, finding: &Finding) -> Warning {
    let level = match finding.severity {
        Severity::Info => Level::Note,
        _ => Level::Warning,
    };
    let message = match finding.entity.as_str() {
        "" => finding.message.clone(),
        entity => format!("{}: {entity}", finding.message),
    };
    Warning::new(format!("mesh.{}", finding.code), level, subject, message, &*finding.remedy)
}

/// What stands out in the materials of a body; elements that keep their volume one by one lock, sheets in plane stress
/// and means over clusters do not.
fn of_material(world: &World, soft: &SoftBody, subject: &str) -> Vec<Warning> {
    let order = &world.resource::<Topology>().bodies[soft.index].order;
    let solid = !(order.tetrahedra.is_empty() && order.hexahedra.is_empty());
    let mut found = Vec::new();
    let mut add = |subject: &str, findings: Vec<MaterialFinding>, locks: bool| {
        let told = findings.into_iter().filter(|f| locks || f.code != "material.poisson.locking");
        found.extend(
            told.map(|f| Warning::new(f.code, Level::Warning, subject, f.message, f.remedy)),
        );
    };
    if solid {
        add(subject, soft.field().findings(), soft.volume == VolumeRule::Elements);
    }
    if let Some(membrane) = &soft.membrane {
        let of = if solid { format!("membrane of {subject}") } else { subject.into() };
        // a membrane of the material of its solid says it once
        if !solid || membrane.material != soft.material {
            add(&of, membrane.material.findings(), membrane.plane == PlaneState::Strain);
        }
    }
    found
}

/// What happened in the steps that led to the present state of a world, such as that of a Bevy app.
pub fn run_warnings(world: &World) -> Vec<Warning> {
    let totals = world.get_resource::<RunTotals>();
    totals.map_or_else(Vec::new, |totals| rules::run_warnings(&Run { world, totals }))
}

/// All that deserves a word in a world, such as that of a Bevy app; see [`Simulation::warnings`].
pub fn warnings(world: &World) -> Vec<Warning> {
    let mut all = body_warnings(world);
    all.extend(run_warnings(world));
    all
}

/// # Warnings
impl Simulation {
    /// Everything that deserves a word: what was found in the meshes and materials of bodies, and what happened in the
    /// steps that led to the present state. Restoring a snapshot restores it too.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    ///
    /// // a mesh in millimetres, and a stiffness in kPa
    /// let mesh = box_tets(DVec3::new(200.0, 100.0, 100.0), [4, 2, 2])?;
    /// let material = YoungPoisson { young_modulus: 6.0, poisson_ratio: 0.45, density: 1060.0 };
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// simulation.add_body(&BodyDescription::new("box", &mesh, material))?;
    /// let codes: Vec<_> = simulation.warnings().into_iter().map(|w| w.code).collect();
    /// assert_eq!(codes, ["mesh.implausible-size", "material.young.range"]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn warnings(&self) -> Vec<Warning> {
        warnings(self.world())
    }

    /// Whether the present state can be trusted, as far as the steps that led to it tell. The command `sinew run` fails
    /// where it cannot.
    ///
    /// # Errors
    /// Why not.
    pub fn verdict(&self) -> Result<(), Untrusted> {
        verdict(self.world())
    }

    /// Sums over the steps that led to the present state; `None` before the first.
    pub fn totals(&self) -> Option<&RunTotals> {
        self.world().get_resource()
    }
}
