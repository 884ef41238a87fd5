// Adam on raw parameters that stay on the GPU: their physical values, and a step from the gradients by these.

struct Step {
    // Gaussians, those of the LiDAR branch.
    size: vec4<u32>,
    // First decay, 1 less it, second decay, 1 less it.
    decays: vec4<f32>,
    // What is added to the root, slope of the speed.
    more: vec4<f32>,
    // Rates of the 17 variables.
    rates: array<vec4<f32>, 5>,
}

@group(0) @binding(0) var<uniform> told: Step;
@group(0) @binding(1) var<storage, read_write> raw: array<f32>; // [N, VARIABLES]
@group(0) @binding(2) var<storage, read> times: array<f32>;
@group(0) @binding(3) var<storage, read_write> shapes: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> looks: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> gradients: array<f32>; // [N, ROW]
@group(0) @binding(6) var<storage, read_write> first: array<f32>; // [N, VARIABLES]
@group(0) @binding(7) var<storage, read_write> second: array<f32>;
@group(0) @binding(8) var<storage, read_write> sums: array<vec2<f32>>; // speed, spoiled gradients of each group
@group(0) @binding(9) var<storage, read_write> counts: array<u32>; // [N] steps that moved it
@group(0) @binding(10) var<storage, read> paces: array<vec2<f32>>; // of each such step, what the moments are multiplied by

var<workgroup> parts: array<vec2<f32>, 256>;

fn is_finite(value: f32) -> bool {
    return (bitcast<u32>(value) & 0x7f800000u) != 0x7f800000u;
}

// The built-in one may be off by many ulps. What is not a number stays so.
fn exact_exp(x: f32) -> f32 {
    if ((bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u) {
        return x;
    }
    let inside = clamp(x, -87.0, 88.0);
    let n = round(inside * 1.44269504);
    let r = fma(n, -1.42860677e-6, fma(n, -0.693145752, inside));
    var p = 1.0 / 5040.0;
    p = fma(p, r, 1.0 / 720.0);
    p = fma(p, r, 1.0 / 120.0);
    p = fma(p, r, 1.0 / 24.0);
    p = fma(p, r, 1.0 / 6.0);
    p = fma(p, r, 0.5);
    p = fma(p, r, 1.0);
    p = fma(p, r, 1.0);
    return p * bitcast<f32>(u32(i32(n) + 127) << 23u);
}

fn sigmoid(x: f32) -> f32 {
    let small = exact_exp(-abs(x));
    return select(1.0, small, x < 0.0) / (1.0 + small);
}

fn sigmoid_slope(x: f32) -> f32 {
    let small = exact_exp(-abs(x));
    return small / ((1.0 + small) * (1.0 + small));
}

fn largest(i: u32) -> f32 {
    return select(LARGEST_BEHIND, LARGEST_SCALE, i < told.size.y);
}

@compute @workgroup_size(256)
fn show_raw(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups) * 256u + local;
    if (i >= told.size.x) {
        return;
    }
    let at = i * VARIABLES;
    shapes[3u * i] = vec4<f32>(raw[at], raw[at + 1u], raw[at + 2u], times[i]);
    shapes[3u * i + 1u] = vec4<f32>(raw[at + 3u], raw[at + 4u], raw[at + 5u], raw[at + 6u]);
    var scale = vec3<f32>(0.0);
    var colour = vec3<f32>(0.0);
    for (var k = 0u; k < 3u; k += 1u) {
        scale[k] = clamp(exact_exp(raw[at + 7u + k]), SMALLEST_SCALE, largest(i));
        colour[k] = sigmoid(raw[at + 11u + k]);
    }
    shapes[3u * i + 2u] = vec4<f32>(scale, sigmoid(raw[at + 10u]));
    looks[2u * i] = vec4<f32>(colour, 0.0);
    looks[2u * i + 1u] = vec4<f32>(raw[at + 14u], raw[at + 15u], raw[at + 16u], 0.0);
}

// Gradient by the raw parameters, from that by the physical values.
fn raw_gradient(i: u32) -> array<f32, VARIABLES> {
    var by_raw: array<f32, VARIABLES>;
    let at = i * VARIABLES;
    let row = i * ROW;
    for (var k = 0u; k < 7u; k += 1u) {
        by_raw[k] = gradients[row + k];
    }
    for (var k = 7u; k < 10u; k += 1u) {
        let scale = exact_exp(raw[at + k]);
        by_raw[k] = select(0.0, gradients[row + k] * scale, scale >= SMALLEST_SCALE && scale <= largest(i));
    }
    for (var k = 10u; k < 14u; k += 1u) {
        by_raw[k] = gradients[row + k] * sigmoid_slope(raw[at + k]);
    }
    for (var k = 14u; k < VARIABLES; k += 1u) {
        by_raw[k] = select(0.0, gradients[row + k], i < told.size.y);
    }
    return by_raw;
}

fn speed_of(i: u32) -> f32 {
    let at = i * VARIABLES + 14u;
    let velocity = vec3<f32>(raw[at], raw[at + 1u], raw[at + 2u]);
    let most = max(abs(velocity.x), max(abs(velocity.y), abs(velocity.z)));
    if (most == 0.0 || i >= told.size.y) {
        return 0.0;
    }
    return most * length(velocity / most);
}

// The speed before the step, and whether the gradient was spoiled.
fn descended(i: u32) -> vec2<f32> {
    var by_raw = raw_gradient(i);
    let at = i * VARIABLES;
    let speed = speed_of(i);
    if (speed > 0.0 && is_finite(speed)) {
        for (var k = 14u; k < VARIABLES; k += 1u) {
            by_raw[k] += told.more.y * (raw[at + k] / speed);
        }
    }
    var is_sound = true;
    for (var k = 0u; k < VARIABLES; k += 1u) {
        is_sound = is_sound && is_finite(by_raw[k]);
    }
    let result = vec2<f32>(speed, select(1.0, 0.0, is_sound));
    // What the views do not show stays, and so does what is spoiled.
    var is_shown = false;
    for (var k = 0u; k < 14u; k += 1u) {
        is_shown = is_shown || by_raw[k] != 0.0;
    }
    if (!is_sound || !is_shown) {
        return result;
    }
    let pace = paces[counts[i]];
    counts[i] += 1u;
    for (var k = 0u; k < VARIABLES; k += 1u) {
        let slope = by_raw[k];
        let m = told.decays.x * first[at + k] + told.decays.y * slope;
        let s = told.decays.z * second[at + k] + told.decays.w * slope * slope;
        first[at + k] = m;
        second[at + k] = s;
        let root = sqrt(s * pace.y);
        if (root > 0.0) {
            raw[at + k] -= told.rates[k / 4u][k % 4u] * (m * pace.x / (root + told.more.x));
        }
    }
    return result;
}

@compute @workgroup_size(256)
fn descend_raw(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let number = linear(group, groups);
    let i = number * 256u + local;
    var found = vec2<f32>(0.0);
    if (i < told.size.x) {
        found = descended(i);
    }
    parts[local] = found;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if (local < half) {
            parts[local] += parts[local + half];
        }
        workgroupBarrier();
    }
    if (local == 0u && number * 256u < told.size.x) {
        sums[number] = parts[0];
    }
}
