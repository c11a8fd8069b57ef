//! Each mesh format and each primitive: its meaning, and that fitted capsules contain it.

use collision::check::sticks_out_m;
use collision::fit::Shape;
use collision::mesh::{Points, read_mesh};
use collision::plan::{Group, Plan};
use collision::scene::Scene;
use collision::write::fit_all;
use nalgebra::Vector3;
use std::path::PathBuf;
use tempfile::TempDir;

/// A wedge: three corners below, one above.
const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.2, 0.0], [0.05, 0.05, 0.1]];
const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

fn write(folder: &TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn wedge() -> Vec<Points> {
    FACES.iter().map(|face| face.iter().map(|corner| Vector3::from(CORNERS[*corner])).collect()).collect()
}

fn assert_is_the_wedge(triangles: &[Points]) {
    assert_eq!(triangles.len(), 4);
    for (ours, wanted) in triangles.iter().flatten().zip(wedge().iter().flatten()) {
        assert!((ours - wanted).norm() < 1e-7, "{ours} {wanted}");
    }
}

/// Fits one capsule around a link with that mesh. Checks that it contains all of it, and that a thinner one does not.
fn assert_contained(folder: &TempDir, geometry: &str, least_m3: f64) {
    let urdf = format!(
        "<robot name=\"r\"><link name=\"l\"><collision><geometry>{geometry}</geometry></collision></link></robot>"
    );
    let robot = urdf_rs::read_from_string(&urdf).unwrap();
    let plan = Plan::of_groups(vec![Group::of_link("l")]);
    let scene = Scene::new(&robot, Some(folder.path()), &plan.fingers);
    let capsules = fit_all(&plan, &scene).unwrap();
    assert_eq!(capsules.len(), 1);
    let capsule = &capsules[0];
    assert!(sticks_out_m(&capsule.content.matter, &[capsule.shape]) <= 0.0, "{geometry}");
    let thin = Shape { radius_m: capsule.shape.radius_m - 4e-3, ..capsule.shape };
    assert!(sticks_out_m(&capsule.content.matter, &[thin]) > 1e-4, "{geometry}");
    // The ratio compares the bare capsule with the convex hull. The hull is no smaller than the shape inside it.
    let hull_m3 = capsule.volume_m3 / capsule.volume_ratio;
    assert!(capsule.volume_ratio >= 1.0 && hull_m3 >= least_m3 * (1.0 - 1e-6), "{geometry}: {hull_m3} {least_m3}");
    assert!(hull_m3 < 2.0 * least_m3, "{geometry}: {hull_m3} {least_m3}");
}

/// Volume of the wedge, m^3: base area times height over 3.
const WEDGE_M3: f64 = 0.5 * 0.3 * 0.2 * 0.1 / 3.0;
const MESH: &str = "<mesh filename=\"package://any/meshes/NAME\"/>";

#[test]
fn obj_mesh_is_read_and_malformed_obj_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::from("# a wedge\no wedge\n");
    CORNERS.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\nvn 0 0 1\n"));
    FACES.iter().for_each(|[a, b, c]| text += &format!("f {}//1 {}/2/1 {}\n", a + 1, b + 1, *c as i64 - 4));
    let path = write(&folder, "wedge.obj", text.as_bytes());
    assert_is_the_wedge(&read_mesh(&path).unwrap());
    assert_contained(&folder, &MESH.replace("NAME", "wedge.obj"), WEDGE_M3);
    // A square is a fan of two triangles.
    let square = write(&folder, "square.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
    assert_eq!(read_mesh(&square).unwrap().len(), 2);
    for wrong in ["v 0 0\nf 1 1 1\n", "v 0 0 0\nf 1 2 3\n", "v 0 0 0\nf 0 1 1\n", "v 0 0 0\n", "v 0 0 nan\nf 1 1 1\n"] {
        let error = read_mesh(&write(&folder, "wrong.obj", wrong.as_bytes())).unwrap_err().to_string();
        assert!(error.contains("wrong.obj"), "{error}");
    }
}

#[test]
fn text_and_binary_stl_are_read_and_truncated_stl_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::from("solid wedge\n");
    let mut binary = vec![b' '; 80];
    binary.extend(4_u32.to_le_bytes());
    for triangle in wedge() {
        text += "facet normal 0 0 0\n outer loop\n";
        binary.extend([0; 12]);
        for corner in &triangle {
            text += &format!("  vertex {:e} {} {}\n", corner.x, corner.y, corner.z);
            corner.iter().for_each(|x| binary.extend((*x as f32).to_le_bytes()));
        }
        text += " endloop\nendfacet\n";
        binary.extend([0; 2]);
    }
    text += "endsolid wedge\n";
    // Some exporters start a binary file with the first word of a text file.
    let mut solid = binary.clone();
    solid[..5].copy_from_slice(b"solid");
    for (name, bytes) in [("text.stl", text.as_bytes()), ("binary.stl", &binary), ("solid.stl", &solid)] {
        assert_is_the_wedge(&read_mesh(&write(&folder, name, bytes)).unwrap());
        assert_contained(&folder, &MESH.replace("NAME", name), WEDGE_M3);
    }
    assert!(read_mesh(&write(&folder, "cut.stl", &binary[..200])).is_err());
    assert!(read_mesh(&write(&folder, "cut_text.stl", &text.as_bytes()[..120])).is_err());
}

#[test]
fn collada_mesh_is_read_and_another_unit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let numbers: Vec<String> = CORNERS.iter().flatten().map(f64::to_string).collect();
    let indices: Vec<String> = FACES.iter().flatten().map(usize::to_string).collect();
    let text = format!(
        "<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\"><asset><unit meter=\"1\"/></asset><library_geometries><geometry><mesh><source id=\"p\">\
         <float_array id=\"a\" count=\"12\">{}</float_array></source><vertices id=\"v\"><input semantic=\"POSITION\" \
         source=\"#p\"/></vertices><triangles count=\"4\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/>\
         <p>{}</p></triangles></mesh></geometry></library_geometries></COLLADA>",
        numbers.join(" "),
        indices.join(" ")
    );
    let path = write(&folder, "wedge.dae", text.as_bytes());
    assert_is_the_wedge(&read_mesh(&path).unwrap());
    assert_contained(&folder, &MESH.replace("NAME", "wedge.dae"), WEDGE_M3);
    let polygons = text.replace("triangles", "polylist").replace("<p>", "<vcount>3 3 3 3</vcount><p>");
    assert_is_the_wedge(&read_mesh(&write(&folder, "polygons.dae", polygons.as_bytes())).unwrap());
    // The node's frame is turned by 90 deg about x and shifted, and the geometry is shifted back below it.
    let node = "<library_visual_scenes><visual_scene><node><translate>0 0 1</translate><rotate>1 0 0 90</rotate><node>\
                <matrix>1 0 0 0  0 0 1 -1  0 -1 0 0  0 0 0 1</matrix><instance_geometry url=\"#g\"/></node></node></visual_scene>\
                </library_visual_scenes></COLLADA>";
    let placed = text.replace("<geometry>", "<geometry id=\"g\">").replace("</COLLADA>", node);
    assert_is_the_wedge(&read_mesh(&write(&folder, "placed.dae", placed.as_bytes())).unwrap());
    let skewed = placed.replace("<matrix>", "<skew>45 0 1 0 1 0 0</skew><matrix>");
    assert!(read_mesh(&write(&folder, "skewed.dae", skewed.as_bytes())).unwrap_err().to_string().contains("<skew>"));
    let missing = text.replace("<p>0 ", "<p>4 ");
    assert!(read_mesh(&write(&folder, "missing.dae", missing.as_bytes())).is_err());
    let inches = text.replace("meter=\"1\"", "meter=\"0.0254\"");
    assert!(read_mesh(&write(&folder, "inches.dae", inches.as_bytes())).unwrap_err().to_string().contains("0.0254"));
}

#[test]
fn mesh_is_scaled_before_the_fit_and_unscaled_mm_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::new();
    CORNERS.iter().for_each(|[x, y, z]| text += &format!("v {} {} {}\n", x * 1e3, y * 1e3, z * 1e3));
    FACES.iter().for_each(|[a, b, c]| text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    write(&folder, "millimetres.obj", text.as_bytes());
    let mesh = MESH.replace("NAME", "millimetres.obj");
    assert_contained(&folder, &mesh.replace("/>", " scale=\"0.001 0.001 0.001\"/>"), WEDGE_M3);
    let urdf =
        format!("<robot name=\"r\"><link name=\"l\"><collision><geometry>{mesh}</geometry></collision></link></robot>");
    let robot = urdf_rs::read_from_string(&urdf).unwrap();
    let error = Scene::new(&robot, Some(folder.path()), &[]).points("l").unwrap_err().to_string();
    assert!(error.contains("millimetres.obj") && error.contains("10 m"), "{error}");
}

#[test]
fn capsules_contain_every_urdf_primitive() {
    let folder = tempfile::tempdir().unwrap();
    let pi = std::f64::consts::PI;
    let (r, l) = (0.05, 0.3);
    let cases = [
        ("<box size=\"0.1 0.2 0.3\"/>", 0.1 * 0.2 * 0.3),
        ("<cylinder radius=\"0.05\" length=\"0.3\"/>", pi * r * r * l),
        ("<sphere radius=\"0.05\"/>", 4.0 / 3.0 * pi * r * r * r),
        ("<capsule radius=\"0.05\" length=\"0.3\"/>", pi * r * r * (l + 4.0 / 3.0 * r)),
    ];
    for (geometry, volume_m3) in cases {
        assert_contained(&folder, geometry, volume_m3);
    }
}
