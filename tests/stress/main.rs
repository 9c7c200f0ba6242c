//! Every method, under every kind of light, in conditions that floating-point numbers do not like.
//!
//! Nothing may panic, no sample may be refused, nothing negative or not finite may come out. What all lights give is
//! compared with the same in double precision, and with a picture of which it must be a multiple; what a method gives is
//! compared with what all lights give. The whole takes minutes and prints the table of `RELIABILITY.md`:
//!
//!     cargo test --test stress -- --ignored --nocapture the_whole

mod check;
mod conditions;
mod exact;
mod room;
mod table;

use check::{Finding, check};
use rayon::prelude::*;

/// Findings of all cases, in their order.
fn findings(quick: bool) -> Vec<Finding> {
    let cases = conditions::all(quick);
    let checks: usize = cases.iter().map(|_| gather::MethodSpec::all().len()).sum();
    let all = cases
        .par_iter()
        .with_max_len(1)
        .map(|case| check(case, checks));
    all.collect::<Vec<_>>().concat()
}

#[track_caller]
fn assert_sound(findings: &[Finding]) {
    let failed: Vec<_> = findings.iter().filter_map(Finding::failure).collect();
    assert!(
        failed.is_empty(),
        "{} of {} failed:\n{}",
        failed.len(),
        findings.len(),
        failed.join("\n")
    );
}

#[test]
fn every_method_is_sound_where_numbers_are_extreme() {
    let findings = findings(true);
    assert!(findings.len() > 1000, "only {} checks", findings.len());
    assert_sound(&findings);
}

#[test]
#[ignore = "minutes: every kind of light, and a million of them"]
fn the_whole() {
    let findings = findings(false);
    eprintln!("{}", table::markdown(&findings));
    assert_sound(&findings);
}

#[test]
#[should_panic(expected = "attempt to add with overflow")]
fn overflow_ends_a_test() {
    let most = std::hint::black_box(u32::MAX);
    assert_eq!(most + 1, 0, "without the check it wraps");
}
