//! `manylight scene`.

use crate::args::SceneArgs;
use crate::error::CliError;
use crate::output::check_folder;

#[allow(clippy::print_stdout, reason = "the answer of the command")]
pub(crate) fn run(arguments: &SceneArgs) -> Result<(), CliError> {
    if arguments.list {
        for name in procedural::NAMES {
            println!("{name}");
        }
        return Ok(());
    }
    let (Some(name), Some(out)) = (&arguments.name, &arguments.out) else {
        return Err(CliError::Input(
            "expected a scene's NAME and --out DIR".into(),
        ));
    };
    let files = procedural::files(name).ok_or_else(|| {
        CliError::Input(format!(
            "found scene {name}; expected one of: {}",
            procedural::NAMES.join(", ")
        ))
    })?;
    check_folder(out)?;
    for file in files {
        film::write_atomically(&out.join(&file.name), |to| to.write_all(&file.bytes))?;
    }
    Ok(())
}
