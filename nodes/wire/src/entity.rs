//! Parts as entities of a simulation, as `simulation_interfaces` knows them: where they are, and filters that pick some.

use minifactory_msgs::geometry_msgs::msg::{Point, Pose, Quaternion, Twist, Vector3 as Vector};
use minifactory_msgs::simulation_interfaces::msg::{Bounds, EntityFilters, EntityState, TagsFilter};
use minifactory_msgs::std_msgs::msg::Header;
use nalgebra::{Isometry3, Point3, Quaternion as Hamilton, Translation3, UnitQuaternion, Vector3};
use regex::{Regex, RegexBuilder};
use thiserror::Error;

use crate::frames;

/// Longest filter, bytes.
const FILTER_BYTES_MAX: usize = 1024;
/// Largest length of a compiled filter, bytes.
const REGEX_BYTES_MAX: usize = 1 << 20;

/// Where an entity is and how it moves, in the platen frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stand {
    /// From the part, its axes those of its drawing and its origin the centre of mass, to the platen.
    pub platen_from_part: Isometry3<f64>,
    /// Velocity of its centre, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Turning rate about z, rad/s.
    pub yaw_rate_rad_s: f64,
}

/// The message; accelerations are not known.
#[must_use]
pub fn to_state(header: &Header, stand: &Stand) -> EntityState {
    let (at, turn) = (stand.platen_from_part.translation.vector, stand.platen_from_part.rotation.coords);
    let velocity = stand.velocity_m_s;
    EntityState {
        header: Header { frame_id: frames::PLATEN.to_owned(), ..header.clone() },
        pose: Pose {
            position: Point { x: at.x, y: at.y, z: at.z },
            orientation: Quaternion { x: turn.x, y: turn.y, z: turn.z, w: turn.w },
        },
        twist: Twist {
            linear: Vector { x: velocity.x, y: velocity.y, z: velocity.z },
            angular: Vector { x: 0.0, y: 0.0, z: stand.yaw_rate_rad_s },
        },
        ..EntityState::default()
    }
}

/// A pose that makes no sense.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PoseError {
    /// A number is infinite or none at all.
    #[error("the pose holds a number that is not finite")]
    NotFinite,
    /// The quaternion is no turn.
    #[error("the orientation's quaternion has length {0}, allowed is 0.99 to 1.01")]
    NotATurn(f64),
    /// The frame is none of those known.
    #[error("there is no frame {frame:?}: allowed are {PLATEN} and {tray}", PLATEN = frames::PLATEN)]
    NoSuchFrame {
        /// The frame.
        frame: String,
        /// The tray's.
        tray: String,
    },
}

/// The pose of a part in the tray frame, from one in the platen's (which an empty frame stands for) or the tray's, called
/// `tray_frame`.
///
/// # Errors
/// [`PoseError`].
pub fn pose_in_tray(
    frame: &str,
    pose: &Pose,
    tray_frame: &str,
    platen_from_tray: &Isometry3<f64>,
) -> Result<Isometry3<f64>, PoseError> {
    let (at, turn) = (&pose.position, &pose.orientation);
    let turn = Hamilton::new(turn.w, turn.x, turn.y, turn.z);
    if !(at.x.is_finite() && at.y.is_finite() && at.z.is_finite() && turn.norm().is_finite()) {
        return Err(PoseError::NotFinite);
    }
    if !(0.99..=1.01).contains(&turn.norm()) {
        return Err(PoseError::NotATurn(turn.norm()));
    }
    let pose = Isometry3::from_parts(Translation3::new(at.x, at.y, at.z), UnitQuaternion::from_quaternion(turn));
    match frame {
        "" | frames::PLATEN => Ok(platen_from_tray.inv_mul(&pose)),
        tray if tray == tray_frame => Ok(pose),
        other => Err(PoseError::NoSuchFrame { frame: other.to_owned(), tray: tray_frame.to_owned() }),
    }
}

/// Why a filter cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FilterError {
    /// What it asks for is not offered.
    #[error("{0}")]
    Unsupported(String),
    /// It makes no sense.
    #[error("{0}")]
    Malformed(String),
}

/// What a filter looks at.
#[derive(Clone, Debug, PartialEq)]
pub struct Entity<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its category, as the standard numbers them.
    pub category: u8,
    /// Its tags.
    pub tags: &'a [&'a str],
    /// Its centre in the platen frame, m.
    pub centre_m: Point3<f64>,
    /// Radius of the ball about the centre in which it lies, m.
    pub radius_m: f64,
}

/// Picks entities.
#[derive(Clone, Debug)]
pub struct Filter {
    name: Option<Regex>,
    categories: Vec<u8>,
    tags: Vec<String>,
    all_tags: bool,
    space: Option<Space>,
}

/// A part of space, m.
#[derive(Clone, Debug)]
enum Space {
    Ball(Point3<f64>, f64),
    Box([Point3<f64>; 2]),
}

impl Filter {
    /// The filter of a message.
    ///
    /// # Errors
    /// [`FilterError`].
    pub fn from_message(message: EntityFilters) -> Result<Self, FilterError> {
        let EntityFilters { filter, categories, tags: TagsFilter { tags, filter_mode, .. }, bounds } = message;
        let compile = |text: String| {
            if text.len() > FILTER_BYTES_MAX {
                let message = format!("a filter of {} bytes, allowed are {FILTER_BYTES_MAX}", text.len());
                return Err(FilterError::Malformed(message));
            }
            let compiled = RegexBuilder::new(&text).size_limit(REGEX_BYTES_MAX).build();
            compiled
                .map_err(|error| FilterError::Malformed(format!("filter {text:?} is no regular expression: {error}")))
        };
        if filter_mode > TagsFilter::FILTER_MODE_ALL {
            return Err(FilterError::Malformed(format!("tags.filter_mode = {filter_mode}, allowed: ANY 0, ALL 1")));
        }
        Ok(Self {
            name: Some(filter).filter(|text| !text.is_empty()).map(compile).transpose()?,
            categories: categories.into_iter().map(|category| category.category).collect(),
            tags,
            all_tags: filter_mode == TagsFilter::FILTER_MODE_ALL,
            space: Space::from_message(&bounds)?,
        })
    }

    /// Whether it picks this entity.
    #[must_use]
    pub fn admits(&self, entity: &Entity) -> bool {
        let has = |tag: &String| entity.tags.contains(&tag.as_str());
        let tagged = if self.all_tags { self.tags.iter().all(has) } else { self.tags.iter().any(has) };
        self.name.as_ref().is_none_or(|name| name.is_match(entity.name))
            && (self.categories.is_empty() || self.categories.contains(&entity.category))
            && (self.tags.is_empty() || tagged)
            && self.space.as_ref().is_none_or(|space| space.reaches(&entity.centre_m, entity.radius_m))
    }
}

impl Space {
    fn from_message(bounds: &Bounds) -> Result<Option<Self>, FilterError> {
        let points: Vec<Point3<f64>> =
            bounds.points.iter().map(|point| Point3::new(point.x, point.y, point.z)).collect();
        if points.iter().any(|point| !point.coords.iter().all(|number| number.is_finite())) {
            return Err(FilterError::Malformed("bounds hold a number that is not finite".to_owned()));
        }
        match (bounds.r#type, &points[..]) {
            (Bounds::TYPE_EMPTY, _) | (_, []) => Ok(None),
            (Bounds::TYPE_BOX, [a, b]) => Ok(Some(Self::Box([a.inf(b), a.sup(b)]))),
            (Bounds::TYPE_SPHERE, [centre, radius]) => Ok(Some(Self::Ball(*centre, radius.x))),
            (Bounds::TYPE_BOX | Bounds::TYPE_SPHERE, points) => {
                Err(FilterError::Malformed(format!("bounds of {} points, a box or a ball has 2", points.len())))
            }
            (kind, _) => Err(FilterError::Unsupported(format!("bounds.type = {kind}: allowed are BOX 1 and SPHERE 3"))),
        }
    }

    /// Whether a ball overlaps it.
    fn reaches(&self, centre_m: &Point3<f64>, radius_m: f64) -> bool {
        match self {
            Self::Ball(middle, reach_m) => (centre_m - middle).norm() <= reach_m + radius_m,
            Self::Box([low, high]) => (centre_m - centre_m.sup(low).inf(high)).norm() <= radius_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use minifactory_msgs::simulation_interfaces::msg::EntityCategory;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;

    const TRAY: &str = "feeder/tray";

    fn turned(x: f64, y: f64, yaw_rad: f64) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(x, y, 0.03), Vector3::new(0.0, 0.0, yaw_rad))
    }

    proptest! {
        #[test]
        fn a_state_that_was_read_can_be_set(
            (x, y, yaw_rad) in (-1.0..1.0, -1.0..1.0, -3.0..3.0),
            tilt in prop::array::uniform3(-2.0..2.0),
        ) {
            let platen_from_tray = turned(x, y, yaw_rad);
            let tray_from_part = Isometry3::new(Vector3::new(0.02, -0.05, 0.021), Vector3::from(tilt));
            let stand = Stand {
                platen_from_part: platen_from_tray * tray_from_part,
                velocity_m_s: Vector3::zeros(),
                yaw_rate_rad_s: 0.0,
            };
            let state = to_state(&Header::default(), &stand);
            let back = pose_in_tray(&state.header.frame_id, &state.pose, TRAY, &platen_from_tray).unwrap();
            prop_assert!((back.translation.vector - tray_from_part.translation.vector).norm() < 1e-12);
            prop_assert!(back.rotation.angle_to(&tray_from_part.rotation) < 1e-7);
        }
    }

    #[test]
    fn a_pose_is_in_the_platen_frame_unless_it_says_the_trays() {
        let tray = turned(0.2, 0.1, 1.0);
        let pose = Pose { position: Point { x: 0.2, y: 0.1, z: 0.03 }, ..Pose::default() };
        let at = |frame: &str| pose_in_tray(frame, &pose, TRAY, &tray).map(|pose| pose.translation.vector);
        assert!(at("").unwrap().norm() < 1e-12 && at("platen").unwrap().norm() < 1e-12);
        assert!((at(TRAY).unwrap() - Vector3::new(0.2, 0.1, 0.03)).norm() < 1e-12);
        let said = at("map").unwrap_err().to_string();
        assert!(said.contains("\"map\"") && said.contains("platen") && said.contains(TRAY), "{said}");
    }

    #[test]
    fn a_pose_that_is_none_is_refused() {
        let none = Pose { position: Point { x: f64::NAN, ..Point::default() }, ..Pose::default() };
        assert_eq!(pose_in_tray("", &none, TRAY, &Isometry3::identity()), Err(PoseError::NotFinite));
        let flat = Pose { orientation: Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 0.0 }, ..Pose::default() };
        assert_eq!(pose_in_tray("", &flat, TRAY, &Isometry3::identity()), Err(PoseError::NotATurn(0.0)));
    }

    fn entity<'a>(name: &'a str, tags: &'a [&'a str]) -> Entity<'a> {
        Entity {
            name,
            category: EntityCategory::CATEGORY_OBJECT,
            tags,
            centre_m: Point3::new(1.0, 0.0, 0.0),
            radius_m: 0.1,
        }
    }

    fn admits(message: EntityFilters) -> [bool; 3] {
        let filter = Filter::from_message(message).unwrap();
        let tags: [&[&str]; 3] = [&["nut", "flat"], &["nut", "on_edge"], &["coin", "flat"]];
        let names = ["part_1", "part_2", "mine"];
        std::array::from_fn(|index| filter.admits(&entity(names[index], tags[index])))
    }

    #[test]
    fn filters_by_name_category_and_tags_apply_together() {
        assert_eq!(admits(EntityFilters::default()), [true; 3]);
        let named = |text: &str| EntityFilters { filter: text.to_owned(), ..EntityFilters::default() };
        assert_eq!(admits(named("^part_[0-9]+$")), [true, true, false]);
        let tagged = |filter_mode| TagsFilter { tags: vec!["nut".into(), "flat".into()], filter_mode };
        assert_eq!(admits(EntityFilters { tags: tagged(0), ..named("") }), [true; 3]);
        assert_eq!(admits(EntityFilters { tags: tagged(1), ..named("") }), [true, false, false]);
        assert_eq!(admits(EntityFilters { tags: tagged(0), ..named("mine") }), [false, false, true]);
        let categories = vec![EntityCategory { category: EntityCategory::CATEGORY_ROBOT }];
        assert_eq!(admits(EntityFilters { categories, ..named("") }), [false; 3]);
    }

    #[test]
    fn bounds_pick_what_overlaps_them() {
        let within = |kind, points: [[f64; 3]; 2]| {
            let points = points.map(|[x, y, z]| Vector { x, y, z }).to_vec();
            let bounds = Bounds { r#type: kind, points };
            admits(EntityFilters { bounds, ..EntityFilters::default() })[0]
        };
        // The entity's ball reaches from 0.9 to 1.1 m.
        assert!(within(Bounds::TYPE_SPHERE, [[0.0; 3], [0.95, 0.0, 0.0]]));
        assert!(!within(Bounds::TYPE_SPHERE, [[0.0; 3], [0.85, 0.0, 0.0]]));
        assert!(within(Bounds::TYPE_BOX, [[0.95, 1.0, 1.0], [-1.0, -1.0, -1.0]]));
        assert!(!within(Bounds::TYPE_BOX, [[0.85, 1.0, 1.0], [-1.0, -1.0, -1.0]]));
    }

    #[test]
    fn a_filter_that_makes_no_sense_is_refused() {
        let refused = |message| Filter::from_message(message).unwrap_err();
        let text = EntityFilters { filter: "(".to_owned(), ..EntityFilters::default() };
        assert!(matches!(refused(text), FilterError::Malformed(_)));
        let bounds = |kind| Bounds { r#type: kind, points: vec![Vector::default()] };
        let of = |kind| EntityFilters { bounds: bounds(kind), ..EntityFilters::default() };
        assert!(matches!(refused(of(Bounds::TYPE_BOX)), FilterError::Malformed(_)));
        assert!(matches!(refused(of(Bounds::TYPE_CONVEX_HULL)), FilterError::Unsupported(_)));
        let tags = TagsFilter { filter_mode: 7, ..TagsFilter::default() };
        assert!(matches!(refused(EntityFilters { tags, ..EntityFilters::default() }), FilterError::Malformed(_)));
    }
}
