//! Faces of linear tetrahedra that a blade parts, and what lies on them. A face is moved linearly by three vertices or ghosts, so that
//! first moments of its parts are all that forces on them and masses need to know.

use sinew_engine::connectivity::ElementKind;
use sinew_engine::layout::WHOLE_TRIANGLE;
use sinew_engine::row::VertexRow;
use sinew_engine::topology::{BodyRows, Topology};
use std::collections::{BTreeMap, BTreeSet};

use super::material::{Material, Order};
use super::{kind_of, row_of};
use crate::body::present::{BodyResection, Resection};

/// A membrane triangle on a face of elements, or a copy of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheet {
    /// Its vertices in the mesh, ascending.
    pub vertices: [u32; 3],
    /// The vertices or ghosts that move it.
    pub nodes: [u32; 3],
    /// Triangle of the mesh that it is a copy of, or itself.
    pub source: u32,
    /// Triangle that it fell off, or itself.
    pub parent: u32,
    /// Part of the area of the whole triangle that lies at each vertex: integrals of linear shape functions.
    pub portion: [f64; 3],
    /// Whether it was removed.
    pub is_gone: bool,
}

impl Sheet {
    /// One of the mesh.
    pub(super) fn whole((source, mut vertices): (u32, [u32; 3])) -> Self {
        vertices.sort_unstable();
        let (nodes, parent, portion) = (vertices, source, WHOLE_TRIANGLE);
        Self { vertices, nodes, source, parent, portion, is_gone: false }
    }
}

/// Which membrane triangle lies on a face of an element.
type Covers = BTreeMap<([u32; 3], u32), u32>;

/// Part of a face of the mesh that the same three vertices or ghosts move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FacePart {
    /// They (in a [`Material`] its numbers), in the order of the vertices of the face.
    pub nodes: [u32; 3],
    /// Integrals of their shape functions over it, as parts of the area of the whole face: a third each if it is that.
    pub moments: [f64; 3],
}

impl FacePart {
    /// Adds it to what the same vertices move, or to the list.
    fn add_to(self, parts: &mut Vec<Self>) {
        match parts.iter_mut().find(|own| own.nodes == self.nodes) {
            Some(own) => (0..3).for_each(|i| own.moments[i] += self.moments[i]),
            None => parts.push(self),
        }
    }
}

/// Triangle of the material on a face of the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceCell {
    /// Vertices of the face, ascending.
    pub face: [u32; 3],
    /// Element that has it.
    pub element: u32,
    /// What that moves the vertices of the face by, and the moments of the triangle.
    pub part: FacePart,
    /// Another element has it, too, and comes first.
    pub is_twin: bool,
}

/// A point by its vertices and the bits of their weights: points on either side of a face that was opened have different numbers.
type Place = ([u32; 4], [u64; 4]);

impl Material {
    /// The triangles on some faces, given by their vertices, ascending, of elements that are left; none of a membrane alone.
    pub(super) fn face_cells(
        &self,
        faces: &BTreeSet<[u32; 3]>,
        is_left: impl Fn(u32) -> bool,
    ) -> Vec<FaceCell> {
        if faces.is_empty() || self.order == Order::Triangles {
            return Vec::new();
        }
        let mut is_near = vec![false; self.vertices as usize];
        faces.iter().flatten().for_each(|&v| is_near[v as usize] = true);
        let mut known = BTreeSet::<[Place; 3]>::new();
        let mut found = Vec::new();
        for cell in &self.cells {
            let element = &self.elements[cell.element as usize];
            let near = element.vertices.iter().filter(|v| is_near[**v as usize]);
            if near.count() < 3 || !is_left(cell.element) {
                continue;
            }
            for opposite in 0..4 {
                let mut face = [1, 2, 3].map(|i| element.vertices[(opposite + i) % 4]);
                face.sort_unstable();
                if !faces.contains(&face) {
                    continue;
                }
                let weights = cell.corners.map(|p| {
                    let point = &self.points[p as usize];
                    (point.weights_in(element.vertices)[opposite] == 0.0)
                        .then(|| point.weights_in([face[0], face[1], face[2], u32::MAX]))
                });
                let on = (0..4).filter(|&i| weights[i].is_some()).collect::<Vec<usize>>();
                let &[i, j, k] = &on[..] else { continue };
                let [a, b, c] = [i, j, k].map(|i| weights[i].unwrap_or_default());
                let minor = |x: usize, y: usize| b[x] * c[y] - b[y] * c[x];
                let area = (a[0] * minor(1, 2) + a[1] * minor(2, 0) + a[2] * minor(0, 1)).abs();
                let mut places = [i, j, k].map(|i| {
                    let point = &self.points[cell.corners[i] as usize];
                    (point.vertices, point.weights.map(f64::to_bits))
                });
                places.sort_unstable();
                let node = |v: u32| {
                    let at = element.vertices.iter().position(|&own| own == v);
                    element.nodes[at.unwrap_or(0)]
                };
                let moments = [0, 1, 2].map(|i| area * ((a[i] + b[i] + c[i]) / 3.0));
                found.push(FaceCell {
                    face,
                    element: cell.element,
                    part: FacePart { nodes: face.map(node), moments },
                    is_twin: !known.insert(places),
                });
            }
        }
        found
    }

    /// Faces of membrane triangles that are left.
    fn covered(&self) -> BTreeSet<[u32; 3]> {
        self.sheets.iter().filter(|sheet| !sheet.is_gone).map(|sheet| sheet.vertices).collect()
    }

    /// The membrane triangles that are left, by what has them.
    pub(super) fn covers(&self) -> Covers {
        if self.sheets.is_empty() {
            return Covers::default();
        }
        let left = (0..).zip(&self.sheets).filter(|(_, sheet): &(u32, _)| !sheet.is_gone);
        let moved: BTreeMap<_, u32> =
            left.map(|(number, sheet)| ((sheet.vertices, sheet.nodes), number)).collect();
        let cells = self.face_cells(&self.covered(), |_| true).into_iter();
        let of = |cell: FaceCell| {
            let sheet = moved.get(&(cell.face, cell.part.nodes))?;
            Some(((cell.face, cell.element), *sheet))
        };
        cells.filter_map(of).collect()
    }

    /// Lets membrane triangles come apart with elements, of which so many were known before. What a face of them was covered by covers
    /// its parts.
    pub(super) fn part_sheets(&mut self, covers: &Covers, known: u32) {
        if covers.is_empty() {
            return;
        }
        let mut parts = BTreeMap::<u32, Vec<FacePart>>::new();
        let cells = self.face_cells(&self.covered(), |_| true);
        for FaceCell { face, mut element, part, .. } in cells.into_iter().filter(|c| !c.is_twin) {
            while element >= known {
                element = self.elements[element as usize].parent;
            }
            if let Some(&sheet) = covers.get(&(face, element)) {
                part.add_to(parts.entry(sheet).or_default());
            }
        }
        for (number, parts) in parts {
            let own = self.sheets[number as usize];
            for (at, part) in parts.iter().enumerate() {
                // what did not come apart is not summed again
                let portion = if parts.len() == 1 { own.portion } else { part.moments };
                let sheet = Sheet { nodes: part.nodes, portion, ..own };
                match at {
                    0 => self.sheets[number as usize] = sheet,
                    _ => self.sheets.push(Sheet { parent: number, ..sheet }),
                }
            }
        }
    }

    /// Whether membrane triangles that are left lie on elements with all of their area.
    pub(super) fn bears_sheets(&self) -> bool {
        if self.order == Order::Triangles {
            return true;
        }
        let mut areas: Vec<f64> =
            self.sheets.iter().map(|sheet| sheet.portion.iter().sum()).collect();
        let covers = self.covers();
        for cell in self.face_cells(&self.covered(), |_| true).iter().filter(|c| !c.is_twin) {
            if let Some(&sheet) = covers.get(&(cell.face, cell.element)) {
                areas[sheet as usize] -= cell.part.moments.iter().sum::<f64>();
            }
        }
        let borne = |(sheet, area): (&Sheet, &f64)| sheet.is_gone || area.abs() < 1e-9;
        self.sheets.iter().zip(&areas).all(borne)
    }
}

impl BodyResection {
    /// What of faces of a body that was cut is left, by the vertices of the mesh, ascending.
    fn parts(
        &self,
        rows: &BodyRows,
        faces: &BTreeSet<[u32; 3]>,
    ) -> BTreeMap<[u32; 3], Vec<FacePart>> {
        let mut parts = BTreeMap::<[u32; 3], Vec<FacePart>>::new();
        let Some(material) = self.material.as_ref().filter(|own| own.order.is_linear()) else {
            return parts;
        };
        let kind = kind_of(rows);
        let is_left =
            |e: u32| self.connectivity.is_present(kind, self.element_of[kind][e as usize]);
        for FaceCell { face, part, .. } in
            material.face_cells(faces, is_left).into_iter().filter(|cell| !cell.is_twin)
        {
            part.add_to(parts.entry(face).or_default());
        }
        // what lies on a face goes on where its elements went
        let sheets = (0..).zip(&material.sheets);
        let left = sheets.filter(|(t, sheet): &(u32, &Sheet)| {
            let row = self.element_of[ElementKind::Triangle][*t as usize];
            faces.contains(&sheet.vertices)
                && self.connectivity.is_present(ElementKind::Triangle, row)
        });
        for (_, sheet) in left {
            let all = parts.entry(sheet.vertices).or_default();
            let part = FacePart { nodes: sheet.nodes, moments: sheet.portion };
            // on a solid the same vertices move what was found; of a membrane alone also two copies that hang together round a slit
            let is_found = all.iter().any(|own| own.nodes == sheet.nodes);
            if material.order == Order::Triangles || !is_found {
                part.add_to(all);
            }
        }
        parts
    }

    /// [`face_parts`] of one body.
    pub(crate) fn face_parts(
        &self,
        rows: &BodyRows,
        faces: &[[VertexRow; 3]],
    ) -> Vec<Option<Vec<FacePart>>> {
        let vertices = |face: &[VertexRow; 3]| {
            let is_own = face.iter().all(|row| rows.vertices.contains(&row.0));
            is_own.then(|| face.map(|row| rows.vertex(row).0))
        };
        let ascending = |mut face: [u32; 3]| {
            face.sort_unstable();
            face
        };
        let asked = faces.iter().filter_map(vertices).map(ascending).collect();
        let parts = self.parts(rows, &asked);
        let of = |face: &[VertexRow; 3]| {
            let face = vertices(face)?;
            let key = ascending(face);
            let at = face.map(|v| key.iter().position(|own| *own == v).unwrap_or(0));
            let turned = |part: &FacePart| FacePart {
                nodes: at.map(|i| rows.vertices.start + row_of(rows, part.nodes[i])),
                moments: at.map(|i| part.moments[i]),
            };
            Some(parts.get(&key)?.iter().map(turned).collect())
        };
        faces.iter().map(of).collect()
    }
}

/// The parts of those of some faces that elements of bodies that were cut have: rows of the world in the order of the corners of the
/// face, and their moments. `None` for all others, which act as they are. `resection` is that of the world.
pub fn face_parts(
    topology: &Topology,
    resection: Option<&Resection>,
    faces: &[[VertexRow; 3]],
) -> Vec<Option<Vec<FacePart>>> {
    let mut all = vec![None; faces.len()];
    let bodies = resection.map_or(&[][..], |resection| &resection.bodies);
    for (rows, own) in topology.bodies.iter().zip(bodies) {
        let Some(own) = own.as_ref().filter(|own| own.material.is_some()) else { continue };
        for (all, own) in all.iter_mut().zip(own.face_parts(rows, faces)) {
            *all = all.take().or(own);
        }
    }
    all
}
