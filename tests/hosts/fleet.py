"""Runs cells of more and more feeders with one arbiter, and prints what each costs: a row for each size.

    unshare --user --map-root-user --net --mount sh -c 'ip link set lo up && python3 fleet.py --feeder target/debug/feeder 1 3 10 30'

Feeders stand on a grid, one station each, every way reserved from the arbiter, pictures small. What all sockets of the network
namespace have received is counted, while the cell comes up and per simulated second after.
"""

import argparse
import json
import math
import os
import subprocess
import tempfile
import time

PITCH_M = 1.0


def scenario(base, feeders, simulated):
    """`base` with so many feeders, each with a station in front of it."""
    import yaml

    plan = yaml.safe_load(open(base))
    side = math.ceil(math.sqrt(feeders))
    places = [(PITCH_M * (n % side), PITCH_M * (n // side)) for n in range(feeders)]
    room = PITCH_M * side
    plan["seed"], plan["feeder"] = 1, "feeder_1"
    plan["run"] = {"duration_s": simulated}
    plan["courier"]["limits"] = {"x_m_min": -1.0, "x_m_max": room, "y_m_min": -1.0, "y_m_max": room}
    plan["courier"]["limits"]["tether_length_m"] = min(20.0, 4.0 * room)
    plan["courier"]["start"] = [0.0, 0.0, 0.0]
    plan["delivery"]["feeding_place"] = [0.0, 0.0, 0.0]
    plan["camera"]["model"]["pose"] = {"x_m": 0.0, "y_m": -0.045, "height_m": 0.5}
    plan["further_feeders"] = [{"name": f"feeder_{n + 1}", "x_m": x, "y_m": y} for n, (x, y) in enumerate(places) if n]
    template = plan["stations"][0]
    plan["stations"] = []
    for n, (x, y) in enumerate(places):
        station = json.loads(json.dumps(template))
        station["name"] = f"station_{n + 1}"
        station["x_m"], station["y_m"] = x + 0.1, y + 0.35
        # Every other one asks the neighbour too, so that ways cross.
        station["feeders"] = [f"feeder_{n + 1}"] + ([f"feeder_{n}"] if n % 2 else [])
        plan["stations"].append(station)
    if feeders == 1:
        plan.pop("further_feeders")
    return yaml.safe_dump(plan)


def received():
    with open("/proc/self/net/snmp") as snmp:
        names, values = [line.split() for line in snmp if line.startswith("Udp:")]
    counts = dict(zip(names[1:], map(int, values[1:])))
    with open("/proc/self/net/dev") as dev:
        loopback = next(line for line in dev if line.strip().startswith("lo:")).split()
    return counts["InDatagrams"], int(loopback[1]), counts["RcvbufErrors"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="+", type=int)
    parser.add_argument("--feeder", required=True)
    parser.add_argument("--base", default="launch_configs/three_feeders.yaml")
    parser.add_argument("--simulated", type=float, default=5.0)
    parser.add_argument("--patience", type=float, default=400.0, help="seconds for one cell")
    parser.add_argument("--processes", action="store_true", help="a process for each node")
    arguments = parser.parse_args()
    print("feeders  start s  factor  of all  delivered  reserve s  datagrams until start, per simulated s  MB  lost in buffers  end")
    for size in arguments.sizes:
        with tempfile.TemporaryDirectory() as folder:
            os.symlink(os.path.abspath(os.path.join(os.path.dirname(arguments.base), "models")), f"{folder}/models")
            with open(f"{folder}/cell.yaml", "w") as file:
                file.write(scenario(arguments.base, size, arguments.simulated))
            command = [arguments.feeder, "up", "--plain", "--scenario", f"{folder}/cell.yaml", "--summary", f"{folder}/s.json"]
            command += [] if arguments.processes else ["--composed"]
            environment = dict(os.environ, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", ROS_DOMAIN_ID="81", NO_COLOR="1")
            began, seen = time.monotonic(), [(0.0, received())]
            with open(f"{folder}/log", "w+") as log:
                run = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
                while run.poll() is None and time.monotonic() < began + arguments.patience:
                    time.sleep(0.02)
                    seen.append((time.monotonic() - began, received()))
                run.kill()
                run.wait()
                log.seek(0)
                said = log.read().strip().splitlines()
            summary = json.load(open(f"{folder}/s.json")) if os.path.exists(f"{folder}/s.json") else {}
            factor, startup = summary.get("real_time_factor") or 0.0, summary.get("startup_s") or 0.0
            first, last = seen[0][1], seen[-1][1]
            at_start = max((entry for entry in seen if entry[0] <= startup), default=seen[0])[1]
            coming_up, running = at_start[0] - first[0], (last[0] - at_start[0]) / arguments.simulated
            reserve = (summary.get("per_delivery_s") or {}).get("reserve")
            reasons = [line for line in said if any(word in line for word in ["panicked", "memory allocation", "error:"])] or said[-1:] or ["?"]
            end = "well" if run.returncode == 0 else reasons[0][:160]
            print(
                f"{size:7d}  {startup:7.1f}  {factor:6.2f}  {factor * size:6.1f}  {summary.get('delivered', 0):9d}  "
                f"{'-' if reserve is None else format(reserve, '.2f'):>9s}  {coming_up:21d}  {running:16.0f}  "
                f"{(last[1] - first[1]) / 1e6:4.0f}  {last[2] - first[2]:15d}  {end}",
                flush=True,
            )


if __name__ == "__main__":
    main()
