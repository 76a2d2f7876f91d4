//! Numbers out of a string of bytes: plausible ones, and ones that should hurt.

/// Values at which arithmetic goes wrong.
const NASTY: [f64; 14] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN_POSITIVE,
    5e-324,
    0.0,
    -0.0,
    -1.0,
    1e300,
    -1e150,
    1e18,
    1e-160,
    1e9,
];

/// Reads a string of bytes; past its end all bytes are 0.
pub(crate) struct Bytes<'a> {
    rest: &'a [u8],
    /// Whether nasty numbers may come.
    pub(crate) rough: bool,
}

impl<'a> Bytes<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self {
            rest: bytes,
            rough: false,
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    pub(crate) fn byte(&mut self) -> u8 {
        match self.rest.split_first() {
            Some((&first, rest)) => {
                self.rest = rest;
                first
            }
            None => 0,
        }
    }

    /// 0 to `n - 1`.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        usize::from(self.byte()) % n.max(1)
    }

    pub(crate) fn coin(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    /// -1 to 1.
    pub(crate) fn signed(&mut self) -> f64 {
        f64::from(self.byte()) / 127.5 - 1.0
    }

    /// `value`, or with rough input in 1 of 32 cases something nasty.
    pub(crate) fn or_nasty(&mut self, value: f64) -> f64 {
        if !self.rough {
            return value;
        }
        let byte = self.byte();
        if byte >= 8 {
            return value;
        }
        match self.below(NASTY.len() + 2) {
            k if k < NASTY.len() => NASTY[k],
            k if k == NASTY.len() => value * 1e6,
            _ => f64::from_bits(u64::from_le_bytes(std::array::from_fn(|_| self.byte()))),
        }
    }

    /// `value + spread * signed`, or something nasty.
    pub(crate) fn near(&mut self, value: f64, spread: f64) -> f64 {
        let offset = self.signed() * spread;
        self.or_nasty(value + offset)
    }
}
