//! Interpolates the picture of the tray between the points of a coarse lattice.
//!
//! The scene is a stack of layers, lower ones first. Each layer is described by two smooth fields over the picture: how
//! far inside its outline a pixel lies, and its grey level. Both are computed exactly (perspective, distortion, light) on
//! the lattice and interpolated between, which is faster by the area of a tile and errs by the sagitta of an outline over
//! one tile: 0.04 px for the outer wall. For the small circles of the hub that is too much; they are computed per pixel
//! from their centre, which is interpolated without error where the lens does not distort.

use nalgebra::Vector2;

use feeder_model::camera::grey_level;

/// Lattice spacing, px.
pub(super) const TILE: usize = 8;

/// Layers from the lowest up; each is a disc, or a piece of one, seen in perspective.
pub(super) const BODY_SIDE: usize = 0;
pub(super) const RIM: usize = 1;
pub(super) const WALL_FACE: usize = 2;
pub(super) const RAMP: usize = 3;
pub(super) const PLATEAU: usize = 4;
pub(super) const HUB_SIDE: usize = 5;
pub(super) const HUB_CHAMFER: usize = 6;
pub(super) const HUB_TOP: usize = 7;
pub(super) const BORE: usize = 8;
pub(super) const LAYERS: usize = 9;

/// Where the layers of the stack lie, seen from one lattice point.
#[derive(Clone, Copy)]
pub(super) struct Node {
    /// Place at the height of the walls' tops relative to the tray's axis, px.
    pub(super) top_px: Vector2<f32>,
    /// Share of light that reaches the platen.
    pub(super) platen_light: f32,
    /// Distance inside each layer's outline, px.
    pub(super) inside_px: [f32; LAYERS],
    /// Grey level of each layer.
    pub(super) grey: [f32; LAYERS],
}

/// Bilinear interpolation over one tile, row by row.
#[derive(Clone, Copy)]
struct Ramp {
    left: f32,
    left_step: f32,
    right: f32,
    right_step: f32,
}

impl Ramp {
    fn new(corners: [f32; 4]) -> Self {
        let step = 1.0 / TILE as f32;
        Self {
            left: corners[0],
            left_step: (corners[2] - corners[0]) * step,
            right: corners[1],
            right_step: (corners[3] - corners[1]) * step,
        }
    }

    fn row(&self, row: usize) -> [f32; TILE] {
        let left = self.left + self.left_step * row as f32;
        let right = self.right + self.right_step * row as f32;
        let slope = (right - left) / TILE as f32;
        std::array::from_fn(|column| left + slope * column as f32)
    }
}

/// A layer that may cover part of a tile.
#[derive(Clone, Copy)]
struct Blend {
    inside_px: Ramp,
    /// For the hub's circles, what makes them exact: their radius.
    radius_px: Option<f32>,
    grey: Ramp,
}

/// Paints the tile that starts at `column` of a band of at most `TILE` rows.
pub(super) fn paint_tile(corners: [&Node; 4], column: usize, width: usize, platen: &[u8], pixels: &mut [u8]) {
    let extent = |layer: usize| {
        let inside = corners.map(|node| node.inside_px[layer]);
        (inside.into_iter().fold(f32::INFINITY, f32::min), inside.into_iter().fold(f32::NEG_INFINITY, f32::max))
    };
    let extents: [(f32, f32); LAYERS] = std::array::from_fn(extent);
    // The topmost layer that covers the whole tile hides all below it.
    let base = (0..LAYERS).rev().find(|layer| extents[*layer].0 > 1.0);
    let grey = |layer: usize| Ramp::new(corners.map(|node| node.grey[layer]));
    let base_grey = base.map(grey);
    let platen_light = Ramp::new(corners.map(|node| node.platen_light));
    let (top_x, top_y) = (Ramp::new(corners.map(|node| node.top_px.x)), Ramp::new(corners.map(|node| node.top_px.y)));
    let blend = |layer: usize| Blend {
        inside_px: Ramp::new(corners.map(|node| node.inside_px[layer])),
        radius_px: (layer >= HUB_CHAMFER).then(|| corners[0].inside_px[layer] + corners[0].top_px.norm()),
        grey: grey(layer),
    };
    let mut blends = [const { None }; LAYERS];
    let above = base.map_or(0, |base| base + 1);
    for (layer, slot) in blends.iter_mut().enumerate().skip(above) {
        if extents[layer].1 > -1.0 {
            *slot = Some(blend(layer));
        }
    }
    let columns = column..(column + TILE).min(width);
    for (row, (pixels, platen)) in pixels.chunks_mut(width).zip(platen.chunks(width)).enumerate() {
        let (pixels, platen) = (&mut pixels[columns.clone()], &platen[columns.clone()]);
        let mut values = match base_grey {
            Some(base_grey) => base_grey.row(row),
            None => {
                let bare = platen
                    .first_chunk::<TILE>()
                    .copied()
                    .unwrap_or_else(|| std::array::from_fn(|column| platen.get(column).copied().unwrap_or_default()));
                let light = platen_light.row(row);
                std::array::from_fn(|column| f32::from(bare[column]) * light[column])
            }
        };
        for Blend { inside_px, radius_px, grey } in blends.iter().flatten() {
            let (mut inside, grey) = (inside_px.row(row), grey.row(row));
            if let Some(radius_px) = radius_px {
                let (x, y) = (top_x.row(row), top_y.row(row));
                inside = std::array::from_fn(|i| radius_px - (x[i] * x[i] + y[i] * y[i]).sqrt());
            }
            values = std::array::from_fn(|i| values[i] + (inside[i] + 0.5).clamp(0.0, 1.0) * (grey[i] - values[i]));
        }
        let levels = values.map(grey_level);
        match pixels.first_chunk_mut::<TILE>() {
            Some(whole) => *whole = levels,
            None => pixels.copy_from_slice(&levels[..pixels.len()]),
        }
    }
}
