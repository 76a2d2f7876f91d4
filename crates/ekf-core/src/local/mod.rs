//! The exact local update (compressed filter): features outside of a working set are touched lazily.
//!
//! A step measures what is in view. Split the state at some time into the working set `A` (camera, features in view)
//! and the rest `B`. As long as only `A` moves and is measured, `B` follows `A` as it did then:
//!
//! ```text
//! P_AB = Phi R        P_BB = P_BB(then) - R^T Psi R        x_B = x_B(then) + R^T theta        R = P_AB(then)
//! ```
//!
//! `Phi <- F Phi` in a prediction, and in an update `Phi <- (I - K H) Phi`, `Psi += Phi^T H^T S^-1 H Phi`,
//! `theta += Phi^T H^T S^-1 g` (Guivant and Nebot, IEEE T-RA 2001). These are the very operations that the filter does
//! to a covariance: give the working state *auxiliary* rows with
//!
//! ```text
//!     [ P_AA   Phi  ]                     [ x_A   ]
//! M = [ Phi^T  -Psi ],   at first I, 0,   [ theta ],   at first 0
//! ```
//!
//! and the plain filter run on `M` keeps all three, with no code of its own: `A` gains and loses blocks as ever.
//!
//! *A feature `J` of `B` that comes into view* joins `A` alone. Its rows of `P(then)` become rows of `R`, copied as they
//! are, and it brings auxiliary rows of its own: what `P_JB = P_JB(then) - R_J^T Psi R` says are its rows
//! `[-R_J^T Psi, I]` of `Phi`, with `Psi = 0` for the new rows. That is O(n) a feature, where writing all of `P_BB` is
//! O(n^2).
//!
//! *When auxiliary rows have become too many* a new working set is chosen among what is inside. All of `P(then)` changes
//! with that, `n_B^2` entries times the number of auxiliary rows: too much for one frame. So [`OutsideSet::renew`] keeps
//! `R`, `Phi`, `Psi` and `P(then)` of before, [`OutsideSet::advance`] writes some rows of the new `P(then)` and the columns
//! of the new `R` in each frame, and what is asked for earlier, a feature that comes back meanwhile, is worked out for
//! itself, see [`renewal`].

mod assemble;
mod buffers;
mod enter;
mod image;
mod moved;
mod outside_set;
mod renewal;

pub(crate) use buffers::Buffers;
pub(crate) use image::OutsideSetImage;
pub(crate) use outside_set::{OutsideMark, OutsideSet};
