//! Light from beyond the scene, as a picture of all directions.
//!
//! Rows are lines of equal height above the horizon, the zenith (+y) first; columns go around it. The radiance of a
//! texel is constant, so that drawing directions in proportion to it leaves nothing but cosines and visibility to chance.

use std::f32::consts::{PI, TAU};

use glam::{DVec3, Vec3};

/// Cells that an environment is divided into at most: as fine as a cosine at the receiver needs them, about 13° across
/// where the light comes from everywhere.
const CELLS: usize = 256;

/// Radiance by direction.
///
/// Direction (x, y, z) is found in column (atan2(x, −z) / 2π mod 1) · width and row acos(y) / π · height: the picture's
/// left edge is −z, its middle +z.
#[derive(Debug, Clone)]
pub struct Environment {
    width: usize,
    height: usize,
    /// W/sr/m², row by row.
    texels: Vec<Vec3>,
    /// Entry (x, y) of width + 1 columns: luminance × solid angle of all texels left of x and above y.
    sums: Vec<f64>,
    cells: Vec<Cell>,
}

/// A rectangle of texels: columns from `x[0]` to before `x[1]`, rows alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Rect {
    x: [usize; 2],
    y: [usize; 2],
}

/// A part of the environment that is one light.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    rect: Rect,
    /// Unit direction to its middle.
    pub middle: Vec3,
    /// Cosine of an angle within which all of its directions lie about the middle; −1 for every direction.
    pub cos: f32,
    /// Radiance × solid angle, summed: what a surface receives that faces all of it, W/m².
    pub irradiance: Vec3,
    /// Greatest that a sample's [`power`](EnvironmentSample::power) can be over `irradiance`, by channel.
    pub peak: f32,
}

/// A direction drawn from the environment.
#[derive(Debug, Clone, Copy)]
pub struct EnvironmentSample {
    /// Unit direction that light comes from.
    pub direction: Vec3,
    /// Radiance over the probability density of the direction within its cell, or within everything, W/m².
    pub power: Vec3,
}

impl Environment {
    /// The environment of `texels`, `width` a row and `height` rows, finite and not negative; `None` when it is black.
    ///
    /// # Panics
    /// When the texels are not as many as they should be, or there is none.
    pub fn new(width: usize, height: usize, texels: Vec<Vec3>) -> Option<Self> {
        assert!(
            width > 0 && height > 0 && texels.len() == width * height,
            "{} texels of {width} × {height}",
            texels.len()
        );
        let mut sums = vec![0.0; (width + 1) * (height + 1)];
        for y in 0..height {
            let solid_angle = solid_angle(width, height, y);
            let mut row = 0.0;
            for x in 0..width {
                row += luminance(texels[y * width + x]) * solid_angle;
                let above = sums[y * (width + 1) + x + 1];
                sums[(y + 1) * (width + 1) + x + 1] = above + row;
            }
        }
        let mut environment = Self {
            width,
            height,
            texels,
            sums,
            cells: Vec::new(),
        };
        let all = environment.all();
        if environment.sum(&all) <= 0.0 {
            return None;
        }
        environment.cells = environment.divide();
        Some(environment)
    }

    /// The same `radiance` from every direction; `None` when it is black.
    pub fn constant(radiance: Vec3) -> Option<Self> {
        // Enough texels to be divided into cells.
        let (width, height) = (32, 16);
        Self::new(width, height, vec![radiance; width * height])
    }

    /// Texels a row and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Row by row, W/sr/m².
    pub fn texels(&self) -> &[Vec3] {
        &self.texels
    }

    /// The lights that it is divided into, of about the same power where the texels allow it. None is black; what is in
    /// none of them is.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Radiance from unit `direction`.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.texels[self.texel(direction)]
    }

    /// Density in sr⁻¹ of drawing unit `direction` in proportion to luminance among all directions.
    pub fn pdf_solid_angle(&self, direction: Vec3) -> f32 {
        let luminance = luminance(self.radiance(direction));
        (luminance / self.sum(&self.all())) as f32
    }

    /// A direction of cell number `cell`, in proportion to luminance: by `u` in [0, 1) the texel, by `within` the place
    /// on it.
    pub fn sample_cell(&self, cell: usize, u: f64, within: [f32; 2]) -> EnvironmentSample {
        self.sample_rect(self.cells[cell].rect, u, within)
    }

    /// A direction, likewise, of all the environment.
    pub fn sample(&self, u: f64, within: [f32; 2]) -> EnvironmentSample {
        self.sample_rect(self.all(), u, within)
    }

    /// What a surface receives that faces all of it, by the mean of the channels, W/m².
    pub fn total(&self) -> f64 {
        self.sum(&self.all())
    }

    fn all(&self) -> Rect {
        Rect {
            x: [0, self.width],
            y: [0, self.height],
        }
    }

    /// Luminance × solid angle of a rectangle, not negative.
    fn sum(&self, rect: &Rect) -> f64 {
        let at = |x: usize, y: usize| self.sums[y * (self.width + 1) + x];
        let ([x0, x1], [y0, y1]) = (rect.x, rect.y);
        (at(x1, y1) - at(x0, y1) - (at(x1, y0) - at(x0, y0))).max(0.0)
    }

    fn sample_rect(&self, mut rect: Rect, mut u: f64, within: [f32; 2]) -> EnvironmentSample {
        // Halved down to a texel, always by what the halves hold.
        let mut pmf = 1.0;
        while let Some([a, b]) = rect.halves() {
            let (one, two) = (self.sum(&a), self.sum(&b));
            let share = one / (one + two);
            // Never into a black half. Where both are lost in rounding the share is no number, and the second is taken.
            let first = u < share || two <= 0.0 && one > 0.0;
            let (part, passed, half) = if first {
                (share, 0.0, a)
            } else {
                (1.0 - share, share, b)
            };
            rect = half;
            pmf *= part;
            u = ((u - passed) / part).clamp(0.0, 1.0 - f64::EPSILON);
        }
        let (x, y) = (rect.x[0], rect.y[0]);
        // Uniform by solid angle: in the azimuth, and in the cosine to the zenith.
        let [top, bottom] = row_cosines(self.height, y);
        let height = top + f64::from(within[1]) * (bottom - top);
        let azimuth = (x as f64 + f64::from(within[0])) / self.width as f64;
        let radiance = self.texels[y * self.width + x].as_dvec3();
        let power = radiance * (solid_angle(self.width, self.height, y) / pmf);
        EnvironmentSample {
            direction: direction(azimuth, height),
            // Not a number only where sums of doubles cannot tell the texel from black.
            power: if pmf > 0.0 {
                power.as_vec3()
            } else {
                Vec3::ZERO
            },
        }
    }

    fn texel(&self, direction: Vec3) -> usize {
        let azimuth = direction.x.atan2(-direction.z) / TAU;
        let azimuth = azimuth - azimuth.floor();
        let down = direction.y.clamp(-1.0, 1.0).acos() / PI;
        // The casts saturate: not-a-number is 0.
        let x = ((azimuth * self.width as f32) as usize).min(self.width - 1);
        let y = ((down * self.height as f32) as usize).min(self.height - 1);
        y * self.width + x
    }

    /// Divides the environment, always the part of most power, until there are [`CELLS`] or only single texels.
    fn divide(&self) -> Vec<Cell> {
        let mut parts = vec![(self.sum(&self.all()), self.all())];
        let mut texels = Vec::new();
        while parts.len() + texels.len() < CELLS {
            let greatest = (0..parts.len()).max_by(|&a, &b| parts[a].0.total_cmp(&parts[b].0));
            let Some(greatest) = greatest else { break };
            let part = parts.swap_remove(greatest);
            match part.1.halves() {
                None => texels.push(part),
                Some(halves) => {
                    let lit = halves.map(|half| (self.sum(&half), half));
                    parts.extend(lit.into_iter().filter(|(sum, _)| *sum > 0.0));
                }
            }
        }
        parts.extend(texels);
        let cells = parts.into_iter().map(|(sum, rect)| self.cell(rect, sum));
        cells.collect()
    }

    fn cell(&self, rect: Rect, sum: f64) -> Cell {
        let mut irradiance = DVec3::ZERO;
        let mut chroma = DVec3::ZERO;
        for y in rect.y[0]..rect.y[1] {
            let solid_angle = solid_angle(self.width, self.height, y);
            for x in rect.x[0]..rect.x[1] {
                let radiance = self.texels[y * self.width + x].as_dvec3();
                irradiance += radiance * solid_angle;
                let luminance = radiance.element_sum() / 3.0;
                if luminance > 0.0 {
                    chroma = chroma.max(radiance / luminance);
                }
            }
        }
        let irradiance = irradiance.as_vec3();
        // A channel that the cell does not have, no texel has.
        let peak = (0..3)
            .filter(|&c| irradiance[c] > 0.0)
            .map(|c| (chroma[c] * sum / f64::from(irradiance[c])) as f32)
            .fold(1.0, f32::max);
        let (middle, cos) = self.around(&rect);
        Cell {
            rect,
            middle,
            cos,
            irradiance,
            // Rounding on the way down to a texel.
            peak: peak * 1.0001,
        }
    }

    /// The middle of a rectangle, and the cosine of an angle about it that holds the rectangle.
    fn around(&self, rect: &Rect) -> (Vec3, f32) {
        let azimuth = |x: usize| x as f64 / self.width as f64;
        let cosine = |y: usize| (std::f64::consts::PI * y as f64 / self.height as f64).cos();
        let [x0, x1] = rect.x.map(azimuth);
        let [y0, y1] = rect.y.map(cosine);
        let corners = [(x0, y0), (x0, y1), (x1, y0), (x1, y1)];
        let corners = corners.map(|(x, y)| direction(x, y));
        let half_down = 0.5 * (y0.acos() + y1.acos());
        let middle = direction(0.5 * (x0 + x1), half_down.cos());
        let least = corners
            .iter()
            .map(|corner| corner.dot(middle))
            .fold(1.0, f32::min);
        // Along a row the angle to the middle grows toward both ends while they are less than half a turn apart; along
        // a column as long as the corners are in front.
        if x1 - x0 <= 0.5 && least > 0.0 {
            (middle, (least - 1e-6).next_down())
        } else {
            (middle, -1.0)
        }
    }
}

impl Rect {
    /// Both halves along the longer side, counted in texels; `None` for a texel.
    fn halves(&self) -> Option<[Self; 2]> {
        let ([x0, x1], [y0, y1]) = (self.x, self.y);
        let (w, h) = (x1 - x0, y1 - y0);
        if w == 1 && h == 1 {
            return None;
        }
        Some(if w >= h {
            let middle = x0 + w / 2;
            [[x0, middle], [middle, x1]].map(|x| Self { x, ..*self })
        } else {
            let middle = y0 + h / 2;
            [[y0, middle], [middle, y1]].map(|y| Self { y, ..*self })
        })
    }
}

/// The direction at `azimuth`, in turns, and `height`, the cosine to the zenith.
fn direction(azimuth: f64, height: f64) -> Vec3 {
    let (sin, cos) = (std::f64::consts::TAU * azimuth).sin_cos();
    let across = (1.0 - height * height).max(0.0).sqrt();
    DVec3::new(across * sin, height, -across * cos).as_vec3()
}

/// Cosines to the zenith of the upper and the lower edge of row `y`.
fn row_cosines(height: usize, y: usize) -> [f64; 2] {
    [y, y + 1].map(|y| (std::f64::consts::PI * y as f64 / height as f64).cos())
}

/// Solid angle of a texel of row `y`.
fn solid_angle(width: usize, height: usize, y: usize) -> f64 {
    let [top, bottom] = row_cosines(height, y);
    std::f64::consts::TAU / width as f64 * (top - bottom)
}

/// The mean of the channels: above 0 wherever a channel is.
fn luminance(c: Vec3) -> f64 {
    c.as_dvec3().element_sum() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use sampling::{Purpose, Rng, uniform_sphere};

    /// A dim coloured sky, black below, with a small sun.
    fn sky() -> Environment {
        let (width, height) = (48, 24);
        let texels = (0..width * height).map(|i| {
            let (x, y) = (i % width, i / width);
            let dim = Vec3::new(0.1, 0.2, 0.3 + 0.01 * x as f32);
            match (x, y) {
                (30, 5) => Vec3::new(900.0, 800.0, 500.0),
                _ if y < height / 2 => dim * (1 + y % 3) as f32,
                _ => Vec3::ZERO,
            }
        });
        Environment::new(width, height, texels.collect()).expect("lit")
    }

    #[test]
    fn directions_are_found_on_the_texel_they_are_drawn_from() {
        let sky = sky();
        let mut rng = Rng::new(1, 0, 0, Purpose::Build);
        let mut apart = 0;
        for _ in 0..20_000 {
            let drawn = sky.sample(rng.f64(), [rng.f32(), rng.f32()]);
            let density = f64::from(sky.pdf_solid_angle(drawn.direction));
            let found = sky.radiance(drawn.direction).as_dvec3() / density;
            // Rounding may put a direction across an edge.
            let same = found.distance(drawn.power.as_dvec3()) < 1e-4 * found.length();
            apart += u32::from(!same);
        }
        assert!(apart < 20, "{apart} of 20000");
    }

    #[test]
    fn cells_hold_their_directions_and_together_all_the_light() {
        for environment in [sky(), Environment::constant(Vec3::ONE).expect("lit")] {
            let mut sum = DVec3::ZERO;
            let mut rng = Rng::new(2, 0, 0, Purpose::Build);
            for (i, cell) in environment.cells().iter().enumerate() {
                sum += cell.irradiance.as_dvec3();
                let mut mean = DVec3::ZERO;
                for k in 0..64 {
                    let u = (f64::from(k) + 0.5) / 64.0;
                    let drawn = environment.sample_cell(i, u, [rng.f32(), rng.f32()]);
                    let cos = drawn.direction.dot(cell.middle);
                    assert!(cos >= cell.cos, "{cos} outside of {cell:?}");
                    let most = cell.irradiance * cell.peak;
                    assert!(drawn.power.cmple(most).all(), "{drawn:?} of {cell:?}");
                    mean += drawn.power.as_dvec3() / 64.0;
                }
                let exact = cell.irradiance.as_dvec3();
                assert!(
                    mean.distance(exact) < 0.02 * exact.length(),
                    "{mean}, {exact}"
                );
            }
            let [width, height] = environment.size();
            let mut exact = DVec3::ZERO;
            for (i, texel) in environment.texels().iter().enumerate() {
                exact += texel.as_dvec3() * solid_angle(width, height, i / width);
            }
            assert!(
                sum.distance(exact) < 1e-5 * exact.length(),
                "{sum}, {exact}"
            );
            assert!(
                environment.cells().len() > CELLS / 2,
                "{}",
                environment.cells().len()
            );
        }
    }

    #[test]
    fn a_constant_environment_has_four_pi_of_it_from_all_directions_alike() {
        let environment = Environment::constant(Vec3::new(1.0, 2.0, 3.0)).expect("lit");
        let total = environment.total();
        assert!(
            (total / (8.0 * std::f64::consts::PI) - 1.0).abs() < 1e-9,
            "{total}"
        );
        let mut rng = Rng::new(3, 0, 0, Purpose::Build);
        for _ in 0..100 {
            let direction = uniform_sphere([rng.f32(), rng.f32()]);
            let pdf = environment.pdf_solid_angle(direction);
            assert!((pdf * 4.0 * PI - 1.0).abs() < 1e-5, "{pdf} at {direction}");
        }
        // Octants get equal shares: 5 sigma of 8000 draws.
        let mut counts = [0; 8];
        for _ in 0..8000 {
            let d = environment
                .sample(rng.f64(), [rng.f32(), rng.f32()])
                .direction;
            counts[(usize::from(d.x > 0.0) * 2 + usize::from(d.y > 0.0)) * 2
                + usize::from(d.z > 0.0)] += 1;
        }
        assert!(
            counts.iter().all(|c| i32::abs(c - 1000) < 150),
            "{counts:?}"
        );
    }

    #[test]
    fn the_zenith_is_the_first_row_and_the_middle_looks_along_z() {
        let (width, height) = (8, 4);
        let texel = |i: usize| Vec3::new((i % width) as f32, (i / width) as f32, 1.0);
        let texels = (0..width * height).map(texel).collect();
        let environment = Environment::new(width, height, texels).expect("lit");
        assert_eq!(environment.radiance(Vec3::Y).y, 0.0, "up");
        assert_eq!(environment.radiance(Vec3::NEG_Y).y, 3.0, "down");
        let ahead = Vec3::new(-1e-3, 1e-3, 1.0).normalize();
        assert_eq!(environment.radiance(ahead), Vec3::new(4.0, 1.0, 1.0), "+z");
        let right = Vec3::new(1.0, 1e-3, -1e-3).normalize();
        assert_eq!(environment.radiance(right), Vec3::new(1.0, 1.0, 1.0), "+x");
    }

    #[test]
    fn black_is_none_and_a_single_texel_is_every_direction() {
        assert!(Environment::constant(Vec3::ZERO).is_none(), "black");
        let one = Environment::new(1, 1, vec![Vec3::ONE]).expect("lit");
        assert_eq!(one.cells().len(), 1, "one cell");
        assert_eq!(one.cells()[0].cos, -1.0, "of every direction");
    }
}
