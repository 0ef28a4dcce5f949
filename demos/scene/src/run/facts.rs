//! What is known at the end of a run, and the summary of it.

use super::totals::Totals;
use crate::assemble::{BuiltBody, BuiltScene, MaterialRanges};
use crate::scene::{LoadedScene, Mode};
use crate::summary::{
    AxesSummary, BodySummary, ConstraintSummary, FamilySummary, Machine, MembraneSummary,
    RunSettings, RunSummary, RunTiming, SCHEMA, SceneSummary, SolverSummary, Stage, SystemSummary,
    TouchSummary, Versions,
};
use sinew::engine::report::SystemTimes;
use sinew::engine::schedule::Executor;
use sinew::engine::workers::Workers;
use sinew::models::axes::muscle::Muscles;
use std::time::Instant;

/// A run at its end.
pub(super) struct RunFacts<'a> {
    pub loaded: &'a LoadedScene,
    pub built: BuiltScene,
    pub totals: Totals,
    /// When it started.
    pub start: Instant,
    /// Host time (s) until the first step.
    pub setup: f64,
    /// Why it ended early, or is not to be trusted.
    pub failure: Option<String>,
    /// It came to its end, and is not to be trusted.
    pub untrusted: bool,
    /// Columns and last values of the probes.
    pub final_probes: Vec<(String, f64)>,
    /// What was written.
    pub files: Vec<String>,
}

impl RunFacts<'_> {
    /// Number of steps carried out.
    pub fn steps(&self) -> u64 {
        self.totals.step_times.count()
    }

    pub fn is_dynamic(&self) -> bool {
        self.built.plan.mode == Mode::Dynamic
    }

    /// The summary.
    pub fn summary(mut self) -> RunSummary {
        let warnings = self.built.all_warnings();
        let timing = self.timing();
        let bodies: Vec<_> = (0..self.built.bodies.len()).map(|i| self.body(i)).collect();
        let scene = self.scene(&bodies);
        let (constraints, settings) = (self.constraints(), self.settings());
        let Self { mut built, totals, failure, untrusted, final_probes, files, .. } = self;
        let sums = built.simulation.totals().cloned().unwrap_or_default();
        let figures = sums.contact;
        RunSummary {
            schema: SCHEMA,
            completed: failure.is_none(),
            failure,
            untrusted,
            scene,
            machine: Machine::this(),
            versions: Versions::this(),
            settings,
            bodies,
            constraints,
            loads: built.loads.into_iter().map(|l| l.summary).collect(),
            resections: built.resections.into_iter().map(|r| r.summary).collect(),
            cuts: built.cuts.into_iter().map(|cut| cut.summary).collect(),
            pressures: built.pressures.into_iter().map(|p| p.summary).collect(),
            touch: totals.touched.map(|touched| TouchSummary { touched, figures }),
            final_probes,
            timing,
            gpu: totals.gpu,
            solver: SolverSummary { totals: sums.sums, figures: sums.solver },
            energy: sums.energy,
            volume: sums.volume,
            warnings,
            files,
            final_state_hash: format!("{:016x}", built.simulation.state_hash()),
        }
    }

    fn scene(&self, bodies: &[BodySummary]) -> SceneSummary {
        let scene = &self.loaded.scene;
        let sum = |count: fn(&BodySummary) -> usize| bodies.iter().map(count).sum();
        SceneSummary {
            name: scene.name.clone(),
            description: scene.description.trim().to_string(),
            file: self.loaded.file.display().to_string(),
            mode: if self.is_dynamic() { "dynamic" } else { "static" },
            gravity: scene.gravity,
            bodies: bodies.len(),
            vertices: sum(|b| b.vertices),
            tetrahedra: sum(|b| b.tetrahedra),
            hexahedra: sum(|b| b.hexahedra),
            edges: sum(|b| b.edges),
        }
    }

    fn settings(&self) -> RunSettings {
        let (plan, simulation) = (&self.built.plan, &self.built.simulation);
        let workers = simulation.world().resource::<Workers>();
        RunSettings {
            dt: plan.dt,
            steps: plan.steps,
            precision: simulation.precision().name(),
            backend: simulation.backend().name(),
            threads: workers.threads(),
            executor: simulation.world().resource::<Executor>().name(),
            instruction_set: workers.instruction_set().name(),
            solver: plan.settings.clone(),
        }
    }

    fn timing(&mut self) -> RunTiming {
        let steps = self.steps().max(1) as f64;
        let stepping = self.totals.step_times.total();
        // what systems took in the step that failed is among their times
        let tried = self.steps() + u64::from(self.totals.failed.is_some());
        let worked = stepping + self.totals.failed.unwrap_or(0.0);
        let total = self.start.elapsed().as_secs_f64();
        let simulated = if self.is_dynamic() { self.built.simulation.time() } else { 0.0 };
        let stage = |name, seconds: f64, every_step: bool| Stage {
            name,
            total_s: seconds,
            per_step_ms: every_step.then(|| 1e3 * seconds / steps),
            share: seconds / total,
        };
        let mut stages = vec![
            stage("set-up", self.setup, false),
            stage("steps", stepping, true),
            stage("probes", self.totals.probes, true),
        ];
        if self.totals.frames > 1e-3 * total {
            stages.push(stage("frames", self.totals.frames, true));
        }
        let times = self.built.simulation.world().resource::<SystemTimes>();
        let systems = times.entries.iter().map(|entry| SystemSummary {
            name: entry.name,
            total_s: entry.seconds,
            runs: entry.runs,
            per_step_ms: 1e3 * entry.seconds / tried.max(1) as f64,
            share: if worked > 0.0 { entry.seconds / worked } else { 0.0 },
        });
        RunTiming {
            total_s: total,
            simulated_s: simulated,
            real_time_factor: (self.is_dynamic() && stepping > 0.0).then(|| simulated / stepping),
            systems: systems.collect(),
            step: self.totals.step_times.timing(),
            stages,
        }
    }

    fn body(&self, index: usize) -> BodySummary {
        let simulation = &self.built.simulation;
        let body: &BuiltBody = &self.built.bodies[index];
        let activation = |family: &str| {
            let mut muscles = simulation.world().get_resource::<Muscles>()?.iter();
            let own = muscles.find(|m| m.body == body.handle.0 && m.family == family);
            own.map(|m| m.activation())
        };
        let volume_ratios = self.totals.volume_ratios[index];
        let statistics = &body.report.statistics;
        let extent = statistics
            .bounds
            .map_or([0.0; 3], |[low, high]| std::array::from_fn(|k| high[k] - low[k]));
        BodySummary {
            name: body.name.clone(),
            source: body.mesh.source.clone(),
            vertices: body.used_vertices.len(),
            unused_vertices: body.mesh.points.len() - body.used_vertices.len(),
            tetrahedra: body.mesh.tetrahedra.len(),
            hexahedra: body.mesh.hexahedra.len(),
            edges: simulation.topology().bodies[body.handle.0].blocks.len(),
            volume: statistics.total_volume,
            mass: body.mass,
            extent,
            worst_quality: statistics.worst_quality,
            preset: body.preset.clone(),
            material: body.material,
            material_ranges: MaterialRanges::new(
                &self.loaded.scene.bodies[index].material,
                &body.mesh,
            ),
            model: body.model,
            evaluation: body.evaluation,
            volume_rule: body.volume,
            integration: body.integration,
            lattice: body.lattice,
            carried: body.carried.as_ref().map(|own| own.points.len()),
            element_method: body.springs,
            tear: simulation.tear_report(body.handle),
            membrane: body.membrane.as_ref().map(|m| MembraneSummary {
                triangles: m.triangles.len(),
                quads: m.quads.len(),
                area: m.area,
                thickness: m.settings.thickness,
                material: m.settings.material,
                model: m.settings.model,
                evaluation: m.settings.evaluation,
                element_method: m.settings.springs,
                bending: m.settings.bending.map(|b| b.thickness.unwrap_or(m.settings.thickness)),
                fibres: m.fibres.iter().map(FamilySummary::from).collect(),
            }),
            axes: body.axes.as_ref().map(|axes| AxesSummary::new(axes, activation, volume_ratios)),
        }
    }

    fn constraints(&self) -> Vec<ConstraintSummary> {
        let reactions = self.built.constraints.iter().zip(&self.totals.reactions);
        reactions
            .map(|(c, &largest_reaction)| ConstraintSummary {
                name: c.name.clone(),
                body: self.built.bodies[c.body].name.clone(),
                vertices: c.vertices.len(),
                axes: (0..3).filter(|&k| c.axes.holds(k)).map(|k| ['x', 'y', 'z'][k]).collect(),
                motion: c.motion.clone(),
                from: c.from.is_finite().then_some(c.from),
                until: c.until.is_finite().then_some(c.until),
                largest_reaction,
            })
            .collect()
    }
}
