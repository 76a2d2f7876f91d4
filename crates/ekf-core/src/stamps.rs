//! Time stamps: which can be in seconds, and which may follow another one.

use crate::error::EkfError;

/// Largest time stamp, seconds: some thousand years; nanoseconds since 1970 are far beyond.
pub const LAST_TIME: f64 = 1e11;

/// Largest silence between two stamps of one source, seconds; beyond it they are taken to be wrong.
pub const LONGEST_GAP: f64 = 3600.0;

/// Whether a stamp can be in seconds.
pub(crate) fn is_sane(t: f64) -> bool {
    t.abs() <= LAST_TIME // NaN is not
}

/// Checks a stamp of `what`; `NonFinite` or `InvalidInput` if it cannot be in seconds.
pub(crate) fn check(what: &'static str, t: f64) -> Result<(), EkfError> {
    if !t.is_finite() {
        return Err(EkfError::NonFinite { what });
    }
    if !is_sane(t) {
        let why = format!("{t} s is not a time stamp in seconds; are these nanoseconds?");
        return Err(EkfError::InvalidInput { what, why });
    }
    Ok(())
}

/// Checks the stamp of a sample of `what` that follows another one; as [`check`], and `BadTime` or `LongGap`.
pub(crate) fn check_next(what: &'static str, t: f64, last: Option<f64>) -> Result<(), EkfError> {
    check(what, t)?;
    match last {
        Some(last) if t <= last => Err(EkfError::BadTime { t, last }),
        Some(last) if t - last > LONGEST_GAP => Err(EkfError::LongGap { t, last }),
        _ => Ok(()),
    }
}
