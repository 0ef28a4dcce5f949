//! The gallery: a small picture for every scene that ships, a page that shows them, and the figures that they print.

use super::capture::CaptureOptions;
#[cfg(feature = "render")]
use super::draw::draw;
#[cfg(feature = "render")]
use super::figures::{FIGURES, scenes_table, with_block};
use super::figures::{GalleryFigures, SceneFigures};
#[cfg(feature = "render")]
use super::job::{RenderJob, RenderReport};
use super::job::{RenderJobError, record};
use super::quantity::Quantity;
use crate::assemble::BuildOptions;
use crate::error::RunError;
use crate::run::Silent;
use crate::scene::LoadedScene;
use crate::shipped_scene;
use crate::summary::RunSummary;
use serde::Deserialize;
use sinew::engine::lanes::InstructionSet;
use sinew_render::RenderError;
#[cfg(feature = "render")]
use sinew_render::adapter::{AdapterRequest, open};
use sinew_render::scene::Recording;
use std::fmt::Write;
#[cfg(feature = "render")]
use std::path::{Path, PathBuf};

/// The list of pictures, which says what its keys mean.
const LIST: &str = include_str!("gallery.toml");

#[derive(Deserialize)]
struct Gallery {
    picture: Vec<GalleryEntry>,
}

/// A picture of the gallery.
#[derive(Clone, Debug, Deserialize)]
pub struct GalleryEntry {
    /// Name of the scene.
    pub scene: String,
    /// Time (s), of a static scene a share of the loads.
    pub at: f64,
    /// Colours.
    pub quantity: Quantity,
    /// Camera, as on the command line.
    pub camera: String,
    /// What to look at.
    pub words: String,
}

impl GalleryEntry {
    /// All pictures, in the order of the page.
    ///
    /// # Errors
    /// When the list cannot be read.
    pub fn all() -> Result<Vec<Self>, RenderError> {
        let list: Result<Gallery, _> = toml::from_str(LIST);
        Ok(list
            .map_err(|e| RenderError::Option {
                option: "--gallery",
                found: e.to_string(),
                remedy: "correct the list of pictures".into(),
            })?
            .picture)
    }

    /// Runs the scene as for its picture: with portable kernels, which give the same bits on every machine.
    ///
    /// # Errors
    /// When the scene cannot be read or built.
    pub fn run(&self) -> Result<(LoadedScene, Recording, RunSummary), RenderJobError> {
        let scene = LoadedScene::read(&shipped_scene(&self.scene)).map_err(RunError::from)?;
        let capture =
            CaptureOptions { quantities: vec![self.quantity], ..CaptureOptions::default() };
        let build = BuildOptions {
            instruction_set: Some(InstructionSet::Portable),
            ..BuildOptions::default()
        };
        let (recording, summary, _) = record(&scene, build, capture, &mut Silent)?;
        Ok((scene, recording, summary))
    }

    /// Runs the scene and finds its figures, without a picture.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn figures(&self) -> Result<SceneFigures, RenderJobError> {
        let (_, recording, summary) = self.run()?;
        Ok(SceneFigures::new(&recording, &summary, self.at))
    }
}

/// The page in Markdown that stands beside a folder of this name.
pub fn gallery_page(name: &str, list: &[GalleryEntry], figures: &GalleryFigures) -> String {
    let mut page = format!(
        "# Gallery\n\nEvery scene in `demos/scenes`, drawn off-screen by `sinew render`. This command draws everything again and \
         writes the figures below\nand those in [numbers.md](numbers.md#scenes) anew; a test compares them with runs:\n\n\
         ```\ncargo run --release -p sinew-cli --features render -- render --gallery docs/{name}\n```\n"
    );
    for GalleryEntry { scene, words, .. } in list {
        let _ = write!(
            page,
            "\n## {scene}\n\n{words} Scene: [`{scene}.toml`](../demos/scenes/{scene}.toml).\n\n\
             ![{scene}]({name}/{scene}.png)\n"
        );
        if let Some(figures) = figures.get(scene) {
            let _ = write!(page, "\n{}\n", figures.words());
        }
    }
    page
}

/// Size (pixels) of pictures of scenes.
#[cfg(feature = "render")]
const SIZE: [u32; 2] = [600, 338];

/// Draws all pictures into a folder, which is made, with the figures that they print; writes a page in Markdown beside
/// it, under the name of the folder, and the table of scenes in `numbers.md` there; returns the files. `tell` hears what
/// is going on.
///
/// # Errors
/// When there is no adapter, a scene cannot be run or a file cannot be written.
#[cfg(feature = "render")]
pub fn gallery(
    folder: &Path,
    adapter: &AdapterRequest,
    mut tell: impl FnMut(&str),
) -> Result<Vec<PathBuf>, RenderJobError> {
    let error = |path: &Path, e: std::io::Error| RenderError::Write {
        path: path.into(),
        reason: e.to_string(),
    };
    std::fs::create_dir_all(folder).map_err(|e| error(folder, e))?;
    let name = folder.file_name().map_or("gallery".into(), |n| n.to_string_lossy().into_owned());
    let mut files = Vec::new();
    let mut all = GalleryFigures::new();
    let list = GalleryEntry::all()?;
    for entry in &list {
        tell(&entry.scene);
        let path = folder.join(format!("{}.png", entry.scene));
        let job = RenderJob {
            size: SIZE,
            picture: Some(path.clone()),
            at: Some(entry.at),
            small: true,
            quantity: entry.quantity,
            camera: entry.camera.parse()?,
            adapter: adapter.clone(),
            ..RenderJob::default()
        };
        let (scene, recording, summary) = entry.run()?;
        if let Some(failure) = summary.failure {
            return Err(RenderJobError::Failed { scene: entry.scene.clone(), failure });
        }
        let mut figures = SceneFigures::new(&recording, &summary, entry.at);
        let gpu = open(adapter).map_err(RenderError::from)?;
        draw(&scene, &job, vec![recording], gpu, &mut RenderReport::default())?;
        figures.drawn(&std::fs::read(&path).map_err(|e| error(&path, e))?);
        all.insert(entry.scene.clone(), figures);
        files.push(path);
    }
    let text = serde_json::to_string_pretty(&all)
        .map_err(|e| RenderError::Empty(format!("figures: {e}")))?;
    let mut texts = vec![
        (folder.join(FIGURES), text + "\n"),
        (folder.with_extension("md"), gallery_page(&name, &list, &all)),
    ];
    let numbers = folder.with_file_name("numbers.md");
    if let Ok(text) = std::fs::read_to_string(&numbers)
        && let Some(text) = with_block(&text, "scenes", &scenes_table(&all))
    {
        texts.push((numbers, text));
    }
    for (path, text) in texts {
        std::fs::write(&path, text).map_err(|e| error(&path, e))?;
        files.push(path);
    }
    Ok(files)
}
