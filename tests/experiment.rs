//! Experiments: a matrix of small renders, what is left of it, and what happens when it ends early.

mod support;

#[cfg(unix)]
use std::time::{Duration, Instant};
use std::{collections::BTreeMap, path::PathBuf};

use support::Folder;

const EXPERIMENT: &str = "(
    title: \"Rooms\",
    image: (width: 32, height: 18),
    scenes: [(name: \"room\", scene: \"scene/scene.ron\", crops: [(0.1, 0.2, 0.3, 0.4)])],
    lights: [
        (name: \"lamps\", lights: AsGiven),
        (name: \"virtual\", lights: Virtual(count: 300, max_bounces: 3)),
    ],
    methods: [
        (name: \"uniform\", method: Uniform(samples: 4)),
        (name: \"stochastic\", method: StochasticLightcuts(cut: 4)),
    ],
    budgets: [Spp(2), LightSamples(20)],
    seeds: [1, 2],
    reference: (standard_error: 0.2, max_spp: 64),
)
";

fn with_experiment() -> Folder {
    let folder = Folder::with_room();
    folder.write("rooms.ron", EXPERIMENT);
    folder
}

/// The experiment with one thing changed.
fn change(folder: &Folder, from: &str, to: &str) {
    let changed = EXPERIMENT.replace(from, to);
    assert!(changed != EXPERIMENT, "{from}");
    folder.write("rooms.ron", changed);
}

/// The table's rows by column name.
fn rows(folder: &Folder, name: &str) -> Vec<BTreeMap<String, String>> {
    let text = String::from_utf8(folder.read(name)).expect("UTF-8");
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let fields = |line: &str| {
        let mut quoted = false;
        let split = line.split(|c| {
            quoted ^= c == '"';
            c == ',' && !quoted
        });
        split
            .map(|s| s.trim_matches('"').to_owned())
            .collect::<Vec<_>>()
    };
    let named = |line| {
        let fields = fields(line);
        assert_eq!(fields.len(), head.len(), "fields of {line}");
        head.iter().map(|s| s.to_string()).zip(fields).collect()
    };
    lines.map(named).collect()
}

/// The finished cells and when their files were written.
fn cells(folder: &Folder, out: &str) -> BTreeMap<PathBuf, std::time::SystemTime> {
    records(folder, &format!("{out}/cells"))
}

/// The JSON files in a folder and when they were written.
fn records(folder: &Folder, below: &str) -> BTreeMap<PathBuf, std::time::SystemTime> {
    let below = folder.path(below);
    let files = folder.files().into_iter();
    let own = files.filter(|f| f.starts_with(&below) && f.extension().is_some_and(|e| e == "json"));
    own.map(|f| {
        let written = f.metadata().and_then(|m| m.modified()).expect("times");
        (f, written)
    })
    .collect()
}

#[test]
fn every_cell_is_a_row_with_cost_error_and_origin() {
    let folder = with_experiment();
    let ran = folder.run("experiment rooms.ron --quiet").fine();
    assert_eq!(ran.stderr, "", "quiet");
    assert!(ran.stdout.contains("## room, virtual"), "{}", ran.stdout);
    let rows = rows(&folder, "out/rooms/results.csv");
    assert_eq!(
        rows.len(),
        2 * 2 * 2 * 2,
        "lights × methods × budgets × seeds"
    );
    for row in &rows {
        assert_eq!(row["status"], "done", "{row:?}");
        let number = |key: &str| row[key].parse::<f64>().unwrap_or(f64::NAN);
        for key in [
            "seconds_render",
            "rays_shadow",
            "mse",
            "relmse",
            "hdr_flip",
            "flip",
        ] {
            assert!(number(key) > 0.0, "{key} in {row:?}");
        }
        assert!(number("bias").abs() < 5.0 * number("bias_95"), "{row:?}");
        for key in ["cpu", "commit", "threads", "reference_method"] {
            assert!(!row[key].is_empty(), "{key} in {row:?}");
        }
        assert!(number("reference_standard_error") <= 0.2, "{row:?}");
        if row["budget"] == "2 spp" {
            assert_eq!(row["spp"], "2", "{row:?}");
        } else {
            let per_pixel = number("light_samples") / (32.0 * 18.0);
            assert!((15.0..25.0).contains(&per_pixel), "{row:?}");
        }
    }
    let json = folder.json("out/rooms/results.json");
    assert_eq!(
        json["references"].as_array().map(Vec::len),
        Some(2),
        "one per light set"
    );
    let reference = &json["references"][0];
    assert_eq!(
        reference["method"], "AllLights(AllLightsSpec)",
        "{reference}"
    );
    assert_eq!(reference["under_test"], false, "{reference}");
    for file in [
        "index.html",
        "summary.md",
        "plots/1-room-lamps-error-time.svg",
    ] {
        assert!(folder.exists(&format!("out/rooms/{file}")), "{file}");
    }
}

#[test]
fn figures_depend_on_neither_threads_nor_other_cells() {
    let folder = with_experiment();
    folder
        .run("experiment rooms.ron --quiet --threads 2 --out two")
        .fine();
    change(
        &folder,
        "(name: \"uniform\", method: Uniform(samples: 4)),",
        "",
    );
    folder
        .run("experiment rooms.ron --quiet --threads 1 --out one")
        .fine();
    let errors = |out: &str| -> Vec<String> {
        let rows = rows(&folder, &format!("{out}/results.csv"));
        let own = rows.iter().filter(|row| row["method"] == "stochastic");
        own.map(|row| format!("{} {} {}", row["spp"], row["relmse"], row["flip"]))
            .collect()
    };
    assert_eq!(errors("one"), errors("two"), "spp, relmse and FLIP");
}

#[test]
fn a_second_run_renders_nothing_and_a_changed_one_only_what_changed() {
    let folder = with_experiment();
    folder.run("experiment rooms.ron --quiet").fine();
    let first = cells(&folder, "out/rooms");
    assert_eq!(first.len(), 16, "cells");
    let table = folder.read("out/rooms/results.csv");
    folder.run("experiment rooms.ron --quiet").fine();
    assert_eq!(cells(&folder, "out/rooms"), first, "nothing was to be done");
    assert!(
        folder.read("out/rooms/results.csv") == table,
        "the same table"
    );

    let references = records(&folder, "out/rooms/references");
    assert_eq!(references.len(), 2, "one for each light set");
    change(&folder, "seeds: [1, 2]", "seeds: [1, 2, 3]");
    folder.run("experiment rooms.ron --quiet").fine();
    let more = cells(&folder, "out/rooms");
    assert_eq!(more.len(), 24, "a seed more");
    let kept = records(&folder, "out/rooms/references");
    assert_eq!(kept, references, "the references serve again");
    assert!(
        first.iter().all(|old| more.get(old.0) == Some(old.1)),
        "the old ones stay"
    );

    // Another scene: nothing of the old one holds.
    let scene = support::ROOM_SCENE.replace("0.3, 1.8, 0", "0.2, 1.8, 0");
    folder.write("scene/scene.ron", scene);
    folder.write("rooms.ron", EXPERIMENT);
    folder.run("experiment rooms.ron --quiet").fine();
    assert_eq!(cells(&folder, "out/rooms").len(), 24 + 16, "all anew");
    let kept = records(&folder, "out/rooms/references");
    assert_eq!(kept.len(), 2 + 2, "references of the new scene");
    assert_eq!(rows(&folder, "out/rooms/results.csv").len(), 16, "rows");
}

#[cfg(unix)]
#[test]
fn a_killed_run_goes_on_where_it_was() {
    let folder = with_experiment();
    let mut command = folder.command("experiment rooms.ron --quiet");
    let mut child = command.spawn().expect("the binary starts");
    let patience = Instant::now() + Duration::from_secs(60);
    while cells(&folder, "out/rooms").len() < 3 && Instant::now() < patience {
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().expect("kills");
    child.wait().expect("ended");
    let kept = cells(&folder, "out/rooms");
    assert!(kept.len() >= 3, "{kept:?}");
    folder.run("experiment rooms.ron --quiet").fine();
    let all = cells(&folder, "out/rooms");
    assert_eq!(all.len(), 16, "cells");
    assert!(
        kept.iter().all(|old| all.get(old.0) == Some(old.1)),
        "kept ones stay"
    );
    assert_eq!(rows(&folder, "out/rooms/results.csv").len(), 16, "rows");
}

#[test]
fn a_cell_that_fails_is_told_and_the_others_go_on() {
    let folder = with_experiment();
    let scenes = "(name: \"gone\", scene: \"nowhere/scene.ron\"), (name: \"room\"";
    change(&folder, "(name: \"room\"", scenes);
    let ran = folder.run("experiment rooms.ron --quiet").exits(1);
    ran.says(&["16 of 32 cells failed", "results.csv"]);
    let rows = rows(&folder, "out/rooms/results.csv");
    for row in rows {
        let gone = row["scene"] == "gone";
        assert_eq!(row["status"] == "failed", gone, "{row:?}");
        let told = row["message"].contains("rooms.ron:4:36: scenes[0].scene: found");
        assert_eq!(told, gone, "{row:?}");
    }
}

#[test]
fn too_many_lights_and_a_budget_that_is_never_spent_fail_alone() {
    let folder = with_experiment();
    let lights = "(name: \"too many\", lights: Virtual(count: 1000000)),";
    change(&folder, "(name: \"lamps\", lights: AsGiven),", lights);
    folder
        .run("experiment rooms.ron --quiet --max-memory 200MB")
        .exits(1);
    let table = rows(&folder, "out/rooms/results.csv");
    for row in &table {
        let failed = row["lights"] == "too many";
        assert_eq!(row["status"] == "failed", failed, "{row:?}");
        for part in ["320.2 MB", "200.0 MB of --max-memory", "lights.count"] {
            assert!(!failed || row["message"].contains(part), "{row:?}");
        }
    }
    folder.write(
        "scene/scene.ron",
        support::ROOM_SCENE
            .replace("(3, 2.8, 2.5)", "(0, 0, 0)")
            .replace("(0.2, 0.3, 0.8)", "(0, 0, 0)"),
    );
    folder.write("rooms.ron", EXPERIMENT);
    folder
        .run("experiment rooms.ron --quiet --out dark")
        .exits(1);
    for row in rows(&folder, "dark/results.csv") {
        let failed = row["budget"] != "2 spp";
        assert_eq!(row["status"] == "failed", failed, "{row:?}");
        assert!(!failed || row["message"].contains("never spent"), "{row:?}");
    }
}

#[test]
fn bad_experiments_are_refused_at_their_place() {
    let folder = with_experiment();
    let before = folder.files();
    for (from, to, part) in [
        (
            "seeds: [1, 2]",
            "seeds: []",
            "rooms.ron:14:12: seeds: found an empty list",
        ),
        (
            "methods: [",
            "method: [",
            "rooms.ron:9:5: unknown field `method`",
        ),
        (
            "samples: 4",
            "samples: 0",
            "rooms.ron:10:52: methods[0].method.samples: found 0",
        ),
        ("Spp(2)", "Spp(0)", "rooms.ron:13:15: budgets[0]"),
        (
            "0.1, 0.2, 0.3, 0.4",
            "0.1, 0.2, 0.95, 0.4",
            "scenes[0].crops[0]: found (0.1, 0.2, 0.95, 0.4)",
        ),
        (
            "max_spp: 64",
            "max_spp: 64, seed: 2",
            "reference.seed: found 2, which is among the seeds",
        ),
        (
            "max_spp: 64",
            "method: Lightcuts",
            "reference.method: found Lightcuts",
        ),
        (
            "scene/scene.ron",
            "$MANYLIGHT_SCENES/a/scene.ron",
            "rooms.ron:4:36: scenes[0].scene",
        ),
        (
            "scene/scene.ron",
            "$MANYLIGHT_SCENES/a/scene.ron",
            "MANYLIGHT_SCENES is not set",
        ),
    ] {
        change(&folder, from, to);
        let ran = folder.run("experiment rooms.ron");
        assert_eq!(ran.code, 2, "{to}: {}", ran.stderr);
        assert!(
            ran.stderr.contains(part),
            "{to}: no {part:?} in {}",
            ran.stderr
        );
        assert_eq!(folder.files(), before, "{to}: a file was left");
    }
}

#[test]
fn an_animation_has_frames_a_flicker_and_a_preview() {
    let folder = with_experiment();
    let path = "animation: (frames: 3, path: Lights([(0, 0, 0), (0.3, -0.2, 0)]))), (name: \"b\",";
    change(
        &folder,
        "crops: [(0.1, 0.2, 0.3, 0.4)])",
        &format!("{path} scene: \"scene/scene.ron\")"),
    );
    folder.run("experiment rooms.ron --quiet").fine();
    let rows = rows(&folder, "out/rooms/results.csv");
    assert_eq!(rows.len(), (3 + 1) * 16, "three frames and a still");
    let moving = rows.iter().filter(|row| row["scene"] == "room");
    let frames: Vec<&str> = moving.map(|row| &*row["frame"]).collect();
    assert_eq!(
        frames.iter().filter(|f| **f == "2").count(),
        16,
        "{frames:?}"
    );
    let page = String::from_utf8(folder.read("out/rooms/index.html")).expect("UTF-8");
    assert_eq!(
        page.matches("\"preview\":").count(),
        2 * 2 * 2,
        "lights × methods × budgets"
    );
    // Frames of lights that move differ; so do their references.
    let json = folder.json("out/rooms/results.json");
    assert_eq!(
        json["references"].as_array().map(Vec::len),
        Some(2 * 4),
        "references"
    );
}

#[test]
fn paths_are_brighter_than_direct_light_and_agree_with_their_reference() {
    let folder = with_experiment();
    let virtual_lights = "(name: \"virtual\", lights: Virtual(count: 300, max_bounces: 3)),";
    let paths = EXPERIMENT
        .replace(virtual_lights, "")
        .replace("seeds:", "integrator: Path(max_bounces: 2), seeds:");
    folder.write("paths.ron", &paths);
    folder.write(
        "direct.ron",
        paths.replace("integrator: Path(max_bounces: 2), ", ""),
    );
    for name in ["paths", "direct"] {
        folder.run(&format!("experiment {name}.ron --quiet")).fine();
        for row in rows(&folder, &format!("out/{name}/results.csv")) {
            let number = |key: &str| row[key].parse::<f64>().unwrap_or(f64::NAN);
            assert!(number("bias").abs() < 5.0 * number("bias_95"), "{row:?}");
        }
    }
    let mean = |name: &str| {
        let files = folder.files().into_iter();
        let own = |f: &PathBuf| f.starts_with(folder.path(&format!("out/{name}/references")));
        let exr = |f: &PathBuf| f.extension().is_some_and(|e| e == "exr");
        let path = files.filter(own).find(exr).expect("a reference");
        let image = film::read_image(&path).unwrap_or_else(|e| panic!("{e}"));
        image.pixels.iter().map(|p| p.element_sum()).sum::<f32>()
    };
    assert!(
        mean("paths") > 1.1 * mean("direct"),
        "reflected light is missing"
    );
}

#[test]
fn the_quick_form_goes_to_a_folder_of_its_own() {
    let folder = with_experiment();
    folder.run("experiment rooms.ron --quick --quiet").fine();
    assert!(!folder.exists("out/rooms"), "the full form's folder");
    let rows = rows(&folder, "out/rooms-quick/results.csv");
    assert_eq!(rows.len(), 2 * 2 * 2, "one seed");
    assert_eq!(
        folder.json("out/rooms-quick/results.json")["quick"],
        true,
        "said"
    );
}
