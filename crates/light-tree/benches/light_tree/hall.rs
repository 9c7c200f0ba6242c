//! Virtual lights on the inner walls of a hall of 40 × 15 × 20, and points there that are to be lit.

use std::cell::OnceCell;

use glam::Vec3;
use manylight_light_tree::{
    LightSet, LightTree, Lobe, Receiver, TreeBuilder, VirtualLight, WideTree,
};
use sampling::{Purpose, Rng};

const SIZE: Vec3 = Vec3::new(40.0, 15.0, 20.0);
/// Points that take turns: more than the nearest cache holds the way to.
const POINTS: usize = 1 << 14;
/// Edge of what a tile sees of a wall.
const TILE: f32 = 0.5;

/// The hall; what a filter on the command line leaves out is not made.
pub(crate) struct Hall {
    pub(crate) count: usize,
    lights: OnceCell<LightSet>,
    tree: OnceCell<LightTree>,
    wide_tree: OnceCell<WideTree>,
}

impl Hall {
    pub(crate) fn of(count: usize) -> Self {
        Self {
            count,
            lights: OnceCell::new(),
            tree: OnceCell::new(),
            wide_tree: OnceCell::new(),
        }
    }

    pub(crate) fn lights(&self) -> &LightSet {
        self.lights.get_or_init(|| {
            let mut rng = Rng::new(1, 0, 0, Purpose::Build);
            let mut set = LightSet::default();
            for _ in 0..self.count {
                let (position, normal) = on_walls(&mut rng);
                let intensity = Vec3::splat(0.5 + rng.f32());
                set.push_virtual(&VirtualLight {
                    position,
                    normal,
                    intensity,
                    gloss: None,
                });
            }
            set
        })
    }

    pub(crate) fn tree(&self) -> &LightTree {
        let build = || LightTree::build(self.lights(), TreeBuilder::Binned).expect("has lights");
        self.tree.get_or_init(build)
    }

    pub(crate) fn wide_tree(&self) -> &WideTree {
        let collapse = || WideTree::collapse(self.tree(), self.lights());
        self.wide_tree.get_or_init(collapse)
    }
}

/// A point on the walls, and the normal there.
fn on_walls(rng: &mut Rng) -> (Vec3, Vec3) {
    let axis = (rng.f32() * 3.0) as usize;
    let mut position = Vec3::new(rng.f32(), rng.f32(), rng.f32()) * SIZE;
    let far = rng.f32() < 0.5;
    position[axis] = if far { SIZE[axis] } else { 0.0 };
    let mut normal = Vec3::ZERO;
    normal[axis] = if far { -1.0 } else { 1.0 };
    (position, normal)
}

/// Points all over the walls.
pub(crate) fn receivers() -> Vec<Receiver> {
    let mut rng = Rng::new(2, 0, 0, Purpose::Build);
    (0..POINTS).map(|_| receiver(on_walls(&mut rng))).collect()
}

/// The same points, glossy and seen from straight above.
pub(crate) fn glossy_receivers() -> Vec<Receiver> {
    let mut rng = Rng::new(2, 0, 0, Purpose::Build);
    let mut glossy = || {
        let (position, normal) = on_walls(&mut rng);
        receiver((position, normal)).with_lobe(Lobe {
            axis: normal,
            diffuse: 0.1,
            near: 0.25,
            far: 0.0,
            far_sin2: 1.0,
            alpha2: 0.01,
        })
    };
    (0..POINTS).map(|_| glossy()).collect()
}

fn receiver((position, normal): (Vec3, Vec3)) -> Receiver {
    Receiver::new(position + normal * 0.01, normal)
}

/// `N` points near each other on the floor, as a tile of a picture sees them.
pub(crate) fn tile<const N: usize>(rng: &mut Rng) -> [Receiver; N] {
    let corner = Vec3::new(rng.f32(), 0.0, rng.f32()) * (SIZE - TILE);
    [(); N].map(|()| {
        let place = corner + Vec3::new(rng.f32(), 0.0, rng.f32()) * TILE;
        receiver((place.with_y(0.0), Vec3::Y))
    })
}
