//! Contact in a summary: of tools, pulls and bodies with each other.

use crate::assemble::{BuiltScene, BuiltThread};
use crate::text::{TextBlock, line, short};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::simulation::Simulation;
use sinew::warning::totals::ContactTotals;

/// What touched in a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct TouchSummary {
    /// Tools, pulls and contacts; in JSON beside the figures.
    #[serde(flatten)]
    pub touched: Touched,
    /// Figures of all of them together.
    #[serde(flatten)]
    pub figures: ContactTotals,
}

/// Tools, pulls and contacts of a run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Touched {
    /// Tools in the order of the file.
    pub tools: Vec<ToolSummary>,
    /// Pulls in the order of the file.
    pub pulls: Vec<PullSummary>,
    /// Contacts of bodies in the order of the file.
    pub contacts: Vec<PairSummary>,
    /// Threads in the order of the file.
    pub threads: Vec<ThreadSummary>,
    /// Clips in the order of the file.
    pub clips: Vec<ThreadSummary>,
}

/// A thread or clip of a run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ThreadSummary {
    /// Name.
    pub name: String,
    /// What it is.
    pub what: String,
    /// Largest tension (N) in steps that converged, and when (s).
    pub peak: f64,
    /// When (s).
    pub peak_time: f64,
    /// Largest tension (N) at the end.
    pub tension: f64,
    /// Length (m) that lies between its ends at the end.
    pub length: f64,
    /// Work (J) of the hands at it.
    pub work: f64,
    /// Energy (J) that friction took.
    pub dissipation: f64,
    /// Points that it lost.
    pub lost: u32,
    /// It broke.
    pub broken: bool,
}

/// The largest force that something felt, and the last one.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct ForceSummary {
    /// Largest magnitude (N) in steps that converged.
    pub peak: f64,
    /// When (s).
    pub peak_time: f64,
    /// At the end (N).
    pub end: [f64; 3],
    /// Steps that did not converge while something touched it: the peak is not taken from them.
    pub unconverged: u64,
    /// Whether the last step is one of them.
    pub end_unconverged: bool,
}

impl ForceSummary {
    fn add(&mut self, force: DVec3, time: f64, unconverged: bool) {
        if !unconverged && force.length() > self.peak {
            (self.peak, self.peak_time) = (force.length(), time);
        }
        self.end = force.to_array();
        self.unconverged += u64::from(unconverged);
        self.end_unconverged = unconverged;
    }

    fn words(&self) -> String {
        let [x, y, z] = self.end.map(short);
        let (peak, time) = (short(self.peak), short(self.peak_time));
        let mut words = format!("force up to {peak} N at {time} s, [{x}, {y}, {z}] N at the end");
        if self.end_unconverged {
            words += ", where it did not converge";
        }
        match self.unconverged {
            0 => words,
            n => format!("{words}; peak without {n} steps that did not converge"),
        }
    }
}

/// A tool of a run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ToolSummary {
    /// Name.
    pub name: String,
    /// What it is and how it moves.
    pub what: String,
    /// Coefficient of friction.
    pub friction: f64,
    /// Force on the tool.
    pub force: ForceSummary,
    /// Forces on its parts; empty for a tool of one part.
    #[serde(skip_serializing_if = "Vec::is_empty", skip_deserializing)]
    pub parts: Vec<ForceSummary>,
    /// Torque (N m) on it about its origin at the end.
    pub torque: [f64; 3],
    /// Work (J) that it did on bodies.
    pub work: f64,
    /// Energy (J) that friction took.
    pub dissipation: f64,
    /// Largest penetration (m).
    pub depth: f64,
    /// Largest way (m) that it stayed behind its target.
    pub lag: f64,
    /// Area (m^2) that its edge swept through tissue against its toughness.
    pub cut_area: f64,
    /// Energy (J) that this took, or the tip of its needle.
    pub fracture: f64,
    /// Elements that its edge parted.
    pub separated: u32,
    /// Vertices that this made.
    pub cut_vertices: u32,
    /// Surfaces that gave way to its needle.
    pub punctures: u32,
    /// Largest length (m) of its needle in tissue.
    pub inserted: f64,
}

/// A pull of a run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PullSummary {
    /// Name.
    pub name: String,
    /// Body.
    pub body: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Stiffness (N/m) of all of them together.
    pub stiffness: f64,
    /// How the hand moves.
    pub motion: String,
    /// Force on the hand.
    pub force: ForceSummary,
    /// Work (J) of the hand.
    pub work: f64,
}

/// A contact between bodies of a run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PairSummary {
    /// Name.
    pub name: String,
    /// Bodies.
    pub bodies: [String; 2],
    /// Coefficient of friction.
    pub friction: f64,
    /// Force on the first body; 0 for one that touches itself.
    pub force: ForceSummary,
    /// Largest area (m^2) in contact.
    pub area: f64,
    /// Largest penetration (m).
    pub depth: f64,
    /// Energy (J) that friction took.
    pub dissipation: f64,
}

impl Touched {
    /// Of a scene before its first step; `None` where nothing touches.
    pub(crate) fn new(built: &BuiltScene) -> Option<Self> {
        if !built.touches() {
            return None;
        }
        let body = |index: usize| built.bodies[index].name.clone();
        let tools = built.tools.iter().map(|tool| ToolSummary {
            name: tool.name.clone(),
            what: tool.words.clone(),
            friction: tool.friction,
            parts: if tool.parts > 1 { vec![ForceSummary::default(); tool.parts] } else { vec![] },
            ..ToolSummary::default()
        });
        let pulls = built.pulls.iter().map(|pull| PullSummary {
            name: pull.name.clone(),
            body: body(pull.body),
            vertices: pull.rows.len(),
            stiffness: pull.stiffness,
            motion: pull.motion.clone(),
            ..PullSummary::default()
        });
        let contacts = built.contacts.iter().map(|contact| PairSummary {
            name: contact.name.clone(),
            bodies: contact.bodies.map(body),
            friction: contact.friction,
            ..PairSummary::default()
        });
        let line = |line: &BuiltThread| ThreadSummary {
            name: line.name.clone(),
            what: line.words.clone(),
            ..ThreadSummary::default()
        };
        Some(Self {
            tools: tools.collect(),
            pulls: pulls.collect(),
            contacts: contacts.collect(),
            threads: built.strands.iter().map(line).collect(),
            clips: built.clips.iter().map(line).collect(),
        })
    }

    /// Adds a step.
    pub(crate) fn add_step(&mut self, built: &BuiltScene) {
        let simulation = &built.simulation;
        let time = simulation.time();
        for (own, tool) in self.tools.iter_mut().zip(&built.tools) {
            let now = tool.report(simulation);
            own.force.add(now.force, time, now.unconverged);
            for (i, part) in own.parts.iter_mut().enumerate() {
                let force = now.parts.get(i).map_or(DVec3::ZERO, |part| part.force);
                part.add(force, time, now.unconverged);
            }
            (own.work, own.dissipation) = (now.work, now.dissipation);
            own.torque = now.torque.to_array();
            (own.depth, own.lag) = (own.depth.max(now.depth), own.lag.max(now.lag));
            (own.cut_area, own.fracture) = (now.cut_area, now.fracture);
            (own.separated, own.cut_vertices) = (now.separated, now.cut_vertices);
            (own.punctures, own.inserted) = (now.punctures, own.inserted.max(now.inserted));
        }
        for (own, pull) in self.pulls.iter_mut().zip(&built.pulls) {
            let now = pull.report(simulation);
            own.force.add(now.force, time, now.unconverged);
            own.work = now.work;
        }
        self.add_contacts(built, simulation, time);
        let lines = self.threads.iter_mut().chain(&mut self.clips);
        for (own, line) in lines.zip(built.strands.iter().chain(&built.clips)) {
            if line.entity().is_none() {
                continue;
            }
            let now = line.report(simulation);
            (own.tension, own.length) = (now.largest(), now.length);
            if !now.unconverged && own.tension > own.peak {
                (own.peak, own.peak_time) = (own.tension, time);
            }
            (own.work, own.dissipation) = (now.work, now.dissipation);
            (own.lost, own.broken) = (now.lost, now.broken);
        }
    }

    fn add_contacts(&mut self, built: &BuiltScene, simulation: &Simulation, time: f64) {
        for (own, contact) in self.contacts.iter_mut().zip(&built.contacts) {
            let Some(now) = simulation.body_contact_report(contact.entity) else { continue };
            own.force.add(now.force, time, now.unconverged);
            own.dissipation = now.dissipation;
            (own.area, own.depth) = (own.area.max(now.area), own.depth.max(now.depth));
        }
    }

    /// A line for every tool, pull and contact.
    pub(super) fn describe(&self, block: &mut TextBlock) {
        for tool in &self.tools {
            let friction = short(tool.friction);
            let words = format!("{}; friction = {friction}; {}", tool.what, tool.force.words());
            block.line(format!("tool {}", tool.name), words);
            if tool.separated > 0 {
                let words = format!(
                    "{} elements parted, {} vertices more; {} cm^2 against toughness, {} J",
                    tool.separated,
                    tool.cut_vertices,
                    short(tool.cut_area * 1e4),
                    short(tool.fracture)
                );
                block.line("  cut", words);
            }
            if tool.inserted > 0.0 {
                let words = format!(
                    "{} punctures, up to {} mm in tissue, {} J at its tip",
                    tool.punctures,
                    short(tool.inserted * 1e3),
                    short(tool.fracture)
                );
                block.line("  needle", words);
            }
            for (i, part) in tool.parts.iter().enumerate() {
                block.line(format!("  part {i}"), part.words());
            }
        }
        for pull in &self.pulls {
            let words = format!(
                "{} vertices of {}, {} N/m, {}; {}",
                pull.vertices,
                pull.body,
                short(pull.stiffness),
                pull.motion,
                pull.force.words()
            );
            block.line(format!("pull {}", pull.name), words);
        }
        for contact in &self.contacts {
            let [a, b] = &contact.bodies;
            // what a body does to itself sums to nothing
            let (of, force) = match a == b {
                true => (format!("{a} with itself"), String::new()),
                false => (format!("{a} with {b}"), format!("; {}", contact.force.words())),
            };
            let words = format!(
                "{of}; friction = {}; up to {} cm^2{force}",
                short(contact.friction),
                short(contact.area * 1e4)
            );
            block.line(format!("contact {}", contact.name), words);
        }
        for (kind, lines) in [("thread", &self.threads), ("clip", &self.clips)] {
            for own in lines {
                let (peak, when) = (short(own.peak), short(own.peak_time));
                let (end, length) = (short(own.tension), short(own.length * 1e3));
                let mut words = format!(
                    "{}; tension up to {peak} N at {when} s, {end} N over {length} mm at the end",
                    own.what
                );
                if own.lost > 0 {
                    words += &format!("; {} points lost", own.lost);
                }
                if own.broken {
                    words += "; broken";
                }
                block.line(format!("{kind} {}", own.name), words);
            }
        }
    }
}

impl TouchSummary {
    /// How well contact was resolved.
    pub(super) fn describe_accuracy(&self, block: &mut TextBlock) {
        let own = &self.figures;
        line!(
            block,
            "contact",
            "at most {} points; {} inner iterations per step (most {}), {} loops unconverged; deepest {} mm, {} \
                 of an edge",
            own.points_max,
            short(own.inner_iterations_mean),
            own.inner_iterations_max,
            own.unconverged,
            short(own.depth * 1e3),
            short(own.depth_over_edge)
        );
        let odd = [
            (own.substeps, format!("{} substeps (most {})", own.substeps, own.substeps_max)),
            (
                own.lagging,
                format!(
                    "behind its path in {} steps, by {} mm at most",
                    own.lagging,
                    short(own.lag * 1e3)
                ),
            ),
            (own.drawn_in, format!("{} drawn in", own.drawn_in)),
            (own.pierced, format!("{} inside after piercing", own.pierced)),
            (own.impacts, format!("{} impacts", own.impacts)),
        ];
        let used: Vec<String> =
            odd.into_iter().filter(|(count, _)| *count > 0).map(|(_, words)| words).collect();
        if !used.is_empty() {
            block.line("fast tools", used.join(", "));
        }
    }
}
