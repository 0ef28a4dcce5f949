//! The pass table and what lies behind it: text, JSON, one HTML page.

use super::{Check, Column, Row, Status, Suite};
use crate::bench::error::BenchError;
use crate::bench::report::page;
use crate::bench::table::{Cell, Table, escape, three_digits};
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};

impl Suite {
    /// Subgroups in order.
    fn parts(&self) -> Vec<super::Part> {
        let mut parts: Vec<super::Part> = Vec::new();
        for row in &self.rows {
            if !parts.contains(&row.part) {
                parts.push(row.part);
            }
        }
        parts
    }

    /// Passed of run, per subgroup and column.
    pub fn pass_table(&self) -> Table {
        let names: Vec<String> = self.columns.iter().map(|c| c.name()).collect();
        let mut columns = vec!["", "hard case"];
        columns.extend(names.iter().map(String::as_str));
        columns.push("independent");
        let cells = self.columns.iter().map(|c| Some(*c)).chain([None]);
        let cells: Vec<Option<Column>> = cells.collect();
        let required: Vec<String> =
            self.columns.iter().filter(|c| c.required()).map(|c| c.name()).collect();
        let mut table = Table::new("pass", "Hard cases: passed of run", &columns).note(format!(
            "{}: must pass, as must everything that depends on neither integrator nor model, and what \
             explicit integrators do beyond their limit. The others are shown for comparison. Energy \
             svk_comp unless named.",
            required.join(", ")
        ));
        for part in self.parts() {
            let of_part = || self.rows.iter().filter(|r| r.part == part);
            let mut row: Vec<Cell> = vec![u64::from(part.group).into(), part.name.into()];
            row.extend(cells.iter().map(|column| {
                let rows: Vec<&Row> = of_part().filter(|r| r.column == *column).collect();
                let available = rows.iter().filter(|r| r.status != Status::NotAvailable).count();
                let passed = rows.iter().filter(|r| r.status == Status::Pass).count();
                match (available, rows.len()) {
                    (0, 0) => Cell::Text(String::new()),
                    (0, _) => Cell::Text("not yet".into()),
                    _ if rows.iter().any(|r| r.required && r.status == Status::Fail) => {
                        Cell::Text(format!("{passed}/{available} FAIL"))
                    }
                    _ => Cell::Text(format!("{passed}/{available}")),
                }
            }));
            table.row(row);
        }
        for row in self.rows.iter().filter(|r| r.status == Status::NotAvailable) {
            table.notes.push(format!("{} {}: {}.", row.part.group, row.part.name, row.note));
        }
        table
    }

    /// What the subgroups must meet.
    pub fn criteria_table(&self) -> Table {
        let mut table =
            Table::new("criteria", "Criteria", &["", "hard case", "criterion"]).note(format!(
                "every simulated case: finite positions and velocities after every step; total energy \
                 at most its start plus outside work, to {} of the energy scale for the safe step and 5 % \
                 for the others; where it must pass, the first case of each subgroup gives the same bits \
                 again and with two threads.",
                if self.precision == "f32" { "1e-5" } else { "1e-6" }
            ));
        for part in self.parts() {
            let group = u64::from(part.group);
            table.row(vec![group.into(), part.name.into(), part.criterion.into()]);
        }
        table
    }

    /// Required cases that failed.
    pub fn failure_table(&self) -> Table {
        let mut table = Table::new(
            "failures",
            "Required cases that fail",
            &["", "case", "with", "criterion", "measured", "limit", "remark"],
        );
        for row in self.failures() {
            let missed: Vec<&Check> = row.checks.iter().filter(|c| !c.pass).collect();
            let with = row.column.map_or(String::new(), Column::name);
            let head = |what: &str| -> Vec<Cell> {
                let case = format!("{}: {}", row.part.name, row.case);
                let group = u64::from(row.part.group);
                vec![group.into(), case.into(), with.clone().into(), what.into()]
            };
            let note = || Cell::from(&row.note);
            for c in &missed {
                let limit =
                    format!("{} {}", if c.at_most { "<=" } else { ">=" }, three_digits(c.limit));
                let tail = vec![c.measured.into(), limit.into(), note()];
                table.row([head(c.what), tail].concat());
            }
            if missed.is_empty() {
                table.row([head("runs"), vec![Cell::Missing, Cell::Missing, note()]].concat());
            }
        }
        table
    }

    /// Every case.
    pub fn row_table(&self) -> Table {
        let mut table = Table::new(
            "cases",
            "All cases",
            &[
                "",
                "hard case",
                "case",
                "with",
                "result",
                "energy rise",
                "most inverted",
                "at end",
                "edge error",
                "steps",
                "solves/step",
                "projected",
                "capped",
                "fallbacks",
                "unconverged",
                "substeps",
                "s",
                "missed",
            ],
        );
        for row in self.rows.iter().filter(|r| r.status != Status::NotAvailable) {
            let f = &row.figures;
            let simulated = f.steps > 0;
            let count = |n: u64| simulated.then_some(n);
            let missed = row.checks.iter().filter(|c| !c.pass).map(|c| {
                format!(
                    "{}: {} against {}",
                    c.what,
                    three_digits(c.measured),
                    three_digits(c.limit)
                )
            });
            let missed: Vec<String> =
                missed.chain((!row.note.is_empty()).then(|| row.note.clone())).collect();
            let result = match (row.status, row.required) {
                (Status::Pass, _) => "ok",
                (_, true) => "FAIL",
                _ => "misses",
            };
            table.row(vec![
                u64::from(row.part.group).into(),
                row.part.name.into(),
                (&row.case).into(),
                row.column.map_or(String::new(), Column::name).into(),
                result.into(),
                f.energy_excess.into(),
                count(f.most_inverted).into(),
                count(f.inverted).into(),
                f.edge_error.into(),
                count(f.steps).into(),
                simulated.then(|| f.solves as f64 / f.steps as f64).into(),
                count(f.projected).into(),
                count(f.capped).into(),
                count(f.fallbacks).into(),
                count(f.unconverged).into(),
                count(f.substeps).into(),
                row.seconds.into(),
                missed.join("; ").into(),
            ]);
        }
        table
    }

    /// How many cases ran and how they ended.
    pub fn summary(&self) -> String {
        let count = |required: bool, status: Status| {
            self.rows.iter().filter(|r| r.required == required && r.status == status).count()
        };
        let (passed, failed) = (count(true, Status::Pass), count(true, Status::Fail));
        let (other_passed, other_failed) = (count(false, Status::Pass), count(false, Status::Fail));
        format!(
            "{passed} of {} required cases passed; {other_passed} of {} for comparison; {} subgroups not \
             available yet; {}, {:.0} s",
            passed + failed,
            other_passed + other_failed,
            count(false, Status::NotAvailable),
            self.precision,
            self.seconds,
        )
    }

    /// One page with everything in it.
    pub fn html(&self) -> String {
        let mut body = String::from("<h1>Sinew: the hard cases</h1>\n");
        let _ = writeln!(body, "<p class=\"machine\">{}</p>", escape(&self.machine.line()));
        let _ = writeln!(body, "<p>{}.</p>", escape(&self.summary()));
        let _ = writeln!(
            body,
            "<p>Made by <code>{}</code>{}.</p>",
            escape(&self.command),
            if self.quick { " (a selection of the cases)" } else { "" }
        );
        body += &self.pass_table().html();
        if self.failures().next().is_some() {
            body += &self.failure_table().html();
        }
        body += &self.criteria_table().html();
        let rows = self.row_table();
        let _ = write!(
            body,
            "<details><summary>All cases ({})</summary>\n{}</details>\n",
            rows.rows.len(),
            rows.html()
        );
        page("Sinew hard cases", &body)
    }

    /// Writes the page: into `stability.html` of a folder, or into a file that ends in `.html`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_html(&self, path: &Path) -> Result<PathBuf, BenchError> {
        let is_page = path.extension().is_some_and(|e| e == "html" || e == "htm");
        let file = if is_page { path.to_path_buf() } else { path.join("stability.html") };
        let error =
            |e: std::io::Error| BenchError::Write { path: file.clone(), reason: e.to_string() };
        if let Some(folder) = file.parent() {
            std::fs::create_dir_all(folder).map_err(error)?;
        }
        std::fs::write(&file, self.html()).map_err(error)?;
        Ok(file)
    }
}

impl fmt::Display for Suite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.pass_table().text())?;
        if self.failures().next().is_some() {
            writeln!(f, "{}", self.failure_table().text())?;
        }
        writeln!(f, "{}", self.summary())
    }
}
