//! The surface of a body, for contact.

use super::description::SoftBody;
use super::present::Resection;
use crate::cutting::cut_faces;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::connectivity::{Connectivity, ElementKind};
use sinew_engine::surface::BodySurface;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::RestPosition;
use std::borrow::Cow;

/// The surface of what is left of body number `body`; empty when there is no such body.
pub(super) fn read_surface(world: &mut World, body: usize) -> BodySurface {
    let mut query = world.query::<&SoftBody>();
    let Some(soft) = query.iter(world).find(|soft| soft.index == body).cloned() else {
        return BodySurface::default();
    };
    let first = world.resource::<Topology>().bodies[body].vertices.start as usize;
    let mut rest = world.query::<&RestPosition>();
    let n = world.resource::<Topology>().bodies[body].row_count();
    let rest: Vec<DVec3> = rest.iter(world).skip(first).take(n).map(|x| x.0).collect();
    let rows = &world.resource::<Topology>().bodies[body];
    let known = world.get_resource::<Resection>().and_then(|r| r.connectivity(body));
    let connectivity = known.map_or_else(|| Cow::Owned(Connectivity::new(rows)), Cow::Borrowed);

    let rest_of = |row: u32| rest[row as usize];
    let matter = soft.matter(&rows.ordered, &rest_of);
    let (mut sum, mut count) = (vec![0.0; n], vec![0.0; n]);
    for kind in [ElementKind::Tetrahedron, ElementKind::Hexahedron] {
        for e in connectivity.all_left(kind) {
            for &v in rows.nodes[kind].of(e) {
                sum[v as usize] += matter.material(kind, e).young_modulus;
                count[v as usize] += 1.0;
            }
        }
    }
    // where a cut divided elements their material tells
    let cut = cut_faces(world, body);
    let is_cut = cut.is_some();
    let divided =
        |kind, e: u32| cut.as_ref().is_some_and(|cut| kind == cut.kind && cut.divided[e as usize]);
    let whole: Vec<u32> = connectivity
        .all_left(ElementKind::Triangle)
        .filter(|&t| !divided(ElementKind::Triangle, t))
        .collect();
    let outside = connectivity.surface().filter(|(_, kind, e)| !divided(*kind, *e));
    let outside: Vec<([u32; 3], ElementKind, u32)> = outside.collect();
    let mut halves = outside.partition_point(|(_, kind, _)| *kind == ElementKind::Tetrahedron);
    let mut triangles: Vec<[u32; 3]> = outside.into_iter().map(|(triangle, ..)| triangle).collect();
    let mut sheets = Vec::new();
    let is_film = cut.as_ref().is_some_and(|cut| cut.kind == ElementKind::Triangle);
    let (points, wounds) = cut.map_or_else(Default::default, |cut| {
        if is_film {
            sheets = cut.triangles;
        } else {
            halves += cut.triangles.len();
            triangles.splice(0..0, cut.triangles);
        }
        (cut.points, cut.wounds)
    });
    for t in whole {
        // in a body that was cut the skin of the solid is where membranes on it are
        let triangle = connectivity.cells.triangles_of.triangles.of(t)[0];
        let mut behind = connectivity.round_triangle.of(triangle).iter();
        if !is_cut || !behind.any(|&e| connectivity.is_present(ElementKind::Tetrahedron, e)) {
            sheets.push(rows.triangles()[t as usize]);
        }
    }
    let sheet_halves = sheets.len();
    for q in connectivity.all_left(ElementKind::Quad) {
        let [a, b, c, d] = rows.quads()[q as usize];
        sheets.extend([[a, b, c], [a, c, d]]);
    }
    if let Some(membrane) = soft.membrane {
        let length = |&[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(rest_of);
            (a.distance(b) + b.distance(c) + c.distance(a)) / 3.0
        };
        // of a membrane alone that was cut the triangles with the vertices that move them
        let of_rows = connectivity.all_left(ElementKind::Triangle);
        let of_rows: Vec<[u32; 3]> = of_rows.map(|t| rows.triangles()[t as usize]).collect();
        let sheets = if is_film { &of_rows } else { &sheets };
        let edge = sheets.iter().map(length).sum::<f64>() / sheets.len().max(1) as f64;
        let young_modulus = membrane.material.young_modulus * membrane.thickness / edge;
        // a membrane on a solid adds little to what the solid resists with
        let solid = count.clone();
        for sheet in sheets {
            for &v in sheet.iter().filter(|&&v| solid[v as usize] == 0.0) {
                sum[v as usize] += young_modulus;
                count[v as usize] += 1.0;
            }
        }
    }
    let mut young_modulus: Vec<f64> =
        sum.iter().zip(&count).map(|(e, n)| e / f64::max(*n, 1.0)).collect();
    for point in &points {
        // some shares in ten-node tetrahedra are below 0, no stiffness is
        let own = || point.shares().map(|(row, w)| (row, w.max(0.0)));
        let sum: f64 = own().map(|(_, w)| w).sum();
        let mean = own().map(|(row, w)| w * young_modulus[row as usize]).sum::<f64>();
        young_modulus.push(if sum > 0.0 { mean / sum } else { 0.0 });
    }
    BodySurface { points, triangles, wounds, halves, sheets, sheet_halves, young_modulus }
}
