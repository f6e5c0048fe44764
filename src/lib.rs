//! The program: the commands of `prosopon`.

pub mod cli;
pub mod demo;
