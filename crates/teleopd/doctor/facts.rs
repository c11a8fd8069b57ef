//! Facts about this machine. This module reads them and does not judge them.

use super::places::{self, Folder, Segment};
use crate::cli::InstanceArgs;
use crate::process::realtime;
use config::{Method, Settings};
use rt::{CoreMap, Limits, Placement, Realtime};
use rustix::fs::{Access, AtFlags, CWD, accessat};
use rustix::time::{ClockId, clock_getres};
use std::path::{Path, PathBuf};

#[derive(Clone, Debug)]
pub struct Facts {
    pub files: Files,
    pub rights: UserRights,
    pub kernel: Kernel,
    pub cores: Cores,
    pub memory: Memory,
    pub place: PlaceFacts,
}

/// Contents of the instance's files, or the error that refused them. `None` means not examined, because an
/// earlier file is refused.
#[derive(Clone, Debug)]
pub struct Files {
    pub settings: Result<Settings, String>,
    pub config: String,
    pub robot: Option<Result<String, String>>,
    /// Doubts about the robot's collision model.
    pub doubts: Vec<String>,
    pub weights: Option<Result<String, String>>,
    pub stages: Option<Result<String, String>>,
}

#[derive(Clone, Debug)]
pub struct UserRights {
    pub uid: u32,
    pub limits: Limits,
    /// The highest priority in the settings. The result says if a trial thread got it.
    pub fifo: Option<(u32, Result<String, String>)>,
    /// `None` if there is no such device.
    pub cpu_dma_latency: Option<bool>,
}

#[derive(Clone, Debug)]
pub struct Kernel {
    pub release: String,
    pub version: String,
    pub preempt_rt: bool,
    /// sched_rt_runtime_us and sched_rt_period_us.
    pub throttling_us: Option<(i64, i64)>,
    pub clocksource: Option<String>,
    pub resolution_ns: u64,
    pub ptrace_scope: Option<u32>,
    pub virtual_machine: bool,
}

#[derive(Clone, Debug)]
pub struct Cores {
    pub map: CoreMap,
    pub nohz_full: Vec<usize>,
    /// Governors of the cores that have one.
    pub governors: Vec<(usize, String)>,
    pub processor: String,
    pub placement: Option<Placement>,
}

#[derive(Clone, Debug)]
pub struct Memory {
    /// Size and free bytes of /dev/shm.
    pub shared: Result<(u64, u64), String>,
    pub swaps: Vec<String>,
}

#[derive(Clone, Debug)]
pub struct PlaceFacts {
    pub run_dir: PathBuf,
    /// The run folder, and the bus's folders in it.
    pub folders: Vec<(PathBuf, Folder)>,
    /// The reason the bus cannot use such paths.
    pub refused: Option<String>,
    pub segments: Vec<Segment>,
    /// Segments of this user's other instances that are dead.
    pub strangers: Vec<Segment>,
    /// Id of the process that holds the operator's socket.
    pub holder: Option<u32>,
}

impl Facts {
    pub fn read(place: &InstanceArgs) -> Self {
        let files = files(place);
        let settings = files.settings.as_ref().ok().map(|settings| &settings.realtime);
        let rights = UserRights {
            uid: rustix::process::geteuid().as_raw(),
            limits: Limits::of_process(),
            fifo: settings.filter(|settings| settings.policy == config::Policy::Fifo).map(|settings| {
                let all = [settings.priority_retarget, settings.priority_control, settings.priority_driver];
                let highest = all.into_iter().max().unwrap_or_default();
                (highest, Realtime::try_fifo(highest as u8))
            }),
            cpu_dma_latency: Path::new(CPU_DMA_LATENCY)
                .exists()
                .then(|| accessat(CWD, CPU_DMA_LATENCY, Access::READ_OK | Access::WRITE_OK, AtFlags::EACCESS).is_ok()),
        };
        let placement = settings.map(realtime::placement);
        Self { files, rights, kernel: kernel(), cores: cores(placement), memory: memory(), place: places::read(place) }
    }
}

/// Device that keeps cores awake.
const CPU_DMA_LATENCY: &str = "/dev/cpu_dma_latency";

fn files(place: &InstanceArgs) -> Files {
    let config = place.config.display().to_string();
    let settings = config::read_settings(&place.config, &place.overrides()).map_err(|error| error.to_string());
    let mut files = Files { settings, config, robot: None, doubts: Vec::new(), weights: None, stages: None };
    let Ok(settings) = &files.settings else { return files };
    let folder = place.config.parent().unwrap_or(Path::new("."));
    let robot_file = folder.join(&settings.robot.file);
    let robot = config::load_model(&robot_file).map_err(|error| error.to_string());
    files.robot = Some(robot.as_ref().map(|_| robot_file.display().to_string()).map_err(Clone::clone));
    let Ok((model, _)) = robot else { return files };
    files.doubts = model.doubts();
    let base = folder.join(&settings.weights.file);
    let manifest = PathBuf::from(format!("{}.toml", base.display()));
    files.weights = Some(if settings.retarget.method == Method::Network || manifest.exists() {
        match config::load_weights(&base, &model) {
            Ok(_) => Ok(format!("{}.safetensors: sha256 as in its manifest, made for this robot", base.display())),
            Err(_) if config::lacks_weights(place.robot.as_ref(), &base) => {
                Ok(String::from("none for this robot, so the closed form retargets; `train` makes them"))
            }
            Err(error) => Err(error.to_string()),
        }
    } else {
        Ok(String::from("none, and retarget.method needs none"))
    });
    if matches!(files.weights, Some(Ok(_))) {
        files.stages = Some(stages(place));
    }
    files
}

fn stages(place: &InstanceArgs) -> Result<String, String> {
    let loaded = config::load(&place.config, place.overrides()).map_err(|error| error.to_string())?;
    crate::check::check_stages(&loaded).map_err(|error| error.to_string())?;
    Ok(format!("accepted by every stage, hash {:016x}", loaded.hash))
}

fn line(path: impl AsRef<Path>) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn kernel() -> Kernel {
    let number = |name: &str| line(format!("/proc/sys/kernel/{name}")).and_then(|text| text.parse::<i64>().ok());
    let resolution = clock_getres(ClockId::Monotonic);
    Kernel {
        release: line("/proc/sys/kernel/osrelease").unwrap_or_default(),
        version: line("/proc/sys/kernel/version").unwrap_or_default(),
        preempt_rt: rt::is_preempt_rt(),
        throttling_us: number("sched_rt_runtime_us").zip(number("sched_rt_period_us")),
        clocksource: line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        resolution_ns: resolution.tv_sec as u64 * 1_000_000_000 + resolution.tv_nsec as u64,
        ptrace_scope: number("yama/ptrace_scope").and_then(|scope| u32::try_from(scope).ok()),
        virtual_machine: std::fs::read_to_string("/proc/cpuinfo").is_ok_and(|text| text.contains(" hypervisor")),
    }
}

fn cores(placement: Option<Placement>) -> Cores {
    let map = CoreMap::of_machine();
    let cpu = "/sys/devices/system/cpu";
    let governor = |core: &usize| line(format!("{cpu}/cpu{core}/cpufreq/scaling_governor")).map(|name| (*core, name));
    Cores {
        governors: map.online.iter().filter_map(governor).collect(),
        nohz_full: line(format!("{cpu}/nohz_full")).and_then(|text| rt::core_list(&text)).unwrap_or_default(),
        processor: rt::cpu_features(),
        map,
        placement,
    }
}

fn memory() -> Memory {
    let shared = rustix::fs::statvfs("/dev/shm").map_err(|error| error.to_string());
    // The first line of /proc/swaps is a heading.
    let swaps = std::fs::read_to_string("/proc/swaps").unwrap_or_default();
    let swaps = swaps.lines().skip(1).filter_map(|line| line.split_whitespace().next().map(str::to_owned)).collect();
    Memory { shared: shared.map(|stat| (stat.f_blocks * stat.f_frsize, stat.f_bavail * stat.f_frsize)), swaps }
}
