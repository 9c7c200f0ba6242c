//! Built-in procedural scenes
