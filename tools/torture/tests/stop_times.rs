//! No stop is longer than its bound, and the bound is tight.

use crate::subject;
use messages::{JOINTS_MAX, TICK_S};
use torture::cli::Changes;
use torture::stop_times::{joint_bound_at_s, joint_bound_s, run, stop_bound_s};

#[test]
fn no_state_takes_longer_to_stop_than_its_bound() {
    let subject = subject(Changes::default());
    let bounds = subject.wbc.bounds();
    let times = run(bounds, 20_000, 3, 2, |_| ());
    assert_eq!((times.states, times.exceeded()), (20_000, 0), "{times:?}");
    for (j, (joint, limits)) in times.joints.iter().zip(bounds).enumerate() {
        let (worst, bound) = (joint.stop_s, joint_bound_s(limits));
        assert!(worst > 0.999 * bound, "joint {j}: {worst} s of {bound} s: the bound is loose, or no state was hard");
    }
    // The same on any number of threads.
    assert_eq!(times, run(bounds, 20_000, 3, 1, |_| ()));
}

#[test]
fn stop_bound_of_a_state_is_that_of_its_slowest_joint() {
    let subject = subject(Changes::default());
    let bounds = subject.wbc.bounds();
    let mut v = [0.0; JOINTS_MAX];
    v[5] = -1.0;
    let expected = joint_bound_at_s(&bounds[5], 1.0) + 3.0 * TICK_S;
    assert!((stop_bound_s(bounds, &v) - expected).abs() < 1e-15);
}
