//! Tests that a sender which computes the plan itself, in `f64`, stays on the plan to its end.

use crate::support::motion::{T, joint, resting, set_joint, set_stopping, store};
use crate::support::{JOINTS, model};
use judge::joint::{Joint, stop_of};
use messages::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use safety::engage::Permit;
use safety::gate::{Config, Proposed, State, Verdict, tick};

/// Goes one tick along the plan. Durations shrink, phases are used up, and the end is exact rest.
fn advance(p: &mut Proposed) {
    for j in 0..JOINTS {
        let (mut x, mut stop, mut left) = (joint(&p.motion, j), stop_of(&p.motion.plan, j), T);
        for (jerk, duration) in &mut stop {
            let t = left.min(*duration);
            x = x.after(*jerk, t);
            *duration -= t;
            left -= t;
        }
        if stop.iter().all(|(_, duration)| *duration == 0.0) {
            (x.v, x.a) = (0.0, 0.0);
        }
        set_joint(p, j, x);
        store(&mut p.motion.plan, j, &stop);
    }
    p.k += 1;
}

#[test]
fn f64_motion_stays_on_plan_from_any_state_to_rest() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let mut rng = Pcg64::seed_from_u64(9);
    for _ in 0..100 {
        let mut p = Proposed { permit: Permit::Stop, ..resting(0, model.home) };
        for j in 0..JOINTS {
            let l = &model.limits[j];
            let a = rng.random_range(-l.a_max..l.a_max);
            let x = Joint { q: model.home[j], v: rng.random_range(-l.v_max..l.v_max), a };
            set_stopping(&mut p, j, x, l);
        }
        let mut state = State::at_rest(model.home);
        state.reseed(&p.motion);
        for _ in 0..1500 {
            advance(&mut p);
            let decision = tick(&config, &mut state, Stamp(0), p);
            assert_eq!(decision.verdict, Verdict::OnPlan, "tick {}", p.k);
        }
        assert!(state.motion().is_at_rest());
    }
}
