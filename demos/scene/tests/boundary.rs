//! Surfaces that pictures show.

use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;
use sinew_scene::picture::{Face, boundary};

fn simulation(mesh: &Mesh) -> (Simulation, BodyHandle) {
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    let material = preset("liver").unwrap().material;
    let body = simulation.add_body(&BodyDescription::new("box", mesh, material)).unwrap();
    (simulation, body)
}

fn volume(mesh: &Mesh, faces: &[Face]) -> f64 {
    let p = |v: u32| mesh.points[v as usize];
    faces.iter().map(|f| f.vertices.map(p)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

#[test]
fn surfaces_enclose_what_is_left() {
    let size = DVec3::new(1.0, 2.0, 3.0);
    for mesh in [box_tets(size, [2, 3, 2]).unwrap(), box_hexahedra(size, [2, 3, 2]).unwrap()] {
        let (mut simulation, body) = simulation(&mesh);
        let faces = boundary(&simulation.surface(body).unwrap(), &[], &[]);
        assert_eq!(faces.len(), 2 * 2 * (6 + 6 + 4));
        assert!((volume(&mesh, &faces) - 6.0).abs() < 1e-12);
        let second = faces.iter().filter(|face| face.second).count();
        assert_eq!(second, if mesh.hexahedra.is_empty() { 0 } else { faces.len() / 2 });
        // a hole appears where an element went
        let (region, gone) = match mesh.tetrahedra.first() {
            Some(t) => (Region::Tetrahedra(vec![0]), mesh.signed_volume(*t).unwrap()),
            None => {
                (Region::Hexahedra(vec![0]), mesh.hexahedron_volume(mesh.hexahedra[0]).unwrap())
            }
        };
        simulation.remove_elements(body, &Removal::new(region)).unwrap();
        let rest = boundary(&simulation.surface(body).unwrap(), &[], &[]);
        assert!((volume(&mesh, &rest) - (6.0 - gone)).abs() < 1e-12);
    }
}

#[test]
fn membranes_on_a_solid_are_not_drawn_twice() {
    let mesh = box_hexahedra(DVec3::ONE, [1, 1, 1]).unwrap();
    let (mut simulation, body) = simulation(&mesh);
    let solid = simulation.surface(body).unwrap();
    assert!(solid.iter().all(|(_, kind, e)| (*kind, *e) == (ElementKind::Hexahedron, 0)));
    let [a, b, c, d] = mesh.surface_quads()[0];
    let alone = [a, b, 7 - a];
    let faces = boundary(&solid, &[alone], &[[c, d, a, b]]);
    assert_eq!(faces.len(), 12 + 1);
    assert_eq!(faces[12], Face { vertices: alone, element: None, second: false });
}
