//! The point that is lit.

use glam::Vec3;
use light_tree::{Lobe, Receiver, luminance};
use sampling::Sequence;
use scene::{Brdf, Surface};

/// A point of an eye path where light is gathered.
#[derive(Debug, Clone, Copy)]
pub struct GatherPoint {
    /// On the viewer's side of the surface, moved off it: shadow rays start here.
    pub position: Vec3,
    /// Unit geometric normal on the viewer's side.
    pub ng: Vec3,
    /// Unit shading normal on the viewer's side.
    pub ns: Vec3,
    /// Unit direction to the viewer.
    pub wo: Vec3,
    /// Reflection at the point.
    pub brdf: Brdf,
    /// What a unit of radiance leaving the point toward the viewer adds to the pixel sample.
    pub strength: Vec3,
    /// Pixel sample that the point belongs to, an index the renderer gives.
    pub slot: u32,
    /// Block of the tile's pixels that it belongs to: points of one are near each other, but for edges.
    pub block: u32,
    /// Which sample of its pixel it belongs to, from 0: low-discrepancy sequences run along it.
    pub sample: u32,
    /// The pixel's sequence.
    pub sequence: Sequence,
    /// Surfaces between the point and the first hit of its path, that one counted: 0 for the first hit.
    pub bounce: u32,
    /// Virtual lights whose light has met more surfaces than this are dark here; `u32::MAX` for none.
    pub light_bounces: u32,
    /// Whether lights that can be hit are met by a ray that goes on from here as well, so that sampling them is to find
    /// only its share.
    pub shares_hits: bool,
    /// The point as a light tree sees it.
    pub receiver: Receiver,
}

impl GatherPoint {
    /// The point at `surface`, seen along `-wo`, as sample 0 of any pixel.
    pub fn new(surface: &Surface, wo: Vec3, strength: Vec3, slot: u32) -> Self {
        let position = surface.ray_origin();
        Self {
            position,
            ng: surface.ng,
            ns: surface.ns,
            wo,
            brdf: surface.brdf,
            strength,
            slot,
            block: 0,
            sample: 0,
            sequence: Sequence(0),
            bounce: 0,
            light_bounces: u32::MAX,
            shares_hits: false,
            receiver: receiver(position, surface, wo),
        }
    }
}

#[cfg(test)]
impl GatherPoint {
    /// A point like it elsewhere.
    pub(crate) fn moved(&self, by: Vec3) -> Self {
        self.with(self.position + by, self.ns)
    }

    /// A point like it with another shading normal.
    pub(crate) fn turned(&self, by: glam::Quat) -> Self {
        self.with(self.position, (by * self.ns).normalize())
    }

    fn with(&self, position: Vec3, ns: Vec3) -> Self {
        let mut receiver = Receiver::new(position, ns);
        if let Some(&lobe) = self.receiver.lobe() {
            receiver = receiver.with_lobe(lobe);
        }
        Self {
            position,
            ns,
            receiver,
            ..*self
        }
    }
}

/// The point as a tree sees it, with its lobe if it has one.
fn receiver(position: Vec3, surface: &Surface, wo: Vec3) -> Receiver {
    let (brdf, ns) = (&surface.brdf, surface.ns);
    let receiver = Receiver::new(position, ns);
    if !brdf.is_glossy() {
        return receiver;
    }
    let cos_o = ns.dot(wo);
    let bound = brdf.lobe_bound(cos_o);
    receiver.with_lobe(Lobe {
        axis: Brdf::lobe_axis(ns, wo),
        diffuse: luminance(brdf.diffuse_bound(cos_o)),
        near: luminance(bound.near),
        far: luminance(bound.far),
        far_sin2: bound.far_sin2,
        alpha2: bound.alpha2[1],
    })
}
