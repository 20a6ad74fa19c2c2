"""A peer that relays raw CDR between its standard streams and Cyclone DDS, with requests in the form of rmw_cyclonedds.

    client NAME REQUEST_TOPIC REQUEST_TYPE REPLY_TOPIC RESPONSE_TYPE
    call NAME NUMBER HEX                 a request; HEX begins with the encapsulation header
    reader NAME TOPIC TYPE RELIABILITY DURABILITY
    writer NAME TOPIC TYPE RELIABILITY DURABILITY
    write NAME HEX

It answers with `matched NAME` when the other side has been found, `reply NAME NUMBER HEX`, `sample NAME HEX`,
`again NAME NUMBER` for a reply that came before, and `stray NAME` for one that answers no request of this client. It
leaves at the end of its input.
"""

import functools
import os
import random
import select
import sys

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

ENCAPSULATION_BYTES = 4
RELIABILITY = {
    "reliable": Policy.Reliability.Reliable(duration(milliseconds=100)),
    "best_effort": Policy.Reliability.BestEffort,
}
DURABILITY = {"volatile": Policy.Durability.Volatile, "latched": Policy.Durability.TransientLocal}


def raw_sample(kind, data):
    sample = kind(0)
    sample.bytes = bytes(data)
    return sample


@functools.cache
def raw_type(name):
    """A type of any name whose samples pass encoder and decoder as bytes; its one field is never looked at."""
    kind = make_idl_struct("Raw", name, {"unused": uint8})
    kind.serialize = lambda sample, *_, **__: sample.bytes
    kind.deserialize = classmethod(lambda kind, data, *_, **__: raw_sample(kind, data))
    return kind


def qos(reliability, durability):
    # ROS 2 writes plain CDR (XCDR1), and so does every peer of it.
    plain = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
    return Qos(RELIABILITY[reliability], DURABILITY[durability], Policy.History.KeepLast(10), plain)


class End:
    """One reader, one writer, or the two of a client."""

    def __init__(self):
        self.reader = self.writer = self.kind = None
        self.matched = False
        self.id = random.randbytes(8)
        self.open = set()
        self.answered = set()

    def is_matched(self):
        reading = not self.reader or bool(self.reader.get_matched_publications())
        return reading and (not self.writer or bool(self.writer.get_matched_subscriptions()))

    def write(self, data):
        self.writer.write(raw_sample(self.kind, data))


class Peer:
    def __init__(self, domain):
        self.participant = DomainParticipant(domain)
        self.ends = {}

    def obey(self, line):
        command, name, *words = line.split()
        end = self.ends.setdefault(name, End())
        if command == "client":
            self.open_writer(end, words[0], words[1], "reliable", "volatile")
            self.open_reader(end, words[2], words[3], "reliable", "volatile")
        elif command == "reader":
            self.open_reader(end, *words)
        elif command == "writer":
            self.open_writer(end, *words)
        elif command == "call":
            # As rmw_cyclonedds: the client's name and the request's number before the body.
            number, data = int(words[0]), bytes.fromhex(words[1])
            header = end.id + number.to_bytes(8, "little", signed=True)
            end.open.add(number)
            end.write(data[:ENCAPSULATION_BYTES] + header + data[ENCAPSULATION_BYTES:])
        elif command == "write":
            end.write(bytes.fromhex(words[0]))
        else:
            sys.exit(f"no such command: {line}")

    def open_reader(self, end, name, kind, *policies):
        topic = Topic(self.participant, name, raw_type(kind))
        end.reader = DataReader(self.participant, topic, qos=qos(*policies))

    def open_writer(self, end, name, kind, *policies):
        end.kind = raw_type(kind)
        end.writer = DataWriter(self.participant, Topic(self.participant, name, end.kind), qos=qos(*policies))

    def report(self):
        """Says what has been found and received since the last call."""
        for name, end in self.ends.items():
            if not end.matched and end.is_matched():
                end.matched = True
                print(f"matched {name}", flush=True)
            for sample in end.reader.take(N=100) if end.reader else ():
                if sample.sample_info.valid_data:
                    self.received(name, end, sample.bytes)

    def received(self, name, end, data):
        if not end.writer:
            print(f"sample {name} {data.hex()}", flush=True)
            return
        at = ENCAPSULATION_BYTES
        client, number = data[at : at + 8], int.from_bytes(data[at + 8 : at + 16], "little", signed=True)
        if client != end.id or number not in end.open | end.answered:
            print(f"stray {name}", flush=True)
            return
        if number in end.answered:
            print(f"again {name} {number}", flush=True)
            return
        end.open.remove(number)
        end.answered.add(number)
        print(f"reply {name} {number} {(data[:at] + data[at + 16 :]).hex()}", flush=True)


def main():
    peer = Peer(int(sys.argv[1]))
    text = b""
    while True:
        # Woken by a command, else every millisecond for what has come over the network.
        if select.select([sys.stdin], [], [], 0.001)[0]:
            chunk = os.read(sys.stdin.fileno(), 65536)
            if not chunk:
                return
            *lines, text = (text + chunk).split(b"\n")
            for line in lines:
                peer.obey(line.decode())
        peer.report()


if __name__ == "__main__":
    main()
