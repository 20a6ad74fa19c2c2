//! What a frame shows is explained by the likeliest parts, one after the other, so that touching parts come apart.

use nalgebra::{Rotation2, Vector2};

use super::super::align::{Fit, NO_PART};
use super::super::modes::Light;
use super::super::segment::Segmentation;
use super::super::sought::Sought;
use super::super::view::View;
use super::{Detector, Found};

/// Share of a part's area that others may cover before it is taken for one of them.
const OVERLAP_MAX: f64 = 0.2;
/// What stands out by less than this, of what the middle one of its like in the frame does, is none of them. Seen of bare floor
/// between bright blocks 0.2 to 0.5, of nuts in a light far from the one taught 0.65 and more.
const AS_OTHERS_RATIO_MIN: f32 = 0.5;
/// Share of a part's area that another explanation of the same thing covers.
const SAME_THING_MIN: f64 = 0.5;

impl Detector {
    /// By how much, per texel, the evidence for a part is stronger than that for another explanation.
    pub(super) fn lead(&self, part: &Found, other: &Found) -> f32 {
        self.sought[part.pose].per_texel(part.fit.evidence - other.fit.evidence)
    }

    /// Whether a fit shows a thing and not bare floor: in any light, a part as bright as the floor could lie wherever nothing does.
    /// What stands out there and is no such thing is in the way all the same.
    pub(in super::super) fn is_thing(&self, part: &Found) -> bool {
        let stands_out = self.sought[part.pose].stands_out(part.fit.evidence);
        let as_others = part.evidence_ratio.is_none_or(|ratio| ratio >= AS_OTHERS_RATIO_MIN);
        self.light == Light::Taught || stands_out && as_others
    }

    /// Takes the fits in order of their evidence for the parts they show, and what they cover as shown.
    pub(super) fn explain(&self, view: &View, fits: &[Found], owners: &mut [u16]) -> Vec<Found> {
        let mut found: Vec<Found> = Vec::new();
        let mut pixels = Vec::new();
        for fit in fits.iter().copied() {
            if !self.is_thing(&fit) {
                continue;
            }
            pixels.clear();
            covered(&self.segmentation, view, &self.sought[fit.pose], &fit.fit, |index| pixels.push(index));
            let count = pixels.len() as f64;
            let mut taken: Vec<u16> =
                pixels.iter().map(|index| owners[*index]).filter(|owner| *owner != 0 && *owner != NO_PART).collect();
            if taken.len() as f64 > OVERLAP_MAX * count {
                taken.sort_unstable();
                for run in taken.chunk_by(|a, b| a == b) {
                    let owner = &mut found[usize::from(run[0]) - 1];
                    if (run.len() as f64) < SAME_THING_MIN * count {
                        continue;
                    }
                    if owner.pose != fit.pose {
                        let lead = self.lead(owner, &fit);
                        if lead < owner.lead {
                            (owner.lead, owner.rival) = (lead, Some((fit.pose, fit.fit)));
                        }
                    } else if owner.yaw_rival.is_none()
                        && self.yaws_differ(fit.pose, owner.fit.yaw_rad, fit.fit.yaw_rad)
                    {
                        owner.yaw_rival = Some(fit.fit);
                    }
                }
                continue;
            }
            let Some(own) = u16::try_from(found.len() + 1).ok().filter(|own| *own != NO_PART) else {
                break;
            };
            let mut px = 0;
            for index in &pixels {
                if owners[*index] == 0 {
                    owners[*index] = own;
                    px += 1;
                }
            }
            found.push(Found { px, ..fit });
        }
        found
    }
}

/// Calls `each` with the pixels of the window that a part covers.
pub(in super::super) fn covered(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    fit: &Fit,
    mut each: impl FnMut(usize),
) {
    let window = frame.window;
    let (Some(pixel), Some(px_from_tray)) =
        (view.pixel(fit.centre, sought.plane_m), view.px_from_tray(fit.centre, sought.plane_m))
    else {
        return;
    };
    let Some(tray_from_px) = px_from_tray.try_inverse() else {
        return;
    };
    let part_from_px = Rotation2::new(-fit.yaw_rad).matrix() * tray_from_px;
    let middle = pixel - Vector2::new(window.left as f64, window.top as f64);
    let reach_px = sought.radius_m / sought.m_per_px + 1.0;
    for row in clip(middle.y - reach_px, middle.y + reach_px, window.height) {
        for column in clip(middle.x - reach_px, middle.x + reach_px, window.width) {
            let place = part_from_px * (Vector2::new(column as f64, row as f64) - middle.coords);
            if sought.texel(place).is_some_and(|texel| sought.outside_m[texel] <= 0.0) {
                each(row * window.width + column);
            }
        }
    }
}

/// The whole numbers from `low` to `high` within 0..`size`.
pub(super) fn clip(low: f64, high: f64, size: usize) -> std::ops::Range<usize> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
    let (low, high) = (low.ceil() as usize, (high.floor() + 1.0) as usize);
    low.min(size)..high.min(size).max(low.min(size))
}
