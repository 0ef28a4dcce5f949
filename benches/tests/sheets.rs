//! Membranes in hard cases: wrinkled, collapsed, blown up.

#![allow(clippy::print_stdout, reason = "shown where a test fails")]

use sinew::models::sheet::MembraneModel;
use sinew::prelude::*;
use sinew_benches::sheets::{Collapse, SheetOptions, collapse, inflation_error, wrinkle};

#[test]
fn wrinkled_sheets_stay_bounded() {
    for fraction in [0.1, 0.3, 0.6] {
        let outcome = wrinkle(fraction, &SheetOptions::default()).unwrap();
        println!("{fraction}: {outcome:?}");
        assert!(outcome.is_bounded(), "{fraction}: {outcome:?}");
        // it left its plane instead of being crushed
        assert!(outcome.out_of_plane > 0.002, "{fraction}: {outcome:?}");
        assert!(outcome.steps[1] > 0, "{fraction}: {outcome:?}");
    }
}

#[test]
fn collapsed_sheets_recover() {
    for kind in [Collapse::Point, Collapse::Line] {
        for model in [MembraneModel::Biquadratic, MembraneModel::CompressibleBiquadratic] {
            let options = SheetOptions { model, ..SheetOptions::default() };
            let outcome = collapse(kind, &options).unwrap();
            println!("{kind:?} {model:?}: {outcome:?}");
            assert!(outcome.is_bounded(), "{kind:?} {model:?}: {outcome:?}");
            assert!(outcome.edge_error < 1e-3, "{kind:?} {model:?}: {outcome:?}");
        }
    }
}

#[test]
fn spheres_inflate_in_single_precision_too() {
    for stretch in [1.2, 2.0, 4.0] {
        let error = inflation_error(stretch, 8, Precision::F32).unwrap();
        println!("{stretch}: {error:e}");
        assert!(error < 5e-3, "{stretch}: {error:e}");
    }
}
