//! libFuzzer on the reader of snapshots.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Err(broken) = collabslam_fuzz::snapshot(bytes) {
        panic!("{broken}");
    }
});
