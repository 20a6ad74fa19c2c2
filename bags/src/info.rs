//! What is in a bag, as `ros2 bag info` shows it.

use std::fmt::{self, Write as _};

use crate::error::Seconds;
use crate::read::{Bag, BagFile};

/// A bag's facts, to be shown.
#[derive(Debug, Clone, Copy)]
pub struct Info<'a>(pub &'a Bag);

impl fmt::Display for Info<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bag = self.0;
        let mut row = |name: &str, value: &dyn fmt::Display| {
            let name = if name.is_empty() { String::new() } else { format!("{name}:") };
            writeln!(f, "{name:<19}{value}")
        };
        let mut name = "Files";
        for file in bag.files() {
            row(name, &file.path().file_name().unwrap_or_default().to_string_lossy())?;
            name = "";
        }
        row("Bag size", &size(bag.size_bytes()))?;
        row("Storage id", &"mcap")?;
        let distribution = bag.metadata().map(|metadata| metadata.ros_distro.as_str()).filter(|name| !name.is_empty());
        row("ROS Distro", &distribution.unwrap_or("unknown"))?;
        let compressions: Vec<&str> = bag.files().flat_map(BagFile::compressions).map(String::as_str).collect();
        let compression = compressions.iter().find(|name| !name.is_empty());
        row("Compression", compression.unwrap_or(&"none"))?;
        let (start, end) = bag.bounds_ns().unwrap_or_default();
        row("Duration", &Seconds(end - start))?;
        row("Start", &Seconds(start))?;
        row("End", &Seconds(end))?;
        row("Messages", &bag.message_count())?;
        let mut name = "Topic information";
        for topic in bag.topics() {
            let line = format!(
                "Topic: {} | Type: {} | Count: {} | Serialization Format: {}",
                topic.name, topic.ros_type, topic.count, topic.message_encoding
            );
            row(name, &line)?;
            name = "";
        }
        let (attachments, records) = bag.extras();
        if !attachments.is_empty() {
            row("Attachments", &attachments.into_iter().collect::<Vec<_>>().join(", "))?;
        }
        for record in records.into_iter().filter(|name| *name != "rosbag2") {
            let mut texts = String::new();
            for (key, value) in bag.records(record).last().into_iter().flatten() {
                let separator = if texts.is_empty() { "" } else { ", " };
                write!(texts, "{separator}{key} {value}")?;
            }
            row(record, &texts)?;
        }
        Ok(())
    }
}

/// A size with a unit, as rosbag2 shows it.
fn size(bytes: u64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "shown with one decimal")]
    let mut value = bytes as f64;
    let mut unit = "B";
    for larger in ["KiB", "MiB", "GiB", "TiB"] {
        if value < 1024.0 {
            break;
        }
        value /= 1024.0;
        unit = larger;
    }
    if unit == "B" { format!("{bytes} B") } else { format!("{value:.1} {unit}") }
}
