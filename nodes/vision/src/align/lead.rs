//! By how much templates say that what is seen must lead another explanation of it.

use nalgebra::{Rotation2, Vector2};

use super::super::modes::Belief;
use super::super::segment::Segmentation;
use super::super::sought::Sought;
use super::super::view::View;
use super::{Bare, Fit, MISS_SIGMAS_MAX, Owners, dark_max, residuals};

/// A part whose picture changes by less than this mean square when it is turned, in standard deviations, looks round.
const TURNED_MIN: f32 = 0.1;

/// A part as fitted, to be compared with the same at other yaws.
pub(in super::super) struct AtYaw<'a> {
    view: &'a View<'a>,
    laid: Laid<'a>,
    noise: f32,
    beside_sigma: f32,
    /// As it is seen there.
    picture: Vec<f32>,
    /// Its texels that are seen and belong to no other.
    seen: Vec<usize>,
}

impl<'a> AtYaw<'a> {
    /// `None` for a part that looks the same at all yaws, or out of the camera's sight.
    pub(in super::super) fn new(
        frame: &Segmentation,
        view: &'a View<'a>,
        laid: Laid<'a>,
        owners: &Owners,
    ) -> Option<Self> {
        if laid.sought.template.yaw_symmetry == 0 {
            return None;
        }
        let picture = laid.picture(view);
        let seen = seen_texels(frame, view, laid.sought, (laid.fit, &picture), owners)?;
        Some(Self { view, laid, noise: frame.sigma * frame.sigma, beside_sigma: owners.beside_sigma, picture, seen })
    }

    /// How much worse the part fits at another yaw, as a share of what the template says it must: about 1 for the part at its own
    /// yaw, and 0 for something that looks the same at both, or lies between them, or of which nothing is seen that tells. What
    /// belongs to others or is hidden tells nothing. `None` where the template does not tell.
    ///
    /// `other` is what was fitted there; nothing but the yaw of it counts if it is to be looked at as it is.
    pub(in super::super) fn lead_share(&self, other: &Fit) -> Option<f32> {
        let Laid { sought, fit, belief } = self.laid;
        // Both as they would be seen in the same place and light.
        let there = Laid { sought, fit: &Fit { yaw_rad: other.yaw_rad, ..*fit }, belief }.picture(self.view);
        let turn = Rotation2::new(fit.yaw_rad - other.yaw_rad);
        let expected = |texels: &[usize], beside_m: Vector2<f64>| {
            let (mut sum, mut count) = (0.0, 0.0_f32);
            for index in texels {
                let Some(turned) = sought.texel(turn * sought.template.place_m(*index) + beside_m) else { continue };
                let difference = self.picture[*index] - there[turned];
                let square = difference * difference / (sought.variance(*index, self.beside_sigma) + self.noise);
                sum += square.min(MISS_SIGMAS_MAX * MISS_SIGMAS_MAX);
                count += 1.0;
            }
            sum / count.max(1.0)
        };
        let whole = expected(&sought.texels, Vector2::zeros());
        if whole < TURNED_MIN {
            return None;
        }
        let wholly_seen = self.seen.len() == sought.texels.len();
        let in_place = if wholly_seen { whole } else { expected(&self.seen, Vector2::zeros()) };
        if in_place < TURNED_MIN {
            return Some(0.0);
        }
        // One whose centre of mass is not that of its picture looks the same turned and a little beside.
        let aside_m = fit.centre - other.centre;
        let least = if aside_m == Vector2::zeros() {
            in_place
        } else {
            in_place.min(expected(&self.seen, Rotation2::new(-other.yaw_rad) * aside_m)).max(TURNED_MIN)
        };
        Some((other.cost - fit.cost) / least)
    }
}

/// By how much, per texel of `part`, the templates say that its evidence must exceed that of another pose as fitted, where what is
/// seen is the part. What belongs to others tells nothing. `None` out of the camera's sight.
pub(in super::super) fn lead_due(
    frame: &Segmentation,
    view: &View,
    part: &Laid,
    other: &Laid,
    owners: &Owners,
) -> Option<f32> {
    let noise = frame.sigma * frame.sigma;
    let bare = Bare::new(noise);
    let (here, there) = (part.picture(view), other.picture(view));
    let into_part = Rotation2::new(other.fit.yaw_rad - part.fit.yaw_rad);
    let aside_m = Rotation2::new(-part.fit.yaw_rad) * (other.fit.centre - part.fit.centre);
    // What `laid` makes of a texel where the part's picture is seen, and bare floor beside that.
    let evidence = |laid: &Laid, picture: &[f32], shown: &dyn Fn(Vector2<f64>) -> f32| {
        let outdone = |index: usize| {
            let level = shown(laid.sought.template.place_m(index));
            let inverse_sigma = 1.0 / (laid.sought.variance(index, owners.beside_sigma) + noise).sqrt();
            let miss = (level - picture[index]) * inverse_sigma;
            let miss = miss.clamp(-dark_max(laid.sought, index), MISS_SIGMAS_MAX);
            bare.outdone(level, miss, inverse_sigma.ln())
        };
        let seen = seen_texels(frame, view, laid.sought, (laid.fit, picture), owners)?;
        Some(seen.into_iter().map(outdone).sum::<f32>() * laid.sought.texel_weight)
    };
    let at = |place_m: Vector2<f64>| part.sought.texel(place_m).map_or(0.0, |index| here[index]);
    let own = evidence(part, &here, &at)?;
    let others = evidence(other, &there, &|place_m| at(into_part * place_m + aside_m))?;
    Some(part.sought.per_texel(own - others))
}

/// The texels of a fit that are seen and belong to no other. `None` out of the camera's sight.
fn seen_texels(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    fitted: (&Fit, &[f32]),
    owners: &Owners,
) -> Option<Vec<usize>> {
    let residuals = residuals(frame, view, sought, fitted, owners)?;
    Some(sought.texels.iter().zip(residuals).filter_map(|(index, residual)| residual.map(|_| *index)).collect())
}

/// A pose laid over a frame, by a belief.
#[derive(Clone, Copy)]
pub(in super::super) struct Laid<'a> {
    pub sought: &'a Sought,
    pub fit: &'a Fit,
    pub belief: &'a Belief,
}

impl Laid<'_> {
    /// Its picture as it is seen there.
    fn picture(&self, view: &View) -> Vec<f32> {
        let mut picture = self.sought.fitted(&self.sought.aspect(view, self.fit), &self.fit.amounts);
        picture.iter_mut().zip(&self.belief.added).for_each(|(level, added)| *level += added);
        picture
    }
}
