//! `manylight merge`.

use std::collections::BTreeSet;

use film::{Exposure, FilmError, Picture};
use gather::Shard;

use crate::args::{MergeArgs, parse_shard};
use crate::error::CliError;
use crate::output::check_file;

/// The attribute of an EXR that says which shard it is: `2/3`.
pub(crate) const SHARD: &str = "shard";

pub(crate) fn run(arguments: &MergeArgs) -> Result<(), CliError> {
    check_file(&arguments.out)?;
    let mut parts = Vec::new();
    let mut shards = Vec::new();
    let mut attributes: Option<Vec<(String, String)>> = None;
    for path in &arguments.shards {
        let (picture, mut found) = Picture::read_exr(path)?;
        shards.extend(taken_out(&mut found));
        match &attributes {
            Some(first) if without_path(first) != without_path(&found) => {
                let pairs = without_path(first).into_iter().zip(without_path(&found));
                let differs = pairs.into_iter().find(|(a, b)| a != b);
                let what = differs.map_or(String::new(), |(a, b)| {
                    format!(": {} is {:?}; expected {:?}", b.0, b.1, a.1)
                });
                return Err(CliError::Input(format!(
                    "{}: a shard of another render{what}",
                    path.display()
                )));
            }
            Some(_) => {}
            None => attributes = Some(found),
        }
        parts.push((path.display().to_string(), picture));
    }
    let whole = Picture::merge(&parts).map_err(|error| match error {
        FilmError::MergeMissing { .. } => missing(error, &shards),
        error => error.into(),
    })?;
    whole.write_exr(&arguments.out, &attributes.unwrap_or_default())?;
    whole.write_png(&arguments.out.with_extension("png"), Exposure::Auto)?;
    Ok(())
}

/// Which shard the attributes tell of, without which they are those of the whole picture.
fn taken_out(attributes: &mut Vec<(String, String)>) -> Option<Shard> {
    let at = attributes.iter().position(|(name, _)| name == SHARD)?;
    parse_shard(&attributes.remove(at).1).ok()
}

/// An error that names the shards that are missing, if those that are there tell.
fn missing(error: FilmError, shards: &[Shard]) -> CliError {
    let counts: BTreeSet<u32> = shards.iter().map(|shard| shard.count).collect();
    let Some(&count) = counts.first().filter(|_| counts.len() == 1) else {
        return error.into();
    };
    let there: BTreeSet<u32> = shards.iter().map(|shard| shard.index).collect();
    let absent: Vec<String> = (0..count)
        .filter(|index| !there.contains(index))
        .map(|index| Shard { index, count }.to_string())
        .collect();
    match absent.as_slice() {
        [] => error.into(),
        [one] => CliError::Input(format!(
            "shard {one} is missing; expected all {count}: render it with --shard {one}"
        )),
        many => CliError::Input(format!(
            "shards {} are missing; expected all {count}: render each with --shard",
            many.join(", ")
        )),
    }
}

/// All but where the scene was: shards may come from several machines, and `scene_content` tells scenes apart.
fn without_path(attributes: &[(String, String)]) -> Vec<&(String, String)> {
    let path = |name: &str| name == "scene";
    attributes.iter().filter(|(name, _)| !path(name)).collect()
}
