//! The waveform generator: owns the waveform and whether it runs.
//!
//! The waveform goes out as a description, latched; the courier driver runs it at servo rate. A new waveform is checked
//! against the courier's limits before it is published.
//!
//! A generator that is made inactive stops the courier first, and goes on when it is active again with what it was asked
//! for last: off may be asked for at any time.

use std::time::Duration;

use feeder_control::courier::WaveformEnvelope;
use feeder_model::waveform::Waveform;
use feeder_runtime::node::{Declare, FeederNode, NodeError, Publisher, Server, Start, StepIo, Subscriber};
use feeder_scenario::plan::{NodeConfig, WaveformGeneratorConfig};
use feeder_wire::{courier_state, nodes, response, services, topics};
use minifactory_msgs::msg;
use minifactory_msgs::srv::SetWaveform;
use minifactory_msgs::std_srvs::srv::SetBool;

/// Between two publications of a waveform that runs, or that the courier has not acknowledged, ns.
const REPEAT_PERIOD_NS: u64 = 500_000_000;

/// Handles of the generator's ports.
#[derive(Debug)]
pub struct Ports {
    waveform: Publisher<msg::Waveform>,
    courier_state: Subscriber<msg::CourierState>,
    set_feeding: Server<SetBool>,
    set_waveform: Server<SetWaveform>,
}

/// The waveform generator.
#[derive(Debug)]
pub struct WaveformGenerator {
    ports: Ports,
    /// What the courier can run: a waveform that its driver would refuse is not published.
    envelope: WaveformEnvelope,
    name: String,
    waveform: Waveform,
    /// Whether it was asked to run.
    enabled: bool,
    /// Whether the generator was active in the last step.
    active: bool,
    sequence: u32,
    /// The sequence that the courier has heard last.
    acknowledged: u32,
    /// The sequence of which it was said last that nobody acknowledges it.
    unheard_sequence: u32,
    /// When the waveform was last published.
    said_ns: u64,
    changed: bool,
}

impl FeederNode for WaveformGenerator {
    const NAME: &'static str = nodes::WAVEFORM_GENERATOR;
    const START: Option<Start> = Some(Start::Active);
    type Config = WaveformGeneratorConfig;
    type Ports = Ports;

    fn tick(config: &WaveformGeneratorConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &WaveformGeneratorConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, _: &WaveformGeneratorConfig) -> Ports {
        Ports {
            waveform: io.publisher(&topics::WAVEFORM),
            courier_state: io.subscriber(&topics::COURIER_STATE),
            set_feeding: io.server(&services::SET_FEEDING),
            set_waveform: io.server(&services::SET_WAVEFORM),
        }
    }

    fn open(ports: Ports, config: &WaveformGeneratorConfig) -> Result<Self, NodeError> {
        config.envelope.check(&config.waveform).map_err(NodeError::new)?;
        Ok(Self {
            ports,
            envelope: config.envelope,
            name: config.name.clone(),
            waveform: config.waveform.clone(),
            enabled: false,
            active: false,
            sequence: 0,
            acknowledged: 0,
            unheard_sequence: 0,
            said_ns: 0,
            changed: false,
        })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        for (asker, request) in io.requests(&self.ports.set_feeding) {
            let set = self.set_feeding(io, request.data);
            io.reply(&self.ports.set_feeding, asker, &response::to_message(set));
        }
        for (asker, request) in io.requests(&self.ports.set_waveform) {
            let replaced = io.check_active(Self::NAME).and_then(|()| self.replace(&request.waveform));
            io.reply(&self.ports.set_waveform, asker, &response::to_message(replaced.map(|()| "")));
        }
        self.changed |= self.active != io.is_active();
        self.active = io.is_active();
        let changed = std::mem::take(&mut self.changed);
        self.sequence += u32::from(changed);
        for state in io.take(&self.ports.courier_state) {
            self.acknowledged = courier_state::from_message(state).waveform_sequence;
        }
        // Said again as a sign of life while the courier vibrates, and until the courier has heard it.
        let unheard = self.acknowledged != self.sequence;
        let due = io.now_ns().saturating_sub(self.said_ns) >= REPEAT_PERIOD_NS;
        if changed || (self.active && (self.enabled || unheard) && due) {
            if !changed && unheard && self.unheard_sequence != self.sequence {
                self.unheard_sequence = self.sequence;
                tracing::warn!("no courier has acknowledged waveform {}: it is sent again", self.sequence);
            }
            self.said_ns = io.now_ns();
            let message = msg::Waveform {
                header: io.header(""),
                sequence: self.sequence,
                name: self.name.clone(),
                enabled: self.enabled && self.active,
                ..feeder_wire::waveform::to_message(&self.waveform)
            };
            io.publish(&self.ports.waveform, &message);
        }
        Ok(())
    }
}

impl WaveformGenerator {
    /// Turns feeding on or off, and says which.
    fn set_feeding(&mut self, io: &StepIo, on: bool) -> Result<&'static str, String> {
        if on {
            io.check_active(Self::NAME)?;
        }
        self.enabled = on;
        // Said anew even when nothing changes: the courier may have been stopped by somebody else.
        self.changed |= io.is_active();
        Ok(if on { "feeding" } else { "not feeding" })
    }

    /// Takes over a waveform; what was there stays when it is refused.
    fn replace(&mut self, message: &msg::Waveform) -> Result<(), String> {
        let waveform = feeder_wire::waveform::from_message(message).map_err(|error| error.to_string())?;
        self.envelope.check(&waveform).map_err(|error| error.to_string())?;
        self.waveform = waveform;
        self.name.clone_from(&message.name);
        self.enabled = message.enabled;
        self.changed = true;
        Ok(())
    }
}
