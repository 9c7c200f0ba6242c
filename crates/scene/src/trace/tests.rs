//! Rays against brute force, along edges, and in awkward geometry.

use glam::DVec3;
use sampling::{Purpose, Rng, uniform_sphere};

use super::width::Four;
use super::*;
use crate::{MaterialId, Mesh};

const NO_HIT: Hit = Hit {
    t: 0.0,
    triangle: u32::MAX,
    u: 0.0,
    v: 0.0,
};

fn scene_of(positions: Vec<Vec3>, indices: Vec<[u32; 3]>) -> Scene {
    let materials = vec![MaterialId(0); indices.len()];
    Scene {
        mesh: Mesh {
            positions,
            indices,
            materials,
            ..Mesh::default()
        },
        materials: vec![crate::Material::default()],
        ..Scene::default()
    }
}

/// A closed sphere of `2 n²` triangles with a bumpy surface, times `scale`, moved by `shift`.
fn bumpy_sphere(n: u32, scale: f32, shift: Vec3) -> Scene {
    let mut rng = Rng::new(5, 0, 0, Purpose::Build);
    let mut positions = vec![Vec3::Y, Vec3::NEG_Y];
    for i in 1..n {
        for j in 0..n {
            let (theta, phi) = (
                i as f32 / n as f32 * std::f32::consts::PI,
                j as f32 / n as f32 * std::f32::consts::TAU,
            );
            let r = 1.0 + 0.1 * rng.f32();
            positions.push(
                Vec3::new(
                    theta.sin() * phi.cos(),
                    theta.cos(),
                    theta.sin() * phi.sin(),
                ) * r,
            );
        }
    }
    let at = |i: u32, j: u32| match i {
        0 => 0,
        i if i == n => 1,
        i => 2 + (i - 1) * n + j % n,
    };
    let mut indices = Vec::new();
    for i in 0..n {
        for j in 0..n {
            let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            for tri in [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]] {
                if tri[0] != tri[1] && tri[1] != tri[2] && tri[0] != tri[2] {
                    indices.push(tri);
                }
            }
        }
    }
    scene_of(
        positions.into_iter().map(|p| p * scale + shift).collect(),
        indices,
    )
}

/// Random triangles of all sizes.
fn soup(n: usize) -> Scene {
    let mut rng = Rng::new(6, 0, 0, Purpose::Build);
    let mut positions = Vec::new();
    for _ in 0..n {
        let centre = Vec3::new(rng.f32(), rng.f32(), rng.f32()) * 10.0;
        let size = 2.0f32.powf(-8.0 * rng.f32());
        for _ in 0..3 {
            positions.push(centre + uniform_sphere([rng.f32(), rng.f32()]) * size);
        }
    }
    let indices = (0..n as u32)
        .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
        .collect();
    scene_of(positions, indices)
}

/// Möller–Trumbore in f64: distance, and how far inside the triangle's edges.
fn exact(corners: [Vec3; 3], ray: &Ray) -> Option<(f64, f64)> {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let (o, d): (DVec3, DVec3) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let h = d.cross(e2);
    let det = e1.dot(h);
    if det == 0.0 {
        return None;
    }
    let s = o - a;
    let u = s.dot(h) / det;
    let q = s.cross(e1);
    let v = d.dot(q) / det;
    Some((e2.dot(q) / det, u.min(v).min(1.0 - u - v)))
}

fn rays_through(scene: &Scene, n: usize) -> Vec<Ray> {
    let mut rng = Rng::new(8, 0, 0, Purpose::Build);
    (0..n)
        .map(|i| {
            let origin = Vec3::new(rng.f32(), rng.f32(), rng.f32()) * 10.0;
            let direction = match i % 4 {
                0 => [Vec3::X, Vec3::NEG_Y, Vec3::Z][i % 3],
                1 => {
                    let t = (rng.f32() * scene.mesh.len() as f32) as usize;
                    scene.mesh.corners(t)[0] - origin
                }
                _ => uniform_sphere([rng.f32(), rng.f32()]),
            };
            Ray {
                origin,
                direction,
                t_max: if i % 2 == 0 { f32::INFINITY } else { 1.0 },
            }
        })
        .collect()
}

#[test]
fn no_hit_of_brute_force_is_missed() {
    let scene = soup(2000);
    let tracer = Tracer::build(&scene);
    let rays = rays_through(&scene, 2000);
    let mut answers = vec![false; rays.len()];
    tracer.occluded(&rays, &mut answers, &mut OcclusionScratch::default());
    // What an earlier call left does not matter.
    let mut hits = vec![Some(NO_HIT); rays.len()];
    let mut scratch = NearestScratch::default();
    tracer.nearest(&rays[..7], &mut hits[..7], &mut scratch);
    tracer.nearest(&rays, &mut hits, &mut scratch);
    for ((ray, occluded), queued) in rays.iter().zip(&answers).zip(hits) {
        let t_max = f64::from(ray.t_max);
        // Clear of edges and ends by more than rounding.
        let nearest = (0..scene.mesh.len())
            .filter_map(|t| exact(scene.mesh.corners(t), ray))
            .filter(|&(t, inside)| inside > 1e-4 && t > 1e-4 && t < t_max * (1.0 - 1e-4))
            .map(|(t, _)| t)
            .fold(f64::INFINITY, f64::min);
        let hit = tracer.closest(ray);
        assert_eq!(
            hit.map(|hit| hit.t),
            queued.map(|hit| hit.t),
            "one by one and in a batch {ray:?} goes as far"
        );
        let alone = tracer.is_occluded(ray);
        assert_eq!(
            alone, *occluded,
            "one by one and in a batch disagree on {ray:?}"
        );
        assert_eq!(
            hit.is_some(),
            *occluded,
            "closest and any hit disagree on {ray:?}"
        );
        if nearest.is_finite() {
            let t = f64::from(
                hit.unwrap_or_else(|| panic!("{ray:?} misses the hit at {nearest}"))
                    .t,
            );
            assert!(
                t <= nearest * (1.0 + 1e-4),
                "{ray:?}: {t}, brute force {nearest}"
            );
        }
        if let Some(hit) = hit {
            let (t, inside) =
                exact(scene.mesh.corners(hit.triangle as usize), ray).expect("not parallel");
            assert!(
                inside > -1e-3 && (t - f64::from(hit.t)).abs() < 1e-3 * (1.0 + t),
                "{ray:?}: false hit {hit:?}"
            );
        }
    }
}

#[test]
fn nothing_leaks_out_of_a_closed_surface_at_any_scale() {
    for (scale, shift) in [
        (1.0, Vec3::ZERO),
        (1e-3, Vec3::ZERO),
        (1e3, Vec3::ZERO),
        (1.0, Vec3::splat(1000.0)),
    ] {
        let scene = bumpy_sphere(60, scale, shift);
        let tracer = Tracer::build(&scene);
        let mut rng = Rng::new(9, 0, 0, Purpose::Build);
        let mut rays = Vec::new();
        for tri in &scene.mesh.indices {
            let origin = shift + uniform_sphere([rng.f32(), rng.f32()]) * (0.5 * scale);
            let [a, b, _] = tri.map(|i| scene.mesh.positions[i as usize]);
            for target in [a, a.lerp(b, rng.f32())] {
                rays.push(Ray {
                    origin,
                    direction: target - origin,
                    t_max: f32::INFINITY,
                });
            }
        }
        let mut answers = vec![false; rays.len()];
        tracer.occluded(&rays, &mut answers, &mut OcclusionScratch::default());
        let leaks = answers.iter().filter(|a| !**a).count();
        assert_eq!(
            leaks,
            0,
            "of {} rays at vertices and edges, scale {scale}, shift {shift}",
            rays.len()
        );
    }
}

#[test]
fn a_ray_that_leaves_a_surface_does_not_meet_it_again() {
    for (scale, shift) in [
        (1.0, Vec3::ZERO),
        (1e-3, Vec3::ZERO),
        (1e3, Vec3::ZERO),
        (1.0, Vec3::new(1e4, 0.0, -3e3)),
    ] {
        let scene = scene_of(
            [
                Vec3::new(-1.0, -0.3, -1.0),
                Vec3::new(1.0, 0.1, -1.0),
                Vec3::new(-0.3, 0.7, 1.3),
            ]
            .map(|p| p * scale + shift)
            .to_vec(),
            vec![[0, 1, 2]],
        );
        let tracer = Tracer::build(&scene);
        let mut rng = Rng::new(10, 0, 0, Purpose::Build);
        for _ in 0..20_000 {
            let (u, v) = (rng.f32(), rng.f32());
            let hit = Hit {
                t: 1.0,
                triangle: 0,
                u: u * (1.0 - v),
                v,
            };
            let surface = scene.surface(&hit, uniform_sphere([rng.f32(), rng.f32()]));
            let wi = uniform_sphere([rng.f32(), rng.f32()]);
            if wi.dot(surface.ng) > 0.0 {
                let ray = Ray {
                    origin: surface.ray_origin(),
                    direction: wi,
                    t_max: f32::INFINITY,
                };
                assert!(
                    !tracer.is_occluded(&ray),
                    "scale {scale} shift {shift}: {hit:?} along {wi}"
                );
            }
        }
    }
}

#[test]
fn an_empty_scene_stops_no_ray() {
    let tracer = Tracer::build(&Scene::default());
    let ray = Ray {
        origin: Vec3::ZERO,
        direction: Vec3::X,
        t_max: f32::INFINITY,
    };
    assert!(
        tracer.closest(&ray).is_none() && !tracer.is_occluded(&ray),
        "nothing is there"
    );
    let mut hits = [Some(NO_HIT)];
    tracer.nearest(&[ray], &mut hits, &mut NearestScratch::default());
    assert_eq!(hits, [None], "nor in a batch");
}

#[test]
fn a_mapped_hole_lets_rays_through_and_its_surround_does_not() {
    let mut scene = scene_of(
        vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)],
        vec![[0, 1, 2], [1, 3, 2]],
    );
    scene.mesh.uvs = vec![
        glam::Vec2::ZERO,
        glam::Vec2::X,
        glam::Vec2::Y,
        glam::Vec2::ONE,
    ];
    scene.mesh.uv_indices = scene.mesh.indices.clone();
    let texels = (0..64)
        .map(|i| [255, 255, 255, if (i % 8) < 4 { 0 } else { 255 }])
        .collect();
    scene.textures.push(crate::Texture {
        path: "mask".into(),
        width: 8,
        height: 8,
        texels,
        has_alpha: true,
    });
    scene.materials[0].opacity_map = Some(crate::TextureId(0));
    let tracer = Tracer::build(&scene);
    let ray = |x: f32| Ray {
        origin: Vec3::new(x, 0.4, 1.0),
        direction: Vec3::NEG_Z,
        t_max: f32::INFINITY,
    };
    assert!(
        !tracer.is_occluded(&ray(0.25)) && tracer.closest(&ray(0.25)).is_none(),
        "the hole"
    );
    assert!(
        tracer.is_occluded(&ray(0.75)) && tracer.closest(&ray(0.75)).is_some(),
        "the surround"
    );
    let rays = [0.25, 0.75].map(ray);
    let mut hits = [None; 2];
    tracer.nearest(&rays, &mut hits, &mut NearestScratch::default());
    assert_eq!(
        hits,
        rays.map(|ray| tracer.closest(&ray)),
        "both in a batch"
    );

    scene.materials[0] = crate::Material {
        opacity: 0.1,
        ..crate::Material::default()
    };
    let tracer = Tracer::build(&scene);
    assert_eq!(
        tracer.triangle_count(),
        0,
        "transparent triangles are not traced"
    );
}

#[test]
fn wide_and_narrow_instructions_give_the_same_bits() {
    // Miri is a thousand times slower.
    let many = if cfg!(miri) { 100 } else { 5000 };
    let scene = soup(many);
    let mut rays = rays_through(&scene, many);
    // From where boxes end, along their faces.
    for (i, &origin) in scene.mesh.positions.iter().take(many / 5).enumerate() {
        let signs = Vec3::new(1.0, -1.0, 1.0);
        let direction = [Vec3::X, Vec3::NEG_Y, Vec3::new(0.0, 1.0, -1.0)][i % 3];
        rays.push(Ray {
            origin,
            direction: direction * if i % 2 == 0 { signs } else { -signs },
            t_max: f32::INFINITY,
        });
    }
    let bits =
        |hit: Option<Hit>| hit.map(|h| (h.triangle, h.t.to_bits(), h.u.to_bits(), h.v.to_bits()));
    let answers = |widest| {
        let tracer = Tracer {
            widest,
            ..Tracer::build(&scene)
        };
        let closest: Vec<_> = rays.iter().map(|ray| bits(tracer.closest(ray))).collect();
        let occluded: Vec<_> = rays.iter().map(|ray| tracer.is_occluded(ray)).collect();
        let mut queued = vec![false; rays.len()];
        tracer.occluded(&rays, &mut queued, &mut OcclusionScratch::default());
        let mut nearest = vec![None; rays.len()];
        tracer.nearest(&rays, &mut nearest, &mut NearestScratch::default());
        let nearest: Vec<_> = nearest.into_iter().map(bits).collect();
        (closest, occluded, queued, nearest)
    };
    let narrow = answers(Widest::Four(Four));
    for widest in Widest::all() {
        let wide = answers(widest);
        for (i, ray) in rays.iter().enumerate() {
            assert_eq!(wide.0[i], narrow.0[i], "{widest:?}: closest hit of {ray:?}");
            assert_eq!(wide.1[i], narrow.1[i], "{widest:?}: occlusion of {ray:?}");
            assert_eq!(wide.2[i], narrow.2[i], "{widest:?}: {ray:?} in a queue");
            assert_eq!(wide.3[i], narrow.3[i], "{widest:?}: queued {ray:?}'s hit");
        }
    }
    let hits = narrow.2.iter().filter(|hit| **hit).count();
    assert!(
        hits > many / 20 && hits < many * 9 / 10,
        "{hits} hits of {many}: both answers are compared"
    );
}

const NAVE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/nave/scene.ron");

/// The builder moves parts of its tree about, so that what is below a node lies scattered among its indices.
#[test]
fn each_triangle_is_in_one_block_within_the_boxes_above_it() {
    let scene = crate::load::load(NAVE.as_ref()).expect("is built in");
    let tracer = Tracer::build(&scene);
    let mut found = vec![0; scene.mesh.len()];
    let mut work = vec![(0, Vec3::NEG_INFINITY, Vec3::INFINITY)];
    while let Some((link, lo, hi)) = work.pop() {
        if !bvh8::is_inner(link) {
            for id in tracer.bvh.block(link).ids() {
                found[id as usize] += 1;
                for corner in scene.mesh.corners(id as usize) {
                    let is_within = corner.cmpge(lo).all() && corner.cmple(hi).all();
                    assert!(is_within, "triangle {id}: {corner}");
                }
            }
            continue;
        }
        let node = tracer.bvh.node(link);
        for slot in 0..bvh8::WIDTH {
            let [x, y, z, to_x, to_y, to_z] = [0, 1, 2, 3, 4, 5].map(|row| node.bounds(row)[slot]);
            if x.is_finite() {
                work.push((
                    node.link(slot),
                    Vec3::new(x, y, z),
                    Vec3::new(to_x, to_y, to_z),
                ));
            }
        }
    }
    let lost = found.iter().filter(|times| **times != 1).count();
    assert_eq!(lost, 0, "of {} triangles", found.len());
}

/// Opening the largest nodes first left 4.4 of eight.
#[test]
fn nodes_are_filled() {
    let scene = crate::load::load(NAVE.as_ref()).expect("is built in");
    let bvh = Tracer::build(&scene).bvh;
    let (mut nodes, mut children) = (0, 0);
    let mut work = vec![0];
    while let Some(link) = work.pop() {
        let node = bvh.node(link);
        let used = (0..bvh8::WIDTH).filter(|&k| node.bounds(0)[k].is_finite());
        let links: Vec<u32> = used.map(|k| node.link(k)).collect();
        nodes += 1;
        children += links.len();
        work.extend(links.into_iter().filter(|&link| bvh8::is_inner(link)));
    }
    let mean = children as f64 / nodes as f64;
    assert!(mean > 5.5, "{mean} children a node");
}

/// The builder joins neighbours, which takes quadratic time where each triangle's box holds the next one's: hours for these.
#[test]
fn a_pile_of_triangles_is_one_primitive_to_the_builder() {
    const COUNT: u32 = 100_000;
    fn concentric(s: f32) -> [Vec3; 3] {
        [
            Vec3::new(-s, -s, 0.0),
            Vec3::new(s, -s, 0.0),
            Vec3::new(0.0, s, 0.0),
        ]
    }
    type Corners = fn(u32) -> [Vec3; 3];
    let piles: [(&str, Corners); 2] = [
        ("the same triangle", |_| concentric(1.0)),
        ("concentric triangles", |i| {
            concentric(1.0 + i as f32 * 1e-5)
        }),
    ];
    for (name, corners) in piles {
        let scene = triangles(COUNT, corners);
        let primitives = build::Primitives::of(&scene.mesh, (0..COUNT).collect());
        assert_eq!(primitives.len(), 1, "{name}");
        are_met(name, &scene, COUNT);
    }
}

/// A binary tree as deep as there are triangles: on the stack of a test's thread the builder would run out of it.
#[test]
fn a_fan_of_slivers_is_traced() {
    const COUNT: u32 = 12_000;
    let scene = triangles(COUNT, |i| {
        let x = -1.0 + 2.0 * i as f32 / COUNT as f32;
        [
            Vec3::new(0.0, 1.0, 0.0),
            Vec3::new(x, -1.0, 0.0),
            Vec3::new(x + 3.0 / COUNT as f32, -1.0, 0.0),
        ]
    });
    are_met("slivers", &scene, COUNT);
}

fn triangles(count: u32, corners: impl Fn(u32) -> [Vec3; 3]) -> Scene {
    scene_of(
        (0..count).flat_map(corners).collect(),
        (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
    )
}

/// Rays along z meet the triangles around the origin, and none beside them.
fn are_met(name: &str, scene: &Scene, count: u32) {
    let tracer = Tracer::build(scene);
    assert_eq!(tracer.triangle_count(), count as usize, "{name}");
    for (x, y, expected) in [(0.0, 0.0, true), (0.3, -0.5, true), (0.0, 3.0, false)] {
        let ray = Ray {
            origin: Vec3::new(x, y, 1.0),
            direction: Vec3::NEG_Z,
            t_max: f32::INFINITY,
        };
        let at = format!("{name} at {x}, {y}");
        assert_eq!(tracer.is_occluded(&ray), expected, "{at}");
        assert_eq!(tracer.closest(&ray).is_some(), expected, "{at}");
    }
}
