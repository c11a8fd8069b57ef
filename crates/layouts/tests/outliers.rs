//! Single outliers are replaced, for one frame. Motion is not, and no error is hidden from the validation.

use crate::client::{CAMERA, PERIOD_NS, as_smpl, bent};
use crate::salt::{Chance, Errors, OFF, ON, Places, builtin, distance_m, filter, spoil};
use layouts::{Noise, NoiseState};
use messages::{RawSkeleton, Stamp};

/// Filter without the low-pass. Its output is the input, or the position at which the joint was held.
const BARE: Noise = Noise { rest_cutoff_hz: 1e12, cutoff_per_m: 0.0, ..ON };
const WRIST: usize = 20;
/// 30 Hz, s.
const PERIOD_S: f32 = PERIOD_NS as f32 * 1e-9;

/// Frames of a person who stands still, except for a wrist.
struct Camera {
    noise: Noise,
    state: NoiseState,
    frame: u64,
    at: Stamp,
}

impl Camera {
    fn new(noise: Noise) -> Self {
        Self { noise, state: NoiseState::default(), frame: 0, at: Stamp(1_000_000_000) }
    }

    /// Returns the filtered offset of a wrist that is off by `off`, m.
    fn see(&mut self, off: [f32; 3]) -> [f32; 3] {
        self.see_changed(off, PERIOD_NS, &|_| ())
    }

    /// As [`Self::see`], `after_ns` after the last frame, with a further change.
    fn see_changed(&mut self, off: [f32; 3], after_ns: u64, change: &dyn Fn(&mut RawSkeleton)) -> [f32; 3] {
        let mut raw = as_smpl(&bent(), false);
        let rest = raw.positions[WRIST];
        self.at = self.at.plus_ns(after_ns);
        (raw.header.sequence, raw.header.origin) = (self.frame + 1, self.at);
        raw.positions[WRIST] = [0, 1, 2].map(|i| rest[i] + off[i]);
        // A change of another joint, so that no frame repeats the previous one.
        raw.positions[15][2] += 0.0001 * (self.frame % 2) as f32;
        change(&mut raw);
        self.noise.filter(&mut self.state, CAMERA, &mut raw);
        self.frame += 1;
        [0, 1, 2].map(|i| raw.positions[WRIST][i] - rest[i])
    }

    /// A camera that has seen the wrist at rest for `frames` frames.
    fn after(noise: Noise, frames: usize) -> Self {
        let mut camera = Self::new(noise);
        (0..frames).for_each(|_| _ = camera.see([0.0; 3]));
        camera
    }
}

fn near(a: [f32; 3], b: [f32; 3], by_m: f64) -> bool {
    distance_m(a, b) < by_m
}

const WILD: [f32; 3] = [0.0, 0.08, 0.0];

#[test]
fn f017_wrist_outlier_of_one_frame_is_replaced() {
    // To the side and ahead, and to the side as far as is not yet a jump.
    let (aside, far) = ([-0.05_f32, 0.06, 0.0], [0.0, 0.125, 0.0]);
    for (speed_m_per_s, wild) in [(0.0_f32, aside), (0.5, aside), (2.5, aside), (1.9, far)] {
        let way = |i: u64| [0.3 - speed_m_per_s * i as f32 * PERIOD_S, 0.0, 0.0];
        let (mut camera, mut calm) = (Camera::new(ON), Camera::new(ON));
        for i in 0..40 {
            let clean = calm.see(way(i));
            let off = if i == 25 || i == 33 { wild } else { [0.0; 3] };
            let out = camera.see([0, 1, 2].map(|k| way(i)[k] + off[k]));
            assert!(near(out, clean, 1e-4), "{speed_m_per_s} m/s, frame {i}: {out:?}, {clean:?}");
        }
        assert_eq!((camera.state.rejected(), calm.state.rejected()), (2, 0));
    }
}

#[test]
fn position_that_repeats_after_outlier_passes_one_frame_late() {
    let mut camera = Camera::after(BARE, 30);
    assert!(near(camera.see(WILD), [0.0; 3], 1e-6), "held");
    for i in 1..20 {
        assert!(near(camera.see(WILD), WILD, 1e-6), "{i} frames later");
    }
    assert_eq!(camera.state.rejected(), 1);
}

#[test]
fn joint_is_never_held_in_two_frames_in_a_row() {
    let mut camera = Camera::after(Noise { outliers_mad: 1e-3, ..BARE }, 30);
    let (mut held, mut chance) = (false, Chance(1));
    for i in 0..2000 {
        let off = [0; 3].map(|_| 0.08 * (chance.uniform() - 0.5));
        let out = camera.see(off);
        let now = !near(out, off, 1e-6);
        assert!(!(held && now), "frame {i}: {out:?} for {off:?}");
        held = now;
    }
    assert!(camera.state.rejected() > 100, "{}", camera.state.rejected());
}

#[test]
fn outlier_threshold_rises_for_noisy_joint() {
    // The wrist becomes noisy, the elbow does not.
    let mut camera = Camera::after(BARE, 30);
    let tremble = |i: usize| [[0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [-0.02, 0.0, 0.02], [0.0, -0.02, -0.02]][i % 4];
    (0..40).for_each(|i| _ = camera.see(tremble(i)));
    assert_eq!(camera.state.rejected(), 0);
    let out = camera.see_changed(WILD, PERIOD_NS, &|raw| raw.positions[18][1] += WILD[1]);
    assert!(near(out, WILD, 1e-6), "{out:?}");
    assert_eq!(camera.state.rejected(), 1, "the elbow alone");
}

#[test]
fn bunched_stamps_make_no_outlier() {
    let mut camera = Camera::new(ON);
    for i in 0..60_u32 {
        let after_ns = if i % 10 == 9 { 3_000_000 } else { PERIOD_NS };
        camera.see_changed([1.0 * i as f32 * PERIOD_S, 0.0, 0.0], after_ns, &|_| ());
    }
    assert_eq!(camera.state.rejected(), 0);
}

#[test]
fn f007_jump_beyond_step_is_no_outlier() {
    let mut camera = Camera::after(ON, 30);
    let far = [0.0, 0.2, 0.0];
    assert!(near(camera.see(far), far, 1e-6));
    // The filter restarts: it does not know where the joint goes from there.
    assert!(!near(camera.see([0.0, 0.28, 0.0]), far, 1e-3));
    assert_eq!(camera.state.rejected(), 0);
}

#[test]
fn held_joint_that_returns_does_not_restart_filter() {
    // 12 cm to one side, and back while it moves on by 4 cm. That is more than the step from its last input
    // position.
    let (mut camera, mut calm) = (Camera::new(ON), Camera::new(ON));
    for i in 0..40 {
        let way = [0.0, -1.2 * i as f32 * PERIOD_S, 0.0];
        let clean = calm.see(way);
        let out = camera.see([0.0, way[1] + if i == 30 { 0.12 } else { 0.0 }, 0.0]);
        // The joint is held where it could have stopped, 4 cm behind. Afterwards it is filtered. After a restart
        // it would not be.
        assert!(near(out, clean, 0.04), "frame {i}: {out:?} {clean:?}");
        assert!(i == 0 || !near(out, way, 1e-3), "frame {i} begins anew");
    }
    assert_eq!(camera.state.rejected(), 1);
}

#[test]
fn outlier_is_found_only_after_eleven_frames() {
    let first = (0..30).find(|&n| !near(Camera::after(BARE, n).see(WILD), WILD, 1e-6));
    // Four positions, and seven residuals.
    assert_eq!(first, Some(11));
}

#[test]
fn outlier_history_restarts_on_new_session_person_or_pause() {
    type Change<'a> = (u64, f32, &'a dyn Fn(&mut RawSkeleton));
    let changes: [Change<'_>; 4] = [
        (PERIOD_NS, 0.08, &|raw| raw.session_nonce = 8),
        (PERIOD_NS, 0.08, &|raw| raw.operator_id = 2),
        (300_000_000, 0.7, &|_| ()),
        (3 * PERIOD_NS, 0.3, &|_| ()),
    ];
    for (i, (after_ns, far, change)) in changes.into_iter().enumerate() {
        let (mut camera, off) = (Camera::after(BARE, 30), [0.0, far, 0.0]);
        assert!(near(camera.see_changed(off, after_ns, change), off, 1e-6), "change {i}");
        assert_eq!(camera.state.rejected(), 0);
    }
    let mut camera = Camera::after(BARE, 30);
    let out = camera.see_changed([0.0, 0.13, 0.0], 2 * PERIOD_NS, &|_| ());
    assert!(near(out, [0.0; 3], 1e-6), "one frame may be lost");
    camera.see_changed([0.0; 3], PERIOD_NS, &|raw| raw.session_nonce = 8);
    assert_eq!(camera.state.rejected(), 1, "the count goes on");
}

#[test]
fn fast_arm_is_no_outlier() {
    // A circle of 0.25 m twice a second, 3.1 m/s and 39 m/s^2, that starts and ends within 0.1 s. The stamps are
    // uneven.
    let mut camera = Camera::after(ON, 30);
    let mut angle = 0.0;
    for i in 0..90_u32 {
        let jitter_ns = if i.is_multiple_of(3) { 8_000_000 } else { 0 };
        let share = i.min(60_u32.saturating_sub(i)).min(3) as f32 / 3.0;
        angle += share * std::f32::consts::TAU * 2.0 * PERIOD_S;
        camera.see_changed([0.25 * angle.sin(), 0.0, 0.25 * angle.cos() - 0.25], PERIOD_NS + jitter_ns, &|_| ());
    }
    assert_eq!(camera.state.rejected(), 0);
}

/// RMS and largest error compared with the filtered clean motion without rejection, m.
fn errors(noise: &Noise, clean: &[Places], noise_m: f32, p: f32) -> Errors {
    let mut errors = Errors::default();
    let (expected, got) = (filter(&OFF, clean, 30.0), filter(noise, &spoil(clean, noise_m, p), 30.0));
    assert_eq!(expected.rejected, 0, "a threshold of zero finds none");
    for (a, b) in expected.frames.iter().flatten().zip(got.frames.iter().flatten()) {
        errors.add(distance_m(*a, *b));
    }
    errors
}

#[test]
fn filter_reduces_outlier_error_and_keeps_noise_level() {
    let clean = builtin(30.0);
    for (noise_m, share) in [(0.0, 0.65), (0.005, 0.9), (0.01, 1.0)] {
        let (off, on) = (errors(&OFF, &clean, noise_m, 0.01), errors(&ON, &clean, noise_m, 0.01));
        assert!(on.rms() < share * off.rms(), "{noise_m}: {} of {}", on.rms(), off.rms());
        assert!(on.largest < 1.1 * off.largest, "{noise_m}: {} of {}", on.largest, off.largest);
        let (off, on) = (errors(&OFF, &clean, noise_m, 0.0), errors(&ON, &clean, noise_m, 0.0));
        assert!(on.rms() <= 1.01 * off.rms(), "{noise_m}, no salt: {} of {}", on.rms(), off.rms());
    }
    let (off, on) = (errors(&OFF, &clean, 0.01, 0.03), errors(&ON, &clean, 0.01, 0.03));
    assert!(on.rms() < 0.905 * off.rms(), "{} of {}", on.rms(), off.rms());
    let accepted = |noise| filter(noise, &spoil(&clean, 0.005, 0.02), 30.0).accepted;
    assert!(accepted(&ON) > accepted(&OFF), "{} of {}", accepted(&ON), accepted(&OFF));
}
