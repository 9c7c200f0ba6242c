//! Bounds on distance and on cosines over boxes.

use glam::{DVec2, Mat3A, Vec3, Vec3A};

use crate::block::SeenLobe;
use crate::cone::Cone;
use crate::emission::Emission;
use crate::lobe::Lobe;
use crate::prefetch::prefetch;
use crate::region::Region;
use crate::tree::Node;

/// The point that is lit, with what bounds need of it worked out once.
#[derive(Debug, Clone, Copy)]
pub struct Receiver {
    position: Vec3A,
    /// World to a frame whose z is the normal, column by column.
    frame: Mat3A,
    /// Its absolute values: half extents of a box become half extents in the frame.
    frame_abs: Mat3A,
    normal: Vec3A,
    /// What a lane takes of it: see [`ReceiverLanes`].
    numbers: [f32; NUMBERS],
    /// `None` when the point is matte, or nobody asks.
    lobe: Option<Lobe>,
    region: Region,
}

/// Least and greatest squared distance from a point to a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceRange {
    /// 0 inside the box.
    pub least2: f32,
    /// Never less than `least2`.
    pub greatest2: f32,
}

/// Relative slack of the cosine bound, so that rounding never makes a lit box dark.
const SLACK: f32 = 1e-6;

impl Receiver {
    /// A point at `position` that light reaches from the side of unit `normal`.
    ///
    /// # Panics
    /// In debug builds, when `normal` is not of unit length or a number is not finite.
    pub fn new(position: Vec3, normal: Vec3) -> Self {
        debug_assert!(position.is_finite(), "receiver at {position}");
        debug_assert!(normal.is_normalized(), "receiver normal {normal}");
        let (t, b) = level_tangents(normal);
        let frame = Mat3A::from_cols(t.into(), b.into(), normal.into()).transpose();
        let frame_abs =
            Mat3A::from_cols(frame.x_axis.abs(), frame.y_axis.abs(), frame.z_axis.abs());
        Self {
            position: position.into(),
            frame,
            frame_abs,
            normal: normal.into(),
            numbers: [
                position.x, position.y, position.z, t.x, t.y, b.x, b.y, b.z, normal.x, normal.y,
                normal.z,
            ],
            lobe: None,
            region: Region::default(),
        }
    }

    /// The same point, which stands for the others of `region` where lights are weighed by a
    /// [`SharedCut`](crate::SharedCut).
    pub fn with_region(self, region: Region) -> Self {
        Self { region, ..self }
    }

    /// Whether `other` is in its region, and reflects about alike.
    pub fn stands_for(&self, other: &Self) -> bool {
        let Region { radius, lift, tilt } = self.region;
        let away = other.position - self.position;
        away.length_squared() <= radius * radius
            && away.dot(self.normal).abs() <= lift
            && self.normal.distance_squared(other.normal) <= tilt * tilt
            && match (SeenLobe::of(self), SeenLobe::of(other)) {
                (None, None) => true,
                (Some(own), Some(others)) => own.is_like(&others),
                _ => false,
            }
    }

    #[inline]
    pub(crate) fn region(&self) -> Region {
        self.region
    }

    /// The same point, which reflects as `lobe` says.
    pub fn with_lobe(self, lobe: Lobe) -> Self {
        Self {
            lobe: Some(lobe),
            ..self
        }
    }

    /// Its lobe, if it has one.
    #[inline]
    pub fn lobe(&self) -> Option<&Lobe> {
        self.lobe.as_ref()
    }

    /// Upper bound of cos⁺ of the angle between the normal and the direction to any point of the box;
    /// 0 only when no point of it is above the horizon. A box that is the receiver's position alone has 0: a
    /// light there has no direction and lights nothing.
    ///
    /// Source: Walter et al. 2005, §3.2: the box is bounded in a frame about the normal, and the cosine
    /// z/√(x²+y²+z²) is greatest for the greatest z and the least |x| and |y|.
    #[inline]
    pub fn cos_bound(&self, node: &Node) -> f32 {
        self.cos_bound_over(&self.relative(node))
    }

    #[inline]
    pub(crate) fn cos_bound_over(&self, seen: &RelativeBox) -> f32 {
        // Both doubled: only directions matter.
        let (centre, half) = (seen.lo + seen.hi, seen.hi - seen.lo);
        let c = self.frame * centre;
        // How far the box reaches at all is −2 times the lesser of both.
        let farthest = seen.lo.min(-seen.hi);
        let e = self.frame_abs * (half - 2.0 * SLACK * farthest);
        let top = c.z + e.z;
        let beside = (c.abs() - e).max(Vec3A::ZERO);
        let across2 = beside.x * beside.x + beside.y * beside.y;
        // No branch: which boxes are below the horizon cannot be predicted. Above it, a length whose square underflows or
        // is rounded down must not make the quotient more than 1, nor divide by 0.
        let length = (across2 + top * top).sqrt();
        top.max(0.0) / length.max(top.max(f32::MIN_POSITIVE))
    }

    /// Upper bound of cos⁺ between the normal, or any of the region's, and the direction against the travel of parallel light in
    /// `travel`; 0 only when all of it comes from below the horizon.
    pub fn cos_bound_parallel(&self, travel: Cone) -> f32 {
        let cos = -self.normal.dot(travel.axis.into());
        widened_cos(cos + self.region.tilt, travel.cos)
    }

    /// Distances to the box of a node that has positional lights.
    #[inline]
    pub fn distances(&self, node: &Node) -> DistanceRange {
        self.relative(node).distances()
    }

    /// The node's box, seen from the receiver.
    #[inline]
    pub(crate) fn relative(&self, node: &Node) -> RelativeBox {
        RelativeBox {
            lo: Vec3A::from(node.lo) - self.position,
            hi: Vec3A::from(node.hi) - self.position,
        }
    }

    /// Upper bound of the share of its intensity that a light below sends from any point of the box to the
    /// receiver; 0 only when none sends anything.
    pub fn emission_bound(&self, node: &Node, emission: Emission) -> f32 {
        self.relative(node).emission_bound(emission)
    }

    /// Upper bound of the cosine, signed, of the angle between the normal and the direction to any point of
    /// the box; 1 where the box is the receiver's position alone.
    pub(crate) fn signed_cos_bound_over(&self, seen: &RelativeBox) -> f32 {
        let cos = self.cos_bound_over(seen);
        if cos > 0.0 {
            return cos;
        }
        // Below the horizon the bound on cos⁺ says nothing of how far.
        seen.cos_below(self.normal)
    }

    /// Whether any point of the box is above the horizon; true when rounding leaves a doubt.
    #[inline]
    pub(crate) fn sees_above_horizon(&self, seen: &RelativeBox) -> bool {
        seen.top(self.normal) > 0.0
    }

    /// Asks for what a lane takes of it.
    #[inline(always)]
    pub(crate) fn prefetch(&self) {
        prefetch(Some(&self.numbers));
    }

    /// The normal.
    pub(crate) fn normal(&self) -> Vec3A {
        self.normal
    }

    /// Where it is.
    pub(crate) fn position(&self) -> Vec3A {
        self.position
    }
}

/// Upper bound of the cosine, signed, between unit `axis` and the direction from the origin to any point of
/// the box.
pub(crate) fn signed_cos_toward(axis: Vec3, seen: &RelativeBox) -> f32 {
    Receiver::new(Vec3::ZERO, axis).signed_cos_bound_over(seen)
}

/// A box as the receiver sees it, the receiver at the origin.
///
/// Corners are moved, not centre and extent: subtraction rounds monotonically, so the offset of any point of
/// the box, rounded, lies between the rounded corners.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RelativeBox {
    pub(crate) lo: Vec3A,
    pub(crate) hi: Vec3A,
}

impl RelativeBox {
    /// See [`Receiver::emission_bound`].
    #[inline]
    pub(crate) fn emission_bound(&self, emission: Emission) -> f32 {
        if emission.is_wide() {
            return 1.0;
        }
        emission.bound(|axis| self.cos_back(axis))
    }

    /// Upper bound of the signed cosine between `axis` and the direction from any point of the box to the receiver.
    /// Greatest reach along the axis over nearest distance: looser than a bound in the axis' own frame where a cluster
    /// is near and wide, and a third of the work.
    #[inline]
    fn cos_back(&self, axis: Vec3) -> f32 {
        // Seen from the lights the receiver fills the mirrored box.
        let top = self.mirrored().top(axis.into());
        let range = self.distances();
        let length2 = if top > 0.0 {
            range.least2.max(top * top)
        } else {
            range.greatest2
        };
        // Where squares underflow any direction is possible.
        if length2 > 0.0 {
            (top / length2.sqrt()).clamp(-1.0, 1.0)
        } else {
            1.0
        }
    }

    #[inline]
    fn centre_and_half(&self) -> (Vec3A, Vec3A) {
        ((self.lo + self.hi) * 0.5, (self.hi - self.lo) * 0.5)
    }

    #[inline]
    pub(crate) fn least2(&self) -> f32 {
        self.lo.max(-self.hi).max(Vec3A::ZERO).length_squared()
    }

    #[inline]
    pub(crate) fn diagonal2(&self) -> f32 {
        (self.hi - self.lo).length_squared()
    }

    #[inline]
    pub(crate) fn distances(&self) -> DistanceRange {
        DistanceRange {
            least2: self.least2(),
            greatest2: self.lo.abs().max(self.hi.abs()).length_squared(),
        }
    }

    /// The receiver's place as seen from the points of the box.
    #[inline]
    pub(crate) fn mirrored(&self) -> Self {
        Self {
            lo: -self.hi,
            hi: -self.lo,
        }
    }

    /// Middle of the box.
    #[inline]
    pub(crate) fn centre(&self) -> Vec3A {
        (self.lo + self.hi) * 0.5
    }

    /// Upper bound of the extent along `axis`.
    #[inline]
    fn top(&self, axis: Vec3A) -> f32 {
        let (centre, half) = self.centre_and_half();
        axis.dot(centre) + axis.abs().dot(half + SLACK * (centre.abs() + half))
    }

    /// Upper bound of the cosine with `axis` where that is known to be ≤ 0: the greatest z over the greatest
    /// length.
    fn cos_below(&self, axis: Vec3A) -> f32 {
        let top = self.top(axis);
        let length2 = self.distances().greatest2;
        if length2 > 0.0 {
            (top / length2.sqrt()).clamp(-1.0, 1.0)
        } else {
            1.0
        }
    }
}

/// Two unit vectors at right angles to `normal` and each other. The first is level, its z 0: a number less to work with.
fn level_tangents(normal: Vec3) -> (Vec3, Vec3) {
    // Squares of the least numbers underflow in single precision.
    let flat = normal.truncate().as_dvec2();
    let flat = flat.try_normalize().unwrap_or(DVec2::Y).as_vec2();
    let t = Vec3::new(-flat.y, flat.x, 0.0);
    (t, normal.cross(t))
}

/// Several receivers, each of which looks at two boxes of its own.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct ReceiverLanes<const N: usize> {
    /// The position, and the rows of the frame: two numbers of the level tangent, three of the other, and the normal.
    numbers: [[f32; N]; NUMBERS],
}

/// Numbers that make up a receiver.
const NUMBERS: usize = 11;

/// Several boxes, coordinate by coordinate.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct BoxLanes<const N: usize> {
    pub(crate) lo: [[f32; N]; 3],
    pub(crate) hi: [[f32; N]; 3],
}

/// What receivers see of a box each.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct SeenLanes<const N: usize> {
    /// What [`cos`](Self::cos) is the quotient of: the one, and the square of the other.
    top: [f32; N],
    length2: [f32; N],
    /// [`RelativeBox::least2`].
    pub(crate) least2: [f32; N],
    /// [`RelativeBox::diagonal2`].
    pub(crate) diagonal2: [f32; N],
}

impl<const N: usize> SeenLanes<N> {
    /// No box.
    pub(crate) const NOTHING: Self = Self {
        top: [0.0; N],
        length2: [0.0; N],
        least2: [0.0; N],
        diagonal2: [0.0; N],
    };

    /// [`Receiver::cos_bound_over`], but for rounding.
    #[inline(always)]
    pub(crate) fn cos(&self, lane: usize) -> f32 {
        let top = self.top[lane];
        let length = greater(self.length2[lane].sqrt(), greater(top, f32::MIN_POSITIVE));
        greater(top, 0.0) / length
    }
}

impl<const N: usize> ReceiverLanes<N> {
    /// Receivers that have no normal: all is dark.
    pub(crate) const NOWHERE: Self = Self {
        numbers: [[0.0; N]; NUMBERS],
    };

    /// The same receiver in each lane.
    #[inline(always)]
    pub(crate) fn splat(receiver: &Receiver) -> Self {
        let mut lanes = Self::NOWHERE;
        for lane in 0..N {
            lanes.set(lane, receiver);
        }
        lanes
    }

    /// Puts a receiver in a lane.
    #[inline(always)]
    pub(crate) fn set(&mut self, lane: usize, receiver: &Receiver) {
        for (lanes, number) in self.numbers.iter_mut().zip(receiver.numbers) {
            lanes[lane] = number;
        }
    }

    /// What each receiver sees of two boxes, the first of each and then the second of each: the same operations in the same order
    /// as for one alone, and so the same bits.
    #[allow(
        clippy::needless_range_loop,
        reason = "an iterator's adaptor would not be compiled for the wider instructions"
    )]
    #[inline(always)]
    pub(crate) fn see<const BOXES: usize>(&self, boxes: &BoxLanes<BOXES>) -> SeenLanes<BOXES> {
        const { assert!(BOXES == 2 * N, "two each") };
        let mut numbers = [[0.0; BOXES]; NUMBERS];
        for i in 0..NUMBERS {
            for k in 0..BOXES {
                numbers[i][k] = self.numbers[i][k % N];
            }
        }
        let mut seen = SeenLanes::NOTHING;
        for k in 0..BOXES {
            let number = |i: usize| numbers[i][k];
            let (mut centre, mut inward, mut nearest) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            let mut inner = [0.0; 3];
            for axis in 0..3 {
                let at = number(axis);
                // How far the box reaches below and above: both with signs such that they are added rather than one of them
                // turned around.
                let (lo, above) = (boxes.lo[axis][k] - at, at - boxes.hi[axis][k]);
                nearest[axis] = greater(greater(lo, above), 0.0);
                // Both doubled: only directions matter.
                (centre[axis], inward[axis]) = (lo - above, lo + above);
                // How far it reaches at all is −2 times the lesser of both.
                inner[axis] = (2.0 * SLACK).mul_add(lesser(lo, above), inward[axis]);
            }
            let dot =
                |a: [f32; 3], b: [f32; 3]| a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]));
            // What a row of the frame makes of the half extents, which are negative here, and something else.
            let reach = |[x, y, z]: [f32; 3], to: f32| {
                let to = y.abs().mul_add(inner[1], x.abs().mul_add(inner[0], to));
                z.abs().mul_add(inner[2], to)
            };
            let (east, north) = (number(3), number(4));
            let across = north.mul_add(centre[1], east * centre[0]).abs();
            let across = north
                .abs()
                .mul_add(inner[1], east.abs().mul_add(inner[0], across));
            let x = greater(across, 0.0);
            let other = [number(5), number(6), number(7)];
            let y = greater(reach(other, dot(other, centre).abs()), 0.0);
            let normal = [number(8), number(9), number(10)];
            let top = -reach(normal, -dot(normal, centre));
            seen.top[k] = top;
            seen.length2[k] = top.mul_add(top, y.mul_add(y, x * x));
            seen.least2[k] = dot(nearest, nearest);
            seen.diagonal2[k] = dot(inward, inward);
        }
        seen
    }
}

/// The greater of two numbers, which is one instruction where neither is NaN.
#[inline(always)]
pub(crate) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The lesser of two numbers, likewise.
#[inline(always)]
pub(crate) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// cos⁺(θ − β) for θ given by `cos` and β by `cos_half`, 1 when θ ≤ β.
pub(crate) fn widened_cos(cos: f32, cos_half: f32) -> f32 {
    widened_signed_cos(cos, cos_half).max(0.0)
}

/// cos(θ − β) for θ given by `cos` and β by `cos_half`, 1 when θ ≤ β.
pub(crate) fn widened_signed_cos(cos: f32, cos_half: f32) -> f32 {
    // Not 1 − cos²: that loses all digits of a small angle.
    let sin_half = ((1.0 - cos_half) * (1.0 + cos_half)).max(0.0).sqrt();
    widened_by(cos, cos_half, sin_half)
}

/// cos(θ − β) for θ given by `cos` and β by its cosine and sine, 1 when θ ≤ β. A cosine alone cannot tell a β
/// below 3·10⁻⁴ from 0.
pub(crate) fn widened_by(cos: f32, cos_half: f32, sin_half: f32) -> f32 {
    // What rounding may have taken off: near −1 and 1 that is worth 5·10⁻⁴ radians.
    let cos = (cos + 3e-7).clamp(-1.0, 1.0);
    if cos >= cos_half - SLACK {
        return 1.0;
    }
    let sin = ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt();
    let widened = cos * cos_half + sin * sin_half + SLACK;
    widened.clamp(-1.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emission::Profile;
    use crate::light::LightId;
    use verify::arbitrary::{Result, Unstructured};

    fn coordinate(u: &mut Unstructured<'_>) -> Result<f32> {
        Ok(match u.int_in_range(0..=4)? {
            0 => 0.0,
            1 => 1.0,
            2 => 1.0 + f32::from(u.arbitrary::<i8>()?) * f32::EPSILON,
            3 => f32::from(u.arbitrary::<i8>()?) * 1e-5,
            _ => f32::from(u.arbitrary::<i16>()?) / 4096.0,
        })
    }

    fn point(u: &mut Unstructured<'_>) -> Result<Vec3> {
        Ok(Vec3::new(coordinate(u)?, coordinate(u)?, coordinate(u)?))
    }

    fn twice(node: &Node) -> BoxLanes<2> {
        BoxLanes {
            lo: node.lo.to_array().map(|lo| [lo; 2]),
            hi: node.hi.to_array().map(|hi| [hi; 2]),
        }
    }

    #[test]
    fn boxes_side_by_side_are_seen_as_each_alone() {
        verify::property(5000, |u| {
            let mut receivers = Vec::new();
            let mut lanes = ReceiverLanes::<4>::NOWHERE;
            for lane in 0..4 {
                let (a, b) = (point(u)?, point(u)?);
                let normal = (b - a).try_normalize().unwrap_or(Vec3::Y);
                let x = Receiver::new(a, normal);
                lanes.set(lane, &x);
                receivers.push(x);
            }
            let mut boxes = BoxLanes {
                lo: [[0.0; 8]; 3],
                hi: [[0.0; 8]; 3],
            };
            let mut nodes = Vec::new();
            for k in 0..8 {
                let (p, q) = (point(u)?, point(u)?);
                let node = Node::leaf(p.min(q), p.max(q), 1.0, LightId(0));
                for axis in 0..3 {
                    (boxes.lo[axis][k], boxes.hi[axis][k]) = (node.lo[axis], node.hi[axis]);
                }
                nodes.push(node);
            }
            let seen = lanes.see(&boxes);
            for (k, (node, x)) in nodes.iter().zip(receivers.iter().cycle()).enumerate() {
                let alone = ReceiverLanes::<1>::splat(x).see(&twice(node));
                let of = |seen: &SeenLanes<8>| [seen.cos(k), seen.least2[k], seen.diagonal2[k]];
                let each = [alone.cos(1), alone.least2[1], alone.diagonal2[1]];
                assert_eq!(
                    of(&seen).map(f32::to_bits),
                    each.map(f32::to_bits),
                    "{x:?} {node:?}"
                );
                // Fused multiplication rounds otherwise.
                let alone = x.relative(node);
                let distances = [seen.least2[k], seen.diagonal2[k]];
                for (own, other) in distances
                    .into_iter()
                    .zip([alone.least2(), alone.diagonal2()])
                {
                    assert!(
                        (own - other).abs() <= 1e-6 * other,
                        "{own}, {other}: {x:?} {node:?}"
                    );
                }
            }
            Ok(())
        });
    }

    /// Points some last digits apart, as far from the origin as from 0 to 1000: there squares of coordinates are all
    /// that is seen of a difference of squares.
    fn neighbours(u: &mut Unstructured<'_>) -> Result<[Vec3; 3]> {
        let middle = Vec3::splat(*u.choose(&[0.0, 1.0, 1000.0])?);
        let mut points = [middle; 3];
        for c in points.iter_mut().flat_map(|p| p.as_mut()) {
            *c += f32::from(u.arbitrary::<i8>()?) * f32::EPSILON * c.max(1.0);
        }
        Ok(points)
    }

    fn boxed(a: Vec3, b: Vec3) -> Node {
        Node::leaf(a.min(b), a.max(b), 1.0, LightId(0))
    }

    /// A point of the box: a corner, the middle, or anywhere.
    fn inside(u: &mut Unstructured<'_>, node: &Node) -> Result<Vec3> {
        let mut at = |lo: f32, hi: f32| -> Result<f32> {
            let t = f32::from(u.int_in_range(0..=4u8)?) / 4.0;
            Ok((lo + (hi - lo) * t).clamp(lo, hi))
        };
        Ok(Vec3::new(
            at(node.lo.x, node.hi.x)?,
            at(node.lo.y, node.hi.y)?,
            at(node.lo.z, node.hi.z)?,
        ))
    }

    fn cos_plus(n: Vec3, d: Vec3) -> f64 {
        let (n, d) = (n.as_dvec3(), d.as_dvec3());
        if d.length() == 0.0 {
            0.0
        } else {
            (n.dot(d) / (n.length() * d.length())).max(0.0)
        }
    }

    #[test]
    fn no_point_of_a_box_exceeds_the_cosine_bound() {
        verify::property(1000, |u| {
            let node = boxed(point(u)?, point(u)?);
            let x = point(u)?;
            let n = point(u)?.try_normalize().unwrap_or(Vec3::Z);
            let receiver = Receiver::new(x, n);
            let lanes = ReceiverLanes::<1>::splat(&receiver).see(&twice(&node));
            let points: Vec<Vec3> = (0..8).map(|_| inside(u, &node)).collect::<Result<_>>()?;
            for bound in [receiver.cos_bound(&node), lanes.cos(0)] {
                assert!((0.0..=1.0 + 1e-5).contains(&bound), "bound {bound}");
                for &p in &points {
                    let truth = cos_plus(n, p - x);
                    assert!(
                        f64::from(bound) >= truth - 2e-6,
                        "bound {bound} truth {truth} at {p} from {x}, n {n}"
                    );
                    assert!(
                        bound > 0.0 || n.dot(p - x) <= 0.0,
                        "a lit point has bound 0: {p} from {x}, n {n}"
                    );
                }
            }
            Ok(())
        });
    }

    #[test]
    fn no_light_of_a_cluster_exceeds_the_emission_bound() {
        verify::property(1000, |u| {
            let node = boxed(point(u)?, point(u)?);
            let x = point(u)?;
            let axes: Vec<Vec3> = (0..3)
                .map(|_| Ok(point(u)?.try_normalize().unwrap_or(Vec3::Y)))
                .collect::<Result<_>>()?;
            let cone = axes
                .iter()
                .fold(Cone::of(axes[0]), |c, a| c.union(Cone::of(*a)));
            let profile = Profile::Cosine;
            let bound = Receiver::new(x, Vec3::Z).emission_bound(&node, Emission { cone, profile });
            for axis in axes {
                let p = inside(u, &node)?;
                let truth = cos_plus(axis, x - p);
                // The cone's own slack of 2e-6 rad and acos near 1 leave a few 1e-4 of angle.
                assert!(
                    f64::from(bound) >= truth - 1e-5,
                    "bound {bound} truth {truth}: light {p} axis {axis}, x {x}"
                );
                assert!(
                    bound > 0.0 || axis.dot(x - p) <= 1e-6,
                    "a lit receiver has bound 0"
                );
            }
            Ok(())
        });
    }

    #[test]
    fn cones_about_a_right_angle_hide_no_light_on_their_rim() {
        let light = boxed(Vec3::ZERO, Vec3::ZERO);
        for cos in [0.0, 1e-45, 1e-30, 6e-8, 1e-7, 3e-4, 2e-3] {
            for cos in [cos, -cos] {
                let (axis, rim) = (Vec3::Y, Vec3::new((1.0f32 - cos * cos).sqrt(), cos, 0.0));
                let around = (0..3600u16).map(|i| f32::from(i) * (std::f32::consts::TAU / 3600.0));
                // All but opposite to the axis, where the cosine of the angle rounds to −1.
                let behind = (-100..=100i8).map(|i| f32::from(i) * 1e-5);
                let places = around
                    .map(|angle| Vec3::new(angle.cos(), angle.sin(), 0.0))
                    .chain(behind.map(|angle| Vec3::new(angle.sin(), -angle.cos(), 0.0)));
                for x in places {
                    let emission = Emission {
                        cone: Cone { axis, cos },
                        profile: Profile::Cosine,
                    };
                    let bound = Receiver::new(x, -x).emission_bound(&light, emission);
                    let truth = rim.dot(x);
                    assert!(
                        bound >= truth - 1e-5 && (bound > 0.0 || truth <= 1e-6),
                        "bound {bound}, truth {truth}: cosine {cos}, towards {x}"
                    );
                }
            }
        }
    }

    #[test]
    fn distances_enclose_every_point() {
        verify::property(1000, |u| {
            let [a, b, x] = if u.arbitrary()? {
                neighbours(u)?
            } else {
                [point(u)?, point(u)?, point(u)?]
            };
            let node = boxed(a, b);
            let range = Receiver::new(x, Vec3::Z).distances(&node);
            let p = inside(u, &node)?;
            let truth = p.as_dvec3().distance_squared(x.as_dvec3());
            let slack = 1e-5 * (f64::from(range.greatest2) + 1e-12);
            assert!(
                f64::from(range.least2) <= truth + slack,
                "{range:?} above {truth}"
            );
            assert!(
                f64::from(range.greatest2) >= truth - slack,
                "{range:?} below {truth}"
            );
            Ok(())
        });
    }

    #[test]
    fn a_box_below_the_horizon_is_dark_and_one_around_the_receiver_is_not() {
        let receiver = Receiver::new(Vec3::ZERO, Vec3::Y);
        let below = boxed(Vec3::new(-1.0, -2.0, -1.0), Vec3::new(1.0, -1.0, 1.0));
        assert_eq!(receiver.cos_bound(&below), 0.0, "below");
        let here = boxed(Vec3::ZERO, Vec3::ZERO);
        assert_eq!(receiver.cos_bound(&here), 0.0, "a light at the receiver");
        let around = boxed(Vec3::splat(-1e-30), Vec3::splat(1e-30));
        assert_eq!(receiver.cos_bound(&around), 1.0, "a tiny box around it");
    }
}
