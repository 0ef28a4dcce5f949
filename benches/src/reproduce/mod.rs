//! `sinew-lab reproduce`: the figures of a paper made again with this engine, as charts and numbers, with a
//! paragraph each that says what agrees and what does not. The paragraphs are worked out from the
//! numbers of the run.

mod axis_cost;
mod compression;
mod cost;
mod cylinder;
mod elements;
mod fibres;
mod fit_cost;
mod lumped;
mod paper_b;
mod paper_c;
mod resection;
mod shear;
mod specimen;
mod square;
mod tessellation;
mod validity;
mod ventricle;
mod volume;

pub use paper_b::{PaperBOptions, paper_b};
pub use paper_c::paper_c;

use crate::bench::error::BenchError;
use crate::bench::machine::MachineNotes;
use crate::bench::report::{Chart, page, scalable};
use crate::bench::table::{Table, escape};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A statement of the paper held against the numbers of this run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Whether they agree.
    pub agrees: bool,
    /// The statement and the numbers.
    pub text: String,
}

/// A figure or table of the paper, made again.
pub struct Figure {
    /// Its letter on the command line.
    pub letter: char,
    /// What it shows.
    pub title: &'static str,
    /// How it was made: sizes and settings that the paper does not print.
    pub setting: String,
    /// What agrees with the paper and what does not.
    pub findings: Vec<Finding>,
    /// What people read.
    pub tables: Vec<Table>,
    /// All numbers, for files only.
    pub numbers: Vec<Table>,
    /// Charts.
    pub charts: Vec<Chart>,
}

/// A paper made again.
pub struct Paper {
    /// Its name on the command line and in files.
    pub name: &'static str,
    /// Authors, year, title.
    pub reference: &'static str,
    /// Authors and year.
    pub short: &'static str,
    /// Where it ran.
    pub machine: MachineNotes,
    /// The figures, in order.
    pub figures: Vec<Figure>,
    /// Models side by side (feature `render`): name and PNG file.
    pub pictures: Vec<(String, Vec<u8>)>,
}

/// The picture of a paper when the figure it belongs to is wanted and a graphics adapter is there; `tell` hears
/// why not.
///
/// # Errors
/// When its runs cannot be carried out.
fn pictures(
    paper: &str,
    wanted: bool,
    tell: &mut dyn FnMut(&str),
) -> Result<Vec<(String, Vec<u8>)>, BenchError> {
    #[cfg(feature = "render")]
    if wanted {
        use sinew_demos::picture::{RenderJobError, papers};
        use sinew_render::{RenderError, adapter::AdapterRequest, image::Packing};
        tell("models side by side, as a picture");
        let request = AdapterRequest::default();
        let drawn = match paper {
            "paper-a" => papers::paper_a(&request),
            "paper-b" => papers::paper_b(&request),
            _ => papers::paper_c(&request),
        };
        let name = format!("{paper}-models");
        return match drawn {
            Ok(image) => match image.png(Packing::Small) {
                Ok(png) => Ok(vec![(name, png)]),
                Err(e) => Err(BenchError::Chart(e.to_string())),
            },
            Err(RenderJobError::Render(RenderError::Adapter(reason))) => {
                tell(&format!("no picture: {reason}"));
                Ok(Vec::new())
            }
            Err(e) => Err(BenchError::Chart(e.to_string())),
        };
    }
    let _ = (paper, wanted, tell);
    Ok(Vec::new())
}

const PAPER_A: &str = "Delingette 2008, Biquadratic and Quadratic Springs for Modeling St Venant \
                     Kirchhoff Materials";

/// Makes the figures of Delingette 2008 with the letters given, all with none; `tell` hears what is going
/// on.
///
/// # Errors
/// When a letter is unknown, a simulation cannot be run or a chart not be drawn.
pub fn paper_a(only: &[char], mut tell: impl FnMut(&str)) -> Result<Paper, BenchError> {
    if let Some(letter) = only.iter().find(|c| !('a'..='f').contains(*c)) {
        return Err(BenchError::Request {
            what: format!("figure {letter}"),
            remedy: "choose of a, b, c, d, e, f".into(),
        });
    }
    let wanted = |letter: char| only.is_empty() || only.contains(&letter);
    let mut figures = Vec::new();
    if wanted('a') {
        tell("a: one tetrahedron under compression");
        figures.push(compression::figure()?);
    }
    if wanted('b') {
        tell("b: a slender cylinder under its weight");
        figures.push(cylinder::figure()?);
    }
    if wanted('c') {
        tell("c: time of force and matrix-vector product");
        figures.push(cost::figure()?);
    }
    if wanted('d') {
        tell("d: laws against strain");
        figures.push(validity::figure()?);
    }
    if wanted('e') {
        tell("e: regular and irregular membranes");
        figures.push(tessellation::figure()?);
    }
    if wanted('f') {
        tell("f: resection of a liver-like organ");
        figures.push(resection::figure()?);
    }
    let (reference, short) = (PAPER_A, "Delingette 2008");
    let pictures = pictures("paper-a", wanted('b'), &mut tell)?;
    Ok(Paper { name: "paper-a", reference, short, machine: MachineNotes::now(), figures, pictures })
}

impl Figure {
    /// Findings in sentences.
    fn paragraph(&self) -> String {
        let sentence = |f: &Finding| {
            format!("{}: {}.", if f.agrees { "Agrees" } else { "Does not agree" }, f.text)
        };
        let sentences: Vec<String> = self.findings.iter().map(sentence).collect();
        sentences.join(" ")
    }
}

impl Paper {
    /// Whether every statement agrees with the numbers.
    pub fn agrees(&self) -> bool {
        self.figures.iter().all(|f| f.findings.iter().all(|f| f.agrees))
    }

    /// For the terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n{}\n", self.reference, self.machine.line());
        for figure in &self.figures {
            let _ = writeln!(text, "\n({}) {}", figure.letter, figure.title);
            let _ = writeln!(text, "{}\n", figure.setting);
            for finding in &figure.findings {
                let word = if finding.agrees { "agrees  " } else { "DIFFERS " };
                let _ = writeln!(text, "  {word} {}", finding.text);
            }
            for table in &figure.tables {
                let _ = write!(text, "\n{}", table.text());
            }
        }
        text
    }

    /// In Markdown, with the charts as files beside it.
    pub fn markdown(&self) -> String {
        let mut text = format!("# {}\n\n{}\n", self.reference, self.machine.line());
        for (name, _) in &self.pictures {
            let _ = writeln!(text, "\n![{name}]({name}.png)");
        }
        for figure in &self.figures {
            let _ = writeln!(text, "\n## ({}) {}\n", figure.letter, figure.title);
            let _ = writeln!(text, "{}\n\n{}", figure.setting, figure.paragraph());
            for chart in &figure.charts {
                let _ = writeln!(text, "\n![{0}]({0}.svg)", chart.name);
            }
            for table in &figure.tables {
                let _ = writeln!(text, "\n{}\n\n{}", table.title, table.markdown());
            }
        }
        text
    }

    /// One self-contained page.
    pub fn html(&self) -> String {
        let mut body = format!("<h1>{}</h1>\n", escape(self.reference));
        let _ = writeln!(body, "<p class=\"machine\">{}</p>", escape(&self.machine.line()));
        #[cfg(feature = "render")]
        for (name, png) in &self.pictures {
            let data = sinew_render::page::data_url("image/png", png);
            let _ = writeln!(
                body,
                "<figure><img src=\"{data}\" alt=\"{name}\" style=\"max-width:100%\"></figure>"
            );
        }
        for figure in &self.figures {
            let _ = writeln!(body, "<h2>({}) {}</h2>", figure.letter, escape(figure.title));
            let _ = writeln!(body, "<p class=\"note\">{}</p>", escape(&figure.setting));
            let _ = writeln!(body, "<p>{}</p>", escape(&figure.paragraph()));
            for chart in &figure.charts {
                let _ = writeln!(body, "<figure>{}</figure>", scalable(&chart.svg));
            }
            for table in &figure.tables {
                body += &table.html();
            }
        }
        page(&format!("{} made again", self.short), &body)
    }

    /// Writes page, Markdown, findings (JSON), one CSV per table, one SVG per chart and the pictures into a folder,
    /// which is made; returns the files.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, BenchError> {
        let error = |path: &Path, reason: String| BenchError::Write { path: path.into(), reason };
        std::fs::create_dir_all(folder).map_err(|e| error(folder, e.to_string()))?;
        let findings: Vec<_> = self.figures.iter().map(|f| (f.letter, &f.findings)).collect();
        let json = serde_json::json!({
            "schema": "sinew-reproduce/1",
            "paper": self.reference,
            "machine": self.machine,
            "findings": findings,
        });
        let mut files = vec![
            (format!("{}.html", self.name), self.html().into_bytes()),
            (format!("{}.md", self.name), self.markdown().into_bytes()),
            (format!("{}.json", self.name), format!("{json:#}\n").into_bytes()),
        ];
        for figure in &self.figures {
            for chart in &figure.charts {
                files.push((format!("{}.svg", chart.name), chart.svg.clone().into_bytes()));
            }
            for table in figure.tables.iter().chain(&figure.numbers) {
                let name = format!("{}.csv", table.name);
                let csv = table.csv().map_err(|e| error(&folder.join(&name), e.to_string()))?;
                files.push((name, csv));
            }
        }
        for (name, png) in &self.pictures {
            files.push((format!("{name}.png"), png.clone()));
        }
        let mut written = Vec::new();
        for (name, bytes) in files {
            let path = folder.join(name);
            std::fs::write(&path, bytes).map_err(|e| error(&path, e.to_string()))?;
            written.push(path);
        }
        Ok(written)
    }
}
