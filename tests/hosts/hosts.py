"""Runs the suite over several hosts, which are network namespaces, and prints what came of it: a row for each link.

    python3 hosts.py --feeder target/debug/feeder [--hosts 2] [--simulated 10] [--cut 0] LINK...

A LINK is DELAY_MS,LOSS or DELAY_MS,LOSS,nomulticast, as 5,0.01,nomulticast: then hosts find each other as static peers. The
first row is one host by itself; every digest must be the same. As root, with iproute2.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time

HERE = os.path.dirname(os.path.abspath(__file__))
SHARES = {2: [["vision_selector", "delivery_planner", "overhead_manipulator"]], 3: [["vision_selector"], ["delivery_planner", "overhead_manipulator"]]}


def ip(*words):
    subprocess.run(["ip", *words], check=True)


class Hosts:
    """Namespaces, joined by a cable in one more."""

    def __init__(self, count, link):
        self.names = [f"fdr{os.getpid() % 10000}h{number}" for number in range(count + 1)]
        self.switch = self.names[0]
        delay, loss, *words = link.split(",")
        ip("netns", "add", self.switch)
        for number, name in enumerate(self.names[1:], 1):
            ip("netns", "add", name)
            ip("-n", name, "link", "add", "cable", "type", "veth", "peer", "name", f"p{number}", "netns", self.switch)
            ip("-n", name, "addr", "add", f"10.71.0.{number}/24", "dev", "cable")
            for device in ["lo", "cable"]:
                ip("-n", name, "link", "set", device, "up")
            ip("-n", name, "route", "add", "default", "dev", "cable")
            ip("-n", self.switch, "link", "set", f"p{number}", "up")
        command = ["ip", "netns", "exec", self.switch, sys.executable, f"{HERE}/cable.py", "--delay-ms", delay, "--loss", loss]
        if "nomulticast" in words:
            command.append("--no-multicast")
        command += [f"p{number}" for number in range(1, count + 1)]
        self.cable = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.cable.stdout.readline() == "ready\n"
        self.peers = ";".join(f"10.71.0.{number}" for number in range(1, count + 1)) if "nomulticast" in words else ""

    def start(self, number, command, log):
        environment = dict(os.environ, ROS_DOMAIN_ID="74", ROS_STATIC_PEERS=self.peers, NO_COLOR="1")
        environment.pop("ROS_AUTOMATIC_DISCOVERY_RANGE", None)
        command = ["ip", "netns", "exec", self.names[number], *command]
        return subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def say(self, word):
        self.cable.stdin.write(word + "\n")
        self.cable.stdin.flush()

    def close(self):
        self.cable.stdin.close()
        said = self.cable.stdout.read().split("\n")
        self.cable.wait()
        for name in self.names:
            ip("netns", "del", name)
        return json.loads([line for line in said if line.startswith("{")][-1])


def run(arguments, hosts, folder, tag):
    """One run; nothing of `hosts` is one host by itself."""
    digest, summary = f"{folder}/{tag}.digest", f"{folder}/{tag}.json"
    log = open(f"{folder}/{tag}.log", "w+")
    up = [arguments.feeder, "up", "--plain", "--duration", str(arguments.simulated), "--digest", digest, "--summary", summary]
    up += ["--speed", arguments.speed]
    if arguments.scenario:
        up += ["--scenario", arguments.scenario]
    began = time.monotonic()
    if hosts is None:
        environment = dict(os.environ, ROS_DOMAIN_ID="74", ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", NO_COLOR="1")
        everybody = [subprocess.Popen(up, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)]
    else:
        shares = SHARES[len(hosts.names) - 1]
        up += ["--except", ",".join(sum(shares, []))]
        everybody = [hosts.start(1, up, log)]
        for number, share in enumerate(shares, 2):
            everybody.append(hosts.start(number, [arguments.feeder, "join", *(f"/feeder/{name}" if name != "overhead_manipulator" else f"/station_1/{name}" for name in share)], log))
    if hosts and arguments.cut:
        time.sleep(arguments.cut_at)
        hosts.say("cut")
        time.sleep(arguments.cut)
        hosts.say("mend")
    codes = []
    for process in everybody:
        try:
            codes.append(process.wait(arguments.patience))
        except subprocess.TimeoutExpired:
            process.kill()
            codes.append("killed")
    took = time.monotonic() - began
    log.seek(0)
    text = log.read()
    result = json.load(open(summary)) if os.path.exists(summary) else {}
    lines = open(digest).read() if os.path.exists(digest) else ""
    return dict(codes=codes, took=took, factor=result.get("real_time_factor"), startup=result.get("startup_s"), digest=lines, log=text)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("links", nargs="+", metavar="LINK")
    parser.add_argument("--feeder", required=True)
    parser.add_argument("--hosts", type=int, default=2)
    parser.add_argument("--scenario")
    parser.add_argument("--simulated", type=float, default=10.0)
    parser.add_argument("--speed", default="max")
    parser.add_argument("--cut", type=float, default=0.0, help="seconds without the cable")
    parser.add_argument("--cut-at", type=float, default=8.0, help="seconds after the start")
    parser.add_argument("--patience", type=float, default=240.0)
    parser.add_argument("--keep", help="folder for logs")
    arguments = parser.parse_args()
    arguments.feeder = os.path.abspath(arguments.feeder)
    good = True
    with tempfile.TemporaryDirectory() as folder:
        folder = arguments.keep or folder
        print("hosts  link                     exits          start s  factor  digest    frames carried/lost")
        alone = run(arguments, None, folder, "alone")
        print(f"{1:5d}  {'none':23s}  {str(alone['codes']):13s}  {alone['startup']:7.1f}  {alone['factor']:6.2f}  {len(alone['digest'].splitlines())} topics", flush=True)
        for link in arguments.links:
            hosts = Hosts(arguments.hosts, link)
            try:
                outcome = run(arguments, hosts, folder, link)
            finally:
                carried = hosts.close()
            same = outcome["digest"] == alone["digest"]
            good &= same
            number = lambda value, form: format(value, form) if value is not None else "-"
            print(
                f"{arguments.hosts:5d}  {link:23s}  {str(outcome['codes']):13s}  {number(outcome['startup'], '7.1f'):>7s}  "
                f"{number(outcome['factor'], '6.2f'):>6s}  {'same' if same else 'OTHER':8s}  {carried['carried']}/{carried['lost']}",
                flush=True,
            )
            if not same:
                print("\n".join("    " + line[:220] for line in outcome["log"].splitlines()[-12:]))
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
