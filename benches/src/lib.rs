//! The bench (speed against error, `sinew bench` and `sinew advise`), the rivals and the suite of hard
//! cases (`sinew bench stability`), and the figures of a paper made again (`sinew reproduce`).

pub mod advise;
pub mod beam;
pub mod bench;
pub mod peers;
pub mod reproduce;
pub mod resection;
pub mod stability;
