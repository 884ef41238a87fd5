// Stable radix sort of keys with their payloads, four bits a pass: counts of each digit in every block of 1024, their prefix sums, and the place
// of every element by its rank among those of its digit in front of it. Counts alone are atomic, so no order depends on time.

@group(0) @binding(0) var<uniform> size: vec4<u32>; // elements, blocks, shift
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> digits: array<u32>; // [16, blocks]
@group(0) @binding(3) var<storage, read> payloads: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_payloads: array<u32>;

var<workgroup> counts: array<atomic<u32>, 16>;
// Sixteen counters of 16 bits for each thread.
var<workgroup> ranks: array<vec4<u32>, 512>;

@compute @workgroup_size(256)
fn sort_count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear(group, groups);
    if (local < 16u) {
        atomicStore(&counts[local], 0u);
    }
    workgroupBarrier();
    for (var k = 0u; k < 4u; k += 1u) {
        let at = block * 1024u + k * 256u + local;
        if (at < size.x) {
            atomicAdd(&counts[(keys[at] >> size.z) & 15u], 1u);
        }
    }
    workgroupBarrier();
    if (local < 16u && block < size.y) {
        digits[local * size.y + block] = atomicLoad(&counts[local]);
    }
}

fn counter(low: vec4<u32>, high: vec4<u32>, digit: u32) -> u32 {
    let half = select(low, high, digit >= 8u);
    let word = half[(digit / 2u) % 4u];
    return select(word & 0xffffu, word >> 16u, (digit & 1u) == 1u);
}

@compute @workgroup_size(256)
fn sort_scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear(group, groups);
    let first = block * 1024u + local * 4u;
    var rank: array<u32, 4>;
    var low = vec4<u32>(0u);
    var high = vec4<u32>(0u);
    for (var k = 0u; k < 4u; k += 1u) {
        if (first + k < size.x) {
            let digit = (keys[first + k] >> size.z) & 15u;
            rank[k] = counter(low, high, digit);
            let one = select(1u, 0x10000u, (digit & 1u) == 1u);
            if (digit < 8u) {
                low[digit / 2u] += one;
            } else {
                high[(digit / 2u) % 4u] += one;
            }
        }
    }
    ranks[local] = low;
    ranks[256u + local] = high;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step *= 2u) {
        var low_before = vec4<u32>(0u);
        var high_before = vec4<u32>(0u);
        if (local >= step) {
            low_before = ranks[local - step];
            high_before = ranks[256u + local - step];
        }
        workgroupBarrier();
        ranks[local] += low_before;
        ranks[256u + local] += high_before;
        workgroupBarrier();
    }
    let low_before = ranks[local] - low;
    let high_before = ranks[256u + local] - high;
    for (var k = 0u; k < 4u; k += 1u) {
        if (first + k < size.x) {
            let key = keys[first + k];
            let digit = (key >> size.z) & 15u;
            let place = digits[digit * size.y + block] + counter(low_before, high_before, digit) + rank[k];
            sorted_keys[place] = key;
            sorted_payloads[place] = payloads[first + k];
        }
    }
}
