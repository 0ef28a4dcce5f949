//! A law of one's own, in one's own crate: `W = V mu/2 |G|^2` of the displacement gradient `G`, beside a
//! shipped one that is switched off and on. `cargo run --release --example 10_own_law`
//!
//! A law is three functions of one tetrahedron, written for one number or a register of them alike; the engine
//! runs them over all elements, in parallel, in either precision, with every integrator.

use bevy_ecs::prelude::Component;
use sinew::engine::element::displacement_gradient;
use sinew::engine::law::{DisabledLaws, TangentKind};
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::scalar::{Real, dot};
use sinew::models::element::tetrahedron::{Element, TetrahedronTangent};
use sinew::models::frame::law::TetrahedronLaw;
use sinew::models::frame::row::LawRow;
use sinew::prelude::*;

/// The law; also the mark of its tetrahedra.
#[derive(Component, Clone, Copy, Debug, Default)]
struct Laplacian;

/// Its row in the table of laws.
static LAPLACIAN: LawRow = LawRow::tetrahedra::<Laplacian>();

/// Gradients of the four shape functions (1/m); they add up to zero.
#[inline(always)]
fn gradients<R: Real>(e: &Element<R>) -> [[R; 3]; 4] {
    let [a, b, c] = e.gradients;
    let first = [-(a[0] + b[0] + c[0]), -(a[1] + b[1] + c[1]), -(a[2] + b[2] + c[2])];
    [first, a, b, c]
}

impl TetrahedronLaw for Laplacian {
    const NAME: &'static str = "Laplacian";
    type Mark = Self;
    // its tangent is definite as it is
    const STRESS_PROJECTION: bool = false;

    /// J
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &[[R; 3]; 4]) -> R {
        let mut squares = R::ZERO;
        for x in displacement_gradient(&e.gradients, u) {
            squares = x.mul_add(x, squares);
        }
        R::from_f64(0.5) * e.volume * e.mu * squares
    }

    /// N
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &[[R; 3]; 4]) -> Option<[[R; 3]; 4]> {
        let g = displacement_gradient(&e.gradients, u);
        let d = gradients(e);
        let mut f = [[R::ZERO; 3]; 4];
        for a in 0..4 {
            for x in 0..3 {
                f[a][x] = -(e.volume * e.mu * dot([g[3 * x], g[3 * x + 1], g[3 * x + 2]], d[a]));
            }
        }
        Some(f)
    }

    /// N/m
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, _: &[[R; 3]; 4], _: TangentKind) -> TetrahedronTangent<R> {
        let d = gradients(e);
        let mut t = TetrahedronTangent { diagonal: [[R::ZERO; 9]; 4], off: [[R::ZERO; 9]; 6] };
        let pairs = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
        for x in 0..3 {
            for a in 0..4 {
                t.diagonal[a][4 * x] = e.volume * e.mu * dot(d[a], d[a]);
            }
            for (block, [a, b]) in t.off.iter_mut().zip(pairs) {
                block[4 * x] = e.volume * e.mu * dot(d[a], d[b]);
            }
        }
        t
    }
}

#[allow(clippy::print_stdout, reason = "a command line program")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mesh = box_tets(DVec3::new(0.1, 0.1, 0.1), [4, 4, 4])?;
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    // plates that bear a weight would have that as a reaction too
    simulation.set_gravity(DVec3::ZERO);
    let own = BodyDescription {
        model: Model::Own(&LAPLACIAN),
        ..BodyDescription::new("own law", &mesh, material)
    };
    let body = simulation.add_body(&own)?;

    // sheared between two plates: the reaction is mu times shear times area
    let bottom = simulation.group_rows(body, &mesh, "z0")?;
    simulation.add_constraint(Constraint::hold("bottom", bottom));
    let top = simulation.group_rows(body, &mesh, "z1")?;
    let slide = Motion::Translate(DVec3::new(0.02, 0.0, 0.0));
    let top =
        simulation.add_constraint(Constraint::moving("top", top, slide, Curve::ramp(0.0, 0.1)));
    simulation.set_solver(SolverSettings {
        integrator: Integrator::QuasiStatic,
        ..SolverSettings::default()
    });
    simulation.set_dt(0.1);
    simulation.step()?;
    let force = simulation.reaction(top).ok_or("no such constraint")?.x;
    // the components of the displacement do not know each other, so the shear is uniform: mu 0.2 A
    let expected = material.lame()?.mu * 0.2 * 0.01;
    println!("the plate pushes with {force:.4} N; by hand {expected:.4} N");
    assert!((force - expected).abs() < 1e-6 * expected);

    // switched off it has no force, and says so
    simulation.world_mut().resource_mut::<DisabledLaws>().0.push(Laplacian::NAME);
    let force = simulation.reaction(top).ok_or("no such constraint")?;
    assert_eq!(force, DVec3::ZERO);
    println!("switched off: {force}");
    Ok(())
}
