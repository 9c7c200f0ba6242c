//! The room that is put under stress, and the lights in it.

use std::fmt::Write;
use std::path::Path;

use film::Image;
use gather::{Inputs, Integrator, VirtualShape};
use glam::Vec3;
use light_tree::{LightSet, SpotCone, TreeBuilder, VirtualLight};
use scene::trace::Tracer;
use scene::{Emitter, Scene};

/// Geometry, material and view. Lengths are in room units; the default is an ordinary room 4 wide and 3 high.
#[derive(Debug, Clone)]
pub(crate) struct Room {
    /// Every position is multiplied by this …
    pub(crate) scale: f32,
    /// … and then moved by this, in scene units.
    pub(crate) shift: Vec3,
    /// Body of the MTL material of all surfaces.
    pub(crate) material: String,
    /// Triangles beside those of the room.
    pub(crate) more: Vec<[Vec3; 3]>,
    /// How often the file has each triangle.
    pub(crate) copies: usize,
    pub(crate) eye: Vec3,
    pub(crate) target: Vec3,
    /// Full vertical angle, degrees.
    pub(crate) view: f32,
}

impl Default for Room {
    fn default() -> Self {
        Self {
            scale: 1.0,
            shift: Vec3::ZERO,
            material: MATTE.into(),
            more: Vec::new(),
            copies: 1,
            eye: Vec3::new(0.3, 1.5, 3.0),
            target: Vec3::new(0.0, 0.9, -0.5),
            view: 65.0,
        }
    }
}

/// A surface that reflects alike in all directions.
pub(crate) const MATTE: &str = "Kd 0.6 0.5 0.4";

/// Floor, back wall, and a block's top and side that cast shadows.
const QUADS: [[[f32; 3]; 4]; 4] = [
    [
        [-2.0, 0.0, -2.0],
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
    ],
    [
        [-2.0, 0.0, -2.0],
        [2.0, 0.0, -2.0],
        [2.0, 3.0, -2.0],
        [-2.0, 3.0, -2.0],
    ],
    [
        [-0.5, 0.8, -0.5],
        [-0.5, 0.8, 0.5],
        [0.5, 0.8, 0.5],
        [0.5, 0.8, -0.5],
    ],
    [
        [0.5, 0.0, -0.5],
        [0.5, 0.8, -0.5],
        [0.5, 0.8, 0.5],
        [0.5, 0.0, 0.5],
    ],
];

/// Kinds of light, and ways to use them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Points,
    Spots,
    Parallel,
    /// Triangles that emit.
    Panels,
    /// An environment.
    Sky,
    /// Virtual spherical lights.
    Spheres,
    /// Virtual point lights with a clamp.
    Clamped,
    /// Virtual lights as they are traced from points.
    Traced,
    /// All kinds at once.
    Every,
    /// Panels and a sky, met by paths as well.
    Paths,
}

impl Kind {
    pub(crate) const ALL: [Self; 10] = [
        Self::Points,
        Self::Spots,
        Self::Parallel,
        Self::Panels,
        Self::Sky,
        Self::Spheres,
        Self::Clamped,
        Self::Traced,
        Self::Every,
        Self::Paths,
    ];
    /// Those whose lights stand where they are told to.
    pub(crate) const PLACED: [Self; 5] = [
        Self::Points,
        Self::Spots,
        Self::Panels,
        Self::Spheres,
        Self::Clamped,
    ];
}

/// Lights of one kind, or all.
#[derive(Debug, Clone)]
pub(crate) struct Lights {
    pub(crate) kind: Kind,
    /// Where they are, room units; parallel light and the sky have no place.
    pub(crate) places: Vec<Vec3>,
    /// One a place; the first is that of the sky.
    pub(crate) brightness: Vec<f32>,
    /// Of virtual lights, room units.
    pub(crate) radius: f32,
}

impl Lights {
    /// Two dozen of about equal power, scattered about the room.
    pub(crate) fn scattered(kind: Kind) -> Self {
        // The additive recurrence of the plastic number's cube root: even in space, and no random number.
        let places = (1..=24).map(|i| {
            let at = |step: f64| (f64::from(i) * step).fract() as f32;
            Vec3::new(
                3.6 * at(0.819_172_513) - 1.8,
                0.1 + 2.7 * at(0.671_043_607),
                3.6 * at(0.549_700_478) - 1.8,
            )
        });
        Self::at(kind, places.collect())
    }

    /// Lights of about equal power at `places`.
    pub(crate) fn at(kind: Kind, places: Vec<Vec3>) -> Self {
        let brightness = (0..places.len()).map(|i| 0.5 + 0.1 * (i % 7) as f32);
        Self {
            kind,
            brightness: brightness.collect(),
            places,
            radius: 0.2,
        }
    }

    /// The same, `factor` times as bright.
    pub(crate) fn brighter(mut self, factor: f32) -> Self {
        for b in &mut self.brightness {
            *b *= factor;
        }
        self
    }

    fn has(&self, kind: Kind) -> bool {
        let part = |k| k != Kind::Clamped && k != Kind::Traced && k != Kind::Paths;
        match self.kind {
            Kind::Every => part(kind),
            Kind::Paths => matches!(kind, Kind::Panels | Kind::Sky),
            Kind::Clamped => kind == Kind::Spheres,
            Kind::Traced => kind == Kind::Points,
            own => own == kind,
        }
    }

    /// Place and colour of each; of all kinds at once every kind gets some of the places.
    fn of(&self, kind: Kind) -> impl Iterator<Item = (Vec3, Vec3)> {
        let parts = [
            Kind::Points,
            Kind::Spots,
            Kind::Parallel,
            Kind::Panels,
            Kind::Spheres,
        ];
        let own = parts.iter().position(|k| *k == kind).unwrap_or(0);
        let all = self.places.iter().zip(&self.brightness).enumerate();
        let wanted = self.has(kind);
        let shared = self.kind == Kind::Every;
        all.filter(move |(i, _)| wanted && (!shared || i % parts.len() == own))
            .map(|(i, (&place, &bright))| {
                let tint = Vec3::new(1.0, 0.7 + 0.1 * (i % 4) as f32, 0.9 - 0.2 * (i % 3) as f32);
                (place, tint * bright)
            })
    }
}

/// What is rendered.
pub(crate) struct Built {
    pub(crate) scene: Scene,
    pub(crate) tracer: Tracer,
    pub(crate) inputs: Inputs,
    pub(crate) shape: VirtualShape,
    pub(crate) integrator: Integrator,
}

/// Writes the room's files into `folder`, loads them as any scene, and adds the lights.
pub(crate) fn build(room: &Room, lights: &Lights, builder: TreeBuilder, folder: &Path) -> Built {
    write_files(room, lights, folder).expect("a temporary folder takes files");
    let mut scene =
        scene::load::load(&folder.join("scene.ron")).unwrap_or_else(|e| panic!("{room:?}: {e}"));
    // Exactly, where the loader has moved the scene to the origin.
    let origin = scene.origin;
    let place = |p: Vec3| (p * room.scale + room.shift) - origin;
    // The same irradiance at any scale.
    let area = room.scale * room.scale;
    let mut set = vpl::source_lights(&scene);
    for (at, colour) in lights.of(Kind::Points) {
        set.push_point(place(at), colour * area);
    }
    for (at, colour) in lights.of(Kind::Spots) {
        let axis = (Vec3::new(0.1, 0.0, -0.3) - at).normalize_or(Vec3::NEG_Y);
        let cone = SpotCone {
            cos_inner: 0.9,
            cos_outer: 0.6,
        };
        set.push_spot(place(at), axis, colour * area * 2.0, cone);
    }
    for (at, colour) in lights.of(Kind::Parallel).take(4) {
        set.push_directional((-at - Vec3::Y).normalize_or(Vec3::NEG_Y), colour * 0.3);
    }
    if lights.kind == Kind::Traced {
        add_traced(&mut scene, &mut set);
    }
    for (at, colour) in lights.of(Kind::Spheres) {
        set.push_virtual(&VirtualLight {
            position: place(at),
            normal: (Vec3::new(0.0, 1.1, 0.2) - at).normalize_or(Vec3::Y),
            intensity: colour * area,
            gloss: None,
        });
    }
    if lights.kind != Kind::Traced {
        set.set_radius(lights.radius * room.scale);
    }
    let tracer = Tracer::build(&scene);
    Built {
        tracer,
        inputs: Inputs::new(set, builder),
        shape: match lights.kind {
            Kind::Clamped => VirtualShape::ClampedPoint(4.0 / area),
            _ => VirtualShape::Sphere,
        },
        integrator: match lights.kind {
            Kind::Paths => Integrator::Path { max_bounces: 3 },
            _ => Integrator::Direct,
        },
        scene,
    }
}

/// Virtual lights of the set's points, which are the scene's emitters for that.
fn add_traced(scene: &mut Scene, set: &mut LightSet) {
    let emitters = set.ids().map(|id| Emitter::Point {
        position: set.position(id),
        intensity: set.intensity(id),
    });
    scene.emitters.extend(emitters);
    let spec = vpl::VirtualLightSpec {
        count: 100,
        max_bounces: 4,
        seed: 5,
        keep_bounces: false,
    };
    let tracer = Tracer::build(scene);
    vpl::trace(scene, &tracer, &spec, set);
    vpl::set_local_radii(set);
}

fn write_files(room: &Room, lights: &Lights, folder: &Path) -> std::io::Result<()> {
    let place = |p: Vec3| p * room.scale + room.shift;
    let mut obj = String::from("mtllib room.mtl\nusemtl room\n");
    let mut triangle = |corners: [Vec3; 3]| {
        for p in corners.map(place) {
            let _ = writeln!(obj, "v {:e} {:e} {:e}", p.x, p.y, p.z);
        }
        obj.push_str("f -3 -2 -1\n");
    };
    for _ in 0..room.copies {
        for quad in QUADS {
            let [a, b, c, d] = quad.map(Vec3::from);
            triangle([a, b, c]);
            triangle([a, c, d]);
        }
        room.more.iter().copied().for_each(&mut triangle);
    }
    let mut mtl = format!("newmtl room\n{}\n", room.material);
    for (i, (at, colour)) in lights.of(Kind::Panels).take(6).enumerate() {
        let _ = writeln!(obj, "usemtl panel{i}");
        let toward = (Vec3::new(0.0, 1.0, 0.0) - at).normalize_or(Vec3::Y);
        let (t, b) = toward.any_orthonormal_pair();
        for p in [at, at + 0.4 * t, at + 0.3 * b + 0.1 * t].map(place) {
            let _ = writeln!(obj, "v {:e} {:e} {:e}", p.x, p.y, p.z);
        }
        obj.push_str("f -3 -2 -1\n");
        let c = colour * 3.0;
        let _ = writeln!(
            mtl,
            "newmtl panel{i}\n{}\nKe {:e} {:e} {:e}",
            room.material, c.x, c.y, c.z
        );
    }
    let mut listed = vec!["Emissive"];
    if lights.has(Kind::Sky) {
        listed.push("Environment(image: \"sky.exr\")");
        let bright = lights.brightness.first().copied().unwrap_or(1.0);
        let texel = |i: usize| match i {
            5 => Vec3::new(20.0, 18.0, 12.0),
            _ if i < 20 => Vec3::new(0.05 * i as f32, 0.3, 0.5),
            _ => Vec3::ZERO,
        };
        let sky = Image {
            width: 8,
            height: 4,
            pixels: (0..32).map(|i| texel(i) * (0.3 * bright)).collect(),
        };
        sky.write_exr(&folder.join("sky.exr"), &film::Metadata::default())
            .map_err(std::io::Error::other)?;
    }
    let vector = |p: Vec3| format!("({:e}, {:e}, {:e})", p.x, p.y, p.z);
    let scene = format!(
        "(geometry: [\"room.obj\"], lights: [{}], camera: (origin: {}, target: {}, up: (0, 1, 0), fov_y_deg: {:e}))",
        listed.join(", "),
        vector(place(room.eye)),
        vector(place(room.target)),
        room.view,
    );
    std::fs::write(folder.join("room.obj"), obj)?;
    std::fs::write(folder.join("room.mtl"), mtl)?;
    std::fs::write(folder.join("scene.ron"), scene)
}
