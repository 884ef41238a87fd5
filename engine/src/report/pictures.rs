//! Pictures of a rendered view: what was drawn, what was true, how far apart they are, how far away things are.

use image::{ImageError, ImageFormat, codecs::jpeg::JpegEncoder, imageops};
use lgs_formats::casts::to_u32;
use lgs_formats::image::{PixelLabel, RgbImage, to_byte};

use super::colour_maps::{ColourMap, INFERNO, VIRIDIS};
use crate::{parallel, render::Rendered, views::View};

/// Mean absolute difference of the colour channels (0..=1) that the error picture shows as its brightest colour.
pub(super) const ERROR_FULL_SCALE: f32 = 0.5;
/// Depths (metres) at the near, bright and the far, dark end of the depth picture's logarithmic scale.
pub(super) const DEPTH_SCALE_M: [f32; 2] = [2.0, 200.0];
/// Grey of pixels that take no part in the figures.
const IGNORED: [u8; 3] = [70, 70, 70];
const JPEG_QUALITY: u8 = 88;
/// Colours of scores from 0 to 1: none of them is grey, as what lies below is.
pub(super) const SCORE_COLOURS: ColourMap = VIRIDIS;
/// How opaque scores lie on what was drawn.
const SCORE_OPACITY: f32 = 0.7;
/// Brightness of what was drawn below scores.
const UNDER_SCORES: f32 = 0.8;
/// Pixels that a thread takes at once.
const GRAIN: usize = 4096;

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureKind {
    /// The camera's image.
    Truth,
    /// The scene as it was drawn.
    Render,
    /// The mean absolute difference of the colour channels of the two.
    Error,
    /// The expected depth of what was drawn.
    Depth,
    /// The policy's scores of pruning.
    Prune,
    /// The policy's scores of adding.
    Add,
}

impl PictureKind {
    /// The kind as part of a file's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Truth => "truth",
            Self::Render => "render",
            Self::Error => "error",
            Self::Depth => "depth",
            Self::Prune => "prune",
            Self::Add => "add",
        }
    }
}

/// One of a policy's two scores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScoreKind {
    /// Of pruning.
    Prune,
    /// Of adding.
    Add,
}

/// A picture of 8 bits a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// What it shows.
    pub kind: PictureKind,
    pixels: image::RgbImage,
}

impl Picture {
    fn new(kind: PictureKind, width: usize, height: usize, colour: impl Fn(usize) -> [u8; 3] + Sync) -> Self {
        let mut pixels = image::RgbImage::new(to_u32(width), to_u32(height));
        parallel::for_chunks(&mut pixels, 3 * GRAIN, &|piece, pixels| {
            (piece * GRAIN..).zip(pixels.as_chunks_mut::<3>().0).for_each(|(i, pixel)| *pixel = colour(i));
        });
        Self { kind, pixels }
    }

    /// The scene as it was drawn.
    pub fn of_render(rendered: &Rendered) -> Self {
        let Rendered { width, height, rgb, .. } = rendered;
        Self::new(PictureKind::Render, *width, *height, |i| std::array::from_fn(|k| to_byte(rgb[3 * i + k])))
    }

    /// The camera's image.
    pub fn of_truth(image: &RgbImage) -> Self {
        let RgbImage { width, height, data } = image;
        Self::new(PictureKind::Truth, *width, *height, |i| std::array::from_fn(|k| to_byte(data[3 * i + k])))
    }

    /// The mean absolute difference of the colour channels, black for none to pale yellow for `ERROR_FULL_SCALE` and
    /// more; grey where the view's labels ignore the pixel.
    pub fn of_error(rendered: &Rendered, view: &View) -> Self {
        let ignored = |i: usize| view.labels.as_ref().is_some_and(|labels| labels[i] == PixelLabel::Ignored);
        Self::new(PictureKind::Error, rendered.width, rendered.height, |i| {
            if ignored(i) {
                return IGNORED;
            }
            let channels = 3 * i..3 * i + 3;
            let pairs = rendered.rgb[channels.clone()].iter().zip(&view.image.data[channels]);
            let mean = pairs.map(|(drawn, seen)| (drawn - seen).abs()).sum::<f32>() / 3.0;
            INFERNO.colour(mean / ERROR_FULL_SCALE)
        })
    }

    /// The expected depth, bright for near to dark for far on the scale of `DEPTH_SCALE_M`; black where nothing was
    /// drawn.
    pub fn of_depth(rendered: &Rendered) -> Self {
        let depth = rendered.expected_depth();
        let [near, far] = DEPTH_SCALE_M.map(f32::ln);
        Self::new(PictureKind::Depth, rendered.width, rendered.height, |i| {
            if rendered.alpha[i] > 0.0 { VIRIDIS.colour((far - depth[i].ln()) / (far - near)) } else { [0; 3] }
        })
    }

    /// Scores as colours over what was drawn, which is grey: the mean score of the Gaussians that are seen there, as opaque as
    /// they are.
    ///
    /// # Shapes
    /// `scores`: prune, add and 1 for the colours of scored Gaussians, black for the others.
    pub fn of_score(kind: ScoreKind, rendered: &Rendered, scores: &Rendered) -> Self {
        let (picture, channel) = match kind {
            ScoreKind::Prune => (PictureKind::Prune, 0),
            ScoreKind::Add => (PictureKind::Add, 1),
        };
        Self::new(picture, rendered.width, rendered.height, |i| {
            let weight = scores.rgb[3 * i + 2];
            let grey = UNDER_SCORES * luminance(&rendered.rgb[3 * i..3 * i + 3]);
            if weight <= 0.0 {
                return [to_byte(grey); 3];
            }
            let colour = SCORE_COLOURS.colour(scores.rgb[3 * i + channel] / weight);
            let opacity = SCORE_OPACITY * weight.min(1.0);
            colour.map(|c| to_byte(opacity * f32::from(c) / 255.0 + (1.0 - opacity) * grey))
        })
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.pixels.width(), self.pixels.height()]
    }

    /// The picture as the bytes of a PNG file.
    ///
    /// # Errors
    /// When the encoder refuses, as it does a picture without pixels.
    pub fn png(&self) -> Result<Vec<u8>, ImageError> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        self.pixels.write_to(&mut bytes, ImageFormat::Png)?;
        Ok(bytes.into_inner())
    }

    /// The picture as the bytes of a JPEG file, brought down to at most `max_width` pixels.
    ///
    /// # Errors
    /// As [`Picture::png`].
    pub fn jpeg(&self, max_width: u32) -> Result<Vec<u8>, ImageError> {
        let mut bytes = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY);
        let [width, height] = self.size();
        if width <= max_width {
            self.pixels.write_with_encoder(encoder)?;
        } else {
            let scaled = u64::from(height) * u64::from(max_width) / u64::from(width);
            let height = u32::try_from(scaled).unwrap_or(height).max(1);
            imageops::thumbnail(&self.pixels, max_width, height).write_with_encoder(encoder)?;
        }
        Ok(bytes)
    }
}

/// Relative luminance (Rec. 709 weights).
fn luminance(rgb: &[f32]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2 x 1: nothing in the first pixel, half-opaque grey 10 m away in the second.
    fn rendered() -> Rendered {
        let rgb = vec![0.0, 0.0, 0.0, 0.5, 0.5, 0.5];
        Rendered { width: 2, height: 1, rgb, alpha: vec![0.0, 0.5], depth: vec![0.0, 5.0] }
    }

    #[test]
    fn depth_is_black_where_nothing_was_drawn_and_brighter_when_nearer() {
        let mut near = rendered();
        near.depth[1] = 2.0;
        let (far, near) = (Picture::of_depth(&rendered()), Picture::of_depth(&near));
        assert_eq!(far.pixels.get_pixel(0, 0).0, [0, 0, 0]);
        let expected = VIRIDIS.colour((200.0_f32 / 10.0).ln() / (200.0_f32 / 2.0).ln());
        assert_eq!(far.pixels.get_pixel(1, 0).0, expected);
        assert!(near.pixels.get_pixel(1, 0).0[1] > expected[1]);
    }

    #[test]
    fn scores_are_means_of_what_is_seen_and_grey_lies_where_there_are_none() {
        let mut scores = rendered();
        scores.rgb = vec![0.0, 0.0, 0.0, 0.1, 0.4, 0.5];
        let picture = |kind| Picture::of_score(kind, &rendered(), &scores);
        let (prune, add) = (picture(ScoreKind::Prune), picture(ScoreKind::Add));
        assert_eq!((prune.kind, add.kind), (PictureKind::Prune, PictureKind::Add));
        assert_eq!(prune.pixels.get_pixel(0, 0).0, [0; 3]);
        let over_grey = |value: f32| {
            let grey = UNDER_SCORES * 0.5;
            let opacity = SCORE_OPACITY * 0.5;
            VIRIDIS.colour(value).map(|c| to_byte(opacity * f32::from(c) / 255.0 + (1.0 - opacity) * grey))
        };
        assert_eq!(prune.pixels.get_pixel(1, 0).0, over_grey(0.2));
        assert_eq!(add.pixels.get_pixel(1, 0).0, over_grey(0.8));
    }

    #[test]
    fn a_png_holds_the_picture_and_a_jpeg_is_brought_down_in_proportion() {
        let picture = Picture::of_render(&rendered());
        let read = image::load_from_memory(&picture.png().unwrap()).unwrap().to_rgb8();
        assert_eq!(read.as_raw(), &[0, 0, 0, 128, 128, 128]);
        let wide = Picture::new(PictureKind::Truth, 40, 20, |i| [to_byte(i as f32 / 800.0); 3]);
        let small = image::load_from_memory(&wide.jpeg(10).unwrap()).unwrap();
        assert_eq!((small.width(), small.height()), (10, 5));
        assert_eq!(image::load_from_memory(&wide.jpeg(64).unwrap()).unwrap().width(), 40);
    }
}
