//! The bench (speed against error, `sinew bench` and `sinew advise`), the rivals and the suite of hard
//! cases (`sinew stability`).

pub mod advise;
pub mod beam;
pub mod bench;
pub mod peers;
pub mod resection;
pub mod stability;
