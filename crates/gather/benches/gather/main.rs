//! Choosing lights and evaluating them in the built-in nave, and where `MANYLIGHT_SCENES` is set in the paper's scenes.
//!
//!     cargo bench -p manylight-gather
//!     cargo bench -p manylight-gather -- nave

mod evaluate;
#[path = "../../../scene/benches/scene/scenes.rs"]
mod scenes;
mod select;
mod view;

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use scenes::scenes;
use view::View;

fn all(c: &mut Criterion) {
    for place in scenes() {
        let view = View::of(place);
        select::bench(c, &view);
        evaluate::bench(c, &view);
    }
}

/// What takes nanoseconds is known soon.
fn short() -> Criterion {
    Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
}

criterion_group! { name = benches; config = short(); targets = all }
criterion_main!(benches);
