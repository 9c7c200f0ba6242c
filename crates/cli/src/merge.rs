//! `manylight merge`.

use std::{collections::BTreeSet, path::Path};

use film::{Exposure, FilmError, Metadata, Picture};
use gather::Shard;

use crate::args::{MergeArgs, parse_shard};
use crate::error::CliError;
use crate::output::check_file;

/// The attribute of an EXR that says which shard it is: `2/3`.
pub(crate) const SHARD: &str = "shard";

pub(crate) fn run(arguments: &MergeArgs) -> Result<(), CliError> {
    check_file(&arguments.out)?;
    let mut shards = Vec::new();
    let mut metadata: Option<Metadata> = None;
    let parts = arguments.shards.iter().map(|path| {
        let (picture, mut found) = Picture::read_exr(path)?;
        shards.extend(taken_out(&mut found));
        match &metadata {
            Some(first) => expect_same(first, &found, path)?,
            None => metadata = Some(found),
        }
        Ok((path.display().to_string(), picture))
    });
    let whole = Picture::merge(parts).map_err(|error| match error {
        CliError::Film(error @ FilmError::MergeMissing { .. }) => missing(error, &shards),
        error => error,
    })?;
    whole.write_exr(&arguments.out, &metadata.unwrap_or_default())?;
    whole.write_png(&arguments.out.with_extension("png"), Exposure::Auto)?;
    Ok(())
}

/// An error if the shard at `path` is of another render than the first one.
fn expect_same(first: &Metadata, found: &Metadata, path: &Path) -> Result<(), CliError> {
    if content(first) == content(found) {
        return Ok(());
    }
    let pairs = content(first).into_iter().zip(content(found));
    let differs = pairs.into_iter().find(|(a, b)| a != b);
    let what = differs.map_or(String::new(), |(a, b)| {
        format!(": {} is {:?}; expected {:?}", b.0, b.1, a.1)
    });
    Err(CliError::Input(format!(
        "{}: a shard of another render{what}",
        path.display()
    )))
}

/// Which shard the metadata tell of, without which they are those of the whole picture.
fn taken_out(metadata: &mut Metadata) -> Option<Shard> {
    let texts = &mut metadata.texts;
    let at = texts.iter().position(|(name, _)| name == SHARD)?;
    parse_shard(&texts.remove(at).1).ok()
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

/// All but where the scene was and how the run file was written: shards may come from several machines, `scene_content`
/// tells scenes apart, and what a run file means is there in other texts.
fn content(metadata: &Metadata) -> Vec<&(String, String)> {
    let is_form = |name: &str| name == "scene" || name == "config";
    let texts = metadata.texts.iter();
    texts.filter(|(name, _)| !is_form(name)).collect()
}
