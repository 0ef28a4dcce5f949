//! The gallery: a small picture for every scene that ships, and a page that shows them.

use super::job::{RenderJob, RenderJobError, render};
use super::quantity::Quantity;
use crate::error::RunError;
use crate::run::Silent;
use crate::scene::LoadedScene;
use crate::shipped_scene;
use sinew_render::RenderError;
use sinew_render::adapter::AdapterRequest;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A picture of a scene.
struct GalleryEntry {
    scene: &'static str,
    /// Time (s), of a static scene share of the loads.
    at: f64,
    quantity: Quantity,
    camera: &'static str,
    /// What to look at.
    words: &'static str,
}

const ENTRIES: [GalleryEntry; 19] = [
    GalleryEntry {
        scene: "liver",
        at: 2.0,
        quantity: Quantity::Displacement,
        camera: "25,14",
        words: "A liver-like organ hangs from its ligament (dark) and is pulled by a tool (orange; the arrow \
                is its force).",
    },
    GalleryEntry {
        scene: "liver_resection",
        at: 1.9,
        quantity: Quantity::None,
        camera: "35,14",
        words: "A tool cuts a lobe off; the surface is rebuilt as elements go.",
    },
    GalleryEntry {
        scene: "cantilever",
        at: 0.4,
        quantity: Quantity::Strain,
        camera: "25,12",
        words: "A soft beam, clamped at one end, falls and swings.",
    },
    GalleryEntry {
        scene: "static_beam",
        at: 1.0,
        quantity: Quantity::Stress,
        camera: "22,16",
        words: "Equilibrium under an end load: the stress falls linearly to the end.",
    },
    GalleryEntry {
        scene: "crush",
        at: 1.2,
        quantity: Quantity::Volume,
        camera: "28,10",
        words: "A cube pressed to half its height between sticky plates.",
    },
    GalleryEntry {
        scene: "slender_cylinder",
        at: 0.3,
        quantity: Quantity::Volume,
        camera: "25,10",
        words: "Two very soft cylinders, with (front) and without (back) the compression term.",
    },
    GalleryEntry {
        scene: "membrane_drum",
        at: 0.55,
        quantity: Quantity::Strain,
        camera: "20,24",
        words: "A drum skin blown up to a dome, and a block with a skin under a bell jar.",
    },
    GalleryEntry {
        scene: "elements",
        at: 1.5,
        quantity: Quantity::Displacement,
        camera: "38,24",
        words: "Hexahedra with finite elements, the same bar of springs, and a hammock of quadrilaterals.",
    },
    GalleryEntry {
        scene: "fibre_bar",
        at: 2.0,
        quantity: Quantity::Displacement,
        camera: "18,8",
        words: "Fibres at 45 degrees move a hanging bar sideways.",
    },
    GalleryEntry {
        scene: "muscle_bar",
        at: 0.5,
        quantity: Quantity::Strain,
        camera: "25,18",
        words: "A bar of muscle contracts; the ghost is its rest shape.",
    },
    GalleryEntry {
        scene: "ventricle",
        at: 0.68,
        quantity: Quantity::Strain,
        camera: "25,16",
        words: "A ventricle with helical fibres at the peak of its beat.",
    },
    GalleryEntry {
        scene: "incompressible",
        at: 0.24,
        quantity: Quantity::Displacement,
        camera: "55,20",
        words: "Two beams of a gel of Poisson's ratio 0.4999: plain tetrahedra lock, clusters of them bend.",
    },
    GalleryEntry {
        scene: "palpation",
        at: 2.0,
        quantity: Quantity::Pressure,
        camera: "25,28",
        words: "A finger slides over soft tissue that hides a stiff ball; the arrow is its force on the tissue.",
    },
    GalleryEntry {
        scene: "drag",
        at: 1.6,
        quantity: Quantity::Pressure,
        camera: "25,26",
        words: "A block, drawn as glass over the pressure that it exerts, is dragged over tissue with friction.",
    },
    GalleryEntry {
        scene: "grasp",
        at: 2.3,
        quantity: Quantity::Displacement,
        camera: "25,16",
        words: "Forceps hold the edge of a liver-like organ and lift it.",
    },
    GalleryEntry {
        scene: "press_flat",
        at: 2.8,
        quantity: Quantity::Pressure,
        camera: "25,18",
        words: "An organ between a table and a plate that presses it flat.",
    },
    GalleryEntry {
        scene: "two_organs",
        at: 0.35,
        quantity: Quantity::Displacement,
        camera: "25,18",
        words: "A soft ball has fallen on another one and rolls off; both lie on a table.",
    },
    GalleryEntry {
        scene: "probe_fast",
        at: 0.5,
        quantity: Quantity::Displacement,
        camera: "25,26",
        words: "A ball that came at 10 m/s rests in a slab.",
    },
    GalleryEntry {
        scene: "side_by_side",
        at: 0.4,
        quantity: Quantity::Displacement,
        camera: "30,14",
        words: "A block of gel pulled to the side; four kinds of springs are systems that run side by side.",
    },
];

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
    for entry in &ENTRIES {
        tell(entry.scene);
        let scene = LoadedScene::read(&shipped_scene(entry.scene)).map_err(RunError::from)?;
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
