//! The pictures of a teaching session, and what somebody said of the things in them.

use std::path::Path;

use anyhow::Context as _;
use feeder_vision::{Click, ClickLabel, ClickedPicture};
use nalgebra::Point2;

use super::labels::{self, Label};
use super::source::Source;
use crate::pictures::Photo;

/// Pictures with clicks in them.
pub(crate) struct Album {
    pub(crate) photos: Vec<Photo>,
    /// For each picture the clicks in it, and each one's line in the table.
    pub(crate) clicks: Vec<Vec<Click>>,
    pub(crate) lines: Vec<Vec<u64>>,
}

impl Album {
    /// The pictures of which a table of labels speaks; the others are not even read.
    pub(crate) fn open(source: &Source, table: &Path, poses: &[String]) -> anyhow::Result<Self> {
        let names = source.names();
        let labelled = labels::read(table, &names, poses)?;
        let mut album = Self { photos: Vec::new(), clicks: Vec::new(), lines: Vec::new() };
        for index in 0..names.len() {
            let mut of_file = labelled.iter().filter(|click| click.picture == index).peekable();
            if of_file.peek().is_none() {
                continue;
            }
            let photo = source.photo(index)?;
            let (mut clicks, mut lines) = (Vec::new(), Vec::new());
            for click in of_file {
                let place = || table.display().to_string();
                click.require_inside(photo.own_size_px).with_context(place)?;
                let pixel = photo.camera_px(Point2::new(click.x_px, click.y_px));
                let label = match click.label {
                    Label::Pose(pose) => ClickLabel::Pose(pose),
                    Label::Other => ClickLabel::Other,
                    Label::Foreign => ClickLabel::Foreign,
                };
                clicks.push(Click { pixel, label });
                lines.push(click.line);
            }
            album.photos.push(photo);
            album.clicks.push(clicks);
            album.lines.push(lines);
        }
        Ok(album)
    }

    /// The pictures for which `which` holds, as the selector learns from them.
    pub(crate) fn shown(&self, which: impl Fn(usize) -> bool) -> Vec<ClickedPicture<'_>> {
        let pictures = self.photos.iter().zip(&self.clicks).enumerate().filter(|(index, _)| which(*index));
        pictures
            .map(|(_, (photo, clicks))| ClickedPicture {
                image: &photo.image,
                platen_from_tray: photo.platen_from_tray,
                clicks,
            })
            .collect()
    }
}
