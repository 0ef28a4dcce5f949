//! `sinew fit` from the mesh to the file and on into a simulation.

use glam::DVec2;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, quad_grid, sphere_tets};
use sinew::prelude::*;
use sinew_identify::error_metrics::position_errors;
use sinew_identify::mass::MassLumping;
use sinew_identify::{ElementMethod, LinearMaterial, Plane, Section};
use sinew_tune::fit::assess::{self, limits};
use sinew_tune::fit::rig::{Grips, Rig, Test};
use sinew_tune::fit::whole::{AMPLITUDES, Sharing, Target, WholeRequest};
use sinew_tune::fit::{
    BodySpring, ElementConstants, FitRequest, FittedBody, file, fit_file, fit_mesh,
};

fn request(method: ElementMethod, nu: f64) -> FitRequest {
    FitRequest {
        material: LinearMaterial::new(1e4, nu).unwrap(),
        density: 1000.0,
        section: Section { plane: Plane::Stress, thickness: 0.01 },
        method,
        masses: MassLumping::RowSum,
        grips: Grips::default(),
        whole: None,
    }
}

fn hex_box() -> Mesh {
    box_hexahedra(DVec3::new(0.06, 0.02, 0.02), [6, 2, 2]).unwrap()
}

fn saved(name: &str, body: &FittedBody) -> FittedBody {
    let path = std::env::temp_dir().join(format!("sinew-{}-{name}", std::process::id()));
    file::write(&path, body).unwrap();
    let again = file::read(&path).unwrap();
    std::fs::remove_file(path).unwrap();
    again
}

#[test]
fn files_come_back_as_they_were_written() {
    let body = fit_mesh(&hex_box(), &request(ElementMethod::TwoNorm, 0.3)).unwrap();
    assert_eq!(saved("body.json", &body), body);
    let plain = FittedBody { assessment: None, freedom: None, ..body };
    assert_eq!(saved("body.csv", &plain), plain);
    let sheet = quad_grid(DVec2::new(0.06, 0.02), [6, 2]).unwrap();
    let body = fit_mesh(&sheet, &request(ElementMethod::Frobenius, 0.3)).unwrap();
    assert_eq!((body.plane, body.thickness), (Some(Plane::Stress), Some(0.01)));
    let plain = FittedBody { assessment: None, ..body };
    assert_eq!(saved("sheet.csv", &plain), plain);
}

/// Squares have a whole interval of constants of least 2-norm (its ends from closed forms), cubes one point.
#[test]
fn a_two_norm_fit_says_whether_it_is_unique() {
    let sheet = quad_grid(DVec2::new(0.06, 0.02), [6, 2]).unwrap();
    let body = fit_mesh(&sheet, &request(ElementMethod::TwoNorm, 0.3)).unwrap();
    let freedom = body.freedom.as_ref().unwrap();
    assert_eq!((body.report.not_unique, freedom.rise, freedom.ranges.len()), (Some(12), None, 1));
    // E t = 100 N/m; stretch and hourglass balance at this norm, which dilation and shear may not exceed
    let nu: f64 = 0.3;
    let stretch = 1.0 / (1.0 + nu);
    let hourglass = (1.0 / (1.0 - nu * nu) + 0.5 / (1.0 + nu)) / 3.0;
    let (norm, sides) = (0.5 * (stretch - hourglass), 0.5 * (stretch + hourglass));
    let least = 50.0 * (1.0 / (1.0 - nu) - sides - norm).max(stretch - norm);
    let most = 50.0 * (1.0 / (1.0 - nu) - sides + norm).min(stretch + norm);
    let range = &freedom.ranges[0];
    assert!(
        (range.range[0] - least).abs() < 1e-4 && (range.range[1] - most).abs() < 1e-4,
        "{range:?}"
    );
    assert!(body.to_string().contains("NOT UNIQUE in 12 of 12 elements"), "{body}");
    let body = fit_mesh(&hex_box(), &request(ElementMethod::TwoNorm, 0.3)).unwrap();
    let freedom = body.freedom.as_ref().unwrap();
    assert_eq!((body.report.not_unique, freedom.ranges.len()), (Some(0), 3));
    for range in &freedom.ranges {
        assert!(range.range[0] < range.constant && range.constant < range.range[1], "{range:?}");
        // 1 % of a residual of a tenth of the stiffness moves no constant by a quarter
        assert!(range.range[1] - range.range[0] < 0.25 * range.constant, "{range:?}");
    }
    assert!(body.to_string().contains("unique; with a 2-norm up by 1 %"), "{body}");
    assert_eq!(fit_mesh(&sheet, &request(ElementMethod::Frobenius, 0.3)).unwrap().freedom, None);
}

#[test]
fn spoiled_files_are_refused() {
    let body = fit_mesh(&hex_box(), &request(ElementMethod::Baudet, 0.25)).unwrap();
    let path = std::env::temp_dir().join(format!("sinew-{}-spoiled.csv", std::process::id()));
    file::write(&path, &body).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    for (from, to, said) in [
        ("sinew-body/1", "sinew-body/9", "schema"),
        ("spring,0,1,", "spring,0,x1,", "`x1` is no second"),
        ("spring,0,1,", "spring,0,0,", "spring 0 joins vertices 0 and 0"),
        ("mass,1,", "mass,7,", "order of vertices"),
        ("record,first", "record,1st", "header"),
    ] {
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let error = file::read(&path).unwrap_err().to_string();
        assert!(error.contains(said) && error.contains("spoiled.csv"), "{from}: {error}");
    }
    std::fs::remove_file(path).unwrap();
    assert!(file::check_name("body.txt".as_ref()).unwrap_err().to_string().contains(".csv"));
}

/// Displacements (m) of a body in the engine under nodal forces, one end held, at equilibrium.
fn simulated(mesh: &Mesh, body: &BodyDescription<'_>, rig: &Rig, scale: f64) -> Vec<[f64; 3]> {
    let mut simulation =
        Simulation::new(SimulationOptions { threads: 1, ..SimulationOptions::default() }).unwrap();
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_solver(SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-10,
        newton_tolerance: 1e-10,
        max_newton_iterations: 50,
        ..SolverSettings::default()
    });
    let handle = simulation.add_body(body).unwrap();
    let held: Vec<u32> = rig.held.iter().map(|&n| rig.nodes[n]).collect();
    let rows = simulation.rows(handle, "held", &held).unwrap();
    simulation.add_constraint(Constraint::hold("held", rows));
    let loading = rig.loading(Test::Tension, Rig::stress(&LinearMaterial::new(1e4, 0.3).unwrap()));
    let nodes: Vec<u32> = loading.forces.iter().map(|(n, _)| rig.nodes[*n]).collect();
    let rows = simulation.rows(handle, "pull", &nodes).unwrap();
    let forces = rows.into_iter().zip(&loading.forces);
    let forces = forces.map(|(row, (_, f))| (row, DVec3::from(*f) * scale)).collect();
    simulation.add_load(Load { name: "pull".into(), forces, curve: Curve::Constant });
    simulation.step().unwrap();
    assert!(!simulation.report().unconverged);
    let u = simulation.displacements(handle);
    assert_eq!(u.len(), mesh.points.len());
    u.iter().map(|u| u.to_array()).collect()
}

/// Fit, simulate: the error that a simulation of the springs has against one of linear elements is the
/// stated one, and its masses are those of the file.
#[test]
fn a_simulation_has_the_stated_error() {
    let mesh = hex_box();
    for method in [ElementMethod::Frobenius, ElementMethod::TwoNorm] {
        let request = request(method, 0.3);
        let body = saved(&format!("{method}.json"), &fit_mesh(&mesh, &request).unwrap());
        let rig = Rig::new(&mesh, request.section, &request.grips).unwrap();
        let material =
            YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: body.density };
        let elements = BodyDescription {
            model: Model::Linear,
            ..BodyDescription::new("elements", &mesh, material)
        };
        let springs = BodyDescription {
            model: Model::MassSpring,
            springs: Some(body.method.into()),
            ..BodyDescription::new("springs", &mesh, material)
        };
        // a strain of 1e-5, where springs with rest lengths are linear
        let place = |u: Vec<[f64; 3]>| -> Vec<[f64; 3]> {
            rig.points.iter().zip(u).map(|(x, u)| [x[0] + u[0], x[1] + u[1], x[2] + u[2]]).collect()
        };
        let fem = place(simulated(&mesh, &elements, &rig, 1e-4));
        let own = place(simulated(&mesh, &springs, &rig, 1e-4));
        let measured = position_errors(&rig.points, &fem, &own).unwrap();
        let stated = &body.assessment.unwrap().tests[0];
        assert_eq!(stated.test, "tension");
        for (measured, stated) in
            [(measured.rms_percent, stated.rms_percent), (measured.max_percent, stated.max_percent)]
        {
            let ratio = measured / stated.unwrap();
            assert!((1.0 / 1.1..1.1).contains(&ratio), "{method}: {measured} beside {stated:?}");
        }
        let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
        let handle = simulation.add_body(&springs).unwrap();
        for (own, written) in simulation.masses(handle).iter().zip(&body.masses) {
            assert!((own / written - 1.0).abs() < 1e-12, "{own} {written}");
        }
    }
}

#[test]
fn verdicts() {
    let words = |mesh: &Mesh, method, nu| {
        let assessment = fit_mesh(mesh, &request(method, nu)).unwrap().assessment.unwrap();
        (assessment.fit, assessment.verdict.join("\n"), assessment)
    };
    let mesh = hex_box();
    // exact under an even pull, and said so
    let (_, text, a) = words(&mesh, ElementMethod::Baudet, 0.25);
    assert!(a.tests[0].rms_percent.unwrap() < limits::RMS_PERCENT && a.tests[0].fit, "{text}");
    assert!(text.contains("fit for use in tension") && text.contains("near enough"), "{text}");
    let names: Vec<&str> = a.tests.iter().map(|t| t.test.as_str()).collect();
    assert_eq!(names, ["tension", "shear", "torsion", "bending"]);
    // springs cannot be nearly incompressible
    let (fit, text, a) = words(&mesh, ElementMethod::Frobenius, 0.45);
    assert!(!fit && text.contains("nearly incompressible"), "{text}");
    assert!(text.contains("central springs cannot hold a free Poisson's ratio"), "{text}");
    assert!(a.moduli.unwrap().poisson_ratio < 0.4 && text.contains("too high"), "{text}");
    // no torsion in the plane
    let sheet = quad_grid(DVec2::new(0.06, 0.02), [6, 2]).unwrap();
    let (_, _, a) = words(&sheet, ElementMethod::Frobenius, 0.3);
    assert_eq!(a.tests.len(), 3);
    // slices four times as long as wide get negative constants
    let long = quad_grid(DVec2::new(0.08, 0.005), [4, 1]).unwrap();
    let (fit, text, _) = words(&long, ElementMethod::TwoNorm, 0.3);
    assert!(!fit && text.contains("negative constants"), "{text}");
    let (_, text, _) = words(&long, ElementMethod::Nonnegative, 0.3);
    assert!(!text.contains("negative constants"), "{text}");
    // a ball has no flat end
    let ball = sphere_tets(0.01, 3).unwrap();
    let (_, _, a) = words(&ball, ElementMethod::Frobenius, 0.3);
    assert!(a.equal_forces && a.tests.iter().all(|t| t.rms_percent.is_some_and(f64::is_finite)));
    let text = fit_mesh(&mesh, &request(ElementMethod::Lloyd, 0.3)).unwrap_err().to_string();
    assert!(text.contains("hexahedron 0") && text.contains("lloyd"), "{text}");
}

/// Straight bodies: finite elements in free tension measure what went in.
#[test]
fn the_machine_measures_what_went_in() {
    for mesh in [hex_box(), box_tets(DVec3::new(0.06, 0.02, 0.02), [6, 2, 2]).unwrap()] {
        for axis in 0..3 {
            let grips = Grips { axis: Some(axis), ..Grips::default() };
            let rig = Rig::new(&mesh, Section::default(), &grips).unwrap();
            let material = LinearMaterial::new(1e4, 0.3).unwrap();
            let u = assess::reference(&rig, &material, &rig.free_tension(100.0)).unwrap();
            let moduli = rig.moduli(&u, 100.0).unwrap();
            assert!((moduli.youngs_modulus / 1e4 - 1.0).abs() < 1e-9, "{axis} {moduli:?}");
            assert!((moduli.poissons_ratio - 0.3).abs() < 1e-9, "{axis} {moduli:?}");
        }
    }
}

#[test]
fn bad_input_is_named() {
    let mesh = hex_box();
    let good = request(ElementMethod::Frobenius, 0.3);
    let error = |request: &FitRequest| fit_mesh(&mesh, request).unwrap_err().to_string();
    let held = |name: &str| Grips { held: Some(name.into()), ..Grips::default() };
    let text = error(&FitRequest { grips: held("foot"), ..good.clone() });
    assert!(text.contains("no group `foot`") && text.contains("x0"), "{text}");
    let text = error(&FitRequest { grips: held("x1"), ..good.clone() });
    assert!(text.contains("both held and loaded"), "{text}");
    let text = error(&FitRequest { density: -1.0, ..good.clone() });
    assert!(text.contains("density"), "{text}");
    let sheet = quad_grid(DVec2::new(0.06, 0.02), [6, 2]).unwrap();
    let grips = Grips { axis: Some(2), ..Grips::default() };
    let text = fit_mesh(&sheet, &FitRequest { grips, ..good.clone() }).unwrap_err().to_string();
    assert!(text.contains("cannot be pulled along z"), "{text}");
    let section = Section { thickness: 0.0, ..good.section };
    let text = fit_mesh(&sheet, &FitRequest { section, ..good.clone() }).unwrap_err().to_string();
    assert!(text.contains("thickness"), "{text}");
    let text = fit_mesh(&Mesh::default(), &good).unwrap_err().to_string();
    assert!(!text.is_empty());
    let text = fit_file("nowhere.msh".as_ref(), &good).unwrap_err().to_string();
    assert!(text.contains("nowhere.msh"), "{text}");
}

/// Springs are found where no test is possible, and the file says why there is none.
#[test]
fn springs_without_tests() {
    let good = request(ElementMethod::Frobenius, 0.3);
    // the ends of an icosahedron are edges, about which it turns
    let ball = sphere_tets(0.01, 1).unwrap();
    let body = fit_mesh(&ball, &good).unwrap();
    let reason = body.untested.clone().unwrap();
    assert!(reason.contains("singular") && body.assessment.is_none(), "{reason}");
    assert_eq!(body.springs.len(), 12 + 30);
    assert!(body.springs.iter().all(|s| s.constant.is_finite()));
    assert_eq!(saved("untested.json", &body), body);
    assert!(body.to_string().contains("not possible: ") && body.to_string().contains("In a scene"));
    // ends that were asked for stay an error
    let same = Some("surface".to_string());
    let grips = Grips { axis: None, held: same.clone(), loaded: same };
    let text = fit_mesh(&ball, &FitRequest { grips, ..good }).unwrap_err().to_string();
    assert!(text.contains("both held and loaded"), "{text}");
}

/// Constants of a whole body meet it better than those of its elements, are told as such, and are what a scene runs.
#[test]
fn springs_of_a_whole_body() {
    let good = request(ElementMethod::Frobenius, 0.3);
    let sheet = quad_grid(DVec2::new(0.06, 0.02), [6, 2]).unwrap();
    let tetrahedra = box_tets(DVec3::new(0.06, 0.02, 0.02), [6, 2, 2]).unwrap();
    for mesh in [&hex_box(), &sheet, &tetrahedra] {
        let elements = fit_mesh(mesh, &good).unwrap();
        let mut residuals = Vec::new();
        for (target, sharing) in [
            (Target::Body, Sharing::Springs),
            (Target::Body, Sharing::Moduli),
            (Target::Forces, Sharing::Springs),
            (Target::Forces, Sharing::Moduli),
        ] {
            let amplitudes = AMPLITUDES.to_vec();
            let whole = Some(WholeRequest { target, sharing, amplitudes });
            let body = fit_mesh(mesh, &FitRequest { whole, ..good.clone() }).unwrap();
            let report = body.whole.clone().unwrap();
            assert_eq!((report.target, report.sharing), (target, sharing));
            if sharing == Sharing::Springs {
                assert!(report.residual < report.residual_of_elements, "{report:?}");
                assert_eq!(report.unknowns, body.springs.len());
            } else {
                assert_eq!((report.unknowns, report.iterations), (report.moduli.len(), 0));
            }
            assert_eq!(report.states.len(), if target == Target::Body { 0 } else { 6 });
            residuals.push(report.residual);
            let same = |a: &FittedBody| a.springs.iter().map(|s| s.nodes).collect::<Vec<_>>();
            assert_eq!(same(&body), same(&elements));
            assert_eq!(body.masses, elements.masses);
            let least = body.springs.iter().map(|s| s.constant).fold(f64::INFINITY, f64::min);
            assert_eq!(body.report.least_constant, least);
            let text = body.to_string();
            assert!(
                text.contains("whole body") && text.contains("springs = \"FILE.json\""),
                "{text}"
            );
            assert_eq!(saved("whole.json", &body), body);
            let plain = FittedBody { assessment: None, untested: None, ..body };
            assert_eq!(saved("whole.csv", &plain), plain);
        }
        // more unknowns, nearer
        assert!(residuals[0] < residuals[1] && residuals[2] < residuals[3], "{residuals:?}");
    }
    let whole = |target, amplitudes| {
        let sharing = Sharing::Springs;
        FitRequest { whole: Some(WholeRequest { target, sharing, amplitudes }), ..good.clone() }
    };
    let text = fit_mesh(&hex_box(), &whole(Target::Forces, vec![0.1, -0.2])).unwrap_err();
    assert!(text.to_string().contains("an amplitude is -0.2"), "{text}");
    // without ends there are no states, but a stiffness
    let ball = sphere_tets(0.01, 1).unwrap();
    assert!(fit_mesh(&ball, &whole(Target::Forces, vec![0.1])).is_err());
    assert!(fit_mesh(&ball, &whole(Target::Body, vec![])).unwrap().whole.is_some());
    // what was found runs in a scene, and is other than the springs of elements
    let read = format!("{CYLINDER}\nsprings = \"body.json\"");
    let run = |request: &FitRequest| {
        run_scene(&read, &json(&fit_mesh(&cylinder(), request).unwrap())).unwrap().0
    };
    let (elements, body) = (run(&good), run(&whole(Target::Body, vec![])));
    let off = elements.iter().zip(&body).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    let largest = elements.iter().map(|u| u.length()).fold(0.0, f64::max);
    assert!(off > 1e-3 * largest && off < 0.5 * largest, "{off} {largest}");
}

/// A scene of one body, whose springs come from `springs` (JSON) where `key` says so.
fn scene(key: &str, springs: &str) -> Result<sinew_scene::assemble::BuiltScene, String> {
    let text = format!(
        "name = \"springs\"\ndt = 0.001\nduration = 0.02\nthreads = 1\n[[body]]\nname = \"body\"\n{key}\n\
         material = {{ young_modulus = 1e4, poisson_ratio = 0.3, density = 1000.0 }}\n\
         [[constraint]]\nname = \"held\"\nselect = {{ group = \"x0\" }}\n"
    );
    let springs = springs.as_bytes().to_vec();
    let scene = sinew_scene::scene::LoadedScene::parse(&text, "a/springs.toml".as_ref());
    let scene = scene.map_err(|e| e.to_string())?.with_files(move |path| {
        let known = path == std::path::Path::new("a/body.json");
        known.then(|| springs.clone()).ok_or(std::io::ErrorKind::NotFound.into())
    });
    sinew_scene::assemble::build(&scene, &Default::default()).map_err(|e| e.to_string())
}

/// Displacements (m) after some steps of it, and masses (kg).
fn run_scene(key: &str, springs: &str) -> Result<(Vec<DVec3>, Vec<f64>), String> {
    let mut built = scene(key, springs)?;
    let handle = built.bodies[0].handle;
    for _ in 0..20 {
        built.simulation.step().map_err(|e| e.to_string())?;
    }
    Ok((built.simulation.displacements(handle), built.simulation.masses(handle)))
}

const CYLINDER: &str = "model = \"mass_spring\"\n\
    generate = { cylinder = { radius = 0.01, length = 0.03, rings = 1, layers = 3, elements = \"hexahedra\" } }";
const SHEET: &str =
    "generate = { sheet = { size = [0.03, 0.02], cells = [3, 2], elements = \"quads\" } }";

fn cylinder() -> Mesh {
    sinew::engine::mesh::generate::cylinder_hexahedra(0.01, 0.03, 2, 1, 3).unwrap()
}

fn json(body: &FittedBody) -> String {
    serde_json::to_string(body).unwrap()
}

/// A scene that reads springs is that which finds them, to rounding.
#[test]
fn a_scene_reads_springs_back() {
    let good = request(ElementMethod::Frobenius, 0.3);
    let near = |a: &[DVec3], b: &[DVec3]| {
        let largest = a.iter().map(|u| u.length()).fold(0.0, f64::max);
        assert!(largest > 1e-6);
        a.iter().zip(b).all(|(a, b)| a.distance(*b) < 1e-9 * largest)
    };
    let sheet = quad_grid(DVec2::new(0.03, 0.02), [3, 2]).unwrap();
    let of_sheet = |keys: &str| {
        format!("{SHEET}\nmembrane = {{ thickness = 0.01, model = \"mass_spring\"{keys} }}")
    };
    for (mesh, fitted, read) in [
        (
            cylinder(),
            format!("{CYLINDER}\nelement_method = \"frobenius\""),
            format!("{CYLINDER}\nsprings = \"body.json\""),
        ),
        (
            sheet,
            of_sheet(", element_method = \"frobenius\""),
            format!("springs = \"body.json\"\n{}", of_sheet("")),
        ),
    ] {
        let mut body = fit_mesh(&mesh, &good).unwrap();
        let (fit, masses) = run_scene(&fitted, "").unwrap();
        let (own, own_masses) = run_scene(&read, &json(&body)).unwrap();
        assert!(near(&fit, &own) && masses == own_masses);
        // without constants of elements the sums are the same
        body.element_constants = ElementConstants::default();
        let (own, _) = run_scene(&read, &json(&body)).unwrap();
        assert!(near(&fit, &own));
        // the springs of the file are what counts
        body.springs.iter_mut().for_each(|s| s.constant *= 1.5);
        let (own, _) = run_scene(&read, &json(&body)).unwrap();
        assert!(!near(&fit, &own));
    }
}

/// After a removal, springs that were given and nodal masses are those of the elements that are left.
#[test]
fn springs_from_a_file_are_shared_by_elements() {
    use sinew::models::resection::{Region, Removal};
    let nodal = FitRequest {
        masses: MassLumping::NodalQuadrature,
        ..request(ElementMethod::Frobenius, 0.3)
    };
    let mut body = fit_mesh(&cylinder(), &nodal).unwrap();
    body.springs.iter_mut().for_each(|s| s.constant *= 1.5);
    let mut built = scene(&format!("{CYLINDER}\nsprings = \"body.json\""), &json(&body)).unwrap();
    let handle = built.bodies[0].handle;
    for removed in [vec![35], vec![14, 20]] {
        for _ in 0..3 {
            built.simulation.step().unwrap();
        }
        let removal = Removal::new(Region::Hexahedra(removed));
        built.simulation.remove_elements(handle, &removal).unwrap();
        let off = built.simulation.verify_against_fresh(handle).unwrap();
        assert!(off.largest().max(off.mass) < 1e-12, "{off:?}");
    }
}

/// Masses by nodal quadrature come from the fit and from the key of the scene, and are those of the file.
#[test]
fn masses_by_nodal_quadrature() {
    let nodal = FitRequest {
        masses: MassLumping::NodalQuadrature,
        ..request(ElementMethod::Frobenius, 0.3)
    };
    let body = fit_mesh(&cylinder(), &nodal).unwrap();
    let rows = fit_mesh(&cylinder(), &request(ElementMethod::Frobenius, 0.3)).unwrap();
    let off = |a: &[f64], b: &[f64]| {
        a.iter().zip(b).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max)
    };
    assert!(off(&body.masses, &rows.masses) > 0.01);
    for (key, file) in
        [("springs = \"body.json\"", json(&body)), ("masses = \"nodal\"", String::new())]
    {
        let (_, masses) = run_scene(&format!("{CYLINDER}\n{key}"), &file).unwrap();
        assert!(off(&masses, &body.masses) < 1e-12, "{key}");
    }
    let key = format!("{CYLINDER}\nsprings = \"body.json\"\nmasses = \"volume\"");
    let text = run_scene(&key, &json(&body)).unwrap_err();
    assert!(text.contains("`masses`"), "{text}");
    assert!(run_scene(&format!("{CYLINDER}\nmasses = \"half\""), "").unwrap_err().contains("half"));
}

#[test]
fn wrong_files_of_springs_are_named() {
    let good = fit_mesh(&cylinder(), &request(ElementMethod::Frobenius, 0.3)).unwrap();
    let key = format!("{CYLINDER}\nsprings = \"body.json\"");
    let refused = |change: &dyn Fn(&mut FittedBody), said: &[&str]| {
        let mut body = good.clone();
        change(&mut body);
        let text = run_scene(&key, &json(&body)).unwrap_err();
        for said in said.iter().chain(&["a/body.json", "springs.toml, line 9, `body[0].springs`"]) {
            assert!(text.contains(said), "{said}: {text}");
        }
    };
    refused(&|b| b.schema = "sinew-body/7".into(), &["sinew-body/7", "sinew fit"]);
    refused(&|b| b.springs[2].nodes = [4, 4], &["spring 2", "another mesh"]);
    refused(&|b| b.springs[2].nodes[1] = 999, &["spring 2", "999"]);
    refused(&|b| b.springs[1] = b.springs[0], &["spring 1", "a second time"]);
    refused(&|b| b.springs[5].constant = 1e30, &["spring 5", "1e30"]);
    refused(&|b| b.springs[5].rest_length *= 2.0, &["spring 5", "scale"]);
    refused(&|b| b.masses[7] *= 1.1, &["vertex 7", "density"]);
    refused(&|b| b.masses.truncate(3), &["3 masses"]);
    let far = good.springs.len();
    let [a, b] = [0, cylinder().points.len() as u32 - 1];
    let rest_length = cylinder().points[0].distance(cylinder().points[b as usize]);
    let spring = BodySpring { nodes: [a, b], constant: 1.0, rest_length };
    refused(&|b| b.springs.push(spring), &[&format!("spring {far}"), "share no element"]);
    for (key, file, said) in [
        (key.clone(), "{".to_string(), "a/body.json"),
        (key.replace("body.json", "none.json"), json(&good), "none.json"),
        (format!("{key}\nelement_method = \"block\""), json(&good), "element_method"),
        (key.replace("mass_spring", "svk"), json(&good), "does not consist of springs"),
    ] {
        let text = run_scene(&key, &file).unwrap_err();
        assert!(text.contains(said) && text.contains("springs.toml"), "{said}: {text}");
    }
}
