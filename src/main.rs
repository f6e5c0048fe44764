//! Entry point of the `prosopon` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    prosopon::cli::run()
}
