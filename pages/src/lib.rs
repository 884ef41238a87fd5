//! What pages and plots are made of: HTML, SVG, CSV, numbers as people read them. It knows nothing of what they show.

mod charts;
mod csv;
mod html;
mod plot;
mod text;

pub use charts::{Curve, CurvesFrame, Range, curves, histogram, scatter};
pub use csv::{csv, csv_rows};
pub use html::{document, escape, section, table};
pub use plot::{Axis, FRAME, Mapping, Plot, Scale};
pub use text::{count, number, or_dash, ranges, thousands};
