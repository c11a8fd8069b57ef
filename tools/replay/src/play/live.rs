//! Publishes through the input domain or the skeleton socket. The first frame is held until the robot follows.

use crate::cli::Cli;
use client::{PlayOptions, Player, Publisher, Transport};
use doors::{DoorError, Reply};
use indicatif::{ProgressBar, ProgressStyle};
use instance::Instance;
use messages::Mode;
use motion::Motion;
use operator::{Client, OperatorError};
use rt::{Exit, Failure, Shutdown, out};
use std::path::Path;
use std::time::Duration;

/// Time between two requests of the mode, and between two updates of the progress.
const LOOK_PERIOD: Duration = Duration::from_millis(50);

const HELD: &str = "Another client holds the lease, so the robot does not see this motion. End that client, wait a second, and \
                    start this one again.";

/// Connects to the operator's socket of the instance. None if it belongs to others, or if only the skeleton
/// socket is given. A client that shares memory with an instance also finds its operator socket. Without that
/// socket there is no instance.
fn operator_of(cli: &Cli, instance: &Instance) -> Result<Option<Client>, Failure> {
    match Client::connect(instance.operator_socket()) {
        Ok(client) => Ok(Some(client)),
        Err(OperatorError::Door(DoorError::PermissionDenied { .. })) => Ok(None),
        Err(_) if cli.socket.is_some() => Ok(None),
        Err(error) => {
            let text = format!("no instance of teleopd runs in {}: {error}", instance.run_dir().display());
            Err(Failure::new(Exit::Unavailable, text))
        }
    }
}

fn bar_of(frames: u64) -> ProgressBar {
    let bar = ProgressBar::new(frames);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {pos}/{len} frames, {elapsed}") {
        bar.set_style(style);
    }
    bar
}

/// Prints a line above the bar. Without a terminal there is no bar.
fn print_line(bar: &ProgressBar, line: &str) {
    if bar.is_hidden() { out!("{line}") } else { bar.println(line) }
}

fn place(cli: &Cli) -> Result<(Instance, Transport), Failure> {
    let instance = match &cli.socket {
        Some(socket) => Instance::unmade(socket.parent().unwrap_or(Path::new("."))),
        None if cli.run_dir.is_dir() => Instance::unmade(&cli.run_dir),
        None => {
            let folder = cli.run_dir.display();
            let text = format!("no instance of teleopd runs in {folder}; start one: `teleopd up --run-dir {folder}`");
            return Err(Failure::new(Exit::Unavailable, text));
        }
    };
    let transport = match &cli.socket {
        Some(socket) => Transport::Socket(socket.clone()),
        // Shared memory does not reach over a link.
        None if doors::linked_robot(instance.run_dir()).is_some() => Transport::Socket(instance.skeleton_socket()),
        None => Transport::Domain(instance.input_domain()),
    };
    Ok((instance, transport))
}

/// Returns true if a client holds the lease now. Shared memory gives no answer, so this asks at the skeleton socket.
fn is_lease_held(instance: &Instance) -> bool {
    doors::Client::attach(instance.skeleton_socket()).is_ok_and(|door| door.last_reply() == Reply::GrantedButHeld)
}

pub fn run(cli: &Cli, motion: &Motion) -> Result<(), Failure> {
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Failed))?;
    let (instance, transport) = place(cli)?;
    if is_lease_held(&instance) {
        out!("{HELD}");
    }
    // The person moves during calibration, although the robot is not engaged.
    let at_once = motion.name == motion::CALIBRATION;
    let looped = cli.looped || at_once;
    let options = PlayOptions { speed: cli.speed, looped, calibration: cli.calibration };
    let nonce = u64::from(rt::incarnation()) << 32 | u64::from(std::process::id());
    let player = Player::new(motion, options, nonce, rt::incarnation());
    let publisher = Publisher::start_on(transport, player, rt::now).map_err(Failure::with(Exit::Unavailable))?;

    let mut control = operator_of(cli, &instance)?;
    // Without an operator socket the start of following is unknown. So the motion begins at once.
    if at_once {
        out!("playing in a loop; `teleopctl calibrate NAME` measures this person, Ctrl-C ends");
        publisher.set_engaged(true);
    } else if control.is_none() {
        out!("no operator socket answers in {}: playing at once", instance.run_dir().display());
        publisher.set_engaged(true);
    } else {
        out!("holding the first frame until the robot is engaged (`teleopctl engage`)");
    }
    let bar = bar_of(publisher.progress().1);
    let (mut mode, mut last_reply, mut unanswered) = (None, None, None);
    let names = instance::read_names(instance.run_dir());
    // `followed` is true once the robot has followed. `ended` is the reason why it stopped following.
    let (mut followed, mut ended) = (false, None);
    while !shutdown.requested() && !publisher.finished() {
        if let Some(client) = &mut control {
            match client.heartbeat() {
                Ok(status) => {
                    let now = Mode::from_u32(status.mode);
                    if now != mode {
                        print_line(&bar, now.map_or("unknown mode", Mode::name));
                        mode = now;
                        let follows = matches!(now, Some(Mode::Engaged | Mode::Engaging));
                        let why = explain::why_stopped(&status, &names).filter(|_| followed && !follows);
                        why.iter().for_each(|why| print_line(&bar, why));
                        ended = if follows { None } else { why.or(ended) };
                        followed |= now == Some(Mode::Engaged);
                    }
                    publisher.set_engaged(at_once || now == Some(Mode::Engaged));
                }
                Err(error) => {
                    let error = Some(error.to_string());
                    error.iter().filter(|_| error != unanswered).for_each(|error| print_line(&bar, error));
                    unanswered = error;
                }
            }
        }
        if publisher.last_reply() != last_reply {
            last_reply = publisher.last_reply();
            last_reply.iter().for_each(|last_reply| print_line(&bar, last_reply));
        }
        bar.set_position(publisher.progress().0);
        std::thread::sleep(LOOK_PERIOD);
    }
    bar.finish();
    outcome(&publisher, ended.filter(|_| !shutdown.requested()))?;
    if !shutdown.requested() {
        out!("the motion is over: no more skeletons are sent, so the robot stops");
    }
    Ok(())
}

/// Returns the reason for which the robot did not see or follow the whole motion as error.
fn outcome(publisher: &Publisher, ended: Option<String>) -> Result<(), Failure> {
    if publisher.failures() > 0 {
        let why = publisher.last_reply().map_or(String::new(), |why| format!("; the last one: {why}"));
        return Err(Failure::new(Exit::Failed, format!("{} frames were not accepted{why}", publisher.failures())));
    }
    let missed = |why| Failure::new(Exit::Failed, format!("the robot did not follow to the end of the motion: {why}"));
    ended.map_or(Ok(()), |why| Err(missed(why)))
}
