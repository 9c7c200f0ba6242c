//! The conditions that the room and its lights are put under.

use glam::Vec3;
use light_tree::TreeBuilder;

use crate::room::{Kind, Lights, Room};

/// What is known beforehand of the picture that all lights give.
#[derive(Debug, Clone)]
pub(crate) enum Expected {
    /// Only what the double-precision twin says, where there is one.
    Nothing,
    /// Every method gives the ordinary picture times this power of two, to the bit.
    SameBits(f32),
    /// Its mean is that of other lights in another room, times `factor`, but for `within` of it.
    Mean {
        of: Box<(Room, Lights)>,
        factor: f64,
        within: f64,
    },
    /// It is black.
    Black,
}

/// One condition with one kind of light.
#[derive(Debug, Clone)]
pub(crate) struct Case {
    /// Row of the table.
    pub(crate) group: &'static str,
    pub(crate) name: String,
    pub(crate) room: Room,
    pub(crate) lights: Lights,
    pub(crate) builder: TreeBuilder,
    /// Columns and rows of the picture, samples a pixel.
    pub(crate) size: [u32; 3],
    pub(crate) expected: Expected,
    /// How far the mean may be from that in double precision, relative.
    pub(crate) rounding: f64,
}

/// Cases of one group.
struct Group<'a> {
    name: &'static str,
    cases: &'a mut Vec<Case>,
}

impl Group<'_> {
    fn add(&mut self, name: impl Into<String>, room: &Room, lights: Lights) -> &mut Case {
        self.cases.push(Case {
            group: self.name,
            name: name.into(),
            room: room.clone(),
            lights,
            builder: TreeBuilder::Binned,
            size: [16, 12, 16],
            expected: Expected::Nothing,
            rounding: 2e-4,
        });
        self.cases.last_mut().expect("one was added")
    }
}

/// Every case, or for `quick` those with few lights and three kinds of light.
pub(crate) fn all(quick: bool) -> Vec<Case> {
    let mut cases = Vec::new();
    scales(&mut cases);
    offsets(&mut cases);
    intensities(&mut cases);
    places(&mut cases);
    counts(&mut cases, quick);
    radii(&mut cases);
    triangles(&mut cases);
    views(&mut cases);
    materials(&mut cases);
    if quick {
        cases.retain(|c| matches!(c.lights.kind, Kind::Points | Kind::Every | Kind::Paths));
    }
    cases
}

fn group<'a>(cases: &'a mut Vec<Case>, name: &'static str) -> Group<'a> {
    Group { name, cases }
}

fn as_ordinary(kind: Kind, factor: f64, within: f64) -> Expected {
    Expected::Mean {
        of: Box::new((Room::default(), Lights::scattered(kind))),
        factor,
        within,
    }
}

fn scales(cases: &mut Vec<Case>) {
    for kind in Kind::ALL {
        let mut scaled = |name: &'static str, scale: f32, expected| {
            let room = Room {
                scale,
                ..Room::default()
            };
            let mut group = group(cases, name);
            group
                .add(format!("{scale:e}"), &room, Lights::scattered(kind))
                .expected = expected;
        };
        scaled("scale 1", 1.0, Expected::Nothing);
        for exponent in [-20, 20] {
            scaled(
                "scale 2^-20, 2^20",
                2.0f32.powi(exponent),
                Expected::SameBits(1.0),
            );
        }
        // Traced paths branch on rounding: a few of a hundred lights are others.
        let within = if kind == Kind::Traced { 0.1 } else { 1e-2 };
        for scale in [1e-6, 1e-3, 1e3, 1e6] {
            scaled("scale 1e-6 to 1e6", scale, as_ordinary(kind, 1.0, within));
        }
        // Near the ends of what the loader accepts.
        for scale in [1e-9, 2e11] {
            scaled("scale 1e-9 and 2e11", scale, as_ordinary(kind, 1.0, within));
        }
    }
}

fn offsets(cases: &mut Vec<Case>) {
    for kind in Kind::ALL {
        for (name, scale, far, rounding) in [
            // One unit in the last place of a coordinate is 6e-5 of the room's width …
            ("1e6 units off, room 1000 wide", 250.0, 1e6, 1e-3),
            // … and 2 % of it: another room, but rendered as well as the first.
            ("1e6 units off, room 4 wide", 1.0, 1e6, 1e-2),
        ] {
            for direction in [Vec3::X, Vec3::new(1.0, -1.0, 1.0)] {
                let room = Room {
                    scale,
                    shift: direction * far,
                    ..Room::default()
                };
                let lights = Lights::scattered(kind);
                let mut group = group(cases, name);
                group.add(format!("{direction}"), &room, lights).rounding = rounding;
            }
        }
    }
}

fn intensities(cases: &mut Vec<Case>) {
    let room = Room::default();
    for kind in Kind::ALL {
        for exponent in [-40, 40] {
            let factor = 2.0f32.powi(exponent);
            let lights = Lights::scattered(kind).brighter(factor);
            let mut group = group(cases, "intensity 2^-40, 2^40");
            group.add(format!("2^{exponent}"), &room, lights).expected = Expected::SameBits(factor);
        }
        for factor in [1e-30f32, 1e-10, 1e10, 1e30] {
            let lights = Lights::scattered(kind).brighter(factor);
            let within = if kind == Kind::Traced { 0.1 } else { 1e-2 };
            let mut group = group(cases, "intensity 1e-30 to 1e30");
            group.add(format!("{factor:e}"), &room, lights).expected =
                as_ordinary(kind, f64::from(factor), within);
        }
        let mut mixed = Lights::scattered(kind);
        let last = mixed.brightness.len() - 1;
        for (i, b) in mixed.brightness.iter_mut().enumerate() {
            *b = 10.0f32.powf(-30.0 + 60.0 * i as f32 / last as f32);
        }
        group(cases, "intensities over 60 decades").add("mixed", &room, mixed);
    }
}

fn places(cases: &mut Vec<Case>) {
    let room = Room::default();
    let on = |f: &dyn Fn(f32) -> Vec3| (0..24).map(|i| f(i as f32 / 24.0)).collect::<Vec<_>>();
    let sets = [
        (
            "lights on surfaces",
            "floor",
            on(&|t| Vec3::new(3.0 * t - 1.5, 0.0, 1.0 - t)),
        ),
        (
            "lights on surfaces",
            "wall",
            on(&|t| Vec3::new(3.0 * t - 1.5, 0.3 + t, -2.0)),
        ),
        (
            "lights on surfaces",
            "block",
            on(&|t| Vec3::new(t - 0.5, 0.8, t - 0.5)),
        ),
        (
            "lights in corners",
            "edge of floor and wall",
            on(&|t| Vec3::new(4.0 * t - 2.0, 0.0, -2.0)),
        ),
        (
            "lights in corners",
            "corner",
            vec![Vec3::new(-2.0, 0.0, -2.0); 3],
        ),
        (
            "lights in corners",
            "a hair from it",
            on(&|t| Vec3::new(t * 1e-5, t * 1e-6, -2.0 + t * 1e-5)),
        ),
        (
            "lights on a line",
            "upright",
            on(&|t| Vec3::new(0.7, 0.2 + 2.0 * t, 0.9)),
        ),
        (
            "lights on a line",
            "slanting",
            on(&|t| Vec3::new(-1.5 + 3.0 * t, 0.3 + t, 1.5 - t)),
        ),
        (
            "lights in a plane",
            "parallel to the floor",
            on(&|t| Vec3::new(3.0 * t - 1.5, 1.5, (t * 7.7).fract() * 3.0 - 1.5)),
        ),
        (
            "lights in a plane",
            "that of the block's top",
            on(&|t| Vec3::new(0.7 + t, 0.8, (t * 7.7).fract() * 3.0 - 1.5)),
        ),
        (
            "coincident lights",
            "two",
            vec![Vec3::new(-1.0, 1.7, 0.8); 2],
        ),
        (
            "coincident lights",
            "two places",
            [[-1.0, 1.7, 0.8], [1.2, 0.9, 1.0]]
                .repeat(12)
                .into_iter()
                .map(Vec3::from)
                .collect(),
        ),
        (
            "a chain of lights, each half as far",
            "toward the corner",
            (0..60)
                .map(|i| Vec3::new(-2.0, 0.0, -2.0) + Vec3::new(1.0, 0.7, 1.1) * 0.5f32.powi(i))
                .collect(),
        ),
        (
            "a chain of lights, each half as far",
            "toward the origin",
            (0..100)
                .map(|i| Vec3::new(1.0, 0.7, 1.1) * 0.5f32.powi(i))
                .collect(),
        ),
    ];
    for kind in Kind::PLACED {
        for (name, what, places) in &sets {
            for builder in [
                TreeBuilder::Binned,
                TreeBuilder::Agglomerative,
                TreeBuilder::Morton,
            ] {
                let lights = Lights::at(kind, places.clone());
                let mut group = group(cases, name);
                let case = group.add(format!("{what}, {builder:?}"), &room, lights);
                case.builder = builder;
                case.rounding = 5e-2;
            }
        }
        // The view is so narrow that all that is seen lies within the light's height above the floor, or nearly.
        for height in [1e-1f32, 1e-3, 1e-5, 1e-7, 0.0] {
            let seen = Vec3::new(0.9, 0.0, 1.1);
            let near = Room {
                target: seen,
                view: height.clamp(1e-5, 1.0) * 5.0,
                ..Room::default()
            };
            let lights = Lights::at(kind, vec![seen + Vec3::Y * height; 3]);
            let mut group = group(cases, "lights on the shading point");
            // The offset of the point off the floor is 4e-6: light that is lower is below it.
            let case = group.add(format!("{height:e} above"), &near, lights);
            case.rounding = if height > 1e-4 { 2e-2 } else { f64::INFINITY };
        }
    }
}

fn counts(cases: &mut Vec<Case>, quick: bool) {
    let room = Room::default();
    for kind in Kind::ALL {
        let mut none = Lights::scattered(kind);
        none.brightness.fill(0.0);
        group(cases, "lights without power")
            .add("all", &room, none)
            .expected = Expected::Black;
        let mut some = Lights::scattered(kind);
        for b in some.brightness.iter_mut().step_by(2) {
            *b = 0.0;
        }
        group(cases, "lights without power").add("every other", &room, some);
    }
    let place = Vec3::new(0.9, 1.8, 0.7);
    for kind in Kind::PLACED {
        for n in [1, 2] {
            let lights = Lights::at(kind, vec![place; n]);
            group(cases, "one light, two lights").add(format!("{n}"), &room, lights);
        }
    }
    if quick {
        return;
    }
    for kind in [Kind::Points, Kind::Spots, Kind::Spheres, Kind::Clamped] {
        let n = 1 << 20;
        let mut many = Lights::at(kind, vec![place; n]);
        many.brightness.fill(1.0 / n as f32);
        // Of a million lights twelve colours come about: one of each stands for all of it.
        let mut few = Lights::at(kind, vec![place; 12]);
        few.brightness.fill(1.0 / 12.0);
        let mut group = group(cases, "a million coincident lights");
        let case = group.add("one place", &room, many);
        case.size = [8, 6, 1];
        case.expected = Expected::Mean {
            of: Box::new((room.clone(), few)),
            factor: 1.0,
            // Points of spheres that a horizon cuts are drawn.
            within: 1e-3,
        };
        case.rounding = f64::INFINITY;
    }
}

fn radii(cases: &mut Vec<Case>) {
    let room = Room::default();
    for kind in [Kind::Spheres, Kind::Every] {
        for radius in [0.0, 1e-30, 1e-20, 1e-10, 1e-3, 1.0, 10.0, 1e5, 1e10, 1e18] {
            let lights = Lights {
                radius,
                ..Lights::scattered(kind)
            };
            group(cases, "radius 0 to 1e18").add(format!("{radius:e}"), &room, lights);
        }
    }
}

fn triangles(cases: &mut Vec<Case>) {
    let sliver = |y: f32| {
        [
            Vec3::new(-2.0, y, 0.3),
            Vec3::new(2.0, y, 0.3),
            Vec3::new(2.0, y, 0.3 + 4e-7),
        ]
    };
    for kind in Kind::ALL {
        let mut with = |name: &'static str, what: &str, more: Vec<[Vec3; 3]>, copies, expected| {
            let room = Room {
                more,
                copies,
                ..Room::default()
            };
            let mut group = group(cases, name);
            let case = group.add(what, &room, Lights::scattered(kind));
            case.expected = expected;
            // Rays start off a triangle by 4e-6 of its greatest coordinate: off the ground by 4000.
            if what == "ground" {
                case.rounding = 2e-2;
            }
        };
        let slivers = (1..30).map(|i| sliver(0.1 * i as f32)).collect();
        // Their shadows are 4e-7 wide.
        let within = if kind == Kind::Traced { 0.1 } else { 1e-2 };
        with(
            "triangles 1e7 times as long as high",
            "shelves",
            slivers,
            1,
            as_ordinary(kind, 1.0, within),
        );
        let p = Vec3::new(0.3, 0.4, 0.5);
        let flat = vec![[p; 3], [p, p, Vec3::ONE], [Vec3::ZERO, p, 2.0 * p]];
        with(
            "degenerate and repeated triangles",
            "degenerate",
            flat,
            1,
            Expected::SameBits(1.0),
        );
        with(
            "degenerate and repeated triangles",
            "thrice",
            Vec::new(),
            3,
            Expected::SameBits(1.0),
        );
        // The floor and the wall again, cut along the other diagonal, and a part of it once more.
        let coplanar = vec![
            [[-2.0, 0.0, -2.0], [-2.0, 0.0, 2.0], [2.0, 0.0, -2.0]],
            [[2.0, 0.0, 2.0], [-2.0, 0.0, 2.0], [2.0, 0.0, -2.0]],
            [[-1.0, 0.0, -1.0], [-1.0, 0.0, 1.5], [1.7, 0.0, -1.0]],
            [[-1.0, 0.0, -2.0], [1.0, 2.0, -2.0], [1.7, 0.0, -2.0]],
        ];
        let coplanar = coplanar.into_iter().map(|t| t.map(Vec3::from)).collect();
        with(
            "coplanar triangles",
            "floor and wall",
            coplanar,
            1,
            as_ordinary(kind, 1.0, within),
        );
        let huge = vec![[
            Vec3::new(-1e9, -1.0, -1e9),
            Vec3::new(1e9, -1.0, -1e9),
            Vec3::new(0.0, -1.0, 1e9),
        ]];
        with(
            "triangles 1e9 wide beside those of the room",
            "ground",
            huge,
            1,
            Expected::Nothing,
        );
    }
}

fn views(cases: &mut Vec<Case>) {
    for kind in Kind::ALL {
        for (name, what, eye, target) in [
            (
                "grazing view",
                "1e-2 above the floor",
                [0.0, 1e-2, 2.0],
                [0.1, 0.0, -1.9],
            ),
            (
                "grazing view",
                "1e-5 above the floor",
                [0.0, 1e-5, 2.0],
                [0.1, 0.0, -1.9],
            ),
            (
                "grazing view",
                "along the wall",
                [-1.9, 1.0, -2.0 + 1e-5],
                [2.0, 1.1, -2.0],
            ),
            (
                "camera in a wall",
                "in the floor",
                [0.9, 0.0, 1.2],
                [0.0, 1.0, -2.0],
            ),
            (
                "camera in a wall",
                "in the wall",
                [0.1, 1.0, -2.0],
                [0.3, 0.4, 1.0],
            ),
            (
                "camera in a wall",
                "inside the block",
                [0.1, 0.4, 0.1],
                [0.3, 0.4, 1.0],
            ),
            (
                "camera in a wall",
                "in a corner",
                [-2.0, 0.0, -2.0],
                [0.3, 0.4, 0.1],
            ),
            (
                "camera in a wall",
                "on a light",
                [-1.0, 0.5, 1.0],
                [0.3, 0.4, 0.1],
            ),
        ] {
            let room = Room {
                eye: eye.into(),
                target: target.into(),
                ..Room::default()
            };
            let mut lights = Lights::scattered(kind);
            if what == "on a light" {
                lights.places[0] = room.eye;
            }
            let case = &mut group(cases, name);
            case.add(what, &room, lights).rounding = match name {
                "grazing view" => 1e-2,
                // A ray that starts in a wall may or may not meet it.
                _ => f64::INFINITY,
            };
        }
    }
}

fn materials(cases: &mut Vec<Case>) {
    for kind in Kind::ALL {
        let mut of = |name: &'static str, what: &str, material: &str, expected| {
            let room = Room {
                material: material.into(),
                ..Room::default()
            };
            let mut group = group(cases, name);
            let case = group.add(what, &room, Lights::scattered(kind));
            case.expected = expected;
        };
        for roughness in [0.0, 1e-6, 0.03, 0.1, 0.5, 1.0] {
            for metal in [0, 1] {
                let text = format!("Kd 0.6 0.5 0.4\nPr {roughness}\nPm {metal}");
                of(
                    "roughness 0 to 1",
                    &format!("{roughness}, metal {metal}"),
                    &text,
                    Expected::Nothing,
                );
            }
        }
        for (what, text) in [
            ("Phong 0", "Kd 0.3 0.3 0.3\nKs 0.5 0.5 0.5\nNs 0"),
            ("Phong 1e6", "Kd 0.3 0.3 0.3\nKs 0.5 0.5 0.5\nNs 1000000"),
        ] {
            of("roughness 0 to 1", what, text, Expected::Nothing);
        }
        let lit_directly = !matches!(kind, Kind::Panels | Kind::Sky | Kind::Every | Kind::Paths);
        let black = if lit_directly {
            Expected::Black
        } else {
            Expected::Nothing
        };
        of("albedo 0 and 1", "0", "Kd 0 0 0", black);
        of("albedo 0 and 1", "1", "Kd 1 1 1", Expected::Nothing);
        of(
            "albedo 0 and 1",
            "1, all of it specular",
            "Kd 0 0 0\nKs 1 1 1\nNs 100",
            Expected::Nothing,
        );
    }
}
