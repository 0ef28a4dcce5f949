//! Cuts of bodies, and what to draw of bodies that were cut.

use crate::body::arrays;
use crate::embedding::Embedding;
use crate::error::Result;
use crate::handle::Handle;
use glam::DVec3;
use sinew::models::cutting::{CutReport, MaterialSkin};
use sinew::simulation::BodyHandle;

/// What is lent out, as of an epoch.
#[derive(Clone, Debug, Default)]
pub(crate) struct SkinBuffer {
    epoch: u64,
    revision: u64,
    /// Revision of the surface of which it is, while nothing was cut.
    surface: Option<u64>,
    skin: MaterialSkin,
    points: Vec<[f64; 3]>,
    rest: Vec<[f64; 3]>,
}

impl SkinBuffer {
    /// Has everything found anew.
    pub fn forget(&mut self) {
        *self = Self { revision: self.revision, ..Self::default() };
    }
}

/// What to draw of a body that may be cut: its outside and both sides of its wounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skin<'a> {
    /// Positions (m): of all vertices of the mesh, then of all points of a surface that the body carries, then of points that cuts made. A wound has points of its own, so that its
    /// edge is sharp and its sides are smooth.
    pub points: &'a [[f64; 3]],
    /// The same at rest (m): coordinates of what is drawn inside of the body.
    pub rest: &'a [[f64; 3]],
    /// Depth (m, at rest) of the points of wounds below the surface of the mesh; 0 at all others.
    pub depth: &'a [f64],
    /// Triangles of points, outward; of a body that was never cut, and carries no surface, as in [`Surface`](crate::Surface).
    pub triangles: &'a [[u32; 3]],
    /// Whether each was laid open by a cut.
    pub wound: &'a [bool],
    /// Changes whenever anything but the points does, and never comes again.
    pub revision: u64,
}

impl Embedding {
    /// Cuts a body of solid elements, or of a membrane of triangles alone, along the surface that a blade sweeps, at once, in the present
    /// shape: its edge is at `[p, q]` (m), one position after another. The body needs vertices to spare
    /// ([`BodyDescription::spare`](crate::BodyDescription::spare)).
    ///
    /// # Errors
    /// When there is no such body, it cannot be cut, or the strip cannot be used; nothing is changed then.
    pub fn cut(&mut self, body: Handle, strip: &[[DVec3; 2]]) -> Result<CutReport> {
        let body = BodyHandle(self.body(body)?);
        let report = self.built.simulation.cut(body, strip)?;
        self.epoch += 1;
        Ok(report)
    }

    /// What to draw of a body, whether it was cut or not.
    ///
    /// # Errors
    /// When there is no such body.
    pub fn skin(&mut self, body: Handle) -> Result<Skin<'_>> {
        let (index, epoch) = (self.body(body)?, self.epoch);
        if self.buffers[index].skin.epoch != epoch {
            let mut own = std::mem::take(&mut self.buffers[index].skin);
            let found = self.find_skin(body, index, &mut own);
            if found.is_ok() {
                own.epoch = epoch;
            }
            self.buffers[index].skin = own;
            found?;
        }
        let SkinBuffer { revision, skin, points, rest, .. } = &self.buffers[index].skin;
        let MaterialSkin { depth, triangles, wound, .. } = skin;
        Ok(Skin { points, rest, depth, triangles, wound, revision: *revision })
    }

    fn find_skin(&mut self, body: Handle, index: usize, own: &mut SkinBuffer) -> Result<()> {
        let simulation = &mut self.built.simulation;
        if simulation.has_skin(BodyHandle(index)) {
            let is_new = simulation.update_skin(BodyHandle(index), &mut own.skin)?;
            own.points.clear();
            own.points.extend(own.skin.points.iter().map(|x| x.to_array()));
            if is_new {
                own.rest = arrays(own.skin.rest.clone());
                (own.revision, own.surface) = (own.revision + 1, None);
            }
            return Ok(());
        }
        own.points = self.positions(body)?.to_vec();
        let surface = self.surface(body)?;
        if own.surface != Some(surface.revision) {
            let (triangles, revision) = (surface.triangles.to_vec(), surface.revision);
            own.rest = arrays(self.built.bodies[index].mesh.points.clone());
            own.skin = MaterialSkin::default();
            own.skin.depth = vec![0.0; own.rest.len()];
            own.skin.wound = vec![false; triangles.len()];
            own.skin.triangles = triangles;
            (own.revision, own.surface) = (own.revision + 1, Some(revision));
        }
        Ok(())
    }
}
