//! Numbers, counts and blocks of lines in reports for a terminal.

use std::borrow::Cow;
use std::fmt;

/// Counts in words, those of 0 left out: "3 tetrahedra and 2 triangles".
pub fn counted(counts: &[(&str, usize)]) -> String {
    let words: Vec<String> = counts
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{count} {name}"))
        .collect();
    match &words[..] {
        [] => format!("0 {}", counts.first().map_or("elements", |(name, _)| name)),
        words => words.join(" and "),
    }
}

/// A number with about four digits, plain where that is short.
pub fn short(x: f64) -> String {
    let size = x.abs();
    if x == 0.0 {
        "0".into()
    } else if !(1e-3..1e5).contains(&size) {
        format!("{x:.2e}")
    } else {
        let digits = (3 - size.log10().floor() as i32).clamp(0, 6) as usize;
        let text = format!("{x:.digits$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').into()
        } else {
            text
        }
    }
}

/// Words in lines of at most `width` characters, each with a beginning of its own.
pub fn wrapped(words: &str, width: usize, begin: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    for word in words.split_whitespace() {
        match lines.last_mut().filter(|line| line.len() + 1 + word.len() <= width) {
            Some(line) => *line += &format!(" {word}"),
            None => lines.push(format!("{begin}{word}")),
        }
    }
    lines.into_iter().map(|line| line + "\n").collect()
}

/// A pressure in the unit that suits it.
pub fn pressure(x: f64) -> String {
    match x {
        x if x >= 1e6 => format!("{} MPa", short(x / 1e6)),
        x if x >= 1e3 => format!("{} kPa", short(x / 1e3)),
        x => format!("{} Pa", short(x)),
    }
}

/// A time in the unit that suits it.
pub fn seconds(x: f64) -> String {
    match x {
        x if x >= 120.0 => format!("{:.0} min {:02.0} s", (x / 60.0).floor(), x % 60.0),
        x if x >= 1.0 => format!("{x:.2} s"),
        x if x >= 1e-3 => format!("{:.1} ms", x * 1e3),
        x => format!("{:.0} us", x * 1e6),
    }
}

/// Lines with labels under a title.
pub(crate) struct TextBlock {
    title: Cow<'static, str>,
    lines: Vec<(String, String)>,
}

impl TextBlock {
    /// Without lines, when nothing is printed.
    pub fn new(title: impl Into<Cow<'static, str>>) -> Self {
        Self { title: title.into(), lines: Vec::new() }
    }

    /// Adds a line; an empty label continues the line before.
    pub fn line(&mut self, label: impl Into<String>, text: impl Into<String>) {
        self.lines.push((label.into(), text.into()));
    }
}

/// Adds a line to a block: its label, and a text as of `format!`.
macro_rules! line {
    ($block:expr, $label:expr, $($text:tt)+) => {
        $block.line($label, format!($($text)+))
    };
}
pub(crate) use line;

/// Writes blocks, their labels in one column.
pub(crate) fn write_blocks(f: &mut fmt::Formatter<'_>, blocks: &[TextBlock]) -> fmt::Result {
    let labels = blocks.iter().flat_map(|block| &block.lines).map(|(label, _)| label);
    let width = labels.map(|label| label.chars().count()).max().unwrap_or(0).min(35);
    for block in blocks.iter().filter(|block| !block.lines.is_empty()) {
        writeln!(f, "\n{}", block.title)?;
        for (label, text) in &block.lines {
            writeln!(f, "  {label:<width$} {text}")?;
        }
    }
    Ok(())
}
