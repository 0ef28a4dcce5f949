//! Threads and clips.

use serde::{Deserialize, Serialize};

/// A thread through tissue.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThreadEntry {
    /// Name, unique among threads.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Names of the bodies, one for each point, in place of `body`.
    pub bodies: Option<Vec<String>>,
    /// `[x, y, z]` (m) at rest of the points of tissue that it goes through, in order.
    #[serde(default)]
    pub points: Vec<[f64; 3]>,
    /// Name of the tool whose needle draws it: what that has passed are further points. Dynamic scenes.
    pub needle: Option<String>,
    /// `[x, y, z]` (m): a hand that holds its last end.
    pub hand: Option<[f64; 3]>,
    /// `[time (s), x, y, z (m)]`: the same hand, moving, linear between. Dynamic scenes.
    pub path: Option<Vec<[f64; 4]>>,
    /// Stiffness `EA` (N).
    pub stiffness: f64,
    /// Free length (m) between its ends; without, what lies there when it is laid.
    pub length: Option<f64>,
    /// Coefficient of friction at the points between its ends; default 0.
    pub friction: Option<f64>,
    /// Force (N) that such a point holds whatever the tension; default 0.
    pub grip: Option<f64>,
    /// Length (m) beyond its first and its last point; 0, the default, for a knot.
    pub tails: Option<[f64; 2]>,
    /// `[time (s), length (m)]` that is drawn past its last point, linear between. Dynamic scenes.
    pub drawn: Option<Vec<[f64; 2]>>,
    /// Time (s) from which its first tail is held. Dynamic scenes.
    pub held: Option<f64>,
    /// Time (s) at which its ends are tied together, once two points hold it. Dynamic scenes.
    pub tied: Option<f64>,
    /// Time (s) from which it holds. Dynamic scenes.
    pub from: Option<f64>,
    /// Time (s) after which it is taken out. Dynamic scenes.
    pub until: Option<f64>,
}

/// A clip, staple or knot that draws two points of tissue together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipEntry {
    /// Name, unique among clips.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Names of the bodies, one for each point, in place of `body`.
    pub bodies: Option<Vec<String>>,
    /// `[x, y, z]` (m) at rest of its two points of tissue.
    pub points: [[f64; 3]; 2],
    /// Stiffness (N/m).
    pub stiffness: f64,
    /// Length (m) up to which it does not pull; default 0.
    pub length: Option<f64>,
    /// Force (N) above which it breaks; without, it does not.
    pub strength: Option<f64>,
    /// Time (s) from which it holds. Dynamic scenes.
    pub from: Option<f64>,
    /// Time (s) after which it is taken out. Dynamic scenes.
    pub until: Option<f64>,
}
