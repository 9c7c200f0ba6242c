//! Images on surfaces.

/// Index into [`Scene::textures`](crate::Scene::textures).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub u32);

/// An 8-bit sRGB image with straight alpha, repeated over the plane.
#[derive(Debug, Clone)]
pub struct Texture {
    /// File it came from, for messages.
    pub path: String,
    /// Texels across, at least 1.
    pub width: u32,
    /// Texels down, at least 1.
    pub height: u32,
    /// Row by row from the top; `width * height` entries of sRGB red, green, blue and linear alpha.
    pub texels: Vec<[u8; 4]>,
    /// Whether the file has an alpha channel; where it has none, opacity is the red channel.
    pub has_alpha: bool,
}
