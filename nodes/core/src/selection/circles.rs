//! Discs of known size, also where they touch: edges vote for centres, then each disc's rim is measured.

use std::sync::LazyLock;

use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};

use super::segment::{LEVELS, Segmentation};
use super::view::View;

/// Share of a disc's rim that must vote for its centre to be looked at.
const VOTES_RATIO_MIN: f32 = 0.22;
/// Discs do not overlap: no second centre within this many radii. Less than 2 allows for errors of votes.
const SEPARATION_RADII: f32 = 1.5;
/// Lines of sight from a centre to the rim.
const SPOKES: usize = 40;
static SPOKE_DIRECTIONS: LazyLock<[Vector2<f64>; SPOKES]> = LazyLock::new(|| {
    std::array::from_fn(|spoke| {
        let (sin, cos) = (std::f64::consts::TAU * spoke as f64 / SPOKES as f64).sin_cos();
        Vector2::new(cos, sin)
    })
});
/// Steps along a spoke, px, and how far the rim may be from where it is expected, px and relative.
const SPOKE_STEP_PX: f64 = 0.5;
const RIM_MISS_PX: f64 = 2.0;
const RIM_MISS_RATIO: f64 = 0.12;
/// A rim point further than this from the fitted circle is not the rim, px.
const RIM_OUTLIER_PX: f64 = 0.8;
/// Weight of the taught radius in the fit, in rim points.
const RADIUS_PRIOR_POINTS: f64 = 6.0;

/// A disc's rim as measured, in the tray frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    pub centre: Point2<f64>,
    pub radius_m: f64,
    /// Share of spokes that found the rim on the circle.
    pub support: f64,
}

/// Scratch memory for voting.
#[derive(Clone, Debug, Default)]
pub(super) struct Votes {
    counts: Vec<u16>,
    sums: Vec<u16>,
}

impl Votes {
    /// Likely centres of discs of `radius_px`, best first, in image pixels.
    pub(super) fn centres(&mut self, frame: &Segmentation, radius_px: f32) -> Vec<Point2<f32>> {
        let (width, height) = (frame.window.width, frame.window.height);
        self.cast(frame, radius_px);
        box_sum(&self.counts, &mut self.sums, width);
        let least = (VOTES_RATIO_MIN * std::f32::consts::TAU * radius_px).max(4.0);
        let mut peaks = Vec::new();
        for row in 1..height.saturating_sub(1) {
            let line = &self.sums[row * width..(row + 1) * width];
            for (column, votes) in line.iter().enumerate().take(width - 1).skip(1) {
                if f32::from(*votes) >= least && self.is_peak(row * width + column, width) {
                    peaks.push((*votes, row, column));
                }
            }
        }
        // Most votes first; the place breaks ties, so that the order is always the same.
        peaks.sort_by(|a, b| b.0.cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut centres: Vec<Point2<f32>> = Vec::new();
        for (_, row, column) in peaks {
            let centre = self.centroid(row, column, width);
            let apart = SEPARATION_RADII * radius_px;
            if centres.iter().all(|other| (centre - other).norm() > apart) {
                centres.push(centre);
            }
        }
        let corner = Vector2::new(frame.window.left as f32, frame.window.top as f32);
        centres.iter().map(|centre| centre + corner).collect()
    }

    /// Every edge pixel votes for the two points a radius away along its gradient.
    fn cast(&mut self, frame: &Segmentation, radius_px: f32) {
        let (width, height) = (frame.window.width, frame.window.height);
        self.counts.clear();
        self.counts.resize(width * height, 0);
        self.sums.resize(width * height, 0);
        let limit = 2.0 * frame.edge_levels * LEVELS;
        let pixels = &frame.smooth;
        for row in 1..height.saturating_sub(1) {
            let line = row * width;
            for index in line + 1..line + width - 1 {
                // Only the surroundings of what lies on the plateau vote.
                if frame.bins[index] == 0 {
                    continue;
                }
                let slope =
                    |step: usize, index: usize| i32::from(pixels[index + step]) - i32::from(pixels[index - step]);
                let (dx, dy) = (slope(1, index), slope(width, index));
                if (dx.abs() + dy.abs()) as f32 <= limit {
                    continue;
                }
                let (along, steepness) = if dx.abs() >= dy.abs() { (1, dx.abs()) } else { (width, dy.abs()) };
                if index < 2 * width || index + 2 * width >= pixels.len() {
                    continue;
                }
                // Thin edges: only the steepest pixel across the edge votes.
                if slope(along, index - along).abs() > steepness || slope(along, index + along).abs() >= steepness {
                    continue;
                }
                let (dx, dy) = (dx as f32, dy as f32);
                let reach = radius_px / (dx * dx + dy * dy).sqrt();
                let (x, y) = ((index - line) as f32, row as f32);
                for reach in [reach, -reach] {
                    let (x, y) = (x + reach * dx + 0.5, y + reach * dy + 0.5);
                    if x >= 0.0 && y >= 0.0 {
                        #[expect(
                            clippy::cast_possible_truncation,
                            clippy::cast_sign_loss,
                            reason = "not negative, and a float cast saturates"
                        )]
                        let (column, row) = (x as usize, y as usize);
                        if column < width && row < height {
                            self.counts[row * width + column] += 1;
                        }
                    }
                }
            }
        }
    }

    fn is_peak(&self, index: usize, width: usize) -> bool {
        let here = self.sums[index];
        let before = [index - width - 1, index - width, index - width + 1, index - 1];
        let after = [index + 1, index + width - 1, index + width, index + width + 1];
        before.iter().all(|other| self.sums[*other] < here) && after.iter().all(|other| self.sums[*other] <= here)
    }

    fn centroid(&self, row: usize, column: usize, width: usize) -> Point2<f32> {
        let (mut weight, mut moment) = (0.0, Vector2::zeros());
        for y in row - 1..=row + 1 {
            for x in column - 1..=column + 1 {
                let votes = f32::from(self.counts[y * width + x]);
                weight += votes;
                moment += Vector2::new(x as f32, y as f32) * votes;
            }
        }
        if weight > 0.0 { Point2::from(moment / weight) } else { Point2::new(column as f32, row as f32) }
    }
}

/// Sum over 3x3 pixels; 0 in the outermost rows.
fn box_sum(counts: &[u16], sums: &mut [u16], width: usize) {
    let height = counts.len() / width.max(1);
    let mut columns = vec![0_u16; width];
    for row in 1..height.saturating_sub(1) {
        let line = |row: usize| &counts[row * width..(row + 1) * width];
        for (column, ((above, middle), below)) in
            columns.iter_mut().zip(line(row - 1).iter().zip(line(row)).zip(line(row + 1)))
        {
            *column = above + middle + below;
        }
        let sums = &mut sums[row * width + 1..(row + 1) * width];
        for (sum, columns) in sums.iter_mut().zip(columns.windows(3)) {
            *sum = columns[0] + columns[1] + columns[2];
        }
    }
}

/// Measures the rim of a disc expected at `centre` on the plane `height_m` above the platen; `None` if it leaves the view.
pub(super) fn measure(
    frame: &Segmentation,
    view: &View,
    height_m: f64,
    centre: Point2<f64>,
    radius_m: f64,
) -> Option<Disc> {
    let mut disc = Disc { centre, radius_m, support: 0.0 };
    // The second look starts from a centre close enough for the rim to stand square to the spokes.
    for _ in 0..2 {
        let pixel = view.pixel(disc.centre, height_m)?;
        let px_from_tray = view.px_from_tray(disc.centre, height_m)?;
        let m_per_px = 1.0 / px_from_tray.determinant().abs().sqrt();
        let rim = rim_points(frame, pixel, px_from_tray, disc.radius_m, m_per_px);
        let (shift, growth, support) = fit_rim(&rim, m_per_px, radius_m - disc.radius_m);
        disc = Disc { centre: disc.centre + shift, radius_m: disc.radius_m + growth, support };
    }
    Some(disc)
}

/// For each spoke that found an edge: its direction, and how far beyond `radius_m` the edge lies, m.
fn rim_points(
    frame: &Segmentation,
    pixel: Point2<f64>,
    px_from_tray: Matrix2<f64>,
    radius_m: f64,
    m_per_px: f64,
) -> Vec<(Vector2<f64>, f64)> {
    const SAMPLES_MAX: usize = 64;
    let step_m = SPOKE_STEP_PX * m_per_px;
    let miss_m = (RIM_MISS_PX * m_per_px).max(RIM_MISS_RATIO * radius_m);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and positive")]
    let half = ((miss_m / step_m).ceil() as usize + 1).min(SAMPLES_MAX / 2 - 1);
    let count = 2 * half + 1;
    let mut rim = Vec::with_capacity(SPOKES);
    for direction in &*SPOKE_DIRECTIONS {
        let px_per_m = px_from_tray * direction;
        let mut levels = [0.0_f32; SAMPLES_MAX];
        let complete = levels[..count].iter_mut().enumerate().all(|(sample, level)| {
            let along_m = radius_m + (sample as f64 - half as f64) * step_m;
            let place = (pixel.coords + px_per_m * along_m).map(crate::camera::single);
            frame.level(place.x, place.y).map(|seen| *level = seen).is_some()
        });
        if !complete {
            continue;
        }
        // Slope over one pixel about every sample but the ends. Edges near the expected radius come first: a shadow's
        // edge beside the rim may be the steeper one.
        let slope = |sample: usize| {
            let near = 1.0 - (sample as f64 - half as f64).abs() / (half + 1) as f64;
            f64::from((levels[sample + 1] - levels[sample - 1]).abs()) * near
        };
        let best = (1..count - 1).rev().max_by(|a, b| slope(*a).total_cmp(&slope(*b)));
        let Some(best) = best.filter(|best| slope(*best) >= f64::from(frame.edge_levels)) else {
            continue;
        };
        let peak = if best > 1 && best + 2 < count {
            let (before, here, after) = (slope(best - 1), slope(best), slope(best + 1));
            let curvature = before - 2.0 * here + after;
            if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 }
        } else {
            0.0
        };
        rim.push((*direction, (best as f64 - half as f64 + peak) * step_m));
    }
    rim
}

/// Least-squares circle through rim points, outliers left out: shift of the centre, growth of the radius, support.
fn fit_rim(rim: &[(Vector2<f64>, f64)], m_per_px: f64, prior_growth_m: f64) -> (Vector2<f64>, f64, f64) {
    let outlier_m = RIM_OUTLIER_PX * m_per_px;
    let mut solution = Vector3::new(0.0, 0.0, prior_growth_m);
    let miss = |solution: &Vector3<f64>, direction: &Vector2<f64>, excess_m: f64| {
        excess_m - solution.z - direction.dot(&solution.xy())
    };
    // Wide at first, so that a centre off by a pixel is not its own outlier.
    for limit_m in [3.0 * outlier_m, 1.5 * outlier_m, outlier_m, outlier_m] {
        let mut normal = Matrix3::from_diagonal(&Vector3::new(1e-3, 1e-3, RADIUS_PRIOR_POINTS));
        let mut target = Vector3::new(0.0, 0.0, RADIUS_PRIOR_POINTS * prior_growth_m);
        for (direction, excess_m) in rim {
            if miss(&solution, direction, *excess_m).abs() < limit_m {
                let row = Vector3::new(direction.x, direction.y, 1.0);
                normal += row * row.transpose();
                target += row * *excess_m;
            }
        }
        if let Some(factors) = normal.cholesky() {
            solution = factors.solve(&target);
        }
    }
    let on_circle = rim.iter().filter(|(direction, excess_m)| miss(&solution, direction, *excess_m).abs() < outlier_m);
    (solution.xy(), solution.z, on_circle.count() as f64 / SPOKES as f64)
}
