//! Moving pictures that every browser shows and nothing is lost in: animated PNG.

use std::{io::BufWriter, path::Path};

use png::{BitDepth, ColorType, Encoder, EncodingError};

use crate::{
    error::{FormatError, Result},
    image::{RgbImage, to_byte},
    write::write_atomic_with,
};

/// Thousandths of a second in a second.
const MILLI: u16 = 1000;

/// How a film runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Number of pictures.
    pub count: u32,
    /// Pictures per second.
    pub rate: f32,
}

/// Writes the pictures 0, 1, ... of a film, which repeats for ever, as an animated PNG; one picture is in memory at a time.
///
/// # Errors
/// No picture, one of another size, a path that cannot be written to, and whatever `picture` says.
pub fn write_animation(path: &Path, film: Film, picture: &mut dyn FnMut(u32) -> Result<RgbImage>) -> Result<()> {
    let failed = |error: EncodingError| FormatError::syntax(path, "animation", error.to_string());
    write_atomic_with(path, |file| {
        let mut encoder = Encoder::new(BufWriter::new(file), film.width, film.height);
        encoder.set_color(ColorType::Rgb);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_animated(film.count, 0).map_err(failed)?;
        encoder.set_frame_delay(milliseconds(film.rate), MILLI).map_err(failed)?;
        let mut writer = encoder.write_header().map_err(failed)?;
        for index in 0..film.count {
            let image = picture(index)?;
            let bytes: Vec<u8> = image.data.iter().map(|&v| to_byte(v)).collect();
            writer.write_image_data(&bytes).map_err(failed)?;
        }
        writer.finish().map_err(failed)
    })
}

/// How long a picture stays.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 1 and 65535 after the clamp")]
fn milliseconds(rate: f32) -> u16 {
    (f32::from(MILLI) / rate).round().clamp(1.0, f32::from(u16::MAX)) as u16
}

#[cfg(test)]
mod tests {
    use image::{AnimationDecoder, codecs::png::PngDecoder};

    use super::*;

    #[test]
    fn an_independent_decoder_sees_every_picture() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("film.png");
        let film = Film { width: 2, height: 1, count: 3, rate: 8.0 };
        let grey = |index: u32| index as f32 * 0.2;
        let mut picture = |index: u32| Ok(RgbImage { width: 2, height: 1, data: vec![grey(index); 6] });
        write_animation(&path, film, &mut picture).unwrap();
        let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
        let frames = PngDecoder::new(file).unwrap().apng().unwrap().into_frames().collect_frames().unwrap();
        assert_eq!(frames.len(), 3);
        for (index, frame) in (0..).zip(&frames) {
            let grey = to_byte(grey(index));
            assert_eq!(frame.buffer().get_pixel(1, 0).0, [grey, grey, grey, 255]);
            let (numerator, denominator) = frame.delay().numer_denom_ms();
            assert_eq!(numerator, 125 * denominator);
        }
    }

    #[test]
    fn a_picture_of_another_size_leaves_no_file() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("film.png");
        let film = Film { width: 2, height: 2, count: 1, rate: 8.0 };
        let mut picture = |_| Ok(RgbImage { width: 2, height: 1, data: vec![0.0; 6] });
        let message = write_animation(&path, film, &mut picture).unwrap_err().to_string();
        assert!(message.contains("film.png: animation: "), "{message}");
        assert!(write_animation(&path, Film { count: 0, ..film }, &mut picture).is_err());
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
    }

    #[test]
    fn slow_and_fast_films_stay_within_the_format() {
        assert_eq!([0.001, 10.0, 1e6].map(milliseconds), [65535, 100, 1]);
    }
}
