//! The numbers of a body that follow from its elements, their rest shapes and what they are made of: masses and
//! constants of springs. [`spawn_body`](super::spawn_body), [`set_material`](super::change::set_material) and
//! removals compute them here, in one order of sums, so that they agree to the last bit.

use super::description::{MassRule, SoftBody};
use super::lumped::{self, ElementSprings, GivenSprings, SpringRule};
use super::sheet::{MembraneModel, MembraneSettings, PlaneState};
use crate::axes::description::{AxisFamily, biquadratic};
use crate::element::hourglass;
use crate::element::membrane::{self, RestTriangle};
use crate::element::precompute::{ADJACENT_PAIRS, RestTetrahedron, SpringConstants};
use crate::frame::rules::Evaluation;
use crate::laws::models::Model;
use crate::material::field::{MaterialField, SpringsError};
use crate::material::{LameParameters, YoungPoisson};
use glam::DVec3;
use sinew_engine::connectivity::{ByKind, ElementKind};
use sinew_engine::element::TETRAHEDRON_FACES;
use sinew_engine::isoparametric::{RestHexahedron, RestQuad, RestTetrahedron10};
use sinew_engine::layout::{BodyElements, Cells};
use sinew_engine::mesh::Filled;
use sinew_engine::row::LocalRow;
use sinew_engine::scalar::sub;
use sinew_identify::cells::Cells as Elements;
use sinew_identify::mass::{MassLumping, lumped_masses};
use sinew_identify::mesh::fit_each;
use sinew_identify::{
    ElementGeometry, ElementMethod, IdentifyError, LinearMaterial, Plane, Section,
};

/// A body as its numbers see it.
#[derive(Clone, Copy)]
pub(crate) struct Matter<'a> {
    /// Its vertices and elements.
    pub ordered: &'a BodyElements,
    /// Rest position (m) of a vertex row.
    pub rest_of: &'a dyn Fn(u32) -> DVec3,
    /// Material of its solid elements.
    pub field: MaterialField<'a>,
    /// Energy of its solid elements.
    pub model: Model,
    /// Evaluation of its solid elements.
    pub evaluation: Evaluation,
    /// Where the constants of its springs come from.
    pub spring_rule: Option<SpringRule>,
    /// Constants of its springs, where they are given.
    pub given: Option<&'a GivenSprings>,
    /// How the mass of an element is shared out.
    pub lumping: MassLumping,
    /// Whether all vertices have the same mass.
    pub equal_masses: bool,
    /// Its membrane.
    pub membrane: Option<MembraneSettings>,
    /// Fibres of its solid elements.
    pub families: &'a [AxisFamily<'a>],
    /// Fibres of its membrane.
    pub sheet_fibres: &'a [AxisFamily<'a>],
}

impl SoftBody {
    /// What its numbers follow from; `rest_of` gives the rest position (m) of a vertex row.
    pub(crate) fn matter<'a>(
        &'a self,
        ordered: &'a BodyElements,
        rest_of: &'a dyn Fn(u32) -> DVec3,
    ) -> Matter<'a> {
        let &Self { model, evaluation, spring_rule, masses, membrane, .. } = self;
        let (field, given, lumping) = (self.field(), self.given.as_deref(), masses.lumping());
        let equal_masses = masses == MassRule::Equal;
        let families = self.axes.as_ref().map_or(&[][..], |axes| &axes.description.families);
        Matter {
            ordered,
            rest_of,
            field,
            model,
            evaluation,
            spring_rule,
            given,
            lumping,
            equal_masses,
            membrane,
            families,
            sheet_fibres: &self.sheet_fibres,
        }
    }
}

/// Items of a body, each of which gets a sum.
#[derive(Clone, Copy)]
pub(crate) enum Items<'a> {
    /// So many, that is all.
    All(usize),
    /// Those listed, ascending.
    Only(&'a [u32]),
}

impl Items<'_> {
    fn count(self) -> usize {
        match self {
            Self::All(count) => count,
            Self::Only(list) => list.len(),
        }
    }

    fn place(self, item: u32) -> Option<usize> {
        match self {
            Self::All(_) => Some(item as usize),
            Self::Only(list) => list.binary_search(&item).ok(),
        }
    }

    fn item(self, place: usize) -> u32 {
        match self {
            Self::All(_) => place as u32,
            Self::Only(list) => list[place],
        }
    }
}

/// Elements of every kind, each list ascending.
pub(crate) type Chosen = ByKind<Vec<u32>>;

/// Elements of a body for which `is_left` says yes.
pub(crate) fn chosen(ordered: &BodyElements, is_left: impl Fn(ElementKind, u32) -> bool) -> Chosen {
    ByKind::of(|kind| (0..ordered.order[kind].len() as u32).filter(|&e| is_left(kind, e)).collect())
}

/// The rest shape of an element: it was found usable when the body was built.
macro_rules! rest_shapes {
    ($($name:ident, $list:ident, $shape:ident;)+) => {$(
        pub fn $name(&self, element: u32) -> $shape {
            let nodes = self.ordered.$list()[element as usize];
            let points = nodes.map(|v| (self.rest_of)(v).to_array());
            $shape::new(points).expect("the body was built with it")
        }
    )+};
}

impl Matter<'_> {
    rest_shapes! {
        tetrahedron, tetrahedra, RestTetrahedron;
        tetrahedron10, tetrahedra10, RestTetrahedron10;
        hexahedron, hexahedra, RestHexahedron;
        triangle, triangles, RestTriangle;
        quad, quads, RestQuad;
    }

    /// Place of a solid element in the arrays of the material: hexahedra follow tetrahedra.
    pub fn place(&self, kind: ElementKind, element: u32) -> usize {
        let user = self.ordered.source(kind, self.ordered.order[kind][element as usize]) as usize;
        let hexahedron = kind == ElementKind::Hexahedron;
        user + if hexahedron { self.ordered.mesh_elements(ElementKind::Tetrahedron) } else { 0 }
    }

    /// Material of a solid element.
    pub fn material(&self, kind: ElementKind, element: u32) -> YoungPoisson {
        self.field.at(self.place(kind, element))
    }

    /// What of its hexahedra is filled.
    pub fn filled(&self) -> Vec<Filled> {
        let hexahedra = 0..self.ordered.order.hexahedra.len() as u32;
        let filled = |h| self.field.filled_at(self.place(ElementKind::Hexahedron, h));
        hexahedra.map(filled).collect()
    }

    /// Its membrane, if the springs of that are those of the pooled systems.
    fn pooled_sheet(&self) -> Option<MembraneSettings> {
        self.membrane.filter(MembraneSettings::is_pooled)
    }

    /// Whether it has springs that are pooled.
    pub fn is_pooled(&self) -> bool {
        self.evaluation == Evaluation::Pooled || self.pooled_sheet().is_some()
    }

    /// Its membrane, if it consists of springs on edges alone.
    pub fn mass_spring_sheet(&self) -> Option<MembraneSettings> {
        self.membrane.filter(|m| m.model == MembraneModel::MassSpring)
    }

    /// Volumes (m^3) or areas (m^2) of the vertices of a hexahedron or quadrilateral by nodal quadrature
    /// (Natsupakpong & Cavusoglu 2010, equation 2); `None` for row sums.
    fn nodal_shares<const N: usize>(&self, nodes: [u32; N]) -> Option<[f64; N]> {
        if self.lumping == MassLumping::RowSum {
            return None;
        }
        let points = nodes.map(|v| (self.rest_of)(v).to_array());
        let kind = if N == 8 {
            sinew_identify::ElementKind::Hexahedron
        } else {
            sinew_identify::ElementKind::Quad
        };
        let geometry = ElementGeometry::new(kind, &points).ok()?;
        let shares = lumped_masses(&geometry, 1.0, &Section::default(), self.lumping).ok()?;
        shares.try_into().ok()
    }

    /// Masses (kg) of vertices, summed over elements: a quarter or third of each linear simplex, the
    /// [shares](sinew_engine::isoparametric::TETRAHEDRON10_MASSES) of ten-node tetrahedra, and the row sums of the mass matrix
    /// of others, or what nodal quadrature gives them.
    pub fn masses(&self, vertices: Items, elements: &Chosen) -> Vec<f64> {
        let mut mass = vec![0.0; vertices.count()];
        let mut add = |nodes: &[u32], shares: &[f64]| {
            for (&v, share) in nodes.iter().zip(shares) {
                if let Some(at) = vertices.place(v) {
                    mass[at] += share;
                }
            }
        };
        let density = |kind, e| self.material(kind, e).density;
        let tens = !self.ordered.tetrahedra10().is_empty();
        for &t in elements[ElementKind::Tetrahedron].iter().filter(|_| tens) {
            let density = density(ElementKind::Tetrahedron, t);
            let parted = self.ordered.lumps(ElementKind::Tetrahedron, t);
            let volumes =
                parted.map_or_else(|| self.tetrahedron10(t).vertex_volumes(), |own| own.mass);
            let nodes = self.ordered.tetrahedra10()[t as usize];
            add(&nodes, &volumes.map(|volume| density * volume));
        }
        for &t in elements[ElementKind::Tetrahedron].iter().filter(|_| !tens) {
            let mass = density(ElementKind::Tetrahedron, t) * self.tetrahedron(t).volume;
            let portion = self.ordered.copies.portions.get(t as usize);
            let shares = portion.map_or([mass / 4.0; 4], |portion| portion.map(|part| part * mass));
            add(&self.ordered.tetrahedra()[t as usize], &shares);
        }
        for &h in &elements[ElementKind::Hexahedron] {
            let density = density(ElementKind::Hexahedron, h);
            let nodes = self.ordered.hexahedra()[h as usize];
            let parted = self.ordered.lumps(ElementKind::Hexahedron, h);
            let parted = parted.map(|own| std::array::from_fn(|i| own.mass[i]));
            let volumes = parted.or_else(|| self.nodal_shares(nodes));
            let volumes = volumes.unwrap_or_else(|| {
                let points = nodes.map(|v| (self.rest_of)(v).to_array());
                let filled = self.field.filled_at(self.place(ElementKind::Hexahedron, h));
                hourglass::vertex_volumes(&self.hexahedron(h), &points, &filled)
            });
            add(&nodes, &volumes.map(|volume| density * volume));
        }
        let Some(sheet) = self.membrane else { return mass };
        let (_, density) = sheet.surface();
        for &t in &elements[ElementKind::Triangle] {
            let mass = density * self.triangle(t).area;
            let shares = match self.ordered.is_whole(ElementKind::Triangle, t) {
                true => [mass / 3.0; 3],
                false => self.ordered.sheet_portion(t).map(|part| part * mass),
            };
            add(&self.ordered.triangles()[t as usize], &shares);
        }
        for &q in &elements[ElementKind::Quad] {
            let nodes = self.ordered.quads()[q as usize];
            let areas = self.nodal_shares(nodes).unwrap_or_else(|| self.quad(q).vertex_areas());
            add(&nodes, &areas.map(|area| density * area));
        }
        mass
    }

    /// By how much (kg) the weight of vertices is that of another mass than [`masses`](Self::masses) gives them, summed over
    /// elements ([`WeightShift`](sinew_engine::vertex::WeightShift)).
    pub fn weight_shifts(&self, vertices: Items, elements: &Chosen) -> Vec<f64> {
        let mut shift = vec![0.0; vertices.count()];
        if self.ordered.tetrahedra10().is_empty() || self.equal_masses {
            return shift;
        }
        for &t in &elements[ElementKind::Tetrahedron] {
            let density = self.material(ElementKind::Tetrahedron, t).density;
            let rest = self.tetrahedron10(t);
            let nodes = self.ordered.tetrahedra10()[t as usize];
            let whole = || (rest.shape_volumes(), rest.vertex_volumes());
            let parted = self.ordered.lumps(ElementKind::Tetrahedron, t);
            let (weights, masses) = parted.map_or_else(whole, |own| (own.weight, own.mass));
            let both = weights.into_iter().zip(masses);
            for (v, (weight, mass)) in nodes.into_iter().zip(both) {
                if let Some(at) = vertices.place(v) {
                    shift[at] += density * (weight - mass);
                }
            }
        }
        shift
    }

    /// Constants (N/m^3) of edges that are springs by themselves, summed over elements, uniform ones counted once in
    /// the solid and once in the membrane; 0 where there is none.
    pub fn edge_springs(
        &self,
        springs: &ElementSprings,
        cells: &Cells,
        edges: Items,
        elements: &Chosen,
    ) -> Vec<f64> {
        let mut sums = vec![0.0; edges.count()];
        if springs.is_empty() {
            return sums;
        }
        let mut shared = [Vec::new(), Vec::new()];
        for kind in ElementKind::ALL {
            let of_sheet = matches!(kind, ElementKind::Triangle | ElementKind::Quad);
            let shared = &mut shared[usize::from(of_sheet)];
            if springs.is_uniform(kind) {
                shared.resize(edges.count(), 0.0);
            }
            for &e in &elements[kind] {
                for (&edge, &k) in cells.edges_of[kind].of(e).iter().zip(springs.of(kind, e)) {
                    match edges.place(edge) {
                        Some(at) if springs.is_uniform(kind) => shared[at] = k.max(shared[at]),
                        Some(at) => sums[at] += k,
                        None => {}
                    }
                }
            }
        }
        for shared in shared {
            sums.iter_mut().zip(shared).for_each(|(sum, k)| *sum += k);
        }
        for (at, sum) in sums.iter_mut().enumerate() {
            let [a, b] = cells.edges[edges.item(at) as usize].map(|v| (self.rest_of)(v).to_array());
            *sum = lumped::tensile_stiffness(*sum, sub(a, b));
        }
        sums
    }

    /// Constants of the springs of pooled elements, summed over elements, those of biquadratic fibres among them; `lame`
    /// are the Lamé parameters (Pa) of their tetrahedra.
    pub fn pooled_springs<'c>(
        &self,
        cells: &'c Cells,
        [edges, triangles]: [Items<'c>; 2],
        elements: &Chosen,
        lame: &[LameParameters],
    ) -> PooledSprings<'c> {
        let tensile = vec![0.0; edges.count()];
        let angular = vec![None; triangles.count()];
        let volumetric = Vec::new();
        let mut sums = PooledSprings { cells, edges, triangles, tensile, angular, volumetric };
        if self.evaluation == Evaluation::Pooled {
            for (&t, &lame) in elements[ElementKind::Tetrahedron].iter().zip(lame) {
                let rest = self.tetrahedron(t);
                let mut constants = SpringConstants::new(&rest, lame);
                let place = self.place(ElementKind::Tetrahedron, t);
                for (axis, modulus) in biquadratic(self.families, place) {
                    constants.add_fibre(&rest, axis.to_array(), modulus);
                }
                sums.add_tetrahedron(t, self.ordered.tetrahedra()[t as usize], &constants);
            }
        }
        if let Some(sheet) = self.pooled_sheet() {
            let (moduli, _) = sheet.surface();
            for &t in &elements[ElementKind::Triangle] {
                let rest = self.triangle(t);
                let mut constants = membrane::SpringConstants::new(&rest, moduli);
                let place = self.ordered.order.triangles[t as usize] as usize;
                for (axis, modulus) in biquadratic(self.sheet_fibres, place) {
                    let axis = rest.in_plane(axis.to_array()).expect("it was spawned with it");
                    constants.add_fibre(&rest, axis, modulus * sheet.thickness);
                }
                sums.add_triangle(t, &constants);
            }
        }
        sums
    }
}

/// Constants (N/m^3) of the springs of pooled elements.
pub(crate) struct PooledSprings<'a> {
    cells: &'a Cells,
    edges: Items<'a>,
    triangles: Items<'a>,
    /// Tensile springs of the edges; 0 where there is none.
    pub tensile: Vec<f64>,
    /// Angular springs of the triangles, `None` where there is none.
    pub angular: Vec<Option<[f64; 3]>>,
    /// Volumetric springs of the tetrahedra, in the order in which these were given.
    pub volumetric: Vec<[f64; 3]>,
}

impl PooledSprings<'_> {
    fn add_tensile(&mut self, edges: &[u32], constants: &[f64]) {
        for (&edge, k) in edges.iter().zip(constants) {
            if let Some(at) = self.edges.place(edge) {
                self.tensile[at] += k;
            }
        }
    }

    fn add_tetrahedron(&mut self, t: u32, nodes: [u32; 4], constants: &SpringConstants) {
        let cells = self.cells;
        self.volumetric.push(constants.volumetric);
        self.add_tensile(cells.edges_of.tetrahedra.of(t), &constants.tensile);
        for (c, [apex, j, k]) in constants.angular.iter().zip(ADJACENT_PAIRS) {
            // the face through the pair lies opposite the one vertex that it does not use
            let face = (0..4).find(|v| ![apex, j, k].contains(v)).unwrap_or(0);
            debug_assert!(TETRAHEDRON_FACES[face].contains(&apex));
            let triangle = cells.triangles_of.tetrahedra.of(t)[face];
            if let Some(at) = self.triangles.place(triangle) {
                let corners = cells.triangles[triangle as usize];
                let m = corners.iter().position(|&v| v == nodes[apex]).unwrap_or(0);
                self.angular[at].get_or_insert_default()[m] += c;
            }
        }
    }

    fn add_triangle(&mut self, t: u32, constants: &membrane::SpringConstants) {
        let cells = self.cells;
        self.add_tensile(cells.edges_of.triangles.of(t), &constants.tensile);
        if let Some(at) = self.triangles.place(cells.triangles_of.triangles.of(t)[0]) {
            let own = self.angular[at].get_or_insert_default();
            for m in 0..3 {
                own[m] += constants.angular[m];
            }
        }
    }
}

impl Matter<'_> {
    /// Spring constants of all elements that are springs.
    pub(crate) fn element_springs(&self) -> Result<ElementSprings, SpringsError> {
        let mut springs = ElementSprings::default();
        let (lists, none) = (self.ordered, Elements::default());
        for kind in ElementKind::ALL {
            let (cells, of_sheet, usual) = match kind {
                ElementKind::Tetrahedron => {
                    let cells = Elements { tetrahedra: lists.tetrahedra(), ..none };
                    (cells, false, ElementMethod::Delingette)
                }
                ElementKind::Triangle => (
                    Elements { triangles: lists.triangles(), ..none },
                    true,
                    ElementMethod::Delingette,
                ),
                ElementKind::Hexahedron => (
                    Elements { hexahedra: lists.hexahedra(), ..none },
                    false,
                    ElementMethod::Frobenius,
                ),
                ElementKind::Quad => {
                    (Elements { quads: lists.quads(), ..none }, true, ElementMethod::Frobenius)
                }
            };
            let sheet = self.mass_spring_sheet();
            let is_spring =
                if of_sheet { sheet.is_some() } else { self.model == Model::MassSpring };
            if !is_spring || cells.is_empty() {
                continue;
            }
            if let Some(given) = self.given {
                let user = |row: &u32| self.ordered.vertex_order[LocalRow(*row)].0;
                let of = |e: usize| cells.element(e).2.iter().map(user).collect::<Vec<_>>();
                springs.constants[kind] = (0..cells.len())
                    .flat_map(|e| given.constants(kind, &of(e)).collect::<Vec<_>>())
                    .collect();
                continue;
            }
            let rule = sheet.filter(|_| of_sheet).map_or(self.spring_rule, |sheet| sheet.springs);
            if let Some(SpringRule::Uniform(uniform)) = rule {
                springs.uniform[kind] = true;
                springs.constants[kind] = uniform.constants(kind).repeat(cells.len());
                continue;
            }
            let (materials, section) = match sheet.filter(|_| of_sheet) {
                Some(sheet) => (vec![linear(sheet.material)], section(&sheet)),
                None => {
                    let of = |e| linear(self.material(kind, e as u32));
                    let materials = (0..cells.len()).map(of).collect();
                    (materials, Section::default())
                }
            };
            let method = match rule {
                Some(SpringRule::Fitted(method)) => method,
                _ => usual,
            };
            springs.constants[kind] =
                self.fitted(&cells, &materials, &section, method).map_err(|(e, source)| {
                    let index = self.ordered.order[kind][e] as usize;
                    SpringsError { kind, index, method, source: Box::new(source) }
                })?;
        }
        if self.given.is_none() {
            // fits come in lexicographic order
            springs.constants[ElementKind::Triangle].chunks_exact_mut(3).for_each(<[f64]>::reverse);
        }
        springs.count(self.ordered);
        Ok(springs)
    }

    /// Constants (N/m) of elements of one kind; on failure the element, in the order of the layout.
    fn fitted(
        &self,
        cells: &Elements,
        materials: &[LinearMaterial],
        section: &Section,
        method: ElementMethod,
    ) -> Result<Vec<f64>, (usize, IdentifyError)> {
        let rows = (0..cells.len()).flat_map(|i| cells.element(i).2);
        let last = rows.max().copied().unwrap_or(0);
        let points: Vec<[f64; 3]> = (0..=last).map(|row| (self.rest_of)(row).to_array()).collect();
        let fits = fit_each(&points, cells, materials, section, method).map_err(|source| {
            let index = if let IdentifyError::Element { index, .. } = source { index } else { 0 };
            (index, source)
        })?;
        Ok((0..cells.len()).flat_map(|i| &fits.of(i).constants).copied().collect())
    }
}

fn linear(material: YoungPoisson) -> LinearMaterial {
    let YoungPoisson { young_modulus, poisson_ratio, .. } = material;
    LinearMaterial { youngs_modulus: young_modulus, poissons_ratio: poisson_ratio }
}

fn section(sheet: &MembraneSettings) -> Section {
    let plane = match sheet.plane {
        PlaneState::Stress => Plane::Stress,
        PlaneState::Strain => Plane::Strain,
    };
    Section { plane, thickness: sheet.thickness }
}
