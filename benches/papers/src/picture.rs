//! A picture for each of the papers: several models side by side.

use sinew::models::body::Model;
use sinew_render::RenderError;
use sinew_render::adapter::{AdapterRequest, open};
use sinew_render::camera::CameraRequest;
use sinew_render::compare::{Comparison, Grid, Layout, Panel};
use sinew_render::image::Image;
use sinew_scene::assemble::BuildOptions;
use sinew_scene::error::RunError;
use sinew_scene::picture::{CaptureOptions, Quantity, RenderJobError, Variant, nearest, record};
use sinew_scene::run::Silent;
use sinew_scene::scene::LoadedScene;
use sinew_scene::shipped_scene;
use std::path::Path;

/// Panels in a row.
const COLUMNS: usize = 4;

/// What to draw of all of them.
struct Plan<'a> {
    title: &'a str,
    subtitle: &'a str,
    variants: Vec<Variant>,
    quantity: Quantity,
    /// Time (s).
    at: f64,
    panel: [u32; 2],
    camera: CameraRequest,
}

/// A scene that ships, cut down to its first body.
fn first_body(name: &str) -> Result<LoadedScene, RenderJobError> {
    let mut scene = LoadedScene::read(&shipped_scene(name)).map_err(RunError::from)?;
    let s = &mut scene.scene;
    let body = s.bodies.first().map(|b| b.name.clone());
    s.bodies.truncate(1);
    s.constraints.retain(|c| c.body.is_none() || c.body == body);
    s.probes.clear();
    Ok(scene)
}

fn drawn(plan: Plan, adapter: &AdapterRequest) -> Result<Image, RenderJobError> {
    let gpu = open(adapter).map_err(RenderError::from)?;
    let mut panels = Vec::new();
    for Variant { label, mut scene } in plan.variants {
        // nothing later is shown
        scene.scene.duration = Some(plan.at);
        let (quantities, frames) = (vec![plan.quantity], Some(2));
        let capture = CaptureOptions { frames, quantities, ..CaptureOptions::default() };
        let (mut recording, summary, _) =
            record(&scene, BuildOptions::default(), capture, &mut Silent)?;
        let frame = nearest(&recording, None);
        let frame = &mut recording.frames[frame];
        frame.note = match plan.quantity {
            Quantity::Volume => {
                let inverted = summary.volume.inverted_final;
                let (j, s) =
                    (summary.volume.final_smallest_j, if inverted == 1 { "" } else { "s" });
                format!("smallest J {j:.2}, {inverted} inverted element{s}").replace('-', "−")
            }
            _ => {
                let largest = frame.fields[0].iter().copied().fold(0.0f32, f32::max);
                format!("largest displacement {:.1} mm", 1e3 * largest)
            }
        };
        if let Some(failure) = summary.failure {
            frame.note = format!("failed: {failure}");
        }
        panels.push(Panel { label, recording });
    }
    let frames: Vec<usize> = panels.iter().map(|p| nearest(&p.recording, None)).collect();
    let layout = Layout::Panels(panels.len().min(COLUMNS), plan.panel);
    let grid = Grid { title: plan.title, layout, camera: plan.camera, field: Some(0) };
    Ok(Comparison::new(gpu, panels, &grid)?.picture(plan.subtitle, &frames)?)
}

/// Delingette 2008: the slender cylinder under its weight by four energies.
///
/// # Errors
/// When there is no adapter, or a run cannot be carried out.
pub fn paper_a(adapter: &AdapterRequest) -> Result<Image, RenderJobError> {
    let models = [
        ("St Venant-Kirchhoff", Model::StVK),
        ("with compression term", Model::CompressibleStVK),
        ("corotational", Model::Corotational),
        ("neo-Hookean", Model::NeoHookean),
    ];
    let scene = first_body("slender_cylinder")?;
    let variants = models.map(|(label, model)| {
        let mut scene = scene.clone();
        scene.scene.bodies[0].model = model;
        Variant { label: label.into(), scene }
    });
    let plan = Plan {
        title: "A soft cylinder under its weight, by four energies",
        subtitle: "E = 1 kPa, ρ g L / E = 0.98, held at its left end; after 1 s",
        variants: variants.into(),
        quantity: Quantity::Volume,
        at: 1.0,
        panel: [250, 350],
        camera: CameraRequest::Orbit { azimuth: 18.0, elevation: 8.0, distance: 1.0 },
    };
    drawn(plan, adapter)
}

/// A scene of one body.
fn scene(name: &str, text: &str) -> Result<LoadedScene, RenderJobError> {
    Ok(LoadedScene::parse(text, Path::new(name)).map_err(RunError::from)?)
}

/// Natsupakpong & Cavusoglu 2010, tables 1 and 3: the cube of 512 hexahedra, held at a side and pulled at the other, by
/// linear finite elements and by springs of three fits.
///
/// # Errors
/// As [`paper_a`].
pub fn paper_b(adapter: &AdapterRequest) -> Result<Image, RenderJobError> {
    let fits = [
        ("finite elements", "model = \"linear\""),
        ("springs, Frobenius norm", "model = \"mass_spring\"\nelement_method = \"frobenius\""),
        ("springs, 2-norm", "model = \"mass_spring\"\nelement_method = \"two-norm\""),
        ("springs, off-diagonal blocks", "model = \"mass_spring\"\nelement_method = \"block\""),
    ];
    let mut variants = Vec::new();
    for (label, model) in fits {
        let text = format!(
            "name = \"cube\"\ndescription = \"A cube in tension.\"\ndt = 0.01\nduration = 1.5\n\
             gravity = [0.0, 0.0, 0.0]\n[solver]\nmass_damping = 20.0\n\
             [[body]]\nname = \"cube\"\n\
             generate = {{ box = {{ size = [0.02, 0.02, 0.02], cells = [8, 8, 8], elements = \"hexahedra\" }} }}\n\
             material = {{ young_modulus = 10e3, poisson_ratio = 0.3, density = 1000.0 }}\n{model}\n\
             [[constraint]]\nname = \"held\"\nselect = {{ group = \"x0\" }}\n\
             [[load]]\nname = \"pull\"\non = {{ group = \"x1\" }}\ntraction = [3e3, 0.0, 0.0]\n"
        );
        variants.push(Variant { label: label.into(), scene: scene("cube.toml", &text)? });
    }
    let plan = Plan {
        title: "A cube in tension, of hexahedra and of springs found from its stiffness",
        subtitle: "E = 10 kPa, ν = 0.3, 2 cm, held at its left side, pulled by 0.3 E at its right one",
        variants,
        quantity: Quantity::Displacement,
        at: 1.5,
        panel: [280, 260],
        camera: CameraRequest::Orbit { azimuth: 20.0, elevation: 14.0, distance: 1.0 },
    };
    drawn(plan, adapter)
}

/// Bourguignon & Cani 2000, figures 1, 5 and 6: a hanging block pulled down, of plain springs of some constants (N/m, on
/// tetrahedra cut alike and irregularly), of a material, and of this with fibres.
///
/// # Errors
/// As [`paper_a`].
pub fn paper_c(
    adapter: &AdapterRequest,
    [alike, irregular]: [f64; 2],
) -> Result<Image, RenderJobError> {
    let springs = |constant: f64| {
        format!(
            "model = \"mass_spring\"\nelement_method = \"uniform\"\nspring_constant = {constant:.3}\n"
        )
    };
    let fibres =
        |course: &str| format!("[[body.fibres]]\nname = \"fibre\"\nmodulus = 40e3\n{course}\n");
    let hemicircular = "hemicircular = { axis = [0.0, 1.0, 0.0], side = [1.0, 0.0, 0.0] }";
    let helicoidal =
        "helicoidal = { centre = [0.04, 0.04, 0.08], axis = [0.0, 0.0, 1.0], degrees = 45.0 }";
    let models = [
        ("springs, parallel cuts", "tetrahedra", springs(alike)),
        ("springs, irregular", "irregular", springs(irregular)),
        ("material, parallel cuts", "tetrahedra", String::new()),
        ("horizontal fibres", "irregular", fibres("direction = [1.0, 0.0, 0.0]")),
        ("diagonal fibres", "irregular", fibres("direction = [1.0, 0.0, 1.0]")),
        ("hemicircular fibres", "irregular", fibres(hemicircular)),
        ("helicoidal fibres", "irregular", fibres(helicoidal)),
        ("random fibres", "irregular", fibres("random = { seed = 1 }")),
    ];
    let mut variants = Vec::new();
    for (label, elements, model) in models {
        let text = format!(
            "name = \"block\"\ndescription = \"A block pulled down.\"\ndt = 0.01\nduration = 2.0\n\
             gravity = [0.0, 0.0, 0.0]\n[solver]\nmass_damping = 20.0\n\
             [[constraint]]\nname = \"top\"\nselect = {{ group = \"z1\" }}\n\
             [[load]]\nname = \"pull\"\non = {{ group = \"z0\" }}\ntraction = [0.0, 0.0, -3e3]\n\
             [[body]]\nname = \"block\"\n\
             generate = {{ box = {{ size = [0.08, 0.08, 0.16], cells = [4, 4, 8], elements = \"{elements}\" }} }}\n\
             material = {{ young_modulus = 10e3, poisson_ratio = 0.3, density = 1000.0 }}\n{model}"
        );
        variants.push(Variant { label: label.into(), scene: scene("block.toml", &text)? });
    }
    let plan = Plan {
        title: "A hanging block pulled down: the cuts of its elements, or its fibres, decide where it goes",
        subtitle: "E = 10 kPa, fibres of 40 kPa more, held at its top, pulled by 0.3 E; at rest",
        variants,
        quantity: Quantity::Displacement,
        at: 2.0,
        panel: [200, 290],
        camera: CameraRequest::Orbit { azimuth: 12.0, elevation: 8.0, distance: 1.0 },
    };
    drawn(plan, adapter)
}
