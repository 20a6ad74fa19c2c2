//! Between bags and the ROS graph: [`record`] fills a bag from a simulated run or from the graph, [`play`] gives it back.

pub mod play;
pub mod record;
