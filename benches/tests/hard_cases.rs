//! The quick selection of the hard cases: what must pass passes, but for what is known to miss.

use sinew::prelude::*;
use sinew_benches::stability::{Row, Suite, SuiteOptions, run};
use std::io::Write;

/// Whether the quick selection passes, but for known misses; these are told even where output is captured.
fn quick(options: SuiteOptions) -> Suite {
    let suite = run(&SuiteOptions { quick: true, ..options }, |_, _| ()).unwrap();
    for group in 1..=11 {
        let here = suite.rows.iter().any(|r| r.part.group == group);
        assert!(here, "group {group} is missing");
    }
    assert!(suite.passed(), "\n{suite}");
    let tell = |what: &str, row: &Row| {
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
    let compared = |r: &&Row| r.column.is_some_and(|c| c.model == Model::MassSpring);
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
    let group = with(SuiteOptions { groups: vec![14], ..Default::default() });
    assert!(group.contains("14") && group.contains("1 to 13"), "{group}");
    let integrators = vec![Integrator::QuasiStatic];
    let equilibria = with(SuiteOptions { integrators, ..Default::default() });
    assert!(equilibria.contains("quasi-static"), "{equilibria}");
}
