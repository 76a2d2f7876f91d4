//! Alignment of a template by Gauss-Newton steps over an affine map, gain and offset.
//!
//! Another camera sees a patch foreshortened in a way that its depth alone does not tell: on a wall along the line of
//! sight the shift alone is off by a pixel, and a wrong match correlates about as well as a right one. Inverse
//! compositional: the template's derivatives and their normal matrix are formed once.

use crate::Image;
use crate::align::{DAMPING, LEAST_GAIN};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

const STEPS: usize = 8;
const SETTLED: f64 = 0.01; // pixels at the template's edge, of a step
const REACH: f64 = 4.0; // pixels from the start that are believed
const STRETCH: f64 = 0.8; // largest change of an element of the map that is

type Row = SVector<f64, 8>;

/// Where the template's middle is, starting from a position some pixels off, and the correlation there once the
/// template is stretched to fit; `None` if the steps lead nowhere, or the template is flat.
///
/// `template` holds `side * side` pixels, side odd and at least 3.
pub fn align_affine(
    image: &Image<'_>,
    template: &[u8],
    side: usize,
    uv: Vector2<f64>,
) -> Option<(Vector2<f64>, f64)> {
    let rows = rows(template, side);
    let mut normal = SMatrix::<f64, 8, 8>::zeros();
    for (_, row) in &rows {
        normal.ger(1.0, row, row, 1.0);
    }
    let weights = normal.diagonal();
    normal.set_diagonal(&(weights * (1.0 + DAMPING)));
    let solver = normal.cholesky()?;
    let (mut place, mut map) = (uv, Matrix2::identity());
    let edge = (side / 2) as f64;
    for _ in 0..STEPS {
        let mut right = Row::zeros();
        for (offset, row) in &rows {
            let at = place + map * offset;
            right.axpy(image.bilinear(at.x, at.y), row, 1.0);
        }
        let fit = solver.solve(&right);
        if fit[6] < LEAST_GAIN {
            return None;
        }
        let [u, v, a, b, c, d] = [0, 1, 2, 3, 4, 5].map(|i| fit[i] / fit[6]);
        // The image is the template moved by this step, seen through the map: take the step back before it.
        let back = (Matrix2::identity() + Matrix2::new(a, b, c, d)).try_inverse()?;
        let step = Vector2::new(u, v);
        map *= back;
        place -= map * step;
        let far = (place - uv).amax() > REACH || (map - Matrix2::identity()).amax() > STRETCH;
        if far || !map.iter().all(|x| x.is_finite()) {
            return None;
        }
        if step.amax() + edge * (back - Matrix2::identity()).amax() < SETTLED {
            break;
        }
    }
    Some((place, correlation(image, &rows, place, &map)))
}

/// Offset from the middle, and derivatives of the grey by shift and map, grey less its mean, and one: for each pixel
/// with neighbours on all sides.
fn rows(template: &[u8], side: usize) -> Vec<(Vector2<f64>, Row)> {
    let half = (side / 2) as f64;
    let at = |x: usize, y: usize| f64::from(template[y * side + x]);
    let inner = || (1..side - 1).flat_map(|y| (1..side - 1).map(move |x| (x, y)));
    let mean = inner().map(|(x, y)| at(x, y)).sum::<f64>() / ((side - 2) * (side - 2)) as f64;
    inner()
        .map(|(x, y)| {
            let (gu, gv) = (
                0.5 * (at(x + 1, y) - at(x - 1, y)),
                0.5 * (at(x, y + 1) - at(x, y - 1)),
            );
            let offset = Vector2::new(x as f64 - half, y as f64 - half);
            let (u, v) = (offset.x, offset.y);
            let row = [gu, gv, gu * u, gu * v, gv * u, gv * v, at(x, y) - mean, 1.0];
            (offset, Row::from(row))
        })
        .collect()
}

/// Zero-normalised correlation of the template and the image seen through the map.
fn correlation(
    image: &Image<'_>,
    rows: &[(Vector2<f64>, Row)],
    place: Vector2<f64>,
    map: &Matrix2<f64>,
) -> f64 {
    let (mut sum, mut squares, mut cross, mut own) = (0.0, 0.0, 0.0, 0.0);
    for (offset, row) in rows {
        let at = place + map * offset;
        let (value, grey) = (image.bilinear(at.x, at.y), row[6]);
        sum += value;
        squares += value * value;
        cross += value * grey;
        own += grey * grey;
    }
    let spread = squares - sum * sum / rows.len() as f64;
    cross / (spread.max(0.0) * own).sqrt().max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 15;

    fn grey(u: f64, v: f64) -> f64 {
        128.0
            + 40.0 * (0.55 * u + 0.2 * v).sin()
            + 35.0 * (0.5 * v - 0.25 * u).cos()
            + 20.0 * (0.31 * u * v * 0.1).sin()
    }

    fn picture(map: &Matrix2<f64>, middle: Vector2<f64>) -> Vec<u8> {
        let back = map.try_inverse().expect("invertible");
        let pixels = (0..64).flat_map(|v| (0..80).map(move |u| (u, v)));
        pixels
            .map(|(u, v)| {
                let at = back * (Vector2::new(f64::from(u), f64::from(v)) - middle);
                (0.7 * grey(at.x, at.y) + 20.0).round() as u8
            })
            .collect()
    }

    fn template() -> Vec<u8> {
        let half = (SIDE / 2) as i32;
        let pixels = (-half..=half).flat_map(|v| (-half..=half).map(move |u| (u, v)));
        pixels
            .map(|(u, v)| grey(f64::from(u), f64::from(v)).round() as u8)
            .collect()
    }

    #[test]
    fn a_foreshortened_patch_is_found_to_a_twentieth_of_a_pixel() {
        for (map, start) in [
            (Matrix2::new(0.6, 0.1, 0.0, 1.0), Vector2::new(1.3, -1.1)),
            (Matrix2::new(1.0, -0.2, 0.3, 1.2), Vector2::new(-0.8, 1.6)),
        ] {
            let middle = Vector2::new(40.3, 31.7);
            let pixels = picture(&map, middle);
            let image = Image::new(&pixels, 80, 64).expect("80 x 64");
            let (place, score) =
                align_affine(&image, &template(), SIDE, middle + start).expect("converges");
            assert!((place - middle).norm() < 0.05, "{place}");
            assert!(score > 0.995, "{score}");
            let shift = crate::align::align(&image, &template(), SIDE, middle + start * 0.3);
            assert!((shift - middle).norm() > 2.0 * (place - middle).norm());
        }
    }

    #[test]
    fn nothing_comes_of_flat_templates_and_of_other_pictures() {
        let flat = [100_u8; SIDE * SIDE];
        let pixels = picture(&Matrix2::identity(), Vector2::new(40.0, 32.0));
        let image = Image::new(&pixels, 80, 64).expect("80 x 64");
        let found = align_affine(&image, &flat, SIDE, Vector2::new(40.0, 32.0));
        assert!(found.is_none_or(|(_, score)| score < 0.5));
        let empty = vec![90_u8; 80 * 64];
        let image = Image::new(&empty, 80, 64).expect("80 x 64");
        assert!(align_affine(&image, &template(), SIDE, Vector2::new(2.0, 60.0)).is_none());
    }
}
