//! What a method finds out about a tile in earlier samples, for later ones.

use crate::tile_points::BLOCKS;

/// What was found out about a tile's lights; empty at first, and the same whatever the passes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Learned {
    /// What weights are multiplied by, block of pixels by block of pixels and, in each, cluster by cluster.
    pub(crate) factors: Vec<f32>,
    /// What came of the lights that were drawn since, in the order of the factors; empty where nothing arrives.
    pub(crate) trials: Vec<Trials>,
    /// What a few rays found before there was any trial, cluster by cluster.
    pub(crate) probed: Probed,
}

/// What rays to lights of each cluster found.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Probed {
    /// Mean squares of what arrives over what is expected, in units of what is typical, cluster by cluster; each > 0.
    pub(crate) squares: Vec<f32>,
    /// The mean square over all; 0 where nothing arrives anywhere.
    pub(crate) typical: f64,
}

impl Learned {
    /// What probes alone say.
    pub(crate) fn of(probed: Probed) -> Self {
        let factors: Vec<f32> = probed.factors().collect();
        let trials = match probed.typical > 0.0 {
            true => vec![Trials::default(); BLOCKS * factors.len()],
            false => Vec::new(),
        };
        Self {
            factors: factors.repeat(BLOCKS),
            trials,
            probed,
        }
    }

    /// Most bytes that are kept of a tile with a cut of `clusters`.
    pub(crate) fn most_bytes(clusters: u32) -> u64 {
        let of_cluster = size_of::<f32>() + BLOCKS * (size_of::<f32>() + size_of::<Trials>());
        u64::from(clusters + MOST_BEYOND) * of_cluster as u64
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        (self.factors.capacity() + self.probed.squares.capacity()) * size_of::<f32>()
            + self.trials.capacity() * size_of::<Trials>()
    }
}

/// So many more clusters than were asked for may a cut have.
pub(crate) const MOST_BEYOND: u32 = 7;

/// What came of the lights that were drawn from one cluster.
///
/// In whole numbers, so that the sums do not depend on the order in which they are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Trials {
    /// How many were drawn.
    pub(crate) count: u32,
    /// Sum of the squares of what arrived over what was expected, in steps.
    pub(crate) squares: u32,
}

/// Where the outcome of a draw is noted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Place among the tile's [`Trials`].
    pub(crate) place: u32,
    /// What was expected to arrive: luminance of the radiance, ≥ 0.
    pub(crate) expected: f64,
}

impl Trial {
    /// The place of no trial.
    pub(crate) const NO_PLACE: u32 = u32::MAX;
    /// Of which nothing is noted.
    pub(crate) const NONE: Self = Self {
        place: Self::NO_PLACE,
        expected: 0.0,
    };
}

/// Steps of a square of 1.
const STEPS: f64 = 64.0;
/// No square counts for more.
const GREATEST: f64 = 4096.0;

impl Trials {
    /// Notes that one was drawn.
    pub(crate) fn begin(&mut self) {
        self.count = self.count.saturating_add(1);
    }

    /// Notes that one arrived; `square` is of [`Trials::square`].
    pub(crate) fn arrive(&mut self, square: u32) {
        self.squares = self.squares.saturating_add(square);
    }

    /// The square of `arrived` over `expected`, in steps; 0 where nothing was expected.
    pub(crate) fn square(arrived: f64, expected: f64) -> u32 {
        if expected <= 0.0 {
            return 0;
        }
        let ratio = arrived / expected;
        ((ratio * ratio).min(GREATEST) * STEPS).round() as u32
    }

    /// Sum of the squares.
    pub(crate) fn squares(self) -> f64 {
        f64::from(self.squares) / STEPS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_bounded_and_nothing_is_made_of_nothing() {
        assert_eq!(Trials::square(0.5, 0.25), 4 * 64);
        assert_eq!(
            [0.0, 1.0].map(|arrived| Trials::square(arrived, 0.0)),
            [0; 2]
        );
        let most = (GREATEST * STEPS) as u32;
        assert_eq!(Trials::square(f64::MAX, f64::MIN_POSITIVE), most);
        let mut full = Trials {
            count: u32::MAX,
            squares: u32::MAX - 1,
        };
        full.begin();
        full.arrive(most);
        assert_eq!((full.count, full.squares), (u32::MAX, u32::MAX));
    }
}
