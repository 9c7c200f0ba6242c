//! Where the lights of a cluster shine.

use glam::Vec3;

use crate::bounds::widened_cos;
use crate::cone::Cone;

/// How light leaves a light whose axis is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Profile {
    /// At most with the cosine of the angle to an axis in the cone: virtual lights, and whatever is mixed. A cone of
    /// every direction says nothing, as for omni lights.
    #[default]
    Cosine,
    /// Only in directions inside the cone: spot lights.
    Beam,
    /// With the cosine of the angle to an axis in the cone or to its opposite: triangles.
    BothSides,
}

/// A cone of axes with what it says about where light goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Emission {
    /// The axes; for distant light the directions in which it travels.
    pub cone: Cone,
    /// What they mean.
    pub profile: Profile,
}

impl Emission {
    /// Of lights about which nothing is known.
    pub const ANY: Self = Self {
        cone: Cone::SPHERE,
        profile: Profile::Cosine,
    };

    /// Of both clusters together.
    pub(crate) fn union(self, other: Self) -> Self {
        if self.profile == other.profile {
            // An axis may be taken for its opposite: the nearer one gives the narrower cone.
            let turned =
                self.profile == Profile::BothSides && self.cone.axis.dot(other.cone.axis) < 0.0;
            let cone = if turned {
                other.cone.opposite()
            } else {
                other.cone
            };
            return Self {
                cone: self.cone.union(cone),
                ..self
            };
        }
        Self {
            cone: self.as_cosine().union(other.as_cosine()),
            profile: Profile::Cosine,
        }
    }

    /// A cone to which cosine emission bounds this one. A beam is no brighter inside its cone, and dark outside.
    pub(crate) fn as_cosine(self) -> Cone {
        match self.profile {
            Profile::Cosine | Profile::Beam => self.cone,
            Profile::BothSides => Cone::SPHERE,
        }
    }

    /// Whether what is known of this cluster holds for the `part` as well.
    pub(crate) fn holds(&self, part: &Self) -> bool {
        if self.profile != part.profile {
            return self.profile == Profile::Cosine && self.cone.holds(&part.as_cosine());
        }
        let turned = self.profile == Profile::BothSides && self.cone.holds(&part.cone.opposite());
        turned || self.cone.holds(&part.cone)
    }

    /// Whether nothing is known of directions.
    #[inline]
    pub(crate) fn is_any(&self) -> bool {
        self.cone.cos <= -1.0
    }

    /// Whether the cone is so wide, a right angle or more, that it says little about cosines.
    #[inline]
    pub(crate) fn is_wide(&self) -> bool {
        self.cone.cos <= 0.0 && self.profile != Profile::Beam
    }

    /// Upper bound, in [0, 1], of the share of its intensity that a light of the cluster sends in some directions; 0
    /// only where nothing is sent. `cos_along` gives an upper bound of the signed cosine between an axis and any of the
    /// directions.
    #[inline]
    pub(crate) fn bound(&self, cos_along: impl Fn(Vec3) -> f32) -> f32 {
        let Cone { axis, cos } = self.cone;
        match self.profile {
            Profile::Beam => f32::from(u8::from(cos_along(axis) >= cos - SLACK)),
            Profile::Cosine => widened_cos(cos_along(axis), cos),
            Profile::BothSides => {
                let along = widened_cos(cos_along(axis), cos);
                along.max(widened_cos(cos_along(-axis), cos))
            }
        }
    }
}

/// What rounding may take off a cosine.
pub(crate) const SLACK: f32 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;
    use sampling::{Purpose, Rng, uniform_sphere};

    /// What a light about `axis` sends toward unit `direction`.
    fn sent(profile: Profile, axis: Cone, direction: Vec3) -> f32 {
        let cos = axis.axis.dot(direction);
        match profile {
            Profile::Cosine => cos.max(0.0),
            Profile::Beam => f32::from(u8::from(cos >= axis.cos)),
            Profile::BothSides => cos.abs(),
        }
    }

    #[test]
    fn a_union_bounds_what_each_part_sends() {
        let mut rng = Rng::new(2, 0, 0, Purpose::Build);
        let (mut dark, mut lit) = (0, 0);
        for _ in 0..4000 {
            // Axes about one direction, or anywhere.
            let spread = rng.f32() * rng.f32() * 2.0;
            let about = uniform_sphere([rng.f32(), rng.f32()]);
            let profiles = [Profile::Cosine, Profile::Beam, Profile::BothSides];
            let first = (rng.f32() * 3.0) as usize;
            let mixed = rng.f32() < 0.3;
            let mut parts = Vec::new();
            for i in 0..1 + (rng.f32() * 4.0) as usize {
                let axis = about + spread * uniform_sphere([rng.f32(), rng.f32()]);
                let profile = profiles[(first + if mixed { i } else { 0 }) % 3];
                let mut cone = Cone::of(axis.normalize_or(about));
                if profile == Profile::Beam {
                    cone.cos = 1.0 - rng.f32() * rng.f32();
                }
                if profile == Profile::BothSides && rng.f32() < 0.5 {
                    cone = cone.opposite();
                }
                parts.push(Emission { cone, profile });
            }
            let all = parts.iter().copied().reduce(Emission::union);
            let all = all.expect("at least one part");
            for _ in 0..8 {
                let direction = uniform_sphere([rng.f32(), rng.f32()]);
                let bound = all.bound(|axis| axis.dot(direction));
                for part in &parts {
                    let truth = sent(part.profile, part.cone, direction);
                    assert!(bound >= truth - 2e-6, "{bound} below {truth}: {parts:?}");
                }
                dark += u32::from(bound == 0.0);
                lit += u32::from(bound > 0.0);
            }
        }
        assert!(dark > 2000 && lit > 2000, "{dark} dark, {lit} lit");
    }

    #[test]
    fn beams_stay_beams_and_sides_stay_sides() {
        let of = |axis, profile| Emission {
            cone: Cone::of(axis),
            profile,
        };
        let beams = of(Vec3::X, Profile::Beam).union(of(Vec3::X, Profile::Beam));
        assert_eq!(beams.bound(|a| a.dot(Vec3::Y)), 0.0, "beside a beam");
        let sides = of(Vec3::X, Profile::BothSides).union(of(Vec3::NEG_X, Profile::BothSides));
        assert!(sides.bound(|a| a.dot(Vec3::Y)) < 1e-3, "edge on: {sides:?}");
        let mixed = sides.union(beams);
        assert_eq!(mixed.bound(|a| a.dot(Vec3::Y)), 1.0, "nothing known");
    }
}
