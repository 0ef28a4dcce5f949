//! Bodies: adding, reading, changing.

use crate::cut::SkinBuffer;
use crate::embedding::Embedding;
use crate::error::{InputError, Result};
use crate::handle::{Handle, Kind, Target};
use crate::mesh::{group, in_range, vectors_of};
use glam::DVec3;
use serde::Deserialize;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::{CheckOptions, Mesh, check};
use sinew::models::body::present::MassPolicy;
use sinew::models::body::sheet::MembraneSettings;
use sinew::models::body::{BodyDescription, SoftBody};
use sinew::models::material::YoungPoisson;
use sinew::models::material::field::{MaterialArrays, MaterialField};
use sinew::models::resection::{Region, Removal, RemovalReport};
use sinew::simulation::{BodyHandle, MaterialChange};
use sinew_scene::assemble::{BuiltBody, BuiltMembrane};
use std::borrow::Cow;

/// Vectors of a body in the user's order, as of an epoch.
#[derive(Clone, Debug, Default)]
struct Buffer {
    epoch: u64,
    values: Vec<[f64; 3]>,
}

/// What a body lends out; everything is sized and filled when it is asked for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Buffers {
    /// Positions, displacements, velocities.
    vectors: [Buffer; 3],
    surface: Vec<[u32; 3]>,
    revision: u64,
    /// Count of removals that the surface is of.
    changes: Option<u64>,
    /// The epoch in which the count was looked at.
    looked: u64,
    pub skin: SkinBuffer,
}

impl Buffers {
    /// Has the surface looked at anew.
    pub fn forget_surface(&mut self) {
        (self.changes, self.looked) = (None, 0);
        self.skin.forget();
    }
}

/// Triangles of the outside of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Surface<'a> {
    /// Outside of what is left of the solid, of elements that are whole after a cut, outward, then membranes that do not lie on it; faces of four corners are cut in
    /// two. Indices of the user's mesh.
    pub triangles: &'a [[u32; 3]],
    /// Changes whenever they do, and never comes again.
    pub revision: u64,
}

/// What can be read of a body; the numbers never change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Quantity {
    /// [`Embedding::positions`].
    Positions = 0,
    /// [`Embedding::displacements`].
    Displacements = 1,
    /// [`Embedding::velocities`].
    Velocities = 2,
    /// [`Embedding::elastic_forces`].
    ElasticForces = 3,
    /// [`Embedding::external_forces`].
    ExternalForces = 4,
    /// [`Embedding::contact_forces`].
    ContactForces = 5,
    /// [`Embedding::contact_pressures`].
    ContactPressures = 6,
    /// [`Embedding::masses`].
    Masses = 7,
    /// [`Embedding::volume_ratios`].
    VolumeRatios = 8,
    /// [`Embedding::area_ratios`].
    AreaRatios = 9,
    /// Of a body that tears, its `TearReport`: area, elements parted, vertices made, tears begun, stress, energy release, pieces and way.
    Tear = 10,
    /// Of a thread or clip, its `ThreadReport`: largest tension, length, work, dissipation, points lost, whether it broke, and whether
    /// the step did not converge.
    Thread = 11,
    /// Numbers of the points that hold a thread or clip.
    ThreadHeld = 12,
    /// Their places.
    ThreadPoints = 13,
    /// Tensions between them.
    ThreadTensions = 14,
    /// Distances between them.
    ThreadSpans = 15,
    /// Free lengths between them.
    ThreadFree = 16,
    /// Lengths that slid through all its points.
    ThreadSlid = 17,
    /// Forces on its two ends.
    ThreadEnds = 18,
    /// Of a body with glue, its `GlueReport`: springs, energy and energy released.
    Glue = 19,
}

impl Quantity {
    /// That of a number.
    pub fn of(number: u32) -> Option<Self> {
        use Quantity::*;
        let all = [
            Positions,
            Displacements,
            Velocities,
            ElasticForces,
            ExternalForces,
            ContactForces,
            ContactPressures,
            Masses,
            VolumeRatios,
            AreaRatios,
            Tear,
            Thread,
            ThreadHeld,
            ThreadPoints,
            ThreadTensions,
            ThreadSpans,
            ThreadFree,
            ThreadSlid,
            ThreadEnds,
            Glue,
        ];
        all.into_iter().find(|own| *own as u32 == number)
    }
}

/// Which vectors are kept in buffers.
#[derive(Clone, Copy, Debug)]
enum Kept {
    Position = 0,
    Displacement = 1,
    Velocity = 2,
}

impl Embedding {
    /// Adds a body: points and solid elements of a mesh, everything else from a description. As in scenes the mesh is checked
    /// first, cells of wrong winding are turned, and findings become [`Embedding::warnings`].
    ///
    /// # Errors
    /// When mesh, material, membrane or axes cannot be used; nothing is added then.
    pub fn add_body(&mut self, mesh: &Mesh, description: &BodyDescription) -> Result<Handle> {
        let name = description.name;
        self.name_is_free(Kind::Body, name)?;
        self.shows_all()?;
        mesh.fits_into_memory()?;
        let mut checked = check(mesh, &CheckOptions::default())?;
        let settings = description.membrane.map(|m| m.settings());
        let material = match settings {
            // the material of the solid means nothing then
            Some(own) if !mesh.is_solid() => own.material,
            _ => description.material,
        };
        let membrane = match (description.membrane, settings) {
            (Some(cells), Some(settings)) => Some(membrane(&checked.mesh, cells, settings)?),
            _ => None,
        };
        if let Some(membrane) = &membrane {
            checked.use_faces(&membrane.triangles, &membrane.quads);
        }
        let own = BodyDescription {
            points: &checked.mesh.points,
            tetrahedra: &checked.mesh.tetrahedra,
            middles: &checked.mesh.middles,
            hexahedra: &checked.mesh.hexahedra,
            ..description.clone()
        };
        let simulation = &mut self.built.simulation;
        let handle = simulation.add_checked_body(&own, &checked.report)?;
        let mass = simulation.masses(handle).iter().sum();
        let (report, used_vertices) = (checked.report, checked.used_vertices);
        self.buffers.push(Buffers::default());
        self.built.bodies.push(BuiltBody {
            name: name.into(),
            handle,
            mesh: checked.mesh,
            report,
            used_vertices,
            material,
            mass,
            membrane,
            preset: None,
            model: description.model,
            evaluation: description.evaluation,
            volume: description.volume,
            integration: description.integration,
            springs: description.springs,
            axes: description.axes.clone().map(|axes| axes.into_owned()),
            carried: None,
            lattice: None,
        });
        self.epoch += 1;
        Ok(self.handles.add(Kind::Body, name, Target::Body(handle.0)))
    }

    /// Index of a body.
    pub(crate) fn body(&self, body: Handle) -> Result<usize> {
        match self.handles.get(body, Kind::Body)? {
            Target::Body(index) => Ok(index),
            Target::Entity(_) | Target::Scene(_) => unreachable!("bodies are no entities"),
        }
    }

    /// The mesh of a body, in place and repaired.
    pub fn mesh(&self, body: Handle) -> Result<&Mesh> {
        Ok(&self.built.bodies[self.body(body)?].mesh)
    }

    /// Number of vertices of its mesh: length of every list of vertices. It may grow: ask again when the revision of
    /// [`Embedding::surface`] is another one.
    pub fn vertex_count(&self, body: Handle) -> Result<usize> {
        Ok(self.mesh(body)?.points.len())
    }

    /// Vertices of a group of its mesh.
    ///
    /// # Errors
    /// When there is no such body or group.
    pub fn group(&self, body: Handle, name: &str) -> Result<Vec<u32>> {
        Ok(group(self.mesh(body)?, name)?.vertices.clone())
    }

    /// Names of its groups.
    pub fn groups(&self, body: Handle) -> Result<Vec<String>> {
        Ok(self.mesh(body)?.groups.iter().map(|g| g.name.clone()).collect())
    }

    fn buffer(&mut self, body: Handle, kept: Kept) -> Result<&[[f64; 3]]> {
        let (body, epoch) = (self.body(body)?, self.epoch);
        let Buffer { epoch: of, values } = &mut self.buffers[body].vectors[kept as usize];
        if *of != epoch {
            let points = &self.built.bodies[body].mesh.points;
            if values.len() != points.len() {
                // vertices that no element ever used stay as they are here
                let rest = |x: &DVec3| match kept {
                    Kept::Position => x.to_array(),
                    Kept::Displacement | Kept::Velocity => [0.0; 3],
                };
                values.clear();
                values.extend(points.iter().map(rest));
            }
            let simulation = &mut self.built.simulation;
            let set = |vertex: usize, x: DVec3| values[vertex] = x.to_array();
            match kept {
                Kept::Position => simulation.each_position(BodyHandle(body), set),
                Kept::Displacement => simulation.each_displacement(BodyHandle(body), set),
                Kept::Velocity => simulation.each_velocity(BodyHandle(body), set),
            }
            *of = epoch;
        }
        Ok(values)
    }

    /// Numbers of a body in the order of its mesh: three a vertex for vectors, else one a vertex or an element; or of a tear, thread,
    /// clip or glue.
    pub fn numbers(&mut self, body: Handle, quantity: Quantity) -> Result<Cow<'_, [f64]>> {
        let vectors = |own: Vec<[f64; 3]>| Cow::Owned(own.into_flattened());
        Ok(match quantity {
            Quantity::Positions => Cow::Borrowed(self.positions(body)?.as_flattened()),
            Quantity::Displacements => Cow::Borrowed(self.displacements(body)?.as_flattened()),
            Quantity::Velocities => Cow::Borrowed(self.velocities(body)?.as_flattened()),
            Quantity::ElasticForces => vectors(self.elastic_forces(body)?),
            Quantity::ExternalForces => vectors(self.external_forces(body)?),
            Quantity::ContactForces => vectors(self.contact_forces(body)?),
            Quantity::ContactPressures => self.contact_pressures(body)?.into(),
            Quantity::Masses => self.masses(body)?.into(),
            Quantity::VolumeRatios => self.volume_ratios(body)?.into(),
            Quantity::AreaRatios => self.area_ratios(body)?.into(),
            Quantity::Tear => self.tear_numbers(body)?.into(),
            Quantity::Glue => self.glue_numbers(body)?.into(),
            _ => self.thread_numbers(body, quantity)?.into(),
        })
    }

    /// Deformed positions (m) of all vertices of the mesh; those that no element ever used stay where they were.
    pub fn positions(&mut self, body: Handle) -> Result<&[[f64; 3]]> {
        self.buffer(body, Kept::Position)
    }

    /// Displacements (m), likewise.
    pub fn displacements(&mut self, body: Handle) -> Result<&[[f64; 3]]> {
        self.buffer(body, Kept::Displacement)
    }

    /// Velocities (m/s), likewise.
    pub fn velocities(&mut self, body: Handle) -> Result<&[[f64; 3]]> {
        self.buffer(body, Kept::Velocity)
    }

    /// Writes positions (m) as three `f32` a vertex into a vertex buffer of a host: that of vertex `i` begins at byte `i *
    /// stride`, and nothing else is written. The machine's byte order.
    ///
    /// # Errors
    /// When there is no such body, the stride is less than 12 bytes, or the buffer too short.
    pub fn positions_f32(&mut self, body: Handle, out: &mut [u8], stride: usize) -> Result<()> {
        let count = self.vertex_count(body)?;
        if stride < 12 {
            let problem = format!("a stride of {stride} bytes; three 32-bit numbers need 12");
            return Err(InputError::invalid("vertex buffer", problem).into());
        }
        let needed =
            if count == 0 { 0 } else { stride.saturating_mul(count - 1).saturating_add(12) };
        if out.len() < needed {
            let expected = format!("at least {needed} bytes for {count} vertices");
            let (what, given) = ("vertex buffer", out.len());
            return Err(InputError::Count { what, given, expected }.into());
        }
        for (row, x) in out.chunks_mut(stride).zip(self.positions(body)?) {
            for (bytes, x) in row.as_chunks_mut::<4>().0.iter_mut().zip(x) {
                *bytes = (*x as f32).to_ne_bytes();
            }
        }
        Ok(())
    }

    /// Sets displacements (m) and velocities (m/s), three numbers a vertex of the mesh.
    ///
    /// # Errors
    /// When there is no such body, a length does not fit or a number is not finite.
    pub fn set_state(
        &mut self,
        body: Handle,
        displacements: &[f64],
        velocities: &[f64],
    ) -> Result<()> {
        let count = self.vertex_count(body)?;
        let u = vectors_of("displacements", displacements, count)?;
        let v = vectors_of("velocities", velocities, count)?;
        let body = BodyHandle(self.body(body)?);
        self.built.simulation.set_state(body, &u, &v)?;
        self.epoch += 1;
        Ok(())
    }

    /// Masses (kg) of its vertices.
    pub fn masses(&mut self, body: Handle) -> Result<Vec<f64>> {
        let body = BodyHandle(self.body(body)?);
        Ok(self.built.simulation.masses(body))
    }

    /// Elastic forces (N) on its vertices at the state as it is.
    pub fn elastic_forces(&mut self, body: Handle) -> Result<Vec<[f64; 3]>> {
        let body = BodyHandle(self.body(body)?);
        Ok(arrays(self.built.simulation.elastic_forces(body)))
    }

    /// Forces (N) of gravity and loads on its vertices in the last step.
    pub fn external_forces(&mut self, body: Handle) -> Result<Vec<[f64; 3]>> {
        let body = BodyHandle(self.body(body)?);
        Ok(arrays(self.built.simulation.external_forces(body)))
    }

    /// Forces (N) of tools, contact and pulls on its vertices at the end of the last step.
    pub fn contact_forces(&self, body: Handle) -> Result<Vec<[f64; 3]>> {
        Ok(arrays(self.built.simulation.contact_forces(BodyHandle(self.body(body)?))))
    }

    /// Pressures (Pa) of contact at its vertices at the end of the last step.
    pub fn contact_pressures(&self, body: Handle) -> Result<Vec<f64>> {
        Ok(self.built.simulation.contact_pressures(BodyHandle(self.body(body)?)))
    }

    /// Volume (m^3) of its solid elements as they are; inverted ones count negative.
    pub fn volume(&mut self, body: Handle) -> Result<f64> {
        let body = BodyHandle(self.body(body)?);
        Ok(self.built.simulation.volume(body))
    }

    /// Volume over that at rest of every tetrahedron, then of every hexahedron (the smallest of its Gauss points).
    pub fn volume_ratios(&mut self, body: Handle) -> Result<Vec<f64>> {
        let body = BodyHandle(self.body(body)?);
        Ok(self.built.simulation.volume_ratios(body))
    }

    /// Area over that at rest of every triangle of its membrane, then of every quadrilateral.
    pub fn area_ratios(&mut self, body: Handle) -> Result<Vec<f64>> {
        let body = BodyHandle(self.body(body)?);
        Ok(self.built.simulation.area_ratios(body))
    }

    /// Triangles to draw it by, over the vertices of its mesh. They are made anew only after removals and cuts. A body that was
    /// cut has more to draw: see [`Embedding::skin`].
    pub fn surface(&mut self, body: Handle) -> Result<Surface<'_>> {
        let (body, epoch) = (self.body(body)?, self.epoch);
        let own = &mut self.buffers[body];
        if own.looked != epoch {
            own.looked = epoch;
            let rows = &self.built.simulation.topology().bodies[body];
            if Some(rows.changes) != own.changes {
                own.changes = Some(rows.changes);
                let triangles = self.built.simulation.outside(BodyHandle(body));
                if own.revision == 0 || triangles != own.surface {
                    own.surface = triangles;
                    own.revision += 1;
                }
            }
        }
        Ok(Surface { triangles: &own.surface, revision: own.revision })
    }

    /// Elements of a kind that are left, by their indices in the mesh, ascending.
    pub fn remaining(&self, body: Handle, kind: ElementKind) -> Result<Vec<u32>> {
        Ok(self.built.simulation.remaining(BodyHandle(self.body(body)?), kind))
    }

    /// Its material: constants, and what replaces them element by element.
    pub fn material(&mut self, body: Handle) -> Result<(YoungPoisson, MaterialArrays)> {
        let index = self.body(body)?;
        let world = self.built.simulation.world_mut();
        let own = world.query::<&SoftBody>().iter(world).find(|own| own.index == index);
        let kept = own.map(|own| (own.material, own.arrays.clone()));
        Ok(kept.unwrap_or_else(|| (self.built.bodies[index].material, MaterialArrays::default())))
    }

    /// Gives it another material from the next step on, uniform or by element; what that did to its energies.
    ///
    /// # Errors
    /// When there is no such body or the material cannot be used; nothing is changed then.
    pub fn set_material(&mut self, body: Handle, field: MaterialField) -> Result<MaterialChange> {
        let index = self.body(body)?;
        let change = self.built.simulation.set_material(BodyHandle(index), field)?;
        self.built.bodies[index].material = field.material;
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.material_changed(&mut self.built, index);
        }
        self.epoch += 1;
        Ok(change)
    }

    /// Removes elements from now on.
    ///
    /// # Errors
    /// When there is no such body, or the region cannot be used or names what is not there; nothing is changed then.
    pub fn remove_elements(
        &mut self,
        body: Handle,
        region: Region,
        mass: MassPolicy,
    ) -> Result<RemovalReport> {
        let body = BodyHandle(self.body(body)?);
        let report = self.built.simulation.remove_elements(body, &Removal { region, mass })?;
        self.epoch += 1;
        Ok(report)
    }

    /// Sets the activation (0 to 1) of an active family of fibres from the next step on.
    ///
    /// # Errors
    /// When there is no such body or family, it follows a curve, or the value is out of range.
    pub fn set_activation(&mut self, body: Handle, family: &str, activation: f64) -> Result<()> {
        let body = BodyHandle(self.body(body)?);
        Ok(self.built.simulation.set_activation(body, family, activation)?)
    }

    /// Gives a family of fibres another modulus (Pa); by how much (J) that changes the elastic energy.
    ///
    /// # Errors
    /// When there is no such body or family, or the modulus cannot be used.
    pub fn set_axis_modulus(&mut self, body: Handle, family: &str, modulus: f64) -> Result<f64> {
        let body = BodyHandle(self.body(body)?);
        let change = self.built.simulation.set_axis_modulus(body, family, modulus)?;
        self.epoch += 1;
        Ok(change)
    }
}

pub(crate) fn arrays(vectors: Vec<DVec3>) -> Vec<[f64; 3]> {
    vectors.into_iter().map(|x| x.to_array()).collect()
}

/// The membrane that a description gives a mesh.
fn membrane(
    mesh: &Mesh,
    cells: sinew::models::body::sheet::MembraneDescription,
    settings: MembraneSettings,
) -> Result<BuiltMembrane> {
    let count = mesh.points.len();
    in_range("triangles of the membrane", cells.triangles.as_flattened(), count)?;
    in_range("quadrilaterals of the membrane", cells.quads.as_flattened(), count)?;
    let (triangles, quads) = (cells.triangles.to_vec(), cells.quads.to_vec());
    Ok(BuiltMembrane::new(mesh, triangles, quads, settings))
}
