//! `feeder bag record`: the ROS graph into a bag.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use clap::ValueEnum;
use feeder_bag_transport::record::{GraphRecorder, GraphSettings, RecordError, TopicCount, definitions};
use feeder_runtime::dds::{Domain, NodeName, Participant};
use indicatif::{ProgressBar, ProgressStyle};
use regex::Regex;
use ros2_bags::{BagError, BagWriter, Compression, Distribution, Selection, WriteSettings};

/// Record topics of the ROS graph until Ctrl-C; without a choice, all that are not hidden
#[derive(Debug, clap::Args)]
pub(crate) struct RecordArgs {
    /// Folder for the bag; it must not exist yet
    #[arg(long, short, value_name = "DIR")]
    out: PathBuf,
    /// Topics to record
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    topics: Vec<String>,
    /// Topics to record: those whose name this pattern is found in
    #[arg(long, short = 'e', value_name = "REGEX")]
    regex: Option<Regex>,
    /// Topics to record: those of these types
    #[arg(long, value_name = "TYPE", num_args = 1..)]
    topic_types: Vec<String>,
    /// Topics to leave out
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    exclude_topics: Vec<String>,
    /// Topics to leave out: those whose name this pattern is found in
    #[arg(long, short = 'x', value_name = "REGEX")]
    exclude_regex: Option<Regex>,
    /// Hidden topics too
    #[arg(long)]
    include_hidden_topics: bool,
    /// Only the topics that are there at the start
    #[arg(long)]
    no_discovery: bool,
    /// Begin a new file at this size, bytes
    #[arg(long, short = 'b', value_name = "BYTES", value_parser = clap::value_parser!(u64).range(1..))]
    max_bag_size: Option<u64>,
    /// Begin a new file after this time, s
    #[arg(long, short = 'd', value_name = "SECONDS", value_parser = seconds)]
    max_bag_duration: Option<Duration>,
    /// How chunks are packed
    #[arg(long, value_enum, default_value_t = Packing::Zstd)]
    compression: Packing,
    /// Write for the tools of this distribution: humble, iron, jazzy, kilted or lyrical
    #[arg(long, value_name = "DISTRO", default_value_t)]
    compat: Distribution,
    /// Take times from /clock; nothing is recorded before the first of it
    #[arg(long)]
    use_sim_time: bool,
    /// End after this time, s
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    duration: Option<Duration>,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Packing {
    None,
    Lz4,
    Zstd,
}

/// A positive number of seconds.
pub(super) fn seconds(text: &str) -> Result<Duration, String> {
    let value: f64 = text.parse().map_err(|_| format!("{text:?} is no number"))?;
    Duration::try_from_secs_f64(value)
        .ok()
        .filter(|duration| !duration.is_zero())
        .ok_or_else(|| format!("{text} is no positive number of seconds"))
}

/// The domain of `--domain` or the environment.
pub(super) fn domain(id: Option<u16>) -> anyhow::Result<Domain> {
    let mut domain = Domain::from_env()?;
    if let Some(id) = id {
        domain.id = id;
    }
    Ok(domain)
}

/// A flag that Ctrl-C and SIGTERM set.
pub(super) fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot listen for signals")?;
    }
    Ok(stop)
}

/// Records until a signal comes or the time is up.
pub(crate) fn run(args: &RecordArgs) -> anyhow::Result<()> {
    let stop = stop_flag()?;
    let settings = WriteSettings {
        distribution: args.compat,
        compression: match args.compression {
            Packing::None => Compression::None,
            Packing::Lz4 => Compression::Lz4,
            Packing::Zstd => Compression::Zstd,
        },
        live: true,
        split_bytes: args.max_bag_size,
        split_ns: args.max_bag_duration.and_then(|duration| u64::try_from(duration.as_nanos()).ok()),
        ..WriteSettings::default()
    };
    let selection = Selection {
        topics: args.topics.clone(),
        regex: args.regex.clone(),
        types: args.topic_types.clone(),
        exclude_topics: args.exclude_topics.clone(),
        exclude_regex: args.exclude_regex.clone(),
        hidden: args.include_hidden_topics,
    };
    let settings_of_graph =
        GraphSettings { selection, use_sim_time: args.use_sim_time, no_discovery: args.no_discovery };
    let writer = BagWriter::create(&args.out, settings)?;
    let participant = Participant::open(&domain(args.domain)?, &NodeName::new("/", "rosbag2_recorder")?)?;
    let mut recorder = GraphRecorder::new(writer, definitions(), settings_of_graph);
    let view = ProgressBar::new_spinner();
    view.set_style(
        ProgressStyle::with_template("{elapsed_precise}  {msg}").unwrap_or_else(|_| ProgressStyle::default_spinner()),
    );
    eprintln!("recording to {}; Ctrl-C ends it", args.out.display());
    let started = Instant::now();
    let mut missed = 0;
    let result = recorder.run(&participant, &stop, |counts, writer| {
        view.set_message(line(counts, writer));
        let now_missed = missing(counts);
        if now_missed > missed {
            view.suspend(|| eprintln!("LOST {} messages in all, {} more than before", now_missed, now_missed - missed));
            missed = now_missed;
        }
        if args.duration.is_some_and(|duration| started.elapsed() >= duration) {
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
        }
    });
    view.finish_and_clear();
    let counts = recorder.counts();
    for count in &counts {
        println!("{:>9} {}", count.recorded, count.topic);
    }
    for TopicCount { topic, lost, dropped, .. } in counts.iter().filter(|count| count.lost + count.dropped > 0) {
        println!("LOST on {topic}: {lost} never arrived, {dropped} arrived and were dropped as the disk was too slow");
    }
    let recorded: u64 = counts.iter().map(|count| count.recorded).sum();
    println!("{recorded} messages of {} topics, {} lost", counts.len(), missing(&counts));
    let writer = recorder.into_writer();
    match result {
        Ok(()) => writer.finish().map(|_| ()).context("cannot close the bag"),
        Err(RecordError::Bag(full @ BagError::Full { .. })) => {
            writer.finish().context("cannot close the bag")?;
            bail!(full)
        }
        Err(error) => Err(error.into()),
    }
}

fn missing(counts: &[TopicCount]) -> u64 {
    counts.iter().map(|count| count.lost + count.dropped).sum()
}

fn line(counts: &[TopicCount], writer: &BagWriter) -> String {
    #[expect(clippy::cast_precision_loss, reason = "shown with one decimal")]
    let size_mib = writer.size_bytes() as f64 / f64::from(1 << 20);
    let messages = writer.message_count();
    format!("{messages} messages of {} topics, {size_mib:.1} MiB, {} lost", counts.len(), missing(counts))
}
