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
use sinew_scene::scene::{LoadedScene, SpringMethod};
use sinew_scene::shipped_scene;

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
    let layout = Layout::Panels(panels.len(), plan.panel);
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

/// Natsupakpong & Cavusoglu 2010: a clamped bar of finite elements and of springs by three fits.
///
/// # Errors
/// As [`paper_a`].
pub fn paper_b(adapter: &AdapterRequest) -> Result<Image, RenderJobError> {
    use sinew::identify::ElementMethod;
    let fits = [
        ("finite elements", None),
        ("springs, Frobenius norm", Some(ElementMethod::Frobenius)),
        ("springs, 2-norm", Some(ElementMethod::TwoNorm)),
        ("springs, off-diagonal blocks", Some(ElementMethod::Block)),
    ];
    let scene = first_body("elements")?;
    let variants = fits.map(|(label, fit)| {
        let mut scene = scene.clone();
        if fit.is_some() {
            scene.scene.bodies[0].model = Model::MassSpring;
            scene.scene.bodies[0].element_method = fit.map(SpringMethod::Fitted);
        }
        Variant { label: label.into(), scene }
    });
    let plan = Plan {
        title: "A bar of hexahedra and bars of springs found from its stiffness",
        subtitle: "E = 150 kPa, ν = 0.3, clamped at its left end, sagging under its weight; after 1.5 s",
        variants: variants.into(),
        quantity: Quantity::Displacement,
        at: 1.5,
        panel: [280, 260],
        camera: CameraRequest::Orbit { azimuth: 20.0, elevation: 14.0, distance: 1.0 },
    };
    drawn(plan, adapter)
}

/// Bourguignon & Cani 2000: a hanging bar with fibres at five angles.
///
/// # Errors
/// As [`paper_a`].
pub fn paper_c(adapter: &AdapterRequest) -> Result<Image, RenderJobError> {
    let scene = first_body("fibre_bar")?;
    let variants = [0.0f64, 22.5, 45.0, 67.5, 90.0].map(|degrees| {
        let mut scene = scene.clone();
        let (sin, cos) = degrees.to_radians().sin_cos();
        for fibres in &mut scene.scene.bodies[0].fibres {
            fibres.direction = Some([sin, 0.0, cos]);
        }
        Variant { label: format!("{degrees}°"), scene }
    });
    let plan = Plan {
        title: "A hanging bar with fibres at five angles to its weight",
        subtitle: "E = 5 kPa, fibres of 50 kPa, held at its top; after 2 s",
        variants: variants.into(),
        quantity: Quantity::Displacement,
        at: 2.0,
        panel: [190, 300],
        camera: CameraRequest::Orbit { azimuth: 12.0, elevation: 8.0, distance: 1.0 },
    };
    drawn(plan, adapter)
}
