//! Inner loops of the front end (METHOD sections 6 and 7): corners ([`corners`]); what a landmark's patch looks like from
//! elsewhere ([`warp`]), where it is in an image ([`search`]) and where exactly ([`align`]); descriptors of windows
//! ([`describe`]), which of them may belong together ([`pairs`]); and the pose that the matches of two views agree on
//! ([`consensus`]).
//!
//! These are loops over many small things, which no image library does and which Python does slowly. Images are 8-bit
//! grey, pixel `(u, v)` is column u of row v, pixel centres are at integers.

use nalgebra::Vector2;

pub mod align;
pub mod consensus;
pub mod corners;
mod correlate;
pub mod describe;
mod noise;
pub mod pairs;
pub mod search;
pub mod warp;

/// Fractional bits of a coordinate in fixed point, and the same as a number.
const BITS: u32 = 16;
const ONE: f64 = 65536.0;
/// Coordinates that fit.
const LARGEST: f64 = 32_000.0;

/// A grey image.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    pixels: &'a [u8],
    width: usize,
    height: usize,
}

impl<'a> Image<'a> {
    /// Rows of `width` pixels one after the other; `None` if the number of pixels is not `width * height` or is zero.
    pub fn new(pixels: &'a [u8], width: usize, height: usize) -> Option<Self> {
        let fits = width.checked_mul(height) == Some(pixels.len()) && !pixels.is_empty();
        fits.then_some(Self {
            pixels,
            width,
            height,
        })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// `count` pixels of row `v` from column `u` on; they must lie in the image.
    fn run(&self, u: usize, v: usize, count: usize) -> &'a [u8] {
        let begin = v * self.width + u;
        &self.pixels[begin..begin + count]
    }

    /// Bilinear value at a place; beyond the edge the edge repeats.
    fn bilinear(&self, u: f64, v: f64) -> f64 {
        let (u0, fu) = split(u, self.width);
        let (v0, fv) = split(v, self.height);
        let step = usize::from(u0 + 1 < self.width);
        let (u1, v1) = (u0 + step, (v0 + 1).min(self.height - 1));
        let at = |u: usize, v: usize| f64::from(self.pixels[v * self.width + u]);
        let above = at(u0, v0) + fu * (at(u1, v0) - at(u0, v0));
        let below = at(u0, v1) + fu * (at(u1, v1) - at(u0, v1));
        above + fv * (below - above)
    }
}

impl Image<'_> {
    /// Bilinear values at equal steps along a line; beyond the edge the edge repeats.
    #[inline(always)]
    fn sample_line(&self, start: Vector2<f64>, step: Vector2<f64>, out: &mut [f32]) {
        let end = start + step * (out.len().max(1) - 1) as f64;
        if !(self.holds(start) && self.holds(end)) {
            for (i, value) in out.iter_mut().enumerate() {
                let at = start + step * i as f64;
                *value = self.bilinear(at.x, at.y) as f32;
            }
            return;
        }
        // Fixed point: far cheaper than turning each coordinate into a whole number.
        let fixed = |x: f64| (x * ONE).round() as i32;
        let (mut u, mut v) = (fixed(start.x), fixed(start.y));
        let (du, dv) = (fixed(step.x), fixed(step.y));
        for value in out {
            let begin = (v >> BITS) as usize * self.width + (u >> BITS) as usize;
            let fraction = |x: i32| (x & (ONE as i32 - 1)) as f32 * (1.0 / ONE as f32);
            let (fu, fv) = (fraction(u), fraction(v));
            let mix = |at: usize| {
                let pair = &self.pixels[at..at + 2];
                let (a, b) = (f32::from(pair[0]), f32::from(pair[1]));
                a + fu * (b - a)
            };
            let (above, below) = (mix(begin), mix(begin + self.width));
            *value = above + fv * (below - above);
            (u, v) = (u + du, v + dv);
        }
    }

    /// Whether a place lies so far inside that rounding keeps four pixels around it.
    fn holds(&self, uv: Vector2<f64>) -> bool {
        let last = |size: usize| (size as f64 - 1.01).min(LARGEST);
        uv.x >= 0.01 && uv.y >= 0.01 && uv.x <= last(self.width) && uv.y <= last(self.height)
    }
}

/// Whole and fractional part of a coordinate, clamped to `0 ..= size - 1`.
fn split(x: f64, size: usize) -> (usize, f64) {
    let x = x.clamp(0.0, (size - 1) as f64);
    let whole = x as usize;
    (whole, x - whole as f64)
}
