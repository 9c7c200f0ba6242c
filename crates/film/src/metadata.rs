//! What a picture's file says about the picture.

/// What an EXR says about itself, beside its pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metadata {
    /// Names (1 to 245 bytes, none of them 0, each once) and values, stored as strings named `manylight.NAME`.
    pub texts: Vec<(String, String)>,
    /// Stored as `worldToCamera` and `worldToNDC`.
    pub camera: Option<CameraMatrices>,
}

/// Where the camera stood, as EXR's standard attributes have it.
///
/// Row by row, for points as rows on the left: the translation is the last row.
///
/// Source: OpenEXR, "Standard Attributes".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraMatrices {
    /// To the space in which the camera is at the origin, x to the right, y up and z (positive) into the picture.
    pub world_to_camera: [f32; 16],
    /// To the space in which (0, 0) is the picture's upper left corner and (1, 1) its lower right one, after the
    /// division by w.
    pub world_to_ndc: [f32; 16],
}
