//! What can go wrong while reading a scene.

/// A scene file that cannot be used. Messages name file, line, value and what was expected.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// Reading failed.
    #[error("{path}: {source}")]
    Io {
        /// File that could not be read.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// `scene.ron` or a file of lights is wrong.
    #[error(transparent)]
    Ron(#[from] ron_file::RonError),
    /// A line of a file is wrong.
    #[error("{file}:{line}: {message}")]
    Line {
        /// The file.
        file: String,
        /// From 1.
        line: usize,
        /// What is wrong there.
        message: String,
    },
    /// A file as a whole is wrong.
    #[error("{file}: {message}")]
    File {
        /// The file.
        file: String,
        /// What is wrong with it.
        message: String,
    },
}

impl SceneError {
    pub(crate) fn line(file: &str, line: usize, message: impl Into<String>) -> Self {
        Self::Line {
            file: file.to_owned(),
            line,
            message: message.into(),
        }
    }

    pub(crate) fn file(file: &str, message: impl Into<String>) -> Self {
        Self::File {
            file: file.to_owned(),
            message: message.into(),
        }
    }
}
