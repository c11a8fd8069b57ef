//! Adam with warm-up and cosine decay, and an exponential moving average of the parameters.

use crate::gemm::widest;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    pub peak: f64,
    pub warm_up: u64,
    /// Decay of Adam's second moment, 0..1.
    pub second_decay: f32,
    /// Steps of the whole run. The rate falls to zero there along a cosine.
    pub steps: u64,
}

impl Schedule {
    /// Returns the learning rate of `step`, counted from 0.
    pub fn rate(&self, step: u64) -> f64 {
        if step < self.warm_up {
            return self.peak * (step + 1) as f64 / self.warm_up as f64;
        }
        let done = (step - self.warm_up) as f64 / (self.steps.saturating_sub(self.warm_up)).max(1) as f64;
        0.5 * self.peak * (1.0 + (std::f64::consts::PI * done.min(1.0)).cos())
    }
}

/// Parameters with their moments and average. Besides the step, this is the whole state of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    pub parameters: Vec<f32>,
    /// Moving average of the parameters. The weights file contains this average.
    pub average: Vec<f32>,
    pub first: Vec<f32>,
    pub second: Vec<f32>,
}

/// Decay of the moving average (best in measurements of the prototype).
const AVERAGE_DECAY: f32 = 0.998;
/// Decay of the first moment (Kingma and Ba 2015, the default).
const FIRST_DECAY: f32 = 0.9;
/// Floor of the denominator (Kingma and Ba 2015).
const EPSILON: f32 = 1e-8;

impl Adam {
    pub fn new(parameters: Vec<f32>) -> Self {
        let zeros = vec![0.0; parameters.len()];
        Self { average: parameters.clone(), parameters, first: zeros.clone(), second: zeros }
    }

    /// Takes one step along the mean of two gradients. `step` counts from 0.
    pub fn step(&mut self, gradients: [&[f32]; 2], step: u64, schedule: &Schedule) {
        let (rate, second_decay) = (schedule.rate(step), schedule.second_decay);
        let power = (step + 1) as f64;
        // Bias corrections 1 - beta^t, folded into the rate and the denominator.
        let first = 1.0 / (1.0 - f64::from(FIRST_DECAY).powf(power));
        let second = (1.0 / (1.0 - f64::from(second_decay).powf(power))).sqrt();
        // The average must not contain the random start, so it begins as a plain mean.
        let decay = AVERAGE_DECAY.min(1.0 - 1.0 / (power as f32 + 1.0));
        widest(|| update(self, gradients, (rate * first) as f32, [second as f32, second_decay], decay));
    }
}

#[inline(always)]
fn update(adam: &mut Adam, [left, right]: [&[f32]; 2], rate: f32, [scale, second_decay]: [f32; 2], decay: f32) {
    let n = adam.parameters.len();
    let (parameters, average) = (&mut adam.parameters[..n], &mut adam.average[..n]);
    let (first, second) = (&mut adam.first[..n], &mut adam.second[..n]);
    let (left, right) = (&left[..n], &right[..n]);
    for i in 0..n {
        let gradient = 0.5 * (left[i] + right[i]);
        first[i] = FIRST_DECAY * first[i] + (1.0 - FIRST_DECAY) * gradient;
        second[i] = second_decay * second[i] + (1.0 - second_decay) * gradient * gradient;
        parameters[i] -= rate * first[i] / (second[i].sqrt() * scale + EPSILON);
        average[i] = decay * average[i] + (1.0 - decay) * parameters[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn learning_rate_rises_over_the_warm_up_and_falls_to_zero() {
        let schedule = Schedule { peak: 1e-3, warm_up: 500, second_decay: 0.999, steps: 40_000 };
        assert!(schedule.rate(0) < 3e-6);
        assert!((schedule.rate(500) - 1e-3).abs() < 1e-12);
        assert!((schedule.rate(20_250) - 5e-4).abs() < 1e-9);
        assert!(schedule.rate(39_999) < 1e-10);
        assert!(schedule.rate(90_000) < 1e-10);
    }

    #[test]
    fn first_adam_step_moves_by_the_rate_against_the_gradient() {
        let mut adam = Adam::new(vec![1.0, 1.0, 1.0]);
        let schedule = Schedule { peak: 0.01, warm_up: 0, second_decay: 0.999, steps: 10 };
        adam.step([&[0.5, -2.0, 0.0], &[1.5, -2.0, 0.0]], 0, &schedule);
        for (got, want) in adam.parameters.iter().zip([0.99, 1.01, 1.0]) {
            assert!((got - want).abs() < 1e-6);
        }
    }
}
