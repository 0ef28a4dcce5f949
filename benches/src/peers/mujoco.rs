//! MuJoCo flex, in a Python process that answers one JSON line per request.

use super::rival::{BeamCase, DAMPING, PeerRow, Rival, milliseconds, say};
use super::touch::{self, Finger, Sample, TouchBlock, TouchRow, TouchTurn};
use crate::toolbox::prelude::*;
use serde::Deserialize;
use serde_json::json;
use std::cell::RefCell;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};

const SCRIPT: &str = include_str!("../../peers/mujoco_flex.py");
/// Iterations at which its linear solves converge on all beams here; its own cap is 100.
const ENOUGH_ITERATIONS: u32 = 1000;

/// An answer of the script; which fields are there depends on the request.
#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(default)]
pub struct Reply {
    error: Option<String>,
    version: String,
    nodes: usize,
    elements: usize,
    /// Time of every step.
    pub milliseconds: Vec<f64>,
    displacements: Vec<f64>,
    /// Displacements (m) at each time of comparison.
    states: Vec<Vec<f64>>,
    speed: f64,
    passive_seconds: f64,
    kinematics_seconds: f64,
    /// What MuJoCo warned of.
    pub warnings: Vec<String>,
    iterations: u32,
    /// Normal force and friction (N) on the ball in every step.
    forces: Vec<[f64; 6]>,
}

impl Reply {
    /// Whether the loaded mesh is ours, so many times.
    fn same_mesh(&self, mesh: &Mesh, copies: usize) -> Result<()> {
        let (nodes, elements) = (copies * mesh.points.len(), copies * mesh.tetrahedra.len());
        if (self.nodes, self.elements) == (nodes, elements) {
            return Ok(());
        }
        Err(BenchError::Rival(format!(
            "MuJoCo flex: {} vertices and {} tetrahedra of {nodes} and {elements}",
            self.nodes, self.elements
        )))
    }
}

/// Reads an answer; the script's own complaint becomes the error.
pub fn parse(line: &str) -> Result<Reply> {
    let fail = |text: String| Err(BenchError::Rival(format!("MuJoCo flex: {text}")));
    match serde_json::from_str::<Reply>(line) {
        Ok(Reply { error: Some(error), .. }) => fail(error),
        Ok(reply) => Ok(reply),
        Err(error) => fail(format!("cannot read its answer ({error}): {}", line.trim_end())),
    }
}

/// Displacements (m) from a flat list, three per vertex.
pub fn to_vectors(flat: &[f64], expected: usize) -> Result<Vec<DVec3>> {
    if flat.len() != 3 * expected {
        return Err(BenchError::Rival(format!(
            "MuJoCo flex: {} numbers for {expected} vertices; its mesh is not ours",
            flat.len()
        )));
    }
    Ok(flat.chunks_exact(3).map(DVec3::from_slice).collect())
}

/// The process, its pipes and its folder; all go when it is dropped.
struct Process {
    child: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
    folder: PathBuf,
}

impl Process {
    fn ask(&mut self, request: &serde_json::Value) -> Result<Reply> {
        let gone = |error: &dyn std::fmt::Display| {
            BenchError::Rival(format!("MuJoCo flex: its process ended ({error})"))
        };
        let input = self.input.as_mut().ok_or_else(|| gone(&"closed"))?;
        writeln!(input, "{request}").and_then(|()| input.flush()).map_err(|e| gone(&e))?;
        let mut line = String::new();
        match self.output.read_line(&mut line) {
            Ok(0) => Err(gone(&"no answer")),
            Ok(_) => parse(&line),
            Err(error) => Err(gone(&error)),
        }
    }

    fn write(&self, name: &str, content: &impl serde::Serialize) -> Result<PathBuf> {
        let path = self.folder.join(name);
        let fail =
            |e: &dyn std::fmt::Display| BenchError::Rival(format!("{}: {e}", path.display()));
        let text = serde_json::to_string(content).map_err(|e| fail(&e))?;
        std::fs::write(&path, text).map_err(|e| fail(&e))?;
        Ok(path)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // end of input ends the script; a failure here leaves nothing that matters
        self.input = None;
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// What moves a flex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// Every vertex of linear tetrahedra.
    Full,
    /// Trilinear cells of a grid whose nodes are the vertices.
    Trilinear([usize; 3]),
    /// Cells of second order of a grid whose nodes, three along each edge of a cell, are the vertices.
    Quadratic([usize; 3]),
}

impl Freedom {
    /// Its name in MuJoCo, and cells of the grid.
    fn words(self) -> (&'static str, Option<[usize; 3]>) {
        match self {
            Self::Full => ("full", None),
            Self::Trilinear(cells) => ("trilinear", Some(cells)),
            Self::Quadratic(cells) => ("quadratic", Some(cells)),
        }
    }
}

/// MuJoCo, running.
pub struct MuJoCo {
    process: Rc<RefCell<Process>>,
    version: String,
}

impl MuJoCo {
    /// Starts the script, or says why not and what to do.
    pub fn start(python: &str) -> Result<Self, String> {
        let remedy = "install it with `python3 -m pip install mujoco` and name that Python";
        let skip = |why: &dyn std::fmt::Display| {
            format!("MuJoCo flex: not run with `{python}` ({why}); {remedy}")
        };
        static STARTED: AtomicU32 = AtomicU32::new(0);
        let name = [std::process::id(), STARTED.fetch_add(1, Ordering::Relaxed)];
        let folder = std::env::temp_dir().join(format!("sinew-peers-{}-{}", name[0], name[1]));
        std::fs::create_dir_all(&folder).map_err(|e| skip(&e))?;
        let process = Self::spawn(python, &folder).map_err(|e| {
            // nothing but the script is in it
            let _ = std::fs::remove_dir_all(&folder);
            skip(&e)
        })?;
        let process = Rc::new(RefCell::new(process));
        let hello = process.borrow_mut().ask(&json!({ "op": "version" })).map_err(|e| skip(&e))?;
        Ok(Self { process, version: hello.version })
    }

    fn spawn(python: &str, folder: &Path) -> std::io::Result<Process> {
        let script = folder.join("mujoco_flex.py");
        std::fs::write(&script, SCRIPT)?;
        let mut child = Command::new(python)
            .arg(&script)
            // it writes a log of its warnings where it runs
            .current_dir(folder)
            // one thread, as the rows say
            .env("OMP_NUM_THREADS", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?;
        let missing = || std::io::Error::other("no pipe");
        let input = child.stdin.take().ok_or_else(missing)?;
        let output = BufReader::new(child.stdout.take().ok_or_else(missing)?);
        Ok(Process { child, input: Some(input), output, folder: folder.into() })
    }

    /// Loads the beam; rows for each step with its own iteration cap, and one with enough iterations. Those of one
    /// freedom hold until another beam is loaded with it.
    pub fn rivals(
        &mut self,
        case: &BeamCase,
        steps: &[f64],
        freedom: Freedom,
    ) -> Result<Vec<Box<dyn Rival>>> {
        let (key, cells) = freedom.words();
        let process = self.process.borrow_mut();
        let mesh = process.write(&format!("{key}-mesh.json"), &case.beam.file())?;
        let flat = |u: &[DVec3]| u.iter().flat_map(|x| x.to_array()).collect::<Vec<f64>>();
        let start = process.write(&format!("{key}-start.json"), &flat(&case.start()))?;
        let truth = process.write(&format!("{key}-truth.json"), &flat(&case.truth))?;
        drop(process);
        let loaded = self.process.borrow_mut().ask(&json!({
            "op": "load",
            "key": key,
            "cells": cells,
            "mesh": mesh,
            "young": case.beam.material.young_modulus,
            "poisson": case.beam.material.poisson_ratio,
            "gravity": case.beam.gravity,
        }))?;
        loaded.same_mesh(&case.beam.mesh, 1)?;
        let middle = steps[steps.len() / 2];
        let mut settings: Vec<(f64, u32)> = steps.iter().map(|&h| (h, loaded.iterations)).collect();
        settings.push((middle, ENOUGH_ITERATIONS));
        Ok(settings
            .into_iter()
            .map(|(h, iterations)| -> Box<dyn Rival> {
                Box::new(MujocoRun {
                    flex: self.flex(key),
                    h,
                    iterations,
                    default_cap: iterations == loaded.iterations,
                    // the forces do not depend on the setting
                    measure_force: h == middle && iterations == loaded.iterations,
                    start: start.clone(),
                    truth: truth.clone(),
                })
            })
            .collect())
    }
}

/// How MuJoCo is set for contact: step (s), options, contact parameters, words.
type Touching = (f64, serde_json::Value, serde_json::Value, &'static str);

/// Its defaults at its own default step and at the one that ours makes; and the stiffest contact (a time constant
/// below two steps is taken as that of the step) with what its manual advises: conjugate gradients for soft solids,
/// the elliptic cone and a larger `impratio` against slip. Smaller steps change the force by 0.1 %, impedances nearer
/// to 1 than the default make the many contacts of flat faces fight each other: force and depth scatter.
fn touching() -> [Touching; 3] {
    let stiff = json!({ "solref": "0.001 1" });
    let advised = json!({
        "iterations": ENOUGH_ITERATIONS, "solver": "CG", "tolerance": 1e-6, "cone": "elliptic", "impratio": 100,
    });
    [
        (0.002, json!({}), json!({}), "contact and step by default"),
        (0.01, json!({}), json!({}), "contact by default"),
        (0.002, advised, stiff, "solref 0.001 1, CG to 1e-6, elliptic cone, impratio 100"),
    ]
}

impl MuJoCo {
    fn flex(&self, key: &'static str) -> Flex {
        let (process, version) = (self.process.clone(), self.version.clone());
        Flex { process, version, key, remark: String::new() }
    }

    /// Settings for the ball or for two blocks.
    pub fn fingers(&mut self, block: &TouchBlock) -> Result<Vec<Box<dyn Finger>>> {
        let mesh = self.process.borrow().write("block.json", &block.file())?;
        Ok(touching()
            .into_iter()
            .map(|touching| -> Box<dyn Finger> {
                let flex = self.flex(touching.3);
                Box::new(MujocoPress { flex, mesh: mesh.clone(), touching })
            })
            .collect())
    }
}

/// What one setting says to MuJoCo, and what it is told.
struct Flex {
    process: Rc<RefCell<Process>>,
    version: String,
    /// Name under which its body is loaded.
    key: &'static str,
    remark: String,
}

impl Flex {
    fn ask(&mut self, mut request: serde_json::Value) -> Result<Reply> {
        request["key"] = self.key.into();
        let reply = self.process.borrow_mut().ask(&request)?;
        for warning in &reply.warnings {
            // the first sentence says what; numbers in the rest differ from run to run
            let text = warning.split([':', ',']).next().unwrap_or(warning);
            if !self.remark.contains(text) {
                say(&mut self.remark, format!("it warns: {text}"));
            }
        }
        Ok(reply)
    }
}

/// One setting of MuJoCo under the ball.
struct MujocoPress {
    flex: Flex,
    mesh: PathBuf,
    touching: Touching,
}

impl Finger for MujocoPress {
    fn row(&self, block: &TouchBlock) -> TouchRow {
        let (h, _, _, words) = &self.touching;
        let setting = format!("flex StVK, discrete, h = {}, {words}", milliseconds(*h));
        block.row("MuJoCo", &self.flex.version, setting)
    }

    fn step(&self) -> f64 {
        self.touching.0
    }

    fn start(&mut self, block: &TouchBlock, friction: f64) -> Result<()> {
        let (h, option, contact, _) = self.touching.clone();
        let loaded = self.flex.ask(json!({
            "op": "touch-load", "mesh": self.mesh, "young": block.material.young_modulus,
            "poisson": block.material.poisson_ratio, "gravity": block.gravity, "damping": block.damping,
            "h": h, "option": option, "contact": contact, "friction": friction,
            "radius": (!block.way.blocks).then_some(touch::RADIUS), "at": block.way.start.to_array(),
            "held": block.way.blocks.then_some(&block.surface),
        }))?;
        loaded.same_mesh(&block.mesh, block.blocks())
    }

    fn advance(&mut self, block: &TouchBlock, places: &[DVec3]) -> Result<TouchTurn> {
        let to: Vec<[f64; 3]> = places.iter().map(|x| x.to_array()).collect();
        let reply = self.flex.ask(json!({ "op": "touch", "places": to }))?;
        let displacements =
            to_vectors(&reply.displacements, block.blocks() * block.mesh.points.len())?;
        if [reply.milliseconds.len(), reply.forces.len()] != [places.len(); 2] {
            let given = reply.forces.len();
            let text = format!("MuJoCo flex: forces of {given} steps of {}", places.len());
            return Err(BenchError::Rival(text));
        }
        let samples = reply.milliseconds.iter().zip(&reply.forces).map(|(&ms, f)| {
            let friction = DVec3::from_slice(&f[3..]);
            Sample { ms, force: DVec3::from_slice(f) + friction, friction: Some(friction) }
        });
        Ok(TouchTurn { samples: samples.collect(), displacements })
    }

    fn remark(&self) -> String {
        self.flex.remark.clone()
    }
}

/// One setting of MuJoCo on the loaded beam; the name of what moves it is that of the load.
struct MujocoRun {
    flex: Flex,
    h: f64,
    iterations: u32,
    default_cap: bool,
    measure_force: bool,
    start: PathBuf,
    truth: PathBuf,
}

impl Rival for MujocoRun {
    fn time(&mut self, _: &BeamCase, steps: usize) -> Result<Vec<f64>> {
        let request = json!({
            "op": "time", "h": self.h, "steps": steps, "start": self.start,
            "iterations": self.iterations,
        });
        Ok(self.flex.ask(request)?.milliseconds)
    }

    fn force(&mut self, case: &BeamCase) -> Result<Option<f64>> {
        if !self.measure_force {
            return Ok(None);
        }
        let reply = self.flex.ask(json!({ "op": "force", "repeats": 20 }))?;
        let text = "its flex kinematics before that cost another";
        if !self.flex.remark.contains(text) {
            let ns = reply.kinematics_seconds * 1e9 / case.beam.mesh.tetrahedra.len() as f64;
            say(&mut self.flex.remark, format!("force is mj_passive; {text} {ns:.1} ns/tet"));
        }
        Ok(Some(reply.passive_seconds))
    }

    fn settle(&mut self, case: &BeamCase) -> Result<Vec<DVec3>> {
        let (steps, warm) = case.settling(self.h);
        let start = warm.then(|| self.truth.clone());
        let request = json!({
            "op": "settle", "h": self.h, "steps": steps, "start": start, "damping": DAMPING,
            "iterations": self.iterations,
        });
        let reply = self.flex.ask(request)?;
        to_vectors(&reply.displacements, case.beam.mesh.points.len())
    }

    fn swing(&mut self, case: &BeamCase, steps: usize, every: usize) -> Result<Vec<Vec<DVec3>>> {
        let request = json!({
            "op": "swing", "h": self.h, "steps": steps, "every": every, "start": null,
            "iterations": self.iterations,
        });
        let states = self.flex.ask(request)?.states;
        if states.len() != steps / every {
            let (given, wanted) = (states.len(), steps / every);
            return Err(BenchError::Rival(format!("MuJoCo flex: {given} states of {wanted}")));
        }
        states.iter().map(|u| to_vectors(u, case.beam.mesh.points.len())).collect()
    }

    fn row(&self, case: &BeamCase) -> PeerRow {
        let kind = match self.flex.key {
            "full" => String::new(),
            cells => format!("{cells} cells, "),
        };
        let setting = format!(
            "flex StVK, {kind}discrete, h = {}, at most {} iterations{}",
            milliseconds(self.h),
            self.iterations,
            if self.default_cap { " (its default)" } else { "" }
        );
        case.row("MuJoCo", &self.flex.version, setting)
    }

    fn step(&self) -> Option<f64> {
        Some(self.h)
    }

    fn remark(&self) -> String {
        self.flex.remark.clone()
    }
}
