//! A string of bytes as damage to a snapshot.

use crate::Broken;
use crate::bytes::Bytes;
use crate::filter::Life;
use crate::sound::check_state;
use ekf_core::filter::snapshot::{open, seal};
use ekf_core::{Bearing, Filter, Measurements};

/// Entries of a P that any snapshot may make.
const SMALL: usize = 4096;

/// Plays the first bytes as a life of a filter, damages its snapshot as the others say, and reads that, with a checksum
/// that is right: it is refused, or makes a filter that can be used.
///
/// # Errors
/// The promise that was broken.
pub fn snapshot(bytes: &[u8]) -> Result<(), Broken> {
    let mut bytes = Bytes::new(bytes);
    let mut life = Life::new(&mut bytes);
    for _ in 0..bytes.below(8) {
        // Refused calls are the other target's business.
        let _ = life.call(&mut bytes);
    }
    let good = life.filter.snapshot();
    let mut body = open(&good).map_err(|e| e.to_string())?.to_vec();
    for _ in 0..=bytes.below(4) {
        damage(&mut body, &mut bytes);
    }
    let Ok(mut filter) = Filter::restore(&seal(&body)) else {
        return Ok(());
    };
    let rows = filter.state().mean().len();
    if rows * rows > 2 * body.len() + SMALL {
        return Err(format!("{} bytes made a filter of {rows} rows", body.len()));
    }
    check_state(&filter)?;
    let again = filter.snapshot();
    if Filter::restore(&again).map_or(true, |f| f.snapshot() != again) {
        return Err("what was read is not what is written".into());
    }
    // Numbers that no filter would come to may be refused; that they are used is all that is asked.
    let _ = filter.predict(filter.time().unwrap_or(0.0) + 0.05);
    let z = Measurements {
        bearings: filter
            .predict_pixels()
            .iter()
            .map(|f| Bearing { id: f.id, uv: f.uv })
            .collect(),
        ..Measurements::default()
    };
    let _ = filter.update(&z);
    filter.manage_map(&[]);
    Ok(())
}

/// Bytes changed, left out, doubled or cut off.
fn damage(body: &mut Vec<u8>, bytes: &mut Bytes<'_>) {
    let at = (bytes.below(256) * 256 + bytes.below(256)) % body.len().max(1);
    let end = (at + 1 + bytes.below(9)).min(body.len());
    match bytes.below(8) {
        0 => drop(body.drain(at..end)),
        1 => body.truncate(at),
        2 => body.splice(at..at, vec![0xff; end - at]).for_each(drop),
        3 | 4 => body[at..end].iter_mut().for_each(|b| *b = bytes.byte()),
        _ => {
            if let Some(byte) = body.get_mut(at) {
                *byte ^= 1 << bytes.below(8);
            }
        }
    }
}
