//! The same networks in other libraries.

use candle_core::{Device, Result, Tensor};
use nalgebra::{DMatrix, DVector};
use retarget::Dense;

/// Returns each layer with true if SiLU follows it: all but the last of each network.
fn with_activation(networks: &[Vec<Dense>]) -> Vec<(&Dense, bool)> {
    let marked =
        networks.iter().flat_map(|layers| layers.iter().enumerate().map(|(i, layer)| (layer, i + 1 < layers.len())));
    marked.collect()
}

/// A matrix product, a sum and SiLU per layer, on the processor.
pub(crate) fn candle(networks: &[Vec<Dense>], input: &[f32], batch: usize) -> impl FnMut() -> Vec<f32> + use<> {
    let build = |(layer, hidden): (&Dense, bool)| -> Result<_> {
        let weight = Tensor::from_slice(&layer.weight, (layer.outputs, layer.inputs), &Device::Cpu)?.t()?;
        Ok((weight, Tensor::from_slice(&layer.bias, layer.outputs, &Device::Cpu)?, hidden))
    };
    let layers: Vec<_> =
        with_activation(networks).into_iter().map(build).collect::<Result<_>>().expect("shapes are right");
    let input = input.to_vec();
    move || {
        let forward = || {
            let mut x = Tensor::from_slice(&input, (batch, input.len() / batch), &Device::Cpu)?;
            for (weight, bias, hidden) in &layers {
                x = x.matmul(weight)?.broadcast_add(bias)?;
                x = if *hidden { x.silu()? } else { x };
            }
            x.flatten_all()?.to_vec1()
        };
        forward().expect("shapes are right")
    }
}

/// A product of a dynamic matrix and a vector per layer and input.
pub(crate) fn nalgebra(networks: &[Vec<Dense>], input: &[f32], batch: usize) -> impl FnMut() -> Vec<f32> + use<> {
    let build = |(layer, hidden): (&Dense, bool)| {
        let weight = DMatrix::from_row_slice(layer.outputs, layer.inputs, &layer.weight);
        (weight, DVector::from_row_slice(&layer.bias), DVector::zeros(layer.outputs), hidden)
    };
    let mut layers: Vec<_> = with_activation(networks).into_iter().map(build).collect();
    let inputs: Vec<_> = input.chunks(input.len() / batch).map(DVector::from_row_slice).collect();
    move || {
        let mut out = Vec::new();
        for input in &inputs {
            let mut from = input;
            for (weight, bias, to, hidden) in &mut layers {
                to.copy_from(bias);
                to.gemv(1.0, weight, from, 1.0);
                if *hidden {
                    to.apply(|x| *x /= 1.0 + (-*x).exp());
                }
                from = to;
            }
            out.extend_from_slice(from.as_slice());
        }
        out
    }
}
