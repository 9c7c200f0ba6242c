//! Virtual spheres whose light has no closed form, evaluated side by side.
//!
//! The estimates of [`sphere`](crate::sphere::sphere), by the same operations in the same order, for lobes of constant
//! reflectance. What is drawn is drawn light by light, so that each gets the random numbers that it would get alone.

use std::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::Vec3;
use light_tree::Gloss;
use sampling::{Frame, Rng, cone_direction, ggx_density, ggx_reflected, ggx_visibility, turn};
use scene::Brdf;

use crate::point::GatherPoint;
use crate::side_by_side::{Placed, Seen, set_vector, vector};
use crate::sphere::LEAST_SHARE;
use crate::width::by_width;

/// Estimates side by side: fewer than lights, for few have none but an estimate.
pub(crate) const FEW: usize = 8;

/// A number of each light.
type Lanes = [f32; FEW];

/// Up to [`FEW`] lights. Lanes that hold none have any numbers.
#[derive(Debug, Default)]
pub(crate) struct LobeLanes {
    given: Given,
    begun: Begun,
    drawn: Drawn,
    /// What the point reflects of each, were its intensity 1.
    pub(crate) reflected: [Lanes; 3],
}

/// What lights are.
#[derive(Debug, Default)]
#[repr(C, align(64))]
struct Given {
    /// Unit direction.
    axis: [Lanes; 3],
    one_minus_cos: Lanes,
    spread: Lanes,
    /// [`Subtended::cosine_integral`](crate::vsl::Subtended::cosine_integral).
    integral: Lanes,
    /// 1 where all of the sphere is above both horizons.
    is_whole: [u32; FEW],
    /// Opposite to the normal of the surface.
    toward: [Lanes; 3],
    /// 1 where the surface has a lobe. Of others the following is unknown.
    is_glossy: [u32; FEW],
    /// Shading normal.
    normal: [Lanes; 3],
    incoming: [Lanes; 3],
    reflectance: [Lanes; 3],
    diffuse: [Lanes; 3],
    specular: [Lanes; 3],
    alpha: Lanes,
}

/// What does not depend on directions.
#[derive(Debug, Default)]
#[repr(C, align(64))]
struct Begun {
    solid_angle: Lanes,
    /// Product of the BRDFs' constant parts, 0 where the integral over it has no closed form.
    constant: [Lanes; 3],
    /// That integral.
    exact: [Lanes; 3],
    /// 1 where the cone is wide enough for the lobe of the point, or of the light, to be drawn from.
    by_receiver: [u32; FEW],
    by_sender: [u32; FEW],
}

/// What was drawn.
#[derive(Debug, Default)]
#[repr(C, align(64))]
struct Drawn {
    /// For a direction of the cone, the second as a [`turn`].
    u: Lanes,
    turn: [Lanes; 2],
    /// Directions by the lobes of the point and of the lights, and 1 where there is one.
    directions: [[Lanes; 3]; 2],
    are_there: [[u32; FEW]; 2],
}

/// A lobe toward one direction.
pub(crate) struct Lobe {
    /// Over the specular reflectance, sr⁻¹.
    pub(crate) value: f32,
    pdf: f32,
}

impl Lobe {
    /// Of `n` and squared roughness `alpha2` for light between unit `wo` and `wi`.
    #[inline(always)]
    pub(crate) fn of(n: Vec3, alpha2: f32, wo: Vec3, wi: Vec3) -> Self {
        let (cos_o, cos_i) = (n.dot(wo), n.dot(wi));
        let h = (wo + wi).normalize_or(n);
        let sin2 = n.cross(h).length_squared().min(1.0);
        let density = ggx_density(alpha2, sin2);
        let value = density * ggx_visibility(alpha2, cos_o, cos_i);
        let pdf = density * ggx_reflected(alpha2, cos_o);
        Self {
            value: if (cos_o > 0.0) & (cos_i > 0.0) {
                value
            } else {
                0.0
            },
            pdf: if cos_o <= 0.0 { 0.0 } else { pdf },
        }
    }
}

impl LobeLanes {
    /// Sets lane `j` to the light in lane `k` of `placed`; `gloss` is its lobe, if it has one.
    #[inline]
    pub(crate) fn set(
        &mut self,
        j: usize,
        (placed, k): (&Placed, usize),
        is_whole: bool,
        normal: Vec3,
        gloss: Option<Gloss>,
    ) {
        let given = &mut self.given;
        set_vector(&mut given.axis, j, vector(&placed.axis, k));
        given.one_minus_cos[j] = placed.one_minus_cos[k];
        given.spread[j] = placed.spread[k];
        given.integral[j] = placed.integral[k];
        given.is_whole[j] = is_whole.into();
        set_vector(&mut given.toward, j, -normal);
        given.is_glossy[j] = gloss.is_some().into();
        if let Some(gloss) = gloss {
            set_vector(&mut given.normal, j, gloss.normal);
            set_vector(&mut given.incoming, j, gloss.incoming);
            set_vector(&mut given.reflectance, j, gloss.reflectance);
            set_vector(&mut given.diffuse, j, gloss.diffuse);
            set_vector(&mut given.specular, j, gloss.specular);
            given.alpha[j] = gloss.alpha;
        }
    }

    /// Works out what does not depend on directions.
    pub(crate) fn begin(&mut self, x: &Seen) {
        self.drawn.are_there = [[0; FEW]; 2];
        begin(&self.given, x, &mut self.begun);
    }

    /// Draws directions for lane `j`.
    #[inline]
    pub(crate) fn draw(&mut self, j: usize, x: &GatherPoint, rng: &mut Rng) {
        let mut u = || [rng.f32(), rng.f32()];
        let drawn = &mut self.drawn;
        let [first, second] = u();
        drawn.u[j] = first;
        [drawn.turn[0][j], drawn.turn[1][j]] = turn(second);
        if self.begun.by_receiver[j] != 0 {
            let w = x.brdf.sample_specular(x.ns, x.wo, u());
            set_vector(&mut drawn.directions[0], j, w);
            drawn.are_there[0][j] = 1;
        }
        if self.begun.by_sender[j] != 0 {
            let given = &self.given;
            let lobe = Brdf {
                specular: vector(&given.specular, j),
                alpha: given.alpha[j],
                ..Brdf::lambert(vector(&given.diffuse, j))
            };
            let (n, wo) = (vector(&given.normal, j), vector(&given.incoming, j));
            let w = -lobe.sample_specular(n, wo, u());
            set_vector(&mut drawn.directions[1], j, w);
            drawn.are_there[1][j] = 1;
        }
    }

    /// Works out what is reflected, after directions were drawn for all lanes that count.
    pub(crate) fn finish(&mut self, x: &Seen) {
        finish(
            &self.given,
            &self.begun,
            &self.drawn,
            x,
            &mut self.reflected,
        );
    }
}

by_width!(finish = finish_with(
    given: &Given,
    begun: &Begun,
    drawn: &Drawn,
    x: &Seen,
    reflected: &mut [Lanes; 3]
));

#[inline(always)]
fn finish_with(given: &Given, begun: &Begun, drawn: &Drawn, x: &Seen, reflected: &mut [Lanes; 3]) {
    match x.is_glossy {
        true => finish_for::<true>(given, begun, drawn, x, reflected),
        false => finish_for::<false>(given, begun, drawn, x, reflected),
    }
}

#[inline(always)]
fn finish_for<const GLOSSY: bool>(
    given: &Given,
    begun: &Begun,
    drawn: &Drawn,
    x: &Seen,
    reflected: &mut [Lanes; 3],
) {
    let mut sum = [[0.0; FEW]; 3];
    for j in 0..FEW {
        let turn = [drawn.turn[0][j], drawn.turn[1][j]];
        let local = cone_direction(given.one_minus_cos[j], drawn.u[j], turn);
        let w = Frame::around(vector(&given.axis, j)).to_world(local);
        set_vector(&mut sum, j, weighed::<GLOSSY>(given, begun, x, j, w));
    }
    for strategy in 0..2 {
        if drawn.are_there[strategy] == [0; FEW] {
            continue;
        }
        for j in 0..FEW {
            let w = vector(&drawn.directions[strategy], j);
            let axis = vector(&given.axis, j);
            let is_in = w.distance_squared(axis) <= 2.0 * given.one_minus_cos[j];
            let before = vector(&sum, j);
            let after = before + weighed::<GLOSSY>(given, begun, x, j, w);
            let counts = (drawn.are_there[strategy][j] != 0) & is_in;
            set_vector(&mut sum, j, if counts { after } else { before });
        }
    }
    for j in 0..FEW {
        let estimate = vector(&sum, j) * given.spread[j];
        set_vector(reflected, j, vector(&begun.exact, j) + estimate);
    }
}

by_width!(begin = begin_with(given: &Given, x: &Seen, begun: &mut Begun));

#[inline(always)]
fn begin_with(given: &Given, x: &Seen, begun: &mut Begun) {
    for j in 0..FEW {
        let solid_angle = TAU * given.one_minus_cos[j];
        begun.solid_angle[j] = solid_angle;
        let is_glossy = given.is_glossy[j] != 0;
        let diffuse = vector(&given.diffuse, j) * FRAC_1_PI;
        let constant = match is_glossy {
            true => x.constant * diffuse * scale(given, j),
            false => x.constant,
        };
        let constant = if given.is_whole[j] != 0 {
            constant
        } else {
            Vec3::ZERO
        };
        set_vector(&mut begun.constant, j, constant);
        let is_black = (constant.x == 0.0) & (constant.y == 0.0) & (constant.z == 0.0);
        let exact = constant * given.integral[j];
        set_vector(
            &mut begun.exact,
            j,
            if is_black { Vec3::ZERO } else { exact },
        );
        let (normal, incoming) = (vector(&given.normal, j), vector(&given.incoming, j));
        let alpha2 = given.alpha[j] * given.alpha[j];
        let reflected = ggx_reflected(alpha2, normal.dot(incoming).max(0.0));
        let greatest_pdf = ggx_density(alpha2, 0.0) * reflected;
        let by_sender = is_glossy & (solid_angle * greatest_pdf >= LEAST_SHARE);
        let by_receiver = x.is_glossy & (solid_angle * x.greatest_pdf >= LEAST_SHARE);
        begun.by_sender[j] = by_sender.into();
        begun.by_receiver[j] = by_receiver.into();
    }
}

/// [`GlossySender::scale`](crate::sender::GlossySender::scale).
#[inline(always)]
fn scale(given: &Given, j: usize) -> Vec3 {
    let reflectance = vector(&given.reflectance, j);
    let one = |r: f32| if r > 0.0 { PI / r } else { 0.0 };
    Vec3::new(one(reflectance.x), one(reflectance.y), one(reflectance.z))
}

/// The integrand at unit `w` over the density of all strategies together, relative to the uniform one.
#[inline(always)]
fn weighed<const GLOSSY: bool>(given: &Given, begun: &Begun, x: &Seen, j: usize, w: Vec3) -> Vec3 {
    let toward = vector(&given.toward, j);
    let cosines = x.ns.dot(w).max(0.0) * toward.dot(w).max(0.0);
    let mut density = 1.0;
    let mut reflected = x.constant;
    if GLOSSY {
        let lobe = Lobe::of(x.ns, x.alpha2, x.wo, w);
        reflected += x.specular * lobe.value;
        let more = density + begun.solid_angle[j] * lobe.pdf;
        density = if begun.by_receiver[j] != 0 {
            more
        } else {
            density
        };
    }
    let normal = vector(&given.normal, j);
    let alpha2 = given.alpha[j] * given.alpha[j];
    let lobe = Lobe::of(normal, alpha2, vector(&given.incoming, j), -w);
    let more = density + begun.solid_angle[j] * lobe.pdf;
    density = if begun.by_sender[j] != 0 {
        more
    } else {
        density
    };
    let diffuse = vector(&given.diffuse, j) * FRAC_1_PI;
    let brdf = diffuse + vector(&given.specular, j) * lobe.value;
    let emitted = brdf * scale(given, j);
    let emitted = if normal.dot(-w) > 0.0 {
        emitted
    } else {
        Vec3::ZERO
    };
    let emitted = if given.is_glossy[j] != 0 {
        emitted
    } else {
        Vec3::ONE
    };
    let integrand = (reflected * emitted - vector(&begun.constant, j)) * cosines;
    let integrand = if cosines == 0.0 {
        Vec3::ZERO
    } else {
        integrand
    };
    integrand / density
}
