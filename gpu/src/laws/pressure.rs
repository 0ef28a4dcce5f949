//! Follower pressure: twin of [`sinew_models::laws::pressure`]. The faces of every [`Pressure`] are a set of their own, and
//! its value the factor of the set.

use bevy_ecs::prelude::*;
use sinew_engine::columns::single_table;
use sinew_engine::load::{LoadTime, Pressure};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::RestPosition;
use sinew_models::laws::pressure::ROW;

use super::{DeviceElement, DeviceLaw, ElementColumns, TRIANGLES};

/// Three vertices; E_1 and E_2 (m).
const FACE: DeviceElement =
    DeviceElement { vertices: 3, constants: 8, threads: 1, files: &[TRIANGLES] };

/// The law. Its faces are found by `columns`, a set for each pressure.
pub static LAW: DeviceLaw = DeviceLaw::new(
    &ROW,
    FACE,
    [|_| ElementColumns::default(); 2],
    &[include_str!("pressure.wgsl")],
);

/// Faces in a body, pressure by pressure.
pub(super) fn columns(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> Vec<(DeviceLaw, ElementColumns)> {
    let mut sources: Vec<_> = world
        .query::<(Entity, &Pressure)>()
        .iter(world)
        .map(|(e, p)| (e, p.faces.clone()))
        .collect();
    sources.sort_unstable_by_key(|(entity, _)| *entity);
    let mut rests = world.query::<&RestPosition>();
    let rest = single_table(rests.contiguous_iter(world)).unwrap_or(&[]);
    let topology = world.resource::<Topology>();
    let rows = &topology.bodies[body].vertices;
    let found = sources.into_iter().map(|(entity, faces)| {
        let mut columns = ElementColumns { load: Some(entity), ..ElementColumns::default() };
        for face in faces.into_iter().filter(|face| face.iter().all(|row| rows.contains(&row.0))) {
            // an edge that no element has any more carries nothing
            let [a, b, c] = face.map(|row| row.0);
            if [(a, b), (b, c), (c, a)].iter().any(|&(a, b)| topology.block(a, b).is_none()) {
                continue;
            }
            columns.nodes.extend(face.map(|row| row.0 - first_row));
            let [a, b, c] = face.map(|row| rest[row.index()].0);
            for edge in [b - a, c - a].map(|edge| edge.as_vec3()) {
                columns.data.extend([edge.x, edge.y, edge.z, 0.0]);
            }
        }
        (LAW, columns)
    });
    found.filter(|(_, columns)| !columns.nodes.is_empty()).collect()
}

/// Values (Pa) of all pressures at the time whose loads act.
pub fn values(world: &mut World) -> Vec<(Entity, f64)> {
    let time = world.get_resource::<LoadTime>().map_or(0.0, |time| time.0);
    let mut pressures = world.query::<(Entity, &Pressure)>();
    pressures.iter(world).map(|(e, p)| (e, p.pressure * p.curve.value(time))).collect()
}
