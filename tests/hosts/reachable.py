"""Tries to reach a running suite from another host, and prints what answers: a row for each range of discovery.

    python3 reachable.py --feeder target/debug/feeder [RANGE[,PEER]...]

On one host, a network namespace, the suite runs; from another a stranger announces itself to every port a participant may
have, and counts who answers. As root, with iproute2.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time

from hosts import HERE, Hosts

STRANGER = """
import random, socket, sys, time
sys.path.insert(0, sys.argv[1])
from attack import Stranger
stranger = Stranger(74, "10.71.0.1", 40, random.Random(1))
stranger.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
stranger.socket.settimeout(0.1)
heard, until = set(), time.monotonic() + 5
datagrams = 0
while time.monotonic() < until:
    stranger.announce()
    for _ in range(20):
        try:
            message, sender = stranger.socket.recvfrom(65536)
        except TimeoutError:
            break
        datagrams += 1
        heard.add(message[8:20])
print(datagrams, len(heard))
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("settings", nargs="*", default=["LOCALHOST", "LOCALHOST,10.71.0.3", "LOCALHOST,10.71.0.2", "SUBNET"])
    parser.add_argument("--feeder", required=True)
    arguments = parser.parse_args()
    arguments.feeder = os.path.abspath(arguments.feeder)
    print("range      static peers  stranger at 10.71.0.2 hears: datagrams  participants  datagrams dropped at the suite's sockets")
    good = True
    for setting in arguments.settings:
        discovery, _, peers = setting.partition(",")
        hosts = Hosts(2, "0,0")
        try:
            environment = dict(os.environ, ROS_DOMAIN_ID="74", ROS_AUTOMATIC_DISCOVERY_RANGE=discovery, ROS_STATIC_PEERS=peers, NO_COLOR="1")
            inside = lambda number, *command: ["ip", "netns", "exec", hosts.names[number], *command]
            with tempfile.TemporaryFile("w+") as log:
                command = inside(1, arguments.feeder, "up", "--plain", "--speed", "1", "--duration", "60")
                run = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
                time.sleep(4)
                said = subprocess.run(inside(2, sys.executable, "-c", STRANGER, HERE), capture_output=True, text=True, check=True).stdout
                table = subprocess.run(inside(1, "cat", "/proc/net/udp"), capture_output=True, text=True).stdout
                run.terminate()
                run.wait(30)
        finally:
            hosts.close()
        datagrams, participants = map(int, said.split())
        drops = sum(int(line.split()[-1]) for line in table.splitlines()[1:])
        print(f"{discovery:9s}  {peers or '-':12s}  {datagrams:40d}  {participants:12d}  {drops:10d}", flush=True)
        may_hear = discovery == "SUBNET" or "10.71.0.2" in peers
        good &= (participants > 0) == may_hear
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
