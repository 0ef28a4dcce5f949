//! The quick hard-case suite with the default integrator: nothing explodes anywhere, and only the
//! cases that are known to end in a wound state may miss their criterion.

use sinew::prelude::*;
use sinew_benches::stability::{SuiteOptions, run};

/// Cases that fail today; a case that begins to pass must be taken off this list.
const KNOWN_FAILURES: [&str; 0] = [];

#[test]
fn safe_step_is_bounded_everywhere() {
    let suite =
        run(SuiteOptions { quick: true, integrator: Integrator::Safe, precision: Precision::F64 })
            .unwrap();
    assert!(suite.rows.iter().all(|r| r.bounded), "a case is not bounded:\n{suite}");
    let failed: Vec<String> =
        suite.rows.iter().filter(|r| !r.pass).map(|r| format!("{} {}", r.group, r.case)).collect();
    assert_eq!(failed.as_slice(), KNOWN_FAILURES, "\n{suite}");
}

#[test]
fn safe_step_is_bounded_in_single_precision() {
    let suite =
        run(SuiteOptions { quick: true, integrator: Integrator::Safe, precision: Precision::F32 })
            .unwrap();
    assert!(suite.rows.iter().all(|r| r.bounded), "a case is not bounded:\n{suite}");
}
