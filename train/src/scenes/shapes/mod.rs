//! Analytic shapes in their own frame: where a ray enters them and how far they reach.

mod entry;

use glam::{Mat3, Vec3};

pub(crate) use entry::leaf_is_solid;

/// A half line; `direction` need not have unit length, distances are in multiples of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub(crate) origin: Vec3,
    pub(crate) direction: Vec3,
}

impl Ray {
    /// The point at `t` directions from the origin.
    pub(crate) fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }

    /// One over each component of the direction; finite where a component is zero, so that slabs give no NaN.
    pub(crate) fn inverse_direction(&self) -> Vec3 {
        self.direction.map(|v| if v.abs() < 1e-20 { 1e-20 } else { v }).recip()
    }
}

/// Where a ray first meets a shape, in the shape's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalHit {
    pub(crate) t: f32,
    pub(crate) normal: Vec3,
    /// For boxes 0..6 = +x, -x, +y, -y, +z, -z; for cylinders 0 = mantle, 4 = top, 5 = bottom; else 0.
    pub(crate) face: u8,
}

/// A shape centred in its own frame (metres).
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    /// A box by its half extents.
    Cuboid { half: Vec3 },
    /// A box whose top is smaller than its bottom.
    Tapered { half: Vec3, planes: Box<[Plane; 6]> },
    /// A cylinder around z with both caps.
    Cylinder { radius: f32, half_height: f32 },
    /// An ellipsoid by its radii.
    Ellipsoid { radii: Vec3 },
    /// A ragged flat clump of leaves in the plane z = 0.
    Leaf { radius: f32, seed: u32 },
}

/// A plane `normal . p = offset`; the inside is where the left side is smaller.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    normal: Vec3,
    offset: f32,
}

/// How far the top of a [`Shape::Tapered`] is drawn in on each side (metres).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taper {
    pub(crate) front: f32,
    pub(crate) rear: f32,
    pub(crate) sides: f32,
}

impl Shape {
    /// A box of the given full size.
    pub(crate) fn cuboid(size: Vec3) -> Self {
        Self::Cuboid { half: size * 0.5 }
    }

    /// A box of the given full size at its bottom, drawn in by `taper` at its top.
    pub(crate) fn tapered(size: Vec3, taper: Taper) -> Self {
        let half = size * 0.5;
        let slanted = |outward: Vec3, reach: f32, inset: f32| {
            let normal = (outward * size.z + Vec3::Z * inset).normalize();
            Plane { normal, offset: normal.dot(outward * reach - Vec3::Z * half.z) }
        };
        let planes = Box::new([
            slanted(Vec3::X, half.x, taper.front),
            slanted(-Vec3::X, half.x, taper.rear),
            slanted(Vec3::Y, half.y, taper.sides),
            slanted(-Vec3::Y, half.y, taper.sides),
            Plane { normal: Vec3::Z, offset: half.z },
            Plane { normal: -Vec3::Z, offset: half.z },
        ]);
        Self::Tapered { half, planes }
    }

    /// Where `ray` (in the shape's frame) enters the shape between `t_min` and `t_max`.
    pub(crate) fn intersect(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<LocalHit> {
        let hit = match self {
            Self::Cuboid { half } => entry::cuboid(ray, *half),
            Self::Tapered { planes, .. } => entry::convex(ray, planes),
            Self::Cylinder { radius, half_height } => entry::cylinder(ray, *radius, *half_height),
            Self::Ellipsoid { radii } => entry::ellipsoid(ray, *radii),
            Self::Leaf { radius, seed } => entry::leaf(ray, *radius, *seed),
        }?;
        (hit.t > t_min && hit.t < t_max).then_some(hit)
    }

    /// Half extents of the axis-aligned bounds after a rotation.
    pub(crate) fn reach(&self, rotation: &Mat3) -> Vec3 {
        let spread = |v: Vec3| rotation.x_axis.abs() * v.x + rotation.y_axis.abs() * v.y + rotation.z_axis.abs() * v.z;
        match self {
            Self::Cuboid { half } | Self::Tapered { half, .. } => spread(*half),
            Self::Cylinder { radius, half_height } => spread(Vec3::new(*radius, *radius, *half_height)),
            Self::Ellipsoid { radii } => {
                let [x, y, z] = [rotation.x_axis * radii.x, rotation.y_axis * radii.y, rotation.z_axis * radii.z];
                (x * x + y * y + z * z).map(f32::sqrt)
            }
            Self::Leaf { radius, .. } => {
                let (x, y) = (rotation.x_axis, rotation.y_axis);
                (x * x + y * y).map(f32::sqrt) * *radius + Vec3::splat(1e-4)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes() -> Vec<Shape> {
        let taper = Taper { front: 0.3, rear: 0.2, sides: 0.1 };
        vec![
            Shape::cuboid(Vec3::new(2.0, 1.0, 3.0)),
            Shape::tapered(Vec3::new(2.0, 1.0, 1.0), taper),
            Shape::Cylinder { radius: 0.5, half_height: 1.0 },
            Shape::Ellipsoid { radii: Vec3::new(1.0, 0.5, 0.25) },
            Shape::Leaf { radius: 0.6, seed: 3 },
        ]
    }

    /// Rays from a sphere of radius 5 towards points near the centre.
    fn rays() -> impl Iterator<Item = Ray> {
        (0..400_u16).map(|i| {
            let i = f32::from(i);
            let (a, z) = (i * 2.4, (i / 200.0 - 1.0) * 0.98);
            let r = (1.0 - z * z).sqrt();
            let origin = Vec3::new(a.cos() * r, a.sin() * r, z) * 5.0;
            let target = Vec3::new((i * 0.7).sin(), (i * 1.3).sin(), (i * 0.3).sin()) * 0.6;
            Ray { origin, direction: target - origin }
        })
    }

    #[test]
    fn hits_lie_on_the_surface_and_normals_face_the_ray() {
        for shape in shapes() {
            let mut hits = 0;
            for ray in rays() {
                let Some(hit) = shape.intersect(&ray, 0.0, 10.0) else { continue };
                hits += 1;
                let p = ray.at(hit.t);
                assert!(hit.normal.dot(ray.direction) <= 1e-5, "{shape:?} {ray:?}");
                assert!((hit.normal.length() - 1.0).abs() < 1e-4);
                let reach = shape.reach(&Mat3::IDENTITY);
                assert!((p.abs() - reach).max_element() < 1e-3, "{shape:?}: {p} outside {reach}");
                // A step back is outside: a ray that starts there meets the same surface.
                let again = shape.intersect(&Ray { origin: ray.at(hit.t - 0.05), ..ray }, 0.0, 10.0);
                assert!((again.unwrap().t - 0.05).abs() < 1e-4, "{shape:?}");
            }
            assert!(hits > 40, "{shape:?}: {hits} hits");
        }
    }

    #[test]
    fn tapered_top_is_smaller_than_its_bottom() {
        let shape = Shape::tapered(Vec3::new(2.0, 2.0, 2.0), Taper { front: 0.5, rear: 0.0, sides: 0.25 });
        let along_x = |z| shape.intersect(&Ray { origin: Vec3::new(9.0, 0.0, z), direction: -Vec3::X }, 0.0, 99.0);
        assert!((along_x(-0.999).unwrap().t - 8.0).abs() < 1e-3);
        assert!((along_x(0.999).unwrap().t - 8.5).abs() < 1e-3);
        assert!(along_x(1.1).is_none());
    }

    #[test]
    fn axis_parallel_rays_are_not_lost() {
        let down = Ray { origin: Vec3::new(0.1, 0.1, 4.0), direction: -Vec3::Z };
        for shape in &shapes()[..4] {
            assert!(shape.intersect(&down, 0.0, 10.0).is_some(), "{shape:?}");
        }
        let level = Ray { origin: Vec3::new(4.0, 0.1, 0.1), direction: -Vec3::X };
        for shape in &shapes()[..4] {
            assert!(shape.intersect(&level, 0.0, 10.0).is_some(), "{shape:?}");
        }
    }
}
