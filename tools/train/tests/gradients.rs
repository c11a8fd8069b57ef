//! Compares the analytic gradients with those of a general library's automatic differentiation, in f64.

use candle_core::{DType, Device, Result, Tensor, Var};
use train::kinematics::{ANGLE_SMOOTHING, ARM, Arm, FEATURES, Limbs, s_gr};
use train::mlp::Mlp;
use train::networks::{LATENT, Networks, REACH, Size};
use train::objective::{MARGIN, Shard, Weighting};
use train::sampling::{Batch, Mixture, Recorded};

const ROWS: usize = 24;

fn arm() -> Arm {
    Arm {
        axes: [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]],
        reference: [0.0, 0.0, std::f32::consts::FRAC_PI_2, 0.0, 0.0],
        // Narrow limits, so that some outputs overrun them.
        mid: [0.2, 0.1, 1.2, 1.0, -0.1],
        half: [0.9, 0.8, 1.3, 1.1, 1.0],
        rolls: [true; 2],
    }
}

fn tensor(values: &[f32], shape: &[usize]) -> Result<Tensor> {
    let values: Vec<f64> = values.iter().map(|v| f64::from(*v)).collect();
    Tensor::from_vec(values, shape, &Device::Cpu)
}

fn perceptron(mlp: &Mlp, parameters: &Tensor, input: &Tensor) -> Result<Tensor> {
    let mut x = input.clone();
    for (index, layer) in mlp.layers.iter().enumerate() {
        let weight = parameters.narrow(0, layer.weight.start, layer.weight.len())?;
        let weight = weight.reshape((layer.output, layer.input))?;
        let bias = parameters.narrow(0, layer.bias.start, layer.bias.len())?;
        x = x.matmul(&weight.t()?)?.broadcast_add(&bias)?;
        if index < mlp.shape.hidden_layers {
            x = x.silu()?;
        }
    }
    Ok(x)
}

/// Quaternions as four columns x, y, z, w of `[rows]`.
type Columns = [Tensor; 4];

fn product(a: &Columns, b: &Columns) -> Result<Columns> {
    let sum = |terms: [(f64, usize, usize); 4]| -> Result<Tensor> {
        let mut total = ((&a[terms[0].1] * &b[terms[0].2])? * terms[0].0)?;
        for (sign, i, j) in &terms[1..] {
            total = (total + ((&a[*i] * &b[*j])? * *sign)?)?;
        }
        Ok(total)
    };
    Ok([
        sum([(1.0, 3, 0), (1.0, 0, 3), (1.0, 1, 2), (-1.0, 2, 1)])?,
        sum([(1.0, 3, 1), (-1.0, 0, 2), (1.0, 1, 3), (1.0, 2, 0)])?,
        sum([(1.0, 3, 2), (1.0, 0, 1), (-1.0, 1, 0), (1.0, 2, 3)])?,
        sum([(1.0, 3, 3), (-1.0, 0, 0), (-1.0, 1, 1), (-1.0, 2, 2)])?,
    ])
}

/// Returns the smoothed angle of S_GR. candle has no inverse trigonometric function. So the value enters as a constant,
/// and the slope by a term that is zero: (S - S0) da/dS. Finite differences in another test tie the slope to the value.
fn smoothed_angle(s_gr: &Tensor) -> Result<Tensor> {
    let eps = f64::from(ANGLE_SMOOTHING);
    let fixed = s_gr.detach();
    let values: Vec<f64> = fixed.to_vec1::<f64>()?;
    let angles: Vec<f64> = values.iter().map(|s| 2.0 * (s + eps).sqrt().atan2((1.0 - s + eps).sqrt())).collect();
    let slopes: Vec<f64> = values.iter().map(|s| 1.0 / ((s + eps) * (1.0 - s + eps)).sqrt()).collect();
    let of = |values: Vec<f64>| Tensor::from_vec(values, s_gr.dims(), &Device::Cpu);
    ((s_gr - fixed)? * of(slopes)?)? + of(angles)?
}

/// Returns 1 - <human, robot>^2 and the smoothed angle, summed over both limbs, per arm.
fn metric(arm: &Arm, q: &Tensor, human: &[Limbs]) -> Result<[Tensor; 2]> {
    let mut rotation: Option<Columns> = None;
    let mut total = Tensor::zeros(human.len(), DType::F64, &Device::Cpu)?;
    let mut angle = total.clone();
    for joint in 0..ARM {
        let half = ((q.narrow(1, joint, 1)?.squeeze(1)? - f64::from(arm.reference[joint]))? * 0.5)?;
        let (sine, cosine) = (half.sin()?, half.cos()?);
        let axis = arm.axes[joint].map(f64::from);
        let turn = [(&sine * axis[0])?, (&sine * axis[1])?, (&sine * axis[2])?, cosine];
        let next = match &rotation {
            None => turn,
            Some(before) => product(before, &turn)?,
        };
        if let Some(limb) = [2, 4].iter().position(|j| *j == joint) {
            let mut dot = Tensor::zeros(human.len(), DType::F64, &Device::Cpu)?;
            for (i, column) in next.iter().enumerate() {
                let target: Vec<f32> = human.iter().map(|limbs| limbs[limb][i]).collect();
                dot = (dot + (column * tensor(&target, &[human.len()])?)?)?;
            }
            let s_gr = (1.0 - dot.sqr()?)?;
            angle = (angle + smoothed_angle(&s_gr)?)?;
            total = (total + s_gr)?;
        }
        rotation = Some(next);
    }
    Ok([total, angle])
}

/// Returns n inside -1..1, and the bound outside. candle's own rule for the slope at the bounds never matters here.
fn clamped(n: &Tensor) -> Result<Tensor> {
    let excess = ((n - 1.0)?.relu()? - (n.neg()? - 1.0)?.relu()?)?;
    n - excess
}

/// Returns all terms as the module's documentation states them, on the shard's batch.
fn reference(networks: &Networks, arm: &Arm, parameters: &Tensor, shard: &Shard) -> Result<[Tensor; 7]> {
    let batch = &shard.batch;
    let features = tensor(&batch.features, &[ROWS, FEATURES])?;
    let posture = tensor(&batch.posture, &[ROWS, ARM])?;
    let half = tensor(&arm.half, &[1, ARM])?;
    let mid = tensor(&arm.mid, &[1, ARM])?;
    let z_human = perceptron(&networks.human, parameters, &features)?;
    let z_robot = perceptron(&networks.robot, parameters, &posture)?;
    let decode = |z: &Tensor| perceptron(&networks.decoder, parameters, z)?.tanh()? * f64::from(REACH);
    let n = decode(&z_human)?;
    let inside = clamped(&n)?;
    let q = inside.broadcast_mul(&half)?.broadcast_add(&mid)?;
    let fit = metric(arm, &q, &batch.human)?;
    let [kinematics, angle] = fit.map(|value| value.sum_all().and_then(|sum| sum / ROWS as f64));
    let limits = (n.abs()? - 1.0)?.relu()?.broadcast_mul(&half)?.mean_all()?;
    let side = |offset: usize| -> Result<Tensor> {
        let rows: Vec<u32> =
            (0..ROWS as u32).filter(|row| Batch::is_noisy_copy(*row as usize)).map(|row| row - offset as u32).collect();
        q.index_select(&Tensor::new(rows, &Device::Cpu)?, 0)
    };
    let steadiness = (side(0)? - side(1)?)?.sqr()?.sum(1)?.mean_all()?;
    let reconstruction = (decode(&z_robot)? - &posture)?.broadcast_mul(&half)?.abs()?.mean_all()?;
    let cycle = (&z_human - perceptron(&networks.robot, parameters, &inside)?)?.abs()?.mean_all()?;
    let mut triplet = Tensor::zeros((), DType::F64, &Device::Cpu)?;
    for row in 0..ROWS {
        let other = (row + batch.shift) % ROWS;
        let members = [
            (z_human.get(row)?, &batch.human[row]),
            (z_human.get(other)?, &batch.human[other]),
            (z_robot.get(row)?, &batch.robot[row]),
        ];
        let anchor = usize::from(batch.anchor[row]);
        let mut rest = [(anchor + 1) % 3, (anchor + 2) % 3];
        let apart = |a: usize| s_gr(members[anchor].1, members[a].1);
        rest.sort_by(|a, b| apart(*a).total_cmp(&apart(*b)));
        let distance = |i: usize| (&members[anchor].0 - &members[i].0)?.sqr()?.sum_all()?.sqrt();
        let hinge = ((distance(rest[0])? - distance(rest[1])?)? + f64::from(MARGIN))?.relu()?;
        triplet = (triplet + (hinge / ROWS as f64)?)?;
    }
    Ok([kinematics?, angle?, limits, steadiness, triplet, reconstruction, cycle])
}

fn weightings() -> [(&'static str, Weighting); 8] {
    let none = Weighting::default();
    [
        ("kinematics", Weighting { kinematics: 10.0, ..none }),
        ("angle", Weighting { angle: 3.0, ..none }),
        ("limits", Weighting { limits: 5.0, ..none }),
        ("steadiness", Weighting { steadiness: 10.0, ..none }),
        ("triplet", Weighting { triplet: 1.0, ..none }),
        ("reconstruction", Weighting { reconstruction: 1.0, ..none }),
        ("cycle", Weighting { cycle: 0.2, ..none }),
        ("all", Weighting::OURS),
    ]
}

#[test]
fn gradients_match_autodiff() -> Result<()> {
    let networks = Networks::new(Size { hidden_layers: 3, hidden_width: 20 });
    let arm = arm();
    let mut parameters = networks.initial(11);
    // A steep last layer of the decoder drives some outputs over the limits. Biases away from zero test their gradient.
    let last = networks.decoder.layers.last().expect("the decoder has layers");
    parameters[last.weight.clone()].iter_mut().for_each(|w| *w *= 60.0);
    for layer in networks.named().iter().flat_map(|(_, mlp)| &mlp.layers) {
        parameters[layer.bias.clone()].iter_mut().enumerate().for_each(|(i, b)| *b = 0.1 * (i as f32).sin());
    }
    let mut shard = Shard::new(&networks, ROWS);
    shard.batch.draw(5, 3, 0, &arm, &Recorded::default(), &Mixture::default());
    let variable = Var::from_tensor(&tensor(&parameters, &[parameters.len()])?)?;
    for (name, weighting) in weightings() {
        let of_norm = if name == "steadiness" { 2e-4 } else { 2e-5 };
        let terms = shard.evaluate(&networks, &arm, &parameters, &weighting);
        let values = reference(&networks, &arm, variable.as_tensor(), &shard)?;
        // Value, weight and reference of every term. Twins are nearly equal, so f32 keeps fewer digits of their
        // difference.
        const STEADINESS: usize = 3;
        let of = [
            (terms.kinematics, weighting.kinematics),
            (terms.angle, weighting.angle),
            (terms.limits, weighting.limits),
            (terms.steadiness, weighting.steadiness),
            (terms.triplet, weighting.triplet),
            (terms.reconstruction, weighting.reconstruction),
            (terms.cycle, weighting.cycle),
        ];
        let mut loss = Tensor::zeros((), DType::F64, &Device::Cpu)?;
        for (index, ((ours, weight), value)) in of.iter().zip(&values).enumerate() {
            loss = (loss + (value * f64::from(*weight))?)?;
            let theirs = value.to_scalar::<f64>()?;
            // Triplets are checked only if they have a weight.
            let of_value = if index == STEADINESS { 1e-4 } else { 1e-5 };
            if *weight != 0.0 {
                assert!(*ours > 0.0, "{name}: a term is idle: {of:?}");
                assert!((ours - theirs).abs() <= of_value * theirs.abs().max(1e-3), "{name}: {ours} against {theirs}");
            }
        }
        let gradients = loss.backward()?;
        let want = gradients.get(&variable).expect("the loss depends on the parameters").to_vec1::<f64>()?;
        for (network, mlp) in networks.named() {
            let range = mlp.layers[0].weight.start..mlp.end();
            let norm = want[range.clone()].iter().map(|v| v * v).sum::<f64>().sqrt();
            let off = shard.gradient[range.clone()].iter().zip(&want[range]);
            let off = off.map(|(ours, theirs)| (f64::from(*ours) - theirs).powi(2)).sum::<f64>().sqrt();
            assert!(off <= of_norm * norm + 1e-9, "{name}, {network}: off by {off:e} of {norm:e}");
            let idle = (name == "triplet" && network == "decoder")
                || (name == "reconstruction" && network == "human")
                || (["kinematics", "angle", "limits", "steadiness"].contains(&name) && network == "robot");
            assert_eq!(norm == 0.0, idle, "{name}, {network}: which networks a term reaches");
        }
    }
    // The latent must be as wide as the tests assume.
    assert_eq!(networks.decoder.shape.input, LATENT);
    Ok(())
}
