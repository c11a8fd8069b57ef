//! Prediction beyond the newest skeleton, learnt from recorded motion: the shipped weights.

use crate::limb_trajectory::{
    DELAY_MS, Person, apart, config, newest_s, node, run, shown_s, skeleton, source_at, swings, turn,
};
use crate::support::{prediction, prediction_files};

use std::f64::consts::TAU;

use messages::{JointTarget, Skeleton, TRAJECTORY_NODES, skeleton_flag};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{
    AGES_S, Config, Dense, HORIZONS_S, History, Limbs, PREDICTION_INPUTS, PREDICTION_WIDTHS, Prediction,
    limb_error_deg, turns_at,
};

fn learnt() -> Config {
    config(DELAY_MS).with_prediction(Some(prediction()))
}

/// Both arms swing forward and back beside the body, in opposition, as in walking.
fn walks(t_s: f64) -> [Limbs; 2] {
    [0.0, 0.5].map(|phase| {
        let swing = (TAU * (0.9 * t_s + phase)).sin();
        // From the T-pose down, then forward and back about the axis to the left.
        let upper = turn(Vector3::y(), -0.5 * swing) * turn(Vector3::x(), -1.3);
        let bend = 0.5 + 0.3 * (TAU * (0.9 * t_s + phase) - 0.4).sin();
        Limbs { upper, fore: turn(Vector3::y(), -bend) * upper }
    })
}

/// Both arms stir around the vertical, faster than any recorded one.
fn stirs(t_s: f64) -> [Limbs; 2] {
    let yaw = turn(Vector3::z(), 8.0 * t_s);
    let upper = yaw * turn(Vector3::y(), 1.0) * yaw.inverse();
    [Limbs { upper, fore: turn(Vector3::z(), 0.7) * upper }; 2]
}

/// Mean angle between the predicted nodes of these arms and the person's later motion, degrees, from 1 s on.
fn off_deg(config: &Config, skeletons: &[Skeleton], person: Person, arms: &[usize]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (now, target) in &run(config, skeletons, 3.9)[1500..] {
        for i in target.trajectory_measured as usize..TRAJECTORY_NODES {
            let then = person(shown_s(*now, target, i));
            for &arm in arms {
                let limbs = node(target, i)[arm].expect("it is meant");
                sum += limb_error_deg(&limbs, &then[arm]).iter().sum::<f64>() / 2.0;
                count += 1.0;
            }
        }
    }
    sum / count
}

fn both_deg(skeletons: &[Skeleton], person: Person, arms: &[usize]) -> [f64; 2] {
    let both = [config(DELAY_MS), learnt()].map(|config| off_deg(&config, skeletons, person, arms));
    println!("fading {:.2}, learnt {:.2} degrees", both[0], both[1]);
    both
}

#[test]
fn swing_is_predicted_better_than_by_fading_turn() {
    for rate_hz in [20.0, 60.0, 240.0] {
        let [fading, learnt] = both_deg(&source_at(walks, 4.0, rate_hz), walks, &[0, 1]);
        assert!(learnt < 0.9 * fading, "{rate_hz} Hz: learnt {learnt}, fading {fading} degrees");
    }
    let [fading, learnt] = both_deg(&source_at(stirs, 4.0, 60.0), stirs, &[0, 1]);
    assert!(learnt < fading, "stirs: learnt {learnt}, fading {fading} degrees");
    let mut skeletons = source_at(walks, 4.0, 60.0);
    for skeleton in &mut skeletons {
        skeleton.flags &= !(skeleton_flag::LIMB[2] | skeleton_flag::LIMB[3]);
    }
    let [fading, learnt] = both_deg(&skeletons, walks, &[0]);
    assert!(learnt < 0.9 * fading, "one arm: learnt {learnt}, fading {fading} degrees");
    // With noise.
    let mut rng = Pcg64::seed_from_u64(3);
    let mut noise = || Vector3::from_fn(|_, _| (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>());
    let skeletons: Vec<Skeleton> = source_at(walks, 4.0, 60.0)
        .iter()
        .enumerate()
        .map(|(i, clean)| {
            let mut by = |limb| turn(noise() * 0.5_f64.to_radians(), 1.0) * limb;
            let noisy = |arm: Limbs| Limbs { upper: by(arm.upper), fore: by(arm.fore) };
            skeleton(i as u64 + 1, clean.received.0, &walks(i as f64 / 60.0).map(noisy))
        })
        .collect();
    let [fading, learnt] = both_deg(&skeletons, walks, &[0, 1]);
    assert!(learnt < fading, "learnt {learnt}, fading {fading} degrees");
}

/// Prediction for `person` as seen at `t_s`, for each arm.
fn expected(prediction: &Prediction, person: Person, t_s: f64, ahead_s: f64) -> [Limbs; 2] {
    let newest = person(t_s);
    let before = AGES_S.map(|age_s| person(t_s - age_s));
    [0, 1].map(|arm| {
        let first = |arms: [Limbs; 2]| [arms[arm], arms[1 - arm]];
        let history = History { newest: first(newest), before: before.map(first) };
        let turns = prediction.turns(&[history])[0].expect("numbers");
        let [upper, fore] = turns_at(&turns, ahead_s).map(|by| turn(by, 1.0));
        Limbs { upper: upper * newest[arm].upper, fore: fore * newest[arm].fore }
    })
}

#[test]
fn nodes_match_learnt_prediction_at_any_rate() {
    let prediction = prediction();
    // Error of the interpolation between frames, and of single precision.
    for (rate_hz, tolerance_rad) in [(60.0, 0.02), (240.0, 0.004)] {
        let skeletons = source_at(swings, 2.0, rate_hz);
        let mut looked = 0;
        for (now, target) in run(&learnt(), &skeletons, 1.9)[1500..].iter().step_by(7) {
            let newest_s = newest_s(&skeletons, *now);
            for i in target.trajectory_measured as usize..TRAJECTORY_NODES {
                let ahead_s = shown_s(*now, target, i) - newest_s;
                let want = expected(&prediction, swings, newest_s, ahead_s);
                for (limbs, want) in node(target, i).into_iter().zip(&want) {
                    let off = apart(&limbs.expect("both arms are meant"), want);
                    assert!(off < tolerance_rad, "{rate_hz} Hz, node {i}, {ahead_s} s ahead: {off} rad");
                    looked += 1;
                }
            }
        }
        assert!(looked > 5000, "{looked} nodes");
    }
}

/// Returns true if any node differs.
fn differ(a: &JointTarget, b: &JointTarget) -> bool {
    a.limb_trajectory != b.limb_trajectory
}

#[test]
fn arm_seen_for_less_than_200_ms_continues_by_fading_turn() {
    // Another writer after a second: the history starts again.
    let mut skeletons = source_at(swings, 2.0, 60.0);
    for (i, skeleton) in skeletons.iter_mut().enumerate().skip(60) {
        skeleton.header.incarnation = 2;
        skeleton.header.sequence = i as u64;
    }
    let (fading, learnt) = (run(&config(DELAY_MS), &skeletons, 1.9), run(&learnt(), &skeletons, 1.9));
    let mut other = [0, 0];
    for ((now, fading), (_, learnt)) in fading.iter().zip(&learnt) {
        let newest_s = newest_s(&skeletons, *now);
        let seen_s = if newest_s < 1.0 { newest_s } else { newest_s - 1.0 };
        if seen_s < 0.199 {
            assert!(!differ(fading, learnt), "{seen_s} s after the {newest_s} s");
        } else {
            other[usize::from(newest_s >= 1.0)] += usize::from(differ(fading, learnt));
        }
    }
    assert!(other.iter().all(|count| *count > 1000), "{other:?} targets differ");
}

/// Weights with which each output grows with the first component of the first turn, by `value`.
fn one_weight(value: f32) -> Prediction {
    let layer = |(i, width): (usize, &[usize; 2])| {
        let [inputs, outputs] = *width;
        let mut weight = vec![0.0; inputs * outputs];
        weight.iter_mut().step_by(inputs).for_each(|first| *first = if i == 0 { 1.0 } else { value });
        Dense { inputs, outputs, weight, bias: vec![0.0; outputs] }
    };
    Prediction::new(&PREDICTION_WIDTHS.array_windows().enumerate().map(layer).collect::<Vec<_>>())
}

#[test]
fn prediction_is_bounded_and_falls_back_on_infinite_sums() {
    let skeletons = source_at(swings, 1.0, 60.0);
    let fading = run(&config(DELAY_MS), &skeletons, 0.9);
    // Far more than any person turns: it is limited to 2 rad, as a fading turn at 20 rad/s.
    let wild = run(&config(DELAY_MS).with_prediction(Some(one_weight(1e6))), &skeletons, 0.9);
    let mut farthest = 0.0_f64;
    for (now, target) in &wild[600..] {
        let newest = swings(newest_s(&skeletons, *now));
        let last = node(target, TRAJECTORY_NODES - 1)[0].expect("it is meant");
        farthest = farthest.max(last.upper.angle_to(&newest[0].upper));
    }
    assert!(farthest > 1.8 && farthest <= 2.002, "{farthest} rad");
    // Infinite sums: as without a prediction.
    let none = run(&config(DELAY_MS).with_prediction(Some(one_weight(3e38))), &source_at(wide, 1.0, 60.0), 0.9);
    let plain = run(&config(DELAY_MS), &source_at(wide, 1.0, 60.0), 0.9);
    assert!(none.iter().zip(&plain).all(|(none, plain)| none.1.limb_trajectory == plain.1.limb_trajectory));
    assert!(wild.iter().zip(&fading).any(|(wild, fading)| differ(&wild.1, &fading.1)));
}

/// Turns about x so far in 17 ms that 3e38 times that exceeds single precision.
fn wide(t_s: f64) -> [Limbs; 2] {
    let limb = turn(Vector3::x(), 90.0 * t_s);
    [Limbs { upper: limb, fore: limb }; 2]
}

#[test]
fn flawed_prediction_files_are_refused_with_reason() {
    let [manifest, tensors] = prediction_files();
    let text = String::from_utf8(manifest).expect("text");
    let refused = |text: &str, tensors: &[u8]| match Prediction::read(text, tensors) {
        Ok(_) => String::from("accepted"),
        Err(error) => error.to_string(),
    };
    assert_eq!(refused(&text, &tensors), "accepted");
    for (from, to, message) in [
        ("format = 2", "format = 1", "format is 1, expected 2"),
        ("ages_s = [0.017", "ages_s = [0.018", "ages_s"),
        ("0.48]", "0.5]", "horizons_s"),
        (&format!("widths = [{PREDICTION_INPUTS}"), "widths = [3", "widths is [3"),
        ("seed", "sead", "sead"),
        ("sha256 = \"", "sha256 = \"0", "sha256"),
    ] {
        assert!(text.contains(from), "{from}");
        let found = refused(&text.replacen(from, to, 1), &tensors);
        assert!(found.contains(message), "{to}: {found}");
    }
    let mut bent = tensors.clone();
    *bent.last_mut().expect("bytes") ^= 1;
    assert!(refused(&text, &bent).contains("sha256"));
    // The hash is right, but the contents are wrong.
    let sealed = |tensors: &[u8]| {
        let hash = text.find("sha256 = \"").expect("there") + "sha256 = \"".len();
        let text = format!("{}{}{}", &text[..hash], retarget::sha256_hex(tensors), &text[hash + 64..]);
        refused(&text, tensors)
    };
    assert_eq!(sealed(&tensors), "accepted");
    let mut infinite = tensors.clone();
    let end = infinite.len();
    infinite[end - 2..].copy_from_slice(&[0, 0x7c]);
    assert!(sealed(&infinite).contains("inf"), "{}", sealed(&infinite));
    assert!(sealed(&tensors[..end - 4]).contains("tensors"), "{}", sealed(&tensors[..end - 4]));
    assert!(sealed(&u64::MAX.to_le_bytes()).contains("header"));
    assert!(HORIZONS_S.is_sorted() && AGES_S.is_sorted());
}
