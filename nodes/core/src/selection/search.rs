//! Where to look closer: the rings of brightness about a place tell, whatever the yaw, whether a part may lie there.

use super::segment::{RELATIVE_UNITS, Segmentation};
use super::sought::Sought;

/// Every so many pixels both ways a place is tried.
const STRIDE: usize = 2;
/// A ring that misses by more standard deviations counts no more than this many.
const MISS_SIGMAS_MAX: f32 = 3.0;
/// Share of a ring that must lie on the plateau for the ring to count.
const RING_SEEN_MIN: f32 = 0.6;
/// The largest mean square miss there can be.
pub(super) const MISS_MAX: f32 = MISS_SIGMAS_MAX * MISS_SIGMAS_MAX;

/// Weight of the rings that must be seen.
const RING_WEIGHT_MIN: f32 = 0.3;

/// A place where a part may lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seed {
    pub pose: usize,
    /// Pixel of the window.
    pub column: usize,
    pub row: usize,
}

/// Finds places; keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Search {
    /// Pixels about the centre, nearest first, and where each ring of them ends.
    places: Vec<(isize, isize)>,
    ends: Vec<usize>,
    /// Cells of the foreground, spread as far as any pose is hollow.
    occupied: Vec<bool>,
    /// Cells whose rings reach beyond the plateau.
    at_border: Vec<bool>,
    /// For each pose and place, its mean square miss.
    misses: Vec<Vec<f32>>,
    /// Places in a row of the latest frame.
    columns: usize,
}

impl Search {
    pub(super) fn new(sought: &[Sought]) -> Self {
        let rings = sought.iter().map(|sought| sought.rings.len()).max().unwrap_or(0);
        #[expect(clippy::cast_possible_wrap, reason = "a few dozen pixels")]
        let reach = rings as isize;
        let mut places: Vec<(usize, isize, isize)> = (-reach..=reach)
            .flat_map(|row| (-reach..=reach).map(move |column| (column, row)))
            .map(|(column, row)| {
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few dozen pixels")]
                let ring = ((column * column + row * row) as f64).sqrt().round() as usize;
                (ring, column, row)
            })
            .filter(|(ring, _, _)| *ring < rings)
            .collect();
        places.sort_unstable();
        let ends = (0..rings).map(|ring| places.partition_point(|(other, _, _)| *other <= ring)).collect();
        let places = places.into_iter().map(|(_, column, row)| (column, row)).collect();
        Self {
            places,
            ends,
            occupied: Vec::new(),
            at_border: Vec::new(),
            misses: vec![Vec::new(); sought.len()],
            columns: 0,
        }
    }

    /// Places worth a closer look, in the order of poses and then of the image.
    pub(super) fn seeds(&mut self, frame: &Segmentation, sought: &[Sought]) -> Vec<Seed> {
        let (width, height) = (frame.window.width, frame.window.height);
        let (columns, rows) = (width / STRIDE, height / STRIDE);
        let hollow_px = sought.iter().map(|sought| sought.hollow_px).max().unwrap_or(0);
        self.mark(frame, columns, rows, hollow_px.div_ceil(STRIDE));
        for misses in &mut self.misses {
            misses.clear();
            misses.resize(columns * rows, f32::INFINITY);
        }
        let offsets: Vec<isize> = self
            .places
            .iter()
            .map(|(column, row)| {
                #[expect(clippy::cast_possible_wrap, reason = "images are at most 4096 px wide")]
                let width = width as isize;
                row * width + column
            })
            .collect();
        let reach = self.ends.len();
        let mut sums = vec![0.0_f32; reach];
        let noise = frame.sigma * frame.sigma;
        for row in 0..rows {
            for column in 0..columns {
                let place = row * columns + column;
                let (x, y) = (column * STRIDE, row * STRIDE);
                if !self.occupied[place] || frame.bins[y * width + x] == 0 {
                    continue;
                }
                let whole = x >= reach && y >= reach && x + reach < width && y + reach < height;
                if whole && !self.at_border[place] {
                    self.sum_rings(&frame.relative, y * width + x, &offsets, &mut sums);
                } else {
                    self.sum_rings_at_border(frame, x, y, &mut sums);
                }
                for (misses, sought) in self.misses.iter_mut().zip(sought) {
                    let (mut miss, mut weight) = (0.0, 0.0);
                    for (ring, sum) in sought.rings.iter().zip(&sums).filter(|(_, sum)| !sum.is_nan()) {
                        let difference = sum - ring.mean;
                        miss += ring.weight * (difference * difference / (ring.variance + noise)).min(MISS_MAX);
                        weight += ring.weight;
                    }
                    misses[place] = if weight >= RING_WEIGHT_MIN { miss / weight } else { MISS_MAX };
                }
            }
        }
        self.columns = columns;
        self.minima(columns, rows, sought)
    }

    /// The least mean square miss of a pose in the latest frame within a place of a pixel of the window.
    pub(super) fn miss_near(&self, pose: usize, column: usize, row: usize) -> f32 {
        let near = |index: usize| (index / STRIDE).saturating_sub(1)..=index / STRIDE + 1;
        let columns = self.columns;
        let places = near(row).flat_map(|row| near(column).map(move |column| row * columns + column));
        places.filter_map(|place| self.misses[pose].get(place)).copied().fold(MISS_MAX, f32::min)
    }

    /// Marks the cells within `spread` cells of foreground, and those within reach of the plateau's border.
    fn mark(&mut self, frame: &Segmentation, columns: usize, rows: usize, spread: usize) {
        let size = (columns, rows);
        let reach = self.ends.len().div_ceil(STRIDE);
        let width = frame.window.width;
        spread_cells(&frame.foreground, width, size, |pixel| pixel != 0, spread, &mut self.occupied);
        spread_cells(&frame.bins, width, size, |bin| bin == 0, reach, &mut self.at_border);
    }

    /// Mean relative brightness of each ring about a pixel.
    fn sum_rings(&self, relative: &[i16], centre: usize, offsets: &[isize], means: &mut [f32]) {
        let mut start = 0;
        for (mean, end) in means.iter_mut().zip(&self.ends) {
            let ring = &offsets[start..*end];
            let sum: i32 = ring.iter().map(|offset| i32::from(relative[centre.wrapping_add_signed(*offset)])).sum();
            *mean = sum as f32 / (ring.len() as f32 * RELATIVE_UNITS);
            start = *end;
        }
    }

    /// The same near the border of the plateau: of each ring what lies on it; NaN where that is too little.
    fn sum_rings_at_border(&self, frame: &Segmentation, x: usize, y: usize, means: &mut [f32]) {
        let (width, height) = (frame.window.width, frame.window.height);
        let mut start = 0;
        for (mean, end) in means.iter_mut().zip(&self.ends) {
            let (mut sum, mut count) = (0.0, 0.0_f32);
            for (column, row) in &self.places[start..*end] {
                let place = x.checked_add_signed(*column).zip(y.checked_add_signed(*row));
                let place = place.filter(|(x, y)| *x < width && *y < height).map(|(x, y)| y * width + x);
                if let Some(index) = place.filter(|index| frame.bins[*index] != 0) {
                    sum += f32::from(frame.relative[index]);
                    count += 1.0;
                }
            }
            let enough = count >= RING_SEEN_MIN * (end - start) as f32;
            *mean = if enough { sum / (count * RELATIVE_UNITS) } else { f32::NAN };
            start = *end;
        }
    }

    /// Places where no neighbour misses by less.
    fn minima(&self, columns: usize, rows: usize, sought: &[Sought]) -> Vec<Seed> {
        let mut seeds = Vec::new();
        for (pose, (misses, sought)) in self.misses.iter().zip(sought).enumerate() {
            for row in 0..rows {
                for column in 0..columns {
                    let here = misses[row * columns + column];
                    if here > sought.template.ring_miss_max {
                        continue;
                    }
                    let near = |index: usize, size: usize| index.saturating_sub(1)..(index + 2).min(size);
                    let mut others =
                        near(row, rows).flat_map(|row| near(column, columns).map(move |column| row * columns + column));
                    let place = row * columns + column;
                    // Of equals the first counts.
                    let lowest = others.all(|other| misses[other] > here || (misses[other] >= here && other >= place));
                    if lowest {
                        seeds.push(Seed { pose, column: column * STRIDE, row: row * STRIDE });
                    }
                }
            }
        }
        seeds
    }
}

/// Marks the cells within `spread` cells, across or along, of one with a pixel that `counts`.
fn spread_cells(
    pixels: &[u8],
    width: usize,
    (columns, rows): (usize, usize),
    counts: impl Fn(u8) -> bool,
    spread: usize,
    marked: &mut Vec<bool>,
) {
    marked.clear();
    marked.resize(columns * rows, false);
    let mut across = vec![false; columns];
    for row in 0..rows {
        across.fill(false);
        for line in pixels[row * STRIDE * width..].chunks(width).take(STRIDE) {
            for (cell, pixels) in line.chunks(STRIDE).take(columns).enumerate() {
                if pixels.iter().any(|pixel| counts(*pixel)) {
                    across[cell.saturating_sub(spread)..(cell + spread + 1).min(columns)].fill(true);
                }
            }
        }
        for line in row.saturating_sub(spread)..(row + spread + 1).min(rows) {
            for (marked, across) in marked[line * columns..(line + 1) * columns].iter_mut().zip(&across) {
                *marked |= across;
            }
        }
    }
}
