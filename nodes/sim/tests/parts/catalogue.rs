//! The part files that come with the feeder, and bad ones.

use feeder_model::part::{PartSpec, PartType};
use feeder_scenario::{PartSource, catalogue_names};
use nalgebra::Vector3;

use crate::support::{part, spec};

#[test]
fn every_part_of_the_catalogue_lies_in_poses_that_add_up() {
    assert!(catalogue_names().len() >= 6);
    for name in catalogue_names() {
        let part = part(name);
        assert_eq!(part.name, name);
        for probabilities in part.dropoff.iter().chain([&part.poured]) {
            assert_eq!(probabilities.len(), part.poses.len());
            assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-6, "{name}");
        }
        for pose in &part.poses {
            // It stands on the floor, and its silhouette surrounds its centre of mass.
            let heights = part.mesh.vertices().iter().map(|vertex| (pose.orientation * vertex).z);
            let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
            assert!((low + pose.com_height_m).abs() < 1e-3 * pose.height_m, "{name}/{}", pose.name);
            assert!((high - low - pose.height_m).abs() < 1e-3 * pose.height_m, "{name}/{}", pose.name);
            assert!((pose.orientation * pose.up[0] - Vector3::z()).norm() < 1e-9, "{name}/{}", pose.name);
        }
    }
}

#[test]
fn yaw_means_what_the_shape_says() {
    let symmetry = |name: &str| part(name).poses[0].yaw_symmetry;
    assert_eq!(["coin", "grommet", "block", "hex_nut", "cap", "bracket", "clip"].map(symmetry), [1, 0, 2, 6, 0, 1, 1],);
}

fn complaint(change: impl FnOnce(&mut PartSpec)) -> String {
    let mut spec = spec(0.006, 0.2);
    change(&mut spec);
    PartType::new(&spec).map_or_else(|error| error.to_string(), |_| "accepted".to_owned())
}

#[test]
fn errors_name_part_key_value_and_allowed_range() {
    for (message, expected) in [
        (
            complaint(|spec| spec.friction_kinetic = 0.25),
            "part \"disc\": friction_static = 0.2 is outside its range: at least friction_kinetic = 0.25, and finite",
        ),
        (
            complaint(|spec| spec.friction_static = 0.0),
            "part \"disc\": friction_static = 0 is outside its range: at least friction_kinetic = 0.2, and finite",
        ),
        (
            complaint(|spec| spec.density_kg_m3 = f64::NAN),
            "part \"disc\": density_kg_m3 = NaN is outside its range: above 0 and finite",
        ),
        (
            complaint(|spec| spec.poses.push(spec.poses[0].clone())),
            "part \"disc\": poses: \"up\" names a pose that has a name already, allowed is one name for each",
        ),
        (
            complaint(|spec| spec.wanted_poses = vec!["edge".to_owned()]),
            "part \"disc\": wanted_poses = [\"edge\"], allowed are one or more of [\"up\", \"pose_1\"]",
        ),
        (
            complaint(|spec| spec.wanted_poses.clear()),
            "part \"disc\": wanted_poses = [], allowed are one or more of [\"up\", \"pose_1\"]",
        ),
    ] {
        assert_eq!(message, expected);
    }
    assert!(
        complaint(|spec| spec.poses[0].up = [1.0, 0.0, 0.0]).contains("\"up\" with up = [1.0, 0.0, 0.0] is no stable")
    );
    assert!(complaint(|spec| spec.poses[0].up = [0.0; 3]).contains("is no stable pose"));
}

#[test]
fn drop_data_of_another_part_are_refused() {
    let mut changed = PartSource::Name("coin".to_owned()).spec().unwrap();
    assert!(changed.drops.is_some(), "the catalogue holds drop data");
    changed.friction_static = 0.3;
    let error = PartType::new(&changed).unwrap_err().to_string();
    assert!(error.contains("drops: fingerprint do not belong to this part"), "{error}");
    let mut lost = PartSource::Name("coin".to_owned()).spec().unwrap();
    lost.drops.as_mut().unwrap().dropoff[0][0] += 0.5;
    assert!(PartType::new(&lost).is_err());
}

#[test]
fn a_part_file_brings_its_mesh_along() {
    let yaml = "name: thing\ndensity_kg_m3: 1000\nfriction_static: 0.2\nfriction_kinetic: 0.2\nreflectance: 0.5\n\
                shape: { stl: { file: corner.stl } }\nwanted_poses: [pose_1]\n";
    let stl = "solid c\n".to_owned()
        + &[
            [[0, 0, 0], [0, 3, 0], [4, 0, 0]],
            [[0, 0, 0], [4, 0, 0], [0, 0, 5]],
            [[0, 0, 0], [0, 0, 5], [0, 3, 0]],
            [[4, 0, 0], [0, 3, 0], [0, 0, 5]],
        ]
        .map(|corners| {
            let lines = corners.map(|[x, y, z]| format!("vertex {x} {y} {z}\n")).concat();
            format!("facet normal 0 0 0\nouter loop\n{lines}endloop\nendfacet\n")
        })
        .concat()
        + "endsolid c\n";
    let load = |mesh: &str| {
        let mut source = PartSource::Name("parts/thing.yaml".to_owned());
        source
            .load(&mut |file| match file {
                "parts/thing.yaml" => Ok(yaml.as_bytes().to_vec()),
                "parts/corner.stl" => Ok(mesh.as_bytes().to_vec()),
                other => Err(format!("asked for {other}")),
            })
            .and_then(|()| source.part_type())
    };
    let part = load(&stl).unwrap();
    assert_eq!(part.mesh.triangles().len(), 4);
    assert!((part.mass_kg - 10e-6).abs() < 1e-12);
    // Without its last face, inside out, and without anything.
    let (open, _) = stl.rsplit_once("facet normal").unwrap();
    assert!(load(&format!("{open}endsolid c\n")).unwrap_err().to_string().contains("the mesh is open: 3 edges"));
    let inside_out = stl.replace("vertex 0 0 0\n", "").replace("outer loop\n", "outer loop\nvertex 0 0 0\n");
    assert!(load(&inside_out).is_err());
    assert!(load("solid c\nendsolid c\n").unwrap_err().to_string().contains("empty"));
    let unknown = PartSource::Name("nothing".to_owned()).part_type().unwrap_err().to_string();
    assert!(unknown.contains("\"nothing\" is no part of the catalogue (block, bracket"), "{unknown}");
}
