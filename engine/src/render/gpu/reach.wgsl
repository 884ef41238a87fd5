// The tiles that a footprint's ellipse reaches, row of tiles by row of tiles, as `tiles.rs` visits them.

struct Reached {
    // Centre, shear, curve along the row.
    first: vec4<f32>,
    // Curve across the rows, log2 of the opacity, depth, half height.
    second: vec4<f32>,
    // Colour, half width.
    third: vec4<f32>,
    // `-1 / curve` along the row, height at which it is widest.
    fourth: vec4<f32>,
}

// First and last index of the pixels whose centres lie in `low..=high`; the first is the greater where there is none.
fn pixel_span(low: f32, high: f32, size: u32) -> vec2<i32> {
    let first = max(ceil(low - 0.5), 0.0);
    let last = min(floor(high - 0.5), f32(size) - 1.0);
    if (!(first <= last)) {
        return vec2<i32>(1, 0);
    }
    return vec2<i32>(i32(first), i32(last));
}

fn tile_rows(f: Reached, size: vec4<u32>) -> vec2<i32> {
    let rows = pixel_span(f.first.y - f.second.w, f.first.y + f.second.w, size.y);
    if (rows.x > rows.y) {
        return rows;
    }
    return rows / i32(TILE_HEIGHT);
}

fn edge(f: Reached, widest: f32, top: f32, bottom: f32, side: f32) -> f32 {
    let dy = min(max(widest, top), bottom);
    let room = f.second.y - LOG2_ALPHA_MIN + f.second.x * dy * dy;
    let half = sqrt(max(room, 0.0) * f.fourth.x);
    return f.first.x + f.first.z * dy + side * (half + 1e-3 + 1e-5 * f.third.w);
}

fn tile_columns(f: Reached, size: vec4<u32>, row: i32, rows: vec2<i32>) -> vec2<i32> {
    var left = f.first.x - f.third.w;
    var right = f.first.x + f.third.w;
    if (rows.x != rows.y) {
        let first = f32(row * i32(TILE_HEIGHT)) + 0.5 - f.first.y;
        let top = max(first, -f.second.w);
        let bottom = min(first + f32(TILE_HEIGHT - 1u), f.second.w);
        left = edge(f, -f.fourth.y, top, bottom, -1.0);
        right = edge(f, f.fourth.y, top, bottom, 1.0);
    }
    let columns = pixel_span(left, right, size.x);
    if (columns.x > columns.y) {
        return columns;
    }
    return columns / i32(TILE_WIDTH);
}
