//! The stage: skeletons in, joint targets out, 1500 times a second.

use messages::{
    Fault, Faults, JointTarget, LIMBS, Layout, PersonChange, Skeleton, Stamp, TICK_S, TRAJECTORY_NODES, skeleton_flag,
    target_flag,
};
use robot::{POINTING_JOINTS, PointingJoints};

use crate::arm::{ARM_Q, ARMS, ArmQ};
use crate::config::Config;
use crate::contact::{Memory, PersonGeometry};
use crate::height::crouch_m;
use crate::limb_trajectory::{LimbTrajectory, Person};
use crate::network::Latent;
use crate::pointing::{Blend, human_closure, human_hand, human_head};
use crate::prediction::{AGES_S, History, Prediction};
use crate::ready::Readiness;
use crate::resample::{Sample, SourceClock, Track};
use robot::Limbs;
use robot::limbs::{on_side, xyzw_from_rotation};

/// Velocities are differences over at most this many ticks. Beyond 10 ms a target is stale (service table).
const VELOCITY_TICKS_MAX: u64 = 15;
/// Time without a skeleton after which an arm is no longer used, ns (assumption). The operator continues with the
/// other arm, and must enable the robot again.
const FORGOTTEN_NS: u64 = 10_000_000_000;
/// Largest time step of one skeleton for the lift, s. After a pause the lift continues as slowly.
const STEP_MAX_S: f64 = 0.1;
/// Odd, so that different counts give different sessions: the multiplier of Knuth's MMIX generator.
const FORGOTTEN_MIX: u64 = 6_364_136_223_846_793_005;
/// Odd as well: the multiplier of MurmurHash3's finaliser.
const PERSON_MIX: u64 = 0xff51_afd7_ed55_8ccd;

/// Input of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Tick index.
    pub k: u64,
    /// The newest skeleton. The same one may be given again.
    pub skeleton: Option<&'a Skeleton>,
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Skeletons that were used.
    pub skeletons: u64,
    /// Arms whose limbs were marked valid but were no rotations.
    pub limbs_refused: u64,
    /// Results of the network that were not finite and were dropped.
    pub network_not_finite: u64,
}

/// State of the stage. Fixed size, no heap.
#[derive(Clone, Debug, Default)]
pub struct State {
    clock: SourceClock,
    readiness: Readiness,
    forgotten: u64,
    tracks: [Track; ARMS],
    /// For the correction of hands that touch.
    touch: Memory,
    /// Target of the lift, m. `None` until a person's height is known.
    lift: Option<f64>,
    /// Source time of the newest skeleton, ns.
    source: i64,
    /// The head, as an upper arm of its own track.
    head: Track,
    /// Turns of the left hand, the right hand and the head.
    blends: [Blend; 3],
    refined: [Option<ArmQ>; ARMS],
    q: [Option<ArmQ>; ARMS],
    dq: [ArmQ; ARMS],
    k: u64,
    received: Stamp,
    origin: Stamp,
    sequence: u64,
    session: u64,
    /// Session of the newest skeleton, without the count of forgotten arms.
    person: u64,
    /// Reason why it differs from the session before.
    change: PersonChange,
    /// The newest skeleton holds the clutch.
    clutch: bool,
    /// It is what one camera sees.
    one_camera: bool,
    counters: Counters,
    trajectory: LimbTrajectory,
}

/// The target of one tick, with details.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// The message. Its header contains only `origin`: the process fills in the rest.
    pub target: JointTarget,
    /// Per arm (left, right): true if a person drives it.
    pub fresh: [bool; ARMS],
    /// Points of the latent space (left, right). Zero without a network.
    pub latents: [Latent; ARMS],
    /// Rotation angles between robot and person, indexed by `Limb`, rad. Zero for an arm without a person.
    pub limb_error_rad: [f64; LIMBS],
    /// `InputStale` while an arm in use is not fresh or the input has not been steady. `InputImplausible` in a
    /// tick that dropped something.
    pub faults: Faults,
    /// Counts since the start.
    pub counters: Counters,
}

/// Advances the stage by one period. It is deterministic, and never allocates, blocks, logs, reads a clock or panics.
///
/// ```
/// # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
/// # let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
/// use retarget::{Config, Input, Method, Settings, State, tick};
///
/// let settings = Settings { method: Method::ClosedForm, ..Settings::default() };
/// let config = Config::new(&model, None, &settings)?; // It needs no weights.
/// let out = tick(&config, &mut State::default(), messages::deadline(7), Input { k: 7, skeleton: None });
/// assert_eq!(out.fresh, [false; 2]); // Nobody is there.
/// assert_eq!(out.target.q, model.home);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    let before = state.counters;
    if let Some(skeleton) = input.skeleton {
        accept_skeleton(config, state, now, skeleton);
    }
    forget(state, now);
    let playhead = state.clock.advance(now, config.delays_ns[usize::from(state.one_camera)]);
    let [left, right] = &mut state.tracks;
    let shown = [left, right].map(|track| track.show(playhead, now));
    if !state.head.is_fresh(now) {
        state.head = Track::default();
    }
    let head = state.head.show(playhead, now).map(|head| head.limbs.upper);
    let postures = config.solver.next(&shown, &state.refined);
    let ticks = input.k.saturating_sub(state.k);
    for arm in 0..ARMS {
        // An arm without a result keeps its last posture.
        let Some(q) = postures[arm] else {
            state.counters.network_not_finite += u64::from(shown[arm].is_some());
            continue;
        };
        state.refined[arm] = Some(q);
        if ticks > 0 {
            state.dq[arm] = velocity(&config.velocity_max[arm], state.q[arm], &q, ticks);
        }
        state.q[arm] = Some(q);
    }
    state.k = input.k;
    let in_use = std::array::from_fn(|arm| state.q[arm].is_some());
    let fresh = std::array::from_fn(|arm| in_use[arm] && state.tracks[arm].is_fresh(now));
    let ready = state.readiness.judge(now, in_use, fresh);
    let mut out = assemble(config, state, fresh, ready, input.k, &shown);
    let elapsed_s = ticks.min(VELOCITY_TICKS_MAX) as f64 * TICK_S;
    point_hands(config, state, &shown, elapsed_s, &mut out.target);
    let head = state.blends[ARMS].next(head, elapsed_s);
    if let (Some(joints), Some(head)) = (&config.head, head) {
        set(&mut out.target, joints, joints.nearest(&head, joints.home));
    }
    if let (Some(lift), Some(q)) = (&config.lift, state.lift) {
        (out.target.q[lift.joint], out.target.valid_mask) = (q, out.target.valid_mask | 1 << lift.joint);
    }
    let State { tracks, trajectory, blends: [left, right, _], counters, .. } = state;
    let touches = config.correction.weight > 0.0;
    let robot = touches.then_some((&config.solver.arms, &config.correction.robot));
    let person = Person { tracks, blends: [left, right], skeletons: counters.skeletons, in_use, robot };
    trajectory.update(&person, input.k, playhead, now);
    (out.target.trajectory_first, out.target.trajectory_nodes, out.target.trajectory_measured) =
        (trajectory.first, TRAJECTORY_NODES as u32, trajectory.measured);
    (out.target.limb_trajectory, out.target.hand_trajectory, out.target.hand_places) =
        (trajectory.nodes, trajectory.hands, trajectory.places);
    let dropped = state.counters.limbs_refused + state.counters.network_not_finite
        > before.limbs_refused + before.network_not_finite;
    out.faults.set(Fault::InputImplausible, dropped);
    out
}

/// Sets the wrist targets of arms with a known or fading hand: the positions nearest to the person's hand, from the target's
/// forearm.
fn point_hands(
    config: &Config,
    state: &mut State,
    shown: &[Option<Sample>; ARMS],
    elapsed_s: f64,
    target: &mut JointTarget,
) {
    for (arm, joints) in config.wrists.iter().enumerate() {
        let Some(q) = state.q[arm] else { continue };
        let own = |turn| on_side(arm, &turn);
        let hand = shown[arm].and_then(|sample| sample.hand);
        let fore = config.solver.arms[arm].forward(&q).fore;
        let bend = state.blends[arm].next(hand.map(|hand| own(fore.inverse() * hand)), elapsed_s);
        target.human_hands[arm] = hand.map_or([0.0; 4], |hand| xyzw_from_rotation(&own(hand)));
        if let Some(bend) = bend {
            set(target, joints, joints.nearest(&bend, joints.home));
        }
        if shown[arm].is_some_and(|sample| sample.touching.is_some()) {
            target.flags |= target_flag::TOUCHING[arm];
        }
        if let Some(closure) = shown[arm].and_then(|sample| sample.closure) {
            target.closure[arm] = closure as f32;
            target.flags |= target_flag::CLOSURE[arm];
        }
    }
}

/// Sets the joints of a hand or a head in a target.
fn set(target: &mut JointTarget, joints: &PointingJoints, q: [f64; POINTING_JOINTS]) {
    for (j, q) in joints.with(q) {
        target.q[j] = q;
        target.valid_mask |= 1 << j;
    }
}

/// Stops using an arm that has not been seen for long while the other one was.
fn forget(state: &mut State, now: Stamp) {
    for (arm, other) in [(0, 1), (1, 0)] {
        let gone = now.since(state.tracks[arm].received()) > FORGOTTEN_NS;
        if state.q[arm].is_some() && gone && state.tracks[other].is_fresh(now) {
            state.tracks[arm] = Track::default();
            (state.refined[arm], state.q[arm], state.dq[arm]) = (None, None, [0.0; ARM_Q]);
            state.forgotten = state.forgotten.wrapping_add(1);
            state.change = PersonChange::ArmForgotten;
        }
    }
}

/// Encodes the arms of a new skeleton and adds them to their tracks.
fn accept_skeleton(config: &Config, state: &mut State, now: Stamp, skeleton: &Skeleton) {
    // A stamp in the future would stay fresh for too long.
    let received = skeleton.received.min(now);
    let Some(placed) = state.clock.place(skeleton, received) else {
        return;
    };
    state.counters.skeletons += 1;
    state.clutch = skeleton.flags & skeleton_flag::CLUTCH != 0;
    state.one_camera = skeleton.flags & skeleton_flag::ONE_CAMERA != 0;
    let counters = &mut state.counters;
    let arms = [0, 1].map(|arm| config.follows[arm].then(|| human_arm(skeleton, arm, counters)).flatten());
    if placed.restart {
        // Another person has other lengths.
        state.touch = Memory::default();
    }
    let arms = correct_contacts(config, state, skeleton, &arms, placed.source);
    let touching = state.touch.postures();
    let latents = config.solver.encode(&arms.map(|limbs| limbs.unwrap_or_else(Limbs::identity)));
    let mut used = [false; ARMS];
    for arm in 0..ARMS {
        let Some(limbs) = arms[arm] else { continue };
        let latent = latents[arm];
        if latent.iter().all(|x| x.is_finite()) {
            let hand = human_hand(skeleton, arm);
            let closure = human_closure(skeleton, arm);
            state.tracks[arm].push(
                placed,
                Sample { latent, limbs, hand, closure, touching: touching[arm] },
                received,
                now,
            );
            used[arm] = true;
        } else {
            state.counters.network_not_finite += 1;
        }
    }
    if let Some(head) = human_head(skeleton) {
        let limbs = Limbs { upper: head, ..Limbs::identity() };
        state.head.push(
            placed,
            Sample { latent: Latent::default(), limbs, hand: None, closure: None, touching: None },
            received,
            now,
        );
    }
    if let Some(prediction) = &config.prediction {
        extrapolate(prediction, &mut state.tracks, used, placed.source);
    }
    if used.contains(&true) {
        let session = session(skeleton, state.forgotten);
        state.readiness.arrived(received, placed.restart, session != state.session);
        state.received = received;
        state.origin = skeleton.header.origin;
        state.sequence = skeleton.header.sequence;
        state.session = session;
        let person = self::session(skeleton, 0);
        if person != std::mem::replace(&mut state.person, person) {
            state.change = PersonChange::from_flags(skeleton.flags);
        }
    }
}

/// Applies the contact correction to the limbs, and moves the lift to the person's height.
fn correct_contacts(
    config: &Config,
    state: &mut State,
    skeleton: &Skeleton,
    arms: &[Option<Limbs>; ARMS],
    source: i64,
) -> [Option<Limbs>; ARMS] {
    let elapsed_s = source.saturating_sub(std::mem::replace(&mut state.source, source)).max(0) as f64 * 1e-9;
    let Some(geometry) = PersonGeometry::measure(&skeleton.positions, arms) else {
        state.touch = Memory::default();
        return *arms;
    };
    if let (Some(lift), Some(crouch_m)) = (&config.lift, crouch_m(&skeleton.positions)) {
        let scale = config.correction.robot[0].reach_m / geometry.reach_m;
        let before = state.lift.unwrap_or(lift.home);
        state.lift = Some(lift.next(before, crouch_m * scale, elapsed_s.min(STEP_MAX_S)));
    }
    if config.correction.weight > 0.0 {
        let hands = [0, 1].map(|arm| human_hand(skeleton, arm));
        config.correction.apply(config.solver.arms.each_ref(), &geometry, (arms, &hands), elapsed_s, &mut state.touch)
    } else {
        *arms
    }
}

/// Extrapolates the arms of a new skeleton at `source`. An arm that was never seen is assumed to equal the other one.
fn extrapolate(prediction: &Prediction, tracks: &mut [Track; ARMS], new: [bool; ARMS], source: i64) {
    let pasts = [tracks[0].past(source), tracks[1].past(source)];
    let histories = [0, 1].map(|arm| {
        let (own, own_before) = pasts[arm].filter(|_| new[arm] && tracks[arm].is_predictable())?;
        let (other, other_before) = pasts[1 - arm].unwrap_or((own, [own; AGES_S.len()]));
        Some(History { newest: [own, other], before: std::array::from_fn(|i| [own_before[i], other_before[i]]) })
    });
    // Most of the time goes into reading the weights, so both arms share it.
    let turns = match histories {
        [Some(left), Some(right)] => prediction.turns(&[left, right]),
        alone => alone.map(|history| prediction.turns(&[history?])[0]),
    };
    for (track, turns) in tracks.iter_mut().zip(turns) {
        if let Some(turns) = turns {
            track.extrapolate(&turns);
        }
    }
}

/// Mixes the session of the target from the client's session, the incarnation of `ingest`, the person, and the count of
/// forgotten arms. A change of any of them needs a new enable edge. Never zero, because zero stands for no session.
fn session(skeleton: &Skeleton, forgotten: u64) -> u64 {
    // 2^64 over the golden ratio. It is odd, so different incarnations stay different.
    let ingest = u64::from(skeleton.header.incarnation).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let person = u64::from(skeleton.operator_id).wrapping_mul(PERSON_MIX);
    (skeleton.session_nonce ^ ingest ^ person ^ forgotten.wrapping_mul(FORGOTTEN_MIX)).max(1)
}

/// Returns the limbs of one arm, mirrored to a left arm. `None` if a flag is not set, or if a limb is no rotation.
fn human_arm(skeleton: &Skeleton, arm: usize, counters: &mut Counters) -> Option<Limbs> {
    let bits = skeleton_flag::LIMB[2 * arm] | skeleton_flag::LIMB[2 * arm + 1];
    if skeleton.flags & bits != bits {
        return None;
    }
    let limbs = [skeleton.limbs[2 * arm], skeleton.limbs[2 * arm + 1]].map(|limb| limb.map(f64::from));
    let limbs = Limbs::from_arm(arm, limbs);
    if limbs.is_none() {
        counters.limbs_refused += 1;
    }
    limbs
}

/// Finite difference over `ticks` ticks, bounded by the velocity limits, rad/s. Zero if there is no previous
/// posture or it is too old.
fn velocity(most: &ArmQ, before: Option<ArmQ>, q: &ArmQ, ticks: u64) -> ArmQ {
    let Some(before) = before.filter(|_| ticks <= VELOCITY_TICKS_MAX) else {
        return [0.0; ARM_Q];
    };
    let dt = ticks as f64 * TICK_S;
    std::array::from_fn(|j| ((q[j] - before[j]) / dt).max(-most[j]).min(most[j]))
}

fn assemble(
    config: &Config,
    state: &State,
    fresh: [bool; ARMS],
    ready: bool,
    k: u64,
    shown: &[Option<Sample>; ARMS],
) -> Output {
    let mut target = JointTarget { k, q: config.home, robot: config.robot, ..JointTarget::ZERO };
    let mut limb_error_rad = [0.0; LIMBS];
    for arm in 0..ARMS {
        let (Some(sample), Some(q)) = (shown[arm], state.q[arm]) else {
            continue;
        };
        for (j, joint) in config.joints[arm].into_iter().enumerate().filter_map(|(j, joint)| Some((j, joint?))) {
            // A right arm was solved as the left arm that mirrors it.
            target.q[joint] = config.signs[arm][j] * q[j];
            target.dq[joint] = config.signs[arm][j] * state.dq[arm][j];
            target.valid_mask |= 1 << joint;
        }
        let limbs = [sample.limbs.upper, sample.limbs.fore].map(|limb| xyzw_from_rotation(&on_side(arm, &limb)));
        target.human_limbs[2 * arm..2 * arm + 2].copy_from_slice(&limbs);
        let error = config.solver.arms[arm].limb_error_deg(&q, &sample.limbs);
        limb_error_rad[2 * arm..2 * arm + 2].copy_from_slice(&error.map(f64::to_radians));
    }
    target.header.origin = state.origin;
    target.input_received = state.received;
    target.input_sequence = state.sequence;
    target.session_nonce = state.session;
    target.flags = state.change.flags() | if ready { target_flag::INPUT_FRESH } else { 0 };
    target.flags |= if state.clutch { target_flag::CLUTCH } else { 0 };
    let latents = shown.map(|sample| sample.map_or(Latent::default(), |sample| sample.latent));
    let mut faults = Faults::NONE;
    faults.set(Fault::InputStale, !ready);
    Output { target, fresh, latents, limb_error_rad, faults, counters: state.counters }
}
