//! Corners out of a response image: its peaks, and those of them that are spread over the image.

use nalgebra::Vector2;

/// A corner response, row by row.
#[derive(Clone, Copy, Debug)]
pub struct Response<'a> {
    values: &'a [f32],
    width: usize,
    height: usize,
}

/// Which peaks of a response count.
#[derive(Clone, Copy, Debug)]
pub struct PeakOptions {
    /// A peak is the largest response within so many pixels (square neighbourhood).
    pub reach: usize,
    /// Pixels along the edge without peaks, at least one.
    pub border: usize,
    /// Least response as a share of the best.
    pub quality: f32,
    /// Least response.
    pub least: f32,
}

impl<'a> Response<'a> {
    /// `None` if the number of values is not `width * height`.
    pub fn new(values: &'a [f32], width: usize, height: usize) -> Option<Self> {
        let fits = width.checked_mul(height) == Some(values.len());
        fits.then_some(Self {
            values,
            width,
            height,
        })
    }

    fn row(&self, v: usize) -> &'a [f32] {
        &self.values[v * self.width..][..self.width]
    }

    /// Sub-pixel places of the local maxima, the strongest first; of equal ones the first in reading order.
    pub fn peaks(&self, options: &PeakOptions) -> Vec<Vector2<f64>> {
        let border = options.border.max(1);
        if self.width.min(self.height) <= 2 * border {
            return Vec::new();
        }
        let columns = border..self.width - border;
        let rows = border..self.height - border;
        let inside = rows.clone().map(|v| &self.row(v)[columns.clone()]);
        let best = inside.map(largest).fold(0.0, f32::max);
        let least = options.least.max(options.quality * best);
        let count = columns.len();
        let mut higher = vec![false; count];
        let mut found = Vec::new();
        for v in rows {
            let (above, row, below) = (self.row(v - 1), self.row(v), self.row(v + 1));
            let middle = &row[border..][..count];
            let (left, right) = (&row[border - 1..][..count], &row[border + 1..][..count]);
            let (up, down) = (&above[border..][..count], &below[border..][..count]);
            let higher = &mut higher[..count];
            for x in 0..count {
                let value = middle[x];
                higher[x] = (value > least)
                    & (value >= left[x])
                    & (value >= right[x])
                    & (value >= up[x])
                    & (value >= down[x]);
            }
            for (x, &value) in middle.iter().enumerate() {
                if higher[x] && self.is_largest(border + x, v, options.reach) {
                    found.push((value, border + x, v));
                }
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let places = found.into_iter().map(|(value, u, v)| {
            let (row, above, below) = (self.row(v), self.row(v - 1), self.row(v + 1));
            Vector2::new(
                u as f64 + f64::from(vertex(row[u - 1], value, row[u + 1])),
                v as f64 + f64::from(vertex(above[u], value, below[u])),
            )
        });
        places.collect()
    }

    /// Whether nothing within `reach` is larger.
    fn is_largest(&self, u: usize, v: usize, reach: usize) -> bool {
        let value = self.values[v * self.width + u];
        let columns = u.saturating_sub(reach)..(u + reach + 1).min(self.width);
        for row in v.saturating_sub(reach)..(v + reach + 1).min(self.height) {
            let mut any = false;
            for &other in &self.row(row)[columns.clone()] {
                any |= other > value;
            }
            if any {
                return false;
            }
        }
        true
    }
}

/// Largest of some numbers that are not below zero.
fn largest(values: &[f32]) -> f32 {
    let (groups, rest) = values.as_chunks::<8>();
    let mut most = [0.0_f32; 8];
    for group in groups {
        for k in 0..8 {
            most[k] = if group[k] > most[k] {
                group[k]
            } else {
                most[k]
            };
        }
    }
    most.iter().chain(rest).fold(0.0, |a, &b| a.max(b))
}

/// Peak of the parabola through three values, the middle one the largest: within half a step.
fn vertex(before: f32, middle: f32, after: f32) -> f32 {
    let curve = (2.0 * middle - before - after).max(1e-20);
    (0.5 * (after - before) / curve).clamp(-0.5, 0.5)
}

/// Over which image corners are to be spread.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Columns and rows of the image.
    pub size: (usize, usize),
    /// Cells along its longer side.
    pub cells: usize,
    /// Least distance between a corner and a point that exists, pixels.
    pub distance: f64,
}

/// At most `count` of the peaks, given by their place in the list, those first whose part of the image needs them most.
///
/// Each cell of a grid offers its peaks in their order; a peak's rank is the number of points that its cell holds before
/// it, existing ones included. Existing points that are not finite do not count.
pub fn spread(
    peaks: &[Vector2<f64>],
    existing: &[Vector2<f64>],
    count: usize,
    grid: &Grid,
) -> Vec<usize> {
    let (width, height) = (grid.size.0 as f64, grid.size.1 as f64);
    let side = width.max(height) / grid.cells as f64;
    let columns = (width / side).ceil() as usize;
    let rows = (height / side).ceil() as usize;
    let cell = |at: &Vector2<f64>| {
        let u = (at.x.clamp(0.0, width - 1.0) / side) as usize;
        let v = (at.y.clamp(0.0, height - 1.0) / side) as usize;
        v * columns + u
    };
    let existing: Vec<_> = existing
        .iter()
        .filter(|at| at.x.is_finite() && at.y.is_finite())
        .collect();
    let mut held = vec![0; columns * rows + 1];
    for at in &existing {
        held[cell(at)] += 1;
    }
    let apart = grid.distance * grid.distance;
    let mut ranked = Vec::with_capacity(peaks.len());
    for (i, at) in peaks.iter().enumerate() {
        if existing
            .iter()
            .all(|other| (at - *other).norm_squared() >= apart)
        {
            let holds = &mut held[cell(at)];
            ranked.push((*holds, i));
            *holds += 1;
        }
    }
    ranked.sort_unstable();
    ranked.truncate(count);
    ranked.into_iter().map(|(_, i)| i).collect()
}
