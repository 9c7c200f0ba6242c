//! The pictures that cells are measured against.

use std::sync::atomic::Ordering;

use experiment::{Coordinates, Reference, store};
use film::Picture;
use gather::{MethodSpec, Render, Shard};

use super::run::Machinery;
use super::spec::{MethodEntry, ReferenceSpec};
use crate::error::CliError;
use crate::fingerprint::Fnv;
use crate::interrupt;
use crate::job::Job;
use crate::prepared::{self, LoadedScene, PreparedLights};
use crate::render::Checkpoint;
use crate::report;
use crate::state::{self, Resumed, Saved, Subject};

/// Up to so many lights, looking at all of them is the surest reference and not much slower than the fastest.
const FEW_LIGHTS: usize = 100;
/// Before this many samples a pixel's variance is little more than a guess.
const LEAST_SPP: u64 = 16;

/// A reference with its picture.
pub(crate) struct Compared {
    pub(crate) record: Reference,
    pub(crate) picture: Picture,
}

/// The reference's method, and whether it is one of those under test.
pub(crate) struct Choice {
    pub(crate) method: MethodSpec,
    pub(crate) under_test: bool,
}

/// The method that the experiment names (an unbiased one), or else the first unbiased one that it does not compare itself.
pub(crate) fn choose(spec: &ReferenceSpec, tested: &[MethodEntry], light_count: usize) -> Choice {
    let is_tested = |method: &MethodSpec| tested.iter().any(|t| t.method == *method);
    if let Some(method) = &spec.method {
        return Choice {
            under_test: is_tested(method),
            method: method.clone(),
        };
    }
    // The one that is clean soonest, and others that use a tree.
    let mut order = vec![MethodSpec::default()];
    let all = MethodSpec::all();
    order.extend(all.into_iter().filter(|m| m.is_unbiased() && m.uses_tree()));
    let all_lights = MethodSpec::AllLights(Default::default());
    match light_count > FEW_LIGHTS {
        true => order.push(all_lights),
        false => order.insert(0, all_lights),
    }
    let free = order.iter().find(|m| !is_tested(m));
    Choice {
        under_test: free.is_none(),
        method: free.unwrap_or(&order[0]).clone(),
    }
}

/// The name of a reference's files: a hash of its content and of how good it is to be, but not of the program's
/// version, so that it outlives a change of the program. The record says which program made it.
pub(crate) fn key(subject: &Subject, spec: &ReferenceSpec) -> String {
    let mut hash = Fnv::default();
    for entry in subject.content() {
        hash.debug(entry);
    }
    hash.debug(&(spec.standard_error.0, spec.max_spp.0, spec.max_seconds.0));
    format!("{:016x}", hash.0)
}

/// A reference that some cells need.
pub(crate) struct Wanted<'a> {
    pub(crate) spec: &'a ReferenceSpec,
    /// As [`key`] gives it.
    pub(crate) key: &'a str,
    /// Of one of the cells.
    pub(crate) coordinates: &'a Coordinates,
    pub(crate) job: &'a Job,
    pub(crate) subject: &'a Subject,
    pub(crate) under_test: bool,
}

/// Reads a reference, or renders it, saving its state about once a minute.
///
/// # Errors
/// When it cannot be read or written, or someone wants it to stop.
pub(crate) fn obtain(
    machinery: &Machinery<'_>,
    wanted: &Wanted<'_>,
    loaded: &LoadedScene,
    lights: &PreparedLights,
) -> Result<Compared, CliError> {
    let file = |end| machinery.store.reference(wanted.key, end);
    let (record, picture) = (file("json"), file("exr"));
    if let Some(record) = store::read_record::<Reference>(&record)?
        && picture.is_file()
    {
        let (picture, _) = Picture::read_exr(&picture)?;
        return Ok(Compared { record, picture });
    }
    let render = converged(machinery, wanted, loaded, lights)?;
    let job = wanted.job;
    let finished = render.picture();
    let coordinates = wanted.coordinates;
    let made = Reference {
        key: wanted.key.to_owned(),
        scene: coordinates.scene.clone(),
        lights: coordinates.lights.clone(),
        frame: coordinates.frame,
        method: format!("{:?}", job.method),
        under_test: wanted.under_test,
        seed: job.seed,
        spp: render.spp(),
        seconds: render.seconds(),
        standard_error: standard_error(&finished),
        asked: wanted.spec.standard_error.0,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: env!("MANYLIGHT_COMMIT").to_owned(),
    };
    let metadata = report::metadata(job, &loaded.scene, render.spp());
    finished.write_exr(&picture, &metadata)?;
    // Last, for it says that the picture is whole.
    store::write_record(&record, &made)?;
    state::remove(&file("state"))?;
    let asked = match made.is_good_enough() {
        true => String::new(),
        false => format!(" (asked for {})", made.asked),
    };
    machinery.progress.line(&format!(
        "reference of {}, {}: {} spp by {}, standard error {:.4}{asked}, {:.1} s",
        made.scene,
        made.lights,
        made.spp,
        job.method.name(),
        made.standard_error,
        made.seconds
    ));
    Ok(Compared {
        record: made,
        picture: finished,
    })
}

/// The render when its error is small enough, or one of its limits is reached.
fn converged<'a>(
    machinery: &Machinery<'_>,
    wanted: &Wanted<'a>,
    loaded: &'a LoadedScene,
    lights: &'a PreparedLights,
) -> Result<Render<'a>, CliError> {
    let saved = machinery.store.reference(wanted.key, "state");
    let begun = || prepared::render(loaded, &lights.inputs, wanted.job, Shard::ALL);
    let mut render = begun();
    if let Some(found) = Saved::open(&saved)? {
        match found.resume(wanted.subject, begun()) {
            Ok(Resumed { render: kept, .. }) => render = kept,
            // The state of another build may be of other bits.
            Err(error) => machinery.progress.line(&format!("warning: {error}")),
        }
    }
    let stop = interrupt::flag();
    render.stop_on(stop);
    render.prepare();
    let mut checkpoint = Checkpoint::new();
    let mut looked_at = 0;
    let limits = wanted.spec;
    loop {
        let spp = u64::from(render.spp());
        // Looking takes time, so each look is at a quarter more samples than the last.
        if spp >= LEAST_SPP && spp * 4 >= looked_at * 5 {
            looked_at = spp;
            if standard_error(&render.picture()) <= limits.standard_error.0 {
                break;
            }
        }
        if render.seconds() >= limits.max_seconds.0 || render.pass(&|_| ()).is_none() {
            break;
        }
        if checkpoint.is_due() {
            state::write(&saved, wanted.subject, &[], &render)?;
            checkpoint.done();
        }
    }
    if stop.load(Ordering::Relaxed) {
        state::write(&saved, wanted.subject, &[], &render)?;
        return Err(super::interrupted(machinery.store));
    }
    Ok(render)
}

/// Relative, as [`Reference::standard_error`]; infinite where a single sample says nothing.
fn standard_error(picture: &Picture) -> f64 {
    film::relative_variance(picture).map_or(f64::INFINITY, f64::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(method: MethodSpec) -> MethodEntry {
        MethodEntry {
            name: method.name().to_owned(),
            method,
        }
    }

    fn chosen(tested: &[MethodEntry], lights: usize) -> (&'static str, bool) {
        let choice = choose(&ReferenceSpec::default(), tested, lights);
        (choice.method.name(), choice.under_test)
    }

    #[test]
    fn few_lights_are_all_looked_at_and_many_are_not() {
        assert_eq!(chosen(&[], 100), ("all-lights", false), "few");
        let best = MethodSpec::default();
        assert_eq!(chosen(&[], 1_000_000), (best.name(), false), "many");
        let (name, under_test) = chosen(&[entry(best)], 1_000_000);
        assert!(name != "all-lights" && !under_test, "{name}");
    }

    #[test]
    fn a_method_under_test_is_chosen_only_where_no_other_serves() {
        let all: Vec<_> = MethodSpec::all().into_iter().map(entry).collect();
        let one = entry(MethodSpec::all().into_iter().next().expect("methods"));
        let (name, under_test) = chosen(&[one], 100);
        assert!(name != "all-lights" && !under_test, "{name}");
        let (_, under_test) = chosen(&all, 100);
        assert!(under_test, "all are under test");
    }
}
