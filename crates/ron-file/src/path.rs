//! Paths to values: `lights.count`, `geometry[0]`.

use std::fmt::Write;

/// One step of a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Step {
    Field(String),
    Index(usize),
}

/// Reads `a.b[2].c`; `None` when it is not a path.
pub(crate) fn parse(path: &str) -> Option<Vec<Step>> {
    let mut steps = Vec::new();
    for part in path.split('.') {
        let name_len = part.find('[').unwrap_or(part.len());
        let (name, mut indices) = part.split_at(name_len);
        let plain = |c: char| c == '_' || c.is_alphanumeric();
        if name.is_empty() || !name.chars().all(plain) {
            return None;
        }
        steps.push(Step::Field(name.to_owned()));
        while !indices.is_empty() {
            let (index, rest) = indices.strip_prefix('[')?.split_once(']')?;
            steps.push(Step::Index(index.parse().ok()?));
            indices = rest;
        }
    }
    Some(steps)
}

/// Writes a path as [`parse`] reads it; empty for the root.
pub(crate) fn show(steps: &[Step]) -> String {
    let mut path = String::new();
    for step in steps {
        // Writing to a string cannot fail.
        let _ = match step {
            Step::Field(name) if path.is_empty() => write!(path, "{name}"),
            Step::Field(name) => write!(path, ".{name}"),
            Step::Index(index) => write!(path, "[{index}]"),
        };
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_read_and_write() {
        for path in ["a", "a.b_2", "geometry[0]", "a[1][2].b"] {
            let steps = parse(path).expect("a path");
            assert_eq!(show(&steps), path, "round trip");
        }
        for bad in ["", ".", "a.", "a..b", "a[", "a[x]", "a b", "[0]", "a[0]b"] {
            assert_eq!(parse(bad), None, "{bad:?} is no path");
        }
    }
}
