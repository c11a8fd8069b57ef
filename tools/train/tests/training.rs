//! Short runs on procedural poses: they learn, repeat bit for bit, and write a file that retargeting reads.

use nalgebra::Vector3;
use rand_pcg::Pcg64;
use retarget::{ArmIdentity, ArmModel, Manifest, Weights, features};
use train::evaluation::limbs;
use train::files::write_both;
use train::kinematics::{Arm, Limbs};
use train::networks::Size;
use train::objective::{Terms, Weighting};
use train::optimiser::Schedule;
use train::sampling::{Mixture, Recorded, procedural};
use train::session::{Options, Session, retarget};

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
        weighting: Weighting::OURS,
        mixture: Mixture { procedural: 1.0, ..Mixture::default() },
    };
    Session::new(options, Arm::from(&identity().arm))
}

fn advance(session: &mut Session, steps: u64) -> Vec<Terms> {
    let recorded = Recorded::default();
    (0..steps).map(|_| session.advance(&recorded)).collect()
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
    for _ in 0..30 {
        Session::advance_together(&mut together, &Recorded::default());
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
    let average: Vec<f32> = run.adam.average.iter().copied().map(perceptron::rounded).collect();
    let networks = run.networks.layers(&average);
    let written = retarget::write_weights(&networks, &Manifest::new(&identity(), &networks));
    let (tensors, manifest) = written.expect("weights can be composed");
    write_both(&base, &tensors, &manifest).expect("weights can be written");
    let text = std::fs::read_to_string(folder.path().join("example.v1.toml")).expect("the manifest is there");
    let bytes = std::fs::read(folder.path().join("example.v1.safetensors")).expect("the tensors are there");
    let weights = Weights::read(&text, &bytes, &identity()).expect("the retargeting takes them");
    let poses = unseen_poses();
    let postures = retarget(&run.networks, &average, &Arm::from(&identity().arm), &poses);
    for (pose, ours) in poses.as_flattened().iter().zip(postures.as_flattened()) {
        let [theirs] = weights.network.decode(&weights.network.encode_human(&[features(&limbs(pose))]));
        for (a, b) in ours.iter().zip(theirs) {
            assert!((f64::from(*a) - b).abs() < 1e-5, "{ours:?} against {theirs:?}");
        }
    }
    let parts: Vec<_> = std::fs::read_dir(folder.path()).expect("the folder can be listed").flatten().collect();
    assert_eq!(parts.len(), 2, "no partial file is left behind");
}
