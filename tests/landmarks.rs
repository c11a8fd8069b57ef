//! The real landmarker, on the rendered videos of `tools/camera/clips`.

use crate::browser::Browser;
use crate::viewer::Viewer;
use base64::Engine;
use harness::Rig;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Images that the browser examines. Most of the person's arm moves in two seconds.
const IMAGES: usize = 60;

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

/// The packages of npm and PyPI in a folder of their own, and the landmarker that is made of them.
struct Packages {
    _folder: tempfile::TempDir,
    modules: PathBuf,
    python: PathBuf,
    model: String,
}

impl Packages {
    /// Installs them. None without the network.
    fn install() -> Option<Self> {
        let folder = tempfile::tempdir().expect("a folder");
        let (camera, root) = (folder.path().join("camera"), harness::repository());
        std::fs::create_dir(&camera).expect("a folder");
        for name in ["package.json", "package-lock.json"] {
            std::fs::copy(root.join("tools/camera").join(name), camera.join(name)).expect(name);
        }
        let venv = folder.path().join("venv");
        let (mut npm, mut python, mut packages) =
            (Command::new("npm"), Command::new("python3"), Command::new(venv.join("bin/pip")));
        npm.args(["ci", "--prefix"]).arg(&camera);
        python.args(["-m", "venv"]).arg(&venv);
        packages.args(["install", "--quiet", "-r"]).arg(root.join("tools/camera/render/requirements.txt"));
        if [npm, python, packages].iter_mut().any(|install| run(install).is_none()) {
            return None;
        }
        let modules = camera.join("node_modules");
        let mut make = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        let made = run(make.args(["landmarker", "full", "--modules"]).arg(&modules)).expect("no network is needed");
        let (python, model) = (venv.join("bin/python"), made.trim().to_owned());
        Some(Self { _folder: folder, modules, python, model })
    }

    /// Runs a command of `tools/camera/render`.
    fn render<const N: usize>(&self, arguments: [&Path; N]) -> String {
        let mut command = Command::new(&self.python);
        command.arg(harness::repository().join("tools/camera/render")).args(arguments);
        run(&mut command).expect("no network is needed")
    }
}

/// Returns the landmarks that the page's worker finds in images, as `render check --found` reads them, m.
fn found_by_page(browser: &mut Browser, images: &Path) -> Value {
    // The page's own worker and address of the user's files.
    browser.evaluate_async(include_str!("landmarks.js"));
    let look = |n: usize| {
        let bytes = std::fs::read(images.join(format!("{n:03}.png"))).expect("an image");
        let picture = base64::engine::general_purpose::STANDARD.encode(bytes);
        browser.evaluate_async(&format!("return landmarks('{picture}', {n} * 1000 / 30);"))
    };
    json!((0..IMAGES).map(look).collect::<Vec<_>>())
}

/// The networks come from npm and MediaPipe from PyPI. The landmarks that `eval --video` and the book use are theirs, and the
/// page finds the same.
#[test]
#[ignore = "installs 300 MB from npm and PyPI: cargo test --release --test system landmarks -- --ignored"]
fn landmarks_of_rendered_videos_are_those_stored() {
    let Some(packages) = Packages::install() else { return };
    let clips = harness::repository().join("tools/camera/clips");
    let printed = packages.render(["check".as_ref(), &clips, "--model".as_ref(), packages.model.as_ref()]);
    assert_eq!(printed.matches("degrees on average").count(), 3, "{printed}");

    let (rig, folder) = (Rig::idle(""), tempfile::tempdir().expect("a folder"));
    let vision = packages.modules.join("@mediapipe/tasks-vision");
    let [model, vision] = [packages.model.as_str(), vision.to_str().expect("UTF-8")];
    let viewer = Viewer::with(&rig, &["--camera", model, "--vision", vision]);
    let Some(mut browser) = Browser::open(&viewer.address) else { return };
    browser.wait_text("cam-state", "off");
    for clip in ["point_and_clap.mp4", "up_and_stretch.mp4"] {
        let (video, images, found) = (clips.join(clip), folder.path().join(clip), folder.path().join("found.json"));
        packages.render(["images".as_ref(), &video, &images]);
        let count = std::fs::read_dir(&images).expect("the images").count();
        assert_eq!(count, IMAGES, "of {clip}");
        std::fs::write(&found, found_by_page(&mut browser, &images).to_string()).expect("a file");
        let printed = packages.render(["check".as_ref(), &video, "--found".as_ref(), &found]);
        println!("in the page: {printed}");
        assert!(printed.contains("degrees on average"), "{printed}");
    }
}
