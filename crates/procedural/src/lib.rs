//! Built-in procedural scenes

/// One file of a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneFile {
    /// Path relative to the scene's folder, with `/` between parts: `textures/ashlar.png`.
    pub name: String,
    /// Contents.
    pub bytes: Vec<u8>,
}

/// Names of the built-in scenes.
pub const NAMES: &[&str] = &[];

/// All files of built-in scene `name`; `None` if there is no such scene.
pub fn files(_name: &str) -> Option<Vec<SceneFile>> {
    None
}
