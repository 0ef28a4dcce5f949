//! A row of the table of laws: by what component the elements of a law are marked, how it is put into the force
//! schedule for either precision, and what it does to tangents and in recovery.
//!
//! The constructors of rows stand beside what runs them: [`super::tetrahedra`], [`super::clusters`],
//! [`super::hexahedra`], [`super::triangles`], [`super::quads`]. A law with systems of its own is made by
//! [`LawRow::of_systems`], with [`mark`], [`partition`] and [`activate_elements`].
//!
//! A world has a copy of the table, [`LawTable`]: another crate adds laws of its own there, or puts one in the
//! place of a shipped one. [`DisabledLaws`](sinew_engine::law::DisabledLaws) switches laws off.

use bevy_ecs::component::{ComponentId, Mutable};
use bevy_ecs::prelude::*;
use bevy_ecs::query::{ContiguousQueryData, QueryBuilder, ReadOnlyQueryData};
use sinew_engine::columns::single_table;
use sinew_engine::element::{AxisVertices, EdgeVertices, MembraneVertices, TetrahedronVertices};
use sinew_engine::isoparametric::{
    AxisHexahedronVertices, AxisTetrahedron10Vertices, HexahedronVertices, QuadVertices,
    Tetrahedron10Vertices,
};
use sinew_engine::law::{LawBuffer, LawInfo, Partition, TangentKind};
use sinew_engine::resource::ensure;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{ElementLaw, Evaluate, activate_law};
use sinew_engine::topology::Topology;

use super::law::TetrahedronLaw;
use super::part::SolidPart;
use super::rules::{VolumeMeasure, VolumeRule};
use crate::element::hourglass::{Modes, Stiffness};
use crate::element::tetrahedron::Element;

/// What the elements of a law are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Elements {
    /// Tetrahedra, one at a time.
    Tetrahedra,
    /// Tetrahedra of pooled bodies.
    PooledTetrahedra,
    /// Faces of tetrahedra and membrane triangles of pooled bodies.
    PooledTriangles,
    /// Edges of pooled bodies.
    PooledEdges,
    /// Hexahedra, at their Gauss points.
    Hexahedra,
    /// Hexahedra with reduced integration.
    ReducedHexahedra,
    /// Ten-node tetrahedra, at their Gauss points.
    Tetrahedra10,
    /// Membrane triangles.
    Triangles,
    /// Membrane quadrilaterals, at their Gauss points.
    Quads,
    /// Edges that are springs by themselves.
    Edges,
    /// Axes of anisotropy in tetrahedra.
    AxesInTetrahedra,
    /// Fibres in membrane triangles.
    AxesInTriangles,
    /// Axes of anisotropy in hexahedra.
    AxesInHexahedra,
    /// Axes of anisotropy in ten-node tetrahedra.
    AxesInTetrahedra10,
    /// Faces under pressure.
    Faces,
    /// Edges between two membrane triangles that resist bending.
    Hinges,
    /// Points of wounds that glue holds together.
    Bonds,
}

/// What a law does while its body recovers from inversion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InRecovery {
    /// The corotational energy of the same elements takes its place.
    StandIn,
    /// It has no energy, no force and no tangent.
    Silent,
    /// Goes on.
    Unchanged,
}

/// Finds the component that marks the elements of a law.
pub type Mark = fn(&mut World) -> ComponentId;
/// Puts a law into the schedule of a world, at its place in the sum.
pub type Activate = fn(&mut World, PlacedLaw);

/// Energy (J) of a tetrahedron at the displacements (m) of its vertices.
pub type TetrahedronEnergy = fn(&Element<f64>, &[[f64; 3]; 4]) -> f64;

/// Forces (N) on the vertices of a tetrahedron at their displacements (m), if there are any.
pub type TetrahedronForces = fn(&Element<f64>, &[[f64; 3]; 4]) -> Option<[[f64; 3]; 4]>;

/// Energy (J) of the hourglass modes of a hexahedron.
pub(crate) type HourglassEnergy = fn(&Stiffness<f64>, &Modes<f64>) -> f64;

/// The measuring of means of volumes ([`super::means`]).
#[derive(Clone, Copy, Debug)]
pub struct Measure {
    /// Name of its system.
    pub name: &'static str,
    /// What it measures.
    pub volume: VolumeMeasure,
}

impl Measure {
    /// Of a law with a volume term that takes a pressure.
    pub(crate) const fn of<L: TetrahedronLaw>(name: &'static str) -> Option<Self> {
        match L::VOLUME {
            Some(volume) => Some(Self { name, volume }),
            None => None,
        }
    }
}

/// One law.
#[derive(Clone, Copy, Debug)]
pub struct LawRow {
    /// Name in reports, and whether it is a load.
    pub info: LawInfo,
    /// What its elements are.
    pub elements: Elements,
    /// Whether it has energy and forces.
    pub forces: bool,
    /// Whether it has a part in a tangent of this kind.
    pub tangent: fn(TangentKind) -> bool,
    /// What it does while its body recovers.
    pub recovery: InRecovery,
    /// Whether it is a part of the damping matrix, and of nothing else.
    pub is_damper: bool,
    /// Whether it holds any follower pressure ([`TetrahedronLaw::HOLDS_PRESSURE`]).
    pub holds_pressure: bool,
    /// Whether its resistance to compression has a maximum ([`TetrahedronLaw::SOFTENS`]).
    pub softens: bool,
    /// Energy of one of its tetrahedra.
    pub energy: Option<TetrahedronEnergy>,
    /// Forces on the vertices of one of its linear tetrahedra.
    pub element_forces: Option<TetrahedronForces>,
    /// Energy of the hourglass modes of one of its elements, where integration is reduced.
    pub(crate) hourglass: Option<HourglassEnergy>,
    /// Rows of the same law in other elements, and with its volume term by means.
    pub family: &'static [&'static LawRow],
    /// What runs before the law, if anything does.
    pub measure: Option<Measure>,
    /// Takes the stiffness from an entity of a removed element, where that is in columns of another crate.
    pub removal: Option<fn(&mut EntityWorldMut)>,
    pub(crate) mark: [Mark; 2],
    pub(crate) activate: [Activate; 2],
    pub(crate) spawn: Option<[fn(&mut World, &SolidPart); 2]>,
}

/// A law as a world has it: its row there, and its place in the sum.
#[derive(Clone, Copy, Debug)]
pub struct PlacedLaw {
    /// The row.
    pub row: &'static LawRow,
    /// The place, lower first.
    pub place: usize,
}

impl PartialEq for LawRow {
    /// Laws are told apart by their names.
    fn eq(&self, other: &Self) -> bool {
        self.info == other.info
    }
}

impl Eq for LawRow {}

/// The component `C` as a mark, for [`LawRow::of_systems`].
pub fn mark<C: Component>(world: &mut World) -> ComponentId {
    world.register_component::<C>()
}

/// Place of a precision in the pairs of a row: 0 for `f64`, 1 for `f32`.
pub fn precision<S: Scalar>() -> usize {
    usize::from(size_of::<S>() == size_of::<f32>())
}

impl LawRow {
    /// A law with systems of its own, silent in recovery: for `f64` and `f32`, how its elements are marked
    /// and how it is put into the schedule.
    pub const fn of_systems(
        info: LawInfo,
        elements: Elements,
        mark: [Mark; 2],
        activate: [Activate; 2],
    ) -> Self {
        Self {
            info,
            elements,
            forces: true,
            tangent: |_| true,
            recovery: if info.is_load { InRecovery::Unchanged } else { InRecovery::Silent },
            is_damper: false,
            holds_pressure: true,
            softens: false,
            energy: None,
            element_forces: None,
            hourglass: None,
            family: &[],
            measure: None,
            removal: None,
            mark,
            activate,
            spawn: None,
        }
    }

    /// A law of dampers, likewise.
    pub const fn of_dampers(
        info: LawInfo,
        elements: Elements,
        mark: [Mark; 2],
        activate: [Activate; 2],
    ) -> Self {
        let recovery = InRecovery::Unchanged;
        let row = Self::of_systems(info, elements, mark, activate);
        Self { forces: false, tangent: |_| false, is_damper: true, recovery, ..row }
    }

    /// This law with a part only in the tangents of which `tangent` says so.
    pub const fn with_tangent(self, tangent: fn(TangentKind) -> bool) -> Self {
        Self { tangent, ..self }
    }

    /// This law with another conduct in recovery.
    pub const fn in_recovery(self, recovery: InRecovery) -> Self {
        Self { recovery, ..self }
    }

    /// This law, whose energy grows no faster than the volume under a pressure.
    pub const fn yielding_to_pressure(self) -> Self {
        Self { holds_pressure: false, ..self }
    }

    /// This law with what takes the stiffness from an entity of a removed element. Columns of this crate need none.
    pub const fn with_removal(self, removal: fn(&mut EntityWorldMut)) -> Self {
        Self { removal: Some(removal), ..self }
    }

    /// This law with its rows in other elements and by means.
    pub const fn with_family(self, family: &'static [&'static LawRow]) -> Self {
        Self { family, ..self }
    }

    /// The same law in these elements of a body with this rule, if there is one.
    pub fn in_elements(
        &'static self,
        elements: Elements,
        volume: VolumeRule,
    ) -> Option<&'static LawRow> {
        let by_means = volume == VolumeRule::Clusters;
        let fits = |row: &&Self| row.elements == elements && row.measure.is_some() == by_means;
        std::iter::once(self).chain(self.family.iter().copied()).find(fits)
    }

    /// The component that marks its elements in a world of this precision.
    pub fn mark<S: Scalar>(&self, world: &mut World) -> ComponentId {
        self.mark[precision::<S>()](world)
    }

    /// Spawns the elements of a body that follow it and puts it into the schedule.
    pub(crate) fn spawn<S: Scalar>(&'static self, world: &mut World, part: &SolidPart) {
        if let Some(spawn) = self.spawn {
            spawn[precision::<S>()](world, part);
            activate::<S>(world, self);
        }
    }
}

/// The laws that a world knows: [`LAWS`](crate::laws::LAWS), then those that its users added.
#[derive(Resource, Clone, Debug)]
pub struct LawTable(pub(crate) Vec<&'static LawRow>);

/// A law that cannot be put into a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LawError {
    /// The name is taken.
    #[error(
        "there is a law `{0}` already: names must be unique; `LawTable::replace` puts one in its place"
    )]
    Duplicate(&'static str),
    /// A body asks for a law that acts on something else.
    #[error(
        "law `{0}` acts neither on tetrahedra nor on axes in them: make its row with `LawRow::tetrahedra`"
    )]
    NotOfTetrahedra(&'static str),
    /// There is none of this name.
    #[error("there is no law `{0}` to replace; `LawTable::rows` lists their names")]
    Unknown(&'static str),
    /// It acts on other elements than the law whose place it takes.
    #[error(
        "law `{name}` acts on {old:?}, the one in its place on {new:?}: they must act on the same elements"
    )]
    OtherElements {
        /// Name.
        name: &'static str,
        /// Elements of the law that was there.
        old: Elements,
        /// Elements of the other.
        new: Elements,
    },
}

impl LawTable {
    /// All rows, in the order in which they are summed up.
    pub fn rows(&self) -> &[&'static LawRow] {
        &self.0
    }

    /// The law of this name with its place in the sum.
    pub fn find(&self, name: &str) -> Option<(usize, &'static LawRow)> {
        self.0.iter().copied().enumerate().find(|(_, row)| row.info.name == name)
    }

    /// Adds a law, and its rows of other elements if it has some, unless they are there. Spawning a body with
    /// [`Model::Own`](crate::laws::models::Model::Own) does this.
    ///
    /// # Errors
    /// When another law has the name.
    pub fn add(&mut self, row: &'static LawRow) -> Result<(), LawError> {
        for row in std::iter::once(row).chain(row.family.iter().copied()) {
            match self.find(row.info.name) {
                None => self.0.push(row),
                Some((_, known)) if std::ptr::eq(known, row) => {}
                Some(_) => return Err(LawError::Duplicate(row.info.name)),
            }
        }
        Ok(())
    }

    /// Puts a law in the place of the one of the same name, for bodies spawned from now on. Call it before the
    /// first body that has it.
    ///
    /// # Errors
    /// When there is none of this name, or it acts on other elements.
    pub fn replace(&mut self, row: &'static LawRow) -> Result<(), LawError> {
        let name = row.info.name;
        let (place, known) = self.find(name).ok_or(LawError::Unknown(name))?;
        let (old, new) = (known.elements, row.elements);
        if old != new {
            return Err(LawError::OtherElements { name, old, new });
        }
        self.0[place] = row;
        Ok(())
    }
}

/// The row that stands in a world's table in the place of `row`, and that place. A row of another crate has its place
/// in the sum from [`LawTable::add`].
pub fn in_table(world: &mut World, row: &'static LawRow) -> PlacedLaw {
    let table = ensure::<LawTable>(world);
    // rows of this crate are in every table: it can only grow, and names are kept
    let (place, row) = table.find(row.info.name).unwrap_or((table.rows().len(), row));
    PlacedLaw { row, place }
}

/// Puts a law into the schedule of a world, once. Call it when its first elements were spawned, and
/// [`partition_laws`](sinew_engine::law::partition_laws) when all were.
pub fn activate<S: Scalar>(world: &mut World, row: &'static LawRow) {
    let law = in_table(world, row);
    law.row.activate[precision::<S>()](world, law);
}

/// Puts a law of elements of kind `C` with the columns `D` into the schedule: what [`LawRow::of_systems`] takes for
/// `activate`. The law is evaluated by `evaluate`, range by range of its buffer.
pub fn activate_elements<C: ElementRows, S: Scalar, D>(
    world: &mut World,
    PlacedLaw { row, place }: PlacedLaw,
    evaluate: Evaluate<S, D>,
) where
    D: ReadOnlyQueryData + ContiguousQueryData + 'static,
{
    let mark = Some(row.mark::<S>(world));
    let partition: Partition<S> = partition::<C, S>;
    activate_law(world, ElementLaw { info: row.info, place, mark, partition, evaluate });
}

/// Elements that know the rows of their vertices.
pub trait ElementRows: Component<Mutability = Mutable> {
    /// Vertex rows.
    fn vertex_rows(&self) -> &[u32];
}

macro_rules! element_rows {
    ($($column:ty),+ $(,)?) => {$(
        impl ElementRows for $column {
            fn vertex_rows(&self) -> &[u32] {
                &self.0
            }
        }
    )+};
}
element_rows!(
    EdgeVertices,
    TetrahedronVertices,
    HexahedronVertices,
    Tetrahedron10Vertices,
    MembraneVertices,
    QuadVertices,
    AxisVertices,
    AxisHexahedronVertices,
    AxisTetrahedron10Vertices,
);

/// Cuts the elements of kind `C` that have the component `mark` into the ranges of a law's buffer.
pub fn partition<C: ElementRows, S: Scalar>(
    world: &mut World,
    mark: Option<ComponentId>,
    buffer: &mut LawBuffer<S>,
) {
    let mut query = QueryBuilder::<&C>::new(world);
    if let Some(mark) = mark {
        query.with_id(mark);
    }
    let mut elements = query.build();
    let topology = world.resource::<Topology>();
    match single_table(elements.contiguous_iter(world)) {
        Some(column) => buffer.partition(column.len(), topology, |i| column[i].vertex_rows()),
        None => buffer.spans.clear(),
    }
}
