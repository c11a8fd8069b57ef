//! Records a running instance, in a process of its own. Or summarises or shows a recording.

use crate::cli::Cli;
use crate::live_view::LiveView;
use crate::{Attached, Entry, Origin, Queue, Rates, Recorded, Summary};
use clap::Parser;
use config::Loaded;
use instance::Instance;
use robot::Names;
use rt::{Exit, Failure, ServiceManager, Shutdown, err, out};
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant, SystemTime};
use view::ViewError;

/// Bounds of the picture rate: at most one per tick, at least one in ten seconds.
const RATE_HZ: (f64, f64) = (0.1, 1500.0);
/// Upper bound of --seconds: a week.
const SECONDS_MAX: f64 = 604_800.0;
/// Time limit of the search for a running instance. Assumption: a thousand processes took 0.1 s.
const LOOK_WITHIN: Duration = Duration::from_secs(5);

/// Runs the command of this process' arguments.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let outcome = match (&cli.view, &cli.summary) {
        (Some(file), _) => view(&cli, file),
        (None, Some(file)) => summary(&cli, file),
        (None, None) => record(&cli),
    };
    rt::finish("record", outcome)
}

fn view(cli: &Cli, file: &Path) -> Result<(), Failure> {
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let loaded = config::load(&cli.config, cli.overrides()).map_err(Failure::with(Exit::Config))?;
    let shown = view::RobotView::load(&loaded, cli.meshes.as_deref()).map_err(Failure::with(Exit::Config))?;
    if !shown.missing.is_empty() {
        err!("record: {} mesh files are not below --meshes: {}", shown.missing.len(), shown.missing.join(", "));
    }
    err!("record: reads {}", file.display());
    let (recording, broken_off) = crate::recording_view(file, &loaded.model).map_err(Failure::with(Exit::NoInput))?;
    let mut name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if let Some(why) = broken_off {
        err!("record: {} is damaged or truncated ({why}); what is whole is shown", file.display());
        name.push_str(", which is damaged or truncated");
    }
    let server = view::Server::recording(recording, &name, &shown, cli.port);
    let server = server.map_err(|error| unserved(error, "--port"))?;
    out!("record: shows {} at {}", file.display(), server.address());
    while !shutdown.requested() {
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

fn summary(cli: &Cli, file: &Path) -> Result<(), Failure> {
    // The names of the parts, and the limits in the picture, come from --config. Without it, indices replace the names.
    let loaded = config::load(&cli.config, cli.overrides()).map_err(Failure::with(Exit::Config));
    let recorded = Recorded::open(file).map_err(Failure::with(Exit::NoInput))?;
    cli.plot.as_deref().map_or(Ok(()), Failure::check_writable)?;
    // The names of another robot would be wrong.
    let loaded = loaded
        .and_then(|loaded| recorded.check_robot(&loaded.model).map(|()| loaded).map_err(Failure::with(Exit::NoInput)));
    let names = loaded.as_ref().map_or_else(|_| Names::default(), |loaded| Names::from_model(&loaded.model));
    let summary = Summary::read(recorded, &names).map_err(Failure::with(Exit::NoInput))?;
    out!("{}", summary.text().trim_end());
    let lost = |why| Failure::new(Exit::DataErr, format!("{} is damaged or truncated: {why}", file.display()));
    let lost = summary.broken_off().map(lost);
    if let Some(picture) = cli.plot.as_ref().filter(|_| lost.is_none() || !summary.counts.is_empty()) {
        let loaded = loaded?;
        let title = format!("{}, {:.1} s", file.display(), summary.duration_s());
        crate::plot(picture, &summary.trace, &loaded.model, &title).map_err(Failure::with(Exit::CantCreate))?;
        out!("picture   {}", picture.display());
    }
    lost.map_or(Ok(()), Err)
}

fn check(cli: &Cli) -> Result<(), Failure> {
    let (low, high) = RATE_HZ;
    if !(low..=high).contains(&cli.rate) {
        return Err(Failure::new(Exit::Usage, format!("--rate {:?} is outside [{low}, {high}]", cli.rate)));
    }
    if let Some(seconds) = cli.seconds.filter(|&seconds| !(seconds > 0.0 && seconds <= SECONDS_MAX)) {
        return Err(Failure::new(Exit::Usage, format!("--seconds {seconds:?} is outside (0, {SECONDS_MAX}]")));
    }
    // `up` and `demo` start their recorder before the instance, so that it reads the first message.
    let prefix = Instance::unmade(&cli.run_dir).core_domain().prefix;
    if cli.child_of.is_none() && !bus::is_inhabited(&prefix, Instant::now() + LOOK_WITHIN) {
        let folder = cli.run_dir.display();
        let text = format!(
            "no instance of teleopd runs in {folder}, so there is nothing to record. Start one (teleopd up --run-dir \
             {folder}), or give the --run-dir of one that runs"
        );
        return Err(Failure::new(Exit::Unavailable, text));
    }
    Ok(())
}

fn record(cli: &Cli) -> Result<(), Failure> {
    check(cli)?;
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let manager = ServiceManager::from_environment().map_err(Failure::with(Exit::Software))?;
    let loaded = config::load(&cli.config, cli.overrides()).map_err(Failure::with(Exit::Config))?;
    let mut attached = attach(cli, &loaded)?;
    let live = cli.foxglove.map(|port| serve(port, cli, &loaded)).transpose()?;
    let mut file = cli.out.as_ref().map(|out| begin(cli, out, &loaded).map(|queue| (out, queue))).transpose()?;
    let _ = manager.ready();
    if let Some(out) = &cli.out {
        out!("record: writing {}", out.display());
    }
    let add = |file: &mut Option<(_, Queue)>, entry: Entry| {
        live.iter().for_each(|live| live.add(&entry));
        if let Some((_, queue)) = file {
            queue.add(entry);
        }
    };
    let begun = rt::now();
    let end = cli.seconds.map(|seconds| begun.plus_ns((seconds * 1e9) as u64));
    let (mut warned, mut failed) = (false, false);
    while !shutdown.requested() && !rt::is_orphaned(cli.child_of) && end.is_none_or(|end| rt::now() < end) {
        attached.look(&mut |entry| add(&mut file, entry));
        if let (false, Some(hash)) = (warned, attached.other_settings()) {
            warned = true;
            let ours = loaded.hash;
            err!(
                "record: the instance runs with the settings {hash:016x}, these options give {ours:016x}. Give \
                 --config, --robot, --engage-without-realtime and --interface as for the instance, or settings and \
                 names are wrong"
            );
        }
        if let Some((out, _)) = file.as_ref().filter(|(_, queue)| !failed && queue.failed()) {
            failed = true;
            err!("record: {}: nothing more can be written; the file is good up to here", out.display());
        }
        shutdown.sleep_until(attached.next_look(rt::now()));
    }
    // Read the last published messages.
    attached.look(&mut |entry| add(&mut file, entry));
    file.map_or(Ok(()), |(out, queue)| finish(out, &attached, queue))
}

fn serve(port: u16, cli: &Cli, loaded: &Loaded) -> Result<LiveView, Failure> {
    let live = LiveView::start(port, crate::about(loaded, &cli.overrides(), Origin::Live).1);
    let live = live.map_err(|error| unserved(error, "--foxglove"))?;
    out!("record: shows {} at {}", cli.run_dir.display(), live.server.address());
    Ok(live)
}

fn unserved(error: ViewError, option: &str) -> Failure {
    match error {
        ViewError::Listen { port, source } => Failure::new(Exit::Unavailable, rt::port_refused(port, option, &source)),
        error => Failure::new(Exit::Unavailable, error),
    }
}

fn attach(cli: &Cli, loaded: &Loaded) -> Result<Attached, Failure> {
    let instance = Instance::unmade(&cli.run_dir);
    let wall = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or(Duration::ZERO);
    // Viewers show the time of day. The stamps inside our own messages stay those of the monotonic clock.
    let offset_ns = u64::try_from(wall.as_nanos()).unwrap_or(0).saturating_sub(rt::now().0);
    let rates = Rates { pictures_hz: cli.rate, full: cli.full };
    Attached::open(instance.core_domain(), (&loaded.model, loaded.hash), rates, offset_ns)
        .map_err(Failure::with(Exit::Unavailable))
}

fn begin(cli: &Cli, out: &Path, loaded: &Loaded) -> Result<Queue, Failure> {
    let (mut about, files) = crate::about(loaded, &cli.overrides(), Origin::Live);
    about.insert("full".to_owned(), cli.full.to_string());
    about.insert("rate_hz".to_owned(), cli.rate.to_string());
    let file = OpenOptions::new().write(true).create_new(true).open(out);
    let file = file.map_err(|error| Failure::unwritable(out, &error))?;
    Queue::start(file, &about, &files).map_err(|error| {
        // A file without a beginning is not a recording. Removing it frees the name for another attempt.
        let _ = std::fs::remove_file(out);
        Failure::new(Exit::CantCreate, format!("{}: {error}", out.display()))
    })
}

fn finish(out: &Path, attached: &Attached, queue: Queue) -> Result<(), Failure> {
    let missed = attached.missed();
    let named = |(topic, count): &(crate::Topic, u64)| (format!("missed {}", topic.name()), count.to_string());
    let last: BTreeMap<String, String> = missed.iter().map(named).collect();
    let outcome = queue.finish(last);
    let unseen: Vec<_> = missed.iter().map(|(topic, count)| format!("{count} of {}", topic.name())).collect();
    out!("record: {} messages in {}, {} lost", outcome.written, out.display(), outcome.lost);
    out!("record: published between two polls and missed: {}", unseen.join(", "));
    if !attached.heard_any() {
        out!("record: no process of an instance published anything; is --run-dir correct?");
    }
    match outcome.failure {
        Some(failure) => {
            Err(Failure::new(Exit::Failed, format!("{}: {failure}; {} messages lost", out.display(), outcome.lost)))
        }
        None => Ok(()),
    }
}
