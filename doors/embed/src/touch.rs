//! Tools, contact between bodies, pulls, and picking.

use crate::embedding::Embedding;
use crate::error::{EmbedError, InputError, Result};
use crate::handle::{Handle, HandleError, Kind, Target};
use crate::mesh::vector;
use bevy_ecs::entity::Entity;
use sinew::engine::load::Pose;
use sinew::simulation::{Backend, BodyHandle};
use sinew::touch::pair::{BodyContact, BodyContactReport};
use sinew::touch::pull::{Pull, PullReport};
use sinew::touch::tool::{Stiffness, Tool, ToolPose, ToolReport};

/// A pull to be: a spring and a damper from vertices to a moving pose.
#[derive(Clone, Copy, Debug)]
pub struct PullSpec<'a> {
    /// Name, unique among pulls.
    pub name: &'a str,
    /// Vertices of the mesh.
    pub vertices: &'a [u32],
    /// Share of each in the stiffness; all the same without.
    pub weights: &'a [f64],
    /// Stiffness (N/m) of all together.
    pub stiffness: f64,
    /// Damping (N s/m) of all together.
    pub damping: f64,
}

/// A point of a surface that a ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Body.
    pub body: Handle,
    /// Vertices of the triangle.
    pub vertices: [u32; 3],
    /// Barycentric coordinates of the point in it, for [`PullSpec::weights`].
    pub weights: [f64; 3],
    /// The point (m).
    pub position: [f64; 3],
    /// Distance (m) from the origin of the ray.
    pub distance: f64,
}

impl Embedding {
    /// Entity of a tool, contact or pull that is there.
    pub(crate) fn touching(&self, handle: Handle, kind: Kind) -> Result<Entity> {
        let stale = || EmbedError::from(HandleError::Stale { handle, kind });
        self.entity(handle, kind)?.ok_or_else(stale)
    }

    /// Refuses what a graphics processor does not have.
    pub(crate) fn can_touch(&self, kind: Kind) -> Result<()> {
        match self.backend() {
            Backend::Cpu => Ok(()),
            Backend::Gpu => {
                let problem = format!("backend \"gpu\" knows no {kind}; use backend = \"cpu\"");
                Err(InputError::invalid(kind.name(), problem).into())
            }
        }
    }

    /// Adds a tool, which touches all surfaces, or only some triangles of a body, three vertices each.
    ///
    /// # Errors
    /// When a size, coefficient or time of it cannot be used, or a triangle is no face.
    pub fn add_tool(&mut self, mut tool: Tool, on: Option<(Handle, &[u32])>) -> Result<Handle> {
        self.can_touch(Kind::Tool)?;
        self.name_is_free(Kind::Tool, &tool.name)?;
        if let Some((body, triangles)) = on {
            tool.faces = Some(self.faces(body, &tool.name, triangles)?);
        }
        let name = tool.name.clone();
        let entity = self.built.simulation.add_tool(tool)?;
        Ok(self.handles.add(Kind::Tool, name, Target::Entity(entity)))
    }

    /// Moves a tool: it is there at the end of the next step, evenly through the step.
    ///
    /// # Errors
    /// When there is no such tool, it has a motion of its own, or the pose cannot be used.
    pub fn move_tool(&mut self, tool: Handle, pose: impl Into<ToolPose>) -> Result<()> {
        let entity = self.touching(tool, Kind::Tool)?;
        Ok(self.built.simulation.move_tool(entity, pose)?)
    }

    /// Puts a tool somewhere else at once.
    ///
    /// # Errors
    /// As [`Embedding::move_tool`].
    pub fn place_tool(&mut self, tool: Handle, pose: impl Into<ToolPose>) -> Result<()> {
        let entity = self.touching(tool, Kind::Tool)?;
        Ok(self.built.simulation.place_tool(entity, pose)?)
    }

    /// Whether what touches a tool sticks to it, however little it is pressed.
    pub fn set_grip(&mut self, tool: Handle, grip: bool) -> Result<()> {
        let entity = self.touching(tool, Kind::Tool)?;
        self.built.simulation.set_grip(entity, grip)?;
        // a grip that the scene opens and closes is the host's from now on
        for own in self.built.tools.iter_mut().filter(|own| own.entity == entity) {
            own.grip = None;
        }
        Ok(())
    }

    /// What a tool and its parts felt in the last step.
    pub fn tool_report(&self, tool: Handle) -> Result<ToolReport> {
        let entity = self.touching(tool, Kind::Tool)?;
        let own = self.built.tools.iter().find(|own| own.entity == entity);
        Ok(match own {
            Some(own) => own.report(&self.built.simulation),
            None => self.built.simulation.tool_report(entity).cloned().unwrap_or_default(),
        })
    }

    /// Lets two bodies touch each other; the same one twice for a body that touches itself.
    ///
    /// # Errors
    /// When there is no such body, the name is taken or a number cannot be used.
    pub fn add_contact(
        &mut self,
        name: &str,
        bodies: [Handle; 2],
        friction: f64,
        stiffness: Stiffness,
    ) -> Result<Handle> {
        self.can_touch(Kind::Contact)?;
        self.name_is_free(Kind::Contact, name)?;
        let bodies = [self.body(bodies[0])?, self.body(bodies[1])?];
        let mut contact = BodyContact::new(name, bodies.map(BodyHandle)).with_friction(friction);
        contact.stiffness = stiffness;
        if let Some(problem) = contact.problem(self.built.bodies.len()) {
            return Err(InputError::invalid(format!("contact `{name}`"), problem).into());
        }
        let entity = self.built.simulation.add_body_contact(contact);
        Ok(self.handles.add(Kind::Contact, name, Target::Entity(entity)))
    }

    /// What two bodies did to each other in the last step.
    pub fn contact_report(&self, contact: Handle) -> Result<BodyContactReport> {
        let entity = self.touching(contact, Kind::Contact)?;
        Ok(self.built.simulation.body_contact_report(entity).copied().unwrap_or_default())
    }

    /// Pulls on vertices from the next step on.
    ///
    /// # Errors
    /// When there is no such body, a vertex is in no element, the name is taken or a number cannot be used.
    pub fn add_pull(&mut self, body: Handle, spec: &PullSpec) -> Result<Handle> {
        self.can_touch(Kind::Pull)?;
        let rows = self.rows(body, spec.name, spec.vertices)?;
        self.name_is_free(Kind::Pull, spec.name)?;
        let mut pull = Pull::new(spec.name, rows, spec.stiffness, spec.damping);
        if !spec.weights.is_empty() {
            pull = pull.with_weights(spec.weights.to_vec());
        }
        if let Some(problem) = pull.problem(self.built.simulation.topology().vertex_count()) {
            return Err(InputError::invalid(format!("pull `{}`", spec.name), problem).into());
        }
        let entity = self.built.simulation.add_pull(pull);
        Ok(self.handles.add(Kind::Pull, spec.name, Target::Entity(entity)))
    }

    /// Where the hand of a pull is at the end of the next step, relative to where its vertices were when it took hold; a vector
    /// is a translation (m).
    ///
    /// # Errors
    /// When there is no such pull, the scene moves it, or the pose cannot be used.
    pub fn move_pull(&mut self, pull: Handle, pose: impl Into<Pose>) -> Result<()> {
        let invalid = |problem: String| Err(InputError::invalid("pull", problem).into());
        if let Target::Scene(index) = self.handles.get(pull, Kind::Pull)? {
            let name = &self.built.pulls[index].name;
            return invalid(format!(
                "`{name}` moves as the scene says and cannot be given targets"
            ));
        }
        let entity = self.touching(pull, Kind::Pull)?;
        let mut pose = pose.into();
        let length = pose.rotation.length();
        if !(pose.translation.is_finite() && pose.centre.is_finite() && length.is_normal()) {
            return invalid(format!("its target {pose:?} is not finite, or its rotation is none"));
        }
        pose.rotation /= length;
        self.built.simulation.move_pull(entity, pose);
        Ok(())
    }

    /// What a pull did in the last step; nothing while one of a scene does not act.
    pub fn pull_report(&self, pull: Handle) -> Result<PullReport> {
        let simulation = &self.built.simulation;
        Ok(match self.handles.get(pull, Kind::Pull)? {
            Target::Scene(index) => self.built.pulls[index].report(simulation),
            Target::Entity(entity) => simulation.pull_report(entity).copied().unwrap_or_default(),
            Target::Body(_) => unreachable!("bodies are no pulls"),
        })
    }

    /// The first point of a surface that a ray from `origin` (m) meets; `direction` may have any length.
    ///
    /// # Errors
    /// When a number is not finite, or the direction has no length.
    pub fn pick(&mut self, origin: [f64; 3], direction: [f64; 3]) -> Result<Option<Pick>> {
        let (origin, direction) = (vector("origin", origin)?, vector("direction", direction)?);
        if direction.try_normalize().is_none() {
            return Err(InputError::invalid("direction", "it has no length").into());
        }
        let simulation = &mut self.built.simulation;
        let Some(pick) = simulation.pick(origin, direction) else { return Ok(None) };
        let rows = &simulation.topology().bodies[pick.body];
        let vertices = pick.rows.map(|row| rows.vertex(row).0);
        Ok(self.handles.of_body(pick.body).map(|body| Pick {
            body,
            vertices,
            weights: pick.weights,
            position: pick.position.to_array(),
            distance: pick.distance,
        }))
    }
}
