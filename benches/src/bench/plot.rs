//! Charts as SVG text.

use super::error::BenchError;
use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;

/// Points of one kind.
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Cost and error, or places of a line.
    pub points: Vec<[f64; 2]>,
    /// Drawn hollow, lines thin.
    pub hollow: bool,
    /// Place in the list of colours.
    pub colour: usize,
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

fn failed(error: impl std::fmt::Display) -> BenchError {
    BenchError::Chart(error.to_string())
}

/// Draws into SVG text that scales with the page.
fn svg(
    size: (u32, u32),
    draw: impl FnOnce(&DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), BenchError>,
) -> Result<String, BenchError> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        draw(&area)?;
        area.present().map_err(failed)?;
    }
    Ok(text)
}

/// Label of a tick of the bars' axis.
fn linear_label(x: f64, logarithmic: bool) -> String {
    if logarithmic { tick_label(&x) } else { super::table::three_digits(x) }
}

/// Whole decades around values, at least one.
fn decades(values: impl Iterator<Item = f64>) -> Option<std::ops::Range<f64>> {
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
fn plain_label(x: &f64) -> String {
    format!("{}", (x * 1e9).round() / 1e9 + 0.0)
}

/// The same as [`tick_label`], only where the number begins with 1, 2 or 5: others would touch.
fn sparse_label(x: &f64) -> String {
    match format!("{x:.0e}").bytes().next() {
        Some(b'1' | b'2' | b'5') => tick_label(x),
        _ => String::new(),
    }
}

/// Errors (%) below this are rounding; they are drawn on the floor of the chart.
const FLOOR: f64 = 1e-8;

/// Error (%) over cost (s), both logarithmic, with lines through the points that nothing beats.
///
/// # Errors
/// When it cannot be drawn.
pub fn speed_against_error(
    title: &str,
    cost: &str,
    error: &str,
    series: &[Series],
    fronts: &[Vec<[f64; 2]>],
) -> Result<String, BenchError> {
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
    svg((860, 520), |area| {
        let (chart_area, legend) = area.split_horizontally(630);
        let mut chart = ChartBuilder::on(&chart_area)
            .caption(title, (FONT, 17).into_font().color(&INK))
            .margin(12)
            .x_label_area_size(46)
            .y_label_area_size(66)
            .build_cartesian_2d(xs.log_scale(), ys.clone().log_scale())
            .map_err(failed)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .axis_style(INK)
            .x_desc(cost)
            .y_desc(error)
            .x_label_formatter(&sparse_label)
            .y_label_formatter(&sparse_label)
            .label_style((FONT, 13).into_font().color(&INK))
            .axis_desc_style((FONT, 14).into_font().color(&INK))
            .draw()
            .map_err(failed)?;
        for front in fronts {
            // stairs: between two points of the front only the cheaper one's error is to be had
            let mut steps: Vec<(f64, f64)> = Vec::new();
            for &[x, y] in front {
                if let Some(&(_, before)) = steps.last() {
                    steps.push((x, before));
                }
                steps.push((x, y.max(ys.start)));
            }
            let style = INK.mix(0.45).stroke_width(1);
            chart.draw_series(LineSeries::new(steps, style)).map_err(failed)?;
        }
        for s in series {
            let shape =
                if s.hollow { colour(s.colour).stroke_width(2) } else { colour(s.colour).filled() };
            let visible = s.points.iter().filter(|p| p.iter().all(|x| x.is_finite()));
            let circles = visible.map(|p| Circle::new((p[0], p[1].max(ys.start)), 4, shape));
            chart.draw_series(circles).map_err(failed)?;
        }
        for (i, s) in series.iter().enumerate() {
            let y = 52 + 21 * i as i32;
            let shape =
                if s.hollow { colour(s.colour).stroke_width(2) } else { colour(s.colour).filled() };
            legend.draw(&Circle::new((12, y), 4, shape)).map_err(failed)?;
            let style = (FONT, 13).into_font().color(&INK);
            legend.draw(&Text::new(s.name.clone(), (24, y - 7), style)).map_err(failed)?;
        }
        if !fronts.is_empty() {
            let y = 52 + 21 * series.len() as i32;
            let line = PathElement::new(vec![(5, y), (19, y)], INK.mix(0.45).stroke_width(1));
            legend.draw(&line).map_err(failed)?;
            let style = (FONT, 13).into_font().color(&INK);
            legend.draw(&Text::new("Pareto front", (24, y - 7), style)).map_err(failed)?;
        }
        Ok(())
    })
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
    title: &str,
    axes: [&str; 2],
    series: &[Series],
    scales: Scales,
) -> Result<String, BenchError> {
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
    if logarithmic {
        let [xs, ys] = bounds.map(|[low, high]| low / 1.2..high * 1.2);
        // ticks of more than a decade would touch
        let labels: [Label; 2] = [&xs, &ys]
            .map(|r| if r.end / r.start < 10.0 { tick_label as Label } else { sparse_label });
        return svg((860, 520), |area| {
            let (chart, legend) = area.split_horizontally(630);
            let chart = framed(&chart, title).build_cartesian_2d(xs.log_scale(), ys.log_scale());
            draw_lines(chart.map_err(failed)?, axes, series, scales, Some(labels))?;
            name_lines(&legend, series)
        });
    }
    let widths = bounds.map(|[low, high]| high - low);
    // the drawing area is about 550 by 440
    let scale = (widths[0] / 550.0).max(widths[1] / 440.0);
    let [xs, ys] = std::array::from_fn(|k| {
        let equal = scales == Scales::Equal;
        let least = if equal { scale * [550.0, 440.0][k] } else { widths[k] };
        let width = 1.08 * if least > 0.0 { least } else { widths[1 - k] };
        let middle = 0.5 * (bounds[k][0] + bounds[k][1]);
        middle - 0.5 * width..middle + 0.5 * width
    });
    svg((860, 520), |area| {
        let (chart, legend) = area.split_horizontally(630);
        let chart = framed(&chart, title).build_cartesian_2d(xs, ys).map_err(failed)?;
        draw_lines(chart, axes, series, scales, None)?;
        name_lines(&legend, series)
    })
}

type Label = fn(&f64) -> String;

fn framed<'a, 'b>(
    area: &'a DrawingArea<SVGBackend<'b>, Shift>,
    title: &str,
) -> ChartBuilder<'a, 'a, SVGBackend<'b>> {
    let mut chart = ChartBuilder::on(area);
    chart.caption(title, (FONT, 17).into_font().color(&INK));
    chart.margin(12).x_label_area_size(46).y_label_area_size(66);
    chart
}

/// Grid, lines, and points; logarithmic axes come with labels of their ticks.
fn draw_lines<X, Y>(
    mut chart: ChartContext<'_, SVGBackend<'_>, Cartesian2d<X, Y>>,
    [x, y]: [&str; 2],
    series: &[Series],
    scales: Scales,
    logarithmic: Option<[Label; 2]>,
) -> Result<(), BenchError>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(TRANSPARENT).bold_line_style(GRID).axis_style(INK).x_desc(x).y_desc(y);
    mesh.label_style((FONT, 13).into_font().color(&INK));
    mesh.axis_desc_style((FONT, 14).into_font().color(&INK));
    let [x_label, y_label] = logarithmic.unwrap_or([plain_label; 2]);
    mesh.x_label_formatter(&x_label).y_label_formatter(&y_label);
    mesh.draw().map_err(failed)?;
    for s in series {
        let style = colour(s.colour).stroke_width(if s.hollow { 1 } else { 2 });
        let line = || {
            let drawn = |x: &f64| x.is_finite() && (logarithmic.is_none() || *x > 0.0);
            s.points.iter().filter(move |p| p.iter().all(drawn)).map(|p| (p[0], p[1]))
        };
        if scales != Scales::Scattered {
            chart.draw_series(LineSeries::new(line(), style)).map_err(failed)?;
        }
        if scales == Scales::Scattered || logarithmic.is_some() {
            let shape = if s.hollow { style } else { colour(s.colour).filled() };
            chart.draw_series(line().map(|p| Circle::new(p, 3, shape))).map_err(failed)?;
        }
    }
    Ok(())
}

fn name_lines(
    legend: &DrawingArea<SVGBackend<'_>, Shift>,
    series: &[Series],
) -> Result<(), BenchError> {
    let first = |i: &usize| series[..*i].iter().all(|s| s.name != series[*i].name);
    for (place, i) in (0..series.len()).filter(first).enumerate() {
        let s = &series[i];
        let style = colour(s.colour).stroke_width(if s.hollow { 1 } else { 2 });
        let at = 52 + 21 * place as i32;
        legend.draw(&PathElement::new(vec![(5, at), (19, at)], style)).map_err(failed)?;
        let words = (FONT, 13).into_font().color(&INK);
        legend.draw(&Text::new(s.name.clone(), (24, at - 7), words)).map_err(failed)?;
    }
    Ok(())
}

/// Horizontal bars with quartiles; a tick shows what was aimed at. Logarithmic when they differ by
/// more than a factor of 30.
///
/// # Errors
/// When it cannot be drawn.
pub fn bars(title: &str, unit: &str, bars: &[Bar]) -> Result<String, BenchError> {
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
    svg((860, bottom as u32 + 46), |area| {
        let text = |words: &str, at: (i32, i32), size: i32| {
            let style = (FONT, size).into_font().color(&INK);
            area.draw(&Text::new(words.to_string(), at, style)).map_err(failed)
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
            let corners = [(left as i32, y + 3), (end, y + row as i32 - 4)];
            area.draw(&Rectangle::new(corners, colour(bar.colour).filled())).map_err(failed)?;
            let middle = y + row as i32 / 2;
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
            text(&super::table::three_digits(bar.value), (beside + 6, y + 2), 12)?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_hold_their_points_and_words() {
        let series = Series {
            name: "a < b".into(),
            points: vec![[1e-3, 1.0], [1e-2, 0.1], [f64::NAN, 1.0], [1.0, 0.0]],
            hollow: false,
            colour: 0,
        };
        let front = vec![vec![[1e-3, 1.0], [1e-2, 0.1]]];
        let text = speed_against_error("title", "cost", "error", &[series], &front).unwrap();
        assert!(text.starts_with("<svg") && text.contains("a &lt; b") && text.contains("Pareto"));
        // three points and one in the legend; zero lies on the floor, NaN nowhere
        assert_eq!(text.matches("<circle").count(), 4);
        assert!(!text.contains("NaN"));
        assert!(speed_against_error("t", "c", "e", &[], &[]).is_err());
    }

    #[test]
    fn lines_are_drawn_with_their_names() {
        let line = |points| Series { name: "a & b".into(), points, hollow: false, colour: 2 };
        let series = [line(vec![[0.0, 0.0], [1.0, -2.0]])];
        let text = lines("title", ["x", "y"], &series, Scales::Equal).unwrap();
        assert!(text.contains("<polyline") && text.contains("a &amp; b") && !text.contains("NaN"));
        let nothing = [line(vec![[f64::NAN, 1.0]])];
        assert!(lines("t", ["x", "y"], &nothing, Scales::Linear).is_err());
        // 0 has no place on logarithmic axes
        let series = [line(vec![[0.0, 1.0], [1.0, 1e-3], [10.0, 1e-2]])];
        let text = lines("title", ["x", "y"], &series, Scales::Logarithmic).unwrap();
        assert_eq!(text.matches("<circle").count(), 2);
    }

    #[test]
    fn bars_have_lengths_and_aims() {
        let bar = |value: f64, aim| Bar {
            label: "x".into(),
            value,
            quartiles: [0.9 * value, 1.1 * value],
            aim,
            colour: 1,
        };
        let text = bars("title", "ns", &[bar(1.0, None), bar(3.0, Some(2.0))]).unwrap();
        assert!(text.matches("<rect").count() >= 3 && text.contains("#C80000"));
        assert!(bars("t", "ns", &[bar(0.0, None)]).is_err());
    }

    #[test]
    fn ticks_are_readable() {
        let labels =
            [0.1 + 1e-17, 0.30000000000000004, 9.999999999999e-5, 20.0].map(|x| sparse_label(&x));
        assert_eq!(labels, ["0.1", "", "1e-4", "20"]);
        assert_eq!(
            [-1e-17, 0.30000000000000004, -40.0].map(|x| plain_label(&x)),
            ["0", "0.3", "-40"]
        );
    }

    #[test]
    fn decades_enclose() {
        assert_eq!(decades([0.002, 0.5, 0.0].into_iter()), Some(1e-3..1.0));
        assert_eq!(decades([1.0].into_iter()), Some(1.0..10.0));
        assert_eq!(decades([0.0].into_iter()), None);
    }
}
