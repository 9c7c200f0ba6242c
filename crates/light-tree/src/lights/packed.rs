//! Virtual lights in half a line of the cache each: a million of them are most of what a render keeps, and one that is drawn is a
//! wait for memory.

use glam::Vec3;

use crate::light::{Gloss, VirtualLight};

/// A [`VirtualLight`]. Its normal is rounded, by less than 7·10⁻⁵ radians; all else is kept to the bit.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub(crate) struct PackedLight {
    pub(crate) position: Vec3,
    normal: PackedAxis,
    pub(crate) intensity: Vec3,
    /// Of a matte light the bits of its radius; otherwise [`GLOSSY`] and the place of its [`PackedGloss`].
    rest: u32,
}

/// The sign of a radius, which is not negative.
const GLOSSY: u32 = 1 << 31;

impl PackedLight {
    /// To be overwritten.
    pub(crate) const NOTHING: Self = Self {
        position: Vec3::ZERO,
        normal: PackedAxis(0),
        intensity: Vec3::ZERO,
        rest: 0,
    };

    /// A matte light of radius 0.
    pub(crate) fn of(light: &VirtualLight) -> Self {
        Self {
            position: light.position,
            normal: PackedAxis::of(light.normal),
            intensity: light.intensity,
            rest: 0,
        }
    }

    /// Unit surface normal.
    #[inline(always)]
    pub(crate) fn normal(&self) -> Vec3 {
        self.normal.get()
    }

    /// The place of its gloss; `None` when it is matte.
    #[inline(always)]
    pub(crate) fn gloss(&self) -> Option<usize> {
        (self.rest & GLOSSY != 0).then_some((self.rest & !GLOSSY) as usize)
    }

    /// Makes it a light whose gloss, and radius, is at `place`, below 2³¹.
    pub(crate) fn set_gloss(&mut self, place: usize) {
        self.rest = GLOSSY | place as u32;
    }

    /// The radius of a matte light.
    #[inline(always)]
    pub(crate) fn matte_radius(&self) -> f32 {
        f32::from_bits(self.rest)
    }

    /// Sets the radius of a matte light, ≥ 0.
    pub(crate) fn set_matte_radius(&mut self, radius: f32) {
        self.rest = radius.to_bits() & !GLOSSY;
    }
}

/// A [`Gloss`], with the radius of its light. Directions are rounded as normals are, colours by less than a part in 10⁵.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PackedGloss {
    reflectance: PackedColour,
    diffuse: PackedColour,
    specular: PackedColour,
    incoming: PackedAxis,
    normal: PackedAxis,
    alpha: f32,
    pub(crate) peak: f32,
    pub(crate) radius: f32,
    is_coat: bool,
}

impl PackedGloss {
    pub(crate) fn of(gloss: &Gloss, radius: f32) -> Self {
        Self {
            reflectance: PackedColour::of(gloss.reflectance),
            diffuse: PackedColour::of(gloss.diffuse),
            specular: PackedColour::of(gloss.specular),
            incoming: PackedAxis::of(gloss.incoming),
            normal: PackedAxis::of(gloss.normal),
            alpha: gloss.alpha,
            peak: gloss.peak,
            radius,
            is_coat: gloss.is_coat,
        }
    }

    #[inline]
    pub(crate) fn get(&self) -> Gloss {
        Gloss {
            incoming: self.incoming.get(),
            normal: self.normal.get(),
            reflectance: self.reflectance.get(),
            diffuse: self.diffuse.get(),
            specular: self.specular.get(),
            alpha: self.alpha,
            is_coat: self.is_coat,
            peak: self.peak,
        }
    }
}

/// A unit vector on an octahedron that is unfolded to a square, 16 bits an edge. Vectors along the axes are kept as they are, as
/// most floors and walls have them.
///
/// Source: Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014, §3.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PackedAxis(u32);

/// So many parts are a half of the square's edge.
const PARTS: f32 = 32767.0;

impl PackedAxis {
    /// By how much rounding turns a vector at most, in radians.
    #[cfg(test)]
    const TURNED: f64 = 7e-5;

    /// Of a unit vector; of 0 some vector.
    fn of(axis: Vec3) -> Self {
        let size = axis.abs().element_sum().max(f32::MIN_POSITIVE);
        let (mut x, mut y) = (axis.x / size, axis.y / size);
        if axis.z < 0.0 {
            (x, y) = (
                (1.0 - y.abs()).copysign(axis.x),
                (1.0 - x.abs()).copysign(axis.y),
            );
        }
        let parts = |c: f32| u32::from((c * PARTS).round() as i16 as u16);
        Self(parts(x) | parts(y) << 16)
    }

    #[inline(always)]
    fn get(self) -> Vec3 {
        let parts = |bits: u32| f32::from(bits as u16 as i16);
        let (x, y) = (parts(self.0), parts(self.0 >> 16));
        // Whole numbers, so that nothing is rounded before the end.
        let z = PARTS - x.abs() - y.abs();
        let folded = if z < 0.0 { -z } else { 0.0 };
        let (x, y) = (x - folded.copysign(x), y - folded.copysign(y));
        let scale = 1.0 / (x * x + y * y + z * z).sqrt();
        Vec3::new(x * scale, y * scale, z * scale)
    }
}

/// Three numbers in [0, 2), each in 5 bits of exponent and 16 of mantissa, the first lowest; below 2⁻³¹ is 0.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PackedColour(u64);

/// Bits of a number, and those of an `f32`'s mantissa that it lacks.
const BITS: u32 = 21;
const LACKING: u32 = 7;
/// What the exponent of 2⁻³¹ is to an `f32`, beside the kept bits of its mantissa.
const LEAST: u32 = (127 - 31) << (BITS - 5);

impl PackedColour {
    fn of(colour: Vec3) -> Self {
        let part = |c: f32| {
            let rounded = (c.to_bits() + (1 << (LACKING - 1))) >> LACKING;
            u64::from(rounded.saturating_sub(LEAST).min((1 << BITS) - 1))
        };
        Self(part(colour.x) | part(colour.y) << BITS | part(colour.z) << (2 * BITS))
    }

    #[inline(always)]
    fn get(self) -> Vec3 {
        let part = |i: u32| {
            let part = (self.0 >> (BITS * i)) as u32 & ((1 << BITS) - 1);
            match part {
                0 => 0.0,
                _ => f32::from_bits((part + LEAST) << LACKING),
            }
        };
        Vec3::new(part(0), part(1), part(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_is_half_a_line_and_its_gloss_less_than_one() {
        assert_eq!(size_of::<PackedLight>(), 32);
        assert_eq!(size_of::<PackedGloss>(), 48);
    }

    #[test]
    fn an_axis_is_turned_by_less_than_is_said() {
        let mut greatest = 0.0f64;
        verify::property(20_000, |u| {
            let mut c =
                || Ok(f32::from(u.arbitrary::<i16>()?) + f32::from(u.arbitrary::<i8>()?) / 128.0);
            let axis = Vec3::new(c()?, c()?, c()?)
                .try_normalize()
                .unwrap_or(Vec3::Y);
            let packed = PackedAxis::of(axis).get();
            assert!(packed.is_normalized(), "{axis} became {packed}");
            let turned = axis.as_dvec3().cross(packed.as_dvec3()).length();
            assert!(
                turned < PackedAxis::TURNED && axis.dot(packed) > 0.0,
                "{axis} became {packed}, turned by {turned}"
            );
            greatest = greatest.max(turned);
            Ok(())
        });
        assert!(greatest > 0.5 * PackedAxis::TURNED, "at most {greatest}");
    }

    #[test]
    fn an_axis_along_a_coordinate_is_kept() {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for axis in [axis, -axis] {
                assert_eq!(PackedAxis::of(axis).get(), axis);
            }
        }
        assert!(PackedAxis::of(Vec3::ZERO).get().is_normalized(), "of none");
    }

    #[test]
    fn a_colour_is_rounded_by_less_than_a_part_in_a_hundred_thousand() {
        let mut c = 2e-9f32;
        while c < 1.9 {
            let packed = PackedColour::of(Vec3::new(c, 1.0, 0.25 * c)).get();
            assert!((packed.x - c).abs() < 1e-5 * c, "{c} became {}", packed.x);
            assert_eq!(packed.y, 1.0, "a part of one colour is another's");
            assert!(
                (packed.z - 0.25 * c).abs() < 0.25e-5 * c,
                "{c}: {}",
                packed.z
            );
            c *= 1.000_37;
        }
        assert_eq!(PackedColour::of(Vec3::ZERO).get(), Vec3::ZERO, "none");
        let least = PackedColour::of(Vec3::splat(f32::MIN_POSITIVE)).get();
        assert_eq!(least, Vec3::ZERO, "as good as none");
        let most = PackedColour::of(Vec3::splat(9.0)).get();
        assert!(
            most.max_element() < 2.0 && most.min_element() > 1.99,
            "{most}"
        );
    }
}
