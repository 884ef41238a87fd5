//! The list of the tensors of a model, from the code that builds it.

use std::sync::{Arc, Mutex, PoisonError};

use candle_core::{DType, Device, Result, Shape, Tensor};
use candle_nn::var_builder::SimpleBackend;
use candle_nn::{Init, VarBuilder};

use crate::ops::DEVICE;

/// One tensor of a model.
#[derive(Clone, Debug)]
pub struct TensorSpec {
    /// Dotted name, as in a checkpoint.
    pub name: String,
    /// Dimensions.
    pub shape: Vec<usize>,
    /// How it is drawn when there is no checkpoint.
    pub init: Init,
}

impl TensorSpec {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether the tensor has no value.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether training changes it; running statistics are kept, not trained.
    pub fn is_parameter(&self) -> bool {
        !(self.name.ends_with(".running_mean") || self.name.ends_with(".running_var"))
    }
}

/// A builder that hands out constants without memory and remembers what was asked for.
#[derive(Clone, Debug, Default)]
pub struct Recorder {
    specs: Arc<Mutex<Vec<TensorSpec>>>,
}

impl Recorder {
    /// The tensors that `build` asks for, in its order.
    ///
    /// # Errors
    /// Those of `build`.
    pub fn list<T>(build: impl FnOnce(&VarBuilder<'_>) -> Result<T>) -> Result<Vec<TensorSpec>> {
        let recorder = Self::default();
        build(&VarBuilder::from_backend(Box::new(recorder.clone()), DType::F32, DEVICE))?;
        let specs = recorder.specs.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(specs.clone())
    }
}

impl SimpleBackend for Recorder {
    fn get(&self, shape: Shape, name: &str, init: Init, dtype: DType, device: &Device) -> Result<Tensor> {
        let spec = TensorSpec { name: name.to_owned(), shape: shape.dims().to_vec(), init };
        self.specs.lock().unwrap_or_else(PoisonError::into_inner).push(spec);
        // One value seen through the whole shape.
        Tensor::zeros((), dtype, device)?.broadcast_as(shape)
    }

    fn get_unchecked(&self, name: &str, _dtype: DType, _device: &Device) -> Result<Tensor> {
        candle_core::bail!("tensor {name}: asked for without a shape")
    }

    fn contains_tensor(&self, _name: &str) -> bool {
        true
    }
}
