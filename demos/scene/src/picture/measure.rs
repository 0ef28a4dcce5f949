//! Scalars of a deformed body: strain, stress, energy and volume ratio of its elements, averaged to vertices.

use crate::assemble::BuiltBody;
use glam::{DMat3, DVec3};
use sinew::engine::isoparametric::{
    RestHexahedron, RestPoints, RestTetrahedron10, TETRAHEDRON_POINTS, gauss_point,
    hexahedron_derivatives, tetrahedron10_derivatives,
};
use sinew::models::body::sheet::PlaneState;
use sinew::models::element::precompute::RestTetrahedron;
use sinew::models::material::{LameParameters, YoungPoisson};

/// Largest principal Green-Lagrange strain (-), von Mises stress (Pa), energy density (J/m^3), volume ratio (-);
/// of membranes the ratio of areas.
pub(crate) type Measures = [f64; 4];

/// A solid element at one of its points.
struct SolidPoint {
    /// Gradients (1/m) of the shape functions.
    gradients: Vec<DVec3>,
    /// Volume (m^3) it stands for.
    volume: f64,
}

struct Solid {
    vertices: Vec<u32>,
    points: Vec<SolidPoint>,
    lame: LameParameters,
}

/// A triangle of a membrane, or half a quadrilateral.
struct Sheet {
    vertices: [u32; 3],
    /// Of the index in the user's list: triangles, then quadrilaterals.
    element: usize,
    lame: LameParameters,
    area: f64,
}

/// What the measures of a body need of its rest shape.
pub(crate) struct Measured {
    solids: Vec<Solid>,
    sheets: Vec<Sheet>,
    rest: Vec<DVec3>,
}

/// Fields of moduli of a body: Young's moduli (Pa) and Poisson's ratios, for tetrahedra and then hexahedra.
#[derive(Default)]
pub(crate) struct Moduli {
    pub young_modulus: Option<Vec<f64>>,
    pub poisson_ratio: Option<Vec<f64>>,
}

fn lame(material: YoungPoisson) -> LameParameters {
    // the scene was built, so the material is valid
    material.lame().unwrap_or(LameParameters { lambda: 0.0, mu: 0.0 })
}

/// The points of an element from its rest shape and the derivatives of its shape functions at them.
fn solid_points<const V: usize, const Q: usize>(
    rest: &RestPoints<Q>,
    derivatives: impl Fn(usize) -> [[f64; 3]; V],
) -> Vec<SolidPoint> {
    let gradient = |q: usize, d: &[f64; 3]| -> DVec3 {
        d.iter().zip(&rest.gradients[q]).map(|(d, g)| DVec3::from_array(*g) * *d).sum()
    };
    let point = |q: usize| SolidPoint {
        gradients: derivatives(q).iter().map(|d| gradient(q, d)).collect(),
        volume: rest.volume[q],
    };
    (0..Q).map(point).collect()
}

impl Measured {
    /// Of a body at rest.
    pub(crate) fn new(body: &BuiltBody, moduli: &Moduli) -> Self {
        let mesh = &body.mesh;
        let point = |v: u32| mesh.points[v as usize].to_array();
        let of = |e: usize| {
            let at = |list: &Option<Vec<f64>>, default| {
                list.as_ref().and_then(|l| l.get(e)).copied().unwrap_or(default)
            };
            let young_modulus = at(&moduli.young_modulus, body.material.young_modulus);
            let poisson_ratio = at(&moduli.poisson_ratio, body.material.poisson_ratio);
            lame(YoungPoisson { young_modulus, poisson_ratio, ..body.material })
        };
        let mut solids = Vec::with_capacity(mesh.tetrahedra.len() + mesh.hexahedra.len());
        for (e, t) in mesh.tetrahedra.iter().enumerate() {
            if let Some(t) = mesh.second_order(e) {
                let at = |q: usize| tetrahedron10_derivatives(TETRAHEDRON_POINTS[q]);
                let points = RestTetrahedron10::new(t.map(point))
                    .map_or(Vec::new(), |rest| solid_points(&rest, at));
                solids.push(Solid { vertices: t.to_vec(), points, lame: of(e) });
                continue;
            }
            let points = RestTetrahedron::new(t.map(point)).map_or(Vec::new(), |rest| {
                let gradients = rest.gradients.map(DVec3::from_array).to_vec();
                vec![SolidPoint { gradients, volume: rest.volume }]
            });
            solids.push(Solid { vertices: t.to_vec(), points, lame: of(e) });
        }
        for (e, h) in mesh.hexahedra.iter().enumerate() {
            let at = |q: usize| hexahedron_derivatives(gauss_point(q));
            let points = RestHexahedron::new(h.map(point))
                .map_or(Vec::new(), |rest| solid_points(&rest, at));
            let lame = of(mesh.tetrahedra.len() + e);
            solids.push(Solid { vertices: h.to_vec(), points, lame });
        }
        let mut sheets = Vec::new();
        if let Some(membrane) = &body.membrane {
            let LameParameters { lambda, mu } = lame(membrane.settings.material);
            let lambda = match membrane.settings.plane {
                PlaneState::Stress => 2.0 * lambda * mu / (lambda + 2.0 * mu),
                PlaneState::Strain => lambda,
            };
            let mut add = |vertices: [u32; 3], element| {
                let [a, b, c] = vertices.map(|v| mesh.points[v as usize]);
                let area = 0.5 * (b - a).cross(c - a).length();
                sheets.push(Sheet { vertices, element, lame: LameParameters { lambda, mu }, area });
            };
            for (e, &t) in membrane.triangles.iter().enumerate() {
                add(t, e);
            }
            for (e, &[a, b, c, d]) in membrane.quads.iter().enumerate() {
                add([a, b, c], membrane.triangles.len() + e);
                add([a, c, d], membrane.triangles.len() + e);
            }
        }
        Self { solids, sheets, rest: mesh.points.clone() }
    }

    /// Mean deformation gradient of a solid element, tetrahedra first, under the displacements `u` (m).
    pub(crate) fn deformation(&self, element: usize, u: &[DVec3]) -> DMat3 {
        let solid = &self.solids[element];
        let (mut sum, mut volume) = (DMat3::ZERO, 0.0);
        for point in &solid.points {
            sum += gradient(solid, point, u) * point.volume;
            volume += point.volume;
        }
        if volume > 0.0 { DMat3::IDENTITY + sum * volume.recip() } else { DMat3::IDENTITY }
    }

    /// Averages by volume at the vertices of what is left of a body, in the order of its mesh; by area where
    /// only membranes meet, 0 strain and a ratio of 1 where nothing does.
    pub(crate) fn at_vertices(
        &self,
        u: &[DVec3],
        solids: &[u32],
        sheet_left: &dyn Fn(usize) -> bool,
    ) -> Vec<Measures> {
        let mut sums = vec![([0.0; 4], 0.0); self.rest.len()];
        for &e in solids {
            let solid = &self.solids[e as usize];
            let (mut mean, mut volume) = ([0.0; 4], 0.0);
            for point in &solid.points {
                let measures = measures(gradient(solid, point, u), solid.lame);
                (0..4).for_each(|k| mean[k] += point.volume * measures[k]);
                volume += point.volume;
            }
            for &v in &solid.vertices {
                let (sum, weight) = &mut sums[v as usize];
                (0..4).for_each(|k| sum[k] += mean[k]);
                *weight += volume;
            }
        }
        let solid: Vec<bool> = sums.iter().map(|s| s.1 > 0.0).collect();
        for sheet in self.sheets.iter().filter(|s| sheet_left(s.element)) {
            let measures = sheet_measures(sheet, &self.rest, u);
            for v in sheet.vertices.map(|v| v as usize).into_iter().filter(|&v| !solid[v]) {
                (0..4).for_each(|k| sums[v].0[k] += sheet.area * measures[k]);
                sums[v].1 += sheet.area;
            }
        }
        let mean = |(sum, weight): ([f64; 4], f64)| {
            if weight > 0.0 { sum.map(|x| x / weight) } else { [0.0, 0.0, 0.0, 1.0] }
        };
        sums.into_iter().map(mean).collect()
    }
}

/// Displacement gradient at a point.
fn gradient(solid: &Solid, point: &SolidPoint, u: &[DVec3]) -> DMat3 {
    let mut g = DMat3::ZERO;
    for (&v, d) in solid.vertices.iter().zip(&point.gradients) {
        let u = u[v as usize];
        g += DMat3::from_cols(u * d.x, u * d.y, u * d.z);
    }
    g
}

/// Of a displacement gradient, by St Venant-Kirchhoff with these moduli, whatever the model.
fn measures(g: DMat3, LameParameters { lambda, mu }: LameParameters) -> Measures {
    let strain = (g + g.transpose() + g.transpose() * g) * 0.5;
    let trace = strain.x_axis.x + strain.y_axis.y + strain.z_axis.z;
    let stress = DMat3::from_diagonal(DVec3::splat(lambda * trace)) + strain * (2.0 * mu);
    let f = g + DMat3::IDENTITY;
    let ratio = f.determinant();
    let cauchy = f * stress * f.transpose() * ratio.abs().max(1e-6).recip();
    let [x, y, z] = [cauchy.x_axis, cauchy.y_axis, cauchy.z_axis];
    let normal = (x.x - y.y).powi(2) + (y.y - z.z).powi(2) + (z.z - x.x).powi(2);
    let shear = x.y * x.y + y.z * y.z + x.z * x.z;
    let square: f64 = strain.to_cols_array().iter().map(|e| e * e).sum();
    let largest =
        nalgebra::Matrix3::from_column_slice(&strain.to_cols_array()).symmetric_eigenvalues().max();
    let energy = 0.5 * lambda * trace * trace + mu * square;
    [largest, (0.5 * normal + 3.0 * shear).sqrt(), energy, ratio]
}

/// The same in the plane of a triangle, whose material keeps its volume.
fn sheet_measures(sheet: &Sheet, rest: &[DVec3], u: &[DVec3]) -> Measures {
    let [a, b, c] = sheet.vertices.map(|v| v as usize);
    let (p, q) = (rest[b] - rest[a], rest[c] - rest[a]);
    let (r, s) = (p + u[b] - u[a], q + u[c] - u[a]);
    let x = p.normalize();
    let y = (q - x * q.dot(x)).normalize();
    // the inverse of [p q] in the frame x, y
    let (l, m, n) = (p.length(), q.dot(x), q.dot(y));
    let (fx, fy) = (r / l, (s - r * (m / l)) / n);
    let strain = [0.5 * (fx.dot(fx) - 1.0), 0.5 * (fy.dot(fy) - 1.0), 0.5 * fx.dot(fy)];
    let (mean, radius) =
        (0.5 * (strain[0] + strain[1]), (0.5 * (strain[0] - strain[1])).hypot(strain[2]));
    let principal = [mean + radius, mean - radius];
    let LameParameters { lambda, mu } = sheet.lame;
    let trace = principal[0] + principal[1];
    let cauchy = principal.map(|e| (1.0 + 2.0 * e) * (lambda * trace + 2.0 * mu * e));
    let von_mises =
        (cauchy[0] * cauchy[0] - cauchy[0] * cauchy[1] + cauchy[1] * cauchy[1]).max(0.0).sqrt();
    let square = principal[0] * principal[0] + principal[1] * principal[1];
    let energy = 0.5 * lambda * trace * trace + mu * square;
    [principal[0], von_mises, energy, fx.cross(fy).length()]
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAME: LameParameters = LameParameters { lambda: 3.0, mu: 2.0 };

    #[test]
    fn a_uniaxial_stretch_has_its_textbook_measures() {
        let g = DMat3::from_diagonal(DVec3::new(0.2, 0.0, 0.0));
        let [strain, stress, energy, ratio] = measures(g, LAME);
        let e = 0.5 * (1.2f64.powi(2) - 1.0);
        assert!((strain - e).abs() < 1e-14);
        assert!((ratio - 1.2).abs() < 1e-14);
        assert!((energy - (0.5 * 3.0 + 2.0) * e * e).abs() < 1e-14);
        // Cauchy: 1.44 S_x / 1.2 along, S_y / 1.2 across
        let along = 1.44 * (3.0 + 4.0) * e / 1.2;
        let across = 3.0 * e / 1.2;
        assert!((stress - (along - across)).abs() < 1e-12);
    }

    #[test]
    fn rotations_have_no_strain_and_keep_the_stress() {
        let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-1.1);
        let [strain, stress, energy, ratio] = measures(turn - DMat3::IDENTITY, LAME);
        assert!(strain.abs() < 1e-14 && stress < 1e-13 && energy < 1e-25);
        assert!((ratio - 1.0).abs() < 1e-14);
        let stretch = DMat3::from_cols_array(&[1.1, 0.1, 0.0, 0.05, 0.9, 0.2, 0.0, 0.1, 1.0]);
        let plain = measures(stretch - DMat3::IDENTITY, LAME);
        let turned = measures(turn * stretch - DMat3::IDENTITY, LAME);
        for k in 0..4 {
            assert!((plain[k] - turned[k]).abs() < 1e-12, "{k}");
        }
    }

    #[test]
    fn a_sheet_measures_as_a_solid_whose_thickness_follows() {
        // plane stress at small strain: sigma = E e along a free stretch
        let (young, nu) = (100.0, 0.3);
        let material = YoungPoisson { young_modulus: young, poisson_ratio: nu, density: 1.0 };
        let LameParameters { lambda, mu } = material.lame().unwrap();
        let lame = LameParameters { lambda: 2.0 * lambda * mu / (lambda + 2.0 * mu), mu };
        let rest = [DVec3::ZERO, DVec3::new(2.0, 1.0, 0.0), DVec3::new(-0.5, 1.5, 0.3)];
        let (x, e) = (DVec3::new(2.0, 1.0, 0.0).normalize(), 1e-6);
        let normal = (rest[1] - rest[0]).cross(rest[2] - rest[0]).normalize();
        let y = normal.cross(x);
        let u = rest.map(|p| (x * p.dot(x) - y * (nu * p.dot(y))) * e);
        let sheet = Sheet { vertices: [0, 1, 2], element: 0, lame, area: 1.0 };
        let [strain, stress, energy, ratio] = sheet_measures(&sheet, &rest, &u);
        assert!((strain / e - 1.0).abs() < 1e-4);
        assert!((stress / (young * e) - 1.0).abs() < 1e-4);
        assert!((energy / (0.5 * young * e * e) - 1.0).abs() < 1e-4);
        assert!((ratio - 1.0 - (1.0 - nu) * e).abs() < 1e-10);
    }
}
