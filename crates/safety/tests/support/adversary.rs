//! An attacker that tries to make the gate send commands which break a limit, and a judge of everything that it sends.

use judge::Robot;
use judge::joint::{Joint, rest_of, stop_of};
use judge::limits::{Breach, Slack};
use messages::{JOINTS_MAX, JointMotion, Layout, Stamp, StopPlan};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::Model;
use safety::engage::Permit;
use safety::gate::{Config, Decision, Denial, Proposed, State, Verdict, tick};

use super::JOINTS;
use super::motion::{T, joint, set_joint, stop_from, store};

/// Slack of the judge for rounding, SI. It is above the gate's own slack of 5.8e-11 and far below any motion.
const GRANTED: f64 = 1e-9;

/// Result of an attack.
#[derive(Clone, Debug, Default)]
pub struct Report {
    pub ticks: u64,
    pub accepted: u64,
    pub on_plan: u64,
    pub denied: u64,
    /// Number of denials of damaged proposals whose damage the judge sees too.
    pub damaged: u64,
    /// Number of denials for clearance.
    pub clearance: u64,
    /// Number of denials, other than for clearance, of undamaged proposals. It must be zero.
    pub honest_denied: u64,
    pub violations: Vec<String>,
}

pub struct Adversary {
    rng: Pcg64,
    robot: Robot,
    config: Config,
    state: State,
    /// The same, but every pair is looked at.
    thorough: (Config, State),
    k: u64,
    permit: Permit,
    /// Direction in which each joint is pushed, as a share of its jerk limit.
    push: [f64; JOINTS_MAX],
    pub report: Report,
}

impl Adversary {
    pub fn new(model: &Model, seed: u64) -> Self {
        let config = Config::new(model).expect("the robot's limits are allowed");
        Self {
            rng: Pcg64::seed_from_u64(seed),
            robot: Robot::new(model.clone()),
            thorough: (config.clone().without_known_for_tests(), State::at_rest(model.home)),
            config,
            state: State::at_rest(model.home),
            k: 10,
            permit: Permit::Follow { speed_scale: 1.0 },
            push: [0.0; JOINTS_MAX],
            report: Report::default(),
        }
    }

    fn sent(&self) -> Proposed {
        Proposed { k: self.k, permit: self.permit, motion: self.state.motion() }
    }

    /// A proposal at the edge of the allowed range. Every joint goes as far in its direction as a few tries reach.
    fn at_the_edge(&mut self, last: &Proposed) -> Proposed {
        let mut next = Proposed { k: self.k + 1, ..*last };
        for j in 0..JOINTS {
            let (x, before, l) = (joint(&last.motion, j), stop_of(&last.motion.plan, j), self.robot.limits[j]);
            // The direction changes every second or so. This is long enough to reach any place in the range,
            // and its edge.
            if self.rng.random_bool(0.001) {
                self.push[j] = [-1.0, 1.0, -0.3, 0.3, 0.0][self.rng.random_range(0..5)];
            }
            let (on_plan, rest) = (x.play(&before, T), rest_of(&before, T));
            let (mut chosen, mut stop) = (on_plan, rest);
            let wish = self.push[j] * l.j_max;
            // Tries the wish, then a part of it, then no jerk, then the opposite.
            for jerk in [wish, wish * self.rng.random_range(0.0..1.0), 0.0, -wish] {
                let to = x.after(jerk, T);
                let brake = stop_from(to, l.a_max, l.j_max);
                if judge::limits::tick(&l, x, &before, to, &brake, Slack::for_grant(0.0)).is_none() {
                    (chosen, stop) = (to, brake);
                    break;
                }
            }
            set_joint(&mut next, j, chosen);
            store(&mut next.motion.plan, j, &stop);
        }
        next
    }

    /// Damages a proposal in one of many ways.
    fn damage(&mut self, p: &mut Proposed) {
        let j = self.rng.random_range(0..JOINTS);
        let l = self.robot.limits[j];
        let size = 10_f64.powf(self.rng.random_range(-10.0..2.0)) * if self.rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let bits = f64::from_bits(self.rng.next_u64());
        let phase = self.rng.random_range(0..3);
        match self.rng.random_range(0..14) {
            0 => p.motion.q[j] += size,
            1 => p.motion.v[j] += size,
            2 => p.motion.a[j] += size,
            3 => p.motion.q[j] = bits,
            4 => p.motion.v[j] = bits,
            5 => p.motion.a[j] = bits,
            6 => p.motion.plan.jerk[j][phase] = bits,
            7 => p.motion.plan.duration_s[j][phase] = bits,
            8 => p.motion.plan.duration_s[j][phase] += size,
            9 => p.motion.plan.jerk[j][phase] *= 1.0 + size,
            10 => p.motion.plan = StopPlan::ZERO,
            11 => p.motion.q[j] = [l.q_min, l.q_max][phase % 2] + size * 1e-3,
            12 => p.k = p.k.wrapping_add(self.rng.random_range(0..4)),
            _ => {
                let x = joint(&p.motion, j).after(size, T);
                set_joint(p, j, x);
            }
        }
    }

    /// Starts both gates again near where they are, at rest, as a driver does. From then on the robot may `recover`, or follow.
    pub fn reseed(&mut self, recover: bool) {
        let q = self.state.motion().q;
        let there = std::array::from_fn(|j| if j < JOINTS { q[j] + self.rng.random_range(-0.1..0.1) } else { q[j] });
        let seed = JointMotion::rest(there);
        self.state.reseed(&seed);
        self.thorough.1.reseed(&seed);
        self.permit = if recover { Permit::Recover } else { Permit::Follow { speed_scale: 1.0 } };
    }

    /// Does one tick and judges it.
    pub fn step(&mut self) {
        let last = self.sent();
        let mut proposed = self.at_the_edge(&last);
        let damaged = self.rng.random_bool(0.3);
        if damaged {
            self.damage(&mut proposed);
        }
        let decision = tick(&self.config, &mut self.state, Stamp(0), proposed);
        let (config, state) = &mut self.thorough;
        let thorough = tick(config, state, Stamp(0), proposed);
        let same = (thorough.verdict, thorough.motion) == (decision.verdict, decision.motion);
        if !same || thorough.clearance_m.to_bits() != decision.clearance_m.to_bits() {
            self.report.violations.push(format!("tick {}: {thorough:?} without bounds", self.report.ticks));
        }
        let index_ok = proposed.k == self.k + 1;
        self.judge_as_a_whole(&last, &proposed, &decision);
        self.k = self.k.max(proposed.k);
        self.report.ticks += 1;
        match decision.verdict {
            Verdict::Accept => self.report.accepted += 1,
            Verdict::OnPlan => self.report.on_plan += 1,
            Verdict::Deny(denial) => {
                self.report.denied += 1;
                let of_clearance = matches!(
                    denial,
                    Denial::ClearanceAtCommand { .. }
                        | Denial::ClearanceAtRest { .. }
                        | Denial::ClearanceOnTheWay { .. }
                );
                self.report.clearance += u64::from(of_clearance);
                self.report.honest_denied += u64::from(!damaged && !of_clearance);
                self.report.damaged += u64::from(!index_ok || self.is_wrong(&last, &proposed));
            }
        }
        // A command for a later index plays several ticks of the plan. The judge of single steps does not apply there.
        if index_ok {
            self.judge(&last, &decision);
        }
    }

    fn is_wrong(&self, last: &Proposed, p: &Proposed) -> bool {
        (0..JOINTS).any(|j| self.broken(j, last, joint(&p.motion, j), &p.motion.plan).is_some())
    }

    fn broken(&self, j: usize, last: &Proposed, next: Joint, plan: &StopPlan) -> Option<Breach> {
        let (limits, before) = (&self.robot.limits[j], stop_of(&last.motion.plan, j));
        judge::limits::tick(limits, joint(&last.motion, j), &before, next, &stop_of(plan, j), Slack::for_grant(GRANTED))
    }

    /// All joints must do the same. Either all follow the proposal, or all play the rest of the stored plan
    /// for as many ticks as have passed.
    fn judge_as_a_whole(&mut self, last: &Proposed, proposed: &Proposed, sent: &Decision) {
        let passed = proposed.k.saturating_sub(self.k) as f64 * T;
        for j in 0..JOINTS {
            let got = joint(&sent.motion, j);
            let (expected, plan) = if sent.accepted() {
                // A joint without a remaining stop is at rest by definition.
                let stop = stop_of(&proposed.motion.plan, j);
                (joint(&proposed.motion, j).play(&stop, 0.0), stop)
            } else {
                let stop = stop_of(&last.motion.plan, j);
                (joint(&last.motion, j).play(&stop, passed), rest_of(&stop, passed))
            };
            let rest = got.play(&stop_of(&sent.motion.plan, j), 1e3).q - expected.play(&plan, 1e3).q;
            // NaN counts as not near.
            let near = [got.q - expected.q, got.v - expected.v, got.a - expected.a, rest];
            if !near.iter().all(|difference| difference.abs() <= GRANTED) {
                let at = self.report.ticks;
                self.report.violations.push(format!("tick {at} joint {j} goes its own way: {last:?} {sent:?}"));
            }
        }
    }

    fn judge(&mut self, last: &Proposed, sent: &Decision) {
        let mut rest = [0.0; JOINTS_MAX];
        for (j, rest) in rest.iter_mut().enumerate() {
            let next = joint(&sent.motion, j);
            *rest = next.play(&stop_of(&sent.motion.plan, j), 1e3).q;
            if let Some(Breach { what, .. }) = self.broken(j, last, next, &sent.motion.plan) {
                self.report.violations.push(format!("tick {} joint {j}: {what}: {last:?} {sent:?}", self.report.ticks));
            }
        }
        if sent.verdict == Verdict::Accept {
            for q in [&sent.motion.q, &rest] {
                let clearance = self.robot.clearance(q);
                if clearance < self.robot.d_min_m - 1e-8 {
                    self.report.violations.push(format!("tick {}: clearance {clearance}", self.report.ticks));
                }
            }
        }
    }
}
