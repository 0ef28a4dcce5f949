//! Parameters: which constants of which elements are fitted, and the smooth maps that keep them in
//! range.

use super::error::{DataFitError, Result};
use serde::Serialize;
use sinew::models::body::SoftBody;
use sinew::models::material::{MAX_POISSON_RATIO, YoungPoisson};
use sinew_scene::assemble::{BuiltBody, BuiltScene};
use sinew_scene::error::hint;

/// A constant of the material, or of its fibres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Constant {
    /// Young's modulus (Pa).
    Young,
    /// Poisson's ratio (-).
    Poisson,
    /// Modulus along a family of axes (Pa).
    Axis,
}

impl Constant {
    /// Word of the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Young => "young",
            Self::Poisson => "poisson",
            Self::Axis => "axis",
        }
    }

    /// Name in a sentence.
    pub fn name(self) -> &'static str {
        match self {
            Self::Young => "Young's modulus",
            Self::Poisson => "Poisson's ratio",
            Self::Axis => "modulus of fibres",
        }
    }

    /// Whether it is a modulus, which is positive and fitted in its logarithm.
    pub fn is_modulus(self) -> bool {
        self != Self::Poisson
    }

    /// SI unit.
    pub fn unit(self) -> &'static str {
        if self.is_modulus() { "Pa" } else { "-" }
    }

    /// Range that the engine accepts.
    fn range(self) -> [f64; 2] {
        if self.is_modulus() { [0.0, f64::INFINITY] } else { [-0.99, MAX_POISSON_RATIO] }
    }
}

/// One constant, the same in a set of elements.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// `young`, `poisson:REGION`, `young:ARRAY=2`, `BODY/young`, `axis:FAMILY` ...
    pub name: String,
    /// What is fitted.
    pub constant: Constant,
    /// Index of the body.
    pub body: usize,
    /// Index of the family of axes; 0 for other constants.
    pub family: usize,
    /// Solid elements in the order of the user's mesh, tetrahedra first.
    pub elements: Vec<u32>,
    /// Value in the scene (Pa or 1); the mean over the elements where it varies.
    pub start: f64,
    /// Whether it varies over the elements in the scene.
    pub varies: bool,
    /// Range (Pa or 1).
    pub bounds: [f64; 2],
}

impl Parameter {
    /// From the unbounded unknown of the least-squares method, which is 1 at the start: exponential, or
    /// logistic between bounds, of a modulus in its logarithm.
    pub fn value(&self, unknown: f64) -> f64 {
        let [low, high] = self.ends();
        let x = unknown - 1.0;
        let moved = if high.is_infinite() {
            self.scaled(self.start) + x
        } else {
            low + (high - low) * logistic(x + self.offset(low, high))
        };
        if self.constant.is_modulus() { moved.exp() } else { moved }
    }

    /// Derivative of [`Parameter::value`].
    pub fn slope(&self, unknown: f64) -> f64 {
        let [low, high] = self.ends();
        let moved = if high.is_infinite() {
            1.0
        } else {
            let share = logistic(unknown - 1.0 + self.offset(low, high));
            (high - low) * share * (1.0 - share)
        };
        if self.constant.is_modulus() { moved * self.value(unknown) } else { moved }
    }

    /// A change by which its influence is judged: a modulus by itself, a ratio by 1/2.
    pub fn scale(&self, value: f64) -> f64 {
        if self.constant.is_modulus() { value } else { 0.5 }
    }

    /// Whether a value is so near to a bound that the bound decides it.
    pub fn at_bound(&self, value: f64) -> bool {
        let [low, high] = self.ends();
        let share = (self.scaled(value) - low) / (high - low);
        high.is_finite() && !(1e-3..=1.0 - 1e-3).contains(&share)
    }

    fn scaled(&self, value: f64) -> f64 {
        if self.constant.is_modulus() { value.ln() } else { value }
    }

    fn ends(&self) -> [f64; 2] {
        self.bounds.map(|bound| self.scaled(bound))
    }

    fn offset(&self, low: f64, high: f64) -> f64 {
        let share = (self.scaled(self.start) - low) / (high - low);
        (share / (1.0 - share)).ln()
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Material of every solid element of a body.
#[derive(Clone, Debug)]
pub struct ElementMaterials {
    /// Material of the whole body.
    pub base: YoungPoisson,
    /// Young's moduli (Pa).
    pub young: Vec<f64>,
    /// Poisson's ratios.
    pub poisson: Vec<f64>,
    /// Densities (kg/m^3).
    pub density: Vec<f64>,
    /// Names of the families of axes and the moduli along them (Pa).
    pub axes: Vec<(String, f64)>,
}

impl ElementMaterials {
    /// Those of all bodies of a scene.
    pub fn of(scene: &mut BuiltScene) -> Vec<Self> {
        let counts: Vec<usize> = scene.bodies.iter().map(|b| solids(b).len()).collect();
        let world = scene.simulation.world_mut();
        let mut bodies: Vec<SoftBody> = world.query::<&SoftBody>().iter(world).cloned().collect();
        bodies.sort_by_key(|body| body.index);
        let all = |(body, count): (SoftBody, usize)| {
            let field = body.field();
            Self {
                base: body.material,
                young: (0..count).map(|i| field.at(i).young_modulus).collect(),
                poisson: (0..count).map(|i| field.at(i).poisson_ratio).collect(),
                density: (0..count).map(|i| field.at(i).density).collect(),
                axes: body.axes.as_ref().map_or(Vec::new(), |axes| {
                    let families = axes.description.families.iter();
                    families.map(|f| (f.name.to_string(), f.modulus)).collect()
                }),
            }
        };
        bodies.into_iter().zip(counts).map(all).collect()
    }

    /// Gives the elements of a parameter a value.
    pub fn set(&mut self, parameter: &Parameter, value: f64) {
        let values = match parameter.constant {
            Constant::Young => &mut self.young,
            Constant::Poisson => &mut self.poisson,
            Constant::Axis => {
                self.axes[parameter.family].1 = value;
                return;
            }
        };
        for &element in &parameter.elements {
            values[element as usize] = value;
        }
    }
}

/// Indices of the solid elements of a body, tetrahedra first.
fn solids(body: &BuiltBody) -> std::ops::Range<u32> {
    0..(body.mesh.tetrahedra.len() + body.mesh.hexahedra.len()) as u32
}

/// Reads parameters such as `young`, `poisson:REGION`, `BODY/young:ARRAY` or `axis:FAMILY`, and bounds such as
/// `young:REGION=1e3..1e5`. An array of cell data stands for one parameter per value.
///
/// # Errors
/// [`DataFitError::Option`].
pub fn parse(
    fit: &[String],
    bounds: &[String],
    scene: &BuiltScene,
    materials: &[ElementMaterials],
) -> Result<Vec<Parameter>> {
    let mut all: Vec<Parameter> = Vec::new();
    for text in fit {
        for parameter in parse_one(text, scene, materials)? {
            let same = |p: &&Parameter| {
                (p.constant, p.body, p.family)
                    == (parameter.constant, parameter.body, parameter.family)
                    && p.elements.iter().any(|e| parameter.elements.binary_search(e).is_ok())
            };
            if let Some(other) = all.iter().find(same) {
                let found = format!("it shares elements with `{}`", other.name);
                let remedy = "fit every element at most once".into();
                return Err(DataFitError::option(format!("--fit {text}"), found, remedy));
            }
            all.push(parameter);
        }
    }
    if all.is_empty() {
        let remedy = "give --fit young, --fit poisson, --fit young:REGION or --fit axis:FAMILY";
        return Err(DataFitError::option(
            "--fit".into(),
            "no parameter is given".into(),
            remedy.into(),
        ));
    }
    for text in bounds {
        set_bounds(text, &mut all)?;
    }
    Ok(all)
}

fn parse_one(
    text: &str,
    scene: &BuiltScene,
    materials: &[ElementMaterials],
) -> Result<Vec<Parameter>> {
    let fault = |found, remedy| DataFitError::option(format!("--fit {text}"), found, remedy);
    let (head, region) = match text.split_once(':') {
        Some((head, region)) => (head, Some(region)),
        None => (text, None),
    };
    let names = || scene.bodies.iter().map(|b| b.name.as_str());
    let (body, word) = match head.rsplit_once('/') {
        Some((name, word)) => match names().position(|known| known == name) {
            Some(body) => (body, word),
            None => {
                let found = format!("the scene has no body `{name}`");
                return Err(fault(found, hint("body", name, names())));
            }
        },
        None if scene.bodies.len() == 1 => (0, head),
        None => {
            let remedy = format!("name one of them, such as {}/{text}", scene.bodies[0].name);
            return Err(fault("the scene has several bodies".into(), remedy));
        }
    };
    let constants = [Constant::Young, Constant::Poisson, Constant::Axis];
    let Some(constant) = constants.into_iter().find(|c| c.word() == word) else {
        let remedy = hint("parameter", word, constants.into_iter().map(Constant::word));
        return Err(fault(format!("there is no parameter `{word}`"), remedy));
    };
    let of = &scene.bodies[body];
    if solids(of).is_empty() {
        let found = format!("body `{}` has no tetrahedra or hexahedra", of.name);
        let remedy = "the material of a membrane alone is not fitted; choose another body";
        return Err(fault(found, remedy.into()));
    }
    if constant == Constant::Axis {
        let families = &materials[body].axes;
        let known = || families.iter().map(|(name, _)| name.as_str());
        let Some(name) = region else {
            let found = "it names no family of fibres".to_string();
            let remedy = format!("write axis:FAMILY; {}", hint("family", "", known()));
            return Err(fault(found, remedy));
        };
        let Some(family) = known().position(|known| known == name) else {
            let found = format!("body `{}` has no fibres `{name}`", of.name);
            return Err(fault(found, hint("family", name, known())));
        };
        let start = families[family].1;
        if start == 0.0 {
            let found = format!("the scene gives fibres `{name}` the modulus 0");
            return Err(fault(found, "start from a positive modulus".into()));
        }
        let (name, elements) = (text.to_string(), solids(of).collect());
        let (varies, bounds) = (false, constant.range());
        let axis = Parameter { name, constant, body, family, elements, start, varies, bounds };
        return Ok(vec![axis]);
    }
    let regions = match region {
        None => vec![(text.to_string(), solids(of).collect())],
        Some(region) => elements_of(text, region, of).map_err(|(f, r)| fault(f, r))?,
    };
    let values = match constant {
        Constant::Poisson => &materials[body].poisson,
        _ => &materials[body].young,
    };
    let parameter = |(name, elements): (String, Vec<u32>)| {
        let own = || elements.iter().map(|&e| values[e as usize]);
        let varies = own().any(|value| value != values[elements[0] as usize]);
        let mean = own().sum::<f64>() / elements.len() as f64;
        let start = if varies { mean } else { values[elements[0] as usize] };
        let bounds = constant.range();
        Parameter { name, constant, body, family: 0, elements, start, varies, bounds }
    };
    Ok(regions.into_iter().map(parameter).collect())
}

/// Elements of a group, or of every value of an array of cell data; or what is wrong and what to do.
fn elements_of(
    text: &str,
    region: &str,
    body: &BuiltBody,
) -> Result<Vec<(String, Vec<u32>)>, (String, String)> {
    let mesh = &body.mesh;
    let tetrahedra = mesh.tetrahedra.len() as u32;
    if let Some(group) = mesh.group_of_dimension(region, 3) {
        let mut elements = group.cells.tetrahedra.clone();
        elements.extend(group.cells.hexahedra.iter().map(|h| tetrahedra + h));
        elements.sort_unstable();
        elements.dedup();
        if elements.is_empty() {
            let remedy = "choose a group that has some (`sinew mesh info` lists them)";
            return Err((format!("group `{region}` has no solid elements"), remedy.into()));
        }
        return Ok(vec![(text.to_string(), elements)]);
    }
    let Some(data) = mesh.data(region) else {
        let groups = mesh.groups.iter().filter(|g| g.dimension == 3).map(|g| g.name.as_str());
        let known = groups.chain(mesh.cell_data.iter().map(|data| data.name.as_str()));
        let found =
            format!("{} has neither a group of cells nor cell data `{region}`", mesh.source);
        return Err((found, hint("region", region, known)));
    };
    let values = [&data.values.tetrahedra[..], &data.values.hexahedra[..]].concat();
    let mut distinct = values.clone();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup();
    if distinct.iter().any(|value| value.is_nan()) {
        let remedy = "give every tetrahedron and hexahedron a value";
        return Err((
            format!("cell data `{region}` has no value for some elements"),
            remedy.into(),
        ));
    }
    if distinct.len() > MOST_REGIONS {
        let found = format!("cell data `{region}` has {} different values", distinct.len());
        let remedy =
            format!("use an array that numbers regions (at most {MOST_REGIONS}), or a group");
        return Err((found, remedy));
    }
    let of = |value: &f64| {
        let own = values.iter().enumerate().filter(|(_, v)| *v == value);
        (format!("{text}={value}"), own.map(|(i, _)| i as u32).collect())
    };
    Ok(distinct.iter().map(of).collect())
}

/// Most values of an array of cell data that is taken for one of regions.
const MOST_REGIONS: usize = 64;

fn set_bounds(text: &str, parameters: &mut [Parameter]) -> Result<()> {
    let fault = |found, remedy| DataFitError::option(format!("--bounds {text}"), found, remedy);
    let form = || "write PARAMETER=LOW..HIGH, such as young=1e3..1e5".to_string();
    let (name, range) =
        text.rsplit_once('=').ok_or_else(|| fault("there is no `=`".into(), form()))?;
    let ends = range.split_once("..").and_then(|(low, high)| {
        Some([low.trim().parse::<f64>().ok()?, high.trim().parse::<f64>().ok()?])
    });
    let [low, high] = ends.ok_or_else(|| fault(format!("`{range}` is no range"), form()))?;
    let family = format!("{name}=");
    let known = hint("parameter", name, parameters.iter().map(|p| p.name.as_str()));
    let mut found = false;
    for p in parameters.iter_mut().filter(|p| p.name == name || p.name.starts_with(&family)) {
        found = true;
        let [least, most] = p.constant.range();
        let (inside, remedy) = match p.constant.is_modulus() {
            true => (low > least && high < most, "give 0 < LOW < HIGH (Pa)".into()),
            false => {
                let remedy = format!("give {least} <= LOW < HIGH <= {most}");
                (low >= least && high <= most, remedy)
            }
        };
        if !(low < high && inside) {
            return Err(fault(format!("{low}..{high} is out of range"), remedy));
        }
        if !(low < p.start && p.start < high) {
            let found = format!("the scene starts `{}` at {}, outside", p.name, p.start);
            return Err(fault(found, "change the material of the scene or the bounds".into()));
        }
        p.bounds = [low, high];
    }
    if found { Ok(()) } else { Err(fault(format!("`{name}` is not fitted"), known)) }
}
