//! Group 4: bad shapes, masses apart by a million, bodies of a micrometre and of a kilometre, far from
//! the origin.

use super::prelude::*;
use sinew::engine::columns::single_table;
use sinew::engine::scalar::Scalar;
use sinew::engine::vertex::Mass;

const SHAPES: CasePart = CasePart {
    group: 4,
    name: "slivers, needles, heavy vertex",
    criterion: "none inverted, elements of the heavy vertex left out; Newton <= 40 iterations",
};
const CONTRAST: CasePart = CasePart {
    group: 4,
    name: "stiffness 1e6 : 1",
    criterion: "none inverted; Newton <= 40 iterations",
};
const SIMILAR: CasePart = CasePart {
    group: 4,
    name: "similar bodies, 1e-6 to 1e3 m",
    criterion: "equal to the body of 0.2 m to 1e-9 of its size (f32: 1e-4)",
};
const FAR: CasePart = CasePart {
    group: 4,
    name: "f32 forces far from the origin",
    criterion: "error at strains 1e-2 to 1e-6: < 1e-4 at 1 m, < 1e-2 farther",
};
/// Edge lengths (m) of the bar.
pub const SIZE: DVec3 = DVec3::new(0.2, 0.05, 0.05);
const CELL: f64 = 0.025;

pub(super) fn cases() -> Result<Cases, MeshError> {
    let bar = box_tets(SIZE, [8, 2, 2])?;
    let plates = thin_layer(&bar, 2, 0.001 * CELL);
    let needles = thin_layer(&plates, 1, 0.001 * CELL);
    let shapes = [
        ("dihedral 1 deg", with_dihedral(&bar, 1.0), 1e4, 1.0),
        ("dihedral 0.01 deg", with_dihedral(&bar, 0.01), 1e4, 1.0),
        ("plates of aspect 1000", plates.clone(), 1e4, 1.0),
        ("needles of aspect 1000", needles.clone(), 1e4, 1.0),
        ("plates of aspect 1000, E 1e5", plates, 1e5, 1.0),
        ("needles of aspect 1000, E 1e5", needles, 1e5, 1.0),
        ("vertex 1e6 heavier", bar.clone(), 1e4, 1e6),
        ("nu 0.4999", bar.clone(), 1e4, 1.0),
    ];
    let mut cases = Cases::default();
    let both = [1.0 / 60.0, 0.1];
    for (name, mesh, young, heavy) in shapes {
        let mesh = Arc::new(mesh);
        let ratios = if name.starts_with("nu") { vec![0.4999] } else { vec![0.3, 0.45] };
        for (nu, dt) in ratios.into_iter().flat_map(|nu| both.map(|dt| (nu, dt))) {
            let name = format!("{name}, nu {nu} h {dt:.4}");
            let run = move |s: &CaseSetting, mesh: &Mesh| {
                let body = BodyDescription::new("body", mesh, tissue(young, nu));
                hang(s, mesh, &body, dt, heavy)
            };
            cases.add(SHAPES, name, nu != 0.45 && dt < 0.1, &mesh, run);
        }
    }
    let rough = Arc::new(jitter_interior(&bar, 0.15, 4)?);
    for (name, held, free) in [("stiff end free", 1e4, 1e10), ("stiff end held", 1e10, 1e4)] {
        let young = |t: &[u32; 4]| {
            let x: f64 = t.iter().map(|&v| rough.points[v as usize].x).sum();
            if x < 2.0 * SIZE.x { held } else { free }
        };
        let young: Arc<Vec<f64>> = Arc::new(rough.tetrahedra.iter().map(young).collect());
        for (nu, dt) in [0.3, 0.45].into_iter().flat_map(|nu| both.map(|dt| (nu, dt))) {
            let (name, young) = (format!("{name}, nu {nu} h {dt:.4}"), Arc::clone(&young));
            let run = move |s: &CaseSetting, mesh: &Mesh| {
                s.of_tetrahedra()?;
                let young_modulus = Some(&young[..]);
                let body = BodyDescription::new("body", mesh, tissue(1e4, nu));
                hang(s, mesh, &BodyDescription { young_modulus, ..body }, dt, 1.0)
            };
            cases.add(CONTRAST, name, nu != 0.45 && dt < 0.1, &rough, run);
        }
    }
    for nu in [0.3, 0.45] {
        let name = format!("nu {nu}");
        cases.add(SIMILAR, name, nu == 0.3, &rough, move |s, mesh| similar(s, mesh, nu));
    }
    for offset in [1.0, 100.0, 1e4] {
        let run = move |s: &CaseSetting, mesh: &Mesh| far(s.column, mesh, offset);
        cases.within(Scope::Once, FAR, format!("{offset} m"), true, &rough, run);
    }
    Ok(cases)
}

/// The second layer of vertices along an axis moved to a small distance of the first.
fn thin_layer(mesh: &Mesh, axis: usize, thickness: f64) -> Mesh {
    let mut mesh = mesh.clone();
    for x in &mut mesh.points {
        if (x[axis] - CELL).abs() < 0.1 * CELL {
            x[axis] = thickness;
        }
    }
    mesh
}

/// The bar with a layer so thin that the smallest dihedral angle is `degrees`.
pub fn with_dihedral(mesh: &Mesh, degrees: f64) -> Mesh {
    let (mut low, mut high) = (1e-9 * CELL, CELL);
    for _ in 0..60 {
        let middle = (low * high).sqrt();
        let flatter = smallest_dihedral(&thin_layer(mesh, 0, middle)) < degrees;
        *(if flatter { &mut low } else { &mut high }) = middle;
    }
    thin_layer(mesh, 0, high)
}

/// Smallest dihedral angle (degrees) of a mesh.
pub fn smallest_dihedral(mesh: &Mesh) -> f64 {
    let mut smallest = f64::INFINITY;
    for t in &mesh.tetrahedra {
        let x = t.map(|v| mesh.points[v as usize]);
        for [a, b, c, d] in
            [[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 0, 2], [2, 3, 0, 1]]
        {
            let edge = x[b] - x[a];
            let [n, m] = [edge.cross(x[c] - x[a]), edge.cross(x[d] - x[a])];
            // accurate for small angles, unlike the arc cosine
            smallest = smallest.min(n.cross(m).length().atan2(n.dot(m)));
        }
    }
    smallest.to_degrees()
}

fn hang(
    setting: &CaseSetting,
    mesh: &Mesh,
    body: &BodyDescription,
    dt: f64,
    heavy: f64,
) -> CaseOutcome {
    let mut run = CaseRun::of(setting, mesh, body)?;
    run.clamp("x0")?;
    run.simulation.set_dt(dt);
    let vertex = nearest(&mesh.points, 0.5 * SIZE) as u32;
    let mut scale = run.mass() * 9.81 * SIZE.x;
    if heavy == 1.0 {
        run.simulation.set_gravity(GRAVITY);
    } else {
        // its weight would crush the bar, so the bar swings about it from a bend instead
        let row = run.simulation.rows(run.body, "heavy", &[vertex])?[0].index();
        match setting.precision {
            Precision::F64 => scale_mass::<f64>(&mut run.simulation, row, heavy),
            Precision::F32 => scale_mass::<f32>(&mut run.simulation, row, heavy),
        }
        let u = bend(mesh, SIZE.x / 0.5);
        run.place_still(&u)?;
        scale = run.energy();
    }
    let mut inverted = 0;
    for _ in 0..60 {
        run.step()?;
        let ratios = run.simulation.volume_ratios(run.body);
        let counted = |t: &[u32; 4]| heavy == 1.0 || !t.contains(&vertex);
        let bad = ratios.iter().zip(&mesh.tetrahedra).filter(|(j, t)| **j <= 0.0 && counted(t));
        inverted = inverted.max(bad.count() as u64);
    }
    let mut checks = vec![Check::none("most inverted in a step", inverted)];
    if setting.column.integrator == Integrator::Newton {
        let most = f64::from(run.figures.most_solves);
        checks.push(Check::at_most("Newton iterations in a step", most, 40.0));
        checks.push(Check::none("steps that did not converge", run.figures.unconverged));
    }
    Ok(run.finish(scale, checks))
}

fn scale_mass<S: Scalar>(simulation: &mut Simulation, row: usize, factor: f64) {
    let world = simulation.world_mut();
    let mut query = world.query::<&mut Mass<S>>();
    if let Some(mut mass) = single_table(query.contiguous_iter_mut(world)) {
        mass[row].0 = S::from_f64(factor * mass[row].0.to_f64());
    }
}

/// The same bar a micrometre and a kilometre long, time and gravity scaled alike.
fn similar(setting: &CaseSetting, mesh: &Mesh, nu: f64) -> CaseOutcome {
    let run = |length: f64| -> Result<(Figures, Vec<Check>, Vec<DVec3>)> {
        let scale = length / SIZE.x;
        let mut scaled = mesh.clone();
        scaled.points.iter_mut().for_each(|x| *x *= scale);
        let mut run = CaseRun::new(setting, &scaled, tissue(1e4, nu))?;
        // waves need as much longer as the body is larger
        run.simulation.set_dt(scale / 60.0);
        run.simulation.set_gravity(DVec3::new(0.0, 1.0, -9.81) / scale);
        run.clamp("x0")?;
        run.steps(20)?;
        let mass = run.mass();
        let field = run.simulation.displacements(run.body).iter().map(|u| *u / length).collect();
        let (figures, checks) = run.finish(mass * 9.81 / scale * length, None);
        Ok((figures, checks, field))
    };
    let (figures, mut checks, expected) = run(SIZE.x)?;
    for length in [1e-6, 1e3] {
        let (_, others, field) = run(length)?;
        let error = field.iter().zip(&expected).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        let limit = setting.pick(1e-9, 1e-4);
        checks.extend(others);
        checks.push(Check::at_most("difference over size", error, limit));
    }
    Ok((figures, checks))
}

/// Forces in single against double precision.
fn far(column: PassColumn, mesh: &Mesh, offset: f64) -> CaseOutcome {
    let mut moved = mesh.clone();
    moved.points.iter_mut().for_each(|x| *x += DVec3::splat(offset));
    let limit = if offset <= 1.0 { 1e-4 } else { 1e-2 };
    let mut checks = Vec::new();
    for strain in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
        let field = |x: &DVec3| {
            let wave = (20.0 * x.x).sin() / 20.0;
            DVec3::new(x.x + x.y, wave, 0.5 * x.z - wave) * strain
        };
        let u: Vec<DVec3> = mesh.points.iter().map(field).collect();
        let force = |precision| -> Result<Vec<DVec3>> {
            let setting = CaseSetting { column, precision, threads: 1 };
            let mut run = CaseRun::new(&setting, &moved, tissue(1e4, 0.4))?;
            run.place_still(&u)?;
            Ok(run.simulation.elastic_forces(run.body))
        };
        let (wide, narrow) = (force(Precision::F64)?, force(Precision::F32)?);
        let largest = wide.iter().map(|f| f.length()).fold(0.0, f64::max);
        let error = wide.iter().zip(&narrow).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        checks.push(Check::at_most("force error of f32", error / largest, limit));
    }
    Ok((Figures::default(), checks))
}
