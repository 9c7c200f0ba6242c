//! The book: every command in it is run, in its page's order, and every file in it is read.
//!
//! A page's blocks share a temporary folder that holds the repository's `configs` and `scenes`. A block whose first line is a
//! comment with a file's name is that file; blocks of `sh` are run by a shell, in which `manylight` is the program under
//! test. A word behind `sh` makes a difference:
//!
//! - `sh,fails`: the last command exits with 2, and says what stands in the next block;
//! - `sh,scenes`: run where `MANYLIGHT_SCENES` is set;
//! - `sh,slurm`: run where a Slurm cluster answers;
//! - `sh,once`: `cargo` builds or tests something, which is what runs this test.

#![cfg(unix)]

mod support;

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use support::{BINARY, Folder};

const REPOSITORY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// A fenced block of a page.
struct Block {
    /// What stands behind the fence: `sh`, `ron`, `sh,fails`.
    kind: String,
    text: String,
    /// In the page, from 1.
    line: usize,
}

impl Block {
    /// The file that the block is, if it is one.
    fn file(&self) -> Option<&str> {
        let first = self.text.lines().next()?;
        let name = first.strip_prefix("// ").or(first.strip_prefix("# "))?;
        let is_name = name.contains('.') && !name.contains(' ');
        (is_name && !self.kind.starts_with("sh")).then_some(name)
    }
}

fn source(page: &str) -> String {
    let path = format!("{REPOSITORY}/docs/book/src/{page}");
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn blocks(page: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut inside = false;
    for (at, line) in source(page).lines().enumerate() {
        match (line.strip_prefix("```"), inside) {
            (Some(kind), false) => blocks.push(Block {
                kind: kind.to_owned(),
                text: String::new(),
                line: at + 2,
            }),
            (None, true) => {
                let block = blocks.last_mut().expect("an open block");
                writeln!(block.text, "{line}").expect("writes to a string");
                continue;
            }
            (Some(_), true) => {}
            (None, false) => continue,
        }
        inside = !inside;
    }
    assert!(!inside, "{page}: a block without an end");
    blocks
}

/// A folder for a page's commands, and the search path that finds the program.
fn folder() -> (Folder, String) {
    let folder = Folder::new();
    let programs = folder.path(".bin");
    std::fs::create_dir(&programs).expect("makes a folder");
    let link = |to: &Path, name: PathBuf| std::os::unix::fs::symlink(to, name).expect("links");
    link(Path::new(BINARY), programs.join("manylight"));
    for name in ["configs", "scenes"] {
        link(&Path::new(REPOSITORY).join(name), folder.path(name));
    }
    let path = std::env::var("PATH").unwrap_or_default();
    (folder, format!("{}:{path}", programs.display()))
}

/// Whether a block is to be run, by the words behind `sh`.
fn is_run(words: &[&str]) -> bool {
    words.iter().all(|word| match *word {
        "fails" => true,
        "scenes" => std::env::var_os("MANYLIGHT_SCENES").is_some(),
        "slurm" => Command::new("sinfo")
            .output()
            .is_ok_and(|o| o.status.success()),
        "once" => false,
        word => panic!("unknown word {word} behind sh"),
    })
}

/// Runs a page's commands, and says how many blocks were run and how many were not.
fn run(page: &str) {
    let (folder, path) = folder();
    let blocks = blocks(page);
    let (mut ran, mut skipped) = (0, 0);
    for (at, block) in blocks.iter().enumerate() {
        let place = format!("{page}:{}", block.line);
        if let Some(name) = block.file() {
            folder.write(name, &block.text);
            let base = name.rsplit('/').next().unwrap_or(name);
            let used = blocks[..at].iter().chain(&blocks[at + 1..]);
            let used = used.filter(|other| other.text.contains(base)).count();
            assert!(used > 0, "{place}: nothing reads {name}");
            continue;
        }
        assert_ne!(block.kind, "ron", "{place}: begin with the file's name");
        let mut words = block.kind.split(',');
        if words.next() != Some("sh") {
            continue;
        }
        let words: Vec<&str> = words.collect();
        if words.contains(&"once") {
            let cargo = |line: &str| line.starts_with("cargo ");
            assert!(block.text.lines().all(cargo), "{place}: only for cargo");
        }
        if !is_run(&words) {
            skipped += 1;
            continue;
        }
        let mut shell = Command::new("sh");
        shell.args(["-e", "-c", &block.text]).env("PATH", &path);
        let output = shell.current_dir(folder.path(".")).output();
        let Output { status, stderr, .. } = output.expect("a shell");
        let said = String::from_utf8_lossy(&stderr);
        let expected = if words.contains(&"fails") { 2 } else { 0 };
        assert_eq!(status.code(), Some(expected), "{place}: {said}");
        if expected == 2 {
            assert_eq!(said, blocks[at + 1].text, "{place}: what it says");
        }
        ran += 1;
    }
    eprintln!("{page}: {ran} blocks run, {skipped} not");
}

/// A test for each page, and the list of them.
macro_rules! pages {
    ($($name:ident = $file:literal),+ $(,)?) => {
        const PAGES: &[&str] = &[$($file),+];

        $(
            #[test]
            fn $name() {
                run($file);
            }
        )+
    };
}

pages! {
    introduction = "introduction.md",
    first_render = "first-render.md",
    your_own_scene = "your-own-scene.md",
    scene_files = "scene-files.md",
    choosing_a_method = "choosing-a-method.md",
    reading_the_report = "reading-the-report.md",
    measuring = "measuring.md",
    reproducing_the_paper = "reproducing-the-paper.md",
    many_machines = "many-machines.md",
    how_it_works = "how-it-works.md",
    adding_a_method = "adding-a-method.md",
}

#[test]
fn every_page_of_the_book_is_tested() {
    let summary = source("SUMMARY.md");
    let listed: Vec<&str> = summary
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
        .collect();
    assert_eq!(listed, PAGES, "pages");
}

#[test]
fn what_the_book_shows_and_includes_is_there() {
    let mut bytes = 0;
    for page in PAGES {
        let text = source(page);
        let targets = |opening: &str, closing: char| -> Vec<String> {
            let parts = text.split(opening).skip(1);
            let target = parts.filter_map(|rest| rest.split(closing).next());
            target.map(str::to_owned).collect()
        };
        let links = targets("](", ')').into_iter();
        let local = links.filter(|target| !target.starts_with("http"));
        for target in local.chain(targets("{{#include ", '}')) {
            let path = format!("{REPOSITORY}/docs/book/src/{target}");
            let found = std::fs::metadata(&path).unwrap_or_else(|e| panic!("{page}: {path}: {e}"));
            if target.starts_with("images/") {
                bytes += found.len();
            }
        }
    }
    assert!(bytes > 0 && bytes < 1 << 20, "{bytes} bytes of pictures");
}

#[test]
fn the_report_page_names_every_field_of_the_report() {
    let folder = Folder::with_room();
    folder.run("render room.ron --spp 1").fine();
    let report = folder.json("out/room.json");
    let page = source("reading-the-report.md");
    // What was asked for stands there too, and needs no word.
    let plain = [
        "scene",
        "width",
        "height",
        "spp",
        "threads",
        "method",
        "triangles",
    ];
    for field in report.as_object().expect("an object").keys() {
        let named = page.contains(&format!("`{field}`"));
        assert!(named || plain.contains(&field.as_str()), "{field}");
    }
}
