//! Judges the input of a tick and returns the set of faults that hold. It keeps ages by this machine's clock,
//! detects restarts and debounces.

use messages::{FAULTS, Fault, Faults, Stamp, TICK_HZ};

use super::reduced::{Ages, Lateness};
use super::{Config, Input};

/// Longest time that a stamp may lie ahead of the tick's own reading of the same clock. Another process may
/// take a stamp after this one read the clock. Readings of one clock differ by scheduling alone.
const FUTURE_TOLERANCE_NS: u64 = 2_000_000;

/// Longest part of this process's own gap that may be charged to a writer. It is two ticks, so that a tick
/// that starts late by its whole length still counts in full.
const CHARGE_MAX_NS: u64 = 2 * 1_000_000_000 / TICK_HZ;

/// Longest time that one sample of the robot's state counts for, ns. It equals the longest allowed silence of
/// the driver. Nothing is known of the robot while samples were missing.
const SAMPLE_MAX_NS: u64 = 20_000_000;

/// Age of a stream, counted only while this process was awake.
#[derive(Clone, Copy, Debug, Default)]
struct StreamAge {
    newest: Stamp,
    awake_ns: u64,
}

impl StreamAge {
    /// Age of the newest message at `now`, ns, or `u64::MAX` before the first. A stamp from the future or one
    /// that runs backwards does not refresh it.
    fn judge(&mut self, now: Stamp, received: Stamp, charged_ns: u64, slept_ns: u64) -> u64 {
        let is_new = received > self.newest && received <= now.plus_ns(FUTURE_TOLERANCE_NS);
        if is_new {
            self.newest = received;
            self.awake_ns = now.since(received).saturating_sub(slept_ns);
        } else {
            self.awake_ns = self.awake_ns.saturating_add(charged_ns);
        }
        if self.newest == Stamp::NONE { u64::MAX } else { self.awake_ns }
    }

    fn seen(&self) -> bool {
        self.newest != Stamp::NONE
    }
}

/// Remembers the identity of a writer, and notices a change.
#[derive(Clone, Copy, Debug, Default)]
struct Identity(Option<u64>);

impl Identity {
    /// Returns true if `id` differs from the previous one. The new one counts as known from the next tick on.
    fn changed(&mut self, id: u64) -> bool {
        let changed = self.0.is_some_and(|known| known != id);
        self.0 = Some(id);
        changed
    }
}

/// The properties of the mode that the faults of some modes depend on.
#[derive(Clone, Copy, Debug)]
pub(super) struct ModeView {
    /// An operator holds authority or can resume.
    pub(super) has_authority: bool,
    /// Holding has lasted longer than allowed.
    pub(super) hold_expired: bool,
    /// The target has jumped repeatedly for too long.
    pub(super) jumps_on: bool,
}

/// State of the monitors.
#[derive(Clone, Debug, Default)]
pub(super) struct Watch {
    target: StreamAge,
    input: StreamAge,
    state: StreamAge,
    heartbeat: StreamAge,
    target_writer: Identity,
    driver: Identity,
    session: Identity,
    pub(super) ages: Ages,
    lateness: Lateness,
    tracking_ns: u64,
    released_ns: u64,
    enable_was_released: bool,
    ticks_held: [u32; FAULTS.len()],
    active: Faults,
    pub(super) counts: [u32; FAULTS.len()],
    pub(super) operator_alive: bool,
}

/// The part of this process's own gap that counts, ns.
pub(super) fn charged_ns(own_gap_ns: u64) -> u64 {
    own_gap_ns.min(CHARGE_MAX_NS)
}

impl Watch {
    /// Returns true if the enable has been seen released for long enough since start.
    pub(super) fn armed(&self) -> bool {
        self.enable_was_released
    }

    /// The debounced faults that hold at this tick. Call exactly once a tick.
    pub(super) fn judge(&mut self, config: &Config, mode: ModeView, now: Stamp, input: &Input) -> Faults {
        self.note_enable(config, input);
        let late = self.lateness.update(input.k, input.deadlines_missed > 0);
        let mut seen = self.conditions(config, mode, now, input);
        seen.set(Fault::DeadlinesLate, late >= config.deadlines_late_per_s_max);
        let mut active = Faults::NONE;
        for row in &FAULTS {
            let held = &mut self.ticks_held[row.fault.index()];
            *held = if seen.has(row.fault) { held.saturating_add(1) } else { 0 };
            if *held >= row.debounce_ticks {
                active = active.with(row.fault);
                if !self.active.has(row.fault) {
                    let count = &mut self.counts[row.fault.index()];
                    *count = count.saturating_add(1);
                }
            }
        }
        self.active = active;
        active
    }

    fn note_enable(&mut self, config: &Config, input: &Input) {
        let released = !input.operator.enable_level && !input.operator.recover_level;
        self.released_ns = if released { self.released_ns.saturating_add(charged_ns(input.own_gap_ns)) } else { 0 };
        self.enable_was_released |= self.released_ns >= config.enable_released_ns;
    }

    fn conditions(&mut self, config: &Config, mode: ModeView, now: Stamp, input: &Input) -> Faults {
        let charged = charged_ns(input.own_gap_ns);
        let slept = input.own_gap_ns - charged;
        let target_age = self.target.judge(now, input.target.received, charged, slept);
        let input_age = self.input.judge(now, input.target.input_received, charged, slept);
        let state_age = self.state.judge(now, input.robot.received, charged, slept);
        let heartbeat_age = self.heartbeat.judge(now, input.operator.heartbeat_received, charged, slept);
        self.ages = Ages { target_ns: target_age, input_ns: input_age };
        let (has_target, has_state) = (self.target.seen(), self.state.seen());
        let target_stale = target_age > config.target_stale_ns;
        self.operator_alive = input.operator.connected && heartbeat_age <= config.operator_silent_ns;

        let mut seen = Faults::NONE;
        seen.set(Fault::NotRealtime, !input.realtime_ok);
        seen.set(
            Fault::ConfigMismatch,
            has_target && !input.target.config_matches || has_state && !input.robot.config_matches,
        );
        seen.set(Fault::StartOutsideLimits, has_state && input.robot.outside_limits);
        seen.set(Fault::StartInCollision, has_state && input.robot.in_collision);
        seen.set(Fault::NoRobotState, !has_state || !input.robot.commanded);
        seen.set(Fault::NoTarget, !has_target || target_stale);
        seen.set(Fault::InputStale, has_target && (input_age > config.input_stale_ns || !input.target.input_fresh));
        seen.set(Fault::InputImplausible, has_target && (input.target.implausible || mode.jumps_on));
        seen.set(Fault::TargetStale, has_target && target_stale);
        seen.set(Fault::CollisionNear, has_state && input.robot.collision_near);
        seen.set(Fault::StateLate, has_state && state_age > config.state_late_ns);
        seen.set(Fault::OperatorSilent, mode.has_authority && !self.operator_alive);
        seen.set(Fault::WriterRestarted, self.writer_restarted(input));
        seen.set(Fault::PersonChanged, self.person_changed(input));
        seen.set(Fault::HoldTimeout, mode.hold_expired);
        seen.set(Fault::EmergencyStop, input.operator.estop_edge || has_state && input.robot.emergency_stop);
        seen.set(Fault::StateStale, has_state && state_age > config.state_stale_ns);
        seen.set(Fault::FeedbackInvalid, has_state && input.robot.feedback_invalid);
        seen.set(Fault::TrackingError, has_state && self.tracking_lost(config, input));
        seen.set(Fault::VelocityError, has_state && input.robot.velocity_error);
        seen.set(Fault::StandstillLost, has_state && input.robot.standstill_lost);
        seen.set(Fault::DeadlineMissed, input.deadlines_missed >= config.deadlines_missed_max);
        seen.set(Fault::DriverFault, has_state && input.robot.driver_fault);
        seen.set(Fault::GateDenied, input.motion.gate_denied);
        // Frames that no longer come hold no clutch: their silence counts.
        let recent = !target_stale && input_age <= config.input_stale_ns;
        seen.set(Fault::Clutch, input.operator.clutch_level || input.target.clutch && recent);
        seen
    }

    /// Returns true if a writer restarted, because the operator has not enabled the new process.
    fn writer_restarted(&mut self, input: &Input) -> bool {
        let target = self.target.seen() && self.target_writer.changed(u64::from(input.target.incarnation));
        let driver = self.state.seen() && self.driver.changed(u64::from(input.robot.incarnation));
        target || driver
    }

    /// Returns true if the person changed, because the operator has not enabled the new one. A session is one
    /// person of one client in one run of `ingest`.
    fn person_changed(&mut self, input: &Input) -> bool {
        input.target.session_nonce != 0 && self.session.changed(input.target.session_nonce)
    }

    /// Returns true if the tracking error is too large, or has been large for too long.
    ///
    /// It adds the time between samples while the error is large, and subtracts half of it while the error is small. So
    /// a joint that swings through its setpoint does not clear the count each time it passes. With amplitude A and
    /// bound b the error is large for the share s = (2 / pi) acos(b / A) of the time. The count grows if s > (1 - s) /
    /// 2, so from A = b / cos(pi / 6) = 1.15 b on. Written so that NaN counts as lost.
    fn tracking_lost(&mut self, config: &Config, input: &Input) -> bool {
        let (angle, length) = (input.robot.tracking_error_rad, input.robot.tracking_error_m);
        let small = angle <= config.tracking_error_rad && length <= config.tracking_error_m;
        let bearable = angle <= config.tracking_error_now_rad && length <= config.tracking_error_now_m;
        let counted_ns = input.robot.sample_ns.min(SAMPLE_MAX_NS);
        self.tracking_ns = if small {
            self.tracking_ns.saturating_sub(counted_ns / 2)
        } else {
            self.tracking_ns.saturating_add(counted_ns).min(config.tracking_error_ns + SAMPLE_MAX_NS)
        };
        !bearable || self.tracking_ns > config.tracking_error_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn message_with_future_stamp_never_looks_fresh() {
        let mut age = StreamAge::default();
        let now = Stamp(1000 * MS);
        assert_eq!(age.judge(now, now.plus_ns(3 * MS), MS, 0), u64::MAX, "never arrived");
        assert_eq!(age.judge(now, now.plus_ns(MS), MS, 0), 0, "taken while this process was on its way");
        let mut age = StreamAge::default();
        assert_eq!(age.judge(now, Stamp(990 * MS), MS, 0), 10 * MS);
        assert_eq!(age.judge(now, Stamp(u64::MAX), MS, 0), 11 * MS, "goes on ageing");
    }

    #[test]
    fn stamp_that_runs_backwards_does_not_refresh_age() {
        let mut age = StreamAge::default();
        let now = Stamp(1000 * MS);
        age.judge(now, Stamp(999 * MS), MS, 0);
        assert_eq!(age.judge(now.plus_ns(MS), Stamp(500 * MS), MS, 0), 2 * MS);
    }

    #[test]
    fn own_sleep_is_charged_to_writer_up_to_its_maximum() {
        let mut age = StreamAge::default();
        let now = Stamp(1000 * MS);
        age.judge(now, now, MS, 0);
        // This process and the writer slept for 50 ms. Only the charged maximum counts at once, then each further tick.
        assert_eq!(
            age.judge(now.plus_ns(50 * MS), now, charged_ns(50 * MS), 50 * MS - charged_ns(50 * MS)),
            CHARGE_MAX_NS
        );
        assert_eq!(age.judge(now.plus_ns(51 * MS), now, MS, 0), CHARGE_MAX_NS + MS);
        // A message that arrived during the sleep does not age by the sleep.
        assert_eq!(age.judge(now.plus_ns(101 * MS), now.plus_ns(60 * MS), CHARGE_MAX_NS, 49 * MS), 0);
        // A message that was old before the sleep stays old.
        assert_eq!(age.judge(now.plus_ns(300 * MS), now.plus_ns(61 * MS), CHARGE_MAX_NS, 9 * MS), 230 * MS);
    }

    #[test]
    fn stream_age_saturates() {
        let mut age = StreamAge { newest: Stamp(1), awake_ns: u64::MAX - 1 };
        assert_eq!(age.judge(Stamp(5), Stamp(1), 10, 0), u64::MAX);
    }
}
