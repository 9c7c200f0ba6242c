//! Lights in proportion to their power, alike for the whole picture.
//!
//! Source: Shirley, Wang and Zimmerman 1996, "Monte Carlo Techniques for Direct Lighting Calculations", §3.

use std::f64::consts::PI;

use glam::Vec3;
use light_tree::{LightId, LightKind, LightSet, luminance};
use sampling::{AliasTable, Rng};
use serde::Deserialize;

use super::{Count, Method};
use crate::Inputs;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;
use crate::side_by_side::LightSample;

/// Draws `samples` lights, independently, with probabilities in proportion to power. Unbiased; no tree is
/// built.
#[derive(Debug)]
pub struct Power {
    samples: Count,
    /// `None` without lights.
    table: Option<AliasTable>,
}

/// Settings of [`Power`].
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PowerSpec {
    /// Light samples a point, in 1..=65536.
    pub samples: Count,
}

impl<'a> Method<'a> for Power {
    type Spec = PowerSpec;
    type Scratch = ();

    fn prepare(spec: &PowerSpec, inputs: &'a Inputs) -> Self {
        Self {
            samples: spec.samples,
            table: AliasTable::new(powers(&inputs.lights)),
        }
    }

    fn is_unbiased(&self) -> bool {
        true
    }

    fn point<E: LightEval>(&self, x: &GatherPoint, eval: &mut E, rng: &mut Rng, (): &mut ()) {
        let Some(table) = &self.table else { return };
        let samples = f64::from(self.samples.get());
        let draw = |_| {
            let i = table.sample(rng.f64());
            LightSample::new(LightId(i as u32), 1.0 / (samples * table.pmf(i)))
        };
        eval.add(x, (0..self.samples.get()).map(draw));
    }
}

/// Power of each light, W, mean of the channels: 4π I for a point light, π I for a virtual one of cosine emission.
///
/// Parallel light has no power of its own; it counts with what it brings through the disc about the other lights,
/// π R² E for half their box' diagonal R. Where all others are at one place there is no such disc: parallel
/// light as a whole then gets half of the probability.
fn powers(lights: &LightSet) -> Vec<f64> {
    let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (mut placed, mut parallel) = (0.0, 0.0);
    let mut powers: Vec<f64> = lights
        .ids()
        .map(|id| {
            let scalar = f64::from(luminance(lights.intensity(id)));
            let kind = lights.kind(id);
            if kind.is_distant() {
                parallel += scalar;
                return scalar;
            }
            lo = lo.min(lights.position(id));
            hi = hi.max(lights.position(id));
            let power = scalar
                * match kind {
                    LightKind::Virtual => PI,
                    LightKind::Triangle => 2.0 * PI,
                    LightKind::Spot => f64::from(lights.spot(id).solid_angle()),
                    _ => 4.0 * PI,
                };
            placed += power;
            power
        })
        .collect();
    if placed > 0.0 && parallel > 0.0 {
        let radius2 = (hi.as_dvec3() - lo.as_dvec3()).length_squared() / 4.0;
        let section = if radius2 > 0.0 {
            PI * radius2
        } else {
            placed / parallel
        };
        for id in lights.ids() {
            if lights.kind(id).is_distant() {
                powers[id.index()] *= section;
            }
        }
    }
    powers
}

#[cfg(test)]
mod tests {
    use super::*;
    use sampling::Purpose;
    use verify::chi_square;

    fn shares(lights: &LightSet) -> Vec<f64> {
        let table = AliasTable::new(powers(lights)).expect("has lights");
        (0..lights.len()).map(|i| table.pmf(i)).collect()
    }

    fn mixed(scale: f32) -> LightSet {
        let mut set = LightSet::default();
        for (x, i) in [(0.0, 1.0), (3.0, 2.0), (-1.0, 0.25)] {
            let intensity = Vec3::new(i, 0.5 * i, 0.0) * scale * scale;
            set.push_point(Vec3::new(x, 1.0, 2.0 * x) * scale, intensity);
        }
        set.push_directional(Vec3::NEG_Y, Vec3::splat(0.3));
        set
    }

    #[test]
    fn probabilities_do_not_depend_on_the_unit_of_length() {
        let one = shares(&mixed(1.0));
        for k in [-30, -3, 7, 30] {
            assert_eq!(shares(&mixed(2.0f32.powi(k))), one, "at 2^{k}");
        }
    }

    #[test]
    fn parallel_light_has_half_where_all_other_lights_are_at_one_place() {
        let mut set = LightSet::default();
        set.push_point(Vec3::ONE, Vec3::splat(5.0));
        set.push_directional(Vec3::NEG_Y, Vec3::splat(1e-3));
        set.push_directional(Vec3::X, Vec3::splat(3e-3));
        let p = shares(&set);
        assert!(
            (p[0] - 0.5).abs() < 1e-12 && (p[2] / p[1] - 3.0).abs() < 1e-5,
            "{p:?}"
        );
    }

    #[test]
    fn lights_are_drawn_as_often_as_their_power_says() {
        let set = mixed(1.0);
        let table = AliasTable::new(powers(&set)).expect("has lights");
        let mut observed = vec![0; set.len()];
        let mut rng = Rng::new(5, 0, 0, Purpose::Lights);
        for _ in 0..100_000 {
            observed[table.sample(rng.f64())] += 1;
        }
        let fit = chi_square(&observed, &shares(&set));
        assert!(fit.p_value > 1e-6, "{fit:?}");
    }

    #[test]
    fn no_light_has_no_power() {
        assert!(
            AliasTable::new(powers(&LightSet::default())).is_none(),
            "nothing to draw"
        );
    }
}
