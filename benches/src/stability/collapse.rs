//! Group 3: free cubes that start flat, folded, mirrored, collapsed or at random.

use super::prelude::*;
use sinew::engine::isoparametric::MIDDLES;

const ORDERED: CasePart = CasePart {
    group: 3,
    name: "flat, line, mirror, fold, push",
    criterion: "edge error < 1 %, none inverted",
};
const DISORDERED: CasePart = CasePart {
    group: 3,
    name: "point and random starts",
    criterion: "edge error < 1 %, none inverted; without recovery H / H(0) < 5 %, at most 2 % inverted",
};
const EQUAL: CasePart = CasePart {
    group: 3,
    name: "all vertices equal",
    criterion: "edge error < 1 %, none inverted; without recovery moves or reports all elements as inverted",
};
/// Cell size of the cubes (m); how fast a crushed cube springs back, in steps, depends on it.
const CELL: f64 = 0.02;
const STEPS: u64 = 180;

pub(super) fn cases() -> Result<Cases, MeshError> {
    let mut cases = Cases::default();
    for cells in [3, 5] {
        let size = cells as f64 * CELL;
        let mesh = Arc::new(jitter_interior(&box_tets(DVec3::splat(size), [cells; 3])?, 0.15, 3)?);
        for (part, name, start) in starts(&mesh.points, size) {
            let start = Arc::new(start);
            let first_seed = name.ends_with('0') || part != DISORDERED;
            for nu in [0.3, 0.45] {
                for dt in [1.0 / 60.0, 0.1] {
                    let start = Arc::clone(&start);
                    let name = format!("{name} {cells}^3 nu {nu} h {dt:.4}");
                    let quick = cells == 3 && dt < 0.1 && first_seed;
                    let run =
                        move |s: &CaseSetting, mesh: &Mesh| recover(s, part, mesh, &start, nu, dt);
                    cases.add(part, name, quick, &mesh, run);
                }
            }
        }
    }
    Ok(cases)
}

/// The starts: part, name, positions (m).
fn starts(x: &[DVec3], size: f64) -> Vec<(CasePart, String, Vec<DVec3>)> {
    let centre = DVec3::splat(size / 2.0);
    let map = |f: &dyn Fn(DVec3) -> DVec3| -> Vec<DVec3> { x.iter().map(|&x| f(x)).collect() };
    let moved = |from: DVec3, to: DVec3| {
        let mut y = x.to_vec();
        y[nearest(x, from)] = to;
        y
    };
    let mirrored = |x: DVec3| DVec3::new(x.x, x.y, size - x.z);
    let ordered = [
        ("plane", map(&|x| DVec3::new(x.x, x.y, centre.z))),
        ("line", map(&|x| DVec3::new(x.x, centre.y, centre.z))),
        ("mirror", map(&mirrored)),
        ("folded", map(&|x| if x.z > centre.z { mirrored(x) } else { x })),
        ("pushed through", moved(DVec3::splat(size), DVec3::splat(-0.3 * size))),
        ("pushed out", moved(centre, DVec3::new(1.5 * size, centre.y, centre.z))),
    ];
    let mut starts: Vec<(CasePart, String, Vec<DVec3>)> =
        ordered.into_iter().map(|(name, y)| (ORDERED, name.to_string(), y)).collect();
    for seed in 0..4 {
        let half = DVec3::splat(0.5);
        let mut random = CaseRandom(0x1234_5678_9abc_def1 + seed);
        let point = x.iter().map(|_| centre + (random.vector() - half) * 1e-6 * size).collect();
        let mut random = CaseRandom(0x2345_6789_abcd_ef12 + seed);
        let scattered = x.iter().map(|_| random.vector() * size).collect();
        let mut random = CaseRandom(0x3456_789a_bcde_f123 + seed);
        let wide = x.iter().map(|_| centre + (random.vector() - half) * 3.0 * size).collect();
        let with = |name: &str, y| (DISORDERED, format!("{name} {seed}"), y);
        starts.extend([with("point", point), with("random", scattered), with("random 3x", wide)]);
    }
    starts.push((EQUAL, "equal".into(), map(&|_| centre)));
    starts
}

fn recover(
    setting: &CaseSetting,
    part: CasePart,
    mesh: &Mesh,
    start: &[DVec3],
    nu: f64,
    dt: f64,
) -> CaseOutcome {
    let mut run = CaseRun::damped(setting, mesh, nu)?;
    run.simulation.set_dt(dt);
    let mut at = start.to_vec();
    at.resize(mesh.points.len(), DVec3::ZERO);
    for (corners, middles) in mesh.tetrahedra.iter().zip(&mesh.middles) {
        for ([a, b], &middle) in MIDDLES.iter().zip(middles) {
            at[middle as usize] = 0.5 * (at[corners[*a] as usize] + at[corners[*b] as usize]);
        }
    }
    let u: Vec<DVec3> = at.iter().zip(&mesh.points).map(|(y, x)| *y - *x).collect();
    run.place_still(&u)?;
    let energy = run.energy();
    run.steps(STEPS)?;
    let elements = run.elements() as f64;
    let checks = if part == ORDERED || setting.column.recovers() {
        run.recovered().to_vec()
    } else if part == DISORDERED {
        run.edge_error();
        let left = run.energy() / energy;
        let share = run.inverted() as f64 / elements;
        vec![
            Check::at_most("energy left", left, setting.loose(0.05)),
            Check::at_most("share inverted at the end", share, 0.02),
        ]
    } else {
        // edges of no length have an error of 1
        let moved = run.edge_error() < 0.99;
        let said = run.inverted() as f64 == elements;
        vec![Check::holds("moved or reported as inverted", moved || said)]
    };
    Ok(run.finish(energy, checks))
}
