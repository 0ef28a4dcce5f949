//! What a body is made of, as its description says and as the world keeps it.

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::connectivity::ElementKind;
use sinew_engine::isoparametric::RestShapeError;
use sinew_engine::memory;
use sinew_engine::mesh::{Filled, Mesh};
use sinew_identify::mass::MassLumping;
use std::sync::Arc;

use crate::axes::description::{AxesDescription, AxesError, AxisFamily, BodyAxes};
use crate::body::lumped::{ElementSprings, GivenSprings, SpringRule};
use crate::body::sheet::{MembraneDescription, MembraneError, MembraneSettings};
use crate::cutting::glue::Glue;
use crate::element::precompute::RestTetrahedronError;
use crate::frame::row::{LawError, LawRow};
use crate::frame::rules::{Evaluation, Integration, VolumeRule};
use crate::laws::models::Model;
use crate::material::YoungPoisson;
use crate::material::field::{FieldError, MaterialArrays, MaterialField, SpringsError};

/// What a body is made of.
#[derive(Clone, Debug)]
pub struct BodyDescription<'a> {
    /// Name, unique in the world.
    pub name: &'a str,
    /// Rest positions (m) in the user's order; vertices that no element uses are left out.
    pub points: &'a [DVec3],
    /// Tetrahedra, positively oriented ([`sinew_engine::mesh`]'s check repairs orientation).
    pub tetrahedra: &'a [[u32; 4]],
    /// Vertices on the edges of every tetrahedron ([`Mesh::middles`]), which make them ten-node tetrahedra, integrated over four
    /// points; none for linear ones. Weight and pressure act as the shape functions give it, inertia by lumped masses that
    /// are [their shares][TETRAHEDRON10_MASSES]; contact acts on four flat triangles for each face.
    ///
    /// [TETRAHEDRON10_MASSES]: sinew_engine::isoparametric::TETRAHEDRON10_MASSES
    pub middles: &'a [[u32; 6]],
    /// Hexahedra in the node order of Gmsh and VTK, positively oriented.
    pub hexahedra: &'a [[u32; 8]],
    /// Material of the whole body.
    pub material: YoungPoisson,
    /// Young's modulus (Pa) of every tetrahedron, then of every hexahedron, in the user's order, in place
    /// of the material's.
    pub young_modulus: Option<&'a [f64]>,
    /// Poisson's ratio of every element, likewise.
    pub poisson_ratio: Option<&'a [f64]>,
    /// Density (kg/m^3) of every element, likewise.
    pub density: Option<&'a [f64]>,
    /// What of every element is filled, where elements reach beyond the body: its share multiplies stiffness and density, masses
    /// of hexahedra go by where it lies, and so do energies of those with [`Integration::Reduced`]. [`Mesh::lattice`] gives it as cell
    /// data, [`Mesh::filled`] reads that.
    pub filled: Option<&'a [Filled]>,
    /// Energy.
    pub model: Model,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// What keeps its volume.
    pub volume: VolumeRule,
    /// How its hexahedra are integrated.
    pub integration: Integration,
    /// Cluster of every tetrahedron, any numbers, where its volume is kept by clusters; without it they are grown.
    pub clusters: Option<&'a [u32]>,
    /// Where the constants of [`Model::MassSpring`] come from; without, those of Delingette 2008 for
    /// tetrahedra and the Frobenius fit for hexahedra.
    pub springs: Option<SpringRule>,
    /// Constants of all elements that are springs, in place of those of `springs`.
    pub spring_constants: Option<Arc<GivenSprings>>,
    /// How its mass is shared out among its vertices.
    pub masses: MassRule,
    /// Membrane beside the solid, or instead of it: without solid elements `material`, `model` and
    /// `evaluation` mean nothing.
    pub membrane: Option<MembraneDescription<'a>>,
    /// How many more vertices [cuts](crate::cutting) may make. They have rows from the start on, so that those of others do not
    /// change: without any the body cannot be cut. A full section of a block of n x n x n cells needs some 2 (n + 1)^2,
    /// with ten-node tetrahedra more. What bodies can be cut is told [there](crate::cutting).
    pub spare: usize,
    /// Stiffness of what holds parts of wounds closed that a blade has not come to yet, in Young's moduli over the mean edge of the mesh:
    /// 0 for none, as by default, 5 is a good value; see [glue](crate::cutting::glue).
    pub glue: f64,
    /// Axes of anisotropy beside the model, or with [`Model::Axes`] instead of one.
    pub axes: Option<AxesDescription<'a>>,
}

impl<'a> BodyDescription<'a> {
    /// A body of all tetrahedra and hexahedra of a mesh, with the default model and evaluation.
    pub fn new(name: &'a str, mesh: &'a Mesh, material: YoungPoisson) -> Self {
        let tetrahedra = Self::from_parts(name, &mesh.points, &mesh.tetrahedra, material);
        Self { hexahedra: &mesh.hexahedra, middles: &mesh.middles, ..tetrahedra }
    }

    /// A body of these points (m) and tetrahedra, with the default model and evaluation.
    pub fn from_parts(
        name: &'a str,
        points: &'a [DVec3],
        tetrahedra: &'a [[u32; 4]],
        material: YoungPoisson,
    ) -> Self {
        Self {
            name,
            points,
            tetrahedra,
            middles: &[],
            hexahedra: &[],
            material,
            young_modulus: None,
            poisson_ratio: None,
            density: None,
            filled: None,
            model: Model::default(),
            evaluation: Evaluation::default(),
            volume: VolumeRule::default(),
            integration: Integration::default(),
            clusters: None,
            springs: None,
            spring_constants: None,
            masses: MassRule::default(),
            membrane: None,
            spare: 0,
            glue: 0.0,
            axes: None,
        }
    }

    /// Material of its solid elements.
    pub fn material_field(&self) -> MaterialField<'a> {
        MaterialField {
            material: self.material,
            young_modulus: self.young_modulus,
            poisson_ratio: self.poisson_ratio,
            density: self.density,
            filled: self.filled,
        }
    }
}

/// How the mass of a body is shared out among its vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MassRule {
    /// Every element gives its mass to its own vertices, by their part of its volume (default).
    #[default]
    Volume,
    /// Hexahedra and quadrilaterals by nodal quadrature (Natsupakpong & Cavusoglu 2010, equation 2), which may be off by
    /// about a percent of their mass; others as by volume.
    Nodal,
    /// All vertices have the same (Bourguignon & Cani 2000, section 5); the mass of the body is that of its
    /// elements. Vertices keep it while they have an element.
    Equal,
}

impl From<MassLumping> for MassRule {
    fn from(lumping: MassLumping) -> Self {
        match lumping {
            MassLumping::RowSum => Self::Volume,
            MassLumping::NodalQuadrature => Self::Nodal,
        }
    }
}

impl MassRule {
    /// How an element shares its mass out, before [`MassRule::apply`].
    pub(crate) fn lumping(self) -> MassLumping {
        match self {
            Self::Volume | Self::Equal => MassLumping::RowSum,
            Self::Nodal => MassLumping::NodalQuadrature,
        }
    }

    /// Applies it to masses (kg) that elements have given to their vertices, 0 where a vertex has none.
    pub(crate) fn apply(self, masses: &mut [f64]) {
        let used = masses.iter().filter(|m| **m > 0.0).count();
        if self == Self::Equal && used > 0 {
            let mean = masses.iter().sum::<f64>() / used as f64;
            masses.iter_mut().filter(|m| **m > 0.0).for_each(|m| *m = mean);
        }
    }
}

/// A body that cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BodyError {
    /// It needs more memory than there is.
    #[error(transparent)]
    TooLarge(#[from] memory::TooLarge),
    /// Material out of range, or a field of another length than the mesh.
    #[error("body `{body}`: {source}")]
    Material {
        /// Name of the body.
        body: String,
        /// What is wrong.
        source: FieldError,
    },
    /// A constant of uniform springs out of range.
    #[error("body `{body}`: the spring constant is {value} N/m; it must be positive and finite")]
    SpringConstant {
        /// Name of the body.
        body: String,
        /// The constant (N/m).
        value: f64,
    },
    /// A tetrahedron without a usable rest shape.
    #[error("body `{body}`, tetrahedron {tetrahedron}: {source}")]
    Tetrahedron {
        /// Name of the body.
        body: String,
        /// Index in the user's mesh.
        tetrahedron: usize,
        /// What is wrong.
        source: RestTetrahedronError,
    },
    /// A ten-node tetrahedron or hexahedron without a usable rest shape.
    #[error("body `{body}`, {} {index}: {source}", .kind.name())]
    Element {
        /// Name of the body.
        body: String,
        /// Kind of the element.
        kind: ElementKind,
        /// Index in the user's mesh.
        index: usize,
        /// What is wrong.
        source: RestShapeError,
    },
    /// Something that ten-node tetrahedra do not have.
    #[error("body `{body}` is of ten-node tetrahedra, {problem}")]
    Tetrahedra10 {
        /// Name of the body.
        body: String,
        /// What does not fit, and what to do.
        problem: String,
    },
    /// A solid element names a vertex that does not exist, or one twice.
    #[error(
        "body `{body}`, {} {index} has vertices {vertices:?} of {count}: \
         indices must be distinct and below the number of vertices; run the mesh check",
        .kind.name()
    )]
    Index {
        /// Name of the body.
        body: String,
        /// Kind of the element.
        kind: ElementKind,
        /// Index in the user's mesh.
        index: usize,
        /// Its vertices.
        vertices: Vec<u32>,
        /// Number of vertices in the mesh.
        count: usize,
    },
    /// An energy that hexahedra do not have.
    #[error(
        "body `{body}`: model \"{}\" is made for tetrahedra: cut the hexahedra into tetrahedra, or take \
         \"svk_comp\"", .model.name()
    )]
    HexahedronModel {
        /// Name of the body.
        body: String,
        /// Its model.
        model: Model,
    },
    /// An energy that hexahedra with reduced integration do not have.
    #[error(
        "body `{body}`: model \"{}\" has no hexahedra with integration = \"reduced\": take \"full\"",
        .model.name()
    )]
    Integration {
        /// Name of the body.
        body: String,
        /// Its model.
        model: Model,
    },
    /// A law of another crate that cannot be used.
    #[error("body `{body}`: {source}")]
    Law {
        /// Name of the body.
        body: String,
        /// What is wrong.
        source: LawError,
    },
    /// An element whose springs cannot be found.
    #[error("body `{body}`: {source}")]
    Springs {
        /// Name of the body.
        body: String,
        /// What is wrong.
        source: SpringsError,
    },
    /// An element that is of springs, without a constant among those given.
    #[error(
        "body `{body}`: {} {index} (from 0) is of springs, but none are given for it; give constants \
         for every element, or leave them out", .kind.name()
    )]
    MissingSprings {
        /// Name of the body.
        body: String,
        /// Kind of the element.
        kind: ElementKind,
        /// Index in the user's mesh.
        index: usize,
    },
    /// An energy that cannot be summed the way asked for.
    #[error(
        "body `{body}`: model \"{}\" has no pooled evaluation; leave `evaluation` out or set it to \
         \"fused\"", .model.name()
    )]
    Evaluation {
        /// Name of the body.
        body: String,
        /// Its model.
        model: Model,
    },
    /// A rule for its volume that does not fit.
    #[error("body `{body}`: volume = \"clusters\" {problem}")]
    Volume {
        /// Name of the body.
        body: String,
        /// Why not, and what to do.
        problem: String,
    },
    /// A membrane that cannot be built.
    #[error("membrane of body `{body}`: {source}")]
    Membrane {
        /// Name of the body.
        body: String,
        /// What is wrong.
        source: MembraneError,
    },
    /// Glue of wounds that cannot be used.
    #[error("body `{body}`: glue {problem}")]
    Glue {
        /// Name of the body.
        body: String,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// Axes that cannot be used.
    #[error("axes of body `{body}`: {source}")]
    Axes {
        /// Name of the body.
        body: String,
        /// What is wrong.
        source: AxesError,
    },
    /// Neither solid elements nor a membrane.
    #[error(
        "body `{body}` has no tetrahedra, no hexahedra and no membrane: fill it with tetrahedra, or give \
         its triangles as a membrane of some thickness"
    )]
    Empty {
        /// Name of the body.
        body: String,
    },
    /// The tables of the bodies already there were changed from outside.
    #[error(
        "body `{body}` cannot be added: a component was added to or removed from a vertex or element \
         entity of another body (or one was despawned), so the order of rows is lost; keep such data on \
         entities of your own"
    )]
    LayoutChanged {
        /// Name of the new body.
        body: String,
    },
    /// The world was not set up for bodies.
    #[error(
        "body `{body}` cannot be added: the world has no `Precision`; add `SinewPlugins` to the app, or \
         call `install_engine`, before the first body"
    )]
    NoPrecision {
        /// Name of the new body.
        body: String,
    },
    /// The name is taken.
    #[error("there is a body `{body}` already; names must be unique")]
    Duplicate {
        /// Name of the body.
        body: String,
    },
}

/// A body in the world; `index` points into [`Topology::bodies`](sinew_engine::topology::Topology::bodies).
#[derive(Component, Clone, Debug)]
pub struct SoftBody {
    /// Index into [`Topology::bodies`](sinew_engine::topology::Topology::bodies).
    pub index: usize,
    /// Material.
    pub material: YoungPoisson,
    /// What varies of it from element to element.
    pub arrays: MaterialArrays,
    /// Energy.
    pub model: Model,
    /// Law of its tetrahedra, and by it of its hexahedra.
    pub law: Option<&'static LawRow>,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// What keeps its volume.
    pub volume: VolumeRule,
    /// How its hexahedra are integrated.
    pub integration: Integration,
    /// Where the constants of its springs come from, if it consists of springs.
    pub spring_rule: Option<SpringRule>,
    /// Constants of its springs, where they were given.
    pub given: Option<Arc<GivenSprings>>,
    /// How its mass is shared out among its vertices.
    pub masses: MassRule,
    /// Constants of the elements that are springs.
    pub springs: Arc<ElementSprings>,
    /// What its membrane is made of.
    pub membrane: Option<MembraneSettings>,
    /// Fibres of its membrane.
    pub sheet_fibres: Vec<AxisFamily<'static>>,
    /// What glues its wounds.
    pub glue: Option<Glue>,
    /// Its axes, and which of their directions were repaired.
    pub axes: Option<BodyAxes>,
}

impl SoftBody {
    /// Material of its solid elements, in the order of the user's mesh, tetrahedra first.
    pub fn field(&self) -> MaterialField<'_> {
        self.arrays.field(self.material)
    }
}
