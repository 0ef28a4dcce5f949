//! A window in which a scene runs, is pulled at and cut: `sinew view`.
//!
//! Pictures are those of `sinew render`, drawn off screen and copied into the window, so that any driver serves, a software one, too.
//! What keys and mouse do to a scene is [`LiveView`]'s.

use sinew_render::RenderError;
use sinew_scene::picture::{LiveView, RenderJobError};
use softbuffer::{Context, Surface};
use std::num::NonZeroU32;
use std::rc::Rc;
use std::time::Instant;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::error::EventLoopError;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, EventLoop, EventLoopBuilder, OwnedDisplayHandle};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Window, WindowId};

/// Keys and mouse, as the window's title says them.
pub const KEYS: &str = "drag: pull, or turn beside the body · wheel: zoom · space: pause · . step · C and drag: cut · R again · Q quit";

/// Pixels of a notch of a wheel.
const NOTCH: f64 = 40.0;
/// Factor on the distance of the camera by a notch.
const ZOOM: f32 = 0.9;

/// Why a window cannot be, or ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WindowError {
    /// There is no display.
    #[error(
        "no window can be opened: {0}; `sinew run` writes a page, `sinew render` pictures, neither needs a display"
    )]
    Display(#[from] EventLoopError),
    /// The window cannot be made or shown.
    #[error("the window failed: {0}")]
    Window(String),
    /// The scene cannot be drawn.
    #[error(transparent)]
    Scene(#[from] RenderJobError),
}

impl From<RenderError> for WindowError {
    fn from(error: RenderError) -> Self {
        Self::Scene(error.into())
    }
}

/// What is done with a way of the mouse with its left button down.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    /// The hand that holds a body.
    Pull,
    /// The camera.
    Turn,
    /// A line that is cut along at its end, from here.
    Cut([f32; 2]),
}

/// A window and the scene in it.
struct ViewWindow {
    view: LiveView,
    /// Close after so many pictures.
    most: Option<u64>,
    shown: Option<(Rc<Window>, Surface<OwnedDisplayHandle, Rc<Window>>)>,
    context: Context<OwnedDisplayHandle>,
    last: Instant,
    mouse: [f32; 2],
    way: Option<Way>,
    cuts: bool,
    pictures: u64,
    failed: Option<WindowError>,
}

/// Shows a scene until its window is closed, or until so many pictures were shown; the scene as it is then, and the pictures.
///
/// # Errors
/// When there is no display, or it or the device fails.
pub fn show(view: LiveView, most: Option<u64>) -> Result<(LiveView, u64), WindowError> {
    show_in(EventLoop::builder(), view, most)
}

/// The same in an event loop of other settings.
///
/// # Errors
/// As [`show`].
pub fn show_in(
    mut builder: EventLoopBuilder<()>,
    view: LiveView,
    most: Option<u64>,
) -> Result<(LiveView, u64), WindowError> {
    let events = builder.build()?;
    let context = Context::new(events.owned_display_handle());
    let context = context.map_err(|e| WindowError::Window(e.to_string()))?;
    let mut window = ViewWindow {
        view,
        most,
        shown: None,
        context,
        last: Instant::now(),
        mouse: [0.5; 2],
        way: None,
        cuts: false,
        pictures: 0,
        failed: None,
    };
    events.run_app(&mut window)?;
    match window.failed {
        Some(error) => Err(error),
        None => Ok((window.view, window.pictures)),
    }
}

impl ViewWindow {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<(), WindowError> {
        let failed = |error: &dyn std::fmt::Display| WindowError::Window(error.to_string());
        let attributes = Window::default_attributes()
            .with_title(format!("Sinew · {KEYS}"))
            .with_inner_size(PhysicalSize::<u32>::from(self.view.size()));
        let window = events.create_window(attributes).map_err(|e| failed(&e))?;
        let window = Rc::new(window);
        let surface = Surface::new(&self.context, window.clone()).map_err(|e| failed(&e))?;
        self.shown = Some((window, surface));
        self.last = Instant::now();
        Ok(())
    }

    /// Carries out what is due and shows it.
    fn draw(&mut self) -> Result<(), WindowError> {
        let failed = |error: &dyn std::fmt::Display| WindowError::Window(error.to_string());
        let Some((window, surface)) = &mut self.shown else { return Ok(()) };
        let size = window.inner_size();
        let (Some(width), Some(height)) =
            (NonZeroU32::new(size.width), NonZeroU32::new(size.height))
        else {
            return Ok(()); // it is minimised
        };
        let size = [size.width.max(16), size.height.max(16)];
        if size != self.view.size() {
            self.view.resize(size)?;
        }
        let now = Instant::now();
        self.view.advance(now - self.last);
        self.last = now;
        let image = self.view.picture()?;
        surface.resize(width, height).map_err(|e| failed(&e))?;
        let mut buffer = surface.buffer_mut().map_err(|e| failed(&e))?;
        let rows = image.data.chunks_exact(4 * image.width as usize);
        for (to, from) in buffer.chunks_exact_mut(width.get() as usize).zip(rows) {
            for (to, from) in to.iter_mut().zip(from.chunks_exact(4)) {
                *to = u32::from_be_bytes([0, from[0], from[1], from[2]]);
            }
        }
        window.pre_present_notify();
        buffer.present().map_err(|e| failed(&e))?;
        self.pictures += 1;
        Ok(())
    }

    fn key(&mut self, key: &Key, events: &ActiveEventLoop) -> Result<(), WindowError> {
        match key.as_ref() {
            Key::Named(NamedKey::Escape) | Key::Character("q" | "Q") => events.exit(),
            Key::Named(NamedKey::Space) => self.view.paused = !self.view.paused,
            Key::Character(".") => {
                self.view.paused = true;
                self.view.step();
            }
            Key::Character("c" | "C") => {
                self.cuts = true;
                self.view.said = "draw a line across the body: it is cut there".into();
            }
            Key::Character("r" | "R") => {
                self.way = None;
                self.view.restart()?;
            }
            _ => {}
        }
        Ok(())
    }

    fn button(&mut self, down: bool) {
        if down {
            self.way = Some(match () {
                () if self.cuts => Way::Cut(self.mouse),
                () if self.view.grab(self.mouse) => Way::Pull,
                () => Way::Turn,
            });
            return;
        }
        match self.way.take() {
            Some(Way::Cut(from)) => {
                self.cuts = false;
                self.view.cut(from, self.mouse);
            }
            Some(Way::Pull) => self.view.release(),
            _ => {}
        }
    }

    fn mouse_at(&mut self, at: [f32; 2]) {
        match self.way {
            Some(Way::Pull) => self.view.drag(at),
            Some(Way::Turn) => self.view.turn([0, 1].map(|k| at[k] - self.mouse[k])),
            _ => {}
        }
        self.mouse = at;
    }

    fn handle(&mut self, event: WindowEvent, events: &ActiveEventLoop) -> Result<(), WindowError> {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => self.draw()?,
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
                self.key(&event.logical_key, events)?;
            }
            WindowEvent::CursorMoved { position, .. } => {
                let [width, height] = self.view.size().map(f64::from);
                self.mouse_at([position.x / width, position.y / height].map(|x| x as f32));
            }
            WindowEvent::MouseInput { state, button: MouseButton::Left, .. } => {
                self.button(state == ElementState::Pressed);
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, y) => y,
                    MouseScrollDelta::PixelDelta(way) => (way.y / NOTCH) as f32,
                };
                self.view.zoom(ZOOM.powf(notches));
            }
            _ => {}
        }
        Ok(())
    }

    fn check(&mut self, done: Result<(), WindowError>, events: &ActiveEventLoop) {
        if let Err(error) = done {
            self.failed.get_or_insert(error);
        }
        if self.failed.is_some() || self.most.is_some_and(|most| self.pictures >= most) {
            events.exit();
        }
    }
}

impl ApplicationHandler for ViewWindow {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.shown.is_none() {
            let done = self.open(events);
            self.check(done, events);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let done = self.handle(event, events);
        self.check(done, events);
    }

    fn about_to_wait(&mut self, _: &ActiveEventLoop) {
        if let Some((window, _)) = &self.shown {
            window.request_redraw();
        }
    }
}
