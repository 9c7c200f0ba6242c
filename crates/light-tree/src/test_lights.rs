//! Lights and receivers that tests draw, biased to ties, flat boxes and wild magnitudes.

use arbtest::arbitrary::{Result, Unstructured};
use glam::Vec3;

use crate::bounds::Receiver;
use crate::lights::{LightId, LightKind, LightSet, VirtualLight, luminance};

pub(crate) fn coordinate(u: &mut Unstructured<'_>) -> Result<f32> {
    Ok(match u.int_in_range(0..=3)? {
        0 => 0.0,
        1 => 1.0,
        2 => f32::from(u.arbitrary::<i8>()?) * 1e-6,
        _ => f32::from(u.arbitrary::<i16>()?),
    })
}

pub(crate) fn any_lights(u: &mut Unstructured<'_>) -> Result<LightSet> {
    let mut set = LightSet::default();
    for _ in 0..u.int_in_range(0..=12)? {
        let i = if u.ratio(1, 8)? {
            1e-30
        } else {
            f32::from(u.arbitrary::<u8>()?)
        };
        let p = Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?);
        if u.ratio(1, 4)? {
            set.push_directional(p.try_normalize().unwrap_or(Vec3::X), Vec3::splat(i));
        } else {
            set.push_point(p, Vec3::splat(i));
        }
    }
    for _ in 0..u.int_in_range(0..=24)? {
        let p = Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?);
        let n = Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?)
            .try_normalize()
            .unwrap_or(Vec3::Y);
        set.push_virtual(&VirtualLight {
            position: p,
            normal: n,
            intensity: Vec3::splat(f32::from(u.arbitrary::<u8>()?)) * 0.5,
            gloss: None,
        });
    }
    Ok(set)
}

/// Contributions up to this are 0 in the renderer's f32.
pub(crate) const BLACK: f64 = 1e-37;

/// A receiver anywhere, often on a light or in the plane of some.
pub(crate) fn any_receiver(u: &mut Unstructured<'_>, lights: &LightSet) -> Result<(Vec3, Vec3)> {
    let mut position = Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?);
    if !lights.is_empty() && u.ratio(1, 4)? {
        position = lights.position(LightId(u.int_in_range(0..=lights.len() as u32 - 1)?));
    }
    let normal = Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?);
    Ok((position, normal.try_normalize().unwrap_or(Vec3::Z)))
}

/// What a light brings a white Lambertian receiver, up to a constant and without visibility.
pub(crate) fn contribution(lights: &LightSet, id: LightId, position: Vec3, normal: Vec3) -> f64 {
    let scalar = f64::from(luminance(lights.intensity(id)));
    if lights.kind(id) == LightKind::Directional {
        return scalar * f64::from(-lights.axis(id).dot(normal)).max(0.0);
    }
    let offset = lights.position(id) - position;
    // The renderer's horizon rule, in its own arithmetic.
    if normal.dot(offset) <= 0.0 {
        return 0.0;
    }
    let d = offset.as_dvec3();
    let cos = normal.as_dvec3().dot(d) / d.length();
    let emitted = match lights.kind(id) {
        LightKind::Virtual => (-lights.axis(id).as_dvec3().dot(d) / d.length()).max(0.0),
        _ => 1.0,
    };
    scalar * cos * emitted / d.length_squared()
}

/// `n` virtual lights on the six inner walls of a cube of side 2.
pub(crate) fn lights_on_walls(n: u32) -> LightSet {
    let mut rng = sampling::Rng::new(11, 0, 0, sampling::Purpose::Build);
    let mut set = LightSet::default();
    for i in 0..n {
        let axis = (i % 3) as usize;
        let side = if i % 6 < 3 { 1.0 } else { -1.0 };
        let mut position = Vec3::new(rng.f32(), rng.f32(), rng.f32()) * 2.0 - 1.0;
        position[axis] = side;
        let mut normal = Vec3::ZERO;
        normal[axis] = -side;
        set.push_virtual(&VirtualLight {
            position,
            normal,
            intensity: Vec3::splat(0.1 + rng.f32()) * 0.5,
            gloss: None,
        });
    }
    set
}

/// The receiver that weights and bounds take.
pub(crate) fn receiver((position, normal): (Vec3, Vec3)) -> Receiver {
    Receiver::new(position, normal)
}
