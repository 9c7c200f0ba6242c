//! What ends a command early.

use experiment::ExperimentError;
use film::FilmError;
use ron_file::RonError;
use scene::SceneError;

/// A failed command; the message is all that the user sees.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    /// A run file cannot be used.
    #[error(transparent)]
    Ron(#[from] RonError),
    /// A scene cannot be used.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A picture cannot be read, written or compared.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// An experiment's results cannot be read or written.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// Anything else that was asked for and cannot be done.
    #[error("{0}")]
    Input(String),
    /// A comparison came out worse than its limit.
    #[error("{0}")]
    Limit(String),
    /// Someone wanted it to stop; what is done so far is saved.
    #[error("{0}")]
    Interrupted(String),
}

impl CliError {
    /// 1 for a failed comparison, 2 for bad input or usage, 3 when interrupted.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Limit(_) => 1,
            Self::Interrupted(_) => 3,
            _ => 2,
        }
    }
}
