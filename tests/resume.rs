//! Renders that end early and go on later, to the bits of a render that never stopped.

mod support;

#[cfg(unix)]
use std::{
    io::{BufRead, BufReader, Read},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use support::Folder;

/// Renders the room whole as `whole`, and the first pass of it as `room`.
fn stopped() -> Folder {
    let folder = Folder::with_room();
    folder.run("render room.ron --spp 6 --name whole").fine();
    let ran = folder.run("render room.ron --spp 6 --max-seconds 0").fine();
    ran.says(&["1 of 6 samples", "--resume"]);
    assert!(folder.exists("out/room.state"), "there is a state");
    folder
}

/// A report without what depends on the clock.
fn counted(folder: &Folder, name: &str) -> Vec<serde_json::Value> {
    let report = folder.json(name);
    let keys = [
        "spp",
        "seed",
        "rays",
        "light_samples",
        "dead_samples",
        "shading_points",
        "nonfinite",
        "lights",
        "needs",
    ];
    keys.map(|key| report[key].clone()).to_vec()
}

#[test]
fn a_stopped_render_goes_on_to_the_same_file() {
    let folder = stopped();
    let before = folder.json("out/room.json");
    assert_eq!(before["spp"], 1, "samples of the stopped render");
    let ran = folder.run("render room.ron --spp 6 --resume --threads 1");
    ran.fine().says(&["going on from", "1 of 6 samples"]);
    assert!(
        folder.read("out/room.exr") == folder.read("out/whole.exr"),
        "the resumed render differs"
    );
    assert!(
        folder.read("out/room.png") == folder.read("out/whole.png"),
        "its PNG differs"
    );
    assert_eq!(
        counted(&folder, "out/room.json"),
        counted(&folder, "out/whole.json"),
        "reports"
    );
    let seconds = |r: &serde_json::Value| r["seconds"]["render"].as_f64().expect("seconds");
    let after = folder.json("out/room.json");
    assert!(seconds(&after) > seconds(&before), "time adds up");
    assert!(!folder.exists("out/room.state"), "no state of the finished");
}

#[test]
fn every_stop_on_the_way_and_more_samples_give_the_same_file() {
    let folder = stopped();
    // The time is up already: nothing more is rendered, and the state stays.
    let again = "render room.ron --spp 6 --resume --max-seconds 0";
    folder.run(again).fine();
    assert_eq!(folder.json("out/room.json")["spp"], 1, "nothing to do");
    // To 3 samples, of which the state is gone when they are done; so stop at 2 of them.
    for (spp, seconds) in [(2, "1e9"), (3, "0")] {
        let line = format!("render room.ron --spp {spp} --name other --max-seconds {seconds}");
        folder.run(&line).fine();
    }
    assert!(folder.exists("out/other.state"), "1 of 3 samples");
    let line = "render room.ron --spp 6 --name other --resume";
    folder.run(line).fine();
    assert!(
        folder.read("out/other.exr") == folder.read("out/whole.exr"),
        "a render with more samples than planned at first differs"
    );
}

#[test]
fn a_shard_goes_on_as_well() {
    let folder = stopped();
    for part in 1..=2 {
        let line = format!("render room.ron --spp 6 --shard {part}/2 --name p{part}");
        folder.run(&format!("{line} --max-seconds 0")).fine();
        folder.run(&format!("{line} --resume")).fine();
    }
    folder
        .run("merge out/p1.exr out/p2.exr --out out/merged.exr")
        .fine();
    assert!(
        folder.read("out/merged.exr") == folder.read("out/whole.exr"),
        "merged resumed shards differ"
    );
}

#[test]
fn errors_of_passes_before_the_stop_are_kept() {
    let folder = stopped();
    let line = "render room.ron --spp 4 --reference out/whole.exr --name r";
    folder.run(&format!("{line} --max-seconds 0")).fine();
    folder.run(&format!("{line} --resume")).fine();
    let report = folder.json("out/r.json");
    let passes = report["error"]["passes"].as_array().expect("a list");
    let samples: Vec<_> = passes.iter().map(|p| p["spp"].as_u64()).collect();
    assert_eq!(samples, [Some(1), Some(2), Some(4)], "passes");
}

#[test]
fn without_a_state_resume_begins_from_the_start() {
    let folder = Folder::with_room();
    let ran = folder.run("render room.ron --resume").fine();
    ran.says(&["room.state is not there", "from the start"]);
    assert_eq!(folder.json("out/room.json")["spp"], 3, "samples");
}

#[test]
fn the_state_of_another_render_is_refused() {
    let folder = stopped();
    let state = folder.read("out/room.state");
    for (flags, what) in [
        ("--seed 2", "seed is 1; expected 2"),
        ("--size 33x18", "size is 32x18; expected 33x18"),
        ("--size 18x32", "size is 32x18"),
        ("--method all-lights", "method is Stochastic"),
        ("--set method.cut=5", "Count(5)"),
        ("--set lights.count=501", "501"),
        ("--set lights=AsGiven", "expected AsGiven"),
        ("--set tree.builder=Morton", "Morton"),
        ("--shard 1/2", "shard is 1/1; expected 1/2"),
    ] {
        let ran = folder.run(&format!("render room.ron --spp 6 --resume {flags}"));
        let ran = ran.exits(2).says(&["room.state", "another render", what]);
        assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
    }
    let scene = support::ROOM_SCENE.replace("0.3, 1.8", "0.4, 1.8");
    folder.write("scene/scene.ron", scene);
    let ran = folder.run("render room.ron --spp 6 --resume");
    ran.exits(2).says(&["room.state", "scene_content"]);
    folder.write("scene/scene.ron", support::ROOM_SCENE);

    // More samples are done than wanted.
    let line = "render room.ron --spp 6 --resume --name room";
    folder.run(line).fine();
    folder.write("out/room.state", &state);
    assert!(
        state == folder.read("out/room.state"),
        "refusals change nothing"
    );
}

#[test]
fn a_damaged_state_is_refused() {
    let folder = stopped();
    let state = folder.read("out/room.state");
    let mut cases: Vec<(String, Vec<u8>)> = vec![
        ("empty".into(), vec![]),
        ("text".into(), b"out/room.exr\n".repeat(10)),
        ("zeros".into(), vec![0; state.len()]),
        ("one byte more".into(), [&*state, b"x"].concat()),
        ("twice".into(), [&*state, &*state].concat()),
    ];
    for end in [1, 15, 16, 20, 23, 24, 30, 500, state.len() / 2] {
        cases.push((format!("cut to {end}"), state[..end].to_vec()));
    }
    for missing in [1, 8, 9] {
        let end = state.len() - missing;
        cases.push((format!("cut by {missing}"), state[..end].to_vec()));
    }
    // Version, length of the header, the header, counters, pixels, check sum.
    let body = state.len() - 32 * 18 * 112;
    for at in [16, 20, 23, 30, 200, body, body + 5000, state.len() - 1] {
        let mut flipped = state.clone();
        flipped[at] ^= 0xC4;
        cases.push((format!("byte {at} changed"), flipped));
    }
    let pictures: Vec<_> = ["exr", "json"]
        .map(|end| folder.read(&format!("out/room.{end}")))
        .into();
    for (what, bytes) in cases {
        folder.write("out/room.state", bytes);
        let ran = folder.run("render room.ron --spp 6 --resume");
        assert_eq!(ran.code, 2, "{what}: {}", ran.stderr);
        let ran = ran.says(&["error: ", "out/room.state: "]);
        assert!(!ran.stderr.contains("panicked"), "{what}: {}", ran.stderr);
    }
    for (end, before) in ["exr", "json"].iter().zip(pictures) {
        assert!(
            folder.read(&format!("out/room.{end}")) == before,
            "a refused render changed room.{end}"
        );
    }
    folder.write("out/room.state", state);
    folder.run("render room.ron --spp 6 --resume").fine();
}

/// Sends `signal` to a render that has begun, and gives its exit code and what it said.
#[cfg(unix)]
fn interrupted(folder: &Folder, line: &str, signal: &str) -> (Option<i32>, String) {
    let mut command = folder.command(line);
    let mut child = command.stderr(Stdio::piped()).spawn().expect("starts");
    let mut lines = BufReader::new(child.stderr.take().expect("piped"));
    let mut said = String::new();
    // The first pass is done when it says so: from then on signals are watched for.
    let is_pass = |line: &str| line.starts_with(|c: char| c.is_ascii_digit());
    while !said
        .lines()
        .any(|l| is_pass(l) && l.contains(" samples a pixel"))
    {
        let read = lines.read_line(&mut said).expect("stderr is text");
        assert!(read > 0, "it ended by itself: {said}");
    }
    let kill = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status();
    assert!(kill.expect("kill starts").success(), "kill");
    lines.read_to_string(&mut said).expect("stderr is text");
    (child.wait().expect("ends").code(), said)
}

#[cfg(unix)]
#[test]
fn a_signal_saves_the_state_and_the_render_goes_on_later() {
    let folder = Folder::with_room();
    let line = "render room.ron --size 48x32 --method all-lights --spp";
    // Far too much to be done before the signal comes.
    let endless = format!("{line} 16000000");
    let (code, said) = interrupted(&folder, &endless, "-TERM");
    assert_eq!(code, Some(3), "{said}");
    assert!(said.contains("out/room.state"), "{said}");
    assert!(said.contains("--resume"), "{said}");
    assert!(folder.exists("out/room.state"), "the state");
    assert!(!folder.exists("out/room.exr"), "no unfinished picture");

    // How far it came depends on the clock: let it end a little later.
    let (code, said) = interrupted(&folder, &format!("{endless} --resume"), "-INT");
    assert_eq!(code, Some(3), "again: {said}");
    let (done, _) = said
        .split_once("interrupted at ")
        .and_then(|(_, rest)| rest.split_once(" of "))
        .expect("says how far it came");
    let spp = done.parse::<u32>().expect("a number") + 20;
    folder.run(&format!("{line} {spp} --resume")).fine();
    folder.run(&format!("{line} {spp} --name whole")).fine();
    assert!(
        folder.read("out/room.exr") == folder.read("out/whole.exr"),
        "the resumed render differs at {spp} samples"
    );
    assert!(!folder.exists("out/room.state"), "the state is gone");
}

#[cfg(unix)]
#[test]
fn a_signal_within_a_long_pass_is_heard_at_once() {
    let folder = Folder::with_room();
    // One pass of this would take minutes.
    let line =
        "render room.ron --size 640x400 --method all-lights --set lights.count=20000 --spp 64";
    let mut command = folder.command(line);
    let mut child = command.stderr(Stdio::piped()).spawn().expect("starts");
    // Set-up is over when the virtual lights are there; then rendering begins.
    let mut lines = BufReader::new(child.stderr.take().expect("piped"));
    let mut said = String::new();
    while !said.contains("virtual lights") {
        let read = lines.read_line(&mut said).expect("stderr is text");
        assert!(read > 0, "it ended by itself: {said}");
    }
    std::thread::sleep(Duration::from_secs(2));
    let kill = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(kill.expect("kill starts").success(), "kill");
    let begun = Instant::now();
    lines.read_to_string(&mut said).expect("stderr is text");
    let code = child.wait().expect("ends").code();
    assert_eq!(code, Some(3), "{said}");
    assert!(begun.elapsed() < Duration::from_secs(20), "it took long");
    assert!(folder.exists("out/room.state"), "the state");
}
