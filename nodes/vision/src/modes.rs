//! What light, surface and lens may do to a part's picture, in few numbers.
//!
//! Under other light than the one taught, or with another surface, a part's picture changes by more than noise, but not in
//! any way: it gets lighter as a whole, its contrast grows or shrinks, its recesses are lit, the floor beside it is shaded.
//! To first order each is a picture of its own, made from the template, times a number: a mode. The fit finds the numbers for
//! each part, so that what decides is what no light changes: where edges are, and how brightness is ordered between them.
//! (Linear bases for images under changing light: Belhumeur and Kriegman 1998, "What is the set of images of an object under
//! all possible lighting conditions?"; fitted beside the pose: Hager and Belhumeur 1998.) Sharpness and size are two more.

use super::template::PoseTemplate;

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

    /// By how much edges are elsewhere than in the template, or less sharp, px.
    pub(super) fn edge_miss_px(self) -> f32 {
        match self {
            Self::Taught => 0.0,
            Self::Any => 0.2,
        }
    }
}

/// Modes that light makes: the coarse search knows these.
pub(super) const LIGHT_MODES: usize = 4;
/// All modes.
pub(super) const MODES: usize = 7;
/// The last three.
pub(super) const BLUR: usize = 5;
pub(super) const SCALE: usize = 6;

/// Amounts of the modes, in units of their spreads.
pub(super) type Amounts = [f32; MODES];
/// The same of those that light makes.
pub(super) type LightAmounts = [f32; LIGHT_MODES];

/// Spreads, as standard deviations. They are no tolerances of one part or camera but what lamps and surfaces differ by from
/// one another: a part as a whole and its contrasts by a quarter, recesses by the brightness of a bare floor between unlit
/// and lit, the floor close by within half of its shade, the lens by 0.3 px² of blur's variance, sizes by 2 %.
const LEVEL_SPREAD: f32 = 0.25;
const CONTRAST_SPREAD: f32 = 0.2;
const RECESS_SPREAD: f32 = 0.4;
const BESIDE_SPREAD: f32 = 0.12;
pub(super) const BLUR_SPREAD_PX2: f32 = 0.3;
pub(super) const SCALE_SPREAD: f32 = 0.02;
/// The shade under a part's rim goes as far as this, px.
const HALO_SPREAD: f32 = 0.12;
const HALO_PX: f32 = 1.5;
/// No amount is larger: what needs more is not the part in other light, but another thing.
pub(super) const AMOUNT_MAX: f32 = 2.5;

/// What a unit of each mode adds to each texel. `inside` tells how far a texel is inside the outline, 0 to 1.
pub(super) fn effects(
    template: &PoseTemplate,
    mean: &[f32],
    inside: &[f32],
    outside_px: &[f32],
    texels_per_px: f32,
) -> Vec<Amounts> {
    let side = template.side();
    let area: f32 = inside.iter().sum();
    let level = inside.iter().zip(mean).map(|(inside, mean)| inside * mean).sum::<f32>() / area.max(1.0);
    let at = |column: usize, row: usize| mean[row * side + column];
    let middle = (side / 2) as f32;
    let effect = |index: usize| {
        let (column, row) = (index % side, index / side);
        let (mean, inside) = (mean[index], inside[index]);
        let (left, right) = (at(column.saturating_sub(1), row), at((column + 1).min(side - 1), row));
        let (below, above) = (at(column, row.saturating_sub(1)), at(column, (row + 1).min(side - 1)));
        let curvature = (left + right + below + above - 4.0 * mean) * texels_per_px * texels_per_px;
        let (x, y) = (column as f32 - middle, row as f32 - middle);
        let outwards = 0.5 * ((right - left) * x + (above - below) * y);
        [
            LEVEL_SPREAD * inside * (1.0 + mean),
            CONTRAST_SPREAD * inside * (mean - level),
            RECESS_SPREAD * inside * template.recess.values()[index],
            BESIDE_SPREAD * (1.0 - inside),
            HALO_SPREAD * (1.0 - inside) * (1.0 - outside_px[index] / HALO_PX).clamp(0.0, 1.0),
            BLUR_SPREAD_PX2 * curvature,
            -SCALE_SPREAD * outwards,
        ]
    };
    (0..mean.len()).map(effect).collect()
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

/// All amounts, of those that light makes.
pub(super) fn all(light: &LightAmounts) -> Amounts {
    std::array::from_fn(|mode| light.get(mode).copied().unwrap_or(0.0))
}

/// By how much a part was seen larger or smaller than taught, relative.
pub(super) fn size_off(amounts: &Amounts) -> f32 {
    (amounts[SCALE] * SCALE_SPREAD).abs()
}

/// Never out of the ranges of their amounts.
pub(super) fn clamped(amount: f32) -> f32 {
    amount.clamp(-AMOUNT_MAX, AMOUNT_MAX)
}
