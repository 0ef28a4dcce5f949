//! `sinew view`.

use crate::BuildArguments;
use crate::render::{adapter, quantity, size};
use clap::Args;
use sinew_cli::{Outcome, print};
use sinew_render::adapter::open;
use sinew_scene::picture::{LiveOptions, LiveView, Quantity};
use sinew_scene::scene::LoadedScene;
use sinew_window::{KEYS, show};
use std::path::PathBuf;

#[derive(Args)]
pub struct ViewArguments {
    /// Scene file (TOML).
    scene: PathBuf,
    /// Width and height (pixels) of the window.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: [u32; 2],
    /// Colours: displacement, strain, stress, energy, volume (or J), pressure (of contact) or none.
    #[arg(long, visible_alias = "colour", default_value = "displacement", value_parser = quantity)]
    color: Quantity,
    /// Stiffness (N/m) of the hand that pulls.
    #[arg(long, value_name = "N/M", default_value_t = 150.0, allow_negative_numbers = true)]
    spring: f64,
    /// Part of the name of a graphics adapter, or `software`.
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Close the window after so many pictures.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pictures: Option<u64>,
    #[command(flatten)]
    build: BuildArguments,
}

pub fn view_scene(arguments: ViewArguments) -> Outcome {
    let ViewArguments { size, color: quantity, spring, .. } = arguments;
    let scene = LoadedScene::read(&arguments.scene)?;
    let gpu = open(&adapter(arguments.adapter.as_deref()))?;
    let options = LiveOptions { build: arguments.build.options(), size, quantity, spring };
    let name = gpu.summary.to_string();
    let view = LiveView::open(&scene, options, gpu)?;
    print(format_args!("{KEYS}\n"))?;
    let (mut view, pictures) = show(view, arguments.pictures)?;
    let (steps, figures) = view.done();
    let built = view.built();
    print(format_args!(
        "{pictures} pictures by {name}; {steps} steps, {:.2} s simulated; {:.2} s behind the clock\n",
        built.simulation.time(),
        figures.dropped.as_secs_f64(),
    ))?;
    for warning in built.all_warnings() {
        print(format_args!("{warning}\n"))?;
    }
    match built.simulation.verdict() {
        Ok(_) => Ok(true),
        Err(why) => {
            eprintln!("error: {}: {why}", arguments.scene.display());
            Ok(false)
        }
    }
}
