//! Closed forms for spring constants from the literature, per element and in N/m.
//!
//! Constants are in the order of [`pairs`]. `E2 = E t` (N/m) is the modulus of a sheet; for plane
//! strain `E / (1 - nu^2)` and `nu / (1 - nu)` take the place of `E` and `nu`. All but Delingette's were
//! written down from memory of the literature, not from the original texts, and count as *recalled*
//! ([`ElementMethod::recalled`]): what they reproduce was checked, the wording of their authors was
//! not.
//!
//! | method | element | constant |
//! |---|---|---|
//! | Van Gelder 1998, simple | triangle | `E2 A / L^2` |
//! | Van Gelder 1998, full | triangle | `E2/(1+nu) A/L^2 + E2 nu/(1-nu^2) (a^2+b^2-L^2)/(8A)`, `a`, `b` the other sides |
//! | Van Gelder 1998 | tetrahedron | `E V / L^2` |
//! | Lloyd et al. 2007 | triangle | `sqrt(3)/4 E2` (made for nu = 1/3) |
//! | Lloyd et al. 2007 | quadrilateral | sides `5/16 E2`, diagonals `7/16 E2` (made for squares, nu = 1/3) |
//! | Lloyd et al. 2007 | tetrahedron | `2 sqrt(2)/25 E l`, `l` the edge of the regular tetrahedron of the same volume (made for nu = 1/4) |
//! | Baudet et al. 2007 | rectangle `i x j` | along `i`: `E2 (j^2 (3 nu + 2) - i^2) / (4 i j (1+nu))`, diagonals `E2 (i^2+j^2) / (4 i j (1+nu))` |
//! | Baudet et al. 2007 | cube of edge `a` | edges `a E (4 nu + 1)/(8 (1+nu))`, body diagonals `3 a E/(8 (1+nu))`, face diagonals 0 |
//! | Delingette 2008 | triangle, tetrahedron | `2 L^2 k` of the tensile biquadratic springs, always positive |
//!
//! Baudet's springs have the right Young's modulus, Poisson's ratio and shear modulus only together
//! with lateral forces: [`baudet_rectangle_correction`], [`baudet_cube_correction`], and
//! [`baudet_tension_correction`] for a mesh.

use crate::cells::Cells;
use crate::error::{ElementError, IdentifyError};
use crate::geometry::{ElementGeometry, dot, norm, scale, sub};
use crate::kind::{ElementKind, ElementMethod};
use crate::material::{LinearMaterial, Section};
use crate::springs::{directions, pairs};

/// Deviation from a rectangle or cube, relative to the diagonal, that is put down to the digits of a
/// mesh file.
const RECTANGULAR: f64 = 1e-5;

/// What the closed forms need to know of an element.
struct Element<'a> {
    geometry: &'a ElementGeometry,
    /// rest lengths, m
    lengths: Vec<f64>,
    /// rest area, m^2, or volume, m^3
    measure: f64,
    /// `E t` of the equivalent sheet (N/m), or `E` (Pa) of a solid
    modulus: f64,
    nu: f64,
    material: &'a LinearMaterial,
}

/// Constants (N/m) of a closed form, or `None` if it has none for this kind of element.
pub(crate) fn constants(
    method: ElementMethod,
    geometry: &ElementGeometry,
    material: &LinearMaterial,
    section: &Section,
) -> Result<Option<Vec<f64>>, ElementError> {
    let plane = geometry.kind().dimension() == 2;
    let (modulus, nu) = if plane {
        section.check()?;
        material.moduli(Some(section.plane))?;
        let (e, nu) = material.in_plane(section.plane);
        (e * section.thickness, nu)
    } else {
        material.moduli(None)?;
        (material.youngs_modulus, material.poissons_ratio)
    };
    let lengths = directions(geometry).into_iter().map(|d| d.0).collect();
    let element = Element { geometry, lengths, measure: geometry.measure(), modulus, nu, material };
    Ok(Some(match (method, geometry.kind()) {
        (ElementMethod::VanGelder, ElementKind::Triangle | ElementKind::Tetrahedron) => {
            element.van_gelder()
        }
        (ElementMethod::VanGelderFull, ElementKind::Triangle) => element.van_gelder_full(),
        (ElementMethod::Lloyd, ElementKind::Triangle) => vec![3f64.sqrt() / 4.0 * modulus; 3],
        (ElementMethod::Lloyd, ElementKind::Quad) => {
            let (side, diagonal) = (5.0 / 16.0 * modulus, 7.0 / 16.0 * modulus);
            vec![side, diagonal, side, side, diagonal, side]
        }
        (ElementMethod::Lloyd, ElementKind::Tetrahedron) => element.lloyd_tetrahedron(),
        (ElementMethod::Baudet, ElementKind::Quad) => element.baudet_rectangle()?,
        (ElementMethod::Baudet, ElementKind::Hexahedron) => element.baudet_cube()?,
        (ElementMethod::Delingette, ElementKind::Triangle) => element.delingette_triangle(),
        (ElementMethod::Delingette, ElementKind::Tetrahedron) => {
            element.delingette_tetrahedron()?
        }
        _ => return Ok(None),
    }))
}

impl Element<'_> {
    fn van_gelder(&self) -> Vec<f64> {
        self.lengths.iter().map(|l| self.modulus * self.measure / (l * l)).collect()
    }

    fn van_gelder_full(&self) -> Vec<f64> {
        let (e, nu, area) = (self.modulus, self.nu, self.measure);
        let all: f64 = self.lengths.iter().map(|l| l * l).sum();
        self.lengths
            .iter()
            .map(|l| {
                let square = l * l;
                e / (1.0 + nu) * area / square
                    + e * nu / (1.0 - nu * nu) * (all - 2.0 * square) / (8.0 * area)
            })
            .collect()
    }

    fn lloyd_tetrahedron(&self) -> Vec<f64> {
        let edge = libm::cbrt(6.0 * 2f64.sqrt() * self.measure);
        vec![2.0 * 2f64.sqrt() / 25.0 * self.modulus * edge; 6]
    }

    fn baudet_rectangle(&self) -> Result<Vec<f64>, ElementError> {
        // pairs: 01 02 03 12 13 23
        let l = &self.lengths;
        let (i, j) = (0.5 * (l[0] + l[5]), 0.5 * (l[2] + l[3]));
        let diagonal = libm::hypot(i, j);
        self.check_ideal("rectangle", &[i, diagonal, j, j, diagonal, i], diagonal)?;
        let common = self.modulus / (4.0 * i * j * (1.0 + self.nu));
        let along_i = common * (j * j * (3.0 * self.nu + 2.0) - i * i);
        let along_j = common * (i * i * (3.0 * self.nu + 2.0) - j * j);
        let across = common * diagonal * diagonal;
        Ok(vec![along_i, across, along_j, along_j, across, along_i])
    }

    fn baudet_cube(&self) -> Result<Vec<f64>, ElementError> {
        // 1: edge, 2: diagonal of a face, 3: diagonal of the body
        let reference = ElementKind::Hexahedron.reference_nodes();
        let order: Vec<usize> = pairs(8)
            .map(|(a, b)| (0..3).filter(|&d| reference[a][d] != reference[b][d]).count())
            .collect();
        let edges = order.iter().zip(&self.lengths).filter(|(o, _)| **o == 1);
        let a = edges.map(|(_, l)| l).sum::<f64>() / 12.0;
        let ideal: Vec<f64> = order.iter().map(|&o| a * (o as f64).sqrt()).collect();
        self.check_ideal("cube", &ideal, a * 3f64.sqrt())?;
        let common = a * self.modulus / (8.0 * (1.0 + self.nu));
        let by_order = [0.0, common * (4.0 * self.nu + 1.0), 0.0, 3.0 * common];
        Ok(order.iter().map(|&o| by_order[o]).collect())
    }

    fn check_ideal(
        &self,
        shape: &'static str,
        ideal: &[f64],
        diagonal: f64,
    ) -> Result<(), ElementError> {
        let off = self.lengths.iter().zip(ideal).map(|(l, i)| (l - i).abs()).fold(0.0, f64::max);
        let off = off.max(self.geometry.off_plane()) / diagonal;
        if off <= RECTANGULAR {
            return Ok(());
        }
        Err(ElementError::NotRectangular {
            shape,
            kind: self.geometry.kind(),
            off_percent: 100.0 * off,
        })
    }

    /// `k_i = (2 cot_i^2 (lambda2 + mu2) + mu2) / (16 A)`, where `mu2 = E2/(1+nu)` is twice the shear
    /// modulus.
    fn delingette_triangle(&self) -> Vec<f64> {
        let lambda = self.modulus * self.nu / (1.0 - self.nu * self.nu);
        let mu = self.modulus / (1.0 + self.nu);
        let all: f64 = self.lengths.iter().map(|l| l * l).sum();
        self.lengths
            .iter()
            .map(|l| {
                let square = l * l;
                let cot = (all - 2.0 * square) / (4.0 * self.measure);
                square * (2.0 * cot * cot * (lambda + mu) + mu) / (8.0 * self.measure)
            })
            .collect()
    }

    /// `k_ij = V/2 ((lambda + mu) (D_i . D_j)^2 + mu |D_i|^2 |D_j|^2)` with the shape vectors `D`.
    fn delingette_tetrahedron(&self) -> Result<Vec<f64>, ElementError> {
        let moduli = self.material.moduli(None)?;
        let (d, _) = self.geometry.gradients([0.25; 3]);
        Ok(pairs(4)
            .zip(&self.lengths)
            .map(|((i, j), l)| {
                let product = dot(d[i], d[j]);
                let k = 0.5
                    * self.measure
                    * ((moduli.lambda + moduli.mu) * product * product
                        + moduli.mu * dot(d[i], d[i]) * dot(d[j], d[j]));
                2.0 * l * l * k
            })
            .collect())
    }
}

/// Outward lateral force (N) on every node of a rectangle, `length` (m) along the pull and `height` (m)
/// across, under tension by Baudet's springs: `(length/height) F (1 - 3 nu) / 4` with the total force
/// `force` (N) on a face. In plane stress. It cancels the stress that the springs alone leave across;
/// derived from their stiffness, since the factor printed by the authors could not be confirmed.
///
/// ```
/// use sinew_identify::baselines::baudet_rectangle_correction;
///
/// assert!((baudet_rectangle_correction(2.0, 1.0, 10.0, 0.1) - 2.0 * 10.0 * 0.7 / 4.0).abs() < 1e-15);
/// assert!(baudet_rectangle_correction(1.0, 1.0, 10.0, 1.0 / 3.0).abs() < 1e-15); // springs are exact
/// ```
pub fn baudet_rectangle_correction(length: f64, height: f64, force: f64, nu: f64) -> f64 {
    length / height * force * (1.0 - 3.0 * nu) / 4.0
}

/// Outward lateral force (N), in each of the two directions across, on every node of a cube pulled with
/// the total force `force` (N) on a face: `F (1 - 4 nu) / 8`. See [`baudet_rectangle_correction`].
///
/// ```
/// assert_eq!(sinew_identify::baselines::baudet_cube_correction(8.0, 0.0), 1.0);
/// ```
pub fn baudet_cube_correction(force: f64, nu: f64) -> f64 {
    force * (1.0 - 4.0 * nu) / 8.0
}

/// Lateral forces (N) on every node of a mesh of rectangles or cubes under the uniform tension `stress`
/// (Pa) along `axis` (0, 1 or 2): with them Baudet's springs have the right moduli. In the interior
/// they cancel.
///
/// Elements are to be aligned with `axis`; the correction belongs to a tension test and to no other
/// loading.
///
/// # Errors
/// [`IdentifyError`]; [`ElementError::NotServed`] for other kinds of elements,
/// [`ElementError::NotRectangular`] also for elements that are not aligned with the pull.
///
/// ```
/// use sinew_identify::Section;
/// use sinew_identify::baselines::baudet_tension_correction;
/// use sinew_identify::cells::Cells;
///
/// let points = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let cells = Cells { quads: &[[0, 1, 2, 3]], ..Cells::default() };
/// let forces = baudet_tension_correction(&points, &cells, &Section::default(), 0.0, 0, 8.0)?;
/// assert_eq!(forces, [[0.0, -2.0, 0.0], [0.0, -2.0, 0.0], [0.0, 2.0, 0.0], [0.0, 2.0, 0.0]]);
/// # Ok::<(), sinew_identify::IdentifyError>(())
/// ```
pub fn baudet_tension_correction(
    points: &[[f64; 3]],
    cells: &Cells<'_>,
    section: &Section,
    nu: f64,
    axis: usize,
    stress: f64,
) -> Result<Vec<[f64; 3]>, IdentifyError> {
    let mut forces = vec![[0.0; 3]; points.len()];
    for element in 0..cells.len() {
        let (kind, index, nodes) = cells.element(element);
        let locate = |source| IdentifyError::Element { kind, index, source };
        if !ElementMethod::Baudet.serves(kind) {
            return Err(locate(ElementMethod::Baudet.not_served(kind)));
        }
        let size = cells.geometry(points, element)?.size();
        let at = |a: usize| points[nodes[a] as usize];
        let dimension = kind.dimension();
        // sides from node 0; which of them is the pull, and where along the others each node is
        let sides: Vec<[f64; 3]> =
            [1, 3, 4][..dimension].iter().map(|&a| sub(at(a), at(0))).collect();
        let pull = (0..dimension)
            .max_by(|&a, &b| sides[a][axis].abs().total_cmp(&sides[b][axis].abs()))
            .expect("two or three sides");
        let length = norm(sides[pull]);
        let off = (length - sides[pull][axis].abs()) / size;
        if off > RECTANGULAR {
            let shape =
                if dimension == 2 { "rectangle along the pull" } else { "cube along the pull" };
            return Err(locate(ElementError::NotRectangular {
                shape,
                kind,
                off_percent: 100.0 * off,
            }));
        }
        for lateral in (0..dimension).filter(|&d| d != pull) {
            let height = norm(sides[lateral]);
            let size = if dimension == 2 {
                let force = stress * height * section.thickness;
                baudet_rectangle_correction(length, height, force, nu)
            } else {
                baudet_cube_correction(stress * height * height, nu)
            };
            let outward = scale(sides[lateral], size / height);
            for (node, place) in nodes.iter().zip(kind.reference_nodes()) {
                for d in 0..3 {
                    forces[*node as usize][d] += place[lateral] * outward[d];
                }
            }
        }
    }
    Ok(forces)
}
