//! The gather renderer: a pixel is a set of gather points, a scene is a set of lights, a method decides
//! which pairs are worth evaluating.
//!
//! [`render`](render::Render) sends eye paths through each pixel, hands every [`GatherPoint`] to the chosen
//! method, and adds up the light that the method's choices bring. The contribution of one light to one
//! point, visibility included, is the same code for every method.

mod contribution;
pub mod method;
mod plan;
mod point;
mod render;
mod shadow_queue;
mod vsl;

pub use contribution::VirtualShape;
pub use method::{Method, MethodSpec};
pub use plan::Plan;
pub use point::GatherPoint;
pub use render::{Counters, Pass, Phase, Render, RenderSpec, Seconds, Shard};
pub use shadow_queue::{LightEval, ShadowQueue};

use std::sync::OnceLock;

use light_tree::{LightSet, LightTree, TreeBuilder};

/// What methods choose from: the lights, and a tree over them that is built when first asked for.
#[derive(Debug)]
pub struct Inputs {
    /// All lights in use.
    pub lights: LightSet,
    builder: TreeBuilder,
    tree: OnceLock<Option<LightTree>>,
}

impl Inputs {
    /// Inputs over `lights`; no tree yet, and one by `builder` when it is asked for.
    pub fn new(lights: LightSet, builder: TreeBuilder) -> Self {
        Self {
            lights,
            builder,
            tree: OnceLock::new(),
        }
    }

    /// The tree; `None` when there is no light.
    pub fn tree(&self) -> Option<&LightTree> {
        self.tree
            .get_or_init(|| LightTree::build(&self.lights, self.builder))
            .as_ref()
    }

    /// The tree if some method asked for it.
    pub fn built_tree(&self) -> Option<&LightTree> {
        self.tree.get()?.as_ref()
    }
}
