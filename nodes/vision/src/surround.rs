//! What is seen close round parts and is theirs: shadow, halo, gleam. Anything else there is in the gripper's way.
//!
//! The lamps stand still: all parts of a pose have the same round them, in the platen's directions, whatever their yaw, or
//! nearly so. What most parts of a frame share is theirs; where few lie, what the lesson showed counts.

use nalgebra::{Point2, Rotation2, Vector2};

use super::align::Fit;
use super::segment::{RELATIVE_UNITS, Segmentation};
use super::sought::Sought;
use super::view::View;
use feeder_model::camera::single;

/// Directions told apart, counter-clockwise from the platen's x, and distances from the outline, in pixels.
pub(super) const DIRECTIONS: usize = 24;
pub(super) const DISTANCES: usize = 16;
/// Parts that must show what is round them for a frame to tell.
pub(super) const SHOWN_MIN: usize = 4;
/// Where light falls as it did, parts differ from each other by so many of the lesson's usual deviations at least, 1.7 standard
/// deviations of a normal one: how they lie counts for more than how bright they are.
const KNOWN_SCATTERS: f32 = 2.5;
/// What lies nearer to the outline than this belongs to it, px: the lens blurs, and the fit errs.
const BLURRED_PX: f64 = 1.5;
/// Share of what tells that must show a part no higher: what else lies there shades too, the part or its like.
const AGREEING_SHARE: f32 = 0.6;
/// Sum of the squares, relative to the plateau's brightness, of what cells would differ by were a part half as high, from which on that
/// tells: with noise of 0.1 in each cell it is known to 0.45.
const TELLING_MIN: f32 = 0.05;
/// By so much of the plateau's brightness parts differ in a cell at least.
const SCATTER_MIN: f32 = 0.03;

/// Brightness round a part relative to the plateau's, by direction and distance.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Surround {
    /// Middle, and the middle of the deviations from it; row by row of distances.
    cells: Vec<(f32, f32)>,
}

/// Brightness round one part, for each cell that shows plateau.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    cells: Vec<Option<f32>>,
}

impl Sample {
    /// What lies round a part; `taken` tells whether a pixel of the window belongs to another.
    pub(super) fn new(
        frame: &Segmentation,
        view: &View,
        sought: &Sought,
        fit: &Fit,
        taken: impl Fn(usize) -> bool,
    ) -> Self {
        let mut cells = vec![None; DIRECTIONS * DISTANCES];
        let floor_m = view.tray.plateau_height_m();
        let middle = view.pixel(fit.centre, floor_m);
        let Some((middle, px_from_tray)) = middle.zip(view.px_from_tray(fit.centre, floor_m)) else {
            return Self { cells };
        };
        let corner = Vector2::new(frame.window.left as f64, frame.window.top as f64);
        for direction in 0..DIRECTIONS {
            let on_platen_rad = std::f64::consts::TAU * direction as f64 / DIRECTIONS as f64;
            let in_tray_rad = on_platen_rad - view.platen_from_tray.rotation.angle();
            let along = Rotation2::new(in_tray_rad) * Vector2::x();
            let edge_m = exit_m(sought, along, fit.yaw_rad);
            for distance in 0..DISTANCES {
                let place = along * (edge_m + (distance as f64 + 0.5) * sought.m_per_px);
                let pixel = (middle - corner + px_from_tray * place).map(single);
                let Some((level, index)) = frame.relative_near(pixel.x, pixel.y) else { continue };
                if frame.bins[index] != 0 && !taken(index) {
                    cells[distance * DIRECTIONS + direction] = Some(level / RELATIVE_UNITS - frame.wall_shade(index));
                }
            }
        }
        Self { cells }
    }
}

/// What parts have round them.
#[derive(Clone, Debug, Default)]
pub(super) struct Samples {
    /// For each cell a brightness for each part that shows it.
    cells: Vec<Vec<f32>>,
}

impl Samples {
    /// Adds what lies round a part.
    pub(super) fn add(&mut self, sample: &Sample) {
        self.cells.resize_with(DIRECTIONS * DISTANCES, Vec::new);
        for (levels, level) in self.cells.iter_mut().zip(&sample.cells) {
            levels.extend(*level);
        }
    }

    /// What the parts share, where so many show it.
    pub(super) fn told(mut self, shown_min: usize) -> Told {
        self.cells.resize_with(DIRECTIONS * DISTANCES, Vec::new);
        let cell = |levels: &mut Vec<f32>| {
            if levels.len() < shown_min {
                return None;
            }
            levels.sort_by(f32::total_cmp);
            let middle = levels[levels.len() / 2];
            // The usual deviation: of neighbours that a few of them have there it takes no notice.
            levels.iter_mut().for_each(|level| *level = (*level - middle).abs());
            levels.sort_by(f32::total_cmp);
            Some((middle, levels[levels.len() / 2]))
        };
        Told { cells: self.cells.iter_mut().map(cell).collect() }
    }
}

/// What parts have round them that they share.
#[derive(Clone, Debug)]
pub(super) struct Told {
    /// As in [`Surround`], of the cells that enough parts show.
    cells: Vec<Option<(f32, f32)>>,
}

impl Told {
    /// This, and elsewhere what is `known` beforehand.
    pub(super) fn or(&self, known: &Surround) -> Surround {
        let cell = |(index, told): (usize, &Option<(f32, f32)>)| {
            told.or_else(|| known.cells.get(index).copied()).unwrap_or_default()
        };
        Surround { cells: self.cells.iter().enumerate().map(cell).collect() }
    }

    /// The same of a frame, in light that falls as it did when the part was taught or otherwise.
    pub(super) fn of_frame(&self, known: &Surround, light_as_taught: bool) -> Surround {
        let mut shared = self.or(known);
        if light_as_taught {
            let cells = shared.cells.iter_mut().zip(&known.cells).zip(&self.cells);
            for (((_, scatter), (_, known)), _) in cells.filter(|(_, told)| told.is_some()) {
                *scatter = scatter.max(KNOWN_SCATTERS * known);
            }
        }
        shared
    }

    /// How high a part seems at most by its shade: 1 as high as those that share this, 0 half as high. `None` where that has too
    /// little shade to tell.
    pub(super) fn height_seen(&self, sample: &Sample) -> Option<f32> {
        // Beyond its reach there is no shade.
        let cell = |distance: usize, direction: usize| {
            self.cells.get(distance * DIRECTIONS + direction).copied().unwrap_or(Some((0.0, 0.0)))
        };
        let told = |(index, level): (usize, &Option<f32>)| {
            let (distance, direction) = (index / DIRECTIONS, index % DIRECTIONS);
            let level = level.filter(|_| distance as f64 + 0.5 > BLURRED_PX)?;
            let (middle, scatter) = cell(distance, direction)?;
            // What is half as high shades half as far.
            let half = 0.5 * (cell(2 * distance, direction)?.0 + cell(2 * distance + 1, direction)?.0);
            let differs = middle - half;
            (differs != 0.0).then(|| ((level - half) / differs, differs, scatter))
        };
        let mut told: Vec<(f32, f32, f32)> = sample.cells.iter().enumerate().filter_map(told).collect();
        if told.iter().map(|(_, differs, _)| differs * differs).sum::<f32>() < TELLING_MIN {
            return None;
        }
        told.sort_by(|a, b| a.0.total_cmp(&b.0));
        let weight = |(_, differs, scatter): &(f32, f32, f32)| differs.abs() / scatter.hypot(SCATTER_MIN);
        let most = AGREEING_SHARE * told.iter().map(weight).sum::<f32>();
        let mut below = 0.0;
        told.iter().find_map(|cell| {
            below += weight(cell);
            (below >= most).then_some(cell.0)
        })
    }
}

impl Surround {
    /// From the middles and scatters of all cells.
    pub(super) fn new(levels: &[f32], scatter: &[f32]) -> Self {
        Self { cells: levels.iter().copied().zip(scatter.iter().copied()).collect() }
    }

    /// Middles and scatters of all cells.
    pub(super) fn planes(&self) -> (Vec<f32>, Vec<f32>) {
        self.cells.iter().copied().unzip()
    }

    /// How dark and how bright a point of the tray frame may be because a part lies so, by so many of the usual deviations:
    /// (0, 0) beyond its reach.
    pub(super) fn range(
        &self,
        view: &View,
        sought: &Sought,
        (centre, yaw_rad): (Point2<f64>, f64),
        point: Point2<f64>,
        scatters: f32,
    ) -> (f32, f32) {
        let from_centre = point - centre;
        let radius_m = from_centre.norm();
        let along = if radius_m > 0.0 { from_centre / radius_m } else { Vector2::x() };
        let beyond_px = (radius_m - exit_m(sought, along, yaw_rad)) / sought.m_per_px;
        if beyond_px >= DISTANCES as f64 {
            return (0.0, 0.0);
        }
        if beyond_px <= BLURRED_PX {
            return (f32::NEG_INFINITY, f32::INFINITY);
        }
        let on_platen_rad = along.y.atan2(along.x) + view.platen_from_tray.rotation.angle();
        let turns = (on_platen_rad / std::f64::consts::TAU).rem_euclid(1.0) * DIRECTIONS as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, and small")]
        let (direction, distance) = (turns.round() as usize % DIRECTIONS, beyond_px as usize);
        let (mut low, mut high) = (0.0_f32, 0.0_f32);
        for row in distance.saturating_sub(1)..(distance + 2).min(DISTANCES) {
            for column in [direction + DIRECTIONS - 1, direction, direction + 1] {
                let (middle, scatter) = self.cells[row * DIRECTIONS + column % DIRECTIONS];
                low = low.min(middle - scatters * scatter);
                high = high.max(middle + scatters * scatter);
            }
        }
        (low, high)
    }
}

/// How far from its centre a direction of the tray frame leaves the outline of a part turned by a yaw, m.
fn exit_m(sought: &Sought, along: Vector2<f64>, yaw_rad: f64) -> f64 {
    let along = Rotation2::new(-yaw_rad) * along;
    let outline = &sought.outline_m;
    let crossing = |(index, from): (usize, &Point2<f64>)| {
        let edge = outline[(index + 1) % outline.len()] - from;
        let outwards = Vector2::new(edge.y, -edge.x);
        let steep = outwards.dot(&along);
        (steep > 0.0).then(|| outwards.dot(&from.coords) / steep)
    };
    // The outline is convex: the nearest of its edges' lines that the ray meets is the one it leaves by.
    outline.iter().enumerate().filter_map(crossing).fold(sought.radius_m, f64::min).max(0.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry2;

    use super::*;
    use crate::SelectorConfig;
    use crate::detector::Detector;
    use crate::modes::MODES;
    use crate::tests::recognition::IN_ANY_LIGHT;
    use crate::tests::{camera, empty_tray, over_camera};
    use feeder_model::camera::MountedTray;
    use feeder_model::tray::TrayGeometry;

    /// As every cell.
    fn alike(middle: f32, scatter: f32) -> Surround {
        Surround::new(&[middle; DIRECTIONS * DISTANCES], &[scatter; DIRECTIONS * DISTANCES])
    }

    /// Brightness that parts show in the first cells.
    fn shown(cells: &[&[f32]]) -> Samples {
        Samples { cells: cells.iter().map(|levels| levels.to_vec()).collect() }
    }

    #[test]
    fn what_enough_parts_show_is_shared_and_elsewhere_what_was_known_holds() {
        let shared = shown(&[&[0.5, -0.1, 0.1, 0.0], &[0.1, 0.2, 0.3]]).told(4).or(&alike(-0.2, 0.05));
        let (middles, scatters) = shared.planes();
        // The middle one above the middle, and the usual deviation from it: the one that is far off counts for no more.
        assert_eq!((middles[0], scatters[0]), (0.1, 0.2));
        assert_eq!((middles[1], scatters[1]), (-0.2, 0.05));
        assert_eq!((middles.len(), middles[DIRECTIONS * DISTANCES - 1]), (DIRECTIONS * DISTANCES, -0.2));
        // Nothing was known.
        assert_eq!(shown(&[]).told(1).or(&Surround::new(&[], &[])), alike(0.0, 0.0));
    }

    #[test]
    fn in_the_light_taught_parts_of_a_frame_differ_by_what_they_did_in_the_lesson_at_least() {
        let samples = || shown(&[&[0.125; 4], &[-0.375, -0.125, 0.125, 0.375], &[0.125; 3]]);
        let known = alike(-0.25, 0.031_25);
        let scatters = |light_as_taught: bool| samples().told(SHOWN_MIN).of_frame(&known, light_as_taught).planes().1;
        assert_eq!(scatters(true)[..3], [0.078_125, 0.25, 0.031_25]);
        assert_eq!(scatters(false)[..3], [0.0, 0.25, 0.031_25]);
        // Four parts tell, three do not.
        assert_eq!(samples().told(SHOWN_MIN).of_frame(&known, true).planes().0[..3], [0.125, 0.125, -0.25]);
    }

    #[test]
    fn a_part_may_shade_what_is_beyond_its_blurred_edge_and_within_reach_in_that_direction_of_the_platen() {
        let (camera, tray) = (camera(), MountedTray::new(TrayGeometry::PAPER));
        let sought = &IN_ANY_LIGHT.sought[0];
        // Dark towards the platen's x from the third pixel on, bright towards its y.
        let (mut levels, mut scatters) = (vec![0.0; DIRECTIONS * DISTANCES], vec![0.0; DIRECTIONS * DISTANCES]);
        (levels[3 * DIRECTIONS], scatters[3 * DIRECTIONS]) = (-0.3, 0.05);
        (levels[8 * DIRECTIONS + DIRECTIONS / 4], scatters[8 * DIRECTIONS + DIRECTIONS / 4]) = (0.25, 0.125);
        let surround = Surround::new(&levels, &scatters);
        let centre = Point2::new(0.01, -0.06);
        let range_of = |surround: &Surround, turn_rad: f64, direction_rad: f64, beyond_px: f64| {
            let platen_from_tray = Isometry2::new(Vector2::new(0.3, 0.3), turn_rad);
            let view = View { camera: &camera, tray: &tray, platen_from_tray };
            let along = Rotation2::new(direction_rad) * Vector2::x();
            let place = centre + along * (exit_m(sought, along, 0.0) + beyond_px * sought.m_per_px);
            surround.range(&view, sought, (centre, 0.0), place, 2.0)
        };
        let range =
            |turn_rad: f64, direction_rad: f64, beyond_px: f64| range_of(&surround, turn_rad, direction_rad, beyond_px);
        let anything = (f32::NEG_INFINITY, f32::INFINITY);
        let dark = (-0.4, 0.0);
        assert_eq!([range(0.0, 0.0, -1.0), range(0.0, 0.0, 1.4)], [anything; 2]);
        // A cell and those that touch it.
        assert_eq!(
            [1.6, 2.5, 3.5, 4.9, 5.1].map(|beyond_px| range(0.0, 0.0, beyond_px)),
            [(0.0, 0.0), dark, dark, dark, (0.0, 0.0)]
        );
        let step_rad = std::f64::consts::TAU / DIRECTIONS as f64;
        assert_eq!(
            [-2.0, -1.0, 1.0, 2.0].map(|steps| range(0.0, steps * step_rad, 3.5)),
            [(0.0, 0.0), dark, dark, (0.0, 0.0)]
        );
        let quarter_rad = std::f64::consts::FRAC_PI_2;
        assert_eq!(range(0.0, quarter_rad, 8.5), (0.0, 0.5));
        // The lamps stand still while the tray turns.
        assert_eq!(range(quarter_rad, -quarter_rad, 3.5), dark);
        assert_eq!(range(quarter_rad, 0.0, 8.5), (0.0, 0.5));
        // The last cells reach to the end.
        let far = alike(-0.1, 0.0);
        let at = |beyond_px: f64| range_of(&far, 0.0, 0.0, beyond_px);
        assert_eq!([at(DISTANCES as f64 - 0.1), at(DISTANCES as f64 + 0.1)], [(-0.1, 0.0), (0.0, 0.0)]);
    }

    /// What shows this brightness in all directions.
    fn showing(level: impl Fn(usize) -> Option<f32>) -> Sample {
        Sample { cells: (0..DIRECTIONS * DISTANCES).map(|cell| level(cell / DIRECTIONS)).collect() }
    }

    #[test]
    fn a_thing_is_as_high_as_those_whose_shade_is_as_long_whatever_else_shades_a_third_of_it() {
        let shade = |length_px: f32| move |distance: usize| ((distance as f32 + 0.5) / length_px - 1.0).min(0.0) * 0.2;
        let [whole, half] = [8.0, 4.0].map(|length_px| showing(move |distance| Some(shade(length_px)(distance))));
        let mut of_pose = Samples::default();
        [&whole, &whole, &whole].into_iter().for_each(|sample| of_pose.add(sample));
        assert_eq!(of_pose.clone().told(SHOWN_MIN).height_seen(&whole), None, "three tell nothing");
        of_pose.add(&half);
        let told = of_pose.told(SHOWN_MIN);
        let height_of = |sample: &Sample| told.height_seen(sample).unwrap();
        let nearly = |height: f32, expected: f32| (height - expected).abs() < 0.02;
        assert!(nearly(height_of(&whole), 1.0) && nearly(height_of(&half), 0.0), "{}", height_of(&half));
        let mut beset = half.clone();
        for (cell, level) in beset.cells.iter_mut().enumerate() {
            if cell % DIRECTIONS < DIRECTIONS / 3 {
                *level = Some(-0.5);
            }
        }
        assert!(height_of(&beset) < 0.1, "{}", height_of(&beset));
        // Nothing near enough to the edge to be its blur, and nothing that a part does not show, tells.
        let blurred = showing(|distance| (distance < 2).then_some(-0.1));
        assert_eq!([blurred, showing(|_| None)].map(|sample| told.height_seen(&sample)), [None; 2]);
        // Where all have little shade.
        let faint = showing(|distance| Some(0.1 * shade(8.0)(distance)));
        let mut of_pose = Samples::default();
        (0..4).for_each(|_| of_pose.add(&faint));
        assert_eq!(of_pose.told(SHOWN_MIN).height_seen(&faint), None);
    }

    /// A rectangle of 4 x 2 mm.
    fn oblong() -> Sought {
        let corners = [(0.002, -0.001), (0.002, 0.001), (-0.002, 0.001), (-0.002, -0.001)];
        let mut sought = IN_ANY_LIGHT.sought[0].clone();
        sought.outline_m = corners.iter().map(|(x, y)| Point2::new(*x, *y)).collect();
        sought.radius_m = 0.003;
        sought
    }

    #[test]
    fn what_lies_round_a_part_is_sampled_from_its_edge_on_in_the_directions_of_the_platen() {
        let (mut detector, sought) = (IN_ANY_LIGHT.clone(), oblong());
        let (camera, tray) = (camera(), MountedTray::new(TrayGeometry::PAPER));
        let step_rad = std::f64::consts::TAU / DIRECTIONS as f64;
        // The tray is turned by two directions.
        let (turn_rad, yaw_rad) = (2.0 * step_rad, 0.3);
        let platen_from_tray = Isometry2::new(over_camera().translation.vector, turn_rad);
        let view = View { camera: &camera, tray: &tray, platen_from_tray };
        let floor_m = tray.plateau_height_m();
        // On the middle of the plateau, and a little from the outer wall.
        let [middle, outside] = [0.06, 0.0855].map(|radius_m| Point2::new(0.0, -radius_m));
        let sampled = |detector: &mut Detector, centre: Point2<f64>, taken: bool| {
            let mut image = empty_tray(&platen_from_tray);
            for (x, y, level) in image.enumerate_pixels_mut() {
                let pixel = Point2::new(f64::from(x), f64::from(y));
                let Some(from_centre) = view.tray_point(pixel, floor_m).map(|point| point - centre) else { continue };
                let on_platen_rad = from_centre.y.atan2(from_centre.x) + turn_rad;
                let beyond_px =
                    (from_centre.norm() - exit_m(&sought, from_centre.normalize(), yaw_rad)) / sought.m_per_px;
                // A dark patch towards the platen's x, and one nearer towards its y.
                let lies = |direction: f64, from_px: f64| {
                    (on_platen_rad - direction * step_rad).abs() < 1.5 * step_rad
                        && (from_px..from_px + 3.0).contains(&beyond_px)
                };
                if lies(0.0, 8.0) || lies(6.0, 4.0) {
                    level.0[0] = level.0[0] / 4 * 3;
                }
            }
            detector.look(&image, &platen_from_tray, SelectorConfig::default().contrast_min_levels).unwrap();
            let fit = Fit { centre, yaw_rad, cost: 0.0, evidence: 1.0, amounts: [0.0; MODES] };
            let mut samples = Samples::default();
            samples.add(&Sample::new(&detector.segmentation, &view, &sought, &fit, |_| taken));
            samples.told(1).or(&alike(1.0, 0.0)).planes().0
        };
        // From so many cells beyond its edge on, in one direction.
        let column =
            |direction: usize, from: usize| (from..DISTANCES).map(move |distance| distance * DIRECTIONS + direction);
        let levels = sampled(&mut detector, middle, false);
        for (direction, first) in [(0, 8.0), (6, 4.0)] {
            let darkness: Vec<f32> = column(direction, 1).map(|cell| -levels[cell]).collect();
            let total: f32 = darkness.iter().sum();
            let moment: f32 = darkness.iter().zip(1_u8..).map(|(dark, distance)| dark * f32::from(distance)).sum();
            // Three cells, a quarter darker: the middle one is the second.
            assert!((total - 0.75).abs() < 0.15, "{direction}: {darkness:?}");
            assert!((moment / total - (first + 1.0)).abs() < 0.5, "{direction}: {darkness:?}");
        }
        for direction in [3, 12, 18, 21] {
            let darkest = column(direction, 3).map(|cell| levels[cell]).fold(0.0, f32::min);
            assert!(darkest > -0.05, "{direction}: {darkest}");
        }
        // What belongs to another part tells nothing, nor does what is no plateau.
        assert_eq!(sampled(&mut detector, middle, true), vec![1.0; DIRECTIONS * DISTANCES]);
        let levels = sampled(&mut detector, outside, false);
        // The wall lies towards the tray's -y.
        let outwards = DIRECTIONS * 3 / 4 + 2;
        assert!(column(outwards, DISTANCES - 1).all(|cell| levels[cell] >= 1.0));
        // Its shade is its own.
        let round = outwards - 3..=outwards + 2;
        let shown =
            round.flat_map(|direction| column(direction, 3)).map(|cell| levels[cell]).filter(|level| *level < 1.0);
        let beside: Vec<f32> = shown.collect();
        let darkest = beside.iter().copied().fold(0.0, f32::min);
        assert!(beside.len() > 20 && darkest > -0.09, "{}: {darkest}", beside.len());
    }

    #[test]
    fn a_ray_leaves_a_part_by_its_edge() {
        let sought = oblong();
        let exit_mm = |direction_rad: f64, yaw_rad: f64| {
            1e3 * exit_m(&sought, Rotation2::new(direction_rad) * Vector2::x(), yaw_rad)
        };
        let quarter_rad = std::f64::consts::FRAC_PI_2;
        for (direction_rad, yaw_rad, expected_mm) in [
            (0.0, 0.0, 2.0),
            (quarter_rad, 0.0, 1.0),
            (2.0 * quarter_rad, 0.0, 2.0),
            (0.25_f64, 0.0, 2.0 / 0.25_f64.cos()),
            (-0.25, 0.25, 2.0 / 0.5_f64.cos().max(2.0 * 0.5_f64.sin())),
            (quarter_rad, quarter_rad, 2.0),
            (0.0, -quarter_rad, 1.0),
        ] {
            let found_mm = exit_mm(direction_rad, yaw_rad);
            assert!((found_mm - expected_mm).abs() < 1e-9, "{direction_rad}, {yaw_rad}: {found_mm}, not {expected_mm}");
        }
    }
}
