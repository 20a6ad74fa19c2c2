//! The topics of the feeder: name, type, quality of service, who publishes, who hears and how late.

use minifactory_msgs::interface::User::{Feedback, Forward, Outside};
use minifactory_msgs::interface::{Qos, TopicSpec};
use minifactory_msgs::msg::{
    AreaLeases, CourierState, DeliveryState, Factsheet, FeedMetrics, FeederState, PartCandidates, PartStates,
    PickEvent, RunProgress, TrayMotion, Waveform,
};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::{CameraInfo, CompressedImage, Image, JointState};
use minifactory_msgs::std_msgs::msg::String as Text;
use minifactory_msgs::tf2_msgs::msg::TFMessage;
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use minifactory_msgs::visualization_msgs::msg::MarkerArray;

use crate::interface::interface;
use crate::interface::namespaces::{FEEDER, GLOBAL, PLATEN, STATION};
use crate::interface::nodes::{
    COURIER_DRIVER, DELIVERY_PLANNER, OVERHEAD_MANIPULATOR, PART_SIMULATOR, PLATEN_ARBITER, RUN_MONITOR,
    VISION_SELECTOR, WAVEFORM_GENERATOR,
};

pub use minifactory_msgs::interface::standard::{CLOCK, DIAGNOSTICS, PARAMETER_EVENTS, ROSOUT};

/// Several nodes publish frames that stay, each once. The player of a bag publishes all of them with the depth that was
/// recorded, so that a depth of 1 would leave those who come late with the last alone.
const STATIC_FRAMES: Qos = Qos { depth: 100, backlog: 100, ..Qos::latched() };

interface! {
    /// All topics of this module's own.
    all;

    /// The waveform, m/s² or rad/s² by s, and whether it runs; again twice a second while it does, as a sign of life
    WAVEFORM: TopicSpec<Waveform> = TopicSpec::new(FEEDER, "waveform", Qos::latched()),
        [WAVEFORM_GENERATOR] => [Forward(COURIER_DRIVER)];

    /// How the tray truly moved in the last tick, from the simulated motor to the simulated parts, a sample each servo period: m, rad, their rates and accelerations
    TRAY_MOTION: TopicSpec<TrayMotion> = TopicSpec::new(FEEDER, "tray_motion", Qos::command()),
        [COURIER_DRIVER] => [Forward(PART_SIMULATOR), Forward(RUN_MONITOR)];

    /// Estimated pose of the courier on the platen, m and rad, and velocity in its own frame, m/s and rad/s, with covariances
    ODOMETRY: TopicSpec<Odometry> = TopicSpec::new(FEEDER, "odometry", Qos::command()),
        [COURIER_DRIVER] => [
            Forward(VISION_SELECTOR), Forward(DELIVERY_PLANNER), Forward(RUN_MONITOR), Outside("viewers"),
        ];

    /// Position and velocity of the courier's axes: x and y in m and m/s, yaw in rad and rad/s
    JOINT_STATES: TopicSpec<JointState> = TopicSpec::new(FEEDER, "joint_states", Qos::command()),
        [COURIER_DRIVER] => [Outside("viewers")];

    /// What the courier does, its tracking errors in m and rad, its fault, and the waveform it has heard last
    COURIER_STATE: TopicSpec<CourierState> = TopicSpec::new(FEEDER, "courier_state", Qos::command()),
        [COURIER_DRIVER] => [
            Forward(DELIVERY_PLANNER), Forward(RUN_MONITOR), Feedback(WAVEFORM_GENERATOR), Outside("viewers"),
        ];

    /// Frames that move, m: courier and gripper, a frame for each joint
    TF: TopicSpec<TFMessage> = TopicSpec::new(GLOBAL, "tf", Qos::command()),
        [COURIER_DRIVER, OVERHEAD_MANIPULATOR] => [Outside("viewers")];

    /// Frames that stay where they are, m: the tray on the courier, the camera, the tools
    TF_STATIC: TopicSpec<TFMessage> = TopicSpec::new(GLOBAL, "tf_static", STATIC_FRAMES),
        [COURIER_DRIVER, PART_SIMULATOR, OVERHEAD_MANIPULATOR] => [Outside("viewers")];

    /// The courier with its tray as URDF; its joints are those of joint_states, its links the frames of /tf
    ROBOT_DESCRIPTION: TopicSpec<Text> = TopicSpec::new(FEEDER, "robot_description", Qos::latched()),
        [COURIER_DRIVER] => [Outside("viewers")];

    /// The camera as URDF
    CAMERA_DESCRIPTION: TopicSpec<Text> = TopicSpec::new(FEEDER, "camera/robot_description", Qos::latched()),
        [PART_SIMULATOR] => [Outside("viewers")];

    /// A station with its tool as URDF; its joints are those of joint_states, its links the frames of /tf
    TOOL_DESCRIPTION: TopicSpec<Text> = TopicSpec::new(STATION, "robot_description", Qos::latched()),
        [OVERHEAD_MANIPULATOR] => [Outside("viewers")];

    /// The tray's running surface and walls as triangles, in the tray's frame, m
    TRAY_MARKERS: TopicSpec<MarkerArray> = TopicSpec::new(FEEDER, "markers/tray", Qos::latched()),
        [PART_SIMULATOR] => [Outside("viewers")];

    /// Ground truth for the eye: every part as it lies, coloured by its resting pose, in the tray's frame, m; ten times a second while somebody looks
    PART_MARKERS: TopicSpec<MarkerArray> = TopicSpec::new(FEEDER, "markers/parts", Qos::command()),
        [PART_SIMULATOR] => [Outside("viewers")];

    /// A ring round every part seen, coloured by what the selector says of it, in the tray's frame, m; for each picture while somebody looks
    CANDIDATE_MARKERS: TopicSpec<MarkerArray> = TopicSpec::new(FEEDER, "markers/candidates", Qos::command()),
        [VISION_SELECTOR] => [Outside("viewers")];

    /// Ground truth of every part, in polar coordinates of the tray, m and rad; in the feeder only the simulated motor, which carries them, hears it
    PARTS: TopicSpec<PartStates> = TopicSpec::new(FEEDER, "parts", Qos::sensor()),
        [PART_SIMULATOR] => [Feedback(COURIER_DRIVER), Forward(RUN_MONITOR), Outside("viewers")];

    /// Ground truth of every gripper that closed, its place in m
    PICKS: TopicSpec<PickEvent> = TopicSpec::new(FEEDER, "picks", Qos::command()),
        [PART_SIMULATOR] => [Forward(RUN_MONITOR), Outside("viewers")];

    /// Compressed grey pictures of the camera, each below 64 kB
    IMAGE_COMPRESSED: TopicSpec<CompressedImage> =
        TopicSpec::new(FEEDER, "camera/image_raw/compressed", Qos::command()),
        [PART_SIMULATOR] => [Forward(VISION_SELECTOR), Outside("viewers")];

    /// Grey pictures of the camera, sent while somebody looks; the selector hears them where its image_transport is raw
    IMAGE_RAW: TopicSpec<Image> = TopicSpec::new(FEEDER, "camera/image_raw", Qos::sensor()),
        [PART_SIMULATOR] => [Forward(VISION_SELECTOR), Outside("viewers")];

    /// Calibration of the camera, px
    CAMERA_INFO: TopicSpec<CameraInfo> = TopicSpec::new(FEEDER, "camera/camera_info", Qos::command()),
        [PART_SIMULATOR] => [Forward(VISION_SELECTOR), Outside("viewers")];

    /// The pictures with what was seen drawn in, sent while somebody looks
    IMAGE_ANNOTATED: TopicSpec<Image> = TopicSpec::new(FEEDER, "camera/annotated", Qos::sensor()),
        [VISION_SELECTOR] => [Outside("viewers")];

    /// Every part seen wholly on the plateau, in the tray's frame, m, at the stamp of the picture
    CANDIDATES: TopicSpec<Detection3DArray> = TopicSpec::new(FEEDER, "candidates", Qos::command()),
        [VISION_SELECTOR] => [Outside("viewers")];

    /// Every part seen, with its free gaps and what speaks against picking it, at the stamp of the picture
    PART_CANDIDATES: TopicSpec<PartCandidates> = TopicSpec::new(FEEDER, "part_candidates", Qos::command()),
        [VISION_SELECTOR] => [Forward(DELIVERY_PLANNER), Forward(RUN_MONITOR), Outside("agents")];

    /// Where the planner stands in its sequence, and counts of deliveries; at least twice a second, as a sign of life
    DELIVERY_STATE: TopicSpec<DeliveryState> = TopicSpec::new(FEEDER, "delivery_state", Qos::command()),
        [DELIVERY_PLANNER] => [Feedback(COURIER_DRIVER), Forward(RUN_MONITOR), Outside("viewers")];

    /// Whether the feeder takes goals, and if not why
    STATE: TopicSpec<FeederState> = TopicSpec::new(FEEDER, "state", Qos::latched()),
        [DELIVERY_PLANNER] => [Outside("agents")];

    /// What the feeder feeds, where to, and how fast and finely, in m and s
    FACTSHEET: TopicSpec<Factsheet> = TopicSpec::new(FEEDER, "factsheet", Qos::latched()),
        [DELIVERY_PLANNER] => [Outside("agents")];

    /// Position and velocity of a manipulator's axes: z in m and m/s, theta in rad and rad/s
    TOOL_JOINT_STATES: TopicSpec<JointState> = TopicSpec::new(STATION, "joint_states", Qos::command()),
        [OVERHEAD_MANIPULATOR] => [Outside("viewers")];

    /// All leases of areas of the platen, m, and who waits for one
    LEASES: TopicSpec<AreaLeases> = TopicSpec::new(PLATEN, "leases", Qos::latched()),
        [PLATEN_ARBITER] => [Forward(RUN_MONITOR), Outside("agents, viewers")];

    /// The score of a run by ground truth, ten times a second; slip in m
    PROGRESS: TopicSpec<RunProgress> = TopicSpec::new(FEEDER, "progress", Qos::command()),
        [RUN_MONITOR] => [Outside("viewers")];

    /// How well the feeder feeds and the selector selects, once a second: parts a minute, gaps in m
    FEED_METRICS: TopicSpec<FeedMetrics> = TopicSpec::new(FEEDER, "feed_metrics", Qos::command()),
        [RUN_MONITOR] => [Outside("viewers")];
}
