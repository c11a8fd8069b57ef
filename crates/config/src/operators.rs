//! Calibrations of operators: one TOML file each, in the folder that the settings name.

use crate::ConfigError;
use crate::load::read_text;
use messages::{HingeCalibration, LIMBS, Layout, calibration_flag};
use serde::{Deserialize, Serialize};
use skeleton::{Calibration, LEAN_MAX_RAD};
use std::path::{Path, PathBuf};

/// Largest number of files that are read. Assumption: more than the people of one laboratory.
const OPERATORS_MAX: usize = 64;
/// Shortest and longest limb, m: a forearm of a person of 1.2 m and an upper arm of one of 2.2 m, with the margins
/// of `skeleton`.
const LENGTH_M: [f64; 2] = [0.1, 0.6];
/// Largest deviation of a hinge's length from 1, as in frames.
const UNIT_ERROR_MAX: f64 = 1e-3;
/// Largest number of a client's person or a layout.
const NUMBER_MAX: f64 = u32::MAX as f64;

/// An operator's calibration for one layout.
#[derive(Clone, Debug, PartialEq)]
pub struct Operator {
    /// The operator's name. Their file is written under it.
    pub name: String,
    /// Number of the person, as the client counts them.
    pub operator_id: u32,
    /// Number of the layout that the client sends.
    pub layout: u32,
    /// Calibration.
    pub calibration: Calibration,
}

/// All known operators, each with the name of its file without the extension.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Operators(Vec<(String, Operator)>);

#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct PerLimb<T> {
    left_upper: T,
    left_fore: T,
    right_upper: T,
    right_fore: T,
}

impl<T: Copy> PerLimb<T> {
    fn from_limbs([left_upper, left_fore, right_upper, right_fore]: [T; LIMBS]) -> Self {
        Self { left_upper, left_fore, right_upper, right_fore }
    }

    fn all(self) -> [(&'static str, T); LIMBS] {
        let Self { left_upper, left_fore, right_upper, right_fore } = self;
        [("left_upper", left_upper), ("left_fore", left_fore), ("right_upper", right_upper), ("right_fore", right_fore)]
    }
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: String,
    operator_id: u32,
    layout: u32,
    torso_lean_deg: f64,
    lengths_m: PerLimb<f64>,
    /// Absent where the layout has no rotations.
    #[serde(skip_serializing_if = "Option::is_none")]
    samples: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    hinges: Option<PerLimb<[f64; 3]>>,
}

impl Operators {
    /// Reads every `*.toml` of a folder, in the order of their names. A missing folder holds no operators. Two files of the
    /// same operator and layout are refused.
    pub fn read(folder: &Path) -> Result<Self, ConfigError> {
        let failed = |error: std::io::Error| ConfigError::Read {
            file: folder.display().to_string(),
            cause: format!("{error} (ingest.operators)"),
        };
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(failed(error)),
        };
        let mut paths = Vec::new();
        for entry in entries {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_some_and(|extension| extension == "toml") {
                paths.push(path);
            }
        }
        paths.sort();
        if paths.len() > OPERATORS_MAX {
            let (file, value) = (folder.display().to_string(), paths.len());
            return Err(ConfigError::TooMany { file, key: "ingest.operators", value, most: OPERATORS_MAX });
        }
        let mut all = Self::default();
        for path in paths {
            let file = path.display().to_string();
            let operator = parse(&file, &read_text(&path)?)?;
            if let Some((_, other)) = all.0.iter().find(|(_, other)| other.key() == operator.key()) {
                let (id, layout) = operator.key();
                let cause = format!(
                    "operator_id {id} with layout {layout} is also that of {:?}; remove one of the files",
                    other.name
                );
                return Err(ConfigError::Syntax { file, cause });
            }
            all.0.push((path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), operator));
        }
        Ok(all)
    }

    /// Returns the reason for which this person in this layout cannot have the file `name`. Either the folder
    /// could no longer be read with it, or the file belongs to another operator.
    pub fn refuses(&self, name: &str, operator_id: u32, layout: u32) -> Option<String> {
        let key = (operator_id, layout);
        for (file, operator) in &self.0 {
            let (id, of) = operator.key();
            match (file == name, operator.key() == key) {
                (true, true) => return None,
                (true, false) => {
                    return Some(format!(
                        "{file}.toml belongs to operator_id {id} with layout {of}, but the client sends operator_id \
                         {operator_id} with layout {layout}. Give another name, or remove that file"
                    ));
                }
                (false, true) => {
                    return Some(format!(
                        "operator_id {id} with layout {of} belongs to {file}.toml already. Let the client send another \
                         operator_id for another person, or calibrate {file} again, or remove that file"
                    ));
                }
                (false, false) => {}
            }
        }
        (self.0.len() >= OPERATORS_MAX)
            .then(|| format!("there are {OPERATORS_MAX} files, the most that are read; remove one"))
    }

    /// Returns the calibrations, by the client's numbers of the person and the layout.
    pub fn calibrations(&self) -> Vec<((u32, u32), Calibration)> {
        self.0.iter().map(|(_, operator)| (operator.key(), operator.calibration)).collect()
    }
}

impl Operator {
    fn key(&self) -> (u32, u32) {
        (self.operator_id, self.layout)
    }

    /// Returns true if `name` is allowed for an operator: letters, digits, `-` and `_`, at most 32 of them.
    pub fn may_be_called(name: &str) -> bool {
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        (1..=32).contains(&name.len()) && name.chars().all(allowed)
    }

    /// Writes `<folder>/<name>.toml` and returns its path. Creates the folder and replaces a file of that name.
    pub fn write(&self, folder: &Path) -> std::io::Result<PathBuf> {
        std::fs::create_dir_all(folder)?;
        let path = folder.join(format!("{}.toml", self.name));
        instance::write_anew(&path, self.to_toml().as_bytes())?;
        Ok(path)
    }

    fn to_toml(&self) -> String {
        let Calibration { hinges, lengths_m, torso_lean_rad } = self.calibration;
        let known = hinges.flags == calibration_flag::ALL;
        let rounded = |x: f64, digits: f64| (x * digits).round() / digits;
        let axes: [_; LIMBS] = std::array::from_fn(|limb| hinges.hinge[limb].map(|x| rounded(f64::from(x), 1e6)));
        let file = File {
            name: self.name.clone(),
            operator_id: self.operator_id,
            layout: self.layout,
            torso_lean_deg: rounded(torso_lean_rad.to_degrees(), 1e2),
            lengths_m: PerLimb::from_limbs(lengths_m.map(|length| rounded(length, 1e4))),
            samples: known.then_some(hinges.samples),
            hinges: known.then(|| PerLimb::from_limbs(axes)),
        };
        let text = toml::to_string(&file).unwrap_or_default();
        format!(
            "# One operator in one layout of skeletons, as `teleopctl calibrate` measured them. Lengths of the limbs; \
             how far the\n\
             # trunk leans back in a T-pose; axes of the elbows in the frames of the joints that carry them.\n{text}"
        )
    }
}

fn parse(file: &str, text: &str) -> Result<Operator, ConfigError> {
    let read: File = toml::from_str(text).map_err(|error| ConfigError::Syntax {
        file: file.to_owned(),
        cause: error.to_string().trim_end().to_owned(),
    })?;
    let within = |key: &str, value: f64, low: f64, high: f64| {
        // Written so that NaN is refused too.
        let refused = ConfigError::Bound { file: file.to_owned(), key: key.to_owned(), value, low, high };
        if value >= low && value <= high { Ok(value) } else { Err(refused) }
    };
    if !Operator::may_be_called(&read.name) {
        let cause = format!("name = {:?} must be 1 to 32 letters, digits, - or _", read.name);
        return Err(ConfigError::Syntax { file: file.to_owned(), cause });
    }
    let lean_max_deg = LEAN_MAX_RAD.to_degrees();
    let torso_lean_deg = within("torso_lean_deg", read.torso_lean_deg, -lean_max_deg, lean_max_deg)?;
    within("layout", f64::from(read.layout), 1.0, NUMBER_MAX)?;
    let mut calibration = Calibration { torso_lean_rad: torso_lean_deg.to_radians(), ..Calibration::NONE };
    for (limb, (name, length)) in read.lengths_m.all().into_iter().enumerate() {
        calibration.lengths_m[limb] = within(&format!("lengths_m.{name}"), length, LENGTH_M[0], LENGTH_M[1])?;
    }
    if let Some(hinges) = read.hinges {
        let mut measured = HingeCalibration { samples: read.samples.unwrap_or_default(), ..HingeCalibration::ZERO };
        for (limb, (name, axis)) in hinges.all().into_iter().enumerate() {
            let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
            within(&format!("|hinges.{name}|"), length, 1.0 - UNIT_ERROR_MAX, 1.0 + UNIT_ERROR_MAX)?;
            measured.hinge[limb] = axis.map(|x| (x / length) as f32);
            measured.flags |= calibration_flag::LIMB[limb];
        }
        calibration.hinges = measured;
    }
    Ok(Operator { name: read.name, operator_id: read.operator_id, layout: read.layout, calibration })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn anna() -> Operator {
        let mut hinges = HingeCalibration { flags: calibration_flag::ALL, samples: 120, ..HingeCalibration::ZERO };
        hinges.hinge = [[0.0, 0.6, 0.8], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let calibration = Calibration { hinges, lengths_m: [0.31, 0.25, 0.3, 0.26], torso_lean_rad: 0.06 };
        Operator { name: "anna".into(), operator_id: 3, layout: 1, calibration }
    }

    #[test]
    fn operator_is_read_as_written_and_found_by_person_and_layout() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("operators");
        assert_eq!(Operators::read(&place).unwrap(), Operators::default(), "no folder, nobody");
        let path = anna().write(&place).unwrap();
        assert_eq!(path, place.join("anna.toml"));
        let mut camera = anna();
        (camera.name, camera.layout, camera.calibration.hinges) = ("anna-camera".into(), 4, HingeCalibration::ZERO);
        camera.write(&place).unwrap();
        std::fs::write(place.join("notes.txt"), "no operator").unwrap();
        let all = Operators::read(&place).unwrap();
        assert_eq!(all.0.iter().map(|(file, _)| file).collect::<Vec<_>>(), ["anna-camera", "anna"]);
        let find = |person: u32, layout: u32| {
            all.calibrations().into_iter().find(|(of, _)| *of == (person, layout)).map(|(_, calibration)| calibration)
        };
        let found = find(3, 1).unwrap();
        assert_eq!((found.lengths_m, found.hinges.flags, found.hinges.samples), ([0.31, 0.25, 0.3, 0.26], 15, 120));
        assert!((found.torso_lean_rad - 0.06).abs() < 1e-4);
        for (read, written) in found.hinges.hinge.iter().flatten().zip(anna().calibration.hinges.hinge.as_flattened()) {
            assert!((read - written).abs() < 1e-6);
        }
        assert_eq!(find(3, 4).unwrap().hinges.flags, 0);
        assert_eq!((find(3, 2), find(4, 1)), (None, None));
        let twin_of = "operator_id 3 with layout 1 belongs to anna.toml already";
        let of_another =
            "anna.toml belongs to operator_id 3 with layout 1, but the client sends operator_id 4 with layout 1";
        for (name, person, layout, why) in [
            ("anna", 3, 1, None),
            ("bert", 4, 1, None),
            ("bert", 3, 1, Some(twin_of)),
            ("anna", 4, 1, Some(of_another)),
        ] {
            let refusal = all.refuses(name, person, layout);
            assert_eq!(refusal.is_some(), why.is_some(), "{name}: {refusal:?}");
            assert!(refusal.is_none_or(|refusal| refusal.contains(why.unwrap_or_default())), "{name}");
        }
        // The file's name counts, not the name inside it.
        std::fs::rename(place.join("anna.toml"), place.join("old.toml")).unwrap();
        let renamed = Operators::read(&place).unwrap();
        assert!(renamed.refuses("anna", 3, 1).is_some_and(|why| why.contains("old.toml")));
        std::fs::rename(place.join("old.toml"), place.join("anna.toml")).unwrap();
        let full = Operators(
            (0..OPERATORS_MAX).map(|n| (format!("{n}"), Operator { operator_id: 100 + n as u32, ..anna() })).collect(),
        );
        assert!(full.refuses("anna", 3, 1).is_some_and(|why| why.contains("64 files")));
        assert_eq!(full.refuses("7", 107, 1), None);
        let mut other = anna();
        other.name = "bert".into();
        other.write(&place).unwrap();
        let error = Operators::read(&place).unwrap_err().to_string();
        assert!(error.contains("bert.toml") && error.contains("\"anna\""), "{error}");
    }

    #[test]
    fn invalid_operator_file_is_refused_with_key_value_and_bound() {
        let good = anna().to_toml();
        parse("a.toml", &good).unwrap();
        for (from, to, text) in [
            ("left_upper = 0.31", "left_upper = 31.0", "a.toml: lengths_m.left_upper = 31 is outside [0.1, 0.6]"),
            ("left_upper = 0.31", "left_upper = nan", "lengths_m.left_upper = NaN"),
            ("torso_lean_deg = 3.44", "torso_lean_deg = 90.0", "torso_lean_deg = 90 is outside"),
            ("[0.0, 0.0, -1.0]", "[0.0, 0.0, 0.0]", "|hinges.left_fore| = 0 is outside"),
            ("name = \"anna\"", "name = \"../anna\"", "must be 1 to 32 letters"),
            ("layout = 1", "layout = 0", "layout = 0 is outside"),
            ("samples = 120", "sample = 120", "unknown field"),
        ] {
            let bad = good.replace(from, to);
            assert_ne!(bad, good, "{from}");
            let error = parse("a.toml", &bad).unwrap_err().to_string();
            assert!(error.starts_with("a.toml: ") && error.contains(text), "{to}: {error}");
        }
    }
}
