//! From mesh and material to entities: every stiffness is precomputed here, in `f64`.

use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::by_precision;
use sinew_engine::columns::single_table;
use sinew_engine::element::{
    AxisVertices, EdgeBlock, EdgeChange, EdgeTension, EdgeVertices, MembraneVertices, RestVolume,
    TETRAHEDRON_FACES, TetrahedronBlocks, TetrahedronEdges, TetrahedronIndex, TetrahedronVertices,
    TriangleEdges, rest_edge_bundle, shape_gradient_bundle,
};
use sinew_engine::isoparametric::{
    AxisHexahedronVertices, HEXAHEDRON_PAIRS, HexahedronBlocks, HexahedronIndex,
    HexahedronVertices, QuadVertices, RestHexahedron, RestShapeError,
};
use sinew_engine::law::{BodiesWithoutRecovery, Law, LawBuffer};
use sinew_engine::layout::{BodyLayout, ElementLists};
use sinew_engine::mesh::Mesh;
use sinew_engine::precision::Precision;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{BodyRows, ElementTables, Topology};
use sinew_engine::vertex::{
    BodyId, Displacement, ElasticForce, ExternalForce, FixedAxes, Mass, Position,
    PrescribedDisplacement, RestPosition, Velocity, VertexIndex,
};
use sinew_identify::ElementMethod;
use std::sync::Arc;

use crate::axes::columns::{AxisAngleStiffness, FibreActive, FibreShape, VolumeAlone};
use crate::axes::damper::{AxialDamper, AxialDampers};
use crate::axes::description::{AxesDescription, AxesError, AxisForm, BodyAxes};
use crate::axes::hexahedra::{HexahedronFibres, HexahedronTriads, HexahedronVolumes};
use crate::axes::printed_system::{PrintedAxes, PrintedSprings};
use crate::axes::site::AxisSite;
use crate::axes::spawn::{Offsets, RestShapes, spawn_axes};
use crate::axes::spawn_printed::{check_chords, spawn_printed};
use crate::axes::systems::{AxesOnly, AxisTriads, Fibres, VolumePreservation};
use crate::corotational::{Corotational, WarpedStiffness};
use crate::field::{FieldError, MaterialArrays, MaterialField};
use crate::fused::{
    self, Compression, CompressionModulus, FirstLameParameter, FusedStVK, PooledProjection,
    ShearModulus, TetrahedronLaw,
};
use crate::fused_membrane::{
    BiquadraticMembrane, CorotationalMembrane, LinearMembrane, MembraneCompression, PooledMembrane,
    QuadraticMembrane, TriangleLaw,
};
use crate::hexahedron::{self, Hexahedral};
use crate::linear::Linear;
use crate::lumped::{self, ElementSprings, Sources, SpringsError};
use crate::material::{LameParameters, YoungPoisson};
use crate::neo_hookean::NeoHookean;
use crate::pooled::{
    self, Angular, AngularStiffness, SpringForces, Tensile, TensileStiffness, TensileTension,
    TriangleVertices, Volumetric, VolumetricStiffness,
};
use crate::precompute::{ADJACENT_PAIRS, RestTetrahedron, RestTetrahedronError, SpringConstants};
use crate::quad::Quadrilateral;
use crate::quadratic::{self, MassSpring, QuadraticSprings};
use crate::resection;
use crate::sheet::{MembraneDescription, MembraneError, MembraneSettings, Sheet};
use crate::stvk_fem::StVKFem;

/// Energy of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Model {
    /// St Venant-Kirchhoff (tetrahedral biquadratic springs).
    #[serde(rename = "svk")]
    StVK,
    /// The same with the compression term of Delingette 2008, section 4 (default).
    #[default]
    #[serde(rename = "svk_comp")]
    CompressibleStVK,
    /// Tetrahedral quadratic springs ([`crate::quadratic`]): St Venant-Kirchhoff for small strains.
    /// Fused evaluation only; no compression term.
    #[serde(rename = "tqs")]
    QuadraticSprings,
    /// Springs on edges alone, the tensile part of the quadratic springs: no material, for
    /// comparison. One pass over edges; nothing resists inversion.
    #[serde(rename = "mass_spring")]
    MassSpring,
    /// Linear elasticity ([`crate::linear`]): small displacements only. For comparison.
    #[serde(rename = "linear")]
    Linear,
    /// Stiffness warping ([`crate::corotational`]): corotational forces, tangent with rotations held.
    /// For comparison.
    #[serde(rename = "corotational_warped")]
    WarpedStiffness,
    /// Corotational elasticity ([`crate::corotational`]). For comparison.
    #[serde(rename = "corotational")]
    Corotational,
    /// St Venant-Kirchhoff written as in textbooks ([`crate::stvk_fem`]). For comparison of cost.
    #[serde(rename = "svk_fem")]
    StVKFem,
    /// Stable neo-Hookean ([`crate::neo_hookean`]). For comparison at large strain.
    #[serde(rename = "neo_hookean")]
    NeoHookean,
    /// Nothing but the axes of the body ([`crate::axes`]); of its material only the density counts.
    #[serde(rename = "axes")]
    Axes,
}

impl Model {
    /// All that a material defines, in the order of their documentation; not [`Axes`](Self::Axes), which
    /// need a description.
    pub const ALL: [Self; 9] = [
        Self::CompressibleStVK,
        Self::StVK,
        Self::QuadraticSprings,
        Self::MassSpring,
        Self::Linear,
        Self::WarpedStiffness,
        Self::Corotational,
        Self::StVKFem,
        Self::NeoHookean,
    ];

    /// Name in scene files and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::StVK => "svk",
            Self::CompressibleStVK => "svk_comp",
            Self::QuadraticSprings => "tqs",
            Self::MassSpring => "mass_spring",
            Self::Linear => "linear",
            Self::WarpedStiffness => "corotational_warped",
            Self::Corotational => "corotational",
            Self::StVKFem => "svk_fem",
            Self::NeoHookean => "neo_hookean",
            Self::Axes => "axes",
        }
    }

    /// Whether hexahedra have it; the textbook form is that of [`StVK`](Self::StVK) there.
    pub fn serves_hexahedra(self) -> bool {
        !matches!(self, Self::QuadraticSprings | Self::WarpedStiffness)
    }

    /// Whether the energy can be summed this way. [`Evaluation::Fused`] always can; for
    /// [`MassSpring`](Self::MassSpring) it means its one pass over edges.
    pub fn supports(self, evaluation: Evaluation) -> bool {
        evaluation == Evaluation::Fused || matches!(self, Self::StVK | Self::CompressibleStVK)
    }
}

/// How the energy is summed; the result is the same to rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Evaluation {
    /// One pass over tetrahedra (default, the faster one).
    #[default]
    Fused,
    /// Independent systems over edges, triangles and tetrahedra.
    Pooled,
}

/// What a body is made of.
#[derive(Clone, Debug)]
pub struct BodyDescription<'a> {
    /// Name, unique in the world.
    pub name: &'a str,
    /// Rest positions (m) in the user's order; vertices that no element uses are left out.
    pub points: &'a [DVec3],
    /// Tetrahedra, positively oriented ([`sinew_engine::mesh`]'s check repairs orientation).
    pub tetrahedra: &'a [[u32; 4]],
    /// Hexahedra in the node order of Gmsh and VTK, positively oriented; integrated over 2x2x2 points.
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
    /// Energy.
    pub model: Model,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// How the constants of [`Model::MassSpring`] are found; without, those of Delingette 2008 for
    /// tetrahedra and the Frobenius fit for hexahedra.
    pub springs: Option<ElementMethod>,
    /// Membrane beside the solid, or instead of it: without solid elements `material`, `model` and
    /// `evaluation` mean nothing.
    pub membrane: Option<MembraneDescription<'a>>,
    /// Axes of anisotropy beside the model, or with [`Model::Axes`] instead of one.
    pub axes: Option<AxesDescription<'a>>,
}

impl<'a> BodyDescription<'a> {
    /// A body of all tetrahedra and hexahedra of a mesh, with the default model and evaluation.
    pub fn new(name: &'a str, mesh: &'a Mesh, material: YoungPoisson) -> Self {
        let tetrahedra = Self::from_parts(name, &mesh.points, &mesh.tetrahedra, material);
        Self { hexahedra: &mesh.hexahedra, ..tetrahedra }
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
            hexahedra: &[],
            material,
            young_modulus: None,
            poisson_ratio: None,
            density: None,
            model: Model::default(),
            evaluation: Evaluation::default(),
            springs: None,
            membrane: None,
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
        }
    }
}

/// A body that cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BodyError {
    /// Material out of range, or a field of another length than the mesh.
    #[error("body `{body}`: {source}")]
    Material {
        /// Name of the body.
        body: String,
        /// What is wrong.
        source: FieldError,
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
    /// A tetrahedron names a vertex that does not exist, or one twice.
    #[error(
        "body `{body}`, tetrahedron {tetrahedron} has vertices {vertices:?} of {count}: \
         indices must be distinct and below the number of vertices; run the mesh check"
    )]
    Index {
        /// Name of the body.
        body: String,
        /// Index in the user's mesh.
        tetrahedron: usize,
        /// Its vertices.
        vertices: [u32; 4],
        /// Number of vertices in the mesh.
        count: usize,
    },
    /// A hexahedron without a usable rest shape.
    #[error("body `{body}`, hexahedron {hexahedron}: {source}")]
    Hexahedron {
        /// Name of the body.
        body: String,
        /// Index in the user's mesh.
        hexahedron: usize,
        /// What is wrong.
        source: RestShapeError,
    },
    /// A hexahedron names a vertex that does not exist, or one twice.
    #[error(
        "body `{body}`, hexahedron {hexahedron} has vertices {vertices:?} of {count}: \
         indices must be distinct and below the number of vertices; run the mesh check"
    )]
    HexahedronIndex {
        /// Name of the body.
        body: String,
        /// Index in the user's mesh.
        hexahedron: usize,
        /// Its vertices.
        vertices: [u32; 8],
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
    /// An element whose springs cannot be found.
    #[error("body `{body}`: {source}")]
    Springs {
        /// Name of the body.
        body: String,
        /// What is wrong.
        source: SpringsError,
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
    /// A membrane that cannot be built.
    #[error("membrane of body `{body}`: {source}")]
    Membrane {
        /// Name of the body.
        body: String,
        /// What is wrong.
        source: MembraneError,
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

/// A body in the world; `index` points into [`Topology::bodies`].
#[derive(Component, Clone, Debug)]
pub struct SoftBody {
    /// Index into [`Topology::bodies`].
    pub index: usize,
    /// Material.
    pub material: YoungPoisson,
    /// What varies of it from element to element.
    pub arrays: MaterialArrays,
    /// Energy.
    pub model: Model,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// How the constants of its springs are found, if it consists of springs.
    pub spring_method: Option<ElementMethod>,
    /// Constants of the elements that are springs.
    pub springs: Arc<ElementSprings>,
    /// What its membrane is made of.
    pub membrane: Option<MembraneSettings>,
    /// Its axes, and which of their directions were repaired.
    pub axes: Option<BodyAxes>,
}

impl SoftBody {
    /// Material of its solid elements, in the order of the user's mesh, tetrahedra first.
    pub fn field(&self) -> MaterialField<'_> {
        self.arrays.field(self.material)
    }
}

/// Builds a body: orders the mesh, precomputes stiffnesses, spawns one entity per vertex, tetrahedron
/// and membrane triangle (per edge and triangle too when springs are pooled) and puts the laws it needs into
/// the force schedule. Its number type is the world's [`Precision`].
///
/// # Errors
/// When material or mesh cannot be used, or the world has no [`Precision`]; nothing is spawned then.
pub fn spawn_body(world: &mut World, body: &BodyDescription) -> Result<Entity, BodyError> {
    match world.get_resource::<Precision>() {
        Some(&precision) => by_precision!(precision, spawn(world, body)),
        None => Err(BodyError::NoPrecision { body: body.name.to_string() }),
    }
}

fn spawn<S: Scalar>(world: &mut World, body: &BodyDescription) -> Result<Entity, BodyError> {
    let name = || body.name.to_string();
    if world.get_resource_or_init::<Topology>().body(body.name).is_some() {
        return Err(BodyError::Duplicate { body: name() });
    }
    if let Some(spawned) = world.get_resource::<ElementTables>()
        && *spawned != ElementTables::of(world)
    {
        return Err(BodyError::LayoutChanged { body: name() });
    }
    if !body.model.supports(body.evaluation) {
        return Err(BodyError::Evaluation { body: name(), model: body.model });
    }
    let membrane = body.membrane.filter(|m| !m.triangles.is_empty() || !m.quads.is_empty());
    let solid = !body.tetrahedra.is_empty() || !body.hexahedra.is_empty();
    if !solid && membrane.is_none() {
        return Err(BodyError::Empty { body: name() });
    }
    let field = body.material_field();
    let user_lame = if solid {
        field
            .lame(body.tetrahedra.len(), body.hexahedra.len())
            .map_err(|source| BodyError::Material { body: name(), source })?
    } else {
        Vec::new()
    };
    let count = body.points.len();
    for (tetrahedron, &t) in body.tetrahedra.iter().enumerate() {
        let distinct = (0..4).all(|i| (0..i).all(|j| t[i] != t[j]));
        if !distinct || t.iter().any(|&v| v as usize >= count) {
            return Err(BodyError::Index { body: name(), tetrahedron, vertices: t, count });
        }
    }
    for (hexahedron, &vertices) in body.hexahedra.iter().enumerate() {
        let distinct = HEXAHEDRON_PAIRS.iter().all(|&[a, b]| vertices[a] != vertices[b]);
        if !distinct || vertices.iter().any(|&v| v as usize >= count) {
            return Err(BodyError::HexahedronIndex { body: name(), hexahedron, vertices, count });
        }
    }
    if !body.hexahedra.is_empty() && !body.model.serves_hexahedra() {
        return Err(BodyError::HexahedronModel { body: name(), model: body.model });
    }
    let of_membrane = |source| BodyError::Membrane { body: name(), source };
    if let Some(m) = &membrane {
        m.validate(count).map_err(of_membrane)?;
    }
    let of_axes = |source| BodyError::Axes { body: name(), source };
    match &body.axes {
        Some(axes) => {
            let tetrahedra = body.tetrahedra.len();
            axes.validate(tetrahedra, body.hexahedra.len()).map_err(of_axes)?;
            if axes.form != AxisForm::EnergyConsistent {
                check_chords(axes, tetrahedra, body.hexahedra, body.points).map_err(of_axes)?;
            }
        }
        None if body.model == Model::Axes && solid => return Err(of_axes(AxesError::Missing)),
        None => {}
    }
    let lists = ElementLists {
        tetrahedra: body.tetrahedra,
        hexahedra: body.hexahedra,
        membrane: membrane.map_or(&[][..], |m| m.triangles),
        quads: membrane.map_or(&[][..], |m| m.quads),
    };
    let layout = BodyLayout::of(count, &lists);
    let rest_of = |row: u32| body.points[layout.vertex_order[row as usize] as usize];
    let mut rest = Vec::with_capacity(layout.tetrahedra.len());
    for (t, &original) in layout.tetrahedra.iter().zip(&layout.tetrahedron_order) {
        let points = t.map(|row| rest_of(row).to_array());
        rest.push(RestTetrahedron::new(points).map_err(|source| BodyError::Tetrahedron {
            body: name(),
            tetrahedron: original as usize,
            source,
        })?);
    }
    let mut bricks = Vec::with_capacity(layout.hexahedra.len());
    for (h, &original) in layout.hexahedra.iter().zip(&layout.hexahedron_order) {
        let points = h.map(|row| rest_of(row).to_array());
        bricks.push(RestHexahedron::new(points).map_err(|source| BodyError::Hexahedron {
            body: name(),
            hexahedron: original as usize,
            source,
        })?);
    }
    let sheet = match &membrane {
        Some(m) => Some(Sheet::new(m, &layout, rest_of).map_err(of_membrane)?),
        None => None,
    };

    let material = |at: usize| match at.checked_sub(body.tetrahedra.len()) {
        None => field.at(layout.tetrahedron_order[at] as usize),
        Some(h) => field.at(body.tetrahedra.len() + layout.hexahedron_order[h] as usize),
    };
    let sources = Sources {
        elements: layout.elements(),
        rest_of: &rest_of,
        solid: (body.model == Model::MassSpring).then_some((&material as _, body.springs)),
        sheet: sheet.as_ref().and_then(Sheet::mass_spring),
    };
    let element_springs = sources
        .springs(|kind, at| layout.order(kind)[at] as usize)
        .map_err(|source| BodyError::Springs { body: name(), source })?;

    // from here on nothing can fail
    let of_user = |&original: &u32| user_lame[original as usize];
    let lame: Vec<_> = layout.tetrahedron_order.iter().map(of_user).collect();
    // materials of hexahedra follow those of tetrahedra
    let first_brick = body.tetrahedra.len();
    let brick_lame: Vec<_> =
        layout.hexahedron_order.iter().map(|&h| user_lame[first_brick + h as usize]).collect();
    let n = layout.vertex_order.len();
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut mass = vec![0.0; n];
    for row in 0..n as u32 {
        low = low.min(rest_of(row));
        high = high.max(rest_of(row));
    }
    for ((t, r), &original) in layout.tetrahedra.iter().zip(&rest).zip(&layout.tetrahedron_order) {
        let density = field.at(original as usize).density;
        for &v in t {
            mass[v as usize] += density * r.volume / 4.0;
        }
    }
    for ((h, r), &original) in layout.hexahedra.iter().zip(&bricks).zip(&layout.hexahedron_order) {
        let density = field.at(first_brick + original as usize).density;
        for (&v, volume) in h.iter().zip(r.vertex_volumes()) {
            mass[v as usize] += density * volume;
        }
    }
    if let Some(sheet) = &sheet {
        sheet.add_mass(&layout, &mut mass);
    }
    let index = world.resource::<Topology>().bodies.len();
    let id = BodyId(index as u32);
    let size = (high - low).max_element();
    world.resource_mut::<Topology>().push(BodyRows::new(name(), &layout, size), &layout.edges);
    let rows = world.resource::<Topology>().bodies[index].clone();
    let (v0, block0) = (rows.vertices.start, rows.blocks.start);

    world.spawn_batch(
        (0..n as u32)
            .zip(mass)
            .map(|(row, mass)| {
                let x = rest_of(row);
                (
                    RestPosition(x),
                    Position(x),
                    Displacement::<S>::default(),
                    Velocity::<S>::default(),
                    ElasticForce::<S>::default(),
                    ExternalForce::<S>::default(),
                    PrescribedDisplacement::<S>::default(),
                    Mass(S::from_f64(mass)),
                    FixedAxes::NONE,
                    VertexIndex(layout.vertex_order[row as usize]),
                    id,
                )
            })
            .collect::<Vec<_>>(),
    );

    let geometry: Vec<_> = layout
        .tetrahedra
        .iter()
        .zip(&layout.tetrahedron_edges)
        .zip(&layout.tetrahedron_order)
        .zip(rest.iter().zip(&lame))
        .map(|(((t, e), &original), (r, &lame))| {
            let d = [r.gradients[1], r.gradients[2], r.gradients[3]];
            (
                TetrahedronVertices(t.map(|v| v + v0)),
                TetrahedronBlocks(e.map(|b| b + block0)),
                TetrahedronIndex(original),
                id,
                shape_gradient_bundle::<S>(d),
                RestVolume(S::from_f64(r.volume)),
                moduli_bundle::<S>(lame, body.model),
            )
        })
        .collect();

    let springs =
        Springs::new(&layout, body, &rest, &lame, sheet.as_ref(), (&element_springs, &rest_of));
    springs.spawn_edges::<S>(world, &layout, &rest_of, v0, block0, id);
    let edge_rows = springs.spawn_pooled::<S>(world, &layout, &rest_of, v0, block0, id);
    spawn_hexahedra::<S>(world, &layout, &bricks, &brick_lame, body.model, (v0, block0, id));
    if matches!(body.model, Model::MassSpring | Model::Axes) {
        world.resource_mut::<BodiesWithoutRecovery>().insert(id.0 as usize);
    }
    match (body.model, body.evaluation) {
        _ if body.tetrahedra.is_empty() => {}
        (Model::QuadraticSprings, _) => spawn_marked::<QuadraticSprings, S>(world, geometry),
        (Model::Linear, _) => spawn_marked::<Linear, S>(world, geometry),
        (Model::WarpedStiffness, _) => spawn_marked::<WarpedStiffness, S>(world, geometry),
        (Model::Corotational, _) => spawn_marked::<Corotational, S>(world, geometry),
        (Model::StVKFem, _) => spawn_marked::<StVKFem, S>(world, geometry),
        (Model::NeoHookean, _) => spawn_marked::<NeoHookean, S>(world, geometry),
        (Model::Axes, _) => {
            world.spawn_batch(geometry.into_iter().map(|g| (g, AxesOnly)).collect::<Vec<_>>());
        }
        (Model::MassSpring, _) => {
            world.spawn_batch(geometry.into_iter().map(|g| (g, MassSpring)).collect::<Vec<_>>());
        }
        (_, Evaluation::Fused) => {
            world.spawn_batch(geometry);
            fused::activate::<FusedStVK, S>(world);
        }
        (_, Evaluation::Pooled) => {
            spawn_volumetric::<S>(world, &layout, &rest, &lame, geometry, &edge_rows);
            fused::activate::<PooledProjection, S>(world);
            if body.model == Model::CompressibleStVK {
                fused::activate::<Compression, S>(world);
            }
        }
    }
    if let Some(sheet) = &sheet {
        sheet.spawn::<S>(world, &layout, v0, block0, id);
    }
    if let Some(axes) = &body.axes {
        let at = Offsets { vertex: v0, block: block0, body: id };
        let rest = RestShapes { tetrahedra: &rest, hexahedra: &bricks };
        match axes.form {
            AxisForm::EnergyConsistent => {
                spawn_axes::<S>(world, axes, &layout, rest, at);
            }
            AxisForm::Printed | AxisForm::PrintedBalanced => {
                spawn_printed::<S>(world, axes, &layout, (&rest_of, rest), at);
            }
        }
    }
    partition_laws::<S>(world);
    resection::install::<S>(world);
    let tables = ElementTables::of(world);
    world.insert_resource(tables);
    let (material, model, evaluation) = (body.material, body.model, body.evaluation);
    let arrays = MaterialArrays::of(&field);
    let membrane = membrane.map(|m| m.settings());
    let axes = body.axes.as_ref().map(|axes| BodyAxes {
        description: axes.clone().into_owned(),
        repaired: axes.count_repairs(),
    });
    let soft = SoftBody {
        index,
        material,
        arrays,
        model,
        evaluation,
        spring_method: body.springs,
        springs: Arc::new(element_springs),
        membrane,
        axes,
    };
    Ok(world.spawn(soft).id())
}

/// Tetrahedra of a law with a table of its own, marked by the law itself.
fn spawn_marked<L: TetrahedronLaw + Component + Default, S: Scalar>(
    world: &mut World,
    geometry: Vec<impl Bundle<Effect: NoBundleEffect>>,
) {
    world.spawn_batch(geometry.into_iter().map(|g| (g, L::default())).collect::<Vec<_>>());
    fused::activate::<L, S>(world);
}

/// Hexahedra of a body, with the law that they need.
fn spawn_hexahedra<S: Scalar>(
    world: &mut World,
    layout: &BodyLayout,
    rest: &[RestHexahedron],
    lame: &[LameParameters],
    model: Model,
    (v0, block0, id): (u32, u32, BodyId),
) {
    if rest.is_empty() {
        return;
    }
    let elements = layout
        .hexahedra
        .iter()
        .zip(&layout.hexahedron_edges)
        .zip(&layout.hexahedron_order)
        .zip(rest.iter().zip(lame))
        .map(|(((h, e), &original), (rest, &lame))| {
            (
                HexahedronVertices(h.map(|v| v + v0)),
                HexahedronBlocks(e.map(|b| b + block0)),
                HexahedronIndex(original),
                id,
                rest.component::<S>(),
                RestVolume(S::from_f64(rest.total_volume())),
                moduli_bundle::<S>(lame, model),
            )
        });
    let elements: Vec<_> = elements.collect();
    macro_rules! spawn_as {
        ($law:ident) => {{
            let mark = Hexahedral::<$law>::default();
            world.spawn_batch(elements.into_iter().map(|e| (e, mark)).collect::<Vec<_>>());
            hexahedron::activate::<$law, S>(world);
        }};
    }
    match model {
        Model::StVK | Model::CompressibleStVK | Model::StVKFem => spawn_as!(FusedStVK),
        Model::Linear => spawn_as!(Linear),
        Model::Corotational => spawn_as!(Corotational),
        Model::NeoHookean => spawn_as!(NeoHookean),
        // springs on edges
        Model::MassSpring => {
            world.spawn_batch(elements.into_iter().map(|e| (e, MassSpring)).collect::<Vec<_>>());
        }
        // nothing but axes
        Model::Axes => {
            world.spawn_batch(elements.into_iter().map(|e| (e, AxesOnly)).collect::<Vec<_>>());
        }
        // refused for hexahedra
        Model::QuadraticSprings | Model::WarpedStiffness => {}
    }
}

/// Moduli of a solid element.
pub(crate) fn moduli_bundle<S: Scalar>(
    lame: LameParameters,
    model: Model,
) -> (FirstLameParameter<S>, ShearModulus<S>, CompressionModulus<S>) {
    let compression = if model == Model::CompressibleStVK { lame.lambda + lame.mu } else { 0.0 };
    let lame = match model {
        Model::Axes => LameParameters { lambda: 0.0, mu: 0.0 },
        _ => lame,
    };
    (
        FirstLameParameter(S::from_f64(lame.lambda)),
        ShearModulus(S::from_f64(lame.mu)),
        CompressionModulus(S::from_f64(compression)),
    )
}

/// Constants (N/m^3) of the springs of a body, summed over its tetrahedra and membrane triangles.
struct Springs {
    /// Edges that are springs by themselves; 0 where there is none.
    mass_spring: Vec<f64>,
    /// Tensile springs of pooled elements; 0 where there is none.
    tensile: Vec<f64>,
    /// Angular springs of pooled elements per triangle of the layout, `None` where there is none.
    angular: Vec<Option<[f64; 3]>>,
}

impl Springs {
    fn new(
        layout: &BodyLayout,
        body: &BodyDescription,
        rest: &[RestTetrahedron],
        lame: &[LameParameters],
        sheet: Option<&Sheet>,
        (element_springs, rest_of): (&ElementSprings, &dyn Fn(u32) -> DVec3),
    ) -> Self {
        let mut mass_spring = vec![0.0; layout.edges.len()];
        let mut tensile = vec![0.0; layout.edges.len()];
        let mut angular = vec![[0.0; 3]; layout.triangles.len()];
        let mut used = vec![false; layout.triangles.len()];
        if !element_springs.is_empty() {
            element_springs.add_to(layout, &mut mass_spring);
            for (k, &[a, b]) in mass_spring.iter_mut().zip(&layout.edges) {
                *k = lumped::tensile_stiffness(*k, (rest_of(a) - rest_of(b)).to_array());
            }
        }
        if body.evaluation == Evaluation::Pooled {
            for (i, (r, &lame)) in rest.iter().zip(lame).enumerate() {
                let constants = SpringConstants::new(r, lame);
                for (k, &e) in constants.tensile.iter().zip(&layout.tetrahedron_edges[i]) {
                    tensile[e as usize] += k;
                }
                let t = layout.tetrahedra[i];
                for (c, [apex, j, k]) in constants.angular.iter().zip(ADJACENT_PAIRS) {
                    // the face through the pair lies opposite the one vertex that it does not use
                    let face = (0..4).find(|v| ![apex, j, k].contains(v)).unwrap_or(0);
                    debug_assert!(TETRAHEDRON_FACES[face].contains(&apex));
                    let triangle = layout.tetrahedron_triangles[i][face] as usize;
                    let vertices = &layout.triangles[triangle];
                    let m = vertices.iter().position(|&v| v == t[apex]).unwrap_or(0);
                    angular[triangle][m] += c;
                    used[triangle] = true;
                }
            }
        }
        if let Some(sheet) = sheet.filter(|sheet| sheet.is_pooled()) {
            sheet.add_springs(layout, &mut tensile, &mut angular);
            layout.membrane_triangles.iter().for_each(|&t| used[t as usize] = true);
        }
        let angular = angular.into_iter().zip(used).map(|(c, used)| used.then_some(c)).collect();
        Self { mass_spring, tensile, angular }
    }

    /// Spawns the edges that are springs by themselves, if there are any.
    fn spawn_edges<S: Scalar>(
        &self,
        world: &mut World,
        layout: &BodyLayout,
        rest_of: &dyn Fn(u32) -> DVec3,
        v0: u32,
        block0: u32,
        id: BodyId,
    ) {
        let edges: Vec<_> = edge_bundles::<S>(layout, &self.mass_spring, rest_of, v0, block0, id)
            .map(|edge| (edge, MassSpring))
            .collect();
        if !edges.is_empty() {
            world.spawn_batch(edges);
            quadratic::activate_mass_spring::<S>(world);
        }
    }

    /// Spawns the edges and triangles of pooled elements, if there are any; edge-table rows of the
    /// edges of the layout.
    fn spawn_pooled<S: Scalar>(
        &self,
        world: &mut World,
        layout: &BodyLayout,
        rest_of: &dyn Fn(u32) -> DVec3,
        v0: u32,
        block0: u32,
        id: BodyId,
    ) -> Vec<u32> {
        let mut edges = world.query::<&EdgeChange<S>>();
        let mut next = edges.iter(world).len() as u32;
        let mut rows = Vec::with_capacity(layout.edges.len());
        for &k in &self.tensile {
            rows.push(next);
            next += u32::from(k != 0.0);
        }
        let edges: Vec<_> = edge_bundles::<S>(layout, &self.tensile, rest_of, v0, block0, id)
            .map(|edge| {
                let change = EdgeChange::<S>::default();
                (edge, change, EdgeTension::<S>::default(), TensileTension::<S>::default())
            })
            .collect();
        if edges.is_empty() {
            return rows;
        }
        world.spawn_batch(edges);
        world.spawn_batch(
            layout
                .triangles
                .iter()
                .zip(&layout.triangle_edges)
                .zip(&self.angular)
                .filter_map(|((t, e), c)| c.map(|c| (t, e, c)))
                .map(|(t, e, c)| {
                    (
                        TriangleVertices(t.map(|v| v + v0)),
                        TriangleEdges(e.map(|e| rows[e as usize])),
                        id,
                        AngularStiffness::<S, 0>(S::from_f64(c[0])),
                        AngularStiffness::<S, 1>(S::from_f64(c[1])),
                        AngularStiffness::<S, 2>(S::from_f64(c[2])),
                    )
                })
                .collect::<Vec<_>>(),
        );
        pooled::activate::<S>(world);
        rows
    }
}

/// Components of the edges that have a spring.
fn edge_bundles<S: Scalar>(
    layout: &BodyLayout,
    tensile: &[f64],
    rest_of: &dyn Fn(u32) -> DVec3,
    v0: u32,
    block0: u32,
    id: BodyId,
) -> impl Iterator<Item = impl Bundle<Effect: NoBundleEffect>> {
    let edges = layout.edges.iter().zip(tensile).enumerate();
    edges.filter(|(_, (_, k))| **k != 0.0).map(move |(i, (&[a, b], &k))| {
        (
            EdgeVertices([a + v0, b + v0]),
            EdgeBlock(i as u32 + block0),
            id,
            rest_edge_bundle::<S>((rest_of(a) - rest_of(b)).to_array()),
            TensileStiffness(S::from_f64(k)),
        )
    })
}

/// Spawns pooled tetrahedra; `edge_rows` are the edge-table rows of the edges of the layout.
fn spawn_volumetric<S: Scalar>(
    world: &mut World,
    layout: &BodyLayout,
    rest: &[RestTetrahedron],
    lame: &[LameParameters],
    geometry: Vec<impl Bundle<Effect: NoBundleEffect>>,
    edge_rows: &[u32],
) {
    let constants =
        rest.iter().zip(lame).map(|(r, &lame)| SpringConstants::new(r, lame).volumetric);
    world.spawn_batch(
        geometry
            .into_iter()
            .zip(&layout.tetrahedron_edges)
            .zip(constants)
            .map(|((geometry, e), d)| {
                (
                    geometry,
                    TetrahedronEdges(e.map(|e| edge_rows[e as usize])),
                    VolumetricStiffness::<S, 0>(S::from_f64(d[0])),
                    VolumetricStiffness::<S, 1>(S::from_f64(d[1])),
                    VolumetricStiffness::<S, 2>(S::from_f64(d[2])),
                )
            })
            .collect::<Vec<_>>(),
    );
}

/// Local face and vertex to which the angular spring of a pair of adjacent edges belongs.
pub(crate) fn angular_place([apex, j, k]: [usize; 3]) -> (usize, usize) {
    // the face through the pair lies opposite the one vertex that it does not use
    let face = (0..4).find(|v| ![apex, j, k].contains(v)).unwrap_or(0);
    debug_assert!(TETRAHEDRON_FACES[face].contains(&apex));
    (face, apex)
}

/// Cuts the elements of every active law into its fixed ranges.
pub(crate) fn partition_laws<S: Scalar>(world: &mut World) {
    fn tetrahedra<L: TetrahedronLaw, S: Scalar>(world: &mut World) {
        partition::<L, S, TetrahedronVertices, L::Bodies>(world, |t| &t.0);
    }
    tetrahedra::<FusedStVK, S>(world);
    tetrahedra::<QuadraticSprings, S>(world);
    tetrahedra::<Linear, S>(world);
    tetrahedra::<WarpedStiffness, S>(world);
    tetrahedra::<Corotational, S>(world);
    tetrahedra::<StVKFem, S>(world);
    tetrahedra::<NeoHookean, S>(world);
    fn hexahedra<L: TetrahedronLaw, S: Scalar>(world: &mut World)
    where
        Hexahedral<L>: Law,
    {
        partition::<Hexahedral<L>, S, HexahedronVertices, With<Hexahedral<L>>>(world, |h| &h.0);
    }
    hexahedra::<FusedStVK, S>(world);
    hexahedra::<Linear, S>(world);
    hexahedra::<Corotational, S>(world);
    hexahedra::<NeoHookean, S>(world);
    fn quads<L: TriangleLaw, S: Scalar>(world: &mut World)
    where
        Quadrilateral<L>: Law,
    {
        partition::<Quadrilateral<L>, S, QuadVertices, With<Quadrilateral<L>>>(world, |q| &q.0);
    }
    quads::<BiquadraticMembrane, S>(world);
    quads::<LinearMembrane, S>(world);
    quads::<CorotationalMembrane, S>(world);
    partition::<MassSpring, S, EdgeVertices, With<MassSpring>>(world, |e| &e.0);
    tetrahedra::<Compression, S>(world);
    tetrahedra::<PooledProjection, S>(world);
    partition::<Volumetric, S, TetrahedronVertices, With<TetrahedronEdges>>(world, |t| &t.0);
    partition::<Tensile, S, EdgeVertices, With<TensileTension<S>>>(world, |e| &e.0);
    partition::<SpringForces, S, EdgeVertices, With<TensileTension<S>>>(world, |e| &e.0);
    partition::<Angular, S, TriangleVertices, ()>(world, |t| &t.0);
    partition::<BiquadraticMembrane, S, MembraneVertices, With<BiquadraticMembrane>>(world, |t| {
        &t.0
    });
    partition::<QuadraticMembrane, S, MembraneVertices, With<QuadraticMembrane>>(world, |t| &t.0);
    partition::<LinearMembrane, S, MembraneVertices, With<LinearMembrane>>(world, |t| &t.0);
    partition::<CorotationalMembrane, S, MembraneVertices, With<CorotationalMembrane>>(
        world,
        |t| &t.0,
    );
    partition::<PooledMembrane, S, MembraneVertices, With<PooledMembrane>>(world, |t| &t.0);
    partition::<MembraneCompression, S, MembraneVertices, With<PooledMembrane>>(world, |t| &t.0);
    fn in_elements<S: Scalar, const N: usize, V: AxisSite<N>>(world: &mut World)
    where
        PrintedSprings<V>: Law,
        AxialDampers<V>: Law,
    {
        partition::<PrintedSprings<V>, S, V, With<PrintedAxes<N>>>(world, |v| v.rows());
        partition::<AxialDampers<V>, S, V, With<AxialDamper<N>>>(world, |v| v.rows());
    }
    partition::<AxisTriads, S, AxisVertices, With<AxisAngleStiffness<S, 0>>>(world, |t| &t.0);
    in_elements::<S, 4, AxisVertices>(world);
    partition::<Fibres, S, AxisVertices, With<FibreShape<S, 1>>>(world, |t| &t.0);
    partition::<VolumePreservation, S, AxisVertices, VolumeAlone<S>>(world, |t| &t.0);
    type InHexahedra = AxisHexahedronVertices;
    in_elements::<S, 8, InHexahedra>(world);
    partition::<HexahedronTriads, S, InHexahedra, With<AxisAngleStiffness<S, 0>>>(world, |h| &h.0);
    partition::<HexahedronFibres, S, InHexahedra, With<FibreActive<S>>>(world, |h| &h.0);
    partition::<HexahedronVolumes, S, InHexahedra, VolumeAlone<S>>(world, |h| &h.0);
    find_edges::<Volumetric, S, TetrahedronEdges>(world, |e| &e.0);
    find_edges::<Angular, S, TriangleEdges>(world, |e| &e.0);
}

/// Tells the ranges of a law of springs which edge-table rows they pull on.
fn find_edges<L: Law, S: Scalar, C: Component>(world: &mut World, edges: impl Fn(&C) -> &[u32]) {
    let mut elements = world.query::<&C>();
    let Some(mut buffer) = world.remove_resource::<LawBuffer<L, S>>() else { return };
    if let Some(column) = single_table(elements.contiguous_iter(world)) {
        for span in &mut buffer.spans {
            let own = || column[span.elements.clone()].iter().flat_map(&edges);
            let (low, high) = (own().min(), own().max());
            span.edges = low.map_or(0, |&e| e as usize)..high.map_or(0, |&e| e as usize + 1);
        }
    }
    world.insert_resource(buffer);
}

fn partition<L: Law, S: Scalar, C: Component, F: bevy_ecs::query::ArchetypeFilter>(
    world: &mut World,
    vertices: impl Fn(&C) -> &[u32],
) {
    let mut elements = world.query_filtered::<&C, F>();
    let Some(mut buffer) = world.remove_resource::<LawBuffer<L, S>>() else { return };
    let topology = world.resource::<Topology>();
    if let Some(column) = single_table(elements.contiguous_iter(world)) {
        buffer.partition(column.len(), topology, |i| vertices(&column[i]));
    } else {
        buffer.spans.clear();
    }
    world.insert_resource(buffer);
}
