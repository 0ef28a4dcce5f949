//! Shared by the tests of the mesh check.

use glam::{DQuat, DVec3};
use sinew_engine::mesh::{CheckOptions, CheckReport, FindingCode as Code, Mesh, Severity, check};

pub fn report(mesh: &Mesh, options: &CheckOptions) -> CheckReport {
    match check(mesh, options) {
        Ok(checked) => {
            assert!(!checked.report.has_errors());
            checked.report
        }
        Err(error) => {
            assert!(error.report.has_errors());
            for finding in error.report.errors() {
                assert!(error.to_string().contains(&finding.to_string()));
            }
            *error.report
        }
    }
}

/// The mesh must have this finding, and beside it none but `others`, at every scale, turned and moved.
pub fn expect(
    mesh: &Mesh,
    (turn, shift): (DQuat, DVec3),
    code: Code,
    (severity, count): (Severity, usize),
    others: &[Code],
) -> String {
    let mut text = String::new();
    for scale in [1e-6, 1.0, 1e3] {
        let mesh = mesh.transformed(scale, turn, scale * shift);
        let options = CheckOptions { expected_size: None, ..CheckOptions::default() };
        let report = report(&mesh, &options);
        let finding = report.finding(code).unwrap_or_else(|| panic!("{code} at {scale}: {report}"));
        assert_eq!((finding.severity, finding.count), (severity, count), "{finding}");
        assert!(!finding.remedy.is_empty() && !finding.message.is_empty());
        for other in &report.findings {
            assert!(other.code == code || others.contains(&other.code), "{scale}: {report}");
        }
        text = finding.to_string();
    }
    text
}
