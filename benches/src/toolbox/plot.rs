//! Charts as SVG text.

use super::error::{BenchError, Result};
use super::stats::Spread;
use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;
use sinew_tune::page::Chart;
use std::ops::Range;

/// Points of one kind.
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Cost and error, or places of a line.
    pub points: Vec<[f64; 2]>,
    /// Drawn hollow, lines thin and dashed.
    pub hollow: bool,
    /// Place in the list of colours.
    pub colour: usize,
}

impl Series {
    /// Points that are drawn full, lines thick.
    pub fn new(name: impl Into<String>, points: Vec<[f64; 2]>, colour: usize) -> Self {
        Self { name: name.into(), points, hollow: false, colour }
    }

    /// Drawn hollow, lines thin, or not.
    #[must_use]
    pub fn hollow(self, hollow: bool) -> Self {
        Self { hollow, ..self }
    }

    fn line(&self) -> ShapeStyle {
        colour(self.colour).stroke_width(if self.hollow { 1 } else { 2 })
    }

    fn mark(&self) -> ShapeStyle {
        if self.hollow { self.line() } else { colour(self.colour).filled() }
    }
}

/// One bar.
pub struct Bar {
    /// What it is.
    pub label: String,
    /// Its length.
    pub value: f64,
    /// Quartiles.
    pub quartiles: [f64; 2],
    /// What was aimed at.
    pub aim: Option<f64>,
    /// Place in the list of colours.
    pub colour: usize,
}

impl Bar {
    /// From the median and the quartiles of samples.
    pub fn new(label: String, spread: &Spread, aim: Option<f64>, colour: usize) -> Self {
        let quartiles = [spread.lower_quartile, spread.upper_quartile];
        Self { label, value: spread.median, quartiles, aim, colour }
    }
}

// distinguishable for most colour-blind readers
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(110, 80, 40),
    RGBColor(90, 90, 90),
];
const INK: RGBColor = RGBColor(34, 34, 34);
const GRID: RGBColor = RGBColor(225, 225, 225);
const FONT: &str = "sans-serif";

fn colour(i: usize) -> RGBColor {
    COLOURS[i % COLOURS.len()]
}

fn words(size: i32) -> TextStyle<'static> {
    (FONT, size).into_font().color(&INK)
}

fn failed(error: impl std::fmt::Display) -> BenchError {
    BenchError::Chart(error.to_string())
}

/// Draws into SVG text that scales with the page.
fn svg(name: &str, size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Result<()>) -> Result<Chart> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        draw(&area)?;
        area.present().map_err(failed)?;
    }
    Ok(Chart { name: name.into(), svg })
}

/// Label of a tick of the bars' axis.
fn linear_label(x: f64, logarithmic: bool) -> String {
    if logarithmic { tick_label(&x) } else { sinew_tune::table::three_digits(x) }
}

/// Whole decades around values, at least one.
pub fn decades(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    for x in values.filter(|x| x.is_finite() && *x > 0.0) {
        (low, high) = (low.min(x), high.max(x));
    }
    (low <= high).then(|| {
        let floor = low.log10().floor();
        let ceiling = high.log10().ceil().max(floor + 1.0);
        10f64.powf(floor)..10f64.powf(ceiling)
    })
}

/// Label of a tick: ticks of logarithmic axes carry rounding errors.
fn tick_label(x: &f64) -> String {
    let rounded = format!("{x:.0e}").parse().unwrap_or(*x);
    if (1e-3..1e4).contains(&rounded) { format!("{rounded}") } else { format!("{x:.0e}") }
}

/// Label of a tick of linear axes, without rounding errors and the sign of 0.
pub fn plain_label(x: &f64) -> String {
    format!("{}", (x * 1e9).round() / 1e9 + 0.0)
}

/// The same as what labels the other axes, only where the number begins with 1, 2 or 5: others would touch.
pub fn sparse_label(x: &f64) -> String {
    match format!("{x:.0e}").bytes().next() {
        Some(b'1' | b'2' | b'5') => tick_label(x),
        _ => String::new(),
    }
}

/// Errors (%) below this are rounding; they are drawn on the floor of the chart.
pub(crate) const FLOOR: f64 = 1e-8;

type Label = fn(&f64) -> String;

/// A chart of points, of lines, or of both.
struct Plot<'a> {
    title: &'a str,
    axes: [&'a str; 2],
    series: &'a [Series],
    /// Stairs through the points that nothing beats.
    fronts: Vec<Vec<(f64, f64)>>,
    ranges: [Range<f64>; 2],
    labels: [Label; 2],
    logarithmic: bool,
    lines: bool,
    points: bool,
    /// A few marks on every line, at other places on each: where lines coincide all are seen.
    marks: bool,
}

/// Marks on a line at most.
const MARKS: usize = 12;

impl Plot<'_> {
    fn chart(&self, name: &str) -> Result<Chart> {
        let [xs, ys] = self.ranges.clone();
        svg(name, (860, 520), |area| {
            let (area, legend) = area.split_horizontally(630);
            let mut chart = ChartBuilder::on(&area);
            chart.caption(self.title, words(17));
            chart.margin(12).x_label_area_size(46).y_label_area_size(66);
            if self.logarithmic {
                let chart = chart.build_cartesian_2d(xs.log_scale(), ys.log_scale());
                self.fill(chart.map_err(failed)?)?;
            } else {
                self.fill(chart.build_cartesian_2d(xs, ys).map_err(failed)?)?;
            }
            self.name(&legend)
        })
    }

    /// Grid, fronts, lines and points.
    fn fill<X, Y>(
        &self,
        mut chart: ChartContext<'_, SVGBackend<'_>, Cartesian2d<X, Y>>,
    ) -> Result<()>
    where
        X: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT).bold_line_style(GRID).axis_style(INK);
        mesh.x_desc(self.axes[0]).y_desc(self.axes[1]);
        mesh.label_style(words(13)).axis_desc_style(words(14));
        mesh.x_label_formatter(&self.labels[0]).y_label_formatter(&self.labels[1]);
        mesh.draw().map_err(failed)?;
        for front in &self.fronts {
            let style = INK.mix(0.45).stroke_width(1);
            chart.draw_series(LineSeries::new(front.clone(), style)).map_err(failed)?;
        }
        // dashed ones last, so that of two that coincide both are seen
        let (dashed, full): (Vec<_>, Vec<_>) =
            self.series.iter().enumerate().partition(|(_, s)| s.hollow && self.lines);
        for (i, s) in full.into_iter().chain(dashed) {
            let drawn = |x: &f64| x.is_finite() && (!self.logarithmic || *x > 0.0);
            let places =
                || s.points.iter().filter(move |p| p.iter().all(drawn)).map(|p| (p[0], p[1]));
            if self.lines && s.hollow {
                let places: Vec<(f64, f64)> = places().collect();
                let dashes = DashedLineSeries::new(places, 6, 4, s.line());
                chart.draw_series(dashes).map_err(failed)?;
            } else if self.lines {
                chart.draw_series(LineSeries::new(places(), s.line())).map_err(failed)?;
            }
            if self.marks {
                let step = s.points.len().div_ceil(MARKS).max(1);
                let marked = s.points.iter().skip(i * step / self.series.len()).step_by(step);
                let marked = marked.filter(|p| p.iter().all(drawn)).map(|p| (p[0], p[1]));
                let size = if s.hollow { 5 } else { 3 };
                chart
                    .draw_series(marked.map(|p| Circle::new(p, size, s.mark())))
                    .map_err(failed)?;
            }
            if self.points {
                let size = if self.lines { 3 } else { 4 };
                let circles = places().map(|p| Circle::new(p, size, s.mark()));
                chart.draw_series(circles).map_err(failed)?;
            }
        }
        Ok(())
    }

    /// The legend; series of one name share a place.
    fn name(&self, legend: &Area<'_>) -> Result<()> {
        let series = self.series;
        let first = |i: &usize| series[..*i].iter().all(|s| s.name != series[*i].name);
        let mut y = 52;
        let mut next = || {
            y += 21;
            (0, y - 21)
        };
        for s in (0..series.len()).filter(first).map(|i| &series[i]) {
            entry(legend, next(), &s.name, self.lines.then(|| s.line()), s.mark(), s.hollow)?;
        }
        if self.fronts.is_empty() {
            return Ok(());
        }
        let style = INK.mix(0.45).stroke_width(1);
        entry(legend, next(), "Pareto front", Some(style), style, false)
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A line of a legend, its left end at a place.
fn entry(
    legend: &Area<'_>,
    (x, y): (i32, i32),
    name: &str,
    line: Option<ShapeStyle>,
    mark: ShapeStyle,
    dashed: bool,
) -> Result<()> {
    let dashes = if dashed { &[[5, 10], [14, 19]][..] } else { &[[5, 19]] };
    match line {
        Some(line) => dashes.iter().try_for_each(|ends| {
            legend.draw(&PathElement::new(ends.map(|end| (x + end, y)).to_vec(), line))
        }),
        None => legend.draw(&Circle::new((x + 12, y), 4, mark)),
    }
    .map_err(failed)?;
    legend.draw(&Text::new(name.to_string(), (x + 24, y - 7), words(13))).map_err(failed)
}

/// A point, not below the floor of a chart; a NaN stays one.
fn lifted([x, y]: [f64; 2], floor: f64) -> [f64; 2] {
    [x, if y < floor { floor } else { y }]
}

/// Series with no point below the floor of a chart.
fn raised(series: &[Series], floor: f64) -> Vec<Series> {
    let raised = |s: &Series| {
        let points = s.points.iter().map(|p| lifted(*p, floor)).collect();
        Series::new(&*s.name, points, s.colour).hollow(s.hollow)
    };
    series.iter().map(raised).collect()
}

/// One of several charts with the same axes and names.
pub struct ChartPanel {
    /// Name of its file.
    pub name: String,
    /// Heading.
    pub title: String,
    /// Its points, joined by lines in their order.
    pub series: Vec<Series>,
}

/// Width and height of a panel without its legend: legible on a telephone.
const PANEL: [u32; 2] = [400, 330];

/// Errors (%) below this are drawn on the floor of panels.
const PANEL_FLOOR: f64 = 1e-4;

/// Error (%) over cost, both logarithmic, of several cases on the same scales: every case by itself, then, when there
/// are several, all in one picture of two columns with this name.
///
/// # Errors
/// When they cannot be drawn.
pub fn panels(
    name: &str,
    axes: [&str; 2],
    panels: &[ChartPanel],
    lines: bool,
) -> Result<Vec<Chart>> {
    let points = || panels.iter().flat_map(|p| &p.series).flat_map(|s| &s.points);
    let range = |k: usize, floor: f64| {
        let values = points().map(|p| p[k]).filter(|x| x.is_finite() && *x > 0.0);
        let ends =
            values.fold([f64::INFINITY, 0.0_f64], |[low, high], x| [low.min(x), high.max(x)]);
        (ends[0] <= ends[1]).then(|| ends[0].max(floor) / 1.5..ends[1].max(floor) * 1.5)
    };
    let (Some(xs), Some(ys)) = (range(0, 0.0), range(1, PANEL_FLOOR)) else {
        return Err(BenchError::Chart(format!("{name}: no points")));
    };
    let draw = |panel: &ChartPanel, area: &Area<'_>| -> Result<()> {
        let series = raised(&panel.series, PANEL_FLOOR);
        let plot = Plot {
            title: &panel.title,
            axes,
            series: &series,
            fronts: Vec::new(),
            ranges: [xs.clone(), ys.clone()],
            labels: [sparse_label; 2],
            logarithmic: true,
            lines,
            points: true,
            marks: false,
        };
        let mut chart = ChartBuilder::on(area);
        chart.caption(plot.title, words(16)).margin(8);
        chart.x_label_area_size(42).y_label_area_size(58);
        let chart = chart.build_cartesian_2d(xs.clone().log_scale(), ys.clone().log_scale());
        plot.fill(chart.map_err(failed)?)
    };
    let picture = |name: &str, panels: &[&ChartPanel]| {
        let mut names: Vec<&Series> = Vec::new();
        for s in panels.iter().flat_map(|p| &p.series) {
            if !s.points.is_empty() && names.iter().all(|n| n.name != s.name) {
                names.push(s);
            }
        }
        let columns = panels.len().min(2);
        let (rows, places) = (panels.len().div_ceil(columns), 2 * columns);
        let [width, height] = [columns as u32 * PANEL[0], rows as u32 * PANEL[1]];
        let legend = 10 + 21 * names.len().div_ceil(places) as u32;
        svg(name, (width, height + legend), |area| {
            let (charts, legend) = area.split_vertically(height);
            for (area, panel) in charts.split_evenly((rows, columns)).iter().zip(panels) {
                draw(panel, area)?;
            }
            for (i, s) in names.iter().enumerate() {
                let width = PANEL[0] as i32 / 2 - 4;
                let at = ((i % places) as i32 * width + 8, (i / places) as i32 * 21 + 10);
                entry(&legend, at, &s.name, lines.then(|| s.line()), s.mark(), s.hollow)?;
            }
            Ok(())
        })
    };
    let mut charts = Vec::with_capacity(panels.len() + 1);
    for panel in panels {
        charts.push(picture(&panel.name, &[panel])?);
    }
    if panels.len() > 1 {
        charts.push(picture(name, &panels.iter().collect::<Vec<_>>())?);
    }
    Ok(charts)
}

/// Error (%) over cost (s), both logarithmic, with lines through the points that nothing beats.
///
/// # Errors
/// When it cannot be drawn.
pub fn speed_against_error(
    name: &str,
    title: &str,
    axes: [&str; 2],
    series: &[Series],
    fronts: &[Vec<[f64; 2]>],
) -> Result<Chart> {
    let all = || series.iter().flat_map(|s| &s.points);
    let errors = decades(all().map(|p| p[1].max(FLOOR)));
    let (Some(xs), Some(ys)) = (decades(all().map(|p| p[0])), errors) else {
        return Err(BenchError::Chart(format!("{title}: no points")));
    };
    // costs need no whole decades
    let costs = || all().map(|p| p[0]).filter(|x| x.is_finite() && *x > 0.0);
    let xs = if xs.end / xs.start > 10.0 {
        costs().fold(f64::INFINITY, f64::min) / 1.5..costs().fold(0.0, f64::max) * 1.5
    } else {
        xs
    };
    let floored = raised(series, ys.start);
    // between two points of a front only the cheaper one's error is to be had
    let stairs = |front: &Vec<[f64; 2]>| {
        let mut steps: Vec<(f64, f64)> = Vec::new();
        for [x, y] in front.iter().map(|p| lifted(*p, ys.start)) {
            steps.extend(steps.last().map(|&(_, before)| (x, before)));
            steps.push((x, y));
        }
        steps
    };
    let (fronts, labels) = (fronts.iter().map(stairs).collect(), [sparse_label as Label; 2]);
    let (series, ranges) = (&floored[..], [xs, ys.clone()]);
    let (logarithmic, lines, points) = (true, false, true);
    let marks = false;
    let plot =
        Plot { title, axes, series, fronts, ranges, labels, logarithmic, lines, points, marks };
    plot.chart(name)
}

/// Scales of a line chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scales {
    /// Both linear.
    Linear,
    /// Both linear; points without lines between them.
    Scattered,
    /// Both linear and equal, for shapes.
    Equal,
    /// Both logarithmic; what is not positive is left out.
    Logarithmic,
}

/// Lines, and points on logarithmic axes or where these are asked for. Series of one name share a place in the legend.
///
/// # Errors
/// When it cannot be drawn.
pub fn lines(
    name: &str,
    title: &str,
    axes: [&str; 2],
    series: &[Series],
    scales: Scales,
) -> Result<Chart> {
    let logarithmic = scales == Scales::Logarithmic;
    let drawn = |p: &&[f64; 2]| p.iter().all(|x| x.is_finite() && (!logarithmic || *x > 0.0));
    let points = || series.iter().flat_map(|s| &s.points).filter(drawn);
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for p in points() {
        for k in 0..2 {
            bounds[k] = [bounds[k][0].min(p[k]), bounds[k][1].max(p[k])];
        }
    }
    if points().next().is_none() || bounds.iter().all(|[low, high]| low == high) {
        return Err(BenchError::Chart(format!("{title}: no points")));
    }
    let widths = bounds.map(|[low, high]| high - low);
    // the drawing area is about 550 by 440
    let scale = (widths[0] / 550.0).max(widths[1] / 440.0);
    let ranges: [Range<f64>; 2] = std::array::from_fn(|k| {
        let [low, high] = bounds[k];
        if logarithmic {
            return low / 1.2..high * 1.2;
        }
        let equal = scales == Scales::Equal;
        let least = if equal { scale * [550.0, 440.0][k] } else { widths[k] };
        let width = 1.08 * if least > 0.0 { least } else { widths[1 - k] };
        let middle = 0.5 * (low + high);
        middle - 0.5 * width..middle + 0.5 * width
    });
    let labels: [Label; 2] = [&ranges[0], &ranges[1]].map(|r| match logarithmic {
        false => plain_label as Label,
        // ticks of more than a decade would touch
        true if r.end / r.start < 10.0 => tick_label,
        true => sparse_label,
    });
    let lines = scales != Scales::Scattered;
    let (points, fronts) = (!lines || logarithmic, Vec::new());
    let marks = scales == Scales::Linear;
    let plot =
        Plot { title, axes, series, fronts, ranges, labels, logarithmic, lines, points, marks };
    plot.chart(name)
}

/// Horizontal bars with quartiles; a tick shows what was aimed at. Points on a logarithmic axis when they
/// differ by more than a factor of 30.
///
/// # Errors
/// When it cannot be drawn.
pub fn bars(name: &str, title: &str, unit: &str, bars: &[Bar]) -> Result<Chart> {
    let values = || bars.iter().flat_map(|b| [b.value, b.quartiles[1]].into_iter().chain(b.aim));
    let Some(range) = decades(values()) else {
        return Err(BenchError::Chart(format!("{title}: no bars")));
    };
    let largest = values().fold(0.0, f64::max);
    let smallest = bars.iter().map(|b| b.value).fold(f64::INFINITY, f64::min);
    let logarithmic = largest > 30.0 * smallest;
    let (left, width, row, top) = (330.0, 430.0, 20.0, 44.0);
    let place = |x: f64| {
        let share = if logarithmic {
            (x.max(range.start) / range.start).log10() / (range.end / range.start).log10()
        } else {
            x / (1.05 * largest)
        };
        (left + width * share) as i32
    };
    let bottom = top + row * bars.len() as f64;
    let ticks: Vec<f64> = if logarithmic {
        let (low, high) = (range.start.log10().round() as i32, range.end.log10().round() as i32);
        (low..=high).map(|k| 10f64.powi(k)).collect()
    } else {
        let step = 10f64.powf(largest.log10().floor());
        let step = [0.2, 0.5, 1.0, 2.0].map(|f| f * step).into_iter().find(|s| largest / s <= 6.0);
        let step = step.unwrap_or(largest);
        (0..=(largest / step) as usize).map(|i| i as f64 * step).collect()
    };
    svg(name, (860, bottom as u32 + 46), |area| {
        let text = |what: &str, at: (i32, i32), size: i32| {
            area.draw(&Text::new(what.to_string(), at, words(size))).map_err(failed)
        };
        text(title, (12, 10), 17)?;
        for &tick in &ticks {
            let x = place(tick);
            let line = PathElement::new(vec![(x, top as i32 - 4), (x, bottom as i32)], GRID);
            area.draw(&line).map_err(failed)?;
            text(&linear_label(tick, logarithmic), (x - 8, bottom as i32 + 4), 12)?;
        }
        text(unit, (left as i32, bottom as i32 + 22), 13)?;
        for (i, bar) in bars.iter().enumerate() {
            let y = (top + row * i as f64) as i32;
            text(&bar.label, (12, y + 2), 13)?;
            let end = place(bar.value);
            let middle = y + row as i32 / 2;
            let full = colour(bar.colour).filled();
            if logarithmic {
                // the length of a bar says nothing on an axis without 0
                area.draw(&Circle::new((end, middle), 5, full)).map_err(failed)?;
            } else {
                let corners = [(left as i32, y + 3), (end, y + row as i32 - 4)];
                area.draw(&Rectangle::new(corners, full)).map_err(failed)?;
            }
            let whisker: Vec<(i32, i32)> =
                bar.quartiles.iter().map(|q| (place(*q), middle)).collect();
            area.draw(&PathElement::new(whisker, INK)).map_err(failed)?;
            if let Some(aim) = bar.aim {
                let x = place(aim);
                let tick = PathElement::new(
                    vec![(x, y + 1), (x, y + row as i32 - 2)],
                    RGBColor(200, 0, 0).stroke_width(2),
                );
                area.draw(&tick).map_err(failed)?;
            }
            let beside = end.max(place(bar.quartiles[1])).max(bar.aim.map_or(0, place));
            text(&sinew_tune::table::three_digits(bar.value), (beside + 6, y + 2), 12)?;
        }
        Ok(())
    })
}
