//! Bodies whose poses, mass and symmetry are known.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use proptest::prelude::*;

use super::*;

fn extruded(outline: Loop, holes: Vec<Loop>, z_m: [f64; 2]) -> Solid {
    Solid::Extruded { outline, holes, z_m, reflectance: None }
}

fn rectangle(x: f64, y: f64) -> Loop {
    Loop::Polygon(vec![[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]])
}

fn mesh(solids: Vec<Solid>) -> PartMesh {
    ShapeSpec::Solids(solids).mesh(0.5).unwrap()
}

fn block(x: f64, y: f64, z: f64) -> PartMesh {
    mesh(vec![extruded(rectangle(x, y), vec![], [0.0, z])])
}

fn cylinder(radius: f64, height: f64) -> PartMesh {
    mesh(vec![extruded(Loop::Circle { radius_m: radius, centre_m: [0.0; 2] }, vec![], [0.0, height])])
}

/// A plate with a wall along one side: no symmetry.
fn bracket() -> PartMesh {
    let hole = Loop::Circle { radius_m: 0.001, centre_m: [0.006, 0.0015] };
    mesh(vec![
        extruded(rectangle(0.008, 0.004), vec![hole], [0.0, 0.001]),
        extruded(rectangle(0.001, 0.004), vec![], [0.001, 0.005]),
    ])
}

/// A wheel with so many teeth, `depth_m` high, the first few of which are broken off.
fn gear(teeth: u32, depth_m: f64, broken: u32) -> PartMesh {
    let corner = |index: u32| {
        let is_tooth = index % 4 < 2 && index >= 4 * broken;
        let radius_m = if is_tooth { 0.004 } else { 0.004 - depth_m };
        let (sin, cos) = (2.0 * PI * f64::from(index) / f64::from(4 * teeth)).sin_cos();
        [radius_m * cos, radius_m * sin]
    };
    mesh(vec![extruded(Loop::Polygon((0..4 * teeth).map(corner).collect()), vec![], [0.0, 0.001])])
}

#[test]
fn verif_mass_properties_of_a_block() {
    let (x, y, z) = (0.004, 0.003, 0.002);
    let block = block(x, y, z);
    assert!((block.volume_m3() - x * y * z).abs() < 1e-18);
    let volume = x * y * z / 12.0;
    let expected = Vector3::new(y * y + z * z, x * x + z * z, x * x + y * y) * volume;
    assert!((block.inertia_per_density_m5() - Matrix3::from_diagonal(&expected)).norm() < 1e-9 * expected.norm());
    assert!((block.radius_m() - 0.5 * Vector3::new(x, y, z).norm()).abs() < 1e-15);
}

#[test]
fn verif_a_profile_and_an_outline_make_the_same_ring() {
    let profile_m = vec![[0.002, 0.0], [0.003, 0.0], [0.003, 0.001], [0.002, 0.001]];
    let turned = mesh(vec![Solid::Revolved { profile_m, reflectance: None }]);
    let hole = Loop::Circle { radius_m: 0.002, centre_m: [0.0; 2] };
    let cut = mesh(vec![extruded(Loop::Circle { radius_m: 0.003, centre_m: [0.0; 2] }, vec![hole], [0.0, 0.001])]);
    assert!((turned.volume_m3() - cut.volume_m3()).abs() < 1e-6 * cut.volume_m3());
    // 64 sides have 0.16 % less than the circle.
    let exact = PI * (0.003_f64.powi(2) - 0.002_f64.powi(2)) * 0.001;
    assert!((turned.volume_m3() / exact - 0.998_39).abs() < 1e-4);
}

#[test]
fn a_cone_touches_its_axis() {
    let profile_m = vec![[0.0, 0.003], [0.0, 0.0], [0.002, 0.0]];
    let cone = mesh(vec![Solid::Revolved { profile_m, reflectance: None }]);
    let exact = PI * 0.002_f64.powi(2) * 0.003 / 3.0;
    assert!((cone.volume_m3() / exact - 0.998_39).abs() < 1e-4);
    // The centre of mass lies at a quarter of the height.
    let lowest = cone.vertices().iter().map(|vertex| vertex.z).fold(f64::INFINITY, f64::min);
    assert!((lowest + 0.003 / 4.0).abs() < 1e-12);
}

#[test]
fn verif_a_block_has_three_poses_and_prefers_its_large_faces() {
    let poses = stable_poses(&block(0.004, 0.003, 0.002)).unwrap();
    let heights: Vec<f64> = poses.iter().map(|pose| pose.height_m).collect();
    assert_eq!(poses.len(), 3);
    assert!(heights.iter().zip([0.002, 0.003, 0.004]).all(|(a, b)| (a - b).abs() < 1e-12), "{heights:?}");
    assert!((poses.iter().map(|pose| pose.probability).sum::<f64>() - 1.0).abs() < 1e-9);
    for pose in &poses {
        assert_eq!((pose.yaw_symmetry, pose.up.len(), pose.rolls, pose.outline.round), (2, 2, false, false));
        assert!((pose.com_height_m - pose.height_m / 2.0).abs() < 1e-12);
    }
    assert!((poses[0].outline.area_m2() - 12e-6).abs() < 1e-12);
    let (least, most) = poses[0].outline.width_range_m();
    assert!((least - 0.003).abs() < 1e-12 && (most - 0.005).abs() < 1e-12);
    // Lying flat, the shortest way over is over the long edge: 1.5 mm aside and 1 mm up.
    assert!((poses[0].tip_angle_rad - 1.5_f64.atan()).abs() < 1e-9);
}

#[test]
fn verif_a_cube_has_one_pose_of_probability_one() {
    let poses = stable_poses(&block(0.003, 0.003, 0.003)).unwrap();
    assert_eq!(poses.len(), 1);
    assert_eq!((poses[0].yaw_symmetry, poses[0].up.len()), (4, 6));
    assert!((poses[0].probability - 1.0).abs() < 1e-9);
}

#[test]
fn a_coin_lies_flat_and_looks_the_same_from_every_side() {
    let poses = stable_poses(&cylinder(0.003, 0.001)).unwrap();
    assert_eq!(poses.len(), 1, "{poses:?}");
    assert_eq!((poses[0].yaw_symmetry, poses[0].up.len()), (0, 2));
    assert!(poses[0].outline.round && (poses[0].outline.radius_m - 0.003).abs() < 1e-9);
}

#[test]
fn a_rod_rolls_on_its_side() {
    let poses = stable_poses(&cylinder(0.001, 0.006)).unwrap();
    assert!(poses[0].rolls && poses[0].up.len() == 64, "{poses:?}");
    assert_eq!(poses[0].yaw_symmetry, 2);
    assert!(poses[0].probability > 0.9);
}

#[test]
fn a_mark_tells_the_faces_of_a_coin_apart() {
    let disc = |from: f64, to: f64, reflectance| Solid::Extruded {
        outline: Loop::Circle { radius_m: 0.003, centre_m: [0.0; 2] },
        holes: vec![],
        z_m: [from, to],
        reflectance: Some(reflectance),
    };
    let poses = stable_poses(&mesh(vec![disc(0.0, 0.0005, 0.3), disc(0.0005, 0.001, 0.6)])).unwrap();
    assert_eq!(poses.len(), 2);
    assert!((poses[0].probability - 0.5).abs() < 1e-6);
    assert!(poses.iter().all(|pose| pose.yaw_symmetry == 0));
}

#[test]
fn a_hexagon_has_six_yaws_and_a_bracket_one() {
    let hexagon = Loop::Regular { sides: 6, inradius_m: 0.00275, centre_m: [0.0; 2] };
    let bore = Loop::Circle { radius_m: 0.00125, centre_m: [0.0; 2] };
    let nut = stable_poses(&mesh(vec![extruded(hexagon, vec![bore], [0.0, 0.0024])])).unwrap();
    assert_eq!(nut[0].yaw_symmetry, 6);
    assert!(!nut[0].outline.round);
    let bracket = stable_poses(&bracket()).unwrap();
    assert!(bracket.len() >= 3, "{}", bracket.len());
    assert!(bracket.iter().all(|pose| pose.yaw_symmetry == 1 && pose.up.len() == 1));
}

#[test]
fn a_ball_has_no_stable_pose() {
    let arc = (0..=24).map(|step| {
        let angle = PI * (f64::from(step) / 24.0 - 0.5);
        [0.003 * angle.cos().max(0.0), 0.003 * angle.sin()]
    });
    let mut profile_m: Vec<[f64; 2]> = arc.collect();
    (profile_m[0][0], profile_m[24][0]) = (0.0, 0.0);
    let ball = mesh(vec![Solid::Revolved { profile_m, reflectance: None }]);
    assert_eq!(stable_poses(&ball).unwrap_err(), PoseError::RollsEverywhere);
}

fn tetrahedron() -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let corners = [[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0], [0.0, 0.0, 1e-3]];
    (corners.map(Point3::from).to_vec(), vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
}

#[test]
fn what_is_no_body_is_refused_and_named() {
    let complaint = |change: fn(&mut Vec<Point3<f64>>, &mut Vec<[u32; 3]>)| {
        let (mut vertices, mut triangles) = tetrahedron();
        change(&mut vertices, &mut triangles);
        let shares = vec![0.5; triangles.len()];
        PartMesh::new(vertices, triangles, shares).unwrap_err()
    };
    assert!(matches!(complaint(|_, triangles| triangles.clear()), MeshError::Empty { triangles: 0, .. }));
    assert!(matches!(complaint(|_, triangles| triangles.truncate(3)), MeshError::Open { edges: 3, .. }));
    assert!(matches!(complaint(|_, t| t[3].swap(0, 1)), MeshError::PartlyInverted { edges: 3, .. }));
    let inverted = complaint(|_, triangles| triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1)));
    assert!(matches!(inverted, MeshError::Inverted { volume_m3 } if volume_m3 < 0.0));
    let flat = complaint(|vertices, _| vertices[3].z = 0.0);
    assert!(matches!(flat, MeshError::Empty { triangles: 4, .. }), "{flat}");
    assert!(matches!(complaint(|v, _| v[1].x = f64::NAN), MeshError::BadVertex { vertex: 1, .. }));
    assert!(matches!(complaint(|_, t| t[0][0] = 9), MeshError::BadVertex { vertex: 9, triangle: 0 }));
    let (vertices, triangles) = tetrahedron();
    let dark = PartMesh::new(vertices, triangles, vec![0.5, 0.5, 1.5, 0.5]).unwrap_err();
    assert_eq!(dark, MeshError::BadReflectance { found: 3, triangles: 4 });
}

#[test]
fn numbers_out_of_range_are_named() {
    let complaint = |solid: Solid| ShapeSpec::Solids(vec![solid]).mesh(0.5).unwrap_err().to_string();
    let circle = |radius_m: f64| Loop::Circle { radius_m, centre_m: [0.0; 2] };
    assert_eq!(
        complaint(extruded(circle(-0.001), vec![], [0.0, 0.001])),
        "radius_m = -0.001 is outside its range: above 0 and finite"
    );
    assert!(complaint(extruded(circle(0.001), vec![], [0.0, 0.0])).starts_with("z_m = 0 is outside"));
    let line = Loop::Polygon(vec![[0.0, 0.0], [0.001, 0.0], [0.002, 0.0]]);
    assert!(complaint(extruded(line, vec![], [0.0, 0.001])).starts_with("polygon = 0 is outside"));
    let profile_m = vec![[-0.001, 0.0], [0.001, 0.0], [0.001, 0.001]];
    let crossing = complaint(Solid::Revolved { profile_m, reflectance: None });
    assert_eq!(crossing, "profile_m = -0.001 is outside its range: radii of 0 or more");
}

#[test]
fn stl_files_are_read_in_their_unit_and_rubbish_is_refused() {
    let (vertices, triangles) = tetrahedron();
    let mut text = String::from("solid corner\n");
    for triangle in &triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for &index in triangle {
            let vertex = vertices[index as usize] * 1e3;
            text += &format!("vertex {} {} {}\n", vertex.x, vertex.y, vertex.z);
        }
        text += "endloop\nendfacet\n";
    }
    text += "endsolid corner\n";
    let stl = || ShapeSpec::Stl { file: "corner.stl".to_owned(), unit_m: 1e-3 };
    assert_eq!(stl().mesh(0.5).unwrap_err(), ShapeError::NotRead { file: "corner.stl".to_owned() });
    let mut shape = stl();
    shape.read_stl(text.as_bytes()).unwrap();
    let mesh = shape.mesh(0.5).unwrap();
    assert_eq!((mesh.vertices().len(), mesh.triangles().len()), (4, 4));
    assert!((mesh.volume_m3() - 1e-9 / 6.0).abs() < 1e-15);
    for rubbish in [&b""[..], b"solid", b"\x00\x01\x02", &[7; 200]] {
        let mut shape = stl();
        assert!(shape.read_stl(rubbish).is_err() || shape.mesh(0.5).is_err());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Whatever way the part was drawn, its poses are the same.
    #[test]
    fn poses_do_not_depend_on_the_frame(axis in prop::array::uniform3(-3.0..3.0_f64), shift in -0.01..0.01_f64) {
        let bracket = bracket();
        let turn = Rotation3::from_scaled_axis(Vector3::from(axis));
        let vertices = bracket.vertices().iter().map(|v| turn * v + Vector3::repeat(shift)).collect();
        let turned = PartMesh::new(vertices, bracket.triangles().to_vec(), bracket.reflectance().to_vec()).unwrap();
        let (here, there) = (stable_poses(&bracket).unwrap(), stable_poses(&turned).unwrap());
        prop_assert_eq!(here.len(), there.len());
        for (a, b) in here.iter().zip(&there) {
            prop_assert!((a.probability - b.probability).abs() < 1e-6);
            prop_assert!((a.height_m - b.height_m).abs() < 1e-9);
            prop_assert!((a.outline.area_m2() - b.outline.area_m2()).abs() < 1e-12);
            prop_assert_eq!(a.yaw_symmetry, b.yaw_symmetry);
            prop_assert!((turn * a.up[0] - b.up[0]).norm() < 1e-6);
        }
    }

    /// A wheel looks the same as often as it has teeth, and one that lacks a tooth does once.
    #[test]
    fn a_wheel_has_as_many_yaws_as_teeth(teeth in 5_u32..48, depth_m in 0.000_2..0.000_6_f64) {
        let yaws = |broken| stable_poses(&gear(teeth, depth_m, broken)).unwrap()[0].yaw_symmetry;
        prop_assert_eq!((yaws(0), yaws(1)), (teeth, 1));
    }

    /// A part lies on its lowest points, and these surround its centre of mass.
    #[test]
    fn a_pose_stands_on_the_floor(x in 0.001..0.01_f64, y in 0.001..0.01_f64, z in 0.001..0.01_f64) {
        let block = block(x, y, z);
        for pose in stable_poses(&block).unwrap() {
            let lying: Vec<_> = block.vertices().iter().map(|vertex| pose.orientation * vertex).collect();
            let lowest = lying.iter().map(|point| point.z).fold(f64::INFINITY, f64::min);
            prop_assert!((lowest + pose.com_height_m).abs() < 1e-9);
            let foot = Outline::around(lying.iter().filter(|p| p.z < lowest + 1e-7).map(Point3::xy));
            prop_assert!(foot.area_m2() > 0.0);
            prop_assert!(pose.tip_angle_rad > 0.0);
        }
    }
}
