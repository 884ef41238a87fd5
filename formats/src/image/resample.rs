//! Undistortion and resizing in one pass over the rows, so that no full-size float image is made.

use crate::image::{ImageSize, PixelLabel, RgbImage, lens::Lens};

/// Channels of a pixel without labels: red, green, blue.
const COLOUR: usize = 3;
/// Channels of a pixel with labels: colours, share that is ignored, share that moves.
const LABELLED: usize = 5;
/// Weight of a bilinear tap below which its label does not count: it comes from rounding.
const MIN_TAP: f32 = 1e-3;

/// A decoded image with its mask and its lens.
#[derive(Debug)]
pub(super) struct Source<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Width and height of the rectified image before it is resized, pixels.
    pub(super) rectified: [usize; 2],
    /// `[H, W, 3]` bytes.
    pub(super) rgb: &'a [u8],
    /// `[H, W]` grey values of the mask.
    pub(super) mask: Option<Vec<u8>>,
    pub(super) lens: Option<Lens>,
}

impl Source<'_> {
    /// The rectified image and its labels at another size; labels are `None` when there is no mask and the lens
    /// leaves no pixel empty.
    pub(super) fn resized(&self, size: ImageSize) -> (RgbImage, Option<Vec<PixelLabel>>) {
        let image = |data| RgbImage { width: size.width, height: size.height, data };
        if self.lens.is_none() && self.mask.is_none() {
            return (image(self.resample::<COLOUR>(size, |y, row| self.copy_colours(y, row))), None);
        }
        let labelled = match &self.lens {
            None => self.resample::<LABELLED>(size, |y, row| self.copy_labelled(y, row)),
            Some(lens) => self.resample::<LABELLED>(size, |y, row| self.rectify(lens, y, row)),
        };
        let (pixels, _) = labelled.as_chunks::<LABELLED>();
        let labels: Vec<_> = pixels.iter().map(|&[_, _, _, ignored, dynamic]| label(ignored, dynamic)).collect();
        let informative = self.mask.is_some() || labels.contains(&PixelLabel::Ignored);
        let colours = pixels.iter().flat_map(|&[r, g, b, _, _]| [r, g, b]).collect();
        (image(colours), informative.then_some(labels))
    }

    fn copy_colours(&self, y: usize, row: &mut [f32]) {
        let bytes = &self.rgb[y * self.width * COLOUR..][..self.width * COLOUR];
        row.iter_mut().zip(bytes).for_each(|(v, &b)| *v = f32::from(b) / 255.0);
    }

    fn copy_labelled(&self, y: usize, row: &mut [f32]) {
        for (x, pixel) in row.as_chunks_mut::<LABELLED>().0.iter_mut().enumerate() {
            *pixel = self.pixel(y * self.width + x);
        }
    }

    fn rectify(&self, lens: &Lens, y: usize, row: &mut [f32]) {
        for (x, pixel) in row.as_chunks_mut::<LABELLED>().0.iter_mut().enumerate() {
            let source = lens.source_of(x as f64 + 0.5, y as f64 + 0.5);
            *pixel = source.and_then(|uv| self.sample(uv)).unwrap_or([0.0, 0.0, 0.0, 1.0, 0.0]);
        }
    }

    /// Colours, ignored share and moving share of one pixel.
    fn pixel(&self, index: usize) -> [f32; LABELLED] {
        let [r, g, b] = [0, 1, 2].map(|c| f32::from(self.rgb[index * COLOUR + c]) / 255.0);
        match self.label(index) {
            PixelLabel::Static => [r, g, b, 0.0, 0.0],
            PixelLabel::Ignored => [r, g, b, 1.0, 0.0],
            PixelLabel::Dynamic => [r, g, b, 0.0, 1.0],
        }
    }

    fn label(&self, index: usize) -> PixelLabel {
        self.mask.as_ref().map_or(PixelLabel::Static, |mask| PixelLabel::from_grey(mask[index]))
    }

    /// The bilinear sample at `(u, v)` (centres at +0.5); `None` outside the image.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=side after the checks")]
    fn sample(&self, [u, v]: [f64; 2]) -> Option<[f32; LABELLED]> {
        if !(0.0..=self.width as f64).contains(&u) || !(0.0..=self.height as f64).contains(&v) {
            return None;
        }
        let (x, y) = ((u - 0.5).max(0.0), (v - 0.5).max(0.0)); // the outer half pixel repeats the edge
        let (x0, y0) = ((x as usize).min(self.width - 1), (y as usize).min(self.height - 1));
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (fx, fy) = ((x - x0 as f64).min(1.0) as f32, (y - y0 as f64).min(1.0) as f32);
        let (top, bottom) = (y0 * self.width, y1 * self.width);
        let taps = [
            (top + x0, (1.0 - fx) * (1.0 - fy)),
            (top + x1, fx * (1.0 - fy)),
            (bottom + x0, (1.0 - fx) * fy),
            (bottom + x1, fx * fy),
        ];
        let mut sum = [0.0; LABELLED];
        for (index, weight) in taps {
            let bytes = &self.rgb[index * COLOUR..][..COLOUR];
            sum.iter_mut().zip(bytes).for_each(|(s, &b)| *s += weight * f32::from(b));
        }
        sum.iter_mut().for_each(|s| *s = full(*s / 255.0));
        if self.mask.is_some() {
            for (index, weight) in taps {
                match self.label(index) {
                    PixelLabel::Static => {}
                    PixelLabel::Dynamic => sum[4] += weight,
                    PixelLabel::Ignored if weight > MIN_TAP => sum[3] = 1.0,
                    PixelLabel::Ignored => {}
                }
            }
        }
        Some(sum)
    }

    /// `[h, w, C]` values at another size; `fill` writes one row of the rectified image, `[W, C]`.
    fn resample<const C: usize>(&self, size: ImageSize, fill: impl Fn(usize, &mut [f32])) -> Vec<f32> {
        let [width, height] = self.rectified;
        let (rows, columns) = (Axis::new(height, size.height), Axis::new(width, size.width));
        let stride = width * C;
        let mut cache = [vec![0.0_f32; stride], vec![0.0_f32; stride]];
        let mut cached = [usize::MAX; 2];
        let mut mixed = vec![0.0_f32; stride];
        let mut out = Vec::with_capacity(size.height * size.width * C);
        for (first, weights) in rows.taps() {
            mixed.fill(0.0);
            for (y, &weight) in (first..).zip(weights) {
                let slot = y % 2; // neighbouring output rows share at most two source rows
                if cached[slot] != y {
                    fill(y, &mut cache[slot]);
                    cached[slot] = y;
                }
                mixed.iter_mut().zip(&cache[slot]).for_each(|(m, v)| *m += weight * v);
            }
            let (pixels, _) = mixed.as_chunks::<C>();
            for (first, weights) in columns.taps() {
                let mut sum = [0.0_f32; C];
                for (pixel, &weight) in pixels[first..].iter().zip(weights) {
                    sum.iter_mut().zip(pixel).for_each(|(s, v)| *s += weight * v);
                }
                out.extend(sum.map(full));
            }
        }
        out
    }
}

/// A weighted mean of values up to 1: rounded weights may sum to more.
const fn full(mean: f32) -> f32 {
    mean.min(1.0)
}

#[expect(clippy::cast_possible_truncation, reason = "rounds a quotient of at most 1")]
fn fraction(part: usize, whole: usize) -> f32 {
    (part as f64 / whole as f64) as f32
}

/// The label of a pixel of which these shares are ignored and moving.
fn label(ignored: f32, dynamic: f32) -> PixelLabel {
    if ignored > 0.0 {
        PixelLabel::Ignored
    } else if dynamic > 0.5 {
        PixelLabel::Dynamic
    } else {
        PixelLabel::Static
    }
}

/// Which input pixels make each output pixel of one axis, with weights that sum to 1.
struct Axis {
    /// First input pixel, and end of the weights in `weights`, of each output pixel.
    spans: Vec<(usize, usize)>,
    weights: Vec<f32>,
}

impl Axis {
    /// Shares of area downward, linear interpolation upward; all positions are exact fractions.
    fn new(input: usize, output: usize) -> Self {
        let mut axis = Self { spans: Vec::with_capacity(output), weights: Vec::new() };
        for o in 0..output {
            let first =
                if output <= input { axis.push_area(o, input, output) } else { axis.push_linear(o, input, output) };
            axis.spans.push((first, axis.weights.len()));
        }
        axis
    }

    /// In units of 1 / `output` input pixels, output pixel o covers `o input .. (o + 1) input`, input pixel i
    /// `i output .. (i + 1) output`.
    fn push_area(&mut self, o: usize, input: usize, output: usize) -> usize {
        let (start, end) = (o * input, (o + 1) * input);
        for i in start / output..end.div_ceil(output) {
            let share = end.min((i + 1) * output) - start.max(i * output);
            self.weights.push(fraction(share, input));
        }
        start / output
    }

    /// The centre of output pixel o is `((2 o + 1) input + output) / (2 output)` input pixels right of the centre of
    /// input pixel -1.
    fn push_linear(&mut self, o: usize, input: usize, output: usize) -> usize {
        let (centre, unit) = ((2 * o + 1) * input + output, 2 * output);
        let (right, rest) = (centre / unit, fraction(centre % unit, unit));
        if right == 0 || right == input || rest == 0.0 {
            self.weights.push(1.0);
            return right.saturating_sub(1);
        }
        self.weights.extend([1.0 - rest, rest]);
        right - 1
    }

    fn taps(&self) -> impl Iterator<Item = (usize, &[f32])> {
        let mut begin = 0;
        self.spans.iter().map(move |&(first, end)| {
            let weights = &self.weights[begin..end];
            begin = end;
            (first, weights)
        })
    }
}

#[cfg(test)]
mod tests;
