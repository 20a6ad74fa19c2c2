//! A mono picture as baseline JPEG (ITU-T T.81), a row of a block at a time in vectors.
//!
//! Written here because coding was a fifth of the simulator's time: general encoders take 1.6 (libjpeg-turbo) to 3 times
//! (jpeg-encoder with its vectors) as long for a picture of the feeder. What it leaves of a picture is as good: steps are those
//! of T.81 for the quality, and coefficients are rounded to the nearest one.

use std::f32::consts::FRAC_1_SQRT_2;
use std::f64::consts::{PI, SQRT_2};

use image::GrayImage;
use wide::{f32x4, f32x8, i16x8};

use feeder_model::camera::single;

/// Pixels along either side of a block.
const SIDE: usize = 8;
/// The level that is 0 for the transform.
const MIDDLE_LEVEL: f32 = 128.0;
/// What begins a run of sixteen zeros, and what says that only zeros are left.
const SIXTEEN_ZEROS: u8 = 0xf0;
const ONLY_ZEROS: u8 = 0x00;

/// Places of a block, counted row by row, in the order in which they are coded (T.81, figure A.6).
#[rustfmt::skip]
const ZIGZAG: [u8; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5,
    12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7, 14, 21, 28,
    35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51,
    58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63,
];
/// Where in that order each place of a transposed block comes.
const ORDER: [u8; 64] = {
    let mut order = [0; 64];
    let mut position = 0;
    while position < 64 {
        let place = ZIGZAG[position as usize] as usize;
        order[place % SIDE * SIDE + place / SIDE] = position;
        position += 1;
    }
    order
};
/// Steps of coefficients at quality 50, row by row (T.81, table K.1).
#[rustfmt::skip]
const STEPS: [u8; 64] = [
    16, 11, 10, 16, 24, 40, 51, 61,
    12, 12, 14, 19, 26, 58, 60, 55,
    14, 13, 16, 24, 40, 57, 69, 56,
    14, 17, 22, 29, 51, 87, 80, 62,
    18, 22, 37, 56, 68, 109, 103, 77,
    24, 35, 55, 64, 81, 104, 113, 92,
    49, 64, 78, 87, 103, 121, 120, 101,
    72, 92, 95, 98, 112, 100, 103, 99,
];
/// How many codes there are of each length from 1 bit on, and what they stand for: of means (T.81, table K.3), and of what
/// follows (table K.5).
const MEAN_LENGTHS: [u8; 16] = [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0];
const MEAN_SYMBOLS: [u8; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];
const REST_LENGTHS: [u8; 16] = [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 125];
#[rustfmt::skip]
const REST_SYMBOLS: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07,
    0x22, 0x71, 0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0,
    0x24, 0x33, 0x62, 0x72, 0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28,
    0x29, 0x2a, 0x34, 0x35, 0x36, 0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49,
    0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69,
    0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89,
    0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7,
    0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3, 0xc4, 0xc5,
    0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2,
    0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8,
    0xf9, 0xfa,
];
static MEAN_CODES: Codes = codes(&MEAN_LENGTHS, &MEAN_SYMBOLS);
static REST_CODES: Codes = codes(&REST_LENGTHS, &REST_SYMBOLS);

/// A block by rows, or transposed.
type Block = [f32x8; SIDE];
/// The code of each symbol, and how many bits it has.
type Codes = [(u32, u32); 256];

/// Appends `image` to `out`, coded at a quality from 1 to 100. Each side has 1 to 65535 px.
pub(super) fn encode(image: &GrayImage, [width, height]: [u16; 2], quality: u8, out: &mut Vec<u8>) {
    let steps = steps(quality);
    write_header([width, height], &steps, out);
    let scales = scales(&steps);
    let (width, height) = (usize::from(width), usize::from(height));
    let padded = width.next_multiple_of(SIDE);
    // Eight rows; beyond the border the last pixel comes again.
    let mut band = vec![0; padded * SIDE];
    let mut bits = Bits { bytes: out, buffer: 0, count: 0 };
    let mut mean = 0;
    for top in (0..height).step_by(SIDE) {
        for (line, row) in band.chunks_exact_mut(padded).zip(top..) {
            let pixels = &image.as_raw()[row.min(height - 1) * width..][..width];
            line[..width].copy_from_slice(pixels);
            line[width..].fill(pixels[width - 1]);
        }
        for left in (0..padded).step_by(SIDE) {
            let row = |row: usize| -> [u8; SIDE] { std::array::from_fn(|column| band[row * padded + left + column]) };
            let block = std::array::from_fn(|index| f32x8::from(row(index).map(f32::from)) - MIDDLE_LEVEL);
            mean = bits.write_block(&quantized(block, &scales), mean);
        }
    }
    bits.finish();
    out.extend([0xff, 0xd9]);
}

/// Steps at a quality, row by row: those of T.81 are said to be of 50, and what others mean is custom.
fn steps(quality: u8) -> [u8; 64] {
    let quality = u32::from(quality.clamp(1, 100));
    let percent = if quality < 50 { 5000 / quality } else { 200 - 2 * quality };
    STEPS.map(|step| u8::try_from((u32::from(step) * percent + 50) / 100).unwrap_or(u8::MAX).max(1))
}

/// What turns the results of the transform, both ways, into steps: transposed.
fn scales(steps: &[u8; 64]) -> Block {
    // By so much the fast transform is too large at a frequency.
    let gain = |frequency: usize| match frequency {
        0 => 1.0,
        _ => SQRT_2 * (PI * frequency as f64 / 16.0).cos(),
    };
    std::array::from_fn(|across| {
        let scale =
            |down: usize| single(1.0 / (8.0 * f64::from(steps[down * SIDE + across]) * gain(across) * gain(down)));
        f32x8::from(std::array::from_fn(scale))
    })
}

fn write_header([width, height]: [u16; 2], steps: &[u8; 64], out: &mut Vec<u8>) {
    let ([width_high, width_low], [height_high, height_low]) = (width.to_be_bytes(), height.to_be_bytes());
    out.extend([0xff, 0xd8]);
    write_segment(0xe0, &[b"JFIF\0\x01\x02\0\0\x01\0\x01\0\0"], out);
    write_segment(0xdb, &[&[0], &ZIGZAG.map(|place| steps[usize::from(place)])], out);
    // Eight bits a level, one component with a block for each unit and tables 0.
    write_segment(0xc0, &[&[8, height_high, height_low, width_high, width_low, 1, 1, 0x11, 0]], out);
    let codes: [&[u8]; 6] = [&[0x00], &MEAN_LENGTHS, &MEAN_SYMBOLS, &[0x10], &REST_LENGTHS, &REST_SYMBOLS];
    write_segment(0xc4, &codes, out);
    write_segment(0xda, &[&[1, 1, 0x00, 0, 63, 0]], out);
}

fn write_segment(marker: u8, parts: &[&[u8]], out: &mut Vec<u8>) {
    let length = 2 + parts.iter().map(|part| part.len()).sum::<usize>();
    out.extend([0xff, marker]);
    out.extend(u16::try_from(length).unwrap_or(u16::MAX).to_be_bytes());
    parts.iter().for_each(|part| out.extend_from_slice(part));
}

/// Codes by the number of them of each length: those of a length count up, and the next longer ones go on from there.
const fn codes(lengths: &[u8; 16], symbols: &[u8]) -> Codes {
    let mut codes = [(0, 0); 256];
    let (mut code, mut next, mut length) = (0, 0, 1);
    while length <= 16 {
        let mut left = lengths[length as usize - 1];
        while left > 0 {
            codes[symbols[next] as usize] = (code, length);
            code += 1;
            next += 1;
            left -= 1;
        }
        code <<= 1;
        length += 1;
    }
    codes
}

/// The coefficients of a block in steps, transposed.
#[inline]
fn quantized(block: Block, scales: &Block) -> [[i16; SIDE]; SIDE] {
    let coefficients = transformed(transposed(transformed(block)));
    std::array::from_fn(|row| {
        let steps = (coefficients[row] * scales[row]).fast_round_int();
        i16x8::from_i32x8_saturate(steps).to_array()
    })
}

/// The cosine transform along the columns, each frequency times its gain, as Y. Arai, T. Agui and M. Nakajima found it: "A
/// fast DCT-SQ scheme for images", Trans. IEICE E71 (11), 1988.
#[inline]
fn transformed([a, b, c, d, e, f, g, h]: Block) -> Block {
    /// Cosine of 3π/8, and that of π/8 less and plus it.
    const COS_6: f32 = 0.382_683_43;
    const COS_2_LESS_COS_6: f32 = 0.541_196_1;
    const COS_2_AND_COS_6: f32 = 1.306_563;
    // Mirrored pairs: sums give the even frequencies, differences the odd ones.
    let (outer, inner) = ([a + h, b + g], [d + e, c + f]);
    let (ends, between) = ([outer[0] + inner[0], outer[0] - inner[0]], [outer[1] + inner[1], outer[1] - inner[1]]);
    let turned = (ends[1] + between[1]) * FRAC_1_SQRT_2;
    let (first, second, third, last) = (a - h, b - g, c - f, d - e);
    let (low, middle, high) = (last + third, third + second, second + first);
    let shared = (low - high) * COS_6;
    let (low, high) = (low * COS_2_LESS_COS_6 + shared, high * COS_2_AND_COS_6 + shared);
    let middle = middle * FRAC_1_SQRT_2;
    let (plus, minus) = (first + middle, first - middle);
    [
        ends[0] + between[0],
        plus + high,
        ends[1] + turned,
        minus - low,
        ends[0] - between[0],
        minus + low,
        ends[1] - turned,
        plus - high,
    ]
}

#[inline]
fn transposed(rows: Block) -> Block {
    let halves = rows.map(|row| {
        let [a, b, c, d, e, f, g, h] = row.to_array();
        [f32x4::from([a, b, c, d]), f32x4::from([e, f, g, h])]
    });
    let quarter = |top: usize, half: usize| f32x4::transpose(std::array::from_fn(|row| halves[top + row][half]));
    let quarters = [0, 1].map(|half| [quarter(0, half), quarter(4, half)]);
    std::array::from_fn(|row| {
        let [upper, lower] = quarters[row / 4].map(|quarter| quarter[row % 4].to_array());
        let ([a, b, c, d], [e, f, g, h]) = (upper, lower);
        f32x8::from([a, b, c, d, e, f, g, h])
    })
}

/// Writes codes one bit after the other.
struct Bits<'a> {
    bytes: &'a mut Vec<u8>,
    /// The latest bits, in the lowest places, and how many of them are not written: at most 32.
    buffer: u64,
    count: u32,
}

impl Bits<'_> {
    /// Codes a block, given transposed and in steps, after one with the mean `before`; returns its mean.
    #[inline]
    fn write_block(&mut self, block: &[[i16; SIDE]; SIDE], before: i16) -> i16 {
        // Most coefficients are 0. Those that are not are brought into order, and marked from the highest bit on.
        let mut ordered = [0; 64];
        let (mut marks, mut left) = (0_u64, 0_u64);
        for (row, values) in block.iter().enumerate() {
            let zeros = i16x8::from(*values).simd_eq(i16x8::ZERO).to_bitmask();
            left |= u64::from(!zeros & 0xff) << (SIDE * row);
        }
        let values = block.as_flattened();
        while left != 0 {
            let place = left.trailing_zeros() as usize % 64;
            let position = usize::from(ORDER[place]) % 64;
            ordered[position] = values[place];
            marks |= 1 << (63 - position);
            left &= left - 1;
        }
        let mean: i16 = ordered[0];
        self.write_value(0, i32::from(mean) - i32::from(before), &MEAN_CODES);
        let (mut last, mut marks) = (0, marks & !(1 << 63));
        while marks != 0 {
            let position = marks.leading_zeros() % 64;
            let mut zeros = position - last - 1;
            while zeros > 15 {
                self.write_symbol(SIXTEEN_ZEROS);
                zeros -= 16;
            }
            self.write_value(zeros, i32::from(ordered[position as usize]), &REST_CODES);
            last = position;
            marks &= !(1 << (63 - position));
        }
        if last < 63 {
            self.write_symbol(ONLY_ZEROS);
        }
        mean
    }

    /// Writes a value that comes after so many zeros: both have a code, followed by the value's bits, of a negative one
    /// those of the value less one.
    #[inline]
    fn write_value(&mut self, zeros: u32, value: i32, codes: &Codes) {
        let size = 32 - value.unsigned_abs().leading_zeros();
        let bits = (value + (value >> 31)).cast_unsigned() & ((1 << size) - 1);
        let (code, length) = codes[(zeros << 4 | size) as usize % 256];
        self.write(code << size | bits, length + size);
    }

    #[inline]
    fn write_symbol(&mut self, symbol: u8) {
        let (code, length) = REST_CODES[usize::from(symbol)];
        self.write(code, length);
    }

    /// Writes at most 32 bits.
    #[inline]
    fn write(&mut self, bits: u32, count: u32) {
        self.buffer = self.buffer << count | u64::from(bits);
        self.count += count;
        if self.count > 32 {
            self.count -= 32;
            let [.., a, b, c, d] = (self.buffer >> self.count).to_be_bytes();
            let bytes = [a, b, c, d];
            if bytes.contains(&0xff) {
                bytes.iter().for_each(|byte| self.write_byte(*byte));
            } else {
                self.bytes.extend_from_slice(&bytes);
            }
        }
    }

    /// A byte that could be taken for the beginning of a marker is followed by a 0.
    fn write_byte(&mut self, byte: u8) {
        self.bytes.push(byte);
        if byte == 0xff {
            self.bytes.push(0);
        }
    }

    /// Fills the last byte with ones.
    fn finish(mut self) {
        self.write(0x7f, 7);
        while self.count >= 8 {
            self.count -= 8;
            let [.., byte] = (self.buffer >> self.count).to_be_bytes();
            self.write_byte(byte);
        }
    }
}
