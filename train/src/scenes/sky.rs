//! Light and sky: the sun, the ambient light, clouds, haze and the tone curve.

use glam::Vec3;
use lgs_formats::casts::to_f32;

use super::{
    config::LightSpec,
    maths::{mix, narrow3, rotation_y, rotation_z, smoothstep},
    surface::colour,
    texture::{noise, octaves},
};

/// Radiance that the tone curve maps to white.
const WHITE: f32 = 1.7;

/// The light of a scene.
#[derive(Clone, Debug)]
pub(crate) struct Light {
    /// Unit vector towards the sun.
    pub(crate) sun: Vec3,
    sun_colour: Vec3,
    from_above: Vec3,
    from_below: Vec3,
    zenith: Vec3,
    horizon: Vec3,
    cloud: Vec3,
    cloud_cover: f32,
    haze_length: f32,
    seed: u32,
}

impl Light {
    /// The light that a configuration describes.
    pub(crate) fn new(spec: &LightSpec, seed: u32) -> Self {
        let rotation = rotation_z(spec.sun_azimuth_deg.to_radians()) * rotation_y(-spec.sun_elevation_deg.to_radians());
        let clear = 1.0 - to_f32(spec.overcast);
        // A low sun is warm.
        let height = smoothstep(0.0, 0.8, to_f32(spec.sun_elevation_deg.to_radians()));
        let warm = Vec3::new(1.0, mix(0.70, 0.93, height), mix(0.42, 0.80, height));
        Self {
            sun: narrow3(rotation.x_axis),
            sun_colour: warm * 2.1 * clear,
            from_above: colour(0.74, 0.79, 0.86) * mix(1.4, 0.8, clear),
            from_below: colour(0.44, 0.42, 0.39),
            zenith: colour(0.74, 0.76, 0.80).lerp(colour(0.28, 0.50, 0.88), clear),
            horizon: colour(0.86, 0.87, 0.88).lerp(colour(0.86, 0.93, 1.0), clear) * warm.lerp(Vec3::ONE, 0.8),
            cloud: colour(0.9, 0.9, 0.92).lerp(colour(1.25, 1.25, 1.26), clear),
            cloud_cover: to_f32(spec.clouds),
            haze_length: to_f32(spec.haze_m),
            seed,
        }
    }

    /// Radiance of the sky in a direction of unit length; `footprint` is the pixel's width in radians.
    pub(crate) fn sky(&self, direction: Vec3, footprint: f32) -> Vec3 {
        let up = direction.z.max(0.0);
        let base = self.horizon.lerp(self.zenith, smoothstep(-0.08, 0.6, up));
        let layer = up + 0.12;
        let (u, v) = (direction.x / layer, direction.y / layer);
        let stretched = footprint / (layer * layer);
        let bend = 0.4 * noise(u * 0.7, v * 0.7, self.seed ^ 9);
        let billow = octaves(u + bend, v - bend, 1.1, 5, stretched, self.seed);
        let edge = mix(0.45, -0.75, self.cloud_cover);
        let cover = smoothstep(edge, edge + 0.5, billow) * smoothstep(0.0, 0.2, up);
        let lit = self.cloud * (0.72 + 0.35 * octaves(u + 0.3, v, 2.0, 3, stretched, self.seed ^ 3));
        let glow = direction.dot(self.sun).max(0.0);
        let glow = glow * glow * glow * glow;
        base.lerp(lit, 0.85 * cover) + self.sun_colour * (0.12 * glow * glow)
    }

    /// Radiance of a matt surface: hemispheric ambient light and the sun where `lit`.
    ///
    /// # Formula
    /// `albedo (openness * mix(below, above, (1 + n_z) / 2) + sun * max(n . s, 0) * lit)`
    pub(crate) fn reflected(&self, albedo: Vec3, normal: Vec3, openness: f32, lit: f32) -> Vec3 {
        let ambient = self.from_below.lerp(self.from_above, 0.5 + 0.5 * normal.z) * openness;
        albedo * (ambient + self.sun_colour * (normal.dot(self.sun).max(0.0) * lit))
    }

    /// Radiance of a clump of leaves, through which part of the sun's light passes.
    pub(crate) fn through_leaves(&self, albedo: Vec3, normal: Vec3, openness: f32, lit: f32) -> Vec3 {
        let ambient = (0.3 * self.from_below + 0.7 * self.from_above) * openness;
        let facing = normal.dot(self.sun);
        let share = 0.3 + if facing > 0.0 { 0.7 * facing } else { -0.35 * facing };
        albedo * (ambient + self.sun_colour * (share * lit * openness))
    }

    /// `radiance` seen through the air over a distance in metres.
    pub(crate) fn hazed(&self, radiance: Vec3, distance: f32) -> Vec3 {
        let optical = distance / self.haze_length;
        radiance.lerp(self.horizon, 1.0 - 1.0 / (1.0 + optical + 0.5 * optical * optical))
    }

    /// Screen colour in 0..=1 of a radiance: compressed highlights, gamma 2.
    ///
    /// # Formula
    /// `sqrt(x (1 + x / WHITE^2) / (1 + x))`, scaled to keep middle tones
    pub(crate) fn encode(radiance: Vec3) -> Vec3 {
        radiance.map(|x| {
            let x = 1.15 * x.max(0.0);
            (x * (1.0 + x / (WHITE * WHITE)) / (1.0 + x)).sqrt().min(1.0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light() -> Light {
        let spec =
            LightSpec { sun_azimuth_deg: 90.0, sun_elevation_deg: 30.0, overcast: 0.0, clouds: 0.5, haze_m: 600.0 };
        Light::new(&spec, 1)
    }

    #[test]
    fn sun_stands_where_the_configuration_says() {
        let sun = light().sun;
        assert!((sun - Vec3::new(0.0, 0.866, 0.5)).length() < 1e-3, "{sun}");
    }

    #[test]
    fn shade_is_darker_and_far_things_fade_to_the_horizon() {
        let light = light();
        let (grey, up) = (Vec3::splat(0.5), Vec3::Z);
        assert!(
            light.reflected(grey, up, 1.0, 1.0).min_element() > 1.3 * light.reflected(grey, up, 1.0, 0.0).max_element()
        );
        assert!((light.hazed(Vec3::ZERO, 1e6) - light.horizon).length() < 1e-3);
        assert!(light.hazed(grey, 0.0) == grey);
    }

    #[test]
    fn screen_colours_stay_in_range() {
        assert_eq!(Light::encode(Vec3::ZERO), Vec3::ZERO);
        assert!(Light::encode(Vec3::splat(50.0)).max_element() <= 1.0);
        assert!(light().sky(Vec3::new(0.6, 0.0, 0.8), 0.002).is_finite());
    }
}
