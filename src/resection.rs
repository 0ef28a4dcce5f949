//! Removal of elements from a [`Simulation`].

use crate::simulation::{BodyHandle, Simulation};
use crate::warning::totals::RunTotals;
use sinew_engine::by_precision;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::row::LocalRow;
use sinew_models::body::BodyError;
use sinew_models::body::present::Resection;
use sinew_models::resection::{
    FreshDifference, Removal, RemovalError, RemovalReport, compare_with_fresh, prepare_removals,
    remove_elements,
};

/// # Removal
impl Simulation {
    /// Removes elements of a body, from now on; see [`sinew_models::resection`]. To do so from a
    /// schedule, spawn a [`RemovalRequest`](sinew_models::resection::RemovalRequest).
    ///
    /// # Errors
    /// When the region cannot be used, or names an element that does not exist, is gone already or
    /// comes twice; nothing is changed then.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    /// use sinew::models::resection::{Region, Removal};
    ///
    /// let mesh = box_tets(DVec3::new(0.2, 0.1, 0.1), [2, 1, 1])?;
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let material = preset("liver")?.material;
    /// let body = simulation.add_body(&BodyDescription::new("box", &mesh, material))?;
    /// let half = Region::Sphere { centre: DVec3::new(0.05, 0.05, 0.05), radius: 0.07 };
    /// let report = simulation.remove_elements(body, &Removal::new(half))?;
    /// assert_eq!((report.tetrahedra.len(), report.remaining, report.pieces), (6, 6, 1));
    /// assert_eq!(report.orphans.len(), 4);
    /// assert!((report.mass - 1e-3 * material.density).abs() < 1e-12);
    /// simulation.step()?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn remove_elements(
        &mut self,
        body: BodyHandle,
        removal: &Removal,
    ) -> Result<RemovalReport, RemovalError> {
        let precision = self.precision();
        let world = self.world_mut();
        let report = by_precision!(precision, remove_elements(world, body.0, removal))?;
        world.get_resource_or_init::<RunTotals>().add_removal(&report);
        Ok(report)
    }

    /// Finds out now what the first removal from a body needs to know, so that it costs no more than
    /// later ones.
    ///
    /// # Errors
    /// When there is no such body.
    pub fn prepare_removals(&mut self, body: BodyHandle) -> Result<(), RemovalError> {
        prepare_removals(self.world_mut(), body.0)
    }

    /// Elements of a kind that are left, by their indices in the user's mesh or list, ascending.
    pub fn remaining(&self, body: BodyHandle, kind: ElementKind) -> Vec<u32> {
        let rows = &self.topology().bodies[body.0];
        let resection = self.world().get_resource::<Resection>();
        let connectivity = resection.and_then(|r| r.connectivity(body.0));
        let mut left: Vec<u32> = (0..)
            .zip(&rows.order[kind])
            .filter(|(e, _)| connectivity.is_none_or(|c| c.is_present(kind, *e)))
            .map(|(_, &index)| index)
            .collect();
        left.sort_unstable();
        left
    }

    /// Tetrahedra that are left, by their indices in the user's mesh, ascending.
    pub fn remaining_tetrahedra(&self, body: BodyHandle) -> Vec<u32> {
        self.remaining(body, ElementKind::Tetrahedron)
    }

    /// Membrane triangles that are left, by their indices in the user's list, ascending.
    pub fn remaining_triangles(&self, body: BodyHandle) -> Vec<u32> {
        self.remaining(body, ElementKind::Triangle)
    }

    /// Triangles of the surface of what is left of the solid, outward, each with the element behind it; all by
    /// their indices in the user's mesh. Faces of hexahedra are cut into two triangles. It is kept up to date
    /// by removals: the cost is that of the list, once the body is prepared.
    ///
    /// # Errors
    /// When there is no such body.
    pub fn surface(
        &mut self,
        body: BodyHandle,
    ) -> Result<Vec<([u32; 3], ElementKind, u32)>, RemovalError> {
        self.prepare_removals(body)?;
        let rows = &self.topology().bodies[body.0];
        let resection = self.world().get_resource::<Resection>();
        let connectivity = resection.and_then(|r| r.connectivity(body.0));
        let surface = connectivity.into_iter().flat_map(|c| c.surface());
        let user = |(triangle, kind, e): ([u32; 3], ElementKind, u32)| {
            let vertices = triangle.map(|v| rows.vertex_order[LocalRow(v)].0);
            (vertices, kind, rows.order[kind][e as usize])
        };
        Ok(surface.map(user).collect())
    }

    /// Holds a body that lost elements against one built anew from what is left, at the present state;
    /// see [`compare_with_fresh`].
    ///
    /// # Errors
    /// When that body cannot be built.
    pub fn verify_against_fresh(&mut self, body: BodyHandle) -> Result<FreshDifference, BodyError> {
        let precision = self.precision();
        let world = self.world_mut();
        by_precision!(precision, compare_with_fresh(world, body.0))
    }
}
