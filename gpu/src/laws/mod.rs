//! Laws on the device: for each the WGSL beside the file that gathers its columns. Names are those of
//! `sinew_models`.

pub mod corotational;
pub mod fused;
pub mod linear;
pub mod mass_spring;
pub mod neo_hookean;
pub mod quadratic;
pub mod stvk_fem;
pub mod warped;

use bevy_ecs::prelude::*;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::fused::{TetrahedronData, TetrahedronLaw};

use crate::sources::{Source, edges, tetrahedra};

/// Elements of a law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    /// Four vertices, twelve constants.
    Tetrahedron,
    /// Two vertices, four constants.
    Edge,
}

impl ElementKind {
    /// Vertices of an element.
    pub fn vertices(self) -> usize {
        match self {
            Self::Tetrahedron => 4,
            Self::Edge => 2,
        }
    }

    /// Constants of an element.
    pub fn constants(self) -> usize {
        match self {
            Self::Tetrahedron => 12,
            Self::Edge => 4,
        }
    }

    /// Tangent blocks of an element: those of its pairs of vertices and of its vertices.
    pub fn blocks(self) -> usize {
        self.vertices() * (self.vertices() + 1) / 2
    }
}

/// A law with a twin on the device.
#[derive(Clone, Copy, Debug)]
pub struct DeviceLaw {
    /// [`Law::NAME`](sinew_engine::law::Law::NAME) of the law.
    pub name: &'static str,
    /// What its elements are.
    pub kind: ElementKind,
    /// Its WGSL, beside the frame.
    files: &'static [&'static str],
}

impl DeviceLaw {
    /// The whole module.
    pub fn source(&self) -> Source {
        match self.kind {
            ElementKind::Tetrahedron => tetrahedra(self.name, self.files),
            ElementKind::Edge => edges(self.name, self.files),
        }
    }
}

/// Forces from a stress.
const STRESS: &str = include_str!("../stress.wgsl");

/// All laws with a twin.
pub static LAWS: [DeviceLaw; 8] = [
    fused::LAW,
    stvk_fem::LAW,
    quadratic::LAW,
    linear::LAW,
    warped::LAW,
    corotational::LAW,
    neo_hookean::LAW,
    mass_spring::LAW,
];

/// Columns of the elements of one body and law, as the device has them.
#[derive(Clone, Debug, Default)]
pub struct ElementColumns {
    /// Vertex rows of element after element, relative to the first row of the body.
    pub nodes: Vec<u32>,
    /// Constants of element after element. Tetrahedra: D_1 (1/m) and lambda V (J), D_2 and mu V, D_3 and kappa V.
    pub data: Vec<f32>,
}

/// Columns of the elements of `body` that have law `L`; `first_row` is the first row of the body.
fn tetrahedron_columns<L: TetrahedronLaw, S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query_filtered::<(TetrahedronData<S>, &BodyId), L::Bodies>();
    for ((nodes, _, (d1, d2, d3), volume, lambda, mu, compression), of) in query.iter(world) {
        if of.0 as usize != body {
            continue;
        }
        let volume = volume.0.to_f64();
        // products in f64, rounded once
        let f = |x: S| x.to_f64() as f32;
        let folded = |x: S| (x.to_f64() * volume) as f32;
        columns.nodes.extend(nodes.0.map(|row| row - first_row));
        columns.data.extend([
            f(d1.0.0),
            f(d1.1.0),
            f(d1.2.0),
            folded(lambda.0),
            f(d2.0.0),
            f(d2.1.0),
            f(d2.2.0),
            folded(mu.0),
            f(d3.0.0),
            f(d3.1.0),
            f(d3.2.0),
            folded(compression.0),
        ]);
    }
    columns
}

/// All elements of a body, law by law.
pub fn columns<S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> Vec<(DeviceLaw, ElementColumns)> {
    let mut found = vec![
        (fused::LAW, fused::columns::<S>(world, body, first_row)),
        (stvk_fem::LAW, stvk_fem::columns::<S>(world, body, first_row)),
        (quadratic::LAW, quadratic::columns::<S>(world, body, first_row)),
        (linear::LAW, linear::columns::<S>(world, body, first_row)),
        (warped::LAW, warped::columns::<S>(world, body, first_row)),
        (corotational::LAW, corotational::columns::<S>(world, body, first_row)),
        (neo_hookean::LAW, neo_hookean::columns::<S>(world, body, first_row)),
        (mass_spring::LAW, mass_spring::columns::<S>(world, body, first_row)),
    ];
    found.retain(|(_, columns)| !columns.nodes.is_empty());
    found
}
