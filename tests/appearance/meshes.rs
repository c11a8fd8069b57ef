//! Tests the user's own meshes: each format is drawn, and no other file of the disk is served.

use super::{loaded, played};
use crate::browser::Browser;
use harness::{SOON, within};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use view::{Mesh, MeshFolder, RobotView, Server};

/// A tetrahedron of 0.4 m: corners and triangles.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.4]];
const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn stl() -> String {
    let mut text = "solid t\n".to_owned();
    for face in FACES {
        text.push_str("facet normal 0 0 0\nouter loop\n");
        for [x, y, z] in face.map(|n| CORNERS[n]) {
            text.push_str(&format!("vertex {x} {y} {z}\n"));
        }
        text.push_str("endloop\nendfacet\n");
    }
    text + "endsolid t\n"
}

fn obj() -> String {
    let corners: String = CORNERS.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let faces: String = FACES.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1)).collect();
    format!("mtllib skin.mtl\n{corners}usemtl skin\n{faces}")
}

fn dae() -> String {
    let corners: Vec<String> = CORNERS.as_flattened().iter().map(f32::to_string).collect();
    let faces: Vec<String> = FACES.as_flattened().iter().map(usize::to_string).collect();
    include_str!("tetrahedron.dae").replace("CORNERS", &corners.join(" ")).replace("FACES", &faces.join(" "))
}

fn glb() -> Vec<u8> {
    let mut bytes: Vec<u8> = CORNERS.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend(FACES.as_flattened().iter().flat_map(|&n| (n as u16).to_le_bytes()));
    let mut json = serde_json::json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "name": "skin", "pbrMetallicRoughness": { "baseColorFactor": [0.0, 0.6, 0.6, 1.0] } }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [0.4, 0.4, 0.4] },
            { "bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 24 }
        ],
        "buffers": [{ "byteLength": bytes.len() }]
    })
    .to_string()
    .into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = Vec::new();
    let length = 12 + 8 + json.len() + 8 + bytes.len();
    for word in [0x4654_6c67, 2, length as u32, json.len() as u32, 0x4e4f_534a] {
        file.extend(word.to_le_bytes());
    }
    file.extend(json);
    file.extend((bytes.len() as u32).to_le_bytes());
    file.extend(0x004e_4942_u32.to_le_bytes());
    file.extend(bytes);
    file
}

/// Returns a robot whose base is one mesh of each format. Its parts are those of its look.
fn view_of(folder: &Path) -> RobotView {
    for (name, bytes) in [
        ("a b.stl", stl().into_bytes()),
        ("skin.obj", obj().into_bytes()),
        ("skin.mtl", b"newmtl skin\nKd 0.9 0.05 0.8\n".to_vec()),
        ("plain.dae", dae().into_bytes()),
        ("cyan.glb", glb()),
    ] {
        std::fs::write(folder.join(name), bytes).expect("a file");
    }
    let mut view = RobotView::load(&loaded(), None).expect("the shipped look");
    view.meshes = ["a b.stl", "skin.obj", "plain.dae", "cyan.glb"]
        .iter()
        .enumerate()
        .map(|(n, name)| Mesh {
            link: "base_link".into(),
            body: 0,
            body_from_mesh: [[1.0, 0.0, 0.0, 0.3], [0.0, 1.0, 0.0, 0.5 * n as f64 - 0.9], [0.0, 0.0, 1.0, 0.1]],
            file: (*name).into(),
            colour: None,
        })
        .collect();
    view.folder = Some(Arc::new(MeshFolder::open(folder).expect("a folder")));
    view
}

#[test]
fn meshes_of_every_format_are_drawn_in_their_colours() {
    let folder = tempfile::tempdir().expect("a folder");
    let view = view_of(folder.path());
    let server = Server::recording(played(&loaded(), 1.0, 2.0), "played.mcap", &view, 0).expect("a port");
    let Some(mut browser) = Browser::open(server.address()) else { return };
    browser.wait_text_like("meshes", "/^\\d+ drawn/");
    assert_eq!(browser.text("meshes"), "4 drawn");
    for (what, near) in [("the OBJ's material", [230, 13, 204]), ("the GLB's material", [0, 204, 204])] {
        let mut seen = 0;
        within(SOON, || {
            let picture = browser.screenshot();
            seen = browser.count_pixels(&picture, near);
            seen > 300
        });
        println!("{what}: {seen} pixels");
        assert!(seen > 300, "{what}: {seen} pixels");
    }
}

#[test]
fn only_meshes_in_the_folder_are_served_and_only_with_token() {
    let folder = tempfile::tempdir().expect("a folder");
    let inner = folder.path().join("meshes");
    std::fs::create_dir(&inner).expect("a folder");
    std::fs::write(folder.path().join("secret.stl"), "secret").expect("a file");
    std::fs::write(inner.join("notes.txt"), "secret").expect("a file");
    std::os::unix::fs::symlink(folder.path().join("secret.stl"), inner.join("link.stl")).expect("a link");
    let view = view_of(&inner);
    let server = Server::recording(played(&loaded(), 1.0, 0.2), "played.mcap", &view, 0).expect("a port");
    let (origin, token) = server.address().split_once("/#").expect("a token");
    let host = origin.strip_prefix("http://").expect("a host");
    let get = |path: &str| {
        let mut stream = TcpStream::connect(host).expect("it listens");
        stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n").as_bytes()).expect("it reads");
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    };
    let answer = get(&format!("/meshes/{token}/a%20b.stl"));
    assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with(&stl()), "{answer}");
    let wrong = "0".repeat(token.len());
    for (path, status) in [
        (format!("/meshes/{wrong}/plain.dae"), "403"),
        (format!("/meshes/{}/plain.dae", &token[1..]), "403"),
        ("/meshes/plain.dae".to_owned(), "404"),
        (format!("/meshes/{token}/../secret.stl"), "404"),
        (format!("/meshes/{token}/%2e%2e/secret.stl"), "404"),
        (format!("/meshes/{token}/..%2fsecret.stl"), "404"),
        (format!("/meshes/{token}/%2fetc/hostname"), "404"),
        (format!("/meshes/{token}/link.stl"), "404"),
        (format!("/meshes/{token}/notes.txt"), "404"),
        (format!("/meshes/{token}/none.stl"), "404"),
        (format!("/meshes/{token}/%ff.stl"), "400"),
        (format!("/meshes/{token}/%zz.stl"), "400"),
    ] {
        let answer = get(&path);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{path}: {answer}");
        assert!(!answer.contains("secret"), "{path}: {answer}");
    }
}
