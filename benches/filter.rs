//! Parts of a filter step at N features and m rows: `cargo bench -p collabslam-benches`.

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use ekf_core::settings::Value;
use ekf_core::{Bearing, Camera, DepthObservation, Filter, Measurements, Settings};
use nalgebra::Vector2;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// A filter of `n` features with known depth, and measurements of `seen` of them half a pixel off.
fn filter_with(n: usize, seen: usize) -> (Filter, Measurements) {
    let camera = Camera::new("pinhole", 720, 480, [600.0, 600.0, 360.0, 240.0], &[])
        .expect("valid calibration");
    let mut settings = Settings::default();
    settings
        .set("map.max_features", &Value::Int(n as i64))
        .expect("valid setting");
    let mut rng = Pcg64::seed_from_u64(1);
    let mut filter = Filter::new(settings, camera, None);
    let depths = (0..n)
        .map(|_| DepthObservation {
            id: None,
            uv: Vector2::new(rng.random_range(20.0..700.0), rng.random_range(20.0..460.0)),
            depth: rng.random_range(2.0..8.0),
            sigma: 0.3,
        })
        .collect();
    filter.predict(0.0).expect("first stamp");
    let births = Measurements {
        depths,
        ..Measurements::default()
    };
    filter.update(&births).expect("valid depths");
    filter.predict(0.02).expect("later stamp");
    let bearings: Vec<Bearing> = filter
        .predict_pixels()
        .iter()
        .take(seen)
        .map(|f| Bearing {
            id: f.id,
            uv: f.uv + Vector2::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5)),
        })
        .collect();
    let measurements = Measurements {
        searched: bearings.iter().map(|b| b.id).collect(),
        bearings,
        ..Measurements::default()
    };
    (filter, measurements)
}

fn parts_of_a_step(c: &mut Criterion) {
    for n in [25, 50, 100, 200] {
        let (filter, measurements) = filter_with(n, 40.min(n));
        let mut group = c.benchmark_group(format!("N={n}"));
        group.sample_size(20);
        group.bench_function(BenchmarkId::new("predict", n), |b| {
            b.iter_batched_ref(
                || filter.clone(),
                |f| f.predict(0.04).expect("later stamp"),
                BatchSize::LargeInput,
            );
        });
        group.bench_function(BenchmarkId::new("predict_pixels", n), |b| {
            b.iter(|| filter.predict_pixels());
        });
        group.bench_function(
            BenchmarkId::new("update", 2 * measurements.bearings.len()),
            |b| {
                b.iter_batched_ref(
                    || filter.clone(),
                    |f| f.update(&measurements).expect("valid measurements"),
                    BatchSize::LargeInput,
                );
            },
        );
        group.finish();
    }
}

criterion_group!(benches, parts_of_a_step);
criterion_main!(benches);
