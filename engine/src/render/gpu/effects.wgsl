// What the costs of a view change by without each Gaussian, as `effects.rs` of the CPU's renderer says it: back to front, a tile by each group of 128
// threads, four pixels by each. Every intersection has a place of its own for its sums.

@group(0) @binding(6) var<storage, read> truth: array<vec4<f32>>; // colour; depth, 0 where none is known, -1 where the pixel is ignored
@group(0) @binding(7) var<storage, read> slopes: array<vec4<f32>>; // [H, W, 2]: by the colours of the terms that count as linear, in the first
@group(0) @binding(8) var<storage, read_write> sums: array<vec4<f32>>; // [places]: removal, shown, covered

const PIXELS: u32 = TILE_WIDTH * TILE_HEIGHT / 128u;
const ROWS: u32 = 128u / TILE_WIDTH;
// Gaussians whose sums are taken together.
const TOGETHER: u32 = 4u;

struct Pixel {
    colour: vec3<f32>,
    depth: f32,
    alpha: f32,
    transmittance: f32,
    stop: f32,
}

var<workgroup> parts: array<vec4<f32>, TOGETHER * 128u>;

@compute @workgroup_size(128)
fn take_out(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = tile_of(linear(group, groups));
    let corner = corner_of(tile);
    let column = corner.x + local % TILE_WIDTH;
    let top = corner.y + local / TILE_WIDTH;
    let x = f32(column) + 0.5;
    // What is behind, and how it is seen.
    var behind: array<Pixel, PIXELS>;
    var residual: array<vec3<f32>, PIXELS>;
    var slope: array<vec3<f32>, PIXELS>;
    // Drawn depth and alpha; true depth, 0 where none is known; what its error is before.
    var deep: array<vec4<f32>, PIXELS>;
    var counted: array<f32, PIXELS>;
    var farthest = 0.0;
    for (var k = 0u; k < PIXELS; k += 1u) {
        behind[k] = Pixel(walk.background.xyz, 0.0, 0.0, 1.0, 0.0);
        residual[k] = vec3<f32>(0.0);
        slope[k] = vec3<f32>(0.0);
        deep[k] = vec4<f32>(0.0);
        counted[k] = 0.0;
        let row = top + k * ROWS;
        if (column < walk.size.x && row < walk.size.y) {
            let pixel = row * walk.size.x + column;
            let drawn = image[pixel];
            let true_value = truth[pixel];
            behind[k].transmittance = ends[pixel].x;
            behind[k].stop = ends[pixel].y;
            farthest = max(farthest, behind[k].stop);
            let alpha = 1.0 - ends[pixel].x;
            let metres = max(true_value.w, 0.0);
            deep[k] = vec4<f32>(drawn.w, alpha, metres, abs(drawn.w / max(alpha, EXPECTED_DEPTH_EPS) - metres));
            if (!(true_value.w < 0.0)) {
                residual[k] = drawn.xyz - true_value.xyz;
                counted[k] = 1.0;
            }
            slope[k] = slopes[2u * pixel].xyz;
        }
    }
    parts[local].x = farthest;
    workgroupBarrier();
    if (local == 0u) {
        for (var i = 1u; i < 128u; i += 1u) {
            farthest = max(farthest, parts[i].x);
        }
        last = position(farthest);
    }
    let bound = workgroupUniformLoad(&last);
    let start = first_of_tile[tile];
    let length = first_of_tile[tile + 1u] - start;
    let used = min(length, bound);
    // Behind the last Gaussian that any pixel shows there is nothing to sum.
    for (var at = used + local; at < length; at += 128u) {
        sums[start - walk.batch.z + at] = vec4<f32>(0.0);
    }
    for (var rest = used; rest > 0u; rest -= min(rest, HELD)) {
        let count = min(rest, HELD);
        let base = rest - count;
        if (local < count) {
            hold(start + base + local, local);
        }
        workgroupBarrier();
        for (var done = 0u; done < count; done += TOGETHER) {
            let some = min(TOGETHER, count - done);
            for (var g = 0u; g < some; g += 1u) {
                let j = count - 1u - done - g;
                let first = held[3u * j];
                let second = held[3u * j + 1u];
                let colour = held[3u * j + 2u].xyz;
                let nth = f32(base + j);
                var sum = vec4<f32>(0.0);
                for (var k = 0u; k < PIXELS; k += 1u) {
                    let dy = f32(top + k * ROWS) + 0.5 - first.y;
                    if (abs(dy) > second.w || !(nth < behind[k].stop)) {
                        continue;
                    }
                    let u = (x - first.x) - first.z * dy;
                    let alpha = min(ALPHA_MAX, exp2(first.w * u * u + (second.y + second.x * dy * dy)));
                    if (alpha >= ALPHA_MIN) {
                        let through = 1.0 - alpha;
                        let t = behind[k].transmittance / through;
                        let w = alpha * t;
                        let change = w * (behind[k].colour - colour);
                        let size = abs(residual[k] + change) - abs(residual[k]);
                        let square = (2.0 * residual[k] + change) * change;
                        let by_colour = dot(vec3<f32>(walk.per.x), size) + dot(vec3<f32>(walk.per.y), square);
                        var by_depth = 0.0;
                        if (deep[k].z > 0.0) {
                            let new_alpha = deep[k].y + w * (behind[k].alpha - 1.0);
                            var expected = 0.0;
                            // What is left is nothing at all, or as much as one Gaussian shows at least: less is rounding.
                            if (new_alpha > 0.5 * ALPHA_MIN) {
                                expected = (deep[k].x + w * (behind[k].depth - second.z)) / new_alpha;
                            }
                            by_depth = walk.per.z * (abs(expected - deep[k].z) - deep[k].w);
                        }
                        let removal = counted[k] * by_colour + dot(slope[k], change) + by_depth;
                        sum += vec4<f32>(removal, counted[k] * w, counted[k] * alpha, 0.0);
                        behind[k].colour = through * behind[k].colour + alpha * colour;
                        behind[k].depth = through * behind[k].depth + alpha * second.z;
                        behind[k].alpha = through * behind[k].alpha + alpha;
                        behind[k].transmittance = t;
                    }
                }
                parts[128u * g + local] = sum;
            }
            workgroupBarrier();
            // By 32 threads for each Gaussian, then by one.
            let own = local / 32u * 128u + local % 32u;
            let sum = (parts[own] + parts[own + 32u]) + (parts[own + 64u] + parts[own + 96u]);
            workgroupBarrier();
            parts[local] = sum;
            workgroupBarrier();
            if (local < some) {
                var total = vec4<f32>(0.0);
                for (var i = 0u; i < 32u; i += 1u) {
                    total += parts[32u * local + i];
                }
                sums[start - walk.batch.z + base + count - 1u - done - local] = total;
            }
            workgroupBarrier();
        }
    }
}
