//! ron's errors in words that name the field, the value found and what was expected.

use ron::error::{Error, SpannedError};
use serde_path_to_error::{Path, Segment};

use crate::path::{self, Step};
use crate::scan::{Kind, Tokens, byte_of};
use crate::tree::Tree;

/// What is wrong, and where in the text handed to ron.
pub(crate) struct Explained {
    /// Byte to point at.
    pub(crate) at: usize,
    /// Path of the field, empty for the whole file.
    pub(crate) path: String,
    /// What is wrong there.
    pub(crate) message: String,
}

/// Longest piece of a file that a message quotes, characters.
const QUOTE: usize = 48;

/// A value on one line and no longer than [`QUOTE`].
pub(crate) fn shortened(value: &str) -> String {
    let start = value
        .char_indices()
        .nth(4 * QUOTE)
        .map_or(value, |(at, _)| &value[..at]);
    let mut line = start.split_whitespace().collect::<Vec<_>>().join(" ");
    if let Some((at, _)) = line.char_indices().nth(QUOTE) {
        line.truncate(at);
    }
    if start.len() < value.len() || line.chars().count() == QUOTE {
        line.push('…');
    }
    line
}

/// Explains a failure of the typed read. `path` is where serde was.
pub(crate) fn explain(text: &str, error: &SpannedError, path: &Path) -> Explained {
    let tree = Tree::new(text);
    if let Some(key) = tree.root().and_then(|root| tree.node(root).key.clone()) {
        let found = shortened(&text[key.clone()]);
        return Explained {
            at: key.start,
            path: String::new(),
            message: format!("found {found}: alone; expected parentheses ( … ) around all fields"),
        };
    }
    let cursor = byte_of(text, error.span.end.line, error.span.end.col);
    let mut steps = steps(path);
    if let Error::NoSuchStructField { found, .. } | Error::NoSuchEnumVariant { found, .. } =
        &error.code
        && matches!(steps.last(), Some(Step::Field(last)) if last == found)
        && tree.find(&steps).is_none_or(|at| tree.value(at) != found)
    {
        steps.pop();
    }
    let here = tree.find(&steps);
    if let Some(here) = here
        && let Some((at, message)) = in_value(&tree, here, cursor, &error.code)
    {
        let path = path::show(&steps);
        return Explained { at, path, message };
    }
    let at = cursor.min(text.len());
    if !here.is_some_and(|here| tree.node(here).span.is_empty()) {
        steps = tree.path_to(at);
        if error.code == Error::ExpectedMapColon && matches!(steps.last(), Some(Step::Index(_))) {
            steps.pop();
        }
    }
    Explained {
        at: token_at(text, at).map_or(at, |token| token.start),
        path: path::show(&steps),
        message: at_cursor(text, at, &error.code),
    }
}

/// Explains a failure to read any RON at all from `text`.
pub(crate) fn syntax(text: &str, error: &SpannedError) -> String {
    at_cursor(
        text,
        byte_of(text, error.span.end.line, error.span.end.col),
        &error.code,
    )
}

/// serde's path; variants and wraps are not steps.
fn steps(path: &Path) -> Vec<Step> {
    path.iter()
        .filter_map(|segment| match segment {
            Segment::Seq { index } => Some(Step::Index(*index)),
            Segment::Map { key } => Some(Step::Field(key.clone())),
            Segment::Enum { .. } | Segment::Unknown => None,
        })
        .collect()
}

/// Errors about the value at `here`; `None` for errors about the text around the cursor.
fn in_value(tree: &Tree<'_>, here: usize, cursor: usize, code: &Error) -> Option<(usize, String)> {
    let node = tree.node(here);
    let start = node.span.start;
    let message = match code {
        Error::NoSuchStructField {
            expected, found, ..
        } => {
            let field = tree.fields(here, found).next();
            let key = field.and_then(|field| tree.node(field).key.clone());
            let at = key.map_or(start, |key| key.start);
            return Some((at, no_such("field", found, expected)));
        }
        Error::DuplicateStructField { field, .. } => {
            let second = tree.fields(here, field).nth(1);
            let key = second.and_then(|field| tree.node(field).key.clone());
            let at = key.map_or(start, |key| key.start);
            return Some((at, format!("field `{field}` is given twice")));
        }
        Error::MissingStructField { field, .. } => format!("field `{field}` is missing"),
        Error::NoSuchEnumVariant {
            expected, found, ..
        } => no_such("variant", found, expected),
        Error::Message(message) => message.clone(),
        Error::InvalidValueForType { expected, .. } => {
            format!("found {}; expected {expected}", shortened(tree.value(here)))
        }
        Error::ExpectedDifferentLength { expected, found } => {
            let plural = if *found == 1 { "value" } else { "values" };
            format!("found {found} {plural}; expected {expected}")
        }
        code => {
            let expected = wanted(code)?;
            let got_inside = node.inside.as_ref().is_some_and(|i| i.start <= cursor);
            if node.span.is_empty() || got_inside {
                return None;
            }
            format!("found {}; expected {expected}", shortened(tree.value(here)))
        }
    };
    Some((start, message))
}

/// What ron wanted where it found a value of another kind.
fn wanted(code: &Error) -> Option<String> {
    Some(match code {
        Error::ExpectedBoolean => "true or false".into(),
        Error::ExpectedFloat => "a number".into(),
        Error::FloatUnderscore => "a number without `_`".into(),
        Error::ExpectedInteger => "a whole number".into(),
        Error::IntegerOutOfBounds => "a whole number that is in range here".into(),
        Error::InvalidIntegerDigit { base: 10, .. } => "a whole number".into(),
        Error::InvalidIntegerDigit { digit, base } => {
            format!("a whole number; {digit:?} is no digit in base {base}")
        }
        Error::ExpectedString => "a string in \"quotes\"".into(),
        Error::ExpectedChar => "a character in 'quotes'".into(),
        Error::ExpectedOption => "Some(…) or None".into(),
        Error::ExpectedUnit => "()".into(),
        Error::ExpectedArray => "a list [ … ]".into(),
        Error::ExpectedMap => "a map { … }".into(),
        Error::ExpectedStructLike | Error::ExpectedNamedStructLike(_) => {
            "values in parentheses ( … )".into()
        }
        Error::ExpectedDifferentStructName { expected, .. } => {
            format!("{expected}( … ), or just ( … )")
        }
        Error::ExpectedIdentifier | Error::SuggestRawIdentifier(_) => "a name".into(),
        _ => return None,
    })
}

/// An unknown name, the nearest known one, and all known ones.
fn no_such(what: &str, found: &str, expected: &[&str]) -> String {
    let near = nearest(found, expected);
    let hint = near.map_or(String::new(), |name| format!(" (did you mean `{name}`?)"));
    let names: Vec<String> = expected.iter().map(|name| format!("`{name}`")).collect();
    let expected = match names.len() {
        0 => format!("there are no {what}s here"),
        1 => format!("expected {}", names[0]),
        _ => format!("expected one of {}", names.join(", ")),
    };
    format!("unknown {what} `{}`{hint}; {expected}", shortened(found))
}

/// The name that `found` is most likely a misspelling of.
fn nearest<'a>(found: &str, expected: &[&'a str]) -> Option<&'a str> {
    // Names are short; a long one is no misspelling, and its distance takes quadratic time.
    if found.len() > 64 {
        return None;
    }
    let lower = found.to_lowercase();
    let distance = |name: &str| strsim::osa_distance(&lower, &name.to_lowercase());
    let near = expected.iter().map(|&name| (distance(name), name)).min()?;
    let close_enough = near.0 <= 2.max(near.1.len() / 3) && near.0 < near.1.len();
    close_enough.then_some(near.1)
}

fn token_at(text: &str, at: usize) -> Option<crate::scan::Token> {
    Tokens::new(text)
        .find(|token| token.end > at)
        .filter(|token| token.start <= at)
}

/// Errors about the text at the cursor.
fn at_cursor(text: &str, at: usize, code: &Error) -> String {
    let token = token_at(text, at);
    let quoted = token.map(|token| shortened(&text[token.range()]));
    let quoted = quoted.unwrap_or_else(|| "the end of the text".to_owned());
    match code {
        Error::ExceededRecursionLimit => "brackets are nested too deep".into(),
        Error::TrailingCharacters => format!("found {quoted} behind the value; expected nothing"),
        Error::ExpectedComma | Error::ExpectedStructLikeEnd | Error::ExpectedArrayEnd
            if token.is_some_and(|t| t.kind == Kind::Literal && t.start < at) =>
        {
            // ron stopped inside a number: `1.5` where an integer belongs.
            format!("found {quoted}; expected a whole number")
        }
        Error::ExpectedComma => match name_before(text, at).filter(|_| quoted == "(") {
            Some(name) => format!("`{name}` takes no values in parentheses"),
            None => format!("expected a comma before {quoted}"),
        },
        Error::ExpectedStructLikeEnd => format!("expected `)` before {quoted}"),
        Error::ExpectedArrayEnd => format!("expected `]` before {quoted}"),
        Error::ExpectedMapEnd => format!("expected `}}` before {quoted}"),
        Error::ExpectedMapColon => format!("expected `:` before {quoted}"),
        Error::Eof => "the text ends in the middle of a value".into(),
        code => match wanted(code) {
            Some(wanted) => format!("found {quoted}; expected {wanted}"),
            None => lower_first(&code.to_string()),
        },
    }
}

/// The identifier that ends right before byte `at`, blanks aside.
fn name_before(text: &str, at: usize) -> Option<&str> {
    let before = Tokens::new(text)
        .take_while(|token| token.start < at)
        .last()?;
    (before.kind == Kind::Ident).then(|| &text[before.range()])
}

fn lower_first(message: &str) -> String {
    let mut chars = message.chars();
    let first = chars.next().map(|c| c.to_ascii_lowercase());
    first.into_iter().chain(chars).collect()
}
