//! libFuzzer on the camera models and the overlap of two views.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Err(broken) = collabslam_fuzz::camera(bytes) {
        panic!("{broken}");
    }
});
