//! `scene.ron` and files of lights as serde types; every number is checked while it is read.

use glam::Vec3;
use serde::Deserialize;

use crate::CameraSpec;

/// Coordinates beyond this are refused: the triangle test multiplies three lengths, which must stay finite in `f32`.
pub(super) const FARTHEST: f32 = 1e12;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneFile {
    pub(super) geometry: Vec<String>,
    #[serde(default = "one")]
    pub(super) metres_per_unit: Scale,
    /// Else the one of a geometry file.
    #[serde(default)]
    pub(super) camera: Option<SoundCamera>,
    pub(super) lights: Vec<LightEntry>,
}

fn one() -> Scale {
    Scale(1.0)
}

/// What Blender multiplies by when it exports lights in the standard's units, and divides by on import; also the
/// definition of the lumen at 555 nm.
fn blender_lumens_per_watt() -> Scale {
    Scale(683.0)
}

/// One entry of `lights`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) enum LightEntry {
    Points(String),
    Point {
        position: Point,
        intensity: Colour,
    },
    Spot {
        position: Point,
        direction: Direction,
        intensity: Colour,
        cos_inner: Cosine,
        cos_outer: Cosine,
    },
    Directional {
        direction: Direction,
        irradiance: Colour,
    },
    Emissive,
    /// Those of the geometry files.
    FromFile {
        /// Photometric units over radiometric ones.
        #[serde(default = "blender_lumens_per_watt")]
        lumens_per_watt: Scale,
    },
    Environment {
        #[serde(default)]
        radiance: Option<Colour>,
        #[serde(default)]
        image: Option<String>,
        #[serde(default)]
        scale: Option<Scale>,
    },
}

/// One light of a file of lights.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PointLight {
    pub(super) position: Point,
    pub(super) intensity: Colour,
}

type Three = (f32, f32, f32);

/// A place in the scene.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "Three")]
pub(super) struct Point(pub(super) Vec3);

impl TryFrom<Three> for Point {
    type Error = String;
    fn try_from(found: Three) -> Result<Self, String> {
        let point = Vec3::from(found);
        // A comparison with NaN is false.
        match point.abs().max_element() <= FARTHEST && point.is_finite() {
            true => Ok(Self(point)),
            false => Err(format!(
                "found {found:?}; expected three numbers from -{FARTHEST:e} to {FARTHEST:e}"
            )),
        }
    }
}

/// Power, intensity or radiance.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "Three")]
pub(super) struct Colour(pub(super) Vec3);

impl TryFrom<Three> for Colour {
    type Error = String;
    fn try_from(found: Three) -> Result<Self, String> {
        let colour = Vec3::from(found);
        match colour.is_finite() && colour.min_element() >= 0.0 {
            true => Ok(Self(colour)),
            false => Err(format!(
                "found {found:?}; expected three finite numbers, none negative"
            )),
        }
    }
}

/// A direction of any length.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "Three")]
pub(super) struct Direction(pub(super) Vec3);

impl TryFrom<Three> for Direction {
    type Error = String;
    fn try_from(found: Three) -> Result<Self, String> {
        let direction = Vec3::from(found);
        match direction.try_normalize() {
            Some(unit) => Ok(Self(unit)),
            None => Err(format!(
                "found {found:?}; expected a finite direction that is not zero"
            )),
        }
    }
}

/// Defines a number with a range.
macro_rules! number {
    ($(#[$doc:meta])* $name:ident, $range:expr, $expected:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, Deserialize)]
        #[serde(try_from = "f32")]
        pub(super) struct $name(pub(super) f32);

        impl TryFrom<f32> for $name {
            type Error = String;
            fn try_from(found: f32) -> Result<Self, String> {
                let in_range: fn(f32) -> bool = $range;
                match in_range(found) {
                    true => Ok(Self(found)),
                    false => Err(format!(concat!("found {}; expected ", $expected), found)),
                }
            }
        }
    };
}

number!(
    /// A factor.
    Scale, |x| x > 0.0 && x.is_finite(), "a finite number above 0"
);
number!(
    /// Cosine of an angle.
    Cosine, |x| (-1.0..=1.0).contains(&x), "a number from -1 to 1"
);
number!(
    /// Full vertical angle of view, degrees.
    FieldOfView, |x| x > 0.0 && x < 180.0, "degrees above 0 and below 180"
);

/// A camera that has a view: its numbers are in range, its points differ, and `up` is across. The checks are made while
/// it is read.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "CameraFields")]
pub struct SoundCamera(pub CameraSpec);

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename = "CameraSpec")]
struct CameraFields {
    origin: Point,
    target: Point,
    up: Direction,
    fov_y_deg: FieldOfView,
}

impl TryFrom<CameraFields> for SoundCamera {
    type Error = String;
    fn try_from(fields: CameraFields) -> Result<Self, String> {
        let (origin, target, up) = (fields.origin.0, fields.target.0, fields.up.0);
        // In f64: two points of the scene can be as near or as far as f32 allows.
        let Some(view) = (target.as_dvec3() - origin.as_dvec3()).try_normalize() else {
            let found = origin.to_array();
            return Err(format!(
                "origin and target are both {found:?}; expected two different points"
            ));
        };
        // sin² of the angle between them; at 1e-10 (0.0006 degrees) f32 cannot tell the picture's up.
        if view.cross(up.as_dvec3()).length_squared() < 1e-10 {
            return Err(format!(
                "up is {:?}, which is parallel to the view direction; expected another direction",
                up.to_array()
            ));
        }
        Ok(Self(CameraSpec {
            origin,
            target,
            up,
            fov_y_deg: fields.fov_y_deg.0,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::{ANNOTATED, BARE};

    #[test]
    fn the_annotated_scene_says_what_the_types_hold() {
        let parse = |text: &str| match ron_file::parse::<SceneFile>("scene.ron", text, &[], BARE) {
            Ok(_) => Ok(()),
            Err(error) => Err(error.to_string()),
        };
        let found = verify::annotated(ANNOTATED, "", &parse);
        assert_eq!(found.complaints, Vec::<String>::new(), "complaints");
        assert!(found.forms.len() >= 3, "{} forms", found.forms.len());
    }
}
