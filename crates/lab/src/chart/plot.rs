//! Curves on linear or logarithmic axes, drawn by plotters.

use crate::Error;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::register_font;
use serde::Serialize;
use std::ops::Range;
use std::sync::Once;

const SIZE: (u32, u32) = (960, 600);

/// Colours that stay apart, also for most who do not see all of them; dashes tell the rounds apart.
const COLORS: [RGBColor; 10] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(100, 60, 20),
    RGBColor(120, 120, 120),
    RGBColor(170, 30, 30),
    RGBColor(60, 60, 160),
];

/// An axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Axis {
    /// What is on it, with its unit.
    pub label: String,
    /// Whether it is logarithmic.
    pub log: bool,
}

impl Axis {
    /// A logarithmic axis.
    pub fn log(label: &str) -> Axis {
        Axis { label: label.to_owned(), log: true }
    }

    /// A linear axis.
    pub fn linear(label: &str) -> Axis {
        Axis { label: label.to_owned(), log: false }
    }
}

/// A curve.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Series {
    /// Name of the series, for the legend.
    pub name: String,
    /// Points of the series, in order; what an axis cannot show is left out.
    pub points: Vec<[f64; 2]>,
    /// Whether points are joined.
    pub line: bool,
}

/// Curves on common axes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plot {
    /// For file names.
    pub name: String,
    /// Headline.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Curves.
    pub series: Vec<Series>,
}

impl Plot {
    fn shown(&self, [x, y]: [f64; 2]) -> bool {
        x.is_finite() && y.is_finite() && (!self.x.log || x > 0.0) && (!self.y.log || y > 0.0)
    }

    fn range(&self, axis: usize) -> Range<f64> {
        let values = self.series.iter().flat_map(|s| &s.points).filter(|p| self.shown(**p));
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for point in values {
            low = low.min(point[axis]);
            high = high.max(point[axis]);
        }
        let log = [&self.x, &self.y][axis].log;
        if !(low <= high) {
            return if log { 0.1..10.0 } else { 0.0..1.0 };
        }
        if log {
            low / 1.5..high * 1.5
        } else {
            let margin = 0.05 * (high - low).max(1e-12 * high.abs()).max(f64::MIN_POSITIVE);
            low - margin..high + margin
        }
    }

    /// The chart as an SVG document.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn svg(&self) -> Result<String, Error> {
        let mut svg = String::new();
        self.draw(&SVGBackend::with_string(&mut svg, SIZE).into_drawing_area())?;
        Ok(svg)
    }

    /// The chart as pixels of 3 bytes, with width and height.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn rgb8(&self) -> Result<(Vec<u8>, u32, u32), Error> {
        let mut bytes = vec![255; 3 * SIZE.0 as usize * SIZE.1 as usize];
        self.draw(&BitMapBackend::with_buffer(&mut bytes, SIZE).into_drawing_area())?;
        Ok((bytes, SIZE.0, SIZE.1))
    }

    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, plotters::coord::Shift>,
    ) -> Result<(), Error> {
        static FONT: Once = Once::new();
        FONT.call_once(|| {
            // The font is part of the program: pictures are the same on every machine.
            let _ = register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular());
        });
        let (x, y) = (self.range(0), self.range(1));
        match (self.x.log, self.y.log) {
            (true, true) => self.draw_on(area, x.log_scale(), y.log_scale()),
            (true, false) => self.draw_on(area, x.log_scale(), y),
            (false, true) => self.draw_on(area, x, y.log_scale()),
            (false, false) => self.draw_on(area, x, y),
        }
        .map_err(|what| Error::Argument { what, remedy: "report this plot" })
    }

    fn draw_on<B, X, Y>(
        &self,
        area: &DrawingArea<B, plotters::coord::Shift>,
        x: X,
        y: Y,
    ) -> Result<(), String>
    where
        B: DrawingBackend,
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let failed = |e: DrawingAreaErrorKind<B::ErrorType>| format!("{}: {e}", self.name);
        area.fill(&WHITE).map_err(failed)?;
        let (plot, legend) = area.split_horizontally(SIZE.0 - 230);
        let mut context = ChartBuilder::on(&plot)
            .caption(&self.title, ("sans-serif", 19))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(72)
            .build_cartesian_2d(x, y)
            .map_err(failed)?;
        context
            .configure_mesh()
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 15))
            .bold_line_style(RGBColor(205, 205, 205))
            .light_line_style(RGBColor(240, 240, 240))
            .x_label_formatter(&|v| tick(*v))
            .y_label_formatter(&|v| tick(*v))
            .draw()
            .map_err(failed)?;
        let pitch = (i32::try_from(SIZE.1).unwrap_or(i32::MAX) - 60)
            / i32::try_from(self.series.len().max(1)).unwrap_or(i32::MAX);
        let pitch = pitch.clamp(10, 22);
        for (i, series) in self.series.iter().enumerate() {
            let color = COLORS[i % COLORS.len()];
            let points: Vec<(f64, f64)> =
                series.points.iter().filter(|p| self.shown(**p)).map(|p| (p[0], p[1])).collect();
            // Solid, dashed, dotted.
            let dash = [None, Some((7, 4)), Some((2, 3))][(i / COLORS.len()).min(2)];
            match dash {
                _ if !series.line => {}
                None => {
                    let line = LineSeries::new(points.clone(), color.stroke_width(2));
                    context.draw_series(line).map_err(failed)?;
                }
                Some((on, off)) => {
                    let line =
                        DashedLineSeries::new(points.clone(), on, off, color.stroke_width(2));
                    context.draw_series(line).map_err(failed)?;
                }
            }
            let dots = points.iter().map(|p| Circle::new(*p, 3, color.filled()));
            context.draw_series(dots).map_err(failed)?;
            let row = 36 + pitch * i32::try_from(i).unwrap_or(i32::MAX);
            let (on, off) = dash.unwrap_or((18, 0));
            let mut x = 8;
            while series.line && x < 26 {
                let mark =
                    Rectangle::new([(x, row + 3), ((x + on).min(26), row + 6)], color.filled());
                legend.draw(&mark).map_err(failed)?;
                x += on + off;
            }
            legend.draw(&Circle::new((17, row + 5), 3, color.filled())).map_err(failed)?;
            let font = ("sans-serif", (pitch - 3).min(14)).into_font();
            legend.draw(&Text::new(series.name.clone(), (32, row - 3), font)).map_err(failed)?;
        }
        area.present().map_err(failed)
    }
}

fn tick(value: f64) -> String {
    if value == 0.0 || (1e-2..1e4).contains(&value.abs()) {
        let text = format!("{value:.3}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        }
    } else {
        format!("{value:.0e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Axes of every kind, points that cannot be shown, no points at all.
    #[test]
    fn every_plot_is_drawn() {
        for (log_x, log_y) in [(true, true), (true, false), (false, true), (false, false)] {
            let axis = |log| Axis { label: "axis, s".into(), log };
            let series = |points: Vec<[f64; 2]>| Series { name: "a".into(), points, line: true };
            for points in
                [vec![], vec![[1.0, 1.0]], vec![[0.0, -1.0], [f64::NAN, 2.0], [3.0, 1e-9]]]
            {
                let plot = Plot {
                    name: "test".into(),
                    title: "Test".into(),
                    x: axis(log_x),
                    y: axis(log_y),
                    series: vec![series(points)],
                };
                assert!(plot.svg().unwrap().contains("</svg>"));
                let (bytes, width, height) = plot.rgb8().unwrap();
                assert_eq!(bytes.len(), 3 * (width * height) as usize);
                assert!(bytes.iter().any(|b| *b < 128), "something was drawn");
            }
        }
    }
}
