//! What lights cost by their number: the trees, the weights of nodes, cuts, and draws.
//!
//!     cargo bench -p manylight-light-tree                    # all sizes: up to ten minutes
//!     cargo bench -p manylight-light-tree -- '/100000$'      # one of them

mod build;
mod hall;
mod select;
mod shared_cut;

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use hall::Hall;

const COUNTS: [usize; 6] = [100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000];

fn lights(c: &mut Criterion) {
    for count in COUNTS {
        let hall = Hall::of(count);
        build::bench(c, &hall);
        select::bench(c, &hall);
        shared_cut::bench(c, &hall);
    }
}

/// There are many sizes, and what takes nanoseconds is known soon.
fn short() -> Criterion {
    Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
}

criterion_group! { name = benches; config = short(); targets = lights }
criterion_main!(benches);
