// A drawn image and the true one.
struct Pair {
    // Width, height, columns and rows of window centres.
    size: vec4<u32>,
    // Weights over counts: of the colours' absolute errors, the similarities, the depths' errors; what a wrong depth counts as in a residual.
    slopes: vec4<f32>,
    // First sum of the view.
    first: vec4<u32>,
}

