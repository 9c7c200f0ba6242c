//! `manylight compare`.

use crate::answer::Answer;
use crate::args::CompareArgs;
use crate::error::CliError;

pub(crate) fn run(arguments: &CompareArgs) -> Result<(), CliError> {
    let image = film::read_image(&arguments.image)?;
    let reference = film::read_image(&arguments.reference)?;
    let metrics = film::compare(&image, &reference)?;
    let mut answer = Answer::default();
    if arguments.json {
        let fields: serde_json::Map<String, serde_json::Value> = metrics
            .fields()
            .into_iter()
            .map(|(name, value)| (name.to_owned(), value.into()))
            .collect();
        answer.line(serde_json::Value::Object(fields));
    } else {
        for (name, value) in metrics.fields() {
            answer.line(format_args!("{name:<11} {value:.6e}"));
        }
    }
    answer.print()?;
    match arguments.max_relmse {
        Some(limit) if metrics.relmse.is_nan() || metrics.relmse > limit => {
            Err(CliError::Limit(format!(
                "{}: relmse is {:e}; expected at most {limit:e}",
                arguments.image.display(),
                metrics.relmse
            )))
        }
        _ => Ok(()),
    }
}
