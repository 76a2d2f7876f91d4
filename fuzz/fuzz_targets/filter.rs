//! libFuzzer on the filter's API.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Err(broken) = collabslam_fuzz::filter(bytes) {
        panic!("{broken}");
    }
});
