//! Patches: pieces of surface, a few pixels wide, whose points share what lights are drawn by.
//!
//! What clusters weigh at a point and at its neighbour of the same pixel hardly differs, unless a light is as near as the
//! neighbour. Working it out once for all samples of a few pixels costs next to nothing, so that it can be finer, and all of a
//! pixel's samples lie along the same line of weights. Which points are of a patch depends on the camera alone, not on which
//! samples are taken together.

use light_tree::{Draws, Receiver, Region};

use crate::point::GatherPoint;
use crate::tile_points::{BLOCKS, Centre, TilePoints, between_milestones};

/// Radius of a patch over that of its block, which is what a block of pixels reaches across the surface.
const REACH: f32 = 0.5;
/// Lift over radius, and greatest tilt: curved surfaces have patches too.
const LIFT: f32 = 0.03;
const TILT: f32 = 0.1;
/// Tilt over the roughness of a glossy surface, at most: a lobe turns by twice the angle.
const TILT_OF_LOBE: f32 = 0.5;

/// The patches of a tile.
#[derive(Debug, Default)]
pub(super) struct Patches {
    /// Memory is kept from tile to tile: only the first `len` are this tile's.
    patches: Vec<Patch>,
    len: usize,
    /// The patch of each pixel's centre.
    of_pixel: Vec<Option<u16>>,
    /// Those of each block.
    of_block: [Vec<u16>; BLOCKS],
    /// Samples a pixel of the pass.
    samples: u32,
}

/// A piece of surface.
#[derive(Debug)]
pub(super) struct Patch {
    /// The point in its midst, which stands for the others.
    pub(super) receiver: Receiver,
    /// How many pixels have their centres on it, at least 1.
    pixels: u32,
    /// Whether what lights are drawn by has been worked out.
    pub(super) is_ready: bool,
    /// What lights are drawn by.
    pub(super) draws: Draws,
}

impl Patches {
    /// Puts the centres of each block's pixels together.
    pub(super) fn find(&mut self, tile: &TilePoints<'_>) {
        self.len = 0;
        self.samples = tile.samples;
        self.of_pixel.clear();
        self.of_block.iter_mut().for_each(Vec::clear);
        for centre in tile.centres {
            let patch = centre.as_ref().map(|centre| {
                let known = self.of_block(&centre.point);
                let patch = known.unwrap_or_else(|| self.add(centre));
                self.patches[usize::from(patch)].pixels += 1;
                patch
            });
            self.of_pixel.push(patch);
        }
    }

    fn add(&mut self, centre: &Centre) -> u16 {
        let x = &centre.point;
        let radius = REACH * centre.reach;
        let roughness = match x.brdf.is_glossy() {
            true => x.brdf.alpha,
            false => 1.0,
        };
        let receiver = x.receiver.with_region(Region {
            radius,
            lift: LIFT * radius,
            tilt: TILT.min(TILT_OF_LOBE * roughness),
        });
        if self.len == self.patches.len() {
            self.patches.push(Patch {
                receiver,
                pixels: 0,
                is_ready: false,
                draws: Draws::default(),
            });
        }
        // A tile has no more patches than pixels.
        let number = self.len as u16;
        let patch = &mut self.patches[self.len];
        (patch.receiver, patch.pixels, patch.is_ready) = (receiver, 0, false);
        self.of_block[x.block as usize].push(number);
        self.len += 1;
        number
    }

    /// The first patch of the point's block that has it.
    fn of_block(&self, x: &GatherPoint) -> Option<u16> {
        let mut patches = self.of_block[x.block as usize].iter().copied();
        patches.find(|&patch| self.has(patch, x))
    }

    fn has(&self, patch: u16, x: &GatherPoint) -> bool {
        let patch = &self.patches[usize::from(patch)];
        patch.receiver.stands_for(&x.receiver)
    }

    /// The patch of a point that is seen, if it is on one: that of its pixel's centre before others.
    pub(super) fn of(&mut self, x: &GatherPoint) -> Option<&mut Patch> {
        let pixel = x.slot / self.samples.max(1);
        let centre = self.of_pixel.get(pixel as usize).copied().flatten();
        let patch = centre
            .filter(|&patch| self.has(patch, x))
            .or_else(|| self.of_block(x))?;
        self.patches.get_mut(usize::from(patch))
    }
}

impl Patch {
    /// How many points of it are lit between two milestones, about, when one of them is of this sample of its pixel.
    pub(super) fn points(&self, sample: u32) -> u32 {
        self.pixels * between_milestones(sample)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};
    use sampling::{Purpose, Rng};

    use super::*;
    use crate::method::conformance::{gather_points, room};
    use crate::tile_points::block;

    /// The patch of each pixel of a tile of 8 × 8, which sees `x` moved and turned as `at` says.
    fn patches(x: &GatherPoint, at: impl Fn(u32, u32) -> Option<(Vec3, Quat)>) -> Vec<Option<u16>> {
        let pixels = (0..64).map(|i| (i % 8, i / 8));
        let centres: Vec<_> = pixels
            .map(|(column, row)| {
                let (by, turn) = at(column, row)?;
                let point = GatherPoint {
                    block: block(column, row),
                    ..x.moved(by).turned(turn)
                };
                Some(Centre {
                    point,
                    reach: 0.06,
                    is_pilot: false,
                })
            })
            .collect();
        let stream = |slot, _, purpose| Rng::new(3, u64::from(slot), 0, purpose);
        let mut patches = Patches::default();
        patches.find(&TilePoints {
            points: &[],
            width: 8,
            samples: 4,
            is_milestone: true,
            centres: &centres,
            probe_stream: &stream(0, 0, Purpose::Probe),
            stream: &stream,
        });
        let slots = centres.iter().enumerate();
        for (i, centre) in slots.filter_map(|(i, c)| Some((i, c.as_ref()?))) {
            // The last sample of the pixel, where its centre is.
            let slot = i as u32 * 4 + 3;
            let seen = GatherPoint {
                slot,
                ..centre.point
            };
            assert!(patches.of(&seen).is_some(), "pixel {i}");
            let elsewhere = seen.moved(Vec3::ONE);
            assert!(
                patches.of(&elsewhere).is_none(),
                "pixel {i} sees another place"
            );
        }
        let counted: u32 = patches.patches[..patches.len]
            .iter()
            .map(|p| p.pixels)
            .sum();
        assert_eq!(counted as usize, centres.iter().flatten().count());
        patches.of_pixel
    }

    fn count(patches: &[Option<u16>]) -> usize {
        let mut all: Vec<_> = patches.iter().flatten().collect();
        all.sort_unstable();
        all.dedup();
        all.len()
    }

    #[test]
    fn what_blocks_see_of_a_plane_is_a_patch_each_and_edges_part_them() {
        let x = gather_points(&room(false))[0];
        let (t, b) = x.ns.any_orthonormal_pair();
        let plane = |column: u32, row: u32| 0.005 * (column as f32 * t + row as f32 * b);
        let still = Quat::IDENTITY;
        let flat = patches(&x, |column, row| Some((plane(column, row), still)));
        assert_eq!(count(&flat), 4, "one a block");
        for (i, patch) in flat.iter().enumerate() {
            let first = block(i as u32 % 8, i as u32 / 8);
            assert_eq!(
                *patch,
                flat[match first {
                    0 => 0,
                    1 => 4,
                    4 => 32,
                    _ => 36,
                }],
                "pixel {i}"
            );
        }
        let step = patches(&x, |column, row| {
            let up = if row % 4 < 2 { 0.0 } else { 0.002 };
            Some((plane(column, row) + up * x.ns, still))
        });
        assert_eq!(count(&step), 8, "a step in each");
        let ridge = patches(&x, |column, row| {
            let angle = if column % 4 < 2 { 0.0 } else { 0.2 };
            let turn = Quat::from_axis_angle(t, angle);
            let along = column as f32 * t + row as f32 * (turn * b);
            Some((0.005 * along, turn))
        });
        assert_eq!(count(&ridge), 8, "a ridge in each");
        let curved = patches(&x, |column, row| {
            let turn = Quat::from_axis_angle(t, 0.01 * column as f32);
            Some((plane(column, row), turn))
        });
        assert_eq!(count(&curved), 4, "hardly curved");
        let half = patches(&x, |column, row| {
            (row < 4).then(|| (plane(column, row), still))
        });
        assert_eq!((count(&half), half[40]), (2, None), "the sky has none");
    }

    #[test]
    fn a_lobe_turns_out_of_a_patch_sooner() {
        let of = |glossy| {
            let x = gather_points(&room(glossy))[0];
            assert_eq!(x.brdf.is_glossy(), glossy);
            let (t, b) = x.ns.any_orthonormal_pair();
            let x = GatherPoint {
                brdf: scene::Brdf {
                    alpha: 0.05,
                    ..x.brdf
                },
                ..x
            };
            count(&patches(&x, |column, row| {
                let turn = Quat::from_axis_angle(t, 0.02 * (column % 4) as f32);
                Some((0.005 * (column as f32 * t + row as f32 * b), turn))
            }))
        };
        assert_eq!(of(false), 4);
        assert!(of(true) > 4);
    }
}
