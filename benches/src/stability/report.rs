//! The pass table and what lies behind it: text, JSON, one HTML page.

use super::Suite;
use super::rows::{CasePart, CaseStatus, Check, HardCaseRow, PassColumn};
use crate::toolbox::error::Result;
use crate::toolbox::report::ReportFiles;
use sinew_tune::page::Page;
use sinew_tune::table::{Cell, Table, escape, three_digits};
use sinew_tune::table_of;
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};

/// Passed of run; what fails though it is required is called so, unless it is known.
fn tally(rows: &[&HardCaseRow]) -> String {
    let passed = rows.iter().filter(|r| r.status == CaseStatus::Pass).count();
    match rows {
        [] => String::new(),
        _ if rows.iter().any(|r| r.required && r.status == CaseStatus::Fail && !r.excused()) => {
            format!("{passed}/{} FAIL", rows.len())
        }
        _ if rows.iter().any(|r| r.required && r.status == CaseStatus::Fail) => {
            format!("{passed}/{} known", rows.len())
        }
        _ => format!("{passed}/{}", rows.len()),
    }
}

impl HardCaseRow {
    /// What stopped it, or why what it misses is known.
    fn remark(&self) -> String {
        match self.known.filter(|_| self.excused()) {
            Some(known) => format!("known: {}", known.reason),
            None => self.note.clone(),
        }
    }

    /// The column in words, nothing where none matters.
    fn with(&self) -> String {
        self.column.map_or(String::new(), PassColumn::name)
    }

    /// How it ended, in a word.
    fn result(&self) -> &'static str {
        match (self.status, self.required) {
            (CaseStatus::Pass, _) if self.known.is_some() => "ok here",
            (CaseStatus::Pass, _) => "ok",
            (_, true) if self.excused() => "known",
            (_, true) => "FAIL",
            _ => "misses",
        }
    }

    /// What it misses, and why.
    fn missed(&self) -> String {
        let missed = self.checks.iter().filter(|c| !c.pass).map(|c| {
            format!("{}: {} against {}", c.what, three_digits(c.measured), three_digits(c.limit))
        });
        let remark = Some(self.remark()).filter(|remark| !remark.is_empty());
        missed.chain(remark).collect::<Vec<_>>().join("; ")
    }

    /// Group, subgroup, case and column on a line.
    fn line(&self) -> String {
        let with = self.column.map_or(String::new(), |c| format!(" [{}]", c.name()));
        format!("  {} {}: {}{with}", self.part.group, self.part.name, self.case)
    }
}

impl Check {
    /// The limit with its sign.
    fn bound(&self) -> String {
        format!("{} {}", if self.at_most { "<=" } else { ">=" }, three_digits(self.limit))
    }
}

impl Suite {
    /// Subgroups in order.
    fn parts(&self) -> Vec<CasePart> {
        let mut parts: Vec<CasePart> = Vec::new();
        for row in &self.rows {
            if !parts.contains(&row.part) {
                parts.push(row.part);
            }
        }
        parts
    }

    /// Passed of run, where the suite must pass: per subgroup and column.
    pub fn pass_table(&self) -> Table {
        let mut settings: Vec<Option<PassColumn>> =
            self.columns.iter().filter(|c| c.required()).map(|c| Some(*c)).collect();
        settings.push(None);
        let names: Vec<String> =
            settings.iter().map(|c| c.map_or("any setting".into(), PassColumn::name)).collect();
        let mut columns = vec!["", "hard case"];
        columns.extend(names.iter().map(String::as_str));
        let mut table = Table::new("pass", "Hard cases: passed of run", &columns).note(format!(
            "Energy {}, recovery from inversion on unless named. \"any setting\": what depends on neither \
             integrator nor energy, and what every explicit integrator does beyond its limit. \"known\": \
             what misses is listed with its reason.",
            PassColumn::DEFAULT.model.name()
        ));
        for part in self.parts() {
            let mut row: Vec<Cell> = vec![u64::from(part.group).into(), part.name.into()];
            let of_part = |r: &&HardCaseRow| r.part == part;
            for setting in &settings {
                let rows: Vec<&HardCaseRow> = self
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
        let compared = |r: &&HardCaseRow| !r.required;
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
                let rows: Vec<&HardCaseRow> = self
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
        let parts = self.parts();
        table_of!("criteria", "Criteria"; for part in parts;
            "" => u64::from(part.group), "hard case" => part.name, "criterion" => part.criterion,
        )
        .note(format!(
            "every simulated case: finite positions and velocities after every step; total energy \
             at most its start plus outside work, to {} of the energy scale for auto and safe and 5 % \
             for the others; where it must pass, the first case of each subgroup gives the same bits \
             again and with two threads.",
            if self.precision == "f32" { "1e-5" } else { "1e-6" }
        ))
    }

    /// Required cases that failed.
    pub fn failure_table(&self) -> Table {
        let missed = self.failures().flat_map(|row| {
            let missed: Vec<Option<&Check>> =
                row.checks.iter().filter(|c| !c.pass).map(Some).collect();
            let missed = if missed.is_empty() { vec![None] } else { missed };
            missed.into_iter().map(move |check| (row, check))
        });
        table_of!("failures", "Required cases that fail"; for (row, check) in missed;
            "" => u64::from(row.part.group), "case" => format!("{}: {}", row.part.name, row.case),
            "with" => row.with(), "criterion" => check.map_or("runs", |c| c.what),
            "measured" => check.map(|c| c.measured), "limit" => check.map(Check::bound),
            "remark" => row.remark(),
        )
    }

    /// Every case.
    pub fn row_table(&self) -> Table {
        table_of!("cases", "All cases"; for row in &self.rows;
            where {
                let f = &row.figures;
                let simulated = f.steps > 0;
                let count = |n: u64| simulated.then_some(n);
            }
            "" => u64::from(row.part.group), "hard case" => row.part.name, "case" => &row.case,
            "with" => row.with(), "result" => row.result(), "energy rise" => f.energy_excess,
            "most inverted" => count(f.most_inverted), "at end" => count(f.inverted),
            "edge error" => f.edge_error, "steps" => count(f.steps),
            "solves/step" => simulated.then(|| f.solves as f64 / f.steps as f64),
            "projected" => count(f.projected), "capped" => count(f.capped),
            "fallbacks" => count(f.fallbacks), "unconverged" => count(f.unconverged),
            "recovering" => count(f.recovering), "substeps" => count(f.substeps),
            "s" => row.seconds, "missed" => row.missed(),
        )
    }

    /// How many cases ran and how they ended.
    pub fn summary(&self) -> String {
        let count = |required: bool, status: CaseStatus| {
            self.rows.iter().filter(|r| r.required == required && r.status == status).count()
        };
        let (passed, failed) = (count(true, CaseStatus::Pass), count(true, CaseStatus::Fail));
        let (other_passed, other_failed) =
            (count(false, CaseStatus::Pass), count(false, CaseStatus::Fail));
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
        let mut page = Page::new("Sinew hard cases", "Sinew: the hard cases", &self.machine.line());
        page.paragraph("", &format!("{}.", self.summary()));
        let selection = if self.quick { " (a selection of the cases)" } else { "" };
        let command = escape(&self.command);
        page.add(format_args!("<p>Made by <code>{command}</code>{selection}.</p>"));
        page.table(&self.pass_table());
        for table in [self.failure_table(), self.comparison_table()] {
            if !table.rows.is_empty() {
                page.table(&table);
            }
        }
        page.table(&self.criteria_table());
        page.table(&self.row_table());
        page.html()
    }

    /// Writes the page: into `stability.html` of a folder, or into a file that ends in `.html`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_html(&self, path: &Path) -> Result<PathBuf> {
        let is_page = path.extension().is_some_and(|e| e == "html" || e == "htm");
        let file = if is_page { path.to_path_buf() } else { path.join("stability.html") };
        let folder = file.parent().unwrap_or(Path::new(""));
        let mut files = ReportFiles::default();
        files.add(file.file_name().unwrap_or_default().to_string_lossy(), self.html());
        files.write(folder)?;
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
            writeln!(f, "{}", row.line())?;
            for c in row.checks.iter().filter(|c| !c.pass) {
                let (is, bound) = (three_digits(c.measured), c.bound());
                writeln!(f, "      {}: {is}, must be {bound}", c.what)?;
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
            writeln!(f, "{}", row.line())?;
        }
        writeln!(f, "{}", self.summary())
    }
}

/// Lines of notes broken at 110 characters, each part as far in as the first; tables are narrower.
fn wrapped(text: &str) -> String {
    let mut wrapped = String::new();
    for line in text.lines() {
        if line.chars().count() <= 110 {
            wrapped += &format!("{line}\n");
            continue;
        }
        let indent = " ".repeat(line.len() - line.trim_start().len());
        let mut now = indent.clone();
        for word in line.split_whitespace() {
            if now.chars().count() + 1 + word.chars().count() > 110 {
                wrapped += &format!("{now}\n");
                now.clone_from(&indent);
            }
            now += if now.len() > indent.len() { " " } else { "" };
            now += word;
        }
        wrapped += &format!("{now}\n");
    }
    wrapped
}
