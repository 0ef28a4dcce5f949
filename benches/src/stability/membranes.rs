//! Group 9: a sheet whose edges are brought together until it wrinkles, sheets collapsed to a point or a
//! line, a sphere blown up to many times its size.

use super::prelude::*;
use crate::toolbox::beam;
use glam::DVec2;
use sinew::engine::load::Pressure;
use sinew::engine::mesh::generate::{sphere_triangles, triangle_grid};
use sinew::engine::vertex::FixedAxes;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::element::membrane::plane_stress;

const WRINKLED: CasePart = CasePart {
    group: 9,
    name: "wrinkled sheet",
    criterion: "leaves its plane by more than 1 % of its size",
};
const COLLAPSED: CasePart = CasePart {
    group: 9,
    name: "sheet collapsed to point, line",
    criterion: "edge error < 1e-3 after 5 s",
};
const INFLATED: CasePart = CasePart {
    group: 9,
    name: "inflated sphere",
    criterion: "radius within 0.5 % of the closed form",
};
/// Side of the sheet, thickness, radius of the sphere (m).
const SIZE: f64 = 0.2;
const THICKNESS: f64 = 0.001;
const RADIUS: f64 = 0.1;

pub(super) fn cases() -> Result<Cases, MeshError> {
    let sheet = Arc::new(triangle_grid(DVec2::splat(SIZE), [10; 2])?);
    let sphere = Arc::new(sphere_triangles(RADIUS, 8)?);
    let mut cases = Cases::default();
    for model in [MembraneModel::Biquadratic, MembraneModel::CompressibleBiquadratic] {
        let own = model.name();
        for dt in [1.0 / 60.0, 0.1] {
            for fraction in [0.1, 0.3, 0.6] {
                let name = format!("{own} {:.0} % h {dt:.4}", 100.0 * fraction);
                let quick = dt < 0.1 && fraction == 0.6;
                let run = move |s: &CaseSetting, mesh: &Mesh| wrinkle(s, mesh, model, fraction, dt);
                cases.within(Scope::Integrators, WRINKLED, name, quick, &sheet, run);
            }
            for (name, line) in [("point", false), ("line", true)] {
                let name = format!("{own} {name} h {dt:.4}");
                let quick = dt < 0.1 && model == MembraneModel::Biquadratic;
                let run = move |s: &CaseSetting, mesh: &Mesh| collapse(s, mesh, model, line, dt);
                cases.within(Scope::Integrators, COLLAPSED, name, quick, &sheet, run);
            }
        }
    }
    for stretch in [1.2, 2.0, 4.0] {
        let run = move |s: &CaseSetting, mesh: &Mesh| inflate(s, mesh, stretch);
        cases.within(Scope::Once, INFLATED, format!("stretch {stretch}"), true, &sphere, run);
    }
    Ok(cases)
}

fn sheet<'a>(setting: &CaseSetting, mesh: &'a Mesh, model: MembraneModel) -> Result<CaseRun<'a>> {
    let material = tissue(1e4, 0.3);
    let membrane = MembraneDescription::new(&mesh.triangles, THICKNESS, material);
    let body = beam::sheet("sheet", mesh, MembraneDescription { model, ..membrane });
    CaseRun::of(setting, mesh, &body)
}

/// Starts at rest, with noise (m) on the displacements.
fn start(run: &mut CaseRun, mut u: Vec<DVec3>, noise: f64) -> Result<()> {
    let mut random = CaseRandom(0x5678_9abc_def1_2345);
    u.iter_mut().for_each(|u| *u += 2.0 * noise * (random.vector() - DVec3::splat(0.5)));
    run.place_still(&u)
}

/// Two opposite edges are brought together in half a second and held for another.
fn wrinkle(
    setting: &CaseSetting,
    mesh: &Mesh,
    model: MembraneModel,
    fraction: f64,
    dt: f64,
) -> CaseOutcome {
    let mut run = sheet(setting, mesh, model)?;
    run.solver(|s| s.mass_damping = 2.0);
    for (side, sign) in [("x0", 0.5), ("x1", -0.5)] {
        let motion = Motion::Translate(DVec3::X * (sign * fraction * SIZE));
        let rows = run.side(side)?;
        let together = Constraint::moving(side, rows, motion, Curve::ramp(0.0, 0.5));
        run.simulation.add_constraint(together);
    }
    start(&mut run, vec![DVec3::ZERO; mesh.points.len()], 1e-6 * SIZE)?;
    run.seconds(dt, 1.0)?;
    let u = run.simulation.displacements(run.body);
    let out = u.iter().map(|u| u.z.abs()).fold(0.0, f64::max) / SIZE;
    Ok(run.finish_by_largest([Check::at_least("way out of its plane over size", out, 0.01)]))
}

/// A free sheet in a point or on a line.
fn collapse(
    setting: &CaseSetting,
    mesh: &Mesh,
    model: MembraneModel,
    line: bool,
    dt: f64,
) -> CaseOutcome {
    let mut run = sheet(setting, mesh, model)?;
    run.solver(|s| s.mass_damping = 4.0);
    let centre = DVec3::new(0.5 * SIZE, 0.5 * SIZE, 0.0);
    let onto = if line { DVec3::Y } else { DVec3::ONE };
    let u = mesh.points.iter().map(|x| (centre - *x) * onto).collect();
    start(&mut run, u, 1e-7 * SIZE)?;
    run.seconds(dt, 5.0)?;
    let error = run.edge_error();
    let (scale, limit) = (run.largest, setting.loose(1e-3));
    Ok(run.finish(scale, [Check::at_most("edge error at the end", error, limit)]))
}

/// A sphere under the pressure at which a perfect one has `stretch` times its radius,
/// `p = 2 (lambda + mu) (s^2 - 1) / (R s)`.
fn inflate(setting: &CaseSetting, mesh: &Mesh, stretch: f64) -> CaseOutcome {
    let mut run = sheet(setting, mesh, MembraneModel::Biquadratic)?;
    run.solver(|s| {
        s.integrator = Integrator::QuasiStatic;
        s.linear_tolerance = 1e-6;
        s.newton_tolerance = setting.pick(1e-9, 1e-6);
    });
    run.simulation.set_dt(0.125);
    // vertices on the axes may move along them only: the sphere cannot move rigidly, but grow
    for k in 0..3 {
        let axis = DVec3::AXES[k];
        let on = |v: &u32| mesh.points[*v as usize].cross(axis).length() < 1e-9 * RADIUS;
        let on: Vec<u32> = (0..mesh.points.len() as u32).filter(on).collect();
        let mut hold = Constraint::hold("axis", run.simulation.rows(run.body, "axis", &on)?);
        hold.axes = FixedAxes(7 & !(1 << k));
        run.simulation.add_constraint(hold);
    }
    let moduli = plane_stress(1e4 * THICKNESS, 0.3);
    let pressure =
        2.0 * (moduli.lambda + moduli.mu) * (stretch * stretch - 1.0) / (RADIUS * stretch);
    let faces = run.simulation.face_rows(run.body, "air", &mesh.triangles)?;
    let curve = Curve::ramp(0.0, 1.0);
    run.simulation.add_pressure(Pressure { name: "air".into(), faces, pressure, curve });
    run.steps(8)?;
    let u = run.simulation.displacements(run.body);
    let sum: f64 = u.iter().zip(&mesh.points).map(|(u, x)| (*u + *x).length()).sum();
    let error = (sum / u.len() as f64 / (stretch * RADIUS) - 1.0).abs();
    Ok((run.close(), vec![Check::at_most("relative error of the mean radius", error, 0.005)]))
}
