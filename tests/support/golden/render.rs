//! Render goldens: gsplat's reference implementation in f64, see `golden/README.md`.

use lgs_engine::render::reference::{Camera, Gaussian, Gradient, Images};

use super::tensors::TensorFile;

/// One scene with its images and gradients.
#[derive(Debug)]
pub struct RenderGolden {
    /// The scene.
    pub gaussians: Vec<Gaussian>,
    /// The camera.
    pub camera: Camera,
    /// The images, to f32.
    pub images: Images,
    /// `[H, W]` pixels at which a threshold decides; nothing is asked of them, and no loss weighs them.
    pub fragile: Vec<bool>,
    /// The loss over colours, alpha and accumulated depth.
    pub main: GoldenLoss,
    /// The loss over the expected depth.
    pub expected_depth: GoldenLoss,
}

/// A weighted sum of the images and its gradients.
#[derive(Debug)]
pub struct GoldenLoss {
    /// The gradient by the images: the weights.
    pub weights: Images,
    /// Its value.
    pub value: f64,
    /// Its gradient by every Gaussian; velocities only where the scene has some.
    pub gradients: Vec<Gradient>,
}

/// The golden in `file`.
///
/// # Errors
/// The file is not in the layout.
pub fn load(file: &TensorFile) -> Result<RenderGolden, String> {
    let image = |name: &str| file.get(name).map(|v| v.data);
    let plane = file.get("out.alpha")?;
    let num_pixels = plane.data.len();
    let camera = camera(file, plane.shape[1], plane.shape[0])?;
    let images = Images {
        rgb: image("out.rgb")?,
        alpha: plane.data,
        depth: image("out.depth_acc")?,
        expected_depth: image("out.depth_exp")?,
    };
    let main_weights = Images {
        rgb: image("loss.w_rgb")?,
        alpha: image("loss.w_alpha")?,
        depth: image("loss.w_depth_acc")?,
        expected_depth: vec![0.0; num_pixels],
    };
    let depth_weights = Images { expected_depth: image("loss.w_depth_exp")?, ..Images::zeros(num_pixels) };
    Ok(RenderGolden {
        gaussians: scene(file)?,
        camera,
        images,
        fragile: image("out.fragile")?.iter().map(|&f| f != 0.0).collect(),
        main: loss(file, main_weights, "out.loss_main", "grad")?,
        expected_depth: loss(file, depth_weights, "out.loss_ed", "grad_ed")?,
    })
}

/// The scene of a golden or of the bench inputs.
///
/// # Errors
/// The file is not in the layout.
pub fn scene(file: &TensorFile) -> Result<Vec<Gaussian>, String> {
    let means = file.rows::<3>("in.means")?;
    let moves = file.names()?.iter().any(|name| name == "in.velocities");
    let still = vec![[0.0; 3]; means.len()];
    let velocities = if moves { file.rows::<3>("in.velocities")? } else { still };
    let times = if moves { file.get("in.times")?.data } else { vec![0.0; means.len()] };
    let (quats, scales) = (file.rows::<4>("in.quats")?, file.rows::<3>("in.scales")?);
    let (opacities, colours) = (file.get("in.opacities")?.data, file.rows::<3>("in.colors")?);
    let gaussian = |i: usize| Gaussian {
        mean: means[i],
        quat: quats[i],
        scale: scales[i],
        opacity: opacities[i],
        colour: colours[i],
        velocity: velocities[i],
        time: times[i],
    };
    Ok((0..means.len()).map(gaussian).collect())
}

/// The camera of a golden or of the bench inputs.
///
/// # Errors
/// The file is not in the layout.
pub fn camera(file: &TensorFile, width: usize, height: usize) -> Result<Camera, String> {
    let k = file.rows::<3>("in.K")?;
    let view = file.rows::<4>("in.viewmat")?;
    let timed = file.names()?.iter().any(|name| name == "in.t_query");
    Ok(Camera {
        width,
        height,
        fx: k[0][0],
        fy: k[1][1],
        cx: k[0][2],
        cy: k[1][2],
        camera_from_world: [view[0], view[1], view[2]],
        time: if timed { file.get("in.t_query")?.data[0] } else { 0.0 },
    })
}

fn loss(file: &TensorFile, weights: Images, value: &str, prefix: &str) -> Result<GoldenLoss, String> {
    let name = |tensor: &str| format!("{prefix}.{tensor}");
    let means = file.rows::<3>(&name("means"))?;
    let (quats, scales) = (file.rows::<4>(&name("quats"))?, file.rows::<3>(&name("scales"))?);
    let (opacities, colours) = (file.get(&name("opacities"))?.data, file.rows::<3>(&name("colors"))?);
    let moves = file.names()?.contains(&name("velocities"));
    let velocities = if moves { file.rows::<3>(&name("velocities"))? } else { vec![[0.0; 3]; means.len()] };
    let gradient = |i: usize| Gradient {
        mean: means[i],
        quat: quats[i],
        scale: scales[i],
        opacity: opacities[i],
        colour: colours[i],
        velocity: velocities[i],
    };
    let gradients = (0..means.len()).map(gradient).collect();
    Ok(GoldenLoss { weights, value: file.get(value)?.data[0], gradients })
}
