//! What a courier must keep clear of, and the shortest way round it.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::plan_error::PlanError;
use crate::platen::{Area, segment_distance_m};
use feeder_model::range::OutOfRange;
use feeder_model::range::check_range;

/// The cable that ties a courier to the edge of the platen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tether {
    /// Where it is fixed, m.
    #[schemars(with = "[f64; 2]")]
    pub anchor_m: Vector2<f64>,
    /// How far from there the courier's centre can go, m.
    pub length_m: f64,
}

/// What is around a courier.
#[derive(Clone, Debug, PartialEq)]
pub struct Surroundings {
    /// Radius of a disc about the courier's centre that covers courier and tray, m.
    pub footprint_radius_m: f64,
    /// How far the courier may cut the corners of its route, m.
    pub corner_m: f64,
    /// Areas that no part of the courier may enter.
    pub keep_out: Vec<Area>,
    /// Its cable, if that is short enough to matter.
    pub tether: Option<Tether>,
}

impl Default for Surroundings {
    fn default() -> Self {
        Self { footprint_radius_m: 0.1, corner_m: 0.02, keep_out: Vec::new(), tether: None }
    }
}

/// Corners of the polygon about each point of a keep-out area that routes may touch.
const CORNERS: u32 = 8;
/// Rounding must not make a route along an area's border cross it, m.
const SLACK_M: f64 = 1e-6;
/// What a corner costs in length when routes are compared: time is lost there, m.
const CORNER_COST_M: f64 = 0.05;

impl Surroundings {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_range("footprint_radius_m", self.footprint_radius_m, 1e-3, 10.0)?;
        check_range("corner_m", self.corner_m, 0.0, 1.0)?;
        if let Some(tether) = &self.tether {
            check_range("tether.anchor_m", tether.anchor_m.x, -100.0, 100.0)?;
            check_range("tether.anchor_m", tether.anchor_m.y, -100.0, 100.0)?;
            check_range("tether.length_m", tether.length_m, 1e-3, 100.0)?;
        }
        self.keep_out.iter().try_for_each(Area::validate)
    }

    /// Whether the courier may stand with its centre at `center_m`.
    ///
    /// # Errors
    /// The tether does not reach there, or a keep-out area is in the way.
    pub fn check(&self, center_m: &Vector2<f64>) -> Result<(), PlanError> {
        if let Some(Tether { anchor_m, length_m }) = self.tether {
            let needed_m = (center_m - anchor_m).norm();
            if needed_m > length_m {
                return Err(PlanError::Tether { needed_m, length_m });
            }
        }
        let here = Area::disc(*center_m, self.footprint_radius_m);
        match self.keep_out.iter().position(|area| area.distance_m(&here) < -SLACK_M) {
            Some(index) => Err(PlanError::KeepOut { index, x_m: center_m.x, y_m: center_m.y }),
            None => Ok(()),
        }
    }

    /// Whether the straight way between two places is clear.
    pub(super) fn is_clear(&self, from_m: Vector2<f64>, to_m: Vector2<f64>) -> bool {
        let way = Area { points_m: vec![from_m, to_m], radius_m: self.footprint_radius_m };
        self.keep_out.iter().all(|area| area.distance_m(&way) >= -SLACK_M)
    }

    /// Smallest distance by which the courier, centred at `center_m`, misses the keep-out areas, m.
    pub(super) fn clearance_m(&self, center_m: &Vector2<f64>) -> f64 {
        let here = Area::disc(*center_m, self.footprint_radius_m);
        self.keep_out.iter().map(|area| area.distance_m(&here)).fold(f64::INFINITY, f64::min)
    }

    /// The shortest way between two places round the keep-out areas: a polyline from one to the other, through corners
    /// for which `may_stand` holds. (A visibility graph and Dijkstra's algorithm; round areas are taken as octagons.)
    ///
    /// # Errors
    /// Either place cannot be stood on, or no way leads from one to the other.
    pub(super) fn route(
        &self,
        from_m: Vector2<f64>,
        to_m: Vector2<f64>,
        may_stand: impl Fn(&Vector2<f64>) -> bool,
    ) -> Result<Vec<Vector2<f64>>, PlanError> {
        self.check(&from_m)?;
        self.check(&to_m)?;
        if self.is_clear(from_m, to_m) {
            return Ok(vec![from_m, to_m]);
        }
        let corners = self.corners().filter(|corner| may_stand(corner) && self.check(corner).is_ok());
        let nodes: Vec<Vector2<f64>> = [from_m, to_m].into_iter().chain(corners).collect();
        // The tentative cost of each node, where it is reached from, and whether it is settled.
        let mut reached: Vec<(f64, usize, bool)> = vec![(f64::INFINITY, 0, false); nodes.len()];
        reached[0].0 = 0.0;
        while let Some(here) = nearest(&reached) {
            reached[here].2 = true;
            if here == 1 {
                break;
            }
            for next in 1..nodes.len() {
                let cost_m = reached[here].0 + (nodes[next] - nodes[here]).norm() + CORNER_COST_M;
                if !reached[next].2 && cost_m < reached[next].0 && self.is_clear(nodes[here], nodes[next]) {
                    reached[next] = (cost_m, here, false);
                }
            }
        }
        if !reached[1].2 {
            return Err(PlanError::NoRoute { from_m: from_m.into(), to_m: to_m.into() });
        }
        let mut route = vec![to_m];
        let mut at = 1;
        while at != 0 {
            at = reached[at].1;
            route.push(nodes[at]);
        }
        route.reverse();
        Ok(route)
    }

    /// A place, and all corners that can be come to from there through corners for which `may_stand` holds.
    pub(super) fn reached_m(
        &self,
        from_m: Vector2<f64>,
        may_stand: impl Fn(&Vector2<f64>) -> bool,
    ) -> Vec<Vector2<f64>> {
        let mut left: Vec<Vector2<f64>> =
            self.corners().filter(|corner| may_stand(corner) && self.check(corner).is_ok()).collect();
        let mut reached_m = vec![from_m];
        let mut looked_from = 0;
        while let Some(&here_m) = reached_m.get(looked_from) {
            let (next, rest) = left.into_iter().partition(|corner| self.is_clear(here_m, *corner));
            reached_m.extend::<Vec<_>>(next);
            left = rest;
            looked_from += 1;
        }
        reached_m
    }

    /// Places from which routes may turn round a keep-out area.
    fn corners(&self) -> impl Iterator<Item = Vector2<f64>> + '_ {
        self.keep_out.iter().flat_map(move |area| {
            let away_m = (area.radius_m + self.footprint_radius_m + self.corner_m) / (PI / f64::from(CORNERS)).cos();
            area.points_m.iter().flat_map(move |point| {
                (0..CORNERS).map(move |index| {
                    let angle_rad = TAU * f64::from(index) / f64::from(CORNERS);
                    point + Vector2::new(angle_rad.cos(), angle_rad.sin()) * (away_m + SLACK_M)
                })
            })
        })
    }
}

/// The cheapest node that is reached but not settled.
fn nearest(reached: &[(f64, usize, bool)]) -> Option<usize> {
    let open = reached.iter().enumerate().filter(|(_, (cost_m, _, settled))| !settled && cost_m.is_finite());
    open.min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0)).map(|(index, _)| index)
}

/// Distance of a point from a polyline, m.
pub(super) fn distance_to_line_m(point: &Vector2<f64>, line: &[Vector2<f64>]) -> f64 {
    let pieces = line.windows(2).map(|pair| segment_distance_m((pair[0], pair[1]), (*point, *point)));
    pieces.fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn around(keep_out: Vec<Area>) -> Surroundings {
        Surroundings { keep_out, ..Surroundings::default() }
    }

    fn length_m(route: &[Vector2<f64>]) -> f64 {
        route.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
    }

    #[test]
    fn a_clear_way_is_straight_and_a_blocked_one_goes_round_on_the_shorter_side() {
        let (from, to) = (Vector2::new(-0.4, 0.0), Vector2::new(0.4, 0.0));
        assert_eq!(around(vec![]).route(from, to, |_| true).unwrap(), [from, to]);
        let post = Area::disc(Vector2::new(0.0, 0.05), 0.05);
        let route = around(vec![post]).route(from, to, |_| true).unwrap();
        assert!(route.len() > 2 && route.iter().all(|point| point.y <= 1e-9), "{route:?}");
        // The taut string round a disc of 0.15 m is 0.806 m long; corners and octagons cost a little.
        assert!(length_m(&route) < 0.87, "{route:?}");
    }

    #[test]
    fn what_cannot_be_reached_is_refused_by_name() {
        let tethered = Surroundings {
            tether: Some(Tether { anchor_m: Vector2::new(-1.0, 0.0), length_m: 1.2 }),
            ..around(vec![Area::disc(Vector2::zeros(), 0.05)])
        };
        let from = Vector2::new(-0.4, 0.0);
        let refused = |to: Vector2<f64>| tethered.route(from, to, |_| true).unwrap_err().to_string();
        assert!(refused(Vector2::new(0.4, 0.0)).contains("tether"));
        assert!(refused(Vector2::new(-0.1, 0.0)).contains("keep-out"));
        // A wall from bound to bound.
        let wall = Area { points_m: vec![Vector2::new(0.0, -9.0), Vector2::new(0.0, 9.0)], radius_m: 0.01 };
        let cut = around(vec![wall]).route(from, -from, |corner| corner.y.abs() < 0.5).unwrap_err();
        assert!(matches!(cut, PlanError::NoRoute { .. }));
    }

    proptest! {
        /// No route enters a keep-out area, and none is shorter than the straight line.
        #[test]
        fn routes_keep_clear(
            posts in prop::collection::vec((-0.4..0.4, -0.4..0.4, 0.0..0.1), 0..4),
            ends in prop::array::uniform4(-0.5..0.5_f64),
        ) {
            let keep_out: Vec<Area> =
                posts.iter().map(|&(x, y, radius_m)| Area::disc(Vector2::new(x, y), radius_m)).collect();
            let surroundings = around(keep_out.clone());
            let (from, to) = (Vector2::new(ends[0], ends[1]), Vector2::new(ends[2], ends[3]));
            if let Ok(route) = surroundings.route(from, to, |_| true) {
                let swept = Area { points_m: route.clone(), radius_m: surroundings.footprint_radius_m };
                for area in &keep_out {
                    prop_assert!(area.distance_m(&swept) >= -2.0 * SLACK_M);
                }
                prop_assert!(length_m(&route) >= (to - from).norm() - 1e-12);
            }
        }
    }
}
