//! Advice, fits and sweeps. In one binary: each would link, and in part compile, everything below for itself.

mod advise;
mod claim;
mod cuts;
mod fit;
mod fit_data;
mod gradient;
mod machine;
mod measures;
mod page;
mod parameter;
mod parquet;
mod plot;
mod record;
mod sampling;
mod statistics;
mod table;
