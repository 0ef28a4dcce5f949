//! Parameters from data: round trips, derivatives, and data that do not say enough.

use glam::DVec3;
use sinew::engine::connectivity::ByKind;
use sinew::engine::mesh::CellData;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::mesh::io::{VtuData, write_vtu};
use sinew_scene::assemble::{BuildOptions, build};
use sinew_scene::scene::LoadedScene;
use sinew_scene::scene_folder;
use sinew_tune::fit_data::error::DataFitError;
use sinew_tune::fit_data::gradient::Gradient;
use sinew_tune::fit_data::report::DataFitReport;
use sinew_tune::fit_data::{DataFitRequest, fit};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Folder of a test, with a bar whose cells are numbered 1 and 2 by halves.
fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("sinew-fit-data-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&path).unwrap();
    let mut mesh = box_tets(DVec3::new(0.2, 0.04, 0.04), [6, 2, 2]).unwrap();
    let x = |t: &[u32; 4]| t.iter().map(|&v| mesh.points[v as usize].x).sum::<f64>() / 4.0;
    let half = |low: f64, high: f64| -> Vec<f64> {
        mesh.tetrahedra.iter().map(|t| if x(t) < 0.1 { low } else { high }).collect()
    };
    let data = |name: &str, integer, tetrahedra| CellData {
        name: name.into(),
        integer,
        values: ByKind {
            tetrahedra,
            triangles: vec![0.0; mesh.triangles.len()],
            ..ByKind::default()
        },
    };
    let data = vec![
        data("tissue", true, half(1.0, 2.0)),
        data("stiffness", false, half(2e4, 6e4)),
        data("start", false, half(4e4, 4e4)),
    ];
    mesh.cell_data = data;
    write_vtu(&path.join("bar.vtu"), &VtuData::of_mesh(&mesh)).unwrap();
    path
}

/// What a bar is made of and what happens to it.
#[derive(Clone, Copy)]
struct Bar<'a> {
    model: &'a str,
    material: &'a str,
    /// Constraints beside the clamp at x = 0, loads and settings.
    rest: &'a str,
}

const PULL: &str = "[[load]]\nname = \"pull\"\nselect = { box = { min = [0.199, -1, -1], max = [1, 1, 1] } }\n\
                    force = [1.5, 0.0, -0.2]\n";
const STRETCH: &str = "[[constraint]]\nname = \"grip\"\nselect = { box = { min = [0.199, -1, -1], max = [1, 1, 1] } }\n\
     motion = { translate = [0.03, 0.0, 0.01] }\n";

impl Bar<'_> {
    fn scene(self, folder: &Path) -> LoadedScene {
        let Self { model, material, rest } = self;
        let text = format!(
            "name = \"bar\"\nmode = \"static\"\ngravity = [0.0, 0.0, 0.0]\n\n[[body]]\nname = \"bar\"\n\
             mesh = \"bar.vtu\"\nmodel = \"{model}\"\n[body.material]\ndensity = 1000.0\n{material}\n\n\
             [[constraint]]\nname = \"clamp\"\n\
             select = {{ box = {{ min = [-1, -1, -1], max = [0.001, 1, 1] }} }}\n\n{rest}"
        );
        LoadedScene::parse(&text, &folder.join("bar.toml")).unwrap()
    }
}

/// Tables of the displacements of all vertices and of the reaction of the clamp at some load factors, with
/// a relative noise.
fn simulate(scene: &LoadedScene, loads: &[f64], noise: f64) -> (String, String) {
    let mut table = String::from("vertex,ux,uy,uz,load\n");
    let mut curve = String::from("load,force,constraint,axis\n");
    let mut random = Noise(7);
    for (load, u, force) in equilibria(scene, loads).1 {
        let largest = u.iter().map(|u| u.length()).fold(0.0, f64::max);
        for (vertex, u) in u.iter().enumerate() {
            let u = *u + noise * largest * random.vector();
            writeln!(table, "{vertex},{:e},{:e},{:e},{load}", u.x, u.y, u.z).unwrap();
        }
        let force = force * (DVec3::ONE + noise * random.vector());
        for (axis, force) in [("x", force.x), ("z", force.z)] {
            writeln!(curve, "{load},{force:e},clamp,{axis}").unwrap();
        }
    }
    (table, curve)
}

/// Load factor, displacements (m) of the first body and force (N) of the first constraint.
type Equilibrium = (f64, Vec<DVec3>, DVec3);

/// Rest positions (m), and equilibria as the scene's own solver finds them, load step after load step.
fn equilibria(scene: &LoadedScene, loads: &[f64]) -> (Vec<DVec3>, Vec<Equilibrium>) {
    let mut scene = scene.clone();
    scene.scene.solver.linear_tolerance = 1e-8;
    let mut built = build(&scene, &BuildOptions::default()).unwrap();
    let body = built.bodies[0].handle;
    let mut found = Vec::new();
    for &load in loads {
        let done = built.simulation.time();
        built.simulation.set_gravity(built.plan.gravity * load);
        built.simulation.set_dt(load - done);
        built.simulation.step().unwrap();
        let report = built.simulation.report();
        assert!(!report.unconverged, "{report:?}");
        built.simulation.evaluate();
        let force = built.simulation.reaction(built.constraints[0].entity).unwrap();
        found.push((load, built.simulation.displacements(body), force));
    }
    (built.bodies[0].mesh.points.clone(), found)
}

/// Random numbers of unit variance: sums of twelve uniform ones.
struct Noise(u64);

impl Noise {
    fn number(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            sum += (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.number(), self.number(), self.number())
    }
}

/// Fits a scene to files with these texts.
fn fit_texts(
    scene: &LoadedScene,
    texts: &[&str],
    what: &[&str],
) -> Result<DataFitReport, DataFitError> {
    let folder = scene.file.parent().unwrap();
    let data = texts
        .iter()
        .enumerate()
        .map(|(i, text)| {
            let path = folder.join(format!("data{i}.csv"));
            std::fs::write(&path, text).unwrap();
            path
        })
        .collect();
    let fit_what = what.iter().map(|w| w.to_string()).collect();
    let request =
        DataFitRequest { data, fit: fit_what, check_gradient: true, ..Default::default() };
    fit(scene, &request)
}

fn near(value: f64, expected: f64, tolerance: f64) {
    assert!((value / expected - 1.0).abs() < tolerance, "{value} is not {expected}");
}

fn codes(report: &DataFitReport) -> Vec<&str> {
    report.warnings.iter().map(|w| w.code.as_str()).filter(|c| c.starts_with("fit.")).collect()
}

const TRUE: &str = "young_modulus = 2.5e4\npoisson_ratio = 0.42";
const WRONG: &str = "young_modulus = 8e3\npoisson_ratio = 0.2";

#[test]
fn both_constants_come_back_and_derivatives_are_exact() {
    let folder = folder("round");
    for model in ["svk_comp", "svk", "linear", "neo_hookean", "corotational", "mass_spring"] {
        let bar = |material| Bar { model, material, rest: PULL }.scene(&folder);
        let (table, _) = simulate(&bar(TRUE), &[0.4, 1.0], 0.0);
        let report = fit_texts(&bar(WRONG), &[&table], &["young", "poisson"]).unwrap();
        assert!(report.converged && report.failure.is_none(), "{model}: {report}");
        near(report.parameters[0].value, 2.5e4, 1e-6);
        near(report.parameters[1].value, 0.42, 1e-6);
        assert_eq!(report.gradient, Gradient::Direct);
        let check = report.gradient_check.unwrap();
        assert!(check.worst < 1e-6, "{model}: {}", check.worst);
        assert!(report.data[0].rms_percent.unwrap() < 1e-5, "{model}: {report}");
        assert_eq!(codes(&report), [""; 0], "{model}: {report}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn regions_come_back_from_an_array_and_from_displacements_with_a_force() {
    let folder = folder("regions");
    let field = |name: &str| format!("poisson_ratio = 0.4\nyoung_modulus_field = \"{name}\"");
    let (truth, start) = (field("stiffness"), field("start"));
    let bar = |material| Bar { model: "svk_comp", material, rest: STRETCH }.scene(&folder);
    let (table, curve) = simulate(&bar(&truth), &[1.0], 0.0);
    let what = ["young:tissue"];
    let report = fit_texts(&bar(&start), &[&table, &curve], &what).unwrap();
    assert!(report.converged, "{report}");
    assert_eq!(report.parameters[0].name, "young:tissue=1");
    near(report.parameters[0].value, 2e4, 1e-6);
    near(report.parameters[1].value, 6e4, 1e-6);
    assert!(report.gradient_check.unwrap().worst < 1e-6, "{report}");
    assert_eq!(codes(&report), [""; 0], "{report}");

    // without the force only the ratio is there
    let report = fit_texts(&bar(&start), &[&table], &what).unwrap();
    near(report.parameters[1].value / report.parameters[0].value, 3.0, 1e-5);
    let warning = report.warnings.iter().find(|w| w.code == "fit.not-identifiable").unwrap();
    assert!(warning.message.contains("only their ratios"), "{warning}");
    assert!(warning.subject.contains("young:tissue=1") && warning.subject.contains("tissue=2"));
    assert!(report.parameters.iter().all(|p| p.standard_error.is_none()), "{report}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Moduli of material and fibres apart from each other, with an active family whose activation grows with the
/// load, by derivatives.
#[test]
fn moduli_of_fibres_come_back() {
    let folder = folder("fibres");
    let scene = |[along, slanted]: [f64; 2], muscle: &str, material| {
        let rest = format!(
            "{PULL}\n[[body.fibres]]\nname = \"along\"\nmodulus = {along}\ndirection = [1, 0, 0]\n{muscle}\n\
             [[body.fibres]]\nname = \"slanted\"\nmodulus = {slanted}\ndirection = [1, 1, 1]\n"
        );
        Bar { model: "svk_comp", material, rest: &rest }.scene(&folder)
    };
    let active = "muscle = { peak_stress = 300.0, stiffening = 0.5 }";
    let (truth, guess) = ([2e4, 5e3], [4e3, 2e4]);
    let all = ["axis:along", "axis:slanted", "young", "poisson"];
    for muscle in ["", active] {
        let (table, _) = simulate(&scene(truth, muscle, TRUE), &[0.4, 1.0], 0.0);
        let report = fit_texts(&scene(guess, muscle, WRONG), &[&table], &all).unwrap();
        assert!(report.converged, "{report}");
        for (p, expected) in report.parameters.iter().zip([2e4, 5e3, 2.5e4, 0.42]) {
            near(p.value, expected, 1e-5);
        }
        assert_eq!(report.gradient, Gradient::Direct);
        let check = report.gradient_check.unwrap();
        assert!(check.worst < 1e-6, "{muscle}: {}", check.worst);
        assert_eq!(codes(&report), [""; 0], "{report}");
    }
    let (table, _) = simulate(&scene(truth, "", TRUE), &[1.0], 0.0);
    for (what, expected) in [
        ("axis", "no family of fibres"),
        ("axis:slantd", "has no fibres `slantd`; did you mean `slanted`"),
        ("bar/axis:none", "has no fibres `none`"),
    ] {
        let error = fit_texts(&scene(truth, "", TRUE), &[&table], &[what]).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
    let error = fit_texts(&scene([0.0, 1e3], "", TRUE), &[&table], &["axis:along"]);
    assert!(error.unwrap_err().to_string().contains("start from a positive modulus"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_curve_gives_the_modulus_by_the_adjoint() {
    let folder = folder("curve");
    let bar = |material| Bar { model: "svk_comp", material, rest: STRETCH }.scene(&folder);
    let (_, curve) = simulate(&bar(TRUE), &[0.25, 0.5, 1.0], 0.0);
    // one force at each load and two constants: the adjoint takes one solve instead of two
    let axial: String =
        curve.lines().filter(|l| !l.ends_with(",z")).fold(String::new(), |mut text, line| {
            text.push_str(line);
            text.push('\n');
            text
        });
    let report = fit_texts(&bar(WRONG), &[&axial], &["young", "poisson"]).unwrap();
    assert_eq!(report.gradient, Gradient::Adjoint);
    assert!(report.gradient_check.unwrap().worst < 1e-6, "{report}");
    assert_eq!(report.work.linear_solves, 3 * report.work.jacobians, "{report}");
    near(report.parameters[0].value, 2.5e4, 1e-5);
    near(report.parameters[1].value, 0.42, 1e-5);

    // forces along two axes: the direct form, and the same result
    let report = fit_texts(&bar(WRONG), &[&curve], &["young", "poisson"]).unwrap();
    assert_eq!(report.gradient, Gradient::Direct);
    assert!(report.gradient_check.unwrap().worst < 1e-6, "{report}");
    near(report.parameters[0].value, 2.5e4, 1e-6);
    near(report.parameters[1].value, 0.42, 1e-6);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn noise_is_met_by_the_confidence_interval() {
    let folder = folder("noise");
    let bar = |material| Bar { model: "svk_comp", material, rest: PULL }.scene(&folder);
    let (table, _) = simulate(&bar(TRUE), &[0.5, 1.0], 0.01);
    let report = fit_texts(&bar(WRONG), &[&table], &["young", "poisson"]).unwrap();
    assert!(report.converged, "{report}");
    for (p, truth) in report.parameters.iter().zip([2.5e4, 0.42]) {
        let [low, high] = p.confidence_95.unwrap();
        assert!(low < truth && truth < high, "{report}");
        assert!(high - low < 0.1 * truth && high > low, "{report}");
    }
    // the noise that was put in, at loads 1 and 1/2
    let rms = report.data[0].rms_percent.unwrap();
    assert!((0.7..0.9).contains(&rms), "{rms}");

    // the same with the standard deviation given: at load 1 only
    let mut with_sigma = String::from("vertex,ux,uy,uz,load,sigma\n");
    let rows: Vec<&str> = table.lines().filter(|l| l.ends_with(",1")).collect();
    let sigma = 0.01 * report.data[0].file.largest;
    for row in &rows {
        writeln!(with_sigma, "{row},{sigma:e}").unwrap();
    }
    let report = fit_texts(&bar(WRONG), &[&with_sigma], &["young", "poisson"]).unwrap();
    let per_number = report.objective[1] / report.degrees_of_freedom as f64;
    assert!((0.8..1.25).contains(&per_number), "{per_number}");
    let [low, high] = report.parameters[0].confidence_95.unwrap();
    assert!(low < 2.5e4 && 2.5e4 < high, "{report}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_data_do_not_say_is_named() {
    let folder = folder("blind");
    let stretched = |material| Bar { model: "svk_comp", material, rest: STRETCH }.scene(&folder);
    let (table, _) = simulate(&stretched(TRUE), &[1.0], 0.0);
    let report = fit_texts(&stretched(WRONG), &[&table], &["young"]).unwrap();
    assert!(report.failure.is_some() && !report.parameters[0].fitted, "{report}");
    assert_eq!(report.parameters[0].value, 8e3);
    let warning = report.warnings.iter().find(|w| w.code == "fit.no-influence").unwrap();
    let text = warning.to_string();
    assert!(text.contains("Young's modulus") && text.contains("prescribed motions"), "{text}");
    assert!(text.contains("give a force"), "{text}");

    // Poisson's ratio comes from the same data all the same
    let report = fit_texts(&stretched(WRONG), &[&table], &["young", "poisson"]).unwrap();
    assert!(report.converged && report.failure.is_none(), "{report}");
    near(report.parameters[1].value, 0.42, 1e-6);
    assert_eq!(codes(&report), ["fit.no-influence"]);

    // a bar with free sides in simple tension, of which only the elongation is measured
    let rollers = "[[constraint]]\nname = \"y\"\naxes = \"y\"\n\
         select = { box = { min = [-1, -1, -1], max = [1, 0.001, 1] } }\n\
         [[constraint]]\nname = \"z\"\naxes = \"z\"\n\
         select = { box = { min = [-1, -1, -1], max = [1, 1, 0.001] } }\n\
         [[constraint]]\nname = \"pull\"\naxes = \"x\"\n\
         select = { box = { min = [0.199, -1, -1], max = [1, 1, 1] } }\n\
         motion = { translate = [0.01, 0.0, 0.0] }\n";
    let sliding = |material| {
        let bar = Bar { model: "linear", material, rest: rollers };
        let mut scene = bar.scene(&folder);
        scene.scene.constraints[0].axes = Some("x".into());
        scene
    };
    let (table, curve) = simulate(&sliding(TRUE), &[1.0], 0.0);
    let axial: String =
        curve.lines().filter(|l| !l.ends_with(",z")).map(|l| format!("{l}\n")).collect();
    let report = fit_texts(&sliding(WRONG), &[&axial], &["young", "poisson"]);
    let report = report.unwrap();
    near(report.parameters[0].value, 2.5e4, 1e-6);
    assert!(report.parameters[0].fitted && !report.parameters[1].fitted, "{report}");
    let warning = report.warnings.iter().find(|w| w.code == "fit.no-influence").unwrap();
    assert!(warning.message.contains("a change by 0.5"), "{warning}");
    assert!(warning.remedy.contains("across the load"), "{warning}");
    // one number for one constant: no residual to judge by
    assert!(report.parameters[0].standard_error.is_none());

    // with displacements across both are there
    let report = fit_texts(&sliding(WRONG), &[&axial, &table], &["young", "poisson"]).unwrap();
    near(report.parameters[0].value, 2.5e4, 1e-6);
    near(report.parameters[1].value, 0.42, 1e-6);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn where_the_tangent_is_no_derivative_it_is_not_used() {
    let folder = folder("differences");
    let bar = |material| Bar { model: "corotational_warped", material, rest: PULL }.scene(&folder);
    let found = fit_texts(&bar(TRUE), &["vertex,ux\n3,0.1\n"], &["young"]).unwrap_err().to_string();
    assert!(found.contains("model = \"corotational\""), "{found}");

    // a pressure on a face that is free to move: no potential, no symmetric tangent
    let pushed = |young: f64| {
        let text = format!(
            "name = \"bar\"\nmode = \"static\"\ngravity = [0.0, 0.0, 0.0]\n\n[[body]]\nname = \"bar\"\n\
             generate = {{ box = {{ size = [0.2, 0.04, 0.04], cells = [6, 2, 2] }} }}\n\
             material = {{ young_modulus = {young}, poisson_ratio = 0.3, density = 1000.0 }}\n\
             [[constraint]]\nname = \"clamp\"\nselect = {{ group = \"x0\" }}\n\
             [[pressure]]\nname = \"suction\"\non = {{ group = \"x1\" }}\npressure = -20.0\n"
        );
        LoadedScene::parse(&text, &folder.join("pushed.toml")).unwrap()
    };
    let (table, _) = simulate(&pushed(2e4), &[1.0], 0.0);
    let report = fit_texts(&pushed(1.4e4), &[&table], &["young"]).unwrap();
    assert!(report.converged, "{report}");
    assert_eq!(report.gradient, Gradient::Differences);
    assert!(report.gradient_reason.unwrap().contains("free rim"), "{report}");
    near(report.parameters[0].value, 2e4, 1e-6);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn bad_data_and_parameters_are_named() {
    let folder = folder("bad");
    let scene = Bar { model: "svk_comp", material: TRUE, rest: PULL }.scene(&folder);
    let message = |text: &str, what: &str| match fit_texts(&scene, &[text], &[what]) {
        Ok(_) => panic!("{text:?} was accepted"),
        Err(error) => error.to_string(),
    };
    let cases = [
        ("vertex,ux,speed\n3,0.1,1\n", "unknown column `speed`"),
        ("vertex,load\n3,1\n", "neither a displacement nor a force"),
        ("ux,uy,uz\n0,0,0\n", "does not say which vertices"),
        ("vertex,x,y,z,ux\n3,0,0,0,0\n", "does not say which vertices"),
        ("vertex,ux,sigma,weight\n3,0.1,1,1\n", "both `sigma` and `weight`"),
        ("vertex,ux,ux\n3,0.1,1\n", "stands twice"),
        ("vertex,ux\n", "there is no observation"),
        ("vertex,ux\n3,0\n", "all observations are zero"),
        ("vertex,ux\n# remark\n3,0.1\n4,abc\n", "line 4, column `ux`: `abc` is no number"),
        ("vertex,ux\n3,inf\n", "column `ux`: `inf` is no number"),
        ("vertex,ux\n-3,0.1\n", "column `vertex`: `-3` is no vertex"),
        ("vertex,ux\n30000,0.1\n", "column `vertex`: vertex 30000 does not exist"),
        ("vertex,ux,load\n3,0.1,1.5\n", "column `load`: load is 1.5"),
        ("vertex,ux,sigma\n3,0.1,0\n", "column `sigma`: sigma is 0"),
        ("vertex,ux,sigma\n3,0.1,\n", "column `sigma`: nothing is given"),
        ("vertex,ux,body\n3,0.1,baar\n", "no body `baar`; did you mean `bar`"),
        ("x,y,z,ux\n0.5,0,0,0.1\n", "from the nearest vertex"),
        ("load,force\n1,1\n", "no column `constraint`"),
        ("load,force,constraint,axis\n1,1,clmap,x\n", "no constraint `clmap`; did you mean"),
        ("load,force,constraint,axis\n1,1,clamp,w\n", "column `axis`: axis is `w`"),
        ("load,force,constraint,axis\n1,,clamp,x\n", "column `force`: nothing is given"),
        ("vertex,ux\n3,0.1,7\n", "in every row as many cells"),
    ];
    for (text, expected) in cases {
        let found = message(text, "young");
        assert!(found.contains(expected), "{text:?}: `{expected}` is not in {found}");
        assert!(found.contains("data0.csv"), "{found}");
    }
    let good = "vertex,ux\n3,0.1\n";
    for (what, expected) in [
        ("yuong", "no parameter `yuong`; did you mean `young`"),
        ("young:nowhere", "neither a group of cells nor cell data `nowhere`"),
        ("baar/young", "no body `baar`"),
    ] {
        let found = message(good, what);
        assert!(found.contains(expected), "`{expected}` is not in {found}");
    }
    let twice = fit_texts(&scene, &[good], &["young", "young:tissue"]).unwrap_err().to_string();
    assert!(twice.contains("shares elements with `young`"), "{twice}");
    let corner = "x,y,z,ux\n0.2,0.04,0.04,0.1\n";
    let few = fit_texts(&scene, &[corner], &["young", "poisson"]);
    assert!(matches!(few, Err(DataFitError::TooFew { observations: 1, parameters: 2 })));
    for (bounds, expected) in [
        ("young", "no `=`"),
        ("young=1..x", "no range"),
        ("young=5..1", "out of range"),
        ("young=1..2", "starts `young` at 25000, outside"),
        ("poisson=0.1..0.2", "`poisson` is not fitted"),
    ] {
        let request = DataFitRequest {
            data: vec![folder.join("data0.csv")],
            fit: vec!["young".into()],
            bounds: vec![bounds.into()],
            ..Default::default()
        };
        let found = fit(&scene, &request).unwrap_err().to_string();
        assert!(found.contains(expected), "`{expected}` is not in {found}");
    }
    let mut touched = scene.clone();
    touched.scene.tools.push(Default::default());
    let found = fit_texts(&touched, &[good], &["young"]).unwrap_err().to_string();
    assert!(found.contains("tools, pulls, contacts, threads or clips"), "{found}");
    let mut dynamic = scene.clone();
    dynamic.scene.mode = sinew_scene::scene::Mode::Dynamic;
    let found = fit_texts(&dynamic, &[good], &["young"]).unwrap_err().to_string();
    assert!(found.contains("mode = \"static\""), "{found}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn bounds_hold_and_are_told() {
    let folder = folder("bounds");
    let bar = |material| Bar { model: "svk_comp", material, rest: PULL }.scene(&folder);
    let (table, _) = simulate(&bar(TRUE), &[1.0], 0.0);
    let data = folder.join("bounded.csv");
    std::fs::write(&data, table).unwrap();
    let mut request = DataFitRequest {
        data: vec![data],
        fit: vec!["young".into(), "poisson".into()],
        bounds: vec!["young=5e3..5e4".into(), "poisson=0.1..0.45".into()],
        ..Default::default()
    };
    let report = fit(&bar(WRONG), &request).unwrap();
    near(report.parameters[0].value, 2.5e4, 1e-6);
    near(report.parameters[1].value, 0.42, 1e-6);
    request.bounds[1] = "poisson=0.1..0.3".into();
    let report = fit(&bar(WRONG), &request).unwrap();
    assert!(report.parameters[1].value <= 0.3, "{report}");
    assert!(codes(&report).contains(&"fit.bound"), "{report}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_example_is_fitted() {
    let scene = LoadedScene::read(&scene_folder().join("fit_bar.toml")).unwrap();
    let request = DataFitRequest {
        data: vec![scene_folder().join("fit_bar.csv")],
        fit: vec!["young".into(), "poisson".into()],
        ..Default::default()
    };
    let report = fit(&scene, &request).unwrap();
    assert!(report.converged, "{report}");
    for (p, truth) in report.parameters.iter().zip([12e3, 0.45]) {
        let [low, high] = p.confidence_95.unwrap();
        assert!(low < truth && truth < high, "{report}");
    }
    // positions are those of vertices to the digits in the file
    assert!(report.data[0].file.farthest_vertex < 1e-6);
}

/// The data of the example are those of its scene; with `SINEW_DATA=write` in the environment they are written.
#[test]
fn data_of_the_example() {
    let mut scene = LoadedScene::read(&scene_folder().join("fit_bar.toml")).unwrap();
    let material = &mut scene.scene.bodies[0].material;
    (material.young_modulus, material.poisson_ratio) = (Some(12e3), Some(0.45));
    let (rest, found) = equilibria(&scene, &[0.5, 1.0]);
    let largest = found[1].1.iter().map(|u| u.length()).fold(0.0, f64::max);
    let mut random = Noise(2);
    let mut text = String::from(
        "# Rest positions and displacements (m) of markers on the top of the bar of fit_bar.toml, at half\n\
         # and at full load; made by\n\
         # SINEW_DATA=write cargo test -p sinew-tune --test fit_data data_of_the_example\n\
         x,y,z,ux,uy,uz,load\n",
    );
    for (load, displacements, _) in found {
        let top = rest.iter().zip(&displacements).filter(|(x, _)| x.z > 0.0199 && x.x > 0.001);
        for (x, u) in top {
            let u = *u + 0.005 * largest * random.vector();
            let place = format!("{:.6},{:.6},{:.6}", x.x, x.y, x.z);
            writeln!(text, "{place},{:.4e},{:.4e},{:.4e},{load}", u.x, u.y, u.z).unwrap();
        }
    }
    let file = scene_folder().join("fit_bar.csv");
    if std::env::var("SINEW_DATA").is_ok_and(|value| value == "write") {
        std::fs::write(&file, &text).unwrap();
    }
    let numbers = |text: &str| -> Vec<f64> {
        let rows = text.lines().filter(|line| !line.starts_with(['#', 'x']));
        rows.flat_map(|line| line.split(',').map(|word| word.parse().unwrap())).collect()
    };
    let (made, found) = (numbers(&text), numbers(&std::fs::read_to_string(&file).unwrap()));
    assert_eq!(made.len(), found.len());
    // the last of five digits depends on the instruction set; small components are differences of large ones
    let close = |(a, b): (&f64, &f64)| (a - b).abs() <= 2e-4 * a.abs() + 1e-5 * largest;
    assert!(made.iter().zip(&found).all(close), "{}", file.display());
}
