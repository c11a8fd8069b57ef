//! Short runs on procedural poses: they learn, repeat bit for bit, resume bit for bit, and write what the retargeting
//! reads.

use nalgebra::Vector3;
use rand_pcg::Pcg64;
use retarget::{ArmIdentity, ArmModel, Manifest, Weights, features};
use std::path::PathBuf;
use train::checkpoint::{Origin, resume, save};
use train::evaluation::limbs;
use train::kinematics::{Arm, Limbs};
use train::networks::Size;
use train::objective::{Terms, Weighting};
use train::optimiser::Schedule;
use train::sampling::{Mixture, Recorded, procedural};
use train::session::{Options, Session};
use train::weights_file::{layers, write};

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
        batch: 64,
        schedule: Schedule { peak: 3e-3, warm_up: 20, second_decay: 0.999, steps },
        seed,
        weighting: Weighting::default(),
        mixture: Mixture { procedural: 1.0, ..Mixture::default() },
    };
    Session::new(options, Arm::from(&identity().arm))
}

fn origin() -> Origin {
    Origin { robot_hash: "7".into(), poses: Recorded::default().digest() }
}

fn advance(session: &mut Session, steps: u64) -> Vec<Terms> {
    let recorded = Recorded::default();
    (0..steps).map(|_| session.advance(&recorded)).collect()
}

fn unseen_poses() -> Vec<Limbs> {
    let mut rng = Pcg64::new(99, 99);
    (0..500).map(|_| procedural(&mut rng)).collect()
}

fn scratch() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("run.checkpoint");
    (folder, path)
}

#[test]
fn three_hundred_steps_cut_the_loss_to_a_third_and_the_error_to_half() {
    let mut run = session(300, 1);
    let poses = unseen_poses();
    let before = run.mean_limb_degrees(&poses);
    let terms = advance(&mut run, 300);
    let mean = |part: &[Terms]| part.iter().map(|t| t.total(&Weighting::default())).sum::<f64>() / part.len() as f64;
    let (first, last) = (mean(&terms[..10]), mean(&terms[290..]));
    assert!(last < first / 3.0, "{first} to {last}");
    let after = run.mean_limb_degrees(&poses);
    assert!(after < before / 2.0, "{before} to {after} degrees");
}

#[test]
fn a_seed_gives_the_same_bits_and_another_seed_others() {
    let run = |seed| {
        let mut run = session(40, seed);
        advance(&mut run, 40);
        run.adam
    };
    assert_eq!(run(3), run(3));
    assert_ne!(run(3).parameters, run(4).parameters);
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one_bit_for_bit() {
    let (_folder, path) = scratch();
    let mut whole = session(60, 5);
    advance(&mut whole, 60);
    let mut part = session(60, 5);
    advance(&mut part, 25);
    save(&path, &part, &origin()).expect("a checkpoint can be written");
    drop(part);
    let mut rest = resume(&path, Arm::from(&identity().arm), &origin()).expect("and read");
    assert_eq!((rest.step, rest.options), (25, whole.options));
    advance(&mut rest, 35);
    assert_eq!(rest.adam, whole.adam);
}

#[test]
fn a_checkpoint_of_another_robot_other_poses_or_half_a_file_is_refused() {
    let (_folder, path) = scratch();
    let arm = Arm::from(&identity().arm);
    save(&path, &session(10, 5), &origin()).expect("a checkpoint can be written");
    let message = |origin: &Origin| resume(&path, arm, origin).expect_err("is refused").to_string();
    assert!(message(&Origin { robot_hash: "8".into(), ..origin() }).contains("hash 7"));
    assert!(message(&Origin { poses: "other".into(), ..origin() }).contains("other recorded poses"));
    let bytes = std::fs::read(&path).expect("the checkpoint is there");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("it can be cut");
    assert!(message(&origin()).contains("run.checkpoint"));
    std::fs::write(&path, b"not a checkpoint at all").expect("it can be overwritten");
    assert!(message(&origin()).contains("run.checkpoint"));
}

#[test]
fn written_weights_give_the_retargeting_the_outputs_of_the_trainer() {
    let (folder, _) = scratch();
    let base = folder.path().join("example.v1");
    let mut run = session(50, 2);
    advance(&mut run, 50);
    let networks = layers(&run.networks, &run.adam.average);
    write(&base, &networks, &Manifest::new(&identity(), &networks)).expect("weights can be written");
    let text = std::fs::read_to_string(folder.path().join("example.v1.toml")).expect("the manifest is there");
    let bytes = std::fs::read(folder.path().join("example.v1.safetensors")).expect("the tensors are there");
    let weights = Weights::read(&text, &bytes, &identity()).expect("the retargeting takes them");
    let poses = unseen_poses();
    for (pose, ours) in poses.iter().zip(run.retarget(&poses)) {
        let [theirs] = weights.network.decode(&weights.network.encode_human(&[features(&limbs(pose))]));
        for (a, b) in ours.iter().zip(theirs) {
            assert!((f64::from(*a) - b).abs() < 1e-5, "{ours:?} against {theirs:?}");
        }
    }
    let parts: Vec<_> = std::fs::read_dir(folder.path()).expect("the folder can be listed").flatten().collect();
    assert_eq!(parts.len(), 2, "no partial file is left behind");
}
