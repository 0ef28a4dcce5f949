//! Carried meshes of bodies that can be cut: they are the surface that the body carries, and take what cuts make of it.

use super::{By, Carried, Shape, SinewCarriedMesh};
use crate::body::mean;
use crate::{SinewBodyIndex, SinewSurface};
use bevy_ecs::prelude::*;
use bevy_math::{DAffine3, DVec3, Vec3};
use bevy_mesh::{Indices, Mesh, VertexAttributeValues};
use sinew::engine::row::MeshVertex;
use sinew::engine::topology::BodyRows;
use sinew::models::cutting::{carry_surface, drop_surface};
use std::collections::HashMap;

/// A mesh that is cut with its body.
pub(super) struct Cut {
    /// As it was loaded, with normals, and where that rests.
    whole: Mesh,
    to_rest: DAffine3,
    /// Revision of the surface that it is of, and the colour of its wounds.
    of: (u64, SinewCarriedMesh),
    /// Rows of the body, relative to its first, and weights by which each vertex moves.
    pub made: Vec<([u32; 4], [f64; 4])>,
    /// Those behind the fourth.
    further: Vec<([u32; 6], [f64; 6])>,
}

impl Cut {
    pub fn new(whole: &Mesh, to_rest: DAffine3) -> Self {
        let (made, further) = (Vec::new(), Vec::new());
        Self { whole: whole.clone(), to_rest, of: Default::default(), made, further }
    }

    /// Where a vertex is, from where rows are.
    pub fn place(&self, vertex: usize, at: impl Fn(usize) -> DVec3) -> DVec3 {
        mean((&self.made, &self.further), vertex, at)
    }

    /// The rows by which a vertex moves.
    fn rows(&self, vertex: usize) -> [u32; 10] {
        let ([a, b, c, d], _) = self.made[vertex];
        let [e, f, g, h, i, j] = self.further.get(vertex).map_or([a; 6], |(rows, _)| *rows);
        [a, b, c, d, e, f, g, h, i, j]
    }

    /// Lets a body carry it; else what is in the way.
    pub fn hang(&self, world: &mut World, body: Entity) -> Result<(), String> {
        let Some(index) = world.get::<SinewBodyIndex>(body).map(|index| index.0) else {
            return Err("its body is gone".into());
        };
        if carries(world, body) {
            let problem =
                "its body can be cut (`spare`) and carries another mesh: make one of both";
            return Err(problem.into());
        }
        let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
        let rest = positions(&self.whole).iter().map(wide);
        let rest: Vec<DVec3> = rest.map(|p| self.to_rest.transform_point3(p)).collect();
        let corners: Vec<u32> = match self.whole.indices() {
            Some(indices) => indices.iter().map(|i| i as u32).collect(),
            None => (0..rest.len() as u32).collect(),
        };
        carry_surface(world, index, &rest, corners.as_chunks().0).map_err(|e| e.to_string())?;
        if let Some(mut surface) = world.get_mut::<SinewSurface>(body) {
            surface.forget();
        }
        Ok(())
    }

    /// Whether a surface is one that has its vertices.
    pub fn knows(&self, surface: &SinewSurface) -> bool {
        !surface.carried.is_empty() && surface.made.len() >= self.whole.count_vertices()
    }

    /// Whether it is of a surface as that is now, with its wounds in this colour.
    pub fn is_of(&self, surface: &SinewSurface, style: &SinewCarriedMesh) -> bool {
        self.of == (surface.revision, *style)
    }

    /// What is left of it, with its wounds.
    pub fn follow(
        &mut self,
        body: &BodyRows,
        surface: &SinewSurface,
        style: &SinewCarriedMesh,
    ) -> Option<(Mesh, Shape)> {
        self.of = (surface.revision, *style);
        let (first, count) = (body.mesh_vertices(), self.whole.count_vertices());
        self.made.clone_from(&surface.made);
        self.further.clone_from(&surface.further);
        // what removals laid open has vertices of the tissue, which come last
        let mut points: Vec<usize> = (first..first + self.made.len()).collect();
        let mut of_tissue = HashMap::new();
        let mut vertex = |point: u32| match (point as usize).checked_sub(first) {
            Some(own) => own as u32,
            None => *of_tissue.entry(point).or_insert_with(|| {
                let row = body.row_of_vertex[MeshVertex(point)].map_or(0, |row| row.0);
                self.made.push(([row; 4], [1.0, 0.0, 0.0, 0.0]));
                points.push(point as usize);
                self.made.len() as u32 - 1
            }),
        };
        let triangles: Vec<[u32; 3]> =
            surface.triangles.iter().map(|t| t.map(&mut vertex)).collect();
        let between: Vec<_> = points[count..].iter().map(|&point| surface.carried[point]).collect();
        let mut mesh = self.whole.clone();
        for (attribute, values) in self.whole.attributes() {
            match longer(values, &between) {
                Some(longer) => mesh.insert_attribute(*attribute, longer),
                None => _ = mesh.remove_attribute(*attribute),
            }
        }
        // directions between two are shorter than these
        if let Some(VertexAttributeValues::Float32x3(own)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_NORMAL)
        {
            own[count..]
                .iter_mut()
                .for_each(|n| *n = Vec3::from(*n).normalize_or_zero().to_array());
        }
        if let Some(VertexAttributeValues::Float32x4(own)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_TANGENT)
        {
            for [x, y, z, _] in &mut own[count..] {
                [*x, *y, *z] = Vec3::new(*x, *y, *z).normalize_or_zero().to_array();
            }
        }
        // what is not on the surface has no colour of the artist's
        if let Some(VertexAttributeValues::Float32x4(own)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_COLOR)
        {
            let new = own[count..].iter_mut().zip(&between);
            new.filter(|(_, (_, shares))| *shares == [0.0; 3]).for_each(|(own, _)| *own = [1.0; 4]);
        }
        let to_mesh = self.to_rest.inverse();
        let places = points[count..].iter().map(|&point| surface.rest[point]);
        let places = places.map(|rest| to_mesh.transform_point3(rest).as_vec3().to_array());
        let all = positions(&self.whole).iter().copied().chain(places);
        mesh.insert_attribute(Mesh::ATTRIBUTE_POSITION, all.collect::<Vec<_>>());
        if let Some(colour) = style.wound.filter(|_| surface.wound.contains(&true)) {
            let mut colours = match mesh.attribute(Mesh::ATTRIBUTE_COLOR) {
                Some(VertexAttributeValues::Float32x4(own)) => own.clone(),
                _ => vec![[1.0; 4]; points.len()],
            };
            let wound = triangles.iter().zip(&surface.wound).filter(|(_, wound)| **wound);
            wound.flat_map(|(t, _)| t).for_each(|&v| colours[v as usize] = colour);
            mesh.insert_attribute(Mesh::ATTRIBUTE_COLOR, colours);
        }
        mesh.insert_indices(Indices::U32(triangles.into_iter().flatten().collect()));
        let (shape, _) = Shape::of(&mesh, |v| self.rows(v)).ok()?;
        mesh.insert_attribute(Mesh::ATTRIBUTE_NORMAL, shape.normals.clone());
        Some((mesh, shape))
    }
}

/// Ends that a body carries a mesh through cuts, unless there is another one already.
pub(super) fn let_go(world: &mut World, body: Entity) {
    let Some(index) = world.get::<SinewBodyIndex>(body).map(|index| index.0) else { return };
    if carries(world, body) {
        return;
    }
    drop_surface(world, index);
    if let Some(mut surface) = world.get_mut::<SinewSurface>(body) {
        surface.forget();
    }
}

/// Whether a body carries a mesh through cuts.
fn carries(world: &mut World, body: Entity) -> bool {
    let mut all = world.query::<&Carried>();
    all.iter(world).any(|own| own.body == body && matches!(own.by, By::Surface(_)))
}

fn positions(mesh: &Mesh) -> &[[f32; 3]] {
    match mesh.attribute(Mesh::ATTRIBUTE_POSITION) {
        Some(VertexAttributeValues::Float32x3(positions)) => positions,
        _ => &[],
    }
}

/// Whether values of an attribute are known between vertices: those of `f32` are.
pub(super) fn is_divided(values: &VertexAttributeValues) -> bool {
    use VertexAttributeValues::{Float32, Float32x2, Float32x3, Float32x4};
    matches!(values, Float32(_) | Float32x2(_) | Float32x3(_) | Float32x4(_))
}

/// Values of an attribute, and those between them; `None` of formats that are not [divided](is_divided), unless there are none between.
fn longer(
    values: &VertexAttributeValues,
    between: &[([u32; 3], [f64; 3])],
) -> Option<VertexAttributeValues> {
    fn all<const N: usize>(own: &[[f32; N]], between: &[([u32; 3], [f64; 3])]) -> Vec<[f32; N]> {
        let mean = |(points, shares): &([u32; 3], [f64; 3])| {
            let of = |k: usize| {
                points.iter().zip(shares).map(move |(p, w)| own[*p as usize][k] * *w as f32)
            };
            std::array::from_fn(|k| of(k).sum())
        };
        own.iter().copied().chain(between.iter().map(mean)).collect()
    }
    if between.is_empty() {
        return Some(values.clone());
    }
    use VertexAttributeValues::{Float32, Float32x2, Float32x3, Float32x4};
    Some(match values {
        Float32(own) => {
            let own: Vec<[f32; 1]> = own.iter().map(|&x| [x]).collect();
            Float32(all(&own, between).into_iter().flatten().collect())
        }
        Float32x2(own) => Float32x2(all(own, between)),
        Float32x3(own) => Float32x3(all(own, between)),
        Float32x4(own) => Float32x4(all(own, between)),
        _ => return None,
    })
}
