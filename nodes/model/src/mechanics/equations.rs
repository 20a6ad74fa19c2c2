//! Closed forms of the mean feed on a flat track, each within the range where it holds.
//!
//! μ_s and μ_k stand for the paper's one μ where each belongs: a part at rest feels μ_s, a sliding one μ_k. For the optimal
//! waveform on any slope see [`OptimalDesign`](crate::waveform::OptimalDesign).

use super::Friction;

/// Mean feed under the stick-slip waveform, m/s (Quaid Eq. 7): with m = μ_k g,
/// v̄ = (T a_min/2) (1/(1 + a_min/a_max) − 1/(1 + a_min/m)).
///
/// `None` outside its validity a_min ≤ μ_s g < a_max, which makes the part stick and slip as meant.
#[must_use]
pub fn stick_slip_feed_m_s(
    period_s: f64,
    a_min: f64,
    a_max: f64,
    friction: &Friction,
    gravity_m_s2: f64,
) -> Option<f64> {
    let hold = friction.static_coefficient() * gravity_m_s2;
    let drag = friction.kinetic_coefficient() * gravity_m_s2;
    (a_min <= hold && hold < a_max)
        .then(|| period_s * a_min / 2.0 * (1.0 / (1.0 + a_min / a_max) - 1.0 / (1.0 + a_min / drag)))
}

/// Mean feed under the stick-slip waveform where the part never sticks, m/s: v̄ = (m T/4) (a_max − a_min)/(a_max + a_min).
///
/// Not in the paper, whose Eq. 7 is wrong here. `None` outside its validity a_min > μ_s g.
#[must_use]
pub fn sliding_stick_slip_feed_m_s(
    period_s: f64,
    a_min: f64,
    a_max: f64,
    friction: &Friction,
    gravity_m_s2: f64,
) -> Option<f64> {
    (a_min > friction.static_coefficient() * gravity_m_s2)
        .then(|| friction.kinetic_coefficient() * gravity_m_s2 * period_s / 4.0 * (a_max - a_min) / (a_max + a_min))
}

/// The share z* = ½ (1 − m/a) of coasting that feeds fastest under a Coulomb pump of amplitude `a`, m = μ_k g.
#[must_use]
pub fn best_coulomb_pump_z(a: f64, friction: &Friction, gravity_m_s2: f64) -> f64 {
    0.5 * (1.0 - friction.kinetic_coefficient() * gravity_m_s2 / a)
}

/// Mean feed under the Coulomb pump in the steady state, m/s (Quaid Eq. 10, corrected beyond z*): a T z²/4 up to z*, the
/// longest coast in which the part does not come to rest, and (a T/4) (1 − z)² ((a − m)/(a + m))² beyond.
///
/// `None` outside its validity a > μ_s g.
#[must_use]
pub fn coulomb_pump_feed_m_s(period_s: f64, a: f64, z: f64, friction: &Friction, gravity_m_s2: f64) -> Option<f64> {
    let drag = friction.kinetic_coefficient() * gravity_m_s2;
    (a > friction.static_coefficient() * gravity_m_s2).then(|| {
        let coast =
            if z <= best_coulomb_pump_z(a, friction, gravity_m_s2) { z } else { (1.0 - z) * (a - drag) / (a + drag) };
        a * period_s / 4.0 * coast * coast
    })
}
