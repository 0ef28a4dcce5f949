//! What an engine must do to have a row among the beams, and the turns in which all of them are timed.

use super::beam::Beam;
use super::equilibrium::equilibrium;
use super::sinew_rows::SinewRun;
use crate::toolbox::prelude::*;
use crate::toolbox::stats::median;
use sinew::models::body::VolumeRule;
use sinew_tune::measures::displacement_error;

/// Mass-proportional damping (1/s) while a beam settles.
pub const DAMPING: f64 = 20.0;
/// Simulated time (s) in which a beam settles: rests of its first modes fade by more than 1e-8.
pub const SETTLE_SECONDS: f64 = 2.0;
/// Most steps spent on settling a body of [`LARGE`] elements or more.
pub const MAX_SETTLE_STEPS: usize = 60;
/// Times (s) at which motions are compared: a multiple of every step, and as many of them as take the beams through a
/// period or so.
const SWING: (f64, usize) = (0.1, 3);
/// Step (s) of the fine motion, of second order and converged: explicit steps come within 0.5 % of it on the beam of 1 536
/// tetrahedra, and within 1.4 % on that of 160.
const FINE_STEP: f64 = 0.005;
/// Elements from which on a body counts as large.
pub const LARGE: usize = 20_000;

/// One engine in one setting on one scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PeerRow {
    /// Engine.
    pub engine: String,
    /// Its version.
    pub version: String,
    /// Scene: size of the beam, load, energy.
    pub scene: String,
    /// Vertices.
    pub nodes: usize,
    /// Tetrahedra.
    pub elements: usize,
    /// Young's modulus (Pa).
    pub young_modulus: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Step, solver, iterations in words.
    pub setting: String,
    /// Threads.
    pub threads: usize,
    /// `"f64"` or `"f32"`.
    pub precision: String,
    /// Median time (ms) of a step.
    pub ms_per_step: Option<f64>,
    /// Seconds of computation per simulated second.
    pub cost_per_simulated_second: Option<f64>,
    /// Time (ns) of the elastic forces per tetrahedron.
    pub force_ns_per_element: Option<f64>,
    /// Static error (%): root mean square of the displacement error over that of the truth.
    pub error_percent: Option<f64>,
    /// Motion from the shape at rest against converged steps of implicit Euler, as long as these, on the same mesh and
    /// with the same energy (%): what linearisation and loose solves cost. None where the step is of another kind.
    pub step_percent: Option<f64>,
    /// The same motion against a fine one (%).
    pub swing_percent: Option<f64>,
    /// What else there is to know, in words.
    pub note: String,
}

/// A beam with its truth.
pub struct BeamCase {
    /// The beam.
    pub beam: Beam,
    /// Equilibrium displacements (m).
    pub truth: Vec<DVec3>,
}

impl BeamCase {
    /// With its truth, by converged Newton.
    ///
    /// # Errors
    /// When Newton stops before it has converged.
    pub fn new(beam: Beam) -> Result<Self> {
        let truth = equilibrium(&beam, Model::StVK, VolumeRule::Elements)?;
        Ok(Self { beam, truth })
    }

    /// Where timed runs begin: half of the equilibrium displacement.
    pub fn start(&self) -> Vec<DVec3> {
        self.truth.iter().map(|u| *u * 0.5).collect()
    }

    /// Steps of settling at `h`, and whether they start from the truth.
    pub fn settling(&self, h: f64) -> (usize, bool) {
        let steps = (SETTLE_SECONDS / h).ceil() as usize;
        let warm = self.beam.mesh.tetrahedra.len() >= LARGE && steps > MAX_SETTLE_STEPS;
        (if warm { MAX_SETTLE_STEPS / 2 } else { steps }, warm)
    }

    /// A row without figures.
    pub fn row(&self, engine: &str, version: &str, setting: String) -> PeerRow {
        let b = &self.beam;
        PeerRow {
            engine: engine.into(),
            version: version.into(),
            scene: b.name.clone(),
            nodes: b.mesh.points.len(),
            elements: b.mesh.tetrahedra.len(),
            young_modulus: b.material.young_modulus,
            poisson_ratio: b.material.poisson_ratio,
            setting,
            threads: 1,
            precision: "f64".into(),
            ..PeerRow::default()
        }
    }
}

/// Static error (%) of displacements against the truth: (field, tip).
pub fn static_error(beam: &Beam, u: &[DVec3], truth: &[DVec3]) -> (f64, f64) {
    let sum =
        |values: &mut dyn Iterator<Item = DVec3>| values.map(|x| x.length_squared()).sum::<f64>();
    let difference = sum(&mut u.iter().zip(truth).map(|(a, b)| *a - *b));
    let field = (difference / sum(&mut truth.iter().copied())).sqrt();
    let tip = beam.tip(u) / beam.tip(truth) - 1.0;
    (100.0 * field, 100.0 * tip)
}

/// A time in words.
pub fn milliseconds(seconds: f64) -> String {
    format!("{} ms", (seconds * 1e5).round() / 100.0)
}

/// Adds a sentence to a note, if there is one.
pub fn say(note: &mut String, text: impl AsRef<str>) {
    let text = text.as_ref();
    *note += if note.is_empty() || text.is_empty() { "" } else { "; " };
    *note += text;
}

/// One engine in one setting: timed in turns with the others, then settled.
pub trait Rival {
    /// Times undamped steps (ms each) from the case's start.
    fn time(&mut self, case: &BeamCase, steps: usize) -> Result<Vec<f64>>;
    /// Displacements (m) after every `every` of undamped steps from the shape at rest.
    fn swing(&mut self, case: &BeamCase, steps: usize, every: usize) -> Result<Vec<Vec<DVec3>>>;
    /// Linear iterations per timed step, where the engine tells them.
    fn linear_iterations(&self) -> Option<f64> {
        None
    }
    /// Seconds of one evaluation of the elastic forces, where it can be told.
    fn force(&mut self, case: &BeamCase) -> Result<Option<f64>>;
    /// Settles and returns the displacements (m).
    fn settle(&mut self, case: &BeamCase) -> Result<Vec<DVec3>>;
    /// What its settled state should be, where that is not the case's truth.
    fn truth(&self, _: &BeamCase) -> Result<Option<Vec<DVec3>>> {
        Ok(None)
    }
    /// Its energy.
    fn energy(&self) -> Model {
        Model::StVK
    }
    /// Whether its steps are meant to be those of implicit Euler.
    fn is_euler(&self) -> bool {
        true
    }
    /// Row without figures.
    fn row(&self, case: &BeamCase) -> PeerRow;
    /// Step (s); none for an equilibrium in one go.
    fn step(&self) -> Option<f64>;
    /// What the runs said.
    fn remark(&self) -> String {
        String::new()
    }
}

/// Converged motions of a beam, each made when it is first asked for.
struct Motions<'a> {
    case: &'a BeamCase,
    known: Vec<(Integrator, Model, f64, Vec<Vec<DVec3>>)>,
}

impl Motions<'_> {
    /// States (m) of [`SWING`] in converged steps (s).
    fn of(&mut self, integrator: Integrator, energy: Model, h: f64) -> Result<&[Vec<DVec3>]> {
        let found = self.known.iter().position(|k| (k.0, k.1, k.2) == (integrator, energy, h));
        let at = match found {
            Some(at) => at,
            None => {
                let mut run = SinewRun::converged("converged", energy, integrator, h);
                self.known.push((integrator, energy, h, swing(&mut run, self.case, h)?));
                self.known.len() - 1
            }
        };
        Ok(&self.known[at].3)
    }

    /// Errors (%) of a rival's motion: of its step, and against the fine motion.
    fn errors(&mut self, rival: &mut dyn Rival) -> Result<[Option<f64>; 2]> {
        let Some(h) = rival.step() else { return Ok([None; 2]) };
        let (energy, n) = (rival.energy(), self.case.beam.mesh.points.len());
        let states = swing(rival, self.case, h)?;
        let percent =
            |truth: &[Vec<DVec3>]| displacement_error(&states, truth, n).map(|e| 100.0 * e);
        let fine = percent(self.of(Integrator::TrBdf2, energy, FINE_STEP)?);
        let own = match rival.is_euler() {
            true => percent(self.of(Integrator::Newton, energy, h)?),
            false => None,
        };
        Ok([own, fine])
    }
}

/// States (m) of [`SWING`] in steps (s) of which a whole number leads from one to the next.
fn swing(rival: &mut dyn Rival, case: &BeamCase, h: f64) -> Result<Vec<Vec<DVec3>>> {
    let every = (SWING.0 / h).round() as usize;
    rival.swing(case, every * SWING.1, every)
}

/// Runs the rivals in turns and gives their rows; a rival that fails keeps its row with the reason.
pub fn compete(case: &BeamCase, rivals: &mut [Box<dyn Rival + '_>], quick: bool) -> Vec<PeerRow> {
    let (rounds, steps) = match (quick, case.beam.mesh.tetrahedra.len() >= LARGE) {
        (true, _) => (3, 5),
        (false, false) => (5, 10),
        (false, true) => (3, 3),
    };
    let mut rows: Vec<PeerRow> = rivals.iter().map(|r| r.row(case)).collect();
    let mut times = vec![Vec::new(); rivals.len()];
    let mut forces = vec![Vec::new(); rivals.len()];
    let mut failed = vec![false; rivals.len()];
    let n = case.beam.mesh.tetrahedra.len() as f64;
    for _ in 0..rounds {
        for (i, rival) in rivals.iter_mut().enumerate() {
            if failed[i] {
                continue;
            }
            // an equilibrium starts from rest whatever came before: one is enough per round
            let steps = if rival.step().is_some() { steps } else { 1 };
            match rival.time(case, steps).and_then(|t| Ok((t, rival.force(case)?))) {
                Ok((time, force)) => {
                    times[i].extend(time);
                    forces[i].extend(force.map(|seconds| seconds * 1e9 / n));
                }
                Err(error) => {
                    failed[i] = true;
                    say(&mut rows[i].note, format!("failed: {error}"));
                }
            }
        }
    }
    let mut motions = Motions { case, known: Vec::new() };
    for (i, rival) in rivals.iter_mut().enumerate() {
        let row = &mut rows[i];
        // a speed without an error is half a result: none is given for a run that failed
        if failed[i] {
            continue;
        }
        match rival.settle(case).and_then(|u| Ok((u, rival.truth(case)?))) {
            Ok((u, truth)) => {
                let truth = truth.as_deref().unwrap_or(&case.truth);
                let (field, tip) = static_error(&case.beam, &u, truth);
                row.ms_per_step = median(&times[i]);
                row.cost_per_simulated_second =
                    rival.step().zip(row.ms_per_step).map(|(h, ms)| ms * 1e-3 / h);
                row.force_ns_per_element = median(&forces[i]);
                row.error_percent = Some(field);
                say(&mut row.note, format!("tip {tip:+.3e} %"));
                if rival.step().is_some_and(|h| case.settling(h).1) {
                    say(&mut row.note, "settled from the truth: drift only");
                }
            }
            Err(error) => say(&mut row.note, format!("failed to settle: {error}")),
        }
        match motions.errors(&mut **rival) {
            Ok(errors) => [row.step_percent, row.swing_percent] = errors,
            Err(error) => say(&mut row.note, format!("its motion failed: {error}")),
        }
        say(&mut row.note, rival.remark());
    }
    rows
}
