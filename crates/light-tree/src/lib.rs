//! Light trees: how one light among millions is found for a point in a few hundred nanoseconds.
//!
//! A [`LightSet`] holds the lights, a [`LightTree`] the hierarchy over them. For a [`Receiver`]
//! (a point with a normal) a [`Cut`] splits the tree into up to N clusters by error bound, and
//! [`LightTree::select`] draws one light from a cluster with a known probability. This crate knows
//! no scene, no material and no visibility.
//!
//! Source: Yuksel, "Stochastic Lightcuts", High-Performance Graphics 2019, and its supplement.

mod bounds;
mod build;
mod cone;
mod conty_kulla;
mod cut;
mod emission;
mod energy_variance;
mod error_bound;
mod light;
mod lights;
mod lobe;
mod order;
mod prefetch;
mod representative;
mod select;
mod shared_cut;
mod splitting;
#[cfg(test)]
mod test_lights;
mod tree;
mod weight;
mod wide;

pub use bounds::{DistanceRange, Receiver};
pub use build::TreeBuilder;
pub use cone::Cone;
pub use cut::Cut;
pub use emission::{Emission, Profile};
pub use energy_variance::EnergyVariance;
pub use error_bound::{ClusterBound, Falloff, Receivers};
pub use light::{
    EnvironmentCell, Gloss, LightId, LightKind, SpotCone, TriangleLight, VirtualLight, luminance,
};
pub use lights::LightSet;
pub use lobe::Lobe;
pub use order::LightOrder;
pub use representative::Representatives;
pub use select::{Chosen, DeadBranch, Selected, Selector};
pub use shared_cut::{Drawn, Draws, SharedCut};
pub use splitting::{Splitter, SplittingRule};
pub use tree::{LightTree, Node, NodeId};
pub use weight::NodeWeights;
pub use wide::{Cluster, WideTree};
