#![doc = include_str!("../README.md")]

mod block;
mod bounds;
mod build;
mod collapse;
mod cone;
mod conty_kulla;
mod cut;
mod cuts;
mod descent;
mod draws;
mod emission;
mod energy_variance;
mod error_bound;
mod fill;
mod light;
mod lights;
mod lobe;
mod opening;
mod order;
mod packed;
mod pair_lanes;
mod prefetch;
mod region;
mod representative;
mod select;
mod shared_cut;
mod splitting;
#[cfg(test)]
mod test_lights;
mod tree;
mod weight;
mod wide;
mod yuksel2019;

pub use block::Cluster;
pub use bounds::{DistanceRange, Receiver};
pub use build::TreeBuilder;
pub use cone::Cone;
pub use cut::Cut;
pub use cuts::Cuts;
pub use descent::{Descents, Drawn};
pub use draws::Draws;
pub use emission::{Emission, Profile};
pub use energy_variance::EnergyVariance;
pub use error_bound::{ClusterBound, Falloff, Receivers};
pub use light::{
    EnvironmentCell, Gloss, LightId, LightKind, SpotCone, TriangleLight, VirtualLight, luminance,
};
pub use lights::LightSet;
pub use lobe::Lobe;
pub use order::LightOrder;
pub use region::Region;
pub use representative::Representatives;
pub use select::{Chosen, DeadBranch, Selected, Start};
pub use shared_cut::SharedCut;
pub use splitting::{Splitter, SplittingRule};
pub use tree::{Directions, LightTree, Node, NodeId};
pub use weight::NodeWeights;
pub use wide::WideTree;
