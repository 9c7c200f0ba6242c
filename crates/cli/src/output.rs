//! The files of a render, found writable before hours go into them.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::error::CliError;

/// Where a render's results go.
#[derive(Debug)]
pub(crate) struct Output {
    pub(crate) exr: PathBuf,
    pub(crate) png: PathBuf,
    pub(crate) json: PathBuf,
    pub(crate) denoised_exr: PathBuf,
    pub(crate) denoised_png: PathBuf,
    /// To go on from; not a result.
    pub(crate) state: PathBuf,
}

impl Output {
    /// Files called `name` in `folder`, which need not exist yet. Leaves nothing behind, not even what a render of that
    /// name left when it was killed.
    ///
    /// # Errors
    /// When the folder cannot be written to, or a file could not take its name.
    pub(crate) fn new(folder: &Path, name: &str) -> Result<Self, CliError> {
        check_folder(folder)?;
        let file = |end: &str| {
            let path = folder.join(format!("{name}.{end}"));
            refuse_folder(&path).map(|()| path)
        };
        let output = Self {
            exr: file("exr")?,
            png: file("png")?,
            json: file("json")?,
            denoised_exr: file("denoised.exr")?,
            denoised_png: file("denoised.png")?,
            state: file("state")?,
        };
        for path in [&output.exr, &output.png, &output.json, &output.state] {
            film::remove_abandoned(path);
        }
        Ok(output)
    }
}

/// Refuses a file that could not be written. Leaves nothing behind, not even what a killed writer of it left.
pub(crate) fn check_file(path: &Path) -> Result<(), CliError> {
    refuse_folder(path)?;
    check_folder(path.parent().unwrap_or(path)).map_err(|error| {
        // The user gave the file and not the folder.
        CliError::Input(format!("{}: {error}", path.display()))
    })?;
    film::remove_abandoned(path);
    Ok(())
}

fn refuse_folder(path: &Path) -> Result<(), CliError> {
    match path.is_dir() {
        true => Err(CliError::Input(format!(
            "{}: is a folder; expected a file, or nothing, in its place",
            path.display()
        ))),
        false => Ok(()),
    }
}

/// Refuses a folder that files could not be made in, or that could not be made itself.
pub(crate) fn check_folder(folder: &Path) -> Result<(), CliError> {
    let nearest = folder
        .ancestors()
        .map(|f| match f.as_os_str().is_empty() {
            true => Path::new("."),
            false => f,
        })
        .find(|f| !matches!(f.metadata(), Err(e) if e.kind() == ErrorKind::NotFound));
    let nearest = nearest.unwrap_or(folder);
    let refuse = |reason: String| {
        CliError::Input(format!(
            "--out {}: {reason}; expected a folder to write to",
            folder.display()
        ))
    };
    // Below a file nothing exists either, but the system calls that by another name.
    match nearest.metadata() {
        Ok(found) if found.is_dir() => {}
        Ok(_) => return Err(refuse(format!("{} is a file", nearest.display()))),
        Err(error) => return Err(refuse(error.to_string())),
    }
    tempfile::tempfile_in(nearest)
        .map(drop)
        .map_err(|error| refuse(format!("cannot write to {}: {error}", nearest.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_not_there_yet_will_do_and_is_not_made() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a/b");
        let output = Output::new(&path, "x").expect("can be made");
        assert_eq!(output.state, path.join("x.state"), "name");
        let mut left = std::fs::read_dir(folder.path()).expect("a folder");
        assert!(left.next().is_none(), "nothing is left behind");
        Output::new(Path::new(""), "x").expect("the current folder");
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let file = folder.path().join("file");
        std::fs::write(&file, "").expect("writes");
        for out in [file.clone(), file.join("deeper/still")] {
            let error = Output::new(&out, "x").expect_err("a file").to_string();
            assert!(error.contains("expected a folder"), "{error}");
        }
        std::fs::create_dir(folder.path().join("x.png")).expect("makes a folder");
        let error = Output::new(folder.path(), "x").expect_err("a folder");
        assert!(error.to_string().contains("x.png: is a folder"), "{error}");
    }
}
