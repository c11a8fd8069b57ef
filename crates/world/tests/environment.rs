//! A robot at a table. Whole-body control and the gate run together with targets that lead into the table. The
//! simulated robot's checker judges. Further tests check the settings that describe the obstacles.

use crate::support::{loaded, shipped, write_settings};
use config::Overrides;
use driver::PlanPlayback;
use messages::{ALL_JOINTS, Header, JOINTS_MAX, JointCommand, Layout, Mode, deadline};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use robot::{BoxEntry, Environment, Model, PlaneEntry};
use safety::{engage, gate};
use world::simulated;

/// `torture` attacks at a shelf for longer.
const TICKS: u64 = 25_000;

/// A table with its top at 0.75 m and its edge 0.7 m ahead.
fn at_a_table() -> Model {
    let floor = PlaneEntry { name: "floor".into(), normal: [0.0, 0.0, 1.0], offset_m: 0.0 };
    let (center_m, size_m) = ([1.1, 0.0, 0.73], [0.8, 1.6, 0.04]);
    let table = BoxEntry { name: "table".into(), center_m, size_m, rpy_deg: [0.0; 3] };
    let (model, _) = config::load_model(&shipped("robots/tiago_dual.toml")).expect("the shipped robot");
    let environment = Environment { planes: vec![floor], boxes: vec![table] };
    model.with_environment("test", &environment).expect("home is clear of the table")
}

/// Targets for the arms before the robot, at the height of the table or below it, with a lift that goes up and down.
fn goal(model: &Model, rng: &mut Pcg64Mcg) -> [f64; JOINTS_MAX] {
    std::array::from_fn(|j| {
        let limits = &model.limits[j];
        let share = match rng.random_range(0..4) {
            0 => f64::from(u8::from(rng.random_bool(0.5))),
            _ => rng.random_range(0.0..1.0),
        };
        limits.q_min + share * (limits.q_max - limits.q_min)
    })
}

struct Outcome {
    violations: u64,
    clearance_violations: u64,
    denials: u64,
    /// Ticks whose nearest pair was an arm and the table, within 1 mm of the bound.
    at_the_table: u64,
}

fn attack(model: &Model, ticks: u64, seed: u64, certified: bool) -> Outcome {
    let options = if certified { wbc::Options::default() } else { wbc::Options::without_certificate_for_tests() };
    let options = options.hand_speed_m_per_s(checker::Options::default().hand_speed_max_m_per_s);
    let wbc_config = wbc::Config::new(model, options).expect("whole-body control");
    let gate_config = gate::Config::new(model).expect("the gate");
    let exact = plant::Options { encoder_noise_rad: 0.0, encoder_step_rad: 0.0, ..plant::Options::default() };
    let options = simulated::Options { robot: exact, ..simulated::Options::default() };
    let robot_config = simulated::Config::new(model, &options).expect("the simulated robot");
    let first_k = 1500;
    let mut robot = simulated::State::new(&robot_config, first_k, seed);
    let start = robot.follower().motion;
    let mut wbc_state = wbc::State::at_rest(&wbc_config, start.q);
    let mut gate_state = gate::State::at_rest(start.q);
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let (mut q, mut at_the_table) = (model.home, 0);
    for k in first_k + 1..=first_k + ticks {
        if rng.random_range(0..600) == 0 {
            q = goal(model, &mut rng);
        }
        let now = deadline(k);
        let target = wbc::Target { q: &q, dq: &[0.0; JOINTS_MAX], ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
        let permit = wbc::Permit::Follow { speed_scale: 1.0 };
        let proposed = wbc::tick(&wbc_config, &mut wbc_state, now, wbc::Input { k, target: Some(target), permit });
        let named = model.shape_name(proposed.nearest_pair[1]);
        at_the_table += u64::from(named == "table" && proposed.clearance_m < model.d_min_m + 1e-3);
        let mut command = JointCommand {
            header: Header { sequence: k, stamp: now, incarnation: 1, ..Header::ZERO },
            robot: model.id(),
            k,
            seed_k: first_k,
            mode: Mode::Engaged as u32,
            ..JointCommand::ZERO
        }
        .with_motion(&proposed.motion);
        if certified {
            let permit = engage::Permit::Follow { speed_scale: 1.0 };
            let offer = gate::Proposed { k, permit, motion: proposed.motion };
            let decision = gate::tick(&gate_config, &mut gate_state, now, offer);
            command = command.with_motion(&decision.motion);
            if !decision.accepted() {
                wbc_state.reseed(&decision.motion);
            }
        }
        let out =
            simulated::tick(&robot_config, &mut robot, now, driver::DriveInput { due_k: k, command: Some(&command) });
        assert!(out.accepted.is_some(), "tick {k}: the driver refused: {:?}", out.refused);
    }
    Outcome {
        violations: robot.report().violations_total(),
        clearance_violations: robot.report().violations_of(checker::ViolationKind::Clearance),
        denials: gate_state.denials(),
        at_the_table,
    }
}

#[test]
fn f045_f049_arms_keep_clear_of_table_while_torso_moves() {
    let outcome = attack(&at_a_table(), TICKS, 11, true);
    println!("{} denials, {} ticks within a millimetre of the bound", outcome.denials, outcome.at_the_table);
    assert_eq!((outcome.violations, outcome.denials), (0, 0));
    assert!(outcome.at_the_table > 100, "never came close: {} ticks", outcome.at_the_table);
}

#[test]
fn arms_without_certificate_hit_table() {
    let mut model = at_a_table();
    // Then only the table can be hit.
    model.pairs.clear();
    assert!(attack(&model, TICKS, 11, false).clearance_violations > 0);
}

#[test]
fn gate_denies_command_that_leads_into_table() {
    let mut model = at_a_table();
    model.pairs.clear();
    let mut blind = model.clone();
    blind.obstacles.clear();
    let options = wbc::Options::default();
    let wbc_config = wbc::Config::new(&blind, options).expect("whole-body control that knows of no table");
    let gate_config = gate::Config::new(&model).expect("the gate");
    let mut wbc_state = wbc::State::at_rest(&wbc_config, model.home);
    let mut gate_state = gate::State::at_rest(model.home);
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    let mut q = model.home;
    let (mut frames, mut least_m) = (robot::Frames::default(), f64::INFINITY);
    for k in 1501..TICKS {
        if gate_state.denials() > 0 {
            break;
        }
        if rng.random_range(0..600) == 0 {
            q = goal(&model, &mut rng);
        }
        let (now, permit) = (deadline(k), wbc::Permit::Follow { speed_scale: 1.0 });
        let target = wbc::Target { q: &q, dq: &[0.0; JOINTS_MAX], ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
        let proposed = wbc::tick(&wbc_config, &mut wbc_state, now, wbc::Input { k, target: Some(target), permit });
        let permit = engage::Permit::Follow { speed_scale: 1.0 };
        let offer = gate::Proposed { k, permit, motion: proposed.motion };
        let decision = gate::tick(&gate_config, &mut gate_state, now, offer);
        wbc_state.reseed(&decision.motion);
        // The gate judges every command, and the posture in which its plan ends.
        let mut motion = decision.motion;
        if !decision.accepted() {
            motion.play(2 * TICKS);
            assert!(motion.is_at_rest());
        }
        model.forward(&motion.q, &mut frames);
        least_m = least_m.min(model.obstacle_clearance(&frames).0);
    }
    assert!(gate_state.denials() > 0, "never denied anything, {least_m} m");
    assert!(least_m >= model.d_min_m - checker::TOLERANCE_CLEARANCE_M, "{least_m} m");
}

#[test]
fn obstacles_of_shipped_settings_change_hash() {
    assert_eq!(loaded().model.obstacles.iter().map(|o| &*o.name).collect::<Vec<_>>(), ["floor"]);
    let folder = tempfile::tempdir().expect("a folder");
    let with = |line: &str| {
        let path = write_settings(folder.path(), |text| text.replace("offset_m = 0.0", line));
        config::load(&path, Overrides::default())
    };
    let (same, lower) = (with("offset_m = 0.0").expect("loads"), with("offset_m = -0.01").expect("a lower floor"));
    assert_ne!(lower.hash, same.hash, "processes with different floors cannot engage");
    let higher = with("offset_m = 0.9").expect_err("a floor in the robot");
    assert!(higher.to_string().contains("environment `floor`"), "{higher}");
    let typo = with("offset_mm = 0.0").expect_err("an unknown key");
    assert!(typo.to_string().contains("offset_mm"), "{typo}");
}
