//! Vectors of four: what every x86-64 and AArch64 processor has.

use glam::{Vec3, Vec4};

use super::{
    AHEAD, BITS, CHILD, FAR_SLACK, Key, Lanes, NOT_MET, Node8, NodeRay, OrderedRay, Stack, WIDTH,
    Width,
};

/// A number for each of four children or triangles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Four;

impl Width for Four {
    #[inline(always)]
    fn meet(self, node: Node8<'_>, ray: &NodeRay, t_max: f32, near: &mut Lanes) -> u32 {
        let mut mask = 0;
        for half in 0..2 {
            let row = |r: usize| Vec4::from_slice(&node.bounds(r)[4 * half..]);
            let (mut from, mut to) = (Vec4::splat(AHEAD), Vec4::INFINITY);
            for axis in 0..3 {
                let origin = Vec4::splat(ray.origin[axis]);
                let inverse = Vec4::splat(ray.inverse[axis]);
                let one = (row(axis) - origin) * inverse;
                let other = (row(axis + 3) - origin) * inverse;
                from = one.min(other).max(from);
                to = one.max(other).min(to);
            }
            let to = (to * FAR_SLACK).min(Vec4::splat(t_max));
            from.write_to_slice(&mut near[4 * half..]);
            mask |= from.cmple(to).bitmask() << (4 * half);
        }
        mask
    }

    #[inline(always)]
    fn meet_ordered(self, node: Node8<'_>, ray: &OrderedRay, t_max: f32, near: &mut Lanes) -> u32 {
        let mut mask = 0;
        for half in 0..2 {
            let plane = |axis: usize, side: usize, inverse: Vec3| {
                let row = node.bounds(ray.rows[axis][side]);
                let row = Vec4::from_slice(&row[4 * half..]);
                (row - Vec4::splat(ray.ray.origin[axis])) * Vec4::splat(inverse[axis])
            };
            let near_plane = |axis| plane(axis, 0, ray.ray.inverse);
            let far_plane = |axis| plane(axis, 1, ray.inverse_far);
            let from = near_plane(0).max(near_plane(1));
            let from = from.max(near_plane(2).max(Vec4::splat(AHEAD)));
            let to = far_plane(0).min(far_plane(1));
            let to = to.min(far_plane(2).min(Vec4::splat(t_max)));
            from.write_to_slice(&mut near[4 * half..]);
            mask |= from.cmple(to).bitmask() << (4 * half);
        }
        mask
    }

    #[inline(always)]
    fn push(self, node: Node8<'_>, mask: u32, stack: &mut Stack, top: usize) -> usize {
        let order = &BITS[mask as usize & 255];
        // All eight are written, whatever the mask: no branch to mispredict.
        for (to, &k) in stack[top..top + WIDTH].iter_mut().zip(order) {
            *to = node.link(k as usize & (WIDTH - 1));
        }
        top + mask.count_ones() as usize
    }

    #[inline(always)]
    fn sort(
        self,
        node: Node8<'_>,
        mask: u32,
        near: &Lanes,
        links: &mut [u32; WIDTH],
        entries: &mut Lanes,
    ) {
        let mut keys: [Key; WIDTH] = std::array::from_fn(|k| match mask >> k & 1 {
            0 => NOT_MET,
            _ => NOT_MET ^ (near[k].to_bits() as Key & !CHILD | k as Key),
        });
        keys.sort_unstable();
        for (i, key) in keys.into_iter().enumerate() {
            let key = NOT_MET ^ key;
            links[i] = node.link((key & CHILD) as usize);
            entries[i] = f32::from_bits((key & !CHILD) as u32);
        }
    }
}
