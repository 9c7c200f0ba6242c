//! What a scene needs, decided once.

use light_tree::{LightKind, LightSet};
use scene::Scene;

/// Name of the feature that eye paths go on behind their first hit; see [`Plan::need`].
pub const BOUNCES: &str = "eye paths that bounce";

/// Features of a render, each either needed or skipped; scanned once and printed in the report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    features: Vec<(&'static str, bool)>,
}

impl Plan {
    /// Scans the scene and the lights in use. `uses_tree` says whether the method built a light tree.
    pub fn of(scene: &Scene, lights: &LightSet, uses_tree: bool) -> Self {
        let materials = &scene.materials;
        let has_normals = scene
            .mesh
            .normal_indices
            .iter()
            .any(|n| n[0] != scene::ABSENT);
        Self {
            features: vec![
                ("triangles", !scene.mesh.is_empty()),
                ("smooth normals", has_normals),
                (
                    "textures",
                    materials.iter().any(|m| {
                        m.diffuse_map.is_some()
                            || m.roughness_map.is_some()
                            || m.metallic_map.is_some()
                    }),
                ),
                ("vertex colours", !scene.mesh.colour_indices.is_empty()),
                (
                    "glossy surfaces",
                    materials.iter().any(scene::Material::is_glossy),
                ),
                (
                    "normal maps",
                    materials.iter().any(|m| m.normal_map.is_some()),
                ),
                (
                    "cut-outs",
                    materials
                        .iter()
                        .any(|m| m.opacity_map.is_some() || m.opacity < 0.5),
                ),
                ("point lights", lights.count(LightKind::Omni) > 0),
                (
                    "directional lights",
                    lights.count(LightKind::Directional) > 0,
                ),
                ("spot lights", lights.count(LightKind::Spot) > 0),
                ("emissive triangles", !scene.emissive.is_empty()),
                ("environment", scene.environment.is_some()),
                ("virtual lights", lights.virtual_count() > 0),
                ("light tree", uses_tree),
                (BOUNCES, false),
            ],
        }
    }

    /// Notes that a feature is needed that the lights at hand do not show yet.
    pub fn need(&mut self, feature: &str) {
        for (name, needed) in &mut self.features {
            *needed |= *name == feature;
        }
    }

    /// Features that the render pays for.
    pub fn needs(&self) -> Vec<&'static str> {
        self.features.iter().filter(|f| f.1).map(|f| f.0).collect()
    }

    /// Features that the scene does not have, and that cost nothing.
    pub fn skipped(&self) -> Vec<&'static str> {
        self.features.iter().filter(|f| !f.1).map(|f| f.0).collect()
    }
}
