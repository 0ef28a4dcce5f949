//! Pictures of the block.

use super::super::drawing::{Panel, bodies};
use super::*;

impl Measured {
    /// Places of the bottom, shapes at rest, and the motion.
    pub(super) fn charts(&self) -> Result<Vec<Chart>> {
        let place = |s: &Shape| [1e3 * s.bottom.x, 1e3 * s.bottom.z];
        let mut series = Vec::new();
        for (colour, field) in COURSES.into_iter().enumerate() {
            for size in [0, 1] {
                let what = What::Printed { field, volume: 0 };
                let own = self.runs.iter().filter(|(k, _)| (k.size, k.what) == (size, what));
                let places = own.filter_map(|(_, s)| s.end.as_ref().map(place)).collect();
                let name = format!("{}{}", field.name(), ["", ", fine"][size]);
                series.push(Series::new(name, places, colour).hollow(size == 1));
            }
        }
        let own = self.runs.iter().filter(|(k, _)| k.what == What::Springs);
        let springs = own.filter_map(|(_, s)| s.end.as_ref().map(place)).collect();
        series.push(Series::new("plain springs", springs, COURSES.len()));
        let title = "Where the bottom comes to rest: tetrahedra cut alike and irregularly";
        let names = ["sideways (mm)", "down (mm)"];
        let mut charts = vec![lines("a-pulled", title, names, &series, Scales::Scattered)?];
        let over_time = |of: fn(&Shape) -> f64| -> Vec<Series> {
            let series = |(colour, field): (usize, Field)| {
                let shapes = self.figure_6(field).map_or(&[][..], |s| &s.shapes);
                let points = (1..).zip(shapes).map(|(i, s)| [STEP * f64::from(i), of(s)]);
                Series::new(field.name(), points.collect(), colour)
            };
            COURSES.into_iter().enumerate().map(series).collect()
        };
        let twist = over_time(|s| s.twist);
        let names = ["time (s)", "turn of the bottom (degrees)"];
        charts.push(lines("a-twist", "Twisting and untwisting", names, &twist, Scales::Linear)?);
        let sideways = over_time(|s| 1e3 * s.bottom.x);
        let names = ["time (s)", "bottom sideways (mm)"];
        charts.push(lines("a-sideways", "Sideways motion", names, &sideways, Scales::Linear)?);
        charts.push(self.snake()?);
        charts.push(self.shapes()?);
        charts.push(self.frames()?);
        Ok(charts)
    }

    /// The axis of the block with hemicircular fibres at some times.
    fn snake(&self) -> Result<Chart> {
        let axis = self.figure_6(Field::Hemicircular).map_or(&[][..], |s| &s.axis);
        let series: Vec<Series> = FRAMES
            .into_iter()
            .enumerate()
            .filter_map(|(i, step)| Some((i, step, axis.get(step - 1)?)))
            .map(|(i, step, x)| {
                let cell = 1e3 * SIZE.z / CELLS[2] as f64;
                let points = x.iter().enumerate().map(|(k, x)| [1e3 * x, cell * k as f64]);
                Series::new(format!("{:.2} s", STEP * step as f64), points.collect(), i)
            })
            .collect();
        let names = ["sideways (mm)", "height at rest (mm)"];
        lines("a-snake", "The axis with hemicircular fibres", names, &series, Scales::Linear)
    }

    fn panel<'a>(
        &'a self,
        mesh: usize,
        title: &str,
        field: Field,
        u: &[DVec3],
    ) -> Result<Panel<'a>> {
        let mesh = &self.blocks[0][mesh].mesh;
        let points = mesh.points.iter().zip(u).map(|(x, u)| *x + *u).collect();
        Ok(Panel { title: title.to_string(), mesh, points, fibres: field.directions(mesh)? })
    }

    /// Figures 1 and 5 in the first row, figure 6 in the second: coarse meshes at rest.
    fn shapes(&self) -> Result<Chart> {
        let (none, first) = (Field::None, IRREGULAR[0]);
        let axes = |field, volume| What::Printed { field, volume };
        let mut wanted = vec![
            (PARALLEL, "springs, parallel cuts".to_string(), What::Springs),
            (PARALLEL, "axes, parallel cuts".to_string(), axes(none, 0)),
            (PARALLEL, "with volume springs".to_string(), axes(none, 1)),
            (first, "springs, irregular".to_string(), What::Springs),
            (first, "axes, irregular".to_string(), axes(none, 0)),
        ];
        let random = IRREGULAR.len() as u64;
        for field in COURSES.into_iter().skip(1).chain([Field::Random(random)]) {
            wanted.push((first, field.name().to_string(), axes(field, 1)));
        }
        let mut panels = Vec::new();
        for (mesh, title, what) in wanted {
            let Some(swing) = self.of(0, mesh, what).filter(|s| !s.u.is_empty()) else { continue };
            panels.push(self.panel(mesh, &title, what.field(), &swing.u)?);
        }
        let title = "The block at rest, pulled down: without fibres (figures 1, 5) and with fibres (figure 6)";
        Ok(bodies("a-shapes", title, &panels, 5))
    }

    /// Figure 6 c to e in time.
    fn frames(&self) -> Result<Chart> {
        let mut panels = Vec::new();
        for field in [Field::Hemicircular, Field::Helicoidal] {
            let frames = self.figure_6(field).map_or(&[][..], |s| &s.frames);
            for (step, u) in FRAMES.into_iter().zip(frames) {
                let title = format!("{}, {:.2} s", field.name(), STEP * step as f64);
                panels.push(self.panel(IRREGULAR[0], &title, field, u)?);
            }
        }
        let title = "The block let go under its load: undulating and twisting";
        Ok(bodies("a-frames", title, &panels, FRAMES.len()))
    }
}
