//! SIFT's histogram of gradients (4 x 4 cells, 8 directions) over windows warped by an affine map.

use crate::Image;
use nalgebra::{Matrix2, Vector2};

/// Samples along the side of a window; twice as many match no better and cost four times as much.
pub const SAMPLES: usize = 8;
/// Length of a descriptor.
pub const LENGTH: usize = CELLS * CELLS * DIRECTIONS;
const CELLS: usize = 4;
const DIRECTIONS: usize = 8;
const CLIP: f32 = 0.2; // largest share of one bin: keeps a single strong edge from ruling the descriptor
const SIDE: usize = SAMPLES + 2; // one sample more on each side for the differences

/// Weights of a sample's row or column in the cells: bilinear, under a Gaussian window.
fn pooling() -> [[f32; CELLS]; SAMPLES] {
    std::array::from_fn(|i| {
        let place = (i as f64 + 0.5) / SAMPLES as f64;
        let window = (-0.5 * ((place - 0.5) / 0.5).powi(2)).exp();
        std::array::from_fn(|cell| {
            let distance = (place * CELLS as f64 - 0.5 - cell as f64).abs();
            ((1.0 - distance).max(0.0) * window) as f32
        })
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
    let weights = pooling();
    out.reserve(windows.len() * LENGTH);
    for (centre, axes) in windows {
        let axes = axes * step;
        let reach = axes.abs() * Vector2::repeat(0.5 * SIDE as f64);
        let inside = image.holds(centre - reach) && image.holds(centre + reach);
        let mut samples = [[0.0_f32; SIDE]; SIDE];
        for (y, row) in samples.iter_mut().enumerate() {
            for (x, value) in row.iter_mut().enumerate() {
                let middle = 0.5 * (SIDE - 1) as f64;
                let at = axes * Vector2::new(x as f64 - middle, y as f64 - middle) + centre;
                *value = if inside {
                    image.bilinear_inside(at.x, at.y) as f32
                } else {
                    image.bilinear(at.x, at.y) as f32
                };
            }
        }
        let histogram = histogram(&samples, &weights);
        let norm = histogram
            .iter()
            .flatten()
            .map(|x| x * x)
            .sum::<f32>()
            .sqrt()
            + 1e-6;
        let clipped = histogram.map(|cell| cell.map(|x| (x / norm).min(CLIP)));
        let sum = clipped.iter().flatten().sum::<f32>() + 1e-9;
        out.extend(clipped.iter().flatten().map(|x| (x / sum).sqrt()));
    }
}

fn histogram(
    samples: &[[f32; SIDE]; SIDE],
    weights: &[[f32; CELLS]; SAMPLES],
) -> [[f32; DIRECTIONS]; CELLS * CELLS] {
    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;
    let mut cells = [[0.0; DIRECTIONS]; CELLS * CELLS];
    for y in 0..SAMPLES {
        // The directions of a row's samples, pooled along u first.
        let mut pooled = [[0.0; DIRECTIONS]; CELLS];
        for x in 0..SAMPLES {
            let dx = samples[y + 1][x + 2] - samples[y + 1][x];
            let dy = samples[y + 2][x + 1] - samples[y][x + 1];
            // max(0, |g| cos(difference) - |g| cos(45 deg)): a bump over the two bins next to a gradient's direction.
            let least = (dx * dx + dy * dy).sqrt() * HALF;
            let along = [dx, HALF * (dx + dy), dy, HALF * (dy - dx)];
            let mut bump = [0.0; DIRECTIONS];
            for k in 0..DIRECTIONS / 2 {
                bump[k] = (along[k] - least).max(0.0);
                bump[k + DIRECTIONS / 2] = (-along[k] - least).max(0.0);
            }
            for (cell, &weight) in pooled.iter_mut().zip(&weights[x]) {
                for k in 0..DIRECTIONS {
                    cell[k] += weight * bump[k];
                }
            }
        }
        for (rows, &weight) in cells.chunks_exact_mut(CELLS).zip(&weights[y]) {
            for (cell, from) in rows.iter_mut().zip(&pooled) {
                for k in 0..DIRECTIONS {
                    cell[k] += weight * from[k];
                }
            }
        }
    }
    cells
}
