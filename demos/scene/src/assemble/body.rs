//! A body of a scene, built.

use glam::DVec3;
use sinew::engine::connectivity::{ByKind, ElementKind};
use sinew::engine::mesh::{CheckReport, EmbeddedPoints, LatticeReport, Mesh};
use sinew::models::axes::description::{AxesDescription, AxisFamily};
use sinew::models::body::lumped::SpringRule;
use sinew::models::body::sheet::MembraneSettings;
use sinew::models::body::{Evaluation, Integration, Model, VolumeRule};
use sinew::models::material::YoungPoisson;
use sinew::simulation::{BodyHandle, Simulation};

/// A surface that a body carries along.
#[derive(Clone, Debug)]
pub struct CarriedSurface {
    /// Points at rest (m).
    pub points: Vec<DVec3>,
    /// Triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Where the points lie in the body.
    pub embedding: EmbeddedPoints,
}

impl CarriedSurface {
    /// The outside of `surface`, in a body; `None` where the body has no solid elements.
    pub fn new(surface: &Mesh, body: &Mesh) -> Option<Self> {
        let mut triangles = surface.outside();
        let mut number = vec![u32::MAX; surface.points.len()];
        let mut points = Vec::new();
        for v in triangles.as_flattened_mut() {
            let own = &mut number[*v as usize];
            if *own == u32::MAX {
                *own = points.len() as u32;
                points.push(surface.points[*v as usize]);
            }
            *v = *own;
        }
        let embedding = EmbeddedPoints::new(body, &points)?;
        Some(Self { points, triangles, embedding })
    }
}

/// A body in the simulation.
pub struct BuiltBody {
    /// Name.
    pub name: String,
    /// The body.
    pub handle: BodyHandle,
    /// Its mesh, in place and repaired.
    pub mesh: Mesh,
    /// What the check found.
    pub report: CheckReport,
    /// Vertices that its elements use, sorted.
    pub used_vertices: Vec<u32>,
    /// Material.
    pub material: YoungPoisson,
    /// Sum of the masses of its vertices (kg).
    pub mass: f64,
    /// Its membrane.
    pub membrane: Option<BuiltMembrane>,
    /// Preset that it came from.
    pub preset: Option<String>,
    /// Energy.
    pub model: Model,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// What keeps its volume.
    pub volume: VolumeRule,
    /// How its hexahedra are integrated.
    pub integration: Integration,
    /// Where constants of lumped springs come from, where the scene says so.
    pub springs: Option<SpringRule>,
    /// Axes.
    pub axes: Option<AxesDescription<'static>>,
    /// The surface that it carries along.
    pub carried: Option<CarriedSurface>,
    /// Where it is a lattice: how the surface was filled.
    pub lattice: Option<LatticeReport>,
}

/// The membrane of a body.
#[derive(Clone, Debug)]
pub struct BuiltMembrane {
    /// Triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Quadrilaterals.
    pub quads: Vec<[u32; 4]>,
    /// What it is made of.
    pub settings: MembraneSettings,
    /// Area (m^2).
    pub area: f64,
    /// Fibres in its triangles.
    pub fibres: Vec<AxisFamily<'static>>,
}

impl BuiltMembrane {
    /// Of faces of a mesh.
    pub fn new(
        mesh: &Mesh,
        triangles: Vec<[u32; 3]>,
        quads: Vec<[u32; 4]>,
        settings: MembraneSettings,
    ) -> Self {
        let twice = |corners: &[u32]| {
            let sides = (0..corners.len()).map(|i| {
                let [a, b] = [corners[i], corners[(i + 1) % corners.len()]];
                mesh.points[a as usize].cross(mesh.points[b as usize])
            });
            sides.sum::<DVec3>().length()
        };
        let areas = triangles.iter().map(|t| twice(t)).chain(quads.iter().map(|q| twice(q)));
        let area = 0.5 * areas.sum::<f64>();
        Self { area, triangles, quads, settings, fibres: Vec::new() }
    }
}

impl BuiltBody {
    /// Triangles of its membrane, none without one.
    pub fn membrane_triangles(&self) -> &[[u32; 3]] {
        self.membrane.as_ref().map_or(&[], |m| &m.triangles)
    }

    /// Quadrilaterals of its membrane, none without one.
    pub fn membrane_quads(&self) -> &[[u32; 4]] {
        self.membrane.as_ref().map_or(&[], |m| &m.quads)
    }

    /// Number of elements of a kind.
    pub fn element_count(&self, kind: ElementKind) -> usize {
        match kind {
            ElementKind::Tetrahedron => self.mesh.tetrahedra.len(),
            ElementKind::Hexahedron => self.mesh.hexahedra.len(),
            ElementKind::Triangle => self.membrane_triangles().len(),
            ElementKind::Quad => self.membrane_quads().len(),
        }
    }

    /// Kind of its solid elements, if it is of one; none of a membrane alone.
    pub fn solid_kind(&self) -> Option<ElementKind> {
        let kinds = [ElementKind::Tetrahedron, ElementKind::Hexahedron];
        kinds.into_iter().find(|kind| self.element_count(*kind) > 0)
    }

    /// Elements of a kind that are left and no cut parted, by their indices in the mesh.
    pub fn whole(&self, simulation: &Simulation, kind: ElementKind) -> Vec<u32> {
        let rows = &simulation.topology().bodies[self.handle.0];
        let mut left = simulation.remaining(self.handle, kind);
        if !rows.copies.portions.is_empty() {
            let row = rows.rows_of(kind);
            left.retain(|&e| rows.is_whole(kind, row[e as usize]));
        }
        left
    }

    /// Points of the body as it is now (m).
    pub fn deformed(&self, simulation: &mut Simulation) -> Vec<DVec3> {
        let u = simulation.displacements(self.handle);
        self.mesh.points.iter().zip(&u).map(|(x, u)| *x + *u).collect()
    }

    /// Volume (m^3) of what is left of it, as it is now; inverted elements count negative.
    pub fn volume(&self, simulation: &mut Simulation) -> f64 {
        if simulation.is_cut(self.handle) {
            // linear tetrahedra and their shares
            return simulation.volume(self.handle);
        }
        let points = self.deformed(simulation);
        let left = |kind| simulation.remaining(self.handle, kind).into_iter().map(|e| e as usize);
        let solid =
            |kind: ElementKind| if kind.is_solid() { left(kind).collect() } else { Vec::new() };
        Mesh { points, ..self.mesh.only(&ByKind::of(solid)) }.total_volume()
    }
}
