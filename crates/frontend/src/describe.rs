//! SIFT's histogram of gradients (4 x 4 cells, 8 directions) over windows warped by an affine map.

use crate::Image;
use nalgebra::{Matrix2, Vector2};
use pulp::{Arch, Simd, WithSimd};

/// Samples along the side of a window; twice as many match no better and cost four times as much.
pub const SAMPLES: usize = 8;
/// Length of a descriptor.
pub const LENGTH: usize = CELLS * CELLS * DIRECTIONS;
const CELLS: usize = 4;
const DIRECTIONS: usize = 8;
const CLIP: f32 = 0.2; // largest share of one bin: keeps a single strong edge from ruling the descriptor
const SIDE: usize = SAMPLES + 2; // one sample more on each side for the differences

/// The two cells that a sample's row or column counts in, the first by number, and its weights there: bilinear, under
/// a Gaussian window.
type Share = (usize, [f32; 2]);

fn shares() -> [Share; SAMPLES] {
    std::array::from_fn(|i| {
        let place = (i as f64 + 0.5) / SAMPLES as f64;
        let window = (-0.5 * ((place - 0.5) / 0.5).powi(2)).exp();
        let at = place * CELLS as f64 - 0.5;
        let first = (at.floor().max(0.0) as usize).min(CELLS - 2);
        let weight = |cell: usize| ((1.0 - (at - cell as f64).abs()).max(0.0) * window) as f32;
        (first, [weight(first), weight(first + 1)])
    })
}

/// Appends the descriptor of each window to `out`: square roots of the L1-normalised histogram, unit vectors of
/// [`LENGTH`] numbers.
///
/// A window is a grid of samples `step` apart in the described view; `axes` maps offsets there to pixel offsets in
/// the image.
pub fn describe(
    image: &Image<'_>,
    windows: &[(Vector2<f64>, Matrix2<f64>)],
    step: f64,
    out: &mut Vec<f32>,
) {
    Arch::new().dispatch(Describe {
        image,
        windows,
        step,
        out,
    });
}

struct Describe<'a> {
    image: &'a Image<'a>,
    windows: &'a [(Vector2<f64>, Matrix2<f64>)],
    step: f64,
    out: &'a mut Vec<f32>,
}

impl WithSimd for Describe<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        describe_all(self.image, self.windows, self.step, self.out);
    }
}

#[inline(always)]
fn describe_all(
    image: &Image<'_>,
    windows: &[(Vector2<f64>, Matrix2<f64>)],
    step: f64,
    out: &mut Vec<f32>,
) {
    let shares = shares();
    out.reserve(windows.len() * LENGTH);
    for (centre, axes) in windows {
        let axes = axes * step;
        let middle = 0.5 * (SIDE - 1) as f64;
        let mut samples = [[0.0_f32; SIDE]; SIDE];
        for (y, row) in samples.iter_mut().enumerate() {
            let start = axes * Vector2::new(-middle, y as f64 - middle) + centre;
            image.sample_line(start, axes.column(0).into_owned(), row);
        }
        let histogram = histogram(&samples, &shares);
        let bins = histogram.as_flattened();
        let mut squares = [0.0_f32; DIRECTIONS];
        for cell in &histogram {
            for k in 0..DIRECTIONS {
                squares[k] += cell[k] * cell[k];
            }
        }
        let norm = squares.iter().sum::<f32>().sqrt() + 1e-6;
        let begin = out.len();
        out.extend_from_slice(bins);
        let described = &mut out[begin..];
        let mut sum = 1e-9;
        for value in described.iter_mut() {
            *value = (*value / norm).min(CLIP);
            sum += *value;
        }
        for value in described.iter_mut() {
            *value = (*value / sum).sqrt();
        }
    }
}

#[inline(always)]
fn histogram(
    samples: &[[f32; SIDE]; SIDE],
    shares: &[Share; SAMPLES],
) -> [[f32; DIRECTIONS]; CELLS * CELLS] {
    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;
    let mut cells = [[0.0; DIRECTIONS]; CELLS * CELLS];
    for (y, (first_row, row_weights)) in shares.iter().enumerate() {
        // The directions of a row's samples, pooled along u first.
        let mut pooled = [[0.0; DIRECTIONS]; CELLS];
        let differences = |x: usize| {
            (
                samples[y + 1][x + 2] - samples[y + 1][x],
                samples[y + 2][x + 1] - samples[y][x + 1],
            )
        };
        for (x, (first, weights)) in shares.iter().enumerate() {
            let (dx, dy) = differences(x);
            // max(0, |g| cos(difference) - |g| cos(45 deg)): a bump over the two bins next to a gradient's direction.
            let least = (dx * dx + dy * dy).sqrt() * HALF;
            let (rising, falling) = (HALF * (dx + dy), HALF * (dy - dx));
            let along = [dx, rising, dy, falling, -dx, -rising, -dy, -falling];
            let mut bump = [0.0; DIRECTIONS];
            for k in 0..DIRECTIONS {
                bump[k] = (along[k] - least).max(0.0);
            }
            for (cell, weight) in pooled[*first..].iter_mut().zip(weights) {
                for k in 0..DIRECTIONS {
                    cell[k] += weight * bump[k];
                }
            }
        }
        for (row, weight) in cells.as_chunks_mut::<CELLS>().0[*first_row..]
            .iter_mut()
            .zip(row_weights)
        {
            for (cell, from) in row.iter_mut().zip(&pooled) {
                for k in 0..DIRECTIONS {
                    cell[k] += weight * from[k];
                }
            }
        }
    }
    cells
}
