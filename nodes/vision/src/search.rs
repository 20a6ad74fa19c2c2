//! Where to look closer: the rings of brightness about a place tell, whatever the yaw, whether a part may lie there; of a part
//! that does not look the same from all sides, a glance at all yaws tells where that is likeliest.

use super::modes::{self, LIGHT_MODES, Light, LightAmounts, SideAmounts, added, clamped};
use super::segment::{RELATIVE_UNITS, Segmentation};
use super::sought::{Ring, Sought};
use super::template::RING_MISS_MAX;

/// Every so many pixels both ways a place is tried.
const STRIDE: usize = 2;
/// Where more of a ring than this lies off the plateau, relative to what lies on it, the ring does not count.
const RING_HIDDEN_MAX: f32 = 0.7;
/// Weight of the rings that must be seen.
const RING_WEIGHT_MIN: f32 = 0.3;

/// What a frame shows of a ring.
#[derive(Clone, Copy, Debug, Default)]
struct RingSum {
    /// Mean relative brightness, and mean shade of the walls.
    mean: f32,
    wall_shade: f32,
    /// Pixels off the plateau, relative to those on it.
    hidden: f32,
}

/// A place where a part may lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seed {
    pub pose: usize,
    /// Pixel of the window.
    pub column: usize,
    pub row: usize,
    /// What the rings tell of the light; nothing where it is taken to be the one taught.
    pub light: Option<LightAmounts>,
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
    /// For each pose and place looked at, what the rings tell of the light.
    lights: Vec<Vec<Option<LightAmounts>>>,
    /// For each place, what a glance at a pose misses.
    glances: Vec<f32>,
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
            lights: vec![Vec::new(); sought.len()],
            glances: Vec::new(),
            columns: 0,
        }
    }

    /// Places worth a closer look, in the order of poses and then of the image: those where the rings miss least and, of poses
    /// with a yaw, where a `glance` at the place misses least. Rings do not tell from which `sides` light comes.
    pub(super) fn seeds(
        &mut self,
        frame: &Segmentation,
        sought: &[Sought],
        sides: &SideAmounts,
        glance: impl Fn(Seed) -> f32,
    ) -> Vec<Seed> {
        let (width, height) = (frame.window.width, frame.window.height);
        let (columns, rows) = (width / STRIDE, height / STRIDE);
        let hollow_px = sought.iter().map(|sought| sought.hollow_px).max().unwrap_or(0);
        self.mark(frame, columns, rows, hollow_px.div_ceil(STRIDE));
        for misses in &mut self.misses {
            misses.clear();
            misses.resize(columns * rows, f32::INFINITY);
        }
        self.lights.iter_mut().for_each(|lights| lights.resize(columns * rows, None));
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
        let mut summed = vec![RingSum::default(); reach];
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
                    self.sum_rings(frame, y * width + x, &offsets, &mut summed);
                } else {
                    self.sum_rings_at_border(frame, x, y, &mut summed);
                }
                for ((misses, lights), sought) in self.misses.iter_mut().zip(&mut self.lights).zip(sought) {
                    let light = light(sought, &summed);
                    lights[place] = light;
                    let (mut miss, mut weight) = (0.0, 0.0);
                    let rings = sought.rings.iter().zip(&summed);
                    for (ring, sum) in rings.filter(|(_, sum)| sum.hidden <= RING_HIDDEN_MAX) {
                        let lit = light.map_or(0.0, |light| added(&ring.effect, &light));
                        let difference = difference(ring, sum) - lit;
                        let variance = ring.variance + noise + ring.variance_along * sum.hidden;
                        miss += ring.weight * (difference * difference / variance).min(RING_MISS_MAX);
                        weight += ring.weight;
                    }
                    misses[place] = if weight >= RING_WEIGHT_MIN { miss / weight } else { RING_MISS_MAX };
                }
            }
        }
        self.columns = columns;
        let mut seeds = Vec::new();
        for (pose, ((misses, lights), sought)) in self.misses.iter().zip(&self.lights).zip(sought).enumerate() {
            let ring_miss_max = sought.template.ring_miss_max;
            let seed = |place: usize| {
                let (column, row) = (place % columns * STRIDE, place / columns * STRIDE);
                Seed { pose, column, row, light: lights[place].map(|light| modes::from_sides(light, sides)) }
            };
            // Next to a part rings fit as well, in a light that is less likely.
            let doubt = |place: usize| {
                let square = lights[place].iter().flatten().map(|amount| amount * amount).sum::<f32>();
                square / sought.rings.len() as f32
            };
            let turns = sought.template.yaw_symmetry != 0;
            self.glances.clear();
            self.glances.extend(misses.iter().enumerate().map(|(place, miss)| match *miss <= ring_miss_max {
                false => f32::INFINITY,
                true if turns => glance(seed(place)) + doubt(place),
                true => miss + doubt(place),
            }));
            seeds.extend(minima(&self.glances, columns, f32::MAX).map(seed));
        }
        seeds
    }

    /// What the rings about a pixel of the window tell of the light, if a part in this pose lies there.
    pub(super) fn light_at(
        &self,
        frame: &Segmentation,
        sought: &Sought,
        column: usize,
        row: usize,
    ) -> Option<LightAmounts> {
        let mut summed = vec![RingSum::default(); self.ends.len()];
        self.sum_rings_at_border(frame, column, row, &mut summed);
        light(sought, &summed)
    }

    /// The least mean square miss of a pose in the latest frame within a place of a pixel of the window.
    pub(super) fn miss_near(&self, pose: usize, column: usize, row: usize) -> f32 {
        let near = |index: usize| (index / STRIDE).saturating_sub(1)..=index / STRIDE + 1;
        let columns = self.columns;
        let places = near(row).flat_map(|row| near(column).map(move |column| row * columns + column));
        places.filter_map(|place| self.misses[pose].get(place)).copied().fold(RING_MISS_MAX, f32::min)
    }

    /// Marks the cells within `spread` cells of foreground, and those within reach of the plateau's border.
    fn mark(&mut self, frame: &Segmentation, columns: usize, rows: usize, spread: usize) {
        let size = (columns, rows);
        let reach = self.ends.len().div_ceil(STRIDE);
        let width = frame.window.width;
        spread_cells(&frame.foreground, width, size, |pixel| pixel != 0, spread, &mut self.occupied);
        spread_cells(&frame.bins, width, size, |bin| bin == 0, reach, &mut self.at_border);
    }

    /// Sums each ring about a pixel.
    fn sum_rings(&self, frame: &Segmentation, centre: usize, offsets: &[isize], summed: &mut [RingSum]) {
        let wall_shade = frame.wall_shade(centre);
        let mut start = 0;
        for (result, end) in summed.iter_mut().zip(&self.ends) {
            let ring = &offsets[start..*end];
            let level = |offset: &isize| i32::from(frame.relative[centre.wrapping_add_signed(*offset)]);
            let sum: i32 = ring.iter().map(level).sum();
            *result = RingSum { mean: sum as f32 / (ring.len() as f32 * RELATIVE_UNITS), wall_shade, hidden: 0.0 };
            start = *end;
        }
    }

    /// The same near the border of the plateau: of each ring what lies on it.
    fn sum_rings_at_border(&self, frame: &Segmentation, x: usize, y: usize, summed: &mut [RingSum]) {
        let (width, height) = (frame.window.width, frame.window.height);
        let mut start = 0;
        for (result, end) in summed.iter_mut().zip(&self.ends) {
            let (mut sum, mut shade, mut count) = (0.0, 0.0, 0.0_f32);
            for (column, row) in &self.places[start..*end] {
                let place = x.checked_add_signed(*column).zip(y.checked_add_signed(*row));
                let place = place.filter(|(x, y)| *x < width && *y < height).map(|(x, y)| y * width + x);
                if let Some(index) = place.filter(|index| frame.bins[*index] != 0) {
                    sum += f32::from(frame.relative[index]);
                    shade += frame.wall_shade(index);
                    count += 1.0;
                }
            }
            let hidden = ((end - start) as f32 - count) / count;
            *result = RingSum { mean: sum / (count * RELATIVE_UNITS), wall_shade: shade / count, hidden };
            start = *end;
        }
    }
}

/// By how much a ring is brighter than the template's.
fn difference(ring: &Ring, sum: &RingSum) -> f32 {
    sum.mean - ring.mean - ring.wall_shade * sum.wall_shade
}

/// What the rings that are seen tell of the light; nothing where it is to be the one taught.
fn light(sought: &Sought, summed: &[RingSum]) -> Option<LightAmounts> {
    if sought.light == Light::Taught {
        return None;
    }
    let mut light = [0.0; LIGHT_MODES];
    for (ring, sum) in sought.rings.iter().zip(summed).filter(|(_, sum)| sum.hidden <= RING_HIDDEN_MAX) {
        let difference = difference(ring, sum);
        light.iter_mut().zip(ring.amounts).for_each(|(amount, told)| *amount += told * difference);
    }
    Some(light.map(clamped))
}

/// Places where no neighbour misses by less, and the place itself by at most `miss_max`.
fn minima(misses: &[f32], columns: usize, miss_max: f32) -> impl Iterator<Item = usize> {
    let near = |index: usize, size: usize| index.saturating_sub(1)..(index + 2).min(size);
    let rows = misses.len() / columns.max(1);
    let least = move |(place, here): (usize, &f32)| {
        if *here > miss_max {
            return None;
        }
        let (row, column) = (place / columns, place % columns);
        let mut others =
            near(row, rows).flat_map(|row| near(column, columns).map(move |column| row * columns + column));
        // Of equals the first counts.
        let least = others.all(|other| misses[other] > *here || (misses[other] >= *here && other >= place));
        least.then_some(place)
    };
    misses.iter().enumerate().filter_map(least)
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
            // What the cell before has marked is marked.
            let mut marked_until = 0;
            for (cell, pixels) in line.chunks(STRIDE).take(columns).enumerate() {
                if pixels.iter().any(|pixel| counts(*pixel)) {
                    let until = (cell + spread + 1).min(columns);
                    across[cell.saturating_sub(spread).max(marked_until)..until].fill(true);
                    marked_until = until;
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
