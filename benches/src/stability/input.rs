//! Group 11: bad input gives a typed error that names the entity before the first step, and leaves the
//! state as it was; extreme but valid input gives bounded results.

use super::prelude::*;
use sinew::engine::mesh::check::{FindingCode, Severity};
use sinew::engine::step::StepError;
use sinew::models::body::BodyError;

const PART: CasePart = CasePart {
    group: 11,
    name: "bad input",
    criterion: "typed error naming the entity before the first step; state intact",
};
const EXTREME: CasePart = CasePart {
    group: 11,
    name: "extreme but valid input",
    criterion: "bounded; far bodies as near ones (1e6 m: 1e-8, 1e9 m: 1e-5, f32 at 1e6 m: 1e-4)",
};
const SIZE: DVec3 = DVec3::new(0.2, 0.05, 0.05);

pub(super) fn cases() -> Result<Cases, MeshError> {
    let mesh = Arc::new(jitter_interior(&box_tets(SIZE, [6, 2, 2])?, 0.15, 11)?);
    type InputBody = fn(&CaseSetting, &Mesh) -> CaseOutcome;
    let table: [(CasePart, &str, InputBody); 14] = [
        (PART, "rest position not finite", rest_positions),
        (PART, "state not finite", states),
        (PART, "E not finite, zero or negative", young_moduli),
        (PART, "nu not finite, 0.5, beyond, -1 or below", poisson_ratios),
        (PART, "rho not finite, zero or negative", densities),
        (PART, "step not finite, zero or negative", steps),
        (PART, "gravity not finite", gravities),
        (PART, "duplicate coordinates, repeated index", flat_by_index),
        (PART, "flat tetrahedron, sliver", flat),
        (PART, "inverted orientation", inverted),
        (PART, "duplicate tetrahedron, third on a face", duplicates),
        (PART, "unused vertices", unused),
        (EXTREME, "1e6 and 1e9 m from the origin", far),
        (EXTREME, "gravity of 1e6 m/s^2", heavy),
    ];
    let mut cases = Cases::default();
    for (part, name, body) in table {
        cases.within(Scope::Once, part, name.into(), true, &mesh, body);
    }
    Ok(cases)
}

/// A sound body in motion, to which bad things are done.
fn sound<'a>(setting: &CaseSetting, mesh: &'a Mesh) -> Result<CaseRun<'a>> {
    let mut run = CaseRun::new(setting, mesh, tissue(2e4, 0.4))?;
    run.simulation.set_gravity(GRAVITY);
    run.clamp("x0")?;
    run.steps(3)?;
    Ok(run)
}

/// Checks of one kind of bad input.
#[derive(Default)]
struct Refusals {
    checks: Vec<Check>,
}

impl Refusals {
    /// What must be so.
    fn holds(&mut self, what: &'static str, holds: bool) {
        self.checks.push(Check::holds(what, holds));
    }

    /// The error must be of the right kind, its message hold these words, and the state be untouched.
    fn note(&mut self, right: bool, message: &str, words: &[&str], intact: bool) {
        self.holds("typed error", right);
        self.holds("names entity and remedy", words.iter().all(|word| message.contains(word)));
        self.holds("state intact", intact);
    }

    /// A bad body added to a running world, which must go on.
    fn body(
        &mut self,
        setting: &CaseSetting,
        good: &Mesh,
        bad: &Mesh,
        material: YoungPoisson,
        kind: fn(&BodyError) -> bool,
        words: &[&str],
    ) -> Result<()> {
        let mut run = sound(setting, good)?;
        let before =
            (run.simulation.state_hash(), run.simulation.world().entities().count_spawned());
        let result = run.simulation.add_body(&BodyDescription::new("bad", bad, material));
        let after =
            (run.simulation.state_hash(), run.simulation.world().entities().count_spawned());
        let words: Vec<&str> = words.iter().copied().chain(["`bad`"]).collect();
        match result {
            Ok(_) => self.note(false, "", &words, false),
            Err(error) => self.note(kind(&error), &error.to_string(), &words, before == after),
        }
        run.step()
    }

    /// A step that must fail twice, and succeed once things are as they were.
    fn step(
        &mut self,
        setting: &CaseSetting,
        mesh: &Mesh,
        spoil: impl Fn(&mut Simulation),
        kind: fn(&StepError) -> bool,
        words: &[&str],
    ) -> Result<()> {
        let mut run = sound(setting, mesh)?;
        let hash = run.simulation.state_hash();
        spoil(&mut run.simulation);
        for _ in 0..2 {
            let result = run.simulation.step();
            let intact = run.simulation.state_hash() == hash;
            match result {
                Ok(()) => self.note(false, "", words, false),
                Err(error) => self.note(kind(&error), &error.to_string(), words, intact),
            }
        }
        run.simulation.set_dt(0.01);
        run.simulation.set_gravity(DVec3::ZERO);
        run.step()
    }

    fn outcome(self) -> CaseOutcome {
        Ok((Figures::default(), self.checks))
    }
}

const NOT_FINITE: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

fn rest_positions(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    for bad in NOT_FINITE {
        for axis in 0..3 {
            let mut spoilt = mesh.clone();
            spoilt.points[3][axis] = bad;
            let kind = |e: &BodyError| matches!(e, BodyError::Tetrahedron { .. });
            let words = ["tetrahedron ", "finite"];
            refusals.body(setting, mesh, &spoilt, tissue(1e4, 0.3), kind, &words)?;
            let found = check(&spoilt, &CheckOptions::default()).err();
            let named = found.is_some_and(|e| {
                let finding = e.report.finding(FindingCode::NonFiniteCoordinate);
                finding.is_some_and(|f| f.entity.contains("vertex 3"))
            });
            refusals.holds("mesh check names the vertex", named);
        }
    }
    refusals.outcome()
}

fn states(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    for bad in NOT_FINITE {
        for velocity in [false, true] {
            let mut run = sound(setting, mesh)?;
            let u = run.simulation.displacements(run.body);
            let v = run.simulation.velocities(run.body);
            let (mut bad_u, mut bad_v) = (u.clone(), v.clone());
            (if velocity { &mut bad_v } else { &mut bad_u })[11].y = bad;
            run.simulation.set_state(run.body, &bad_u, &bad_v)?;
            let hash = run.simulation.state_hash();
            let error = run.simulation.step().err();
            let right = matches!(error, Some(StepError::NotFinite { vertex: MeshVertex(11), .. }));
            let message = error.map_or(String::new(), |e| e.to_string());
            let intact = run.simulation.state_hash() == hash;
            refusals.note(right, &message, &["vertex 11 ", "`body`"], intact);
            run.simulation.set_state(run.body, &u, &v)?;
            run.step()?;
        }
    }
    refusals.outcome()
}

fn materials(
    setting: &CaseSetting,
    mesh: &Mesh,
    bad: &[f64],
    spoil: fn(&mut YoungPoisson, f64),
    words: &[&str],
) -> CaseOutcome {
    let mut refusals = Refusals::default();
    for &value in bad {
        let mut material = tissue(1e4, 0.3);
        spoil(&mut material, value);
        let kind = |e: &BodyError| matches!(e, BodyError::Material { .. });
        refusals.body(setting, mesh, mesh, material, kind, words)?;
    }
    refusals.outcome()
}

fn young_moduli(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let bad = [&NOT_FINITE[..], &[0.0, -1e4]].concat();
    materials(setting, mesh, &bad, |m, x| m.young_modulus = x, &["Young's modulus"])
}

fn poisson_ratios(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let bad = [&NOT_FINITE[..], &[0.49995, 0.5, 0.7, -1.0, -3.0]].concat();
    materials(setting, mesh, &bad, |m, x| m.poisson_ratio = x, &["Poisson's ratio"])
}

fn densities(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let bad = [&NOT_FINITE[..], &[0.0, -1.0]].concat();
    materials(setting, mesh, &bad, |m, x| m.density = x, &["density"])
}

fn steps(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    for dt in [0.0, -0.01].into_iter().chain(NOT_FINITE) {
        let kind = |e: &StepError| matches!(e, StepError::InvalidStep { .. });
        refusals.step(setting, mesh, |s| s.set_dt(dt), kind, &["step length dt", "positive"])?;
    }
    refusals.outcome()
}

fn gravities(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    for bad in NOT_FINITE {
        for axis in DVec3::AXES {
            let gravity = DVec3::select(axis.cmpgt(DVec3::ZERO), DVec3::splat(bad), DVec3::ZERO);
            let kind = |e: &StepError| matches!(e, StepError::InvalidGravity { .. });
            let words = ["gravity", "not finite"];
            refusals.step(setting, mesh, |s| s.set_gravity(gravity), kind, &words)?;
        }
    }
    refusals.outcome()
}

fn flat_by_index(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    let [a, b, c, d] = mesh.tetrahedra[17];
    let mut same_place = mesh.clone();
    same_place.points[b as usize] = same_place.points[a as usize];
    let flat = |e: &BodyError| matches!(e, BodyError::Tetrahedron { .. });
    refusals.body(setting, mesh, &same_place, tissue(1e4, 0.3), flat, &["tetrahedron ", "flat"])?;
    let count = mesh.points.len() as u32;
    for indices in [[a, a, c, d], [a, b, c, b], [a, b, c, count], [u32::MAX, b, c, d]] {
        let mut spoilt = mesh.clone();
        spoilt.tetrahedra[17] = indices;
        let kind = |e: &BodyError| matches!(e, BodyError::Index { index: 17, .. });
        let words = ["tetrahedron 17 ", "distinct"];
        refusals.body(setting, mesh, &spoilt, tissue(1e4, 0.3), kind, &words)?;
    }
    refusals.outcome()
}

/// One tetrahedron whose fourth vertex is at a height over the unit triangle.
fn leaf(height: f64) -> Mesh {
    let points = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(0.3, 0.3, height)];
    Mesh { points, tetrahedra: vec![[0, 1, 2, 3]], ..Mesh::default() }
}

fn flat(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    for height in [0.0, 1e-13] {
        let kind = |e: &BodyError| matches!(e, BodyError::Tetrahedron { tetrahedron: 0, .. });
        let words = ["tetrahedron 0", "flat"];
        refusals.body(setting, mesh, &leaf(height), tissue(1e4, 0.3), kind, &words)?;
        let error = check(&leaf(height), &CheckOptions::default()).err();
        let named = error.is_some_and(|e| e.report.finding(FindingCode::ZeroVolume).is_some());
        refusals.holds("mesh check calls it flat", named);
    }
    // a sliver above the limit is a body, with a warning
    let report = check(&leaf(1e-7), &CheckOptions::default())?.report;
    let finding = report.finding(FindingCode::Sliver);
    let warned = finding.is_some_and(|f| f.severity == Severity::Warning);
    refusals.holds("mesh check warns of a sliver", warned);
    let sliver = leaf(1e-7);
    CaseRun::new(setting, &sliver, tissue(1e4, 0.3))?;
    refusals.outcome()
}

fn inverted(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    let mut spoilt = mesh.clone();
    spoilt.tetrahedra[17].swap(0, 1);
    let kind = |e: &BodyError| matches!(e, BodyError::Tetrahedron { tetrahedron: 17, .. });
    let words = ["tetrahedron 17", "swap"];
    refusals.body(setting, mesh, &spoilt, tissue(1e4, 0.3), kind, &words)?;
    let checked = check(&spoilt, &CheckOptions::default())?;
    let reported =
        checked.report.finding(FindingCode::InvertedWinding).is_some_and(|f| f.count == 1);
    refusals.holds("mesh check reports it", reported);
    let volume = checked.mesh.signed_volume(checked.mesh.tetrahedra[17]);
    refusals.holds("mesh check mends it", volume.is_some_and(|v| v > 0.0));
    let strict = CheckOptions { strict: true, ..CheckOptions::default() };
    refusals.holds("an error in strict mode", check(&spoilt, &strict).is_err());
    refusals.outcome()
}

fn duplicates(_: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    let mut twice = mesh.clone();
    twice.tetrahedra.push(mesh.tetrahedra[5]);
    // a third tetrahedron on a face that has two already
    let mut third = mesh.clone();
    let [a, b, c] = interior_face(mesh).ok_or("the bar has no inner face")?;
    let x = [a, b, c].map(|v| mesh.points[v as usize]);
    let up = (x[1] - x[0]).cross(x[2] - x[0]).normalize();
    third.points.push(x[0] + 0.01 * up);
    third.tetrahedra.push([a, b, c, mesh.points.len() as u32]);
    for (spoilt, code) in
        [(twice, FindingCode::DuplicateCell), (third, FindingCode::NonManifoldFace)]
    {
        let report = match check(&spoilt, &CheckOptions::default()) {
            Ok(checked) => checked.report,
            Err(error) => *error.report,
        };
        let named = report.finding(code).is_some_and(|f| {
            f.severity >= Severity::Warning && f.count >= 1 && !f.entity.is_empty()
        });
        refusals.holds("mesh check names and counts them", named);
    }
    refusals.outcome()
}

/// A face that two tetrahedra share.
fn interior_face(mesh: &Mesh) -> Option<[u32; 3]> {
    let mut seen = std::collections::HashSet::new();
    mesh.tetrahedra.iter().find_map(|&[a, b, c, d]| {
        [[a, b, c], [a, b, d], [a, c, d], [b, c, d]].into_iter().find(|face| {
            let mut sorted = *face;
            sorted.sort_unstable();
            !seen.insert(sorted)
        })
    })
}

fn unused(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut refusals = Refusals::default();
    let mut more = mesh.clone();
    more.points.extend([DVec3::ONE, DVec3::ZERO]);
    let report = check(&more, &CheckOptions::default())?.report;
    let counted = report.finding(FindingCode::UnusedVertices).is_some_and(|f| f.count == 2);
    refusals.holds("mesh check counts them", counted);
    let mut run = sound(setting, &more)?;
    let without = sound(setting, mesh)?.simulation.displacements(run.body);
    let with = run.simulation.displacements(run.body);
    let same = with[..without.len()] == without[..];
    refusals.holds("the body moves as without them", same);
    let still = with[without.len()..].iter().all(|u| *u == DVec3::ZERO);
    refusals.holds("they stay", still);
    let error = run.simulation.rows(run.body, "pin", &[more.points.len() as u32 - 1]).err();
    let message = error.map_or(String::new(), |e| e.to_string());
    let words = ["`pin`", "`body`"];
    let named = words.iter().all(|word| message.contains(word));
    refusals.holds("cannot be held, with an error", named);
    run.step()?;
    refusals.outcome()
}

fn far(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let sag = |offset: f64, precision| -> Result<Vec<DVec3>> {
        let mut moved = mesh.clone();
        moved.points.iter_mut().for_each(|x| *x += DVec3::new(offset, -offset, offset));
        let mut run =
            CaseRun::new(&CaseSetting { precision, ..*setting }, &moved, tissue(2e4, 0.4))?;
        run.solver(|s| s.linear_tolerance = if precision == Precision::F64 { 1e-10 } else { 1e-6 });
        run.simulation.set_gravity(GRAVITY);
        run.clamp("x0")?;
        run.steps(20)?;
        Ok(run.simulation.displacements(run.body))
    };
    let mut checks = Vec::new();
    let all =
        [(Precision::F64, 1e6, 1e-8), (Precision::F64, 1e9, 1e-5), (Precision::F32, 1e6, 1e-4)];
    for (precision, offset, limit) in all {
        let (near, away) = (sag(0.0, precision)?, sag(offset, precision)?);
        let error = near.iter().zip(&away).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        checks.push(Check::at_most("difference over size", error / SIZE.x, limit));
    }
    Ok((Figures::default(), checks))
}

fn heavy(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut run = sound(setting, mesh)?;
    run.simulation.set_gravity(DVec3::new(0.0, 0.0, -1e6));
    let mass = run.mass();
    run.open_books();
    run.steps(50)?;
    let reported = run.figures.most_inverted as f64;
    let check = Check::at_least("inverted elements reported", reported, 1.0);
    Ok(run.finish(mass * 1e6 * SIZE.x, [check]))
}
