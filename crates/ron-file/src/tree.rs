//! The shape of a RON text: which bytes hold which field.
//!
//! Built only for overrides and for error messages, never to get a value. It takes any text whose
//! brackets match, right or wrong, and needs no stack however deep the text nests.

use std::ops::Range;

use crate::path::Step;
use crate::scan::{Kind, Tokens};

/// One value, with the key before it.
#[derive(Debug, Default, Clone)]
pub(crate) struct Node {
    /// Bytes of the key, where the value has one.
    pub(crate) key: Option<Range<usize>>,
    /// Bytes of the value; empty when there is none (`a: ,`).
    pub(crate) span: Range<usize>,
    /// Whether the value is an identifier, perhaps with brackets behind it.
    pub(crate) named: bool,
    /// Bytes between the brackets.
    pub(crate) inside: Option<Range<usize>>,
    /// Values between the brackets.
    pub(crate) children: Vec<usize>,
    /// A key was read, its value not yet.
    awaits_value: bool,
}

/// All values of a text.
#[derive(Debug)]
pub(crate) struct Tree<'a> {
    text: &'a str,
    nodes: Vec<Node>,
}

impl<'a> Tree<'a> {
    pub(crate) fn new(text: &'a str) -> Self {
        let mut nodes = vec![Node::default()];
        let root = 0;
        // (group, the item of it that is being read)
        let mut groups: Vec<(usize, Option<usize>)> = vec![(root, None)];
        for token in Tokens::after_attributes(text) {
            let Some((group, item)) = groups.last_mut() else {
                break;
            };
            if token.kind == Kind::Comma {
                if item.take().is_none() {
                    // Two commas in a row: the value between them is missing, but has a number.
                    nodes.push(Node {
                        span: token.start..token.start,
                        ..Node::default()
                    });
                    let missing = nodes.len() - 1;
                    nodes[*group].children.push(missing);
                }
                continue;
            }
            if token.kind == Kind::Close {
                if groups.len() > 1
                    && let Some((closed, _)) = groups.pop()
                {
                    let node: &mut Node = &mut nodes[closed];
                    if let Some(inside) = &mut node.inside {
                        inside.end = token.start;
                    }
                    node.span.end = token.end;
                }
                continue;
            }
            let fresh = item.is_none();
            let at = *item.get_or_insert_with(|| {
                nodes.push(Node::default());
                let new = nodes.len() - 1;
                nodes[*group].children.push(new);
                new
            });
            let node = &mut nodes[at];
            if token.kind == Kind::Colon && node.key.is_none() && !fresh {
                *node = Node {
                    key: Some(node.span.clone()),
                    span: token.end..token.end,
                    awaits_value: true,
                    ..Node::default()
                };
                continue;
            }
            if fresh || node.awaits_value {
                node.awaits_value = false;
                node.span = token.range();
                node.named = token.kind == Kind::Ident;
            } else {
                node.span.end = token.end;
            }
            if token.kind == Kind::Open {
                // A second group in one item is a mistake; its values join the first one's.
                node.inside = Some(token.end..token.end);
                groups.push((at, None));
            }
        }
        Self { text, nodes }
    }

    pub(crate) fn node(&self, at: usize) -> &Node {
        &self.nodes[at]
    }

    /// Text of a value.
    pub(crate) fn value(&self, at: usize) -> &'a str {
        &self.text[self.nodes[at].span.clone()]
    }

    fn key(&self, at: usize) -> Option<&'a str> {
        let key = self.nodes[at].key.clone()?;
        let key = &self.text[key];
        Some(key.strip_prefix("r#").unwrap_or(key))
    }

    /// The text's own value; `None` in an empty text.
    pub(crate) fn root(&self) -> Option<usize> {
        self.nodes[0].children.first().copied()
    }

    /// Whether the value ends in a `(…)` group.
    pub(crate) fn has_parentheses(&self, at: usize) -> bool {
        let inside = self.nodes[at].inside.as_ref();
        inside.is_some_and(|inside| self.text[..inside.start].ends_with('('))
    }

    /// The one value without a key in the parentheses of `at`, when it has parentheses itself.
    fn wrapped(&self, at: usize) -> Option<usize> {
        match self.nodes[at].children[..] {
            [only] if self.has_parentheses(at) && self.has_parentheses(only) => {
                self.nodes[only].key.is_none().then_some(only)
            }
            _ => None,
        }
    }

    /// The value that holds the fields of `at`: itself, or the one struct inside `Foo((a: 1))`, `Some(…)`.
    pub(crate) fn holder(&self, mut at: usize) -> usize {
        while let Some(inner) = self.wrapped(at) {
            at = inner;
        }
        at
    }

    /// The children of `at` that are called `name`, in order.
    pub(crate) fn fields(&self, at: usize, name: &str) -> impl Iterator<Item = usize> {
        let children = &self.nodes[self.holder(at)].children;
        children
            .iter()
            .copied()
            .filter(move |&child| self.key(child) == Some(name))
    }

    /// One step down from `at`.
    pub(crate) fn child(&self, at: usize, step: &Step) -> Option<usize> {
        match step {
            Step::Field(name) => self.fields(at, name).next(),
            Step::Index(index) => {
                let node = &self.nodes[at];
                // `Points([…])`: the list inside a variant.
                let list = match node.children[..] {
                    [only] if node.named && self.value(only).starts_with('[') => only,
                    _ => at,
                };
                self.nodes[list].children.get(*index).copied()
            }
        }
    }

    /// The value at `path` from the root.
    pub(crate) fn find(&self, path: &[Step]) -> Option<usize> {
        path.iter()
            .try_fold(self.root()?, |at, step| self.child(at, step))
    }

    /// Path of the innermost value whose key or text covers byte `at`.
    pub(crate) fn path_to(&self, at: usize) -> Vec<Step> {
        let mut path = Vec::new();
        let Some(mut here) = self.root() else {
            return path;
        };
        loop {
            let inner = self.nodes[here].children.iter().position(|&child| {
                let node = &self.nodes[child];
                let start = node.key.as_ref().unwrap_or(&node.span).start;
                start <= at && at < node.span.end
            });
            let Some(index) = inner else {
                return path;
            };
            let is_wrap = self.wrapped(here).is_some();
            let siblings = &self.nodes[here].children;
            let siblings_have_keys = siblings.iter().any(|&s| self.nodes[s].key.is_some());
            here = siblings[index];
            match self.key(here) {
                Some(name) => path.push(Step::Field(name.to_owned())),
                None if is_wrap => {}
                // A field that lacks its colon.
                None if siblings_have_keys => return path,
                None => path.push(Step::Index(index)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::parse;

    fn value(text: &str, path: &str) -> Option<String> {
        let tree = Tree::new(text);
        let steps = parse(path).expect("a path");
        tree.find(&steps).map(|at| tree.value(at).to_owned())
    }

    #[test]
    fn fields_are_found_through_names_and_single_wraps() {
        let text = "(a: V(kind: Vsl, n: 5), b: Foo((c: (1, 2))), d: Some((e: 3)), l: P([7, 8]))";
        let found = |path| value(text, path).unwrap_or_default();
        assert_eq!(found("a.kind"), "Vsl", "inside a variant");
        assert_eq!(found("a"), "V(kind: Vsl, n: 5)", "the variant itself");
        assert_eq!(found("b.c"), "(1, 2)", "through a wrap");
        assert_eq!(found("b.c[1]"), "2", "tuple element");
        assert_eq!(found("d.e"), "3", "through Some");
        assert_eq!(found("l[0]"), "7", "list inside a variant");
        assert_eq!(value(text, "a.x"), None, "no such field");
        assert_eq!(value(text, "a.n.x"), None, "a number has no field");
    }

    #[test]
    fn depth_does_not_matter() {
        let text = "(".repeat(200_000) + &")".repeat(200_000);
        let tree = Tree::new(&text);
        assert!(tree.root().is_some(), "a deep text has a root");
        assert!(tree.path_to(100_000).len() <= 200_000, "and places in it");
    }
}
