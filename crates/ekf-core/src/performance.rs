//! Why the filter is built as it is, with figures.
//!
//! Every figure is of `make bench`, which prints them and writes `results/bench.json`; those below are from a shared
//! two-core AVX2 machine (so only ratios taken in turns mean something). The unit is *the yardsticks*: dsyrk + dtrsm +
//! dpotrf of OpenBLAS, one thread, at the same `n` and `m`. `cargo bench -p collabslam-benches` times the parts.
//!
//! | figure | measured | aim |
//! |---|---|---|
//! | update, N = 100, m = 80, four features an anchor | 0.82 to 0.85 of the yardsticks | 1.0 |
//! | the same, an anchor for each feature | 1.47 to 1.55 | 1.0 |
//! | step (predict, pixels of all, HOHCT with 3 wrong of 40, update) | 1.17 to 1.21 of the yardsticks | 1.5 |
//! | HOHCT, 3 wrong of 40 | 0.18 to 0.19 of the update, N = 100, m = 80 | 0.3 |
//! | HOHCT, 10 wrong of 100 | 0.48 to 0.56 of the update, N = 100, m = 200 | 1.0 |
//! | local update, N = 400, 42 in view, against the plain one, both with the gauge transport | 0.199 | 0.2 |
//! | heap allocations of a warm step | 0 | 0 |
//! | a step through Python | 1.5 to 2.3 % more | 5 % |
//! | plain dense update | 6 times the yardsticks | |
//!
//! The update includes the gauge transport (`estimator.consistency`).
//!
//! # One triangle, in panels
//! P is dense: 100 features correlate with each other through the camera. What cannot be avoided is `V = P H^T L^-T`
//! and `P -= V V^T`. P keeps its lower triangle only, which halves memory traffic. `P H^T` is built in panels of 24
//! rows (a row of H touches 13 or 19 columns, so this is O(n m)), solved where it lies, and multiplied from both sides:
//! the panel is what a register tile reads, for both factors, so nothing is packed. [`pulp`] chooses AVX-512, AVX2,
//! NEON or plain code at run time; nothing is built for one machine, and every kernel is tested with and without SIMD.
//! Tiles are 2 vectors by 6 columns with 16 registers: 3 by 4 has the same number of sums but the compiler spilled one,
//! which cost a third of the speed. Closures inside of a kernel are not inlined into code with SIMD features, and
//! neither are iterators of other crates without LTO: kernels use index loops and inlined functions. No `unsafe`, the
//! crate forbids it, so that there is nothing for Miri to look at: slices become vectors through `pulp`, and bounds are
//! checked once per tile. Panels and columns of P begin cache lines; a vector over two lines costs two loads.
//!
//! # Gauge transport
//! It adds a product of eight columns to P, which the downdate's tiles take along: `P <- P - V V^T - X Y^T`, one pass,
//! a tenth more arithmetic. That needs `P B` after the update before P is written: `P B - V L^-1 H P B`, whose second
//! term comes from the same tiles as `V L^-1 g`. `P B` itself is one pass over the triangle. Only rows that follow the
//! view move, see [`gauge`](crate::gauge): what is out of view costs nothing. With an anchor for each feature P is 3 MB
//! in place of 1.7: the downdate is over half of that update, and the yardsticks have no `P H^T`, no S to gather, no
//! transport and no second linearisation.
//!
//! # Anchors once
//! Features born from one position have the same anchor, three of their six numbers, for ever: their rows of P are
//! equal. They are stored once. A map of the demo has 120 features and about 30 anchors: 463 rows in place of 733, 40 %
//! of the arithmetic. The state that is shown keeps six numbers a feature. The benches' maps have four features an
//! anchor; `update_single_anchor_ratio` is that of a map where every feature has its own.
//!
//! # The batch test
//! See [`validate`](crate::validate). HOHCT works on `S^-1`, formed only if the batch fails as a whole; leaving out `k`
//! matches is a `k x k` problem. `validate.max_nodes` bounds it (about 0.15 ms a node for 100 matches): of 4000 frames
//! of the benches, 10 of 100 wrong took 3 nodes in the median, 98 in 99 of 100, 674 and fewer in all but one, and
//! 15 104 in that one, some two seconds: there the level asks for four right matches to go besides the ten wrong ones,
//! and sets that exchange ten and more of the fourteen are what no bound refutes. More groups kept whole do not help
//! (tried up to 40). The default of 100 keeps the test within a frame's time: in one frame of a hundred of this kind the best
//! set so far stands, at least as good as the greedy one, and `exact` is false. Choices of groups count by their work:
//! where nearly half of the matches are wrong they took 40 ms that no budget knew of.
//! `make bench` takes 2400 more frames of this case: `hohct_struck`, `hohct_most_nodes`, `hohct_worst_ms`.
//!
//! # A warm step allocates nothing
//! Buffers live in the filter and only grow; `tests/rust/allocations.rs` counts.
//! [`Filter::update_into`](crate::Filter::update_into) and
//! [`Filter::predict_pixels_into`](crate::Filter::predict_pixels_into) return into lists of before. A birth writes its
//! rows into spare capacity, O(n). Any number of deletions is one compaction.
//!
//! # Features out of view
//! In a map of 150 features and more (see the module `local` in the source) the update works on what is in view and auxiliary rows for the rest.
//! Exact: the test of a walk with births, deletions, clones and wrong matches asserts 1e-8 standard deviations between
//! it and the plain filter. Which features outside may be in view is told from points of up to 32 frames ago, with a
//! margin: after a gross jump one may be predicted some frames late. The gauge transport works with it, as it moves
//! only what follows the view. When too many auxiliary rows have accumulated, every 70 frames or so of that walk, all of P is written,
//! a thirty-second of it in each frame (docs/long-trajectories.md has the times with 1000 features); more seldom makes the steps
//! between dearer. In the median a step costs 0.164 of the plain one. It is off by default:
//! the default map has 120 features, few of them out of view.
//!
//! # Python
//! Each call that works on the state releases the interpreter's lock. A step makes three calls; measured pixels are
//! copied once (some hundred numbers), results are built as numpy arrays without another copy. `predict_pixels` of 100
//! features takes 0.06 ms there.
