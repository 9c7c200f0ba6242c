//! Renders that are ended at any moment, or have no room on the disk: what is there afterwards is whole, and the
//! render goes on to the bits of one that nobody disturbed.
#![cfg(unix)]

mod support;

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use film::Picture;
use support::{BINARY, Folder};

/// Large enough that a good part of the time goes into writing.
const LINE: &str = "render room.ron --size 96x64 --quiet";
/// Each start makes a pass, and writes all files anew.
const SPP: u32 = 40;

/// Numbers in [0, 1) that are evenly spread however many they are: multiples of the golden ratio.
fn spread(n: u32) -> f64 {
    (f64::from(n) * 0.618_033_988_749_894_9).fract()
}

/// Starts the command, kills it after `delay`, and says whether it was still there to be killed.
fn kill_after(folder: &Folder, line: &str, delay: Duration) -> bool {
    let mut command = folder.command(line);
    let mut child = command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    std::thread::sleep(delay);
    let was_running = matches!(child.try_wait(), Ok(None));
    child.kill().expect("kills");
    child.wait().expect("ended");
    was_running
}

/// Every file in `out` can be read as what its name says, apart from temporary ones that never took a name.
fn assert_whole(folder: &Folder) {
    for path in folder.files() {
        let shown = path.display().to_string();
        let bytes = std::fs::read(&path).expect("reads");
        let hidden = path
            .file_name()
            .is_some_and(|n| n.to_string_lossy().starts_with('.'));
        match path.extension().and_then(|e| e.to_str()) {
            _ if hidden => {}
            Some("exr") => {
                film::read_image(&path).unwrap_or_else(|e| panic!("half a file: {e}"));
            }
            Some("json") => {
                serde_json::from_slice::<serde_json::Value>(&bytes)
                    .unwrap_or_else(|e| panic!("half a file: {shown}: {e}"));
            }
            Some("png") => {
                // Its last chunk has nothing in it.
                assert!(
                    bytes.ends_with(b"IEND\xAE\x42\x60\x82"),
                    "half a file: {shown}"
                );
            }
            Some("csv" | "html" | "svg" | "md") => assert!(!bytes.is_empty(), "{shown}"),
            _ => {}
        }
    }
}

/// Temporary files that are left in `out`.
fn temporary(folder: &Folder) -> Vec<PathBuf> {
    let mut files = folder.files();
    files.retain(|path| path.extension().is_some_and(|e| e == "tmp"));
    files
}

/// How long the command takes when nobody disturbs it.
fn time(folder: &Folder, line: &str) -> Duration {
    let begun = Instant::now();
    folder.run(line).fine();
    begun.elapsed()
}

/// However slow the machine is, a hundred kills do not take this long.
const PATIENCE: Duration = Duration::from_secs(30 * 60);

/// Calls `attempt` with moments between the beginning and a little beyond the end of what takes `whole`, until
/// `wanted` attempts say that what they killed was still running: how many come too late depends on the machine.
fn kill_until(
    wanted: u32,
    what: &str,
    mut whole: Duration,
    mut attempt: impl FnMut(Duration) -> bool,
) {
    let begun = Instant::now();
    let (mut killed, mut attempts) = (0, 0);
    while killed < wanted {
        assert!(
            begun.elapsed() < PATIENCE,
            "only {killed} of {attempts} {what} were killed while they ran"
        );
        let share = 1.1 * spread(attempts);
        attempts += 1;
        if attempt(whole.mul_f64(share)) {
            killed += 1;
            // The machine is busier than it was: else the end would not be reached again.
            if share > 1.0 {
                whole = whole.mul_f64(1.2);
            }
        }
    }
    eprintln!("{killed} of {attempts} {what} killed while they ran, the others had just ended");
}

/// Kills renders until `kills` were killed while they ran.
fn kill_renders(kills: u32) {
    let folder = Folder::with_room();
    folder
        .run(&format!("{LINE} --spp {SPP} --name whole"))
        .fine();
    let pass = format!("{LINE} --spp {SPP} --max-seconds 0 --resume");
    let whole = time(&folder, &pass);
    kill_until(kills, "renders", whole, |delay| {
        if folder.exists("out/room.exr") && !folder.exists("out/room.state") {
            // It is finished: begin anew.
            std::fs::remove_file(folder.path("out/room.exr")).expect("removes");
        }
        let was_running = kill_after(&folder, &pass, delay);
        assert_whole(&folder);
        was_running
    });
    folder.run(&format!("{LINE} --spp {SPP} --resume")).fine();
    let after = temporary(&folder);
    assert!(after.is_empty(), "{after:?} left by killed renders");
    for end in ["exr", "png"] {
        let [went_on, undisturbed] =
            ["room", "whole"].map(|n| folder.read(&format!("out/{n}.{end}")));
        assert!(went_on == undisturbed, "{end} after {kills} kills differs");
    }
}

#[test]
fn a_render_killed_at_any_moment_leaves_whole_files_and_goes_on_to_the_same_bits() {
    kill_renders(6);
}

/// A file as a writer of `name` leaves it when it is killed.
fn leave_half(folder: &Folder, name: &str) {
    folder.write(&format!("out/.{name}.b0c1d2.tmp"), "half");
}

#[test]
fn what_killed_runs_left_is_gone_after_the_next_of_the_same_name() {
    let folder = Folder::with_room();
    let tiny = "render room.ron --quiet --size 8x6 --spp 1 --set lights=AsGiven";
    folder.run(tiny).fine();
    for end in ["exr", "png", "json", "state"] {
        leave_half(&folder, &format!("room.{end}"));
    }
    leave_half(&folder, "other.exr");
    folder.run(tiny).fine();
    let others = folder.path("out/.other.exr.b0c1d2.tmp");
    assert_eq!(temporary(&folder), [others], "only its own is gone");

    folder.run(&format!("{tiny} --name a --shard 1/2")).fine();
    folder.run(&format!("{tiny} --name b --shard 2/2")).fine();
    leave_half(&folder, "whole.exr");
    folder
        .run("merge out/a.exr out/b.exr --out out/whole.exr")
        .fine();
    assert_eq!(temporary(&folder).len(), 1, "{:?}", temporary(&folder));

    folder.write("e.ron", EXPERIMENT);
    for name in [
        ".results.csv",
        ".index.html",
        "cells/.0123.exr",
        "references/.0123.exr",
        "plots/.error.svg",
        "pictures/.0123.js",
        "animations/.power.png",
    ] {
        folder.write(&format!("out/e/{name}.b0c1d2.tmp"), "half");
    }
    folder
        .run("experiment e.ron --quiet --quick --out out/e")
        .fine();
    assert_eq!(temporary(&folder).len(), 1, "{:?}", temporary(&folder));
}

#[test]
#[ignore = "minutes: a hundred moments"]
fn a_render_killed_at_a_hundred_moments_goes_on_to_the_same_bits() {
    kill_renders(100);
}

#[test]
#[ignore = "minutes: checkpoints are a minute apart"]
fn a_render_killed_after_a_checkpoint_goes_on_from_it_to_the_same_bits() {
    let folder = Folder::with_room();
    let line = "render room.ron --size 48x32 --method all-lights --spp";
    // Far too much to be done before the kill.
    let mut command = folder.command(&format!("{line} 16000000 --quiet"));
    let mut child = command.spawn().expect("starts");
    let begun = Instant::now();
    while !folder.exists("out/room.state") && begun.elapsed() < Duration::from_secs(150) {
        std::thread::sleep(Duration::from_millis(100));
    }
    child.kill().expect("kills");
    child.wait().expect("ended");
    assert!(folder.exists("out/room.state"), "there is a checkpoint");
    let ran = folder.run(&format!("{line} 16000000 --resume --max-seconds 0"));
    ran.fine().says(&["going on from"]);
    let done = folder.json("out/room.json")["spp"].as_u64();
    let spp = done.expect("a number") + 20;
    folder.run(&format!("{line} {spp} --resume")).fine();
    folder.run(&format!("{line} {spp} --name whole")).fine();
    assert!(
        folder.read("out/room.exr") == folder.read("out/whole.exr"),
        "the render that went on differs at {spp} samples"
    );
}

const EXPERIMENT: &str = "(
    title: \"Rooms\", image: (width: 32, height: 18), scenes: [(name: \"room\", scene: \"scene/scene.ron\")],
    methods: [(name: \"power\", method: Power), (name: \"all\", method: AllLights)],
    budgets: [Spp(2), Spp(9)], seeds: [1, 2], reference: (standard_error: 0.2, max_spp: 64),
)";

/// Kills experiments until `kills` were killed while they ran. One is killed up to four times, then finished, and the
/// next begins anew.
fn kill_experiments(kills: u32) {
    let folder = Folder::with_room();
    folder.write("e.ron", EXPERIMENT);
    let line = "experiment e.ron --quiet --out out/e";
    let whole = time(&folder, "experiment e.ron --quiet --out out/whole");
    let mut attempts = 0;
    kill_until(kills, "experiments", whole, |delay| {
        let was_running = kill_after(&folder, line, delay);
        assert_whole(&folder);
        attempts += 1;
        if attempts % 4 == 0 {
            folder.run(line).fine();
            let left = temporary(&folder);
            assert!(left.is_empty(), "{left:?} after {attempts} attempts");
            assert_eq!(
                pictures(&folder, "e"),
                pictures(&folder, "whole"),
                "after {attempts} attempts"
            );
            std::fs::remove_dir_all(folder.path("out/e")).expect("removes");
        }
        was_running
    });
}

/// The radiance of all of an experiment's pictures; their names depend on the clock as little as they do.
fn pictures(folder: &Folder, name: &str) -> Vec<Vec<[u32; 3]>> {
    let below = folder.path(&format!("out/{name}"));
    let files = folder.files();
    let mine = files.iter().filter(|f| f.starts_with(&below));
    let exr = mine.filter(|f| f.extension().is_some_and(|e| e == "exr"));
    let images = exr.map(|path| film::read_image(path).unwrap_or_else(|e| panic!("{e}")));
    let mut all: Vec<Vec<_>> = images
        .map(|i| {
            i.pixels
                .iter()
                .map(|p| p.to_array().map(f32::to_bits))
                .collect()
        })
        .collect();
    all.sort();
    all
}

#[test]
#[ignore = "minutes: a hundred moments"]
fn an_experiment_killed_at_a_hundred_moments_goes_on_to_the_same_pictures() {
    kill_experiments(100);
}

/// Runs the command where no file may be larger than so many blocks of 512 bytes, and writing more is an error, as it is
/// on a full disk.
fn run_with_little_room(folder: &Folder, line: &str, blocks: u32) -> (Option<i32>, String) {
    let limited = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" {line}");
    let output = Command::new("sh")
        .args(["-c", &limited, BINARY])
        .current_dir(folder.path(""))
        .output()
        .expect("sh starts");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), said)
}

#[test]
fn a_full_disk_is_an_error_that_keeps_the_last_good_state() {
    let folder = Folder::with_room();
    folder.run(&format!("{LINE} --spp 6 --name whole")).fine();
    folder
        .run(&format!("{LINE} --spp 6 --max-seconds 0"))
        .fine();
    let kept = ["exr", "json", "state"].map(|end| folder.read(&format!("out/room.{end}")));
    let before = folder.files();
    let (code, said) = run_with_little_room(&folder, &format!("{LINE} --spp 6 --resume"), 16);
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.starts_with("error: ") && said.contains("out/room."),
        "{said}"
    );
    assert!(!said.contains("panicked"), "{said}");
    for (end, kept) in ["exr", "json", "state"].iter().zip(kept) {
        assert!(
            folder.read(&format!("out/room.{end}")) == kept,
            "room.{end} is another"
        );
    }
    assert_eq!(folder.files(), before, "no temporary file is left");
    folder.run(&format!("{LINE} --spp 6 --resume")).fine();
    assert!(
        folder.read("out/room.exr") == folder.read("out/whole.exr"),
        "the render that went on differs"
    );
}

#[test]
fn a_finished_render_whose_picture_cannot_be_written_is_saved() {
    let folder = Folder::with_room();
    folder.run(&format!("{LINE} --spp 6 --name whole")).fine();
    // The state of so few pixels is smaller than their picture: it fits where that does not.
    let tiny = "render room.ron --quiet --spp 6 --set lights=AsGiven --size";
    let size = |folder: &Folder, name: &str| folder.read(name).len();
    folder.run(&format!("{tiny} 1x1 --max-seconds 0")).fine();
    let (exr, state) = (
        size(&folder, "out/room.exr"),
        size(&folder, "out/room.state"),
    );
    assert!(
        state + 512 < exr,
        "a state of {state} bytes beside a picture of {exr}"
    );
    for end in ["exr", "png", "json", "state"] {
        std::fs::remove_file(folder.path(&format!("out/room.{end}"))).expect("removes");
    }
    let blocks = state.div_ceil(512) as u32;
    let (code, said) = run_with_little_room(&folder, &format!("{tiny} 1x1"), blocks);
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("room.exr") && said.contains("--resume"),
        "{said}"
    );
    let ran = folder.run(&format!("{} 1x1 --resume", tiny.replace("--quiet ", "")));
    ran.fine().says(&["6 of 6 samples"]);
    assert!(
        folder.exists("out/room.exr") && !folder.exists("out/room.state"),
        "finished"
    );
    let whole: Picture = folder.picture("out/room.exr");
    assert_eq!(whole.samples, [6], "samples");
}
