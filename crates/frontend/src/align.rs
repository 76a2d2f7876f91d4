//! Sub-pixel alignment of a template by Gauss-Newton steps over shift, gain and offset.
//!
//! The quadratic surface of a correlation peak is off by up to a tenth of a pixel where the texture is not symmetric;
//! this is not.

use crate::{Image, split};
use nalgebra::{Matrix4, Vector2, Vector4};

const STEPS: usize = 3;
const LONGEST: f64 = 0.5; // pixels, a step
const LEAST_GAIN: f64 = 0.1; // contrast of the image over the template's below which a step says nothing
const DAMPING: f64 = 1e-6; // of each diagonal element
const REACH: f64 = 1.0; // pixels from the start that are believed

/// Where the template's middle is, from a position to within about half a pixel; the same position if the steps lead
/// further than a pixel away, or the template is flat.
///
/// `template` holds `side * side` pixels, side odd and at least 3.
pub fn align(image: &Image<'_>, template: &[u8], side: usize, uv: Vector2<f64>) -> Vector2<f64> {
    let inner = side - 2;
    let at = |x: usize, y: usize| f64::from(template[y * side + x]);
    let mut rows = Vec::with_capacity(inner * inner);
    for y in 1..=inner {
        for x in 1..=inner {
            let (du, dv) = (at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1));
            rows.push([0.5 * du, 0.5 * dv, at(x, y), 1.0]);
        }
    }
    let mean = rows.iter().map(|row| row[2]).sum::<f64>() / rows.len() as f64;
    let mut normal = [[0.0; 4]; 4];
    for row in &mut rows {
        row[2] -= mean;
        for i in 0..4 {
            for j in 0..4 {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    let mut normal = Matrix4::from(normal);
    // In proportion to each number's own weight: a common one pulls the shift along with the mean grey.
    let weights = normal.diagonal();
    normal.set_diagonal(&(weights * (1.0 + DAMPING)));
    let Some(inverse) = normal.try_inverse() else {
        return uv;
    };
    let half = (inner / 2) as f64;
    let mut place = uv;
    for _ in 0..STEPS {
        let fit = inverse * right_side(image, &rows, inner, place - Vector2::repeat(half));
        if fit.z > LEAST_GAIN {
            place -= (fit.xy() / fit.z).map(|step| step.clamp(-LONGEST, LONGEST));
        }
    }
    if (place - uv).amax() <= REACH {
        place
    } else {
        uv
    }
}

/// The rows, weighted by the image sampled around a top left corner; beyond the image its edge repeats.
fn right_side(
    image: &Image<'_>,
    rows: &[[f64; 4]],
    inner: usize,
    corner: Vector2<f64>,
) -> Vector4<f64> {
    let (u0, fu) = split(corner.x, image.width);
    let (v0, fv) = split(corner.y, image.height);
    let inside =
        corner.x >= 0.0 && corner.y >= 0.0 && u0 + inner < image.width && v0 + inner < image.height;
    let mut total = [0.0; 4];
    let mut add = |row: &[f64; 4], value: f64| {
        for i in 0..4 {
            total[i] += row[i] * value;
        }
    };
    for (y, line) in rows.chunks_exact(inner).enumerate() {
        if inside {
            let above = image.run(u0, v0 + y, inner + 1);
            let below = image.run(u0, v0 + y + 1, inner + 1);
            let mix =
                |x: usize| f64::from(above[x]) + fv * (f64::from(below[x]) - f64::from(above[x]));
            let mut left = mix(0);
            for (x, row) in line.iter().enumerate() {
                let right = mix(x + 1);
                add(row, left + fu * (right - left));
                left = right;
            }
        } else {
            for (x, row) in line.iter().enumerate() {
                add(
                    row,
                    image.bilinear(corner.x + x as f64, corner.y + y as f64),
                );
            }
        }
    }
    Vector4::from(total)
}
