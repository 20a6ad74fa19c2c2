//! `feeder-lab plan-move`: how long a gentle move takes, against what friction would allow.

use clap::ValueEnum;
use feeder_control::courier::CourierLimits;
use feeder_control::delivery::{GentleParameters, MovePlan, MovePlanner, PlanError};
use feeder_model::motor::Load;
use feeder_model::range::OutOfRange;
use feeder_model::tray::TrayGeometry;
use nalgebra::{Vector2, Vector3};
use serde::Serialize;

/// What to protect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
enum Protect {
    /// A part on the plateau.
    Selected,
    /// A part on the ramp, the move along its slope: uphill it is held less well than downhill.
    All,
}

/// Plan a straight move from rest to rest and print its figures as JSON.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct Args {
    /// Distance, m.
    #[arg(
        long,
        allow_negative_numbers = true,
        required_unless_present = "sweep",
        default_value_if("sweep", "true", "0.3")
    )]
    distance: Option<f64>,
    /// Print a list: 20 to 600 mm at μ 0.15, 0.2 and 0.3.
    #[arg(long, conflicts_with_all = ["distance", "mu"])]
    sweep: bool,
    /// How far the tray turns on the way, rad; with `--policy all`.
    #[arg(long, allow_negative_numbers = true, default_value_t = 0.0)]
    turn: f64,
    /// Coefficient of static friction between part and tray.
    #[arg(long, allow_negative_numbers = true, default_value_t = GentleParameters::default().friction)]
    mu: f64,
    /// Largest jerk, m/s³.
    #[arg(long, allow_negative_numbers = true, default_value_t = GentleParameters::default().jerk_m_s3_max)]
    jerk: f64,
    /// What to protect.
    #[arg(long, value_enum, default_value_t = Protect::Selected)]
    policy: Protect,
    /// Radius at which the part lies on the ramp, m.
    #[arg(long, allow_negative_numbers = true, default_value_t = TrayGeometry::PAPER.outer_radius_m)]
    ramp_radius: f64,
    /// Share of the acceleration held by friction that is used.
    #[arg(long, allow_negative_numbers = true, default_value_t = GentleParameters::default().friction_share)]
    friction_share: f64,
}

/// The figures of a move.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct MoveFigures {
    policy: Protect,
    distance_m: f64,
    friction: f64,
    friction_share: f64,
    jerk_m_s3_max: f64,
    /// Duration of the planned move.
    duration_s: f64,
    /// Least duration under the friction limit alone.
    bound_s: f64,
    /// Least duration under the friction limit and the jerk limit.
    jerk_bound_s: f64,
    /// Largest magnitude of acceleration of the planned move.
    peak_acceleration_m_s2: f64,
    /// The duration over `jerk_bound_s`.
    over_jerk_bound: f64,
}

/// Plans the move and prints its figures.
///
/// # Errors
/// An argument out of its range, or a move that cannot be planned.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    if !args.sweep {
        println!("{}", serde_json::to_string_pretty(&figures(args)?)?);
        return Ok(());
    }
    let rows: Vec<MoveFigures> = sweep(args).collect::<Result<_, _>>()?;
    println!("{}", serde_json::to_string_pretty(&rows)?);
    Ok(())
}

fn sweep(args: &Args) -> impl Iterator<Item = Result<MoveFigures, PlanError>> {
    let distances_m = [0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
    let args = *args;
    [0.15, 0.2, 0.3].into_iter().flat_map(move |mu| {
        distances_m.into_iter().map(move |distance_m| figures(&Args { distance: Some(distance_m), mu, ..args }))
    })
}

fn figures(args: &Args) -> Result<MoveFigures, PlanError> {
    let tray = TrayGeometry::PAPER;
    let limits = CourierLimits::default();
    let (distance_m, length_m) = (args.distance.unwrap_or(f64::NAN), limits.x_m_max - limits.x_m_min);
    let within = distance_m > 0.0 && distance_m <= length_m;
    OutOfRange::unless(within, "--distance", distance_m, format_args!("0 < distance ≤ {length_m} m"))?;
    let (radius_m, inner_m, outer_m) = (args.ramp_radius, tray.inner_radius_m, tray.outer_radius_m);
    let within = (inner_m..=outer_m).contains(&radius_m);
    OutOfRange::unless(within, "--ramp-radius", radius_m, format_args!("{inner_m} to {outer_m} m"))?;
    // One part on the axis of the move feels no turn.
    let turns = args.policy == Protect::All || args.turn == 0.0;
    OutOfRange::unless(turns, "--turn", args.turn, "0 with --policy selected, anything with --policy all")?;

    let gentle = GentleParameters {
        friction: args.mu,
        friction_share: args.friction_share,
        jerk_m_s3_max: args.jerk,
        ..GentleParameters::default()
    };
    let planner = MovePlanner::new(gentle, tray, limits, Load::default())?;
    // A quarter turn up the ramp, where uphill is -x and the move goes uphill first.
    let half_way_up = Vector2::new(0.0, radius_m);
    let protected = match args.policy {
        Protect::Selected => Vec::new(),
        Protect::All => vec![half_way_up],
    };
    let from = Vector3::new(limits.x_m_max, 0.0, 0.0);
    let to = Vector3::new(limits.x_m_max - distance_m, 0.0, args.turn);
    let MovePlan { duration_s, bound_s, jerk_bound_s, peak_acceleration_m_s2, .. } =
        planner.plan(from, to, &protected)?;
    Ok(MoveFigures {
        policy: args.policy,
        distance_m,
        friction: gentle.friction,
        friction_share: gentle.friction_share,
        jerk_m_s3_max: gentle.jerk_m_s3_max,
        duration_s,
        bound_s,
        jerk_bound_s,
        peak_acceleration_m_s2,
        over_jerk_bound: duration_s / jerk_bound_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(distance: f64, mu: f64, policy: Protect) -> Args {
        let distance = Some(distance);
        Args { distance, sweep: false, turn: 0.0, mu, jerk: 100.0, policy, ramp_radius: 0.09, friction_share: 0.955 }
    }

    #[test]
    fn verif_the_reference_case_has_the_bounds_of_the_table() {
        // 300 mm at μ 0.2: 0.782 s flat, 0.802 s with J = 100 m/s³; 0.838 s for a part on the ramp at 90 mm.
        let flat = figures(&args(0.3, 0.2, Protect::Selected)).unwrap();
        assert!((flat.bound_s - 0.782).abs() < 5e-4 && (flat.jerk_bound_s - 0.802).abs() < 5e-4);
        assert!(flat.duration_s <= 1.03 * flat.jerk_bound_s && flat.duration_s <= 1.05 * flat.bound_s);
        assert!((figures(&args(0.3, 0.2, Protect::All)).unwrap().bound_s - 0.838).abs() < 5e-4);
    }

    #[test]
    fn the_sweep_stays_near_its_bounds() {
        for policy in [Protect::Selected, Protect::All] {
            let rows: Vec<MoveFigures> = sweep(&args(0.0, 0.0, policy)).collect::<Result<_, _>>().unwrap();
            assert_eq!(rows.len(), 24);
            assert!(rows.iter().all(|row| row.over_jerk_bound <= 1.03), "{rows:?}");
        }
    }

    #[test]
    fn figures_out_of_range_are_refused_by_name() {
        for (distance, mu, name) in [(-1.0, 0.2, "--distance"), (f64::NAN, 0.2, "--distance"), (0.3, -0.2, "friction")]
        {
            let error = figures(&args(distance, mu, Protect::Selected)).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        }
    }
}
