//! The short form of what `make reliability` does with the core.

use collabslam_fuzz::{drive, endurance};

#[test]
fn random_inputs_break_no_promise() {
    let tally = drive::inputs(8000, 3, 2);
    assert_eq!((tally.found, &tally.findings), (0, &Vec::new()));
    assert!(tally.refused > 500 && tally.calls > 10 * tally.refused / 2);
}

#[test]
fn a_filter_in_long_use_stays_sound_and_near_the_truth() {
    let endured = endurance::endure(3000, 5).expect("no promise is broken");
    assert!(endured.born > 20, "{endured:?}");
    assert!(endured.largest_error_m < 0.5, "{endured:?}");
    let again = endurance::endure(3000, 5).expect("no promise is broken");
    assert_eq!(endured.fingerprint, again.fingerprint);
}
