//! The report of a run: JSON, CSV, SVG, one HTML page, Markdown for the README, text.

use super::accuracy::{AccuracyReport, Point};
use super::aims::{self, Aim};
use super::error::BenchError;
use super::integrators::IntegratorReport;
use super::kernels::KernelReport;
use super::machine::{Load, MachineNotes};
use super::plot::{self, Bar, Series};
use super::roofline::Limits;
use super::scenes::{self, SceneRow};
use super::step::StepReport;
use super::table::{Table, escape};
use crate::peers::PeerReport;
use serde::{Deserialize, Serialize};
use sinew::engine::lanes::InstructionSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Name and version of the JSON; the number grows when a reader would have to change.
pub const SCHEMA: &str = "sinew-bench/1";

/// Everything that one run measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
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
    pub limits: Vec<Limits>,
    /// Aims and whether they were met.
    pub aims: Vec<Aim>,
    /// Kernels.
    pub kernels: Option<KernelReport>,
    /// Steps.
    pub step: Option<StepReport>,
    /// Speed against error.
    pub accuracy: Option<AccuracyReport>,
    /// Integrators beside each other.
    pub integrators: Option<IntegratorReport>,
    /// Demo scenes.
    pub scenes: Option<Vec<SceneRow>>,
    /// Other engines beside ours.
    pub peers: Option<PeerReport>,
}

/// Load of the machine during one part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartLoad {
    /// Part.
    pub part: String,
    /// Load.
    pub load: Load,
}

/// A chart and what it is called.
pub struct Chart {
    /// Name of the file.
    pub name: String,
    /// SVG text.
    pub svg: String,
}

impl Report {
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
            integrators: None,
            scenes: None,
            peers: None,
        }
    }

    /// Books the load of a part.
    pub fn add_load(&mut self, part: &str, load: Load) {
        if let Some(warning) = load.warning(self.machine.cores) {
            self.warnings.push(format!("{part}: {warning}"));
        }
        self.loads.push(PartLoad { part: part.into(), load });
    }

    /// Works out the aims from what was measured.
    pub fn work_out_aims(&mut self) {
        self.aims.clear();
        self.aims.extend(self.kernels.iter().flat_map(aims::kernels));
        self.aims.extend(self.step.iter().flat_map(aims::steps));
        self.aims.extend(self.accuracy.iter().flat_map(aims::accuracy));
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
        tables.extend(self.step.iter().flat_map(StepReport::tables));
        tables.extend(self.accuracy.iter().flat_map(AccuracyReport::tables));
        tables.extend(self.integrators.iter().flat_map(IntegratorReport::tables));
        tables.extend(self.scenes.as_deref().map(scenes::table));
        tables.extend(self.peers.iter().flat_map(peer_tables));
        tables.push(self.load_table());
        tables
    }

    fn limits_table(&self) -> Table {
        let mut table = Table::new(
            "limits",
            "Limits of the machine, probed in this run",
            &["threads", "probe", "data KiB/thread", "rate", "unit"],
        )
        .note("best of several samples; all threads at once, each with data of its own.");
        for l in &self.limits {
            let fma = [("multiply-add f64", l.fma_f64), ("multiply-add f32", l.fma_f32)];
            for (probe, rate) in fma {
                let cells = vec![l.threads.into(), probe.into(), None::<f64>.into(), rate.into()];
                table.row([cells, vec!["GFLOP/s".into()]].concat());
            }
            for r in &l.read {
                table.row(vec![
                    l.threads.into(),
                    format!("read {}", r.level).into(),
                    r.kib.into(),
                    r.gb_per_s.into(),
                    "GB/s".into(),
                ]);
            }
        }
        table
    }

    fn load_table(&self) -> Table {
        let percent = |x: Option<f64>| x.map(|x| 100.0 * x);
        let mut table = Table::new(
            "load",
            "Load of the machine during this run",
            &["part", "took s", "others %", "stolen %", "waiting %", "load before", "load after"],
        )
        .note(
            "others: share of all cores that other processes took; stolen: share that the host of a \
             virtual machine kept; waiting: share of its time that the measuring thread was ready but \
             had no core (wall time above its processor time).",
        );
        for PartLoad { part, load } in &self.loads {
            table.row(vec![
                part.into(),
                load.wall_s.into(),
                percent(load.others).into(),
                percent(load.stolen).into(),
                percent(load.waiting).into(),
                load.load_before.into(),
                load.load_after.into(),
            ]);
        }
        table
    }

    /// All charts.
    ///
    /// # Errors
    /// When one cannot be drawn.
    pub fn charts(&self) -> Result<Vec<Chart>, BenchError> {
        let mut charts = Vec::new();
        if let Some(accuracy) = self.accuracy.as_ref().filter(|a| !a.points.is_empty()) {
            charts.extend(accuracy_charts(accuracy)?);
        }
        if let Some(kernels) = &self.kernels {
            for precision in ["f64", "f32"] {
                let bars: Vec<Bar> = kernels
                    .rows
                    .iter()
                    .filter(|r| r.precision == precision && !r.kernel.starts_with("pooled:"))
                    .filter(|r| r.instructions == InstructionSet::best().name())
                    .map(|r| {
                        let what = format!("{} {} force", r.kernel, r.model);
                        let size = (r.tetrahedra + 500) / 1000;
                        let aim = self.aims.iter().find(|aim| {
                            let threads = if r.threads == 1 { "1 thread" } else { "2 threads" };
                            r.quantity == "force"
                                && aim.what
                                    == format!(
                                        "{what}, {precision}, {}k, {threads}",
                                        if size == 49 { 50 } else { size }
                                    )
                        });
                        Bar {
                            label: format!(
                                "{} {}, {}, {}k, {}T",
                                r.kernel.replace(", all passes", ""),
                                r.quantity,
                                r.model,
                                size,
                                r.threads
                            ),
                            value: r.ns_per_tet.median,
                            quartiles: [r.ns_per_tet.lower_quartile, r.ns_per_tet.upper_quartile],
                            aim: aim.map(|a| a.limit),
                            colour: usize::from(r.threads > 1),
                        }
                    })
                    .collect();
                if !bars.is_empty() {
                    let title = format!("Kernels, {precision}: time per tetrahedron");
                    let unit = "ns per tetrahedron (median, line: quartiles, red: aim)";
                    let svg = plot::bars(&title, unit, &bars)?;
                    charts.push(Chart { name: format!("kernels-{precision}"), svg });
                }
            }
        }
        if let Some(step) = self.step.as_ref().filter(|s| !s.rows.is_empty()) {
            let bars: Vec<Bar> = step
                .rows
                .iter()
                .map(|r| Bar {
                    label: format!(
                        "{}{}, {}, {}k, {} {}T",
                        r.integrator,
                        if r.projections > 0 { " (projected)" } else { "" },
                        if r.solver.is_empty() { "substeps" } else { &r.solver },
                        (r.tetrahedra + 500) / 1000,
                        r.precision,
                        r.threads
                    ),
                    value: r.ms.median,
                    quartiles: [r.ms.lower_quartile, r.ms.upper_quartile],
                    aim: None,
                    colour: if r.solver.is_empty() { 2 } else { usize::from(r.threads > 1) },
                })
                .collect();
            let unit = "ms of wall time (median, line: quartiles)";
            let svg = plot::bars("Steps of 10 ms", unit, &bars)?;
            charts.push(Chart { name: "steps".into(), svg });
        }
        Ok(charts)
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
        let threads = |n: usize| if n == 1 { "1 thread".into() } else { format!("{n} threads") };
        let columns = ["what", "conditions", "median", "unit", "error"];
        let mut key = Table::new("key", "Key figures", &columns);
        let best = InstructionSet::best().name();
        for row in self.kernels.iter().flat_map(|k| &k.rows) {
            let whole = !row.kernel.starts_with("pooled: ") && row.model == "svk_comp";
            let portable = row.instructions == InstructionSet::Portable.name();
            if whole && row.quantity == "force" && (row.instructions == best || portable) {
                let threads = threads(row.threads) + if portable { ", portable" } else { "" };
                let tets = row.tetrahedra;
                key.row(vec![
                    format!("{} force", row.kernel.replace(", all passes", "")).into(),
                    format!("{tets} tets, {}, {threads}", row.precision).into(),
                    row.ns_per_tet.median.into(),
                    "ns/tet".into(),
                    row.error.map(|e| format!("{e:.0e} of the force")).into(),
                ]);
            }
        }
        let most = self.step.iter().flat_map(|s| &s.rows).map(|r| r.threads).max();
        for row in self.step.iter().flat_map(|s| &s.rows) {
            let default = row.solver.starts_with("auto") || row.integrator == "stormer-verlet";
            if default && Some(row.threads) == most {
                let solver = if row.solver.is_empty() { "substeps" } else { &row.solver };
                let (tets, threads) = (row.tetrahedra, threads(row.threads));
                key.row(vec![
                    format!("{} step of 10 ms, {}", row.integrator, row.state).into(),
                    format!("{tets} tets, {solver}, {}, {threads}", row.precision).into(),
                    row.ms.median.into(),
                    "ms".into(),
                    row.error_percent.map(|e| format!("{e:.1e} % of the converged step")).into(),
                ]);
            }
        }
        for r in self.peers.iter().flat_map(|p| &p.rows) {
            let threads = threads(r.threads);
            key.row(vec![
                format!("{} {}, step", r.engine, r.version).into(),
                format!("{}, {}, {}, {threads}", r.scene, r.setting, r.precision).into(),
                r.ms_per_step.into(),
                "ms".into(),
                r.error_percent.map(|e| format!("{e:.1e} %, static")).into(),
            ]);
        }
        for case in self.accuracy.iter().flat_map(|a| &a.cases) {
            let points = self.accuracy.iter().flat_map(|a| &a.points);
            let mut good: Vec<&Point> = points
                .filter(|p| p.case == case.case && p.error_percent.is_some_and(|e| e < 1.0))
                .collect();
            let cost = |p: &Point| p.cost.map_or(f64::INFINITY, |c| c.median);
            good.sort_by(|a, b| a.tetrahedra.cmp(&b.tetrahedra).then(cost(a).total_cmp(&cost(b))));
            good.dedup_by_key(|p| p.tetrahedra);
            for p in good {
                let method = format!("{}, {}, {}", p.method(), p.model, p.evaluation);
                let threads = threads(p.threads);
                key.row(vec![
                    (&p.case).into(),
                    format!("{} tets, {method}, {}, {threads}", p.tetrahedra, p.precision).into(),
                    p.cost.map(|c| 1e3 * c.median).into(),
                    if case.motion { "ms per simulated s" } else { "ms to the answer" }.into(),
                    p.error_percent.map(|e| format!("{e:.1e} % on the same mesh")).into(),
                ]);
            }
        }
        text.push('\n');
        text + &key.markdown()
    }

    /// One page with everything in it.
    ///
    /// # Errors
    /// When a chart cannot be drawn.
    pub fn html(&self) -> Result<String, BenchError> {
        let mut body = String::from("<h1>Sinew bench: speed against error</h1>\n");
        let _ = writeln!(body, "<p class=\"machine\">{}</p>", escape(&self.machine.line()));
        for warning in &self.warnings {
            let _ = writeln!(body, "<p class=\"warning\">{}</p>", escape(warning));
        }
        let _ = writeln!(
            body,
            "<p>Made by <code>{}</code>{}. Every figure is a median of repeats in which the variants \
             took turns; quartiles and minima stand beside it. The same data are in \
             <code>report.json</code> and in one CSV file per table.</p>",
            escape(&self.command),
            if self.quick { " (cut-down sizes and repeats)" } else { "" }
        );
        let met = self.aims.iter().filter(|a| a.met).count();
        let tables = self.tables();
        body += "<nav>";
        for table in &tables {
            let _ =
                write!(body, "<a href=\"#{}\">{}</a> ", table.name, escape(short(&table.title)));
        }
        body += "</nav>\n";
        for chart in self.charts()? {
            let _ = writeln!(
                body,
                "<figure id=\"chart-{}\">{}</figure>",
                chart.name,
                scalable(&chart.svg)
            );
        }
        if !self.aims.is_empty() {
            let _ = writeln!(body, "<p>{met} of {} aims met.</p>", self.aims.len());
        }
        for table in &tables {
            if table.rows.len() > LONG {
                let _ = write!(
                    body,
                    "<details><summary>{} ({} rows)</summary>\n{}</details>\n",
                    escape(&table.title),
                    table.rows.len(),
                    table.html()
                );
            } else {
                body += &table.html();
            }
        }
        let _ = write!(
            body,
            "<h2>How to reproduce</h2>\n<p><code>cargo run --release -- {}</code> from a checkout, \
             with nothing else running. For the other engines see <code>sinew-lab bench --help</code>.</p>\n",
            escape(self.command.trim_start_matches("sinew "))
        );
        Ok(page("Sinew bench", &body))
    }

    /// For the terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n\n", self.machine.line());
        for table in self.tables() {
            // the points fill screens; the front is what counts
            if table.name != "points" {
                text += &table.text();
                text.push('\n');
            }
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
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, BenchError> {
        let error = |path: &Path, reason: String| BenchError::Write { path: path.into(), reason };
        std::fs::create_dir_all(folder).map_err(|e| error(folder, e.to_string()))?;
        let json = serde_json::to_string_pretty(self)
            .map_err(|e| error(&folder.join("report.json"), e.to_string()))?;
        let mut files = vec![
            ("report.json".to_string(), (json + "\n").into_bytes()),
            ("report.html".to_string(), self.html()?.into_bytes()),
            ("readme.md".to_string(), self.readme().into_bytes()),
        ];
        for chart in self.charts()? {
            files.push((format!("{}.svg", chart.name), chart.svg.into_bytes()));
        }
        for table in self.tables() {
            let name = format!("{}.csv", table.name);
            let csv = table.csv().map_err(|e| error(&folder.join(&name), e.to_string()))?;
            files.push((name, csv));
        }
        let mut written = Vec::new();
        for (name, bytes) in files {
            let path = folder.join(name);
            std::fs::write(&path, bytes).map_err(|e| error(&path, e.to_string()))?;
            written.push(path);
        }
        Ok(written)
    }
}

fn peer_tables(report: &PeerReport) -> Vec<Table> {
    let mut rows = Table::new(
        "peers",
        "Other engines beside Sinew: same mesh, material and load",
        &[
            "engine", "version", "scene", "tets", "setting", "threads", "precision", "ms/step",
            "s per s", "force ns/tet", "static error %", "note",
        ],
    )
    .note(
        "ms/step: median of undamped steps of the beam let go from half its equilibrium, engines in \
         turns. static error: root mean square of the displacement error of the settled beam over that \
         of the equilibrium of the same mesh by converged Newton.",
    );
    for reason in &report.skipped {
        rows = rows.note(format!("Not run: {reason}"));
    }
    for r in &report.rows {
        rows.row(vec![
            (&r.engine).into(),
            (&r.version).into(),
            (&r.scene).into(),
            r.elements.into(),
            (&r.setting).into(),
            r.threads.into(),
            (&r.precision).into(),
            r.ms_per_step.into(),
            r.cost_per_simulated_second.into(),
            r.force_ns_per_element.into(),
            r.error_percent.into(),
            (&r.note).into(),
        ]);
    }
    let mut aims = Table::new("peer-aims", "Aims against other engines", &["aim", "measured", ""]);
    for aim in &report.aims {
        let met = if aim.met { "met" } else { "missed" };
        aims.row(vec![(&aim.aim).into(), (&aim.measured).into(), met.into()]);
    }
    vec![aims, rows]
}

/// A self-contained page in the style of all reports.
pub fn page(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{body}</main>\n</body>\n</html>\n",
        escape(title)
    )
}

/// Rows above which a table is folded in the page.
const LONG: usize = 60;

fn short(title: &str) -> &str {
    title.split(':').next().unwrap_or(title)
}

/// Width and height become a view box, so that the page decides.
pub(crate) fn scalable(svg: &str) -> String {
    match svg.find("<svg") {
        Some(at) => svg[at..].to_string(),
        None => svg.to_string(),
    }
}

fn accuracy_charts(report: &AccuracyReport) -> Result<Vec<Chart>, BenchError> {
    let mut charts = Vec::new();
    let pair = |p: &Point, refined: bool| {
        let error = if refined { p.refined_error_percent } else { p.error_percent };
        [p.cost.map_or(f64::NAN, |c| c.median), error.unwrap_or(f64::NAN)]
    };
    let usable = |pair: &[f64; 2]| pair.iter().all(|x| x.is_finite());
    let overview: Vec<Series> = report
        .cases
        .iter()
        .enumerate()
        .map(|(i, case)| Series {
            name: if case.motion {
                format!("{} (per simulated s)", case.case)
            } else {
                case.case.clone()
            },
            points: report
                .points
                .iter()
                .filter(|p| p.case == case.case)
                .map(|p| pair(p, false))
                .filter(usable)
                .collect(),
            hollow: case.motion,
            colour: i,
        })
        .collect();
    let mut meshes: Vec<(&str, usize)> =
        report.points.iter().map(|p| (p.case.as_str(), p.tetrahedra)).collect();
    meshes.dedup();
    let overview_fronts: Vec<Vec<[f64; 2]>> = meshes
        .into_iter()
        .map(|mesh| {
            let on_front =
                report.points.iter().filter(|p| p.pareto && (&*p.case, p.tetrahedra) == mesh);
            let mut front: Vec<[f64; 2]> = on_front.map(|p| pair(p, false)).collect();
            front.sort_by(|a, b| a[0].total_cmp(&b[0]));
            front
        })
        .collect();
    charts.push(Chart {
        name: "speed-against-error".into(),
        svg: plot::speed_against_error(
            "Speed against error: every method on every scene",
            "wall time (s): to the answer, or per simulated second",
            "error against the converged solution on the same mesh (%)",
            &overview,
            &overview_fronts,
        )?,
    });
    for case in &report.cases {
        for refined in [false, true] {
            let points: Vec<&Point> = report
                .points
                .iter()
                .filter(|p| p.case == case.case && usable(&pair(p, refined)))
                .collect();
            if points.is_empty() {
                continue;
            }
            let mut series: Vec<Series> = Vec::new();
            let mut sizes: Vec<usize> = points.iter().map(|p| p.tetrahedra).collect();
            sizes.dedup();
            for p in &points {
                let words = if sizes.len() > 1 {
                    format!(", {} tets", p.tetrahedra)
                } else {
                    String::new()
                };
                let name = format!("{} {}{words}", p.integrator, p.precision);
                let kinds =
                    ["safe", "newton", "quasi-static", "symplectic-euler", "stormer-verlet"];
                let kind = kinds.iter().position(|k| *k == p.integrator).unwrap_or(5);
                let at = series.iter().position(|s| s.name == name).unwrap_or_else(|| {
                    series.push(Series {
                        name,
                        points: Vec::new(),
                        hollow: p.precision == "f32",
                        // meshes of one case in different colours
                        colour: kind + if p.tetrahedra == sizes[0] { 0 } else { 5 },
                    });
                    series.len() - 1
                });
                series[at].points.push(pair(p, refined));
            }
            let on_front = |p: &&&Point| if refined { p.pareto_refined } else { p.pareto };
            let mut fronts: Vec<Vec<[f64; 2]>> = Vec::new();
            let groups: Vec<Option<usize>> =
                if refined { vec![None] } else { sizes.iter().map(|s| Some(*s)).collect() };
            for size in groups {
                let mut front: Vec<[f64; 2]> = points
                    .iter()
                    .filter(on_front)
                    .filter(|p| size.is_none_or(|s| p.tetrahedra == s))
                    .map(|p| pair(p, refined))
                    .collect();
                front.sort_by(|a, b| a[0].total_cmp(&b[0]));
                fronts.push(front);
            }
            let (suffix, against) = if refined {
                (
                    "-refined",
                    format!("refined mesh of {} tets", case.refined_tetrahedra.unwrap_or(0)),
                )
            } else {
                ("", "same mesh".to_string())
            };
            let cost = if case.motion {
                "wall time per simulated second (s)"
            } else {
                "wall time to the answer (s)"
            };
            charts.push(Chart {
                name: format!("{}{suffix}", case.case.replace(' ', "-")),
                svg: plot::speed_against_error(
                    &format!("{}: against the converged solution, {against}", case.case),
                    cost,
                    "error (%)",
                    &series,
                    &fronts,
                )?,
            });
        }
    }
    Ok(charts)
}

const STYLE: &str = "\
body { margin: 0; background: #fff; color: #222; font: 15px/1.45 system-ui, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 24px; }
h1 { font-size: 26px; margin: 0 0 4px; }
h2 { font-size: 21px; margin: 36px 0 8px; }
h3 { font-size: 17px; margin: 28px 0 6px; }
p { margin: 6px 0; max-width: 90ch; }
.machine, .note { color: #444; font-size: 13px; }
.warning { background: #fff3d6; border-left: 4px solid #d98e00; padding: 6px 10px; }
code { background: #f2f2f2; padding: 1px 4px; border-radius: 3px; }
nav { margin: 12px 0; font-size: 14px; }
nav a { margin-right: 12px; color: #0059a8; }
figure { margin: 18px 0; }
figure svg { max-width: 100%; height: auto; border: 1px solid #e2e2e2; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 9px; border-bottom: 1px solid #e4e4e4; text-align: right; white-space: nowrap; }
th { background: #f4f4f4; position: sticky; top: 0; }
.words { text-align: left; }
tr.marked td { background: #e8f4e8; font-weight: 600; }
summary { cursor: pointer; font-weight: 600; margin: 18px 0 4px; }
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_survives_json_and_names_its_schema() {
        let mut report = Report::new("sinew-lab bench kernels", true);
        report.aims.push(Aim::at_most("a", 1.0, "ns", 2.0));
        report.kernels = Some(KernelReport::default());
        let text = serde_json::to_string(&report).unwrap();
        let back: Report = serde_json::from_str(&text).unwrap();
        assert_eq!(back, report);
        assert!(text.contains("\"schema\":\"sinew-bench/1\""));
        let html = report.html().unwrap();
        assert!(html.contains("missed") && html.ends_with("</html>\n"));
        // nothing is fetched
        assert!(!html.contains("src=") && !html.contains("<link") && !html.contains("@import"));
    }
}
