// What a walk over the lists of tiles is told.
struct Walk {
    // Width, height, columns of tiles, tiles.
    size: vec4<u32>,
    // Colour behind all; on the way forth the transmittance at which a pixel ends.
    background: vec4<f32>,
    // On a way back: first tile, tiles and first place of the batch.
    batch: vec4<u32>,
    // Where effects are measured, what an error of 1 costs: of a colour, of its square, of a depth.
    per: vec4<f32>,
}

@group(0) @binding(0) var<uniform> walk: Walk;
@group(0) @binding(1) var<storage, read> footprints: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> first_of_tile: array<u32>; // [tiles + 1]
@group(0) @binding(3) var<storage, read> intersections: array<u32>;

