//! Pictures whose brightness is known: by formula, or by another way to the same light.

use std::f32::consts::PI;

use film::FilmError;
use glam::Vec3;
use light_tree::{LightSet, TreeBuilder};
use scene::{CameraSpec, Emitter, Environment, Material, MaterialId, Mesh};
use verify::z_test;

use super::tests::{floor_scene, spec};
use super::*;
use crate::method::StochasticLightcutsSpec;
use crate::method::shining_room::shining_room;

pub(super) const PATH: fn(u32) -> Integrator = |max_bounces| Integrator::Path { max_bounces };

pub(super) fn all_lights() -> MethodSpec {
    MethodSpec::AllLights(Default::default())
}

pub(super) fn stochastic() -> MethodSpec {
    MethodSpec::StochasticLightcuts(StochasticLightcutsSpec::default())
}

/// Mean of a picture's green, with the variance of that mean.
struct Brightness {
    mean: f64,
    variance: f64,
}

/// Renders `size`² pixels under the scene's own lights.
fn brightness(
    scene: &Scene,
    method: &MethodSpec,
    integrator: Integrator,
    size: u32,
    spp: u32,
) -> Brightness {
    brightness_of(
        scene,
        vpl::source_lights(scene),
        method,
        integrator,
        size,
        spp,
    )
}

fn brightness_of(
    scene: &Scene,
    lights: LightSet,
    method: &MethodSpec,
    integrator: Integrator,
    size: u32,
    spp: u32,
) -> Brightness {
    let tracer = Tracer::build(scene);
    let inputs = Inputs::new(lights, TreeBuilder::Binned);
    let spec = RenderSpec {
        width: size,
        height: size,
        spp,
        integrator,
        ..spec()
    };
    let mut render = Render::new(scene, &tracer, &inputs, method, spec);
    while render.pass(&|_| ()).is_some() {}
    assert_eq!(render.counters().nonfinite, 0, "{}", method.name());
    let picture = render.picture();
    let pixels = f64::from(size * size);
    let sum = |values: &[Vec3]| values.iter().map(|c| f64::from(c.y)).sum::<f64>();
    Brightness {
        mean: sum(&picture.radiance) / pixels,
        variance: sum(&picture.variance) / (pixels * pixels),
    }
}

/// Within 4.5 sigma (false alarm 7e-6 each), `slack` of the value apart, and sharp enough to say something.
#[track_caller]
fn assert_is(what: &str, found: &Brightness, exact: f64, slack: f64) {
    let off = (found.mean - exact).abs() - slack * exact;
    let deviation = found.variance.sqrt();
    assert!(
        off < 4.5 * deviation + 1e-6 * exact && deviation < 0.02 * exact,
        "{what}: {} ± {deviation} instead of {exact}",
        found.mean
    );
}

/// Triangles of one material.
fn mesh(positions: Vec<Vec3>, indices: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        positions,
        materials: vec![MaterialId(0); indices.len()],
        indices,
        ..Mesh::default()
    }
}

fn matte(reflectance: f32) -> Material {
    Material {
        diffuse: Vec3::splat(reflectance),
        ..Material::default()
    }
}

/// A closed cube of side 2 about the origin, seen from inside.
pub(super) fn cube(reflectance: f32) -> Scene {
    let corner = |i: u32| {
        let c = |bit: u32| if i & bit != 0 { 1.0 } else { -1.0 };
        Vec3::new(c(1), c(2), c(4))
    };
    let quads = [
        [0, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
    ];
    let halves = |q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]];
    Scene {
        mesh: mesh(
            (0..8).map(corner).collect(),
            quads.iter().flat_map(halves).collect(),
        ),
        materials: vec![matte(reflectance)],
        camera: CameraSpec {
            origin: Vec3::new(-0.7, 0.2, 0.6),
            target: Vec3::new(0.5, -0.3, -0.4),
            fov_y_deg: 80.0,
            ..CameraSpec::default()
        },
        ..Scene::default()
    }
}

/// An octahedron whose faces were `times` divided into four, its corners moved to distance `radius` from `centre`.
pub(super) fn sphere(centre: Vec3, radius: f32, times: u32) -> Mesh {
    let axes = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y];
    let mut faces = Vec::new();
    for pole in [Vec3::Z, Vec3::NEG_Z] {
        for i in 0..4 {
            faces.push([axes[i], axes[(i + 1) % 4], pole]);
        }
    }
    for _ in 0..times {
        let quarters = |[a, b, c]: [Vec3; 3]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(Vec3::normalize);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        faces = faces.into_iter().flat_map(quarters).collect();
    }
    let positions = faces.iter().flatten().map(|p| centre + *p * radius);
    let indices = (0..faces.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    mesh(positions.collect(), indices.collect())
}

/// Makes lights of the triangles from number `first` on.
fn light_up(scene: &mut Scene, first: usize, radiance: f32) {
    let material = MaterialId(scene.materials.len() as u32);
    scene.materials.push(Material {
        emission: Vec3::splat(radiance),
        ..scene.materials[0].clone()
    });
    let triangles = scene.mesh.len();
    scene.emissive = (0..triangles).map(|t| t >= first).collect();
    for t in first..triangles {
        scene.mesh.materials[t] = material;
        scene.emitters.push(Emitter::Triangle {
            triangle: t as u32,
            radiance: Vec3::splat(radiance),
            peak: 1.0,
        });
    }
}

/// A large floor, of which the camera sees next to nothing but the origin.
fn floor_at_origin() -> Scene {
    let floor = floor_scene();
    Scene {
        camera: CameraSpec {
            fov_y_deg: 0.5,
            ..floor.camera
        },
        ..floor
    }
}

/// Adds triangles to a scene.
pub(super) fn add(scene: &mut Scene, more: Mesh) -> usize {
    let mesh = &mut scene.mesh;
    let (first, vertex) = (mesh.len(), mesh.positions.len() as u32);
    mesh.positions.extend(more.positions);
    mesh.indices
        .extend(more.indices.iter().map(|t| t.map(|i| i + vertex)));
    mesh.materials.extend(more.materials);
    first
}

#[test]
fn a_lamp_in_a_closed_sphere_lights_it_as_the_geometric_series_says() {
    // ρ I / π · Σ ρᵏ over 0..=n bounces in a sphere of radius 1.
    let reflectance = 0.6;
    let mut scene = cube(reflectance);
    scene.mesh = sphere(Vec3::ZERO, 1.0, 4);
    scene.emitters = vec![Emitter::Point {
        position: Vec3::ZERO,
        intensity: Vec3::ONE,
    }];
    for bounces in [0, 1, 6] {
        let series: f32 = (0..=bounces).map(|k| reflectance.powi(k)).sum();
        let exact = f64::from(reflectance / PI * series);
        for method in MethodSpec::all() {
            let found = brightness(&scene, &method, PATH(bounces as u32), 16, 16);
            let what = format!("{}, {bounces} bounces", method.name());
            // The polyhedron is half a percent smaller than the sphere, and points that differ may be taken as alike.
            let slack = match method {
                MethodSpec::Multidimensional(_) => 0.03,
                _ => 6e-3,
            };
            assert_is(&what, &found, exact, slack);
        }
    }
}

#[test]
fn a_room_whose_walls_all_shine_is_as_bright_everywhere() {
    // From every direction L Σ ρᵏ, over light seen directly and 1..=n + 1 reflections.
    let reflectance = 0.7f32;
    let mut scene = cube(reflectance);
    light_up(&mut scene, 0, 2.0);
    for bounces in [0, 3] {
        let series: f32 = (0..=bounces + 1).map(|k| reflectance.powi(k)).sum();
        for method in [all_lights(), stochastic()] {
            let found = brightness(&scene, &method, PATH(bounces as u32), 16, 64);
            let what = format!("{}, {bounces} bounces", method.name());
            assert_is(&what, &found, f64::from(2.0 * series), 0.0);
        }
    }
}

#[test]
fn a_plane_under_a_uniform_sky_reflects_its_share() {
    let mut scene = floor_at_origin();
    scene.environment = Environment::constant(Vec3::splat(3.0));
    for method in MethodSpec::all() {
        for integrator in [Integrator::Direct, PATH(0), PATH(2)] {
            let found = brightness(&scene, &method, integrator, 4, 400);
            let what = format!("{}, {integrator:?}", method.name());
            // Lightcuts may be off by its share.
            let slack = match method {
                MethodSpec::Lightcuts(_) | MethodSpec::Multidimensional(_) => 0.02,
                _ => 0.0,
            };
            assert_is(&what, &found, 1.5, slack);
        }
    }
    scene.camera.target = scene.camera.origin + Vec3::new(0.1, 1.0, 0.2);
    let up = brightness(&scene, &all_lights(), Integrator::Direct, 4, 4);
    assert_eq!((up.mean, up.variance), (3.0, 0.0), "the sky itself");
}

#[test]
fn a_shining_rectangle_has_its_form_factor() {
    let (half, height, radiance) = (0.5f32, 1.2f32, 5.0f32);
    let mut scene = floor_at_origin();
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    let corners = corners.map(|[x, z]| Vec3::new(x, height, z)).to_vec();
    let first = add(&mut scene, mesh(corners, vec![[0, 1, 2], [0, 2, 3]]));
    light_up(&mut scene, first, radiance);
    // Four rectangles with a corner above the point (Howell, "A Catalog of Radiation Heat Transfer Configuration
    // Factors", B-3): both sides are half / height long.
    let a = f64::from(half / height);
    let root = (1.0 + a * a).sqrt();
    let factor = 4.0 * 2.0 * a / root * (a / root).atan() / std::f64::consts::TAU;
    let exact = 0.5 * f64::from(radiance) * factor;
    for method in [all_lights(), stochastic()] {
        for integrator in [Integrator::Direct, PATH(0)] {
            let found = brightness(&scene, &method, integrator, 4, 800);
            assert_is(
                &format!("{} {integrator:?}", method.name()),
                &found,
                exact,
                0.0,
            );
        }
    }
}

#[test]
fn a_shining_sphere_has_its_form_factor() {
    // E = π L (r / d)²: 512 triangles, half of them behind the others.
    let (radius, distance, radiance) = (0.5f32, 1.3f32, 4.0f32);
    let mut scene = floor_at_origin();
    let ball = sphere(Vec3::Y * distance, radius, 3);
    let first = add(&mut scene, ball);
    light_up(&mut scene, first, radiance);
    let exact = f64::from(0.5 * radiance * (radius / distance).powi(2));
    for method in [all_lights(), stochastic()] {
        let found = brightness(&scene, &method, Integrator::Direct, 4, 400);
        // The polyhedron looks 1 % smaller.
        assert_is(method.name(), &found, exact, 0.02);
    }
}

#[test]
fn spots_and_parallel_light_follow_their_formulas() {
    let spot = |cos_inner, cos_outer| Emitter::Spot {
        position: Vec3::new(0.0, 3.0, -4.0),
        // At the origin the angle to the axis has a cosine of 0.6.
        direction: Vec3::NEG_Y,
        intensity: Vec3::splat(7.0),
        cos_inner,
        cos_outer,
    };
    let full = 0.5 / PI * 7.0 * 0.6 / 25.0;
    let parallel = Emitter::Directional {
        direction: Vec3::new(0.6, -0.8, 0.0),
        irradiance: Vec3::splat(2.0),
    };
    for (what, emitter, exact) in [
        ("inside", spot(0.55, 0.3), full),
        ("halfway", spot(0.7, 0.5), full / 2.0),
        ("outside", spot(0.9, 0.65), 0.0),
        ("inside a hard edge", spot(0.59, 0.59), full),
        ("outside a hard edge", spot(0.61, 0.61), 0.0),
        ("parallel", parallel, 0.5 / PI * 2.0 * 0.8),
    ] {
        let mut scene = floor_at_origin();
        scene.emitters = vec![emitter];
        for method in MethodSpec::all() {
            let found = brightness(&scene, &method, Integrator::Direct, 4, 4);
            // The pixels show a few hundredths of the floor.
            let off = (found.mean - f64::from(exact)).abs();
            let what = format!("{what}, {}", method.name());
            assert!(off <= 0.01 * f64::from(exact), "{what}: {}", found.mean);
        }
    }
}

#[test]
fn dividing_lights_between_sampling_and_hits_changes_no_mean() {
    for glossy in [false, true] {
        let mut scene = shining_room(glossy);
        scene.camera = CameraSpec {
            origin: Vec3::new(0.3, 1.5, 3.5),
            target: Vec3::new(0.0, 0.9, 0.0),
            ..CameraSpec::default()
        };
        for method in [all_lights(), stochastic()] {
            let sampled = brightness(&scene, &method, Integrator::Direct, 24, 64);
            let divided = brightness(&scene, &method, PATH(0), 24, 64);
            let variance = sampled.variance + divided.variance;
            let z = z_test(sampled.mean, variance, divided.mean);
            // 4.5 sigma: false alarm 7e-6 each. Half a percent would be seen.
            let sharp = variance.sqrt() < 1e-2 * sampled.mean;
            let (a, b) = (sampled.mean, divided.mean);
            assert!(
                z.abs() < 4.5 && sharp,
                "{}: {a}, {b}, z = {z}",
                method.name()
            );
        }
    }
}

#[test]
fn paths_give_the_same_bits_for_any_number_of_threads_and_shards() {
    let scene = shining_room(true);
    let tracer = Tracer::build(&scene);
    let inputs = Inputs::new(vpl::source_lights(&scene), TreeBuilder::Binned);
    let method = stochastic();
    let picture = |shard, threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("thread pool");
        let spec = RenderSpec {
            integrator: PATH(3),
            shard,
            ..spec()
        };
        pool.install(|| {
            let mut render = Render::new(&scene, &tracer, &inputs, &method, spec);
            while render.pass(&|_| ()).is_some() {}
            (render.picture(), render.counters().bounce_rays)
        })
    };
    let (whole, bounce_rays) = picture(Shard::ALL, 1);
    assert!(bounce_rays > 3000, "paths go on: {bounce_rays} rays");
    assert!(picture(Shard::ALL, 3).0 == whole, "three threads differ");
    let shards = (0..2).map(|index| {
        let shard = Shard { index, count: 2 };
        Ok::<_, FilmError>((index.to_string(), picture(shard, 2).0))
    });
    let merged = Picture::merge(shards).expect("two disjoint shards");
    assert!(merged == whole, "merged shards differ");
}

#[test]
fn virtual_lights_and_paths_find_the_same_light_in_a_closed_room() {
    let mut scene = cube(0.6);
    add(&mut scene, sphere(Vec3::new(0.3, -0.5, -0.2), 0.35, 2));
    scene.emitters = vec![Emitter::Point {
        position: Vec3::new(0.2, 0.7, 0.1),
        intensity: Vec3::ONE,
    }];
    let bounces = 4;
    let mut lights = vpl::source_lights(&scene);
    let tracer = Tracer::build(&scene);
    let traced = vpl::VirtualLightSpec {
        count: 6000,
        max_bounces: bounces,
        keep_bounces: false,
        seed: 3,
    };
    vpl::trace(&scene, &tracer, &traced, &mut lights);
    lights.set_radius(0.05);
    let virtually = brightness_of(&scene, lights, &all_lights(), Integrator::Direct, 16, 1);
    let walked = brightness(&scene, &all_lights(), PATH(bounces), 32, 64);
    let ratio = virtually.mean / walked.mean;
    // 6000 lights of about the same power, which all pixels share: their sum has a deviation below 1 %.
    assert!(
        (ratio - 1.0).abs() < 0.02,
        "virtual lights over paths: {ratio}"
    );
}
