//! How noisy an image is, told by the image.

use crate::Image;

/// Every so many pixels of a row, and rows, one is asked.
const STEP: usize = 4;
/// Share of the answers that are smaller than what counts: structure is in the larger ones.
const SHARE: f64 = 0.25;
/// A standard normal number is smaller than this, in size, with that probability.
const SMALLER_THAN: f64 = 0.318_639_363_964_375;
/// Root of the sum of squares of the weights: by how much an answer is larger than the noise of a pixel.
const GAIN: f64 = 6.0;
/// Largest answer of all.
const LARGEST: usize = 8 * 255;

/// Variance of the noise of a pixel, (grey levels)^2, if neighbours err independently; 0 for images of less than 3 x 3.
///
/// The second difference along rows of the one along columns has no answer to planes and straight edges along either, so
/// that what is left is noise and fine structure (Immerkaer, CVIU 1996). Structure is not everywhere and noise is: the
/// lower quartile of the answers' size says how large it is. Where a quarter of the image is over- or underexposed, or
/// was flattened by a compression, it says little of the rest, and rather too little than too much.
pub(crate) fn noise_variance(image: &Image<'_>) -> f64 {
    let (width, height) = (image.width(), image.height());
    if width < 3 || height < 3 {
        return 0.0;
    }
    let mut counts = [0_u32; LARGEST + 1];
    let mut total = 0_u32;
    for v in (1..height - 1).step_by(STEP) {
        let rows = [v - 1, v, v + 1].map(|v| image.run(0, v, width));
        for u in (1..width - 1).step_by(STEP) {
            let [above, here, below] = rows.map(|row| {
                let [left, middle, right] = [u - 1, u, u + 1].map(|u| i32::from(row[u]));
                left - 2 * middle + right
            });
            counts[(above - 2 * here + below).unsigned_abs() as usize] += 1;
            total += 1;
        }
    }
    let sd = quantile(&counts, SHARE * f64::from(total)) / (GAIN * SMALLER_THAN);
    sd * sd
}

/// The size below which `wanted` of the counted answers are, each spread over the half a level around it that rounding
/// takes away.
fn quantile(counts: &[u32], wanted: f64) -> f64 {
    let mut below = 0.0;
    for (size, &count) in counts.iter().enumerate() {
        let count = f64::from(count);
        if below + count > wanted {
            let (low, high) = ((size as f64 - 0.5).max(0.0), size as f64 + 0.5);
            return low + (high - low) * (wanted - below) / count;
        }
        below += count;
    }
    0.0
}
