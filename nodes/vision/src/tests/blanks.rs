//! Things of a part's shape without its figure.

use super::*;
use feeder_model::geometry::{ShapeSpec, stable_poses};

/// A coin as it comes from the press: without head and figure, as bright as `reflectance` all over.
fn blank_coin(reflectance: f64) -> PartSolid {
    let rim = [
        [0.0, 0.0],
        [0.0027, 0.0],
        [0.0027, -0.00015],
        [0.003, -0.00015],
        [0.003, 0.00095],
        [0.0027, 0.00095],
        [0.0027, 0.0008],
        [0.0, 0.0008],
    ];
    let shape: ShapeSpec =
        serde_json::from_value(serde_json::json!({ "solids": [{ "revolved": { "profile_m": rim } }] })).unwrap();
    let mesh = shape.mesh(reflectance).unwrap();
    let poses = stable_poses(&mesh).unwrap();
    PartSolid::new(mesh, &poses)
}

/// Of things strewn in a picture for each of these poses: how many there are, and how many the selector for coins would pick.
fn picked(things: &Scene, poses: &[usize], seed: u64) -> (usize, usize) {
    let coin = catalogue("coin");
    let config = SelectorConfig { wanted_poses: coin.wanted_poses.clone(), ..SelectorConfig::default() };
    let mut selector = Selector::new(config, &things.camera, &things.tray, &COIN).unwrap();
    let mut renderer = Renderer::new(things).unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (mut count, mut admitted) = (0, 0);
    for pose in poses {
        let laid = strewn(&coin, Some(*pose), 18, 2.0 * coin.outline_radius_m() + 0.003, &mut random);
        let image = shoot(&mut renderer, &over_camera(), &laid, &mut random);
        let seen = selector.detect(&image, &over_camera()).unwrap();
        count += laid.len();
        admitted += seen.iter().filter(|candidate| selector.admits(candidate)).count();
    }
    (count, admitted)
}

#[test]
fn a_blank_is_no_coin_however_bright_and_whatever_the_noise() {
    let coin = catalogue("coin");
    let mut taken = Vec::new();
    for sigma in [2.0, 4.0, 8.0, 12.0] {
        let coins = scene(&coin, sigma);
        let (count, right) = picked(&coins, &[0, 1], 5);
        assert!(10 * right >= 9 * count, "{right} of {count} coins at noise {sigma}");
        for (seed, reflectance) in [(5, 0.2), (6, 0.25), (7, 0.3)] {
            let blanks = Scene { part: blank_coin(reflectance), ..scene(&coin, sigma) };
            let (count, wrong) = picked(&blanks, &[0, 0], seed);
            if wrong > 0 {
                taken.push(format!("{wrong} of {count} that send back {reflectance}, at noise {sigma}"));
            }
        }
    }
    assert!(taken.is_empty(), "{taken:?}");
}
