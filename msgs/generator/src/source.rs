//! Definitions as they lie in packages' folders.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use crate::{error::Error, model::PackageFolder};

/// The text of one definition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DefinitionFile {
    /// Package that the definition belongs to.
    pub package: String,
    /// Folder within the package.
    pub namespace: PackageFolder,
    /// Name of the type: the file's without extension.
    pub name: String,
    /// File, for error messages.
    pub file: PathBuf,
    /// Text of the file.
    pub text: String,
}

impl DefinitionFile {
    /// Reads the definitions in the folders `msg`, `srv` and `action` of a package, in the order of their names.
    ///
    /// # Errors
    /// [`Error::Read`] if a folder or file cannot be read; [`Error::Foreign`] for another kind of file in them.
    pub fn read_package(package: &str, root: &Path) -> Result<Vec<Self>, Error> {
        let mut sources = Vec::new();
        for namespace in PackageFolder::ALL {
            let folder = root.join(namespace.as_str());
            if !folder.exists() {
                continue;
            }
            for file in entries(&folder)? {
                let extension = namespace.as_str();
                if file.extension().is_none_or(|found| found != extension) {
                    return Err(Error::Foreign { path: file, extension });
                }
                sources.push(Self {
                    package: package.to_owned(),
                    namespace,
                    name: file.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                    text: fs::read_to_string(&file).map_err(|source| read_error(&file, source))?,
                    file,
                });
            }
        }
        Ok(sources)
    }

    /// Reads all packages of a folder, each in a folder of its name.
    ///
    /// # Errors
    /// As [`DefinitionFile::read_package`].
    pub fn read_packages(root: &Path) -> Result<Vec<Self>, Error> {
        let mut sources = Vec::new();
        for folder in entries(root)? {
            let package = folder.file_name().unwrap_or_default().to_string_lossy();
            sources.extend(Self::read_package(&package, &folder)?);
        }
        Ok(sources)
    }
}

/// What lies in a folder, sorted so that results do not depend on the file system.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut paths = fs::read_dir(folder)
        .and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>())
        .map_err(|source| read_error(folder, source))?;
    paths.sort();
    Ok(paths)
}

fn read_error(path: &Path, source: io::Error) -> Error {
    Error::Read { path: path.to_owned(), source }
}
