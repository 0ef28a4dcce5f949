//! The `sinew` command.
fn main() {
    let quick = std::env::args().any(|a| a == "--quick");
    let suite = sinew_benches::stability::run(sinew_benches::stability::SuiteOptions {
        quick,
        integrator: if std::env::var("NEWTON").is_ok() { sinew::prelude::Integrator::Newton } else { Default::default() },
        precision: Default::default(),
    })
    .unwrap();
    println!("{suite}");
}
