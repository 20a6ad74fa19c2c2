//! The machine that the driver drives, here a simulated one.
//!
//! This is where another machine is plugged in: a type that is a [`PlanarMotor`](feeder_model::motor::PlanarMotor), and how
//! to connect to it. A simulated motor has two things to do that hardware does not: it tells the simulated parts how the tray
//! really moved, and carries as many of them as there really are. The driver knows nothing of that.

use std::time::Duration;

use feeder_model::motor::Load;
use feeder_runtime::node::{Declare, NodeError, Publisher, StepIo, Subscriber, stamp_of_ns};
use feeder_scenario::SimulatedCourier;
use feeder_sim::motor::SimulatedMotor;
use feeder_wire::{frames, topics};
use minifactory_msgs::msg::{PartStates, TrayMotion};

/// The motor.
pub(crate) type Motor = SimulatedMotor;

/// What the machine is called on `/diagnostics`.
pub(crate) const HARDWARE_ID: &str = "simulated courier";

/// Connects to the motor, which rests at the courier's start.
pub(crate) fn connect(courier: &SimulatedCourier, seed: u64) -> Result<Motor, NodeError> {
    courier.simulated_motor(seed).map_err(NodeError::new)
}

/// Handles of the ports between the simulated motor and the simulated parts.
pub(crate) struct TruthPorts {
    motion: Publisher<TrayMotion>,
    parts: Subscriber<PartStates>,
}

pub(crate) fn declare(io: &mut Declare) -> TruthPorts {
    TruthPorts { motion: io.publisher(&topics::TRAY_MOTION), parts: io.subscriber(&topics::PARTS) }
}

/// Tells the parts how the tray really moved, and the motor what it really carries.
pub(crate) struct Truth {
    ports: TruthPorts,
    tick: Duration,
    sequence: u32,
    /// What the tray carries beside parts, and the mass of a part, kg.
    own: Load,
    part_kg: f64,
    /// Parts that the motor carries; none before it has heard of any.
    carried: Option<usize>,
}

impl Truth {
    pub(crate) fn new(ports: TruthPorts, tick: Duration, own: Load, part_kg: f64) -> Self {
        Self { ports, tick, sequence: 0, own, part_kg, carried: None }
    }

    /// Hears which parts there are. The motor is loaded with them where they are when their number changes; what they move
    /// between is little.
    pub(crate) fn hear(&mut self, io: &mut StepIo, motor: &mut Motor) {
        let Some(newest) = io.take(&self.ports.parts).pop() else { return };
        if self.carried == Some(newest.parts.len()) {
            return;
        }
        self.carried = Some(newest.parts.len());
        let part = |radius_m: f64| Load { mass_kg: self.part_kg, inertia_kg_m2: self.part_kg * radius_m * radius_m };
        let load = newest.parts.iter().fold(self.own, |load, state| load.with(1.0, &part(state.radius_m)));
        motor.set_load(&load);
    }

    /// Publishes the motion in the tick that has just passed.
    pub(crate) fn publish(&mut self, io: &mut StepIo, motor: &mut Motor) {
        let started_ns = io.now_ns().saturating_sub(u64::try_from(self.tick.as_nanos()).unwrap_or(0));
        let mut message = feeder_wire::tray_motion::to_message(&motor.take_block());
        message.header.stamp = stamp_of_ns(started_ns);
        frames::PLATEN.clone_into(&mut message.header.frame_id);
        message.sequence = self.sequence;
        self.sequence += 1;
        io.publish(&self.ports.motion, &message);
    }
}
