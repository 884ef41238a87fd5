//! Splat clouds as files hold them.
