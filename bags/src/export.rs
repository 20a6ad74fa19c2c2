//! The numbers and texts of a bag as tables (CSV): one file for each topic, one row for each message, one column for each number and text.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::cdr::{Leaf, MessageType};
use crate::error::BagError;
use crate::read::{Bag, Query, Topic};
use crate::selection::Selection;

/// A table with more columns is of little use, and not written.
const COLUMNS_MAX: usize = 4096;

/// A table that was written, or why it was not.
#[derive(Debug)]
pub struct Exported {
    /// The topic.
    pub topic: String,
    /// The file and its rows, or the reason.
    pub outcome: Result<(PathBuf, u64), String>,
}

/// Writes the topics of `selection` to files in `folder`, named after the topics with dots for slashes. The first columns
/// are the time in the bag and the time of publication, ns; the others are named by field, as `position[0]`. Sequences get
/// as many columns as the longest has elements; cells of shorter ones are empty. Raw bytes are left out.
///
/// # Errors
/// When a file cannot be written. What is wrong with a topic is in the result.
pub fn export(bag: &Bag, selection: &Selection, folder: &Path) -> Result<Vec<Exported>, BagError> {
    std::fs::create_dir_all(folder).map_err(BagError::io(folder))?;
    let mut exported = Vec::new();
    for (index, topic) in bag.topics().iter().enumerate() {
        if !selection.takes(&topic.name, &topic.ros_type) {
            continue;
        }
        let outcome = match columns(bag, index, topic) {
            Ok((ty, columns)) => Ok(write(bag, index, topic, &ty, &columns, folder)?),
            Err(reason) => Err(reason),
        };
        exported.push(Exported { topic: topic.name.clone(), outcome });
    }
    Ok(exported)
}

type Columns = HashMap<String, usize>;

/// The columns that the topic's messages need, in the order in which they come up.
fn columns(bag: &Bag, index: usize, topic: &Topic) -> Result<(MessageType, Columns), String> {
    let ty = MessageType::parse(&topic.ros_type, &topic.schema).map_err(|error| error.to_string())?;
    let mut columns = Columns::new();
    for message in bag.messages(&Query::topic(index)).filter_map(Result::ok) {
        let walked = ty.walk(&message.data, &mut |path, leaf| {
            if !matches!(leaf, Leaf::Bytes(_)) && !columns.contains_key(path) && columns.len() <= COLUMNS_MAX {
                columns.insert(path.to_owned(), columns.len());
            }
        });
        walked.map_err(|reason| format!("its messages do not fit their definition: {reason}"))?;
        if columns.len() > COLUMNS_MAX {
            return Err(format!("its messages need more than {COLUMNS_MAX} columns"));
        }
    }
    if columns.is_empty() { Err("it has neither numbers nor texts".to_owned()) } else { Ok((ty, columns)) }
}

fn write(
    bag: &Bag,
    index: usize,
    topic: &Topic,
    ty: &MessageType,
    columns: &Columns,
    folder: &Path,
) -> Result<(PathBuf, u64), BagError> {
    let path = folder.join(format!("{}.csv", topic.name.trim_matches('/').replace('/', ".")));
    let fail = |error: csv::Error| BagError::invalid(&path, error);
    let mut table = csv::Writer::from_path(&path).map_err(fail)?;
    let mut row = vec![String::new(); columns.len() + 2];
    row[0] = "log_time_ns".to_owned();
    row[1] = "publish_time_ns".to_owned();
    for (name, column) in columns {
        row[column + 2].clone_from(name);
    }
    table.write_record(&row).map_err(fail)?;
    let mut rows = 0;
    for message in bag.messages(&Query::topic(index)).filter_map(Result::ok) {
        row.iter_mut().for_each(String::clear);
        row[0] = message.log_ns.to_string();
        row[1] = message.publish_ns.to_string();
        let walked = ty.walk(&message.data, &mut |path, leaf| {
            if let Some(column) = columns.get(path) {
                row[column + 2] = exactly(leaf);
            }
        });
        walked.map_err(|reason| BagError::Message { topic: topic.name.clone(), log_ns: message.log_ns, reason })?;
        table.write_record(&row).map_err(fail)?;
        rows += 1;
    }
    table.flush().map_err(BagError::io(&path))?;
    Ok((path, rows))
}

/// A text as it is, and a number with as many digits as it takes to read it back.
fn exactly(leaf: Leaf<'_>) -> String {
    match leaf {
        Leaf::Float32(value) => format!("{value:?}"),
        Leaf::Float64(value) => format!("{value:?}"),
        Leaf::Bool(value) => u8::from(value).to_string(),
        Leaf::Text(text) => text.to_owned(),
        other => other.to_string(),
    }
}
