//! Reads the triangles of collision meshes: STL (binary and text), Wavefront OBJ and COLLADA.

use crate::error::{CollisionError, read};
use nalgebra::{Matrix4, Point3, Vector3};
use roxmltree::{Document, Node};
use std::path::Path;

/// A triangle, or any small set of points that stands for its convex hull.
pub type Points = Vec<Vector3<f64>>;

/// Reads the triangles of a mesh file, in the file's frame and unit. A URDF's `scale` converts them to metres.
///
/// COLLADA: geometries stand where the nodes of the scene place them. As in the ROS tools, the document's up axis does
/// not count. Units other than the metre are rejected, not guessed.
pub fn read_mesh(path: &Path) -> Result<Vec<Points>, CollisionError> {
    let bytes = read(path)?;
    let text = || std::str::from_utf8(&bytes).map_err(|_| "is not UTF-8 text".to_owned());
    let triangles = match path.extension().and_then(|extension| extension.to_str()) {
        Some("stl" | "STL") if is_text_stl(&bytes) => text().and_then(text_stl),
        Some("stl" | "STL") => stl(&bytes),
        Some("obj" | "OBJ") => text().and_then(obj),
        Some("dae" | "DAE") => text().and_then(dae),
        _ => Err("only .stl, .obj and .dae are supported".into()),
    };
    let finite = triangles.and_then(|triangles| {
        let finite = triangles.iter().flatten().flatten().all(|x| x.is_finite());
        if finite { Ok(triangles) } else { Err("a coordinate is NaN or infinite".into()) }
    });
    finite.map_err(|cause| CollisionError::content(path.display().to_string(), cause))
}

/// Both kinds of STL may start with `solid`. Only text has facets, and its length matches no triangle count.
fn is_text_stl(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(1_000)];
    head.starts_with(b"solid") && head.windows(5).any(|word| word == b"facet")
}

/// Reads text STL: three lines `vertex x y z` for each facet.
fn text_stl(text: &str) -> Result<Vec<Points>, String> {
    let corners = text.lines().filter_map(|line| line.trim().strip_prefix("vertex "));
    let corners: Points = corners.map(triple).collect::<Result<_, _>>()?;
    if !text.contains("endsolid") {
        return Err("ends before `endsolid`".into());
    }
    if corners.is_empty() || !corners.len().is_multiple_of(3) {
        return Err(format!("has {} vertices, must be three for each facet", corners.len()));
    }
    Ok(corners.chunks(3).map(<[_]>::to_vec).collect())
}

fn triple(text: &str) -> Result<Vector3<f64>, String> {
    match numbers::<f64>(text)?.as_slice() {
        [x, y, z, ..] => Ok(Vector3::new(*x, *y, *z)),
        _ => Err(format!("`{text}` must be three numbers")),
    }
}

/// Reads Wavefront OBJ: `v x y z`, and `f` with indices of corners from 1, or from the end if negative. The
/// part after a `/` is texture and normal. Faces are cut into fans. Lines and points are left out.
fn obj(text: &str) -> Result<Vec<Points>, String> {
    let (mut vertices, mut triangles) = (Points::new(), Vec::new());
    for line in text.lines() {
        match line.trim().split_once(char::is_whitespace) {
            Some(("v", rest)) => vertices.push(triple(rest)?),
            Some(("f", rest)) => {
                let corner = |word: &str| {
                    let index: i64 = word.split('/').next()?.parse().ok()?;
                    let at = if index < 0 { vertices.len() as i64 + index } else { index - 1 };
                    vertices.get(usize::try_from(at).ok()?).copied()
                };
                let face: Option<Points> = rest.split_ascii_whitespace().map(corner).collect();
                let face = face.ok_or_else(|| format!("face `{rest}` refers to a vertex that does not exist"))?;
                triangles.extend(face.windows(2).skip(1).map(|edge| vec![face[0], edge[0], edge[1]]));
            }
            _ => {}
        }
    }
    if triangles.is_empty() { Err("holds no faces".into()) } else { Ok(triangles) }
}

/// Reads binary STL: 80 bytes, a count, then 50 bytes per triangle (normal, three corners as f32, two bytes).
fn stl(bytes: &[u8]) -> Result<Vec<Points>, String> {
    let count = bytes.get(80..84).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize);
    let body = bytes.get(84..).unwrap_or_default();
    if count.is_none_or(|count| count == 0 || body.len() != count * 50) {
        return Err("is not a binary STL: length and triangle count disagree".into());
    }
    let number = |bytes: &[u8]| f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
    let corner = |bytes: &[u8]| Vector3::new(number(bytes), number(&bytes[4..]), number(&bytes[8..]));
    let triangle = |record: &[u8]| vec![corner(&record[12..]), corner(&record[24..]), corner(&record[36..])];
    Ok(body.chunks_exact(50).map(triangle).collect())
}

/// Reads COLLADA: the `<triangles>` and the `<polylist>` of all geometries, where the nodes place them.
fn dae(text: &str) -> Result<Vec<Points>, String> {
    let document = Document::parse(text).map_err(|error| error.to_string())?;
    for element in document.descendants() {
        match element.tag_name().name() {
            tag @ ("polygons" | "trifans" | "tristrips") => return Err(format!("<{tag}> is not supported")),
            "unit" => match element.attribute("meter") {
                Some(meter) if meter.parse::<f64>().unwrap_or(1.0) != 1.0 => {
                    return Err(format!("unit meter = {meter}, must be 1"));
                }
                _ => {}
            },
            _ => {}
        }
    }
    let mut triangles = Vec::new();
    for scene in document.descendants().filter(|element| element.has_tag_name("visual_scene")) {
        read_node(scene, &Matrix4::identity(), &mut triangles)?;
    }
    // Without a scene, geometries are taken as they are.
    if triangles.is_empty() {
        read_geometry(document.root(), &Matrix4::identity(), &mut triangles)?;
    }
    if triangles.is_empty() { Err("holds no triangles".into()) } else { Ok(triangles) }
}

/// Reads the geometries of a node and of the nodes below it. Their transforms stand before them.
fn read_node<'a>(node: Node<'a, 'a>, above: &Matrix4<f64>, triangles: &mut Vec<Points>) -> Result<(), String> {
    let mut pose = *above;
    for child in node.children() {
        match child.tag_name().name() {
            tag @ ("matrix" | "translate" | "rotate" | "scale") => {
                let numbers: Vec<f64> = numbers(child.text().unwrap_or_default())?;
                pose *= match (tag, numbers.as_slice()) {
                    ("matrix", rows) if rows.len() == 16 => Matrix4::from_row_slice(rows),
                    ("translate", &[x, y, z]) => Matrix4::new_translation(&Vector3::new(x, y, z)),
                    ("scale", &[x, y, z]) => Matrix4::new_nonuniform_scaling(&Vector3::new(x, y, z)),
                    ("rotate", &[x, y, z, degrees]) => {
                        Matrix4::new_rotation(Vector3::new(x, y, z).normalize() * degrees.to_radians())
                    }
                    _ => return Err(format!("<{tag}> of a node has {} numbers", numbers.len())),
                };
            }
            tag @ ("skew" | "lookat" | "instance_controller" | "instance_node") => {
                return Err(format!("<{tag}> of a node is not supported"));
            }
            "instance_geometry" => {
                let geometry = child.attribute("url").and_then(|url| element_of(child, url));
                read_geometry(geometry.ok_or("a geometry of a node is missing")?, &pose, triangles)?;
            }
            "node" => read_node(child, &pose, triangles)?,
            _ => {}
        }
    }
    Ok(())
}

fn read_geometry<'a>(geometry: Node<'a, 'a>, pose: &Matrix4<f64>, triangles: &mut Vec<Points>) -> Result<(), String> {
    let first = triangles.len();
    for element in
        geometry.descendants().filter(|element| ["triangles", "polylist"].contains(&element.tag_name().name()))
    {
        read_primitive(element, triangles)?;
    }
    let place = |point: &mut Vector3<f64>| *point = pose.transform_point(&Point3::from(*point)).coords;
    triangles[first..].iter_mut().flatten().for_each(place);
    Ok(())
}

/// Returns the element that a reference such as `#name` names.
fn element_of<'a>(from: Node<'a, 'a>, reference: &str) -> Option<Node<'a, 'a>> {
    let id = reference.trim_start_matches('#');
    from.document().descendants().find(|element| element.attribute("id") == Some(id))
}

fn children<'a>(parent: Node<'a, 'a>, tag: &'a str) -> impl Iterator<Item = Node<'a, 'a>> {
    parent.children().filter(move |child| child.has_tag_name(tag))
}

/// Returns the element that an `<input>` of this meaning names.
fn input<'a>(parent: Node<'a, 'a>, semantic: &str) -> Option<Node<'a, 'a>> {
    let input = children(parent, "input").find(|input| input.attribute("semantic") == Some(semantic))?;
    element_of(parent, input.attribute("source")?)
}

/// Reads a `<triangles>` or a `<polylist>`.
fn read_primitive<'a>(primitive: Node<'a, 'a>, triangles: &mut Vec<Points>) -> Result<(), String> {
    let text = |parent, tag| children(parent, tag).next().and_then(|child| child.text());
    let positions = input(primitive, "VERTEX").and_then(|vertices| input(vertices, "POSITION"));
    let array = positions.and_then(|source| text(source, "float_array"));
    let array: Vec<f64> = numbers(array.ok_or("positions of a primitive are missing")?)?;
    let indices: Vec<usize> = numbers(text(primitive, "p").unwrap_or_default())?;
    let offset = |input: &Node<'_, '_>| input.attribute("offset").and_then(|offset| offset.parse().ok()).unwrap_or(0);
    let of_vertex = children(primitive, "input").find(|input| input.attribute("semantic") == Some("VERTEX"));
    let of_vertex = of_vertex.as_ref().map_or(0, offset);
    let stride = children(primitive, "input").map(|input| offset(&input) + 1).max().unwrap_or(1);
    let point = |corner: usize| {
        let at = indices.get(corner * stride + of_vertex)?;
        Some(Vector3::from_column_slice(array.get(3 * at..3 * at + 3)?))
    };
    let counts = text(primitive, "vcount").map(numbers::<usize>).transpose()?;
    let mut first = 0;
    for count in counts.unwrap_or_else(|| vec![3; indices.len() / stride / 3]) {
        // A polygon is the fan of triangles around its first corner.
        for k in 1..count.saturating_sub(1) {
            let triangle = [first, first + k, first + k + 1].map(point).into_iter().collect::<Option<Points>>();
            triangles.push(triangle.ok_or("an index refers to an entry that does not exist")?);
        }
        first += count;
    }
    Ok(())
}

fn numbers<T: std::str::FromStr>(text: &str) -> Result<Vec<T>, String> {
    let parse = |word: &str| word.parse().map_err(|_| format!("`{word}` is not a number"));
    text.split_ascii_whitespace().map(parse).collect()
}
