//! Generates the Rust types of the definitions in `msg`, `srv`, `action` and `standard`.

use std::{env, error::Error, fs, path::Path, process::ExitCode};

use ros2_msggen::{Catalogue, DefinitionFile, emit};

const PACKAGE: &str = "minifactory_msgs";

fn main() -> ExitCode {
    match generate() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn generate() -> Result<(), Box<dyn Error>> {
    let root = env::var("CARGO_MANIFEST_DIR")?;
    let root = Path::new(&root);
    let standard = root.join("standard");
    for folder in ["msg", "srv", "action", "standard"] {
        println!("cargo::rerun-if-changed={folder}");
    }
    let mut sources = DefinitionFile::read_package(PACKAGE, root)?;
    sources.extend(DefinitionFile::read_packages(&standard)?);
    let catalogue = Catalogue::new(&sources)?;
    let file = Path::new(&env::var("OUT_DIR")?).join("messages.rs");
    fs::write(file, emit(&catalogue, PACKAGE)?)?;
    Ok(())
}
