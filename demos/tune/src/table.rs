//! Tables: one form for the terminal, CSV, Markdown and HTML.

use serde::Serialize;
use sinew_scene::output::no_formula;
use std::fmt::Write;

/// One value of a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Cell {
    /// Words.
    Text(String),
    /// A number; CSV has all its digits, people see three.
    Number(f64),
    /// A count, shown in full.
    Count(u64),
    /// Not measured.
    Missing,
}

macro_rules! cells {
    ($($from:ty: |$x:ident| $cell:expr;)+) => {
        $(impl From<$from> for Cell {
            fn from($x: $from) -> Self {
                $cell
            }
        })+
    };
}

cells! {
    &str: |text| Self::Text(text.to_string());
    &String: |text| Self::Text(text.clone());
    String: |text| Self::Text(text);
    f64: |x| Self::Number(x);
    usize: |n| Self::Count(n as u64);
    u64: |n| Self::Count(n);
    u32: |n| Self::Count(n.into());
    bool: |yes| Self::Text(if yes { "yes" } else { "" }.to_string());
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

impl Cell {
    /// For people.
    pub fn shown(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(x) => three_digits(*x),
            Self::Count(n) => n.to_string(),
            Self::Missing => "-".to_string(),
        }
    }

    /// For programs: all digits of a number.
    pub fn exact(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(x) => {
                let digits = format!("{x:?}");
                digits.strip_suffix(".0").map_or(digits.clone(), String::from)
            }
            Self::Count(n) => n.to_string(),
            Self::Missing => String::new(),
        }
    }

    /// Its value, if it is a number.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(x) => Some(*x),
            Self::Count(n) => Some(*n as f64),
            Self::Text(_) | Self::Missing => None,
        }
    }

    fn is_text(&self) -> bool {
        matches!(self, Self::Text(_))
    }
}

/// About three significant digits.
pub fn three_digits(x: f64) -> String {
    let size = x.abs();
    if x == 0.0 {
        "0".to_string()
    } else if !(1e-3..1e6).contains(&size) {
        format!("{x:.1e}")
    } else if size >= 100.0 {
        format!("{x:.0}")
    } else if size >= 10.0 {
        format!("{x:.1}")
    } else if size >= 1.0 {
        format!("{x:.2}")
    } else {
        let digits = 2 - size.log10().floor() as i32;
        format!("{x:.*}", digits.max(0) as usize)
    }
}

/// A [`Table`] with one row for each item of an iterator. The heading of a column stands before its cell; what every
/// row needs first may stand after `where`.
///
/// ```
/// use sinew_tune::table_of;
///
/// let table = table_of!("squares", "Squares"; for n in [2_usize, 3];
///     where { let square = n * n; }
///     "n" => n, "square" => square, "root" => (n as f64).sqrt(),
/// );
/// assert_eq!((table.columns[1].as_str(), table.rows.len()), ("square", 2));
/// ```
#[macro_export]
macro_rules! table_of {
    ($name:expr, $title:expr; for $row:pat in $rows:expr;
     $(where { $($first:tt)* })? $($heading:expr => $cell:expr),+ $(,)?) => {{
        let mut table = $crate::table::Table::new($name, $title, &[$($heading),+]);
        for $row in $rows {
            $($($first)*)?
            table.row(vec![$($crate::table::Cell::from($cell)),+]);
        }
        table
    }};
}

/// A table with a heading.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Table {
    /// Name of the CSV file and of the anchor in HTML.
    pub name: &'static str,
    /// Heading.
    pub title: String,
    /// What the reader must know: definitions, conditions.
    pub notes: Vec<String>,
    /// Headings of the columns, with unit.
    pub columns: Vec<String>,
    /// One entry per column in each.
    pub rows: Vec<Vec<Cell>>,
    /// Rows to point out.
    pub marked: Vec<usize>,
}

impl Table {
    /// An empty table.
    pub fn new(name: &'static str, title: impl Into<String>, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|c| (*c).to_string()).collect();
        Self { name, title: title.into(), columns, ..Self::default() }
    }

    /// Adds a remark.
    #[must_use]
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// Adds a row.
    ///
    /// # Panics
    /// When it has another number of cells than the table has columns.
    pub fn row(&mut self, cells: Vec<Cell>) {
        assert_eq!(cells.len(), self.columns.len(), "row of table `{}`", self.name);
        self.rows.push(cells);
    }

    /// Whether a column holds words, which go to the left.
    pub fn is_words(&self, column: usize) -> bool {
        self.rows.iter().any(|row| row[column].is_text())
    }

    /// Aligned, for the terminal.
    pub fn text(&self) -> String {
        let shown: Vec<Vec<String>> =
            self.rows.iter().map(|row| row.iter().map(Cell::shown).collect()).collect();
        let width = |c: usize| {
            let cells = shown.iter().map(|row| row[c].chars().count());
            cells.max().unwrap_or(0).max(self.columns[c].chars().count())
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let line = |cells: &[String], mark: &str| {
            let mut text = String::from(mark);
            for (c, cell) in cells.iter().enumerate() {
                let pad = " ".repeat(widths[c].saturating_sub(cell.chars().count()));
                let (before, after) = if self.is_words(c) { ("", &*pad) } else { (&*pad, "") };
                let _ = write!(text, "  {before}{cell}{after}");
            }
            text.trim_end().to_string() + "\n"
        };
        let mut text = format!("{}\n", self.title);
        text += &line(&self.columns, " ");
        for (i, row) in shown.iter().enumerate() {
            text += &line(row, if self.marked.contains(&i) { "*" } else { " " });
        }
        for note in &self.notes {
            let _ = writeln!(text, "  {note}");
        }
        text
    }

    /// Comma-separated, all digits.
    ///
    /// # Errors
    /// When memory cannot be written, which does not happen.
    pub fn csv(&self) -> Result<Vec<u8>, csv::Error> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(self.columns.iter().map(|c| no_formula(c)))?;
        for row in &self.rows {
            writer.write_record(row.iter().map(Cell::exact))?;
        }
        writer.into_inner().map_err(|error| error.into_error().into())
    }

    /// A Markdown table without its heading.
    pub fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let mut text = line(self.columns.clone());
        let rule = |c| if self.is_words(c) { "---" } else { "---:" }.to_string();
        text += &line((0..self.columns.len()).map(rule).collect());
        for row in &self.rows {
            text += &line(row.iter().map(|c| c.shown().replace('|', "\\|")).collect());
        }
        text
    }

    /// An HTML section.
    pub fn html(&self) -> String {
        let mut text = format!("<h3 id=\"{}\">{}</h3>\n", self.name, escape(&self.title));
        for note in &self.notes {
            let _ = writeln!(text, "<p class=\"note\">{}</p>", escape(note));
        }
        text += "<div class=\"scroll\"><table>\n<thead><tr>";
        for (c, column) in self.columns.iter().enumerate() {
            let class = if self.is_words(c) { " class=\"words\"" } else { "" };
            let _ = write!(text, "<th{class}>{}</th>", escape(column));
        }
        text += "</tr></thead>\n<tbody>\n";
        for (i, row) in self.rows.iter().enumerate() {
            text += if self.marked.contains(&i) { "<tr class=\"marked\">" } else { "<tr>" };
            for (c, cell) in row.iter().enumerate() {
                let class = if self.is_words(c) { " class=\"words\"" } else { "" };
                let _ = write!(text, "<td{class}>{}</td>", escape(&cell.shown()));
            }
            text += "</tr>\n";
        }
        text + "</tbody></table></div>\n"
    }
}

/// Text safe inside HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
