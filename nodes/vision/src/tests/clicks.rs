//! Parts pointed at in pictures.

use super::*;

#[test]
fn a_click_finds_the_part_that_it_is_near_and_none_further_away() {
    let scene = scene(&GROMMET, 2.0);
    let parts: [LaidPart; 9] = std::array::from_fn(|i| at([0.06, 0.07][i % 2], 3.6 + 0.25 * i as f64, 0));
    let image = simple_picture(&parts);
    let fitted = |beside_m: f64| {
        let clicks = parts.map(|part| click(&scene, &part, Vector2::new(0.0, beside_m)));
        let shown = ClickedPicture { image: &image, platen_from_tray: over_camera(), clicks: &clicks };
        fit_clicks(&[shown], &MODEL, &scene.camera, &scene.tray, 10.0).unwrap()
    };
    // However many clicks miss the same way, parts lie where they are seen.
    for (fit, part) in fitted(0.001_2).iter().zip(&parts) {
        assert!(fit.doubt.is_none() && (fit.part.unwrap().place - part.place).norm() < 0.000_1, "{fit:?}");
    }
    for fit in fitted(0.002_3) {
        assert_eq!((fit.part, fit.doubt), (None, Some(ClickDoubt::NotFound)));
    }
}

/// A click so far beside a part, saying in what pose that lies.
fn click(scene: &Scene, part: &LaidPart, beside_m: Vector2<f64>) -> Click {
    let height_m = scene.tray.plateau_height_m() + 0.5 * GROMMET.poses[part.pose].height_m;
    let clicked = over_camera() * (part.place + beside_m);
    let pixel = scene.camera.project(nalgebra::Point3::new(clicked.x, clicked.y, height_m)).unwrap();
    Click { pixel, label: ClickLabel::Pose(part.pose) }
}

#[test]
fn a_pose_of_which_most_parts_look_otherwise_than_drawn_stays_as_drawn_and_the_clicks_on_it_are_named() {
    let scene = scene(&GROMMET, 2.0);
    let radii_m = [0.045, 0.06, 0.075];
    let parts: Vec<LaidPart> = (0..18).map(|i| at(radii_m[i / 6], 3.5 + 0.45 * (i % 6) as f64, i % 2)).collect();
    let clicks: Vec<Click> = parts.iter().map(|part| click(&scene, part, Vector2::zeros())).collect();
    // Parts of the second pose, but for some of them, gleam: half of each is white.
    let lesson = |spared: usize| {
        let mut image = simple_picture(&parts);
        for gleaming in clicks.iter().filter(|click| click.label == ClickLabel::Pose(1)).skip(spared) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the picture")]
            let (x, y) = (gleaming.pixel.x as u32, gleaming.pixel.y as u32);
            (x..x + 11).for_each(|x| (y - 10..y + 11).for_each(|y| image.put_pixel(x, y, Luma([250]))));
        }
        let shown = [ClickedPicture { image: &image, platen_from_tray: over_camera(), clicks: &clicks }];
        teach_from_clicks(&shown, &[], &MODEL, &scene.camera, &scene.tray, 10.0).unwrap()
    };
    let told = |lesson: &ClickLesson, pose: usize| {
        let of_pose = lesson.fits.iter().filter(|fit| clicks[fit.click].label == ClickLabel::Pose(pose));
        of_pose.filter(|fit| fit.doubt == Some(ClickDoubt::NotAsDrawn)).count()
    };
    let pictures = |model: &PartModel, pose: usize| model.poses[pose].mean();
    for (spared, left_out) in [(4, 9), (5, 0)] {
        let lesson = lesson(spared);
        assert_eq!((told(&lesson, 0), told(&lesson, 1)), (0, left_out), "{spared}: {:?}", lesson.fits);
        let is_drawn = |pose: usize| pictures(&lesson.model, pose) == pictures(&MODEL, pose);
        assert_eq!((is_drawn(0), is_drawn(1)), (false, left_out > 0), "{spared}");
    }
    // Pictures of something else.
    let image = simple_picture(&[]);
    let shown = [ClickedPicture { image: &image, platen_from_tray: over_camera(), clicks: &clicks }];
    let refused = teach_from_clicks(&shown, &[], &MODEL, &scene.camera, &scene.tray, 10.0);
    assert!(matches!(refused, Err(TeachError::NothingAsDrawn { clicks: 18 })), "{refused:?}");
}
