//! Axes in the form that Bourguignon & Cani 2000 print: a law of axes added from another crate. The table of laws of the
//! world takes its rows, the body's elements are read from their columns, and entities of springs and dampers are spawned
//! beside them.
//!
//! | module | content |
//! |---|---|
//! | [`springs`] | the formulas |
//! | [`law`] | the law, in tetrahedra and in hexahedra |
//! | [`attachment`] | where axes meet the faces of their element |
//!
//! Spring constants follow from moduli such that these axes and the shipped ones agree near rest: `Y V/L^2` (N/m) along
//! an axis, `G V/sqrt(L_i L_j)` (N) between two, `9 Lambda V/(16 R^2)` (N/m) for the sum of radii of a tetrahedron,
//! `9 Lambda V/(8 R^2)` for each radius of a hexahedron, with the lengths L of the chords and the mean radius R of the
//! element (its root mean square in hexahedra).

pub mod attachment;
pub mod law;
pub mod springs;

use attachment::Attachment;
use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::prelude::*;
use glam::DVec3;
use law::{Printed, PrintedAxes, PrintedElement, PrintedModuli};
use sinew::engine::by_precision;
use sinew::engine::element::{
    AxisBlocks, AxisTetrahedron, AxisVertices, TetrahedronBlocks, TetrahedronIndex,
    TetrahedronVertices,
};
use sinew::engine::isoparametric::{
    AxisHexahedron, AxisHexahedronBlocks, AxisHexahedronVertices, HexahedronBlocks,
    HexahedronIndex, HexahedronVertices, RestHexahedron,
};
use sinew::engine::law::partition_laws;
use sinew::engine::precision::Precision;
use sinew::engine::resource::ensure;
use sinew::engine::scalar::Scalar;
use sinew::engine::topology::ElementTables;
use sinew::engine::vertex::{BodyId, RestPosition};
use sinew::models::axes::damper::{self, AxialDamper};
use sinew::models::axes::description::{
    AxesDescription, AxesError, AxisFamily, AxisGroup, FibreForm,
};
use sinew::models::axes::element::AXIS_PAIRS;
use sinew::models::element::precompute::RestTetrahedron;
use sinew::models::frame::row::{LawError, LawRow, LawTable, activate};
use sinew::prelude::{BodyHandle, Simulation};
use springs::VolumeForm;

/// Axes of a body in the printed form.
#[derive(Clone, Debug)]
pub struct PrintedDescription<'a> {
    /// Directions and moduli, without muscles.
    pub axes: AxesDescription<'a>,
    /// Form of the springs of volume.
    pub form: VolumeForm,
    /// Viscosity (Pa s) of the dampers beside the radial springs of hexahedra, `9 eta V / sum R^2` (N s/m) each; 0
    /// without them.
    pub volume_viscosity: f64,
}

/// Why a body cannot have such axes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PrintedError {
    /// Axes of any form could not be made.
    #[error(transparent)]
    Axes(#[from] AxesError),
    /// A law of the same name is another one.
    #[error(transparent)]
    Law(#[from] LawError),
    /// An axis that meets no two faces.
    #[error(
        "family `{family}`: its axis meets no two faces of element {element}; mend the element"
    )]
    NoChord {
        /// Name of the family.
        family: String,
        /// Index in the user's mesh, hexahedra counted after tetrahedra.
        element: usize,
    },
    /// An active family.
    #[error("family `{family}` is active, which printed axes do not know; leave its muscle out")]
    Muscle {
        /// Name of the family.
        family: String,
    },
    /// A family of another form.
    #[error("family `{family}` is biquadratic; printed axes measure stretch: leave its form out")]
    Form {
        /// Name of the family.
        family: String,
    },
    /// A viscosity of volume that cannot be used.
    #[error(
        "the viscosity of volume springs is {value} Pa s; it must be finite, not negative, and 0 in a body \
         without hexahedra"
    )]
    Viscosity {
        /// The viscosity (Pa s).
        value: f64,
    },
}

/// Rows and blocks of a tetrahedron, and where it comes from.
type InTetrahedron = (AxisVertices, AxisBlocks, AxisTetrahedron, BodyId);
/// The same of a hexahedron.
type InHexahedron = (AxisHexahedronVertices, AxisHexahedronBlocks, AxisHexahedron, BodyId);

/// An element of the body, with its number in lists of directions and its corners (m).
struct Place<Rows, const N: usize> {
    rows: Rows,
    element: usize,
    points: [DVec3; N],
    /// m^3
    volume: f64,
}

/// The elements of a body, in the order of their tables.
struct Places {
    tetrahedra: Vec<Place<InTetrahedron, 4>>,
    hexahedra: Vec<Place<InHexahedron, 8>>,
}

impl Places {
    fn of(world: &mut World, body: usize) -> Self {
        let rest: Vec<DVec3> = world.query::<&RestPosition>().iter(world).map(|x| x.0).collect();
        let at = |v: u32| rest[v as usize];
        let mut elements =
            world.query::<(&TetrahedronVertices, &TetrahedronBlocks, &TetrahedronIndex, &BodyId)>();
        let own = elements.iter(world).filter(|e| e.3.0 as usize == body);
        let tetrahedra: Vec<_> = own
            .filter_map(|(vertices, blocks, index, &id)| {
                let points = vertices.0.map(at);
                let shape = RestTetrahedron::new(points.map(|x| x.to_array())).ok()?;
                let rows =
                    (AxisVertices(vertices.0), AxisBlocks(blocks.0), AxisTetrahedron(index.0), id);
                Some(Place { rows, element: index.0 as usize, points, volume: shape.volume })
            })
            .collect();
        let mut elements =
            world.query::<(&HexahedronVertices, &HexahedronBlocks, &HexahedronIndex, &BodyId)>();
        let own = elements.iter(world).filter(|e| e.3.0 as usize == body);
        let hexahedra = own.filter_map(|(vertices, blocks, index, &id)| {
            let points = vertices.0.map(at);
            let shape = RestHexahedron::new(points.map(|x| x.to_array())).ok()?;
            let rows = (
                AxisHexahedronVertices(vertices.0),
                AxisHexahedronBlocks(blocks.0),
                AxisHexahedron(index.0),
                id,
            );
            // directions of hexahedra follow those of tetrahedra
            let element = tetrahedra.len() + index.0 as usize;
            Some(Place { rows, element, points, volume: shape.total_volume() })
        });
        let hexahedra = hexahedra.collect();
        Self { tetrahedra, hexahedra }
    }
}

impl PrintedDescription<'_> {
    /// Spawns the axes in a body none of whose elements was removed. Without another law its model is
    /// `Model::Own(&law::IN_TETRAHEDRA)`.
    ///
    /// # Errors
    /// When the description cannot be used; nothing is spawned then.
    pub fn add(&self, simulation: &mut Simulation, body: BodyHandle) -> Result<(), PrintedError> {
        let world = simulation.world_mut();
        let places = Places::of(world, body.0);
        self.check(&places)?;
        ensure::<LawTable>(world).add(&law::IN_TETRAHEDRA)?;
        let precision = *world.resource::<Precision>();
        by_precision!(precision, spawn(world, self, &places));
        Ok(())
    }

    fn check(&self, places: &Places) -> Result<(), PrintedError> {
        self.axes.validate(places.tetrahedra.len(), places.hexahedra.len())?;
        let value = self.volume_viscosity;
        if !(value >= 0.0 && value.is_finite()) || value > 0.0 && places.hexahedra.is_empty() {
            return Err(PrintedError::Viscosity { value });
        }
        for family in &self.axes.families {
            let family_name = || family.name.to_string();
            if family.muscle.is_some() {
                return Err(PrintedError::Muscle { family: family_name() });
            }
            if family.form != FibreForm::Stretch {
                return Err(PrintedError::Form { family: family_name() });
            }
            // in tetrahedra that have a volume every axis meets two faces
            for place in &places.hexahedra {
                let element = place.element;
                if family.share(element) > 0.0
                    && attachment::hexahedron(place.points, unit(family, element)).is_none()
                {
                    return Err(PrintedError::NoChord { family: family_name(), element });
                }
            }
        }
        Ok(())
    }
}

/// Unit vector of a family; where it has none, which its share of 0 allows, any.
fn unit(family: &AxisFamily, element: usize) -> DVec3 {
    family.direction(element).try_normalize().unwrap_or(DVec3::X)
}

fn spawn<S: Scalar>(world: &mut World, printed: &PrintedDescription, places: &Places) {
    let groups = printed.axes.pack();
    spawn_in::<S, _, 4>(
        world,
        (printed, &groups),
        &places.tetrahedra,
        [&law::IN_TETRAHEDRA, &damper::IN_TETRAHEDRA],
    );
    spawn_in::<S, _, 8>(
        world,
        (printed, &groups),
        &places.hexahedra,
        [&law::IN_HEXAHEDRA, &damper::IN_HEXAHEDRA],
    );
    partition_laws::<S>(world);
    let tables = ElementTables::of(world);
    world.insert_resource(tables);
}

/// Spawns the axes in the elements of a kind, and puts their laws into the schedule.
fn spawn_in<S: Scalar, Rows, const N: usize>(
    world: &mut World,
    (printed, groups): (&PrintedDescription, &[AxisGroup]),
    places: &[Place<Rows, N>],
    [of_springs, of_dampers]: [&'static LawRow; 2],
) where
    Rows: Bundle<Effect: NoBundleEffect> + Copy,
    Printed: PrintedElement<N>,
{
    let (mut springs, mut dampers) = (Vec::new(), Vec::new());
    for place in places {
        let made = Made::new(printed, groups, place);
        springs.extend(made.springs.into_iter().map(|springs| (place.rows, springs)));
        dampers.extend(made.dampers.into_iter().map(|damper| (place.rows, damper)));
    }
    if !springs.is_empty() {
        world.spawn_batch(springs);
        activate::<S>(world, of_springs);
    }
    if !dampers.is_empty() {
        world.spawn_batch(dampers);
        activate::<S>(world, of_dampers);
    }
}

/// Dampers from the barycentre to the vertices of a hexahedron, of a viscosity times volume of `viscosity` (J s);
/// tetrahedra have none. As with the springs there, the constant of each is `9 eta V / sum R^2` (N s/m).
fn radial_dampers<const N: usize>(
    points: [DVec3; N],
    viscosity: f64,
    form: VolumeForm,
) -> impl Iterator<Item = AxialDamper<N>> {
    let centre = points.iter().sum::<DVec3>() / N as f64;
    let squares: f64 = points.iter().map(|x| x.distance_squared(centre)).sum();
    let count = if N == 8 && viscosity > 0.0 { N } else { 0 };
    (0..count).map(move |j| {
        let arm = points[j] - centre;
        let radius = arm.length();
        let own = |a: usize| if a == j { 1.0 / radius } else { 0.0 };
        let share = 1.0 / (N as f64 * radius);
        let viscosity = 9.0 * viscosity / squares * radius * radius;
        let shape = std::array::from_fn(|a| own(a) - share);
        let damper = AxialDamper::new((arm / radius).to_array(), shape, viscosity);
        match form {
            VolumeForm::Balanced => damper,
            VolumeForm::Printed => AxialDamper { spread: std::array::from_fn(own), ..damper },
        }
    })
}

/// What the axes of an element of `N` vertices become.
struct Made<const N: usize> {
    springs: Vec<PrintedAxes<N>>,
    dampers: Vec<AxialDamper<N>>,
}

impl<const N: usize> Made<N>
where
    Printed: PrintedElement<N>,
{
    fn new<Rows>(
        printed: &PrintedDescription,
        groups: &[AxisGroup],
        place: &Place<Rows, N>,
    ) -> Self {
        let PrintedDescription { axes, form, volume_viscosity } = printed;
        let &Place { element, points, volume, .. } = place;
        // a chord without shape for an axis that is left open or has no share
        let none = (DVec3::ZERO, Attachment { plus: [0.0; N], minus: [0.0; N], length: 1.0 });
        let chord = |family: &AxisFamily| {
            let axis = unit(family, element);
            let ends = Printed::ends(points, axis).filter(|_| family.share(element) > 0.0);
            ends.map_or(none, |ends| (axis, ends))
        };
        let springs = groups.iter().map(|group| {
            let (families, axial, angular, volume_modulus) = match *group {
                AxisGroup::Triad { axes, axial, angles, volume } => (axes, axial, angles, volume),
                // refused
                AxisGroup::Biquadratic(i) | AxisGroup::Fibre(i) => {
                    ([Some(i), None, None], [Some(i), None, None], [0.0; 3], 0.0)
                }
                AxisGroup::Volume(modulus) => ([None; 3], [None; 3], [0.0; 3], modulus),
            };
            let families = families.map(|f| f.map(|f| &axes.families[f]));
            let share = families.map(|f| f.map_or(0.0, |f| f.share(element)));
            let pairs = AXIS_PAIRS.map(|[i, j]| share[i].min(share[j]));
            let modulus = axial.map(|f| f.map_or(0.0, |f| axes.families[f].modulus));
            let moduli = PrintedModuli {
                axial: modulus,
                share,
                angular: [0, 1, 2].map(|k| angular[k] * pairs[k]),
                volume: volume_modulus,
            };
            let chords = families.map(|f| f.map_or(none, chord));
            let chords = (chords.map(|c| c.0), chords.map(|c| c.1));
            PrintedAxes::new(points, volume, chords, moduli, *form)
        });
        let dampers = axes.families.iter().filter(|f| f.viscosity > 0.0).filter_map(|family| {
            let (axis, ends) = chord(family);
            let viscosity = volume * family.viscosity * family.share(element);
            let shape = ends.spread().map(|w| w / ends.length);
            (viscosity > 0.0).then(|| AxialDamper::new(axis.to_array(), shape, viscosity))
        });
        let radial = radial_dampers(points, volume * volume_viscosity, *form);
        Self { springs: springs.collect(), dampers: dampers.chain(radial).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::springs::RadialSprings;
    use super::*;

    #[test]
    fn radial_dampers_are_those_of_the_paper() {
        let corner = |i: usize| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
        // an irregular hexahedron in the order of VTK, moved and moving
        let points = [0, 1, 3, 2, 4, 5, 7, 6].map(|i| {
            let x = corner(i);
            x + 0.1 * DVec3::new(x.y * x.z, 0.5 * x.x, -x.x * x.y)
        });
        let u: [[f64; 3]; 8] =
            std::array::from_fn(|a| [0.02 * a as f64, -0.01, 0.03 * (a % 3) as f64]);
        let v: [[f64; 3]; 8] = std::array::from_fn(|a| [(a * a % 5) as f64, (a % 2) as f64, -1.0]);
        let centre = points.iter().sum::<DVec3>() / 8.0;
        let rest = points.map(|x| x.distance(centre));
        let viscosity = 0.7;
        let damping = 9.0 * viscosity / rest.iter().map(|r| r * r).sum::<f64>();
        let springs = RadialSprings { rest, stiffness: 0.0, damping };
        let x = std::array::from_fn(|a| (points[a] + DVec3::from_array(u[a])).to_array());
        for form in [VolumeForm::Printed, VolumeForm::Balanced] {
            let expected = springs.damping_forces(&x, &v, form);
            let mut sum = [[0.0; 3]; 8];
            for damper in radial_dampers(points, viscosity, form) {
                for (sum, f) in
                    sum.as_flattened_mut().iter_mut().zip(damper.forces(&u, &v).as_flattened())
                {
                    *sum += f;
                }
            }
            let largest = expected.as_flattened().iter().fold(0.0f64, |m, f| m.max(f.abs()));
            for (a, b) in sum.as_flattened().iter().zip(expected.as_flattened()) {
                assert!((a - b).abs() < 1e-13 * largest, "{form:?}: {a} beside {b}");
            }
        }
        let tetrahedron = [0, 1, 2, 4].map(corner);
        assert_eq!(radial_dampers(tetrahedron, viscosity, VolumeForm::Printed).count(), 0);
    }
}
