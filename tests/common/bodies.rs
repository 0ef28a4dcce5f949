//! Bodies that together reach every row of the table of laws, for the tests of laws and for those of whole worlds.

use glam::{DVec2, DVec3};
use sinew_engine::mesh::Mesh;
use sinew_engine::mesh::generate::{box_hexahedra, box_tets, quad_grid, triangle_grid};
use sinew_models::axes::description::{AxesDescription, AxisFamily, FibreForm};
use sinew_models::body::sheet::{Bending, MembraneDescription, MembraneModel};
use sinew_models::body::{BodyDescription, Evaluation, Integration, Model, VolumeRule};
use sinew_models::material::YoungPoisson;

/// What they are made of.
pub const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.4, density: 1000.0 };

/// Direction of the fibres of a membrane.
const ALONG: [DVec3; 1] = [DVec3::new(0.6, 0.8, 0.0)];

/// One mesh of every kind of element.
pub struct Meshes {
    pub tetrahedra: Mesh,
    pub tetrahedra10: Mesh,
    pub hexahedra: Mesh,
    pub triangles: Mesh,
    pub quads: Mesh,
    /// Fibres of a membrane.
    fibres: [AxisFamily<'static>; 1],
}

impl Meshes {
    /// Boxes of so many cells.
    pub fn new(cells: [usize; 3]) -> Self {
        let (size, side) = (DVec3::new(0.2, 0.1, 0.1), DVec2::splat(0.1));
        let tetrahedra = box_tets(size, cells).unwrap();
        Self {
            tetrahedra10: tetrahedra.with_second_order(),
            tetrahedra,
            hexahedra: box_hexahedra(size, cells).unwrap(),
            triangles: triangle_grid(side, [3, 3]).unwrap(),
            quads: quad_grid(side, [3, 3]).unwrap(),
            fibres: [AxisFamily {
                form: FibreForm::Biquadratic,
                ..AxisFamily::new("f", &ALONG, 1e4)
            }],
        }
    }

    fn solids(&self) -> [&Mesh; 3] {
        [&self.tetrahedra, &self.hexahedra, &self.tetrahedra10]
    }

    /// Every model in every way of evaluation and of keeping volumes that its elements allow, axes alone, and every model of
    /// membranes.
    pub fn bodies(&self) -> Vec<BodyDescription<'_>> {
        let mut bodies = Vec::new();
        for mesh in self.solids() {
            let body = BodyDescription::new("body", mesh, MATERIAL);
            for model in Model::ALL {
                let served = if mesh.is_second_order() {
                    model.serves_tetrahedra10()
                } else {
                    mesh.hexahedra.is_empty() || model.serves_hexahedra()
                };
                if !served {
                    continue;
                }
                bodies.push(BodyDescription { model, ..body.clone() });
                let integration = Integration::Reduced;
                let reduced = BodyDescription { model, integration, ..body.clone() };
                if !mesh.hexahedra.is_empty() && model.law().is_some() {
                    bodies.push(reduced.clone());
                }
                if model.supports(Evaluation::Pooled)
                    && body.middles.is_empty()
                    && body.hexahedra.is_empty()
                {
                    let evaluation = Evaluation::Pooled;
                    bodies.push(BodyDescription { model, evaluation, ..body.clone() });
                }
                if model.keeps_mean_volume() {
                    let volume = VolumeRule::Clusters;
                    bodies.push(BodyDescription { model, volume, ..body.clone() });
                    if !mesh.hexahedra.is_empty() {
                        bodies.push(BodyDescription { volume, ..reduced });
                    }
                }
            }
            for kind in 0..4 {
                let (model, axes) = (Model::Axes, Some(axes(kind)));
                bodies.push(BodyDescription { model, axes, ..body.clone() });
            }
            if body.middles.is_empty() && body.hexahedra.is_empty() {
                bodies.push(BodyDescription { glue: 5.0, ..body.clone() });
                let (evaluation, axes) = (Evaluation::Pooled, Some(axes(3)));
                bodies.push(BodyDescription { evaluation, axes, ..body });
            }
        }
        for mesh in [&self.triangles, &self.quads] {
            bodies.extend(sheets(mesh));
        }
        for mut body in sheets(&self.triangles) {
            if let Some(own) = &mut body.membrane
                && own.model == MembraneModel::Biquadratic
            {
                own.fibres = &self.fibres;
                bodies.push(body);
            }
        }
        bodies
    }
}

/// Axes that need every law: a triad, a single fibre, volume alone, a biquadratic fibre; all with dampers.
fn axes(kind: usize) -> AxesDescription<'static> {
    let mut axes = AxesDescription::isotropic(MATERIAL.lame().unwrap());
    match kind {
        0 => {}
        1 | 3 => {
            axes.families.truncate(1);
            axes.angles.clear();
            axes.volume_modulus = 0.0;
        }
        _ => {
            axes.families.clear();
            axes.angles.clear();
        }
    }
    for family in &mut axes.families {
        family.viscosity = 3.0;
        if kind == 3 {
            family.form = FibreForm::Biquadratic;
        }
    }
    axes
}

/// Bodies that are all membrane.
fn sheets(mesh: &Mesh) -> Vec<BodyDescription<'_>> {
    use MembraneModel::{Biquadratic, CompressibleBiquadratic, Corotational, Linear, Quadratic};
    let mut sheets = Vec::new();
    for model in [Biquadratic, CompressibleBiquadratic, Quadratic, Linear, Corotational] {
        if model == Quadratic && !mesh.quads.is_empty() {
            continue;
        }
        for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
            let springs = matches!(model, Biquadratic | CompressibleBiquadratic);
            if evaluation == Evaluation::Pooled && !springs {
                continue;
            }
            let sheet = MembraneDescription::new(&mesh.triangles, 1e-3, MATERIAL);
            let sheet = MembraneDescription { quads: &mesh.quads, model, evaluation, ..sheet };
            let body = BodyDescription::from_parts("sheet", &mesh.points, &[], MATERIAL);
            // one is enough: its law knows nothing of the others
            if mesh.quads.is_empty() && model == Biquadratic && evaluation == Evaluation::Fused {
                let bending = Some(Bending::default());
                let bends = MembraneDescription { bending, ..sheet };
                sheets.push(BodyDescription { membrane: Some(bends), ..body.clone() });
            }
            sheets.push(BodyDescription { membrane: Some(sheet), ..body });
        }
    }
    sheets
}
