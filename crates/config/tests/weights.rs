//! Invalid files that the settings name: weights that change while they are in use, and a prediction that is missing or
//! broken.

use crate::choice::repository;
use config::{Overrides, load, load_weights};

#[test]
fn f095_loaded_weights_stay_unchanged_when_file_changes() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("weights");
    for extension in ["safetensors", "toml"] {
        let from = repository().join("weights/tiago_dual").with_extension(extension);
        std::fs::copy(from, base.with_extension(extension)).expect("copied");
    }
    let model = config::load_model(&repository().join("config/robots/tiago_dual.toml")).expect("shipped").0;
    let weights = load_weights(&base, &model).expect("accepted");
    let latent = [[0.25; retarget::LATENT]];
    let before = weights.network.decode(&latent);

    // Overwritten in place, and then truncated: a memory map of the file would show it, or end the process.
    let tensors = base.with_extension("safetensors");
    let length = std::fs::metadata(&tensors).expect("there").len() as usize;
    std::fs::write(&tensors, vec![0x3f; length]).expect("overwritten");
    assert_eq!(weights.network.decode(&latent), before);
    std::fs::File::options().write(true).open(&tensors).and_then(|file| file.set_len(0)).expect("cut");
    assert_eq!(weights.network.decode(&latent), before);
    // The next start notices it.
    assert!(load_weights(&base, &model).is_err_and(|error| error.to_string().contains("sha256")));
}

#[test]
fn missing_or_broken_prediction_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, base) = (folder.path().join("teleop.toml"), folder.path().join("mine"));
    let loaded = |name: &str| {
        let shipped = std::fs::read_to_string(repository().join("config/teleop.toml")).expect("shipped");
        let absolute = |name: &str| format!("\"{}/", repository().join(name).display());
        let text = shipped
            .replace("\"../weights/prediction\"", &format!("{name:?}"))
            .replace("\"robots/", &absolute("config/robots"))
            .replace("\"../weights/", &absolute("weights"));
        std::fs::write(&path, text).expect("written");
        load(&path, Overrides::default()).map_err(|error| error.to_string())
    };
    // Without a prediction the turn of each limb fades.
    let none = loaded("").expect("loads");
    assert!(none.prediction.is_none());
    let error = loaded("mine").expect_err("there is no such file");
    for part in ["mine.toml", "no such file", "retarget.prediction in ", "teleop.toml"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    for extension in ["safetensors", "toml"] {
        let from = repository().join("weights/prediction").with_extension(extension);
        std::fs::copy(from, base.with_extension(extension)).expect("copied");
    }
    let whole = loaded("mine").expect("loads");
    assert!(whole.prediction.is_some() && whole.files.contains(&base.with_extension("safetensors")));
    assert_ne!(whole.hash, none.hash, "processes with different predictions cannot engage");
    std::fs::write(base.with_extension("safetensors"), b"nothing").expect("overwritten");
    let error = loaded("mine").expect_err("broken");
    assert!(error.contains("mine.safetensors") && error.contains("sha256"), "{error}");
}
