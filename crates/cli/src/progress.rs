//! What a long command says while it works: a bar on a terminal, plain lines elsewhere, on stderr.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Reports on one command.
pub(crate) struct Progress {
    quiet: bool,
    bar: Option<ProgressBar>,
    /// Share of all samples done, in parts of [`STEPS`].
    done: AtomicU64,
}

/// Resolution of the bar.
const STEPS: u64 = 1 << 20;

impl Progress {
    /// Says nothing when `quiet`.
    pub(crate) fn new(quiet: bool) -> Self {
        Self {
            quiet,
            bar: None,
            done: AtomicU64::new(0),
        }
    }

    /// A line about a finished step.
    pub(crate) fn line(&self, text: &str) {
        if !self.quiet {
            match &self.bar {
                Some(bar) => bar.println(text),
                None => eprintln!("{text}"),
            }
        }
    }

    /// From here on `advance` moves a bar, if there is a terminal to show one.
    pub(crate) fn start_bar(&mut self, what: &str) {
        if self.quiet || !std::io::stderr().is_terminal() {
            return;
        }
        let bar =
            ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr_with_hz(10));
        if let Ok(style) =
            ProgressStyle::with_template("{prefix} [{bar:40}] {percent}% {elapsed} ({eta} left)")
        {
            bar.set_style(style);
        }
        bar.set_prefix(what.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        self.bar = Some(bar);
    }

    /// Adds a share of the whole work, in [0, 1].
    pub(crate) fn advance(&self, share: f64) {
        if let Some(bar) = &self.bar {
            let done = self
                .done
                .fetch_add((share * STEPS as f64) as u64, Ordering::Relaxed);
            bar.set_position(done.min(STEPS));
        }
    }

    /// A line after each pass, where no bar shows it.
    pub(crate) fn pass(&self, text: impl FnOnce() -> String) {
        if !self.quiet && self.bar.is_none() {
            eprintln!("{}", text());
        }
    }

    /// Removes the bar.
    pub(crate) fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}
