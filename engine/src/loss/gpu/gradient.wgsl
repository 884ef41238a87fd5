// Gradient of the loss by the colours of one channel, and with the first channel by the expected depth; sums of the absolute errors. 16x16 pixels
// by each group.

@group(0) @binding(0) var<uniform> pair: Pair;
@group(0) @binding(1) var<storage, read> truth: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> slopes: array<f32>;
@group(0) @binding(4) var<storage, read> ends: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> gradients: array<f32>; // [H, W, 2, 4]
@group(0) @binding(6) var<storage, read_write> sums: array<vec2<f32>>; // [3 channels, groups]: colours, depths

const SIDE: u32 = 26u;
// Three planes each: vectors of three would take the room of four.
var<workgroup> held: array<f32, 3u * SIDE * SIDE>;
var<workgroup> rows: array<f32, 3u * SIDE * 16u>;
var<workgroup> parts: array<vec2<f32>, 256>;

fn slopes_at(x: i32, y: i32, channel: u32) -> vec3<f32> {
    if (x < 0 || y < 0 || x >= i32(pair.size.z) || y >= i32(pair.size.w)) {
        return vec3<f32>(0.0);
    }
    let centres = pair.size.z * pair.size.w;
    let at = 3u * channel * centres + u32(y) * pair.size.z + u32(x);
    return vec3<f32>(slopes[at], slopes[at + centres], slopes[at + 2u * centres]);
}

fn towards(error: f32, slope: f32) -> f32 {
    return select(select(slope, -slope, error < 0.0), 0.0, error == 0.0);
}

@compute @workgroup_size(256)
fn descend(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let channel = group.z;
    let corner = 16u * group.xy;
    for (var at = local; at < SIDE * SIDE; at += 256u) {
        let found = slopes_at(i32(corner.x + at % SIDE) - 10, i32(corner.y + at / SIDE) - 10, channel);
        held[at] = found.x;
        held[SIDE * SIDE + at] = found.y;
        held[2u * SIDE * SIDE + at] = found.z;
    }
    workgroupBarrier();
    for (var at = local; at < 3u * SIDE * 16u; at += 256u) {
        var sum = 0.0;
        for (var k = 0u; k < 11u; k += 1u) {
            sum += window(k) * held[at / 16u * SIDE + at % 16u + k];
        }
        rows[at] = sum;
    }
    workgroupBarrier();
    let x = local % 16u;
    let y = local / 16u;
    var spread = vec3<f32>(0.0);
    for (var k = 0u; k < 11u; k += 1u) {
        let at = (y + k) * 16u + x;
        spread += window(k) * vec3<f32>(rows[at], rows[16u * SIDE + at], rows[32u * SIDE + at]);
    }
    var errors = vec2<f32>(0.0);
    let at = corner + vec2<u32>(x, y);
    if (all(at < pair.size.xy)) {
        let pixel = at.y * pair.size.x + at.x;
        let true_value = truth[pixel];
        let is_ignored = true_value.w < 0.0;
        let b = image[pixel][channel];
        let d = b - true_value[channel];
        let similar = spread.x + 2.0 * (d * spread.y + b * spread.z);
        let slope = towards(d, pair.slopes.x) - pair.slopes.y * similar;
        gradients[8u * pixel + channel] = select(slope, 0.0, is_ignored);
        errors.x = select(abs(d), 0.0, is_ignored);
        if (channel == 0u) {
            var by_depth = 0.0;
            if (true_value.w > 0.0) {
                let alpha = 1.0 - ends[pixel].x;
                let error = image[pixel].w / max(alpha, EXPECTED_DEPTH_EPS) - true_value.w;
                by_depth = towards(error, pair.slopes.z);
                errors.y = abs(error);
            }
            gradients[8u * pixel + 3u] = by_depth;
            for (var k = 4u; k < 8u; k += 1u) {
                gradients[8u * pixel + k] = 0.0;
            }
        }
    }
    parts[local] = errors;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if (local < half) {
            parts[local] += parts[local + half];
        }
        workgroupBarrier();
    }
    if (local == 0u) {
        sums[pair.first.x + (channel * groups.y + group.y) * groups.x + group.x] = parts[0];
    }
}
