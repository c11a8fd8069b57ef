//! Shows a running instance in a browser.

use crate::children::instance_in;
use crate::cli;
use crate::process::realtime::keep_off;
use crate::programs::RECORD;
use config::Loaded;
use instance::Instance;
use poses::error::PosesError;
use poses::triangle::{POSES, Triangle};
use rt::{Exit, Failure, Shutdown, err, out};
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, TcpListener};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use view::{
    KeyPoses, Landmarker, LiveOptions, Measuring, RobotView, Secure, SecureError, Server, ViewError, VisionFiles,
};

/// Polling period for signals.
const LOOK: Duration = Duration::from_millis(50);

pub fn run(options: &cli::View) -> Result<Exit, Failure> {
    if let Some(recording) = &options.recording {
        return recorded(options, recording);
    }
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let place = &options.place;
    let instance = instance_in(&place.run_dir)?;
    if let Some(robot) = doors::linked_robot(instance.run_dir()) {
        let text = format!(
            "{}: an operator's end of a link to robot {robot} runs there. A page needs the shared memory of the robot's \
             machine: run view there, with --https for this browser",
            instance.run_dir().display()
        );
        return Err(Failure::new(Exit::Unavailable, text));
    }
    let loaded = place.load()?;
    let key_poses = key_poses(options.key_poses.as_deref(), &loaded)?;
    let vision = options.camera.as_ref().map(|model| VisionFiles::open(&options.vision, model)).transpose();
    let vision = vision.map_err(Failure::with(Exit::NoInput))?;
    let tls = options.tls.clone().unwrap_or_else(|| instance.run_dir().join("tls"));
    let port = options.page.port;
    let secure = options.https.as_ref().map(|names| Secure::open(names, &tls, port)).transpose();
    let secure = secure.map_err(|error| match error {
        SecureError::Name { .. } => Failure::new(Exit::Usage, error.to_string()),
        SecureError::Address { address, source } => listen_failure(Some(address), port, &source),
        SecureError::File { .. } => Failure::new(Exit::CantCreate, error.to_string()),
    })?;
    if let Some(secure) = &secure {
        if let Some(made) = &secure.made {
            out!("teleopd: {made}");
        }
        out!(
            "teleopd: where a browser warns of an unknown certificate, go on only if its SHA-256 fingerprint is:\n\
             teleopd:   {}",
            secure.fingerprint
        );
        out!("teleopd: browsers that take {} as an authority show no warning", secure.authority.display());
    }
    let lease = Duration::from_secs_f64(loaded.settings.ingest.authority_timeout_ms * 1e-3);
    let measuring = Measuring { operators: loaded.operators_dir.clone(), lease };
    let server = serve(
        &instance,
        &loaded,
        LiveOptions { key_poses, vision, measuring: Some(measuring), secure },
        &options.page,
    )?;
    out!(
        "teleopd: shows {} at {}\nteleopd: everyone with this address may operate the robot; Ctrl-C ends the page, not \
         the instance",
        instance.run_dir().display(),
        server.address()
    );
    if operator::Client::connect(instance.operator_socket()).is_err() {
        let folder = instance.run_dir().display();
        out!("teleopd: no instance runs there yet; the page waits for one (`teleopd up --run-dir {folder}` starts it)");
    }
    while !shutdown.requested() && !rt::is_orphaned(options.child_of) {
        if server.has_ended() {
            return Err(Failure::new(Exit::Software, "the server of the page ended by itself"));
        }
        std::thread::sleep(LOOK);
    }
    Ok(Exit::after(&shutdown))
}

/// Makes the landmarker, if it is not there yet.
pub fn landmarker(landmarker: Landmarker, modules: &Path) -> Result<Exit, Failure> {
    let file = landmarker.file(modules);
    let file = file.map_err(|(file, why)| Failure::new(Exit::NoInput, format!("{}: {why}", file.display())))?;
    out!("{}", file.display());
    Ok(Exit::Ok)
}

fn recorded(options: &cli::View, recording: &Path) -> Result<Exit, Failure> {
    let mut command = Command::new(RECORD.path()?);
    command.arg("--view").arg(recording).arg("--port").arg(options.page.port.to_string());
    if let Some(meshes) = &options.page.meshes {
        command.arg("--meshes").arg(meshes);
    }
    command.arg("--config").arg(&options.place.config);
    if let Some(robot) = &options.place.robot {
        command.arg("--robot").arg(robot.typed());
    }
    Err(Failure::new(Exit::Software, command.exec()))
}

/// Starts a server for `instance`, which was started at `place`. Its pages cannot act as the person.
pub fn start(instance: &Instance, place: &cli::InstanceArgs, page: &cli::Page) -> Result<Server, Failure> {
    serve(instance, &place.load()?, LiveOptions::default(), page)
}

fn port_failure(port: u16, option: &str, error: &std::io::Error) -> Failure {
    Failure::new(Exit::Unavailable, rt::port_refused(port, option, error))
}

/// Returns an error if the port is in use. Called before anything starts that would have to be stopped again.
pub fn refuse_taken(port: u16, option: &str) -> Result<(), Failure> {
    let tried = TcpListener::bind((Ipv4Addr::LOCALHOST, port));
    tried.map(drop).map_err(|error| port_failure(port, option, &error))
}

fn serve(instance: &Instance, loaded: &Loaded, options: LiveOptions, page: &cli::Page) -> Result<Server, Failure> {
    let view = RobotView::load(loaded, page.meshes.as_deref()).map_err(Failure::with(Exit::Config))?;
    if !view.missing.is_empty() {
        err!("teleopd: {} mesh files are not below --meshes: {}", view.missing.len(), view.missing.join(", "));
    }
    let https = options.secure.as_ref().map(|secure| secure.address);
    // The server's threads inherit the cores of the thread that starts them.
    let served = std::thread::scope(|scope| {
        let serve = || {
            keep_off(&loaded.settings.realtime);
            Server::live(instance, &view, options, page.port)
        };
        scope.spawn(serve).join()
    });
    let served = served.map_err(|_| Failure::new(Exit::Software, "the server of the page could not be started"))?;
    served.map_err(|error| match error {
        ViewError::Bus(error) => crate::process::bus_failure(error),
        ViewError::Listen { port, source } => listen_failure(https, port, &source),
    })
}

fn listen_failure(https: Option<IpAddr>, port: u16, error: &std::io::Error) -> Failure {
    match https {
        Some(address) if error.kind() == ErrorKind::AddrNotAvailable => {
            let text =
                format!("--https: {address}: no interface of this machine has it; `ip address` lists those that exist");
            Failure::new(Exit::Unavailable, text)
        }
        _ => port_failure(port, "--port", error),
    }
}

/// Returns the key poses that the user named, or the default ones. `None` if the instance has no network and the
/// user named no poses.
fn key_poses(asked: Option<&[String]>, loaded: &Loaded) -> Result<Option<KeyPoses>, Failure> {
    let Some(weights) = &loaded.weights else {
        let text = "--key-poses: the settings' weights.file is missing; its latent space mixes the poses";
        return asked.map_or(Ok(None), |_| Err(Failure::new(Exit::Config, text)));
    };
    let poses = asked.map_or_else(|| POSES.map(str::to_owned).to_vec(), <[String]>::to_vec);
    let triangle = Triangle::new(&loaded.model, &weights.network, &poses).map_err(|error| {
        let exit = match error {
            PosesError::Motion(_) | PosesError::File { .. } => Exit::NoInput,
            _ => Exit::Usage,
        };
        Failure::new(exit, format!("--key-poses: {error}"))
    })?;
    let names = triangle.names().clone();
    Ok(Some(KeyPoses { names, person: Box::new(move |shares, at_s| triangle.raw(shares, at_s)) }))
}
