"""What every peer on Eclipse Cyclone DDS needs to talk as ROS 2 does: common types, policies, and clients of services."""

import sys
import time
import uuid
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

# ROS 2 writes plain CDR (XCDR1), and so does every peer of it.
PLAIN_CDR = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10), PLAIN_CDR)
RELIABLE = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10), PLAIN_CDR)
LATCHED = Qos(
    Policy.Reliability.Reliable(duration(milliseconds=100)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
    PLAIN_CDR,
)


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0

    def nanoseconds(self):
        return self.sec * 1_000_000_000 + self.nanosec


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


class Peer:
    """A participant that collects what its topics bring until a deadline; all of it gives up then."""

    def __init__(self, domain, seconds):
        self.participant = DomainParticipant(domain)
        self.deadline = time.monotonic() + seconds
        self.collected = {}

    def collect(self, topic, kind, qos):
        """The list to which everything goes that a topic brings from now on."""
        reader = DataReader(self.participant, Topic(self.participant, f"rt{topic}", kind), qos=qos)
        return self.collected.setdefault(reader, [])

    def wait_until(self, what, holds):
        """Receives on all topics until `holds` is true."""
        while not holds():
            if time.monotonic() > self.deadline:
                sys.exit(f"waited in vain for {what}; {self.progress()}")
            for reader, collected in self.collected.items():
                collected.extend(s for s in reader.take(N=100) if s.sample_info.valid_data)
            time.sleep(0.002)

    def progress(self):
        """How far it has come, for people to read."""
        received = {reader.topic.name: len(collected) for reader, collected in self.collected.items()}
        return f"received so far: {received}"


class Service:
    """A client of one service: its endpoints stay open, as an answer may take long.

    Requests and replies begin with the client's id and a sequence number: the wire form of rmw_cyclonedds.
    """

    def __init__(self, peer, name, request_kind, response_kind):
        self.peer, self.name, self.request_kind = peer, name, request_kind
        participant = peer.participant
        self.writer = DataWriter(participant, Topic(participant, f"rq{name}Request", request_kind), qos=RELIABLE)
        self.reader = DataReader(participant, Topic(participant, f"rr{name}Reply", response_kind), qos=RELIABLE)
        self.client = uuid.uuid4().int & (2**63 - 1)
        self.sent, self.answers = 0, {}

    def ask(self, *fields):
        """Sends a request once both topics are connected; the answer comes with `answer`."""
        ends = (self.writer.get_matched_subscriptions, self.reader.get_matched_publications)
        self.peer.wait_until(self.name, lambda: all(matched() for matched in ends))
        self.sent += 1
        self.writer.write(self.request_kind(self.client, self.sent, *fields))
        return self.sent

    def answer(self, number):
        def answered():
            for reply in self.reader.take(N=100):
                if getattr(reply, "client", None) == self.client:
                    self.answers[reply.number] = reply
            return number in self.answers

        self.peer.wait_until(f"an answer of {self.name}", answered)
        return self.answers.pop(number)

    def call(self, *fields):
        return self.answer(self.ask(*fields))
