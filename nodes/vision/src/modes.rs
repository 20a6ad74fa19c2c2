//! What light, surface and lens may do to a part's picture, in few numbers.
//!
//! Under other light than the one taught, or with another surface, a part's picture changes by more than noise, but not in
//! any way: it gets lighter as a whole, its contrast grows or shrinks, its recesses are lit, the floor beside it is shaded,
//! the shadow that it casts to one side fades.
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
pub(super) const MODES: usize = 8;
/// Those of lens and size, and that of the shadow.
pub(super) const BLUR: usize = 5;
pub(super) const SCALE: usize = 6;
pub(super) const SHADOW: usize = 7;

/// Amounts of the modes, in units of their spreads.
pub(super) type Amounts = [f32; MODES];
/// The same of those that light makes.
pub(super) type LightAmounts = [f32; LIGHT_MODES];

/// Spreads, as standard deviations. They are no tolerances of one part or camera but what lamps and surfaces differ by from
/// one another: a part as a whole and its contrasts by a quarter, recesses by the brightness of a bare floor between unlit
/// and lit, the floor close by within half of its shade, a cast shadow by a half (two of those leave none, as a dome does), the lens
/// by 0.3 px² of blur's variance, sizes by 2 %.
const LEVEL_SPREAD: f32 = 0.25;
const CONTRAST_SPREAD: f32 = 0.2;
const RECESS_SPREAD: f32 = 0.4;
const BESIDE_SPREAD: f32 = 0.12;
const SHADOW_SPREAD: f32 = 0.5;
/// By how much shadows differ from the one taught where light falls as it did then, in spreads of their mode.
const SHADOW_AS_TAUGHT_SPREAD: f32 = 0.1;
pub(super) const BLUR_SPREAD_PX2: f32 = 0.3;
pub(super) const SCALE_SPREAD: f32 = 0.02;
/// The shade under a part's rim goes as far as this, px.
const HALO_SPREAD: f32 = 0.12;
const HALO_PX: f32 = 1.5;
/// No amount is larger: what needs more is not the part in other light, but another thing.
pub(super) const AMOUNT_MAX: f32 = 2.5;

/// What is believed of a part before it is fitted.
#[derive(Clone, Debug)]
pub(super) struct Belief {
    /// Middle of each mode's amount, and its spread relative to the usual one.
    pub middle: Amounts,
    pub spread: Amounts,
    /// What the frame adds to each texel of the template; nothing if empty.
    pub added: Vec<f32>,
    /// Evidence that the middle one has; 0 if nothing is known of others.
    pub evidence: f32,
}

impl Belief {
    /// That light, surface and lens may be any.
    pub(super) fn open() -> Self {
        Self { middle: [0.0; MODES], spread: [1.0; MODES], added: Vec::new(), evidence: 0.0 }
    }

    /// The same of light that is known to fall as it did when the part was taught: so do shadows.
    pub(super) fn of_light_as_taught() -> Self {
        let mut belief = Self::open();
        belief.spread[SHADOW] = SHADOW_AS_TAUGHT_SPREAD;
        belief
    }
}

/// What a unit of each mode but the shadow's adds to each texel. `inside` tells how far a texel is inside the outline, 0 to 1.
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
            // See `of_shadow`.
            0.0,
        ]
    };
    (0..mean.len()).map(effect).collect()
}

/// What a unit of the shadow's mode adds to each texel of a picture: what of the part's shadow falls to one side. It falls to another
/// side of a part that is turned, so that it is none of the mean picture's.
pub(super) fn of_shadow(picture: &[f32], inside: &[f32], outside_px: &[f32]) -> Vec<f32> {
    /// Rings of a pixel's width about the outline in which the usual level is taken for what falls to all sides.
    const RINGS: usize = 16;
    let ring = |index: usize| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let ring = outside_px[index].clamp(0.0, (RINGS - 1) as f32) as usize;
        ring
    };
    let mut sums = [(0.0_f32, 0.0_f32); RINGS];
    for (index, level) in picture.iter().enumerate() {
        let (sum, weight) = &mut sums[ring(index)];
        *sum += (1.0 - inside[index]) * level;
        *weight += 1.0 - inside[index];
    }
    let cast = |(index, level): (usize, &f32)| {
        let (sum, weight) = sums[ring(index)];
        SHADOW_SPREAD * (1.0 - inside[index]) * (level - sum / weight.max(1e-3))
    };
    picture.iter().enumerate().map(cast).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of three pixels to a side about a part of one.
    fn shadow(picture: [f32; 9]) -> Vec<f32> {
        let inside = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
        let outside_px = [1.2, 1.0, 1.2, 1.0, -0.5, 1.0, 1.2, 1.0, 1.2];
        of_shadow(&picture, &inside, &outside_px)
    }

    #[test]
    fn only_what_falls_to_one_side_is_a_cast_shadow() {
        let all_round = shadow([-0.2, -0.2, -0.2, -0.2, 0.7, -0.2, -0.2, -0.2, -0.2]);
        assert!(all_round.iter().all(|effect| effect.abs() < 1e-6), "{all_round:?}");
        let to_one_side = shadow([0.0, 0.0, -0.4, 0.0, 0.7, -0.4, 0.0, 0.0, -0.4]);
        // Two of the spreads less of it leave what falls to all sides: 0.15.
        let left: Vec<f32> = [0.0, -0.4]
            .into_iter()
            .zip([to_one_side[0], to_one_side[2]])
            .map(|(level, effect)| level - 2.0 * effect)
            .collect();
        assert!(left.iter().all(|level| (level + 0.15).abs() < 1e-6), "{left:?}");
        assert!(to_one_side[4] == 0.0, "the part casts none on itself");
    }
}
