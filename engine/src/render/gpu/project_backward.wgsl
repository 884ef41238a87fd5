// From the sums of a Gaussian over its tiles to the gradients of its physical values: the chain rule of `projection.wgsl`.

struct Back {
    // First place and places of this batch, and whether it is the first.
    batch: vec4<u32>,
    // What gradients are multiplied by before they are added.
    factor: vec4<f32>,
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> back: Back;
@group(0) @binding(2) var<storage, read> visible: array<u32>; // indices, nearest first
@group(0) @binding(3) var<storage, read> first_of_splat: array<u32>; // [visible + 1]
@group(0) @binding(4) var<storage, read> places: array<u32>;
@group(0) @binding(5) var<storage, read> sums: array<f32>; // [places, SUMS]
@group(0) @binding(6) var<storage, read_write> totals: array<f32>; // [visible, SUMS]
@group(0) @binding(7) var<storage, read> shapes: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> looks: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> gradients: array<f32>; // [N, ROW]

// Sums over the tiles of a batch, in their order, added to those of the batches before.
@compute @workgroup_size(256)
fn sum_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let v = linear(group, groups) * 256u + local;
    if (v >= camera.count.y) {
        return;
    }
    var s0 = vec4<f32>(0.0);
    var s1 = vec4<f32>(0.0);
    var s2 = vec4<f32>(0.0);
    if (back.batch.z == 0u) {
        let at = v * SUMS;
        s0 = vec4<f32>(totals[at], totals[at + 1u], totals[at + 2u], totals[at + 3u]);
        s1 = vec4<f32>(totals[at + 4u], totals[at + 5u], totals[at + 6u], totals[at + 7u]);
        s2 = vec4<f32>(totals[at + 8u], totals[at + 9u], totals[at + 10u], totals[at + 11u]);
    }
    for (var e = first_of_splat[v]; e < first_of_splat[v + 1u]; e += 1u) {
        let place = places[e] - back.batch.x;
        if (place < back.batch.y) {
            let at = place * SUMS;
            s0 += vec4<f32>(sums[at], sums[at + 1u], sums[at + 2u], sums[at + 3u]);
            s1 += vec4<f32>(sums[at + 4u], sums[at + 5u], sums[at + 6u], sums[at + 7u]);
            s2 += vec4<f32>(sums[at + 8u], sums[at + 9u], sums[at + 10u], sums[at + 11u]);
        }
    }
    for (var k = 0u; k < 4u; k += 1u) {
        totals[v * SUMS + k] = s0[k];
        totals[v * SUMS + 4u + k] = s1[k];
        totals[v * SUMS + 8u + k] = s2[k];
    }
}

// Gradient by the unnormalised quaternion, from that by the columns of the rotation.
fn by_quat(p: Projected, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> vec4<f32> {
    if (p.norm == 0.0) {
        return vec4<f32>(0.0);
    }
    let w = p.quat.x;
    let x = p.quat.y;
    let y = p.quat.z;
    let z = p.quat.w;
    let unit = 2.0 * vec4<f32>(
        x * (b.z - c.y) + y * (c.x - a.z) + z * (a.y - b.x),
        -2.0 * x * (b.y + c.z) + y * (b.x + a.y) + z * (c.x + a.z) + w * (b.z - c.y),
        x * (b.x + a.y) - 2.0 * y * (a.x + c.z) + z * (c.y + b.z) + w * (c.x - a.z),
        x * (c.x + a.z) + y * (c.y + b.z) - 2.0 * z * (a.x + b.y) + w * (a.y - b.x),
    );
    return (unit - dot(unit, p.quat) * p.quat) / p.norm;
}

// Gradient by the mean in the camera frame: through the centre, the Jacobian and the depth.
fn by_camera_mean(p: Projected, v_centre: vec2<f32>, v_x: vec3<f32>, v_y: vec3<f32>, v_depth: f32) -> vec3<f32> {
    let z = p.mean.z;
    let focal = camera.lens.xy / z;
    let diagonal = vec2<f32>(dot(v_x, p.row_x), dot(v_y, p.row_y));
    let last = vec2<f32>(dot(v_x, p.row_z), dot(v_y, p.row_z));
    let direct = focal * (v_centre - select(last / z, vec2<f32>(0.0), p.clamped));
    let along = select(2.0 * p.kept, p.kept, p.clamped) * last - diagonal;
    let deep = focal * (along / z - v_centre * (p.mean.xy / z));
    return vec3<f32>(direct, v_depth + deep.x + deep.y);
}

@compute @workgroup_size(256)
fn project_back(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let n = linear(group, groups) * 256u + local;
    if (n >= camera.count.y) {
        return;
    }
    let i = visible[n];
    let at = n * SUMS;
    let row = i * ROW;
    gradients[row + MAPPED] += totals[at + 10u];
    gradients[row + MAPPED + 1u] += totals[at + 11u];
    var any_sum = false;
    for (var k = 0u; k < 10u; k += 1u) {
        any_sum = any_sum || totals[at + k] != 0.0;
    }
    if (!any_sum) {
        return;
    }
    let shape = shapes[3u * i + 2u];
    let p = project(camera, shapes[3u * i], shapes[3u * i + 1u], shape, looks[2u * i + 1u].xyz);
    if (!p.visible) {
        return;
    }
    // By the covariance of the scaled image; a, c and the shear are those of that image.
    let square = p.size * p.size;
    let a = p.yy / p.determinant;
    let c = 1.0 / p.yy;
    let s = p.xy / p.yy;
    let a_s = p.xy / p.determinant;
    let g_dy = totals[at + 1u];
    let g_u = totals[at + 3u];
    // In pixels of the scaled image distances are `size` times smaller: the sums of squares are divided by its square.
    let v_a = -0.5 * totals[at + 5u] / square;
    let v_c = -0.5 * totals[at + 2u] / square;
    let v_s = a * totals[at + 4u] / square;
    let straight = vec2<f32>(a * g_u, c * g_dy - a_s * g_u) / square;
    let v_xx = -a * a * v_a;
    let v_xy = 2.0 * a * a_s * v_a + c * v_s;
    let v_yy = -a_s * a_s * v_a - c * c * v_c - s * c * v_s;
    let v_m_x = (2.0 * v_xx * p.m_x + v_xy * p.m_y) / p.size;
    let v_m_y = (v_xy * p.m_x + 2.0 * v_yy * p.m_y) / p.size;
    let scaled_x = p.axis_x * shape.x;
    let scaled_y = p.axis_y * shape.y;
    let scaled_z = p.axis_z * shape.z;
    let bent_x = scaled_x * v_m_x.x + scaled_y * v_m_x.y + scaled_z * v_m_x.z;
    let bent_y = scaled_x * v_m_y.x + scaled_y * v_m_y.y + scaled_z * v_m_y.z;
    let outer_x = p.image_x * v_m_x.x + p.image_y * v_m_y.x;
    let outer_y = p.image_x * v_m_x.y + p.image_y * v_m_y.y;
    let outer_z = p.image_x * v_m_x.z + p.image_y * v_m_y.z;
    let v_scale = vec3<f32>(dot(outer_x, p.axis_x), dot(outer_y, p.axis_y), dot(outer_z, p.axis_z));
    let v_quat = by_quat(p, outer_x * shape.x, outer_y * shape.y, outer_z * shape.z);
    // The bend is a constant: gradients pass through its transpose.
    let v_centre = vec2<f32>(dot(p.bend_x, straight), dot(p.bend_y, straight));
    let v_x = p.bend_x.x * bent_x + p.bend_x.y * bent_y;
    let v_y = p.bend_y.x * bent_x + p.bend_y.y * bent_y;
    let v_camera = by_camera_mean(p, v_centre, v_x, v_y, totals[at + 9u]);
    let v_mean = p.row_x * v_camera.x + p.row_y * v_camera.y + p.row_z * v_camera.z;
    let v_velocity = v_mean * p.elapsed;
    let factor = back.factor.x;
    for (var k = 0u; k < 3u; k += 1u) {
        gradients[row + k] += factor * v_mean[k];
        gradients[row + 7u + k] += factor * v_scale[k];
        gradients[row + 11u + k] += factor * totals[at + 6u + k];
        gradients[row + 14u + k] += factor * v_velocity[k];
    }
    for (var k = 0u; k < 4u; k += 1u) {
        gradients[row + 3u + k] += factor * v_quat[k];
    }
    gradients[row + 10u] += factor * (totals[at] / shape.w);
}
