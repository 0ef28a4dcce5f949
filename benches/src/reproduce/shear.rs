//! Natsupakpong & Cavusoglu 2010, table 6: squares and cubes in shear.

use super::lumped::{Meshes, Ours, error_row, error_table, printed_name, rows_alike};
use super::{Figure, Finding};
use crate::bench::error::BenchError;
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

struct Row {
    element: &'static str,
    method: ElementMethod,
    printed: [f64; 2],
    counts: [usize; 2],
    ours: Ours,
}

fn measure(meshes: &Meshes, quick: bool) -> Result<Vec<Row>, BenchError> {
    let mut rows = Vec::new();
    for (mesh, element, method, printed) in TABLE_6 {
        if quick && !mesh.starts_with("square") {
            continue;
        }
        let Some(specimen) = meshes.get(mesh)? else { continue };
        let ours = Ours::measure(&specimen, method, specimen.rig.across(), SHEAR)?;
        rows.push(Row { element, method, printed, counts: specimen.counts, ours });
    }
    Ok(rows)
}

fn findings(rows: &[Row]) -> Vec<Finding> {
    let named = rows.iter().map(|r| {
        let ours = r.ours.nearer(r.printed).map_or(f64::NAN, |e| e.rms_percent);
        let name = format!(
            "{} {} ({ours:.2} here, {:.2} printed)",
            r.element,
            printed_name(r.method),
            r.printed[0]
        );
        (name, r.ours.alike(r.printed))
    });
    let mut findings =
        vec![rows_alike("table 6", named, "are within a factor 1.5 of the printed e_rms")];
    let of = |method| {
        let row = rows.iter().find(|r| r.element == "tri" && r.method == method);
        row.and_then(|r| r.ours.traction).map(|e| e.rms_percent)
    };
    if let (Some(gelder), Some(lloyd), Some(two)) = (of(VanGelder), of(Lloyd), of(TwoNorm)) {
        findings.push(Finding {
            agrees: gelder > lloyd && gelder > two,
            text: format!(
                "Van Gelder's triangles are the worst in shear: {gelder:.2} % here (17.25 printed), Lloyd {lloyd:.2} \
                 (5.04), 2-norm {two:.2} (3.68)"
            ),
        });
    }
    findings
}

/// `quick`: the squares only, for tests.
pub(super) fn figure(meshes: &Meshes, quick: bool) -> Result<Figure, BenchError> {
    let rows = measure(meshes, quick)?;
    let title = "Table 6: errors in shear";
    let mut table = error_table("e-table-6", title, ["element", "method"]);
    for r in &rows {
        table.row(error_row(r.element, r.method, Some(r.printed), &r.ours, r.counts));
    }
    Ok(Figure {
        letter: 'e',
        title: "Squares and cubes in shear (table 6)",
        setting: format!(
            "Side 2 cm, one side held, the opposite one pushed along itself and free to tilt, until finite \
             elements move by 10 % of the side. {}. The paper mentions torsion without a table; `sinew fit` \
             has that test.",
            meshes.source()
        ),
        findings: findings(&rows),
        tables: vec![table],
        numbers: Vec::new(),
        charts: Vec::new(),
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
            rows.iter().find(|r| r.element == "quad" && r.method == method).map(|r| r.ours).unwrap()
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
