//! The lights a tree is built over.

use glam::Vec3;
use rayon::prelude::*;

use crate::cone::Cone;
use crate::emission::{Emission, Profile, SLACK};
use crate::light::{
    EnvironmentCell, Gloss, LightId, LightKind, SpotCone, TriangleLight, VirtualLight, luminance,
};
use crate::prefetch::prefetch;
use crate::tree::Node;

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

/// What every light has, side by side: a light that is drawn is one of a million, and each array that it were spread over
/// would be one more wait for memory.
#[derive(Debug, Clone, Copy)]
#[repr(align(16))]
struct Light {
    position: Vec3,
    axis: Vec3,
    intensity: Vec3,
    /// 0 but for virtual lights.
    radius: f32,
    /// Index into the array of the light's kind, or [`NONE`].
    detail: u32,
    kind: LightKind,
}

/// The detail of a light that has none.
const NONE: u32 = u32::MAX;

/// All lights in use, in one order, virtual lights after all others. Every light has power above zero and finite numbers.
#[derive(Debug, Clone, Default)]
pub struct LightSet {
    lights: Vec<Light>,
    spots: Vec<SpotCone>,
    areas: Vec<Area>,
    cells: Vec<Cell>,
    /// Of the virtual lights that are not matte.
    glosses: Vec<Gloss>,
    virtual_count: usize,
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

    /// Adds a virtual light, or nothing when its surface reflects nothing. Returns whether it was added.
    ///
    /// # Panics
    /// On a non-finite or negative number.
    pub fn push_virtual(&mut self, light: &VirtualLight) -> bool {
        let intensity = light.intensity;
        assert!(
            light.position.is_finite() && light.normal.is_finite(),
            "virtual light {light:?}"
        );
        check_colour(intensity);
        if luminance(intensity) <= 0.0 {
            return false;
        }
        let detail = light.gloss.map_or(NONE, |gloss| {
            assert!(
                gloss.peak >= 0.0 && gloss.peak.is_finite() && gloss.alpha > 0.0,
                "virtual light {light:?}"
            );
            self.glosses.push(gloss);
            self.glosses.len() as u32 - 1
        });
        self.lights.push(Light {
            position: light.position,
            axis: light.normal,
            intensity,
            radius: self.common_radius(),
            detail,
            kind: LightKind::Virtual,
        });
        self.virtual_count += 1;
        true
    }

    /// Appends `parts` in their order, which hold virtual lights only; of their bounces nothing is taken over.
    ///
    /// # Panics
    /// When a part holds a light of another kind.
    pub fn append_virtual(&mut self, parts: &[Self]) {
        let added: usize = parts.iter().map(|part| part.virtual_count).sum();
        assert!(
            added == parts.iter().map(Self::len).sum(),
            "virtual lights come last"
        );
        let old = self.len();
        let radius = self.common_radius();
        let nothing = Light {
            position: Vec3::ZERO,
            axis: Vec3::ZERO,
            intensity: Vec3::ZERO,
            radius,
            detail: NONE,
            kind: LightKind::Virtual,
        };
        self.lights.resize(old + added, nothing);
        let mut rest = &mut self.lights[old..];
        let mut tasks = Vec::with_capacity(parts.len());
        for part in parts {
            let (own, others) = rest.split_at_mut(part.len());
            rest = others;
            tasks.push((own, part, self.glosses.len() as u32));
            self.glosses.extend_from_slice(&part.glosses);
        }
        tasks.into_par_iter().for_each(|(own, part, glosses)| {
            for (light, from) in own.iter_mut().zip(&part.lights) {
                *light = Light { radius, ..*from };
                if from.detail != NONE {
                    light.detail += glosses;
                }
            }
        });
        self.virtual_count += added;
    }

    fn push(
        &mut self,
        position: Vec3,
        axis: Vec3,
        intensity: Vec3,
        kind: LightKind,
        detail: u32,
    ) -> bool {
        assert!(self.virtual_count == 0, "virtual lights come last");
        check_colour(intensity);
        if luminance(intensity) <= 0.0 {
            return false;
        }
        self.lights.push(Light {
            position,
            axis,
            intensity,
            radius: 0.0,
            detail,
            kind,
        });
        true
    }

    /// Sets the radius of all virtual lights, in scene units, finite and ≥ 0.
    pub fn set_radius(&mut self, radius: f32) {
        assert!(
            radius >= 0.0 && radius.is_finite(),
            "virtual light radius {radius}"
        );
        let first = self.first_virtual();
        for light in &mut self.lights[first..] {
            light.radius = radius;
        }
        (self.radius, self.has_radii) = (radius, false);
    }

    /// Sets the radius of each virtual light, in scene units, finite and ≥ 0; of none to leave all with radius 0.
    ///
    /// # Panics
    /// When there are neither none nor as many as virtual lights.
    pub fn set_radii(&mut self, radii: Vec<f32>) {
        assert!(
            radii.is_empty() || radii.len() == self.virtual_count,
            "{} radii of {} virtual lights",
            radii.len(),
            self.virtual_count
        );
        self.set_radius(0.0);
        let sound = |r: &f32| *r >= 0.0 && r.is_finite();
        assert!(radii.iter().all(sound), "virtual light radii");
        let first = self.first_virtual();
        for (light, radius) in self.lights[first..].iter_mut().zip(&radii) {
            light.radius = *radius;
        }
        self.radius = radii.iter().copied().fold(0.0, f32::max);
        self.has_radii = !radii.is_empty();
    }

    /// Says of each virtual light how many surfaces its light has met, its own counted.
    ///
    /// # Panics
    /// When there are not as many as virtual lights.
    pub fn set_bounces(&mut self, bounces: Vec<u16>) {
        assert!(
            bounces.len() == self.virtual_count,
            "bounces of {} of {} virtual lights",
            bounces.len(),
            self.virtual_count
        );
        self.bounces = bounces;
    }

    /// Surfaces that the light of virtual light `id` has met, its own counted; 0 when that was not [set](Self::set_bounces).
    #[inline]
    pub fn bounces(&self, id: LightId) -> u32 {
        if self.bounces.is_empty() {
            0
        } else {
            self.bounces[id.index() - self.first_virtual()].into()
        }
    }

    /// Greatest radius of the virtual lights; 0 when there are none.
    #[inline]
    pub fn greatest_radius(&self) -> f32 {
        self.radius
    }

    /// The radius that half of the virtual lights exceed, or all have; 0 when there are none.
    pub fn median_radius(&self) -> f32 {
        if !self.has_radii {
            return self.radius;
        }
        let virtual_lights = &self.lights[self.first_virtual()..];
        let mut radii: Vec<f32> = virtual_lights.iter().map(|light| light.radius).collect();
        let middle = radii.len() / 2;
        *radii.select_nth_unstable_by(middle, f32::total_cmp).1
    }

    /// What virtual lights to come have.
    fn common_radius(&self) -> f32 {
        if self.has_radii { 0.0 } else { self.radius }
    }

    /// Whether virtual lights differ in radius.
    pub fn has_radii(&self) -> bool {
        self.has_radii
    }

    /// Radius of virtual light `id`.
    #[inline]
    pub fn radius(&self, id: LightId) -> f32 {
        self.lights[id.index()].radius
    }

    /// How virtual light `id` shines; `None` when it is matte, or of another kind.
    #[inline]
    pub fn gloss(&self, id: LightId) -> Option<&Gloss> {
        let Light { kind, detail, .. } = self.lights[id.index()];
        match kind {
            LightKind::Virtual => self.glosses.get(detail as usize),
            _ => None,
        }
    }

    /// Asks for what light `id` is evaluated by: who asks for several before evaluating the first waits once for all. The
    /// gloss of a virtual light lies behind an index, and is not among it.
    #[inline]
    pub fn prefetch(&self, id: LightId) {
        prefetch(self.lights.get(id.index()));
    }

    /// Number of virtual lights that are not matte.
    pub fn gloss_count(&self) -> usize {
        self.glosses.len()
    }

    #[inline]
    fn first_virtual(&self) -> usize {
        self.len() - self.virtual_count
    }

    /// Number of lights.
    pub fn len(&self) -> usize {
        self.lights.len()
    }

    /// Whether there is no light: legal, and black.
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// Number of virtual lights; they are the last ones.
    pub fn virtual_count(&self) -> usize {
        self.virtual_count
    }

    /// Number of lights of `kind`.
    pub fn count(&self, kind: LightKind) -> usize {
        self.lights.iter().filter(|l| l.kind == kind).count()
    }

    /// World-space position, the centre of a triangle; the origin for distant lights.
    #[inline]
    pub fn position(&self, id: LightId) -> Vec3 {
        self.lights[id.index()].position
    }

    /// World-space positions of the virtual lights.
    pub fn virtual_positions(&self) -> Vec<Vec3> {
        let virtual_lights = self.lights[self.first_virtual()..].par_iter();
        virtual_lights.map(|light| light.position).collect()
    }

    /// Unit surface normal of a virtual light or a triangle, axis of a spot, direction in which distant light travels
    /// (for a cell from its middle), zero for omni lights.
    #[inline]
    pub fn axis(&self, id: LightId) -> Vec3 {
        self.lights[id.index()].axis
    }

    /// RGB intensity (W/sr) along the axis, or irradiance (W/m²) of distant light.
    #[inline]
    pub fn intensity(&self, id: LightId) -> Vec3 {
        self.lights[id.index()].intensity
    }

    /// Kind of light.
    #[inline]
    pub fn kind(&self, id: LightId) -> LightKind {
        self.lights[id.index()].kind
    }

    /// Whether the light is one of the scene's own, and none that stands for what a surface sends on.
    pub fn is_source(&self, id: LightId) -> bool {
        id.index() < self.first_virtual()
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

    #[inline]
    fn detail(&self, id: LightId) -> usize {
        self.lights[id.index()].detail as usize
    }

    /// The virtual light as it was stored; `None` for other kinds.
    pub fn virtual_light(&self, id: LightId) -> Option<VirtualLight> {
        (self.kind(id) == LightKind::Virtual).then(|| VirtualLight {
            position: self.position(id),
            normal: self.axis(id),
            intensity: self.intensity(id),
            gloss: self.gloss(id).copied(),
        })
    }

    /// All ids in order.
    pub fn ids(&self) -> impl Iterator<Item = LightId> + use<> {
        (0..self.len() as u32).map(LightId)
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.len() * size_of::<Light>()
            + self.spots.len() * size_of::<SpotCone>()
            + self.areas.len() * size_of::<Area>()
            + self.cells.len() * size_of::<Cell>()
            + self.bounces.len() * size_of::<u16>()
            + self.glosses.len() * size_of::<Gloss>()
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

    #[test]
    fn appending_parts_is_pushing_their_lights() {
        let light = |i: u32| VirtualLight {
            position: Vec3::splat(i as f32),
            normal: Vec3::Y,
            intensity: Vec3::new(1.0, 2.0, i as f32),
            gloss: (i % 3 == 1).then_some(Gloss {
                incoming: Vec3::Y,
                normal: Vec3::Y,
                reflectance: Vec3::splat(0.5),
                diffuse: Vec3::splat(0.3),
                specular: Vec3::splat(0.2),
                alpha: 0.1 + i as f32,
                is_coat: false,
                peak: 3.0,
            }),
        };
        let set = |numbers: &[u32], has_source: bool| {
            let mut set = LightSet::default();
            if has_source {
                set.push_point(Vec3::ONE, Vec3::ONE);
            }
            for &i in numbers {
                set.push_virtual(&light(i));
            }
            set
        };
        // Matte and glossy ones, in what is there and in what comes.
        for first in [&[][..], &[0, 3], &[0, 1, 2]] {
            for parts in [
                &[&[3, 6][..], &[], &[9]][..],
                &[&[0], &[1, 2, 4], &[6, 9], &[7]],
            ] {
                let mut appended = set(first, true);
                let parts: Vec<LightSet> = parts.iter().map(|part| set(part, false)).collect();
                appended.append_virtual(&parts);
                let mut numbers = first.to_vec();
                for part in &parts {
                    let positions = part.virtual_positions().into_iter();
                    numbers.extend(positions.map(|position| position.x as u32));
                }
                let pushed = set(&numbers, true);
                assert_eq!(
                    format!("{appended:?}"),
                    format!("{pushed:?}"),
                    "{numbers:?}"
                );
            }
        }
    }

    #[test]
    fn only_glossy_lights_have_gloss_and_matte_ones_need_no_memory_for_it() {
        let mut set = LightSet::default();
        set.push_point(Vec3::ONE, Vec3::ONE);
        let matte = VirtualLight {
            position: Vec3::new(1.0, 2.0, 3.0),
            normal: Vec3::Y,
            intensity: Vec3::new(1.0, 2.0, 3.0),
            gloss: None,
        };
        let gloss = Gloss {
            incoming: Vec3::new(0.6, 0.8, 0.0),
            normal: Vec3::Y,
            reflectance: Vec3::splat(0.5),
            diffuse: Vec3::splat(0.3),
            specular: Vec3::splat(0.2),
            alpha: 0.1,
            is_coat: false,
            peak: 3.0,
        };
        let glossy = VirtualLight {
            gloss: Some(gloss),
            ..matte
        };
        set.push_virtual(&matte);
        let (one, bytes) = (set.bytes() - LightSet::default().bytes(), set.bytes());
        assert!(one < 100, "{one} bytes for two lights");
        for light in [&matte, &glossy, &matte] {
            set.push_virtual(light);
        }
        let found: Vec<_> = set.ids().map(|id| set.virtual_light(id)).collect();
        let stored = [None, Some(matte), Some(matte), Some(glossy), Some(matte)];
        assert_eq!(found, stored, "as they were stored");
        assert!(set.bytes() > bytes, "counted");
    }

    #[test]
    fn radii_are_common_or_each_lights_own() {
        let mut set = LightSet::default();
        set.push_point(Vec3::ONE, Vec3::ONE);
        for _ in 0..2 {
            set.push_virtual(&VirtualLight {
                position: Vec3::ZERO,
                normal: Vec3::Y,
                intensity: Vec3::ONE,
                gloss: None,
            });
        }
        set.set_radius(0.5);
        assert_eq!(set.radius(LightId(2)), 0.5, "common");
        set.set_radii(vec![0.1, 0.3]);
        let own = [set.radius(LightId(1)), set.radius(LightId(2))];
        assert_eq!((own, set.greatest_radius()), ([0.1, 0.3], 0.3), "own");
    }
}
