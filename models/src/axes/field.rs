//! Fibre fields: a unit vector in every solid element of a mesh, tetrahedra first, then hexahedra, for
//! [`AxisFamily::directions`](super::description::AxisFamily::directions).
//!
//! Where a field comes from: cell data of the mesh ([`from_cell_data`]), a formula ([`from_formula`]), two
//! surfaces ([`Laplace`], the rule-based fibres of heart models), or a generator ([`circular`],
//! [`hemicircular`], [`helicoidal`], [`random`]). A constant field needs none of these: a family takes one
//! direction for all elements. [`across`] finds two more directions, orthogonal to those of a field.

use glam::DVec3;
use sinew_engine::element_kind::ByKind;
use sinew_engine::mesh::{CellData, Mesh};

use super::formula::Formula;
use crate::element::precompute::RestTetrahedron;

/// A direction in every solid element: the tetrahedra in the order of the mesh, then the hexahedra.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FibreField {
    /// Unit vectors.
    pub directions: Vec<DVec3>,
    /// How many were not of unit length and have been made so; only vectors that somebody gave count.
    pub repaired: usize,
}

/// A fibre field that cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FibreError {
    /// The mesh has no such data.
    #[error(
        "the mesh {source_name} has no cell data `{name}_x`, `{name}_y` and `{name}_z` (a VTU array \
         `{name}` of three components gives them); it has: {known:?}"
    )]
    Data {
        /// File or generator of the mesh.
        source_name: String,
        /// Name of the field.
        name: String,
        /// Names that it has.
        known: Vec<String>,
    },
    /// A vector that is no direction.
    #[error(
        "{what}: the vector {value} of element {element} has no direction; it must be finite and not zero"
    )]
    Direction {
        /// Where the field comes from.
        what: String,
        /// Index in the mesh, hexahedra counted after tetrahedra.
        element: usize,
        /// The vector.
        value: DVec3,
    },
    /// A formula that cannot be read.
    #[error("formula of {component} `{text}`: {reason}; use x, y and z (m), numbers and functions")]
    Formula {
        /// `x`, `y` or `z`, or which angle.
        component: &'static str,
        /// The formula.
        text: String,
        /// What is wrong.
        reason: String,
    },
    /// An element without volume, or with vertices that do not exist.
    #[error("element {element} has no usable shape; run the mesh check")]
    Shape {
        /// Index in the mesh, hexahedra counted after tetrahedra.
        element: usize,
    },
    /// Fibres along the direction that their second axis is taken from.
    #[error(
        "the fibre of element {element}, {value}, runs along {what}, so there is no second axis across it on that side; \
         give another direction"
    )]
    Parallel {
        /// What it is parallel to.
        what: String,
        /// Index in the mesh, hexahedra counted after tetrahedra.
        element: usize,
        /// The fibre.
        value: DVec3,
    },
    /// A surface without vertices.
    #[error("the {which} surface has no vertex of the body; name a group of its vertices")]
    Surface {
        /// `inner` or `outer`.
        which: &'static str,
    },
    /// Surfaces that touch.
    #[error("vertex {vertex} belongs to both surfaces, between which the rule runs; separate them")]
    Overlap {
        /// Index in the mesh.
        vertex: u32,
    },
    /// No solution.
    #[error(
        "the Laplace problem was not solved to {tolerance:e} within {iterations} iterations: its residual \
         is {residual:e}; look for elements of bad shape"
    )]
    Unsolved {
        /// Relative residual wanted.
        tolerance: f64,
        /// Iterations made.
        iterations: usize,
        /// Relative residual reached.
        residual: f64,
    },
    /// An axis or angle that cannot be used.
    #[error("{what} is {value}; it must be finite{remedy}")]
    Parameter {
        /// Which one.
        what: &'static str,
        /// Its value.
        value: String,
        /// What else it must be.
        remedy: &'static str,
    },
}

/// Unit vectors from any.
fn normalised(what: &str, vectors: Vec<DVec3>, given: bool) -> Result<FibreField, FibreError> {
    let mut field = FibreField { directions: vectors, repaired: 0 };
    for (element, v) in field.directions.iter_mut().enumerate() {
        let Some(unit) = v.try_normalize() else {
            return Err(FibreError::Direction { what: what.into(), element, value: *v });
        };
        field.repaired += usize::from(given && (v.length() - 1.0).abs() > 1e-6);
        *v = unit;
    }
    Ok(field)
}

fn axis_of(value: DVec3) -> Result<DVec3, FibreError> {
    value.try_normalize().ok_or_else(|| FibreError::Parameter {
        what: "the axis",
        value: value.to_string(),
        remedy: " and not zero",
    })
}

fn barycentres(mesh: &Mesh) -> Result<Vec<DVec3>, FibreError> {
    let of = |(element, vertices): (usize, &[u32])| {
        let points = vertices.iter().map(|&v| mesh.points.get(v as usize));
        let sum = points.sum::<Option<DVec3>>();
        sum.map(|sum| sum / vertices.len() as f64).ok_or(FibreError::Shape { element })
    };
    let tetrahedra = mesh.tetrahedra.iter().map(|t| &t[..]);
    tetrahedra.chain(mesh.hexahedra.iter().map(|h| &h[..])).enumerate().map(of).collect()
}

/// The field that the mesh file keeps with its solid elements as `NAME_x`, `NAME_y` and `NAME_z`; readers of VTU
/// and VTK files split arrays of three components into these.
///
/// # Errors
/// When there are no such data, or a vector is zero or not finite (a file without a value gives NaN).
pub fn from_cell_data(mesh: &Mesh, name: &str) -> Result<FibreField, FibreError> {
    let column = |axis: &str| mesh.data(&format!("{name}_{axis}"));
    let (Some(x), Some(y), Some(z)) = (column("x"), column("y"), column("z")) else {
        let known = mesh.cell_data.iter().map(|d| d.name.clone()).collect();
        let (source_name, name) = (mesh.source.clone(), name.to_string());
        return Err(FibreError::Data { source_name, name, known });
    };
    let join = |x: &[f64], y: &[f64], z: &[f64]| -> Vec<DVec3> {
        x.iter().zip(y).zip(z).map(|((&x, &y), &z)| DVec3::new(x, y, z)).collect()
    };
    let [x, y, z] = [&x.values, &y.values, &z.values];
    let mut vectors = join(&x.tetrahedra, &y.tetrahedra, &z.tetrahedra);
    vectors.extend(join(&x.hexahedra, &y.hexahedra, &z.hexahedra));
    normalised(&format!("cell data `{name}`"), vectors, true)
}

/// Cell data `NAME_x`, `NAME_y`, `NAME_z` of a field on a mesh, for writers of mesh files; faces have none.
pub fn to_cell_data(name: &str, directions: &[DVec3], mesh: &Mesh) -> [CellData; 3] {
    let (tetrahedra, hexahedra) = directions.split_at(mesh.tetrahedra.len().min(directions.len()));
    [("x", 0), ("y", 1), ("z", 2)].map(|(axis, k)| CellData {
        name: format!("{name}_{axis}"),
        integer: false,
        values: ByKind {
            tetrahedra: tetrahedra.iter().map(|d| d[k]).collect(),
            hexahedra: hexahedra.iter().map(|d| d[k]).collect(),
            triangles: vec![f64::NAN; mesh.triangles.len()],
            quads: vec![f64::NAN; mesh.quads.len()],
        },
    })
}

fn parse(component: &'static str, text: &str) -> Result<Formula, FibreError> {
    let error = |reason| FibreError::Formula { component, text: text.into(), reason };
    Formula::parse(text).map_err(error)
}

/// Azimuths and elevations (degrees) by two formulas in `x`, `y` and `z` (m), taken at the barycentres of the
/// elements, for [`from_angles`].
///
/// # Errors
/// When a formula cannot be read.
pub fn angles_by_formula(mesh: &Mesh, formulas: [&str; 2]) -> Result<[Vec<f64>; 2], FibreError> {
    let (azimuth, elevation) = (parse("azimuth", formulas[0])?, parse("elevation", formulas[1])?);
    let centres = barycentres(mesh)?;
    let of = |f: &Formula| centres.iter().map(|x| f.at(x.to_array())).collect();
    Ok([of(&azimuth), of(&elevation)])
}

/// Directions from maps of azimuth and elevation (degrees), as measured fibres of hearts are given (Bourguignon &
/// Cani 2000, figure 7): `cos(e) (cos(a) zero + sin(a) axis x zero) + sin(e) axis`, one angle of each for every
/// solid element. The elevation is taken from the plane across `axis`, towards it; the azimuth in this plane from
/// the part of `zero` in it, counterclockwise seen against `axis`.
///
/// ```
/// # use sinew_engine::mesh::Mesh;
/// # use glam::DVec3;
/// use sinew_models::axes::field::from_angles;
/// let field = from_angles([&[0.0, 90.0, 0.0], &[0.0, 0.0, 90.0]], DVec3::Z, DVec3::X)?;
/// for (found, expected) in field.directions.iter().zip([DVec3::X, DVec3::Y, DVec3::Z]) {
///     assert!((*found - expected).length() < 1e-15);
/// }
/// # Ok::<(), sinew_models::axes::field::FibreError>(())
/// ```
///
/// # Errors
/// When an angle is not finite, `axis` is no direction, or `zero` has no part across it.
pub fn from_angles(
    [azimuth, elevation]: [&[f64]; 2],
    axis: DVec3,
    zero: DVec3,
) -> Result<FibreField, FibreError> {
    let axis = axis_of(axis)?;
    let across = zero.reject_from_normalized(axis);
    let zero = across.try_normalize().filter(|_| across.length() > 1e-9 * zero.length());
    let zero = zero.ok_or(FibreError::Parameter {
        what: "the direction of azimuth 0",
        value: across.to_string(),
        remedy: " and not along the axis",
    })?;
    let side = axis.cross(zero);
    let direction = |(a, e): (&f64, &f64)| {
        let (sin, cos) = libm::sincos(a.to_radians());
        let (up, flat) = libm::sincos(e.to_radians());
        flat * (cos * zero + sin * side) + up * axis
    };
    let vectors = azimuth.iter().zip(elevation).map(direction).collect();
    normalised("azimuth and elevation", vectors, false)
}

/// Three formulas in `x`, `y` and `z` (m), taken at the barycentres of the elements; any length.
///
/// ```
/// # use sinew_engine::mesh::Mesh;
/// # use glam::DVec3;
/// use sinew_models::axes::field::from_formula;
/// let mesh = Mesh {
///     points: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
///     tetrahedra: vec![[0, 1, 2, 3]],
///     ..Mesh::default()
/// };
/// let field = from_formula(&mesh, ["-y", "x", "0"])?;
/// assert!((field.directions[0] - DVec3::new(-0.5_f64.sqrt(), 0.5_f64.sqrt(), 0.0)).length() < 1e-15);
/// # Ok::<(), sinew_models::axes::field::FibreError>(())
/// ```
///
/// # Errors
/// When a formula cannot be read or gives a vector that is zero or not finite.
pub fn from_formula(mesh: &Mesh, formulas: [&str; 3]) -> Result<FibreField, FibreError> {
    let parsed = [parse("x", formulas[0])?, parse("y", formulas[1])?, parse("z", formulas[2])?];
    let at = |centre: DVec3| DVec3::from_array(parsed.each_ref().map(|f| f.at(centre.to_array())));
    let vectors = barycentres(mesh)?.into_iter().map(at).collect();
    normalised("formula", vectors, false)
}

/// Where the second of three orthogonal axes lies; the first is the fibre.
#[derive(Clone, Debug, PartialEq)]
pub enum Second {
    /// The part across the fibre of that of the coordinate axes x, y and z, in this order, which is farthest from the fibre.
    /// It jumps where another one becomes the farthest.
    Coordinate,
    /// The part across the fibre of one direction, of any length.
    Towards(DVec3),
    /// Away from an axis through `centre` (m), for fibres that run round it or along it, in part or wholly; on the axis any
    /// direction across it.
    Away {
        /// A point on the axis (m).
        centre: DVec3,
        /// Direction of the axis.
        axis: DVec3,
    },
    /// The part across the fibre of a direction in every element, such as that [through the wall](Laplace::transmural).
    Each(Vec<DVec3>),
}

/// Sine below which a fibre counts as parallel to a direction.
const PARALLEL: f64 = 1e-6;

/// The second and third axes of the triads whose first axes are `fibres` (unit vectors): the second as [`Second`] says, the
/// third `first x second`. One direction for all elements gives one of either.
///
/// ```
/// use glam::DVec3;
/// use sinew_engine::mesh::Mesh;
/// use sinew_models::axes::field::{Second, across};
///
/// let fibre = DVec3::new(0.6, 0.8, 0.0);
/// let [second, third] = across(&[fibre], &Second::Towards(DVec3::X), &Mesh::default())?;
/// assert!((second[0] - DVec3::new(0.8, -0.6, 0.0)).length() < 1e-15);
/// assert!((third[0] - DVec3::NEG_Z).length() < 1e-15);
/// assert!(across(&[fibre], &Second::Towards(3.0 * fibre), &Mesh::default()).is_err());
/// # Ok::<(), sinew_models::axes::field::FibreError>(())
/// ```
///
/// # Errors
/// [`FibreError::Parallel`] names the first element whose fibre runs along the direction that was to give its second axis.
pub fn across(
    fibres: &[DVec3],
    second: &Second,
    mesh: &Mesh,
) -> Result<[Vec<DVec3>; 2], FibreError> {
    let centres = match second {
        Second::Away { .. } => barycentres(mesh)?,
        _ => Vec::new(),
    };
    let mut result = [Vec::with_capacity(fibres.len()), Vec::with_capacity(fibres.len())];
    for (element, &fibre) in fibres.iter().enumerate() {
        let towards = match second {
            Second::Coordinate => {
                let along = fibre.abs();
                let nearest = along.min_element();
                [DVec3::X, DVec3::Y, DVec3::Z][(0..3).find(|&k| along[k] == nearest).unwrap_or(0)]
            }
            Second::Towards(direction) => *direction,
            Second::Away { centre, axis } => {
                let axis = axis_of(*axis)?;
                round(axis, *centre, centres[element]).cross(axis)
            }
            Second::Each(directions) => directions[element],
        };
        let part = towards.reject_from_normalized(fibre);
        let unit = part.try_normalize().filter(|_| part.length() > PARALLEL * towards.length());
        let unit = unit.ok_or_else(|| FibreError::Parallel {
            what: match second {
                Second::Each(_) => format!("the direction {towards} there"),
                _ => towards.to_string(),
            },
            element,
            value: fibre,
        })?;
        result[0].push(unit);
        result[1].push(fibre.cross(unit));
    }
    Ok(result)
}

/// Unit vector round an axis at a place; on the axis any across it.
fn round(axis: DVec3, centre: DVec3, at: DVec3) -> DVec3 {
    axis.cross(at - centre).try_normalize().unwrap_or(axis.any_orthonormal_vector())
}

/// Directions round an axis through `centre` (m); on the axis, any across it.
///
/// # Errors
/// When the axis is no direction.
pub fn circular(mesh: &Mesh, centre: DVec3, axis: DVec3) -> Result<FibreField, FibreError> {
    helicoidal(mesh, centre, axis, 0.0)
}

/// Half circles (the C shape of Bourguignon & Cani 2000, figure 6): round the axis `axis` through the middle
/// of the side of the mesh's box that `side` points to.
///
/// # Errors
/// When a direction is none, or the mesh has no points.
pub fn hemicircular(mesh: &Mesh, axis: DVec3, side: DVec3) -> Result<FibreField, FibreError> {
    circular(mesh, middle_of_side(mesh, side)?, axis)
}

/// Middle (m) of the side of the mesh's box that a direction points to.
///
/// # Errors
/// When it is no direction, or the mesh has no points.
pub fn middle_of_side(mesh: &Mesh, side: DVec3) -> Result<DVec3, FibreError> {
    let side = axis_of(side)?;
    let Some((low, high)) = mesh.bounds() else { return Err(FibreError::Shape { element: 0 }) };
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    // from the middle to the box along the side
    let reach = half / side.abs();
    Ok(middle + side * reach.min_element())
}

/// Concentric helices round an axis through `centre` (m), rising along it by `pitch` (rad, between the fibre
/// and the plane across the axis).
///
/// # Errors
/// When the axis is no direction or the angle is not finite.
pub fn helicoidal(
    mesh: &Mesh,
    centre: DVec3,
    axis: DVec3,
    pitch: f64,
) -> Result<FibreField, FibreError> {
    let axis = axis_of(axis)?;
    if !(pitch.is_finite() && centre.is_finite()) {
        let value = format!("{pitch} rad about {centre}");
        return Err(FibreError::Parameter { what: "the helix", value, remedy: "" });
    }
    let vectors = barycentres(mesh)?.into_iter();
    let (sin, cos) = libm::sincos(pitch);
    let vectors = vectors.map(|x| round(axis, centre, x) * cos + axis * sin).collect();
    normalised("helix", vectors, false)
}

/// Directions drawn evenly from the sphere; the same for the same seed and number of elements.
pub fn random(mesh: &Mesh, seed: u64) -> FibreField {
    let mut state = seed;
    // splitmix64
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    let directions = (0..mesh.tetrahedra.len() + mesh.hexahedra.len()).map(|_| {
        let (height, turn) = (2.0 * next() - 1.0, std::f64::consts::TAU * next());
        let radius = (1.0 - height * height).max(0.0).sqrt();
        let (sin, cos) = libm::sincos(turn);
        DVec3::new(radius * cos, radius * sin, height)
    });
    FibreField { directions: directions.collect(), repaired: 0 }
}

/// Solution of the Laplace equation in a body, 0 on an inner and 1 on an outer surface: its gradient points
/// through the wall, whatever its shape, and its value says how far.
#[derive(Clone, Debug, PartialEq)]
pub struct Laplace {
    /// Potential of every vertex of the mesh, 0 for those without a solid element.
    pub potential: Vec<f64>,
    /// Mean potential of every element, tetrahedra first, then hexahedra.
    pub depth: Vec<f64>,
    /// Unit vectors from the inner to the outer surface, one per element.
    pub transmural: Vec<DVec3>,
}

/// Tetrahedra into which a hexahedron is cut.
const PARTS: usize = 6;
/// Relative residual to which the Laplace problem is solved.
const TOLERANCE: f64 = 1e-10;
/// Gradient times size of the body below which the potential counts as level, and sine below which
/// directions count as parallel.
const LEVEL: f64 = 1e-6;

impl Laplace {
    /// Solves for a mesh and the vertices of two surfaces. Hexahedra are cut into tetrahedra for this; they
    /// take the mean gradient of theirs.
    ///
    /// # Errors
    /// When a surface is empty, they share a vertex, an element has no shape, or a part of the body hangs
    /// on one of them only (its gradient has no direction).
    pub fn solve(mesh: &Mesh, inner: &[u32], outer: &[u32]) -> Result<Self, FibreError> {
        let (n, whole) = (mesh.points.len(), mesh.tetrahedra.len());
        let split;
        let mesh = if mesh.hexahedra.is_empty() {
            mesh
        } else {
            split = mesh.split_into_simplices();
            &split
        };
        // parts of hexahedra follow the tetrahedra
        let element = |t: usize| if t < whole { t } else { whole + (t - whole) / PARTS };
        let mut shapes = Vec::with_capacity(mesh.tetrahedra.len());
        for (i, t) in mesh.tetrahedra.iter().enumerate() {
            let error = FibreError::Shape { element: element(i) };
            if t.iter().any(|&v| v as usize >= n) {
                return Err(error);
            }
            let rest = RestTetrahedron::new(t.map(|v| mesh.points[v as usize].to_array()));
            shapes.push(rest.map_err(|_| error)?);
        }
        let mut used = vec![false; n];
        mesh.tetrahedra.iter().flatten().for_each(|&v| used[v as usize] = true);
        let mut held = vec![false; n];
        let mut x = vec![0.0; n];
        for (which, surface, value) in [("inner", inner, 0.0), ("outer", outer, 1.0)] {
            let own = surface.iter().filter(|&&v| used.get(v as usize) == Some(&true));
            let mut count = 0;
            for &v in own {
                if held[v as usize] && x[v as usize] != value {
                    return Err(FibreError::Overlap { vertex: v });
                }
                (held[v as usize], x[v as usize]) = (true, value);
                count += 1;
            }
            if count == 0 {
                return Err(FibreError::Surface { which });
            }
        }
        solve_laplace(mesh, &shapes, &held, &mut x)?;
        let size = mesh.bounds().map_or(0.0, |(low, high)| low.distance(high));
        let count = mesh.tetrahedra.len().checked_sub(1).map_or(0, |last| element(last) + 1);
        let (mut depth, mut vectors) = (vec![0.0; count], vec![DVec3::ZERO; count]);
        let mut volume = vec![0.0; count];
        for (i, (t, shape)) in mesh.tetrahedra.iter().zip(&shapes).enumerate() {
            let (e, weight) = (element(i), shape.volume);
            let values = t.map(|v| x[v as usize]);
            volume[e] += weight;
            depth[e] += weight * values.iter().sum::<f64>() / 4.0;
            for (value, d) in values.iter().zip(shape.gradients) {
                vectors[e] += weight * *value * DVec3::from_array(d);
            }
        }
        for ((depth, gradient), volume) in depth.iter_mut().zip(&mut vectors).zip(&volume) {
            *depth /= volume;
            *gradient /= *volume;
            // a part that hangs on one surface is level, but for what the solution leaves
            if gradient.length() * size < LEVEL {
                *gradient = DVec3::ZERO;
            }
        }
        let transmural = normalised("Laplace rule", vectors, false)?.directions;
        Ok(Self { potential: x, depth, transmural })
    }

    /// The direction through the wall as a field.
    pub fn through(&self) -> FibreField {
        FibreField { directions: self.transmural.clone(), repaired: 0 }
    }

    /// Fibres in the wall whose helix angle runs linearly from `inner` to `outer` (rad): 0 is round the axis
    /// `axis`, a quarter turn along it.
    ///
    /// # Errors
    /// When the axis is no direction, an angle is not finite, or the wall is square to the axis somewhere.
    pub fn helix(&self, axis: DVec3, inner: f64, outer: f64) -> Result<FibreField, FibreError> {
        let axis = axis_of(axis)?;
        let mut vectors = Vec::with_capacity(self.depth.len());
        for (&through, &depth) in self.transmural.iter().zip(&self.depth) {
            let round = axis.cross(through);
            // both are unit vectors: what is left of parallel ones is rounding
            let round = if round.length() > LEVEL { round.normalize() } else { DVec3::ZERO };
            let along = through.cross(round);
            let (sin, cos) = libm::sincos(inner + (outer - inner) * depth);
            vectors.push(round * cos + along * sin);
        }
        normalised("helix rule", vectors, false)
    }
}

/// `K x = 0` with the held entries of `x` kept, by conjugate gradients with the diagonal.
fn solve_laplace(
    mesh: &Mesh,
    shapes: &[RestTetrahedron],
    held: &[bool],
    x: &mut [f64],
) -> Result<(), FibreError> {
    let n = x.len();
    let multiply = |x: &[f64]| {
        let mut y = vec![0.0; n];
        for (t, shape) in mesh.tetrahedra.iter().zip(shapes) {
            let mut flux = DVec3::ZERO;
            for (&v, d) in t.iter().zip(shape.gradients) {
                flux += x[v as usize] * DVec3::from_array(d);
            }
            for (&v, d) in t.iter().zip(shape.gradients) {
                y[v as usize] += shape.volume * flux.dot(DVec3::from_array(d));
            }
        }
        for (y, &held) in y.iter_mut().zip(held) {
            *y = if held { 0.0 } else { *y };
        }
        y
    };
    let mut diagonal = vec![0.0; n];
    for (t, shape) in mesh.tetrahedra.iter().zip(shapes) {
        for (&v, d) in t.iter().zip(shape.gradients) {
            diagonal[v as usize] += shape.volume * DVec3::from_array(d).length_squared();
        }
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let precondition = |r: &[f64]| -> Vec<f64> {
        r.iter().zip(&diagonal).map(|(r, d)| if *d > 0.0 { r / d } else { 0.0 }).collect()
    };
    let mut r: Vec<f64> = multiply(x).into_iter().map(|y| -y).collect();
    let start = dot(&r, &precondition(&r));
    if start == 0.0 {
        return Ok(());
    }
    let mut z = precondition(&r);
    let mut p = z.clone();
    let mut rz = start;
    let limit = 10 * n + 100;
    for _ in 0..limit {
        let q = multiply(&p);
        let step = rz / dot(&p, &q);
        for i in 0..n {
            x[i] += step * p[i];
            r[i] -= step * q[i];
        }
        z = precondition(&r);
        let new = dot(&r, &z);
        if new <= TOLERANCE * TOLERANCE * start {
            return Ok(());
        }
        let keep = new / rz;
        for (p, z) in p.iter_mut().zip(&z) {
            *p = z + keep * *p;
        }
        rz = new;
    }
    let residual = (rz / start).sqrt();
    Err(FibreError::Unsolved { tolerance: TOLERANCE, iterations: limit, residual })
}
