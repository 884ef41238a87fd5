// Rows of the Gaussians that some view shows, one after the other.

@group(0) @binding(0) var<uniform> size: vec4<u32>; // Gaussians; first number that is taken of a row, and how many
@group(0) @binding(1) var<storage, read> rows: array<f32>; // [N, ROW]
@group(0) @binding(2) var<storage, read_write> places: array<u32>; // [N + 1]
@group(0) @binding(3) var<storage, read_write> packed: array<f32>; // [seen, numbers]
@group(0) @binding(4) var<storage, read_write> indices: array<u32>; // [seen]

// 1 for each that is seen, 0 for the others and behind the last.
@compute @workgroup_size(256)
fn flag_seen(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups) * 256u + local;
    if (i <= size.x) {
        places[i] = 0u;
    }
    if (i < size.x && rows[i * ROW + SEEN] > 0.0) {
        places[i] = 1u;
    }
}

@compute @workgroup_size(256)
fn list_seen(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups) * 256u + local;
    if (i < size.x && places[i + 1u] > places[i]) {
        indices[places[i]] = i;
    }
}

@compute @workgroup_size(256)
fn pack_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear(group, groups) * 256u + local;
    if (i < size.x && places[i + 1u] > places[i]) {
        for (var k = 0u; k < size.z; k += 1u) {
            packed[places[i] * size.z + k] = rows[i * ROW + size.y + k];
        }
    }
}
