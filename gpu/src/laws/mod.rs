//! Laws on the device: for each the WGSL beside the file that gathers its columns. Names are those of
//! `sinew_models`.

pub mod axes;
pub mod dampers;
pub mod mass_spring;
pub mod membranes;
pub mod pooled;
pub mod pressure;
pub mod solid;

use bevy_ecs::component::ComponentId;
use bevy_ecs::prelude::*;
use bevy_ecs::query::{QueryBuilder, ReadOnlyQueryData};
use sinew_engine::isoparametric::HexahedronRest;
use sinew_engine::law::TangentKind;
use sinew_engine::resource::ensure;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::frame::row::{InRecovery, LawRow, LawTable, precision};
use sinew_models::laws::pooled::{EDGE_CHANGES, SPRING_FORCES};

use crate::sources::{ShaderSource, elements};

/// What elements are: their vertices, constants and the frame of their passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceElement {
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
pub const EDGE: DeviceElement = DeviceElement {
    vertices: 2,
    constants: 4,
    threads: 1,
    files: &[include_str!("../edges.wgsl")],
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

impl DeviceElement {
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

/// Finds the elements of a body that follow a law.
type Find = fn(ElementSearch<'_>) -> ElementColumns;

/// Elements that are looked for.
struct ElementSearch<'w> {
    world: &'w mut World,
    /// The component that marks them.
    mark: ComponentId,
    /// Index of their body.
    body: usize,
    /// Its first row.
    first_row: u32,
}

impl ElementSearch<'_> {
    /// What was found; `add` appends the constants of an element and returns its vertex rows.
    fn columns<D: ReadOnlyQueryData, const N: usize>(
        self,
        add: impl Fn(D::Item<'_, '_>, &mut Vec<f32>) -> [u32; N],
    ) -> ElementColumns {
        let mut columns = ElementColumns::default();
        let mut query = QueryBuilder::<(D, &BodyId)>::new(self.world);
        let mut query = query.with_id(self.mark).build();
        for (element, of) in query.iter(self.world) {
            if of.0 as usize == self.body {
                let nodes = add(element, &mut columns.data);
                columns.nodes.extend(nodes.map(|row| row - self.first_row));
            }
        }
        columns
    }
}

/// Appends rows of constants, in `f64` so that products are rounded once.
fn push<const R: usize>(data: &mut Vec<f32>, rows: [[f64; 4]; R]) {
    data.extend(rows.as_flattened().iter().map(|x| *x as f32));
}

/// A vector and a number.
fn row([x, y, z]: [f64; 3], number: f64) -> [f64; 4] {
    [x, y, z, number]
}

/// The three numbers of columns in a tuple.
macro_rules! three {
    ($columns:expr) => {
        [$columns.0.0.to_f64(), $columns.1.0.to_f64(), $columns.2.0.to_f64()]
    };
}
use three;

/// Gradients (1/m) of the local coordinates at the points of a hexahedron, with the shares (m^3) of the points.
fn points<S: Scalar>(rest: &HexahedronRest<S>) -> impl Iterator<Item = ([[f64; 3]; 3], f64)> {
    (0..8).map(|q| {
        let d = |i: usize, x: usize| rest.gradients[3 * i + x][q].to_f64();
        let d = std::array::from_fn(|i| std::array::from_fn(|x| d(i, x)));
        (d, rest.volume[q].to_f64())
    })
}

/// Twelve constants of elements or points with nothing but the modulus of the compression term, that at place `at`;
/// none where no element has it.
fn compression_alone(mut columns: ElementColumns, at: usize) -> ElementColumns {
    if columns.data.chunks_exact(12).all(|constants| constants[at] == 0.0) {
        return ElementColumns::default();
    }
    for constants in columns.data.chunks_exact_mut(12) {
        (constants[3], constants[7]) = (0.0, 0.0);
    }
    columns
}

/// A law with a twin on the device. A body has a set of elements for each of its laws; what sets give is added
/// up in the order of the laws.
#[derive(Clone, Copy, Debug)]
pub struct DeviceLaw {
    /// The law.
    pub row: &'static LawRow,
    /// What its elements are.
    pub kind: DeviceElement,
    /// Whether its set measures volume ratios. Every solid element of a body is in one such set at most.
    pub volumes: bool,
    /// How its elements are found, in `f64` and `f32`.
    find: [Find; 2],
    /// Its WGSL, beside that of the kind of element.
    files: &'static [&'static str],
}

impl DeviceLaw {
    /// A law whose set measures no volumes.
    const fn new(
        row: &'static LawRow,
        kind: DeviceElement,
        find: [Find; 2],
        files: &'static [&'static str],
    ) -> Self {
        Self { row, kind, volumes: false, find, files }
    }

    /// Name of the law.
    pub fn name(&self) -> &'static str {
        self.row.info.name
    }

    /// Whether its energy is the potential of a load.
    pub fn is_load(&self) -> bool {
        self.row.info.is_load
    }

    /// Whether it has a part in a tangent of this kind.
    pub fn has_tangent(&self, kind: TangentKind) -> bool {
        (self.row.tangent)(kind)
    }

    /// The law that its elements follow.
    pub fn now(&self, recovering: bool) -> Option<&Self> {
        match self.row.recovery {
            InRecovery::StandIn if recovering && self.kind == solid::HEXAHEDRON => {
                Some(&solid::COROTATIONAL_HEXAHEDRA)
            }
            InRecovery::StandIn if recovering => Some(&solid::COROTATIONAL_TETRAHEDRA),
            InRecovery::Silent if recovering => None,
            _ => Some(self),
        }
    }

    /// The whole module.
    pub fn source(&self) -> ShaderSource {
        elements(self.name(), self.kind.files, self.files)
    }
}

/// All laws with a twin.
pub fn all() -> impl Iterator<Item = &'static DeviceLaw> {
    let kinds = [solid::LAWS, pooled::LAWS, membranes::LAWS, axes::LAWS, dampers::LAWS];
    kinds.into_iter().flatten().chain([&mass_spring::LAW, &pressure::LAW])
}

/// Names of systems that have no elements of their own here: others do their part.
fn is_carried(name: &str) -> bool {
    [EDGE_CHANGES, SPRING_FORCES.info.name].contains(&name)
}

/// Whether a law or system that is active in a world runs on the device.
pub fn is_known(name: &str) -> bool {
    is_carried(name) || all().any(|law| law.name() == name)
}

/// Columns of the elements of one body and law, as the device has them.
#[derive(Clone, Debug, Default)]
pub struct ElementColumns {
    /// Vertex rows of element after element, relative to the first row of the body.
    pub nodes: Vec<u32>,
    /// Constants of element after element, as its [`DeviceElement`] has them.
    pub data: Vec<f32>,
    /// The load that they belong to, if any: its value is a factor.
    pub load: Option<Entity>,
}

/// The elements of a body that follow one of the laws `wanted`, law by law in the order in which the processor
/// adds them up.
pub fn columns<S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
    wanted: impl Fn(&DeviceLaw) -> bool,
) -> Vec<(DeviceLaw, ElementColumns)> {
    let mut found: Vec<_> = all()
        .filter(|law| wanted(law))
        .map(|law| {
            let mark = law.row.mark::<S>(world);
            (*law, law.find[precision::<S>()](ElementSearch { world, mark, body, first_row }))
        })
        .filter(|(_, columns)| !columns.nodes.is_empty())
        .collect();
    if wanted(&pressure::LAW) {
        found.extend(pressure::columns(world, body, first_row));
    }
    let table = ensure::<LawTable>(world);
    found.sort_by_key(|(law, _)| table.find(law.name()).map(|(place, _)| place));
    found
}
