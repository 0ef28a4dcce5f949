//! Documents: what they link to, and the files that they name, exist.

use std::fs::{read_dir, read_to_string};
use std::path::{Path, PathBuf};

/// All Markdown files below a folder; what was built or fetched is no document of ours.
fn documents(folder: &Path, found: &mut Vec<PathBuf>) {
    for path in read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let name = path.file_name().unwrap().to_string_lossy();
        if path.is_dir() {
            if name != "target" && !name.starts_with('.') {
                documents(&path, found);
            }
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
}

/// What stands between `start` and `end`, for every `start` of a text.
fn between<'a>(text: &'a str, start: &'a str, end: char) -> impl Iterator<Item = &'a str> {
    text.split(start).skip(1).filter_map(move |rest| rest.split_once(end).map(|(inner, _)| inner))
}

/// Whether a page has a heading that is reached by `anchor`, as GitHub names headings.
fn has_heading(page: &Path, anchor: &str) -> bool {
    let kept = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | ' ');
    let slug = |heading: &str| {
        let heading = heading.trim_start_matches('#').trim().to_lowercase();
        heading.chars().filter(|&c| kept(c)).collect::<String>().replace(' ', "-")
    };
    let text = read_to_string(page).unwrap();
    text.lines().filter(|line| line.starts_with('#')).any(|line| slug(line) == anchor)
}

#[test]
fn links_lead_somewhere_and_named_files_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut found, mut links, mut wrong) = (Vec::new(), 0, Vec::new());
    documents(root, &mut found);
    for document in &found {
        let text = read_to_string(document).unwrap();
        let folder = document.parent().unwrap();
        let targets = between(&text, "](", ')').chain(between(&text, "src=\"", '"'));
        for link in targets.filter(|link| !link.contains("://")) {
            links += 1;
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let page = if path.is_empty() { document.clone() } else { folder.join(path) };
            if !page.exists() || !(anchor.is_empty() || has_heading(&page, anchor)) {
                wrong.push(format!("{}: link {link}", document.display()));
            }
        }
    }
    // these name files by their way from the root
    for document in ["ARCHITECTURE.md", "CONTRIBUTING.md"] {
        let text = read_to_string(root.join(document)).unwrap();
        for path in text.split('`').skip(1).step_by(2).filter(|path| !path.contains(['<', ' '])) {
            let top = path.split_once('/').map(|(top, _)| root.join(top));
            if top.is_some_and(|top| top.is_dir()) && !root.join(path).exists() {
                wrong.push(format!("{document}: file {path}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    // the walk found the documents, and the links in them
    assert!(found.len() > 15 && links > 100, "{} documents, {links} links", found.len());
}
