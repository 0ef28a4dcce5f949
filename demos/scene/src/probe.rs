//! What probes can record: a row of [`PROBES`] for every quantity. A new quantity is a new row, and a word in
//! `demos/scenes/README.md`.

use crate::assemble::body::BuiltBody;
use crate::assemble::conditions::BuiltConstraint;
use crate::assemble::{BuiltContact, BuiltPull, BuiltThread, BuiltTool};
use glam::DVec3;
use sinew::engine::mesh::enclosed_volume;
use sinew::models::cutting::glue::GlueReport;
use sinew::models::cutting::tear::TearReport;
use sinew::simulation::Simulation;
use sinew::touch::pair::BodyContactReport;
use sinew::touch::pull::PullReport;
use sinew::touch::thread::ThreadReport;
use sinew::touch::tool::{PartReport, ToolReport};

/// A quantity that probes can record.
#[derive(Clone, Copy, Debug)]
pub struct Probe {
    /// Word in scene files.
    pub key: &'static str,
    /// Name of its columns.
    pub column: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// What an entry must say.
    pub needs: Needs,
    /// How it is found.
    pub evaluate: ProbeValue,
}

/// What a quantity is about, and so what its entry must say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// The whole scene: nothing.
    Scene,
    /// A body, and vertices of it where it depends on them.
    Body,
    /// A constraint.
    Constraint,
    /// A group of faces of a body.
    Faces,
    /// A tool.
    Tool,
    /// A part of a tool.
    Part,
    /// A pull.
    Pull,
    /// A contact between bodies.
    Contact,
    /// A thread.
    Thread,
    /// A clip.
    Clip,
}

/// A quantity of one column, or of three.
#[derive(Clone, Copy, Debug)]
pub enum ProbeValue {
    /// A number.
    Scalar(fn(&mut Sampler, &ProbeSubject) -> f64),
    /// A vector.
    Vector(fn(&mut Sampler, &ProbeSubject) -> DVec3),
}

use ProbeValue::{Scalar, Vector};

/// Everything that probes can record.
pub static PROBES: [Probe; 54] = [
    vector("mean_displacement", "m", Needs::Body, |now, of| {
        of.mean(&now.simulation.displacements(of.body.handle))
    }),
    scalar("max_displacement", "m", Needs::Body, |now, of| {
        let u = now.simulation.displacements(of.body.handle);
        of.probe.vertices.iter().map(|&i| u[i as usize].length()).fold(0.0, f64::max)
    }),
    vector("mean_velocity", "m/s", Needs::Body, |now, of| {
        of.mean(&now.simulation.velocities(of.body.handle))
    }),
    // on the body; zero while the constraint does not act
    vector("reaction", "N", Needs::Constraint, |now, of| {
        let time = now.simulation.time();
        let acting = of.constraint.filter(|c| time > 0.0 && c.acts(time));
        let reaction = acting.and_then(|c| {
            // reactions are read from the forces of the state as it is
            now.elastic_energy();
            now.simulation.reaction(c.entity)
        });
        reaction.unwrap_or_default()
    }),
    scalar("elastic_energy", "J", Needs::Scene, |now, _| now.elastic_energy()),
    scalar("kinetic_energy", "J", Needs::Scene, |now, _| now.kinetic_energy),
    // smallest volume ratio
    Probe {
        column: "min_J",
        ..scalar("min_j", "-", Needs::Body, |now, of| {
            smallest(now.simulation.volume_ratios(of.body.handle))
        })
    },
    // smallest area ratio of the membrane
    scalar("min_area_ratio", "-", Needs::Body, |now, of| {
        smallest(now.simulation.area_ratios(of.body.handle))
    }),
    // of the elements that are left
    scalar("volume", "m^3", Needs::Body, |now, of| of.body.volume(now.simulation)),
    // one side of what tore, at rest, and the mean stress at the ends of wounds
    scalar("torn_area", "m^2", Needs::Body, |now, of| of.tear(now).area),
    scalar("tear_stress", "Pa", Needs::Body, |now, of| of.tear(now).stress),
    scalar("tear_energy_release", "J/m^2", Needs::Body, |now, of| of.tear(now).energy_release),
    // in the glue of its wounds, and in what of it blades have come to
    scalar("glue_energy", "J", Needs::Body, |now, of| of.glue(now).energy),
    scalar("glue_released", "J", Needs::Body, |now, of| of.glue(now).released),
    // between the faces of a group and their rim: what a cavity holds
    scalar("enclosed_volume", "m^3", Needs::Faces, |now, of| {
        enclosed_volume(&of.body.deformed(now.simulation), &of.probe.faces).abs()
    }),
    // on the tool, normal and friction; zero while it does not touch
    vector("tool_force", "N", Needs::Tool, |now, of| of.tool(now).force),
    // about its origin
    vector("tool_torque", "N m", Needs::Tool, |now, of| of.tool(now).torque),
    vector("tool_normal", "N", Needs::Tool, |now, of| of.tool(now).normal),
    vector("tool_friction", "N", Needs::Tool, |now, of| of.tool(now).friction),
    // by points of the other kind, with `error_bar`
    vector("tool_other_force", "N", Needs::Tool, |now, of| {
        of.tool(now).other_points.unwrap_or_default()
    }),
    scalar("tool_work", "J", Needs::Tool, |now, of| of.tool(now).work),
    scalar("tool_dissipation", "J", Needs::Tool, |now, of| of.tool(now).dissipation),
    scalar("tool_closing", "N m", Needs::Tool, |now, of| of.tool(now).closing),
    // what its edge has cut
    scalar("tool_cut_area", "m^2", Needs::Tool, |now, of| of.tool(now).cut_area),
    scalar("tool_fracture", "J", Needs::Tool, |now, of| of.tool(now).fracture),
    scalar("tool_separated", "-", Needs::Tool, |now, of| of.tool(now).separated.into()),
    // of its needle
    scalar("tool_inserted", "m", Needs::Tool, |now, of| of.tool(now).inserted),
    scalar("tool_tip_force", "N", Needs::Tool, |now, of| of.tool(now).tip_force),
    scalar("tool_shaft_force", "N", Needs::Tool, |now, of| of.tool(now).shaft_force),
    scalar("tool_punctures", "-", Needs::Tool, |now, of| of.tool(now).punctures.into()),
    scalar("tool_area", "m^2", Needs::Tool, |now, of| of.tool(now).area),
    scalar("tool_depth", "m", Needs::Tool, |now, of| of.tool(now).depth),
    scalar("tool_pressure", "Pa", Needs::Tool, |now, of| of.tool(now).pressure),
    vector("tool_centre", "m", Needs::Tool, |now, of| of.tool(now).centre),
    scalar("tool_sticking", "-", Needs::Tool, |now, of| of.tool(now).sticking.into()),
    scalar("tool_slipping", "-", Needs::Tool, |now, of| of.tool(now).slipping.into()),
    scalar("tool_lag", "m", Needs::Tool, |now, of| of.tool(now).lag),
    vector("tool_position", "m", Needs::Tool, |now, of| of.tool(now).position),
    // of one part, such as a jaw
    vector("tool_part_force", "N", Needs::Part, |now, of| of.part(now).force),
    vector("tool_part_torque", "N m", Needs::Part, |now, of| of.part(now).torque),
    scalar("tool_part_depth", "m", Needs::Part, |now, of| of.part(now).depth),
    scalar("tool_part_sticking", "-", Needs::Part, |now, of| of.part(now).sticking.into()),
    scalar("tool_part_slipping", "-", Needs::Part, |now, of| of.part(now).slipping.into()),
    // on the hand
    vector("pull_force", "N", Needs::Pull, |now, of| of.pull(now).force),
    scalar("pull_distance", "m", Needs::Pull, |now, of| of.pull(now).distance),
    scalar("pull_work", "J", Needs::Pull, |now, of| of.pull(now).work),
    // on the first body
    vector("contact_force", "N", Needs::Contact, |now, of| of.contact(now).force),
    scalar("contact_area", "m^2", Needs::Contact, |now, of| of.contact(now).area),
    // the largest of its segments
    scalar("thread_tension", "N", Needs::Thread, |now, of| of.line(of.thread, now).largest()),
    scalar("thread_length", "m", Needs::Thread, |now, of| of.line(of.thread, now).length),
    scalar("thread_free", "m", Needs::Thread, |now, of| of.line(of.thread, now).free.iter().sum()),
    scalar("thread_work", "J", Needs::Thread, |now, of| of.line(of.thread, now).work),
    scalar("clip_tension", "N", Needs::Clip, |now, of| of.line(of.clip, now).largest()),
    scalar("clip_length", "m", Needs::Clip, |now, of| of.line(of.clip, now).length),
];

/// A number whose column has the name of its word.
const fn scalar(
    key: &'static str,
    unit: &'static str,
    needs: Needs,
    evaluate: fn(&mut Sampler, &ProbeSubject) -> f64,
) -> Probe {
    Probe { key, column: key, unit, needs, evaluate: Scalar(evaluate) }
}

/// A vector, likewise.
const fn vector(
    key: &'static str,
    unit: &'static str,
    needs: Needs,
    evaluate: fn(&mut Sampler, &ProbeSubject) -> DVec3,
) -> Probe {
    Probe { key, column: key, unit, needs, evaluate: Vector(evaluate) }
}

fn smallest(ratios: Vec<f64>) -> f64 {
    ratios.into_iter().fold(f64::INFINITY, f64::min)
}

impl Probe {
    /// Endings of the names of its columns.
    fn endings(&self) -> &'static [&'static str] {
        match self.evaluate {
            Scalar(_) => &[""],
            Vector(_) => &["_x", "_y", "_z"],
        }
    }
}

/// An entry `[[probe]]`, checked.
#[derive(Clone, Debug, Default)]
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
    /// Index of the tool.
    pub tool: Option<usize>,
    /// Number of a part of the tool.
    pub part: Option<usize>,
    /// Index of the pull.
    pub pull: Option<usize>,
    /// Index of the contact.
    pub contact: Option<usize>,
    /// Index of the thread.
    pub thread: Option<usize>,
    /// Index of the clip.
    pub clip: Option<usize>,
    /// What to record.
    pub record: Vec<&'static Probe>,
}

/// The state of a simulation while probes are read.
pub struct Sampler<'a> {
    simulation: &'a mut Simulation,
    /// Of the whole scene (J).
    kinetic_energy: f64,
    elastic_energy: Option<f64>,
}

impl<'a> Sampler<'a> {
    /// Reads a simulation whose kinetic energy (J) is known.
    pub fn new(simulation: &'a mut Simulation, kinetic_energy: f64) -> Self {
        Self { simulation, kinetic_energy, elastic_energy: None }
    }

    /// Elastic energy (J) of the whole scene; evaluates all forces when first asked for.
    fn elastic_energy(&mut self) -> f64 {
        *self.elastic_energy.get_or_insert_with(|| self.simulation.evaluate())
    }
}

/// What an entry is about.
pub struct ProbeSubject<'a> {
    probe: &'a BuiltProbe,
    body: &'a BuiltBody,
    constraint: Option<&'a BuiltConstraint>,
    tool: Option<&'a BuiltTool>,
    pull: Option<&'a BuiltPull>,
    contact: Option<&'a BuiltContact>,
    thread: Option<&'a BuiltThread>,
    clip: Option<&'a BuiltThread>,
}

/// What probes of a scene look at.
#[derive(Clone, Copy)]
pub struct Recorded<'a> {
    /// Bodies.
    pub bodies: &'a [BuiltBody],
    /// Constraints.
    pub constraints: &'a [BuiltConstraint],
    /// Tools.
    pub tools: &'a [BuiltTool],
    /// Pulls.
    pub pulls: &'a [BuiltPull],
    /// Contacts between bodies.
    pub contacts: &'a [BuiltContact],
    /// Threads.
    pub threads: &'a [BuiltThread],
    /// Clips.
    pub clips: &'a [BuiltThread],
}

impl ProbeSubject<'_> {
    /// What the tool felt.
    fn tool(&self, now: &Sampler) -> ToolReport {
        self.tool.map_or_else(ToolReport::default, |tool| tool.report(now.simulation))
    }

    /// What the part of the tool felt; nothing while the tool does not touch.
    fn part(&self, now: &Sampler) -> PartReport {
        let known = self.probe.part.and_then(|part| self.tool(now).parts.get(part).copied());
        known.unwrap_or_default()
    }

    /// What the pull did.
    fn pull(&self, now: &Sampler) -> PullReport {
        self.pull.map_or_else(PullReport::default, |pull| pull.report(now.simulation))
    }

    /// What the contact did.
    fn contact(&self, now: &Sampler) -> BodyContactReport {
        let known = self.contact.and_then(|c| now.simulation.body_contact_report(c.entity));
        known.copied().unwrap_or_default()
    }

    /// What tore of its body.
    fn tear(&self, now: &Sampler) -> TearReport {
        now.simulation.tear_report(self.body.handle).unwrap_or_default()
    }

    /// What the glue of its body does.
    fn glue(&self, now: &mut Sampler) -> GlueReport {
        now.simulation.glue_report(self.body.handle).unwrap_or_default()
    }

    /// What a thread or clip did.
    fn line(&self, line: Option<&BuiltThread>, now: &Sampler) -> ThreadReport {
        line.map_or_else(ThreadReport::default, |line| line.report(now.simulation))
    }

    /// Mean over the vertices of the probe.
    fn mean(&self, of_body: &[DVec3]) -> DVec3 {
        let vertices = &self.probe.vertices;
        let sum: DVec3 = vertices.iter().map(|&i| of_body[i as usize]).sum();
        sum / vertices.len().max(1) as f64
    }
}

/// What probes record: names, units, and the endings of the columns of each.
pub fn quantities(
    probes: &[BuiltProbe],
) -> impl Iterator<Item = (String, &'static str, &'static [&'static str])> {
    let recorded = probes.iter().flat_map(|p| p.record.iter().map(move |own| (&p.name, own)));
    recorded.map(|(name, own)| (format!("{name}.{}", own.column), own.unit, own.endings()))
}

/// Names of the columns of probes.
pub fn columns(probes: &[BuiltProbe]) -> Vec<String> {
    let of = |(name, unit, endings): (String, &str, &[&str])| -> Vec<String> {
        endings.iter().map(|end| format!("{name}{end} ({unit})")).collect()
    };
    quantities(probes).flat_map(of).collect()
}

/// Values of probes in the order of [`columns`]; `reaction` is told constraints and their reactions (N).
pub fn values(
    now: &mut Sampler,
    parts: &Recorded,
    probes: &[BuiltProbe],
    mut reaction: impl FnMut(usize, DVec3),
) -> Vec<f64> {
    let mut values = Vec::new();
    for probe in probes {
        let of = ProbeSubject {
            probe,
            body: &parts.bodies[probe.body],
            constraint: probe.constraint.map(|i| &parts.constraints[i]),
            tool: probe.tool.map(|i| &parts.tools[i]),
            pull: probe.pull.map(|i| &parts.pulls[i]),
            contact: probe.contact.map(|i| &parts.contacts[i]),
            thread: probe.thread.map(|i| &parts.threads[i]),
            clip: probe.clip.map(|i| &parts.clips[i]),
        };
        for own in &probe.record {
            match own.evaluate {
                Scalar(evaluate) => values.push(evaluate(now, &of)),
                Vector(evaluate) => {
                    let value = evaluate(now, &of);
                    values.extend(value.to_array());
                    if let (Needs::Constraint, Some(i)) = (own.needs, probe.constraint) {
                        reaction(i, value);
                    }
                }
            }
        }
    }
    values
}
