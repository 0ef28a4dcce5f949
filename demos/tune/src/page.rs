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

/// How an aim was judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judgement {
    /// It holds.
    Yes,
    /// It does not.
    No,
    /// This run cannot tell, as when times were taken on a busy machine.
    Open,
}

/// An aim and how it was judged.
pub struct Verdict {
    /// How.
    pub judgement: Judgement,
    /// What was measured, in a few words.
    pub measured: String,
    /// What was aimed at.
    pub what: String,
}

/// How many aims are met of those that were judged, and how many were not judged.
pub fn aims_met(judgements: impl Iterator<Item = Judgement> + Clone) -> String {
    let of = |wanted| judgements.clone().filter(|j| *j == wanted).count();
    let [yes, no, open] = [Judgement::Yes, Judgement::No, Judgement::Open].map(of);
    match (yes + no, open) {
        (judged, 0) => format!("{yes} of {judged} met"),
        (0, _) => format!("{open} not judged"),
        (judged, _) => format!("{yes} of {judged} met, {open} not judged"),
    }
}

/// A statement with a word about it in front.
pub struct Badge<'a> {
    /// Style of the word: `met`, `missed`, `wrong`, `choice` or `open`.
    pub class: &'static str,
    /// The word.
    pub word: &'static str,
    /// What was measured, in bold; may be empty.
    pub measured: &'a str,
    /// The statement.
    pub what: &'a str,
}

/// Rows above which a table is folded in a page.
const LONG: usize = 60;
/// Verdicts above which the rest is folded.
const MANY: usize = 14;

/// A self-contained page in the style of all reports.
pub struct Page {
    title: String,
    /// Heading and what the page is about.
    head: String,
    /// Links to the sections.
    contents: String,
    body: String,
}

impl Page {
    /// A page that begins with a heading and what it is about.
    pub fn new(title: impl Into<String>, heading: &str, about: &str) -> Self {
        let (heading, about) = (escape(heading), escape(about));
        let head = format!("<h1>{heading}</h1>\n<p class=\"machine\">{about}</p>\n");
        Self { title: title.into(), head, contents: String::new(), body: String::new() }
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

    /// The one thing to know, above the contents.
    pub fn headline(&mut self, text: &str) {
        let _ = writeln!(self.head, "<p class=\"count\">{}</p>", escape(text));
    }

    /// A heading, listed in the contents at the top of the page.
    pub fn section(&mut self, id: &str, title: &str) {
        self.entry(id, title);
        self.add(format_args!("<h2 id=\"{id}\">{}</h2>", escape(title)));
    }

    /// One more entry of the contents, for what has a heading of its own.
    pub fn entry(&mut self, id: &str, title: &str) {
        let _ = write!(self.contents, "<a href=\"#{id}\">{}</a> ", escape(title));
    }

    /// What the reader must know of the conditions, in one box; several are folded under a summary.
    pub fn warnings(&mut self, summary: &str, warnings: &[String]) {
        match warnings {
            [] => {}
            [one] => self.paragraph("warning", one),
            all => {
                let summary = escape(summary);
                self.add(format_args!("<details class=\"warning\"><summary>{summary}</summary>"));
                all.iter().for_each(|warning| self.paragraph("", warning));
                self.add("</details>");
            }
        }
    }

    /// Verdicts on aims with a heading that counts them, what does not hold first; of many the last are folded.
    pub fn verdicts(&mut self, verdicts: &[Verdict]) {
        if verdicts.is_empty() {
            return;
        }
        let counted = aims_met(verdicts.iter().map(|v| v.judgement));
        self.section("verdicts", &format!("Verdicts: {counted}"));
        let of = |wanted| verdicts.iter().filter(move |v| v.judgement == wanted);
        let all: Vec<Badge> = [Judgement::No, Judgement::Open, Judgement::Yes]
            .into_iter()
            .flat_map(of)
            .map(|v| {
                let (class, word) = match v.judgement {
                    Judgement::Yes => ("met", "met"),
                    Judgement::No => ("missed", "not met"),
                    Judgement::Open => ("open", "not judged"),
                };
                Badge { class, word, measured: &v.measured, what: &v.what }
            })
            .collect();
        let (shown, folded) = all.split_at(all.len().min(MANY));
        self.badges(shown);
        if !folded.is_empty() {
            self.add(format_args!("<details><summary>{} more</summary>", folded.len()));
            self.badges(folded);
            self.add("</details>");
        }
    }

    /// Statements in their order, one row each.
    pub fn badges(&mut self, badges: &[Badge]) {
        self.add("<ul class=\"verdicts\">");
        for Badge { class, word, measured, what } in badges {
            let (measured, what) = (escape(measured), escape(what));
            self.add(format_args!(
                "<li class=\"{class}\"><b>{word}</b><span><strong>{measured}</strong> {what}</span></li>"
            ));
        }
        self.add("</ul>");
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
        let contents = match self.contents.as_str() {
            "" => String::new(),
            links => format!("<nav>{links}</nav>\n"),
        };
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{}{contents}{}</main>\n</body>\n</html>\n",
            escape(&self.title),
            self.head,
            self.body
        )
    }
}

const STYLE: &str = "\
body { margin: 0; background: #fff; color: #222; font: 15px/1.45 system-ui, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 20px 24px; overflow-wrap: break-word; }
h1 { font-size: 26px; margin: 0 0 4px; }
h2 { font-size: 21px; margin: 28px 0 8px; }
.machine + h2, .warning + h2, nav + h2 { margin-top: 12px; }
h3 { font-size: 17px; margin: 28px 0 6px; }
h4 { font-size: 14px; margin: 18px 0 4px; }
p { margin: 6px 0; max-width: 90ch; }
.machine, .note { color: #444; font-size: 13px; }
.machine { max-width: none; }
details.warning summary { margin: 0; }
.warning { background: #fff3d6; border-left: 4px solid #d98e00; padding: 4px 10px; font-size: 13px; max-width: none; }
code { background: #f2f2f2; padding: 1px 4px; border-radius: 3px; overflow-wrap: anywhere; }
nav { margin: 12px 0; font-size: 14px; }
nav { columns: 3 300px; column-gap: 24px; line-height: 1.5; }
nav a { display: block; color: #0059a8; break-inside: avoid; }
.count { font-size: 17px; font-weight: 600; }
figure img { max-width: 100%; }
figure { margin: 18px 0; overflow-x: auto; }
figure svg { max-width: 100%; height: auto; border: 1px solid #e2e2e2; }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 370px), 1fr)); gap: 8px; margin: 12px 0; }
.charts:has(> :nth-child(4):last-child) { grid-template-columns: repeat(auto-fit, minmax(min(100%, 480px), 1fr)); }
.charts figure { margin: 0; max-width: 640px; }
.charts figure svg, .plots figure svg { width: 100%; box-sizing: border-box; }
.verdicts { list-style: none; margin: 6px 0; padding: 0; columns: 2 480px; column-gap: 24px; font-size: 13px; line-height: 1.35; }
.verdicts li { display: flex; gap: 8px; padding: 3px 0; break-inside: avoid; }
.verdicts b { flex: 0 0 68px; align-self: flex-start; text-align: center; border-radius: 3px; font-size: 12px; padding: 1px 0; }
.verdicts .met b { background: #dcefdc; color: #145214; }
.verdicts .missed b { background: #fbdcd3; color: #8a1c00; }
.verdicts .wrong b { background: #e3dcf5; color: #3d1d8a; }
.verdicts .choice b { background: #fdefc8; color: #6b4c00; }
.verdicts .open b { background: #e6e8eb; color: #444; }
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
  figure:not(.charts figure, .plots figure) svg { max-width: none; width: 600px; }
  figure img { max-width: none; width: 860px; }
  .grouped td, .grouped th, .grouped .below td { padding-left: 6px; padding-right: 6px; }
}
";
