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
}
