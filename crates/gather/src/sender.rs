//! How a virtual light sends on what its surface received.

use std::f32::consts::PI;

use glam::Vec3;
use light_tree::{Gloss, LightId, LightSet};
use scene::{Brdf, Fresnel};

/// A glossy virtual light.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GlossySender {
    pub(crate) brdf: Brdf,
    /// Shading normal.
    pub(crate) normal: Vec3,
    /// Toward where its light came from.
    pub(crate) incoming: Vec3,
    /// π over reflectance, which turns BRDF values into shares of the light's intensity; 0 where nothing is reflected.
    pub(crate) scale: Vec3,
}

impl GlossySender {
    /// `None` for matte lights, and for lights that are not virtual.
    #[inline]
    pub(crate) fn of(lights: &LightSet, id: LightId) -> Option<Self> {
        lights.gloss(id).map(|gloss| Self::new(&gloss))
    }

    fn new(gloss: &Gloss) -> Self {
        let reflects = gloss.reflectance.cmpgt(Vec3::ZERO);
        Self {
            brdf: Brdf {
                diffuse: gloss.diffuse,
                specular: gloss.specular,
                alpha: gloss.alpha,
                fresnel: match gloss.is_coat {
                    true => Fresnel::Schlick,
                    false => Fresnel::Constant,
                },
            },
            normal: gloss.normal,
            incoming: gloss.incoming,
            scale: Vec3::select(reflects, PI / gloss.reflectance, Vec3::ZERO),
        }
    }

    /// What is sent along unit `w`, which leaves the light, over the light's intensity; the cosine is not included.
    pub(crate) fn emitted(&self, w: Vec3) -> Vec3 {
        if self.normal.dot(w) > 0.0 {
            self.brdf.eval(self.normal, self.incoming, w) * self.scale
        } else {
            Vec3::ZERO
        }
    }
}
