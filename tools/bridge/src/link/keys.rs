//! Files with certificates and keys. Each begins with lines that name the robot and, for an operator, the operator.

use rt::{Exit, Failure};
use sha2::{Digest, Sha256};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::str::FromStr;

/// Longest name: bytes.
const NAME_BYTES_MAX: usize = 32;
/// Longest file: three blocks of less than 1 KiB.
const FILE_BYTES_MAX: u64 = 1 << 16;
const CERTIFICATE: &str = "CERTIFICATE";
const PRIVATE_KEY: &str = "PRIVATE KEY";

/// Name of a robot or of an operator: part of the keys on the wire, of a certificate and of file names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name(String);

impl Name {
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for Name {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_';
        if (1..=NAME_BYTES_MAX).contains(&text.len()) && text.chars().all(known) {
            Ok(Self(text.to_owned()))
        } else {
            Err(format!("a name has 1 to {NAME_BYTES_MAX} characters of a-z, 0-9, - and _"))
        }
    }
}

impl std::fmt::Display for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

#[derive(Clone)]
pub struct Keys {
    pub robot: Name,
    /// The operator whose end it is. `None` for the robot's.
    pub operator: Option<Name>,
    /// The operators whom the robot's end admits, and the common names of their certificates. Empty for an operator's.
    pub operators: Vec<(Name, String)>,
    /// Common name of the router's certificate, where the robot's end or an operator's admits one.
    pub router: Option<String>,
    pub certificate: String,
    pub key: String,
    pub authority: String,
}

impl Keys {
    /// Reads the robot's keys from the folder that `teleop-bridge link pair` fills.
    pub fn read_robot(folder: &Path) -> Result<Self, Failure> {
        let file = folder.join(super::pair::ROBOT);
        if !file.exists() {
            let text = format!(
                "{}: no keys of a robot. Run teleop-bridge link pair robot --name NAME first",
                folder.display()
            );
            return Err(Failure::new(Exit::NoInput, text));
        }
        let own = Self::parse(&file, &read_secret(&file)?, operators(&folder.join(super::pair::OPERATORS))?)?;
        let router = folder.join(super::pair::ROUTER);
        let router = router.exists().then(|| common_name(&router, "router")).transpose()?;
        Ok(Self { router, ..own })
    }

    pub fn read_operator(bundle: &Path) -> Result<Self, Failure> {
        let keys = Self::parse(bundle, &read_secret(bundle)?, Vec::new())?;
        if keys.operator.is_none() {
            let text = "has no line \"operator: NAME\". Give the bundle that teleop-bridge link pair operator made";
            return Err(wrong(bundle, text));
        }
        Ok(keys)
    }

    /// Reads a router's bundle, and the folder with the certificates of the operators whom it admits.
    pub fn read_router(bundle: &Path, listed: &Path) -> Result<Self, Failure> {
        let text = read_secret(bundle)?;
        if !text.contains(super::pair::IS_ROUTER) {
            return Err(wrong(bundle, "is no router's bundle. Give the one that teleop-bridge link pair router made"));
        }
        Self::parse(bundle, &text, operators(listed)?)
    }

    fn parse(path: &Path, text: &str, operators: Vec<(Name, String)>) -> Result<Self, Failure> {
        let value = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)).map(str::trim);
        let named = |key: &str| -> Result<Option<Name>, Failure> {
            value(key).map(|name| name.parse().map_err(|error| wrong(path, format!("{key} {error}")))).transpose()
        };
        let missing = |what: &str| wrong(path, format!("has no {what}"));
        let (certificates, keys) = (blocks(text, CERTIFICATE), blocks(text, PRIVATE_KEY));
        let [certificate, authority] = certificates[..] else { return Err(missing("two certificates")) };
        let [key] = keys[..] else { return Err(missing("private key")) };
        Ok(Self {
            robot: named("robot:")?.ok_or_else(|| missing("line \"robot: NAME\""))?,
            operator: named("operator:")?,
            operators,
            router: value(super::pair::BY_ROUTER).map(str::to_owned),
            certificate: certificate.to_owned(),
            key: key.to_owned(),
            authority: authority.to_owned(),
        })
    }

    /// Returns a short code of both certificates, to compare by eye: the first 8 bytes of their SHA-256.
    pub fn code(&self) -> String {
        let hash = Sha256::new().chain_update(&self.certificate).chain_update(&self.authority).finalize();
        let pairs: Vec<_> = hash.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        pairs.chunks(2).map(|two| two.concat()).collect::<Vec<_>>().join("-")
    }
}

fn operators(listed: &Path) -> Result<Vec<(Name, String)>, Failure> {
    let mut operators = Vec::new();
    for entry in std::fs::read_dir(listed).into_iter().flatten().flatten() {
        let file = entry.file_name();
        let name = file.to_string_lossy().strip_suffix(".pem").and_then(|name| name.parse::<Name>().ok());
        let Some(name) = name else { continue };
        let common_name = common_name(&entry.path(), name.as_str())?;
        operators.push((name, common_name));
    }
    operators.sort_by(|(a, _): &(Name, String), (b, _)| a.0.cmp(&b.0));
    Ok(operators)
}

/// Returns the common name in a file that admits the holder of a certificate.
fn common_name(path: &Path, name: &str) -> Result<String, Failure> {
    let unreadable = |error| Failure::new(Exit::NoInput, rt::unreadable(path, &error));
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    let common_name = text.lines().find_map(|line| line.strip_prefix(super::pair::COMMON_NAME));
    let is_own = |common: &&str| {
        let number = common.strip_prefix(name).and_then(|rest| rest.strip_prefix('.'));
        number.is_some_and(|number| number.len() == 16 && number.chars().all(|c| c.is_ascii_hexdigit()))
    };
    let common_name = common_name.map(str::trim).filter(is_own);
    common_name.map(str::to_owned).ok_or_else(|| wrong(path, "has no line \"common name: NAME.NUMBER\""))
}

fn blocks<'a>(text: &'a str, label: &str) -> Vec<&'a str> {
    let (begin, end) = (format!("-----BEGIN {label}-----"), format!("-----END {label}-----"));
    let starts = text.match_indices(&begin).map(|(at, _)| at);
    starts.filter_map(|at| text[at..].find(&end).map(|length| &text[at..at + length + end.len()])).collect()
}

/// Reads a file that only its owner may read.
fn read_secret(path: &Path) -> Result<String, Failure> {
    let unreadable = |error| Failure::new(Exit::NoInput, rt::unreadable(path, &error));
    let about = std::fs::metadata(path).map_err(unreadable)?;
    if about.len() > FILE_BYTES_MAX {
        return Err(wrong(path, format!("has {} bytes; keys have at most {FILE_BYTES_MAX}", about.len())));
    }
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    if about.mode() & 0o077 != 0 && text.contains(PRIVATE_KEY) {
        let text =
            format!("holds a key that others may read (mode {:04o}). Run chmod 600 on it", about.mode() & 0o7777);
        return Err(wrong(path, text));
    }
    Ok(text)
}

fn wrong(path: &Path, text: impl std::fmt::Display) -> Failure {
    Failure::new(Exit::DataErr, format!("{}: {text}", path.display()))
}
