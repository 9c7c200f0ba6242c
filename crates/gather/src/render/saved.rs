//! A render's state as bytes, so that another process can go on with it to the same bits.
//!
//! Little-endian: samples done (u32), seconds (f64), counters (u64 each); then tile by tile the samples done
//! (u32), pixel by pixel the statistics and the sums of features, and what was learned: the number of clusters (u32), what is
//! typical (f64), the mean square of each (f32), and unless nothing is typical factors (f32) and trials (u32 each) by blocks and
//! clusters. What the render is of is not in there: whoever keeps the bytes makes sure that they meet the same scene, lights
//! and settings again.

use std::io::{Error, ErrorKind, Read, Result, Write};

use film::PixelStats;
use glam::DVec3;

use super::{Features, Render, Tile};
use crate::counters::{Counters, PHASES};
use crate::learned::{Learned, MOST_BEYOND, Probed};

/// Counters of [`Counters`].
const COUNTERS: usize = 7 + PHASES;
/// Beyond this a counter is no count: sums of a few must stay below 2⁶⁴.
const GREATEST_COUNT: u64 = 1 << 56;

impl Render<'_> {
    /// Writes the state after the last pass, with the finished tiles of one that was stopped.
    ///
    /// # Errors
    /// When `to` does not take it.
    pub fn save(&self, to: &mut dyn Write) -> Result<()> {
        to.write_all(&self.done.to_le_bytes())?;
        to.write_all(&self.seconds.to_le_bytes())?;
        for count in counts(&self.counters()) {
            to.write_all(&count.to_le_bytes())?;
        }
        for tile in &self.tiles {
            to.write_all(&tile.done.to_le_bytes())?;
            for (pixel, features) in tile.pixels.iter().zip(&tile.features) {
                to.write_all(&pixel.to_bytes())?;
                features.save(to)?;
            }
            tile.learned.save(to)?;
        }
        Ok(())
    }

    /// This render with the state that [`Render::save`] wrote for one of the same scene, method and spec;
    /// only the number of samples asked for may differ.
    ///
    /// # Errors
    /// When `from` fails, ends early, or holds what cannot be a state of this render. It takes no memory.
    pub fn restored(mut self, from: &mut dyn Read) -> Result<Self> {
        let target = self.spec.spp;
        self.done = u32::from_le_bytes(take(from)?);
        self.seconds = f64::from_le_bytes(take(from)?);
        if !self.seconds.is_finite() || self.seconds < 0.0 {
            return Err(unsound(format!("{} seconds of rendering", self.seconds)));
        }
        let mut found = [0; COUNTERS];
        for count in &mut found {
            *count = u64::from_le_bytes(take(from)?);
            if *count > GREATEST_COUNT {
                return Err(unsound(format!("a count of {count}")));
            }
        }
        self.before = counters(&found);
        let mut most = self.done;
        for tile in &mut self.tiles {
            tile.restore(from)?;
            if tile.done < self.done {
                let (tile, all) = (tile.done, self.done);
                return Err(unsound(format!("a tile of {tile} samples among {all}")));
            }
            most = most.max(tile.done);
        }
        if most > target {
            return Err(unsound(format!(
                "it has {most} samples a pixel; expected at most the {target} asked for"
            )));
        }
        Ok(self)
    }
}

impl Tile {
    fn restore(&mut self, from: &mut dyn Read) -> Result<()> {
        self.done = u32::from_le_bytes(take(from)?);
        for (pixel, features) in self.pixels.iter_mut().zip(&mut self.features) {
            *pixel = PixelStats::from_bytes(&take(from)?)
                .filter(|pixel| pixel.count() <= self.done)
                .ok_or_else(|| unsound("statistics of a pixel".into()))?;
            *features = Features::read(from)?;
            if !features.is_sound(self.done) {
                return Err(unsound(format!("{features:?}")));
            }
        }
        self.learned = Learned::read(from)?;
        Ok(())
    }
}

/// Clusters of a cut, at most.
const MOST_CLUSTERS: u32 = (1 << 16) + MOST_BEYOND;

impl Learned {
    fn save(&self, to: &mut dyn Write) -> Result<()> {
        let Probed { squares, typical } = &self.probed;
        to.write_all(&(squares.len() as u32).to_le_bytes())?;
        to.write_all(&typical.to_le_bytes())?;
        for square in squares {
            to.write_all(&square.to_le_bytes())?;
        }
        for (factor, trials) in self.factors.iter().zip(&self.trials) {
            to.write_all(&factor.to_le_bytes())?;
            to.write_all(&trials.count.to_le_bytes())?;
            to.write_all(&trials.squares.to_le_bytes())?;
        }
        Ok(())
    }

    fn read(from: &mut dyn Read) -> Result<Self> {
        let clusters = u32::from_le_bytes(take(from)?);
        let typical = f64::from_le_bytes(take(from)?);
        let is_sound = clusters <= MOST_CLUSTERS && typical >= 0.0 && typical.is_finite();
        if !is_sound {
            let what = format!("{clusters} clusters of typically {typical}");
            return Err(unsound(what));
        }
        let mut squares = Vec::new();
        for _ in 0..clusters {
            squares.push(positive(from)?);
        }
        let mut learned = Self::of(Probed { squares, typical });
        for (factor, trials) in learned.factors.iter_mut().zip(&mut learned.trials) {
            *factor = positive(from)?;
            trials.count = u32::from_le_bytes(take(from)?);
            trials.squares = u32::from_le_bytes(take(from)?);
        }
        Ok(learned)
    }
}

/// A number above 0.
fn positive(from: &mut dyn Read) -> Result<f32> {
    let number = f32::from_le_bytes(take(from)?);
    match number > 0.0 && number.is_finite() {
        true => Ok(number),
        false => Err(unsound(format!("{number} where something was learned"))),
    }
}

impl Features {
    fn save(&self, to: &mut dyn Write) -> Result<()> {
        let vectors = [self.albedo, self.normal, self.direct];
        for value in vectors.iter().flat_map(|v| v.to_array()) {
            to.write_all(&value.to_le_bytes())?;
        }
        to.write_all(&self.depth.to_le_bytes())?;
        to.write_all(&self.hits.to_le_bytes())
    }

    fn read(from: &mut dyn Read) -> Result<Self> {
        let mut value = || take(from).map(f64::from_le_bytes);
        Ok(Self {
            albedo: DVec3::new(value()?, value()?, value()?),
            normal: DVec3::new(value()?, value()?, value()?),
            direct: DVec3::new(value()?, value()?, value()?),
            depth: value()?,
            hits: u32::from_le_bytes(take(from)?),
        })
    }

    fn is_sound(&self, samples: u32) -> bool {
        let vectors = [self.albedo, self.normal, self.direct];
        let finite = vectors.iter().all(|v| v.is_finite()) && self.depth.is_finite();
        finite && self.hits <= samples
    }
}

fn counts(c: &Counters) -> [u64; COUNTERS] {
    let [a, b, d, e, f] = c.nanoseconds;
    [
        c.camera_rays,
        c.bounce_rays,
        c.shadow_rays,
        c.light_samples,
        c.dead_samples,
        c.shading_points,
        c.nonfinite,
        a,
        b,
        d,
        e,
        f,
    ]
}

fn counters(counts: &[u64; COUNTERS]) -> Counters {
    let &[
        camera_rays,
        bounce_rays,
        shadow_rays,
        light_samples,
        dead_samples,
        shading_points,
        nonfinite,
        ref nanoseconds @ ..,
    ] = counts;
    Counters {
        camera_rays,
        bounce_rays,
        shadow_rays,
        light_samples,
        dead_samples,
        shading_points,
        nonfinite,
        nanoseconds: *nanoseconds,
    }
}

fn take<const N: usize>(from: &mut dyn Read) -> Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn unsound(what: String) -> Error {
    Error::new(ErrorKind::InvalidData, what)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

    use super::super::tests::{floor_scene, lights, sharing, spec};
    use super::*;
    use crate::{Inputs, MethodSpec, RenderSpec};
    use scene::trace::Tracer;

    /// Calls `f` with a way to make a render of so many samples a pixel: with a cut at every point, with shared ones, and
    /// with what is learned.
    fn with_renders(f: impl Fn(&dyn Fn(u32) -> Render<'static>)) {
        let scene = Box::leak(Box::new(floor_scene()));
        let tracer: &Tracer = Box::leak(Box::new(Tracer::build(scene)));
        let inputs: &Inputs = Box::leak(Box::new(Inputs::new(
            lights(50),
            light_tree::TreeBuilder::Binned,
        )));
        let scene: &scene::Scene = scene;
        for method in [sharing(1), sharing(3), MethodSpec::default()] {
            let method: &MethodSpec = Box::leak(Box::new(method));
            f(&|spp| Render::new(scene, tracer, inputs, method, RenderSpec { spp, ..spec() }));
        }
    }

    fn finish(render: &mut Render<'_>) {
        while render.pass(&|_| ()).is_some() {}
    }

    fn bytes(render: &Render<'_>) -> Vec<u8> {
        let mut bytes = Vec::new();
        render.save(&mut bytes).expect("a Vec takes all");
        bytes
    }

    fn whole_numbers(render: &Render<'_>) -> Counters {
        Counters {
            nanoseconds: [0; PHASES],
            ..render.counters()
        }
    }

    #[test]
    fn a_restored_render_goes_on_to_the_same_bits() {
        with_renders(|render| {
            let mut whole = render(9);
            finish(&mut whole);
            for passes in 0..5 {
                let mut first = render(9);
                for _ in 0..passes {
                    first.pass(&|_| ());
                }
                let mut second = render(9)
                    .restored(&mut &*bytes(&first))
                    .expect("a sound state");
                assert_eq!(second.spp(), first.spp(), "samples after {passes} passes");
                assert_eq!(second.seconds(), first.seconds(), "seconds");
                finish(&mut second);
                assert!(second.picture() == whole.picture(), "after {passes} passes");
                assert_eq!(whole_numbers(&second), whole_numbers(&whole), "counters");
            }
        });
    }

    #[test]
    fn a_render_stopped_within_a_pass_goes_on_to_the_same_bits() {
        with_renders(|render| {
            let mut whole = render(9);
            finish(&mut whole);
            for tiles in [0, 1, 5, 12, 17, 40] {
                let stop = AtomicBool::new(false);
                let left = AtomicU32::new(tiles);
                let count = |_: f64| {
                    if left.fetch_sub(1, Ordering::Relaxed) <= 1 {
                        stop.store(true, Ordering::Relaxed);
                    }
                };
                let mut first = render(9);
                first.stop_on(&stop);
                while first.pass(&count).is_some() {}
                assert!(first.spp() < 9, "{tiles} tiles are not all");
                let state = bytes(&first);
                let mut second = render(9).restored(&mut &*state).expect("a sound state");
                finish(&mut second);
                assert!(second.picture() == whole.picture(), "after {tiles} tiles");
                assert_eq!(whole_numbers(&second), whole_numbers(&whole), "counters");
            }
        });
    }

    #[test]
    fn more_samples_than_asked_for_are_refused() {
        with_renders(|render| {
            let mut four = render(4);
            finish(&mut four);
            let state = bytes(&four);
            assert!(render(4).restored(&mut &*state).is_ok(), "just enough");
            let error = render(3).restored(&mut &*state).err().expect("too many");
            assert!(
                error.to_string().contains("expected at most the 3"),
                "{error}"
            );
        });
    }

    #[test]
    fn no_bytes_make_it_panic() {
        with_renders(|render| {
            let mut first = render(2);
            finish(&mut first);
            let state = bytes(&first);
            for end in [0, 3, 12, 100, 101, state.len() / 2, state.len() - 1] {
                assert!(render(2).restored(&mut &state[..end]).is_err(), "{end}");
            }
            verify::property(1000, |u| {
                let mut forged = state.clone();
                for _ in 0..u.int_in_range(1..=4)? {
                    let end = if u.ratio(3, 4)? { 300 } else { forged.len() };
                    let value = [0, 1, 0x7F, 0x80, 0xFF][u.int_in_range(0..=4)?];
                    let at = u.int_in_range(0..=end - 1)?;
                    forged[at..(at + 4).min(end)].fill(value);
                }
                if let Ok(mut render) = render(3).restored(&mut &*forged) {
                    finish(&mut render);
                    render.picture();
                    render.counters();
                }
                Ok(())
            });
        });
    }
}
