//! Scenes that are fetched separately: `MANYLIGHT_SCENES=… cargo test --release -- --ignored`.

use std::path::Path;
use std::time::Instant;

#[test]
#[ignore = "needs the folder that MANYLIGHT_SCENES names"]
fn every_fetched_scene_loads() {
    let root = std::env::var("MANYLIGHT_SCENES").expect("MANYLIGHT_SCENES is set");
    let folders = std::fs::read_dir(root).expect("the folder can be read");
    for folder in folders {
        let path = folder.expect("an entry").path();
        let name = path.file_name().expect("a name").to_owned();
        if !path.join("scene.ron").is_file() {
            continue;
        }
        let path = Path::new("$MANYLIGHT_SCENES").join(&name).join("scene.ron");
        let start = Instant::now();
        let scene = manylight_scene::load::load(&path).unwrap_or_else(|e| panic!("{e}"));
        let seconds = start.elapsed().as_secs_f64();
        eprintln!(
            "{name:?}: {seconds:.3} s, {} triangles, {} materials, {} textures, {} lights, {:#?}",
            scene.mesh.len(),
            scene.materials.len(),
            scene.textures.len(),
            scene.emitters.len(),
            scene.notes
        );
        assert!(!scene.mesh.is_empty(), "{name:?} has triangles");
        assert!(!scene.emitters.is_empty(), "{name:?} has lights");
    }
}
