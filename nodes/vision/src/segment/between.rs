//! Brightness between pixels.

use super::Segmentation;

impl Segmentation {
    /// Column and row of the pixel before a place of the window; `None` if that pixel or the next is nearer to the border
    /// than `margin` pixels.
    fn pixel_before(&self, x: f32, y: f32, margin: u8) -> Option<(usize, usize)> {
        let least = f32::from(margin);
        if !(x >= least && y >= least) {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "not negative, and a cast saturates"
        )]
        let (column, row) = (x as usize, y as usize);
        let beyond = 1 + usize::from(margin);
        let inside =
            column.saturating_add(beyond) < self.window.width && row.saturating_add(beyond) < self.window.height;
        inside.then_some((column, row))
    }

    /// As [`Self::relative_at`], by straight lines between pixels.
    pub(in super::super) fn relative_near(&self, x: f32, y: f32) -> Option<(f32, usize)> {
        let (column, row) = self.pixel_before(x, y, 0)?;
        let width = self.window.width;
        let index = row * width + column;
        let (across, down) = (x - column as f32, y - row as f32);
        let along = |index: usize| {
            let (left, right) = (f32::from(self.relative[index]), f32::from(self.relative[index + 1]));
            left + across * (right - left)
        };
        let (above, below) = (along(index), along(index + width));
        Some((above + down * (below - above), index))
    }

    /// Relative brightness at a place of the window, in its units, and the index of a pixel there; `None` off the window.
    /// Cubic convolution (Keys 1981, a = −½): between pixels, linear interpolation would miss an edge by several levels.
    pub(in super::super) fn relative_at(&self, x: f32, y: f32) -> Option<(f32, usize)> {
        let (column, row) = self.pixel_before(x, y, 1)?;
        let across = cubic_weights(x - column as f32);
        let down = cubic_weights(y - row as f32);
        let first = (row - 1) * self.window.width + column - 1;
        let mut level = 0.0;
        for (line, weight) in down.into_iter().enumerate() {
            let start = first + line * self.window.width;
            let values = self.relative.get(start..start + 4)?;
            let along: f32 = values.iter().zip(across).map(|(value, weight)| f32::from(*value) * weight).sum();
            level += weight * along;
        }
        Some((level, row * self.window.width + column))
    }
}

/// Weights of four neighbours at a share of the way from the second to the third.
fn cubic_weights(share: f32) -> [f32; 4] {
    let t = share;
    [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (1.5 * t - 2.5),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (0.5 * t - 0.5),
    ]
}
