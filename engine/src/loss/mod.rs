//! The rendering loss: value and gradient by the rendered images.
