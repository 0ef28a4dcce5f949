//! Number type of a world's state, chosen once, when the engine is installed.

use crate::scalar::{Scalar, Single};
use bevy_ecs::prelude::Resource;
use serde::{Deserialize, Serialize};

/// Number type of the state. [`install_engine`](crate::step::install_engine) puts it into the world;
/// bodies and steps take it from there.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Precision {
    /// 64-bit (default).
    #[default]
    F64,
    /// 32-bit: about 5e-6 relative force error at any strain.
    F32,
}

impl Precision {
    /// That of a number type.
    pub fn of<S: Scalar>() -> Self {
        if size_of::<S>() == size_of::<f64>() { Self::F64 } else { Self::F32 }
    }

    /// Whether worlds of it can be: in WebAssembly there is double precision alone ([`Single`]).
    pub fn is_built(self) -> bool {
        self == Self::F64 || size_of::<Single>() == size_of::<f32>()
    }

    /// `"f32"` or `"f64"`.
    pub fn name(self) -> &'static str {
        match self {
            Self::F64 => f64::NAME,
            Self::F32 => f32::NAME,
        }
    }
}

/// Calls the generic `$function` for the number type of a [`Precision`](crate::precision::Precision).
#[macro_export]
macro_rules! by_precision {
    ($precision:expr, $function:ident ( $($argument:expr),* $(,)? )) => {
        match $precision {
            $crate::precision::Precision::F64 => $function::<f64>($($argument),*),
            $crate::precision::Precision::F32 => $function::<$crate::scalar::Single>($($argument),*),
        }
    };
}
