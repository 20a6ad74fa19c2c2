//! temporary
use feeder_core::scenario::Scenario;
use feeder_runtime::dds::Qos;
use feeder_runtime::node::*;
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use minifactory_msgs::sensor_msgs::msg::CompressedImage;
use minifactory_msgs::nav_msgs::msg::Odometry;
/// x
pub struct Ports{image: Subscriber<CompressedImage>, odometry: Subscriber<Odometry>, candidates: Publisher<Detection3DArray>}
/// x
pub struct VisionSelector{ports: Ports}
impl FeederNode for VisionSelector {
 const NAME: &'static str = "vision_selector"; type Config = Scenario; type Ports = Ports;
 fn namespaces(c: &Scenario) -> Vec<String> { vec![c.namespace()] }
 fn declare(io: &mut Declare, _: &Scenario) -> Ports { Ports {
            image: io.subscriber("camera/image_raw/compressed", Latency::Forward, Qos::command()),
            odometry: io.subscriber("odometry", Latency::Forward, Qos::command()),
            candidates: io.publisher("candidates", Qos::command()), } }
 fn open(ports: Ports, _: &Scenario) -> Result<Self, NodeError> { Ok(Self{ports}) }
 fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> { let n = io.take(&self.ports.odometry).len(); for i in io.take(&self.ports.image) { let _=n; let m = Detection3DArray{header: i.header, ..Default::default()}; io.publish(&self.ports.candidates, &m); } Ok(()) }
}
