//! Every command of the program, run as a user runs it.

mod support;

use film::Picture;
use serde_json::Value;
use support::Folder;

/// Renders the room with `flags` into `out/room.*`.
fn room(flags: &str) -> Folder {
    let folder = Folder::with_room();
    folder.run(&format!("render room.ron {flags}")).fine();
    folder
}

fn brightness(picture: &Picture) -> f32 {
    picture.radiance.iter().map(|c| c.element_sum()).sum()
}

#[track_caller]
fn whole_number(report: &Value, path: &str) -> u64 {
    let value = report.pointer(path);
    let number = value.and_then(Value::as_u64);
    number.unwrap_or_else(|| panic!("{path} is {value:?}; expected a whole number"))
}

#[test]
fn render_writes_its_three_files_and_says_nothing_on_stdout() {
    let folder = Folder::with_room();
    let ran = folder.run("render room.ron").fine();
    assert_eq!(ran.stdout, "", "stdout is for results");
    assert!(!ran.stderr.is_empty(), "progress goes to stderr");
    let mut names: Vec<_> = std::fs::read_dir(folder.path("out"))
        .expect("the default folder")
        .map(|entry| entry.expect("an entry").file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["room.exr", "room.json", "room.png"], "files");
    assert!(folder.read("out/room.png").starts_with(b"\x89PNG"), "PNG");
    let picture = folder.picture("out/room.exr");
    assert_eq!((picture.width, picture.height), (32, 18), "size");
    assert!(brightness(&picture) > 1.0, "there is light in the room");
    assert!(picture.samples.iter().all(|&n| n == 3), "samples");
}

#[test]
fn lines_between_passes_say_how_much_time_is_left() {
    let folder = Folder::with_room();
    let ran = folder.run("render room.ron --spp 4").fine();
    let passes = ran.stderr.lines().filter(|l| l.contains("samples a pixel"));
    let told: Vec<_> = passes.map(|l| l.ends_with("s left")).collect();
    assert_eq!(told, [true, true, false], "1, 2 and 4 of 4: {}", ran.stderr);
}

#[test]
fn out_and_name_say_where_files_go_and_quiet_says_nothing() {
    let folder = Folder::with_room();
    let ran = folder.run("render room.ron --out a/b --name other --quiet --threads 1");
    let ran = ran.fine();
    assert_eq!((&*ran.stdout, &*ran.stderr), ("", ""), "quiet");
    for end in ["exr", "png", "json"] {
        assert!(folder.exists(&format!("a/b/other.{end}")), "{end}");
    }
    assert!(!folder.exists("out"), "the default folder is not made");
    assert_eq!(folder.json("a/b/other.json")["threads"], 1, "threads");
}

#[test]
fn the_report_has_every_field_with_a_sound_value() {
    let folder = room("--spp 2 --seed 7");
    let report = folder.json("out/room.json");
    for key in ["load", "bvh", "lights", "tree", "render", "write"] {
        let seconds = report["seconds"][key].as_f64();
        assert!(
            seconds.is_some_and(|s| (0.0..600.0).contains(&s)),
            "{key}: {seconds:?}"
        );
    }
    assert_eq!(whole_number(&report, "/rays/camera"), 32 * 18 * 2, "camera");
    assert!(whole_number(&report, "/rays/bounce") > 0, "bounce");
    assert!(whole_number(&report, "/rays/shadow") > 0, "shadow");
    assert!(whole_number(&report, "/light_samples") > 0, "light samples");
    let points = whole_number(&report, "/shading_points");
    assert_eq!(points, 32 * 18 * 2, "the room is closed");
    assert!(whole_number(&report, "/threads") >= 1, "threads");
    for (key, value) in [("spp", 2), ("width", 32), ("height", 18), ("seed", 7)] {
        assert_eq!(report[key], value, "{key}");
    }
    assert_eq!(report["method"], "stochastic-lightcuts", "method");
    assert_eq!(report["lights"]["point"], 2, "point lights");
    assert_eq!(report["lights"]["directional"], 0, "directional lights");
    assert!(
        (300..=2000).contains(&whole_number(&report, "/lights/virtual")),
        "about 500 virtual lights: {}",
        report["lights"]
    );
    assert_eq!(report["triangles"], 22, "triangles");
    assert_eq!(report["nonfinite"], 0, "nonfinite");
    for key in ["needs", "skipped"] {
        let list = report[key].as_array();
        let names = |l: &Vec<Value>| l.iter().all(|name| name.as_str().is_some());
        assert!(list.is_some_and(names), "{key} is {list:?}");
    }
    for key in ["version", "commit"] {
        let text = report[key].as_str();
        assert!(text.is_some_and(|t| !t.is_empty()), "{key} is {text:?}");
    }
    if cfg!(target_os = "linux") {
        assert!(whole_number(&report, "/peak_rss_bytes") > 1 << 20, "memory");
    }
    assert!(report.get("error").is_none(), "no reference, no error");
}

#[test]
fn threads_do_not_change_the_file_and_the_seed_does() {
    let folder = room("--name one --threads 1");
    folder.run("render room.ron --name two --threads 2").fine();
    folder.run("render room.ron --name other --seed 2").fine();
    let one = folder.read("out/one.exr");
    assert!(one == folder.read("out/two.exr"), "1 and 2 threads differ");
    assert!(
        folder.read("out/one.png") == folder.read("out/two.png"),
        "PNGs of 1 and 2 threads differ"
    );
    let radiance = |name| folder.picture(name).radiance;
    assert!(
        radiance("out/one.exr") != radiance("out/other.exr"),
        "another seed gives the same picture"
    );
}

#[test]
fn shards_put_together_are_the_whole_to_the_byte() {
    let folder = room("--size 70x50 --spp 2");
    for part in 1..=3 {
        let line = format!("render room.ron --size 70x50 --spp 2 --shard {part}/3 --name p{part}");
        folder.run(&line).fine();
    }
    // In any order.
    let merge = "merge out/p2.exr out/p3.exr out/p1.exr --out merged/all.exr";
    let ran = folder.run(merge).fine();
    assert_eq!(ran.stdout, "", "merge has nothing to say");
    assert!(
        folder.read("merged/all.exr") == folder.read("out/room.exr"),
        "merged shards differ from the whole"
    );
    assert!(
        folder.read("merged/all.png") == folder.read("out/room.png"),
        "their PNGs differ"
    );

    let missing = folder.run("merge out/p1.exr out/p2.exr --out none.exr");
    missing
        .exits(2)
        .says(&["shard 3/3 is missing", "--shard 3/3"]);
    let missing = folder.run("merge out/p2.exr --out none.exr");
    missing.exits(2).says(&["shards 1/3, 3/3 are missing"]);
    let twice = folder.run("merge out/p1.exr out/p2.exr out/p1.exr --out none.exr");
    twice.exits(2).says(&["both have samples"]);
    assert!(!folder.exists("none.exr"), "a failed merge writes nothing");
}

#[test]
fn shards_of_different_renders_are_refused() {
    let folder = room("--shard 1/2 --name a");
    for (flags, what) in [
        ("--seed 9", "seed is \"9\"; expected \"1\""),
        ("--spp 1", "spp is \"1\"; expected \"3\""),
        ("--set method.cut=5", "method is"),
        ("--set lights.count=400", "lights is"),
    ] {
        let line = format!("render room.ron --shard 2/2 --name b {flags}");
        folder.run(&line).fine();
        let ran = folder.run("merge out/a.exr out/b.exr --out none.exr");
        ran.exits(2).says(&["b.exr", "another render", what]);
    }
    // A shard that time stopped has fewer samples than the others.
    let line = "render room.ron --shard 2/2 --name b --max-seconds 0";
    folder.run(line).fine();
    let ran = folder.run("merge out/a.exr out/b.exr --out none.exr");
    ran.exits(2)
        .says(&["b.exr", "spp is \"1\"; expected \"3\""]);
    assert!(!folder.exists("none.exr"), "a refused merge writes nothing");
}

#[test]
fn compare_prints_figures_and_knows_its_limit() {
    let folder = room("--name a");
    folder.run("render room.ron --name b --seed 2").fine();
    folder.run("render room.ron --name c --size 16x9").fine();
    let names = [
        "mse",
        "rmse",
        "relmse",
        "mape",
        "psnr",
        "flip",
        "mean_ratio",
    ];

    let text = folder.run("compare out/a.exr out/b.exr").fine().stdout;
    let found: Vec<_> = text.lines().filter_map(|l| l.split(' ').next()).collect();
    assert_eq!(found, names, "lines");

    let json = folder.run("compare --json out/a.exr out/b.exr").fine();
    let figures: Value = serde_json::from_str(&json.stdout).expect("one JSON object");
    for name in names {
        assert!(figures[name].is_number(), "{name} is {}", figures[name]);
    }
    let relmse = figures["relmse"].as_f64().expect("a number");
    assert!(relmse > 0.0, "two seeds differ");
    let ratio = figures["mean_ratio"].as_f64().expect("a number");
    assert!((0.7..1.4).contains(&ratio), "same room: {ratio}");

    let same = folder.run("compare --json out/a.exr out/a.exr --max-relmse 0");
    let figures: Value = serde_json::from_str(&same.fine().stdout).expect("JSON");
    for name in ["mse", "rmse", "relmse", "mape", "flip"] {
        assert_eq!(figures[name], 0.0, "{name} of a picture with itself");
    }
    assert_eq!(figures["mean_ratio"], 1.0, "mean_ratio");

    folder
        .run(&format!(
            "compare out/a.exr out/b.exr --max-relmse {}",
            relmse * 1.01
        ))
        .fine();
    let worse = folder.run(&format!(
        "compare out/a.exr out/b.exr --max-relmse {}",
        relmse * 0.99
    ));
    worse.exits(1).says(&["out/a.exr", "relmse", "at most"]);
    let sizes = folder.run("compare out/a.exr out/c.exr --max-relmse 1e9");
    sizes.exits(2).says(&["32x18", "16x9"]);
}

#[test]
fn a_reference_adds_the_error_of_every_pass() {
    let folder = room("--name reference --method all-lights --spp 8");
    folder
        .run("render room.ron --spp 4 --reference out/reference.exr")
        .fine();
    let report = folder.json("out/room.json");
    let error = &report["error"];
    let passes = error["passes"].as_array().expect("a list of passes");
    let samples: Vec<_> = passes.iter().map(|p| whole_number(p, "/spp")).collect();
    assert_eq!(samples, [1, 2, 4], "passes");
    let times: Vec<_> = passes
        .iter()
        .map(|p| p["seconds"].as_f64().expect("seconds"))
        .collect();
    assert!(times.is_sorted(), "time goes on: {times:?}");
    let relmse = |v: &Value| v["relmse"].as_f64().expect("relmse");
    assert_eq!(relmse(&passes[2]), relmse(error), "last pass and picture");
    assert!(relmse(&passes[2]) < relmse(&passes[0]), "it converges");
    for name in ["mse", "rmse", "mape", "psnr", "flip", "mean_ratio"] {
        assert!(error[name].is_number(), "{name} is {}", error[name]);
    }
}

#[test]
fn max_seconds_stops_after_the_pass_that_it_falls_in() {
    let folder = room("--spp 64 --max-seconds 0");
    assert_eq!(folder.json("out/room.json")["spp"], 1, "samples done");
    let picture = folder.picture("out/room.exr");
    assert!(picture.samples.iter().all(|&n| n == 1), "one pass");
    folder.run("render room.ron --spp 1 --name one").fine();
    assert!(
        picture == folder.picture("out/one.exr"),
        "a stopped render is the shorter render"
    );
}

#[test]
fn methods_are_chosen_by_name() {
    let folder = room("--method all-lights --spp 1 --name all");
    folder
        .run("render room.ron --method best --spp 1 --name best")
        .fine();
    assert_eq!(folder.json("out/all.json")["method"], "all-lights", "name");
    assert!(folder.json("out/best.json")["method"].is_string(), "best");
    let (all, best) = (
        folder.picture("out/all.exr"),
        folder.picture("out/best.exr"),
    );
    let ratio = brightness(&best) / brightness(&all);
    assert!((0.7..1.4).contains(&ratio), "brightness ratio {ratio}");
}

#[test]
fn a_gltf_file_needs_no_run_file() {
    let folder = Folder::with_room();
    let text = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64,AACAvwAAgL8AAAAAAACAPwAAgL8AAAAAAAAAAAAAgD8AAAAA"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 6830}]}},
        "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 3]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 0, 2]}]}"#;
    std::fs::write(folder.path("tri.gltf"), text).expect("a file");
    let flags = "--size 16x16 --spp 2 --set lights.count=100";
    folder.run(&format!("render tri.gltf {flags}")).fine();
    let picture = folder.picture("out/tri.exr");
    // 10 W/sr at distance 2 over a surface that reflects a half: 0.5 / π × 10 / 4.
    let middle = picture.radiance[8 * 16 + 8].x;
    assert!((middle - 0.398).abs() < 0.02, "{middle}");
    let report = folder.json("out/tri.json");
    assert_eq!(whole_number(&report, "/lights/point"), 1, "its light");
    assert!(
        whole_number(&report, "/bytes/mesh") >= 36,
        "memory of the mesh"
    );
    let check = folder.run("check tri.gltf").fine();
    assert!(check.stdout.contains("tri.gltf"), "{}", check.stdout);
}

#[test]
fn a_scene_file_needs_no_run_file_either() {
    let folder = Folder::with_room();
    let flags = "--size 16x16 --spp 2 --set lights.count=100";
    folder
        .run(&format!("render scene/scene.ron --name of_scene {flags}"))
        .fine();
    folder.write("run.ron", "(scene: \"scene/scene.ron\", lights: Virtual)");
    folder
        .run(&format!("render run.ron --name of_run {flags}"))
        .fine();
    let [of_scene, of_run] =
        ["out/of_scene.exr", "out/of_run.exr"].map(|name| folder.picture(name));
    assert_eq!(of_scene.radiance, of_run.radiance, "lit by virtual lights");
    folder.run("check scene/scene.ron").fine();
}

#[test]
fn set_changes_any_field() {
    let folder = Folder::with_room();
    let ran = folder.run_words(&[
        "render",
        "room.ron",
        "--set",
        "image.width=20",
        "--set",
        "image.height = 10",
        "--set",
        "image.spp=2",
        "--set",
        "method.cut=3",
        "--set",
        "lights.count=200",
        "--set",
        "lights.kind=Vpl(clamp: 10)",
        "--set",
        "integrator=Direct",
        "--set",
        "seed=5",
    ]);
    ran.fine();
    let report = folder.json("out/room.json");
    for (key, value) in [("width", 20), ("height", 10), ("spp", 2), ("seed", 5)] {
        assert_eq!(report[key], value, "{key}");
    }
    let settings = report["method_settings"].as_str().expect("text");
    assert!(settings.contains("cut: Count(3)"), "{settings}");
    let count = whole_number(&report, "/lights/virtual");
    assert!((100..=800).contains(&count), "{count} virtual lights");
    assert_eq!(report["virtual_lights"]["radius"], 0.0, "points");
    // Fields of what the file leaves out; the whole struct is made.
    folder.write("bare.ron", "(scene: \"scene/scene.ron\")");
    folder
        .run("render bare.ron --set image.width=8 --set image.height=4 --set image.spp=1")
        .fine();
    assert_eq!(folder.json("out/bare.json")["width"], 8, "width");
    // A flag overrides --set as it overrides the file.
    folder
        .run("render room.ron --set image.spp=2 --spp 1")
        .fine();
    assert_eq!(folder.json("out/room.json")["spp"], 1, "--spp");
}

#[test]
fn compensation_follows_paths_for_what_a_clamp_takes_off() {
    let folder = Folder::with_room();
    for (name, kind) in [
        ("clamped", "Vpl(clamp: 0.02)"),
        ("whole", "Vpl(clamp: 0.02, compensate: true)"),
    ] {
        let kind = format!("lights.kind={kind}");
        folder
            .run_words(&["render", "room.ron", "--name", name, "--set", &kind])
            .fine();
    }
    let [clamped, whole] =
        ["clamped", "whole"].map(|name| folder.json(&format!("out/{name}.json")));
    let bounces = |report: &serde_json::Value| {
        let needs = report["needs"].as_array().expect("a list");
        needs.iter().any(|need| need == "eye paths that bounce")
    };
    assert!(bounces(&whole) && !bounces(&clamped), "what is needed");
    for key in ["/rays/bounce", "/shading_points"] {
        let [a, b] = [&clamped, &whole].map(|report| whole_number(report, key));
        assert!(b > a, "{key}: {a} clamped, {b} compensated");
    }
    let compared = folder.run("compare out/clamped.exr out/whole.exr --json");
    let compared: serde_json::Value = serde_json::from_str(&compared.fine().stdout).expect("JSON");
    let ratio = compared["mean_ratio"].as_f64().expect("a number");
    assert!(ratio < 1.0, "{ratio} of the light without compensation");
}

#[test]
fn paths_and_lights_of_every_kind_are_reported() {
    let folder = Folder::with_room();
    let mtl = String::from_utf8(folder.read("scene/room.mtl")).expect("text");
    folder.write("scene/room.mtl", format!("{mtl}Ke 2 2 1\n"));
    let scene = String::from_utf8(folder.read("scene/scene.ron")).expect("text");
    let more = "lights: [Emissive, Environment(radiance: (0.1, 0.2, 0.3)),
        Spot(position: (0, 1.9, 0), direction: (0, -1, 0), intensity: (1, 1, 1), cos_inner: 0.9, cos_outer: 0.8),
        Directional(direction: (1, -1, 0), irradiance: (1, 1, 1)),
        Directional(direction: (1, -1, 0), irradiance: (0, 0, 0)),";
    folder.write("scene/scene.ron", scene.replace("lights: [", more));
    let settings = [
        "--set",
        "lights=AsGiven",
        "--set",
        "integrator=Path(max_bounces: 2)",
    ];
    let run = |command: &str| {
        let words = [&[command, "room.ron"], &settings[..]].concat();
        folder.run_words(&words).fine()
    };
    let said = run("check").stdout;
    // The block's five sides, without the one it stands on.
    for part in [
        "2 point, 1 spot, 10 triangle, 1 directional, 256 of the environment",
        "1 lights without power dropped",
        "emissive triangles, environment",
        "eye paths that bounce",
    ] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
    run("render");
    let report = folder.json("out/room.json");
    for (kind, count) in [
        ("spot", 1),
        ("triangle", 10),
        ("directional", 1),
        ("environment", 256),
    ] {
        assert_eq!(report["lights"][kind], count, "{kind}");
    }
    assert_eq!(report["nonfinite"], 0, "all samples are sound");
    let rays = |kind: &str| report["rays"][kind].as_u64().expect("a number");
    let (camera, bounce) = (rays("camera"), rays("bounce"));
    assert!(
        bounce > camera && bounce <= 3 * camera,
        "{bounce} rays behind {camera}"
    );
    assert!(report["shading_points"].as_u64() > Some(camera), "vertices");
}

#[test]
fn check_says_what_a_render_would_need_and_renders_nothing() {
    let folder = Folder::with_room();
    let before = folder.files();
    let ran = folder.run("check room.ron").fine();
    for part in [
        "scene.ron",
        "triangles  22",
        "lights     2",
        "500 virtual",
        "32x18",
        "needs ",
        "skips ",
        "memory ",
    ] {
        assert!(ran.stdout.contains(part), "no {part:?} in {}", ran.stdout);
    }
    assert_eq!(folder.files(), before, "check writes nothing");
    let ran = folder.run("check room.ron --set lights=AsGiven --size 60000x60000");
    let ran = ran.exits(2).says(&["60000x60000", "room.ron"]);
    assert!(ran.stdout.contains("memory "), "the estimate comes first");
}

#[test]
fn scene_lists_and_writes_the_built_in_scenes() {
    let folder = Folder::new();
    let listed = folder.run("scene --list").fine().stdout;
    assert!(listed.lines().any(|name| name == "nave"), "{listed}");
    let ran = folder.run("scene nave --out files").fine();
    assert_eq!(ran.stdout, "", "files are the result");
    assert!(folder.exists("files/scene.ron"), "scene.ron");

    // The nave as the repository has it, and as it was just written.
    let repository = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/nave.ron");
    let flags = "--size 32x18 --spp 1 --seed 3 --set lights.count=2000 --quiet";
    let line = format!("render {repository} {flags}");
    folder.run(&line).fine();
    let text = std::fs::read_to_string(repository).expect("the repository's run file");
    let text = text.replace("../scenes/nave/scene.ron", "files/scene.ron");
    assert!(text.contains("files/scene.ron"), "{text}");
    folder.write("written.ron", text);
    folder.run(&format!("render written.ron {flags}")).fine();
    let picture = folder.picture("out/nave.exr");
    assert!(
        picture == folder.picture("out/written.exr"),
        "the written scene gives another picture"
    );
    assert!(brightness(&picture) > 0.0, "the nave is lit");
    assert_eq!(folder.json("out/nave.json")["nonfinite"], 0, "nonfinite");
}

#[test]
fn a_scene_without_lights_is_black() {
    let folder = Folder::with_room();
    let text = support::ROOM_SCENE;
    let start = text.find("lights:").expect("there are lights");
    folder.write(
        "scene/scene.ron",
        format!("{}lights: [],\n)\n", &text[..start]),
    );
    for flags in ["", "--set lights=AsGiven", "--method all-lights"] {
        folder.run(&format!("render room.ron {flags}")).fine();
        let picture = folder.picture("out/room.exr");
        assert_eq!(brightness(&picture), 0.0, "{flags}");
        assert_eq!(folder.json("out/room.json")["nonfinite"], 0, "{flags}");
    }
    let ran = folder.run("check room.ron").fine();
    assert!(ran.stdout.contains("black"), "{}", ran.stdout);
}

#[test]
fn a_camera_inside_a_wall_or_outside_the_room_renders() {
    let folder = Folder::with_room();
    for origin in [
        "(-0.4, 0.5, -0.5)",
        "(0, 0, 1)",
        "(2, 1, 2)",
        "(0, 1, 1000)",
        "(0.1, 5, 0)",
    ] {
        let text = support::ROOM_SCENE.replace("origin: (0, 1, 1.8)", &format!("origin: {origin}"));
        assert!(text.contains(origin), "replaced");
        folder.write("scene/scene.ron", text);
        folder.run("render room.ron --spp 1").fine();
        let report = folder.json("out/room.json");
        assert_eq!(report["nonfinite"], 0, "camera at {origin}");
        let picture = folder.picture("out/room.exr");
        assert!(
            picture.radiance.iter().all(|c| c.is_finite()),
            "camera at {origin}"
        );
    }
}

#[test]
fn more_shards_than_tiles_are_merged_as_well() {
    let folder = room("--name whole --size 20x10");
    for part in 1..=3 {
        let line = format!("render room.ron --size 20x10 --shard {part}/3 --name p{part}");
        folder.run(&line).fine();
    }
    folder
        .run("merge out/p1.exr out/p2.exr out/p3.exr --out out/all.exr")
        .fine();
    assert!(
        folder.read("out/all.exr") == folder.read("out/whole.exr"),
        "merged shards differ from the whole"
    );
}

#[test]
fn shards_may_come_from_different_folders() {
    let folder = room("--name p1 --shard 1/2");
    let elsewhere = folder.path("scene/scene.ron").display().to_string();
    let scene = format!("scene={elsewhere:?}");
    let words = [
        "render", "room.ron", "--name", "p2", "--shard", "2/2", "--set",
    ];
    folder.run_words(&[&words[..], &[&*scene]].concat()).fine();
    folder
        .run("merge out/p1.exr out/p2.exr --out out/all.exr")
        .fine();
    // The same place, but not the same scene.
    let text = support::ROOM_SCENE.replace("0.3, 1.8", "0.4, 1.8");
    folder.write("scene/scene.ron", text);
    folder.run("render room.ron --name p2 --shard 2/2").fine();
    let ran = folder.run("merge out/p1.exr out/p2.exr --out out/none.exr");
    ran.exits(2).says(&["p2.exr", "scene_content is"]);
}

#[test]
fn a_reader_that_has_seen_enough_is_no_error() {
    use std::process::Stdio;

    let folder = Folder::with_room();
    let mut command = folder.command("check room.ron");
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("ends");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), &*said), (Some(0), ""), "no panic");
}

#[test]
fn help_and_version_go_to_stdout() {
    let folder = Folder::new();
    let help = folder.run("--help").fine().stdout;
    for command in ["render", "check", "compare", "merge", "scene"] {
        assert!(help.contains(command), "{command} in {help}");
    }
    let version = folder.run("--version").fine().stdout;
    assert!(version.starts_with("manylight "), "{version}");
    let help = folder.run("render --help").fine().stdout;
    for part in ["all-lights", "--resume", "--max-seconds"] {
        assert!(help.contains(part), "{part} in {help}");
    }
}

#[test]
fn annotated_files_are_printed_and_can_be_used() {
    let folder = Folder::with_room();
    let scene = folder.run("config scene").fine().stdout;
    assert!(scene.contains("lumens_per_watt"), "{scene}");
    let run = folder.run("config run").fine().stdout;
    folder.write("whole.ron", run.replace("scene.ron\"", "scene/scene.ron\""));
    folder.run("check whole.ron --size 8x8").fine();
    let experiment = folder.run("config experiment").fine().stdout;
    assert!(experiment.contains("standard_error"), "{experiment}");
}

#[test]
fn completions_and_man_pages_know_every_command() {
    let commands = ["render", "check", "experiment", "compare", "merge", "scene"];
    let folder = Folder::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = folder.run(&format!("completions {shell}")).fine().stdout;
        for word in commands.iter().chain(&["max-seconds"]) {
            assert!(script.contains(word), "{word} in {shell}'s");
        }
        // The others do not complete values.
        let completes_values = ["bash", "zsh", "fish"].contains(&shell);
        assert_eq!(script.contains("all-lights"), completes_values, "{shell}");
    }
    let page = folder.run("man").fine().stdout;
    assert!(page.contains(".TH manylight 1"), "{page}");
    folder.run("man --out man").fine();
    for name in commands {
        let file = format!("man/manylight-{name}.1");
        let page = String::from_utf8(folder.read(&file)).expect("text");
        assert!(page.contains("manylight") && page.contains(".SH"), "{page}");
    }
    assert!(folder.exists("man/manylight.1"), "the program's own");
}

#[test]
fn misspelt_names_are_answered_with_the_nearest() {
    let folder = Folder::with_room();
    for (line, near) in [
        ("rendr room.ron", "'render'"),
        ("render room.ron --method lightcutz", "'lightcuts'"),
        ("render room.ron --max-second 3", "'--max-seconds'"),
        ("scene naive --out x", "'nave'"),
        ("render room.ron --set image.widht=3", "`width`"),
        ("render room.ron --set method=Lightcutz", "`Lightcuts`"),
    ] {
        folder.run(line).exits(2).says(&[near]);
    }
}

#[test]
fn errors_are_coloured_only_where_that_is_wanted() {
    let folder = Folder::new();
    // A failure of the program's own, and one that clap reports.
    for line in ["check none.ron", "chekc none.ron"] {
        for (variables, coloured) in [
            (&[][..], false),
            (&["CLICOLOR_FORCE"][..], true),
            (&["CLICOLOR_FORCE", "NO_COLOR"][..], false),
        ] {
            let mut command = folder.command(line);
            for name in ["CLICOLOR_FORCE", "NO_COLOR", "CLICOLOR"] {
                command.env_remove(name);
            }
            command.envs(variables.iter().map(|name| (name, "1")));
            let said = command.output().expect("the binary starts").stderr;
            let said = String::from_utf8(said).expect("UTF-8");
            assert_eq!(said.contains('\x1b'), coloured, "{variables:?}: {said:?}");
            assert!(said.contains("error:"), "{said:?}");
        }
    }
}

#[test]
fn a_picture_carries_the_run_file_that_gives_it_again() {
    let flags = "--size 40x20 --spp 2 --seed 9 --method uniform --set lights.count=300";
    let folder = room(flags);
    let (picture, metadata) =
        Picture::read_exr(&folder.path("out/room.exr")).unwrap_or_else(|e| panic!("{e}"));
    let config = metadata.texts.iter().find(|(name, _)| name == "config");
    let (_, config) = config.expect("a run file");
    folder.write("again.ron", config);
    folder.run("render again.ron").fine();
    assert!(
        folder.read("out/again.exr") == folder.read("out/room.exr"),
        "another picture by {config}"
    );

    // The middle of the picture is what the camera looks at, (0, 0.9, 0).
    let camera = metadata.camera.expect("matrices");
    let ndc = camera.world_to_ndc;
    let seen: Vec<f32> = (0..4).map(|c| 0.9 * ndc[4 + c] + ndc[12 + c]).collect();
    for (c, half) in [(0, "left"), (1, "upper")] {
        let place = seen[c] / seen[3];
        assert!((place - 0.5).abs() < 1e-5, "{half} half: {place}");
    }
    assert!(
        picture.indirect.iter().any(|c| c.max_element() > 0.0),
        "indirect light"
    );
    assert!(
        picture.direct.iter().any(|c| c.max_element() > 0.0),
        "direct light"
    );
}

#[test]
fn denoising_works_or_says_what_is_missing() {
    let folder = Folder::with_room();
    let ran = folder.run("render room.ron --denoise");
    if ran.code == 0 {
        let image = film::read_image(&folder.path("out/room.denoised.exr"));
        let image = image.unwrap_or_else(|e| panic!("{e}"));
        assert!(image.pixels.iter().all(|c| c.is_finite()), "finite");
        assert!(folder.exists("out/room.denoised.png"), "PNG");
        return;
    }
    let missing = match cfg!(feature = "denoise") {
        true => "expected version 2 of its library",
        false => "--features denoise",
    };
    ran.exits(2).says(&["--denoise", missing]);
    assert!(!folder.exists("out/room.exr"), "nothing is rendered");
    let both = folder.run("render room.ron --denoise --shard 1/2");
    both.exits(2).says(&["--denoise", "--shard"]);
}
