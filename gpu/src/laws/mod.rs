//! Laws on the device: for each the WGSL beside the file that gathers its columns. Names are those of
//! `sinew_models`.

pub mod axes;
pub mod corotational;
pub mod dampers;
pub mod fused;
pub mod hexahedra;
pub mod linear;
pub mod mass_spring;
pub mod membranes;
pub mod neo_hookean;
pub mod pooled;
pub mod pressure;
pub mod quadratic;
pub mod stvk_fem;
pub mod warped;

use bevy_ecs::prelude::*;
use sinew_engine::element::AxisVertices;
use sinew_engine::isoparametric::AxisHexahedronVertices;
use sinew_engine::law::{Law, TangentKind};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::corotational::Corotational;
use sinew_models::fused::{FusedStVK, TetrahedronData, TetrahedronLaw};
use sinew_models::fused_membrane::{
    BiquadraticMembrane, CorotationalMembrane, LinearMembrane, PooledMembrane, QuadraticMembrane,
};
use sinew_models::linear::Linear;
use sinew_models::neo_hookean::NeoHookean;
use sinew_models::pooled::SpringForces;

use crate::sources::{Source, elements};

/// What elements are: their vertices, constants and the frame of their passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ElementKind {
    /// Vertices of an element.
    pub vertices: usize,
    /// Constants of an element, a multiple of 4.
    pub constants: usize,
    /// Threads that share an element, a power of two.
    pub threads: usize,
    /// Its WGSL.
    files: &'static [&'static str],
}

/// Two vertices; rest vector X_a - X_b (m) and stiffness (N/m^3).
pub const EDGE: ElementKind =
    ElementKind { vertices: 2, constants: 4, threads: 1, files: &[include_str!("../edges.wgsl")] };

/// Four vertices; D_1 (1/m) and lambda V (J), D_2 and mu V, D_3 and kappa V.
pub const TETRAHEDRON: ElementKind = ElementKind {
    vertices: 4,
    constants: 12,
    threads: 1,
    files: &[
        TETRAHEDRA,
        FOUR_VERTICES,
        DEFORMATION,
        include_str!("../tetrahedron.wgsl"),
        PROJECTION,
        include_str!("../tetrahedron_volumes.wgsl"),
        VOLUMES,
    ],
};

/// Forces and blocks of four vertices from those of three.
const FOUR_VERTICES: &str = include_str!("../four_vertices.wgsl");
/// What deformation is measured by.
const DEFORMATION: &str = include_str!("../deformation.wgsl");
/// Positive semidefinite tangents.
const PROJECTION: &str = include_str!("../projection.wgsl");
/// Volume ratios.
const VOLUMES: &str = include_str!("../volumes.wgsl");
/// Forces from a stress.
const VERTEX_FORCES: &str = include_str!("../vertex_forces.wgsl");
/// The same, and what tangents of isotropic laws are made of.
const STRESS: &str = concat!(include_str!("../vertex_forces.wgsl"), include_str!("../stress.wgsl"));
/// How far an edge is stretched.
const STRETCH: &str = include_str!("stretch.wgsl");
/// Triangles, one thread each.
const TRIANGLES: &str = include_str!("../triangles.wgsl");
/// Tetrahedra, one thread each.
const TETRAHEDRA: &str = include_str!("../tetrahedra.wgsl");

impl ElementKind {
    /// Tangent blocks of an element: those of its vertices, then those of its pairs of vertices in
    /// lexicographic order.
    pub fn blocks(&self) -> usize {
        self.vertices * (self.vertices + 1) / 2
    }

    /// Place among those blocks of the local vertices `a <= b`.
    pub fn block(&self, a: usize, b: usize) -> usize {
        let n = self.vertices;
        if a == b { a } else { n + a * (2 * n - a - 1) / 2 + b - a - 1 }
    }
}

/// What a law does while its body recovers from inversion.
#[derive(Clone, Copy, Debug)]
pub enum InRecovery {
    /// Another law of the same elements, with the same columns, stands in for it.
    StandIn(&'static DeviceLaw),
    /// It has no energy, no force and no tangent.
    Silent,
    /// Goes on.
    Unchanged,
}

/// A law with a twin on the device. A body has a set of elements for each of its laws; what sets give is added
/// up in the order of the laws.
#[derive(Clone, Copy, Debug)]
pub struct DeviceLaw {
    /// [`Law::NAME`] of the law.
    pub name: &'static str,
    /// [`Law::ORDER`] of the law.
    pub order: u8,
    /// What its elements are.
    pub kind: ElementKind,
    /// What it does while its body recovers.
    pub recovery: InRecovery,
    /// Whether its energy is the potential of a load ([`Law::IS_LOAD`]).
    pub is_load: bool,
    /// Whether it has energy and forces.
    pub forces: bool,
    /// Whether it has a part in a tangent of this kind.
    pub tangent: fn(TangentKind) -> bool,
    /// Whether it is a part of the damping matrix, and of nothing else.
    pub is_damper: bool,
    /// Whether its set measures volume ratios. Every solid element of a body is in one such set at most.
    pub volumes: bool,
    /// Its WGSL, beside that of the kind of element.
    files: &'static [&'static str],
}

impl DeviceLaw {
    /// Law `L`, with energy, forces and all tangents, silent in recovery.
    const fn of<L: Law>(kind: ElementKind, files: &'static [&'static str]) -> Self {
        Self {
            name: L::NAME,
            order: L::ORDER,
            kind,
            recovery: InRecovery::Silent,
            is_load: L::IS_LOAD,
            forces: true,
            tangent: |_| true,
            is_damper: false,
            volumes: false,
            files,
        }
    }

    /// Law `L` of tetrahedra, for which the corotational one stands in where the CPU has it so.
    const fn of_tetrahedra<L: TetrahedronLaw>(files: &'static [&'static str]) -> Self {
        let recovery =
            if L::STANDS_IN { InRecovery::StandIn(&corotational::LAW) } else { InRecovery::Silent };
        let forces = L::FORCES;
        let law = Self::of::<L>(TETRAHEDRON, files);
        Self { recovery, forces, tangent: L::contributes, volumes: true, ..law }
    }

    /// The law that its elements follow.
    pub fn now(&self, recovering: bool) -> Option<&Self> {
        match self.recovery {
            InRecovery::StandIn(other) if recovering => Some(other),
            InRecovery::Silent if recovering => None,
            _ => Some(self),
        }
    }

    /// The whole module.
    pub fn source(&self) -> Source {
        elements(self.name, self.kind.files, self.files)
    }
}

/// All laws with a twin.
pub static LAWS: [DeviceLaw; 35] = [
    fused::LAW,
    fused::COMPRESSION,
    fused::PROJECTION,
    pooled::TENSILE,
    pooled::ANGULAR,
    pooled::VOLUMETRIC,
    stvk_fem::LAW,
    quadratic::LAW,
    linear::LAW,
    warped::LAW,
    corotational::LAW,
    neo_hookean::LAW,
    mass_spring::LAW,
    hexahedra::STVK,
    hexahedra::LINEAR,
    hexahedra::COROTATIONAL,
    hexahedra::NEO_HOOKEAN,
    axes::TRIADS,
    axes::FIBRES,
    axes::VOLUMES,
    axes::HEXAHEDRON_TRIADS,
    axes::HEXAHEDRON_FIBRES,
    axes::HEXAHEDRON_VOLUMES,
    membranes::BIQUADRATIC,
    membranes::QUADRATIC,
    membranes::LINEAR,
    membranes::COROTATIONAL,
    membranes::QUAD_BIQUADRATIC,
    membranes::QUAD_LINEAR,
    membranes::QUAD_COROTATIONAL,
    membranes::COMPRESSION,
    membranes::PROJECTION,
    pressure::LAW,
    dampers::IN_TETRAHEDRA,
    dampers::IN_HEXAHEDRA,
];

/// Names of systems that have no elements of their own here: others do their part.
const CARRIED: [&str; 2] = [sinew_models::pooled::EDGE_CHANGES, SpringForces::NAME];

/// Whether a law or system that is active in a world runs on the device.
pub fn is_known(name: &str) -> bool {
    CARRIED.contains(&name) || LAWS.iter().any(|law| law.name == name)
}

/// Columns of the elements of one body and law, as the device has them.
#[derive(Clone, Debug, Default)]
pub struct ElementColumns {
    /// Vertex rows of element after element, relative to the first row of the body.
    pub nodes: Vec<u32>,
    /// Constants of element after element, as its [`ElementKind`] has them.
    pub data: Vec<f32>,
    /// The load that they belong to, if any: its value is a factor.
    pub load: Option<Entity>,
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
        let d = [d1.0.0, d1.1.0, d1.2.0, d2.0.0, d2.1.0, d2.2.0, d3.0.0, d3.1.0, d3.2.0];
        columns.nodes.extend(nodes.0.map(|row| row - first_row));
        push_tetrahedron(&mut columns.data, d, volume.0, [lambda.0, mu.0, compression.0]);
    }
    columns
}

/// Appends the constants of a [`TETRAHEDRON`] from its shape vectors (1/m), volume (m^3) and moduli (Pa).
fn push_tetrahedron<S: Scalar>(data: &mut Vec<f32>, d: [S; 9], volume: S, moduli: [S; 3]) {
    for (d, modulus) in d.chunks_exact(3).zip(moduli) {
        data.extend(d.iter().map(|x| x.to_f64() as f32));
        // in f64, rounded once
        data.push((modulus.to_f64() * volume.to_f64()) as f32);
    }
}

/// Finds the elements of a body (by index and first row) that follow a law.
type Find = fn(&mut World, usize, u32) -> ElementColumns;

/// How the elements of every law are found.
fn finders<S: Scalar>() -> Vec<(DeviceLaw, Find)> {
    vec![
        (fused::LAW, fused::columns::<S>),
        (fused::COMPRESSION, fused::compression::<S>),
        (fused::PROJECTION, fused::projection::<S>),
        (pooled::TENSILE, pooled::tensile::<S>),
        (pooled::ANGULAR, pooled::angular::<S>),
        (pooled::VOLUMETRIC, pooled::volumetric::<S>),
        (stvk_fem::LAW, stvk_fem::columns::<S>),
        (quadratic::LAW, quadratic::columns::<S>),
        (linear::LAW, linear::columns::<S>),
        (warped::LAW, warped::columns::<S>),
        (corotational::LAW, corotational::columns::<S>),
        (neo_hookean::LAW, neo_hookean::columns::<S>),
        (mass_spring::LAW, mass_spring::columns::<S>),
        (hexahedra::STVK, hexahedra::columns::<FusedStVK, S>),
        (hexahedra::LINEAR, hexahedra::columns::<Linear, S>),
        (hexahedra::COROTATIONAL, hexahedra::columns::<Corotational, S>),
        (hexahedra::NEO_HOOKEAN, hexahedra::columns::<NeoHookean, S>),
        (axes::TRIADS, axes::triads::<S>),
        (axes::FIBRES, axes::fibres::<S>),
        (axes::VOLUMES, axes::volumes::<S>),
        (axes::HEXAHEDRON_TRIADS, axes::hexahedron_triads::<S>),
        (axes::HEXAHEDRON_FIBRES, axes::hexahedron_fibres::<S>),
        (axes::HEXAHEDRON_VOLUMES, axes::hexahedron_volumes::<S>),
        (dampers::IN_TETRAHEDRA, dampers::columns::<4, AxisVertices>),
        (dampers::IN_HEXAHEDRA, dampers::columns::<8, AxisHexahedronVertices>),
        (membranes::BIQUADRATIC, membranes::columns::<BiquadraticMembrane, S>),
        (membranes::QUADRATIC, membranes::columns::<QuadraticMembrane, S>),
        (membranes::LINEAR, membranes::columns::<LinearMembrane, S>),
        (membranes::COROTATIONAL, membranes::columns::<CorotationalMembrane, S>),
        (membranes::QUAD_BIQUADRATIC, membranes::quads::<BiquadraticMembrane, S>),
        (membranes::QUAD_LINEAR, membranes::quads::<LinearMembrane, S>),
        (membranes::QUAD_COROTATIONAL, membranes::quads::<CorotationalMembrane, S>),
        (membranes::COMPRESSION, membranes::compression::<S>),
        (membranes::PROJECTION, membranes::columns::<PooledMembrane, S>),
    ]
}

/// The elements of a body that follow one of the laws `wanted`, law by law in the order in which the processor
/// adds them up.
pub fn columns<S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
    wanted: impl Fn(&DeviceLaw) -> bool,
) -> Vec<(DeviceLaw, ElementColumns)> {
    let mut found: Vec<_> = finders::<S>()
        .into_iter()
        .filter(|(law, _)| wanted(law))
        .map(|(law, find)| (law, find(world, body, first_row)))
        .filter(|(_, columns)| !columns.nodes.is_empty())
        .collect();
    if wanted(&pressure::LAW) {
        found.extend(pressure::columns(world, body, first_row));
    }
    found.sort_by_key(|(law, _)| law.order);
    found
}
