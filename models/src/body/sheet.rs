//! Membranes as parts of bodies: what a description needs, and from there to entities.

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::element::{
    AxisBlocks, AxisTriangle, AxisVertices, MembraneBlocks, MembraneIndex, MembraneVertices,
    membrane_rest_bundle,
};
use sinew_engine::isoparametric::{QuadBlocks, QuadIndex, QuadVertices, RestQuad, RestShapeError};
use sinew_engine::layout::BodyLayout;
use sinew_engine::ratios::report_areas;
use sinew_engine::row::LocalRow;
use sinew_engine::scalar::Scalar;
use thiserror::Error;

use crate::axes::columns::{PooledSheetBiquadratic, SheetBiquadratic};
use crate::axes::description::{AxesError, AxisFamily, biquadratic};
use crate::axes::spawn::{sheet_fibre, spawn_rows};
use crate::axes::systems;
use crate::body::lumped::SpringRule;
use crate::element::membrane::{RestTriangle, RestTriangleError, plane_strain, plane_stress};
use crate::element::plate::{Branching, Neighbours};
use crate::frame::part::{Offsets, bad_vertices, rest_shapes};
use crate::frame::quads::Quadrilateral;
use crate::frame::row;
use crate::frame::rules::Evaluation;
use crate::frame::triangles::{
    MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus,
};
use crate::laws::bending;
use crate::laws::membranes;
use crate::laws::membranes::{
    BIQUADRATIC, BIQUADRATIC_QUADS, BiquadraticMembrane, COROTATIONAL, COROTATIONAL_QUADS,
    CorotationalMembrane, LINEAR, LINEAR_QUADS, LinearMembrane, PooledMembrane, QUADRATIC,
    QuadraticMembrane,
};
use crate::laws::quadratic::MassSpring;
use crate::material::{LameParameters, MaterialError, YoungPoisson};

/// Energy of a membrane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MembraneModel {
    /// Triangular biquadratic springs, equal to St Venant-Kirchhoff in plane stress (default).
    #[default]
    #[serde(rename = "trbs")]
    Biquadratic,
    /// The same with a term that resists the loss of area ([`crate::element::membrane`]).
    #[serde(rename = "trbs_comp")]
    CompressibleBiquadratic,
    /// Triangular quadratic springs. Fused evaluation only.
    #[serde(rename = "trqs")]
    Quadratic,
    /// Springs on edges alone: no material, for comparison.
    #[serde(rename = "mass_spring")]
    MassSpring,
    /// Constant-strain triangles: small displacements in the rest plane only, nothing resists motion
    /// out of it. For comparison.
    #[serde(rename = "linear")]
    Linear,
    /// Corotational triangles. For comparison.
    #[serde(rename = "corotational")]
    Corotational,
}

impl MembraneModel {
    /// All of them, in the order of their documentation.
    pub const ALL: [Self; 6] = [
        Self::Biquadratic,
        Self::CompressibleBiquadratic,
        Self::Quadratic,
        Self::MassSpring,
        Self::Linear,
        Self::Corotational,
    ];

    /// Name in scene files and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Biquadratic => "trbs",
            Self::CompressibleBiquadratic => "trbs_comp",
            Self::Quadratic => "trqs",
            Self::MassSpring => "mass_spring",
            Self::Linear => "linear",
            Self::Corotational => "corotational",
        }
    }

    /// Whether the energy can be summed this way. [`Evaluation::Fused`] always can; for
    /// [`MassSpring`](Self::MassSpring) it means its one pass over edges.
    pub fn supports(self, evaluation: Evaluation) -> bool {
        let springs = matches!(self, Self::Biquadratic | Self::CompressibleBiquadratic);
        evaluation == Evaluation::Fused || springs
    }
}

/// Which strains or stresses across a membrane vanish: what its moduli in the plane follow from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlaneState {
    /// No stress across (default): a thin sheet, free to become thinner.
    #[default]
    Stress,
    /// No strain across: a slice of a long body.
    Strain,
}

/// Shape of a membrane without bending moments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RestCurvature {
    /// As the mesh is curved (default).
    #[default]
    Meshed,
    /// Flat: a curved mesh is a sheet that was bent into its shape.
    Flat,
}

/// Resistance of a membrane to bending, as a plate of its material ([`crate::laws::bending`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bending {
    /// Thickness (m) that bends; without, that of the membrane. The stiffness `E t^3 / (12 (1 - nu^2))` of a sheet of fibres
    /// or layers is mostly less than that of a plate of its thickness.
    pub thickness: Option<f64>,
    /// Shape without moments.
    pub rest: RestCurvature,
}

/// What a membrane is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MembraneSettings {
    /// Thickness (m).
    pub thickness: f64,
    /// Material; Young's modulus in Pa, as of a solid.
    pub material: YoungPoisson,
    /// Plane stress or plane strain.
    pub plane: PlaneState,
    /// Energy.
    pub model: MembraneModel,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// As [`MembraneDescription::springs`].
    pub springs: Option<SpringRule>,
    /// As [`MembraneDescription::bending`].
    pub bending: Option<Bending>,
}

impl MembraneSettings {
    /// A membrane of these elements.
    pub fn of<'a>(
        &self,
        triangles: &'a [[u32; 3]],
        quads: &'a [[u32; 4]],
    ) -> MembraneDescription<'a> {
        let &Self { thickness, material, plane, model, evaluation, springs, bending } = self;
        MembraneDescription {
            triangles,
            quads,
            thickness,
            material,
            plane,
            model,
            evaluation,
            springs,
            bending,
            fibres: &[],
        }
    }

    /// Moduli `lambda` and `mu` (N m) of the plate that it is when it bends, `t^2/12` times those in the plane, and whether it is
    /// flat without moments; nothing where it does not resist.
    pub(crate) fn plate(&self) -> Option<([f64; 2], bool)> {
        let Bending { thickness, rest } = self.bending?;
        let thickness = thickness.unwrap_or(self.thickness);
        let LameParameters { lambda, mu } = surface(&self.material, thickness, self.plane).0;
        let arm = thickness * thickness / 12.0;
        Some(([arm * lambda, arm * mu], rest == RestCurvature::Flat))
    }

    /// Moduli in the plane times the thickness (N/m) and mass per rest area (kg/m^2).
    pub fn surface(&self) -> (LameParameters, f64) {
        surface(&self.material, self.thickness, self.plane)
    }

    /// Whether springs are pooled with those of the solid.
    pub(crate) fn is_pooled(&self) -> bool {
        self.evaluation == Evaluation::Pooled
    }

    /// Modulus (N/m) of the compression term, or 0 without it.
    pub(crate) fn compression(&self) -> f64 {
        let LameParameters { lambda, mu } = self.surface().0;
        if self.model == MembraneModel::CompressibleBiquadratic { lambda + mu } else { 0.0 }
    }
}

/// The membrane of a body: triangles and quadrilaterals between its points.
#[derive(Clone, Copy, Debug)]
pub struct MembraneDescription<'a> {
    /// Triangles, of any winding. Vertices and edges that they share with tetrahedra of the body are
    /// one.
    pub triangles: &'a [[u32; 3]],
    /// Quadrilaterals, in the order of their boundary, of any winding; integrated over 2x2 points.
    pub quads: &'a [[u32; 4]],
    /// Thickness (m).
    pub thickness: f64,
    /// Material; Young's modulus in Pa, as of a solid.
    pub material: YoungPoisson,
    /// Plane stress or plane strain.
    pub plane: PlaneState,
    /// Energy.
    pub model: MembraneModel,
    /// Evaluation. Springs pooled over the mesh are summed with those of tetrahedra where the latter
    /// are pooled too.
    pub evaluation: Evaluation,
    /// Where the constants of [`MembraneModel::MassSpring`] come from; without, those of Delingette 2008 for
    /// triangles and the Frobenius fit for quadrilaterals.
    pub springs: Option<SpringRule>,
    /// Resistance to bending, of triangles; none without it.
    pub bending: Option<Bending>,
    /// Biquadratic fibres in its triangles: moduli in Pa, as of a solid; of directions the part in the plane of a triangle
    /// counts. Where springs are pooled they are a part of these.
    pub fibres: &'a [AxisFamily<'a>],
}

impl<'a> MembraneDescription<'a> {
    /// A membrane with the default model and evaluation.
    pub fn new(triangles: &'a [[u32; 3]], thickness: f64, material: YoungPoisson) -> Self {
        Self {
            triangles,
            quads: &[],
            thickness,
            material,
            plane: PlaneState::default(),
            model: MembraneModel::default(),
            evaluation: Evaluation::default(),
            springs: None,
            bending: None,
            fibres: &[],
        }
    }

    /// What it is made of.
    pub fn settings(&self) -> MembraneSettings {
        let &Self { thickness, material, plane, model, evaluation, springs, bending, .. } = self;
        MembraneSettings { thickness, material, plane, model, evaluation, springs, bending }
    }
}

/// A membrane that cannot be built.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MembraneError {
    /// Material out of range.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// The thickness is no thickness.
    #[error("the thickness is {value} m: it must be positive and finite")]
    Thickness {
        /// What was given, m.
        value: f64,
    },
    /// An element names a vertex that does not exist, or one twice.
    #[error(
        "{kind} {index} has vertices {vertices:?} of {count}: indices must be distinct and below \
         the number of vertices; run the mesh check"
    )]
    Index {
        /// `triangle` or `quadrilateral`.
        kind: &'static str,
        /// Index in the user's list.
        index: usize,
        /// Its vertices.
        vertices: Vec<u32>,
        /// Number of vertices in the mesh.
        count: usize,
    },
    /// An element is there twice, which would make the membrane twice as stiff there.
    #[error("{kind}s {first} and {second} have the same vertices: remove one of them")]
    Duplicate {
        /// `triangle` or `quadrilateral`.
        kind: &'static str,
        /// Index in the user's list.
        first: u32,
        /// Index in the user's list.
        second: u32,
    },
    /// A quadrilateral without a usable rest shape.
    #[error("quadrilateral {quad}: {source}")]
    Quad {
        /// Index in the user's list.
        quad: usize,
        /// What is wrong.
        source: RestShapeError,
    },
    /// An energy that quadrilaterals do not have.
    #[error(
        "model \"{}\" is made for triangles: cut the quadrilaterals into triangles, or take \"trbs\" or \
         \"mass_spring\"", .model.name()
    )]
    QuadModel {
        /// The model.
        model: MembraneModel,
    },
    /// Bending of quadrilaterals.
    #[error(
        "quadrilaterals do not resist bending: make the mesh of triangles, or leave `bending` out"
    )]
    QuadBending,
    /// The thickness that bends is no thickness.
    #[error("the thickness that bends is {value} m: it must be positive and finite")]
    BendingThickness {
        /// What was given, m.
        value: f64,
    },
    /// More than two triangles bend at one edge.
    #[error(
        "{count} triangles have the edge {edge:?}: a membrane that resists bending has no branches; remove some, or \
         leave `bending` out"
    )]
    Branching {
        /// Vertices of the mesh.
        edge: [u32; 2],
        /// Number of triangles.
        count: usize,
    },
    /// A triangle without a usable rest shape.
    #[error("triangle {triangle}: {source}")]
    Triangle {
        /// Index in the user's list.
        triangle: usize,
        /// What is wrong.
        source: RestTriangleError,
    },
    /// Fibres that cannot be used.
    #[error(transparent)]
    Fibres(#[from] AxesError),
    /// An energy that cannot be summed the way asked for.
    #[error(
        "model \"{}\" has no pooled evaluation; leave `evaluation` out or set it to \"fused\"",
        .model.name()
    )]
    Evaluation {
        /// The model.
        model: MembraneModel,
    },
}

/// Moduli in the plane (N/m) and mass per rest area (kg/m^2) of a membrane of some thickness (m).
fn surface(material: &YoungPoisson, thickness: f64, plane: PlaneState) -> (LameParameters, f64) {
    let &YoungPoisson { young_modulus, poisson_ratio, density } = material;
    let moduli = match plane {
        PlaneState::Stress => plane_stress(young_modulus * thickness, poisson_ratio),
        PlaneState::Strain => plane_strain(young_modulus * thickness, poisson_ratio),
    };
    (moduli, density * thickness)
}

/// A membrane in engine order, ready to be spawned.
pub(crate) struct Sheet {
    rest: Vec<RestTriangle>,
    quads: Vec<RestQuad>,
    settings: MembraneSettings,
}

impl MembraneDescription<'_> {
    /// Checks all that does not need the points in order.
    pub(crate) fn validate(&self, count: usize) -> Result<(), MembraneError> {
        match self.plane {
            PlaneState::Stress => self.material.validate_sheet()?,
            PlaneState::Strain => self.material.validate()?,
        }
        if !(self.thickness > 0.0 && self.thickness.is_finite()) {
            return Err(MembraneError::Thickness { value: self.thickness });
        }
        if !self.model.supports(self.evaluation) {
            return Err(MembraneError::Evaluation { model: self.model });
        }
        let bad = |kind, (index, vertices): (usize, &[u32])| {
            let vertices = vertices.to_vec();
            Err(MembraneError::Index { kind, index, vertices, count })
        };
        if let Some(triangle) = bad_vertices(self.triangles, count) {
            return bad("triangle", triangle);
        }
        if let Some(quad) = bad_vertices(self.quads, count) {
            return bad("quadrilateral", quad);
        }
        if !self.quads.is_empty() && !self.fibres.is_empty() {
            return Err(AxesError::SheetQuads.into());
        }
        let springs = [MembraneModel::Quadratic];
        if let Some(bending) = self.bending {
            if !self.quads.is_empty() {
                return Err(MembraneError::QuadBending);
            }
            if let Some(value) = bending.thickness.filter(|t| !(*t > 0.0 && t.is_finite())) {
                return Err(MembraneError::BendingThickness { value });
            }
        }
        if !self.quads.is_empty() && springs.contains(&self.model) {
            return Err(MembraneError::QuadModel { model: self.model });
        }
        Ok(())
    }
}

/// Equal elements are neighbours in the layout.
fn no_twins<const N: usize>(
    kind: &'static str,
    nodes: &[[u32; N]],
    order: &[u32],
) -> Result<(), MembraneError> {
    let sorted = |mut nodes: [u32; N]| {
        nodes.sort_unstable();
        nodes
    };
    let mut pairs = nodes.windows(2).zip(order.windows(2));
    match pairs.find(|(pair, _)| sorted(pair[0]) == sorted(pair[1])) {
        Some((_, order)) => {
            Err(MembraneError::Duplicate { kind, first: order[0], second: order[1] })
        }
        None => Ok(()),
    }
}

impl Sheet {
    /// `rest_of` gives the rest position (m) of a vertex row.
    pub(crate) fn new(
        description: &MembraneDescription,
        layout: &BodyLayout,
        rest_of: impl Fn(u32) -> DVec3,
    ) -> Result<Self, MembraneError> {
        let order = &layout.order;
        no_twins("triangle", layout.triangles(), &order.triangles)?;
        let rest =
            rest_shapes(layout.triangles(), &order.triangles, &rest_of, |points, triangle| {
                RestTriangle::new(points)
                    .map_err(|source| MembraneError::Triangle { triangle, source })
            })?;
        if description.bending.is_some()
            && let Err(Branching { edge, count }) = Neighbours::new(layout.triangles().to_vec())
        {
            let edge = edge.map(|row| layout.vertex_order[LocalRow(row)].0);
            return Err(MembraneError::Branching { edge, count });
        }
        for (t, rest) in rest.iter().enumerate() {
            let element = order.triangles[t] as usize;
            for (axis, _) in biquadratic(description.fibres, element) {
                if rest.in_plane(axis.to_array()).is_none() {
                    let mut families = description.fibres.iter();
                    let own = families.find(|f| f.direction(element).normalize() == axis);
                    let family = own.map_or(String::new(), |f| f.name.to_string());
                    return Err(AxesError::Across { family, element, value: axis }.into());
                }
            }
        }
        no_twins("quadrilateral", layout.quads(), &order.quads)?;
        let quads = rest_shapes(layout.quads(), &order.quads, &rest_of, |points, quad| {
            RestQuad::new(points).map_err(|source| MembraneError::Quad { quad, source })
        })?;
        Ok(Self { rest, quads, settings: description.settings() })
    }

    /// Spawns its fibres; `first` is the number of the first of the families in the body.
    pub(crate) fn spawn_fibres<S: Scalar>(
        &self,
        world: &mut World,
        layout: &BodyLayout,
        at: Offsets,
        (families, first): (&[AxisFamily], usize),
    ) {
        let mut fibres = Vec::new();
        let triangles = layout.triangles().iter().zip(layout.cells.edges_of.triangles.each::<3>());
        for (((t, e), &original), rest) in triangles.zip(&layout.order.triangles).zip(&self.rest) {
            let [a, b, c] = at.vertices(t);
            let [bc, ac, ab] = at.blocks(e);
            let place = (
                AxisVertices([a, b, c, c]),
                // those of the last vertex get zeros
                AxisBlocks([ab, ac, ac, bc, bc, bc]),
                AxisTriangle(original),
                at.body,
            );
            let weight = rest.area * self.settings.thickness;
            for (i, family) in families.iter().enumerate() {
                let made = sheet_fibre::<S>(family, first + i, rest, (original as usize, weight));
                fibres.extend(made.map(|made| (place, made)));
            }
        }
        if self.settings.is_pooled() {
            let marked = fibres.into_iter().map(|own| (own, PooledSheetBiquadratic)).collect();
            spawn_rows::<S, _>(world, marked, &systems::SHEET_PROJECTION);
        } else {
            let marked = fibres.into_iter().map(|own| (own, SheetBiquadratic)).collect();
            spawn_rows::<S, _>(world, marked, &systems::SHEET_BIQUADRATIC);
        }
    }

    /// Spawns an entity per triangle and quadrilateral and puts the laws that they need into the force
    /// schedule.
    pub(crate) fn spawn<S: Scalar>(&self, world: &mut World, layout: &BodyLayout, at: Offsets) {
        let LameParameters { lambda, mu } = self.settings.surface().0;
        let moduli = (
            MembraneFirstModulus(S::from_f64(lambda)),
            MembraneShearModulus(S::from_f64(mu)),
            MembraneCompressionModulus(S::from_f64(self.settings.compression())),
        );
        let triangles = layout
            .triangles()
            .iter()
            .zip(layout.cells.edges_of.triangles.each::<3>())
            .zip(&layout.order.triangles)
            .zip(&self.rest)
            .map(|(((t, e), &original), rest)| {
                (
                    MembraneVertices(at.vertices(t)),
                    MembraneBlocks(at.blocks(e)),
                    MembraneIndex(original),
                    at.body,
                    membrane_rest_bundle::<S>(rest.edges, rest.area),
                    moduli,
                )
            });
        let quads = layout
            .quads()
            .iter()
            .zip(layout.cells.edges_of.quads.each::<6>())
            .zip(&layout.order.quads)
            .zip(&self.quads)
            .map(|(((q, e), &original), rest)| {
                (
                    QuadVertices(at.vertices(q)),
                    QuadBlocks(at.blocks(e)),
                    QuadIndex(original),
                    at.body,
                    rest.component::<S>(),
                    moduli,
                )
            });
        let (triangles, quads): (Vec<_>, Vec<_>) = (triangles.collect(), quads.collect());
        macro_rules! spawn_as {
            ($elements:ident, $mark:expr, $activate:expr) => {
                if !$elements.is_empty() {
                    world
                        .spawn_batch($elements.into_iter().map(|e| (e, $mark)).collect::<Vec<_>>());
                    $activate;
                }
            };
        }
        macro_rules! spawn_both {
            ($law:ident, $triangles:expr, $quads:expr) => {
                spawn_as!(triangles, $law, row::activate::<S>(world, $triangles));
                spawn_as!(
                    quads,
                    Quadrilateral::<$law>::default(),
                    row::activate::<S>(world, $quads)
                );
            };
        }
        match self.settings.model {
            MembraneModel::Biquadratic | MembraneModel::CompressibleBiquadratic => {
                if self.settings.is_pooled() {
                    spawn_as!(triangles, PooledMembrane, {
                        row::activate::<S>(world, &membranes::PROJECTION);
                        if self.settings.compression() > 0.0 {
                            row::activate::<S>(world, &membranes::COMPRESSION);
                        }
                    });
                    // a quadrilateral has no springs to pool
                    spawn_as!(
                        quads,
                        Quadrilateral::<BiquadraticMembrane>::default(),
                        row::activate::<S>(world, &BIQUADRATIC_QUADS)
                    );
                } else {
                    spawn_both!(BiquadraticMembrane, &BIQUADRATIC, &BIQUADRATIC_QUADS);
                }
            }
            // refused for quadrilaterals
            MembraneModel::Quadratic => {
                spawn_as!(triangles, QuadraticMembrane, row::activate::<S>(world, &QUADRATIC));
            }
            MembraneModel::Linear => {
                spawn_both!(LinearMembrane, &LINEAR, &LINEAR_QUADS);
            }
            MembraneModel::Corotational => {
                spawn_both!(CorotationalMembrane, &COROTATIONAL, &COROTATIONAL_QUADS);
            }
            MembraneModel::MassSpring => {
                spawn_as!(triangles, MassSpring, {});
                spawn_as!(quads, MassSpring, {});
            }
        }
        if self.settings.bending.is_some() {
            bending::activate::<S>(world);
        }
        report_areas::<S>(world);
    }
}
