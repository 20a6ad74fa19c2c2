//! `feeder view`: shows a graph that runs already, or a bag that is being played.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::Context as _;
use feeder_bags::Bag;
use feeder_runtime::dds::Domain;
use feeder_scenario::plan::{RunPlan, load_plan, named};
use feeder_view::{Place, Settings, Source, View};

use crate::bag::recorded_plan;
use crate::up::stop_on_signals;

/// Between two looks at whether somebody wants it to end.
const LOOK: Duration = Duration::from_millis(100);

/// Show a running graph on a page, or a bag that is being played; without an address on this machine alone.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Where the page is: an address with a port, or one of both
    #[arg(value_name = "ADDRESS|PORT")]
    place: Option<Place>,
    /// What runs: its scenario or plan, or the bag that is played; without it the built-in scenario
    #[arg(long, value_name = "FILE|BAG")]
    scenario: Option<PathBuf>,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
    /// The page controls nothing
    #[arg(long)]
    view_read_only: bool,
}

impl Args {
    fn plan(&self) -> anyhow::Result<RunPlan> {
        match &self.scenario {
            Some(path) if path.is_dir() || path.extension().is_some_and(|extension| extension == "mcap") => {
                recorded_plan(&Bag::open(path)?)
            }
            file => Ok(load_plan(file.as_deref())?),
        }
    }
}

/// Shows it until a signal comes.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let stop = stop_on_signals()?;
    let plan = args.plan().context("--scenario")?;
    let mut domain = Domain::from_env()?;
    domain.id = args.domain.unwrap_or(domain.id);
    let settings = Settings {
        place: args.place.unwrap_or(Place::Default),
        read_only: args.view_read_only,
        source: Source::Graph,
        scenario: named(args.scenario.as_deref()),
        domain,
    };
    let view = View::start(&plan, &settings)?;
    eprintln!("see it live at {}", view.url());
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(LOOK);
    }
    Ok(())
}
