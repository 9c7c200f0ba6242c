//! The `manylight` command: reads the command line, runs one subcommand, maps failures to exit codes.

mod answer;
mod args;
mod check;
mod compare;
mod denoise;
mod error;
mod experiment;
mod fingerprint;
#[cfg(test)]
mod fuzz;
mod help;
mod interrupt;
mod job;
mod limits;
mod machine;
#[cfg(all(target_os = "linux", not(test)))]
mod memory;
mod merge;
mod output;
mod prepared;
mod progress;
mod render;
mod report;
mod state;
mod tev;
mod view;
mod write_scene;

use std::process::ExitCode;

use clap::Parser;
use clap::builder::styling::AnsiColor;

use args::{Arguments, Command};
use error::CliError;

#[cfg(all(target_os = "linux", not(test)))]
#[global_allocator]
static MEMORY: memory::LargePages = memory::LargePages;

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command {
        Command::Render(arguments) => render::run(&arguments),
        Command::View(arguments) => view::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Experiment(arguments) => experiment::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Scene(arguments) => write_scene::run(&arguments),
        Command::Config(arguments) => help::config(&arguments),
        Command::Completions(arguments) => help::completions(arguments.shell),
        Command::Man(arguments) => help::man(&arguments),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            match &error {
                // Asked for, and no error.
                CliError::Interrupted(message) => eprintln!("{message}"),
                // As clap writes its own: coloured on terminals alone, and not against NO_COLOR.
                _ => {
                    let style = AnsiColor::Red.on_default().bold();
                    anstream::eprintln!("{style}error:{style:#} {error}");
                }
            }
            ExitCode::from(error.exit_code())
        }
    }
}
