//! What axes a body has, as the user states it, and how they are packed into tables.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt;

use super::muscle::{MuscleError, MuscleSettings};
use crate::material::LameParameters;

/// What the springs along fibres measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FibreForm {
    /// The stretch `l = |F a|`: energy density `Y/2 (l - 1)^2`.
    #[default]
    Stretch,
    /// The Green-Lagrange strain along the fibre: energy density `Y/2 (a.E a)^2`, `a.E a = (l^2 - 1)/2`. The fibres of
    /// St Venant-Kirchhoff: in pooled tetrahedra they only add to the constants of the springs
    /// ([`SpringConstants::add_fibre`](crate::element::precompute::SpringConstants::add_fibre)). They soften in
    /// compression, and give way below a stretch of 0.58.
    Biquadratic,
}

impl FibreForm {
    /// Name in scene files and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stretch => "stretch",
            Self::Biquadratic => "biquadratic",
        }
    }
}

/// Axes of one kind: a direction in every solid element and a modulus along it; or in every triangle of a membrane
/// ([`MembraneDescription::fibres`](crate::body::sheet::MembraneDescription::fibres)).
#[derive(Clone, Debug, PartialEq)]
pub struct AxisFamily<'a> {
    /// Name, unique among the families of the body.
    pub name: Cow<'a, str>,
    /// Directions at rest in the order of the user's tetrahedra, then hexahedra, or one for all of them. Other lengths
    /// than 1 are repaired and counted ([`BodyAxes::repaired`]).
    pub directions: Cow<'a, [DVec3]>,
    /// Modulus along the axis (Pa): stress per stretch, over the rest area.
    pub modulus: f64,
    /// What it measures.
    pub form: FibreForm,
    /// Viscosity along the axis (Pa s): stress per rate of stretch ([`damper`](super::damper)), 0 without
    /// damping.
    pub viscosity: f64,
    /// Factor on modulus, viscosity and muscle tension in every solid element, 1 without; where it is 0 the direction
    /// may be anything.
    pub share: Option<Cow<'a, [f64]>>,
    /// Makes the fibres active.
    pub muscle: Option<MuscleSettings>,
}

impl<'a> AxisFamily<'a> {
    /// A passive family.
    pub fn new(name: &'a str, directions: &'a [DVec3], modulus: f64) -> Self {
        Self {
            name: Cow::Borrowed(name),
            directions: Cow::Borrowed(directions),
            modulus,
            form: FibreForm::default(),
            viscosity: 0.0,
            share: None,
            muscle: None,
        }
    }

    /// Direction in an element, not normalised.
    pub fn direction(&self, element: usize) -> DVec3 {
        match self.directions.len() {
            1 => self.directions[0],
            _ => self.directions[element],
        }
    }

    /// Share of an element.
    pub fn share(&self, element: usize) -> f64 {
        self.share.as_ref().map_or(1.0, |share| share[element])
    }

    /// The family in some elements, which are numbered anew in this order.
    pub(crate) fn of_elements(&self, elements: &[usize]) -> AxisFamily<'static> {
        let mut own = self.clone().into_owned();
        if own.directions.len() > 1 {
            own.directions = elements.iter().map(|&e| self.directions[e]).collect();
        }
        own.share = self.share.as_ref().map(|share| elements.iter().map(|&e| share[e]).collect());
        own
    }

    /// Checks everything for a body of so many elements.
    fn validate(&self, count: usize) -> Result<(), AxesError> {
        let name = || self.name.to_string();
        check_modulus(ModulusOf::Family(name()), self.modulus)?;
        let value = self.viscosity;
        if !(value >= 0.0 && value.is_finite()) {
            return Err(AxesError::Viscosity { family: name(), value });
        }
        let found = self.directions.len();
        if found != 1 && found != count {
            return Err(AxesError::Length { family: name(), what: "directions", found, count });
        }
        if let Some(share) = &self.share {
            let found = share.len();
            if found != count {
                return Err(AxesError::Length { family: name(), what: "shares", found, count });
            }
            if let Some(element) = share.iter().position(|x| !(*x >= 0.0 && x.is_finite())) {
                let value = share[element];
                return Err(AxesError::Share { family: name(), element, value });
            }
        }
        for element in 0..if found == 1 { 1 } else { count } {
            let value = self.direction(element);
            let unused = found > 1 && self.share(element) == 0.0;
            if !unused && value.try_normalize().is_none() {
                return Err(AxesError::Direction { family: name(), element, value });
            }
        }
        let Some(muscle) = &self.muscle else { return Ok(()) };
        if self.form == FibreForm::Biquadratic {
            return Err(AxesError::ActiveForm { family: name() });
        }
        muscle.validate().map_err(|source| AxesError::Muscle { family: name(), source })
    }

    pub(crate) fn into_owned(self) -> AxisFamily<'static> {
        AxisFamily {
            name: Cow::Owned(self.name.into_owned()),
            directions: Cow::Owned(self.directions.into_owned()),
            modulus: self.modulus,
            form: self.form,
            viscosity: self.viscosity,
            share: self.share.map(|s| Cow::Owned(s.into_owned())),
            muscle: self.muscle,
        }
    }
}

/// A spring on the angle between the axes of two families.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisAngle {
    /// Indices of the two families.
    pub families: [usize; 2],
    /// Modulus (Pa): energy density `G/2 (cos - cos_rest)^2`. It is the shear modulus in the plane of
    /// orthogonal axes.
    pub modulus: f64,
}

/// Axes of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AxesDescription<'a> {
    /// Any number of directions per element.
    pub families: Vec<AxisFamily<'a>>,
    /// Angles between them that are springs.
    pub angles: Vec<AxisAngle>,
    /// Modulus `Lambda` of the term of volume `Lambda/2 (J-1)^2` (Pa), 0 without it.
    pub volume_modulus: f64,
}

/// Coordinate directions of [`AxesDescription::isotropic`].
const COORDINATES: [[DVec3; 1]; 3] = [[DVec3::X], [DVec3::Y], [DVec3::Z]];

/// Axes (unit vectors) and moduli (Pa) of the biquadratic fibres of some families in an element.
pub(crate) fn biquadratic<'a>(
    families: &'a [AxisFamily<'a>],
    element: usize,
) -> impl Iterator<Item = (DVec3, f64)> + 'a {
    let own =
        families.iter().filter(move |f| f.form == FibreForm::Biquadratic && f.share(element) > 0.0);
    own.map(move |f| (super::spawn::unit(f, element), f.modulus * f.share(element)))
}

fn check_modulus(of: ModulusOf, value: f64) -> Result<(), AxesError> {
    match value >= 0.0 && value.is_finite() {
        true => Ok(()),
        false => Err(AxesError::Modulus { of, value }),
    }
}

/// Checks families for a body of so many elements.
fn validate_families(families: &[AxisFamily], count: usize) -> Result<(), AxesError> {
    families.iter().enumerate().try_for_each(|(i, family)| {
        match families[..i].iter().any(|other| other.name == family.name) {
            true => Err(AxesError::Duplicate { family: family.name.to_string() }),
            false => family.validate(count),
        }
    })
}

/// Checks the fibres of a membrane of so many triangles beside those of a solid.
pub(crate) fn validate_sheet(
    families: &[AxisFamily],
    solid: &[AxisFamily],
    count: usize,
) -> Result<(), AxesError> {
    validate_families(families, count)?;
    for family in families {
        let name = || family.name.to_string();
        if solid.iter().any(|other| other.name == family.name) {
            return Err(AxesError::Duplicate { family: name() });
        }
        if family.form != FibreForm::Biquadratic {
            return Err(AxesError::SheetForm { family: name() });
        }
        if family.viscosity != 0.0 {
            return Err(AxesError::SheetViscosity { family: name() });
        }
    }
    Ok(())
}

impl AxesDescription<'_> {
    /// Whether some of its fibres are biquadratic.
    pub fn has_biquadratic(&self) -> bool {
        self.families.iter().any(|f| f.form == FibreForm::Biquadratic)
    }

    /// Axes along x, y and z that amount to an isotropic material at small strain: `Y = 2 mu`, `G = mu`,
    /// `Lambda = lambda`.
    pub fn isotropic(material: LameParameters) -> AxesDescription<'static> {
        let family = |name, i: usize| AxisFamily::new(name, &COORDINATES[i], 2.0 * material.mu);
        let angle = |families| AxisAngle { families, modulus: material.mu };
        AxesDescription {
            families: vec![family("x", 0), family("y", 1), family("z", 2)],
            angles: vec![angle([0, 1]), angle([0, 2]), angle([1, 2])],
            volume_modulus: material.lambda,
        }
    }

    /// The same with data of its own.
    pub fn into_owned(self) -> AxesDescription<'static> {
        AxesDescription {
            families: self.families.into_iter().map(AxisFamily::into_owned).collect(),
            angles: self.angles,
            volume_modulus: self.volume_modulus,
        }
    }

    /// The axes of some elements, which are numbered anew in this order.
    pub(crate) fn of_elements(&self, elements: &[usize]) -> AxesDescription<'static> {
        AxesDescription {
            families: self.families.iter().map(|family| family.of_elements(elements)).collect(),
            ..self.clone().into_owned()
        }
    }

    /// Checks everything for a body of so many tetrahedra and hexahedra, which lists hold in this order.
    ///
    /// # Errors
    /// The first thing that cannot be used.
    pub fn validate(&self, tetrahedra: usize, hexahedra: usize) -> Result<(), AxesError> {
        let count = tetrahedra + hexahedra;
        if count == 0 {
            return Err(AxesError::NoElements);
        }
        if self.families.is_empty() && self.volume_modulus == 0.0 {
            return Err(AxesError::Nothing);
        }
        check_modulus(ModulusOf::Volume, self.volume_modulus)?;
        validate_families(&self.families, count)?;
        for (index, angle) in self.angles.iter().enumerate() {
            let families @ [i, j] = angle.families;
            if i == j || i.max(j) >= self.families.len() {
                let count = self.families.len();
                return Err(AxesError::Angle { families, count });
            }
            check_modulus(ModulusOf::Angle { index, families }, angle.modulus)?;
        }
        Ok(())
    }

    /// How many directions of each family are not of unit length (by more than rounding).
    pub(crate) fn count_repairs(&self) -> Vec<usize> {
        let off = |a: &&DVec3| (a.length() - 1.0).abs() > 1e-6 && a.try_normalize().is_some();
        self.families.iter().map(|f| f.directions.iter().filter(off).count()).collect()
    }

    /// Packs families and angles into what one entity holds. Angles are covered by triads as long as
    /// there are any; a passive family goes with the first triad that has it, others are single fibres. Biquadratic
    /// families are always single.
    pub fn pack(&self) -> Vec<AxisGroup> {
        let mut left: Vec<([usize; 2], f64)> = Vec::new();
        for AxisAngle { families: [i, j], modulus } in self.angles.iter().copied() {
            let pair = [i.min(j), i.max(j)];
            match left.iter_mut().find(|(known, _)| *known == pair) {
                Some((_, sum)) => *sum += modulus,
                None => left.push((pair, modulus)),
            }
        }
        let mut groups = Vec::new();
        let single = |f: &AxisFamily| f.muscle.is_some() || f.form == FibreForm::Biquadratic;
        let mut placed: Vec<bool> = self.families.iter().map(single).collect();
        let mut volume = self.volume_modulus;
        while let Some(&([i, j], _)) = left.first() {
            let pairs = |k: usize| [[i.min(k), i.max(k)], [j.min(k), j.max(k)]];
            let known = |pair: &[usize; 2]| left.iter().any(|(p, _)| p == pair);
            let others = (0..self.families.len()).filter(|&k| k != i && k != j);
            // as many angles as possible, then as many new axes, then the first
            let third = others.max_by_key(|&k| {
                let covered = pairs(k).iter().filter(|p| known(p)).count();
                (covered, !placed[k], std::cmp::Reverse(k))
            });
            let axes = [Some(i), Some(j), third];
            let mut angles = [0.0; 3];
            for (angle, [a, b]) in angles.iter_mut().zip(super::element::AXIS_PAIRS) {
                let (Some(a), Some(b)) = (axes[a], axes[b]) else { continue };
                let pair = [a.min(b), a.max(b)];
                if let Some(at) = left.iter().position(|(p, _)| *p == pair) {
                    *angle = left.remove(at).1;
                }
            }
            let axial =
                axes.map(|axis| axis.filter(|&axis| !std::mem::replace(&mut placed[axis], true)));
            groups.push(AxisGroup::Triad { axes, axial, angles, volume });
            volume = 0.0;
        }
        for (i, family) in self.families.iter().enumerate() {
            match family.form {
                FibreForm::Biquadratic => groups.push(AxisGroup::Biquadratic(i)),
                FibreForm::Stretch if !placed[i] || single(family) => {
                    groups.push(AxisGroup::Fibre(i));
                }
                FibreForm::Stretch => {}
            }
        }
        if volume > 0.0 {
            groups.push(AxisGroup::Volume(volume));
        }
        groups
    }
}

/// What one axis entity of an element holds.
#[derive(Clone, Debug, PartialEq)]
pub enum AxisGroup {
    /// Three axes.
    Triad {
        /// Their families; `None`: any direction.
        axes: [Option<usize>; 3],
        /// Families of the springs along them.
        axial: [Option<usize>; 3],
        /// Moduli of their angles (Pa).
        angles: [f64; 3],
        /// Modulus of volume (Pa).
        volume: f64,
    },
    /// A family that measures its stretch.
    Fibre(usize),
    /// A family that measures its strain.
    Biquadratic(usize),
    /// Modulus of volume (Pa).
    Volume(f64),
}

/// Axes that a body was spawned with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyAxes {
    /// What the user gave.
    pub description: AxesDescription<'static>,
    /// How many directions of each family were not of unit length and have been made so.
    pub repaired: Vec<usize>,
}

/// What has a modulus.
#[derive(Clone, Debug, PartialEq)]
pub enum ModulusOf {
    /// The term of volume.
    Volume,
    /// The family of that name.
    Family(String),
    /// An angle.
    Angle {
        /// Place among [`AxesDescription::angles`].
        index: usize,
        /// Its families.
        families: [usize; 2],
    },
}

impl fmt::Display for ModulusOf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Volume => f.write_str("the term of volume"),
            Self::Family(name) => write!(f, "family `{name}`"),
            Self::Angle { families: [i, j], .. } => write!(f, "the angle of families {i} and {j}"),
        }
    }
}

/// Axes that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AxesError {
    /// A body without solid elements.
    #[error(
        "axes lie in tetrahedra and hexahedra, and the body has none; leave them out or fill the body"
    )]
    NoElements,
    /// Neither families nor a term of volume.
    #[error("there is no axis and no volume modulus; give a family, or leave the axes out")]
    Nothing,
    /// A body of axes alone without axes.
    #[error("model \"axes\" needs a description of axes; give one or choose another model")]
    Missing,
    /// Two families of a name.
    #[error("there are two families `{family}`; names must be unique")]
    Duplicate {
        /// Name of the family.
        family: String,
    },
    /// A modulus out of range.
    #[error("modulus of {of} is {value} Pa; it must be finite and not negative")]
    Modulus {
        /// What has it.
        of: ModulusOf,
        /// The modulus (Pa).
        value: f64,
    },
    /// No such family.
    #[error("the body has no family of axes `{family}`; it has {known:?}")]
    Unknown {
        /// Name that was asked for.
        family: String,
        /// Names that there are.
        known: Vec<String>,
    },
    /// A viscosity out of range.
    #[error("viscosity of family `{family}` is {value} Pa s; it must be finite and not negative")]
    Viscosity {
        /// Name of the family.
        family: String,
        /// The viscosity (Pa s).
        value: f64,
    },
    /// A list of another length than the mesh.
    #[error("family `{family}` has {found} {what} for {count} solid elements; give one for each")]
    Length {
        /// Name of the family.
        family: String,
        /// What the list holds.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Number of solid elements.
        count: usize,
    },
    /// A direction that is none.
    #[error(
        "family `{family}`, element {element}: {value} is no direction; give a finite vector \
         that is not zero, or set the share of the family to 0 there"
    )]
    Direction {
        /// Name of the family.
        family: String,
        /// Index in the user's mesh, hexahedra counted after tetrahedra.
        element: usize,
        /// The direction.
        value: DVec3,
    },
    /// A share out of range.
    #[error(
        "family `{family}`, element {element}: share is {value}; it must be finite and not \
         negative"
    )]
    Share {
        /// Name of the family.
        family: String,
        /// Index in the user's mesh, hexahedra counted after tetrahedra.
        element: usize,
        /// The share.
        value: f64,
    },
    /// An angle between families that do not exist or are the same.
    #[error("an angle is between families {families:?} of {count}; it needs two different ones")]
    Angle {
        /// The families.
        families: [usize; 2],
        /// Number of families.
        count: usize,
    },
    /// Active fibres of a form that has no activation.
    #[error(
        "family `{family}` is active and of the form \"biquadratic\", which has no stretch to act on: take the form \
         \"stretch\", or leave the muscle out"
    )]
    ActiveForm {
        /// Name of the family.
        family: String,
    },
    /// Fibres of a membrane that measure stretch.
    #[error(
        "family `{family}` lies in a membrane, whose fibres are biquadratic; give it the form \"biquadratic\""
    )]
    SheetForm {
        /// Name of the family.
        family: String,
    },
    /// Viscous fibres of a membrane.
    #[error("family `{family}` lies in a membrane and is viscous; leave its viscosity out")]
    SheetViscosity {
        /// Name of the family.
        family: String,
    },
    /// Fibres of a membrane of quadrilaterals.
    #[error("fibres of a membrane lie in triangles; cut the quadrilaterals into triangles")]
    SheetQuads,
    /// Fibres across a membrane.
    #[error(
        "family `{family}`: the direction {value} stands square to triangle {element}; give one with a part in its plane, or \
         a share of 0"
    )]
    Across {
        /// Name of the family.
        family: String,
        /// Index in the user's list.
        element: usize,
        /// The direction.
        value: DVec3,
    },
    /// A muscle that cannot be used.
    #[error("muscle of family `{family}`: {source}")]
    Muscle {
        /// Name of the family.
        family: String,
        /// What is wrong.
        source: MuscleError,
    },
}
