//! What to do in the time that there is: recipes that were measured, what they would take on a clip, and the choice among them.

mod budget;
mod fit;
mod least_squares;
mod record;
mod usual;
mod work;

pub use budget::{Budget, Chosen, choose};
pub use least_squares::non_negative;
pub use record::{MeasuredRecipe, Named, PRESETS_FORMAT, Preset, Record, RecordedClip};
pub use usual::{REFINER, usual};
pub use work::ClipWork;
