//! Active search: a template is looked for only where the filter expects it.
//!
//! Zero-normalised cross-correlation (ZNCC) inside the ellipse of the predicted pixel's covariance, a test against
//! low and ambiguous peaks, then the peak's sub-pixel position.
//!
//! Two windows that show the same, each with noise of its own, correlate by the share of their variance that is not
//! noise, and no better. Where few features are left, that share of the least correlation is asked for: a weak texture in
//! a noisy image can be as sure a match as a strong one, though a less exact one.

use crate::Image;
use crate::align::align;
use crate::correlate::{Map, Template};
use crate::noise::noise_variance;
use nalgebra::{Matrix2, Vector2};
use std::ops::Range;

/// Least share of a template's variance that counts as not noise: of one that is mostly noise as much is asked as of one
/// that is half of it, which it will not reach.
const MIN_SHARE: f64 = 0.5;

/// What a search is told.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Radius of the search ellipse in standard deviations.
    pub gate: f64,
    /// Least radius of the ellipse, pixels.
    pub min_radius: f64,
    /// Radius above which the ellipse is not searched whole if a guess lies in it, pixels.
    pub large_radius: f64,
    /// Cap of the search window's half side, pixels.
    pub max_radius: f64,
    /// Half side of the window searched around a guess, pixels.
    pub guess_radius: f64,
    /// Factor on the ellipse inside which a guess is believed.
    pub guess_gate: f64,
    /// Least correlation of a peak.
    pub min_score: f64,
    /// Whether less is asked for, by the share of a template that is noise.
    pub scarce: bool,
    /// A second peak above this share of the best score makes a match ambiguous.
    pub ambiguity: f64,
    /// Peaks nearer than this to the best one belong to it, pixels.
    pub peak_distance: f64,
    /// Least standard deviation of a template, grey levels.
    pub min_deviation: f64,
    /// Whether ellipses above `large_radius` are searched where no guess lies in them.
    pub whole: bool,
}

/// What became of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SearchOutcome {
    /// One clear peak.
    Found = 0,
    /// No peak is high enough.
    LowScore = 1,
    /// A second peak is nearly as high.
    Ambiguous = 2,
    /// The ellipse lies outside of the image.
    Outside = 3,
    /// The ellipse is wide, and nothing says where in it the template is: it was left for later.
    Wide = 4,
}

/// Outcome of a search.
#[derive(Clone, Copy, Debug)]
pub struct SearchResult {
    /// Sub-pixel position of the best peak; NaN where there is none.
    pub uv: Vector2<f64>,
    /// Its correlation; -1 where there is none.
    pub score: f64,
    /// Correlation of the next best peak that does not belong to it; -1 where there is none.
    pub second: f64,
    /// What became of it.
    pub outcome: SearchOutcome,
}

/// Where one template is looked for.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Predicted pixel.
    pub uv: Vector2<f64>,
    /// Its covariance, pixel noise included, px^2.
    pub s: Matrix2<f64>,
    /// Where something else says that it is; NaN for nowhere.
    pub guess: Vector2<f64>,
}

/// Looks for templates of `side * side` pixels, one after the other in `templates`, in one image.
///
/// An ellipse wider than `large_radius` is not searched whole if the guess lies in it (generously): then a small
/// window around the guess is. Without a guess the window is capped at `max_radius`, so that one template costs at
/// most one correlation at (2 max_radius + 3)^2 places. `side` is odd and at least 3.
pub fn search(
    image: &Image<'_>,
    templates: &[u8],
    side: usize,
    expected: &[Expected],
    options: &Options,
) -> Vec<SearchResult> {
    if expected.is_empty() {
        return Vec::new();
    }
    let noise = if options.scarce {
        noise_variance(image)
    } else {
        0.0
    };
    let mut map = Map::default();
    let mut wanted = Vec::new();
    let pairs = templates.chunks_exact(side * side).zip(expected);
    pairs
        .map(|(pixels, expected)| {
            let mut found = SearchResult {
                uv: Vector2::repeat(f64::NAN),
                score: -1.0,
                second: -1.0,
                outcome: SearchOutcome::Outside,
            };
            let Some(area) = Area::new(image, side, expected, options) else {
                return found;
            };
            if area.wide && !options.whole {
                found.outcome = SearchOutcome::Wide;
                return found;
            }
            found.outcome = SearchOutcome::LowScore;
            let template = Template::new(pixels, side);
            if template.deviation() < options.min_deviation {
                return found;
            }
            area.wanted(&mut wanted);
            let corner = (area.low.0 - side / 2, area.low.1 - side / 2);
            map.fill(image, &template, corner, area.size(), &wanted);
            area.judge(&map, options.peak_distance, &mut found);
            let not_noise = 1.0 - noise / template.deviation().powi(2);
            if found.score >= options.min_score * not_noise.max(MIN_SHARE) {
                found.uv = align(image, pixels, side, found.uv);
                let unique = found.second < options.ambiguity * found.score;
                found.outcome = if unique {
                    SearchOutcome::Found
                } else {
                    SearchOutcome::Ambiguous
                };
            }
            found
        })
        .collect()
}

/// An ellipse of the image, and the whole pixels around it.
struct Area {
    centre: Vector2<f64>,
    precision: Matrix2<f64>,
    limit: f64,
    /// Whether it is above `large_radius`.
    wide: bool,
    /// First and last column and row, with one more pixel all around the ellipse: it tells a peak from the slope of
    /// one outside.
    low: (usize, usize),
    high: (usize, usize),
}

impl Area {
    /// `None` where the ellipse, or all room for the template around it, is outside of the image.
    fn new(image: &Image<'_>, side: usize, expected: &Expected, options: &Options) -> Option<Self> {
        let floor = (options.min_radius / options.gate).powi(2);
        let shape = expected.s + Matrix2::from_diagonal_element(floor);
        let finite = expected
            .uv
            .iter()
            .chain(shape.iter())
            .all(|x| x.is_finite());
        let mut precision = shape.try_inverse().filter(|_| finite)?;
        let mut radius = shape.diagonal().map(|s| options.gate * s.sqrt());
        let mut centre = expected.uv;
        let mut limit = options.gate.powi(2);
        let shift = expected.guess - centre;
        let distance = shift.dot(&(precision * shift));
        let mut wide = radius.max() > options.large_radius;
        if wide && distance <= (options.gate * options.guess_gate).powi(2) {
            wide = false;
            centre = expected.guess;
            radius = Vector2::repeat(options.guess_radius);
            precision = Matrix2::from_diagonal_element(1.0 / options.guess_radius.powi(2));
            limit = 2.0;
        }
        let half = side / 2;
        let span = |centre: f64, radius: f64, size: usize| {
            let reach = radius.ceil().min(options.max_radius);
            let (first, last) = (half as i64, size as i64 - 1 - half as i64);
            let low = ((centre - reach).floor() as i64).max(first);
            let high = ((centre + reach).ceil() as i64).min(last);
            let (low, high) = ((low - 1).max(first), (high + 1).min(last));
            (high - low >= 2).then_some((low as usize, high as usize))
        };
        let (u0, u1) = span(centre.x, radius.x, image.width())?;
        let (v0, v1) = span(centre.y, radius.y, image.height())?;
        Some(Self {
            centre,
            precision,
            limit,
            wide,
            low: (u0, v0),
            high: (u1, v1),
        })
    }

    fn size(&self) -> (usize, usize) {
        (self.high.0 - self.low.0 + 1, self.high.1 - self.low.1 + 1)
    }

    /// Offset of a place of the map from the ellipse's centre.
    fn offset(&self, x: usize, y: usize) -> Vector2<f64> {
        Vector2::new((self.low.0 + x) as f64, (self.low.1 + y) as f64) - self.centre
    }

    /// Columns of each row of the map within one pixel of the ellipse.
    fn wanted(&self, out: &mut Vec<Range<usize>>) {
        let (width, height) = self.size();
        let [a, b, c] = [self.precision.m11, self.precision.m12, self.precision.m22];
        // a x^2 + 2 b x y + c y^2 <= limit; a row counts as the widest part of itself and its neighbours.
        let ends = |y: f64| {
            let root = (b * y).powi(2) - a * (c * y * y - self.limit);
            (root >= 0.0).then(|| ((-b * y - root.sqrt()) / a, (-b * y + root.sqrt()) / a))
        };
        out.clear();
        out.extend((0..height).map(|row| {
            let middle = self.offset(0, row);
            let mut low = f64::INFINITY;
            let mut high = f64::NEG_INFINITY;
            for y in [middle.y - 1.0, middle.y, middle.y + 1.0] {
                if let Some((first, last)) = ends(y) {
                    (low, high) = (low.min(first), high.max(last));
                }
            }
            if low > high {
                return 0..0;
            }
            let begin = (low - 1.0 - middle.x).floor().max(0.0) as usize;
            let end = (high + 1.0 - middle.x).ceil().max(-1.0) + 1.0;
            let end = (end as usize).min(width);
            begin.min(end)..end
        }));
    }

    /// Best peak inside the ellipse, and the next best that does not belong to it.
    fn judge(&self, map: &Map, apart: f64, found: &mut SearchResult) {
        let mut peaks: Vec<(f32, usize, usize)> = Vec::new();
        let width = map.width;
        for y in 1..map.height - 1 {
            let [above, row, below] = [y - 1, y, y + 1].map(|y| &map.values[y * width..][..width]);
            for x in 1..width - 1 {
                let value = row[x];
                if value <= 0.0 || row[x - 1] > value || row[x + 1] > value {
                    continue;
                }
                let near = x - 1..x + 2;
                let higher = |v: &f32| *v > value;
                if above[near.clone()].iter().any(higher) || below[near].iter().any(higher) {
                    continue;
                }
                let offset = self.offset(x, y);
                if offset.dot(&(self.precision * offset)) <= self.limit {
                    peaks.push((value, x, y));
                }
            }
        }
        // Of equal peaks the first in reading order.
        let Some(&(best, x, y)) = peaks.iter().reduce(|a, b| if b.0 > a.0 { b } else { a }) else {
            return;
        };
        found.score = f64::from(best);
        for &(value, x2, y2) in &peaks {
            let (du, dv) = (x2 as f64 - x as f64, y2 as f64 - y as f64);
            if du * du + dv * dv > apart * apart {
                found.second = found.second.max(f64::from(value));
            }
        }
        let near = |dx: usize, dy: usize| f64::from(map.values[(y + dy - 1) * width + x + dx - 1]);
        let values = [0, 1, 2].map(|dy| [0, 1, 2].map(|dx| near(dx, dy)));
        found.uv = self.offset(x, y) + self.centre + quadratic_peak(&values);
    }
}

/// Offset (u, v) of the maximum of the quadratic surface fitted to 3 x 3 values (rows are v) around a peak; zero where
/// it has none within a pixel.
fn quadratic_peak(values: &[[f64; 3]; 3]) -> Vector2<f64> {
    let column = |u: usize| values[0][u] + values[1][u] + values[2][u];
    let row = |v: usize| values[v][0] + values[v][1] + values[v][2];
    let gradient = Vector2::new(column(2) - column(0), row(2) - row(0)) / 6.0;
    let uu = (column(0) - 2.0 * column(1) + column(2)) / 3.0;
    let vv = (row(0) - 2.0 * row(1) + row(2)) / 3.0;
    let uv = (values[0][0] + values[2][2] - values[0][2] - values[2][0]) / 4.0;
    let determinant = uu * vv - uv * uv;
    if determinant <= 1e-12 || uu >= 0.0 {
        return Vector2::zeros();
    }
    let offset = Vector2::new(
        uv * gradient.y - vv * gradient.x,
        uv * gradient.x - uu * gradient.y,
    ) / determinant;
    if offset.amax() <= 1.0 {
        offset
    } else {
        Vector2::zeros()
    }
}
