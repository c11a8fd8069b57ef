//! Payloads: taken only at rest, refused with a reason, and used in every certificate from then on.

use crate::support::{Bench, LEFT_ARM, loaded};
use explain::payload_refused;
use messages::{Fault, Faults, JOINTS_MAX, Mode, PayloadOrder, PayloadRefusal, TICK_HZ};
use robot::{Model, Names, Payload};

/// Joint that lifts the left arm: its second one.
const LIFTS: usize = LEFT_ARM.start + 1;

/// The left arm stretched out to the side, level.
fn stretched(model: &Model) -> [f64; JOINTS_MAX] {
    let mut q = model.home;
    q[LEFT_ARM].copy_from_slice(&[0.3, 0.0, 1.57, 0.2, 0.0, 0.0, 0.0]);
    q
}

fn kilograms(mass_kg: f64) -> PayloadOrder {
    PayloadOrder { mass_kg, centre_m: None }
}

/// Sends the order, and returns the reason of a refusal.
fn order_payload(bench: &mut Bench, hand: usize, order: PayloadOrder) -> Option<PayloadRefusal> {
    let before = bench.status;
    bench.hand.payload[hand] = Some(order);
    bench.step();
    let now = bench.status;
    let (taken, refused) = (now.payloads_taken - before.payloads_taken, now.payloads_refused - before.payloads_refused);
    assert_eq!(taken + refused, 1, "every word is answered once");
    if refused == 1 {
        assert_eq!((now.payload_kg, now.payload_centre_m), (before.payload_kg, before.payload_centre_m));
        return Some(PayloadRefusal::from_u32(now.payload_refused_why).expect("a reason"));
    }
    None
}

#[test]
fn payload_is_accepted_at_rest_and_shown() {
    let loaded = loaded();
    let mut bench = Bench::new(&loaded, loaded.model.home, 1);
    bench.settle();
    assert_eq!(bench.status.payload_kg, [0.0; 2]);
    let [left, right] = loaded.model.payload.map(|hand| hand.expect("a centre").center.into());
    assert_eq!(bench.status.payload_centre_m, [left, right]);
    assert_eq!(order_payload(&mut bench, 1, kilograms(0.5)), None);
    assert_eq!((bench.status.payload_kg, bench.status.payload_centre_m), ([0.0, 0.5], [left, right]));
    let order = PayloadOrder { mass_kg: 0.2, centre_m: Some([0.0, 0.0, -0.3]) };
    assert_eq!(order_payload(&mut bench, 0, order), None);
    assert_eq!(bench.status.payload_kg, [0.2, 0.5]);
    assert_eq!(bench.status.payload_centre_m, [[0.0, 0.0, -0.3], right]);
    assert!(explain::payload(&bench.status).contains("0.200 kg left, 0.500 kg right"));
    // Without a centre the robot file's centre is used again.
    assert_eq!(order_payload(&mut bench, 0, kilograms(0.0)), None);
    assert_eq!(bench.status.payload_centre_m, [left, right]);
    bench.assert_no_violations("at rest");
}

#[test]
fn payload_out_of_range_is_refused() {
    let mut loaded = loaded();
    loaded.model.payload[1] = None;
    let mut bench = Bench::new(&loaded, loaded.model.home, 1);
    bench.settle();
    for mass_kg in [-0.1, 5.1, f64::NAN, f64::INFINITY] {
        assert_eq!(order_payload(&mut bench, 0, kilograms(mass_kg)), Some(PayloadRefusal::Mass));
    }
    for centre_m in [[0.6, 0.0, 0.0], [0.3, 0.3, 0.3], [f64::NAN, 0.0, 0.0]] {
        let order = PayloadOrder { mass_kg: 0.1, centre_m: Some(centre_m) };
        assert_eq!(order_payload(&mut bench, 0, order), Some(PayloadRefusal::Centre));
    }
    let refused = order_payload(&mut bench, 1, kilograms(0.1));
    assert_eq!(refused, Some(PayloadRefusal::NoCentre), "the file says nothing of it");
    assert_eq!(order_payload(&mut bench, 1, kilograms(0.0)), None);
    assert_eq!(order_payload(&mut bench, 1, PayloadOrder { mass_kg: 0.1, centre_m: Some([0.0; 3]) }), None);
}

#[test]
fn payload_is_refused_unless_disengaged_and_at_rest() {
    let loaded = loaded();
    let mut bench = Bench::new(&loaded, loaded.model.home, 1);
    bench.target = Some(stretched(&loaded.model));
    bench.settle();
    bench.press_enable();
    // The enable and the payload arrive in one tick: the robot is no longer Disengaged.
    assert_eq!(order_payload(&mut bench, 0, kilograms(0.1)), Some(PayloadRefusal::NotDisengaged));
    bench.steps(TICK_HZ);
    assert_eq!(bench.mode(), Mode::Engaging);
    assert_eq!(order_payload(&mut bench, 0, kilograms(0.1)), Some(PayloadRefusal::NotDisengaged));
    bench.let_go();
    let comes_to_rest = (0..2 * TICK_HZ).any(|_| {
        let at_rest = bench.mode() == Mode::Disengaged && bench.status.moving == 0;
        bench.step();
        at_rest
    });
    assert!(comes_to_rest, "it comes to rest");
    for n in 0..20 {
        bench.step_measuring(|state| state.q_measured[LIFTS] += if n % 10 < 5 { 0.006 } else { -0.006 });
    }
    assert_eq!((bench.mode(), bench.status.moving), (Mode::Disengaged, 1));
    assert_eq!(order_payload(&mut bench, 0, kilograms(0.1)), Some(PayloadRefusal::Moving));
    bench.settle();
    assert_eq!(order_payload(&mut bench, 0, kilograms(0.1)), None);
}

#[test]
fn payload_too_heavy_for_joint_blocks_start() {
    let loaded = loaded();
    let mut bench = Bench::new(&loaded, stretched(&loaded.model), 1);
    bench.settle();
    assert_eq!(order_payload(&mut bench, 0, kilograms(1.0)), None);
    assert_eq!(bench.status.payload_kg, [1.0, 0.0]);
    assert_eq!(bench.status.payload_refused_why, PayloadRefusal::Overload as u32);
    let why = payload_refused(&bench.status, &Names::from_model(&loaded.model)).expect("a reason");
    assert!(why.starts_with("arm_left_2_joint: ") && why.contains("share of the effort limit"), "{why}");
    bench.step();
    assert!(Faults(bench.status.faults).has(Fault::StartOutsideLimits));
    bench.target = Some(loaded.model.home);
    bench.press_enable();
    for _ in 0..TICK_HZ {
        bench.step();
        assert_eq!(bench.mode(), Mode::Disengaged);
    }
    bench.let_go();
    // Both hands at once, and one after the other: a lighter payload is always taken.
    assert_eq!(order_payload(&mut bench, 0, kilograms(0.9)), None);
    assert_eq!(order_payload(&mut bench, 0, kilograms(0.0)), None);
    assert_eq!(bench.status.payload_refused_why, 0);
    bench.step();
    assert!(!Faults(bench.status.faults).has(Fault::StartOutsideLimits));
}

/// The robot file gives the hand a payload that is too heavy for the posture. The robot does not start until the
/// operator sets the hand empty.
#[test]
fn start_with_overloaded_hand_is_refused_until_hand_is_empty() {
    let mut loaded = loaded();
    loaded.model.payload[0] = loaded.model.payload[0].map(|hand| Payload { mass_kg: 1.0, ..hand });
    let mut bench = Bench::new(&loaded, stretched(&loaded.model), 1);
    bench.settle();
    assert!(Faults(bench.status.faults).has(Fault::StartOutsideLimits));
    assert_eq!((bench.status.joint_outside, bench.status.outside_by), (LIFTS as u32 + 1, 0.0));
    assert_eq!(order_payload(&mut bench, 0, kilograms(0.0)), None);
    bench.step();
    assert!(!Faults(bench.status.faults).has(Fault::StartOutsideLimits));
}
