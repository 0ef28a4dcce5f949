//! What probes can record: a row of [`PROBES`] for every quantity. A new quantity is a new row, and a word in
//! `demos/scenes/README.md`.

use crate::build::body::BuiltBody;
use crate::build::conditions::BuiltConstraint;
use glam::DVec3;
use sinew::engine::mesh::enclosed_volume;
use sinew::simulation::Simulation;

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
    pub evaluate: Evaluate,
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
}

/// A quantity of one column, or of three.
#[derive(Clone, Copy, Debug)]
pub enum Evaluate {
    /// A number.
    Scalar(fn(&mut Sampler, &Subject) -> f64),
    /// A vector.
    Vector(fn(&mut Sampler, &Subject) -> DVec3),
}

use Evaluate::{Scalar, Vector};

/// Everything that probes can record.
pub static PROBES: [Probe; 10] = [
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
        acting.map_or(DVec3::ZERO, |c| {
            // reactions are read from the forces of the state as it is
            now.elastic_energy();
            now.simulation.reaction(c.entity)
        })
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
    // between the faces of a group and their rim: what a cavity holds
    scalar("enclosed_volume", "m^3", Needs::Faces, |now, of| {
        enclosed_volume(&of.body.deformed(now.simulation), &of.probe.faces).abs()
    }),
];

/// A number whose column has the name of its word.
const fn scalar(
    key: &'static str,
    unit: &'static str,
    needs: Needs,
    evaluate: fn(&mut Sampler, &Subject) -> f64,
) -> Probe {
    Probe { key, column: key, unit, needs, evaluate: Scalar(evaluate) }
}

/// A vector, likewise.
const fn vector(
    key: &'static str,
    unit: &'static str,
    needs: Needs,
    evaluate: fn(&mut Sampler, &Subject) -> DVec3,
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
pub struct Subject<'a> {
    probe: &'a BuiltProbe,
    body: &'a BuiltBody,
    constraint: Option<&'a BuiltConstraint>,
}

impl Subject<'_> {
    /// Mean over the vertices of the probe.
    fn mean(&self, of_body: &[DVec3]) -> DVec3 {
        let vertices = &self.probe.vertices;
        let sum: DVec3 = vertices.iter().map(|&i| of_body[i as usize]).sum();
        sum / vertices.len().max(1) as f64
    }
}

/// Names of the columns of probes.
pub fn columns(probes: &[BuiltProbe]) -> Vec<String> {
    let recorded = probes.iter().flat_map(|p| p.record.iter().map(move |own| (&p.name, own)));
    recorded
        .flat_map(|(name, own)| {
            let column = move |end| format!("{name}.{}{end} ({})", own.column, own.unit);
            own.endings().iter().map(column)
        })
        .collect()
}

/// Values of probes in the order of [`columns`]; `reaction` is told constraints and their reactions (N).
pub fn values(
    now: &mut Sampler,
    bodies: &[BuiltBody],
    constraints: &[BuiltConstraint],
    probes: &[BuiltProbe],
    mut reaction: impl FnMut(usize, DVec3),
) -> Vec<f64> {
    let mut values = Vec::new();
    for probe in probes {
        let constraint = probe.constraint.map(|i| &constraints[i]);
        let of = Subject { probe, body: &bodies[probe.body], constraint };
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
