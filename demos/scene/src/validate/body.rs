//! The body of a case: its material, its elements and their law.

use super::CaseError;
use super::read::{CaseEntry, ReferenceCase};
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel, PlaneState};
use sinew::models::body::{Evaluation, VolumeRule};
use sinew::prelude::*;
use std::path::Path;

/// Material of a case: constants, and lists of one value per element in the order of the file.
#[derive(Clone)]
pub(super) struct CaseMaterial {
    /// That of the first element.
    base: YoungPoisson,
    young_modulus: Option<Vec<f64>>,
    poisson_ratio: Option<Vec<f64>>,
    density: Option<Vec<f64>>,
}

impl CaseMaterial {
    /// The same everywhere.
    pub fn uniform(base: YoungPoisson) -> Self {
        Self { base, young_modulus: None, poisson_ratio: None, density: None }
    }

    /// `E`, `nu` and `rho` (water's by default) of an object, each a number or a list of one per element.
    pub fn read(entry: &CaseEntry, elements: usize) -> Result<Self, CaseError> {
        let constant = |key: &str| {
            let entry = entry.get(key);
            if !entry.is_list() {
                return Ok((entry.number()?, None));
            }
            let fail = || entry.error(format!("a number or a list of {elements}, one per element"));
            let values = entry.numbers()?;
            match values.first() {
                Some(&first) if values.len() == elements => {
                    let varies = values.iter().any(|&v| v != first);
                    Ok((first, varies.then_some(values)))
                }
                _ => Err(fail()),
            }
        };
        let (first_modulus, young_modulus) = constant("E")?;
        let (first_ratio, poisson_ratio) = constant("nu")?;
        let (first_density, density) =
            if entry.get("rho").is_absent() { (1000.0, None) } else { constant("rho")? };
        let base = YoungPoisson {
            young_modulus: first_modulus,
            poisson_ratio: first_ratio,
            density: first_density,
        };
        Ok(Self { base, young_modulus, poisson_ratio, density })
    }

    /// Whether elements differ.
    fn varies(&self) -> bool {
        self.young_modulus.is_some() || self.poisson_ratio.is_some() || self.density.is_some()
    }

    /// That of one element alone.
    pub fn of_element(&self, i: usize) -> Self {
        let pick = |list: &Option<Vec<f64>>, base| list.as_ref().map_or(base, |list| list[i]);
        let base = YoungPoisson {
            young_modulus: pick(&self.young_modulus, self.base.young_modulus),
            poisson_ratio: pick(&self.poisson_ratio, self.base.poisson_ratio),
            density: pick(&self.density, self.base.density),
        };
        Self { base, young_modulus: None, poisson_ratio: None, density: None }
    }
}

/// Which strains or stresses across a plane case vanish.
pub(super) fn plane_state(entry: &CaseEntry) -> Result<PlaneState, CaseError> {
    match entry.clone().given().map(|entry| entry.text()).transpose()? {
        None | Some("stress") => Ok(PlaneState::Stress),
        Some("strain") => Ok(PlaneState::Strain),
        Some(_) => Err(entry.error("`stress` or `strain`")),
    }
}

/// Elements of one kind.
#[derive(Clone, Copy)]
pub(super) enum CaseCells<'a> {
    Tetrahedra(&'a [[u32; 4]]),
    /// Of ten nodes: corners, and the nodes on the edges.
    Tetrahedra10(&'a [[u32; 4]], &'a [[u32; 6]]),
    Hexahedra(&'a [[u32; 8]]),
    Triangles(&'a [[u32; 3]]),
    Quads(&'a [[u32; 4]]),
}

impl<'a> CaseCells<'a> {
    /// Those of a mesh: solid elements before what may be their surface.
    pub fn of(mesh: &'a Mesh) -> Option<Self> {
        let kinds = [
            CaseCells::Hexahedra(&mesh.hexahedra),
            CaseCells::Tetrahedra(&mesh.tetrahedra),
            CaseCells::Quads(&mesh.quads),
            CaseCells::Triangles(&mesh.triangles),
        ];
        kinds.into_iter().find(|cells| cells.len() > 0)
    }

    pub fn len(self) -> usize {
        match self {
            CaseCells::Tetrahedra(cells)
            | CaseCells::Tetrahedra10(cells, _)
            | CaseCells::Quads(cells) => cells.len(),
            CaseCells::Hexahedra(cells) => cells.len(),
            CaseCells::Triangles(cells) => cells.len(),
        }
    }

    /// Nodes of an element.
    pub fn nodes(self) -> usize {
        match self {
            CaseCells::Tetrahedra(_) | CaseCells::Quads(_) => 4,
            CaseCells::Tetrahedra10(..) => 10,
            CaseCells::Hexahedra(_) => 8,
            CaseCells::Triangles(_) => 3,
        }
    }

    /// Name of the kind in case files.
    pub fn kind(self) -> &'static str {
        match self {
            CaseCells::Tetrahedra(_) => "tet",
            CaseCells::Tetrahedra10(..) => "tet10",
            CaseCells::Hexahedra(_) => "hex",
            CaseCells::Triangles(_) => "tri",
            CaseCells::Quads(_) => "quad",
        }
    }
}

/// A law of solid elements or of membranes.
#[derive(Clone, Copy)]
pub(super) enum CaseLaw {
    Solid(Model, VolumeRule),
    Membrane(MembraneModel),
}

impl CaseLaw {
    /// The law of a name for a kind of elements. Plane cases call the laws of membranes by those of solids.
    pub fn find(name: &str, kind: &str) -> Result<Self, CaseError> {
        let model = |name: &str| Model::ALL.into_iter().find(|m| m.name() == name);
        let solid = || model(name).map(|model| CaseLaw::Solid(model, VolumeRule::Elements));
        let by_mean = || {
            let model = model(name.strip_suffix("_cluster")?).filter(|m| m.keeps_mean_volume());
            model.map(|model| CaseLaw::Solid(model, VolumeRule::Clusters))
        };
        let membrane = || match name {
            "svk" => Some(MembraneModel::Biquadratic),
            "svk_comp" => Some(MembraneModel::CompressibleBiquadratic),
            _ => MembraneModel::ALL.into_iter().find(|m| m.name() == name),
        };
        let found = match kind {
            "tet" => by_mean().or_else(solid),
            "tet10" => by_mean().or_else(|| {
                solid().filter(|law| matches!(law, CaseLaw::Solid(m, _) if m.serves_tetrahedra10()))
            }),
            "hex" => by_mean().or_else(|| {
                solid().filter(|law| matches!(law, CaseLaw::Solid(m, _) if m.serves_hexahedra()))
            }),
            "tri" | "quad" => membrane().map(CaseLaw::Membrane),
            _ => return Err(CaseError::NotRun(format!("{kind} elements are not known"))),
        };
        let why = || CaseError::NotRun(format!("law `{name}` is not built yet"));
        found.ok_or_else(why)
    }

    /// Name in reports of trajectories.
    pub fn name(self) -> &'static str {
        match self {
            CaseLaw::Solid(model, _) => model.name(),
            CaseLaw::Membrane(model) => model.name(),
        }
    }
}

/// A body of one kind of elements.
#[derive(Clone, Copy)]
pub(super) struct CaseBody<'a> {
    pub points: &'a [DVec3],
    pub cells: CaseCells<'a>,
    pub law: CaseLaw,
    /// Clusters of tetrahedra that keep their volume together, if the case names them.
    pub clusters: Option<&'a [u32]>,
    pub material: &'a CaseMaterial,
    /// Thickness of a membrane (m); moduli of plane cases are per unit thickness.
    pub thickness: f64,
    pub plane: PlaneState,
}

impl<'a> CaseBody<'a> {
    /// A body without clusters, of unit thickness and in plane stress where it is a membrane.
    pub fn new(
        points: &'a [DVec3],
        cells: CaseCells<'a>,
        law: CaseLaw,
        material: &'a CaseMaterial,
    ) -> Self {
        let plane = PlaneState::Stress;
        Self { points, cells, law, clusters: None, material, thickness: 1.0, plane }
    }

    /// A simulation of this body alone, without gravity.
    pub fn simulation(&self, case: &ReferenceCase) -> Result<(Simulation, BodyHandle), CaseError> {
        let threads = case.options.threads;
        let mut simulation =
            Simulation::new(SimulationOptions { threads, exclusive: true, ..Default::default() })
                .map_err(|e| case.simulation_error(e))?;
        let wanted = case.options.evaluation;
        let simplices = matches!(self.cells, CaseCells::Tetrahedra(_) | CaseCells::Triangles(_));
        let evaluation =
            |supported| if simplices && supported { wanted } else { Evaluation::Fused };
        let plain = BodyDescription::from_parts("body", self.points, &[], self.material.base);
        let description = match (self.law, self.cells) {
            (CaseLaw::Solid(model, volume), cells) => BodyDescription {
                tetrahedra: match cells {
                    CaseCells::Tetrahedra(cells) | CaseCells::Tetrahedra10(cells, _) => cells,
                    _ => &[],
                },
                middles: if let CaseCells::Tetrahedra10(_, middles) = cells {
                    middles
                } else {
                    &[]
                },
                hexahedra: if let CaseCells::Hexahedra(cells) = cells { cells } else { &[] },
                young_modulus: self.material.young_modulus.as_deref(),
                poisson_ratio: self.material.poisson_ratio.as_deref(),
                density: self.material.density.as_deref(),
                model,
                evaluation: evaluation(model.supports(wanted)),
                volume,
                clusters: self.clusters,
                ..plain
            },
            (CaseLaw::Membrane(_), _) if self.material.varies() => {
                let why = "a membrane has one material; values per element are for solid elements";
                return Err(CaseError::NotRun(why.into()));
            }
            (CaseLaw::Membrane(model), cells) => {
                let triangles = if let CaseCells::Triangles(cells) = cells { cells } else { &[] };
                let membrane = MembraneDescription {
                    quads: if let CaseCells::Quads(cells) = cells { cells } else { &[] },
                    model,
                    plane: self.plane,
                    evaluation: evaluation(model.supports(wanted)),
                    ..MembraneDescription::new(triangles, self.thickness, self.material.base)
                };
                BodyDescription { membrane: Some(membrane), ..plain }
            }
        };
        let body = simulation.add_body(&description).map_err(|e| case.simulation_error(e))?;
        simulation.set_gravity(DVec3::ZERO);
        Ok((simulation, body))
    }

    /// The same at displacements (m), at rest.
    pub fn displaced(
        &self,
        case: &ReferenceCase,
        u: &[DVec3],
    ) -> Result<(Simulation, BodyHandle), CaseError> {
        let (mut simulation, body) = self.simulation(case)?;
        let still = vec![DVec3::ZERO; u.len()];
        simulation.set_state(body, u, &still).map_err(|e| case.simulation_error(e))?;
        Ok((simulation, body))
    }
}

/// The mesh that a case names, found in the folder of the options, or else in `meshes` beside the case or
/// beside its folder.
pub(super) fn mesh(case: &ReferenceCase) -> Result<Mesh, CaseError> {
    let root = case.root();
    let name = root.get("mesh").text()?;
    let beside = case.path.parent().unwrap_or(Path::new("."));
    let near = ["meshes", "../meshes", "", ".."].map(|folder| beside.join(folder));
    let searched: Vec<_> = case.options.meshes.iter().cloned().chain(near).collect();
    let file = searched.iter().map(|folder| folder.join(name)).find(|file| file.is_file());
    let Some(file) = file else {
        return Err(CaseError::NoMesh { case: case.path.clone(), mesh: name.into(), searched });
    };
    let mesh = Mesh::read(&file)?;
    let cells = CaseCells::of(&mesh).map_or(0, CaseCells::len);
    for (key, count) in [("nodes", mesh.points.len()), ("cells", cells)] {
        let given = root.get(key).given();
        if let Some(given) = given.filter(|g| g.index().ok() != u32::try_from(count).ok()) {
            return Err(given.error(format!("{count}, as `{}` has", file.display())));
        }
    }
    Ok(mesh)
}
