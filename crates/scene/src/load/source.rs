//! Where a scene's files come from: a folder, the scenes built into the program, or another file that holds them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use procedural::SceneFile;

use crate::SceneError;

/// The folder (on disk or in memory) that names are relative to. Names in untrusted files cannot leave it.
#[derive(Debug, Clone)]
pub(super) enum Source {
    Disk(PathBuf),
    Memory {
        /// Its name for messages: `builtin:nave`.
        folder: String,
        files: Arc<[SceneFile]>,
    },
}

impl Source {
    /// The built-in scene called `scene`; else a message.
    pub(super) fn built_in(scene: &str) -> Result<Self, String> {
        let files = procedural::files(scene).ok_or_else(|| {
            let known = procedural::NAMES.join(", ");
            format!("there is no built-in scene `{scene}`; there are: {known}")
        })?;
        Ok(Self::Memory {
            folder: format!("builtin:{scene}"),
            files: files.into(),
        })
    }

    /// A file's name for messages: its path, or `builtin:nave/scene.obj`.
    pub(super) fn shown(&self, name: &str) -> String {
        match self {
            Self::Disk(folder) => folder.join(name).display().to_string(),
            Self::Memory { folder, .. } => format!("{folder}/{name}"),
        }
    }

    /// Contents of the file called `name`, as [`join`] makes names.
    pub(super) fn read(&self, name: &str) -> std::io::Result<Vec<u8>> {
        match self {
            Self::Disk(folder) => std::fs::read(folder.join(name)),
            Self::Memory { files, .. } => files
                .iter()
                .find(|file| file.name == name)
                .map(|file| file.bytes.clone())
                .ok_or_else(|| std::io::ErrorKind::NotFound.into()),
        }
    }

    pub(super) fn has(&self, name: &str) -> bool {
        match self {
            Self::Disk(folder) => folder.join(name).is_file(),
            Self::Memory { files, .. } => files.iter().any(|file| file.name == name),
        }
    }
}

/// The file called `name` in a file called `from`, relative to the source; else a message.
///
/// Either slash divides folders. Absolute names and names that climb out of the source are refused.
pub(super) fn join(from: &str, name: &str) -> Result<String, String> {
    let slash = ['/', '\\'];
    let drive = name.chars().nth(1) == Some(':');
    if name.starts_with(slash) || drive || name.contains('\0') {
        return Err(format!(
            "`{name}` is an absolute path; expected one relative to this file"
        ));
    }
    let mut parts: Vec<&str> = from.split('/').collect();
    parts.pop();
    for part in name.split(slash) {
        match part {
            "" | "." => {}
            ".." if parts.pop().is_none() => {
                return Err(format!("`{name}` leads out of the scene's folder"));
            }
            ".." => {}
            part => parts.push(part),
        }
    }
    match name.ends_with(slash) || parts.is_empty() {
        true => Err(format!("`{name}` names no file")),
        false => Ok(parts.join("/")),
    }
}

/// What an environment variable at the start of a scene's path should name, and where such scenes can be had.
pub const SCENE_FOLDER: &str = "the folder that holds the scene folders sibenik/, sponza/, conference/ and so on, \
    each with its scene.ron (scenes to fetch: Morgan McGuire's Computer Graphics Archive, \
    https://casual-effects.com/data, and Benedikt Bitterli's rendering resources, \
    https://benedikt-bitterli.me/resources/)";

/// Puts in the environment variable that `path` may begin with: `$MANYLIGHT_SCENES/sibenik/scene.ron`.
///
/// # Errors
///
/// When the variable is not set, or its name is not of letters, digits and `_`.
pub fn expand(path: &str) -> Result<PathBuf, SceneError> {
    let Some(rest) = path.strip_prefix('$') else {
        return Ok(PathBuf::from(path));
    };
    let (variable, rest) = rest.split_once(['/', '\\']).unwrap_or((rest, ""));
    let plain = |c: char| c == '_' || c.is_ascii_alphanumeric();
    if variable.is_empty() || !variable.chars().all(plain) {
        let message = format!(
            "`${variable}` is no environment variable; expected a path like $MANYLIGHT_SCENES/sibenik/scene.ron"
        );
        return Err(SceneError::file(path, message));
    }
    match std::env::var_os(variable) {
        Some(folder) if !folder.is_empty() => Ok(Path::new(&folder).join(rest)),
        _ => Err(SceneError::file(
            path,
            format!("the environment variable {variable} is not set; set it to {SCENE_FOLDER}"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_relative_to_the_file_that_holds_them() {
        let join = |from, name| join(from, name).expect("inside");
        assert_eq!(join("scene.obj", "scene.mtl"), "scene.mtl", "beside it");
        assert_eq!(join("a/b.obj", "t\\x.png"), "a/t/x.png", "backslash");
        assert_eq!(join("a/b.obj", "../c/./d.mtl"), "c/d.mtl", "up and down");
        assert_eq!(join("b.obj", "a name.mtl"), "a name.mtl", "a space");
    }

    #[test]
    fn names_cannot_leave_the_folder() {
        for name in [
            "/etc/passwd",
            "..",
            "../x",
            "a/../../x",
            "\\x",
            "C:\\x",
            "..\\x",
            "",
            "a/",
        ] {
            assert!(join("scene.obj", name).is_err(), "{name}");
        }
        assert!(join("a/b.obj", "../../x").is_err(), "two up from one down");
    }

    #[test]
    fn variables_are_named_when_missing() {
        assert_eq!(
            expand("a/b.ron").expect("no variable"),
            Path::new("a/b.ron"),
            "plain"
        );
        let error = expand("$MANYLIGHT_NOT_SET_ANYWHERE/a.ron").expect_err("not set");
        let error = error.to_string();
        for part in [
            "MANYLIGHT_NOT_SET_ANYWHERE",
            "sibenik/",
            "casual-effects.com",
        ] {
            assert!(error.contains(part), "{part} in {error}");
        }
        assert!(expand("$/a").is_err(), "no name");
        assert!(expand("${HOME}/a").is_err(), "braces");
    }
}
