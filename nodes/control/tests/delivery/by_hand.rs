//! A sequencer to which reports are made by hand, at times of the test's own.

use std::time::Duration;

use feeder_control::courier::CourierLimits;
use feeder_control::delivery::{
    CandidateFrame, CourierReport, Delivered, DeliveryConfig, DeliveryId, DeliverySequencer, Failure, MoveId, Output,
    Stamp, Warning,
};
use feeder_model::motor::Load;
use feeder_model::tray::TrayGeometry;
use nalgebra::Vector3;

use crate::world::{asking, config, washer};

/// Where the parts lie in the tray, and where the courier stands to bring them under the station `right`.
pub(crate) const PART_M: [f64; 2] = [0.0, -0.07];
pub(crate) const STAND: [f64; 3] = [0.3, 0.17, 0.0];

pub(crate) fn at(s: f64) -> Stamp {
    Duration::from_secs_f64(s)
}

/// A sequencer with one request, whose courier is at rest at the feeding place from 1 s on.
pub(crate) struct ByHand {
    pub(crate) sequencer: DeliverySequencer,
    pub(crate) id: DeliveryId,
}

impl ByHand {
    /// The same before the courier has reported.
    pub(crate) fn unheard(config: DeliveryConfig) -> Self {
        Self::asked(config, 0.5e-3, None)
    }

    fn asked(config: DeliveryConfig, tolerance_m: f64, timeout: Option<Duration>) -> Self {
        let (tray, limits) = (TrayGeometry::PAPER, CourierLimits::default());
        let mut sequencer = DeliverySequencer::new(config, tray, limits, Load::default()).unwrap();
        let mut request = asking("right", tolerance_m);
        request.timeout = timeout;
        let id = sequencer.request(at(0.5), request).unwrap();
        Self { sequencer, id }
    }

    pub(crate) fn new(config: DeliveryConfig, tolerance_m: f64, timeout: Option<Duration>) -> Self {
        let mut this = Self::asked(config, tolerance_m, timeout);
        this.home(1.0, false);
        this.step(1.0);
        this
    }

    /// The courier says where it is and whether it moves.
    pub(crate) fn courier(&mut self, s: f64, position: Vector3<f64>, moving: bool) {
        self.sequencer.courier(CourierReport { stamp: at(s), position, vibrating: false, moving });
    }

    /// The same of the feeding place.
    pub(crate) fn home(&mut self, s: f64, moving: bool) {
        self.courier(s, config().feeding_place, moving);
    }

    /// A picture shows parts at these places, m.
    pub(crate) fn see(&mut self, s: f64, places_m: &[[f64; 2]]) {
        let candidates = (1..).zip(places_m).map(|(id, &place_m)| washer(id, place_m.into()));
        let candidates = candidates.collect();
        self.sequencer.candidates(CandidateFrame { stamp: at(s), candidates, is_blind: false });
    }

    pub(crate) fn step(&mut self, s: f64) -> Vec<Output> {
        self.sequencer.step(at(s))
    }

    /// Whether a move begins.
    pub(crate) fn departs(&mut self, s: f64) -> Option<MoveId> {
        self.step(s).into_iter().find_map(|output| match output {
            Output::Move(id, _) => Some(id),
            _ => None,
        })
    }

    pub(crate) fn presents(&mut self, s: f64) -> Option<Delivered> {
        self.step(s).into_iter().find_map(|output| match output {
            Output::Presented(_, delivered) => Some(delivered),
            _ => None,
        })
    }

    /// How a delivery ended, and the warnings given.
    pub(crate) fn ends(&mut self, s: f64) -> (Option<Result<(), Failure>>, Vec<Warning>) {
        let (mut end, mut warnings) = (None, Vec::new());
        for output in self.step(s) {
            match output {
                Output::Finished(_, result) => end = Some(result.map(|_| ())),
                Output::Warning(warning) => warnings.push(warning),
                _ => {}
            }
        }
        (end, warnings)
    }

    /// On the way to the station since 1.1 s.
    pub(crate) fn departed(config: DeliveryConfig, tolerance_m: f64, timeout: Option<Duration>) -> (Self, MoveId) {
        let mut this = Self::new(config, tolerance_m, timeout);
        this.step(1.06);
        this.see(1.08, &[PART_M]);
        let id = this.departs(1.1).unwrap();
        (this, id)
    }

    /// The courier has arrived at 2 s, so far off along x, m.
    pub(crate) fn arrived(config: DeliveryConfig, tolerance_m: f64, timeout: Option<Duration>, off_m: f64) -> Self {
        let (mut this, id) = Self::departed(config, tolerance_m, timeout);
        this.sequencer.move_ended(id, Ok(()));
        this.courier(2.0, Vector3::from(STAND) + Vector3::x() * off_m, false);
        this
    }
}
