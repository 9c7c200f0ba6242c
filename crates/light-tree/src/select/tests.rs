//! Probabilities: that they are those of the draws, on trees and lights of every kind.

use glam::Vec3;

use super::*;
use crate::build::TreeBuilder;
use crate::light::VirtualLight;
use crate::lights::LightSet;
use crate::test_lights::{
    BLACK, any_lights, any_receiver, contribution, lights_on_walls, receiver,
};
use crate::tree::Node;
use crate::tree::Pair;

#[test]
fn every_light_that_contributes_can_be_drawn_and_probabilities_sum_to_one() {
    verify::property(1000, |u| {
        let lights = any_lights(u)?;
        let at = any_receiver(u, &lights)?;
        let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
            return Ok(());
        };
        // A share of 10⁻²⁵ is beyond what f32 weights tell apart, and beyond any picture.
        let all: f64 = lights
            .ids()
            .map(|id| contribution(&lights, id, at.0, at.1))
            .sum();
        let black = BLACK.max(1e-25 * all);
        for weights in NodeWeights::ALL {
            let (pmfs, dead) = tree.pmf_below(weights, &receiver(at), tree.root());
            let sum: f64 = pmfs.iter().map(|p| p.1).sum::<f64>() + dead;
            assert!((sum - 1.0).abs() < 1e-9, "{weights:?}: sum {sum}");
            for id in lights.ids() {
                let lit = contribution(&lights, id, at.0, at.1);
                let pmf = pmfs.iter().find(|p| p.0 == id).map_or(0.0, |p| p.1);
                assert!(
                    lit <= black || pmf > 0.0,
                    "{weights:?}: {id:?} brings {lit} to {at:?}, never drawn"
                );
            }
        }
        Ok(())
    });
}

#[test]
fn lights_are_drawn_as_often_as_reported() {
    let lights = lights_on_walls(200);
    let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
    for weights in NodeWeights::ALL {
        for at in [
            (Vec3::new(0.1, -0.9, 0.2), Vec3::Y),
            (Vec3::new(-1.0, 0.3, 0.3), Vec3::X),
        ] {
            let (pmfs, dead) = tree.pmf_below(weights, &receiver(at), tree.root());
            let mut expected = vec![0.0; lights.len() + 1];
            for (id, pmf) in pmfs {
                expected[id.index()] = pmf;
            }
            expected[lights.len()] = dead;
            let mut observed = vec![0u64; lights.len() + 1];
            let mut rng = sampling::Rng::new(1, 0, 0, sampling::Purpose::Lights);
            let starts: Vec<_> = (0..40_000)
                .map(|_| Start {
                    receiver: 0,
                    node: tree.root(),
                    u: rng.f64(),
                })
                .collect();
            let mut drawn = Vec::new();
            tree.select_each(
                weights,
                DeadBranch::Stop,
                &[&receiver(at)],
                &starts,
                &mut drawn,
            );
            for drawn in drawn {
                match drawn {
                    Some(s) => {
                        let pmf = expected[s.light.index()];
                        assert!(
                            (s.pmf / pmf - 1.0).abs() < 1e-9,
                            "reported {} enumerated {pmf}",
                            s.pmf
                        );
                        observed[s.light.index()] += 1;
                    }
                    None => observed[lights.len()] += 1,
                }
            }
            let test = verify::chi_square(&observed, &expected);
            // Four tests at 1e-4: false alarm 4e-4, and the seed is pinned.
            assert!(test.p_value > 1e-4, "{weights:?} at {at:?}: {test:?}");
        }
    }
}

#[test]
fn many_descents_at_once_draw_what_each_draws_alone() {
    verify::property(1000, |u| {
        let lights = any_lights(u)?;
        let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
            return Ok(());
        };
        let receivers = [
            receiver(any_receiver(u, &lights)?),
            receiver(any_receiver(u, &lights)?),
            receiver(any_receiver(u, &lights)?),
        ];
        let receivers = receivers.each_ref();
        let all: Vec<NodeId> = tree.nodes_below(tree.root()).collect();
        let mut starts = Vec::new();
        // Up to more than there are lanes.
        let most = *u.choose(&[11, 150])?;
        for _ in 0..u.int_in_range(1..=most)? {
            starts.push(Start {
                receiver: u.int_in_range(0..=2)?,
                node: *u.choose(&all)?,
                u: f64::from(u.arbitrary::<u32>()?) / 4_294_967_296.0,
            });
        }
        for weights in NodeWeights::ALL {
            let alone: Vec<_> = starts
                .iter()
                .map(|start| {
                    let receiver = receivers[start.receiver as usize];
                    tree.select(weights, receiver, start.node, start.u)
                })
                .collect();
            // Behind what was drawn before.
            let mut drawn = vec![None];
            tree.select_each(weights, DeadBranch::Stop, &receivers, &starts, &mut drawn);
            assert_eq!(drawn[1..], alone, "{weights:?}");
            // The same by narrower instructions.
            let run = |run: fn(Descending<'_>)| {
                let mut drawn = vec![None; starts.len()];
                let all = Descending::new(&tree, weights, &receivers, &starts, &mut drawn);
                run(all);
                drawn
            };
            assert_eq!(run(|mut all| all.run_plain()), alone, "{weights:?}, plain");
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2")
                && std::arch::is_x86_feature_detected!("fma")
            {
                #[allow(unsafe_code, reason = "the code for a processor that has AVX2")]
                // SAFETY: this one has.
                let drawn = run(|mut all| unsafe { all.run_avx2() });
                assert_eq!(drawn, alone, "{weights:?}, AVX2");
            }
        }
        Ok(())
    });
}

/// A pair of lights below the receiver's horizon whose common box reaches above it, and one light above.
fn dead_pair(scale: f32) -> (LightSet, Receiver) {
    let mut lights = LightSet::default();
    lights.push_point(Vec3::new(1.0, -1.5, 0.0), Vec3::splat(scale));
    lights.push_point(Vec3::new(-1.5, 1.0, 0.0), Vec3::splat(scale));
    lights.push_point(Vec3::new(9.0, 9.0, 0.0), Vec3::ONE);
    (
        lights,
        Receiver::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0).normalize()),
    )
}

#[test]
fn retry_brightens_by_the_dead_mass_and_stop_does_not() {
    for scale in [0.1, 1.0, 10.0] {
        let (lights, x) = dead_pair(scale);
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        let weights = NodeWeights::Yuksel2019;
        let (_, dead) = tree.pmf_below(weights, &x, tree.root());
        assert!(dead > 0.05, "the case has a dead branch: {dead}");
        let mean = |dead_branches| {
            let n = 100_000;
            let starts: Vec<_> = (0..n)
                .map(|i| Start {
                    receiver: 0,
                    node: tree.root(),
                    u: (f64::from(i) + 0.5) / f64::from(n),
                })
                .collect();
            let mut drawn = Vec::new();
            tree.select_each(weights, dead_branches, &[&x], &starts, &mut drawn);
            let above = |s: &Selected| s.light == LightId(2);
            let found = drawn.into_iter().flatten().filter(above);
            let sum: f64 = found.map(|s| 1.0 / s.pmf).sum();
            sum / f64::from(n)
        };
        // The light above is worth 1: reached directly, and once more after each dead end.
        assert!(
            (mean(DeadBranch::Stop) - 1.0).abs() < 1e-3,
            "stop: {}",
            mean(DeadBranch::Stop)
        );
        let retry = mean(DeadBranch::Retry);
        assert!(
            (retry - (1.0 + dead)).abs() < 1e-3,
            "retry: {retry}, dead mass {dead}"
        );
    }
}

#[test]
fn extreme_numbers_never_reach_a_child_of_weight_zero() {
    let tiny = f32::from_bits(1);
    for u in [0.0, 0.5, BELOW_ONE] {
        for (w, only) in [
            ([0.0, 1.0], Some(1)),
            ([1.0, 0.0], Some(0)),
            ([tiny, 0.0], Some(0)),
            ([0.0, tiny], Some(1)),
        ] {
            let (child, p, rescaled) = choose(w, u).expect("something has weight");
            assert_eq!(Some(child), only, "weights {w:?} u {u}");
            assert!(
                p == 1.0 && (0.0..1.0).contains(&rescaled),
                "p {p} u {rescaled}"
            );
        }
        let (_, p, rescaled) = choose([1.0, 1.0 - f32::EPSILON], u).expect("both have weight");
        assert!(
            p > 0.0 && (0.0..1.0).contains(&rescaled),
            "p {p} u {rescaled}"
        );
    }
    assert!(choose([0.0, 0.0], 0.5).is_none(), "dead");
}

/// A tree that is a list: each pair holds one light and all that are left.
fn chain(lights: &LightSet) -> LightTree {
    let built = LightTree::build(lights, TreeBuilder::Binned).expect("has lights");
    let n = lights.len() as u32;
    let leaf = |i: u32| {
        let p = lights.position(LightId(i));
        Node::leaf(
            p,
            p,
            crate::luminance(lights.intensity(LightId(i))),
            LightId(i),
        )
    };
    let mut pairs = vec![Pair([Node::UNUSED; 2]); n as usize];
    let mut rest = leaf(n - 1);
    for i in (0..n - 1).rev() {
        let first = leaf(i);
        pairs[i as usize + 1] = Pair([first, rest]);
        rest = Node::inner(
            first.lo.min(rest.lo),
            first.hi.max(rest.hi),
            first.intensity + rest.intensity,
            2 * (i + 1),
        );
    }
    pairs[0] = Pair([rest, Node::UNUSED]);
    LightTree {
        pairs,
        depth: n - 1,
        ..built
    }
}

#[test]
fn a_chain_of_a_hundred_levels_draws_each_light_with_its_probability() {
    let mut lights = LightSet::default();
    for i in 0..101u8 {
        lights.push_point(Vec3::new(0.01 * f32::from(i), 5.0, 0.0), Vec3::ONE);
    }
    let tree = chain(&lights);
    assert_eq!(tree.validate(&lights), Ok(()), "the chain");
    let x = Receiver::new(Vec3::ZERO, Vec3::Y);
    for weights in NodeWeights::ALL {
        let (pmfs, dead) = tree.pmf_below(weights, &x, tree.root());
        let mut expected = vec![0.0; lights.len()];
        for (id, pmf) in pmfs {
            expected[id.index()] = pmf;
        }
        let sum: f64 = expected.iter().sum();
        assert!(
            (sum - 1.0).abs() < 1e-9 && dead == 0.0,
            "{weights:?}: sum {sum}"
        );
        let mut observed = vec![0; lights.len()];
        let mut rng = sampling::Rng::new(3, 0, 0, sampling::Purpose::Lights);
        for _ in 0..40_000 {
            let drawn = tree
                .select(weights, &x, tree.root(), rng.f64())
                .expect("lit");
            let pmf = expected[drawn.light.index()];
            assert!(
                (drawn.pmf / pmf - 1.0).abs() < 1e-9,
                "{} for {pmf}",
                drawn.pmf
            );
            observed[drawn.light.index()] += 1;
        }
        let fit = verify::chi_square(&observed, &expected);
        // Four tests: a false alarm is 4e-4.
        assert!(fit.p_value > 1e-4, "{weights:?}: {fit:?}");
    }
}

#[test]
fn a_random_number_lasts_down_a_deep_tree() {
    // Each level halves the probability: 40 levels use 40 bits. An f32 has 24.
    let mut lights = LightSet::default();
    for i in 0..41i8 {
        let place = Vec3::new(0.01 * f32::from(i), 5.0, 0.0);
        lights.push_point(place, Vec3::splat(2.0f32.powi(-i32::from(i))));
    }
    let tree = chain(&lights);
    let x = Receiver::new(Vec3::ZERO, Vec3::Y);
    for weights in NodeWeights::ALL {
        let (pmfs, _) = tree.pmf_below(weights, &x, tree.root());
        // Each light's interval of numbers, in the tree's order: its middle must lead to it.
        let mut before = 0.0;
        for id in tree.lights_below(tree.root()) {
            let pmf = pmfs.iter().find(|p| p.0 == id).map_or(0.0, |p| p.1);
            let drawn = tree.select(weights, &x, tree.root(), before + 0.5 * pmf);
            assert_eq!(
                drawn.map(|s| s.light),
                Some(id),
                "{weights:?}: {pmf} from {before} on"
            );
            before += pmf;
        }
        assert!((before - 1.0).abs() < 1e-9, "{weights:?}: {before}");
    }
}

#[test]
fn a_light_of_a_probability_below_all_of_f32_is_drawn() {
    // Each level leaves a ten-thousandth to what is left of it: 20 levels, 10⁻⁷⁷, and a number of 0 goes down all.
    let mut lights = LightSet::default();
    for i in 0..20i8 {
        let place = Vec3::new(0.01 * f32::from(i), 5.0, 0.0);
        lights.push_point(place, Vec3::splat(10f64.powi(38 - 4 * i32::from(i)) as f32));
    }
    let mut tree = chain(&lights);
    for pair in &mut tree.pairs[1..] {
        pair.0.swap(0, 1);
    }
    let x = Receiver::new(Vec3::ZERO, Vec3::Y);
    let faintest = LightId(19);
    for weights in NodeWeights::ALL {
        let (pmfs, _) = tree.pmf_below(weights, &x, tree.root());
        let pmf = pmfs.iter().find(|p| p.0 == faintest).map_or(0.0, |p| p.1);
        assert!(pmf > 0.0 && pmf < 1e-60, "{weights:?}: {pmf}");
        let drawn = tree.select(weights, &x, tree.root(), 0.0).expect("lit");
        assert_eq!(drawn.light, faintest, "{weights:?}");
        assert!(
            (drawn.pmf / pmf - 1.0).abs() < 1e-9,
            "{weights:?}: {} for {pmf}",
            drawn.pmf
        );
    }
}

#[test]
fn powers_beyond_all_measure_leave_every_lit_light_a_probability() {
    let x = Receiver::new(Vec3::ZERO, Vec3::Y);
    // The dark one beside those that are near, whose box is then around the receiver, or beside the far one: then the
    // ratio of the distances counts, which is 10⁵.
    let dark = [Vec3::new(0.3, -2.0, 0.0), Vec3::new(-500.0, -100.0, 100.0)];
    // f32 weights tell some 10⁴⁰ apart, and the far one is 10⁵ times as faint.
    let powers = [1.0, 1e5, 1e35];
    for case in 0..162usize {
        let places = [
            Vec3::new(0.0, 2.0, 0.0),
            dark[case / 81],
            Vec3::new(0.1, 2.2, 0.4),
            Vec3::new(-500.0, 100.0, 100.0),
        ];
        let mut lights = LightSet::default();
        for (i, place) in places.into_iter().enumerate() {
            lights.push_point(place, Vec3::splat(powers[case / 3usize.pow(i as u32) % 3]));
        }
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        for weights in NodeWeights::ALL {
            let (pmfs, dead) = tree.pmf_below(weights, &x, tree.root());
            let sum: f64 = pmfs.iter().map(|p| p.1).sum::<f64>() + dead;
            assert!(
                (sum - 1.0).abs() < 1e-9,
                "{weights:?}, case {case}: sum {sum}"
            );
            // A share of 10⁻²⁵ is beyond what f32 weights tell apart.
            let brings = |id| contribution(&lights, id, Vec3::ZERO, Vec3::Y);
            let all: f64 = lights.ids().map(brings).sum();
            for id in lights.ids().filter(|id| brings(*id) > 1e-25 * all) {
                let pmf = pmfs.iter().find(|p| p.0 == id).map_or(0.0, |p| p.1);
                assert!(pmf > 0.0, "{weights:?}, case {case}: {id:?} is never drawn");
            }
            // Half a cluster of 1e35 may be dark, but what is lit is not drawn less for it.
            let unlit = pmfs.iter().find(|p| p.0.0 == 1).map_or(0.0, |p| p.1);
            assert_eq!(
                unlit, 0.0,
                "{weights:?}, case {case}: the light below the horizon"
            );
        }
    }
}

/// Variance of one draw from the whole tree over the squared sum, for a white surface.
fn relative_variance(lights: &LightSet, builder: TreeBuilder, weights: NodeWeights) -> f64 {
    let at = (Vec3::new(0.3, 0.0, 0.2), Vec3::Y);
    let tree = LightTree::build(lights, builder).expect("has lights");
    let (pmfs, _) = tree.pmf_below(weights, &receiver(at), tree.root());
    let (mut sum, mut square) = (0.0, 0.0);
    for (id, pmf) in pmfs {
        let f = contribution(lights, id, at.0, at.1);
        sum += f;
        square += f * f / pmf;
    }
    square / (sum * sum) - 1.0
}

#[test]
fn lights_on_a_line_in_a_plane_or_in_one_place_are_drawn_as_well_as_scattered_ones() {
    let n = 1000u32;
    let along = |i: u32| i as f32 * 0.01 - 5.0;
    let line = |i: u32| Vec3::new(along(i), 1.0, 0.0);
    let plane = |i: u32| {
        Vec3::new(
            (i % 32) as f32 * 0.2 - 3.0,
            1.0,
            (i / 32) as f32 * 0.2 - 3.0,
        )
    };
    let places = |i: u32| Vec3::new((i % 4) as f32 - 1.5, 1.0, (i / 4 % 4) as f32 - 1.5);
    let set = |place: &dyn Fn(u32) -> Vec3, order: &dyn Fn(u32) -> u32, jitter: f32| {
        let mut rng = sampling::Rng::new(9, 0, 0, sampling::Purpose::Build);
        let mut lights = LightSet::default();
        for i in 0..n {
            let off = Vec3::new(rng.f32(), rng.f32(), rng.f32()) - 0.5;
            lights.push_point(place(order(i)) + jitter * off, Vec3::ONE);
        }
        lights
    };
    let in_order = |i: u32| i;
    // 387 has no factor in common with 1000.
    let mixed = |i: u32| (i * 387) % n;
    for place in [&line as &dyn Fn(u32) -> Vec3, &plane, &places] {
        for builder in TreeBuilder::ALL {
            for weights in NodeWeights::ALL {
                let of = |order: &dyn Fn(u32) -> u32, jitter| {
                    relative_variance(&set(place, order, jitter), builder, weights)
                };
                let scattered = of(&in_order, 1e-3);
                for order in [&in_order as &dyn Fn(u32) -> u32, &mixed] {
                    let variance = of(order, 0.0);
                    assert!(
                        variance < 2.0 * scattered + 0.05,
                        "{builder:?}, {weights:?}: {variance}, scattered by a millimetre {scattered}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_bright_light_among_many_faint_ones_is_drawn_by_its_power_not_by_their_number() {
    let n = 10_000u16;
    let mut lights = LightSet::default();
    lights.push_point(Vec3::new(0.0, 3.0, 0.0), Vec3::ONE);
    let mut rng = sampling::Rng::new(9, 0, 0, sampling::Purpose::Build);
    for _ in 0..n {
        let off = Vec3::new(rng.f32(), rng.f32(), rng.f32()) - 0.5;
        lights.push_point(Vec3::Y * 3.0 + off, Vec3::splat(1.0 / f32::from(n)));
    }
    let x = Receiver::new(Vec3::ZERO, Vec3::Y);
    for builder in TreeBuilder::ALL {
        let tree = LightTree::build(&lights, builder).expect("has lights");
        for weights in NodeWeights::ALL {
            let (pmfs, _) = tree.pmf_below(weights, &x, tree.root());
            let pmf = pmfs.iter().find(|p| p.0.0 == 0).map_or(0.0, |p| p.1);
            assert!((0.3..0.7).contains(&pmf), "{builder:?}, {weights:?}: {pmf}");
        }
    }
}

#[test]
fn parallel_light_is_drawn_by_what_it_brings_however_many_lamps_there_are() {
    let x = Receiver::new(Vec3::ZERO, Vec3::Y);
    for lamps in [1u16, 10, 1000] {
        let mut lights = LightSet::default();
        let mut rng = sampling::Rng::new(9, 0, 0, sampling::Purpose::Build);
        for _ in 0..lamps {
            let off = Vec3::new(rng.f32(), rng.f32(), rng.f32()) - 0.5;
            lights.push_point(
                Vec3::Y * 4.0 + 0.1 * off,
                Vec3::splat(16.0 / f32::from(lamps)),
            );
        }
        // As much as all lamps together, and then a third of that.
        for (irradiance, share) in [(1.0, 0.5), (1.0 / 3.0, 0.25)] {
            let mut lights = lights.clone();
            lights.push_directional(Vec3::NEG_Y, Vec3::splat(irradiance));
            let sun = lights.len() as u32 - 1;
            let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
            for weights in NodeWeights::ALL {
                let (pmfs, _) = tree.pmf_below(weights, &x, tree.root());
                let pmf = pmfs.iter().find(|p| p.0.0 == sun).map_or(0.0, |p| p.1);
                assert!(
                    (pmf - share).abs() < 0.1,
                    "{weights:?}, {lamps} lamps: {pmf} instead of {share}"
                );
            }
        }
    }
}

#[test]
fn a_million_lights_make_a_valid_tree_and_every_draw_is_a_light_of_it() {
    let mut lights = LightSet::default();
    let mut rng = sampling::Rng::new(5, 0, 0, sampling::Purpose::Build);
    for _ in 0..1_000_000 {
        let position = Vec3::new(rng.f32(), rng.f32(), rng.f32()) * 10.0;
        let normal = sampling::uniform_sphere([rng.f32(), rng.f32()]);
        lights.push_virtual(&VirtualLight {
            position,
            normal,
            intensity: Vec3::splat(0.5),
            gloss: None,
        });
    }
    let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
    assert_eq!(tree.validate(&lights), Ok(()), "the tree");
    assert!(tree.bytes() <= 128 * lights.len(), "{} bytes", tree.bytes());
    let at = (Vec3::new(5.0, 0.0, 5.0), Vec3::Y);
    let mut found = 0;
    for _ in 0..1000 {
        let drawn = tree.select(NodeWeights::MinMax, &receiver(at), tree.root(), rng.f64());
        found += i32::from(drawn.is_some_and(|s| s.pmf > 0.0 && s.pmf < 1.0));
    }
    assert!(found > 300, "{found} of 1000 draws found a light");
}
