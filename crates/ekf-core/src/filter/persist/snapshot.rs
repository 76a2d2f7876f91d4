//! A filter as bytes, and back: every bit of it, so that the filter restored goes on as the one saved would have.
//!
//! ```text
//! magic "CSLAMEKF" | version u32 | length of body u64 | body | SHA-256 of all before     (little endian)
//! ```
//!
//! The body lists every field, in the compact format of `postcard`: f64 as they are, bit for bit. What only
//! serves speed (buffers, spare room) is left out. Bytes that are cut short, altered, or of another version give an
//! error; so does a body that makes no filter (dimensions that disagree, ids twice, numbers that are not finite), even
//! with a right checksum: reading never panics, and takes no more memory than a small multiple of the bytes given.

use crate::error::EkfError;
use sha2::{Digest, Sha256};

const MAGIC: &[u8; 8] = b"CSLAMEKF";

/// Counts the changes of what a body holds.
pub const VERSION: u32 = 25;

const HEAD: usize = MAGIC.len() + 4 + 8;

const CHECKSUM: usize = 32;

/// Puts head and checksum around a body: what a test or a fuzzer needs to get an altered body past the checksum.
pub fn seal(body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD + body.len() + CHECKSUM);
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&(body.len() as u64).to_le_bytes());
    bytes.extend_from_slice(body);
    let sum = Sha256::digest(&bytes);
    bytes.extend_from_slice(&sum);
    bytes
}

/// The body of sealed bytes.
///
/// # Errors
/// `BadSnapshot` if they are not what [`seal`] made.
pub fn open(bytes: &[u8]) -> Result<&[u8], EkfError> {
    let Some((head, rest)) = bytes.split_at_checked(HEAD) else {
        return Err(EkfError::bad_snapshot("it is cut short"));
    };
    let (magic, head) = head.split_at(MAGIC.len());
    if magic != MAGIC {
        return Err(EkfError::bad_snapshot("it is not a snapshot of a filter"));
    }
    let (version, length) = head.split_at(4);
    let version = u32::from_le_bytes(version.try_into().expect("4 bytes"));
    if version != VERSION {
        return Err(EkfError::bad_snapshot(format!(
            "it has version {version}, this program reads version {VERSION}; use the program that wrote it"
        )));
    }
    let length = u64::from_le_bytes(length.try_into().expect("8 bytes"));
    if length.checked_add(CHECKSUM as u64) != Some(rest.len() as u64) {
        return Err(EkfError::bad_snapshot(
            "it is cut short, or has bytes too many",
        ));
    }
    let (body, sum) = rest.split_at(rest.len() - CHECKSUM);
    if Sha256::digest(&bytes[..bytes.len() - CHECKSUM]).as_slice() != sum {
        return Err(EkfError::bad_snapshot(
            "its checksum is wrong: the bytes were altered",
        ));
    }
    Ok(body)
}
