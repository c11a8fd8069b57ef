//! The shipped robot in the form that retargeting uses.

use crate::support;

use retarget::{ArmIdentity, ArmModel, Config, Manifest, Method, Settings, Weights, write_weights};

#[test]
fn shipped_robot_arm_matches_hand_computed_model() {
    let (arm, design) = (ArmModel::from_model(&support::shipped("tiago_dual"), 0), support::arm());
    for (axis, want) in arm.axes.iter().zip(&design.axes) {
        assert!((axis - want).norm() < 1e-6, "{axis} instead of {want}");
    }
    assert!(arm.reference.iter().zip(&design.reference).all(|(a, b)| (a - b).abs() < 1e-9));
    assert!((0..5).all(|j| arm.q_min[j] < arm.reference[j] && arm.reference[j] < arm.q_max[j]));
}

#[test]
fn f094_f101_weights_fit_only_their_arm_regardless_of_comments() {
    let model = support::shipped("tiago_dual");
    let layers = support::layers(1, 2, 16);
    let (bytes, text) = write_weights(&layers, &Manifest::new(&ArmIdentity::from_model(&model, 0), &layers)).unwrap();
    let commented = support::edited("tiago_dual", |text| text + "\n# A comment.\n");
    assert_ne!(commented.hash, model.hash);
    let weights = Weights::from_bytes(&text, &bytes, &commented, 0).expect("a comment changes nothing");
    assert!(Config::new(&model, Some(weights), &Settings::default()).is_ok());

    let mut longer = model.clone();
    longer.limits[5].q_max -= 0.01;
    let error = Weights::from_bytes(&text, &bytes, &longer, 0).unwrap_err().to_string();
    assert!(error.contains("robot_hash"), "{error}");
}

#[test]
fn f094_shipped_weights_are_accepted_on_this_machine() {
    for name in support::ROBOTS {
        support::shipped_weights(&support::shipped(name));
    }
}

#[test]
fn missing_weights_or_options_out_of_range_are_refused() {
    let model = support::shipped("tiago_dual");
    let refuse = |settings: Settings| Config::new(&model, None, &settings).map(|_| ()).unwrap_err().to_string();
    let closed_form = Settings { method: Method::ClosedForm, ..Settings::default() };
    assert!(refuse(Settings::default()).contains("no weights"));
    let refused = refuse(Settings { following_delay_ms: 250.1, ..closed_form.clone() });
    assert_eq!(refused, "following_delay_ms = 250.1 is outside [0, 250]");
    for delay_ms in [f64::NAN, -1.0] {
        let refused = refuse(Settings { following_delay_ms: delay_ms, ..closed_form.clone() });
        assert!(refused.contains("following_delay_ms"), "{refused}");
    }
    for delay_ms in [0.0, 250.0] {
        let settings = Settings { following_delay_ms: delay_ms, ..closed_form.clone() };
        assert!(Config::new(&model, None, &settings).is_ok(), "{delay_ms} ms");
    }
    assert!(refuse(Settings { refinement_steps: 11, ..closed_form }).contains("refinement_steps = 11"));
}
