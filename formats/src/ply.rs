//! Splat clouds as PLY files.
