//! Where definitions of types come from: what the program knows itself, and the packages on `AMENT_PREFIX_PATH`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ros2_msggen::{Catalogue, DefinitionFile, Error, PackageFolder, Problem, TypeName};

/// The variable that names where ROS packages are installed, with colons between.
const AMENT_PREFIX_PATH: &str = "AMENT_PREFIX_PATH";

/// A type as a bag describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Definition {
    /// Its name, `package/msg/Name`.
    pub ros_type: String,
    /// Its definition and those of the types it refers to, as `ros2msg`.
    pub text: String,
    /// Its hash (REP-2011).
    pub type_hash: String,
}

/// Looks definitions up.
///
/// ```
/// use ros2_bags::{Definition, Definitions};
///
/// let number = Definition {
///     ros_type: "demo_msgs/msg/Number".to_owned(),
///     text: "uint32 data\n".to_owned(),
///     type_hash: String::new(),
/// };
/// let definitions = Definitions::from_env().with_known([number.clone()]);
/// assert_eq!(definitions.look_up("demo_msgs/msg/Number"), Ok(Some(number)));
/// assert_eq!(definitions.look_up("demo_msgs/msg/Nothing"), Ok(None));
/// ```
#[derive(Debug, Clone)]
pub struct Definitions {
    known: BTreeMap<String, Definition>,
    prefixes: Vec<PathBuf>,
}

impl Definitions {
    /// With the packages that the environment names.
    #[must_use]
    pub fn from_env() -> Self {
        let prefixes = std::env::var_os(AMENT_PREFIX_PATH);
        Self::new(prefixes.map(|paths| std::env::split_paths(&paths).collect()).unwrap_or_default())
    }

    /// With the packages installed under these prefixes.
    #[must_use]
    pub fn new(prefixes: Vec<PathBuf>) -> Self {
        Self { known: BTreeMap::new(), prefixes }
    }

    /// With these as well: types that the program was built with. They come before those of installed packages.
    #[must_use]
    pub fn with_known(mut self, definitions: impl IntoIterator<Item = Definition>) -> Self {
        self.known.extend(definitions.into_iter().map(|definition| (definition.ros_type.clone(), definition)));
        self
    }

    /// The definition of `ros_type`, if it is known.
    ///
    /// # Errors
    /// Why a definition that is there cannot be used.
    pub fn look_up(&self, ros_type: &str) -> Result<Option<Definition>, String> {
        if let Some(known) = self.known.get(ros_type) {
            return Ok(Some(known.clone()));
        }
        let Some(name) = parse_type(ros_type) else { return Ok(None) };
        let Some(first) = self.source(&name)? else { return Ok(None) };
        let mut sources = vec![first];
        // A definition says what it needs by what is found missing.
        loop {
            match Catalogue::new(&sources) {
                Ok(catalogue) => {
                    return Ok(catalogue.get(&name).map(|structure| Definition {
                        ros_type: ros_type.to_owned(),
                        text: catalogue.schema(structure),
                        type_hash: catalogue.type_hash(structure),
                    }));
                }
                Err(Error::Definition { problem: Problem::Unknown(missing), .. }) => {
                    let source = self.source(&missing)?;
                    sources.push(source.ok_or_else(|| format!("{missing}, which it refers to, is not installed"))?);
                }
                Err(error) => return Err(error.to_string()),
            }
        }
    }

    /// The file that defines `name`, from the first prefix that has it; the known text where none has.
    fn source(&self, name: &TypeName) -> Result<Option<DefinitionFile>, String> {
        let namespace = name.namespace.as_str();
        // What ROS derives from a service or action stands in the file of that.
        let base =
            if name.namespace == PackageFolder::Msg { &*name.name } else { name.name.split('_').next().unwrap_or("") };
        for prefix in &self.prefixes {
            let file = prefix.join("share").join(&name.package).join(namespace).join(format!("{base}.{namespace}"));
            match std::fs::read_to_string(&file) {
                Ok(text) => {
                    let (package, name) = (name.package.clone(), base.to_owned());
                    let namespace = parse_namespace(namespace).unwrap_or(PackageFolder::Msg);
                    return Ok(Some(DefinitionFile { package, namespace, name, file, text }));
                }
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
                Err(error) => return Err(format!("{}: {error}", file.display())),
            }
        }
        let known = self.known.get(&name.to_string()).filter(|_| name.namespace == PackageFolder::Msg);
        Ok(known.map(|known| DefinitionFile {
            package: name.package.clone(),
            namespace: PackageFolder::Msg,
            name: name.name.clone(),
            file: PathBuf::from(name.to_string()),
            text: known.text.split("=".repeat(80).as_str()).next().unwrap_or_default().to_owned(),
        }))
    }
}

/// `package/msg/Name` as its parts.
pub(crate) fn parse_type(ros_type: &str) -> Option<TypeName> {
    let mut parts = ros_type.split('/');
    let (package, namespace, name) = (parts.next()?, parts.next()?, parts.next()?);
    if parts.next().is_some() || package.is_empty() || name.is_empty() || name.starts_with('.') {
        return None;
    }
    let plain = |text: &str| text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    let namespace = parse_namespace(namespace).filter(|_| plain(package) && plain(name))?;
    Some(TypeName { package: package.to_owned(), namespace, name: name.to_owned() })
}

fn parse_namespace(text: &str) -> Option<PackageFolder> {
    PackageFolder::ALL.into_iter().find(|namespace| namespace.as_str() == text)
}

/// The name that ROS gives a type in DDS, `package::msg::dds_::Name_`.
#[must_use]
pub fn dds_type(ros_type: &str) -> Option<String> {
    let TypeName { package, namespace, name } = parse_type(ros_type)?;
    Some(format!("{package}::{}::dds_::{name}_", namespace.as_str()))
}

/// The ROS name of a DDS type that ROS named.
#[must_use]
pub fn ros_type(dds_type: &str) -> Option<String> {
    let (scope, name) = dds_type.split_once("::dds_::")?;
    let ros_type = format!("{}/{}", scope.replace("::", "/"), name.strip_suffix('_')?);
    parse_type(&ros_type).map(|_| ros_type)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_translated_both_ways() {
        for (ros, dds) in [
            ("std_msgs/msg/String", "std_msgs::msg::dds_::String_"),
            ("a/action/B_FeedbackMessage", "a::action::dds_::B_FeedbackMessage_"),
        ] {
            assert_eq!(dds_type(ros).as_deref(), Some(dds));
            assert_eq!(ros_type(dds).as_deref(), Some(ros));
        }
        for bad in ["", "String", "a/b/c/d", "a/msg/../b", "a/msg/", "a/topic/B"] {
            assert_eq!(dds_type(bad), None, "{bad}");
        }
        for bad in ["std_msgs::msg::String", "HelloWorld", "a::msg::dds_::B"] {
            assert_eq!(ros_type(bad), None, "{bad}");
        }
    }

    #[test]
    fn some_types_are_known_and_others_come_from_where_packages_are_installed() {
        let rule = "=".repeat(80);
        let header = Definition {
            ros_type: "std_msgs/msg/Header".to_owned(),
            text: format!("builtin_interfaces/Time stamp\n{rule}\nMSG: builtin_interfaces/Time\nint32 sec\n"),
            type_hash: "RIHS01_0".to_owned(),
        };
        let time = Definition {
            ros_type: "builtin_interfaces/msg/Time".to_owned(),
            text: "int32 sec\n".to_owned(),
            type_hash: "RIHS01_1".to_owned(),
        };
        let prefix = tempfile::tempdir().unwrap();
        let folder = prefix.path().join("share/other_msgs/msg");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("Outer.msg"), "std_msgs/Header header\nInner[] inner\n").unwrap();
        std::fs::write(folder.join("Inner.msg"), "float64 value_m\n").unwrap();
        std::fs::write(folder.join("Broken.msg"), "Missing x\n").unwrap();
        let definitions = Definitions::new(vec![prefix.path().join("nowhere"), prefix.path().to_owned()]);
        let definitions = definitions.with_known([header.clone(), time]);
        assert_eq!(definitions.look_up("std_msgs/msg/Header").unwrap(), Some(header));
        let outer = definitions.look_up("other_msgs/msg/Outer").unwrap().unwrap();
        for part in ["MSG: other_msgs/Inner", "MSG: std_msgs/Header", "MSG: builtin_interfaces/Time", "value_m"] {
            assert!(outer.text.contains(part), "{}", outer.text);
        }
        assert!(outer.type_hash.starts_with("RIHS01_"));
        let error = definitions.look_up("other_msgs/msg/Broken").unwrap_err();
        assert!(error.contains("other_msgs/msg/Missing"), "{error}");
        assert_eq!(definitions.look_up("other_msgs/msg/Nowhere").unwrap(), None);
        assert_eq!(definitions.look_up("other_msgs/msg/../../x").unwrap(), None);
    }
}
