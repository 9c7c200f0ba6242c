//! Made-up results for the tests of tables, plots and the page.

use film::Image;
use glam::Vec3;

use crate::{
    Cell, Coordinates, Error, Figures, Machine, Outcome, Pass, Phases, Reference, Results,
    SceneView, Seconds,
};

/// A grey ramp, from nearly black to `brightest`.
pub(crate) fn image(brightest: f32) -> Image {
    Image {
        width: 32,
        height: 18,
        pixels: (0..32 * 18)
            .map(|i| Vec3::splat(brightest * (i as f32 + 1.0) / 576.0))
            .collect(),
    }
}

/// Two methods, of which one failed in one of two scenes.
pub(crate) fn results() -> Results {
    Results {
        name: "made-up".into(),
        title: "Two methods, made up".into(),
        about: "Figures for tests: nobody rendered them.".into(),
        quick: false,
        machine: Machine {
            cpu: "A <fast> processor, of 1 \"GHz\"".into(),
            threads: 2,
            version: "0.1.0".into(),
            commit: "abc".into(),
        },
        scenes: vec![SceneView {
            name: "room".into(),
            crops: vec![[0.25, 0.25, 0.5, 0.5]],
        }],
        references: vec![Reference {
            key: "ref".into(),
            scene: "room".into(),
            lights: "lamps".into(),
            frame: 0,
            method: "AllLights".into(),
            under_test: false,
            seed: 99,
            spp: 1024,
            seconds: 60.0,
            standard_error: 0.004,
            asked: 0.005,
            version: "0.1.0".into(),
            commit: "abc".into(),
        }],
        cells: vec![
            cell("room", "one", 1, 1.0),
            cell("room", "two", 1, 0.25),
            Cell {
                outcome: Outcome::Failed("there is, \"again\", no scene".into()),
                ..cell("hall", "one", 1, 1.0)
            },
        ],
        animations: Vec::new(),
    }
}

/// A cell whose `relmse` is `error` over samples, at a million rays a second.
pub(crate) fn cell(scene: &str, method: &str, seed: u64, error: f64) -> Cell {
    let pass = |spp: u32| Pass {
        spp,
        seconds: 0.5 * f64::from(spp),
        cpu_seconds: Some(f64::from(spp)),
        shadow_rays: u64::from(spp) * 500_000,
        relmse: Some(error / f64::from(spp)),
        mse: Some(2.0 * error / f64::from(spp)),
    };
    Cell {
        coordinates: Coordinates {
            scene: scene.into(),
            lights: "lamps".into(),
            method: method.into(),
            tree: String::new(),
            budget: "4 spp".into(),
            seed,
            frame: 0,
        },
        settings: format!("{method}(cut: 3)"),
        outcome: Outcome::Done(Box::new(Figures {
            key: format!("{scene}-{method}-{seed}"),
            reference: "ref".into(),
            unbiased: true,
            width: 32,
            height: 18,
            spp: 4,
            light_count: 120,
            triangles: 22,
            seconds: Seconds {
                load: 0.25,
                bvh: 0.125,
                lights: 0.5,
                tree: 0.0625,
                render: 2.0,
            },
            cpu_seconds: Some(4.0),
            phases: Phases {
                eye: 0.5,
                cut: 0.5,
                select: 1.0,
                evaluate: 0.5,
                shadow: 1.5,
            },
            camera_rays: 2304,
            shadow_rays: 2_000_000,
            light_samples: 23_040,
            nonfinite: 0,
            peak_rss_bytes: None,
            error: Error {
                mse: Some(0.5 * error),
                rmse: Some(0.75),
                relmse: Some(0.25 * error),
                mape: Some(0.5),
                hdr_flip: Some(0.25),
                flip: Some(0.125),
                mean_ratio: Some(1.0),
                bias: Some(0.001),
                bias_95: Some(0.002),
                local_bias: None,
                local_bias_95: None,
            },
            passes: vec![pass(1), pass(2), pass(4)],
        })),
    }
}
