//! Flat panels with openings: ear clipping after joining every hole to the outline.

use crate::materials::Material;
use crate::mesh::Mesh;
use glam::DVec2;

/// A wall panel in the plane z = 0 of its frame.
///
/// `outline` and `holes` are simple polygons of either turning; holes lie strictly inside and
/// apart from each other.
pub(crate) fn panel(material: Material, outline: &[DVec2], holes: &[Vec<DVec2>]) -> Mesh {
    let mut mesh = Mesh::default();
    for t in triangulate(outline, holes) {
        mesh.triangle(material, t.map(|p| p.extend(0.0)));
    }
    mesh
}

fn area(points: &[DVec2]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points
        .iter()
        .zip(next)
        .map(|(a, b)| a.perp_dot(*b))
        .sum::<f64>()
        / 2.0
}

fn turned(points: &[DVec2], positive: bool) -> Vec<DVec2> {
    let mut points = points.to_vec();
    if (area(&points) > 0.0) != positive {
        points.reverse();
    }
    points
}

fn triangulate(outline: &[DVec2], holes: &[Vec<DVec2>]) -> Vec<[DVec2; 3]> {
    let mut ring = turned(outline, true);
    let mut holes: Vec<Vec<DVec2>> = holes.iter().map(|h| turned(h, false)).collect();
    // Rightmost first, so that a hole never hides behind one not joined yet.
    let reach = |h: &[DVec2]| h.iter().map(|p| p.x).fold(f64::MIN, f64::max);
    holes.sort_by(|a, b| reach(b).total_cmp(&reach(a)));
    for hole in &holes {
        join(&mut ring, hole);
    }
    clip(ring)
}

/// Splices `hole` into `ring` through the shortest pair of points that see each other, starting
/// from the hole's rightmost point.
fn join(ring: &mut Vec<DVec2>, hole: &[DVec2]) {
    let start = (0..hole.len())
        .max_by(|&a, &b| hole[a].x.total_cmp(&hole[b].x))
        .unwrap_or(0);
    let from = hole[start];
    let mut order: Vec<usize> = (0..ring.len()).collect();
    order.sort_by(|&a, &b| {
        let d = |k: usize| ring[k].distance_squared(from);
        d(a).total_cmp(&d(b))
    });
    let sees = |k: &usize| {
        let to = ring[*k];
        let previous = ring[(*k + ring.len() - 1) % ring.len()];
        let next = ring[(*k + 1) % ring.len()];
        let inside = if (to - previous).perp_dot(next - to) >= 0.0 {
            (to - previous).perp_dot(from - previous) > 0.0 && (next - to).perp_dot(from - to) > 0.0
        } else {
            (to - previous).perp_dot(from - previous) > 0.0 || (next - to).perp_dot(from - to) > 0.0
        };
        to.x >= from.x && inside && !blocked(ring, from, to) && !blocked(hole, from, to)
    };
    let at = order
        .iter()
        .copied()
        .find(sees)
        .expect("a hole's rightmost point sees the ring");
    let around = hole[start..].iter().chain(&hole[..=start]).copied();
    let patch: Vec<DVec2> = around.chain([ring[at]]).collect();
    ring.splice(at + 1..at + 1, patch);
}

/// Whether an edge of `ring` touches the segment between `a` and `b` other than at its ends.
fn blocked(ring: &[DVec2], a: DVec2, b: DVec2) -> bool {
    let next = ring.iter().cycle().skip(1);
    ring.iter().zip(next).any(|(&p, &q)| {
        if [p, q]
            .iter()
            .any(|e| e.distance_squared(a) < 1e-18 || e.distance_squared(b) < 1e-18)
        {
            // An edge at one of the ends blocks only where it runs along the segment.
            let far = |e: DVec2| e.distance_squared(a) > 1e-18 && e.distance_squared(b) > 1e-18;
            return [p, q].iter().any(|&e| {
                let along = (e - a).dot(b - a) / (b - a).length_squared();
                far(e) && (b - a).perp_dot(e - a).abs() < 1e-9 && (0.0..1.0).contains(&along)
            });
        }
        let (pa, pb) = ((q - p).perp_dot(a - p), (q - p).perp_dot(b - p));
        let (ap, aq) = ((b - a).perp_dot(p - a), (b - a).perp_dot(q - a));
        pa * pb <= 0.0 && ap * aq <= 0.0
    })
}

/// Ear clipping of a weakly simple counter-clockwise ring.
fn clip(mut ring: Vec<DVec2>) -> Vec<[DVec2; 3]> {
    let mut triangles = Vec::with_capacity(ring.len());
    let mut at = 0;
    let mut misses = 0;
    // Loosened once nothing qualifies any more: collinear leftovers carry no area.
    let mut strict = true;
    while ring.len() >= 3 {
        let n = ring.len();
        let [a, b, c] = [ring[(at + n - 1) % n], ring[at % n], ring[(at + 1) % n]];
        let size = (b - a).perp_dot(c - b);
        let lengths = (b - a).length() * (c - b).length();
        let sharp = strict && size < 0.05 * lengths && misses < n;
        let ear = size > 1e-10 && !sharp && ring.iter().all(|&p| !covers([a, b, c], p));
        if ear || (!strict && size.abs() <= 1e-10) {
            if ear {
                triangles.push([a, b, c]);
            }
            ring.remove(at % n);
            misses = 0;
            strict = true;
            // Skip a point, so that fans do not all start at one corner.
            at = (at + 1) % ring.len();
        } else {
            misses += 1;
            at = (at + 1) % n;
            if misses > 2 * n {
                if !strict {
                    break;
                }
                strict = false;
                misses = 0;
            }
        }
    }
    triangles
}

/// Whether `p` lies in the triangle or on its border, its corners excepted.
fn covers([a, b, c]: [DVec2; 3], p: DVec2) -> bool {
    if [a, b, c].iter().any(|q| q.distance_squared(p) < 1e-18) {
        return false;
    }
    let eps = -1e-12;
    (b - a).perp_dot(p - a) >= eps
        && (c - b).perp_dot(p - b) >= eps
        && (a - c).perp_dot(p - c) >= eps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arch::Arch;

    #[test]
    fn a_panel_with_openings_covers_exactly_what_is_left() {
        let square = |x: f64, y: f64, r: f64| {
            [(-r, -r), (r, -r), (r, r), (-r, r)]
                .map(|(a, b)| DVec2::new(x + a, y + b))
                .to_vec()
        };
        let shift = |p: &DVec2, x: f64| *p + DVec2::new(x, 0.3);
        let mut holes = vec![square(0.0, -3.0, 0.5)];
        for k in 0..5 {
            let opening = Arch::pointed(0.3, 0.5).opening(6, 1.0);
            holes.push(
                opening
                    .iter()
                    .map(|p| shift(p, f64::from(k) * 0.8 - 1.6))
                    .collect(),
            );
        }
        let outline = square(0.0, 0.0, 4.0);
        let want = area(&outline) - holes.iter().map(|h| area(h).abs()).sum::<f64>();
        let got: f64 = triangulate(&outline, &holes).iter().map(|t| area(t)).sum();
        assert!((want - got).abs() < 1e-9, "want {want}, got {got}");
    }
}
