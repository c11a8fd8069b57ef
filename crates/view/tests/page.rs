//! The page's files.

use sha2::{Digest, Sha256};
use view::{ASSETS, BODIES, FIELDS, LENGTH, POSE, VERSION};

fn text(path: &str) -> &'static str {
    let asset = ASSETS.iter().find(|asset| asset.path == path).expect("a file of the page");
    std::str::from_utf8(asset.bytes).expect("text")
}

#[test]
fn everything_that_the_page_names_is_served_and_nothing_comes_from_elsewhere() {
    for asset in ASSETS.iter().filter(|asset| !asset.path.contains("three")) {
        let text = text(asset.path);
        for elsewhere in ["http://", "https://", "\"//", "'//"] {
            assert!(!text.contains(elsewhere), "{}: {elsewhere}", asset.path);
        }
        let names = text.split(['"', '\'', '`']).filter(|word| word.ends_with(".js") || word.ends_with(".css"));
        for name in names {
            let path = format!("/{}", name.trim_start_matches("./"));
            assert!(ASSETS.iter().any(|asset| asset.path == path), "{} names {name}", asset.path);
        }
    }
    assert!(text("/").contains("page.js") && text("/page.js").contains("./wire.js"));
}

/// Hashes of build/three.module.min.js and build/three.core.min.js of the package three 0.185.0 on npm.
#[test]
fn three_is_as_published() {
    for (path, hash) in [
        ("/three.module.min.js", "86bcee248b64f44bcfc23c331ae74619061957d59cab040171dcb6fb5900beb6"),
        ("/three.core.min.js", "0e9dd2793e01d0d9eb4f2ab00b4ffcdd4488275ebebee5c31fa8d347bc29f0bf"),
    ] {
        let found: String = Sha256::digest(text(path)).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(found, hash, "{path}");
    }
}

#[test]
fn the_page_reads_frames_as_they_are_written() {
    let wire = text("/wire.js");
    let number = |name: &str| -> usize {
        let (_, after) = wire.split_once(&format!("{name} = ")).unwrap_or_else(|| panic!("no {name}"));
        after.split(|c: char| !c.is_ascii_digit()).next().and_then(|digits| digits.parse().ok()).expect("a number")
    };
    let fields = wire.split_once("FIELDS = [").and_then(|(_, after)| after.split_once(']')).expect("fields").0;
    assert_eq!(fields.split(',').count(), FIELDS);
    let (person, bodies, pose, joints) = (number("PERSON"), number("BODIES"), number("POSE"), number("JOINTS"));
    assert_eq!((bodies, pose, number("VERSION")), (BODIES, POSE, VERSION as usize));
    assert_eq!(FIELDS + 6 + 3 * person + 3 * bodies * pose + 4 * joints, LENGTH);
    assert!(text("/artist.js").contains(&format!("const POSE = {POSE};")));
}
