//! `manylight scene`.

use crate::answer::Answer;
use crate::args::SceneArgs;
use crate::error::CliError;
use crate::output::check_folder;

pub(crate) fn run(arguments: &SceneArgs) -> Result<(), CliError> {
    if arguments.list {
        let mut answer = Answer::default();
        procedural::NAMES.iter().for_each(|name| answer.line(name));
        return answer.print();
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
