//! What lies between the render and the page: what is wished for, and what is there to be seen.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use film::Image;
use scene::CameraSpec;

/// What the page wants to see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wish {
    /// In the scene's coordinates.
    pub(super) camera: CameraSpec,
    /// Number in the list of methods.
    pub(super) method: usize,
}

/// A picture to be seen.
#[derive(Debug)]
pub(super) struct Shown {
    /// Number of the wish that it is of.
    pub(super) wish: u64,
    pub(super) image: Image,
    /// Samples a pixel.
    pub(super) spp: u32,
    /// Of so many.
    pub(super) of: u32,
    pub(super) seconds: f64,
    /// Error against the reference, where there is one of this view.
    pub(super) relmse: Option<f64>,
}

#[derive(Debug)]
struct State {
    wish: Wish,
    /// Of the wish, from 1.
    number: u64,
    /// Number of the picture, from 1, and the picture.
    shown: (u64, Option<Arc<Shown>>),
}

/// Wishes go one way and pictures the other.
#[derive(Debug)]
pub(super) struct Desk {
    state: Mutex<State>,
    wished: Condvar,
    stop: AtomicBool,
}

impl Desk {
    pub(super) fn new(wish: Wish) -> Self {
        Self {
            state: Mutex::new(State {
                wish,
                number: 1,
                shown: (0, None),
            }),
            wished: Condvar::new(),
            stop: AtomicBool::new(false),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Each change of the state is one assignment, so it is sound even if a thread died.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Set while a wish waits to be looked at.
    pub(super) fn stop(&self) -> &AtomicBool {
        &self.stop
    }

    /// Changes what is wished for and returns the number of the wish.
    pub(super) fn wish(&self, change: impl FnOnce(&mut Wish)) -> u64 {
        let mut state = self.state();
        let mut wish = state.wish;
        change(&mut wish);
        if wish != state.wish {
            state.wish = wish;
            state.number += 1;
            self.stop.store(true, Ordering::Relaxed);
            self.wished.notify_all();
        }
        state.number
    }

    /// The newest wish and its number, once that is not `last`.
    pub(super) fn next_wish(&self, last: u64) -> (u64, Wish) {
        let state = self.state();
        let state = self.wished.wait_while(state, |state| state.number == last);
        let state = state.unwrap_or_else(PoisonError::into_inner);
        self.stop.store(false, Ordering::Relaxed);
        (state.number, state.wish)
    }

    /// Puts a picture where the page finds it.
    pub(super) fn show(&self, shown: Shown) {
        let mut state = self.state();
        state.shown = (state.shown.0 + 1, Some(Arc::new(shown)));
    }

    /// The newest picture and its number, if that is above `last`.
    pub(super) fn newer_than(&self, last: u64) -> Option<(u64, Arc<Shown>)> {
        let state = self.state();
        let (number, shown) = &state.shown;
        let shown = shown.as_ref().filter(|_| *number > last)?;
        Some((*number, Arc::clone(shown)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wish() -> Wish {
        Wish {
            camera: CameraSpec::default(),
            method: 0,
        }
    }

    #[test]
    fn a_wish_stops_what_is_under_way_until_it_is_looked_at() {
        let desk = Desk::new(wish());
        assert_eq!(desk.next_wish(0), (1, wish()), "the first is there at once");
        assert_eq!(desk.wish(|_| ()), 1, "no change is no new wish");
        assert!(!desk.stop().load(Ordering::Relaxed), "nor a reason to stop");
        assert_eq!(desk.wish(|w| w.method = 3), 2, "a new one");
        assert!(desk.stop().load(Ordering::Relaxed), "stop");
        assert_eq!(desk.wish(|w| w.method = 4), 3, "the next");
        assert_eq!(desk.next_wish(1).1.method, 4, "only the newest counts");
        assert!(!desk.stop().load(Ordering::Relaxed), "go on");
    }

    #[test]
    fn a_picture_is_handed_out_to_whoever_has_not_seen_it() {
        let desk = Desk::new(wish());
        assert!(desk.newer_than(0).is_none(), "nothing yet");
        for spp in 1..3 {
            desk.show(Shown {
                wish: 1,
                image: Image {
                    width: 1,
                    height: 1,
                    pixels: vec![glam::Vec3::ZERO],
                },
                spp,
                of: 2,
                seconds: 0.0,
                relmse: None,
            });
        }
        let (number, shown) = desk.newer_than(0).expect("a picture");
        assert_eq!((number, shown.spp), (2, 2), "the newest");
        assert!(desk.newer_than(2).is_none(), "seen");
    }
}
