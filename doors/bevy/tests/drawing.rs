//! Meshes, interpolation and lines.

use crate::common::*;
use bevy_app::{App, FixedPostUpdate, FixedUpdate};
use bevy_asset::{AssetEvent, Assets};
use bevy_ecs::prelude::*;
use bevy_math::{Quat, Vec3};
use bevy_mesh::{Mesh, Mesh3d, VertexAttributeValues};
use bevy_time::{Fixed, Time, Virtual};
use bevy_transform::components::{GlobalTransform, Transform};
use sinew::engine::schedule::SimulationSystems;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::{Displacement, Position};
use sinew::models::cutting::cut_body;
use sinew::models::resection::{Region, Removal, RemovalRequest};
use sinew::prelude::{DVec3, Shape, Tool};
use sinew_bevy::*;
use std::time::Duration;

fn drawn(app: &App, body: Entity) -> &Mesh {
    let mesh = app.world().get::<Mesh3d>(body).unwrap();
    app.world().resource::<Assets<Mesh>>().get(&mesh.0).unwrap()
}

fn attribute(mesh: &Mesh, normals: bool) -> Vec<Vec3> {
    let attribute = if normals { Mesh::ATTRIBUTE_NORMAL } else { Mesh::ATTRIBUTE_POSITION };
    let Some(VertexAttributeValues::Float32x3(values)) = mesh.attribute(attribute) else {
        panic!()
    };
    values.iter().map(|&v| v.into()).collect()
}

/// Positions (m) of the first body by vertices of the user's mesh.
fn positions(app: &mut App) -> Vec<DVec3> {
    let order = app.world().resource::<Topology>().bodies[0].vertex_order.clone();
    let world = app.world_mut();
    let rows: Vec<_> = world.query::<&Position>().iter(world).map(|p| p.0).collect();
    let mut result = vec![DVec3::ZERO; order.len()];
    order.iter().zip(rows).for_each(|(vertex, row)| result[vertex.index()] = row);
    result
}

/// Largest distance (m) of what is drawn from where the body is.
fn error(app: &mut App, body: Entity) -> f64 {
    let expected = positions(app);
    let frame = *app.world().get::<GlobalTransform>(body).unwrap();
    let found = attribute(drawn(app, body), false);
    let found = found.iter().map(|&p| frame.transform_point(p).as_dvec3());
    found.zip(expected).map(|(found, expected)| found.distance(expected)).fold(0.0, f64::max)
}

#[test]
fn a_mesh_is_where_the_body_is() {
    let place = Transform {
        translation: Vec3::new(0.3, -0.2, 0.1),
        rotation: Quat::from_rotation_y(0.7),
        scale: Vec3::new(1.5, 1.0, 0.5),
    };
    for place in [Transform::default(), place] {
        let mut app = app();
        let body = held(&mut app, place);
        app.world_mut().entity_mut(body).insert(SinewMeshSync::default());
        for _ in 0..20 {
            app.update();
        }
        let sag = positions(&mut app).iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        assert!(sag.is_finite());
        let difference = error(&mut app, body);
        assert!(difference < 1e-6, "{difference:e}");
        // a body is not carried by its `Transform`: the frame changes, the place does not
        let other = Transform::from_xyz(0.1, 0.0, 0.3).with_rotation(Quat::from_rotation_x(0.3));
        app.world_mut().resource_mut::<Time<Virtual>>().pause();
        *app.world_mut().get_mut::<Transform>(body).unwrap() = other;
        app.update();
        let difference = error(&mut app, body);
        assert!(difference < 1e-6, "{difference:e}");

        let mesh = drawn(&app, body);
        let surface = app.world().get::<SinewSurface>(body).unwrap();
        let indices: Vec<u32> = mesh.indices().unwrap().iter().map(|i| i as u32).collect();
        assert_eq!(indices, surface.triangles.concat());
        let points = attribute(mesh, false);
        let bounds = mesh.final_aabb.unwrap();
        let (min, max) = (Vec3::from(bounds.min), Vec3::from(bounds.max));
        assert!(points.iter().all(|p| p.cmpge(min).all() && p.cmple(max).all()));
        assert!(points.iter().any(|p| p.x == min.x) && points.iter().any(|p| p.y == max.y));
        // area-weighted, computed another way
        let normals = attribute(mesh, true);
        let mut expected = vec![DVec3::ZERO; points.len()];
        for t in &surface.triangles {
            let [a, b, c] = t.map(|v| points[v as usize].as_dvec3());
            t.iter().for_each(|&v| expected[v as usize] += (b - a).cross(c - a) / 2.0);
        }
        for (normal, expected) in normals.iter().zip(&expected) {
            if expected.length() > 0.0 {
                assert!(normal.as_dvec3().distance(expected.normalize()) < 1e-4);
            }
        }
        let top = mesh_group("z1")[0];
        assert!(indices.contains(&top));
    }
}

/// Modified meshes since the last call.
fn modified(app: &mut App) -> usize {
    let events = messages::<AssetEvent<Mesh>>(app);
    events.iter().filter(|event| matches!(event, AssetEvent::Modified { .. })).count()
}

#[test]
fn both_sides_of_a_cut_are_drawn_and_move() {
    let mut app = app_of(Duration::from_millis(10), STEP);
    let body = held(&mut app, Transform::default());
    let count = mesh().points.len();
    let mut own = app.world_mut().get_mut::<SinewBody>(body).unwrap();
    own.spare = count;
    app.world_mut().entity_mut(body).insert(SinewMeshSync::default());
    (0..3).for_each(|_| app.update());
    assert_eq!(drawn(&app, body).count_vertices(), count);
    let edge = |y: f64| [DVec3::new(0.045, y, 1.0), DVec3::new(0.045, y, -1.0)];
    let report = cut_body::<f64>(app.world_mut(), 0, &[edge(-1.0), edge(1.0)]).unwrap();
    assert_eq!(report.pieces, 2);
    (0..3).for_each(|_| app.update());
    let surface = app.world().get::<SinewSurface>(body).unwrap();
    assert_eq!((surface.revision, surface.wound.len()), (2, surface.triangles.len()));
    assert!(surface.wound.contains(&true) && surface.depth.iter().any(|depth| *depth > 0.0));
    let mesh = drawn(&app, body);
    assert_eq!(mesh.count_vertices(), count + surface.made.len());
    let indices: Vec<u32> = mesh.indices().unwrap().iter().map(|i| i as u32).collect();
    assert_eq!(indices, surface.triangles.concat());
    // its sides have a colour of their own, and points of their own for it
    let wound = SinewMeshSync::default().wound.unwrap();
    let Some(VertexAttributeValues::Float32x4(colours)) = mesh.attribute(Mesh::ATTRIBUTE_COLOR)
    else {
        panic!("no colours")
    };
    for (triangle, open) in surface.triangles.iter().zip(&surface.wound) {
        let expected = if *open { wound } else { [1.0; 4] };
        assert!(triangle.iter().all(|&v| colours[v as usize] == expected));
    }
    // closed: nothing is missing along the wound
    let at = attribute(mesh, false);
    let corners = |t: &[u32; 3]| t.map(|v| at[v as usize]);
    let volume = |[a, b, c]: [Vec3; 3]| a.dot(b.cross(c)) / 6.0;
    let volume: f32 = surface.triangles.iter().map(corners).map(volume).sum();
    let (low, high) = self::mesh().bounds().unwrap();
    let whole = (high - low).element_product() as f32;
    assert!((volume / whole - 1.0).abs() < 0.02, "{volume} of {whole}");
}

#[test]
fn a_mesh_is_written_when_the_body_changed_and_indices_when_it_was_cut() {
    let mut app = app_of(Duration::from_millis(5), STEP);
    let body = held(&mut app, Transform::default());
    app.world_mut().entity_mut(body).insert(SinewMeshSync::default());
    for _ in 0..6 {
        app.update();
    }
    modified(&mut app);
    // two frames a step: one of them finds nothing new
    let mut written = 0;
    for _ in 0..10 {
        app.update();
        written += modified(&mut app);
    }
    assert_eq!(written, 5);
    app.world_mut().resource_mut::<Time<Virtual>>().pause();
    app.update();
    modified(&mut app);
    app.update();
    assert_eq!(modified(&mut app), 0);
    app.world_mut().resource_mut::<Time<Virtual>>().unpause();

    // attributes of the app stay right through a cut
    let count = mesh().points.len();
    let uv: Vec<[f32; 2]> = (0..count).map(|i| [i as f32, 0.0]).collect();
    let handle = app.world().get::<Mesh3d>(body).unwrap().0.clone();
    {
        let mut meshes = app.world_mut().resource_mut::<Assets<Mesh>>();
        meshes.get_mut(&handle).unwrap().insert_attribute(Mesh::ATTRIBUTE_UV_0, uv.clone());
    }
    let before: Vec<u32> = drawn(&app, body).indices().unwrap().iter().map(|i| i as u32).collect();
    let corner = Region::Sphere { centre: DVec3::new(0.1, 0.08, 0.04), radius: 0.03 };
    app.world_mut().spawn(RemovalRequest::new(0, Removal::new(corner)));
    (0..4).for_each(|_| app.update());
    let mesh = drawn(&app, body);
    let indices: Vec<u32> = mesh.indices().unwrap().iter().map(|i| i as u32).collect();
    assert_ne!(indices, before);
    assert_eq!(indices, app.world().get::<SinewSurface>(body).unwrap().triangles.concat());
    assert_eq!(mesh.count_vertices(), count);
    let kept = mesh.attribute(Mesh::ATTRIBUTE_UV_0).unwrap();
    assert_eq!(kept, &VertexAttributeValues::Float32x2(uv));
}

#[test]
fn flat_triangles_have_their_own_normals() {
    let mut app = app();
    let body = held(&mut app, Transform::default());
    app.world_mut()
        .entity_mut(body)
        .insert(SinewMeshSync { smooth_normals: false, ..Default::default() });
    (0..5).for_each(|_| app.update());
    let surface = app.world().get::<SinewSurface>(body).unwrap().triangles.clone();
    let mesh = drawn(&app, body);
    assert!(mesh.indices().is_none());
    let (points, normals) = (attribute(mesh, false), attribute(mesh, true));
    assert_eq!(points.len(), 3 * surface.len());
    for (p, n) in points.chunks(3).zip(normals.chunks(3)) {
        let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize();
        assert!(n.iter().all(|n| n.distance(normal) < 1e-6));
    }
    let first = positions(&mut app)[surface[0][0] as usize];
    assert!(points[0].as_dvec3().distance(first) < 1e-7);
    // and back
    app.world_mut().get_mut::<SinewMeshSync>(body).unwrap().smooth_normals = true;
    app.update();
    assert_eq!(drawn(&app, body).count_vertices(), crate::common::mesh().points.len());
    assert_eq!(drawn(&app, body).indices().unwrap().len(), 3 * surface.len());
}

#[test]
fn interpolation_draws_between_two_steps() {
    #[derive(Resource, Default)]
    struct Steps([Vec<DVec3>; 2]);
    let mut app = app_of(Duration::from_millis(16), STEP);
    app.init_resource::<Steps>();
    let keep = |mut steps: ResMut<Steps>, positions: Query<&Position>| {
        steps.0.swap(0, 1);
        steps.0[1] = positions.iter().map(|p| p.0).collect();
    };
    app.add_systems(FixedPostUpdate, keep.in_set(SimulationSystems::Last));
    let body = held(&mut app, Transform::default());
    app.world_mut()
        .entity_mut(body)
        .insert((SinewMeshSync::default(), SinewInterpolation::default()));
    let mut seen = 0;
    for frame in 0..12 {
        app.update();
        let steps = app.world().resource::<Steps>();
        if steps.0[0].is_empty() {
            continue;
        }
        let fraction = app.world().resource::<Time<Fixed>>().overstep_fraction_f64();
        let order = &app.world().resource::<Topology>().bodies[0].vertex_order;
        let points = attribute(drawn(&app, body), false);
        let way =
            steps.0[0].iter().zip(&steps.0[1]).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        for (row, vertex) in order.iter().enumerate() {
            let expected = steps.0[0][row].lerp(steps.0[1][row], fraction);
            let found = points[vertex.index()].as_dvec3();
            assert!(found.distance(expected) < 1e-7, "frame {frame}: {found} {expected}");
        }
        seen += usize::from(way > 1e-5 && (0.1..0.9).contains(&fraction));
    }
    assert!(seen > 3);
}

#[test]
fn lines_show_what_is_held_pressed_and_inverted() {
    let mut app = app();
    let body = held(&mut app, Transform::default());
    let tool = Tool::new("ball", Shape::Sphere { radius: 0.02 }, DVec3::new(0.05, 0.04, 0.07));
    let place = Transform::from_xyz(0.05, 0.04, 0.062);
    let tool = app.world_mut().spawn((tool, FollowTransform::default(), place)).id();
    app.add_systems(FixedUpdate, move |mut tools: Query<&mut Transform, With<Tool>>| {
        tools.iter_mut().for_each(|mut t| t.translation.z -= 0.0005);
    });
    (0..12).for_each(|_| app.update());
    assert!(app.world().resource::<SinewGizmoLines>().0.is_empty(), "nobody asked");
    app.world_mut().entity_mut(body).insert(SinewGizmos { per_newton: 2.0 });
    app.update();
    let lines = app.world().resource::<SinewGizmoLines>().0.clone();
    let of = |kind| lines.iter().filter(move |line| line.kind == kind);
    assert_eq!(of(GizmoKind::Held).count(), 3 * mesh_group("z0").len());
    assert!(of(GizmoKind::Held).all(|line| line.from.midpoint(line.to).z.abs() < 1e-6));
    let force: Vec3 = of(GizmoKind::Force).map(|line| (line.to - line.from) / 2.0).sum();
    let state = app.world().get::<SinewBodyState>(body).unwrap();
    assert!(force.z < -0.02 && force.as_dvec3().distance(state.contact_force) < 1e-5, "{force}");
    assert_eq!(of(GizmoKind::Inverted).count(), 0);
    app.world_mut().despawn(tool);
    let turn = |mut rows: Query<&mut Displacement<f64>>| {
        rows.iter_mut().take(20).for_each(|mut u| u.set(DVec3::new(0.0, 0.0, 0.15)));
    };
    app.world_mut().run_system_cached(turn).unwrap();
    app.update();
    let state = app.world().get::<SinewBodyState>(body).unwrap();
    assert!(state.inverted > 0);
    let inverted = state.inverted as usize;
    let lines = &app.world().resource::<SinewGizmoLines>().0;
    let count = lines.iter().filter(|line| line.kind == GizmoKind::Inverted).count();
    assert_eq!(count, 6 * inverted);
    app.world_mut().entity_mut(body).remove::<SinewGizmos>();
    app.update();
    assert!(app.world().resource::<SinewGizmoLines>().0.is_empty());
}
