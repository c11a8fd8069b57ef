//! Memory layout of every message, compared with the stored snapshot. A change of layout is a change of contract.
//! It needs a new version number in the message and in its service name.

use messages::{
    Feedback, GripperMotion, GripperState, Header, HingeCalibration, InputStatus, JointCommand, JointTarget, Layout,
    Message, OperatorRequest, RawSkeleton, RobotMeasured, RobotSetpoint, RobotState, SERVICES, Skeleton, Status,
    StopPlan, Transition, deadline, tick_at,
};
use std::fmt::Write;

fn describe<M: Message>(out: &mut String) {
    writeln!(out, "{} size {} align {}", M::NAME, size_of::<M>(), align_of::<M>()).unwrap();
    for field in M::FIELDS {
        writeln!(out, "  {:4} {:4} {}: {}", field.offset, field.size, field.name, field.ty).unwrap();
    }
}

fn snapshot() -> String {
    let mut out = String::new();
    describe::<Header>(&mut out);
    describe::<HingeCalibration>(&mut out);
    describe::<RawSkeleton>(&mut out);
    describe::<Skeleton>(&mut out);
    describe::<JointTarget>(&mut out);
    describe::<StopPlan>(&mut out);
    describe::<JointCommand>(&mut out);
    describe::<RobotState>(&mut out);
    describe::<Transition>(&mut out);
    describe::<Status>(&mut out);
    describe::<InputStatus>(&mut out);
    describe::<OperatorRequest>(&mut out);
    describe::<RobotSetpoint>(&mut out);
    describe::<RobotMeasured>(&mut out);
    describe::<GripperMotion>(&mut out);
    describe::<GripperState>(&mut out);
    describe::<Feedback>(&mut out);
    out
}

#[test]
fn layouts_match_snapshot() {
    let stored = include_str!("layout.txt");
    let actual = snapshot();
    assert!(actual == stored, "layouts changed; if that is meant, raise the versions and store this:\n{actual}");
}

#[test]
#[ignore = "writes the snapshot: cargo test -p messages --test all layout -- --ignored"]
fn write_the_snapshot() {
    std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/layout.txt"), snapshot()).unwrap();
}

#[test]
fn type_names_carry_version_and_hash() {
    let name = JointCommand::TYPE_NAME;
    let expected = format!("teleop.JointCommand.v{}.{:016x}", JointCommand::VERSION, JointCommand::HASH);
    assert_eq!(name.as_str(), expected);
    assert_ne!(JointTarget::HASH, JointCommand::HASH);
}

#[test]
fn service_names_carry_version_of_their_message() {
    let versions = [
        RawSkeleton::VERSION,
        Skeleton::VERSION,
        JointTarget::VERSION,
        JointCommand::VERSION,
        RobotState::VERSION,
        Status::VERSION,
        InputStatus::VERSION,
        RobotSetpoint::VERSION,
        RobotMeasured::VERSION,
    ];
    for (index, (row, version)) in SERVICES.iter().zip(versions).enumerate() {
        assert_eq!(row.service as usize, index);
        assert!(row.name.ends_with(&format!("/{version}")), "{} and version {version}", row.name);
    }
}

#[test]
fn tick_grid_has_no_drift() {
    // Three ticks are exactly two milliseconds, also a thousand days after the origin.
    for base in [0_u64, 1, 2, 1_499, 129_600_000_000] {
        assert_eq!(deadline(base + 3).0 - deadline(base).0, 2_000_000);
    }
    for k in (0..5_000).chain(129_600_000_000..129_600_005_000) {
        let at = deadline(k);
        assert_eq!(tick_at(at), k);
        assert_eq!(tick_at(messages::Stamp(at.0 - u64::from(k > 0))), k.saturating_sub(1));
    }
}
