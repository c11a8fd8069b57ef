//! Sentences for the operator: what happened, and why the robot does not move. They name the fault, the joint or
//! the pair.

use crate::following::{engages, follows};
use crate::input_age_ms;
use messages::{
    CalibrationSource, FAULTS, Fault, Faults, Mode, PayloadRefusal, Response, Stamp, Status, Subject, TRANSITIONS_KEPT,
    Transition, reduced_flag,
};
use robot::Names;
use safety::gate::Denial;
use skeleton::DropReason;

/// Number of transitions that a status keeps.
const KEPT: u32 = TRANSITIONS_KEPT as u32;

/// Age of a target from which `retarget` counts as silent, ms: 1500 targets come in a second.
const TARGET_SILENT_MS: f64 = 50.0;

/// A frame that is younger than this was just received, ms: those of the slowest allowed client are 50 ms apart.
const INPUT_SEEN_MS: f64 = 100.0;

messages::named! {
    /// Severity of a sentence.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Severity {
        /// Information.
        Note => "note",
        /// The robot slowed down, held or was released.
        Warning => "warning",
        /// The robot was stopped, or a command was denied.
        Error => "error",
    }
}

impl Severity {
    fn from_fault(fault: Fault) -> Self {
        match fault.row().response {
            Response::Inhibit => Self::Note,
            Response::Hold | Response::Release => Self::Warning,
            Response::Stop => Self::Error,
        }
    }
}

/// A sentence with its severity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sentence {
    /// Severity.
    pub gravity: Severity,
    /// The sentence.
    pub text: String,
}

/// Lists everything that happened after `before`, up to `now`. Without `before`, or if `now` comes from a
/// restarted `control`, it gives the present mode and faults.
pub fn sentences(before: Option<&Status>, now: &Status, names: &Names) -> Vec<Sentence> {
    let sentence = |gravity, text| Sentence { gravity, text };
    let of_fault = |fault| sentence(Severity::from_fault(fault), named(fault, now, names));
    let Some(before) = before.filter(|before| before.header.incarnation == now.header.incarnation) else {
        let mut all = vec![sentence(Severity::Note, format!("The robot is {}.", mode_name(now.mode)))];
        all.extend(Faults(now.faults).iter().map(of_fault));
        return all;
    };
    let mut all = Vec::new();
    let made = now.transition_count.wrapping_sub(before.transition_count);
    if made > KEPT {
        all.push(sentence(Severity::Warning, format!("{} mode changes were missed.", made - KEPT)));
    }
    let mut listed = Faults::NONE;
    for made in newest_transitions(now, made) {
        let fault = Fault::from_u32(made.why);
        listed = fault.map_or(listed, |fault| listed.with(fault));
        all.push(sentence(fault.map_or(Severity::Note, Severity::from_fault), changed(made, now, names)));
    }
    for row in &FAULTS {
        let count = now.fault_counts[row.fault.index()].wrapping_sub(before.fault_counts[row.fault.index()]);
        if count > 0 && !listed.has(row.fault) {
            all.push(of_fault(row.fault));
        }
    }
    let denied = now.gate_denials.wrapping_sub(before.gate_denials);
    if denied > 0 {
        let why = self::denied(now, names).map_or(String::new(), |why| format!(", the last one because {why}"));
        all.push(sentence(Severity::Error, format!("The gate denied {denied} commands{why}.")));
    }
    let refused = now.fallbacks.wrapping_sub(before.fallbacks);
    if refused > 0 {
        let about = Subject::from_code(now.refused_about);
        let why = match about {
            Some(Subject::Joint(_)) => "would have needed more than its share of the effort limit",
            _ => "would have come too close",
        };
        let why = subject(about, names).map_or(String::new(), |which| format!(": {which} {why}"));
        all.push(sentence(Severity::Note, format!("{refused} motions were refused; the plan continued{why}.")));
    }
    if let Some((name, meaning)) = dropped(now).filter(|_| now.input_drop != before.input_drop) {
        all.push(sentence(Severity::Warning, format!("Frames of the person are dropped: {name}: {meaning}.")));
    }
    if now.calibration != before.calibration {
        all.push(sentence(Severity::Note, format!("Calibration of the person: {}.", calibration_name(now))));
    }
    if now.payloads_taken != before.payloads_taken {
        all.push(sentence(Severity::Note, format!("The hands carry {}.", payload(now))));
    }
    let answered = [now.payloads_taken != before.payloads_taken, now.payloads_refused != before.payloads_refused];
    if let Some(why) = payload_refused(now, names).filter(|_| answered.contains(&true)) {
        let what = if answered[1] { "was refused" } else { "is too much" };
        all.push(sentence(Severity::Warning, format!("The payload {what}: {why}.")));
    }
    let newly = Status { reduced: now.reduced & !before.reduced, ..*now };
    all.extend(reduced(&newly).map(|name| sentence(Severity::Warning, format!("The speed is reduced: {name}."))));
    all
}

/// Names of what reduces the speed.
pub(crate) fn reduced(status: &Status) -> impl Iterator<Item = &'static str> {
    reduced_flag::NAMES.iter().filter(|(flag, _)| status.reduced & flag != 0).map(|(_, name)| *name)
}

/// Says why the robot does not follow, or follows slowly: how it came into this mode, and what prevents motion
/// now. `None` while it follows at full speed, and before anything has happened.
pub fn why_stopped(status: &Status, names: &Names) -> Option<String> {
    let mut all = Vec::new();
    if Mode::from_u32(status.mode).is_some_and(moves) {
        all.extend(reduced(status).map(|name| format!("The speed is reduced: {name}.")));
    } else {
        // Begins where the robot last moved. Transitions before a reset are left out.
        let moved = |made: &Transition| Mode::from_u32(made.from).is_some_and(moves);
        let begins = |(n, made): (usize, &Transition)| match made.why {
            Transition::RESET => Some(n + 1),
            _ => moved(made).then_some(n),
        };
        let since = newest_transitions(status, KEPT).enumerate().filter_map(begins).last().unwrap_or(0);
        // Whatever stopped the robot before: the operator has let go, and knows it.
        let let_go = status.mode == Mode::Disengaged as u32
            && newest_transitions(status, KEPT).skip(since).any(|made| made.why == Transition::RELEASED);
        let mut listed = Faults::NONE;
        for made in newest_transitions(status, KEPT).skip(since).filter(|_| !let_go) {
            listed = Fault::from_u32(made.why).map_or(listed, |fault| listed.with(fault));
            all.push(changed(made, status, names));
        }
        let others = Faults(status.faults | status.latched).iter().filter(|&fault| !listed.has(fault));
        all.extend(others.map(|fault| named(fault, status, names)));
        all.extend(not_at_rest(status, names));
    }
    (!all.is_empty()).then(|| all.join(" "))
}

/// Says why the robot does not follow, or follows slowly. If nothing prevents motion, it says that the robot
/// follows or waits.
pub fn why(status: &Status, names: &Names) -> String {
    why_stopped(status, names).unwrap_or_else(|| match Mode::from_u32(status.mode) {
        Some(Mode::Recovering) => "The robot moves back slowly.".into(),
        Some(Mode::Engaging) => engages(status, names),
        Some(mode) if moves(mode) => follows(status, names),
        _ => "The robot waits to be engaged.".into(),
    })
}

/// Explains a fault. While the fault lasts, adds the joint or pair that it concerns and a remedy.
pub fn meaning(fault: Fault, status: &Status, names: &Names) -> String {
    let meaning = fault.row().meaning;
    if !Faults(status.faults | status.latched).has(fault) {
        return meaning.into();
    }
    if let Some(joint) = status.not_finite(fault) {
        return format!("{meaning} The position of {} is not finite.", names.joint(joint));
    }
    let measured_pair = || {
        let (pair, clearance_mm) = (names.pair(status.nearest_pair_measured), status.clearance_measured_m * 1e3);
        format!("{pair} are {clearance_mm:.1} mm apart")
    };
    let never = status.target_stamp == Stamp::NONE;
    let silent_ms = if never { 0.0 } else { status.header.stamp.since(status.target_stamp) as f64 * 1e-6 };
    match (fault, status.joint_outside.checked_sub(1)) {
        (Fault::StartOutsideLimits, Some(joint)) => {
            let joint = joint as usize;
            let (name, unit, by) = (names.joint(joint), names.unit(joint), status.outside_by);
            if by == 0.0 {
                return format!("{meaning} {name} needs more than its share of the effort limit to hold its load.");
            }
            let side = if by < 0.0 { "below its lowest position" } else { "above its highest position" };
            format!("{meaning} {name} is {:.4} {unit} {side}; teleopctl recover brings it back.", by.abs())
        }
        (Fault::StartInCollision, _) => format!("{meaning} {}; teleopctl recover moves them apart.", measured_pair()),
        (Fault::CollisionNear, _) => format!("{meaning} {}.", measured_pair()),
        (Fault::EmergencyStop, _) if status.reset_first_by > 0 => {
            format!("{meaning} Only user {} or root may reset it.", status.reset_first_by - 1)
        }
        (Fault::GateDenied, _) => match denied(status, names) {
            Some(why) => format!("{meaning} Last reason: {why}."),
            None => meaning.into(),
        },
        (Fault::TrackingError, _) => format!("{meaning} {}", off_course(status, names)),
        // Only the simulator engages without real-time scheduling.
        (Fault::FeedbackInvalid | Fault::DriverFault | Fault::StateStale | Fault::DeadlineMissed, _)
            if status.realtime == 0 =>
        {
            let missed = match status.missed_deadlines {
                0 => String::new(),
                missed => format!(": {missed} deadlines were missed"),
            };
            format!(
                "{meaning} A pause of this machine, which runs no process in real time, causes it, too{missed}. See \
                 docs/src/real-time.md."
            )
        }
        (Fault::VelocityError | Fault::StandstillLost, _) => match unsteady(status, names) {
            Some(name) => format!("{meaning} It is {name}."),
            None => meaning.into(),
        },
        (Fault::InputStale, _) if silent_ms > TARGET_SILENT_MS => {
            format!(
                "{meaning} `retarget` has sent no target for {silent_ms:.0} ms, so the skeletons' state is unknown."
            )
        }
        (Fault::InputStale, _) => match dropped(status) {
            Some((name, why)) => format!("{meaning} Frames arrive, but are dropped: {name}: {why}."),
            None if input_age_ms(status).is_some_and(|age_ms| age_ms < INPUT_SEEN_MS) => {
                format!("{meaning} Frames arrive, but at least 15 a second are needed for half a second.")
            }
            None => meaning.into(),
        },
        _ => meaning.into(),
    }
}

/// Says which joint is the farthest from its command, now.
fn off_course(status: &Status, names: &Names) -> String {
    let joint = status.tracking_joint.saturating_sub(1) as usize;
    let (name, error) = (names.joint(joint), format!("{:.4} {}", status.tracking_error, names.unit(joint)));
    if Faults(status.faults).has(Fault::TrackingError) {
        format!("{name} is {error} from its command.")
    } else {
        format!("That is over: now {name} is the farthest from its command, by {error}.")
    }
}

/// Names the joint that does not move as commanded, leaves its place or does not come to rest.
fn unsteady(status: &Status, names: &Names) -> Option<String> {
    status.unsteady_joint.checked_sub(1).map(|joint| names.joint(joint as usize))
}

/// Says why the robot can be neither enabled nor reset although its command rests: it is measured moving. `None`
/// if it is at rest.
pub fn not_at_rest(status: &Status, names: &Names) -> Option<String> {
    let name = unsteady(status, names).filter(|_| status.moving != 0)?;
    Some(format!("The robot is not at rest: {name} is moving, or moved less than 0.1 s ago."))
}

/// The payloads of both hands.
pub fn payload(status: &Status) -> String {
    let [left, right] = status.payload_kg;
    format!("{left:.3} kg left, {right:.3} kg right")
}

/// Says why the last payload was refused or is too much for a start, and names the joint. `None` if neither is the
/// case.
pub fn payload_refused(status: &Status, names: &Names) -> Option<String> {
    let why = PayloadRefusal::from_u32(status.payload_refused_why)?.meaning();
    let joint = status.payload_refused_joint.checked_sub(1).map(|joint| names.joint(joint as usize));
    Some(joint.map_or(why.into(), |joint| format!("{joint}: {why}")))
}

/// Name of the source of the elbow hinge axes.
pub fn calibration_name(status: &Status) -> &'static str {
    CalibrationSource::from_u32(status.calibration).unwrap_or_default().name()
}

pub(crate) const fn moves(mode: Mode) -> bool {
    matches!(mode, Mode::Engaging | Mode::Engaged | Mode::Recovering)
}

/// Name of a mode.
pub fn mode_name(mode: u32) -> &'static str {
    Mode::from_u32(mode).map_or("in an unknown mode", Mode::name)
}

fn named(fault: Fault, status: &Status, names: &Names) -> String {
    format!("{}: {}", fault.row().name, meaning(fault, status, names))
}

pub(crate) fn subject(subject: Option<Subject>, names: &Names) -> Option<String> {
    subject.and_then(|subject| match subject {
        Subject::Joint(joint) => Some(names.joint(joint)),
        Subject::Pair(pair) => Some(names.pair(pair)),
        Subject::Person(_) => None,
    })
}

/// Reason of the gate's last denial, with the joint or the pair. `None` if it never denied a command.
pub(crate) fn denied(status: &Status, names: &Names) -> Option<String> {
    let why = Denial::meaning(status.denied_why)?;
    let about = subject(Subject::from_code(status.denied_about), names);
    Some(about.map_or(why.into(), |about| format!("{why} ({about})")))
}

/// Says why `ingest` drops frames now. `None` if it drops none.
pub fn dropped_now(status: &Status) -> Option<String> {
    dropped(status).map(|(name, meaning)| format!("frames are dropped: {name}: {meaning}"))
}

/// Name and meaning of the reason for which `ingest` drops frames now. `None` if it drops none.
pub(crate) fn dropped(status: &Status) -> Option<(&'static str, &'static str)> {
    let reason = *DropReason::ALL.get(status.input_drop.checked_sub(1)? as usize)?;
    Some((reason.name(), reason.meaning()))
}

/// The fault behind a change of mode, by its name, and what it was about. None if no fault made the change.
pub fn fault_behind(made: &Transition, status: &Status, names: &Names) -> Option<String> {
    let (fault, about) = (Fault::from_u32(made.why)?, Subject::from_code(made.about));
    if let Some(Subject::Person(change)) = about {
        return Some(format!("{}: {}", fault.row().name, change.meaning()));
    }
    let current = status.about(fault).filter(|_| Faults(status.faults | status.latched).has(fault));
    let was = subject(about.filter(|&was| current != Some(was)), names);
    Some(named(fault, status, names) + &was.map_or(String::new(), |was| format!(" It was {was}.")))
}

fn changed(made: &Transition, status: &Status, names: &Names) -> String {
    let why = fault_behind(made, status, names).unwrap_or_else(|| format!("{}.", made.why_name()));
    format!("{} after {}: {why}", mode_name(made.to), mode_name(made.from))
}

/// Iterates over the newest `count` transitions, the oldest first.
pub fn newest_transitions(status: &Status, count: u32) -> impl Iterator<Item = &Transition> {
    let end = status.transition_count;
    (end.saturating_sub(count.min(KEPT))..end).map(|n| &status.transitions[(n % KEPT) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    fn transition(k: u64, from: Mode, to: Mode, why: u32) -> Transition {
        Transition { k, from: from as u32, to: to as u32, why, about: 0 }
    }

    #[test]
    fn each_transition_fault_and_denial_is_reported_once() {
        let names = Names::default();
        let mut status = Status::ZERO;
        let first = sentences(None, &status, &names);
        assert_eq!(first[0].text, "The robot is Disengaged.");
        let before = status;
        status.transitions[0] = transition(5, Mode::Disengaged, Mode::Engaging, Transition::ENABLED);
        status.transitions[1] = transition(9, Mode::Engaging, Mode::Holding, Fault::CollisionNear as u32);
        status.transition_count = 2;
        status.faults = Faults::NONE.with(Fault::CollisionNear).0;
        status.fault_counts[Fault::CollisionNear.index()] = 1;
        status.fault_counts[Fault::StateLate.index()] = 1;
        (status.gate_denials, status.nearest_pair_measured) = (2, [3, 4]);
        let denial = Denial::ClearanceAtRest { pair: [1, 2] };
        (status.denied_why, status.denied_about) = (denial.code(), denial.subject().map_or(0, Subject::code));
        (status.fallbacks, status.refused_about) = (7, Subject::Pair([5, 6]).code());
        (status.input_drop, status.calibration) = (DropReason::Size as u32 + 1, CalibrationSource::Online as u32);
        let texts: Vec<_> =
            sentences(Some(&before), &status, &names).into_iter().map(|sentence| sentence.text).collect();
        assert_eq!(texts.len(), 7, "{texts:?}");
        assert_eq!(texts[0], "Engaging after Disengaged: enabled.");
        assert!(texts[1].starts_with("Holding after Engaging: CollisionNear"), "{texts:?}");
        assert!(texts[1].contains("part 3 and part 4"), "{texts:?}");
        assert!(texts[2].starts_with("StateLate: "), "{texts:?}");
        let why = "parts would be too close where the stop ends (part 1 and part 2)";
        assert_eq!(texts[3], format!("The gate denied 2 commands, the last one because {why}."));
        assert_eq!(
            texts[4],
            "7 motions were refused; the plan continued: part 5 and part 6 would have come too close."
        );
        assert!(texts[5].starts_with("Frames of the person are dropped: Size: hips to shoulders"), "{texts:?}");
        assert_eq!(texts[6], "Calibration of the person: estimated online.");
        assert!(sentences(Some(&status), &status, &names).is_empty());
        status.header.incarnation = 9;
        let anew = sentences(Some(&before), &status, &names);
        assert_eq!(anew.len(), 2, "another control begins anew: {anew:?}");
    }

    #[test]
    fn cause_of_stop_is_reported_until_reset() {
        let names = Names::default();
        let mut status = Status::ZERO;
        assert_eq!(why_stopped(&status, &names), None, "nothing has happened");
        let near = Fault::CollisionNear;
        status.mode = Mode::Holding as u32;
        status.transitions[0] = transition(9, Mode::Engaged, Mode::Holding, near as u32);
        status.transitions[0].about = Subject::Pair([3, 4]).code();
        status.transition_count = 1;
        (status.faults, status.nearest_pair_measured) = (Faults::NONE.with(near).0, [3, 4]);
        let why = why_stopped(&status, &names).expect("it holds");
        assert!(why.starts_with("Holding after Engaged: CollisionNear: "), "{why}");
        assert!(why.contains("part 3 and part 4 are 0.0 mm apart"), "{why}");
        assert!(!why.contains("It was"), "once: {why}");
        // Another pair is near by now.
        status.nearest_pair_measured = [5, 6];
        let why = why_stopped(&status, &names).expect("it holds");
        assert!(why.contains("part 5 and part 6 are 0.0 mm apart. It was part 3 and part 4."), "{why}");
        // All are apart again: the pair that was near is still named, and no other one.
        status.faults = Faults::NONE.with(Fault::InputStale).0;
        status.input_drop = DropReason::Chirality as u32 + 1;
        let why = why_stopped(&status, &names).expect("it holds still");
        assert!(why.contains("It was part 3 and part 4.") && !why.contains("part 5"), "{why}");
        assert!(why.contains("InputStale: No valid skeleton") && why.contains("dropped: Chirality: left"), "{why}");
        // At rest, the cause is still named.
        status.mode = Mode::Disengaged as u32;
        status.transitions[1] = transition(12, Mode::Holding, Mode::Disengaged, Transition::AT_REST);
        status.transition_count = 2;
        let why = why_stopped(&status, &names).expect("it rests");
        assert!(why.contains("CollisionNear") && why.contains("Disengaged after Holding: at rest."), "{why}");
        let mut seldom = Status { input_age_ns: 40_000_000, input_drop: 0, ..status };
        (seldom.header.stamp, seldom.target_stamp) = (Stamp(2_000_000_000), Stamp(1_999_000_000));
        assert!(super::why(&seldom, &names).contains("at least 15 a second"), "they come, and are not fresh");
        seldom.input_age_ns = 150_000_000;
        assert!(!super::why(&seldom, &names).contains("at least 15 a second"), "they come no more");
        // A reset ends the history, but not the faults that are still active.
        status.transitions[2] = transition(20, Mode::Disengaged, Mode::Faulted, Fault::EmergencyStop as u32);
        status.transitions[3] = transition(30, Mode::Faulted, Mode::Disengaged, Transition::RESET);
        status.transition_count = 4;
        let why = why_stopped(&status, &names).expect("there are no frames");
        assert!(why.contains("InputStale") && !why.contains("EmergencyStop"), "{why}");
        status.faults = 0;
        assert_eq!(super::why(&status, &names), "The robot waits to be engaged.");
        (status.moving, status.unsteady_joint) = (1, 7);
        let why = why_stopped(&status, &names).expect("it swings");
        assert!(why.contains("not at rest: joint 6 is moving"), "{why}");
        (status.moving, status.unsteady_joint) = (0, 0);
        status.mode = Mode::Engaged as u32;
        assert_eq!(super::why(&status, &names), "The robot follows.");
        let right_alone = Status { left_out: 1, ..status };
        assert_eq!(super::why(&right_alone, &names), "The robot's right arm follows.");
        let unseen = super::why(&Status { left_out: 8, ..status }, &names);
        assert_eq!(unseen, "The robot follows. The person's right arm is not seen well enough.");
        status.reduced = reduced_flag::NAMES[0].0;
        assert!(why_stopped(&status, &names).is_some_and(|why| why.contains(reduced_flag::NAMES[0].1)));
    }

    #[test]
    fn fault_meaning_names_joint_or_pair() {
        let both = Faults::NONE.with(Fault::StartOutsideLimits).with(Fault::StartInCollision);
        let status = Status {
            faults: both.0,
            joint_outside: 6,
            outside_by: -0.0123,
            clearance_measured_m: 0.0042,
            nearest_pair_measured: [3, 30],
            ..Status::ZERO
        };
        let text = |fault| meaning(fault, &status, &Names::default());
        let lost = Faults::NONE.with(Fault::TrackingError).0;
        let behind = Status { faults: lost, tracking_joint: 4, tracking_error: 0.06, ..Status::ZERO };
        let text_of = |status: &Status| meaning(Fault::TrackingError, status, &Names::default());
        assert!(text_of(&behind).ends_with("joint 3 is 0.0600 rad or m from its command."));
        let back = text_of(&Status { faults: 0, latched: lost, tracking_error: 0.0, ..behind });
        assert!(back.contains("That is over: now joint 3 is the farthest"), "{back}");
        let paused = Status { latched: Faults::NONE.with(Fault::DriverFault).0, missed_deadlines: 90, ..Status::ZERO };
        let driver = |status: &Status| meaning(Fault::DriverFault, status, &Names::default());
        assert!(driver(&paused).contains("90 deadlines were missed"), "{}", driver(&paused));
        assert!(!driver(&Status { realtime: 1, ..paused }).contains("pause"), "a machine in real time does not pause");
        for fault in [Fault::VelocityError, Fault::StandstillLost] {
            let swings = Status { latched: Faults::NONE.with(fault).0, unsteady_joint: 7, ..Status::ZERO };
            let text = meaning(fault, &swings, &Names::default());
            assert_eq!(text, format!("{} It is joint 6.", fault.row().meaning));
            let over = Status { unsteady_joint: 0, ..swings };
            assert_eq!(meaning(fault, &over, &Names::default()), fault.row().meaning);
        }
        let outside = text(Fault::StartOutsideLimits);
        assert!(outside.contains("joint 5 is 0.0123 rad or m below"), "{outside}");
        let close = text(Fault::StartInCollision);
        assert!(close.contains("part 3 and part 30 are 4.2 mm apart"), "{close}");
        assert!(close.contains("teleopctl recover"), "{close}");
        assert_eq!(text(Fault::NoTarget), Fault::NoTarget.row().meaning);
    }
}
