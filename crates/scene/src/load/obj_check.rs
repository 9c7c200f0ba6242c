//! The check of an OBJ text, line by line, before tobj reads it.
//!
//! tobj's errors have no line numbers; it takes NaN, reads `l 1 2 3` as a triangle, and makes up the indices
//! that a corner lacks. So every line of interest is checked here and passed on in plain form, and what
//! tobj cannot tell (materials, which corners have what) is kept beside it.

use std::collections::{BTreeMap, HashMap};

use crate::SceneError;
use crate::load::lines;
use crate::load::scene_file::FARTHEST;

/// One `f` line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    /// Triangles it is cut into, at least 1.
    pub(super) triangles: u32,
    /// Index into [`Checked::materials`]; `None` before any `usemtl`.
    pub(super) material: Option<u32>,
    pub(super) has_uvs: bool,
    pub(super) has_normals: bool,
}

/// A checked OBJ text.
#[derive(Debug, Default)]
pub(super) struct Checked {
    /// The `v`, `vt`, `vn` and `f` lines; all indices are in range.
    pub(super) plain: String,
    /// In order.
    pub(super) faces: Vec<Face>,
    /// `mtllib` lines: number and what follows.
    pub(super) libraries: Vec<(usize, String)>,
    /// Names that `usemtl` gives, each with the first line that does.
    pub(super) materials: Vec<(usize, String)>,
    /// Keywords that have no effect here, with the first line and how often.
    pub(super) unused: BTreeMap<String, (usize, usize)>,
}

/// Number of elements of one kind so far, and the largest index used.
#[derive(Debug, Default, Clone, Copy)]
struct Count {
    so_far: usize,
    largest: usize,
    /// Line of `largest`.
    line: usize,
}

struct Check<'a> {
    shown: &'a str,
    line: usize,
    out: Checked,
    /// Vertices, texture coordinates, normals.
    counts: [Count; 3],
    material: Option<u32>,
    material_index: HashMap<String, u32>,
}

const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// Checks `text`; `shown` is its name for messages.
pub(super) fn check(shown: &str, text: &str) -> Result<Checked, SceneError> {
    let mut check = Check {
        shown,
        line: 0,
        out: Checked {
            plain: String::with_capacity(text.len()),
            ..Checked::default()
        },
        counts: [Count::default(); 3],
        material: None,
        material_index: HashMap::new(),
    };
    for (line, content) in lines(text) {
        check.line = line;
        check.line(&content)?;
    }
    check.end()
}

impl Check<'_> {
    fn error<T>(&self, message: impl Into<String>) -> Result<T, SceneError> {
        Err(SceneError::line(self.shown, self.line, message))
    }

    fn line(&mut self, content: &str) -> Result<(), SceneError> {
        let content = content.trim();
        let (key, rest) = content
            .split_once(|c: char| c.is_ascii_whitespace())
            .unwrap_or((content, ""));
        match key {
            "" => Ok(()),
            "v" => self.vertex(content, rest),
            "vt" => self.texture_coordinate(content, rest),
            "vn" => self.normal(content, rest),
            "f" => self.face(rest),
            "usemtl" => self.use_material(rest.trim()),
            "mtllib" => {
                let name = rest.trim().to_owned();
                if name.is_empty() {
                    return self.error("mtllib: there is no file name");
                }
                self.out.libraries.push((self.line, name));
                Ok(())
            }
            // Names, groups and smoothing say nothing about where the surface is.
            "o" | "g" | "s" => Ok(()),
            key if key.starts_with('#') => Ok(()),
            key => {
                let key = key.chars().take(32).collect();
                let entry = self.out.unused.entry(key).or_insert((self.line, 0));
                entry.1 += 1;
                Ok(())
            }
        }
    }

    /// Reads up to `N` numbers of `rest`: how many there are, and whether a comment follows.
    fn numbers<const N: usize>(
        &self,
        key: &str,
        rest: &str,
        at_least: usize,
    ) -> Result<([f32; N], usize, bool), SceneError> {
        let (mut numbers, mut count) = ([0.0; N], 0);
        for word in rest.split_ascii_whitespace() {
            if word.starts_with('#') {
                return self
                    .enough(key, rest, count, at_least, N)
                    .map(|()| (numbers, count, true));
            }
            if let Some(slot) = numbers.get_mut(count) {
                *slot = match word.parse::<f32>() {
                    Ok(number) if number.abs() <= FARTHEST => number,
                    Ok(_) => {
                        let limits = format!("expected -{FARTHEST:e} to {FARTHEST:e}");
                        return self.error(format!("{key}: found {word}; {limits}"));
                    }
                    Err(_) => return self.error(format!("{key}: '{word}' is not a number")),
                };
            }
            count += 1;
        }
        self.enough(key, rest, count, at_least, N)?;
        Ok((numbers, count, false))
    }

    fn enough(
        &self,
        key: &str,
        rest: &str,
        count: usize,
        at_least: usize,
        at_most: usize,
    ) -> Result<(), SceneError> {
        if (at_least..=at_most).contains(&count) {
            return Ok(());
        }
        let rest: String = rest.trim().chars().take(60).collect();
        self.error(format!(
            "{key}: found {count} numbers ({rest}); expected {at_least} to {at_most}"
        ))
    }

    fn keep(&mut self, content: &str) {
        self.out.plain.push_str(content);
        self.out.plain.push('\n');
    }

    fn vertex(&mut self, content: &str, rest: &str) -> Result<(), SceneError> {
        let (numbers, count, comment) = self.numbers::<6>("v", rest, 3)?;
        let [x, y, z, w, ..] = numbers;
        match count {
            3 if !comment => self.keep(content),
            // Colours of vertices have no effect here.
            3 | 6 => self.keep(&format!("v {x} {y} {z}")),
            4 => {
                let point = [x, y, z].map(|c| c / w);
                // The comparison is false for NaN.
                if !point.iter().all(|c| c.abs() <= FARTHEST) {
                    return self.error(format!("v: x, y, z over w = {w} is not a point"));
                }
                let [x, y, z] = point;
                self.keep(&format!("v {x} {y} {z}"));
            }
            _ => {
                return self
                    .error("v: found 5 numbers; expected 3, 4 (x y z w) or 6 (x y z r g b)");
            }
        }
        self.counts[0].so_far += 1;
        Ok(())
    }

    fn texture_coordinate(&mut self, content: &str, rest: &str) -> Result<(), SceneError> {
        let ([u, v, _], count, comment) = self.numbers::<3>("vt", rest, 1)?;
        match count {
            2 if !comment => self.keep(content),
            _ => self.keep(&format!("vt {u} {v}")),
        }
        self.counts[1].so_far += 1;
        Ok(())
    }

    fn normal(&mut self, content: &str, rest: &str) -> Result<(), SceneError> {
        let ([x, y, z], _, comment) = self.numbers::<3>("vn", rest, 3)?;
        match comment {
            false => self.keep(content),
            true => self.keep(&format!("vn {x} {y} {z}")),
        }
        self.counts[2].so_far += 1;
        Ok(())
    }

    fn face(&mut self, rest: &str) -> Result<(), SceneError> {
        let plain = &mut self.out.plain;
        plain.push('f');
        let (mut corners, mut first_has) = (0u32, [false; 3]);
        for word in rest.split_ascii_whitespace() {
            if word.starts_with('#') {
                break;
            }
            let has = corner(word, self.line, &mut self.counts)
                .map_err(|message| SceneError::line(self.shown, self.line, message))?;
            if corners == 0 {
                first_has = has;
            } else if has != first_has {
                let i = if has[1] == first_has[1] { 2 } else { 1 };
                let kind = KINDS[i];
                return self.error(format!(
                    "f: corner `{word}` differs from the face's first in having a {kind} or not"
                ));
            }
            self.out.plain.push(' ');
            self.out.plain.push_str(word);
            corners = corners.saturating_add(1);
        }
        self.out.plain.push('\n');
        if corners < 3 {
            return self.error(format!("f: found {corners} corners; expected at least 3"));
        }
        self.out.faces.push(Face {
            triangles: corners - 2,
            material: self.material,
            has_uvs: first_has[1],
            has_normals: first_has[2],
        });
        Ok(())
    }

    fn use_material(&mut self, name: &str) -> Result<(), SceneError> {
        if name.is_empty() {
            return self.error("usemtl: there is no material name");
        }
        let id = match self.material_index.get(name) {
            Some(&id) => id,
            None => {
                // One line each: fewer than 2³² in any text that fits in memory.
                let id = u32::try_from(self.out.materials.len()).unwrap_or(u32::MAX);
                self.out.materials.push((self.line, name.to_owned()));
                self.material_index.insert(name.to_owned(), id);
                id
            }
        };
        self.material = Some(id);
        Ok(())
    }

    /// Indices may point forward, so the largest ones are compared at the end.
    fn end(mut self) -> Result<Checked, SceneError> {
        for (count, kind) in self.counts.into_iter().zip(KINDS) {
            if count.largest > count.so_far {
                self.line = count.line;
                return self.error(format!(
                    "{kind} index {} out of range; the file has {}",
                    count.largest, count.so_far
                ));
            }
        }
        let triangles: u64 = self.out.faces.iter().map(|f| u64::from(f.triangles)).sum();
        let most = u64::from(u32::MAX / 3);
        if triangles > most || self.counts[0].so_far as u64 > most {
            let message = format!("{triangles} triangles; expected at most {most}");
            return Err(SceneError::file(self.shown, message));
        }
        Ok(self.out)
    }
}

/// Checks `v`, `v/vt`, `v//vn` or `v/vt/vn`; which of the three are there.
fn corner(word: &str, line: usize, counts: &mut [Count; 3]) -> Result<[bool; 3], String> {
    let mut has = [false; 3];
    for (i, index) in word.split('/').enumerate() {
        let Some(count) = counts.get_mut(i) else {
            return Err(format!("f: corner `{word}` has more than three indices"));
        };
        if index.is_empty() {
            continue;
        }
        has[i] = true;
        let kind = KINDS[i];
        let value: i64 = index
            .parse()
            .map_err(|_| format!("f: `{word}`: '{index}' is not a {kind} index"))?;
        let magnitude = usize::try_from(value.unsigned_abs()).unwrap_or(usize::MAX);
        match value {
            0 => return Err(format!("f: {kind} index 0; indices count from 1")),
            1.. if magnitude > count.largest => {
                count.largest = magnitude;
                count.line = line;
            }
            1.. => {}
            _ if magnitude > count.so_far => {
                let so_far = count.so_far;
                return Err(format!(
                    "f: {kind} index {value} out of range; the file has {so_far} so far"
                ));
            }
            _ => {}
        }
    }
    match has[0] {
        true => Ok(has),
        false => Err(format!("f: corner `{word}` has no vertex index")),
    }
}
