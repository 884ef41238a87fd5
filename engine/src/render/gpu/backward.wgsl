// Back-to-front gradients of the compositing, a tile by each group of `THREADS`, 64 or a multiple of it: the fewer, the more pixels of its own each sums
// before the sums go through memory that they share; the more, the more of the GPU works where there are few tiles. Every intersection has a place
// of its own for its sums.

// [H, W, 4]: by the colours and the expected depth; by accumulated alpha and depth, and two maps.
@group(0) @binding(6) var<storage, read> gradients: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> sums: array<f32>; // [places, SUMS]

const PIXELS: u32 = TILE_WIDTH * TILE_HEIGHT / THREADS;
const ROWS: u32 = THREADS / TILE_WIDTH;
// Parts of the threads, of 64 each, whose sums are taken by themselves.
const PARTS: u32 = THREADS / 64u;
// Gaussians whose sums are taken together.
const TOGETHER: u32 = 4u / PARTS;
// A column more than threads of a part, so that those that sum read from different banks.
const STRIDE: u32 = 65u;

var<workgroup> parts: array<f32, TOGETHER * PARTS * SUMS * STRIDE>;
var<workgroup> of_parts: array<f32, 4u * SUMS>;

@compute @workgroup_size(THREADS)
fn uncomposite(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = tile_of(linear(group, groups));
    let corner = corner_of(tile);
    let column = local % TILE_WIDTH;
    let top = local / TILE_WIDTH;
    let x = f32(corner.x + column) + 0.5;
    var v: array<vec4<f32>, PIXELS>;
    var maps: array<vec2<f32>, PIXELS>;
    var behind: array<f32, PIXELS>;
    var transmittance: array<f32, PIXELS>;
    var stop: array<f32, PIXELS>;
    var farthest = 0.0;
    for (var k = 0u; k < PIXELS; k += 1u) {
        v[k] = vec4<f32>(0.0);
        maps[k] = vec2<f32>(0.0);
        behind[k] = 0.0;
        transmittance[k] = 1.0;
        stop[k] = 0.0;
        let y = corner.y + top + k * ROWS;
        if (corner.x + column < walk.size.x && y < walk.size.y) {
            let pixel = y * walk.size.x + corner.x + column;
            let by_image = gradients[2u * pixel];
            let by_rest = gradients[2u * pixel + 1u];
            let t = ends[pixel].x;
            let alpha = 1.0 - t;
            var v_alpha = by_rest.x;
            var v_depth = by_rest.y;
            if (by_image.w != 0.0) {
                v_depth += by_image.w / max(alpha, EXPECTED_DEPTH_EPS);
                if (alpha > EXPECTED_DEPTH_EPS) {
                    v_alpha -= by_image.w * (image[pixel].w / alpha / alpha);
                }
            }
            v[k] = vec4<f32>(by_image.xyz, v_depth);
            maps[k] = by_rest.zw;
            behind[k] = t * (dot(walk.background.xyz, by_image.xyz) - v_alpha);
            transmittance[k] = t;
            stop[k] = ends[pixel].y;
            farthest = max(farthest, stop[k]);
        }
    }
    parts[local] = farthest;
    workgroupBarrier();
    if (local == 0u) {
        for (var i = 1u; i < THREADS; i += 1u) {
            farthest = max(farthest, parts[i]);
        }
        last = position(farthest);
    }
    let bound = workgroupUniformLoad(&last);
    let start = first_of_tile[tile];
    let length = first_of_tile[tile + 1u] - start;
    let used = min(length, bound);
    // Behind the last Gaussian that any pixel shows there is nothing to sum.
    for (var at = SUMS * used + local; at < SUMS * length; at += THREADS) {
        sums[(start - walk.batch.z) * SUMS + at] = 0.0;
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
                let third = held[3u * j + 2u];
                let nth = f32(base + j);
                var s0 = vec4<f32>(0.0);
                var s1 = vec4<f32>(0.0);
                var s2 = vec4<f32>(0.0);
                for (var k = 0u; k < PIXELS; k += 1u) {
                    let dy = f32(corner.y + top + k * ROWS) + 0.5 - first.y;
                    if (abs(dy) > second.w || !(nth < stop[k])) {
                        continue;
                    }
                    let u = (x - first.x) - first.z * dy;
                    let uncapped = exp2(first.w * u * u + (second.y + second.x * dy * dy));
                    let alpha = min(ALPHA_MAX, uncapped);
                    if (alpha >= ALPHA_MIN) {
                        let inverse = 1.0 / (1.0 - alpha);
                        let t = transmittance[k] * inverse;
                        let w = alpha * t;
                        let q = dot(third.xyz, v[k].xyz) + second.z * v[k].w;
                        let v_alpha = t * q - behind[k] * inverse;
                        behind[k] += w * q;
                        transmittance[k] = t;
                        let g = select(alpha * v_alpha, 0.0, uncapped > ALPHA_MAX);
                        let gu = g * u;
                        s0 += vec4<f32>(g, g * dy, g * dy * dy, gu);
                        s1 += vec4<f32>(gu * dy, gu * u, w * v[k].x, w * v[k].y);
                        s2 += vec4<f32>(w * v[k].z, w * v[k].w, w * maps[k]);
                    }
                }
                // [Gaussians, sums, parts, threads of a part]
                let at = (g * SUMS * PARTS + local / 64u) * STRIDE + local % 64u;
                for (var k = 0u; k < 4u; k += 1u) {
                    parts[at + k * PARTS * STRIDE] = s0[k];
                    parts[at + (4u + k) * PARTS * STRIDE] = s1[k];
                    parts[at + (8u + k) * PARTS * STRIDE] = s2[k];
                }
            }
            workgroupBarrier();
            var sum = vec4<f32>(0.0);
            if (local < some * SUMS * PARTS) {
                for (var i = 0u; i < 64u; i += 4u) {
                    let at = local * STRIDE + i;
                    sum += vec4<f32>(parts[at], parts[at + 1u], parts[at + 2u], parts[at + 3u]);
                }
            }
            var total = (sum.x + sum.y) + (sum.z + sum.w);
            if (PARTS > 1u) {
                if (local < some * SUMS * PARTS) {
                    of_parts[local] = total;
                }
                workgroupBarrier();
                total = 0.0;
                if (local < some * SUMS) {
                    for (var part = 0u; part < PARTS; part += 1u) {
                        total += of_parts[local * PARTS + part];
                    }
                }
            }
            if (local < some * SUMS) {
                let place = start + base + count - 1u - done - local / SUMS - walk.batch.z;
                sums[place * SUMS + local % SUMS] = total;
            }
            workgroupBarrier();
        }
    }
}
