//! Which elements to remove: lists, places in space, and the strain and stress of elements.

use bevy_ecs::prelude::*;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use sinew_engine::connectivity::ElementKind;
use sinew_engine::element::{displacement_gradient, volume_change};
use sinew_engine::scalar::{Scalar, sub};
use sinew_engine::topology::Topology;

use super::report::RemovalError;
use super::state::{Point, Queries, State};
use crate::body::description::SoftBody;
use crate::body::matter::Chosen;
use crate::body::present::BodyResection;
use crate::element::membrane;
use crate::element::tetrahedron::{Element, green_strain, second_piola_kirchhoff};

/// Which elements of a body to remove: all but the lists take elements of every kind alike.
/// Positions are those at the present state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Region {
    /// Tetrahedra by their indices in the user's mesh.
    Tetrahedra(Vec<u32>),
    /// Membrane triangles by their indices in the user's list.
    Triangles(Vec<u32>),
    /// Hexahedra by their indices in the user's mesh.
    Hexahedra(Vec<u32>),
    /// Membrane quadrilaterals by their indices in the user's list.
    Quads(Vec<u32>),
    /// All that are left.
    Everything,
    /// Those whose barycentre lies within a sphere.
    Sphere {
        /// Centre (m).
        centre: DVec3,
        /// Radius (m).
        radius: f64,
    },
    /// Those whose barycentre lies within a sphere that is swept along a segment, such as a tool from
    /// its last position to the present one. The volume removed is then that swept, on average; a tool
    /// thinner than the elements misses some.
    Capsule {
        /// Start of the segment (m).
        from: DVec3,
        /// End of the segment (m).
        to: DVec3,
        /// Radius (m).
        radius: f64,
    },
    /// Those whose largest principal Green strain is above a limit, at some Gauss point if there are
    /// several.
    Strain {
        /// The limit (-).
        above: f64,
    },
    /// Those whose von Mises equivalent of the Cauchy stress is above a limit. The stress is that of
    /// St Venant-Kirchhoff with the moduli of the element (of plane stress in a membrane, over its
    /// deformed thickness at constant volume), whatever the model; compression terms play no part.
    Stress {
        /// The limit (Pa).
        above: f64,
    },
}

impl Region {
    /// The elements that it lists, if it does so.
    fn list(&self) -> Option<(ElementKind, &[u32])> {
        Some(match self {
            Self::Tetrahedra(list) => (ElementKind::Tetrahedron, list),
            Self::Triangles(list) => (ElementKind::Triangle, list),
            Self::Hexahedra(list) => (ElementKind::Hexahedron, list),
            Self::Quads(list) => (ElementKind::Quad, list),
            _ => return None,
        })
    }

    fn check(&self) -> Result<(), RemovalError> {
        let point = |quantity, value: DVec3| match value.is_finite() {
            true => Ok(()),
            false => {
                Err(RemovalError::Region { quantity, value: value.to_string(), range: "finite" })
            }
        };
        let positive = |quantity, value: f64| match value > 0.0 && value.is_finite() {
            true => Ok(()),
            false => Err(RemovalError::Region {
                quantity,
                value: value.to_string(),
                range: "positive and finite",
            }),
        };
        match self {
            Region::Sphere { centre, radius } => {
                point("centre", *centre).and_then(|()| positive("radius", *radius))
            }
            Region::Capsule { from, to, radius } => point("from", *from)
                .and_then(|()| point("to", *to))
                .and_then(|()| positive("radius", *radius)),
            Region::Strain { above } | Region::Stress { above } => positive("limit", *above),
            _ => Ok(()),
        }
    }

    /// Whether a sphere, capsule or everything holds a point.
    fn holds(&self, x: DVec3) -> bool {
        match self {
            Self::Everything => true,
            Self::Sphere { centre, radius } => x.distance(*centre) <= *radius,
            Self::Capsule { from, to, radius } => {
                let axis = *to - *from;
                let square = axis.length_squared();
                let along = if square > 0.0 {
                    ((x - *from).dot(axis) / square).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                x.distance(*from + axis * along) <= *radius
            }
            _ => false,
        }
    }
}

impl BodyResection {
    /// Elements of a region that are left and not `taken`.
    pub(super) fn choose<S: Scalar>(
        &self,
        world: &mut World,
        soft: &SoftBody,
        region: &Region,
        taken: &Chosen,
    ) -> Result<Chosen, RemovalError> {
        region.check()?;
        let is_free = |kind: ElementKind, e: u32| {
            self.connectivity.is_present(kind, e) && taken[kind].binary_search(&e).is_err()
        };
        if let Some((kind, list)) = region.list() {
            let mut result = Chosen::default();
            let body = || world.resource::<Topology>().bodies[soft.index].name.clone();
            result[kind] = self.listed(kind, list, body, |e| is_free(kind, e))?;
            return Ok(result);
        }
        let mut queries = Queries::<S>::new(world);
        let state = State::new(self, world, soft, &mut queries);
        let thickness = soft.membrane.map_or(0.0, |m| m.thickness);
        let exceeds = |kind, e: u32, limit: f64, measure: &dyn Fn(Point) -> f64| {
            let mut exceeds = false;
            state.visit(kind, e, |point| exceeds |= measure(point) > limit);
            exceeds
        };
        let holds = |kind, e: u32| match *region {
            Region::Strain { above } => exceeds(kind, e, above, &|point| match point {
                Point::Solid(e, u) => largest_strain(e, u),
                Point::Sheet(e, u, _) => principal(membrane_strain(e, u))[0],
            }),
            Region::Stress { above } => exceeds(kind, e, above, &|point| match point {
                Point::Solid(e, u) => von_mises_stress(e, u),
                Point::Sheet(e, u, factor) => membrane_von_mises(e, u, factor * thickness),
            }),
            _ => {
                let nodes = self.connectivity.vertices(kind, e);
                let ordered = &self.connectivity.ordered;
                let portion = ordered.copies.portions.get(e as usize);
                let place = match ordered.lumps(kind, e).filter(|_| kind == ElementKind::Hexahedron)
                {
                    Some(lumps) => state.vertices.mean(nodes, &lumps.mass),
                    None => match (kind, portion) {
                        (ElementKind::Tetrahedron, Some(portion)) => {
                            state.vertices.mean(nodes, portion)
                        }
                        (ElementKind::Triangle, _) if !ordered.is_whole(kind, e) => {
                            state.vertices.mean(nodes, &ordered.sheet_portion(e))
                        }
                        _ => state.vertices.barycentre(nodes),
                    },
                };
                region.holds(place)
            }
        };
        let mut chosen = Chosen::default();
        for kind in ElementKind::ALL {
            let left = self.connectivity.all_left(kind);
            chosen[kind] = left.filter(|&e| is_free(kind, e) && holds(kind, e)).collect();
        }
        Ok(chosen)
    }

    /// Elements by the user's indices, ascending.
    fn listed(
        &self,
        kind: ElementKind,
        list: &[u32],
        body: impl Fn() -> String,
        is_free: impl Fn(u32) -> bool,
    ) -> Result<Vec<u32>, RemovalError> {
        let of = &self.element_of[kind];
        let mut chosen = Vec::with_capacity(list.len());
        for &index in list {
            let Some(&e) = of.get(index as usize) else {
                let (kind, count) = (kind.name(), of.len());
                return Err(RemovalError::Element { body: body(), kind, index, count });
            };
            chosen.push((e, index));
        }
        chosen.sort_unstable();
        let twice = chosen.windows(2).find(|w| w[0] == w[1]).map(|w| w[0].1);
        let gone = chosen.iter().find(|(e, _)| !is_free(*e));
        if let Some(index) = twice.or(gone.map(|g| g.1)) {
            return Err(RemovalError::Removed { body: body(), kind: kind.name(), index });
        }
        Ok(chosen.into_iter().map(|(e, _)| e).collect())
    }
}

/// Green strain of a membrane triangle in its plane: entries xx, yy, xy, with x along the first edge.
fn membrane_strain(e: &membrane::Element<f64>, u: &[[f64; 3]; 3]) -> [f64; 3] {
    let [a, b] = e.edges.map(DVec3::from_array);
    let w = [1, 2].map(|i| DVec3::from_array(sub(u[i], u[0])));
    let c = [
        w[0].dot(a + a + w[0]),
        w[1].dot(b + b + w[1]),
        w[0].dot(b) + a.dot(w[1]) + w[0].dot(w[1]),
    ];
    // edges in the frame of the triangle: a = (l, 0), b = (p, q)
    let length = a.length();
    let (p, q) = (a.dot(b) / length, a.cross(b).length() / length);
    let xx = c[0] / (length * length);
    let xy = (c[2] / length - p * xx) / q;
    let yy = (c[1] - p * p * xx - 2.0 * p * q * xy) / (q * q);
    [0.5 * xx, 0.5 * yy, 0.5 * xy]
}

/// Principal values of a symmetric 2x2 matrix given as xx, yy, xy, larger first.
fn principal([xx, yy, xy]: [f64; 3]) -> [f64; 2] {
    let (mean, radius) = (0.5 * (xx + yy), libm::hypot(0.5 * (xx - yy), xy));
    [mean + radius, mean - radius]
}

/// Von Mises equivalent (Pa) of the Cauchy stress of a membrane triangle of this thickness (m), whose
/// material keeps its volume. Both stresses share the principal axes of the strain.
fn membrane_von_mises(e: &membrane::Element<f64>, u: &[[f64; 3]; 3], thickness: f64) -> f64 {
    let strain = principal(membrane_strain(e, u));
    let stress = strain.map(|x| e.lambda * (strain[0] + strain[1]) + 2.0 * e.mu * x);
    // F S F^T / (J2 t) with t = thickness / J2
    let [a, b] = [0, 1].map(|i| (1.0 + 2.0 * strain[i]) * stress[i] / thickness);
    (a * a - a * b + b * b).sqrt()
}

/// Largest principal Green strain (-).
fn largest_strain(element: &Element<f64>, u: &[[f64; 3]; 4]) -> f64 {
    let strain = green_strain(&displacement_gradient(&element.gradients, u));
    largest_eigenvalue(strain)
}

/// Von Mises equivalent (Pa) of the Cauchy stress `F S F^T / |J|`.
fn von_mises_stress(element: &Element<f64>, u: &[[f64; 3]; 4]) -> f64 {
    let g = displacement_gradient(&element.gradients, u);
    let [xx, yy, zz, yz, xz, xy] = second_piola_kirchhoff(element, &green_strain(&g));
    let s = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
    let f = DMat3::from_cols_array(&g).transpose() + DMat3::IDENTITY;
    let cauchy = f * s * f.transpose() * (1.0 + volume_change(&g)).abs().recip();
    let [x, y, z] = [cauchy.x_axis, cauchy.y_axis, cauchy.z_axis];
    let normal = (x.x - y.y).powi(2) + (y.y - z.z).powi(2) + (z.z - x.x).powi(2);
    let shear = x.y * x.y + y.z * y.z + x.z * x.z;
    (0.5 * normal + 3.0 * shear).sqrt()
}

/// Largest eigenvalue of a symmetric matrix given as xx, yy, zz, yz, xz, xy.
fn largest_eigenvalue([xx, yy, zz, yz, xz, xy]: [f64; 6]) -> f64 {
    let mean = (xx + yy + zz) / 3.0;
    let (x, y, z) = (xx - mean, yy - mean, zz - mean);
    let square = (x * x + y * y + z * z + 2.0 * (yz * yz + xz * xz + xy * xy)) / 6.0;
    if square == 0.0 {
        return mean;
    }
    let radius = square.sqrt();
    let det = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
    let angle = libm::acos((det / (2.0 * radius * square)).clamp(-1.0, 1.0)) / 3.0;
    mean + 2.0 * radius * libm::cos(angle)
}
