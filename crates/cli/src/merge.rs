//! `manylight merge`.

use film::{Exposure, Metadata, Picture};

use crate::args::MergeArgs;
use crate::error::CliError;
use crate::output::check_file;

pub(crate) fn run(arguments: &MergeArgs) -> Result<(), CliError> {
    check_file(&arguments.out)?;
    let mut parts = Vec::new();
    let mut metadata: Option<Metadata> = None;
    for path in &arguments.shards {
        let (picture, found) = Picture::read_exr(path)?;
        match &metadata {
            Some(first) if content(first) != content(&found) => {
                let pairs = content(first).into_iter().zip(content(&found));
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
            None => metadata = Some(found),
        }
        parts.push((path.display().to_string(), picture));
    }
    let whole = Picture::merge(&parts)?;
    whole.write_exr(&arguments.out, &metadata.unwrap_or_default())?;
    whole.write_png(&arguments.out.with_extension("png"), Exposure::Auto)?;
    Ok(())
}

/// All but where the scene was and how the run file was written: shards may come from several machines, `scene_content`
/// tells scenes apart, and what a run file means is there in other texts.
fn content(metadata: &Metadata) -> Vec<&(String, String)> {
    let is_form = |name: &str| name == "scene" || name == "config";
    let texts = metadata.texts.iter();
    texts.filter(|(name, _)| !is_form(name)).collect()
}
