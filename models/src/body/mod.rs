//! From mesh and material to entities: every stiffness is precomputed here, in `f64`.

pub mod change;
pub mod lumped;
pub mod sheet;

use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::by_precision;
use sinew_engine::element::{
    EdgeBlock, EdgeChange, EdgeTension, EdgeVertices, RestVolume, ShapeGradientBundle,
    TETRAHEDRON_FACES, TetrahedronBlocks, TetrahedronEdges, TetrahedronIndex, TetrahedronVertices,
    TriangleEdges, rest_edge_bundle, shape_gradient_bundle,
};
use sinew_engine::isoparametric::{
    HEXAHEDRON_PAIRS, HexahedronBlocks, HexahedronIndex, HexahedronRest, HexahedronVertices,
    RestHexahedron, RestShapeError,
};
use sinew_engine::law::{BodiesWithoutRecovery, partition_laws};
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

use crate::axes::description::{AxesDescription, AxesError, AxisForm, BodyAxes};
use crate::axes::spawn::{Offsets, RestShapes, spawn_axes};
use crate::axes::spawn_printed::{check_chords, spawn_printed};
use crate::axes::systems::AxesOnly;
use crate::body::lumped::{ElementSprings, Sources, SpringsError};
use crate::body::sheet::{MembraneDescription, MembraneError, MembraneSettings, Sheet};
use crate::element::precompute::{
    ADJACENT_PAIRS, RestTetrahedron, RestTetrahedronError, SpringConstants,
};
use crate::frame::hexahedra::Hexahedral;
use crate::frame::tetrahedra::{
    CompressionModulus, FirstLameParameter, ShearModulus, TetrahedronLaw,
};
use crate::laws::pooled::{
    self, AngularStiffness, TensileStiffness, TensileTension, TriangleVertices, VolumetricStiffness,
};
use crate::laws::quadratic::{self, MassSpring};
use crate::laws::{self, Elements, LawError, LawRow, LawTable, svk};
use crate::material::field::{FieldError, MaterialArrays, MaterialField};
use crate::material::{LameParameters, YoungPoisson};
use crate::resection;

pub use crate::laws::models::{Evaluation, Model};

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
    /// Law of its tetrahedra, and by it of its hexahedra.
    pub law: Option<&'static LawRow>,
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
    if let Model::Own(law) = body.model {
        let of_law = |source| BodyError::Law { body: name(), source };
        if law.elements != Elements::Tetrahedra {
            return Err(of_law(LawError::NotOfTetrahedra(law.info.name)));
        }
        world.get_resource_or_init::<LawTable>().add(law).map_err(of_law)?;
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

    let springs =
        Springs::new(&layout, body, &rest, &lame, sheet.as_ref(), (&element_springs, &rest_of));
    springs.spawn_edges::<S>(world, &layout, &rest_of, v0, block0, id);
    let edge_rows = springs.spawn_pooled::<S>(world, &layout, &rest_of, v0, block0, id);
    if matches!(body.model, Model::MassSpring | Model::Axes) {
        world.resource_mut::<BodiesWithoutRecovery>().insert(id.0 as usize);
    }
    let law = body.model.law().map(|row| laws::in_table(world, row).1);
    let part = SolidPart {
        layout: &layout,
        rest: &rest,
        bricks: &bricks,
        lame: [&lame, &brick_lame],
        model: body.model,
        at: (v0, block0, id),
    };
    part.spawn::<S>(world, law, body.evaluation, &edge_rows);
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
        law,
        evaluation,
        spring_method: body.springs,
        springs: Arc::new(element_springs),
        membrane,
        axes,
    };
    Ok(world.spawn(soft).id())
}

/// The solid elements of a body on their way into the world.
pub struct SolidPart<'a> {
    layout: &'a BodyLayout,
    rest: &'a [RestTetrahedron],
    bricks: &'a [RestHexahedron],
    /// Lamé parameters of tetrahedra and of hexahedra.
    lame: [&'a [LameParameters]; 2],
    model: Model,
    /// First vertex row, first block, body.
    at: (u32, u32, BodyId),
}

/// Components of a tetrahedron, without the mark of its law.
type TetrahedronBundle<S> = (
    TetrahedronVertices,
    TetrahedronBlocks,
    TetrahedronIndex,
    BodyId,
    ShapeGradientBundle<S>,
    RestVolume<S>,
    Moduli<S>,
);

/// Components of a hexahedron, likewise.
type HexahedronBundle<S> = (
    HexahedronVertices,
    HexahedronBlocks,
    HexahedronIndex,
    BodyId,
    HexahedronRest<S>,
    RestVolume<S>,
    Moduli<S>,
);

impl SolidPart<'_> {
    fn tetrahedra<S: Scalar>(&self) -> impl Iterator<Item = TetrahedronBundle<S>> {
        let (v0, block0, id) = self.at;
        let Self { layout, model, .. } = self;
        let elements = layout.tetrahedra.iter().zip(&layout.tetrahedron_edges);
        let elements =
            elements.zip(&layout.tetrahedron_order).zip(self.rest.iter().zip(self.lame[0]));
        elements.map(move |(((t, e), &original), (rest, &lame))| {
            let d = [rest.gradients[1], rest.gradients[2], rest.gradients[3]];
            (
                TetrahedronVertices(t.map(|v| v + v0)),
                TetrahedronBlocks(e.map(|b| b + block0)),
                TetrahedronIndex(original),
                id,
                shape_gradient_bundle::<S>(d),
                RestVolume(S::from_f64(rest.volume)),
                moduli_bundle::<S>(lame, *model),
            )
        })
    }

    fn hexahedra<S: Scalar>(&self) -> impl Iterator<Item = HexahedronBundle<S>> {
        let (v0, block0, id) = self.at;
        let Self { layout, model, .. } = self;
        let elements = layout.hexahedra.iter().zip(&layout.hexahedron_edges);
        let elements =
            elements.zip(&layout.hexahedron_order).zip(self.bricks.iter().zip(self.lame[1]));
        elements.map(move |(((h, e), &original), (rest, &lame))| {
            (
                HexahedronVertices(h.map(|v| v + v0)),
                HexahedronBlocks(e.map(|b| b + block0)),
                HexahedronIndex(original),
                id,
                rest.component::<S>(),
                RestVolume(S::from_f64(rest.total_volume())),
                moduli_bundle::<S>(lame, *model),
            )
        })
    }

    /// Spawns the elements with the mark of their law.
    fn spawn<S: Scalar>(
        &self,
        world: &mut World,
        law: Option<&'static LawRow>,
        evaluation: Evaluation,
        edge_rows: &[u32],
    ) {
        if !self.rest.is_empty() {
            match law {
                Some(_) if evaluation == Evaluation::Pooled => {
                    self.spawn_pooled::<S>(world, edge_rows);
                }
                Some(law) => law.spawn::<S>(world, self),
                None if self.model == Model::MassSpring => {
                    self.spawn_tetrahedra::<MassSpring, S>(world);
                }
                None => self.spawn_tetrahedra::<AxesOnly, S>(world),
            }
        }
        if !self.bricks.is_empty() {
            match law {
                Some(LawRow { hexahedra: Some(law), .. }) => {
                    laws::in_table(world, law).1.spawn::<S>(world, self);
                }
                // refused before
                Some(_) => {}
                None if self.model == Model::MassSpring => {
                    self.spawn_hexahedra::<MassSpring, S>(world);
                }
                None => self.spawn_hexahedra::<AxesOnly, S>(world),
            }
        }
    }

    fn spawn_tetrahedra<M: Component + Default, S: Scalar>(&self, world: &mut World) {
        let marked = self.tetrahedra::<S>().map(|t| (t, M::default()));
        world.spawn_batch(marked.collect::<Vec<_>>());
    }

    fn spawn_hexahedra<M: Component + Default, S: Scalar>(&self, world: &mut World) {
        let marked = self.hexahedra::<S>().map(|h| (h, M::default()));
        world.spawn_batch(marked.collect::<Vec<_>>());
    }

    /// Spawns pooled tetrahedra; `edge_rows` are the edge-table rows of the edges of the layout.
    fn spawn_pooled<S: Scalar>(&self, world: &mut World, edge_rows: &[u32]) {
        let constants = self.rest.iter().zip(self.lame[0]);
        let constants = constants.map(|(r, &lame)| SpringConstants::new(r, lame).volumetric);
        let elements = self.tetrahedra::<S>().zip(&self.layout.tetrahedron_edges).zip(constants);
        let elements = elements.map(|((tetrahedron, e), d)| {
            (
                tetrahedron,
                TetrahedronEdges(e.map(|e| edge_rows[e as usize])),
                VolumetricStiffness::<S, 0>(S::from_f64(d[0])),
                VolumetricStiffness::<S, 1>(S::from_f64(d[1])),
                VolumetricStiffness::<S, 2>(S::from_f64(d[2])),
            )
        });
        world.spawn_batch(elements.collect::<Vec<_>>());
        laws::activate::<S>(world, &svk::PROJECTION);
        if self.model.has_compression() {
            laws::activate::<S>(world, &svk::COMPRESSION);
        }
    }
}

/// Spawns the tetrahedra of a body with the mark of law `L`.
pub(crate) fn spawn_tetrahedra<L: Component + Default, S: Scalar>(
    world: &mut World,
    part: &SolidPart,
) {
    part.spawn_tetrahedra::<L, S>(world);
}

/// Spawns the hexahedra of a body with the mark of law `L`.
pub(crate) fn spawn_hexahedra<L: TetrahedronLaw, S: Scalar>(world: &mut World, part: &SolidPart) {
    part.spawn_hexahedra::<Hexahedral<L>, S>(world);
}

/// Columns of the moduli of a solid element.
type Moduli<S> = (FirstLameParameter<S>, ShearModulus<S>, CompressionModulus<S>);

/// Moduli of a solid element.
pub(crate) fn moduli_bundle<S: Scalar>(lame: LameParameters, model: Model) -> Moduli<S> {
    let compression = if model.has_compression() { lame.lambda + lame.mu } else { 0.0 };
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
            laws::activate::<S>(world, &quadratic::EDGE_SPRINGS);
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
        for row in pooled::SPRINGS {
            laws::activate::<S>(world, row);
        }
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

/// Local face and vertex to which the angular spring of a pair of adjacent edges belongs.
pub(crate) fn angular_place([apex, j, k]: [usize; 3]) -> (usize, usize) {
    // the face through the pair lies opposite the one vertex that it does not use
    let face = (0..4).find(|v| ![apex, j, k].contains(v)).unwrap_or(0);
    debug_assert!(TETRAHEDRON_FACES[face].contains(&apex));
    (face, apex)
}
