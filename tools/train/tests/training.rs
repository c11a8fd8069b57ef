//! Short runs on procedural poses: they learn, repeat bit for bit, and write a file that retargeting reads.

use nalgebra::Vector3;
use rand_pcg::Pcg64;
use retarget::{ArmIdentity, ArmModel, Manifest, Weights, features};
use std::path::Path;
use train::baseline::{Baseline, S3LE_POSTURES, S3LE_SEED};
use train::evaluation::limbs;
use train::files::write_both;
use train::kinematics::{Arm, Limbs};
use train::networks::{Pose, Size};
use train::objective::{Terms, Weighting};
use train::optimiser::Schedule;
use train::pairs::{matched, random_postures};
use train::preset::Preset;
use train::sampling::{Mixture, Recorded, procedural};
use train::session::{Data, Options, Session, retarget};

fn identity() -> ArmIdentity {
    let reference = [0.0, 0.0, std::f64::consts::FRAC_PI_2, 0.0, 0.0];
    let axes = [-Vector3::z(), -Vector3::x(), Vector3::y(), -Vector3::z(), -Vector3::y()];
    ArmIdentity {
        robot: "example".into(),
        robot_hash: 7,
        joints: ["a", "b", "c", "d", "e"].map(String::from),
        arm: ArmModel::new(axes, reference, [-1.1, -1.1, -0.7, -0.3, -2.0], [1.5, 1.1, 3.8, 2.2, 2.0]),
    }
}

fn session(steps: u64, seed: u64) -> Session {
    let options = Options {
        size: Size { hidden_layers: 2, hidden_width: 32 },
        pose: Pose::default(),
        batch: 64,
        schedule: Schedule { peak: 3e-3, warm_up: 20, second_decay: 0.999, steps },
        seed,
        weighting: Weighting::OURS,
        mixture: Mixture { procedural: 1.0, ..Mixture::default() },
    };
    Session::new(options, Arm::from(&identity().arm))
}

fn advance(session: &mut Session, steps: u64) -> Vec<Terms> {
    let recorded = Recorded::default();
    (0..steps).map(|_| session.advance(Data::Unpaired(&recorded))).collect()
}

fn unseen_poses() -> Vec<[Limbs; 2]> {
    let mut rng = Pcg64::new(99, 99);
    (0..250).map(|_| [procedural(&mut rng), procedural(&mut rng)]).collect()
}

#[test]
fn training_of_300_steps_cuts_loss_to_third_and_error_to_half() {
    let mut run = session(300, 1);
    let poses = unseen_poses();
    let before = run.mean_limb_degrees(&poses);
    let terms = advance(&mut run, 300);
    let mean = |part: &[Terms]| part.iter().map(|t| t.total(&Weighting::OURS)).sum::<f64>() / part.len() as f64;
    let (first, last) = (mean(&terms[..10]), mean(&terms[290..]));
    assert!(last < first / 3.0, "{first} to {last}");
    let after = run.mean_limb_degrees(&poses);
    assert!(after < before / 2.0, "{before} to {after} degrees");
}

#[test]
fn training_is_bit_identical_per_seed_and_differs_by_seed() {
    let run = |seed| {
        let mut run = session(40, seed);
        advance(&mut run, 40);
        run.adam
    };
    assert_eq!(run(3), run(3));
    assert_ne!(run(3).parameters, run(4).parameters);
}

#[test]
fn robots_trained_together_share_the_human_encoder_alone() {
    let mut other = Arm::from(&identity().arm);
    other.axes[0] = [0.0, 0.0, 1.0];
    let first = session(30, 3);
    let mut together = [first.clone(), Session::new(first.options, other)];
    let recorded = Recorded::default();
    for _ in 0..30 {
        Session::advance_together(&mut together, &[Data::Unpaired(&recorded); 2]);
    }
    let mut alone = first;
    advance(&mut alone, 30);
    let human = 0..alone.networks.human.end();
    let [one, two] = together.each_ref().map(|run| &run.adam.parameters);
    assert_eq!(one[human.clone()], two[human.clone()]);
    assert_ne!(one[human.end..], two[human.end..]);
    assert_ne!(one[human.clone()], alone.adam.parameters[human], "the other robot has its share");
}

#[test]
fn written_weights_give_retargeting_the_outputs_of_training() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let base = folder.path().join("example.v1");
    let mut run = session(50, 2);
    advance(&mut run, 50);
    let networks = run.networks.layers(&run.adam.average);
    let written = retarget::write_weights(&networks, &Manifest::new(&identity(), &networks));
    let (tensors, manifest) = written.expect("weights can be composed");
    write_both(&base, &tensors, &manifest).expect("weights can be written");
    let text = std::fs::read_to_string(folder.path().join("example.v1.toml")).expect("the manifest is there");
    let bytes = std::fs::read(folder.path().join("example.v1.safetensors")).expect("the tensors are there");
    let weights = Weights::read(&text, &bytes, &identity()).expect("the retargeting takes them");
    let poses = unseen_poses();
    let postures = retarget(&run.networks, &run.adam.average, &Arm::from(&identity().arm), &poses);
    for (pose, ours) in poses.as_flattened().iter().zip(postures.as_flattened()) {
        let [theirs] = weights.network.decode(&weights.network.encode_human(&[features(&limbs(pose))]));
        for (a, b) in ours.iter().zip(theirs) {
            assert!((f64::from(*a) - b).abs() < 1e-5, "{ours:?} against {theirs:?}");
        }
    }
    let parts: Vec<_> = std::fs::read_dir(folder.path()).expect("the folder can be listed").flatten().collect();
    assert_eq!(parts.len(), 2, "no partial file is left behind");
}

/// Creates a short run of a preset's networks and losses at a small size.
fn baseline(preset: Preset, steps: u64) -> Session {
    let recipe = preset.recipe();
    let options = Options { pose: recipe.pose, weighting: recipe.weighting, ..session(steps, 1).options };
    Session::new(options, Arm::from(&identity().arm))
}

fn write(base: &Path, name: &str, run: &Session) {
    Baseline::write(base, name.into(), run, &identity(), "nothing".into()).expect("a baseline can be written");
}

fn both_arms(frames: &[[Limbs; 2]]) -> Vec<[retarget::Limbs; 2]> {
    frames.iter().map(|arms| arms.each_ref().map(limbs)).collect()
}

#[test]
fn written_baseline_matches_its_run_and_damage_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let base = folder.path().join("example");
    for preset in [Preset::Paper, Preset::OursPose, Preset::OursNoLtc] {
        gives_what_its_run_gives(&base, preset);
    }
    let other = ArmIdentity { robot_hash: 8, ..identity() };
    assert!(Baseline::read(&base, &other).expect("it can be read").is_none(), "another arm");
    let tensors = folder.path().join("example.safetensors");
    let mut bytes = std::fs::read(&tensors).expect("the tensors are there");
    *bytes.last_mut().expect("there are bytes") ^= 1;
    std::fs::write(&tensors, bytes).expect("they can be damaged");
    assert!(Baseline::read(&base, &identity()).expect_err("damaged").to_string().contains("sha256"));
}

fn gives_what_its_run_gives(base: &Path, preset: Preset) {
    let mut run = baseline(preset, 30);
    advance(&mut run, 30);
    write(base, "example", &run);
    let read = Baseline::read(base, &identity()).expect("and read").expect("for this arm");
    let frames = unseen_poses();
    let want = retarget(&run.networks, &run.adam.average, &Arm::from(&identity().arm), &frames);
    for (ours, want) in both_arms(&frames).iter().map(|frame| read.retarget(frame)).zip(&want) {
        for (a, b) in ours.as_flattened().iter().zip(want.as_flattened()) {
            // The file holds 11 bits of every weight.
            assert!((a - f64::from(*b)).abs() < 2e-2, "{ours:?} against {want:?}");
        }
    }
}

#[test]
fn s3le_answers_only_known_postures_and_pairing_loss_falls() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let base = folder.path().join("s3le");
    let arm = Arm::from(&identity().arm);
    let postures = random_postures(3_000, S3LE_SEED);
    let pairs = matched(&arm, &postures, &Recorded::default(), &Mixture::default(), 500, 1);
    let mut run = baseline(Preset::S3le, 200);
    let terms: Vec<Terms> = (0..200).map(|_| run.advance(Data::Pairs(&pairs))).collect();
    assert!(terms[199].pairing < 0.5 * terms[0].pairing, "{:?} to {:?}", terms[0], terms[199]);
    write(&base, "s3le", &run);
    let read = Baseline::read(&base, &identity()).expect("and read").expect("for this arm");
    let all = random_postures(S3LE_POSTURES, S3LE_SEED);
    for q in both_arms(&unseen_poses()[..3]).iter().map(|frame| read.retarget(frame)) {
        let is_known = |n: &[[f32; 5]; 2]| n.map(|n| arm.denormalised(&n).map(f64::from)) == q;
        assert!(all.iter().any(is_known), "{q:?}");
    }
}
