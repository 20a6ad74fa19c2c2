"""Reads what the feeder publishes and calls its services through Eclipse Cyclone DDS with default settings.

Prints one JSON object with what it has seen; whether that is right is for the caller to judge. Only what it
cannot go on without makes it fail: messages that stay away until the deadline.
"""

import argparse
import json
import sys
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int64, sequence, uint8, uint32, uint64

from ros import BEST_EFFORT, RELIABLE, Header, Peer, Service


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


def stamps(messages):
    return [message.header.stamp.nanoseconds() for message in messages]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain", type=int, required=True)
    parser.add_argument("--images", type=int, required=True, help="compressed images to receive")
    parser.add_argument("--load", type=int, required=True, help="parts to load on the way")
    parser.add_argument("--seconds", type=float, required=True, help="give up after so long")
    options = parser.parse_args()
    peer = Peer(options.domain, options.seconds)
    joint_states = peer.collect("/feeder/joint_states", JointState, RELIABLE)
    images = peer.collect("/feeder/camera/image_raw/compressed", CompressedImage, RELIABLE)
    parts = peer.collect("/feeder/parts", PartStates, BEST_EFFORT)
    set_feeding = Service(peer, "/feeder/set_feeding", SetBoolRequest, SetBoolResponse)
    load_parts = Service(peer, "/feeder/load_parts", LoadPartsRequest, LoadPartsResponse)

    peer.wait_until("all topics", lambda: joint_states and images and parts)
    parts_before = len(parts[-1].parts)
    feeding = set_feeding.call(True)
    loaded = load_parts.call(options.load)
    if loaded.loaded > 0:
        peer.wait_until("the loaded parts", lambda: len(parts[-1].parts) > parts_before)
    peer.wait_until("images", lambda: len(images) >= options.images)

    files = [bytes(image.data) for image in images]
    states = [part for message in parts for part in message.parts]
    report = {
        "joint_state_stamps_ns": stamps(joint_states),
        "joint_names": sorted({tuple(message.name) for message in joint_states}),
        "joint_positions": [list(message.position) for message in joint_states],
        "image_stamps_ns": stamps(images),
        "image_formats": sorted({image.format for image in images}),
        "image_frames": sorted({image.header.frame_id for image in images}),
        "image_sizes_px": sorted({tuple(jpeg_size(file) or ()) for file in files}),
        "image_bytes_max": max(len(file) for file in files),
        "part_frames": sorted({message.header.frame_id for message in parts}),
        "part_counts": [len(message.parts) for message in parts],
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
