//! Lists of fields that other languages need again: written from the structures of Rust, never by hand.
//!
//! A test fails when a copy is stale; with `SINEW_LISTS=write` in the environment it writes them.

use std::path::Path;
use std::slice;

/// A field, a constant or an argument: its name, its type or value, and its documentation in one line.
struct Item {
    name: String,
    of: String,
    doc: String,
}

fn source(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Documentation that ends where a text ends, in one line.
fn doc_before(text: &str) -> String {
    let lines: Vec<&str> = text.lines().rev().map(str::trim).collect();
    let lines = lines.iter().skip_while(|line| line.is_empty() || line.starts_with("#["));
    let mut doc: Vec<&str> = lines.map_while(|line| line.strip_prefix("///")).collect();
    doc.reverse();
    doc.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" ")
}

/// A structure of a source: its documentation and its fields.
fn structure(source: &str, name: &str) -> (String, Vec<Item>) {
    let at = source.find(&format!("pub struct {name} ")).unwrap_or_else(|| panic!("no {name}"));
    let (_, body) = source[at..].split_once("{\n").unwrap();
    let body = body.split("}\n").next().unwrap();
    let mut fields = Vec::new();
    for (start, _) in body.match_indices("pub ") {
        let line = body[start + 4..].lines().next().unwrap().trim_end_matches(',');
        let (name, of) = line.split_once(": ").unwrap();
        // what follows in a table of figures
        let of = of.split(" => ").next().unwrap();
        let doc = doc_before(&body[..start]);
        fields.push(Item { name: name.into(), of: of.into(), doc });
    }
    assert!(!fields.is_empty(), "{name}");
    (doc_before(&source[..at]), fields)
}

/// Links of Rust as `link` words them.
fn unlinked(doc: &str, link: impl Fn(&str) -> String) -> String {
    let mut parts = doc.split("[`");
    let mut plain = parts.next().unwrap_or_default().to_string();
    for part in parts {
        let (path, rest) = part.split_once("`]").unwrap();
        plain += &link(path.rsplit("::").next().unwrap());
        plain += rest;
    }
    plain
}

/// Text in lines of at most 120 columns, each after an indent.
fn wrapped(text: &str, indent: &str) -> String {
    let (mut all, mut line) = (String::new(), indent.trim_end().to_string());
    for word in text.split_whitespace() {
        if line.len() + word.len() + 1 > 120 {
            all += &line;
            all.push('\n');
            line = indent.trim_end().into();
        }
        let space = if line.trim().is_empty() { &indent[line.len()..] } else { " " };
        line += space;
        line += word;
    }
    all + &line + "\n"
}

/// Holds a file against what it should be, or writes it.
#[track_caller]
fn kept(path: &str, text: &str) {
    let place = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path);
    if std::env::var("SINEW_LISTS").is_ok_and(|value| value == "write") {
        std::fs::write(&place, text).unwrap();
    }
    let found = std::fs::read_to_string(&place).unwrap_or_default();
    assert!(
        found == text,
        "{path} is not that of the sources: run this test with SINEW_LISTS=write"
    );
}

const TOOL: &str = "solvers/contact/src/tool.rs";
const THREAD: &str = "solvers/contact/src/thread.rs";
const TEAR: &str = "models/src/cutting/tear.rs";
const GLUE: &str = "models/src/cutting/glue.rs";

/// Type in C, and how it is read, of a field of a report.
fn plain_c(name: &str, of: &str) -> (&'static str, String) {
    match of {
        "DVec3" => ("[f64; 3]", format!("r.{name}.to_array()")),
        "DQuat" => ("[f64; 4]", format!("r.{name}.to_array()")),
        "Option<DVec3>" => ("[f64; 3]", format!("r.{name}.unwrap_or_default().to_array()")),
        "Option<DMat3>" => ("[f64; 9]", format!("r.{name}.unwrap_or(DMat3::ZERO).to_cols_array()")),
        "f64" => ("f64", format!("r.{name}")),
        "u32" => ("u32", format!("r.{name}")),
        "bool" => ("u32", format!("r.{name}.into()")),
        _ => panic!("{name}: {of} is not known to C"),
    }
}

/// Structures of C for reports, and how they are filled.
fn reports_of_c() -> String {
    let mut text = String::from(
        "//! Structures of reports, and how they are filled. Written by test `lists` of sinew-embed; do not edit.\n\n\
         use sinew_embed::{DMat3, PartReport, ToolReport};\n",
    );
    for (own, name) in [("ToolReport", "sinew_tool_report"), ("PartReport", "sinew_part_report")] {
        let (doc, fields) = structure(&source(TOOL), own);
        let (mut list, mut filled) = (String::new(), String::new());
        let mut add = |doc: &str, name: &str, of: &str, read: &str| {
            list += &wrapped(doc, "    /// ");
            list += &format!("    pub {name}: {of},\n");
            filled += &format!("            {name}: {read},\n");
        };
        if own == "ToolReport" {
            let doc = format!("sizeof({name}), set by the caller");
            add(&doc, "struct_size", "u32", "size_of::<Self>() as u32");
            let doc = "Number of its parts, if there are several.";
            add(doc, "parts", "u32", "r.parts.len() as u32");
        }
        for field in fields.iter().filter(|field| field.name != "parts") {
            let (of, read) = plain_c(&field.name, &field.of);
            let mut doc = unlinked(&field.doc, |word| format!("`SINEW_{}`", word.to_uppercase()));
            if field.of.starts_with("Option") {
                doc += " All 0 without.";
            }
            let name = if field.of == "DQuat" { "quaternion" } else { &field.name };
            add(&doc, name, of, &read);
        }
        let doc = wrapped(&doc, "/// ");
        text += &format!(
            "\n{doc}#[repr(C)]\n#[derive(Clone, Copy)]\npub struct {name} {{\n{list}}}\n\n\
             impl From<&{own}> for {name} {{\n    fn from(r: &{own}) -> Self {{\n        Self {{\n{filled}        }}\n    }}\n}}\n"
        );
    }
    text
}

/// Type in Python of a field, and the shape of its array. Numbers that come as JSON are `None` when they are not finite.
fn python(name: &str, of: &str, json: bool) -> (String, &'static str) {
    let float = if json { "float | None" } else { "float" };
    let (of, shape) = match of {
        "DVec3" => ("Floats", "(3,)"),
        "DQuat" => ("Floats", "a quaternion (x, y, z, w)"),
        "Option<DVec3>" => ("Floats | None", "(3,)"),
        "Option<DMat3>" => ("Floats | None", "(3, 3)"),
        "f64" => (float, ""),
        "Option<f64>" => ("float | None", ""),
        "u32" | "u64" | "usize" => ("int", ""),
        "bool" => ("bool", ""),
        "[f64; 3]" => ("list[float]", ""),
        "[DVec3; 2]" => ("Floats", "(2, 3)"),
        "Vec<DVec3>" => ("Floats", "(n, 3)"),
        "Vec<f64>" if !json => ("Floats", "(n,)"),
        "Vec<f64>" => ("list[float | None]", ""),
        "Vec<u32>" | "Vec<u64>" | "Vec<MeshVertex>" => ("list[int]", ""),
        "Vec<[u32; 2]>" => ("list[list[int]]", ""),
        "Vec<PartReport>" => ("tuple[PartReport, ...]", ""),
        "Fallbacks" | "ContactFigures" => (of, ""),
        "VolumeReport" => ("Volume", ""),
        _ if of.starts_with("Cow<") => ("str", ""),
        _ => panic!("{name}: {of} is not known to Python"),
    };
    (of.into(), shape)
}

/// Reports as dataclasses.
fn reports_of_python() -> String {
    let mut text = String::from(
        "\"\"\"Reports. Written by test `lists` of sinew-embed; do not edit.\"\"\"\n\n\
         from __future__ import annotations\n\n\
         from dataclasses import dataclass\n\n\
         import numpy as np\nfrom numpy.typing import NDArray\n\n\
         Floats = NDArray[np.float64]\n",
    );
    let engine = "engine/src/report.rs";
    let figures = structure(&source(engine), "StepReport").1;
    for (path, own, name, json) in [
        (TOOL, "PartReport", "PartReport", false),
        (TOOL, "ToolReport", "ToolReport", false),
        ("solvers/contact/src/pair.rs", "BodyContactReport", "ContactReport", false),
        ("solvers/contact/src/pull.rs", "PullReport", "PullReport", false),
        (THREAD, "ThreadReport", "ThreadReport", false),
        (GLUE, "GlueReport", "GlueReport", false),
        (TEAR, "TearReport", "TearReport", false),
        (engine, "Fallbacks", "Fallbacks", true),
        (engine, "ContactFigures", "ContactFigures", true),
        (engine, "VolumeReport", "Volume", true),
        ("doors/embed/src/embedding.rs", "Report", "Report", true),
        ("models/src/resection/report.rs", "RemovalReport", "Removal", false),
        ("models/src/cutting/mod.rs", "CutReport", "Cut", false),
    ] {
        let (doc, fields) = structure(&source(path), own);
        let words = |doc: &str| unlinked(doc, |word| format!("`{word}`")).replace('`', "``");
        let arrays = fields.iter().any(|field| field.of.contains("DVec3"));
        let eq = if arrays { ", eq=False" } else { "" };
        let doc = wrapped(&format!("\"\"\"{}\"\"\"", words(&doc)), "    ");
        text += &format!("\n\n@dataclass(frozen=True{eq})\nclass {name}:\n{doc}");
        // figures of a step stand beside the others; the time that a removal took is not told
        let flat = fields.iter().flat_map(|field| match field.of.as_str() {
            "StepReport" => &figures[..],
            _ => slice::from_ref(field),
        });
        for field in flat.filter(|field| field.of != "Duration") {
            let (of, shape) = python(&field.name, &field.of, json);
            let mut doc = words(&field.doc);
            if !shape.is_empty() {
                doc = format!("{}; {shape}.", doc.trim_end_matches('.'));
            }
            if !json && of.ends_with("None") {
                doc += " ``None`` without.";
            }
            let doc = wrapped(&format!("\"\"\"{doc}\"\"\""), "    ");
            text += &format!("\n    {}: {of}\n{doc}", field.name);
        }
    }
    text
}

#[test]
fn c_has_all_fields_of_reports() {
    kept("doors/c/src/reports.rs", &reports_of_c());
}

#[test]
fn python_has_all_fields_of_reports() {
    kept("doors/python/package/sinew/_reports.py", &reports_of_python());
}

/// The sources of the C library; reports as they are to be, so that one run writes all files.
fn sources_of_c() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../c/src");
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    let names =
        names.iter().map(|name| name.to_str().unwrap()).filter(|name| *name != "reports.rs");
    names.map(|name| source(&format!("doors/c/src/{name}"))).collect::<String>() + &reports_of_c()
}

/// A name of C in C#: without `sinew_`, every word with a capital.
fn pascal(name: &str) -> String {
    let words = name.trim_start_matches("sinew_").trim_start_matches("SINEW_").split('_');
    words.map(|word| word[..1].to_uppercase() + &word[1..].to_lowercase()).collect()
}

fn camel(name: &str) -> String {
    let pascal = pascal(name);
    let name = pascal[..1].to_lowercase() + &pascal[1..];
    // words of the language
    if name == "out" { "result".into() } else { name }
}

/// What a structure is called: those that users see by their own names.
fn struct_of_csharp(name: &str) -> String {
    match name {
        "sinew_tool_report" | "sinew_part_report" => pascal(name),
        "sinew_pick_result" => "Pick".into(),
        "sinew_thread_point" | "sinew_cut_report" | "sinew_haptic_feedback" => pascal(name),
        _ => format!("Native{}", pascal(name)),
    }
}

fn summary(doc: &str, indent: &str) -> String {
    let doc = doc.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    wrapped(&format!("<summary>{doc}</summary>"), &format!("{indent}/// "))
}

/// Members of a structure of C# for a field.
fn members(name: &str, of: &str) -> (&'static str, String) {
    let own = pascal(name);
    match of {
        "u32" => ("uint", own),
        "u64" | "sinew_handle" => ("ulong", own),
        "usize" => ("UIntPtr", own),
        "f64" => ("double", own),
        "[f64; 3]" => ("Vec3", own),
        "[f64; 4]" => ("double", "Qx, Qy, Qz, Qw".into()),
        "[f64; 9]" => ("Vec3", format!("{own}X, {own}Y, {own}Z")),
        "[u32; 3]" => ("uint", "Vertex0, Vertex1, Vertex2".into()),
        _ if of.starts_with('*') => ("IntPtr", own),
        _ => panic!("{name}: {of} is not known to C#"),
    }
}

/// An argument of a function in C#; `next` is the name of the one after it.
fn argument(function: &str, name: &str, of: &str, next: &str) -> String {
    let own = camel(name);
    let list = next == "capacity" || next.ends_with("count") || next == "vertices";
    let Some((constant, of)) = of.strip_prefix('*').and_then(|of| of.split_once(' ')) else {
        let (of, _) = members(name, of);
        return format!("{of} {own}");
    };
    let owner = match of {
        "sinew_simulation" => "SimulationHandle",
        "sinew_mesh" => "MeshHandle",
        "sinew_snapshot" => "SnapshotHandle",
        "sinew_haptic_device" => "HapticDevice",
        "sinew_live" => "LiveReader",
        _ => "",
    };
    match (constant, of) {
        _ if function.ends_with("_free") => format!("IntPtr {own}"),
        _ if !owner.is_empty() => format!("{owner} {own}"),
        (_, "c_char" | "u8") => format!("byte[] {own}"),
        (_, "f32") => format!("IntPtr {own}"),
        ("mut", "u32") if !list => format!("out uint {own}"),
        (_, "u32") => format!("uint[] {own}"),
        (_, "usize") => format!("out UIntPtr {own}"),
        ("const", "sinew_handle") => format!("ulong[] {own}"),
        (_, "u64" | "sinew_handle") => format!("out ulong {own}"),
        ("const", "f64")
            if [
                "position",
                "velocity",
                "angular_velocity",
                "origin",
                "direction",
                "about",
                "gravity",
            ]
            .contains(&name) =>
        {
            format!("ref Vec3 {own}")
        }
        ("mut", "f64") if ["force", "torque"].contains(&name) => format!("out Vec3 {own}"),
        ("mut", "f64") if !list => format!("out double {own}"),
        (_, "f64") => format!("double[] {own}"),
        _ if of.starts_with("*mut ") => format!("out IntPtr {own}"),
        _ if list => format!("{}[] {own}", struct_of_csharp(of)),
        _ => format!("ref {} {own}", struct_of_csharp(of)),
    }
}

/// Constants of C, which are written name, type, value.
fn constants(source: &str) -> Vec<Item> {
    let found = source.match_indices("pub const SINEW_").map(|(at, _)| {
        let line = source[at..].lines().next().unwrap();
        let (name, of) = line["pub const ".len()..].split_once(": ").unwrap();
        let (_, value) = of.trim_end_matches(';').split_once(" = ").unwrap();
        Item { name: name.into(), of: value.into(), doc: doc_before(&source[..at]) }
    });
    found.collect()
}

/// Everything of the header in C#.
fn header_of_csharp() -> String {
    let source = sources_of_c();
    let mut text = String::from(
        "// Constants, structures and functions of sinew.h. Written by test `lists` of sinew-embed; do not edit.\n\
         using System;\nusing System.Runtime.InteropServices;\n\nnamespace Sinew\n{\n",
    );
    let mut left = constants(&source);
    for (doc, name, first, last) in [
        ("Kinds of errors.", "Code", "OK", "PANIC"),
        ("Kinds of things that a handle may stand for.", "Kind : uint", "BODY", "CLIP"),
        ("What can be read of a body, thread or clip.", "Quantity : uint", "POSITIONS", "GLUE"),
        ("What a tool does; several by `|`.", "ToolFlags : uint", "GRIP", "CAVITY"),
        (
            "What is not as it should be with a haptic force; several by `|`.",
            "HapticFlags : uint",
            "HAPTIC_WAITING",
            "HAPTIC_UNCONVERGED",
        ),
    ] {
        let place = |name: &str| left.iter().position(|own| own.name[6..] == *name).unwrap();
        let (first, last) = (place(first), place(last));
        text += &summary(doc, "    ");
        let flags = name.contains("Flags");
        let (attribute, none) =
            if flags { ("    [Flags]\n", "        None = 0,\n") } else { ("", "") };
        text += &format!("{attribute}    public enum {name}\n    {{\n{none}");
        for Item { name, of, doc } in left.drain(first..=last) {
            text += &format!("{}        {} = {of},\n", summary(&doc, "        "), pascal(&name));
        }
        text += "    }\n\n";
    }
    for (at, _) in source.match_indices("#[repr(C)]") {
        let name = source[at..].split("pub struct ").nth(1).unwrap().split(' ').next().unwrap();
        let (doc, fields) = structure(&source, name);
        let own = struct_of_csharp(name);
        let native = own.starts_with("Native");
        let kind = if native { "internal struct" } else { "public partial struct" };
        text += &summary(&doc, "    ");
        text += &format!("    [StructLayout(LayoutKind.Sequential)]\n    {kind} {own}\n    {{\n");
        for Item { name, of, doc } in fields {
            let hidden = native || ["struct_size", "reserved", "hit"].contains(&name.as_str());
            let (of, names) = members(&name, &of);
            let names = if name == "hit" { "HitFlag".into() } else { names };
            if !hidden {
                text += &summary(&doc, "        ");
            }
            let seen = if hidden { "internal" } else { "public" };
            text += &format!("        {seen} {of} {names};\n");
        }
        text += "    }\n\n";
    }
    text += "    internal static partial class Native\n    {\n";
    for Item { name, of, .. } in left {
        text += &format!("        internal const uint {name} = {of};\n");
    }
    for (at, _) in source.match_indices("extern \"C\" fn sinew_") {
        let (head, rest) = source[at + "extern \"C\" fn ".len()..].split_once('(').unwrap();
        let (arguments, rest) = rest.split_once(')').unwrap();
        if head == "sinew_test_panic" {
            continue;
        }
        let answer = rest.split('{').next().unwrap().trim().trim_start_matches("-> ");
        let answer = match answer {
            "" => "void",
            "sinew_status" => "int",
            "u32" => "uint",
            "*const c_char" => "IntPtr",
            _ => panic!("{head}: {answer} is not known to C#"),
        };
        let list: Vec<(&str, &str)> =
            arguments.split(',').filter_map(|one| one.trim().split_once(": ")).collect();
        let next = list.iter().skip(1).map(|own| own.0).chain([""]);
        let list: Vec<String> = list
            .iter()
            .zip(next)
            .map(|((name, of), next)| argument(head, name, of, next))
            .collect();
        // lines break between arguments only
        let list = list.join(", ").replace(' ', "~").replace(",~", ", ");
        let line = format!("internal~static~extern~{answer}~{head}({list});");
        let line =
            wrapped(&line, "        ").replace("\n        ", "\n            ").replace('~', " ");
        text += &format!("\n        [DllImport(Library, CallingConvention = C)]\n{line}");
    }
    text + "    }\n}\n"
}

#[test]
fn csharp_has_everything_of_the_header() {
    kept("doors/unity/Native.cs", &header_of_csharp());
}
