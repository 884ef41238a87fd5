//! Figures of rendered views.
