//! What pictures can show.

use serde::{Deserialize, Serialize};
use sinew_render::RenderError;
use sinew_render::colour::ColourMap;
use sinew_render::scene::Field;

/// What gives a body its colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// Length of the displacement (m).
    #[default]
    Displacement,
    /// Largest principal Green-Lagrange strain (-).
    Strain,
    /// Von Mises equivalent of the Cauchy stress (Pa) of St Venant-Kirchhoff with the moduli of the element,
    /// whatever the model.
    Stress,
    /// Energy density (J/m^3) of St Venant-Kirchhoff, likewise.
    Energy,
    /// Volume over that at rest (-), `J` in reports and VTU files; of membranes the area.
    #[serde(alias = "J")]
    Volume,
    /// Pressure (Pa) of tools and other bodies on the surface.
    Pressure,
    /// Distance (m) to where a run with a quarter of the step arrives; dynamic scenes without resections.
    Error,
    /// Plain colours, one for each body.
    None,
}

impl Quantity {
    /// All that any run gives.
    pub const ALL: [Self; 5] =
        [Self::Displacement, Self::Strain, Self::Stress, Self::Energy, Self::Volume];

    /// The field of recordings, without its range; `None` for plain colours.
    pub(crate) fn field(self) -> Option<Field> {
        let (name, label, unit, map) = match self {
            Self::Displacement => ("displacement", "displacement", "m", ColourMap::Viridis),
            Self::Strain => ("strain", "principal strain", "", ColourMap::Ember),
            Self::Stress => ("stress", "von Mises stress", "Pa", ColourMap::Ember),
            Self::Energy => ("energy", "energy density", "J/m³", ColourMap::Ember),
            Self::Volume => ("volume", "volume ratio J", "", ColourMap::Diverging),
            Self::Pressure => ("pressure", "contact pressure", "Pa", ColourMap::Ember),
            Self::Error => ("error", "error of the step", "m", ColourMap::Ember),
            Self::None => return None,
        };
        let (name, label, unit) = (name.into(), label.into(), unit.into());
        Some(Field { name, label, unit, map, range: [0.0, 1.0] })
    }

    /// Place among the measures of elements; `None` for those of vertices.
    pub(crate) fn index(self) -> Option<usize> {
        match self {
            Self::Strain => Some(0),
            Self::Stress => Some(1),
            Self::Energy => Some(2),
            Self::Volume => Some(3),
            Self::Displacement | Self::Pressure | Self::Error | Self::None => None,
        }
    }
}

impl std::str::FromStr for Quantity {
    type Err = RenderError;

    fn from_str(text: &str) -> Result<Self, RenderError> {
        // as reports and frames call it
        let text = if text == "J" { "volume" } else { text };
        serde_json::from_value(text.into()).map_err(|_| RenderError::Option {
            option: "--color",
            found: text.into(),
            remedy:
                "choose of displacement, strain, stress, energy, volume (J), pressure, error, none"
                    .into(),
        })
    }
}
