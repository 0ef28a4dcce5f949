//! Files that someone or something damaged: every reader and the scenes answer with a mesh, a run or a typed error,
//! never with a panic, a long wait or a number that is not finite.
//!
//! The seeds are the files of `tests/corpus`. `SINEW_FUZZ_CASES` sets the cases of every test, `SINEW_FUZZ_SEED`
//! the first of them: a failure prints the seed that makes it again.

#![allow(
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "seeds and counts are for whoever looks into a failure"
)]

use sinew::engine::mesh::io::read_tetgen;
use sinew::engine::mesh::{CheckOptions, Mesh, MeshError, check};
use sinew_scene::assemble::BuildOptions;
use sinew_scene::mesh_tool::MeshInfo;
use sinew_scene::run::{RunOptions, Silent, run};
use sinew_scene::scene::{Generate, LoadedScene};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The splitmix64 sequence.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn pick<'a, T: ?Sized>(&mut self, from: &[&'a T]) -> &'a T {
        from[self.below(from.len())]
    }
}

/// What numbers are replaced by.
const NUMBERS: [&str; 18] = [
    "0",
    "-1",
    "1",
    "2",
    "0.5",
    "-0.0",
    "1e-300",
    "1e308",
    "1e999",
    "-1e12",
    "nan",
    "inf",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551616",
    "\"x\"",
    "[]",
];

/// Places of a file where a number stands.
fn numbers(bytes: &[u8]) -> Vec<(usize, usize)> {
    let part = |b: u8| b.is_ascii_digit() || b"+-.eE".contains(&b);
    let mut found = Vec::new();
    let mut i = 0;
    while i < bytes.len() {
        let end = bytes[i..].iter().position(|&b| !part(b)).map_or(bytes.len(), |n| i + n);
        if bytes[i..end].iter().any(u8::is_ascii_digit) {
            found.push((i, end));
        }
        i = end + 1;
    }
    found
}

/// A damaged copy: bytes changed, spans taken out, repeated, moved or taken from another file, numbers
/// replaced, the end cut off.
fn damaged(random: &mut Random, seeds: &[Vec<u8>], whole_numbers_only: bool) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].clone();
    let rounds = if whole_numbers_only { 1 } else { 1 + random.below(4) };
    for _ in 0..rounds {
        let kind = if whole_numbers_only { 0 } else { random.below(8) };
        let start = random.below(bytes.len());
        let end = (start + 1 + random.below(40)).min(bytes.len());
        match kind {
            0 | 1 => {
                let places = numbers(&bytes);
                if !places.is_empty() {
                    let (start, end) = places[random.below(places.len())];
                    bytes.splice(start..end, random.pick(&NUMBERS).bytes());
                }
            }
            2 if !bytes.is_empty() => bytes[start] = random.next() as u8,
            3 if !bytes.is_empty() => bytes[start] ^= 1 << random.below(8),
            4 => drop(bytes.drain(start..end)),
            5 => {
                let span = bytes[start..end].to_vec();
                let times = 1 + random.below(3);
                (0..times).for_each(|_| drop(bytes.splice(start..start, span.iter().copied())));
            }
            6 => {
                let other = &seeds[random.below(seeds.len())];
                let from = random.below(other.len());
                let to = (from + 1 + random.below(80)).min(other.len());
                bytes.splice(start..end, other[from..to].iter().copied());
            }
            _ => bytes.truncate(end),
        }
    }
    bytes
}

fn corpus(extension: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    // the order of a folder is not that of every machine
    files.sort();
    let files = files.iter().filter(|path| path.extension().is_some_and(|e| e == extension));
    let seeds: Vec<Vec<u8>> = files.map(|path| std::fs::read(path).unwrap()).collect();
    assert!(!seeds.is_empty(), "no seed {extension}");
    seeds
}

/// Runs `case` on damaged files and says from which seed one comes that it does not survive.
fn survive(extension: &str, cases: u64, mut case: impl FnMut(&[u8]) -> bool) {
    let number = |name: &str| std::env::var(name).ok().and_then(|n| n.parse::<u64>().ok());
    let cases = number("SINEW_FUZZ_CASES").unwrap_or(cases);
    let first = number("SINEW_FUZZ_SEED").unwrap_or(0);
    let seeds = corpus(extension);
    for seed in &seeds {
        assert!(case(seed), "a file of the corpus is refused");
    }
    struct Told(u64);
    impl Drop for Told {
        fn drop(&mut self) {
            if std::thread::panicking() {
                eprintln!("SINEW_FUZZ_SEED={} SINEW_FUZZ_CASES=1 makes it again", self.0);
            }
        }
    }
    let mut accepted = 0;
    for seed in first..first + cases {
        let _told = Told(seed);
        // every other file has one changed number and is otherwise whole
        let bytes = damaged(&mut Random(seed << 8), &seeds, seed % 2 == 0);
        let clock = Instant::now();
        accepted += u64::from(case(&bytes));
        assert!(clock.elapsed() < Duration::from_secs(20), "{:?}", clock.elapsed());
    }
    println!("{extension}: {cases} cases, {accepted} accepted");
    // what is always or never refused tests one half only
    assert!(cases < 100 || (accepted > 0 && accepted < cases), "{accepted} of {cases} accepted");
}

fn is_told(message: &str, file: &str) {
    assert!(message.contains(file), "names no file: {message}");
    assert!(message.len() < 1500, "{} bytes: {message}", message.len());
    assert!(
        !message.chars().any(|c| c.is_control() && c != '\n'),
        "control characters: {message:?}"
    );
}

/// Whether the mesh can be simulated; what the check repairs or refuses is told, all numbers are finite.
fn answered(result: Result<Mesh, MeshError>, file: &str) -> bool {
    let mesh = match result {
        Ok(mesh) => mesh,
        Err(error) => {
            is_told(&error.to_string(), file);
            return false;
        }
    };
    let info = serde_json::to_string(&MeshInfo::of(&mesh)).unwrap();
    match check(&mesh, &CheckOptions::default()) {
        Ok(checked) => {
            // what is not finite is written as null
            let finite = checked.mesh.points.iter().all(|p| p.is_finite());
            assert!(finite && !info.contains("null"), "{info}");
            true
        }
        Err(error) => {
            is_told(&error.to_string(), "");
            false
        }
    }
}

fn reader(extension: &str) {
    let file = format!("fuzz.{extension}");
    survive(extension, 2000, |bytes| answered(Mesh::from_bytes(&file, bytes), &file));
}

#[test]
fn gmsh_files() {
    reader("msh");
}

#[test]
fn vtk_files() {
    reader("vtk");
}

#[test]
fn vtu_files() {
    reader("vtu");
}

#[test]
fn obj_files() {
    reader("obj");
}

#[test]
fn stl_files() {
    reader("stl");
}

#[test]
fn tetgen_files() {
    let whole = |extension: &str| corpus(extension).remove(0);
    let (node, ele, face) = (whole("node"), whole("ele"), whole("face"));
    for kind in ["node", "ele", "face"] {
        survive(kind, 2000, |bytes| {
            let pick = |own: &str, other| if own == kind { bytes } else { other };
            let (node, ele, face) =
                (pick("node", &node[..]), pick("ele", &ele[..]), pick("face", &face[..]));
            answered(read_tetgen(node, ele, Some(face), "fuzz.node"), "fuzz.")
        });
    }
}

/// Cells of a shape, above which a test need not build it.
fn small(shape: &Generate) -> bool {
    let product = |counts: &[usize]| counts.iter().map(|&n| n as f64).product::<f64>() < 2000.0;
    shape.cuboid.as_ref().is_none_or(|s| product(&s.cells))
        && shape.cylinder.as_ref().is_none_or(|s| product(&[s.rings, s.rings, s.layers]))
        && shape.sheet.as_ref().is_none_or(|s| product(&s.cells))
}

/// Scenes are built and carried on for two steps.
#[test]
fn scenes() {
    survive("toml", 3000, |bytes| {
        let Ok(text) = std::str::from_utf8(bytes) else { return false };
        let told = |error: &dyn std::error::Error| {
            is_told(&error.to_string(), "fuzz.toml");
            false
        };
        let scene = match LoadedScene::parse(text, Path::new("fuzz.toml")) {
            Ok(scene) => scene,
            Err(error) => return told(&error),
        };
        // sizes that no machine has are refused soon; those that a machine has may take their time
        let beyond =
            |s: &Generate| s.cuboid.as_ref().is_some_and(|s| s.cells.contains(&usize::MAX));
        if !scene.scene.bodies.iter().flat_map(|b| &b.generate).all(|s| small(s) || beyond(s)) {
            return true;
        }
        let build = BuildOptions { steps: Some(2), threads: Some(1), ..BuildOptions::default() };
        match run(&scene, &RunOptions { build, ..RunOptions::default() }, &mut Silent) {
            Err(error) => told(&error),
            Ok(summary) => {
                let e = &summary.energy;
                let finite = [e.elastic, e.kinetic, e.load_work, e.constraint_work];
                assert!(finite.iter().all(|x| x.is_finite()), "{e:?}");
                summary.failure.inspect(|failure| is_told(failure, "")).is_none()
            }
        }
    });
}
