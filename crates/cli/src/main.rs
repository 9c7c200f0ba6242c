//! The manylight command line
fn main() {}
