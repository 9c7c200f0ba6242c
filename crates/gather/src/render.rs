//! The tile loop.

mod eyes;
mod saved;

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use film::{Picture, PixelStats};
use glam::DVec3;
use rayon::prelude::*;
use sampling::{Purpose, Rng};
use scene::trace::Tracer;
use scene::{Camera, Scene};

use crate::Inputs;
use crate::contribution::VirtualShape;
use crate::counters::{Counters, Phase};
use crate::learned::Learned;
use crate::method::{Method, MethodSpec, Visitor};
use crate::path::Integrator;
use crate::point::GatherPoint;
use crate::shadow_queue::{LightEval, QueueScratch, Seen, ShadowQueue};
use crate::tile_points::{Centre, TILE, TilePoints, is_milestone, next_milestone};

use eyes::Eyes;

/// What is rendered and how, apart from scene and lights.
#[derive(Debug, Clone)]
pub struct RenderSpec {
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// Samples a pixel, at least 1.
    pub spp: u32,
    /// Seed of eye paths and light choices.
    pub seed: u64,
    /// How virtual lights shine.
    pub shape: VirtualShape,
    /// Which light paths are followed.
    pub integrator: Integrator,
    /// Which part of the picture; all of it by default.
    pub shard: Shard,
}

/// Part `index` of `count`, from 0: every `count`-th tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 0, below `count`.
    pub index: u32,
    /// At least 1.
    pub count: u32,
}

impl Shard {
    /// The whole picture.
    pub const ALL: Self = Self { index: 0, count: 1 };
}

impl std::fmt::Display for Shard {
    /// As on the command line, from 1: `2/3`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.count)
    }
}

/// What is watched when nobody wants to stop a render.
static NEVER: AtomicBool = AtomicBool::new(false);

/// Samples a pixel in one pass of a method that takes whole pixels: a tile's gather points are all in memory.
const MOST_AT_ONCE: u32 = 256;

/// A tile of the film.
#[derive(Debug, Clone)]
struct Tile {
    x: u32,
    y: u32,
    width: u32,
    /// Samples a pixel; all of [`Render::done`], or more when a pass was stopped after this tile.
    done: u32,
    pixels: Vec<PixelStats>,
    features: Vec<Features>,
    /// What the method keeps of the tile from pass to pass.
    learned: Learned,
    counters: Counters,
}

/// Sums over a pixel's samples beside their radiance: what the first hit looks like, and which part of the light is direct.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Features {
    albedo: DVec3,
    normal: DVec3,
    depth: f64,
    hits: u32,
    direct: DVec3,
}

/// A pixel's radiance in two parts.
struct Parts {
    direct: DVec3,
    indirect: DVec3,
}

impl Features {
    /// The parts of the mean radiance of `pixel`.
    fn parts(&self, pixel: &PixelStats) -> Parts {
        /// Means and sums round differently: a part below this share of the whole is rounding, and there is none.
        const ROUNDING: f64 = 1e-10;
        let mean = pixel.mean_f64();
        let direct = self.direct / f64::from(pixel.count().max(1));
        let indirect = mean - direct;
        let is_there = indirect.cmpgt(mean * ROUNDING);
        Parts {
            direct: DVec3::select(is_there, direct, mean),
            indirect: DVec3::select(is_there, indirect, DVec3::ZERO),
        }
    }
}

/// A finished pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pass {
    /// Samples a pixel so far.
    pub spp: u32,
    /// Seconds of rendering so far, without what the caller does between passes.
    pub seconds: f64,
}

/// A render under way: passes are made one after the other, each adding samples to every pixel.
///
/// Each sample is a function of (seed, pixel, sample number) alone and pixels are summed in sample order, so
/// that bits depend neither on threads nor on how samples are split into passes.
pub struct Render<'a> {
    scene: &'a Scene,
    tracer: &'a Tracer,
    inputs: &'a Inputs,
    method: &'a MethodSpec,
    spec: RenderSpec,
    camera: Camera,
    tiles: Vec<Tile>,
    done: u32,
    seconds: f64,
    /// Of an earlier run that this one continues.
    before: Counters,
    stop: &'a AtomicBool,
}

impl<'a> Render<'a> {
    /// A render of which nothing is done yet.
    ///
    /// # Panics
    /// When the size or the number of samples is 0, or the shard is out of range.
    pub fn new(
        scene: &'a Scene,
        tracer: &'a Tracer,
        inputs: &'a Inputs,
        method: &'a MethodSpec,
        spec: RenderSpec,
    ) -> Self {
        assert!(
            spec.width > 0 && spec.height > 0 && spec.spp > 0,
            "an empty render: {spec:?}"
        );
        assert!(
            spec.shard.index < spec.shard.count,
            "shard {:?}",
            spec.shard
        );
        let mut tiles = Vec::new();
        let columns = spec.width.div_ceil(TILE);
        for n in 0..columns * spec.height.div_ceil(TILE) {
            // Neighbouring tiles go to different shards, so that all take about equal time.
            if n % spec.shard.count != spec.shard.index {
                continue;
            }
            let (x, y) = (n % columns * TILE, n / columns * TILE);
            let (width, height) = (TILE.min(spec.width - x), TILE.min(spec.height - y));
            let pixels = (width * height) as usize;
            tiles.push(Tile {
                x,
                y,
                width,
                done: 0,
                pixels: vec![PixelStats::default(); pixels],
                features: vec![Features::default(); pixels],
                learned: Learned::default(),
                counters: Counters::default(),
            });
        }
        let camera = Camera::new(&scene.camera, spec.width, spec.height);
        Self {
            scene,
            tracer,
            inputs,
            method,
            spec,
            camera,
            tiles,
            done: 0,
            seconds: 0.0,
            before: Counters::default(),
            stop: &NEVER,
        }
    }

    /// Stops the pass under way, and makes no other, as soon as `flag` is set.
    pub fn stop_on(&mut self, flag: &'a AtomicBool) {
        self.stop = flag;
    }

    /// Makes the next pass and says how far the render is; `None` when all samples are done or it was stopped.
    ///
    /// A pass that is stopped drops the tiles under way and keeps the finished ones: a later pass, perhaps of a
    /// [restored](Render::restored) render, makes up for what is missing.
    ///
    /// `tile_done` is called from many threads after each tile, with the share of the pass that it was.
    pub fn pass(&mut self, tile_done: &(impl Fn(f64) + Sync)) -> Option<Pass> {
        self.pass_of_at_most(u32::MAX, tile_done)
    }

    /// [`Render::pass`] with at most so many samples a pixel, for who has a budget to keep: only a method that
    /// takes whole pixels sees a difference in anything but time.
    pub fn pass_of_at_most(
        &mut self,
        most: u32,
        tile_done: &(impl Fn(f64) + Sync),
    ) -> Option<Pass> {
        let samples = self.next_samples().min(most);
        if samples == 0 {
            return None;
        }
        let until = self.done + samples;
        let started = Instant::now();
        self.method.visit(
            self.inputs,
            PassOf {
                scene: self.scene,
                tracer: self.tracer,
                inputs: self.inputs,
                spec: &self.spec,
                camera: &self.camera,
                tiles: &mut self.tiles,
                until,
                stop: self.stop,
                tile_done,
            },
        );
        self.seconds += started.elapsed().as_secs_f64();
        if self.tiles.iter().any(|tile| tile.done < until) {
            return None;
        }
        self.done = until;
        Some(Pass {
            spp: self.done,
            seconds: self.seconds,
        })
    }

    /// Builds what the method needs, such as a light tree, unless that is there already.
    pub fn prepare(&self) {
        self.method.visit(self.inputs, Preparation);
    }

    /// Samples a pixel that the next pass makes; 0 when the render is done.
    ///
    /// Passes grow from 1 to 16, and end at milestones: a first picture soon, little overhead later.
    /// A method that takes whole pixels gets up to 256 samples of each at once.
    pub fn next_samples(&self) -> u32 {
        let most = if self.method.whole_pixel() {
            MOST_AT_ONCE
        } else {
            next_milestone(self.done) - self.done
        };
        most.min(self.spec.spp - self.done)
    }

    /// Samples a pixel so far.
    pub fn spp(&self) -> u32 {
        self.done
    }

    /// Seconds of rendering so far.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Sums over the tiles, earlier runs of a restored render included.
    pub fn counters(&self) -> Counters {
        let mut all = self.before;
        for tile in &self.tiles {
            all.merge(&tile.counters);
        }
        all
    }

    /// Heap memory in bytes of what the method keeps of the tiles from pass to pass.
    pub fn learned_bytes(&self) -> usize {
        self.tiles.iter().map(|tile| tile.learned.bytes()).sum()
    }

    /// The picture so far; pixels of other shards are empty.
    pub fn picture(&self) -> Picture {
        let mut picture = Picture::new(self.spec.width, self.spec.height);
        for tile in &self.tiles {
            for (i, (pixel, features)) in tile.pixels.iter().zip(&tile.features).enumerate() {
                let (x, y) = (
                    tile.x + i as u32 % tile.width,
                    tile.y + i as u32 / tile.width,
                );
                let at = y as usize * self.spec.width as usize + x as usize;
                picture.radiance[at] = pixel.mean();
                picture.variance[at] = pixel.variance_of_mean();
                picture.samples[at] = pixel.count();
                let parts = features.parts(pixel);
                picture.direct[at] = parts.direct.as_vec3();
                picture.indirect[at] = parts.indirect.as_vec3();
                if tile.done > 0 {
                    picture.albedo[at] = (features.albedo / f64::from(tile.done)).as_vec3();
                    picture.normal[at] = (features.normal / f64::from(tile.done)).as_vec3();
                }
                if features.hits > 0 {
                    picture.depth[at] = (features.depth / f64::from(features.hits)) as f32;
                }
            }
        }
        picture
    }
}

/// Makes a method and drops it: what it shares with later ones stays.
struct Preparation;

impl Visitor for Preparation {
    type Output = ();

    fn visit<'m, M: Method<'m>>(self, _: M) {}
}

/// A pass with the method still to be filled in.
struct PassOf<'a, F> {
    scene: &'a Scene,
    tracer: &'a Tracer,
    inputs: &'a Inputs,
    spec: &'a RenderSpec,
    camera: &'a Camera,
    tiles: &'a mut [Tile],
    /// Samples a pixel that every tile is to have.
    until: u32,
    stop: &'a AtomicBool,
    tile_done: &'a F,
}

/// No block of pixels is taken to reach farther over a surface than this share of its distance.
const FARTHEST: f32 = 0.25;

/// Memory of one thread.
#[derive(Default)]
struct Scratch<S> {
    queue: QueueScratch,
    eyes: Eyes,
    points: Vec<GatherPoint>,
    centres: Vec<Option<Centre>>,
    /// What is seen without a surface that reflects it, by pixel sample.
    seen: Vec<Seen>,
    features: Vec<Features>,
    method: S,
}

impl<F: Fn(f64) + Sync> Visitor for PassOf<'_, F> {
    type Output = ();

    fn visit<'m, M: Method<'m>>(mut self, method: M) {
        let share = 1.0 / self.tiles.len().max(1) as f64;
        let tiles = std::mem::take(&mut self.tiles);
        // As many as threads at a time, taken and given back: what `for_each_init` makes serves one tile each.
        let idle = Mutex::new(Vec::<Scratch<M::Scratch>>::new());
        tiles.par_iter_mut().with_max_len(1).for_each(|tile| {
            let kept = idle.lock().ok().and_then(|mut idle| idle.pop());
            let mut scratch = kept.unwrap_or_default();
            self.tile(&method, tile, &mut scratch);
            if let Ok(mut idle) = idle.lock() {
                idle.push(scratch);
            }
            (self.tile_done)(share);
        });
    }
}

impl<F> PassOf<'_, F> {
    fn tile<'m, M: Method<'m>>(
        &self,
        method: &M,
        tile: &mut Tile,
        scratch: &mut Scratch<M::Scratch>,
    ) {
        // A stopped pass may have left a tile ahead of the others.
        let samples = self.until.saturating_sub(tile.done) as usize;
        if samples == 0 || self.stop.load(Ordering::Relaxed) {
            return;
        }
        let started = Instant::now();
        scratch.points.clear();
        scratch.seen.clear();
        scratch.features.clone_from(&tile.features);
        let bounce_rays = self.eye_paths(tile, M::STRATIFIED, scratch);
        scratch.centres.clear();
        if M::CENTRES {
            self.centres(tile, scratch);
        }
        let eye = started.elapsed();

        let slots = tile.pixels.len() * samples;
        let lights = &self.inputs.lights;
        let mut queue = ShadowQueue::new(
            self.scene,
            lights,
            self.tracer,
            self.spec.shape,
            slots,
            &mut scratch.queue,
        );
        for seen in &scratch.seen {
            queue.add_seen(seen);
        }
        // Every vertex of a path has streams of its own.
        let vertex_stream = |slot: u32, bounce: u32, purpose| {
            let pixel = self.pixel_index(tile, slot as usize / samples);
            let sample = tile.done + slot % samples as u32;
            let number = u64::from(bounce) << 32 | u64::from(sample);
            Rng::new(self.spec.seed, pixel, number, purpose)
        };
        let probe_stream = |number| {
            Rng::new(
                self.spec.seed,
                self.pixel_index(tile, 0),
                number,
                Purpose::Probe,
            )
        };
        let handed = TilePoints {
            points: &scratch.points,
            width: tile.width,
            samples: samples as u32,
            is_milestone: is_milestone(tile.done),
            centres: &scratch.centres,
            probe_stream: &probe_stream(0),
            stream: &vertex_stream,
        };
        let mut learned = tile.learned.clone();
        queue.begin_tile(probe_stream(1));
        method.begin_tile(&handed, &mut queue, &mut learned, &mut scratch.method);
        queue.mark(Phase::Cut);
        queue.give_trials(std::mem::take(&mut learned.trials));
        let pixel_of = |x: &GatherPoint| x.slot as usize / samples;
        // Points that a method is given together.
        let alike = |a: &GatherPoint, b: &GatherPoint| M::WHOLE_PIXEL && pixel_of(a) == pixel_of(b);
        for xs in scratch.points.chunk_by(alike) {
            if self.stop.load(Ordering::Relaxed) {
                return; // nothing of this tile is kept
            }
            let of_vertex = |purpose| vertex_stream(xs[0].slot, xs[0].bounce, purpose);
            let rng = &mut of_vertex(Purpose::Lights);
            queue.begin_points(xs.len(), of_vertex(Purpose::LightSurface));
            match xs {
                [x] => method.point(x, &mut queue, rng, &mut scratch.method),
                xs => method.pixel(xs, &mut queue, rng, &mut scratch.method),
            }
            queue.end_point();
        }
        learned.trials = queue.take_trials();
        let (counters, sums) = queue.finish();
        let pixels = tile.pixels.iter_mut().zip(&mut scratch.features);
        for ((pixel, features), sums) in pixels.zip(sums.chunks_exact(samples)) {
            for sum in sums {
                if pixel.add(sum.radiance.as_vec3()) {
                    // Rounded as the whole is, so that nothing is left of what is all direct.
                    features.direct += sum.direct.as_vec3().as_dvec3();
                } else {
                    tile.counters.nonfinite += 1;
                }
            }
        }
        std::mem::swap(&mut tile.features, &mut scratch.features);
        tile.learned = learned;
        tile.done = self.until;
        tile.counters.merge(&counters);
        tile.counters.camera_rays += slots as u64;
        tile.counters.bounce_rays += bounce_rays;
        tile.counters.nanoseconds[Phase::Eye as usize] += eye.as_nanos() as u64;
    }

    /// Number of the tile's `i`-th pixel in the whole picture.
    fn pixel_index(&self, tile: &Tile, i: usize) -> u64 {
        let (x, y) = (
            tile.x + i as u32 % tile.width,
            tile.y + i as u32 / tile.width,
        );
        u64::from(y) * u64::from(self.spec.width) + u64::from(x)
    }
}

#[cfg(test)]
mod analytic;
#[cfg(test)]
mod compensated;
#[cfg(test)]
mod tests;
