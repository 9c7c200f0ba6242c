//! What is seen from the camera: where every pixel sample begins.

use glam::Vec3;
use sampling::{Purpose, Rng, Sequence};
use scene::trace::{Hit, NearestScratch, Ray};

use super::{FARTHEST, PassOf, Scratch, Tile};
use crate::compensation::Compensation;
use crate::path::{Integrator, Walk, seen};
use crate::point::GatherPoint;
use crate::shadow_queue::Seen;
use crate::tile_points::{Centre, block, block_edges};

/// Rays that are traced together: enough to keep the tracer's lanes full, few enough to stay in the nearest cache.
const TOGETHER: usize = 1024;

/// Rays from the camera, and what they meet.
#[derive(Debug, Default)]
pub(super) struct Eyes {
    /// One a ray, of those of pixel samples.
    paths: Vec<EyePath>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    tracing: NearestScratch,
}

/// Where an eye path starts.
#[derive(Debug)]
struct EyePath {
    /// Number of the pixel in the tile.
    pixel: usize,
    sample: u32,
    sequence: Sequence,
    slot: u32,
    /// What it goes on by.
    rng: Rng,
}

impl<F> PassOf<'_, F> {
    /// Follows the eye paths of a tile's next samples, and leaves their gather points and what they see of lights. Returns the
    /// number of rays behind the first of each. Samples are `stratified` over the pixel, or anywhere.
    pub(super) fn eye_paths<S>(
        &self,
        tile: &Tile,
        is_stratified: bool,
        scratch: &mut Scratch<S>,
    ) -> u64 {
        let samples = self.until - tile.done;
        let mut bounce_rays = 0;
        for pixel in 0..tile.pixels.len() {
            let number = self.pixel_index(tile, pixel);
            let sequence = Sequence(Rng::new(self.spec.seed, number, 0, Purpose::Sequence).u32());
            for sample in tile.done..self.until {
                let mut rng = Rng::new(self.spec.seed, number, u64::from(sample), Purpose::Eye);
                let place = [0, 1].map(|dimension| match is_stratified {
                    true => sequence.f32(sample, dimension),
                    false => rng.f32(),
                });
                scratch.eyes.rays.push(self.camera_ray(tile, pixel, place));
                scratch.eyes.paths.push(EyePath {
                    pixel,
                    sample,
                    sequence,
                    slot: pixel as u32 * samples + sample - tile.done,
                    rng,
                });
                if scratch.eyes.rays.len() == TOGETHER {
                    bounce_rays += self.follow(tile, scratch);
                }
            }
        }
        bounce_rays + self.follow(tile, scratch)
    }

    /// Through a place in the tile's `i`-th pixel, each coordinate in [0, 1].
    fn camera_ray(&self, tile: &Tile, i: usize, [dx, dy]: [f32; 2]) -> Ray {
        let (x, y) = (
            tile.x + i as u32 % tile.width,
            tile.y + i as u32 / tile.width,
        );
        Ray {
            origin: self.camera.origin(),
            direction: self.camera.direction(x as f32 + dx, y as f32 + dy),
            t_max: f32::INFINITY,
        }
    }

    /// Follows the eye paths that have begun.
    fn follow<S>(&self, tile: &Tile, scratch: &mut Scratch<S>) -> u64 {
        self.trace(&mut scratch.eyes);
        let mut paths = std::mem::take(&mut scratch.eyes.paths);
        let mut bounce_rays = 0;
        for (i, path) in paths.drain(..).enumerate() {
            self.scene.expect(&scratch.eyes.hits[i..]);
            let (direction, hit) = (scratch.eyes.rays[i].direction, scratch.eyes.hits[i]);
            bounce_rays += self.go_on(tile, path, direction, hit, scratch);
        }
        scratch.eyes.paths = paths;
        scratch.eyes.rays.clear();
        bounce_rays
    }

    fn trace(&self, eyes: &mut Eyes) {
        eyes.hits.resize(eyes.rays.len(), None);
        self.tracer
            .nearest(&eyes.rays, &mut eyes.hits, &mut eyes.tracing);
    }

    /// Follows an eye path from its first hit on. Returns the number of rays behind the first.
    fn go_on<S>(
        &self,
        tile: &Tile,
        path: EyePath,
        direction: Vec3,
        hit: Option<Hit>,
        scratch: &mut Scratch<S>,
    ) -> u64 {
        let EyePath {
            pixel,
            sample,
            sequence,
            slot,
            mut rng,
        } = path;
        if self.scene.has_visible_lights() {
            let radiance = seen(self.scene, direction, hit.as_ref());
            if radiance != Vec3::ZERO {
                scratch.seen.push(Seen {
                    slot,
                    radiance,
                    is_direct: true,
                });
            }
        }
        let Some(hit) = hit else {
            return 0;
        };
        let surface = self.scene.surface(&hit, direction);
        let features = &mut scratch.features[pixel];
        features.albedo += surface.brdf.albedo(surface.ns.dot(-direction)).as_dvec3();
        features.normal += surface.ns.as_dvec3();
        features.depth += f64::from(hit.t);
        features.hits += 1;
        let first = GatherPoint {
            block: block(pixel as u32 % tile.width, pixel as u32 / tile.width),
            sample,
            sequence,
            ..GatherPoint::new(&surface, -direction, Vec3::ONE, slot)
        };
        match self.spec.integrator {
            Integrator::Direct => {
                scratch.points.push(first);
                0
            }
            Integrator::Path { max_bounces } => {
                let walk = Walk {
                    scene: self.scene,
                    tracer: self.tracer,
                    max_bounces,
                };
                walk.follow(first, &mut rng, &mut scratch.points, &mut scratch.seen)
            }
            Integrator::Compensated { max_bounces } => {
                let compensation = Compensation {
                    scene: self.scene,
                    tracer: self.tracer,
                    clamp: self.spec.shape.clamp(),
                    max_bounces,
                };
                compensation.follow(first, &mut rng, &mut scratch.points)
            }
        }
    }

    /// Finds what is seen at the centres of the tile's pixels.
    pub(super) fn centres<S>(&self, tile: &Tile, scratch: &mut Scratch<S>) {
        let Scratch { eyes, centres, .. } = scratch;
        let rays = (0..tile.pixels.len()).map(|i| self.camera_ray(tile, i, [0.5, 0.5]));
        eyes.rays.extend(rays);
        self.trace(eyes);
        centres.extend(eyes.rays.iter().enumerate().map(|(i, ray)| {
            self.scene.expect(&eyes.hits[i..]);
            Some(self.centre(tile, i, ray, eyes.hits[i].as_ref()?))
        }));
        eyes.rays.clear();
    }

    /// What `ray` through the centre of the tile's `i`-th pixel meets.
    fn centre(&self, tile: &Tile, i: usize, ray: &Ray, hit: &Hit) -> Centre {
        let (column, row) = (i as u32 % tile.width, i as u32 / tile.width);
        let surface = self.scene.surface(hit, ray.direction);
        let point = GatherPoint {
            block: block(column, row),
            ..GatherPoint::new(&surface, -ray.direction, Vec3::ONE, 0)
        };
        // Where the corners of the block lie on the plane; what is seen at a grazing angle ends before.
        let most = FARTHEST * hit.t;
        let height = (ray.origin - point.position).dot(point.ng);
        let mut reach = 0.0f32;
        for x in block_edges(column) {
            for y in block_edges(row) {
                let (x, y) = (tile.x as f32 + x as f32, tile.y as f32 + y as f32);
                let direction = self.camera.direction(x, y);
                let down = -direction.dot(point.ng);
                let corner = ray.origin + direction * (height / down);
                let away = corner.distance(point.position);
                reach = reach.max(if down > 0.0 { away } else { most });
            }
        }
        Centre {
            point,
            reach: reach.min(most),
            is_pilot: column % 4 == 2 && row % 4 == 2,
        }
    }
}
