//! An organ in a window, held by its ligament. The left mouse button pulls it, the right one pokes it with a ball, X cuts
//! out what is under the pointer, G shows forces and held vertices.

use bevy::input::common_conditions::input_just_pressed;
use bevy::prelude::*;
use bevy::window::PrimaryWindow;
use sinew::engine::step::Gravity;
use sinew::models::resection::{Region, Removal, RemovalRequest};
use sinew::prelude::{DVec3, Shape, SolverSettings, Tool, YoungPoisson};
use sinew_bevy::*;

/// Radius (m) of the ball that pokes, and of what is cut out.
const BALL: f32 = 0.015;
const CUT: f64 = 0.015;

fn main() {
    App::new()
        .add_plugins(
            DefaultPlugins
                .set(WindowPlugin {
                    primary_window: Some(Window {
                        title: "left: pull, right: poke, X: cut, G: forces".into(),
                        ..default()
                    }),
                    ..default()
                })
                .set(AssetPlugin { file_path: "../../demos/meshes".into(), ..default() }),
        )
        .add_plugins(SinewBevyPlugins::default())
        // Bevy's up is y
        .insert_resource(Gravity(DVec3::new(0.0, -9.81, 0.0)))
        .insert_resource(SolverSettings { mass_damping: 2.0, ..SolverSettings::default() })
        .add_systems(Startup, setup)
        .add_systems(
            Update,
            (
                point,
                (
                    pull,
                    poke,
                    cut.run_if(input_just_pressed(KeyCode::KeyX)),
                    show.run_if(input_just_pressed(KeyCode::KeyG)),
                    lines,
                ),
            )
                .chain(),
        )
        .add_systems(Update, tell)
        .run();
}

#[derive(Component)]
struct Organ;

/// What the mouse does.
#[derive(Resource, Default)]
struct Pointer {
    ray: Option<Ray3d>,
    facing: Vec3,
    pulled: Option<Entity>,
    /// The ball, how far (m) along the ray the surface was, and how far (m) it went in.
    ball: Option<(Entity, f32, f32)>,
}

fn setup(
    mut commands: Commands,
    assets: Res<AssetServer>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    commands.init_resource::<Pointer>();
    let soft = YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.45, density: 1050.0 };
    let liver = materials.add(StandardMaterial {
        base_color: Color::srgb(0.45, 0.12, 0.1),
        perceptual_roughness: 0.4,
        ..default()
    });
    commands
        .spawn((
            Name::new("liver"),
            Organ,
            SinewBody::new(assets.load("liver.msh"), soft),
            // the mesh has its z upwards
            Transform::from_rotation(Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2)),
            SinewMeshSync::default(),
            SinewInterpolation::default(),
            MeshMaterial3d(liver),
        ))
        .with_child(SinewHold::new("ligament"));
    commands.spawn((
        Camera3d::default(),
        Transform::from_xyz(0.05, 0.12, 0.34).looking_at(Vec3::new(0.0, -0.02, 0.0), Vec3::Y),
    ));
    commands.spawn((
        DirectionalLight::default(),
        Transform::from_xyz(1.0, 2.0, 1.5).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

/// Ray through the pointer.
fn point(
    mut pointer: ResMut<Pointer>,
    window: Single<&Window, With<PrimaryWindow>>,
    camera: Single<(&Camera, &GlobalTransform)>,
) {
    let (camera, place) = *camera;
    let cursor = window.cursor_position();
    pointer.ray = cursor.and_then(|cursor| camera.viewport_to_world(place, cursor).ok());
    pointer.facing = place.forward().into();
}

fn pull(
    mut pointer: ResMut<Pointer>,
    buttons: Res<ButtonInput<MouseButton>>,
    mut mouse: SinewMouse,
) {
    if buttons.just_released(MouseButton::Left)
        && let Some(pulled) = pointer.pulled.take()
    {
        mouse.release(pulled);
    }
    let Some(ray) = pointer.ray else { return };
    if buttons.just_pressed(MouseButton::Left) {
        let grabbed = mouse.grab(ray, pointer.facing, 200.0, 1.0);
        pointer.pulled = grabbed.map(|(pull, _)| pull);
    } else if let Some(pulled) = pointer.pulled {
        mouse.drag(pulled, ray);
    }
}

fn poke(
    mut commands: Commands,
    mut pointer: ResMut<Pointer>,
    buttons: Res<ButtonInput<MouseButton>>,
    cast: SinewRayCast,
    time: Res<Time>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    if buttons.just_released(MouseButton::Right)
        && let Some((ball, ..)) = pointer.ball.take()
    {
        commands.entity(ball).despawn();
    }
    let Some(ray) = pointer.ray else { return };
    if buttons.just_pressed(MouseButton::Right) {
        let Some(hit) = cast.cast(ray) else { return };
        let away = hit.distance as f32 - 1.2 * BALL;
        let shape = Shape::Sphere { radius: f64::from(BALL) };
        let ball = commands.spawn((
            Tool::new("ball", shape, DVec3::ZERO).with_friction(0.2),
            FollowTransform { moved: Moved::EveryFrame, ..default() },
            Transform::from_translation(ray.get_point(away)),
            Mesh3d(meshes.add(Sphere::new(BALL))),
            MeshMaterial3d(materials.add(Color::srgb(0.7, 0.7, 0.75))),
        ));
        pointer.ball = Some((ball.id(), away, 0.0));
    } else if let Some((ball, away, depth)) = &mut pointer.ball {
        // 10 cm/s until it is 4 cm on
        *depth = (*depth + 0.1 * time.delta_secs()).min(0.04);
        let there = Transform::from_translation(ray.get_point(*away + *depth));
        commands.entity(*ball).insert(there);
    }
}

fn cut(
    mut commands: Commands,
    pointer: Res<Pointer>,
    cast: SinewRayCast,
    bodies: Query<&SinewBodyIndex>,
) {
    let Some(hit) = pointer.ray.and_then(|ray| cast.cast(ray)) else { return };
    if let Ok(body) = bodies.get(hit.entity) {
        let region = Region::Sphere { centre: hit.position, radius: CUT };
        commands.spawn(RemovalRequest::new(body.0, Removal::new(region)));
    }
}

fn show(mut commands: Commands, organs: Query<(Entity, Has<SinewGizmos>), With<Organ>>) {
    for (organ, is_shown) in &organs {
        if is_shown {
            commands.entity(organ).remove::<SinewGizmos>();
        } else {
            commands.entity(organ).insert(SinewGizmos::default());
        }
    }
}

fn lines(mut gizmos: Gizmos, lines: Res<SinewGizmoLines>) {
    for line in &lines.0 {
        let color = match line.kind {
            GizmoKind::Held => Color::srgb(0.3, 0.6, 1.0),
            GizmoKind::Force => Color::srgb(1.0, 0.8, 0.2),
            GizmoKind::Inverted => Color::srgb(1.0, 0.2, 0.8),
        };
        gizmos.line(line.from, line.to, color);
    }
}

fn tell(
    mut cuts: MessageReader<Resected>,
    mut failed: MessageReader<BodyFailed>,
    mut steps: MessageReader<StepFailed>,
) {
    for cut in cuts.read() {
        info!("{} tetrahedra cut away, {} left", cut.report.tetrahedra.len(), cut.report.remaining);
    }
    for failure in failed.read() {
        error!("no organ: {}", failure.error);
    }
    for failure in steps.read() {
        error!("the organ stands still: {}", failure.0);
    }
}
