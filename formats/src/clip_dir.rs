//! Clip directories: `clip.json` and the files beside it.
