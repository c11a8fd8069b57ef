//! Packets of VMC as OSC libraries write them.

use bridge::{Protocol, Taken, Vmc};
use messages::RawSkeleton;
use std::io::Write;
use std::process::{Command, Stdio};

/// Messages as JSON: whole numbers, fractions, a truth value, and a hand that is not seen.
const MESSAGES: &str = include_str!("libraries/messages.json");

const PYTHON_OSC: &str = include_str!("libraries/python_osc.py");
const OSC_JS: &str = include_str!("libraries/osc_js.js");
const OSC: &str = include_str!("libraries/osc.js");

/// Checks the one person of these packets.
fn check(packets: &[Vec<u8>], library: &str) {
    let (mut vmc, mut frames) = (Vmc::default(), Vec::<RawSkeleton>::new());
    for packet in packets {
        assert_eq!(vmc.decode(packet, &mut |frame| frames.push(*frame)), Ok(Taken::Person), "{library}");
    }
    let [frame] = frames[..] else { panic!("{library}: {} frames", frames.len()) };
    assert_eq!(frame.positions[0], [0.0, 1.0, 0.5], "{library}");
    assert_eq!(frame.rotations[13..=14], [[0.6, 0.0, 0.0, 0.8], [0.0, 1.0, 0.0, 0.0]], "{library}");
    assert_eq!(
        frame.confidence[13..=18],
        [1.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        "{library}: lower arms and hands are not sent"
    );
}

/// Runs a script that reads the messages and prints a packet in hexadecimal digits.
fn packet(program: &mut Command) -> Vec<u8> {
    let mut child = program.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
    child.stdin.take().expect("its input").write_all(MESSAGES.as_bytes()).expect("it reads");
    let done = child.wait_with_output().expect("it ends");
    assert!(done.status.success(), "{program:?}");
    let digits = String::from_utf8(done.stdout).expect("digits");
    let byte = |at| u8::from_str_radix(&digits[at..at + 2], 16).expect("digits");
    (0..digits.trim().len()).step_by(2).map(byte).collect()
}

#[test]
#[ignore = "installs packages of PyPI and npm; .ci/long runs it"]
fn python_osc_osc_js_and_osc_of_npm_are_read() {
    let folder = tempfile::tempdir().expect("a folder");
    match harness::python(&folder.path().join("venv"), &["python-osc==1.10.2"]) {
        Ok(python) => check(&[packet(Command::new(python).args(["-c", PYTHON_OSC]))], "python-osc"),
        Err(why) => println!("skipped: no python-osc 1.10.2: {why}"),
    }
    let install = ["install", "--no-audit", "--no-fund", "--ignore-scripts", "osc-js@2.4.1", "osc@2.4.5"];
    let installed = Command::new("npm").args(install).current_dir(&folder).output();
    if !installed.is_ok_and(|done| done.status.success()) {
        return println!("skipped: npm installs no osc-js 2.4.1 and osc 2.4.5");
    }
    for (library, script) in [("osc-js", OSC_JS), ("osc", OSC)] {
        check(&[packet(Command::new("node").args(["-e", script]).current_dir(&folder))], library);
    }
}

/// A text or a list of tags in OSC: with a zero at its end, filled up to a multiple of four bytes.
fn padded(text: &str) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(text.len() / 4 * 4 + 4, 0);
    bytes
}

/// C and C# libraries write the types that they get: floats or doubles, and a packet for each message.
#[test]
fn floats_and_doubles_in_packets_of_their_own_are_read() {
    let write = |is_double: bool| {
        let message = |address: &str, name: Option<&str>, numbers: &[f32]| {
            let tag = if is_double { "d" } else { "f" };
            let tags = format!(",{}{}", name.map_or("", |_| "s"), tag.repeat(numbers.len()));
            let mut bytes = [padded(address), padded(&tags), name.map(padded).unwrap_or_default()].concat();
            for number in numbers {
                let double = f64::from(*number).to_be_bytes().to_vec();
                bytes.extend(if is_double { double } else { number.to_be_bytes().to_vec() });
            }
            bytes
        };
        let bone = |name: &str, numbers: [f32; 7]| message("/VMC/Ext/Bone/Pos", Some(name), &numbers);
        vec![
            message("/VMC/Ext/OK", None, &[1.0]),
            bone("Hips", [0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0]),
            bone("LeftUpperArm", [0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.8]),
            bone("RightUpperArm", [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]),
            bone("LeftHand", [f32::NAN; 7]),
            message("/VMC/Ext/T", None, &[1.5]),
        ]
    };
    check(&write(false), "floats");
    check(&write(true), "doubles");
    let mut bundle = [b"#bundle\0".to_vec(), 1_u64.to_be_bytes().to_vec()].concat();
    for message in write(false) {
        bundle.extend((message.len() as u32).to_be_bytes());
        bundle.extend(message);
    }
    check(&[bundle], "a bundle");
}
