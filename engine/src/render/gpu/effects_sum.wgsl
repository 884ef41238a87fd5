// From the effects at a Gaussian's tiles to its own.

@group(0) @binding(0) var<uniform> batch: vec4<u32>; // first place and places of the batch, visible Gaussians
@group(0) @binding(1) var<storage, read> visible: array<u32>; // indices, nearest first
@group(0) @binding(2) var<storage, read> first_of_splat: array<u32>; // [visible + 1]
@group(0) @binding(3) var<storage, read> places: array<u32>;
@group(0) @binding(4) var<storage, read> sums: array<vec4<f32>>; // [places]
@group(0) @binding(5) var<storage, read_write> effects: array<vec4<f32>>; // [N]

// Adds the sums over the tiles of a batch, in their order.
@compute @workgroup_size(256)
fn sum_effects(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let v = linear(group, groups) * 256u + local;
    if (v >= batch.z) {
        return;
    }
    var sum = vec4<f32>(0.0);
    for (var e = first_of_splat[v]; e < first_of_splat[v + 1u]; e += 1u) {
        let place = places[e] - batch.x;
        if (place < batch.y) {
            sum += sums[place];
        }
    }
    effects[visible[v]] += sum;
}
