//! The page, embedded: nothing is fetched from anywhere else.

/// A file of the page.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// Path of its address.
    pub path: &'static str,
    /// MIME type.
    pub kind: &'static str,
    /// Content.
    pub bytes: &'static [u8],
}

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// All of them. three.js 0.185.0 (MIT) is as its authors publish it on npm, byte for byte.
pub const ASSETS: [Asset; 10] = [
    Asset { path: "/", kind: HTML, bytes: include_bytes!("../page/index.html") },
    Asset { path: "/page.css", kind: CSS, bytes: include_bytes!("../page/page.css") },
    Asset { path: "/page.js", kind: SCRIPT, bytes: include_bytes!("../page/page.js") },
    Asset { path: "/stage.js", kind: SCRIPT, bytes: include_bytes!("../page/stage.js") },
    Asset { path: "/artist.js", kind: SCRIPT, bytes: include_bytes!("../page/artist.js") },
    Asset { path: "/wire.js", kind: SCRIPT, bytes: include_bytes!("../page/wire.js") },
    Asset { path: "/mix.js", kind: SCRIPT, bytes: include_bytes!("../page/mix.js") },
    Asset { path: "/chart.js", kind: SCRIPT, bytes: include_bytes!("../page/chart.js") },
    Asset { path: "/three.module.min.js", kind: SCRIPT, bytes: include_bytes!("../page/three/three.module.min.js") },
    Asset { path: "/three.core.min.js", kind: SCRIPT, bytes: include_bytes!("../page/three/three.core.min.js") },
];
