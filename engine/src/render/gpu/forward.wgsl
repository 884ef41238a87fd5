// Front-to-back compositing, half a tile by each group, a pixel by each thread.

@group(0) @binding(4) var<storage, read_write> image: array<vec4<f32>>; // [H, W]: colour, depth
@group(0) @binding(5) var<storage, read_write> ends: array<vec2<f32>>; // [H, W]: transmittance, list position that ended the pixel

// Groups that share a tile, and rows of each.
const HALVES: u32 = TILE_WIDTH * TILE_HEIGHT / 256u;
const ROWS: u32 = 256u / TILE_WIDTH;

var<workgroup> held: array<vec4<f32>, 768>;
var<workgroup> live: u32;

@compute @workgroup_size(256)
fn composite(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let number = min(linear(group, groups), HALVES * walk.size.w - 1u);
    let tile = number / HALVES;
    let column = tile % walk.size.z * TILE_WIDTH + local % TILE_WIDTH;
    let row = tile / walk.size.z * TILE_HEIGHT + number % HALVES * ROWS + local / TILE_WIDTH;
    let x = f32(column) + 0.5;
    let y = f32(row) + 0.5;
    var colour = vec4<f32>(0.0);
    var transmittance = 1.0;
    var stop = NEVER;
    let is_inside = column < walk.size.x && row < walk.size.y;
    var ended = !is_inside;
    let start = first_of_tile[tile];
    let end = first_of_tile[tile + 1u];
    for (var base = start; base < end; base += 256u) {
        if (local == 0u) {
            live = 0u;
        }
        workgroupBarrier();
        if (!ended) {
            live = 1u;
        }
        if (base + local < end) {
            let i = intersections[base + local];
            held[3u * local] = footprints[4u * i];
            held[3u * local + 1u] = footprints[4u * i + 1u];
            held[3u * local + 2u] = footprints[4u * i + 2u];
        }
        if (workgroupUniformLoad(&live) == 0u) {
            break;
        }
        let count = min(256u, end - base);
        for (var j = 0u; j < count && !ended; j += 1u) {
            let first = held[3u * j];
            let second = held[3u * j + 1u];
            let dy = y - first.y;
            if (abs(dy) > second.w) {
                continue;
            }
            let u = (x - first.x) - first.z * dy;
            let alpha = min(ALPHA_MAX, exp2(first.w * u * u + (second.y + second.x * dy * dy)));
            if (alpha >= ALPHA_MIN) {
                let next = transmittance * (1.0 - alpha);
                if (next <= walk.background.w) {
                    ended = true;
                    stop = f32(base + j - start);
                } else {
                    colour += alpha * transmittance * vec4<f32>(held[3u * j + 2u].xyz, second.z);
                    transmittance = next;
                }
            }
        }
        workgroupBarrier();
    }
    if (is_inside) {
        let pixel = row * walk.size.x + column;
        image[pixel] = colour + vec4<f32>(transmittance * walk.background.xyz, 0.0);
        ends[pixel] = vec2<f32>(transmittance, stop);
    }
}
