//! A number that tells scenes apart by their content.

use std::fmt::{Debug, Write};

use scene::Scene;

/// FNV-1a, 64 bits: it finds accidents, and is no proof against malice.
///
/// Source: Fowler, Noll, Vo, draft-eastlake-fnv.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fnv(pub(crate) u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    /// Takes bytes one by one.
    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.word(u32::from(byte));
        }
    }

    /// Takes four bytes in the time of one.
    fn word(&mut self, word: u32) {
        self.0 = (self.0 ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3);
    }

    /// Takes a list and its length.
    fn words(&mut self, words: impl IntoIterator<Item = u32>) {
        let mut count = 0;
        for word in words {
            self.word(word);
            count += 1;
        }
        self.word(count);
    }

    /// Takes bytes, four at a time, and their number.
    pub(crate) fn file(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks();
        self.words(words.iter().map(|&word| u32::from_le_bytes(word)));
        self.bytes(rest);
    }

    /// Takes what `{:?}` shows, which tells floats apart to the bit.
    pub(crate) fn debug(&mut self, value: &impl Debug) {
        // Taking text cannot fail.
        let _ = write!(self, "{value:?};");
    }
}

impl Write for Fnv {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.bytes(text.as_bytes());
        Ok(())
    }
}

/// Depends on everything in the scene that a picture depends on, and not on where its files are.
pub(crate) fn fingerprint(scene: &Scene) -> u64 {
    let mut hash = Fnv::default();
    let mesh = &scene.mesh;
    for points in [&mesh.positions, &mesh.normals] {
        hash.words(points.iter().flat_map(|p| p.to_array().map(f32::to_bits)));
    }
    hash.words(mesh.uvs.iter().flat_map(|p| p.to_array().map(f32::to_bits)));
    for indices in [&mesh.indices, &mesh.normal_indices, &mesh.uv_indices] {
        hash.words(indices.iter().copied().flatten());
    }
    if !mesh.colours.is_empty() {
        let colours = mesh.colours.iter();
        hash.words(colours.flat_map(|c| c.to_array().map(f32::to_bits)));
        hash.words(mesh.colour_indices.iter().copied().flatten());
    }
    hash.words(mesh.materials.iter().map(|m| m.0));
    for texture in &scene.textures {
        hash.debug(&(texture.width, texture.height, texture.has_alpha));
        hash.words(texture.texels.iter().map(|&t| u32::from_le_bytes(t)));
    }
    hash.debug(&scene.materials);
    for emitter in &scene.emitters {
        hash.debug(emitter);
    }
    hash.words(scene.emissive.iter().map(|&emits| u32::from(emits)));
    if let Some(environment) = &scene.environment {
        hash.debug(&environment.size());
        let texels = environment.texels().iter();
        hash.words(texels.flat_map(|t| t.to_array().map(f32::to_bits)));
    }
    hash.debug(&scene.camera);
    hash.debug(&scene.metres_per_unit);
    hash.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use scene::Emitter;

    #[test]
    fn bytes_give_the_published_values() {
        let of = |text: &str| {
            let mut hash = Fnv::default();
            hash.bytes(text.as_bytes());
            hash.0
        };
        assert_eq!(of(""), 0xcbf2_9ce4_8422_2325, "nothing");
        assert_eq!(of("a"), 0xaf63_dc4c_8601_ec8c, "a");
        assert_eq!(of("foobar"), 0x8594_4171_f739_67e8, "foobar");
    }

    #[test]
    fn any_change_of_content_shows() {
        let scene = Scene::default();
        let mut seen = vec![fingerprint(&scene)];
        let changes: [fn(&mut Scene); 7] = [
            |s| s.mesh.positions.push(Vec3::ZERO),
            |s| s.mesh.normals.push(Vec3::ZERO),
            |s| s.mesh.indices.push([0; 3]),
            |s| s.environment = scene::Environment::constant(Vec3::ONE),
            |s| s.mesh.normal_indices.push([0; 3]),
            |s| s.camera.fov_y_deg = f32::from_bits(s.camera.fov_y_deg.to_bits() + 1),
            |s| {
                s.emitters.push(Emitter::Point {
                    position: Vec3::ZERO,
                    intensity: Vec3::ONE,
                });
            },
        ];
        for change in changes {
            let mut changed = scene.clone();
            change(&mut changed);
            let found = fingerprint(&changed);
            assert!(!seen.contains(&found), "a change of {seen:?} is not seen");
            seen.push(found);
        }
        let mut elsewhere = scene.clone();
        elsewhere.notes.remarks.push("anything".into());
        assert_eq!(fingerprint(&elsewhere), seen[0], "notes are no content");
    }
}
