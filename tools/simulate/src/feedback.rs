//! Judges feedback: if the robot does not follow its setpoints, or its measurements are wrong, it must be stopped.

use crate::modes::{Broken, moves};
use crate::oracle::Seen;
use messages::{Fault, Faults, JOINTS_MAX, Mode, RobotState, TICK_HZ, TICK_S};

/// Largest distance of a revolute joint from its setpoint, rad, and for how many ticks. The known lag of its
/// servo comes on top. The bounds of the simulated robot are 0.049 at once and 0.035 for 100 ms. A message and
/// a stop take time.
const AWAY_RAD: [(f64, u64); 2] = [(0.056, 30), (0.042, TICK_HZ / 10 + 60)];
/// The same for a prismatic joint, m: 0.028 at once and 0.0105 for 100 ms.
const AWAY_M: [(f64, u64); 2] = [(0.032, 30), (0.0125, TICK_HZ / 10 + 60)];
/// A measurement jumped if it moves by more than this, rad or m, beyond three times its joint's ability.
const JUMP: f64 = 0.03;
/// Consecutive samples after which a jump must have stopped the robot.
const JUMPED: u32 = 6;
/// A measurement froze if it stays identical for `STILL` ticks while its joint's setpoint moves and the joint
/// itself moves by `WENT` rad.
const STILL: u64 = TICK_HZ / 20 + 30;
const WENT: f64 = 0.024;
/// Without power, the driver's hold setpoint may lie this far from the joint, rad or m, for at most
/// `SAGGED_TICKS` ticks.
const SAGGED: f64 = 2e-3;
const SAGGED_TICKS: u32 = 20;
/// A joint that is at most this far outside its limits, rad or m, may have its hold setpoint at the limit.
const NUDGED: f64 = 5e-3;
/// Factor on the speed limit that bounds a joint without power.
const FALLS: f64 = 3.0;

/// State of a joint when its measurement last changed.
#[derive(Clone, Copy, Default)]
struct Still {
    measured: f64,
    reported: f64,
    truth: f64,
    k: u64,
}

#[derive(Clone, Default)]
pub struct Feedback {
    away: [[u64; 2]; JOINTS_MAX],
    good: Option<([f64; JOINTS_MAX], u64)>,
    jumped: u32,
    /// True if the mode of the previous tick permitted motion.
    moved: bool,
    /// State of each joint at the last change of its measurement.
    still: [Still; JOINTS_MAX],
    sagged: u32,
    /// True if an encoder was wrong since the robot lost power.
    lied: bool,
}

fn index(state: &RobotState) -> u64 {
    state.executed_k + state.plan_ticks_played
}

impl Feedback {
    pub fn check(&mut self, seen: &Seen<'_>, mode: Mode) -> Result<(), Broken> {
        if seen.driver_restarted {
            (self.good, self.jumped, self.sagged) = (None, 0, 0);
        }
        self.follows(seen, mode)?;
        self.sags(seen)?;
        if seen.moment.control.is_none() {
            return Ok(());
        }
        let Some(state) = &seen.moment.state_seen else { return Ok(()) };
        self.jumps(seen, state)?;
        self.stands(seen, state, mode)?;
        self.moved = moves(mode);
        Ok(())
    }

    /// The joints are near their setpoints, or nothing moves.
    fn follows(&mut self, seen: &Seen<'_>, mode: Mode) -> Result<(), Broken> {
        let Some(robot) = &seen.moment.robot else { return Ok(()) };
        let judged = moves(mode) && !seen.encoders_lie && !seen.undriven && seen.moment.control.is_some();
        for j in 0..seen.robot.count {
            let away = (robot.q[j] - seen.servo_lag_s * robot.v[j] - seen.truth[j]).abs();
            let bounds = if seen.robot.prismatic[j] { AWAY_M } else { AWAY_RAD };
            for (n, (bound, ticks)) in bounds.into_iter().enumerate() {
                let count = &mut self.away[j][n];
                *count = if judged && away > bound { *count + 1 } else { 0 };
                if *count > ticks {
                    let detail = format!("joint {j} is {away} away for {count} ticks, but the robot still moves");
                    return Err(("not followed", detail));
                }
            }
        }
        Ok(())
    }

    /// Joints that sink without power are held where they sink to, as soon as an encoder reports the place. If
    /// a wrong measurement lasted long enough for the joint to get there, it was accepted. The true measurement
    /// then needs the same time to be accepted.
    fn sags(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        let Some(robot) = &seen.moment.robot else { return Ok(()) };
        // A joint slightly outside its limits may be held at the limit.
        let off = |j: usize| {
            let (truth, limits) = (seen.truth[j], &seen.robot.limits[j]);
            let nearest = truth.clamp(limits.q_min, limits.q_max);
            let held = if (truth - nearest).abs() <= NUDGED { nearest } else { truth };
            (robot.q[j] - held).abs().min((robot.q[j] - truth).abs())
        };
        let worst = (0..seen.robot.count).max_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(0);
        let judged = seen.unpowered && !seen.encoders_lie;
        self.lied = seen.unpowered && (self.lied || seen.encoders_lie);
        self.sagged = if judged && off(worst) > SAGGED { self.sagged + 1 } else { 0 };
        // A posture is accepted as a whole, so the slowest joint decides.
        let back_ticks =
            (0..seen.robot.count).map(|j| off(j) / (FALLS * seen.robot.limits[j].v_max * TICK_S)).fold(0.0, f64::max);
        let allowed = SAGGED_TICKS + if self.lied { back_ticks.ceil() as u32 } else { 0 };
        if self.sagged > allowed {
            return Err(("without power", format!("joint {worst} is {} from its holding position", off(worst))));
        }
        Ok(())
    }

    /// A measurement that jumps and stays there stops the robot, and the status reports it.
    fn jumps(&mut self, seen: &Seen<'_>, state: &RobotState) -> Result<(), Broken> {
        let (q, k) = (state.q_measured, index(state));
        let Some((good, good_k)) = self.good.filter(|_| self.moved || self.jumped > 0) else {
            (self.good, self.jumped) = (Some((q, k)), 0);
            return Ok(());
        };
        let status = seen.moment.control.as_ref().map(|control| Faults(control.status.faults | control.status.latched));
        let is_reported = status.is_some_and(|faults| faults.has(Fault::FeedbackInvalid));
        let dt = k.saturating_sub(good_k).max(1) as f64 * TICK_S;
        let off = |j: usize| (q[j] - good[j]).abs() > 3.0 * seen.robot.limits[j].v_max * dt + JUMP;
        let Some(j) = (0..seen.robot.count).find(|&j| off(j)).filter(|_| !is_reported) else {
            (self.good, self.jumped) = (Some((q, k)), 0);
            return Ok(());
        };
        self.jumped += 1;
        if self.jumped > JUMPED {
            return Err(("encoder jump", format!("joint {j} from {} to {} without a fault", good[j], q[j])));
        }
        Ok(())
    }

    /// A measurement that freezes while its joint is sent on and moves stops the robot.
    fn stands(&mut self, seen: &Seen<'_>, state: &RobotState, mode: Mode) -> Result<(), Broken> {
        let k = index(state);
        for j in 0..seen.robot.count {
            let now = Still { measured: state.q_measured[j], reported: state.q[j], truth: seen.truth[j], k };
            let then = self.still[j];
            let went = (now.reported - then.reported).abs().min((now.truth - then.truth).abs());
            if then.measured != now.measured || !moves(mode) || k < then.k {
                self.still[j] = now;
            } else if k - then.k > STILL && went > seen.scale(j) * WENT {
                let detail = format!("joint {j} at {} for {} ticks, but went {went}", now.measured, k - then.k);
                return Err(("frozen encoder", detail));
            }
        }
        Ok(())
    }
}
