//! The laboratory, command `sinew-lab`: the bench (speed against error, `bench`), the rivals (`bench peers`)
//! and the suite of hard cases (`bench stability`).

pub mod bench;
pub mod peers;
pub mod stability;
pub mod toolbox;
