//! Extracts of real pictures: tiles, and the lights that their points see.

use std::cell::OnceCell;

use light_tree::{LightSet, TreeBuilder};
use manylight_gather::{GatherPoint, Inputs};
use sampling::{Purpose, Rng};
use scene::load::load;
use scene::trace::{Ray, Tracer};
use scene::{Brdf, Camera, Scene};
use vpl::{VirtualLightSpec, set_local_radii, source_lights, trace};

use crate::scenes::Place;

const WIDTH: u32 = 960;
const HEIGHT: u32 = 540;
/// Tiles in a row of the extract, and rows.
const TILES: [u32; 2] = [6, 4];
/// Pixels along the edge of a tile.
const EDGE: u32 = 16;
/// Points of a tile that a shared cut is made for: one in so many.
pub(crate) const POINTS_PER_PILOT: usize = 16;
/// Virtual lights, of scenes that are lit by them.
const VIRTUAL_LIGHTS: usize = 1_000_000;

/// A scene as its run file in `configs/` has it; what a filter on the command line leaves out is not made.
pub(crate) struct View {
    pub(crate) place: Place,
    scene: OnceCell<(Scene, Tracer)>,
    inputs: OnceCell<Inputs>,
}

impl View {
    pub(crate) fn of(place: Place) -> Self {
        Self {
            place,
            scene: OnceCell::new(),
            inputs: OnceCell::new(),
        }
    }

    pub(crate) fn scene(&self) -> &(Scene, Tracer) {
        self.scene.get_or_init(|| {
            let scene = load(&self.place.path).unwrap_or_else(|e| panic!("{e}"));
            let tracer = Tracer::build(&scene);
            (scene, tracer)
        })
    }

    /// A million virtual lights in the churches, the lamps elsewhere.
    pub(crate) fn inputs(&self) -> &Inputs {
        self.inputs.get_or_init(|| {
            let (scene, tracer) = self.scene();
            let mut lights = source_lights(scene);
            if ["nave", "sibenik"].contains(&self.place.name) {
                add_virtual_lights(scene, tracer, &mut lights);
            }
            Inputs::new(lights, TreeBuilder::Binned)
        })
    }

    /// What is seen in tiles all over the picture, tile by tile; with `brdf` in place of what reflects there.
    pub(crate) fn tiles(&self, brdf: Option<Brdf>) -> Vec<Vec<GatherPoint>> {
        let [columns, rows] = TILES;
        let tiles = (0..columns * rows).map(|i| {
            let column = (i % columns * 2 + 1) * WIDTH / (2 * columns);
            let row = (i / columns * 2 + 1) * HEIGHT / (2 * rows);
            self.tile(column, row, brdf)
        });
        tiles.filter(|tile| !tile.is_empty()).collect()
    }

    fn tile(&self, column: u32, row: u32, brdf: Option<Brdf>) -> Vec<GatherPoint> {
        let (scene, tracer) = self.scene();
        let camera = Camera::new(&scene.camera, WIDTH, HEIGHT);
        let mut rng = Rng::new(1, u64::from(column), u64::from(row), Purpose::Eye);
        let seen = |pixel: u32| {
            let (x, y) = (column + pixel % EDGE, row + pixel / EDGE);
            let ray = Ray {
                origin: camera.origin(),
                direction: camera.direction(x as f32 + rng.f32(), y as f32 + rng.f32()),
                t_max: f32::INFINITY,
            };
            let mut surface = scene.surface(&tracer.closest(&ray)?, ray.direction);
            surface.brdf = brdf.unwrap_or(surface.brdf);
            Some(GatherPoint::new(
                &surface,
                -ray.direction,
                glam::Vec3::ONE,
                0,
            ))
        };
        (0..EDGE * EDGE).filter_map(seen).collect()
    }
}

fn add_virtual_lights(scene: &Scene, tracer: &Tracer, lights: &mut LightSet) {
    let spec = VirtualLightSpec {
        count: VIRTUAL_LIGHTS,
        max_bounces: 8,
        keep_bounces: false,
        seed: 1,
    };
    trace(scene, tracer, &spec, lights);
    set_local_radii(lights);
}
