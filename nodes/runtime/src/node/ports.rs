//! Ports: what a node publishes, hears, serves and calls, declared once and used by typed handles.

use std::marker::PhantomData;

pub use minifactory_msgs::interface::Latency;
use minifactory_msgs::interface::{Facts, Qos, ServiceSpec, TopicSpec};
use minifactory_msgs::{Message, Service};

/// What a port does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortKind {
    /// Publishes a topic.
    Publish,
    /// Hears a topic.
    Subscribe(Latency),
    /// Serves a service.
    Serve,
    /// Calls a service.
    Call(Latency),
}

/// A declared port.
#[derive(Clone, Debug, PartialEq)]
pub struct Port {
    /// What it does.
    pub kind: PortKind,
    /// Absolute name of the topic or service.
    pub name: String,
    /// Its ROS type, `package/msg/Name`.
    pub ros_type: String,
    /// DDS type names: of the message, or of request and response.
    pub dds_types: Vec<String>,
    /// Quality of service towards the rest of the graph.
    pub qos: Qos,
}

/// All ports of a node, in the order of their handles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Interface {
    /// The ports.
    pub ports: Vec<Port>,
}

impl Interface {
    /// Whether the node publishes `topic`.
    #[must_use]
    pub fn publishes(&self, topic: &str) -> bool {
        self.ports.iter().any(|port| port.kind == PortKind::Publish && port.name == topic)
    }
}

macro_rules! handle {
    ($(#[$doc:meta])* $name:ident<$param:ident: $bound:ident>) => {
        $(#[$doc])*
        pub struct $name<$param: $bound> {
            pub(super) port: usize,
            of: PhantomData<fn() -> $param>,
        }
        impl<$param: $bound> Clone for $name<$param> {
            fn clone(&self) -> Self { *self }
        }
        impl<$param: $bound> Copy for $name<$param> {}
        impl<$param: $bound> std::fmt::Debug for $name<$param> {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.debug_tuple(stringify!($name)).field(&self.port).finish()
            }
        }
    };
}

handle!(
    /// Publishes messages of type `M`.
    Publisher<M: Message>
);
handle!(
    /// Hears messages of type `M`.
    Subscriber<M: Message>
);
handle!(
    /// Answers requests to a service of type `S`.
    Server<S: Service>
);
handle!(
    /// Calls a service of type `S`.
    Client<S: Service>
);

/// A node has an end of something that does not name the node at that end.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{node} {does} {name}, which is not stated for it: stated are {stated}")]
pub struct NotStated {
    /// Name of the node, without its namespace.
    pub node: String,
    /// What it does with it.
    pub does: &'static str,
    /// Absolute name of the topic or service.
    pub name: String,
    /// Who is stated at this end.
    pub stated: String,
}

/// Where a node declares its ports, each by the constant that states it. What lies in the namespace of its owner lies in
/// this node's, or in the one that is given where a node deals with another namespace.
#[derive(Debug)]
pub struct Declare {
    node: String,
    namespace: String,
    interface: Interface,
    /// The first port that is not stated for this node.
    not_stated: Option<NotStated>,
}

impl Declare {
    /// For the node called `node` in `namespace`, such as `/feeder`.
    #[must_use]
    pub fn new(node: &str, namespace: &str) -> Self {
        Self {
            node: node.to_owned(),
            namespace: namespace.trim_end_matches('/').to_owned(),
            interface: Interface::default(),
            not_stated: None,
        }
    }

    /// The namespace of the node, with a leading slash and none at the end.
    #[must_use]
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// The finished interface.
    ///
    /// # Errors
    /// When a port is not stated for this node.
    pub fn finish(self) -> Result<Interface, NotStated> {
        self.not_stated.map_or(Ok(self.interface), Err)
    }

    /// Declares a published topic.
    pub fn publisher<M: Message>(&mut self, topic: &TopicSpec<M>) -> Publisher<M> {
        self.publisher_in(&self.namespace.clone(), topic)
    }

    /// Declares a topic that is published in `namespace`.
    pub fn publisher_in<M: Message>(&mut self, namespace: &str, topic: &TopicSpec<M>) -> Publisher<M> {
        let name = self.owned(namespace, topic.facts(), "publishes");
        self.publisher_named(name, topic.qos())
    }

    /// Declares a subscription.
    pub fn subscriber<M: Message>(&mut self, topic: &TopicSpec<M>) -> Subscriber<M> {
        self.subscriber_in(&self.namespace.clone(), topic)
    }

    /// Declares a subscription to what is published in `namespace`.
    pub fn subscriber_in<M: Message>(&mut self, namespace: &str, topic: &TopicSpec<M>) -> Subscriber<M> {
        let (name, latency) = self.used(namespace, topic.facts(), "hears");
        self.subscriber_named(name, latency, topic.qos())
    }

    /// Declares a service.
    pub fn server<S: Service>(&mut self, service: &ServiceSpec<S>) -> Server<S> {
        self.server_in(&self.namespace.clone(), service)
    }

    /// Declares a service in `namespace`.
    pub fn server_in<S: Service>(&mut self, namespace: &str, service: &ServiceSpec<S>) -> Server<S> {
        let name = self.owned(namespace, service.facts(), "serves");
        self.server_named(name)
    }

    /// Declares the use of another node's service.
    pub fn client<S: Service>(&mut self, service: &ServiceSpec<S>) -> Client<S> {
        self.client_in(&self.namespace.clone(), service)
    }

    /// Declares the use of a service in `namespace`.
    pub fn client_in<S: Service>(&mut self, namespace: &str, service: &ServiceSpec<S>) -> Client<S> {
        let (name, latency) = self.used(namespace, service.facts(), "calls");
        self.client_named(name, latency)
    }

    pub(super) fn publisher_named<M: Message>(&mut self, name: String, qos: Qos) -> Publisher<M> {
        let port = self.message::<M>(PortKind::Publish, name, qos);
        Publisher { port, of: PhantomData }
    }

    pub(super) fn subscriber_named<M: Message>(&mut self, name: String, latency: Latency, qos: Qos) -> Subscriber<M> {
        let port = self.message::<M>(PortKind::Subscribe(latency), name, qos);
        Subscriber { port, of: PhantomData }
    }

    pub(super) fn server_named<S: Service>(&mut self, name: String) -> Server<S> {
        let port = self.service::<S>(PortKind::Serve, name);
        Server { port, of: PhantomData }
    }

    pub(super) fn client_named<S: Service>(&mut self, name: String, latency: Latency) -> Client<S> {
        let port = self.service::<S>(PortKind::Call(latency), name);
        Client { port, of: PhantomData }
    }

    /// The name of what this node publishes or serves.
    pub(super) fn owned(&mut self, namespace: &str, facts: &Facts, does: &'static str) -> String {
        let name = facts.name_in(namespace);
        if !facts.is_owned_by(&self.node) {
            self.note(does, &name, facts.owners().join(", "));
        }
        name
    }

    /// The name of what this node hears or calls, and how late that may be.
    pub(super) fn used(&mut self, namespace: &str, facts: &Facts, does: &'static str) -> (String, Latency) {
        let name = facts.name_in(namespace);
        let latency = facts.latency_of(&self.node).unwrap_or_else(|| {
            self.note(does, &name, facts.users().iter().map(ToString::to_string).collect::<Vec<_>>().join(", "));
            Latency::Forward
        });
        (name, latency)
    }

    fn note(&mut self, does: &'static str, name: &str, stated: String) {
        let node = self.node.clone();
        self.not_stated.get_or_insert(NotStated { node, does, name: name.to_owned(), stated });
    }

    fn message<M: Message>(&mut self, kind: PortKind, name: String, qos: Qos) -> usize {
        self.port(kind, name, M::INFO.ros_type(), vec![M::INFO.dds_type()], qos)
    }

    fn service<S: Service>(&mut self, kind: PortKind, name: String) -> usize {
        let dds_types = vec![S::Request::INFO.dds_type(), S::Response::INFO.dds_type()];
        self.port(kind, name, S::INFO.ros_type(), dds_types, Qos::service())
    }

    fn port(&mut self, kind: PortKind, name: String, ros_type: String, dds_types: Vec<String>, qos: Qos) -> usize {
        self.interface.ports.push(Port { kind, name, ros_type, dds_types, qos });
        self.interface.ports.len() - 1
    }
}

#[cfg(test)]
mod tests {
    use minifactory_msgs::geometry_msgs::msg::Point;
    use minifactory_msgs::interface::{Namespace, User};
    use minifactory_msgs::std_srvs::srv::Trigger;

    use super::*;

    const PLACE: TopicSpec<Point> = TopicSpec::new(Namespace::Own("/<house>"), "place", Qos::latched()).between(
        &["mover"],
        &[User::Forward("viewer"), User::Feedback("planner")],
        "",
    );
    const STOP: ServiceSpec<Trigger> = ServiceSpec::new(Namespace::Fixed("/street"), "stop").between(
        &["mover"],
        &[User::Feedback("planner"), User::Outside("people")],
        "",
    );

    #[test]
    fn a_constant_says_name_latency_and_quality() {
        let mut io = Declare::new("planner", "/barn/");
        io.subscriber(&PLACE);
        io.subscriber_in("/stable", &PLACE);
        io.client_in("/stable", &STOP);
        let ports = io.finish().unwrap().ports;
        let names: Vec<_> = ports.iter().map(|port| (port.name.as_str(), port.kind, port.qos)).collect();
        let heard = PortKind::Subscribe(Latency::Feedback);
        let expected = [
            ("/barn/place", heard, Qos::latched()),
            ("/stable/place", heard, Qos::latched()),
            ("/street/stop", PortKind::Call(Latency::Feedback), Qos::service()),
        ];
        assert_eq!(names, expected);
    }

    #[test]
    fn a_node_that_is_not_stated_at_its_end_is_refused_by_name() {
        let refused = |declare: fn(&mut Declare)| {
            let mut io = Declare::new("stranger", "/barn");
            declare(&mut io);
            io.finish().unwrap_err().to_string()
        };
        let not_stated = "which is not stated for it: stated are";
        let said = [
            refused(|io| _ = io.publisher(&PLACE)),
            refused(|io| _ = io.subscriber(&PLACE)),
            refused(|io| _ = io.server(&STOP)),
            refused(|io| _ = io.client(&STOP)),
        ];
        let expected = [
            format!("stranger publishes /barn/place, {not_stated} mover"),
            format!("stranger hears /barn/place, {not_stated} viewer, planner (feedback)"),
            format!("stranger serves /street/stop, {not_stated} mover"),
            format!("stranger calls /street/stop, {not_stated} planner (feedback), people"),
        ];
        assert_eq!(said, expected);
    }
}
