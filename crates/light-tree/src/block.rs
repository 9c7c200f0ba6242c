//! Eight clusters, weighed all at once.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3A;
use sampling::ggx_density;

use crate::bounds::Receiver;
use crate::cone::Cone;
use crate::light::LightId;
use crate::region::Region;

/// Children of a node: their numbers fill a register of eight lanes.
pub(crate) const WIDTH: usize = 8;
pub(crate) type Lanes = [f32; WIDTH];

/// A cluster: a light, or a node of a [`WideTree`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cluster(pub(crate) u32);

/// Set in a [`Cluster`] that is a light alone, whose other bits are its id.
const LIGHT: u32 = 1 << 31;
/// No cluster: more lights than a tree holds.
const UNUSED: u32 = u32::MAX;

impl Cluster {
    /// A light alone.
    pub(crate) fn of_light(light: LightId) -> Self {
        Self(LIGHT | light.0)
    }

    /// The light, where the cluster is one.
    #[inline]
    pub fn light(self) -> Option<LightId> {
        (self.0 & LIGHT != 0).then_some(LightId(self.0 & !LIGHT))
    }

    /// Whether there is none.
    #[inline]
    pub(crate) fn is_unused(self) -> bool {
        self.0 == UNUSED
    }

    /// The block that holds its children, where it is not a light alone.
    #[inline]
    pub(crate) fn block(self) -> Option<usize> {
        (self.0 & LIGHT == 0).then_some(self.0 as usize)
    }
}

/// Eight clusters, or as many of several blocks, number by number. Lengths are in units of [`WideTree::scale`], intensities shares of
/// the whole.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(crate) struct Block<const N: usize = WIDTH> {
    pub(crate) lo: [[f32; N]; 3],
    pub(crate) hi: [[f32; N]; 3],
    /// Emission axis, or travel direction, and the cosine of the cone about it.
    pub(crate) axis: [[f32; N]; 3],
    pub(crate) cos: [f32; N],
    /// ‖I‖.
    pub(crate) intensity: [f32; N],
    pub(crate) clusters: [Cluster; N],
    /// Greatest radius of the spheres.
    pub(crate) radius: [f32; N],
    /// Square of the distance at which the nearest of the lights is to be expected, seen from among them, and no less
    /// than what the smallest of the spheres counts as.
    pub(crate) near2: [f32; N],
}

impl<const N: usize> Block<N> {
    /// No clusters: weights of 0.
    pub(crate) const EMPTY: Self = Self {
        lo: [[0.0; N]; 3],
        hi: [[0.0; N]; 3],
        axis: [[0.0; N]; 3],
        cos: [-1.0; N],
        intensity: [0.0; N],
        radius: [0.0; N],
        near2: [LEAST_DIST2; N],
        clusters: [Cluster(UNUSED); N],
    };
}

impl Block {
    /// Number of clusters.
    pub(crate) fn len(&self) -> usize {
        self.clusters.iter().filter(|c| !c.is_unused()).count()
    }

    /// Copies cluster `from` of `other` to place `to`.
    pub(crate) fn take(&mut self, to: usize, other: &Self, from: usize) {
        for axis in 0..3 {
            self.lo[axis][to] = other.lo[axis][from];
            self.hi[axis][to] = other.hi[axis][from];
            self.axis[axis][to] = other.axis[axis][from];
        }
        self.cos[to] = other.cos[from];
        self.radius[to] = other.radius[from];
        self.near2[to] = other.near2[from];
        self.intensity[to] = other.intensity[from];
        self.clusters[to] = other.clusters[from];
    }
}

/// A point that is lit, in the units of a [`WideTree`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    pub(crate) position: Vec3A,
    pub(crate) normal: Vec3A,
    pub(crate) lobe: Option<SeenLobe>,
    /// What it stands for, if for more than itself.
    pub(crate) region: Option<Region>,
}

/// The lobe of a glossy point, as a share of all that it reflects. What Fresnel reflection adds far off the mirror direction is
/// left out: an estimate may be low where it matters little.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeenLobe {
    axis: Vec3A,
    /// Of a matte surface that reflects as much this were 1.
    diffuse: f32,
    /// Times the density of facets.
    near: f32,
    pub(crate) alpha2: f32,
}

impl SeenLobe {
    /// What a matte point has.
    pub(crate) const NONE: Self = Self {
        axis: Vec3A::ZERO,
        diffuse: 1.0,
        near: 0.0,
        alpha2: 1.0,
    };

    pub(crate) fn of(receiver: &Receiver) -> Option<Self> {
        let lobe = receiver.lobe()?;
        let axis = Vec3A::from(lobe.axis);
        // Directions lie four times as densely as the facets that mirror them, times the cosine.
        let cos = receiver.normal().dot(axis).max(0.0);
        let all = lobe.diffuse + 4.0 * FRAC_1_PI * lobe.near * cos;
        (all > 0.0 && all.is_finite()).then(|| Self {
            axis,
            diffuse: lobe.diffuse / all,
            near: lobe.near / all,
            alpha2: lobe.alpha2,
        })
    }

    /// Whether what is weighed by it is about what `other` reflects: nothing of that more than about twice as much.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let covers = |has: f32, wants: f32| wants <= 2.0 * has + 0.05;
        covers(self.diffuse, other.diffuse)
            && covers(1.0 - self.diffuse, 1.0 - other.diffuse)
            && other.alpha2 <= 2.0 * self.alpha2
            && self.alpha2 <= 2.0 * other.alpha2
    }
}

/// The points that a block's clusters are weighed for, lane by lane.
pub(crate) trait Viewers: Copy {
    /// Coordinate of the position.
    fn position(&self, axis: usize, lane: usize) -> f32;
    /// Coordinate of the normal.
    fn normal(&self, axis: usize, lane: usize) -> f32;
    /// Coordinate of the lobe's axis.
    fn lobe_axis(&self, axis: usize, lane: usize) -> f32;
    /// [`SeenLobe::diffuse`].
    fn diffuse(&self, lane: usize) -> f32;
    /// [`SeenLobe::near`].
    fn facets(&self, lane: usize) -> f32;
    /// [`SeenLobe::alpha2`].
    fn alpha2(&self, lane: usize) -> f32;
}

/// One point in all lanes. A copy: what lies behind a reference is read anew where the compiler sees a branch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Viewer {
    position: Vec3A,
    normal: Vec3A,
    lobe: SeenLobe,
}

impl Viewer {
    #[inline(always)]
    pub(crate) fn of(seen: &Seen) -> Self {
        Self {
            position: seen.position,
            normal: seen.normal,
            lobe: seen.lobe.unwrap_or(SeenLobe::NONE),
        }
    }
}

impl Viewers for Viewer {
    #[inline(always)]
    fn position(&self, axis: usize, _: usize) -> f32 {
        self.position[axis]
    }
    #[inline(always)]
    fn normal(&self, axis: usize, _: usize) -> f32 {
        self.normal[axis]
    }
    #[inline(always)]
    fn lobe_axis(&self, axis: usize, _: usize) -> f32 {
        self.lobe.axis[axis]
    }
    #[inline(always)]
    fn diffuse(&self, _: usize) -> f32 {
        self.lobe.diffuse
    }
    #[inline(always)]
    fn facets(&self, _: usize) -> f32 {
        self.lobe.near
    }
    #[inline(always)]
    fn alpha2(&self, _: usize) -> f32 {
        self.lobe.alpha2
    }
}

/// As many points as blocks, each in eight lanes.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct ViewerLanes<const N: usize> {
    position: [[f32; N]; 3],
    normal: [[f32; N]; 3],
    lobe_axis: [[f32; N]; 3],
    diffuse: [f32; N],
    facets: [f32; N],
    alpha2: [f32; N],
}

impl<const N: usize> ViewerLanes<N> {
    pub(crate) const NONE: Self = Self {
        position: [[0.0; N]; 3],
        normal: [[0.0; N]; 3],
        lobe_axis: [[0.0; N]; 3],
        diffuse: [0.0; N],
        facets: [0.0; N],
        alpha2: [1.0; N],
    };

    /// Puts a point into the eight lanes from `first` on.
    #[inline(always)]
    pub(crate) fn put(&mut self, seen: &Seen, first: usize) {
        let Viewer {
            position,
            normal,
            lobe,
        } = Viewer::of(seen);
        for k in first..first + WIDTH {
            for axis in 0..3 {
                self.position[axis][k] = position[axis];
                self.normal[axis][k] = normal[axis];
                self.lobe_axis[axis][k] = lobe.axis[axis];
            }
            self.diffuse[k] = lobe.diffuse;
            self.facets[k] = lobe.near;
            self.alpha2[k] = lobe.alpha2;
        }
    }
}

impl<const N: usize> Viewers for &ViewerLanes<N> {
    #[inline(always)]
    fn position(&self, axis: usize, lane: usize) -> f32 {
        self.position[axis][lane]
    }
    #[inline(always)]
    fn normal(&self, axis: usize, lane: usize) -> f32 {
        self.normal[axis][lane]
    }
    #[inline(always)]
    fn lobe_axis(&self, axis: usize, lane: usize) -> f32 {
        self.lobe_axis[axis][lane]
    }
    #[inline(always)]
    fn diffuse(&self, lane: usize) -> f32 {
        self.diffuse[lane]
    }
    #[inline(always)]
    fn facets(&self, lane: usize) -> f32 {
        self.facets[lane]
    }
    #[inline(always)]
    fn alpha2(&self, lane: usize) -> f32 {
        self.alpha2[lane]
    }
}

/// Weights of eight clusters, or of as many more.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weighed<const N: usize = WIDTH> {
    pub(crate) weights: [f32; N],
    /// What each would weigh, were all its lights where they bring most.
    pub(crate) peaks: [f32; N],
    /// How many times as much a light at the nearest point may bring to another point of the region.
    pub(crate) swings: [f32; N],
    /// > 0 where the lights are so far off, and shine so much alike, that only their intensities tell them apart.
    pub(crate) alike: [f32; N],
}

impl<const N: usize> Weighed<N> {
    /// Zeros. A derived default is a call in the midst of vector code.
    const NONE: Self = Self {
        weights: [0.0; N],
        peaks: [0.0; N],
        swings: [0.0; N],
        alike: [0.0; N],
    };
}

/// Squared distances below this, in units of the box around all lights, count alike: 1/d⁴ stays finite.
pub(crate) const LEAST_DIST2: f32 = 1e-14;

/// Squared distances below this share of the squared diagonal of all lights count alike in a bound, so that one near
/// light does not claim the whole cut.
const NEAREST2: f32 = 1e-4;
/// Weights beyond this are no more than this: their sums stay finite.
const GREATEST: f32 = 1e30;
/// A cluster weighs at least this share of what it would if all its lights were where they bring most: where it is lit by a
/// corner of its box alone, what is drawn there by chance would count for thousands of times as much.
const LEAST_OF_MOST: f32 = 0.005;
/// Lights are far off the squared half diagonal of whose cluster is less than this share of its squared distance: a fifth of the
/// distance, or of the lobe's width.
const FAR2: f32 = 0.04;
/// Cosine of the widest cone of normals, or of axes, of lights that shine alike.
const ALIKE: f32 = 0.95;
/// Relative slack of reaches, so that rounding never makes a lit box dark.
const SLACK: f32 = 2e-6;
/// What rounding may add to the cosine of a cone: a cosine of 1 stands for angles up to 3·10⁻⁴.
const COS_SLACK: f32 = 3e-7;

impl<const N: usize> Block<N> {
    /// An estimate of I cos cos / d² of each cluster's lights together, > 0 wherever any of them is above both
    /// horizons. Of a glossy point its lobe takes the place of its share of the cosine.
    ///
    /// Heights above the horizons are spread evenly over the box (and the cone), and the mean of their positive
    /// parts is taken; the squared distance is the mean over the box; the lobe is widened by the angle that the box
    /// subtends. For a `REGION` weights are those of the point in its midst, but > 0 wherever a light is above both horizons of
    /// any of its points.
    #[inline(always)]
    pub(crate) fn weigh<
        const ORIENTED: bool,
        const BOUND: bool,
        const GLOSSY: bool,
        const REGION: bool,
    >(
        &self,
        viewers: impl Viewers,
        region: Region,
    ) -> Weighed<N> {
        let mut centre2 = [0.0f32; N];
        let mut half2 = [0.0f32; N];
        let mut least2 = [0.0f32; N];
        let mut far2 = [0.0f32; N];
        let mut height = [0.0f32; N];
        let mut reach = [0.0f32; N];
        let mut ahead = [0.0f32; N];
        let mut ahead_reach = [0.0f32; N];
        let mut along = [0.0f32; N];
        for axis in 0..3 {
            for k in 0..N {
                let (p, n) = (viewers.position(axis, k), viewers.normal(axis, k));
                let (lo, hi) = (self.lo[axis][k] - p, self.hi[axis][k] - p);
                let (c, h) = ((lo + hi) * 0.5, (hi - lo) * 0.5);
                let padded = h + SLACK * (c.abs() + h);
                centre2[k] += c * c;
                half2[k] += h * h;
                let near = (c.abs() - h).max(0.0);
                least2[k] += near * near;
                let far = c.abs() + padded;
                far2[k] += far * far;
                height[k] += n * c;
                reach[k] += n.abs() * padded;
                if ORIENTED {
                    let a = self.axis[axis][k];
                    ahead[k] -= a * c;
                    ahead_reach[k] += a.abs() * padded;
                }
                if GLOSSY {
                    along[k] += viewers.lobe_axis(axis, k) * c;
                }
            }
        }
        let mut out = Weighed::NONE;
        for k in 0..N {
            // The mean of 1/d² over distances spread evenly from a to b is 1/(ab).
            let (near2, radius) = (self.near2[k], self.radius[k]);
            let (from2, to2) = (least2[k].max(near2), far2[k].max(near2));
            let falloff = if BOUND {
                1.0 / least2[k].max(1.5 * radius * radius).max(NEAREST2)
            } else {
                1.0 / (from2 * to2).sqrt()
            };
            let d = 1.0 / (centre2[k] + half2[k] * (1.0 / 3.0)).max(near2).sqrt();
            let mut nearest2 = from2;
            if REGION {
                // What is above the horizon of another point, by its normal, is no further below this one's.
                reach[k] += region.lift + region.tilt * (far2[k].sqrt() + region.radius);
                let nearest = (least2[k].sqrt() - region.radius).max(0.0);
                nearest2 = (nearest * nearest).max(near2);
            }
            let mut swing = from2 / nearest2;
            // A sphere is lit by, or sends by way of, more than its centre; dark is what its centre says.
            let mut alive = (self.intensity[k] > 0.0) & (height[k] + reach[k] > 0.0);
            // Were all lights where the bound has them.
            let from = 1.0 / from2.sqrt();
            let cos_most = ((height[k] + reach[k]) * from).min(1.0);
            let mut most_arriving = self.intensity[k] / from2;
            let reach = reach[k] + radius;
            let cos = mean_positive(height[k], reach) * d;
            let mut arriving = self.intensity[k] * falloff;
            if ORIENTED {
                let cos = self.cos[k];
                let sin = ((1.0 - cos + COS_SLACK) * (1.0 + cos)).max(0.0).sqrt();
                let sin = if cos <= 0.0 { 1.0 } else { sin };
                let mut spread = ahead_reach[k] + sin * far2[k].sqrt();
                if REGION {
                    spread += region.radius;
                }
                let omni = cos <= -1.0;
                let emitted = mean_positive(ahead[k], spread + radius) * d;
                let most_emitted = ((ahead[k] + spread) * from).clamp(0.0, 1.0);
                let all = only(omni, 1.0);
                arriving *= all + only(!omni, emitted);
                most_arriving *= all + only(!omni, most_emitted);
                alive &= omni | (ahead[k] + spread > 0.0);
            }
            let own_alpha2 = viewers.alpha2(k);
            let around2 = half2[k] + radius * radius;
            let mut alike = FAR2 * own_alpha2 * centre2[k] - around2;
            if ORIENTED {
                alike = only(self.cos[k] >= ALIKE, alike);
            }
            out.alike[k] = alike;
            let (mut reflected, mut most) = (cos, cos);
            if GLOSSY {
                let (diffuse, facets) = (viewers.diffuse(k), viewers.facets(k));
                let dist2 = (centre2[k] + around2).max(LEAST_DIST2);
                // A facet turns by half the angle by which the direction does.
                let mut alpha2 = (own_alpha2 + 0.25 * around2 / dist2).min(1.0);
                if REGION {
                    let turned2 = 0.25 * region.radius * region.radius / dist2;
                    let wide2 = (alpha2 + turned2 + region.tilt * region.tilt).min(1.0);
                    swing *= wide2 / alpha2;
                    alpha2 = wide2;
                }
                let sin2 = 0.5 * (1.0 - along[k] / centre2[k].max(LEAST_DIST2).sqrt());
                let above =
                    ((height[k] + reach) / (2.0 * reach).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
                let mirrored = above * facets * ggx_density(alpha2, sin2.clamp(0.0, 1.0));
                reflected = diffuse * cos + mirrored;
                most = diffuse * cos + mirrored * (alpha2 / own_alpha2);
            }
            // However small, a light that is lit can be drawn.
            let least = match BOUND {
                true => 0.0,
                false => LEAST_OF_MOST * most_arriving * cos_most,
            };
            let weight = (arriving * reflected)
                .max(least)
                .clamp(f32::MIN_POSITIVE, GREATEST);
            out.weights[k] = only(alive, weight);
            out.swings[k] = swing;
            let peak = (arriving * most * (to2 / nearest2)).min(GREATEST);
            out.peaks[k] = only(alive, peak);
        }
        out
    }

    /// Adds the lights without falloff of the eight clusters from `first` on.
    #[cold]
    pub(crate) fn add_parallel(
        &self,
        first: usize,
        receiver: &Receiver,
        parallel: &Lanes,
        weights: &mut [f32; N],
        alike: &mut [f32; N],
    ) {
        for (k, &parallel) in parallel.iter().enumerate() {
            if parallel > 0.0 {
                let k = first + k;
                weights[k] += parallel * receiver.cos_bound_parallel(self.cone(k));
                alike[k] = 0.0;
            }
        }
    }

    /// Of one direction a cone that has room for what packing turned it by.
    fn cone(&self, lane: usize) -> Cone {
        Cone {
            axis: glam::Vec3::new(self.axis[0][lane], self.axis[1][lane], self.axis[2][lane]),
            cos: self.cos[lane].min(1.0 - 2.0 * f32::EPSILON),
        }
    }
}

/// `x`, or 0 where it is not so. Not by a branch, for which the compiler would go through lanes one after the other.
#[inline(always)]
fn only(is: bool, x: f32) -> f32 {
    f32::from_bits(x.to_bits() & u32::from(is).wrapping_neg())
}

/// Mean of the positive part of what is spread evenly over middle ± reach.
#[inline(always)]
fn mean_positive(middle: f32, reach: f32) -> f32 {
    let top = (middle + reach).max(0.0);
    if middle >= reach {
        middle
    } else {
        top * top / (4.0 * reach).max(f32::MIN_POSITIVE)
    }
}
