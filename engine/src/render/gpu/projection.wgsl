// What one Gaussian is in the camera: the common part of the forward and the backward pass, as `project.rs` has it in f64.
//
// In f32 it stays exact enough by three means: a mean is taken relative to the camera's centre (two numbers) before it is turned, the covariance
// is that of an image scaled so that the largest row of `J W R S` has length 1, and the cross product of its determinant keeps what rounding takes.

struct Camera {
    // Rows of `camera_from_clip`.
    row_x: vec4<f32>,
    row_y: vec4<f32>,
    row_z: vec4<f32>,
    // Centre in the clip frame, and what f32 leaves of it; the view's time in `centre.w`, the blur's variance in
    // `centre_rest.w`.
    centre: vec4<f32>,
    centre_rest: vec4<f32>,
    // Focal lengths and principal point.
    lens: vec4<f32>,
    // Smallest and largest `x / z` and `y / z` at which the Jacobian is taken.
    limits: vec4<f32>,
    // Shutter: seconds at the corner, a pixel to the right, a pixel down; 1 where it rolls.
    moments: vec4<f32>,
    // Earliest and latest moment.
    moment_limits: vec4<f32>,
    turn: vec4<f32>,
    drift: vec4<f32>,
    // Width, height, columns and rows of tiles.
    size: vec4<u32>,
    // Gaussians; visible ones.
    count: vec4<u32>,
}

struct Projected {
    visible: bool,
    // Rows of `camera_from_clip` at the moment of exposure.
    row_x: vec3<f32>,
    row_y: vec3<f32>,
    row_z: vec3<f32>,
    elapsed: f32,
    // Columns of what a rolling shutter does to places.
    bend_x: vec2<f32>,
    bend_y: vec2<f32>,
    mean: vec3<f32>,
    kept: vec2<f32>,
    clamped: vec2<bool>,
    quat: vec4<f32>,
    norm: f32,
    axis_x: vec3<f32>,
    axis_y: vec3<f32>,
    axis_z: vec3<f32>,
    // Rows of `J W`.
    image_x: vec3<f32>,
    image_y: vec3<f32>,
    // Rows of `J W R S` divided by `size`, their covariance and its determinant.
    m_x: vec3<f32>,
    m_y: vec3<f32>,
    size: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    determinant: f32,
}

fn is_finite(value: f32) -> bool {
    return (bitcast<u32>(value) & 0x7f800000u) != 0x7f800000u;
}

fn are_finite(values: vec4<f32>) -> bool {
    let bits = bitcast<vec4<u32>>(values) & vec4<u32>(0x7f800000u);
    return all(bits != vec4<u32>(0x7f800000u));
}

fn products(a: f32, b: f32, c: f32, d: f32) -> f32 {
    let cd = c * d;
    return fma(a, b, -cd) + fma(-c, d, cd);
}

fn exact_cross(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(products(a.y, b.z, a.z, b.y), products(a.z, b.x, a.x, b.z), products(a.x, b.y, a.y, b.x));
}

fn turned(axis: vec3<f32>, cosine: f32, v: vec3<f32>) -> vec3<f32> {
    return v + 2.0 * cross(axis, cross(axis, v) + cosine * v);
}

fn limited(camera: Camera, seconds: f32) -> f32 {
    return clamp(seconds, camera.moment_limits.x, camera.moment_limits.y);
}

// Moves a Gaussian that is ahead to where it is when its line is exposed.
fn roll(camera: Camera, velocity: vec3<f32>, p: ptr<function, Projected>) {
    let point = (*p).mean;
    let by = camera.moments.yz;
    let speed = vec3<f32>(dot(camera.row_x.xyz, velocity), dot(camera.row_y.xyz, velocity), dot(camera.row_z.xyz, velocity));
    let slope = point.xy / point.z;
    let moves = (speed - camera.drift.xyz) - cross(camera.turn.xyz, point);
    var rate = camera.lens.xy * (moves.xy - slope * moves.z) / point.z;
    let swift = length(rate) * length(by);
    if (swift > SHUTTER_FASTEST) {
        rate *= SHUTTER_FASTEST / swift;
    }
    let lines = dot(by, rate);
    let start = limited(camera, camera.moments.x + dot(by, camera.lens.xy * slope + camera.lens.zw));
    let drawn = rate / (1.0 - lines);
    let seconds = limited(camera, start / (1.0 - lines));
    // Half the angle is small: sine and cosine by their series.
    let half = -0.5 * seconds * camera.turn.xyz;
    let h = dot(half, half);
    let axis = half * (1.0 - h / 6.0 * (1.0 - h / 20.0 * (1.0 - h / 42.0 * (1.0 - h / 72.0))));
    let cosine = 1.0 - h / 2.0 * (1.0 - h / 12.0 * (1.0 - h / 30.0 * (1.0 - h / 56.0)));
    let shift = -seconds * camera.drift.xyz;
    (*p).mean = turned(axis, cosine, point + shift + speed * seconds);
    let columns = array<vec3<f32>, 3>(
        turned(axis, cosine, vec3<f32>(camera.row_x.x, camera.row_y.x, camera.row_z.x)),
        turned(axis, cosine, vec3<f32>(camera.row_x.y, camera.row_y.y, camera.row_z.y)),
        turned(axis, cosine, vec3<f32>(camera.row_x.z, camera.row_y.z, camera.row_z.z)),
    );
    (*p).row_x = vec3<f32>(columns[0].x, columns[1].x, columns[2].x);
    (*p).row_y = vec3<f32>(columns[0].y, columns[1].y, columns[2].y);
    (*p).row_z = vec3<f32>(columns[0].z, columns[1].z, columns[2].z);
    (*p).elapsed += seconds;
    (*p).bend_x = vec2<f32>(1.0, 0.0) + drawn * by.x;
    (*p).bend_y = vec2<f32>(0.0, 1.0) + drawn * by.y;
}

fn orient(p: ptr<function, Projected>, given: vec4<f32>) {
    let largest = max(max(abs(given.x), abs(given.y)), max(abs(given.z), abs(given.w)));
    (*p).quat = vec4<f32>(1.0, 0.0, 0.0, 0.0);
    (*p).norm = 0.0;
    if (largest > 0.0) {
        let scaled = given / largest;
        let norm = length(scaled);
        (*p).quat = scaled / norm;
        (*p).norm = norm * largest;
    }
    let w = (*p).quat.x;
    let x = (*p).quat.y;
    let y = (*p).quat.z;
    let z = (*p).quat.w;
    (*p).axis_x = vec3<f32>(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y));
    (*p).axis_y = vec3<f32>(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x));
    (*p).axis_z = vec3<f32>(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

// The Gaussian in the camera; not visible behind the near plane or where a number is not finite.
fn project(camera: Camera, place: vec4<f32>, quat: vec4<f32>, shape: vec4<f32>, velocity: vec3<f32>) -> Projected {
    var p: Projected;
    p.visible = false;
    if (!(are_finite(place) && are_finite(quat) && are_finite(shape) && are_finite(vec4<f32>(velocity, 0.0)))) {
        return p;
    }
    p.elapsed = camera.centre.w - place.w;
    let offset = ((place.xyz - camera.centre.xyz) + velocity * p.elapsed) - camera.centre_rest.xyz;
    p.row_x = camera.row_x.xyz;
    p.row_y = camera.row_y.xyz;
    p.row_z = camera.row_z.xyz;
    p.mean = vec3<f32>(dot(p.row_x, offset), dot(p.row_y, offset), dot(p.row_z, offset));
    p.bend_x = vec2<f32>(1.0, 0.0);
    p.bend_y = vec2<f32>(0.0, 1.0);
    let rolls = camera.moments.w != 0.0;
    if (rolls && are_finite(vec4<f32>(p.mean, 0.0)) && p.mean.z >= NEAR_PLANE) {
        roll(camera, velocity, &p);
    }
    if (!are_finite(vec4<f32>(p.mean, 0.0)) || p.mean.z < NEAR_PLANE) {
        return p;
    }
    let z = p.mean.z;
    let slope = p.mean.xy / z;
    p.kept = clamp(slope, camera.limits.xy, camera.limits.zw);
    p.clamped = p.kept != slope;
    orient(&p, quat);
    let focal = camera.lens.xy / z;
    let straight_x = focal.x * (p.row_x - p.kept.x * p.row_z);
    let straight_y = focal.y * (p.row_y - p.kept.y * p.row_z);
    p.image_x = straight_x;
    p.image_y = straight_y;
    if (rolls) {
        p.image_x = p.bend_x.x * straight_x + p.bend_y.x * straight_y;
        p.image_y = p.bend_x.y * straight_x + p.bend_y.y * straight_y;
    }
    let m_x = vec3<f32>(dot(p.axis_x, p.image_x), dot(p.axis_y, p.image_x), dot(p.axis_z, p.image_x)) * shape.xyz;
    let m_y = vec3<f32>(dot(p.axis_x, p.image_y), dot(p.axis_y, p.image_y), dot(p.axis_z, p.image_y)) * shape.xyz;
    let wide = max(abs(m_x), abs(m_y));
    p.size = max(1.0, max(wide.x, max(wide.y, wide.z)));
    p.m_x = m_x / p.size;
    p.m_y = m_y / p.size;
    let blur = camera.centre_rest.w / p.size / p.size;
    p.xx = dot(p.m_x, p.m_x) + blur;
    p.yy = dot(p.m_y, p.m_y) + blur;
    p.xy = dot(p.m_x, p.m_y);
    let normal = exact_cross(p.m_x, p.m_y);
    p.determinant = dot(normal, normal) + blur * (p.xx + p.yy - blur);
    p.visible = true;
    return p;
}
