//! What OBJ and MTL allow, loads, and means what it says.

use glam::Vec3;
use image::{DynamicImage, ImageFormat};
use manylight_scene::{ABSENT, Emitter, Scene, load::load};

const CAMERA: &str =
    "camera: (origin: (0, 1, 5), target: (0, 1, 0), up: (0, 1, 0), fov_y_deg: 60.0)";

/// A scene of one OBJ, one MTL and one white texture `t.png`.
fn load_obj(obj: &str, mtl: &str) -> Scene {
    load_files(obj.as_bytes(), mtl, &DynamicImage::new_rgb8(1, 1))
}

fn load_files(obj: &[u8], mtl: &str, texture: &DynamicImage) -> Scene {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let scene = format!("(geometry: [\"a.obj\"], {CAMERA}, lights: [])");
    std::fs::write(path("scene.ron"), scene).expect("a file");
    std::fs::write(path("a.obj"), obj).expect("a file");
    std::fs::write(path("a.mtl"), mtl).expect("a file");
    let written = texture.save_with_format(path("t.png"), ImageFormat::Png);
    written.expect("a texture");
    load(&path("scene.ron")).unwrap_or_else(|e| panic!("{e}"))
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn corners(scene: &Scene) -> Vec<[[f32; 3]; 3]> {
    let mesh = &scene.mesh;
    (0..mesh.len())
        .map(|t| mesh.corners(t).map(Into::into))
        .collect()
}

#[test]
fn polygons_become_fans() {
    let scene = load_obj(&format!("{SQUARE}f 1 2 3 4\n"), "");
    let (a, b, c, d) = ([0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]);
    assert_eq!(corners(&scene), [[a, b, c], [a, c, d]], "two triangles");
    let scene = load_obj(&format!("{SQUARE}v -1 0.5 0\nf 1 2 3 4 5\n"), "");
    assert_eq!(scene.mesh.len(), 3, "a pentagon");
    assert_eq!(scene.mesh.positions.len(), 5, "vertices stay shared");
}

#[test]
fn every_way_to_write_a_number_or_line_is_read() {
    let plain = corners(&load_obj(&format!("{SQUARE}f 1 2 3\nf 1 3 4\n"), ""));
    for (what, obj) in [
        (
            "CRLF",
            format!("{SQUARE}f 1 2 3\nf 1 3 4\n").replace('\n', "\r\n"),
        ),
        ("BOM", format!("\u{FEFF}{SQUARE}f 1 2 3\nf 1 3 4\n")),
        ("negative", format!("{SQUARE}f -4 -3 -2\nf -4 -2 -1\n")),
        ("forward", format!("f 1 2 3\nf 1 3 4\n{SQUARE}")),
        ("continued", format!("{SQUARE}f 1 \\\n2 \\\r\n3\nf 1 3 4")),
        (
            "tabs",
            format!("{SQUARE}f\t1 \t2\t3\n\tf 1 3 4\n").replace("v ", "v\t"),
        ),
        (
            "comments",
            format!("# x\n{SQUARE}f 1 2 3 # f 1 2 4\n#f 1 2 4\nf 1 3 4"),
        ),
        (
            "exponents",
            "v 0 0 0\nv 1e0 0 0\nv +1.0 10E-1 -0\nv 0.0 .1e+1 0 1\nf 1 2 3\nf 1 3 4".to_owned(),
        ),
        (
            "w",
            "v 0 0 0\nv 2 0 0 2\nv 1 1 0 1\nv 0 -3 0 -3\nf 1 2 3\nf 1 3 4".to_owned(),
        ),
        (
            "colours",
            "v 0 0 0 1 1 1\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4".to_owned(),
        ),
        (
            "groups",
            format!("o a\ng b c\ns off\n{SQUARE}f 1 2 3\no\ng\nf 1 3 4\n"),
        ),
    ] {
        assert_eq!(corners(&load_obj(&obj, "")), plain, "{what}");
    }
}

#[test]
fn faces_keep_only_the_attributes_they_have() {
    let obj = format!(
        "{SQUARE}vt 0.25 0.5\nvn 0 0 2\nf 1//1 2//1 3//1\nf 1/1 3/1 4/1\nf 1 2 4\nf 2/1/1 3/1/1 4/1/1"
    );
    let mesh = load_obj(&obj, "").mesh;
    let has =
        |indices: &[[u32; 3]]| -> Vec<bool> { indices.iter().map(|i| i[0] != ABSENT).collect() };
    assert_eq!(
        has(&mesh.normal_indices),
        [true, false, false, true],
        "normals"
    );
    assert_eq!(
        has(&mesh.uv_indices),
        [false, true, false, true],
        "texture coordinates"
    );
    assert_eq!(mesh.normals, [Vec3::Z], "of unit length");
    assert_eq!(mesh.uvs[0].to_array(), [0.25, 0.5], "as stored");
    let bare = load_obj(&format!("{SQUARE}f 1 2 3"), "").mesh;
    assert!(
        bare.normal_indices.is_empty() && bare.uv_indices.is_empty(),
        "nobody has any"
    );
}

#[test]
fn lines_and_unknown_keywords_are_no_triangles() {
    let scene = load_obj(&format!("{SQUARE}l 1 2 3\np 1 2 3\nfoo 1 2 3\nf 1 2 3"), "");
    assert_eq!(scene.mesh.len(), 1, "only the face");
    let remarks = scene.notes.remarks.join("\n");
    for part in ["a.obj:5: `l`", "a.obj:6: `p`", "a.obj:7: `foo`"] {
        assert!(remarks.contains(part), "{part} in {remarks}");
    }
}

#[test]
fn what_is_dropped_is_counted() {
    let obj = format!(
        "{SQUARE}v 2 0 0\nvn 0 0 0\nvn 0 0 1\nf 1//1 2//2 3//2\nf 1 2 5\nf 1 1 2\nf 3 1 2\nf 1 3 4"
    );
    let scene = load_obj(&obj, "");
    assert_eq!(scene.mesh.len(), 2, "kept");
    assert_eq!(scene.notes.degenerate_triangles, 2, "no area");
    assert_eq!(scene.notes.duplicate_triangles, 1, "repeated");
    assert_eq!(scene.notes.zero_normals, 1, "a normal without direction");
    assert!(
        scene.mesh.normal_indices.is_empty(),
        "its triangle shades flat"
    );
}

#[test]
fn empty_scenes_are_black_but_legal() {
    let scene = load_obj("", "");
    assert!(
        scene.mesh.is_empty() && scene.emitters.is_empty(),
        "nothing"
    );
    let remarks = scene.notes.remarks.join("\n");
    assert!(remarks.contains("no triangles"), "{remarks}");
}

#[test]
fn materials_mean_what_they_say() {
    let obj = format!("mtllib a.mtl\n{SQUARE}f 1 2 3\nusemtl one name\nf 1 3 4\nusemtl b\nf 1 2 4");
    let mtl = "# materials\r\nnewmtl one name\r\n\tKd 0.5 # grey\r\nTr 0.25\r\nillum 2\r\nmap_Kd -bm 1 -s 1 1 1 .\\t.png\r\nnewmtl b\nKd .93 .93 .2\nKs 0.5 0 0.1\nNs 1e3\nKe 1 2 3\nd 0.5\nTr 0.9\nmap_d t.png\nnorm t.png\nrefl x.png\n";
    let scene = load_obj(&obj, mtl);
    let [default, a, b] = &scene.materials[..] else {
        panic!("three materials");
    };
    let used: Vec<u32> = scene.mesh.materials.iter().map(|m| m.0).collect();
    assert_eq!(used, [0, 1, 2], "a face before usemtl has the default");
    assert_eq!(default.name, "default", "the default is first");
    assert_eq!(
        (a.name.as_str(), a.diffuse),
        ("one name", Vec3::splat(0.5)),
        "one number"
    );
    assert_eq!(a.opacity, 0.75, "1 - Tr");
    assert_eq!(b.opacity, 0.5, "d counts, not Tr");
    assert_eq!(b.emission, Vec3::new(1.0, 2.0, 3.0), "Ke");
    assert_eq!(b.alpha, manylight_scene::alpha_of_exponent(1000.0), "Ns");
    assert_eq!(b.normal_map, None, "grey texels are heights");
    let sum = b.diffuse + b.specular;
    assert!(
        sum.max_element() <= 1.0 + 1e-6,
        "energy is conserved: {sum}"
    );
    assert!(
        (b.diffuse.y - 0.93).abs() < 1e-6,
        "a channel that fits is kept"
    );
    assert_eq!(scene.textures.len(), 1, "one entry per file");
    assert!(
        a.diffuse_map.is_some() && a.diffuse_map == b.opacity_map,
        "shared"
    );
    assert_eq!(
        scene.notes.ignored_emissive_materials, 1,
        "Ke without Emissive"
    );
    let remarks = scene.notes.remarks.join("\n");
    for part in [
        "refl",
        "t.png is a map of heights",
        "options without effect: -bm 1 -s 1 1 1",
        "material `b`: Kd + Ks reaches 1.43",
    ] {
        assert!(remarks.contains(part), "{part} in {remarks}");
    }
}

#[test]
fn roughness_and_metalness_replace_the_highlight() {
    let obj = format!("mtllib a.mtl\n{SQUARE}usemtl m\nf 1 2 3\nusemtl p\nf 1 3 4");
    let mtl = "newmtl m\nKd 0.9 0.6 0.3\nKs 1 1 1\nPr 0.5\nPm 1\nnewmtl p\nKd 1 1 1\nPm 0\nNs 6\n";
    let scene = load_obj(&obj, mtl);
    let (metal, plastic) = (&scene.materials[1], &scene.materials[2]);
    assert_eq!(
        (metal.metallic, metal.alpha),
        (Some(1.0), 0.25),
        "Pr squared"
    );
    assert_eq!(
        (plastic.metallic, plastic.alpha),
        (Some(0.0), 0.5),
        "without Pr, Ns tells"
    );
    assert!(metal.is_glossy() && plastic.is_glossy(), "both are glossy");
    let remarks = scene.notes.remarks.join("\n");
    assert!(
        remarks.contains("material `m` has Pr or Pm, beside which Ks has no effect"),
        "{remarks}"
    );
}

#[test]
fn maps_of_roughness_and_metalness_multiply_at_each_point() {
    let obj = format!("mtllib a.mtl\n{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nusemtl m\nf 1/1 2/2 3/3");
    let texel = image::RgbImage::from_pixel(1, 1, image::Rgb([51, 0, 255]));
    let surface = |mtl: &str| {
        let scene = load_files(obj.as_bytes(), mtl, &texel.clone().into());
        let hit = manylight_scene::trace::Hit {
            t: 1.0,
            triangle: 0,
            u: 0.25,
            v: 0.25,
        };
        scene.surface(&hit, Vec3::NEG_Z)
    };
    let both = surface("newmtl m\nKd 1 1 1\nPr 0.5\nPm 0.5\nmap_Pr t.png\nmap_Pm t.png\n").brdf;
    assert!((both.alpha - 0.01).abs() < 1e-6, "red is 0.2: {both:?}");
    assert!(
        (both.diffuse.x - 0.9).abs() < 1e-6,
        "half of 0.2 is metal: {both:?}"
    );
    let alone = surface("newmtl m\nKd 1 1 1\nmap_Pr t.png\n").brdf;
    assert!(
        (alone.alpha - 0.04).abs() < 1e-6,
        "a map alone is the roughness: {alone:?}"
    );
    assert_eq!(alone.diffuse, Vec3::ONE, "and no metal: {alone:?}");
    let metal = surface("newmtl m\nKd 1 1 1\nPr 0\nmap_Pm t.png\n").brdf;
    assert!(
        (metal.diffuse.x - 0.8).abs() < 1e-6,
        "a map alone is the metalness: {metal:?}"
    );
}

#[test]
fn every_kind_of_png_becomes_eight_bit_colour() {
    let obj = format!("mtllib a.mtl\n{SQUARE}usemtl a\nf 1 2 3");
    let mtl = "newmtl a\nKd 1 1 1\nmap_Kd t.png\n";
    let texture = |image: &DynamicImage| {
        let scene = load_files(obj.as_bytes(), mtl, image);
        scene.textures.into_iter().next().expect("a texture")
    };
    let grey = image::GrayImage::from_pixel(2, 3, image::Luma([7]));
    let grey = texture(&grey.into());
    assert_eq!(
        (grey.width, grey.height, grey.has_alpha),
        (2, 3, false),
        "grey"
    );
    assert_eq!(grey.texels, [[7, 7, 7, 255]; 6], "grey in all channels");
    let deep = image::ImageBuffer::from_pixel(1, 1, image::Rgb([65535u16, 0, 32768]));
    assert_eq!(
        texture(&deep.into()).texels,
        [[255, 0, 128, 255]],
        "sixteen bits"
    );
    let alpha = image::RgbaImage::from_pixel(1, 1, image::Rgba([1, 2, 3, 4]));
    let alpha = texture(&alpha.into());
    assert_eq!(
        (alpha.texels[0], alpha.has_alpha),
        ([1, 2, 3, 4], true),
        "alpha"
    );
}

#[test]
fn bytes_that_are_not_utf8_are_replaced_with_a_remark() {
    let mut obj = b"# caf\xE9\n".to_vec();
    obj.extend(format!("{SQUARE}f 1 2 3").as_bytes());
    let scene = load_files(&obj, "", &DynamicImage::new_rgb8(1, 1));
    assert_eq!(scene.mesh.len(), 1, "the face");
    assert!(
        scene.notes.remarks.join(" ").contains("not UTF-8"),
        "a remark"
    );
}

#[test]
fn several_geometry_files_and_folders_merge() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let write = |name: &str, text: &str| std::fs::write(path(name), text).expect("a file");
    for name in ["one", "two", "maps"] {
        std::fs::create_dir(path(name)).expect("a folder");
    }
    let scene = format!(
        "(geometry: [\"one/a.obj\", \"two/b.obj\"], {CAMERA}, lights: [Point(position: (0, 1, 0), intensity: (0, 0, 0))])"
    );
    write("scene.ron", &scene);
    let obj = |shift: u32| {
        format!(
            "mtllib m.mtl\nv {shift} 0 0\nv 5 1 0\nv 5 5 1\nvn 0 1 0\nusemtl a\nf 1//1 2//1 3//1"
        )
    };
    write("one/a.obj", &obj(1));
    write("two/b.obj", &obj(2));
    write("one/m.mtl", "newmtl a\nKd 0.1\nmap_Kd ../maps/t.png\n");
    write("two/m.mtl", "newmtl a\nKd 0.2\nmap_Kd ../maps/t.png\n");
    image::RgbImage::new(1, 1)
        .save(path("maps/t.png"))
        .expect("a texture");
    let scene = load(&path("scene.ron")).unwrap_or_else(|e| panic!("{e}"));
    let first: Vec<f32> = (0..2).map(|t| scene.mesh.corners(t)[0].x).collect();
    assert_eq!(first, [1.0, 2.0], "each has its own vertices");
    let diffuse: Vec<f32> = scene
        .mesh
        .materials
        .iter()
        .map(|m| scene.materials[m.0 as usize].diffuse.x)
        .collect();
    assert_eq!(diffuse, [0.1, 0.2], "and its own material of one name");
    assert_eq!(scene.textures.len(), 1, "the texture is shared");
    assert_eq!(
        scene.notes.zero_power_lights, 1,
        "a light without power is counted"
    );
    assert!(scene.emitters.is_empty(), "and left out");
}

/// A scene with this list of lights, a square of emissive material and one of grey.
fn load_lights(lights: &str, mtl: &str, sky: &DynamicImage, name: &str) -> Scene {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let scene = format!("(geometry: [\"a.obj\"], {CAMERA}, lights: [{lights}])");
    std::fs::write(path("scene.ron"), scene).expect("a file");
    let obj = format!(
        "mtllib a.mtl\n{SQUARE}v 0 0 9\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl lit\n\
         f 1/1 2/2 3/3 4/4\nusemtl grey\nf 1 2 5\n"
    );
    std::fs::write(path("a.obj"), obj).expect("a file");
    std::fs::write(
        path("a.mtl"),
        format!("newmtl grey\nKd 0.5\nnewmtl lit\nKd 0.5\n{mtl}"),
    )
    .expect("a file");
    sky.save(path(name)).expect("a picture");
    load(&path("scene.ron")).unwrap_or_else(|e| panic!("{e}"))
}

fn grey(value: f32) -> DynamicImage {
    image::Rgb32FImage::from_pixel(4, 2, image::Rgb([value; 3])).into()
}

#[test]
fn every_kind_of_light_is_read() {
    let scene = load_lights(
        "Spot(position: (1, 2, 3), direction: (0, 0, -2), intensity: (1, 2, 3), cos_inner: 0.5, cos_outer: 0.5),
         Spot(position: (1, 2, 3), direction: (0, 0, -2), intensity: (1, 2, 3), cos_inner: 1, cos_outer: 1),
         Directional(direction: (0, -3, 0), irradiance: (4, 5, 6)), Emissive, Environment(radiance: (1, 1, 0))",
        "Ke 7 8 9\n",
        &grey(1.0),
        "sky.exr",
    );
    let [spot, parallel, a, b] = &scene.emitters[..] else {
        panic!("four lights: {:?}", scene.emitters);
    };
    let expected = Emitter::Spot {
        position: Vec3::new(1.0, 2.0, 3.0),
        direction: Vec3::NEG_Z,
        intensity: Vec3::new(1.0, 2.0, 3.0),
        cos_inner: 0.5,
        cos_outer: 0.5,
    };
    assert_eq!(*spot, expected, "a hard edge");
    assert_eq!(scene.notes.zero_power_lights, 1, "an angle of 0");
    let expected = Emitter::Directional {
        direction: Vec3::NEG_Y,
        irradiance: Vec3::new(4.0, 5.0, 6.0),
    };
    assert_eq!(*parallel, expected, "parallel light");
    for (light, triangle) in [(a, 0), (b, 1)] {
        let expected = Emitter::Triangle {
            triangle,
            radiance: Vec3::new(7.0, 8.0, 9.0),
            peak: 1.0,
        };
        assert_eq!(*light, expected, "half of the square");
    }
    assert_eq!(scene.emissive, [true, true, false], "one table of lights");
    assert_eq!(scene.emitted(2, 0.3, 0.3), Vec3::ZERO, "the grey one");
    assert_eq!(scene.notes.ignored_emissive_materials, 0, "asked for");
    let sky = scene.environment.expect("a sky");
    assert_eq!(
        sky.radiance(Vec3::X),
        Vec3::new(1.0, 1.0, 0.0),
        "its colour"
    );
}

#[test]
fn environments_are_read_from_every_kind_of_picture() {
    let kinds = [
        ("sky.exr", grey(2.5), 2.5),
        ("sky.hdr", grey(2.5), 2.5),
        // sRGB 188 is half of the light of 255.
        (
            "sky.png",
            image::RgbImage::from_pixel(4, 2, image::Rgb([188; 3])).into(),
            0.503,
        ),
        (
            "sky.jpg",
            image::RgbImage::from_pixel(8, 8, image::Rgb([188; 3])).into(),
            0.503,
        ),
    ];
    for (name, picture, value) in kinds {
        let lights = format!("Environment(image: \"{name}\", scale: 2.0)");
        let scene = load_lights(&lights, "", &picture, name);
        let sky = scene.environment.unwrap_or_else(|| panic!("{name}"));
        let found = sky.radiance(Vec3::X);
        assert!(
            (found - 2.0 * value).abs().max_element() < 0.02,
            "{name}: {found}"
        );
    }
    let lights = "Environment(image: \"sky.exr\")";
    let black = load_lights(lights, "", &grey(0.0), "sky.exr");
    assert!(black.environment.is_none(), "black");
    assert_eq!(black.notes.black_environments, 1, "and counted");
}

#[test]
fn a_texture_makes_the_mean_of_an_emissive_triangle() {
    // The left half bright, the right one black, in a file with an alpha channel that is of no matter.
    let half = image::RgbaImage::from_fn(64, 64, |x, _| {
        image::Rgba([if x < 32 { 255 } else { 0 }, 0, 0, 9])
    });
    let scene = load_lights("Emissive", "Ke 4\nmap_Ke t.png\n", &half.into(), "t.png");
    let mut mean = 0.0;
    for light in &scene.emitters {
        let &Emitter::Triangle {
            triangle,
            radiance,
            peak,
        } = light
        else {
            panic!("{light:?}");
        };
        assert_eq!((radiance.y, radiance.z), (0.0, 0.0), "red only");
        assert!((radiance.x * peak - 4.0).abs() < 1e-4, "bound of {light:?}");
        // The triangles are cut along the diagonal: ¼ and ¾ of each is lit.
        let exact = if triangle == 0 { 1.0 } else { 3.0 };
        assert!((radiance.x - exact).abs() < 0.05, "{light:?}");
        mean += radiance.x / 2.0;
    }
    assert!((mean - 2.0).abs() < 0.03, "half of 4: {mean}");
    let black = image::RgbImage::new(4, 4);
    let scene = load_lights("Emissive", "Ke 4\nmap_Ke t.png\n", &black.into(), "t.png");
    assert!(
        scene.emitters.is_empty() && scene.emissive.is_empty(),
        "no light"
    );
    assert_eq!(scene.notes.dark_emissive_triangles, 2, "counted");
}

#[test]
fn emissive_triangles_without_area_or_of_no_finite_power_are_skipped_and_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let scene = format!("(geometry: [\"a.obj\"], {CAMERA}, lights: [Emissive])");
    std::fs::write(path("scene.ron"), scene).expect("a file");
    // A square, a triangle without area, one as large as coordinates may be, and one that blinds.
    let obj = format!(
        "mtllib a.mtl\n{SQUARE}v 2 0 0\nv 1e12 0 0\nv 0 1e12 0\nusemtl lit\nf 1 2 3 4\nf 1 2 5\n\
         f 1 6 7\nusemtl blinding\nf 1 2 4\n"
    );
    std::fs::write(path("a.obj"), obj).expect("a file");
    let mtl = "newmtl lit\nKd 0\nKe 1e16\nnewmtl blinding\nKd 0\nKe 3e38\n";
    std::fs::write(path("a.mtl"), mtl).expect("a file");
    let scene = load(&path("scene.ron")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(scene.emitters.len(), 2, "the square");
    assert_eq!(scene.emissive, [true, true, false, false], "and no other");
    assert_eq!(scene.notes.degenerate_triangles, 1, "without area");
    assert_eq!(scene.notes.dark_emissive_triangles, 2, "of no finite power");
}
