//! Every decoder of bytes or text from outside, by name, for fuzzers and for the tests that replay what they found: none may
//! panic, hang, or take memory out of proportion to its input, whatever that is. `tests/fuzzers` has a target for each.

use std::sync::LazyLock;

use feeder_model::geometry::ShapeSpec;
use feeder_model::part::{PartSpec, PartType};
use feeder_runtime::cdr;
use feeder_scenario::Scenario;
use feeder_vision::{PartModel, Selector};
use minifactory_msgs::{Message, MessageVisitor, visit_messages};
use ros2_bags::recover::recover;
use ros2_bags::{Bag, WriteSettings};

/// Takes any input and returns.
pub type Target = fn(&[u8]);

/// The targets that are not the runtime's.
const TARGETS: &[(&str, Target)] = &[
    ("bag", bag),
    ("bag_metadata", bag_metadata),
    ("cdr", any_message),
    ("labels", feeder::fuzz_labels),
    ("part", part),
    ("part_model", part_model),
    ("picture", picture),
    ("recording", feeder_lab::fuzz_recording),
    ("scenario", scenario),
    ("stl", stl),
];

/// All targets, by name.
pub fn targets() -> impl Iterator<Item = (&'static str, Target)> {
    feeder_runtime::fuzzing::TARGETS.iter().chain(TARGETS).copied()
}

/// The target of this name.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn target(name: &str) -> Target {
    targets()
        .find(|(known, _)| *known == name)
        .map_or_else(|| panic!("there is no target {name}"), |(_, target)| target)
}

/// A bag of one file: opened, checked with every message taken apart, and recovered.
#[expect(clippy::expect_used, reason = "this is what fuzzers are to find")]
fn bag(input: &[u8]) {
    let work = tempfile::tempdir().expect("a folder for bags");
    let file = work.path().join("bag.mcap");
    std::fs::write(&file, input).expect("room for bags");
    if let Ok(bag) = Bag::open(&file) {
        let _ = ros2_bags::check::check(&bag);
        let again = work.path().join("again");
        if recover(&bag, &again, &WriteSettings::default()).is_ok() {
            let bag = Bag::open(&again).expect("a recovered bag can be opened");
            assert!(bag.problems().is_empty(), "{:?}", bag.problems());
        }
    }
}

/// A message of any type in either byte order: the first two bytes say which. Reading and writing every type takes long to
/// compile, so it is here and not in the runtime.
fn any_message(input: &[u8]) {
    struct One<'a> {
        skip: usize,
        body: &'a [u8],
        little_endian: bool,
    }

    impl MessageVisitor for One<'_> {
        fn visit<M: Message>(&mut self) {
            if self.skip == 0
                && let Ok(message) = cdr::decode::<M>(self.body, self.little_endian)
            {
                // What was read can be written, and is read again from that.
                #[expect(clippy::expect_used, reason = "this is what fuzzers are to find")]
                let body = cdr::encode(&message).expect("every message has a CDR form");
                assert!(cdr::decode::<M>(&body, true).is_ok(), "{} cannot be read again", M::INFO.ros_type());
            }
            self.skip = self.skip.wrapping_sub(1);
        }
    }

    if let [which, order, body @ ..] = input {
        visit_messages(&mut One { skip: usize::from(*which), body, little_endian: order & 1 == 1 });
    }
}

/// What `metadata.yaml` of a bag says.
fn bag_metadata(input: &[u8]) {
    if let Ok(metadata) = ros2_bags::metadata::Metadata::parse(&String::from_utf8_lossy(input)) {
        let _ = metadata.to_yaml();
    }
}

/// A part file with its mesh spelled out, or in solids.
fn part(input: &[u8]) {
    if let Ok(spec) = serde_saphyr::from_str::<PartSpec>(&String::from_utf8_lossy(input)) {
        let _ = PartType::new(&spec);
    }
}

/// The built-in scenario, in which models are tried.
static BUILT_IN: LazyLock<Scenario> = LazyLock::new(Scenario::default);

/// What `feeder teach` printed, and hands may have changed.
fn part_model(input: &[u8]) {
    let text = String::from_utf8_lossy(input);
    if let (Ok(model), Ok(part)) = (serde_saphyr::from_str::<PartModel>(&text), BUILT_IN.part_type()) {
        let (camera, tray) = (&BUILT_IN.camera.model, &BUILT_IN.tray);
        let _ = Selector::new(BUILT_IN.selector(&part), camera, tray, &model);
    }
}

/// A picture of a camera or a file.
fn picture(input: &[u8]) {
    let _ = feeder_vision::decode(input);
}

/// A scenario that names no files but those of the catalogue.
fn scenario(input: &[u8]) {
    let text = String::from_utf8_lossy(input);
    if let Ok(scenario) = text.parse::<Scenario>() {
        let _ = scenario.resolve(&text);
    }
}

/// A mesh, in millimetres, as the shape of a part.
fn stl(input: &[u8]) {
    let mut shape = ShapeSpec::Stl { file: "part.stl".to_owned(), unit_m: 1e-3 };
    if shape.read_stl(input).is_ok() {
        let spec = PartSpec {
            name: "part".to_owned(),
            density_kg_m3: 1000.0,
            friction_static: 0.2,
            friction_kinetic: 0.2,
            friction_uncertainty_ratio: 0.1,
            reflectance: 0.5,
            shape,
            poses: Vec::new(),
            wanted_poses: vec!["pose_1".to_owned()],
            drops: None,
        };
        let _ = PartType::new(&spec);
    }
}
