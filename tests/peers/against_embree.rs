//! Rates of rays as ratios of Embree's single-ray rates, on the same rays in the same run.
//!
//!     pip install embreex      # holds Embree 4, in embreex.libs; no part of the tests
//!     cargo run --release -p manylight-scene --example against_embree -- PATH/libembree4.so SCENE.ron ...
//!
//! Rays are those of a render (`rays.rs`). Cut-outs are taken as solid, which is all that Embree knows. One thread,
//! its own CPU time, the contestants by turns; the median of the rounds is printed.

#![allow(
    unsafe_code,
    clippy::print_stdout,
    reason = "a C library is called, and figures are what this program is for"
)]

mod rays;

use std::ffi::{c_char, c_void};
use std::hint::black_box;
use std::path::Path;
use std::ptr;
use std::time::Duration;

use libloading::Library;
use manylight_scene::trace::{OcclusionScratch, Ray, Tracer};
use manylight_scene::{Scene, load};
use rays::{Rays, rays_of};
use rustix::time::{ClockId, clock_gettime};

/// Rays that are handed to the queue together, as a render does.
const BATCH: usize = 1024;
const ROUNDS: usize = 9;

type Handle = *mut c_void;

/// `RTCRay` of Embree 4.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
struct EmbreeRay {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
}

/// `RTCRayHit` of Embree 4.
#[repr(C, align(16))]
struct EmbreeRayHit {
    ray: EmbreeRay,
    normal: [f32; 3],
    uv: [f32; 2],
    primitive: u32,
    geometry: u32,
    /// What later versions add ends within these.
    instances: [u32; 5],
}

const NO_GEOMETRY: u32 = u32::MAX;

impl EmbreeRay {
    fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin.to_array(),
            near: 0.0,
            direction: ray.direction.to_array(),
            time: 0.0,
            far: ray.t_max,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        }
    }
}

/// The scene as Embree holds it; it lives as long as the program.
struct Embree {
    scene: Handle,
    occluded: unsafe extern "C" fn(Handle, *mut EmbreeRay, *mut c_void),
    intersect: unsafe extern "C" fn(Handle, *mut EmbreeRayHit, *mut c_void),
}

impl Embree {
    /// Builds `scene` in Embree's best quality.
    fn build(library: &'static Library, scene: &Scene) -> Self {
        // SAFETY: names, signatures and constants are those of Embree 4's rtcore headers; buffers are filled within
        // the sizes that were asked for.
        unsafe {
            macro_rules! function {
                ($name:literal, $type:ty) => {
                    *library
                        .get::<$type>(concat!($name, "\0").as_bytes())
                        .unwrap_or_else(|e| panic!("{}: {e}", $name))
                };
            }
            let new_device = function!(
                "rtcNewDevice",
                unsafe extern "C" fn(*const c_char) -> Handle
            );
            let new_scene = function!("rtcNewScene", unsafe extern "C" fn(Handle) -> Handle);
            let quality = function!("rtcSetSceneBuildQuality", unsafe extern "C" fn(Handle, u32));
            let new_geometry = function!(
                "rtcNewGeometry",
                unsafe extern "C" fn(Handle, u32) -> Handle
            );
            let new_buffer = function!(
                "rtcSetNewGeometryBuffer",
                unsafe extern "C" fn(Handle, u32, u32, u32, usize, usize) -> *mut c_void
            );
            let commit_geometry = function!("rtcCommitGeometry", unsafe extern "C" fn(Handle));
            let attach = function!(
                "rtcAttachGeometry",
                unsafe extern "C" fn(Handle, Handle) -> u32
            );
            let commit_scene = function!("rtcCommitScene", unsafe extern "C" fn(Handle));
            const BEST: u32 = 2;
            const TRIANGLES: u32 = 0;
            const INDEX: u32 = 0;
            const VERTEX: u32 = 1;
            const UINT3: u32 = 0x5003;
            const FLOAT3: u32 = 0x9003;

            let device = new_device(c"threads=1".as_ptr());
            let handle = new_scene(device);
            quality(handle, BEST);
            let geometry = new_geometry(device, TRIANGLES);
            let (positions, indices) = (&scene.mesh.positions, &scene.mesh.indices);
            let vertices = new_buffer(geometry, VERTEX, 0, FLOAT3, 12, positions.len());
            ptr::copy_nonoverlapping(positions.as_ptr(), vertices.cast(), positions.len());
            let corners = new_buffer(geometry, INDEX, 0, UINT3, 12, indices.len());
            ptr::copy_nonoverlapping(indices.as_ptr(), corners.cast(), indices.len());
            commit_geometry(geometry);
            attach(handle, geometry);
            commit_scene(handle);
            Self {
                scene: handle,
                occluded: function!(
                    "rtcOccluded1",
                    unsafe extern "C" fn(Handle, *mut EmbreeRay, *mut c_void)
                ),
                intersect: function!(
                    "rtcIntersect1",
                    unsafe extern "C" fn(Handle, *mut EmbreeRayHit, *mut c_void)
                ),
            }
        }
    }

    fn is_occluded(&self, ray: &Ray) -> bool {
        let mut query = EmbreeRay::new(ray);
        // SAFETY: the scene was committed, the ray is laid out as the function expects.
        unsafe { (self.occluded)(self.scene, &mut query, ptr::null_mut()) };
        query.far < 0.0
    }

    fn closest(&self, ray: &Ray) -> Option<(f32, u32)> {
        let mut query = EmbreeRayHit {
            ray: EmbreeRay::new(ray),
            normal: [0.0; 3],
            uv: [0.0; 2],
            primitive: 0,
            geometry: NO_GEOMETRY,
            instances: [NO_GEOMETRY; 5],
        };
        // SAFETY: as above.
        unsafe { (self.intersect)(self.scene, &mut query, ptr::null_mut()) };
        (query.geometry != NO_GEOMETRY).then_some((query.ray.far, query.primitive))
    }
}

/// CPU time of this thread that `work` takes, in seconds.
fn seconds(work: impl FnOnce()) -> f64 {
    let now = || Duration::try_from(clock_gettime(ClockId::ThreadCPUTime)).expect("not negative");
    let before = now();
    work();
    (now() - before).as_secs_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let (Some(library), scenes) = (arguments.next(), arguments.collect::<Vec<_>>()) else {
        panic!("usage: against_embree LIBRARY SCENE.ron ...");
    };
    // SAFETY: the library is what the user says it is: Embree, which may be loaded at any time.
    let library = unsafe { Library::new(&library) }.unwrap_or_else(|e| panic!("{library}: {e}"));
    let library: &'static Library = Box::leak(Box::new(library));
    println!(
        "scene, triangles, occluded, Embree any-hit Mray/s, queued / Embree, single / Embree, any-hit agreement, \
         Embree closest Mray/s, closest / Embree, closest agreement"
    );
    for path in &scenes {
        let mut scene = load::load(Path::new(path)).unwrap_or_else(|e| panic!("{e}"));
        for material in &mut scene.materials {
            material.opacity = 1.0;
            material.opacity_map = None;
        }
        let tracer = Tracer::build(&scene);
        let embree = Embree::build(library, &scene);
        let Rays { shadow, bounce } = rays_of(&scene, &tracer);

        let mut scratch = OcclusionScratch::default();
        let mut queued = vec![false; shadow.len()];
        let mut alone = vec![false; shadow.len()];
        let mut theirs = vec![false; shadow.len()];
        let mut times = [const { Vec::new() }; 5];
        for _ in 0..ROUNDS {
            times[0].push(seconds(|| {
                for (ray, answer) in shadow.iter().zip(&mut theirs) {
                    *answer = embree.is_occluded(ray);
                }
            }));
            times[1].push(seconds(|| {
                for (rays, answers) in shadow.chunks(BATCH).zip(queued.chunks_mut(BATCH)) {
                    tracer.occluded(rays, answers, &mut scratch);
                }
            }));
            times[2].push(seconds(|| {
                for (ray, answer) in shadow.iter().zip(&mut alone) {
                    *answer = tracer.is_occluded(ray);
                }
            }));
            times[3].push(seconds(|| {
                for ray in &bounce {
                    black_box(embree.closest(ray));
                }
            }));
            times[4].push(seconds(|| {
                for ray in &bounce {
                    black_box(tracer.closest(ray));
                }
            }));
        }
        assert!(queued == alone, "{path}: queued and single rays disagree");
        let ratio = |theirs: usize, ours: usize| {
            median(
                times[theirs]
                    .iter()
                    .zip(&times[ours])
                    .map(|(t, o): (&f64, &f64)| t / o)
                    .collect(),
            )
        };
        let rate = |of: usize, rays: &[Ray]| rays.len() as f64 / 1e6 / median(times[of].clone());
        let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
        let agree = queued.iter().zip(&theirs).filter(|(q, t)| q == t).count();
        // Other triangles are other answers only where they lie at another distance.
        let agree_closest = bounce
            .iter()
            .filter(|ray| match (tracer.closest(ray), embree.closest(ray)) {
                (Some(ours), Some(theirs)) => (ours.t - theirs.0).abs() <= 1e-4 * theirs.0.abs(),
                (ours, theirs) => ours.is_none() && theirs.is_none(),
            })
            .count();
        println!(
            "{path}, {}, {:.3}, {:.2}, {:.2}, {:.2}, {:.6}, {:.2}, {:.2}, {:.6}",
            tracer.triangle_count(),
            share(theirs.iter().filter(|t| **t).count(), shadow.len()),
            rate(0, &shadow),
            ratio(0, 1),
            ratio(0, 2),
            share(agree, shadow.len()),
            rate(3, &bounce),
            ratio(3, 4),
            share(agree_closest, bounce.len()),
        );
    }
}
