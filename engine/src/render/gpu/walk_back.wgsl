// What ways back read of a drawn view, and the Gaussians that a group holds.
@group(0) @binding(4) var<storage, read> image: array<vec4<f32>>; // [H, W]: colour, depth
@group(0) @binding(5) var<storage, read> ends: array<vec2<f32>>; // [H, W]: transmittance, list position that ended the pixel

// Gaussians that a group holds at a time.
const HELD: u32 = 64u;

var<workgroup> held: array<vec4<f32>, 3u * HELD>;
var<workgroup> last: u32;

// Holds the Gaussian at a place.
fn hold(place: u32, at: u32) {
    let i = intersections[place];
    held[3u * at] = footprints[4u * i];
    held[3u * at + 1u] = footprints[4u * i + 1u];
    held[3u * at + 2u] = footprints[4u * i + 2u];
}

// The tile of a group.
fn tile_of(number: u32) -> u32 {
    return walk.batch.x + min(number, walk.batch.y - 1u);
}

fn corner_of(tile: u32) -> vec2<u32> {
    return vec2<u32>(tile % walk.size.z * TILE_WIDTH, tile / walk.size.z * TILE_HEIGHT);
}

// A list position that is farther than any as a whole number.
fn position(farthest: f32) -> u32 {
    return u32(min(farthest, 4294967040.0));
}

