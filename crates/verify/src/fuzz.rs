//! Damaged inputs, many of them, for whatever reads files.
//!
//! Inputs are good ones with a few changes: bytes, numbers and pieces that are other, missing or doubled. They are a
//! function of (name, number), so that a failure can be had again without keeping its bytes.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Nothing here takes a second: what takes this long hangs.
const HANGS_AFTER: Duration = Duration::from_secs(30);

/// Numbers that readers stumble over.
const NUMBERS: [&str; 16] = [
    "0",
    "-1",
    "-0",
    "1e39",
    "-1e39",
    "1e-46",
    "NaN",
    "inf",
    "2147483648",
    "4294967295",
    "4294967296",
    "18446744073709551616",
    "0.1",
    "1e15",
    "1e400",
    "007",
];

/// Words of four bytes that lengths and offsets stumble over.
const WORDS: [u32; 10] = [
    0,
    1,
    0xFF,
    0xFFFF,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFF,
    0xFFFF_FFF0,
    0x0100_0000,
    0x3F80_0000,
];

/// What is damaged, and how it is watched.
pub struct Fuzz<'a> {
    /// Names the inputs: another name gives others.
    pub name: &'a str,
    /// Good inputs, at least one.
    pub seeds: Vec<Vec<u8>>,
    /// Pieces of text that are put in here and there.
    pub words: &'a [&'a str],
    /// Makes damage reach beyond a check sum, in every other input.
    pub repair: fn(&mut [u8]),
    /// Greatest number of bytes allocated at once since the last call.
    pub peak: &'a dyn Fn() -> usize,
    /// No input may need more bytes at once.
    pub most_bytes: usize,
}

/// What became of the inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Inputs tried.
    pub inputs: u64,
    /// Inputs that were good all the same.
    pub accepted: u64,
    /// Seconds that the slowest took.
    pub slowest: f64,
    /// Greatest number of bytes allocated at once.
    pub peak: usize,
}

/// SplitMix64, Steele et al. 2014.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In 0..n; 0 for n = 0.
    fn below(&mut self, n: usize) -> usize {
        (self.next() % (n as u64).max(1)) as usize
    }

    fn of<'t, T>(&mut self, items: &'t [T]) -> &'t T {
        &items[self.below(items.len())]
    }
}

impl Fuzz<'_> {
    /// Gives `inputs` inputs to `attempt`, which says whether it could use one.
    ///
    /// # Panics
    /// At the end, when an attempt panicked or needed more memory than allowed, with the numbers of the first such
    /// inputs and where their bytes are. An attempt that hangs ends the process, likewise.
    pub fn run(&self, inputs: u64, attempt: impl Fn(&[u8]) -> bool) -> Outcome {
        let watch = Watch::new(self.name);
        let mut outcome = Outcome {
            inputs,
            accepted: 0,
            slowest: 0.0,
            peak: 0,
        };
        let mut failures = Vec::new();
        for number in 0..inputs {
            let bytes = self.input(number);
            watch.begin(number, &bytes);
            (self.peak)();
            let started = Instant::now();
            let result = catch_unwind(AssertUnwindSafe(|| attempt(&bytes)));
            outcome.slowest = outcome.slowest.max(started.elapsed().as_secs_f64());
            let peak = (self.peak)();
            outcome.peak = outcome.peak.max(peak);
            match result {
                Ok(accepted) => outcome.accepted += u64::from(accepted),
                Err(_) => failures.push((number, "panicked".to_owned())),
            }
            if peak > self.most_bytes {
                failures.push((number, format!("took {peak} bytes")));
            }
        }
        watch.end();
        let told: Vec<String> = failures
            .iter()
            .take(10)
            .map(|(number, what)| {
                let kept = keep(self.name, *number, &self.input(*number));
                format!("input {number} {what}: {}", kept.display())
            })
            .collect();
        assert!(
            failures.is_empty(),
            "{}: {} of {inputs} inputs failed:\n{}",
            self.name,
            failures.len(),
            told.join("\n")
        );
        outcome
    }

    /// The input of that number.
    pub fn input(&self, number: u64) -> Vec<u8> {
        let name = self.name.bytes().fold(0u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        let mut random = Random(name ^ number.wrapping_mul(0xd134_2543_de82_ef95));
        let mut bytes = random.of(&self.seeds).clone();
        for _ in 0..=random.below(4) {
            self.damage(&mut bytes, &mut random);
        }
        if random.below(2) == 0 {
            (self.repair)(&mut bytes);
        }
        bytes
    }

    fn damage(&self, bytes: &mut Vec<u8>, random: &mut Random) {
        let at = random.below(bytes.len());
        let piece = at..(at + 1 + random.below(16)).min(bytes.len());
        match random.below(11) {
            _ if bytes.is_empty() => bytes.push(random.next() as u8),
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.next() as u8,
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(piece)),
            4 => {
                let copy = bytes[piece].to_vec();
                let to = random.below(bytes.len());
                drop(bytes.splice(to..to, copy));
            }
            5 => {
                let other = random.of(&self.seeds);
                let from = random.below(other.len());
                let end = (from + 1 + random.below(64)).min(other.len());
                let found = other.get(from..end).unwrap_or(&[]).to_vec();
                drop(bytes.splice(piece, found));
            }
            6 => {
                let word = random.of(&WORDS).to_le_bytes();
                let end = (at + 4).min(bytes.len());
                bytes[at..end].copy_from_slice(&word[..end - at]);
            }
            7 | 8 => {
                let number = number_near(bytes, at);
                drop(bytes.splice(number, random.of(&NUMBERS).bytes()));
            }
            9 if !self.words.is_empty() => {
                let word = random.of(self.words);
                drop(bytes.splice(at..at, word.bytes()));
            }
            _ => {
                // A piece many times over: lists without end, and depth.
                let copy = bytes[piece].repeat(1 << random.below(10));
                drop(bytes.splice(at..at, copy));
            }
        }
    }
}

/// The digits, with sign, point and exponent, at `at` or behind it.
fn number_near(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    let is_part = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
    let first = bytes[at..].iter().position(u8::is_ascii_digit);
    let start = at + first.unwrap_or(0);
    let length = bytes[start..].iter().take_while(|b| is_part(b)).count();
    start..start + length
}

/// Where an input that failed is kept.
fn place(name: &str, number: u64) -> PathBuf {
    std::env::temp_dir().join(format!("fuzz-{name}-{number}"))
}

/// Writes an input down and says where.
fn keep(name: &str, number: u64, bytes: &[u8]) -> PathBuf {
    let path = place(name, number);
    // The number is enough to have it again.
    let _ = std::fs::write(&path, bytes);
    path
}

/// The input under way: when it was begun, its number, and its bytes.
type Now = Option<(Instant, u64, Vec<u8>)>;

/// Ends the process when an input takes too long.
struct Watch {
    now: Arc<Mutex<Now>>,
}

impl Watch {
    fn new(name: &str) -> Self {
        let now = Arc::new(Mutex::new(Now::None));
        let (seen, name) = (Arc::downgrade(&now), name.to_owned());
        std::thread::spawn(move || {
            while let Some(now) = seen.upgrade() {
                if let Ok(Some((begun, number, bytes))) = now.lock().as_deref()
                    && begun.elapsed() > HANGS_AFTER
                {
                    let kept = keep(&name, *number, bytes);
                    eprintln!("{name}: input {number} hangs: {}", kept.display());
                    std::process::abort();
                }
                drop(now);
                std::thread::sleep(Duration::from_secs(1));
            }
        });
        Self { now }
    }

    fn begin(&self, number: u64, bytes: &[u8]) {
        if let Ok(mut now) = self.now.lock() {
            *now = Some((Instant::now(), number, bytes.to_vec()));
        }
    }

    fn end(&self) {
        if let Ok(mut now) = self.now.lock() {
            *now = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fuzz<'a>(name: &'a str, peak: &'a dyn Fn() -> usize) -> Fuzz<'a> {
        Fuzz {
            name,
            seeds: vec![b"(width: 12, height: 7)".to_vec(), b"(a)".to_vec()],
            words: &["NaN", "(("],
            repair: |_| (),
            peak,
            most_bytes: 100,
        }
    }

    #[test]
    fn inputs_are_a_function_of_name_and_number_and_most_differ() {
        let peak = || 0;
        let (one, two) = (fuzz("one", &peak), fuzz("two", &peak));
        let mut all: Vec<_> = (0..1000).map(|i| one.input(i)).collect();
        let again: Vec<_> = (0..1000).map(|i| one.input(i)).collect();
        let others: Vec<_> = (0..1000).map(|i| two.input(i)).collect();
        assert_eq!(all, again, "the same name");
        assert_ne!(all, others, "another name");
        all.sort();
        all.dedup();
        assert!(all.len() > 700, "only {} different ones", all.len());
    }

    #[test]
    fn a_panic_and_too_much_memory_are_found() {
        let silent = |what: &dyn Fn()| catch_unwind(AssertUnwindSafe(what)).is_err();
        let little = || 0;
        let found = silent(&|| {
            fuzz("panic", &little).run(2000, |bytes| {
                assert!(!bytes.windows(2).any(|w| w == b"(("), "two brackets");
                true
            });
        });
        assert!(found, "a panic");
        let much = || 101;
        let found = silent(&|| {
            fuzz("memory", &much).run(1, |_| true);
        });
        assert!(found, "memory");
        // They look like failures of real readers to who finds them later.
        let kept = (0..2000).map(|number| place("panic", number));
        for path in kept.chain([place("memory", 0)]).filter(|p| p.exists()) {
            std::fs::remove_file(path).expect("removes");
        }
        let outcome = fuzz("sound", &little).run(500, |bytes| bytes.starts_with(b"("));
        assert!(
            outcome.accepted > 100 && outcome.accepted < 500,
            "{outcome:?}"
        );
    }
}
