//! The services of rosbag2's player, under its names.

use std::sync::mpsc::Sender;

use feeder_runtime::dds::{DdsError, Participant, Server};
use feeder_runtime::node::ns_of_stamp;
use minifactory_msgs::Service;
use minifactory_msgs::rosbag2_interfaces::srv::{
    Burst, BurstResponse, GetRate, GetRateResponse, IsPaused, IsPausedResponse, Pause, PauseResponse, Play, PlayNext,
    PlayNextResponse, PlayResponse, Resume, ResumeResponse, Seek, SeekResponse, SetRate, SetRateResponse, Stop,
    StopResponse, TogglePaused, TogglePausedResponse,
};

use super::control::{Control, Done};

/// Serves `~/pause`, `~/resume`, `~/toggle_paused`, `~/is_paused`, `~/set_rate`, `~/get_rate`, `~/play`, `~/play_next`,
/// `~/burst`, `~/seek` and `~/stop` until the result is dropped; what is asked goes to `controls`.
///
/// # Errors
/// When DDS refuses a server.
pub fn serve(participant: &Participant, controls: &Sender<Control>) -> Result<Vec<Server>, DdsError> {
    let offer = Offer { participant, controls };
    Ok(vec![
        offer.service::<Pause, _>("pause", |_, done| Control::Pause(done), |()| PauseResponse::default())?,
        offer.service::<Resume, _>("resume", |_, done| Control::Resume(done), |()| ResumeResponse::default())?,
        offer.service::<TogglePaused, _>(
            "toggle_paused",
            |_, done| Control::TogglePaused(done),
            |()| TogglePausedResponse::default(),
        )?,
        offer.service::<IsPaused, _>(
            "is_paused",
            |_, done| Control::IsPaused(done),
            |paused| IsPausedResponse { paused },
        )?,
        offer.service::<SetRate, _>(
            "set_rate",
            |request, done| Control::SetRate(request.rate, done),
            |success| SetRateResponse { success },
        )?,
        offer.service::<GetRate, _>("get_rate", |_, done| Control::GetRate(done), |rate| GetRateResponse { rate })?,
        offer.service::<PlayNext, _>(
            "play_next",
            |_, done| Control::PlayNext(done),
            |success| PlayNextResponse { success },
        )?,
        offer.service::<Burst, _>(
            "burst",
            |request, done| Control::Burst(request.num_messages, done),
            |actually_burst| BurstResponse { actually_burst },
        )?,
        offer.service::<Seek, _>(
            "seek",
            |request, done| Control::Seek(ns_of_stamp(&request.time), done),
            |success| SeekResponse { success },
        )?,
        offer.service::<Stop, _>("stop", |_, done| Control::Stop(done), |()| StopResponse::default())?,
        // A player ends with its bag, so while there is one to ask it is playing already.
        participant.serve::<Play>(&offer.name("play"), |_| PlayResponse { success: false })?,
    ])
}

struct Offer<'a> {
    participant: &'a Participant,
    controls: &'a Sender<Control>,
}

impl Offer<'_> {
    fn name(&self, name: &str) -> String {
        let node = self.participant.node().to_string();
        format!("{node}/{name}")
    }

    /// `ask` makes the control of a request, `answer` the response of its outcome.
    fn service<S: Service, T: 'static>(
        &self,
        name: &str,
        ask: impl Fn(S::Request, Done<T>) -> Control + Send + 'static,
        answer: fn(T) -> S::Response,
    ) -> Result<Server, DdsError> {
        let controls = self.controls.clone();
        self.participant.serve_later::<S>(&self.name(name), move |request, responder| {
            let done = Done::tell(move |outcome| responder.send(&answer(outcome)));
            // A closed inbox belongs to a player that has ended; its caller gets no answer.
            let _ = controls.send(ask(request, done));
        })
    }
}
