use safetensors::{Dtype, tensor::TensorView};

use super::*;

type Tensors = Vec<(String, Vec<usize>, Vec<f32>)>;

/// All tensors of the network, with arbitrary values of a size that keeps features alive through the trunk.
fn tensors() -> Tensors {
    let mut shapes = vec![("scaling_layer.shift".to_owned(), vec![1, 3, 1, 1])];
    shapes.push(("scaling_layer.scale".to_owned(), vec![1, 3, 1, 1]));
    let mut add = |name: String, out: usize, input: usize, side: usize| {
        shapes.push((format!("{name}.weight"), vec![out, input, side, side]));
        shapes.push((format!("{name}.bias"), vec![out]));
    };
    add("features.0".into(), 64, 3, 3);
    for (index, input, squeezed, expanded) in FIRES {
        add(format!("features.{index}.squeeze"), squeezed, input, 1);
        add(format!("features.{index}.expand1x1"), expanded, squeezed, 1);
        add(format!("features.{index}.expand3x3"), expanded, squeezed, 3);
    }
    shapes.extend(TAP_CHANNELS.iter().enumerate().map(|(i, &c)| (format!("lin{i}.model.1.weight"), vec![1, c, 1, 1])));
    let mut state = 1_u32;
    let mut draw = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut fill = |(name, shape): (String, Vec<usize>)| {
        let fan_in: usize = shape[1..].iter().product();
        let positive = name.starts_with("lin") || name.ends_with("scale");
        let values = (0..shape.iter().product()).map(|_| match positive {
            true => draw() + 0.1,
            false => (draw() - 0.45) * 4.0 / (fan_in as f32).sqrt(),
        });
        let values = values.collect();
        (name, shape, values)
    };
    shapes.into_iter().map(&mut fill).collect()
}

fn load(tensors: &Tensors) -> Result<Lpips> {
    let bytes: Vec<Vec<u8>> =
        tensors.iter().map(|(_, _, values)| values.iter().flat_map(|v| v.to_le_bytes()).collect()).collect();
    let views = tensors
        .iter()
        .zip(&bytes)
        .map(|((name, shape, _), data)| (name, TensorView::new(Dtype::F32, shape.clone(), data).unwrap()));
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), safetensors::serialize(views, None).unwrap()).unwrap();
    Lpips::load(file.path())
}

fn image(width: usize, height: usize, phase: f32) -> RgbImage {
    let value = |i: usize| 0.5 + 0.5 * (i as f32 * (0.7 + phase) + phase).sin();
    RgbImage { width, height, data: (0..width * height * 3).map(value).collect() }
}

/// One image's features `[C][h][w]` in f64.
type Planes = Vec<Vec<Vec<f64>>>;

/// The slow twin of the whole metric, written from the definition.
struct Twin<'a>(&'a Tensors);

impl Twin<'_> {
    fn values(&self, name: &str) -> Vec<f64> {
        let found = self.0.iter().find(|t| t.0 == name).unwrap();
        found.2.iter().map(|&v| f64::from(v)).collect()
    }

    fn convolve(&self, name: &str, input: &Planes, side: usize, stride: usize, padding: usize) -> Planes {
        let (weight, bias) = (self.values(&format!("{name}.weight")), self.values(&format!("{name}.bias")));
        let (height, width) = (input[0].len(), input[0][0].len());
        let count = |size: usize| (size + 2 * padding - side) / stride + 1;
        let at = |c: usize, y: usize, x: usize| match (y.checked_sub(padding), x.checked_sub(padding)) {
            (Some(y), Some(x)) if y < height && x < width => input[c][y][x],
            _ => 0.0,
        };
        let output = |o: usize, y: usize, x: usize| {
            let mut sum = bias[o];
            for c in 0..input.len() {
                for k in 0..side * side {
                    let w = weight[(o * input.len() + c) * side * side + k];
                    sum += w * at(c, y * stride + k / side, x * stride + k % side);
                }
            }
            sum.max(0.0)
        };
        let row = |o: usize, y: usize| (0..count(width)).map(|x| output(o, y, x)).collect();
        (0..bias.len()).map(|o| (0..count(height)).map(|y| row(o, y)).collect()).collect()
    }

    fn pool(input: &Planes) -> Planes {
        let count = |size: usize| size.saturating_sub(3).div_ceil(2) + 1;
        let pool_plane = |plane: &Vec<Vec<f64>>| {
            let (height, width) = (plane.len(), plane[0].len());
            let window = |y: usize, x: usize| {
                let rows = plane[2 * y..height.min(2 * y + 3)].iter();
                rows.flat_map(|row| &row[2 * x..width.min(2 * x + 3)]).fold(f64::NEG_INFINITY, |m, &v| m.max(v))
            };
            (0..count(height)).map(|y| (0..count(width)).map(|x| window(y, x)).collect()).collect()
        };
        input.iter().map(pool_plane).collect()
    }

    fn features(&self, image: &RgbImage) -> Vec<Planes> {
        let (shift, scale) = (self.values("scaling_layer.shift"), self.values("scaling_layer.scale"));
        let value = |c: usize, y: usize, x: usize| {
            (f64::from(image.data[(y * image.width + x) * 3 + c]) * 2.0 - 1.0 - shift[c]) / scale[c]
        };
        let plane = |c: usize| (0..image.height).map(|y| (0..image.width).map(|x| value(c, y, x)).collect()).collect();
        let mut current = self.convolve("features.0", &(0..3).map(plane).collect(), 3, 2, 0);
        let mut taps = vec![current.clone()];
        for index in 2..=12 {
            if [2, 5, 8].contains(&index) {
                current = Self::pool(&current);
                continue;
            }
            let name = format!("features.{index}");
            let squeezed = self.convolve(&format!("{name}.squeeze"), &current, 1, 1, 0);
            current = self.convolve(&format!("{name}.expand1x1"), &squeezed, 1, 1, 0);
            current.extend(self.convolve(&format!("{name}.expand3x3"), &squeezed, 3, 1, 1));
            if ![3, 6].contains(&index) {
                taps.push(current.clone());
            }
        }
        taps
    }

    fn distance(&self, a: &RgbImage, b: &RgbImage) -> f64 {
        let (a, b) = (self.features(a), self.features(b));
        let mut total = 0.0;
        for (layer, (a, b)) in a.iter().zip(&b).enumerate() {
            let head = self.values(&format!("lin{layer}.model.1.weight"));
            let (height, width) = (a[0].len(), a[0][0].len());
            let mut sum = 0.0;
            for (y, x) in (0..height * width).map(|i| (i / width, i % width)) {
                let norm = |f: &Planes| f.iter().map(|p| p[y][x] * p[y][x]).sum::<f64>().sqrt() + 1e-10;
                let (norm_a, norm_b) = (norm(a), norm(b));
                sum +=
                    (0..head.len()).map(|c| head[c] * (a[c][y][x] / norm_a - b[c][y][x] / norm_b).powi(2)).sum::<f64>();
            }
            total += sum / (height * width) as f64;
        }
        total
    }
}

#[test]
fn equals_the_twin() {
    let tensors = tensors();
    let lpips = load(&tensors).unwrap();
    for (width, height) in [(17, 17), (22, 35), (36, 19)] {
        let (a, b) = (image(width, height, 0.0), image(width, height, 0.4));
        let (got, want) = (lpips.distance(&a, &b).unwrap(), Twin(&tensors).distance(&a, &b));
        assert!(want > 1e-2 && (got - want).abs() < 1e-5 * want, "{width}x{height}: got {got}, want {want}");
    }
}

#[test]
fn identical_images_have_no_distance_and_order_does_not_matter() {
    let lpips = load(&tensors()).unwrap();
    let (a, b) = (image(40, 24, 0.0), image(40, 24, 0.3));
    assert_eq!(lpips.distance(&a, &a).unwrap(), 0.0);
    assert_eq!(lpips.distance(&a, &b).unwrap(), lpips.distance(&b, &a).unwrap());
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    let lpips = load(&tensors()).unwrap();
    let (a, b) = (image(90, 61, 0.0), image(90, 61, 0.3));
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| lpips.distance(&a, &b).unwrap())
    };
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn all_missing_and_misshaped_tensors_are_named_at_once() {
    let mut tensors = tensors();
    tensors.retain(|t| t.0 != "features.7.squeeze.bias" && t.0 != "lin6.model.1.weight");
    tensors.iter_mut().filter(|t| t.0 == "features.0.weight").for_each(|t| t.1 = vec![64, 27]);
    let message = load(&tensors).unwrap_err().to_string();
    let want = ": tensors: expected features.0.weight F32 [64, 3, 3, 3], features.7.squeeze.bias F32 [32], \
                lin6.model.1.weight F32 [1, 512, 1, 1], found features.0.weight F32 [64, 27], \
                features.7.squeeze.bias missing, lin6.model.1.weight missing";
    assert!(message.ends_with(want), "{message}");
}

#[test]
fn images_that_do_not_fit_are_refused() {
    let lpips = load(&tensors()).unwrap();
    let refuse = |a: &RgbImage, b: &RgbImage| lpips.distance(a, b).unwrap_err().to_string();
    let want = "image size for LPIPS: expected two images of one size, 20x30, found 30x20";
    assert_eq!(refuse(&image(30, 20, 0.0), &image(20, 30, 0.0)), want);
    let want = "image size for LPIPS: expected at least 17x17, found 16x30";
    assert_eq!(refuse(&image(30, 16, 0.0), &image(30, 16, 0.0)), want);
    let mut spoiled = image(30, 20, 0.0);
    spoiled.data[4] = f32::NAN;
    let want = "value 1804 of two images for LPIPS: expected a finite value, found NaN";
    assert_eq!(refuse(&image(30, 20, 0.0), &spoiled), want);
}
