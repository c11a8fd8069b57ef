//! Present cause for which the robot does not follow, without the history.

use crate::following::{engages, follows};
use crate::sentences::{meaning, moves, newest_transitions, not_at_rest, reduced, subject, why};
use messages::{Fault, Faults, Mode, Response, Status, Subject, Transition};
use robot::Names;
use std::cmp::Reverse;

/// Says why the robot does not follow now, the gravest fault first. The events tell the history. While the robot
/// moves, it says how closely the robot follows.
pub fn cause(status: &Status, names: &Names) -> String {
    if let Some(mode) = Mode::from_u32(status.mode).filter(|&mode| moves(mode)) {
        return following(mode, status, names);
    }
    let mut faults: Vec<Fault> = Faults(status.faults | status.latched).iter().collect();
    faults.sort_by_key(|fault| Reverse(gravity(fault.row().response)));
    let mut all: Vec<String> = faults.iter().map(|&fault| meaning(fault, status, names)).collect();
    if faults.is_empty() {
        all.extend(ended_by(status, names));
    }
    all.extend(not_at_rest(status, names));
    if faults.is_empty() && status.mode == Mode::Disengaged as u32 {
        all.push("The robot waits to be engaged.".into());
    }
    all.join(" ")
}

/// Says how far a moving robot is behind the person and why, then why its speed is reduced.
fn following(mode: Mode, status: &Status, names: &Names) -> String {
    let mut all = vec![match mode {
        Mode::Engaged => follows(status, names),
        Mode::Engaging => engages(status, names),
        _ => return why(status, names),
    }];
    all.extend(reduced(status).map(|name| format!("The speed is reduced: {name}.")));
    all.join(" ")
}

const fn gravity(response: Response) -> u32 {
    match response {
        Response::Inhibit => 0,
        Response::Hold => 1,
        Response::Release => 2,
        Response::Stop => 3,
    }
}

/// Returns the fault that ended the last motion, also if that fault is over. `None` if an operator ended the
/// motion or reset the robot.
fn ended_by(status: &Status, names: &Names) -> Option<String> {
    let made: Vec<&Transition> = newest_transitions(status, u32::MAX).collect();
    let begins = made.iter().rposition(|made| Mode::from_u32(made.from).is_some_and(moves))?;
    let since = &made[begins..];
    if since.iter().any(|made| made.why == Transition::RESET || made.why == Transition::RELEASED) {
        return None;
    }
    let faults = || since.iter().filter_map(|made| Some((Fault::from_u32(made.why)?, Subject::from_code(made.about))));
    let sentence = |(fault, about): (Fault, Option<Subject>)| match about {
        Some(Subject::Person(change)) => change.meaning().to_owned(),
        about => {
            let was = subject(about, names).map_or(String::new(), |was| format!(" It was {was}."));
            format!("{}{was}", fault.row().meaning)
        }
    };
    let first = faults().next()?;
    // Whatever stopped the robot first: another person keeps it from going on.
    let person = faults().skip(1).find(|(fault, _)| *fault == Fault::PersonChanged);
    Some(core::iter::once(first).chain(person).map(sentence).collect::<Vec<_>>().join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{FollowingLimit, Layout, PersonChange, reduced_flag};

    fn status(mode: Mode, made: &[(Mode, Mode, u32)]) -> Status {
        let mut status = Status::ZERO;
        status.mode = mode as u32;
        for &(from, to, why) in made {
            let made = Transition { k: 1, from: from as u32, to: to as u32, why, about: 0 };
            status.transitions[status.transition_count as usize] = made;
            status.transition_count += 1;
        }
        status
    }

    #[test]
    fn cause_gives_gravest_fault_first_without_history() {
        let stopped = [(Mode::Engaged, Mode::Faulted, Fault::EmergencyStop as u32)];
        let mut status = status(Mode::Faulted, &stopped);
        status.faults = Faults::NONE.with(Fault::InputStale).0;
        status.latched = Faults::NONE.with(Fault::EmergencyStop).0;
        let text = cause(&status, &Names::default());
        assert!(text.starts_with("The emergency stop was pressed"), "{text}");
        assert!(text.contains("No valid skeleton") && !text.contains("after Engaged"), "{text}");
    }

    #[test]
    fn cause_names_ended_fault_until_reset() {
        let mut made = vec![
            (Mode::Engaged, Mode::Holding, Fault::CollisionNear as u32),
            (Mode::Holding, Mode::Disengaged, Fault::HoldTimeout as u32),
        ];
        let mut near = status(Mode::Disengaged, &made);
        near.transitions[0].about = Subject::Pair([3, 4]).code();
        let text = cause(&near, &Names::default());
        let meaning = Fault::CollisionNear.row().meaning;
        assert_eq!(text, format!("{meaning} It was part 3 and part 4. The robot waits to be engaged."));
        made.push((Mode::Faulted, Mode::Disengaged, Transition::RESET));
        assert_eq!(cause(&status(Mode::Disengaged, &made), &Names::default()), "The robot waits to be engaged.");
    }

    #[test]
    fn each_change_of_the_person_has_a_sentence_of_its_own() {
        let made = [
            (Mode::Engaged, Mode::Holding, Fault::InputStale as u32),
            (Mode::Holding, Mode::Disengaged, Fault::PersonChanged as u32),
        ];
        let names = Names::default();
        for change in PersonChange::ALL {
            let mut changed = status(Mode::Disengaged, &made);
            changed.transitions[1].about = Subject::Person(change).code();
            let stale = Fault::InputStale.row().meaning;
            let waits = "The robot waits to be engaged.";
            assert_eq!(cause(&changed, &names), format!("{stale} {} {waits}", change.meaning()));
            let expected = format!("Disengaged after Holding: PersonChanged: {}", change.meaning());
            assert!(why(&changed, &names).ends_with(&expected), "{}", why(&changed, &names));
            // Alone.
            changed.transitions[0] = changed.transitions[1];
            changed.transitions[0].from = Mode::Engaged as u32;
            changed.transition_count = 1;
            assert_eq!(cause(&changed, &names), format!("{} {waits}", change.meaning()));
        }
    }

    #[test]
    fn cause_after_release_names_no_fault() {
        let made = [
            (Mode::Engaged, Mode::Holding, Transition::RELEASED),
            (Mode::Holding, Mode::Disengaged, Transition::AT_REST),
        ];
        assert_eq!(cause(&status(Mode::Disengaged, &made), &Names::default()), "The robot waits to be engaged.");
        assert_eq!(cause(&status(Mode::Engaged, &made), &Names::default()), "The robot follows.");
        // The robot held for a fault that is over when the operator let go.
        let made = [
            (Mode::Engaged, Mode::Holding, Fault::InputStale as u32),
            (Mode::Holding, Mode::Disengaged, Transition::RELEASED),
        ];
        let mut rests = status(Mode::Disengaged, &made);
        assert_eq!(why(&rests, &Names::default()), "The robot waits to be engaged.");
        rests.faults = Faults::NONE.with(Fault::NoTarget).0;
        let missing = format!("NoTarget: {}", Fault::NoTarget.row().meaning);
        assert_eq!(why(&rests, &Names::default()), missing, "what stands in the way now");
        let stops = status(Mode::Holding, &[(Mode::Engaged, Mode::Holding, Transition::RELEASED)]);
        assert_eq!(why(&stops, &Names::default()), "Holding after Engaged: released.");
    }

    #[test]
    fn cause_of_robot_behind_gives_angle_and_limit() {
        let mut status = status(Mode::Engaged, &[]);
        status.limb_error_measured_rad = 24.0_f64.to_radians();
        status.limited_why = FollowingLimit::Speed as u32;
        status.limited_about = Subject::Joint(4).code();
        let text = cause(&status, &Names::default());
        assert_eq!(text, "The robot follows, 24 degrees behind: joint 4 is at its highest speed.");
        let (flag, name) = reduced_flag::NAMES[0];
        status.reduced = flag;
        assert_eq!(cause(&status, &Names::default()), format!("{text} The speed is reduced: {name}."));
        status.mode = Mode::Engaging as u32;
        let text = cause(&status, &Names::default());
        let slow =
            "The robot moves to the person's posture slowly, 24 degrees behind: joint 4 is at its highest speed.";
        assert!(text.starts_with(slow), "{text}");
        (status.reduced, status.limb_error_measured_rad) = (0, 0.0);
        assert_eq!(cause(&status, &Names::default()), "The robot moves to the person's posture slowly.");
        status.sources = messages::source_flag::POLICY[1];
        assert_eq!(cause(&status, &Names::default()), "The robot moves to the policy's posture slowly.");
    }
}
