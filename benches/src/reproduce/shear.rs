//! Natsupakpong & Cavusoglu 2010, table 6: squares and cubes in shear.

use super::Means;
use super::lumped::{Meshes, Ours, Row, error_table, printed_name, rows_alike};
use crate::bench::error::BenchError;
use crate::report::{Figure, Finding};
use sinew_identify::ElementMethod::{self, Baudet, Frobenius, Lloyd, TwoNorm, VanGelder};

/// Mesh, element, method, printed errors (rms, max).
const TABLE_6: [(&str, &str, ElementMethod, [f64; 2]); 10] = [
    ("square_tri", "tri", VanGelder, [17.25, 34.17]),
    ("square_tri", "tri", Lloyd, [5.04, 10.73]),
    ("square_tri", "tri", TwoNorm, [3.68, 8.60]),
    ("square_quad", "quad", Baudet, [3.60, 8.28]),
    ("square_quad", "quad", Lloyd, [3.64, 8.85]),
    ("square_quad", "quad", TwoNorm, [3.82, 11.28]),
    ("cube_tet", "tet", Lloyd, [5.68, 15.16]),
    ("cube_tet", "tet", Frobenius, [5.30, 14.55]),
    ("cube_hex", "hex", Baudet, [3.86, 9.36]),
    ("cube_hex", "hex", TwoNorm, [3.96, 9.37]),
];

/// Displacement over height.
const SHEAR: f64 = 0.1;

fn measure(meshes: &Meshes, quick: bool) -> Result<Vec<Row>, BenchError> {
    let mut rows = Vec::new();
    for (mesh, element, method, printed) in TABLE_6 {
        if quick && !mesh.starts_with("square") {
            continue;
        }
        let Some(specimen) = meshes.get(mesh)? else { continue };
        let ours = Ours::measure(&specimen, method, specimen.rig.across(), SHEAR)?;
        let (printed, counts) = (Some(printed), specimen.counts);
        rows.push(Row { mesh, what: element, method, printed, counts, ours });
    }
    Ok(rows)
}

fn findings(rows: &[Row]) -> Vec<Finding> {
    let named = rows.iter().filter_map(|r| {
        let printed = r.printed?;
        let ours = r.ours.nearer(printed).map_or(f64::NAN, |e| e.rms_percent);
        let method = printed_name(r.method);
        let name = format!("{} {method} ({ours:.2} here, {:.2} printed)", r.what, printed[0]);
        Some((name, r.ours.alike(printed)))
    });
    let mut findings =
        vec![rows_alike("table 6", named, "are within a factor 1.5 of the printed e_rms")];
    let of = |method| {
        let row = rows.iter().find(|r| r.what == "tri" && r.method == method);
        row.and_then(|r| r.ours.traction).map(|e| e.rms_percent)
    };
    if let (Some(gelder), Some(lloyd), Some(two)) = (of(VanGelder), of(Lloyd), of(TwoNorm)) {
        findings.push(Finding::of(gelder > lloyd && gelder > two).says(format!(
                "Van Gelder's triangles are the worst in shear: {gelder:.2} % here (17.25 printed), Lloyd {lloyd:.2} \
                 (5.04), 2-norm {two:.2} (3.68)"
            )));
    }
    findings
}

/// Quick: the squares only, for tests.
pub(super) fn figure(means: &Means) -> Result<Figure, BenchError> {
    let rows = measure(&means.meshes, means.quick)?;
    let title = "Table 6: errors in shear";
    Ok(Figure {
        setting: format!(
            "Side 2 cm, one side held, the opposite one pushed along itself and free to tilt, until finite \
             elements move by 10 % of the side. {}. The paper mentions torsion without a table; `sinew fit` \
             has that test.",
            means.meshes.source()
        ),
        findings: findings(&rows),
        tables: vec![error_table("e-table-6", title, ["element", "method"], &rows)],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_in_shear() {
        let mut rows = measure(&Meshes::new(None), true).unwrap();
        assert_eq!(rows.len(), 6);
        // the square of 100 quadrilaterals is the printed mesh: its 2-norm row comes out, Baudet's does not
        let of = |method| {
            rows.iter().find(|r| r.what == "quad" && r.method == method).map(|r| r.ours).unwrap()
        };
        assert!(of(TwoNorm).alike([3.82, 11.28]), "{:?}", of(TwoNorm));
        assert!((of(Baudet).traction.unwrap().rms_percent - 0.17).abs() < 0.005);
        assert!(!of(Baudet).alike([3.60, 8.28]));
        assert!(findings(&rows).iter().all(|f| !f.text.contains("NaN")));
        for r in &mut rows {
            r.ours.traction.as_mut().unwrap().rms_percent *= 10.0;
            r.ours.equal = None;
        }
        assert!(!findings(&rows)[0].agrees);
    }
}
