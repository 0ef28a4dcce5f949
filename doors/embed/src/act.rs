//! What acts on bodies: constraints, loads, pressures.

use crate::embedding::Embedding;
use crate::error::{EmbedError, InputError, Result};
use crate::handle::{Handle, HandleError, Kind, Target};
use crate::mesh::{cells, finite, vector, vectors};
use glam::DVec3;
use serde::Serialize;
use sinew::engine::load::{Constraint, Curve, Load, Motion, Pose, Pressure};
use sinew::engine::row::VertexRow;
use sinew::engine::vertex::FixedAxes;
use sinew::simulation::BodyHandle;

/// Faces of a body that bear a traction.
#[derive(Clone, Copy, Debug)]
pub enum TractionOn<'a> {
    /// The boundary of its solid elements, or without these all of its membrane.
    Whole,
    /// Those faces of it that have all their vertices in a group of its mesh.
    Group(&'a str),
    /// Triangles, three vertices each.
    Triangles(&'a [u32]),
    /// Quadrilaterals, four vertices each.
    Quads(&'a [u32]),
}

/// A constraint to be.
#[derive(Clone, Debug)]
pub struct ConstraintSpec<'a> {
    /// Name, unique among constraints.
    pub name: &'a str,
    /// Vertices of the mesh.
    pub vertices: &'a [u32],
    /// Whether x, y and z are held.
    pub axes: [bool; 3],
    /// How they move. What holds can be given targets.
    pub motion: Motion,
    /// Factor on the motion over time.
    pub curve: Curve,
    /// Time (s) from which it acts.
    pub from: f64,
    /// Time (s) after which the vertices are free again.
    pub until: f64,
}

impl<'a> ConstraintSpec<'a> {
    /// Holds vertices where they are, for good.
    pub fn hold(name: &'a str, vertices: &'a [u32]) -> Self {
        Self {
            name,
            vertices,
            axes: [true; 3],
            motion: Motion::Hold,
            curve: Curve::Constant,
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
        }
    }
}

/// A force (N) and its torque (N m) about the point asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Wrench {
    /// Force (N).
    pub force: [f64; 3],
    /// Torque (N m).
    pub torque: [f64; 3],
}

impl Embedding {
    /// Rows of vertices of a body, at least one.
    pub(crate) fn rows(
        &self,
        body: Handle,
        name: &str,
        vertices: &[u32],
    ) -> Result<Vec<VertexRow>> {
        let body = self.body(body)?;
        if vertices.is_empty() {
            return Err(InputError::invalid(format!("`{name}`"), "no vertex is given").into());
        }
        Ok(self.built.simulation.rows(BodyHandle(body), name, vertices)?)
    }

    /// Holds or moves vertices of a body.
    ///
    /// # Errors
    /// When there is no such body, a vertex is in no element, the name is taken or a number cannot be used.
    pub fn add_constraint(&mut self, body: Handle, spec: &ConstraintSpec) -> Result<Handle> {
        let rows = self.rows(body, spec.name, spec.vertices)?;
        self.name_is_free(Kind::Constraint, spec.name)?;
        let invalid = |problem: &str| -> Result<Handle> {
            Err(InputError::invalid(format!("constraint `{}`", spec.name), problem).into())
        };
        match &spec.motion {
            Motion::Hold => {}
            Motion::Translate(by) => finite("translation", &by.to_array())?,
            Motion::TranslateEach(by) if by.len() != rows.len() => {
                return invalid("it needs one translation per vertex");
            }
            Motion::TranslateEach(by) => {
                by.iter().try_for_each(|by| finite("translation", &by.to_array()))?;
            }
            Motion::Rotate { centre, axis, angle } => {
                finite("centre", &centre.to_array())?;
                finite("angle", &[*angle])?;
                if axis.try_normalize().is_none() {
                    return invalid("its axis of rotation has no usable direction");
                }
            }
            Motion::Follow(_) => return invalid("make it with Motion::Hold, then set targets"),
        }
        if let Some(problem) = spec.curve.problem() {
            return invalid(problem);
        }
        if spec.from.is_nan() || spec.until.is_nan() || spec.from >= spec.until {
            return invalid(&format!(
                "it acts from {} s until {} s; make `until` later than `from`",
                spec.from, spec.until
            ));
        }
        let mut constraint =
            Constraint::moving(spec.name, rows, spec.motion.clone(), spec.curve.clone());
        let bits = (0..3).filter(|&k| spec.axes[k]).map(|k| 1u8 << k).sum();
        if bits == 0 {
            return invalid("it holds no axis");
        }
        constraint.axes = FixedAxes(bits);
        (constraint.from, constraint.until) = (spec.from, spec.until);
        let entity = self.built.simulation.add_constraint(constraint);
        Ok(self.handles.add(Kind::Constraint, spec.name, Target::Entity(entity)))
    }

    /// Where what a constraint holds is at the end of the next step, relative to where it took hold; a vector is a translation
    /// (m).
    ///
    /// # Errors
    /// When there is no such constraint, it has a motion of its own, or the pose cannot be used.
    pub fn set_target(&mut self, constraint: Handle, pose: impl Into<Pose>) -> Result<()> {
        let entity = self.constraint(constraint)?;
        Ok(self.built.simulation.set_target(entity, pose)?)
    }

    fn constraint(&self, constraint: Handle) -> Result<bevy_ecs::entity::Entity> {
        let kind = Kind::Constraint;
        let stale = || EmbedError::from(HandleError::Stale { handle: constraint, kind });
        self.entity(constraint, kind)?.ok_or_else(stale)
    }

    /// Force of a constraint on its body at the state as it is, and its torque about a point (m).
    ///
    /// # Errors
    /// When there is no such constraint, or the point is not finite.
    pub fn reaction(&mut self, constraint: Handle, about: [f64; 3]) -> Result<Wrench> {
        let entity = self.constraint(constraint)?;
        let about = vector("point", about)?;
        let found = self.built.simulation.reaction_about(entity, about);
        let stale = HandleError::Stale { handle: constraint, kind: Kind::Constraint };
        let [force, torque] = found.ok_or(stale)?;
        Ok(Wrench { force: force.to_array(), torque: torque.to_array() })
    }

    /// Adds forces (N) on vertices: three numbers for each, or three for all together, which they share evenly.
    ///
    /// # Errors
    /// When there is no such body, a vertex is in no element, the name is taken or a number cannot be used.
    pub fn add_load(
        &mut self,
        body: Handle,
        name: &str,
        vertices: &[u32],
        forces: &[f64],
        curve: Curve,
    ) -> Result<Handle> {
        let rows = self.rows(body, name, vertices)?;
        self.name_is_free(Kind::Load, name)?;
        let forces: Vec<DVec3> = match vectors("forces", forces)?.as_slice() {
            [all] => vec![*all / rows.len() as f64; rows.len()],
            each if each.len() == rows.len() => each.to_vec(),
            other => {
                let (what, given) = ("forces", 3 * other.len());
                let expected = format!("3, or 3 x {}", rows.len());
                return Err(InputError::Count { what, given, expected }.into());
            }
        };
        curve_is_usable("load", name, &curve)?;
        let forces = rows.into_iter().zip(forces).collect();
        let entity = self.built.simulation.add_load(Load { name: name.into(), forces, curve });
        Ok(self.handles.add(Kind::Load, name, Target::Entity(entity)))
    }

    /// Adds a follower pressure (Pa) on triangles, three vertices each, that pushes along their normals.
    ///
    /// # Errors
    /// When there is no such body, a triangle is no face of its elements, the name is taken or a number cannot be used.
    pub fn add_pressure(
        &mut self,
        body: Handle,
        name: &str,
        triangles: &[u32],
        pressure: f64,
        curve: Curve,
    ) -> Result<Handle> {
        self.name_is_free(Kind::Pressure, name)?;
        let faces = self.faces(body, name, triangles)?;
        finite("pressure", &[pressure])?;
        curve_is_usable("pressure", name, &curve)?;
        let own = Pressure { name: name.into(), faces, pressure, curve };
        let entity = self.built.simulation.add_pressure(own);
        Ok(self.handles.add(Kind::Pressure, name, Target::Entity(entity)))
    }

    /// Adds a traction (N/m^2 at rest) that keeps its direction; every vertex of a face gets what its shape function says.
    ///
    /// # Errors
    /// When there is no such body or group, a face is none of its elements, the name is taken or a number cannot be
    /// used.
    pub fn add_traction(
        &mut self,
        body: Handle,
        name: &str,
        on: TractionOn<'_>,
        traction: [f64; 3],
        curve: Curve,
    ) -> Result<Handle> {
        self.name_is_free(Kind::Load, name)?;
        let index = self.body(body)?;
        let points = self.vertex_count(body)?;
        let mesh = self.mesh(body)?;
        let (triangles, quads) = match on {
            TractionOn::Triangles(list) => (cells("triangles", list, points)?, Vec::new()),
            TractionOn::Quads(list) => (Vec::new(), cells("quads", list, points)?),
            _ if mesh.is_solid() => {
                let surface = mesh.surface();
                (surface.triangles, surface.quads)
            }
            _ => (mesh.triangles.clone(), mesh.quads.clone()),
        };
        let mut on_faces = sinew::engine::mesh::Surface { triangles, quads };
        if let TractionOn::Group(group) = on {
            let mut chosen = self.group(body, group)?;
            chosen.sort_unstable();
            let within = |face: &[u32]| face.iter().all(|v| chosen.binary_search(v).is_ok());
            on_faces.triangles.retain(|t| within(t));
            on_faces.quads.retain(|q| within(q));
        }
        if on_faces.triangles.is_empty() && on_faces.quads.is_empty() {
            return Err(InputError::invalid(format!("`{name}`"), "no face is given").into());
        }
        let traction = vector("traction", traction)?;
        curve_is_usable("load", name, &curve)?;
        let simulation = &mut self.built.simulation;
        let faces = simulation.traction_faces(BodyHandle(index), name, &on_faces, traction)?;
        let entity = simulation.add_loaded_faces(name, faces, curve);
        Ok(self.handles.add(Kind::Load, name, Target::Entity(entity)))
    }

    /// Rows of triangles of a body, at least one.
    pub(crate) fn faces(
        &self,
        body: Handle,
        name: &str,
        triangles: &[u32],
    ) -> Result<Vec<[VertexRow; 3]>> {
        let index = self.body(body)?;
        let triangles = cells::<3>("triangles", triangles, self.vertex_count(body)?)?;
        if triangles.is_empty() {
            return Err(InputError::invalid(format!("`{name}`"), "no triangle is given").into());
        }
        Ok(self.built.simulation.face_rows(BodyHandle(index), name, &triangles)?)
    }
}

fn curve_is_usable(kind: &str, name: &str, curve: &Curve) -> Result<()> {
    match curve.problem() {
        None => Ok(()),
        Some(problem) => Err(InputError::invalid(format!("{kind} `{name}`"), problem).into()),
    }
}
