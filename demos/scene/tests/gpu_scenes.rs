//! Scenes on a graphics processor against the same scenes on the processor. On a machine without an adapter
//! they are skipped with a message.

use crate::common::says;
use glam::DVec3;
use sinew::gpu::{GpuBackend, GpuError, GpuOptions};
use sinew::models::body::Evaluation;
use sinew::prelude::{Integrator, Precision};
use sinew::simulation::Backend;
use sinew_scene::assemble::{BuildOptions, BuiltBody, build};
use sinew_scene::error::RunError;
use sinew_scene::run::{RunOptions, Silent, run};
use sinew_scene::scene::LoadedScene;
use std::path::Path;

#[allow(clippy::print_stderr, reason = "a skipped test says so, a comparison its figures")]
fn say(message: &str) {
    eprintln!("{message}");
}

fn adapter() -> bool {
    match GpuBackend::new(&GpuOptions::default()) {
        Ok(_) => true,
        Err(GpuError::Adapter(error)) => {
            say(&format!("skipped: no GPU adapter ({error})"));
            false
        }
        Err(error) => panic!("{error}"),
    }
}

fn scene(name: &str) -> LoadedScene {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes");
    LoadedScene::read(&folder.join(name).with_extension("toml")).unwrap()
}

/// Displacements after `steps` steps, largest difference from those of the processor in `f64` over their largest
/// length: of the device, and of the processor in `f32`.
fn differences(name: &str, mut loaded: LoadedScene, steps: u64) -> Option<[f64; 2]> {
    if !adapter() {
        return None;
    }
    // differences of the solvers' last digits would hide those of the arithmetic
    loaded.scene.solver.linear_tolerance = 1e-5;
    // what "auto" stands for on the device
    loaded.scene.solver.integrator = Integrator::Safe;
    let ways = [
        (Backend::Cpu, Precision::F64),
        (Backend::Gpu, Precision::F64),
        (Backend::Cpu, Precision::F32),
    ];
    let [truth, gpu, single] = ways.map(|(backend, precision)| {
        let (backend, precision) = (Some(backend), Some(precision));
        let options = BuildOptions { backend, precision, ..BuildOptions::default() };
        let mut built = build(&loaded, &options).unwrap();
        assert_eq!(Some(built.simulation.backend()), backend);
        let (mut iterations, mut residual) = (0, 0.0_f64);
        for step in 0..steps {
            if let Err(error) = built.simulation.step() {
                panic!("{name}, {backend:?}, step {step}: {error}");
            }
            iterations += built.simulation.report().cg_iterations;
            residual = residual.max(built.simulation.report().cg_residual);
        }
        say(&format!(
            "{name} {backend:?} {precision:?}: {iterations} iterations, residual {residual:.1e}"
        ));
        let of = |body: &BuiltBody| built.simulation.displacements(body.handle);
        built.bodies.iter().flat_map(of).collect::<Vec<_>>()
    });
    let largest = truth.iter().map(|u| u.length()).fold(0.0, f64::max);
    let apart = |(a, b): (&DVec3, &DVec3)| (*a - *b).length();
    let found =
        [gpu, single].map(|u| u.iter().zip(&truth).map(apart).fold(0.0, f64::max) / largest);
    say(&format!(
        "{name}: GPU {:.1e}, CPU f32 {:.1e} of the largest displacement after {steps} steps",
        found[0], found[1]
    ));
    Some(found)
}

/// The device is within `bound` of `f64`, or no worse than twice what `f32` costs on the processor.
fn check(name: &str, loaded: LoadedScene, steps: u64, bound: f64) {
    if let Some([gpu, single]) = differences(name, loaded, steps) {
        assert!(gpu < bound.max(2.0 * single), "{name}: {gpu:.1e}, CPU in f32 {single:.1e}");
    }
}

macro_rules! scenes {
    ($($test:ident: $name:literal, $steps:literal steps, $bound:literal;)+) => {$(
        #[test]
        fn $test() {
            check($name, scene($name), $steps, $bound);
        }
    )+};
}

scenes! {
    cantilever: "cantilever", 30 steps, 1e-4;
    liver: "liver", 40 steps, 1e-5;
    crush: "crush", 110 steps, 1e-5;
    bar_of_hexahedra_beside_one_of_springs_and_a_hammock: "elements", 30 steps, 1e-4;
    fibre_bar: "fibre_bar", 20 steps, 1e-4;
    muscle_bar: "muscle_bar", 30 steps, 1e-4;
    ventricle: "ventricle", 20 steps, 1e-4;
    membrane_drum: "membrane_drum", 20 steps, 1e-4;
}

#[test]
fn crush_with_pooled_springs() {
    let mut loaded = scene("crush");
    for body in &mut loaded.scene.bodies {
        body.evaluation = Evaluation::Pooled;
    }
    check("crush, pooled", loaded, 110, 1e-5);
}

#[test]
fn a_run_reports_the_device() {
    if !adapter() {
        return;
    }
    let steps = Some(3);
    let build = BuildOptions { backend: Some(Backend::Gpu), steps, ..BuildOptions::default() };
    let options = RunOptions { build, ..RunOptions::default() };
    let summary = run(&scene("cantilever"), &options, &mut Silent).unwrap();
    assert!(summary.completed, "{:?}", summary.failure);
    assert_eq!(summary.settings.backend, "gpu");
    let gpu = summary.gpu.as_ref().unwrap();
    assert!(gpu.host_s > 0.0 && gpu.bytes_down > 0 && !gpu.adapter.is_empty());
    assert!(summary.to_string().contains(&gpu.adapter));
}

#[test]
fn what_the_device_does_not_have_is_refused_before_the_first_step() {
    if !adapter() {
        return;
    }
    let options = BuildOptions { backend: Some(Backend::Gpu), ..BuildOptions::default() };
    let error = build(&scene("static_beam"), &options).err().map(RunError::from).unwrap();
    says(&error.to_string(), &["quasi-static", "safe"]);
}
