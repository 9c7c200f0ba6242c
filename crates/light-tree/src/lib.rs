//! Light trees, cuts and hierarchical importance sampling; knows no scene and no material
