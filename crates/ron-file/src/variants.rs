//! Bare variants: `kind: Vsl` for `kind: Vsl()`, and `kind: Vsl((radius: 1))` for `kind: Vsl(radius: 1)`.

use crate::edit::Edited;
use crate::scan::{Kind, Token, Tokens};

/// Gives the variants named in `names` the one form that ron reads for both struct variants and variants
/// that hold a struct (ron's extension `unwrap_variant_newtypes`).
pub(crate) fn normalise(edited: &mut Edited, names: &[&str]) {
    if names.is_empty() {
        return;
    }
    let tokens: Vec<Token> = Tokens::new(edited.text()).collect();
    let text = edited.text();
    let (mut bare, mut doubled) = (Vec::new(), Vec::new());
    for (i, token) in tokens.iter().enumerate() {
        if token.kind != Kind::Ident || !names.contains(&&text[token.range()]) {
            continue;
        }
        let after = &tokens[i + 1..];
        match after.first().map(|t| (t.kind, &text[t.range()])) {
            Some((Kind::Colon, _) | (_, "(")) => doubled.extend(second_pair(text, after)),
            _ => bare.push(token.end),
        }
    }
    doubled.sort_unstable();
    edited.blank(&doubled);
    edited.insert_at(&bare, "()");
}

/// The inner parentheses of `((name: …))`, where `tokens` begin with that.
fn second_pair(text: &str, tokens: &[Token]) -> Vec<usize> {
    let [outer, inner, key, colon, rest @ ..] = tokens else {
        return Vec::new();
    };
    let opens = |token: &Token| &text[token.range()] == "(";
    let is_struct = key.kind == Kind::Ident && colon.kind == Kind::Colon;
    if !(opens(outer) && opens(inner) && is_struct) {
        return Vec::new();
    }
    let mut depth = 1usize;
    let end = rest.iter().position(|token| {
        match token.kind {
            Kind::Open => depth += 1,
            Kind::Close => depth -= 1,
            _ => {}
        }
        depth == 0
    });
    let Some(end) = end else { return Vec::new() };
    let mut places = vec![inner.start, rest[end].start];
    // `Foo((a: 1,),)`: one comma is enough, and only one is allowed.
    let comma = |at: Option<&Token>| at.filter(|t| t.kind == Kind::Comma).map(|t| t.start);
    let inner_comma = comma(end.checked_sub(1).and_then(|before| rest.get(before)));
    if inner_comma.is_some() {
        places.extend(comma(rest.get(end + 1)));
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normal(text: &str) -> String {
        let mut edited = Edited::new(text);
        normalise(&mut edited, &["Vsl", "Foo"]);
        edited.text().to_owned()
    }

    #[test]
    fn only_bare_variants_get_parentheses() {
        assert_eq!(normal("(kind: Vsl)"), "(kind: Vsl())", "bare");
        assert_eq!(
            normal("[Vsl, Vsl /* ( */]"),
            "[Vsl(), Vsl() /* ( */]",
            "twice"
        );
        assert_eq!(normal("Vsl (a: 1)"), "Vsl (a: 1)", "with fields");
        assert_eq!(
            normal("(Vsl: 1, b: \"Vsl\")"),
            "(Vsl: 1, b: \"Vsl\")",
            "key, string"
        );
        assert_eq!(normal("VslX"), "VslX", "other name");
    }

    #[test]
    fn doubled_parentheses_become_one_pair() {
        assert_eq!(normal("Foo((a: (1, 2)))"), "Foo( a: (1, 2) )", "plain");
        assert_eq!(normal("Foo((a: 1,),)"), "Foo( a: 1,  )", "commas");
        assert_eq!(normal("Foo((1, 2))"), "Foo((1, 2))", "a tuple stays");
    }
}
