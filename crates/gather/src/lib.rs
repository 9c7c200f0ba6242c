//! The gather renderer: a pixel is a set of gather points, a scene is a set of lights, a method decides
//! which pairs are worth evaluating.
//!
//! [`render`](render::Render) sends eye paths through each pixel, hands every [`GatherPoint`] to the chosen
//! method, and adds up the light that the method's choices bring. The contribution of one light to one
//! point, visibility included, is the same code for every method.
//!
//! ```
//! use light_tree::{LightSet, TreeBuilder};
//! use manylight_gather::{
//!     Inputs, Integrator, MethodSpec, Render, RenderSpec, Shard, VirtualShape,
//! };
//! use scene::trace::Tracer;
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("scene.ron");
//! # std::fs::write(folder.path().join("floor.obj"), "v -5 0 -5\nv -5 0 5\nv 5 0 5\nv 5 0 -5\nf 1 2 3 4\n")?;
//! # std::fs::write(&path, "(
//! #     geometry: [\"floor.obj\"],
//! #     camera: (origin: (0, 3, 8), target: (0, 0, 0), up: (0, 1, 0), fov_y_deg: 45.0),
//! #     lights: [Point(position: (0, 2, 0), intensity: (4, 4, 4))],
//! # )")?;
//! let scene = scene::load::load(&path)?;
//! let tracer = Tracer::build(&scene);
//! let mut lights = LightSet::default();
//! lights.push_point(glam::Vec3::new(0.0, 2.0, 0.0), glam::Vec3::splat(4.0));
//! let inputs = Inputs::new(lights, TreeBuilder::Binned);
//! let method = MethodSpec::default();
//! let spec = RenderSpec {
//!     width: 32,
//!     height: 18,
//!     spp: 4,
//!     seed: 1,
//!     shape: VirtualShape::Sphere,
//!     integrator: Integrator::Direct,
//!     shard: Shard::ALL,
//! };
//! let mut render = Render::new(&scene, &tracer, &inputs, &method, spec);
//! while render.pass(&|_| {}).is_some() {}
//! let middle = render.picture().radiance[9 * 32 + 16];
//! assert!(middle.x > 0.1, "the lamp lights the floor: {middle}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod compensation;
mod contribution;
mod counters;
mod error_bound;
mod gather_tree;
mod learned;
mod lobe_lanes;
pub mod method;
mod path;
mod plan;
mod point;
mod render;
mod sender;
mod shadow_queue;
mod side_by_side;
mod sphere;
mod tile_points;
mod vsl;
mod weight;
mod width;

pub use contribution::VirtualShape;
pub use counters::{Counters, Phase, Seconds};
pub use method::{Method, MethodSpec};
pub use path::Integrator;
pub use plan::{BOUNCES, Plan};
pub use point::GatherPoint;
pub use render::{Pass, Render, RenderSpec, Shard};
pub use shadow_queue::{Gathered, LightEval, QueueScratch, SampleSum, Seen, ShadowQueue};
pub use side_by_side::LightSample;
pub use tile_points::{Centre, TilePoints};

use std::borrow::Cow;
use std::sync::OnceLock;

use light_tree::{
    Directions, EnergyVariance, LightKind, LightOrder, LightSet, LightTree, NodeWeights,
    Representatives, TreeBuilder, WideTree,
};

/// A tree for methods that let one light stand for others of its kind.
#[derive(Debug)]
struct Clusters {
    /// None where the common tree keeps kinds apart as it is.
    tree: Option<LightTree>,
    representatives: Representatives,
}

/// What methods choose from: the lights, and a tree over them that is built when first asked for.
#[derive(Debug)]
pub struct Inputs {
    /// All lights in use.
    pub lights: LightSet,
    builder: TreeBuilder,
    tree: OnceLock<Option<LightTree>>,
    /// The same without directions.
    bare_tree: OnceLock<Option<LightTree>>,
    wide_tree: OnceLock<Option<WideTree>>,
    clusters: OnceLock<Option<Clusters>>,
    light_order: OnceLock<Option<LightOrder>>,
    energy_variance: OnceLock<Option<EnergyVariance>>,
}

impl Inputs {
    /// Inputs over `lights`; no tree yet, and one by `builder` when it is asked for.
    pub fn new(lights: LightSet, builder: TreeBuilder) -> Self {
        Self {
            lights,
            builder,
            tree: OnceLock::new(),
            bare_tree: OnceLock::new(),
            wide_tree: OnceLock::new(),
            clusters: OnceLock::new(),
            light_order: OnceLock::new(),
            energy_variance: OnceLock::new(),
        }
    }

    /// The tree, where lights point included; `None` when there is no light.
    pub fn tree(&self) -> Option<&LightTree> {
        self.tree
            .get_or_init(|| LightTree::build(&self.lights, self.builder))
            .as_ref()
    }

    /// A tree for methods that only weigh by `weights`: without directions where these do not look at them, unless [`tree`](Self::tree) is
    /// there already. `None` when there is no light.
    pub fn tree_for(&self, weights: NodeWeights) -> Option<&LightTree> {
        let directions = weights.directions();
        if directions == Directions::Kept || self.tree.get().is_some() {
            return self.tree();
        }
        self.bare_tree
            .get_or_init(|| LightTree::build_with(&self.lights, self.builder, directions))
            .as_ref()
    }

    /// The eight-way form of the tree; `None` when there is no light. The tree that it was is kept only if something else
    /// has asked for it.
    pub fn wide_tree(&self) -> Option<&WideTree> {
        let collapse = || {
            let tree = match self.tree.get() {
                Some(tree) => tree.as_ref().map(Cow::Borrowed),
                None => LightTree::build(&self.lights, self.builder).map(Cow::Owned),
            };
            tree.map(|tree| WideTree::collapse(&tree, &self.lights))
        };
        self.wide_tree.get_or_init(collapse).as_ref()
    }

    /// The eight-way form of the tree if some method asked for it.
    pub fn built_wide_tree(&self) -> Option<&WideTree> {
        self.wide_tree.get()?.as_ref()
    }

    /// Nodes and depth of the tree that was built, two-way if there is one; `None` when no method asked for any.
    pub fn tree_size(&self) -> Option<(usize, u32)> {
        let tree = self.built_tree().map(|t| (t.node_count(), t.depth()));
        tree.or_else(|| self.built_wide_tree().map(|t| (t.node_count(), t.depth())))
    }

    /// How much the lights below each node of [`tree`](Self::tree) differ; `None` when there is no light.
    pub fn energy_variance(&self) -> Option<&EnergyVariance> {
        self.energy_variance
            .get_or_init(|| self.tree().map(EnergyVariance::of))
            .as_ref()
    }

    /// A tree that keeps kinds of light apart, with a light that stands for each cluster; `None` when there is
    /// no light.
    pub fn clusters(&self) -> Option<(&LightTree, &Representatives)> {
        let clusters = self.clusters.get_or_init(|| self.choose()).as_ref()?;
        let tree = clusters.tree.as_ref().or_else(|| self.tree())?;
        Some((tree, &clusters.representatives))
    }

    /// The lights in the order of the tree of [`clusters`](Self::clusters); `None` when there is no light.
    pub fn light_order(&self) -> Option<&LightOrder> {
        let order = || Some(LightOrder::of(self.clusters()?.0, &self.lights));
        self.light_order.get_or_init(order).as_ref()
    }

    fn choose(&self) -> Option<Clusters> {
        let kinds = |distant| {
            let alike = LightKind::ALL.iter().filter(|k| k.is_distant() == distant);
            alike.filter(|k| self.lights.count(**k) > 0).count()
        };
        let tree = if kinds(false) > 1 || kinds(true) > 1 {
            LightTree::build_by_kind(&self.lights, self.builder)
        } else {
            None
        };
        // The same for every render, so that two methods see the same clusters.
        let seed = 0;
        let over = tree.as_ref().or_else(|| self.tree())?;
        let representatives = Representatives::choose(over, &self.lights, seed);
        Some(Clusters {
            tree,
            representatives,
        })
    }

    /// The tree if some method asked for it.
    pub fn built_tree(&self) -> Option<&LightTree> {
        let common = self.tree.get().or_else(|| self.bare_tree.get());
        let common = common.and_then(Option::as_ref);
        common.or_else(|| self.clusters.get()?.as_ref()?.tree.as_ref())
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use light_tree::VirtualLight;

    use super::*;

    #[test]
    fn directions_are_kept_only_for_weights_that_look_at_them() {
        let inputs = || {
            let mut lights = LightSet::default();
            for i in 0..9u8 {
                lights.push_virtual(&VirtualLight {
                    position: Vec3::splat(f32::from(i)),
                    normal: Vec3::Y,
                    intensity: Vec3::ONE,
                    gloss: None,
                });
            }
            Inputs::new(lights, TreeBuilder::Binned)
        };
        let at = |tree: Option<&LightTree>| tree.map(std::ptr::from_ref);
        let (blind, seeing) = (NodeWeights::Yuksel2019, NodeWeights::MinMax);
        let alone = inputs();
        let bare = alone.tree_for(blind).expect("has lights").bytes();
        assert!(alone.tree.get().is_none(), "no other tree");
        assert_eq!(at(alone.built_tree()), at(alone.tree_for(blind)), "counted");
        let full = alone.tree_for(seeing).expect("has lights").bytes();
        assert!(bare < full, "{bare} and {full} bytes");
        // Whoever comes later uses what is there.
        let shared = inputs();
        let full = at(shared.tree());
        assert_eq!(at(shared.tree_for(blind)), full, "no second tree");
        assert!(shared.bare_tree.get().is_none(), "no second tree");
    }
}
