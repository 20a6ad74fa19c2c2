//! Services with messages in place of bytes.

use std::{
    future::Future,
    marker::PhantomData,
    pin::Pin,
    task::{Context, Poll},
    time::Duration,
};

use minifactory_msgs::{Message, Service};

use crate::{
    cdr::{self, CdrError},
    dds::{Call, CallError, Client, DdsError, Participant, ReplyHandle, Server},
};

impl Participant {
    /// Offers a service whose answers are known at once. `answer` runs on the participant's thread and
    /// must return soon (see [`crate::dds`]). A request that cannot be read is logged and counted.
    ///
    /// # Errors
    /// [`DdsError::Name`] for a bad name, [`DdsError::Endpoint`] when the middleware refuses.
    pub fn serve<S: Service>(
        &self,
        name: &str,
        mut answer: impl FnMut(S::Request) -> S::Response + Send + 'static,
    ) -> Result<Server, DdsError> {
        self.serve_later::<S>(name, move |request, responder| {
            responder.send(&answer(request));
        })
    }

    /// Offers a service whose answers may come later and from any thread. `deliver` runs on the
    /// participant's thread and must return soon (see [`crate::dds`]).
    ///
    /// # Errors
    /// As [`serve`](Self::serve).
    pub fn serve_later<S: Service>(
        &self,
        name: &str,
        mut deliver: impl FnMut(S::Request, Responder<S>) + Send + 'static,
    ) -> Result<Server, DdsError> {
        let (request_type, response_type) = dds_types::<S>();
        self.server(name, &request_type, &response_type, move |request| match request.decode() {
            Ok(message) => deliver(message, Responder { reply: request.reply, service: PhantomData }),
            Err(error) => request.reply.refuse(&error),
        })
    }

    /// Makes a client of a service.
    ///
    /// # Errors
    /// As [`serve`](Self::serve).
    pub fn service_client<S: Service>(&self, name: &str) -> Result<ServiceClient<S>, DdsError> {
        let (request_type, response_type) = dds_types::<S>();
        let client = self.client(name, &request_type, &response_type)?;
        Ok(ServiceClient { client, service: PhantomData })
    }
}

fn dds_types<S: Service>() -> (String, String) {
    (<S::Request as Message>::INFO.dds_type(), <S::Response as Message>::INFO.dds_type())
}

/// The right to answer one request. Dropped unused, the client gets no answer.
#[derive(Debug)]
pub struct Responder<S> {
    reply: ReplyHandle,
    service: PhantomData<fn() -> S>,
}

impl<S: Service> Responder<S> {
    /// Answers. Returns at once; see [`ReplyHandle::send`].
    pub fn send(self, response: &S::Response) {
        self.reply.send_message(response);
    }
}

/// A client of a service. Calls in flight end when it is dropped.
pub struct ServiceClient<S> {
    client: Client,
    service: PhantomData<fn() -> S>,
}

impl<S: Service> ServiceClient<S> {
    /// Whether a server is there to take a request.
    #[must_use]
    pub fn is_available(&self) -> bool {
        self.client.is_available()
    }

    /// Sends a request as soon as a server is there.
    pub fn call(&self, request: &S::Request, timeout: Duration) -> ServiceCall<S::Response> {
        let call = cdr::encode(request).map(|payload| self.client.call(payload, timeout));
        ServiceCall { call: call.map_err(Some), response: PhantomData }
    }
}

/// Why a call has no answer.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// No reply came.
    #[error(transparent)]
    Call(#[from] CallError),
    /// The request cannot be written or the reply cannot be read.
    #[error(transparent)]
    Cdr(#[from] CdrError),
    /// The answer was taken before.
    #[error("a call is answered only once")]
    Taken,
}

/// A call in flight: a future, for any executor, or something to wait for.
#[derive(Debug)]
pub struct ServiceCall<R> {
    call: Result<Call, Option<CdrError>>,
    response: PhantomData<fn() -> R>,
}

impl<R: Message> ServiceCall<R> {
    /// Blocks until the call has ended.
    ///
    /// # Errors
    /// [`ServiceError`] when there is no answer.
    pub fn wait(self) -> Result<R, ServiceError> {
        match self.call {
            Ok(call) => Ok(call.wait()?.decode()?),
            Err(error) => Err(error.map_or(ServiceError::Taken, ServiceError::Cdr)),
        }
    }
}

impl<R: Message> Future for ServiceCall<R> {
    type Output = Result<R, ServiceError>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let answer = match &mut self.call {
            Ok(call) => match std::task::ready!(Pin::new(call).poll(context)) {
                Ok(reply) => reply.decode().map_err(ServiceError::Cdr),
                Err(error) => Err(error.into()),
            },
            Err(error) => Err(error.take().map_or(ServiceError::Taken, ServiceError::Cdr)),
        };
        self.call = Err(None);
        Poll::Ready(answer)
    }
}
