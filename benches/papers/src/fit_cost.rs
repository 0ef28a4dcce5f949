//! Natsupakpong & Cavusoglu 2010, table 2: time to find the constants of one element.

use super::lumped::{MATERIAL, SECTION, printed_name};
use super::prelude::*;
use sinew_benches::toolbox::stats::Spread;
use sinew_identify::ElementMethod::{self, Block, Frobenius, TwoNorm};
use sinew_identify::{ElementGeometry, ElementKind, fit_element};
use sinew_tune::fit::FitError;
use std::hint::black_box;

/// Element, springs, printed seconds of the Frobenius norm and of the 2-norm.
const TABLE_2: [(ElementKind, usize, [f64; 2]); 4] = [
    (ElementKind::Triangle, 3, [0.08, 1.73]),
    (ElementKind::Quad, 6, [0.32, 2.26]),
    (ElementKind::Tetrahedron, 6, [0.32, 2.33]),
    (ElementKind::Hexahedron, 28, [3.04, 29.01]),
];

/// Seconds this project aims at for a hexahedron, Frobenius norm and 2-norm.
const AIMS: [f64; 2] = [1e-3, 20e-3];

/// Ratios of times are alike within this factor, half an order of magnitude: the machines differ.
const SAME_ORDER: f64 = 3.162_277_660_168_379_5;

/// Random elements of each kind, as in the paper.
const ELEMENTS: usize = 100;
/// Largest move of a node along each axis, over the side.
const MOVE: f64 = 0.2;

/// Elements of side 1 cm with every node moved at random.
fn random_elements(kind: ElementKind, count: usize) -> Result<Vec<ElementGeometry>, FitError> {
    let (regular, plane): (Vec<[f64; 3]>, bool) = match kind {
        ElementKind::Triangle => (vec![[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.866, 0.0]], true),
        ElementKind::Quad => {
            (vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]], true)
        }
        ElementKind::Tetrahedron => {
            (vec![[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.866, 0.0], [0.5, 0.289, 0.816]], false)
        }
        ElementKind::Hexahedron => {
            let face = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
            let nodes = (0..8).map(|i| [face[i % 4][0], face[i % 4][1], (i / 4) as f64]);
            (nodes.collect(), false)
        }
    };
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        MOVE * (2.0 * (state >> 11) as f64 / (1u64 << 53) as f64 - 1.0)
    };
    let elements = (0..count).map(|_| {
        let moved: Vec<[f64; 3]> = regular
            .iter()
            .map(|x| {
                [0, 1, 2].map(|d| 0.01 * (x[d] + if plane && d == 2 { 0.0 } else { random() }))
            })
            .collect();
        Ok(ElementGeometry::new(kind, &moved)?)
    });
    elements.collect()
}

/// Seconds of every element, one after the other on one thread; least of three turns, so that what else
/// the machine does counts little.
fn times(elements: &[ElementGeometry], method: ElementMethod) -> Result<Vec<f64>, FitError> {
    let mut least = vec![f64::INFINITY; elements.len()];
    for _ in 0..3 {
        for (element, best) in elements.iter().zip(&mut least) {
            let clock = Instant::now();
            black_box(fit_element(black_box(element), &MATERIAL, &SECTION, method)?);
            *best = best.min(clock.elapsed().as_secs_f64());
        }
    }
    Ok(least)
}

struct Row {
    kind: ElementKind,
    springs: usize,
    method: ElementMethod,
    printed: Option<f64>,
    mean: f64,
    spread: Spread,
}

fn measure(count: usize) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for (kind, springs, [frobenius, two]) in TABLE_2 {
        let elements = random_elements(kind, count)?;
        for (method, printed) in [(Frobenius, Some(frobenius)), (TwoNorm, Some(two)), (Block, None)]
        {
            let times = times(&elements, method)?;
            let mean = times.iter().sum::<f64>() / times.len() as f64;
            let Some(spread) = Spread::of(&times) else { continue };
            rows.push(Row { kind, springs, method, printed, mean, spread });
        }
    }
    Ok(rows)
}

fn findings(rows: &[Row]) -> Vec<Finding> {
    let of = |kind, method| {
        let row = rows.iter().find(|r| r.kind == kind && r.method == method);
        row.map_or([f64::NAN; 2], |r| [r.mean, r.printed.unwrap_or(f64::NAN)])
    };
    // ratios here and printed
    let compare = |a: [f64; 2], b: [f64; 2]| [a[0] / b[0], a[1] / b[1]];
    let alike = |[own, printed]: [f64; 2]| (own / printed).ln().abs() <= SAME_ORDER.ln();
    let named = |kind: ElementKind, [own, printed]: [f64; 2]| {
        (format!("{kind} {own:.1} here, {printed:.1} printed"), alike([own, printed]))
    };
    let list = |table: &str, ratios: Vec<(String, bool)>| {
        let all: Vec<&str> = ratios.iter().map(|r| r.0.as_str()).collect();
        Finding::of_times(ratios.iter().all(|r| r.1)).says(format!(
            "{table}: {} ({SAME_ORDER:.1} times more or less is allowed)",
            all.join(", ")
        ))
    };
    let norms = TABLE_2.map(|t| named(t.0, compare(of(t.0, TwoNorm), of(t.0, Frobenius))));
    let mut findings =
        vec![list("table 2, times of the 2-norm over those of the F-norm", norms.into())];
    for method in [Frobenius, TwoNorm] {
        let triangle = of(ElementKind::Triangle, method);
        let kinds = TABLE_2[1..].iter().map(|t| named(t.0, compare(of(t.0, method), triangle)));
        let name = printed_name(method);
        findings.push(list(
            &format!("table 2, times of the {name} over that of a triangle"),
            kinds.collect(),
        ));
    }
    for (method, aim) in [(Frobenius, AIMS[0]), (TwoNorm, AIMS[1])] {
        let [mean, printed] = of(ElementKind::Hexahedron, method);
        findings.push(Finding::of_times(mean < aim).says(format!(
            "this project's own aim: a hexahedron takes {:.3} ms with the {} (aim {} ms; {printed} s printed)",
            1e3 * mean,
            printed_name(method),
            1e3 * aim,
        )));
    }
    findings
}

/// `quick`: few elements, for tests.
pub(crate) fn figure(quick: bool) -> Result<Figure> {
    let count = if quick { 3 } else { ELEMENTS };
    let rows = measure(count)?;
    let title = "Table 2: time for the constants of one element";
    let table = table_of!("b-table-2", title; for r in &rows;
        "element" => r.kind.to_string(), "springs" => r.springs, "fit" => printed_name(r.method),
        "printed s" => r.printed, "mean ms" => 1e3 * r.mean, "median ms" => 1e3 * r.spread.median,
        "slowest quarter ms" => 1e3 * r.spread.upper_quartile,
        "times faster" => r.printed.map(|p| p / r.mean),
    );
    Ok(Figure {
        setting: format!(
            "{count} random elements of each kind (regular ones of 1 cm, every node moved by up to {MOVE} of the \
             side along each axis), one thread, stiffness matrix included; the least of three turns counts. The \
             paper's machine is some fifteen years older, so the factors are no measure of the \
             method."
        ),
        findings: findings(&rows),
        tables: vec![table],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_elements_can_all_be_fitted() {
        for (kind, springs, _) in TABLE_2 {
            let elements = random_elements(kind, ELEMENTS).unwrap();
            let fit = fit_element(&elements[7], &MATERIAL, &SECTION, Frobenius).unwrap();
            assert_eq!((elements.len(), fit.constants.len()), (ELEMENTS, springs));
            assert_ne!(elements[0].measure(), elements[1].measure());
        }
        let mut rows = measure(2).unwrap();
        assert_eq!(rows.len(), 12);
        // the printed times agree but for the aims; equal ones do not, and each ratio is looked at
        rows.iter_mut().for_each(|r| r.mean = r.printed.unwrap_or(r.mean));
        let verdicts = |rows: &[Row]| findings(rows).iter().map(|f| f.agrees()).collect::<Vec<_>>();
        assert_eq!(verdicts(&rows), [true, true, true, false, false]);
        rows.iter_mut().for_each(|r| r.mean = 1e-4);
        assert_eq!(verdicts(&rows), [false, false, false, true, true]);
    }
}
