//! Scalars of a deformed body: strain, stress, energy and volume ratio of its elements, averaged to vertices.

use crate::assemble::BuiltBody;
use glam::{DMat3, DVec3};
use sinew::engine::isoparametric::{
    RestHexahedron, RestPoints, RestTetrahedron10, TETRAHEDRON_POINTS, gauss_point,
    hexahedron_derivatives, tetrahedron10_derivatives,
};
use sinew::models::body::sheet::PlaneState;
use sinew::models::element::precompute::RestTetrahedron;
use sinew::models::material::field::MaterialField;
use sinew::models::material::{LameParameters, YoungPoisson};

/// Largest principal Green-Lagrange strain (-), von Mises stress (Pa), energy density (J/m^3), volume ratio (-);
/// of membranes the ratio of areas.
pub type Measures = [f64; 4];

/// A solid element at one of its points.
struct SolidPoint {
    /// Gradients (1/m) of the shape functions.
    gradients: Vec<DVec3>,
    /// Volume (m^3) it stands for.
    volume: f64,
}

struct MeasuredSolid {
    vertices: Vec<u32>,
    points: Vec<SolidPoint>,
    lame: LameParameters,
}

/// A triangle of a membrane, or half a quadrilateral.
struct MeasuredSheet {
    vertices: [u32; 3],
    /// Of the index in the user's list: triangles, then quadrilaterals.
    element: usize,
    lame: LameParameters,
    area: f64,
}

/// What the measures of a body need of its rest shape.
pub(crate) struct MeasuredBody {
    solids: Vec<MeasuredSolid>,
    sheets: Vec<MeasuredSheet>,
    rest: Vec<DVec3>,
}

/// A piece of a tetrahedron or hexahedron that a cut parted, or of a triangle of a body that is a membrane alone.
pub(crate) struct Parted {
    /// The element of the mesh.
    pub source: u32,
    /// Vertices that move it, of the mesh or made by cuts.
    pub nodes: Vec<u32>,
    /// Part of its volume or area.
    pub share: f64,
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

impl MeasuredBody {
    /// Of a body at rest, with the material of its elements.
    pub(crate) fn new(body: &BuiltBody, field: MaterialField) -> Self {
        // a stress is that of the part that is filled
        let field = MaterialField { filled: None, ..field };
        let mesh = &body.mesh;
        let point = |v: u32| mesh.points[v as usize].to_array();
        let of = |e: usize| lame(field.at(e));
        let mut solids = Vec::with_capacity(mesh.tetrahedra.len() + mesh.hexahedra.len());
        for (e, t) in mesh.tetrahedra.iter().enumerate() {
            if let Some(t) = mesh.second_order(e) {
                let at = |q: usize| tetrahedron10_derivatives(TETRAHEDRON_POINTS[q]);
                let points = RestTetrahedron10::new(t.map(point))
                    .map_or(Vec::new(), |rest| solid_points(&rest, at));
                solids.push(MeasuredSolid { vertices: t.to_vec(), points, lame: of(e) });
                continue;
            }
            let points = RestTetrahedron::new(t.map(point)).map_or(Vec::new(), |rest| {
                let gradients = rest.gradients.map(DVec3::from_array).to_vec();
                vec![SolidPoint { gradients, volume: rest.volume }]
            });
            solids.push(MeasuredSolid { vertices: t.to_vec(), points, lame: of(e) });
        }
        for (e, h) in mesh.hexahedra.iter().enumerate() {
            let at = |q: usize| hexahedron_derivatives(gauss_point(q));
            let points = RestHexahedron::new(h.map(point))
                .map_or(Vec::new(), |rest| solid_points(&rest, at));
            let lame = of(mesh.tetrahedra.len() + e);
            solids.push(MeasuredSolid { vertices: h.to_vec(), points, lame });
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
                sheets.push(MeasuredSheet {
                    vertices,
                    element,
                    lame: LameParameters { lambda, mu },
                    area,
                });
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
            sum += gradient(&solid.vertices, point, u) * point.volume;
            volume += point.volume;
        }
        if volume > 0.0 { DMat3::IDENTITY + sum * volume.recip() } else { DMat3::IDENTITY }
    }

    /// Averages by volume at the vertices of what is left of a body, in the order of its mesh, then at those that cuts made;
    /// by area where only membranes meet, 0 strain and a ratio of 1 where nothing does. `solids` are those that are whole.
    pub(crate) fn at_vertices(
        &self,
        u: &[DVec3],
        solids: &[u32],
        parted: &[Parted],
        sheet_left: &dyn Fn(usize) -> bool,
    ) -> Vec<Measures> {
        let mut sums = vec![([0.0; 4], 0.0); u.len()];
        let whole = solids.iter().map(|&e| (e, &self.solids[e as usize].vertices[..], 1.0));
        let of_sheets = if self.solids.is_empty() { parted.len() } else { 0 };
        let (parted_sheets, parted) = parted.split_at(of_sheets);
        let parted = parted.iter().map(|own| (own.source, &own.nodes[..], own.share));
        for (e, vertices, share) in whole.chain(parted) {
            let solid = &self.solids[e as usize];
            let (mut mean, mut volume) = ([0.0; 4], 0.0);
            for point in &solid.points {
                let measures = measures(gradient(vertices, point, u), solid.lame);
                (0..4).for_each(|k| mean[k] += share * point.volume * measures[k]);
                volume += share * point.volume;
            }
            for &v in vertices {
                let (sum, weight) = &mut sums[v as usize];
                (0..4).for_each(|k| sum[k] += mean[k]);
                *weight += volume;
            }
        }
        let solid: Vec<bool> = sums.iter().map(|s| s.1 > 0.0).collect();
        let whole = self.sheets.iter().filter(|s| sheet_left(s.element));
        let whole = whole.map(|sheet| (sheet, sheet.vertices, 1.0));
        let parted = parted_sheets.iter().map(|Parted { source, nodes, share }| {
            (&self.sheets[*source as usize], [nodes[0], nodes[1], nodes[2]], *share)
        });
        for (sheet, nodes, share) in whole.chain(parted) {
            let rest = sheet.vertices.map(|v| self.rest[v as usize]);
            let nodes = nodes.map(|v| v as usize);
            let measures = sheet_measures(sheet.lame, rest, nodes.map(|v| u[v]));
            let area = share * sheet.area;
            for v in nodes.into_iter().filter(|&v| !solid[v]) {
                (0..4).for_each(|k| sums[v].0[k] += area * measures[k]);
                sums[v].1 += area;
            }
        }
        let mean = |(sum, weight): ([f64; 4], f64)| {
            if weight > 0.0 { sum.map(|x| x / weight) } else { [0.0, 0.0, 0.0, 1.0] }
        };
        sums.into_iter().map(mean).collect()
    }
}

/// Displacement gradient at a point.
fn gradient(vertices: &[u32], point: &SolidPoint, u: &[DVec3]) -> DMat3 {
    let mut g = DMat3::ZERO;
    for (&v, d) in vertices.iter().zip(&point.gradients) {
        let u = u[v as usize];
        g += DMat3::from_cols(u * d.x, u * d.y, u * d.z);
    }
    g
}

/// Of a displacement gradient, by St Venant-Kirchhoff with these moduli, whatever the model.
pub fn measures(g: DMat3, LameParameters { lambda, mu }: LameParameters) -> Measures {
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
    let largest = largest_eigenvalue(strain);
    let energy = 0.5 * lambda * trace * trace + mu * square;
    [largest, (0.5 * normal + 3.0 * shear).sqrt(), energy, ratio]
}

/// The largest eigenvalue of a symmetric matrix, by its characteristic polynomial: the angle of its invariants.
fn largest_eigenvalue(a: DMat3) -> f64 {
    let mean = (a.x_axis.x + a.y_axis.y + a.z_axis.z) / 3.0;
    let rest = a - DMat3::from_diagonal(DVec3::splat(mean));
    let spread = (rest.to_cols_array().iter().map(|x| x * x).sum::<f64>() / 6.0).sqrt();
    if spread <= f64::MIN_POSITIVE {
        return mean;
    }
    let cosine = 0.5 * (rest * spread.recip()).determinant();
    mean + 2.0 * spread * (cosine.clamp(-1.0, 1.0).acos() / 3.0).cos()
}

/// The same in the plane of a triangle from its corners at rest and their displacements (m), whose material keeps its
/// volume.
pub fn sheet_measures(lame: LameParameters, rest: [DVec3; 3], u: [DVec3; 3]) -> Measures {
    let (p, q) = (rest[1] - rest[0], rest[2] - rest[0]);
    let (r, s) = (p + u[1] - u[0], q + u[2] - u[0]);
    let x = p.normalize();
    let y = (q - x * q.dot(x)).normalize();
    // the inverse of [p q] in the frame x, y
    let (l, m, n) = (p.length(), q.dot(x), q.dot(y));
    let (fx, fy) = (r / l, (s - r * (m / l)) / n);
    let strain = [0.5 * (fx.dot(fx) - 1.0), 0.5 * (fy.dot(fy) - 1.0), 0.5 * fx.dot(fy)];
    let (mean, radius) =
        (0.5 * (strain[0] + strain[1]), (0.5 * (strain[0] - strain[1])).hypot(strain[2]));
    let principal = [mean + radius, mean - radius];
    let LameParameters { lambda, mu } = lame;
    let trace = principal[0] + principal[1];
    let cauchy = principal.map(|e| (1.0 + 2.0 * e) * (lambda * trace + 2.0 * mu * e));
    let von_mises =
        (cauchy[0] * cauchy[0] - cauchy[0] * cauchy[1] + cauchy[1] * cauchy[1]).max(0.0).sqrt();
    let square = principal[0] * principal[0] + principal[1] * principal[1];
    let energy = 0.5 * lambda * trace * trace + mu * square;
    [principal[0], von_mises, energy, fx.cross(fy).length()]
}
