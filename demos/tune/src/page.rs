//! The one writer of pages: tables and charts in one self-contained file.

use crate::table::{Cell, Table, escape};
use std::fmt::{Display, Write};

/// A chart and what it is called.
pub struct Chart {
    /// Name of the file.
    pub name: String,
    /// SVG text.
    pub svg: String,
}

/// An aim and whether it was met.
pub struct Verdict {
    /// Whether it was met.
    pub met: bool,
    /// What was measured, in a few words.
    pub measured: String,
    /// What was aimed at.
    pub what: String,
}

/// Rows above which a table is folded in a page.
const LONG: usize = 60;
/// Verdicts above which the rest is folded.
const MANY: usize = 14;

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

    /// Charts of one look, side by side as far as there is room.
    pub fn charts<'a>(&mut self, charts: impl IntoIterator<Item = &'a Chart>) {
        self.add("<div class=\"charts\">");
        charts.into_iter().for_each(|chart| self.chart(chart));
        self.add("</div>");
    }

    /// Verdicts, what was missed first; of many the last are folded.
    pub fn verdicts(&mut self, verdicts: &[Verdict]) {
        if verdicts.is_empty() {
            return;
        }
        let met = verdicts.iter().filter(|v| v.met).count();
        self.add(format_args!("<h2>Verdicts: {met} of {} met</h2>", verdicts.len()));
        let item = |v: &&Verdict| {
            let (class, word) = if v.met { ("met", "met") } else { ("missed", "not met") };
            let (measured, what) = (escape(&v.measured), escape(&v.what));
            format!(
                "<li class=\"{class}\"><b>{word}</b><span><strong>{measured}</strong> {what}</span></li>\n"
            )
        };
        let missed = verdicts.iter().filter(|v| !v.met);
        let all: Vec<&Verdict> = missed.chain(verdicts.iter().filter(|v| v.met)).collect();
        let (shown, folded) = all.split_at(all.len().min(MANY));
        let list = |part: &[&Verdict]| part.iter().map(item).collect::<String>();
        self.add(format_args!("<ul class=\"verdicts\">\n{}</ul>", list(shown)));
        if !folded.is_empty() {
            self.add(format_args!(
                "<details><summary>{} more</summary>\n<ul class=\"verdicts\">\n{}</ul></details>",
                folded.len(),
                list(folded)
            ));
        }
    }

    /// A table in groups of rows that have the same value in a column, which becomes their heading. Columns in `below` are
    /// words: they stand under the figures of their row.
    pub fn grouped(
        &mut self,
        table: &Table,
        group: Option<&str>,
        below: &[&str],
        heading: impl Fn(&str) -> String,
    ) {
        let at = |name: &str| table.columns.iter().position(|c| c == name);
        let group = group.and_then(at);
        let below: Vec<usize> = below.iter().filter_map(|name| at(name)).collect();
        let figures: Vec<usize> =
            (0..table.columns.len()).filter(|c| Some(*c) != group && !below.contains(c)).collect();
        let is_text = |c: usize| table.rows.iter().any(|row| matches!(row[c], Cell::Text(_)));
        let class = |c: usize| if is_text(c) { " class=\"words\"" } else { "" };
        self.add(format_args!("<h3 id=\"{}\">{}</h3>", table.name, escape(&table.title)));
        table.notes.iter().for_each(|note| self.paragraph("note", note));
        let key = |row: &Vec<Cell>| group.map(|c| row[c].shown());
        for rows in table.rows.chunk_by(|a, b| key(a) == key(b)) {
            if let Some(key) = rows.first().and_then(key) {
                self.add(format_args!("<h4>{}</h4>", escape(&heading(&key))));
            }
            self.add("<div class=\"scroll\"><table class=\"grouped\">\n<thead><tr>");
            for &c in &figures {
                self.add(format_args!("<th{}>{}</th>", class(c), escape(&table.columns[c])));
            }
            self.add("</tr></thead>\n<tbody>");
            for row in rows {
                let cell = |&c: &usize| format!("<td{}>{}</td>", class(c), escape(&row[c].shown()));
                self.add(format_args!("<tr>{}</tr>", figures.iter().map(cell).collect::<String>()));
                let words: Vec<String> = below
                    .iter()
                    .filter(|&&c| row[c] != Cell::Missing)
                    .map(|&c| row[c].shown())
                    .filter(|text| !text.is_empty())
                    .collect();
                if !words.is_empty() {
                    let (span, words) = (figures.len(), escape(&words.join("; ")));
                    self.add(format_args!(
                        "<tr class=\"below\"><td colspan=\"{span}\"><div>{words}</div></td></tr>"
                    ));
                }
            }
            self.add("</tbody></table></div>");
        }
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
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{}</main>\n</body>\n</html>\n",
            escape(&self.title),
            self.body
        )
    }
}

const STYLE: &str = "\
body { margin: 0; background: #fff; color: #222; font: 15px/1.45 system-ui, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 20px 24px; overflow-wrap: break-word; }
h1 { font-size: 26px; margin: 0 0 4px; }
h2 { font-size: 21px; margin: 28px 0 8px; }
.machine + h2, .warning + h2 { margin-top: 12px; }
h3 { font-size: 17px; margin: 28px 0 6px; }
h4 { font-size: 14px; margin: 18px 0 4px; }
p { margin: 6px 0; max-width: 90ch; }
.machine, .note { color: #444; font-size: 13px; }
.machine { max-width: none; }
.warning { background: #fff3d6; border-left: 4px solid #d98e00; padding: 4px 10px; font-size: 13px; max-width: none; }
code { background: #f2f2f2; padding: 1px 4px; border-radius: 3px; overflow-wrap: anywhere; }
nav { margin: 12px 0; font-size: 14px; }
nav a { margin-right: 12px; color: #0059a8; }
figure { margin: 18px 0; overflow-x: auto; }
figure svg { max-width: 100%; height: auto; border: 1px solid #e2e2e2; }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 370px), 1fr)); gap: 8px; margin: 12px 0; }
.charts:has(> :nth-child(4):last-child) { grid-template-columns: repeat(auto-fit, minmax(min(100%, 480px), 1fr)); }
.charts figure { margin: 0; max-width: 640px; }
.charts figure svg { width: 100%; box-sizing: border-box; }
.verdicts { list-style: none; margin: 6px 0; padding: 0; columns: 2 480px; column-gap: 24px; font-size: 13px; line-height: 1.35; }
.verdicts li { display: flex; gap: 8px; padding: 3px 0; break-inside: avoid; }
.verdicts b { flex: 0 0 62px; align-self: flex-start; text-align: center; border-radius: 3px; font-size: 12px; padding: 1px 0; }
.verdicts .met b { background: #dcefdc; color: #145214; }
.verdicts .missed b { background: #fbdcd3; color: #8a1c00; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 9px; border-bottom: 1px solid #e4e4e4; text-align: right; white-space: nowrap; }
th { background: #f4f4f4; position: sticky; top: 0; }
.words { text-align: left; }
td.words:last-child { white-space: normal; min-width: 28ch; }
.grouped td { border-bottom: none; border-top: 1px solid #e4e4e4; padding: 3px 12px 0; }
.grouped th { padding: 3px 12px; }
.grouped td:first-child { font-weight: 600; }
.grouped td.words:last-child { white-space: nowrap; min-width: 0; }
.grouped .below td { border-top: none; padding: 0 12px 4px; text-align: left; white-space: normal; font-weight: 400; }
.below div { color: #555; font-size: 12px; position: sticky; left: 12px; max-width: min(100ch, calc(100vw - 56px)); }
tr.marked td { background: #e8f4e8; font-weight: 600; }
summary { cursor: pointer; font-weight: 600; margin: 18px 0 4px; }
@media (max-width: 620px) {
  main { padding: 14px 16px; }
  h1 { font-size: 21px; }
  h2 { font-size: 18px; margin-top: 20px; }
  figure:not(.charts figure) svg { max-width: none; width: 600px; }
  .grouped td, .grouped th, .grouped .below td { padding-left: 6px; padding-right: 6px; }
}
";
