//! A text under edit that remembers where each byte came from.

use std::ops::Range;

/// Where a byte of an edited text came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Origin {
    /// This byte of the file.
    File(usize),
    /// Put in at this byte of the file to please ron.
    Inserted(usize),
    /// The override with this index.
    Set(usize),
}

impl Origin {
    /// Origin of the byte `by` bytes further on.
    fn advanced(self, by: usize) -> Self {
        match self {
            Self::File(at) => Self::File(at + by),
            same => same,
        }
    }
}

/// A text under edit. Pieces are (first byte, origin of that byte), in order, the first at 0.
#[derive(Debug)]
pub(crate) struct Edited {
    text: String,
    pieces: Vec<(usize, Origin)>,
}

impl Edited {
    pub(crate) fn new(text: &str) -> Self {
        Self {
            text: text.to_owned(),
            pieces: vec![(0, Origin::File(0))],
        }
    }

    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    /// Where byte `at` came from.
    pub(crate) fn origin(&self, at: usize) -> Origin {
        let next = self.pieces.partition_point(|&(start, _)| start <= at);
        match next.checked_sub(1).map(|piece| self.pieces[piece]) {
            Some((start, origin)) => origin.advanced(at - start),
            None => Origin::File(at),
        }
    }

    /// Puts `with` in place of `range`; it is override number `set`.
    pub(crate) fn replace(&mut self, range: Range<usize>, with: &str, set: usize) {
        let after = self.origin(range.end);
        let kept = self
            .pieces
            .partition_point(|&(start, _)| start < range.start);
        let tail = self
            .pieces
            .partition_point(|&(start, _)| start <= range.end);
        let new_end = range.start + with.len();
        let tail: Vec<_> = self.pieces[tail..]
            .iter()
            .map(|&(start, origin)| (start - range.end + new_end, origin))
            .collect();
        self.pieces.truncate(kept);
        self.pieces.push((range.start, Origin::Set(set)));
        self.pieces.push((new_end, after));
        self.pieces.extend(tail);
        self.text.replace_range(range, with);
    }

    /// Puts `with` in at every byte of `places`, which ascend.
    pub(crate) fn insert_at(&mut self, places: &[usize], with: &str) {
        let mut text = String::with_capacity(self.text.len() + places.len() * with.len());
        let mut pieces = Vec::with_capacity(self.pieces.len() + 2 * places.len());
        let mut old = self.pieces.iter().copied().peekable();
        let mut copied = 0;
        for &place in places {
            while let Some((start, origin)) = old.next_if(|&(start, _)| start <= place) {
                pieces.push((start + text.len() - copied, origin));
            }
            text.push_str(&self.text[copied..place]);
            let before = self.origin(place.saturating_sub(1));
            let inserted = match before {
                Origin::File(at) => Origin::Inserted(at),
                same => same,
            };
            pieces.push((text.len(), inserted));
            text.push_str(with);
            pieces.push((text.len(), self.origin(place)));
            copied = place;
        }
        pieces.extend(old.map(|(start, origin)| (start + text.len() - copied, origin)));
        text.push_str(&self.text[copied..]);
        (self.text, self.pieces) = (text, pieces);
    }

    /// Blanks one-byte characters, which keeps every place.
    pub(crate) fn blank(&mut self, places: &[usize]) {
        for &place in places {
            self.text.replace_range(place..place + 1, " ");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_survive_edits() {
        let mut edited = Edited::new("abc def ghi");
        edited.replace(4..7, "12345", 0);
        edited.replace(0..1, "", 1);
        assert_eq!(edited.text(), "bc 12345 ghi", "text after two edits");
        edited.insert_at(&[2, 8], "()");
        assert_eq!(edited.text(), "bc() 12345() ghi", "text after insertions");
        let origins: Vec<Origin> = (0..16).map(|at| edited.origin(at)).collect();
        assert_eq!(origins[0], Origin::File(1), "b");
        assert_eq!(origins[2..4], [Origin::Inserted(2); 2], "first ()");
        assert_eq!(origins[4], Origin::File(3), "first space");
        assert_eq!(
            origins[5..12],
            [Origin::Set(0); 7],
            "the override and its ()"
        );
        assert_eq!(origins[12], Origin::File(7), "second space");
        assert_eq!(origins[13], Origin::File(8), "g");
    }
}
