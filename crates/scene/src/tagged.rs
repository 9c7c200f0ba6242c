//! Keys of three numbers to sort by.

/// Three numbers and whose they are, ordered by the numbers, then by whose: one integer, which sorts sooner than an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Tagged(u128);

impl Tagged {
    pub(crate) fn new([a, b, c]: [u32; 3], tag: u32) -> Self {
        let high = u64::from(a) << 32 | u64::from(b);
        let low = u64::from(c) << 32 | u64::from(tag);
        Self(u128::from(high) << 64 | u128::from(low))
    }

    /// The three numbers, as one.
    pub(crate) fn key(self) -> u128 {
        self.0 >> 32
    }

    /// Whose they are.
    pub(crate) fn tag(self) -> u32 {
        self.0 as u32
    }
}
