//! How the error of an animation changes from frame to frame.

use glam::DVec3;

use crate::{FilmError, Image, metrics::check, metrics::ratio_or_zero, metrics::relative_scales};

/// Edge, in pixels, of the blocks over which [`Flicker::block`] averages before it looks.
pub const FLICKER_BLOCK: usize = 8;

/// Temporal error: how much of the change from one frame to the next is not in the reference.
///
/// With x and r a frame and its reference, e = x − r, the temporal error of frame t is e(t) − e(t−1). A
/// constant error, such as a picture that is too dark alike in every frame, gives 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flicker {
    /// Mean over frames, pixels and channels of the squared temporal error over r² + 0.01·m². Noise that is
    /// new in each frame counts here as much as anything else.
    pub pixel: f64,
    /// The same after both are averaged over blocks of 8 × 8 pixels: what stays is error that neighbours
    /// share and that jumps, which an eye follows. Noise that is independent from pixel to pixel falls by 64.
    pub block: f64,
}

impl Flicker {
    /// The flicker of `frames` against `references`, in order; `None` for fewer than two frames.
    ///
    /// # Errors
    ///
    /// The sizes of a frame and its reference, or of two frames, differ, there is no pixel, or a pixel is not
    /// finite.
    ///
    /// # Panics
    ///
    /// When there are not as many references as frames.
    pub fn of(frames: &[Image], references: &[Image]) -> Result<Option<Self>, FilmError> {
        assert_eq!(frames.len(), references.len(), "frames and references");
        let (mut pixel, mut block, mut steps) = (0.0, 0.0, 0.0);
        let mut before: Option<Vec<DVec3>> = None;
        for (frame, reference) in frames.iter().zip(references) {
            check(frame, reference)?;
            check(reference, &references[0])?;
            let errors = frame.pixels.iter().zip(&reference.pixels);
            let now: Vec<DVec3> = errors.map(|(x, r)| x.as_dvec3() - r.as_dvec3()).collect();
            if let Some(before) = &before {
                let change: Vec<DVec3> = now.iter().zip(before).map(|(a, b)| a - b).collect();
                pixel += relative_square(&change, &reference.pixels_f64());
                let blocks = |values: &[DVec3]| block_means(values, reference.width as usize);
                block += relative_square(&blocks(&change), &blocks(&reference.pixels_f64()));
                steps += 1.0;
            }
            before = Some(now);
        }
        Ok((steps > 0.0).then(|| Self {
            pixel: pixel / steps,
            block: block / steps,
        }))
    }
}

/// Mean of the squared `change` over r² + 0.01·m², r being `reference`.
fn relative_square(change: &[DVec3], reference: &[DVec3]) -> f64 {
    let terms = change.iter().zip(relative_scales(reference));
    let sum: f64 = terms
        .flat_map(|(d, scale)| (0..3).map(move |c| ratio_or_zero(d[c] * d[c], scale[c])))
        .sum();
    sum / (3.0 * change.len() as f64)
}

/// Means over blocks of [`FLICKER_BLOCK`]² pixels, those at the right and lower edge perhaps smaller.
fn block_means(values: &[DVec3], width: usize) -> Vec<DVec3> {
    let columns = width.div_ceil(FLICKER_BLOCK);
    let rows = (values.len() / width).div_ceil(FLICKER_BLOCK);
    let mut sums = vec![(DVec3::ZERO, 0.0); columns * rows];
    for (i, value) in values.iter().enumerate() {
        let at = i / width / FLICKER_BLOCK * columns + i % width / FLICKER_BLOCK;
        sums[at].0 += value;
        sums[at].1 += 1.0;
    }
    sums.into_iter().map(|(sum, count)| sum / count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    const SIZE: usize = 64;

    fn frame(value: impl Fn(usize, usize) -> f32) -> Image {
        let pixels = (0..SIZE * SIZE).map(|i| Vec3::splat(value(i % SIZE, i / SIZE)));
        Image {
            width: SIZE as u32,
            height: SIZE as u32,
            pixels: pixels.collect(),
        }
    }

    fn flicker(frames: &[Image]) -> Flicker {
        let references = vec![frame(|_, _| 1.0); frames.len()];
        let found = Flicker::of(frames, &references).expect("comparable");
        found.expect("frames enough")
    }

    #[test]
    fn an_error_that_stays_is_no_flicker() {
        let still = frame(|x, _| 1.0 + 0.3 * (x % 5) as f32);
        let found = flicker(&[still.clone(), still.clone(), still]);
        assert_eq!((found.pixel, found.block), (0.0, 0.0), "still");
    }

    #[test]
    fn a_jump_of_the_whole_picture_counts_alike_at_both_scales() {
        let found = flicker(&[frame(|_, _| 1.0), frame(|_, _| 1.5)]);
        let expected = 0.25 / 1.01;
        assert!((found.pixel - expected).abs() < 1e-9, "{found:?}");
        assert!((found.block - expected).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn blocks_do_not_see_what_cancels_among_neighbours() {
        let checks = |sign: f32| frame(move |x, y| 1.0 + sign * [0.5, -0.5][(x + y) % 2]);
        let found = flicker(&[checks(1.0), checks(-1.0)]);
        assert!((found.pixel - 1.0 / 1.01).abs() < 1e-6, "{found:?}");
        assert!(found.block < 1e-12, "{found:?}");
    }

    #[test]
    fn the_reference_may_move() {
        let frames = [frame(|_, _| 1.0), frame(|_, _| 3.0)];
        let found = Flicker::of(&frames, &frames).expect("comparable");
        let found = found.expect("two frames");
        assert_eq!((found.pixel, found.block), (0.0, 0.0), "exact");
    }

    #[test]
    fn one_frame_has_no_flicker_and_sizes_must_agree() {
        let one = [frame(|_, _| 1.0)];
        assert_eq!(Flicker::of(&one, &one).expect("comparable"), None, "one");
        let small = Image {
            width: 1,
            height: 1,
            pixels: vec![Vec3::ONE],
        };
        let mixed = [one[0].clone(), small];
        assert!(Flicker::of(&mixed, &mixed).is_err(), "sizes");
    }
}
