//! What a render counts, and where its time goes.

use std::time::Duration;

/// Where time goes while rendering.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Shadow rays. Measured in full where they are traced together, at one point in 61 where one by one.
    Trace,
    /// Choosing the clusters. This and the next two are measured at one point in 61; what is done once for a tile, in full.
    Cut,
    /// Choosing a light in each cluster.
    Select,
    /// Evaluating the chosen lights, visibility apart.
    Evaluate,
    /// Eye paths. Measured in full.
    Eye,
}

/// Number of [`Phase`]s.
pub(crate) const PHASES: usize = 5;

/// Sums over a render; whole numbers, so that the order of adding up does not matter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Rays from the camera.
    pub camera_rays: u64,
    /// Rays of eye paths behind the first hit.
    pub bounce_rays: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
    /// Lights evaluated.
    pub light_samples: u64,
    /// Light samples that ended in a branch that cannot light the point.
    pub dead_samples: u64,
    /// Gather points.
    pub shading_points: u64,
    /// Samples refused because a number in them was not finite.
    pub nonfinite: u64,
    pub(crate) nanoseconds: [u64; PHASES],
}

/// Thread time by phase, seconds summed over threads.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Seconds {
    /// Eye paths.
    pub eye: f64,
    /// Choosing clusters.
    pub cut: f64,
    /// Choosing lights in clusters.
    pub select: f64,
    /// Evaluating lights.
    pub evaluate: f64,
    /// Tracing shadow rays.
    pub shadow: f64,
}

impl Counters {
    /// Adds the time spent on a phase.
    pub(crate) fn time(&mut self, phase: Phase, spent: Duration) {
        self.nanoseconds[phase as usize] += spent.as_nanos() as u64;
    }

    /// Adds another part's sums.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.camera_rays += other.camera_rays;
        self.bounce_rays += other.bounce_rays;
        self.shadow_rays += other.shadow_rays;
        self.light_samples += other.light_samples;
        self.dead_samples += other.dead_samples;
        self.shading_points += other.shading_points;
        self.nonfinite += other.nonfinite;
        for (sum, n) in self.nanoseconds.iter_mut().zip(other.nanoseconds) {
            *sum += n;
        }
    }

    /// Thread time by phase; estimates, see [`Phase`].
    pub fn seconds(&self) -> Seconds {
        let of = |phase: Phase| self.nanoseconds[phase as usize] as f64 * 1e-9;
        Seconds {
            eye: of(Phase::Eye),
            cut: of(Phase::Cut),
            select: of(Phase::Select),
            evaluate: of(Phase::Evaluate),
            shadow: of(Phase::Trace),
        }
    }
}
