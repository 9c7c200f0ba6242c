//! Points that one of them stands for.

/// How much points may differ from a [`Receiver`](crate::Receiver) that stands for them; all 0 for itself alone.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Region {
    /// Greatest distance from the receiver, ≥ 0 and finite, in scene units.
    pub radius: f32,
    /// Greatest distance from the plane through the receiver, across its normal; ≥ 0, and no more than the radius.
    pub lift: f32,
    /// Greatest length of the difference of unit normals, in 0..=2.
    pub tilt: f32,
}

impl Region {
    /// The same in other units of length.
    pub(crate) fn scaled(self, scale: f32) -> Self {
        Self {
            radius: self.radius * scale,
            lift: self.lift * scale,
            tilt: self.tilt,
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};
    use sampling::{Purpose, Rng};
    use verify::arbitrary::{Result, Unstructured};
    use verify::z_test;

    use super::*;
    use crate::block::Cluster;
    use crate::bounds::Receiver;
    use crate::descent::Descents;
    use crate::draws::Draws;
    use crate::light::LightId;
    use crate::lobe::Lobe;
    use crate::shared_cut::SharedCut;
    use crate::test_lights::{
        BLACK, any_lights, any_receiver, contribution, coordinate, lights_on_walls, receiver, wide,
    };
    use crate::wide::WideTree;

    /// A point of the region around `centre`, often at its edge.
    fn any_point(
        u: &mut Unstructured<'_>,
        centre: (Vec3, Vec3),
        region: Region,
    ) -> Result<(Vec3, Vec3)> {
        let share =
            |u: &mut Unstructured<'_>| Ok([-0.999, -0.5, 0.0, 0.7, 0.999][u.int_in_range(0..=4)?]);
        let (position, normal) = centre;
        let (t, b) = normal.any_orthonormal_pair();
        let turn = Quat::from_axis_angle(normal, f32::from(u.arbitrary::<u8>()?));
        let up = region.lift * share(u)?;
        let across = (region.radius * region.radius - up * up).max(0.0).sqrt() * share(u)?;
        let angle = 2.0 * (0.5 * region.tilt * share(u)?).asin();
        let tilted = Quat::from_axis_angle(turn * b, angle) * normal;
        Ok((
            position + turn * t * across + normal * up,
            tilted.normalize(),
        ))
    }

    /// Clusters with the weight that each has for `at`, which is of the region that was weighed.
    fn weighed(
        cut: &SharedCut,
        tree: &WideTree,
        at: &Receiver,
        draws: &mut Draws,
    ) -> Vec<(Cluster, f32)> {
        draws.left.clone_from(&draws.weights);
        cut.weigh_near(tree, at, draws);
        let rows = draws.rows.iter().zip(&draws.left);
        let lanes = rows.flat_map(|(row, weights)| {
            let clusters = *cut.clusters(tree, *row);
            clusters.into_iter().zip(*weights)
        });
        lanes.filter(|(_, weight)| *weight > 0.0).collect()
    }

    #[test]
    fn whatever_lights_a_point_of_the_region_can_be_drawn_for_it() {
        let mut checked = 0;
        verify::property(3000, |u| {
            let lights = any_lights(u)?;
            let centre = any_receiver(u, &lights)?;
            let radius = coordinate(u)?.abs();
            let region = Region {
                radius,
                lift: radius * [0.0, 0.03, 1.0][u.int_in_range(0..=2)?],
                tilt: [0.0, 0.1, 1.0][u.int_in_range(0..=2)?],
            };
            let at = any_point(u, centre, region)?;
            let (centre, point) = (receiver(centre).with_region(region), receiver(at));
            let Some(tree) = wide(&lights) else {
                return Ok(());
            };
            if !centre.stands_for(&point) {
                return Ok(());
            }
            let mut cut = SharedCut::default();
            cut.refine(&tree, &[centre], u.int_in_range(1..=20)?);
            let mut draws = Draws::default();
            cut.weigh(&tree, &centre, &mut draws);
            cut.open(&tree, &centre, 10, u.int_in_range(1..=200)?, &mut draws);
            let all: f64 = lights
                .ids()
                .map(|id| contribution(&lights, id, at.0, at.1))
                .sum();
            let black = BLACK.max(1e-25 * all);
            let drawn: Vec<LightId> = weighed(&cut, &tree, &point, &mut draws)
                .into_iter()
                .flat_map(|(cluster, _)| tree.pmf_below(&point, cluster).0)
                .filter(|(_, pmf)| *pmf > 0.0)
                .map(|(light, _)| light)
                .collect();
            for id in lights.ids() {
                let lit = contribution(&lights, id, at.0, at.1);
                checked += u32::from(lit > black);
                assert!(
                    lit <= black || drawn.contains(&id),
                    "{id:?} brings {lit} to {at:?}, never drawn by {centre:?}"
                );
            }
            Ok(())
        });
        assert!(checked > 3000, "{checked} lights");
    }

    const CENTRE: (Vec3, Vec3) = (Vec3::new(0.2, -0.93, 0.9), Vec3::Y);
    const REGION: Region = Region {
        radius: 0.2,
        lift: 0.02,
        tilt: 0.1,
    };

    /// Points of the region; the third is twenty times as near to the next wall as its midst.
    fn points() -> [(Vec3, Vec3); 4] {
        let (p, n) = CENTRE;
        let tilted = Quat::from_rotation_z(0.09) * n;
        [
            CENTRE,
            (p + 0.19 * Vec3::X, n),
            (p + 0.095 * Vec3::Z, n),
            (p - 0.15 * Vec3::X - 0.01 * n, tilted),
        ]
    }

    #[test]
    fn light_of_points_that_share_weights_averages_to_that_of_all_lights() {
        let lights = lights_on_walls(2000);
        let tree = wide(&lights).expect("has lights");
        let lobe = Lobe {
            axis: Vec3::Y,
            diffuse: 0.02,
            near: 0.25,
            far: 0.0,
            far_sin2: 1.0,
            alpha2: 0.01,
        };
        let rounds = 20_000;
        for centre in [receiver(CENTRE), receiver(CENTRE).with_lobe(lobe)] {
            let centre = centre.with_region(REGION);
            let mut cut = SharedCut::default();
            cut.refine(&tree, &[centre], 30);
            let (mut draws, mut descents) = (Draws::default(), Descents::default());
            cut.weigh(&tree, &centre, &mut draws);
            let factors: Vec<f32> = (0..cut.len()).map(|i| 0.5 + (i % 4) as f32).collect();
            draws.scale(&factors);
            cut.open(&tree, &centre, 8, 100, &mut draws);
            cut.settle(&tree, 8, &mut draws);
            assert!(
                draws.near > 0 && draws.near < draws.rows.len(),
                "some are near"
            );
            for at in points() {
                let mut x = receiver(at);
                if let Some(lobe) = centre.lobe() {
                    x = x.with_lobe(*lobe);
                }
                assert!(centre.stands_for(&x), "{at:?}");
                let brings = |id| contribution(&lights, id, at.0, at.1);
                let exact: f64 = lights.ids().map(brings).sum();
                let mut rng = Rng::new(5, 0, 0, Purpose::Lights);
                let (mut sum, mut squares) = (0.0, 0.0);
                for _ in 0..rounds {
                    let drawn = cut.draw(&tree, &x, rng.f64(), &mut draws, &mut descents);
                    let drawn = drawn.iter().flatten();
                    let estimate: f64 = drawn.map(|d| brings(d.light) / d.expected).sum();
                    sum += estimate;
                    squares += estimate * estimate;
                }
                let n = f64::from(rounds);
                let mean = sum / n;
                // 4.5 sigma over 8 cases: false alarm 6e-5.
                let z = z_test(mean, (squares / n - mean * mean) / n, exact);
                assert!(
                    z.abs() < 4.5,
                    "{mean} instead of {exact} at {at:?}, z = {z}"
                );
            }
        }
    }

    #[test]
    fn near_lights_are_weighed_for_each_point_and_the_others_once() {
        let lights = lights_on_walls(20_000);
        let tree = wide(&lights).expect("has lights");
        let centre = receiver(CENTRE).with_region(REGION);
        let mut cut = SharedCut::default();
        cut.refine(&tree, &[centre], 128);
        let mut draws = Draws::default();
        cut.weigh(&tree, &centre, &mut draws);
        draws.scale(&vec![2.0; cut.len()]);
        cut.open(&tree, &centre, 10, 1000, &mut draws);
        for at in points() {
            let x = receiver(at);
            let worth = draws.total() as f32 / 10.0;
            let shared = weighed(&cut, &tree, &x, &mut draws);
            // Of all, for this point alone.
            let mut own = Draws::default();
            tree.weigh_all(&tree.unpacked(), &x, &mut own);
            let mut near = 0;
            for (block, weights) in tree.blocks.iter().zip(&own.weights) {
                for (cluster, own) in block.clusters.iter().zip(weights) {
                    let Some((_, weight)) = shared.iter().find(|(c, _)| c == cluster) else {
                        continue;
                    };
                    let own = 2.0 * own;
                    near += u32::from(*weight == own);
                    // What is worth little may be off by more.
                    assert!(
                        weight.max(own) < worth || (0.2..5.0).contains(&(weight / own)),
                        "{weight} instead of {own} at {at:?}"
                    );
                }
            }
            assert!(near > 0, "some are near");
        }
    }

    #[test]
    fn a_receiver_stands_for_what_is_near_and_alike() {
        let centre = receiver(CENTRE).with_region(REGION);
        for at in points() {
            assert!(centre.stands_for(&receiver(at)), "{at:?}");
        }
        let (p, n) = CENTRE;
        for at in [
            (p + 0.21 * Vec3::X, n),
            (p + 0.03 * n, n),
            (p, Quat::from_rotation_x(0.11) * n),
            (p, -n),
        ] {
            assert!(!centre.stands_for(&receiver(at)), "{at:?}");
        }
        let lobe = |diffuse, alpha2| Lobe {
            axis: n,
            diffuse,
            near: 0.2,
            far: 0.0,
            far_sin2: 1.0,
            alpha2,
        };
        let glossy = |diffuse, alpha2| receiver(CENTRE).with_lobe(lobe(diffuse, alpha2));
        let centre = glossy(0.3, 0.04).with_region(REGION);
        assert!(centre.stands_for(&glossy(0.25, 0.03)), "about alike");
        for other in [glossy(0.3, 0.1), glossy(0.0, 0.04), receiver(CENTRE)] {
            assert!(!centre.stands_for(&other), "{other:?}");
        }
        assert!(
            !receiver(CENTRE).stands_for(&receiver((p + 1e-3 * Vec3::X, n))),
            "itself alone"
        );
    }
}
