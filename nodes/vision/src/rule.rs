//! The one rule by which a part may be picked.

use feeder_model::part::Refusals;

use super::candidate::Candidate;
use super::config::SelectorConfig;

/// What speaks against picking a part that a frame shows as `seen` and that all frames so far show in `pose`, with
/// `confidence`: it must be sure and undisputed, wholly on the plateau, and have the room that the gripper needs, measured
/// from its outline to those of other things and to the walls.
pub(super) fn refusals(config: &SelectorConfig, seen: &Candidate, pose: Option<usize>, confidence: f64) -> Refusals {
    Refusals {
        pose_unsure: pose.is_none() || confidence < config.confidence_min,
        pose_disagrees: seen.pose != pose,
        off_plateau: !seen.on_plateau,
        part_too_near: seen.part_gap_m < config.part_clearance_m,
        wall_too_near: seen.wall_gap_m < config.wall_clearance_m,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const CONFIG: fn() -> SelectorConfig = SelectorConfig::default;

    /// A part that may be picked, but for what is changed of it.
    fn seen() -> Candidate {
        Candidate {
            x_m: 0.0,
            y_m: -0.06,
            yaw_rad: None,
            likeness: 1,
            pose: Some(1),
            confidence: 0.95,
            part_gap_m: 0.004,
            wall_gap_m: 0.02,
            on_plateau: true,
        }
    }

    #[test]
    fn a_part_may_be_picked_if_nothing_at_all_speaks_against_it() {
        assert!(refusals(&CONFIG(), &seen(), Some(1), 0.95).may_be_picked());
        let none = Refusals::default();
        let config = CONFIG();
        let cases = [
            (seen(), Some(1), 0.89, Refusals { pose_unsure: true, ..none }),
            (Candidate { pose: None, ..seen() }, None, 0.95, Refusals { pose_unsure: true, ..none }),
            (Candidate { pose: Some(0), ..seen() }, Some(1), 0.95, Refusals { pose_disagrees: true, ..none }),
            (Candidate { pose: None, ..seen() }, Some(1), 0.95, Refusals { pose_disagrees: true, ..none }),
            (Candidate { on_plateau: false, ..seen() }, Some(1), 0.95, Refusals { off_plateau: true, ..none }),
            (Candidate { part_gap_m: 0.0009, ..seen() }, Some(1), 0.95, Refusals { part_too_near: true, ..none }),
            (Candidate { wall_gap_m: -0.0011, ..seen() }, Some(1), 0.95, Refusals { wall_too_near: true, ..none }),
        ];
        for (seen, pose, confidence, expected) in cases {
            assert_eq!(refusals(&config, &seen, pose, confidence), expected, "{seen:?}");
            assert!(!expected.may_be_picked() && !expected.to_string().is_empty());
        }
    }

    proptest! {
        /// Each condition is judged by its own threshold alone, and the pose is no condition.
        #[test]
        fn each_threshold_decides_one_refusal(
            gaps_m in [-0.01..0.01, -0.01..0.01], clearances_m in [-0.01..0.01, -0.01..0.01],
            confidence in 0.0..1.0, confidence_min in 0.0..1.0, on_plateau: bool, pose in 0_usize..4, shown in 0_usize..4,
        ) {
            let [part_gap_m, wall_gap_m] = gaps_m;
            let [part_clearance_m, wall_clearance_m] = clearances_m;
            let config = SelectorConfig { confidence_min, part_clearance_m, wall_clearance_m, ..CONFIG() };
            let seen = Candidate { part_gap_m, wall_gap_m, on_plateau, pose: Some(shown), ..seen() };
            let found = refusals(&config, &seen, Some(pose), confidence);
            prop_assert_eq!(found.pose_unsure, confidence < confidence_min);
            prop_assert_eq!(found.pose_disagrees, pose != shown);
            prop_assert_eq!(found.off_plateau, !on_plateau);
            prop_assert_eq!(found.part_too_near, part_gap_m < part_clearance_m);
            prop_assert_eq!(found.wall_too_near, wall_gap_m < wall_clearance_m);
            let elsewhere = SelectorConfig { wanted_poses: vec![0, 2], ..config };
            prop_assert_eq!(refusals(&elsewhere, &seen, Some(pose), confidence), found);
        }
    }
}
