//! The learning rate over the steps.

use serde::{Deserialize, Serialize};

use crate::error::{Result, TrainError};

/// Linear warm-up, then half a cosine down to a share of the peak.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Steps in all.
    pub steps: u64,
    /// Steps of the warm-up.
    pub warm_up: u64,
    /// Largest learning rate.
    pub peak: f64,
}

/// Share of the peak at the last step.
const FLOOR: f64 = 0.01;

impl Schedule {
    /// The learning rate of a step.
    ///
    /// # Formula
    /// `peak (step + 1) / warm_up` before `warm_up`, then `peak (floor + (1 - floor) (1 + cos(pi x)) / 2)`, x from 0 to 1 over the rest.
    pub fn rate(&self, step: u64) -> f64 {
        if step < self.warm_up {
            return self.peak * (step + 1) as f64 / self.warm_up as f64;
        }
        let rest = self.steps.saturating_sub(self.warm_up).max(1);
        let share = ((step - self.warm_up) as f64 / rest as f64).min(1.0);
        let cosine = libm::cos(std::f64::consts::PI * share);
        self.peak * (FLOOR + (1.0 - FLOOR) * 0.5 * (1.0 + cosine))
    }

    /// Fails when a value is out of its range.
    ///
    /// # Errors
    /// The first value out of its range.
    pub fn validate(&self) -> Result<()> {
        if !(1..=1_000_000_000).contains(&self.steps) {
            return Err(TrainError::config("steps", "1 to 1000000000", self.steps));
        }
        if self.warm_up > self.steps {
            return Err(TrainError::config("warm_up", format!("at most {} steps", self.steps), self.warm_up));
        }
        if self.peak > 0.0 && self.peak <= 1.0 {
            return Ok(());
        }
        Err(TrainError::config("peak learning rate", "above 0, at most 1", self.peak))
    }
}

#[cfg(test)]
mod tests {
    use super::Schedule;

    #[test]
    fn up_then_down() {
        let schedule = Schedule { steps: 110, warm_up: 10, peak: 2.0 };
        assert_eq!(schedule.rate(0), 0.2);
        assert_eq!(schedule.rate(9), 2.0);
        assert!((schedule.rate(60) - 1.01).abs() < 1e-12);
        assert!((schedule.rate(110) - 0.02).abs() < 1e-12);
        let rates: Vec<f64> = (10..110).map(|step| schedule.rate(step)).collect();
        assert!(rates.is_sorted_by(|a, b| a > b));
    }
}
