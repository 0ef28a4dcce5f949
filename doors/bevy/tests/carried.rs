//! Meshes that bodies carry along.

use crate::common::*;
use bevy_app::App;
use bevy_asset::{Assets, Handle, RenderAssetUsages};
use bevy_ecs::prelude::*;
use bevy_ecs::system::SystemState;
use bevy_math::{DQuat, Dir3, Quat, Vec3};
use bevy_mesh::{Indices, Mesh, Mesh3d, PrimitiveTopology, VertexAttributeValues};
use bevy_shape::Ray3d;
use bevy_time::{Time, Virtual};
use bevy_transform::components::{GlobalTransform, Transform};
use sinew::engine::mesh::EmbeddedPoints;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::engine::step::Gravity;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::{Position, RestPosition};
use sinew::models::cutting::cut_body;
use sinew::models::resection::{Region, Removal, RemovalRequest};
use sinew::prelude::DVec3;
use sinew::snapshot::{restore_snapshot, take_snapshot};
use sinew_bevy::*;

/// In the frame of a body: a sheet inside of it, finer than its tissue.
const CORNER: Vec3 = Vec3::new(0.01, 0.01, 0.025);
const CELLS: u32 = 12;

/// From the frame of the mesh to that of the body.
fn place() -> Transform {
    Transform::from_translation(CORNER).with_scale(Vec3::new(0.08, 0.06, 0.01))
}

/// A unit square of many triangles with slanting normals, whose middle column is there twice, as at a seam.
fn sheet() -> Mesh {
    let columns: Vec<u32> = (0..=CELLS / 2).chain(CELLS / 2..=CELLS).collect();
    let mut points = Vec::new();
    for j in 0..=CELLS {
        let own = columns.iter().map(|&i| [i as f32 / CELLS as f32, j as f32 / CELLS as f32, 0.3]);
        points.extend(own);
    }
    let (wide, mut triangles) = (columns.len() as u32, Vec::new());
    for j in 0..CELLS {
        for i in (0..wide - 1).filter(|&i| columns[i as usize] != columns[i as usize + 1]) {
            let at = |di: u32, dj: u32| (j + dj) * wide + i + di;
            triangles.extend([at(0, 0), at(1, 0), at(1, 1), at(0, 0), at(1, 1), at(0, 1)]);
        }
    }
    let normal = Vec3::new(0.3, -0.2, 0.9).normalize().to_array();
    let count = points.len();
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, points)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![normal; count])
        .with_inserted_attribute(Mesh::ATTRIBUTE_TANGENT, vec![[1.0, 0.0, 0.0, -1.0]; count])
        .with_inserted_indices(Indices::U32(triangles))
}

/// An app in which nothing moves by itself.
fn weightless() -> App {
    let mut app = app();
    app.insert_resource(Gravity(DVec3::ZERO));
    app
}

fn three(mesh: &Mesh, which: bevy_mesh::MeshVertexAttribute) -> Vec<Vec3> {
    match mesh.attribute(which) {
        Some(VertexAttributeValues::Float32x3(values)) => {
            values.iter().map(|&v| v.into()).collect()
        }
        Some(VertexAttributeValues::Float32x4(values)) => {
            values.iter().map(|&[x, y, z, _]| Vec3::new(x, y, z)).collect()
        }
        _ => panic!(),
    }
}

fn drawn(app: &App, entity: Entity) -> Mesh {
    let mesh = app.world().get::<Mesh3d>(entity).unwrap();
    app.world().resource::<Assets<Mesh>>().get(&mesh.0).unwrap().clone()
}

fn carried(app: &mut App, body: Entity, mesh: &Handle<Mesh>) -> Entity {
    // as scenes of other programs are: below a node of their own
    let node = app.world_mut().spawn((place(), ChildOf(body))).id();
    app.world_mut().spawn((SinewCarriedMesh::default(), Mesh3d(mesh.clone()), ChildOf(node))).id()
}

fn added(app: &mut App, mesh: Mesh) -> Handle<Mesh> {
    app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh)
}

/// Largest distance (m) of what is drawn from where the tissue has it, by the rows of body `index`.
fn error(app: &mut App, index: usize, body: Transform, entity: Entity) -> f64 {
    let world = app.world_mut();
    let mut query = world.query::<(&Position, &RestPosition)>();
    let rows: Vec<_> = query.iter(world).map(|(x, rest)| x.0 - rest.0).collect();
    let own = world.resource::<Topology>().bodies[index].clone();
    let mut way = vec![DVec3::ZERO; own.mesh_vertices()];
    own.vertices_and_rows().for_each(|(vertex, row)| way[vertex.index()] = rows[row.index()]);
    let at_rest: Vec<DVec3> = three(&sheet(), Mesh::ATTRIBUTE_POSITION)
        .iter()
        .map(|&p| place().transform_point(p).as_dvec3())
        .collect();
    let tissue = mesh();
    let embedding = EmbeddedPoints::new(&tissue, &at_rest).unwrap();
    assert_eq!(embedding.outside, 0);
    let expected = embedding.displacements(&way);
    let expected = at_rest
        .iter()
        .zip(expected)
        .map(|(p, way)| body.transform_point(p.as_vec3()).as_dvec3() + way);
    let frame = *app.world().get::<GlobalTransform>(entity).unwrap();
    let found = three(&drawn(app, entity), Mesh::ATTRIBUTE_POSITION);
    let found = found.iter().map(|&p| frame.transform_point(p).as_dvec3());
    found.zip(expected).map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
}

#[test]
fn a_carried_mesh_is_where_the_tissue_is() {
    let turned = Transform {
        translation: Vec3::new(0.3, -0.2, 0.1),
        rotation: Quat::from_rotation_y(0.7),
        scale: Vec3::new(1.5, 1.0, 0.5),
    };
    let mut app = weightless();
    let mesh = added(&mut app, sheet());
    let bodies = [Transform::default(), turned].map(|place| (held(&mut app, place), place));
    let carried = bodies.map(|(body, _)| carried(&mut app, body, &mesh));
    (0..4).for_each(|_| app.update());
    assert!(steps_done(&app) > 0);
    // nothing has moved yet: it is the artist's, to the digit of f32
    for entity in carried {
        assert!(app.world().get::<Mesh3d>(entity).unwrap().0 != mesh, "a copy of its own");
        let (found, own) = (drawn(&app, entity), sheet());
        for which in [Mesh::ATTRIBUTE_POSITION, Mesh::ATTRIBUTE_NORMAL, Mesh::ATTRIBUTE_TANGENT] {
            let pairs = three(&found, which).into_iter().zip(three(&own, which));
            let off = pairs.map(|(a, b)| a.distance(b)).fold(0.0, f32::max);
            assert!(off < 2e-5, "{which:?}: {off:e}");
        }
    }
    let before = drawn(&app, carried[0]);
    app.insert_resource(Gravity::default());
    (0..20).for_each(|_| app.update());
    for ((entity, (_, place)), index) in carried.into_iter().zip(bodies).zip(0..) {
        let off = error(&mut app, index, place, entity);
        assert!(off < 1e-6, "{off:e}");
    }
    let moved = three(&drawn(&app, carried[0]), Mesh::ATTRIBUTE_POSITION);
    let most = three(&before, Mesh::ATTRIBUTE_POSITION).into_iter().zip(moved);
    assert!(most.map(|(a, b)| a.distance(b)).fold(0.0, f32::max) > 0.01, "the tissue sags");
    // both drew a copy of their own
    let same = |a: &Mesh, b: &Mesh| {
        three(a, Mesh::ATTRIBUTE_POSITION) == three(b, Mesh::ATTRIBUTE_POSITION)
    };
    assert!(same(app.world().resource::<Assets<Mesh>>().get(&mesh).unwrap(), &sheet()));
    // a body is not carried by its `Transform`: the frame changes, the place does not
    app.world_mut().resource_mut::<Time<Virtual>>().pause();
    let other = Transform::from_xyz(0.1, 0.0, 0.3).with_rotation(Quat::from_rotation_x(0.3));
    *app.world_mut().get_mut::<Transform>(bodies[1].0).unwrap() = other;
    app.update();
    let off = error(&mut app, 1, turned, carried[1]);
    assert!(off < 1e-6, "{off:e}");
    let bounds = drawn(&app, carried[1]).final_aabb.unwrap();
    let points = three(&drawn(&app, carried[1]), Mesh::ATTRIBUTE_POSITION);
    let (min, max) = (Vec3::from(bounds.min), Vec3::from(bounds.max));
    assert!(points.iter().all(|p| p.cmpge(min).all() && p.cmple(max).all()));
    assert!(points.iter().any(|p| p.x == min.x) && points.iter().any(|p| p.z == max.z));
}

#[test]
fn normals_and_tangents_turn_with_the_tissue() {
    let mut app = weightless();
    let mesh = added(&mut app, sheet());
    let body = held(&mut app, Transform::default());
    let entity = carried(&mut app, body, &mesh);
    (0..4).for_each(|_| app.update());
    app.world_mut().resource_mut::<Time<Virtual>>().pause();
    let turn = DQuat::from_euler(bevy_math::EulerRot::XYZ, 0.4, 0.9, 0.0);
    let world = app.world_mut();
    world.query::<(&mut Position, &RestPosition)>().iter_mut(world).for_each(|(mut x, rest)| {
        x.0 = turn * rest.0;
    });
    world.get_mut::<SinewBodyState>(body).unwrap().set_changed();
    app.update();
    let (found, own) = (drawn(&app, entity), sheet());
    let frame = place();
    // the sheet is flat: what turns it is the shortest way from its normal to the turned one, in the frame of the mesh
    let up = Vec3::Z;
    let turned = (turn.as_quat() * Vec3::Z / frame.scale.recip()).normalize();
    let expected = Quat::from_rotation_arc(up, turned);
    let find = |which| three(&own, which).into_iter().zip(three(&found, which));
    for which in [Mesh::ATTRIBUTE_NORMAL, Mesh::ATTRIBUTE_TANGENT] {
        for (at_rest, now) in find(which) {
            assert!((expected * at_rest).distance(now) < 1e-4, "{which:?}: {at_rest} {now}");
        }
    }
    // a seam stays closed
    let points = three(&found, Mesh::ATTRIBUTE_POSITION);
    let normals = three(&found, Mesh::ATTRIBUTE_NORMAL);
    let seam = CELLS as usize / 2;
    assert_eq!([points[seam], normals[seam]], [points[seam + 1], normals[seam + 1]]);
}

#[test]
fn triangles_at_removed_elements_are_no_longer_drawn() {
    let mut app = app();
    let mesh = added(&mut app, sheet());
    let body = held(&mut app, Transform::default());
    let entity = carried(&mut app, body, &mesh);
    (0..4).for_each(|_| app.update());
    let corners = |app: &App| drawn(app, entity).indices().unwrap().iter().collect::<Vec<_>>();
    let all = corners(&app);
    let away = |p: DVec3| p.x > 0.06;
    let tissue = crate::common::mesh();
    let gone: Vec<u32> = (0..)
        .zip(&tissue.tetrahedra)
        .filter(|(_, t)| t.iter().all(|&v| away(tissue.points[v as usize])))
        .map(|(t, _)| t)
        .collect();
    assert!(!gone.is_empty() && gone.len() < tissue.tetrahedra.len());
    let removal = Removal::new(Region::Tetrahedra(gone.clone()));
    let before = take_snapshot(app.world_mut()).unwrap();
    app.world_mut().spawn(RemovalRequest::new(0, removal));
    (0..3).for_each(|_| app.update());
    // by the cell of every vertex
    let at_rest: Vec<DVec3> = three(&sheet(), Mesh::ATTRIBUTE_POSITION)
        .iter()
        .map(|&p| place().transform_point(p).as_dvec3())
        .collect();
    let embedding = EmbeddedPoints::new(&tissue, &at_rest).unwrap();
    let cells: Vec<u32> = embedding.cells().map(|(_, cell)| cell).collect();
    let is_left = |t: &&[usize]| t.iter().all(|&v| !gone.contains(&cells[v]));
    let expected: Vec<usize> = all.chunks(3).filter(is_left).flatten().copied().collect();
    assert!(!expected.is_empty() && expected.len() < all.len());
    assert_eq!(corners(&app), expected);
    // the way back brings them back
    restore_snapshot(app.world_mut(), &before).unwrap();
    (0..2).for_each(|_| app.update());
    assert_eq!(corners(&app), all);
}

/// The outside of a unit box with texture coordinates that are its first two axes.
fn shell(cells: [usize; 3]) -> Mesh {
    let solid = box_tets(DVec3::ONE, cells).unwrap();
    let points: Vec<[f32; 3]> = solid.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let texture: Vec<[f32; 2]> = points.iter().map(|&[x, y, _]| [x, y]).collect();
    let corners = solid.surface_triangles().concat();
    // points inside of it are in no triangle
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, points)
        .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, texture)
        .with_inserted_indices(Indices::U32(corners))
}

fn corners(mesh: &Mesh) -> Vec<[usize; 3]> {
    let all: Vec<usize> = mesh.indices().unwrap().iter().collect();
    all.as_chunks().0.to_vec()
}

fn volume(mesh: &Mesh) -> f64 {
    let at = three(mesh, Mesh::ATTRIBUTE_POSITION);
    let of = |t: [usize; 3]| t.map(|v| at[v].as_dvec3());
    corners(mesh).into_iter().map(of).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

/// A mesh is cut with its body: closed at rest, with texture coordinates where a blade made vertices, and what is cut off falls with all
/// that is drawn of it.
#[test]
fn a_carried_mesh_is_cut_with_its_body() {
    let mut app = weightless();
    // finer than the tissue
    let shell = shell([13, 11, 7]);
    let (mesh, soft) = (added(&mut app, shell.clone()), asset(&mut app));
    let body = SinewBody { spare: 200, ..SinewBody::new(soft, material()) };
    let turned = Transform::from_xyz(0.3, -0.2, 0.1).with_rotation(Quat::from_rotation_y(0.7));
    let body = app.world_mut().spawn((body, turned)).id();
    app.world_mut().spawn((SinewHold::new("x0"), ChildOf(body)));
    let size = Transform::from_scale(Vec3::new(0.1, 0.08, 0.04));
    let own = (SinewCarriedMesh::default(), Mesh3d(mesh), size, ChildOf(body));
    let entity = app.world_mut().spawn(own).id();
    (0..4).for_each(|_| app.update());
    let off = |a: &Mesh, b: &Mesh| {
        let [a, b] = [a, b].map(|mesh| three(mesh, Mesh::ATTRIBUTE_POSITION));
        a.into_iter().zip(b).map(|(a, b)| a.distance(b)).fold(0.0, f32::max)
    };
    assert!(off(&drawn(&app, entity), &shell) < 2e-5);
    // rays meet the tissue
    let cast = |app: &mut App, x: f32, y: f32| {
        let from = turned.transform_point(Vec3::new(x, y, 1.0));
        let ray = Ray3d::new(from, Dir3::new(turned.rotation * Vec3::NEG_Z).unwrap());
        SystemState::<SinewRayCast>::new(app.world_mut()).get(app.world()).unwrap().cast(ray)
    };
    let hit = cast(&mut app, 0.07, 0.03).unwrap();
    assert!((hit.distance - 0.96).abs() < 1e-5 && hit.entity == body, "{hit:?}");
    let place = |p: DVec3| turned.transform_point(p.as_vec3()).as_dvec3();
    let edge = |y: f64| [place(DVec3::new(0.045, y, 1.0)), place(DVec3::new(0.055, y, -1.0))];
    let report = cut_body::<f64>(app.world_mut(), 0, &[edge(-1.0), edge(1.0)]).unwrap();
    assert_eq!(report.pieces, 2);
    (0..2).for_each(|_| app.update());
    let cut = drawn(&app, entity);
    let (whole, count) = (shell.count_vertices(), cut.count_vertices());
    assert!(off(&cut, &shell) < 2e-5 && count > whole + 50);
    assert!((volume(&cut) - 1.0).abs() < 2e-3, "{}", volume(&cut));
    let [at, normals] =
        [Mesh::ATTRIBUTE_POSITION, Mesh::ATTRIBUTE_NORMAL].map(|which| three(&cut, which));
    let (
        Some(VertexAttributeValues::Float32x2(texture)),
        Some(VertexAttributeValues::Float32x4(colours)),
    ) = (cut.attribute(Mesh::ATTRIBUTE_UV_0), cut.attribute(Mesh::ATTRIBUTE_COLOR))
    else {
        panic!("no texture or colours")
    };
    let wound = app.world().get::<SinewSurface>(body).unwrap().wound.clone();
    let colour = SinewMeshSync::default().wound.unwrap();
    let (mut open, mut made) = (0, 0);
    for (t, is_wound) in corners(&cut).into_iter().zip(wound) {
        for v in t {
            assert_eq!(colours[v], if is_wound { colour } else { [1.0; 4] });
            assert!((normals[v].length() - 1.0).abs() < 1e-3, "{}", normals[v]);
            if !is_wound {
                made += usize::from(v >= whole);
                let [x, y] = texture[v];
                assert!((at[v].x - x).abs().max((at[v].y - y).abs()) < 2e-5);
            }
        }
        open += usize::from(is_wound);
    }
    assert!(open > 20 && made > 50, "{open} {made}");
    app.insert_resource(Gravity::default());
    (0..20).for_each(|_| app.update());
    let fallen = drawn(&app, entity);
    let frame = *app.world().get::<GlobalTransform>(entity).unwrap();
    let now = three(&fallen, Mesh::ATTRIBUTE_POSITION);
    let way = |v: usize| (frame.transform_point(at[v]) - frame.transform_point(now[v])).z;
    let ways: Vec<[f32; 3]> = corners(&fallen).into_iter().map(|t| t.map(way)).collect();
    // g t^2 / 2
    let fell = ways.iter().filter(|t| t.iter().all(|way| *way > 0.15)).count();
    let stayed = ways.iter().filter(|t| t.iter().all(|way| *way < 0.1)).count();
    assert!(fell > 400 && stayed > 400 && fell + stayed == ways.len(), "{fell} {stayed}");
    let tissue = crate::common::mesh();
    // also what fell, and nothing between the two
    let mut hits = [0, 0];
    for i in 0..50 {
        let Some(hit) = cast(&mut app, 0.01 * i as f32 - 0.2, 0.037) else { continue };
        let rows = app.world().resource::<Topology>().bodies[0].rows(&hit.vertices).unwrap();
        let mut query = app.world_mut().query::<&Position>();
        let all: Vec<DVec3> = query.iter(app.world()).map(|x| x.0).collect();
        let [a, b, c] = [0, 1, 2].map(|k| all[rows[k].index()]);
        assert!(a.distance(b).max(b.distance(c)).max(c.distance(a)) < 0.06, "{hit:?}");
        hits[usize::from(tissue.points[hit.vertices[0] as usize].x > 0.05)] += 1;
    }
    assert!(hits[0] > 2 && hits[1] > 2, "{hits:?}");
    // a coarser mesh, with colours, takes its place, and elements are removed
    let is_right = |t: &[u32; 4]| t.iter().all(|&v| tissue.points[v as usize].x > 0.06);
    let right = (0..).zip(&tissue.tetrahedra).filter(|(_, t)| is_right(t)).map(|(t, _)| t);
    let removal = Removal::new(Region::Tetrahedra(right.collect()));
    app.world_mut().spawn(RemovalRequest::new(0, removal));
    let other = self::shell([3, 3, 2]);
    let white = vec![[0.5_f32; 4]; other.count_vertices()];
    let other = added(&mut app, other.with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, white));
    app.world_mut().entity_mut(entity).insert(Mesh3d(other));
    (0..3).for_each(|_| app.update());
    let coarse = drawn(&app, entity);
    let Some(VertexAttributeValues::Float32x4(colours)) = coarse.attribute(Mesh::ATTRIBUTE_COLOR)
    else {
        panic!("no colours")
    };
    let used: Vec<[f32; 4]> = corners(&coarse).into_iter().flatten().map(|v| colours[v]).collect();
    for colour in [[0.5; 4], [1.0; 4], SinewMeshSync::default().wound.unwrap()] {
        assert!(used.contains(&colour), "{colour:?}");
    }
    assert!(coarse.count_vertices() < count && used.iter().all(|colour| colour[3] > 0.4));
    // and is let go of
    app.world_mut().despawn(entity);
    (0..3).for_each(|_| app.update());
    let surface = app.world().get::<SinewSurface>(body).unwrap();
    let at_vertices =
        surface.triangles.iter().flatten().any(|v| (*v as usize) < tissue.points.len());
    assert!(at_vertices && surface.wound.contains(&true));
    assert!(app.world().resource::<StepOutcome>().0.is_none());
}

/// What is cut off falls with all that is drawn of it, and of the rest nothing moves but by its elements.
#[test]
fn a_carried_mesh_is_cut_with_hexahedra_and_ten_node_tetrahedra() {
    let bricks = box_hexahedra(DVec3::new(0.1, 0.08, 0.04), [5, 4, 2]).unwrap();
    let ten = box_tets(DVec3::new(0.1, 0.08, 0.04), [4, 3, 2]).unwrap().with_second_order();
    for tissue in [bricks, ten] {
        let mut app = weightless();
        let shell = shell([13, 11, 7]);
        let mesh = added(&mut app, shell.clone());
        let soft = SoftMesh::new(tissue).unwrap();
        let soft = app.world_mut().resource_mut::<Assets<SoftMesh>>().add(soft);
        let body = SinewBody { spare: 400, ..SinewBody::new(soft, material()) };
        let body = app.world_mut().spawn((body, Transform::default())).id();
        app.world_mut().spawn((SinewHold::new("x0"), ChildOf(body)));
        let size = Transform::from_scale(Vec3::new(0.1, 0.08, 0.04));
        let own = (SinewCarriedMesh::default(), Mesh3d(mesh), size, ChildOf(body));
        let entity = app.world_mut().spawn(own).id();
        (0..4).for_each(|_| app.update());
        let edge = |y: f64| [DVec3::new(0.047, y, 1.0), DVec3::new(0.056, y, -1.0)];
        let report = cut_body::<f64>(app.world_mut(), 0, &[edge(-1.0), edge(1.0)]).unwrap();
        assert_eq!(report.pieces, 2);
        (0..2).for_each(|_| app.update());
        let cut = drawn(&app, entity);
        assert!(cut.count_vertices() > shell.count_vertices() + 50);
        assert!((volume(&cut) - 1.0).abs() < 2e-3, "{}", volume(&cut));
        app.insert_resource(Gravity::default());
        (0..20).for_each(|_| app.update());
        let fallen = drawn(&app, entity);
        let [at, now] = [&cut, &fallen].map(|mesh| three(mesh, Mesh::ATTRIBUTE_POSITION));
        // of heights that are 1 in the mesh
        let way = |v: usize| 0.04 * (at[v] - now[v]).z;
        let ways: Vec<[f32; 3]> = corners(&fallen).into_iter().map(|t| t.map(way)).collect();
        let fell = ways.iter().filter(|t| t.iter().all(|way| *way > 0.15)).count();
        let stayed = ways.iter().filter(|t| t.iter().all(|way| *way < 0.1)).count();
        assert!(fell > 400 && stayed > 400 && fell + stayed == ways.len(), "{fell} {stayed}");
        assert!(app.world().resource::<StepOutcome>().0.is_none());
    }
}

#[test]
fn meshes_that_cannot_be_carried_are_told_once_and_tried_again() {
    let mut app = app();
    let mesh = added(&mut app, sheet());
    let lines = Mesh::new(PrimitiveTopology::LineList, RenderAssetUsages::default());
    let lines = added(&mut app, lines);
    let body = held(&mut app, Transform::default());
    let soft = asset(&mut app);
    let cuttable = SinewBody { spare: 100, ..SinewBody::new(soft, material()) };
    let cuttable = app.world_mut().spawn(cuttable).id();
    let first = carried(&mut app, cuttable, &mesh);
    let cases = [
        (Some(mesh.clone()), None, place(), "is a child of no `SinewBody`"),
        (
            Some(mesh.clone()),
            Some(cuttable),
            place(),
            "its body can be cut (`spare`) and carries another mesh",
        ),
        (
            Some(mesh.clone()),
            Some(cuttable),
            place().with_scale(Vec3::new(-0.08, 0.06, 0.01)),
            "its `Transform` mirrors it",
        ),
        (None, Some(body), place(), "its entity has no `Mesh3d`"),
        (Some(lines), Some(body), place(), "its mesh is a LineList"),
        (Some(mesh.clone()), Some(body), Transform::default(), "lies 1.3"),
    ];
    let entities = cases.each_ref().map(|(mesh, body, place, _)| {
        let mut entity = app.world_mut().spawn((SinewCarriedMesh::default(), *place));
        if let Some(mesh) = mesh {
            entity.insert(Mesh3d(mesh.clone()));
        }
        if let Some(body) = body {
            entity.insert(ChildOf(*body));
        }
        entity.id()
    });
    let mut told = Vec::new();
    for _ in 0..4 {
        app.update();
        told.extend(messages::<InputFailed>(&mut app));
    }
    assert_eq!(told.len(), cases.len(), "{told:?}");
    for (entity, (_, _, _, text)) in entities.iter().zip(&cases) {
        let error = app.world().get::<SinewInputError>(*entity).unwrap().0.to_string();
        assert!(error.contains(text), "{error}");
        assert!(told.iter().any(|own| own.entity == *entity && own.error.to_string() == error));
    }
    assert!(app.world().get::<SinewInputError>(first).is_none());
    // a mesh comes, and a parent: they are carried
    app.world_mut().entity_mut(entities[3]).insert(Mesh3d(mesh.clone()));
    app.world_mut().entity_mut(entities[0]).insert(ChildOf(body));
    app.update();
    for entity in [entities[0], entities[3]] {
        assert!(app.world().get::<SinewInputError>(entity).is_none());
    }
    let handle = |app: &App| app.world().get::<Mesh3d>(entities[3]).unwrap().0.clone();
    assert_ne!(handle(&app), mesh);
    // and let go of
    let last = handle(&app);
    app.world_mut().entity_mut(entities[3]).remove::<SinewCarriedMesh>();
    let before = drawn(&app, entities[3]);
    (0..5).for_each(|_| app.update());
    assert_eq!(handle(&app), last);
    assert!(drawn(&app, entities[3]) == before);
}
