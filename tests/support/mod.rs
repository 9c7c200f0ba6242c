//! Runs the real binary in a folder of its own, with small scenes to render.

#![allow(dead_code, reason = "every test file uses its own part of this module")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use film::Picture;

/// The program under test.
pub(crate) const BINARY: &str = env!("CARGO_BIN_EXE_manylight");

/// A temporary folder that commands run in.
pub(crate) struct Folder {
    folder: tempfile::TempDir,
}

/// What a command left.
pub(crate) struct Ran {
    /// The command line, for messages.
    pub(crate) line: String,
    /// Exit code; -1 when a signal ended it.
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Ran {
    /// Exit code 0, or the test ends with what the command said.
    #[track_caller]
    pub(crate) fn fine(self) -> Self {
        self.exits(0)
    }

    #[track_caller]
    pub(crate) fn exits(self, code: i32) -> Self {
        assert_eq!(self.code, code, "{}\n{}", self.line, self.stderr);
        self
    }

    /// stderr holds all of `parts`.
    #[track_caller]
    pub(crate) fn says(self, parts: &[&str]) -> Self {
        for part in parts {
            let found = self.stderr.contains(part);
            assert!(found, "{}: no {part:?} in: {}", self.line, self.stderr);
        }
        self
    }
}

impl Folder {
    /// An empty folder.
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("temporary folder");
        Self { folder }
    }

    /// A folder with the small room and its run file, `room.ron`.
    pub(crate) fn with_room() -> Self {
        let folder = Self::new();
        folder.write("scene/scene.ron", ROOM_SCENE);
        folder.write("scene/room.obj", ROOM_OBJ);
        folder.write("scene/room.mtl", ROOM_MTL);
        folder.write("room.ron", ROOM);
        folder
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("inside the folder")).expect("makes folders");
        std::fs::write(path, bytes).expect("writes");
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn exists(&self, name: &str) -> bool {
        self.path(name).exists()
    }

    pub(crate) fn picture(&self, name: &str) -> Picture {
        let read = Picture::read_exr(&self.path(name));
        read.unwrap_or_else(|e| panic!("{e}")).0
    }

    pub(crate) fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.read(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// A command that runs in this folder, with words divided by spaces.
    pub(crate) fn command(&self, line: &str) -> Command {
        let mut command = Command::new(BINARY);
        command
            .args(line.split_whitespace())
            .current_dir(self.folder.path())
            .env_remove("MANYLIGHT_SCENES");
        command
    }

    /// Runs words divided by spaces.
    pub(crate) fn run(&self, line: &str) -> Ran {
        self.run_words(&line.split_whitespace().collect::<Vec<_>>())
    }

    /// Runs words that may hold spaces.
    pub(crate) fn run_words(&self, words: &[&str]) -> Ran {
        let output = self.command("").args(words).output();
        let Output {
            status,
            stdout,
            stderr,
        } = output.expect("the binary starts");
        Ran {
            line: words.join(" "),
            code: status.code().unwrap_or(-1),
            stdout: String::from_utf8(stdout).expect("stdout is UTF-8"),
            stderr: String::from_utf8(stderr).expect("stderr is UTF-8"),
        }
    }

    /// Paths of all files below the folder, sorted.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        collect(self.folder.path(), &mut files);
        files.sort();
        files
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        match path.is_dir() {
            true => collect(&path, files),
            false => files.push(path),
        }
    }
}

/// Every test's default: the room at a size that renders in a blink, in two by two tiles.
const ROOM: &str = "(
    scene: \"scene/scene.ron\",
    image: (width: 32, height: 18, spp: 3),
    lights: Virtual(kind: Vsl, count: 500, max_bounces: 3),
    method: StochasticLightcuts(cut: 4),
    seed: 1,
)
";

pub(crate) const ROOM_SCENE: &str = "(
    geometry: [\"room.obj\"],
    camera: (origin: (0, 1, 1.8), target: (0, 0.9, 0), up: (0, 1, 0), fov_y_deg: 60),
    lights: [
        Point(position: (0.3, 1.8, 0), intensity: (3, 2.8, 2.5)),
        Point(position: (-0.6, 0.4, 0.9), intensity: (0.2, 0.3, 0.8)),
    ],
)
";

/// A closed room of 4 by 2 by 4 with a block in it.
const ROOM_OBJ: &str = "mtllib room.mtl
v -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2
v -2 2 -2\nv 2 2 -2\nv 2 2 2\nv -2 2 2
v -0.9 0 -1\nv 0.1 0 -1\nv 0.1 0 0\nv -0.9 0 0
v -0.9 1 -1\nv 0.1 1 -1\nv 0.1 1 0\nv -0.9 1 0
usemtl grey
f 1 2 3 4
f 5 8 7 6
f 1 5 6 2
usemtl red
f 1 4 8 5
usemtl green
f 2 6 7 3
usemtl grey
f 3 7 8 4
usemtl shiny
f 9 10 14 13
f 10 11 15 14
f 11 12 16 15
f 12 9 13 16
f 13 14 15 16
";

const ROOM_MTL: &str = "newmtl grey\nKd 0.7 0.7 0.7
newmtl red\nKd 0.6 0.1 0.1
newmtl green\nKd 0.1 0.5 0.1
newmtl shiny\nKd 0.3 0.3 0.4\nKs 0.4 0.4 0.4\nNs 40
";
