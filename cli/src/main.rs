//! The `sinew` command.
fn main() {
    let files: Vec<std::path::PathBuf> = std::env::args().skip(1).map(Into::into).collect();
    if files.is_empty() {
        let suite = sinew_benches::stability::run(sinew_benches::stability::SuiteOptions {
            quick: false,
            integrator: Default::default(),
            precision: Default::default(),
        })
        .unwrap();
        println!("{suite}");
        return;
    }
    let r = sinew_demos::validate::validate(&files, &Default::default(), |r| {
        eprintln!("{} {}", r.case, r.law)
    })
    .unwrap();
    println!("{r}");
}
