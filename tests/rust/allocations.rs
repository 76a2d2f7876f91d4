//! A warm step takes nothing from the heap, as an allocator that counts shows.

#![allow(clippy::unwrap_used, reason = "a test may panic")]
#![allow(clippy::print_stdout, reason = "a test may show its figures")]
#![allow(
    unsafe_code,
    reason = "an allocator is an unsafe trait; all work is the system's"
)]

use ekf_core::{
    Bearing, Camera, DepthObservation, Filter, MeasurementOutcome, Measurements, Settings,
    UpdateReport,
};
use nalgebra::{Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// 100 points before a camera that drifts sideways, 40 of them measured in turn, up to three matches wrong.
#[test]
fn a_warm_step_allocates_nothing() {
    let camera =
        Camera::new("pinhole", 720, 480, [600.0, 600.0, 360.0, 240.0], &[]).expect("calibration");
    let mut rng = Pcg64::seed_from_u64(3);
    let points: Vec<Vector3<f64>> = (0..100)
        .map(|_| {
            let z = rng.random_range(2.0..8.0);
            let (x, y) = (rng.random_range(-0.5..0.5), rng.random_range(-0.3..0.3));
            Vector3::new(x * z, y * z, z)
        })
        .collect();
    let mut filter = Filter::new(Settings::default(), camera.clone(), None);
    let position = |frame: usize| Vector3::new(0.1 * (0.05 * frame as f64).sin(), 0.0, 0.0);
    let pixel = |frame: usize, point: usize| {
        let seen = points[point] - position(frame);
        camera.project(&seen).expect("in front")
    };
    filter.predict(0.0).unwrap();
    let births = (0..100).map(|i| DepthObservation {
        id: None,
        uv: pixel(0, i),
        depth: points[i].z,
        sigma: 0.02 * points[i].z,
    });
    let births = Measurements {
        depths: births.collect(),
        ..Measurements::default()
    };
    let report = filter.update(&births).unwrap();
    let ids = report.depths.iter().map(|o| match o {
        MeasurementOutcome::Born(id) => *id,
        other => panic!("{other:?}"),
    });
    let ids: Vec<u64> = ids.collect();
    let (mut report, mut seen) = (UpdateReport::default(), Vec::new());
    let (mut counted, mut wrong_out) = (0, 0);
    for frame in 1..400 {
        let chosen: Vec<usize> = (0..40).map(|k| (frame * 7 + k * 2) % 100).collect();
        let mut z = Measurements::default();
        for &point in &chosen {
            let noise = Vector2::from_fn(|_, _| rng.random_range(-1.5..1.5));
            let (id, uv) = (ids[point], pixel(frame, point) + noise);
            z.searched.push(id);
            z.bearings.push(Bearing { id, uv });
        }
        for k in 0..frame % 4 {
            z.bearings[11 * k].uv.y += 9.0;
        }
        let before = COUNT.get();
        filter.predict(frame as f64 / 30.0).unwrap();
        filter.predict_pixels_into(&mut seen);
        filter.update_into(&z, &mut report).unwrap();
        if frame >= 200 {
            counted += COUNT.get() - before;
            wrong_out += report.order;
        }
    }
    assert!(COUNT.get() > 0, "the counter counts");
    println!("warm_step_allocations {counted}");
    assert!(wrong_out > 50, "the batch test had work to do: {wrong_out}");
    assert_eq!(counted, 0);
}
