//! Damaged pictures: each is read or refused, in little time and memory, as a shard to merge and as a reference.

use glam::Vec3;
use manylight_film::{FilmError, Metadata, Picture, read_image};
use peak_alloc::PeakAlloc;
use verify::{Fuzz, Outcome};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// What a damaged file of a few thousand bytes may make its reader take: what headers may always claim, and half as
/// much for what it becomes.
const MOST_BYTES: usize = 400 << 20;

/// The pixels of every second row.
fn shard(odd: usize) -> Picture {
    let mut picture = Picture::new(7, 20);
    for at in (0..140).filter(|at| at / 7 % 2 == odd) {
        picture.radiance[at] = Vec3::new(at as f32, 0.5, 1e-20);
        picture.variance[at] = Vec3::splat(1e-3);
        picture.depth[at] = 3.0;
        picture.samples[at] = 4;
    }
    picture
}

/// Tries `inputs` pictures.
fn fuzz(inputs: u64) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    let metadata = Metadata {
        texts: vec![("seed".to_owned(), "1".to_owned())],
        camera: None,
    };
    shard(0).write_exr(&path, &metadata).expect("writes");
    let seed = std::fs::read(&path).expect("reads");
    let other = ("other".to_owned(), shard(1));
    let peak = || {
        let peak = MEMORY.peak_usage();
        MEMORY.reset_peak_usage();
        peak
    };
    let fuzz = Fuzz {
        name: "exr",
        seeds: vec![seed],
        words: &[
            "channels",
            "\x08",
            "tiles",
            "deepscanline",
            "R\x00",
            "dataWindow",
        ],
        repair: |_| (),
        peak: &peak,
        most_bytes: MOST_BYTES,
    };
    fuzz.run(inputs, |bytes| {
        std::fs::write(&path, bytes).expect("writes");
        let image = read_image(&path).is_ok();
        let Ok((picture, _)) = Picture::read_exr(&path) else {
            return image;
        };
        let parts = [other.clone(), ("damaged".to_owned(), picture)];
        Picture::merge(parts.map(Ok::<_, FilmError>)).is_ok()
    })
}

#[test]
fn damaged_pictures_are_read_or_refused_in_little_time_and_memory() {
    let outcome = fuzz(500);
    assert!(
        outcome.accepted > 0 && outcome.accepted < 500,
        "{outcome:?}"
    );
}

#[test]
#[ignore = "minutes: tens of thousands of files"]
fn very_many_damaged_pictures_are_read_or_refused() {
    eprintln!("exr: {:?}", fuzz(60_000));
}
