// Footprints of all Gaussians, which of them can reach a pixel, and how many tiles each touches; then the list of the visible ones.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> shapes: array<vec4<f32>>; // [N, 3]: mean and time, quaternion, scale and opacity
@group(0) @binding(2) var<storage, read> looks: array<vec4<f32>>; // [N, 2]: colour, velocity
@group(0) @binding(3) var<storage, read_write> footprints: array<vec4<f32>>; // [N, 4]
@group(0) @binding(4) var<storage, read_write> counts: array<u32>; // [2, N + 1]: of the visible, of the tiles

@compute @workgroup_size(256)
fn project_all(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups) * 256u + local;
    if (i > camera.count.x) {
        return;
    }
    let tiles = camera.count.x + 1u + i;
    counts[i] = 0u;
    counts[tiles] = 0u;
    if (i == camera.count.x) {
        return;
    }
    let shape = shapes[3u * i + 2u];
    let colour = looks[2u * i];
    let opacity = shape.w;
    let p = project(camera, shapes[3u * i], shapes[3u * i + 1u], shape, looks[2u * i + 1u].xyz);
    if (!p.visible || opacity < ALPHA_MIN || !are_finite(colour)) {
        return;
    }
    let centre = camera.lens.xy * (p.mean.xy / p.mean.z) + camera.lens.zw;
    let reach = sqrt(max(0.0, 2.0 * log(opacity / ALPHA_MIN))) + 1e-4;
    let extent = reach * p.size * sqrt(vec2<f32>(p.xx, p.yy));
    let size = vec2<f32>(camera.size.xy);
    if (!(all(centre + extent >= vec2<f32>(0.5)) && all(centre - extent <= size - 0.5))) {
        return;
    }
    let curve_u = -HALF_LOG2_E * (p.yy / p.determinant) / p.size / p.size;
    let curve_y = -HALF_LOG2_E / p.yy / p.size / p.size;
    let width2 = (p.determinant / (HALF_LOG2_E * p.yy)) * p.size * p.size;
    let first = vec4<f32>(centre, p.xy / p.yy, curve_u);
    let second = vec4<f32>(curve_y, log2(opacity), p.mean.z, extent.y);
    let third = vec4<f32>(colour.xyz, extent.x);
    let fourth = vec4<f32>(width2, p.xy / p.xx * extent.x, 0.0, 0.0);
    if (!(are_finite(first) && are_finite(second) && are_finite(third) && are_finite(fourth))) {
        return;
    }
    footprints[4u * i] = first;
    footprints[4u * i + 1u] = second;
    footprints[4u * i + 2u] = third;
    footprints[4u * i + 3u] = fourth;
    let reached = Reached(first, second, third, fourth);
    let rows = tile_rows(reached, camera.size);
    var count = 0u;
    for (var row = rows.x; row <= rows.y; row += 1) {
        let columns = tile_columns(reached, camera.size, row, rows);
        if (columns.x <= columns.y) {
            count += u32(columns.y - columns.x + 1);
        }
    }
    counts[i] = 1u;
    counts[tiles] = count;
}
