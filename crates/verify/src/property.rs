//! Properties that hold for any input, on inputs that are the same in every run.

use std::env::var_os;

use arbtest::arbitrary::{Result, Unstructured};
use arbtest::arbtest;

/// Bytes of random input that a case has: from so many, which hardly describe anything …
const FEWEST_BYTES: u64 = 32;
/// … doubled so often.
const DOUBLINGS: u64 = 10;

/// Gives `property` so many inputs of growing size, which are a function of their number; it panics where it does not
/// hold, and an error says that the input was too short to make a case of.
///
/// With `ARBTEST_BUDGET_MS` in the environment inputs are new ones in every run, for so many milliseconds, and with
/// `ARBTEST_SEED` there is only the one of that seed, which a failure prints.
///
/// # Panics
/// When the property does, and when no input was long enough.
pub fn property(cases: u64, mut property: impl FnMut(&mut Unstructured<'_>) -> Result<()>) {
    if var_os("ARBTEST_BUDGET_MS").is_some() || var_os("ARBTEST_SEED").is_some() {
        arbtest(property).run();
        return;
    }
    let mut made = 0;
    for case in 0..cases {
        arbtest(|u| {
            made += u64::from(property(u).is_ok());
            Ok(())
        })
        .seed(seed(case, cases))
        .run();
    }
    assert!(made > 0, "none of {cases} inputs was long enough");
}

/// arbtest's seed of a case: 32 random bits, and below them the number of bytes.
fn seed(case: u64, cases: u64) -> u64 {
    let bytes = FEWEST_BYTES << (case * (DOUBLINGS + 1) / cases);
    // An odd factor: another number for each case, and never 0, which arbtest's generator makes nothing but zeros of.
    let random = (2 * case + 1).wrapping_mul(0x9e37_79b9) & 0xffff_ffff;
    random << 32 | bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    fn inputs(cases: u64) -> Vec<Vec<u8>> {
        let mut inputs = Vec::new();
        property(cases, |u| {
            inputs.push(u.bytes(u.len())?.to_vec());
            Ok(())
        });
        inputs
    }

    #[test]
    fn inputs_are_the_same_in_every_run_and_grow() {
        let first = inputs(200);
        assert_eq!(first, inputs(200), "another run");
        assert_eq!(first.len(), 200, "cases");
        assert_eq!(first[0].len(), 32, "bytes of the first");
        assert_eq!(first[199].len(), 32768, "bytes of the last");
        let mut words: Vec<_> = first.iter().map(|input| &input[..8]).collect();
        words.sort();
        words.dedup();
        assert_eq!(words.len(), 200, "different inputs");
    }

    #[test]
    fn a_property_that_fails_or_has_no_case_is_told() {
        let panics = |what: &dyn Fn()| catch_unwind(AssertUnwindSafe(what)).is_err();
        let even = || {
            property(50, |u| {
                assert_eq!(u.arbitrary::<u8>()? % 2, 0, "odd");
                Ok(())
            });
        };
        assert!(panics(&even), "half of all bytes are odd");
        let endless = || {
            property(50, |_| Err(arbtest::arbitrary::Error::NotEnoughData));
        };
        assert!(panics(&endless), "no case was made");
    }
}
