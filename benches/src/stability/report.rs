//! The pass table and what lies behind it: text, JSON, one HTML page.

use super::{Check, Column, Row, Status, Suite};
use crate::bench::error::BenchError;
use crate::bench::report::page;
use crate::bench::table::{Cell, Table, escape, three_digits};
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};

/// Passed of run; what fails though it is required is called so, unless it is known.
fn tally(rows: &[&Row]) -> String {
    let passed = rows.iter().filter(|r| r.status == Status::Pass).count();
    match rows {
        [] => String::new(),
        _ if rows.iter().any(|r| r.required && r.status == Status::Fail && !r.excused()) => {
            format!("{passed}/{} FAIL", rows.len())
        }
        _ if rows.iter().any(|r| r.required && r.status == Status::Fail) => {
            format!("{passed}/{} known", rows.len())
        }
        _ => format!("{passed}/{}", rows.len()),
    }
}

impl Row {
    /// What stopped it, or why what it misses is known.
    fn remark(&self) -> String {
        match self.known.filter(|_| self.excused()) {
            Some(known) => format!("known: {}", known.reason),
            None => self.note.clone(),
        }
    }
}

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

    /// Passed of run, where the suite must pass: per subgroup and column.
    pub fn pass_table(&self) -> Table {
        let mut settings: Vec<Option<Column>> =
            self.columns.iter().filter(|c| c.required()).map(|c| Some(*c)).collect();
        settings.push(None);
        let names: Vec<String> =
            settings.iter().map(|c| c.map_or("any setting".into(), Column::name)).collect();
        let mut columns = vec!["", "hard case"];
        columns.extend(names.iter().map(String::as_str));
        let mut table = Table::new("pass", "Hard cases: passed of run", &columns).note(format!(
            "Energy {}, recovery from inversion on unless named. \"any setting\": what depends on neither \
             integrator nor energy, and what every explicit integrator does beyond its limit. \"known\": \
             what misses is listed with its reason.",
            Column::DEFAULT.model.name()
        ));
        for part in self.parts() {
            let mut row: Vec<Cell> = vec![u64::from(part.group).into(), part.name.into()];
            let of_part = |r: &&Row| r.part == part;
            for setting in &settings {
                let rows: Vec<&Row> = self
                    .rows
                    .iter()
                    .filter(of_part)
                    .filter(|r| r.column.filter(|c| c.required()) == *setting)
                    .filter(|r| r.required)
                    .collect();
                row.push(tally(&rows).into());
            }
            if row[2..].iter().any(|c| *c != Cell::Text(String::new())) {
                table.row(row);
            }
        }
        table
    }

    /// Passed of run with the settings that are shown for comparison, per group.
    pub fn comparison_table(&self) -> Table {
        let compared = |r: &&Row| !r.required;
        let mut groups: Vec<u8> = self.rows.iter().filter(compared).map(|r| r.part.group).collect();
        groups.dedup();
        let names: Vec<String> = groups.iter().map(u8::to_string).collect();
        let mut columns = vec!["setting"];
        columns.extend(names.iter().map(String::as_str));
        let mut table =
            Table::new("comparison", "For comparison: passed of run, by group", &columns).note(
                "Not required: integrators and energies that are not robust, or not meant to be. A dash: \
                 the group has no such case.",
            );
        for &column in self.columns.iter().filter(|c| !c.required()) {
            let mut row: Vec<Cell> = vec![column.name().into()];
            for &group in &groups {
                let rows: Vec<&Row> = self
                    .rows
                    .iter()
                    .filter(compared)
                    .filter(|r| r.part.group == group && r.column == Some(column))
                    .collect();
                row.push(if rows.is_empty() { "-".into() } else { tally(&rows).into() });
            }
            table.row(row);
        }
        table
    }

    /// What the subgroups must meet.
    pub fn criteria_table(&self) -> Table {
        let mut table =
            Table::new("criteria", "Criteria", &["", "hard case", "criterion"]).note(format!(
                "every simulated case: finite positions and velocities after every step; total energy \
                 at most its start plus outside work, to {} of the energy scale for auto and safe and 5 % \
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
            let note = || Cell::from(row.remark());
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
                "recovering",
                "substeps",
                "s",
                "missed",
            ],
        );
        for row in &self.rows {
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
            let remark = Some(row.remark()).filter(|remark| !remark.is_empty());
            let missed: Vec<String> = missed.chain(remark).collect();
            let result = match (row.status, row.required) {
                (Status::Pass, _) if row.known.is_some() => "ok here",
                (Status::Pass, _) => "ok",
                (_, true) if row.excused() => "known",
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
                count(f.recovering).into(),
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
        let mut text = format!("{passed} of {} required cases passed", passed + failed);
        if other_passed + other_failed > 0 {
            let _ =
                write!(text, "; {other_passed} of {} for comparison", other_passed + other_failed);
        }
        let known = self.failures().filter(|r| r.excused()).count();
        let better = self.better_than_known().count();
        if known + better > 0 {
            let _ = write!(text, "; {known} known misses, {better} more pass here");
        }
        let set = self.instruction_set.name();
        let _ = write!(text, "; {}, {set}, {:.0} s", self.precision, self.seconds);
        text
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
        let comparison = self.comparison_table();
        if !comparison.rows.is_empty() {
            body += &comparison.html();
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
        writeln!(f, "{}", wrapped(&self.pass_table().text()))?;
        let comparison = self.comparison_table();
        if !comparison.rows.is_empty() {
            writeln!(f, "{}", wrapped(&comparison.text()))?;
        }
        if self.failures().next().is_some() {
            writeln!(f, "Required cases that fail")?;
        }
        for row in self.failures() {
            let with = row.column.map_or(String::new(), |c| format!(" [{}]", c.name()));
            writeln!(f, "  {} {}: {}{with}", row.part.group, row.part.name, row.case)?;
            for c in row.checks.iter().filter(|c| !c.pass) {
                let sign = if c.at_most { "<=" } else { ">=" };
                let [is, limit] = [c.measured, c.limit].map(three_digits);
                writeln!(f, "      {}: {is}, must be {sign} {limit}", c.what)?;
            }
            let remark = row.remark();
            if !remark.is_empty() {
                write!(f, "{}", wrapped(&format!("      {remark}\n")))?;
            }
        }
        for (i, row) in self.better_than_known().enumerate() {
            if i == 0 {
                writeln!(f, "Known misses that pass here")?;
            }
            let with = row.column.map_or(String::new(), |c| format!(" [{}]", c.name()));
            writeln!(f, "  {} {}: {}{with}", row.part.group, row.part.name, row.case)?;
        }
        writeln!(f, "{}", self.summary())
    }
}

/// Lines of notes broken at 110 characters, each part as far in as the first; tables are narrower.
fn wrapped(text: &str) -> String {
    let mut wrapped = String::new();
    for line in text.lines() {
        let indent = " ".repeat(line.len() - line.trim_start().len());
        if line.chars().count() <= 110 {
            wrapped += line;
            wrapped.push('\n');
            continue;
        }
        let mut now = indent.clone();
        for word in line.split_whitespace() {
            if now.chars().count() + 1 + word.chars().count() > 110 {
                wrapped += &now;
                wrapped.push('\n');
                now.clone_from(&indent);
            }
            if now.len() > indent.len() {
                now.push(' ');
            }
            now += word;
        }
        wrapped += &now;
        wrapped.push('\n');
    }
    wrapped
}
