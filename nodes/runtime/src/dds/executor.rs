//! The one thread of a participant, on which all its readers are drained.

use std::{
    future::Future,
    io,
    pin::Pin,
    sync::{Mutex, PoisonError, mpsc},
    task::{Context, Poll},
    thread::{self, JoinHandle, ThreadId},
};

use tokio::{runtime, sync::oneshot, task::AbortHandle};

/// Runs tasks on a thread of its own. Dropping it drops the tasks and joins the thread.
pub(super) struct Executor {
    spawner: Spawner,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Executor {
    pub(super) fn start(thread_name: &str) -> io::Result<Self> {
        // No I/O driver: the DDS library has its own threads for sockets and wakes us through
        // wakers, so parking is a futex wait rather than a poll of descriptors.
        let runtime = runtime::Builder::new_current_thread().enable_time().build()?;
        let handle = runtime.handle().clone();
        let (stop, stopped) = oneshot::channel::<()>();
        let thread = thread::Builder::new().name(thread_name.to_owned()).spawn(move || {
            // Ends by the message or by the sender's end; both mean stop.
            let _ = runtime.block_on(stopped);
        })?;
        let spawner = Spawner { handle, thread: thread.thread().id() };
        Ok(Self { spawner, stop: Some(stop), thread: Some(thread) })
    }

    /// Starts a task; it ends when it is done or when the returned handle is dropped.
    pub(super) fn spawn(&self, future: impl Future<Output = ()> + Send + 'static) -> Task {
        let (alive, ended) = mpsc::channel();
        let task = self.spawner.handle.spawn(Tracked { future: Box::pin(future), _alive: alive });
        Task { abort: task.abort_handle(), ended: Mutex::new(ended), spawner: self.spawner.clone() }
    }

    pub(super) fn spawner(&self) -> &Spawner {
        &self.spawner
    }
}

/// Starts tasks on an executor without keeping it alive.
#[derive(Clone)]
pub(super) struct Spawner {
    handle: runtime::Handle,
    thread: ThreadId,
}

impl Spawner {
    /// Starts a task that runs until it is done or the executor ends; after that it is dropped at once.
    pub(super) fn spawn(&self, future: impl Future<Output = ()> + Send + 'static) {
        self.handle.spawn(future);
    }

    /// Whether this is the executor's own thread.
    pub(super) fn is_current_thread(&self) -> bool {
        self.thread == thread::current().id()
    }
}

impl Drop for Executor {
    fn drop(&mut self) {
        self.stop.take();
        if let Some(thread) = self.thread.take() {
            // A thread cannot join itself: that happens when a callback owned the last handle of
            // its own participant.
            if !self.spawner.is_current_thread() && thread.join().is_err() {
                tracing::error!("the DDS thread had panicked");
            }
        }
    }
}

/// A running task. Dropping it ends the task and waits until everything the task owned is gone.
pub(crate) struct Task {
    abort: AbortHandle,
    // Behind a lock only because a receiver cannot be shared between threads, and handles are.
    ended: Mutex<mpsc::Receiver<()>>,
    spawner: Spawner,
}

impl Drop for Task {
    fn drop(&mut self) {
        self.abort.abort();
        if !self.spawner.is_current_thread() {
            // Nothing is ever sent: this returns when the task's end of the channel is dropped.
            let _ = self.ended.get_mut().unwrap_or_else(PoisonError::into_inner).recv();
        }
    }
}

/// A future whose end can be waited for; the future is dropped before the channel.
struct Tracked {
    future: Pin<Box<dyn Future<Output = ()> + Send>>,
    _alive: mpsc::Sender<()>,
}

impl Future for Tracked {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        self.future.as_mut().poll(context)
    }
}
