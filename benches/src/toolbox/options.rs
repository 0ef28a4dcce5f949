//! What a bench is asked for.

// no words on the type: the command would take them for its own
#[allow(missing_docs, reason = "its options say it")]
#[derive(clap::Args, Clone, Debug)]
pub struct BenchOptions {
    /// Smaller sizes and fewer repeats: a minute or two instead of a quarter of an hour.
    #[arg(long)]
    pub quick: bool,
    /// Sizes of the bodies in tetrahedra, such as 5000,50000, where a part has a choice.
    #[arg(long = "tets", value_name = "N", value_delimiter = ',')]
    pub sizes: Vec<usize>,
    /// Only this case of the accuracy part (`elements` and `elements-liver` are the kinds of elements), kind of contact, or of `peers`
    /// `beam`, `touch` or `bodies`; may be given several times.
    #[arg(long = "case", value_name = "NAME")]
    pub cases: Vec<String>,
    /// Python with the package `mujoco`.
    #[arg(long, value_name = "PATH", default_value = "python3")]
    pub python: String,
}
