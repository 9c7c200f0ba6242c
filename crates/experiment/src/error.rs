//! What can go wrong with results.

use film::FilmError;

/// Results that could not be read or written; the message names the file.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A picture or file could not be read, written or compared.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A record could not be read.
    #[error("{path}: cannot be read: {source}")]
    Read {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// A plot could not be drawn.
    #[error("{path}: cannot be drawn: {message}")]
    Plot {
        /// Its file.
        path: String,
        /// Why.
        message: String,
    },
    /// The page could not be made.
    #[error("index.html: {0}")]
    Page(String),
}
