//! Scenes built in code: nothing to download, the same bytes everywhere.
//!
//! A scene is a list of files, exactly those a user would put in a folder: `scene.ron`, the
//! OBJ and MTL it names, its lights and its textures. The renderer reads them from memory;
//! `manylight scene <name>` writes them out.
//!
//! `mesh` gathers triangles; `sweep`, `arch` and `polygon` make mouldings, arches and
//! walls with openings; `obj`, `materials`, `textures` and `lights` turn the result into
//! files. `nave` is the one scene so far: a domed church in the manner of Šibenik cathedral.
//!
//! Angles go through `trig` and randomness through integer hashes, so that no platform's
//! rounding shows in the output.

mod arch;
mod lights;
mod materials;
mod mesh;
mod nave;
mod noise;
mod obj;
mod polygon;
mod sweep;
mod textures;
mod trig;

/// One file of a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneFile {
    /// Path relative to the scene's folder, with `/` between parts: `textures/ashlar.png`.
    pub name: String,
    /// Contents.
    pub bytes: Vec<u8>,
}

/// Names of the built-in scenes.
pub const NAMES: &[&str] = &["nave"];

/// All files of built-in scene `name` (`scene.ron`, `scene.obj`, `scene.mtl`, `lights.ron` and
/// `textures/*.png`); `None` if there is no such scene.
///
/// Deterministic: the same bytes on every call, platform and number of threads.
pub fn files(name: &str) -> Option<Vec<SceneFile>> {
    match name {
        "nave" => Some(nave::files()),
        _ => None,
    }
}
