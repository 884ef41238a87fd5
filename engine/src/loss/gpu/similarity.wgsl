// Similarity at every window centre of one channel and its slopes by the window sums, 16x16 centres by each group.
//
// A constant is taken off the differences before they are squared, as `ssim/forward.rs` does for a row: here the one of the group's middle pixel.

@group(0) @binding(0) var<uniform> pair: Pair;
@group(0) @binding(1) var<storage, read> truth: array<vec4<f32>>; // colour; depth, 0 where none is known, -1 where the pixel is ignored
@group(0) @binding(2) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> slopes: array<f32>; // [3 channels, 3, centres]
@group(0) @binding(4) var<storage, read_write> sums: array<f32>; // [3 channels, groups]

const SIDE: u32 = 26u; // of the pixels that 16 windows see
var<workgroup> held: array<vec2<f32>, SIDE * SIDE>;
var<workgroup> moments: array<vec4<f32>, 16u * SIDE>;

fn colours(at: vec2<u32>, channel: u32) -> vec2<f32> {
    let inside = min(at, pair.size.xy - 1u);
    let pixel = inside.y * pair.size.x + inside.x;
    let a = truth[pixel];
    let b = select(image[pixel][channel], a[channel], a.w < 0.0);
    return vec2<f32>(a[channel], b);
}

@compute @workgroup_size(256)
fn compare(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let channel = group.z;
    let corner = 16u * group.xy;
    let middle = colours(corner + 13u, channel);
    let shift = middle.y - middle.x;
    for (var at = local; at < SIDE * SIDE; at += 256u) {
        held[at] = colours(corner + vec2<u32>(at % SIDE, at / SIDE), channel);
    }
    workgroupBarrier();
    for (var at = local; at < 16u * SIDE; at += 256u) {
        var sum = vec4<f32>(0.0);
        for (var k = 0u; k < 11u; k += 1u) {
            let ab = held[at + k * SIDE];
            let d = (ab.y - ab.x) - shift;
            sum += window(k) * vec4<f32>(ab.x, d, d * d, ab.x * ab.x + ab.y * ab.y);
        }
        moments[at] = sum;
    }
    workgroupBarrier();
    let x = local % 16u;
    let y = local / 16u;
    var sum = vec4<f32>(0.0);
    for (var k = 0u; k < 11u; k += 1u) {
        sum += window(k) * moments[y * SIDE + x + k];
    }
    let mean_a = sum.x;
    let mean_d = sum.y + shift;
    let mean_b = mean_a + mean_d;
    let variance_d = sum.z - sum.y * sum.y;
    let energy = mean_a * mean_a + mean_b * mean_b;
    let inverse_1 = 1.0 / (energy + C1);
    let inverse_2 = 1.0 / ((sum.w - energy) + C2);
    let lost_1 = mean_d * mean_d * inverse_1;
    let lost_2 = variance_d * inverse_2;
    let luminance = 1.0 - lost_1;
    let structure = 1.0 - lost_2;
    let slope_2 = luminance * inverse_2;
    let slope_1 = structure * inverse_1;
    let by_mean = 2.0 * (slope_1 * (mean_b * lost_1 - mean_d) + slope_2 * (mean_d - mean_b * lost_2));
    let centre = corner + vec2<u32>(x, y);
    let is_inside = all(centre < pair.size.zw);
    var value = 0.0;
    if (is_inside) {
        let under = centre + 5u;
        let counts = !(truth[under.y * pair.size.x + under.x].w < 0.0);
        let centres = pair.size.z * pair.size.w;
        let at = 3u * channel * centres + centre.y * pair.size.z + centre.x;
        slopes[at] = select(0.0, by_mean, counts);
        slopes[at + centres] = select(0.0, -slope_2, counts);
        slopes[at + 2u * centres] = select(0.0, slope_2 * lost_2, counts);
        value = select(0.0, luminance * structure, counts);
    }
    workgroupBarrier();
    moments[local] = vec4<f32>(value, 0.0, 0.0, 0.0);
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if (local < half) {
            moments[local] += moments[local + half];
        }
        workgroupBarrier();
    }
    if (local == 0u) {
        sums[pair.first.x + (channel * groups.y + group.y) * groups.x + group.x] = moments[0].x;
    }
}
