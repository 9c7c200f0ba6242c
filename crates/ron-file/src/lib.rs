//! RON files, read with the [`ron`] crate into any serde type, with three things added:
//!
//! - overrides by path (`--set lights.count=2000`), see [`Override`];
//! - bare variants: `kind: Vsl` where ron wants `kind: Vsl()`;
//! - errors that name file, line, column, field, the value found and what was expected.
//!
//! Range checks belong to the types that are read: a `#[serde(try_from = "…")]` type whose error says
//! `found 0; expected 1..=16384` comes out as `a.ron:3:12: image.width: found 0; expected 1..=16384`.
//! ron accepts `NaN`, `inf` and `1e999`: such types refuse them.
//!
//! All edits are made in the text, and remember where every byte came from, so that errors point into the
//! file as it is on disk, or at the override.

mod edit;
mod explain;
mod path;
mod scan;
mod set;
mod tree;
mod variants;

use std::path::Path;

use ron::extensions::Extensions;
use serde::de::DeserializeOwned;

use edit::{Edited, Origin};
pub use set::Override;
use tree::Tree;

/// A RON text that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RonError {
    /// The file could not be read.
    #[error("{file}: cannot be read ({source}); expected a RON file")]
    Io {
        /// Path as given.
        file: String,
        /// Why.
        source: std::io::Error,
    },
    /// Something in the file is wrong.
    #[error("{file}:{line}:{column}: {message}")]
    File {
        /// Path as given.
        file: String,
        /// From 1.
        line: usize,
        /// From 1, in characters.
        column: usize,
        /// Field, value found and what was expected.
        message: String,
    },
    /// Something in an override is wrong.
    #[error("--set {set}: {message}")]
    Set {
        /// The override, `PATH=VALUE`.
        set: String,
        /// Value found and what was expected.
        message: String,
    },
}

/// Line and column in a text, both from 1; columns count characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Line.
    pub line: usize,
    /// Column.
    pub column: usize,
}

/// Reads `file` into a `T`; see [`parse`].
///
/// # Errors
///
/// When the file cannot be read, and as [`parse`].
pub fn read<T: DeserializeOwned>(
    file: &Path,
    overrides: &[Override],
    variants_with_fields: &[&str],
) -> Result<T, RonError> {
    let name = file.display().to_string();
    parse(&name, &read_text(file)?, overrides, variants_with_fields)
}

/// Reads `file` as text.
///
/// # Errors
///
/// When the file cannot be read, and as [`text`].
pub fn read_text(file: &Path) -> Result<String, RonError> {
    let name = file.display().to_string();
    let bytes = std::fs::read(file).map_err(|source| RonError::Io {
        file: name.clone(),
        source,
    })?;
    text(&name, &bytes).map(str::to_owned)
}

/// The text in a file's bytes.
///
/// # Errors
///
/// When the bytes are not UTF-8, or zeros are among them, as only binary files have them; `name` is the
/// file's name for the message.
pub fn text<'a>(name: &str, bytes: &'a [u8]) -> Result<&'a str, RonError> {
    let zero = bytes.iter().position(|&byte| byte == 0);
    let bad = match std::str::from_utf8(bytes) {
        Ok(text) if zero.is_none() => return Ok(text),
        Ok(_) => bytes.len(),
        Err(error) => error.valid_up_to(),
    };
    let at = zero.map_or(bad, |zero| zero.min(bad));
    let valid = std::str::from_utf8(&bytes[..at]).unwrap_or_default();
    let message = match bytes.get(at) {
        Some(0) | None => "byte 0x00 is no text; expected a text file in UTF-8".to_owned(),
        Some(byte) => format!("byte 0x{byte:02X} is not UTF-8; expected a text file in UTF-8"),
    };
    Err(file_error(name, valid, valid.len(), message))
}

/// Whether the outermost value of `text` has a field of that name, by which files of different kinds are told
/// apart; false for text that is not RON.
pub fn has_field(text: &str, name: &str) -> bool {
    let tree = Tree::new(text.strip_prefix('\u{FEFF}').unwrap_or(text));
    tree.root()
        .is_some_and(|root| tree.fields(root, name).next().is_some())
}

/// Reads `text` into a `T`, after putting in the `overrides`. `name` is the file's name for messages.
///
/// `variants_with_fields` lists the enum variants that hold named fields and may be written without
/// parentheses when all fields have defaults. They may be struct variants, or variants that hold a struct.
///
/// Extensions in force: `implicit_some`, `unwrap_newtypes`, `unwrap_variant_newtypes`.
///
/// # Errors
///
/// When the text is not RON, nests deeper than about 60 brackets, or is not a `T`; when an override does
/// not fit. Never panics, whatever the text.
pub fn parse<T: DeserializeOwned>(
    name: &str,
    text: &str,
    overrides: &[Override],
    variants_with_fields: &[&str],
) -> Result<T, RonError> {
    let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
    scan::check_closed(text).map_err(|(at, message)| file_error(name, text, at, message))?;
    if scan::Tokens::after_attributes(text).next().is_none() {
        return Err(file_error(
            name,
            text,
            0,
            "the file holds no value; expected one, such as ( … )".to_owned(),
        ));
    }
    let mut edited = Edited::new(text);
    set::apply(&mut edited, overrides, variants_with_fields)?;
    variants::normalise(&mut edited, variants_with_fields);
    typed(edited.text()).map_err(|explained| {
        let field = explained.path.as_str();
        let message = explained.message;
        match edited.origin(explained.at) {
            Origin::File(at) | Origin::Inserted(at) => {
                let colon = if field.is_empty() { "" } else { ": " };
                file_error(name, text, at, format!("{field}{colon}{message}"))
            }
            Origin::Set(index) => {
                let set = &overrides[index];
                let message = match field == set.path || field.is_empty() {
                    true => message,
                    false => format!("{field}: {message}"),
                };
                let set = set.to_string();
                RonError::Set { set, message }
            }
        }
    })
}

/// `text` with the `overrides` put in, comments and all: what a file would say that needs none.
///
/// # Errors
///
/// When an override does not fit.
pub fn overridden(
    text: &str,
    overrides: &[Override],
    variants_with_fields: &[&str],
) -> Result<String, RonError> {
    let mut edited = Edited::new(text.strip_prefix('\u{FEFF}').unwrap_or(text));
    set::apply(&mut edited, overrides, variants_with_fields)?;
    Ok(edited.text().to_owned())
}

/// Where the value at `path` (`lights[3].intensity`) is in a text, for checks that come after reading.
pub fn place(text: &str, path: &str) -> Option<Place> {
    let shift = text.len() - text.trim_start_matches('\u{FEFF}').len();
    let tree = Tree::new(&text[shift..]);
    let at = tree.node(tree.find(&path::parse(path)?)?).span.start;
    let (line, column) = scan::line_column(&text[shift..], at);
    Some(Place { line, column })
}

fn options() -> ron::Options {
    ron::Options::default().with_default_extension(
        Extensions::IMPLICIT_SOME
            | Extensions::UNWRAP_NEWTYPES
            | Extensions::UNWRAP_VARIANT_NEWTYPES,
    )
}

fn typed<T: DeserializeOwned>(text: &str) -> Result<T, explain::Explained> {
    let root = |error: ron::error::SpannedError| explain::Explained {
        at: scan::byte_of(text, error.span.end.line, error.span.end.col),
        path: String::new(),
        message: explain::syntax(text, &error),
    };
    let mut reader = ron::Deserializer::from_str_with_options(text, &options()).map_err(root)?;
    let value = serde_path_to_error::deserialize(&mut reader).map_err(|error| {
        let path = error.path().clone();
        explain::explain(text, &reader.span_error(error.into_inner()), &path)
    })?;
    reader.end().map_err(|code| root(reader.span_error(code)))?;
    Ok(value)
}

fn file_error(file: &str, text: &str, at: usize, message: String) -> RonError {
    let (line, column) = scan::line_column(text, at);
    RonError::File {
        file: file.to_owned(),
        line,
        column,
        message,
    }
}

#[cfg(test)]
mod tests;
