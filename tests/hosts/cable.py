"""A cable between network namespaces, in the middle one of them: delay, loss, no multicast, and cuts.

    ip netns exec MIDDLE python3 cable.py [--delay-ms 10] [--loss 0.01] [--no-multicast] [--seed 1] INTERFACE INTERFACE...

What comes in by one interface goes out by all others, as a switch does it, after a while, or not at all. A line `cut` on
the standard input takes the cable out, `mend` puts it back; the end of the input ends it. Prints `ready` first, and what
it has carried last.
"""

import argparse
import heapq
import json
import random
import select
import socket
import struct
import sys
import time

PACKET_OUTGOING = 4
UDP = 17


def opened(name):
    link = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
    link.bind((name, 0))
    # Promiscuous (SOL_PACKET, PACKET_ADD_MEMBERSHIP): frames for others are what it is about.
    request = struct.pack("iHH8s", socket.if_nametoindex(name), 1, 0, b"")
    link.setsockopt(263, 1, request)
    link.setblocking(False)
    return link


def carried(frame):
    """The frame, with no checksum over its datagram: the kernel leaves that to a network card, and there is none."""
    if frame[12:14] != b"\x08\x00" or frame[23] != UDP or int.from_bytes(frame[20:22]) & 0x1FFF:
        return frame
    at = 14 + 4 * (frame[14] & 0x0F) + 6
    return frame[:at] + b"\0\0" + frame[at + 2 :]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("interfaces", nargs="+")
    parser.add_argument("--delay-ms", type=float, default=0.0)
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--no-multicast", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    chance = random.Random(arguments.seed)
    links = [opened(name) for name in arguments.interfaces]
    delay = arguments.delay_ms / 1000
    waiting, number, is_cut = [], 0, False
    counts = dict(carried=0, bytes=0, lost=0, multicast_refused=0, cut=0)
    print("ready", flush=True)
    while True:
        wait = max(0.0, waiting[0][0] - time.monotonic()) if waiting else None
        ready, _, _ = select.select([*links, sys.stdin], [], [], wait)
        for link in ready:
            if link is sys.stdin:
                word = sys.stdin.readline()
                if not word:
                    print(json.dumps(counts), flush=True)
                    return
                is_cut = word.strip() == "cut"
                print(word.strip(), flush=True)
                continue
            for _ in range(64):
                try:
                    frame, address = link.recvfrom(65536)
                except (BlockingIOError, OSError):
                    break
                if address[2] == PACKET_OUTGOING:
                    continue
                is_multicast = frame[0] & 1 and frame[:6] != b"\xff" * 6
                if is_cut:
                    counts["cut"] += 1
                elif arguments.no_multicast and is_multicast:
                    counts["multicast_refused"] += 1
                elif chance.random() < arguments.loss:
                    counts["lost"] += 1
                else:
                    number += 1
                    heapq.heappush(waiting, (time.monotonic() + delay, number, links.index(link), carried(frame)))
        now = time.monotonic()
        while waiting and waiting[0][0] <= now:
            _, _, source, frame = heapq.heappop(waiting)
            for index, link in enumerate(links):
                if index != source:
                    try:
                        link.send(frame)
                    except OSError:
                        counts["lost"] += 1
                        continue
            counts["carried"] += 1
            counts["bytes"] += len(frame)


if __name__ == "__main__":
    main()
