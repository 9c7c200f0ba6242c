//! How far the estimate of a cluster by one light can be off: what the cluster can send at most.
//!
//! Source: Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005, §3.2: material × geometry,
//! with nothing in the way.

use glam::Vec3;
use light_tree::{
    ClusterBound, Falloff, LightKind, LightSet, LightTree, NodeId, Receivers, Representatives,
    luminance,
};
use scene::{Brdf, LobeBound};

use crate::contribution::VirtualShape;
use crate::point::GatherPoint;

/// What a point reflects at most, or the greatest of several.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reflection {
    /// Diffuse BRDF value, sr⁻¹.
    diffuse: Vec3,
    /// `None` for matte surfaces.
    lobe: Option<LobeBound>,
}

impl Reflection {
    pub(crate) fn of(x: &GatherPoint) -> Self {
        let cos_o = x.ns.dot(x.wo);
        Self {
            diffuse: x.brdf.diffuse_bound(cos_o),
            lobe: x.brdf.is_glossy().then(|| x.brdf.lobe_bound(cos_o)),
        }
    }

    /// The greatest of both.
    pub(crate) fn max(&self, other: &Self) -> Self {
        Self {
            diffuse: self.diffuse.max(other.diffuse),
            lobe: match (&self.lobe, &other.lobe) {
                (Some(a), Some(b)) => Some(a.max(b)),
                (a, b) => a.or(*b),
            },
        }
    }

    /// Greatest BRDF × cosine for directions under cosines up to `cos`, and up to `lobe_cos` with the lobe's axis.
    fn value(&self, cos: f32, lobe_cos: f32) -> Vec3 {
        let lobe = self.lobe.map_or(Vec3::ZERO, |lobe| lobe.value(lobe_cos));
        self.diffuse * cos + lobe
    }

    /// Greatest BRDF, likewise.
    fn value_per_cosine(&self, lobe_cos: f32) -> Vec3 {
        let lobe = self
            .lobe
            .map_or(Vec3::ZERO, |lobe| lobe.value(lobe_cos) * lobe.per_cosine);
        self.diffuse + lobe
    }

    /// Greatest BRDF × cosine for any direction, of any channel.
    pub(crate) fn greatest(&self) -> f32 {
        self.value(1.0, 1.0).max_element()
    }
}

/// The clusters that bounds are asked about, and how their lights fall off.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clusters<'a> {
    pub(crate) tree: &'a LightTree,
    pub(crate) representatives: &'a Representatives,
    pub(crate) lights: &'a LightSet,
    pub(crate) shape: VirtualShape,
}

impl Clusters<'_> {
    /// Whether the lights below `id`, all of one kind, are the scene's own.
    pub(crate) fn is_source(&self, id: NodeId) -> bool {
        self.lights.is_source(self.representatives.light(id))
    }

    /// Upper bound of the luminance that the lights below `id`, all of one kind, send by way of any of the
    /// points of together `strength` to the viewer: of the error of an estimate that is not negative and not
    /// above it either.
    ///
    /// 0 only where nothing arrives; +∞ where a point may be at a light.
    pub(crate) fn bound(
        &self,
        at: &Receivers,
        reflection: &Reflection,
        strength: Vec3,
        id: NodeId,
    ) -> f64 {
        let ClusterBound {
            emitted,
            falloff,
            cos,
            lobe_cos,
        } = at.bound(self.tree, id, self.falloff(id));
        if emitted == 0.0 {
            return 0.0;
        }
        let of = self.representatives;
        let intensity = of.intensity(id);
        // What one drawn point stands for may be more than what all points send.
        let drawn = self.lights.peak(self.kind(id));
        let sent = intensity * (emitted * drawn) + of.peak(id);
        let times = |sent: Vec3, reflected: Vec3, geometry: f32| {
            let luminance = f64::from(luminance(strength * sent * reflected));
            // A black surface is black also where the geometry is infinite.
            if luminance > 0.0 {
                luminance * f64::from(geometry)
            } else {
                0.0
            }
        };
        let bound = times(sent, reflection.value(cos, lobe_cos), falloff);
        // The clamp takes the light's cosine along, which a bound of its lobe counts on.
        let is_matte = of.peak(id) == Vec3::ZERO;
        match self.shape {
            VirtualShape::ClampedPoint(clamp)
                if is_matte && self.kind(id) == LightKind::Virtual =>
            {
                let reflected = reflection.value_per_cosine(lobe_cos);
                bound.min(times(intensity, reflected, clamp))
            }
            _ => bound,
        }
    }

    fn kind(&self, id: NodeId) -> LightKind {
        self.lights.kind(self.representatives.light(id))
    }

    fn falloff(&self, id: NodeId) -> Falloff {
        match (self.kind(id), self.shape) {
            (LightKind::Directional | LightKind::Environment, _) => Falloff::None,
            (LightKind::Omni | LightKind::Spot | LightKind::Triangle, _) => Falloff::Point,
            (LightKind::Virtual, VirtualShape::Sphere) => {
                Falloff::Sphere(self.lights.greatest_radius())
            }
            (LightKind::Virtual, VirtualShape::ClampedPoint(_)) => Falloff::VirtualPoint,
        }
    }
}

impl GatherPoint {
    /// The point as error bounds see it.
    pub(crate) fn receivers(&self) -> Receivers {
        Receivers::at(&self.receiver, self.mirror())
    }

    /// Axis of the specular lobe, if there is one.
    pub(crate) fn mirror(&self) -> Option<Vec3> {
        self.brdf
            .is_glossy()
            .then(|| Brdf::lobe_axis(self.ns, self.wo))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contribution::unoccluded;
    use crate::gather_tree::GatherTree;
    use crate::sphere::MOST_STRATEGIES;
    use light_tree::{Gloss, LightId, Receiver, TreeBuilder, VirtualLight};
    use sampling::{Purpose, Rng};
    use scene::{Emitter, Environment, Fresnel, Material, MaterialId, Scene};
    use verify::arbitrary::{Result, Unstructured};

    fn coordinate(u: &mut Unstructured<'_>) -> Result<f32> {
        Ok(match u.int_in_range(0..=4)? {
            0 => 0.0,
            1 => 1.0,
            2 => f32::from(u.arbitrary::<i8>()?) * 1e-6,
            3 => f32::from(u.arbitrary::<i8>()?) / 64.0,
            _ => f32::from(u.arbitrary::<i16>()?) / 256.0,
        })
    }

    fn vector(u: &mut Unstructured<'_>) -> Result<Vec3> {
        Ok(Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?))
    }

    fn unit(u: &mut Unstructured<'_>) -> Result<Vec3> {
        Ok(vector(u)?.try_normalize().unwrap_or(Vec3::Y))
    }

    /// Lights of all kinds, and the scene that those with an extent are in: in heaps, in a plane, all facing one way or
    /// every way.
    fn lights(u: &mut Unstructured<'_>) -> Result<(Scene, LightSet)> {
        let mut scene = Scene::default();
        let colour = |u: &mut Unstructured<'_>| -> Result<Vec3> {
            let mut channel = || Ok(f32::from(u.int_in_range(0..=4_u8)?));
            Ok(Vec3::new(channel()?, channel()?, channel()?))
        };
        for _ in 0..u.int_in_range(0..=8)? {
            scene.emitters.push(Emitter::Point {
                position: vector(u)?,
                intensity: colour(u)?,
            });
        }
        for _ in 0..u.int_in_range(0..=4)? {
            scene.emitters.push(Emitter::Directional {
                direction: unit(u)?,
                irradiance: colour(u)?,
            });
        }
        for _ in 0..u.int_in_range(0..=6)? {
            let cos_outer = [0.999, 0.7, 0.0, -1.0][u.int_in_range(0..=3)?];
            scene.emitters.push(Emitter::Spot {
                position: vector(u)?,
                direction: unit(u)?,
                intensity: colour(u)?,
                cos_inner: if u.arbitrary()? { cos_outer } else { 1.0 },
                cos_outer,
            });
        }
        for _ in 0..u.int_in_range(0..=6)? {
            let radiance = colour(u)?;
            let triangle = scene.mesh.len() as u32;
            let first = scene.mesh.positions.len() as u32;
            for _ in 0..3 {
                scene.mesh.positions.push(vector(u)?);
            }
            scene.mesh.indices.push([first, first + 1, first + 2]);
            scene.mesh.materials.push(MaterialId(triangle));
            scene.materials.push(Material {
                emission: radiance,
                ..Material::default()
            });
            scene.emissive.push(true);
            scene.emitters.push(Emitter::Triangle {
                triangle,
                radiance,
                peak: 1.0,
            });
        }
        if u.arbitrary()? {
            let texels = (0..8).map(|_| colour(u)).collect::<Result<_>>()?;
            scene.environment = Environment::new(4, 2, texels);
        }
        let mut set = vpl::source_lights(&scene);
        let common = if u.arbitrary()? { Some(unit(u)?) } else { None };
        for _ in 0..u.int_in_range(0..=12)? {
            let normal = match common {
                Some(n) => n,
                None => unit(u)?,
            };
            let gloss = if u.ratio(1, 4)? {
                Some(gloss(u, normal)?)
            } else {
                None
            };
            set.push_virtual(&VirtualLight {
                position: vector(u)?,
                normal,
                intensity: colour(u)? * 0.5,
                gloss,
            });
        }
        const RADII: [f32; 5] = [0.0, 1e-3, 0.1, 2.0, 300.0];
        if u.arbitrary()? {
            set.set_radius(RADII[u.int_in_range(0..=4)?]);
        } else {
            let count = set.virtual_count();
            let radii = (0..count).map(|_| Ok(RADII[u.int_in_range(0..=4)?]));
            set.set_radii(radii.collect::<Result<_>>()?);
        }
        Ok((scene, set))
    }

    /// As light tracing stores it.
    fn gloss(u: &mut Unstructured<'_>, normal: Vec3) -> Result<Gloss> {
        let brdf = brdf(u)?;
        let toward = unit(u)?;
        let incoming = if toward.dot(normal) > 0.01 {
            toward
        } else {
            normal
        };
        Ok(vpl::gloss(&brdf, [normal, normal], incoming))
    }

    fn brdf(u: &mut Unstructured<'_>) -> Result<Brdf> {
        Ok(Brdf {
            diffuse: Vec3::new(0.6, 0.0, 0.2) * f32::from(u.int_in_range(0..=1_u8)?),
            specular: Vec3::new(0.3, 0.3, 0.0) * f32::from(u.int_in_range(0..=1_u8)?),
            alpha: [1.0, 0.3, 0.05, 1e-3][u.int_in_range(0..=3)?],
            fresnel: [Fresnel::Constant, Fresnel::Schlick][u.int_in_range(0..=1)?],
        })
    }

    fn gather_point(u: &mut Unstructured<'_>, lights: &LightSet) -> Result<GatherPoint> {
        let mut position = vector(u)?;
        if !lights.is_empty() && u.ratio(1, 3)? {
            position = lights.position(LightId(u.int_in_range(0..=lights.len() as u32 - 1)?));
            if u.arbitrary()? {
                position += vector(u)? * 1e-3;
            }
        }
        let ns = unit(u)?;
        let toward = unit(u)?;
        let wo = if toward.dot(ns) >= 0.0 {
            toward
        } else {
            -toward
        };
        let brdf = brdf(u)?;
        Ok(GatherPoint {
            position,
            ng: ns,
            ns,
            wo,
            brdf,
            strength: Vec3::ONE,
            slot: 0,
            block: 0,
            sample: 0,
            sequence: sampling::Sequence(0),
            bounce: 0,
            light_bounces: u32::MAX,
            shares_hits: false,
            receiver: Receiver::new(position, ns),
        })
    }

    /// How far above its bound a single estimate of a light may be: the bound is that of the integral.
    fn most(lights: &LightSet, shape: VirtualShape, is_glossy: bool) -> f64 {
        if shape == VirtualShape::Sphere && (is_glossy || lights.gloss_count() > 0) {
            f64::from(MOST_STRATEGIES)
        } else {
            1.0
        }
    }

    #[test]
    fn no_light_of_a_cluster_exceeds_its_bound() {
        let mut lit = 0;
        verify::property(1000, |u| {
            let (scene, lights) = lights(u)?;
            let x = gather_point(u, &lights)?;
            let shape = match u.int_in_range(0..=3)? {
                0 => VirtualShape::ClampedPoint(0.5),
                1 => VirtualShape::ClampedPoint(f32::INFINITY),
                _ => VirtualShape::Sphere,
            };
            let builder = *u.choose(&TreeBuilder::ALL)?;
            let Some(tree) = LightTree::build(&lights, builder) else {
                return Ok(());
            };
            let representatives = Representatives::choose(&tree, &lights, 0);
            let clusters = Clusters {
                tree: &tree,
                representatives: &representatives,
                lights: &lights,
                shape,
            };
            let (at, reflection) = (x.receivers(), Reflection::of(&x));
            let most = most(&lights, shape, x.brdf.is_glossy());
            let mut rng = Rng::new(u.arbitrary()?, 0, 0, Purpose::LightSurface);
            let roots = representatives.roots().iter();
            for id in roots.flat_map(|root| tree.nodes_below(*root)) {
                let bound = clusters.bound(&at, &reflection, Vec3::ONE, id);
                assert!(bound >= 0.0, "bound {bound}");
                let truth: f64 = tree
                    .lights_below(id)
                    .filter_map(|l| unoccluded(&scene, &lights, shape, &x, l, &mut rng))
                    .map(|l| f64::from(luminance(l.radiance)))
                    .sum();
                lit += i32::from(truth > 0.0);
                // The sharpest lobe turns a rounding error of 1e-7 of a cosine into 1e-4 of the value;
                // below the least normal number there are no such digits.
                assert!(
                    bound * most >= truth * (1.0 - 1e-3) - 1e-36,
                    "node {}: bound {bound}, truth {truth}, {shape:?}, {x:?}",
                    id.0
                );
            }
            Ok(())
        });
        assert!(lit > 100, "only {lit} lit clusters were looked at");
    }

    #[test]
    fn no_pairs_of_clusters_exceed_their_bound() {
        let mut lit = 0;
        verify::property(1000, |u| {
            let (scene, lights) = lights(u)?;
            let near = gather_point(u, &lights)?;
            let mut points = Vec::new();
            for _ in 0..u.int_in_range(1..=6)? {
                let mut x = gather_point(u, &lights)?;
                if u.arbitrary()? {
                    // A pixel's points are mostly close together.
                    x.position = near.position + vector(u)? * 1e-2;
                    x.receiver = Receiver::new(x.position, x.ns);
                }
                x.strength = Vec3::splat(f32::from(u.int_in_range(0..=2_u8)?));
                points.push(x);
            }
            let shape = if u.arbitrary()? {
                VirtualShape::ClampedPoint(0.5)
            } else {
                VirtualShape::Sphere
            };
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            let representatives = Representatives::choose(&tree, &lights, 0);
            let clusters = Clusters {
                tree: &tree,
                representatives: &representatives,
                lights: &lights,
                shape,
            };
            let mut rng = Rng::new(u.arbitrary()?, 0, 0, Purpose::LightSurface);
            let most = most(&lights, shape, points.iter().any(|x| x.brdf.is_glossy()));
            let mut gather = GatherTree::default();
            let Some(root) = gather.build(&points, 1.0) else {
                return Ok(());
            };
            let mut below = vec![Vec::new(); gather.len()];
            for id in gather.ids() {
                let node = gather.node(id);
                below[id.index()] = match node.children {
                    None => vec![gather.first_point(id)],
                    Some([a, b]) => [a, b].map(|c| below[c.index()].clone()).concat(),
                };
            }
            assert_eq!(below[root.index()].len(), points.len(), "all points");
            let roots = representatives.roots().iter();
            for light in roots.flat_map(|root| tree.nodes_below(*root)) {
                for g in gather.ids() {
                    let node = gather.node(g);
                    let strength = node.strength.as_vec3();
                    let bound = clusters.bound(&node.receivers, &node.reflection, strength, light);
                    let mut truth = 0.0;
                    for l in tree.lights_below(light) {
                        for x in below[g.index()].iter().map(|i| &points[*i]) {
                            truth += unoccluded(&scene, &lights, shape, x, l, &mut rng)
                                .map_or(0.0, |l| f64::from(luminance(l.radiance * x.strength)));
                        }
                    }
                    lit += i32::from(truth > 0.0);
                    assert!(
                        bound * most >= truth * (1.0 - 1e-3) - 1e-36,
                        "node {}: bound {bound}, truth {truth}, {shape:?}, {points:?}",
                        light.0
                    );
                }
            }
            Ok(())
        });
        assert!(lit > 100, "only {lit} lit clusters were looked at");
    }
}
