"""Tries every range of discovery of a node against every one of a listener, and prints who is heard: a row for each pair.

    python3 ranges.py --feeder target/debug/feeder

A node runs on one host, a network namespace, and recorders listen on the same one and on another: without static peers, with
the node's host naming the other, and with the other naming the node's. As root, with iproute2.
"""

import argparse
import itertools
import os
import subprocess
import sys
import tempfile

from hosts import Hosts

RANGES = ["SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT"]
NODE, OTHER = "10.71.0.1", "10.71.0.2"
# Where the listener is, whom the node names, whom the listener names.
PLACES = [(1, "", ""), (2, "", ""), (2, OTHER, ""), (2, "", NODE), (2, OTHER, NODE)]


def expected(node, listener, place, named_by_node, named_by_listener):
    """What docs/how-to/several_hosts.md says."""
    if "OFF" in (node, listener):
        return False
    if place == 1:
        return True
    # Static peers count with these alone.
    names = [named_by_node and node != "SYSTEM_DEFAULT", named_by_listener and listener != "SYSTEM_DEFAULT"]
    lets_in = [node != "LOCALHOST" or names[0], listener != "LOCALHOST" or names[1]]
    finds = any(names) or "LOCALHOST" not in (node, listener)
    return bool(all(lets_in) and finds)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--feeder", required=True)
    parser.add_argument("--scenario", default="launch_configs/three_feeders.yaml")
    arguments = parser.parse_args()
    arguments.feeder, arguments.scenario = os.path.abspath(arguments.feeder), os.path.abspath(arguments.scenario)
    hosts, good = Hosts(2, "0,0"), True
    try:
        print("node            listener        same host  other host  node names it  it names node  both")
        for number, (node, listener) in enumerate(itertools.product(RANGES, RANGES)):
            with tempfile.TemporaryDirectory() as folder:
                nodes, listeners = [], []
                for at, (place, named_by_node, named_by_listener) in enumerate(PLACES):
                    domain = str(1 + (len(PLACES) * number + at) % 100)

                    def start(host, discovery, peers, *command):
                        environment = dict(os.environ, ROS_DOMAIN_ID=domain, ROS_AUTOMATIC_DISCOVERY_RANGE=discovery, ROS_STATIC_PEERS=peers)
                        command = ["ip", "netns", "exec", hosts.names[host], arguments.feeder, *command]
                        return subprocess.Popen(command, env=environment, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

                    nodes.append(start(1, node, named_by_node, "node", "platen_arbiter", "--", "--config", arguments.scenario))
                    record = ["bag", "record", "--topics", "/diagnostics", "--duration", "5", "--out", f"{folder}/{at}"]
                    listeners.append(start(place, listener, named_by_listener, *record))
                for process in listeners:
                    process.wait(60)
                for process in nodes:
                    process.terminate()
                for process in nodes:
                    process.wait(20)
                words = []
                for at, place in enumerate(PLACES):
                    said = subprocess.run([arguments.feeder, "bag", "info", f"{folder}/{at}"], capture_output=True, text=True).stdout
                    heard = "/diagnostics" in said
                    right = heard == expected(node, listener, *place)
                    good &= right
                    words.append(("heard" if heard else "-") + ("" if right else " (!)"))
            print(f"{node:14s}  {listener:14s}  {words[0]:9s}  {words[1]:10s}  {words[2]:13s}  {words[3]:13s}  {words[4]}", flush=True)
    finally:
        hosts.close()
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
