//! How much a step and the tasks of a host suffer from each other, by what Sinew's threads do: the table of
//! `docs/bevy.md`. A host keeps all threads of a pool of its own busy, one per core, and makes a step of
//! 4 800 tetrahedra 60 times a second. Run with `--release`; nothing else should run.

#![allow(clippy::print_stdout, reason = "prints a table")]

use bevy_app::{App, TaskPoolPlugin, Update};
use bevy_asset::{AssetPlugin, Assets};
use bevy_ecs::prelude::*;
use bevy_tasks::TaskPoolBuilder;
use bevy_transform::TransformPlugin;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::workers::Threads;
use sinew::prelude::*;
use sinew_bevy::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::task::Poll;
use std::time::{Duration, Instant};

const FRAME: Duration = Duration::from_micros(16_667);
const FRAMES: usize = 90;
const ROUNDS: usize = 7;

/// Start of the step, and times (s) of all.
#[derive(Resource, Default)]
struct Times(Option<Instant>, Vec<f64>);

/// An app with a body that swings, and a step in every `Update`.
fn app(threads: Threads) -> Result<App, Box<dyn std::error::Error>> {
    let mut app = App::new();
    app.add_plugins((TaskPoolPlugin::default(), TransformPlugin, AssetPlugin::default()));
    let engine = SinewPlugins { threads, ..Default::default() };
    app.add_plugins(SinewBevyPlugins { engine }.in_schedule(Update));
    app.init_resource::<Times>();
    app.world_mut().resource_mut::<StepClock>().dt = FRAME.as_secs_f64();
    app.add_systems(
        Update,
        (
            (|mut times: ResMut<Times>| times.0 = Some(Instant::now()))
                .in_set(SimulationSystems::Prepare),
            (|mut times: ResMut<Times>| {
                if let Some(start) = times.0.take() {
                    times.1.push(start.elapsed().as_secs_f64());
                }
            })
            .in_set(SimulationSystems::Writeback),
        ),
    );
    let mesh = SoftMesh::new(box_tets(DVec3::new(0.2, 0.1, 0.08), [10, 10, 8])?)?;
    let mesh = app.world_mut().resource_mut::<Assets<SoftMesh>>().add(mesh);
    let body = SinewBody::new(mesh, preset("liver")?.material);
    let body = app.world_mut().spawn((body, SinewMeshSync::default())).id();
    app.world_mut().spawn((SinewHold::new("x0"), ChildOf(body)));
    (0..20).for_each(|_| app.update());
    Ok(app)
}

/// Tasks that keep every core busy, in a pool like those of Bevy; pieces of work done.
fn busy(cores: usize, stop: &Arc<AtomicBool>, done: &Arc<AtomicU64>) -> bevy_tasks::TaskPool {
    let pool = TaskPoolBuilder::new().num_threads(cores).thread_name("host".into()).build();
    for _ in 0..4 * cores {
        let (stop, done) = (stop.clone(), done.clone());
        pool.spawn(async move {
            let mut x = 1.0_f64;
            while !stop.load(Ordering::Relaxed) {
                for _ in 0..20_000 {
                    x = std::hint::black_box(x * 1.000_000_1 + 1e-9);
                }
                done.fetch_add(1, Ordering::Relaxed);
                // other tasks of the pool may go on
                let mut is_first = true;
                std::future::poll_fn(|context| {
                    context.waker().wake_by_ref();
                    if std::mem::take(&mut is_first) { Poll::Pending } else { Poll::Ready(()) }
                })
                .await;
            }
        })
        .detach();
    }
    pool
}

/// Frames of a variant; times of its steps (s), and pieces of the host's work a second.
fn run(app: Option<&mut App>, cores: usize, is_busy: bool) -> (Vec<f64>, f64) {
    let (stop, done) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
    let pool = is_busy.then(|| busy(cores, &stop, &done));
    let mut app = app;
    if let Some(app) = &mut app {
        app.world_mut().resource_mut::<Times>().1.clear();
    }
    let start = Instant::now();
    for frame in 1..=FRAMES as u32 {
        if let Some(app) = &mut app {
            app.update();
        }
        std::thread::sleep((frame * FRAME).saturating_sub(start.elapsed()));
    }
    let rate = done.load(Ordering::Relaxed) as f64 / start.elapsed().as_secs_f64();
    stop.store(true, Ordering::Relaxed);
    drop(pool);
    let times = app.map_or(Vec::new(), |app| app.world().resource::<Times>().1.clone());
    (times, rate)
}

fn quantile(times: &mut [f64], part: f64) -> f64 {
    times.sort_by(f64::total_cmp);
    1e3 * times[((times.len() - 1) as f64 * part) as usize]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let cores = std::thread::available_parallelism()?.get();
    let all = |pinned, awake| Threads { count: cores, pinned, awake };
    let mut variants = vec![
        ("all, pinned, awake", all(true, true)),
        ("all, pinned", all(true, false)),
        ("all, awake", all(false, true)),
        ("all", all(false, false)),
    ];
    if cores > 2 {
        for (name, count) in [("one less", cores - 1), ("half", cores / 2)] {
            variants.push((name, Threads { count, pinned: false, awake: false }));
            let awake = Threads { count, pinned: false, awake: true };
            variants
                .push((if count < cores - 1 { "half, awake" } else { "one less, awake" }, awake));
        }
    }
    variants.push(("1", 1.into()));
    let mut apps = Vec::new();
    for (name, threads) in variants {
        apps.push((name, app(threads)?, [Vec::new(), Vec::new()], Vec::new()));
    }
    // by rounds, so that what else the machine does meets all alike
    let mut undisturbed = Vec::new();
    for _ in 0..ROUNDS {
        undisturbed.push(run(None, cores, true).1);
        for (_, app, times, rates) in &mut apps {
            times[0].extend(run(Some(app), cores, false).0);
            let (busy, rate) = run(Some(app), cores, true);
            times[1].extend(busy);
            rates.push(rate);
        }
    }
    let median = |values: &mut Vec<f64>| quantile(values, 0.5) / 1e3;
    let undisturbed = median(&mut undisturbed);
    println!("{cores} cores, {ROUNDS} rounds of {FRAMES} frames");
    println!(
        "| threads | step, idle host (median, 95 %) | step, busy host (median, 95 %) | host's work |"
    );
    println!("|---|---|---|---|");
    for (name, _, [idle, busy], rates) in &mut apps {
        let [a, b] = [quantile(idle, 0.5), quantile(idle, 0.95)];
        let [c, d] = [quantile(busy, 0.5), quantile(busy, 0.95)];
        let left = 100.0 * median(rates) / undisturbed;
        println!("| {name} | {a:.2}, {b:.2} ms | {c:.2}, {d:.2} ms | {left:.0} % |");
    }
    Ok(())
}
