//! glTF files load, mean what they say, and are refused where they are broken. All are made here.

use std::collections::BTreeMap;
use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_4};
use std::path::Path;

use base64::Engine;
use glam::Vec3;
use image::{DynamicImage, ImageFormat};
use manylight_scene::trace::{Ray, Tracer};
use manylight_scene::{ABSENT, Emitter, MaterialId, Scene, SceneError, load::load};
use serde_json::{Value, json};

const CAMERA: &str = "camera: (origin: (0, 1, 5), target: (0, 1, 0), up: (0, 1, 0), fov_y_deg: 60)";

/// A glTF document that grows by accessors.
struct Doc {
    json: Value,
    bin: Vec<u8>,
}

impl Doc {
    fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [], "materials": [], "buffers": [{}],
        });
        Self {
            json,
            bin: Vec::new(),
        }
    }

    /// Appends to a list of the document; the new item's index.
    fn push(&mut self, list: &str, item: Value) -> usize {
        let object = self.json.as_object_mut().expect("an object");
        let list = object.entry(list).or_insert_with(|| json!([]));
        let list = list.as_array_mut().expect("a list");
        list.push(item);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend(bytes);
        let view = json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()});
        self.push("bufferViews", view)
    }

    fn floats<const N: usize>(&mut self, items: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = items
            .iter()
            .flatten()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let view = self.view(&bytes);
        let kind = format!("VEC{N}");
        let count = items.len();
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5126, "count": count, "type": kind}),
        )
    }

    fn indices(&mut self, items: &[u16]) -> usize {
        let bytes: Vec<u8> = items.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let count = items.len();
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5123, "count": count, "type": "SCALAR"}),
        )
    }

    /// The square 0..1 in the plane z = 0, seen from +z, with normals and coordinates; its mesh.
    fn square(&mut self, material: Option<usize>) -> usize {
        let positions = self.floats(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
        let normals = self.floats(&[[0., 0., 1.]; 4]);
        // v points down in glTF.
        let uvs = self.floats(&[[0., 1.], [1., 1.], [1., 0.], [0., 0.]]);
        let indices = self.indices(&[0, 1, 2, 0, 2, 3]);
        let mut primitive = json!({
            "attributes": {"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs}, "indices": indices,
        });
        if let Some(material) = material {
            primitive["material"] = material.into();
        }
        self.push("meshes", json!({"primitives": [primitive]}))
    }

    /// A node at the root of the scene.
    fn node(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        let roots = self.json["scenes"][0]["nodes"].as_array_mut();
        roots.expect("a list").push(index.into());
        index
    }

    /// A picture of one texel held in the buffer; the texture.
    fn texture(&mut self, texel: [u8; 4], alpha: bool) -> usize {
        let view = self.view(&png(texel, alpha));
        let image = self.push(
            "images",
            json!({"bufferView": view, "mimeType": "image/png"}),
        );
        self.push("textures", json!({"source": image}))
    }

    /// The document with its buffer in a data URI.
    fn text(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bin);
        json["buffers"][0] = json!({
            "byteLength": self.bin.len(), "uri": format!("data:application/octet-stream;base64,{data}"),
        });
        json.to_string().into_bytes()
    }

    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"][0] = json!({"byteLength": self.bin.len()});
        let mut json = json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut out = b"glTF".to_vec();
        for word in [2, 28 + json.len() + bin.len(), json.len()] {
            out.extend((word as u32).to_le_bytes());
        }
        out.extend(b"JSON");
        out.extend(json);
        out.extend((bin.len() as u32).to_le_bytes());
        out.extend(b"BIN\0");
        out.extend(bin);
        out
    }

    fn load(&self, lights: &str) -> Scene {
        let text = self.text();
        with_file("a.gltf", &text, lights).unwrap_or_else(|e| panic!("{e}"))
    }

    /// What is wrong with it.
    fn error(&self) -> String {
        with_file("a.gltf", &self.text(), "")
            .expect_err("refused")
            .to_string()
    }
}

fn png(texel: [u8; 4], alpha: bool) -> Vec<u8> {
    let picture = image::RgbaImage::from_pixel(1, 1, image::Rgba(texel));
    let picture = DynamicImage::from(picture);
    let picture = if alpha {
        picture
    } else {
        picture.into_rgb8().into()
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, ImageFormat::Png)
        .expect("a PNG");
    bytes.into_inner()
}

fn with_file(name: &str, bytes: &[u8], lights: &str) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = format!("(geometry: [{name:?}], {CAMERA}, lights: [{lights}])");
    std::fs::write(folder.path().join("scene.ron"), scene).expect("a file");
    std::fs::write(folder.path().join(name), bytes).expect("a file");
    load(&folder.path().join("scene.ron"))
}

fn corners(scene: &Scene) -> Vec<[[f32; 3]; 3]> {
    let all = 0..scene.mesh.len();
    all.map(|t| scene.mesh.corners(t).map(Into::into)).collect()
}

/// What is seen from `from` along `direction`.
fn seen(scene: &Scene, from: Vec3, direction: Vec3) -> manylight_scene::Surface {
    let ray = Ray {
        origin: from,
        direction,
        t_max: f32::INFINITY,
    };
    let hit = Tracer::build(scene).closest(&ray).expect("a hit");
    scene.surface(&hit, direction)
}

#[test]
fn a_box_loads_alike_from_json_and_glb() {
    let mut doc = Doc::new();
    // Eight corners, twelve triangles, without normals or material.
    let corner = |i: u8| [i & 1, i >> 1 & 1, i >> 2].map(f32::from);
    let positions = doc.floats(&(0..8).map(corner).collect::<Vec<_>>());
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let split = faces
        .iter()
        .flat_map(|&[a, b, c, d]| [a, b, c, a, c, d])
        .collect::<Vec<u16>>();
    let indices = doc.indices(&split);
    let primitive = json!({"attributes": {"POSITION": positions}, "indices": indices});
    let mesh = doc.push("meshes", json!({"primitives": [primitive]}));
    doc.node(json!({"mesh": mesh, "name": "box"}));
    let scene = doc.load("");
    assert_eq!(scene.mesh.len(), 12, "triangles");
    assert_eq!(scene.mesh.positions.len(), 8, "vertices stay shared");
    assert!(
        scene.mesh.normal_indices.is_empty() && scene.mesh.uv_indices.is_empty(),
        "no attributes"
    );
    assert_eq!(
        scene.mesh.materials[0],
        MaterialId(0),
        "the default material"
    );
    for t in 0..12 {
        let [a, b, c] = scene.mesh.corners(t);
        let outward = (a + b + c) / 3.0 - 0.5;
        assert!(
            (b - a).cross(c - a).dot(outward) > 0.0,
            "triangle {t} turns outward"
        );
    }
    let glb = with_file("a.glb", &doc.glb(), "").expect("a scene");
    assert_eq!(corners(&glb), corners(&scene), "GLB");
}

#[test]
fn nodes_place_instances_and_mirrors_turn_nothing_inside_out() {
    let mut doc = Doc::new();
    let mesh = doc.square(None);
    doc.node(json!({"mesh": mesh, "translation": [0, 0, -5]}));
    // Mirrored in x and scaled unevenly, below a parent that turns by 90° about y.
    let child = doc.push(
        "nodes",
        json!({"mesh": mesh, "scale": [-2, 3, 1], "translation": [0, 10, 0]}),
    );
    let turn = json!({"rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2], "children": [child]});
    doc.node(turn);
    let scene = doc.load("");
    assert_eq!(scene.mesh.len(), 4, "two triangles each");
    assert_eq!(
        corners(&scene)[0],
        [[0., 0., -5.], [1., 0., -5.], [1., 1., -5.]],
        "moved"
    );
    // x goes to −z, then mirrored; the front, which was +z, faces +x.
    let far = scene
        .mesh
        .corners(2)
        .into_iter()
        .chain(scene.mesh.corners(3));
    let most = far.fold(Vec3::MIN, Vec3::max);
    assert!(most.distance(Vec3::new(0.0, 13.0, 2.0)) < 1e-5, "{most}");
    for t in 2..4 {
        let [a, b, c] = scene.mesh.corners(t);
        let ng = (b - a).cross(c - a).normalize();
        assert!(ng.distance(Vec3::X) < 1e-5, "triangle {t} faces {ng}");
        let n = scene.mesh.normals[scene.mesh.normal_indices[t][0] as usize];
        assert!(n.distance(Vec3::X) < 1e-5, "its normals point to {n}");
    }
}

#[test]
fn normals_stay_at_right_angles_under_uneven_scales() {
    let mut doc = Doc::new();
    let positions = doc.floats(&[[0., 0., 0.], [1., 0., -1.], [0., 1., 0.]]);
    let slope = [FRAC_1_SQRT_2, 0., FRAC_1_SQRT_2];
    let normals = doc.floats(&[slope; 3]);
    let attributes = json!({"POSITION": positions, "NORMAL": normals});
    let mesh = doc.push(
        "meshes",
        json!({"primitives": [{"attributes": attributes}]}),
    );
    // A matrix, by columns: x is stretched.
    doc.node(json!({"mesh": mesh, "matrix": [4,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}));
    let scene = doc.load("");
    let [a, b, _] = scene.mesh.corners(0);
    let n = scene.mesh.normals[0];
    assert!(
        n.dot((b - a).normalize()).abs() < 1e-6,
        "{n} along {}",
        b - a
    );
}

#[test]
fn strips_fans_and_sparse_accessors_are_triangles_too() {
    for (mode, expected) in [(5, [[0, 1, 2], [2, 1, 3]]), (6, [[0, 1, 2], [0, 2, 3]])] {
        let mut doc = Doc::new();
        let at = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [1., 1., 1.]];
        let positions = doc.floats(&at);
        let primitive = json!({"attributes": {"POSITION": positions}, "mode": mode});
        let mesh = doc.push("meshes", json!({"primitives": [primitive]}));
        doc.node(json!({"mesh": mesh}));
        let expected = expected.map(|t: [usize; 3]| t.map(|i| at[i]));
        assert_eq!(corners(&doc.load("")), expected, "mode {mode}");
    }
    let mut doc = Doc::new();
    let mesh = doc.square(None);
    doc.node(json!({"mesh": mesh}));
    let (index, value) = (doc.view(&2u16.to_le_bytes()), doc.view(&[0; 12]));
    let at = doc.bin.len() - 12;
    for (i, x) in [5.0f32, 6.0, 7.0].into_iter().enumerate() {
        doc.bin[at + 4 * i..][..4].copy_from_slice(&x.to_le_bytes());
    }
    doc.json["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": {"bufferView": index, "componentType": 5123}, "values": {"bufferView": value},
    });
    assert_eq!(corners(&doc.load(""))[0][2], [5., 6., 7.], "put in");
    let normal = doc.push(
        "accessors",
        json!({"componentType": 5126, "count": 4, "type": "VEC3"}),
    );
    doc.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = normal.into();
    assert_eq!(
        doc.load("").notes.zero_normals,
        4,
        "without bytes all are zero"
    );
}

#[test]
fn whole_numbers_are_scaled_as_they_say() {
    let mut doc = Doc::new();
    let mesh = doc.square(None);
    doc.node(json!({"mesh": mesh}));
    let bytes: Vec<u8> = [
        [0, 0, 0, 0],
        [127, 0, 0, 0],
        [127, 127, 0, 0],
        [0, 127, 129, 0],
    ]
    .concat();
    let view = doc.view(&bytes);
    doc.json["bufferViews"][view]["byteStride"] = 4.into();
    let accessor = json!({"bufferView": view, "componentType": 5120, "count": 4, "type": "VEC3", "normalized": true});
    doc.json["accessors"][0] = accessor;
    let scene = doc.load("");
    assert_eq!(corners(&scene)[1][2], [0., 1., -1.], "bytes with a stride");
}

#[test]
fn a_textured_square_shows_each_map_where_it_belongs() {
    let mut doc = Doc::new();
    let picture =
        image::RgbImage::from_fn(1, 2, |_, y| image::Rgb([if y == 0 { 255 } else { 0 }; 3]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    DynamicImage::from(picture)
        .write_to(&mut bytes, ImageFormat::Png)
        .expect("a PNG");
    let data = base64::engine::general_purpose::STANDARD.encode(bytes.into_inner());
    let image = doc.push(
        "images",
        json!({"uri": format!("data:image/png;base64,{data}")}),
    );
    let base = doc.push("textures", json!({"source": image}));
    let rough_metal = doc.texture([7, 128, 51, 255], false);
    let bump = doc.texture([192, 128, 192, 255], false);
    let material = doc.push(
        "materials",
        json!({
            "name": "m", "emissiveFactor": [1, 0.5, 0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}},
            "normalTexture": {"index": bump, "scale": 0.5},
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 0.25, 1, 1], "baseColorTexture": {"index": base},
                "roughnessFactor": 0.8, "metallicFactor": 0.5,
                "metallicRoughnessTexture": {"index": rough_metal},
            },
        }),
    );
    let mesh = doc.square(Some(material));
    doc.node(json!({"mesh": mesh}));
    let scene = doc.load("Emissive");
    assert_eq!(scene.emitters.len(), 2, "two triangles shine");
    assert_eq!(
        scene.materials[1].emission,
        Vec3::new(4.0, 2.0, 0.0),
        "emission times strength"
    );

    let top = seen(&scene, Vec3::new(0.5, 0.75, 1.0), Vec3::NEG_Z);
    let metallic = 0.5 * 51.0 / 255.0;
    let base = Vec3::new(0.5, 0.25, 1.0);
    assert!(
        top.brdf.diffuse.distance(base * (1.0 - metallic)) < 1e-5,
        "white above: {}",
        top.brdf.diffuse
    );
    let specular = Vec3::splat(0.04).lerp(base, metallic);
    assert!(
        top.brdf.specular.distance(specular) < 1e-5,
        "metalness is blue: {}",
        top.brdf.specular
    );
    let alpha = (0.8f32 * 128.0 / 255.0).powi(2);
    assert!(
        (top.brdf.alpha - alpha).abs() < 1e-6,
        "roughness is green: {}",
        top.brdf.alpha
    );
    // 45° toward u, at half the slope.
    let ns = Vec3::new(0.5, 0.0, 1.0).normalize();
    assert!(top.ns.distance(ns) < 1e-5, "bump: {}", top.ns);
    let bottom = seen(&scene, Vec3::new(0.5, 0.25, 1.0), Vec3::NEG_Z);
    assert!(
        bottom.brdf.diffuse.length() < 1e-5,
        "black below: {}",
        bottom.brdf.diffuse
    );
}

#[test]
fn vertex_colours_multiply_the_material_of_their_mesh_alone() {
    let mut doc = Doc::new();
    let material = doc.push(
        "materials",
        json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 1], "metallicFactor": 0}}),
    );
    let (plain, coloured) = (doc.square(Some(material)), doc.square(Some(material)));
    // Left corners red, right ones a green of one half; the alpha is left out.
    let (left, right) = ([255, 0, 0, 9], [0, 128, 0, 255]);
    let view = doc.view(&[left, right, right, left].concat());
    let colours = doc.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5121, "count": 4, "type": "VEC4", "normalized": true}),
    );
    doc.json["meshes"][coloured]["primitives"][0]["attributes"]["COLOR_0"] = colours.into();
    let last = doc.square(Some(material));
    for (mesh, x) in [(plain, -2), (coloured, 0), (last, 2)] {
        doc.node(json!({"mesh": mesh, "translation": [x, 0, 0]}));
    }
    let diffuse = |scene: &Scene, x| {
        let seen = seen(scene, Vec3::new(x, 0.3, 5.0), Vec3::NEG_Z);
        seen.brdf.diffuse
    };
    let scene = doc.load("");
    let expected = Vec3::new(0.5 * 0.75, 0.25 * 128.0 / 255.0, 0.0);
    let found = diffuse(&scene, 0.25);
    assert!(found.distance(expected) < 1e-5, "{found} for {expected}");
    for x in [-1.5, 2.5] {
        let found = diffuse(&scene, x);
        assert_eq!(found, Vec3::new(0.5, 1.0, 1.0), "no colours at x = {x}");
    }
    let floats = doc.floats(&[[-1.0, 7.0, 0.5]; 4]);
    doc.json["meshes"][coloured]["primitives"][0]["attributes"]["COLOR_0"] = floats.into();
    let found = diffuse(&doc.load(""), 0.25);
    assert!(
        found.distance(Vec3::new(0.0, 1.0, 0.5)) < 1e-6,
        "clamped: {found}"
    );
    let few = doc.floats(&[[1.0, 1.0, 1.0]; 3]);
    doc.json["meshes"][coloured]["primitives"][0]["attributes"]["COLOR_0"] = few.into();
    let message = doc.error();
    assert!(
        message.contains("attributes.COLOR_0: found 3 elements; expected 4"),
        "{message}"
    );
}

#[test]
fn hidden_nodes_are_left_out_with_all_below_them() {
    let mut doc = lit();
    let whole = doc.load("FromFile");
    let (mesh, lights) = (doc.square(None), whole.emitters.len());
    doc.push("extensionsRequired", json!("KHR_node_visibility"));
    let below = doc.push(
        "nodes",
        json!({"mesh": mesh, "extensions": {"KHR_lights_punctual": {"light": 0}}}),
    );
    let node = doc.node(json!({"children": [below], "translation": [0, 0, 9]}));
    for (visibility, more) in [
        (json!({}), 1),
        (json!({"visible": true}), 1),
        (json!({"visible": false}), 0),
    ] {
        doc.json["nodes"][node]["extensions"] = json!({"KHR_node_visibility": visibility});
        let scene = doc.load("FromFile");
        let found = (scene.mesh.len(), scene.emitters.len());
        let expected = (whole.mesh.len() + 2 * more, lights + more);
        assert_eq!(found, expected, "{visibility}");
    }
}

#[test]
fn green_of_a_normal_map_points_up_the_picture_also_in_a_mirror() {
    let mut doc = Doc::new();
    let bump = doc.texture([192, 192, 128, 255], false);
    let material = doc.push("materials", json!({"normalTexture": {"index": bump}}));
    let mesh = doc.square(Some(material));
    doc.node(json!({"mesh": mesh, "translation": [0, 0, 0]}));
    doc.node(json!({"mesh": mesh, "translation": [-2, 0, 0], "scale": [-1, 1, 1]}));
    let scene = doc.load("");
    // The map has no z: what is seen leans along u and v as far as it may.
    let plain = seen(&scene, Vec3::new(0.5, 0.5, 1.0), Vec3::NEG_Z).ns;
    assert!(plain.x > 0.7 && plain.y > 0.7, "toward u and v: {plain}");
    let mirrored = seen(&scene, Vec3::new(-2.5, 0.5, 1.0), Vec3::NEG_Z).ns;
    assert!(
        mirrored.x < -0.7 && mirrored.y > 0.7,
        "u is mirrored: {mirrored}"
    );
}

#[test]
fn texture_transforms_move_the_picture() {
    let mut doc = Doc::new();
    let base = doc.texture([255; 4], false);
    let transform =
        json!({"offset": [0.5, 0.25], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2, 3]});
    let info = json!({"index": base, "extensions": {"KHR_texture_transform": transform}});
    let material = doc.push(
        "materials",
        json!({"pbrMetallicRoughness": {"baseColorTexture": info}}),
    );
    let mesh = doc.square(Some(material));
    doc.node(json!({"mesh": mesh}));
    doc.push("extensionsRequired", json!("KHR_texture_transform"));
    let scene = doc.load("");
    // (1, 1) in the file: scaled to (2, 3), turned to (3, −2), moved to (3.5, −1.75); v upward is 1 minus it.
    let uv = scene.mesh.uvs[1];
    assert!(uv.distance(glam::Vec2::new(3.5, 2.75)) < 1e-5, "{uv}");
}

#[test]
fn alpha_cuts_out_at_the_cutoff_and_a_texture_without_alpha_does_not() {
    for (texel, alpha, mode, cutoff, there) in [
        ([0, 0, 0, 100], true, "MASK", 0.5, false),
        ([0, 0, 0, 100], true, "MASK", 0.3, true),
        ([0, 0, 0, 100], true, "MASK", 0.0, true),
        ([0, 0, 0, 200], true, "MASK", 0.9, false),
        ([0, 0, 0, 255], false, "MASK", 0.5, true),
        ([0, 0, 0, 100], true, "BLEND", 0.1, false),
        ([0, 0, 0, 100], true, "OPAQUE", 0.9, true),
    ] {
        let mut doc = Doc::new();
        let base = doc.texture(texel, alpha);
        let mut material = json!({"alphaMode": mode, "pbrMetallicRoughness": {"baseColorTexture": {"index": base}}});
        if mode == "MASK" {
            material["alphaCutoff"] = cutoff.into();
        }
        let material = doc.push("materials", material);
        let mesh = doc.square(Some(material));
        doc.node(json!({"mesh": mesh}));
        let scene = doc.load("");
        let ray = Ray {
            origin: Vec3::new(0.4, 0.3, 1.0),
            direction: Vec3::NEG_Z,
            t_max: 10.0,
        };
        let hit = Tracer::build(&scene).closest(&ray).is_some();
        assert_eq!(hit, there, "{texel:?} {alpha} {mode} {cutoff}");
    }
}

/// A lamp of each kind and a camera, each turned so that −z becomes −x.
fn lit() -> Doc {
    let mut doc = Doc::new();
    let mesh = doc.square(None);
    doc.node(json!({"mesh": mesh}));
    doc.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 683, "color": [1, 0.5, 0]},
        {"type": "spot", "intensity": 1366, "spot": {"innerConeAngle": 0.0, "outerConeAngle": FRAC_PI_4}},
        {"type": "directional", "intensity": 2049},
    ]}});
    let turn = json!([0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2]);
    for light in 0..3 {
        let light = json!({"KHR_lights_punctual": {"light": light}});
        doc.node(json!({"extensions": light, "rotation": turn, "translation": [1, 2, 3], "scale": [9, 9, 9]}));
    }
    doc.push("cameras", json!({"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 1, "znear": 0}}));
    doc.push(
        "cameras",
        json!({"type": "perspective", "perspective": {"yfov": FRAC_PI_4, "znear": 0.1}}),
    );
    doc.node(json!({"camera": 0}));
    doc.node(json!({"camera": 1, "rotation": turn, "translation": [4, 0, 0]}));
    doc
}

#[test]
fn lights_are_converted_as_blender_does_and_shine_along_minus_z() {
    let doc = lit();
    let near = |a: Vec3, b: Vec3| a.distance(b) < 1e-5;
    for (entry, factor) in [("FromFile", 1.0), ("FromFile(lumens_per_watt: 1)", 683.0)] {
        let scene = doc.load(entry);
        let [point, spot, sun] = scene.emitters[..] else {
            panic!("{:?}", scene.emitters);
        };
        let Emitter::Point {
            position,
            intensity,
        } = point
        else {
            panic!("{point:?}")
        };
        assert!(near(position, Vec3::new(1.0, 2.0, 3.0)), "{position}");
        assert!(
            near(intensity / factor, Vec3::new(1.0, 0.5, 0.0)),
            "{intensity}: no part of the scale"
        );
        let Emitter::Spot {
            direction,
            intensity,
            cos_inner,
            cos_outer,
            ..
        } = spot
        else {
            panic!("{spot:?}")
        };
        assert!(near(direction, Vec3::NEG_X), "{direction}");
        assert!(near(intensity / factor, Vec3::splat(2.0)), "{intensity}");
        assert!(
            cos_inner == 1.0 && (cos_outer - FRAC_1_SQRT_2).abs() < 1e-6,
            "{cos_inner} {cos_outer}"
        );
        let Emitter::Directional {
            direction,
            irradiance,
        } = sun
        else {
            panic!("{sun:?}")
        };
        assert!(
            near(direction, Vec3::NEG_X) && near(irradiance / factor, Vec3::splat(3.0)),
            "{sun:?}"
        );
    }
    let remarks = doc.load("").notes.remarks.join("\n");
    assert!(
        remarks.contains("3 lights of geometry files are not among"),
        "{remarks}"
    );
}

#[test]
fn a_file_alone_is_a_scene_with_its_own_camera_and_lights() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a file");
        load(Path::new(&path))
    };
    let scene = write("a b.glb", &lit().glb()).expect("a scene");
    assert_eq!(scene.emitters.len(), 3, "its lights");
    assert_eq!(
        scene.camera.origin,
        Vec3::new(4.0, 0.0, 0.0),
        "the camera in perspective"
    );
    let view = scene.camera.target - scene.camera.origin;
    assert!(
        view.normalize().distance(Vec3::NEG_X) < 1e-5,
        "looks along {view}"
    );
    assert!(
        (scene.camera.fov_y_deg - 45.0).abs() < 1e-4,
        "{}",
        scene.camera.fov_y_deg
    );

    let mut dark = lit();
    dark.json["cameras"] = json!([dark.json["cameras"][0], dark.json["cameras"][0]]);
    let error = write("dark.glb", &dark.glb())
        .expect_err("no camera")
        .to_string();
    assert!(
        error.contains("dark.glb:1:1: camera: there is none"),
        "{error}"
    );
}

#[test]
fn files_beside_it_are_found_by_their_encoded_names_and_nowhere_else() {
    let mut doc = Doc::new();
    let image = doc.push("images", json!({"uri": "a%20b.png"}));
    let base = doc.push("textures", json!({"source": image}));
    let material = doc.push(
        "materials",
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": base}}}),
    );
    let mesh = doc.square(Some(material));
    doc.node(json!({"mesh": mesh}));
    let folder = tempfile::tempdir().expect("a folder");
    let write =
        |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("a file");
    let scene = format!("(geometry: [\"a.gltf\"], {CAMERA}, lights: [])");
    write("scene.ron", scene.as_bytes());
    write("a b.png", &png([255; 4], false));
    write("data.bin", &doc.bin);
    let length = doc.bin.len();
    let mut load_with = |buffer: &str, picture: &str| {
        doc.json["buffers"][0] = json!({"uri": buffer, "byteLength": length});
        doc.json["images"][0]["uri"] = picture.into();
        write("a.gltf", doc.json.to_string().as_bytes());
        load(&folder.path().join("scene.ron")).map_err(|e| e.to_string())
    };
    assert_eq!(
        load_with("data.bin", "a%20b.png")
            .expect("a scene")
            .textures
            .len(),
        1,
        "a texture"
    );
    for (buffer, picture, parts) in [
        (
            "../data.bin",
            "a%20b.png",
            ["a.gltf: buffers[0].uri", "out of the scene's folder"],
        ),
        (
            "/etc/passwd",
            "a%20b.png",
            ["a.gltf: buffers[0].uri", "absolute"],
        ),
        (
            "none.bin",
            "a%20b.png",
            ["a.gltf: buffers[0].uri", "none.bin: No such file"],
        ),
        (
            "data:text/plain,x",
            "a%20b.png",
            ["a.gltf: buffers[0].uri", "base64"],
        ),
        (
            "data:x;base64,%%%",
            "a%20b.png",
            ["a.gltf: buffers[0].uri", "base64"],
        ),
        (
            "data.bin",
            "%2e%2e/x.png",
            ["a.gltf: images[0].uri", "out of the scene's folder"],
        ),
        (
            "data.bin",
            "x.png",
            [
                "materials[0].baseColorTexture: images[0]",
                "x.png: No such file",
            ],
        ),
        (
            "data.bin",
            "data.bin",
            [
                "materials[0].baseColorTexture: images[0]",
                "not a PNG or JPEG",
            ],
        ),
    ] {
        let error = load_with(buffer, picture).expect_err("refused");
        assert!(
            parts.iter().all(|part| error.contains(part)),
            "{buffer} {picture}: {error}"
        );
    }
}

#[test]
fn broken_files_are_refused_by_name_and_place() {
    let change = |pointer: &str, value: Value| {
        let mut doc = lit();
        let base = doc.texture([255; 4], false);
        let pbr = json!({"baseColorTexture": {"index": base}});
        let material = doc.push(
            "materials",
            json!({"name": "painted", "pbrMetallicRoughness": pbr}),
        );
        doc.json["meshes"][0]["primitives"][0]["material"] = material.into();
        doc.json["extensionsRequired"] = json!([]);
        let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
        let parent = doc
            .json
            .pointer_mut(parent)
            .unwrap_or_else(|| panic!("{pointer}"));
        match parent {
            Value::Array(list) => {
                let i: usize = key.parse().expect("an index");
                if i < list.len() {
                    list[i] = value
                } else {
                    list.push(value)
                }
            }
            object => object[key] = value,
        }
        doc
    };
    let cases: Vec<(&str, Value, &[&str])> = vec![
        (
            "/asset/version",
            json!("1.0"),
            &["asset.version", "\"1.0\""],
        ),
        (
            "/extensionsRequired/0",
            json!("KHR_draco_mesh_compression"),
            &["extensionsRequired", "KHR_draco"],
        ),
        ("/scene", json!(7), &["scene: found index 7"]),
        ("/scenes/0/nodes/0", json!(99), &["found index 99"]),
        ("/nodes/0/children", json!([0]), &["nodes[0]: found twice"]),
        ("/nodes/1/children", json!([0]), &["nodes[0]: found twice"]),
        ("/nodes/0/mesh", json!(5), &["nodes[0].mesh: found index 5"]),
        (
            "/nodes/0/rotation",
            json!([0, 0, 0, 0]),
            &["nodes[0].rotation"],
        ),
        (
            "/nodes/0/translation",
            json!([1e30, 0, 0]),
            &["nodes[0]: found", "1e12"],
        ),
        (
            "/nodes/1/extensions/KHR_lights_punctual/light",
            json!(9),
            &["nodes[1]", "found index 9"],
        ),
        (
            "/nodes/2/scale",
            json!([1, 1, 0]),
            &["nodes[2]", "no direction"],
        ),
        (
            "/extensions/KHR_lights_punctual/lights/0/intensity",
            json!(-1),
            &["none negative"],
        ),
        (
            "/extensions/KHR_lights_punctual/lights/1/spot/outerConeAngle",
            json!(3),
            &["outerConeAngle 3"],
        ),
        (
            "/extensions/KHR_lights_punctual/lights/1/spot/innerConeAngle",
            json!(1),
            &["innerConeAngle 1"],
        ),
        (
            "/extensions/KHR_lights_punctual/lights/2/type",
            json!("area"),
            &["directional, point or spot"],
        ),
        ("/cameras/1/perspective/yfov", json!(4), &["found yfov 4"]),
        (
            "/meshes/0/primitives/0/material",
            json!(4),
            &["primitives[0].material: found index 4"],
        ),
        (
            "/meshes/0/primitives/0/mode",
            json!(9),
            &["primitives[0].mode"],
        ),
        (
            "/meshes/0/primitives/0/indices",
            json!(77),
            &["indices: found index 77"],
        ),
        (
            "/meshes/0/primitives/0/indices",
            json!(0),
            &["accessors[0] is of Vec3; expected Scalar"],
        ),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            json!(2),
            &["is of Vec2; expected Vec3"],
        ),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            json!(55),
            &["POSITION: found index 55"],
        ),
        (
            "/meshes/0/primitives/0/attributes",
            json!({}),
            &["POSITION is missing"],
        ),
        ("/accessors/3/count", json!(5), &["found 5 corners"]),
        (
            "/accessors/3/componentType",
            json!(5122),
            &["unsigned whole"],
        ),
        (
            "/accessors/3/componentType",
            json!(1),
            &["unknown type or componentType"],
        ),
        (
            "/accessors/1/count",
            json!(3),
            &["NORMAL: found 3 elements; expected 4"],
        ),
        (
            "/accessors/0/count",
            json!(3),
            &["NORMAL: found 4 elements; expected 3"],
        ),
        (
            "/accessors/0/count",
            json!(1u64 << 62),
            &["accessors[0]", "within the bufferView's 48"],
        ),
        (
            "/accessors/3/count",
            json!(1u64 << 62),
            &["triangles; expected at most"],
        ),
        (
            "/accessors/1/count",
            json!(1u64 << 62),
            &["accessors[1]", "within the bufferView's 48"],
        ),
        (
            "/accessors/0/byteOffset",
            json!(u64::MAX),
            &["accessors[0]", "within the bufferView's 48"],
        ),
        (
            "/accessors/0/bufferView",
            json!(88),
            &["accessors[0].bufferView: found index 88"],
        ),
        (
            "/accessors/1",
            json!({"count": 1u64 << 40, "componentType": 5126, "type": "VEC3"}),
            &["without a bufferView"],
        ),
        (
            "/accessors/0/sparse",
            json!({"count": 1, "indices": {"bufferView": 3, "componentType": 5125}, "values": {"bufferView": 0}}),
            &["accessors[0].sparse.indices: found 65536"],
        ),
        (
            "/bufferViews/0/byteStride",
            json!(4),
            &["elements of 12 bytes every 4"],
        ),
        (
            "/bufferViews/0/byteLength",
            json!(u64::MAX),
            &["bufferViews[0]: found"],
        ),
        (
            "/bufferViews/0/buffer",
            json!(1),
            &["bufferViews[0].buffer: found index 1"],
        ),
        (
            "/materials/0/pbrMetallicRoughness/roughnessFactor",
            json!(1.5),
            &["materials[0]", "roughnessFactor: found 1.5", "`painted`"],
        ),
        (
            "/materials/0/pbrMetallicRoughness/metallicFactor",
            json!(-0.5),
            &["materials[0]", "metallicFactor: found -0.5", "`painted`"],
        ),
        (
            "/materials/0/pbrMetallicRoughness/baseColorFactor",
            json!([0.5, 1.5, 0, 1]),
            &["materials[0]", "baseColorFactor: found 1.5", "`painted`"],
        ),
        (
            "/materials/0",
            json!({"name": "lamp", "emissiveFactor": [1, 1, 1],
                "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": -2}}}),
            &["emissiveFactor", "times -2; expected", "`lamp`"],
        ),
        (
            "/materials/0/pbrMetallicRoughness/baseColorTexture/index",
            json!(3),
            &["baseColorTexture.index: found index 3"],
        ),
        (
            "/materials/0/emissiveFactor",
            json!([-1, 0, 0]),
            &["materials[0].emissiveFactor: found [-1.0", "`painted`"],
        ),
        (
            "/materials/0/alphaMode",
            json!("GLASS"),
            &["materials[0].alphaMode"],
        ),
        (
            "/materials/0",
            json!({"alphaMode": "MASK", "alphaCutoff": -1}),
            &["materials[0].alphaCutoff: found -1"],
        ),
        ("/textures/0/source", json!(4), &["found index 4"]),
    ];
    for (pointer, value, parts) in cases {
        let doc = change(pointer, value.clone());
        let error = doc.error();
        assert!(
            error.contains("a.gltf: "),
            "{pointer} = {value}: {error} names no file"
        );
        for part in parts {
            assert!(
                error.contains(part),
                "{pointer} = {value}: {error} lacks {part}"
            );
        }
    }
    let mut doc = lit();
    let indices = doc.json["bufferViews"][3]["byteOffset"].as_u64();
    doc.bin[indices.expect("a place") as usize] = 4;
    let error = doc.error();
    assert!(
        error.contains("indices: found 4; expected less than 4"),
        "{error}"
    );
    let mut doc = lit();
    doc.bin[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(
        doc.error().contains("POSITION: accessors[0]: found [NaN"),
        "{}",
        doc.error()
    );
}

#[test]
fn a_mesh_named_too_often_is_refused_before_it_is_made() {
    let mut doc = Doc::new();
    let zeros = doc.push(
        "accessors",
        json!({"componentType": 5126, "count": 1 << 24, "type": "VEC3"}),
    );
    let primitive = json!({"attributes": {"POSITION": zeros}, "mode": 5});
    let mesh = doc.push("meshes", json!({"primitives": [primitive]}));
    for _ in 0..9 {
        doc.node(json!({"mesh": mesh}));
    }
    assert!(
        doc.error()
            .contains("150994944 triangles; expected at most"),
        "{}",
        doc.error()
    );
}

#[test]
fn json_errors_say_line_and_column_and_no_cut_or_flipped_byte_panics() {
    let error = |bytes: &[u8]| {
        with_file("a.glb", bytes, "")
            .map(|_| ())
            .map_err(|e| e.to_string())
    };
    let message = error(b"{\n \"asset\": 3}").expect_err("refused");
    assert!(message.contains("a.glb:2:"), "{message}");
    let message = error(b"{\"animations\": [\n {}\n ],\n\"asset\": 3}").expect_err("refused");
    assert!(message.contains("a.glb:4:10"), "animations: {message}");
    let message = error(b"{\n\"animations\": 3}").expect_err("refused");
    assert!(message.contains("a.glb:2:"), "no animations: {message}");
    let glb = lit().glb();
    error(&glb).expect("sound");
    for length in (0..glb.len() - 4).step_by(7) {
        let message = error(&glb[..length]).expect_err("cut short");
        assert!(message.contains("a.glb"), "{message}");
    }
    // Broken in one byte it may still be a scene; it must not panic.
    let mut outcomes = BTreeMap::new();
    for at in (0..glb.len()).step_by(3) {
        for flip in [0x01, 0x80, 0xFF] {
            let mut broken = glb.clone();
            broken[at] ^= flip;
            *outcomes.entry(error(&broken).is_ok()).or_insert(0) += 1;
        }
    }
    assert!(outcomes.len() == 2, "some load, some do not: {outcomes:?}");
}

#[test]
fn what_has_no_effect_is_said() {
    let mut doc = Doc::new();
    let mesh = doc.square(None);
    doc.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 0}]);
    // No node: what moves is named by an extension.
    let channel = json!({"sampler": 0, "target": {"path": "pointer"}});
    doc.push("animations", json!({"samplers": [], "channels": [channel]}));
    let line = json!({"attributes": {"POSITION": 0}, "mode": 1});
    doc.json["meshes"][0]["primitives"]
        .as_array_mut()
        .expect("a list")
        .push(line);
    doc.push("extensionsUsed", json!("KHR_materials_clearcoat"));
    doc.node(json!({"mesh": mesh}));
    let scene = doc.load("");
    assert!(scene.mesh.normal_indices[0][0] != ABSENT, "normals");
    let remarks = scene.notes.remarks.join("\n");
    for part in [
        "points or lines",
        "1 primitives have morph targets",
        "1 animations",
        "KHR_materials_clearcoat has no effect",
    ] {
        assert!(remarks.contains(part), "{part} in {remarks}");
    }
}

#[test]
fn lights_that_cannot_shine_are_skipped_and_counted() {
    let mut doc = lit();
    let lamp = doc.push("materials", json!({"emissiveFactor": [1, 1, 1]}));
    // Of the square's two triangles one gets no area.
    doc.json["meshes"][0]["primitives"][0]["material"] = lamp.into();
    let indices = doc.json["bufferViews"][3]["byteOffset"].as_u64();
    doc.bin[indices.expect("a place") as usize + 2] = 0;
    // One that emits more than can be told.
    let strength = json!({"KHR_materials_emissive_strength": {"emissiveStrength": 1e38}});
    let blinding = doc.push(
        "materials",
        json!({"emissiveFactor": [1, 1, 1], "extensions": strength}),
    );
    let mesh = doc.square(Some(blinding));
    doc.node(json!({"mesh": mesh, "scale": [10, 10, 10]}));
    doc.json["extensions"]["KHR_lights_punctual"]["lights"][1]["intensity"] = json!(0);
    let scene = doc.load("FromFile, Emissive, Environment(radiance: (0, 0, 0))");
    assert_eq!(scene.emitters.len(), 3, "a point, the sun, half a square");
    assert_eq!(scene.notes.degenerate_triangles, 1, "without area");
    assert_eq!(scene.notes.dark_emissive_triangles, 2, "too bright to tell");
    assert_eq!(scene.notes.zero_power_lights, 1, "the spot");
    assert_eq!(scene.notes.black_environments, 1, "the sky");
    assert!(scene.environment.is_none(), "and left out");
}
