//! The final check of every command, under any proposal and any seed.

use crate::bytes::Bytes;
use crate::robots::MODEL;
use messages::{JOINTS_MAX, JointMotion, Layout, Stamp, StopPlan, TICK_S};
use robot::Model;
use safety::engage::Permit;
use safety::gate::{Config, Decision, Proposed, State, Verdict, tick};
use std::sync::LazyLock;

/// Joints of TIAGo++.
const JOINTS: usize = 17;

const TICKS_MAX: usize = 64;
/// Tolerance for the rounding of units (2^-40) and of doubles.
const SLACK: f64 = 1e-9;

static CONFIG: LazyLock<Config> = LazyLock::new(|| Config::new(&MODEL).expect("its limits"));

/// Runs the input. Each tick starts with a byte: the proposal, the number of its overwritten numbers, and the permit. A
/// proposal is an honest step, whose jerks follow, or the last state again. Any 64 bits can overwrite a number.
pub(crate) fn run(input: &[u8]) {
    let (model, config) = (&*MODEL, &*CONFIG);
    let mut bytes = Bytes::new(input);
    let mut state = State::at_rest(model.home);
    // No reseed has moved the state, so everything sent was judged before.
    let mut judged = true;
    let mut k = 1000;
    for _ in 0..TICKS_MAX {
        if bytes.is_empty() {
            return;
        }
        let head = bytes.u8();
        k += 1;
        let (mut proposed, patches) = (honest(model, &state, k, &mut bytes, head), (head >> 2) % 8);
        for _ in 0..patches {
            let (place, bits) = (usize::from(bytes.u8()), bytes.f64());
            *number(&mut proposed, place) = bits;
        }
        proposed.permit = match head >> 5 {
            0 => Permit::Stop,
            1 => Permit::Recover,
            2 => Permit::Follow { speed_scale: bytes.f64() },
            _ => Permit::Follow { speed_scale: 1.0 },
        };
        if head == 0xff {
            (proposed.k, judged) = (bytes.u64(), false);
        }
        if head == 0xfe {
            let [q, v, a] = [bytes.joints(), bytes.joints(), bytes.joints()];
            state.reseed(&JointMotion { q, v, a, plan: proposed.motion.plan });
            judged = false;
        }
        let (before, denials) = (state.motion(), state.denials());
        let out = tick(config, &mut state, Stamp(1), proposed);
        finite(&out);
        assert_eq!(state.denials() - denials, u64::from(!out.accepted()), "every denial is counted");
        assert!(out.verdict != Verdict::Accept || proposed.permit != Permit::Stop, "moved without a permit");
        if judged {
            within(model, &before, &out);
        }
    }
}

/// Returns one tick with these jerks from the last state, and a stop from there. Or it returns the last state again.
fn honest(model: &Model, state: &State, k: u64, bytes: &mut Bytes<'_>, head: u8) -> Proposed {
    let JointMotion { mut q, mut v, mut a, mut plan } = state.motion();
    if head & 3 != 0 {
        plan = StopPlan::ZERO;
    }
    for j in 0..JOINTS {
        if head & 3 == 0 {
            break;
        }
        // Share of a joint's jerk limit, -1 to 1.
        let share = if head & 3 == 3 || j % 4 == 0 { f64::from(bytes.u8() as i8) / 128.0 } else { 0.0 };
        let (jerk, t) = (share * model.limits[j].j_max, TICK_S);
        q[j] += v[j] * t + a[j] * t * t / 2.0 + jerk * t * t * t / 6.0;
        v[j] += a[j] * t + jerk * t * t / 2.0;
        a[j] += jerk * t;
        // The stop removes the acceleration, then the speed. At small speeds it stays below the acceleration
        // limit. This is enough here.
        let most = 0.99 * model.limits[j].j_max;
        let speed = v[j] + a[j] * a[j].abs() / (2.0 * most);
        let half = (speed.abs() / most).sqrt();
        plan.jerk[j] = [-a[j].signum() * most, -speed.signum() * most, speed.signum() * most];
        plan.duration_s[j] = [a[j].abs() / most, half, half];
    }
    Proposed { k, permit: Permit::Stop, motion: JointMotion { q, v, a, plan } }
}

fn number(proposed: &mut Proposed, place: usize) -> &mut f64 {
    let j = place % JOINTS;
    match place / JOINTS_MAX {
        0..=2 => &mut proposed.motion.q[j],
        3..=5 => &mut proposed.motion.v[j],
        6..=8 => &mut proposed.motion.a[j],
        i @ 9..=11 => &mut proposed.motion.plan.jerk[j][i - 9],
        i => &mut proposed.motion.plan.duration_s[j][i % 3],
    }
}

fn finite(out: &Decision) {
    let JointMotion { q, v, a, plan } = &out.motion;
    let phases = plan.jerk.iter().chain(&plan.duration_s).flatten();
    assert!(q.iter().chain(v).chain(a).chain(phases).all(|x| x.is_finite()), "{out:?}");
}

/// Checks that a robot that began at rest within its limits stays within them, whatever the proposal.
fn within(model: &Model, before: &JointMotion, out: &Decision) {
    for j in 0..JOINTS {
        let (limits, t) = (&model.limits[j], TICK_S);
        let (q, v, a) = (out.motion.q[j], out.motion.v[j], out.motion.a[j]);
        assert!(q >= limits.q_min - SLACK && q <= limits.q_max + SLACK, "joint {j} at {q}, {limits:?}");
        assert!(v.abs() <= limits.v_max + SLACK, "joint {j} at {v} per second, {limits:?}");
        assert!(a.abs() <= limits.a_max + SLACK, "joint {j}: acceleration {a}, {limits:?}");
        let (dq, dv) = (q - before.q[j], v - before.v[j]);
        assert!(dq.abs() <= limits.v_max * t + SLACK, "joint {j} jumps by {dq}");
        assert!(dv.abs() <= limits.a_max * t + SLACK, "joint {j}: speed jumps by {dv}");
        let da = (a - before.a[j]).abs();
        assert!(da <= limits.j_max * t + 1e-6, "joint {j}: acceleration jumps by {da}");
    }
}
