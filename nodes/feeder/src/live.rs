//! `feeder view` and `feeder top`: show a graph that runs already, or a bag that is being played, on a page or on the
//! terminal.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::{Context as _, bail};
use feeder_runtime::dds::Domain;
use feeder_scenario::plan::{RunPlan, load_plan, named};
use feeder_top::Screen;
use feeder_view::{Place, Settings, Source, View};
use ros2_bags::Bag;

use crate::bag::recorded_plan;
use crate::up::stop_on_signals;

/// Between two looks at whether somebody wants it to end.
const LOOK: Duration = Duration::from_millis(100);

/// What is shown.
#[derive(Debug, Clone, clap::Args)]
struct What {
    /// What runs: its scenario or plan, or the bag that is played; without it the built-in scenario
    #[arg(long, value_name = "FILE|BAG")]
    scenario: Option<PathBuf>,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

/// Show a running graph on a page, or a bag that is being played; without an address on this machine alone.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct ViewArgs {
    /// Where the page is: an address with a port, or one of both
    #[arg(value_name = "ADDRESS|PORT")]
    place: Option<Place>,
    #[command(flatten)]
    what: What,
    /// The page controls nothing
    #[arg(long)]
    view_read_only: bool,
}

/// Show a running graph on this terminal, or a bag that is being played.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct TopArgs {
    #[command(flatten)]
    what: What,
}

impl What {
    fn plan(&self) -> anyhow::Result<RunPlan> {
        match &self.scenario {
            Some(path) if path.is_dir() || path.extension().is_some_and(|extension| extension == "mcap") => {
                recorded_plan(&Bag::open(path)?)
            }
            file => Ok(load_plan(file.as_deref())?),
        }
    }

    fn show(&self, place: Option<Place>, read_only: bool) -> anyhow::Result<View> {
        let plan = self.plan().context("--scenario")?;
        let mut domain = Domain::from_env()?;
        domain.id = self.domain.unwrap_or(domain.id);
        let scenario = named(self.scenario.as_deref());
        let settings = Settings { place, read_only, source: Source::Graph, scenario, domain };
        Ok(View::start(&plan, &settings)?)
    }
}

/// Shows it on a page until a signal comes.
pub(crate) fn view(args: &ViewArgs) -> anyhow::Result<()> {
    let stop = stop_on_signals()?;
    let view = args.what.show(Some(args.place.unwrap_or(Place::Default)), args.view_read_only)?;
    eprintln!("see it live at {}", view.url().unwrap_or_default());
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(LOOK);
    }
    Ok(())
}

/// Shows it on the terminal until a key or a signal comes.
pub(crate) fn top(args: &TopArgs) -> anyhow::Result<()> {
    let stop = stop_on_signals()?;
    if !feeder_top::is_possible() {
        bail!(
            "feeder top draws on a terminal and reads its keys: standard input and output must be one, and TERM must say \
             which; feeder view shows the same on a page"
        );
    }
    let view = args.what.show(None, true)?;
    let watch = view.watch().context("nobody can look")?;
    let mut screen = Screen::open(watch, "the same on a page: feeder view", Arc::clone(&stop))?;
    while !stop.load(Ordering::Relaxed) && screen.is_open() {
        std::thread::sleep(LOOK);
    }
    screen.close();
    Ok(())
}
