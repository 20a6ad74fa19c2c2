//! What light, surface and lens may do to a part's picture, in few numbers.
//!
//! Under other light than the one taught, or with another surface, a part's picture changes by more than noise, but not in
//! any way: it gets lighter as a whole, its contrast grows or shrinks, the floor beside it is shaded, and it comes to look more like
//! what its drawing shows in other lights, such as fall alike from all sides: recesses are lit, cast shadows fade, walls change.
//! To first order each is a picture of its own, made from the template, times a number: a mode. The fit finds the numbers for
//! each part, so that what decides is what no light changes: where edges are, and how brightness is ordered between them.
//! (Linear bases for images under changing light: Belhumeur and Kriegman 1998, "What is the set of images of an object under
//! all possible lighting conditions?"; fitted beside the pose: Hager and Belhumeur 1998.) Sharpness and size are two more.

use std::ops::Range;

use super::template::{Aspect, LIGHTS_MAX, LitPicture, PoseTemplate, SIDES};

/// In what light, through what lens and on what surfaces parts are looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Light {
    /// As taught: a part's picture is the template's, and nothing of it is fitted but place and yaw.
    Taught,
    /// Whatever it is: what it does to the picture is fitted too.
    Any,
}

impl Light {
    /// What no template reproduces of a part, relative to the plateau's brightness.
    pub(super) fn model_sigma(self) -> f32 {
        match self {
            Self::Taught => 0.012,
            Self::Any => 0.02,
        }
    }

    /// By how many of the usual deviations what parts have round them differs: 2.7 standard deviations of a normal one where all
    /// that was taught counts, and as little as can be where a few parts of a frame tell.
    pub(super) fn scatters(self) -> f32 {
        match self {
            Self::Taught => 4.0,
            Self::Any => 1.0,
        }
    }

    /// How far beside its place in the picture, along rows and columns, a part's shadow may be seen, px: the lamp may stand a little
    /// elsewhere than taught, or than the parts of the frame tell. Where light is fitted that comes from no side more than it did, the picture
    /// has the shadow already, and more room for chance would let things beside pass for it.
    pub(super) fn shadow_misses_px(self, is_from_a_side: bool) -> &'static [f64] {
        match self {
            Self::Any if !is_from_a_side => &[0.0],
            Self::Taught | Self::Any => &[-1.0, 0.0, 1.0],
        }
    }

    /// By how much edges are elsewhere than in the template, or less sharp, px.
    pub(super) fn edge_miss_px(self) -> f32 {
        match self {
            Self::Taught => 0.0,
            Self::Any => 0.2,
        }
    }
}

/// The modes that other lights than the one taught make: all parts of a frame share them.
pub(super) const OTHER_LIGHTS: Range<usize> = WHOLE_LIGHTS.start..FROM_SIDES.end;
/// Those of lights as a part is drawn in them, and those of where low light comes from.
pub(super) const WHOLE_LIGHTS: Range<usize> = 3..3 + LIGHTS_MAX;
const FROM_SIDES: Range<usize> = WHOLE_LIGHTS.end..WHOLE_LIGHTS.end + SIDES;
/// The mode of the part's brightness as a whole, and that of the floor beside.
const LEVEL: usize = 0;
const BESIDE: usize = 2;
/// Modes that light makes: the coarse search knows these.
pub(super) const LIGHT_MODES: usize = OTHER_LIGHTS.end;
/// Those of lens and size, and all.
pub(super) const BLUR: usize = LIGHT_MODES;
pub(super) const SCALE: usize = LIGHT_MODES + 1;
pub(super) const MODES: usize = LIGHT_MODES + 2;

/// Amounts of the modes, in units of their spreads.
pub(super) type Amounts = [f32; MODES];
/// The same of those that light makes, and of those of where low light comes from.
pub(super) type LightAmounts = [f32; LIGHT_MODES];
pub(super) type SideAmounts = [f32; SIDES];

/// Spreads, as standard deviations. They are no tolerances of one part or camera but what lamps and surfaces differ by from
/// one another: a part as a whole and its contrasts by a quarter, the floor close by within half of its shade, the light taught by
/// half of its way to another (two of those are the whole way), the lens by 0.3 px² of blur's variance, sizes by 2 %.
const LEVEL_SPREAD: f32 = 0.25;
const CONTRAST_SPREAD: f32 = 0.2;
const BESIDE_SPREAD: f32 = 0.12;
const OTHER_LIGHT_SPREAD: f32 = 0.5;
/// The same where light falls as taught, in spreads of those modes.
const OTHER_LIGHTS_AS_TAUGHT_SPREAD: f32 = 0.1;
pub(super) const BLUR_SPREAD_PX2: f32 = 0.3;
pub(super) const SCALE_SPREAD: f32 = 0.02;
/// No amount is larger: what needs more is not the part in other light, but another thing.
pub(super) const AMOUNT_MAX: f32 = 2.5;

/// What is believed of a part before it is fitted.
#[derive(Clone, Debug)]
pub(super) struct Belief {
    /// Middle of each mode's amount, and its spread relative to the usual one.
    pub middle: Amounts,
    pub spread: Amounts,
    /// By how much parts of its pose differ from the middle one: their standard deviation, or the spread.
    pub deviation: Amounts,
    /// What the frame adds to each texel of the template; nothing if empty.
    pub added: Vec<f32>,
    /// Evidence that the middle one has; 0 if nothing is known of others.
    pub evidence: f32,
}

impl Belief {
    /// That light, surface and lens may be any.
    pub(super) fn open() -> Self {
        Self { middle: [0.0; MODES], spread: [1.0; MODES], deviation: [1.0; MODES], added: Vec::new(), evidence: 0.0 }
    }

    /// The same of light that is known to fall as it did when the part was taught.
    pub(super) fn of_light_as_taught() -> Self {
        let mut belief = Self::open();
        belief.spread[OTHER_LIGHTS].fill(OTHER_LIGHTS_AS_TAUGHT_SPREAD);
        belief
    }
}

/// What a unit of each mode adds to each texel of a picture. Those of other lights are as the picture's `aspect` has them;
/// the others are those of the template's mean over all yaws, seen from straight above.
#[derive(Clone, Debug)]
pub(super) struct Effects {
    /// For each texel all modes; those of other lights are the mean picture's.
    of_mean: Vec<Amounts>,
}

/// What a unit of each mode adds to each texel of one picture.
pub(super) struct EffectsOn<'a> {
    of_mean: &'a [Amounts],
    /// Modes of other lights, and what a unit of each adds to each texel; none where nothing is fitted.
    lights: Vec<(usize, Vec<f32>)>,
}

impl Effects {
    /// None at all.
    pub(super) fn none(texels: usize) -> Self {
        Self { of_mean: vec![[0.0; MODES]; texels] }
    }

    /// Those of a template, whose `mean` this is. `inside` tells how far a texel is inside the outline, 0 to 1.
    pub(super) fn new(template: &PoseTemplate, mean: &[f32], inside: &[f32], texels_per_px: f32) -> Self {
        let side = template.side();
        let area: f32 = inside.iter().sum();
        let level = inside.iter().zip(mean).map(|(inside, mean)| inside * mean).sum::<f32>() / area.max(1.0);
        let at = |column: usize, row: usize| mean[row * side + column];
        let middle = (side / 2) as f32;
        let lit: Vec<Vec<f32>> = template.lights.iter().map(LitPicture::mean).collect();
        let effect = |index: usize| {
            let (column, row) = (index % side, index / side);
            let (mean, inside) = (mean[index], inside[index]);
            let (left, right) = (at(column.saturating_sub(1), row), at((column + 1).min(side - 1), row));
            let (below, above) = (at(column, row.saturating_sub(1)), at(column, (row + 1).min(side - 1)));
            let curvature = (left + right + below + above - 4.0 * mean) * texels_per_px * texels_per_px;
            let (x, y) = (column as f32 - middle, row as f32 - middle);
            let outwards = 0.5 * ((right - left) * x + (above - below) * y);
            let mut effect = [0.0; MODES];
            effect[..OTHER_LIGHTS.start].copy_from_slice(&[
                LEVEL_SPREAD * inside * (1.0 + mean),
                CONTRAST_SPREAD * inside * (mean - level),
                BESIDE_SPREAD * (1.0 - inside),
            ]);
            for (mode, lit) in WHOLE_LIGHTS.zip(&lit) {
                effect[mode] = OTHER_LIGHT_SPREAD * (lit[index] - mean);
            }
            effect[BLUR] = BLUR_SPREAD_PX2 * curvature;
            effect[SCALE] = -SCALE_SPREAD * outwards;
            effect
        };
        Self { of_mean: (0..mean.len()).map(effect).collect() }
    }

    /// Those on a picture under some aspect.
    pub(super) fn on(&self, template: &PoseTemplate, picture: &[f32], aspect: &Aspect) -> EffectsOn<'_> {
        let to_light = |mut lit: Vec<f32>| {
            lit.iter_mut().zip(picture).for_each(|(lit, level)| *lit = OTHER_LIGHT_SPREAD * (*lit - level));
            lit
        };
        let from_side = |mut added: Vec<f32>| {
            added.iter_mut().for_each(|added| *added *= OTHER_LIGHT_SPREAD);
            added
        };
        let whole = WHOLE_LIGHTS.zip(template.in_other_lights(aspect).map(to_light));
        let sides = FROM_SIDES.zip(template.lit_from_sides(aspect).map(from_side));
        EffectsOn { of_mean: &self.of_mean, lights: whole.chain(sides).collect() }
    }

    /// Those of light on a texel of the mean picture.
    pub(super) fn of_light(&self, texel: usize) -> LightAmounts {
        of_light(&self.of_mean[texel])
    }

    /// Those on a picture in the light taught: none.
    pub(super) fn as_taught(&self) -> EffectsOn<'_> {
        EffectsOn { of_mean: &self.of_mean, lights: Vec::new() }
    }
}

impl EffectsOn<'_> {
    /// Of each mode on a texel.
    #[inline]
    pub(super) fn at(&self, texel: usize) -> Amounts {
        let mut effect = self.of_mean[texel];
        for (mode, lit) in &self.lights {
            effect[*mode] = lit[texel];
        }
        effect
    }

    /// What all modes together add to a texel in these amounts.
    pub(super) fn added(&self, texel: usize, amounts: &Amounts) -> f32 {
        added(&self.at(texel), amounts)
    }
}

/// The sum of modes in these amounts.
#[inline]
pub(super) fn added<const N: usize>(effect: &[f32; N], amounts: &[f32; N]) -> f32 {
    effect.iter().zip(amounts).map(|(effect, amount)| effect * amount).sum()
}

/// The amounts that light makes, of all.
pub(super) fn of_light(amounts: &Amounts) -> LightAmounts {
    std::array::from_fn(|mode| amounts[mode])
}

/// The amounts that other lights make, and nothing else.
pub(super) fn of_other_lights(amounts: &Amounts) -> Amounts {
    std::array::from_fn(|mode| if OTHER_LIGHTS.contains(&mode) { amounts[mode] } else { 0.0 })
}

/// The amounts of where low light comes from, of all.
pub(super) fn of_sides(amounts: &Amounts) -> SideAmounts {
    std::array::from_fn(|side| amounts[FROM_SIDES.start + side])
}

/// The same amounts of light but for where low light comes from.
pub(super) fn from_sides(mut light: LightAmounts, sides: &SideAmounts) -> LightAmounts {
    light[FROM_SIDES].copy_from_slice(sides);
    light
}

/// All amounts, of those that light makes.
pub(super) fn all(light: &LightAmounts) -> Amounts {
    std::array::from_fn(|mode| light.get(mode).copied().unwrap_or(0.0))
}

/// The amounts with the floor beside no darker than taught.
pub(super) fn not_darker_beside(amounts: &Amounts) -> Amounts {
    let mut amounts = *amounts;
    amounts[BESIDE] = amounts[BESIDE].max(0.0);
    amounts
}

/// By how much a part was seen darker as a whole than taught, relative; below 0 if brighter.
pub(super) fn darker(amounts: &Amounts) -> f32 {
    -amounts[LEVEL] * LEVEL_SPREAD
}

/// By how much a part was seen larger or smaller than taught, relative.
pub(super) fn size_off(amounts: &Amounts) -> f32 {
    (amounts[SCALE] * SCALE_SPREAD).abs()
}

/// Never out of the ranges of their amounts.
pub(super) fn clamped(amount: f32) -> f32 {
    amount.clamp(-AMOUNT_MAX, AMOUNT_MAX)
}
