//! Reads the triangles of collision meshes: STL (binary and text), Wavefront OBJ and COLLADA.

use crate::error::{CollisionError, read};
use nalgebra::Vector3;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::HashMap;
use std::path::Path;

/// A triangle, or any small set of points that stands for its convex hull.
pub type Points = Vec<Vector3<f64>>;

/// Reads the triangles of a mesh file, in the file's frame and unit. A URDF's `scale` converts them to metres.
///
/// COLLADA: geometries are taken as they are, as the ROS tools do, without the document's up axis. Node
/// transforms and units other than the metre are rejected, not guessed.
pub fn read_mesh(path: &Path) -> Result<Vec<Points>, CollisionError> {
    let name = path.display().to_string();
    let bytes = read(path)?;
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("stl" | "STL") if is_text_stl(&bytes) => text_stl(&name, &text(&name, &bytes)?),
        Some("stl" | "STL") => stl(&name, &bytes),
        Some("obj" | "OBJ") => obj(&name, &text(&name, &bytes)?),
        Some("dae" | "DAE") => dae(&name, &text(&name, &bytes)?),
        _ => Err(CollisionError::content(name, "only .stl, .obj and .dae are supported")),
    }
}

fn text(name: &str, bytes: &[u8]) -> Result<String, CollisionError> {
    String::from_utf8(bytes.to_vec()).map_err(|_| CollisionError::content(name, "is not UTF-8 text"))
}

/// Both kinds of STL may start with `solid`. Only text has facets, and its length matches no triangle count.
fn is_text_stl(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(1_000)];
    head.starts_with(b"solid") && head.windows(5).any(|word| word == b"facet")
}

/// Reads text STL: three lines `vertex x y z` for each facet.
fn text_stl(name: &str, text: &str) -> Result<Vec<Points>, CollisionError> {
    let mut corners = Points::new();
    for line in text.lines() {
        if let Some(rest) = line.trim().strip_prefix("vertex ") {
            corners.push(triple(rest).map_err(|cause| CollisionError::content(name, cause))?);
        }
    }
    if !text.contains("endsolid") {
        return Err(CollisionError::content(name, "ends before `endsolid`"));
    }
    if corners.is_empty() || !corners.len().is_multiple_of(3) {
        return Err(CollisionError::content(
            name,
            format!("has {} vertices, must be three for each facet", corners.len()),
        ));
    }
    finite(name, corners.chunks(3).map(<[_]>::to_vec).collect())
}

fn triple(text: &str) -> Result<Vector3<f64>, String> {
    match numbers::<f64>(text)?.as_slice() {
        [x, y, z, ..] => Ok(Vector3::new(*x, *y, *z)),
        _ => Err(format!("`{text}` must be three numbers")),
    }
}

/// Reads Wavefront OBJ: `v x y z`, and `f` with indices of corners from 1, or from the end if negative. The
/// part after a `/` is texture and normal. Faces are cut into fans. Lines and points are left out.
fn obj(name: &str, text: &str) -> Result<Vec<Points>, CollisionError> {
    let wrong = |cause: String| CollisionError::content(name, cause);
    let (mut vertices, mut triangles) = (Points::new(), Vec::new());
    for line in text.lines() {
        match line.trim().split_once(char::is_whitespace) {
            Some(("v", rest)) => vertices.push(triple(rest).map_err(wrong)?),
            Some(("f", rest)) => {
                let corner = |word: &str| {
                    let index: i64 = word.split('/').next()?.parse().ok()?;
                    let at = if index < 0 { vertices.len() as i64 + index } else { index - 1 };
                    vertices.get(usize::try_from(at).ok()?).copied()
                };
                let face: Option<Points> = rest.split_ascii_whitespace().map(corner).collect();
                let face =
                    face.ok_or_else(|| wrong(format!("face `{rest}` refers to a vertex that does not exist")))?;
                let fan = face.windows(2).skip(1).map(|edge| vec![face[0], edge[0], edge[1]]);
                triangles.extend(fan);
            }
            _ => {}
        }
    }
    if triangles.is_empty() {
        return Err(wrong("holds no faces".into()));
    }
    finite(name, triangles)
}

/// Reads binary STL: 80 bytes, a count, then 50 bytes per triangle (normal, three corners as f32, two bytes).
fn stl(name: &str, bytes: &[u8]) -> Result<Vec<Points>, CollisionError> {
    let count = bytes.get(80..84).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize);
    let body = bytes.get(84..).unwrap_or_default();
    if count.is_none_or(|count| count == 0 || body.len() != count * 50) {
        return Err(CollisionError::content(name, "is not a binary STL: length and triangle count disagree"));
    }
    let number = |bytes: &[u8]| f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
    let corner = |bytes: &[u8]| Vector3::new(number(bytes), number(&bytes[4..]), number(&bytes[8..]));
    let triangles: Vec<Points> = body
        .chunks_exact(50)
        .map(|record| vec![corner(&record[12..]), corner(&record[24..]), corner(&record[36..])])
        .collect();
    finite(name, triangles)
}

fn finite(name: &str, triangles: Vec<Points>) -> Result<Vec<Points>, CollisionError> {
    if triangles.iter().flatten().flatten().any(|x| !x.is_finite()) {
        return Err(CollisionError::content(name, "a coordinate is NaN or infinite"));
    }
    Ok(triangles)
}

/// Content of one `<triangles>` or `<polylist>`.
#[derive(Default)]
struct Primitive {
    stride: usize,
    vertex_offset: usize,
    source: String,
    /// Number of corners of each polygon. Empty for triangles.
    counts: Vec<usize>,
    indices: Vec<usize>,
}

/// The relevant elements, in any order.
#[derive(Default)]
struct Collada {
    arrays: HashMap<String, Vec<f64>>,
    /// Maps a `<vertices>` id to the source of its positions.
    positions: HashMap<String, String>,
    primitives: Vec<Primitive>,
}

fn dae(name: &str, text: &str) -> Result<Vec<Points>, CollisionError> {
    let wrong = |cause: String| CollisionError::content(name, cause);
    let mut reader = Reader::from_str(text);
    let (mut collada, mut open): (Collada, Vec<String>) = Default::default();
    let (mut source, mut vertices) = (String::new(), String::new());
    loop {
        let event = reader.read_event().map_err(|error| wrong(error.to_string()))?;
        let (start, empty) = match &event {
            Event::Start(start) => (start, false),
            Event::Empty(start) => (start, true),
            Event::End(_) => {
                open.pop();
                continue;
            }
            Event::Text(text) => {
                let text = text.decode().map_err(|error| wrong(error.to_string()))?;
                collada.take_text(open.last().map_or("", String::as_str), &source, &text).map_err(wrong)?;
                continue;
            }
            Event::Eof => return finite(name, collada.triangles().map_err(wrong)?),
            _ => continue,
        };
        let tag = String::from_utf8_lossy(start.local_name().as_ref()).into_owned();
        match tag.as_str() {
            "source" => source = attribute(start, "id"),
            "vertices" => vertices = attribute(start, "id"),
            "triangles" | "polylist" => collada.primitives.push(Primitive::default()),
            "input" => collada.take_input(start, &vertices, open.last().map_or("", String::as_str)),
            "matrix" | "translate" | "rotate" | "scale" | "skew" | "lookat" => {
                return Err(wrong(format!("<{tag}> of a node is not supported")));
            }
            "polygons" | "trifans" | "tristrips" => return Err(wrong(format!("<{tag}> is not supported"))),
            "unit" if attribute(start, "meter").parse::<f64>().unwrap_or(1.0) != 1.0 => {
                return Err(wrong(format!("unit meter = {}, must be 1", attribute(start, "meter"))));
            }
            _ => {}
        }
        if !empty {
            open.push(tag);
        }
    }
}

fn attribute(start: &BytesStart<'_>, key: &str) -> String {
    let found = start.attributes().flatten().find(|attribute| attribute.key.local_name().as_ref() == key.as_bytes());
    found.map(|attribute| String::from_utf8_lossy(&attribute.value).into_owned()).unwrap_or_default()
}

fn numbers<T: std::str::FromStr>(text: &str) -> Result<Vec<T>, String> {
    let parse = |word: &str| word.parse().map_err(|_| format!("`{word}` is not a number"));
    text.split_ascii_whitespace().map(parse).collect()
}

impl Collada {
    fn take_text(&mut self, tag: &str, source: &str, text: &str) -> Result<(), String> {
        match (tag, self.primitives.last_mut()) {
            ("float_array", _) => {
                self.arrays.insert(source.into(), numbers(text)?);
            }
            ("vcount", Some(primitive)) => primitive.counts = numbers(text)?,
            ("p", Some(primitive)) => primitive.indices = numbers(text)?,
            _ => {}
        }
        Ok(())
    }

    fn take_input(&mut self, start: &BytesStart<'_>, vertices: &str, inside: &str) {
        let target = attribute(start, "source").trim_start_matches('#').to_owned();
        let semantic = attribute(start, "semantic");
        if inside == "vertices" {
            if semantic == "POSITION" {
                self.positions.insert(vertices.into(), target);
            }
        } else if let Some(primitive) = self.primitives.last_mut() {
            let offset = attribute(start, "offset").parse().unwrap_or(0);
            primitive.stride = primitive.stride.max(offset + 1);
            if semantic == "VERTEX" {
                (primitive.vertex_offset, primitive.source) = (offset, target);
            }
        }
    }

    fn triangles(&self) -> Result<Vec<Points>, String> {
        let mut triangles = Vec::new();
        for primitive in &self.primitives {
            let array = self.positions.get(&primitive.source).and_then(|id| self.arrays.get(id));
            let array = array.ok_or_else(|| format!("positions of `{}` are missing", primitive.source))?;
            let point = |corner: usize| {
                let at = primitive.indices.get(corner * primitive.stride + primitive.vertex_offset)?;
                let xyz = array.get(3 * at..3 * at + 3)?;
                Some(Vector3::new(xyz[0], xyz[1], xyz[2]))
            };
            let corners = primitive.indices.len() / primitive.stride.max(1);
            let counts = if primitive.counts.is_empty() { vec![3; corners / 3] } else { primitive.counts.clone() };
            let mut first = 0;
            for count in counts {
                // A polygon is the fan of triangles around its first corner.
                for k in 1..count.saturating_sub(1) {
                    let triangle = [first, first + k, first + k + 1].map(point).into_iter().collect::<Option<Points>>();
                    triangles.push(triangle.ok_or("an index refers to an entry that does not exist")?);
                }
                first += count;
            }
        }
        if triangles.is_empty() {
            return Err("holds no triangles".into());
        }
        Ok(triangles)
    }
}
