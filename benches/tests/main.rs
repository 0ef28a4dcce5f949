//! All tests of the laboratory, one binary.

mod bar;
mod bench;
mod command;
mod elements;
mod hard_cases;
mod peers;
mod toolbox;
