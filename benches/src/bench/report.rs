//! The report of a run: JSON, CSV, SVG, one HTML page, Markdown for the README, text.

use super::accuracy::{AccuracyPoint, AccuracyReport, CaseRow};
use super::aims;
use super::kernels::KernelReport;
use super::roofline::MachineLimits;
use super::step::StepsReport;
use crate::peers::{self, PeerReport};
use crate::toolbox::aim::BenchAim;
use crate::toolbox::plot::{self, Bar, Series};
use crate::toolbox::prelude::*;
use crate::toolbox::report::ReportFiles;
use sinew::engine::lanes::InstructionSet;
use sinew_tune::machine::{Load, MachineNotes};
use sinew_tune::page::{Page, Verdict};
use sinew_tune::table::{escape, three_digits};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Name and version of the JSON; the number grows when a reader would have to change.
pub const SCHEMA: &str = "sinew-bench/2";

/// Everything that one run measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchReport {
    /// [`SCHEMA`].
    pub schema: String,
    /// Command that makes such a report.
    pub command: String,
    /// Whether sizes and repeats were cut down.
    pub quick: bool,
    /// Where it ran.
    pub machine: MachineNotes,
    /// Load during each part.
    pub loads: Vec<PartLoad>,
    /// What the reader must know of the conditions.
    pub warnings: Vec<String>,
    /// Limits of the machine, per number of threads.
    pub limits: Vec<MachineLimits>,
    /// Aims and whether they were met.
    pub aims: Vec<BenchAim>,
    /// Kernels.
    pub kernels: Option<KernelReport>,
    /// Steps.
    pub step: Option<StepsReport>,
    /// Speed against error.
    pub accuracy: Option<AccuracyReport>,
    /// Other engines beside ours.
    pub peers: Option<PeerReport>,
    /// Integrators, demo scenes, resection, contact, device: what only readers of tables need.
    pub tables: Vec<Table>,
}

/// Load of the machine during one part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartLoad {
    /// Part.
    pub part: String,
    /// Load.
    pub load: Load,
}

impl BenchReport {
    /// An empty report of this machine.
    pub fn new(command: impl Into<String>, quick: bool) -> Self {
        Self {
            schema: SCHEMA.into(),
            command: command.into(),
            quick,
            machine: MachineNotes::now(),
            loads: Vec::new(),
            warnings: Vec::new(),
            limits: Vec::new(),
            aims: Vec::new(),
            kernels: None,
            step: None,
            accuracy: None,
            peers: None,
            tables: Vec::new(),
        }
    }

    /// Books the load of a part.
    pub fn add_load(&mut self, part: &str, load: Load) {
        if let Some(warning) = load.warning(self.machine.cores) {
            self.warnings.push(format!("{part}: {warning}"));
        }
        self.loads.push(PartLoad { part: part.into(), load });
    }

    /// Works out the aims of the parts that keep their rows.
    pub fn work_out_aims(&mut self) {
        let found: [(&str, Vec<BenchAim>); 4] = [
            ("kernels", self.kernels.iter().flat_map(aims::kernels).collect()),
            ("step", self.step.iter().flat_map(aims::steps).collect()),
            ("accuracy", self.accuracy.iter().flat_map(aims::accuracy).collect()),
            ("peers", self.peers.iter().flat_map(|p| peers::aims(&p.rows)).collect()),
        ];
        found.into_iter().for_each(|(part, aims)| self.add_aims(part, aims));
    }

    /// Adds the aims of a part whose load is booked.
    pub fn add_aims(&mut self, part: &str, aims: impl IntoIterator<Item = BenchAim>) {
        let cores = self.machine.cores;
        let busy = |l: &PartLoad| l.part == part && l.load.warning(cores).is_some();
        let busy = self.loads.iter().any(busy);
        let told = |aim: BenchAim| if busy { aim.on_a_busy_machine() } else { aim };
        self.aims.extend(aims.into_iter().map(told));
    }

    /// All tables, the aims first.
    pub fn tables(&self) -> Vec<Table> {
        let mut tables = Vec::new();
        if !self.aims.is_empty() {
            tables.push(aims::table(&self.aims));
        }
        if let Some(kernels) = &self.kernels {
            tables.extend(kernels.tables());
            tables.push(self.limits_table());
        }
        tables.extend(self.step.iter().flat_map(StepsReport::tables));
        tables.extend(self.accuracy.iter().flat_map(AccuracyReport::tables));
        tables.extend(self.peers.iter().flat_map(peer_tables));
        tables.extend(self.tables.iter().cloned());
        tables.push(self.load_table());
        tables
    }

    fn limits_table(&self) -> Table {
        let rates = self.limits.iter().flat_map(|l| {
            let fma = [("multiply-add f64", l.fma_f64), ("multiply-add f32", l.fma_f32)];
            let fma = fma.map(|(probe, rate)| (l, probe.to_string(), None, rate, "GFLOP/s"));
            let read = l.read.iter();
            let read = read
                .map(move |r| (l, format!("read {}", r.level), Some(r.kib), r.gb_per_s, "GB/s"));
            fma.into_iter().chain(read)
        });
        table_of!("limits", "Limits of the machine, probed in this run";
            for (l, probe, kib, rate, unit) in rates;
            "threads" => l.threads, "probe" => probe, "data KiB/thread" => kib, "rate" => rate, "unit" => unit,
        )
        .note("best of several samples; all threads at once, each with data of its own.")
    }

    fn load_table(&self) -> Table {
        let percent = |x: Option<f64>| x.map(|x| 100.0 * x);
        table_of!("load", "Load of the machine during this run"; for PartLoad { part, load } in &self.loads;
            "part" => part, "took s" => load.wall_s, "others %" => percent(load.others),
            "stolen %" => percent(load.stolen), "waiting %" => percent(load.waiting),
            "load before" => load.load_before, "load after" => load.load_after,
        )
        .note(
            "others: share of all cores that other processes took; stolen: share that the host of a \
             virtual machine kept; waiting: share of its time that the measuring thread was ready but \
             had no core (wall time above its processor time).",
        )
    }

    /// Charts that a page begins with, those side by side together, and how many of them are shown at once; the last of
    /// several is all of them in one picture.
    fn leading_charts(&self) -> Result<Vec<(Vec<Chart>, usize)>> {
        let mut groups = Vec::new();
        let elements = self.accuracy.iter().flat_map(|a| &a.elements);
        for elements in elements.filter(|e| !e.rows.is_empty()) {
            groups.push((elements.charts()?, usize::MAX));
        }
        if let Some(peers) = &self.peers {
            groups.push(peers.charts()?);
        }
        Ok(groups)
    }

    /// All charts.
    ///
    /// # Errors
    /// When one cannot be drawn.
    pub fn charts(&self) -> Result<Vec<Chart>> {
        let mut charts: Vec<Chart> =
            self.leading_charts()?.into_iter().flat_map(|(charts, _)| charts).collect();
        if let Some(accuracy) = self.accuracy.as_ref().filter(|a| !a.points.is_empty()) {
            charts.push(overview(accuracy)?);
            for case in &accuracy.cases {
                for refined in [false, true] {
                    charts.extend(case_chart(accuracy, case, refined)?);
                }
            }
        }
        for precision in ["f64", "f32"] {
            let bars = self.kernel_bars(precision);
            if !bars.is_empty() {
                let title = format!("Kernels, {precision}: time per tetrahedron");
                let unit = "ns per tetrahedron (median, line: quartiles, red: aim)";
                charts.push(plot::bars(&format!("kernels-{precision}"), &title, unit, &bars)?);
            }
        }
        let steps = self.step.iter().flat_map(|s| &s.rows);
        let bars: Vec<Bar> = steps
            .map(|r| {
                let projected = if r.projections > 0 { " (projected)" } else { "" };
                let solver = if r.solver.is_empty() { "substeps" } else { &r.solver };
                let size = (r.tetrahedra + 500) / 1000;
                let label = format!(
                    "{}{projected}, {solver}, {size}k, {} {}T",
                    r.integrator, r.precision, r.threads
                );
                let colour = if r.solver.is_empty() { 2 } else { usize::from(r.threads > 1) };
                Bar::new(label, &r.ms, None, colour)
            })
            .collect();
        if !bars.is_empty() {
            let unit = "ms of wall time (median, line: quartiles)";
            charts.push(plot::bars("steps", "Steps of 10 ms", unit, &bars)?);
        }
        Ok(charts)
    }

    /// Cases that have no chart because every method has the same error, and that error in words.
    fn level_charts(&self) -> Vec<(&str, String)> {
        let Some(accuracy) = &self.accuracy else { return Vec::new() };
        let all = accuracy.cases.iter().flat_map(|case| [(case, false), (case, true)]);
        all.filter_map(|(case, refined)| {
            let [low, high] = level(accuracy, case, refined)?.map(three_digits);
            let mesh = if refined { "a refined mesh" } else { "the same mesh" };
            Some((&*case.case, format!("every method is {low} to {high} % from the converged solution on {mesh}; no chart")))
        })
        .collect()
    }

    /// Kernels of a precision with the widest instruction set, beside their aims.
    fn kernel_bars(&self, precision: &str) -> Vec<Bar> {
        let best = InstructionSet::best().name();
        let rows = self.kernels.iter().flat_map(|k| &k.rows).filter(|r| {
            r.precision == precision && !r.kernel.starts_with("pooled:") && r.instructions == best
        });
        rows.map(|r| {
            let size = (r.tetrahedra + 500) / 1000;
            let about = if size == 49 { 50 } else { size };
            let threads = if r.threads == 1 { "1 thread" } else { "2 threads" };
            let what = format!("{} {} force, {precision}, {about}k, {threads}", r.kernel, r.model);
            let aim = self.aims.iter().find(|aim| r.quantity == "force" && aim.what == what);
            let kernel = r.kernel.replace(", all passes", "");
            let label = format!("{kernel} {}, {}, {size}k, {}T", r.quantity, r.model, r.threads);
            Bar::new(label, &r.ns_per_tet, aim.map(|a| a.limit), usize::from(r.threads > 1))
        })
        .collect()
    }

    /// The key figures for the README, in Markdown: forces with the widest instruction set, steps with
    /// the default solver, other engines, and for every case the cheapest method below 1 % error.
    pub fn readme(&self) -> String {
        let mut text = format!("Measured by `{}` on {}.\n", self.command, self.machine.line());
        if !self.warnings.is_empty() {
            let parts: Vec<&str> =
                self.warnings.iter().filter_map(|w| w.split(':').next()).collect();
            let _ = writeln!(text, "\nThe machine was busy during: {}.", parts.join(", "));
        }
        let headline = self.headline().map(|headline| format!("\n{headline}\n"));
        text.push_str(&headline.unwrap_or_default());
        let threads = |n: usize| if n == 1 { "1 thread".into() } else { format!("{n} threads") };
        let best = InstructionSet::best().name();
        let mut rows: Vec<(String, String, Option<f64>, &str, Option<String>)> = Vec::new();
        for row in self.kernels.iter().flat_map(|k| &k.rows) {
            let whole = !row.kernel.starts_with("pooled: ") && row.model == "svk_comp";
            let portable = row.instructions == InstructionSet::Portable.name();
            if whole && row.quantity == "force" && (row.instructions == best || portable) {
                let threads = threads(row.threads) + if portable { ", portable" } else { "" };
                rows.push((
                    format!("{} force", row.kernel.replace(", all passes", "")),
                    format!("{} tets, {}, {threads}", row.tetrahedra, row.precision),
                    Some(row.ns_per_tet.median),
                    "ns/tet",
                    row.error.map(|e| format!("{e:.0e} of the force")),
                ));
            }
        }
        let most = self.step.iter().flat_map(|s| &s.rows).map(|r| r.threads).max();
        for row in self.step.iter().flat_map(|s| &s.rows) {
            let default = row.solver.starts_with("auto") || row.integrator == "stormer-verlet";
            if default && Some(row.threads) == most {
                let solver = if row.solver.is_empty() { "substeps" } else { &row.solver };
                let (tets, threads) = (row.tetrahedra, threads(row.threads));
                rows.push((
                    format!("{} step of 10 ms, {}", row.integrator, row.state),
                    format!("{tets} tets, {solver}, {}, {threads}", row.precision),
                    Some(row.ms.median),
                    "ms",
                    row.error_percent.map(|e| format!("{e:.1e} % of the converged step")),
                ));
            }
        }
        for r in self.peers.iter().flat_map(|p| &p.rows) {
            let threads = threads(r.threads);
            rows.push((
                format!("{} {}, step", r.engine, r.version),
                format!("{}, {}, {}, {threads}", r.scene, r.setting, r.precision),
                r.ms_per_step,
                "ms",
                r.swing_percent.map(|e| format!("{e:.1e} %, of the motion")),
            ));
        }
        for case in self.accuracy.iter().flat_map(|a| &a.cases) {
            let points = self.accuracy.iter().flat_map(|a| &a.points);
            let mut good: Vec<&AccuracyPoint> = points
                .filter(|p| p.case == case.case && p.error_percent.is_some_and(|e| e < 1.0))
                .collect();
            let cost = |p: &AccuracyPoint| p.cost.map_or(f64::INFINITY, |c| c.median);
            good.sort_by(|a, b| a.tetrahedra.cmp(&b.tetrahedra).then(cost(a).total_cmp(&cost(b))));
            good.dedup_by_key(|p| p.tetrahedra);
            for p in good {
                let method = format!("{}, {}, {}", p.method(), p.model, p.evaluation);
                let threads = threads(p.threads);
                rows.push((
                    p.case.clone(),
                    format!("{} tets, {method}, {}, {threads}", p.tetrahedra, p.precision),
                    p.cost.map(|c| 1e3 * c.median),
                    if case.motion { "ms per simulated s" } else { "ms to the answer" },
                    p.error_percent.map(|e| format!("{e:.1e} % on the same mesh")),
                ));
            }
        }
        let key = table_of!("key", "Key figures"; for (what, conditions, median, unit, error) in rows;
            "what" => what, "conditions" => conditions, "median" => median, "unit" => unit, "error" => error,
        );
        text.push('\n');
        text + &key.markdown()
    }

    /// What a user asks first, where steps were measured.
    fn headline(&self) -> Option<String> {
        self.step.as_ref().and_then(StepsReport::headline)
    }

    /// Aims of the project and against other engines.
    fn verdicts(&self) -> Vec<Verdict> {
        let verdict = |a: &BenchAim| Verdict {
            judgement: a.judgement(),
            measured: format!("{} {}", three_digits(a.found), a.unit).trim_end().to_owned(),
            what: match a.what.contains("at least") {
                true => a.what.clone(),
                false => format!("{}; aim: at most {}", a.what, three_digits(a.limit)),
            },
        };
        self.aims.iter().map(verdict).collect()
    }

    /// One page with everything in it.
    ///
    /// # Errors
    /// When a chart cannot be drawn.
    pub fn html(&self) -> Result<String> {
        let heading = "Sinew bench: speed against error";
        let mut page = Page::new("Sinew bench", heading, &self.machine.line());
        let busy = format!("{} parts were measured on a busy machine", self.warnings.len());
        page.warnings(&busy, &self.warnings);
        self.headline().iter().for_each(|headline| page.paragraph("", headline));
        let mut drawn = Vec::new();
        for (group, leading) in self.leading_charts()? {
            // what is in the picture of all stands there by itself
            let single = &group[..if group.len() > 1 { group.len() - 1 } else { group.len() }];
            let (shown, folded) = single.split_at(leading.min(single.len()));
            page.charts(shown);
            if !folded.is_empty() {
                page.add(format_args!("<details><summary>{} more charts</summary>", folded.len()));
                page.charts(folded);
                page.add("</details>");
            }
            drawn.extend(group.into_iter().map(|chart| chart.name));
        }
        page.verdicts(&self.verdicts());
        page.add(format_args!(
            "<p class=\"note\">Made by <code>{}</code>{}. Every figure is a median of repeats in which the variants \
             took turns; quartiles and minima stand beside it. The same data are in \
             <code>report.json</code> and in one CSV file per table.</p>",
            escape(&self.command),
            if self.quick { " (cut-down sizes and repeats)" } else { "" }
        ));
        let mut tables = self.tables();
        tables.retain(|t| t.name != "aims");
        let start = |table: &Table| -> String {
            table.title.split(':').next().unwrap_or(&table.title).into()
        };
        for table in &tables {
            let alike = tables.iter().filter(|other| start(other) == start(table)).count();
            let title = if alike > 1 { table.title.clone() } else { start(table) };
            page.entry(table.name, &title);
        }
        let rest = self.charts()?;
        for chart in rest.iter().filter(|c| !drawn.contains(&c.name)) {
            if height(chart) <= LONG_CHART {
                page.chart(chart);
                continue;
            }
            page.add(format_args!("<details><summary>{}, a long chart</summary>", chart.name));
            page.chart(chart);
            page.add("</details>");
        }
        for (chart, why) in self.level_charts() {
            page.paragraph("note", &format!("{chart}: {why}"));
        }
        for table in &tables {
            match table.name {
                "peers" => {
                    page.grouped(table, Some("scene"), &["setting", "note"], str::to_owned);
                }
                "peers-touch" | "peers-bodies" | "peers-cut" => {
                    page.grouped(table, None, &["setting", "note"], str::to_owned)
                }
                "elements" | "elements-equal" => {
                    page.grouped(table, Some("nu"), &["note"], |nu| {
                        format!("Poisson's ratio {nu}")
                    });
                }
                _ => page.table(table),
            }
        }
        page.add(format_args!(
            "<h2>How to reproduce</h2>\n<p><code>cargo run --release -p sinew-benches -- {}</code> from a checkout, \
             with nothing else running. For the other engines see <code>sinew-lab bench --help</code>.</p>",
            escape(self.command.trim_start_matches("sinew-lab "))
        ));
        Ok(page.html())
    }

    /// For the terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n\n", self.machine.line());
        self.headline().iter().for_each(|headline| text.push_str(&format!("{headline}\n\n")));
        // the points fill screens; the front is what counts
        for table in self.tables().iter().filter(|t| t.name != "points") {
            let _ = writeln!(text, "{}", table.text());
        }
        for warning in &self.warnings {
            let _ = writeln!(text, "WARNING: {warning}");
        }
        text
    }

    /// Writes everything into a folder, which is made; returns the files.
    ///
    /// # Errors
    /// When a file cannot be written or a chart not be drawn.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        let mut files = ReportFiles::default();
        files.json("report.json", self)?;
        files.add("report.html", self.html()?);
        files.add("readme.md", self.readme());
        files.parts(&self.charts()?, &self.tables())?;
        files.write(folder)
    }
}

/// Height (pixels) above which a chart is folded.
const LONG_CHART: u32 = 1300;

/// Height (pixels) that a chart says it has.
fn height(chart: &Chart) -> u32 {
    let text = chart.svg.split("height=\"").nth(1).and_then(|rest| rest.split('"').next());
    text.and_then(|height| height.parse().ok()).unwrap_or(0)
}

fn peer_tables(report: &PeerReport) -> Vec<Table> {
    let title = "Other engines beside Sinew: same mesh, material and load";
    let mut rows = table_of!("peers", title; for r in &report.rows;
        "engine" => format!("{} {}", r.engine, r.version), "ms/step" => r.ms_per_step,
        "s per s" => r.cost_per_simulated_second, "static error %" => r.error_percent,
        "step error %" => r.step_percent, "motion error %" => r.swing_percent,
        "force ns/tet" => r.force_ns_per_element, "precision" => &r.precision, "threads" => r.threads,
        "tets" => r.elements, "scene" => &r.scene, "setting" => &r.setting, "note" => &r.note,
    )
    .note(
        "ms/step: median of undamped steps of the beam let go from half its equilibrium, engines in \
         turns. static error: root mean square of the displacement error of the settled beam over that \
         of the equilibrium of the same mesh by converged Newton. step error, motion error: 0.3 s from the shape \
         at rest, largest distance of a vertex over the largest displacement, against converged steps of implicit \
         Euler as long as these and against a fine motion (TR-BDF2, 5 ms), with the row's own energy.",
    );
    for reason in &report.skipped {
        rows = rows.note(format!("Not run: {reason}"));
    }
    let title = "Contact beside other engines: a ball pressed into a block, held and dragged";
    let touch = table_of!("peers-touch", title; for r in &report.touch;
        "engine" => format!("{} {}", r.engine, r.version), "ms/step" => r.ms_per_step,
        "s per s" => r.cost_per_simulated_second, "error %" => r.error_percent,
        "off faces %" => r.off_second_percent, "force N" => r.force, "depth mm" => r.depth_mm,
        "with friction ms" => r.ms_with_friction, "ripple %" => r.ripple_percent,
        "friction over its limit" => r.friction_ratio, "precision" => &r.precision, "threads" => r.threads,
        "tets" => r.elements, "setting" => &r.setting, "note" => &r.note,
    )
    .note(
        "force: on the ball at the end of the hold; error: against the first row, exact contact of the \
         vertices of the same mesh; off faces: against points on its faces. depth: deepest vertex of the surface in the ball, measured by the same \
         code for all. ms/step: median once the ball is pressed in, engines in turns. ripple: largest less \
         smallest force over the mean while dragged without friction. friction: vector sums; above 1 on a ball, whose \
         normals spread more than the friction does.",
    );
    let title =
        "Contact beside other engines: a soft block pressed on a soft block, held and dragged";
    let bodies = table_of!("peers-bodies", title; for r in &report.bodies;
        "engine" => format!("{} {}", r.engine, r.version), "ms/step" => r.ms_per_step,
        "with friction ms" => r.ms_with_friction, "apart ms" => r.ms_apart,
        "over apart" => r.over_apart, "friction over apart" => r.friction_over_apart,
        "s per s" => r.cost_per_simulated_second, "error %" => r.error_percent,
        "off finer mesh %" => r.off_second_percent, "force N" => r.force, "depth mm" => r.depth_mm,
        "ripple %" => r.ripple_percent, "T/(mu N)" => r.friction_ratio, "precision" => &r.precision,
        "threads" => r.threads, "tets" => r.elements, "setting" => &r.setting, "note" => &r.note,
    )
    .note(
        "force: on the upper block at the end of the hold; error: against the equilibrium of the same mesh (first row); off \
         finer mesh: against that of two blocks of half the edge. depth: largest height of a vertex beyond the \
         other face, measured by the same code for all. ms/step: median of the drag without friction, engines in turns. \
         apart: the same blocks without contact, swinging undamped. ripple: largest less smallest force, off a parabola \
         over time, over the mean while dragged without friction. T/(mu N): sideways over coefficient times vertical force \
         while dragged with friction; where faces tilt, contact alone pushes sideways.",
    );
    let title =
        "Cuts beside other engines: an oblique plane that ends inside a beam, opened by a load";
    let cut = table_of!("peers-cut", title; for r in &report.cut;
        "engine" => format!("{} {}", r.engine, r.version), "ms/step" => r.ms_per_step, "cut ms" => r.cut_ms,
        "off blade rms" => r.distance_rms, "largest" => r.distance_largest,
        "opening error %" => r.opening_percent, "energy change" => r.energy_change,
        "precision" => &r.precision, "threads" => r.threads, "tets" => r.elements,
        "setting" => &r.setting, "note" => &r.note,
    )
    .note(
        "off blade: distance of the wound from the plane of the blade, in edges. opening: volume of the gap 2 s after the          cut, against a converged continuum; a mesh of these elements that fits the cut misses 44 % with 8 cells across.          energy change: of a beam that is loaded first, at its cut. ms/step: median after the cut.",
    );
    vec![rows, touch, bodies, cut]
}

/// Cost (s) and error (%) of a point; `refined`: against the refined mesh.
fn pair(p: &AccuracyPoint, refined: bool) -> [f64; 2] {
    let error = if refined { p.refined_error_percent } else { p.error_percent };
    [p.cost.map_or(f64::NAN, |c| c.median), error.unwrap_or(f64::NAN)]
}

fn usable(pair: &[f64; 2]) -> bool {
    pair.iter().all(|x| x.is_finite())
}

/// Points that nothing beats, cheapest first.
fn front<'a>(points: impl Iterator<Item = &'a AccuracyPoint>, refined: bool) -> Vec<[f64; 2]> {
    let mut front: Vec<[f64; 2]> = points
        .filter(|p| if refined { p.pareto_refined } else { p.pareto })
        .map(|p| pair(p, refined))
        .collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    front
}

/// Every method on every case.
fn overview(report: &AccuracyReport) -> Result<Chart> {
    let series = |(i, case): (usize, &CaseRow)| {
        let name = &case.case;
        let points = report.points.iter().filter(|p| p.case == *name).map(|p| pair(p, false));
        let per = if case.motion { " (per simulated s)" } else { "" };
        let points = points.filter(usable).collect();
        Series::new(format!("{name}{per}"), points, i).hollow(case.motion)
    };
    let series: Vec<Series> = report.cases.iter().enumerate().map(series).collect();
    let mut meshes: Vec<(&str, usize)> = report.points.iter().map(AccuracyPoint::mesh).collect();
    meshes.dedup();
    let front = |mesh| front(report.points.iter().filter(|p| p.mesh() == mesh), false);
    let fronts: Vec<_> = meshes.into_iter().map(front).collect();
    let axes = [
        "wall time (s): to the answer, or per simulated second",
        "error against the converged solution on the same mesh (%)",
    ];
    let title = "Speed against error: every method on every scene";
    plot::speed_against_error("speed-against-error", title, axes, &series, &fronts)
}

/// Ratio of errors below which a chart of them would be one row of dots.
const LEVEL: f64 = 1.5;

/// Least and largest error (%) of a case, as far as charts tell errors apart, where these are level.
fn level(report: &AccuracyReport, case: &CaseRow, refined: bool) -> Option<[f64; 2]> {
    let own = report.points.iter().filter(|p| p.case == case.case);
    let errors = own.map(|p| pair(p, refined)).filter(usable).map(|p| p[1].max(plot::FLOOR));
    let start = [f64::INFINITY, 0.0];
    let [low, high] = errors.fold(start, |[low, high]: [f64; 2], e| [low.min(e), high.max(e)]);
    (low <= high && high < LEVEL * low).then_some([low, high])
}

/// Every method on one case, against the same or the refined mesh; none without points.
fn case_chart(report: &AccuracyReport, case: &CaseRow, refined: bool) -> Result<Option<Chart>> {
    let own = report.points.iter().filter(|p| p.case == case.case);
    let points: Vec<&AccuracyPoint> = own.filter(|p| usable(&pair(p, refined))).collect();
    if level(report, case, refined).is_some() {
        return Ok(None);
    }
    let mut sizes: Vec<usize> = points.iter().map(|p| p.tetrahedra).collect();
    sizes.dedup();
    let Some(&first) = sizes.first() else { return Ok(None) };
    let mut series: Vec<Series> = Vec::new();
    for p in &points {
        let size = match sizes.len() {
            1 => String::new(),
            _ => format!(", {} tets", p.tetrahedra),
        };
        let name = format!("{} {}{size}", p.integrator, p.precision);
        let at = series.iter().position(|s| s.name == name).unwrap_or_else(|| {
            let kinds = ["safe", "newton", "quasi-static", "symplectic-euler", "stormer-verlet"];
            let kind = kinds.iter().position(|k| *k == p.integrator).unwrap_or(5);
            // meshes of one case in different colours
            let colour = kind + if p.tetrahedra == first { 0 } else { 5 };
            series.push(Series::new(name, Vec::new(), colour).hollow(p.precision == "f32"));
            series.len() - 1
        });
        series[at].points.push(pair(p, refined));
    }
    let of = |size: Option<usize>| {
        let own = points.iter().copied().filter(|p| size.is_none_or(|s| p.tetrahedra == s));
        front(own, refined)
    };
    let fronts: Vec<_> = match refined {
        true => vec![of(None)],
        false => sizes.iter().map(|s| of(Some(*s))).collect(),
    };
    let (suffix, against) = match refined {
        true => {
            let tets = case.refined_tetrahedra.unwrap_or(0);
            ("-refined", format!("refined mesh of {tets} tets"))
        }
        false => ("", "same mesh".to_string()),
    };
    let cost = match case.motion {
        true => "wall time per simulated second (s)",
        false => "wall time to the answer (s)",
    };
    let name = format!("{}{suffix}", case.case.replace(' ', "-"));
    let title = format!("{}: against the converged solution, {against}", case.case);
    plot::speed_against_error(&name, &title, [cost, "error (%)"], &series, &fronts).map(Some)
}
