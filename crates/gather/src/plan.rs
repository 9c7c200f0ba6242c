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
                            || m.emission_map.is_some()
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

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use light_tree::{SpotCone, VirtualLight};
    use scene::{Channel, Environment, Material, TextureId};

    use super::*;

    /// Something that gives a scene or its lights a feature.
    type Add = fn(&mut Scene, &mut LightSet);

    const ADDED: &[(&str, Add)] = &[
        ("triangles", |scene, _| scene.mesh.indices.push([0, 1, 2])),
        ("smooth normals", |scene, _| {
            scene.mesh.normal_indices.push([0; 3]);
        }),
        ("textures", |scene, _| material(scene).diffuse_map = MAP),
        ("textures", |scene, _| material(scene).emission_map = MAP),
        ("textures", |scene, _| {
            material(scene).roughness_map = CHANNEL;
        }),
        ("textures", |scene, _| {
            material(scene).metallic_map = CHANNEL
        }),
        ("vertex colours", |scene, _| {
            scene.mesh.colour_indices.push([0; 3]);
        }),
        ("glossy surfaces", |scene, _| {
            material(scene).specular = Vec3::splat(1e-30);
        }),
        ("glossy surfaces", |scene, _| {
            material(scene).metallic = Some(0.0);
        }),
        ("normal maps", |scene, _| material(scene).normal_map = MAP),
        ("cut-outs", |scene, _| material(scene).opacity_map = MAP),
        ("cut-outs", |scene, _| material(scene).opacity = 0.4),
        ("point lights", |_, lights| {
            lights.push_point(Vec3::ZERO, Vec3::ONE);
        }),
        ("directional lights", |_, lights| {
            lights.push_directional(Vec3::X, Vec3::ONE);
        }),
        ("spot lights", |_, lights| {
            let cone = SpotCone {
                cos_inner: 0.5,
                cos_outer: 0.0,
            };
            lights.push_spot(Vec3::ZERO, Vec3::X, Vec3::ONE, cone);
        }),
        ("emissive triangles", |scene, _| scene.emissive.push(true)),
        ("environment", |scene, _| {
            scene.environment = Environment::constant(Vec3::ONE);
        }),
        ("virtual lights", |_, lights| {
            lights.push_virtual(&VirtualLight {
                position: Vec3::ZERO,
                normal: Vec3::Y,
                intensity: Vec3::ONE,
                gloss: None,
            });
        }),
    ];

    const MAP: Option<TextureId> = Some(TextureId(0));
    const CHANNEL: Option<Channel> = Some(Channel {
        texture: TextureId(0),
        index: 1,
    });

    fn material(scene: &mut Scene) -> &mut Material {
        &mut scene.materials[0]
    }

    #[test]
    fn each_feature_is_named_by_what_has_it_and_skipped_by_what_lacks_it() {
        let of = |adds: &[Add], uses_tree| {
            let (mut scene, mut lights) = (Scene::default(), LightSet::default());
            scene.materials.push(Material::default());
            for add in adds {
                add(&mut scene, &mut lights);
            }
            Plan::of(&scene, &lights, uses_tree)
        };
        let plain = of(&[], false);
        assert!(plain.needs().is_empty(), "{plain:?}");
        let mut all = plain.skipped();
        for &(name, add) in ADDED {
            assert_eq!(of(&[add], false).needs(), [name], "needed");
            assert!(!of(&[add], false).skipped().contains(&name), "{name}");
            all.retain(|left| *left != name);
        }
        assert_eq!(all, ["light tree", BOUNCES], "of what no scene says");
        assert_eq!(of(&[], true).needs(), ["light tree"], "by the method");
        let mut bouncing = plain;
        bouncing.need(BOUNCES);
        assert_eq!(bouncing.needs(), [BOUNCES], "by the integrator");
    }
}
