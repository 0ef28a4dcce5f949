//! A scene that runs while somebody looks at it, pulls at it and cuts it: what a window does, without the window.

use super::capture::{CaptureOptions, Recorder};
use super::job::RenderJobError;
use super::quantity::Quantity;
use crate::assemble::{BuildOptions, BuiltBody, BuiltScene, build};
use crate::error::{RunError, SceneError};
use crate::scene::{BodyEntry, LoadedScene, Mode};
use bevy_ecs::entity::Entity;
use glam::{DVec3, Vec3};
use sinew::live::{LoopFigures, SimulationLoop};
use sinew::simulation::BodyHandle;
use sinew::touch::pull::{Pull, PullReport};
use sinew_render::RenderError;
use sinew_render::adapter::Gpu;
use sinew_render::camera::{Camera, CameraRequest};
use sinew_render::image::Image;
use sinew_render::overlay::Fonts;
use sinew_render::painter::{Captions, Painter, margins};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// Most steps between two pictures: a scene that is slower than that falls behind the clock.
const MOST_STEPS: u32 = 4;
/// Time between two load steps of a static scene.
const LOAD_STEP: Duration = Duration::from_millis(33);
/// Damping of the hand over its stiffness (s).
const DAMPING: f64 = 0.02;
/// Places on a line that is drawn over the picture where it is asked for bodies.
const LOOKS: u8 = 32;
/// Degrees by which a way as long as the picture is high turns the camera.
const TURN: f32 = 180.0;

/// How a scene is looked at.
#[derive(Clone, Debug)]
pub struct LiveOptions {
    /// How it is carried out.
    pub build: BuildOptions,
    /// Width and height (pixels).
    pub size: [u32; 2],
    /// What colours mean.
    pub quantity: Quantity,
    /// Stiffness (N/m) of the hand that pulls.
    pub spring: f64,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            build: BuildOptions::default(),
            size: [1280, 720],
            quantity: Quantity::default(),
            spring: 150.0,
        }
    }
}

/// A hand that holds a body.
struct Hand {
    pull: Entity,
    /// Where it took hold (m), and how deep in the picture that is (m).
    from: DVec3,
    depth: f64,
}

/// A scene that runs, and the camera before it. Places in the picture are from 0 to 1, from left to right and from top to bottom.
pub struct LiveView {
    scene: LoadedScene,
    options: LiveOptions,
    gpu: Gpu,
    built: BuiltScene,
    recorder: Recorder,
    painter: Painter,
    fonts: Fonts,
    /// What the camera keeps in the picture (m), and the upward direction.
    shown: (Vec<Vec3>, Vec3),
    /// Azimuth and elevation (degrees) of the camera, and a factor on its distance.
    orbit: [f32; 3],
    pace: SimulationLoop,
    done: u64,
    hand: Option<Hand>,
    /// Time (ms) of the last steps.
    ms: f64,
    /// Nothing moves but by [`LiveView::step`].
    pub paused: bool,
    /// What the last deed came to, for who looks.
    pub said: String,
}

impl LiveView {
    /// Builds a scene.
    ///
    /// # Errors
    /// When it cannot be built or drawn.
    pub fn open(
        scene: &LoadedScene,
        options: LiveOptions,
        gpu: Gpu,
    ) -> Result<Self, RenderJobError> {
        let option = |option, found: String, remedy: &str| RenderError::Option {
            option,
            found,
            remedy: remedy.into(),
        };
        if !(options.spring > 0.0 && options.spring.is_finite()) {
            let found = options.spring.to_string();
            return Err(option("--spring", found, "give a positive stiffness (N/m)").into());
        }
        if options.quantity == Quantity::Error {
            let remedy = "it needs a second run; choose another quantity";
            return Err(option("--color", "error".into(), remedy).into());
        }
        let mut built = cuttable(scene, &options.build).map_err(RunError::from)?;
        let quantities = vec![options.quantity];
        let capture = CaptureOptions { quantities, frames: Some(2), ..CaptureOptions::default() };
        let mut recorder = Recorder::new(&scene.scene.name, capture);
        let recording = recorder.show(&mut built, 0);
        let shown = (recording.shown().collect(), recording.up);
        let field = (options.quantity != Quantity::None).then_some(0);
        let request = CameraRequest::default();
        let painter =
            Painter::new(gpu.clone(), options.size, recording, request, field, Captions::ALL)?;
        let step = match built.plan.mode {
            Mode::Static => LOAD_STEP,
            _ => Duration::from_secs_f64(built.plan.dt),
        };
        let pace = SimulationLoop::new(step, MOST_STEPS).map_err(|error| {
            option("dt", built.plan.dt.to_string(), &format!("{error}; give a longer step"))
        })?;
        let CameraRequest::Orbit { azimuth, elevation, distance } = request else {
            unreachable!("it is the one of all pictures")
        };
        Ok(Self {
            scene: scene.clone(),
            options,
            gpu,
            built,
            recorder,
            painter,
            fonts: Fonts::default(),
            shown,
            orbit: [azimuth, elevation, distance],
            pace,
            done: 0,
            hand: None,
            ms: 0.0,
            paused: false,
            said: String::new(),
        })
    }

    /// The scene from its beginning, seen from where it was seen.
    ///
    /// # Errors
    /// As [`LiveView::open`].
    pub fn restart(&mut self) -> Result<(), RenderJobError> {
        let orbit = self.orbit;
        *self = Self::open(&self.scene, self.options.clone(), self.gpu.clone())?;
        self.orbit = orbit;
        self.place_camera();
        Ok(())
    }

    /// The scene as it is.
    pub fn built(&mut self) -> &mut BuiltScene {
        &mut self.built
    }

    /// Width and height (pixels) of pictures.
    pub fn size(&self) -> [u32; 2] {
        self.options.size
    }

    /// Steps done, and how the clock was kept.
    pub fn done(&self) -> (u64, LoopFigures) {
        (self.done, self.pace.figures())
    }

    /// Where the camera is.
    pub fn camera(&self) -> &Camera {
        &self.painter.camera
    }

    /// Carries out the steps that are due after so much time; how many.
    pub fn advance(&mut self, passed: Duration) -> u32 {
        if self.paused {
            return 0;
        }
        let due = self.pace.due(passed);
        (0..due).take_while(|_| self.step()).count() as u32
    }

    /// Carries out a step. One that fails changes nothing, stops the clock and is told.
    pub fn step(&mut self) -> bool {
        let clock = Instant::now();
        let done = self.done + 1;
        let prepared = self.built.prepare_step(done).map_err(|error| error.to_string());
        let stepped =
            prepared.and_then(|()| self.built.simulation.step().map_err(|e| e.to_string()));
        if let Err(why) = stepped {
            self.paused = true;
            self.said = format!("STEP {done} FAILED: {why}");
            return false;
        }
        self.done = done;
        let ms = 1e3 * clock.elapsed().as_secs_f64();
        self.ms = if done == 1 { ms } else { 0.9 * self.ms + 0.1 * ms };
        true
    }

    /// Turns the camera by a way across the picture.
    pub fn turn(&mut self, [x, y]: [f32; 2]) {
        self.orbit[0] -=
            TURN * x * self.painter.camera.tangents[0] / self.painter.camera.tangents[1];
        self.orbit[1] = (self.orbit[1] + TURN * y).clamp(-89.0, 89.0);
        self.place_camera();
    }

    /// Takes the camera farther away by a factor, or nearer.
    pub fn zoom(&mut self, factor: f32) {
        self.orbit[2] = (self.orbit[2] * factor).clamp(0.2, 5.0);
        self.place_camera();
    }

    /// Pictures of another size (pixels) from now on.
    ///
    /// # Errors
    /// When the device cannot draw such.
    pub fn resize(&mut self, size: [u32; 2]) -> Result<(), RenderError> {
        let (look, captions) = (self.painter.look.clone(), self.painter.captions);
        let recording = self.recorder.show(&mut self.built, self.done);
        let request = CameraRequest::default();
        self.painter =
            Painter::new(self.gpu.clone(), size, recording, request, look.field, captions)?;
        self.painter.look = look;
        self.options.size = size;
        self.place_camera();
        Ok(())
    }

    fn place_camera(&mut self) {
        let [azimuth, elevation, distance] = self.orbit;
        let request = CameraRequest::Orbit { azimuth, elevation, distance };
        let [width, height] = self.options.size;
        let margins = margins(width, height, self.painter.captions, true);
        let (points, up) = &self.shown;
        let aspect = width as f32 / height as f32;
        let fitted = Camera::fit(request, *up, points.iter().copied(), aspect, margins);
        // it fitted them before
        self.painter.camera = fitted.unwrap_or(self.painter.camera);
    }

    /// Where the eye is (m), and the way (m) from there to a place in the picture that is one metre deep.
    fn ray(&self, [x, y]: [f32; 2]) -> [DVec3; 2] {
        let Camera { eye, right, up, forward, tangents, .. } = self.painter.camera;
        let across = right * tangents[0] * (2.0 * x - 1.0) + up * tangents[1] * (1.0 - 2.0 * y);
        [eye, forward + across].map(|v| v.as_dvec3())
    }

    /// Takes hold of the body at a place in the picture; whether there is one.
    pub fn grab(&mut self, at: [f32; 2]) -> bool {
        self.release();
        let [eye, along] = self.ray(at);
        let Some(pick) = self.built.simulation.pick(eye, along) else { return false };
        let spring = self.options.spring;
        let pull = Pull::new("hand", pick.rows.to_vec(), spring, DAMPING * spring);
        let pull = self.built.simulation.add_pull(pull.with_weights(pick.weights.to_vec()));
        let forward = self.painter.camera.forward.as_dvec3();
        let depth = forward.dot(pick.position - eye);
        self.hand = Some(Hand { pull, from: pick.position, depth });
        self.said.clear();
        true
    }

    /// Takes the hand to a place in the picture, as deep as it took hold.
    pub fn drag(&mut self, at: [f32; 2]) {
        let [eye, along] = self.ray(at);
        if let Some(Hand { pull, from, depth }) = self.hand {
            self.built.simulation.move_pull(pull, eye + depth * along - from);
        }
    }

    /// Lets go.
    pub fn release(&mut self) {
        if let Some(hand) = self.hand.take() {
            self.built.simulation.remove_contact(hand.pull);
        }
    }

    /// What the hand does; `None` where it holds nothing.
    pub fn hand(&self) -> Option<&PullReport> {
        self.built.simulation.pull_report(self.hand.as_ref()?.pull)
    }

    /// Cuts the bodies behind a line across the picture, as deep as the picture is; elements that came apart.
    pub fn cut(&mut self, from: [f32; 2], to: [f32; 2]) -> usize {
        let part = |i: u8| f32::from(i) / f32::from(LOOKS);
        let place = |i| [0, 1].map(|k| from[k] + part(i) * (to[k] - from[k]));
        let mut bodies = BTreeSet::new();
        for i in 0..=LOOKS {
            let [eye, along] = self.ray(place(i));
            bodies.extend(self.built.simulation.pick(eye, along).map(|pick| pick.body));
        }
        let depth = self.painter.camera.depth.map(f64::from);
        let strip = [from, to].map(|at| {
            let [eye, along] = self.ray(at);
            depth.map(|depth| eye + depth * along)
        });
        let (mut parted, mut words) = (0, Vec::new());
        for body in bodies {
            let body = &self.built.bodies[body];
            match self.built.simulation.cut(body.handle, &strip) {
                Ok(report) => {
                    let own = report.separated.len();
                    parted += own;
                    let (name, pieces) = (&body.name, report.pieces);
                    words.push(format!("{name}: {own} elements parted, pieces: {pieces}"));
                }
                Err(error) => words.push(format!("NOT CUT: {error}")),
            }
        }
        self.said =
            if words.is_empty() { "no body behind the line".into() } else { words.join(" · ") };
        parted
    }

    /// Values at the ends of the colours; `None` without any.
    pub fn range(&mut self) -> Option<[f32; 2]> {
        let recording = self.recorder.show(&mut self.built, self.done);
        recording.fields.first().map(|field| field.range)
    }

    /// A picture of the present state.
    ///
    /// # Errors
    /// When the device fails.
    pub fn picture(&mut self) -> Result<Image, RenderError> {
        let words = self.words();
        let recording = self.recorder.show(&mut self.built, self.done);
        recording.subtitle = words;
        self.painter.picture(&self.fonts, recording, 0)
    }

    /// What is to be known now: doubts first.
    pub fn words(&self) -> String {
        let report = self.built.simulation.report();
        let mut words = Vec::new();
        if report.unconverged {
            words.push("NOT CONVERGED".to_owned());
        }
        if self.paused {
            words.push("paused".to_owned());
        }
        words.extend(Some(self.said.clone()).filter(|said| !said.is_empty()));
        words.push(format!("{:.1} ms a step", self.ms));
        if let Some(hand) = self.hand() {
            words.push(format!("hand {:.3} N", hand.force.length()));
        }
        let behind = self.pace.figures().dropped.as_secs_f64();
        if behind > 0.0 {
            words.push(format!("{behind:.1} s behind the clock"));
        }
        words.join(" · ")
    }
}

/// A scene whose bodies have vertices to spare, so that they can be cut, as many as their meshes have; but for those that say how many they
/// have and those that cannot be cut anyway.
fn cuttable(scene: &LoadedScene, options: &BuildOptions) -> Result<BuiltScene, SceneError> {
    let mut scene = scene.clone();
    let mut built = build(&scene, options)?;
    let open = |(entry, _): &(&mut BodyEntry, &BuiltBody)| entry.spare.is_none();
    for (entry, body) in scene.scene.bodies.iter_mut().zip(&built.bodies).filter(open) {
        entry.spare = Some(body.mesh.points.len() as u32);
    }
    // a kind of body that has no spares at all
    let Ok(with_spares) = build(&scene, options) else { return Ok(built) };
    built = with_spares;
    let bodies: Vec<BodyHandle> = built.bodies.iter().map(|body| body.handle).collect();
    let whole: Vec<bool> =
        bodies.iter().map(|&body| built.simulation.check_cut(body).is_err()).collect();
    if !whole.contains(&true) {
        return Ok(built);
    }
    for (entry, whole) in scene.scene.bodies.iter_mut().zip(whole) {
        entry.spare = entry.spare.filter(|_| !whole);
    }
    build(&scene, options)
}
