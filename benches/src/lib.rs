//! The bench (speed against error, `sinew bench` and `sinew advise`), the rivals and the suite of hard
//! cases (`sinew bench stability`), the figures of papers made again (`sinew reproduce`), and springs
//! identified for a mesh (`sinew fit`).

pub mod advise;
pub mod beam;
pub mod bench;
pub mod fit;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod peers;
pub mod reproduce;
pub mod resection;
pub mod stability;
