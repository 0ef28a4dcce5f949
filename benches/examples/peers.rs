//! Runs the rivals and prints their rows as JSON; `--quick` for the small ones, `--python PATH` for a
//! Python with the package `mujoco`.
#![allow(clippy::print_stdout, reason = "the rows are the result")]

use sinew_benches::peers::{PeerOptions, run};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut options = PeerOptions::default();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--quick" => options.quick = true,
            "--python" => options.python = arguments.next().ok_or("--python needs a path")?,
            "--threads" => {
                options.threads = arguments.next().ok_or("--threads needs a number")?.parse()?
            }
            other => return Err(format!("unknown argument `{other}`").into()),
        }
    }
    let report = run(&options)?;
    println!("{}", serde_json::to_string_pretty(&report)?);
    Ok(())
}
