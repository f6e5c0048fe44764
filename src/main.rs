//! The `prosopon` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    prosopon::cli::run()
}
