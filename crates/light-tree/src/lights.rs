//! The lights a tree is built over, as a structure of arrays.

use glam::Vec3;

/// Index of a light in a [`LightSet`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LightId(pub u32);

impl LightId {
    /// As an index into the set's arrays.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// How a light's contribution falls off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightKind {
    /// Shines alike in every direction, inverse square.
    Omni,
    /// A virtual spherical light: cosine emission about its axis, inverse square outside its sphere.
    Virtual,
    /// Parallel light along its axis, no attenuation.
    Directional,
}

/// A virtual light, as a particle leaves it where it hits a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualLight {
    /// Where the particle hit, moved off the surface along `normal` by the hit's error bound.
    pub position: Vec3,
    /// Unit surface normal on the side the particle came from.
    pub normal: Vec3,
    /// Unit direction from the surface back to where the particle came from.
    pub incoming: Vec3,
    /// Power that arrives, W, already divided by the number of paths.
    pub flux: Vec3,
    /// Diffuse reflectance of the surface, so that intensity along the normal is flux · reflectance / π.
    pub reflectance: Vec3,
    /// The surface's material, an index the scene understands and this crate does not.
    pub material: u32,
}

/// What only virtual lights have.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Origin {
    pub(crate) incoming: Vec3,
    pub(crate) flux: Vec3,
    pub(crate) reflectance: Vec3,
    pub(crate) material: u32,
}

/// All lights in use: a structure of arrays in one order, omni and directional lights first, virtual
/// ones after them. Every light has power above zero and finite numbers.
#[derive(Debug, Clone, Default)]
pub struct LightSet {
    positions: Vec<Vec3>,
    axes: Vec<Vec3>,
    intensities: Vec<Vec3>,
    kinds: Vec<LightKind>,
    origins: Vec<Origin>,
    radius: f32,
}

/// The scalar by which lights are weighed: the mean of the channels, above 0 wherever a channel is.
#[inline]
pub fn luminance(c: Vec3) -> f32 {
    (c.x + c.y + c.z) * (1.0 / 3.0)
}

impl LightSet {
    /// Adds a point light of `intensity` W/sr, or nothing when it has no power. Returns whether it was added.
    ///
    /// # Panics
    /// On a non-finite or negative number, or after a virtual light was added.
    pub fn push_point(&mut self, position: Vec3, intensity: Vec3) -> bool {
        assert!(position.is_finite(), "point light at {position}");
        self.push(position, Vec3::ZERO, intensity, LightKind::Omni)
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
        self.push(Vec3::ZERO, direction, irradiance, LightKind::Directional)
    }

    /// Adds a virtual light, or nothing when its surface reflects none of its flux. Returns whether it was added.
    ///
    /// # Panics
    /// On a non-finite or negative number.
    pub fn push_virtual(&mut self, light: &VirtualLight) -> bool {
        let intensity = light.flux * light.reflectance * std::f32::consts::FRAC_1_PI;
        assert!(
            light.position.is_finite() && light.normal.is_finite(),
            "virtual light {light:?}"
        );
        check_colour(intensity);
        if luminance(intensity) <= 0.0 {
            return false;
        }
        self.positions.push(light.position);
        self.axes.push(light.normal);
        self.intensities.push(intensity);
        self.kinds.push(LightKind::Virtual);
        self.origins.push(Origin {
            incoming: light.incoming,
            flux: light.flux,
            reflectance: light.reflectance,
            material: light.material,
        });
        true
    }

    fn push(&mut self, position: Vec3, axis: Vec3, intensity: Vec3, kind: LightKind) -> bool {
        assert!(self.origins.is_empty(), "virtual lights come last");
        check_colour(intensity);
        if luminance(intensity) <= 0.0 {
            return false;
        }
        self.positions.push(position);
        self.axes.push(axis);
        self.intensities.push(intensity);
        self.kinds.push(kind);
        true
    }

    /// Sets the radius of all virtual lights, in scene units, finite and ≥ 0.
    pub fn set_radius(&mut self, radius: f32) {
        assert!(
            radius >= 0.0 && radius.is_finite(),
            "virtual light radius {radius}"
        );
        self.radius = radius;
    }

    /// Radius of the virtual lights; 0 when there are none.
    #[inline]
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Number of lights.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no light: legal, and black.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Number of virtual lights; they are the last ones.
    pub fn virtual_count(&self) -> usize {
        self.origins.len()
    }

    /// Number of lights of `kind`.
    pub fn count(&self, kind: LightKind) -> usize {
        self.kinds.iter().filter(|&&k| k == kind).count()
    }

    /// World-space position; the origin for directional lights.
    #[inline]
    pub fn position(&self, id: LightId) -> Vec3 {
        self.positions[id.index()]
    }

    /// Unit surface normal of a virtual light, travel direction of a directional one, zero for omni lights.
    #[inline]
    pub fn axis(&self, id: LightId) -> Vec3 {
        self.axes[id.index()]
    }

    /// RGB intensity (W/sr) along the axis, or irradiance (W/m²) of a directional light.
    #[inline]
    pub fn intensity(&self, id: LightId) -> Vec3 {
        self.intensities[id.index()]
    }

    /// Kind of light.
    #[inline]
    pub fn kind(&self, id: LightId) -> LightKind {
        self.kinds[id.index()]
    }

    /// The virtual light as it was stored; `None` for other kinds.
    pub fn virtual_light(&self, id: LightId) -> Option<VirtualLight> {
        let first = self.len() - self.origins.len();
        let origin = self.origins.get(id.index().checked_sub(first)?)?;
        Some(VirtualLight {
            position: self.position(id),
            normal: self.axis(id),
            incoming: origin.incoming,
            flux: origin.flux,
            reflectance: origin.reflectance,
            material: origin.material,
        })
    }

    /// All ids in order.
    pub fn ids(&self) -> impl Iterator<Item = LightId> + use<> {
        (0..self.len() as u32).map(LightId)
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.len() * (3 * size_of::<Vec3>() + size_of::<LightKind>())
            + self.origins.len() * size_of::<Origin>()
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
            incoming: Vec3::Y,
            flux: Vec3::ONE,
            reflectance: Vec3::ZERO,
            material: 0,
        };
        assert!(
            !set.push_virtual(&black_surface),
            "light on a black surface"
        );
        assert_eq!(set.len(), 1, "only the dim one");
    }

    #[test]
    fn a_virtual_light_comes_back_as_it_was_stored() {
        let mut set = LightSet::default();
        set.push_point(Vec3::ONE, Vec3::ONE);
        let light = VirtualLight {
            position: Vec3::new(1.0, 2.0, 3.0),
            normal: Vec3::Y,
            incoming: Vec3::new(0.6, 0.8, 0.0),
            flux: Vec3::new(1.0, 2.0, 3.0),
            reflectance: Vec3::splat(0.5),
            material: 7,
        };
        set.push_virtual(&light);
        assert_eq!(set.virtual_light(LightId(0)), None, "the point light");
        assert_eq!(
            set.virtual_light(LightId(1)),
            Some(light),
            "the virtual one"
        );
    }
}
