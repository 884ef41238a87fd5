//! From a clip directory to a scene, its views and their figures: the stages in their order.
//!
//! What is held out cannot leak: [`begin`] takes [`Inputs`], which hold views and sweeps of input frames only, and
//! [`Session::held_out`] reads the images of held-out frames after the scene is final.

mod evaluate;
mod hold_out;
mod inputs;
mod memory;
mod network;
mod optimise;
mod prune;
mod reconstruct;
mod run;
mod session;
mod stages;
#[cfg(test)]
mod tests;

pub use evaluate::{Drawing, Figures, RenderedView, evaluate_views};
pub use hold_out::HoldOut;
pub use inputs::Inputs;
pub(crate) use memory::check_memory;
pub use memory::{MemorySettings, Need, check_refinement};
pub use network::{NetworkRun, NetworkSettings, NetworkSummary, UpdateSkipped, run_network};
pub use prune::Pruning;
pub use reconstruct::{Begun, GaussianCounts, Reconstruction, begin};
pub use run::{Deadline, Marks, Run};
pub use session::{Opening, Session};
pub use stages::{PointStep, Progress, Silent, Stage, StageTimes, Watch};
