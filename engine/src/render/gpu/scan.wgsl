// Exclusive prefix sums, a block of 2048 values by each group; the sums of the blocks are scanned in turn and added.

@group(0) @binding(0) var<uniform> size: vec4<u32>; // values, blocks
@group(0) @binding(1) var<storage, read_write> values: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;

var<workgroup> partial: array<u32, 256>;

@compute @workgroup_size(256)
fn scan_blocks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear(group, groups);
    let first = block * 2048u + local * 8u;
    var own: array<u32, 8>;
    var total = 0u;
    for (var k = 0u; k < 8u; k += 1u) {
        own[k] = total;
        if (first + k < size.x) {
            total += values[first + k];
        }
    }
    partial[local] = total;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step *= 2u) {
        var before = 0u;
        if (local >= step) {
            before = partial[local - step];
        }
        workgroupBarrier();
        partial[local] += before;
        workgroupBarrier();
    }
    let before = partial[local] - total;
    for (var k = 0u; k < 8u; k += 1u) {
        if (first + k < size.x) {
            values[first + k] = before + own[k];
        }
    }
    if (local == 255u && block < size.y) {
        sums[block] = partial[255];
    }
}

@compute @workgroup_size(256)
fn scan_add(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    // The first block has nothing before it.
    let block = linear(group, groups) + 1u;
    if (block >= size.y) {
        return;
    }
    let before = sums[block];
    for (var k = 0u; k < 8u; k += 1u) {
        let at = block * 2048u + k * 256u + local;
        if (at < size.x) {
            values[at] += before;
        }
    }
}
