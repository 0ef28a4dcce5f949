//! The gallery: a small picture for every scene that ships, and a page that shows them.

use super::job::{RenderJob, RenderJobError, render};
use super::quantity::Quantity;
use crate::error::RunError;
use crate::run::Silent;
use crate::scene::LoadedScene;
use crate::shipped_scene;
use serde::Deserialize;
use sinew_render::RenderError;
use sinew_render::adapter::AdapterRequest;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The list of pictures, which says what its keys mean.
const LIST: &str = include_str!("gallery.toml");

#[derive(Deserialize)]
struct Gallery {
    picture: Vec<GalleryEntry>,
}

#[derive(Deserialize)]
struct GalleryEntry {
    scene: String,
    at: f64,
    quantity: Quantity,
    camera: String,
    words: String,
}

/// Size (pixels) of pictures of scenes.
const SIZE: [u32; 2] = [600, 338];

/// Draws all pictures into a folder, which is made, and writes a page in Markdown beside it, under the name of
/// the folder; returns the files. `tell` hears what is going on.
///
/// # Errors
/// When there is no adapter, a scene cannot be run or a file cannot be written.
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
    let mut page = format!(
        "# Gallery\n\nEvery scene in `demos/scenes`, drawn off-screen by `sinew render`. This command draws everything again:\n\n\
         ```\ncargo run --release -p sinew-cli --features render -- render --gallery docs/{name}\n```\n"
    );
    let mut files = Vec::new();
    let list: Gallery = toml::from_str(LIST).map_err(|e| RenderError::Option {
        option: "--gallery",
        found: e.to_string(),
        remedy: "correct the list of pictures".into(),
    })?;
    for entry in list.picture {
        tell(&entry.scene);
        let scene = LoadedScene::read(&shipped_scene(&entry.scene)).map_err(RunError::from)?;
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
        render(&scene, &job, &mut Silent)?;
        let (scene, words) = (entry.scene, entry.words);
        let _ = write!(
            page,
            "\n## {scene}\n\n{words} Scene: [`{scene}.toml`](../demos/scenes/{scene}.toml).\n\n\
             ![{scene}]({name}/{scene}.png)\n"
        );
        files.push(path);
    }
    let path = folder.with_extension("md");
    std::fs::write(&path, page).map_err(|e| error(&path, e))?;
    files.push(path);
    Ok(files)
}
