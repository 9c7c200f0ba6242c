//! What only virtual lights have.

use glam::Vec3;
use rayon::prelude::*;

use super::packed::{PackedGloss, PackedLight};
use super::{LightSet, Stored, check_colour};
use crate::light::{Gloss, LightId, VirtualLight, luminance};
use crate::prefetch::prefetch;

impl LightSet {
    /// Adds a virtual light, or nothing when its surface reflects nothing. Returns whether it was added. Its normal is kept to 7·10⁻⁵
    /// radians, and so are the directions of its gloss, whose colours are kept to a part in 10⁵.
    ///
    /// # Panics
    /// On a non-finite or negative number, or when the gloss has a colour of 2 or more.
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
        let mut packed = PackedLight::of(light);
        match &light.gloss {
            None => packed.set_matte_radius(self.common_radius()),
            Some(gloss) => {
                let colours = [gloss.reflectance, gloss.diffuse, gloss.specular];
                assert!(
                    gloss.peak >= 0.0
                        && gloss.peak.is_finite()
                        && gloss.alpha > 0.0
                        && colours
                            .iter()
                            .all(|c| c.min_element() >= 0.0 && c.max_element() < 2.0),
                    "virtual light {light:?}"
                );
                packed.set_gloss(self.glosses.len());
                let gloss = PackedGloss::of(gloss, self.common_radius());
                self.glosses.push(gloss);
            }
        }
        self.virtuals.push(packed);
        true
    }

    /// Appends `parts` in their order, which hold virtual lights only; of their radii and bounces nothing is taken over.
    ///
    /// # Panics
    /// When a part holds a light of another kind.
    pub fn append_virtual(&mut self, parts: &[Self]) {
        assert!(
            parts.iter().all(|part| part.own.is_empty()),
            "virtual lights come last"
        );
        let radius = self.common_radius();
        let (old, old_glosses) = (self.virtuals.len(), self.glosses.len());
        let added: usize = parts.iter().map(Self::len).sum();
        self.virtuals.resize(old + added, PackedLight::NOTHING);
        let mut rest = &mut self.virtuals[old..];
        let mut tasks = Vec::with_capacity(parts.len());
        for part in parts {
            let (own, others) = rest.split_at_mut(part.len());
            rest = others;
            tasks.push((own, part, self.glosses.len()));
            self.glosses.extend_from_slice(&part.glosses);
        }
        for gloss in &mut self.glosses[old_glosses..] {
            gloss.radius = radius;
        }
        tasks.into_par_iter().for_each(|(own, part, glosses)| {
            for (light, from) in own.iter_mut().zip(&part.virtuals) {
                *light = *from;
                match from.gloss() {
                    None => light.set_matte_radius(radius),
                    Some(place) => light.set_gloss(glosses + place),
                }
            }
        });
    }

    /// Sets the radius of all virtual lights, in scene units, finite and ≥ 0.
    pub fn set_radius(&mut self, radius: f32) {
        assert!(
            radius >= 0.0 && radius.is_finite(),
            "virtual light radius {radius}"
        );
        for light in &mut self.virtuals {
            set_radius(light, &mut self.glosses, radius);
        }
        (self.radius, self.has_radii) = (radius, false);
    }

    /// Sets the radius of each virtual light, in scene units, finite and ≥ 0; of none to leave all with radius 0.
    ///
    /// # Panics
    /// When there are neither none nor as many as virtual lights.
    pub fn set_radii(&mut self, radii: Vec<f32>) {
        assert!(
            radii.is_empty() || radii.len() == self.virtuals.len(),
            "{} radii of {} virtual lights",
            radii.len(),
            self.virtuals.len()
        );
        self.set_radius(0.0);
        let sound = |r: &f32| *r >= 0.0 && r.is_finite();
        assert!(radii.iter().all(sound), "virtual light radii");
        for (light, radius) in self.virtuals.iter_mut().zip(&radii) {
            set_radius(light, &mut self.glosses, *radius);
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
            bounces.len() == self.virtuals.len(),
            "bounces of {} of {} virtual lights",
            bounces.len(),
            self.virtuals.len()
        );
        self.bounces = bounces;
    }

    /// Surfaces that the light of virtual light `id` has met, its own counted; 0 when that was not [set](Self::set_bounces).
    #[inline]
    pub fn bounces(&self, id: LightId) -> u32 {
        if self.bounces.is_empty() {
            0
        } else {
            self.bounces[id.index() - self.own.len()].into()
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
        let radii = self.virtuals.iter().map(|light| self.radius_of(light));
        let mut radii: Vec<f32> = radii.collect();
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

    /// Radius of virtual light `id`; 0 for other kinds.
    #[inline]
    pub fn radius(&self, id: LightId) -> f32 {
        match self.stored(id) {
            Stored::Own(_) => 0.0,
            Stored::Virtual(light) => self.radius_of(light),
        }
    }

    #[inline]
    fn radius_of(&self, light: &PackedLight) -> f32 {
        match light.gloss() {
            None => light.matte_radius(),
            Some(place) => self.glosses[place].radius,
        }
    }

    /// Asks for the gloss of light `id`, if it has one. Reads the light itself, which should have [arrived](Self::prefetch).
    #[inline]
    pub fn prefetch_gloss(&self, id: LightId) {
        if let Stored::Virtual(light) = self.stored(id) {
            prefetch(light.gloss().and_then(|place| self.glosses.get(place)));
        }
    }

    /// Whether light `id` is a virtual light that is not matte.
    #[inline]
    pub fn is_glossy(&self, id: LightId) -> bool {
        match self.stored(id) {
            Stored::Own(_) => false,
            Stored::Virtual(light) => light.gloss().is_some(),
        }
    }

    /// How virtual light `id` shines; `None` when it is matte, or of another kind.
    #[inline]
    pub fn gloss(&self, id: LightId) -> Option<Gloss> {
        match self.stored(id) {
            Stored::Own(_) => None,
            Stored::Virtual(light) => light.gloss().map(|place| self.glosses[place].get()),
        }
    }

    /// Number of virtual lights that are not matte.
    pub fn gloss_count(&self) -> usize {
        self.glosses.len()
    }

    /// Number of virtual lights; they are the last ones.
    pub fn virtual_count(&self) -> usize {
        self.virtuals.len()
    }

    /// World-space positions of the virtual lights.
    pub fn virtual_positions(&self) -> Vec<Vec3> {
        let lights = self.virtuals.par_iter();
        lights.map(|light| light.position).collect()
    }

    /// The virtual light as it is kept; `None` for other kinds.
    pub fn virtual_light(&self, id: LightId) -> Option<VirtualLight> {
        match self.stored(id) {
            Stored::Own(_) => None,
            Stored::Virtual(light) => Some(VirtualLight {
                position: light.position,
                normal: light.normal(),
                intensity: light.intensity,
                gloss: self.gloss(id),
            }),
        }
    }
}

/// Sets a light's radius, where that is kept.
fn set_radius(light: &mut PackedLight, glosses: &mut [PackedGloss], radius: f32) {
    match light.gloss() {
        None => light.set_matte_radius(radius),
        Some(place) => glosses[place].radius = radius,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of numbers that are not rounded.
    const GLOSS: Gloss = Gloss {
        incoming: Vec3::X,
        normal: Vec3::Y,
        reflectance: Vec3::splat(0.5),
        diffuse: Vec3::splat(0.375),
        specular: Vec3::splat(0.125),
        alpha: 0.1,
        is_coat: false,
        peak: 3.0,
    };

    #[test]
    fn appending_parts_is_pushing_their_lights() {
        let light = |i: u32| VirtualLight {
            position: Vec3::splat(i as f32),
            normal: Vec3::Y,
            intensity: Vec3::new(1.0, 2.0, i as f32),
            gloss: (i % 3 == 1).then_some(Gloss {
                alpha: 0.1 + i as f32,
                ..GLOSS
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
        let glossy = VirtualLight {
            gloss: Some(GLOSS),
            ..matte
        };
        set.push_virtual(&matte);
        let (one, bytes) = (set.bytes() - LightSet::default().bytes(), set.bytes());
        assert_eq!(one, 48 + 32, "bytes for two lights");
        for light in [&matte, &glossy, &matte] {
            set.push_virtual(light);
        }
        let found: Vec<_> = set.ids().map(|id| set.virtual_light(id)).collect();
        let stored = [None, Some(matte), Some(matte), Some(glossy), Some(matte)];
        assert_eq!(found, stored, "as they were pushed");
        assert!(set.bytes() > bytes, "counted");
    }

    #[test]
    fn radii_are_common_or_each_lights_own() {
        let mut set = LightSet::default();
        set.push_point(Vec3::ONE, Vec3::ONE);
        for gloss in [None, Some(GLOSS), None] {
            set.push_virtual(&VirtualLight {
                position: Vec3::ZERO,
                normal: Vec3::Y,
                intensity: Vec3::ONE,
                gloss,
            });
        }
        let radii = |set: &LightSet| [0, 1, 2, 3].map(|i| set.radius(LightId(i)));
        set.set_radius(0.5);
        assert_eq!(radii(&set), [0.0, 0.5, 0.5, 0.5], "common, but of a lamp");
        set.set_radii(vec![0.1, 0.2, 0.3]);
        assert_eq!(radii(&set), [0.0, 0.1, 0.2, 0.3], "own");
        assert_eq!((set.greatest_radius(), set.median_radius()), (0.3, 0.2));
    }
}
