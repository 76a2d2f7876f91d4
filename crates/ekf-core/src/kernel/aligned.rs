//! Numbers that begin where a cache line does: a vector that straddles two lines costs two loads.

use std::ops::{Deref, DerefMut};

/// Numbers in a cache line.
pub(crate) const LINE: usize = 8;

/// A buffer whose first number begins a cache line, or would if the allocator's block allowed it.
#[derive(Debug, Default)]
pub(crate) struct Aligned {
    data: Vec<f64>,
    skip: usize,
    len: usize,
}

impl Aligned {
    /// `len` zeros.
    pub(crate) fn zeros(len: usize) -> Self {
        let data = vec![0.0; len + LINE];
        let skip = data.as_ptr().align_offset(LINE * size_of::<f64>());
        let skip = if skip < LINE { skip } else { 0 };
        Self { data, skip, len }
    }

    /// Takes a new length; what the entries are is left open. Allocates only to grow.
    pub(crate) fn reshape(&mut self, len: usize) {
        if len + LINE > self.data.len() {
            *self = Self::zeros(len);
        }
        self.len = len;
    }
}

impl Clone for Aligned {
    fn clone(&self) -> Self {
        let mut copy = Self::zeros(self.len);
        copy.copy_from_slice(self);
        copy
    }
}

impl Deref for Aligned {
    type Target = [f64];
    #[inline]
    fn deref(&self) -> &[f64] {
        &self.data[self.skip..self.skip + self.len]
    }
}

impl DerefMut for Aligned {
    #[inline]
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.data[self.skip..self.skip + self.len]
    }
}
