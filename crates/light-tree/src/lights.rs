//! The lights a tree is built over.

use glam::Vec3;

use crate::cone::Cone;
use crate::emission::{Emission, Profile, SLACK};
use crate::light::{EnvironmentCell, LightId, LightKind, SpotCone, TriangleLight, luminance};
use crate::prefetch::prefetch;
use crate::tree::Node;

mod packed;
mod virtual_lights;

use packed::{PackedGloss, PackedLight};

/// What only triangles have.
#[derive(Debug, Clone, Copy)]
struct Area {
    lo: Vec3,
    hi: Vec3,
    element: u32,
}

/// What only cells of an environment have.
#[derive(Debug, Clone, Copy)]
struct Cell {
    travel: Cone,
    element: u32,
}

/// What each of the scene's own lights has, side by side: each array that it were spread over would be one more wait for memory.
#[derive(Debug, Clone, Copy)]
#[repr(align(16))]
struct Light {
    position: Vec3,
    axis: Vec3,
    intensity: Vec3,
    /// Index into the array of the light's kind, or [`NONE`].
    detail: u32,
    kind: LightKind,
}

/// The detail of a light that has none.
const NONE: u32 = u32::MAX;

/// A light, as it is kept.
enum Stored<'a> {
    Own(&'a Light),
    Virtual(&'a PackedLight),
}

/// All lights in use, in one order, virtual lights after all others. Every light has power above zero and finite numbers.
#[derive(Debug, Clone, Default)]
pub struct LightSet {
    /// The scene's own.
    own: Vec<Light>,
    spots: Vec<SpotCone>,
    areas: Vec<Area>,
    cells: Vec<Cell>,
    virtuals: Vec<PackedLight>,
    /// Of the virtual lights that are not matte.
    glosses: Vec<PackedGloss>,
    /// The greatest radius, and whether virtual lights differ in theirs.
    radius: f32,
    has_radii: bool,
    /// One a virtual light, or empty when nobody asks.
    bounces: Vec<u16>,
    /// Greatest of the triangles' and of the cells' peaks; 0 without any.
    peaks: [f32; 2],
}

impl LightSet {
    /// Adds a point light of `intensity` W/sr, or nothing when it has no power. Returns whether it was added.
    ///
    /// # Panics
    /// On a non-finite or negative number, or after a virtual light was added.
    pub fn push_point(&mut self, position: Vec3, intensity: Vec3) -> bool {
        assert!(position.is_finite(), "point light at {position}");
        self.push(position, Vec3::ZERO, intensity, LightKind::Omni, NONE)
    }

    /// Adds parallel light that travels along unit `direction`, of `irradiance` W/m² on a facing surface,
    /// or nothing when it has no power. Returns whether it was added.
    ///
    /// # Panics
    /// On a non-finite or negative number, or after a virtual light was added.
    pub fn push_directional(&mut self, direction: Vec3, irradiance: Vec3) -> bool {
        assert!(
            direction.is_normalized(),
            "directional light along {direction}"
        );
        self.push(
            Vec3::ZERO,
            direction,
            irradiance,
            LightKind::Directional,
            NONE,
        )
    }

    /// Adds a light at `position` that shines about unit `axis`, with `intensity` W/sr inside the cone; nothing when it
    /// has no power, as with a cone of angle 0. Returns whether it was added.
    ///
    /// # Panics
    /// On a non-finite or negative number, an outer cone inside the inner one, or after a virtual light was added.
    pub fn push_spot(
        &mut self,
        position: Vec3,
        axis: Vec3,
        intensity: Vec3,
        cone: SpotCone,
    ) -> bool {
        assert!(
            position.is_finite() && axis.is_normalized(),
            "spot light at {position} along {axis}"
        );
        assert!(
            -1.0 <= cone.cos_outer && cone.cos_outer <= cone.cos_inner && cone.cos_inner <= 1.0,
            "spot light {cone:?}"
        );
        let detail = self.spots.len() as u32;
        if cone.cos_outer >= 1.0 || !self.push(position, axis, intensity, LightKind::Spot, detail) {
            return false;
        }
        self.spots.push(cone);
        true
    }

    /// Adds a triangle that emits, or nothing when it has no area or no power. Returns whether it was added.
    ///
    /// # Panics
    /// On a non-finite or negative number, or after a virtual light was added.
    pub fn push_triangle(&mut self, light: &TriangleLight) -> bool {
        let [a, b, c] = light.corners;
        assert!(
            light.corners.iter().all(|p| p.is_finite()) && light.offset >= 0.0,
            "emissive {light:?}"
        );
        // In f64: the area of a small triangle underflows.
        let normal = (b - a).as_dvec3().cross((c - a).as_dvec3());
        let Some(normal) = normal.try_normalize() else {
            return false;
        };
        // Both sides emit: of the two normals the one that neighbours are likely to have as well.
        let normal = normal.as_vec3();
        let normal = if normal[normal.abs().max_position()] < 0.0 {
            -normal
        } else {
            normal
        };
        let centre = a / 3.0 + b / 3.0 + c / 3.0;
        let (kind, detail) = (LightKind::Triangle, self.areas.len() as u32);
        if !self.push(centre, normal, light.intensity, kind, detail) {
            return false;
        }
        self.areas.push(Area {
            lo: a.min(b).min(c) - light.offset,
            hi: a.max(b).max(c) + light.offset,
            element: light.element,
        });
        self.peaks[0] = self.peaks[0].max(light.peak);
        true
    }

    /// Adds a cell of an environment, or nothing when it has no power. Returns whether it was added.
    ///
    /// # Panics
    /// On a non-finite or negative number, or after a virtual light was added.
    pub fn push_environment(&mut self, cell: &EnvironmentCell) -> bool {
        assert!(cell.travel.axis.is_normalized(), "environment {cell:?}");
        let (axis, kind) = (cell.travel.axis, LightKind::Environment);
        let detail = self.cells.len() as u32;
        if !self.push(Vec3::ZERO, axis, cell.irradiance, kind, detail) {
            return false;
        }
        self.cells.push(Cell {
            travel: cell.travel,
            element: cell.element,
        });
        self.peaks[1] = self.peaks[1].max(cell.peak);
        true
    }

    fn push(
        &mut self,
        position: Vec3,
        axis: Vec3,
        intensity: Vec3,
        kind: LightKind,
        detail: u32,
    ) -> bool {
        assert!(self.virtuals.is_empty(), "virtual lights come last");
        check_colour(intensity);
        if luminance(intensity) <= 0.0 {
            return false;
        }
        self.own.push(Light {
            position,
            axis,
            intensity,
            detail,
            kind,
        });
        true
    }

    /// Asks for what light `id` is evaluated by: who asks for several before evaluating the first waits once for all. The
    /// gloss of a virtual light lies behind an index, and is not among it.
    #[inline]
    pub fn prefetch(&self, id: LightId) {
        match id.index().checked_sub(self.own.len()) {
            None => prefetch(self.own.get(id.index())),
            Some(place) => prefetch(self.virtuals.get(place)),
        }
    }

    #[inline(always)]
    fn stored(&self, id: LightId) -> Stored<'_> {
        match id.index().checked_sub(self.own.len()) {
            None => Stored::Own(&self.own[id.index()]),
            Some(place) => Stored::Virtual(&self.virtuals[place]),
        }
    }

    /// Number of lights.
    pub fn len(&self) -> usize {
        self.own.len() + self.virtuals.len()
    }

    /// Whether there is no light: legal, and black.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of lights of `kind`.
    pub fn count(&self, kind: LightKind) -> usize {
        match kind {
            LightKind::Virtual => self.virtuals.len(),
            _ => self.own.iter().filter(|l| l.kind == kind).count(),
        }
    }

    /// World-space position, the centre of a triangle; the origin for distant lights.
    #[inline]
    pub fn position(&self, id: LightId) -> Vec3 {
        match self.stored(id) {
            Stored::Own(light) => light.position,
            Stored::Virtual(light) => light.position,
        }
    }

    /// Unit surface normal of a virtual light or a triangle, axis of a spot, direction in which distant light travels
    /// (for a cell from its middle), zero for omni lights.
    #[inline]
    pub fn axis(&self, id: LightId) -> Vec3 {
        match self.stored(id) {
            Stored::Own(light) => light.axis,
            Stored::Virtual(light) => light.normal(),
        }
    }

    /// RGB intensity (W/sr) along the axis, or irradiance (W/m²) of distant light.
    #[inline]
    pub fn intensity(&self, id: LightId) -> Vec3 {
        match self.stored(id) {
            Stored::Own(light) => light.intensity,
            Stored::Virtual(light) => light.intensity,
        }
    }

    /// Kind of light.
    #[inline]
    pub fn kind(&self, id: LightId) -> LightKind {
        match self.stored(id) {
            Stored::Own(light) => light.kind,
            Stored::Virtual(_) => LightKind::Virtual,
        }
    }

    /// Whether the light is one of the scene's own, and none that stands for what a surface sends on.
    pub fn is_source(&self, id: LightId) -> bool {
        id.index() < self.own.len()
    }

    /// Least and greatest corner of the box around all points that the light shines from: its position, or a triangle
    /// with the offset of its points. `None` for distant lights.
    pub fn bounds(&self, id: LightId) -> Option<(Vec3, Vec3)> {
        match self.kind(id) {
            LightKind::Omni | LightKind::Spot | LightKind::Virtual => {
                Some((self.position(id), self.position(id)))
            }
            LightKind::Triangle => {
                let area = &self.areas[self.detail(id)];
                Some((area.lo, area.hi))
            }
            LightKind::Directional | LightKind::Environment => None,
        }
    }

    /// The leaf that a tree has for the light.
    pub fn leaf(&self, id: LightId) -> Node {
        let scalar = luminance(self.intensity(id));
        match self.bounds(id) {
            Some((lo, hi)) => Node::leaf(lo, hi, scalar, id),
            None => Node::leaf(Vec3::INFINITY, Vec3::NEG_INFINITY, 0.0, id),
        }
    }

    /// Where the light shines, or for distant light where it travels.
    pub fn emission(&self, id: LightId) -> Emission {
        let axis = Cone::of(self.axis(id));
        let (cone, profile) = match self.kind(id) {
            LightKind::Omni | LightKind::Virtual | LightKind::Directional => {
                (axis, Profile::Cosine)
            }
            LightKind::Spot => {
                // As wide as rounding may make it.
                let cos = (self.spots[self.detail(id)].cos_outer - SLACK).max(-1.0);
                (Cone { cos, ..axis }, Profile::Beam)
            }
            LightKind::Triangle => (axis, Profile::BothSides),
            LightKind::Environment => (self.cells[self.detail(id)].travel, Profile::Cosine),
        };
        Emission { cone, profile }
    }

    /// The cone of a spot light.
    ///
    /// # Panics
    /// For other kinds.
    #[inline]
    pub fn spot(&self, id: LightId) -> SpotCone {
        debug_assert!(self.kind(id) == LightKind::Spot, "{id:?} is no spot light");
        self.spots[self.detail(id)]
    }

    /// Which triangle, or which cell of the environment, as the scene counts them.
    ///
    /// # Panics
    /// For other kinds.
    #[inline]
    pub fn element(&self, id: LightId) -> u32 {
        match self.kind(id) {
            LightKind::Triangle => self.areas[self.detail(id)].element,
            kind => {
                debug_assert!(kind == LightKind::Environment, "{id:?} has no element");
                self.cells[self.detail(id)].element
            }
        }
    }

    /// Greatest that light of one drawn point of a light of `kind` can be over what its intensity says, by channel.
    pub fn peak(&self, kind: LightKind) -> f32 {
        match kind {
            LightKind::Triangle => self.peaks[0],
            LightKind::Environment => self.peaks[1],
            LightKind::Omni | LightKind::Spot | LightKind::Virtual | LightKind::Directional => 1.0,
        }
    }

    /// Of one of the scene's own lights.
    #[inline]
    fn detail(&self, id: LightId) -> usize {
        self.own[id.index()].detail as usize
    }

    /// All ids in order.
    pub fn ids(&self) -> impl Iterator<Item = LightId> + use<> {
        (0..self.len() as u32).map(LightId)
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.own.len() * size_of::<Light>()
            + self.virtuals.len() * size_of::<PackedLight>()
            + self.spots.len() * size_of::<SpotCone>()
            + self.areas.len() * size_of::<Area>()
            + self.cells.len() * size_of::<Cell>()
            + self.bounces.len() * size_of::<u16>()
            + self.glosses.len() * size_of::<PackedGloss>()
    }
}

fn check_colour(c: Vec3) {
    assert!(
        c.is_finite() && c.min_element() >= 0.0,
        "light colour {c} is not finite and >= 0"
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::VirtualLight;

    #[test]
    fn lights_without_power_are_not_added() {
        let mut set = LightSet::default();
        assert!(!set.push_point(Vec3::ZERO, Vec3::ZERO), "black point light");
        assert!(
            set.push_point(Vec3::ZERO, Vec3::new(0.0, 1e-30, 0.0)),
            "dim point light"
        );
        let black_surface = VirtualLight {
            position: Vec3::ZERO,
            normal: Vec3::Y,
            intensity: Vec3::ZERO,
            gloss: None,
        };
        assert!(
            !set.push_virtual(&black_surface),
            "light on a black surface"
        );
        assert_eq!(set.len(), 1, "only the dim one");
    }
}
