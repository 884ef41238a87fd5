// Stable radix sort of keys with their payloads, eight bits a pass: counts of each digit in every block of 1024, the counts of the blocks before, and
// the place of every element by its rank among those of its digit in front of it. Counts alone are atomic, so no order depends on time.

@group(0) @binding(0) var<uniform> size: vec4<u32>; // elements, blocks, shift
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> digits: array<u32>; // [256, blocks]
@group(0) @binding(3) var<storage, read_write> totals: array<u32>; // [256]
@group(0) @binding(4) var<storage, read> payloads: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_payloads: array<u32>;

var<workgroup> counts: array<atomic<u32>, 256>;
// Of each digit: how many, in all and in the block, stand before it.
var<workgroup> before: array<vec2<u32>, 256>;
// Sixteen counters of 16 bits for each thread.
var<workgroup> ranks: array<vec4<u32>, 512>;
// Where each digit of four bits begins.
var<workgroup> starts: array<u32, 16>;
// Digit and place in the block of each element.
var<workgroup> order: array<u32, 1024>;

@compute @workgroup_size(256)
fn sort_count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = linear(group, groups);
    atomicStore(&counts[local], 0u);
    workgroupBarrier();
    for (var k = 0u; k < 4u; k += 1u) {
        let at = block * 1024u + k * 256u + local;
        if (at < size.x) {
            atomicAdd(&counts[(keys[at] >> size.z) & 255u], 1u);
        }
    }
    workgroupBarrier();
    if (block < size.y) {
        digits[local * size.y + block] = atomicLoad(&counts[local]);
    }
}

fn scan_before(local: u32) {
    for (var step = 1u; step < 256u; step *= 2u) {
        var added = vec2<u32>(0u);
        if (local >= step) {
            added = before[local - step];
        }
        workgroupBarrier();
        before[local] += added;
        workgroupBarrier();
    }
}

// The counts of a digit become those of the blocks before: a digit by each thread, for few blocks.
@compute @workgroup_size(256)
fn sort_sum_few(@builtin(local_invocation_index) local: u32) {
    var total = 0u;
    for (var block = 0u; block < size.y; block += 1u) {
        let own = digits[local * size.y + block];
        digits[local * size.y + block] = total;
        total += own;
    }
    totals[local] = total;
}

// The same, a digit by each group.
@compute @workgroup_size(256)
fn sort_sum(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    var carried = 0u;
    for (var base = 0u; base < size.y; base += 1024u) {
        let first = base + 4u * local;
        var own: array<u32, 4>;
        var total = 0u;
        for (var k = 0u; k < 4u; k += 1u) {
            own[k] = total;
            if (first + k < size.y) {
                total += digits[group.x * size.y + first + k];
            }
        }
        workgroupBarrier();
        before[local] = vec2<u32>(total, 0u);
        workgroupBarrier();
        scan_before(local);
        let start = carried + before[local].x - total;
        for (var k = 0u; k < 4u; k += 1u) {
            if (first + k < size.y) {
                digits[group.x * size.y + first + k] = start + own[k];
            }
        }
        carried += before[255].x;
    }
    if (local == 0u) {
        totals[group.x] = carried;
    }
}

fn counter(low: vec4<u32>, high: vec4<u32>, digit: u32) -> u32 {
    let half = select(low, high, digit >= 8u);
    let word = half[(digit / 2u) % 4u];
    return select(word & 0xffffu, word >> 16u, (digit & 1u) == 1u);
}

// Puts the block in the order of four of its digit's bits.
fn arrange(local: u32, shift: u32) {
    var own: array<u32, 4>;
    var rank: array<u32, 4>;
    var low = vec4<u32>(0u);
    var high = vec4<u32>(0u);
    for (var k = 0u; k < 4u; k += 1u) {
        own[k] = order[4u * local + k];
        let digit = (own[k] >> shift) & 15u;
        rank[k] = counter(low, high, digit);
        let one = select(1u, 0x10000u, (digit & 1u) == 1u);
        if (digit < 8u) {
            low[digit / 2u] += one;
        } else {
            high[(digit / 2u) % 4u] += one;
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
    if (local < 16u) {
        var start = 0u;
        for (var digit = 0u; digit < local; digit += 1u) {
            start += counter(ranks[255], ranks[511], digit);
        }
        starts[local] = start;
    }
    workgroupBarrier();
    let low_before = ranks[local] - low;
    let high_before = ranks[256u + local] - high;
    for (var k = 0u; k < 4u; k += 1u) {
        let digit = (own[k] >> shift) & 15u;
        order[starts[digit] + counter(low_before, high_before, digit) + rank[k]] = own[k];
    }
    workgroupBarrier();
}

@compute @workgroup_size(256)
fn sort_scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = min(linear(group, groups), size.y - 1u);
    let in_front = digits[local * size.y + block];
    var here = totals[local] - in_front;
    if (block + 1u < size.y) {
        here = digits[local * size.y + block + 1u] - in_front;
    }
    before[local] = vec2<u32>(totals[local], here);
    for (var k = 0u; k < 4u; k += 1u) {
        let at = k * 256u + local;
        // What is behind the last element stays behind it.
        var digit = 255u;
        if (block * 1024u + at < size.x) {
            digit = (keys[block * 1024u + at] >> size.z) & 255u;
        }
        order[at] = (digit << 16u) | at;
    }
    workgroupBarrier();
    scan_before(local);
    let own = before[local] - vec2<u32>(totals[local], here);
    workgroupBarrier();
    // Place of the block's first of each digit, less its place in the block.
    before[local].x = own.x + in_front - own.y;
    workgroupBarrier();
    arrange(local, 16u);
    arrange(local, 20u);
    for (var k = 0u; k < 4u; k += 1u) {
        let at = k * 256u + local;
        let digit = order[at] >> 16u;
        let source = block * 1024u + (order[at] & 1023u);
        if (source < size.x) {
            let place = before[digit].x + at;
            sorted_keys[place] = keys[source];
            sorted_payloads[place] = payloads[source];
        }
    }
}
