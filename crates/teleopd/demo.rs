//! Runs the whole system on one machine: real processes, a recorded person and a virtual operator. Prints a table
//! at the end.

use crate::children::{Children, Output, instance_in, refuse_second};
use crate::cli;
use crate::folder::Folder;
use crate::live_display::LiveDisplay;
use crate::process::bus_failure;
use crate::processes::PROCESSES;
use crate::programs::TELEOPD;
use crate::recorder::Recorder;
use crate::report::{Report, Simulator};
use client::{ClientError, PlayOptions, Player, Publisher};
use config::{DriverKind, Loaded, Overrides, RealtimeSettings};
use instance::Instance;
use messages::{Mode, Status};
use motion::CalibrationMode;
use operator::OperatorSession;
use robot::Names;
use rt::{Exit, Failure};
use rt::{Shutdown, out};
use std::path::Path;
use std::time::{Duration, Instant};

/// Polling period of the run, and time between two pictures.
const LOOK: Duration = Duration::from_millis(50);
/// Longest time until no fault inhibits engaging. The processes are READY, so a few hundred ms are enough.
const CLEAR_WITHIN: Duration = Duration::from_secs(5);
/// Longest time from the enable to Engaged. Blending takes 3 s, and the torso's whole stroke takes 5 s.
const ENGAGED_WITHIN: Duration = Duration::from_secs(20);
/// Longest time from release to rest, four times the longest stop.
const REST_WITHIN: Duration = Duration::from_secs(2);

/// Runs the demo.
pub fn run(options: &cli::Demo) -> Result<Exit, Failure> {
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let (motion, loaded) = read(options)?;
    let simulator = if loaded.driver_program().is_some() { Simulator::Own } else { Simulator::BuiltIn };
    let folder = Folder::new(options.run_dir.as_deref(), "demo");
    let instance = instance_in(&folder.path)?;
    let place = cli::InstanceArgs {
        config: options.config.clone(),
        run_dir: folder.path.clone(),
        engage_without_realtime: true,
        interface: options.interface,
        robot: options.robot.clone(),
    };
    print_inputs(&motion, &loaded);
    refuse_second(&instance)?;
    let mut recorder = Recorder::start_if(options.record.as_deref(), &instance, &place)?;
    let mut children = Children::start(&instance, &place, Output::Files)?;
    out!("processes {} are ready", PROCESSES.join(", "));
    let play = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
    let nonce = u64::from(rt::incarnation()) << 32 | u64::from(std::process::id());
    let player = Player::new(&motion, play, nonce, rt::incarnation());
    let publisher = Publisher::start(instance.input_domain(), player, rt::now).map_err(client_failure)?;
    let operator = OperatorSession::connect(&instance.operator_socket())?;
    let missing = missing(&loaded.settings.realtime);
    let names = Names::from_model(&loaded.model);
    let mut show = LiveDisplay::new(&instance, loaded.model, options.quiet)?;
    let page = cli::Page { port: options.view_port, meshes: options.meshes.clone() };
    let server = if options.view { Some(shown(&instance, &place, &page, &shutdown)?) } else { None };
    let mut run = Run {
        children: &mut children,
        operator: &operator,
        publisher: &publisher,
        shutdown: &shutdown,
        missing: &missing,
        names: &names,
    };
    let ended = run.engage_and_follow(options.seconds, &mut show);
    show.end();

    operator.release();
    operator.wait(REST_WITHIN, |status| !matches!(mode_of(status), Mode::Engaging | Mode::Engaged | Mode::Holding));
    let faults = operator.status().map(|status| explain::status_json(&status, &names)["fault_counts"].take());
    drop((operator, server));
    let mut trouble = children.stop();
    trouble.extend(recorder.as_mut().and_then(Recorder::stop));
    drop(publisher);
    if folder.temporary {
        instance.retire();
    }
    let report = Report::collect(&instance, simulator, faults).map_err(|failure| {
        let causes = trouble.iter().chain(ended.as_ref().err()).chain([&failure.text]);
        Failure::new(failure.exit, causes.map(String::as_str).collect::<Vec<_>>().join("; "))
    })?;
    report.print();
    report.write(options.report.as_deref())?;
    if shutdown.requested() {
        return Ok(Exit::Interrupted);
    }
    judged(trouble, ended.err(), &report)?;
    if !options.quiet {
        out!(
            "\nnext      {} demo --view shows it in a browser; docs/src/getting-started.md goes on from there",
            TELEOPD.typed()
        );
    }
    out!("{}", report.verdict());
    Ok(Exit::Ok)
}

/// Prints what is played, and who drives the robot if a program of the settings does.
fn print_inputs(motion: &motion::Motion, loaded: &Loaded) {
    out!("motion    {} ({:.1} s at {:.0} Hz)", motion.name, motion.duration_s(), motion.frame_rate_hz);
    for warning in &motion.guesses.warnings {
        out!("          {warning}");
    }
    if let Some(program) = loaded.driver_program() {
        let ros2 = &loaded.settings.ros2;
        out!(
            "driver    {}; over ROS 2: domain {}, servo lag {} ms",
            program.display(),
            ros2.domain_id,
            ros2.servo_lag_ms
        );
    }
}

/// Returns the failure of a run. `trouble` is that of the processes, and `ended` why the robot was stopped or did not engage. A
/// machine that paused is no broken robot: then the run was only held.
fn judged(mut trouble: Vec<String>, ended: Option<String>, report: &Report) -> Result<(), Failure> {
    trouble.extend(report.violations());
    let mut stops = report.stops();
    stops.extend(ended);
    match (trouble.is_empty(), stops.is_empty(), report.advice(), report.pause()) {
        (true, true, None, _) => Ok(()),
        (true, true, Some(advice), _) => Err(Failure::new(Exit::Held, advice)),
        (true, false, _, Some(pause)) => {
            let (why, book) = (stops.join("; "), "docs/src/real-time.md");
            Err(Failure::new(
                Exit::Held,
                format!("{pause}: the robot stopped as it must; run it again, or see {book} ({why})"),
            ))
        }
        (_, _, advice, _) => {
            trouble.extend(stops);
            trouble.extend(advice);
            Err(Failure::new(Exit::Failed, trouble.join("; ")))
        }
    }
}

/// Reads all inputs of a run. Checks that its report can be written and its page served.
fn read(options: &cli::Demo) -> Result<(motion::Motion, Loaded), Failure> {
    if let Some(seconds) = options.seconds.filter(|seconds| !(*seconds > 0.0 && *seconds <= 86_400.0)) {
        return Err(Failure::new(Exit::Usage, format!("--seconds {seconds:?} is outside (0, 86400]")));
    }
    let path = options.motion.as_deref().unwrap_or(Path::new("builtin"));
    let motion = motion::load_with(path, &options.load).map_err(|error| poses::error::failure(&error))?;
    motion.stands_from().map_err(|why| Failure::new(Exit::NoInput, format!("{}: {why}", path.display())))?;
    let (interface, robot) = (options.interface, options.robot.clone());
    let overrides = Overrides { engage_without_realtime: true, interface, robot };
    let loaded = config::load(&options.config, overrides).map_err(Failure::with(Exit::Config))?;
    if loaded.settings.driver.kind == DriverKind::Robot {
        let text = "demo moves a simulated robot only, but driver.kind is \"robot\"; run `teleopd up`";
        return Err(Failure::new(Exit::Config, text));
    }
    options.report.as_deref().map_or(Ok(()), Failure::check_writable)?;
    if options.view {
        crate::view::refuse_taken(options.view_port, "--view-port")?;
    }
    Ok((motion, loaded))
}

/// Returns the real-time features that this machine or the settings deny to the real-time processes. Empty if
/// they run in real time.
pub fn missing(settings: &RealtimeSettings) -> Vec<&'static str> {
    let limits = rt::Limits::of_process();
    let fifo =
        settings.policy == config::Policy::Fifo && rt::Realtime::try_fifo(settings.priority_control as u8).is_ok();
    let memory = settings.lock_memory && (limits.any_lock || limits.memlock_bytes.is_none());
    [(fifo, "SCHED_FIFO"), (memory, "locked memory"), (rt::is_preempt_rt(), "a PREEMPT_RT kernel")]
        .into_iter()
        .filter_map(|(granted, name)| (!granted).then_some(name))
        .collect()
}

/// Serves the page and waits until one is open.
fn shown(
    instance: &Instance,
    place: &cli::InstanceArgs,
    page: &cli::Page,
    shutdown: &Shutdown,
) -> Result<view::Server, Failure> {
    let server = crate::view::start(instance, place, page)?;
    out!("open      {}", server.address());
    while server.pages() == 0 && !shutdown.requested() {
        std::thread::sleep(LOOK);
    }
    Ok(server)
}

fn mode_of(status: &Status) -> Mode {
    Mode::from_u32(status.mode).unwrap_or(Mode::Faulted)
}

/// Parts of a run that it supervises.
struct Run<'a> {
    children: &'a mut Children,
    operator: &'a OperatorSession,
    publisher: &'a Publisher,
    shutdown: &'a Shutdown,
    /// Reasons why the run is not real-time.
    missing: &'a [&'static str],
    names: &'a Names,
}

impl Run<'_> {
    /// Says what happened, and why.
    fn reason(&self, what: &str) -> String {
        let why = self.operator.status().and_then(|status| explain::why_stopped(&status, self.names));
        why.map_or_else(|| what.to_owned(), |why| format!("{what}: {why}"))
    }

    /// Engages and follows the motion to its end, or for `seconds` of it. Returns an error that says what went
    /// wrong.
    fn engage_and_follow(&mut self, seconds: Option<f64>, show: &mut LiveDisplay) -> Result<(), String> {
        // Control must see the enable released before it engages. Wait for that, and until every inhibit has cleared.
        let clear =
            self.operator.wait(CLEAR_WITHIN, |status| status.faults == 0 && status.moving == 0 && status.ticks > 600);
        if !clear {
            return Err(self.reason("cannot engage"));
        }
        let realtime = self.operator.status().is_some_and(|status| status.realtime == 1);
        if !realtime {
            out!(
                "note      not real-time here, without {}: fine for the simulator, with relaxed stale times\n          \
                 (`teleopd doctor` says what a robot needs)",
                if self.missing.is_empty() { "real-time rights".to_owned() } else { self.missing.join(", ") }
            );
        }
        if self.shutdown.requested() {
            return Ok(());
        }
        self.operator.enable();
        let enabled = Instant::now();
        let mut engaged: Option<Instant> = None;
        loop {
            std::thread::sleep(LOOK);
            let Some(mode) = self.operator.mode() else { return Err("control does not answer".into()) };
            show.draw(self.operator.status(), self.publisher.progress());
            if self.shutdown.requested() {
                return Ok(());
            }
            if let Some((name, status)) = self.children.ended() {
                return Err(format!("{name} ended by itself ({status})"));
            }
            if mode == Mode::Faulted {
                return Err("the robot was stopped".into());
            }
            if mode == Mode::Engaged && engaged.is_none() {
                engaged = Some(Instant::now());
                self.publisher.set_engaged(true);
            }
            if engaged.is_some() && mode == Mode::Disengaged {
                return Err(self.reason("the robot was released before the end of the motion"));
            }
            match engaged {
                None if enabled.elapsed() > ENGAGED_WITHIN => return Err(self.reason("the robot did not engage")),
                None => {}
                Some(since) => {
                    let enough = seconds.is_some_and(|seconds| since.elapsed().as_secs_f64() >= seconds);
                    if enough || self.publisher.finished() {
                        return Ok(());
                    }
                }
            }
        }
    }
}

fn client_failure(error: ClientError) -> Failure {
    match error {
        ClientError::Bus(error) => bus_failure(error),
        error => Failure::new(Exit::Unavailable, error),
    }
}
