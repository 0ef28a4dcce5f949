//! The figures of three papers made again with this engine, command `sinew-papers`: charts and numbers, with a verdict on
//! every statement. The lines are worked out from the numbers of the run.

pub mod axes;
mod axis_cost;
mod between;
mod compression;
mod cost;
mod cylinder;
mod drawing;
mod elements;
mod equivalence;
mod fibres;
pub mod figure;
mod fit_cost;
mod frame;
mod lumped;
mod overlay;
#[cfg(feature = "render")]
mod picture;
mod prelude;
mod relaxed;
mod resection;
mod shapes;
mod shear;
mod specimen;
mod square;
mod tessellation;
mod validity;
mod ventricle;
mod volume;

use figure::{Figure, Verdict};
use lumped::Meshes;
use sinew_benches::toolbox::error::{BenchError, Result};
use sinew_benches::toolbox::report::ReportFiles;
use sinew_tune::machine::{MachineNotes, Watch};
use sinew_tune::page::Page;
use sinew_tune::table::escape;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// How figures are made.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Folder with files `b_*.msh` for Natsupakpong & Cavusoglu 2010; without one they are generated.
    pub meshes: Option<PathBuf>,
    /// Few rows, for tests.
    pub quick: bool,
}

/// What a figure is made with.
struct Setup {
    meshes: Meshes,
    quick: bool,
}

type Make = fn(&Setup) -> Result<Figure>;

/// A paper that can be made again.
pub struct Source {
    /// Its name in files.
    pub name: &'static str,
    /// Authors, year, title.
    pub reference: &'static str,
    /// Authors and year.
    pub short: &'static str,
    /// Letter of the figure that its picture belongs to.
    picture: char,
    /// Titles of its figures, which have the letters a, b, ..., and what makes them.
    figures: &'static [(&'static str, Make)],
}

/// Delingette 2008.
pub static PAPER_A: Source = Source {
    name: "paper-a",
    reference: "Delingette 2008, Biquadratic and Quadratic Springs for Modeling St Venant Kirchhoff Materials",
    short: "Delingette 2008",
    picture: 'b',
    figures: &[
        ("One tetrahedron under compression (Fig. 2, left)", |_| compression::figure()),
        ("A slender cylinder under its weight (Fig. 2, right)", |_| cylinder::figure()),
        ("Time of force and matrix-vector product (Fig. 3, top)", |_| cost::figure()),
        ("Quadratic springs and other laws against strain", |_| validity::figure()),
        ("A membrane on regular and irregular tessellations", |_| tessellation::figure()),
        ("Resection of a liver in real time (Fig. 3, bottom)", |_| resection::figure()),
        ("The springs are the material (sections 2.3, 2.4, 3)", |_| equivalence::figure()),
    ],
};

/// Natsupakpong & Cavusoglu 2010.
pub static PAPER_B: Source = Source {
    name: "paper-b",
    reference: "Natsupakpong & Cavusoglu 2010, Determination of elasticity parameters in lumped \
                element (mass-spring) models of deformable objects",
    short: "Natsupakpong & Cavusoglu 2010",
    picture: 'a',
    figures: &[
        ("Objects in tension (tables 1 and 3)", elements::figure),
        ("Time to find spring constants (table 2)", |setup| fit_cost::figure(setup.quick)),
        ("The tensile specimen (tables 4 and 5)", specimen::figure),
        ("One square of springs (figure 9)", |_| square::figure()),
        ("Squares and cubes in shear (table 6), and solids in torsion", shear::figure),
        ("The ventricle floor (section 3.5)", |setup| ventricle::figure(setup.quick)),
    ],
};

/// Bourguignon & Cani 2000.
pub static PAPER_C: Source = Source {
    name: "paper-c",
    reference: "Bourguignon & Cani 2000, Controlling Anisotropy in Mass-Spring Systems",
    short: "Bourguignon & Cani 2000",
    picture: 'a',
    figures: &[
        ("A block pulled down, by the course of its fibres", |_| fibres::figure()),
        ("Stiffness in directions between the axes", |_| between::figure()),
        ("Volume on a table, and a cantilever", |_| volume::figure()),
        ("Time", |_| axis_cost::figure()),
    ],
};

impl Source {
    /// Makes the figures with the letters given, all with none; `tell` hears what is going on.
    ///
    /// # Errors
    /// When a letter is unknown, a mesh cannot be used, a simulation or test not be run or a chart not be
    /// drawn.
    pub fn make(
        &'static self,
        only: &[char],
        options: &Options,
        mut tell: impl FnMut(&str),
    ) -> Result<Paper> {
        let letters: Vec<char> = ('a'..).take(self.figures.len()).collect();
        if let Some(letter) = only.iter().find(|c| !letters.contains(c)) {
            let known: Vec<String> = letters.iter().map(char::to_string).collect();
            return Err(BenchError::Request {
                what: format!("figure {letter}"),
                remedy: format!("choose of {}", known.join(", ")),
            });
        }
        let setup = Setup { meshes: Meshes::find(options)?, quick: options.quick };
        let wanted = |letter: char| only.is_empty() || only.contains(&letter);
        let machine = MachineNotes::now();
        let mut figures = Vec::new();
        for (letter, (title, make)) in letters.into_iter().zip(self.figures) {
            if wanted(letter) {
                tell(&format!("{letter}: {title}"));
                let watch = Watch::start();
                let mut figure = make(&setup)?;
                let busy = watch.finish().warning(machine.cores).is_some();
                if busy {
                    let timed = figure.findings.iter_mut().filter(|f| f.timed);
                    timed.for_each(|f| f.verdict = Verdict::NotJudged);
                }
                figures.push((letter, *title, figure));
            }
        }
        let pictures = pictures(self.name, wanted(self.picture) && !options.quick, &mut tell)?;
        let meshes = (self.name == PAPER_B.name).then(|| setup.meshes.source());
        Ok(Paper { source: self, machine, meshes, figures, pictures })
    }
}

/// A paper made again.
pub struct Paper {
    /// Which.
    pub source: &'static Source,
    /// Where it ran.
    pub machine: MachineNotes,
    /// Which meshes it ran on, where there is a choice.
    pub meshes: Option<String>,
    /// Letters, titles and figures, in order.
    pub figures: Vec<(char, &'static str, Figure)>,
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
) -> Result<Vec<(String, Vec<u8>)>> {
    #[cfg(feature = "render")]
    if wanted {
        use sinew_render::{RenderError, adapter::AdapterRequest, image::Packing};
        use sinew_scene::picture::RenderJobError;
        tell("models side by side, as a picture");
        let request = AdapterRequest::default();
        let drawn = match paper {
            "paper-a" => picture::paper_a(&request),
            "paper-b" => picture::paper_b(&request),
            _ => picture::paper_c(&request),
        };
        let name = format!("{paper}-models");
        return match drawn {
            Ok(image) => {
                let png =
                    image.png(Packing::Small).map_err(|e| BenchError::Chart(e.to_string()))?;
                Ok(vec![(name, png)])
            }
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

impl Paper {
    /// How often each verdict was given, in words.
    fn count(&self) -> String {
        let verdicts = self.figures.iter().flat_map(|f| f.2.verdicts());
        format!("Statements of the paper: {}", Verdict::counted(verdicts))
    }

    /// For the terminal.
    pub fn text(&self) -> String {
        let meshes = self.meshes.iter().map(|m| format!("{m}.\n")).collect::<String>();
        let (reference, count) = (self.source.reference, self.count());
        let mut text = format!("{meshes}{reference}\n{}\n{count}\n", self.machine.line());
        for (letter, title, figure) in &self.figures {
            let _ = writeln!(text, "\n({letter}) {title}\n{}\n", figure.setting);
            for finding in &figure.findings {
                let _ = writeln!(text, "  {:18} {}", finding.verdict.word(), finding.whole());
            }
            for table in &figure.tables {
                let _ = write!(text, "\n{}", table.text());
            }
        }
        text
    }

    /// In Markdown, with the charts as files beside it.
    pub fn markdown(&self) -> String {
        let meshes = self.meshes.iter().map(|m| format!("{m}.\n\n")).collect::<String>();
        let (reference, machine) = (self.source.reference, self.machine.line());
        let mut text = format!("# {reference}\n\n{meshes}{machine}\n\n{}.\n", self.count());
        for (name, _) in &self.pictures {
            let _ = writeln!(text, "\n![{name}]({name}.png)");
        }
        for (letter, title, figure) in &self.figures {
            let _ = writeln!(text, "\n## ({letter}) {title}\n");
            let _ = writeln!(text, "{}\n", figure.setting);
            for finding in &figure.findings {
                let _ = writeln!(text, "- **{}:** {}.", finding.verdict.word(), finding.whole());
            }
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
        let title = format!("{} made again", self.source.short);
        let mut page = Page::new(title, self.source.reference, &self.machine.line());
        self.meshes.iter().for_each(|meshes| page.paragraph("note", &format!("{meshes}.")));
        page.headline(&self.count());
        #[cfg(feature = "render")]
        for (name, png) in &self.pictures {
            let data = sinew_render::page::data_url("image/png", png);
            page.add(format_args!("<figure><img src=\"{data}\" alt=\"{name}\"></figure>"));
        }
        for (letter, title, figure) in &self.figures {
            let count = Verdict::counted(figure.verdicts());
            page.entry(&format!("figure-{letter}"), &format!("({letter}) {title}: {count}"));
            page.add(format_args!("<h2 id=\"figure-{letter}\">({letter}) {}</h2>", escape(title)));
            page.paragraph("note", &figure.setting);
            figure.list(&mut page);
            figure.charts.iter().for_each(|chart| page.chart(chart));
            figure.tables.iter().for_each(|table| page.table(table));
        }
        page.html()
    }

    /// Writes page, Markdown, findings (JSON), one CSV per table, one SVG per chart and the pictures into a folder,
    /// which is made; returns the files.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        let name = self.source.name;
        let findings: Vec<_> = self.figures.iter().map(|(l, _, f)| (l, &f.findings)).collect();
        let json = serde_json::json!({
            "schema": "sinew-reproduce/2",
            "paper": self.source.reference,
            "machine": self.machine,
            "findings": findings,
        });
        let mut files = ReportFiles::default();
        files.add(format!("{name}.html"), self.html());
        files.add(format!("{name}.md"), self.markdown());
        files.json(format!("{name}.json"), &json)?;
        for (_, _, figure) in &self.figures {
            files.parts(&figure.charts, figure.tables.iter().chain(&figure.numbers))?;
        }
        for (name, png) in &self.pictures {
            files.add(format!("{name}.png"), png.clone());
        }
        files.write(folder)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(source: &'static Source, letter: char, options: &Options) -> String {
        source.make(&[letter], options, |_| {}).err().unwrap().to_string()
    }

    #[test]
    fn wrong_letters_and_folders_are_named() {
        let options = Options::default();
        let unknown = error(&PAPER_B, 'g', &options);
        assert!(unknown.contains("figure g"), "{unknown}");
        let unknown = error(&PAPER_C, 'x', &options);
        assert!(unknown.contains("figure x") && unknown.contains("a, b, c, d"), "{unknown}");
        let meshes = Some(PathBuf::from("nowhere"));
        let folder = error(&PAPER_B, 'a', &Options { meshes, quick: false });
        assert!(folder.contains("nowhere") && folder.contains("b_cube_hex.msh"), "{folder}");
    }

    #[test]
    fn all_figures_in_their_quick_form() {
        let options = Options { meshes: None, quick: true };
        let paper = PAPER_B.make(&[], &options, |_| {}).unwrap();
        let letters: String = paper.figures.iter().map(|f| f.0).collect();
        assert_eq!(letters, "abcdef");
        let (text, html) = (paper.text(), paper.html());
        assert!(text.contains("Table 6") && html.contains("Natsupakpong &amp; Cavusoglu"));
        assert!(!text.contains("NaN"), "{text}");
        assert!(text.starts_with("Meshes: generated"), "{text}");
        // the count first, then a line a claim
        let all = paper.figures.iter().map(|f| f.2.findings.len()).sum::<usize>();
        assert!(html.contains(&paper.count()) && html.matches("<li class=").count() == all);
        assert!(html.find("Statements of the paper").unwrap() < html.find("<h2").unwrap());
        assert_eq!(html.matches("<a href=\"#figure-").count(), 6);
    }
}
