//! How a camera shows colours, so that several cameras can speak of the same ones.

use std::borrow::Cow;

use lgs_formats::image::RgbImage;
use serde::Serialize;

use super::{PinholeView, Role, View};
use crate::parallel;

/// Least colour that a power is taken of: half a step of eight bits.
const DARKEST: f32 = 0.5 / 255.0;

/// How an image shows common colours: gain, tone and vignetting.
///
/// # Formula
/// `shown = min(1, (gain * exp(-v1 t - v2 t^2) * common)^tone)`, channel by channel, where `t` is the squared tangent of the angle
/// between a pixel's ray and the camera's axis. With a shoulder, which keeps white white, the same holds of light, of which
/// `light / sqrt(1 + light^2)` is shown, and of which common colours are what is shown by a gain of 1.
///
/// # Source
/// Gain and tone by channel as in the photometric calibration of panoramas (Kim and Pollefeys, "Robust radiometric calibration and
/// vignetting correction", 2008), with a power for the tone and an even polynomial for the vignetting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Response {
    /// `[red, green, blue]`
    pub gain: [f32; 3],
    /// Exponent.
    pub tone: f32,
    /// `[v1, v2]`
    pub vignetting: [f32; 2],
    /// Whether it shows brightness alone.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub grey: bool,
    /// Whether its tone curve has a shoulder: all light is then shown as less than white.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub shoulder: bool,
}

/// From this value on an image may have clipped what was brighter; at 1 it surely did.
const CLIPPED: f32 = 0.96;

/// What red, green and blue are worth as brightness (ITU-R BT.601).
const BRIGHTNESS: [f32; 3] = [0.299, 0.587, 0.114];

impl Response {
    /// Shows common colours as they are.
    pub const IDENTITY: Self = Self { gain: [1.0; 3], tone: 1.0, vignetting: [0.0; 2], grey: false, shoulder: false };

    /// Shows common colours as brightness.
    pub(crate) const GREY: Self = Self { grey: true, ..Self::IDENTITY };

    /// The common colours of an image, in its place. What the camera clips is as bright as a scene can be.
    ///
    /// # Shapes
    /// `rgb` `[H, W, 3]`.
    pub(crate) fn to_common(self, rgb: &mut [f32], pinhole: &PinholeView) {
        let power = 1.0 / self.tone;
        if self.shoulder {
            self.each(rgb, pinhole, |value, gain| shown(raised(light(value), power) / gain));
            return;
        }
        self.each(rgb, pinhole, |value, gain| {
            let straight = raised(value, power);
            let common = straight / gain;
            // What is clipped is at least as bright as it looks: then as bright as the brightest that a scene holds.
            let clipped = ((value - CLIPPED) / (1.0 - CLIPPED)).clamp(0.0, 1.0).powi(2);
            common + clipped * (1.0 - common).max(0.0)
        });
    }

    /// Common colours as the camera shows them, in their place.
    ///
    /// # Shapes
    /// `rgb` `[H, W, 3]`.
    pub fn show(self, rgb: &mut [f32], pinhole: &PinholeView) {
        if self.grey {
            for pixel in rgb.as_chunks_mut::<3>().0 {
                *pixel = [pixel.iter().zip(BRIGHTNESS).map(|(value, worth)| value * worth).sum(); 3];
            }
        }
        self.each(rgb, pinhole, |value, gain| {
            // What is no number stays so, to be told of: limits would hide it.
            if !value.is_finite() {
                return value;
            }
            if self.shoulder {
                shown(raised(light(value) * gain, self.tone))
            } else {
                raised((value * gain).max(0.0), self.tone).min(1.0)
            }
        });
    }

    fn each(self, rgb: &mut [f32], pinhole: &PinholeView, change: impl Fn(f32, f32) -> f32 + Sync) {
        parallel::for_chunks(rgb, 3 * pinhole.width, &|row, pixels| {
            for (column, pixel) in pixels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let vignette = self.vignette(off_axis(pinhole, column as f32 + 0.5, row as f32 + 0.5));
                for (value, gain) in pixel.iter_mut().zip(self.gain) {
                    *value = change(*value, gain * vignette);
                }
            }
        });
    }

    fn vignette(self, off_axis: f32) -> f32 {
        let [first, second] = self.vignetting;
        if first == 0.0 && second == 0.0 { 1.0 } else { (-off_axis * (first + second * off_axis)).exp() }
    }
}

/// The light of which a colour is shown by a tone curve with a shoulder.
pub(crate) fn light(value: f32) -> f32 {
    /// Less than white by an eighth of a step of eight bits.
    const WHITE: f32 = 1.0 - 0.125 / 255.0;
    let value = value.clamp(0.0, WHITE);
    value / (1.0 - value * value).sqrt()
}

/// The colour that light is shown as by that curve; white as [`light`] has it.
fn shown(light: f32) -> f32 {
    light / (1.0 + light * light).sqrt()
}

/// `value` to a power; straight below the darkest colour that an image can tell from black, so that black stays black and slopes stay finite.
fn raised(value: f32, power: f32) -> f32 {
    if power == 1.0 {
        value
    } else if value >= DARKEST {
        value.powf(power)
    } else {
        value * DARKEST.powf(power - 1.0)
    }
}

/// The squared tangent of the angle between the ray of an image position (pixels) and the camera's axis.
pub(crate) fn off_axis(pinhole: &PinholeView, u: f32, v: f32) -> f32 {
    ((u - pinhole.cx) / pinhole.fx).powi(2) + ((v - pinhole.cy) / pinhole.fy).powi(2)
}

impl View {
    /// The view with its image as the camera took it, for who compares with it: without a depth map.
    pub fn as_taken(&self) -> Cow<'_, Self> {
        let Some(response) = self.response.filter(|_| self.role == Role::Input) else { return Cow::Borrowed(self) };
        let mut data = self.image.data.clone();
        response.show(&mut data, &self.pinhole);
        let image = RgbImage { data, ..self.image };
        Cow::Owned(Self {
            image,
            response: None,
            camera: self.camera.clone(),
            labels: self.labels.clone(),
            depth_map: None,
            depth_samples: self.depth_samples.clone(),
            ..*self
        })
    }

    /// Where the returns of its sweep that it shows are, metres, clip frame.
    pub(crate) fn returns(&self) -> impl Iterator<Item = [f32; 3]> {
        self.depth_samples.iter().map(|&super::DepthSample { pixel, depth }| {
            let (row, column) = (pixel as usize / self.pinhole.width, pixel as usize % self.pinhole.width);
            self.pinhole.unproject(super::Projected { u: column as f32 + 0.5, v: row as f32 + 0.5, depth })
        })
    }

    /// Makes the image of an input view, as the camera took it, one of common colours; a held-out one stays as it was taken, and what is
    /// drawn for it is shown so.
    pub(crate) fn make_common(&mut self, response: Response) {
        if self.role == Role::Input {
            response.to_common(&mut self.image.data, &self.pinhole);
        }
        self.response = Some(response);
    }
}
