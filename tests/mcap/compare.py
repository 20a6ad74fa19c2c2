#!/usr/bin/env python3
"""What recording costs, next to the Python mcap writer on the same messages, and how well playing keeps time.

    python3 -m venv VENV && VENV/bin/pip install -r tests/interop/requirements.txt
    cargo build --release && VENV/bin/python tests/mcap/compare.py

1. Runs the built-in scenario with its camera, composed and as fast as it goes, without and with --record of everything.
2. Writes the messages of that bag again: with the Python writer (reading them first, outside of the measurement), and
   with `feeder bag recover`, which reads and unpacks them too. Both pack chunks of 1 MiB with zstd.
3. Plays a topic of 1 kHz and prints the timing error that the player reports.

Sizes are those of the messages before packing. CPU is user and system time of the process.
"""

import argparse
import os
import pathlib
import resource
import shutil
import subprocess
import tempfile
import time

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as Ros2Writer

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]


def run(command):
    """Output, wall time and CPU time of a command."""
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True, env=environment)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout, wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def read(bag):
    """Schemas, channels and messages of a bag."""
    messages = []
    for file in sorted(bag.glob("*.mcap")):
        with open(file, "rb") as stream:
            reader = make_reader(stream)
            for schema, channel, message in reader.iter_messages():
                messages.append((schema, channel, message.log_time, message.data))
    return messages


def write_with_python(messages, path):
    """CPU time of writing these messages."""
    started = time.process_time()
    with open(path, "wb") as stream:
        writer = Writer(stream, chunk_size=1 << 20, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="compare.py")
        schemas, channels = {}, {}
        for schema, channel, log_time, data in messages:
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            writer.add_message(channels[channel.id], log_time, data, log_time)
        writer.finish()
    return time.process_time() - started


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--feeder", default=REPOSITORY / "target/release/feeder", help="the executable")
    parser.add_argument("--seconds", type=int, default=60, help="simulated seconds of the run")
    parser.add_argument("--play-seconds", type=int, default=20, help="seconds of the bag that is played")
    parser.add_argument("--domain", type=int, default=93, help="DDS domain")
    options = parser.parse_args()
    work = pathlib.Path(tempfile.mkdtemp())
    up = [options.feeder, "up", "--composed", "--domain", options.domain, "--duration", options.seconds]
    _, plain_wall, plain_cpu = run(up)
    _, wall, cpu = run([*up, "--record", work / "bag"])
    messages = read(work / "bag")
    size_mb = sum(len(data) for *_, data in messages) / 1e6
    packed_mb = sum(file.stat().st_size for file in (work / "bag").glob("*.mcap")) / 1e6
    print(f"{options.seconds} s of the built-in scenario: {len(messages)} messages, {size_mb:.0f} MB, {packed_mb:.0f} MB in the bag")
    print(f"  without recording {plain_wall:.1f} s wall, {plain_cpu:.1f} s CPU")
    print(f"  with recording    {wall:.1f} s wall, {cpu:.1f} s CPU: {len(messages) / wall:.0f} messages/s, {size_mb / wall:.0f} MB/s")
    python_cpu = write_with_python(messages, work / "python.mcap")
    _, _, own_cpu = run([options.feeder, "bag", "recover", work / "bag", "--out", work / "again"])
    for name, seconds in (("Python mcap writer", python_cpu), ("feeder bag recover, reading included", own_cpu)):
        print(f"{name}: {seconds:.2f} s CPU, {size_mb / seconds:.0f} MB and {len(messages) / seconds:.0f} messages a CPU second")
    with open(work / "khz.mcap", "wb") as stream, Ros2Writer(stream) as writer:
        text = writer.register_msgdef("std_msgs/msg/String", "string data\n")
        for i in range(1000 * options.play_seconds):
            writer.write_message("/text", text, {"data": f"message {i}"}, i * 1_000_000, i * 1_000_000, i)
    played, _, cpu = run([options.feeder, "bag", "play", "--domain", options.domain, work / "khz.mcap"])
    print(f"playing 1000 messages/s for {options.play_seconds} s, {cpu:.1f} s CPU: " + "; ".join(played.splitlines()))
    shutil.rmtree(work)


if __name__ == "__main__":
    main()
