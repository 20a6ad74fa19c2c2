//! The page, in the executable.

/// A file of the page.
pub(crate) struct Asset {
    /// Its name, as the page asks for it.
    pub(crate) name: &'static str,
    /// What it is.
    pub(crate) content_type: &'static str,
    /// What is in it.
    pub(crate) body: &'static [u8],
}

macro_rules! assets {
    ($($name:literal as $content_type:literal),+ $(,)?) => {
        &[$(Asset {
            name: $name,
            content_type: $content_type,
            body: include_bytes!(concat!("../page/", $name)),
        }),+]
    };
}

/// Every file in the folder `page`.
pub(crate) const ASSETS: &[Asset] = assets![
    "alerts.js" as "text/javascript; charset=utf-8",
    "camera_view.js" as "text/javascript; charset=utf-8",
    "connection.js" as "text/javascript; charset=utf-8",
    "controls.js" as "text/javascript; charset=utf-8",
    "dom.js" as "text/javascript; charset=utf-8",
    "feed_view.js" as "text/javascript; charset=utf-8",
    "format.js" as "text/javascript; charset=utf-8",
    "gl.js" as "text/javascript; charset=utf-8",
    "help.js" as "text/javascript; charset=utf-8",
    "history.js" as "text/javascript; charset=utf-8",
    "icon.svg" as "image/svg+xml",
    "index.html" as "text/html; charset=utf-8",
    "keys.js" as "text/javascript; charset=utf-8",
    "main.js" as "text/javascript; charset=utf-8",
    "mat4.js" as "text/javascript; charset=utf-8",
    "match.js" as "text/javascript; charset=utf-8",
    "nodes_view.js" as "text/javascript; charset=utf-8",
    "orbit.js" as "text/javascript; charset=utf-8",
    "page.css" as "text/css; charset=utf-8",
    "part_mesh.js" as "text/javascript; charset=utf-8",
    "period_view.js" as "text/javascript; charset=utf-8",
    "permissions.js" as "text/javascript; charset=utf-8",
    "picture.js" as "text/javascript; charset=utf-8",
    "platen_view.js" as "text/javascript; charset=utf-8",
    "playback.js" as "text/javascript; charset=utf-8",
    "plot.js" as "text/javascript; charset=utf-8",
    "run_bar.js" as "text/javascript; charset=utf-8",
    "scene.js" as "text/javascript; charset=utf-8",
    "shaders.js" as "text/javascript; charset=utf-8",
    "slow_motion.js" as "text/javascript; charset=utf-8",
    "stick_slip.js" as "text/javascript; charset=utf-8",
    "theme.css" as "text/css; charset=utf-8",
    "theme.js" as "text/javascript; charset=utf-8",
    "timeline.js" as "text/javascript; charset=utf-8",
    "trails.js" as "text/javascript; charset=utf-8",
    "tray_mesh.js" as "text/javascript; charset=utf-8",
    "tray_view.js" as "text/javascript; charset=utf-8",
    "views.css" as "text/css; charset=utf-8",
];

/// The file of this name.
pub(crate) fn asset(name: &str) -> Option<&'static Asset> {
    ASSETS.iter().find(|asset| asset.name == name)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;

    #[test]
    fn every_file_of_the_page_is_served_as_what_it_is() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("page");
        let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let served: BTreeSet<String> = ASSETS.iter().map(|asset| asset.name.to_owned()).collect();
        assert_eq!(files.collect::<BTreeSet<_>>(), served);
        for Asset { name, content_type, .. } in ASSETS {
            let expected = match name.rsplit_once('.').unwrap().1 {
                "html" => "text/html; charset=utf-8",
                "js" => "text/javascript; charset=utf-8",
                "css" => "text/css; charset=utf-8",
                "svg" => "image/svg+xml",
                other => panic!("{name}: a file of a kind that is not served, {other}"),
            };
            assert_eq!(*content_type, expected, "{name}");
        }
    }
}
