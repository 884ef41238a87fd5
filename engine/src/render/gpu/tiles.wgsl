// Lists of the tiles: visible Gaussians with their depths, the intersections of each by depth, and what the sort by tile made of them.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> footprints: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> lists: array<u32>; // what the pass reads; see each
@group(0) @binding(3) var<storage, read> counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> payloads: array<u32>;
@group(0) @binding(6) var<storage, read_write> owners: array<u32>;
@group(0) @binding(7) var<storage, read_write> rows: array<f32>; // [N, ROW]

// `lists`: places of the visible, `[N + 1]`. Writes depths and indices, and that they are seen; positive depths order as
// their bits do.
@compute @workgroup_size(256)
fn list_visible(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups) * 256u + local;
    if (i < camera.count.x && lists[i + 1u] > lists[i]) {
        keys[lists[i]] = bitcast<u32>(footprints[4u * i + 1u].z);
        payloads[lists[i]] = i;
        rows[i * ROW + SEEN] = 1.0;
    }
}

// `lists`: indices of the visible, nearest first; `counts`: `[2, N + 1]`, the second as sums. Writes their counts of tiles, `[visible + 1]`, to `keys`.
@compute @workgroup_size(256)
fn count_in_order(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let v = linear(group, groups) * 256u + local;
    if (v < camera.count.y) {
        let tiles = camera.count.x + 1u + lists[v];
        keys[v] = counts[tiles + 1u] - counts[tiles];
    } else if (v == camera.count.y) {
        keys[v] = 0u;
    }
}

// `lists`: indices of the visible, nearest first; `counts`: first intersection of each. Writes tile, number and Gaussian of every intersection.
@compute @workgroup_size(256)
fn intersect(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let v = linear(group, groups) * 256u + local;
    if (v >= camera.count.y) {
        return;
    }
    let i = lists[v];
    let reached = Reached(footprints[4u * i], footprints[4u * i + 1u], footprints[4u * i + 2u], footprints[4u * i + 3u]);
    let reach = tile_rows(reached, camera.size);
    let end = counts[v + 1u];
    var next = counts[v];
    for (var row = reach.x; row <= reach.y; row += 1) {
        let columns = tile_columns(reached, camera.size, row, reach);
        for (var column = columns.x; column <= columns.y; column += 1) {
            // Two kernels may round differently: a tile more than were counted has no place.
            if (next < end) {
                keys[next] = u32(row) * camera.size.z + u32(column);
                payloads[next] = next;
                owners[next] = i;
                next += 1u;
            }
        }
    }
    // And one that was counted and is none goes behind all tiles.
    for (; next < end; next += 1u) {
        keys[next] = camera.size.z * camera.size.w;
        payloads[next] = next;
        owners[next] = i;
    }
}
