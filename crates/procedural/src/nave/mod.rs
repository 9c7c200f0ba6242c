//! A domed church in the manner of Šibenik cathedral, drawn from scratch.
//!
//! Each module makes parts in their own frame; this one stands them in place. [`plan`] holds
//! the measurements. The 120 lamps hang inside the dome, so everything west of the first bay or
//! so is lit by light that has been reflected at least once.

mod apse;
mod columns;
mod crossing;
mod dome;
mod floor;
mod furniture;
mod plan;
mod vaults;
mod walls;
mod west;
mod windows;

use crate::SceneFile;
use crate::lights;
use crate::materials;
use crate::materials::Material;
use crate::mesh::{Mesh, at, upright};
use crate::obj;
use crate::sweep::{arch_band, xy};
use crate::textures;
use columns::Seen;
use glam::{DVec2, DVec3};
use plan::{
    AISLE, APSE, BAY, BAYS, CHOIR_EAST, CHOIR_FLOOR, CHOIR_WEST, CROSSING, HALF, HIGH_RISE,
    HIGH_SPRING, LOW_RISE, LOW_SPRING, NAVE_EAST, OUTER, WALL, WALL_TOP, WEST,
};
use vaults::Vault;
use walls::Behind;

/// Warm white, per lamp, in W/sr.
const LAMP: [f64; 3] = [12.0, 11.0, 9.4];

const SCENE: &str = "(
    geometry: [\"scene.obj\"],
    metres_per_unit: 1.0,
    camera: (
        origin: (-15.3, 2.0, 0.7),
        target: (0.0, 4.75, -0.2),
        up: (0.0, 1.0, 0.0),
        fov_y_deg: 57.0,
    ),
    lights: [Points(\"lights.ron\")],
)
";

/// The scene's files; see [`crate::files`].
pub(crate) fn files() -> Vec<SceneFile> {
    let file = |name: &str, bytes: Vec<u8>| SceneFile {
        name: name.to_owned(),
        bytes,
    };
    // Painting takes as long as building, and the two have nothing in common.
    let (textures, geometry) = std::thread::scope(|scope| {
        let painting = scope.spawn(textures::all);
        let geometry = obj::write(&building(), "scene.mtl");
        (painting.join().expect("painting cannot fail"), geometry)
    });
    let mut files = vec![
        file("scene.ron", SCENE.as_bytes().to_vec()),
        file("scene.obj", geometry),
        file("scene.mtl", materials::mtl()),
        file("lights.ron", lights::ron(&lamps(), LAMP)),
    ];
    files.extend(textures.into_iter().map(|png| file(png.name, png.bytes)));
    files
}

/// Positions of the 120 lamps.
fn lamps() -> Vec<DVec3> {
    lights::positions(&dome::lamps(xy(CROSSING, 0.0)))
}

/// The whole building in world coordinates.
fn building() -> Mesh {
    let mut mesh = Mesh::default();
    nave(&mut mesh);
    aisles(&mut mesh);
    crossing(&mut mesh);
    transepts(&mut mesh);
    choir(&mut mesh);
    mesh.merge(west::front());
    mesh.merge(floor::floor());
    furnish(&mut mesh);
    mesh
}

/// Middle of nave bay `k`, from the west.
fn bay_middle(k: usize) -> f64 {
    WEST + BAY * (k as f64 + 0.5)
}

/// Frame of the wall at z = `side` × `distance`, facing the axis.
fn facing_axis(x: f64, side: f64, distance: f64) -> glam::DAffine3 {
    upright(DVec3::new(x, 0.0, side * distance), xy(-side, 0.0))
}

fn nave(mesh: &mut Mesh) {
    let vault = Vault {
        half_x: BAY / 2.0,
        half_z: HALF + 0.03,
        rise: HIGH_RISE,
        steps: 9,
    };
    let (web, transverse) = (vault.mesh(), vault.transverse());
    let wall = walls::high_bay(BAY, Behind::Aisle);
    let (pier, shafts) = (columns::pier(), columns::vault_shafts(LOW_SPRING));
    for k in 0..BAYS {
        mesh.append(&web, &at(bay_middle(k), HIGH_SPRING, 0.0));
        for side in [-1.0, 1.0] {
            mesh.append(&wall, &facing_axis(bay_middle(k), side, HALF));
        }
    }
    for k in 0..=BAYS {
        let x = WEST + BAY * k as f64;
        if k < BAYS {
            mesh.append(&transverse, &at(x, HIGH_SPRING, 0.0));
        }
        for side in [-1.0, 1.0] {
            let mut standing = Mesh::default();
            standing.append(&pier, &at(x, 0.0, side * (HALF + WALL / 2.0)));
            // The first and the last stand half in the walls behind them.
            standing.bury(|p| p.x < WEST - 0.01 || p.x > NAVE_EAST + 0.01);
            mesh.merge(standing);
            if k < BAYS {
                mesh.append(&shafts, &facing_axis(x, side, HALF));
            }
        }
    }
}

fn aisles(mesh: &mut Mesh) {
    let middle = HALF + WALL + AISLE / 2.0;
    let vault = Vault {
        half_x: BAY / 2.0,
        half_z: AISLE / 2.0 + 0.03,
        rise: LOW_RISE,
        steps: 7,
    };
    let (web, transverse) = (vault.mesh(), vault.transverse());
    let wall = walls::aisle_wall(BAY, LOW_SPRING + LOW_RISE + 0.6);
    let respond = columns::shaft(0.2, 0.46, LOW_SPRING, Seen::Front);
    for side in [-1.0, 1.0] {
        for k in 0..BAYS {
            mesh.append(&web, &at(bay_middle(k), LOW_SPRING, side * middle));
            mesh.append(&wall, &facing_axis(bay_middle(k), side, OUTER));
        }
        for k in 0..=BAYS {
            let x = WEST + BAY * k as f64;
            mesh.append(&transverse, &at(x, LOW_SPRING, side * middle));
            mesh.append(&respond, &facing_axis(x, side, OUTER));
        }
    }
}

fn crossing(mesh: &mut Mesh) {
    let arch = crossing::arch();
    let centre = DVec3::new(CROSSING, 0.0, 0.0);
    let reach = HALF + WALL / 2.0;
    // Each arch's far face (local +z) looks to the crossing.
    for out in [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y] {
        let place = upright(
            centre + DVec3::new(out.x, 0.0, out.y) * reach,
            xy(-out.y, out.x),
        );
        mesh.append(&arch, &place);
        mesh.append(&crossing::diaphragm(-WALL / 2.0), &place);
    }
    for (x, z) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        mesh.append(
            &crossing::pier(-x, -z),
            &at(CROSSING + x * reach, 0.0, z * reach),
        );
    }
    mesh.append(&crossing::pendentives(), &at(CROSSING, 0.0, 0.0));
    mesh.append(&dome::dome(), &at(CROSSING, 0.0, 0.0));
}

fn transepts(mesh: &mut Mesh) {
    let middle = HALF + WALL + AISLE / 2.0;
    let vault = Vault {
        half_x: HALF + 0.03,
        half_z: AISLE / 2.0 + 0.03,
        rise: HIGH_RISE,
        steps: 9,
    };
    let web = vault.mesh();
    let passage = crate::arch::Arch::pointed(AISLE / 2.0 - 0.35, 2.3);
    let orders = vec![
        xy(0.0, -WALL),
        xy(-0.12, -WALL + 0.12),
        xy(-0.12, -0.12),
        xy(0.0, 0.0),
    ];
    let band = arch_band(
        Material::Limestone,
        passage,
        LOW_SPRING,
        &orders,
        plan::ARCH_STEPS,
    );
    let west = crossing::end_wall(AISLE / 2.0 + 0.1, WALL_TOP, Some((passage, LOW_SPRING)));
    // A chapel niche: the same opening with a wall behind it.
    let mut east = west.clone();
    east.append(&band, &at(0.0, LOW_SPRING, 0.0));
    east.append(
        &crossing::end_wall(AISLE / 2.0 + 0.1, HIGH_SPRING, None),
        &at(0.0, 0.0, -WALL),
    );
    let end = west::transept_end();
    for side in [-1.0, 1.0] {
        mesh.append(&web, &at(CROSSING, HIGH_SPRING, side * middle));
        mesh.append(&end, &facing_axis(CROSSING, side, OUTER));
        let wall_at =
            |x: f64, facing: f64| upright(DVec3::new(x, 0.0, side * middle), xy(0.0, -facing));
        let inner = wall_at(CROSSING - HALF, 1.0);
        mesh.append(&west, &inner);
        mesh.append(&band, &(inner * at(0.0, LOW_SPRING, 0.0)));
        mesh.append(&west, &wall_at(NAVE_EAST, -1.0));
        mesh.append(&east, &wall_at(CROSSING + HALF, -1.0));
        let corner = columns::shaft(0.14, 0.0, HIGH_SPRING, Seen::Round);
        for x in [-HALF, HALF] {
            for z in [OUTER, HALF + WALL] {
                let mut standing = Mesh::default();
                standing.append(&corner, &at(CROSSING + x, 0.0, side * z));
                standing.bury(|p| (p.x - CROSSING).abs() > HALF + 0.01 || p.z.abs() > OUTER + 0.01);
                mesh.merge(standing);
            }
        }
    }
}

fn choir(mesh: &mut Mesh) {
    let length = CHOIR_EAST - CHOIR_WEST;
    let middle = (CHOIR_EAST + CHOIR_WEST) / 2.0;
    let vault = Vault {
        half_x: length / 2.0,
        half_z: HALF + 0.03,
        rise: HIGH_RISE,
        steps: 9,
    };
    mesh.append(&vault.mesh(), &at(middle, HIGH_SPRING, 0.0));
    let wall = walls::high_bay(length, Behind::Niche);
    for side in [-1.0, 1.0] {
        mesh.append(&wall, &facing_axis(middle, side, HALF));
        for x in [CHOIR_WEST, CHOIR_EAST] {
            mesh.append(
                &columns::shaft(0.13, CHOIR_FLOOR, HIGH_SPRING, Seen::Round),
                &at(x, 0.0, side * HALF),
            );
        }
    }
    let place = upright(DVec3::new(CHOIR_EAST + WALL / 2.0, 0.0, 0.0), xy(0.0, -1.0));
    mesh.append(&crossing::arch(), &place);
    mesh.append(&crossing::diaphragm(-WALL / 2.0), &place);
    mesh.append(&apse::apse(), &at(APSE, 0.0, 0.0));
}

fn furnish(mesh: &mut Mesh) {
    let bench = furniture::bench(1.55);
    for k in 0..6 {
        let x = -10.3 + 1.2 * f64::from(k);
        for side in [-1.0, 1.0] {
            mesh.append(&bench, &at(x, 0.0, side * 2.62));
        }
    }
    mesh.merge(furniture::altar());
    for side in [-1.0, 1.0] {
        let stick = furniture::candlestick(1.7);
        mesh.append(&stick, &at(CHOIR_WEST + 2.6, CHOIR_FLOOR, side * 2.2));
        mesh.append(&stick, &at(APSE - 0.7, CHOIR_FLOOR + 0.15, side * 1.75));
    }
    mesh.append(
        &furniture::pulpit(),
        &at(CROSSING - HALF + 0.3, 0.0, -HALF + 1.35),
    );
}
