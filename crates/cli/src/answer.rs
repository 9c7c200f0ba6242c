//! What a command answers on stdout.

use std::fmt::Display;
use std::io::{ErrorKind, Write};

use crate::error::CliError;

/// Lines that are printed together.
#[derive(Debug, Default)]
pub(crate) struct Answer(String);

impl Answer {
    /// Adds a line.
    pub(crate) fn line(&mut self, text: impl Display) {
        self.0.push_str(&text.to_string());
        self.0.push('\n');
    }

    /// Prints the lines. Whoever closes the other end (`manylight check a.ron | head -1`) has seen enough.
    ///
    /// # Errors
    /// When stdout goes to a full disk, say.
    pub(crate) fn print(self) -> Result<(), CliError> {
        let mut stdout = std::io::stdout().lock();
        let written = stdout
            .write_all(self.0.as_bytes())
            .and_then(|()| stdout.flush());
        match written {
            Err(error) if error.kind() != ErrorKind::BrokenPipe => {
                Err(CliError::Input(format!("cannot write to stdout: {error}")))
            }
            _ => Ok(()),
        }
    }
}
