//! Where the scenes are that are measured.

use std::path::PathBuf;

/// A scene, and where it is.
pub(crate) struct Place {
    pub(crate) name: &'static str,
    pub(crate) path: PathBuf,
}

/// The built-in nave, and the paper's scenes where they are.
pub(crate) fn scenes() -> Vec<Place> {
    let nave = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/nave/scene.ron");
    let mut places = vec![Place {
        name: "nave",
        path: nave.into(),
    }];
    match std::env::var_os("MANYLIGHT_SCENES").map(PathBuf::from) {
        Some(folder) => places.extend(["sibenik", "sponza", "conference"].map(|name| Place {
            name,
            path: folder.join(name).join("scene.ron"),
        })),
        None => eprintln!("MANYLIGHT_SCENES is not set: only the nave is measured"),
    }
    places
}
