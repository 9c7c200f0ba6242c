//! What the program says about itself: examples, completions, man pages and annotated files.

use clap::CommandFactory;
use clap::builder::PossibleValue;
use clap_complete::Shell;
use clap_mangen::Man;
use gather::MethodSpec;

use crate::answer::Answer;
use crate::args::{Arguments, ConfigArgs, FileKind, ManArgs};
use crate::error::CliError;
use crate::output::check_folder;

/// Examples of each command, for its help. Every line that is indented is a command line that a test reads.
pub(crate) mod examples {
    pub(crate) const ALL: &str = "\
Begin with a built-in scene:
  manylight scene nave --out nave
  manylight config run > nave/run.ron
  manylight render nave/run.ron --size 480x270 --spp 8

`manylight COMMAND --help` has examples of each command.
`manylight config run` prints a run file with all that can be set.";

    pub(crate) const RENDER: &str = "\
Examples:
  manylight render run.ron                                    as the run file says, into out/run.*
  manylight render scene.glb --size 480x270 --spp 16          a glTF file, with its own camera and lights
  manylight render scene.ron --size 480x270 --spp 16          or a scene, without a run file
  manylight render run.ron --method lightcuts --name cuts     another method, beside the first
  manylight render run.ron --set lights.count=20000           any field: see `manylight config run`
  manylight render run.ron --max-seconds 60                   what a minute gives; --resume goes on from there
  manylight render run.ron --reference truth.exr              the error after every pass, in run.json
  manylight render run.ron --shard 1/4 --name part1           one part of four; `manylight merge` joins them";

    pub(crate) const CHECK: &str = "\
Examples:
  manylight check run.ron
  manylight check run.ron --size 8192x8192                    would it fit into memory?";

    pub(crate) const VIEW: &str = "\
Examples:
  manylight view run.ron                                      then open the address that it prints
  manylight view run.ron --reference truth.exr                with the error against a picture
  manylight view scene.glb --size 640x360";

    pub(crate) const EXPERIMENT: &str = "\
Examples:
  manylight experiment tests.ron --quick                      a minute: does it work?
  manylight experiment tests.ron                              then open out/tests/index.html

`manylight config experiment` prints an experiment with all that can be set. The same command goes on where it ended.";

    pub(crate) const COMPARE: &str = "\
Examples:
  manylight compare out/run.exr truth.exr
  manylight compare out/run.exr truth.exr --json
  manylight compare out/run.exr truth.exr --max-relmse 0.001  for scripts: exit code 1 when it is worse";

    pub(crate) const MERGE: &str = "\
Example, on two machines and then on one:
  manylight render run.ron --shard 1/2 --name part1
  manylight render run.ron --shard 2/2 --name part2
  manylight merge out/part1.exr out/part2.exr --out whole.exr

The whole has the bits of a render without --shard.";

    pub(crate) const SCENE: &str = "\
Examples:
  manylight scene --list
  manylight scene nave --out nave";

    pub(crate) const CONFIG: &str = "\
Examples:
  manylight config run > run.ron
  manylight config scene > scene.ron
  manylight config experiment > tests.ron";

    pub(crate) const COMPLETIONS: &str = "\
Examples:
  manylight completions bash > ~/.local/share/bash-completion/completions/manylight
  manylight completions zsh > ~/.zfunc/_manylight
  manylight completions fish > ~/.config/fish/completions/manylight.fish";

    pub(crate) const MAN: &str = "\
Examples:
  manylight man | man -l -
  manylight man --out ~/.local/share/man/man1";
}

/// Names of methods, each with a line about it.
pub(crate) fn methods() -> Vec<PossibleValue> {
    let best = MethodSpec::default();
    let best = PossibleValue::new("best").help(format!("the default: {}", best.name()));
    let value = |method: &MethodSpec| PossibleValue::new(method.name()).help(method.about());
    MethodSpec::all().iter().map(value).chain([best]).collect()
}

/// `manylight completions`.
pub(crate) fn completions(shell: Shell) -> Result<(), CliError> {
    let mut script = Vec::new();
    clap_complete::generate(
        shell,
        &mut Arguments::command(),
        env!("CARGO_PKG_NAME"),
        &mut script,
    );
    print(&script)
}

/// `manylight man`.
pub(crate) fn man(arguments: &ManArgs) -> Result<(), CliError> {
    let mut command = Arguments::command().disable_help_subcommand(true);
    command.build();
    let Some(out) = &arguments.out else {
        return print(&page(&Man::new(command))?);
    };
    check_folder(out)?;
    let write = |page_of: &clap::Command| {
        let man = Man::new(page_of.clone());
        let page = page(&man)?;
        let file = out.join(man.get_filename());
        Ok::<(), CliError>(film::write_atomically(&file, |to| to.write_all(&page))?)
    };
    command.get_subcommands().try_for_each(write)?;
    write(&command)
}

fn page(man: &Man) -> Result<Vec<u8>, CliError> {
    let mut page = Vec::new();
    let rendered = man.render(&mut page);
    rendered.map_err(|error| CliError::Input(format!("no man page: {error}")))?;
    Ok(page)
}

/// `manylight config`.
pub(crate) fn config(arguments: &ConfigArgs) -> Result<(), CliError> {
    print(
        match arguments.kind {
            FileKind::Run => crate::job::ANNOTATED,
            FileKind::Scene => scene::load::ANNOTATED,
            FileKind::Experiment => crate::experiment::ANNOTATED,
        }
        .as_bytes(),
    )
}

fn print(text: &[u8]) -> Result<(), CliError> {
    let mut answer = Answer::default();
    answer.line(String::from_utf8_lossy(text).trim_end());
    answer.print()
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    /// Help of the program and of each command.
    fn helps() -> Vec<String> {
        let mut command = Arguments::command();
        command.build();
        let mut helps = vec![command.render_long_help().to_string()];
        for sub in command.get_subcommands_mut() {
            if sub.get_name() != "help" {
                helps.push(sub.render_long_help().to_string());
            }
        }
        helps
    }

    #[test]
    fn every_command_has_an_example_that_is_read() {
        for help in helps() {
            let mut examples = 0;
            for line in help.lines() {
                let Some(line) = line.strip_prefix("  manylight ") else {
                    continue;
                };
                // What stands behind two blanks explains; redirections are the shell's.
                let line = line.split("  ").next().unwrap_or_default();
                let line = line.split(['>', '|']).next().unwrap_or_default();
                let words = ["manylight"].into_iter().chain(line.split_whitespace());
                if let Err(error) = Arguments::try_parse_from(words) {
                    panic!("{line}: {error}");
                }
                examples += 1;
            }
            assert!(examples > 0, "no example in {help}");
        }
    }

    #[test]
    fn no_line_of_help_is_too_wide_for_a_terminal_of_120() {
        for help in helps() {
            for line in help.lines() {
                let values = line.contains("[possible values:");
                assert!(values || line.chars().count() <= 120, "{line}");
            }
        }
    }

    #[test]
    fn every_method_has_a_line_about_it() {
        let all = methods();
        assert_eq!(all.len(), MethodSpec::all().len() + 1, "with best");
        for method in all {
            let about = method.get_help().map(ToString::to_string);
            assert!(about.is_some_and(|about| about.len() > 10), "{method:?}");
        }
    }
}
