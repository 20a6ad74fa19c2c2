//! Connected blobs of foreground.

/// A stretch of foreground in a row.
#[derive(Clone, Copy, Debug)]
struct Run {
    row: usize,
    start: usize,
    end: usize,
    /// A run of the same blob found earlier, or itself.
    parent: usize,
    /// Pixels of the blob, as far as known to its first run.
    area: usize,
}

/// Finds blobs by their runs; keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Blobs {
    runs: Vec<Run>,
}

impl Blobs {
    /// Clears the blobs, diagonals connecting, of fewer than `blob_px_min` pixels.
    pub(super) fn drop_specks(&mut self, foreground: &mut [u8], width: usize, blob_px_min: usize) {
        self.runs.clear();
        let mut above = 0..0;
        for (row, pixels) in foreground.chunks(width).enumerate() {
            let first = self.runs.len();
            let mut column = 0;
            let mut candidate = above.start;
            while let Some(start) = pixels[column..].iter().position(|p| *p != 0).map(|skip| column + skip) {
                let end = pixels[start..].iter().position(|p| *p == 0).map_or(width, |length| start + length);
                let index = self.runs.len();
                self.runs.push(Run { row, start, end, parent: index, area: end - start });
                while candidate < above.end && self.runs[candidate].end < start {
                    candidate += 1;
                }
                let mut touching = candidate;
                while touching < above.end && self.runs[touching].start <= end {
                    self.join(touching, index);
                    touching += 1;
                }
                column = end;
            }
            above = first..self.runs.len();
        }
        for index in 0..self.runs.len() {
            let root = self.root(index);
            let Run { row, start, end, .. } = self.runs[index];
            if self.runs[root].area < blob_px_min {
                foreground[row * width + start..row * width + end].fill(0);
            }
        }
    }

    fn root(&mut self, mut index: usize) -> usize {
        while self.runs[index].parent != index {
            let grandparent = self.runs[self.runs[index].parent].parent;
            self.runs[index].parent = grandparent;
            index = grandparent;
        }
        index
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            let (low, high) = (a.min(b), a.max(b));
            self.runs[high].parent = low;
            self.runs[low].area += self.runs[high].area;
        }
    }
}

#[cfg(test)]
mod tests {
    use imageproc::region_labelling::{Connectivity, connected_components};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn verif_blobs_against_the_labelling_of_imageproc(
            pixels in proptest::collection::vec(0_u8..2, 12 * 9), blob_px_min in 1_usize..12,
        ) {
            let image = image::GrayImage::from_raw(12, 9, pixels.clone()).unwrap();
            let labels = connected_components(&image, Connectivity::Eight, image::Luma([0]));
            let mut expected = pixels.clone();
            for (pixel, label) in expected.iter_mut().zip(labels.iter()) {
                let area = labels.iter().filter(|other| *other == label).count();
                if *label > 0 && area < blob_px_min {
                    *pixel = 0;
                }
            }
            let mut found = pixels;
            Blobs::default().drop_specks(&mut found, 12, blob_px_min);
            prop_assert_eq!(found, expected);
        }
    }
}
