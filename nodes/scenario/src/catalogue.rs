//! The parts that come with the feeder, and how a scenario names its part.

use thiserror::Error;

use crate::error::yaml_problem;
use crate::source::Source;
use feeder_model::geometry::ShapeError;
use feeder_model::part::{PartSpec, PartType, PartTypeError};

/// The part files of the catalogue by name.
const PART_FILES: [(&str, &str); 7] = [
    ("block", include_str!("../../../launch_configs/parts/block.yaml")),
    ("bracket", include_str!("../../../launch_configs/parts/bracket.yaml")),
    ("cap", include_str!("../../../launch_configs/parts/cap.yaml")),
    ("clip", include_str!("../../../launch_configs/parts/clip.yaml")),
    ("coin", include_str!("../../../launch_configs/parts/coin.yaml")),
    ("grommet", include_str!("../../../launch_configs/parts/grommet.yaml")),
    ("hex_nut", include_str!("../../../launch_configs/parts/hex_nut.yaml")),
];

/// The meshes they name.
const MESH_FILES: [(&str, &[u8]); 1] = [("clip.stl", include_bytes!("../../../launch_configs/parts/clip.stl"))];

/// A part as a scenario states it: the name of a part of the catalogue or of a part file, or the part.
pub type PartSource = Source<PartSpec>;

/// Why there is no part.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PartSourceError {
    /// Neither a part of the catalogue nor a file that was read.
    #[error("{name:?} is no part of the catalogue ({}) and no part file was read under this name", catalogue_names().join(", "))]
    Unknown {
        /// The name.
        name: String,
    },
    /// The text of a part file is none: an unknown key, a wrong type, a missing value.
    #[error("{name}: {message}")]
    Yaml {
        /// Name of the file.
        name: String,
        /// What is wrong, and where.
        message: String,
    },
    /// A file could not be read, or is no mesh.
    #[error("{name}: {message}")]
    File {
        /// Name of the file.
        name: String,
        /// What is wrong.
        message: String,
    },
    /// The part is none.
    #[error(transparent)]
    Part(#[from] PartTypeError),
}

/// Names of the parts in the catalogue, in alphabetical order.
#[must_use]
pub fn catalogue_names() -> Vec<&'static str> {
    PART_FILES.iter().map(|(name, _)| *name).collect()
}

impl PartSource {
    /// What is still to be found in files goes through `read`, which is given the name of a file as the scenario states
    /// it and returns its content, or why it has none.
    ///
    /// # Errors
    /// If a file cannot be read or holds no part.
    pub fn load(&mut self, read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<(), PartSourceError> {
        if let Self::Name(name) = self
            && PART_FILES.iter().all(|(known, _)| known != name)
        {
            let name = std::mem::take(name);
            let bytes = read(&name).map_err(|message| PartSourceError::File { name: name.clone(), message })?;
            let spec = spec_from_yaml(&name, &String::from_utf8_lossy(&bytes))?;
            let folder = name.rfind('/').map_or("", |end| &name[..=end]).to_owned();
            *self = Self::Here(Box::new(spec));
            return self.load(&mut |file| read(&format!("{folder}{file}")));
        }
        if let Self::Here(spec) = self
            && let Some(file) = spec.shape.file()
        {
            let file = file.to_owned();
            let problem = |message| PartSourceError::File { name: file.clone(), message };
            let bytes = read(&file).map_err(problem)?;
            spec.shape.read_stl(&bytes).map_err(|error: ShapeError| problem(error.to_string()))?;
        }
        Ok(())
    }

    /// The part as its file states it.
    ///
    /// # Errors
    /// If it is not in the catalogue and was not loaded.
    pub fn spec(&self) -> Result<PartSpec, PartSourceError> {
        match self {
            Self::Here(spec) => Ok(PartSpec::clone(spec)),
            Self::Name(name) => {
                let Some((name, text)) = PART_FILES.iter().find(|(known, _)| known == name) else {
                    return Err(PartSourceError::Unknown { name: name.clone() });
                };
                let mut source = Self::Here(Box::new(spec_from_yaml(name, text)?));
                source.load(&mut |file| {
                    let mesh = MESH_FILES.iter().find(|(known, _)| *known == file);
                    mesh.map(|(_, bytes)| bytes.to_vec()).ok_or_else(|| "not in the catalogue".to_owned())
                })?;
                source.spec()
            }
        }
    }

    /// The part, checked, with its stable poses.
    ///
    /// # Errors
    /// If it is not in the catalogue and was not loaded, or is no part.
    pub fn part_type(&self) -> Result<PartType, PartSourceError> {
        Ok(PartType::new(&self.spec()?)?)
    }
}

fn spec_from_yaml(name: &str, text: &str) -> Result<PartSpec, PartSourceError> {
    serde_saphyr::from_str(text)
        .map_err(|error| PartSourceError::Yaml { name: name.to_owned(), message: yaml_problem(&error) })
}
