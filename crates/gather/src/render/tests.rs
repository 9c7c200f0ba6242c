//! Determinism, shards, skipped work, and a light over a plane.

use film::FilmError;
use glam::Vec3;
use light_tree::TreeBuilder;

use super::*;
use crate::method::{StochasticLightcutsSpec, StratifiedLightcutsSpec};
use scene::{CameraSpec, Material, MaterialId, Mesh};

pub(super) fn floor_scene() -> Scene {
    let positions = [
        [-5.0, 0.0, -5.0],
        [5.0, 0.0, -5.0],
        [5.0, 0.0, 5.0],
        [-5.0, 0.0, 5.0],
    ]
    .map(Vec3::from)
    .to_vec();
    let camera = CameraSpec {
        origin: Vec3::new(0.0, 2.0, 4.0),
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y_deg: 60.0,
    };
    Scene {
        mesh: Mesh {
            positions,
            indices: vec![[0, 1, 2], [0, 2, 3]],
            materials: vec![MaterialId(0); 2],
            ..Mesh::default()
        },
        materials: vec![Material::default()],
        camera,
        ..Scene::default()
    }
}

pub(super) fn lights(n: u32) -> light_tree::LightSet {
    let mut set = light_tree::LightSet::default();
    let mut rng = Rng::new(1, 0, 0, Purpose::Build);
    for _ in 0..n {
        set.push_point(
            Vec3::new(
                rng.f32() * 6.0 - 3.0,
                1.0 + rng.f32(),
                rng.f32() * 6.0 - 3.0,
            ),
            Vec3::ONE,
        );
    }
    set
}

pub(super) fn spec() -> RenderSpec {
    RenderSpec {
        width: 50,
        height: 37,
        spp: 5,
        seed: 3,
        shape: VirtualShape::Sphere,
        integrator: Integrator::Direct,
        shard: Shard::ALL,
    }
}

/// Stochastic lightcuts with one cut for blocks of so many pixels along an edge.
pub(super) fn sharing(edge: u64) -> MethodSpec {
    MethodSpec::StochasticLightcuts(StochasticLightcutsSpec {
        share: edge.try_into().expect("in range"),
        ..Default::default()
    })
}

fn rendered(spec: RenderSpec, method: &MethodSpec, threads: usize) -> Picture {
    let scene = floor_scene();
    let tracer = Tracer::build(&scene);
    let inputs = Inputs::new(lights(300), TreeBuilder::Binned);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("thread pool");
    pool.install(|| {
        let mut render = Render::new(&scene, &tracer, &inputs, method, spec);
        while render.pass(&|_| ()).is_some() {}
        render.picture()
    })
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for method in [sharing(1), sharing(5), MethodSpec::default()] {
        let one = rendered(spec(), &method, 1);
        assert!(
            one.radiance.iter().any(|c| *c != Vec3::ZERO),
            "there is a picture"
        );
        for threads in [2, 5] {
            assert!(
                rendered(spec(), &method, threads) == one,
                "{threads} threads differ from one with {method:?}"
            );
        }
    }
}

/// The picture of a scene under these lights, and what it needs.
fn lit(
    scene: &Scene,
    lights: light_tree::LightSet,
    method: &MethodSpec,
    integrator: Integrator,
) -> (Picture, Vec<&'static str>) {
    let tracer = Tracer::build(scene);
    let inputs = Inputs::new(lights, TreeBuilder::Binned);
    let spec = RenderSpec {
        integrator,
        ..spec()
    };
    let mut render = Render::new(scene, &tracer, &inputs, method, spec);
    while render.pass(&|_| ()).is_some() {}
    let mut plan = crate::Plan::of(scene, &inputs.lights, inputs.tree_size().is_some());
    if integrator != Integrator::Direct {
        plan.need(crate::BOUNCES);
    }
    assert_eq!(
        tracer.has_cutouts(),
        plan.needs().contains(&"cut-outs"),
        "what rays ask"
    );
    (render.picture(), plan.needs())
}

/// Checks that what `forced` asks for beyond a plain floor under `plain` lights is `names`, and changes no bit.
fn assert_same_with(
    names: &[&str],
    method: &MethodSpec,
    plain: impl Fn() -> light_tree::LightSet,
    forced: (&Scene, light_tree::LightSet, Integrator),
) {
    let direct = Integrator::Direct;
    let (skipped, few) = lit(&floor_scene(), plain(), method, direct);
    let (scene, lights, integrator) = forced;
    let (paid, many) = lit(scene, lights, method, integrator);
    let added: Vec<_> = many.iter().filter(|name| !few.contains(name)).collect();
    assert!(added.into_iter().eq(names), "{few:?} became {many:?}");
    assert!(skipped == paid, "{names:?} with {method:?}");
}

#[test]
fn what_a_scene_lacks_is_skipped_without_changing_a_bit() {
    let direct = Integrator::Direct;
    // The same surfaces by way of an opacity map without holes, a white texture and stored normals.
    let mut dressed = floor_scene();
    let texels = vec![[255; 4]; 4];
    let path = "white".into();
    dressed.textures.push(scene::Texture {
        path,
        width: 2,
        height: 2,
        texels,
        has_alpha: true,
    });
    dressed.materials[0].opacity_map = Some(scene::TextureId(0));
    dressed.materials[0].diffuse_map = Some(scene::TextureId(0));
    dressed.mesh.uvs = vec![
        glam::Vec2::ZERO,
        glam::Vec2::X,
        glam::Vec2::ONE,
        glam::Vec2::Y,
    ];
    dressed.mesh.uv_indices = dressed.mesh.indices.clone();
    dressed.mesh.normals = vec![Vec3::Y];
    dressed.mesh.normal_indices = vec![[0; 3]; 2];
    // Gloss that is lost in rounding.
    let mut glossy = floor_scene();
    glossy.materials[0].specular = Vec3::splat(1e-30);
    let floor = floor_scene();
    for method in [sharing(1), MethodSpec::default()] {
        let plain = || lights(300);
        let names = ["smooth normals", "textures", "cut-outs"];
        assert_same_with(&names, &method, plain, (&dressed, plain(), direct));
        let names = ["glossy surfaces"];
        assert_same_with(&names, &method, plain, (&glossy, plain(), direct));
        // Paths go on from a floor and meet nothing.
        let path = Integrator::Path { max_bounces: 5 };
        let names = ["eye paths that bounce"];
        assert_same_with(&names, &method, plain, (&floor, plain(), path));
    }
    // Points that are spots with cones of every direction.
    let mut spots = light_tree::LightSet::default();
    let everywhere = light_tree::SpotCone {
        cos_inner: -1.0,
        cos_outer: -1.0,
    };
    let points = lights(300);
    for id in points.ids() {
        spots.push_spot(
            points.position(id),
            Vec3::NEG_Y,
            points.intensity(id),
            everywhere,
        );
    }
    let names = ["spot lights"];
    assert_same_with(&names, &sharing(1), || lights(300), (&floor, spots, direct));
    // A sun that is lost in rounding, and hardly ever the one light that is drawn. Lamps are so many that none of their clusters are near
    // the depth where lights are halved by count, which the sun's subtree brings nearer.
    let many = || lights(20_000);
    let mut sunny = many();
    sunny.push_directional(Vec3::NEG_Y, Vec3::splat(1e-30));
    let one_light = MethodSpec::StochasticLightcuts(StochasticLightcutsSpec {
        cut: 1u64.try_into().expect("in range"),
        ..Default::default()
    });
    let names = ["directional lights"];
    assert_same_with(&names, &one_light, many, (&floor, sunny, direct));
}

#[test]
fn shards_put_together_are_the_whole() {
    for method in [sharing(1), sharing(8), MethodSpec::default()] {
        shards_are_the_whole_with(&method);
    }
}

fn shards_are_the_whole_with(method: &MethodSpec) {
    let parts = (0..3).map(|index| {
        let shard = RenderSpec {
            shard: Shard { index, count: 3 },
            ..spec()
        };
        Ok::<_, FilmError>((index.to_string(), rendered(shard, method, 2)))
    });
    let merged = Picture::merge(parts).expect("three disjoint shards");
    assert!(
        merged == rendered(spec(), method, 2),
        "merged shards differ with {method:?}"
    );
}

#[test]
fn a_method_that_takes_whole_pixels_gets_all_samples_at_once() {
    let scene = floor_scene();
    let tracer = Tracer::build(&scene);
    let inputs = Inputs::new(lights(300), TreeBuilder::Binned);
    let mean = |method: &MethodSpec| {
        let mut render = Render::new(&scene, &tracer, &inputs, method, spec());
        let first = render.pass(&|_| ()).map(|pass| pass.spp);
        while render.pass(&|_| ()).is_some() {}
        let picture = render.picture();
        let sum: DVec3 = picture.radiance.iter().map(|c| c.as_dvec3()).sum();
        (first, render.counters().shading_points, sum)
    };
    let (first, points, whole) = mean(&MethodSpec::Multidimensional(Default::default()));
    let (first_all, points_all, exact) = mean(&MethodSpec::AllLights(Default::default()));
    assert_eq!((first, first_all), (Some(5), Some(1)), "samples at once");
    assert_eq!(points, points_all, "gather points");
    // Errors of 2000 pixels mostly cancel.
    assert!(
        (whole - exact).abs().max_element() < 1e-2 * exact.max_element(),
        "{whole} instead of {exact}"
    );
}

#[test]
fn samples_do_not_depend_on_how_they_are_split_into_passes() {
    let scene = floor_scene();
    let tracer = Tracer::build(&scene);
    let inputs = Inputs::new(lights(300), TreeBuilder::Binned);
    for method in [sharing(1), sharing(3), MethodSpec::default()] {
        let picture = |most| {
            let spec = RenderSpec { spp: 37, ..spec() };
            let mut render = Render::new(&scene, &tracer, &inputs, &method, spec);
            while render.pass_of_at_most(most, &|_| ()).is_some() {}
            assert_eq!(render.spp(), 37);
            render.picture()
        };
        let natural = picture(u32::MAX);
        for most in [1, 3, 7] {
            assert!(picture(most) == natural, "{most} at once, {method:?}");
        }
    }
}

#[test]
fn what_is_learned_takes_a_few_numbers_for_each_of_a_tiles_clusters() {
    let scene = floor_scene();
    let tracer = Tracer::build(&scene);
    let inputs = Inputs::new(lights(300), TreeBuilder::Binned);
    let bytes = |spp, learn| {
        let method = MethodSpec::StratifiedLightcuts(StratifiedLightcutsSpec {
            learn,
            ..Default::default()
        });
        let mut render = Render::new(&scene, &tracer, &inputs, &method, spec());
        while render.spp() < spp && render.pass(&|_| ()).is_some() {}
        render.learned_bytes()
    };
    assert_eq!([bytes(2, true), bytes(4, false)], [0, 0], "nothing learned");
    // 4 by 3 tiles of up to 128 + 7 clusters; those at the top see no floor.
    let most = MethodSpec::default().most_learned_bytes(spec().width, spec().height);
    let learned = bytes(4, true) as u64;
    assert_eq!(most, 12 * 135 * (4 + 16 * 12));
    assert!((most / 12..=most).contains(&learned), "{learned} bytes");
}

#[test]
fn a_light_over_a_plane_gives_its_irradiance() {
    // Radiance = ρ/π · I cosθ / d² under the light's foot: 0.5/π · 1/4.
    let scene = floor_scene();
    let tracer = Tracer::build(&scene);
    let mut one = light_tree::LightSet::default();
    one.push_point(Vec3::Y * 2.0, Vec3::ONE);
    let inputs = Inputs::new(one, TreeBuilder::Binned);
    for method in MethodSpec::all() {
        let spec = RenderSpec {
            width: 1001,
            height: 1001,
            spp: 1,
            ..spec()
        };
        let narrow = Scene {
            camera: CameraSpec {
                fov_y_deg: 1.0,
                ..scene.camera
            },
            ..scene.clone()
        };
        let mut render = Render::new(
            &narrow,
            &tracer,
            &inputs,
            &method,
            RenderSpec {
                width: 33,
                height: 33,
                ..spec
            },
        );
        while render.pass(&|_| ()).is_some() {}
        let centre = render.picture().radiance[16 * 33 + 16];
        let exact = 0.5 / std::f32::consts::PI / 4.0;
        assert!(
            (centre.x / exact - 1.0).abs() < 1e-3,
            "{}: {centre} instead of {exact}",
            method.name()
        );
    }
}

#[test]
fn a_scene_without_lights_is_black_and_sound() {
    let scene = floor_scene();
    let tracer = Tracer::build(&scene);
    let inputs = Inputs::new(light_tree::LightSet::default(), TreeBuilder::Binned);
    for method in MethodSpec::all() {
        let mut render = Render::new(&scene, &tracer, &inputs, &method, spec());
        while render.pass(&|_| ()).is_some() {}
        assert!(
            render.picture().radiance.iter().all(|c| *c == Vec3::ZERO),
            "{}",
            method.name()
        );
        assert_eq!(render.counters().nonfinite, 0, "{}", method.name());
    }
    assert!(inputs.built_tree().is_none(), "no lights, no tree");
}

/// Mean of all pixels and channels.
fn mean(layer: &[Vec3]) -> f64 {
    let sum: f64 = layer.iter().map(|c| c.as_dvec3().element_sum()).sum();
    sum / (3 * layer.len()) as f64
}

#[test]
fn every_method_tells_direct_light_from_indirect() {
    let scene = floor_scene();
    let tracer = Tracer::build(&scene);
    let with_virtual = |sources: u32| {
        let mut set = lights(sources);
        for i in 0..20 {
            set.push_virtual(&light_tree::VirtualLight {
                position: Vec3::new(0.3 * i as f32 - 3.0, 1.5, -1.0),
                normal: Vec3::NEG_Y,
                intensity: Vec3::splat(0.7),
                gloss: None,
            });
        }
        set.set_radius(0.1);
        Inputs::new(set, TreeBuilder::Binned)
    };
    let both = with_virtual(40);
    let alone = Inputs::new(lights(40), TreeBuilder::Binned);
    let picture = |inputs: &Inputs, method: &MethodSpec, spp: u32| {
        let spec = RenderSpec { spp, ..spec() };
        let mut render = Render::new(&scene, &tracer, inputs, method, spec);
        while render.pass(&|_| ()).is_some() {}
        render.picture()
    };
    let all_lights = &MethodSpec::all()[0];
    let truth = picture(&alone, all_lights, 16).radiance;
    let running = StochasticLightcutsSpec {
        stopping: crate::method::Stopping::RunningTotal(Default::default()),
        ..Default::default()
    };
    let mut methods = MethodSpec::all();
    methods.push(MethodSpec::StochasticLightcuts(running));
    for method in &methods {
        let found = picture(&both, method, 16);
        let parts = found.direct.iter().zip(&found.indirect);
        for ((direct, indirect), all) in parts.zip(&found.radiance) {
            let off = (direct + indirect - all).abs().max_element();
            assert!(
                off <= 1e-6 * all.max_element(),
                "{method:?}: {direct} and {indirect} are not {all}"
            );
        }
        let ratio = mean(&found.direct) / mean(&truth);
        assert!((0.9..1.1).contains(&ratio), "{method:?}: direct × {ratio}");
        let share = mean(&found.indirect) / mean(&found.radiance);
        assert!((0.01..0.5).contains(&share), "{method:?}: indirect {share}");

        let sources = picture(&alone, method, 2);
        assert!(
            sources.direct == sources.radiance,
            "{method:?}: all is direct"
        );
        assert!(
            sources.indirect.iter().all(|c| *c == Vec3::ZERO),
            "{method:?}: nothing is indirect"
        );
        let none = picture(&with_virtual(0), method, 2);
        assert!(
            none.direct.iter().all(|c| *c == Vec3::ZERO),
            "{method:?}: nothing is direct"
        );
    }
}
