//! Bad files and command lines: each is refused with exit code 2 and one error that names the place, what was
//! found and what was expected; none panics or leaves a file behind.

mod support;

use support::{Folder, Ran};

/// Exit code 2, one error, no panic, and all of `parts` in it.
#[track_caller]
fn assert_refused(folder: &Folder, before: &[std::path::PathBuf], ran: &Ran, parts: &[&str]) {
    let said = &ran.stderr;
    assert_eq!(ran.code, 2, "{}: {said}", ran.line);
    let errors = said.lines().filter(|l| l.starts_with("error: ")).count();
    assert_eq!(errors, 1, "{}: one error in: {said}", ran.line);
    assert!(!said.contains("panicked"), "{}: {said}", ran.line);
    for part in parts {
        assert!(said.contains(part), "{}: no {part:?} in: {said}", ran.line);
    }
    assert_eq!(ran.stdout, "", "{}: stdout carries results", ran.line);
    assert_eq!(folder.files(), before, "{}: a file was left", ran.line);
}

/// A changed run file: what is replaced, by what, the line of the error, and what it says.
type Change = (&'static str, &'static str, u32, &'static [&'static str]);

#[rustfmt::skip]
const RUN_FILES: &[Change] = &[
    ("seed: 1", "sed: 1", 6, &["sed", "seed"]),
    ("spp: 3", "samples: 3", 3, &["samples", "spp"]),
    ("count: 500", "number: 500", 4, &["number", "count"]),
    ("cut: 4", "cuts: 4", 5, &["cuts", "cut"]),
    ("width: 32", "width: \"wide\"", 3, &["image.width", "wide"]),
    ("width: 32", "width: 0", 3, &["image.width: found 0; expected 1..=65536"]),
    ("width: 32", "width: -3", 3, &["image.width: found -3; expected 1..=65536"]),
    ("width: 32", "width: 1.5", 3, &["image.width", "1.5"]),
    ("height: 18", "height: 65537", 3, &["found 65537; expected 1..=65536"]),
    ("height: 18", "height: NaN", 3, &["image.height", "NaN"]),
    ("height: 18", "height: 99999999999999999999999", 3, &["image.height"]),
    ("spp: 3", "spp: 0", 3, &["image.spp: found 0; expected 1..="]),
    ("spp: 3", "spp: 99999999", 3, &["image.spp: found 99999999"]),
    ("spp: 3", "spp: true", 3, &["image.spp", "true"]),
    ("count: 500", "count: -1", 4, &["lights.count: found -1; expected 0..="]),
    ("count: 500", "count: 2000000000", 4, &["lights.count", "expected 0..=1000000000"]),
    ("max_bounces: 3", "max_bounces: 0", 4, &["max_bounces", "found 0; expected 1..="]),
    ("kind: Vsl", "kind: Vsl(radius: NaN)", 4, &["radius", "found NaN"]),
    ("kind: Vsl", "kind: Vsl(radius: inf)", 4, &["radius", "found inf"]),
    ("kind: Vsl", "kind: Vsl(radius: -1)", 4, &["radius", "found -1"]),
    ("kind: Vsl", "kind: Vsl(radius: 1e999)", 4, &["radius", "found inf"]),
    ("kind: Vsl", "kind: Vpl(clamp: 0)", 4, &["clamp", "found 0"]),
    ("kind: Vsl", "kind: Vpl(clamp: NaN)", 4, &["clamp", "found NaN"]),
    ("kind: Vsl", "kind: Vpl(compensate: true)", 4, &["lights: found compensate: true", "expected clamp"]),
    ("kind: Vsl", "kind: Vpl(clamp: 1, compensate: 1)", 4, &["compensate"]),
    ("kind: Vsl", "kind: Vxl", 4, &["Vxl", "Vsl"]),
    ("Virtual(", "Real(", 4, &["Real", "Virtual"]),
    ("cut: 4", "cut: 0", 5, &["method.cut", "found 0; expected 1..=65536"]),
    ("cut: 4", "cut: 1000000", 5, &["found 1000000; expected 1..=65536"]),
    ("cut: 4", "weights: Best", 5, &["Best", "Yuksel2019"]),
    ("cut: 4", "dead_branches: Maybe", 5, &["Maybe", "Stop", "Retry"]),
    ("cut: 4", "share: 9", 5, &["method.share", "found 9; expected 1..=8"]),
    ("cut: 4", "stopping: RunningTotal(error: 2.0)", 5, &["method.stopping.error", "found 2; expected 0..=1"]),
    ("cut: 4", "stopping: RunningTotal(), dead_branches: Retry", 5, &["RunningTotal", "Retry", "expected one of them"]),
    ("cut: 4", "stopping: RunningTotal(), share: 4", 5, &["RunningTotal", "share", "expected one of them"]),
    ("cut: 4", "stopping: RunningTotal(), roulette: 0.3", 5, &["RunningTotal", "roulette", "expected one of them"]),
    ("cut: 4", "roulette: 1.5", 5, &["method.roulette", "found 1.5; expected 0..=1"]),
    ("StochasticLightcuts", "Lightcut", 5, &["Lightcut", "StochasticLightcuts"]),
    ("StochasticLightcuts(cut: 4)", "7", 5, &["method", "7"]),
    ("seed: 1", "seed: -1", 6, &["seed", "-1"]),
    ("seed: 1", "seed: 18446744073709551616", 6, &["seed"]),
    ("seed: 1", "integrator: Sideways", 6, &["Sideways", "Direct"]),
    ("seed: 1", "integrator: Path(max_bounces: -1)", 6, &["max_bounces: found -1; expected 0..=1024"]),
    ("seed: 1", "integrator: Path", 6, &["integrator: found Path with lights: Virtual", "expected integrator: Direct, or lights: AsGiven"]),
    ("seed: 1,", "seed: 1, seed: 2,", 6, &["seed"]),
    ("seed: 1,", "scene: \"b.ron\",", 6, &["scene"]),
    ("scene: \"scene/scene.ron\",", "", 1, &["scene"]),
    ("scene: \"scene/scene.ron\"", "scene: 3", 2, &["scene", "3"]),
    ("scene/scene.ron", "scene/nowhere.ron", 2, &["nowhere.ron", "expected"]),
    ("scene/scene.ron", "scene", 2, &["scene", "folder", "expected"]),
    ("scene/scene.ron", "$MANYLIGHT_SCENES/sponza/scene.ron", 2, &["MANYLIGHT_SCENES is not set", "set it to the folder"]),
    ("scene/scene.ron", "$MANY LIGHT/a.ron", 2, &["no environment variable"]),
    (", height: 18", " height: 18", 3, &["comma"]),
    ("seed: 1,\n)", "seed: 1,", 1, &["room.ron"]),
    ("seed: 1,\n)", "seed: 1,\n) and more", 7, &["room.ron"]),
    ("\"scene/scene.ron\"", "\"scene/scene.ron", 2, &["string"]),
    ("seed: 1,", "/* seed: 1,", 6, &["comment"]),
    ("image: (width: 32, height: 18, spp: 3)", "image: 32", 3, &["image"]),
    ("image: (width: 32, height: 18, spp: 3)", "image: [32, 18]", 3, &["image"]),
];

#[test]
fn bad_run_files_are_refused_at_their_place() {
    let folder = Folder::with_room();
    let good = String::from_utf8(folder.read("room.ron")).expect("text");
    let before = folder.files();
    for (from, to, line, parts) in RUN_FILES {
        assert_eq!(good.matches(from).count(), 1, "{from} is there once");
        folder.write("room.ron", good.replace(from, to));
        for command in ["render", "check"] {
            let ran = folder.run(&format!("{command} room.ron"));
            let ran = Ran {
                line: format!("{command} with {to}"),
                ..ran
            };
            assert_refused(&folder, &before, &ran, parts);
            let place = format!("error: room.ron:{line}:");
            assert!(ran.stderr.contains(&place), "{place} in: {}", ran.stderr);
        }
    }
}

#[test]
fn files_that_are_no_run_files_are_refused() {
    let folder = Folder::with_room();
    let nested = format!("(scene: {}", "(".repeat(100_000));
    let bytes: &[(&str, &[u8])] = &[
        ("empty", b""),
        ("blank", b" \n\t\n"),
        ("comment", b"// nothing here\n"),
        ("byte order mark", b"\xEF\xBB\xBF"),
        ("binary", b"\x7FELF\x02\x01\x01\0\0\0\xFF\xFE\x80"),
        ("zeros", &[0; 64]),
        ("Latin-1", b"(scene: \"sp\xE4ti.ron\")"),
        ("prose", b"Dear renderer, a church please."),
        ("JSON", b"{\"scene\": \"scene/scene.ron\"}"),
        ("list", b"[1, 2, 3]"),
        ("nested", nested.as_bytes()),
    ];
    folder.write("bad.ron", "");
    let before = folder.files();
    for (what, bytes) in bytes {
        folder.write("bad.ron", bytes);
        let ran = folder.run("render bad.ron");
        let line = (*what).to_owned();
        assert_refused(&folder, &before, &Ran { line, ..ran }, &["bad.ron:1:"]);
    }
    for (line, parts) in [
        ("render nowhere.ron", ["nowhere.ron", "expected a RON file"]),
        ("render scene", ["error: scene: ", "expected a RON file"]),
        (
            "check nowhere/a.ron",
            ["nowhere/a.ron", "expected a RON file"],
        ),
        (
            "render room.ron/a.ron",
            ["room.ron/a.ron", "expected a RON file"],
        ),
    ] {
        assert_refused(&folder, &before, &folder.run(line), &parts);
    }
}

#[test]
fn bad_scene_files_are_refused_at_their_place() {
    let folder = Folder::with_room();
    let before = folder.files();
    for (from, to, parts) in [
        ("room.obj", "none.obj", ["scene.ron:2:", "none.obj"]),
        ("room.obj", "../../x.obj", ["scene.ron:2:", "leads out of"]),
        ("room.obj", "room.stl", ["scene.ron:2:", ".obj"]),
        (
            "room.obj",
            "builtin:attic/scene.obj",
            ["scene.ron:2:", "nave"],
        ),
        (
            "fov_y_deg: 60",
            "fov_y_deg: 180",
            ["scene.ron:3:", "found 180"],
        ),
        ("fov_y_deg: 60", "fov: 60", ["scene.ron:3:", "fov_y_deg"]),
        (
            "origin: (0, 1, 1.8)",
            "origin: (0, NaN, 0)",
            ["scene.ron:3:", "NaN"],
        ),
        (
            "origin: (0, 1, 1.8)",
            "origin: (0, 0.9, 0)",
            ["scene.ron:3:", "different points"],
        ),
        (
            "up: (0, 1, 0)",
            "up: (0, 0, 0)",
            ["scene.ron:3:", "not zero"],
        ),
        (
            "intensity: (3, ",
            "intensity: (-3, ",
            ["scene.ron:5:", "negative"],
        ),
        ("position: (0.3", "position: (inf", ["scene.ron:5:", "inf"]),
        (
            "Point(position: (0.3",
            "Lamp(position: (0.3",
            ["scene.ron:5:", "Lamp"],
        ),
        (
            "lights: [",
            "lights: [ Points(\"none.ron\"),",
            ["scene.ron:4:", "none.ron"],
        ),
    ] {
        let text = support::ROOM_SCENE;
        assert_eq!(text.matches(from).count(), 1, "{from} is there once");
        folder.write("scene/scene.ron", text.replace(from, to));
        for command in ["render", "check"] {
            let ran = folder.run(&format!("{command} room.ron"));
            let line = format!("{command} with {to}");
            assert_refused(&folder, &before, &Ran { line, ..ran }, &parts);
        }
    }
    folder.write("scene/scene.ron", support::ROOM_SCENE);
    for (text, parts) in [
        ("v 0 0 zero\n", ["room.obj:1", "zero"]),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", ["room.obj:4", "4"]),
        ("v 0 0 nan\n", ["room.obj:1", "nan"]),
    ] {
        folder.write("scene/room.obj", text);
        let ran = folder.run("render room.ron");
        assert_refused(&folder, &before, &ran, &parts);
    }
}

/// Command lines, words divided by `|`, and what the error says.
#[rustfmt::skip]
const COMMAND_LINES: &[(&str, &[&str])] = &[
    ("paint", &["paint"]),
    ("render", &["<CONFIG>"]),
    ("render|room.ron|extra", &["extra"]),
    ("render|room.ron|--colour", &["--colour"]),
    ("render|room.ron|--size|32", &["--size", "found 32; expected", "480x270"]),
    ("render|room.ron|--size|32x", &["--size", "height: found ; expected"]),
    ("render|room.ron|--size|axb", &["--size", "width: found a; expected"]),
    ("render|room.ron|--size|0x18", &["--size", "width: found 0; expected a whole number, 1..=65536"]),
    ("render|room.ron|--size|32x70000", &["--size", "height: found 70000; expected a whole number, 1..=65536"]),
    ("render|room.ron|--size=-5x5", &["--size", "found -5; expected"]),
    ("render|room.ron|--size|99999999999x1", &["--size", "expected"]),
    ("render|room.ron|--spp|0", &["--spp", "found 0; expected a whole number, 1..="]),
    ("render|room.ron|--spp|many", &["--spp", "found many; expected a whole number"]),
    ("render|room.ron|--spp|-1", &["--spp", "found -1; expected a whole number, 1..="]),
    ("render|room.ron|--spp|4000000000", &["--spp", "found 4000000000; expected a whole number, 1..="]),
    ("render|room.ron|--spp|99999999999", &["--spp", "99999999999"]),
    ("render|room.ron|--seed|x", &["--seed", "found x; expected a whole number"]),
    ("render|room.ron|--seed|-1", &["--seed", "found -1; expected a whole number, 0..="]),
    ("render|room.ron|--seed|18446744073709551616", &["--seed"]),
    ("render|room.ron|--threads|0", &["--threads", "found 0; expected a whole number, 1..="]),
    ("render|room.ron|--threads|65535", &["--threads", "found 65535; expected"]),
    ("render|room.ron|--threads|two", &["--threads", "found two; expected"]),
    ("render|room.ron|--max-memory|much", &["--max-memory", "found much; expected a number of bytes, such as 500MB"]),
    ("render|room.ron|--max-memory|0", &["--max-memory", "found 0; expected"]),
    ("render|room.ron|--max-memory=-1GB", &["--max-memory", "found -1GB; expected"]),
    ("render|room.ron|--shard|0/3", &["--shard", "found 0/3; expected", "1 <= I <= N"]),
    ("render|room.ron|--shard|4/3", &["--shard", "found 4/3; expected"]),
    ("render|room.ron|--shard|1/0", &["--shard", "found 1/0; expected"]),
    ("render|room.ron|--shard|half", &["--shard", "found half; expected"]),
    ("render|room.ron|--max-seconds|nan", &["--max-seconds", "found nan; expected"]),
    ("render|room.ron|--max-seconds|inf", &["--max-seconds", "found inf; expected"]),
    ("render|room.ron|--max-seconds=-1", &["--max-seconds", "found -1; expected"]),
    ("render|room.ron|--max-seconds|soon", &["--max-seconds", "found soon; expected"]),
    ("render|room.ron|--method|lightcutz", &["--method", "lightcutz", "all-lights", "best"]),
    ("render|room.ron|--method|", &["--method", "all-lights"]),
    ("render|room.ron|--set|cut", &["--set", "cut", "PATH=VALUE"]),
    ("render|room.ron|--set|=3", &["--set", "=3"]),
    ("render|room.ron|--set|image..width=3", &["--set", "image..width"]),
    ("render|room.ron|--set|nosuch=3", &["--set nosuch=3", "nosuch"]),
    ("render|room.ron|--set|method.nosuch=3", &["--set method.nosuch=3", "cut"]),
    ("render|room.ron|--set|image.depth=3", &["--set image.depth=3", "width"]),
    ("render|room.ron|--set|lights.count=many", &["--set lights.count=many", "many"]),
    ("render|room.ron|--set|lights.count=-1", &["--set lights.count=-1"]),
    ("render|room.ron|--set|lights.count=", &["--set lights.count="]),
    ("render|room.ron|--set|image=(width: 1", &["--set image=(width: 1"]),
    ("render|room.ron|--set|method=Nosuch", &["--set method=Nosuch", "StochasticLightcuts"]),
    ("render|room.ron|--set|scene=\"none.ron\"", &["--set scene", "none.ron"]),
    ("render|room.ron|--set|seed.x=1", &["--set seed.x=1"]),
    ("render|room.ron|--name|", &["--name", "expected a file name"]),
    ("render|room.ron|--name|a/b", &["--name", "found \"a/b\"; expected a file name"]),
    ("render|room.ron|--name|..", &["--name", "expected a file name"]),
    ("render|room.ron|--out|room.ron", &["--out room.ron", "is a file; expected a folder"]),
    ("render|room.ron|--out|room.ron/out", &["--out room.ron/out", "expected a folder"]),
    ("render|room.ron|--reference|none.exr", &["none.exr"]),
    ("render|room.ron|--reference|room.ron", &["room.ron: "]),
    ("render|room.ron|--reference|scene", &["scene: "]),
    ("render|room.ron|--reference|small.exr", &["small.exr", "16x9", "expected the render's 32x18"]),
    ("check", &["<CONFIG>"]),
    ("check|room.ron|--out|x", &["--out"]),
    ("check|room.ron|--method|none", &["--method", "none"]),
    ("compare|small.exr", &["<REFERENCE>"]),
    ("compare|none.exr|small.exr", &["none.exr"]),
    ("compare|small.exr|none.exr", &["none.exr"]),
    ("compare|room.ron|small.exr", &["room.ron: "]),
    ("compare|small.exr|scene", &["scene: "]),
    ("compare|small.exr|small.exr|--max-relmse|nan", &["--max-relmse", "found nan; expected a number, 0 or more"]),
    ("compare|small.exr|small.exr|--max-relmse=-1", &["--max-relmse", "-1"]),
    ("compare|small.exr|small.exr|--max-relmse|low", &["--max-relmse", "low"]),
    ("merge|--out|x.exr", &["<SHARDS>"]),
    ("merge|small.exr", &["--out"]),
    ("merge|none.exr|--out|x.exr", &["none.exr"]),
    ("merge|room.ron|--out|x.exr", &["room.ron: "]),
    ("merge|small.exr|small.exr|--out|x.exr", &["small.exr", "both have samples"]),
    ("merge|small.exr|--out|room.ron/x.exr", &["room.ron/x.exr", "expected a folder"]),
    ("merge|small.exr|--out|scene", &["scene", "folder"]),
    ("scene", &["<NAME>"]),
    ("scene|attic|--out|x", &["attic", "nave"]),
    ("scene|nave", &["--out"]),
    ("scene|nave|--out|room.ron", &["--out room.ron", "expected a folder"]),
];

#[test]
fn bad_command_lines_are_refused() {
    let folder = Folder::with_room();
    let small = "render room.ron --size 16x9 --spp 1 --set lights=AsGiven --out . --name small";
    folder.run(small).fine();
    let before = folder.files();
    for (line, parts) in COMMAND_LINES {
        let words: Vec<_> = line.split('|').collect();
        assert_refused(&folder, &before, &folder.run_words(&words), parts);
    }
}

#[test]
fn no_command_at_all_shows_the_help() {
    let ran = Folder::new().run("").exits(2);
    ran.says(&["Usage:", "render"]);
}

#[cfg(target_os = "linux")]
#[test]
fn what_does_not_fit_into_memory_is_refused_with_an_estimate() {
    let folder = Folder::with_room();
    let before = folder.files();
    for (flags, size) in [
        ("--size 65536x65536", "1.4 TB"),
        ("--set image.width=65000 --set image.height=65000", "1.3 TB"),
        ("--set lights.count=1000000000", "320.0 GB"),
    ] {
        let ran = folder.run(&format!("render room.ron {flags}"));
        let parts = [
            "room.ron: ",
            size,
            "expected at most",
            "free",
            "lower image.width",
        ];
        assert_refused(&folder, &before, &ran, &parts);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn what_is_over_the_given_memory_is_refused_with_an_estimate() {
    let folder = Folder::with_room();
    let before = folder.files();
    for command in ["render", "check"] {
        let ran = folder.run(&format!(
            "{command} room.ron --max-memory 60MB --set lights.count=1000000"
        ));
        let said = &ran.stderr;
        assert_eq!(ran.code, 2, "{said}");
        for part in [
            "room.ron: ",
            "320.2 MB",
            "left of the 60.0 MB of --max-memory",
            "in use",
        ] {
            assert!(said.contains(part), "no {part:?} in: {said}");
        }
        assert_eq!(folder.files(), before, "a file was left");
    }
    folder.run("check room.ron --max-memory 2GB").fine();
}

/// 2048 × 2048 texels: 17 MB that stay, and twice that while they are decoded.
#[cfg(target_os = "linux")]
#[test]
fn textures_over_the_given_memory_are_refused_before_they_are_decoded() {
    let folder = Folder::with_room();
    folder.write("scene/room.obj", "mtllib room.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl grey\nf 1/1 2/2 3/3\n");
    folder.write(
        "scene/room.mtl",
        "newmtl grey\nKd 1 1 1\nmap_Kd large.png\n",
    );
    let large = folder.path("scene/large.png");
    film::write_rgb8(&large, 2048, 2048, &vec![128; 3 << 22]).unwrap_or_else(|e| panic!("{e}"));
    let sky = "(geometry: [\"room.obj\"], camera: (origin: (0, 0, 3), target: (0, 0, 0), up: (0, 1, 0), fov_y_deg: 60),
        lights: [Environment(image: \"large.png\")])";
    folder.write("scene/sky.ron", sky);
    for (scene, parts) in [
        (
            "scene",
            [
                "scene.ron: its textures (1 in all) need about 50.3 MB",
                "50.0 MB of --max-memory",
            ],
        ),
        (
            "sky",
            ["large.png needs about 167.8 MB", "50.0 MB of --max-memory"],
        ),
    ] {
        let small = "--size 8x6 --spp 1 --set lights=AsGiven";
        let job = format!("room.ron --set scene=\"scene/{scene}.ron\" {small}");
        let before = folder.files();
        for command in ["render", "check"] {
            let ran = folder.run(&format!("{command} {job} --max-memory 50MB"));
            assert_refused(&folder, &before, &ran, &parts);
        }
        folder.run(&format!("check {job} --max-memory 2GB")).fine();
    }
}
