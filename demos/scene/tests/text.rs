//! Numbers and hints in words.

use sinew_scene::error::hint;
use sinew_scene::text::{pressure, seconds, short};

#[test]
fn numbers_are_short() {
    let texts: Vec<String> = [0.0, 1.0, 1060.0, 0.012345, 1234.5678, 3.2e-9, 1e7].map(short).into();
    assert_eq!(texts, ["0", "1", "1060", "0.01235", "1235", "3.20e-9", "1.00e7"]);
    assert_eq!(pressure(5000.0), "5 kPa");
    assert_eq!(seconds(0.0166667), "16.7 ms");
    assert_eq!(seconds(125.0), "2 min 05 s");
}

#[test]
fn hints_name_the_nearest_or_all() {
    let keys = ["young_modulus", "poisson_ratio", "density"];
    assert_eq!(hint("key", "youngs_modulus", keys), "did you mean `young_modulus`?");
    assert_eq!(hint("key", "desnity", keys), "did you mean `density`?");
    assert_eq!(hint("group", "top", ["x0", "x1"]), "known: `x0`, `x1`");
    assert_eq!(hint("group", "top", []), "there is no group to choose from");
}
