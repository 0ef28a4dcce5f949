//! Laws of axes, of hexahedra and of membranes that are added from another crate: this one.

use glam::DVec2;
use sinew::engine::element::MembraneVertices;
use sinew::engine::law::{TangentKind, partition_laws};
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, jitter_interior, triangle_grid};
use sinew::engine::resource::ensure;
use sinew::engine::scalar::Real;
use sinew::models::axes::description::AxesDescription;
use sinew::models::body::sheet::MembraneDescription;
use sinew::models::element::membrane::{self, TriangleTangent, biquadratic};
use sinew::models::element::tetrahedron::{Element, TetrahedronTangent};
use sinew::models::frame::law::{TetrahedronLaw, TriangleLaw};
use sinew::models::frame::row::{LawRow, LawTable, activate};
use sinew::models::laws::linear::Linear;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;
use sinew_benches::toolbox::beam::{relative_distance, sheet};
use sinew_papers::axes::law::IN_TETRAHEDRA;
use sinew_papers::axes::springs::VolumeForm;
use sinew_papers::axes::{PrintedDescription, PrintedError};

const SIZE: DVec3 = DVec3::new(0.06, 0.04, 0.04);
const CELLS: [usize; 3] = [3, 2, 2];
const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.4, density: 1000.0 };

/// A body without gravity on one thread.
fn alone(description: &BodyDescription) -> (Simulation, BodyHandle) {
    let options = SimulationOptions { threads: 1, ..SimulationOptions::default() };
    let mut simulation = Simulation::new(options).unwrap();
    let body = simulation.add_body(description).unwrap();
    simulation.set_gravity(DVec3::ZERO);
    (simulation, body)
}

/// A body of nothing but axes, printed or with an energy, which amount to [`MATERIAL`] near rest.
fn axes(mesh: &Mesh, form: Option<VolumeForm>) -> (Simulation, BodyHandle) {
    let axes = AxesDescription::isotropic(MATERIAL.lame().unwrap());
    let body = BodyDescription::new("body", mesh, MATERIAL);
    let Some(form) = form else {
        return alone(&BodyDescription { model: Model::Axes, axes: Some(axes), ..body });
    };
    let (mut simulation, body) =
        alone(&BodyDescription { model: Model::Own(&IN_TETRAHEDRA), ..body });
    let printed = PrintedDescription { axes, form, volume_viscosity: 0.0 };
    printed.add(&mut simulation, body).unwrap();
    (simulation, body)
}

fn displace(simulation: &mut Simulation, body: BodyHandle, u: &[DVec3]) {
    simulation.set_state(body, u, &vec![DVec3::ZERO; u.len()]).unwrap();
}

/// Displacements (m) that bend, shear and stretch, the same every time.
fn disturbed(mesh: &Mesh) -> Vec<DVec3> {
    let wave = |x: DVec3| DVec3::new((90.0 * x.y).sin(), (70.0 * x.z).cos(), (110.0 * x.x).sin());
    mesh.points.iter().map(|x| 2e-3 * wave(*x)).collect()
}

#[test]
fn printed_axes_agree_near_rest() {
    let u = |mesh: &Mesh| mesh.points.iter().map(|x| *x * 1e-5).collect::<Vec<_>>();
    let energy = |mesh: &Mesh, form| {
        let (mut simulation, body) = axes(mesh, form);
        displace(&mut simulation, body, &u(mesh));
        simulation.evaluate()
    };
    let mesh = box_hexahedra(SIZE, CELLS).unwrap();
    let exact = energy(&mesh, None);
    for form in [VolumeForm::Printed, VolumeForm::Balanced] {
        let printed = energy(&mesh, Some(form));
        assert!((printed / exact - 1.0).abs() < 1e-3, "{form:?}: {printed} {exact}");
    }
}

/// What the printed formulas lack: the resultant of their volume springs and the moment of their angular
/// springs are not zero, while balanced springs and axes with an energy have neither.
#[test]
fn printed_axes_push_and_turn_free_bodies() {
    let mesh = jitter_interior(&box_tets(SIZE, CELLS).unwrap(), 0.2, 7).unwrap();
    let u = disturbed(&mesh);
    let resultants = |form| {
        let (mut simulation, body) = axes(&mesh, form);
        displace(&mut simulation, body, &u);
        simulation.evaluate();
        let f = simulation.elastic_forces(body);
        let x: Vec<_> = mesh.points.iter().zip(&u).map(|(x, u)| *x + *u).collect();
        let size: f64 = f.iter().map(|f| f.length()).sum();
        let lever: f64 = f.iter().zip(&x).map(|(f, x)| f.length() * x.length()).sum();
        let force = f.iter().sum::<DVec3>().length() / size;
        let moment = f.iter().zip(&x).map(|(f, x)| x.cross(*f)).sum::<DVec3>().length() / lever;
        (force, moment)
    };
    let (force, moment) = resultants(None);
    assert!(force < 1e-12 && moment < 1e-12, "{force:e} {moment:e}");
    let (force, moment) = resultants(Some(VolumeForm::Balanced));
    assert!(force < 1e-12 && moment > 1e-5, "{force:e} {moment:e}");
    let (force, moment) = resultants(Some(VolumeForm::Printed));
    assert!(force > 1e-4 && moment > 1e-5, "{force:e} {moment:e}");
}

/// Two halves of a body have the energy of the whole, in either order of removal.
#[test]
fn printed_axes_leave_with_their_elements() {
    for mesh in [box_tets(SIZE, CELLS).unwrap(), box_hexahedra(SIZE, CELLS).unwrap()] {
        let region = |elements| match mesh.hexahedra.is_empty() {
            true => Region::Tetrahedra(elements),
            false => Region::Hexahedra(elements),
        };
        let count = (mesh.tetrahedra.len() + mesh.hexahedra.len()) as u32;
        let energy = |removed: std::ops::Range<u32>| {
            let (mut simulation, body) = axes(&mesh, Some(VolumeForm::Balanced));
            displace(&mut simulation, body, &disturbed(&mesh));
            if !removed.is_empty() {
                let removal = Removal::new(region(removed.collect()));
                simulation.remove_elements(body, &removal).unwrap();
            }
            simulation.evaluate()
        };
        let (whole, first, second) = (energy(0..0), energy(count / 3..count), energy(0..count / 3));
        assert!(first > 0.0 && second > 0.0);
        assert!((first + second - whole).abs() < 1e-12 * whole, "{first} {second} {whole}");
    }
}

#[test]
fn printed_axes_that_cannot_be_made_are_refused() {
    let mesh = box_tets(SIZE, CELLS).unwrap();
    let body = BodyDescription::new("body", &mesh, MATERIAL);
    let (mut simulation, body) = alone(&body);
    let form = VolumeForm::Printed;
    let mut axes = AxesDescription::isotropic(MATERIAL.lame().unwrap());
    let mut refused = |axes: &AxesDescription, volume_viscosity| {
        let printed = PrintedDescription { axes: axes.clone(), form, volume_viscosity };
        printed.add(&mut simulation, body).unwrap_err()
    };
    assert_eq!(refused(&axes, 1.0), PrintedError::Viscosity { value: 1.0 });
    axes.families[0].muscle = Some(Default::default());
    assert!(refused(&axes, 0.0).to_string().contains("family `x` is active"));
    axes.families.clear();
    assert!(refused(&axes, 0.0).to_string().contains("families"));
}

/// Linear elasticity under another name; also the mark of its elements.
#[derive(bevy_ecs::prelude::Component, Clone, Copy, Debug, Default)]
struct Mine;

static MINE: LawRow = LawRow::tetrahedra::<Mine>().with_family(&[&MINE_IN_HEXAHEDRA]);
static MINE_IN_HEXAHEDRA: LawRow = LawRow::hexahedra::<Mine>("mine, in hexahedra");

impl TetrahedronLaw for Mine {
    const NAME: &'static str = "mine";
    type Mark = Self;
    const STRESS_PROJECTION: bool = false;
    fn energy<R: Real>(e: &Element<R>, u: &[[R; 3]; 4]) -> R {
        Linear::energy(e, u)
    }
    fn forces<R: Real>(e: &Element<R>, u: &[[R; 3]; 4]) -> Option<[[R; 3]; 4]> {
        Linear::forces(e, u)
    }
    fn tangent<R: Real>(e: &Element<R>, u: &[[R; 3]; 4], k: TangentKind) -> TetrahedronTangent<R> {
        Linear::tangent(e, u, k)
    }
}

#[test]
fn a_law_of_hexahedra_can_be_added() {
    for mesh in [box_hexahedra(SIZE, CELLS).unwrap(), box_tets(SIZE, CELLS).unwrap()] {
        let run = |model| {
            let body = BodyDescription::new("body", &mesh, MATERIAL);
            let (mut simulation, body) = alone(&BodyDescription { model, ..body });
            let rows = simulation.group_rows(body, &mesh, "x0").unwrap();
            simulation.add_constraint(Constraint::hold("x0", rows));
            displace(&mut simulation, body, &disturbed(&mesh));
            simulation.set_dt(1e-3);
            simulation.step().unwrap();
            (simulation.evaluate(), simulation.displacements(body))
        };
        let ((own, u), (linear, v)) = (run(Model::Own(&MINE)), run(Model::Linear));
        assert!(linear > 0.0 && (own / linear - 1.0).abs() < 1e-12, "{own} {linear}");
        assert!(relative_distance(&u, &v) < 1e-12);
    }
}

/// The springs of a membrane once more, in all triangles there are.
struct Again;

static AGAIN: LawRow = LawRow::triangles::<Again>();

impl TriangleLaw for Again {
    const NAME: &'static str = "membranes again";
    type Mark = MembraneVertices;
    fn energy<R: Real>(e: &membrane::Element<R>, u: &[[R; 3]; 3]) -> R {
        biquadratic::energy(e, u)
    }
    fn forces<R: Real>(e: &membrane::Element<R>, u: &[[R; 3]; 3]) -> [[R; 3]; 3] {
        biquadratic::forces(e, u)
    }
    fn tangent<R: Real>(
        e: &membrane::Element<R>,
        u: &[[R; 3]; 3],
        kind: TangentKind,
    ) -> TriangleTangent<R> {
        biquadratic::tangent(e, u, kind)
    }
}

#[test]
fn a_law_of_membranes_can_be_added() {
    let mesh = triangle_grid(DVec2::splat(0.1), [4, 4]).unwrap();
    let run = |again| {
        let membrane = MembraneDescription::new(&mesh.triangles, 1e-3, MATERIAL);
        let (mut simulation, body) = alone(&sheet("sheet", &mesh, membrane));
        if again {
            let world = simulation.world_mut();
            ensure::<LawTable>(world).add(&AGAIN).unwrap();
            activate::<f64>(world, &AGAIN);
            partition_laws::<f64>(world);
        }
        displace(&mut simulation, body, &disturbed(&mesh));
        (simulation.evaluate(), simulation.elastic_forces(body))
    };
    let ((once, force), (twice, forces)) = (run(false), run(true));
    assert!(once > 0.0 && (twice / once - 2.0).abs() < 1e-12, "{once} {twice}");
    let double: Vec<DVec3> = force.iter().map(|f| 2.0 * *f).collect();
    assert!(relative_distance(&forces, &double) < 1e-12);
}
