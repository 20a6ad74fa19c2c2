//! The machine that the driver drives, here a simulated one.
//!
//! This is where another machine is plugged in: a type that is a [`PlanarMotor`](feeder_model::motor::PlanarMotor), and how
//! to connect to it. A simulated motor has one thing to do that hardware does not: it tells the simulated parts how the tray
//! really moved. The driver knows nothing of that.

use std::time::Duration;

use feeder_runtime::node::{Declare, NodeError, Publisher, StepIo, stamp_of_ns};
use feeder_scenario::SimulatedCourier;
use feeder_sim::motor::SimulatedMotor;
use feeder_wire::{frames, topics};
use minifactory_msgs::msg::TrayMotion;

/// The motor.
pub(crate) type Motor = SimulatedMotor;

/// What the machine is called on `/diagnostics`.
pub(crate) const HARDWARE_ID: &str = "simulated courier";

/// Connects to the motor, which rests at the courier's start.
pub(crate) fn connect(courier: &SimulatedCourier, seed: u64) -> Result<Motor, NodeError> {
    courier.simulated_motor(seed).map_err(NodeError::new)
}

/// Handle of the port on which the truth goes out.
pub(crate) type TruthPort = Publisher<TrayMotion>;

pub(crate) fn declare(io: &mut Declare) -> TruthPort {
    io.publisher(&topics::TRAY_MOTION)
}

/// Tells how the tray really moved.
pub(crate) struct Truth {
    port: TruthPort,
    tick: Duration,
    sequence: u32,
}

impl Truth {
    pub(crate) fn new(port: TruthPort, tick: Duration) -> Self {
        Self { port, tick, sequence: 0 }
    }

    /// Publishes the motion in the tick that has just passed.
    pub(crate) fn publish(&mut self, io: &mut StepIo, motor: &mut Motor) {
        let started_ns = io.now_ns().saturating_sub(u64::try_from(self.tick.as_nanos()).unwrap_or(0));
        let mut message = feeder_wire::tray_motion::to_message(&motor.take_block());
        message.header.stamp = stamp_of_ns(started_ns);
        frames::PLATEN.clone_into(&mut message.header.frame_id);
        message.sequence = self.sequence;
        self.sequence += 1;
        io.publish(&self.port, &message);
    }
}
