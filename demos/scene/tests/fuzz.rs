//! Files that someone or something damaged: every reader and the scenes answer with a mesh, a run or a typed error,
//! never with a panic, a long wait or a number that is not finite.
//!
//! Beside them stand scenes made up at random: every kind of body, law and integrator, with tools, contacts, pulls, pressures and
//! cuts, well and badly proportioned.
//!
//! The seeds of damaged files are those of `tests/corpus`. `SINEW_FUZZ_CASES` sets the cases of every test, `SINEW_FUZZ_SEED`
//! the first of them, `SINEW_FUZZ_SECONDS` the longest that one may take: a failure prints the seed that makes it again.

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
    let seeds = corpus(extension);
    for seed in &seeds {
        assert!(case(seed), "a file of the corpus is refused");
    }
    survive_seeds(extension, cases, |seed| {
        // every other file has one changed number and is otherwise whole
        case(&damaged(&mut Random(seed << 8), &seeds, seed % 2 == 0))
    });
}

/// Runs `case` on many seeds, some of which it accepts, and says which it does not survive.
fn survive_seeds(what: &str, cases: u64, mut case: impl FnMut(u64) -> bool) {
    let number = |name: &str| std::env::var(name).ok().and_then(|n| n.parse::<u64>().ok());
    let cases = number("SINEW_FUZZ_CASES").unwrap_or(cases);
    let first = number("SINEW_FUZZ_SEED").unwrap_or(0);
    // on a busy machine the slowest case that its caps end takes half of this
    let limit = number("SINEW_FUZZ_SECONDS").unwrap_or(60);
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
        let clock = Instant::now();
        accepted += u64::from(case(seed));
        assert!(clock.elapsed() < Duration::from_secs(limit), "{:?}", clock.elapsed());
    }
    println!("{what}: {cases} cases, {accepted} accepted");
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

/// Whether a scene runs so many steps; what it says is said well, what it computed is finite.
fn runs(text: &str, steps: u64, out: Option<&Path>) -> bool {
    let told = |error: &dyn std::error::Error| {
        is_told(&error.to_string(), "fuzz.toml");
        false
    };
    let scene = match LoadedScene::parse(text, Path::new("fuzz.toml")) {
        Ok(scene) => scene,
        Err(error) => return told(&error),
    };
    // sizes that no machine has are refused soon; those that a machine has may take their time
    let beyond = |s: &Generate| s.cuboid.as_ref().is_some_and(|s| s.cells.contains(&usize::MAX));
    if !scene.scene.bodies.iter().flat_map(|b| &b.generate).all(|s| small(s) || beyond(s)) {
        return true;
    }
    let build = BuildOptions { steps: Some(steps), threads: Some(1), ..BuildOptions::default() };
    let options = RunOptions { build, out: out.map(Into::into), ..RunOptions::default() };
    match run(&scene, &options, &mut Silent) {
        Err(error) => told(&error),
        Ok(summary) => {
            let e = &summary.energy;
            let finite = [e.elastic, e.kinetic, e.load_work, e.constraint_work];
            assert!(finite.iter().all(|x| x.is_finite()), "{e:?}");
            let report = summary.to_string() + &summary.brief().to_string();
            assert!(!report.contains("NaN") && !report.contains(" inf"), "{report}");
            summary.failure.inspect(|failure| is_told(failure, "")).is_none()
        }
    }
}

/// Scenes are built and carried on for two steps.
#[test]
fn scenes() {
    survive("toml", 3000, |bytes| std::str::from_utf8(bytes).is_ok_and(|text| runs(text, 2, None)));
}

impl Random {
    /// A number between two positive ones, its logarithm spread evenly.
    fn log(&mut self, low: f64, high: f64) -> f64 {
        let share = (self.next() >> 11) as f64 / (1_u64 << 53) as f64;
        (low.ln() * (1.0 - share) + high.ln() * share).exp()
    }

    /// A vector of lengths about `size`.
    fn vector(&mut self, size: f64) -> String {
        let mut one = || (2.0 * (self.next() >> 11) as f64 / (1_u64 << 53) as f64 - 1.0) * size;
        format!("[{:.6}, {:.6}, {:.6}]", one(), one(), one())
    }

    fn chance(&mut self, of: usize) -> bool {
        self.below(of) == 0
    }
}

/// A body of any kind, about a decimetre in size.
fn random_body(random: &mut Random, name: &str) -> String {
    let shape = random.pick(&[
        "box = { size = [0.1, 0.08, 0.06], cells = [2, 1, 2] }",
        "box = { size = [0.1, 0.1, 0.1], cells = [2, 2, 1], elements = \"hexahedra\" }",
        "box = { size = [0.2, 0.02, 0.02], cells = [4, 1, 1], elements = \"irregular\", seed = 3 }",
        "sphere = { radius = 0.05, shells = 2 }",
        "cylinder = { radius = 0.03, length = 0.1, rings = 1, layers = 2 }",
        "tube = { radius = 0.02, wall = 0.01, length = 0.05, around = 8, through = 1, along = 3 }",
        "cup = { radius = 0.03, depth = 0.05, wall = 0.01, core = 2, rings = 1, layers = 1 }",
        "sheet = { size = [0.1, 0.1], cells = [2, 2] }",
        "disc = { radius = 0.05, rings = 2 }",
        "balloon = { radius = 0.05, cuts = 2 }",
    ]);
    let flat = ["sheet", "disc", "balloon"].iter().any(|own| shape.starts_with(own));
    let nu = random.pick(&["0.0", "0.3", "0.45", "0.45", "0.49", "0.4999"]);
    let (young, density) = (random.log(1e2, 1e7), random.log(1e2, 1e4));
    let mut text = format!(
        "[[body]]\nname = \"{name}\"\ngenerate = {{ {shape} }}\ntranslate = {}\n\
         material = {{ young_modulus = {young:e}, poisson_ratio = {nu}, density = {density:e} }}\n",
        random.vector(0.1)
    );
    // of surfaces that are closed; others are refused
    let lattice = random.chance(5);
    if lattice {
        text += &format!("lattice = {:e}\n", random.log(8e-3, 0.1));
    }
    let model = random.pick(&[
        "svk_comp",
        "svk",
        "svk_volume",
        "neo_hookean",
        "corotational",
        "linear",
        "svk_fem",
        "tqs",
        "corotational_warped",
        "mass_spring",
    ]);
    if flat && !lattice {
        text += &format!("membrane = {{ thickness = {:e} }}\n", random.log(1e-4, 1e-2));
    } else {
        text += &format!("model = \"{model}\"\n");
        if random.chance(3) {
            text += "volume = \"clusters\"\n";
        }
        if random.chance(5) {
            text += "second_order = true\n";
        }
        if random.chance(6) {
            text += "membrane = { thickness = 0.001, surface = true }\n";
        }
        if random.chance(4) {
            let (modulus, stress) = (random.log(1e2, 1e5), random.log(1e2, 1e5));
            text += &format!(
                "[[body.fibres]]\nname = \"f\"\nmodulus = {modulus:e}\ndirection = [1.0, 0.2, 0.0]\n\
                 muscle = {{ peak_stress = {stress:e}, curve = {{ ramp = [0.0, 0.03] }} }}\n"
            );
        }
    }
    text
}

/// A scene of any kind.
fn random_scene(seed: u64) -> String {
    let mut random = Random(seed << 8 | 1);
    let random = &mut random;
    let integrator = random.pick(&[
        "auto",
        "auto",
        "safe",
        "safe",
        "newton",
        "bdf2",
        "tr-bdf2",
        "linearised-tr-bdf2",
        "symplectic-euler",
        "stormer-verlet",
    ]);
    let dt = random.log(1e-4, 3e-2);
    let gravity = random.pick(&["[0.0, 0.0, -9.81]", "[0.0, 0.0, 0.0]", "[30.0, 0.0, 0.0]"]);
    // caps that end a hopeless case soon: a loop that has none shows by its time
    let mut text = format!(
        "name = \"fuzz\"\ndt = {dt:e}\nduration = {:e}\ngravity = {gravity}\n\
         solver = {{ integrator = \"{integrator}\", max_newton_iterations = 15, max_linear_iterations = 1000, max_substeps = 4000 }}\n\
         output = {{ every = 2 }}\n",
        20.0 * dt
    );
    let two = random.chance(2);
    text += &random_body(random, "a");
    if two {
        text += &random_body(random, "b");
        let friction = random.pick(&["0.0", "0.4"]);
        text +=
            &format!("[[contact]]\nname = \"c\"\nbodies = [\"a\", \"b\"]\nfriction = {friction}\n");
    }
    let box_round = "box = { min = [-9.0, -9.0, -9.0], max = [0.02, 9.0, 9.0] }";
    if random.chance(2) {
        text +=
            &format!("[[constraint]]\nname = \"hold\"\nbody = \"a\"\nselect = {{ {box_round} }}\n");
        if random.chance(2) {
            let size = random.log(1e-3, 10.0);
            let by = random.vector(size);
            text += &format!(
                "motion = {{ translate = {by} }}\ncurve = {{ ramp = [0.0, {:e}] }}\n",
                6.0 * dt
            );
        }
    }
    if random.chance(2) {
        let shape = random.pick(&[
            "shape = \"sphere\"\nradius = 0.02",
            "shape = \"half-space\"",
            "shape = \"box\"\nhalf = [0.05, 0.05, 0.01]",
            "shape = \"capsule\"\nradius = 0.01\nhalf_length = 0.05",
        ]);
        let (at, by) = (random.vector(0.15), random.vector(0.2));
        text += &format!(
            "[[tool]]\nname = \"t\"\n{shape}\nat = {at}\ntranslate = {by}\nfriction = 0.3\ncurve = {{ ramp = [0.0, {:e}] }}\n",
            8.0 * dt
        );
    }
    if random.chance(4) {
        let (stiffness, by) = (random.log(1.0, 1e4), random.vector(0.3));
        text += &format!(
            "[[pull]]\nname = \"p\"\nbody = \"a\"\nselect = {{ all = true }}\nstiffness = {stiffness:e}\ntranslate = {by}\n"
        );
    }
    if random.chance(3) {
        let sign = random.pick(&["", "-"]);
        let pressure = random.log(1.0, 1e5);
        let on = random.pick(&["surface", "membrane"]);
        text += &format!(
            "[[pressure]]\nname = \"air\"\nbody = \"a\"\non = {{ {on} = true }}\npressure = {sign}{pressure:e}\n"
        );
    }
    if random.chance(4) {
        let centre = random.vector(0.1);
        text += &format!(
            "[[resection]]\nname = \"cut\"\nbody = \"a\"\nsphere = {{ centre = {centre}, radius = 0.06 }}\nfrom = {:e}\n",
            3.0 * dt
        );
    }
    text
}

/// Frames of a run hold finite numbers, cells without a value aside.
fn frames_are_finite(out: &Path) {
    for entry in std::fs::read_dir(out.join("frames")).unwrap() {
        let path = entry.unwrap().path();
        let mesh = Mesh::read(&path).unwrap();
        assert!(mesh.points.iter().all(|p| p.is_finite()), "{}", path.display());
    }
    let rows = std::fs::read_to_string(out.join("fuzz.csv")).unwrap();
    assert!(!rows.contains("NaN") && !rows.contains("inf,"), "{rows}");
}

/// Scenes of every kind run, or are refused, or fail in words; what they write is finite.
#[test]
fn scenes_made_up_at_random() {
    let out = std::env::temp_dir().join(format!("sinew-fuzz-{}", std::process::id()));
    survive_seeds("random scenes", 250, |seed| {
        let files = seed % 10 == 0;
        let scene = random_scene(seed);
        if std::env::var("SINEW_FUZZ_CASES").is_ok_and(|cases| cases == "1") {
            println!("# seed {seed}\n{scene}");
        }
        let done = runs(&scene, 8, files.then_some(&*out));
        if files && out.join("fuzz.csv").is_file() {
            frames_are_finite(&out);
            std::fs::remove_dir_all(&out).unwrap();
        }
        done
    });
}
