//! Overrides: `--set lights.count=2000`.

use std::str::FromStr;

use serde::de::IgnoredAny;

use crate::edit::Edited;
use crate::explain;
use crate::path::{self, Step};
use crate::tree::Tree;
use crate::{RonError, options};

/// One field's value from the command line, in place of the file's or added to it.
///
/// A path goes through an enum variant as if its fields were the field's own: `lights.count` is `count`
/// in `lights: Virtual(count: 5)`. List elements have indices: `geometry[0]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Override {
    /// Field names joined by dots.
    pub path: String,
    /// One RON value.
    pub value: String,
}

impl Override {
    fn error(&self, message: impl Into<String>) -> RonError {
        RonError::Set {
            set: self.to_string(),
            message: message.into(),
        }
    }
}

impl FromStr for Override {
    type Err = RonError;

    /// Reads `PATH=VALUE`. The value is looked at only when it is used.
    fn from_str(text: &str) -> Result<Self, RonError> {
        let (path, value) = text.split_once('=').ok_or_else(|| RonError::Set {
            set: text.to_owned(),
            message: "expected PATH=VALUE, for example image.spp=16".to_owned(),
        })?;
        Ok(Self {
            path: path.trim().to_owned(),
            value: value.trim().to_owned(),
        })
    }
}

impl std::fmt::Display for Override {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={}", self.path, explain::shortened(&self.value))
    }
}

/// Puts every override into the text, in order.
pub(crate) fn apply(
    edited: &mut Edited,
    overrides: &[Override],
    variants_with_fields: &[&str],
) -> Result<(), RonError> {
    for (index, set) in overrides.iter().enumerate() {
        let steps = path::parse(&set.path).ok_or_else(|| {
            set.error("the part before `=` is not a path; expected field names joined by dots")
        })?;
        let value = one_value(set)?;
        let edit = plan(edited.text(), &steps, value, variants_with_fields);
        let (range, text) = edit.map_err(|message| set.error(message))?;
        edited.replace(range, &text, index);
    }
    Ok(())
}

/// The value's text without the blanks and comments around it.
fn one_value(set: &Override) -> Result<&str, RonError> {
    if set.value.is_empty() {
        return Err(set.error("there is no value behind `=`"));
    }
    if let Err((_, message)) = crate::scan::check_closed(&set.value) {
        return Err(set.error(message));
    }
    if let Err(error) = options().from_str::<IgnoredAny>(&set.value) {
        let message = explain::syntax(&set.value, &error);
        let quotes = "text needs quotes: 'scene=\"a.ron\"'";
        return Err(set.error(format!("the value is not RON: {message} ({quotes})")));
    }
    let tree = Tree::new(&set.value);
    Ok(tree.root().map_or(&set.value, |root| tree.value(root)))
}

type Edit = (std::ops::Range<usize>, String);

/// What to write where, so that the value at `steps` becomes `value`; else why that cannot be.
fn plan(
    text: &str,
    steps: &[Step],
    value: &str,
    variants_with_fields: &[&str],
) -> Result<Edit, String> {
    let tree = Tree::new(text);
    let mut at = tree.root().ok_or("the file is empty")?;
    for (i, step) in steps.iter().enumerate() {
        if let Some(child) = tree.child(at, step) {
            at = child;
            continue;
        }
        let here = match i {
            0 => "the file".to_owned(),
            _ => format!("`{}`", path::show(&steps[..i])),
        };
        let Step::Field(name) = step else {
            let message = format!(
                "{here} has no element {}",
                path::show(std::slice::from_ref(step))
            );
            return Err(message);
        };
        let Some(value) = within(&steps[i + 1..], value) else {
            let whole = path::show(&steps[..=i]);
            return Err(format!(
                "{here} has no field `{name}` to set `{}` in; set `{whole}` as a whole",
                path::show(&steps[i + 1..])
            ));
        };
        return add_field(&tree, at, name, &value, variants_with_fields).ok_or_else(|| {
            let found = explain::shortened(tree.value(at));
            format!("{here} is {found}, which has no field `{name}`")
        });
    }
    Ok((tree.node(at).span.clone(), value.to_owned()))
}

/// The value in structs that are not there yet: `(b: (c: value))` for the path `b.c`; `None` where the path
/// goes through a list.
fn within(steps: &[Step], value: &str) -> Option<String> {
    let mut text = value.to_owned();
    for step in steps.iter().rev() {
        let Step::Field(name) = step else {
            return None;
        };
        text = format!("({name}: {text})");
    }
    Some(text)
}

/// Adds `name: value` to the struct or variant `at`; `None` where it has no named fields.
fn add_field(
    tree: &Tree<'_>,
    at: usize,
    name: &str,
    value: &str,
    variants_with_fields: &[&str],
) -> Option<Edit> {
    let at = tree.holder(at);
    let node = tree.node(at);
    let Some(inside) = &node.inside else {
        let takes_fields = variants_with_fields.contains(&tree.value(at));
        let end = node.span.end..node.span.end;
        return takes_fields.then(|| (end, format!("({name}: {value})")));
    };
    let keyed = |&child: &usize| tree.node(child).key.is_some();
    if !tree.has_parentheses(at) || !node.children.iter().all(keyed) {
        return None;
    }
    let comma = if node.children.is_empty() { "" } else { ", " };
    Some((
        inside.start..inside.start,
        format!("{name}: {value}{comma}"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "(image: (width: 9, spp: 4), lights: Virtual(kind: Vsl, count: 5), m: Foo((a: 1)), p: (1, 2), i: Direct, e: ())";

    fn set(text: &str, sets: &[&str]) -> Result<String, String> {
        let mut edited = Edited::new(text);
        let sets: Result<Vec<Override>, _> = sets.iter().map(|s| s.parse()).collect();
        let sets = sets.map_err(|e| e.to_string())?;
        apply(&mut edited, &sets, &["Vsl"]).map_err(|e| e.to_string())?;
        Ok(edited.text().to_owned())
    }

    #[test]
    fn values_are_replaced_and_added() {
        for (sets, expected) in [
            (&["image.spp=16 // x"][..], "width: 9, spp: 16)"),
            (&["lights.count=1"], "Virtual(kind: Vsl, count: 1)"),
            (&["lights.kind.radius=2.0"], "kind: Vsl(radius: 2.0), count"),
            (
                &["lights.kind=Vpl", "lights.count=7"],
                "Virtual(kind: Vpl, count: 7)",
            ),
            (&["m.a=2", "m.b=3"], "Foo((b: 3, a: 2))"),
            (&["e.x=(1, 2)", "e.x[1]=5"], "e: (x: (1, 5))"),
            (
                &["i=Path(max_bounces: 5)", "i.max_bounces=6"],
                "i: Path(max_bounces: 6)",
            ),
            (&["seed=4"], "(seed: 4, image:"),
            (&["a.b=1", "a.c=2"], "(a: (c: 2, b: 1), image:"),
            (&["image.x.y.z=1"], "image: (x: (y: (z: 1)), width: 9"),
        ] {
            let text = set(FILE, sets).expect("overrides apply");
            assert!(text.contains(expected), "{sets:?} gave {text}");
        }
    }

    #[test]
    fn what_cannot_be_set_is_refused() {
        for (sets, expected) in [
            (
                "a[0]=1",
                "the file has no field `a` to set `[0]` in; set `a` as a whole",
            ),
            (
                "image.x.y[1]=1",
                "`image` has no field `x` to set `y[1]` in",
            ),
            ("image.spp.x=1", "`image.spp` is 4, which has no field `x`"),
            ("i.x=1", "`i` is Direct, which has no field `x`"),
            ("p.x=1", "`p` is (1, 2), which has no field `x`"),
            ("p[2]=1", "`p` has no element [2]"),
            ("seed", "expected PATH=VALUE"),
            ("=1", "not a path"),
            ("a..b=1", "not a path"),
            ("seed=", "no value"),
            ("seed=1 2", "not RON"),
            ("seed=1, image: 3", "not RON"),
            ("seed=(1", "never closed"),
            ("seed=1)", "closes nothing"),
            ("seed=\"x", "never closed"),
        ] {
            let error = set(FILE, &[sets]).expect_err(sets);
            assert!(error.contains(expected), "{sets} gave {error}");
            assert!(error.starts_with("--set "), "{sets} gave {error}");
        }
    }
}
