//! Tests the page's files.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};
use view::{ASSETS, FIELDS, POSE, TURNS, VERSION, length};

fn text(path: &str) -> &'static str {
    let asset = ASSETS.iter().find(|asset| asset.path == path).expect("a file of the page");
    std::str::from_utf8(asset.bytes).expect("text")
}

#[test]
fn page_names_only_files_that_are_served() {
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

/// Hashes of the files below build and examples/jsm in the package three 0.185.0 on npm.
#[test]
fn three_matches_published_hashes() {
    let published = [
        ("/three.module.min.js", "86bcee248b64f44bcfc23c331ae74619061957d59cab040171dcb6fb5900beb6"),
        ("/three.core.min.js", "0e9dd2793e01d0d9eb4f2ab00b4ffcdd4488275ebebee5c31fa8d347bc29f0bf"),
        ("/three/loaders/ColladaLoader.js", "b150c67c4bf98ed1eec3cf291e1bd00fc53016488bcefadd7a24f659e86e52d9"),
        (
            "/three/loaders/collada/ColladaComposer.js",
            "d96f4dcf36bc6a30a4d385bce511ed10e27893d1824074daa97ac863df1232e8",
        ),
        ("/three/loaders/collada/ColladaParser.js", "d9532ab17f1d9e2919deba8029d759d5dcaed2f21195ded9e29491f719b1a0c6"),
        ("/three/loaders/TGALoader.js", "da4cfa0c050b8076a63596f36f6e5a54a4a8271774a5301482996be030505c43"),
        ("/three/loaders/STLLoader.js", "023ed97f848b633d8bcd53d4db3b996d29d0c644088700691297c552257d480b"),
        ("/three/loaders/GLTFLoader.js", "97642d720f16cc9a0c9844934198e4d0c023bea8e89576d0f7545d03b2d103d2"),
        ("/three/loaders/OBJLoader.js", "86c8384e269b75a21d502d438e3f0dc2e09dc61b6e6da6b81947f5b119112bf8"),
        ("/three/loaders/MTLLoader.js", "f1f8f0c6fcfa09671cb609954ea436521d835606853c110c5aff2dc8188f5e61"),
        ("/three/utils/BufferGeometryUtils.js", "5c552223a9309883743b80538d6e9cdb45e3227f30d3ec56fb2c39b46e78d595"),
        ("/three/utils/SkeletonUtils.js", "b1632a703206c3d830de9fcbe515696770d04b71a15ee6b50afa6d2c3298c86f"),
    ];
    let vendored = ASSETS.iter().filter(|asset| asset.path.contains("three")).count();
    assert_eq!(vendored, published.len());
    for (path, hash) in published {
        let found: String = Sha256::digest(text(path)).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(found, hash, "{path}");
    }
}

#[test]
fn page_constants_match_frame_layout() {
    let wire = text("/wire.js");
    let number = |name: &str| -> usize {
        let (_, after) = wire.split_once(&format!("{name} = ")).unwrap_or_else(|| panic!("no {name}"));
        after.split(|c: char| !c.is_ascii_digit()).next().and_then(|digits| digits.parse().ok()).expect("a number")
    };
    let fields = wire.split_once("FIELDS = [").and_then(|(_, after)| after.split_once(']')).expect("fields").0;
    assert_eq!(fields.split(',').count(), FIELDS);
    let (person, pose) = (number("PERSON"), number("POSE"));
    assert_eq!((pose, number("TURNS"), number("VERSION")), (POSE, TURNS, VERSION as usize));
    // The page computes the length from the number of joints in the scene.
    for joints in [7, 14, 22] {
        assert_eq!(FIELDS + 12 + 3 * person + TURNS + 3 * (joints + 1) * pose + 4 * joints, length(joints));
    }
    assert!(wire.contains("(joints + 1) * POSE") && wire.contains("4 * joints"));
    assert!(text("/robot.js").contains(&format!("const POSE = {POSE};")));
}

/// The browser runs the import map only if the policy contains its hash.
#[test]
fn import_map_hash_is_in_policy() {
    let page = text("/");
    let (_, after) = page.split_once("<script type=\"importmap\">").expect("an import map");
    let map = after.split_once("</script>").expect("its end").0;
    let hash = STANDARD.encode(Sha256::digest(map));
    assert!(view::POLICY.contains(&format!("'sha256-{hash}'")), "{hash} is not in the policy");
}

/// The same limit as for the Rust files.
#[test]
fn own_scripts_have_at_most_500_lines() {
    for asset in ASSETS.iter().filter(|asset| !asset.path.contains("three")) {
        let lines = text(asset.path).lines().count();
        assert!(lines <= 500, "{}: {lines} lines", asset.path);
    }
}
