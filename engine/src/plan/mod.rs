//! What to do in the time that there is: recipes that were measured, what they would take on a clip, and the choice among them.

mod budget;
mod fit;
mod least_squares;
mod record;

pub use budget::{Budget, Chosen, choose};
pub use least_squares::non_negative;
pub use record::{ClipWork, MeasuredRecipe, Named, PRESETS_FORMAT, Preset, Record, RecordedClip};
