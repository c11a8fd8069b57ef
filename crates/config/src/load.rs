//! Reads an instance's files: settings, robot, weights. Computes one hash of them, which every message header carries.

use crate::ConfigError;
use crate::choice::RobotChoice;
use crate::operators::Operators;
use crate::settings::Settings;
use driver::Interface;
use layouts::{Layouts, Lifter, Map};
use messages::{FNV_BASIS, fnv};
use retarget::{Method, RIGHT_ARM};
use robot::Model;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Largest text file that is read. The bound comes from `robot`, which allows a URDF of 5 MB. The others are smaller.
const TEXT_BYTES_MAX: u64 = 5 << 20;
/// Index of the robot file in `Loaded::files`.
const ROBOT_FILE: usize = 1;
/// The largest weights file that is read.
const WEIGHTS_BYTES_MAX: u64 = 256 << 20;

/// Everything that is fixed before the first tick.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The settings in force.
    pub settings: Settings,
    /// The robot among its obstacles.
    pub model: Model,
    /// Trained weights. `None` if the method needs none and there is no file.
    pub weights: Option<retarget::Weights>,
    /// Prediction of the person's limbs. `None` if the settings name no file.
    pub prediction: Option<retarget::Prediction>,
    /// The lifter of a camera's image points. `None` if the settings name no file.
    pub lifter: Option<Lifter>,
    /// The layouts that clients may send.
    pub layouts: Layouts,
    /// Calibrations of the operators. They may change while the instance runs, so the hash excludes them.
    pub operators: Operators,
    /// Folder of their files.
    pub operators_dir: PathBuf,
    /// Hash of everything else.
    pub hash: u64,
    /// The files that were read.
    pub files: Vec<PathBuf>,
}

impl Loaded {
    /// The settings file's name, for errors.
    pub fn config_name(&self) -> String {
        self.files.first().map_or_else(String::new, |file| file.display().to_string())
    }

    /// The robot file. Other files of the robot are beside it.
    pub fn robot_file(&self) -> &Path {
        self.files.get(ROBOT_FILE).map_or(Path::new(""), PathBuf::as_path)
    }

    /// The program that drives the robot in place of the simulated one; `None` if the settings name none.
    pub fn driver_program(&self) -> Option<PathBuf> {
        self.settings.driver_program(self.files.first().map_or(Path::new(""), PathBuf::as_path))
    }

    /// Every setting in force, as `table.key` and value.
    pub fn effective(&self) -> Vec<(String, String)> {
        let tables = toml::Table::try_from(&self.settings).unwrap_or_default();
        let mut all = Vec::new();
        for (table, keys) in &tables {
            for (key, value) in keys.as_table().into_iter().flatten() {
                all.push((format!("{table}.{key}"), value.to_string()));
            }
            // It has a default for a simulated robot alone.
            if table == "driver" && self.settings.driver.interface.is_none() {
                all.push(("driver.interface".to_owned(), format!("\"{}\"", self.settings.interface().name())));
            }
        }
        all
    }
}

/// Changes by the command line. They are part of the hash, so processes started differently cannot engage.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Overrides {
    /// `control.engage_without_realtime = true`.
    pub engage_without_realtime: bool,
    /// `driver.interface`, in place of the one in the file.
    pub interface: Option<Interface>,
    /// `robot.file` and `weights.file`, in place of those in the file.
    pub robot: Option<RobotChoice>,
}

impl Overrides {
    /// The changes of a program with `--robot` alone.
    pub fn robot(robot: Option<&RobotChoice>) -> Self {
        Self { robot: robot.cloned(), ..Self::default() }
    }

    /// Applies the changes to the settings of the file `config`.
    pub fn apply(&self, config: &Path, settings: &mut Settings) -> Result<(), ConfigError> {
        settings.control.engage_without_realtime |= self.engage_without_realtime;
        settings.driver.interface = self.interface.or(settings.driver.interface);
        self.robot.as_ref().map_or(Ok(()), |robot| robot.apply(config, settings))
    }

    /// Adds the option to an error of a value that it gave.
    fn named(&self, error: ConfigError) -> ConfigError {
        match (error, self.interface) {
            (ConfigError::Syntax { file, cause }, Some(interface)) if cause.starts_with("driver.interface") => {
                ConfigError::Syntax { file, cause: format!("{cause} (--interface {} sets it)", interface.name()) }
            }
            (error, _) => error,
        }
    }
}

/// Reads the settings file alone, applies the overrides, and checks the result.
pub fn read_settings(config: &Path, overrides: &Overrides) -> Result<Settings, ConfigError> {
    parse_settings(config, overrides).map(|(settings, _)| settings)
}

/// Returns the settings in force, checked, and the text of their file.
fn parse_settings(config: &Path, overrides: &Overrides) -> Result<(Settings, String), ConfigError> {
    let text = read_text(config).map_err(|error| match error {
        ConfigError::Read { file, cause } => {
            let is_default = config == instance::default_config();
            let hint =
                if is_default { "run from the repository's root, or give --config" } else { "--config names it" };
            ConfigError::Read { file, cause: format!("{cause} ({hint})") }
        }
        other => other,
    })?;
    let file = config.display().to_string();
    let mut settings = Settings::parse_unchecked(&file, &text)?;
    overrides.apply(config, &mut settings)?;
    settings.check(&file).map_err(|error| overrides.named(error))?;
    Ok((settings, text))
}

/// Settings with their robot, for programs that need no weights.
struct Placed {
    settings: Settings,
    text: String,
    model: Model,
    files: Vec<PathBuf>,
}

/// Reads and checks the settings file and the robot that it names. Returns the robot among its obstacles.
pub fn load_robot(config: &Path, overrides: &Overrides) -> Result<(Settings, Model), ConfigError> {
    place(config, overrides).map(|Placed { settings, model, .. }| (settings, model))
}

fn place(config: &Path, overrides: &Overrides) -> Result<Placed, ConfigError> {
    let (settings, text) = parse_settings(config, overrides)?;
    let robot_path = config.parent().unwrap_or(Path::new(".")).join(&settings.robot.file);
    let (model, urdf_path) = load_model(&robot_path).map_err(|error| match overrides.robot {
        Some(_) => error,
        None => named(error, &robot_path, config, "robot.file"),
    })?;
    let config_name = config.display().to_string();
    let model = model.with_environment(&config_name, &settings.environment).map_err(ConfigError::robot)?;
    Ok(Placed { settings, text, model, files: vec![config.to_path_buf(), robot_path, urdf_path] })
}

/// Reads and checks the settings file and every file it names.
pub fn load(config: &Path, overrides: Overrides) -> Result<Loaded, ConfigError> {
    let Placed { mut settings, text, model, mut files } = place(config, &overrides)?;
    let folder = config.parent().unwrap_or(Path::new("."));

    let weights_path = folder.join(&settings.weights.file);
    let weights_files = weight_files(&weights_path);
    let weights = if settings.retarget.method == Method::Network || weights_files[0].exists() {
        let read = read_weights(&weights_path, &model);
        match read.map_err(|error| name_weights(error, &weights_files, config, "weights.file")) {
            // A new robot moves before it is trained.
            Err(ConfigError::Weights { .. } | ConfigError::Read { .. })
                if lacks_weights(overrides.robot.as_ref(), &weights_path) =>
            {
                settings.retarget.method = Method::ClosedForm;
                None
            }
            read => Some(read?),
        }
    } else {
        None
    };
    let optional = |name: &str, key: &str| (folder.join(name), key.to_owned(), !name.is_empty());
    let prediction = optional(&settings.retarget.prediction, "retarget.prediction");
    let (prediction, prediction_read) = read_optional(prediction, config, retarget::Prediction::read)?;
    let lifter = optional(&settings.ingest.lifter, "ingest.lifter");
    let (lifter, lifter_read) = read_optional(lifter, config, Lifter::read)?;

    // The obstacles are part of the text.
    let mut hash = fnv(FNV_BASIS, text.as_bytes());
    hash = fnv(hash, &[u8::from(settings.control.engage_without_realtime)]);
    hash = fnv(hash, settings.interface().name().as_bytes());
    hash = fnv(hash, &model.hash.to_le_bytes());
    let mut layouts = Layouts::default();
    for name in &settings.ingest.layouts {
        let path = folder.join(name);
        let text = read_text(&path).map_err(|error| named(error, &path, config, "ingest.layouts"))?;
        let file = path.display().to_string();
        let map = Map::parse(&file, &text)?;
        if map.is_flat() && lifter.is_none() {
            let (key, value) = ("joint".to_owned(), "`point` alone".to_owned());
            let bound = "with `is` and `half_of`, or ingest.lifter must name a network".to_owned();
            return Err(layouts::LayoutError::Value { file, key, value, bound }.into());
        }
        layouts.add(&file, map)?;
        hash = fnv(hash, text.as_bytes());
        files.push(path);
    }
    let operators_dir = folder.join(&settings.ingest.operators);
    let operators = Operators::read(&operators_dir)?;
    // The hash uses the text that was checked, because the file may have changed since.
    let own_right = weights.is_some() && !model.mirrored;
    files.extend(own_right.then(|| weight_files(&right_weights(&weights_path))).into_iter().flatten());
    let weights_read = weights.as_ref().map(|(_, text)| (text.clone(), weights_files));
    for (text, both) in [weights_read, prediction_read, lifter_read].into_iter().flatten() {
        hash = fnv(hash, text.as_bytes());
        files.extend(both);
    }
    let weights = weights.map(|(weights, _)| weights);
    Ok(Loaded { settings, model, weights, prediction, lifter, layouts, operators, operators_dir, hash, files })
}

/// Returns true if a chosen robot has no weights of its own, so that those of the settings were read.
pub fn lacks_weights(robot: Option<&RobotChoice>, read: &Path) -> bool {
    robot.is_some_and(|robot| read.file_name() != Some(robot.name().as_ref()))
}

/// Paths of the manifest and the tensors of `base`.
pub(crate) fn weight_files(base: &Path) -> [PathBuf; 2] {
    // Keeps a dot that belongs to the name, unlike `Path::with_extension`.
    ["toml", "safetensors"].map(|extension| {
        let mut name = base.as_os_str().to_owned();
        name.push(format!(".{extension}"));
        PathBuf::from(name)
    })
}

/// Adds the settings key to the error if either file could not be read. See [`named`].
fn name_weights(error: ConfigError, files: &[PathBuf; 2], config: &Path, key: &str) -> ConfigError {
    files.iter().fold(error, |error, file| named(error, file, config, key))
}

/// Adds the settings key that names `file` to the error if `file` could not be read. A copy of the settings alone
/// finds no files beside itself.
fn named(error: ConfigError, file: &Path, config: &Path, key: &str) -> ConfigError {
    match error {
        ConfigError::Read { file: unread, cause } if Path::new(&unread) == file => {
            let config = config.display();
            let cause = format!("{cause} ({key} in {config} names it; such a path is relative to that file)");
            ConfigError::Read { file: unread, cause }
        }
        other => other,
    }
}

/// Postures in which every process looks for pairs that a robot file wrongly leaves out. The search takes 3 to 44 ms with the
/// shipped robots (measured 2026-11-26, two shared cores).
const POSTURES_TRIED: u64 = 500;

/// Reads a robot file and the URDF it names. Returns the model, without obstacles, and the URDF's path.
pub fn load_model(robot_file: &Path) -> Result<(Model, PathBuf), ConfigError> {
    let toml_text = read_text(robot_file)?;
    let toml_name = robot_file.display().to_string();
    let urdf = robot::urdf_file(&toml_name, &toml_text).map_err(ConfigError::robot)?;
    let urdf_path = robot_file.parent().unwrap_or(Path::new(".")).join(urdf);
    let urdf_text = read_text(&urdf_path).map_err(|error| named(error, &urdf_path, robot_file, "urdf"))?;
    let urdf_name = urdf_path.display().to_string();
    let model = Model::from_text(&toml_name, &toml_text, &urdf_name, &urdf_text).map_err(ConfigError::robot)?;
    model.check_fit().map_err(ConfigError::robot)?;
    model.check_guarded().map_err(ConfigError::robot)?;
    model.check_proved_clear(POSTURES_TRIED).map_err(ConfigError::robot)?;
    Ok((model, urdf_path))
}

/// Reads `<base>.safetensors` and `<base>.toml` and checks them against the robot. Both are copied into memory
/// first. Only the copies are checked and used, so a later change of the files has no effect.
pub fn load_weights(base: &Path, model: &Model) -> Result<retarget::Weights, ConfigError> {
    read_weights(base, model).map(|(weights, _)| weights)
}

fn read_weights(base: &Path, model: &Model) -> Result<(retarget::Weights, String), ConfigError> {
    let read = |base: &Path, side: usize| {
        read_weight_files(base, |manifest, tensors| retarget::Weights::from_bytes(manifest, tensors, model, side))
    };
    let (mut left, text) = read(base, 0)?;
    if model.mirrored {
        return Ok((left, text));
    }
    let own = "the arms do not mirror: `train` writes the right one's weights there";
    let (right, of_right) = read(&right_weights(base), 1).map_err(|error| match error {
        ConfigError::Read { file, cause } => ConfigError::Read { file, cause: format!("{cause} ({own})") },
        other => other,
    })?;
    left.network = left.network.with_right(right.network);
    Ok((left, text + &of_right))
}

/// Path of the weights of a right arm that does not mirror the left one, without extension.
fn right_weights(base: &Path) -> PathBuf {
    let base = base.to_string_lossy();
    PathBuf::from(format!("{}{RIGHT_ARM}", base.strip_suffix(".safetensors").unwrap_or(&base)))
}

/// Text of a manifest, and the two files that were read.
type Checked = Option<(String, [PathBuf; 2])>;

/// Reads the weights at a path that a key of the settings may name.
fn read_optional<T>(
    (path, key, is_named): (PathBuf, String, bool),
    config: &Path,
    read: impl FnOnce(&str, &[u8]) -> Result<T, retarget::WeightsError>,
) -> Result<(Option<T>, Checked), ConfigError> {
    if !is_named {
        return Ok((None, None));
    }
    let files = weight_files(&path);
    let (value, text) = read_weight_files(&path, read).map_err(|error| name_weights(error, &files, config, &key))?;
    Ok((Some(value), Some((text, files))))
}

/// Applies `read` to the manifest and the tensors of `base`.
fn read_weight_files<T>(
    base: &Path,
    read: impl FnOnce(&str, &[u8]) -> Result<T, retarget::WeightsError>,
) -> Result<(T, String), ConfigError> {
    // `base` may be the name of the tensors or the name without extension.
    let stem = base.to_str().and_then(|text| text.strip_suffix(".safetensors"));
    let [manifest_path, tensors_path] = weight_files(stem.map_or(base, Path::new));
    let manifest = read_text(&manifest_path)?;
    let tensors = read_bytes(&tensors_path, WEIGHTS_BYTES_MAX)?;
    let value = read(&manifest, &tensors).map_err(|error| {
        let cause = error.to_string();
        let file = if cause.starts_with("manifest") { manifest_path } else { tensors_path };
        ConfigError::Weights { file: file.display().to_string(), cause }
    })?;
    Ok((value, manifest))
}

/// Reads a text file. It must be a regular file of bounded length, in UTF-8.
pub fn read_text(path: &Path) -> Result<String, ConfigError> {
    String::from_utf8(read_bytes(path, TEXT_BYTES_MAX)?)
        .map_err(|_| ConfigError::Read { file: path.display().to_string(), cause: "is not UTF-8 text".into() })
}

fn read_bytes(path: &Path, most: u64) -> Result<Vec<u8>, ConfigError> {
    let refuse = |cause: String| ConfigError::Read { file: path.display().to_string(), cause };
    let failed = |error: std::io::Error| {
        refuse(match error.kind() {
            ErrorKind::NotFound => "there is no such file; check the path".into(),
            ErrorKind::PermissionDenied => "permission denied; run this as the user who may read it".into(),
            _ => error.to_string(),
        })
    };
    // Checked before opening: opening a pipe would wait for its writer.
    if !std::fs::metadata(path).map_err(failed)?.is_file() {
        return Err(refuse("is not a regular file".into()));
    }
    let file = std::fs::File::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    let mut bytes = Vec::new();
    // The file may grow while it is read: at most one byte beyond the bound is read.
    file.take(most + 1).read_to_end(&mut bytes).map_err(failed)?;
    if length > most || bytes.len() as u64 > most {
        return Err(refuse(format!("has {length} bytes, at most {most} are allowed")));
    }
    Ok(bytes)
}
