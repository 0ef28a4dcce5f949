//! Distance field of a closed triangle mesh, the shape of a tool that presses into tissue.
//!
//! A regular grid in the mesh's own frame holds, at every grid point, the exact distance to the nearest triangle,
//! found in a tree of boxes. The sign comes from the winding number: along each line of the grid that is parallel
//! to x, crossings of triangles are counted with the side on which they are crossed. For a closed mesh this is the
//! generalised winding number of Jacobson, Kavan and Sorkine-Hornung 2013 ("Robust inside-outside segmentation
//! using generalized winding numbers"), an integer. Lines that meet a vertex or an edge count as if they were moved
//! by an infinitely small step (Edelsbrunner and Mücke 1990, "Simulation of simplicity").
//!
//! Between grid points the field is the tricubic B-spline that takes the samples as its values (Unser 1999,
//! "Splines: a perfect fit for signal and image processing"): value, gradient and curvature are continuous. Edges
//! that are sharper than the grid can show are rounded; [`DistanceField::accuracy`] says by how much.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, PoisonError};

/// Cells of the grid beyond the mesh's box on each side. The spline is evaluated in all but the outermost.
const PADDING: usize = 3;
/// Most grid points of a field: 64 MiB.
const LIMIT: f64 = 256.0 * 256.0 * 256.0;
/// Most grid points where the spacing is not given: 4 MiB.
const SMALL: f64 = LIMIT / 16.0;
/// Points at which the accuracy is measured, and the worst of them, about which larger errors are looked for.
const CHECKS: [usize; 2] = [8192, 128];

/// Why a mesh has no distance field.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DistanceFieldError {
    /// Nothing to measure a distance to.
    #[error("the mesh has no triangles; a tool needs a closed surface of triangles")]
    NoTriangles,
    /// A triangle names a vertex that is not there.
    #[error(
        "triangle {triangle} names vertex {vertex}, but there are {points} points, counted from 0"
    )]
    Index {
        /// Number of the triangle, from 0.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of points.
        points: usize,
    },
    /// A coordinate of this point is infinite or not a number.
    #[error("point {0} is not finite; repair or remove it")]
    NotFinite(usize),
    /// Inside and outside are not defined.
    #[error(
        "the mesh is not closed: {open} edges have one triangle, {crowded} have more than two, first the edge of \
         vertices {} and {}; fill holes, merge points that lie on each other, and part what meets in an edge",
        first[0], first[1]
    )]
    NotClosed {
        /// Edges of one triangle.
        open: usize,
        /// Edges of more than two triangles.
        crowded: usize,
        /// Vertices of the first such edge.
        first: [u32; 2],
    },
    /// Neighbours disagree on what is outside.
    #[error(
        "{edges} edges join triangles that face opposite ways, first the edge of vertices {} and {}; \
         turn the triangles so that all go round counterclockwise seen from outside",
        first[0], first[1]
    )]
    Winding {
        /// Edges that both their triangles pass in the same direction.
        edges: usize,
        /// Vertices of the first such edge.
        first: [u32; 2],
    },
    /// The surface is folded flat; its signed volume (m^3).
    #[error("the mesh encloses no volume ({0:e} m^3); give the tool a thickness")]
    Flat(f64),
    /// Part of the surface lies within the body, or is turned against the rest.
    #[error(
        "the mesh winds {number} times around ({}, {}, {}): parts overlap, or one is wound inside out; \
         join the parts, or give each as a shape of its own",
        at.x, at.y, at.z
    )]
    Overlap {
        /// Winding number there; 1 is inside, 0 outside.
        number: i32,
        /// The place (m).
        at: DVec3,
    },
    /// No grid can have this spacing.
    #[error("the spacing of the grid is {0} m; it must be positive and finite")]
    Spacing(f64),
    /// The grid would take too much memory.
    #[error(
        "a spacing of {spacing} m needs {points:.2e} grid points, more than 2^24; {fits:.2e} m fits"
    )]
    TooFine {
        /// The spacing asked for (m).
        spacing: f64,
        /// Grid points it needs.
        points: f64,
        /// A spacing that is allowed (m).
        fits: f64,
    },
}

/// Signed distance (m) to a closed triangle mesh, sampled on a grid; see the [module](self).
///
/// The mesh may have cavities and several parts. Parts must not overlap, nor touch over an area: there the field
/// is zero although no surface can be reached. Triangles that name a vertex twice are passed over.
#[derive(PartialEq, Serialize, Deserialize)]
pub struct DistanceField {
    points: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    turned: bool,
    /// The spacing asked for, by which the cache knows the field again.
    asked: Option<f64>,
    bounds: [DVec3; 2],
    /// First grid point (m).
    origin: DVec3,
    /// Grid points along x, y and z; x runs fastest.
    size: [usize; 3],
    spacing: f64,
    /// Coefficients of the B-spline, in spacings, so that single precision serves meshes of any scale.
    coefficients: Vec<f32>,
    accuracy: f64,
}

impl std::fmt::Debug for DistanceField {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { size, spacing, triangles, .. } = self;
        write!(
            f,
            "DistanceField({} triangles, {size:?} points, {spacing} m apart)",
            triangles.len()
        )
    }
}

impl DistanceField {
    /// Whether its parts belong together, as they do unless it was read from damaged data.
    pub fn is_whole(&self) -> bool {
        let [a, b, c] = self.size;
        let count = a.checked_mul(b).and_then(|ab| ab.checked_mul(c));
        let finite = [self.origin, self.bounds[0], self.bounds[1]].iter().all(|x| x.is_finite());
        self.size.iter().all(|&n| n >= 4)
            && count == Some(self.coefficients.len())
            && finite
            && self.spacing > 0.0
            && self.spacing.is_finite()
            && self.triangles.iter().flatten().all(|&v| (v as usize) < self.points.len())
    }

    /// Samples the distance to the surface of `triangles`, which name `points` (m) counterclockwise seen from
    /// outside. A mesh that is wound inside out as a whole is turned.
    ///
    /// `spacing` (m) is the distance of grid points. Without it, it is the smaller of a 64th of the longest side
    /// of the mesh's box and a third of the shortest, but never so small that the grid has more than 2^20 points.
    ///
    /// # Errors
    /// [`DistanceFieldError`] where the mesh is not a closed, consistently wound surface of finite points that encloses a
    /// volume, and where the spacing is unusable or needs more than 2^24 grid points.
    pub fn new(
        points: &[DVec3],
        triangles: &[[u32; 3]],
        spacing: Option<f64>,
    ) -> Result<Self, DistanceFieldError> {
        check(points, triangles)?;
        let corners =
            || triangles.iter().filter(|t| is_proper(t)).map(|t| t.map(|v| points[v as usize]));
        let lower = corners().flatten().fold(DVec3::INFINITY, DVec3::min);
        let upper = corners().flatten().fold(DVec3::NEG_INFINITY, DVec3::max);
        let extent = upper - lower;
        // Coordinates from the corner of the box: no digits are lost far from the origin.
        let mut faces: Vec<_> = corners().map(|t| t.map(|v| v - lower)).collect();
        let volume = faces.iter().map(|[a, b, c]| a.dot(b.cross(*c)) / 6.0).sum::<f64>();
        let area = faces.iter().map(|face| normal(face).length() / 2.0).sum::<f64>();
        // Thinner than a billionth of its length: no grid shows it, and rounding decides the sign.
        let least = 1e-9 * extent.max_element() * area;
        if volume.is_nan() || volume.abs() <= least {
            return Err(DistanceFieldError::Flat(volume));
        }
        let turned = volume < 0.0;
        let mut triangles = triangles.to_vec();
        if turned {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
            faces.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let h = grid_spacing(extent, spacing)?;
        let size = grid_size(extent, h).to_array().map(|n| n as usize);
        let start = (extent - grid_size(extent, h).map(|n| n - 1.0) * h) / 2.0;
        let tree = Tree::new(faces);
        let mut coefficients = sample(&tree, start, size, h)
            .map_err(|(number, at)| DistanceFieldError::Overlap { number, at: lower + at })?;
        prefilter(&mut coefficients, size);
        let mut field = Self {
            points: points.to_vec(),
            triangles,
            turned,
            asked: spacing,
            bounds: [lower, upper],
            origin: lower + start,
            size,
            spacing: h,
            coefficients,
            accuracy: 0.0,
        };
        field.accuracy = field.measure(&tree);
        Ok(field)
    }

    /// As [`DistanceField::new`], but a field of the same points, triangles and spacing is built once in the
    /// process and shared. The cache keeps the latest fields, 2^25 samples (128 MiB) in all.
    ///
    /// # Errors
    /// As [`DistanceField::new`].
    pub fn cached(
        points: &[DVec3],
        triangles: &[[u32; 3]],
        spacing: Option<f64>,
    ) -> Result<Arc<Self>, DistanceFieldError> {
        static CACHE: Mutex<Vec<Arc<DistanceField>>> = Mutex::new(Vec::new());
        // Held while a field is built: who wants the same one waits for it.
        let mut fields = CACHE.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(field) = fields.iter().find(|field| field.is_of(points, triangles, spacing)) {
            return Ok(field.clone());
        }
        let field = Arc::new(Self::new(points, triangles, spacing)?);
        fields.push(field.clone());
        while fields.len() > 1
            && fields.iter().map(|f| f.coefficients.len()).sum::<usize>() > 1 << 25
        {
            fields.remove(0);
        }
        Ok(field)
    }

    fn is_of(&self, points: &[DVec3], triangles: &[[u32; 3]], spacing: Option<f64>) -> bool {
        let turn = |&[a, b, c]: &[u32; 3]| if self.turned { [a, c, b] } else { [a, b, c] };
        self.asked == spacing
            && self.points == points
            && triangles.iter().map(turn).eq(self.triangles.iter().copied())
    }

    /// Signed distance (m, negative inside) at a point (m) of the mesh's frame, and its gradient, the exact
    /// derivative of the interpolated function (about 1 long, not normalised).
    ///
    /// Outside the grid, `q` is the nearest point of the grid's box, `s = at - q` and `g` the gap between the boxes
    /// of grid and mesh: `sqrt(phi(q)^2 + |s|^2 + 2 sum g_i |s_i|)`. It continues the field, is exact above a flat
    /// side of the box, and exceeds the distance by no more than the field does at `q`, because every point of the
    /// mesh lies at least `g_i` behind each face of the grid's box that `at` has passed.
    pub fn distance(&self, at: DVec3) -> (f64, DVec3) {
        let h = self.spacing;
        let lower = self.origin + h;
        let upper = self.origin + DVec3::from(self.size.map(|n| (n - 2) as f64)) * h;
        let q = at.max(lower).min(upper);
        let (value, gradient) = self.spline(q);
        let s = at - q;
        if s == DVec3::ZERO {
            return (value, gradient);
        }
        let gap =
            DVec3::select(s.cmplt(DVec3::ZERO), self.bounds[0] - lower, upper - self.bounds[1]);
        let far = (value * value + s.length_squared() + 2.0 * gap.dot(s.abs())).sqrt();
        let inner = value * gradient;
        (far, DVec3::select(s.cmpeq(DVec3::ZERO), inner, s + gap * s.signum()) / far)
    }

    /// The tricubic spline and its gradient within the grid.
    fn spline(&self, at: DVec3) -> (f64, DVec3) {
        let u = ((at - self.origin) / self.spacing).to_array();
        let cell: [usize; 3] = std::array::from_fn(|a| (u[a] as usize).clamp(1, self.size[a] - 3));
        let weights: [_; 3] = std::array::from_fn(|a| weights(u[a] - cell[a] as f64));
        let [[x, dx], [y, dy], [z, dz]] = weights;
        let (mut value, mut gradient) = (0.0, DVec3::ZERO);
        for k in 0..4 {
            for j in 0..4 {
                let row = (cell[2] + k - 1) * self.size[1] + cell[1] + j - 1;
                let first = row * self.size[0] + cell[0] - 1;
                let c = &self.coefficients[first..first + 4];
                let (mut along, mut slope) = (0.0, 0.0);
                for i in 0..4 {
                    along += x[i] * f64::from(c[i]);
                    slope += dx[i] * f64::from(c[i]);
                }
                value += along * (y[j] * z[k]);
                gradient +=
                    DVec3::new(slope * y[j] * z[k], along * dy[j] * z[k], along * y[j] * dz[k]);
            }
        }
        (value * self.spacing, gradient)
    }

    /// Box (m) of the mesh, lower and upper corner.
    pub fn bounds(&self) -> [DVec3; 2] {
        self.bounds
    }

    /// Distance of grid points (m).
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Largest error (m) found against the exact distance within two spacings of the surface, and a tenth more for
    /// what lies between the check points: 8192 about faces, edges and vertices, then a search uphill from the
    /// worst. They are the same on every machine.
    pub fn accuracy(&self) -> f64 {
        self.accuracy
    }

    /// Whether the mesh was wound inside out and has been turned.
    pub fn was_turned(&self) -> bool {
        self.turned
    }

    /// Points (m) of the mesh, as given.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Triangles of the mesh, counterclockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// See [`Self::accuracy`].
    fn measure(&self, tree: &Tree) -> f64 {
        let h = self.spacing;
        let mut seed = 0;
        let mut cube = |half: f64| random_in_cube(&mut seed, half);
        let error = |p: DVec3| {
            let exact = tree.signed_distance(p);
            let found = self.distance(p + self.bounds[0]).0;
            if exact.abs() <= 2.0 * h { (found - exact).abs() } else { 0.0 }
        };
        let mut worst: Vec<(f64, DVec3)> = Vec::with_capacity(CHECKS[0]);
        for i in 0..CHECKS[0] {
            let [a, b, c] = tree.faces[i * tree.faces.len() / CHECKS[0]].corners;
            let r = cube(0.5) + 0.5;
            let place = match i % 3 {
                0 => (a * r.x + b * r.y + c * r.z) / r.element_sum(),
                1 => [a, b, c][(r.x * 3.0) as usize].lerp([b, c, a][(r.x * 3.0) as usize], r.y),
                _ => [a, b, c][(r.x * 3.0) as usize],
            };
            // Errors at corners are near them, others anywhere.
            let p = place + cube(2.0 * h) * if i % 2 == 0 { 1.0 } else { r.z };
            worst.push((error(p), p));
        }
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        worst.truncate(CHECKS[1]);
        for (most, p) in &mut worst {
            let mut step = h / 2.0;
            for _ in 0..64 {
                let next = *p + cube(step);
                let found = error(next);
                if found > *most {
                    (*most, *p) = (found, next);
                } else {
                    step *= 0.85;
                }
            }
        }
        1.1 * worst.iter().map(|w| w.0).fold(0.0, f64::max)
    }
}

/// Number in 0..1 and the next state (Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators").
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

fn random_in_cube(state: &mut u64, half: f64) -> DVec3 {
    DVec3::from([(); 3].map(|()| (2.0 * random(state) - 1.0) * half))
}

/// Weights of the four coefficients about a place `t` in 0..1 of a cell, and their derivatives by `t`.
fn weights(t: f64) -> [[f64; 4]; 2] {
    let s = 1.0 - t;
    let value =
        [s * s * s, (3.0 * t - 6.0) * t * t + 4.0, (3.0 * s - 6.0) * s * s + 4.0, t * t * t];
    let slope = [-s * s, (3.0 * t - 4.0) * t, -(3.0 * s - 4.0) * s, t * t];
    [value.map(|w| w / 6.0), slope.map(|w| w / 2.0)]
}

/// Turns samples into coefficients of the spline that takes them as values: `c[i-1] + 4 c[i] + c[i+1] = 6 s[i]`
/// along each axis by elimination, with no curvature at the ends, where `c = s`.
fn prefilter(data: &mut [f32], size: [usize; 3]) {
    let mut stride = 1;
    for n in size {
        let mut m = vec![0.0; n];
        for i in 1..n - 1 {
            m[i] = 1.0 / (4.0 - m[i - 1]);
        }
        for block in data.chunks_exact_mut(stride * n) {
            for i in 1..n - 1 {
                for at in i * stride..(i + 1) * stride {
                    let rest = 6.0 * f64::from(block[at]) - f64::from(block[at - stride]);
                    block[at] = (rest * m[i]) as f32;
                }
            }
            for i in (1..n - 1).rev() {
                for at in i * stride..(i + 1) * stride {
                    block[at] =
                        (f64::from(block[at]) - m[i] * f64::from(block[at + stride])) as f32;
                }
            }
        }
        stride *= n;
    }
}

/// Signed distances, in spacings, at all grid points; the first point around which the mesh winds neither 0 nor 1
/// times, and that number, where there is one. Planes of the grid are shared out among the machine's processors;
/// each line of the grid is worked out by itself, so that their number changes nothing.
fn sample(tree: &Tree, start: DVec3, size: [usize; 3], h: f64) -> Result<Vec<f32>, (i32, DVec3)> {
    let mut samples = vec![0.0; size.iter().product()];
    let planes = Mutex::new(samples.chunks_exact_mut(size[0] * size[1]).enumerate());
    let work = || loop {
        let (k, plane) = planes.lock().unwrap_or_else(PoisonError::into_inner).next()?;
        for (j, row) in plane.chunks_exact_mut(size[0]).enumerate() {
            let from = start + DVec3::new(0.0, j as f64, k as f64) * h;
            if let Err(overlap) = sample_row(tree, from, h, row) {
                return Some((k, overlap));
            }
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(size[2]);
    // Planes are handed out in order, so the first overlap is among those that are found.
    let first = std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
        let mut found = vec![work()];
        for thread in others {
            found.push(thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        }
        found.into_iter().flatten().min_by_key(|overlap| overlap.0)
    });
    first.map_or(Ok(samples), |(_, overlap)| Err(overlap))
}

/// One line of the grid along x.
fn sample_row(tree: &Tree, from: DVec3, h: f64, row: &mut [f32]) -> Result<(), (i32, DVec3)> {
    let mut crossings = Vec::new();
    tree.crossings(from, &mut crossings);
    let (mut number, mut passed, mut nearest) = (0, 0, 0);
    for (i, sample) in row.iter_mut().enumerate() {
        let p = from + DVec3::X * (i as f64 * h);
        while passed < crossings.len() && crossings[passed].0 <= p.x {
            number += crossings[passed].1;
            passed += 1;
        }
        // The nearest triangle of the last point leaves little to search.
        let mut best = (f64::INFINITY, nearest);
        tree.faces[nearest].lower(p, &mut best.0);
        tree.nearest(0, p, &mut best);
        nearest = best.1;
        let distance = best.0.sqrt() / h;
        // On the surface rounding may miscount: harmless where the distance is next to nothing.
        if !matches!(number, 0 | 1) && distance > 1e-3 {
            return Err((number, p));
        }
        *sample = if number == 0 { distance } else { -distance } as f32;
    }
    Ok(())
}

/// Grid points along each axis, as a number that cannot overflow.
fn grid_size(extent: DVec3, spacing: f64) -> DVec3 {
    (extent / spacing).ceil() + (2 * PADDING + 1) as f64
}

fn grid_spacing(extent: DVec3, asked: Option<f64>) -> Result<f64, DistanceFieldError> {
    let points = |h: f64| grid_size(extent, h).element_product();
    let fitting = |mut h: f64, limit: f64| {
        while points(h) > limit {
            h *= 1.01;
        }
        h
    };
    match asked {
        None => Ok(fitting((extent.max_element() / 64.0).min(extent.min_element() / 3.0), SMALL)),
        Some(h) if !(h > 0.0 && h.is_finite()) => Err(DistanceFieldError::Spacing(h)),
        Some(h) if points(h) > LIMIT => {
            // A little more, so that the number holds as it is printed.
            let fits = 1.01 * fitting(h.max(extent.max_element() / LIMIT), LIMIT);
            Err(DistanceFieldError::TooFine { spacing: h, points: points(h), fits })
        }
        Some(h) => Ok(h),
    }
}

/// Whether a triangle names three vertices.
fn is_proper([a, b, c]: &[u32; 3]) -> bool {
    a != b && b != c && c != a
}

/// Refuses what is not a closed, consistently wound surface of finite points.
fn check(points: &[DVec3], triangles: &[[u32; 3]]) -> Result<(), DistanceFieldError> {
    for (triangle, t) in triangles.iter().enumerate() {
        if let Some(&vertex) = t.iter().find(|&&v| v as usize >= points.len()) {
            return Err(DistanceFieldError::Index { triangle, vertex, points: points.len() });
        }
    }
    if let Some(point) = points.iter().position(|p| !p.is_finite()) {
        return Err(DistanceFieldError::NotFinite(point));
    }
    let mut edges: Vec<_> = triangles
        .iter()
        .filter(|t| is_proper(t))
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| ([a.min(b), a.max(b)], a < b))
        .collect();
    if edges.is_empty() {
        return Err(DistanceFieldError::NoTriangles);
    }
    edges.sort_unstable();
    let (mut torn, mut odd) = ([Vec::new(), Vec::new()], Vec::new());
    for edge in edges.chunk_by(|a, b| a.0 == b.0) {
        match edge {
            [a, b] if a.1 != b.1 => {}
            [a, _] => odd.push(a.0),
            _ => torn[usize::from(edge.len() > 1)].push(edge[0].0),
        }
    }
    if let Some(&first) = torn.iter().flatten().min() {
        let [open, crowded] = torn.map(|edges| edges.len());
        return Err(DistanceFieldError::NotClosed { open, crowded, first });
    }
    odd.first()
        .map_or(Ok(()), |&first| Err(DistanceFieldError::Winding { edges: odd.len(), first }))
}

/// Normal, twice the area (m^2) long.
fn normal([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// A triangle, which may be a line or a point.
struct Face {
    corners: [DVec3; 3],
    /// Of length 1; zero for a needle, whose normal cannot be trusted and whose edges are near enough.
    normal: DVec3,
    /// Place in the mesh, which settles draws.
    number: usize,
}

impl Face {
    fn new((number, [a, b, c]): (usize, [DVec3; 3])) -> Self {
        let normal = normal(&[a, b, c]);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let needle = normal.length() <= 1e-8 * longest * longest;
        let normal = if needle { DVec3::ZERO } else { normal.normalize() };
        Self { corners: [a, b, c], normal, number }
    }

    /// Lowers `best` to the squared distance (m^2) of `p` and says so.
    fn lower(&self, p: DVec3, best: &mut f64) -> bool {
        let [a, b, c] = self.corners;
        let height = self.normal.dot(p - a);
        if height * height >= *best {
            return false;
        }
        let sides = [(p - a, b - a), (p - b, c - b), (p - c, a - c)];
        let above = self.normal != DVec3::ZERO
            && sides.iter().all(|(from, edge)| self.normal.cross(*edge).dot(*from) > 0.0);
        let to_edge = |&(from, edge): &(DVec3, DVec3)| {
            let length = edge.length_squared();
            let t = if length > 0.0 { edge.dot(from) / length } else { 0.0 };
            (from - edge * t.clamp(0.0, 1.0)).length_squared()
        };
        let squared = if above {
            height * height
        } else {
            sides.iter().map(to_edge).fold(f64::INFINITY, f64::min)
        };
        let lower = squared < *best;
        *best = best.min(squared);
        lower
    }
}

/// A box about the triangles `first..first + count`; where `count` is 0, about the next node and node `first`.
struct Node {
    lower: DVec3,
    upper: DVec3,
    /// The mean normal, and how far along it the triangles begin and end.
    axis: DVec3,
    slab: [f64; 2],
    first: usize,
    count: usize,
}

impl Node {
    fn distance_squared(&self, p: DVec3) -> f64 {
        let height = self.axis.dot(p);
        let beyond = (self.slab[0] - height).max(height - self.slab[1]).max(0.0);
        let outside = (self.lower - p).max(p - self.upper).max(DVec3::ZERO);
        outside.length_squared().max(beyond * beyond)
    }
}

/// Adds the node about `faces`, the first of which is number `first` of all, and those below it.
fn grow(nodes: &mut Vec<Node>, faces: &mut [Face], first: usize) {
    let corners = || faces.iter().flat_map(|face| face.corners);
    let lower = corners().fold(DVec3::INFINITY, DVec3::min);
    let upper = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    let axis = faces.iter().map(|face| normal(&face.corners)).sum::<DVec3>().normalize_or_zero();
    let heights = || corners().map(|v| axis.dot(v));
    let slab =
        [heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max)];
    let node = nodes.len();
    nodes.push(Node { lower, upper, axis, slab, first, count: faces.len() });
    if faces.len() <= 4 {
        faces.sort_unstable_by_key(|face| face.number);
        return;
    }
    let along = (upper - lower).max_position();
    let key = |face: &Face| face.corners.iter().sum::<DVec3>()[along];
    let order = |a: &Face, b: &Face| key(a).total_cmp(&key(b)).then(a.number.cmp(&b.number));
    let half = faces.len() / 2;
    faces.select_nth_unstable_by(half, order);
    let (left, right) = faces.split_at_mut(half);
    grow(nodes, left, first);
    (nodes[node].first, nodes[node].count) = (nodes.len(), 0);
    grow(nodes, right, first + half);
}

/// Triangles in a tree of boxes, halved at the median of their centres along the longest side.
struct Tree {
    nodes: Vec<Node>,
    faces: Vec<Face>,
}

impl Tree {
    fn new(faces: Vec<[DVec3; 3]>) -> Self {
        let mut faces: Vec<_> = faces.into_iter().enumerate().map(Face::new).collect();
        let mut nodes = Vec::new();
        grow(&mut nodes, &mut faces, 0);
        Self { nodes, faces }
    }

    /// Lowers `best`, a squared distance (m^2) and its triangle, to that of the triangle nearest to `p`.
    fn nearest(&self, node: usize, p: DVec3, best: &mut (f64, usize)) {
        let Node { first, count, .. } = self.nodes[node];
        for i in first..first + count {
            if self.faces[i].lower(p, &mut best.0) {
                best.1 = i;
            }
        }
        if count == 0 {
            let mut children = [node + 1, first].map(|c| (self.nodes[c].distance_squared(p), c));
            if children[1].0 < children[0].0 {
                children.swap(0, 1);
            }
            for (squared, child) in children {
                if squared < best.0 {
                    self.nearest(child, p, best);
                }
            }
        }
    }

    /// Where the line through `at` along x crosses triangles, in order, with the change of the winding number.
    fn crossings(&self, at: DVec3, found: &mut Vec<(f64, i32)>) {
        // Changes sum to zero unless rounding misled the count: then a line next to it serves.
        for tries in 0..8 {
            found.clear();
            let nearby = self.nodes[0].upper.max_element() * 1e-12 * f64::from(tries);
            self.cross(0, at + nearby, found);
            if found.iter().map(|c| c.1).sum::<i32>() == 0 {
                break;
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
    }

    fn cross(&self, node: usize, at: DVec3, found: &mut Vec<(f64, i32)>) {
        let Node { lower, upper, first, count, .. } = self.nodes[node];
        if at.y < lower.y || at.y > upper.y || at.z < lower.z || at.z > upper.z {
            return;
        }
        if count == 0 {
            self.cross(node + 1, at, found);
            self.cross(first, at, found);
        }
        for face in &self.faces[first..first + count] {
            let [a, b, c] = face.corners.map(|v| v - at);
            let det = |a: DVec3, b: DVec3| a.y * b.z - a.z * b.y;
            let left = |a: DVec3, b: DVec3| match det(a, b) {
                // As if `at` were moved by a tiny step along y and a far smaller one along z.
                0.0 if a.z != b.z => a.z > b.z,
                0.0 => b.y > a.y,
                d => d > 0.0,
            };
            let outward = left(a, b);
            if left(b, c) == outward && left(c, a) == outward {
                let (u, v, w) = (det(b, c), det(c, a), det(a, b));
                let sum = u + v + w;
                let x = if sum == 0.0 { a.x } else { (u * a.x + v * b.x + w * c.x) / sum };
                found.push((at.x + x, if outward { -1 } else { 1 }));
            }
        }
    }

    fn signed_distance(&self, p: DVec3) -> f64 {
        let (mut best, mut found) = ((f64::INFINITY, 0), Vec::new());
        self.nearest(0, p, &mut best);
        self.crossings(p, &mut found);
        let number: i32 = found.iter().filter(|c| c.0 <= p.x).map(|c| c.1).sum();
        if number == 0 { best.0.sqrt() } else { -best.0.sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use sinew_engine::mesh::generate::sphere_triangles;

    type Surface = (Vec<DVec3>, Vec<[u32; 3]>);

    /// A sphere of radius 1 of `20 n^2` triangles.
    fn sphere(n: usize) -> Surface {
        let mesh = sphere_triangles(1.0, n).unwrap();
        (mesh.points, mesh.triangles)
    }

    fn cuboid(half: DVec3) -> Surface {
        let corner = |i: u32| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
        let points = (0..8).map(|i| (2.0 * corner(i) - 1.0) * half).collect();
        let quads =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        (points, quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
    }

    fn cuboid_distance(half: DVec3, p: DVec3) -> f64 {
        let q = p.abs() - half;
        q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
    }

    /// Two surfaces as one.
    fn both(mut a: Surface, b: Surface) -> Surface {
        let n = a.0.len() as u32;
        a.0.extend(b.0);
        a.1.extend(b.1.iter().map(|t| t.map(|v| v + n)));
        a
    }

    fn turned((points, triangles): Surface) -> Surface {
        (points, triangles.iter().map(|&[a, b, c]| [a, c, b]).collect())
    }

    fn field((points, triangles): &Surface) -> DistanceField {
        DistanceField::new(points, triangles, None).unwrap()
    }

    /// The error against `exact`, in accuracies, at `n` random places within two spacings of the surface, half of
    /// them about the vertices; it also demands the sign of what is farther from the surface than the accuracy.
    fn worst_error(field: &DistanceField, n: usize, exact: impl Fn(DVec3) -> f64) -> f64 {
        let (mut seed, mut worst, mut near) = (42, 0.0_f64, 0);
        while near < n {
            let t = field.triangles[(random(&mut seed) * field.triangles.len() as f64) as usize];
            let [a, b, c] = t.map(|v| field.points[v as usize]);
            let r = random_in_cube(&mut seed, 0.5) + 0.5;
            let place =
                if near % 2 == 0 { (a * r.x + b * r.y + c * r.z) / r.element_sum() } else { a };
            let p = place + random_in_cube(&mut seed, 2.0 * field.spacing);
            let (found, exact) = (field.distance(p).0, exact(p));
            if exact.abs() <= 2.0 * field.spacing {
                near += 1;
                worst = worst.max((found - exact).abs() / field.accuracy);
                assert!(
                    exact.abs() <= field.accuracy || found * exact > 0.0,
                    "{p}: {found}, {exact}"
                );
            }
        }
        worst
    }

    #[test]
    fn a_sphere_is_between_its_inner_and_outer_ball() {
        let ball = sphere(16);
        let field = field(&ball);
        // The inner ball touches the middles of the largest triangles.
        let plane = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| ball.0[v as usize]);
            a.dot((b - a).cross(c - a).normalize())
        };
        let sag = 1.0 - ball.1.iter().map(plane).fold(f64::INFINITY, f64::min);
        assert!(sag < 0.05 * field.spacing && field.accuracy < 0.025 * field.spacing, "{field:?}");
        let mut seed = 1;
        for _ in 0..10_000 {
            let p = random_in_cube(&mut seed, 1.0).normalize()
                * (1.0 + random_in_cube(&mut seed, 0.06).x);
            let ((found, gradient), smooth) = (field.distance(p), p.length() - 1.0);
            assert!(found >= smooth - field.accuracy && found <= smooth + sag + field.accuracy);
            assert!((gradient - p.normalize()).length() < 0.05, "{p}: {gradient}");
        }
        assert!((field.distance(DVec3::ZERO).0 + 1.0).abs() < 0.1 * field.spacing);
    }

    #[test]
    fn the_tree_finds_the_nearest_triangle_and_counts_crossings_once() {
        let (points, triangles) = sphere(6);
        let tree = Tree::new(triangles.iter().map(|t| t.map(|v| points[v as usize])).collect());
        let mut seed = 4;
        for i in 0..1000 {
            let p = random_in_cube(&mut seed, [0.1, 2.0][i % 2]);
            let one_by_one = |face: &Face| {
                let mut best = f64::INFINITY;
                face.lower(p, &mut best);
                best
            };
            let least = tree.faces.iter().map(one_by_one).fold(f64::INFINITY, f64::min).sqrt();
            assert!((tree.signed_distance(p).abs() - least).abs() < 1e-14, "{p}: {least}");
        }
        // Lines through vertices and along edges, without the way out of moving them.
        let (corners, quads) = cuboid(DVec3::new(1.0, 0.75, 0.5));
        let cuboid = Tree::new(quads.iter().map(|t| t.map(|v| corners[v as usize])).collect());
        let crossings = |tree: &Tree, at: DVec3| {
            let mut found = Vec::new();
            tree.cross(0, at, &mut found);
            assert_eq!(found.iter().map(|c| c.1).sum::<i32>(), 0, "{at}: {found:?}");
            found.len()
        };
        assert!(points.iter().chain(&corners).all(|&p| crossings(&tree, p) <= 2));
        for i in 0..81 {
            let [y, z] = [i % 9 - 4, i / 9 - 4].map(f64::from);
            let found = crossings(&cuboid, DVec3::new(0.0, y * 0.1875, z * 0.125));
            assert!(found == 2 || found == 0 && y.abs().max(z.abs()) == 4.0, "{y} {z}: {found}");
        }
    }

    #[test]
    fn boxes_have_their_distances_within_the_accuracy() {
        let (half, turn) =
            (DVec3::new(1.0, 0.7, 0.4), DQuat::from_xyzw(0.1, 0.2, 0.3, 0.9).normalize());
        let (points, triangles) = cuboid(half);
        let tilted = (points.iter().map(|&p| turn * p).collect(), triangles.clone());
        let straight = field(&(points, triangles));
        let tilted = field(&tilted);
        for (field, turn) in [(&straight, DQuat::IDENTITY), (&tilted, turn)] {
            assert!(field.accuracy < 0.36 * field.spacing, "{}", field.accuracy / field.spacing);
            let worst = worst_error(field, 50_000, |p| cuboid_distance(half, turn.inverse() * p));
            assert!(worst > 0.5 && worst <= 1.0, "{worst}");
        }
        // The exact distance, which gives the samples, has the right sign however near an edge or a corner is.
        let faces = tilted.triangles.iter().map(|t| t.map(|v| tilted.points[v as usize])).collect();
        let (tree, mut seed) = (Tree::new(faces), 3);
        for i in 0..1000 {
            let at = [half, half.with_x(0.2), half.with_z(-0.1), half.with_y(0.0)][i % 4];
            let p = at + random_in_cube(&mut seed, [1e-6, 1e-3, 0.1][i % 3]);
            let (exact, found) = (cuboid_distance(half, p), tree.signed_distance(turn * p));
            assert!((exact - found).abs() < 1e-14 && exact * found > 0.0, "{p}: {exact}, {found}");
        }
    }

    #[test]
    fn cavities_and_parts_count_and_overlaps_are_refused() {
        let (outer, inner) = (DVec3::new(1.0, 0.9, 0.8), DVec3::new(0.5, 0.4, 0.3));
        let shell = field(&both(cuboid(outer), turned(cuboid(inner))));
        let exact = |p| cuboid_distance(outer, p).max(-cuboid_distance(inner, p));
        assert!(worst_error(&shell, 20_000, exact) <= 1.0);
        let moved = |s: Surface, by: DVec3| (s.0.iter().map(|&p| p + by).collect(), s.1);
        let two = both(cuboid(inner), moved(cuboid(inner), DVec3::X * 1.4));
        let exact = |p| cuboid_distance(inner, p).min(cuboid_distance(inner, p - DVec3::X * 1.4));
        assert!(worst_error(&field(&two), 20_000, exact) <= 1.0);
        let refused = |s: Surface| DistanceField::new(&s.0, &s.1, None).unwrap_err();
        let crossed = both(cuboid(inner), moved(cuboid(inner), DVec3::splat(0.3)));
        assert!(matches!(refused(crossed), DistanceFieldError::Overlap { number: 2, .. }));
        let against = both(cuboid(outer), moved(turned(cuboid(inner)), DVec3::X * 2.0));
        assert!(matches!(refused(against), DistanceFieldError::Overlap { number: -1, .. }));
    }

    #[test]
    fn bad_meshes_are_named() {
        let (points, triangles) = cuboid(DVec3::ONE);
        let refused = |points: &[DVec3], triangles: &[[u32; 3]], spacing| {
            DistanceField::new(points, triangles, spacing).unwrap_err()
        };
        assert_eq!(refused(&points, &[], None), DistanceFieldError::NoTriangles);
        let index = refused(&points, &[[0, 1, 2], [3, 8, 4]], None);
        assert_eq!(index, DistanceFieldError::Index { triangle: 1, vertex: 8, points: 8 });
        let mut broken = points.clone();
        broken[3].y = f64::NAN;
        assert_eq!(refused(&broken, &triangles, None), DistanceFieldError::NotFinite(3));
        let open = refused(&points, &triangles[1..], None);
        assert_eq!(open, DistanceFieldError::NotClosed { open: 3, crowded: 0, first: [0, 2] });
        let mut more = triangles.clone();
        more.push(more[0]);
        let crowded = refused(&points, &more, None);
        assert_eq!(crowded, DistanceFieldError::NotClosed { open: 0, crowded: 3, first: [0, 2] });
        let mut odd = triangles.clone();
        odd[0].swap(0, 1);
        assert_eq!(
            refused(&points, &odd, None),
            DistanceFieldError::Winding { edges: 3, first: [0, 2] }
        );
        let flat: Vec<_> = points.iter().map(|p| p.with_z(0.0)).collect();
        assert!(matches!(refused(&flat, &triangles, None), DistanceFieldError::Flat(_)));
        for bad in [0.0, -1.0, f64::INFINITY] {
            assert_eq!(refused(&points, &triangles, Some(bad)), DistanceFieldError::Spacing(bad));
        }
        let DistanceFieldError::TooFine { fits, .. } = refused(&points, &triangles, Some(1e-9))
        else {
            panic!()
        };
        assert!(fits > 2.0 / 256.0 && fits < 2.2 / 248.0, "{fits}");
        // A thin plate would have 3000 x 3000 points at a third of its thickness.
        let plate = field(&cuboid(DVec3::new(1.0, 1.0, 1e-3)));
        assert!(plate.coefficients.len() <= 1 << 20 && plate.accuracy > 1e-3);
    }

    #[test]
    fn a_mesh_inside_out_is_turned_and_fields_are_shared() {
        let (ball, inverse) = (sphere(2), turned(sphere(2)));
        let (a, b) = (field(&ball), field(&inverse));
        assert!(!a.was_turned() && b.was_turned() && a.triangles() == b.triangles());
        assert_eq!(a.coefficients, b.coefficients);
        let cached = |s: &Surface, h| DistanceField::cached(&s.0, &s.1, h).unwrap();
        let first = cached(&inverse, Some(0.1));
        assert!(Arc::ptr_eq(&first, &cached(&inverse, Some(0.1))));
        assert!(!Arc::ptr_eq(&first, &cached(&inverse, Some(0.2))));
        assert!(!Arc::ptr_eq(&first, &cached(&ball, Some(0.1))));
    }

    #[test]
    fn the_gradient_is_the_derivative_and_the_field_is_continuous() {
        let half = DVec3::new(1.0, 0.7, 0.4);
        let field = field(&cuboid(half));
        let (step, mut seed) = (1e-4 * field.spacing, 9);
        for i in 0..3000 {
            // Places within the grid and beyond its box.
            let p = random_in_cube(&mut seed, [1.05, 3.0][i % 2]);
            let (value, gradient) = field.distance(p);
            for (a, axis) in DVec3::AXES.into_iter().enumerate() {
                let [more, less] = [step, -step].map(|d| field.distance(p + axis * d).0);
                let slope = (more - less) / (2.0 * step);
                assert!((slope - gradient[a]).abs() < 1e-6, "{p}: {gradient}, {slope}");
            }
            assert!(value - cuboid_distance(half, p) < field.accuracy, "{p}: {value}");
        }
        assert!(
            field.distance(DVec3::NAN).0.is_nan()
                && field.distance(DVec3::INFINITY).0 == f64::INFINITY
        );
        let [lower, upper] = field.bounds();
        for i in 0..1000 {
            let mut p = lower + (random_in_cube(&mut seed, 0.5) + 0.5) * (upper - lower);
            p[i % 3] = upper[i % 3] + 2.0 * field.spacing;
            let slopes = [-1.0, 0.0, 1.0, 2.0].map(|d| {
                let mut p = p;
                p[i % 3] += (d + 0.5) * 1e-9;
                field.distance(p).0
            });
            assert!(slopes.windows(2).all(|s| (s[1] - s[0]).abs() < 2e-9), "{p}: {slopes:?}");
        }
    }

    #[test]
    fn far_from_the_origin_the_field_is_the_same() {
        let (points, triangles) = sphere(4);
        let by = DVec3::new(1024.0, -4096.0, 256.0);
        // Coordinates that the sum keeps exactly.
        let points: Vec<_> = points.iter().map(|p| (p * 1048576.0).round() / 1048576.0).collect();
        let far: Vec<_> = points.iter().map(|p| p + by).collect();
        let (near, far) = (field(&(points, triangles.clone())), field(&(far, triangles)));
        let mut seed = 2;
        for _ in 0..1000 {
            let p = random_in_cube(&mut seed, 1.5);
            let ((a, n), (b, m)) = (near.distance(p), far.distance(p + by));
            assert!((a - b).abs() < 1e-11 && (n - m).length() < 1e-9, "{p}: {a}, {b}");
        }
    }
}
