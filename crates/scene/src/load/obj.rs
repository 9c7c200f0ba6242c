//! OBJ files: checked by [`obj_check`](super::obj_check), read by tobj, added to the mesh.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use tobj::LoadOptions;

use crate::load::obj_check::{Checked, Face, check};
use crate::load::source::{Source, join};
use crate::load::{Parts, lenient_text, mtl, unreadable};
use crate::{ABSENT, MaterialId, Mesh, SceneError};

/// Adds the file called `name` to `parts`. Polygons become fans of triangles around their first corner.
pub(super) fn read(
    parts: &mut Parts,
    source: &Source,
    name: &str,
    bytes: &[u8],
) -> Result<(), SceneError> {
    let shown = source.shown(name);
    let text = lenient_text(&shown, bytes, &mut parts.notes)?;
    let checked = check(&shown, &text)?;
    for (key, (line, count)) in &checked.unused {
        let remark = format!("{shown}:{line}: `{key}` has no effect ({count} in all)");
        parts.notes.remarks.push(remark);
    }
    let materials = materials(parts, source, name, &checked)?;
    let options = LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..LoadOptions::default()
    };
    // The plain text names no library.
    let no_library = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut checked.plain.as_bytes(), &options, no_library)
        .map_err(|e| SceneError::file(&shown, e.to_string()))?;
    // One model: the plain text has no names that would divide it.
    for model in &models {
        append(parts, &model.mesh, &checked.faces, &materials)
            .map_err(|message| SceneError::file(&shown, message))?;
    }
    Ok(())
}

/// Reads the material libraries, and finds the material of every `usemtl` name.
fn materials(
    parts: &mut Parts,
    source: &Source,
    name: &str,
    checked: &Checked,
) -> Result<Vec<MaterialId>, SceneError> {
    let shown = source.shown(name);
    let mut known: HashMap<String, usize> = HashMap::new();
    for (line, rest) in &checked.libraries {
        let wrong = |m: String| SceneError::line(&shown, *line, format!("mtllib: {m}"));
        // A name with spaces, or several names.
        let whole = join(name, rest).map_err(wrong)?;
        let files = match source.has(&whole) || !rest.contains(char::is_whitespace) {
            true => vec![whole],
            false => {
                let names = rest.split_whitespace().map(|file| join(name, file));
                names.collect::<Result<_, _>>().map_err(wrong)?
            }
        };
        for file in files {
            let bytes = source.read(&file);
            let bytes = bytes.map_err(|e| wrong(unreadable(source, &file, &e)))?;
            known.extend(mtl::read(parts, source, &file, &bytes)?);
        }
    }
    let used = checked.materials.iter().map(|(line, name)| {
        let id = known.get(name).copied().ok_or_else(|| {
            let message = match checked.libraries.is_empty() {
                true => {
                    format!("usemtl: material `{name}` is not defined; the file has no mtllib line")
                }
                false => format!(
                    "usemtl: material `{name}` is not defined in the files that mtllib names"
                ),
            };
            SceneError::line(&shown, *line, message)
        })?;
        Ok(MaterialId(u32::try_from(id).unwrap_or(u32::MAX)))
    });
    used.collect()
}

/// Adds what tobj read to the mesh. Fails when the mesh grows too large for 32-bit indices.
fn append(
    parts: &mut Parts,
    read: &tobj::Mesh,
    faces: &[Face],
    materials: &[MaterialId],
) -> Result<(), String> {
    let mesh = &mut parts.mesh;
    let most = u32::MAX as usize / 3;
    if mesh.indices.len() + read.indices.len() / 3 > most
        || mesh.positions.len() + read.positions.len() / 3 > most
    {
        return Err(format!(
            "the scene has too many triangles; expected at most {most}"
        ));
    }
    let first = |count: usize| u32::try_from(count).unwrap_or(ABSENT);
    let first_position = first(mesh.positions.len());
    let first_normal = first(mesh.normals.len());
    let first_uv = first(mesh.uvs.len());

    mesh.positions.extend(
        read.positions
            .as_chunks()
            .0
            .iter()
            .map(|&p| Vec3::from_array(p)),
    );
    mesh.uvs.extend(
        read.texcoords
            .as_chunks()
            .0
            .iter()
            .map(|&t| Vec2::from_array(t)),
    );
    let normals = read.normals.as_chunks().0.iter().map(|&n| {
        // In f64: the length of a short normal can underflow in f32.
        let unit = Vec3::from_array(n).as_dvec3().normalize_or_zero();
        unit.as_vec3()
    });
    mesh.normals.extend(normals);
    let new_normals = &mesh.normals[first_normal as usize..];
    let zero = |n: &&Vec3| **n == Vec3::ZERO;
    parts.notes.zero_normals += new_normals.iter().filter(zero).count();

    let mut corners = read.indices.as_chunks::<3>().0.iter();
    let mut uvs = read.texcoord_indices.as_chunks::<3>().0.iter();
    let mut normals = read.normal_indices.as_chunks::<3>().0.iter();
    for face in faces {
        let material = face
            .material
            .and_then(|m| materials.get(m as usize).copied());
        let material = material.unwrap_or_default();
        for _ in 0..face.triangles {
            // tobj has one entry a corner in each of these, or none at all.
            let Some(corner) = corners.next() else {
                return Err("the faces do not come out as counted".to_owned());
            };
            let uv = uvs.next().filter(|_| face.has_uvs);
            let normal = normals.next().filter(|_| face.has_normals);
            let normal = normal.map(|n| n.map(|i| first_normal + i));
            let normal = normal.filter(|n| all_unit(mesh, n));
            mesh.indices.push(corner.map(|i| first_position + i));
            mesh.uv_indices
                .push(uv.map_or([ABSENT; 3], |t| t.map(|i| first_uv + i)));
            mesh.normal_indices.push(normal.unwrap_or([ABSENT; 3]));
            mesh.materials.push(material);
        }
    }
    Ok(())
}

/// Whether the three normals all have a direction.
fn all_unit(mesh: &Mesh, normals: &[u32; 3]) -> bool {
    normals
        .iter()
        .all(|&i| mesh.normals[i as usize] != Vec3::ZERO)
}

#[cfg(test)]
mod tests {
    use procedural::SceneFile;

    use super::*;

    #[test]
    fn a_built_in_scene_is_read_from_memory() {
        let file = |name: &str, text: &str| SceneFile {
            name: name.to_owned(),
            bytes: text.as_bytes().to_vec(),
        };
        let files = [
            file(
                "scene.obj",
                "mtllib scene.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3",
            ),
            file("scene.mtl", "newmtl a\nKd 1\nmap_Kd textures\\t.png"),
        ];
        let source = Source::Memory {
            folder: "builtin:test".to_owned(),
            files: files.to_vec().into(),
        };
        let mut parts = Parts {
            materials: vec![crate::Material::default()],
            ..Parts::default()
        };
        let bytes = source.read("scene.obj").expect("a file");
        read(&mut parts, &source, "scene.obj", &bytes).expect("a scene");
        assert_eq!(parts.mesh.len(), 1, "triangles");
        assert_eq!(parts.mesh.materials[0].0, 1, "its material");
        let error = parts.textures.all()[0].load().expect_err("no such texture");
        let error = error.to_string();
        let expected = "builtin:test/scene.mtl:3: map_Kd: builtin:test/textures/t.png: ";
        assert!(error.starts_with(expected), "{error}");
    }
}
