//! Zero-normalised cross-correlation of one template at many places, in SIMD chosen at run time.

use crate::Image;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Places whose sums are kept in registers at once.
const PLACES: usize = 16;
/// Independent sums of each, so that additions need not wait for one another.
const CHAINS: usize = 4;
/// What a correlation can't be: where none was asked for, and where an image window is flat.
pub(crate) const NONE: f32 = -2.0;

/// Sum of squares without mean of a window that is flat, (grey levels)^2.
const FLAT: f64 = 0.5;

/// A template less its mean, and the size of what is left.
pub(crate) struct Template {
    side: usize,
    /// Row by row, each `line` long: zeros fill it up.
    values: Vec<f32>,
    line: usize,
    norm: f64,
}

impl Template {
    /// From `side * side` pixels.
    pub(crate) fn new(pixels: &[u8], side: usize) -> Self {
        let count = (side * side) as f64;
        let sum: u32 = pixels.iter().map(|&p| u32::from(p)).sum();
        let mean = f64::from(sum) / count;
        let squares: u64 = pixels.iter().map(|&p| u64::from(p) * u64::from(p)).sum();
        let line = side.next_multiple_of(CHAINS);
        let mut values = vec![0.0; side * line];
        for (to, from) in values.chunks_exact_mut(line).zip(pixels.chunks_exact(side)) {
            for (to, &p) in to.iter_mut().zip(from) {
                *to = (f64::from(p) - mean) as f32;
            }
        }
        Self {
            side,
            values,
            line,
            norm: (squares as f64 - f64::from(sum) * mean).max(0.0),
        }
    }

    /// Standard deviation of the pixels, grey levels.
    pub(crate) fn deviation(&self) -> f64 {
        (self.norm / (self.side * self.side) as f64).sqrt()
    }
}

/// Correlations of a template around the places of a rectangle of the image, and the buffers they are made in.
#[derive(Default)]
pub(crate) struct Map {
    /// Columns and rows of the map.
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Row by row; [`NONE`] where nothing was asked for.
    pub(crate) values: Vec<f32>,
    window: Vec<f32>,
    columns: Vec<(u32, u32)>,
    sums: Vec<i32>,
    squares: Vec<i32>,
}

impl Map {
    /// Correlates with the template's top left corner at `(left, top)` and `width x height` places from there on;
    /// in row y only at the columns `wanted[y]`.
    pub(crate) fn fill(
        &mut self,
        image: &Image<'_>,
        template: &Template,
        (left, top): (usize, usize),
        (width, height): (usize, usize),
        wanted: &[Range<usize>],
    ) {
        (self.width, self.height) = (width, height);
        let side = template.side;
        // Each row is as long as its last register reaches.
        let stride = width + template.line + PLACES;
        let columns = width + side - 1;
        self.values.clear();
        self.values.resize(width * height, NONE);
        self.window.clear();
        self.window.resize((height + side - 1) * stride, 0.0);
        for (y, row) in self.window.chunks_exact_mut(stride).enumerate() {
            let pixels = image.run(left, top + y, columns);
            row.iter_mut()
                .zip(pixels)
                .for_each(|(to, &p)| *to = f32::from(p));
        }
        self.sum_windows(image, side, (left, top), wanted);
        Arch::new().dispatch(Products {
            template,
            window: &self.window,
            stride,
            width,
            wanted,
            sums: &self.sums,
            squares: &self.squares,
            out: &mut self.values,
        });
    }

    /// Sums of the pixels under the template at each place of the map, and of their squares.
    fn sum_windows(
        &mut self,
        image: &Image<'_>,
        side: usize,
        (left, top): (usize, usize),
        wanted: &[Range<usize>],
    ) {
        let columns = self.width + side - 1;
        self.columns.clear();
        self.columns.resize(columns, (0, 0));
        for sums in [&mut self.sums, &mut self.squares] {
            sums.clear();
            sums.resize(self.width * self.height, 0);
        }
        let square = |p: u8| u32::from(p) * u32::from(p);
        for (row, pixels) in
            (0..self.height + side - 1).map(|y| (y, image.run(left, top + y, columns)))
        {
            for ((sum, squares), &p) in self.columns.iter_mut().zip(pixels) {
                *sum += u32::from(p);
                *squares += square(p);
            }
            let Some(y) = (row + 1).checked_sub(side) else {
                continue;
            };
            let Range { start, end } = wanted[y].clone();
            if start < end {
                let (mut sum, mut squares) = (0, 0);
                for column in &self.columns[start..start + side - 1] {
                    sum += column.0;
                    squares += column.1;
                }
                let ends = self.columns[start..]
                    .iter()
                    .zip(&self.columns[start + side - 1..]);
                let places = y * self.width + start..y * self.width + end;
                let out = self.sums[places.clone()]
                    .iter_mut()
                    .zip(&mut self.squares[places]);
                for ((first, last), (to, to_squares)) in ends.zip(out) {
                    (sum, squares) = (sum + last.0, squares + last.1);
                    (*to, *to_squares) = (sum as i32, squares as i32);
                    (sum, squares) = (sum - first.0, squares - first.1);
                }
            }
            for ((sum, squares), &p) in
                self.columns
                    .iter_mut()
                    .zip(image.run(left, top + y, columns))
            {
                *sum -= u32::from(p);
                *squares -= square(p);
            }
        }
    }
}

/// Correlations from an image window and the sums under the template, [`PLACES`] at once.
struct Products<'a> {
    template: &'a Template,
    window: &'a [f32],
    stride: usize,
    width: usize,
    wanted: &'a [Range<usize>],
    sums: &'a [i32],
    squares: &'a [i32],
    out: &'a mut [f32],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES {
            16 => self.run::<S, 1>(simd),
            8 => self.run::<S, 2>(simd),
            4 => self.run::<S, 4>(simd),
            _ => self.run::<S, PLACES>(simd),
        }
    }
}

impl Products<'_> {
    /// `V` vectors hold [`PLACES`] numbers.
    #[inline(always)]
    fn run<S: Simd, const V: usize>(self, simd: S) {
        let line = self.template.line;
        let per_pixel = 1.0 / (self.template.side * self.template.side) as f64;
        for (y, wanted) in self.wanted.iter().enumerate() {
            let mut x = wanted.start;
            while x < wanted.end {
                let mut sums = [[simd.splat_f32s(0.0); V]; CHAINS];
                for (dy, line) in self.template.values.chunks_exact(line).enumerate() {
                    let row = &self.window[(y + dy) * self.stride + x..][..line.len() + PLACES];
                    let (groups, _) = line.as_chunks::<CHAINS>();
                    for (g, group) in groups.iter().enumerate() {
                        for k in 0..CHAINS {
                            let t = simd.splat_f32s(group[k]);
                            let (pixels, _) = S::as_simd_f32s(&row[CHAINS * g + k..][..PLACES]);
                            for v in 0..V {
                                sums[k][v] = simd.mul_add_f32s(t, pixels[v], sums[k][v]);
                            }
                        }
                    }
                }
                let mut totals = [0.0_f32; PLACES];
                let (vectors, _) = S::as_mut_simd_f32s(&mut totals);
                for v in 0..V {
                    let low = simd.add_f32s(sums[0][v], sums[1][v]);
                    vectors[v] = simd.add_f32s(low, simd.add_f32s(sums[2][v], sums[3][v]));
                }
                let end = wanted.end.min(x + PLACES);
                let row = y * self.width;
                self.out[row + x..row + end].copy_from_slice(&totals[..end - x]);
                x = end;
            }
            let row = y * self.width + wanted.start..y * self.width + wanted.end.max(wanted.start);
            let places = self.out[row.clone()].iter_mut();
            let sums = self.sums[row.clone()].iter().zip(&self.squares[row]);
            for (value, (&sum, &square)) in places.zip(sums) {
                let sum = f64::from(sum);
                let norm = f64::from(square) - sum * sum * per_pixel;
                let correlation = f64::from(*value) / (norm * self.template.norm).sqrt();
                *value = if norm > FLAT {
                    correlation as f32
                } else {
                    NONE
                };
            }
        }
    }
}
