//! Whether a frame can be trusted: what it shows of what was taught, and what it leaves unexplained.
//!
//! [`HealthWatch`] follows that from frame to frame: a hand in one of them is no trouble.

use std::collections::BTreeMap;
use std::fmt;

/// Share of the plateau that must be covered before anything is concluded from what is not recognised.
const COVERED_MIN: f64 = 0.004;
/// A frame that shows less of the plateau than this tells nothing of what is not recognised: many of the few parts in it are cut
/// by the picture's edge. So it is while the tray stands under a station beside the camera's field.
const IN_VIEW_MIN: f64 = 0.5;
/// Less of what lies there being explained than this is called blindness.
const EXPLAINED_MIN: f64 = 0.3;
/// More of the plateau than this quite black or quite white is clipped: sensors saturate in highlights, not on floors.
const CLIPPED_MAX: f64 = 0.02;
/// The light differs when hub and plateau have changed by more than this against each other: no lamp that stays does that.
/// Path-traced pictures differ by 1 % under lamps like the one taught and by 7 % under a low one.
const HUB_CHANGE_MAX: f64 = 0.05;
/// Or when it falls otherwise across the plateau by more than this: in sparse path-traced pictures that differs by 0.0001 to 0.0016
/// from what was taught under the same lamps, and by 0.0013 to 0.008 under others. (Where parts hide most of the plateau what was
/// taught counts instead, and the light passes for the same.)
const LIGHT_CHANGE_MAX: f64 = 0.002;
/// Parts are out of focus from this excess of blur's variance, px²: 1.2 px instead of 0.7.
const BLUR_EXCESS_MAX_PX2: f64 = 0.95;
/// Parts are seen in another size from this on. Other light alone makes up to 4.5 % in path-traced pictures, as shaded rims
/// look as if they belonged to the part; the calibration's watch sees less by the rim of the tray.
const SIZE_CHANGE_MAX: f64 = 0.06;

/// What a frame that looks as taught shows at least and at most. In rendered crowds under the light taught 0.86 to 1 is explained, in
/// path-traced pictures under a low lamp 0.2 to 0.6.
const EXPLAINED_AS_TAUGHT_MIN: f64 = 0.97;
/// Three of four parts of five kinds miss by 0.11 to 0.23 of what they may at least in pictures like those taught, by up to 0.31 in 98 of 100
/// of a tray that vibrates, and by 0.38 to 0.9 where a part is 3 % darker or brighter or the lens blurs by 1 px in place of 0.5.
const MISS_AS_TAUGHT_MAX: f64 = 0.33;
/// What lies beside most parts is no dirt but their shadow, from a lamp that stands elsewhere.
const BESET_AS_TAUGHT_MAX: f64 = 0.5;

/// A cause is in force from so many frames in a row on, until as many are without it.
const FRAMES_IN_A_ROW: u32 = 5;

/// What a frame is worth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameHealth {
    /// Share of the plateau that is in the picture, 0 to 1.
    pub in_view_ratio: f64,
    /// Share of that on which something lies, 0 to 1.
    pub covered_ratio: f64,
    /// Share of that which recognised parts, with their shadows, account for, 0 to 1; 1 where nothing lies.
    pub explained_ratio: f64,
    /// Brightness of the plateau over that when the part was taught.
    pub plateau_ratio: f64,
    /// The same of the hub's top; `None` where it is not seen.
    pub hub_ratio: Option<f64>,
    /// By how much the light falls otherwise across the plateau than when the part was taught, relative to its brightness: root
    /// of the mean square over the picture. `None` where the tray stands elsewhere than then, and light cannot be compared.
    pub light_change_ratio: Option<f64>,
    /// Share of the plateau's pixels that are quite black or quite white, 0 to 1.
    pub clipped_ratio: f64,
    /// By how much the parts recognised are more blurred than taught, as a variance, px²; `None` without any.
    pub blur_excess_px2: Option<f64>,
    /// By how much they are larger than taught, relative; `None` without any.
    pub size_excess_ratio: Option<f64>,
    /// What three of four parts recognised in a pose miss their template by at least, of what they may, in the pose that fits worst; 0
    /// where too few lie to tell.
    pub miss_ratio: f64,
    /// Share of the parts recognised to which something that belongs to no part leaves too little room; 0 where too few lie to tell.
    pub beset_ratio: f64,
    /// Whether two poses of the part, or two yaws, look alike in this light: then nothing is recognised in them.
    pub looks_alike: bool,
    /// Parts recognised.
    pub recognised: usize,
}

/// What makes a frame doubtful.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum HealthCause {
    /// Much lies on the plateau, and next to nothing of it is known.
    NothingRecognised,
    /// Two poses of the part, or two yaws, look alike in this light.
    LooksAlike,
    /// The light is another than the one taught.
    LightDiffers,
    /// The image is over- or under-exposed.
    Clipped,
    /// The lens is out of focus.
    Blurred,
    /// Parts are seen in another size: camera, lens or tray are not where they are believed to be, or it is another part.
    SizeDiffers,
}

impl fmt::Display for HealthCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NothingRecognised => "much of the plateau is covered or shaded, and nothing there is recognised",
            Self::LooksAlike => "the part looks alike in two poses or yaws, and is not recognised in them",
            Self::LightDiffers => "the light differs from the one taught",
            Self::Clipped => "the image is wrongly exposed: part of the plateau is quite black or quite white",
            Self::Blurred => "parts are blurred: the lens is out of focus",
            Self::SizeDiffers => "parts are seen in another size than taught: camera or part is another",
        })
    }
}

/// Whether the light is another than the one taught, by what [`FrameHealth`] tells of plateau, hub and change.
pub(super) fn light_differs(plateau_ratio: f64, hub_ratio: Option<f64>, change_ratio: f64) -> bool {
    let hub_change = hub_ratio.map_or(0.0, |hub| (hub / plateau_ratio.max(1e-3) - 1.0).abs());
    hub_change > HUB_CHANGE_MAX || change_ratio > LIGHT_CHANGE_MAX
}

impl FrameHealth {
    /// What makes the frame doubtful, the gravest first.
    #[must_use]
    pub fn causes(&self) -> Vec<HealthCause> {
        let beyond = |value: Option<f64>, most: f64| value.is_some_and(|value| value > most);
        let size_change = self.size_excess_ratio.map(f64::abs);
        let unexplained = self.covered_ratio > COVERED_MIN && self.explained_ratio < EXPLAINED_MIN;
        let blind = self.shows(HealthCause::NothingRecognised) && unexplained;
        [
            (HealthCause::NothingRecognised, blind),
            (HealthCause::LooksAlike, self.looks_alike),
            (HealthCause::Clipped, self.clipped_ratio > CLIPPED_MAX),
            (HealthCause::LightDiffers, self.light_differs()),
            (HealthCause::Blurred, beyond(self.blur_excess_px2, BLUR_EXCESS_MAX_PX2)),
            (HealthCause::SizeDiffers, beyond(size_change, SIZE_CHANGE_MAX)),
        ]
        .into_iter()
        .filter_map(|(cause, holds)| holds.then_some(cause))
        .collect()
    }

    /// Takes back that a part is recognised which has this share in what lies there.
    pub(super) fn unrecognise(&mut self, share: f64) {
        self.recognised = self.recognised.saturating_sub(1);
        // The shadows are theirs.
        self.explained_ratio = if self.recognised == 0 { 0.0 } else { (self.explained_ratio - share).max(0.0) };
    }

    /// Whether all looks as taught: light, lens and surfaces.
    #[must_use]
    pub(super) fn is_as_taught(&self) -> bool {
        self.explained_ratio >= EXPLAINED_AS_TAUGHT_MIN
            && self.beset_ratio <= BESET_AS_TAUGHT_MAX
            && self.looks_as_taught(self.miss_ratio)
    }

    /// Whether parts that miss by so much, of what they may, look as taught, whatever else lies there, and light falls as it did.
    #[must_use]
    pub(super) fn looks_as_taught(&self, miss_ratio: f64) -> bool {
        miss_ratio <= MISS_AS_TAUGHT_MAX && !self.light_differs()
    }

    /// Whether the light is another than the one taught, as far as that shows.
    #[must_use]
    pub fn light_differs(&self) -> bool {
        let differs = |change_ratio| light_differs(self.plateau_ratio, self.hub_ratio, change_ratio);
        self.light_change_ratio.is_some_and(differs)
    }

    /// Whether light is seen to fall as it did when the part was taught.
    pub(super) fn light_is_as_taught(&self) -> bool {
        self.shows(HealthCause::LightDiffers) && !self.light_differs()
    }

    /// Whether the frame can tell that a cause holds, or that it does not.
    fn shows(&self, cause: HealthCause) -> bool {
        match cause {
            HealthCause::NothingRecognised => self.in_view_ratio >= IN_VIEW_MIN,
            HealthCause::LightDiffers => self.light_change_ratio.is_some(),
            HealthCause::LooksAlike | HealthCause::Clipped | HealthCause::Blurred | HealthCause::SizeDiffers => true,
        }
    }

    /// Whether the selector is blind: then an empty list of parts does not mean an empty plateau.
    #[must_use]
    pub fn is_blind(&self) -> bool {
        self.causes().contains(&HealthCause::NothingRecognised)
    }
}

/// What makes frames doubtful, one after the other.
#[derive(Clone, Debug, Default)]
pub struct HealthWatch {
    /// For each cause in force or about to change: whether it is in force, and how many frames in a row contradict that.
    causes: BTreeMap<HealthCause, (bool, u32)>,
}

impl HealthWatch {
    /// Notes what the latest frame is worth.
    pub fn note(&mut self, health: &FrameHealth) {
        let now = health.causes();
        for cause in &now {
            self.causes.entry(*cause).or_default();
        }
        for (cause, (in_force, against)) in self.causes.iter_mut().filter(|(cause, _)| health.shows(**cause)) {
            *against = if now.contains(cause) == *in_force { 0 } else { *against + 1 };
            if *against >= FRAMES_IN_A_ROW {
                (*in_force, *against) = (!*in_force, 0);
            }
        }
    }

    /// The causes in force, the gravest first.
    pub fn causes(&self) -> impl Iterator<Item = HealthCause> {
        self.causes.iter().filter(|(_, (in_force, _))| *in_force).map(|(cause, _)| *cause)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound() -> FrameHealth {
        FrameHealth {
            in_view_ratio: 0.9,
            covered_ratio: 0.1,
            explained_ratio: 0.98,
            plateau_ratio: 1.0,
            hub_ratio: Some(1.0),
            light_change_ratio: Some(0.001),
            clipped_ratio: 0.0,
            blur_excess_px2: Some(0.0),
            size_excess_ratio: Some(0.0),
            looks_alike: false,
            recognised: 9,
            miss_ratio: 0.2,
            beset_ratio: 0.1,
        }
    }

    #[test]
    fn each_cause_is_told_by_what_it_shows_in_and_by_nothing_else() {
        assert_eq!(sound().causes(), []);
        assert_eq!(FrameHealth { explained_ratio: 0.1, ..sound() }.causes(), [HealthCause::NothingRecognised]);
        assert_eq!(FrameHealth { covered_ratio: 0.001, explained_ratio: 0.0, ..sound() }.causes(), []);
        assert_eq!(FrameHealth { clipped_ratio: 0.1, ..sound() }.causes(), [HealthCause::Clipped]);
        // More light on everything is not another light.
        assert_eq!(FrameHealth { plateau_ratio: 0.7, hub_ratio: Some(0.7), ..sound() }.causes(), []);
        assert_eq!(FrameHealth { hub_ratio: Some(1.2), ..sound() }.causes(), [HealthCause::LightDiffers]);
        assert_eq!(FrameHealth { light_change_ratio: Some(0.003), ..sound() }.causes(), [HealthCause::LightDiffers]);
        let elsewhere = FrameHealth { light_change_ratio: None, ..sound() };
        assert_eq!(FrameHealth { hub_ratio: Some(1.2), ..elsewhere }.causes(), []);
        assert_eq!(FrameHealth { blur_excess_px2: Some(1.0), ..sound() }.causes(), [HealthCause::Blurred]);
        assert_eq!(FrameHealth { looks_alike: true, ..sound() }.causes(), [HealthCause::LooksAlike]);
        assert_eq!(FrameHealth { size_excess_ratio: Some(-0.07), ..sound() }.causes(), [HealthCause::SizeDiffers]);
        assert!(FrameHealth { explained_ratio: 0.1, ..sound() }.is_blind() && !sound().is_blind());
    }

    #[test]
    fn a_frame_looks_as_taught_unless_any_of_what_it_shows_does_not() {
        assert!(sound().is_as_taught());
        for other in [
            FrameHealth { explained_ratio: 0.96, ..sound() },
            FrameHealth { miss_ratio: 0.34, ..sound() },
            FrameHealth { beset_ratio: 0.51, ..sound() },
            FrameHealth { light_change_ratio: Some(0.003), ..sound() },
            FrameHealth { hub_ratio: Some(1.2), ..sound() },
        ] {
            assert!(!other.is_as_taught(), "{other:?}");
        }
    }

    #[test]
    fn a_part_that_is_not_recognised_after_all_explains_nothing_nor_do_shadows_of_none() {
        let mut health = FrameHealth { recognised: 2, explained_ratio: 0.5, ..sound() };
        health.unrecognise(0.125);
        assert_eq!((health.recognised, health.explained_ratio), (1, 0.375));
        health.unrecognise(0.125);
        assert_eq!((health.recognised, health.explained_ratio), (0, 0.0));
    }

    #[test]
    fn light_that_cannot_be_compared_is_not_taken_for_the_one_taught_nor_for_another() {
        let seen = |light_change_ratio| FrameHealth { light_change_ratio, ..sound() };
        for (change_ratio, is_as_taught, differs) in
            [(Some(0.001), true, false), (Some(0.003), false, true), (None, false, false)]
        {
            let health = seen(change_ratio);
            assert_eq!((health.light_is_as_taught(), health.light_differs()), (is_as_taught, differs), "{health:?}");
        }
    }

    #[test]
    fn a_cause_is_in_force_once_it_lasts_and_until_it_has_gone() {
        let mut watch = HealthWatch::default();
        let blind = FrameHealth { explained_ratio: 0.1, ..sound() };
        let told = |watch: &mut HealthWatch, health: &FrameHealth| {
            watch.note(health);
            watch.causes().collect::<Vec<_>>()
        };
        for _ in 0..3 {
            // A hand.
            (0..4).for_each(|_| assert_eq!(told(&mut watch, &blind), []));
            assert_eq!(told(&mut watch, &sound()), []);
        }
        let last = (0..FRAMES_IN_A_ROW).map(|_| told(&mut watch, &blind)).last();
        assert_eq!(last.unwrap(), [HealthCause::NothingRecognised]);
        assert_eq!(told(&mut watch, &sound()), [HealthCause::NothingRecognised]);
        assert_eq!((0..4).map(|_| told(&mut watch, &sound())).last().unwrap(), []);
    }

    #[test]
    fn parts_cut_by_the_edge_of_a_picture_that_shows_little_of_the_plateau_are_no_blindness() {
        let blind = FrameHealth { explained_ratio: 0.0, ..sound() };
        let aside = FrameHealth { in_view_ratio: 0.3, ..blind.clone() };
        assert_eq!(aside.causes(), []);
        let mut watch = HealthWatch::default();
        let mut told = |health: &FrameHealth, frames: u32| {
            (0..frames).for_each(|_| watch.note(health));
            watch.causes().collect::<Vec<_>>()
        };
        assert_eq!(told(&aside, 20), []);
        // Nor does such a picture end one.
        assert_eq!(told(&blind, FRAMES_IN_A_ROW), [HealthCause::NothingRecognised]);
        assert_eq!(told(&aside, 20), [HealthCause::NothingRecognised]);
        assert_eq!(told(&sound(), FRAMES_IN_A_ROW), []);
    }

    #[test]
    fn what_is_said_of_the_light_stands_while_the_tray_is_elsewhere() {
        let mut watch = HealthWatch::default();
        let (dim, elsewhere) =
            ([Some(0.003), None]).map(|change| FrameHealth { light_change_ratio: change, ..sound() }).into();
        let mut told = |health: &FrameHealth, frames: u32| {
            (0..frames).for_each(|_| watch.note(health));
            watch.causes().collect::<Vec<_>>()
        };
        assert_eq!(told(&dim, 4), []);
        assert_eq!(told(&elsewhere, 20), []);
        assert_eq!(told(&dim, 1), [HealthCause::LightDiffers]);
        assert_eq!(told(&elsewhere, 20), [HealthCause::LightDiffers]);
        assert_eq!(told(&sound(), 5), []);
    }
}
