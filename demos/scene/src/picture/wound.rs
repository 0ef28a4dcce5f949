//! The skins of bodies that can be cut, in a recording. Points that cuts made come after all others, and there are more of them after
//! every cut; points of a surface that a body carries have places of their own for ever.

use super::boundary::Face;
use super::measure::Parted;
use crate::assemble::BuiltBody;
use glam::DVec3;
use sinew::models::cutting::{MaterialSkin, cut_material};
use sinew::simulation::Simulation;
use std::collections::BTreeSet;

/// The skin of a body since it was cut, or from the start where it carries a surface.
#[derive(Default)]
pub(super) struct Wound {
    pub skin: MaterialSkin,
    /// Vertices of the mesh, which are the first points of the skin.
    vertices: usize,
    /// Points of it that have their places among those recorded for ever: these, and those of a surface that the body carries.
    pub fixed: usize,
    /// Where its other points begin among those recorded.
    pub first: usize,
}

impl Wound {
    /// The skin as it is now; whether there is one.
    pub fn faces(&mut self, simulation: &mut Simulation, body: &BuiltBody) -> Option<Vec<Face>> {
        self.vertices = body.mesh.points.len();
        let carried = body.carried.as_ref().filter(|_| simulation.carries_surface(body.handle));
        self.fixed = self.vertices + carried.map_or(0, |carried| carried.points.len());
        simulation.update_skin(body.handle, &mut self.skin).ok()?;
        let material = cut_material(simulation.world(), body.handle.0);
        let kind = body.solid_kind();
        // what cuts parted has no shape of its own that vertices of the mesh would tell
        let is_whole = |vertices: &[u32; 3], e: u32| {
            let is_parted = material.is_some_and(|material| material.is_parted(e));
            !is_parted && vertices.iter().all(|&v| (v as usize) < self.vertices)
        };
        let face = |(&vertices, &e): (&[u32; 3], &u32)| Face {
            vertices,
            element: kind.filter(|_| is_whole(&vertices, e)).map(|kind| (kind, e)),
            second: false,
        };
        Some(self.skin.triangles.iter().zip(&self.skin.elements).map(face).collect())
    }

    /// Where a point is among those recorded, if a cut made it.
    pub fn place(&self, point: u32) -> Option<u32> {
        let made = (point as usize).checked_sub(self.fixed)?;
        Some((self.first + made) as u32)
    }

    /// Places at rest of the points that cuts made, with the depths of those on wounds.
    pub fn made(&self) -> impl Iterator<Item = ([f32; 3], f32)> {
        let skin = &self.skin;
        let mut depth = vec![f32::NAN; skin.points.len()];
        for (triangle, _) in skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound) {
            triangle.iter().for_each(|&v| depth[v as usize] = skin.depth[v as usize] as f32);
        }
        let rest = skin.rest.iter().map(|x| x.as_vec3().to_array());
        rest.zip(depth).skip(self.fixed)
    }

    /// Numbers of the points of a surface that the body carries.
    pub fn of_surface(&self) -> std::ops::Range<usize> {
        self.vertices..self.fixed
    }

    /// Moves the points, adds the displacements of the vertices that cuts made, and tells the pieces that they move.
    pub fn update(
        &mut self,
        simulation: &mut Simulation,
        body: &BuiltBody,
        u: &mut Vec<DVec3>,
    ) -> Vec<Parted> {
        let at = simulation.node_places(body.handle);
        let moved = simulation.update_skin(body.handle, &mut self.skin);
        let Some(material) =
            cut_material(simulation.world(), body.handle.0).filter(|_| moved.is_ok())
        else {
            return Vec::new();
        };
        let rest = |&vertex: &u32| body.mesh.points[vertex as usize];
        u.extend(at[self.vertices..].iter().zip(&material.ghosts).map(|(x, of)| *x - rest(of)));
        // of solid elements those that fill what is left of them, of a membrane alone its triangles
        let kind = body.solid_kind();
        let solid = self.skin.cells.iter().map(|(_, e)| *e);
        let sheets = self.skin.elements.iter().copied().filter(|_| kind.is_none());
        let is_parted = |e: &u32| kind.is_some() || material.is_parted(*e);
        let pieces: BTreeSet<u32> = solid.chain(sheets).filter(is_parted).collect();
        let size = material.order.size();
        let parted = |e: u32| {
            let element = &material.elements[e as usize];
            let place = |v| (0..size).find(|&i| element.vertex(i) == v).unwrap_or(0);
            let source = element.source as usize;
            let vertices = match kind.and_then(|kind| body.mesh.cell(kind, source)) {
                Some(own) => own.to_vec(),
                None => body.membrane_triangles()[source].to_vec(),
            };
            let nodes = vertices.into_iter().map(|v| element.node(place(v))).collect();
            Parted { source: element.source, nodes, share: element.share() }
        };
        pieces.into_iter().map(parted).collect()
    }
}
