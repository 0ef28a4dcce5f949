//! Files of fitted bodies.
//!
//! JSON (`.json`) is a [`FittedBody`] as it stands. CSV (`.csv`) holds springs, masses and constants for
//! other programs, one record a line under the header `record,first,second,value,rest_length`:
//!
//! | record | first | second | value | rest_length |
//! |---|---|---|---|---|
//! | `schema`, `mesh`, `method`, `mass_lumping` | | | text | |
//! | `plane` (plane bodies only) | | | `stress` or `strain` | |
//! | `young_modulus` (Pa), `poisson_ratio`, `density` (kg/m^3), `thickness` (m, plane bodies only) | | | number | |
//! | `whole` (constants found for the body as a whole only: its report as JSON) | | | text | |
//! | `frobenius_residual`, `two_norm_residual` (mean, then worst with its element) | `mean` or `worst` | element | number | |
//! | `spring` | vertex | vertex | constant, N/m | m |
//! | `mass` | vertex | | kg | |
//! | `triangle`, `quad`, `tetrahedron`, `hexahedron` | element | pair | constant, N/m | |
//!
//! [`read`] takes both; a CSV file says nothing of virtual tests.

use super::{BodySpring, ElementConstants, FitError, FittedBody, Result, SCHEMA};
use sinew_identify::mesh::{FitReport, Residuals};
use sinew_identify::{ElementKind, ElementMethod, Plane};
use std::path::Path;
use std::str::FromStr;

const HEADER: [&str; 5] = ["record", "first", "second", "value", "rest_length"];

fn fault(path: &Path, reason: impl ToString) -> FitError {
    FitError::File { path: path.into(), reason: reason.to_string() }
}

fn is_csv(path: &Path) -> Result<bool> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("json") => Ok(false),
        Some("csv") => Ok(true),
        _ => Err(fault(path, "a body file ends in .json or .csv")),
    }
}

/// Writes a body; the extension tells the format.
///
/// # Errors
/// [`FitError::File`].
pub fn write(path: &Path, body: &FittedBody) -> Result<()> {
    let bytes = if is_csv(path)? {
        to_csv(body).map_err(|e| fault(path, e))?
    } else {
        let mut text = serde_json::to_vec_pretty(body).map_err(|e| fault(path, e))?;
        text.push(b'\n');
        text
    };
    std::fs::write(path, bytes).map_err(|e| fault(path, e))
}

/// Whether a body could be written to a file of this name, to be asked before the work.
///
/// # Errors
/// [`FitError::File`] for an extension other than `.json` and `.csv`.
pub fn check_name(path: &Path) -> Result<()> {
    is_csv(path).map(|_| ())
}

/// Reads a body that [`write()`] wrote.
///
/// # Errors
/// [`FitError::File`], with the line of a CSV file.
pub fn read(path: &Path) -> Result<FittedBody> {
    let csv = is_csv(path)?;
    let bytes = std::fs::read(path).map_err(|e| fault(path, e))?;
    let body: FittedBody = if csv {
        from_csv(&bytes).map_err(|reason| fault(path, reason))?
    } else {
        serde_json::from_slice(&bytes).map_err(|e| fault(path, e))?
    };
    if body.schema != SCHEMA {
        let reason = format!("schema `{}` is not `{SCHEMA}`; write the file again", body.schema);
        return Err(fault(path, reason));
    }
    check(&body).map_err(|reason| fault(path, reason))?;
    Ok(body)
}

/// Numbers that no body can have.
fn check(body: &FittedBody) -> Result<(), String> {
    let vertices = body.masses.len();
    for (i, s) in body.springs.iter().enumerate() {
        let [a, b] = s.nodes;
        if a == b || a as usize >= vertices || b as usize >= vertices {
            return Err(format!(
                "spring {i} joins vertices {a} and {b} of {vertices}; they must differ and exist"
            ));
        }
        let usable = s.constant.is_finite() && s.rest_length.is_finite() && s.rest_length > 0.0;
        if !usable {
            return Err(format!(
                "spring {i} has constant {} N/m and rest length {} m; the first must be finite, the \
                 second positive",
                s.constant, s.rest_length
            ));
        }
    }
    match body.masses.iter().position(|m| !(m.is_finite() && *m >= 0.0)) {
        Some(v) => {
            Err(format!("vertex {v} has mass {} kg; masses are not negative", body.masses[v]))
        }
        None => Ok(()),
    }
}

fn to_csv(body: &FittedBody) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut line = |record: &str, first: String, second: String, value: String, rest: String| {
        writer.write_record([record, &first, &second, &value, &rest])
    };
    let none = String::new;
    line(HEADER[0], HEADER[1].into(), HEADER[2].into(), HEADER[3].into(), HEADER[4].into())?;
    let mut setting = |name: &str, value: String| line(name, none(), none(), value, none());
    setting("schema", body.schema.clone())?;
    setting("mesh", body.mesh.clone())?;
    setting("method", body.method.name().to_string())?;
    setting("young_modulus", body.young_modulus.to_string())?;
    setting("poisson_ratio", body.poisson_ratio.to_string())?;
    setting("density", body.density.to_string())?;
    setting("mass_lumping", body.mass_lumping.to_string())?;
    if let Some(plane) = body.plane {
        setting("plane", if plane == Plane::Stress { "stress" } else { "strain" }.to_string())?;
    }
    if let Some(thickness) = body.thickness {
        setting("thickness", thickness.to_string())?;
    }
    if let Some(whole) = &body.whole {
        setting("whole", serde_json::to_string(whole).unwrap_or_default())?;
    }
    let r = &body.report;
    setting("distinct_fits", r.distinct_fits.to_string())?;
    setting("worst_off_plane", r.worst_off_plane.to_string())?;
    if let Some(gap) = r.worst_certificate_gap {
        setting("worst_certificate_gap", gap.to_string())?;
    }
    if let Some(count) = r.not_unique {
        setting("not_unique", count.to_string())?;
    }
    setting("negative_element_constants", r.negative_element_constants.to_string())?;
    setting("negative_edges", r.negative_edges.to_string())?;
    for (name, residual) in
        [("frobenius_residual", r.frobenius_residual), ("two_norm_residual", r.two_norm_residual)]
    {
        line(name, "mean".into(), none(), residual.mean.to_string(), none())?;
        let element = residual.worst_element.to_string();
        line(name, "worst".into(), element, residual.worst.to_string(), none())?;
    }
    for s in &body.springs {
        let [a, b] = s.nodes.map(|v| v.to_string());
        line("spring", a, b, s.constant.to_string(), s.rest_length.to_string())?;
    }
    for (v, m) in body.masses.iter().enumerate() {
        line("mass", v.to_string(), none(), m.to_string(), none())?;
    }
    for (kind, elements) in body.element_constants.kinds() {
        for (e, constants) in elements.iter().enumerate() {
            for (pair, k) in constants.iter().enumerate() {
                line(kind, e.to_string(), pair.to_string(), k.to_string(), none())?;
            }
        }
    }
    writer.into_inner().map_err(|error| error.into_error().into())
}

/// Settings by name, as they were read.
#[derive(Default)]
struct FileSettings(Vec<(String, String, u64)>);

impl FileSettings {
    fn get<T: FromStr>(&self, name: &str) -> Result<Option<T>, String> {
        let Some((_, value, line)) = self.0.iter().find(|s| s.0 == name) else { return Ok(None) };
        value.parse().map(Some).map_err(|_| format!("line {line}: `{value}` is no {name}"))
    }

    fn need<T: FromStr>(&self, name: &str) -> Result<T, String> {
        self.get(name)?.ok_or_else(|| format!("there is no record `{name}`; write the file again"))
    }
}

fn from_csv(bytes: &[u8]) -> Result<FittedBody, String> {
    let mut reader = csv::Reader::from_reader(bytes);
    let header = reader.headers().map_err(|e| e.to_string())?;
    if header != HEADER.as_slice() {
        return Err(format!("line 1 is not the header `{}`", HEADER.join(",")));
    }
    let mut settings = FileSettings::default();
    let (mut springs, mut masses) = (Vec::new(), Vec::new());
    let mut lists = ElementConstants::default();
    let zero = Residuals { mean: 0.0, worst: 0.0, worst_element: 0 };
    let mut residuals = [zero; 2];
    for record in reader.records() {
        let record = record.map_err(|e| e.to_string())?;
        let line = record.position().map_or(0, csv::Position::line);
        let field = |i: usize| record.get(i).unwrap_or("");
        let bad = |i: usize| format!("line {line}: `{}` is no {}", field(i), HEADER[i]);
        let number = |i: usize| field(i).parse::<f64>().map_err(|_| bad(i));
        let index = |i: usize| field(i).parse::<u32>().map_err(|_| bad(i));
        match field(0) {
            "spring" => springs.push(BodySpring {
                nodes: [index(1)?, index(2)?],
                constant: number(3)?,
                rest_length: number(4)?,
            }),
            "mass" => {
                if index(1)? as usize != masses.len() {
                    return Err(format!("line {line}: masses are not in the order of vertices"));
                }
                masses.push(number(3)?);
            }
            name @ ("frobenius_residual" | "two_norm_residual") => {
                let residual = &mut residuals[usize::from(name == "two_norm_residual")];
                if field(1) == "mean" {
                    residual.mean = number(3)?;
                } else {
                    residual.worst = number(3)?;
                    residual.worst_element = index(2)? as usize;
                }
            }
            kind @ ("triangle" | "quad" | "tetrahedron" | "hexahedron") => {
                let place = lists.kinds().iter().position(|(name, _)| *name == kind).unwrap_or(0);
                let list = lists.list(ElementKind::ALL[place]);
                let (element, pair) = (index(1)? as usize, index(2)? as usize);
                if element == list.len() && pair == 0 {
                    list.push(Vec::new());
                }
                match list.last_mut() {
                    Some(own) if own.len() == pair => own.push(number(3)?),
                    _ => return Err(format!("line {line}: constants are not in order")),
                }
            }
            name => settings.0.push((name.to_string(), field(3).to_string(), line)),
        }
    }
    let method: String = settings.need("method")?;
    let method = ElementMethod::from_str(&method).map_err(|e| e.to_string())?;
    let plane = match settings.get::<String>("plane")?.as_deref() {
        None => None,
        Some("stress") => Some(Plane::Stress),
        Some("strain") => Some(Plane::Strain),
        Some(other) => return Err(format!("plane `{other}` is neither stress nor strain")),
    };
    let counts = lists.kinds().map(|(_, l)| (l.len(), l.iter().map(Vec::len).sum::<usize>()));
    let report = FitReport {
        method,
        recalled: method.recalled(),
        elements: counts.iter().map(|c| c.0).sum(),
        distinct_fits: settings.need("distinct_fits")?,
        element_constants: counts.iter().map(|c| c.1).sum(),
        negative_element_constants: settings.need("negative_element_constants")?,
        negative_edges: settings.need("negative_edges")?,
        least_constant: springs.iter().map(|s| s.constant).fold(f64::INFINITY, f64::min),
        frobenius_residual: residuals[0],
        two_norm_residual: residuals[1],
        worst_certificate_gap: settings.get("worst_certificate_gap")?,
        not_unique: settings.get("not_unique")?,
        worst_off_plane: settings.need("worst_off_plane")?,
    };
    Ok(FittedBody {
        schema: settings.need("schema")?,
        mesh: settings.need("mesh")?,
        method,
        young_modulus: settings.need("young_modulus")?,
        poisson_ratio: settings.need("poisson_ratio")?,
        density: settings.need("density")?,
        plane,
        thickness: settings.get("thickness")?,
        springs,
        masses,
        mass_lumping: settings.get("mass_lumping")?.unwrap_or_default(),
        element_constants: lists,
        report,
        freedom: None,
        whole: match settings.get::<String>("whole")? {
            Some(text) => {
                Some(serde_json::from_str(&text).map_err(|e| format!("record `whole`: {e}"))?)
            }
            None => None,
        },
        assessment: None,
        untested: None,
    })
}
