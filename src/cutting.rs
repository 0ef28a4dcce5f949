//! Cuts of bodies of a [`Simulation`].

use crate::simulation::{Backend, BodyHandle, Simulation};
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::by_precision;
use sinew_engine::row::VertexRow;
use sinew_models::cutting::glue::{GlueReport, glue_report};
use sinew_models::cutting::{
    CutError, CutReport, FineSurface, MaterialSkin, carries_surface, carry_surface, check_cut,
    cut_body, drop_surface, is_cut, node_places, node_velocities, update_skin,
};
use std::sync::Arc;

/// # Cuts
impl Simulation {
    /// Cuts a body along the surface that a blade sweeps, at once, from now on: its edge is at `[p, q]` (m), one position
    /// after another, in the present shape of the body. Mass and momentum are the same before and after, and energy as far as
    /// [`sinew_models::cutting`] says, which tells what can be cut, too. The body needs [spare](sinew_models::body::BodyDescription::spare) vertices.
    ///
    /// # Errors
    /// When the strip cannot be used, the body is none that can be cut, or a pressure acts on elements with Gauss points that would be parted; nothing is changed then. A strip beside the body is no error.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    ///
    /// let mesh = box_tets(DVec3::new(0.2, 0.1, 0.1), [8, 4, 4])?;
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let block = BodyDescription::new("block", &mesh, preset("liver")?.material);
    /// let body = simulation.add_body(&BodyDescription { spare: 200, ..block })?;
    /// let wall = simulation.group_rows(body, &mesh, "x0")?;
    /// simulation.add_constraint(Constraint::hold("wall", wall));
    /// // right through, somewhat oblique
    /// let edge = |y: f64| [DVec3::new(0.09, y, 0.11), DVec3::new(0.11, y, -0.01)];
    /// let report = simulation.cut(body, &[edge(-0.01), edge(0.11)])?;
    /// assert_eq!(report.pieces, 2);
    /// // what is behind the cut falls freely
    /// let integrator = Integrator::Safe;
    /// simulation.set_solver(SolverSettings { integrator, ..SolverSettings::default() });
    /// for _ in 0..10 {
    ///     simulation.step()?;
    /// }
    /// let tip = mesh.group("x1").ok_or("no such group")?.vertices[0] as usize;
    /// let fallen = -simulation.displacements(body)[tip].z;
    /// let time = simulation.time();
    /// assert!((fallen / (0.5 * 9.81 * time * (time + 0.01)) - 1.0).abs() < 1e-3);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn cut(&mut self, body: BodyHandle, strip: &[[DVec3; 2]]) -> Result<CutReport, CutError> {
        self.check_cut(body)?;
        let precision = self.precision();
        by_precision!(precision, cut_body(self.world_mut(), body.0, strip))
    }

    /// Whether a body can be cut, as far as that does not depend on the blade.
    ///
    /// # Errors
    /// Says why not, and what helps.
    pub fn check_cut(&mut self, body: BodyHandle) -> Result<(), CutError> {
        if self.backend() == Backend::Gpu
            && let Some(rows) = self.topology().bodies.get(body.0)
        {
            let problem = "backend = \"gpu\" has no cuts; use backend = \"cpu\"".into();
            return Err(CutError::Body { body: rows.name.clone(), problem });
        }
        check_cut(self.world_mut(), body.0)
    }

    /// What the [glue](sinew_models::cutting::glue) of a body does; `None` where it has none.
    pub fn glue_report(&self, body: BodyHandle) -> Option<GlueReport> {
        by_precision!(self.precision(), glue_report(self.world(), body.0))
    }

    /// The surface of the material of a body that can be cut: faces of its mesh as far as they have material, and both sides
    /// of its wounds, in the present shape. Of a membrane alone all that is left of it.
    ///
    /// # Errors
    /// When the body is none that can be cut.
    pub fn skin(&mut self, body: BodyHandle) -> Result<MaterialSkin, CutError> {
        let mut skin = MaterialSkin::default();
        self.update_skin(body, &mut skin)?;
        Ok(skin)
    }

    /// Lets a body of tetrahedra or hexahedra that can be cut carry a finer surface along: points (m) in the frame of its mesh, and triangles
    /// of them, outward. It takes the place of all of its [skin](Self::skin) that no cut laid open: points move by the shape functions of the
    /// element in which they lie, or the nearest, and triangles through which a wound goes are divided along it. What was removed carries nothing.
    ///
    /// # Errors
    /// When the body is none such, or a triangle has a point that there is not; nothing is changed then.
    pub fn carry_surface(
        &mut self,
        body: BodyHandle,
        points: &[DVec3],
        triangles: &[[u32; 3]],
    ) -> Result<Arc<FineSurface>, CutError> {
        self.check_cut(body)?;
        carry_surface(self.world_mut(), body.0, points, triangles)
    }

    /// Lets a body [carry no surface](Self::carry_surface) any more: its skin is that of its mesh again.
    pub fn drop_surface(&mut self, body: BodyHandle) {
        drop_surface(self.world_mut(), body.0);
    }

    /// Whether a body [carries a surface](Self::carry_surface) along.
    pub fn carries_surface(&self, body: BodyHandle) -> bool {
        carries_surface(self.world(), body.0)
    }

    /// Whether it does, or was cut: what is drawn of it is its [skin](Self::skin) then.
    pub fn has_skin(&self, body: BodyHandle) -> bool {
        self.is_cut(body) || self.carries_surface(body)
    }

    /// Makes a [`skin`](Self::skin) of this simulation that of the present shape. While nothing was cut or removed since it was
    /// made, only its points move: for every frame. Whether it is made anew.
    ///
    /// # Errors
    /// When the body is none that can be cut.
    pub fn update_skin(
        &mut self,
        body: BodyHandle,
        skin: &mut MaterialSkin,
    ) -> Result<bool, CutError> {
        let precision = self.precision();
        by_precision!(precision, update_skin(self.columns(), body.0, skin))
    }

    /// Whether a body was cut.
    pub fn is_cut(&self, body: BodyHandle) -> bool {
        is_cut(self.world(), body.0)
    }

    /// Places (m) of the vertices of the mesh of a body, then of those that cuts made: the nodes of its skin.
    pub fn node_places(&mut self, body: BodyHandle) -> Vec<DVec3> {
        let precision = self.precision();
        by_precision!(precision, node_places(self.columns(), body.0))
    }

    /// Velocities (m/s) of the same.
    pub fn node_velocities(&mut self, body: BodyHandle) -> Vec<DVec3> {
        let precision = self.precision();
        by_precision!(precision, node_velocities(self.columns(), body.0))
    }

    /// Vertex rows of the elements that cuts parted.
    pub(crate) fn parted_elements(&self, body: BodyHandle) -> Vec<Vec<VertexRow>> {
        let rows = &self.topology().bodies[body.0];
        let kind = rows.copies.kind;
        let all = 0..rows.copies.portions.len() as u32;
        let parted = all.filter(|&e| !rows.is_whole(kind, e));
        let of = |e| rows.nodes[kind].of(e).iter().map(|v| VertexRow(v + rows.vertices.start));
        parted.map(|e| of(e).collect()).collect()
    }
}
