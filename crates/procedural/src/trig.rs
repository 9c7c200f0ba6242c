//! Sine, cosine and arc cosine from IEEE additions, products and roots alone.
//!
//! The system's own differ in the last bit from platform to platform; these do not, so a
//! generated scene is the same file everywhere.

use glam::DVec2;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Unit vector at `angle` radians, counter-clockwise from +x: (cos, sin). |angle| up to ~1e6.
pub(crate) fn direction(angle: f64) -> DVec2 {
    let quarter_turns = (angle / FRAC_PI_2).round();
    let a = angle - quarter_turns * FRAC_PI_2;
    let a2 = a * a;
    // Taylor series on [-π/4, π/4]: nine terms leave less than 1e-16.
    let (mut sin, mut cos, mut term) = (0.0, 0.0, 1.0);
    for k in 0..9 {
        let k = f64::from(k);
        cos += term;
        sin += term * a / (2.0 * k + 1.0);
        term *= -a2 / ((2.0 * k + 1.0) * (2.0 * k + 2.0));
    }
    match quarter_turns.rem_euclid(4.0) as u8 {
        0 => DVec2::new(cos, sin),
        1 => DVec2::new(-sin, cos),
        2 => DVec2::new(-cos, -sin),
        _ => DVec2::new(sin, -cos),
    }
}

/// Angle in [0, π] whose cosine is `x`; `x` is clamped to [-1, 1].
pub(crate) fn acos(x: f64) -> f64 {
    let x = x.clamp(-1.0, 1.0);
    2.0 * arctan_ratio((1.0 - x).sqrt(), (1.0 + x).sqrt())
}

/// Angle in [0, π/2] of the point (`x`, `y`) with both coordinates ≥ 0 and not both zero.
fn arctan_ratio(y: f64, x: f64) -> f64 {
    if y > x {
        return FRAC_PI_2 - arctan_ratio(x, y);
    }
    // Two halvings bring the tangent under 0.2, where the series is short.
    let halve = |t: f64| t / (1.0 + (1.0 + t * t).sqrt());
    let t = halve(halve(y / x));
    let (mut sum, mut power) = (0.0, t);
    for k in 0..12 {
        sum += power / f64::from(2 * k + 1);
        power *= -t * t;
    }
    4.0 * sum
}

/// Degrees to radians.
pub(crate) fn degrees(angle: f64) -> f64 {
    angle * PI / 180.0
}

/// Unit vector after `k` of `n` equal turns.
pub(crate) fn turn(k: usize, n: usize) -> DVec2 {
    direction(k as f64 * 8.0 * FRAC_PI_4 / n as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_agree_with_the_system_to_a_few_ulps() {
        for k in -400..400 {
            let a = f64::from(k) * 0.037;
            let d = direction(a);
            assert!((d.x - a.cos()).abs() < 1e-14, "cos({a})");
            assert!((d.y - a.sin()).abs() < 1e-14, "sin({a})");
        }
    }

    #[test]
    fn acos_undoes_cos() {
        for k in 0..=180 {
            let a = degrees(f64::from(k));
            assert!((acos(direction(a).x) - a).abs() < 1e-7, "{k} degrees");
        }
    }
}
