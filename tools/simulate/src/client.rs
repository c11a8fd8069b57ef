//! The person in front of the camera, and the client that publishes the person. Simulates all that can go wrong
//! with the delivery.

use crate::active::Faults;
use crate::camera::Camera;
use crate::frames;
use crate::kinds::{Delivery, Fault};
use client::Player;
use messages::{Header, RawSkeleton, Stamp, TICK_HZ};
use rand::RngExt;

/// After this long (ticks) without an accepted frame, the person restarts the client: 1.5 s.
const PATIENCE: u64 = TICK_HZ * 3 / 2;

/// Ticks between two starts of a client that keeps restarting. Every second start comes before the previous
/// person is forgotten (1 s).
const RECONNECT: u64 = TICK_HZ / 2;

/// Session nonce of a client that publishes without the lease, or takes it.
const STRANGER: u64 = 0x5712_a26e;

/// Number of past frames that are kept.
const PAST: usize = 12;

#[derive(Clone)]
pub struct Client {
    player: Player,
    session: u64,
    sequence: u64,
    /// Added to the sequence of this session.
    sequence_offset: u64,
    last: Option<RawSkeleton>,
    past: Vec<RawSkeleton>,
    held_back: Vec<RawSkeleton>,
    let_through: u64,
    heard: u64,
    stranger_sequence: u64,
    camera: Option<Camera>,
}

/// Ticks for which a hand stays as it is.
const GRASP: u64 = 400;

/// Closure of a hand in its `n`-th grasp. One of five hands is not known.
fn closure(n: u64) -> Option<f32> {
    // The multiplier of Knuth's MMIX generator. Its high bits look random.
    let drawn = n.wrapping_mul(6_364_136_223_846_793_005) >> 40;
    Some(drawn % 5).filter(|&step| step < 4).map(|step| step as f32 / 3.0)
}

impl Client {
    /// Creates a client, which sees the person by a camera if there is one.
    pub fn new(player: Player, camera: Option<Camera>) -> Self {
        Self {
            camera,
            player,
            session: 1,
            sequence: 0,
            sequence_offset: 0,
            last: None,
            past: Vec::new(),
            held_back: Vec::new(),
            let_through: 0,
            heard: 0,
            stranger_sequence: 0,
        }
    }

    fn restart(&mut self, k: u64) {
        self.session += 1;
        (self.sequence, self.sequence_offset, self.heard) = (0, 0, k);
        self.last = None;
        self.held_back.clear();
    }

    /// Notes whether a frame was accepted in tick `k`. Restarts the client if none was for too long.
    pub fn listen(&mut self, k: u64, accepted: bool) {
        if accepted {
            self.heard = k;
        } else if k > self.heard + PATIENCE {
            self.restart(k);
        }
    }

    pub fn rebase(&mut self) {
        self.heard = 0;
    }

    /// Returns in `out` the frames that arrive in tick `k` of the run, whose deadline is `now`.
    pub fn tick(&mut self, k: u64, now: Stamp, engaged: bool, faults: &mut Faults, out: &mut Vec<RawSkeleton>) {
        out.clear();
        let reconnects = |fault| (fault == Fault::Delivery(Delivery::Reconnect)).then_some(());
        let mut restarts = false;
        faults.each(reconnects, |active, ()| {
            let again = active.age.is_multiple_of(RECONNECT);
            restarts |= again;
            again
        });
        if restarts {
            self.restart(k);
        }
        let burst = faults.active.iter().find(|active| active.fault == Fault::Delivery(Delivery::Burst));
        let burst = burst.map(|active| active.age);
        if let Some((_, mut raw)) = self.player.due(now, engaged) {
            self.sequence += 1;
            raw.session_nonce = self.session;
            raw.flags = messages::with_closure(raw.flags, [0, 1].map(|side| closure(2 * (k / GRASP) + side)));
            self.stamp(&mut raw, now, faults);
            let last = self.last;
            let of_frames = |fault| if let Fault::Frame(frame) = fault { Some(frame) } else { None };
            faults.each(of_frames, |active, frame| frames::alter(frame, active, &mut raw, last.as_ref()));
            self.remember(&raw);
            if self.deliver(k, faults) {
                out.push(raw);
            } else if burst.is_some() {
                self.held_back.push(raw);
            }
        }
        if burst.is_none_or(|age| age % (TICK_HZ / 5) == TICK_HZ / 5 - 1) {
            out.append(&mut self.held_back);
        }
        self.besides(now, faults, out);
        if let Some(camera) = &mut self.camera {
            out.retain_mut(|raw| camera.find(raw));
        }
    }

    fn remember(&mut self, raw: &RawSkeleton) {
        self.last = Some(*raw);
        if self.past.len() == PAST {
            self.past.remove(0);
        }
        self.past.push(*raw);
    }

    /// Sets the sequence and the stamps as the client believes them to be.
    fn stamp(&mut self, raw: &mut RawSkeleton, now: Stamp, faults: &mut Faults) {
        let (sequence, last) = (self.sequence, self.last.map(|last| last.header));
        let offset = &mut self.sequence_offset;
        let mut origin = now;
        let mut same = false;
        faults.each(as_delivery, |active, delivery| match delivery {
            Delivery::StampBack if active.acts() => {
                origin = Stamp(origin.0.saturating_sub(active.rng.random_range(1_000_000..500_000_000)));
                true
            }
            Delivery::StampFuture if active.acts() => {
                origin = origin.plus_ns(active.rng.random_range(2_000_001..10_000_000_000));
                true
            }
            Delivery::StampDouble if active.acts() => {
                same = true;
                last.is_some()
            }
            Delivery::Drift => {
                let drift_ns = (active.age * 1_000_000_000 / TICK_HZ) / 2000;
                let ahead = active.episode.param.is_multiple_of(2);
                origin = if ahead { origin.plus_ns(drift_ns) } else { Stamp(origin.0 - drift_ns) };
                drift_ns > 0
            }
            Delivery::ClockStep => {
                let step_ns = (active.strength * 90e6) as u64;
                let ahead = active.episode.param.is_multiple_of(2);
                origin = if ahead { origin.plus_ns(step_ns) } else { Stamp(origin.0 - step_ns) };
                true
            }
            Delivery::SequenceWrap if active.note == 0 => {
                active.note = 1;
                *offset = (u64::MAX - 5).wrapping_sub(sequence);
                false
            }
            Delivery::SequenceWrap => sequence.checked_add(*offset).is_none(),
            _ => false,
        });
        raw.header.sequence = sequence.wrapping_add(self.sequence_offset);
        raw.header.origin = origin;
        raw.header.stamp = now;
        if let (true, Some(last)) = (same, last) {
            (raw.header.sequence, raw.header.origin) = (last.sequence, last.origin);
        }
    }

    /// Returns true if the frame of this tick leaves the client.
    fn deliver(&mut self, k: u64, faults: &mut Faults) -> bool {
        let starved = k < self.let_through + TICK_HZ / 5;
        let mut through = true;
        faults.each(as_delivery, |_, delivery| {
            let keeps = match delivery {
                Delivery::Loss | Delivery::Burst | Delivery::HolderPauses => true,
                Delivery::Starve => starved,
                _ => false,
            };
            through &= !keeps;
            keeps
        });
        if through {
            self.let_through = k;
        }
        through
    }

    /// Adds the frames that arrive in addition to the person's own.
    fn besides(&mut self, now: Stamp, faults: &mut Faults, out: &mut Vec<RawSkeleton>) {
        let Some(last) = &self.last else { return };
        let (past, strangers) = (&self.past, &mut self.stranger_sequence);
        let (sequence, offset, session) = (&mut self.sequence, self.sequence_offset, self.session);
        let mut counted = Vec::new();
        faults.each(as_delivery, |active, delivery| {
            let before = out.len();
            match delivery {
                Delivery::Flood => {
                    // 10 kHz is 6 or 7 frames per tick.
                    for n in 0..6 {
                        *sequence += 1;
                        let (sequence, origin) = (sequence.wrapping_add(offset), now.plus_ns(n + 1));
                        out.push(RawSkeleton { header: Header { sequence, origin, ..last.header }, ..*last });
                    }
                }
                Delivery::StrangerFloods | Delivery::Stranger | Delivery::HolderPauses => {
                    let rate = if delivery == Delivery::StrangerFloods { 6 } else { u64::from(active.age % 25 == 12) };
                    for n in 0..rate {
                        *strangers += 1;
                        let (sequence, at) = (*strangers, now.plus_ns(n));
                        let header = Header { sequence, origin: at, stamp: at, ..last.header };
                        out.push(RawSkeleton { header, session_nonce: STRANGER ^ active.episode.param, ..*last });
                    }
                }
                Delivery::Replayed if active.age % 10 == 3 => out.push(past[active.rng.random_range(0..past.len())]),
                Delivery::OldSession if active.age % 10 == 3 => {
                    // An old frame of another session with its own sequence and stamps, or with a fresh origin stamp.
                    let mut old = past[active.rng.random_range(0..past.len())];
                    old.session_nonce = session.wrapping_sub(1);
                    if active.rng.random() {
                        old.header.origin = now;
                    }
                    out.push(old);
                }
                _ => {}
            }
            counted.push((active.episode.kind, (out.len() - before) as u64));
            false
        });
        counted.into_iter().for_each(|(kind, count)| faults.count(kind, count));
    }
}

fn as_delivery(fault: Fault) -> Option<Delivery> {
    if let Fault::Delivery(delivery) = fault { Some(delivery) } else { None }
}
