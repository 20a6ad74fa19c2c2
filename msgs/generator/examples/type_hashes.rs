//! Prints the name and hash of every type in a folder of packages:
//! `cargo run --package ros2_msggen --example type_hashes -- msgs/standard`.

use std::error::Error;
use std::path::PathBuf;

use ros2_msggen::{Catalogue, DefinitionFile};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map(PathBuf::from).ok_or("which folder of packages?")?;
    let catalogue = Catalogue::new(&DefinitionFile::read_packages(&folder)?)?;
    for structure in catalogue.structures() {
        println!("{} {}", structure.name, catalogue.type_hash(structure));
    }
    Ok(())
}
