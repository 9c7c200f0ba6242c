//! FLIP: the difference that someone sees who flips between two images.
//!
//! Source: Andersson et al. 2020, FLIP: A difference evaluator for alternating images, and, for radiance,
//! Andersson et al. 2021, Visualizing errors in rendered high dynamic range images.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::{
    FilmError, Image,
    metrics::check,
    png::{curve, luminance},
};

/// A 0.7 m wide screen of 3840 pixels seen from 0.7 m, the papers' viewing condition.
pub const PIXELS_PER_DEGREE: f32 = 3840.0 * PI / 180.0;

/// Linear sRGB → CIE XYZ, each divided by that of the white point (D65), so that white is (1, 1, 1).
#[rustfmt::skip]
const RGB_TO_XYZ: Mat3 = Mat3::from_cols_array(&[
    // red: X, Y, Z; then green, blue
    0.433_895_4, 0.212_636_8, 0.017_752_42,
    0.376_242_4, 0.715_183,   0.109_465_6,
    0.189_862_2, 0.072_180_2, 0.872_782,
]);

/// Where the papers' tone curve (an ACES fit) reaches 0.85 of its range; see [`exposures`].
const CURVE_BRIGHT: f64 = 0.85;
/// The median of a mostly black reference counts as at least this share of its brightest pixel: 2⁻²³.
const LEAST_MEDIAN: f64 = 1.0 / 8_388_608.0;

/// Rows that are worked on at a time.
const BAND: usize = 32;

/// FLIP of each pixel, 0 to 1, row-major: HDR-FLIP of `image` against `reference`, both linear RGB radiance.
///
/// Both images are exposed to the range that the *reference* asks for: from where its brightest pixel reaches
/// 0.85 on the display to where its median pixel does, in steps of about a stop, the two ends at least. At each
/// exposure they go through a filmic (ACES) curve, are clamped to [0, 1] as linear sRGB, and compared with
/// LDR-FLIP; a pixel's value is its largest over the exposures. Negative values count as zero.
///
/// `pixels_per_degree` of visual angle: [`PIXELS_PER_DEGREE`] (67) as in the papers. Expected > 0.
///
/// Against a reference without positive values the only exposure is 1. Departure from the papers' program: the
/// least median of a mostly black reference is relative to its maximum, so that scaling both images changes
/// nothing.
///
/// Linear in the number of pixels; the same bits whatever the number of threads.
///
/// # Errors
///
/// The sizes differ, there is no pixel, or a pixel is not finite.
pub fn flip_map(
    image: &Image,
    reference: &Image,
    pixels_per_degree: f32,
) -> Result<Vec<f32>, FilmError> {
    check(image, reference)?;
    let exposures = exposures(reference);
    Ok(worst_of(
        image,
        reference,
        pixels_per_degree,
        &exposures,
        tone,
    ))
}

/// FLIP of each pixel, 0 to 1, row-major: LDR-FLIP of the pictures that [`tone_map`](crate::tone_map) makes of
/// both at one `exposure` (finite, > 0), without rounding to 8 bits.
///
/// `pixels_per_degree` as for [`flip_map`].
///
/// # Errors
///
/// Those of [`flip_map`].
pub fn ldr_flip_map(
    image: &Image,
    reference: &Image,
    exposure: f32,
    pixels_per_degree: f32,
) -> Result<Vec<f32>, FilmError> {
    check(image, reference)?;
    let exposures = [f64::from(exposure)];
    Ok(worst_of(
        image,
        reference,
        pixels_per_degree,
        &exposures,
        curve,
    ))
}

/// The largest LDR-FLIP of each pixel over the `exposures`; `display` turns exposed radiance into linear
/// display values from 0 to 1.
fn worst_of(
    image: &Image,
    reference: &Image,
    pixels_per_degree: f32,
    exposures: &[f64],
    display: fn(f32) -> f32,
) -> Vec<f32> {
    let filters = Filters::new(pixels_per_degree);
    let width = image.width as usize;
    let mut worst = vec![0.0_f32; image.pixels.len()];
    // Bands are small enough for the cache, and independent of one another.
    worst
        .par_chunks_mut(BAND * width)
        .enumerate()
        .for_each(|(band, worst)| {
            let height = worst.len() / width;
            for &exposure in exposures {
                let shown = |value: f32| display((f64::from(value) * exposure) as f32);
                let [seen, seen_reference] =
                    [image, reference].map(|image| filters.see(image, band * BAND, height, shown));
                for (i, worst) in worst.iter_mut().enumerate() {
                    *worst = worst.max(filters.difference(&seen, &seen_reference, i));
                }
            }
        });
    worst
}

/// Constants of the tone curve (c₀x² + c₁x) / (c₂x² + c₃x + c₄).
const CURVE: [f64; 5] = [
    0.6 * 0.6 * 2.51,
    0.6 * 0.03,
    0.6 * 0.6 * 2.43,
    0.6 * 0.59,
    0.14,
];

/// Exposed radiance → display, linear, 0 to 1. Rises; 0 at 0 and below.
fn tone(x: f32) -> f32 {
    let [c0, c1, c2, c3, c4] = CURVE.map(|c| c as f32);
    let x = x.clamp(0.0, 1e9); // its square must stay finite, and the curve is flat long before
    ((c0 * x + c1) * x / ((c2 * x + c3) * x + c4)).min(1.0)
}

/// Factors for the radiance, from dark to bright, as the reference asks for.
fn exposures(reference: &Image) -> Vec<f64> {
    let mut luminances: Vec<f64> = reference
        .pixels
        .iter()
        .map(|rgb| luminance(rgb.max(Vec3::ZERO)))
        .collect();
    let middle = luminances.len() / 2;
    let median = *luminances.select_nth_unstable_by(middle, f64::total_cmp).1;
    let largest = luminances.iter().copied().fold(0.0, f64::max);
    if largest <= 0.0 {
        return vec![1.0];
    }
    // tone(x) = t is a quadratic in x; its positive root.
    let [c0, c1, c2, c3, c4] = CURVE;
    let (a, b, c) = (
        c0 - CURVE_BRIGHT * c2,
        c1 - CURVE_BRIGHT * c3,
        -CURVE_BRIGHT * c4,
    );
    let bright = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);

    let first = (bright / largest).log2();
    let last = (bright / median.max(LEAST_MEDIAN * largest)).log2();
    if first == last {
        return vec![first.exp2()];
    }
    let steps = (last - first).ceil().max(2.0) as u32 - 1;
    (0..=steps)
        .map(|i| (first + (last - first) * f64::from(i) / f64::from(steps)).exp2())
        .collect()
}

/// Everything that depends on the viewing condition alone.
struct Filters {
    /// Contrast sensitivity for luminance and red-green: one Gaussian each, of sum 1.
    achromatic: Vec<f32>,
    red_green: Vec<f32>,
    /// For blue-yellow: two weighted Gaussians of sum 1; the weights add up to 1.
    blue_yellow: [(f32, Vec<f32>); 2],
    /// Gaussian and its derivatives for edges and points.
    smooth: Vec<f32>,
    edge: Vec<f32>,
    point: Vec<f32>,
    /// The largest colour distance that there is, to the power of [`COLOUR_EXPONENT`].
    largest: f32,
}

/// Compresses large colour distances (2020, section 4.1.3).
const COLOUR_EXPONENT: f32 = 0.7;

/// An image as an eye sees it at some exposure.
struct Seen {
    /// L*a*b* after the contrast filters, with a* and b* scaled by L*/100 (Hunt effect).
    colours: Vec<Vec3>,
    /// Strength of edges and of points in the unfiltered luminance.
    edges: Vec<f32>,
    points: Vec<f32>,
}

impl Filters {
    fn new(pixels_per_degree: f32) -> Self {
        assert!(
            pixels_per_degree > 0.0,
            "pixels_per_degree is {pixels_per_degree}; expected > 0"
        );
        // 2020, section 4.1.1, table 1: each filter is a sum of a·√(π/b)·exp(−π²r²/b), r in degrees.
        const ACHROMATIC: f32 = 0.0047;
        const RED_GREEN: f32 = 0.0053;
        const BLUE_YELLOW: [(f32, f32); 2] = [(34.1, 0.04), (13.5, 0.025)];
        let radius = (3.0 * (0.04_f32 / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
        let degrees = |i: i32| i as f32 / pixels_per_degree;
        let gauss = |b: f32| {
            (-radius..=radius)
                .map(|i| (-PI * PI * degrees(i).powi(2) / b).exp())
                .collect::<Vec<_>>()
        };
        // Weights that could not change an f32 sum are left out of the narrow ones.
        let narrow = |b: f32| {
            let mut kernel = gauss(b);
            kernel.retain(|&weight| weight > 1e-9);
            normalised(kernel)
        };
        // The sum of both is normalised as a whole, so each Gaussian's share is its two-dimensional sum.
        let shares =
            BLUE_YELLOW.map(|(a, b)| a * (PI / b).sqrt() * gauss(b).iter().sum::<f32>().powi(2));
        let total: f32 = shares.iter().sum();

        // 2020, section 4.2: a point or edge is seen at 0.082 degrees.
        let sigma = 0.5 * 0.082 * pixels_per_degree;
        let radius = (3.0 * sigma).ceil() as i32;
        let kernel = |weight: fn(f32) -> f32| -> Vec<f32> {
            let at = |i: i32| i as f32 / sigma;
            (-radius..=radius)
                .map(|i| weight(at(i)) * (-0.5 * at(i).powi(2)).exp())
                .collect()
        };
        Filters {
            achromatic: narrow(ACHROMATIC),
            red_green: narrow(RED_GREEN),
            blue_yellow: [0, 1].map(|i| (shares[i] / total, normalised(gauss(BLUE_YELLOW[i].1)))),
            smooth: normalised(kernel(|_| 1.0)),
            edge: normalised(kernel(|x| -x)),
            point: normalised(kernel(|x| x * x - 1.0)),
            largest: largest_distance().powf(COLOUR_EXPONENT),
        }
    }

    /// Rows beyond a band on either side that its filters reach.
    fn reach(&self) -> usize {
        self.blue_yellow[0].1.len().max(self.smooth.len()) / 2
    }

    /// Shows and filters `height` rows of an image from row `top` on.
    fn see(&self, image: &Image, top: usize, height: usize, shown: impl Fn(f32) -> f32) -> Seen {
        let (width, reach) = (image.width as usize, self.reach());
        let mut planes = [(); 3].map(|()| Vec::with_capacity(width * (height + 2 * reach)));
        for y in top..top + height + 2 * reach {
            // Beyond its edges an image goes on with its last rows.
            let y = y.saturating_sub(reach).min(image.height as usize - 1);
            for rgb in &image.pixels[y * width..(y + 1) * width] {
                let shown = rgb.to_array().map(&shown);
                let opponent = opponent_from_xyz(RGB_TO_XYZ * Vec3::from(shown));
                planes
                    .iter_mut()
                    .zip(opponent.to_array())
                    .for_each(|(plane, value)| plane.push(value));
            }
        }
        let [y, cx, cz] = planes;
        let filter = |plane: &[f32], across: &[f32], down: &[f32]| {
            columns(&rows(plane, width, across), width, reach, down)
        };
        let blur = |plane: &[f32], kernel: &[f32]| filter(plane, kernel, kernel);
        let [(share0, kernel0), (share1, kernel1)] = &self.blue_yellow;
        let (y_seen, cx_seen) = (blur(&y, &self.achromatic), blur(&cx, &self.red_green));
        let (cz_seen0, cz_seen1) = (blur(&cz, kernel0), blur(&cz, kernel1));
        let xyz_to_rgb = RGB_TO_XYZ.inverse();
        let colours = (0..width * height)
            .map(|i| {
                let opponent = Vec3::new(
                    y_seen[i],
                    cx_seen[i],
                    share0 * cz_seen0[i] + share1 * cz_seen1[i],
                );
                let rgb = (xyz_to_rgb * xyz_from_opponent(opponent)).clamp(Vec3::ZERO, Vec3::ONE);
                hunt(lab_from_xyz(RGB_TO_XYZ * rgb))
            })
            .collect();

        // Features are sought in luminance, 0 to 1.
        let luminance: Vec<f32> = y.iter().map(|y| (y + 16.0) / 116.0).collect();
        let smooth = rows(&luminance, width, &self.smooth);
        let length = |kernel: &[f32]| {
            let across = filter(&luminance, kernel, &self.smooth);
            let down = columns(&smooth, width, reach, kernel);
            across
                .iter()
                .zip(&down)
                .map(|(x, y)| (x * x + y * y).sqrt())
                .collect::<Vec<f32>>()
        };
        Seen {
            colours,
            edges: length(&self.edge),
            points: length(&self.point),
        }
    }
}

impl Filters {
    /// LDR-FLIP of pixel `i`, 0 to 1.
    fn difference(&self, a: &Seen, b: &Seen, i: usize) -> f32 {
        // 2020, section 4.1.3: distances up to 0.4 of the largest fill 0 to 0.95, the others the rest.
        const KNEE: f32 = 0.4;
        const KNEE_VALUE: f32 = 0.95;
        let distance = hyab(a.colours[i], b.colours[i]).powf(COLOUR_EXPONENT);
        let knee = KNEE * self.largest;
        let colour = if distance < knee {
            KNEE_VALUE * distance / knee
        } else {
            KNEE_VALUE + (1.0 - KNEE_VALUE) * (distance - knee) / (self.largest - knee)
        };
        // Section 4.2.2, and 4.3: features that differ amplify the colour difference.
        let edge = (a.edges[i] - b.edges[i]).abs();
        let point = (a.points[i] - b.points[i]).abs();
        let feature = (edge.max(point) * std::f32::consts::FRAC_1_SQRT_2).sqrt();
        colour.clamp(0.0, 1.0).powf((1.0 - feature).max(0.0))
    }
}

/// Scales the positive weights to a sum of 1, and the negative ones to −1.
fn normalised(kernel: Vec<f32>) -> Vec<f32> {
    let positive: f32 = kernel.iter().filter(|&&k| k > 0.0).sum();
    let negative: f32 = -kernel.iter().filter(|&&k| k < 0.0).sum::<f32>();
    kernel
        .into_iter()
        .map(|k| {
            if k > 0.0 {
                k / positive
            } else if k < 0.0 {
                k / negative
            } else {
                0.0
            }
        })
        .collect()
}

/// Filters each row with `kernel`, of odd length; beyond its ends a row goes on with its last values.
fn rows(plane: &[f32], width: usize, kernel: &[f32]) -> Vec<f32> {
    let reach = kernel.len() / 2;
    let mut out = vec![0.0; plane.len()];
    let mut padded = Vec::with_capacity(width + 2 * reach);
    for (out, row) in out.chunks_exact_mut(width).zip(plane.chunks_exact(width)) {
        padded.clear();
        padded.resize(reach, row[0]);
        padded.extend_from_slice(row);
        padded.resize(width + 2 * reach, row[width - 1]);
        for (shift, &weight) in kernel.iter().enumerate() {
            add(out, weight, &padded[shift..]);
        }
    }
    out
}

/// Filters each column with `kernel`, of odd length ≤ 2·`reach` + 1, leaving out `reach` rows at either end.
fn columns(plane: &[f32], width: usize, reach: usize, kernel: &[f32]) -> Vec<f32> {
    let first = reach - kernel.len() / 2;
    let mut out = vec![0.0; plane.len() - 2 * reach * width];
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        for (shift, &weight) in kernel.iter().enumerate() {
            add(out, weight, &plane[(y + first + shift) * width..]);
        }
    }
    out
}

/// out += weight · values, for as many as `out` has.
fn add(out: &mut [f32], weight: f32, values: &[f32]) {
    out.iter_mut()
        .zip(values)
        .for_each(|(out, value)| *out += weight * value);
}

/// White-relative XYZ → YCxCz, the linear opponent space in which the contrast filters work.
fn opponent_from_xyz(xyz: Vec3) -> Vec3 {
    Vec3::new(
        116.0 * xyz.y - 16.0,
        500.0 * (xyz.x - xyz.y),
        200.0 * (xyz.y - xyz.z),
    )
}

/// Inverse of [`opponent_from_xyz`].
fn xyz_from_opponent(opponent: Vec3) -> Vec3 {
    let y = (opponent.x + 16.0) / 116.0;
    Vec3::new(y + opponent.y / 500.0, y, y - opponent.z / 200.0)
}

/// White-relative XYZ → CIE L*a*b*.
fn lab_from_xyz(xyz: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let f = |t: f32| {
        if t > DELTA.powi(3) {
            t.cbrt()
        } else {
            t / (3.0 * DELTA * DELTA) + 4.0 / 29.0
        }
    };
    let (x, y, z) = (f(xyz.x), f(xyz.y), f(xyz.z));
    Vec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
}

/// Colours look the more colourful the brighter they are: a* and b* times L*/100.
fn hunt(lab: Vec3) -> Vec3 {
    let strength = 0.01 * lab.x;
    Vec3::new(lab.x, strength * lab.y, strength * lab.z)
}

/// Distance for large colour differences: city block in lightness, Euclidean in hue and chroma.
fn hyab(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

/// The largest [`hyab`] distance in sRGB, green against blue.
fn largest_distance() -> f32 {
    let seen = |rgb: Vec3| hunt(lab_from_xyz(RGB_TO_XYZ * rgb));
    hyab(seen(Vec3::Y), seen(Vec3::Z))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A 64 × 48 scene made of integers: a tiled floor in light that falls off, a lamp, a dark third.
    fn scene() -> Image {
        let pixel = |i: u32| {
            let (x, y) = (i % 64, i / 64);
            let tile = if (x / 6 + y / 6) % 2 == 0 { 1.0 } else { 0.25 };
            let light = if y >= 32 { 0.03 } else { 2.0 } / (1 + x) as f32;
            let lamp = if (20..24).contains(&x) && (5..8).contains(&y) {
                30.0
            } else {
                0.0
            };
            Vec3::new(1.0, 0.75, 0.5) * (tile * light) + Vec3::splat(lamp)
        };
        Image {
            width: 64,
            height: 48,
            pixels: (0..64 * 48).map(pixel).collect(),
        }
    }

    fn changed(image: &Image, change: impl Fn(usize, Vec3) -> Vec3) -> Image {
        let pixels = image
            .pixels
            .iter()
            .enumerate()
            .map(|(i, &rgb)| change(i, rgb))
            .collect();
        Image {
            pixels,
            ..image.clone()
        }
    }

    fn noisy(image: &Image) -> Image {
        changed(image, |i, rgb| {
            let noise =
                |salt: u32| ((i as u32 + salt).wrapping_mul(2_654_435_761) >> 24) as f32 / 128.0;
            rgb * Vec3::new(noise(1), noise(1001), noise(2001))
        })
    }

    fn mean(image: &Image, reference: &Image) -> f64 {
        let map = flip_map(image, reference, PIXELS_PER_DEGREE).expect("comparable");
        assert!(
            map.iter().all(|value| (0.0..=1.0).contains(value)),
            "values between 0 and 1"
        );
        map.iter().map(|&value| f64::from(value)).sum::<f64>() / map.len() as f64
    }

    #[test]
    fn means_agree_with_those_of_the_papers_own_program() {
        // Expected: flip-evaluator 1.7 (NVIDIA, PyPI) in HDR mode with its defaults, on these very images.
        let reference = scene();
        let swapped = changed(&reference, |_, rgb| Vec3::new(rgb.z, rgb.x, rgb.y));
        let shifted = changed(&reference, |i, _| {
            reference.pixels[i - usize::from(i % 64 > 0)]
        });
        let mut boxes = changed(&reference, |_, _| Vec3::ZERO);
        let black = boxes.clone();
        for i in 0..100 {
            boxes.pixels[64 * (10 + i / 10) + 5 + i % 10] = Vec3::Y;
        }
        let moved = changed(&black, |i, _| {
            Vec3::new(0.0, 0.0, boxes.pixels[i.saturating_sub(3)].y)
        });
        let pairs = [
            ("noisy", noisy(&reference), &reference, 0.224_120_8),
            (
                "darker",
                changed(&reference, |_, rgb| rgb * 0.75),
                &reference,
                0.287_235_9,
            ),
            ("other colours", swapped, &reference, 0.393_109_6),
            ("shifted by a pixel", shifted, &reference, 0.225_723_3),
            ("green box, blue box", moved, &boxes, 0.093_249_7),
        ];
        for (what, image, reference, expected) in pairs {
            let got = mean(&image, reference);
            assert!(
                (got - expected).abs() < 1e-5,
                "{what}: {got}, expected {expected}"
            );
        }
    }

    #[test]
    fn equal_images_differ_nowhere() {
        assert_eq!(mean(&scene(), &scene()), 0.0, "mean");
    }

    #[test]
    fn more_noise_is_seen_more() {
        let reference = scene();
        let noisy = noisy(&reference);
        let half = changed(&reference, |i, rgb| (rgb + noisy.pixels[i]) * 0.5);
        assert!(
            mean(&noisy, &reference) > 1.2 * mean(&half, &reference),
            "noise"
        );
    }

    #[test]
    fn brightness_of_the_whole_does_not_matter() {
        let reference = scene();
        let noisy = noisy(&reference);
        let expected = mean(&noisy, &reference);
        for scale in [1e-12_f32, 1e-3, 1e3, 1e12] {
            let scaled = |image: &Image| changed(image, |_, rgb| rgb * scale);
            let got = mean(&scaled(&noisy), &scaled(&reference));
            assert!(
                (got - expected).abs() < 1e-5,
                "{scale}: {got}, expected {expected}"
            );
        }
    }

    #[test]
    fn the_smallest_and_the_wildest_images_give_values_in_range() {
        let image = |width: u32, pixels: &[Vec3]| Image {
            width,
            height: pixels.len() as u32 / width,
            pixels: pixels.into(),
        };
        assert_eq!(
            mean(&image(1, &[Vec3::ONE]), &image(1, &[Vec3::ONE])),
            0.0,
            "one pixel"
        );
        let wild = [
            Vec3::MAX,
            Vec3::MIN,
            Vec3::ZERO,
            Vec3::splat(f32::MIN_POSITIVE),
        ];
        let calm = [Vec3::ONE; 4];
        for width in [1, 2, 4] {
            let (wild, calm) = (image(width, &wild), image(width, &calm));
            assert!(
                mean(&wild, &calm) > 0.0 && mean(&calm, &wild) > 0.0,
                "width {width}"
            );
        }
        let black = image(2, &[Vec3::ZERO; 4]);
        assert!(mean(&image(2, &calm), &black) > 0.5, "black reference");
        assert_eq!(mean(&black, &black), 0.0, "black on black");
    }

    #[test]
    fn filters_keep_a_flat_plane_flat_and_find_a_step() {
        let filters = Filters::new(PIXELS_PER_DEGREE);
        let reach = filters.reach();
        let flat = vec![3.0; 5 * (3 + 2 * reach)];
        let blurred = columns(
            &rows(&flat, 5, &filters.achromatic),
            5,
            reach,
            &filters.achromatic,
        );
        assert_eq!(blurred.len(), 15, "the band alone");
        assert!(
            blurred.iter().all(|value| (value - 3.0).abs() < 1e-5),
            "{blurred:?}"
        );
        let step: Vec<f32> = (0..31).map(|x| if x < 15 { 0.0 } else { 1.0 }).collect();
        let edges = rows(&step, 31, &filters.edge);
        let strongest = (0..31)
            .max_by(|&a, &b| edges[a].abs().total_cmp(&edges[b].abs()))
            .expect("some");
        assert!(
            (14..=15).contains(&strongest) && edges[0].abs() < 1e-6,
            "{edges:?}"
        );
    }
}
