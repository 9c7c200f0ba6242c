//! Shards that are read when they are asked for are dropped before the next one: memory does not grow with their number.

use glam::Vec3;
use manylight_film::{FilmError, Metadata, Picture};
use peak_alloc::PeakAlloc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

const SHARDS: usize = 24;
const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
/// Six colours, a depth and a count of samples.
const BYTES_PER_PIXEL: usize = 6 * 12 + 8;

#[test]
fn many_shards_are_merged_in_the_memory_of_a_few() {
    let folder = tempfile::tempdir().expect("a folder");
    let paths: Vec<_> = (0..SHARDS)
        .map(|k| folder.path().join(format!("{k}.exr")))
        .collect();
    for (k, path) in paths.iter().enumerate() {
        let mut shard = Picture::new(WIDTH, HEIGHT);
        for i in (k..shard.samples.len()).step_by(SHARDS) {
            shard.radiance[i] = Vec3::splat(i as f32);
            shard.samples[i] = 1;
        }
        shard
            .write_exr(path, &Metadata::default())
            .expect("a shard can be written");
    }
    MEMORY.reset_peak_usage();
    let before = MEMORY.current_usage();
    let parts = paths.iter().map(|path| {
        let (picture, _) = Picture::read_exr(path)?;
        Ok::<_, FilmError>((path.display().to_string(), picture))
    });
    let whole = Picture::merge(parts).expect("the shards fit together");
    let peak = MEMORY.peak_usage() - before;
    assert!(
        (0..whole.radiance.len()).all(|i| whole.radiance[i].x == i as f32),
        "a pixel is not its shard's"
    );
    // The whole, a shard, and the file that becomes it; with a margin.
    let most = 6 * BYTES_PER_PIXEL * (WIDTH * HEIGHT) as usize;
    assert!(peak < most, "{peak} bytes; expected less than {most}");
}
