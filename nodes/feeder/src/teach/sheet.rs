//! The contact sheet: every thing that pictures show, cut out, with the number by which the table of labels names it.

use image::{GrayImage, Luma};
use nalgebra::Point2;

/// Cut-outs on a row, and rows on a sheet.
const COLUMNS: u32 = 10;
const ROWS: u32 = 10;
/// Side of a cut-out on the sheet, px, at least.
const SIDE_MIN_PX: u32 = 80;
/// Between cut-outs, and height of the line that holds a number, px.
const GAP_PX: u32 = 6;
const LINE_PX: u32 = 14;
/// Pixels of the sheet that a dot of a digit takes each way.
const DOT_PX: u32 = 2;
const DIGIT_COLUMNS: u32 = 3;
/// The digits 0 to 9, three dots wide and five high, row by row, the lowest bit on the right.
const DIGITS: [[u8; 5]; 10] = [
    [7, 5, 5, 5, 7],
    [2, 6, 2, 2, 7],
    [7, 1, 7, 4, 7],
    [7, 1, 7, 1, 7],
    [5, 5, 7, 1, 1],
    [7, 4, 7, 1, 7],
    [7, 4, 7, 5, 7],
    [7, 1, 1, 1, 1],
    [7, 5, 7, 5, 7],
    [7, 5, 7, 1, 7],
];

/// A thing to be shown.
pub(crate) struct CutOut<'a> {
    pub(crate) number: u32,
    pub(crate) image: &'a GrayImage,
    pub(crate) pixel: Point2<f64>,
}

/// The sheets, each cut-out reaching `reach_px` from its middle.
pub(crate) fn sheets(things: &[CutOut], reach_px: u32) -> Vec<GrayImage> {
    things.chunks((COLUMNS * ROWS) as usize).map(|page| sheet(page, reach_px)).collect()
}

fn sheet(things: &[CutOut], reach_px: u32) -> GrayImage {
    let taken = 2 * reach_px + 1;
    let enlarged = SIDE_MIN_PX.div_ceil(taken).max(1);
    let side = taken * enlarged;
    let (across, down) = (side + GAP_PX, side + LINE_PX + GAP_PX);
    let count = u32::try_from(things.len()).unwrap_or(u32::MAX);
    let mut sheet = GrayImage::from_pixel(COLUMNS * across, count.div_ceil(COLUMNS) * down, Luma([255]));
    for (index, thing) in (0_u32..).zip(things) {
        let (left, top) = (index % COLUMNS * across, index / COLUMNS * down);
        #[expect(clippy::cast_possible_truncation, reason = "a place in a picture")]
        let (middle_x, middle_y) = (thing.pixel.x.round() as i64, thing.pixel.y.round() as i64);
        for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
            let source = |middle: i64, at: u32| middle - i64::from(reach_px) + i64::from(at / enlarged);
            let pixel = u32::try_from(source(middle_x, x)).ok().zip(u32::try_from(source(middle_y, y)).ok());
            let pixel = pixel.and_then(|(x, y)| thing.image.get_pixel_checked(x, y));
            sheet.put_pixel(left + x, top + y, pixel.copied().unwrap_or(Luma([0])));
        }
        write(&mut sheet, left, top + side + 2, thing.number);
    }
    sheet
}

/// Writes a number in black.
fn write(sheet: &mut GrayImage, left: u32, top: u32, number: u32) {
    for (index, digit) in (0_u32..).zip(number.to_string().bytes()) {
        let rows = DIGITS[usize::from(digit - b'0')];
        for (row, bits) in (0_u32..).zip(rows) {
            for column in (0..DIGIT_COLUMNS).filter(|column| bits >> (DIGIT_COLUMNS - 1 - column) & 1 == 1) {
                let x = left + ((DIGIT_COLUMNS + 1) * index + column) * DOT_PX;
                let y = top + row * DOT_PX;
                for (dx, dy) in (0..DOT_PX).flat_map(|dy| (0..DOT_PX).map(move |dx| (dx, dy))) {
                    if let Some(pixel) = sheet.get_pixel_mut_checked(x + dx, y + dy) {
                        *pixel = Luma([0]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_thing_is_cut_out_over_its_number() {
        let mut image = GrayImage::new(100, 100);
        image.put_pixel(50, 40, Luma([200]));
        let thing = |number, x, y| CutOut { number, image: &image, pixel: Point2::new(x, y) };
        let things: Vec<CutOut> = (1..=101).map(|number| thing(number, 50.2, 39.8)).collect();
        let sheets = sheets(&things, 10);
        assert_eq!(sheets.len(), 2);
        // 21 px enlarged four times; the marked pixel is in the middle.
        let (across, down) = (84 + GAP_PX, 84 + LINE_PX + GAP_PX);
        assert_eq!(sheets[0].dimensions(), (10 * across, 10 * down));
        assert_eq!(sheets[1].dimensions(), (10 * across, down));
        let bright = sheets[0].enumerate_pixels().filter(|(x, y, pixel)| *x < 84 && *y < 84 && pixel.0[0] == 200);
        let bright: Vec<(u32, u32)> = bright.map(|(x, y, _)| (x, y)).collect();
        assert_eq!((bright.len(), bright[0]), (16, (40, 40)));
        // The first is a 1, of ten dots less those that are white: 1 + 2 + 1 + 1 + 3.
        let line =
            sheets[0].enumerate_pixels().filter(|(x, y, pixel)| *x < 84 && (84..98).contains(y) && pixel.0[0] == 0);
        assert_eq!(line.count(), 8 * 4);
    }

    #[test]
    fn a_thing_at_the_border_is_cut_out_with_black_beyond_it() {
        let image = GrayImage::from_pixel(100, 100, Luma([90]));
        let sheet = sheets(&[CutOut { number: 7, image: &image, pixel: Point2::new(0.0, 99.0) }], 20).remove(0);
        assert_eq!((sheet.get_pixel(0, 0).0, sheet.get_pixel(60, 10).0, sheet.get_pixel(60, 70).0), ([0], [90], [0]));
    }
}
