"""Decodes every message of a bag with rosbags, mcap and mcap-ros2-support; prints how many each topic has, as JSON."""

import json
import pathlib
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader


def with_rosbags(folder):
    with AnyReader([folder]) as reader:
        counts = {connection.topic: 0 for connection in reader.connections}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            counts[connection.topic] += 1
        promised = {topic: info.msgcount for topic, info in reader.topics.items()}
        hashes = {connection.msgtype: connection.digest for connection in reader.connections}
        wrong = [name for name, digest in hashes.items() if reader.typestore.hash_rihs01(name) != digest]
    assert counts == promised, (counts, promised)
    assert not wrong, f"type hashes of {wrong}"
    return counts


def with_mcap(folder):
    counts = {}
    for file in sorted(folder.glob("*.mcap")):
        with open(file, "rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            assert reader.get_header().profile == "ros2"
            for channel in reader.get_summary().channels.values():
                counts.setdefault(channel.topic, 0)
            for _, channel, _ in reader.iter_messages():
                counts[channel.topic] += 1
    return counts


def with_mcap_ros2(folder):
    counts = {}
    for file in sorted(folder.glob("*.mcap")):
        with open(file, "rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            for channel in reader.get_summary().channels.values():
                counts.setdefault(channel.topic, 0)
            for _, channel, _, _ in reader.iter_decoded_messages():
                counts[channel.topic] += 1
    return counts


if __name__ == "__main__":
    bag = pathlib.Path(sys.argv[1])
    readers = {"rosbags": with_rosbags, "mcap": with_mcap, "mcap-ros2-support": with_mcap_ros2}
    print(json.dumps({name: reader(bag) for name, reader in readers.items()}))
