//! Motion of a gripper: one number from 0 (open) to 1 (closed), with a largest speed.
//!
//! With the largest speed V and the time constant T = [`RAMP_S`], the rate follows the way d to the goal:
//!
//! ```text
//! r' = d / T     within [-V, V], and at most V / T away from r per second
//! c' = c + (r + r') dt / 2
//! ```
//!
//! A rate that falls with the way falls by at most V / T a second. So a gripper that starts at rest overshoots nothing.

use messages::{GripperMotion, GripperState, TICK_S};

/// Time constant, and the time in which a gripper gets its full speed, s. Assumption: fingers without a load. It also
/// takes the tremble out of a camera's closure.
pub const RAMP_S: f64 = 0.1;
/// Ticks that a gripper makes up for at once, after a pause of its driver: 10 ms.
const TICKS_MAX: u64 = 15;
/// Rounding of a closure and of a rate.
const ROUNDING: f64 = 1e-9;

/// Largest closing speed of the left and of the right gripper, 1/s. Zero for a hand without one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Grippers(pub [f64; 2]);

impl Grippers {
    /// Returns the motion one tick after `now`. Each gripper goes to its goal, or brakes without one. NaN is no goal.
    pub fn toward(&self, now: &GripperMotion, goals: [Option<f64>; 2]) -> GripperMotion {
        let mut next = *now;
        for (side, (speed, goal)) in self.0.into_iter().zip(goals).enumerate() {
            let goal = goal.filter(|goal| !goal.is_nan());
            (next.closure[side], next.rate[side]) = toward(speed, now.closure[side], now.rate[side], goal);
        }
        next
    }

    /// Returns true if `next` may follow `now` after `ticks` ticks. False for NaN, and for any motion of a hand without a
    /// gripper.
    fn continues(&self, now: &GripperMotion, next: &GripperMotion, ticks: u64) -> bool {
        let elapsed_s = ticks as f64 * TICK_S;
        (0..2).all(|side| {
            let (speed, closure, rate) = (self.0[side], next.closure[side], next.rate[side]);
            let moved = (closure - now.closure[side]).abs();
            // Fingers that meet stop at once.
            let at_end = rate == 0.0 && (closure == 0.0 || closure == 1.0);
            (0.0..=1.0).contains(&closure)
                && rate.abs() <= speed + ROUNDING
                && moved <= speed * elapsed_s + ROUNDING
                && ((rate - now.rate[side]).abs() <= speed / RAMP_S * elapsed_s + ROUNDING || at_end)
        })
    }

    /// Returns the motion `ticks` later. A command that continues `now` is taken as it is. Another one is approached.
    /// Without a command the grippers brake, and hold what they hold.
    pub(crate) fn after(&self, now: &GripperMotion, ticks: u64, command: Option<&GripperMotion>) -> GripperMotion {
        let ticks = ticks.min(TICKS_MAX);
        if let Some(command) = command.filter(|command| ticks > 0 && self.continues(now, command, ticks)) {
            return *command;
        }
        let goals = command.map_or([None; 2], |command| command.closure.map(Some));
        (0..ticks).fold(*now, |now, _| self.toward(&now, goals))
    }

    /// Returns grippers at rest at the robot's own setpoints. Returns `None` if a setpoint is not finite.
    pub(crate) fn at_rest(&self, measured: &GripperState) -> Option<GripperMotion> {
        let mut rest = GripperMotion { closure: [0.0; 2], rate: [0.0; 2] };
        for side in (0..2).filter(|&side| self.0[side] > 0.0) {
            let held = measured.setpoint[side];
            if !held.is_finite() {
                return None;
            }
            rest.closure[side] = held.clamp(0.0, 1.0);
        }
        Some(rest)
    }
}

fn toward(speed: f64, closure: f64, rate: f64, goal: Option<f64>) -> (f64, f64) {
    let wanted = goal.map_or(0.0, |goal| (goal.clamp(0.0, 1.0) - closure) / RAMP_S).clamp(-speed, speed);
    let change = speed / RAMP_S * TICK_S;
    let next = wanted.clamp(rate - change, rate + change);
    let moved = closure + (rate + next) / 2.0 * TICK_S;
    if (0.0..=1.0).contains(&moved) { (moved, next) } else { (moved.clamp(0.0, 1.0), 0.0) }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use rand::{RngExt, SeedableRng};

    const GRIPPERS: Grippers = Grippers([2.0, 0.5]);
    const OPEN: GripperMotion = GripperMotion { closure: [0.0; 2], rate: [0.0; 2] };

    #[test]
    fn gripper_gets_there_and_overshoots_nothing() {
        let mut now = OPEN;
        for k in 0..1500 {
            let next = GRIPPERS.toward(&now, [Some(0.6), None]);
            assert!(GRIPPERS.continues(&now, &next, 1), "{k} {now:?} {next:?}");
            assert!(next.closure[0] <= 0.6 && next.closure[0] >= now.closure[0] && next.closure[1] == 0.0);
            now = next;
        }
        assert!((now.closure[0] - 0.6).abs() < 1e-3, "{now:?}");
    }

    #[test]
    fn every_goal_gives_an_admissible_motion() {
        let (mut rng, mut now) = (rand_pcg::Pcg64Mcg::seed_from_u64(7), OPEN);
        let mut goal = [None; 2];
        for k in 0..200_000 {
            if k % 97 == 0 {
                let one = |rng: &mut rand_pcg::Pcg64Mcg| match rng.random_range(0..8) {
                    0 => None,
                    1 => Some(f64::NAN),
                    2 => Some(f64::INFINITY),
                    3 => Some(-1.0),
                    _ => Some(rng.random_range(0.0..1.0)),
                };
                goal = [one(&mut rng), one(&mut rng)];
            }
            let next = GRIPPERS.toward(&now, goal);
            assert!(GRIPPERS.continues(&now, &next, 1), "{k}: {goal:?} {now:?} {next:?}");
            now = next;
        }
    }

    #[test]
    fn step_and_nan_are_no_continuation() {
        let refused = [
            GripperMotion { closure: [0.1, 0.0], ..OPEN },
            GripperMotion { rate: [0.1, 0.0], ..OPEN },
            GripperMotion { closure: [f64::NAN, 0.0], ..OPEN },
            GripperMotion { rate: [0.0, f64::NAN], ..OPEN },
            GripperMotion { closure: [-1e-12, 0.0], ..OPEN },
        ];
        for next in refused {
            assert!(!GRIPPERS.continues(&OPEN, &next, 1), "{next:?}");
        }
        assert!(!Grippers::default().continues(&OPEN, &GripperMotion { closure: [1e-6, 0.0], ..OPEN }, 1));
    }

    #[test]
    fn driver_takes_a_step_slowly_and_brakes_without_a_command() {
        let step = GripperMotion { closure: [1.0, 1.0], ..OPEN };
        let mut now = OPEN;
        for _ in 0..300 {
            let next = GRIPPERS.after(&now, 1, Some(&step));
            assert!(GRIPPERS.continues(&now, &next, 1));
            now = next;
        }
        assert!(now.closure[0] > 0.2 && now.rate[0] > 1.0, "{now:?}");
        let stopped = (0..150).fold(now, |now, _| GRIPPERS.after(&now, 1, None));
        assert!(stopped.rate == [0.0; 2] && stopped.closure[0] > now.closure[0] && stopped.closure[0] < 1.0);
        let nan = GripperMotion { closure: [f64::NAN; 2], ..OPEN };
        assert!(GRIPPERS.after(&now, u64::MAX, Some(&nan)).closure[0] > 0.0);
    }

    #[test]
    fn short_pause_of_the_driver_brakes_no_gripper() {
        let (mut ahead, mut now) = (OPEN, OPEN);
        for k in 1..600 {
            ahead = GRIPPERS.toward(&ahead, [Some(1.0), None]);
            // Every hundredth command comes after a pause of 1 to 8 ticks.
            let pause = k / 100 + 2;
            if k % 100 >= pause || k % 100 == 0 {
                now = GRIPPERS.after(&now, if k % 100 == pause { pause } else { 1 }, Some(&ahead));
            }
            assert!((now.rate[0] - ahead.rate[0]).abs() < 0.2, "{k}: {now:?} {ahead:?}");
        }
    }

    #[test]
    fn grippers_begin_at_the_robots_setpoint() {
        let pressing = GripperState { closure: [0.5, 0.2], force_n: [20.0, 0.0], setpoint: [1.004, 0.2] };
        assert_eq!(GRIPPERS.at_rest(&pressing), Some(GripperMotion { closure: [1.0, 0.2], rate: [0.0; 2] }));
        assert_eq!(GRIPPERS.at_rest(&GripperState { setpoint: [f64::NAN, 0.0], ..pressing }), None);
        assert_eq!(
            Grippers([0.0, 0.5])
                .at_rest(&GripperState { setpoint: [f64::NAN, 0.2], ..pressing })
                .map(|rest| rest.closure),
            Some([0.0, 0.2])
        );
    }
}
