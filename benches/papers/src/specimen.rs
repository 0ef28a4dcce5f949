//! Natsupakpong & Cavusoglu 2010, tables 4 and 5: the tensile specimen measured as in a testing machine,
//! and the errors of several methods in tension.

use super::Setup;
use super::lumped::{
    How, MATERIAL, Meshes, Ours, Row, Specimen, Springs, VAN_GELDER, against_print, answers,
    error_table, judged, printed_name, ranking,
};
use super::overlay;
use super::prelude::*;
use super::shapes::WIDTH;
use sinew_identify::ElementMethod::{self, Baudet, Frobenius, Lloyd, TwoNorm, VanGelder};
use sinew_identify::mesh::FittedSprings;
use sinew_identify::virtual_test::gauge::{MeasuredModuli, tensile_moduli};
use sinew_tune::fit::rig::Reading;

/// Elongations; the paper says at least 10 %.
const STRETCH: f64 = 0.1;
const STRETCHES: [f64; 3] = [STRETCH, 0.15, 0.2];

/// Printed moduli: mesh, element, 2-norm (Pa, ratio), Frobenius norm; and how many meshes of about the printed counts are
/// measured, since few nodes lie in the straight part.
const TABLE_4: [(&str, &str, [f64; 2], [f64; 2], u64); 4] = [
    ("dogbone_tri", "tri", [10300.70, 0.25], [9461.44, 0.26], 5),
    ("dogbone_quad", "quad", [11169.70, 0.45], [9839.55, 0.43], 5),
    ("dogbone_tet", "tet", [12165.80, 0.09], [9697.49, 0.09], 3),
    ("dogbone_hex", "hex", [9804.64, 0.29], [10228.00, 0.29], 3),
];

/// Printed moduli and errors: mesh, element, method, (Pa, ratio), (rms, max).
const TABLE_5: [(&str, &str, ElementMethod, [f64; 2], [f64; 2]); 10] = [
    ("dogbone_tri", "tri", VanGelder, [15010.80, 0.27], [20.08, 34.58]),
    ("dogbone_tri", "tri", Lloyd, [10855.80, 0.29], [5.61, 10.88]),
    ("dogbone_tri", "tri", TwoNorm, [10300.70, 0.25], [3.02, 5.65]),
    ("square_quad", "quad (square)", Baudet, [10330.50, 0.34], [1.06, 2.07]),
    ("dogbone_quad", "quad", Lloyd, [13097.10, 0.44], [4.84, 8.20]),
    ("dogbone_quad", "quad", TwoNorm, [11169.70, 0.45], [3.36, 5.50]),
    ("dogbone_tet", "tet", Lloyd, [8671.48, 0.03], [7.75, 14.65]),
    ("dogbone_tet", "tet", Frobenius, [9697.49, 0.09], [9.37, 15.72]),
    ("cube_hex", "hex (cube)", Baudet, [10712.50, 0.12], [3.67, 6.99]),
    ("cube_hex", "hex (cube)", TwoNorm, [10242.00, 0.14], [2.88, 6.05]),
];

/// How far a measured modulus (relative) and ratio may be from the printed ones.
const SAME: [f64; 2] = [0.1, 0.05];

/// Springs that tables 4 and 5 may have been measured with.
const LAWS: [Springs; 2] = [Springs::Linear, Springs::RestLengths(STRETCH)];

/// Moduli from the strain in the straight part of a specimen, or in the middle half of another body, under consistent
/// traction: of finite elements and of springs, where they have an answer.
fn measured(
    specimen: &Specimen,
    springs: &FittedSprings,
    law: Springs,
) -> Result<(Option<MeasuredModuli>, Option<MeasuredModuli>)> {
    let rig = &specimen.rig;
    let (loading, fem) = specimen.loaded(rig.axis, Reading::Traction, STRETCH)?;
    let force: f64 = loading.forces.iter().map(|(_, f)| f[rig.axis]).sum::<f64>().abs();
    let bone = rig.length().abs() > 10.0 * WIDTH;
    let middle = rig.points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |m, p| {
        [m[0].min(p[rig.axis]), m[1].max(p[rig.axis])]
    });
    let middle = 0.5 * (middle[0] + middle[1]);
    let (gauge, section) = if bone {
        let within = |n: &usize| (rig.points[*n][rig.axis] - middle).abs() <= WIDTH * 1.000_001;
        let thickness = if rig.dimension == 2 { rig.section.thickness } else { WIDTH };
        ((0..rig.points.len()).filter(within).collect(), WIDTH * thickness)
    } else {
        (rig.gauge(), rig.area())
    };
    let moduli = |u: &[[f64; 3]]| {
        let stress = force / section;
        tensile_moduli(&rig.points, u, &gauge, rig.dimension, rig.axis, stress)
    };
    let how = How { springs: law, load: Reading::Traction };
    let own = answers(specimen, springs, rig.axis, &[how])?.remove(0);
    Ok((moduli(&fem), own.and_then(|own| moduli(&own.displacements))))
}

fn moduli(m: Option<MeasuredModuli>) -> Cell {
    m.map(|m| format!("{:.0}, {:.2}", m.youngs_modulus, m.poissons_ratio)).into()
}

fn printed_moduli([e, nu]: [f64; 2]) -> Cell {
    format!("{e:.0}, {nu:.2}").into()
}

/// Which of the two moduli.
#[derive(Clone, Copy, PartialEq)]
enum Which {
    Young,
    Poisson,
}

impl Which {
    fn of(self, m: &MeasuredModuli) -> f64 {
        if self == Self::Young { m.youngs_modulus } else { m.poissons_ratio }
    }

    /// Whether a measured value is the printed one.
    fn same(self, value: f64, [e, nu]: [f64; 2]) -> bool {
        match self {
            Self::Young => (value / e - 1.0).abs() < SAME[0],
            Self::Poisson => (value - nu).abs() < SAME[1],
        }
    }
}

/// A row of table 4: moduli on every mesh, by the laws of [`LAWS`].
struct Fourth {
    element: &'static str,
    method: ElementMethod,
    printed: [f64; 2],
    found: [Vec<MeasuredModuli>; 2],
    /// Meshes on which springs have no answer, by law.
    lost: [usize; 2],
    fem: Vec<MeasuredModuli>,
    negative: usize,
    counts: [usize; 2],
}

impl Fourth {
    fn values(&self, law: usize, which: Which) -> impl Iterator<Item = f64> + Clone {
        self.found[law].iter().map(move |m| which.of(m))
    }

    /// Smallest and largest over the meshes.
    fn range(&self, law: usize, which: Which) -> String {
        let least = self.values(law, which).fold(f64::INFINITY, f64::min);
        let most = self.values(law, which).fold(f64::NEG_INFINITY, f64::max);
        match which {
            _ if self.found[law].is_empty() => "no equilibrium".to_string(),
            Which::Young => format!("{least:.0} to {most:.0}"),
            Which::Poisson => format!("{least:.2} to {most:.2}"),
        }
    }
}

fn fourth(meshes: &Meshes, keep: &dyn Fn(&str) -> bool) -> Result<Vec<Fourth>> {
    let mut rows = Vec::new();
    for (mesh, element, two, frobenius, count) in TABLE_4.into_iter().filter(|t| keep(t.0)) {
        for (method, printed) in [(TwoNorm, two), (Frobenius, frobenius)] {
            let counts = meshes.get(mesh)?.counts;
            let mut row = Fourth {
                element,
                method,
                printed,
                found: Default::default(),
                lost: [0; 2],
                fem: Vec::new(),
                negative: 0,
                counts,
            };
            for number in 0..count {
                let specimen = meshes.variant(mesh, number)?;
                let springs = specimen.springs(method)?;
                row.negative = row.negative.max(springs.report.negative_edges);
                for (k, law) in LAWS.into_iter().enumerate() {
                    let (fem, own) = measured(&specimen, &springs, law)?;
                    match own {
                        Some(own) => row.found[k].push(own),
                        None => row.lost[k] += 1,
                    }
                    row.fem.extend(fem.filter(|_| k == 0));
                }
            }
            rows.push(row);
        }
    }
    Ok(rows)
}

/// Errors of table 5 as printed, and the moduli of the same bodies.
struct Fifth {
    row: Row,
    printed: [f64; 2],
    /// By the laws of [`LAWS`].
    moduli: [Option<MeasuredModuli>; 2],
}

fn fifth(meshes: &Meshes, keep: &dyn Fn(&str) -> bool) -> Result<Vec<Fifth>> {
    let hows = How::all(&STRETCHES);
    let mut rows = Vec::new();
    for (mesh, element, method, out, errors) in TABLE_5.into_iter().filter(|t| keep(t.0)) {
        // squares and cubes have one mesh, specimens those of table 4
        let count = TABLE_4.iter().find(|t| t.0 == mesh).map_or(1, |t| t.4);
        for number in 0..count {
            let specimen = meshes.variant(mesh, number)?;
            let springs = specimen.springs_of_print(method)?;
            let ours = Ours::measure(&specimen, &springs, specimen.rig.axis, &hows)?;
            let (printed, counts) = (Some(errors), specimen.counts);
            let [linear, rest] = LAWS.map(|law| measured(&specimen, &springs, law));
            rows.push(Fifth {
                row: Row { mesh, number, what: element, method, printed, counts, ours },
                printed: out,
                moduli: [linear?.1, rest?.1],
            });
        }
    }
    Ok(rows)
}

/// What is said of some rows of table 4, of each of `met`'s cases of one law: whether it holds on one mesh at least, and
/// on all of them. The law is one for all rows.
fn on_meshes(met: [Vec<[bool; 2]>; 2]) -> Finding {
    let all = |law: &Vec<[bool; 2]>, k: usize| law.iter().all(|m| m[k]);
    if met.iter().all(|law| all(law, 1)) {
        return Finding::of(true);
    }
    let count = |law: &Vec<[bool; 2]>| {
        let of = |k: usize| law.iter().filter(|m| m[k]).count();
        format!("{} on some mesh, {} on all meshes, of {}", of(0), of(1), law.len())
    };
    let choices = format!(
        "meshes of nearly the same counts; linear springs: {}; with rest lengths: {}",
        count(&met[0]),
        count(&met[1])
    );
    Finding::not_determined(met.iter().any(|law| all(law, 0)), choices)
}

/// Rows of table 4 against the print.
fn moduli_of_print(rows: &[&Fourth], which: Which, what: &str) -> Finding {
    let met = [0, 1].map(|law| {
        let one = |r: &&Fourth| {
            let same = r.values(law, which).map(|v| which.same(v, r.printed));
            [same.clone().any(|s| s), r.lost[law] == 0 && same.clone().all(|s| s)]
        };
        rows.iter().map(one).collect()
    });
    let each = |r: &&Fourth| {
        let printed = match which {
            Which::Young => format!("{:.0}", r.printed[0]),
            Which::Poisson => format!("{:.2}", r.printed[1]),
        };
        format!(
            "{} {} {} (rest lengths {}; {printed} printed)",
            r.element,
            printed_name(r.method),
            r.range(0, which),
            r.range(1, which)
        )
    };
    let list: Vec<String> = rows.iter().map(each).collect();
    on_meshes(met).says(format!("{what}: {}", list.join(", ")))
}

/// The paper's claim about table 4.
fn near_what_was_asked(four: &[Fourth]) -> Finding {
    let asked = MATERIAL.youngs_modulus;
    let met = [0, 1].map(|law| {
        let one = |r: &Fourth| {
            let near_wanted = r.method == Frobenius || r.element == "tri" || r.element == "hex";
            let near = r.values(law, Which::Young).map(|e| (e / asked - 1.0).abs() <= SAME[0]);
            let right = near.map(|near| near == near_wanted);
            [right.clone().any(|r| r), r.lost[law] == 0 && right.clone().all(|r| r)]
        };
        four.iter().map(one).collect()
    });
    let each = |r: &Fourth| {
        format!("{} {} {}", r.element, printed_name(r.method), r.range(0, Which::Young))
    };
    let list: Vec<String> = four.iter().map(each).collect();
    on_meshes(met).says(format!(
        "table 4: the modulus is close to the 10 kPa asked in triangles and hexahedra with both norms, in quadrilaterals \
         and tetrahedra with the F-norm, and off by more than 10 % in these with the 2-norm (linear: {})",
        list.join(", ")
    ))
}

/// The three numbers that are printed for Van Gelder's triangles: modulus and e_max of table 5, e_max of table 6.
const GELDER: [f64; 3] = [15010.80, 34.58, 34.17];

/// Van Gelder's triangles with the constants as recalled, and as they must have been.
fn van_gelder(meshes: &Meshes) -> Result<Finding> {
    let rest = |part| How { springs: Springs::RestLengths(part), load: Reading::Traction };
    let (bone, square) = (meshes.get("dogbone_tri")?, meshes.get("square_tri")?);
    let numbers = |factor: f64| -> Result<[Option<f64>; 3]> {
        let scaled = |specimen: &Specimen| -> Result<FittedSprings> {
            let mut springs = specimen.springs(VanGelder)?;
            springs.constants.iter_mut().for_each(|k| *k *= factor);
            Ok(springs)
        };
        let springs = scaled(&bone)?;
        let tension = Ours::measure(&bone, &springs, bone.rig.axis, &[rest(STRETCH)])?;
        let modulus = measured(&bone, &springs, LAWS[1])?.1.map(|m| m.youngs_modulus);
        let shear =
            Ours::measure(&square, &scaled(&square)?, square.rig.across(), &[rest(STRETCH)])?;
        let most = |ours: &Ours| ours.of(rest(STRETCH)).map(|e| e[1]);
        Ok([modulus, most(&tension), most(&shear)])
    };
    let [recalled, larger] = [numbers(1.0)?, numbers(VAN_GELDER)?];
    let near = |own: &[Option<f64>; 3]| {
        own.iter()
            .zip(GELDER)
            .all(|(own, p)| own.is_some_and(|own| (own / p - 1.0).abs() < SAME[0]))
    };
    let words = |own: [Option<f64>; 3]| {
        let [a, b, c] = own.map(|x| x.unwrap_or(f64::NAN));
        format!("{a:.0} Pa, {b:.2} and {c:.2}")
    };
    let finding = if near(&recalled) {
        Finding::of(true)
    } else {
        Finding::not_determined(
            near(&larger),
            format!(
                "the factor before A / L^2: with E A / L^2, as recalled, {}; with 3/2 of it all three within {} %: {}. \
                 E A / L^2 is exact on equilateral triangles at nu 1/3, so what was compared is not Van Gelder's formula \
                 as it is known",
                words(recalled),
                100.0 * SAME[0],
                words(larger)
            ),
        )
    };
    Ok(finding.says(
        "Van Gelder's triangles: modulus 15011 Pa and e_max 34.58 % in tension (table 5), e_max 34.17 % in shear (table 6)",
    ))
}

fn findings(meshes: &Meshes, four: &[Fourth], five: &[Fifth]) -> Result<Vec<Finding>> {
    let by = |method| four.iter().filter(|r| r.method == method).collect::<Vec<_>>();
    let mut findings = vec![
        moduli_of_print(&by(Frobenius), Which::Young, "table 4, modulus (Pa) by the F-norm"),
        moduli_of_print(&by(TwoNorm), Which::Young, "table 4, modulus (Pa) by the 2-norm"),
        moduli_of_print(
            &four.iter().collect::<Vec<_>>(),
            Which::Poisson,
            "table 4, Poisson's ratio",
        ),
    ];
    let rows: Vec<Row> = five.iter().map(|f| f.row.clone()).collect();
    let hows = How::all(&STRETCHES);
    if four.len() == 2 * TABLE_4.len() {
        findings.push(near_what_was_asked(four));
    }
    let own = judged(&rows, |r| matches!(r.method, Frobenius | TwoNorm));
    let others = judged(&rows, |r| !matches!(r.method, Frobenius | TwoNorm));
    findings.push(against_print("table 5, F-norm and 2-norm", &own, &hows));
    findings.push(against_print("table 5, other methods (Van Gelder's times 3/2)", &others, &hows));
    if four.len() == 2 * TABLE_4.len() {
        findings.push(ranking(
            "table 5: the paper's fit is best but in quadrilaterals, where it is second, and in tetrahedra",
            &rows,
            &hows,
            &[
                ("tri", |e| e("tri", TwoNorm) < e("tri", Lloyd).min(e("tri", VanGelder))),
                ("quad", |e| {
                    let own = e("quad", TwoNorm);
                    e("quad (square)", Baudet) < own && own < e("quad", Lloyd)
                }),
                ("tet", |e| e("tet", Lloyd) < e("tet", Frobenius)),
                ("hex", |e| e("hex (cube)", TwoNorm) < e("hex (cube)", Baudet)),
            ],
        ));
    }
    findings.push(van_gelder(meshes)?);
    Ok(findings)
}

/// Quick: triangles only, for tests.
pub(crate) fn figure(setup: &Setup) -> Result<Figure> {
    let keep = |mesh: &str| !setup.quick || mesh.ends_with("tri");
    let four = fourth(&setup.meshes, &keep)?;
    let five = fifth(&setup.meshes, &keep)?;
    let title =
        "Table 4: moduli of the specimen (Pa, ratio), smallest to largest over several meshes";
    let table_4 = table_of!("c-table-4", title; for r in &four;
        "element" => r.element, "fit" => printed_name(r.method), "printed" => printed_moduli(r.printed),
        "linear: E" => r.range(0, Which::Young), "nu" => r.range(0, Which::Poisson),
        "rest lengths: E" => r.range(1, Which::Young), "nu" => r.range(1, Which::Poisson),
        "finite elements" => moduli(r.fem.first().copied()), "meshes" => r.fem.len(),
        "negative" => r.negative, "nodes" => r.counts[0], "elements" => r.counts[1],
    )
    .note(
        "strain: least squares over the nodes of the straight part; rest lengths at 10 %; printed meshes: 125/192, \
         329/266, 538/1500, 1396/843",
    );
    let title = "Table 5: moduli, against other methods";
    let moduli_5 = table_of!("c-table-5-moduli", title; for r in five.iter().filter(|r| r.row.number == 0);
        "element" => r.row.what, "method" => printed_name(r.row.method),
        "printed" => printed_moduli(r.printed), "linear" => moduli(r.moduli[0]),
        "rest lengths" => moduli(r.moduli[1]),
    );
    let first = five.iter().filter(|f| f.row.number == 0);
    let rows: Vec<Row> = first.map(|f| f.row.clone()).collect();
    let title = "Table 5: errors in tension, against other methods";
    let table_5 =
        error_table("c-table-5", title, ["element", "method"], &rows, &How::all(&STRETCHES)).note(
            "the first mesh of each element; Van Gelder's constants are 3/2 of the recalled ones; Baudet's formula needs rectangles, \
             which the specimen of quadrilaterals does not have, so his quadrilaterals are measured on the square; the formulas of Van Gelder, \
             Lloyd and Baudet are recalled, their original texts were not read",
        );
    let shapes: Vec<_> = TABLE_4.iter().filter(|t| keep(t.0)).map(|t| (t.0, t.1)).collect();
    let title = "The tensile specimen";
    let chart = overlay::chart(&setup.meshes, "c-shapes", title, &shapes, STRETCH)?;
    Ok(Figure {
        setting: "Straight part of 1 x 2 cm (1 cm thick in space), grips of 3 cm, 16 cm long; one end held, the other \
                  loaded; moduli under a consistent traction. Whether springs keep their rest lengths is not printed."
            .into(),
        findings: findings(&setup.meshes, &four, &five)?,
        tables: vec![table_4, table_5, moduli_5],
        charts: vec![chart],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::super::figure::Verdict;
    use super::*;

    #[test]
    fn the_specimen_of_triangles() {
        let figure = figure(&Setup { meshes: Meshes::new(None), quick: true }).unwrap();
        let [four, five, moduli] = &figure.tables[..] else { panic!("three tables") };
        assert_eq!((four.rows.len(), five.rows.len(), moduli.rows.len()), (2, 3, 3));
        // the machine is sound: finite elements measure the modulus that went in
        let four = fourth(&Meshes::new(None), &|mesh| mesh.ends_with("tri")).unwrap();
        let fem = four.iter().flat_map(|r| &r.fem);
        assert!(fem.clone().count() == 10);
        for m in fem {
            assert!((m.youngs_modulus / MATERIAL.youngs_modulus - 1.0).abs() < 0.05, "{m:?}");
        }
        let stiff = figure.findings.iter().find(|f| f.text.contains("Van Gelder's tri")).unwrap();
        assert_eq!(stiff.verdict, Verdict::NotDetermined, "{stiff:?}");
        assert!(figure.findings.iter().all(|f| !f.text.contains("NaN")));
        // other numbers are not the printed ones
        assert!(
            Which::Young.same(9461.0, [9461.44, 0.26]) && !Which::Young.same(9461.0, [12e3, 0.26])
        );
        assert!(Which::Poisson.same(0.3, [1.0, 0.26]) && !Which::Poisson.same(0.32, [1.0, 0.26]));
    }

    /// A statement agrees only where neither mesh nor law matters.
    #[test]
    fn meshes_and_laws_are_choices() {
        let [yes, some, no] = [[true, true], [true, false], [false, false]];
        let verdict =
            |a: [[bool; 2]; 2], b: [[bool; 2]; 2]| on_meshes([a.to_vec(), b.to_vec()]).verdict;
        assert_eq!(verdict([yes, yes], [yes, yes]), Verdict::Agrees);
        assert_eq!(verdict([no, yes], [some, yes]), Verdict::NotDetermined);
        assert_eq!(verdict([no, yes], [yes, no]), Verdict::Differs);
    }
}
