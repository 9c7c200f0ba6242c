//! Random streams, warps and discrete distributions for rendering
