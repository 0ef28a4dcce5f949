//! `sinew render`.

use crate::BuildArguments;
use crate::progress::Progress;
use clap::Args;
use sinew::prelude::{Integrator, Model};
use sinew_cli::{Outcome, choice, print};
#[cfg(feature = "render")]
use sinew_render::adapter::AdapterRequest;
use sinew_render::camera::CameraRequest;
#[cfg(feature = "render")]
use sinew_scene::picture::gallery;
use sinew_scene::picture::{Quantity, RenderJob, Variant, render};
use sinew_scene::run::{Observer, Silent};
use sinew_scene::scene::LoadedScene;
use sinew_tune::advise::Choice;
use std::path::PathBuf;

#[derive(Args)]
pub struct RenderArguments {
    /// Scene file (TOML).
    #[arg(required_unless_present = "gallery")]
    scene: Option<PathBuf>,
    /// Instead of a scene: draw every scene that ships into a folder, and write a page in Markdown beside it.
    #[arg(long, value_name = "DIR", conflicts_with = "scene")]
    gallery: Option<PathBuf>,
    /// Folder for one PNG per frame.
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// Film (.mp4, .webm, .gif ... by an ffmpeg on the path; an animated PNG without).
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// One picture (PNG).
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Page with an interactive player; needs no graphics adapter.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Another scene, shown beside this one at the same times; may be given several times.
    #[arg(long, value_name = "SCENE")]
    beside: Vec<PathBuf>,
    /// Energies of all bodies, each shown beside the others, such as svk,svk_comp,corotational.
    #[arg(long, value_delimiter = ',', value_parser = choice::<Model>, conflicts_with_all = ["beside", "model"])]
    models: Vec<Model>,
    /// Time (s) of that picture, of a static scene the share of the loads [default: the end].
    #[arg(long, value_name = "S", requires = "picture")]
    at: Option<f64>,
    /// Frames in all [default: those of the scene's output].
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..))]
    frames: Option<u32>,
    /// Width and height (pixels).
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: [u32; 2],
    /// Colours: displacement, strain, stress, energy, volume (or J), pressure (of contact), error (against a quarter of the
    /// step) or none.
    #[arg(long, visible_alias = "colour", default_value = "displacement", value_parser = quantity)]
    color: Quantity,
    /// AZIMUTH,ELEVATION[,FACTOR on the fitting distance] in degrees, or eye and target X,Y,Z,X,Y,Z in metres
    /// [default: 25,18].
    #[arg(long, allow_hyphen_values = true, value_parser = camera)]
    camera: Option<CameraRequest>,
    /// Part of the name of a graphics adapter, or `software`.
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Lines along sharp edges.
    #[arg(long)]
    edges: bool,
    /// No ground.
    #[arg(long)]
    no_ground: bool,
    /// No shape at rest.
    #[arg(long)]
    no_ghost: bool,
    /// Energy of all bodies.
    #[arg(long, value_parser = choice::<Model>)]
    model: Option<Model>,
    /// Time integrator.
    #[arg(long, value_parser = choice::<Integrator>)]
    integrator: Option<Integrator>,
    #[command(flatten)]
    build: BuildArguments,
    /// No progress bar and no report.
    #[arg(long, short)]
    quiet: bool,
}

pub fn size(text: &str) -> Result<[u32; 2], String> {
    let numbers = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    numbers.ok_or_else(|| format!("`{text}` is no size; give WIDTHxHEIGHT such as 1280x720"))
}

pub fn quantity(text: &str) -> Result<Quantity, String> {
    text.parse().map_err(|e: sinew_render::RenderError| e.to_string())
}

fn camera(text: &str) -> Result<CameraRequest, String> {
    text.parse().map_err(|e: sinew_render::RenderError| e.to_string())
}

/// The adapter of a word on the command line.
#[cfg(feature = "render")]
pub fn adapter(word: Option<&str>) -> AdapterRequest {
    match word {
        Some("software") => AdapterRequest { software: Some(true), ..AdapterRequest::default() },
        name => AdapterRequest { name: name.map(str::to_owned), ..AdapterRequest::default() },
    }
}

pub fn render_scene(arguments: RenderArguments) -> Outcome {
    #[cfg(not(feature = "render"))]
    if arguments.gallery.is_some() {
        return Err(sinew_render::RenderError::NoPictures("--gallery").into());
    }
    #[cfg(feature = "render")]
    let adapter = adapter(arguments.adapter.as_deref());
    #[cfg(feature = "render")]
    if let Some(folder) = &arguments.gallery {
        let files = gallery(folder, &adapter, |what| eprintln!("{what}"))?;
        eprintln!("{} files written to {}", files.len(), folder.display());
        return Ok(true);
    }
    let path = arguments.scene.unwrap_or_default();
    let mut scene = LoadedScene::read(&path)?;
    let replaced =
        Choice { integrator: arguments.integrator, model: arguments.model, ..Choice::default() };
    replaced.apply(&mut scene);
    let with = |scene: &LoadedScene, model: Model| {
        let mut scene = scene.clone();
        Choice { model: Some(model), ..Choice::default() }.apply(&mut scene);
        Variant { label: model.name().into(), scene }
    };
    let mut label = String::new();
    let mut beside = Vec::new();
    if let Some((first, others)) = arguments.models.split_first() {
        beside.extend(others.iter().map(|&model| with(&scene, model)));
        Variant { label, scene } = with(&scene, *first);
    }
    for path in &arguments.beside {
        let mut scene = LoadedScene::read(path)?;
        replaced.apply(&mut scene);
        beside.push(Variant { label: scene.scene.name.clone(), scene });
    }
    let job = RenderJob {
        build: arguments.build.options(),
        frames: arguments.frames.map(|n| n as usize),
        size: arguments.size,
        png: arguments.png,
        video: arguments.video,
        picture: arguments.picture,
        html: arguments.html,
        label,
        beside,
        at: arguments.at,
        small: false,
        quantity: arguments.color,
        camera: arguments.camera.unwrap_or_default(),
        #[cfg(feature = "render")]
        adapter,
        edges: arguments.edges,
        no_ground: arguments.no_ground,
        no_ghost: arguments.no_ghost,
    };
    let mut progress = Progress::default();
    let observer: &mut dyn Observer = if arguments.quiet { &mut Silent } else { &mut progress };
    let (report, summary) = render(&scene, &job, observer)?;
    if !arguments.quiet {
        print(format_args!("{report}"))?;
    }
    if let Some(failure) = &summary.failure {
        eprintln!("error: {}: {failure}", path.display());
    }
    Ok(summary.completed)
}
