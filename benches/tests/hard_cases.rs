//! The quick selection of the hard cases: what must pass passes, but for what is known to miss.

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;
use sinew_benches::stability::shape::{SIZE, smallest_dihedral, with_dihedral};
use sinew_benches::stability::{
    CasePart, CaseStatus, Check, Figures, HardCaseRow, KNOWN_MISSES, Suite, SuiteOptions,
    excused_cases, run,
};
use std::io::Write;

/// Whether the quick selection passes, but for known misses; these are told even where output is captured.
fn quick(options: SuiteOptions) -> Suite {
    let suite = run(&SuiteOptions { quick: true, ..options }, |_, _| ()).unwrap();
    for group in 1..=11 {
        let here = suite.rows.iter().any(|r| r.part.group == group);
        assert!(here, "group {group} is missing");
    }
    assert!(suite.passed(), "\n{suite}");
    let tell = |what: &str, row: &HardCaseRow| {
        let Some(known) = row.known else { return };
        let _ = writeln!(
            std::io::stderr(),
            "{what} ({}, {}): {} {}: {} ({})",
            suite.precision,
            suite.instruction_set.name(),
            row.part.group,
            row.part.name,
            row.case,
            known.reason
        );
    };
    suite.failures().for_each(|row| tell("known miss", row));
    suite.better_than_known().for_each(|row| tell("passes here", row));
    suite
}

#[test]
fn required_cases_pass() {
    let suite = quick(SuiteOptions::default());
    // the settings for comparison are there
    let compared = |r: &&HardCaseRow| r.column.is_some_and(|c| c.model == Model::MassSpring);
    assert!(suite.rows.iter().filter(compared).count() > 10);
    let page = suite.html();
    assert!(page.contains("Hard cases: passed of run") && page.ends_with("</html>\n"));
    assert!(!page.contains("src=") && !page.contains("<link"));
}

#[test]
fn required_cases_pass_in_single_precision() {
    quick(SuiteOptions {
        precision: Precision::F32,
        integrators: vec![Integrator::Auto, Integrator::Safe],
        ..Default::default()
    });
}

#[test]
fn senseless_options_are_named() {
    let with = |options: SuiteOptions| run(&options, |_, _| ()).unwrap_err().to_string();
    let group = with(SuiteOptions { groups: vec![15], ..Default::default() });
    assert!(group.contains("15") && group.contains("1 to 14"), "{group}");
    let integrators = vec![Integrator::QuasiStatic];
    let equilibria = with(SuiteOptions { integrators, ..Default::default() });
    assert!(equilibria.contains("quasi-static"), "{equilibria}");
}

#[test]
fn every_known_miss_is_of_a_case() {
    let excused = excused_cases().unwrap();
    for known in &KNOWN_MISSES {
        for name in known.cases {
            let found = excused.iter().any(|(case, by)| case == name && *by == known);
            assert!(found, "{name}: {known:?}");
        }
    }
}

/// A row of a listed case with these checks.
fn row(checks: Vec<Check>) -> HardCaseRow {
    let part = CasePart { group: 1, name: "cantilevers", criterion: "" };
    let status = match checks.iter().all(|c| c.pass) && !checks.is_empty() {
        true => CaseStatus::Pass,
        false => CaseStatus::Fail,
    };
    HardCaseRow {
        part,
        case: String::new(),
        column: None,
        status,
        required: true,
        known: Some(&KNOWN_MISSES[0]),
        checks,
        figures: Figures::default(),
        note: String::new(),
        seconds: 0.0,
    }
}

#[test]
fn a_known_miss_excuses_nothing_else() {
    let missed = || Check::none(KNOWN_MISSES[0].checks[0], 1);
    assert!(row(vec![missed(), Check::none("other", 0)]).excused());
    assert!(!row(vec![missed(), Check::none("other", 1)]).excused());
    assert!(!row(vec![Check::none(KNOWN_MISSES[0].checks[0], 0)]).excused(), "it passes");
    assert!(!row(Vec::new()).excused(), "an error is no miss");
    assert!(!HardCaseRow { known: None, ..row(vec![missed()]) }.excused());
    assert!(!Check::at_most("", f64::NAN, 1.0).pass && !Check::at_least("", f64::NAN, 1.0).pass);
}

#[test]
fn shapes_are_as_bad_as_they_say() {
    let bar = box_tets(SIZE, [8, 2, 2]).unwrap();
    for degrees in [1.0, 0.01] {
        let found = smallest_dihedral(&with_dihedral(&bar, degrees));
        assert!((found / degrees - 1.0).abs() < 1e-6, "{found} instead of {degrees}");
    }
    assert!((smallest_dihedral(&bar) - 45.0).abs() < 1e-9);
}
