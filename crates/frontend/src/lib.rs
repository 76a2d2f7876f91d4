//! Inner loops of the front end (METHOD sections 6 and 7): what a landmark's patch looks like from elsewhere ([`warp`]),
//! where it is in an image ([`search`]) and where exactly ([`align`]); descriptors of windows ([`describe`]); and the
//! pose that the matches of two views agree on ([`consensus`]).
//!
//! These are loops over many small things, which no image library does and which Python does slowly. Images are 8-bit
//! grey, pixel `(u, v)` is column u of row v, pixel centres are at integers.

use nalgebra::Vector2;

pub mod align;
pub mod consensus;
mod correlate;
pub mod describe;
pub mod search;
pub mod warp;

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
    /// Whether a place has four pixels around it.
    fn holds(&self, uv: Vector2<f64>) -> bool {
        let last = Vector2::new(self.width as f64 - 2.0, self.height as f64 - 2.0);
        uv.x >= 0.0 && uv.y >= 0.0 && uv.x <= last.x && uv.y <= last.y
    }

    /// [`Image::bilinear`] where the image [holds](Self::holds) the place.
    fn bilinear_inside(&self, u: f64, v: f64) -> f64 {
        let (u0, v0) = (u as usize, v as usize);
        let (fu, fv) = (u - u0 as f64, v - v0 as f64);
        let begin = v0 * self.width + u0;
        let (above, below) = (&self.pixels[begin..], &self.pixels[begin + self.width..]);
        let mix = |row: &[u8]| {
            let (a, b) = (f64::from(row[0]), f64::from(row[1]));
            a + fu * (b - a)
        };
        let (above, below) = (mix(&above[..2]), mix(&below[..2]));
        above + fv * (below - above)
    }
}

/// Whole and fractional part of a coordinate, clamped to `0 ..= size - 1`.
fn split(x: f64, size: usize) -> (usize, f64) {
    let x = x.clamp(0.0, (size - 1) as f64);
    let whole = x as usize;
    (whole, x - whole as f64)
}
