//! The laboratory, command `sinew-lab`: the bench (speed against error, `bench`), the rivals (`bench peers`)
//! and the suite of hard cases (`bench stability`).

pub mod beam;
pub mod bench;
pub mod contact;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod peers;
pub mod report;
pub mod resection;
pub mod stability;
