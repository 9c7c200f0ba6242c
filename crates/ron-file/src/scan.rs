//! RON text cut into tokens, without a grammar and without recursion.
//!
//! The parsing proper is ron's. This scanner only has to know where strings, comments and brackets
//! begin and end, so that text can be edited and places in it named.

use std::ops::Range;

/// What a token is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// `(`, `[` or `{`.
    Open,
    /// `)`, `]` or `}`.
    Close,
    Comma,
    Colon,
    Ident,
    /// A number, string or character.
    Literal,
    /// A string, raw string or block comment that the text ends in the middle of.
    Unclosed(&'static str),
    /// Anything else, one character.
    Other,
}

/// A token and the bytes it covers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Token {
    pub(crate) kind: Kind,
    pub(crate) start: usize,
    pub(crate) end: usize,
}

impl Token {
    pub(crate) fn range(self) -> Range<usize> {
        self.start..self.end
    }
}

/// Iterator over the tokens of a text; comments and whitespace are left out.
#[derive(Clone)]
pub(crate) struct Tokens<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Tokens<'a> {
    pub(crate) fn new(text: &'a str) -> Self {
        Self { text, at: 0 }
    }

    /// The tokens behind the attributes (`#![enable(…)]`) that a text may begin with.
    pub(crate) fn after_attributes(text: &'a str) -> Self {
        let mut tokens = Self::new(text);
        loop {
            let before = tokens.clone();
            if tokens.next().is_none_or(|t| &text[t.range()] != "#") {
                return before;
            }
            let mut depth = 0usize;
            for token in tokens.by_ref() {
                match token.kind {
                    Kind::Open => depth += 1,
                    Kind::Close if depth <= 1 => break,
                    Kind::Close => depth -= 1,
                    _ => {}
                }
            }
        }
    }

    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    /// Skips whitespace and comments; the byte where an unclosed block comment starts.
    fn skip_blank(&mut self) -> Result<(), usize> {
        loop {
            let rest = self.rest();
            let blank = rest.find(|c| !is_blank(c)).unwrap_or(rest.len());
            self.at += blank;
            let rest = &rest[blank..];
            if rest.starts_with("//") {
                self.at += rest.find('\n').unwrap_or(rest.len());
            } else if rest.starts_with("/*") {
                let start = self.at;
                self.at += block_comment_len(rest).ok_or(start)?;
            } else {
                return Ok(());
            }
        }
    }
}

impl Iterator for Tokens<'_> {
    type Item = Token;

    fn next(&mut self) -> Option<Token> {
        if let Err(start) = self.skip_blank() {
            self.at = self.text.len();
            let kind = Kind::Unclosed("block comment");
            return Some(Token {
                kind,
                start,
                end: self.at,
            });
        }
        let (kind, len) = first_token(self.rest())?;
        let start = self.at;
        self.at += len;
        Some(Token {
            kind,
            start,
            end: self.at,
        })
    }
}

/// The characters ron treats as whitespace.
fn is_blank(c: char) -> bool {
    matches!(
        c,
        ' ' | '\t'..='\r' | '\u{85}' | '\u{200E}' | '\u{200F}' | '\u{2028}' | '\u{2029}'
    )
}

/// Length of the nested block comment that `rest` starts with; `None` when it does not end.
fn block_comment_len(rest: &str) -> Option<usize> {
    let bytes = rest.as_bytes();
    let (mut depth, mut at) = (1usize, 2);
    while depth > 0 {
        at += bytes.get(at..)?.iter().position(|b| b"/*".contains(b))?;
        match bytes.get(at..at + 2) {
            Some(b"/*") => (depth, at) = (depth + 1, at + 2),
            Some(b"*/") => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
    }
    Some(at)
}

/// Kind and length of the token that `rest` starts with; `None` at the end.
fn first_token(rest: &str) -> Option<(Kind, usize)> {
    let first = rest.chars().next()?;
    Some(match first {
        '(' | '[' | '{' => (Kind::Open, 1),
        ')' | ']' | '}' => (Kind::Close, 1),
        ',' => (Kind::Comma, 1),
        ':' => (Kind::Colon, 1),
        '"' => string(rest, 1),
        '\'' => character(rest, 1),
        '0'..='9' | '+' | '-' | '.' => (Kind::Literal, number_len(rest)),
        'r' | 'b' => prefixed(rest),
        c if is_ident_start(c) => (Kind::Ident, ident_len(rest)),
        c => (Kind::Other, c.len_utf8()),
    })
}

fn is_ident_start(c: char) -> bool {
    c == '_' || c.is_alphabetic()
}

fn ident_len(rest: &str) -> usize {
    rest.find(|c: char| c != '_' && !c.is_alphanumeric())
        .unwrap_or(rest.len())
}

/// Something that starts with `r` or `b`: a raw or byte string, a raw identifier, or a plain identifier.
fn prefixed(rest: &str) -> (Kind, usize) {
    if rest.starts_with("b\"") {
        return string(rest, 2);
    }
    if rest.starts_with("b'") {
        return character(rest, 2);
    }
    let letters = if rest.starts_with("br") { 2 } else { 1 };
    if rest[letters - 1..].starts_with('r') {
        let hashes = rest[letters..].bytes().take_while(|&b| b == b'#').count();
        let quote = letters + hashes;
        if rest[quote..].starts_with('"') {
            let close = format!("\"{}", "#".repeat(hashes));
            return match rest[quote + 1..].find(&close) {
                Some(at) => (Kind::Literal, quote + 1 + at + close.len()),
                None => (Kind::Unclosed("raw string"), rest.len()),
            };
        }
        if letters == 1 && hashes == 1 {
            let raw = |c: char| c == '_' || c.is_alphanumeric() || matches!(c, '.' | '+' | '-');
            let len = rest[2..].find(|c| !raw(c)).unwrap_or(rest.len() - 2);
            return (Kind::Ident, 2 + len);
        }
    }
    (Kind::Ident, ident_len(rest))
}

/// A string whose first character after the quote is at `from`.
fn string(rest: &str, from: usize) -> (Kind, usize) {
    let mut escaped = false;
    for (at, byte) in rest.bytes().enumerate().skip(from) {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = true,
            b'"' => return (Kind::Literal, at + 1),
            _ => {}
        }
    }
    (Kind::Unclosed("string"), rest.len())
}

/// A character whose text is at `from`; a lone quote is [`Kind::Other`].
fn character(rest: &str, from: usize) -> (Kind, usize) {
    let mut chars = rest[from..].char_indices();
    let close = match chars.next() {
        // Escapes are short: `\u{10FFFF}` is the longest.
        Some((_, '\\')) => chars
            .skip(1)
            .take(10)
            .find(|&(_, c)| c == '\'')
            .map(|(at, _)| at),
        Some(_) => chars.next().filter(|&(_, c)| c == '\'').map(|(at, _)| at),
        None => None,
    };
    match close {
        Some(at) => (Kind::Literal, from + at + 1),
        None => (Kind::Other, from),
    }
}

/// Length of a number, or of what was meant as one: `1.5`, `-0x1F`, `1e-3`, `+inf`, `12abc`.
fn number_len(rest: &str) -> usize {
    let bytes = rest.as_bytes();
    let hex = rest.trim_start_matches(['+', '-']).starts_with("0x");
    let sign_belongs = |at: usize| at == 0 || (!hex && matches!(bytes[at - 1], b'e' | b'E'));
    rest.char_indices()
        .find(|&(at, c)| match c {
            '+' | '-' => !sign_belongs(at),
            c => !(c == '_' || c == '.' || c.is_alphanumeric()),
        })
        .map_or(rest.len(), |(at, _)| at)
}

/// Checks that every bracket, string and comment is closed.
///
/// On failure: the byte to point at, and what is wrong there.
pub(crate) fn check_closed(text: &str) -> Result<(), (usize, String)> {
    let mut open: Vec<usize> = Vec::new();
    let byte_at = |at: usize| char::from(text.as_bytes()[at]);
    for token in Tokens::new(text) {
        match token.kind {
            Kind::Open => open.push(token.start),
            Kind::Close => {
                let close = byte_at(token.start);
                let Some(start) = open.pop() else {
                    return Err((token.start, format!("`{close}` closes nothing")));
                };
                if matching(byte_at(start)) != close {
                    let (line, column) = line_column(text, start);
                    let opened = byte_at(start);
                    return Err((
                        token.start,
                        format!("`{close}` cannot close the `{opened}` of {line}:{column}"),
                    ));
                }
            }
            Kind::Unclosed(what) => {
                return Err((token.start, format!("this {what} is never closed")));
            }
            _ => {}
        }
    }
    match open.pop() {
        None => Ok(()),
        Some(start) => Err((start, format!("this `{}` is never closed", byte_at(start)))),
    }
}

fn matching(open: char) -> char {
    match open {
        '(' => ')',
        '[' => ']',
        _ => '}',
    }
}

/// Line and column of byte `at`, both from 1; columns count characters.
pub(crate) fn line_column(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    let line = 1 + before.bytes().filter(|&b| b == b'\n').count();
    (line, 1 + before[line_start..].chars().count())
}

/// Byte of a line and column, the reverse of [`line_column`]; the text's end when there is no such place.
pub(crate) fn byte_of(text: &str, line: usize, column: usize) -> usize {
    let mut start = 0;
    for _ in 1..line {
        match text[start..].find('\n') {
            Some(newline) => start += newline + 1,
            None => return text.len(),
        }
    }
    text[start..]
        .char_indices()
        .nth(column.saturating_sub(1))
        .map_or(text.len(), |(at, _)| start + at)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(text: &str) -> Vec<&str> {
        Tokens::new(text).map(|t| &text[t.range()]).collect()
    }

    #[test]
    fn strings_and_comments_hide_brackets() {
        let text = r##"a /* ( /* [ */ */ "(\"" r#"("#  '(' '\'' // {
            b'(' b"(" br"(" 1e-3-2"##;
        let expected = [
            "a",
            r#""(\"""#,
            r###"r#"("#"###,
            "'('",
            r"'\''",
            "b'('",
            "b\"(\"",
            "br\"(\"",
            "1e-3",
            "-2",
        ];
        assert_eq!(texts(text), expected, "tokens");
    }

    #[test]
    fn unclosed_things_are_named() {
        let message = |text| check_closed(text).expect_err("not closed");
        assert_eq!(message("(a: [1)").0, 6, "place of the wrong bracket");
        assert!(message("(a: [1)").1.contains("1:5"), "where it was opened");
        assert_eq!(message("(\n(").0, 2, "innermost open bracket");
        assert!(message("\"abc").1.contains("string"), "open string");
        assert!(message("/* /* */").1.contains("comment"), "open comment");
        assert!(message("}").1.contains("closes nothing"), "extra bracket");
    }

    #[test]
    fn places_go_both_ways() {
        let text = "a\r\nbé c\n\nx";
        for (at, _) in text.char_indices() {
            let (line, column) = line_column(text, at);
            assert_eq!(byte_of(text, line, column), at, "byte {at}");
        }
    }
}
