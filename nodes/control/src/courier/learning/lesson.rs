//! What was learned of one waveform.

use nalgebra::{Complex, Vector3};

use super::super::response::LoopModel;
use super::Instant;
use super::harmonic::{Harmonic, Prior};
use super::mode::{Ratio, TrayMode};
use super::plant::Seen;
use super::projection::{Amplitude, Projection};
use super::wanted::Wanted;
use super::watch::{Followed, Watch};
use feeder_model::waveform::Waveform;

/// The acceleration learned for one waveform, and what is known of the plant at its harmonics.
#[derive(Clone, Debug)]
pub(super) struct Lesson {
    waveform: Waveform,
    axis: usize,
    fundamental_rad_s: f64,
    /// Coefficients of the position that the set point asks for on the vibrating axis, first harmonic first.
    position: Vec<Complex<f64>>,
    /// By how much the plant may differ from a rigid one before its harmonics are measured, relative.
    spread: f64,
    /// Acceleration that each axis needs, rms: on the vibrating one the set point's, on the others what couples into them.
    scale: Vector3<f64>,
    /// Acceleration that the forcers give each axis at their peak.
    reach: Vector3<f64>,
    /// Of the vibrating axis' acceleration that about each harmonic, as a share of the whole: what is disturbed by the motion
    /// itself is so in this proportion.
    envelope: Vec<f64>,
    /// What of the position goes with the command, and the square of the command, summed over windows, and the windows.
    raw: Vec<(Complex<f64>, f64)>,
    /// Harmonics of the axes that do not vibrate.
    lateral_orders: usize,
    projection: Projection,
    harmonics: Vec<[Harmonic; 3]>,
    /// The acceleration to add to that of feedback and feed-forward. A constant one is the controller's integral's to find.
    learned: Vec<Amplitude>,
    /// By how much it changed last, rms.
    change: f64,
    /// Ticks to let pass before the next window: what a change stirs up dies away.
    wait_ticks: u32,
    settle_ticks: u32,
    updates: u32,
    /// Acceleration that disturbances need, as a share of the waveform's own, rms.
    disturbed: f64,
    /// How the tray swings, if it does.
    mode: Option<TrayMode>,
    /// Windows in a row that found it so.
    mode_windows: u32,
    watch: Watch,
}

impl Lesson {
    /// Windows are at least this long, s.
    const WINDOW_S: f64 = 0.1;
    /// How far the centre of mass may be off the centre, m: by this lever the axes couple.
    const LEVER_M: f64 = 3e-3;
    /// The same where the excitation has measured it: by this the plant in motion may differ from that at rest.
    const MEASURED_SPREAD: f64 = 0.1;
    /// Disturbance expected in a harmonic, and by how much it changes from window to window, as shares of the acceleration
    /// about it.
    const DISTURBANCE: f64 = 0.1;
    const DRIFT: f64 = 1e-3;
    /// Share of a change of the command by which the disturbance changes, such as that of ripple.
    const COUPLING: f64 = 0.1;
    /// Share of the acceleration on an axis that does not vibrate which couples into it without a lever.
    const CROSS: f64 = 0.05;
    /// By about this lever forcers turn the courier, m.
    const ARM_M: f64 = 0.05;
    /// What a window keeps of those before it in the sums by which a mode is looked for.
    const RAW_MEMORY: f64 = 0.98;
    /// Relative error of what is measured beside the noise: what is left of transients, and leaks from harmonic to harmonic.
    const LEAK: f64 = 1e-3;
    /// How far a command may go from that of the rigid plant: shares of that command and of the acceleration's rms. Where
    /// this binds, what is measured is not what the command did.
    const OWN_SHARE_MAX: f64 = 3.0;
    const SHARE_MAX: f64 = 0.15;
    /// The second of these shares for an axis that is to stand still: all that couples into it may be in one harmonic.
    const LATERAL_SHARE_MAX: f64 = 2.0;
    /// The first of these shares for a tray that swings: beyond its frequency it takes as many times the force.
    const SWINGING_SHARE_MAX: f64 = 30.0;
    /// Share of the acceleration that the forcers give at their peak which all of it may have, rms, from the lowest
    /// frequency on.
    const RMS_OF_PEAK: f64 = 0.3;
    /// Share of that in which a command moves whose effect may be anything.
    const PROBE: f64 = 0.1;
    /// Windows after which a mode is looked for.
    const MODE_UPDATES: u32 = 2;
    /// Windows in a row that must find one before it is spoken of. With a long period there are only a few of them in the first
    /// seconds of feeding.
    const MODE_WINDOWS: u32 = 2;
    /// An answer known better than this, relative, has been measured.
    const MEASURED: f64 = 0.03;
    /// Errors of a plant's answer when a mode is looked for: of all, relative, and as a share of the acceleration's rms over
    /// that of the harmonic.
    const ROUGH: f64 = 0.01;
    const POLLUTION: f64 = 1e-3;
    /// A change below this share of the acceleration's rms stirs nothing up.
    const STIR: f64 = 0.01;
    /// Share of a larger disturbance that a window adds to what is said of it: one window's noise is none.
    const DISTURBED_GAIN: f64 = 0.3;

    /// A lesson that begins with the acceleration by which the model would follow, of a plant that may differ by `spread`
    /// from a rigid one and gets at most the wrench `reach`.
    pub(super) fn new(
        vibration: &Instant,
        models: &[LoopModel; 3],
        mass: &Vector3<f64>,
        reach: &Vector3<f64>,
        lateral_hz: f64,
        spread: f64,
    ) -> Self {
        let LoopModel { control, period_s, .. } = models[0];
        let axis = vibration.axis;
        let position = vibration.fourier.position().to_vec();
        let fundamental_rad_s = vibration.fourier.fundamental_rad_s();
        let orders = (1_u32..).map(f64::from);
        let squares: Vec<f64> =
            orders.zip(&position).map(|(k, p)| (k * fundamental_rad_s).powi(4) * p.norm_sqr()).collect();
        let rms = (0.5 * squares.iter().sum::<f64>()).sqrt();
        let envelope = (0..squares.len()).map(|index| {
            let reach = (index / 3).max(2);
            let about = &squares[index.saturating_sub(reach)..(index + reach + 1).min(squares.len())];
            (about.iter().sum::<f64>() / about.len() as f64).sqrt() / rms
        });
        let force = rms * mass[axis];
        // Couplings by a centre of mass off the centre, and by forcers that do not give all the same.
        let scale = Vector3::from_fn(|other, _| match (other == axis, other == 2, axis == 2) {
            (true, ..) => rms,
            (false, true, _) => force * (Self::LEVER_M + Self::CROSS * Self::ARM_M) / mass.z,
            (false, false, true) => rms * Self::LEVER_M + Self::CROSS * force / (Self::ARM_M * mass[other]),
            (false, false, false) => rms * Self::CROSS,
        });
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred harmonics")]
        let lateral_orders = (lateral_hz * vibration.waveform.period_s() * (1.0 + 1e-9)) as usize;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred ticks")]
        let settle_ticks = (1.0 / (control.bandwidth_hz * period_s)).round() as u32;
        let mut lesson = Self {
            waveform: vibration.waveform.clone(),
            axis,
            fundamental_rad_s,
            spread,
            scale,
            reach: reach.component_div(mass),
            envelope: envelope.collect(),
            raw: vec![(Complex::from(0.0), 0.0); position.len()],
            lateral_orders: lateral_orders.min(position.len()),
            projection: Projection::new(fundamental_rad_s, position.len(), Self::WINDOW_S / period_s, period_s),
            harmonics: Vec::new(),
            learned: vec![Amplitude::zeros(); position.len()],
            change: 0.0,
            wait_ticks: 0,
            settle_ticks,
            updates: 0,
            disturbed: 0.0,
            mode: None,
            mode_windows: 0,
            watch: Watch::new(position.len()),
            position,
        };
        lesson.harmonics = lesson.priors(models).map(|priors| priors.map(Harmonic::new)).collect();
        lesson.begin(models);
        lesson
    }

    /// Takes over what an excitation at rest showed, by the order of the harmonic.
    pub(super) fn take_measured(&mut self, measured: &[(usize, Seen)], models: &[LoopModel; 3]) {
        for (order, seen) in measured {
            let Some(harmonic) = self.harmonics.get_mut(order - 1) else { continue };
            let expected = harmonic[self.axis].plant();
            let plant = seen.position / seen.command;
            let variance = seen.variance / seen.command.norm_sqr() + (Self::MEASURED_SPREAD * plant.norm()).powi(2);
            harmonic[self.axis].believe(plant, variance, self.spread * expected.norm());
        }
        self.begin(models);
    }

    /// Aims anew, at what would follow on the plant and under the disturbances as believed now.
    fn begin(&mut self, models: &[LoopModel; 3]) {
        let wanted: Vec<_> = self.wanted_of_axes(models).collect();
        let mut spent = [0.0; 3];
        for (index, wanted) in wanted.iter().enumerate() {
            for axis in self.axes(index) {
                let (wanted, harmonic) = (&wanted[axis], &self.harmonics[index][axis]);
                let rigid = wanted.rigid;
                let most = self.most(axis, rigid, spent);
                let aim = (wanted.position - harmonic.disturbance()) / harmonic.plant();
                let command = rigid + cut(aim - rigid, most);
                spent[axis] += (command - rigid).norm_sqr();
                self.learned[index][axis] = wanted.learned(command, wanted.position);
            }
        }
        self.forget_window();
    }

    pub(super) fn teaches(&self, waveform: &Waveform) -> bool {
        self.waveform == *waveform
    }

    /// Another load that is known: aims anew at what would follow under it. What was given up is tried again.
    pub(super) fn follow(&mut self, models: &[LoopModel; 3]) {
        if self.watch.is_given_up() {
            self.retry(models);
        } else {
            self.begin(models);
        }
    }

    /// A wish to try again: aims anew, and tries what was given up.
    pub(super) fn retry(&mut self, models: &[LoopModel; 3]) {
        self.watch = Watch::new(self.position.len());
        self.begin(models);
        self.doubt(models);
    }

    /// Doubts all that was found, as when something has changed that nobody spoke of.
    pub(super) fn doubt(&mut self, models: &[LoopModel; 3]) {
        let priors: Vec<_> = self.priors(models).collect();
        for (harmonics, priors) in self.harmonics.iter_mut().zip(&priors) {
            harmonics.iter_mut().zip(priors).for_each(|(harmonic, prior)| harmonic.doubt(prior));
        }
    }

    /// The learned acceleration at this tick.
    pub(super) fn acceleration(&mut self, elapsed_s: f64) -> Vector3<f64> {
        let powers = self.projection.advance(elapsed_s);
        let mut acceleration = Vector3::zeros();
        if !self.watch.is_given_up() {
            for (learned, power) in self.learned.iter().zip(powers) {
                for axis in 0..3 {
                    acceleration[axis] += (learned[axis] * power).re;
                }
            }
        }
        acceleration
    }

    /// Notes what was measured and commanded at this tick, and what was asked for beyond that. Says whether a window is full.
    pub(super) fn note(&mut self, error: &Vector3<f64>, command: &Vector3<f64>, cut: &Vector3<f64>) -> bool {
        if self.wait_ticks > 0 {
            self.wait_ticks -= 1;
            return false;
        }
        self.projection.add(error, command, cut);
        self.projection.is_full()
    }

    /// Begins a new window, once what the present tick stirs up has died away.
    pub(super) fn forget_window(&mut self) {
        self.projection.forget();
        self.wait_ticks = self.settle_ticks;
    }

    /// What a full window shows of the plant of the vibrating axis; to be asked once a window.
    pub(super) fn seen(&mut self) -> Vec<Seen> {
        let axis = self.axis;
        self.projection.measure_noise();
        let variance = self.projection.noise()[axis];
        let seen = self.projection.amplitudes().zip(&self.position).zip(1_u32..);
        let seen = seen.map(|(((error, command), set_point), order)| Seen {
            omega_rad_s: self.fundamental_rad_s * f64::from(order),
            command: command[axis],
            position: set_point - error[axis],
            variance,
        });
        seen.collect()
    }

    /// How much more than expected a full window is off, as a ratio of squares: the mean over the harmonics that are known
    /// best, those in the noise left out.
    pub(super) fn surprise(&self, seen: &[Seen]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (seen, harmonics) in seen.iter().zip(&self.harmonics) {
            let harmonic = &harmonics[self.axis];
            let noise = seen.variance + (Self::LEAK * seen.position.norm()).powi(2);
            let expected = harmonic.position_deviation(seen.command).powi(2) + noise;
            if seen.position.norm_sqr() > 100.0 * seen.variance {
                sum += (seen.position - harmonic.predict(seen.command)).norm_sqr() / expected;
                count += 1.0;
            }
        }
        sum / f64::max(count, 1.0)
    }

    /// Takes over a model of the vibrating axis that has changed.
    pub(super) fn rescale(&mut self, from: &LoopModel, to: &LoopModel) {
        for (harmonics, order) in self.harmonics.iter_mut().zip(1_u32..) {
            let omega_rad_s = self.fundamental_rad_s * f64::from(order);
            harmonics[self.axis].rescale(to.at(omega_rad_s).position / from.at(omega_rad_s).position);
        }
    }

    /// Corrects what is learned by a full window, and begins the next one.
    pub(super) fn update(&mut self, models: &[LoopModel; 3]) {
        let noise = self.projection.noise();
        let wanted: Vec<[Wanted; 3]> = self.wanted_of_axes(models).collect();
        let amplitudes: Vec<_> = self.projection.amplitudes().zip(self.projection.cut()).collect();
        // A change that stirs nothing up is that of the noise.
        let coupled = Self::COUPLING * (self.change / self.scale[self.axis] - Self::STIR).max(0.0);
        self.watch.begin();
        let mut targets = self.learned.clone();
        let (mut square, mut needed, mut spent) = (0.0, 0.0, [0.0; 3]);
        for (index, (wanted, ((error, given), beyond))) in wanted.iter().zip(amplitudes).enumerate() {
            for axis in self.axes(index) {
                let wanted = &wanted[axis];
                let harmonic = &mut self.harmonics[index][axis];
                let (position, command) = (wanted.set_point - error[axis], given[axis]);
                let scale = self.scale[axis];
                let about = self.envelope[index] * scale;
                let changed = (Self::DRIFT * about).powi(2) + (coupled * about).powi(2);
                harmonic.drift(wanted.response.position.norm_sqr() * changed);
                harmonic.observe(command, position, noise[axis] + (Self::LEAK * position.norm()).powi(2));
                harmonic.note_beyond_rigid(position - wanted.response.position * command);
                let rigid = wanted.rigid;
                let most = self.most(axis, rigid, spent);
                let harmonic = &mut self.harmonics[index][axis];
                let way = (wanted.position - harmonic.disturbance()) / harmonic.plant() - command;
                let step = way * harmonic.caution();
                let step = if harmonic.contracts() { step } else { cut(step, Self::PROBE * most) };
                let aim = rigid + cut(command + step - rigid, most);
                spent[axis] += (aim - rigid).norm_sqr();
                // What is always cut has to be asked for the more.
                let asked = aim + cut(beyond[axis], most);
                targets[index][axis] = wanted.learned(asked, harmonic.predict(aim));
                if axis == self.axis {
                    needed += harmonic.sure_disturbance_square() / wanted.response.position.norm_sqr();
                    // All of it as the tray does it.
                    let tray = wanted.tray_over_seen;
                    let followed = Followed {
                        omega_rad_s: wanted.response.omega_rad_s,
                        wanted: tray * wanted.position / wanted.share,
                        reached: tray * position,
                        expected: tray * harmonic.predict(command),
                        with_feedback: tray * wanted.without_learning(harmonic),
                        noise: tray.norm_sqr() * noise[axis],
                    };
                    if self.watch.judge(index, &followed) {
                        targets[index][axis] = Complex::from(0.0);
                    }
                    square += (targets[index][axis] - self.learned[index][axis]).norm_sqr();
                }
            }
        }
        let disturbed = (0.5 * needed).sqrt() / self.scale[self.axis];
        let more = (disturbed - self.disturbed).max(0.0);
        self.disturbed = self.disturbed.min(disturbed) + Self::DISTURBED_GAIN * more;
        self.watch.end();
        self.learned = targets;
        self.change = (0.5 * square).sqrt();
        self.updates = self.updates.saturating_add(1);
        self.projection.forget();
        let stirs = self.change > Self::STIR * self.scale[self.axis];
        self.wait_ticks = if stirs { self.settle_ticks } else { 0 };
    }

    /// Looks for a mode of the tray in what is seen of the plant.
    pub(super) fn find_mode(&mut self, seen: &[Seen], model: &LoopModel) {
        for (raw, seen) in self.raw.iter_mut().zip(seen) {
            raw.0 = raw.0 * Self::RAW_MEMORY + seen.position * seen.command.conj();
            raw.1 = raw.1 * Self::RAW_MEMORY + seen.command.norm_sqr();
        }
        if self.updates < Self::MODE_UPDATES {
            return;
        }
        let known = self.mode.is_some();
        let windows = f64::from(self.updates + 1).min(1.0 / (1.0 - Self::RAW_MEMORY));
        let ratios =
            self.raw.iter().zip(seen).filter(|((_, square), _)| *square > 0.0).map(|((product, square), seen)| {
                let rigid = model.at(seen.omega_rad_s).position;
                // Where little is commanded, what disturbs passes for an answer.
                let polluted = Self::POLLUTION * self.scale[self.axis] / (square / windows).sqrt();
                let noise = (seen.variance / square).sqrt() / rigid.norm();
                let deviation = Self::ROUGH.hypot(polluted).hypot(noise);
                Ratio { omega_rad_s: seen.omega_rad_s, ratio: product / square / rigid, deviation }
            });
        self.mode = TrayMode::fit(&ratios.collect::<Vec<_>>(), known);
        self.mode_windows = if self.mode.is_some() { self.mode_windows.saturating_add(1) } else { 0 };
        if let Some(mode) = self.mode.filter(|_| !known) {
            for (harmonics, seen) in self.harmonics.iter_mut().zip(seen) {
                let harmonic = &mut harmonics[self.axis];
                let plant = model.at(seen.omega_rad_s).position * mode.seen_over_rigid(seen.omega_rad_s);
                let off = if harmonic.uncertainty() > Self::MEASURED { (plant - harmonic.plant()).norm() } else { 0.0 };
                let spread = off.hypot(harmonic.uncertainty() * harmonic.plant().norm());
                harmonic.believe(plant, (Self::MEASURED_SPREAD * plant.norm()).powi(2), spread);
            }
        }
    }

    /// Acceleration that disturbances need, as a share of the waveform's own, rms.
    pub(super) fn disturbed(&self) -> f64 {
        self.disturbed
    }

    /// How the tray swings, once enough windows in a row have found it so.
    pub(super) fn sure_mode(&self) -> Option<&TrayMode> {
        self.mode.as_ref().filter(|_| self.mode_windows >= Self::MODE_WINDOWS)
    }

    pub(super) fn updates(&self) -> u32 {
        self.updates
    }

    pub(super) fn axis(&self) -> usize {
        self.axis
    }

    pub(super) fn watch(&self) -> &Watch {
        &self.watch
    }

    pub(super) fn give_up(&mut self) {
        self.watch.give_up();
    }

    /// What is known of the plant's answer on the vibrating axis: frequency, answer, its relative uncertainty.
    pub(super) fn plant(&self) -> impl Iterator<Item = (f64, Complex<f64>, f64)> + '_ {
        self.harmonics.iter().zip(1_u32..).map(|(harmonics, order)| {
            let harmonic = &harmonics[self.axis];
            (self.fundamental_rad_s * f64::from(order), harmonic.plant(), harmonic.uncertainty())
        })
    }

    /// How far a command may go from `rigid`, that of a rigid courier, when `spent` is the sum of squares by which those of
    /// lower frequency have gone.
    fn most(&self, axis: usize, rigid: Complex<f64>, spent: [f64; 3]) -> f64 {
        let swings = axis == self.axis && self.mode.is_some();
        let own = if swings { Self::SWINGING_SHARE_MAX } else { Self::OWN_SHARE_MAX };
        let share = if axis == self.axis { Self::SHARE_MAX } else { Self::LATERAL_SHARE_MAX };
        let most = own * rigid.norm() + share * self.scale[axis];
        let left = 2.0 * (Self::RMS_OF_PEAK * self.reach[axis]).powi(2) - spent[axis];
        most.min(left.max(0.0).sqrt())
    }

    /// The axes on which a harmonic is learned.
    fn axes(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        let (axis, lateral) = (self.axis, index < self.lateral_orders);
        (0..3).filter(move |&other| other == axis || lateral)
    }

    /// The other axes are to stand still.
    fn wanted_of_axes<'a>(&'a self, models: &'a [LoopModel; 3]) -> impl Iterator<Item = [Wanted; 3]> + 'a {
        self.position.iter().zip(1_u32..).map(move |(&set_point, order)| {
            [0, 1, 2].map(|axis| {
                let set_point = if axis == self.axis { set_point } else { Complex::from(0.0) };
                let model = &models[axis];
                let response = model.at(self.fundamental_rad_s * f64::from(order));
                let omega_rad_s = response.omega_rad_s;
                let tray = self.mode.filter(|_| axis == self.axis).map_or((Complex::from(1.0), 0.0), |mode| {
                    (mode.tray_over_seen(omega_rad_s), mode.tray_uncertainty(omega_rad_s))
                });
                Wanted::new(set_point, response, model.control.feed_forward, tray)
            })
        })
    }

    fn priors<'a>(&'a self, models: &'a [LoopModel; 3]) -> impl Iterator<Item = [Prior; 3]> + 'a {
        (1..=self.position.len()).map(move |order| {
            [0, 1, 2].map(|axis| {
                let plant = models[axis].at(self.fundamental_rad_s * order as f64).position;
                Prior {
                    plant,
                    plant_variance: (self.spread * plant.norm()).powi(2),
                    disturbance_variance: (Self::DISTURBANCE
                        * self.envelope[order - 1]
                        * self.scale[axis]
                        * plant.norm())
                    .powi(2),
                }
            })
        })
    }
}

/// `value`, or what of it has the magnitude `most`.
fn cut(value: Complex<f64>, most: f64) -> Complex<f64> {
    let norm = value.norm();
    if norm > most { value * (most / norm) } else { value }
}
