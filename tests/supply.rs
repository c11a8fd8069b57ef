//! Tests the dependencies of the product: locked, from one registry, under permissive licences, and without
//! network code. The rules are those of `deny.toml`, but need neither `cargo-deny` nor a network.

use crate::sources::{cargo, metadata, root};
use serde_json::Value;
use spdx::{Expression, ParseMode};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

const REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";

fn toml_file(name: &str) -> toml::Table {
    let text = std::fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    text.parse().unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or("")
}

/// Returns the strings of an array.
fn strings(value: &toml::Value) -> BTreeSet<String> {
    value.as_array().expect("an array").iter().map(|item| item.as_str().expect("a string").to_owned()).collect()
}

/// Returns true if these licences satisfy an SPDX expression. A bare `/` is an old form of `OR`.
fn admits(expression: &str, allowed: &BTreeSet<String>) -> bool {
    let read = Expression::parse_mode(expression, ParseMode::LAX);
    read.is_ok_and(|read| read.evaluate(|licence| allowed.contains(&licence.to_string())))
}

#[test]
fn f113_every_dependency_is_locked_by_hash_from_one_registry() {
    for name in ["Cargo.lock", "tests/fuzz/libfuzzer/Cargo.lock", "tests/models/Cargo.lock"] {
        let lock = toml_file(name);
        let packages = lock["package"].as_array().expect("packages");
        assert!(packages.len() > 10, "{name}: {} packages", packages.len());
        for package in packages {
            let Some(source) = package.get("source") else { continue };
            let package_name = &package["name"];
            assert_eq!(source.as_str(), Some(REGISTRY), "{name}: {package_name}");
            let hash = package.get("checksum").and_then(toml::Value::as_str).unwrap_or("");
            assert!(hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit()), "{name}: {package_name}: {hash}");
        }
    }
}

#[test]
fn f113_package_without_a_registry_is_a_workspace_member() {
    let metadata = metadata();
    let members = metadata["workspace_members"].as_array().expect("members");
    for package in metadata["packages"].as_array().expect("packages") {
        let local = package["source"].is_null();
        assert_eq!(local, members.contains(&package["id"]), "{}", text(package, "name"));
        let folder = Path::new(text(package, "manifest_path"));
        assert!(!local || folder.starts_with(root()), "{}", folder.display());
    }
}

#[test]
fn toolchain_of_rustup_is_the_oldest_supported_rust() {
    let manifest = toml_file("Cargo.toml");
    let oldest = manifest["workspace"]["package"]["rust-version"].as_str().expect("a version");
    let toolchain = toml_file("rust-toolchain.toml");
    let installed = toolchain["toolchain"]["channel"].as_str().expect("a version");
    assert!(installed.starts_with(&format!("{oldest}.")), "rust-toolchain.toml: {installed}, Cargo.toml: {oldest}");
    let readme = std::fs::read_to_string(root().join("README.md")).expect("README.md");
    assert!(readme.contains(&format!("Rust {oldest} ")), "README.md names another version than {oldest}");
    for package in metadata()["packages"].as_array().expect("packages").iter().filter(|p| p["source"].is_null()) {
        assert_eq!(text(package, "rust_version"), oldest, "{}", text(package, "name"));
    }
}

/// Every package says in a line what it is for.
#[test]
fn every_package_has_a_description() {
    for package in metadata()["packages"].as_array().expect("packages").iter().filter(|p| p["source"].is_null()) {
        let description = text(package, "description");
        assert!(description.len() > 10, "{}: {description:?}", text(package, "name"));
    }
}

/// An exception names one crate and its whole licence. One that is not needed fails too.
#[test]
fn f113_every_licence_is_on_the_permissive_list_or_a_named_exception() {
    let deny = toml_file("deny.toml");
    let licenses = &deny["licenses"];
    let allowed = strings(&licenses["allow"]);
    let mut exceptions: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for exception in licenses["exceptions"].as_array().expect("exceptions") {
        exceptions.insert(exception["crate"].as_str().expect("a name"), strings(&exception["allow"]));
    }
    for package in metadata()["packages"].as_array().expect("packages") {
        let (name, licence) = (text(package, "name"), text(package, "license"));
        if !admits(licence, &allowed) {
            let excepted = exceptions.remove(name).is_some_and(|own| admits(licence, &own));
            assert!(excepted, "{name}: \"{licence}\" cannot be met with deny.toml's list");
        }
    }
    assert!(exceptions.is_empty(), "deny.toml excepts without need: {exceptions:?}");
}

#[test]
fn f113_banned_crates_are_not_built() {
    let deny = toml_file("deny.toml");
    let banned: BTreeSet<&str> = deny["bans"]["deny"]
        .as_array()
        .expect("bans")
        .iter()
        .map(|ban| ban["crate"].as_str().expect("a name"))
        .collect();
    assert!(banned.len() >= 5, "{banned:?}");
    for package in metadata()["packages"].as_array().expect("packages") {
        let name = text(package, "name");
        assert!(!banned.contains(name), "{name} is banned by deny.toml");
    }
}

/// Returns the crates that these packages are built from, each with its features.
fn built_with(packages: &[&str]) -> BTreeSet<String> {
    let args = ["tree", "--edges", "normal,build", "--prefix", "none", "--format", "{p} {f}"];
    let lines = cargo(&[&args, packages].concat());
    lines.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
}

/// A program of two dependencies. It is built in seconds, so that it names no features for others.
pub const SMALL: &str = "hazards";

/// Otherwise cargo builds them again for that program, see crates/features.
#[test]
fn every_program_is_built_with_the_features_of_the_workspace() {
    let whole = built_with(&["--workspace"]);
    assert!(whole.len() > 200, "{}", whole.len());
    let packages = metadata()["packages"].as_array().expect("packages").clone();
    let programs = packages.iter().filter(|package| {
        let bin = |target: &Value| target["kind"] == serde_json::json!(["bin"]);
        package["source"].is_null()
            && package["name"] != SMALL
            && package["targets"].as_array().is_some_and(|targets| targets.iter().any(bin))
    });
    let mut seen = 0;
    for program in programs {
        seen += 1;
        let name = text(program, "name");
        let own = built_with(&["--package", name]);
        let others: Vec<_> = own.difference(&whole).collect();
        assert!(others.is_empty(), "{name} needs other features, name them in crates/features: {others:#?}");
    }
    assert!(seen > 10, "{seen}");
}
