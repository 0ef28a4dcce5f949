//! Meshes: read or generated, and put in place.

use crate::error::SceneError;
use crate::scene::{BodyEntry, Generate, Key, Rotation, SHAPES, SheetCells, SolidCells};
use glam::{DQuat, DVec2, DVec3};
use sinew::engine::load::rotation;
use sinew::engine::mesh::generate::{
    box_hexahedra, box_tets, cup_hexahedra, cylinder_hexahedra, cylinder_tets, disc_triangles,
    grade_box, irregular_box_tets, jitter_interior, quad_grid, specimen_hexahedra, specimen_quads,
    specimen_tets, specimen_triangles, sphere_tets, sphere_triangles, triangle_grid,
    tube_hexahedra,
};
use sinew::engine::mesh::{LatticeReport, Mesh, MeshError};

/// The mesh of a generated shape.
///
/// # Errors
/// [`MeshError`] when a parameter is out of range, `Ok(None)` unless exactly one shape is given.
pub fn generate(shape: &Generate) -> Result<Option<Mesh>, MeshError> {
    let Generate { cuboid, cylinder, sphere, sheet, specimen, disc, balloon, tube, cup } = shape;
    let shapes = [
        cuboid.as_ref().map(|s| {
            let size = DVec3::from_array(s.size);
            let mut mesh = match s.elements {
                SolidCells::Tetrahedra => box_tets(size, s.cells),
                SolidCells::Hexahedra => box_hexahedra(size, s.cells),
                SolidCells::Irregular => {
                    irregular_box_tets(size, s.cells, 0.15, s.seed.unwrap_or(0))
                }
            }?;
            let grading = s.grading.map_or(DVec3::ONE, DVec3::from_array);
            grade_box(&mut mesh, size, grading)?;
            Ok(mesh)
        }),
        cylinder.as_ref().map(|s| match s.elements {
            SolidCells::Tetrahedra => cylinder_tets(s.radius, s.length, s.rings, s.layers),
            SolidCells::Hexahedra => {
                cylinder_hexahedra(s.radius, s.length, 2 * s.rings, s.rings, s.layers)
            }
            SolidCells::Irregular => cylinder_tets(s.radius, s.length, s.rings, s.layers)
                .and_then(|mesh| jitter_interior(&mesh, 0.15, 0)),
        }),
        sphere.as_ref().map(|s| sphere_tets(s.radius, s.shells)),
        sheet.as_ref().map(|s| {
            let size = DVec2::from_array(s.size);
            match s.elements {
                SheetCells::Triangles => triangle_grid(size, s.cells),
                SheetCells::Quads => quad_grid(size, s.cells),
            }
        }),
        specimen.as_ref().map(|s| {
            let cells = |i: usize| s.cells.get(i).copied().unwrap_or(0);
            let (flat, deep) = ([cells(0), cells(1)], [cells(0), cells(1), cells(2)]);
            match (s.thickness, s.solid, s.sheet.unwrap_or_default()) {
                (None, _, SheetCells::Triangles) => specimen_triangles(s.width, flat),
                (None, _, SheetCells::Quads) => specimen_quads(s.width, flat),
                (Some(t), Some(SolidCells::Hexahedra), _) => specimen_hexahedra(s.width, t, deep),
                (Some(t), Some(SolidCells::Irregular), _) => {
                    specimen_tets(s.width, t, deep).and_then(|mesh| jitter_interior(&mesh, 0.15, 0))
                }
                (Some(t), ..) => specimen_tets(s.width, t, deep),
            }
        }),
        disc.as_ref().map(|s| disc_triangles(s.radius, s.rings)),
        balloon.as_ref().map(|s| sphere_triangles(s.radius, s.cuts)),
        tube.as_ref().map(|s| {
            let cells = [s.around, s.through, s.along];
            cut(tube_hexahedra(s.radius, s.wall, s.length, cells)?, s.elements)
        }),
        cup.as_ref().map(|s| {
            let mesh = cup_hexahedra([s.radius, s.depth], s.wall, s.core, s.rings, s.layers)?;
            cut(mesh, s.elements)
        }),
    ];
    let mut given = shapes.into_iter().flatten();
    match (given.next(), given.next()) {
        (Some(mesh), None) => mesh.map(Some),
        _ => Ok(None),
    }
}

/// A mesh of hexahedra as it is, or cut into tetrahedra.
fn cut(mesh: Mesh, cells: SolidCells) -> Result<Mesh, MeshError> {
    match cells {
        SolidCells::Hexahedra => Ok(mesh),
        SolidCells::Tetrahedra => Ok(mesh.split_into_simplices()),
        SolidCells::Irregular => jitter_interior(&mesh.split_into_simplices(), 0.15, 0),
    }
}

/// Key of what the mesh of a body comes from.
pub(super) fn source<'a>(key: &Key<'a>, body: &BodyEntry) -> Key<'a> {
    key.at(if body.mesh.is_some() { "mesh" } else { "generate" })
}

/// The mesh of a body in place, and the surface that it carries.
pub(super) struct Placed {
    pub mesh: Mesh,
    pub surface: Option<Mesh>,
    pub lattice: Option<LatticeReport>,
}

/// Reads or generates the mesh of a body and puts it in place.
pub(super) fn placed(key: &Key, body: &BodyEntry) -> Result<Placed, SceneError> {
    let own = source(key, body);
    let error = |source: MeshError| own.error(source);
    let mesh = match (&body.mesh, &body.generate) {
        (Some(path), None) => key.loaded.read_mesh(path).map_err(error)?,
        (None, Some(shape)) => generate(shape).map_err(error)?.ok_or_else(|| {
            let names: Vec<&str> = SHAPES.iter().map(|shape| shape.name).collect();
            own.value("not exactly one shape is given", format!("give one of {}", names.join(", ")))
        })?,
        (None, None) => {
            let remedy = "give `mesh` (a file) or `generate` (a shape)";
            return Err(key.missing("the mesh", remedy));
        }
        (Some(_), Some(_)) => {
            let found = "both `mesh` and `generate` are given";
            return Err(key.at("generate").value(found, "keep one of them"));
        }
    };
    let scale = key.at("scale").positive(body.scale.unwrap_or(1.0), "scale", "")?;
    let rotation = match &body.rotate {
        Some(Rotation { axis, degrees }) => {
            let key = key.at("rotate");
            let axis = key.axis(*axis)?;
            key.at("degrees").finite([*degrees])?;
            rotation(axis, degrees.to_radians())
        }
        None => DQuat::IDENTITY,
    };
    let translation = key.at("translate").finite(body.translate.unwrap_or_default())?;
    let mesh = mesh.transformed(scale, rotation, translation);
    let mut surface = None;
    if let Some(path) = &body.surface {
        let key = key.at("surface");
        if body.lattice.is_some() {
            let remedy = "leave it out";
            return Err(key.value("a lattice carries the surface that it is made of", remedy));
        }
        let own = key.loaded.read_mesh(path).map_err(|source| key.error(source))?;
        let own = own.transformed(scale, rotation, translation);
        if own.outside().is_empty() {
            return Err(key.value("there are no faces in it", "give a file with triangles"));
        }
        surface = Some(own);
    }
    if let Some(cell) = body.lattice {
        let key = key.at("lattice");
        if body.membrane.is_some() {
            let found = "a membrane would lie on the steps of the cells";
            return Err(
                key.value(found, "leave the membrane out, or fill the surface with tetrahedra")
            );
        }
        let (lattice, report) = mesh.lattice(cell).map_err(|source| key.error(source))?;
        return Ok(Placed { mesh: lattice, surface: Some(mesh), lattice: Some(report) });
    }
    if !body.second_order {
        return Ok(Placed { mesh, surface, lattice: None });
    }
    if mesh.tetrahedra.is_empty() {
        let remedy = "leave it out, or give a mesh of tetrahedra";
        return Err(key.at("second_order").value("there are no tetrahedra", remedy));
    }
    Ok(Placed { mesh: mesh.with_second_order(), surface, lattice: None })
}
