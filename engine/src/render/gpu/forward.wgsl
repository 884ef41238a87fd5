// Front-to-back compositing, a tile by each group, two pixels by each thread.

struct Composite {
    // Width, height, columns of tiles, tiles.
    size: vec4<u32>,
    // Colour behind all, and the transmittance at which a pixel ends.
    background: vec4<f32>,
}

@group(0) @binding(0) var<uniform> drawing: Composite;
@group(0) @binding(1) var<storage, read> footprints: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> first_of_tile: array<u32>;
@group(0) @binding(3) var<storage, read> intersections: array<u32>;
@group(0) @binding(4) var<storage, read_write> image: array<vec4<f32>>; // [H, W]: colour, depth
@group(0) @binding(5) var<storage, read_write> ends: array<vec2<f32>>; // [H, W]: transmittance, list position that ended the pixel

const PIXELS: u32 = TILE_WIDTH * TILE_HEIGHT / 256u;
const ROWS: u32 = 256u / TILE_WIDTH;

var<workgroup> held: array<vec4<f32>, 768>;
var<workgroup> live: u32;

@compute @workgroup_size(256)
fn composite(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = min(linear(group, groups), drawing.size.w - 1u);
    let corner = vec2<u32>(tile % drawing.size.z * TILE_WIDTH, tile / drawing.size.z * TILE_HEIGHT);
    let column = local % TILE_WIDTH;
    let top = local / TILE_WIDTH;
    let x = f32(corner.x + column) + 0.5;
    var colours: array<vec4<f32>, PIXELS>;
    var transmittance: array<f32, PIXELS>;
    var stop: array<f32, PIXELS>;
    var ended: array<bool, PIXELS>;
    for (var k = 0u; k < PIXELS; k += 1u) {
        colours[k] = vec4<f32>(0.0);
        transmittance[k] = 1.0;
        stop[k] = NEVER;
        let y = corner.y + top + k * ROWS;
        ended[k] = corner.x + column >= drawing.size.x || y >= drawing.size.y;
    }
    let start = first_of_tile[tile];
    let end = first_of_tile[tile + 1u];
    for (var base = start; base < end; base += 256u) {
        if (local == 0u) {
            live = 0u;
        }
        workgroupBarrier();
        var lives = false;
        for (var k = 0u; k < PIXELS; k += 1u) {
            lives = lives || !ended[k];
        }
        if (lives) {
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
        for (var j = 0u; j < count; j += 1u) {
            let first = held[3u * j];
            let second = held[3u * j + 1u];
            let third = held[3u * j + 2u];
            for (var k = 0u; k < PIXELS; k += 1u) {
                let dy = f32(corner.y + top + k * ROWS) + 0.5 - first.y;
                if (ended[k] || abs(dy) > second.w) {
                    continue;
                }
                let u = (x - first.x) - first.z * dy;
                let alpha = min(ALPHA_MAX, exp2(first.w * u * u + (second.y + second.x * dy * dy)));
                if (alpha >= ALPHA_MIN) {
                    let t = transmittance[k];
                    let next = t * (1.0 - alpha);
                    if (next <= drawing.background.w) {
                        ended[k] = true;
                        stop[k] = f32(base + j - start);
                    } else {
                        colours[k] += alpha * t * vec4<f32>(third.xyz, second.z);
                        transmittance[k] = next;
                    }
                }
            }
        }
        workgroupBarrier();
    }
    for (var k = 0u; k < PIXELS; k += 1u) {
        let y = corner.y + top + k * ROWS;
        if (corner.x + column < drawing.size.x && y < drawing.size.y) {
            let pixel = y * drawing.size.x + corner.x + column;
            image[pixel] = colours[k] + vec4<f32>(transmittance[k] * drawing.background.xyz, 0.0);
            ends[pixel] = vec2<f32>(transmittance[k], stop[k]);
        }
    }
}
