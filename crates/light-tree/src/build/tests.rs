//! Trees of every builder.

use super::*;
use crate::test_lights::any_lights;

#[test]
fn every_tree_is_valid() {
    verify::property(1000, |u| {
        let set = any_lights(u)?;
        for builder in TreeBuilder::ALL {
            match LightTree::build(&set, builder) {
                None => assert!(set.is_empty(), "a tree for {} lights", set.len()),
                Some(tree) => tree
                    .validate(&set)
                    .unwrap_or_else(|e| panic!("{builder:?}: {e}")),
            }
        }
        Ok(())
    });
}

#[test]
fn dropped_directions_leave_the_same_nodes_and_weights() {
    use crate::NodeWeights;
    use crate::test_lights::{any_receiver, receiver};
    verify::property(1000, |u| {
        let set = any_lights(u)?;
        let at = receiver(any_receiver(u, &set)?);
        let builder = *u.choose(&TreeBuilder::ALL)?;
        let Some(kept) = LightTree::build(&set, builder) else {
            return Ok(());
        };
        let dropped = LightTree::build_with(&set, builder, Directions::Dropped).expect("lights");
        dropped.validate(&set).unwrap_or_else(|e| panic!("{e}"));
        let nodes = |tree: &LightTree| format!("{:?}", tree.pairs);
        assert!(nodes(&kept) == nodes(&dropped), "{builder:?}: nodes");
        let has_axes = set.ids().any(|id| set.axis(id) != Vec3::ZERO);
        assert_eq!(!kept.cones.is_empty(), has_axes, "kept");
        let has_distant = set.ids().any(|id| set.kind(id).is_distant());
        assert_eq!(!dropped.cones.is_empty(), has_distant, "dropped");
        let blind = |weights: &NodeWeights| weights.directions() == Directions::Dropped;
        for weights in NodeWeights::ALL.into_iter().filter(blind) {
            let of = |tree: &LightTree| tree.pmf_below(weights, &at, tree.root());
            assert_eq!(of(&kept), of(&dropped), "{weights:?}");
            for id in kept.nodes_below(kept.root()) {
                let of = |tree: &LightTree| tree.bound(weights, &at, id);
                assert_eq!(of(&kept), of(&dropped), "{weights:?}: node {}", id.0);
            }
        }
        Ok(())
    });
}

#[test]
fn a_light_without_directions_takes_less_than_seventy_bytes_of_tree() {
    let mut set = LightSet::default();
    let mut rng = sampling::Rng::new(3, 0, 0, sampling::Purpose::Build);
    let count = 1000;
    for _ in 0..count {
        set.push_virtual(&crate::VirtualLight {
            position: Vec3::new(rng.f32(), rng.f32(), rng.f32()),
            normal: Vec3::Y,
            intensity: Vec3::ONE,
            gloss: None,
        });
    }
    set.set_radii((0..count).map(|_| rng.f32()).collect());
    let bytes = |directions| {
        let tree = LightTree::build_with(&set, TreeBuilder::Binned, directions);
        tree.expect("has lights").bytes() / count
    };
    let both = [Directions::Dropped, Directions::Kept].map(bytes);
    assert!(both[0] < 70 && both[1] > 90, "{both:?} bytes a light");
}

#[test]
fn coincident_lights_make_a_shallow_tree() {
    let mut set = LightSet::default();
    for _ in 0..20_000 {
        set.push_point(Vec3::ONE, Vec3::ONE);
    }
    for builder in TreeBuilder::ALL {
        let tree = LightTree::build(&set, builder).expect("has lights");
        tree.validate(&set)
            .unwrap_or_else(|e| panic!("{builder:?}: {e}"));
        assert!(tree.depth() <= 16, "{builder:?}: depth {}", tree.depth());
    }
}

#[test]
fn lights_without_a_place_are_told_apart_by_their_directions() {
    // Few are joined from below, many divided from above.
    for n in [10u8, 40] {
        let mut set = LightSet::default();
        for i in 0..n {
            let across = if i % 2 == 0 { Vec3::X } else { Vec3::Y };
            let direction = across + Vec3::Z * (0.01 * f32::from(i));
            set.push_directional(direction.normalize(), Vec3::ONE);
        }
        let tree = LightTree::build(&set, TreeBuilder::Binned).expect("has lights");
        let first = tree.node(tree.root()).first_child().expect("many lights");
        for child in [first, crate::NodeId(first.0 + 1)] {
            let cos = tree.cone(child).cos;
            // Of either kind alone 0.98, of both at most 0.71.
            assert!(cos > 0.95, "{n} lights: cosine {cos}");
        }
    }
}

#[test]
fn a_geometric_chain_of_lights_keeps_its_depth_bounded() {
    let mut set = LightSet::default();
    for i in 0..120 {
        set.push_point(Vec3::X * 0.5f32.powi(i), Vec3::ONE);
    }
    for builder in TreeBuilder::ALL {
        let tree = LightTree::build(&set, builder).expect("has lights");
        tree.validate(&set)
            .unwrap_or_else(|e| panic!("{builder:?}: {e}"));
        assert!(tree.depth() <= 3 * 7, "{builder:?}: depth {}", tree.depth());
    }
}

#[test]
fn the_tree_is_the_same_for_one_thread_and_four() {
    let mut set = LightSet::default();
    let mut rng = sampling::Rng::new(3, 0, 0, sampling::Purpose::Build);
    for _ in 0..30_000 {
        set.push_point(
            Vec3::new(rng.f32(), rng.f32(), rng.f32()),
            Vec3::splat(rng.f32()),
        );
    }
    let build_with = |builder, threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("thread pool");
        let tree = pool
            .install(|| LightTree::build(&set, builder))
            .expect("has lights");
        format!("{:?}", tree.pairs)
    };
    for builder in TreeBuilder::ALL {
        assert!(
            build_with(builder, 1) == build_with(builder, 4),
            "{builder:?}: trees differ"
        );
    }
}

#[test]
fn the_shape_of_a_tree_does_not_depend_on_the_unit_of_length() {
    let shape = |builder, scale: f32| {
        let mut set = LightSet::default();
        let mut rng = sampling::Rng::new(3, 0, 0, sampling::Purpose::Build);
        // Some on a line, whose boxes have no area, and some anywhere about it.
        for i in 0..200u8 {
            let anywhere = Vec3::new(rng.f32(), rng.f32(), rng.f32());
            let on_line = Vec3::new(f32::from(i) * 0.005, 0.5, 0.5);
            let place = if i % 2 == 0 { on_line } else { anywhere };
            set.push_point(
                place * scale,
                Vec3::splat((0.1 + rng.f32()) * scale * scale),
            );
        }
        let tree = LightTree::build(&set, builder).expect("has lights");
        tree.lights_below(tree.root()).collect::<Vec<_>>()
    };
    for builder in TreeBuilder::ALL {
        let one = shape(builder, 1.0);
        for k in [-20, -7, 8, 20] {
            assert!(
                shape(builder, 2.0f32.powi(k)) == one,
                "{builder:?} at 2^{k}"
            );
        }
    }
}

/// Sum over all inner nodes of intensity times squared diagonal: what a good tree keeps small.
fn looseness(set: &LightSet, builder: TreeBuilder) -> f64 {
    let tree = LightTree::build(set, builder).expect("has lights");
    let nodes = tree.pairs.iter().flat_map(|p| p.0);
    nodes
        .filter(|n| n.has_positions())
        .map(|n| f64::from(n.intensity * (n.hi - n.lo).length_squared()))
        .sum()
}

#[test]
fn lights_on_a_line_are_clustered_whatever_their_order() {
    let mut shuffled: Vec<u32> = (0..1000).collect();
    shuffled.sort_by_key(|i| i.wrapping_mul(2_654_435_761));
    let line = |order: &mut dyn Iterator<Item = u32>| {
        let mut set = LightSet::default();
        for i in order {
            set.push_point(Vec3::new(i as f32, 2.0, 3.0), Vec3::ONE);
        }
        set
    };
    let (straight, shuffled) = (line(&mut (0..1000)), line(&mut shuffled.into_iter()));
    for builder in TreeBuilder::ALL {
        let (a, b) = (looseness(&straight, builder), looseness(&shuffled, builder));
        assert!(
            (a / b - 1.0).abs() < 0.01,
            "{builder:?}: {a} in order, {b} shuffled"
        );
        // Halving a line of n: n · n² · (1 + 1/4 + …) = 4/3 n³.
        assert!(a < 2.0e9, "{builder:?}: {a} for a line of 1000");
    }
}
