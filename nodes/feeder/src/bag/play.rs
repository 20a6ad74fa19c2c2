//! `feeder bag play`: a bag back to the ROS graph.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::channel;
use std::time::Duration;

use anyhow::Context as _;
use feeder_bag_transport::play::{Control, Done, PlaySettings, Played, Player, serve};
use feeder_runtime::dds::{NodeName, Participant};
use indicatif::{ProgressBar, ProgressStyle};
use regex::Regex;
use ros2_bags::qos::parse_overrides;
use ros2_bags::{Seconds, Selection};

use super::record::{domain, seconds, stop_flag};

/// Play a bag; its types need not be installed
///
/// Keys: space pauses and resumes, right plays the next message in pause, up and down change the rate by a tenth, page up
/// and page down go 10 s forward and back, left goes 1 s back, q ends. The services are those of rosbag2's player, under
/// /rosbag2_player.
#[derive(Debug, clap::Args)]
pub(crate) struct PlayArgs {
    /// The bag: a folder or an MCAP file
    bag: PathBuf,
    /// Seconds of the bag per second
    #[arg(long, short, value_parser = positive, default_value_t = 1.0)]
    rate: f64,
    /// Begin again at the end, for ever
    #[arg(long = "loop", short = 'l')]
    repeat: bool,
    /// Begin in pause
    #[arg(long, short = 'p')]
    start_paused: bool,
    /// Skip the first seconds
    #[arg(long, value_name = "SECONDS", value_parser = duration, default_value = "0")]
    start_offset: Duration,
    /// Play for so many seconds of the bag
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    playback_duration: Option<Duration>,
    /// Stop at this time in the bag, seconds since its epoch
    #[arg(long, value_name = "SECONDS", value_parser = duration, conflicts_with = "playback_until_nsec")]
    playback_until_sec: Option<Duration>,
    /// Stop at this time in the bag, ns since its epoch
    #[arg(long, value_name = "NANOSECONDS")]
    playback_until_nsec: Option<u64>,
    /// Wait before each beginning, s
    #[arg(long, short, value_name = "SECONDS", value_parser = duration, default_value = "0")]
    delay: Duration,
    /// Publish /clock so often, in place of that in the bag
    #[arg(long, value_name = "HZ", value_parser = positive, num_args = 0..=1, default_missing_value = "40")]
    clock: Option<f64>,
    /// Keep to the /clock that somebody else publishes, whatever the rate
    #[arg(long, conflicts_with_all = ["clock", "rate", "repeat"])]
    follow_clock: bool,
    /// Topics to play
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    topics: Vec<String>,
    /// Topics to play: those whose name this pattern is found in
    #[arg(long, short = 'e', value_name = "REGEX")]
    regex: Option<Regex>,
    /// Topics to leave out
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    exclude_topics: Vec<String>,
    /// Topics to leave out: those whose name this pattern is found in
    #[arg(long, short = 'x', value_name = "REGEX")]
    exclude_regex: Option<Regex>,
    /// Publish topics under other names
    #[arg(long, short = 'm', value_name = "OLD:=NEW", num_args = 1.., value_parser = remap)]
    remap: Vec<(String, String)>,
    /// File (YAML) with quality of service for topics, in place of the bag's, in rosbag2's form
    #[arg(long, value_name = "FILE")]
    qos_profile_overrides_path: Option<PathBuf>,
    /// Do not listen to keys
    #[arg(long)]
    disable_keyboard_controls: bool,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

fn positive(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| format!("{text} is no positive number"))
}

fn duration(text: &str) -> Result<Duration, String> {
    let value: f64 = text.parse().map_err(|_| format!("{text:?} is no number"))?;
    Duration::try_from_secs_f64(value).map_err(|_| format!("{text} is no number of seconds from zero"))
}

fn remap(text: &str) -> Result<(String, String), String> {
    let (old, new) = text.split_once(":=").ok_or_else(|| format!("{text:?} is not of the form /old:=/new"))?;
    Ok((old.to_owned(), new.to_owned()))
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Plays to the end, or until a signal or a key ends it.
pub(crate) fn run(args: &PlayArgs) -> anyhow::Result<ExitCode> {
    let stop = stop_flag()?;
    let bag = Arc::new(super::open(&args.bag)?);
    let qos_overrides = match &args.qos_profile_overrides_path {
        None => BTreeMap::new(),
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
            parse_overrides(&text).map_err(anyhow::Error::msg).with_context(|| path.display().to_string())?
        }
    };
    let start_offset_ns = nanoseconds(args.start_offset);
    let from_duration = args.playback_duration.zip(bag.bounds_ns()).map(|(duration, (first_ns, _))| {
        first_ns.saturating_add(start_offset_ns).saturating_add(nanoseconds(duration))
    });
    let until_ns = args.playback_until_sec.map(nanoseconds).or(args.playback_until_nsec);
    let settings = PlaySettings {
        selection: Selection {
            topics: args.topics.clone(),
            regex: args.regex.clone(),
            exclude_topics: args.exclude_topics.clone(),
            exclude_regex: args.exclude_regex.clone(),
            // What is in the bag was chosen when it was recorded.
            hidden: true,
            ..Selection::default()
        },
        rate: Some(args.rate),
        repeat: args.repeat,
        start_paused: args.start_paused,
        start_offset_ns,
        // Of both, the later one, as in rosbag2.
        until_ns: from_duration.max(until_ns),
        delay: args.delay,
        clock_hz: args.clock,
        follow_clock: args.follow_clock,
        remaps: args.remap.iter().cloned().collect(),
        qos_overrides,
    };
    let participant = Participant::open(&domain(args.domain)?, &NodeName::new("/", "rosbag2_player")?)?;
    let (sender, controls) = channel();
    let _services = serve(&participant, &sender)?;
    let player = Player::new(&participant, Arc::clone(&bag), settings, &sender, controls)?;
    let keyboard = if args.disable_keyboard_controls { None } else { super::keyboard::listen(sender.clone()) };
    let (first_ns, last_ns) = bag.bounds_ns().unwrap_or_default();
    let view = ProgressBar::new(last_ns - first_ns);
    let style = ProgressStyle::with_template("[{bar:32}]  {msg}").unwrap_or_else(|_| ProgressStyle::default_bar());
    view.set_style(style);
    let played = player.run(|position_ns, paused| {
        view.set_position(position_ns.saturating_sub(first_ns));
        view.set_message(format!("{}{}", Seconds(position_ns), if paused { "  paused" } else { "" }));
        if stop.load(Ordering::Relaxed) {
            // Obeyed with the next look at the controls.
            let _ = sender.send(Control::Stop(Done::nobody()));
        }
    });
    view.finish_and_clear();
    drop(keyboard);
    report(&played);
    Ok(ExitCode::SUCCESS)
}

fn report(played: &Played) {
    println!("{} messages played", played.messages);
    for (reason, count) in &played.failed {
        println!("LOST {count}: {reason}");
    }
    let quantile = |share| played.lateness.quantile_us(share);
    if let (Some(p50), Some(p99), Some(most)) = (quantile(0.5), quantile(0.99), quantile(1.0)) {
        println!("timing error: p50 {p50} µs, p99 {p99} µs, largest {most} µs");
    }
}
