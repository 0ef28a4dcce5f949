//! The summary of a run as text.

use super::{
    AxesSummary, BodySummary, FamilySummary, Level, MembraneSummary, RunSummary, SolverSummary,
    Warning, evaluation_name,
};
use crate::assemble::{CutSummary, ResectionSummary};
use crate::text::{TextBlock, counted, line, pressure, seconds, short, write_blocks};
use sinew::engine::mesh::LatticeReport;
use sinew::models::axes::description::FibreForm;
use sinew::models::body::lumped::SpringRule;
use sinew::models::body::sheet::MembraneModel;
use sinew::models::body::{Evaluation, Integration, Model, VolumeRule};
use std::fmt;

impl fmt::Display for RunSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}", self.scene.name, self.headline())?;
        self.write_warnings(f)?;
        write_blocks(f, &[self.what(), self.speed(), self.accuracy()])?;
        if !self.final_probes.is_empty() {
            writeln!(f, "\nResults at the end{}", self.doubt())?;
        }
        let width = self.final_probes.iter().map(|(name, _)| name.chars().count()).max();
        for (name, value) in &self.final_probes {
            writeln!(f, "  {name:<0$}  {1:>9}", width.unwrap_or(0), short(*value))?;
        }
        self.write_files(f)
    }
}

/// A report in a few lines.
pub struct Brief<'a>(&'a RunSummary);

impl fmt::Display for Brief<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let run = self.0;
        writeln!(f, "{}: {}", run.scene.name, run.headline())?;
        run.write_warnings(f)?;
        let mut block = TextBlock::new("What was simulated");
        run.bodies.iter().for_each(|body| body.describe(&mut block));
        run.touch.iter().for_each(|touch| touch.touched.describe(&mut block));
        let mut results = TextBlock::new(format!("Results{}", run.doubt()));
        for c in run.constraints.iter().filter(|c| c.largest_reaction.is_some()) {
            let largest = short(c.largest_reaction.unwrap_or(0.0));
            line!(results, format!("hold {}", c.name), "largest reaction {largest} N");
        }
        let values = joined(&run.final_probes);
        for (name, value) in values.iter().take(BRIEF) {
            results.line(name, format!("{value} at the end"));
        }
        if values.len() > BRIEF {
            line!(results, "", "and {} more", values.len() - BRIEF);
        }
        results.line("energy (J)", run.energy_balance());
        results.line("volume ratio J", run.volume_words());
        write_blocks(f, &[block, results])?;
        run.write_files(f)?;
        writeln!(f, "\n-v tells settings, times and accuracy as well")
    }
}

/// Values of probes, those of a vector in one.
fn joined(probes: &[(String, f64)]) -> Vec<(String, String)> {
    let mut all: Vec<(String, String)> = Vec::new();
    let mut rest = probes;
    while let [(name, value), tail @ ..] = rest {
        let vector = name.contains("_x (").then(|| name.replacen("_x (", "_y (", 1));
        match (vector, tail) {
            (Some(second), [(y, v), (_, w), others @ ..]) if *y == second => {
                let [u, v, w] = [*value, *v, *w].map(short);
                all.push((name.replacen("_x (", " (", 1), format!("[{u}, {v}, {w}]")));
                rest = others;
            }
            _ => {
                all.push((name.clone(), short(*value)));
                rest = tail;
            }
        }
    }
    all
}

/// Values of probes in a brief report.
const BRIEF: usize = 8;

impl RunSummary {
    /// The report in a few lines, for a terminal.
    pub fn brief(&self) -> Brief<'_> {
        Brief(self)
    }

    /// Why it is not to be trusted, or where it failed, as the first line and pages say it.
    pub fn doubted(&self) -> Option<String> {
        let failure = self.failure.as_ref()?;
        let (done, steps) = (self.timing.step.count, self.settings.steps);
        Some(if self.untrusted {
            format!("NOT TO BE TRUSTED, though all {steps} steps were made: {failure}")
        } else {
            format!("FAILED after {done} of {steps} steps: {failure}")
        })
    }

    /// What happened, what does not let one trust it, and how many warnings there are.
    fn headline(&self) -> String {
        let total = seconds(self.timing.total_s);
        let done = self.timing.step.count;
        let mut line = match (self.doubted(), self.timing.real_time_factor) {
            (Some(failure), _) => failure,
            (None, Some(_)) => format!("{} simulated in {total}", seconds(self.timing.simulated_s)),
            (None, None) => format!("equilibrium found in {total}"),
        };
        let unconverged = self.solver.figures.unconverged_steps;
        if unconverged > 0 && self.failure.is_none() {
            line += &format!("; {unconverged} of {done} steps did not converge");
        }
        let missed = self.touch.as_ref().map_or(0, |touch| touch.figures.missed);
        if missed > 0 && self.failure.is_none() {
            line += &format!("; forces of {missed} steps did not converge");
        }
        let warnings = self.warnings.iter().filter(|w| w.level == Level::Warning).count();
        match warnings {
            0 => line,
            1 => line + "; 1 warning",
            more => format!("{line}; {more} warnings"),
        }
    }

    /// What is to be said of forces at the end.
    fn doubt(&self) -> &'static str {
        match &self.touch {
            Some(touch) if touch.figures.missed_final => ", whose forces did not converge",
            _ => "",
        }
    }

    /// Warnings, then notes.
    fn write_warnings(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nWarnings")?;
        for of in [Level::Warning, Level::Note] {
            for Warning { code, subject, message, remedy, .. } in
                self.warnings.iter().filter(|w| w.level == of)
            {
                writeln!(f, "  {} [{code}] {subject}: {message}\n    -> {remedy}", of.name())?;
            }
        }
        if self.warnings.is_empty() { writeln!(f, "  none") } else { Ok(()) }
    }

    fn write_files(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nFiles")?;
        for file in &self.files {
            writeln!(f, "  {file}")?;
        }
        if self.files.is_empty() {
            let advice = "use --out DIR for frames and probes, --json FILE for the figures";
            writeln!(f, "  none; {advice}")?;
        }
        Ok(())
    }

    fn what(&self) -> TextBlock {
        let mut block = TextBlock::new("What was simulated");
        line!(block, "scene", "{} ({})", self.scene.file, self.scene.mode);
        self.bodies.iter().for_each(|body| body.describe(&mut block));
        for c in &self.constraints {
            let window = match (c.from, c.until) {
                (None, None) => String::new(),
                (Some(a), None) => format!(", from {a} s"),
                (None, Some(b)) => format!(", until {b} s"),
                (Some(a), Some(b)) => format!(", from {a} s to {b} s"),
            };
            let force = c.largest_reaction;
            let force =
                force.map_or(String::new(), |r| format!("; largest reaction {} N", short(r)));
            line!(
                block,
                format!("hold {}", c.name),
                "{} vertices of {} along {}, {}{window}{force}",
                c.vertices,
                c.body,
                c.axes,
                c.motion
            );
        }
        for p in &self.pressures {
            line!(
                block,
                format!("pressure {}", p.name),
                "{} on {} triangles of {}",
                pressure(p.pressure),
                p.triangles,
                p.body
            );
        }
        for load in &self.loads {
            let [x, y, z] = load.force.map(short);
            line!(
                block,
                format!("load {}", load.name),
                "[{x}, {y}, {z}] N on {} vertices of {}",
                load.vertices,
                load.body
            );
        }
        self.touch.iter().for_each(|touch| touch.touched.describe(&mut block));
        self.resections.iter().for_each(|resection| describe_resection(resection, &mut block));
        self.cuts.iter().for_each(|cut| describe_cut(cut, &mut block));
        let (s, steps) = (&self.settings.solver, self.settings.steps);
        let integrator = s.integrator.resolve().name();
        if self.scene.mode == "static" {
            line!(block, "integrator", "{integrator}, {steps} load step(s)");
        } else {
            line!(
                block,
                "integrator",
                "{integrator}, dt = {}, {} steps, {} simulated",
                seconds(self.settings.dt),
                self.timing.step.count,
                seconds(self.timing.simulated_s)
            );
            let (mass, stiffness) = (s.mass_damping, s.stiffness_damping);
            line!(block, "damping", "mass {mass} 1/s, stiffness {stiffness} s");
        }
        block
    }

    fn speed(&self) -> TextBlock {
        let mut block = TextBlock::new("How fast");
        let step = &self.timing.step;
        let [median, p99, longest] = [step.median_ms, step.p99_ms, step.max_ms].map(short);
        line!(
            block,
            "per step",
            "{median} ms median, {p99} ms 99th percentile, {longest} ms longest"
        );
        if let Some(factor) = self.timing.real_time_factor {
            line!(block, "real time", "{} times real time", short(factor));
        }
        let (machine, settings) = (&self.machine, &self.settings);
        let processor = machine.processor.as_deref().unwrap_or(machine.architecture);
        line!(block, "on", "{processor}, {} cores, {}", machine.cores, machine.os);
        line!(
            block,
            "with",
            "{} thread(s), {}, instruction set {}, executor {}",
            settings.threads,
            settings.precision,
            settings.instruction_set,
            settings.executor
        );
        let slept = self.solver.totals.sleeping;
        if slept > 0 {
            line!(block, "asleep", "{slept} steps of bodies were left out, as these rested");
        }
        self.describe_gpu(&mut block);
        let stages: Vec<String> = self
            .timing
            .stages
            .iter()
            .map(|s| format!("{} {} ({:.0} %)", s.name, seconds(s.total_s), 100.0 * s.share))
            .collect();
        block.line("time went to", stages.join(", "));
        let names = self.timing.systems.iter().map(|s| s.name.chars().count());
        let width = names.max().unwrap_or(0);
        for (i, system) in self.timing.systems.iter().enumerate() {
            // a run that broke off has no whole of which they are shares
            let share = match &self.failure {
                None => format!(" {:>3.0} % of the steps,", 100.0 * system.share),
                Some(_) => String::new(),
            };
            line!(
                block,
                if i == 0 { "time per system" } else { "" },
                "{:<width$} {:>8} ms per step,{share} {} runs",
                system.name,
                short(system.per_step_ms),
                system.runs
            );
        }
        let SolverSummary { totals: t, figures: s } = &self.solver;
        let per_step = |total: u64| short(total as f64 / step.count.max(1) as f64);
        if t.newton_iterations > 0 {
            line!(
                block,
                "iterations",
                "CG {} per step (most {}), Newton {} per step (most {})",
                per_step(t.cg_iterations),
                s.cg_iterations_max,
                per_step(t.newton_iterations),
                s.newton_iterations_max
            );
        }
        if t.substeps > 0 {
            // without an end where all that moves is held
            let stable = s
                .stable_step
                .filter(|h| h.is_finite())
                .map_or(String::new(), |h| format!(", smallest stable step {}", seconds(h)));
            line!(block, "substeps", "{} per step{stable}", per_step(t.substeps));
        }
        block
    }

    fn describe_gpu(&self, block: &mut TextBlock) {
        let Some(gpu) = &self.gpu else { return };
        let device: f64 = gpu.device_s.iter().map(|(_, s)| s).sum();
        let parts: Vec<_> =
            gpu.device_s.iter().map(|(n, s)| format!("{n} {}", seconds(*s))).collect();
        let software = if gpu.software { "no measure of speed; " } else { "" };
        line!(
            block,
            "gpu",
            "{}; steps in f32; {software}device {} ({}), host {}; {:.1} MB up, {:.1} MB down",
            gpu.adapter,
            seconds(device),
            parts.join(", "),
            seconds(gpu.host_s),
            gpu.bytes_up as f64 * 1e-6,
            gpu.bytes_down as f64 * 1e-6
        );
    }

    fn accuracy(&self) -> TextBlock {
        let mut block = TextBlock::new("How accurately");
        let SolverSummary { totals: t, figures: s } = &self.solver;
        if t.newton_iterations > 0 {
            line!(
                block,
                "linear systems",
                "worst relative residual {:.1e} (tolerance {:.0e}), {} at the iteration cap; \
                     preconditioner {}, computed {} times",
                s.worst_residual,
                self.settings.solver.linear_tolerance,
                t.cg_caps,
                s.preconditioner,
                t.preconditioner_refreshes
            );
            self.describe_newton(&mut block);
        }
        self.touch.iter().for_each(|touch| touch.describe_accuracy(&mut block));
        let safeguards = [
            (t.projections, "tangents projected"),
            (t.gradient_fallbacks, "gradient fallbacks"),
            (t.backtracks, "backtracks"),
            (t.line_search_failures, "failed line searches"),
            (t.energy_caps, "energy caps"),
            (t.refinements, "refinements"),
        ];
        let used = safeguards.iter().filter(|(count, _)| *count > 0);
        let used: Vec<String> = used.map(|(count, name)| format!("{count} {name}")).collect();
        block
            .line("safeguards", if used.is_empty() { "none used".into() } else { used.join(", ") });
        block.line("energy (J)", self.energy_balance());
        block.line("volume ratio J", self.volume_words());
        if let Some(change) = self.volume.largest_mean_change {
            line!(
                block,
                "volume of clusters",
                "changes by at most {}; single elements need not keep theirs",
                short(change)
            );
        }
        block.line("state hash", &self.final_state_hash);
        block
    }

    fn describe_newton(&self, block: &mut TextBlock) {
        let SolverSummary { totals: t, figures: s } = &self.solver;
        if self.settings.solver.integrator.converges() {
            let (step, unconverged) = (s.worst_newton_step, s.unconverged_steps);
            line!(
                block,
                "Newton",
                "largest last step {step:.1e} of the body size, {unconverged} steps unconverged"
            );
            return;
        }
        let [start, indefinite, shortened, energy, inverted, waiting] = s.fallbacks;
        if t.second_order_steps > 0 {
            line!(
                block,
                "linearised BDF2",
                "{} steps; safe steps: {start} at a start, {indefinite} indefinite, \
                     {shortened} shortened, {energy} energy, {inverted} inverted, {waiting} waiting",
                t.second_order_steps
            );
        }
        line!(
            block,
            "linearisation",
            "energy decrease off its prediction by {:.1e} in the mean, {:.1e} at most",
            s.linearisation_error_mean,
            s.linearisation_error_max
        );
    }

    /// Smallest volume ratios, and how many elements were inside out.
    fn volume_words(&self) -> String {
        let v = &self.volume;
        if self.scene.tetrahedra + self.scene.hexahedra == 0 {
            return "there are no solid elements".into();
        }
        let when = match self.scene.mode {
            "static" => String::new(),
            _ => format!(" at {} s", short(v.smallest_j_time)),
        };
        let end = match v.final_smallest_j {
            j if j.is_finite() => format!("{} at the end", short(j)),
            _ => "no element is left at the end".into(),
        };
        format!(
            "smallest {}{when}, {end}; inverted elements: at most {}, {} at the end",
            short(v.smallest_j),
            v.inverted_max,
            v.inverted_final
        )
    }

    /// Where energy came from and where it went.
    fn energy_balance(&self) -> String {
        let e = &self.energy;
        let Some(dissipated) = e.dissipated else {
            return format!("{} elastic", short(e.elastic));
        };
        let contact = e.contact.unwrap_or_default();
        let unless_zero = |sign: &str, value: f64, name: &str| match value {
            0.0 => String::new(),
            value => format!(" {sign} {} {name}", short(value)),
        };
        let own = dissipated - e.damping - contact.friction;
        let share = match 100.0 * own / e.put_in() {
            share if share >= 1.0 => format!(" ({share:.0} % of what was put in)"),
            _ => String::new(),
        };
        format!(
            "{} initial + {} loads + {} constraints{}{}{}{} = {} elastic + {} kinetic{}{} + {} damped + {} \
             by the integrator{share}",
            short(e.initial),
            short(e.load_work),
            short(e.constraint_work),
            unless_zero("+", contact.work, "tools"),
            unless_zero("+", e.activation_work, "muscles"),
            unless_zero("+", e.recovery, "recovery"),
            unless_zero("-", e.removed, "removed"),
            short(e.elastic),
            short(e.kinetic),
            unless_zero("+", contact.stored, "in contacts"),
            unless_zero("+", contact.friction, "friction"),
            short(e.damping),
            short(own)
        )
    }
}

/// How an energy is evaluated, or for lumped springs how their constants are found.
fn evaluated(evaluation: Evaluation, springs: Option<SpringRule>) -> String {
    let method = match springs {
        None => return format!("{} evaluation", evaluation_name(evaluation)),
        Some(SpringRule::Uniform(uniform)) => {
            return format!("springs of {} N/m each", short(uniform.constant));
        }
        Some(SpringRule::Fitted(method)) => method,
    };
    let recalled =
        if method.recalled() { " (formula recalled, not read in the original)" } else { "" };
    format!("springs by {}{recalled}", method.name())
}

impl BodySummary {
    fn describe(&self, block: &mut TextBlock) {
        let [x, y, z] = self.extent.map(|length| short(100.0 * length));
        line!(
            block,
            format!("body {}", self.name),
            "{} vertices, {}, {x} x {y} x {z} cm, {} kg; {}",
            self.vertices,
            counted(&[("tetrahedra", self.tetrahedra), ("hexahedra", self.hexahedra)]),
            short(self.mass),
            self.source
        );
        if self.tetrahedra + self.hexahedra > 0 {
            let preset =
                self.preset.as_ref().map_or(String::new(), |name| format!(" (preset {name})"));
            let springs = self.element_method.filter(|_| self.model == Model::MassSpring);
            let clusters = match self.volume_rule {
                VolumeRule::Elements => "",
                VolumeRule::Clusters => ", volume by clusters",
            };
            let integration = match self.integration {
                _ if self.hexahedra == 0 => "",
                Integration::Full => "",
                Integration::Reduced => ", reduced integration",
            };
            line!(
                block,
                "",
                "{}{preset}; model {}, {}{clusters}{integration}",
                self.material_ranges.words(&self.material),
                self.model.name(),
                evaluated(self.evaluation, springs)
            );
        }
        if let Some(LatticeReport { cell, volume, held, .. }) = self.lattice {
            line!(
                block,
                "",
                "cubes of {} mm hold {:.1} % of the volume inside the surface",
                short(1e3 * cell),
                100.0 * held / volume
            );
        }
        if let Some(points) = self.carried {
            line!(block, "", "carries a surface of {points} points");
        }
        if let Some(tear) = &self.tear {
            line!(
                block,
                "  torn",
                "{} cm^2, {} tears that began at the surface: {} elements parted, {} vertices more, {} piece(s)",
                short(tear.area * 1e4),
                tear.begun,
                tear.separated,
                tear.vertices,
                tear.pieces.max(1)
            );
        }
        if let Some(axes) = &self.axes {
            axes.describe(block);
        }
        if let Some(membrane) = &self.membrane {
            membrane.describe(block);
        }
    }
}

impl FamilySummary {
    fn describe(&self, block: &mut TextBlock) {
        let viscous = match self.viscosity {
            0.0 => String::new(),
            viscosity => format!(", viscosity {} Pa s", short(viscosity)),
        };
        let active = self.peak_stress.map_or(String::new(), |stress| {
            let activation = short(self.activation.unwrap_or(0.0));
            let stress = pressure(stress);
            format!(", active stress up to {stress}, activation {activation} at the end")
        });
        let modulus = match self.form {
            FibreForm::Stretch => pressure(self.modulus),
            form => format!("{}, {}", pressure(self.modulus), form.name()),
        };
        line!(block, format!("  fibres {}", self.name), "{modulus}{viscous}{active}");
    }
}

impl AxesSummary {
    fn describe(&self, block: &mut TextBlock) {
        self.families.iter().for_each(|family| family.describe(block));
        let [smallest, largest, last] = self.volume_ratio.map(short);
        line!(
            block,
            "  axes",
            "{} angle(s), volume modulus {}; volume over rest from {smallest} to {largest}, \
                 {last} at the end",
            self.angles,
            pressure(self.volume_modulus)
        );
    }
}

impl MembraneSummary {
    fn describe(&self, block: &mut TextBlock) {
        let m = &self.material;
        let springs = self.element_method.filter(|_| self.model == MembraneModel::MassSpring);
        let bends =
            self.bending.map_or(String::new(), |t| format!("; bends as {} mm", short(t * 1e3)));
        line!(
            block,
            "  membrane",
            "{}, {} cm^2, {} mm; E = {}, nu = {}, {} kg/m^3; model {}, {}{bends}",
            counted(&[("triangles", self.triangles), ("quadrilaterals", self.quads)]),
            short(self.area * 1e4),
            short(self.thickness * 1e3),
            pressure(m.young_modulus),
            m.poisson_ratio,
            short(m.density),
            self.model.name(),
            evaluated(self.evaluation, springs)
        );
        self.fibres.iter().for_each(|family| family.describe(block));
    }
}

fn describe_cut(cut: &CutSummary, block: &mut TextBlock) {
    line!(
        block,
        format!("cut {}", cut.name),
        "{}, {} cm^2: {} elements parted, {} copies and {} vertices more ({} spare), {} piece(s); {}",
        cut.body,
        short(cut.area * 1e4),
        cut.separated,
        cut.copies,
        cut.vertices,
        cut.spare,
        cut.pieces,
        seconds(cut.total_s)
    );
}

fn describe_resection(r: &ResectionSummary, block: &mut TextBlock) {
    let kinds = ["tetrahedra", "hexahedra", "triangles", "quadrilaterals"];
    let count = |of: [usize; 4]| counted(&std::array::from_fn::<_, 4, _>(|k| (kinds[k], of[k])));
    let removed = count([r.removed, r.removed_hexahedra, r.removed_triangles, r.removed_quads]);
    let left =
        count([r.remaining, r.remaining_hexahedra, r.remaining_triangles, r.remaining_quads]);
    line!(
        block,
        format!("resect {}", r.name),
        "{removed} of {} ({left} left in {} piece(s), {} vertices without any), {} kg, {} J; {} in \
             all, {} longest",
        r.body,
        r.pieces,
        r.orphans,
        short(r.mass),
        short(r.energy),
        seconds(r.total_s),
        seconds(r.longest_s)
    );
}
