//! What a run leaves behind for programs and for people: figures, pictures, a page.

mod colour_maps;
mod html;
mod maps;
mod metrics;
mod moving;
mod pictures;

pub use html::{Page, PageView, html};
pub use maps::maps_in_words;
pub use metrics::{
    BudgetRecord, Config, FIGURES, FigureKind, METRICS_FORMAT, Metrics, NUM_FULL_IMAGE, RoleMeans, ViewRecord,
    role_name,
};
pub use moving::{MOVING_SPEED, MovingShares, percent};
pub use pictures::{Picture, PictureKind, ScoreKind};
