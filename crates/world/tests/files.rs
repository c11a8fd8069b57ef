//! Invalid settings: an unknown, missing or out-of-range key, read or taken by a stage.

use crate::support;
use config::{Loaded, Settings};

/// The shipped settings as a table.
pub fn shipped() -> toml::Table {
    std::fs::read_to_string(support::shipped("teleop.toml")).expect("shipped").parse().expect("TOML")
}

fn refusal(table: &toml::Table) -> String {
    let text = toml::to_string(table).expect("a table is TOML");
    match Settings::parse("teleop.toml", &text) {
        Ok(settings) => thresholds(settings),
        Err(error) => error.to_string(),
    }
}

/// Returns control's error for these settings.
fn thresholds(settings: Settings) -> String {
    let loaded = Loaded { settings, ..support::loaded() };
    let driver = world::driver_config(&loaded, true).map(|_| ());
    let robot = world::robot_config(&loaded).map(|_| ());
    let retarget = world::retarget_config(&loaded).map(|_| ());
    let refused = world::control_config(&loaded, true).map(|_| ()).and(driver).and(robot).and(retarget);
    refused.map_or_else(|error| error.to_string(), |()| "accepted".into())
}

/// All keys of all tables, as (table, key).
fn keys() -> Vec<(String, String)> {
    let all = shipped();
    let keys = all.iter().filter(|(table, _)| *table != "environment");
    keys.flat_map(|(table, keys)| keys.as_table().expect("a table").keys().map(|key| (table.clone(), key.clone())))
        .collect()
}

fn changed(table: &str, key: &str, value: Option<toml::Value>) -> toml::Table {
    let mut all = shipped();
    let inner = all[table].as_table_mut().expect("a table");
    match value {
        Some(value) => _ = inner.insert(key.into(), value),
        None => _ = inner.remove(key),
    }
    all
}

#[test]
fn f097_missing_or_unknown_key_is_refused_by_name() {
    assert_eq!(refusal(&shipped()), "accepted");
    assert!(keys().len() > 40, "{:?}", keys());
    for (table, key) in keys() {
        let missing = refusal(&changed(&table, &key, None));
        assert!(missing.contains("teleop.toml") && missing.contains(&key), "{table}.{key}: {missing}");
        let unknown = refusal(&changed(&table, &format!("{key}_x"), Some(1.into())));
        assert!(unknown.contains(&format!("{key}_x")), "{table}.{key}: {unknown}");
    }
    for table in shipped().keys().filter(|table| *table != "environment") {
        let mut all = shipped();
        all.remove(table);
        assert!(refusal(&all).contains(table.as_str()), "{table}");
    }
    let mut all = shipped();
    all.insert("saftey".into(), toml::Table::new().into());
    assert!(refusal(&all).contains("saftey"));
}

#[test]
fn f097_f098_nan_infinite_negative_or_huge_number_is_refused() {
    let mut numbers = 0;
    for (table, key) in keys() {
        let shipped = &shipped()[&table][&key];
        let values: &[toml::Value] = match shipped {
            toml::Value::Float(_) => &[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 1e300].map(toml::Value::Float),
            toml::Value::Integer(_) if key != "seed" => &[toml::Value::Integer(-1), toml::Value::Integer(1 << 40)],
            _ => continue,
        };
        numbers += 1;
        for value in values {
            let refused = refusal(&changed(&table, &key, Some(value.clone())));
            let is_named = refused.contains(&key) || refused.contains("teleop.toml");
            assert!(is_named, "{table}.{key} = {value}: {refused}");
            assert_ne!(refused, "accepted", "{table}.{key} = {value}");
            assert!(!refused.contains("0000000000000000"), "{table}.{key} = {value}: {refused}");
        }
    }
    assert!(numbers > 25, "{numbers}");
}

#[test]
fn f097_limits_in_wrong_order_are_refused() {
    for (key, value) in [("state_late_ms", 30.0), ("tracking_error_rad", 0.2), ("tracking_error_m", 0.04)] {
        let refusal_text = refusal(&changed("safety", key, Some(value.into())));
        assert!(refusal_text.contains(key) && refusal_text.contains("must be below"), "{key}: {refusal_text}");
    }
}

#[test]
fn robot_with_late_watchdog_is_refused_if_it_plays_its_stop() {
    let late = changed("sim", "watchdog_ms", Some(20.1.into()));
    let refusal_text = refusal(&late);
    assert!(refusal_text.contains("sim.watchdog_ms") && refusal_text.contains("20"), "{refusal_text}");
    let mut held = late;
    held["sim"].as_table_mut().expect("a table").insert("reaction".into(), "hold".into());
    assert_eq!(refusal(&held), "accepted");
}
