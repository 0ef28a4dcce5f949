//! `sinew plot`.

use clap::Args;
use sinew_cli::{Outcome, print};
use sinew_tune::plot::{charts, write};
use std::path::PathBuf;

#[derive(Args)]
pub struct PlotArguments {
    /// Tables (CSV) of runs, drawn over each other.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// File to write, .svg or .html [default: that of the first table with the ending .plot.html].
    #[arg(long, value_name = "FILE", value_parser = picture)]
    out: Option<PathBuf>,
    /// Draw columns whose names hold this word; may be given several times [default: what probes recorded].
    #[arg(long, value_name = "WORD")]
    column: Vec<String>,
}

fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let known = path.extension().is_some_and(|end| end == "svg" || end == "html");
    if known { Ok(path) } else { Err("charts are .svg or .html".into()) }
}

pub fn plot(arguments: &PlotArguments) -> Outcome {
    let files = &arguments.files;
    let out = arguments.out.clone().unwrap_or_else(|| files[0].with_extension("plot.html"));
    let found = charts(files, &arguments.column)?;
    write(&out, files, &found)?;
    let mut names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
    if names.len() > 8 {
        names.truncate(8);
        names.push("...");
    }
    print(format_args!(
        "{} charts: {}\nwritten to {}\n",
        found.len(),
        names.join(", "),
        out.display()
    ))?;
    Ok(true)
}
