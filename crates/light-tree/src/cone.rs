//! Cones of directions.

use std::f64::consts::PI;

use glam::Vec3;

/// All directions within a half angle of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Unit axis; any unit vector when the cone holds every direction.
    pub axis: Vec3,
    /// Cosine of the half angle: 1 for one direction, −1 for every direction.
    pub cos: f32,
}

/// Added to every merged half angle, in radians, so that rounding never excludes a direction.
const SLACK: f64 = 2e-6;
/// Sine of the angle below which the direction from one f32 axis to another is rounding error. What is then
/// not turned is covered by [`SLACK`].
const LEAST_ACROSS: f64 = 1e-6;

impl Cone {
    /// Every direction.
    pub const SPHERE: Self = Self {
        axis: Vec3::Z,
        cos: -1.0,
    };

    /// Just `axis`, a unit vector; every direction when it has no length (omni lights).
    pub fn of(axis: Vec3) -> Self {
        if axis.length_squared() > 0.25 {
            Self { axis, cos: 1.0 }
        } else {
            Self::SPHERE
        }
    }

    /// A cone that holds both, the smallest one up to rounding.
    ///
    /// Equal, opposite and nearly equal axes are all sound; opposite ones give every direction.
    pub fn union(self, other: Self) -> Self {
        let (wide, narrow) = if self.cos <= other.cos {
            (self, other)
        } else {
            (other, self)
        };
        let (theta_wide, theta_narrow) = (half_angle(wide.cos), half_angle(narrow.cos));
        let between = angle_between(wide.axis, narrow.axis);
        if between + theta_narrow <= theta_wide {
            return wide;
        }
        let theta = 0.5 * (theta_wide + between + theta_narrow);
        if theta + SLACK >= PI {
            return Self::SPHERE;
        }
        // Turn the wide axis toward the narrow one. The part of `narrow` across `wide` has length
        // sin(between): for equal axes there is nothing to turn to, for opposite ones no one direction.
        let (from, to) = (wide.axis.as_dvec3(), narrow.axis.as_dvec3());
        let across = to - from * (from.dot(to) / from.length_squared());
        let turn = theta - theta_wide;
        let axis = if across.length() > LEAST_ACROSS {
            (from * turn.cos() + across.normalize() * turn.sin())
                .normalize()
                .as_vec3()
        } else if between < 1.0 {
            wide.axis
        } else {
            return Self::SPHERE;
        };
        // Rounded toward the wider angle: near 1 an f32 cosine is good to 3·10⁻⁴ radians only.
        Self {
            axis,
            cos: ((theta + SLACK).cos() as f32).next_down(),
        }
    }

    /// The opposite directions.
    pub(crate) fn opposite(self) -> Self {
        Self {
            axis: -self.axis,
            ..self
        }
    }

    /// Whether unit `direction` lies inside.
    pub fn contains(&self, direction: Vec3) -> bool {
        angle_between(self.axis, direction) <= half_angle(self.cos) + SLACK
    }

    /// Whether all of `other` lies inside.
    pub(crate) fn holds(&self, other: &Self) -> bool {
        let reach = angle_between(self.axis, other.axis) + half_angle(other.cos);
        // The axis of a whole sphere says nothing.
        self.cos <= -1.0 || reach <= half_angle(self.cos) + SLACK
    }
}

/// Half angle of a cone.
fn half_angle(cos: f32) -> f64 {
    // Of a light alone, as it is of half of all that are joined.
    if cos >= 1.0 {
        return 0.0;
    }
    f64::from(cos).clamp(-1.0, 1.0).acos()
}

/// Angle between unit vectors, accurate for tiny and for nearly straight angles (Kahan).
fn angle_between(a: Vec3, b: Vec3) -> f64 {
    let (a, b) = (a.as_dvec3(), b.as_dvec3());
    2.0 * (a - b).length().atan2((a + b).length())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(u: &mut verify::arbitrary::Unstructured<'_>) -> verify::arbitrary::Result<Vec3> {
        let mut c = || -> verify::arbitrary::Result<f32> {
            Ok(match u.int_in_range(0..=4)? {
                0 => 0.0,
                1 => 1.0,
                2 => -1.0,
                3 => 1e-7 * f32::from(u.arbitrary::<i8>()?),
                _ => f32::from(u.arbitrary::<i16>()?) / 32768.0,
            })
        };
        Ok(Vec3::new(c()?, c()?, c()?)
            .try_normalize()
            .unwrap_or(Vec3::X))
    }

    #[test]
    fn a_union_holds_both_cones() {
        verify::property(1000, |u| {
            let mut cone = Cone::of(unit(u)?);
            let mut members = vec![cone.axis];
            for _ in 0..u.int_in_range(1..=6)? {
                let axis = if u.ratio(1, 4)? {
                    -members[0]
                } else {
                    unit(u)?
                };
                members.push(axis);
                cone = if u.arbitrary()? {
                    cone.union(Cone::of(axis))
                } else {
                    Cone::of(axis).union(cone)
                };
                assert!(
                    cone.axis.is_normalized() && cone.cos.is_finite(),
                    "{cone:?}"
                );
                for m in &members {
                    assert!(cone.contains(*m), "{cone:?} lacks {m}");
                }
            }
            Ok(())
        });
    }

    #[test]
    fn equal_axes_stay_narrow_and_opposite_ones_open_up() {
        let narrow = Cone::of(Vec3::X).union(Cone::of(Vec3::X));
        assert!(narrow.cos > 0.999_999, "{narrow:?}");
        let open = Cone::of(Vec3::X).union(Cone::of(Vec3::NEG_X));
        assert!(
            open.contains(Vec3::Y) && open.contains(Vec3::NEG_Z),
            "{open:?}"
        );
        assert_eq!(
            Cone::of(Vec3::ZERO),
            Cone::SPHERE,
            "no axis, every direction"
        );
    }
}
