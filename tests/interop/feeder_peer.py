"""Reads what the feeder publishes and calls its services through Eclipse Cyclone DDS with default settings.

Prints one JSON object with what it has seen; whether that is right is for the caller to judge. Only what it
cannot go on without makes it fail: messages that stay away until the deadline.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, int64, sequence, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32

    def nanoseconds(self):
        return self.sec * 1_000_000_000 + self.nanosec


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class CompressedImage(IdlStruct, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class PartState(IdlStruct, typename="minifactory_msgs::msg::dds_::PartState_"):
    id: uint32
    part_class: str
    surface: uint8
    resting_pose: uint8
    radius_m: float64
    angle_rad: float64
    yaw_rad: float64
    radial_velocity_m_s: float64
    tangential_velocity_m_s: float64
    sticking: bool
    stranded: bool


@dataclass
class PartStates(IdlStruct, typename="minifactory_msgs::msg::dds_::PartStates_"):
    header: Header
    parts: sequence[PartState]
    fed: uint32
    recirculated: uint32
    picked: uint32
    jams: uint32


# Requests and replies begin with the client's id and a sequence number: the wire form of rmw_cyclonedds.


@dataclass
class LoadPartsRequest(IdlStruct, typename="minifactory_msgs::srv::dds_::LoadParts_Request_"):
    client: uint64
    number: int64
    count: uint32


@dataclass
class LoadPartsResponse(IdlStruct, typename="minifactory_msgs::srv::dds_::LoadParts_Response_"):
    client: uint64
    number: int64
    loaded: uint32
    message: str


@dataclass
class SetBoolRequest(IdlStruct, typename="std_srvs::srv::dds_::SetBool_Request_"):
    client: uint64
    number: int64
    data: bool


@dataclass
class SetBoolResponse(IdlStruct, typename="std_srvs::srv::dds_::SetBool_Response_"):
    client: uint64
    number: int64
    success: bool
    message: str


# ROS 2 writes plain CDR (XCDR1), and so does every peer of it.
PLAIN_CDR = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10), PLAIN_CDR)
RELIABLE = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10), PLAIN_CDR)
CLIENT = 0x0123456789ABCDEF


def jpeg_size(data):
    """Width and height from the frame header of a whole JPEG file, or nothing."""
    if data[:2] != b"\xff\xd8" or data[-2:] != b"\xff\xd9":
        return None
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        # Start of frame: 0xC0 to 0xCF but for the Huffman tables, JPG and arithmetic coding tables.
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return [int.from_bytes(data[at + 7 : at + 9], "big"), int.from_bytes(data[at + 5 : at + 7], "big")]
        at += 2 + length
    return None


class Peer:
    def __init__(self, options):
        self.participant = DomainParticipant(options.domain)
        self.deadline = time.monotonic() + options.seconds
        joint_states = self.reader("/feeder/joint_states", JointState, RELIABLE)
        images = self.reader("/feeder/camera/image_raw/compressed", CompressedImage, RELIABLE)
        parts = self.reader("/feeder/parts", PartStates, BEST_EFFORT)
        self.seen = {joint_states: [], images: [], parts: []}
        self.joint_states, self.images, self.parts = self.seen.values()

    def reader(self, topic, kind, qos):
        return DataReader(self.participant, Topic(self.participant, "rt" + topic, kind), qos=qos)

    def wait_until(self, what, holds):
        """Receives on all topics until `holds` is true."""
        while not holds():
            if time.monotonic() > self.deadline:
                seen = f"{len(self.joint_states)} joint states, {len(self.images)} images, {len(self.parts)} part states"
                sys.exit(f"waited in vain for {what}; received so far: {seen}")
            for reader, seen in self.seen.items():
                seen.extend(s for s in reader.take(N=100) if s.sample_info.valid_data)
            time.sleep(0.002)

    def call(self, service, request, response_kind):
        """Calls a service once both of its topics are connected and returns the answer."""
        topics = [
            Topic(self.participant, f"rq{service}Request", type(request)),
            Topic(self.participant, f"rr{service}Reply", response_kind),
        ]
        writer = DataWriter(self.participant, topics[0], qos=RELIABLE)
        reader = DataReader(self.participant, topics[1], qos=RELIABLE)
        ends = (writer.get_matched_subscriptions, reader.get_matched_publications)
        self.wait_until(service, lambda: all(matched() for matched in ends))
        writer.write(request)
        replies = []

        def answered():
            replies.extend(r for r in reader.take(N=100) if (r.client, r.number) == (request.client, request.number))
            return replies

        self.wait_until(f"an answer of {service}", answered)
        return replies[0]


def stamps(messages):
    return [message.header.stamp.nanoseconds() for message in messages]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain", type=int, required=True)
    parser.add_argument("--images", type=int, required=True, help="compressed images to receive")
    parser.add_argument("--load", type=int, required=True, help="parts to load on the way")
    parser.add_argument("--seconds", type=float, required=True, help="give up after so long")
    options = parser.parse_args()
    peer = Peer(options)

    peer.wait_until("all topics", lambda: all(peer.seen.values()))
    parts_before = len(peer.parts[-1].parts)
    feeding = peer.call("/feeder/set_feeding", SetBoolRequest(CLIENT, 1, True), SetBoolResponse)
    loaded = peer.call("/feeder/load_parts", LoadPartsRequest(CLIENT, 2, options.load), LoadPartsResponse)
    if loaded.loaded > 0:
        peer.wait_until("the loaded parts", lambda: len(peer.parts[-1].parts) > parts_before)
    peer.wait_until("images", lambda: len(peer.images) >= options.images)

    files = [bytes(image.data) for image in peer.images]
    states = [part for message in peer.parts for part in message.parts]
    report = {
        "joint_state_stamps_ns": stamps(peer.joint_states),
        "joint_names": sorted({tuple(message.name) for message in peer.joint_states}),
        "joint_positions": [list(message.position) for message in peer.joint_states],
        "image_stamps_ns": stamps(peer.images),
        "image_formats": sorted({image.format for image in peer.images}),
        "image_frames": sorted({image.header.frame_id for image in peer.images}),
        "image_sizes_px": sorted({tuple(jpeg_size(file) or ()) for file in files}),
        "image_bytes_max": max(len(file) for file in files),
        "part_frames": sorted({message.header.frame_id for message in peer.parts}),
        "part_counts": [len(message.parts) for message in peer.parts],
        "part_classes": sorted({part.part_class for part in states}),
        "part_surfaces": sorted({part.surface for part in states}),
        "part_poses": sorted({part.resting_pose for part in states}),
        "part_radius_m_min": min(part.radius_m for part in states),
        "part_radius_m_max": max(part.radius_m for part in states),
        "feeding": {"success": feeding.success, "message": feeding.message},
        "loaded": {"loaded": loaded.loaded, "message": loaded.message},
    }
    json.dump(report, sys.stdout)


if __name__ == "__main__":
    main()
