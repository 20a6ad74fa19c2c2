//! What a node's interface is made of: topics, services and actions as typed constants, and how their samples travel.
//!
//! A name, its type, its quality of service, who is at which end and how late what they hear may be are stated once, in
//! a constant that both ends use. So a type cannot differ between the two ends, and neither can a quality of service.
//!
//! ```
//! use minifactory_msgs::interface::{Namespace, Qos, TopicSpec, User};
//! use minifactory_msgs::std_msgs::msg::Bool;
//!
//! const DOOR: TopicSpec<Bool> = TopicSpec::new(Namespace::Own("/<house>"), "door_open", Qos::latched())
//!     .between(&["porter"], &[User::Feedback("heating")], "Whether the door is open");
//! assert_eq!(DOOR.name_in("/cottage"), "/cottage/door_open");
//! assert_eq!(DOOR.entry().name, "/<house>/door_open");
//! ```

use std::fmt;
use std::marker::PhantomData;

use crate::{Action, Message, Service, TypeInfo};

mod qos;
pub mod simulation;
pub mod standard;

pub use qos::{Durability, Qos, QosMismatch, Reliability};

/// How late an input may be. An edge between two nodes is as late as the latest thing it carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Latency {
    /// Downstream, from cause to effect: the next tick.
    Forward,
    /// Back upstream, from what was seen to what is done about it. The delay stands for the latency that such a path
    /// has in a real cell, and it lets the nodes of the loop run ahead of each other.
    Feedback,
}

/// Stands for any node, where a table says who is at an end of something.
pub const EVERY_NODE: &str = "every node";

/// Who hears a topic, or calls a service or an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum User {
    /// A node, downstream of what it hears.
    Forward(&'static str),
    /// A node, upstream of what it hears.
    Feedback(&'static str),
    /// Who is no node of the suite, in words, such as `viewers`.
    Outside(&'static str),
}

impl User {
    /// How late what `node` hears may be, if this is that node.
    fn latency_of(self, node: &str) -> Option<Latency> {
        let (name, latency) = match self {
            Self::Forward(name) => (name, Latency::Forward),
            Self::Feedback(name) => (name, Latency::Feedback),
            Self::Outside(_) => return None,
        };
        (name == node || name == EVERY_NODE).then_some(latency)
    }
}

impl fmt::Display for User {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Forward(name) | Self::Outside(name) => f.write_str(name),
            Self::Feedback(name) => write!(f, "{name} (feedback)"),
        }
    }
}

/// Where a name lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Namespace {
    /// In the namespace of the node that publishes or serves it; the text, such as `/<feeder>`, stands for it in tables.
    Own(&'static str),
    /// In this one, such as `/platen`, whoever uses it; empty: in none.
    Fixed(&'static str),
}

/// What tables say of a topic, service or action beside its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Facts {
    namespace: Namespace,
    name: &'static str,
    owners: &'static [&'static str],
    users: &'static [User],
    meaning: &'static str,
}

impl Facts {
    const fn new(namespace: Namespace, name: &'static str) -> Self {
        Self { namespace, name, owners: &[], users: &[], meaning: "" }
    }

    /// The absolute name, for an owner in `namespace`, such as `/feeder`.
    #[must_use]
    pub fn name_in(&self, namespace: &str) -> String {
        let namespace = match self.namespace {
            Namespace::Own(_) => namespace.trim_end_matches('/'),
            Namespace::Fixed(fixed) => fixed,
        };
        format!("{namespace}/{}", self.name)
    }

    /// The nodes that publish or serve it.
    #[must_use]
    pub fn owners(&self) -> &'static [&'static str] {
        self.owners
    }

    /// Who hears or calls it.
    #[must_use]
    pub fn users(&self) -> &'static [User] {
        self.users
    }

    /// What it is, in a line.
    #[must_use]
    pub fn meaning(&self) -> &'static str {
        self.meaning
    }

    /// Whether `node` publishes or serves it.
    #[must_use]
    pub fn is_owned_by(&self, node: &str) -> bool {
        self.owners.iter().any(|owner| *owner == node || *owner == EVERY_NODE)
    }

    /// How late what `node` hears or calls may be; nothing for a node that is not named as a user.
    #[must_use]
    pub fn latency_of(&self, node: &str) -> Option<Latency> {
        self.users.iter().find_map(|user| user.latency_of(node))
    }

    fn entry(&self, kind: EntryKind, info: &TypeInfo, qos: Option<Qos>) -> Entry {
        let shown = match self.namespace {
            Namespace::Own(shown) | Namespace::Fixed(shown) => shown,
        };
        Entry { kind, name: format!("{shown}/{}", self.name), ros_type: info.ros_type(), qos, facts: *self }
    }
}

/// What an entry of a table is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EntryKind {
    /// A topic.
    Topic,
    /// A service.
    Service,
    /// An action.
    Action,
}

/// A line of a table of interfaces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// What it is.
    pub kind: EntryKind,
    /// Its name, with a placeholder for the namespace.
    pub name: String,
    /// Its ROS type, `package/msg/Name`.
    pub ros_type: String,
    /// Quality of service, of a topic.
    pub qos: Option<Qos>,
    /// All else.
    pub facts: Facts,
}

/// Makes the type of a constant, its constructors but `new`, and what tables show of it.
macro_rules! spec {
    ($(#[$doc:meta])* $spec:ident<$param:ident: $bound:ident> $(, $qos:ident)?) => {
        $(#[$doc])*
        pub struct $spec<$param: $bound> {
            facts: Facts,
            $($qos: Qos,)?
            of: PhantomData<fn() -> $param>,
        }

        impl<$param: $bound> Clone for $spec<$param> {
            fn clone(&self) -> Self { *self }
        }

        impl<$param: $bound> Copy for $spec<$param> {}

        impl<$param: $bound> fmt::Debug for $spec<$param> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.debug_tuple(stringify!($spec)).field(&self.facts).finish()
            }
        }

        impl<$param: $bound> $spec<$param> {
            /// The same between these nodes: those that publish or serve it, and those that hear or call it, with what it
            /// means in a line.
            #[must_use]
            pub const fn between(
                self,
                owners: &'static [&'static str],
                users: &'static [User],
                meaning: &'static str,
            ) -> Self {
                Self { facts: Facts { owners, users, meaning, ..self.facts }, ..self }
            }

            /// Names, ends and meaning.
            #[must_use]
            pub const fn facts(&self) -> &Facts {
                &self.facts
            }

            /// The absolute name, for an owner in `namespace`, such as `/feeder`.
            #[must_use]
            pub fn name_in(&self, namespace: &str) -> String {
                self.facts.name_in(namespace)
            }
        }
    };
}

spec!(
    /// A topic that carries messages of type `M`.
    TopicSpec<M: Message>, qos
);
spec!(
    /// A service of type `S`.
    ServiceSpec<S: Service>
);
spec!(
    /// An action of type `A`.
    ActionSpec<A: Action>
);

impl<M: Message> TopicSpec<M> {
    /// A topic without ends yet.
    #[must_use]
    pub const fn new(namespace: Namespace, name: &'static str, qos: Qos) -> Self {
        Self { facts: Facts::new(namespace, name), qos, of: PhantomData }
    }

    /// Quality of service, at either end.
    #[must_use]
    pub const fn qos(&self) -> Qos {
        self.qos
    }

    /// Name of the type as ROS 2 gives it to DDS.
    #[must_use]
    pub fn dds_type(&self) -> String {
        M::INFO.dds_type()
    }

    /// Its line in a table.
    #[must_use]
    pub fn entry(&self) -> Entry {
        self.facts.entry(EntryKind::Topic, &M::INFO, Some(self.qos))
    }
}

impl<S: Service> ServiceSpec<S> {
    /// A service without ends yet.
    #[must_use]
    pub const fn new(namespace: Namespace, name: &'static str) -> Self {
        Self { facts: Facts::new(namespace, name), of: PhantomData }
    }

    /// Its line in a table.
    #[must_use]
    pub fn entry(&self) -> Entry {
        self.facts.entry(EntryKind::Service, &S::INFO, None)
    }
}

impl<A: Action> ActionSpec<A> {
    /// An action without ends yet.
    #[must_use]
    pub const fn new(namespace: Namespace, name: &'static str) -> Self {
        Self { facts: Facts::new(namespace, name), of: PhantomData }
    }

    /// Its line in a table.
    #[must_use]
    pub fn entry(&self) -> Entry {
        self.facts.entry(EntryKind::Action, &A::INFO, None)
    }
}
