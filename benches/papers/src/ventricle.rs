//! Natsupakpong & Cavusoglu 2010, section 3.5: the floor of the third ventricle, 558 masses and 1607
//! springs, stepped by implicit Euler while a balloon pushes through it, alone and within its quasi-static
//! surroundings of 9145 nodes.
//!
//! Floor and surroundings are one body that shares the vertices of the rim. A step of implicit Euler brings a vertex
//! without mass into equilibrium, so surroundings are quasi-static when their masses are next to nothing; both are
//! solved for together, and nothing has to be iterated between them.

use super::frame::{clamp, world};
use super::prelude::*;
use glam::DVec2;
use sinew::engine::load::Pressure;
use sinew::engine::mesh::Group;
use sinew::engine::vertex::Mass;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::resection::{Region, Removal, RemovalError};
use sinew_benches::toolbox::beam::{relative_distance, sheet};
use sinew_identify::ElementMethod;
use sinew_tune::measures::quantile;
use std::collections::BTreeSet;

/// Radius (m), thickness (m) and material of the floor; none is printed.
const RADIUS: f64 = 0.01;
const THICKNESS: f64 = 1e-3;
const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
/// Vertices of the rim, and rings between it and the centre with their vertices.
const RIM: usize = 64;
const RINGS: usize = 12;
const INNER: usize = 493;
/// Step (s) of the paper, and frames per second on its machine.
const STEP: f64 = 0.01;
const PRINTED_RATE: f64 = 30.0;
/// Pressure (Pa) after [`PUSH`] seconds, up to which nothing tears; it goes on growing at this rate.
const PRESSURE: f64 = 300.0;
const PUSH: f64 = 0.5;
/// Longest time (s) of the whole.
const LAST: f64 = 6.0;
/// The balloon touches more and more of the floor: radii (over that of the floor) and times (s) at which
/// it reaches them.
const TOUCH: [(f64, f64); 4] = [(0.15, 0.0), (0.25, 0.1), (0.35, 0.2), (0.45, 0.3)];
/// Green strain at which the floor tears.
const TEAR: f64 = 0.3;
/// Triangles gone at which the balloon is through and loses its hold.
const HOLE: usize = 12;
/// Frames after that.
const AFTERMATH: usize = 30;
/// Nodes and faces of the surroundings, rim included, rings between rim and outer boundary, and how far the latter is
/// pulled outwards (over its radius): without tension a membrane has no stiffness across, and no equilibrium.
const SURROUNDINGS: (usize, usize) = (9145, 17942);
const AROUND: usize = 52;
const TENSION: f64 = 0.05;
/// Part of their masses that the surroundings keep.
const LIGHT: f64 = 1e-6;
/// Steps of the converged run to one of ours.
const FINE: usize = 16;

/// Disc of 558 vertices and 1050 triangles, 64 vertices on the rim (group `rim`).
fn floor() -> Mesh {
    let mut counts = vec![1];
    let part = |ring: usize| {
        (INNER as f64 * (ring * (ring + 1)) as f64 / (RINGS * (RINGS + 1)) as f64).round() as usize
    };
    counts.extend((1..=RINGS).map(|ring| part(ring) - part(ring - 1)));
    counts.push(RIM);
    let mut mesh = Mesh { source: "floor of the third ventricle".into(), ..Mesh::default() };
    let mut start = 0;
    for (ring, &count) in counts.iter().enumerate() {
        let radius = RADIUS * ring as f64 / (counts.len() - 1) as f64;
        for i in 0..count {
            let angle = std::f64::consts::TAU * i as f64 / count as f64;
            mesh.points.push((radius * DVec2::from_angle(angle)).extend(0.0));
        }
        if ring > 0 {
            let inner = counts[ring - 1];
            strip(start - inner, inner, start, count, &mut mesh.triangles);
        }
        start += count;
    }
    let rim = (start - RIM) as u32..start as u32;
    mesh.groups.push(Group { name: "rim".into(), vertices: rim.collect(), ..Group::default() });
    mesh
}

/// What is simulated.
struct Whole {
    mesh: Mesh,
    /// Group of the vertices that are held.
    held: &'static str,
    /// Vertices that are quasi-static.
    light: Vec<u32>,
    /// Strain in its plane before anything happens.
    tension: f64,
}

impl Whole {
    /// The floor, held at its rim.
    fn alone() -> Self {
        Self { mesh: floor(), held: "rim", light: Vec::new(), tension: 0.0 }
    }

    /// The floor in the middle of rings of quasi-static nodes.
    fn surrounded() -> Self {
        let mut mesh = floor();
        let (nodes, faces) = SURROUNDINGS;
        let first = mesh.points.len();
        // so that there are as many faces: two for each node but those of the boundaries, which have one
        let outer = 2 * nodes - RIM - faces;
        let inner = nodes - RIM - outer;
        let growth = (outer - RIM) as f64 / (2 * AROUND) as f64;
        let weight = |ring: usize| ring as f64 * (RIM as f64 + growth * (ring + 1) as f64);
        let upto =
            |ring: usize| (inner as f64 * weight(ring) / weight(AROUND - 1)).round() as usize;
        let mut counts: Vec<usize> = (1..AROUND).map(|ring| upto(ring) - upto(ring - 1)).collect();
        counts.push(outer);
        let (mut start, mut before) = (first - RIM, RIM);
        for (ring, &count) in counts.iter().enumerate() {
            let share = (ring + 1) as f64 / AROUND as f64;
            let radius = RADIUS * (1.0 + share * (outer as f64 / RIM as f64 - 1.0));
            let angles = (0..count).map(|i| std::f64::consts::TAU * i as f64 / count as f64);
            mesh.points.extend(angles.map(|a| (radius * DVec2::from_angle(a)).extend(0.0)));
            strip(start, before, start + before, count, &mut mesh.triangles);
            (start, before) = (start + before, count);
        }
        let vertices = (start as u32..mesh.points.len() as u32).collect();
        mesh.groups.push(Group { name: "outer".into(), vertices, ..Group::default() });
        let light = (first as u32..mesh.points.len() as u32).collect();
        Self { mesh, held: "outer", light, tension: TENSION }
    }
}

/// Triangles between two rings, advancing on the one that lags behind in angle.
fn strip(inner: usize, m: usize, outer: usize, n: usize, triangles: &mut Vec<[u32; 3]>) {
    let a = |i: usize| (inner + i % m) as u32;
    let b = |j: usize| (outer + j % n) as u32;
    if m == 1 {
        triangles.extend((0..n).map(|j| [a(0), b(j), b(j + 1)]));
        return;
    }
    let (mut i, mut j) = (0, 0);
    while i < m || j < n {
        // middles of the next edges, in units of 1 / (2 m n) turns
        if j < n && (i == m || (2 * j + 1) * m <= (2 * i + 1) * n) {
            triangles.push([a(i), b(j), b(j + 1)]);
            j += 1;
        } else {
            triangles.push([a(i), b(j), a(i + 1)]);
            i += 1;
        }
    }
}

/// Pairs of vertices that share a triangle: springs.
fn edges(mesh: &Mesh) -> usize {
    let pairs = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let sorted = pairs.map(|[a, b]| [a.min(b), a.max(b)]);
    sorted.collect::<BTreeSet<_>>().len()
}

struct Floor {
    simulation: Simulation,
    body: BodyHandle,
    balloon: Vec<bevy_ecs::entity::Entity>,
}

fn build(whole: &Whole, dt: f64) -> Result<Floor> {
    let mesh = &whole.mesh;
    let integrator = Integrator::Safe;
    let solver = SolverSettings { integrator, mass_damping: 2.0, ..SolverSettings::default() };
    let membrane = MembraneDescription {
        model: MembraneModel::MassSpring,
        springs: Some(ElementMethod::Frobenius.into()),
        ..MembraneDescription::new(&mesh.triangles, THICKNESS, MATERIAL)
    };
    let (mut simulation, body) = world(&sheet("floor", mesh, membrane), solver)?;
    simulation.set_dt(dt);
    let stretched: Vec<DVec3> = mesh.points.iter().map(|p| whole.tension * *p).collect();
    simulation.set_state(body, &stretched, &vec![DVec3::ZERO; stretched.len()])?;
    clamp(&mut simulation, body, mesh, whole.held)?;
    let light: BTreeSet<VertexRow> =
        simulation.rows(body, "surroundings", &whole.light)?.into_iter().collect();
    let world = simulation.world_mut();
    for (row, mut mass) in (0..).map(VertexRow).zip(world.query::<&mut Mass<f64>>().iter_mut(world))
    {
        mass.0 *= if light.contains(&row) { LIGHT } else { 1.0 };
    }
    let mut balloon = Vec::new();
    let mut inner = 0.0;
    for (outer, from) in TOUCH {
        let touched: Vec<[u32; 3]> = mesh
            .triangles
            .iter()
            .copied()
            .filter(|t| {
                let sum: DVec3 = t.iter().map(|&v| mesh.points[v as usize]).sum();
                let distance = sum.length() / 3.0 / RADIUS;
                (inner..outer).contains(&distance)
            })
            .collect();
        inner = outer;
        let faces = simulation.face_rows(body, "balloon", &touched)?;
        // an annulus that is touched later comes to the common pressure within a tenth of a second
        let rate = PRESSURE / PUSH;
        let curve = Curve::Points(vec![
            [from, 0.0],
            [from + 0.1, (from + 0.1) * rate],
            [LAST, LAST * rate],
        ]);
        let pressure = Pressure { name: "balloon".into(), faces, pressure: 1.0, curve };
        balloon.push(simulation.add_pressure(pressure));
    }
    Ok(Floor { simulation, body, balloon })
}

/// Displacements after [`PUSH`] seconds, nothing torn.
fn pushed(whole: &Whole, dt: f64) -> Result<Vec<DVec3>> {
    let mut floor = build(whole, dt)?;
    for _ in 0..(PUSH / dt).round() as usize {
        floor.simulation.step()?;
    }
    Ok(floor.simulation.displacements(floor.body))
}

/// One frame.
struct Frame {
    time: f64,
    /// Seconds of wall time, removal included.
    seconds: f64,
    removed: usize,
    /// Largest height (m).
    height: f64,
    residual: f64,
}

struct Run {
    frames: Vec<Frame>,
    /// Time (s) of the first tear and when the balloon was through.
    torn: Option<f64>,
    through: Option<f64>,
    /// Energy that was left, and whether every displacement is a number.
    finite: bool,
    /// Largest force on a quasi-static vertex when the push ends, over the largest spring force of one on the floor.
    unbalanced: f64,
}

/// See [`Run::unbalanced`].
fn unbalanced(simulation: &mut Simulation, body: BodyHandle, whole: &Whole) -> f64 {
    let held = whole.mesh.group(whole.held).map_or(&[][..], |group| &group.vertices);
    simulation.evaluate();
    let forces = simulation.elastic_forces(body);
    let largest = |vertices: &mut dyn Iterator<Item = u32>| {
        vertices.map(|v| forces[v as usize].length()).fold(0.0, f64::max)
    };
    let floor = 0..(forces.len() - whole.light.len()) as u32;
    let free = whole.light.iter().copied().filter(|v| !held.contains(v));
    largest(&mut { free }) / largest(&mut { floor })
}

fn run(whole: &Whole) -> Result<Run> {
    let Floor { mut simulation, body, balloon } = build(whole, STEP)?;
    let request = |error: RemovalError| BenchError::Request {
        what: error.to_string(),
        remedy: "the floor must be one body with a membrane".into(),
    };
    simulation.prepare_removals(body).map_err(request)?;
    let (frames, torn, through) = (Vec::new(), None, None);
    let mut run = Run { frames, torn, through, finite: true, unbalanced: 0.0 };
    let (mut gone, mut left) = (0, AFTERMATH);
    while simulation.time() < LAST - STEP && left > 0 {
        let clock = Instant::now();
        let removal = Removal::new(Region::Strain { above: TEAR });
        let removed = simulation.remove_elements(body, &removal).map_err(request)?;
        simulation.step()?;
        let seconds = clock.elapsed().as_secs_f64();
        let time = simulation.time();
        let count = removed.triangles.len();
        gone += count;
        if count > 0 && run.torn.is_none() {
            run.torn = Some(time);
        }
        if gone >= HOLE && run.through.is_none() {
            run.through = Some(time);
            // through the hole the balloon no longer presses on the floor
            for &entity in &balloon {
                simulation.world_mut().despawn(entity);
            }
        }
        if (time - PUSH).abs() < 0.5 * STEP {
            run.unbalanced = unbalanced(&mut simulation, body, whole);
        }
        left -= usize::from(run.through.is_some());
        let u = simulation.displacements(body);
        run.finite &= u.iter().all(|u| u.is_finite());
        run.frames.push(Frame {
            time,
            seconds,
            removed: count,
            height: u.iter().map(|u| u.z.abs()).fold(0.0, f64::max),
            residual: simulation.report().cg_residual,
        });
    }
    Ok(run)
}

/// Frames per second at half, at the slowest twentieth and at the slowest of the frames.
fn rates(frames: &[Frame]) -> [f64; 3] {
    let mut seconds: Vec<f64> = frames.iter().map(|f| f.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    [0.5, 0.95, 1.0].map(|share| 1.0 / quantile(&seconds, share))
}

pub(crate) fn figure(quick: bool) -> Result<Figure> {
    let (alone, surrounded) = (Whole::alone(), Whole::surrounded());
    let springs = edges(&alone.mesh);
    let (run, around) = (run(&alone)?, run(&surrounded)?);
    let fine = pushed(&alone, STEP / FINE as f64)?;
    let error = 100.0 * relative_distance(&pushed(&alone, STEP)?, &fine);
    let check = (!quick)
        .then(|| pushed(&alone, STEP / (2 * FINE) as f64))
        .transpose()?
        .map(|finer| 100.0 * relative_distance(&fine, &finer));
    let [median, slow, worst] = rates(&around.frames);
    let own = rates(&run.frames);
    let residual = |run: &Run| run.frames.iter().map(|f| f.residual).fold(0.0, f64::max);
    let seconds = |time: Option<f64>| time.unwrap_or(f64::INFINITY);
    let gone = |run: &Run| run.frames.iter().map(|f| f.removed).sum::<usize>();
    let height = |run: &Run| 1e3 * run.frames.iter().map(|f| f.height).fold(0.0, f64::max);
    let findings = vec![
        Finding::of_times(slow > PRINTED_RATE && run.finite && around.finite).says(format!(
                "interactive with its quasi-static surroundings: {median:.0} frames per second in the median, \
                 {slow:.0} for 95 % of them, {worst:.0} at worst, {:.1} times the 30 printed, which drawing is part of; \
                 the floor alone {:.0}, {:.0} and {:.0}",
                median / PRINTED_RATE, own[0], own[1], own[2]
            )),
    ];
    let mut rows = vec![
        ("frames per second with surroundings, median", median),
        ("frames per second with surroundings, 95 % of frames", slow),
        ("frames per second with surroundings, worst frame", worst),
        ("frames per second of the floor alone, median", own[0]),
        ("frames per second of the floor alone, 95 % of frames", own[1]),
        ("frames per second of the floor alone, worst frame", own[2]),
        ("largest relative residual of a linear system", residual(&run).max(residual(&around))),
        (
            "surroundings out of balance at 0.5 s, % of the largest force on the floor",
            100.0 * around.unbalanced,
        ),
        ("error at 0.5 s against the fine run, floor alone, % of largest displacement", error),
        (
            "height at 0.5 s, floor alone, mm",
            1e3 * fine.iter().map(|u| u.z.abs()).fold(0.0, f64::max),
        ),
        ("largest height, floor alone, mm", height(&run)),
        ("largest height with surroundings, mm", height(&around)),
        ("triangles torn, floor alone", gone(&run) as f64),
        ("triangles torn with surroundings", gone(&around) as f64),
        ("first tear, floor alone, s", seconds(run.torn)),
        ("first tear with surroundings, s", seconds(around.torn)),
        ("through, floor alone, s", seconds(run.through)),
        ("through with surroundings, s", seconds(around.through)),
    ];
    rows.extend(check.map(|check| ("fine run against one of half its step, %", check)));
    let build =
        if cfg!(debug_assertions) { "; NO RELEASE BUILD, so the rates mean little" } else { "" };
    let table = table_of!("f-ventricle", "Ventricle floor"; for (name, value) in rows;
        "quantity" => name, "value" => value,
    )
    .note(format!("times with removal of torn triangles, one thread{build}"));
    let frames = [("alone", &run), ("with surroundings", &around)];
    let all = frames.iter().flat_map(|(which, run)| run.frames.iter().map(move |f| (which, f)));
    let numbers = table_of!("f-ventricle-frames", "Frames"; for (which, f) in all;
        "floor" => *which, "time s" => f.time, "wall time ms" => 1e3 * f.seconds,
        "triangles removed" => f.removed, "height mm" => 1e3 * f.height, "residual" => f.residual,
    );
    let series: Vec<Series> = (0..)
        .zip(&frames)
        .map(|(colour, (which, run))| {
            let heights = run.frames.iter().map(|f| [f.time, 1e3 * f.height]).collect();
            Series::new(format!("floor {which}"), heights, colour)
        })
        .collect();
    let axes = ["time (s)", "largest height (mm)"];
    let chart = lines(
        "f-ventricle",
        "The ventricle floor under the balloon",
        axes,
        &series,
        Scales::Linear,
    )?;
    Ok(Figure {
        setting: format!(
            "Disc of {RADIUS} m radius, {THICKNESS} m thick, made to have the {} masses, {springs} springs and {} faces \
             that are printed; {} Pa, nu {} (none of them printed), springs by the \
             F-norm, rim held, safe implicit Euler of {STEP} s. The balloon is a follower pressure on a patch that \
             grows to 0.45 of the radius in 0.4 s; the pressure rises by {} Pa a second. Triangles tear at a \
             Green strain of {TEAR}; with {HOLE} gone the balloon is through and presses no more. The fine run has \
             steps of {} s. Surroundings: rings of the {} nodes and {} faces that are printed, in the plane of the \
             floor, of the same material, under a tension of {} % and held outside (their shape is not printed); they \
             keep a millionth of their mass, so that each step finds their equilibrium together with the floor's motion.",
            alone.mesh.points.len(),
            alone.mesh.triangles.len(),
            MATERIAL.young_modulus,
            MATERIAL.poisson_ratio,
            PRESSURE / PUSH,
            STEP / FINE as f64,
            SURROUNDINGS.0,
            SURROUNDINGS.1,
            100.0 * TENSION,
        ),
        findings,
        tables: vec![table],
        numbers: vec![numbers],
        charts: vec![chart],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_floor_has_the_printed_counts_and_tears() {
        let mesh = floor();
        let area: f64 = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| mesh.points[v as usize]);
                let normal = (b - a).cross(c - a);
                assert!(normal.z > 0.0);
                0.5 * normal.z
            })
            .sum();
        let polygon = 0.5 * RIM as f64 * (std::f64::consts::TAU / RIM as f64).sin();
        assert!((area / (polygon * RADIUS * RADIUS) - 1.0).abs() < 1e-12, "{area}");
        let counts = (mesh.points.len(), edges(&mesh), mesh.triangles.len());
        assert_eq!(counts, (558, 1607, 1050));
        let run = run(&Whole::alone()).unwrap();
        assert!(run.finite && run.through.is_some());
        // nothing tears before the push ends, and the floor has risen by then
        assert!(run.torn.unwrap() > PUSH);
        let before = run.frames.iter().filter(|f| f.time <= PUSH);
        assert!(before.map(|f| f.height).fold(0.0, f64::max) > 0.05 * RADIUS);
    }

    #[test]
    fn smaller_steps_come_closer() {
        let whole = Whole::alone();
        let fine = pushed(&whole, STEP / 8.0).unwrap();
        let errors =
            [1.0, 4.0].map(|n| relative_distance(&pushed(&whole, STEP / n).unwrap(), &fine));
        assert!(errors[1] < 0.6 * errors[0], "{errors:?}");
    }

    #[test]
    fn surroundings_follow_the_floor_in_equilibrium() {
        let whole = Whole::surrounded();
        assert_eq!(whole.mesh.points.len() - floor().points.len() + RIM, SURROUNDINGS.0);
        assert_eq!(whole.mesh.triangles.len() - floor().triangles.len(), SURROUNDINGS.1);
        let flat = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| whole.mesh.points[v as usize]);
            (b - a).cross(c - a).z > 0.0
        };
        assert!(whole.mesh.triangles.iter().all(flat));
        let mut whole_run = build(&whole, STEP).unwrap();
        for _ in 0..30 {
            whole_run.simulation.step().unwrap();
        }
        let off = unbalanced(&mut whole_run.simulation, whole_run.body, &whole);
        assert!(off < 0.05, "{off}");
        // the rim, which is held in the run of the floor alone, rises with it
        let u = whole_run.simulation.displacements(whole_run.body);
        let rim = &whole.mesh.group("rim").unwrap().vertices;
        let height = u.iter().map(|u| u.z.abs()).fold(0.0, f64::max);
        assert!(rim.iter().all(|&v| u[v as usize].z.abs() > 0.05 * height), "{height}");
    }
}
