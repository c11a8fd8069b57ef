//! Files of the page, embedded in the program. The page loads nothing from elsewhere.

/// A file of the page.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Asset {
    pub path: &'static str,
    pub kind: &'static str,
    pub bytes: &'static [u8],
}

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Builds the entry of a script from its file below `page`.
macro_rules! script {
    ($name:literal) => {
        script!($name, $name)
    };
    ($name:literal, $file:literal) => {
        Asset { path: concat!("/", $name), kind: SCRIPT, bytes: include_bytes!(concat!("../page/", $file)) }
    };
}

/// All files. three.js 0.185.0 (MIT) is byte for byte as its authors publish it on npm.
pub const ASSETS: [Asset; 36] = [
    Asset { path: "/", kind: HTML, bytes: include_bytes!("../page/index.html") },
    Asset { path: "/page.css", kind: CSS, bytes: include_bytes!("../page/page.css") },
    script!("page.js"),
    script!("stage.js"),
    script!("panel.js"),
    script!("sparkline.js"),
    script!("mix.js"),
    script!("webcam.js"),
    script!("webcam-worker.js"),
    script!("headset.js"),
    script!("headset-poses.js"),
    script!("headset-room.js"),
    script!("wire.js"),
    script!("artist.js"),
    script!("camera.js"),
    script!("floor.js"),
    script!("person.js"),
    script!("tube.js"),
    script!("near.js"),
    script!("robot.js"),
    script!("solid.js"),
    script!("quality.js"),
    script!("shadow.js"),
    script!("meshes.js"),
    script!("three.module.min.js", "three/three.module.min.js"),
    script!("three.core.min.js", "three/three.core.min.js"),
    // Used only for the user's own meshes.
    script!("three/loaders/ColladaLoader.js"),
    script!("three/loaders/collada/ColladaComposer.js"),
    script!("three/loaders/collada/ColladaParser.js"),
    script!("three/loaders/TGALoader.js"),
    script!("three/loaders/STLLoader.js"),
    script!("three/loaders/GLTFLoader.js"),
    script!("three/loaders/OBJLoader.js"),
    script!("three/loaders/MTLLoader.js"),
    script!("three/utils/BufferGeometryUtils.js"),
    script!("three/utils/SkeletonUtils.js"),
];
