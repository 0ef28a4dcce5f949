//! What acts on bodies: held vertices, pulls and tools, each where its entity is, and haptic devices.

use crate::{BodySystems, SimulationSystems, SinewBody, SinewBodyIndex, SoftMesh, StepOutcome};
use bevy_app::App;
use bevy_asset::Assets;
use bevy_ecs::intern::Interned;
use bevy_ecs::message::signal_message_update_system;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;
use bevy_math::{DQuat, DVec3};
use bevy_time::{Fixed, Time};
use bevy_transform::components::{GlobalTransform, Transform};
use bevy_transform::helper::TransformHelper;
use sinew::engine::order::Order;
use sinew::engine::precision::Precision;
use sinew::engine::row::VertexRow;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::FixedAxes;
use sinew::haptics::{HapticDevice, HapticError, HapticOptions, HapticReport, HapticTissue};
use sinew::prelude::{BodyHandle, Constraint, Pose, Pull, Tool, ToolPose};
use sinew::touch::set::ContactSet;

/// How often the entity of an input is moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Moved {
    /// Before every step, as from `FixedUpdate`: the input is where the entity is at the end of the next step
    /// (default).
    #[default]
    EveryStep,
    /// Once a frame, as by a mouse or from `Update`: the way is spread evenly over the steps of the frame. Otherwise
    /// the first of them would make it all, at several times the speed.
    EveryFrame,
}

/// Vertices of a body.
#[derive(Clone, Debug, PartialEq)]
pub enum Patch {
    /// By their indices in the user's mesh.
    Vertices(Vec<u32>),
    /// All of a named group of the mesh.
    Group(String),
}

impl From<Vec<u32>> for Patch {
    fn from(vertices: Vec<u32>) -> Self {
        Self::Vertices(vertices)
    }
}

impl From<&str> for Patch {
    fn from(group: &str) -> Self {
        Self::Group(group.into())
    }
}

/// Holds vertices of the body that its entity is a child of. As the entity moves, they follow it rigidly, from where
/// both were when it took hold; so they do when the `Transform` of the body or a parent is moved.
#[derive(Component, Clone, Debug)]
#[require(Transform)]
pub struct SinewHold {
    /// Vertices.
    pub vertices: Patch,
    /// Held axes of the world.
    pub axes: FixedAxes,
    /// How often the entity is moved.
    pub moved: Moved,
}

impl SinewHold {
    /// Holds vertices along all axes.
    pub fn new(vertices: impl Into<Patch>) -> Self {
        Self { vertices: vertices.into(), axes: FixedAxes::ALL, moved: Moved::EveryStep }
    }
}

/// Pulls on vertices of the body that its entity is a child of, by a spring and a damper to where the entity carries
/// them from the places they had when it took hold. What it does is told by
/// [`PullReport`](sinew::touch::pull::PullReport) on the same entity.
#[derive(Component, Clone, Debug)]
#[require(Transform)]
pub struct SinewPull {
    /// Vertices.
    pub vertices: Patch,
    /// Share of each vertex; equal ones when empty.
    pub weights: Vec<f64>,
    /// Stiffness (N/m) of all vertices together.
    pub stiffness: f64,
    /// Damping (N s/m) of all vertices together.
    pub damping: f64,
    /// How often the entity is moved.
    pub moved: Moved,
}

impl SinewPull {
    /// Pulls on vertices with equal weights.
    pub fn new(vertices: impl Into<Patch>, stiffness: f64, damping: f64) -> Self {
        let (vertices, weights) = (vertices.into(), Vec::new());
        Self { vertices, weights, stiffness, damping, moved: Moved::EveryStep }
    }
}

/// Lets a haptic device hold vertices of the body that its entity is a child of, by a spring that is part of the step, and serves it round
/// every step ([`sinew::haptics`]). Beside a [`Tool`] on the same entity, without vertices, it holds that. As soon as it holds, the
/// entity has a [`SinewHapticDevice`]; what it does is told by [`PullReport`](sinew::touch::pull::PullReport) or
/// [`ToolReport`](sinew::touch::tool::ToolReport), too. The device is where its thread says, wherever the entity is.
#[derive(Component, Clone, Debug)]
#[require(Transform)]
pub struct SinewHaptic {
    /// Vertices.
    pub vertices: Patch,
    /// How it holds them. Name, body and vertices are those of the entity, whatever stands here.
    pub options: HapticOptions,
}

impl SinewHaptic {
    /// Holds vertices as devices do by default.
    pub fn new(vertices: impl Into<Patch>) -> Self {
        let options = HapticOptions::new(BodyHandle(0), Vec::new());
        Self { vertices: vertices.into(), options }
    }

    /// Holds the tool on its entity as devices do by default.
    pub fn of_tool() -> Self {
        Self::new(Vec::new())
    }
}

/// The end of a [`SinewHaptic`] at the device, for the thread of that, and what the last step found for it.
#[derive(Component, Debug)]
pub struct SinewHapticDevice {
    device: Option<HapticDevice>,
    report: Option<HapticReport>,
}

impl SinewHapticDevice {
    /// The device, which has one owner: `None` from the second call on. It may outlive the app; its force then falls to zero.
    pub fn take(&mut self) -> Option<HapticDevice> {
        self.device.take()
    }

    /// What the last step found for the device; `None` before the first.
    pub fn report(&self) -> Option<&HapticReport> {
        self.report.as_ref()
    }
}

/// What serves a device.
#[derive(Component)]
struct HapticEnd(Option<Box<HapticTissue>>);

/// Puts a [`Tool`] on the same entity where that entity is. It appears there with the first step, and moves
/// there from then on.
#[derive(Component, Clone, Copy, Debug, Default)]
#[require(Transform, Followed)]
pub struct FollowTransform {
    /// Angle (rad) between the jaws of the tool.
    pub opening: f64,
    /// How often the entity is moved.
    pub moved: Moved,
}

/// Where a tool that follows its entity is.
#[derive(Component, Default)]
struct Followed(Option<ToolPose>);

/// An input that cannot act; correct it, and it is tried again.
#[derive(Component, Clone, Debug, PartialEq)]
pub struct SinewInputError(pub InputError);

/// An input cannot act; see [`SinewInputError`].
#[derive(Message, Clone, Debug, PartialEq)]
pub struct InputFailed {
    /// Its entity.
    pub entity: Entity,
    /// Why.
    pub error: InputError,
}

/// Why an input cannot act.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// It has no parent that is a body.
    #[error("`{0}` is a child of no `SinewBody`: spawn it with `ChildOf(body)`")]
    NoBody(String),
    /// There is no such vertex.
    #[error(
        "`{name}`: vertex {vertex} of body `{body}` does not exist or belongs to no element, so it cannot be held or \
         pulled"
    )]
    Vertex {
        /// Input.
        name: String,
        /// Body.
        body: String,
        /// Index in the user's mesh.
        vertex: u32,
    },
    /// A size of it cannot be used, or it cannot go where its entity is.
    #[error("`{name}`: {problem}")]
    Invalid {
        /// Input.
        name: String,
        /// What is wrong, and with which value.
        problem: String,
    },
}

/// A place and a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rigid {
    position: DVec3,
    rotation: DQuat,
}

impl Rigid {
    fn of(transform: &GlobalTransform) -> Self {
        let (_, rotation, position) = transform.to_scale_rotation_translation();
        Self { position: position.as_dvec3(), rotation: rotation.as_dquat().normalize() }
    }

    fn towards(self, to: Self, part: f64) -> Self {
        if part >= 1.0 {
            return to;
        }
        Self {
            position: self.position.lerp(to.position, part),
            rotation: self.rotation.slerp(to.rotation, part),
        }
    }

    /// The motion from here to there.
    fn pose(self, to: Self) -> Pose {
        let translation = to.position - self.position;
        if to.rotation == self.rotation {
            return translation.into();
        }
        let rotation = (to.rotation * self.rotation.inverse()).normalize();
        Pose { translation, rotation, centre: self.position }
    }
}

/// An input that acts: where its entity was when it took hold, and where the input is.
#[derive(Component, Clone, Copy, Debug)]
struct Acting {
    start: Rigid,
    at: Rigid,
}

pub(crate) fn build(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    app.add_message::<InputFailed>();
    app.add_observer(|gone: On<Remove<SinewHold>>, commands: Commands| {
        end::<Constraint>(gone.entity, commands);
    });
    app.add_observer(|gone: On<Remove<SinewPull>>, commands: Commands| {
        end::<Pull>(gone.entity, commands);
    });
    app.add_observer(
        |gone: On<Remove<SinewHaptic>>,
         commands: Commands,
         mut tools: Query<HeldTool, With<HapticEnd>>,
         contact: Option<Res<ContactSet>>| {
            if let Ok((mut tool, order, _)) = tools.get_mut(gone.entity) {
                HapticTissue::let_go(&mut tool, contact.and_then(|own| own.pose_of_tool(*order)));
            }
            end::<(Pull, HapticEnd, SinewHapticDevice)>(gone.entity, commands);
        },
    );
    let before = serve_haptics(|tissue, world| tissue.before_step_in(world).map(|()| None));
    let after = serve_haptics(|tissue, world| tissue.after_step_in(world).map(Some));
    app.add_systems(
        schedule,
        (
            begin_holds,
            begin_pulls,
            begin_haptics,
            follow_holds,
            follow_pulls,
            follow_tools,
            before
                .run_if(any_with_component::<HapticEnd>)
                // the one system of Bevy's in the fixed schedules
                .ambiguous_with(signal_message_update_system),
        )
            .chain()
            .in_set(BodySystems::Input),
    );
    app.add_systems(
        schedule,
        after
            .run_if(any_with_component::<HapticEnd>)
            .after(SimulationSystems::Step)
            .before(BodySystems::State)
            .ambiguous_with(signal_message_update_system),
    );
}

fn end<C: Bundle>(entity: Entity, mut commands: Commands) {
    if let Ok(mut entity) = commands.get_entity(entity) {
        entity.try_remove::<(C, Acting, SinewInputError)>();
    }
}

/// Inputs that are new or changed, or wait for their bodies.
type New<C> = Or<(Changed<C>, (Without<Acting>, Without<SinewInputError>))>;
type Input<'a, C> = (Entity, &'a C, Option<&'a ChildOf>, Option<&'a Name>);

/// What beginning an input takes.
#[derive(bevy_ecs::system::SystemParam)]
struct Begin<'w, 's> {
    commands: Commands<'w, 's>,
    topology: Res<'w, Topology>,
    bodies: Query<'w, 's, (&'static SinewBody, Option<&'static SinewBodyIndex>)>,
    meshes: Res<'w, Assets<SoftMesh>>,
    transforms: TransformHelper<'w, 's>,
    failed: MessageWriter<'w, InputFailed>,
}

impl Begin<'_, '_> {
    /// Rows of an input, `None` while its body is not built.
    fn rows(
        &self,
        name: &str,
        parent: Option<&ChildOf>,
        patch: &Patch,
    ) -> Result<Option<Vec<VertexRow>>, InputError> {
        let body = parent.and_then(|parent| self.bodies.get(parent.parent()).ok());
        let Some(body) = body else { return Err(InputError::NoBody(name.into())) };
        let (own, Some(index)) = body else { return Ok(None) };
        let body = &self.topology.bodies[index.0];
        let vertices = match (patch, self.meshes.get(&own.mesh)) {
            (Patch::Vertices(vertices), _) => vertices.clone(),
            (Patch::Group(_), None) => return Ok(None),
            (Patch::Group(group), Some(mesh)) => mesh.group(group).map_err(|error| {
                InputError::Invalid { name: name.into(), problem: error.to_string() }
            })?,
        };
        let row = |&vertex: &u32| {
            let (name, of) = (name.into(), body.name.clone());
            body.row(vertex).ok_or(InputError::Vertex { name, body: of, vertex })
        };
        vertices.iter().map(row).collect::<Result<_, _>>().map(Some)
    }

    fn begin<C: Bundle>(&mut self, entity: Entity, made: Result<Option<C>, InputError>) {
        match made {
            Ok(None) => {}
            Ok(Some(made)) => {
                let Ok(global) = self.transforms.compute_global_transform(entity) else { return };
                let start = Rigid::of(&global);
                let acting = (made, Acting { start, at: start });
                self.commands.entity(entity).try_remove::<SinewInputError>().try_insert(acting);
            }
            Err(error) => {
                log::error!("{error}");
                self.commands
                    .entity(entity)
                    .try_remove::<(C, Acting)>()
                    .try_insert(SinewInputError(error.clone()));
                self.failed.write(InputFailed { entity, error });
            }
        }
    }
}

pub(crate) fn label(kind: &str, entity: Entity, name: Option<&Name>) -> String {
    name.map_or_else(|| format!("{kind} {entity}"), Name::to_string)
}

fn begin_holds(mut with: Begin, holds: Query<Input<SinewHold>, New<SinewHold>>) {
    for (entity, hold, parent, name) in &holds {
        let name = label("hold", entity, name);
        let rows = with.rows(&name, parent, &hold.vertices);
        let made = rows.map(|rows| {
            rows.map(|rows| {
                let mut made = Constraint::hold(name, rows);
                made.axes = hold.axes;
                made
            })
        });
        with.begin(entity, made);
    }
}

fn begin_pulls(mut with: Begin, pulls: Query<Input<SinewPull>, New<SinewPull>>) {
    for (entity, pull, parent, name) in &pulls {
        let name = label("pull", entity, name);
        let rows = with.rows(&name, parent, &pull.vertices);
        let made = rows.and_then(|rows| {
            let Some(rows) = rows else { return Ok(None) };
            let mut made = Pull::new(name.clone(), rows, pull.stiffness, pull.damping);
            if !pull.weights.is_empty() {
                made = made.with_weights(pull.weights.clone());
            }
            match made.problem(with.topology.vertex_count()) {
                Some(problem) => Err(InputError::Invalid { name, problem }),
                None => Ok(Some(made)),
            }
        });
        with.begin(entity, made);
    }
}

/// A tool that a device may hold, and what else moves it.
type HeldTool = (&'static mut Tool, &'static Order, Has<FollowTransform>);

fn begin_haptics(
    mut with: Begin,
    (precision, contact): (Res<Precision>, Option<Res<ContactSet>>),
    haptics: Query<Input<SinewHaptic>, New<SinewHaptic>>,
    mut tools: Query<HeldTool>,
) {
    for (entity, haptic, parent, name) in &haptics {
        let name = label("haptic device", entity, name);
        if let (Patch::Vertices(none), Ok((mut tool, order, follows))) =
            (&haptic.vertices, tools.get_mut(entity))
            && none.is_empty()
        {
            let options =
                HapticOptions { name: name.clone(), tool: Some(entity), ..haptic.options.clone() };
            let options = HapticOptions { vertices: Vec::new(), ..options };
            let also = || {
                follows.then(|| {
                    "a `FollowTransform` and a haptic device move it; remove one of them".into()
                })
            };
            let made = match options.problem().or_else(also) {
                Some(problem) => Err(problem),
                None => {
                    let at = contact.as_ref().and_then(|own| own.pose_of_tool(*order));
                    let (at, rows) = (at.unwrap_or(tool.start), with.topology.vertex_count());
                    HapticTissue::holding_tool((entity, &mut tool), at, options, (*precision, rows))
                        .map_err(|error| error.to_string())
                }
            };
            let made = made.map_err(|problem| InputError::Invalid { name, problem });
            with.begin(entity, made.map(|(tissue, device)| Some(held(tissue, device))));
            continue;
        }
        let rows = with.rows(&name, parent, &haptic.vertices);
        let made = rows.and_then(|rows| {
            let Some(rows) = rows else { return Ok(None) };
            // of which only counts whether there are any
            let vertices = rows.iter().map(|row| row.0).collect();
            let options = HapticOptions { name: name.clone(), vertices, ..haptic.options.clone() };
            let pull = Pull::new(name.clone(), rows, options.stiffness, 0.0);
            let problem = options.problem();
            let problem = problem.or_else(|| pull.problem(with.topology.vertex_count()));
            if let Some(problem) = problem {
                return Err(InputError::Invalid { name, problem });
            }
            let (tissue, device) = HapticTissue::holding(entity, options, *precision);
            Ok(Some((pull, held(tissue, device))))
        });
        with.begin(entity, made);
    }
}

/// Both ends of a handle as components.
fn held(tissue: HapticTissue, device: HapticDevice) -> (HapticEnd, SinewHapticDevice) {
    let device = SinewHapticDevice { device: Some(device), report: None };
    (HapticEnd(Some(Box::new(tissue))), device)
}

/// A system that serves all haptic devices at one moment of a step. What a step that failed leaves is not told to them: their forces fall.
fn serve_haptics(
    serve: fn(&mut HapticTissue, &mut World) -> Result<Option<HapticReport>, HapticError>,
) -> impl FnMut(&mut World, &mut QueryState<Entity, With<HapticEnd>>) {
    move |world, ends| {
        if world.resource::<StepOutcome>().0.is_some() {
            return;
        }
        for entity in ends.iter(world).collect::<Vec<_>>() {
            let end = world.get_mut::<HapticEnd>(entity).and_then(|mut end| end.0.take());
            let Some(mut tissue) = end else { continue };
            let served = serve(&mut tissue, world);
            if let Some(mut end) = world.get_mut::<HapticEnd>(entity) {
                end.0 = Some(tissue);
            }
            // all that can be wrong is that the app took its pull away: then it is as if no step were taken
            let report = served.ok().flatten();
            if let Some(mut device) =
                world.get_mut::<SinewHapticDevice>(entity).filter(|_| report.is_some())
            {
                device.report = report;
            }
        }
    }
}

/// Where entities are now, and what part of the way there is for the next step.
#[derive(bevy_ecs::system::SystemParam)]
struct Places<'w, 's> {
    transforms: TransformHelper<'w, 's>,
    time: Option<Res<'w, Time<Fixed>>>,
}

impl Places<'_, '_> {
    fn of(&self, entity: Entity) -> Option<Rigid> {
        self.transforms.compute_global_transform(entity).ok().map(|global| Rigid::of(&global))
    }

    fn part(&self, moved: Moved) -> f64 {
        match (&self.time, moved) {
            (Some(time), Moved::EveryFrame) => {
                // of the steps that this frame still owes, this is the first
                let later = time.overstep().as_nanos() / time.timestep().as_nanos().max(1);
                1.0 / (later + 1) as f64
            }
            _ => 1.0,
        }
    }

    /// Moves an input on; the motion since it took hold if it moved.
    fn next(
        &self,
        (entity, name): (Entity, &str),
        acting: &mut Acting,
        moved: Moved,
    ) -> Result<Option<Pose>, InputError> {
        let Some(there) = self.of(entity) else { return Ok(None) };
        if !(there.position.is_finite() && there.rotation.is_finite()) {
            let problem = format!("the `Transform` of its entity is not finite: {there:?}");
            return Err(InputError::Invalid { name: name.into(), problem });
        }
        let next = acting.at.towards(there, self.part(moved));
        let has_moved = next != acting.at;
        acting.at = next;
        Ok(has_moved.then(|| acting.start.pose(next)))
    }
}

/// Tells errors once, and takes them back.
#[derive(bevy_ecs::system::SystemParam)]
struct Errors<'w, 's> {
    commands: Commands<'w, 's>,
    known: Query<'w, 's, (), With<SinewInputError>>,
    failed: MessageWriter<'w, InputFailed>,
}

impl Errors<'_, '_> {
    fn book(&mut self, entity: Entity, result: Result<(), InputError>) {
        match (result, self.known.contains(entity)) {
            (Ok(()), true) => {
                self.commands.entity(entity).try_remove::<SinewInputError>();
            }
            (Err(error), false) => {
                log::error!("{error}");
                self.commands.entity(entity).try_insert(SinewInputError(error.clone()));
                self.failed.write(InputFailed { entity, error });
            }
            _ => {}
        }
    }
}

fn follow_holds(
    places: Places,
    mut errors: Errors,
    mut holds: Query<(Entity, &SinewHold, &mut Acting, &mut Constraint)>,
) {
    for (entity, hold, mut acting, mut constraint) in &mut holds {
        let acting = acting.bypass_change_detection();
        let next = places.next((entity, &constraint.name), acting, hold.moved);
        let result = next.and_then(|pose| match pose.map(|pose| constraint.set_target(pose)) {
            Some(Err(error)) => {
                let (name, problem) = (constraint.name.clone(), error.to_string());
                Err(InputError::Invalid { name, problem })
            }
            _ => Ok(()),
        });
        errors.book(entity, result);
    }
}

fn follow_pulls(
    places: Places,
    mut errors: Errors,
    mut pulls: Query<(Entity, &SinewPull, &mut Acting, &mut Pull)>,
) {
    for (entity, own, mut acting, mut pull) in &mut pulls {
        let acting = acting.bypass_change_detection();
        let next = places.next((entity, &pull.name), acting, own.moved);
        let result = next.map(|pose| {
            if let Some(pose) = pose {
                pull.target = pose;
            }
        });
        errors.book(entity, result);
    }
}

fn follow_tools(
    places: Places,
    mut errors: Errors,
    mut tools: Query<(Entity, &FollowTransform, &mut Followed, &mut Tool, Option<&SinewHaptic>)>,
) {
    for (entity, follow, mut followed, mut tool, haptic) in &mut tools {
        if haptic.is_some_and(|own| own.vertices == Patch::Vertices(Vec::new())) {
            let problem =
                "a `FollowTransform` and a haptic device move it; remove one of them".into();
            let name = tool.name.clone();
            errors.book(entity, Err(InputError::Invalid { name, problem }));
            continue;
        }
        let Some(there) = places.of(entity) else { continue };
        let next = followed.0.map_or(there, |at| {
            let at = Rigid { position: at.position, rotation: at.rotation };
            at.towards(there, places.part(follow.moved))
        });
        let pose =
            ToolPose { position: next.position, rotation: next.rotation, opening: follow.opening };
        let result = match followed.0 {
            Some(at) if at == pose => Ok(()),
            Some(_) => tool.set_target(pose),
            None => tool.place(pose),
        };
        if result.is_ok() {
            followed.0 = Some(pose);
        }
        let name = &tool.name;
        let result = result.map_err(|error| InputError::Invalid {
            name: name.clone(),
            problem: error.to_string(),
        });
        errors.book(entity, result);
    }
}
