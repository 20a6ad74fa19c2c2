"""Writes a bag with rosbags and one with mcap and mcap-ros2-support: in each, messages of two topics, a millisecond apart."""

import pathlib
import sys

import numpy
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

START_NS = 1_700_000_000_000_000_000
STEP_NS = 1_000_000


def with_rosbags(folder, count):
    store = get_typestore(Stores.ROS2_JAZZY)
    text, joints = store.types["std_msgs/msg/String"], store.types["sensor_msgs/msg/JointState"]
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        to_text = writer.add_connection("/text", text.__msgtype__, typestore=store)
        to_joints = writer.add_connection("/joints", joints.__msgtype__, typestore=store)
        for i in range(count):
            stamp = START_NS + i * STEP_NS
            writer.write(to_text, stamp, store.serialize_cdr(text(data=f"message {i}"), text.__msgtype__))
            state = joints(
                header=header(stamp=time(sec=i, nanosec=0), frame_id="platen"),
                name=["x"],
                position=numpy.array([float(i)]),
                velocity=numpy.array([]),
                effort=numpy.array([]),
            )
            writer.write(to_joints, stamp, store.serialize_cdr(state, joints.__msgtype__))


def with_mcap(file, count):
    with open(file, "wb") as stream, McapWriter(stream) as writer:
        text = writer.register_msgdef("std_msgs/msg/String", "string data\n")
        number = writer.register_msgdef("other_msgs/msg/Number", "float64 value_m\nuint8[3] digits\n")
        for i in range(count):
            stamp = START_NS + i * STEP_NS
            writer.write_message("/text", text, {"data": f"message {i}"}, stamp, stamp, i)
            writer.write_message("/number", number, {"value_m": 0.5 * i, "digits": [1, 2, 3]}, stamp, stamp, i)


if __name__ == "__main__":
    target = pathlib.Path(sys.argv[1])
    with_rosbags(target / "rosbags", int(sys.argv[2]))
    with_mcap(target / "foreign.mcap", int(sys.argv[2]))
