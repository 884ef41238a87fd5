// Pixel by pixel: the errors that guide a refinement, with the maps that weigh them; and what a step wants and does.

@group(0) @binding(0) var<uniform> pair: Pair;
@group(0) @binding(1) var<storage, read> truth: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> ends: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> before: array<vec4<f32>>; // colours before a step
@group(0) @binding(5) var<storage, read_write> gradients: array<vec4<f32>>; // [H, W, 2]

@compute @workgroup_size(256)
fn take_residual(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = linear(group, groups) * 256u + local;
    if (pixel >= pair.size.x * pair.size.y) {
        return;
    }
    let true_value = truth[pixel];
    var by_image = vec4<f32>(0.0);
    var maps = vec2<f32>(0.0);
    if (!(true_value.w < 0.0)) {
        let error = image[pixel].xyz - true_value.xyz;
        var by_depth = 0.0;
        if (true_value.w > 0.0) {
            let alpha = 1.0 - ends[pixel].x;
            let off = image[pixel].w / max(alpha, EXPECTED_DEPTH_EPS) - true_value.w;
            by_depth = select(select(pair.slopes.w, -pair.slopes.w, off < 0.0), 0.0, off == 0.0);
        }
        by_image = vec4<f32>(error, by_depth);
        maps = vec2<f32>(1.0, (abs(error.x) + abs(error.y) + abs(error.z)) / 3.0);
    }
    gradients[2u * pixel] = by_image;
    gradients[2u * pixel + 1u] = vec4<f32>(0.0, 0.0, maps);
}

@compute @workgroup_size(256)
fn take_agreement(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = linear(group, groups) * 256u + local;
    if (pixel >= pair.size.x * pair.size.y) {
        return;
    }
    let true_value = truth[pixel];
    var maps = vec2<f32>(0.0);
    if (!(true_value.w < 0.0)) {
        let change = image[pixel].xyz - before[pixel].xyz;
        maps = vec2<f32>(dot(true_value.xyz - before[pixel].xyz, change), dot(change, change));
    }
    gradients[2u * pixel] = vec4<f32>(0.0);
    gradients[2u * pixel + 1u] = vec4<f32>(0.0, 0.0, maps);
}
