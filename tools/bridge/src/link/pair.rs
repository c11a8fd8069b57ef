//! Makes the certificates of a link. All of it happens at the robot: its authority signs the certificates of its operators.

use super::keys::{Keys, Name};
use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};
use rt::{Exit, Failure, out};
use std::fs::{DirBuilder, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::Path;

/// File with the robot's certificate, its key and its authority.
pub(super) const ROBOT: &str = "robot.pem";
/// File with the authority's key. It never leaves the robot.
const AUTHORITY_KEY: &str = "authority-key.pem";
/// Folder with one certificate for each operator. A file that is removed removes the operator.
pub(super) const OPERATORS: &str = "operators";

/// File that admits a router at the robot. A router whose file is removed is removed.
pub(super) const ROUTER: &str = "router.pem";
const ROUTER_NAME: &str = "router";
/// Beginning of the line with the router's common name, in an operator's bundle.
pub(super) const BY_ROUTER: &str = "by router:";
/// Line of a router's bundle.
pub(super) const IS_ROUTER: &str = "router: yes";

/// Beginning of the line with a certificate's common name, in an operator's file.
pub(super) const COMMON_NAME: &str = "common name:";

pub fn pair_robot(name: &Name, keys: &Path) -> Result<(), Failure> {
    if name.as_str() == ROUTER_NAME {
        return Err(Failure::new(Exit::Usage, format!("{name}: a router has this name. Give the robot another one")));
    }
    let failed = Failure::with(Exit::Software);
    DirBuilder::new().recursive(true).mode(0o700).create(keys).map_err(|error| unwritable(keys, &error))?;
    let key = KeyPair::generate().map_err(&failed)?;
    let authority = authority_of(name).self_signed(&key).map_err(&failed)?.pem();
    write_new(&keys.join(AUTHORITY_KEY), &key.serialize_pem())?;
    let issuer = Issuer::new(authority_of(name), key);
    // At a router the robot is a client, too.
    let purposes = vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
    let (certificate, own_key) = sign(name.as_str(), purposes, &issuer)?;
    write_new(&keys.join(ROBOT), &format!("robot: {name}\n{certificate}{own_key}{authority}"))?;
    out!("bridge: {} holds the keys of robot {name}, code {}", keys.display(), Keys::read_robot(keys)?.code());
    out!("bridge: next: teleop-bridge link pair operator --name NAME --keys {}", keys.display());
    Ok(())
}

pub fn pair_operator(name: &Name, keys: &Path) -> Result<(), Failure> {
    let robot = Keys::read_robot(keys)?;
    if *name == robot.robot || name.as_str() == ROUTER_NAME {
        let text = format!("{name}: the robot or its router has this name. Give the operator another one");
        return Err(Failure::new(Exit::Usage, text));
    }
    let operators = keys.join(OPERATORS);
    DirBuilder::new().recursive(true).mode(0o700).create(&operators).map_err(|error| unwritable(&operators, &error))?;
    let bundle = keys.join(format!("{name}.bundle"));
    // No server: an operator cannot present itself as the robot.
    let purposes = vec![ExtendedKeyUsagePurpose::ClientAuth];
    let admits = operators.join(format!("{name}.pem"));
    let router = robot.router.as_ref().map_or(String::new(), |router| format!("\n{BY_ROUTER} {router}"));
    admit(keys, &robot, name.as_str(), purposes, &format!("operator: {name}{router}"), &bundle, &admits)?;
    let code = Keys::read_operator(&bundle)?.code();
    out!("bridge: copy {} to the operator's machine, with scp, and remove it here", bundle.display());
    out!("bridge: code {code}; teleop-bridge link pair show must print the same there");
    out!("bridge: a robot end that runs admits {name} after its next start");
    Ok(())
}

pub fn pair_router(keys: &Path) -> Result<(), Failure> {
    let robot = Keys::read_robot(keys)?;
    let bundle = keys.join(format!("{ROUTER_NAME}.bundle"));
    // A server for operators and robot.
    let purposes = vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
    admit(keys, &robot, ROUTER_NAME, purposes, IS_ROUTER, &bundle, &keys.join(ROUTER))?;
    out!("bridge: copy {} to the router's machine, with scp, and remove it here", bundle.display());
    out!("bridge: copy the folder {} beside it; replace it and restart after a change", keys.join(OPERATORS).display());
    out!("bridge: a robot end that runs admits the router after its next start");
    Ok(())
}

/// Signs a certificate with a name of its own. Writes the secret bundle, and the file that admits it at the robot.
fn admit(
    keys: &Path,
    robot: &Keys,
    name: &str,
    purposes: Vec<ExtendedKeyUsagePurpose>,
    role: &str,
    bundle: &Path,
    admits: &Path,
) -> Result<(), Failure> {
    let path = keys.join(AUTHORITY_KEY);
    let key =
        std::fs::read_to_string(&path).map_err(|error| Failure::new(Exit::NoInput, rt::unreadable(&path, &error)))?;
    let key =
        KeyPair::from_pem(&key).map_err(|error| Failure::new(Exit::DataErr, format!("{}: {error}", path.display())))?;
    let issuer = Issuer::new(authority_of(&robot.robot), key);
    // A number of its own, so that one who was removed does not come back with the next one of this name.
    let common_name = format!("{name}.{:016x}", doors::draw_nonce());
    let (certificate, own_key) = sign(&common_name, purposes, &issuer)?;
    let text = format!("robot: {}\n{role}\n{certificate}{own_key}{}\n", robot.robot, robot.authority);
    // The bundle first: where an old one lies, nobody is admitted by it.
    write_new(bundle, &text)?;
    write_new(admits, &format!("{COMMON_NAME} {common_name}\n{certificate}"))
}

pub fn show(bundle: &Path) -> Result<(), Failure> {
    let keys = Keys::read_operator(bundle)?;
    let operator = keys.operator.as_ref().map(Name::as_str).unwrap_or_default();
    out!("bridge: operator {operator} of robot {}, code {}", keys.robot, keys.code());
    Ok(())
}

fn named(name: &str) -> CertificateParams {
    let mut params = CertificateParams::default();
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, name);
    params
}

fn authority_of(robot: &Name) -> CertificateParams {
    let mut params = named(&format!("{robot} authority"));
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
    params
}

/// Returns a certificate and its key, PEM.
fn sign(
    common_name: &str,
    purposes: Vec<ExtendedKeyUsagePurpose>,
    issuer: &Issuer<'_, KeyPair>,
) -> Result<(String, String), Failure> {
    let failed = Failure::with(Exit::Software);
    let key = KeyPair::generate().map_err(&failed)?;
    let mut params = named(common_name);
    params.extended_key_usages = purposes;
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    let certificate = params.signed_by(&key, issuer).map_err(&failed)?;
    Ok((certificate.pem(), key.serialize_pem()))
}

/// Writes a file that only its owner may read. An existing one is never replaced.
fn write_new(path: &Path, text: &str) -> Result<(), Failure> {
    let file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path);
    let written = file.and_then(|mut file| file.write_all(text.as_bytes()).and_then(|()| file.sync_all()));
    written.map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => {
            let text = format!(
                "{}: exists. Keys are never replaced. Give another --keys for another robot. To pair an operator again, \
                 remove the .bundle and the .pem of that name. Without the authority's key, nobody can be added",
                path.display()
            );
            Failure::new(Exit::CantCreate, text)
        }
        _ => unwritable(path, &error),
    })
}

fn unwritable(path: &Path, error: &std::io::Error) -> Failure {
    Failure::new(Exit::CantCreate, rt::unwritable(path, error))
}
