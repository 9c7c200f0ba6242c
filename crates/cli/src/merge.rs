//! `manylight merge`.

use film::{Exposure, Picture};

use crate::args::MergeArgs;
use crate::error::CliError;
use crate::output::check_file;

pub(crate) fn run(arguments: &MergeArgs) -> Result<(), CliError> {
    check_file(&arguments.out)?;
    let mut parts = Vec::new();
    let mut attributes: Option<Vec<(String, String)>> = None;
    for path in &arguments.shards {
        let (picture, found) = Picture::read_exr(path)?;
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
    let whole = Picture::merge(&parts)?;
    whole.write_exr(&arguments.out, &attributes.unwrap_or_default())?;
    whole.write_png(&arguments.out.with_extension("png"), Exposure::Auto)?;
    Ok(())
}

/// All but where the scene was: shards may come from several machines, and `scene_content` tells scenes apart.
fn without_path(attributes: &[(String, String)]) -> Vec<&(String, String)> {
    let path = |name: &str| name == "scene";
    attributes.iter().filter(|(name, _)| !path(name)).collect()
}
