//! From a description of axes to entities of the printed form.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::scalar::Scalar;

use super::attachment::{self, Attachment};
use super::columns::AxisSource;
use super::damper::{self, AxialDamper};
use super::description::{AxesDescription, AxesError, AxisFamily, AxisForm, AxisGroup};
use super::element::AXIS_PAIRS;
use super::printed::VolumeForm;
use super::printed_system::{self, Printed, PrintedAxes, PrintedElement, PrintedModuli};
use super::spawn::{hexahedron_rows, spawn_rows, tetrahedron_place, unit};
use crate::frame::part::SolidPart;

/// Checks that every axis in a hexahedron meets two of its faces. In tetrahedra that have a volume it does.
///
/// # Errors
/// The first axis that does not.
pub(crate) fn check_chords(
    axes: &AxesDescription,
    tetrahedra: usize,
    hexahedra: &[[u32; 8]],
    points: &[DVec3],
) -> Result<(), AxesError> {
    for (h, nodes) in hexahedra.iter().enumerate() {
        let points = nodes.map(|v| points[v as usize]);
        let element = tetrahedra + h;
        for family in axes.families.iter().filter(|f| f.share(element) > 0.0) {
            if attachment::hexahedron(points, unit(family, element)).is_none() {
                return Err(AxesError::NoChord { family: family.name.to_string(), element });
            }
        }
    }
    Ok(())
}

/// Spawns the axes of a body in the printed form; [`check_chords`] has passed.
pub(crate) fn spawn_printed<S: Scalar>(
    world: &mut World,
    axes: &AxesDescription,
    part: &SolidPart,
) {
    let groups = axes.pack();
    let SolidPart { layout, rest_of, rest, .. } = part;
    let (mut springs, mut dampers) = (Vec::new(), Vec::new());
    for (row, &original) in layout.tetrahedron_order.iter().enumerate() {
        let place = tetrahedron_place(part, row);
        let points = layout.tetrahedra[row].map(rest_of);
        let made = Made::new(axes, &groups, original as usize, points, rest.tetrahedra[row].volume);
        springs.extend(made.springs.into_iter().map(|springs| (place, springs)));
        dampers.extend(made.dampers.into_iter().map(|damper| (place, damper)));
    }
    spawn_rows::<S, _>(world, springs, &printed_system::IN_TETRAHEDRA);
    spawn_rows::<S, _>(world, dampers, &damper::IN_TETRAHEDRA);
    let (mut springs, mut dampers) = (Vec::new(), Vec::new());
    for (row, &original) in layout.hexahedron_order.iter().enumerate() {
        let place = hexahedron_rows(part, row);
        let points = layout.hexahedra[row].map(rest_of);
        // directions of hexahedra follow those of tetrahedra
        let element = layout.tetrahedra.len() + original as usize;
        let volume = rest.hexahedra[row].total_volume();
        let made = Made::new(axes, &groups, element, points, volume);
        springs.extend(made.springs.into_iter().map(|springs| (place, springs)));
        dampers.extend(made.dampers.into_iter().map(|damper| (place, damper)));
    }
    spawn_rows::<S, _>(world, springs, &printed_system::IN_HEXAHEDRA);
    spawn_rows::<S, _>(world, dampers, &damper::IN_HEXAHEDRA);
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
    springs: Vec<(PrintedAxes<N>, AxisSource)>,
    dampers: Vec<AxialDamper<N>>,
}

impl<const N: usize> Made<N>
where
    Printed: PrintedElement<N>,
{
    fn new(
        axes: &AxesDescription,
        groups: &[AxisGroup],
        element: usize,
        points: [DVec3; N],
        volume: f64,
    ) -> Self {
        let form = match axes.form {
            AxisForm::PrintedBalanced => VolumeForm::Balanced,
            _ => VolumeForm::Printed,
        };
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
                AxisGroup::Fibre(i) => {
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
            let springs = PrintedAxes::new(points, volume, chords, moduli, form);
            (springs, AxisSource::new(axial, springs.axial_weights(share, volume)))
        });
        let dampers = axes.families.iter().filter(|f| f.viscosity > 0.0).filter_map(|family| {
            let (axis, ends) = chord(family);
            let viscosity = volume * family.viscosity * family.share(element);
            let shape = ends.spread().map(|w| w / ends.length);
            (viscosity > 0.0).then(|| AxialDamper::new(axis.to_array(), shape, viscosity))
        });
        let radial = radial_dampers(points, volume * axes.volume_viscosity, form);
        Self { springs: springs.collect(), dampers: dampers.chain(radial).collect() }
    }
}
