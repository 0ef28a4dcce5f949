//! Natsupakpong & Cavusoglu 2010, tables 1 and 3: soft tissue, cylinders and cubes in tension, springs
//! against finite elements.

use super::Setup;
use super::lumped::{
    How, MATERIAL, Meshes, Ours, Row, Springs, against_print, error_table, in_readings, judged,
};
use super::overlay;
use super::prelude::*;
use super::shapes::printed;
use sinew_identify::ElementMethod::{Block, Frobenius, TwoNorm};
use sinew_identify::mass::MassLumping;
use sinew_identify::mesh::mesh_masses;
use sinew_tune::fit::assess::{against, reference};
use sinew_tune::fit::rig::{Reading, Rig};

/// Mesh, name in the paper, printed errors (rms, max) of the 2-norm and the Frobenius norm.
type Printed = (&'static str, &'static str, [f64; 2], [f64; 2]);
const TABLE_1: [Printed; 7] = [
    ("tissue_tri", "tissue, tri", [2.26, 4.99], [3.46, 6.42]),
    ("tissue_quad", "tissue, quad", [5.55, 9.65], [5.14, 8.44]),
    ("cylinder_tet", "cylinder, tet", [22.89, 43.73], [11.00, 24.29]),
    ("cylinder_hex", "cylinder, hex", [5.63, 18.49], [6.15, 18.00]),
    ("cylinder_hole_tet", "cylinder with hole, tet", [20.53, 38.96], [5.91, 13.77]),
    ("cube_tet", "cube, tet", [22.52, 53.51], [8.28, 25.29]),
    ("cube_hex", "cube, hex", [2.91, 6.92], [14.98, 25.19]),
];

/// Table 3, the cube at 30 %.
const TABLE_3: [Printed; 2] = [
    ("cube_tet", "cube, tet", [22.30, 53.35], [8.28, 25.29]),
    ("cube_hex", "cube, hex", [2.95, 14.36], [14.98, 25.19]),
];

/// Deformed bodies: file, title, and what the names of their meshes begin with.
const SHAPES: [(&str, &str, &str); 3] = [
    ("a-shapes-tissue", "The soft tissue in tension", "tissue"),
    ("a-shapes-cylinder", "The cylinders in tension", "cylinder"),
    ("a-shapes-cube", "The cube in tension", "cube"),
];

/// Elongation of table 1; the paper says at least 10 %.
const STRETCH_1: f64 = 0.1;
const STRETCH_3: f64 = 0.3;

/// Objects of which more than one mesh or outline has the printed counts, and how many are measured.
const SEVERAL: [(&str, u64); 4] =
    [("cylinder_hex", 2), ("tissue_tri", 2), ("tissue_quad", 4), ("cube_tet", 3)];

fn measure(meshes: &Meshes, wanted: &[Printed], stretch: f64) -> Result<Vec<Row>> {
    let hows = How::all(&[stretch]);
    let mut rows = Vec::new();
    for &(mesh, object, two, frobenius) in wanted {
        let count = SEVERAL.iter().find(|s| s.0 == mesh).map_or(1, |s| s.1);
        for number in 0..count {
            let specimen = meshes.variant(mesh, number)?;
            let fits = [(TwoNorm, Some(two)), (Frobenius, Some(frobenius)), (Block, None)];
            for (method, printed) in fits.into_iter().filter(|f| number == 0 || f.1.is_some()) {
                let springs = specimen.springs(method)?;
                let ours = Ours::measure(&specimen, &springs, specimen.rig.axis, &hows)?;
                let counts = specimen.counts;
                rows.push(Row { mesh, number, what: object, method, printed, counts, ours });
            }
        }
    }
    Ok(rows)
}

/// Part by which the errors of the one mesh that is known for certain may be off: how its end is held is not printed, and
/// clamped and on rollers they part by 1.3 % by themselves.
const CERTAIN: f64 = 0.02;

/// Errors of the cube of hexahedra with the F-norm under a consistent traction, its end clamped or on rollers.
fn cube(meshes: &Meshes) -> Result<Finding> {
    let specimen = meshes.get("cube_hex")?;
    let rig = &specimen.rig;
    let springs = specimen.springs(Frobenius)?;
    let stress = Rig::stress(&MATERIAL);
    let mut unit = [0.0; 3];
    unit[rig.axis] = stress * rig.length().signum();
    let mut words = Vec::new();
    let mut near = true;
    for (what, loading) in [
        ("clamped", rig.pushed(unit, Reading::Traction)),
        ("on rollers, its middle held", rig.free_tension(stress)),
    ] {
        let errors = reference(rig, &MATERIAL, &loading)
            .and_then(|fem| against(rig, &springs, &loading, &fem, None))?
            .errors;
        let own = [errors.rms_percent, errors.max_percent];
        near &= own.iter().zip([14.98, 25.19]).all(|(own, p)| (own / p - 1.0).abs() < CERTAIN);
        words.push(format!("{:.2} / {:.2} with its end {what}", own[0], own[1]));
    }
    Ok(Finding::of(near).says(format!(
        "table 1, cube of hexahedra, F-norm, consistent traction, on the only mesh that is known for certain: 14.98 / \
         25.19 printed, {}; {} % allowed",
        words.join(", "),
        100.0 * CERTAIN
    )))
}

/// The paper's claim about table 1: by e_rms the 2-norm is the better fit of triangles and hexahedra, the F-norm that of
/// quadrilaterals and tetrahedra. Both norms are compared on one mesh.
fn better(first: &[Row]) -> Option<Finding> {
    let hows: Vec<How> = first.first()?.ours.errors.iter().map(|e| e.0).collect();
    // on every mesh of an object
    let right = |t: &Printed, how: How| -> Vec<bool> {
        let two_wanted = t.0.ends_with("tri") || t.0.ends_with("hex");
        let rows = first.iter().filter(|r| r.mesh == t.0 && r.method == TwoNorm);
        let of = |row: &Row| {
            let own = |r: &&Row| (r.mesh, r.number, r.method) == (t.0, row.number, Frobenius);
            let f = first.iter().find(own).and_then(|r| r.ours.of(how));
            match (row.ours.of(how), f) {
                (Some(two), Some(f)) => (two[0] < f[0]) == two_wanted,
                // no equilibrium is no better
                (two, f) => f.is_some() && two.is_none() && !two_wanted,
            }
        };
        rows.map(of).collect()
    };
    let mut words = Vec::new();
    let (mut met, mut everywhere) = (Vec::new(), true);
    for &how in &hows {
        let found: Vec<(&str, Vec<bool>)> = TABLE_1.iter().map(|t| (t.1, right(t, how))).collect();
        let list = |not: &dyn Fn(&[bool]) -> bool| -> Vec<&str> {
            found.iter().filter(|f| not(&f.1)).map(|f| f.0).collect()
        };
        let wrong = list(&|meshes| !meshes.contains(&true));
        let some = list(&|meshes| meshes.contains(&true) && meshes.contains(&false));
        everywhere &= some.is_empty();
        for (what, objects) in [("not", &wrong), ("not on all meshes", &some)] {
            if !objects.is_empty() {
                words.push(format!("with {} {what} {}", how.words(), objects.join(", ")));
            }
        }
        met.push((how, TABLE_1.len() - wrong.len()));
    }
    Some(in_readings(&met, TABLE_1.len(), everywhere).says(format!(
        "table 1: by e_rms the 2-norm is the better fit in triangles and hexahedra, the F-norm in quadrilaterals and \
         tetrahedra (seven objects, each on one mesh at least; {})",
        words.join("; ")
    )))
}

/// What tables 1, 3 and 5 say of one and the same test.
fn contradictions(first: &[Row], third: &[Row]) -> Vec<Finding> {
    let of = |rows: &[Row], mesh: &str, method, rest: bool| {
        let row = rows.iter().find(|r| r.mesh == mesh && r.method == method)?;
        let is = |how: &How| {
            how.load == Reading::Traction && matches!(how.springs, Springs::RestLengths(_)) == rest
        };
        row.ours.errors.iter().find(|e| is(&e.0))?.1
    };
    // whether errors at 10 and at 30 % are the same to the two digits that are printed
    let same = |mesh, method, rest| {
        let (a, b) = (of(first, mesh, method, rest)?, of(third, mesh, method, rest)?);
        Some((0..2).all(|k| (a[k] - b[k]).abs() < 0.005))
    };
    let meshes = || TABLE_3.iter().map(|t| t.0).filter(|m| third.iter().any(|r| r.mesh == *m));
    let linear = meshes()
        .all(|m| same(m, Frobenius, false) == Some(true) && same(m, TwoNorm, false) == Some(true));
    let rest = meshes().all(|m| same(m, Frobenius, true) == Some(false));
    let here = |rest| {
        let pair = |rows| of(rows, "cube_hex", Frobenius, rest).unwrap_or([f64::NAN; 2]);
        let ([a, b], [c, d]) = (pair(first), pair(third));
        format!("{a:.2} / {b:.2} and {c:.2} / {d:.2}")
    };
    vec![
        Finding::paper_wrong(
            linear && rest,
            format!(
                "springs with their stiffness at rest have the same errors at any stretch, in every row; springs with \
                 rest lengths in none. So the F-norm rows, equal in all digits, are of the former and the 2-norm rows of \
                 the latter (here, cube of hexahedra, F-norm, at 10 and 30 %: {}; with rest lengths {})",
                here(false),
                here(true)
            ),
        )
        .says(
            "tables 1 and 3 compare the two norms: from 10 to 30 % the F-norm rows do not change (8.28 / 25.29, 14.98 / \
             25.19), those of the 2-norm do (22.52 / 53.51 to 22.30 / 53.35, 2.91 / 6.92 to 2.95 / 14.36)",
        ),
        Finding::paper_wrong(
            linear,
            "mesh, load, material and fit are the same, so with the linear springs of table 1's F-norm rows the errors \
             are as well",
        )
        .says(
            "the cube of 512 hexahedra by the 2-norm in tension has the errors 2.91 / 6.92 (table 1), 2.95 / 14.36 \
             (table 3) and 2.88 / 6.05 (table 5)",
        ),
    ]
}

/// Equation (2) on meshes of every kind: nodal masses against the mass of the body.
fn masses(meshes: &Meshes) -> Result<Finding> {
    let density = 1000.0;
    let mut words = Vec::new();
    let mut off = Vec::new();
    for (mesh, number, what) in [
        ("square_tri", 0, "triangles"),
        ("tissue_quad", 0, "quadrilaterals"),
        ("cube_tet", 0, "tetrahedra"),
        ("cube_hex", 0, "cubes"),
        ("cube_hex", 1, "distorted hexahedra"),
    ] {
        let specimen = meshes.variant(mesh, number)?;
        let rig = &specimen.rig;
        let sum = |lumping| {
            let masses = mesh_masses(&rig.points, &rig.cells(), density, &rig.section, lumping)?;
            Ok::<f64, sinew_identify::IdentifyError>(masses.iter().sum())
        };
        let part = sum(MassLumping::NodalQuadrature)? / sum(MassLumping::RowSum)? - 1.0;
        words.push(format!("{what} {part:.1e}"));
        off.push(part.abs());
    }
    let shown = off[..4].iter().all(|part| *part < 1e-12) && off[4] > 1e-5;
    Ok(Finding::paper_wrong(
        shown,
        "the nodes of an element with equal weights integrate what is at most linear along each axis exactly; det J of a \
         distorted hexahedron is of second degree there",
    )
    .says(format!("masses by (2) add up to the mass of the body; here they are off by these parts: {}", words.join(", "))))
}

fn findings(meshes: &Meshes, first: &[Row], third: &[Row]) -> Result<Vec<Finding>> {
    let hows = [How::all(&[STRETCH_1]), How::all(&[STRETCH_3])];
    let norms = [(Frobenius, "F-norm"), (TwoNorm, "2-norm")];
    let mut findings = vec![cube(meshes)?];
    for (mesh, what) in [
        (
            &["cylinder_tet", "cylinder_hole_tet", "cube_tet", "cube_hex"][..],
            "cylinders of tetrahedra and cubes",
        ),
        (
            &["cylinder_hex"],
            "cylinder of 675 nodes and 496 hexahedra (62 quadrilaterals in 8 layers)",
        ),
        (
            &["tissue_tri", "tissue_quad"],
            "soft tissue (a rectangle, one that bulges by a fifth; quadrilaterals: thirds of triangles, a grid)",
        ),
    ] {
        for (method, name) in norms {
            let rows = judged(first, |r| mesh.contains(&r.mesh) && r.method == method);
            // table 3 shows that springs of solids are linear in F-norm rows; of plane bodies it says nothing
            let solid = method == Frobenius && !mesh.contains(&"tissue_tri");
            let open = if solid { &hows[0][..2] } else { &hows[0][..] };
            if !rows.is_empty() {
                findings.push(against_print(&format!("table 1, {name}, {what}"), &rows, open));
            }
        }
    }
    findings.extend(better(first).filter(|_| first.len() > 3));
    findings.extend(contradictions(first, third));
    for (method, name) in norms {
        let open = if method == Frobenius { &hows[1][..2] } else { &hows[1][..] };
        let rows = judged(third, |r| r.method == method);
        findings.push(against_print(&format!("table 3, {name}"), &rows, open));
    }
    findings.push(masses(meshes)?);
    Ok(findings)
}

/// Quick: the cube of hexahedra only, for tests.
pub(crate) fn figure(setup: &Setup) -> Result<Figure> {
    let meshes = &setup.meshes;
    let keep = |t: &&Printed| !setup.quick || t.0 == "cube_hex";
    let own: Vec<Printed> = TABLE_1.iter().filter(keep).copied().collect();
    let first = measure(meshes, &own, STRETCH_1)?;
    let wanted: Vec<Printed> = TABLE_3.iter().filter(keep).copied().collect();
    let third = measure(meshes, &wanted, STRETCH_3)?;
    let setting = String::from(
        "E 10 kPa, nu 0.3 (plane stress in the plane); one end held, the other pulled until finite elements \
         are 10 % (table 1) and 30 % (table 3) longer. How the load was brought onto the end is not printed, nor whether \
         springs keep their rest lengths: all are measured.",
    );
    let table = |name, title, rows: &[Row], part| {
        error_table(name, title, ["object", "fit"], rows, &How::all(&[part]))
    };
    let mut one = table("a-table-1", "Table 1: errors in tension at 10 %", &first, STRETCH_1);
    for &(mesh, object, ..) in &own {
        let Some([nodes, elements]) = printed(mesh) else { continue };
        one.notes.push(format!("printed mesh of {object}: {nodes} nodes, {elements} elements"));
    }
    let three = table("a-table-3", "Table 3: the cube at 30 %", &third, STRETCH_3);
    let findings = findings(meshes, &first, &third)?;
    let mut charts = Vec::new();
    for (name, title, prefix) in SHAPES {
        let rows: Vec<_> =
            own.iter().filter(|t| t.0.starts_with(prefix)).map(|t| (t.0, t.1)).collect();
        if !rows.is_empty() {
            charts.push(overlay::chart(meshes, name, title, &rows, STRETCH_1)?);
        }
    }
    Ok(Figure { setting, findings, tables: vec![one, three], charts, ..Figure::default() })
}

#[cfg(test)]
mod tests {
    use super::super::figure::Verdict;
    use super::*;

    #[test]
    fn the_cube_is_the_printed_one_and_wrong_numbers_differ() {
        let figure = figure(&Setup { meshes: Meshes::new(None), quick: true }).unwrap();
        let cube = &figure.findings[0];
        assert!(
            cube.agrees() && cube.text.contains("14.98 / 25.58 with its end clamped"),
            "{cube:?}"
        );
        assert_eq!((figure.tables[0].rows.len(), figure.tables[1].rows.len()), (3, 3));
        let text = figure.tables[0].text();
        assert!(text.contains("14.98 / 25.19") && !text.contains("NaN"), "{text}");
        let wrong = |f: &&Finding| f.verdict == Verdict::PaperWrong;
        assert_eq!(figure.findings.iter().filter(wrong).count(), 3, "{:?}", figure.findings);
        // a proof counts only where the numbers bear it out
        let wanted = [("cube_hex", "cube", [2.91, 6.92], [14.98, 25.19])];
        let meshes = Meshes::new(None);
        let [mut first, third] = [0.1, 0.3].map(|part| measure(&meshes, &wanted, part).unwrap());
        assert!(contradictions(&first, &third).iter().all(|f| wrong(&f)));
        for row in &mut first {
            let linear = row.ours.errors[0].1.as_mut().unwrap();
            linear[1] += 1.0;
        }
        assert!(contradictions(&first, &third).iter().all(|f| f.verdict == Verdict::Differs));
    }
}
