//! What Bourguignon & Cani 2000 leave open: how stiff a body of axes is in directions between them.

use super::frame::{equilibrium, settle, world};
use super::prelude::*;
use sinew::engine::mesh::generate::box_hexahedra;
use sinew::engine::vertex::FixedAxes;
use sinew::models::axes::description::{AxesDescription, AxisFamily};
use std::borrow::Cow;

const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
/// Modulus (Pa) of the fibres, a family beside three isotropic ones.
const FIBRE: f64 = 5e4;

/// Angles (degrees) between fibres and pull.
const ANGLES: [f64; 7] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0];

/// Young's modulus (Pa) of an isotropic material with fibres in a direction at `angle` (rad) to them, in
/// closed form: `1/E = s11 sin^4 + s33 cos^4 + (2 s13 + 1/mu) sin^2 cos^2` with the compliances of the
/// stiffness whose component along the fibres is larger by their modulus.
fn closed_form(angle: f64) -> Result<f64> {
    let lame = MATERIAL.lame()?;
    let (a, b) = (lame.lambda + 2.0 * lame.mu, lame.lambda);
    let c33 = a + FIBRE;
    // the part with equal strains across is 2 x 2
    let determinant = c33 * (a + b) - 2.0 * b * b;
    let (s33, s13) = ((a + b) / determinant, -b / determinant);
    // strains of a unit stress across: across, across the other way, along
    let sum = c33 / determinant;
    let s11 = 0.5 * (sum + 1.0 / (a - b));
    let (sin, cos) = (angle.sin().powi(2), angle.cos().powi(2));
    Ok(1.0 / (s11 * sin * sin + s33 * cos * cos + (2.0 * s13 + 1.0 / lame.mu) * sin * cos))
}

/// The same by a small pull on one hexahedron.
fn pulled_cube(angle: f64) -> Result<f64> {
    const SIDE: f64 = 0.01;
    const STRAIN: f64 = 1e-5;
    let mesh = box_hexahedra(DVec3::splat(SIDE), [1, 1, 1])?;
    let mut axes = AxesDescription::isotropic(MATERIAL.lame()?);
    let directions = Cow::Owned(vec![DVec3::new(angle.sin(), 0.0, angle.cos())]);
    axes.families.push(AxisFamily { directions, ..AxisFamily::new("fibre", &[], FIBRE) });
    let (axes, description) = (Some(axes), BodyDescription::new("block", &mesh, MATERIAL));
    let description = BodyDescription { model: Model::Axes, axes, ..description };
    let (mut simulation, body) = world(&description, equilibrium())?;
    let mut hold = |vertices: &[u32], axes: u8| -> Result<()> {
        let rows = simulation.rows(body, "held", vertices)?;
        let mut constraint = Constraint::hold("held", rows);
        constraint.axes = FixedAxes(axes);
        simulation.add_constraint(constraint);
        Ok(())
    };
    // the bottom stays level; one corner stays, another along x
    let on = |test: &dyn Fn(DVec3) -> bool| -> Vec<u32> {
        (0..8).filter(|&v| test(mesh.points[v as usize])).collect()
    };
    hold(&on(&|p| p.z == 0.0), 4)?;
    hold(&on(&|p| p == DVec3::ZERO), 7)?;
    hold(&on(&|p| p == DVec3::X * SIDE), 6)?;
    let top = on(&|p| p.z == SIDE);
    let force = MATERIAL.young_modulus * STRAIN * SIDE * SIDE;
    let rows = simulation.rows(body, "top", &top)?;
    let forces = rows.iter().map(|&row| (row, DVec3::Z * (force / 4.0))).collect();
    simulation.add_load(Load { name: "pull".into(), forces, curve: Curve::Constant });
    settle(&mut simulation, 1, &format!("cube, {:.0} degrees", angle.to_degrees()))?;
    let u = simulation.displacements(body);
    let rise = top.iter().map(|&v| u[v as usize].z).sum::<f64>() / 4.0;
    Ok(force / (SIDE * SIDE) / (rise / SIDE))
}

/// Stiffness between the axes.
pub(crate) fn figure() -> Result<Figure> {
    let mut rows = Vec::new();
    for angle in ANGLES {
        let (found, exact) = (pulled_cube(angle.to_radians())?, closed_form(angle.to_radians())?);
        rows.push((angle, found, exact, 100.0 * (found / exact - 1.0)));
    }
    let title = "Young's modulus in a direction at an angle to the fibres";
    let table = table_of!("b-between", title; for &(angle, found, exact, off) in &rows;
        "angle degrees" => angle, "engine Pa" => found, "closed form Pa" => exact, "off by %" => off,
    );
    let worst = rows.iter().fold(0.0, |worst: f64, r| worst.max(r.3.abs()));
    let found = rows.iter().map(|r| [r.0, r.1]).collect();
    let exact: Vec<[f64; 2]> = rows.iter().map(|r| [r.0, r.2]).collect();
    let modulus = |i: usize| exact.get(i).map_or(f64::NAN, |p| p[1]);
    let text = format!(
        "what the paper leaves open, stiffness in directions between the axes, follows from the moduli: the \
         pull of one element is within {worst:.2} % of the closed form at every angle; it falls from {:.1} kPa \
         along the fibres to {:.1} kPa at 45 degrees and is {:.1} kPa across them",
        modulus(0) / 1e3,
        modulus(3) / 1e3,
        modulus(6) / 1e3
    );
    let findings = vec![Finding::of(worst < 0.1).says(text)];
    let series = [("engine", found, false, 0), ("closed form", exact, true, 1)]
        .map(|(name, points, hollow, colour)| Series::new(name, points, colour).hollow(hollow));
    let title = "Young's modulus between the axes";
    let names = ["angle to the fibres (degrees)", "Young's modulus (Pa)"];
    let chart = lines("b-between", title, names, &series, Scales::Linear)?;
    Ok(Figure {
        setting: format!(
            "One hexahedron of isotropic axes (E = {} Pa, nu = {}) and fibres of {FIBRE} Pa, pulled by a strain of \
             about 1e-5 at an angle to the fibres, its sides free.",
            MATERIAL.young_modulus, MATERIAL.poisson_ratio
        ),
        findings,
        tables: vec![table],
        charts: vec![chart],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stiffness_between_the_axes_is_that_of_the_closed_form() {
        for angle in [0.0, 0.3, 0.9, 1.5] {
            let (found, exact) = (pulled_cube(angle).unwrap(), closed_form(angle).unwrap());
            assert!((found / exact - 1.0).abs() < 1e-3, "{angle}: {found} beside {exact}");
        }
        let along = closed_form(0.0).unwrap();
        // all that fibres along the pull do is to bear their share
        assert!((along / (MATERIAL.young_modulus + FIBRE) - 1.0).abs() < 1e-12, "{along}");
    }
}
