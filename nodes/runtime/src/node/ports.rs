//! Ports: what a node publishes, hears, serves and calls, declared once and used by typed handles.

use std::marker::PhantomData;

use minifactory_msgs::{Message, Service};

use crate::dds::Qos;

/// How late an input may be. An edge between two nodes is as late as the latest thing it carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Latency {
    /// Downstream, from cause to effect: the next tick.
    Forward,
    /// Back upstream, from what was seen to what is done about it. The delay stands for the latency that such a path
    /// has in a real cell, and it lets the nodes of the loop run ahead of each other.
    Feedback,
}

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

/// Where a node declares its ports. Relative names lie in the node's namespace.
#[derive(Debug)]
pub struct Declare {
    namespace: String,
    interface: Interface,
}

impl Declare {
    /// For a node in `namespace`, such as `/feeder`.
    #[must_use]
    pub fn new(namespace: &str) -> Self {
        Self { namespace: namespace.trim_end_matches('/').to_owned(), interface: Interface::default() }
    }

    /// The namespace of the node, with a leading slash and none at the end.
    #[must_use]
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// The finished interface.
    #[must_use]
    pub fn finish(self) -> Interface {
        self.interface
    }

    /// Declares a published topic.
    pub fn publisher<M: Message>(&mut self, name: &str, qos: Qos) -> Publisher<M> {
        let port = self.message::<M>(PortKind::Publish, name, qos);
        Publisher { port, of: PhantomData }
    }

    /// Declares a subscription.
    pub fn subscriber<M: Message>(&mut self, name: &str, latency: Latency, qos: Qos) -> Subscriber<M> {
        let port = self.message::<M>(PortKind::Subscribe(latency), name, qos);
        Subscriber { port, of: PhantomData }
    }

    /// Declares a service.
    pub fn server<S: Service>(&mut self, name: &str) -> Server<S> {
        let port = self.service::<S>(PortKind::Serve, name);
        Server { port, of: PhantomData }
    }

    /// Declares the use of another node's service.
    pub fn client<S: Service>(&mut self, name: &str, latency: Latency) -> Client<S> {
        let port = self.service::<S>(PortKind::Call(latency), name);
        Client { port, of: PhantomData }
    }

    fn message<M: Message>(&mut self, kind: PortKind, name: &str, qos: Qos) -> usize {
        self.port(kind, name, M::INFO.ros_type(), vec![M::INFO.dds_type()], qos)
    }

    fn service<S: Service>(&mut self, kind: PortKind, name: &str) -> usize {
        let dds_types = vec![S::Request::INFO.dds_type(), S::Response::INFO.dds_type()];
        self.port(kind, name, S::INFO.ros_type(), dds_types, Qos::service())
    }

    fn port(&mut self, kind: PortKind, name: &str, ros_type: String, dds_types: Vec<String>, qos: Qos) -> usize {
        let name = if name.starts_with('/') { name.to_owned() } else { format!("{}/{name}", self.namespace) };
        self.interface.ports.push(Port { kind, name, ros_type, dds_types, qos });
        self.interface.ports.len() - 1
    }
}
