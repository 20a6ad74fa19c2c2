//! `feeder-lab experiment`: experiments on the simulated courier, the paper's and others.

mod faults;
mod learning;
mod rig;

use anyhow::Result;
use clap::{Args as ClapArgs, Subcommand};

/// Experiments on the simulated courier.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(Debug, Subcommand)]
enum Experiment {
    /// Fig. 6 of the paper, stick-slip on a block, with the courier in the loop.
    Fig6(rig::Args),
    /// Fig. 8 of the paper, the Coulomb pump on a block, with the courier in the loop.
    Fig8(rig::Args),
    Learning(learning::Args),
    Faults(faults::Args),
}

pub(crate) fn run(args: &Args) -> Result<()> {
    match &args.experiment {
        Experiment::Fig6(args) => rig::run(rig::Figure::Six, args),
        Experiment::Fig8(args) => rig::run(rig::Figure::Eight, args),
        Experiment::Learning(args) => learning::run(args),
        Experiment::Faults(args) => faults::run(args),
    }
}
