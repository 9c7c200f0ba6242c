//! Finished cells and references on disk: one file each, by key, so that an ended run goes on where it was.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::ExperimentError;

/// The folder of an experiment's results.
#[derive(Debug, Clone)]
pub struct Store {
    folder: PathBuf,
}

impl Store {
    /// Results in `folder`, which need not be there yet.
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
        }
    }

    /// The folder itself.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Removes what writers that were killed left in it and in its folders; see [`film::remove_abandoned`].
    pub fn remove_abandoned(&self) {
        film::remove_all_abandoned(&self.folder);
        // Whatever folders there are: a list of them would forget the next one.
        for entry in std::fs::read_dir(&self.folder)
            .into_iter()
            .flatten()
            .flatten()
        {
            if entry.file_type().is_ok_and(|t| t.is_dir()) {
                film::remove_all_abandoned(&entry.path());
            }
        }
    }

    /// `cells/KEY.END`.
    pub fn cell(&self, key: &str, end: &str) -> PathBuf {
        self.folder.join("cells").join(format!("{key}.{end}"))
    }

    /// `references/KEY.END`.
    pub fn reference(&self, key: &str, end: &str) -> PathBuf {
        self.folder.join("references").join(format!("{key}.{end}"))
    }
}

/// The record in the JSON file at `path`; `None` when there is none, or none of this version's.
///
/// # Errors
/// When it is there and cannot be read.
pub fn read_record<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, ExperimentError> {
    match std::fs::read(path) {
        // A record that an older version wrote is as good as none.
        Ok(bytes) => Ok(serde_json::from_slice(&bytes).ok()),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(source) => Err(ExperimentError::Read {
            path: path.display().to_string(),
            source,
        }),
    }
}

/// Writes `record` as JSON, whole or not at all.
///
/// # Errors
/// Names the file when it cannot be written.
pub fn write_record<T: Serialize>(path: &Path, record: &T) -> Result<(), ExperimentError> {
    write_with(path, |file| {
        serde_json::to_writer_pretty(&mut *file, record)?;
        file.write_all(b"\n")
    })
}

/// Writes a file, whole or not at all; see [`film::write_atomically`].
pub(crate) fn write_with(
    path: &Path,
    write: impl FnOnce(&mut dyn std::io::Write) -> std::io::Result<()>,
) -> Result<(), ExperimentError> {
    Ok(film::write_atomically(path, write)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_comes_back_and_a_damaged_one_is_as_good_as_none() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let store = Store::new(folder.path());
        let path = store.cell("0123", "json");
        let none: Option<Vec<u32>> = read_record(&path).expect("nothing is there");
        assert_eq!(none, None, "nothing");
        write_record(&path, &vec![1, 2]).expect("writes");
        assert_eq!(read_record(&path).expect("reads"), Some(vec![1, 2]), "kept");
        std::fs::write(&path, "[1, 2").expect("writes");
        let none: Option<Vec<u32>> = read_record(&path).expect("reads");
        assert_eq!(none, None, "half a file");
    }
}
