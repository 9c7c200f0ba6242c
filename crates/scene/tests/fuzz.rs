//! Damaged scene files of every kind: each loads or is refused, in little time and memory.

use std::path::Path;

use base64::Engine;
use image::{DynamicImage, ImageFormat};
use manylight_scene::load::load;
use peak_alloc::PeakAlloc;
use verify::{Fuzz, Outcome};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// What a damaged file of a few hundred bytes may make the loader take.
const MOST_BYTES: usize = 100 << 20;

/// A kind of file: which one of a sound scene's is replaced, and what the scene is called.
struct Target {
    name: &'static str,
    file: &'static str,
    scene: &'static str,
    seeds: Vec<Vec<u8>>,
    words: &'static [&'static str],
    repair: fn(&mut [u8]),
}

const SCENE: &str = "(
    geometry: [\"scene.obj\"], metres_per_unit: 1.0,
    camera: (origin: (0, 1, 5), target: (0, 1, 0), up: (0, 1, 0), fov_y_deg: 60.0),
    lights: [
        Points(\"lights.ron\"), Point(position: (0, 2, 0), intensity: (1, 1, 1)), Emissive,
        Spot(position: (0, 2, 0), direction: (0, -1, 0), intensity: (1, 2, 1), cos_inner: 0.9, cos_outer: 0.5),
        Directional(direction: (0, -1, 0), irradiance: (1, 1, 1)), Environment(radiance: (1, 1, 1)),
    ],
)";
const OBJ: &str = "mtllib scene.mtl
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1
usemtl white\nf 1/1/1 2/2/1 3/3/1
g part\nusemtl red\nf -4//1 -2//1 -1//1\nf 1 2 3 4
";
const MTL: &str = "newmtl white\nKd 0.8 0.8 0.8\nmap_Kd t.png\nnorm t.png\nmap_d t.png
newmtl red\nKd 0.8 0.1 0.1\nKs 0.1 0.1 0.1\nNs 10\nd 1\nKe 1 0 0\nmap_Ke -s 1 1 1 t.png\nPr 0.3\nPm 0.5\nmap_Pr t.png
";
const LIGHTS: &str =
    "[(position: (0, 1, 0), intensity: (1, 1, 1)), (position: (0, 3, 0), intensity: (2, 2, 2))]";

/// A picture of four by two texels; of JPEG only grey, which is small.
fn picture(format: ImageFormat) -> Vec<u8> {
    let texels = image::RgbaImage::from_fn(4, 2, |x, y| {
        image::Rgba([40 * x as u8, 90 * y as u8, 200, 255 - 60 * x as u8])
    });
    let picture = DynamicImage::ImageRgba8(texels);
    let picture = match format {
        ImageFormat::Jpeg => DynamicImage::ImageLuma8(picture.into_luma8()),
        ImageFormat::Hdr | ImageFormat::OpenExr => DynamicImage::ImageRgb32F(picture.into_rgb32f()),
        _ => picture,
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, format)
        .expect("a picture in memory");
    bytes.into_inner()
}

/// Check sums of all chunks of a PNG that are whole.
fn repair_png(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = bytes.get(at..at + 4) {
        let length = u32::from_be_bytes(length.try_into().expect("four bytes")) as usize;
        let Some(end) = at
            .checked_add(8 + length)
            .filter(|end| end + 4 <= bytes.len())
        else {
            return;
        };
        let mut crc = !0u32;
        for &byte in &bytes[at + 4..end] {
            crc ^= u32::from(byte);
            for _ in 0..8 {
                crc = crc >> 1 ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
            }
        }
        bytes[end..end + 4].copy_from_slice(&(!crc).to_be_bytes());
        at = end + 4;
    }
}

/// Lengths of a GLB's header and of its first chunk's.
fn repair_glb(bytes: &mut [u8]) {
    let whole = (bytes.len() as u32).to_le_bytes();
    if let Some(length) = bytes.get_mut(8..12) {
        length.copy_from_slice(&whole);
    }
}

/// A square of two triangles with a textured material, a light and a camera, and its buffer.
fn gltf_text(buffer: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1]}}],
        "nodes":[{{"mesh":0,"children":[2],"translation":[1,2,3]}},{{"camera":0,"rotation":[0,0,0,1]}},
        {{"mesh":0,"scale":[2,2,2],"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}],
        "extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"point","intensity":683}}]}}}},
        "cameras":[{{"type":"perspective","perspective":{{"yfov":0.8,"znear":0.1}}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2,"material":0}}]}}],
        "materials":[{{"emissiveFactor":[1,0,1],"alphaMode":"MASK","alphaCutoff":0.4,
        "pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}},"metallicFactor":0.5}}}}],
        "textures":[{{"source":0}}],"images":[{{"uri":"t.png"}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},
        {{"bufferView":0,"byteOffset":16,"componentType":5126,"count":4,"type":"VEC2"}},
        {{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":12}}],
        "buffers":[{buffer}]}}"#
    )
}

/// Corners of a square, and its triangles.
fn square() -> Vec<u8> {
    let corners: [[f32; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    let corners = corners.iter().flatten().flat_map(|x| x.to_le_bytes());
    let triangles = [0u16, 1, 2, 0, 2, 3];
    corners
        .chain(triangles.iter().flat_map(|i| i.to_le_bytes()))
        .collect()
}

fn glb_bytes() -> Vec<u8> {
    let mut json = gltf_text(r#"{"byteLength":60}"#).into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let bin = square();
    let mut glb = b"glTF".to_vec();
    for word in [2, 28 + json.len() + bin.len(), json.len()] {
        glb.extend((word as u32).to_le_bytes());
    }
    glb.extend(b"JSON");
    glb.extend(json);
    glb.extend((bin.len() as u32).to_le_bytes());
    glb.extend(b"BIN\0");
    glb.extend(bin);
    glb
}

fn targets() -> Vec<Target> {
    let text = |name, file, seed: &str, words| Target {
        name,
        file,
        scene: "scene.ron",
        seeds: vec![seed.as_bytes().to_vec()],
        words,
        repair: |_| (),
    };
    let data = base64::engine::general_purpose::STANDARD.encode(square());
    let uri = format!(r#"{{"byteLength":60,"uri":"data:application/octet-stream;base64,{data}"}}"#);
    let json: &[&str] = &[
        "null",
        "[[",
        "{\"a\":",
        "[0]",
        "5121",
        "\"sparse\":{}",
        "\"byteStride\":4,",
    ];
    let sky = |name, file, scene, format| Target {
        name,
        file,
        scene,
        seeds: vec![picture(format)],
        words: &["DWAA", "compression", "\x08", "\x09"],
        repair: |_| (),
    };
    vec![
        text(
            "scene",
            "scene.ron",
            SCENE,
            &[
                "((",
                "\"../../x\"",
                "\"/etc/passwd\"",
                "Emissive,",
                "\"builtin:nave\"",
                "$HOME",
                "[",
                "FromFile,",
            ],
        ),
        text(
            "lights",
            "lights.ron",
            LIGHTS,
            &["((", "[[", "position", "),"],
        ),
        text(
            "obj",
            "scene.obj",
            OBJ,
            &[
                "f 1 2 3\n",
                "\\\n",
                "/",
                "//",
                "-",
                "usemtl x\n",
                "mtllib ../x\n",
                "#",
                "v 1e30 0 0\n",
            ],
        ),
        text(
            "mtl",
            "scene.mtl",
            MTL,
            &[
                "newmtl white\n",
                "map_Kd ../../t.png\n",
                "map_Kd /dev/zero\n",
                "Ke ",
                "-bm 2",
                "\\\n",
                "map_Bump t.png\n",
            ],
        ),
        Target {
            scene: "a.gltf",
            ..text("gltf", "a.gltf", &gltf_text(&uri), json)
        },
        Target {
            seeds: vec![glb_bytes()],
            scene: "a.glb",
            repair: repair_glb,
            ..text("glb", "a.glb", "", json)
        },
        Target {
            seeds: vec![picture(ImageFormat::Png), picture(ImageFormat::Jpeg)],
            repair: repair_png,
            ..text(
                "texture",
                "t.png",
                "",
                &["IHDR", "IDAT", "PLTE", "tRNS", "\x00"],
            )
        },
        sky("sky_exr", "sky.exr", "exr.ron", ImageFormat::OpenExr),
        sky("sky_hdr", "sky.hdr", "hdr.ron", ImageFormat::Hdr),
    ]
}

fn write_sound_files(folder: &Path) {
    let write =
        |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("a file");
    write("scene.ron", SCENE.as_bytes());
    write("scene.obj", OBJ.as_bytes());
    write("scene.mtl", MTL.as_bytes());
    write("lights.ron", LIGHTS.as_bytes());
    write("t.png", &picture(ImageFormat::Png));
    for end in ["exr", "hdr"] {
        let image = format!("Environment(image: \"sky.{end}\")");
        let scene = SCENE.replace("Environment(radiance: (1, 1, 1))", &image);
        write(&format!("{end}.ron"), scene.as_bytes());
    }
}

/// Tries `inputs` of one kind.
fn fuzz(target: Target, inputs: u64) -> Outcome {
    let peak = || {
        let peak = MEMORY.peak_usage();
        MEMORY.reset_peak_usage();
        peak
    };
    let folder = tempfile::tempdir().expect("a folder");
    write_sound_files(folder.path());
    let attempt = |bytes: &[u8]| {
        std::fs::write(folder.path().join(target.file), bytes).expect("a file");
        load(&folder.path().join(target.scene)).is_ok()
    };
    let name = target.name;
    assert!(attempt(&target.seeds[0]), "{name} is sound to begin with");
    let fuzz = Fuzz {
        name,
        seeds: target.seeds,
        words: target.words,
        repair: target.repair,
        peak: &peak,
        most_bytes: MOST_BYTES,
    };
    let outcome = fuzz.run(inputs, attempt);
    assert!(outcome.accepted < inputs, "{name}: some are refused");
    outcome
}

#[test]
fn damaged_files_load_or_are_refused_in_little_time_and_memory() {
    for target in targets() {
        fuzz(target, 150);
    }
}

/// One test for each kind of file, so that kinds can be tried alone.
macro_rules! very_many {
    ($($kind:ident),+) => {$(
        #[test]
        #[ignore = "minutes: tens of thousands of files"]
        fn $kind() {
            let target = targets().into_iter().find(|t| t.name == stringify!($kind));
            eprintln!("{}: {:?}", stringify!($kind), fuzz(target.expect("a kind of file"), 60_000));
        }
    )+};
}

very_many!(
    scene, lights, obj, mtl, gltf, glb, texture, sky_exr, sky_hdr
);
