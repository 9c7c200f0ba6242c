//! The built-in nave as a reader of its files sees it.

use manylight_procedural::{NAMES, SceneFile, files};
use std::collections::HashSet;
use std::path::Path;
use std::sync::OnceLock;

type Point = [f64; 3];

fn nave() -> &'static [SceneFile] {
    static FILES: OnceLock<Vec<SceneFile>> = OnceLock::new();
    FILES.get_or_init(|| files("nave").expect("the nave is built in"))
}

fn text(name: &str) -> &'static str {
    let file = nave()
        .iter()
        .find(|f| f.name == name)
        .expect("the file is in the list");
    std::str::from_utf8(&file.bytes).expect("text files are UTF-8")
}

/// The OBJ file taken at its word: indices are only checked, numbers only parsed.
#[derive(Default)]
struct Obj {
    points: Vec<Point>,
    uvs: usize,
    normals: Vec<Point>,
    triangles: Vec<[usize; 3]>,
    triangle_normals: Vec<Option<[usize; 3]>>,
    materials: Vec<String>,
}

impl Obj {
    fn corners(&self, triangle: usize) -> [Point; 3] {
        self.triangles[triangle].map(|k| self.points[k])
    }
}

fn number(word: &str) -> f64 {
    let value: f64 = word.parse().expect("numbers parse");
    assert!(value.is_finite(), "{word}");
    value
}

fn obj() -> &'static Obj {
    static OBJ: OnceLock<Obj> = OnceLock::new();
    OBJ.get_or_init(|| {
        let mut obj = Obj::default();
        for line in text("scene.obj").lines() {
            let mut words = line.split(' ');
            let keyword = words.next().expect("lines are not empty");
            let words: Vec<&str> = words.collect();
            match keyword {
                "v" | "vn" => {
                    let numbers: Vec<f64> = words.iter().map(|w| number(w)).collect();
                    let vector = [numbers[0], numbers[1], numbers[2]];
                    if keyword == "v" {
                        obj.points.push(vector)
                    } else {
                        obj.normals.push(vector)
                    }
                }
                "vt" => {
                    words.iter().for_each(|w| _ = number(w));
                    obj.uvs += 1;
                }
                "usemtl" => obj.materials.push(words[0].to_owned()),
                "mtllib" => assert_eq!(words, ["scene.mtl"], "one library"),
                "f" => {
                    let corner = |w: &str, part: usize, count: usize| {
                        let word = w.split('/').nth(part).unwrap_or("");
                        (!word.is_empty()).then(|| {
                            let index: usize = word.parse().expect("indices parse");
                            assert!((1..=count).contains(&index), "{line}");
                            index - 1
                        })
                    };
                    assert_eq!(words.len(), 3, "{line}");
                    let at = |k: usize| corner(words[k], 0, obj.points.len()).expect("a position");
                    let triangle = [at(0), at(1), at(2)];
                    let uv = [0, 1, 2].map(|k| corner(words[k], 1, obj.uvs).is_some());
                    assert!(uv[0] == uv[1] && uv[1] == uv[2], "{line}");
                    let n = [0, 1, 2].map(|k| corner(words[k], 2, obj.normals.len()));
                    let normals = match n {
                        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
                        [None, None, None] => None,
                        _ => panic!("{line}"),
                    };
                    obj.triangles.push(triangle);
                    obj.triangle_normals.push(normals);
                }
                _ => panic!("unexpected line: {line}"),
            }
        }
        obj
    })
}

fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Positions of the lamps, read with nothing but the brackets.
fn lamps() -> Vec<Point> {
    let lines = text("lights.ron")
        .lines()
        .filter(|l| l.contains("position"));
    lines
        .map(|line| {
            let inside = line.split('(').nth(2).and_then(|l| l.split(')').next());
            let numbers: Vec<f64> = inside
                .expect("a vector in brackets")
                .split(", ")
                .map(number)
                .collect();
            [numbers[0], numbers[1], numbers[2]]
        })
        .collect()
}

#[test]
fn every_name_has_files_and_other_names_have_none() {
    for name in NAMES {
        assert!(files(name).is_some(), "{name}");
    }
    assert!(files("navel").is_none(), "no such scene");
}

#[test]
fn two_calls_give_the_same_bytes() {
    assert!(
        files("nave").as_deref() == Some(nave()),
        "the generator is deterministic"
    );
}

#[test]
fn the_size_is_what_the_readme_promises() {
    let count = obj().triangles.len();
    assert!((60_000..=150_000).contains(&count), "{count} triangles");
    let lamps = lamps();
    assert_eq!(lamps.len(), 120, "lamps");
    assert!(
        lamps.iter().all(|p| p[1] > 15.0),
        "all lamps hang inside the dome"
    );
}

#[test]
fn triangles_have_area_and_occur_once() {
    let obj = obj();
    let mut seen = HashSet::new();
    for k in 0..obj.triangles.len() {
        let [a, b, c] = obj.corners(k);
        let area = cross(sub(b, a), sub(c, a));
        assert!(
            dot(area, area) > 0.0,
            "triangle {k} has no area: {a:?} {b:?} {c:?}"
        );
        let mut bits = [a, b, c].map(|p| p.map(f64::to_bits));
        bits.sort_unstable();
        assert!(
            seen.insert(bits),
            "triangle {k} occurs twice: {a:?} {b:?} {c:?}"
        );
    }
}

#[test]
fn normals_are_unit_and_on_the_side_of_the_winding() {
    let obj = obj();
    for n in &obj.normals {
        assert!((dot(*n, *n) - 1.0).abs() < 1e-3, "{n:?}");
    }
    for k in 0..obj.triangles.len() {
        let Some(normals) = obj.triangle_normals[k] else {
            continue;
        };
        let [a, b, c] = obj.corners(k);
        let face = cross(sub(b, a), sub(c, a));
        for n in normals {
            assert!(dot(face, obj.normals[n]) > 0.0, "triangle {k} at {a:?}");
        }
    }
}

#[test]
fn materials_reflect_no_more_than_they_receive_and_are_all_known() {
    let (mut names, mut kd) = (HashSet::new(), [0.0; 3]);
    for line in text("scene.mtl").lines().filter(|l| !l.is_empty()) {
        let words: Vec<&str> = line.split(' ').collect();
        match words[0] {
            "newmtl" => assert!(names.insert(words[1].to_owned()), "{line}"),
            "Kd" => kd = [1, 2, 3].map(|k| number(words[k])),
            "Ks" => (0..3).for_each(|k| {
                let sum = kd[k] + number(words[k + 1]);
                assert!((0.0..=1.0).contains(&sum), "{line} after Kd {kd:?}");
            }),
            "Ns" | "illum" => assert!(number(words[1]) >= 1.0, "{line}"),
            "map_Kd" => assert!(nave().iter().any(|f| f.name == words[1]), "{line}"),
            _ => panic!("unexpected line: {line}"),
        }
    }
    for used in &obj().materials {
        assert!(names.contains(used), "{used}");
    }
}

#[test]
fn textures_decode_and_are_small() {
    let pictures: Vec<_> = nave().iter().filter(|f| f.name.ends_with(".png")).collect();
    assert!(!pictures.is_empty(), "there are textures");
    for file in pictures {
        let image = image::load_from_memory(&file.bytes)
            .expect("a PNG")
            .to_rgb8();
        assert!(
            image.width() <= 512 && image.height() <= 512,
            "{}",
            file.name
        );
    }
}

/// Distance along `direction` to the nearest triangle, by brute force.
fn nearest(origin: Point, direction: Point) -> Option<f64> {
    let obj = obj();
    let hits = (0..obj.triangles.len()).filter_map(|k| {
        let [a, b, c] = obj.corners(k);
        let (ab, ac) = (sub(b, a), sub(c, a));
        let p = cross(direction, ac);
        let determinant = dot(ab, p);
        let from = sub(origin, a);
        let u = dot(from, p) / determinant;
        if !(0.0..=1.0).contains(&u) {
            return None;
        }
        let q = cross(from, ab);
        let v = dot(direction, q) / determinant;
        let t = dot(ac, q) / determinant;
        (v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
    });
    hits.min_by(f64::total_cmp)
}

/// Evenly spread directions: a spiral over the sphere.
fn spiral(k: usize, count: usize) -> Point {
    let y = 1.0 - 2.0 * (k as f64 + 0.5) / count as f64;
    let angle = 2.399_963_229_728_653 * k as f64;
    let r = (1.0 - y * y).sqrt();
    [r * angle.cos(), y, r * angle.sin()]
}

#[test]
fn no_ray_escapes() {
    // Nave, both aisles, crossing, dome, transept, choir and apse.
    let places = [
        [-17.0, 2.0, 0.3],
        [-9.0, 7.0, -0.4],
        [-12.3, 2.0, 6.1],
        [-4.2, 2.5, -6.3],
        [4.1, 3.0, 0.2],
        [4.3, 15.3, -0.1],
        [3.9, 5.0, 6.4],
        [11.1, 6.0, 0.3],
        [14.9, 5.0, -0.2],
    ];
    const RAYS: usize = 100;
    for place in places {
        for k in 0..RAYS {
            let direction = spiral(k, RAYS);
            let distance = nearest(place, direction);
            assert!(
                distance.is_some_and(|d| d < 40.0),
                "from {place:?} along {direction:?}"
            );
        }
    }
}

#[test]
fn lamps_hang_free_in_the_dome() {
    // The rings repeat the dome's sixteen sectors: every fifth lamp sees all there is.
    for lamp in lamps().into_iter().step_by(5) {
        for k in 0..14 {
            let distance = nearest(lamp, spiral(k, 14)).expect("the dome is closed");
            assert!(
                distance > 0.2,
                "a lamp at {lamp:?} is {distance} m from a surface"
            );
        }
    }
}

#[test]
fn the_committed_scene_is_in_step_with_the_generator() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/nave");
    let committed =
        |name: &str| std::fs::read_to_string(folder.join(name)).expect("the file is committed");
    assert_eq!(committed("lights.ron"), text("lights.ron"), "lights.ron");
    let builtin = text("scene.ron").replace("\"scene.obj\"", "\"builtin:nave/scene.obj\"");
    assert_eq!(committed("scene.ron"), builtin, "scene.ron");
}
