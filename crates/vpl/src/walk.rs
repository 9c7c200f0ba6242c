//! The particles' random walk, and the virtual lights it leaves.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use light_tree::{Gloss, LightSet, VirtualLight};
use rayon::prelude::*;
use sampling::{Purpose, Rng};
use scene::trace::{Hit, NearestScratch, Ray, Tracer};
use scene::{Brdf, Fresnel, Scene};

use crate::emit::Sources;

/// How many virtual lights, and how far light bounces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualLightSpec {
    /// Virtual lights asked for; the number traced differs by chance, at a million by about 0.4 %.
    pub count: usize,
    /// Surfaces that light may meet, that of the last virtual light counted; 1 to 65,535.
    pub max_bounces: u32,
    /// Whether to note of each light how many surfaces that were: [`LightSet::bounces`].
    pub keep_bounces: bool,
    /// Seed of all particle paths.
    pub seed: u64,
}

/// What tracing did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct VirtualLightStats {
    /// Particle paths, which each light's flux is divided by.
    pub paths: u64,
    /// Rays traced, the pilot's included.
    pub rays: u64,
    /// Power that left the sources, W per channel.
    pub source_flux: [f64; 3],
    /// Power that the virtual lights send on, W per channel.
    pub virtual_flux: [f64; 3],
}

/// Longest a path survives by chance alone: the chance to go on is never above this.
const MOST_SURVIVAL: f32 = 0.95;
/// Fewest and most paths that estimate how many lights a path leaves, and lights asked for per such path: few of the
/// rays are theirs, and yet the count is met within 1 %.
const PILOT_PATHS: [u64; 2] = [1 << 12, 1 << 17];
const LIGHTS_PER_PILOT_PATH: u64 = 24;
/// Paths per parallel task: fixed, so that the result does not depend on the number of threads.
const CHUNK: u64 = 1 << 12;
/// Paths that are followed together: enough that few rays are alone when the last of them end, few enough to stay in the
/// cache.
const WAVE: usize = 1 << 10;

/// Traces virtual lights and appends them to `lights`.
///
/// A pilot run fixes the number of paths beforehand: stopping when enough lights are stored would favour
/// paths that leave many. Each light's flux is divided by the number of *paths*, so that the sum over all
/// virtual lights estimates the indirect light.
///
/// Nothing is added when no light has power, `count` is 0, or no path meets a reflecting surface.
///
/// # Panics
/// When bounces are to be kept and `lights` holds virtual lights already.
pub fn trace(
    scene: &Scene,
    tracer: &Tracer,
    spec: &VirtualLightSpec,
    lights: &mut LightSet,
) -> VirtualLightStats {
    let mut stats = VirtualLightStats::default();
    let Some(sources) = Sources::new(scene).filter(|_| spec.count > 0) else {
        return stats;
    };
    let walk = Walk {
        scene,
        tracer,
        sources: &sources,
        spec,
    };
    let [fewest, most] = PILOT_PATHS;
    let pilot_paths = (spec.count as u64 / LIGHTS_PER_PILOT_PATH).clamp(fewest, most);
    let pilot = walk.run(pilot_paths, Purpose::Pilot);
    stats.rays = pilot.iter().map(|part| part.rays).sum();
    let expected: f64 = pilot.iter().map(|part| part.expected).sum();
    if expected == 0.0 {
        return stats;
    }
    let per_path = expected / pilot_paths as f64;
    stats.paths = (spec.count as f64 / per_path).round().max(1.0) as u64;
    let parts = walk.run(stats.paths, Purpose::Particles);
    for part in &parts {
        stats.rays += part.rays;
        for c in 0..3 {
            stats.source_flux[c] += part.source_flux[c];
            stats.virtual_flux[c] += part.virtual_flux[c];
        }
    }
    let (sets, bounces): (Vec<_>, Vec<_>) = parts
        .into_iter()
        .map(|part| (part.lights, part.bounces))
        .unzip();
    lights.append_virtual(&sets);
    if spec.keep_bounces {
        lights.set_bounces(bounces.concat());
    }
    stats
}

struct Walk<'a> {
    scene: &'a Scene,
    tracer: &'a Tracer,
    sources: &'a Sources<'a>,
    spec: &'a VirtualLightSpec,
}

/// What some of the paths left.
#[derive(Default)]
struct Part {
    lights: LightSet,
    /// One a light if they are kept: surfaces met, its own counted.
    bounces: Vec<u16>,
    /// How many lights were to be expected: the chances to leave one, summed. It varies less than their number.
    expected: f64,
    rays: u64,
    source_flux: [f64; 3],
    virtual_flux: [f64; 3],
}

/// Paths that are followed together.
#[derive(Default)]
struct Wave {
    flights: Vec<Flight>,
    /// One a flight.
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    scratch: NearestScratch,
    /// In the order of bounces.
    left: Vec<Left>,
    /// Places in `left`, in the order of paths.
    order: Vec<u32>,
}

/// What a path left.
struct Left {
    /// Which of the wave's paths.
    number: u16,
    /// Surfaces met.
    bounce: u16,
    light: VirtualLight,
}

impl Wave {
    /// What was left, as if the paths had been followed one by one.
    fn by_path(&mut self) -> impl Iterator<Item = &Left> {
        let mut ends = [0u32; WAVE + 1];
        for left in &self.left {
            ends[usize::from(left.number) + 1] += 1;
        }
        for n in 1..ends.len() {
            ends[n] += ends[n - 1];
        }
        self.order.resize(self.left.len(), 0);
        for (left, i) in self.left.iter().zip(0..) {
            let end = &mut ends[usize::from(left.number)];
            self.order[*end as usize] = i;
            *end += 1;
        }
        self.order.iter().map(|&i| &self.left[i as usize])
    }
}

/// A particle under way.
struct Flight {
    /// Which of the wave's paths.
    number: u16,
    flux: Vec3,
    rng: Rng,
}

impl Walk<'_> {
    /// What `paths` paths leave, in parts, in order.
    fn run(&self, paths: u64, purpose: Purpose) -> Vec<Part> {
        (0..paths.div_ceil(CHUNK))
            .into_par_iter()
            .map_init(Wave::default, |wave, chunk| {
                let mut part = Part::default();
                let end = ((chunk + 1) * CHUNK).min(paths);
                for first in (chunk * CHUNK..end).step_by(WAVE) {
                    for path in first..(first + WAVE as u64).min(end) {
                        let rng = Rng::new(self.spec.seed, path, 0, purpose);
                        self.start([path, paths], rng, wave, &mut part);
                    }
                    self.follow(wave, &mut part);
                }
                part
            })
            .collect()
    }

    /// Adds a path of `paths` to the wave.
    fn start(&self, [path, paths]: [u64; 2], mut rng: Rng, wave: &mut Wave, part: &mut Part) {
        // Paths take the lights in turn, each its share: less noise than choosing afresh.
        let u = (path as f64 + rng.f64()) / paths as f64;
        let particle = self.sources.emit(u.min(1.0 - f64::EPSILON), &mut rng);
        let flux = particle.flux / paths as f32;
        for c in 0..3 {
            part.source_flux[c] += f64::from(flux[c]);
        }
        let number = wave.flights.len() as u16;
        wave.flights.push(Flight { number, flux, rng });
        wave.rays.push(Ray {
            origin: particle.origin,
            direction: particle.direction,
            t_max: f32::INFINITY,
        });
    }

    /// Follows the wave's paths bounce by bounce, until none is left: their rays are traced many in flight.
    fn follow(&self, wave: &mut Wave, part: &mut Part) {
        wave.left.clear();
        for bounce in 1..=self.spec.max_bounces {
            part.rays += wave.rays.len() as u64;
            wave.hits.resize(wave.rays.len(), None);
            self.tracer
                .nearest(&wave.rays, &mut wave.hits, &mut wave.scratch);
            let mut flying = 0;
            for i in 0..wave.rays.len() {
                self.scene.expect(&wave.hits[i..]);
                let Some(hit) = &wave.hits[i] else {
                    continue;
                };
                let (flight, ray) = (&mut wave.flights[i], &mut wave.rays[i]);
                let (light, goes_on) = self.bounce(hit, ray, flight, &mut part.expected);
                if let Some(light) = light {
                    wave.left.push(Left {
                        number: flight.number,
                        bounce: bounce as u16,
                        light,
                    });
                }
                if goes_on {
                    wave.flights.swap(i, flying);
                    wave.rays.swap(i, flying);
                    flying += 1;
                }
            }
            wave.flights.truncate(flying);
            wave.rays.truncate(flying);
            if flying == 0 {
                break;
            }
        }
        // Those that have met as many surfaces as they may.
        wave.flights.clear();
        wave.rays.clear();
        for left in wave.by_path() {
            let light = &left.light;
            if part.lights.push_virtual(light) && self.spec.keep_bounces {
                part.bounces.push(left.bounce);
            }
            for c in 0..3 {
                part.virtual_flux[c] += f64::from(light.intensity[c]) * std::f64::consts::PI;
            }
        }
    }

    /// What a particle leaves where it hits a surface, and whether it goes on: `flight` and `ray` are then those of its
    /// way from there. Its chance to leave something is added to `expected`.
    #[inline(always)]
    fn bounce(
        &self,
        hit: &Hit,
        ray: &mut Ray,
        flight: &mut Flight,
        expected: &mut f64,
    ) -> (Option<VirtualLight>, bool) {
        let Flight { flux, rng, .. } = flight;
        let surface = self.scene.surface(hit, ray.direction);
        let wo = -ray.direction;
        let (cos_o, cos_arriving) = (surface.ns.dot(wo), surface.ng.dot(wo));
        if cos_o <= 0.0 || cos_arriving <= 0.0 {
            return (None, false);
        }
        // Particles come and go in proportion to cosines with the geometric normal, where a surface that is seen
        // reflects by those with the shading normal (Veach 1997, §5.3.2). Both are the same on flat triangles.
        let arriving = cos_o / cos_arriving;
        // Absorbing before storing leaves lights of about equal power, which a tree samples best.
        let survival = surface.brdf.albedo(cos_o).max_element().min(MOST_SURVIVAL);
        let albedo = reflectance(&surface.brdf, cos_o);
        let reflects = *flux * albedo != Vec3::ZERO;
        if reflects {
            *expected += f64::from(survival);
        }
        if rng.f32() >= survival {
            return (None, false);
        }
        *flux /= survival;
        let light = reflects.then(|| VirtualLight {
            position: surface.ray_origin(),
            normal: surface.ng,
            intensity: *flux * albedo * (arriving * FRAC_1_PI),
            gloss: surface
                .brdf
                .is_glossy()
                .then(|| gloss(&surface.brdf, [surface.ns, surface.ng], wo)),
        });
        let Some(sample) = surface.brdf.sample(surface.ns, wo, rng) else {
            return (light, false);
        };
        let cos_leaving = sample.wi.dot(surface.ng);
        if cos_leaving <= 0.0 {
            return (light, false);
        }
        let leaving = cos_leaving / sample.wi.dot(surface.ns);
        *flux *= sample.weight * (arriving * leaving);
        ray.origin = surface.ray_origin();
        ray.direction = sample.wi;
        (light, true)
    }
}

/// Share of light under cosine `cos` that `brdf` sends on, per channel. A coat sends a little of every colour in some
/// direction, however dark it is along the normal.
fn reflectance(brdf: &Brdf, cos: f32) -> Vec3 {
    match brdf.fresnel {
        Fresnel::Constant => brdf.albedo(cos),
        Fresnel::Schlick => brdf.albedo(cos).max(Vec3::splat(1e-4)),
    }
}

/// How a surface of reflection `brdf` sends on light that comes from unit `incoming`, above the horizon of its normals: that of
/// shading, and that which light leaves by.
pub fn gloss(brdf: &Brdf, [normal, leaving]: [Vec3; 2], incoming: Vec3) -> Gloss {
    let cos = normal.dot(incoming);
    let reflectance = reflectance(brdf, cos);
    let lobe = brdf.lobe_bound(cos);
    // Without the cosine that the lobe's bound holds for: that of emission is with the geometric normal.
    let per_cosine = if normal == leaving {
        1.0
    } else {
        lobe.per_cosine
    };
    let beyond_matte = (brdf.diffuse_bound(cos) * PI - reflectance).max(Vec3::ZERO);
    let sent = beyond_matte + lobe.value(1.0) * (PI * per_cosine);
    let peak = Vec3::select(
        reflectance.cmpgt(Vec3::ZERO),
        sent / reflectance,
        Vec3::ZERO,
    );
    Gloss {
        incoming,
        normal,
        reflectance,
        diffuse: brdf.diffuse,
        specular: brdf.specular,
        alpha: brdf.alpha,
        is_coat: brdf.fresnel == Fresnel::Schlick,
        peak: peak.max_element(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sampling::Extreme;
    use scene::{Emitter, Environment, Material, MaterialId, Mesh};

    /// A closed cube of side 2 about the origin with reflectance `albedo`, a point light inside.
    fn closed_box(albedo: f32) -> Scene {
        let positions: Vec<Vec3> = (0..8)
            .map(|i| {
                let c = |bit: u32| if i & bit != 0 { 1.0 } else { -1.0 };
                Vec3::new(c(1), c(2), c(4))
            })
            .collect();
        let quads = [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ];
        let indices: Vec<[u32; 3]> = quads
            .iter()
            .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
            .collect();
        Scene {
            mesh: Mesh {
                positions,
                materials: vec![MaterialId(0); indices.len()],
                indices,
                ..Mesh::default()
            },
            materials: vec![Material {
                diffuse: Vec3::splat(albedo),
                ..Material::default()
            }],
            emitters: vec![Emitter::Point {
                position: Vec3::new(0.2, 0.3, -0.1),
                intensity: Vec3::new(1.0, 2.0, 0.5),
            }],
            ..Scene::default()
        }
    }

    fn traced(scene: &Scene, count: usize, max_bounces: u32) -> (LightSet, VirtualLightStats) {
        let tracer = Tracer::build(scene);
        let mut lights = LightSet::default();
        let stats = trace(
            scene,
            &tracer,
            &VirtualLightSpec {
                count,
                max_bounces,
                keep_bounces: false,
                seed: 1,
            },
            &mut lights,
        );
        (lights, stats)
    }

    #[test]
    fn virtual_lights_send_on_what_the_walls_reflect() {
        for albedo in [0.3f64, 0.5, 0.8, 1.0] {
            let (lights, stats) = traced(&closed_box(albedo as f32), 200_000, 8);
            let power = 4.0 * std::f64::consts::PI * 2.0;
            assert!(
                (stats.source_flux[1] / power - 1.0).abs() < 1e-4,
                "sources emit {:?}",
                stats.source_flux
            );
            // Every bounce reflects the share `albedo` of what arrives: a geometric series.
            let exact: f64 = (1..=8).map(|k| power * albedo.powi(k)).sum();
            let ratio = stats.virtual_flux[1] / exact;
            // Survival is decided by chance: over 70,000 paths of a few bounces the sum has a relative
            // deviation below 0.4 %; 4 sigma.
            assert!(
                (ratio - 1.0).abs() < 0.016,
                "albedo {albedo}: ratio {ratio}"
            );
            assert!(lights.len() as f64 > 190_000.0, "{} lights", lights.len());
        }
    }

    /// [`closed_box`] of reflectance ½ with another light; a triangle is number 12.
    fn box_with(emitter: Option<Emitter>, sky: Option<Environment>) -> Scene {
        let mut scene = closed_box(0.5);
        scene.emitters = emitter.into_iter().collect();
        scene.environment = sky;
        if matches!(emitter, Some(Emitter::Triangle { .. })) {
            let first = scene.mesh.positions.len() as u32;
            scene
                .mesh
                .positions
                .extend([Vec3::ZERO, Vec3::X * 0.5, Vec3::Y * 0.5]);
            scene.mesh.indices.push([first, first + 1, first + 2]);
            scene.mesh.materials.push(MaterialId(1));
            scene.materials.push(Material {
                emission: Vec3::splat(3.0),
                ..scene.materials[0].clone()
            });
            scene.emissive = (0..13).map(|t| t == 12).collect();
        }
        scene
    }

    /// What the virtual lights in that box send on of one channel.
    fn sent_on(emitter: Option<Emitter>, sky: Option<Environment>) -> f64 {
        traced(&box_with(emitter, sky), 200_000, 8).1.virtual_flux[1]
    }

    fn spot(cos_inner: f32, cos_outer: f32) -> Emitter {
        Emitter::Spot {
            position: Vec3::new(0.2, 0.3, -0.1),
            direction: Vec3::new(0.6, 0.0, 0.8),
            intensity: Vec3::splat(2.0),
            cos_inner,
            cos_outer,
        }
    }

    const TRIANGLE: Emitter = Emitter::Triangle {
        triangle: 12,
        radiance: Vec3::splat(3.0),
        peak: 1.0,
    };
    const PARALLEL: Emitter = Emitter::Directional {
        direction: Vec3::NEG_Z,
        irradiance: Vec3::splat(1.5),
    };

    #[test]
    fn every_kind_of_light_emits_its_power() {
        let pi = std::f64::consts::PI;
        // Inside, half of what arrives is sent on, eight times over.
        let inside: f64 = (1..=8).map(|k| 0.5f64.powi(k)).sum();
        let sky = Environment::constant(Vec3::ONE);
        for (name, found, power, sent) in [
            (
                "hard spot",
                sent_on(Some(spot(0.5, 0.5)), None),
                2.0 * pi,
                inside * 2.0 * 0.5,
            ),
            // The cubic step has half its width's weight.
            (
                "soft spot",
                sent_on(Some(spot(1.0, 0.5)), None),
                2.0 * pi,
                inside * 2.0 * 0.25,
            ),
            (
                "lamp",
                sent_on(Some(spot(-1.0, -1.0)), None),
                4.0 * pi,
                inside * 2.0,
            ),
            // Both sides of an area of 1/8.
            (
                "triangle",
                sent_on(Some(TRIANGLE), None),
                2.0 * pi * 3.0 / 8.0,
                inside,
            ),
            // From outside a convex body, which sends it away: one face of 4, all faces of 24.
            ("parallel", sent_on(Some(PARALLEL), None), 1.5 * 4.0, 0.5),
            ("sky", sent_on(None, sky), pi * 24.0, 0.5),
        ] {
            let ratio = found / (power * sent);
            // Survival and hits on the body are decided by chance: over 10⁵ paths below 0.5 %; 4 sigma.
            assert!((ratio - 1.0).abs() < 0.02, "{name}: ratio {ratio}");
        }
    }

    #[test]
    fn extreme_random_numbers_leave_finite_lights_of_every_kind_of_source() {
        let point = Emitter::Point {
            position: Vec3::new(0.2, 0.3, -0.1),
            intensity: Vec3::ONE,
        };
        let emitters = [
            point,
            spot(0.5, 0.5),
            spot(1.0, 0.5),
            spot(-1.0, -1.0),
            TRIANGLE,
            PARALLEL,
        ];
        let skies = [Environment::constant(Vec3::ONE)].into_iter();
        let sources = emitters.map(|e| (Some(e), None)).into_iter();
        for (emitter, sky) in sources.chain(skies.map(|sky| (None, sky))) {
            for (alpha, specular) in [(1.0, 0.0), (1e-3, 0.6), (0.3, 0.6), (1.0, 0.6)] {
                let mut scene = box_with(emitter, sky.clone());
                for material in &mut scene.materials {
                    (material.alpha, material.specular) = (alpha, Vec3::splat(specular));
                    material.diffuse = Vec3::splat(0.4);
                }
                let tracer = Tracer::build(&scene);
                let spec = VirtualLightSpec {
                    count: 2,
                    max_bounces: 50,
                    keep_bounces: true,
                    seed: 1,
                };
                let sources = Sources::new(&scene).expect("a light with power");
                let walk = Walk {
                    scene: &scene,
                    tracer: &tracer,
                    sources: &sources,
                    spec: &spec,
                };
                for number in [Extreme::Zero, Extreme::BelowOne] {
                    let (mut wave, mut part) = (Wave::default(), Part::default());
                    for path in 0..2 {
                        walk.start([path, 2], Rng::extreme(number), &mut wave, &mut part);
                    }
                    walk.follow(&mut wave, &mut part);
                    assert!(part.rays <= 100, "{} rays", part.rays);
                    for left in wave.by_path() {
                        let light = &left.light;
                        let told = || format!("{emitter:?}, {number:?}: {light:?}");
                        assert!(light.position.is_finite(), "{}", told());
                        assert!(light.intensity.is_finite(), "{}", told());
                        assert!(light.intensity.min_element() >= 0.0, "{}", told());
                        assert!(light.normal.is_normalized(), "{}", told());
                    }
                    assert!(
                        part.source_flux.iter().all(|f| f.is_finite()),
                        "{emitter:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn lights_stand_in_the_order_of_paths() {
        let scene = closed_box(0.5);
        let tracer = Tracer::build(&scene);
        let spec = VirtualLightSpec {
            count: 1,
            max_bounces: 8,
            keep_bounces: true,
            seed: 1,
        };
        let sources = Sources::new(&scene).expect("a light with power");
        let walk = Walk {
            scene: &scene,
            tracer: &tracer,
            sources: &sources,
            spec: &spec,
        };
        let rng = |path| Rng::new(1, path, 0, Purpose::Particles);
        let (mut wave, mut together) = (Wave::default(), Part::default());
        for path in 0..100 {
            walk.start([path, 100], rng(path), &mut wave, &mut together);
        }
        walk.follow(&mut wave, &mut together);
        let mut one_by_one = Part::default();
        for path in 0..100 {
            walk.start([path, 100], rng(path), &mut wave, &mut one_by_one);
            walk.follow(&mut wave, &mut one_by_one);
        }
        assert!(together.bounces.contains(&4), "long paths");
        assert_eq!(together.bounces, one_by_one.bounces, "bounces");
        assert_eq!(together.rays, one_by_one.rays, "rays");
        let all = |part: &Part| format!("{:?}", part.lights);
        assert_eq!(all(&together), all(&one_by_one), "lights");
    }

    #[test]
    fn the_count_asked_for_is_met_within_one_percent() {
        let (lights, _) = traced(&closed_box(0.6), 300_000, 8);
        let ratio = lights.len() as f64 / 300_000.0;
        assert!((ratio - 1.0).abs() < 0.01, "{} lights", lights.len());
    }

    #[test]
    fn the_lights_are_the_same_for_one_thread_and_three() {
        let scene = closed_box(0.5);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("thread pool");
            let (lights, stats) = pool.install(|| traced(&scene, 20_000, 4));
            let all: Vec<_> = lights.ids().map(|id| lights.virtual_light(id)).collect();
            format!("{stats:?}{all:?}")
        };
        assert!(run(1) == run(3), "lights differ");
    }

    #[test]
    fn black_walls_and_dark_scenes_leave_no_lights() {
        assert!(
            traced(&closed_box(0.0), 1000, 8).0.is_empty(),
            "black walls"
        );
        let dark = Scene {
            emitters: Vec::new(),
            ..closed_box(0.5)
        };
        assert!(traced(&dark, 1000, 8).0.is_empty(), "no light");
        assert!(
            traced(&closed_box(0.5), 0, 8).0.is_empty(),
            "none asked for"
        );
    }

    #[test]
    fn lights_lie_on_the_walls_and_look_inward() {
        let (lights, _) = traced(&closed_box(0.5), 5000, 8);
        for id in lights.ids() {
            let (p, n) = (lights.position(id), lights.axis(id));
            assert!((p.abs().max_element() - 1.0).abs() < 1e-3, "light at {p}");
            assert!(p.dot(n) < 0.0, "light at {p} looks along {n}");
        }
    }
}
