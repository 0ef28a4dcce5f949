//! Axes of charts as SVG text, and curves over time.

use crate::page::Chart;
use crate::table::{escape, three_digits};
use sinew_render::scene::Series;
use std::fmt::Write;

/// Colours of curves.
const INKS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#b58900"];
/// Strokes of what has the same colour.
const DASHES: [&str; 4] = ["", "6 3", "2 3", "8 3 2 3"];
/// Points of a curve.
const POINTS: usize = 2000;
/// Width and height of a chart of curves.
pub(crate) const CURVES: [f64; 2] = [720.0, 250.0];
/// Left, right, top, bottom.
const MARGIN: [f64; 4] = [62.0, 12.0, 30.0, 40.0];

/// The axes of a chart.
pub(crate) struct Axes {
    /// Width and height.
    pub size: [f64; 2],
    /// Ends of what is shown.
    pub x: (f64, f64),
    /// Likewise.
    pub y: (f64, f64),
    /// Whether `x` is logarithmic.
    pub log: bool,
}

/// The place of a value between two ends.
fn share(v: f64, (low, high): (f64, f64)) -> f64 {
    if high > low { (v - low) / (high - low) } else { 0.5 }
}

impl Axes {
    fn right(&self) -> f64 {
        self.size[0] - MARGIN[1]
    }

    fn bottom(&self) -> f64 {
        self.size[1] - MARGIN[3]
    }

    /// Where a value of `x` is.
    pub fn across(&self, v: f64) -> f64 {
        let scaled = |x: f64| if self.log { x.ln() } else { x };
        let part = share(scaled(v), (scaled(self.x.0), scaled(self.x.1)));
        MARGIN[0] + 6.0 + (self.right() - MARGIN[0] - 12.0) * part
    }

    /// Where a value of `y` is.
    pub fn up(&self, v: f64) -> f64 {
        self.bottom() - 6.0 - (self.bottom() - MARGIN[2] - 12.0) * share(v, self.y)
    }

    /// The beginning of a chart of `result` over `parameter`: names, lines and ticks.
    pub fn begin(&self, result: &str, parameter: &str) -> String {
        let ([width, height], left, top) = (self.size, MARGIN[0], MARGIN[2]);
        let (right, bottom) = (self.right(), self.bottom());
        let mut svg = format!(
            "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" \
             font-family=\"system-ui, sans-serif\" font-size=\"11\" fill=\"#333\">\n\
             <title>{} over {}</title>\n\
             <path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"#999\"/>\n",
            escape(result),
            escape(parameter),
        );
        // a width that holds the text
        let fitted = |text: &str, most: f64| {
            let size = (most / (0.56 * text.chars().count().max(1) as f64)).clamp(6.0, 12.0);
            format!("font-size=\"{size:.1}\">{}", escape(text))
        };
        let name = fitted(result, width - 20.0);
        let _ = writeln!(svg, "<text x=\"6\" y=\"16\" font-weight=\"600\" {name}</text>");
        let log = if self.log { " (log)" } else { "" };
        let name = fitted(&format!("{parameter}{log}"), width - 20.0);
        let y = height - 6.0;
        let _ = writeln!(svg, "<text x=\"{right}\" y=\"{y}\" text-anchor=\"end\" {name}</text>");
        for v in ticks(self.y, false) {
            let at = self.up(v);
            let _ = writeln!(
                svg,
                "<path d=\"M{left} {at:.1}h-4\" stroke=\"#999\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                left - 7.0,
                at + 4.0,
                three_digits(v)
            );
        }
        for v in ticks(self.x, self.log) {
            let at = self.across(v);
            let _ = writeln!(
                svg,
                "<path d=\"M{at:.1} {bottom}v4\" stroke=\"#999\"/><text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                bottom + 16.0,
                three_digits(v)
            );
        }
        svg
    }
}

/// Round numbers from `low` to `high` at which an axis has its ticks: at most seven, on a logarithmic axis over two decades and
/// more the powers of ten alone.
pub fn ticks((low, high): (f64, f64), log: bool) -> Vec<f64> {
    // NaN and single values have no scale
    let wide = high > low;
    if !wide {
        return vec![low];
    }
    let power = |x: f64| 10f64.powi(x as i32);
    let within = |x: &f64| (low..=high).contains(x);
    let mut found: Vec<f64> = Vec::new();
    if log {
        let (first, last) = (low.log10().floor(), high.log10().ceil());
        let decades = last - first;
        let parts: &[f64] = if decades <= 2.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let every = (decades / 6.0).ceil().max(1.0) as usize;
        let exponents = (first as i32..=last as i32).step_by(every);
        let all = exponents.flat_map(|e| parts.iter().map(move |p| p * 10f64.powi(e)));
        found.extend(all.filter(within));
    }
    if found.len() < 2 {
        let rough = (high - low) / 5.0;
        let unit = power(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .iter()
            .map(|p| p * unit)
            .find(|&step| step >= rough)
            .unwrap_or(rough);
        let first = (low / step).ceil();
        found = (0..8).map(|i| (first + f64::from(i)) * step).filter(within).collect();
    }
    found
}

/// Curves of one quantity: of every run its lines, in the same order.
pub struct Curves {
    /// What they are, with the unit.
    pub name: String,
    /// The runs.
    pub runs: Vec<(String, Vec<Series>)>,
}

impl Curves {
    /// As a chart over `time`; nothing where no number is finite.
    pub fn chart(&self, time: &str) -> Option<Chart> {
        let lines = || self.runs.iter().flat_map(|(_, lines)| lines);
        let ends = |of: usize| {
            let values = lines().flat_map(|line| &line.points).map(move |p| p[of]);
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
        };
        let (x, y) = (ends(0), ends(1));
        if x.0 > x.1 {
            return None;
        }
        // a curve without its zero shows nothing of its size
        let axes = Axes { size: CURVES, x, y: (y.0.min(0.0), y.1.max(0.0)), log: false };
        let mut svg = axes.begin(&self.name, time);
        let several = self.runs.len() > 1;
        let style = |ink: &str, dash: usize| {
            let dash = DASHES[dash % DASHES.len()];
            format!(
                "fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.6\" stroke-dasharray=\"{dash}\""
            )
        };
        let mut keys: Vec<(&str, String)> = Vec::new();
        for (r, (run, lines)) in self.runs.iter().enumerate() {
            if several {
                keys.push((run, style(INKS[r % INKS.len()], 0)));
            }
            for (l, line) in lines.iter().enumerate() {
                let (ink, dash) = if several { (r, l) } else { (l, 0) };
                let stroke = style(INKS[ink % INKS.len()], dash);
                let _ = write!(svg, "<polyline {stroke} points=\"");
                for [t, v] in line.thinned(POINTS) {
                    let _ = write!(svg, "{:.1},{:.1} ", axes.across(t), axes.up(v));
                }
                let name = format!("{run} {}", line.name);
                let _ = writeln!(svg, "\"><title>{}</title></polyline>", escape(name.trim()));
                // several runs have colours, their lines strokes
                if !several {
                    keys.push((&line.name, stroke));
                }
            }
        }
        let parts = self.runs[0].1.iter().enumerate().filter(|_| several);
        keys.extend(parts.map(|(l, line)| (line.name.as_str(), style("#666", l))));
        // the keys, from the right as far as there is room
        let (mut at, room) = (CURVES[0] - MARGIN[1], 7.0 * self.name.chars().count() as f64 + 20.0);
        for (name, stroke) in keys.iter().rev().filter(|(name, _)| !name.is_empty()) {
            at -= 6.2 * name.chars().count() as f64 + 34.0;
            if at < room {
                break;
            }
            let (text, name) = (at + 22.0, escape(name));
            let _ = writeln!(
                svg,
                "<path {stroke} d=\"M{at:.0} 12h18\"/><text x=\"{text:.0}\" y=\"16\">{name}</text>"
            );
        }
        let plain = |c: char| if c.is_alphanumeric() { c } else { '-' };
        let name = self.name.chars().map(plain).collect();
        Some(Chart { name, svg: svg + "</svg>" })
    }
}
