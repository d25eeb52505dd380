//! The `kiln` program; see the library for everything it does.

fn main() -> std::process::ExitCode {
    kiln::cli::main()
}
