// From intersections sorted by tile: where each tile's list begins, which Gaussian stands at each place, and the place of each intersection.

@group(0) @binding(0) var<uniform> size: vec4<u32>; // intersections, tiles
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> numbers: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read_write> first_of_tile: array<u32>; // [tiles + 1]
@group(0) @binding(5) var<storage, read_write> intersections: array<u32>;
@group(0) @binding(6) var<storage, read_write> places: array<u32>;

@compute @workgroup_size(256)
fn find_ranges(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear(group, groups) * 256u + local;
    if (p > size.x) {
        return;
    }
    var begin = 0u;
    if (p > 0u) {
        begin = keys[p - 1u] + 1u;
    }
    var end = size.y;
    if (p < size.x) {
        end = keys[p];
        intersections[p] = owners[numbers[p]];
        places[numbers[p]] = p;
    }
    for (var tile = begin; tile <= min(end, size.y); tile += 1u) {
        first_of_tile[tile] = p;
    }
}
