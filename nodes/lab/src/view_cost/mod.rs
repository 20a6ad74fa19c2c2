//! `feeder-lab view-cost`: what a view costs a run: frames, bytes, processor time, speed.

mod suite;
mod viewer;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};
use feeder_scenario::Scenario;

use suite::{Outcome, Pace, Suite};
use viewer::{Looking, Traffic, Viewer};

/// Measure what the view costs: what a viewer gets, processor time of the suite with viewers, and speed and fingerprint of
/// runs at full speed. Rounds alternate, so that ratios hold on a busy machine too.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The `feeder` command that is measured; without it the one beside this command
    #[arg(long, value_name = "FILE")]
    feeder: Option<PathBuf>,
    /// Parts in the tray
    #[arg(long, value_delimiter = ',', default_value = "10,100", value_parser = clap::value_parser!(u32).range(1..=200))]
    parts: Vec<u32>,
    /// Wall seconds of each measurement at the speed of real time
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=3600), default_value_t = 10)]
    seconds: u64,
    /// Simulated seconds of each run at full speed
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=3600), default_value_t = 40)]
    simulated: u64,
    /// How often everything is measured
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100), default_value_t = 3)]
    rounds: u32,
    /// All nodes of a suite in one process instead of one process each
    #[arg(long)]
    composed: bool,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

/// What a viewer may want to see: a name, and channels of the view.
const WISHES: [(&str, &[&str]); 4] = [
    ("frames and events", &["frame", "event"]),
    ("with motion", &["frame", "event", "motion", "servo"]),
    ("with pictures", &["frame", "event", "picture"]),
    ("everything, as the page", EVERYTHING),
];
const EVERYTHING: &[&str] = &["frame", "event", "motion", "servo", "picture"];
/// Viewers beside which the suite's processor time is taken.
const VIEWERS: [usize; 3] = [0, 1, 5];
/// What the messages of a second weigh is told in this.
const KILO: f64 = 1000.0;

/// Who looks at a run at full speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Audience {
    NoView,
    Nobody,
    One,
    /// One that never reads.
    Stalled,
}

const AUDIENCES: [(Audience, &str); 4] = [
    (Audience::NoView, "without `--view`"),
    (Audience::Nobody, "with it, nobody looks"),
    (Audience::One, "one viewer of everything"),
    (Audience::Stalled, "one that never reads"),
];

/// What is measured, with what.
struct Bench<'a> {
    args: &'a Args,
    feeder: PathBuf,
}

/// Measures and prints tables in Markdown.
///
/// # Errors
/// A suite that does not start, or does not come to its end.
pub(crate) fn run(args: &Args) -> Result<()> {
    let beside = || Ok::<_, std::io::Error>(std::env::current_exe()?.with_file_name("feeder"));
    let feeder = args.feeder.clone().map_or_else(beside, Ok)?;
    ensure!(feeder.is_file(), "{}: there is no such command; build it, or name it with --feeder", feeder.display());
    let bench = Bench { args, feeder };
    bench.traffic()?;
    bench.processor_time()?;
    bench.full_speed()
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a few rounds")]
    let count = values.clone().count() as f64;
    values.sum::<f64>() / count
}

/// The mean of some values, with the least and the largest.
fn with_range(values: &[f64], digits: usize) -> String {
    let (least, most) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    format!("{:.digits$} ({least:.digits$}–{most:.digits$})", mean(values.iter().copied()))
}

impl Bench<'_> {
    fn period(&self) -> Duration {
        Duration::from_secs(self.args.seconds)
    }

    /// A suite of the built-in scenario with so many parts.
    fn start(&self, parts: u32, pace: Pace, has_view: bool) -> Result<Suite> {
        let scenario = Scenario { parts_loaded: parts, ..Scenario::default() };
        let Args { domain, composed, .. } = self.args;
        let domain = domain.map(|domain| format!("--domain={domain}"));
        let options: Vec<&str> = domain.as_deref().into_iter().chain(composed.then_some("--composed")).collect();
        Suite::start(&self.feeder, &options, &scenario, pace, has_view)
    }

    /// What a viewer gets.
    fn traffic(&self) -> Result<()> {
        println!("| Parts | A viewer of | Frames a second | kB/s |\n|---|---|---|---|");
        for parts in &self.args.parts {
            let suite = self.start(*parts, Pace::RealTime, true)?;
            let mut heard: Vec<Vec<Traffic>> = vec![Vec::new(); WISHES.len()];
            for _ in 0..self.args.rounds {
                for ((_, channels), heard) in WISHES.iter().zip(&mut heard) {
                    fill_up(suite.address()?, *parts)?;
                    let mut viewer = Viewer::connect(suite.address()?, channels)?;
                    heard.push(viewer.look(self.period())?);
                }
            }
            suite.end()?;
            for ((name, _), heard) in WISHES.iter().zip(heard) {
                let frames: Vec<f64> = heard.iter().map(Traffic::frames_per_s).collect();
                let bytes_per_s = mean(heard.iter().map(Traffic::bytes_per_s));
                println!("| {parts} | {name} | {} | {:.0} |", with_range(&frames, 1), bytes_per_s / KILO);
            }
        }
        Ok(())
    }

    /// What the suite takes of a core with viewers of everything.
    fn processor_time(&self) -> Result<()> {
        let parts = Scenario::default().parts_loaded;
        let suite = self.start(parts, Pace::RealTime, true)?;
        let mut shares: Vec<Vec<f64>> = vec![Vec::new(); VIEWERS.len()];
        for _ in 0..self.args.rounds {
            for (count, shares) in VIEWERS.iter().zip(&mut shares) {
                fill_up(suite.address()?, parts)?;
                let looking = (0..*count).map(|_| Viewer::connect(suite.address()?, EVERYTHING));
                let looking: Vec<Viewer> = looking.collect::<Result<_>>()?;
                let looking: Vec<_> = looking.into_iter().map(Viewer::read_in_background).collect();
                let (before_s, since) = (suite.cpu_s()?, Instant::now());
                std::thread::sleep(self.period());
                shares.push((suite.cpu_s()? - before_s) / since.elapsed().as_secs_f64());
                looking.into_iter().try_for_each(Looking::leave)?;
            }
        }
        suite.end()?;
        println!(
            "\n| Viewers of everything | Processor time of the suite, {parts} parts, real time: % of a core |\n|---|---|"
        );
        for (count, shares) in VIEWERS.iter().zip(shares) {
            let percent: Vec<f64> = shares.iter().map(|share| 100.0 * share).collect();
            println!("| {count} | {} |", with_range(&percent, 0));
        }
        Ok(())
    }

    /// How fast runs go, and whether they come out the same.
    fn full_speed(&self) -> Result<()> {
        let parts = Scenario::default().parts_loaded;
        let mut runs: Vec<Vec<Outcome>> = AUDIENCES.iter().map(|_| Vec::new()).collect();
        for _ in 0..self.args.rounds {
            for ((audience, name), runs) in AUDIENCES.iter().zip(&mut runs) {
                runs.push(self.at_full_speed(parts, *audience).with_context(|| format!("a run {name}"))?);
            }
        }
        let reference = runs[0][0].digest.clone();
        println!(
            "\n| {} s at full speed | Simulated seconds per wall second | Processor time, s | Fingerprint |\n|---|---|---|---|",
            self.args.simulated
        );
        for ((_, name), runs) in AUDIENCES.iter().zip(&runs) {
            let factors: Vec<f64> = runs.iter().map(|run| run.real_time_factor).collect();
            let cpu_s: Vec<f64> = runs.iter().map(|run| run.cpu_s).collect();
            let same = runs.iter().all(|run| run.digest == reference);
            let word = if same { "the same" } else { "DIFFERENT" };
            println!("| {name} | {} | {} | {word} |", with_range(&factors, 1), with_range(&cpu_s, 1));
        }
        ensure!(runs.iter().flatten().all(|run| run.digest == reference), "a viewer has changed the run");
        Ok(())
    }

    fn at_full_speed(&self, parts: u32, audience: Audience) -> Result<Outcome> {
        let suite = self.start(parts, Pace::Full(self.args.simulated), audience != Audience::NoView)?;
        match audience {
            Audience::NoView | Audience::Nobody => suite.outcome(),
            Audience::One => {
                let looking = Viewer::connect(suite.address()?, EVERYTHING)?.read_in_background();
                let outcome = suite.outcome()?;
                let traffic = looking.end()?;
                ensure!(traffic.frames > 0, "the viewer has seen nothing");
                Ok(outcome)
            }
            Audience::Stalled => {
                let _stalled = Viewer::connect(suite.address()?, EVERYTHING)?;
                suite.outcome()
            }
        }
    }
}

/// Has parts loaded until there are so many, since some are delivered meanwhile.
fn fill_up(address: SocketAddr, parts: u32) -> Result<()> {
    let mut viewer = Viewer::connect(address, WISHES[0].1)?;
    let there = viewer.parts()?;
    let missing = parts.saturating_sub(there);
    if missing > 0 {
        viewer.load_parts(missing)?;
    }
    Ok(())
}

/// A file that is written by a run, read when it has ended.
fn read(path: &Path) -> Result<String> {
    std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
}
