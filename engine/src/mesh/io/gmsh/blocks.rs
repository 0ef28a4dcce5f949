//! Sections of version 4.1, which list nodes and elements by geometric entity.

use super::super::cells::too_many;
use super::super::scan::words;
use super::{CellKind, Reader, SAVE_AGAIN, UNKNOWN_KIND, cell_kind, in_order_of_vtk};
use crate::mesh::error::MeshError;

impl Reader<'_> {
    /// Physical tags of the geometric entities (4.1).
    pub(super) fn entities(&mut self) -> Result<(), MeshError> {
        let mut counts = [0; 4];
        if self.cursor.binary {
            for count in &mut counts {
                *count = self.size("the numbers of entities")?;
            }
        } else {
            let line = self.cursor.expect_line("the numbers of entities")?;
            let mut fields = words(line);
            for count in &mut counts {
                *count =
                    self.cursor.count(fields.next().unwrap_or(b""), "the numbers of entities")?;
            }
        }
        for (dimension, count) in (0u8..).zip(counts) {
            let reals = if dimension == 0 { 3 } else { 6 };
            for read in 0..count {
                if self.cursor.binary {
                    self.entity_binary(dimension, reals)?;
                } else {
                    self.entity_line(dimension, reals, count, read)?;
                }
            }
        }
        self.expect_end(
            b"$EndEntities",
            "entities",
            counts.iter().fold(0, |sum, &c| sum.saturating_add(c)),
        )
    }

    fn entity_binary(&mut self, dimension: u8, reals: usize) -> Result<(), MeshError> {
        let tag = self.int("the tag of an entity")?;
        self.cursor.take(8 * reals, "the box of an entity")?;
        let count = self.size("the number of physical tags")?;
        let count = self.cursor.room_for(count, 4, "physical tags")?;
        let mut physical = Vec::with_capacity(count);
        for _ in 0..count {
            physical.push(self.int("a physical tag")?);
        }
        if dimension > 0 {
            let count = self.size("the number of bounding entities")?;
            let count = self.cursor.room_for(count, 4, "bounding entities")?;
            self.cursor.take(4 * count, "bounding entities")?;
        }
        self.entities.insert((dimension, tag), physical);
        Ok(())
    }

    fn entity_line(
        &mut self,
        dimension: u8,
        reals: usize,
        count: u64,
        read: u64,
    ) -> Result<(), MeshError> {
        let expected = format!("entity {} of {count} of dimension {dimension}", read + 1);
        let line = self.cursor.expect_line(&expected)?;
        if line.starts_with(b"$") {
            let what = format!("the number of entities of dimension {dimension}");
            return Err(self.cursor.mismatch(&what, count, read));
        }
        let mut fields = words(line);
        let tag = self.cursor.integer(fields.next().unwrap_or(b""), "the tag of an entity")?;
        for _ in 0..reals {
            self.cursor.real(fields.next().unwrap_or(b""), "the box of an entity")?;
        }
        let count =
            self.cursor.count(fields.next().unwrap_or(b""), "the number of physical tags")?;
        let mut physical = Vec::new();
        for _ in 0..count {
            physical.push(self.cursor.integer(fields.next().unwrap_or(b""), "a physical tag")?);
        }
        self.entities.insert((dimension, tag), physical);
        Ok(())
    }

    /// The numbers on a header line of version 4.1, signed where `ints` counts them, or from bytes.
    fn header<const N: usize>(
        &mut self,
        ints: usize,
        expected: &str,
    ) -> Result<[i64; N], MeshError> {
        let mut values = [0; N];
        if self.cursor.binary {
            for (i, value) in values.iter_mut().enumerate() {
                *value = if i < ints { self.int(expected)? } else { self.tag(expected)? };
            }
        } else {
            let line = self.cursor.expect_line(expected)?;
            let mut fields = words(line);
            for value in &mut values {
                *value = self.cursor.integer(fields.next().unwrap_or(b""), expected)?;
            }
        }
        Ok(values)
    }

    fn positive(&self, value: i64, expected: &str) -> Result<u64, MeshError> {
        u64::try_from(value)
            .map_err(|_| self.cursor.invalid(value.to_string().as_bytes(), expected))
    }

    pub(super) fn nodes_by_block(&mut self) -> Result<(), MeshError> {
        self.has_nodes = true;
        let [blocks, total, _, _] = self.header(0, "the counts of the $Nodes section")?;
        let total = self.positive(total, "the number of nodes")?;
        let mut read = 0u64;
        let mut numbers = Vec::new();
        for _ in 0..blocks {
            let [dimension, _, parametric, count] =
                self.header(3, "the head of a block of nodes")?;
            let count = self.positive(count, "the number of nodes in a block")?;
            if count > total - read {
                let found = read.saturating_add(count);
                return Err(self.cursor.mismatch("the number of nodes", total, found));
            }
            numbers.clear();
            if self.cursor.binary {
                let extra = if parametric == 0 { 0 } else { dimension.clamp(0, 3) as usize };
                let width = self.size_width + 8 * (3 + extra);
                self.cursor.room_for(count, width as u64, "nodes")?;
                for _ in 0..count {
                    numbers.push(self.tag("a node number")?);
                }
                for &number in &numbers {
                    let point = self.binary_point()?;
                    self.cursor.take(8 * extra, "parametric coordinates")?;
                    self.add_node(number, point, 0)?;
                }
            } else {
                for i in 0..count {
                    let line = self.listed("node", total, read + i)?;
                    numbers.push(self.cursor.integer(line, "a node number")?);
                }
                for (i, &number) in (0..).zip(&numbers) {
                    let line = self.listed("node", total, read + i)?;
                    let point = self.cursor.point(&mut words(line))?;
                    self.add_node(number, point, self.cursor.line)?;
                }
            }
            read += count;
        }
        if read != total {
            return Err(self.cursor.mismatch("the number of nodes", total, read));
        }
        self.expect_end(b"$EndNodes", "nodes", total)
    }

    pub(super) fn elements_by_block(&mut self) -> Result<(), MeshError> {
        self.has_elements = true;
        let [blocks, total, _, _] = self.header(0, "the counts of the $Elements section")?;
        let total = self.positive(total, "the number of elements")?;
        if total > u64::from(u32::MAX) {
            return Err(too_many(self.cursor.file, "cells", total));
        }
        let mut read = 0u64;
        for _ in 0..blocks {
            let [dimension, entity, kind, count] =
                self.header(3, "the head of a block of elements")?;
            let count = self.positive(count, "the number of elements in a block")?;
            if count > total - read {
                let found = read.saturating_add(count);
                return Err(self.cursor.mismatch("the number of elements", total, found));
            }
            let number = kind;
            let kind = cell_kind(number).unwrap_or(UNKNOWN_KIND);
            if kind == UNKNOWN_KIND && self.cursor.binary {
                let feature = format!("element type {number}");
                return Err(self.cursor.unsupported(feature, SAVE_AGAIN));
            }
            let Some(dimension) = u8::try_from(dimension).ok().filter(|&d| d <= 3) else {
                let found = dimension.to_string();
                return Err(self
                    .cursor
                    .invalid(found.as_bytes(), "the dimension 0 to 3 of a block"));
            };
            let physical = self.entities.get(&(dimension, entity)).cloned().unwrap_or_default();
            let mut groups: Vec<usize> =
                physical.iter().map(|tag| self.group(dimension, tag.saturating_abs())).collect();
            groups.sort_unstable();
            groups.dedup();
            // Keeps the memory linear in the size of the file.
            if groups.len() > 256 {
                let feature = format!("an entity in {} physical groups", groups.len());
                return Err(self
                    .cursor
                    .unsupported(feature, "use at most 256 groups for each entity"));
            }
            if self.cursor.binary {
                let width = self.size_width * (1 + kind.vertices);
                self.cursor.room_for(count, width as u64, "elements")?;
            }
            for i in 0..count {
                let number = self.element_of_block(kind, total, read + i)?;
                if let Some(cell) = kind.used_as() {
                    let index = self.builder.mesh.count(cell);
                    self.elements.insert(number, (cell, index..index + kind.parts()));
                }
                let mut vertices = std::mem::take(&mut self.vertices);
                in_order_of_vtk(kind, &mut vertices);
                let line = if self.cursor.binary { 0 } else { self.cursor.line };
                self.builder.cell(kind, &vertices, &groups, line);
                self.vertices = vertices;
            }
            read += count;
        }
        if read != total {
            return Err(self.cursor.mismatch("the number of elements", total, read));
        }
        self.expect_end(b"$EndElements", "elements", total)
    }

    /// Collects the vertices of the next element of a block (4.1); its number.
    fn element_of_block(
        &mut self,
        kind: CellKind,
        total: u64,
        read: u64,
    ) -> Result<i64, MeshError> {
        self.vertices.clear();
        if self.cursor.binary {
            let number = self.tag("an element number")?;
            for _ in 0..kind.vertices {
                let node = self.tag("a node number")?;
                self.push_vertex(node, kind, number)?;
            }
            return Ok(number);
        }
        let mut fields = words(self.listed("element", total, read)?);
        let number = self.cursor.integer(fields.next().unwrap_or(b""), "an element number")?;
        if kind == UNKNOWN_KIND {
            return Ok(number);
        }
        for field in fields {
            let node = self.cursor.integer(field, "a node number")?;
            self.push_vertex(node, kind, number)?;
        }
        if self.vertices.len() != kind.vertices {
            let what = format!("the number of nodes of element {number} ({})", kind.name);
            return Err(self.cursor.mismatch(
                &what,
                kind.vertices as u64,
                self.vertices.len() as u64,
            ));
        }
        Ok(number)
    }
}
