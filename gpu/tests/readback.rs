//! The state comes down after every step, or when somebody asks: the bits are the same.

use crate::common::shared::Shortcuts;
use crate::common::{MATERIAL, beam, cut_notch, device, hold, noise, of, say, scramble};
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::engine::vertex::Position;
use sinew::models::axes::description::{AxesDescription, AxisFamily};
use sinew::models::axes::muscle::{ActivationWork, MuscleSettings};
use sinew::prelude::*;
use sinew::simulation::Readback;
use sinew_gpu::{GpuOptions, GpuReport};

/// One scene for both ways: builds a body and says what happens between steps.
type Scene<'a> = &'a dyn Fn(&mut Simulation, BodyHandle, &Mesh, usize);

/// What a run leaves behind.
#[derive(Debug, PartialEq)]
struct Run {
    hashes: Vec<u64>,
    volumes: Vec<(u64, f64)>,
    reports: Vec<String>,
    positions: Vec<DVec3>,
}

/// Runs a scene; with the steps in which the state came down.
fn run(
    mesh: &Mesh,
    description: &BodyDescription<'_>,
    readback: Readback,
    steps: usize,
    ask: usize,
    scene: Scene<'_>,
) -> Option<(Run, Vec<GpuReport>)> {
    let backend = device(&GpuOptions::default())?;
    let options = SimulationOptions { readback, ..SimulationOptions::default() };
    let mut simulation = Simulation::with_gpu(options, backend).unwrap();
    let body = simulation.add_body(description).unwrap();
    simulation
        .set_solver(SolverSettings { integrator: Integrator::Safe, ..SolverSettings::default() });
    let mut run = Run { hashes: vec![], volumes: vec![], reports: vec![], positions: vec![] };
    let mut device = Vec::new();
    for step in 0..steps {
        scene(&mut simulation, body, mesh, step);
        simulation.step().unwrap();
        device.push(simulation.world().resource::<GpuReport>().clone());
        let volumes = simulation.volume_report();
        run.volumes.push((volumes.inverted, volumes.smallest_ratio));
        let muscles = simulation.world().get_resource::<ActivationWork>();
        run.reports.push(format!("{:?} {muscles:?}", simulation.report()));
        if (step + 1) % ask == 0 {
            run.hashes.push(simulation.state_hash());
        }
    }
    let world = simulation.world_mut();
    run.positions.extend(world.query::<&Position>().iter(world).map(|p| p.0));
    Some((run, device))
}

#[test]
fn same_bits_however_the_state_is_read() {
    let mesh = beam([8, 3, 3]);
    // a constraint that begins on the way, where vertices happen to be then
    let late = |s: &mut Simulation, body: BodyHandle, mesh: &Mesh, step: usize| {
        if step == 0 {
            hold(s, body, mesh, "x0");
            let rows = s.group_rows(body, mesh, "x1").unwrap();
            let motion = Motion::Translate(DVec3::new(0.0, 0.0, 0.02));
            let ramp = Curve::ramp(0.055, 0.155);
            let mut pull = Constraint::moving("pull", rows, motion, ramp);
            pull.from = 0.055;
            pull.until = 0.105;
            s.add_constraint(pull);
        }
    };
    // things done from outside between steps
    let outside = |s: &mut Simulation, body: BodyHandle, mesh: &Mesh, step: usize| match step {
        0 => hold(s, body, mesh, "x0"),
        3 => {
            let v: Vec<_> = s.velocities(body).iter().map(|v| *v + DVec3::Y * 0.1).collect();
            let u = s.displacements(body);
            s.set_state(body, &u, &v).unwrap();
        }
        6 => cut_notch(s, body, mesh),
        8 => {
            s.set_material(body, YoungPoisson { young_modulus: 2e4, ..MATERIAL }).unwrap();
        }
        _ => {}
    };
    // inside out and back
    let scrambled = |s: &mut Simulation, body: BodyHandle, mesh: &Mesh, step: usize| {
        if step == 0 {
            scramble(s, body, mesh);
        }
    };
    let along = [DVec3::X];
    let curve = Some(Curve::ramp(0.01, 0.04));
    let muscle = Some(MuscleSettings { peak_stress: 2e3, curve, ..MuscleSettings::default() });
    let family = AxisFamily { muscle, ..AxisFamily::new("m", &along, 3e3) };
    let muscle = BodyDescription {
        axes: Some(AxesDescription { families: vec![family], ..AxesDescription::default() }),
        ..of(&mesh, Model::CompressibleStVK)
    };
    let scenes: [(&str, BodyDescription<'_>, usize, Scene<'_>); 5] = [
        ("constraint that begins", of(&mesh, Model::CompressibleStVK), 14, &late),
        ("changes from outside", of(&mesh, Model::Corotational), 12, &outside),
        ("scrambled", of(&mesh, Model::CompressibleStVK), 40, &scrambled),
        ("springs, whose volumes the processor has", of(&mesh, Model::MassSpring), 6, &late),
        ("muscle, whose work is found from the columns before a step", muscle, 6, &late),
    ];
    for (name, description, steps, scene) in scenes {
        // both ask now and then; what is asked for must not matter
        let ways = [(Readback::EveryStep, 2), (Readback::OnDemand, 2), (Readback::OnDemand, 1)];
        let mut runs = Vec::new();
        for (readback, ask) in ways {
            let Some(found) = run(&mesh, &description, readback, steps, ask, scene) else { return };
            runs.push(found);
        }
        let read: Vec<usize> =
            runs.iter().map(|(_, device)| device.iter().filter(|r| r.state_read).count()).collect();
        say(&format!("{name}: of {steps} steps brought the state down: {read:?}"));
        assert_eq!(read[0], steps);
        let always = name.contains("the processor");
        assert_eq!(read[1], if always { steps } else { 0 }, "{name}");
        assert_eq!(runs[0].0, runs[1].0, "{name}");
        assert_eq!(runs[0].0.positions, runs[2].0.positions, "{name}");
        assert_eq!(runs[0].0.volumes, runs[2].0.volumes, "{name}");
        let every_second: Vec<u64> = runs[2].0.hashes.iter().skip(1).step_by(2).copied().collect();
        assert_eq!(runs[0].0.hashes, every_second, "{name}");
        if name == "scrambled" {
            assert!(runs[0].0.volumes[0].0 > 0 && runs[0].0.volumes[39].0 == 0);
        }
    }
}

#[test]
fn volume_ratios_are_those_of_the_processor() {
    let mesh = beam([8, 3, 3]);
    let Some(backend) = device(&GpuOptions::default()) else { return };
    let options =
        SimulationOptions { readback: Readback::OnDemand, ..SimulationOptions::default() };
    let mut simulation = Simulation::with_gpu(options, backend).unwrap();
    let bodies = ["one", "two"].map(|name| {
        let body = simulation.add_body(&BodyDescription::new(name, &mesh, MATERIAL)).unwrap();
        hold(&mut simulation, body, &mesh, "x0");
        body
    });
    simulation.set_solver(SolverSettings {
        integrator: Integrator::Safe,
        recovery: false,
        ..SolverSettings::default()
    });
    let u: Vec<_> = (0..mesh.points.len()).map(|i| 0.02 * noise(i)).collect();
    simulation.displace(bodies[1], &u);
    simulation.step().unwrap();
    let report = simulation.volume_report().clone();
    for body in bodies {
        let ratios = simulation.volume_ratios(body);
        let inverted = ratios.iter().filter(|&&j| j <= 0.0).count() as u64;
        let smallest = ratios.iter().copied().fold(f64::INFINITY, f64::min);
        assert_eq!(report.inverted_by_body[body.0], inverted);
        assert_eq!(report.elements_by_body[body.0], ratios.len() as u64);
        let found = report.smallest_by_body[body.0];
        assert!((found - smallest).abs() < 1e-5 * smallest.abs().max(1.0), "{found} {smallest}");
    }
    assert!(report.inverted_by_body[0] == 0 && report.inverted_by_body[1] > 10);
    assert_eq!(report.inverted, report.inverted_by_body[1]);
    assert_eq!(report.smallest_ratio, report.smallest_by_body[1]);
}

#[test]
fn bytes_of_a_step() {
    let mesh = beam([12, 4, 4]);
    let still = |s: &mut Simulation, body: BodyHandle, mesh: &Mesh, step: usize| {
        if step == 0 {
            hold(s, body, mesh, "x0");
        }
    };
    let down = [Readback::EveryStep, Readback::OnDemand].map(|readback| {
        let (_, reports) =
            run(&mesh, &of(&mesh, Model::CompressibleStVK), readback, 4, 99, &still)?;
        Some(reports[3].bytes_down)
    });
    let [Some(every), Some(lean)] = down else { return };
    say(&format!("{} vertices: {every} bytes down a step, {lean} on demand", mesh.points.len()));
    assert_eq!(every - lean, 32 * mesh.points.len() as u64);
    assert!(lean < 4096, "{lean}");
}
