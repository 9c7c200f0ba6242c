//! Lights and receivers that tests draw, biased to ties, flat boxes and wild magnitudes.

use glam::Vec3;
use verify::arbitrary::{Result, Unstructured};

use crate::bounds::Receiver;
use crate::build::TreeBuilder;
use crate::cone::Cone;
use crate::light::{
    EnvironmentCell, LightId, LightKind, SpotCone, TriangleLight, VirtualLight, luminance,
};
use crate::lights::LightSet;
use crate::tree::LightTree;
use crate::wide::WideTree;

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
        let axis = p.try_normalize().unwrap_or(Vec3::X);
        let colour = Vec3::splat(i);
        match u.int_in_range(0..=7)? {
            0 => set.push_directional(axis, colour),
            1 => set.push_environment(&EnvironmentCell {
                travel: Cone {
                    axis,
                    cos: [1.0, 0.99, 0.5, -1.0][u.int_in_range(0..=3)?],
                },
                irradiance: colour,
                peak: 1.0,
                element: 0,
            }),
            2 => set.push_triangle(&TriangleLight {
                corners: [p, p + any_offset(u)?, p + any_offset(u)?],
                intensity: colour,
                peak: 1.0,
                offset: 0.0,
                element: 0,
            }),
            3 => {
                let cos_outer = [1.0, 0.999, 0.5, 0.0, -0.5, -1.0][u.int_in_range(0..=5)?];
                let cos_inner = if u.arbitrary()? { cos_outer } else { 1.0 };
                let cone = SpotCone {
                    cos_inner,
                    cos_outer,
                };
                set.push_spot(p + any_offset(u)?, axis, colour, cone)
            }
            _ => set.push_point(p, colour),
        };
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

fn any_offset(u: &mut Unstructured<'_>) -> Result<Vec3> {
    Ok(Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?))
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

/// What a light brings a white Lambertian receiver, up to a constant and without visibility; of a light that has an
/// extent, the most that one of a few of its points or directions brings.
pub(crate) fn contribution(lights: &LightSet, id: LightId, position: Vec3, normal: Vec3) -> f64 {
    let scalar = f64::from(luminance(lights.intensity(id)));
    if lights.kind(id).is_distant() {
        let cone = lights.emission(id).cone;
        let (t, b) = cone.axis.any_orthonormal_pair();
        let across = (1.0 - cone.cos * cone.cos).max(0.0).sqrt() * 0.999;
        let brings = [Vec3::ZERO, t, b, -t, -b].map(|edge| {
            let travel = (cone.axis * cone.cos.max(-0.99) + edge * across).normalize();
            scalar * f64::from(-travel.dot(normal)).max(0.0)
        });
        return brings.into_iter().fold(0.0, f64::max);
    }
    let centre = lights.position(id);
    let points = match lights.kind(id) {
        LightKind::Triangle => {
            let (lo, hi) = lights.bounds(id).expect("a place");
            // Two corners that the triangle has are corners of its box, or on its edges.
            [
                centre,
                centre.lerp(lo, 0.3).clamp(lo, hi),
                centre.lerp(hi, 0.3).clamp(lo, hi),
            ]
        }
        _ => [centre; 3],
    };
    let brings = points.map(|point| {
        let offset = point - position;
        // The renderer's horizon rule, in its own arithmetic.
        if normal.dot(offset) <= 0.0 {
            return 0.0;
        }
        let d = offset.as_dvec3();
        let cos = normal.as_dvec3().dot(d) / d.length();
        let along = -lights.axis(id).as_dvec3().dot(d) / d.length();
        let emitted = match lights.kind(id) {
            LightKind::Virtual => along.max(0.0),
            LightKind::Triangle => along.abs(),
            LightKind::Spot => f64::from(lights.spot(id).falloff(along as f32)),
            _ => 1.0,
        };
        scalar * cos * emitted / d.length_squared()
    });
    brings.into_iter().fold(0.0, f64::max)
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

/// The eight-way tree that stratified lightcuts have by default; `None` without lights.
pub(crate) fn wide(lights: &LightSet) -> Option<WideTree> {
    let tree = LightTree::build(lights, TreeBuilder::Binned)?;
    Some(WideTree::collapse(&tree, lights))
}
