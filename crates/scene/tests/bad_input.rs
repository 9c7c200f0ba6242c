//! Every kind of broken scene gives an error that names the file, the place and the value; none panics.

use std::path::Path;

use manylight_scene::{Scene, SceneError, load::load};

const SCENE: &str = "(
    geometry: [\"scene.obj\"],
    metres_per_unit: 1.0,
    camera: (origin: (0, 1, 5), target: (0, 1, 0), up: (0, 1, 0), fov_y_deg: 60.0),
    lights: [
        Points(\"lights.ron\"),
        Point(position: (0, 2, 0), intensity: (1, 1, 1)),
    ],
)
";

const OBJ: &str = "# two triangles
mtllib scene.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vn 0 0 1
usemtl white
f 1/1/1 2/1/1 3/1/1
usemtl red
f -4//1 -2//1 -1//1
";

const MTL: &str = "newmtl white
Kd 0.8 0.8 0.8
map_Kd t.png
newmtl red
Kd 0.8 0.1 0.1
Ks 0.1 0.1 0.1
Ns 10
d 1
Ke 0 0 0
";

const LIGHTS: &str = "[
    (position: (0, 1, 0), intensity: (1, 1, 1)),
    (position: (0, 3, 0), intensity: (2, 2, 2)),
]
";

fn png(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbImage::new(width, height);
    let written = image.write_to(&mut bytes, image::ImageFormat::Png);
    written.expect("a PNG in memory");
    bytes.into_inner()
}

/// A good scene in a new folder, with some files replaced.
fn load_with(files: &[(&str, &[u8])]) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.path().join(name), bytes).expect("a file");
    };
    write("scene.ron", SCENE.as_bytes());
    write("scene.obj", OBJ.as_bytes());
    write("scene.mtl", MTL.as_bytes());
    write("lights.ron", LIGHTS.as_bytes());
    write("t.png", &png(2, 2));
    for (name, bytes) in files {
        write(name, bytes);
    }
    load(&folder.path().join("scene.ron"))
}

/// (text replaced, by what, parts of the message)
type Edit = (&'static str, &'static str, &'static [&'static str]);

fn every_edit_is_refused(file: &str, good: &str, edits: &[Edit]) {
    let mut wrong = Vec::new();
    for (from, to, expected) in edits {
        assert!(good.contains(from), "{from:?} is in {file}");
        let text = good.replacen(from, to, 1);
        match load_with(&[(file, text.as_bytes())]) {
            Ok(_) => wrong.push(format!("{file}: {to:?} loads")),
            Err(error) => {
                let error = error.to_string();
                let missing: Vec<_> = expected.iter().filter(|&&e| !error.contains(e)).collect();
                if !missing.is_empty() {
                    wrong.push(format!(
                        "{file}: {to:?} gives\n  {error}\n  without {missing:?}"
                    ));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_scene_that_the_others_break_is_good() {
    let scene = load_with(&[]).expect("a good scene");
    assert_eq!(scene.mesh.len(), 2, "triangles");
    assert_eq!(scene.emitters.len(), 3, "lights");
    assert_eq!(scene.textures.len(), 1, "textures");
    assert_eq!(scene.materials.len(), 3, "materials, with the default");
}

#[test]
fn bad_scene_files_are_refused() {
    every_edit_is_refused(
        "scene.ron",
        SCENE,
        &[
            (
                "\"scene.obj\"",
                "\"other.obj\"",
                &["scene.ron:2:16", "geometry[0]", "other.obj: No such file"],
            ),
            (
                "\"scene.obj\"",
                "\"../scene.obj\"",
                &["scene.ron:2:16", "leads out of the scene's folder"],
            ),
            (
                "\"scene.obj\"",
                "\"/etc/passwd\"",
                &["scene.ron:2:16", "absolute path"],
            ),
            (
                "\"scene.obj\"",
                "\"C:\\\\a.obj\"",
                &["scene.ron:2:16", "absolute path"],
            ),
            (
                "\"scene.obj\"",
                "\"scene.ply\"",
                &["scene.ron:2:16", "expected .obj, .gltf or .glb"],
            ),
            (
                "\"scene.obj\"",
                "\"builtin:nothing/scene.obj\"",
                &["scene.ron:2:16", "no built-in scene `nothing`"],
            ),
            (
                "\"scene.obj\"",
                "\"$MANYLIGHT_NOT_SET/scene.obj\"",
                &["scene.ron:2:16", "MANYLIGHT_NOT_SET is not set"],
            ),
            (
                "\"scene.obj\"",
                "\"\"",
                &["scene.ron:2:16", "names no file"],
            ),
            (
                "[\"scene.obj\"]",
                "\"scene.obj\"",
                &["scene.ron:2:15", "geometry", "expected a list"],
            ),
            (
                "geometry",
                "geometri",
                &[
                    "scene.ron:2:5",
                    "unknown field `geometri`",
                    "did you mean `geometry`",
                ],
            ),
            (
                "metres_per_unit: 1.0",
                "metres_per_unit: 0",
                &[
                    "scene.ron:3:22",
                    "found 0; expected a finite number above 0",
                ],
            ),
            (
                "metres_per_unit: 1.0",
                "metres_per_unit: inf",
                &["scene.ron:3:22", "found inf"],
            ),
            (
                "metres_per_unit: 1.0",
                "metres_per_unit: -1",
                &["scene.ron:3:22", "found -1"],
            ),
            (
                "fov_y_deg: 60.0",
                "fov_y_deg: 180",
                &["scene.ron:4:", "camera.fov_y_deg", "found 180"],
            ),
            (
                "fov_y_deg: 60.0",
                "fov_y_deg: 0",
                &["scene.ron:4:", "camera.fov_y_deg", "found 0"],
            ),
            (
                "fov_y_deg: 60.0",
                "fov_y_deg: NaN",
                &["scene.ron:4:", "camera.fov_y_deg", "found NaN"],
            ),
            (
                "fov_y_deg: 60.0",
                "fov_y_deg: \"wide\"",
                &[
                    "scene.ron:4:",
                    "camera.fov_y_deg",
                    "found \"wide\"; expected a number",
                ],
            ),
            (
                ", fov_y_deg: 60.0",
                "",
                &["scene.ron:4:13", "camera", "field `fov_y_deg` is missing"],
            ),
            (
                "target: (0, 1, 0)",
                "target: (0, 1, 5)",
                &["scene.ron:4:13", "origin and target are both"],
            ),
            (
                "up: (0, 1, 0)",
                "up: (0, 0, 2)",
                &["scene.ron:4:13", "parallel to the view direction"],
            ),
            (
                "up: (0, 1, 0)",
                "up: (0, 0, 0)",
                &["scene.ron:4:", "camera.up", "not zero"],
            ),
            (
                "up: (0, 1, 0)",
                "up: (0, NaN, 0)",
                &["scene.ron:4:", "camera.up", "NaN"],
            ),
            (
                "origin: (0, 1, 5)",
                "origin: (0, 1e999, 5)",
                &["scene.ron:4:", "camera.origin", "inf"],
            ),
            (
                "origin: (0, 1, 5)",
                "origin: (0, NaN, 5)",
                &["scene.ron:4:", "camera.origin", "NaN"],
            ),
            (
                "origin: (0, 1, 5)",
                "origin: (0, 1e30, 5)",
                &["scene.ron:4:", "camera.origin", "1e12"],
            ),
            (
                "origin: (0, 1, 5)",
                "origin: (0, 1)",
                &["scene.ron:4:", "camera.origin", "found 2 values"],
            ),
            (
                "origin: (0, 1, 5)",
                "origin: [0, 1, 5]",
                &["scene.ron:4:", "camera.origin", "parentheses"],
            ),
            (
                "\"lights.ron\"",
                "\"l.ron\"",
                &["scene.ron:6:9", "lights[0]", "l.ron: No such file"],
            ),
            (
                "\"lights.ron\"",
                "\"../../l.ron\"",
                &["scene.ron:6:9", "leads out"],
            ),
            (
                "intensity: (1, 1, 1)",
                "intensity: (1, -1, 1)",
                &["scene.ron:7:", "lights[1].intensity", "-1", "none negative"],
            ),
            (
                "Point(",
                "Pont(",
                &[
                    "scene.ron:7:9",
                    "unknown variant `Pont`",
                    "did you mean `Point`",
                ],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Emisive",
                &["scene.ron:7:9", "did you mean `Emissive`"],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Environment(radiance: (1, 1, 1), image: \"sky.exr\")",
                &[
                    "scene.ron:7:9",
                    "expected Environment(radiance: (r, g, b)) or",
                ],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Environment(radiance: (1, 1, 1)), Environment(radiance: (1, 1, 1))",
                &[
                    "scene.ron:7:43",
                    "lights[2]",
                    "a second environment beside lights[1]",
                ],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Environment(image: \"sky.exr\")",
                &["scene.ron:7:", "lights[1].image", "sky.exr: No such file"],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Environment(image: \"scene.mtl\")",
                &[
                    "scene.ron:7:",
                    "scene.mtl: not an EXR, HDR, PNG or JPEG file",
                ],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Environment(radiance: (1, NaN, 1))",
                &["scene.ron:7:", "lights[1].radiance", "NaN"],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Directional(direction: (0, -1, 0), irradiance: (1, -1, 1))",
                &["scene.ron:7:", "lights[1].irradiance", "none negative"],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Directional(direction: (0, 0, 0), irradiance: (1, 1, 1))",
                &["scene.ron:7:", "lights[1].direction", "not zero"],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Spot(position: (0, 2, 0), direction: (0, 1, 0), intensity: (1, 1, 1), cos_inner: 0.5, cos_outer: 0.75)",
                &[
                    "scene.ron:7:",
                    "lights[1].cos_inner: found 0.5; expected at least cos_outer, which is 0.75",
                ],
            ),
            (
                "Point(position: (0, 2, 0), intensity: (1, 1, 1))",
                "Spot(position: (0, 2, 0), direction: (0, 1, 0), intensity: (1, 1, 1), cos_inner: 1, cos_outer: 2)",
                &[
                    "scene.ron:7:",
                    "cos_outer",
                    "found 2; expected a number from -1 to 1",
                ],
            ),
            ("],\n)", "],\n", &["scene.ron:1:1", "never closed"]),
            (")\n", ")\n)\n", &["scene.ron:", "closes nothing"]),
            (SCENE, "", &["scene.ron:1:1", "holds no value"]),
        ],
    );
}

#[test]
fn bad_light_files_are_refused() {
    every_edit_is_refused(
        "lights.ron",
        LIGHTS,
        &[
            (
                "(2, 2, 2)",
                "(2, -2, 2)",
                &["lights.ron:3:", "[1].intensity", "-2", "none negative"],
            ),
            (
                "(2, 2, 2)",
                "(2, inf, 2)",
                &["lights.ron:3:", "[1].intensity", "inf"],
            ),
            (
                "(0, 3, 0)",
                "(0, NaN, 0)",
                &["lights.ron:3:", "[1].position", "NaN"],
            ),
            (
                "(0, 3, 0)",
                "(0, x, 0)",
                &[
                    "lights.ron:3:",
                    "[1].position[1]",
                    "found x; expected a number",
                ],
            ),
            (
                ", intensity: (2, 2, 2)",
                "",
                &["lights.ron:3:5", "[1]", "field `intensity` is missing"],
            ),
            (
                "intensity: (2",
                "intensty: (2",
                &["lights.ron:3:", "did you mean `intensity`"],
            ),
            ("]\n", "", &["lights.ron:1:1", "never closed"]),
            (LIGHTS, "(1, 2, 3)", &["lights.ron:1:1", "expected a list"]),
        ],
    );
}

#[test]
fn bad_obj_files_are_refused() {
    every_edit_is_refused(
        "scene.obj",
        OBJ,
        &[
            (
                "3/1/1",
                "99/1/1",
                &[
                    "scene.obj:10",
                    "vertex index 99 out of range; the file has 4",
                ],
            ),
            (
                "3/1/1",
                "3/2/1",
                &["scene.obj:10", "texture coordinate index 2 out of range"],
            ),
            (
                "3/1/1",
                "3/1/2",
                &[
                    "scene.obj:10",
                    "normal index 2 out of range; the file has 1",
                ],
            ),
            (
                "3/1/1",
                "0/1/1",
                &["scene.obj:10", "vertex index 0; indices count from 1"],
            ),
            (
                "3/1/1",
                "3/0/1",
                &["scene.obj:10", "texture coordinate index 0"],
            ),
            ("3/1/1", "3/1/0", &["scene.obj:10", "normal index 0"]),
            ("3/1/1", "3", &["scene.obj:10", "corner `3` differs"]),
            (
                "3/1/1",
                "3/1/1/1",
                &["scene.obj:10", "more than three indices"],
            ),
            ("3/1/1", "/1/1", &["scene.obj:10", "no vertex index"]),
            (
                "3/1/1",
                "x/1/1",
                &["scene.obj:10", "'x' is not a vertex index"],
            ),
            (
                "3/1/1",
                "1.5/1/1",
                &["scene.obj:10", "'1.5' is not a vertex index"],
            ),
            (
                "3/1/1",
                "99999999999999999999/1/1",
                &["scene.obj:10", "is not a vertex index"],
            ),
            (
                "3/1/1",
                "9223372036854775807/1/1",
                &["scene.obj:10", "9223372036854775807 out of range"],
            ),
            (
                "-4//1",
                "-5//1",
                &[
                    "scene.obj:12",
                    "vertex index -5 out of range; the file has 4 so far",
                ],
            ),
            (
                "-4//1",
                "-9223372036854775808//1",
                &["scene.obj:12", "out of range"],
            ),
            (
                "-4//1",
                "-4//-2",
                &["scene.obj:12", "normal index -2 out of range"],
            ),
            (
                " -2//1 -1//1",
                "",
                &["scene.obj:12", "found 1 corners; expected at least 3"],
            ),
            (" -1//1", " # -1//1", &["scene.obj:12", "found 2 corners"]),
            (
                "v 1 1 0",
                "v 1 1",
                &["scene.obj:5", "found 2 numbers (1 1)"],
            ),
            ("v 1 1 0", "v 1 nan 0", &["scene.obj:5", "found nan"]),
            ("v 1 1 0", "v 1 inf 0", &["scene.obj:5", "found inf"]),
            ("v 1 1 0", "v 1 1e39 0", &["scene.obj:5", "found 1e39"]),
            ("v 1 1 0", "v 1 1e20 0", &["scene.obj:5", "found 1e20"]),
            (
                "v 1 1 0",
                "v 1 abc 0",
                &["scene.obj:5", "'abc' is not a number"],
            ),
            (
                "v 1 1 0",
                "v 1 1,0 0",
                &["scene.obj:5", "'1,0' is not a number"],
            ),
            ("v 1 1 0", "v 1 1 0 0", &["scene.obj:5", "w = 0"]),
            (
                "v 1 1 0",
                "v 1 1 0 1 1",
                &["scene.obj:5", "found 5 numbers"],
            ),
            (
                "v 1 1 0",
                "v 1 1 0 1 1 1 1",
                &["scene.obj:5", "found 7 numbers"],
            ),
            ("v 1 1 0", "v", &["scene.obj:5", "found 0 numbers"]),
            ("vt 0 0", "vt", &["scene.obj:7", "found 0 numbers"]),
            ("vt 0 0", "vt 0 NaN", &["scene.obj:7", "found NaN"]),
            ("vn 0 0 1", "vn 0 0", &["scene.obj:8", "found 2 numbers"]),
            ("vn 0 0 1", "vn 0 0 inf", &["scene.obj:8", "found inf"]),
            (
                "usemtl red",
                "usemtl green",
                &["scene.obj:11", "material `green` is not defined"],
            ),
            (
                "usemtl red",
                "usemtl",
                &["scene.obj:11", "no material name"],
            ),
            (
                "mtllib scene.mtl\n",
                "",
                &["scene.obj:8", "material `white`", "no mtllib"],
            ),
            (
                "mtllib scene.mtl",
                "mtllib",
                &["scene.obj:2", "no file name"],
            ),
            (
                "mtllib scene.mtl",
                "mtllib other.mtl",
                &["scene.obj:2", "other.mtl: No such file"],
            ),
            (
                "mtllib scene.mtl",
                "mtllib scene.mtl other.mtl",
                &["scene.obj:2", "other.mtl: No such file"],
            ),
            (
                "mtllib scene.mtl",
                "mtllib ../scene.mtl",
                &["scene.obj:2", "leads out"],
            ),
            (
                "mtllib scene.mtl",
                "mtllib /etc/passwd",
                &["scene.obj:2", "absolute path"],
            ),
            (
                "mtllib scene.mtl",
                "mtllib ..\\scene.mtl",
                &["scene.obj:2", "leads out"],
            ),
            ("v 1 1 0", "v 1 1 0\0", &["scene.obj: ", "zero bytes"]),
            // The line that a continuation starts on counts.
            (
                "f 1/1/1 2/1/1",
                "f 1/1/1 \\\n 2/1/1 \\\n 77/1/1",
                &["scene.obj:10", "77 out of range"],
            ),
        ],
    );
}

#[test]
fn bad_mtl_files_are_refused() {
    every_edit_is_refused(
        "scene.mtl",
        MTL,
        &[
            (
                "Kd 0.8 0.8 0.8",
                "Kd 0.8 abc 0.8",
                &["scene.mtl:2", "Kd: 'abc' is not a number"],
            ),
            (
                "Kd 0.8 0.8 0.8",
                "Kd 0.8 0.8",
                &[
                    "scene.mtl:2",
                    "Kd: found `0.8 0.8`; expected one number or three",
                ],
            ),
            (
                "Kd 0.8 0.8 0.8",
                "Kd 0.8 0.8 0.8 0.8",
                &["scene.mtl:2", "expected one number or three"],
            ),
            ("Kd 0.8 0.8 0.8", "Kd", &["scene.mtl:2", "Kd"]),
            (
                "Kd 0.8 0.8 0.8",
                "Kd 0.8 1.5 0.8",
                &["scene.mtl:2", "0.8 1.5 0.8", "`white`", "0 to 1"],
            ),
            (
                "Kd 0.8 0.8 0.8",
                "Kd 0.8 -0.5 0.8",
                &["scene.mtl:2", "-0.5"],
            ),
            (
                "Kd 0.8 0.8 0.8",
                "Kd 0.8 nan 0.8",
                &["scene.mtl:2", "'nan' is not a finite number"],
            ),
            (
                "Kd 0.8 0.8 0.8",
                "Kd spectral a.rfl",
                &["scene.mtl:2", "`Kd spectral` is not supported"],
            ),
            (
                "Kd 0.8 0.8 0.8",
                "Kd xyz 1 1 1",
                &["scene.mtl:2", "`Kd xyz` is not supported"],
            ),
            (
                "Ks 0.1 0.1 0.1",
                "Ks 2",
                &["scene.mtl:6", "Ks: found 2", "`red`"],
            ),
            ("Ks 0.1 0.1 0.1", "Ks 0.1 0.1 inf", &["scene.mtl:6", "inf"]),
            (
                "Ns 10",
                "Ns -1",
                &["scene.mtl:7", "Ns: found -1", "`red`", "0 to 1000000"],
            ),
            ("Ns 10", "Ns 2e6", &["scene.mtl:7", "Ns: found 2000000"]),
            ("Ns 10", "Ns ten", &["scene.mtl:7", "'ten' is not a number"]),
            ("Ns 10", "Ns", &["scene.mtl:7", "expected one number"]),
            ("Ns 10", "Ns 10 10", &["scene.mtl:7", "expected one number"]),
            (
                "Ns 10",
                "Pr 1.5",
                &["scene.mtl:7", "Pr: found 1.5", "`red`", "0 to 1"],
            ),
            (
                "Ns 10",
                "Pr nan",
                &["scene.mtl:7", "'nan' is not a finite number"],
            ),
            ("Ns 10", "Pm -1", &["scene.mtl:7", "Pm: found -1", "`red`"]),
            ("d 1", "d 1.5", &["scene.mtl:8", "d: found 1.5"]),
            ("d 1", "d", &["scene.mtl:8", "expected one number"]),
            ("d 1", "Tr -0.1", &["scene.mtl:8", "Tr: found -0.1"]),
            (
                "Ke 0 0 0",
                "Ke 0 -1 0",
                &["scene.mtl:9", "Ke: found 0 -1 0"],
            ),
            ("Ke 0 0 0", "Ke 0 inf 0", &["scene.mtl:9", "inf"]),
            ("newmtl red", "newmtl", &["scene.mtl:4", "no name"]),
            (
                "newmtl white\n",
                "",
                &["scene.mtl:1", "before any `newmtl`"],
            ),
            ("map_Kd t.png", "map_Kd", &["scene.mtl:3", "no file name"]),
            (
                "map_Kd t.png",
                "map_Kd -s 1 1 1",
                &["scene.mtl:3", "1: No such file"],
            ),
            (
                "map_Kd t.png",
                "map_Kd u.png",
                &["scene.mtl:3", "map_Kd", "u.png: No such file"],
            ),
            (
                "map_Kd t.png",
                "map_Kd ../t.png",
                &["scene.mtl:3", "leads out"],
            ),
            (
                "map_Kd t.png",
                "map_Kd /t.png",
                &["scene.mtl:3", "absolute path"],
            ),
            (
                "map_Kd t.png",
                "map_Kd scene.obj",
                &["scene.mtl:3", "scene.obj: not a PNG or JPEG file"],
            ),
            (
                "d 1",
                "map_d u.png",
                &["scene.mtl:8", "map_d", "u.png: No such file"],
            ),
            (
                "d 1",
                "map_Pr u.png",
                &["scene.mtl:8", "map_Pr", "u.png: No such file"],
            ),
            (
                "d 1",
                "map_Pm u.png",
                &["scene.mtl:8", "map_Pm", "u.png: No such file"],
            ),
            (
                "d 1",
                "map_Ke u.png",
                &["scene.mtl:8", "map_Ke", "u.png: No such file"],
            ),
            (
                "d 1",
                "norm u.png",
                &["scene.mtl:8", "norm", "u.png: No such file"],
            ),
        ],
    );
}

#[test]
fn bad_textures_are_refused() {
    let good = png(2, 2);
    let cut = &good[..good.len() - 20];
    let mut wrong_sum = good.clone();
    let last = wrong_sum.len() - 20;
    wrong_sum[last] ^= 0xFF;
    let huge = png(20_000, 1);
    let cases: [(&str, &[u8], &str); 6] = [
        ("empty", b"", "not a PNG or JPEG"),
        ("text", b"hello, this is no picture", "not a PNG or JPEG"),
        ("cut", cut, "t.png"),
        ("damaged", &wrong_sum, "t.png"),
        ("huge", &huge, "16384"),
        ("half a JPEG", b"\xFF\xD8\xFF\xE0\x00\x10JFIF", "t.png"),
    ];
    for (what, bytes, expected) in cases {
        let error = load_with(&[("t.png", bytes)]).expect_err(what).to_string();
        assert!(error.contains(expected), "{what}: {error}");
        assert!(error.contains("scene.mtl:3: map_Kd"), "{what}: {error}");
    }
}

#[test]
fn files_that_are_no_text_are_refused() {
    for file in ["scene.ron", "lights.ron"] {
        let error = load_with(&[(file, b"(\n\xFF")])
            .expect_err(file)
            .to_string();
        assert!(error.contains(&format!("{file}:2:1")), "{error}");
    }
    for file in ["scene.obj", "scene.mtl"] {
        let error = load_with(&[(file, &png(2, 2))])
            .expect_err(file)
            .to_string();
        assert!(
            error.contains(file) && error.contains("zero bytes"),
            "{error}"
        );
    }
    let error = load(Path::new("no/such/scene.ron")).expect_err("no file");
    assert!(
        error
            .to_string()
            .contains("no/such/scene.ron: No such file"),
        "{error}"
    );
    let error = load(Path::new("$MANYLIGHT_NOT_SET/scene.ron")).expect_err("no variable");
    assert!(
        error.to_string().contains("MANYLIGHT_NOT_SET is not set"),
        "{error}"
    );
}

#[test]
fn damaged_files_never_panic() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_owned();
    let pieces = [
        "\\\n",
        "/",
        "-1",
        "0",
        "99999999999",
        "nan",
        "1e40",
        "#",
        "\n",
        "f ",
        "v ",
        "vt 1\n",
        "vn 0 0 0\n",
        "usemtl ",
        "mtllib ",
        "l 1 2 3\n",
        "newmtl a\n",
        "Kd 0.5\n",
        "map_Kd -s ",
        "(",
        ")",
        ":",
        "é",
        "\r",
        "\t",
        "Tr 0.5\n",
        "f 1 2 3 4 1 2\n",
        "-",
        "\"",
        "[",
        ",",
    ];
    verify::property(1000, |u| {
        for (name, good) in [
            ("scene.ron", SCENE),
            ("scene.obj", OBJ),
            ("scene.mtl", MTL),
            ("lights.ron", LIGHTS),
        ] {
            let mut bytes = good.as_bytes().to_vec();
            for _ in 0..u.int_in_range(0..=3)? {
                let start = u.choose_index(bytes.len() + 1)?;
                let end = bytes.len().min(start + u.int_in_range(0..=6)?);
                let with: Vec<u8> = match u.ratio(1, 8)? {
                    true => vec![u.arbitrary()?],
                    false => u.choose(&pieces)?.as_bytes().to_vec(),
                };
                bytes.splice(start..end, with);
            }
            std::fs::write(path.join(name), bytes).expect("a file");
        }
        std::fs::write(path.join("t.png"), png(1, 1)).expect("a file");
        if let Ok(scene) = load(&path.join("scene.ron")) {
            let mesh = &scene.mesh;
            let finite = mesh.positions.iter().all(|p| p.is_finite());
            assert!(finite, "positions of a loaded scene are finite");
            let vertices = mesh.positions.len();
            let in_range = mesh
                .indices
                .iter()
                .flatten()
                .all(|&i| (i as usize) < vertices);
            assert!(in_range, "indices of a loaded scene are in range");
            let materials = scene.materials.len();
            let known = mesh.materials.iter().all(|m| (m.0 as usize) < materials);
            assert!(known, "materials of a loaded scene exist");
        }
        Ok(())
    });
}
