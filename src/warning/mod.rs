//! What bodies, scenes and steps deserve a word about, and whether a run is to be trusted.
//!
//! A step that could not be carried out is an error. One that was carried out, but not as it should be, is told here: a body
//! was halted, contact did not converge, elements were turned inside out. [`Simulation::warnings`] has all of that since the
//! start, after what was found in meshes and materials; [`Simulation::verdict`] says whether the state can be trusted at all.

mod rules;
pub mod totals;

use crate::simulation::Simulation;
use bevy_ecs::prelude::*;
use rules::Run;
use serde::{Deserialize, Serialize};
use sinew_engine::mesh::{CheckOptions, CheckReport, Finding, Mesh, Severity, check};
use sinew_engine::topology::Topology;
use sinew_models::body::sheet::PlaneState;
use sinew_models::body::{BodyDescription, BodyError, SoftBody, VolumeRule, spawn_body};
use sinew_models::material::MaterialFinding;
use std::fmt;
use totals::RunTotals;

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

/// Why a run is not to be trusted, although every step was carried out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Untrusted {
    /// Bodies were halted in too many steps.
    #[error(
        "in {halted} of {steps} steps a body was halted because no state of lower energy was found, so it hardly moved; \
         loads, motions or units are far beyond what the material holds: make them smaller, or use a smaller dt"
    )]
    Halted {
        /// Steps in which a body was halted.
        halted: u64,
        /// Steps carried out.
        steps: u64,
    },
    /// An equilibrium that was asked for was not found.
    #[error(
        "no equilibrium found in {unconverged} of {steps} steps (last Newton step {newton_step:.1e} of the body size): \
         apply the loads in more parts (load_steps), or raise max_newton_iterations"
    )]
    NoEquilibrium {
        /// Steps without one.
        unconverged: u64,
        /// Steps carried out.
        steps: u64,
        /// Length of the largest last Newton step over body size.
        newton_step: f64,
    },
    /// There is more energy than was put in.
    #[error(
        "the bodies end with {gain:.2e} J more than the {put_in:.2e} J that loads and motions put in; use a smaller dt or \
         integrator = \"safe\""
    )]
    Energy {
        /// Energy from nowhere (J).
        gain: f64,
        /// Energy that was put in (J).
        put_in: f64,
    },
}

/// Part of the steps above which a run whose bodies were halted is not to be trusted, and how many there must be.
const HALTED: (f64, u64) = (0.25, 5);
/// Energy from nowhere, over all that was put in, above which a run is not to be trusted.
const GAIN: f64 = 0.1;

impl RunTotals {
    /// Whether the state that these steps led to can be trusted.
    ///
    /// # Errors
    /// Why not.
    pub fn verdict(&self) -> Result<(), Untrusted> {
        let (steps, halted) = (self.steps, self.solver.halted_steps);
        if halted >= HALTED.1 && halted as f64 > HALTED.0 * steps as f64 {
            return Err(Untrusted::Halted { halted, steps });
        }
        let Some(dissipated) = self.energy.dissipated else {
            let (unconverged, newton_step) =
                (self.solver.unconverged_steps, self.solver.worst_newton_step);
            return match unconverged {
                0 => Ok(()),
                _ => Err(Untrusted::NoEquilibrium { unconverged, steps, newton_step }),
            };
        };
        let (gain, put_in) = (-dissipated, self.energy.put_in());
        // false for NaN
        if gain <= GAIN * put_in { Ok(()) } else { Err(Untrusted::Energy { gain, put_in }) }
    }
}

/// What the checks of the meshes of bodies found.
#[derive(Resource, Default)]
struct MeshFindings(Vec<(Entity, Vec<Finding>)>);

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
    keep_findings(world, entity, &report);
    Ok(entity)
}

/// Keeps what the check of the mesh of a body found for [`warnings`].
pub(crate) fn keep_findings(world: &mut World, body: Entity, report: &CheckReport) {
    let mut kept = world.get_resource_or_init::<MeshFindings>();
    kept.0.push((body, report.findings.clone()));
}

/// What was found in the meshes and materials of the bodies of a world, such as that of a Bevy app.
pub fn body_warnings(world: &World) -> Vec<Warning> {
    let Some(mut query) = world.try_query::<(Entity, &SoftBody)>() else { return Vec::new() };
    let mut bodies: Vec<_> = query.iter(world).collect();
    bodies.sort_by_key(|(_, soft)| soft.index);
    let meshes = world.get_resource::<MeshFindings>();
    let mut found = Vec::new();
    for (entity, soft) in bodies {
        let subject = format!("body `{}`", world.resource::<Topology>().bodies[soft.index].name);
        let own = meshes.and_then(|meshes| meshes.0.iter().find(|(of, _)| *of == entity));
        found.extend(own.into_iter().flat_map(|(_, own)| own).map(|f| of_mesh(&subject, f)));
        found.extend(of_material(world, soft, &subject));
    }
    found
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
        self.world().get_resource::<RunTotals>().map_or(Ok(()), RunTotals::verdict)
    }

    /// Sums over the steps that led to the present state; `None` before the first.
    pub fn totals(&self) -> Option<&RunTotals> {
        self.world().get_resource()
    }
}
