//! The macro by which topics and services are stated: one entry makes the constant, its documentation and its line in
//! the interface page.

/// Names of the nodes, which are those of their crates.
pub mod nodes {
    /// Turns feeding on and off and owns the waveform.
    pub const WAVEFORM_GENERATOR: &str = "waveform_generator";
    /// Moves the courier.
    pub const COURIER_DRIVER: &str = "courier_driver";
    /// Stands for the parts and the camera.
    pub const PART_SIMULATOR: &str = "part_simulator";
    /// Finds parts that lie right.
    pub const VISION_SELECTOR: &str = "vision_selector";
    /// Plans deliveries.
    pub const DELIVERY_PLANNER: &str = "delivery_planner";
    /// Picks parts at a station.
    pub const OVERHEAD_MANIPULATOR: &str = "overhead_manipulator";
    /// Leases areas of a shared platen.
    pub const PLATEN_ARBITER: &str = "platen_arbiter";
    /// Scores a run by ground truth.
    pub const RUN_MONITOR: &str = "run_monitor";
}

/// Where names lie.
pub(crate) mod namespaces {
    use feeder_model::area::PLATEN_NAMESPACE;
    use minifactory_msgs::interface::Namespace;

    pub(crate) const FEEDER: Namespace = Namespace::Own("/<feeder>");
    pub(crate) const STATION: Namespace = Namespace::Own("/<station>");
    pub(crate) const PLATEN: Namespace = Namespace::Fixed(PLATEN_NAMESPACE);
    pub(crate) const GLOBAL: Namespace = Namespace::Fixed("");
}

/// States constants, each with its documentation, its type, where it lies, who is at its ends and who uses it, and a
/// function that lists them all. The documentation is also the meaning that the interface page shows.
macro_rules! interface {
    ($(#[$list_doc:meta])* $list:ident; $(
        #[doc = $meaning:literal]
        $name:ident: $spec:ty = $new:expr, $owners:expr => $users:expr;
    )+) => {
        $(
            #[doc = $meaning]
            pub const $name: $spec = $new.between(&$owners, &$users, $meaning.trim_ascii());
        )+

        $(#[$list_doc])*
        #[must_use]
        pub fn $list() -> Vec<minifactory_msgs::interface::Entry> {
            vec![$($name.entry()),+]
        }
    };
}
pub(crate) use interface;
