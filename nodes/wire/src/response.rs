//! Responses of services that say whether something was done, with a word on it for people, and no more.

use minifactory_msgs::Message;
use minifactory_msgs::srv::{
    ChangeRecipeResponse, PurgeResponse, ReleaseAreaResponse, ReportHandoverResponse, SetWaveformResponse,
};
use minifactory_msgs::std_srvs::srv::{SetBoolResponse, TriggerResponse};

/// A response that says whether something was done, with a word on it.
pub trait PlainResponse: Message {
    /// The response.
    fn of(done: bool, message: String) -> Self;

    /// Whether it was done, and the word on it.
    fn parts(self) -> (bool, String);
}

macro_rules! plain_responses {
    ($($response:ident.$done:ident),+ $(,)?) => {
        $(
            impl PlainResponse for $response {
                fn of(done: bool, message: String) -> Self {
                    Self { $done: done, message }
                }

                fn parts(self) -> (bool, String) {
                    (self.$done, self.message)
                }
            }
        )+
    };
}

plain_responses! {
    ChangeRecipeResponse.changed,
    PurgeResponse.purged,
    ReleaseAreaResponse.released,
    ReportHandoverResponse.accepted,
    SetBoolResponse.success,
    SetWaveformResponse.accepted,
    TriggerResponse.success,
}

/// What was done, or why it was not, as a response.
#[must_use]
pub fn to_message<R: PlainResponse>(said: Result<impl Into<String>, impl ToString>) -> R {
    match said {
        Ok(message) => R::of(true, message.into()),
        Err(reason) => R::of(false, reason.to_string()),
    }
}

/// The response of what was done.
#[must_use]
pub fn done<R: PlainResponse>(message: &str) -> R {
    R::of(true, message.to_owned())
}

/// What a response says: that it was done, or why it was not; either way with a word, which may be empty.
#[expect(clippy::missing_errors_doc, reason = "a response may be a refusal")]
pub fn from_message<R: PlainResponse>(response: R) -> Result<String, String> {
    let (done, message) = response.parts();
    if done { Ok(message) } else { Err(message) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_round_trip<R: PlainResponse>() {
        for said in [Ok("on the way".to_owned()), Err("another client has it".to_owned())] {
            let response: R = to_message(said.clone());
            assert_eq!(from_message(response), said);
        }
    }

    #[test]
    fn responses_survive_the_round_trip() {
        assert_round_trip::<ChangeRecipeResponse>();
        assert_round_trip::<PurgeResponse>();
        assert_round_trip::<ReleaseAreaResponse>();
        assert_round_trip::<ReportHandoverResponse>();
        assert_round_trip::<SetBoolResponse>();
        assert_round_trip::<SetWaveformResponse>();
        assert_round_trip::<TriggerResponse>();
        let refused: TriggerResponse = to_message(Err::<&str, _>("no"));
        assert_eq!(refused, TriggerResponse { success: false, message: "no".to_owned() });
    }
}
