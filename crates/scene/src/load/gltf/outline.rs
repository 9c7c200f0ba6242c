//! What is read before the rest of a file: which nodes are hidden, and where its animations are, which are passed over.

use std::borrow::Cow;

use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::value::RawValue;

/// The parts of a document that the glTF crate's types lack, or refuse although nothing here depends on them: an
/// animation's target need not be a node (`KHR_animation_pointer`).
#[derive(Debug, Deserialize)]
pub(super) struct Outline<'a> {
    #[serde(borrow)]
    animations: Option<&'a RawValue>,
    #[serde(default)]
    nodes: Vec<Node>,
}

#[derive(Debug, Deserialize)]
struct Node {
    extensions: Option<Extensions>,
}

#[derive(Debug, Deserialize)]
struct Extensions {
    #[serde(rename = "KHR_node_visibility")]
    visibility: Option<Visibility>,
}

/// Source: Khronos, "KHR_node_visibility".
#[derive(Debug, Deserialize)]
struct Visibility {
    #[serde(default = "by_default")]
    visible: bool,
}

fn by_default() -> bool {
    true
}

impl<'a> Outline<'a> {
    pub(super) fn read(json: &'a [u8]) -> serde_json::Result<Self> {
        serde_json::from_slice(json)
    }

    /// Whether the node, and with it all below it, is not to be seen.
    pub(super) fn hides(&self, node: usize) -> bool {
        let extensions = self.nodes.get(node).and_then(|n| n.extensions.as_ref());
        let visibility = extensions.and_then(|e| e.visibility.as_ref());
        visibility.is_some_and(|visibility| !visibility.visible)
    }

    /// The document with an empty list of animations, all else at its line and column; and how many there were.
    ///
    /// `json` is what the outline was read from.
    pub(super) fn without_animations(&self, json: &'a [u8]) -> (Cow<'a, [u8]>, usize) {
        let animations = self.animations.map_or("", RawValue::get);
        let Ok(list) = serde_json::from_str::<Vec<IgnoredAny>>(animations) else {
            return (Cow::Borrowed(json), 0);
        };
        // The text is borrowed from the document.
        let from = animations.as_ptr().addr() - json.as_ptr().addr();
        let mut rest = json.to_vec();
        let range = &mut rest[from..][..animations.len()];
        let inner = 1..range.len() - 1;
        let inner = range[inner].iter_mut();
        inner.filter(|c| **c != b'\n').for_each(|c| *c = b' ');
        (Cow::Owned(rest), list.len())
    }
}
