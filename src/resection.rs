//! Removal of elements from a [`Simulation`].

use crate::simulation::{BodyHandle, Simulation};
use crate::warning::totals::RunTotals;
use bevy_ecs::prelude::Entity;
use sinew_contact::pair::BodyContact;
use sinew_contact::pull::Pull;
use sinew_engine::by_precision;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::load::{Constraint, Load, Pressure};
use sinew_engine::resource::ensure;
use sinew_engine::row::{LocalRow, VertexRow};
use sinew_models::body::BodyError;
use sinew_models::body::present::Resection;
use sinew_models::cutting::tear::Tear;
use sinew_models::resection::{
    FreshDifference, Region, Removal, RemovalError, RemovalReport, compare_with_fresh,
    prepare_removals, remove_elements,
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
        ensure::<RunTotals>(world).add_removal(&report);
        Ok(report)
    }

    /// Takes a body away, from now on: all its elements, with their mass and energy. Constraints, loads, pressures, pulls and
    /// contacts that act on nothing else go with it, and those of several bodies keep what they have of the others. Its name is
    /// free again. Its handle and its vertex rows stay, so that those of other bodies do not change; a step passes over them.
    ///
    /// Bodies are added to a running simulation as before the first step, by [`Simulation::add_body`]. Snapshots are of the bodies
    /// that were added until then: one from before does not fit afterwards, and says so.
    ///
    /// # Errors
    /// When elements of the bodies got other components meanwhile.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    ///
    /// let mesh = box_tets(DVec3::splat(0.05), [2, 2, 2])?;
    /// let block = BodyDescription::new("block", &mesh, preset("liver")?.material);
    /// let mut simulation = Simulation::new(SimulationOptions::default())?;
    /// let first = simulation.add_body(&block)?;
    /// let floor = simulation.group_rows(first, &mesh, "z0")?;
    /// let floor = simulation.add_constraint(Constraint::hold("floor", floor));
    /// simulation.step()?;
    /// let report = simulation.remove_body(first)?;
    /// assert_eq!((report.tetrahedra.len(), report.remaining), (48, 0));
    /// assert!(simulation.find_body("block").is_none() && simulation.reaction(floor).is_none());
    /// // another one of the same name, which falls
    /// let second = simulation.add_body(&block)?;
    /// simulation.step()?;
    /// assert_eq!(simulation.find_body("block"), Some(second));
    /// assert!(simulation.velocities(second).iter().all(|v| v.z < -0.09));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn remove_body(&mut self, body: BodyHandle) -> Result<RemovalReport, RemovalError> {
        let report = self.remove_elements(body, &Removal::new(Region::Everything))?;
        let own = self.topology().bodies[body.0].vertices.clone();
        let stays = |row: &VertexRow| !own.contains(&row.0);
        let world = self.world_mut();
        let mut gone = Vec::new();
        for (entity, mut constraint) in world.query::<(Entity, &mut Constraint)>().iter_mut(world) {
            if constraint.rows.iter().all(stays) {
                continue;
            }
            let Constraint { rows, start, .. } = &mut *constraint;
            if start.len() == rows.len() {
                let mut kept = rows.iter().map(stays);
                start.retain(|_| kept.next() == Some(true));
            }
            rows.retain(stays);
            gone.extend(rows.is_empty().then_some(entity));
        }
        for (entity, mut load) in world.query::<(Entity, &mut Load)>().iter_mut(world) {
            if !load.forces.iter().all(|(row, _)| stays(row)) {
                load.forces.retain(|(row, _)| stays(row));
                gone.extend(load.forces.is_empty().then_some(entity));
            }
        }
        for (entity, pressure) in world.query::<(Entity, &Pressure)>().iter(world) {
            // its faces went with their elements
            gone.extend(pressure.faces.is_empty().then_some(entity));
        }
        for (entity, pull) in world.query::<(Entity, &Pull)>().iter(world) {
            gone.extend((!pull.rows.iter().all(stays)).then_some(entity));
        }
        for (entity, contact) in world.query::<(Entity, &BodyContact)>().iter(world) {
            gone.extend(contact.bodies.contains(&body.0).then_some(entity));
        }
        for (entity, tear) in world.query::<(Entity, &Tear)>().iter(world) {
            gone.extend((tear.body == body.0).then_some(entity));
        }
        for entity in gone {
            world.despawn(entity);
        }
        Ok(report)
    }

    /// Finds out now what the first removal from a body needs to know, so that it costs no more than
    /// later ones.
    ///
    /// # Errors
    /// When there is no such body.
    pub fn prepare_removals(&mut self, body: BodyHandle) -> Result<(), RemovalError> {
        prepare_removals(self.columns(), body.0)
    }

    /// Elements of a kind that are left, by their indices in the user's mesh or list, ascending; copies that cuts made are
    /// numbered after those of the mesh.
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
    /// their indices in the user's mesh. Faces that a cut parted are not among them: [`Simulation::skin`] has them. Faces of hexahedra are cut into two triangles. It is kept up to date
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
        let surface = surface.filter(|(_, kind, e)| rows.is_whole(*kind, *e));
        let user = |(triangle, kind, e): ([u32; 3], ElementKind, u32)| {
            let vertices = triangle.map(|v| rows.vertex_of(LocalRow(v)).0);
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
