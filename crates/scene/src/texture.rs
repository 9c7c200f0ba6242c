//! Images on surfaces.

use std::sync::LazyLock;

use glam::{Vec2, Vec3};

use crate::prefetch::prefetch;

/// Index into [`Scene::textures`](crate::Scene::textures).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub u32);

/// One channel of a texture, for a number that varies over a surface. Its bytes are linear, 255 is 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Channel {
    /// The image.
    pub texture: TextureId,
    /// 0 red, 1 green, 2 blue, 3 alpha.
    pub index: u8,
}

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

/// Linear value of every sRGB byte (IEC 61966-2-1).
static SRGB_TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let c = i as f64 / 255.0;
        (if c <= 0.040_45 {
            c / 12.92
        } else {
            ((c + 0.055) / 1.055).powf(2.4)
        }) as f32
    })
});

impl Texture {
    /// Linear RGB at `uv`, bilinear between texel centres.
    pub fn colour(&self, uv: Vec2) -> Vec3 {
        let table = &*SRGB_TO_LINEAR;
        self.bilinear(uv, |[r, g, b, _]| {
            Vec3::new(
                table[usize::from(r)],
                table[usize::from(g)],
                table[usize::from(b)],
            )
        })
    }

    /// The greatest linear value of each channel anywhere.
    pub(crate) fn brightest(&self) -> Vec3 {
        let greatest = self.texels.iter().fold([0; 3], |most, texel| {
            std::array::from_fn(|c| texel[c].max(most[c]))
        });
        greatest.map(|c| SRGB_TO_LINEAR[usize::from(c)]).into()
    }

    /// Opacity at `uv` in [0, 1], bilinear: alpha, or red where the file has no alpha.
    pub fn opacity(&self, uv: Vec2) -> f32 {
        self.bilinear(uv, |[r, _, _, a]| {
            f32::from(if self.has_alpha { a } else { r }) / 255.0
        })
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.texels[..])
    }

    /// Channel `index`, below 4, at `uv` in [0, 1], bilinear; bytes are linear.
    pub fn channel(&self, uv: Vec2, index: u8) -> f32 {
        self.bilinear(uv, |texel| f32::from(texel[usize::from(index)]) / 255.0)
    }

    /// The texels as a normal map, z outward and green along growing v, bilinear; not normalised.
    pub fn normal(&self, uv: Vec2) -> Vec3 {
        self.bilinear(uv, |[r, g, b, _]| {
            // 128 is 0, so that a flat map is exactly flat.
            Vec3::new(f32::from(r), f32::from(g), f32::from(b)) - 128.0
        })
    }

    /// Whether all texels are grey, as in a map of heights.
    pub fn is_grey(&self) -> bool {
        self.texels.iter().all(|[r, g, b, _]| r == g && g == b)
    }

    /// Asks for the texels around `uv`.
    #[inline]
    pub(crate) fn expect(&self, uv: Vec2) {
        let (x0, _, _) = neighbours(uv.x, self.width);
        let (y0, y1, _) = neighbours(1.0 - uv.y, self.height);
        for y in [y0, y1] {
            prefetch(
                self.texels
                    .get(y as usize * self.width as usize + x0 as usize),
            );
        }
    }

    /// Weighted sum of the four texels around `uv`; v = 0 is the bottom row, both coordinates repeat.
    fn bilinear<T>(&self, uv: Vec2, value: impl Fn([u8; 4]) -> T) -> T
    where
        T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let (x0, x1, fx) = neighbours(uv.x, self.width);
        let (y0, y1, fy) = neighbours(1.0 - uv.y, self.height);
        let at = |x: u32, y: u32| value(self.texels[y as usize * self.width as usize + x as usize]);
        let top = at(x0, y0) * (1.0 - fx) + at(x1, y0) * fx;
        let bottom = at(x0, y1) * (1.0 - fx) + at(x1, y1) * fx;
        top * (1.0 - fy) + bottom * fy
    }
}

/// The greatest whole number that is not above `x`, which is finite. Without SSE4.1 the library's is a call.
#[inline]
fn floor(x: f64) -> f64 {
    // Beyond 2⁵³ all numbers are whole.
    if x.abs() >= 9_007_199_254_740_992.0 {
        return x;
    }
    let whole = x as i64 as f64;
    whole - f64::from(u8::from(whole > x))
}

/// The texels on both sides of repeating coordinate `s` and the weight of the second.
fn neighbours(s: f32, size: u32) -> (u32, u32, f32) {
    // Coordinates can be huge: the fraction is taken first, in f64; not-a-number counts as 0.
    let s = f64::from(s);
    let x = if s.is_finite() {
        (s - floor(s)) * f64::from(size) - 0.5
    } else {
        0.0
    };
    // From -1 to the last.
    let floor = floor(x);
    let second = (floor + 1.0) as u32;
    let first = if second == 0 { size } else { second } - 1;
    (
        first,
        if second == size { 0 } else { second },
        (x - floor) as f32,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floor_is_the_librarys() {
        for x in [
            0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 1e-300, -1e-300, 123.75, -123.75, 1e18, -1e300,
        ] {
            for x in [x, f64::next_up(x), f64::next_down(x)] {
                assert_eq!(floor(x), f64::floor(x), "{x}");
            }
        }
    }

    fn checker() -> Texture {
        // Top row red, green; bottom row blue, half transparent white.
        let texels = vec![
            [255, 0, 0, 255],
            [0, 255, 0, 255],
            [0, 0, 255, 255],
            [255, 255, 255, 128],
        ];
        Texture {
            path: "checker".into(),
            width: 2,
            height: 2,
            texels,
            has_alpha: true,
        }
    }

    #[test]
    fn v_zero_is_the_bottom_row_and_coordinates_repeat() {
        let t = checker();
        for shift in [0.0, 1.0, -3.0] {
            let at = |u: f32, v: f32| t.colour(Vec2::new(u + shift, v + shift));
            assert!(
                at(0.25, 0.75).distance(Vec3::X) < 1e-5,
                "top left at shift {shift}"
            );
            assert!(
                at(0.25, 0.25).distance(Vec3::Z) < 1e-5,
                "bottom left at shift {shift}"
            );
        }
        assert!(
            (t.opacity(Vec2::new(0.75, 0.25)) - 128.0 / 255.0).abs() < 1e-5,
            "alpha of bottom right"
        );
    }

    #[test]
    fn wild_coordinates_stay_inside() {
        let t = checker();
        for s in [
            f32::NAN,
            f32::INFINITY,
            -1e30,
            1e9,
            0.999_999_94,
            -0.0,
            f32::MIN_POSITIVE,
        ] {
            assert!(t.colour(Vec2::splat(s)).is_finite(), "{s}");
        }
    }

    #[test]
    fn middle_grey_is_decoded_from_srgb() {
        let t = Texture {
            path: String::new(),
            width: 1,
            height: 1,
            texels: vec![[188; 4]],
            has_alpha: false,
        };
        assert!(
            (t.colour(Vec2::ZERO).x - 0.5029).abs() < 1e-3,
            "{}",
            t.colour(Vec2::ZERO).x
        );
    }
}
