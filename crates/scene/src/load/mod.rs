//! Reading `scene.ron`, glTF, OBJ, MTL, textures and files of lights.
//!
//! Scene files are untrusted: every number is checked, nothing panics, and names in files cannot leave the
//! scene's folder. What is dropped is counted in [`LoadNotes`].

mod decode;
mod emissive;
mod environment;
mod gltf;
mod lights;
mod mtl;
mod obj;
mod obj_check;
mod place;
mod scene_file;
mod source;
mod texture;
mod weed;

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rayon::prelude::*;

use crate::{CameraSpec, Emitter, LoadNotes, Material, Mesh, Scene, SceneError, Texture};
use scene_file::SceneFile;
pub use scene_file::SoundCamera;
use source::Source;
pub use source::{SCENE_FOLDER, expand};

/// A `scene.ron` with every field and every kind of light, and what they mean in comments.
pub const ANNOTATED: &str = include_str!("annotated.ron");

/// Variants with fields that a `scene.ron` may write without parentheses.
const BARE: &[&str] = &["Environment", "FromFile"];

/// What geometry files add to.
#[derive(Debug, Default)]
struct Parts {
    mesh: Mesh,
    materials: Vec<Material>,
    textures: texture::WantedList,
    /// Materials whose opacity is a texture's alpha, and 1 where it has none.
    alpha_maps: Vec<usize>,
    /// The first one that a file has.
    camera: Option<CameraSpec>,
    /// Lights of the files in photometric units: candela where watts per steradian are meant, lux for W/m².
    lights: Vec<Emitter>,
    notes: LoadNotes,
}

/// Says whether so many bytes more may be taken; else a message that begins with them.
pub type Fits<'a> = &'a dyn Fn(u64) -> Result<(), String>;

/// Reads a scene, whatever memory it takes. `path` names a `scene.ron`, or a glTF file with its own camera and lights, and may begin with an
/// environment variable (`$MANYLIGHT_SCENES/sibenik/scene.ron`).
///
/// A scene without triangles or without lights is legal, and black.
///
/// # Errors
///
/// When a file is missing or holds anything that cannot be rendered as it says; see [`SceneError`].
pub fn load(path: &Path) -> Result<Scene, SceneError> {
    load_within(path, &|_| Ok(()))
}

/// Reads a scene as [`load`] does, but asks before it decodes pictures: by their headers, all textures together.
///
/// # Errors
///
/// As [`load`], and when pictures do not fit.
pub fn load_within(path: &Path, fits: Fits<'_>) -> Result<Scene, SceneError> {
    let path = match path.to_str() {
        Some(text) => expand(text)?,
        None => path.to_owned(),
    };
    let shown = path.display().to_string();
    let bytes = match gltf_name(&path) {
        Some(name) => format!("(geometry: [{name:?}], lights: [FromFile, Emissive])").into_bytes(),
        None => std::fs::read(&path).map_err(|source| SceneError::Io {
            path: shown.clone(),
            source,
        })?,
    };
    let text = ron_file::text(&shown, &bytes)?;
    let file: SceneFile = ron_file::parse(&shown, text, &[], BARE)?;
    let here = SceneText {
        shown: &shown,
        text,
        folder: Source::Disk(path.parent().unwrap_or(Path::new("")).to_owned()),
        built_in: RefCell::default(),
        fits,
    };

    let mut parts = Parts {
        materials: vec![Material::default()],
        ..Parts::default()
    };
    for (i, name) in file.geometry.iter().enumerate() {
        let field = format!("geometry[{i}]");
        let (source, name) = here.resolve(&field, name)?;
        let is_gltf = is_gltf(&name);
        if !is_gltf && !name.to_ascii_lowercase().ends_with(".obj") {
            let message =
                format!("{name}: geometry of this kind is not read; expected .obj, .gltf or .glb");
            return Err(here.error(&field, message));
        }
        let bytes = source.read(&name);
        let bytes = bytes.map_err(|e| here.error(&field, unreadable(&source, &name, &e)))?;
        match is_gltf {
            true => gltf::read(&mut parts, &source, &name, &bytes)?,
            false => obj::read(&mut parts, &source, &name, &bytes)?,
        }
    }
    let lights = lights::read(&file.lights, &here, &parts.lights, &mut parts.notes)?;
    let camera = file.camera.map(|camera| camera.0).or(parts.camera);
    let camera = camera.ok_or_else(|| {
        let message = "there is none, and no geometry file has one in perspective; expected \
                       (origin: (x, y, z), target: (x, y, z), up: (0, 1, 0), fov_y_deg: 60.0)";
        here.error("camera", message)
    })?;
    texture::refuse_too_large(parts.textures.all(), fits)
        .map_err(|message| SceneError::file(&shown, message))?;
    let Parts {
        mut mesh,
        mut materials,
        mut notes,
        alpha_maps,
        textures,
        ..
    } = parts;
    let load_all = || -> Vec<_> {
        textures
            .all()
            .par_iter()
            .map(texture::Wanted::load)
            .collect()
    };
    let (textures, ()) = rayon::join(load_all, || weed::weed(&mut mesh, &mut notes));
    let textures: Vec<Texture> = textures.into_iter().collect::<Result<_, _>>()?;

    for material in alpha_maps {
        let map = &mut materials[material].opacity_map;
        *map = map.filter(|map| textures[map.0 as usize].has_alpha);
    }
    drop_height_maps(&mut materials, &textures, &mut notes);
    if mesh.is_empty() {
        let message = "the scene has no triangles: every picture of it is black";
        notes.remarks.push(message.to_owned());
    }
    if !lights.emissive {
        notes.ignored_emissive_materials = emissive_in_use(&mesh, &materials);
    }
    let mut scene = Scene {
        mesh,
        materials,
        textures,
        emitters: lights.emitters,
        emissive: Vec::new(),
        environment: lights.environment,
        camera,
        origin: glam::Vec3::ZERO,
        metres_per_unit: file.metres_per_unit.0,
        notes,
    };
    place::check_extent(&scene.mesh).map_err(|message| SceneError::file(&shown, message))?;
    place::centre(&mut scene);
    if lights.emissive {
        emissive::find(&mut scene);
    }
    Ok(scene)
}

fn is_gltf(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.ends_with(".gltf") || name.ends_with(".glb")
}

/// The file's name, if that is the one of a glTF file, which [`load`] reads without a `scene.ron`.
pub fn gltf_name(path: &Path) -> Option<&str> {
    let name = path.file_name()?.to_str()?;
    is_gltf(name).then_some(name)
}

/// `map_Bump` may name a map of heights or one of normals, which only the texels tell.
fn drop_height_maps(materials: &mut [Material], textures: &[Texture], notes: &mut LoadNotes) {
    let mut dropped = BTreeSet::new();
    for material in materials {
        let map = material.normal_map.map(|map| &textures[map.0 as usize]);
        if let Some(map) = map.filter(|map| map.is_grey()) {
            material.normal_map = None;
            dropped.insert(&map.path);
        }
    }
    for path in dropped {
        let remark = format!("{path} is a map of heights, which has no effect; normal maps have");
        notes.remarks.push(remark);
    }
}

/// Emissive materials that some triangle has.
fn emissive_in_use(mesh: &Mesh, materials: &[Material]) -> usize {
    let mut used = vec![false; materials.len()];
    for id in &mesh.materials {
        used[id.0 as usize] = true;
    }
    let emits = |m: &Material| m.emission.max_element() > 0.0;
    let in_use = materials.iter().zip(used);
    in_use
        .filter(|(material, used)| *used && emits(material))
        .count()
}

/// The text of `scene.ron`, for names and for errors found after it was read.
struct SceneText<'a> {
    shown: &'a str,
    text: &'a str,
    folder: Source,
    /// Built-in scenes in use: making one takes time.
    built_in: RefCell<BTreeMap<String, Source>>,
    fits: Fits<'a>,
}

impl SceneText<'_> {
    /// An error about the value of `field`.
    fn error(&self, field: &str, message: impl AsRef<str>) -> SceneError {
        let place = ron_file::place(self.text, field);
        let place = place.unwrap_or(ron_file::Place { line: 1, column: 1 });
        SceneError::Ron(ron_file::RonError::File {
            file: self.shown.to_owned(),
            line: place.line,
            column: place.column,
            message: format!("{field}: {}", message.as_ref()),
        })
    }

    fn built_in(&self, scene: &str) -> Result<Source, String> {
        let mut known = self.built_in.borrow_mut();
        if let Some(source) = known.get(scene) {
            return Ok(source.clone());
        }
        let source = Source::built_in(scene)?;
        known.insert(scene.to_owned(), source.clone());
        Ok(source)
    }

    /// The source of a file that `field` names, and the file's name there.
    ///
    /// `a/b.obj` is relative to `scene.ron`; `builtin:nave/scene.obj` is built in; a name that begins with
    /// an environment variable brings its own folder.
    fn resolve(&self, field: &str, name: &str) -> Result<(Source, String), SceneError> {
        if let Some(built_in) = name.strip_prefix("builtin:") {
            let (scene, file) = built_in.split_once('/').unwrap_or((built_in, ""));
            let source = self.built_in(scene).map_err(|m| self.error(field, m))?;
            let file = source::join("", file).map_err(|m| self.error(field, m))?;
            return Ok((source, file));
        }
        if name.starts_with('$') {
            let path = expand(name).map_err(|e| self.error(field, e.to_string()))?;
            let file = path.file_name().and_then(|file| file.to_str());
            let file = file.ok_or_else(|| self.error(field, format!("`{name}` names no file")))?;
            let folder = path.parent().unwrap_or(Path::new(""));
            return Ok((Source::Disk(folder.to_owned()), file.to_owned()));
        }
        let file = source::join("scene.ron", name).map_err(|m| self.error(field, m))?;
        Ok((self.folder.clone(), file))
    }
}

/// A message for a file that could not be read.
fn unreadable(source: &Source, name: &str, error: &std::io::Error) -> String {
    format!("{}: {error}", source.shown(name))
}

/// The text in a file's bytes; bytes that are not UTF-8 (old files with accents in comments) are replaced,
/// with a remark.
fn lenient_text(shown: &str, bytes: &[u8], notes: &mut LoadNotes) -> Result<String, SceneError> {
    if bytes.contains(&0) {
        let message = "the file has zero bytes; expected a text file in UTF-8 or ASCII";
        return Err(SceneError::file(shown, message));
    }
    let text = String::from_utf8_lossy(bytes);
    if matches!(text, std::borrow::Cow::Owned(_)) {
        let remark = format!("{shown}: some bytes are not UTF-8 and were replaced by \u{FFFD}");
        notes.remarks.push(remark);
    }
    Ok(text.trim_start_matches('\u{FEFF}').to_owned())
}

/// The logical lines of OBJ and MTL text with the number of their first line: a line that ends in `\` goes
/// on in the next one.
fn lines<'a>(text: &'a str) -> impl Iterator<Item = (usize, std::borrow::Cow<'a, str>)> {
    use std::borrow::Cow;
    let mut physical = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (number, first) = physical.next()?;
        let Some(start) = first.strip_suffix('\\') else {
            return Some((number + 1, Cow::Borrowed(first)));
        };
        let mut whole = start.to_owned();
        for (_, next) in physical.by_ref() {
            whole.push(' ');
            match next.strip_suffix('\\') {
                Some(part) => whole.push_str(part),
                None => {
                    whole.push_str(next);
                    break;
                }
            }
        }
        Some((number + 1, Cow::Owned(whole)))
    })
}
