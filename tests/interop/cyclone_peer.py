"""A peer that talks to the feeder through Eclipse Cyclone DDS, as rmw_cyclonedds does.

Topics carry std_msgs/msg/String; services are example_interfaces/srv/AddTwoInts in Cyclone's wire
form, which puts a client's id and a sequence number before request and reply. Needs the package
`cyclonedds`; Cyclone runs with its default configuration unless CYCLONEDDS_URI says otherwise.

Every command prints one line per thing it has seen and fails when it has not seen enough in time.
"""

import argparse
import sys
import time
from dataclasses import dataclass

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import InstanceState, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, int64, sequence, uint8, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common::msg::dds_::Gid_"):
    data: array[uint8, 16]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


@dataclass
class Request(IdlStruct, typename="example_interfaces::srv::dds_::AddTwoInts_Request_"):
    client: uint64
    number: int64
    a: int64
    b: int64


@dataclass
class Response(IdlStruct, typename="example_interfaces::srv::dds_::AddTwoInts_Response_"):
    client: uint64
    number: int64
    sum: int64


RELIABLE = Policy.Reliability.Reliable(duration(milliseconds=100))
# ROS 2 writes plain CDR (XCDR1), and so does every peer of it.
PLAIN_CDR = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)


def qos(*policies):
    return Qos(RELIABLE, Policy.History.KeepLast(10), PLAIN_CDR, *policies)


LATCHED = qos(Policy.Durability.TransientLocal)


def samples(reader, deadline):
    """Yields what a reader gets until the deadline."""
    while time.monotonic() < deadline:
        for sample in reader.take(N=100):
            if sample.sample_info.valid_data:
                yield sample
        time.sleep(0.002)


def subscribe(participant, options, deadline):
    topic = Topic(participant, "rt" + options.topic, String)
    reader = DataReader(participant, topic, qos=LATCHED if options.latched else qos())
    for seen, sample in enumerate(samples(reader, deadline), start=1):
        print(f"received {sample.data}", flush=True)
        if seen == options.count:
            return True
    return False


def publish(participant, options, deadline):
    topic = Topic(participant, "rt" + options.topic, String)
    writer = DataWriter(participant, topic, qos=qos())
    while not writer.get_matched_subscriptions():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    for number in range(options.count):
        writer.write(String(f"{number}"))
        print(f"sent {number}", flush=True)
        # A writer that keeps the last ten loses what it overwrites.
        time.sleep(0.002)
    return writer.wait_for_acks(duration(seconds=5))


def nodes(participant, options, deadline):
    topic = Topic(participant, "ros_discovery_info", ParticipantEntitiesInfo)
    for sample in samples(DataReader(participant, topic, qos=LATCHED), deadline):
        for node in sample.node_entities_info_seq:
            name = f"{node.node_namespace.rstrip('/')}/{node.node_name}"
            print(f"node {name} readers {len(node.reader_gid_seq)} writers {len(node.writer_gid_seq)}", flush=True)
            if name == options.node:
                return True
    return False


def topics(participant, options, deadline):
    reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    for sample in samples(reader, deadline):
        if sample.topic_name.startswith("rt/"):
            print(f"topic {sample.topic_name[2:]} type {sample.type_name}", flush=True)
        if sample.topic_name == "rt" + options.topic:
            return True
    return False


def leave(participant, options, deadline):
    """Waits until so many endpoints of others are there, and then until none is left."""
    kinds = (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription)
    readers = [BuiltinDataReader(participant, kind) for kind in kinds]
    there, came = set(), False
    while time.monotonic() < deadline:
        for sample in (sample for reader in readers for sample in reader.take(N=1000)):
            if sample.sample_info.instance_state != InstanceState.Alive:
                there.discard(sample.key)
            elif sample.participant_key != participant.guid:
                there.add(sample.key)
        if not came and len(there) >= options.count:
            came = True
            print(f"there {len(there)}", flush=True)
        if came and not there:
            print("gone", flush=True)
            return True
        time.sleep(0.002)
    print(f"left {len(there)}", flush=True)
    return False


def service_ends(participant, service, wrote, read):
    request = Topic(participant, f"rq{service}Request", Request)
    reply = Topic(participant, f"rr{service}Reply", Response)
    ends = {Request: request, Response: reply}
    return DataWriter(participant, ends[wrote], qos=qos()), DataReader(participant, ends[read], qos=qos())


def call(participant, options, deadline):
    writer, reader = service_ends(participant, options.service, Request, Response)
    while not (writer.get_matched_subscriptions() and reader.get_matched_publications()):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    client = 0x0123456789ABCDEF
    for number in range(options.count):
        began = time.monotonic()
        writer.write(Request(client, number, number, 40))
        reply = next((s for s in samples(reader, deadline) if (s.client, s.number) == (client, number)), None)
        if reply is None or reply.sum != number + 40:
            return False
        print(f"reply {reply.sum} after {(time.monotonic() - began) * 1e3:.0f} ms", flush=True)
    return True


def serve(participant, options, deadline):
    writer, reader = service_ends(participant, options.service, Response, Request)
    print("serving", flush=True)
    for seen, request in enumerate(samples(reader, deadline), start=1):
        writer.write(Response(request.client, request.number, request.a + request.b))
        print(f"answered {request.number}", flush=True)
        if seen == options.count:
            writer.wait_for_acks(duration(seconds=5))
            # The client is to have its answer before this end leaves.
            time.sleep(0.5)
            return True
    return False


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain", type=int, required=True)
    parser.add_argument("--seconds", type=float, default=20.0, help="give up after so long")
    commands = parser.add_subparsers(dest="command", required=True)
    for function, arguments in (
        (subscribe, ("topic", "count", "latched")),
        (publish, ("topic", "count")),
        (nodes, ("node",)),
        (topics, ("topic",)),
        (leave, ("count",)),
        (call, ("service", "count")),
        (serve, ("service", "count")),
    ):
        command = commands.add_parser(function.__name__)
        command.set_defaults(function=function)
        for argument in arguments:
            if argument == "latched":
                command.add_argument("--latched", action="store_true")
            else:
                command.add_argument(f"--{argument}", type=int if argument == "count" else str, required=True)
    options = parser.parse_args()
    participant = DomainParticipant(options.domain)
    seen = options.function(participant, options, time.monotonic() + options.seconds)
    return 0 if seen else 1


if __name__ == "__main__":
    sys.exit(main())
