//! Membranes as parts of bodies: what a description needs, and from there to entities.

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::element::{
    MembraneBlocks, MembraneIndex, MembraneVertices, membrane_rest_bundle,
};
use sinew_engine::layout::BodyLayout;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::report_areas;
use sinew_engine::vertex::BodyId;
use thiserror::Error;

use crate::body::Evaluation;
use crate::fused_membrane::{
    BiquadraticMembrane, CorotationalMembrane, LinearMembrane, MembraneCompression,
    MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus, PooledMembrane,
    QuadraticMembrane, activate,
};
use crate::material::{LameParameters, MaterialError, YoungPoisson};
use crate::membrane::{RestTriangle, RestTriangleError, SpringConstants, plane_stress};
use crate::quadratic::MassSpring;

/// Energy of a membrane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MembraneModel {
    /// Triangular biquadratic springs, equal to St Venant-Kirchhoff in plane stress (default).
    #[default]
    #[serde(rename = "trbs")]
    Biquadratic,
    /// The same with a term that resists the loss of area ([`crate::membrane`]).
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

/// The membrane of a body: triangles between its points.
#[derive(Clone, Copy, Debug)]
pub struct MembraneDescription<'a> {
    /// Triangles, of any winding. Vertices and edges that they share with tetrahedra of the body are
    /// one.
    pub triangles: &'a [[u32; 3]],
    /// Thickness (m).
    pub thickness: f64,
    /// Material; Young's modulus in Pa, as of a solid.
    pub material: YoungPoisson,
    /// Energy.
    pub model: MembraneModel,
    /// Evaluation. Springs pooled over the mesh are summed with those of tetrahedra where the latter
    /// are pooled too.
    pub evaluation: Evaluation,
}

impl<'a> MembraneDescription<'a> {
    /// A membrane with the default model and evaluation.
    pub fn new(triangles: &'a [[u32; 3]], thickness: f64, material: YoungPoisson) -> Self {
        let (model, evaluation) = (MembraneModel::default(), Evaluation::default());
        Self { triangles, thickness, material, model, evaluation }
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
    /// A triangle names a vertex that does not exist, or one twice.
    #[error(
        "triangle {triangle} has vertices {vertices:?} of {count}: indices must be distinct and below \
         the number of vertices; run the mesh check"
    )]
    Index {
        /// Index in the user's list.
        triangle: usize,
        /// Its vertices.
        vertices: [u32; 3],
        /// Number of vertices in the mesh.
        count: usize,
    },
    /// A triangle is there twice, which would make the membrane twice as stiff there.
    #[error("triangles {first} and {second} have the same vertices: remove one of them")]
    Duplicate {
        /// Index in the user's list.
        first: u32,
        /// Index in the user's list.
        second: u32,
    },
    /// A triangle without a usable rest shape.
    #[error("triangle {triangle}: {source}")]
    Triangle {
        /// Index in the user's list.
        triangle: usize,
        /// What is wrong.
        source: RestTriangleError,
    },
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

/// Plane-stress moduli (N/m) and mass per rest area (kg/m^2) of a membrane of some thickness (m).
pub(crate) fn surface(material: &YoungPoisson, thickness: f64) -> (LameParameters, f64) {
    let &YoungPoisson { young_modulus, poisson_ratio, density } = material;
    (plane_stress(young_modulus * thickness, poisson_ratio), density * thickness)
}

/// A membrane in engine order, ready to be spawned.
pub(crate) struct Sheet {
    rest: Vec<RestTriangle>,
    moduli: LameParameters,
    /// Mass per rest area (kg/m^2).
    surface_density: f64,
    model: MembraneModel,
    evaluation: Evaluation,
}

impl MembraneDescription<'_> {
    /// Checks all that does not need the points in order.
    pub(crate) fn validate(&self, count: usize) -> Result<(), MembraneError> {
        self.material.validate()?;
        if !(self.thickness > 0.0 && self.thickness.is_finite()) {
            return Err(MembraneError::Thickness { value: self.thickness });
        }
        if !self.model.supports(self.evaluation) {
            return Err(MembraneError::Evaluation { model: self.model });
        }
        for (triangle, &vertices) in self.triangles.iter().enumerate() {
            let [a, b, c] = vertices;
            if a == b || b == c || c == a || vertices.iter().any(|&v| v as usize >= count) {
                return Err(MembraneError::Index { triangle, vertices, count });
            }
        }
        Ok(())
    }
}

impl Sheet {
    /// `rest_of` gives the rest position (m) of a vertex row.
    pub(crate) fn new(
        description: &MembraneDescription,
        layout: &BodyLayout,
        rest_of: impl Fn(u32) -> DVec3,
    ) -> Result<Self, MembraneError> {
        for (t, order) in layout.membrane.windows(2).zip(layout.membrane_order.windows(2)) {
            if t[0] == t[1] {
                return Err(MembraneError::Duplicate { first: order[0], second: order[1] });
            }
        }
        let rest = layout.membrane.iter().zip(&layout.membrane_order).map(|(t, &original)| {
            let points = t.map(|row| rest_of(row).to_array());
            let triangle = original as usize;
            RestTriangle::new(points).map_err(|source| MembraneError::Triangle { triangle, source })
        });
        let rest = rest.collect::<Result<_, _>>()?;
        let (moduli, surface_density) = surface(&description.material, description.thickness);
        Ok(Self {
            rest,
            moduli,
            surface_density,
            model: description.model,
            evaluation: description.evaluation,
        })
    }

    /// Adds a third of the mass (kg) of each triangle to its vertices.
    pub(crate) fn add_mass(&self, layout: &BodyLayout, mass: &mut [f64]) {
        for (t, rest) in layout.membrane.iter().zip(&self.rest) {
            for &v in t {
                mass[v as usize] += self.surface_density * rest.area / 3.0;
            }
        }
    }

    /// Whether its springs are those of the pooled systems.
    pub(crate) fn is_pooled(&self) -> bool {
        self.evaluation == Evaluation::Pooled
    }

    /// Whether it consists of springs on edges alone.
    pub(crate) fn is_mass_spring(&self) -> bool {
        self.model == MembraneModel::MassSpring
    }

    /// Adds the constants (N/m^3) of its springs: per edge, and per triangle of the layout.
    pub(crate) fn add_springs(
        &self,
        layout: &BodyLayout,
        tensile: &mut [f64],
        angular: &mut [[f64; 3]],
    ) {
        for (i, rest) in self.rest.iter().enumerate() {
            let constants = SpringConstants::new(rest, self.moduli);
            for (k, &e) in constants.tensile.iter().zip(&layout.membrane_edges[i]) {
                tensile[e as usize] += k;
            }
            if let Some(own) = angular.get_mut(layout.membrane_triangles[i] as usize) {
                for m in 0..3 {
                    own[m] += constants.angular[m];
                }
            }
        }
    }

    /// Spawns an entity per triangle and puts the laws that it needs into the force schedule.
    pub(crate) fn spawn<S: Scalar>(
        &self,
        world: &mut World,
        layout: &BodyLayout,
        v0: u32,
        block0: u32,
        id: BodyId,
    ) {
        let LameParameters { lambda, mu } = self.moduli;
        let compressible = self.model == MembraneModel::CompressibleBiquadratic;
        let kappa = if compressible { lambda + mu } else { 0.0 };
        let geometry: Vec<_> = layout
            .membrane
            .iter()
            .zip(&layout.membrane_edges)
            .zip(&layout.membrane_order)
            .zip(&self.rest)
            .map(|(((t, e), &original), rest)| {
                (
                    MembraneVertices(t.map(|v| v + v0)),
                    MembraneBlocks(e.map(|b| b + block0)),
                    MembraneIndex(original),
                    id,
                    membrane_rest_bundle::<S>(rest.edges, rest.area),
                    MembraneFirstModulus(S::from_f64(lambda)),
                    MembraneShearModulus(S::from_f64(mu)),
                    MembraneCompressionModulus(S::from_f64(kappa)),
                )
            })
            .collect();
        macro_rules! spawn_as {
            ($mark:expr) => {
                world.spawn_batch(geometry.into_iter().map(|g| (g, $mark)).collect::<Vec<_>>());
            };
        }
        match self.model {
            MembraneModel::Biquadratic | MembraneModel::CompressibleBiquadratic => {
                if self.is_pooled() {
                    spawn_as!(PooledMembrane);
                    activate::<PooledMembrane, S>(world);
                    if compressible {
                        activate::<MembraneCompression, S>(world);
                    }
                } else {
                    spawn_as!(BiquadraticMembrane);
                    activate::<BiquadraticMembrane, S>(world);
                }
            }
            MembraneModel::Quadratic => {
                spawn_as!(QuadraticMembrane);
                activate::<QuadraticMembrane, S>(world);
            }
            MembraneModel::Linear => {
                spawn_as!(LinearMembrane);
                activate::<LinearMembrane, S>(world);
            }
            MembraneModel::Corotational => {
                spawn_as!(CorotationalMembrane);
                activate::<CorotationalMembrane, S>(world);
            }
            MembraneModel::MassSpring => {
                spawn_as!(MassSpring);
            }
        }
        report_areas::<S>(world);
    }
}
