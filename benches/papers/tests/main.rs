//! Tests of the papers.

mod command;
mod outside;
mod springs;
mod verdicts;
