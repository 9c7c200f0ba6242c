//! What many renders add up to.
//!
//! An experiment is a matrix: scenes × light sets × methods × budgets × seeds. Each [`Cell`] is one render and
//! its figures; a [`Results`] holds all of them, with the machine and the references they were measured
//! against, and is written as tables, plots and a page. Nothing here renders, and nothing here knows a method.

mod animation;
mod browser;
mod cell;
mod error;
mod page;
mod plot;
mod reference;
mod results;
pub mod statistics;
pub mod store;
mod strips;
mod summary;
mod table;
#[cfg(test)]
mod test_results;

pub use animation::{Flickering, write_animations};
pub use browser::{COLOURS, HalfFloats, STYLE, filled};
pub use cell::{Cell, Coordinates, Error, Figures, Outcome, Pass, Phases, Seconds};
pub use error::ExperimentError;
pub use page::write_page;
pub use plot::{Plot, write_plots};
pub use reference::Reference;
pub use results::{Machine, Results, SceneView, Series};
pub use store::Store;
pub use strips::{Strip, write_strips};
pub use summary::{summary, write_summary};
pub use table::{write_csv, write_json};
