//! The one writer of pages: tables and charts in one self-contained file.

use crate::table::{Table, escape};
use std::fmt::{Display, Write};

/// A chart and what it is called.
pub struct Chart {
    /// Name of the file.
    pub name: String,
    /// SVG text.
    pub svg: String,
}

/// Rows above which a table is folded in a page.
const LONG: usize = 60;

/// A self-contained page in the style of all reports.
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    /// A page that begins with a heading and what it is about.
    pub fn new(title: impl Into<String>, heading: &str, about: &str) -> Self {
        let mut page = Self { title: title.into(), body: String::new() };
        page.add(format_args!("<h1>{}</h1>", escape(heading)));
        page.paragraph("machine", about);
        page
    }

    /// A line of HTML as it stands.
    pub fn add(&mut self, html: impl Display) {
        let _ = writeln!(self.body, "{html}");
    }

    /// A paragraph of plain text in a style, which may be empty.
    pub fn paragraph(&mut self, class: &str, text: &str) {
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        self.add(format_args!("<p{class}>{}</p>", escape(text)));
    }

    /// A chart.
    pub fn chart(&mut self, chart: &Chart) {
        // the page decides on the size
        let svg = chart.svg.find("<svg").map_or(&*chart.svg, |at| &chart.svg[at..]);
        self.add(format_args!("<figure id=\"chart-{}\">{svg}</figure>", chart.name));
    }

    /// A table; a long one is folded.
    pub fn table(&mut self, table: &Table) {
        if table.rows.len() <= LONG {
            self.body += &table.html();
            return;
        }
        let (title, rows) = (escape(&table.title), table.rows.len());
        self.add(format_args!(
            "<details><summary>{title} ({rows} rows)</summary>\n{}</details>",
            table.html()
        ));
    }

    /// All of it.
    pub fn html(self) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width\">\n<title>{}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{}</main>\n</body>\n</html>\n",
            escape(&self.title),
            self.body
        )
    }
}

const STYLE: &str = "\
body { margin: 0; background: #fff; color: #222; font: 15px/1.45 system-ui, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 24px; }
h1 { font-size: 26px; margin: 0 0 4px; }
h2 { font-size: 21px; margin: 36px 0 8px; }
h3 { font-size: 17px; margin: 28px 0 6px; }
p { margin: 6px 0; max-width: 90ch; }
.machine, .note { color: #444; font-size: 13px; }
.warning { background: #fff3d6; border-left: 4px solid #d98e00; padding: 6px 10px; }
code { background: #f2f2f2; padding: 1px 4px; border-radius: 3px; }
nav { margin: 12px 0; font-size: 14px; }
nav a { margin-right: 12px; color: #0059a8; }
figure { margin: 18px 0; }
figure svg { max-width: 100%; height: auto; border: 1px solid #e2e2e2; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 9px; border-bottom: 1px solid #e4e4e4; text-align: right; white-space: nowrap; }
th { background: #f4f4f4; position: sticky; top: 0; }
.words { text-align: left; }
tr.marked td { background: #e8f4e8; font-weight: 600; }
summary { cursor: pointer; font-weight: 600; margin: 18px 0 4px; }
";
