//! Names of runs and checksums.

/// FNV-1a of 128 bits over parts, each with its length, so that no two lists of parts read alike.
#[derive(Clone, Copy, Debug)]
pub struct Hash(u128);

impl Hash {
    /// Of nothing.
    pub fn new() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }

    /// With one part more.
    #[must_use]
    pub fn and(self, part: impl AsRef<[u8]>) -> Self {
        let part = part.as_ref();
        let length = (part.len() as u64).to_le_bytes();
        let bytes = length.iter().chain(part);
        let next = |hash: u128, byte: &u8| {
            (hash ^ u128::from(*byte)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b)
        };
        Self(bytes.fold(self.0, next))
    }

    /// Of one part.
    pub fn of(part: impl AsRef<[u8]>) -> Self {
        Self::new().and(part)
    }

    /// 32 digits.
    pub fn text(self) -> String {
        format!("{:032x}", self.0)
    }

    /// 16 digits, for lines.
    pub fn short(self) -> String {
        format!("{:016x}", (self.0 >> 64) as u64 ^ self.0 as u64)
    }
}
