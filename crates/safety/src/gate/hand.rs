//! Checks the speed of elbows and hands in the base frame, at the command and at the samples of its stop.
//!
//! A point p of an arm moves with p' = sum_k J_k q_k'. For a revolute joint about z_k through o_k, J_k is z_k
//! x (p - o_k). For a prismatic joint it is z_k. The length of J_k is at most the lever R_k (see `body`).
//!
//! Let V_k be the largest speed of joint k on the whole way. If sum_k R_k V_k <= bound, the point needs no
//! kinematics. Otherwise the velocity is computed at the command and at the same instants as the clearance. Let B
//! be the bound on the acceleration of a point. Between two instants that are dt apart, the point may be
//! faster by at most B dt / 2. Whole-body control proves that it is not.

use messages::JOINTS_MAX;

use super::body::{Body, Places, unplaced};
use super::denial::Denial;
use super::fixed::{Point, UNITS};
use super::stop::Stop;
use super::stop_clearance::{positions, sample_times};

/// Rounding of a speed, m/s. The rounding of positions and speeds is below 1e-10 rad and rad/s, that of
/// levers below 1e-14 m.
const SPEED_SLACK_M_PER_S: f64 = 1e-9;

/// Checks that elbows and hands are no faster than `max_m_per_s` at the command `next` and at the samples of `stops`.
pub(super) fn judge(
    body: &Body,
    max_m_per_s: f64,
    next: &[Point; JOINTS_MAX],
    stops: &[Stop; JOINTS_MAX],
) -> Result<(), Denial> {
    let fastest: [f64; JOINTS_MAX] = std::array::from_fn(|j| stops[j].v as f64 / UNITS);
    let left = (0..body.point_count()).fold(0, |left, i| {
        let slow = body.fastest(i, &fastest) <= max_m_per_s;
        if slow { left } else { left | 1 << i }
    });
    if left == 0 {
        return Ok(());
    }
    let mut places = unplaced();
    at(body, max_m_per_s, next, left, &mut places)?;
    sample_times(stops).into_iter().try_for_each(|time| {
        let x = std::array::from_fn(|j| stops[j].at(time));
        at(body, max_m_per_s, &x, left, &mut places)
    })
}

/// Checks the points of the set `left`.
fn at(body: &Body, max_m_per_s: f64, x: &[Point; JOINTS_MAX], left: u32, places: &mut Places) -> Result<(), Denial> {
    let points = || (0..body.point_count()).filter(|i| left & 1 << i != 0);
    body.place(&positions(x), points().fold(0, |set, i| set | body.point_joints(i)), places);
    let v = x.map(|x| x.v as f64 / UNITS);
    for i in points() {
        // Written so that NaN is refused.
        let slow = body.point_velocity(i, &v, places).norm() <= max_m_per_s + SPEED_SLACK_M_PER_S;
        if !slow {
            return Err(Denial::HandSpeed { joint: body.point_body(i) - 1 });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clearance::tests::shipped;
    use crate::gate::fixed::Phase;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;
    use robot::{Frames, Model};

    /// Speed of the fastest point at `q` and `v`, by the model's Jacobian.
    fn fastest(model: &Model, q: &[f64; JOINTS_MAX], v: &[f64; JOINTS_MAX]) -> f64 {
        let mut frames = Frames::default();
        model.forward(q, &mut frames);
        let speed = |point: robot::SpeedPoint| {
            let place = frames.base_from_body[point.body].transform_point(&point.at);
            let columns = model.jacobian(&frames, point.body, &place);
            let along = |i: usize| (0..JOINTS_MAX).map(|j| columns[j][i] * v[j]).sum::<f64>();
            nalgebra::Vector3::new(along(0), along(1), along(2)).norm()
        };
        model.speed_points().map(speed).into_iter().fold(0.0, f64::max)
    }

    /// By the sum of levers, hands reach 7 m/s at the shipped limits. So the gate checks the bound of 3 m/s.
    /// For a robot that cannot reach the bound, the check would cost nothing.
    #[test]
    fn hand_speed_is_checked_only_if_a_hand_can_reach_its_bound() {
        let model = shipped();
        let body = Body::new(&model);
        let v = model.limits.map(|limits| limits.v_max);
        let most: [f64; 4] = std::array::from_fn(|i| body.fastest(i, &v));
        assert!(most.into_iter().fold(0.0, f64::max) > 3.0, "{most:?}");
        let gate = super::super::Config::new(&model).and_then(|gate| gate.with_hand_speed(3.0));
        assert!(gate.is_ok_and(|gate| gate.hand_speed_m_per_s == Some(3.0)));
        let mut slow = model;
        slow.limits.iter_mut().for_each(|limits| limits.v_max *= 0.3);
        let gate = super::super::Config::new(&slow).and_then(|gate| gate.with_hand_speed(3.0));
        assert!(gate.is_ok_and(|gate| gate.hand_speed_m_per_s.is_none()));
    }

    #[test]
    fn hand_with_a_sample_faster_than_bound_is_denied() {
        let model = shipped();
        let body = Body::new(&model);
        let mut rng = Pcg64::seed_from_u64(51);
        let (mut at_command, mut later, mut slow) = (0, 0, 0);
        for n in 0..3000 {
            let next: [Point; JOINTS_MAX] = std::array::from_fn(|j| {
                let l = &model.limits[j];
                let v = l.v_max * rng.random_range(-1.0..=1.0);
                Point::quantised(rng.random_range(l.q_min..=l.q_max), v, 0.0).expect("finite")
            });
            let stops: [Stop; JOINTS_MAX] = std::array::from_fn(|j| {
                let mut phases = [Phase::default(); 3];
                for phase in &mut phases {
                    // Some of the stops get faster on their way.
                    phase.jerk = (model.limits[j].j_max * 0.2 * rng.random_range(-1.0..=1.0) * UNITS) as i64;
                    phase.duration = rng.random_range(0..1 << 44);
                }
                let mut stop = Stop::new(next[j], &phases);
                for (i, phase) in phases.iter().enumerate() {
                    let (end, extremes) = phase.play(stop.end());
                    stop.record(i, end, &extremes);
                }
                stop
            });
            let speed = |x: &[Point; JOINTS_MAX]| fastest(&model, &positions(x), &x.map(|x| x.v as f64 / UNITS));
            let first = speed(&next);
            let of_samples = sample_times(&stops).map(|time| speed(&std::array::from_fn(|j| stops[j].at(time))));
            let most = of_samples.into_iter().fold(first, f64::max);
            // The bound is checked at the boundary and beyond it, on both sides of the slack.
            assert_eq!(judge(&body, most, &next, &stops), Ok(()), "{n}");
            let denied = judge(&body, most - 2e-9, &next, &stops);
            assert!(
                matches!(denied, Err(Denial::HandSpeed { joint }) if [7, 9, 14, 16].contains(&joint)),
                "{n}: {denied:?}"
            );
            (at_command, later) = (at_command + u32::from(most == first), later + u32::from(most > first));
            let levers = (0..4).map(|i| body.fastest(i, &std::array::from_fn(|j| stops[j].v as f64 / UNITS)));
            let bound = levers.fold(0.0, f64::max);
            assert!(bound >= most - 1e-12, "{n}: {most} beyond {bound}");
            slow += u32::from(judge(&body, bound, &next, &stops).is_ok());
        }
        assert!(at_command > 300 && later > 300 && slow == 3000, "{at_command} {later} {slow}");
    }
}
