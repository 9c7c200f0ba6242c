//! Lights of one point, evaluated side by side.
//!
//! What most lights are, virtual spheres and points, is worked out for sixteen at a time by the operations of
//! [`unoccluded`], in their order, and so to the same bits, whatever the processor's vectors are. What is rare is left to that
//! function: lights with an extent, spots, clamped points, coats.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use light_tree::{LightId, LightKind, LightSet};
use sampling::Rng;
use scene::trace::Ray;
use scene::{Fresnel, Scene};

use crate::contribution::{Unoccluded, VirtualShape, unoccluded};
use crate::learned::Trial;
use crate::lobe_lanes::{FEW, Lobe, LobeLanes};
use crate::point::GatherPoint;
use crate::vsl::Subtended;
use crate::width::by_width;

/// Lights side by side: a number of each fills a register of AVX-512.
pub(crate) const LANES: usize = 16;

/// A number of each light.
type Lanes = [f32; LANES];

/// A light that was chosen for a point.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// Which light.
    pub light: LightId,
    /// What its radiance is multiplied by: 1 over the probability of having chosen it.
    pub scale: f64,
    /// Where what comes of it is noted.
    pub trial: Trial,
}

impl LightSample {
    /// A light of which nothing is noted.
    #[inline]
    pub fn new(light: LightId, scale: f64) -> Self {
        Self {
            light,
            scale,
            trial: Trial::NONE,
        }
    }
}

/// What lights are evaluated in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct World<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) lights: &'a LightSet,
    pub(crate) shape: VirtualShape,
}

/// A point, as lights side by side see it.
#[derive(Debug)]
pub(crate) struct Seen {
    pub(crate) position: Vec3,
    pub(crate) ng: Vec3,
    pub(crate) ns: Vec3,
    pub(crate) wo: Vec3,
    /// The constant part of the BRDF's value, sr⁻¹.
    pub(crate) constant: Vec3,
    pub(crate) specular: Vec3,
    /// Squared roughness.
    pub(crate) alpha2: f32,
    pub(crate) is_glossy: bool,
    /// Greatest density of its lobe, sr⁻¹; 0 where it has none.
    pub(crate) greatest_pdf: f32,
    strength: Vec3,
    light_bounces: u32,
    /// Whether points are evaluated side by side here, and virtual lights.
    takes_points: bool,
    takes_virtual: bool,
}

impl Seen {
    #[inline]
    pub(crate) fn of(x: &GatherPoint, shape: VirtualShape) -> Self {
        let is_glossy = x.brdf.is_glossy();
        let is_constant = x.brdf.fresnel == Fresnel::Constant;
        Self {
            position: x.position,
            ng: x.ng,
            ns: x.ns,
            wo: x.wo,
            constant: x.brdf.diffuse * FRAC_1_PI,
            specular: x.brdf.specular,
            alpha2: x.brdf.alpha * x.brdf.alpha,
            is_glossy,
            greatest_pdf: match is_glossy {
                true => x.brdf.greatest_specular_pdf(x.ns.dot(x.wo)),
                false => 0.0,
            },
            strength: x.strength,
            light_bounces: x.light_bounces,
            takes_points: is_constant,
            takes_virtual: is_constant && shape == VirtualShape::Sphere,
        }
    }
}

/// The `k`-th of vectors side by side.
#[inline(always)]
pub(crate) fn vector<const N: usize>(lanes: &[[f32; N]; 3], k: usize) -> Vec3 {
    Vec3::new(lanes[0][k], lanes[1][k], lanes[2][k])
}

/// Sets the `k`-th of vectors side by side.
#[inline(always)]
pub(crate) fn set_vector<const N: usize>(lanes: &mut [[f32; N]; 3], k: usize, v: Vec3) {
    lanes[0][k] = v.x;
    lanes[1][k] = v.y;
    lanes[2][k] = v.z;
}

/// What lights are.
#[derive(Debug, Default)]
#[repr(C, align(64))]
struct Given {
    position: [Lanes; 3],
    /// Of a virtual light.
    normal: [Lanes; 3],
    intensity: [Lanes; 3],
    radius: Lanes,
    scale: [f64; LANES],
}

/// How lights lie about the point.
#[derive(Debug, Default)]
#[repr(C, align(64))]
pub(crate) struct Placed {
    /// Unit direction.
    pub(crate) axis: [Lanes; 3],
    /// 1 − cosine of half the angle under which a sphere is seen.
    pub(crate) one_minus_cos: Lanes,
    /// [`Subtended::spread`].
    pub(crate) spread: Lanes,
    /// [`Subtended::cosine_integral`].
    pub(crate) integral: Lanes,
    /// cos / d² of a point.
    share: Lanes,
}

/// What is told of lights, a bit each.
#[derive(Debug, Default, Clone, Copy)]
struct Told {
    /// The light is not above both horizons of the point.
    is_below: u32,
    /// The point is not above the horizon of the light.
    is_behind: u32,
    /// All of the sphere is above both horizons.
    is_whole: u32,
    /// The square of the distance underflows.
    is_near: u32,
}

/// What lights bring.
#[derive(Debug, Default)]
#[repr(C, align(64))]
struct Brought {
    /// Of virtual lights of intensity 1 that have no closed form.
    reflected: [Lanes; 3],
    radiance: [Lanes; 3],
    /// What is added to the pixel sample.
    value: [Lanes; 3],
}

/// What is told of values, a bit each.
#[derive(Debug, Default, Clone, Copy)]
struct Outcome {
    /// Not finite.
    is_refused: u32,
    /// Finite and not zero.
    is_bright: u32,
}

/// Which lights are evaluated how, a bit each.
#[derive(Debug, Default, Clone, Copy)]
struct Ways {
    /// Side by side.
    points: u32,
    spheres: u32,
    /// The spheres of surfaces with a lobe.
    glossy: u32,
    /// Alone.
    alone: u32,
}

/// Up to [`LANES`] lights of one point. Lanes that hold none have any numbers, and count for nothing.
#[derive(Debug)]
pub(crate) struct SideBySide {
    count: usize,
    samples: [LightSample; LANES],
    ways: Ways,
    given: Given,
    placed: Placed,
    brought: Brought,
    lobes: [LobeLanes; LANES / FEW],
    /// Those of [`Ways::alone`].
    alone: [Option<Unoccluded>; LANES],
    outcome: Outcome,
}

impl Default for SideBySide {
    fn default() -> Self {
        Self {
            count: 0,
            samples: [LightSample::new(LightId(0), 0.0); LANES],
            ways: Ways::default(),
            given: Given::default(),
            placed: Placed::default(),
            brought: Brought::default(),
            lobes: Default::default(),
            alone: Default::default(),
            outcome: Outcome::default(),
        }
    }
}

/// A light that brings something unless something is in the way.
#[derive(Debug)]
pub(crate) struct Lit {
    pub(crate) sample: LightSample,
    pub(crate) radiance: Vec3,
    /// What it adds to the pixel sample: finite, and not zero.
    pub(crate) value: Vec3,
    pub(crate) shadow_ray: Ray,
}

impl SideBySide {
    /// Takes the next of `samples`, as many as there are lanes; returns them.
    #[inline]
    pub(crate) fn take(
        &mut self,
        lights: &LightSet,
        x: &Seen,
        samples: &mut impl Iterator<Item = LightSample>,
    ) -> &[LightSample] {
        self.count = 0;
        self.ways = Ways::default();
        while self.count < LANES {
            let Some(sample) = samples.next() else { break };
            let (k, id) = (self.count, sample.light);
            self.count += 1;
            self.samples[k] = sample;
            let given = &mut self.given;
            given.scale[k] = sample.scale;
            let bit = 1 << k;
            match lights.kind(id) {
                LightKind::Virtual if x.takes_virtual => {
                    if lights.bounces(id) > x.light_bounces {
                        continue;
                    }
                    set_vector(&mut given.normal, k, lights.axis(id));
                    given.radius[k] = lights.radius(id);
                    self.ways.spheres |= bit;
                    self.ways.glossy |= u32::from(lights.is_glossy(id)) << k;
                }
                LightKind::Omni if x.takes_points => self.ways.points |= bit,
                _ => {
                    self.ways.alone |= bit;
                    continue;
                }
            }
            set_vector(&mut given.position, k, lights.position(id));
            set_vector(&mut given.intensity, k, lights.intensity(id));
        }
        &self.samples[..self.count]
    }

    /// Works out what the lights that were taken bring to `x`, which is seen as `seen`. As in [`unoccluded`], numbers are
    /// drawn from `rng` by those that need them, in their order.
    pub(crate) fn evaluate(
        &mut self,
        world: &World<'_>,
        x: &GatherPoint,
        seen: &Seen,
        rng: &mut Rng,
    ) {
        let Ways {
            points,
            spheres,
            glossy,
            mut alone,
        } = self.ways;
        let told = place(&self.given, seen, &mut self.placed);
        let lit = !told.is_below & (points | spheres & !told.is_behind);
        alone |= lit & told.is_near;
        let lit = lit & !told.is_near;
        let has_lobe = if seen.is_glossy { u32::MAX } else { glossy };
        let mut estimated = lit & spheres & (has_lobe | !told.is_whole);
        let mut count = 0;
        for k in bits(estimated) {
            let id = self.samples[k].light;
            let gloss = world.lights.gloss(id);
            if gloss.is_some_and(|gloss| gloss.is_coat || gloss.specular == Vec3::ZERO) {
                alone |= 1 << k;
                continue;
            }
            let normal = vector(&self.given.normal, k);
            let is_whole = told.is_whole >> k & 1 != 0;
            let lanes = &mut self.lobes[count / FEW];
            lanes.set(count % FEW, (&self.placed, k), is_whole, normal, gloss);
            count += 1;
        }
        estimated &= !alone;
        let groups = count.div_ceil(FEW);
        for lanes in &mut self.lobes[..groups] {
            lanes.begin(seen);
        }
        let mut next = 0;
        for k in bits(estimated | alone) {
            if alone >> k & 1 != 0 {
                let (lights, id) = (world.lights, self.samples[k].light);
                self.alone[k] = unoccluded(world.scene, lights, world.shape, x, id, rng);
            } else {
                self.lobes[next / FEW].draw(next % FEW, x, rng);
                next += 1;
            }
        }
        for lanes in &mut self.lobes[..groups] {
            lanes.finish(seen);
        }
        for (j, k) in bits(estimated).enumerate() {
            let reflected = vector(&self.lobes[j / FEW].reflected, j % FEW);
            set_vector(&mut self.brought.reflected, k, reflected);
        }
        let Outcome {
            is_refused,
            is_bright,
        } = bring(
            &self.given,
            &self.placed,
            seen,
            [points, estimated],
            &mut self.brought,
        );
        self.outcome = Outcome {
            is_refused: is_refused & lit & !alone,
            is_bright: is_bright & lit & !alone,
        };
        self.ways.alone = alone;
        for k in bits(alone) {
            let Some(light) = self.alone[k] else { continue };
            set_vector(&mut self.brought.radiance, k, light.radiance);
            match light.adds(x, self.samples[k].scale) {
                None => self.outcome.is_refused |= 1 << k,
                Some(Vec3::ZERO) => {}
                Some(value) => {
                    self.outcome.is_bright |= 1 << k;
                    set_vector(&mut self.brought.value, k, value);
                }
            }
        }
    }

    /// How many values were not finite.
    #[inline]
    pub(crate) fn refused(&self) -> u32 {
        self.outcome.is_refused.count_ones()
    }

    /// What the lights add to the pixel sample that bring something, in their order.
    #[inline]
    pub(crate) fn values(&self) -> impl Iterator<Item = Vec3> {
        bits(self.outcome.is_bright).map(|k| vector(&self.brought.value, k))
    }

    /// The lights that bring something to `x`, in their order.
    #[inline]
    pub(crate) fn brought(&self, x: &GatherPoint) -> impl Iterator<Item = Lit> {
        bits(self.outcome.is_bright).map(|k| {
            let between = Ray::between(x.position, vector(&self.given.position, k));
            let alone = match self.ways.alone >> k & 1 {
                0 => None,
                _ => self.alone[k],
            };
            Lit {
                sample: self.samples[k],
                radiance: vector(&self.brought.radiance, k),
                value: vector(&self.brought.value, k),
                shadow_ray: alone.map_or(between, |light| light.shadow_ray),
            }
        })
    }
}

/// The numbers of the bits that are set, from the lowest.
#[inline]
fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (bit < 32).then_some(bit)
    })
}

by_width!(place = place_with(given: &Given, x: &Seen, placed: &mut Placed) -> Told);

#[inline(always)]
fn place_with(given: &Given, x: &Seen, placed: &mut Placed) -> Told {
    let mut told = Told {
        is_below: 0,
        is_behind: 0,
        is_whole: 0,
        is_near: 0,
    };
    for k in 0..LANES {
        let offset = vector(&given.position, k) - x.position;
        let toward = -vector(&given.normal, k);
        let dist2 = offset.length_squared();
        let dist = dist2.sqrt();
        let cone = Subtended::along(offset / dist, dist, dist2, given.radius[k]);
        let (cos_x, cos_light) = (x.ns.dot(cone.axis), toward.dot(cone.axis));
        set_vector(&mut placed.axis, k, cone.axis);
        placed.one_minus_cos[k] = cone.one_minus_cos;
        placed.spread[k] = cone.spread();
        placed.integral[k] = cone.cosine_integral(x.ns, toward, cos_x, cos_light);
        placed.share[k] = cos_x / dist2;
        let is_below = (x.ns.dot(offset) <= 0.0) | (x.ng.dot(offset) <= 0.0);
        let is_behind = vector(&given.normal, k).dot(offset) >= 0.0;
        let is_whole = cone.is_above(cos_x) & cone.is_above(cos_light);
        let is_near = dist2 <= f32::MIN_POSITIVE;
        told.is_below |= u32::from(is_below) << k;
        told.is_behind |= u32::from(is_behind) << k;
        told.is_whole |= u32::from(is_whole) << k;
        told.is_near |= u32::from(is_near) << k;
    }
    told
}

by_width!(bring = bring_with(
    given: &Given,
    placed: &Placed,
    x: &Seen,
    ways: [u32; 2],
    brought: &mut Brought
) -> Outcome);

#[inline(always)]
fn bring_with(
    given: &Given,
    placed: &Placed,
    x: &Seen,
    ways: [u32; 2],
    brought: &mut Brought,
) -> Outcome {
    match x.is_glossy && ways[0] != 0 {
        true => bring_for::<true>(given, placed, x, ways, brought),
        false => bring_for::<false>(given, placed, x, ways, brought),
    }
}

/// [`bring_with`], where points may meet a lobe, or not.
#[inline(always)]
fn bring_for<const LOBE: bool>(
    given: &Given,
    placed: &Placed,
    x: &Seen,
    [points, estimated]: [u32; 2],
    brought: &mut Brought,
) -> Outcome {
    let mut outcome = Outcome {
        is_refused: 0,
        is_bright: 0,
    };
    let is_black = (x.constant.x == 0.0) & (x.constant.y == 0.0) & (x.constant.z == 0.0);
    for k in 0..LANES {
        let intensity = vector(&given.intensity, k);
        let exact = x.constant * placed.integral[k];
        let exact = if is_black { Vec3::ZERO } else { exact };
        let is_estimated = estimated >> k & 1 != 0;
        let reflected = if is_estimated {
            vector(&brought.reflected, k)
        } else {
            exact
        };
        let of_sphere = intensity * reflected;
        let mut brdf = x.constant;
        if LOBE {
            brdf += x.specular * Lobe::of(x.ns, x.alpha2, x.wo, vector(&placed.axis, k)).value;
        }
        let of_point = brdf * intensity * placed.share[k];
        let radiance = if points >> k & 1 != 0 {
            of_point
        } else {
            of_sphere
        };
        set_vector(&mut brought.radiance, k, radiance);
        // As in `Unoccluded::adds`.
        let value = radiance * x.strength;
        let scale = given.scale[k];
        let value = Vec3::new(
            (f64::from(value.x) * scale) as f32,
            (f64::from(value.y) * scale) as f32,
            (f64::from(value.z) * scale) as f32,
        );
        set_vector(&mut brought.value, k, value);
        let is_dark = (radiance.x == 0.0) & (radiance.y == 0.0) & (radiance.z == 0.0);
        let is_finite = value.x.is_finite() & value.y.is_finite() & value.z.is_finite();
        let is_zero = (value.x == 0.0) & (value.y == 0.0) & (value.z == 0.0);
        outcome.is_refused |= u32::from(!is_dark & !is_finite) << k;
        outcome.is_bright |= u32::from(!is_dark & is_finite & !is_zero) << k;
    }
    outcome
}

#[cfg(test)]
mod tests {
    use light_tree::{Gloss, Receiver, SpotCone, VirtualLight};
    use sampling::Purpose;
    use scene::Brdf;
    use verify::arbitrary::{Result, Unstructured};

    use super::*;
    use crate::width::{WIDEST, Width};

    /// Ties, wild magnitudes and plain numbers.
    fn coordinate(u: &mut Unstructured<'_>) -> Result<f32> {
        Ok(match u.int_in_range(0..=5)? {
            0 => 0.0,
            1 => *u.choose(&[1.0, -1.0])?,
            2 => f32::from(u.arbitrary::<i8>()?) * *u.choose(&[1e-30, 1e-22, 1e-12, 1e9])?,
            _ => f32::from(u.arbitrary::<i16>()?) * 1e-4,
        })
    }

    fn any_vector(u: &mut Unstructured<'_>) -> Result<Vec3> {
        Ok(Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?))
    }

    fn direction(u: &mut Unstructured<'_>) -> Result<Vec3> {
        // In f64, where no square underflows.
        let any = any_vector(u)?.as_dvec3();
        Ok(any.normalize_or(glam::DVec3::Y).as_vec3())
    }

    fn share(u: &mut Unstructured<'_>) -> Result<Vec3> {
        let mut channel = || Ok(*u.choose(&[0.0, 0.3, 0.5, 1e-30])?);
        Ok(Vec3::new(channel()?, channel()?, channel()?))
    }

    fn any_brdf(u: &mut Unstructured<'_>) -> Result<Brdf> {
        let matte = Brdf::lambert(share(u)?);
        if u.arbitrary()? {
            return Ok(matte);
        }
        Ok(Brdf {
            specular: share(u)?,
            alpha: *u.choose(&[1e-3, 0.05, 0.3, 1.0])?,
            fresnel: match u.ratio(1, 8)? {
                true => Fresnel::Schlick,
                false => Fresnel::Constant,
            },
            ..matte
        })
    }

    fn any_point(u: &mut Unstructured<'_>) -> Result<GatherPoint> {
        let (position, ns) = (any_vector(u)?, direction(u)?);
        Ok(GatherPoint {
            position,
            ng: if u.ratio(3, 4)? { ns } else { direction(u)? },
            ns,
            wo: direction(u)?,
            brdf: any_brdf(u)?,
            strength: *u.choose(&[Vec3::ONE, Vec3::new(0.5, 0.1, 0.0)])?,
            slot: 0,
            block: 0,
            sample: 0,
            sequence: sampling::Sequence(0),
            bounce: 0,
            light_bounces: *u.choose(&[u32::MAX, 2])?,
            shares_hits: false,
            receiver: Receiver::new(position, ns),
        })
    }

    /// Lights of all kinds that need no scene, many of them near `x` or on it.
    fn any_lights(u: &mut Unstructured<'_>, x: &GatherPoint) -> Result<LightSet> {
        let mut set = LightSet::default();
        for _ in 0..u.int_in_range(0..=4)? {
            let (position, axis) = (any_vector(u)?, direction(u)?);
            let intensity = share(u)?;
            let spot = SpotCone {
                cos_inner: 0.9,
                cos_outer: 0.1,
            };
            match u.int_in_range(0..=3)? {
                0 => set.push_directional(axis, intensity),
                1 => set.push_spot(position, axis, intensity, spot),
                _ => set.push_point(position, intensity),
            };
        }
        let (mut radii, mut bounces) = (Vec::new(), Vec::new());
        for _ in 0..u.int_in_range(0..=40)? {
            let offset = any_vector(u)?;
            let normal = direction(u)?;
            let brdf = any_brdf(u)?;
            let incoming = direction(u)?;
            let gloss = Gloss {
                incoming,
                normal: if u.arbitrary()? {
                    normal
                } else {
                    direction(u)?
                },
                reflectance: share(u)?,
                diffuse: brdf.diffuse,
                specular: brdf.specular,
                alpha: brdf.alpha,
                is_coat: brdf.fresnel == Fresnel::Schlick,
                peak: 1.0,
            };
            let light = VirtualLight {
                position: x.position + offset,
                normal: if u.arbitrary()? {
                    -offset.normalize_or(normal)
                } else {
                    normal
                },
                intensity: share(u)? * *u.choose(&[1.0, 1e-20, 1e20])?,
                gloss: if u.arbitrary()? { Some(gloss) } else { None },
            };
            if set.push_virtual(&light) {
                let near = offset.length() * *u.choose(&[0.3, 0.999, 1.0, 2.0])?;
                let radius = *u.choose(&[0.0, 1e-30, 1e-3, 0.1, 1.0, near])?;
                radii.push(if radius.is_finite() { radius } else { 0.0 });
                bounces.push(u.int_in_range(0..=3)?);
            }
        }
        set.set_radii(radii);
        set.set_bounces(bounces);
        Ok(set)
    }

    /// What came of a light: its number, and the bits of radiance, value and ray.
    type Came = (usize, [u32; 9]);

    fn came(k: usize, radiance: Vec3, value: Vec3, ray: Ray) -> Came {
        let [a, b, c] = radiance.to_array();
        let [d, e, f] = value.to_array();
        let [g, h, i] = ray.direction.to_array();
        (k, [a, b, c, d, e, f, g, h, i].map(f32::to_bits))
    }

    #[test]
    fn lights_side_by_side_bring_what_each_brings_alone() {
        let scene = Scene::default();
        let mut counts = [0; 4];
        verify::property(4000, |u| {
            let x = any_point(u)?;
            let lights = any_lights(u, &x)?;
            let shape = *u.choose(&[
                VirtualShape::Sphere,
                VirtualShape::Sphere,
                VirtualShape::ClampedPoint(3.0),
            ])?;
            let scales = [1.0, 0.37, 1e-60, 1e60, 1e300];
            let sample =
                |id: LightId| LightSample::new(id, scales[id.0 as usize * 7 % 11 % scales.len()]);
            let world = World {
                scene: &scene,
                lights: &lights,
                shape,
            };
            let stream = || Rng::new(3, lights.len() as u64, 0, Purpose::LightSurface);

            let (mut rng, mut alone, mut refused) = (stream(), Vec::new(), 0);
            for id in lights.ids() {
                let Some(light) = unoccluded(&scene, &lights, shape, &x, id, &mut rng) else {
                    continue;
                };
                match light.adds(&x, sample(id).scale) {
                    Some(value) if value == Vec3::ZERO => {}
                    Some(value) => {
                        alone.push(came(id.index(), light.radiance, value, light.shadow_ray));
                    }
                    None => refused += 1,
                }
            }

            WIDEST.set(*u.choose(&[Width::Any, Width::Avx2, Width::Avx512])?);
            let (mut their_rng, mut together, mut they_refused) = (stream(), Vec::new(), 0);
            let mut side_by_side = SideBySide::default();
            let seen = Seen::of(&x, shape);
            let mut samples = lights.ids().map(sample);
            let (mut taken, mut left) = (0, 0);
            loop {
                let some = side_by_side.take(&lights, &seen, &mut samples).len();
                if some == 0 {
                    break;
                }
                taken += some;
                side_by_side.evaluate(&world, &x, &seen, &mut their_rng);
                they_refused += side_by_side.refused();
                left += side_by_side.ways.alone.count_ones();
                for brought in side_by_side.brought(&x) {
                    let (id, ray) = (brought.sample.light, brought.shadow_ray);
                    together.push(came(id.index(), brought.radiance, brought.value, ray));
                }
            }
            assert_eq!(taken, lights.len(), "all are taken");
            assert_eq!(together, alone, "{shape:?} {x:?} {lights:?}");
            assert_eq!(they_refused, refused, "{shape:?} {x:?} {lights:?}");
            assert_eq!(rng.u32(), their_rng.u32(), "as many numbers are drawn");
            let is_matte = u32::from(!x.brdf.is_glossy());
            for (count, more) in counts.iter_mut().zip([
                is_matte * alone.len() as u32,
                (1 - is_matte) * alone.len() as u32,
                refused,
                left,
            ]) {
                *count += more;
            }
            Ok(())
        });
        assert!(counts.iter().all(|&count| count > 100), "{counts:?}");
    }
}
