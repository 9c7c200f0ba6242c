//! The measurements everything else hangs on, in metres.
//!
//! x runs from the west front (−) to the apse (+), y up, z across. The crossing is a square of
//! side 2 × [`HALF`] about ([`CROSSING`], 0); four nave bays lie west of it, one choir bay and the
//! apse east of it, a shallow transept on either side.

use crate::arch::Arch;
use crate::sweep::xy;
use glam::DVec2;

/// Half the clear width of nave, choir and crossing.
pub(super) const HALF: f64 = 3.75;
/// Thickness of the arcade walls and of the crossing arches.
pub(super) const WALL: f64 = 0.9;
/// Clear width of an aisle and depth of a transept.
pub(super) const AISLE: f64 = 3.75;
/// Inner face of the outer walls.
pub(super) const OUTER: f64 = HALF + WALL + AISLE;
/// Length of a nave bay.
pub(super) const BAY: f64 = 5.0;
/// Bays of the nave.
pub(super) const BAYS: usize = 4;
/// Middle of the crossing.
pub(super) const CROSSING: f64 = WALL / 2.0 + HALF;
/// East end of the nave: the west face of the crossing arch.
pub(super) const NAVE_EAST: f64 = -WALL / 2.0;
/// Inner face of the west front.
pub(super) const WEST: f64 = NAVE_EAST - BAYS as f64 * BAY;
/// West and east end of the choir bay.
pub(super) const CHOIR_WEST: f64 = CROSSING + HALF + WALL;
/// East end of the choir bay.
pub(super) const CHOIR_EAST: f64 = CHOIR_WEST + 4.2;
/// Middle of the apse.
pub(super) const APSE: f64 = CHOIR_EAST + WALL;

/// Springing of arcades and aisle vaults.
pub(super) const LOW_SPRING: f64 = 3.6;
/// Rise of the aisle vaults.
pub(super) const LOW_RISE: f64 = 3.1;
/// Springing of the high vaults and the crossing arches.
pub(super) const HIGH_SPRING: f64 = 9.0;
/// Rise of the high vaults.
pub(super) const HIGH_RISE: f64 = 4.2;
/// Top of the high walls, above every vault.
pub(super) const WALL_TOP: f64 = 13.9;
/// String course above the arcade.
pub(super) const STRING: f64 = 7.05;
/// Floor of choir and apse.
pub(super) const CHOIR_FLOOR: f64 = 0.9;

/// Where the pendentives meet the drum.
pub(super) const RING: f64 = HIGH_SPRING + HALF;
/// Springing of the dome.
pub(super) const DOME_SPRING: f64 = 14.8;
/// Radius of the oculus under the lantern.
pub(super) const OCULUS: f64 = 0.8;

/// Steps of each half arch; panels and mouldings that meet use the same.
pub(super) const ARCH_STEPS: usize = 11;

/// Intrados of the arcade in a bay of `length`.
pub(super) fn arcade(length: f64) -> Arch {
    let half_span = length / 2.0 - 0.45;
    Arch::pointed(half_span, 1.24 * half_span)
}

/// Intrados of the four crossing arches and the apse arch.
pub(super) fn crossing_arch() -> Arch {
    Arch::round(HALF - CROSSING_ORDERS)
}

/// Radial depth of the crossing arches' orders.
pub(super) const CROSSING_ORDERS: f64 = 0.45;
/// Radial depth of the arcades' orders.
pub(super) const ARCADE_ORDERS: f64 = 0.33;

/// Corners of the axis-aligned rectangle between two points.
pub(super) fn rectangle(min: DVec2, max: DVec2) -> Vec<DVec2> {
    vec![min, xy(max.x, min.y), max, xy(min.x, max.y)]
}
