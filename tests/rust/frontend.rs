//! Patches: correlation against its formula, sub-pixel alignment and warps against analytic images, and no panic
//! whatever the windows.

use ekf_core::Camera;
use frontend::search::{Expected, Options, SearchOutcome, search};
use frontend::{Image, align, warp};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

const SIDE: usize = 15;
/// Where few features are left.
const SCARCE: Options = Options {
    scarce: true,
    ..OPTIONS
};
const OPTIONS: Options = Options {
    gate: 3.0,
    min_radius: 2.5,
    large_radius: 16.0,
    max_radius: 48.0,
    guess_radius: 6.0,
    guess_gate: 1.5,
    min_score: 0.78,
    scarce: false,
    ambiguity: 0.94,
    peak_distance: 3.0,
    min_deviation: 4.0,
    whole: true,
};

/// A smooth image without symmetry, shifted by `(du, dv)`.
fn waves(width: usize, height: usize, du: f64, dv: f64) -> Vec<u8> {
    let value = |x: f64, y: f64| {
        let (x, y) = (x - du, y - dv);
        128.0
            + 50.0 * (0.31 * x + 0.11 * y).sin()
            + 40.0 * (0.23 * y - 0.07 * x + 0.002 * x * y).cos()
            + 20.0 * (0.013 * x * x).sin()
    };
    (0..height)
        .flat_map(|y| (0..width).map(move |x| value(x as f64, y as f64).round() as u8))
        .collect()
}

fn cut(image: &[u8], width: usize, u: usize, v: usize) -> Vec<u8> {
    let rows = v - SIDE / 2..=v + SIDE / 2;
    rows.flat_map(|y| image[y * width + u - SIDE / 2..][..SIDE].to_vec())
        .collect()
}

fn expected(u: f64, v: f64, sd: f64) -> Expected {
    Expected {
        uv: Vector2::new(u, v),
        s: Matrix2::from_diagonal_element(sd * sd),
        guess: Vector2::repeat(f64::NAN),
    }
}

#[test]
fn a_template_is_found_where_it_was_cut() {
    let pixels = waves(120, 90, 0.0, 0.0);
    let image = Image::new(&pixels, 120, 90).expect("the sizes fit");
    let template = cut(&pixels, 120, 50, 40);
    let found = search(
        &image,
        &template,
        SIDE,
        &[expected(54.0, 37.0, 2.0)],
        &OPTIONS,
    );
    assert_eq!(found[0].outcome, SearchOutcome::Found);
    assert!((found[0].score - 1.0).abs() < 1e-6);
    assert!((found[0].uv - Vector2::new(50.0, 40.0)).norm() < 1e-3);
    // Out of the ellipse, and out of the image.
    let far = search(
        &image,
        &template,
        SIDE,
        &[expected(70.0, 40.0, 2.0)],
        &OPTIONS,
    );
    let radius = (OPTIONS.gate * 2.0).hypot(OPTIONS.min_radius) + 2.0; // one by the peak's surface, one by the alignment
    let away = (far[0].uv - Vector2::new(70.0, 40.0)).norm();
    assert!(
        away.is_nan() || away <= radius,
        "{away} px from the ellipse's middle"
    );
    let outside = search(
        &image,
        &template,
        SIDE,
        &[expected(-40.0, 40.0, 2.0)],
        &OPTIONS,
    );
    assert_eq!(outside[0].outcome, SearchOutcome::Outside);
}

#[test]
fn the_score_is_the_correlation() {
    let (pixels, other) = (waves(80, 80, 0.0, 0.0), waves(80, 80, 3.4, 1.2));
    let image = Image::new(&pixels, 80, 80).expect("the sizes fit");
    let template = cut(&other, 80, 40, 40);
    let options = Options {
        min_score: 2.0,
        ..OPTIONS
    }; // no alignment: the place stays near the best pixel
    let found = search(
        &image,
        &template,
        SIDE,
        &[expected(37.0, 39.0, 2.0)],
        &options,
    )[0];
    let window = cut(
        &pixels,
        80,
        found.uv.x.round() as usize,
        found.uv.y.round() as usize,
    );
    let mean = |x: &[u8]| x.iter().map(|&p| f64::from(p)).sum::<f64>() / x.len() as f64;
    let (m, n) = (mean(&template), mean(&window));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        template
            .iter()
            .zip(&window)
            .map(|(&a, &b)| f(f64::from(a) - m, f64::from(b) - n))
            .sum()
    };
    let score = sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt();
    assert!(
        (found.score - score).abs() < 1e-5,
        "{} against {score}",
        found.score
    );
}

/// An image with noise of its own on each pixel, evenly spread over `+-reach`.
fn noisy(pixels: &[u8], reach: f64, mut seed: u64) -> Vec<u8> {
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    let with = |p: &u8| f64::from(*p) + reach * (2.0 * next() - 1.0);
    pixels.iter().map(with).map(|p| p.round() as u8).collect()
}

#[test]
fn a_weak_texture_is_found_in_noise() {
    // Grey levels of sd 7 or so, and noise of sd 5: the same place correlates by 0.6, no more.
    let faint = |p: &u8| (128.0 + (f64::from(*p) - 128.0) / 7.0).round() as u8;
    let clean: Vec<u8> = waves(120, 90, 0.0, 0.0).iter().map(faint).collect();
    let (first, second) = (noisy(&clean, 8.5, 1), noisy(&clean, 8.5, 2));
    let image = Image::new(&second, 120, 90).expect("the sizes fit");
    let (mut found, mut wrong, mut few, mut tried) = (0, 0, 0, 0);
    for (u, v) in (12..108)
        .step_by(8)
        .flat_map(|u| (12..78).step_by(8).map(move |v| (u, v)))
    {
        let expected = [expected(u as f64 + 1.0, v as f64 - 1.0, 2.0)];
        let template = cut(&first, 120, u, v);
        let one = search(&image, &template, SIDE, &expected, &SCARCE)[0];
        let strict = search(&image, &template, SIDE, &expected, &OPTIONS)[0];
        few += usize::from(strict.outcome == SearchOutcome::Found);
        tried += 1;
        if one.outcome == SearchOutcome::Found {
            let off = (one.uv - Vector2::new(u as f64, v as f64)).norm();
            if off < 2.0 { found += 1 } else { wrong += 1 }
        }
    }
    assert!(
        found >= 95 && wrong == 0,
        "{found} found, {wrong} wrong of {tried}"
    );
    assert!(few < 10, "{few} of {tried} where enough are left");
}

#[test]
fn noise_alone_is_not_found() {
    let flat = vec![128; 120 * 90];
    let (first, second) = (noisy(&flat, 12.0, 3), noisy(&flat, 12.0, 4));
    let image = Image::new(&second, 120, 90).expect("the sizes fit");
    for u in (20..100).step_by(5) {
        let template = cut(&first, 120, u, 45);
        let found = search(
            &image,
            &template,
            SIDE,
            &[expected(u as f64, 45.0, 8.0)],
            &SCARCE,
        );
        assert_eq!(
            found[0].outcome,
            SearchOutcome::LowScore,
            "{}",
            found[0].score
        );
    }
}

#[test]
fn alignment_is_sub_pixel() {
    let before = waves(80, 80, 0.0, 0.0);
    let template = cut(&before, 80, 40, 40);
    for (du, dv) in [(0.3, -0.4), (-0.45, 0.1), (0.0, 0.0)] {
        let pixels = waves(80, 80, du, dv);
        let image = Image::new(&pixels, 80, 80).expect("the sizes fit");
        let found = align::align(&image, &template, SIDE, Vector2::repeat(40.0));
        let error = found - Vector2::new(40.0 + du, 40.0 + dv);
        assert!(
            error.norm() < 0.03,
            "off by {error} at a shift of {du}, {dv}"
        );
    }
}

#[test]
fn a_warp_follows_the_view() {
    let camera =
        Camera::new("pinhole", 640, 480, [500.0, 500.0, 319.5, 239.5], &[]).expect("a camera");
    let middle = Vector2::new(319.5, 239.5);
    let towards = Vector3::new(0.0, 0.0, -0.5); // half a metre nearer, of two
    let warp = warp::affine_map(
        &camera,
        middle,
        &camera,
        (&Matrix3::identity(), &towards),
        0.5,
    );
    let affine = warp.affine.expect("in front");
    assert!((affine - Matrix2::from_diagonal_element(2.0 / 1.5)).norm() < 1e-9);
    let behind = Vector3::new(0.0, 0.0, -3.0);
    let gone = warp::affine_map(
        &camera,
        middle,
        &camera,
        (&Matrix3::identity(), &behind),
        0.5,
    );
    assert!(gone.uv.is_none() && gone.affine.is_none());
    // Infinitely far only the rotation counts.
    let far = warp::affine_map(
        &camera,
        middle,
        &camera,
        (&Matrix3::identity(), &behind),
        f64::NAN,
    );
    assert!((far.affine.expect("in front") - Matrix2::identity()).norm() < 1e-9);
}

#[test]
fn samples_follow_the_map() {
    let pixels: Vec<u8> = (0..60 * 50).map(|i| (3 * (i % 60)) as u8).collect(); // 3 grey levels a column
    let image = Image::new(&pixels, 60, 50).expect("the sizes fit");
    let centre = Vector2::new(30.25, 20.0);
    for scale in [2.0, 1.0, 0.5] {
        let mut out = Vec::new();
        let map = Matrix2::from_diagonal_element(scale);
        let reach = warp::sample(&image, centre, &map, SIDE, &mut out).expect("an inverse");
        assert!((reach - Vector2::repeat(7.0 / scale)).norm() < 1e-9);
        for (i, &value) in out.iter().enumerate() {
            let exact = 3.0 * (centre.x + ((i % SIDE) as f64 - 7.0) / scale);
            assert!(
                (f64::from(value) - exact).abs() <= 0.5 + 1e-9,
                "{value} for {exact}"
            );
        }
    }
    assert!(warp::sample(&image, centre, &Matrix2::zeros(), SIDE, &mut Vec::new()).is_none());
}

#[test]
fn no_window_panics() {
    let mut state = 1_u64;
    let mut random = |range: f64| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 * range
    };
    for (width, height) in [(15, 15), (16, 40), (17, 17), (40, 18), (90, 5), (1, 1)] {
        let pixels: Vec<u8> = (0..width * height).map(|_| random(256.0) as u8).collect();
        let image = Image::new(&pixels, width, height).expect("the sizes fit");
        let templates: Vec<u8> = (0..400 * SIDE * SIDE)
            .map(|_| random(256.0) as u8)
            .collect();
        let places: Vec<Expected> = (0..400)
            .map(|i| {
                let (a, b, c) = (random(40.0), random(1.9) - 0.95, random(40.0));
                let s = Matrix2::new(a * a, a * b * c, a * b * c, c * c);
                let mut place = expected(random(150.0) - 30.0, random(90.0) - 30.0, 0.0);
                place.s = if i % 50 == 0 { -s } else { s };
                if i % 3 == 0 {
                    place.guess = Vector2::new(random(200.0) - 50.0, random(200.0) - 50.0);
                }
                place
            })
            .collect();
        for found in search(&image, &templates, SIDE, &places, &OPTIONS) {
            assert!(
                found.outcome != SearchOutcome::Found || found.uv.iter().all(|x| x.is_finite())
            );
        }
        let anywhere = Vector2::new(random(400.0) - 200.0, random(400.0) - 200.0);
        align::align(&image, &templates[..SIDE * SIDE], SIDE, anywhere);
        let mut out = Vec::new();
        warp::sample(&image, anywhere, &Matrix2::identity(), SIDE, &mut out);
        assert_eq!(out.len(), SIDE * SIDE);
    }
    assert!(Image::new(&[0; 6], 2, 2).is_none() && Image::new(&[], 0, 5).is_none());
}
