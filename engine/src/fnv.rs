//! 64-bit FNV-1a, for hashes that are the same on every machine.

/// The hash of all words added so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fnv64(pub u64);

impl Default for Fnv64 {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv64 {
    /// Adds a word: a byte in the published function. With larger words, [`fold`](Self::fold) after each.
    pub fn add(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0000_0100_0000_01b3);
    }

    /// Adds the bits from `shift` on to the lowest ones, which they would never reach by multiplication.
    pub fn fold(&mut self, shift: u32) {
        self.0 ^= self.0 >> shift;
    }
}
